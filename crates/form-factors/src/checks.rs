//! Checks of form factors: closure, reciprocity, sign and size, and that what blocks only takes away.
//!
//! Nothing is changed here ([`crate::repair`] does, on closed scenes). Row sums of a closed scene are 1; those of an open
//! one are smaller, what is missing goes to the surroundings, and an open scene is never normalised.

use std::ops::Range;

use radiosity_core::{Entries, FormFactors, RowBuf, StoreError};
use radiosity_geometry::Facets;
use rayon::prelude::*;

use crate::Estimate;
use crate::analytic::unoccluded;

/// Rows named in [`Checks::worst_rows`] at most.
const WORST: usize = 5;

/// What a store of form factors violates, and where.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Checks {
    /// Row sums Σ_t F_st. `None` if no row has an area.
    pub row_sums: Option<RowSums>,
    /// The worst rows, worst first, with their sums: farthest from 1 in a closed scene, largest in an open one.
    pub worst_rows: Vec<(usize, f64)>,
    /// Rows that sum to more than 1 by more than the rounding of a sum.
    pub rows_above_one: u64,
    /// Closure: the row with the largest |Σ_t F_st − 1|, and that difference with its sign. `None` for an open scene,
    /// whose rows need not sum to 1.
    pub closure: Option<(usize, f64)>,
    /// The row with the largest Σ_t F_st, and that sum: at most 1 in any scene. `None` if there is no row.
    pub largest_row_sum: Option<(usize, f64)>,
    /// Reciprocity: the pair s < t with the largest |A_s F_st − A_t F_ts| / min(A_s, A_t), and that number. `None` if the store is
    /// not square or has a single row.
    pub reciprocity: Option<(usize, usize, f64)>,
    /// The entry with the largest A_s F_st / min(A_s, A_t), and that number: at most 1 in any scene. `None` if all are 0.
    pub largest_share: Option<(usize, usize, f64)>,
    /// Entries A_s F_st above min(A_s, A_t) by more than rounding.
    pub above_area: u64,
    /// Entries with F_st above 1 by more than rounding: some of those above an area.
    pub above_one: u64,
    /// Entries below 0.
    pub negative: u64,
}

/// Row sums Σ_t F_st of the sources that have an area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowSums {
    /// Smallest.
    pub smallest: f64,
    /// Largest.
    pub largest: f64,
    /// Area-weighted mean.
    pub mean: f64,
}

/// What one row says.
struct RowChecks {
    sum: f64,
    largest_share: Option<(usize, f64)>,
    above_area: u64,
    above_one: u64,
    negative: u64,
}

/// Reads all rows (band 0) and reports what they violate.
///
/// `closed` says that every ray from a front side meets a front side again. Rows are read in parallel, once; those of a square
/// store that is not symmetric once more for every 64 sources, a part of each, with 512 bytes a source and thread kept
/// meanwhile; sparse ones for every 512, whose entries are kept. A store that recomputes its rows pays for each reading.
///
/// # Errors
///
/// [`StoreError`] if the store cannot give a row.
///
/// # Panics
///
/// If the areas do not fit the store.
pub fn check(
    store: &dyn FormFactors,
    source_areas: &[f64],
    target_areas: &[f64],
    closed: bool,
) -> Result<Checks, StoreError> {
    check_beside(store, source_areas, target_areas, closed, &[])
}

