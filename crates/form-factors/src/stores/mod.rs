//! Stores: what keeps, or computes when asked, the rows that an estimator gives.
//!
//! | store | holds | lends | made for |
//! |---|---|---|---|
//! | [`DenseFormFactors`] | every entry, 8 bytes | without a copy | closed rooms, direct methods |
//! | [`SparseFormFactors`] | entries that are not zero, 12 bytes each | without a copy | scenes that hide most pairs |
//! | [`PackedFormFactors`] | symmetric entries once, in tiles of 4 or 8 bytes an entry | a row copied to the caller's buffer | large closed rooms, products at the speed of memory |
//! | [`MovableFormFactors`] | every entry, 8 bytes | without a copy | meshes that are refined between solutions |
//! | [`DiagonalBlocks`] | stores of parts that exchange nothing | as its parts | rooms that do not see each other |
//! | [`ThinnedFormFactors`] | a store without small pairs, and the sums of its rows | a row copied | answers within a tolerance |
//! | [`OnDemand`] | nothing, or the rows asked for so far | a row computed in the caller's buffer | shooting, little memory |
//!
//! All of them give the same bytes at any number of threads, and all but the packed one serve rectangular and unsymmetric
//! rows too. Those that hold their entries are [`Held`] and can be scaled in place, for [`crate::repair`]. [`aggregate`] sums rows and
//! columns of elements to patches. What is *not* here: estimators, and any change of a value that nobody asked for (normalising; small pairs are
//! dropped by [`crate::thinning`]).

mod dense;
mod diagonal_blocks;
mod dot;
mod extended;
mod lanes;
mod movable;
mod on_demand;
mod packed;
mod sparse;
mod thinned;
mod tiles;

use std::ops::Range;

use radiosity_core::{BandValues, Bands, BandsMut, Block, Cost, FormFactors, Relax, RowBuf, StoreError};
use rayon::prelude::*;

pub use dense::DenseFormFactors;
pub use diagonal_blocks::{DiagonalBlocks, Part};
pub use extended::ExtendedFormFactors;
pub use movable::{MovableFormFactors, Source};
pub use on_demand::{Keep, OnDemand};
pub use packed::PackedFormFactors;
pub use sparse::SparseFormFactors;
pub use thinned::{GivenBack, ThinnedFormFactors};
pub use tiles::Entry;

/// A store that holds its entries, with a bound for each row, and can scale them in place.
pub trait Held: FormFactors + Send {
    /// Bound of the error of every entry of row s (three standard errors where sampled), if the estimator gave one.
    fn bound(&self, s: usize) -> Option<f64>;

    /// Turns A_s F_st into d_s A_s F_st d_t: symmetry to the last bit, zeros and signs stay. Takes no memory.
    ///
    /// The bound of a row grows by the largest change of its entries.
    ///
    /// # Panics
    ///
    /// If there is not one factor a source, or the store is not square.
    fn scale(&mut self, factors: &[f64]);
}

/// One factor a row, and a square store.
fn assert_factors(store: &impl FormFactors, factors: &[f64]) {
    let sizes = (store.sources(), store.targets());
    assert_eq!(sizes, (factors.len(), factors.len()), "scale: factors of a square store");
}

/// Scales the entries `values` of one row in the columns that `factors` belongs to by those and `d_s`; the largest change.
fn scale_row<'a>(d_s: f64, factors: impl Iterator<Item = f64>, values: impl Iterator<Item = &'a mut f64>) -> f64 {
    // The product of the two factors first: the same for (s, t) and (t, s).
    values.zip(factors).fold(0.0, |change: f64, (value, d_t)| {
        let old = std::mem::replace(value, *value * (d_s * d_t));
        change.max((*value - old).abs())
    })
}

/// Rows of a product that one task computes; fixed, so that the work is cut alike at any number of threads.
const PIECE: usize = 16;

