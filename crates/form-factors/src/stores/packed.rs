//! Symmetric exchange areas, each pair once, in tiles.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use radiosity_core::{
    BandValues, Bands, BandsMut, Block, Cost, Entries, FormFactors, Properties, Relax, Row, RowBuf, StoreError,
};
use rayon::prelude::*;

use super::lanes::run;
use super::tiles::{Entry, Half, LANES, LINE, Layout, Pass, STRIP, TILE, place};
use super::{Held, assert_factors, assert_lengths, check_memory, check_row};
use crate::level::Level;
use crate::mirrored::{Copies, RowOf, fill};
use crate::{Mirrors, Rows};

/// Exchange areas A_s F_st = A_t F_ts of all pairs s ≤ t, in double or single precision (`T` is `f64` or `f32`).
///
/// The matrix is cut into tiles of 256 × 256, of which those on and above the diagonal are kept; sides are padded to multiples
/// of 8. With w_I = 8·⌈min(256, n − 256·I)/8⌉,
///
/// ```text
/// bytes = size of T · Σ_{I ≤ J} w_I · w_J,      I, J < ⌈n/256⌉
/// ```
///
/// which is half of n² entries and 128·n for the diagonal, whose tiles are kept whole.
///
/// **Products.** One reading of a tile v applies both of its halves, in all bands:
///
/// ```text
/// y_s += Σ_t v_st x_t  (s in I),      y_t += Σ_s v_st x_s  (t in J)
/// ```
///
/// so that a gather of n² entries reads n²/2. [`Cost::entries`] counts the n² entries applied and [`Cost::bytes`] what is
/// read for them. Tiles are dealt, in order, to a number of partial sums that depends on n alone, and the partial sums are
/// added in order: the bytes of a result do not depend on the number of threads. They do depend, by rounding, on the
/// instruction set. A scatter is a gather, since the matrix is symmetric; it does not skip dark rows.
///
/// **Sweeps** are exact Gauss–Seidel, tile row by tile row: the tiles right of the diagonal are read for the sums of their
/// rows, and again, from the cache while 256·n entries fit it, to carry the new values of these rows to the columns below.
///
/// **Single precision** rounds each entry, by at most 2⁻²⁴ of it (or 2⁻¹⁵⁰ near underflow), once and alike for both
/// directions; products are those of the rounded matrix, in double precision. [`Self::row_bound`] includes the rounding. Row sums
/// are off by up to 6·10⁻⁸, usually less by √n: what a closed room loses that way matters as 1/(1 − ρ).
#[derive(Debug)]
pub struct PackedFormFactors<T> {
    layout: Layout,
    /// Tiles one after another, from `first` on: where a cache line begins.
    values: Vec<T>,
    first: usize,
    bounds: Vec<f64>,
    /// Partial sums of a product, kept from one to the next: fresh pages would cost as much as a tenth of it.
    scratch: Mutex<Vec<f64>>,
}

/// Rows computed before they are put into tiles: the scratch of [`PackedFormFactors::assemble`], 256·n bytes.
const ROWS_AT_ONCE: usize = 32;
/// Rows of a block of a sweep, whose inside is handed over row by row.
const BLOCK: usize = 64;
/// Rows of a tile that one task of a sweep sums.
const ROWS_OF_TASK: usize = 16;
/// Most partial sums of a product.
const MOST_PARTIALS: usize = 32;

impl<T: Entry> PackedFormFactors<T> {
    /// Computes all rows from the diagonal on and keeps them, in parallel over rows; of rows that are known to be mirror images only their originals.
    ///
    /// The most memory taken meanwhile is what is kept and 256·n bytes.
    ///
    /// # Errors
    ///
    /// [`StoreError::NeedsSymmetric`] before anything is computed if the rows are not symmetric, and [`StoreError`] if a row
    /// cannot be had or holds a value that is no exchange area, or none in single precision.
    pub fn assemble(rows: &dyn Rows) -> Result<(Self, Cost), StoreError> {
        Self::assemble_within(rows, None)
    }

