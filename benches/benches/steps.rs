//! What does one step of each solver cost?
//!
//! The first step after `start` on a dense symmetric store of a random enclosure, one band: a product (Jacobi, conjugate
//! gradients), a sweep (Gauss–Seidel), a shot (shooting), 64 draws a row and what they bring (stochastic), and for the direct method the
//! factorisation with one correction. Throughput counts the entries that the step reads, which is n² but for a shot and says little of the direct
//! method, whose work is n³.

use std::time::Duration;

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use radiosity_benches::SEED;
use radiosity_core::{Cost, Iterate, Solver, System};
use radiosity_gallery::RandomEnclosure;
use radiosity_solvers::{NAMES, STOCHASTIC, by_name};

fn start(name: &str, system: &System<'_>) -> (Box<dyn Solver>, Iterate) {
    let mut solver = by_name(name).expect("a name from the list of names");
    let (iterate, _) = solver.start(system, None).expect("rows are at hand");
    (solver, iterate)
}

fn step(system: &System<'_>, (solver, iterate): &mut (Box<dyn Solver>, Iterate)) -> Cost {
    solver.step(system, iterate).expect("rows are at hand").1
}

fn steps(c: &mut Criterion) {
    for n in [256, 512, 1024] {
        let enclosure = RandomEnclosure::new(n, SEED);
        let store = enclosure.dense();
        let system = enclosure.system(&store);
        for name in NAMES.into_iter().chain([STOCHASTIC]) {
            let entries = step(&system, &mut start(name, &system)).entries;
            let mut group = c.benchmark_group(format!("step/{name}"));
            group.warm_up_time(Duration::from_secs(1)).measurement_time(Duration::from_secs(3));
            group.throughput(Throughput::Elements(entries));
            group.bench_function(BenchmarkId::new("dense", n), |bench| {
                bench.iter_batched_ref(|| start(name, &system), |run| step(&system, run), BatchSize::LargeInput);
            });
            group.finish();
        }
    }
}

criterion_group!(benches, steps);
criterion_main!(benches);
