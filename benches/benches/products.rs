//! How fast does each store gather, scatter and sweep, and how near do the packed ones come to the speed of memory?
//!
//! Rows of a random enclosure of n elements that count as row-wise, so that a scatter is not a gather of a symmetric store;
//! the sparse store holds one entry in four. The on-demand store has kept all its rows before the clock starts. A sweep
//! is timed without the relaxation, which is the solver's. Throughput counts entries held, read once for all bands.
//!
//! The packed stores are of symmetric rows. At n = 8192, where no store fits a cache, `large` has their gathers and sweeps beside
//! those of the dense store and beside `read`: the plain sum of as many bytes, by all threads, which is what memory
//! gives. Throughput there counts bytes of form factors, each once, so that a gather is to be compared with `read`.

use std::hint::black_box;
use std::time::Duration;

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use radiosity_benches::{RowWise, values};
use radiosity_core::{BandValues, Cost, FormFactors, StoreError};
use radiosity_form_factors::Rows;
use radiosity_form_factors::stores::{DenseFormFactors, Keep, OnDemand, PackedFormFactors, SparseFormFactors};
use radiosity_gallery::RandomEnclosure;
use rayon::prelude::*;

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

/// Symmetric rows without zeros, at any n for nothing.
struct Smooth(usize);

impl Rows for Smooth {
    fn name(&self) -> &'static str {
        "smooth"
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
        values.iter_mut().enumerate().for_each(|(t, v)| *v = 1.0 / (1 + s + t + s.min(t)) as f64);
        Ok((Cost::default(), 0.0))
    }
}

fn packed(c: &mut Criterion) {
    for n in [256, 512, 1024, 2048] {
        let rows = RandomEnclosure::new(n, radiosity_benches::SEED);
        bench(c, &PackedFormFactors::<f64>::assemble(&rows).expect("exchange areas").0, (n * n) as u64);
        bench(c, &PackedFormFactors::<f32>::assemble(&rows).expect("exchange areas").0, (n * n) as u64);
    }
}

/// Sum of all values by all threads, in pieces that keep the prefetchers busy.
fn read(values: &[f64]) -> f64 {
    let sum = |piece: &[f64]| {
        let mut sums = [0.0; 32];
        for chunk in piece.chunks_exact(32) {
            sums.iter_mut().zip(chunk).for_each(|(sum, v)| *sum += v);
        }
        sums.iter().sum::<f64>()
    };
    values.par_chunks(1 << 20).map(sum).sum()
}

fn large(c: &mut Criterion) {
    const N: usize = 8192;
    let mut group = c.benchmark_group("large");
    settle(&mut group).sample_size(30);
    let mut timed = |store: &dyn FormFactors| {
        let bytes = store.properties().stored_bytes;
        group.throughput(Throughput::Bytes(bytes));
        let whole = vec![1.0; bytes as usize / 8];
        group.bench_function(BenchmarkId::new("read", format!("{}/{N}", store.name())), |bench| {
            bench.iter(|| read(black_box(&whole)));
        });
        drop(whole);
        for (name, product) in [PRODUCTS[0], PRODUCTS[2]] {
            for bands in [1, 3] {
                let (x, mut y) = (values(bands, N), values(bands, N));
                let id = BenchmarkId::new(name, format!("{}/bands-{bands}/{N}", store.name()));
                group.bench_function(id, |bench| bench.iter(|| product(store, &x, &mut y)));
            }
        }
    };
    timed(&DenseFormFactors::assemble(&Smooth(N)).expect("exchange areas").0);
    timed(&PackedFormFactors::<f64>::assemble(&Smooth(N)).expect("exchange areas").0);
    timed(&PackedFormFactors::<f32>::assemble(&Smooth(N)).expect("exchange areas").0);
    group.finish();
}

criterion_group!(benches, products, packed, large);
criterion_main!(benches);