    /// [`Self::assemble`], in at most `limit` bytes.
    ///
    /// # Errors
    ///
    /// [`StoreError::Memory`] before anything is computed, else as [`Self::assemble`].
    pub fn assemble_within(rows: &dyn Rows, limit: Option<u64>) -> Result<(Self, Cost), StoreError> {
        let n = rows.sources();
        if !rows.symmetric() || n != rows.targets() {
            return Err(StoreError::NeedsSymmetric { store: T::NAME, rows: rows.name() });
        }
        check_memory(n, n, Self::bytes(n), limit)?;
        let layout = Layout::new(n);
        // Zeros that the system hands out untouched: each page is first written by who fills it.
        let values = vec![T::default(); layout.entries() + LINE / size_of::<T>()];
        let first = values.as_ptr().align_offset(LINE).min(LINE / size_of::<T>());
        let mut store = Self { layout, values, first, bounds: Vec::with_capacity(n), scratch: Mutex::default() };
        let found = match rows.mirrors() {
            Some(mirrors) => store.fill_mirrored(rows, mirrors)?,
            None => store.fill(rows)?,
        };
        let (mut total, mut largest) = (Cost::default(), 0.0_f64);
        for (cost, bound, most) in found {
            total += cost;
            largest = largest.max(most);
            // Entry (s, t < s) was computed in row t and has that row's bound.
            store.bounds.push(store.bounds.last().map_or(bound, |last: &f64| bound.max(*last)));
        }
        if largest > 0.0 && largest < T::LEAST {
            return Err(StoreError::Underflow { store: T::NAME, largest, least: T::LEAST });
        }
        Ok((store, total))
    }

    /// Puts in all rows from the diagonal on: what each cost, its bound, and its largest value.
    fn fill(&mut self, rows: &dyn Rows) -> Result<Vec<(Cost, f64, f64)>, StoreError> {
        let Self { layout, values, first, .. } = self;
        let n = layout.n();
        let mut found = Vec::with_capacity(n);
        let mut band = vec![0.0; ROWS_AT_ONCE.min(n) * n];
        let mut rest = &mut values[*first..];
        for i in 0..layout.blocks() {
            let mut tiles = Vec::with_capacity(layout.blocks() - i);
            for j in i..layout.blocks() {
                let (tile, after) = rest.split_at_mut(layout.side(i) * layout.side(j));
                tiles.push(tile);
                rest = after;
            }
            for from in (0..layout.height(i)).step_by(ROWS_AT_ONCE) {
                let count = ROWS_AT_ONCE.min(layout.height(i) - from);
                let s_0 = i * TILE + from;
                let spent: Vec<Result<(Cost, f64, f64), StoreError>> = band[..count * n]
                    .par_chunks_mut(n)
                    .enumerate()
                    .map(|(r, values)| examined::<T>(s_0 + r, rows.upper_row(s_0 + r, values)?, values))
                    .collect();
                // In order, so that the first fault is the same on any number of threads.
                for row in spent {
                    found.push(row?);
                }
                tiles.par_iter_mut().enumerate().for_each(|(k, tile)| {
                    let (j, width) = (i + k, layout.side(i + k));
                    for (r, values) in band[..count * n].chunks_exact(n).enumerate() {
                        let begin = if k == 0 { from + r } else { 0 };
                        for t in begin..layout.height(j) {
                            tile[place(width, from + r, t)] = T::round(values[j * TILE + t]);
                        }
                    }
                });
            }
            mirror(tiles[0], layout.side(i));
        }
        Ok(found)
    }

