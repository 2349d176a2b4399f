//! The exchange areas that are not zero.

use std::ops::Range;

use radiosity_core::{
    Bands, BandsMut, Cost, Entries, FormFactors, Properties, Relax, Row, RowBuf, StoreError, scatter_by_rows,
    sweep_by_rows,
};
use rayon::prelude::*;
use sprs::CsMatI;

use super::dot::{self, Abreast};
use super::{
    Held, assert_factors, assert_lengths, by_blocks, by_rows, check_memory, check_row, check_value, scale_row,
};
use crate::rows::{Rows, SparseRow};

/// Exchange areas A_s F_st that are not zero, by rows: 12 bytes each (value and 32-bit target) and 8 a row.
///
/// Nothing is dropped but exact zeros. The matrix of `sprs` holds the structure; products are this crate's own.
#[derive(Clone, Debug)]
pub struct SparseFormFactors {
    values: CsMatI<f64, u32, usize>,
    bounds: Option<Vec<f64>>,
    symmetric: bool,
}

/// Rows that one task computes.
const PIECE: usize = 16;

/// Rows while they are collected.
#[derive(Default)]
struct Collected {
    begins: Vec<usize>,
    targets: Vec<u32>,
    values: Vec<f64>,
}

impl SparseFormFactors {
    /// Rows computed before they are put together: bounds the scratch while a store is assembled of rows that are not symmetric. What
    /// is symmetric takes as much again as what is held.
    pub const ROWS_AT_ONCE: usize = 1024;

    /// Computes all rows and keeps what is not zero; of symmetric rows only the upper triangle, mirrored.
    ///
    /// # Errors
    ///
    /// [`StoreError`] if a row cannot be had or holds a value that is no exchange area.
    pub fn assemble(rows: &dyn Rows) -> Result<(Self, Cost), StoreError> {
        Self::assemble_within(rows, None)
    }

    /// [`Self::assemble`], in at most `limit` bytes (12 an entry that is not zero, 8 a row).
    ///
    /// # Errors
    ///
    /// [`StoreError::Memory`] as soon as the limit is passed (then with the bytes needed *so far*), else as
    /// [`Self::assemble`].
    ///
    /// # Panics
    ///
    /// If the rows are symmetric but not square.
    pub fn assemble_within(rows: &dyn Rows, limit: Option<u64>) -> Result<(Self, Cost), StoreError> {
        let (sources, targets, symmetric) = (rows.sources(), rows.targets(), rows.symmetric());
        assert!(!symmetric || sources == targets, "a symmetric store of {sources} sources, {targets} targets");
        let mut kept = Collected { begins: vec![0], ..Collected::default() };
        let (mut total, mut bounds, mut diagonal) = (Cost::default(), Vec::with_capacity(sources), 0);
        for begin in (0..sources).step_by(Self::ROWS_AT_ONCE) {
            let end = (begin + Self::ROWS_AT_ONCE).min(sources);
            let pieces: Vec<Result<_, StoreError>> = (begin..end)
                .into_par_iter()
                .step_by(PIECE)
                .map_init(SparseRow::default, |row, first| {
                    let (mut piece, mut spent) = (Collected::default(), Vec::with_capacity(PIECE));
                    for s in first..(first + PIECE).min(end) {
                        spent.push(if symmetric { rows.sparse_upper_row(s, row) } else { rows.sparse_row(s, row) }?);
                        row.entries.iter().try_for_each(|&(t, value)| check_value(s, t as usize, value))?;
                        piece.targets.extend(row.entries.iter().map(|entry| entry.0));
                        piece.values.extend(row.entries.iter().map(|entry| entry.1));
                        piece.begins.push(piece.values.len());
                    }
                    Ok((piece, spent))
                })
                .collect();
            for piece in pieces {
                let (piece, spent) = piece?;
                let before = kept.values.len();
                for ((cost, bound), end) in spent.into_iter().zip(piece.begins) {
                    total += cost;
                    let first = kept.begins[bounds.len()] - before;
                    diagonal += usize::from(first < end && piece.targets[first] as usize == bounds.len());
                    bounds.push(bound);
                    kept.begins.push(before + end);
                }
                kept.targets.extend_from_slice(&piece.targets);
                kept.values.extend_from_slice(&piece.values);
            }
            // Room for rows like these, so that what is kept is not copied each time it grows.
            let more = (kept.values.len() / bounds.len() + 1) * (sources - bounds.len());
            kept.targets.reserve(more);
            kept.values.reserve(more);
            let entries = if symmetric { 2 * kept.values.len() - diagonal } else { kept.values.len() };
            check_memory(sources, targets, bytes(sources, entries), limit)?;
        }
        if symmetric {
            kept = kept.mirrored();
            (1..sources).for_each(|s| bounds[s] = bounds[s].max(bounds[s - 1]));
        }
        let values = CsMatI::new((sources, targets), kept.begins, kept.targets, kept.values);
        Ok((Self { values, bounds: Some(bounds), symmetric }, total))
    }