/// [`check`] of rows that exchange so much with what the store does not hold, which counts in their sums; nothing if `beside` is empty.
///
/// # Errors
///
/// As [`check`].
///
/// # Panics
///
/// As [`check`], and if `beside` has not one value a source.
pub fn check_beside(
    store: &dyn FormFactors,
    source_areas: &[f64],
    target_areas: &[f64],
    closed: bool,
    beside: &[f64],
) -> Result<Checks, StoreError> {
    let (sources, targets) = (store.sources(), store.targets());
    assert_eq!((source_areas.len(), target_areas.len()), (sources, targets), "check: areas of sources and targets");
    assert!(beside.is_empty() || beside.len() == sources, "check: {} values beside {sources} rows", beside.len());
    // A face without an area sends and receives nothing.
    let lit: Vec<usize> = (0..sources).filter(|&s| source_areas[s] > 0.0).collect();
    let rows: Vec<RowChecks> = lit
        .par_iter()
        .map_init(RowBuf::default, |buf, &s| {
            let row = check_row(&store.row(s, 0, buf)?.entries, source_areas[s], target_areas);
            Ok(RowChecks { sum: row.sum + beside.get(s).copied().unwrap_or(0.0), ..row })
        })
        .collect::<Result<_, StoreError>>()?;
    let sums: Vec<(usize, f64)> = lit.iter().zip(&rows).map(|(&s, row)| (s, row.sum / source_areas[s])).collect();
    let mut checks = Checks { row_sums: summary(&rows, &sums, source_areas), ..Checks::default() };
    let rounding = targets as f64 * f64::EPSILON;
    for (&(s, sum), row) in sums.iter().zip(&rows) {
        checks.rows_above_one += u64::from(sum > 1.0 + rounding);
        checks.above_area += row.above_area;
        checks.above_one += row.above_one;
        checks.negative += row.negative;
        if let Some((t, share)) = row.largest_share
            && checks.largest_share.is_none_or(|(.., largest)| share > largest)
        {
            checks.largest_share = Some((s, t, share));
        }
        if checks.largest_row_sum.is_none_or(|(_, largest)| sum > largest) {
            checks.largest_row_sum = Some((s, sum));
        }
    }
    // Ties keep the order of rows. NaN counts as worst.
    let distance = |sum: f64| if closed { (sum - 1.0).abs() } else { sum };
    let mut worst = sums;
    worst.sort_by(|a, b| distance(b.1).total_cmp(&distance(a.1)));
    worst.truncate(WORST);
    checks.closure = worst.first().filter(|_| closed).map(|&(s, sum)| (s, sum - 1.0));
    checks.worst_rows = worst;
    if sources == targets {
        checks.reciprocity = if store.properties().symmetric {
            // To the last bit, as a symmetric store must.
            lit.first().zip(lit.get(1)).map(|(&s, &t)| (s, t, 0.0))
        } else {
            reciprocity(store, source_areas)?
        };
    }
    Ok(checks)
}

fn check_row(row: &Entries<'_>, area: f64, target_areas: &[f64]) -> RowChecks {
    let above = 1.0 + 8.0 * f64::EPSILON;
    let mut checks = RowChecks { sum: row.sum(), largest_share: None, above_area: 0, above_one: 0, negative: 0 };
    let mut largest = 0.0;
    row.for_each(|t, value| {
        let limit = area.min(target_areas[t]);
        checks.negative += u64::from(value < 0.0);
        checks.above_area += u64::from(value > limit * above);
        checks.above_one += u64::from(value > area * above);
        if value > largest * limit {
            largest = value / limit;
            checks.largest_share = Some((t, largest));
        }
    });
    checks
}

fn summary(rows: &[RowChecks], sums: &[(usize, f64)], areas: &[f64]) -> Option<RowSums> {
    let mut sums = sums.iter().map(|(_, sum)| *sum);
    let first = sums.next()?;
    let (smallest, largest) = sums.fold((first, first), |(lo, hi), sum| (lo.min(sum), hi.max(sum)));
    let total: f64 = rows.iter().map(|row| row.sum).sum();
    Some(RowSums { smallest, largest, mean: total / areas.iter().sum::<f64>() })
}

/// Sources whose rows [`reciprocity`] holds at a time: full ones, and sparse ones, of which every row is looked into once a block.
const BLOCK: usize = 64;
const SPARSE_BLOCK: usize = 512;

/// A pair s < t with |A_s F_st − A_t F_ts| / min(A_s, A_t).
type Differing = (usize, usize, f64);

/// The pair with the largest |A_s F_st − A_t F_ts| / min(A_s, A_t), the first of them.
///
/// Block by block of sources: their rows are held, and of all rows after them the part in the columns of the block is read.
fn reciprocity(store: &dyn FormFactors, areas: &[f64]) -> Result<Option<Differing>, StoreError> {
    let n = store.sources();
    let mut buf = RowBuf::default();
    let sparse = n > 0 && matches!(store.row(0, 0, &mut buf)?.entries, Entries::Sparse { .. });
    let (size, of_block): (_, OfBlock) =
        if sparse { (SPARSE_BLOCK, sparse_block_reciprocity) } else { (BLOCK, block_reciprocity) };
    let blocks: Vec<Option<Differing>> = (0..n.div_ceil(size))
        .into_par_iter()
        .map(|k| of_block(store, areas, k * size..((k + 1) * size).min(n)))
        .collect::<Result<_, StoreError>>()?;
    Ok(blocks.into_iter().flatten().reduce(worse))
}

