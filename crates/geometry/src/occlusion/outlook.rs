//! Rays that leave one plane, many at a time, against every polygon of a scene of few.
//!
//! Seen from the frame of a source with its plane at z = 0, the scene scaled to about 1, a ray o + t d meets the plane n·p + c = 0 of a polygon at
//!
//! ```text
//! t = −(n·o + c)/(n·d),      h = o + t d,
//! ```
//!
//! and the polygon if t > 0 and eₖ·h + gₖ > 0 for all of its edges, with eₖ the unit normal into the polygon: 40 operations of single precision
//! for as many rays as a register holds. All of these numbers, and h itself, are off by at most
//!
//! ```text
//! τ = (ε + ε′|t|)/|n·d|
//! ```
//!
//! Therefore a ray hits if the smallest of t and eₖ·h + gₖ is above τ, misses if it is below −τ, and *may* hit in between. The nearest
//! certain hit is the answer if t + τ is below t − τ of all other hits, certain or not. The rays for which it is not, one in
//! thousands, are left to the exact test: so answers are those of [`Occluders::first_hits`], whatever the instruction set.
//!
//! What is *not* here: scenes of more polygons, where the hierarchy is faster.

use glam::DVec3;
use pulp::{Arch, Simd, WithSimd};

use super::cells::Bin;
use super::{NOBODY, Occluders};
use crate::Polygon;

/// Polygons that are gone through one after another; beyond that the hierarchy is faster.
const FEW: usize = 96;

/// Rays in a [`Bundle`] at most.
pub const BUNDLE: usize = 256;

/// Error of a height over a plane or an edge in single precision. Coordinates lie below 4 and carry 2⁻²¹ as sums of three products, constants 2⁻²³, unit normals
/// 2⁻²⁵ a component, and three fused steps below 8 add 3 · 2⁻²²: less than 2⁻¹⁹ in all, of which twice goes into t and once each into
/// h and its edges. Twice that is taken.
const HEIGHT: f64 = 1.0 / (1 << 16) as f64;

/// Error of a slope and of an edge's slope along the ray, in the same way: 2⁻²² each, and 2⁻²² of t by rounding, four times.
const SLOPE: f32 = 1.0 / (1 << 19) as f32;

/// Largest 1/|n·d|: keeps t finite where a ray is parallel to a plane. What it meets there is uncertain in any case.
const STEEP: f32 = 1e12;

/// Of no polygon.
const MISS: u32 = u32::MAX;
/// Of a ray for the exact test.
const OPEN: u32 = u32::MAX - 1;

/// Rays in the frame of an [`Outlook`], side by side: where they begin and where they go. Directions are unit vectors to 10⁻⁶.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct Bundle {
    /// Where they begin along both axes, from the middle, scaled: see [`Outlook::scale`].
    pub begin: [[f32; BUNDLE]; 2],
    /// Directions, the third component along the normal of the plane.
    pub direction: [[f32; BUNDLE]; 3],
    /// Number of rays; the places after them hold anything finite.
    pub len: usize,
}

impl Default for Bundle {
    fn default() -> Self {
        Self { begin: [[0.0; BUNDLE]; 2], direction: [[0.0; BUNDLE]; 3], len: 0 }
    }
}

/// The polygons of a scene as a source sees them that looks along its normal.
pub struct Outlook<'a> {
    occluders: &'a Occluders,
    /// Unit vectors along the plane, and its normal.
    axes: [DVec3; 3],
    faces: Vec<Face>,
    /// Plane after plane: eₖ and gₖ.
    edges: Vec<[f32; 4]>,
    /// ε.
    height: f32,
}

/// A polygon in the frame of a source.
struct Face {
    polygon: u32,
    /// n and c.
    plane: [f32; 4],
    /// Its edges end here.
    edges: u32,
    /// How its bins are found, if it is cut into facets.
    chart: FlatChart,
}

