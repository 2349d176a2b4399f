//! What any store must do, whatever it keeps.

use radiosity_core::{BandValues, Block, Cost, DrawBuf, Draws, FormFactors, LOST, RowBuf};

/// Checks a store against its own rows.
///
/// - A row asked for twice has the same bytes; its entries are exchange areas, and `get`, `for_each`, `dot`, `sum` and
///   `stored` tell the same of them. If symmetry is claimed, it holds to the last bit.
/// - Gather and scatter are the sums over the rows, to rounding; a band alone has the bytes it has among others; rows
///   with x = 0 in every band are not asked for by a scatter of rows that are computed.
/// - A sweep visits every source once and in order, hands over all of the row, and sees what blocks before it changed.
/// - Draws from rows give every target its share, rounded down or up, and lose what a row lacks of the area.
/// - Counts of entries and flops are those of the rows; stores known by name hold the bytes their formula says.
/// - All of this has the same bytes in pools of 1, 2 and 8 threads.
///
/// Takes a few seconds for a thousand rows; rows that are computed are asked for about ten times.
///
/// # Panics
///
/// At the first fact that does not hold, naming store and place.
pub fn conformance(store: &dyn FormFactors) {
    let bands = 3;
    let rows: Vec<Vec<f64>> = (0..bands).map(|b| table(store, b)).collect();
    check_rows(store, &rows);
    check_products(store, &rows);
    check_sweep(store, &rows);
    check_draws(store, &rows);
    check_bytes(store, &rows[0]);
    check_threads(store, bands);
}

/// Values without a pattern that a mistake could share.
fn values(bands: usize, len: usize) -> BandValues {
    let value = |k: usize| ((k * 37 + 11) % 101) as f64 / 50.0 - 0.7;
    BandValues::new((0..bands * len).map(value).collect(), len)
}

fn table(store: &dyn FormFactors, band: usize) -> Vec<f64> {
    let (targets, mut buf) = (store.targets(), RowBuf::default());
    let mut table = vec![0.0; store.sources() * targets];
    for (s, values) in table.chunks_exact_mut(targets).enumerate() {
        let row = store.row(s, band, &mut buf).expect("a row can be had");
        row.entries.for_each(|t, value| values[t] = value);
    }
    table
}

/// Rounding that a sum of `terms` products of total size `size` may show, twice over.
fn rounding(terms: usize, size: f64) -> f64 {
    (2 * terms + 8) as f64 * f64::EPSILON * size
}

fn check_rows(store: &dyn FormFactors, rows: &[Vec<f64>]) {
    let (name, sources, targets) = (store.name(), store.sources(), store.targets());
    let (x, mut buf) = (values(1, targets), RowBuf::default());
    for (b, table) in rows.iter().enumerate() {
        for (s, wanted) in table.chunks_exact(targets).enumerate() {
            let place = format!("{name}, row {s}, band {b}");
            let entries = store.row(s, b, &mut buf).expect("a row can be had").entries;
            let mut visited = Vec::new();
            entries.for_each(|t, value| visited.push((t, value)));
            assert!(visited.windows(2).all(|pair| pair[0].0 < pair[1].0), "{place}: order of targets");
            assert!(visited.iter().all(|(_, v)| v.is_finite() && *v >= 0.0), "{place}: values");
            assert!(entries.stored() <= visited.len(), "{place}: entries stored");
            assert!((0..targets).all(|t| entries.get(t) == wanted[t]), "{place}: get, or a second call");
            let (sum, dot): (f64, f64) = (wanted.iter().sum(), wanted.iter().zip(x.values()).map(|(f, x)| f * x).sum());
            assert!((entries.sum() - sum).abs() <= rounding(targets, sum), "{place}: sum");
            assert!((entries.dot(x.values()) - dot).abs() <= rounding(targets, 2.0 * sum), "{place}: dot");
        }
    }
    let properties = store.properties();
    assert!(properties.per_band || rows.iter().all(|row| *row == rows[0]), "{name}: rows differ between bands");
    if properties.symmetric {
        assert_eq!(sources, targets, "{name}: symmetric and square");
        let mirrored = |s: usize, t: usize| rows.iter().all(|row| row[s * targets + t] == row[t * targets + s]);
        assert!((0..sources).all(|s| (0..s).all(|t| mirrored(s, t))), "{name}: symmetry in every band");
    }
}

