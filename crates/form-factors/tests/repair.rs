//! Symmetric scaling closes the rows of a closed scene, keeps what it must keep, and cuts errors at high reflectance.

use faer::Mat;
use faer::prelude::Solve;
use radiosity_core::{Cost, RowBuf, StoreError};
use radiosity_form_factors::Rows;
use radiosity_form_factors::checks::{check, row_sums};
use radiosity_form_factors::repair::{RepairError, Scaling, repair};
use radiosity_form_factors::stores::{DenseFormFactors, Held, PackedFormFactors, SparseFormFactors};
use radiosity_gallery::RandomEnclosure;

const N: usize = 150;

/// The next of a sequence of numbers in [−1, 1) (Steele, Lea and Flood's SplitMix, 2014).
fn noise(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// An enclosure, every seventh pair hidden so that zeros are met, and its exact row sums.
fn exact() -> (Vec<f64>, Vec<f64>) {
    let RandomEnclosure { mut exchange, .. } = RandomEnclosure::new(N, 3);
    for s in 0..N {
        for t in 0..s {
            if (s * t + s + t) % 7 == 0 {
                (exchange[s * N + t], exchange[t * N + s]) = (0.0, 0.0);
            }
        }
    }
    let areas = exchange.chunks_exact(N).map(|row| row.iter().sum()).collect();
    (exchange, areas)
}

/// The exchange areas with every pair off by up to `share` of itself.
fn disturbed(exchange: &[f64], share: f64) -> Vec<f64> {
    let (mut noisy, mut state) = (exchange.to_vec(), 11);
    for s in 0..N {
        for t in 0..s {
            let factor = 1.0 + share * noise(&mut state);
            noisy[s * N + t] *= factor;
            noisy[t * N + s] = noisy[s * N + t];
        }
    }
    noisy
}

fn dense(exchange: &[f64]) -> DenseFormFactors {
    DenseFormFactors::from_rows(exchange, N, N, true).unwrap()
}

/// B of (I − ρF) B = E by elimination.
fn radiosity(store: &DenseFormFactors, areas: &[f64], rho: f64, emission: impl Fn(usize) -> f64) -> Vec<f64> {
    let matrix = Mat::from_fn(N, N, |s, t| f64::from(u8::from(s == t)) - rho * store.entry(s, t) / areas[s]);
    let b = matrix.partial_piv_lu().solve(Mat::from_fn(N, 1, |s, _| emission(s)));
    (0..N).map(|s| b[(s, 0)]).collect()
}

fn scaled(store: &DenseFormFactors, scaling: &Scaling) -> DenseFormFactors {
    let mut store = store.clone();
    scaling.apply(&mut store);
    store
}

fn largest_relative_error(b: &[f64], exact: &[f64]) -> f64 {
    b.iter().zip(exact).map(|(b, exact)| (b / exact - 1.0).abs()).fold(0.0, f64::max)
}

#[test]
fn rows_close_to_1e_13_and_symmetry_and_zeros_stay() {
    let (exchange, areas) = exact();
    let store = dense(&disturbed(&exchange, 0.3));
    let scaling = repair(&store, &areas, true).unwrap();
    let repaired = scaled(&store, &scaling);
    for (sum, area) in row_sums(&repaired).unwrap().iter().zip(&areas) {
        assert!((sum / area - 1.0).abs() < 1e-13, "{}", sum / area - 1.0);
    }
    assert!(scaling.closure_after < 1e-13 && scaling.closure_before > 1e-3);
    for s in 0..N {
        for t in 0..N {
            assert_eq!(repaired.entry(s, t), repaired.entry(t, s));
            assert_eq!(repaired.entry(s, t) == 0.0, exchange[s * N + t] == 0.0);
            assert!(repaired.entry(s, t) >= 0.0);
        }
    }
    let checks = check(&repaired, &areas, &areas, true).unwrap();
    assert!(checks.closure.unwrap().1.abs() < 1e-13 && checks.negative == 0);
}

#[test]
fn an_exact_matrix_stays_as_it_is_to_1e_14() {
    let (exchange, areas) = exact();
    let store = dense(&exchange);
    let scaling = repair(&store, &areas, true).unwrap();
    let repaired = scaled(&store, &scaling);
    assert!((0..N).all(|s| {
        (0..N).all(|t| (repaired.entry(s, t) / store.entry(s, t) - 1.0).abs() < 1e-14 || store.entry(s, t) == 0.0)
    }));
    assert!(scaling.largest_relative_change < 1e-14, "{}", scaling.largest_relative_change);
}

/// Row sums off by δ give errors of δ/(1 − ρ): at ρ = 0.999 noise of 10 % an entry, about 0.1/√(3·150) = 0.5 % a row, ruins the answer.
#[test]
fn the_error_of_a_furnace_goes_away_and_that_of_one_lamp_falls_tenfold() {
    let (exchange, areas) = exact();
    let truth = dense(&exchange);
    let store = dense(&disturbed(&exchange, 0.1));
    let scaling = repair(&store, &areas, true).unwrap();
    let repaired = scaled(&store, &scaling);
    // E = 1 everywhere: B = 1/(1 − ρ) = 1000; rounding of 1e-13 in the sums times 1000 is far below 1e-9.
    let furnace = [1000.0; N];
    let before = largest_relative_error(&radiosity(&store, &areas, 0.999, |_| 1.0), &furnace);
    let after = largest_relative_error(&radiosity(&repaired, &areas, 0.999, |_| 1.0), &furnace);
    assert!(before > 0.05 && after < 1e-9, "{before} {after}");
    // One lamp: what is left is the error of single entries.
    let lamp = |s: usize| f64::from(u8::from(s == 4));
    let wanted = radiosity(&truth, &areas, 0.999, lamp);
    let before = largest_relative_error(&radiosity(&store, &areas, 0.999, lamp), &wanted);
    let after = largest_relative_error(&radiosity(&repaired, &areas, 0.999, lamp), &wanted);
    assert!(after < 0.1 * before, "{before} {after}");
}

#[test]
fn the_reported_change_is_the_largest_of_all_entries() {
    let (exchange, areas) = exact();
    let store = dense(&disturbed(&exchange, 0.2));
    let scaling = repair(&store, &areas, true).unwrap();
    let repaired = scaled(&store, &scaling);
    let pairs = || (0..N).flat_map(|s| (0..N).map(move |t| (s, t))).filter(|&(s, t)| store.entry(s, t) > 0.0);
    let relative = pairs().map(|(s, t)| (repaired.entry(s, t) / store.entry(s, t) - 1.0).abs()).fold(0.0, f64::max);
    let absolute = |(s, t): (usize, usize)| (repaired.entry(s, t) - store.entry(s, t)).abs() / areas[s].min(areas[t]);
    assert!((scaling.largest_relative_change - relative).abs() < 1e-14);
    assert!((scaling.largest_change - pairs().map(absolute).fold(0.0, f64::max)).abs() < 1e-14);
    let square = |(s, t): (usize, usize)| store.entry(s, t) * (repaired.entry(s, t) / store.entry(s, t) - 1.0).powi(2);
    let total: f64 = pairs().map(|(s, t)| store.entry(s, t)).sum();
    let rms = (pairs().map(square).sum::<f64>() / total).sqrt();
    assert!((scaling.rms_relative_change - rms).abs() < 1e-14 && rms < relative);
}

/// As a store's rows, with an error of 0.
struct Given<'a>(&'a DenseFormFactors);