/// A [`Chart`](super::cells::Chart) in single precision, in the frame of a source.
#[derive(Clone, Copy, Default)]
struct FlatChart {
    /// x and y of a point.
    across: [[f32; 4]; 2],
    twist: [f32; 2],
    least: [f32; 2],
    steps: [f32; 2],
    /// Largest change of σ and of τ, in bins, with the point.
    steep: [f32; 2],
}

/// What the planes and edges of a polygon need in every frame.
pub(super) struct Flat {
    /// A point and the unit normal into the polygon, of the edges.
    sides: Vec<(DVec3, DVec3)>,
}

/// Planes and edges of polygons, if they are few.
pub(super) fn flats(polygons: &[Polygon]) -> Option<Vec<Flat>> {
    let flat = |p: &Polygon| {
        let side = |(a, b): (DVec3, DVec3)| Some((a, p.normal().cross(b - a).try_normalize()?));
        Flat { sides: p.edges().filter_map(side).collect() }
    };
    (polygons.len() <= FEW).then(|| polygons.iter().map(flat).collect())
}

impl Occluders {
    /// What can be hit from points of the polygon `source` in directions in front of it; `None` if there are too many polygons to go
    /// through all of them.
    pub fn outlook(&self, source: &Polygon) -> Option<Outlook<'_>> {
        let flats = self.flats.as_ref()?;
        let (middle, (x, y), z) = (source.centroid(), source.frame(), source.normal());
        let (axes, scale) = ([x, y, z], self.frame.scale);
        let turned = |v: DVec3| DVec3::new(v.dot(x), v.dot(y), v.dot(z));
        let affine = |v: DVec3, constant: f64| {
            let v = turned(v);
            [v.x as f32, v.y as f32, v.z as f32, constant as f32]
        };
        let (mut faces, mut edges) = (Vec::with_capacity(flats.len()), Vec::with_capacity(4 * flats.len()));
        let mut margin = 0.0_f64;
        for (k, (flat, &leaf)) in flats.iter().zip(&self.flat_leaves).enumerate() {
            let leaf = &self.leaves[leaf as usize];
            let polygon = &self.polygons[k];
            let behind = polygon.vertices().iter().all(|v| (*v - middle).dot(z) <= leaf.margin);
            let in_plane =
                || source.vertices().iter().all(|v| (*v - leaf.centroid).dot(leaf.normal).abs() <= 0.5 * leaf.margin);
            if behind || in_plane() {
                continue;
            }
            margin = margin.max(leaf.margin);
            edges.extend(flat.sides.iter().map(|&(a, inward)| affine(inward, inward.dot(middle - a) * scale)));
            let mut chart = FlatChart::default();
            if let Some(cells) = &self.cells {
                let exact = &cells.grid(k).chart;
                let single = |x: [f64; 2]| x.map(|x| x as f32);
                let across = exact.duals.map(|dual| affine(dual / scale, dual.dot(middle - exact.corner)));
                let length = exact.duals.map(|dual| dual.length() / scale);
                let steep = exact.steps.map(|steps| steps * exact.steep * length[0].max(length[1]));
                let (twist, least, steps) = (single(exact.twist), single(exact.least), single(exact.steps));
                chart = FlatChart { across, twist, least, steps, steep: single(steep) };
            }
            faces.push(Face {
                polygon: k as u32,
                plane: affine(leaf.normal, leaf.normal.dot(middle - leaf.centroid) * scale),
                edges: edges.len() as u32,
                chart,
            });
        }
        let height = (HEIGHT + 4.0 * margin * scale) as f32;
        Some(Outlook { occluders: self, axes, faces, edges, height })
    }
}