    /// [`Self::fill`] of originals, with their copies, which cost nothing.
    fn fill_mirrored(&mut self, rows: &dyn Rows, mirrors: &Mirrors) -> Result<Vec<(Cost, f64, f64)>, StoreError> {
        let n = self.layout.n();
        let found = fill(self, mirrors, (n, true), |s, wanted, values| {
            examined::<T>(s, rows.row_of(s, s, wanted, values)?, values)
        })?;
        for i in 0..self.layout.blocks() {
            let range = self.layout.range(self.layout.index(i, i));
            mirror(&mut self.values[self.first..][range], self.layout.side(i));
        }
        let mut found = found.into_iter();
        let of_row = |s: usize| if mirrors.computes(s) { found.next() } else { None };
        // Rows come after their originals, whose bounds are carried on to all later ones.
        Ok((0..n).map(of_row).map(Option::unwrap_or_default).collect())
    }

    /// Bytes that a store of n rows keeps.
    pub fn bytes(n: usize) -> u64 {
        Layout::entries_of(n).saturating_mul(size_of::<T>() as u64)
    }

    /// A_s F_st as it is kept.
    pub fn entry(&self, s: usize, t: usize) -> f64 {
        let (low, high) = (s.min(t), s.max(t));
        let (i, j) = (low / TILE, high / TILE);
        self.tile(i, j)[place(self.layout.side(j), low % TILE, high % TILE)].into()
    }

    /// Bound of the error of every entry of row s: the estimator's (three standard errors where sampled) and rounding.
    pub fn row_bound(&self, s: usize) -> f64 {
        self.bounds[s]
    }

    fn tile(&self, i: usize, j: usize) -> &[T] {
        &self.values[self.first..][self.layout.range(self.layout.index(i, j))]
    }

    /// x with room for the padding of the last tile.
    fn padded(&self, x: Bands<'_>) -> Vec<f64> {
        let stride = self.layout.stride();
        let mut padded = vec![0.0; x.count() * stride];
        padded.chunks_mut(stride).enumerate().for_each(|(b, values)| values[..x.len()].copy_from_slice(x.band(b)));
        padded
    }

    /// Adds the products of the tiles in `range` of their order to y, in which bands lie as far apart as in x.
    fn apply(&self, level: Level, range: Range<usize>, x: &[f64], y: &mut [f64], bands: usize) {
        let (layout, stride) = (&self.layout, self.layout.stride());
        let mut sums = vec![0.0; bands * TILE];
        let mut place = 0;
        for i in 0..layout.blocks() {
            for j in i..layout.blocks() {
                if range.contains(&place) {
                    let (s_0, t_0) = (i * TILE, j * TILE);
                    sums.fill(0.0);
                    run(
                        level,
                        Pass {
                            // A tile on the diagonal is whole: its rows are both halves.
                            half: if i == j { Half::Rows } else { Half::Both },
                            bands,
                            rows: self.tile(i, j),
                            width: layout.side(j),
                            x_t: (&x[t_0..], stride),
                            x_s: (&x[s_0..], stride),
                            sums: (&mut sums, TILE),
                            y_t: (&mut y[t_0..], stride),
                        },
                    );
                    for (y, sums) in y[s_0..].chunks_mut(stride).zip(sums.chunks_exact(TILE)) {
                        y.iter_mut().zip(&sums[..layout.height(i)]).for_each(|(y, sum)| *y += sum);
                    }
                }
                place += 1;
            }
        }
    }

    /// Row of tiles in which the tile at `place` in their order lies.
    fn row_of(&self, place: usize) -> usize {
        let blocks = self.layout.blocks();
        (0..blocks).find(|&i| place <= self.layout.index(i, blocks - 1)).expect("a tile of the store")
    }

    fn applied(&self, bands: usize) -> Cost {
        let n = self.layout.n();
        Cost { bytes: Self::bytes(n), ..Cost::applied(n * n, 0, bands) }
    }
}

