//! Every exchange area in one matrix.

use std::ops::Range;

use faer::MatRef;
use radiosity_core::{
    Bands, BandsMut, Cost, Entries, FormFactors, Properties, Relax, Row, RowBuf, StoreError, scatter_by_rows,
    sweep_by_rows,
};
use rayon::prelude::*;

use super::{Held, assert_factors, assert_lengths, by_blocks, by_pieces, check_memory, check_row, dot, scale_row};
use crate::mirrored::{Copies, RowOf, fill};
use crate::{Mirrors, Rows};

/// Exchange areas A_s F_st of all pairs, 8 bytes each (columns of the matrix padded to 64 bytes).
///
/// Column s of the matrix is row s of the exchange areas, contiguous, and lent without a copy.
#[derive(Clone, Debug)]
pub struct DenseFormFactors {
    table: Table,
    bounds: Option<Vec<f64>>,
    symmetric: bool,
}

impl DenseFormFactors {
    /// Computes and keeps all rows, in parallel over rows; of symmetric rows only the upper triangle, mirrored, and of rows that are known to be mirror
    /// images only their originals.
    ///
    /// # Errors
    ///
    /// [`StoreError`] if a row cannot be had or holds a value that is no exchange area.
    pub fn assemble(rows: &dyn Rows) -> Result<(Self, Cost), StoreError> {
        Self::assemble_within(rows, None)
    }

    /// [`Self::assemble`], in at most `limit` bytes (8 a pair).
    ///
    /// # Errors
    ///
    /// [`StoreError::Memory`] before anything is computed, else as [`Self::assemble`].
    pub fn assemble_within(rows: &dyn Rows, limit: Option<u64>) -> Result<(Self, Cost), StoreError> {
        let symmetric = rows.symmetric();
        if let Some(mirrors) = rows.mirrors() {
            return Self::fill_mirrored(rows, mirrors, limit);
        }
        Self::fill(rows.sources(), rows.targets(), symmetric, limit, |s, values| {
            let (cost, bound) = if symmetric { rows.upper_row(s, values) } else { rows.row(s, values) }?;
            Ok((cost, Some(bound)))
        })
    }

    /// Keeps given exchange areas, row after row.
    ///
    /// # Errors
    ///
    /// [`StoreError::Value`] for an entry that is no exchange area, [`StoreError::NotSymmetric`] if `symmetric` is
    /// claimed and two mirrored entries differ.
    ///
    /// # Panics
    ///
    /// If there are not `sources` · `targets` values, or `symmetric` is claimed of a table that is not square.
    pub fn from_rows(values: &[f64], sources: usize, targets: usize, symmetric: bool) -> Result<Self, StoreError> {
        assert_eq!(values.len(), sources * targets, "{sources} × {targets} exchange areas");
        let mut store = Self {
            table: Table::zeros(sources, targets),
            bounds: None,
            symmetric: symmetric && store_is_square(sources, targets),
        };
        store.table.rows_mut().zip(values.chunks(targets.max(1))).for_each(|(row, given)| row.copy_from_slice(given));
        for s in 0..sources {
            check_row(s, 0, store.slice(s))?;
            if symmetric && let Some(t) = (0..s).find(|&t| store.entry(s, t) != store.entry(t, s)) {
                let (value, mirrored) = (store.entry(s, t), store.entry(t, s));
                return Err(StoreError::NotSymmetric { source_index: s, target_index: t, value, mirrored });
            }
        }
        Ok(store)
    }

    /// A store whose row s `row(s, zeros)` fills (from the diagonal on, if symmetric), with its cost and bound.
    pub(super) fn fill(
        sources: usize,
        targets: usize,
        symmetric: bool,
        limit: Option<u64>,
        row: impl Fn(usize, &mut [f64]) -> Result<(Cost, Option<f64>), StoreError> + Sync,
    ) -> Result<(Self, Cost), StoreError> {
        let symmetric = symmetric && store_is_square(sources, targets);
        check_memory(sources, targets, 8 * sources as u64 * targets as u64, limit)?;
        let mut table = Table::zeros(sources, targets);
        let done: Vec<Result<(Cost, Option<f64>), StoreError>> = table
            .par_rows_mut()
            .enumerate()
            .map(|(s, values)| {
                let spent = row(s, values)?;
                check_row(s, if symmetric { s } else { 0 }, values)?;
                Ok(spent)
            })
            .collect();
        // In order, so that the first fault is the same on any number of threads.
        let (mut total, mut bounds) = (Cost::default(), Vec::with_capacity(sources));
        for spent in done {
            let (cost, bound) = spent?;
            total += cost;
            bounds.push(bound);
        }
        let mut bounds: Option<Vec<f64>> = bounds.into_iter().collect();
        if symmetric {
            table.mirror();
            // Entry (s, t < s) was computed in row t and has that row's bound.
            if let Some(bounds) = &mut bounds {
                (1..bounds.len()).for_each(|s| bounds[s] = bounds[s].max(bounds[s - 1]));
            }
        }
        Ok((Self { table, bounds, symmetric }, total))
    }