impl Outlook<'_> {
    /// Lengths in the frame are lengths of the scene times this.
    pub fn scale(&self) -> f64 {
        self.occluders.frame.scale
    }

    /// The owners of what rays meet first, where that is a front; `u32::MAX` where it is a back, or nothing. `begin` gives where ray k
    /// begins exactly: within 10⁻⁶ of where the bundle says, the scene scaled to 1. Directions are exact as they are.
    ///
    /// # Panics
    ///
    /// If there are not as many `owners` as rays.
    pub fn owners(&self, rays: &Bundle, begin: impl Fn(usize) -> DVec3, owners: &mut [u32]) {
        assert_eq!(rays.len, owners.len(), "{} rays, {} owners", rays.len, owners.len());
        let mut met = Met::default();
        Arch::new().dispatch(Follow { outlook: self, rays, met: &mut met });
        let grids = self.occluders.cells.as_ref();
        for (k, owner) in owners.iter_mut().enumerate() {
            *owner = match met.face[k] {
                MISS => NOBODY,
                OPEN => self.exact(rays, &begin, k),
                face => {
                    let face = &self.faces[face as usize];
                    match grids {
                        None => self.occluders.owners[face.polygon as usize],
                        Some(cells) => {
                            let grid = cells.grid(face.polygon as usize);
                            let point = [met.point[0][k], met.point[1][k], met.point[2][k]];
                            match face.chart.bin(point, met.error[k], grid.count).map(|[i, j]| grid.bin(i, j)) {
                                Some(Bin::One(owner)) => owner,
                                _ => self.on(face.polygon, rays, &begin, k),
                            }
                        }
                    }
                }
            };
        }
    }

    /// Direction of ray k.
    fn direction(&self, rays: &Bundle, k: usize) -> DVec3 {
        let [x, y, z] = [0, 1, 2].map(|axis| self.axes[axis] * f64::from(rays.direction[axis][k]));
        x + y + z
    }

    /// What ray k meets, by the exact test.
    #[cold]
    fn exact(&self, rays: &Bundle, begin: &impl Fn(usize) -> DVec3, k: usize) -> u32 {
        let hit = self.occluders.first_hit(begin(k), self.direction(rays, k));
        hit.filter(|hit| hit.front).map_or(NOBODY, |hit| hit.owner)
    }

    /// Whose part of a polygon ray k meets.
    fn on(&self, polygon: u32, rays: &Bundle, begin: &impl Fn(usize) -> DVec3, k: usize) -> u32 {
        let (origin, d) = (begin(k), self.direction(rays, k));
        let face = &self.occluders.polygons[polygon as usize];
        let t = -face.signed_distance(origin) / d.dot(face.normal());
        self.occluders.owner_at(polygon, origin + d * t)
    }
}

impl FlatChart {
    /// The bin of a point, if it is certain.
    #[inline(always)]
    fn bin(&self, [px, py, pz]: [f32; 3], error: f32, count: [u32; 2]) -> Option<[u32; 2]> {
        let [x, y] = self.across.map(|[a, b, c, d]| a * px + b * py + c * pz + d);
        let [g1, g2] = self.twist;
        let (mut sigma, mut tau) = (x, y);
        if g1 != 0.0 || g2 != 0.0 {
            let b = 1.0 + g2 * x - g1 * y;
            tau = 2.0 * y / (b + (b * b + 4.0 * g1 * y).max(0.0).sqrt());
            sigma = x / (1.0 + g1 * tau);
        }
        // Beyond the error of the point those of sums whose terms are below 4 times the slope.
        let error = error + 1e-5;
        let step = |at: f32, axis: usize| {
            let (at, slack) = ((at - self.least[axis]) * self.steps[axis], self.steep[axis] * error);
            // Conversion saturates: a point on the border lies in the last bin.
            let most = count[axis] - 1;
            (((at - slack) as u32).min(most), ((at + slack) as u32).min(most))
        };
        let (i, j) = (step(sigma, 0), step(tau, 1));
        (i.0 == i.1 && j.0 == j.1).then_some([i.0, j.0])
    }
}

/// What rays have met.
#[repr(C, align(64))]
struct Met {
    /// Index of the face whose front they meet, [`MISS`] or [`OPEN`].
    face: [u32; BUNDLE],
    /// Where.
    point: [[f32; BUNDLE]; 3],
    /// 2τ.
    error: [f32; BUNDLE],
}

impl Default for Met {
    fn default() -> Self {
        Self { face: [MISS; BUNDLE], point: [[0.0; BUNDLE]; 3], error: [0.0; BUNDLE] }
    }
}