    /// Keeps given exchange areas, row after row, without their zeros.
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
        assert!(!symmetric || sources == targets, "a symmetric store of {sources} sources, {targets} targets");
        let mut kept = Collected { begins: vec![0], ..Collected::default() };
        for s in 0..sources {
            let row = &values[s * targets..(s + 1) * targets];
            check_row(s, 0, row)?;
            if symmetric && let Some(t) = (0..s).find(|&t| row[t] != values[t * targets + s]) {
                let (value, mirrored) = (row[t], values[t * targets + s]);
                return Err(StoreError::NotSymmetric { source_index: s, target_index: t, value, mirrored });
            }
            kept.targets.extend((0..targets).filter(|&t| row[t] != 0.0).map(|t| t as u32));
            kept.values.extend(row.iter().filter(|v| **v != 0.0));
            kept.begins.push(kept.values.len());
        }
        let values = CsMatI::new((sources, targets), kept.begins, kept.targets, kept.values);
        Ok(Self { values, bounds: None, symmetric })
    }

    /// The exchange areas by rows.
    pub fn matrix(&self) -> &CsMatI<f64, u32, usize> {
        &self.values
    }

    /// Bound of the error of every entry of row s (three standard errors where sampled), zeros included.
    pub fn row_bound(&self, s: usize) -> Option<f64> {
        self.bounds.as_ref().map(|bounds| bounds[s])
    }

    fn gather_abreast<const W: usize>(&self, x: Bands<'_>, y: BandsMut<'_>) {
        let x = Abreast::<W>::new(x);
        by_rows(y, |s, sums| {
            let (targets, values) = self.slices(s);
            dot::sparse(targets, values, &x, sums);
        });
    }

    /// Sums over whole rows of an x that is 0 inside the block.
    fn sweep_abreast<const W: usize>(&self, x: BandsMut<'_>, relax: &mut Relax<'_>) {
        let mut outside = (Abreast::<W>::new(x.view()), 0..0);
        let next = |(outside, last): &mut (Abreast<W>, Range<usize>), block: &Range<usize>, x: Bands<'_>| {
            outside.set(std::mem::replace(last, block.clone()), x);
            outside.clear(block.clone());
        };
        by_blocks(self.sources(), x, relax, &mut outside, next, |(outside, block), rows, x, sums, inside| {
            let rows = rows.zip(sums.chunks_exact_mut(x.count()).zip(inside.chunks_exact_mut(block.len())));
            for (s, (sums, inside)) in rows {
                let (targets, values) = self.slices(s);
                dot::sparse(targets, values, outside, sums);
                let first = targets.partition_point(|&t| (t as usize) < block.start);
                let entries = targets[first..].iter().zip(&values[first..]);
                for (&t, &value) in entries.take_while(|entry| (*entry.0 as usize) < block.end) {
                    inside[t as usize - block.start] = value;
                }
            }
        });
    }

    fn slices(&self, s: usize) -> (&[u32], &[f64]) {
        let range = self.values.indptr().outer_inds_sz(s);
        (&self.values.indices()[range.clone()], &self.values.data()[range])
    }
}

/// Bytes of a store with this many rows and entries.
fn bytes(sources: usize, entries: usize) -> u64 {
    12 * entries as u64 + 8 * (sources as u64 + 1)
}

impl Collected {
    /// The whole of a symmetric matrix from rows that begin at the diagonal.
    fn mirrored(&self) -> Self {
        let n = self.begins.len() - 1;
        let upper = |s: usize| (self.begins[s]..self.begins[s + 1]).map(move |k| (s, k));
        let mut lengths = vec![0; n];
        for (s, k) in (0..n).flat_map(upper) {
            let t = self.targets[k] as usize;
            lengths[s] += 1;
            lengths[t] += usize::from(t != s);
        }
        let mut begins = vec![0];
        lengths.iter().for_each(|length| begins.push(begins[begins.len() - 1] + length));
        let (mut targets, mut values) = (vec![0; begins[n]], vec![0.0; begins[n]]);
        // Rows in order: what row s mirrors into row t > s comes before row t's own entries, ascending.
        let mut next = begins[..n].to_vec();
        for (s, k) in (0..n).flat_map(upper) {
            let t = self.targets[k] as usize;
            let places = if t == s { [Some((s, t)), None] } else { [Some((s, t)), Some((t, s))] };
            for (row, column) in places.into_iter().flatten() {
                (targets[next[row]], values[next[row]]) = (column as u32, self.values[k]);
                next[row] += 1;
            }
        }
        Self { begins, targets, values }
    }
}