    /// A store of originals, which are computed, and their copies.
    fn fill_mirrored(rows: &dyn Rows, mirrors: &Mirrors, limit: Option<u64>) -> Result<(Self, Cost), StoreError> {
        let (sources, targets) = (rows.sources(), rows.targets());
        let symmetric = rows.symmetric() && store_is_square(sources, targets);
        check_memory(sources, targets, 8 * sources as u64 * targets as u64, limit)?;
        let mut store = Self { table: Table::zeros(sources, targets), bounds: None, symmetric };
        let found = fill(&mut store, mirrors, (targets, symmetric), |s, wanted, values| {
            let spent = if symmetric { rows.row_of(s, s, wanted, values) } else { rows.row(s, values) }?;
            check_row(s, 0, values)?;
            Ok(spent)
        })?;
        if symmetric {
            store.table.mirror();
        }
        let (mut total, mut bounds) = (Cost::default(), Vec::<f64>::with_capacity(sources));
        let mut found = found.into_iter();
        for s in 0..sources {
            let (original, _) = mirrors.original(s);
            let bound = if original < s {
                bounds[original]
            } else {
                let (cost, bound) = found.next().expect("each original was computed");
                total += cost;
                bound
            };
            // Entries of pairs with earlier orbits were computed in their rows.
            let earlier = bounds.last().copied().filter(|_| symmetric).unwrap_or(0.0);
            bounds.push(bound.max(earlier));
        }
        Ok((Self { bounds: Some(bounds), ..store }, total))
    }

    /// The exchange areas as a matrix of `targets` × `sources`: column s is row s.
    pub fn matrix(&self) -> MatRef<'_, f64> {
        let Table { sources, targets, stride, .. } = self.table;
        MatRef::from_column_major_slice_with_stride(self.table.used(), targets, sources, stride)
    }

    /// A_s F_st.
    pub fn entry(&self, s: usize, t: usize) -> f64 {
        self.slice(s)[t]
    }

    /// Bound of the error of every entry of row s (three standard errors where sampled), if the estimator gave one.
    pub fn row_bound(&self, s: usize) -> Option<f64> {
        self.bounds.as_ref().map(|bounds| bounds[s])
    }

    /// The store with every two mirrored entries replaced by their mean.
    ///
    /// For entries that differ within the bounds of a pairwise estimator. Of rows with sampling errors the mean
    /// keeps reciprocity but not the row sums, and is no repair.
    ///
    /// # Panics
    ///
    /// If the store is not square.
    pub fn symmetrised(mut self) -> Self {
        store_is_square(self.sources(), self.targets());
        for s in 0..self.sources() {
            for t in 0..s {
                let (here, there) = (self.table.place(s, t), self.table.place(t, s));
                let mean = 0.5 * (self.table.values[here] + self.table.values[there]);
                (self.table.values[here], self.table.values[there]) = (mean, mean);
            }
        }
        if let Some(bounds) = &mut self.bounds {
            let worst = bounds.iter().copied().fold(0.0, f64::max);
            bounds.fill(worst);
        }
        Self { symmetric: true, ..self }
    }

    /// The store read the other way: entry (t, s) where this one has (s, t). Bounds of rows do not carry over.
    pub fn transposed(&self) -> Self {
        let mut table = Table::zeros(self.targets(), self.sources());
        for (t, row) in table.rows_mut().enumerate() {
            row.iter_mut().enumerate().for_each(|(s, value)| *value = self.entry(s, t));
        }
        Self { table, bounds: None, ..*self }
    }

    fn slice(&self, s: usize) -> &[f64] {
        self.table.row(s)
    }

    fn slices(&self, rows: Range<usize>) -> Vec<&[f64]> {
        rows.map(|s| self.slice(s)).collect()
    }
}

impl Copies for DenseFormFactors {
    fn entry(&self, s: usize, t: usize) -> f64 {
        self.slice(s)[t]
    }

    fn put(&mut self, row: &RowOf<'_>) {
        let symmetric = self.symmetric;
        self.table.par_rows_mut().enumerate().for_each(|(s, values)| {
            if let Some((from, places)) = row(s) {
                let first = if symmetric { s } else { 0 };
                values[first..].iter_mut().zip(&places[first..]).for_each(|(value, &t)| *value = from[t as usize]);
            }
        });
    }
}