/// Follows the rays of a bundle with one instruction set.
struct Follow<'a, 'b> {
    outlook: &'a Outlook<'b>,
    rays: &'a Bundle,
    met: &'a mut Met,
}

impl WithSimd for Follow<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { outlook, rays, met } = self;
        let splat = |x: f32| simd.splat_f32s(x);
        let fma = |a, b, c| simd.mul_add_e_f32s(a, b, c);
        let (infinite, zero) = (splat(f32::INFINITY), splat(0.0));
        let (height, slope) = (splat(outlook.height), splat(SLOPE));
        let begin = rays.begin.each_ref().map(|x| S::as_simd_f32s(x).0);
        let direction = rays.direction.each_ref().map(|x| S::as_simd_f32s(x).0);
        let faces = S::as_mut_simd_u32s(&mut met.face).0;
        let points = met.point.each_mut().map(|x| S::as_mut_simd_f32s(x).0);
        let errors = S::as_mut_simd_f32s(&mut met.error).0;
        for k in 0..rays.len.div_ceil(S::F32_LANES) {
            let (x, y) = (begin[0][k], begin[1][k]);
            let (dx, dy, dz) = (direction[0][k], direction[1][k], direction[2][k]);
            // Nearest certain hit: t − τ, t + τ, t, 1/(n·d), face; and t − τ of the nearest other.
            let (mut low, mut high, mut near) = (infinite, infinite, zero);
            let (mut steep, mut face) = (zero, simd.splat_u32s(MISS));
            let mut rival = infinite;
            let mut first = 0;
            for (index, f) in outlook.faces.iter().enumerate() {
                let [nx, ny, nz, c] = f.plane.map(splat);
                let over = fma(nx, x, fma(ny, y, c));
                let along = fma(nx, dx, fma(ny, dy, simd.mul_f32s(nz, dz)));
                let inverse = simd.div_f32s(splat(-1.0), along);
                let inverse = simd.max_f32s(simd.min_f32s(inverse, splat(STEEP)), splat(-STEEP));
                let t = simd.mul_f32s(over, inverse);
                let error = simd.mul_f32s(simd.abs_f32s(inverse), fma(simd.abs_f32s(t), slope, height));
                let (hx, hy, hz) = (fma(t, dx, x), fma(t, dy, y), simd.mul_f32s(t, dz));
                let mut least = t;
                for edge in &outlook.edges[first..f.edges as usize] {
                    let [ex, ey, ez, g] = edge.map(splat);
                    least = simd.min_f32s(least, fma(ex, hx, fma(ey, hy, fma(ez, hz, g))));
                }
                first = f.edges as usize;
                let (before, after) = (simd.sub_f32s(t, error), simd.add_f32s(t, error));
                let missed = simd.less_than_f32s(simd.add_f32s(least, error), zero);
                let hit = simd.less_than_f32s(error, least);
                let nearest = simd.and_m32s(hit, simd.less_than_f32s(after, high));
                let other = simd.select_f32s(nearest, low, simd.select_f32s(missed, infinite, before));
                rival = simd.min_f32s(rival, other);
                low = simd.select_f32s(nearest, before, low);
                high = simd.select_f32s(nearest, after, high);
                near = simd.select_f32s(nearest, t, near);
                steep = simd.select_f32s(nearest, inverse, steep);
                face = simd.select_u32s(nearest, simd.splat_u32s(index as u32), face);
            }
            let none = simd.less_than_f32s(splat(f32::MAX), simd.min_f32s(high, rival));
            let certain = simd.or_m32s(none, simd.less_than_f32s(high, rival));
            // −1/(n·d) is negative where a ray meets a back.
            let front = simd.less_than_f32s(zero, steep);
            let face = simd.select_u32s(front, face, simd.splat_u32s(MISS));
            faces[k] = simd.select_u32s(certain, face, simd.splat_u32s(OPEN));
            points[0][k] = fma(near, dx, x);
            points[1][k] = fma(near, dy, y);
            points[2][k] = simd.mul_f32s(near, dz);
            errors[k] = simd.sub_f32s(high, low);
        }
    }
}

