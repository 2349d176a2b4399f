//! How many pixels a second does a hemicube fill, and what do its polygons cost?
//!
//! One row at a time on one thread, from 8 sources spread over the scene: the Cornell box as it is (few polygons, where
//! filling counts) and 10,254 triangles (where setting them up does), by resolution and by instruction set, pixels alone;
//! then with near targets from pairs. Throughput counts pixels.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use pulp::Arch;
use radiosity_benches::{SEED, cornell, spheres};
use radiosity_form_factors::hemicube::Hemicube;
use radiosity_form_factors::{Receivers, Rows};
use radiosity_geometry::Facets;

/// Rows computed in one iteration.
const ROWS: usize = 8;

/// Instruction sets that this machine has, with their names.
fn instruction_sets() -> Vec<(&'static str, Arch)> {
    let mut sets = vec![("plain", Arch::Scalar)];
    #[cfg(target_arch = "x86_64")]
    {
        sets.extend(pulp::x86::V3::try_new().map(|simd| ("avx2", Arch::V3(simd))));
        sets.extend(pulp::x86::V4::try_new().map(|simd| ("avx512", Arch::V4(simd))));
    }
    sets
}

fn bench(c: &mut Criterion, id: BenchmarkId, facets: &Facets, hemicube: &Hemicube<'_>, resolution: u32) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool of one thread");
    let mut values = vec![0.0; facets.len()];
    let mut group = c.benchmark_group("hemicube");
    group.throughput(Throughput::Elements(ROWS as u64 * 3 * u64::from(resolution).pow(2)));
    group.bench_function(id, |bench| {
        pool.install(|| {
            bench.iter(|| {
                for k in 0..ROWS {
                    let s = (2 * k + 1) * facets.len() / (2 * ROWS);
                    hemicube.row(s, &mut values).expect("rows of a sound scene");
                }
            });
        });
    });
    group.finish();
}

fn hemicube(c: &mut Criterion) {
    let mut balls = Facets::new();
    spheres().into_iter().for_each(|triangle| balls.push(vec![triangle], false));
    for (scene, facets) in [("cornell", Facets::of_surfaces(&cornell())), ("spheres", balls)] {
        for resolution in [64, 128, 256, 512] {
            let hemicube =
                || Hemicube::new(&facets, Receivers::facets(&facets), resolution, SEED).expect("a resolution in range");
            for (name, arch) in instruction_sets() {
                let id = BenchmarkId::new(format!("{scene}/{name}"), resolution);
                bench(c, id, &facets, &hemicube().exact_near(false).on(arch), resolution);
            }
            let id = BenchmarkId::new(format!("{scene}/near-targets-from-pairs"), resolution);
            bench(c, id, &facets, &hemicube(), resolution);
        }
    }
}

criterion_group!(benches, hemicube);
criterion_main!(benches);