impl FormFactors for SparseFormFactors {
    fn name(&self) -> &'static str {
        "sparse"
    }

    fn sources(&self) -> usize {
        self.values.rows()
    }

    fn targets(&self) -> usize {
        self.values.cols()
    }

    fn properties(&self) -> Properties {
        let stored_bytes = bytes(self.sources(), self.values.nnz());
        Properties { symmetric: self.symmetric, per_band: false, stored_bytes, rounding: 0.0 }
    }

    fn row<'a>(&'a self, s: usize, _band: usize, _buf: &'a mut RowBuf) -> Result<Row<'a>, StoreError> {
        let (targets, values) = self.slices(s);
        Ok(Row { entries: Entries::Sparse { targets, values }, cost: Cost::default() })
    }

    fn gather(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        assert_lengths("gather", (self.targets(), self.sources()), x, &y);
        match x.count() {
            1 => self.gather_abreast::<1>(x, y),
            2 => self.gather_abreast::<2>(x, y),
            _ => self.gather_abreast::<4>(x, y),
        }
        Ok(Cost::applied(self.values.nnz(), 12, x.count()))
    }

    fn scatter(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        if self.symmetric { self.gather(x, y) } else { scatter_by_rows(self, x, y) }
    }

    fn sweep(&self, x: BandsMut<'_>, relax: &mut Relax<'_>) -> Result<Cost, StoreError> {
        let (n, bands) = (self.sources(), x.count());
        if n != self.targets() {
            return sweep_by_rows(self, x, relax);
        }
        match bands {
            1 => self.sweep_abreast::<1>(x, relax),
            2 => self.sweep_abreast::<2>(x, relax),
            _ => self.sweep_abreast::<4>(x, relax),
        }
        Ok(Cost::applied(self.values.nnz(), 12, bands))
    }
}

impl Held for SparseFormFactors {
    fn bound(&self, s: usize) -> Option<f64> {
        self.row_bound(s)
    }

    fn scale(&mut self, factors: &[f64]) {
        assert_factors(self, factors);
        let (begins, targets, mut rest) = self.values.view_mut().into_raw_storage();
        for s in 0..factors.len() {
            let (begin, end) = (begins[s], begins[s + 1]);
            let (row, after) = rest.split_at_mut(end - begin);
            let change =
                scale_row(factors[s], targets[begin..end].iter().map(|&t| factors[t as usize]), row.iter_mut());
            if let Some(bounds) = &mut self.bounds {
                bounds[s] += change;
            }
            rest = after;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::Table;
    use super::*;

    #[test]
    fn rows_hold_what_is_not_zero_in_ascending_order() {
        for (sources, targets) in [(7, 7), (300, 300), (5, 9)] {
            let (store, _) = SparseFormFactors::assemble(&Table { sources, targets }).unwrap();
            for s in 0..sources {
                let wanted: Vec<(usize, f64)> =
                    (0..targets).map(|t| (t, Table::value(s, t))).filter(|entry| entry.1 != 0.0).collect();
                let mut found = Vec::new();
                let mut buf = RowBuf::default();
                store.row(s, 0, &mut buf).unwrap().entries.for_each(|t, v| found.push((t, v)));
                assert_eq!(found, wanted, "row {s} of {sources} × {targets}");
            }
        }
    }

    #[test]
    fn stored_bytes_are_12_an_entry_and_8_a_row() {
        let (store, _) = SparseFormFactors::assemble(&Table { sources: 5, targets: 9 }).unwrap();
        let entries = (0..45).filter(|k| Table::value(k / 9, k % 9) != 0.0).count() as u64;
        assert_eq!(store.properties().stored_bytes, 12 * entries + 8 * 6);
    }

    #[test]
    fn symmetry_that_is_claimed_is_checked() {
        let error = StoreError::NotSymmetric { source_index: 1, target_index: 0, value: 2.0, mirrored: 1.0 };
        assert_eq!(SparseFormFactors::from_rows(&[0.0, 1.0, 2.0, 0.0], 2, 2, true).map(|_| ()), Err(error));
    }

    #[test]
    fn the_memory_limit_counts_what_is_kept() {
        let table = Table { sources: 300, targets: 300 };
        let needed = SparseFormFactors::assemble(&table).unwrap().0.properties().stored_bytes;
        assert!(SparseFormFactors::assemble_within(&table, Some(needed)).is_ok());
        let refused = SparseFormFactors::assemble_within(&table, Some(needed / 2)).map(|_| ());
        assert!(matches!(refused, Err(StoreError::Memory { limit, .. }) if limit == needed / 2));
    }
}