/// True, or a panic: symmetry is only claimed of square tables.
fn store_is_square(sources: usize, targets: usize) -> bool {
    assert_eq!(sources, targets, "a symmetric store has as many sources as targets");
    true
}

/// Rows one after another, each from the beginning of a cache line on.
///
/// Fresh memory costs as much as half of the arithmetic of unoccluded pairs: it is taken as zeros that the system hands out
/// untouched, so that each page is first written by the thread that fills it.
#[derive(Debug)]
struct Table {
    values: Vec<f64>,
    /// Where the first row begins.
    first: usize,
    sources: usize,
    targets: usize,
    /// From one row to the next.
    stride: usize,
}

/// A cache line, in values.
const LINE: usize = 8;
/// Rows that take the other half of a symmetric table at once.
const BLOCK: usize = 64;

impl Table {
    fn zeros(sources: usize, targets: usize) -> Self {
        let stride = targets.next_multiple_of(LINE);
        let values = vec![0.0; sources * stride + LINE];
        let first = values.as_ptr().align_offset(LINE * size_of::<f64>()).min(LINE);
        Self { values, first, sources, targets, stride }
    }

    fn place(&self, s: usize, t: usize) -> usize {
        self.first + s * self.stride + t
    }

    fn used(&self) -> &[f64] {
        &self.values[self.first..self.first + self.sources * self.stride]
    }

    fn used_mut(&mut self) -> &mut [f64] {
        &mut self.values[self.first..self.first + self.sources * self.stride]
    }

    fn row(&self, s: usize) -> &[f64] {
        &self.used()[s * self.stride..][..self.targets]
    }

    fn rows_mut(&mut self) -> impl Iterator<Item = &mut [f64]> {
        let (stride, targets) = (self.stride, self.targets);
        self.used_mut().chunks_mut(stride.max(1)).map(move |row| &mut row[..targets])
    }

    fn par_rows_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [f64]> {
        let (stride, targets) = (self.stride, self.targets);
        self.used_mut().par_chunks_mut(stride.max(1)).map(move |row| &mut row[..targets])
    }

    /// Copies what lies right of the diagonal of each row to the other side.
    fn mirror(&mut self) {
        let (n, stride) = (self.sources, self.stride);
        for begin in (0..n).step_by(BLOCK) {
            // Rows of the block take their left part from the rows above them, a line of each at a time, then from each other.
            let (above, block) = self.used_mut().split_at_mut(begin * stride);
            let block = &mut block[..BLOCK.min(n - begin) * stride];
            block.par_chunks_mut(LINE * stride).enumerate().for_each(|(k, rows)| {
                let s = begin + k * LINE;
                for (t, above) in above.chunks_exact(stride).enumerate() {
                    let line = &above[s..s + rows.len() / stride];
                    line.iter().enumerate().for_each(|(r, value)| rows[r * stride + t] = *value);
                }
            });
            for s in 0..block.len() / stride {
                (0..s).for_each(|t| block[s * stride + begin + t] = block[t * stride + begin + s]);
            }
        }
    }
}

/// The copy begins its rows at cache lines of its own.
impl Clone for Table {
    fn clone(&self) -> Self {
        let mut table = Self::zeros(self.sources, self.targets);
        table.used_mut().copy_from_slice(self.used());
        table
    }
}

impl FormFactors for DenseFormFactors {
    fn name(&self) -> &'static str {
        "dense"
    }

    fn sources(&self) -> usize {
        self.table.sources
    }

    fn targets(&self) -> usize {
        self.table.targets
    }

    fn properties(&self) -> Properties {
        let held = (self.table.sources * self.table.stride) as u64;
        Properties { symmetric: self.symmetric, per_band: false, stored_bytes: 8 * held, rounding: 0.0 }
    }

    fn row<'a>(&'a self, s: usize, _band: usize, _buf: &'a mut RowBuf) -> Result<Row<'a>, StoreError> {
        Ok(Row { entries: Entries::Dense(self.slice(s)), cost: Cost::default() })
    }

    fn gather(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        assert_lengths("gather", (self.targets(), self.sources()), x, &y);
        by_pieces(y, |rows, sums| dot::dense(&self.slices(rows), x, 0, sums));
        Ok(Cost::applied(self.sources() * self.targets(), 8, x.count()))
    }

    fn scatter(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        if self.symmetric { self.gather(x, y) } else { scatter_by_rows(self, x, y) }
    }

    fn sweep(&self, x: BandsMut<'_>, relax: &mut Relax<'_>) -> Result<Cost, StoreError> {
        let (n, bands) = (self.sources(), x.count());
        if n != self.targets() {
            return sweep_by_rows(self, x, relax);
        }
        let next = |now: &mut Range<usize>, block: &Range<usize>, _: Bands<'_>| *now = block.clone();
        by_blocks(n, x, relax, &mut (0..0), next, |block, rows, x, sums, inside| {
            let rows = self.slices(rows);
            let part = |part: Range<usize>| rows.iter().map(|row| &row[part.clone()]).collect::<Vec<_>>();
            // Both sides of the block; the part in between is copied while it is in the cache.
            let mut left = vec![0.0; sums.len()];
            dot::dense(&part(0..block.start), x, 0, &mut left);
            dot::dense(&part(block.end..n), x, block.end, sums);
            sums.iter_mut().zip(&left).for_each(|(sum, left)| *sum += left);
            let inside = inside.chunks_exact_mut(block.len());
            inside.zip(part(block.clone())).for_each(|(inside, row)| inside.copy_from_slice(row));
        });
        Ok(Cost::applied(n * n, 8, bands))
    }
}