fn check_products(store: &dyn FormFactors, rows: &[Vec<f64>]) {
    let (name, sources, targets, bands) = (store.name(), store.sources(), store.targets(), rows.len());
    let (x, z) = (values(bands, targets), values(bands, sources));
    let (mut y, mut w) = (BandValues::zeros(bands, sources), BandValues::zeros(bands, targets));
    let gathered = store.gather(x.view(), y.view_mut()).expect("rows can be had");
    let scattered = store.scatter(z.view(), w.view_mut()).expect("rows can be had");
    for (b, table) in rows.iter().enumerate() {
        let entry = |s: usize, t: usize| table[s * targets + t];
        for s in 0..sources {
            let terms = (0..targets).map(|t| entry(s, t) * x.band(b)[t]);
            let (sum, size) = terms.fold((0.0, 0.0), |(sum, size), term| (sum + term, size + term.abs()));
            let error = (y.band(b)[s] - sum).abs();
            assert!(error <= rounding(targets, size), "{name}, gather, source {s}, band {b}: off by {error}");
        }
        for t in 0..targets {
            let terms = (0..sources).map(|s| entry(s, t) * z.band(b)[s]);
            let (sum, size) = terms.fold((0.0, 0.0), |(sum, size), term| (sum + term, size + term.abs()));
            let error = (w.band(b)[t] - sum).abs();
            assert!(error <= rounding(sources, size), "{name}, scatter, target {t}, band {b}: off by {error}");
        }
    }
    check_counts(store, gathered, bands);
    if !store.properties().per_band {
        check_counts(store, scattered, bands);
        // One band by itself has the bytes that it has among others.
        let mut alone = BandValues::zeros(1, sources);
        let band = BandValues::single(x.band(1).to_vec());
        store.gather(band.view(), alone.view_mut()).expect("rows can be had");
        assert_eq!(alone.band(0), y.band(1), "{name}: bytes of a band by itself");
    }
    // A single lit source: its row and nothing else.
    let (mut lit, mut w) = (BandValues::zeros(bands, sources), BandValues::zeros(bands, targets));
    let s = sources / 2;
    lit.band_mut(bands - 1)[s] = 2.0;
    let cost = store.scatter(lit.view(), w.view_mut()).expect("rows can be had");
    let wanted = rows[bands - 1][s * targets..(s + 1) * targets].iter().map(|value| 2.0 * value);
    assert!(w.band(bands - 1).iter().copied().eq(wanted), "{name}: a scatter of one source is its row");
    assert!((0..bands - 1).all(|b| w.band(b).iter().all(|&w| w == 0.0)), "{name}: dark bands stay dark");
    assert!(cost.source_evaluations <= 1, "{name}: rows computed for dark sources");
}

/// Counts of a product over all rows are those of the rows; links, each of which serves many rows, are read once.
fn check_counts(store: &dyn FormFactors, cost: Cost, bands: usize) {
    if store.name() == "extended" {
        // Two parts, each read once for all bands that share it; a row has them added up.
        let least = (store.sources() * store.targets()) as u64 / 2;
        assert!(cost.entries >= least && cost.flops <= 2 * cost.entries * bands as u64, "extended: entries and flops");
        return;
    }
    if store.name() == "thinned" {
        // What was kept, and two vectors; or full rows.
        let most = (store.sources() * (store.targets() + 2)) as u64;
        assert!(cost.entries <= most && cost.flops == 2 * cost.entries * bands as u64, "thinned: entries and flops");
        return;
    }
    if store.name() == "hierarchical" {
        let entries = (store.sources() * store.targets()) as u64;
        assert!(cost.entries <= entries && cost.flops == 2 * cost.entries * bands as u64, "links: entries and flops");
        return;
    }
    let (tables, mut buf) = (if store.properties().per_band { bands } else { 1 }, RowBuf::default());
    let stored =
        |s: usize, b: usize, buf: &mut RowBuf| store.row(s, b, buf).expect("a row can be had").entries.stored();
    let mut entries = 0;
    for b in 0..tables {
        entries += (0..store.sources()).map(|s| stored(s, b, &mut buf) as u64).sum::<u64>();
    }
    let served = (bands / tables) as u64;
    assert_eq!((cost.entries, cost.flops), (entries, 2 * entries * served), "{}: entries and flops", store.name());
}

