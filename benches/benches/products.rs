//! How fast does each store gather, scatter and sweep?
//!
//! Rows of a random enclosure of n elements that count as row-wise, so that a scatter is not a gather of a symmetric store;
//! the sparse store holds one entry in four. The on-demand store has kept all its rows before the clock starts. A sweep
//! is timed without the relaxation, which is the solver's. Throughput counts entries held, read once for all bands.

use std::time::Duration;

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use radiosity_benches::{RowWise, values};
use radiosity_core::{BandValues, FormFactors};
use radiosity_form_factors::stores::{DenseFormFactors, Keep, OnDemand, SparseFormFactors};

/// Entries of which the sparse store holds one.
const SPARSE: usize = 4;

/// A product of `store` with x in place of y.
type Product = fn(&dyn FormFactors, &BandValues, &mut BandValues);

const PRODUCTS: [(&str, Product); 3] = [("gather", gather), ("scatter", scatter), ("sweep", sweep)];

fn gather(store: &dyn FormFactors, x: &BandValues, y: &mut BandValues) {
    store.gather(x.view(), y.view_mut()).expect("rows are at hand");
}

fn scatter(store: &dyn FormFactors, x: &BandValues, y: &mut BandValues) {
    store.scatter(x.view(), y.view_mut()).expect("rows are at hand");
}

fn sweep(store: &dyn FormFactors, _: &BandValues, y: &mut BandValues) {
    store.sweep(y.view_mut(), &mut |_, _| {}).expect("rows are at hand");
}

/// Every product in one and in three bands.
fn bench(c: &mut Criterion, store: &dyn FormFactors, entries: u64) {
    let n = store.sources();
    for (name, product) in PRODUCTS {
        let mut group = c.benchmark_group(format!("{name}/{}", store.name()));
        settle(&mut group).throughput(Throughput::Elements(entries));
        for bands in [1, 3] {
            let (x, mut y) = (values(bands, n), values(bands, n));
            // Once outside the clock: the on-demand store computes its rows.
            product(store, &x, &mut y);
            let id = BenchmarkId::new(format!("bands-{bands}"), n);
            group.bench_function(id, |bench| bench.iter(|| product(store, &x, &mut y)));
        }
        group.finish();
    }
}

/// Many short benches: a third of criterion's usual time each.
fn settle<'a, 'b>(group: &'b mut BenchmarkGroup<'a, WallTime>) -> &'b mut BenchmarkGroup<'a, WallTime> {
    group.warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_millis(1500))
}

fn products(c: &mut Criterion) {
    for n in [256, 512, 1024, 2048] {
        let whole = RowWise::new(n, 1);
        let (dense, _) = DenseFormFactors::assemble(&whole).expect("exchange areas");
        bench(c, &dense, (n * n) as u64);
        drop(dense);
        bench(c, &OnDemand::new(Box::new(whole), Keep::All), (n * n) as u64);
        let (sparse, _) = SparseFormFactors::assemble(&RowWise::new(n, SPARSE)).expect("exchange areas");
        bench(c, &sparse, sparse.matrix().nnz() as u64);
    }
}

criterion_group!(benches, products);
criterion_main!(benches);