impl Held for DenseFormFactors {
    fn bound(&self, s: usize) -> Option<f64> {
        self.row_bound(s)
    }

    fn scale(&mut self, factors: &[f64]) {
        assert_factors(self, factors);
        let scaled = self.table.par_rows_mut().zip(factors);
        let scaled = scaled.map(|(row, &d_s)| scale_row(d_s, factors.iter().copied(), row.iter_mut()));
        let changes: Vec<f64> = scaled.collect();
        if let Some(bounds) = &mut self.bounds {
            bounds.iter_mut().zip(changes).for_each(|(bound, change)| *bound += change);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Table, values};
    use super::*;
    use radiosity_core::{BandValues, gather_by_rows};

    #[test]
    fn a_symmetric_table_is_computed_once_and_mirrored() {
        let (store, cost) = DenseFormFactors::assemble(&Table { sources: 150, targets: 150 }).unwrap();
        assert_eq!((cost.form_factors, cost.source_evaluations), (150 * 151 / 2, 150));
        assert!(store.properties().symmetric);
        assert!((0..150).all(|s| (0..150).all(|t| store.entry(s, t) == Table::value(s, t))));
    }

    #[test]
    fn a_mirrored_row_has_the_largest_bound_of_the_rows_it_came_from() {
        let (store, _) = DenseFormFactors::assemble(&Table { sources: 5, targets: 5 }).unwrap();
        assert_eq!(store.row_bound(3), Some(3.0));
        let given = DenseFormFactors::from_rows(&[0.5; 6], 2, 3, false).unwrap();
        assert_eq!(given.row_bound(1), None);
    }

    #[test]
    fn symmetry_that_is_claimed_is_checked() {
        let values = [0.0, 1.0, 2.0, 1.0, 0.0, 3.0, 2.0, 3.5, 0.0];
        let error = StoreError::NotSymmetric { source_index: 2, target_index: 1, value: 3.5, mirrored: 3.0 };
        assert_eq!(DenseFormFactors::from_rows(&values, 3, 3, true).map(|_| ()), Err(error));
        let mean = DenseFormFactors::from_rows(&values, 3, 3, false).unwrap().symmetrised();
        assert_eq!((mean.entry(1, 2), mean.entry(2, 1), mean.properties().symmetric), (3.25, 3.25, true));
    }

    #[test]
    fn stored_bytes_are_8_a_pair_in_columns_padded_to_64_bytes() {
        let (store, _) = DenseFormFactors::assemble(&Table { sources: 7, targets: 13 }).unwrap();
        assert_eq!(store.properties().stored_bytes, 7 * 128);
    }

    /// 101 terms below 5 in size, added in another order.
    #[test]
    fn a_gather_gives_the_sums_of_a_gather_over_lent_rows() {
        let (store, _) = DenseFormFactors::assemble(&Table { sources: 37, targets: 101 }).unwrap();
        let x = values(5, 101);
        let (mut fast, mut plain) = (BandValues::zeros(5, 37), BandValues::zeros(5, 37));
        let cost = store.gather(x.view(), fast.view_mut()).unwrap();
        assert_eq!(cost, gather_by_rows(&store, x.view(), plain.view_mut()).unwrap());
        assert!(fast.values().iter().zip(plain.values()).all(|(a, b)| (a - b).abs() < 1e-13));
    }

    #[test]
    fn a_scatter_counts_only_lit_rows() {
        let (store, _) = DenseFormFactors::assemble(&Table { sources: 20, targets: 1100 }).unwrap();
        let mut x = BandValues::zeros(2, 20);
        x.band_mut(1)[4] = 1.0;
        let cost = store.scatter(x.view(), BandValues::zeros(2, 1100).view_mut()).unwrap();
        assert_eq!(cost, Cost::applied(1100, 8, 2));
    }
}
