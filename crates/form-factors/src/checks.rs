//! Checks of form factors: closure, reciprocity, sign and size.
//!
//! Nothing is changed here ([`crate::repair`] does, on closed scenes). Row sums of a closed scene are 1; those of an open
//! one are smaller, what is missing goes to the surroundings, and an open scene is never normalised.

use radiosity_core::{FormFactors, RowBuf, StoreError};

/// What a store of form factors violates, and where.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Checks {
    /// Closure: the row with the largest |Σ_t F_st − 1|, and that difference with its sign. `None` for an open scene,
    /// whose rows need not sum to 1.
    pub closure: Option<(usize, f64)>,
    /// The row with the largest Σ_t F_st, and that sum: at most 1 in any scene. `None` if there is no row.
    pub largest_row_sum: Option<(usize, f64)>,
    /// Reciprocity: the pair s < t with the largest |A_s F_st − A_t F_ts| / min(A_s, A_t), and that number. `None` if the store is
    /// not square or has a single row.
    pub reciprocity: Option<(usize, usize, f64)>,
    /// Entries A_s F_st above min(A_s, A_t) by more than rounding.
    pub above_area: u64,
    /// Entries below 0.
    pub negative: u64,
}

/// Reads all rows once (band 0) and reports what they violate.
///
/// `closed` says that every ray from a front side meets a front side again. Of square stores the entries right of the
/// diagonal are kept until their partners come, 16 bytes each; of those that are symmetric, to the last bit as they must be,
/// none is.
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
    let (sources, targets) = (store.sources(), store.targets());
    assert_eq!((source_areas.len(), target_areas.len()), (sources, targets), "check: areas of sources and targets");
    let mut checks = Checks::default();
    // Column by column what rows above have said: partners of the entries left of the diagonal.
    let symmetric = store.properties().symmetric;
    let compared = sources == targets && !symmetric;
    let mut above: Vec<Vec<(u32, f64)>> = vec![Vec::new(); if compared { targets } else { 0 }];
    let mut buf = RowBuf::default();
    for (s, &area) in source_areas.iter().enumerate() {
        // A face without an area sends and receives nothing.
        if area == 0.0 {
            continue;
        }
        let row = store.row(s, 0, &mut buf)?.entries;
        let sum = row.sum() / area;
        if checks.largest_row_sum.is_none_or(|(_, largest)| sum > largest) {
            checks.largest_row_sum = Some((s, sum));
        }
        if closed && checks.closure.is_none_or(|(_, worst)| (sum - 1.0).abs() > worst.abs()) {
            checks.closure = Some((s, sum - 1.0));
        }
        row.for_each(|t, value| {
            checks.negative += u64::from(value < 0.0);
            let limit = area.min(target_areas[t]);
            checks.above_area += u64::from(value > limit * (1.0 + 8.0 * f64::EPSILON));
        });
        if compared {
            let mut worse = |t: usize, difference: f64| {
                let relative = difference.abs() / area.min(target_areas[t]);
                if target_areas[t] > 0.0 && checks.reciprocity.is_none_or(|(.., worst)| relative > worst) {
                    checks.reciprocity = Some((t, s, relative));
                }
            };
            let mut partners = std::mem::take(&mut above[s]).into_iter().peekable();
            row.for_each(|t, value| {
                if t > s && value != 0.0 {
                    above[t].push((s as u32, value));
                } else if t < s {
                    // Partners of entries that this row does not hold count as against 0.
                    while let Some((u, partner)) = partners.next_if(|(u, _)| (*u as usize) < t) {
                        worse(u as usize, partner);
                    }
                    let partner = partners.next_if(|(u, _)| *u as usize == t).map_or(0.0, |(_, partner)| partner);
                    worse(t, value - partner);
                }
            });
            for (u, partner) in partners {
                worse(u as usize, partner);
            }
        }
    }
    if symmetric {
        let mut pair = (0..sources).filter(|&s| source_areas[s] > 0.0);
        checks.reciprocity = pair.next().zip(pair.next()).map(|(s, t)| (s, t, 0.0));
    }
    Ok(checks)
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
    use radiosity_core::{Entries, Properties, Row};

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
