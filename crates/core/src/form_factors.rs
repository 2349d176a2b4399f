//! The trait that hands form factors to solvers, and its bodies over rows.

use std::ops::Range;

use rayon::prelude::*;

use crate::{BandValues, Bands, BandsMut, Cost, DrawBuf, Drawn, Draws, StoreError, sample_by_rows};

/// What holds for every row of a store.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Properties {
    /// A_s F_st = A_t F_ts to the last bit, in every band.
    pub symmetric: bool,
    /// Rows differ between bands (coloured mirrors); otherwise a row serves all bands.
    pub per_band: bool,
    /// Bytes the store holds for form factors now.
    pub stored_bytes: u64,
    /// Relative error that keeping an entry adds to it: 0 in double precision.
    pub rounding: f64,
}

/// One row of exchange areas A_s F_st, in the layout its store keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Entries<'a> {
    /// A value for every target.
    Dense(&'a [f64]),
    /// Values of the targets named, ascending; all others are 0.
    Sparse {
        /// Targets.
        targets: &'a [u32],
        /// Their values.
        values: &'a [f64],
    },
    /// Piecewise constant: `values[k]` for each of the targets from `ends[k − 1]` (0 for k = 0) up to `ends[k]`.
    Runs {
        /// One past the last target of each run, ascending.
        ends: &'a [u32],
        /// Value of every target of the run.
        values: &'a [f64],
    },
}

impl Entries<'_> {
    /// Number of values held.
    pub fn stored(&self) -> usize {
        match self {
            Self::Dense(values) | Self::Sparse { values, .. } | Self::Runs { values, .. } => values.len(),
        }
    }

    /// Calls `visit(t, A_s F_st)` for every entry that is held, in ascending t.
    pub fn for_each(&self, mut visit: impl FnMut(usize, f64)) {
        match *self {
            Self::Dense(values) => values.iter().enumerate().for_each(|(t, &v)| visit(t, v)),
            Self::Sparse { targets, values } => {
                targets.iter().zip(values).for_each(|(&t, &v)| visit(t as usize, v));
            }
            Self::Runs { ends, values } => {
                let mut begin = 0;
                for (&end, &v) in ends.iter().zip(values) {
                    (begin..end as usize).for_each(|t| visit(t, v));
                    begin = end as usize;
                }
            }
        }
    }

    /// Σ_t A_s F_st x_t.
    pub fn dot(&self, x: &[f64]) -> f64 {
        match *self {
            Self::Dense(values) => {
                // Eight running sums: the loop is bound by memory, not by the latency of one addition.
                let mut sums = [0.0; 8];
                let (head, tail) = values.split_at(values.len() / 8 * 8);
                for (v, x) in head.chunks_exact(8).zip(x.chunks_exact(8)) {
                    for k in 0..8 {
                        sums[k] += v[k] * x[k];
                    }
                }
                let rest: f64 = tail.iter().zip(&x[head.len()..]).map(|(v, x)| v * x).sum();
                sums.iter().sum::<f64>() + rest
            }
            _ => {
                let mut sum = 0.0;
                self.for_each(|t, v| sum += v * x[t]);
                sum
            }
        }
    }

    /// Σ_t A_s F_st.
    pub fn sum(&self) -> f64 {
        let mut sum = 0.0;
        self.for_each(|_, v| sum += v);
        sum
    }

    /// A_s F_st of one target.
    pub fn get(&self, t: usize) -> f64 {
        match *self {
            Self::Dense(values) => values[t],
            Self::Sparse { targets, values } => targets.binary_search(&(t as u32)).map_or(0.0, |k| values[k]),
            Self::Runs { ends, values } => values[ends.partition_point(|&end| end as usize <= t)],
        }
    }
}

/// A row and what lending it cost.
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    /// Exchange areas A_s F_st.
    pub entries: Entries<'a>,
    /// What *this call* spent.
    pub cost: Cost,
}

/// Scratch into which a store may compute a row it does not hold.
#[derive(Clone, Debug, Default)]
pub struct RowBuf {
    /// Values of the row.
    pub values: Vec<f64>,
    /// Targets, where the row is sparse.
    pub targets: Vec<u32>,
}

/// One block of a sweep: rows `range`, what they gather from outside the block, and the block itself.
#[derive(Debug)]
pub struct Block<'a> {
    /// Sources of the block.
    pub range: Range<usize>,
    /// Σ_{t outside the block} A_s F_st x_t for s in `range`, one band of `range.len()` values after another.
    pub outside: Bands<'a>,
    /// A_s F_st for s and t in `range`, row after row, one table for all bands (or one a band if
    /// [`Properties::per_band`]). Empty when the store is not square: then `outside` holds the whole sum.
    pub inside: &'a [f64],
}

/// What a sweep calls block by block: it may change x in the block's range and nowhere else.
pub type Relax<'a> = dyn FnMut(&Block<'_>, BandsMut<'_>) + 'a;

