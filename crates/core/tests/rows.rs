//! Rows in every layout, and the products that the trait's own bodies make of them.

use radiosity_core::{
    BandValues, Block, Cost, DrawBuf, Draws, Entries, FormFactors, LOST, Properties, Row, RowBuf, StoreError,
    gather_by_rows, scatter_by_rows, sweep_by_rows,
};

/// Entry (s, t) of band b is (b + 1) / (1 + s + 2t), or 0 where s + t is a multiple of 4.
struct Formula {
    sources: usize,
    targets: usize,
    per_band: bool,
}

impl Formula {
    fn value(&self, s: usize, t: usize, b: usize) -> f64 {
        let scale = if self.per_band { b + 1 } else { 1 } as f64;
        if (s + t).is_multiple_of(4) { 0.0 } else { scale / (1 + s + 2 * t) as f64 }
    }
}

impl FormFactors for Formula {
    fn name(&self) -> &'static str {
        "formula"
    }
    fn sources(&self) -> usize {
        self.sources
    }
    fn targets(&self) -> usize {
        self.targets
    }
    fn properties(&self) -> Properties {
        Properties { symmetric: false, per_band: self.per_band, stored_bytes: 0, rounding: 0.0 }
    }
    fn row<'a>(&'a self, s: usize, band: usize, buf: &'a mut RowBuf) -> Result<Row<'a>, StoreError> {
        buf.values.clear();
        buf.targets.clear();
        for t in (0..self.targets).filter(|t| !(s + t).is_multiple_of(4)) {
            buf.targets.push(t as u32);
            buf.values.push(self.value(s, t, band));
        }
        let cost = Cost { source_evaluations: 1, ..Cost::default() };
        Ok(Row { entries: Entries::Sparse { targets: &buf.targets, values: &buf.values }, cost })
    }
}

fn values(bands: usize, len: usize) -> BandValues {
    BandValues::new((0..bands * len).map(|k| ((k * 5 + 2) % 9) as f64 - 3.0).collect(), len)
}

#[test]
fn one_row_in_three_layouts_tells_the_same() {
    let dense = [0.0, 0.0, 2.0, 2.0, 2.0, 0.0, 5.0, 0.0, 0.0, 1.0];
    let x = [3.0, 1.0, 4.0, 1.0, 5.0, 9.0, 2.0, 6.0, 5.0, 3.0];
    let layouts = [
        Entries::Dense(&dense),
        Entries::Sparse { targets: &[2, 3, 4, 6, 9], values: &[2.0, 2.0, 2.0, 5.0, 1.0] },
        Entries::Runs { ends: &[2, 5, 6, 7, 9, 10], values: &[0.0, 2.0, 0.0, 5.0, 0.0, 1.0] },
    ];
    for entries in layouts {
        // Small whole numbers: sums are exact.
        assert_eq!((entries.sum(), entries.dot(&x)), (12.0, 33.0), "{entries:?}");
        assert!((0..10).all(|t| entries.get(t) == dense[t]), "{entries:?}");
        let mut seen = [0.0; 10];
        entries.for_each(|t, v| seen[t] = v);
        assert_eq!(seen, dense, "{entries:?}");
    }
    assert_eq!(layouts.map(|entries| entries.stored()), [10, 5, 6]);
}

/// Sums of up to 150 terms below 12: 1e-12 is 30 roundings of the largest.
#[test]
fn products_are_sums_over_rows_for_every_band() {
    for (sources, targets) in [(1, 1), (70, 70), (150, 9), (9, 150)] {
        for per_band in [false, true] {
            let store = Formula { sources, targets, per_band };
            let (x, z) = (values(3, targets), values(3, sources));
            let (mut y, mut w) = (BandValues::zeros(3, sources), BandValues::zeros(3, targets));
            let gathered = gather_by_rows(&store, x.view(), y.view_mut()).unwrap();
            let scattered = scatter_by_rows(&store, z.view(), w.view_mut()).unwrap();
            for b in 0..3 {
                for s in 0..sources {
                    let sum: f64 = (0..targets).map(|t| store.value(s, t, b) * x.band(b)[t]).sum();
                    assert!((sum - y.band(b)[s]).abs() < 1e-12);
                }
                for t in 0..targets {
                    let sum: f64 = (0..sources).map(|s| store.value(s, t, b) * z.band(b)[s]).sum();
                    assert!((sum - w.band(b)[t]).abs() < 1e-12);
                }
            }
            let tables = if per_band { 3 } else { 1 };
            assert_eq!(gathered.source_evaluations, (tables * sources) as u64);
            assert!(scattered.source_evaluations <= gathered.source_evaluations);
        }
    }
}

