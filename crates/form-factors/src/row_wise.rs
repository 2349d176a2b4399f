//! What row-wise estimators share: who receives, and how a source's own frame is turned.

use radiosity_geometry::Facets;

/// The facets that a row-wise estimator looks at, and the target each one counts for.
#[derive(Clone, Copy, Debug)]
pub struct Receivers<'a> {
    facets: &'a Facets,
    group: Option<&'a [u32]>,
    count: usize,
}

impl<'a> Receivers<'a> {
    /// Every facet is a target of its own.
    pub fn facets(facets: &'a Facets) -> Self {
        Self { facets, group: None, count: facets.len() }
    }

    /// Facet k counts for target `group[k]` of `count`: elements gathered to their patches.
    ///
    /// # Panics
    ///
    /// If `group` does not name one of `count` targets for every facet.
    pub fn grouped(facets: &'a Facets, group: &'a [u32], count: usize) -> Self {
        assert_eq!(group.len(), facets.len(), "a group for every facet");
        assert!(group.iter().all(|&g| (g as usize) < count), "groups lie below {count}");
        Self { facets, group: Some(group), count }
    }

    /// The facets looked at.
    pub fn all(&self) -> &'a Facets {
        self.facets
    }

    /// Number of targets.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The target that facet `k` counts for, if it receives at all.
    pub fn target(&self, k: usize) -> Option<usize> {
        (!self.facets.covered(k)).then(|| self.group.map_or(k, |group| group[k] as usize))
    }
}
