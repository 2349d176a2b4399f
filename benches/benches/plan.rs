//! What does a plan cost, and what does a run by it take beside one whose choices are made by hand?
//!
//! An empty convex grey room, three equal bands. `plan/new` and `plan/left-out` are the plan and its counts alone, by elements along an edge;
//! `plan/run` the whole run: `planned`, `everything`, and `by-hand`, which is a library call on a scene of one band. Throughput counts elements.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use radiosity::plan::Omissions;
use radiosity::{Method, Plan, Strategy, run};
use radiosity_gallery::boxes::material;
use radiosity_gallery::rooms::grey_room;
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::Subdivision;

/// The grey room in one band.
fn one_band() -> Scene {
    let Scene { surfaces, .. } = grey_room([3.0; 3]);
    Scene { surfaces, materials: vec![material("grey", 0.5, 0.0), material("lamp", 0.3, 3.0)] }
}

fn plan(c: &mut Criterion) {
    let (grey, alone) = (grey_room([3.0; 3]), one_band());
    let mut group = c.benchmark_group("plan");
    for k in [8, 16] {
        let everything = Strategy::new(Subdivision::Uniform(k), Method::ANALYTIC);
        let planned = Strategy { omit: Omissions::ALL, ..everything.clone() };
        group.throughput(Throughput::Elements(6 * u64::from(k).pow(2)));
        group.bench_function(BenchmarkId::new("new", k), |bench| bench.iter(|| Plan::new(&grey, &planned)));
        let found = Plan::new(&grey, &planned);
        let geometry = found.mesh(&grey, &planned).expect("a mesh of a sound scene");
        group.bench_function(BenchmarkId::new("left-out", k), |bench| {
            bench.iter(|| found.left_out(&geometry, &planned));
        });
        for (name, scene, strategy) in
            [("planned", &grey, &planned), ("everything", &grey, &everything), ("by-hand", &alone, &everything)]
        {
            let id = BenchmarkId::new(format!("run/{name}"), k);
            group.bench_function(id, |bench| {
                bench.iter(|| run(scene, strategy, &mut ()).expect("a sound scene"));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, plan);
criterion_main!(benches);