/// Tiles that lie one after another, each with its row and column of tiles.
fn tiles_of<'t, T>(layout: &Layout, mut rest: &'t mut [T]) -> Vec<(usize, usize, &'t mut [T])> {
    let mut tiles = Vec::with_capacity(layout.tiles());
    for i in 0..layout.blocks() {
        for j in i..layout.blocks() {
            let (tile, after) = rest.split_at_mut(layout.side(i) * layout.side(j));
            tiles.push((i, j, tile));
            rest = after;
        }
    }
    tiles
}

/// What row s cost, from the diagonal on, the bound of what will be kept of it, and its largest value.
fn examined<T: Entry>(s: usize, (cost, bound): (Cost, f64), values: &[f64]) -> Result<(Cost, f64, f64), StoreError> {
    check_row(s, s, values)?;
    let mut rounding = 0.0_f64;
    for (t, &value) in values.iter().enumerate().skip(s) {
        let kept: f64 = T::round(value).into();
        if !kept.is_finite() {
            return Err(StoreError::Value { source_index: s, target_index: t, value: kept });
        }
        rounding = rounding.max((kept - value).abs());
    }
    Ok((cost, bound + rounding, values[s..].iter().copied().fold(0.0, f64::max)))
}

impl<T: Entry> Copies for PackedFormFactors<T> {
    fn entry(&self, s: usize, t: usize) -> f64 {
        self.entry(s, t)
    }

    fn put(&mut self, row: &RowOf<'_>) {
        let Self { layout, values, first, .. } = self;
        tiles_of(layout, &mut values[*first..]).into_par_iter().for_each(|(i, j, tile)| {
            for r in 0..layout.height(i) {
                if let Some((from, places)) = row(i * TILE + r) {
                    let begin = if i == j { r } else { 0 };
                    let places = places[j * TILE..][..layout.height(j)].iter().enumerate().skip(begin);
                    places.for_each(|(t, &at)| tile[place(layout.side(j), r, t)] = T::round(from[at as usize]));
                }
            }
        });
    }
}

/// Appends entries of row r of a tile, from a column on at which a vector begins.
fn copy_row<T: Entry>(tile: &[T], width: usize, r: usize, columns: Range<usize>, row: &mut Vec<f64>) {
    for t in columns.clone().step_by(LANES) {
        let begin = place(width, r, t);
        row.extend(tile[begin..begin + LANES.min(columns.end - t)].iter().map(|&value| -> f64 { value.into() }));
    }
}

/// Copies what lies right of the diagonal of a tile to the other side.
fn mirror<T: Copy>(tile: &mut [T], width: usize) {
    for r in 0..width {
        for t in 0..r {
            tile[place(width, r, t)] = tile[place(width, t, r)];
        }
    }
}