/// Sums the rows of elements to rows of their patches: A_p F_pt = Σ_{e in p} A_e F_et.
///
/// `parent[e]` is the patch, of `n`, of source e. This is how the two-level form gets its n × n matrix from rows of
/// elements. The rows of the store are asked for in parallel over patches; their cost is returned.
///
/// # Errors
///
/// [`StoreError`] if a row cannot be had.
///
/// # Panics
///
/// If `parent` does not fit the store, names a patch beyond `n`, or the store's rows differ between bands.
pub fn aggregate_sources(
    store: &dyn FormFactors,
    parent: &[u32],
    n: usize,
) -> Result<(DenseFormFactors, Cost), StoreError> {
    let columns: Vec<u32> = (0..store.targets() as u32).collect();
    aggregate(store, (parent, n), (&columns, store.targets()))
}

/// Sums rows and columns to groups: A_p F_pq = Σ_{s in p} Σ_{t in q} A_s F_st.
///
/// Each side is a map from index to group and the number of groups. If the store is symmetric and both maps are the
/// same, the result is symmetric to the last bit (the upper triangle is mirrored).
///
/// # Errors
///
/// [`StoreError`] if a row cannot be had.
///
/// # Panics
///
/// If a map does not fit the store or names a group that does not exist, or the store's rows differ between bands.
pub fn aggregate(
    store: &dyn FormFactors,
    (row_groups, rows): (&[u32], usize),
    (column_groups, columns): (&[u32], usize),
) -> Result<(DenseFormFactors, Cost), StoreError> {
    assert_eq!((row_groups.len(), column_groups.len()), (store.sources(), store.targets()), "aggregate: lengths");
    assert!(!store.properties().per_band, "aggregate: rows that differ between bands have no single sum");
    let symmetric = store.properties().symmetric && rows == columns && row_groups == column_groups;
    // Sources of every group, ascending, so that sums come out the same on any number of threads.
    let mut members = vec![Vec::new(); rows];
    for (s, &p) in row_groups.iter().enumerate() {
        assert!((p as usize) < rows, "aggregate: source {s} is in group {p} of {rows}");
        members[p as usize].push(s);
    }
    if let Some(t) = column_groups.iter().position(|&q| q as usize >= columns) {
        panic!("aggregate: target {t} is in group {} of {columns}", column_groups[t]);
    }
    DenseFormFactors::fill(rows, columns, symmetric, None, |p, sums| {
        let (mut cost, mut buf) = (Cost::default(), RowBuf::default());
        for &s in &members[p] {
            let row = store.row(s, 0, &mut buf)?;
            cost += row.cost + Cost::applied(row.entries.stored(), 8, 1);
            row.entries.for_each(|t, value| sums[column_groups[t] as usize] += value);
        }
        Ok((cost, None))
    })
}

/// Refuses what is no exchange area.
fn check_value(source_index: usize, target_index: usize, value: f64) -> Result<(), StoreError> {
    if value.is_finite() && value >= 0.0 {
        return Ok(());
    }
    Err(StoreError::Value { source_index, target_index, value })
}

/// [`check_value`] of the entries of row `s` from target `first` on.
fn check_row(s: usize, first: usize, values: &[f64]) -> Result<(), StoreError> {
    let values = &values[first..];
    // All at once, since a fault is rare; false for what is no number.
    if values.iter().fold(true, |sound, value| sound & (*value >= 0.0) & (*value < f64::INFINITY)) {
        return Ok(());
    }
    values.iter().enumerate().try_for_each(|(k, &value)| check_value(s, first + k, value))
}

/// Refuses a store that needs more than `limit` bytes.
fn check_memory(sources: usize, targets: usize, needed: u64, limit: Option<u64>) -> Result<(), StoreError> {
    match limit {
        Some(limit) if needed > limit => Err(StoreError::Memory { sources, targets, needed, limit }),
        _ => Ok(()),
    }
}

/// Entries to read that are worth waking another thread for.
const WORTH_IT: usize = 1 << 14;

/// Tasks of so many entries, about, that one thread takes together.
fn tasks_worth_it(entries: usize) -> usize {
    WORTH_IT.div_ceil(entries.max(1))
}