fn check_sweep(store: &dyn FormFactors, rows: &[Vec<f64>]) {
    let (name, sources, targets, bands) = (store.name(), store.sources(), store.targets(), rows.len());
    let (square, per_band) = (sources == targets, store.properties().per_band);
    let mut x = values(bands, targets);
    // What x must be: each block adds 1 to what it owns after it was relaxed.
    let mut newest = x.clone();
    let mut next = 0;
    let visit = &mut |block: &Block<'_>, mut x: radiosity_core::BandsMut<'_>| {
        let (range, len) = (block.range.clone(), block.range.len());
        assert_eq!(range.start, next, "{name}, sweep: order of blocks");
        next = range.end;
        assert_eq!(x.view().values(), newest.values(), "{name}, sweep: x of block {range:?}");
        let tables = if !square {
            0
        } else if per_band {
            bands
        } else {
            1
        };
        assert_eq!(block.inside.len(), tables * len * len, "{name}, sweep: size of the block's inside");
        for (b, table) in rows.iter().enumerate() {
            let owned = if tables == 0 { 0..0 } else { range.clone() };
            for (k, s) in range.clone().enumerate() {
                let row = &table[s * targets..(s + 1) * targets];
                let terms = (0..targets).filter(|t| !owned.contains(t)).map(|t| row[t] * newest.band(b)[t]);
                let (sum, size) = terms.fold((0.0, 0.0), |(sum, size), term| (sum + term, size + term.abs()));
                let error = (block.outside.band(b)[k] - sum).abs();
                assert!(error <= rounding(targets, size), "{name}, sweep, source {s}, band {b}: off by {error}");
                let at = (if per_band { b } else { 0 } * len + k) * len;
                if !owned.is_empty() {
                    assert_eq!(&block.inside[at..at + len], &row[owned.clone()], "{name}, sweep: inside, source {s}");
                }
            }
            for t in owned {
                newest.band_mut(b)[t] += 1.0;
                x.band(b)[t] += 1.0;
            }
        }
    };
    let cost = store.sweep(x.view_mut(), visit).expect("rows can be had");
    assert_eq!(next, sources, "{name}, sweep: sources visited");
    if name != "hierarchical" {
        // Over links a sweep goes by rows, and a product does not.
        check_counts(store, cost, bands);
    }
}

/// Of rows whose area is a tenth more than their sum.
fn check_draws(store: &dyn FormFactors, rows: &[Vec<f64>]) {
    if !store.draws_from_rows() {
        return;
    }
    let (name, targets, mut buf) = (store.name(), store.targets(), DrawBuf::default());
    let mut drawn = [vec![0; 3 * targets], vec![0; 7]];
    for (b, table) in rows.iter().enumerate() {
        for (s, row) in table.chunks_exact(targets).enumerate() {
            let (place, area) = (format!("{name}, row {s}, band {b}"), 1.1 * row.iter().sum::<f64>());
            let mut seed = 0;
            let draws = drawn.each_mut().map(|targets| {
                seed += 1;
                Draws { seed, targets }
            });
            let exchange = store.sample(s, b, area, &mut { draws }, &mut buf).expect("a row can be had").exchange;
            assert_eq!(exchange, area, "{place}: what the draws share");
            for drawn in &drawn {
                let mut hits = vec![0.0; targets];
                drawn.iter().filter(|&&t| t != LOST).for_each(|&t| hits[t as usize] += 1.0);
                for (t, (hits, entry)) in hits.iter().zip(row).enumerate() {
                    let share = if area > 0.0 { drawn.len() as f64 * entry / area } else { 0.0 };
                    assert!((hits - share).abs() < 1.0 + 1e-9, "{place}: {hits} draws of {t} for {share}");
                }
            }
        }
    }
}

/// Bytes of stores whose formula is known by their name, after every row has been asked for.
fn check_bytes(store: &dyn FormFactors, table: &[f64]) {
    let (sources, targets) = (store.sources() as u64, store.targets() as u64);
    let nonzero = table.iter().filter(|value| **value != 0.0).count() as u64;
    let wanted = match store.name() {
        "dense" => 8 * sources * targets.next_multiple_of(8),
        "sparse" => 12 * nonzero + 8 * (sources + 1),
        "packed" => 8 * packed_entries(sources),
        "packed-f32" => 4 * packed_entries(sources),
        "on-demand" => 0,
        "on-demand-kept" => 8 * sources * targets,
        _ => return,
    };
    assert_eq!(store.properties().stored_bytes, wanted, "{}: stored bytes", store.name());
}

/// Entries of a packed store: whole tiles of 256 × 256 on and above the diagonal, and a last column of tiles of what is left of
/// n, padded to a multiple of 8.
fn packed_entries(n: u64) -> u64 {
    let (whole, rest) = (n / 256, n % 256);
    whole * (whole + 1) / 2 * 256 * 256 + (n - rest + rest.next_multiple_of(8)) * rest.next_multiple_of(8)
}

fn check_threads(store: &dyn FormFactors, bands: usize) {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of a few threads");
        pool.install(|| {
            let (x, z) = (values(bands, store.targets()), values(bands, store.sources()));
            let (mut y, mut w) = (BandValues::zeros(bands, z.len()), BandValues::zeros(bands, x.len()));
            let mut costs = store.gather(x.view(), y.view_mut()).expect("rows can be had");
            costs += store.scatter(z.view(), w.view_mut()).expect("rows can be had");
            let (mut swept, mut outside) = (x.clone(), Vec::new());
            let visit = &mut |block: &Block<'_>, _: radiosity_core::BandsMut<'_>| {
                outside.extend_from_slice(block.outside.values());
            };
            costs += store.sweep(swept.view_mut(), visit).expect("rows can be had");
            (y, w, outside, costs)
        })
    };
    let one = run(1);
    assert!(one == run(2) && one == run(8), "{}: bytes at 1, 2 and 8 threads", store.name());
}