impl Rows for Given<'_> {
    fn name(&self) -> &'static str {
        "given"
    }
    fn sources(&self) -> usize {
        N
    }
    fn targets(&self) -> usize {
        N
    }
    fn symmetric(&self) -> bool {
        true
    }
    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        values.iter_mut().enumerate().for_each(|(t, v)| *v = self.0.entry(s, t));
        Ok((Cost::default(), 0.0))
    }
}

/// Scaled in place every store holds the same numbers, and its bounds cover what changed; single precision to its rounding.
#[test]
fn every_symmetric_store_can_be_repaired() {
    let (exchange, areas) = exact();
    let store = dense(&disturbed(&exchange, 0.1));
    let scaling = repair(&store, &areas, true).unwrap();
    let wanted = scaled(&store, &scaling);
    assert!(scaling.factors.iter().any(|d| (d - 1.0).abs() > 1e-3));
    let rows = Given(&store);
    let stores: [(Box<dyn Held>, f64); 4] = [
        (Box::new(DenseFormFactors::assemble(&rows).unwrap().0), 0.0),
        (Box::new(SparseFormFactors::assemble(&rows).unwrap().0), 0.0),
        (Box::new(PackedFormFactors::<f64>::assemble(&rows).unwrap().0), 0.0),
        // Rounded when kept and when scaled, by 2⁻²⁴ each.
        (Box::new(PackedFormFactors::<f32>::assemble(&rows).unwrap().0), 1.2e-7),
    ];
    for (mut held, rounding) in stores {
        scaling.apply(&mut *held);
        let mut buf = RowBuf::default();
        for s in 0..N {
            let row = held.row(s, 0, &mut buf).unwrap().entries;
            let mut largest = 0.0_f64;
            for t in 0..N {
                assert!(
                    (row.get(t) - wanted.entry(s, t)).abs() <= rounding * wanted.entry(s, t),
                    "{} {s} {t}",
                    held.name()
                );
                largest = largest.max((row.get(t) - store.entry(s, t)).abs());
            }
            assert!(held.bound(s).unwrap() >= largest, "{} {s}", held.name());
        }
        let (again, left) = (repair(&*held, &areas, true).unwrap(), 1e-13 + rounding);
        assert!(again.factors.iter().all(|d| (d - 1.0).abs() < left), "{}: nothing is left to do", held.name());
    }
}

