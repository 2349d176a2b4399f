//! How many rays a second does the hierarchy of blockers take on one thread, beside the one it is built from?
//!
//! `closest` follows rays from points spread evenly over all polygons in directions distributed like the cosine, `segments` tests
//! segments between such points that face each other; in the Cornell box (38 triangles) and among 20 spheres (10,254). `obvhs` is
//! its CWBVH with triangles in single precision, built as slowly as it can and compiled for this program's processor level:
//! how busy the machine is shows there. Throughput counts rays, in batches of 65,536; `single` asks ray by ray.
//!
//! Of the time of `obvhs` (compiled for plain x86-64) among the spheres, rays take 0.76 with AVX-512, 0.79 with AVX2 and 1.23 with
//! neither, segments 0.74, 0.81 and 1.27 (best of 15 runs of 4,096 rays each). The quick test lets hardly any polygon pass that is not
//! met, so that those in double precision are few; what is left is waiting for nodes and blocks from the second and third level of
//! the cache, which is why a busy neighbour costs more here than it costs `obvhs`.

use std::time::Duration;

use criterion::{
    BenchmarkGroup, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main, measurement::WallTime,
};
use glam::DVec3;
use obvhs::{
    BvhBuildParams,
    cwbvh::{CwBvh, builder::build_cwbvh_from_tris},
    ray::{Ray, RayHit},
    rt_triangle::RtTriangle,
    triangle::Triangle,
};
use radiosity_benches::{cornell_triangles, facing_segments, spheres, surface_rays};
use radiosity_geometry::{Occluders, Polygon};

/// Rays in one iteration.
const RAYS: usize = 1 << 16;
/// Share of a segment that single precision leaves out at either end, so that it meets no polygon that it begins or ends on.
const OFFSET: f64 = 1e-4;

/// The same triangles in single precision.
struct Single {
    hierarchy: CwBvh,
    /// In the order of the hierarchy.
    triangles: Vec<RtTriangle>,
}

impl Single {
    fn new(polygons: &[Polygon]) -> Self {
        let corner = |p: &Polygon, k: usize| p.vertices()[k].as_vec3a();
        let all = polygons.iter().map(|p| Triangle { v0: corner(p, 0), v1: corner(p, 1), v2: corner(p, 2) });
        let all: Vec<Triangle> = all.collect();
        let hierarchy = build_cwbvh_from_tris(&all, BvhBuildParams::very_slow_build(), &mut Duration::default());
        let triangles = hierarchy.primitive_indices.iter().map(|&k| RtTriangle::from(&all[k as usize])).collect();
        Self { hierarchy, triangles }
    }

    fn hit(&self, ray: Ray) -> bool {
        self.hierarchy.ray_traverse(ray, &mut RayHit::none(), |ray, k| self.triangles[k].intersect(ray))
    }

    fn blocked(&self, ray: Ray) -> bool {
        !self.hierarchy.ray_traverse_miss(ray, |ray, k| self.triangles[k].intersect(ray))
    }
}

/// A ray along a unit vector, begun a little later and ended a little before the length.
fn ray(origin: DVec3, d: DVec3, length: f64, size: f64) -> Ray {
    let offset = OFFSET * size;
    Ray::new((origin + d * offset).as_vec3a(), d.as_vec3a(), 0.0, (length - 2.0 * offset) as f32)
}

fn group<'a>(c: &'a mut Criterion, query: &str) -> BenchmarkGroup<'a, WallTime> {
    let mut group = c.benchmark_group(query);
    group.throughput(Throughput::Elements(RAYS as u64)).sample_size(20);
    group
}

fn closest(c: &mut Criterion, occluders: &Occluders, single: &Single, size: f64) {
    let n = occluders.len();
    let rays = surface_rays(occluders.polygons(), RAYS);
    let singles: Vec<Ray> = rays.iter().map(|&(o, d)| ray(o, d, f64::INFINITY, size)).collect();
    let mut hits = vec![None; RAYS];
    let mut group = group(c, "closest");
    group.bench_function(BenchmarkId::new("obvhs", n), |bench| {
        bench.iter(|| singles.iter().filter(|&&ray| single.hit(ray)).count());
    });
    group.bench_function(BenchmarkId::new("batch", n), |bench| bench.iter(|| occluders.first_hits(&rays, &mut hits)));
    group.bench_function(BenchmarkId::new("single", n), |bench| {
        bench.iter(|| rays.iter().filter(|&&(o, d)| occluders.first_hit(o, d).is_some()).count());
    });
    group.finish();
}

fn segments(c: &mut Criterion, occluders: &Occluders, single: &Single, size: f64) {
    let n = occluders.len();
    let segments = facing_segments(occluders.polygons(), RAYS);
    let singles: Vec<Ray> = segments.iter().map(|&(p, q)| ray(p, (q - p).normalize(), p.distance(q), size)).collect();
    let mut blocked = vec![false; RAYS];
    let mut group = group(c, "segments");
    group.bench_function(BenchmarkId::new("obvhs", n), |bench| {
        bench.iter(|| singles.iter().filter(|&&ray| single.blocked(ray)).count());
    });
    group.bench_function(BenchmarkId::new("batch", n), |bench| {
        bench.iter(|| occluders.occluded_many(&segments, &mut blocked));
    });
    group.bench_function(BenchmarkId::new("single", n), |bench| {
        bench.iter(|| segments.iter().filter(|&&(p, q)| occluders.occluded(p, q)).count());
    });
    group.finish();
}

fn visibility(c: &mut Criterion) {
    for (polygons, size) in [(cornell_triangles(), 556.0), (spheres(), 1.0)] {
        let (single, owners) = (Single::new(&polygons), (0..polygons.len() as u32).collect());
        let occluders = Occluders::new(polygons, owners);
        closest(c, &occluders, &single, size);
        segments(c, &occluders, &single, size);
    }
}

criterion_group!(benches, visibility);
criterion_main!(benches);
