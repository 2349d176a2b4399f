//! How fast does each store gather, scatter and sweep, and how near do the packed ones come to the speed of memory?
//!
//! Rows of a random enclosure of n elements that count as row-wise, so that a scatter is not a gather of a symmetric store;
//! the sparse store holds one entry in four. The on-demand store has kept all its rows before the clock starts. A sweep
//! is timed without the relaxation, which is the solver's. Throughput counts entries held, read once for all bands.
//!
//! The packed stores are of symmetric rows. At n = 8192, where no store fits a cache, `large` has their gathers and sweeps beside
//! those of the dense store and beside `read`: the plain sum of as many bytes, by all threads, which is what memory
//! gives. Throughput there counts bytes of form factors, each once, so that a gather is to be compared with `read`. `faer` is that
//! library's product of the full matrix with as many columns as there are bands, in two threads.
//!
//! `sparse` has rows of 512 entries among 40,000: the store's products beside `hand`, a loop over the same arrays in parallel that sums a row
//! in eight accumulators and knows nothing of bands or stores, `sprs`, that library's product (one thread), and `read`.

use std::hint::black_box;
use std::time::Duration;

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use radiosity_benches::{RowWise, values};
use radiosity_core::{BandValues, Cost, FormFactors, StoreError};
use radiosity_form_factors::Rows;
use radiosity_form_factors::stores::{DenseFormFactors, Keep, OnDemand, PackedFormFactors, SparseFormFactors};
use radiosity_gallery::RandomEnclosure;
use rayon::prelude::*;
use sprs::prod::mul_acc_mat_vec_csr;

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
            group.bench_function(id, |bench| within(|| bench.iter(|| product(store, &x, &mut y))));
        }
        group.finish();
    }
}

/// Runs `timed` as a task of the pool, as the program does: from outside, each block of a sweep would wait for a thread to wake.
fn within(timed: impl FnOnce() + Send) {
    rayon::scope(|_| timed());
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
    let dense = DenseFormFactors::assemble(&Smooth(N)).expect("exchange areas").0;
    group.throughput(Throughput::Bytes(dense.properties().stored_bytes));
    // Column s of the store's matrix is row s; the matrix is symmetric, so faer may take it either way.
    for (layout, matrix) in [("row-major", dense.matrix().transpose()), ("column-major", dense.matrix())] {
        for bands in [1, 3] {
            let (x, mut y) = (values(bands, N), values(bands, N));
            let id = BenchmarkId::new("faer", format!("{layout}/bands-{bands}/{N}"));
            group.bench_function(id, |bench| {
                bench.iter(|| {
                    let x = MatRef::from_column_major_slice(x.values(), N, bands);
                    let y = MatMut::from_column_major_slice_mut(y.values_mut(), N, bands);
                    matmul(y, Accum::Replace, matrix, x, 1.0, Par::rayon(2));
                });
            });
        }
    }
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
                group.bench_function(id, |bench| within(|| bench.iter(|| product(store, &x, &mut y))));
            }
        }
    };
    timed(&dense);
    drop(dense);
    timed(&PackedFormFactors::<f64>::assemble(&Smooth(N)).expect("exchange areas").0);
    timed(&PackedFormFactors::<f32>::assemble(&Smooth(N)).expect("exchange areas").0);
    group.finish();
}

/// Rows with so many entries at places without a pattern, not symmetric.
struct Scattered {
    n: usize,
    entries: usize,
}

impl Rows for Scattered {
    fn name(&self) -> &'static str {
        "scattered"
    }

    fn sources(&self) -> usize {
        self.n
    }

    fn targets(&self) -> usize {
        self.n
    }

    fn symmetric(&self) -> bool {
        false
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        values.fill(0.0);
        // A generator modulo 2⁶⁴ (D. E. Knuth's multiplier), its upper half as the place.
        let mut state = s as u64 + radiosity_benches::SEED;
        let mut left = self.entries;
        while left > 0 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let value = &mut values[(state >> 32) as usize % self.n];
            left -= usize::from(*value == 0.0);
            *value = 1.0 / (1 + state % 1000) as f64;
        }
        Ok((Cost::default(), 0.0))
    }
}

/// y = A x of compressed rows: what one would write by hand.
fn by_hand(begins: &[usize], targets: &[u32], values: &[f64], x: &[f64], y: &mut [f64]) {
    y.par_iter_mut().with_min_len(16).enumerate().for_each(|(s, y)| {
        let (targets, values) = (&targets[begins[s]..begins[s + 1]], &values[begins[s]..begins[s + 1]]);
        let (targets, last_targets) = targets.as_chunks::<8>();
        let (values, last_values) = values.as_chunks::<8>();
        let mut sums = [0.0; 8];
        for (targets, values) in targets.iter().zip(values) {
            for k in 0..8 {
                sums[k] += values[k] * x[targets[k] as usize];
            }
        }
        let rest: f64 = last_targets.iter().zip(last_values).map(|(&t, v)| v * x[t as usize]).sum();
        *y = sums.iter().sum::<f64>() + rest;
    });
}

fn sparse(c: &mut Criterion) {
    const N: usize = 40_000;
    let store = SparseFormFactors::assemble(&Scattered { n: N, entries: 512 }).expect("exchange areas").0;
    let bytes = store.properties().stored_bytes;
    let mut group = c.benchmark_group("sparse");
    settle(&mut group).sample_size(30).throughput(Throughput::Bytes(bytes));
    let (x, mut y) = (values(1, N), values(1, N));
    let whole = vec![1.0; bytes as usize / 8];
    group.bench_function(BenchmarkId::new("read", N), |bench| bench.iter(|| read(black_box(&whole))));
    drop(whole);
    let matrix = store.matrix();
    let begins = matrix.indptr();
    let begins = begins.raw_storage();
    group.bench_function(BenchmarkId::new("hand", N), |bench| {
        bench.iter(|| by_hand(begins, matrix.indices(), matrix.data(), x.values(), y.values_mut()));
    });
    group.bench_function(BenchmarkId::new("sprs", N), |bench| {
        bench.iter(|| {
            y.values_mut().fill(0.0);
            mul_acc_mat_vec_csr(matrix.view(), x.values(), y.values_mut());
        });
    });
    for (name, product) in [PRODUCTS[0], PRODUCTS[2]] {
        for bands in [1, 3] {
            let (x, mut y) = (values(bands, N), values(bands, N));
            let id = BenchmarkId::new(name, format!("bands-{bands}/{N}"));
            group.bench_function(id, |bench| within(|| bench.iter(|| product(&store, &x, &mut y))));
        }
    }
    group.finish();
}

criterion_group!(benches, products, packed, large, sparse);
criterion_main!(benches);