type OfBlock = fn(&dyn FormFactors, &[f64], Range<usize>) -> Result<Option<Differing>, StoreError>;

/// The one that differs more, the first if they are alike.
fn worse(a: Differing, b: Differing) -> Differing {
    if b.2 > a.2 || b.2 == a.2 && (b.0, b.1) < (a.0, a.1) { b } else { a }
}

/// The worst pair of a source of `block` and a later one, their rows held in full.
fn block_reciprocity(
    store: &dyn FormFactors,
    areas: &[f64],
    block: Range<usize>,
) -> Result<Option<Differing>, StoreError> {
    let n = store.sources();
    let (mut buf, mut held) = (RowBuf::default(), vec![0.0; block.len() * n]);
    for (s, row) in block.clone().zip(held.chunks_exact_mut(n)) {
        place(&store.row(s, 0, &mut buf)?.entries, 0..n, row);
    }
    let (mut worst, mut partners): (Option<Differing>, _) = (None, vec![0.0; block.len()]);
    for t in block.start + 1..n {
        place(&store.row(t, 0, &mut buf)?.entries, block.clone(), &mut partners);
        for s in block.start..t.min(block.end) {
            let smaller = areas[s].min(areas[t]);
            let share = (held[(s - block.start) * n + t] - partners[s - block.start]).abs() / smaller;
            if smaller > 0.0 && worst.is_none_or(|worst| worse(worst, (s, t, share)) != worst) {
                worst = Some((s, t, share));
            }
        }
    }
    Ok(worst)
}

/// The same of sparse rows, which are held by target: pairs both entries of which are 0 are not looked at.
fn sparse_block_reciprocity(
    store: &dyn FormFactors,
    areas: &[f64],
    block: Range<usize>,
) -> Result<Option<Differing>, StoreError> {
    let (n, mut buf) = (store.sources(), RowBuf::default());
    // Entries (s, value) of every later target, sources in order.
    let mut ends = vec![0; n + 1];
    for s in block.clone() {
        store.row(s, 0, &mut buf)?.entries.for_each(|t, _| ends[t] += usize::from(t > s));
    }
    let mut all = 0;
    for end in &mut ends {
        all += std::mem::replace(end, all);
    }
    let mut held = vec![(0, 0.0); all];
    for s in block.clone() {
        store.row(s, 0, &mut buf)?.entries.for_each(|t, value| {
            if t > s {
                held[ends[t]] = (s, value);
                ends[t] += 1;
            }
        });
    }
    // A pair of which both are held has 0 before its first.
    let mut worst = (block.start + 1 < n && areas[block.start].min(areas[block.start + 1]) > 0.0).then_some((
        block.start,
        block.start + 1,
        0.0,
    ));
    let mut compare = |s: usize, t: usize, difference: f64| {
        let smaller = areas[s].min(areas[t]);
        let pair = (s, t, difference.abs() / smaller);
        if smaller > 0.0 && worst.is_none_or(|worst| worse(worst, pair) != worst) {
            worst = Some(pair);
        }
    };
    for t in block.start + 1..n {
        let mut to_t = held[ends[t - 1]..ends[t]].iter().copied().peekable();
        let mut from_t = |s: usize, value: f64| {
            while let Some((before, alone)) = to_t.next_if(|(of, _)| *of < s) {
                compare(before, t, alone);
            }
            let partner = to_t.next_if(|(of, _)| *of == s).map_or(0.0, |(_, partner)| partner);
            compare(s, t, partner - value);
        };
        if let Entries::Sparse { targets, values } = store.row(t, 0, &mut buf)?.entries {
            let first = targets.partition_point(|s| (*s as usize) < block.start);
            let inside = targets[first..].iter().zip(&values[first..]);
            inside.take_while(|(s, _)| (**s as usize) < t.min(block.end)).for_each(|(s, v)| from_t(*s as usize, *v));
        }
        to_t.for_each(|(s, alone)| compare(s, t, alone));
    }
    Ok(worst)
}

