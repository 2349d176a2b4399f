//! What does one row of each estimator cost?
//!
//! Eight rows of a mesh of 8 × 8 elements a face, spread over it, in the empty cube and in the Cornell box; the settings of
//! the row-wise estimators vary by factors of 2. Throughput counts form factors (analytic), rays (ray-cast) and pixels
//! (hemicube). A row uses all threads, as it does when a solver asks for it. `ray-cast` follows rays to the surfaces, in bundles where they
//! are few, and finds the element from the place of the hit; `ray-cast-to-elements` follows the same rays to the elements themselves, through the
//! hierarchy. With AVX-512, side by side on a busy machine: 33 to 40 million rays a second and thread against 5.4 to 7.8 in the Cornell box, 45 to 48
//! against 5.2 to 6.3 in the cube.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use radiosity::{Geometry, Method, rows};
use radiosity_benches::{SEED, cornell, empty_cube, geometry};
use radiosity_core::{Cost, Form};
use radiosity_form_factors::analytic::Analytic;
use radiosity_form_factors::ray_cast::RayCast;
use radiosity_form_factors::{PairwiseRows, Receivers, Rows};
use radiosity_geometry::Occluders;

/// Elements along an edge of a face.
const SUBDIVISION: u32 = 8;
/// Rows computed in one iteration.
const ROWS: usize = 8;
/// Absolute error of F asked of the analytic estimator.
const TOLERANCE: f64 = 1e-10;

/// Computes [`ROWS`] rows spread over the mesh.
fn compute(rows: &dyn Rows, values: &mut [f64]) -> Cost {
    let sources = (0..ROWS).map(|k| (2 * k + 1) * rows.sources() / (2 * ROWS));
    sources.map(|s| rows.row(s, values).expect("rows of a sound mesh").0).sum()
}

fn bench(c: &mut Criterion, group: &str, scene: &str, rows: &dyn Rows, size: u32, work: fn(&Cost, usize) -> u64) {
    let mut values = vec![0.0; rows.targets()];
    let cost = compute(rows, &mut values);
    let mut group = c.benchmark_group(format!("row/{group}"));
    group.throughput(Throughput::Elements(work(&cost, ROWS * rows.targets())));
    group.bench_function(BenchmarkId::new(scene, size), |bench| bench.iter(|| compute(rows, &mut values)));
    group.finish();
}

/// Every estimator on one mesh.
fn estimators(c: &mut Criterion, scene: &str, geometry: &Geometry<'_>) {
    let elements = geometry.elements();
    let entries = |_: &Cost, entries: usize| entries as u64;
    let m = elements.len() as u32;
    let unoccluded = PairwiseRows::new(Analytic::new(None), elements, elements, TOLERANCE, SEED);
    bench(c, "analytic-unoccluded", scene, &unoccluded, m, entries);
    if !geometry.blockers().is_empty() {
        let analytic = Analytic::new(Some(geometry.blockers()));
        let occluded = PairwiseRows::new(analytic, elements, elements, TOLERANCE, SEED);
        bench(c, "analytic-occluded", scene, &occluded, m, entries);
    }
    let row_wise = |method| rows(geometry, method, Form::Full, SEED).expect("settings in range");
    for rays in [512, 1024, 2048] {
        let rows = row_wise(Method::rays(rays));
        bench(c, "ray-cast", scene, &*rows, rays, |cost, _| cost.rays);
    }
    let apart = Occluders::of_facets(elements);
    for rays in [512, 1024, 2048] {
        let rows = RayCast::new(elements, Receivers::facets(elements), &apart, rays, SEED);
        bench(c, "ray-cast-to-elements", scene, &rows, rays, |cost, _| cost.rays);
    }
    for resolution in [64, 128, 256] {
        let rows = row_wise(Method::Hemicube { resolution });
        bench(c, "hemicube", scene, &*rows, resolution, |cost, _| cost.hemicube_pixels);
    }
}

fn row(c: &mut Criterion) {
    for (name, scene) in [("empty-cube", empty_cube()), ("cornell", cornell())] {
        estimators(c, name, &geometry(&scene, SUBDIVISION));
    }
}

criterion_group!(benches, row);
criterion_main!(benches);
