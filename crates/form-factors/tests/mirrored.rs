//! Stores copy rows that are mirror images of others: every entry is the one that would have been computed.

use std::sync::atomic::{AtomicU64, Ordering};

use radiosity_core::{Cost, FormFactors, StoreError};
use radiosity_form_factors::stores::{DenseFormFactors, Held, Keep, OnDemand, PackedFormFactors, SparseFormFactors};
use radiosity_form_factors::{MirroredRows, Mirrors, Rows};

/// Exchange areas on a ring of `n` places, which depend on the way from one to the other and, for every second, on which it is.
struct Ring {
    n: usize,
    symmetric: bool,
    /// Entries asked for.
    asked: AtomicU64,
}

impl Ring {
    fn new(n: usize, symmetric: bool) -> Self {
        Self { n, symmetric, asked: AtomicU64::new(0) }
    }

    fn value(&self, s: usize, t: usize) -> f64 {
        let way = (t + self.n - s) % self.n;
        let way = if self.symmetric { way.min(self.n - way) } else { way };
        1.0 / (3 + 5 * way + (s % 2) + (t % 2)) as f64
    }

    /// Turns by two places, and so two orbits.
    fn mirrors(&self) -> Mirrors {
        let turned = |by: usize| (0..self.n).map(|t| ((t + self.n - by) % self.n) as u32).collect();
        let maps = (0..self.n / 2).map(|k| turned(2 * k)).collect();
        Mirrors::new((0..self.n as u32).map(|s| (s % 2, s / 2)).collect(), maps)
    }
}

impl Rows for Ring {
    fn name(&self) -> &'static str {
        "ring"
    }
    fn sources(&self) -> usize {
        self.n
    }
    fn targets(&self) -> usize {
        self.n
    }
    fn symmetric(&self) -> bool {
        self.symmetric
    }
    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        values.iter_mut().enumerate().for_each(|(t, value)| *value = self.value(s, t));
        self.asked.fetch_add(self.n as u64, Ordering::Relaxed);
        Ok((Cost { source_evaluations: 1, ..Cost::default() }, 1e-3 * s as f64))
    }
    fn row_of(&self, s: usize, first: usize, wanted: &[bool], values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        for (t, value) in values.iter_mut().enumerate() {
            let asked = t >= first && wanted[t];
            *value = if asked { self.value(s, t) } else { 0.0 };
            self.asked.fetch_add(u64::from(asked), Ordering::Relaxed);
        }
        Ok((Cost { source_evaluations: 1, ..Cost::default() }, 1e-3 * s as f64))
    }
}

fn entries(store: &dyn FormFactors) -> Vec<f64> {
    let mut buf = radiosity_core::RowBuf::default();
    let row = |s: usize| {
        let mut values = vec![0.0; store.targets()];
        store.row(s, 0, &mut buf).unwrap().entries.for_each(|t, value| values[t] = value);
        values
    };
    (0..store.sources()).flat_map(row).collect()
}

/// Of 600 rows in tiles of 256, and of 8 in one, two are computed, and of the pairs of both orbits one row of the first.
#[test]
fn entries_of_copies_are_those_that_would_be_computed() {
    for n in [8, 600] {
        let table = Ring::new(n, true);
        let expected: Vec<f64> = (0..n * n).map(|k| table.value(k / n, k % n)).collect();
        let rows = || MirroredRows::new(Box::new(Ring::new(n, true)), table.mirrors());
        let (dense, cost) = DenseFormFactors::assemble(&rows()).unwrap();
        assert_eq!(cost.source_evaluations, 2);
        assert_eq!(entries(&dense), expected);
        let (packed, cost) = PackedFormFactors::<f64>::assemble(&rows()).unwrap();
        assert_eq!(cost.source_evaluations, 2);
        assert_eq!(entries(&packed), expected);
        let single: Vec<f64> = expected.iter().map(|value| f64::from(*value as f32)).collect();
        assert_eq!(entries(&PackedFormFactors::<f32>::assemble(&rows()).unwrap().0), single);
        // Rows 0 and 1 have bounds of their own, and later entries may come from both.
        assert_eq!([0, 1, n - 1].map(|s| dense.bound(s)), [Some(0.0), Some(1e-3), Some(1e-3)]);
        assert_eq!([0, 1, n - 1].map(|s| packed.bound(s)), [Some(0.0), Some(1e-3), Some(1e-3)]);
    }
}

/// The first row whole, and of the second what belongs to its own orbit: n + n/2 entries of n (n + 1)/2.
#[test]
fn pairs_of_two_orbits_are_computed_once() {
    let ring = Ring::new(40, true);
    let rows = MirroredRows::new(Box::new(&ring), ring.mirrors());
    DenseFormFactors::assemble(&rows).unwrap();
    assert_eq!(ring.asked.load(Ordering::Relaxed), 40 + 20);
}

#[test]
fn rows_without_symmetry_of_their_own_are_copied_whole() {
    let table = Ring::new(50, false);
    let rows = MirroredRows::new(Box::new(Ring::new(50, false)), table.mirrors());
    let (store, cost) = DenseFormFactors::assemble(&rows).unwrap();
    assert_eq!(cost.source_evaluations, 2);
    assert_eq!(entries(&store), (0..2500).map(|k| table.value(k / 50, k % 50)).collect::<Vec<_>>());
    assert_eq!([0, 1, 2, 49].map(|s| store.row_bound(s)), [0.0, 1e-3, 0.0, 1e-3].map(Some));
}

#[test]
fn stores_of_lists_and_of_nothing_compute_all_rows() {
    let table = Ring::new(12, true);
    let expected: Vec<f64> = (0..144).map(|k| table.value(k / 12, k % 12)).collect();
    let rows = || Box::new(MirroredRows::new(Box::new(Ring::new(12, true)), table.mirrors()));
    let (sparse, cost) = SparseFormFactors::assemble(&*rows()).unwrap();
    assert_eq!((entries(&sparse), cost.source_evaluations), (expected.clone(), 12));
    assert_eq!(entries(&OnDemand::new(rows(), Keep::All)), expected);
}

/// The fault is named where it was computed.
#[test]
fn what_is_no_exchange_area_is_refused() {
    struct Broken;
    impl Rows for Broken {
        fn name(&self) -> &'static str {
            "broken"
        }
        fn sources(&self) -> usize {
            4
        }
        fn targets(&self) -> usize {
            4
        }
        fn symmetric(&self) -> bool {
            true
        }
        fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
            values.fill(1.0);
            values[3] = if s == 1 { -2.0 } else { 1.0 };
            Ok((Cost::default(), 0.0))
        }
    }
    let mirrors = Mirrors::new(vec![(0, 0), (1, 0), (0, 1), (1, 1)], vec![vec![0, 1, 2, 3], vec![2, 3, 0, 1]]);
    let rows = MirroredRows::new(Box::new(Broken), mirrors);
    let error = StoreError::Value { source_index: 1, target_index: 3, value: -2.0 };
    assert_eq!(DenseFormFactors::assemble(&rows).map(|_| ()), Err(error.clone()));
    assert_eq!(PackedFormFactors::<f64>::assemble(&rows).map(|_| ()), Err(error));
}