impl<T: Entry> FormFactors for PackedFormFactors<T> {
    fn name(&self) -> &'static str {
        T::NAME
    }

    fn sources(&self) -> usize {
        self.layout.n()
    }

    fn targets(&self) -> usize {
        self.layout.n()
    }

    fn properties(&self) -> Properties {
        Properties {
            symmetric: true,
            per_band: false,
            stored_bytes: Self::bytes(self.layout.n()),
            rounding: T::ROUNDING,
        }
    }

    fn row<'a>(&'a self, s: usize, _band: usize, buf: &'a mut RowBuf) -> Result<Row<'a>, StoreError> {
        let (layout, i, r) = (&self.layout, s / TILE, s % TILE);
        assert!(s < layout.n(), "row {s} of {}", layout.n());
        buf.values.clear();
        for j in 0..i {
            // Above the diagonal tile the row is a column.
            let (tile, width) = (self.tile(j, i), layout.side(i));
            buf.values.extend((0..TILE).map(|q| -> f64 { tile[place(width, q, r)].into() }));
        }
        for j in i..layout.blocks() {
            let (tile, width) = (self.tile(i, j), layout.side(j));
            copy_row(tile, width, r, 0..layout.height(j), &mut buf.values);
        }
        Ok(Row { entries: Entries::Dense(&buf.values), cost: Cost::default() })
    }

    fn gather(&self, x: Bands<'_>, mut y: BandsMut<'_>) -> Result<Cost, StoreError> {
        let (layout, n, bands) = (&self.layout, self.layout.n(), x.count());
        assert_lengths("gather", (n, n), x, &y);
        if n == 0 {
            return Ok(Cost::default());
        }
        let (level, stride, padded) = (Level::best(), layout.stride(), self.padded(x));
        let partials = (layout.tiles() / 2).clamp(1, MOST_PARTIALS);
        let share = |k: usize| k * layout.tiles() / partials..(k + 1) * layout.tiles() / partials;
        // A partial sum begins where the first of its tiles does.
        let begins: Vec<usize> = (0..partials).map(|k| self.row_of(share(k).start) * TILE).collect();
        // A poisoned scratch holds numbers like any other: it is filled before it is read.
        let mut scratch = std::mem::take(&mut *self.scratch.lock().unwrap_or_else(PoisonError::into_inner));
        if scratch.len() != partials * bands * stride {
            // Zeros that the system hands out untouched: partial sums that begin late are never written in front.
            scratch = vec![0.0; partials * bands * stride];
        }
        scratch.par_chunks_mut(bands * stride).enumerate().for_each(|(k, sums)| {
            sums.chunks_mut(stride).for_each(|band| band[begins[k]..].fill(0.0));
            self.apply(level, share(k), &padded, sums, bands);
        });
        y.values().par_chunks_mut(n).enumerate().for_each(|(b, y)| {
            y.par_chunks_mut(TILE).enumerate().for_each(|(i, y)| {
                y.fill(0.0);
                for (k, sums) in scratch.chunks(bands * stride).enumerate() {
                    if begins[k] <= i * TILE {
                        let sums = &sums[b * stride + i * TILE..];
                        y.iter_mut().zip(sums).for_each(|(y, sum)| *y += sum);
                    }
                }
            });
        });
        *self.scratch.lock().unwrap_or_else(PoisonError::into_inner) = scratch;
        Ok(self.applied(bands))
    }

    fn scatter(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        self.gather(x, y)
    }

    fn sweep(&self, mut x: BandsMut<'_>, relax: &mut Relax<'_>) -> Result<Cost, StoreError> {
        let (layout, n, bands) = (&self.layout, self.layout.n(), x.count());
        assert_eq!(x.len(), n, "sweep: x has {} values a band, the store {n} targets", x.len());
        if n == 0 {
            return Ok(Cost::default());
        }
        let (level, stride) = (Level::best(), layout.stride());
        let mut newest = self.padded(x.view());
        // What the tiles above have brought to the columns, one tile column after another.
        let mut above = vec![0.0; layout.blocks() * bands * TILE];
        let mut inside = Vec::with_capacity(BLOCK * BLOCK);
        for i in 0..layout.blocks() {
            let (height, width, s_0, diagonal) = (layout.height(i), layout.side(i), i * TILE, self.tile(i, i));
            let right = self.right_of_diagonal(level, i, &newest, bands);
            let above_i = &above[i * bands * TILE..];
            let mut masked = vec![0.0; bands * TILE];
            for begin in (0..height).step_by(BLOCK) {
                let range = begin..(begin + BLOCK).min(height);
                // Inside the diagonal tile but outside the block.
                for (b, masked) in masked.chunks_exact_mut(TILE).enumerate() {
                    masked[..height].copy_from_slice(&newest[b * stride + s_0..][..height]);
                    masked[range.clone()].fill(0.0);
                }
                let mut beside = vec![0.0; bands * BLOCK];
                run(
                    level,
                    Pass {
                        half: Half::Rows,
                        bands,
                        rows: &diagonal[range.start * width..range.end.next_multiple_of(STRIP) * width],
                        width,
                        x_t: (&masked, TILE),
                        x_s: (&[], 0),
                        sums: (&mut beside, BLOCK),
                        y_t: (&mut [], 0),
                    },
                );
                let mut sums = BandValues::zeros(bands, range.len());
                for b in 0..bands {
                    for (r, sum) in range.clone().zip(sums.band_mut(b)) {
                        let (task, k) = (r / ROWS_OF_TASK, r % ROWS_OF_TASK);
                        let right = right[(task * bands + b) * ROWS_OF_TASK + k];
                        *sum = beside[b * BLOCK + r - range.start] + above_i[b * TILE + r] + right;
                    }
                }
                inside.clear();
                range.clone().for_each(|r| copy_row(diagonal, width, r, range.clone(), &mut inside));
                let sources = s_0 + range.start..s_0 + range.end;
                relax(&Block { range: sources.clone(), outside: sums.view(), inside: &inside }, x.reborrow());
                for b in 0..bands {
                    newest[b * stride..][sources.clone()].copy_from_slice(&x.band(b)[sources.clone()]);
                }
            }
            // The new values of these rows, to the columns that come later.
            above.par_chunks_mut(bands * TILE).enumerate().skip(i + 1).for_each(|(j, y_t)| {
                run(
                    level,
                    Pass {
                        half: Half::Columns,
                        bands,
                        rows: self.tile(i, j),
                        width: layout.side(j),
                        x_t: (&[], 0),
                        x_s: (&newest[s_0..], stride),
                        sums: (&mut [], 0),
                        y_t: (y_t, TILE),
                    },
                );
            });
        }
        Ok(self.applied(bands))
    }
}