/// Exchange areas A_s F_st from `sources` to `targets`; F_st is the fraction of the power leaving s that arrives
/// directly at t.
///
/// Divided by A_s a row is a gather, divided by A_t the same row is a shot. A store that holds no symmetric matrix
/// serves rows of sources only.
pub trait FormFactors: Sync {
    /// Short name for tables: `dense`, `sparse`, `on-demand`, …
    fn name(&self) -> &'static str;

    /// Number of rows.
    fn sources(&self) -> usize;

    /// Length of a row.
    fn targets(&self) -> usize;

    /// What holds for every row.
    fn properties(&self) -> Properties;

    /// Exchange areas of source `s` with every target in `band`, computed if they must be.
    ///
    /// # Errors
    ///
    /// [`StoreError`] if the row cannot be had.
    ///
    /// # Panics
    ///
    /// If `s` is not below [`Self::sources`].
    fn row<'a>(&'a self, s: usize, band: usize, buf: &'a mut RowBuf) -> Result<Row<'a>, StoreError>;

    /// y_s = Σ_t A_s F_st x_t, all bands in one pass.
    ///
    /// # Errors
    ///
    /// As [`Self::row`].
    fn gather(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        gather_by_rows(self, x, y)
    }

    /// y_t = Σ_s A_s F_st x_s, all bands in one pass; rows with x_s = 0 in every band are not asked for.
    ///
    /// # Errors
    ///
    /// As [`Self::row`].
    fn scatter(&self, x: Bands<'_>, y: BandsMut<'_>) -> Result<Cost, StoreError> {
        scatter_by_rows(self, x, y)
    }

    /// Visits the sources in order, block by block, with the newest x: Gauss–Seidel at the speed of a gather.
    ///
    /// # Errors
    ///
    /// As [`Self::row`].
    fn sweep(&self, x: BandsMut<'_>, relax: &mut Relax<'_>) -> Result<Cost, StoreError> {
        sweep_by_rows(self, x, relax)
    }