/// Sets y_s in all bands to the sums that `dots(s, sums)` fills in, rows in parallel over fixed pieces.
fn by_rows(y: BandsMut<'_>, dots: impl Fn(usize, &mut [f64]) + Sync) {
    let bands = y.count();
    by_pieces(y, |rows, sums| rows.zip(sums.chunks_exact_mut(bands)).for_each(|(s, sums)| dots(s, sums)));
}

/// Sets y in all bands to what `dots(rows, sums)` fills in, in parallel over pieces of at most [`PIECE`] rows: sums of one row after another.
fn by_pieces(mut y: BandsMut<'_>, dots: impl Fn(Range<usize>, &mut [f64]) + Sync) {
    let (bands, len) = (y.count(), y.len());
    let fill = |sums: &mut [f64]| {
        sums.par_chunks_mut(PIECE * bands).enumerate().with_min_len(tasks_worth_it(PIECE * len)).for_each(
            |(k, piece)| {
                dots(k * PIECE..k * PIECE + piece.len() / bands, piece);
            },
        );
    };
    match bands {
        0 => (),
        1 => fill(y.values()),
        _ => {
            // Row after row while threads write, then turned to band after band.
            let mut sums = vec![0.0; len * bands];
            fill(&mut sums);
            for b in 0..bands {
                y.band(b).iter_mut().zip(sums[b..].iter().step_by(bands)).for_each(|(y, sum)| *y = *sum);
            }
        }
    }
}

/// Rows of a block of a sweep: enough to share among threads, few enough for its inside to stay in the cache.
const BLOCK: usize = 64;
/// Rows of a block that one task sums.
const ROWS_OF_TASK: usize = 8;

