//! How long does the Cornell box take from scene to verified solution?
//!
//! Mesh of 8 × 8 elements a face, rows by 1024 rays, dense store, Gauss–Seidel to an unshot share of 1e-6, three bands. Reading
//! the file is outside the clock. Throughput counts elements. Error against time is what the experiments measure.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use radiosity::{Method, Strategy, run};
use radiosity_benches::cornell;
use radiosity_geometry::Subdivision;

fn solve(c: &mut Criterion) {
    let scene = cornell();
    let strategy = Strategy { unshot: 1e-6, ..Strategy::new(Subdivision::Uniform(8), Method::RAY_CAST) };
    let solve = || run(&scene, &strategy, &mut ()).expect("a sound scene");
    let elements = solve().geometry.elements().len();
    let mut group = c.benchmark_group("solve/gauss-seidel");
    group.sample_size(10).throughput(Throughput::Elements(elements as u64));
    group.bench_function(BenchmarkId::new("dense", elements), |bench| bench.iter(solve));
    group.finish();
}

criterion_group!(benches, solve);
criterion_main!(benches);