/// Plates that see almost only each other: plain alternating scaling contracts by 1 − 10⁻⁶ a step there.
#[test]
fn two_groups_that_hardly_see_themselves_are_closed_too() {
    let leak = 1e-6;
    let s = [leak, 1.1, 0.0, 0.0, 1.1, 0.0, leak, 0.0, 0.0, leak, 0.0, 0.9, 0.0, 0.0, 0.9, leak];
    let areas = [1.0; 4];
    let store = DenseFormFactors::from_rows(&s, 4, 4, true).unwrap();
    let scaling = repair(&store, &areas, true).unwrap();
    assert!(scaling.closure_after < 1e-13 && scaling.steps < 60, "{scaling:?}");
}

#[test]
fn what_cannot_be_repaired_is_refused() {
    let (exchange, areas) = exact();
    let store = dense(&exchange);
    assert_eq!(repair(&store, &areas, false), Err(RepairError::Open));
    let rows = DenseFormFactors::from_rows(&exchange, N, N, false).unwrap();
    assert_eq!(repair(&rows, &areas, true), Err(RepairError::NeedsSymmetric { store: "dense" }));
    let alone = DenseFormFactors::from_rows(&[0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0], 3, 3, true).unwrap();
    assert_eq!(repair(&alone, &[1.0; 3], true), Err(RepairError::Isolated { row: 2, sum: 0.0, area: 1.0 }));
    assert_eq!(repair(&alone, &[1.0, 1.0, 0.0], true).unwrap().factors, [1.0; 3]);
    let error = repair(&alone, &[1.0, f64::NAN, 1.0], true);
    assert!(matches!(error, Err(RepairError::Area { element: 1, .. })), "{error:?}");
    // Two elements that see only a third, which is too small for both.
    let star = DenseFormFactors::from_rows(&[0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0], 3, 3, true).unwrap();
    let error = repair(&star, &[1.0; 3], true);
    assert!(matches!(error, Err(RepairError::NotConverged { .. })), "{error:?}");
}