/// A sweep of a square store, block by block.
///
/// Before each block `next(state, block, x)` may look at the newest x; then `fill(state, rows, x, sums, inside)` gives what some of its rows
/// gather from outside the block, the bands of one row after another, and puts what lies inside it over zeros, in parallel.
///
/// # Panics
///
/// If x does not have `n` values a band.
fn by_blocks<T: Sync>(
    n: usize,
    mut x: BandsMut<'_>,
    relax: &mut Relax<'_>,
    state: &mut T,
    next: impl Fn(&mut T, &Range<usize>, Bands<'_>),
    fill: impl Fn(&T, Range<usize>, Bands<'_>, &mut [f64], &mut [f64]) + Sync,
) {
    let bands = x.count();
    assert_eq!(x.len(), n, "sweep: x has {} values a band, the store {n} targets", x.len());
    for begin in (0..n).step_by(BLOCK) {
        let block = begin..(begin + BLOCK).min(n);
        let (len, view) = (block.len(), x.view());
        next(state, &block, view);
        let (state, mut inside, mut sums) = (&*state, vec![0.0; len * len], vec![0.0; bands * len]);
        let tasks = inside.par_chunks_mut(ROWS_OF_TASK * len).zip(sums.par_chunks_mut(ROWS_OF_TASK * bands));
        tasks.enumerate().with_min_len(tasks_worth_it(ROWS_OF_TASK * n)).for_each(|(k, (inside, sums))| {
            let first = begin + k * ROWS_OF_TASK;
            fill(state, first..first + inside.len() / len, view, sums, inside);
        });
        let mut outside = BandValues::zeros(bands, len);
        for b in 0..bands {
            outside.band_mut(b).iter_mut().zip(sums[b..].iter().step_by(bands)).for_each(|(to, sum)| *to = *sum);
        }
        relax(&Block { range: block, outside: outside.view(), inside: &inside }, x.reborrow());
    }
}

/// Lengths of a product must fit the store.
fn assert_lengths(what: &str, (x_len, y_len): (usize, usize), x: Bands<'_>, y: &BandsMut<'_>) {
    assert_eq!((x.len(), y.len(), y.count()), (x_len, y_len, x.count()), "{what}: lengths");
}

#[cfg(test)]
pub(crate) mod tests {
    use radiosity_core::{BandValues, Cost, StoreError};

    use super::*;
    use crate::Rows;

    /// Exchange areas v(s, t) given by a function, with some zeros; symmetric when square.
    pub(crate) struct Table {
        pub sources: usize,
        pub targets: usize,
    }

    impl Table {
        pub fn value(s: usize, t: usize) -> f64 {
            let (low, high) = (s.min(t) as f64, s.max(t) as f64);
            if (s * t + s + t).is_multiple_of(3) { 0.0 } else { 1.0 / (1.0 + 3.0 * low + high * high) }
        }
    }

    impl Rows for Table {
        fn name(&self) -> &'static str {
            "table"
        }
        fn sources(&self) -> usize {
            self.sources
        }
        fn targets(&self) -> usize {
            self.targets
        }
        fn symmetric(&self) -> bool {
            self.sources == self.targets
        }
        fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
            values.iter_mut().enumerate().for_each(|(t, v)| *v = Self::value(s, t));
            Ok((Cost { form_factors: self.targets as u64, source_evaluations: 1, ..Cost::default() }, s as f64))
        }
        fn upper_row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
            // What lies below the diagonal is rubbish on purpose: stores must not use it.
            values[..s].fill(f64::NAN);
            values[s..].iter_mut().enumerate().for_each(|(k, v)| *v = Self::value(s, s + k));
            let form_factors = (self.targets - s) as u64;
            Ok((Cost { form_factors, source_evaluations: 1, ..Cost::default() }, s as f64))
        }
    }

    /// A table that holds one value that is no exchange area.
    pub(crate) struct Broken;

    impl Rows for Broken {
        fn name(&self) -> &'static str {
            "broken"
        }
        fn sources(&self) -> usize {
            5
        }
        fn targets(&self) -> usize {
            3
        }
        fn symmetric(&self) -> bool {
            false
        }
        fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
            values.fill(1.0);
            if s == 3 {
                values[1] = -2.0;
            }
            Ok((Cost::default(), 0.0))
        }
    }

    /// Values in `bands` bands that no symmetry hides.
    pub(crate) fn values(bands: usize, len: usize) -> BandValues {
        BandValues::new((0..bands * len).map(|k| ((k * 7 + 3) % 11) as f64 - 4.0).collect(), len)
    }

    /// Every store of a table, with its name.
    pub(crate) fn stores(sources: usize, targets: usize) -> Vec<Box<dyn FormFactors>> {
        let table = || Table { sources, targets };
        let mut all: Vec<Box<dyn FormFactors>> = vec![
            Box::new(DenseFormFactors::assemble(&table()).unwrap().0),
            Box::new(SparseFormFactors::assemble(&table()).unwrap().0),
            Box::new(OnDemand::new(Box::new(table()), Keep::None)),
            Box::new(OnDemand::new(Box::new(table()), Keep::All)),
        ];
        if sources == targets {
            all.push(Box::new(PackedFormFactors::<f64>::assemble(&table()).unwrap().0));
        }
        all
    }

    /// Sums of at most 70 terms below 5 in size: 1e-13 is 20 roundings of the largest.
    const SUM: f64 = 1e-13;

    #[test]
    fn products_of_every_store_are_the_sums_over_the_table() {
        for (sources, targets) in [(1, 1), (7, 7), (70, 70), (70, 9), (3, 70), (20, 1100)] {
            for store in stores(sources, targets) {
                for bands in [1, 2, 3, 4, 7] {
                    let (x, z) = (values(bands, targets), values(bands, sources));
                    let (mut y, mut w) = (BandValues::zeros(bands, sources), BandValues::zeros(bands, targets));
                    store.gather(x.view(), y.view_mut()).unwrap();
                    store.scatter(z.view(), w.view_mut()).unwrap();
                    for b in 0..bands {
                        for s in 0..sources {
                            let sum: f64 = (0..targets).map(|t| Table::value(s, t) * x.band(b)[t]).sum();
                            assert!((sum - y.band(b)[s]).abs() < SUM, "gather {} {sources} × {targets}", store.name());
                        }
                        for t in 0..targets {
                            let sum: f64 = (0..sources).map(|s| Table::value(s, t) * z.band(b)[s]).sum();
                            assert!((sum - w.band(b)[t]).abs() < SUM, "scatter {} {sources} × {targets}", store.name());
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn products_give_the_same_bytes_in_pools_of_1_2_and_8_threads() {
        for store in stores(600, 600).into_iter().chain(stores(150, 1100)) {
            let (sources, targets) = (store.sources(), store.targets());
            let run = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| {
                    let (mut y, mut w) = (BandValues::zeros(3, sources), BandValues::zeros(3, targets));
                    store.gather(values(3, targets).view(), y.view_mut()).unwrap();
                    store.scatter(values(3, sources).view(), w.view_mut()).unwrap();
                    (y, w)
                })
            };
            let one = run(1);
            assert!(one == run(2) && one == run(8), "{}", store.name());
        }
    }

    #[test]
    fn a_value_that_is_no_exchange_area_is_named() {
        let error = StoreError::Value { source_index: 3, target_index: 1, value: -2.0 };
        assert_eq!(DenseFormFactors::assemble(&Broken).map(|_| ()), Err(error.clone()));
        assert_eq!(SparseFormFactors::assemble(&Broken).map(|_| ()), Err(error.clone()));
        let store = OnDemand::new(Box::new(Broken), Keep::All);
        assert_eq!(store.row(3, 0, &mut RowBuf::default()).map(|_| ()), Err(error));
    }

    #[test]
    fn a_store_over_its_memory_limit_is_refused_with_both_numbers() {
        let table = Table { sources: 8, targets: 40 };
        let needed = 8 * 8 * 40;
        let error = StoreError::Memory { sources: 8, targets: 40, needed, limit: needed - 1 };
        assert_eq!(DenseFormFactors::assemble_within(&table, Some(needed - 1)).map(|_| ()), Err(error));
        assert!(DenseFormFactors::assemble_within(&table, Some(needed)).is_ok());
    }

    #[test]
    fn rows_of_groups_are_sums_of_rows() {
        let (row_groups, column_groups) = ([0, 2, 1, 1, 0, 2, 2], [1, 0, 0, 2, 1]);
        for store in stores(7, 5) {
            let (sums, cost) = aggregate(&*store, (&row_groups, 3), (&column_groups, 3)).unwrap();
            // (s + 1)(t + 1) leaves 1 divided by 3 in 3 · 2 + 2 · 2 of the 35 places: those are zero.
            assert_eq!(cost.entries, if store.name() == "sparse" { 25 } else { 35 });
            for p in 0..3 {
                for q in 0..3 {
                    let members = (0..7).flat_map(|s| (0..5).map(move |t| (s, t)));
                    let wanted = members.filter(|&(s, t)| row_groups[s] == p && column_groups[t] == q);
                    let sum: f64 = wanted.map(|(s, t)| Table::value(s, t)).sum();
                    assert!((sums.entry(p as usize, q as usize) - sum).abs() < SUM);
                }
            }
        }
    }

    #[test]
    fn the_same_groups_on_both_sides_of_a_symmetric_store_stay_symmetric() {
        let groups: Vec<u32> = (0..70).map(|e| (e * e) % 9).collect();
        let (sums, _) = aggregate(&*stores(70, 70)[0], (&groups, 9), (&groups, 9)).unwrap();
        assert!(sums.properties().symmetric);
        assert!((0..9).all(|p| (0..9).all(|q| sums.entry(p, q) == sums.entry(q, p))));
    }

    #[test]
    fn patch_rows_keep_every_target() {
        let parent = [0, 1, 1, 0];
        let (rows, _) = aggregate_sources(&*stores(4, 6)[1], &parent, 2).unwrap();
        assert_eq!((rows.sources(), rows.targets()), (2, 6));
        assert_eq!(rows.entry(1, 5), Table::value(1, 5) + Table::value(2, 5));
    }
}