#[cfg(test)]
mod tests {
    #[cfg(target_arch = "x86_64")]
    use pulp::x86::{V3, V4};
    use pulp::{NullaryFnOnce, Scalar};

    use super::*;
    use crate::testing::{Random, cornell_box, cube, scene_of};
    use crate::{Facets, Mesh, MeshSettings, Scene, Subdivision};

    /// Elements that see something and the pieces that they are parts of.
    fn exposed(scene: &Scene, k: u32) -> (Facets, Occluders) {
        let settings = MeshSettings { elements: Subdivision::Uniform(k), patches: None, contacts: true };
        let mesh = Mesh::new(scene, &Occluders::of_scene(scene), &settings).unwrap();
        let (mut facets, mut carriers, faces) = (Facets::new(), Vec::new(), mesh.faces());
        for e in (0..mesh.elements.len()).filter(|&e| !mesh.elements[e].covered) {
            facets.push(mesh.element_facets.polygons(e).to_vec(), false);
            carriers.push(faces[e]);
        }
        let occluders = Occluders::of_parts(scene, &facets, &carriers);
        (facets, occluders)
    }

    /// Rays from a polygon, where they begin, and where they go: half of them at random, half aimed at points of `targets`.
    fn bundle(
        polygon: &Polygon,
        outlook: &Outlook<'_>,
        targets: &[DVec3],
        random: &mut Random,
    ) -> (Bundle, Vec<DVec3>) {
        let (mut bundle, mut begins) = (Bundle::default(), Vec::new());
        let axes = outlook.axes;
        while begins.len() < BUNDLE {
            let begin = polygon.sample(random.unit(), random.unit());
            let k = begins.len();
            let target = targets[(random.unit() * targets.len() as f64) as usize];
            let d = if k % 2 == 0 { random.direction() } else { (target - begin).normalize() };
            if d.dot(axes[2]) <= 1e-3 && k % 2 == 1 {
                begins.push(polygon.centroid());
                (0..3).for_each(|axis| bundle.direction[axis][k] = if axis == 2 { 1.0 } else { 0.0 });
                continue;
            }
            let d = if d.dot(axes[2]) < 0.0 { -d } else { d };
            (0..3).for_each(|axis| bundle.direction[axis][k] = d.dot(axes[axis]) as f32);
            for (begins, axis) in bundle.begin.iter_mut().zip(axes) {
                begins[k] = ((begin - polygon.centroid()).dot(axis) * outlook.scale()) as f32;
            }
            begins.push(begin);
        }
        bundle.len = BUNDLE;
        (bundle, begins)
    }

    fn vertices(scene: &Scene) -> Vec<DVec3> {
        // Corners, and points of edges.
        let of = |p: &Polygon| p.edges().flat_map(|(a, b)| [a, a.lerp(b, 0.3), a.lerp(b, 0.5)]).collect::<Vec<_>>();
        scene.pieces().flat_map(|(_, p)| of(p)).collect()
    }

    /// Also for rays at corners and edges, where single precision leaves it to the exact test.
    #[test]
    fn answers_are_those_of_the_exact_test() {
        let scene = scene_of(&cornell_box());
        let (facets, occluders) = exposed(&scene, 5);
        let (targets, mut random) = (vertices(&scene), Random(11));
        let mut rays = 0;
        for s in (0..facets.len()).step_by(3) {
            let polygon = &facets.polygons(s)[0];
            let outlook = occluders.outlook(polygon).unwrap();
            let (bundle, begins) = bundle(polygon, &outlook, &targets, &mut random);
            let mut owners = [0; BUNDLE];
            outlook.owners(&bundle, |k| begins[k], &mut owners);
            for (k, &owner) in owners.iter().enumerate() {
                let hit = occluders.first_hit(begins[k], outlook.direction(&bundle, k));
                let expected = hit.filter(|hit| hit.front).map_or(NOBODY, |hit| hit.owner);
                assert_eq!(owner, expected, "ray {k} of source {s}");
                rays += 1;
            }
        }
        assert!(rays > 30_000);
    }