#[test]
fn dark_rows_are_not_asked_for() {
    let store = Formula { sources: 40, targets: 5, per_band: false };
    let mut x = BandValues::zeros(2, 40);
    x.band_mut(0)[3] = 1.0;
    x.band_mut(1)[3] = 2.0;
    x.band_mut(1)[17] = 1.0;
    let cost = scatter_by_rows(&store, x.view(), BandValues::zeros(2, 5).view_mut()).unwrap();
    assert_eq!(cost.source_evaluations, 2);
}

/// Each block sees what earlier blocks have written; inside and outside make up the whole row.
#[test]
fn a_sweep_visits_blocks_in_order_with_the_newest_values() {
    for (sources, targets, per_band) in [(150, 150, false), (150, 150, true), (150, 20, false)] {
        let store = Formula { sources, targets, per_band };
        let mut x = values(2, targets);
        let mut newest = x.clone();
        let mut visited = 0;
        sweep_by_rows(&store, x.view_mut(), &mut |block: &Block<'_>, mut x| {
            assert_eq!((block.range.start, x.view().values()), (visited, newest.values()));
            visited = block.range.end;
            let len = block.range.len();
            for b in 0..2 {
                for (k, s) in block.range.clone().enumerate() {
                    let mut sum = block.outside.band(b)[k];
                    for (l, t) in block.range.clone().enumerate().filter(|_| !block.inside.is_empty()) {
                        let table = if per_band { b } else { 0 };
                        sum += block.inside[(table * len + k) * len + l] * newest.band(b)[t];
                    }
                    let wanted: f64 = (0..targets).map(|t| store.value(s, t, b) * newest.band(b)[t]).sum();
                    assert!((sum - wanted).abs() < 1e-12, "source {s}, band {b}");
                }
                let at = visited.min(targets) - 1;
                newest.band_mut(b)[at] += 7.0;
                x.band(b)[at] += 7.0;
            }
        })
        .unwrap();
        assert_eq!(visited, sources);
    }
}

#[test]
fn costs_add_up_field_by_field() {
    let one = Cost::applied(10, 8, 3) + Cost { rays: 5, form_factors: 2, ..Cost::default() };
    let sum: Cost = [one, one].into_iter().sum();
    assert_eq!(sum, Cost { entries: 20, flops: 120, bytes: 160, rays: 10, form_factors: 4, ..Cost::default() });
}

/// Targets of n draws from row 1 of a formula, whose entries are 1/(2 + 2t) but for t = 3, 7, …
fn drawn(n: usize, area: f64, seed: u64) -> (Vec<u32>, f64) {
    let store = Formula { sources: 3, targets: 9, per_band: false };
    let mut targets = vec![0; n];
    let draws = &mut [Draws { seed, targets: &mut targets }];
    let found = store.sample(1, 0, area, draws, &mut DrawBuf::default()).unwrap();
    assert_eq!((found.cost.source_evaluations, found.cost.entries), (1, 7));
    (targets, found.exchange)
}

#[test]
fn draws_give_every_target_its_share_rounded_and_the_rest_is_lost() {
    let store = Formula { sources: 3, targets: 9, per_band: false };
    let sum: f64 = (0..9).map(|t| store.value(1, t, 0)).sum();
    // An open row, and one that sums to more than the area.
    for (area, total) in [(2.0 * sum, 2.0 * sum), (0.5 * sum, sum)] {
        for (n, seed) in [(1, 1), (7, 2), (1000, 3)] {
            let (targets, exchange) = drawn(n, area, seed);
            assert!((exchange - total).abs() <= 1e-15 * total, "{exchange} for {total}");
            for t in 0..9 {
                let hits = targets.iter().filter(|&&found| found == t as u32).count() as f64;
                let share = n as f64 * store.value(1, t, 0) / total;
                assert!((hits - share).abs() < 1.0, "target {t} of {n}: {hits} for {share}");
            }
            let lost = targets.iter().filter(|&&found| found == LOST).count() as f64;
            assert!((lost - n as f64 * (1.0 - sum / total)).abs() < 1.0 + 1e-9, "{lost}");
        }
    }
}

/// Means of 4,000 seeds: the standard error of a share is below 0.5/√4000 = 0.8 %, of which four are allowed.
#[test]
fn single_draws_have_the_probabilities_of_the_row() {
    let store = Formula { sources: 3, targets: 9, per_band: false };
    let seeds = 4_000;
    let mut hits = [0.0; 9];
    for seed in 0..seeds {
        if let Some(hits) = hits.get_mut(drawn(1, 3.0, seed).0[0] as usize) {
            *hits += 1.0 / seeds as f64;
        }
    }
    for (t, share) in hits.iter().enumerate() {
        assert!((share - store.value(1, t, 0) / 3.0).abs() < 0.03, "target {t}: {share}");
    }
}