/// The entries of a row in the columns of `range`, zeros included.
fn place(row: &Entries<'_>, range: Range<usize>, to: &mut [f64]) {
    match *row {
        Entries::Dense(values) => to.copy_from_slice(&values[range]),
        Entries::Sparse { targets, values } => {
            to.fill(0.0);
            let first = targets.partition_point(|t| (*t as usize) < range.start);
            let inside = targets[first..].iter().zip(&values[first..]);
            inside
                .take_while(|(t, _)| (**t as usize) < range.end)
                .for_each(|(t, v)| to[*t as usize - range.start] = *v);
        }
        Entries::Runs { .. } => {
            row.for_each(|t, v| {
                if range.contains(&t) {
                    to[t - range.start] = v;
                }
            });
        }
    }
}

/// Form factors compared with what they would be if nothing blocked.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BlockedPairs {
    /// Pairs compared.
    pub compared: u64,
    /// Of those, pairs from which something takes light away: smaller by more than the bounds.
    pub reduced: u64,
    /// Of those, pairs that are larger than unblocked by more than the bounds.
    pub increased: u64,
    /// The pair with the largest excess over the unblocked value, beyond the bounds and relative to min(A_s, A_t), and that excess:
    /// not above 0 if all is well.
    pub largest_excess: Option<(usize, usize, f64)>,
}

/// Rows of which [`check_blocked`] compares some pairs at most, and pairs of each.
const SAMPLED: (usize, usize) = (64, 32);

/// Compares pairs of a store between `facets` with their unblocked exchange areas: what blocks never adds.
///
/// Up to 64 rows, spread evenly, and of each up to 32 entries that are not 0, spread evenly too. `bound(s)` bounds the error of
/// an entry of row s; `tolerance` is that of [`unoccluded`], whose own bound counts as well. A pair that a blocker hides
/// wholly is 0 and needs no comparison.
///
/// # Errors
///
/// [`StoreError`] if the store cannot give a row.
///
/// # Panics
///
/// If the facets do not fit the store.
pub fn check_blocked(
    store: &dyn FormFactors,
    facets: &Facets,
    bound: &dyn Fn(usize) -> f64,
    tolerance: f64,
) -> Result<BlockedPairs, StoreError> {
    let n = store.sources();
    assert_eq!((facets.len(), facets.len()), (n, store.targets()), "check: facets of sources and targets");
    let (mut blocked, mut buf) = (BlockedPairs::default(), RowBuf::default());
    for s in spread(n, SAMPLED.0) {
        let mut entries = Vec::new();
        store.row(s, 0, &mut buf)?.entries.for_each(|t, value| {
            if value > 0.0 {
                entries.push((t, value));
            }
        });
        let sample: Vec<(usize, f64)> = spread(entries.len(), SAMPLED.1).map(|k| entries[k]).collect();
        let whole: Vec<Estimate> = sample.par_iter().map(|&(t, _)| unblocked(facets, s, t, tolerance)).collect();
        for ((t, value), whole) in sample.into_iter().zip(whole) {
            let allowed = bound(s) + whole.bound + 8.0 * f64::EPSILON * whole.value;
            let excess = (value - whole.value - allowed) / facets.area(s).min(facets.area(t));
            blocked.compared += 1;
            blocked.reduced += u64::from(value < whole.value - allowed);
            blocked.increased += u64::from(excess > 0.0);
            if blocked.largest_excess.is_none_or(|(.., largest)| excess > largest) {
                blocked.largest_excess = Some((s, t, excess));
            }
        }
    }
    Ok(blocked)
}

/// `most` of `0..n` (all if there are no more), the same distance from each other.
fn spread(n: usize, most: usize) -> impl Iterator<Item = usize> {
    let count = n.min(most);
    (0..count).map(move |k| (2 * k + 1) * n / (2 * count))
}

/// Unblocked exchange area of two facets.
fn unblocked(facets: &Facets, s: usize, t: usize, tolerance: f64) -> Estimate {
    let mut total = Estimate::default();
    for (k, i) in facets.polygons(s).iter().enumerate() {
        for (l, j) in facets.polygons(t).iter().enumerate() {
            if (s, k) != (t, l) {
                let pair = unoccluded(i, j, tolerance);
                total.value += pair.value;
                total.bound += pair.bound;
            }
        }
    }
    total
}