    /// The hierarchy over all elements knows nothing of surfaces. Random rays come nowhere near a border of elements.
    #[test]
    fn parts_of_surfaces_are_what_rays_at_the_parts_themselves_meet() {
        let scene = scene_of(&cornell_box());
        let (facets, occluders) = exposed(&scene, 7);
        let (apart, mut random) = (Occluders::of_facets(&facets), Random(5));
        let (lo, hi) = (DVec3::splat(1.0), DVec3::splat(545.0));
        let mut compared = 0;
        for k in 0..20_000 {
            let (p, d) = (random.point(lo, hi), random.direction());
            let met = |occluders: &Occluders| occluders.first_hit(p, d).map(|hit| (hit.owner, hit.front));
            let part = met(&occluders);
            // From within a block a ray may reach the floor under it, which is no element.
            if part != Some((NOBODY, true)) {
                assert_eq!(part, met(&apart), "ray {k}");
                compared += 1;
            }
        }
        assert!(compared > 19_000);
    }

    #[test]
    fn no_ray_of_a_bundle_escapes_a_cube_turned_and_moved_far_away() {
        let turn = glam::DMat3::from_quat(glam::DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7));
        let mut faces = cube(2.0);
        faces.iter_mut().flatten().for_each(|v| *v = turn * *v + DVec3::new(1e5, -1e5, 1e5));
        let scene = scene_of(&faces);
        let (facets, occluders) = exposed(&scene, 3);
        let (targets, mut random) = (vertices(&scene), Random(2));
        for s in 0..facets.len() {
            let polygon = &facets.polygons(s)[0];
            let outlook = occluders.outlook(polygon).unwrap();
            let (bundle, begins) = bundle(polygon, &outlook, &targets, &mut random);
            let mut owners = [0; BUNDLE];
            outlook.owners(&bundle, |k| begins[k], &mut owners);
            assert!(!owners.contains(&NOBODY), "source {s}");
        }
    }

    struct With<'a, 'b, S>(S, Follow<'a, 'b>);

    impl<S: Simd> NullaryFnOnce for With<'_, '_, S> {
        type Output = ();

        #[inline(always)]
        fn call(self) {
            self.1.with_simd(self.0);
        }
    }

    /// What is certain on one instruction set is the same on all; fewer than one random ray in 500 is left open.
    #[test]
    fn every_instruction_set_is_certain_of_the_same() {
        let scene = scene_of(&cornell_box());
        let (facets, occluders) = exposed(&scene, 4);
        let (targets, mut random) = (vertices(&scene), Random(9));
        let (mut open, mut all) = (0, 0);
        for s in (0..facets.len()).step_by(7) {
            let polygon = &facets.polygons(s)[0];
            let outlook = occluders.outlook(polygon).unwrap();
            let (bundle, _) = bundle(polygon, &outlook, &targets, &mut random);
            let (mut plain, mut met) = (Met::default(), [Met::default(), Met::default()]);
            Follow { outlook: &outlook, rays: &bundle, met: &mut plain }.with_simd(Scalar::new());
            let mut sets = 0;
            #[cfg(target_arch = "x86_64")]
            {
                let [first, second] = &mut met;
                if let Some(simd) = V3::try_new() {
                    simd.vectorize(With(simd, Follow { outlook: &outlook, rays: &bundle, met: first }));
                    sets += 1;
                }
                if let Some(simd) = V4::try_new() {
                    simd.vectorize(With(simd, Follow { outlook: &outlook, rays: &bundle, met: second }));
                    sets += 1;
                }
            }
            for (k, &face) in plain.face.iter().enumerate() {
                let others = met[..sets].iter().map(|met| met.face[k]);
                assert!(others.into_iter().all(|other| other == face || other == OPEN || face == OPEN), "ray {k}");
                open += usize::from(face == OPEN && k % 2 == 0);
                all += usize::from(k % 2 == 0);
            }
        }
        assert!(open * 500 < all, "{open} of {all}");
    }
}
