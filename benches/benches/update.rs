//! What does a moved block cost, against all of it from nothing?
//!
//! The Cornell box with K × K elements a face, exact pairs, dense store, conjugate gradients; its short block moves by a tenth of its size. `whole` solves
//! the scene from nothing, `moved` goes on from the scene before, `same` from the scene itself: what looking for changes costs.
//! Throughput counts the form factors of a whole run.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use glam::DVec3;
use radiosity::{Method, Solved, Strategy};
use radiosity_benches::cornell;
use radiosity_geometry::{Polygon, Subdivision};

fn update(c: &mut Criterion) {
    let before = cornell();
    let mut after = before.clone();
    let block = after.surfaces.iter_mut().filter(|surface| surface.name.starts_with("short"));
    for piece in block.flat_map(|surface| &mut surface.pieces) {
        let corners: Vec<DVec3> = piece.vertices().iter().map(|v| *v + DVec3::new(-12.0, 0.0, 9.0)).collect();
        *piece = Polygon::new(&corners).expect("a polygon stays one where it is moved");
    }
    let mut group = c.benchmark_group("update/analytic");
    for k in [4, 8] {
        let strategy = Strategy { verify: false, ..Strategy::new(Subdivision::Uniform(k), Method::ANALYTIC) };
        let solve = |scene| Solved::new(scene, &strategy, &mut ()).expect("a sound scene");
        let solved = solve(&before);
        let go_on = |scene| solved.resolve(scene, &mut ()).expect("the same surfaces");
        group.sample_size(10).throughput(Throughput::Elements(go_on(&after).1.of_form_factors));
        group.bench_function(BenchmarkId::new("whole", k), |bench| bench.iter(|| solve(&after)));
        group.bench_function(BenchmarkId::new("moved", k), |bench| bench.iter(|| go_on(&after)));
        group.bench_function(BenchmarkId::new("same", k), |bench| bench.iter(|| go_on(&before)));
    }
    group.finish();
}

criterion_group!(benches, update);
criterion_main!(benches);