    /// Draws targets of source `s` of area `area` in `band`: t with probability A_s F_st / T, T = max(`area`, Σ_t A_s F_st), and
    /// [`LOST`](crate::LOST) with what is left. All of `draws` together ask for one row.
    ///
    /// # Errors
    ///
    /// As [`Self::row`].
    fn sample(
        &self,
        s: usize,
        band: usize,
        area: f64,
        draws: &mut [Draws<'_>],
        buf: &mut DrawBuf,
    ) -> Result<Drawn, StoreError> {
        sample_by_rows(self, s, band, area, draws, buf)
    }

    /// Whether [`Self::sample`] draws from the entries that [`Self::row`] lends. Where it does not, it casts rays of its own: no row
    /// is had, and rows cannot verify what was drawn, since they carry errors that it has not.
    fn draws_from_rows(&self) -> bool {
        true
    }
}

/// Rows in a block of [`sweep_by_rows`], and in a piece of [`scatter_by_rows`]: large enough to keep threads busy,
/// fixed so that sums come out the same on any number of them.
const BLOCK: usize = 64;

/// [`FormFactors::gather`] over rows, in parallel.
///
/// # Errors
///
/// As [`FormFactors::row`].
///
/// # Panics
///
/// If `x` or `y` does not fit the store.
pub fn gather_by_rows<S: FormFactors + ?Sized>(
    store: &S,
    x: Bands<'_>,
    mut y: BandsMut<'_>,
) -> Result<Cost, StoreError> {
    let (bands, sources) = (x.count(), store.sources());
    assert_eq!((x.len(), y.len(), y.count()), (store.targets(), sources, bands), "gather: lengths");
    let rows = rows_dot(store, 0..sources, bands, |_, entries, band| entries.dot(x.band(band)))?;
    let mut cost = Cost::default();
    for (s, (sums, row_cost)) in rows.into_iter().enumerate() {
        cost += row_cost;
        sums.into_iter().enumerate().for_each(|(b, sum)| y.band(b)[s] = sum);
    }
    Ok(cost)
}

/// `apply(s, row, band)` of every source in `range` and every band, in parallel, with what the rows cost.
fn rows_dot<S: FormFactors + ?Sized>(
    store: &S,
    range: Range<usize>,
    bands: usize,
    apply: impl Fn(usize, &Entries<'_>, usize) -> f64 + Sync,
) -> Result<Vec<(Vec<f64>, Cost)>, StoreError> {
    let per_band = store.properties().per_band;
    range
        .into_par_iter()
        .map_init(RowBuf::default, |buf, s| {
            let (mut sums, mut cost) = (Vec::with_capacity(bands), Cost::default());
            if per_band {
                for b in 0..bands {
                    let row = store.row(s, b, buf)?;
                    cost += row.cost + Cost::applied(row.entries.stored(), 8, 1);
                    sums.push(apply(s, &row.entries, b));
                }
            } else {
                let row = store.row(s, 0, buf)?;
                cost += row.cost + Cost::applied(row.entries.stored(), 8, bands);
                sums.extend((0..bands).map(|b| apply(s, &row.entries, b)));
            }
            Ok((sums, cost))
        })
        .collect()
}

/// [`FormFactors::scatter`] over rows, in parallel over fixed pieces whose sums are added in order.
///
/// # Errors
///
/// As [`FormFactors::row`].
///
/// # Panics
///
/// If `x` or `y` does not fit the store.
pub fn scatter_by_rows<S: FormFactors + ?Sized>(
    store: &S,
    x: Bands<'_>,
    mut y: BandsMut<'_>,
) -> Result<Cost, StoreError> {
    let (bands, sources, targets) = (x.count(), store.sources(), store.targets());
    assert_eq!((x.len(), y.len(), y.count()), (sources, targets, bands), "scatter: lengths");
    let per_band = store.properties().per_band;
    // At most 16 pieces, however many rows: each needs a table of its own.
    let piece = sources.div_ceil(16).max(BLOCK);
    let pieces: Vec<(BandValues, Cost)> = (0..sources.div_ceil(piece))
        .into_par_iter()
        .map(|k| {
            let (mut sums, mut cost, mut buf) = (BandValues::zeros(bands, targets), Cost::default(), RowBuf::default());
            for s in k * piece..((k + 1) * piece).min(sources) {
                let lit = (0..bands).filter(|&b| x.band(b)[s] != 0.0);
                if per_band {
                    for b in lit {
                        let row = store.row(s, b, &mut buf)?;
                        cost += row.cost + Cost::applied(row.entries.stored(), 8, 1);
                        let (x_s, sums) = (x.band(b)[s], sums.band_mut(b));
                        row.entries.for_each(|t, v| sums[t] += v * x_s);
                    }
                } else if lit.count() > 0 {
                    let row = store.row(s, 0, &mut buf)?;
                    cost += row.cost + Cost::applied(row.entries.stored(), 8, bands);
                    for b in 0..bands {
                        let (x_s, sums) = (x.band(b)[s], sums.band_mut(b));
                        row.entries.for_each(|t, v| sums[t] += v * x_s);
                    }
                }
            }
            Ok((sums, cost))
        })
        .collect::<Result<_, StoreError>>()?;
    y.values().fill(0.0);
    let mut cost = Cost::default();
    for (sums, piece_cost) in pieces {
        cost += piece_cost;
        y.values().iter_mut().zip(sums.values()).for_each(|(y, v)| *y += v);
    }
    Ok(cost)
}

/// [`FormFactors::sweep`] over rows: the rows of a block in parallel, the blocks in order.
///
/// # Errors
///
/// As [`FormFactors::row`].
///
/// # Panics
///
/// If `x` does not fit the store (x has one value a target; a block's range lies in the targets when the store is
/// square, otherwise `relax` is handed the whole x and changes what it owns).
pub fn sweep_by_rows<S: FormFactors + ?Sized>(
    store: &S,
    mut x: BandsMut<'_>,
    relax: &mut Relax<'_>,
) -> Result<Cost, StoreError> {
    let (bands, sources, targets) = (x.count(), store.sources(), store.targets());
    assert_eq!(x.len(), targets, "sweep: x has {} values a band, the store {targets} targets", x.len());
    let square = sources == targets;
    let tables = if store.properties().per_band { bands } else { 1 };
    let mut cost = Cost::default();
    for begin in (0..sources).step_by(BLOCK) {
        let range = begin..(begin + BLOCK).min(sources);
        let view = x.view();
        // Rows of the block: the sum over all targets first, then the part inside the block taken out of x.
        let masked = if square { without(view, &range) } else { view.to_owned() };
        let rows: Vec<(Vec<f64>, Vec<f64>, Cost)> = range
            .clone()
            .into_par_iter()
            .map_init(RowBuf::default, |buf, s| {
                let (mut sums, mut inside, mut cost) = (Vec::with_capacity(bands), Vec::new(), Cost::default());
                for table in 0..tables {
                    let row = store.row(s, table, buf)?;
                    let served = if tables == 1 { 0..bands } else { table..table + 1 };
                    cost += row.cost + Cost::applied(row.entries.stored(), 8, served.len());
                    sums.extend(served.map(|b| row.entries.dot(masked.band(b))));
                    if square {
                        inside.extend(range.clone().map(|t| row.entries.get(t)));
                    }
                }
                Ok((sums, inside, cost))
            })
            .collect::<Result<_, StoreError>>()?;
        let len = range.len();
        let mut outside = BandValues::zeros(bands, len);
        let mut inside = vec![0.0; if square { tables * len * len } else { 0 }];
        for (k, (sums, row_inside, row_cost)) in rows.into_iter().enumerate() {
            cost += row_cost;
            sums.into_iter().enumerate().for_each(|(b, sum)| outside.band_mut(b)[k] = sum);
            for (table, values) in row_inside.chunks(len).enumerate() {
                let at = (table * len + k) * len;
                inside[at..at + len].copy_from_slice(values);
            }
        }
        relax(&Block { range, outside: outside.view(), inside: &inside }, x.reborrow());
    }
    Ok(cost)
}

/// A copy of x that is zero in `range`.
fn without(x: Bands<'_>, range: &Range<usize>) -> BandValues {
    let mut x = x.to_owned();
    (0..x.count()).for_each(|b| x.band_mut(b)[range.clone()].fill(0.0));
    x
}
