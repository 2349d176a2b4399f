//! Rows of some of an estimator's sources to some of its targets, for estimators that see all targets at once.
//!
//! A row is that of all targets with entries left away, so that it does not matter to any entry which others are asked for: seeds go by
//! the numbers of all sources. [`Cost::form_factors`](radiosity_core::Cost) counts entries that are given. Pairwise estimators need none of this
//! ([`crate::Numbers`]): they compute what is asked for and nothing else. What is *not* here: targets drawn without a row.

use radiosity_core::{Cost, StoreError};

use crate::rows::{Rows, SparseRow};

/// Some rows of an estimator, and some of their entries.
pub struct SelectedRows<'a> {
    rows: Box<dyn Rows + 'a>,
    sources: Vec<u32>,
    /// Number among the selected of every target, or [`NONE`].
    place: Vec<u32>,
    targets: usize,
}

/// Not selected.
const NONE: u32 = u32::MAX;

impl<'a> SelectedRows<'a> {
    /// The rows of `sources` to `targets`, both ascending.
    ///
    /// # Panics
    ///
    /// If there is no such source or target.
    pub fn new(rows: Box<dyn Rows + 'a>, sources: Vec<u32>, targets: &[u32]) -> Self {
        assert!(sources.iter().all(|&s| (s as usize) < rows.sources()), "sources lie below {}", rows.sources());
        let mut place = vec![NONE; rows.targets()];
        (0..).zip(targets).for_each(|(k, &t)| place[t as usize] = k);
        Self { rows, sources, place, targets: targets.len() }
    }
}

impl Rows for SelectedRows<'_> {
    fn name(&self) -> &'static str {
        self.rows.name()
    }

    fn sources(&self) -> usize {
        self.sources.len()
    }

    fn targets(&self) -> usize {
        self.targets
    }

    fn symmetric(&self) -> bool {
        false
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        let mut row = SparseRow::default();
        let spent = self.sparse_row(s, &mut row)?;
        row.spread(values);
        Ok(spent)
    }

    fn sparse_row(&self, s: usize, row: &mut SparseRow) -> Result<(Cost, f64), StoreError> {
        let (mut cost, bound) = self.rows.sparse_row(self.sources[s] as usize, row)?;
        cost.form_factors = cost.form_factors.saturating_sub((self.place.len() - self.targets) as u64);
        row.entries.retain_mut(|(t, _)| {
            *t = self.place[*t as usize];
            *t != NONE
        });
        Ok((cost, bound))
    }
}