/// Σ_t A_s F_st of every source (band 0): divided by A_s, 1 in a closed scene.
///
/// # Errors
///
/// [`StoreError`] if the store cannot give a row.
pub fn row_sums(store: &dyn FormFactors) -> Result<Vec<f64>, StoreError> {
    let mut buf = RowBuf::default();
    (0..store.sources()).map(|s| Ok(store.row(s, 0, &mut buf)?.entries.sum())).collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use radiosity_core::{Properties, Row};
    use radiosity_geometry::Polygon;

    use super::*;

    struct Table(Vec<Vec<f64>>);

    impl FormFactors for Table {
        fn name(&self) -> &'static str {
            "table"
        }

        fn sources(&self) -> usize {
            self.0.len()
        }

        fn targets(&self) -> usize {
            self.0[0].len()
        }

        fn properties(&self) -> Properties {
            Properties { symmetric: false, per_band: false, stored_bytes: 0, rounding: 0.0 }
        }

        fn row<'a>(&'a self, s: usize, _: usize, buf: &'a mut RowBuf) -> Result<Row<'a>, StoreError> {
            // Sparse, so that missing partners are met too.
            (buf.targets, buf.values) =
                self.0[s].iter().enumerate().filter(|(_, v)| **v != 0.0).map(|(t, v)| (t as u32, *v)).unzip();
            let entries = Entries::Sparse { targets: &buf.targets, values: &buf.values };
            Ok(Row { entries, cost: Default::default() })
        }
    }

    /// The same with full rows.
    struct Full(Table);

    impl FormFactors for Full {
        fn name(&self) -> &'static str {
            self.0.name()
        }

        fn sources(&self) -> usize {
            self.0.sources()
        }

        fn targets(&self) -> usize {
            self.0.targets()
        }

        fn properties(&self) -> Properties {
            self.0.properties()
        }

        fn row<'a>(&'a self, s: usize, _: usize, _: &'a mut RowBuf) -> Result<Row<'a>, StoreError> {
            Ok(Row { entries: Entries::Dense(&self.0.0[s]), cost: Default::default() })
        }
    }

    #[test]
    fn each_violation_is_found_where_it_is() {
        let table = Table(vec![vec![0.0, 1.0, 0.25], vec![1.5, 0.0, 0.0], vec![0.0, -0.5, 2.5]]);
        let areas = [1.0, 2.0, 4.0];
        let checks = check(&table, &areas, &areas, true).unwrap();
        assert_eq!(checks.largest_row_sum, Some((0, 1.25)));
        assert_eq!(checks.closure, Some((2, -0.5)));
        // 1.0 against 1.5, per area 1, is worse than 0.25 against nothing and −0.5 against nothing per area 2.
        assert_eq!(checks.reciprocity, Some((0, 1, 0.5)));
        assert_eq!((checks.above_area, checks.negative), (1, 1));
        assert_eq!(row_sums(&table).unwrap(), [1.25, 1.5, 2.0]);
        // 2.5 of the diagonal per area 4 is less than 1.5 per area 1.
        assert_eq!((checks.largest_share, checks.above_one), (Some((1, 0, 1.5)), 0));
    }

    /// Sums 1.25, 0.75 and 0.5, of which only the first is too much.
    #[test]
    fn worst_rows_are_those_farthest_from_1_or_the_largest() {
        let table = Table(vec![vec![0.0, 1.0, 0.25], vec![1.5, 0.0, 0.0], vec![0.0, -0.5, 2.5]]);
        let areas = [1.0, 2.0, 4.0];
        let closed = check(&table, &areas, &areas, true).unwrap();
        assert_eq!(closed.worst_rows, [(2, 0.5), (0, 1.25), (1, 0.75)]);
        let open = check(&table, &areas, &areas, false).unwrap();
        assert_eq!(open.worst_rows, [(0, 1.25), (1, 0.75), (2, 0.5)]);
        assert_eq!((open.rows_above_one, open.row_sums.map(|r| r.smallest)), (1, Some(0.5)));
        assert_eq!(open.row_sums.map(|r| r.mean), Some(4.75 / 7.0));
    }

    /// 600 rows: two blocks of sparse ones, ten of full ones, the last ones short. Two thirds of the pairs differ by less.
    #[test]
    fn the_worst_pair_is_found_wherever_its_block_lies() {
        let n = 600;
        for (s, t) in [(0, 599), (63, 64), (70, 100), (511, 512), (598, 599)] {
            let entry = |a: usize, b: usize| match (a + 2 * b) % 3 {
                _ if (a, b) == (s, t) => 4.0,
                0 => 0.0,
                k => k as f64,
            };
            let table = Table((0..n).map(|a| (0..n).map(|b| entry(a, b)).collect()).collect());
            let areas = vec![2.0; n];
            let expected = Some((s, t, (4.0 - entry(t, s)) / 2.0));
            assert_eq!(check(&table, &areas, &areas, false).unwrap().reciprocity, expected);
            assert_eq!(check(&Full(table), &areas, &areas, false).unwrap().reciprocity, expected);
        }
    }

    #[test]
    fn of_pairs_that_differ_alike_the_first_is_named() {
        let n = 600;
        let entry = |a: usize, b: usize| f64::from(u8::from((a + 7 * b).is_multiple_of(11)));
        let table = Table((0..n).map(|a| (0..n).map(|b| entry(a, b)).collect()).collect());
        let areas = vec![1.0; n];
        let differ = |(a, b): &(usize, usize)| entry(*a, *b) != entry(*b, *a);
        let first = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b))).find(differ).unwrap();
        let expected = Some((first.0, first.1, 1.0));
        assert_eq!(check(&table, &areas, &areas, false).unwrap().reciprocity, expected);
        assert_eq!(check(&Full(table), &areas, &areas, false).unwrap().reciprocity, expected);
    }

    fn square(z: f64, up: bool) -> Polygon {
        let mut corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, z));
        if !up {
            corners.reverse();
        }
        Polygon::new(&corners).unwrap()
    }

    /// Opposed unit squares: F = 0.19982…; what is less is blocked, what is more is wrong.
    #[test]
    fn a_pair_above_its_unblocked_value_is_found() {
        let mut facets = Facets::new();
        facets.push(vec![square(0.0, true)], false);
        facets.push(vec![square(1.0, false)], false);
        let against = |value: f64| {
            let table = Table(vec![vec![0.0, value], vec![value, 0.0]]);
            check_blocked(&table, &facets, &|_| 1e-9, 1e-9).unwrap()
        };
        let (less, equal, more) = (against(0.1), against(0.199_824_895_7), against(0.2));
        assert_eq!((less.compared, less.reduced, less.increased), (2, 2, 0));
        assert_eq!((equal.reduced, equal.increased), (0, 0));
        assert_eq!((more.reduced, more.increased), (0, 2));
        assert!((more.largest_excess.unwrap().2 - 1.751_043e-4).abs() < 1e-8);
        assert!(less.largest_excess.unwrap().2 < -0.09);
    }

    #[test]
    fn a_missing_partner_counts_as_zero() {
        let table = Table(vec![vec![0.0, 0.0, 0.75], vec![0.0, 0.0, 0.0], vec![0.0, 0.0, 0.0]]);
        let checks = check(&table, &[1.0; 3], &[1.0; 3], false).unwrap();
        assert_eq!((checks.reciprocity, checks.closure), (Some((0, 2, 0.75)), None));
    }

    #[test]
    fn a_row_without_an_area_is_no_violation() {
        let table = Table(vec![vec![0.0; 3], vec![0.0, 0.0, 0.5], vec![0.0, 0.5, 0.0]]);
        let checks = check(&table, &[0.0, 1.0, 2.0], &[0.0, 1.0, 2.0], true).unwrap();
        assert_eq!((checks.reciprocity, checks.largest_row_sum), (Some((1, 2, 0.0)), Some((1, 0.5))));
        assert_eq!(checks.closure, Some((2, -0.75)));
    }

    #[test]
    fn a_store_that_is_not_square_has_no_reciprocity() {
        let table = Table(vec![vec![0.5, 0.25, 0.25], vec![1.0, 0.5, 0.5]]);
        let checks = check(&table, &[1.0, 2.0], &[1.0, 0.5, 0.5], true).unwrap();
        assert_eq!((checks.reciprocity, checks.closure), (None, Some((0, 0.0))));
    }
}
