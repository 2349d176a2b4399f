//! Rows of which most entries are known from before a change.
//!
//! | rows | kept are | computed are |
//! |---|---|---|
//! | [`UpdatedPairs`] of a pairwise estimator | pairs of facets that were there before and that no changed blocker can reach | all other pairs |
//! | [`UpdatedRows`] of a row-wise one | rows of sources that were there before and look at nothing that changed | all other rows, whole |
//!
//! Both are [`Rows`], so that every store can be filled with them. What is kept is what is stored: a copy of values that were computed
//! once. Bounds of rows do not shrink: a row with a kept entry has at least the bound that it had.

use radiosity_core::{Cost, RowBuf, StoreError};
use radiosity_geometry::FacetMap;

use crate::analytic::{Analytic, BlockerChange, Sides};
use crate::stores::Held;
use crate::{PairwiseRows, Rows};

/// A store from before the change, and where its sources and targets are now.
#[derive(Clone, Copy)]
pub struct Before<'a> {
    /// The store.
    pub store: &'a dyn Held,
    /// Where the sources were and are.
    pub sources: &'a FacetMap,
    /// Where the targets were and are; the same object as `sources` if rows are symmetric.
    pub targets: &'a FacetMap,
}

impl<'a> Before<'a> {
    /// Itself, if its maps lead from the store's sources and targets to those of `rows`.
    fn check(self, rows: &dyn Rows) -> Self {
        let (sources, targets) = (self.sources, self.targets);
        let sizes =
            [(sources.later().len(), targets.later().len()), (sources.earlier().len(), targets.earlier().len())];
        let has = [(self.store.sources(), self.store.targets()), (rows.sources(), rows.targets())];
        assert_eq!(sizes, has, "facets before and after the change");
        self
    }

    /// Row `old` of the store in the order of the targets now, from target `first` on, zeros where a target is new; the row's bound.
    fn copy(&self, old: u32, first: usize, values: &mut [f64]) -> Result<f64, StoreError> {
        values[first..].fill(0.0);
        let (mut buf, later) = (RowBuf::default(), self.targets.later());
        self.store.row(old as usize, 0, &mut buf)?.entries.for_each(|t, value| {
            if let Some(t) = later[t].map(|t| t as usize).filter(|&t| t >= first) {
                values[t] = value;
            }
        });
        Ok(self.store.bound(old as usize).unwrap_or(f64::INFINITY))
    }
}

/// Rows of pairs of which those are computed that can have changed.
///
/// The kept values are those that the estimator would give again, to the last bit if it computes partly blocked pairs exactly and the store
/// holds double precision. Where it tests segments, the seed of a pair depends on its indices: then a kept value is another sample of the
/// same error if facets were added or removed before it.
pub struct UpdatedPairs<'a> {
    rows: PairwiseRows<'a, Analytic<'a>>,
    before: Before<'a>,
    change: BlockerChange,
    sources: Sides,
    /// `None` where targets are the sources.
    targets: Option<Sides>,
}

impl<'a> UpdatedPairs<'a> {
    /// `rows` after a change of blockers, of which `before` holds what was computed.
    ///
    /// # Panics
    ///
    /// If `before` is not of as many sources and targets, earlier and now.
    pub fn new(rows: PairwiseRows<'a, Analytic<'a>>, before: Before<'a>, change: BlockerChange) -> Self {
        let before = before.check(&rows);
        let sources = change.sides(rows.source_facets());
        let targets = (!rows.symmetric()).then(|| change.sides(rows.target_facets()));
        Self { rows, before, change, sources, targets }
    }

    /// Whether the pair of s and t must be computed, both having been there before.
    fn reached(&self, s: usize, t: usize) -> bool {
        let targets = self.targets.as_ref().unwrap_or(&self.sources);
        let polygons = self.rows.run(s, t).polygons(t).map(|(i, j, _)| (i, j));
        self.change.reaches((&self.sources, s), (targets, t), polygons)
    }

    fn fill(&self, s: usize, first: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        let mut cost = Cost { source_evaluations: 1, ..Cost::default() };
        let Some(old) = self.before.sources.earlier()[s] else {
            let (spent, bound) = self.rows.part(s, first, &mut values[first..]);
            return Ok((cost + spent, bound));
        };
        let mut bound = self.before.copy(old, first, values)?;
        let earlier = self.before.targets.earlier();
        let stale = |t: &usize| earlier[*t].is_none() || self.reached(s, *t);
        // Neighbours change together: runs of them go to the estimator at once.
        let (mut t, mut computed) = (first, false);
        while let Some(begin) = (t..values.len()).find(stale) {
            t = (begin + 1..values.len()).find(|t| !stale(t)).unwrap_or(values.len());
            let (spent, run_bound) = self.rows.part(s, begin, &mut values[begin..t]);
            (cost, bound, computed) = (cost + spent, bound.max(run_bound), true);
        }
        cost.source_evaluations = u64::from(computed);
        Ok((cost, bound))
    }
}

impl Rows for UpdatedPairs<'_> {
    fn name(&self) -> &'static str {
        self.rows.name()
    }

    fn sources(&self) -> usize {
        self.rows.sources()
    }

    fn targets(&self) -> usize {
        self.rows.targets()
    }

    fn symmetric(&self) -> bool {
        self.rows.symmetric()
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        self.fill(s, 0, values)
    }

    fn upper_row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        self.fill(s, if self.symmetric() { s } else { 0 }, values)
    }
}

/// Rows of a row-wise estimator of which those are computed that can have changed.
pub struct UpdatedRows<'a> {
    rows: Box<dyn Rows + 'a>,
    before: Before<'a>,
    /// Whether the row of a source is as it was.
    kept: Vec<bool>,
}

impl<'a> UpdatedRows<'a> {
    /// `rows` after a change, of which `before` holds those of the sources that `kept` names; sources that are new are computed in any case.
    ///
    /// # Panics
    ///
    /// If `before` is not of as many sources and targets, earlier and now, or `kept` not of as many sources.
    pub fn new(rows: Box<dyn Rows + 'a>, before: Before<'a>, kept: Vec<bool>) -> Self {
        let before = before.check(&*rows);
        assert_eq!(kept.len(), rows.sources(), "whether each row is kept");
        Self { rows, before, kept }
    }
}

impl Rows for UpdatedRows<'_> {
    fn name(&self) -> &'static str {
        self.rows.name()
    }

    fn sources(&self) -> usize {
        self.rows.sources()
    }

    fn targets(&self) -> usize {
        self.rows.targets()
    }

    fn symmetric(&self) -> bool {
        self.rows.symmetric()
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        match self.before.sources.earlier()[s] {
            Some(old) if self.kept[s] => Ok((Cost::default(), self.before.copy(old, 0, values)?)),
            _ => self.rows.row(s, values),
        }
    }
}
