//! What does the form-factor phase of an unoccluded scene cost, and what bounds it?
//!
//! The unit cube seen from inside, K × K cells a face: all pairs, symmetric, computed from a list of facets into a fresh store, with
//! AVX-512, AVX2 and neither. Throughput counts the 15 K⁴ pairs that face each other. `rows` computes them into one
//! row's buffer: arithmetic alone. `fresh` writes that many zeros into fresh memory, as a dense store must: what the system
//! takes for handing out pages. At 1e-8 a pair takes 57 evaluations of the kernel in the mean (16 in three pairs of four), each about
//! 7 vector operations an 8th of a register wide, and as many operations again for its orders and bound. So with AVX-512 the
//! arithmetic of 24 × 24 cells is 1.4 times the time of touching the pages of a dense store, and both count;
//! with narrower registers the arithmetic is what bounds it.
//!
//! Tolerances are what the *bound* of each pair meets; the worst true error is a quarter to a half of it (1.3e-9 for 1,536 and 0.9e-9
//! for 3,456 patches where 3.5e-9 is asked).

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use radiosity_benches::{SEED, empty_cube, geometry};
use radiosity_form_factors::analytic::Analytic;
use radiosity_form_factors::level::Level;
use radiosity_form_factors::stores::{DenseFormFactors, PackedFormFactors};
use radiosity_form_factors::{PairwiseRows, Rows};
use rayon::prelude::*;

fn level_name(level: Level) -> &'static str {
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx512(_) => "avx-512",
        #[cfg(target_arch = "x86_64")]
        Level::Avx2(_) => "avx2",
        Level::Plain => "plain",
    }
}

fn pairs(c: &mut Criterion) {
    let scene = empty_cube();
    for k in [16, 24] {
        let geometry = geometry(&scene, k);
        let facets = geometry.elements();
        let mut group = c.benchmark_group(format!("pairs/{}", facets.len()));
        group.sample_size(10).throughput(Throughput::Elements(15 * u64::from(k).pow(4)));
        for tolerance in [3.5e-9, 3.5e-11] {
            for level in Level::all() {
                let analytic = Analytic::new(None).at_level(level);
                let id = |store: &str| BenchmarkId::new(format!("{store}/{}", level_name(level)), tolerance);
                let rows = || PairwiseRows::new(analytic.clone(), facets, facets, tolerance, SEED);
                group.bench_function(id("rows"), |bench| {
                    bench.iter(|| {
                        let rows = rows();
                        let row = |values: &mut Vec<f64>, s| rows.upper_row(s, values).expect("a sound mesh").1;
                        let bounds = (0..facets.len()).into_par_iter().map_init(|| vec![0.0; facets.len()], row);
                        bounds.reduce(|| 0.0, f64::max)
                    });
                });
                group.bench_function(id("dense"), |bench| {
                    bench.iter(|| DenseFormFactors::assemble(&rows()).expect("exchange areas"));
                });
                group.bench_function(id("packed"), |bench| {
                    bench.iter(|| PackedFormFactors::<f64>::assemble(&rows()).expect("exchange areas"));
                });
            }
        }
        group.bench_function("fresh", |bench| {
            bench.iter(|| {
                let mut values = vec![0.0; facets.len() * facets.len()];
                values.par_chunks_mut(facets.len()).for_each(|row| row.fill(1.0));
                values
            });
        });
        group.finish();
    }
}

criterion_group!(benches, pairs);
criterion_main!(benches);