impl<T: Entry> Held for PackedFormFactors<T> {
    fn bound(&self, s: usize) -> Option<f64> {
        Some(self.row_bound(s))
    }

    /// In single precision the scaled entries are rounded once more.
    fn scale(&mut self, factors: &[f64]) {
        assert_factors(self, factors);
        let Self { layout, values, first, bounds, .. } = self;
        let scaled = tiles_of(layout, &mut values[*first..]).into_par_iter().map(|(i, j, tile)| {
            let (mut of_rows, mut of_columns) = (vec![0.0_f64; layout.height(i)], vec![0.0_f64; layout.height(j)]);
            for (r, of_row) in of_rows.iter_mut().enumerate() {
                for (t, of_column) in of_columns.iter_mut().enumerate() {
                    let value = &mut tile[place(layout.side(j), r, t)];
                    let old: f64 = (*value).into();
                    *value = T::round(old * (factors[i * TILE + r] * factors[j * TILE + t]));
                    let change = ((*value).into() - old).abs();
                    (*of_row, *of_column) = (of_row.max(change), of_column.max(change));
                }
            }
            (i, j, of_rows, of_columns)
        });
        let mut changes = vec![0.0_f64; factors.len()];
        for (i, j, of_rows, of_columns) in scaled.collect::<Vec<_>>() {
            for (block, of) in [(i, of_rows), (j, of_columns)] {
                changes[block * TILE..].iter_mut().zip(of).for_each(|(change, of)| *change = change.max(of));
            }
        }
        bounds.iter_mut().zip(changes).for_each(|(bound, change)| *bound += change);
    }
}

impl<T: Entry> PackedFormFactors<T> {
    /// Σ_t v_st x_t over the tiles right of the diagonal tile of row I: for each task's rows, band after band.
    fn right_of_diagonal(&self, level: Level, i: usize, x: &[f64], bands: usize) -> Vec<f64> {
        let (layout, stride) = (&self.layout, self.layout.stride());
        let mut sums = vec![0.0; layout.height(i).div_ceil(ROWS_OF_TASK) * bands * ROWS_OF_TASK];
        sums.par_chunks_mut(bands * ROWS_OF_TASK).enumerate().for_each(|(k, sums)| {
            let rows = k * ROWS_OF_TASK..((k + 1) * ROWS_OF_TASK).min(layout.side(i));
            for j in i + 1..layout.blocks() {
                let width = layout.side(j);
                run(
                    level,
                    Pass {
                        half: Half::Rows,
                        bands,
                        rows: &self.tile(i, j)[rows.start * width..rows.end * width],
                        width,
                        x_t: (&x[j * TILE..], stride),
                        x_s: (&[], 0),
                        sums: (&mut *sums, ROWS_OF_TASK),
                        y_t: (&mut [], 0),
                    },
                );
            }
        });
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Broken, Table, values};
    use super::*;
    use crate::stores::DenseFormFactors;

