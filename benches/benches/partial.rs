//! What does it cost to know a partly hidden pair to a tolerance, and how much of a blocked scene's form-factor phase is that?
//!
//! A box of side 0.4 in the unit cube: of the pairs that face each other seven in ten are clear, an eighth is hidden and a sixth partial.
//! A partial pair at 1e-6 takes some 40 points, evaluated a vector at a time: less than a tenth of the phase. Cutting polygons
//! along the visibility events takes longer, and sorting pairs and the unoccluded rule most of all, which is why the cost hardly falls with
//! the tolerance. 256 segments a partial pair, for errors of some 1e-4, take several times as long.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use radiosity_form_factors::PairwiseRows;
use radiosity_form_factors::analytic::{Analytic, PartialVisibility};
use radiosity_form_factors::stores::DenseFormFactors;
use radiosity_gallery::boxes::{box_in_cube, material};
use radiosity_geometry::mesh::{Mesh, MeshSettings, Subdivision};
use radiosity_geometry::{Facets, Occluders};

/// Error of unoccluded pairs: below that of the partial ones.
const UNOCCLUDED: f64 = 1e-8;

/// K × K cells a face of the room and half of that on the box.
fn scene(k: u32) -> (Facets, Occluders) {
    let grey = || material("grey", 0.5, 1.0);
    let scene = box_in_cube(0.4, grey(), grey());
    let cells = |k: u32| {
        let settings = MeshSettings { elements: Subdivision::Uniform(k), patches: None, contacts: true };
        Mesh::new(&scene, &Occluders::of_scene(&scene), &settings).expect("k is positive").element_facets
    };
    // The room's six faces come first.
    let (fine, coarse) = (cells(k), cells(k / 2));
    let mut facets = Facets::new();
    (0..fine.len() / 2).for_each(|t| facets.push(fine.polygons(t).to_vec(), false));
    (coarse.len() / 2..coarse.len()).for_each(|t| facets.push(coarse.polygons(t).to_vec(), false));
    (facets, Occluders::blocking(&scene))
}

fn partial(c: &mut Criterion) {
    let mut group = c.benchmark_group("partial");
    group.sample_size(10);
    for k in [8, 16] {
        let (facets, blockers) = scene(k);
        let rules = [
            ("1e-4", PartialVisibility::Exact { tolerance: 1e-4 }),
            ("1e-6", PartialVisibility::Exact { tolerance: 1e-6 }),
            ("1e-8", PartialVisibility::Exact { tolerance: 1e-8 }),
            ("256-segments", PartialVisibility::Rays { samples: 256, standard_error: f64::INFINITY }),
        ];
        for (name, rule) in rules {
            let estimator = Analytic::new(Some(&blockers)).partial_visibility(rule);
            let rows = PairwiseRows::new(&estimator, &facets, &facets, UNOCCLUDED, 1);
            let cost = DenseFormFactors::assemble(&rows).expect("the store fits").1;
            group.throughput(Throughput::Elements(cost.partial_pairs));
            group.bench_function(BenchmarkId::new(name, facets.len()), |bench| {
                bench.iter(|| DenseFormFactors::assemble(&rows).expect("the store fits"));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, partial);
criterion_main!(benches);
