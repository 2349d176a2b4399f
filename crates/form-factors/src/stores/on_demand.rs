//! Rows computed when they are asked for.

use std::sync::OnceLock;

use radiosity_core::{
    Cost, DrawBuf, Drawn, Draws, Entries, FormFactors, Properties, Row, RowBuf, StoreError, sample_by_rows,
};

use super::{check_memory, check_row};
use crate::{Rows, Sampler};

/// What [`OnDemand`] does with a row it has computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// Keeps it: a row is computed once, when first asked for.
    All,
    /// Forgets it: a row is computed each time it is asked for, and nothing is held.
    None,
}

/// Exchange areas from an estimator, a row at a time as solvers ask.
///
/// The cost of computing a row is in the cost of the call that asked. A kept row is computed outside its lock and then
/// set, so an estimator may use all threads itself; only where two calls ask for the same new row at the same time
/// (no solver does) is it computed, and counted, twice.
pub struct OnDemand<'a> {
    rows: Box<dyn Rows + 'a>,
    kept: Vec<OnceLock<Box<[f64]>>>,
}

impl<'a> OnDemand<'a> {
    /// A store over the rows of an estimator.
    pub fn new(rows: Box<dyn Rows + 'a>, keep: Keep) -> Self {
        let kept = if keep == Keep::All { rows.sources() } else { 0 };
        Self { rows, kept: (0..kept).map(|_| OnceLock::new()).collect() }
    }

    /// [`Self::new`], refused if keeping every row could take more than `limit` bytes (8 a pair).
    ///
    /// # Errors
    ///
    /// [`StoreError::Memory`].
    pub fn within(rows: Box<dyn Rows + 'a>, keep: Keep, limit: Option<u64>) -> Result<Self, StoreError> {
        let (sources, targets) = (rows.sources(), rows.targets());
        let needed = if keep == Keep::All { 8 * sources as u64 * targets as u64 } else { 0 };
        check_memory(sources, targets, needed, limit)?;
        Ok(Self::new(rows, keep))
    }

    /// What is done with rows.
    pub fn keep(&self) -> Keep {
        if self.kept.is_empty() { Keep::None } else { Keep::All }
    }

    /// What draws targets without a row: that of the estimator, unless rows are kept, which then are what there is to draw from.
    fn sampler(&self) -> Option<&dyn Sampler> {
        self.rows.sampler().filter(|_| self.keep() == Keep::None)
    }

    /// Number of rows held now.
    pub fn rows_held(&self) -> usize {
        self.kept.iter().filter(|row| row.get().is_some()).count()
    }
}

impl std::fmt::Debug for OnDemand<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (name, sources, targets) = (self.rows.name(), self.sources(), self.targets());
        write!(f, "OnDemand {{ {name}, {sources} × {targets}, keeps {:?} }}", self.keep())
    }
}

impl FormFactors for OnDemand<'_> {
    fn name(&self) -> &'static str {
        match self.keep() {
            Keep::All => "on-demand-kept",
            Keep::None => "on-demand",
        }
    }

    fn sources(&self) -> usize {
        self.rows.sources()
    }

    fn targets(&self) -> usize {
        self.rows.targets()
    }

    fn properties(&self) -> Properties {
        let stored_bytes = 8 * self.targets() as u64 * self.rows_held() as u64;
        Properties { symmetric: self.rows.symmetric(), per_band: false, stored_bytes, rounding: 0.0 }
    }

    fn row<'b>(&'b self, s: usize, _band: usize, buf: &'b mut RowBuf) -> Result<Row<'b>, StoreError> {
        if let Some(kept) = self.kept.get(s).and_then(OnceLock::get) {
            return Ok(Row { entries: Entries::Dense(kept), cost: Cost::default() });
        }
        buf.values.clear();
        buf.values.resize(self.targets(), 0.0);
        let (cost, _) = self.rows.row(s, &mut buf.values)?;
        check_row(s, 0, &buf.values)?;
        let values: &[f64] = match self.kept.get(s) {
            Some(cell) => cell.get_or_init(|| buf.values.as_slice().into()),
            None => &buf.values,
        };
        Ok(Row { entries: Entries::Dense(values), cost })
    }

    fn sample(
        &self,
        s: usize,
        band: usize,
        area: f64,
        draws: &mut [Draws<'_>],
        buf: &mut DrawBuf,
    ) -> Result<Drawn, StoreError> {
        match self.sampler() {
            Some(sampler) => Ok(sampler.sample(s, draws)),
            None => sample_by_rows(self, s, band, area, draws, buf),
        }
    }

    fn draws_from_rows(&self) -> bool {
        self.sampler().is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Table, values};
    use super::*;
    use radiosity_core::BandValues;

    fn store(keep: Keep) -> OnDemand<'static> {
        OnDemand::new(Box::new(Table { sources: 9, targets: 13 }), keep)
    }

    /// Cost of one gather.
    fn gather(store: &OnDemand<'_>) -> Cost {
        store.gather(values(2, 13).view(), BandValues::zeros(2, 9).view_mut()).unwrap()
    }

    #[test]
    fn a_kept_row_is_paid_for_once() {
        let store = store(Keep::All);
        let (first, second) = (gather(&store), gather(&store));
        assert_eq!((first.form_factors, second.form_factors), (9 * 13, 0));
        assert_eq!((first.entries, second.entries), (9 * 13, 9 * 13));
        assert_eq!(store.properties().stored_bytes, 8 * 9 * 13);
    }

    #[test]
    fn a_row_that_is_not_kept_is_paid_for_each_time_and_takes_no_memory() {
        let store = store(Keep::None);
        assert_eq!((gather(&store).form_factors, gather(&store).form_factors), (9 * 13, 9 * 13));
        assert_eq!(store.properties().stored_bytes, 0);
    }

    #[test]
    fn a_scatter_computes_only_rows_that_shoot() {
        let store = store(Keep::All);
        let mut x = BandValues::zeros(2, 9);
        x.band_mut(0)[4] = 1.0;
        let cost = store.scatter(x.view(), BandValues::zeros(2, 13).view_mut()).unwrap();
        assert_eq!((cost.source_evaluations, store.rows_held()), (1, 1));
    }

    #[test]
    fn keeping_more_than_the_limit_is_refused_and_keeping_nothing_is_not() {
        let rows = || Box::new(Table { sources: 9, targets: 13 });
        let error = StoreError::Memory { sources: 9, targets: 13, needed: 936, limit: 900 };
        assert_eq!(OnDemand::within(rows(), Keep::All, Some(900)).map(|_| ()), Err(error));
        assert!(OnDemand::within(rows(), Keep::None, Some(900)).is_ok());
    }
}