    /// Two tiles and a rest.
    const N: usize = 600;

    fn table() -> Table {
        Table { sources: N, targets: N }
    }

    #[test]
    fn tiles_hold_the_upper_triangle_and_lend_whole_rows() {
        let (store, cost) = PackedFormFactors::<f64>::assemble(&table()).unwrap();
        assert_eq!((cost.form_factors, cost.source_evaluations), ((N * (N + 1) / 2) as u64, N as u64));
        let mut buf = RowBuf::default();
        for s in [0, 31, 32, 255, 256, 511, 512, 599] {
            let row = store.row(s, 0, &mut buf).unwrap().entries;
            assert_eq!(row.stored(), N);
            assert!((0..N).all(|t| row.get(t) == Table::value(s, t) && store.entry(s, t) == row.get(t)), "row {s}");
        }
    }

    #[test]
    fn single_precision_rounds_each_entry_once_and_its_bound_covers_that() {
        let (store, _) = PackedFormFactors::<f32>::assemble(&Given(N, |s, t| 1.0 / (1 + s + t) as f64)).unwrap();
        for s in [0, 300, 599] {
            for t in 0..N {
                let (kept, value) = (store.entry(s, t), 1.0 / (1 + s + t) as f64);
                assert!((kept - value).abs() <= value * 2.0_f64.powi(-24) && kept == store.entry(t, s));
                assert!((kept - value).abs() <= store.row_bound(s));
            }
            // The worst of the rows down to it: 1/3 is off by 2⁻²⁶/3, and no entry below 1/2 by more than 2⁻²⁶.
            assert!(store.row_bound(s) >= 2.0_f64.powi(-26) / 3.0 && store.row_bound(s) <= 2.0_f64.powi(-26));
        }
    }

    #[test]
    fn scaling_goes_through_all_tiles_and_the_bounds_grow_by_what_it_changes() {
        let (mut store, _) = PackedFormFactors::<f64>::assemble(&table()).unwrap();
        let factors: Vec<f64> = (0..N).map(|s| 1.0 + (s % 7) as f64 / 64.0).collect();
        store.scale(&factors);
        for s in [0, 255, 256, 599] {
            let scaled = |t| Table::value(s, t) * (factors[s] * factors[t]);
            assert!((0..N).all(|t| store.entry(s, t) == scaled(t) && store.entry(t, s) == scaled(t)), "row {s}");
            let largest = (0..N).map(|t| (scaled(t) - Table::value(s, t)).abs()).fold(0.0, f64::max);
            assert_eq!(store.row_bound(s), s as f64 + largest);
        }
    }

    #[test]
    fn a_mirrored_row_has_the_largest_bound_of_the_rows_it_came_from() {
        let (store, _) = PackedFormFactors::<f64>::assemble(&table()).unwrap();
        assert_eq!((store.row_bound(0), store.row_bound(7)), (0.0, 7.0));
    }

    #[test]
    fn bytes_are_those_of_the_tiles_on_and_above_the_diagonal() {
        // Heights 256, 256 and 88, all multiples of 8.
        let entries = 3 * 256 * 256 + 2 * 256 * 88 + 88 * 88;
        let (store, _) = PackedFormFactors::<f64>::assemble(&table()).unwrap();
        assert_eq!(store.properties().stored_bytes, 8 * entries);
        assert_eq!(PackedFormFactors::<f32>::bytes(N), 4 * entries);
        // Large stores come near to half and a quarter of 8 n².
        let whole = 8 * 20_000_u64.pow(2);
        assert!((PackedFormFactors::<f64>::bytes(20_000) as f64) < 0.507 * whole as f64);
        assert!(PackedFormFactors::<f32>::bytes(20_000) < 820_000_000);
    }

