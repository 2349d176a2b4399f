//! Rows kept one by one, for sources and targets that are cut between solutions.

use radiosity_core::{Bands, BandsMut, Cost, Entries, FormFactors, Properties, Row, RowBuf, StoreError};
use rayon::prelude::*;

use super::{assert_lengths, by_pieces, check_row, dot};

/// Exchange areas A_s F_st in rows of their own, 8 bytes a pair.
///
/// Where [`super::DenseFormFactors`] is one matrix of fixed size, here a row can move to another place in the list of sources without
/// being computed or copied: [`Self::rearranged`] takes what it can from the store before and asks for the rest.
#[derive(Clone, Debug, Default)]
pub struct MovableFormFactors {
    rows: Vec<Held>,
    targets: usize,
}

#[derive(Clone, Debug)]
struct Held {
    values: Box<[f64]>,
    bound: f64,
}

/// Where a row of [`MovableFormFactors::rearranged`] comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// It is the row of this source as it is.
    Moved(usize),
    /// It follows from the row of this source and new work.
    Changed(usize),
    /// It is new.
    New,
}

impl MovableFormFactors {
    /// A store of the given sources and `targets` targets. What is not moved `row(s, old, values)` computes, in parallel, from the old
    /// row and its bound, if there is one, into zeros; it returns what that took and a bound of the error of every entry.
    ///
    /// # Errors
    ///
    /// [`StoreError`] if a row cannot be had or holds a value that is no exchange area; this store is lost then.
    ///
    /// # Panics
    ///
    /// If a row is asked for twice or is not there, or a row moves that does not have `targets` entries.
    pub fn rearranged(
        self,
        sources: &[Source],
        targets: usize,
        row: impl Fn(usize, Option<(&[f64], f64)>, &mut [f64]) -> Result<(Cost, f64), StoreError> + Sync,
    ) -> Result<(Self, Cost), StoreError> {
        let before = self.targets;
        let mut old: Vec<Option<Held>> = self.rows.into_iter().map(Some).collect();
        let mut take = |s: usize| old[s].take().expect("every row has one place to go to");
        let places: Vec<(Source, Option<Held>)> = sources
            .iter()
            .map(|&source| match source {
                Source::Moved(s) => {
                    assert_eq!(before, targets, "a row moves only between equal targets");
                    (source, Some(take(s)))
                }
                Source::Changed(s) => (source, Some(take(s))),
                Source::New => (source, None),
            })
            .collect();
        let done: Vec<Result<(Held, Cost), StoreError>> = places
            .into_par_iter()
            .enumerate()
            .map(|(s, place)| match place {
                (Source::Moved(_), Some(held)) => Ok((held, Cost::default())),
                (_, held) => {
                    let mut values = vec![0.0; targets].into_boxed_slice();
                    let (cost, bound) = row(s, held.as_ref().map(|held| (&*held.values, held.bound)), &mut values)?;
                    check_row(s, 0, &values)?;
                    Ok((Held { values, bound }, cost))
                }
            })
            .collect();
        // In order, so that the first fault is the same on any number of threads.
        let (mut rows, mut total) = (Vec::with_capacity(done.len()), Cost::default());
        for made in done {
            let (held, cost) = made?;
            rows.push(held);
            total += cost;
        }
        Ok((Self { rows, targets }, total))
    }

    /// The entries of row s.
    pub fn entries(&self, s: usize) -> &[f64] {
        &self.rows[s].values
    }

    /// Bound of the error of every entry of row s (three standard errors where sampled).
    pub fn bound(&self, s: usize) -> f64 {
        self.rows[s].bound
    }
}

impl FormFactors for MovableFormFactors {
    fn name(&self) -> &'static str {
        "movable"
    }

    fn sources(&self) -> usize {
        self.rows.len()
    }

    fn targets(&self) -> usize {
        self.targets
    }

    fn properties(&self) -> Properties {
        let stored_bytes = 8 * (self.rows.len() * self.targets) as u64;
        Properties { symmetric: false, per_band: false, stored_bytes, rounding: 0.0 }
    }

    fn row<'a>(&'a self, s: usize, _band: usize, _buf: &'a mut RowBuf) -> Result<Row<'a>, StoreError> {
        Ok(Row { entries: Entries::Dense(self.entries(s)), cost: Cost::default() })
    }

    fn gather(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        assert_lengths("gather", (self.targets(), self.sources()), x, &y);
        by_pieces(y, |rows, sums| {
            let rows: Vec<&[f64]> = rows.map(|s| self.entries(s)).collect();
            dot::dense(&rows, x, 0, sums);
        });
        Ok(Cost::applied(self.sources() * self.targets(), 8, x.count()))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Broken, Table};
    use super::*;
    use crate::Rows;

    fn table(sources: usize, targets: usize) -> (MovableFormFactors, Cost) {
        let table = Table { sources, targets };
        let row = |s: usize, _: Option<(&[f64], f64)>, values: &mut [f64]| table.row(s, values);
        MovableFormFactors::default().rearranged(&vec![Source::New; sources], targets, row).unwrap()
    }

    #[test]
    fn moved_rows_cost_nothing_and_new_ones_their_own() {
        let (store, cost) = table(5, 7);
        assert_eq!((cost.source_evaluations, cost.form_factors), (5, 35));
        let sources = [Source::Moved(3), Source::New, Source::Moved(0), Source::New];
        let fresh = Table { sources: 9, targets: 7 };
        let (store, cost) = store.rearranged(&sources, 7, |s, _, values| fresh.row(s + 4, values)).unwrap();
        assert_eq!((cost.source_evaluations, cost.form_factors), (2, 14));
        for (s, from) in [3, 5, 0, 7].into_iter().enumerate() {
            assert!((0..7).all(|t| store.entries(s)[t] == Table::value(from, t)));
            assert_eq!(store.bound(s), from as f64);
        }
        assert_eq!(store.properties().stored_bytes, 8 * 4 * 7);
    }

    #[test]
    fn changed_rows_are_made_from_what_they_were() {
        let (store, _) = table(3, 2);
        let sources = [0, 1, 2].map(Source::Changed);
        let split = |s: usize, old: Option<(&[f64], f64)>, values: &mut [f64]| {
            let (old, _) = old.unwrap();
            values.copy_from_slice(&[old[0], 0.25 * old[1], 0.75 * old[1]]);
            Ok((Cost { form_factors: 2, ..Cost::default() }, s as f64))
        };
        let (store, cost) = store.rearranged(&sources, 3, split).unwrap();
        assert_eq!((cost.form_factors, store.targets()), (6, 3));
        assert_eq!(store.entries(2)[0], Table::value(2, 0));
        assert_eq!(store.entries(2)[1] + store.entries(2)[2], Table::value(2, 1));
    }

    #[test]
    fn a_row_that_is_none_is_refused() {
        let row = |s: usize, _: Option<(&[f64], f64)>, values: &mut [f64]| Broken.row(s, values);
        let error = MovableFormFactors::default().rearranged(&[Source::New; 5], 3, row).unwrap_err();
        assert_eq!(error, StoreError::Value { source_index: 3, target_index: 1, value: -2.0 });
    }
}
