//! How many rays a second does the hierarchy of blockers take, on one thread?
//!
//! `first_hit` follows a ray from one polygon towards another, `occluded` tests the segment between the two points; 4096
//! of them between points spread over all polygons, in the Cornell box and among 10,008 triangles. Throughput counts rays.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use radiosity_benches::{cornell, furnished_cube, segments};
use radiosity_geometry::Occluders;

/// Rays in one iteration.
const RAYS: usize = 4096;

fn visibility(c: &mut Criterion) {
    let triangles = furnished_cube();
    let owners = (0..triangles.len() as u32).collect();
    let scenes = [("cornell", Occluders::of_scene(&cornell())), ("furnished-cube", Occluders::new(triangles, owners))];
    for (name, occluders) in &scenes {
        let segments = segments(occluders.polygons(), RAYS);
        let id = || BenchmarkId::new(*name, occluders.len());
        let mut group = c.benchmark_group("first-hit");
        group.throughput(Throughput::Elements(RAYS as u64));
        group.bench_function(id(), |bench| {
            bench.iter(|| segments.iter().filter(|(p, q)| occluders.first_hit(*p, *q - *p).is_some()).count());
        });
        group.finish();
        let mut group = c.benchmark_group("occluded");
        group.throughput(Throughput::Elements(RAYS as u64));
        group.bench_function(id(), |bench| {
            bench.iter(|| segments.iter().filter(|(p, q)| occluders.occluded(*p, *q)).count());
        });
        group.finish();
    }
}

criterion_group!(benches, visibility);
criterion_main!(benches);