    #[test]
    fn rows_that_are_not_symmetric_are_refused_by_name() {
        let error = StoreError::NeedsSymmetric { store: "packed-f32", rows: "broken" };
        assert_eq!(PackedFormFactors::<f32>::assemble(&Broken).map(|_| ()), Err(error));
    }

    #[test]
    fn a_store_over_its_limit_is_refused() {
        let needed = PackedFormFactors::<f32>::bytes(N);
        let error = StoreError::Memory { sources: N, targets: N, needed, limit: needed - 1 };
        assert_eq!(PackedFormFactors::<f32>::assemble_within(&table(), Some(needed - 1)).map(|_| ()), Err(error));
        assert!(PackedFormFactors::<f32>::assemble_within(&table(), Some(needed)).is_ok());
    }

    /// So many symmetric rows of given values, without an error.
    struct Given(usize, fn(usize, usize) -> f64);

    impl Rows for Given {
        fn name(&self) -> &'static str {
            "given"
        }
        fn sources(&self) -> usize {
            self.0
        }
        fn targets(&self) -> usize {
            self.0
        }
        fn symmetric(&self) -> bool {
            true
        }
        fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
            values.iter_mut().enumerate().for_each(|(t, v)| *v = self.1(s, t));
            Ok((Cost::default(), 0.0))
        }
    }

    #[test]
    fn what_single_precision_cannot_hold_is_named() {
        let error = StoreError::Value { source_index: 0, target_index: 0, value: f64::INFINITY };
        assert_eq!(PackedFormFactors::<f32>::assemble(&Given(3, |_, _| 1e39)).map(|_| ()), Err(error));
        assert!(PackedFormFactors::<f64>::assemble(&Given(3, |_, _| 1e39)).is_ok());
        let error = StoreError::Value { source_index: 0, target_index: 0, value: -1.0 };
        assert_eq!(PackedFormFactors::<f64>::assemble(&Given(3, |_, _| -1.0)).map(|_| ()), Err(error));
    }

    /// Sums of 600 terms of at most 4 that decay like 1/t²: rounding is that of sums below 30.
    #[test]
    fn products_are_those_of_the_dense_store_across_tiles() {
        let (store, _) = PackedFormFactors::<f64>::assemble(&table()).unwrap();
        let (dense, _) = DenseFormFactors::assemble(&table()).unwrap();
        for bands in [1, 3, 4, 5] {
            let x = values(bands, N);
            let (mut y, mut wanted) = (BandValues::zeros(bands, N), BandValues::zeros(bands, N));
            let cost = store.gather(x.view(), y.view_mut()).unwrap();
            let whole = dense.gather(x.view(), wanted.view_mut()).unwrap();
            assert_eq!((cost.entries, cost.flops), (whole.entries, whole.flops));
            assert_eq!(cost.bytes, store.properties().stored_bytes);
            assert!(y.values().iter().zip(wanted.values()).all(|(y, w)| (y - w).abs() < 1e-13));
        }
    }

    #[test]
    fn single_precision_tiles_are_applied_in_double_precision() {
        let (store, _) = PackedFormFactors::<f32>::assemble(&table()).unwrap();
        let (x, mut y) = (values(2, N), BandValues::zeros(2, N));
        store.gather(x.view(), y.view_mut()).unwrap();
        for s in (0..N).step_by(7) {
            for b in 0..2 {
                let sum: f64 = (0..N).map(|t| store.entry(s, t) * x.band(b)[t]).sum();
                assert!((y.band(b)[s] - sum).abs() < 1e-13, "{s}");
            }
        }
    }
}
