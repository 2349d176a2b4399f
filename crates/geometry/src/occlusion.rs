//! What blocks: occlusion of segments and the first polygon along a ray.
//!
//! A CWBVH of single precision (Ylitie, Karras & Laine 2017, crate `obvhs`) over boxes rounded outward proposes
//! polygons; the polygons themselves are tested in double precision. The test is watertight in the sense of Woop, Benthin
//! & Wald (2013): every vertex is sheared to a point (x, y) of the plane across the ray, rounded once and the same for all
//! polygons that share the vertex, and the origin is on the side of an edge that the comparison of two rounded products
//! a_x b_y ≷ a_y b_x gives. Rounding is monotonic, so the comparison is right or a tie; ties count as inside. A segment
//! through an edge or vertex that neighbours share bit for bit is therefore blocked by one of them at least.
//!
//! What is *not* here: which side of a polygon receives light, and anything about materials.

use std::time::Duration;

use glam::{DVec3, UVec2, Vec3A};
use obvhs::{
    Boundable, BvhBuildParams,
    aabb::Aabb,
    cwbvh::{CwBvh, builder::build_cwbvh},
    ray::{Ray, RayHit},
};

use crate::{Facets, Polygon, Scene, polygon::bounds};

/// Boxes grow by this on all sides, the scene scaled to [−1, 1]³. Rounding of a ray (origin, direction, the clamp of its
/// inverse at 2⁻²³ over a path of 2√3) and of the box test moves them apart by at most 1.6e-6.
const PAD: f64 = 1.0 / (1 << 18) as f64;

/// Single-precision rays begin this far before their origin, the scene scaled to [−1, 1]³: the box test of `obvhs` drops
/// what ends before 1e-4.
const BACK: f64 = 1.0 / (1 << 12) as f64;

/// Rounding of a point computed from scene coordinates, in units of ε times the largest coordinate.
const ROUNDING: f64 = 16.0;

/// The first polygon along a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Owner of the polygon: its surface, or its group of facets.
    pub owner: u32,
    /// Index of the polygon.
    pub polygon: u32,
    /// Distance from the origin of the ray, in the scene's unit of length.
    pub distance: f64,
    /// Whether the ray meets the front of the polygon.
    pub front: bool,
}

/// Polygons that block.
pub struct Occluders {
    polygons: Vec<Polygon>,
    owners: Vec<u32>,
    bvh: CwBvh,
    /// In the order of the hierarchy.
    leaves: Vec<Leaf>,
    /// Vertices of all leaves.
    corners: Vec<DVec3>,
    /// Scaled = (point − centre) · scale.
    centre: DVec3,
    scale: f64,
    /// A front hit no further behind the nearest hit than this, measured across its plane, counts as equally near.
    coincident: f64,
}

/// A polygon, as the traversal reads it.
struct Leaf {
    centroid: DVec3,
    normal: DVec3,
    /// A plane no further away contains the point: rounding plus twice the thickness.
    margin: f64,
    first: u32,
    count: u32,
    polygon: u32,
}

/// Box of a polygon for the builder.
struct OutwardBox(Aabb);

impl Boundable for OutwardBox {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

/// A ray's projection along itself onto the plane of the two axes it is least parallel to.
struct Shear {
    x: DVec3,
    y: DVec3,
}

impl Shear {
    fn along(d: DVec3) -> Self {
        let a = d.abs();
        // Shears stay below 1 when the axis dropped is the ray's largest.
        if a.x >= a.y && a.x >= a.z {
            Self { x: DVec3::new(-d.y / d.x, 1.0, 0.0), y: DVec3::new(-d.z / d.x, 0.0, 1.0) }
        } else if a.y >= a.z {
            Self { x: DVec3::new(0.0, -d.z / d.y, 1.0), y: DVec3::new(1.0, -d.x / d.y, 0.0) }
        } else {
            Self { x: DVec3::new(1.0, 0.0, -d.x / d.z), y: DVec3::new(0.0, 1.0, -d.y / d.z) }
        }
    }

    /// Whether the line through `p` passes the inside of the loop, by counting the edges that cross the half line
    /// y = 0, x > 0.
    #[inline]
    fn passes(&self, p: DVec3, corners: &[DVec3]) -> bool {
        let project = |v: DVec3| ((v - p).dot(self.x), (v - p).dot(self.y));
        let (mut ax, mut ay) = project(corners[corners.len() - 1]);
        let mut inside = false;
        for &corner in corners {
            let (bx, by) = project(corner);
            if (ay > 0.0) != (by > 0.0) {
                let (left, right) = (ax * by, ay * bx);
                if left == right {
                    return true;
                }
                inside ^= (left > right) == (by > 0.0);
            }
            (ax, ay) = (bx, by);
        }
        inside
    }
}

/// A ray for the hierarchy: distance s along it is t · scale + shift.
struct Scaled {
    ray: Ray,
    shift: f64,
}

fn single(v: DVec3) -> Vec3A {
    // Adding 0 turns −0 into +0, on whose sign the box test of `obvhs` contradicts itself.
    v.as_vec3a() + Vec3A::ZERO
}

impl Occluders {
    /// Occluders of any number of polygons, none included; `owners[k]` is reported for hits of polygon k.
    ///
    /// # Panics
    ///
    /// If the lists differ in length.
    pub fn new(polygons: Vec<Polygon>, owners: Vec<u32>) -> Self {
        assert_eq!(polygons.len(), owners.len(), "{} polygons, {} owners", polygons.len(), owners.len());
        let (lo, hi) = bounds(polygons.iter().flat_map(|p| p.vertices().iter().copied()));
        let empty = polygons.is_empty();
        let (centre, half) =
            if empty { (DVec3::ZERO, 1.0) } else { (lo * 0.5 + hi * 0.5, ((hi - lo) * 0.5).max_element()) };
        let reach = if empty { 1.0 } else { lo.abs().max(hi.abs()).max_element() };
        let (scale, rounding) = (half.recip(), ROUNDING * f64::EPSILON * reach);
        let boxes: Vec<OutwardBox> = polygons
            .iter()
            .map(|p| {
                let (lo, hi) = p.bounds();
                let scaled = |v: DVec3, pad: f64| ((v - centre) * scale + pad).as_vec3a();
                OutwardBox(Aabb::new(scaled(lo, -PAD), scaled(hi, PAD)))
            })
            .collect();
        let mut bvh = CwBvh::default();
        if !empty {
            bvh = build_cwbvh(&boxes, BvhBuildParams::medium_build(), &mut Duration::default());
        }
        let (mut leaves, mut corners) = (Vec::with_capacity(polygons.len()), Vec::new());
        for &k in &bvh.primitive_indices {
            let p = &polygons[k as usize];
            leaves.push(Leaf {
                centroid: p.centroid(),
                normal: p.normal(),
                margin: rounding + 2.0 * p.thickness(),
                first: corners.len() as u32,
                count: p.vertices().len() as u32,
                polygon: k,
            });
            corners.extend_from_slice(p.vertices());
        }
        let coincident = rounding + 1e-12 * if empty { 0.0 } else { (hi - lo).length() };
        Self { polygons, owners, bvh, leaves, corners, centre, scale, coincident }
    }

    /// All pieces of a scene, owned by their surfaces.
    pub fn of_scene(scene: &Scene) -> Self {
        let (owners, polygons) = scene.pieces().map(|(s, p)| (s as u32, p.clone())).unzip();
        Self::new(polygons, owners)
    }

    /// All polygons of facets, owned by their groups.
    pub fn of_facets(facets: &Facets) -> Self {
        let (owners, polygons) = facets.iter_polygons().map(|(k, p)| (k as u32, p.clone())).unzip();
        Self::new(polygons, owners)
    }

    /// The pieces of a scene that can block a segment between two of its points, owned by their surfaces: for
    /// [`Self::occluded`] only, since rays end on the others too. See [`blocking_polygons`].
    pub fn blocking(scene: &Scene) -> Self {
        let (owners, polygons) = blocking_polygons(scene).into_iter().map(|(s, p)| (s as u32, p.clone())).unzip();
        Self::new(polygons, owners)
    }

    /// Distance within which rounding moves a point computed from the coordinates of a scene: 16 ε times the largest.
    pub fn rounding(scene: &Scene) -> f64 {
        let (lo, hi) = scene.bounds();
        ROUNDING * f64::EPSILON * lo.abs().max(hi.abs()).max_element()
    }

    /// Number of polygons.
    pub fn len(&self) -> usize {
        self.polygons.len()
    }

    /// Whether there is no polygon.
    pub fn is_empty(&self) -> bool {
        self.polygons.is_empty()
    }

    /// The polygons, in the order given.
    pub fn polygons(&self) -> &[Polygon] {
        &self.polygons
    }

    /// Owner of a polygon.
    ///
    /// # Panics
    ///
    /// If there is no such polygon.
    pub fn owner(&self, polygon: usize) -> u32 {
        self.owners[polygon]
    }

    /// The ray from `origin` along the unit vector `d`, begun at the scene's box if it begins outside; `None` if it
    /// misses the box.
    #[inline]
    fn scaled(&self, origin: DVec3, d: DVec3) -> Option<Scaled> {
        let o = (origin - self.centre) * self.scale;
        let mut shift = BACK;
        if o.abs().max_element() > 1.5 {
            // Slabs of the box [−1, 1]³, a little larger.
            let (a, b) = ((-1.01 - o) / d, (1.01 - o) / d);
            let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
            for k in 0..3 {
                if d[k] != 0.0 {
                    enter = enter.max(a[k].min(b[k]));
                    leave = leave.min(a[k].max(b[k]));
                } else if o[k].abs() > 1.01 {
                    return None;
                }
            }
            if enter > leave {
                return None;
            }
            shift -= enter;
        }
        Some(Scaled { ray: Ray::new(single(o - d * shift), single(d), 0.0, f32::INFINITY), shift })
    }

    /// Single-precision distance along a scaled ray, rounded up.
    #[inline]
    fn reach(&self, t: f64, shift: f64) -> f32 {
        ((t * self.scale + shift) * (1.0 + 1e-6) + PAD) as f32
    }

    #[inline]
    fn corners(&self, leaf: &Leaf) -> &[DVec3] {
        &self.corners[leaf.first as usize..(leaf.first + leaf.count) as usize]
    }

    /// Whether a polygon properly crosses the open segment p q.
    ///
    /// A polygon whose plane contains an end point does not block: one no further from it than 16 ε times the scene's
    /// largest coordinate plus twice the polygon's thickness. Swapping p and q changes nothing.
    pub fn occluded(&self, p: DVec3, q: DVec3) -> bool {
        // One order of the end points, so that both directions round alike.
        let swap = (q.x, q.y, q.z) < (p.x, p.y, p.z);
        let (p, q) = if swap { (q, p) } else { (p, q) };
        let length = (q - p).length();
        if self.is_empty() || !(length > 0.0 && length.is_finite()) {
            return false;
        }
        let d = (q - p) / length;
        let Some(Scaled { mut ray, shift }) = self.scaled(p, d) else { return false };
        ray.tmax = self.reach(length, shift);
        let shear = Shear::along(d);
        !self.bvh.ray_traverse_miss(ray, |_, k| {
            let leaf = &self.leaves[k];
            let (dp, dq) = ((p - leaf.centroid).dot(leaf.normal), (q - leaf.centroid).dot(leaf.normal));
            let crosses = dp.abs() > leaf.margin && dq.abs() > leaf.margin && (dp > 0.0) != (dq > 0.0);
            if crosses && shear.passes(p, self.corners(leaf)) { 0.0 } else { f32::INFINITY }
        })
    }

    /// The first polygon along a ray of any direction but 0.
    ///
    /// Polygons whose plane contains the origin (as in [`Self::occluded`]) are not hit. Where a front and a back face
    /// coincide the one whose front faces the ray wins; among equals the smaller index, so that the answer does not depend on
    /// the order of traversal.
    pub fn first_hit(&self, origin: DVec3, direction: DVec3) -> Option<Hit> {
        let d = direction.try_normalize()?;
        if self.is_empty() || !origin.is_finite() {
            return None;
        }
        let Scaled { ray, shift } = self.scaled(origin, d)?;
        let shear = Shear::along(d);
        // (distance, polygon, cosine) of the nearest hit and of the nearest hit of a front.
        let (mut any, mut front) = ((f64::INFINITY, u32::MAX, 0.0), (f64::INFINITY, u32::MAX, 0.0));
        self.bvh.ray_traverse(ray, &mut RayHit::none(), |_, k| {
            let leaf = &self.leaves[k];
            let (height, slope) = ((origin - leaf.centroid).dot(leaf.normal), d.dot(leaf.normal));
            // On the plane, parallel to it, or leaving it.
            if height.abs() <= leaf.margin || height * slope >= 0.0 || !shear.passes(origin, self.corners(leaf)) {
                return f32::INFINITY;
            }
            let mut t = -height / slope;
            if slope.abs() < 1e-3 {
                // Nearly edge-on the quotient is ill-conditioned; the hit lies between the vertices all the same.
                let along = self.corners(leaf).iter().map(|v| (*v - origin).dot(d));
                let (near, far) = along.fold((f64::INFINITY, 0.0), |(a, b): (f64, f64), s| (a.min(s), b.max(s)));
                t = t.clamp(near.clamp(0.0, far), far);
            }
            let hit = (t, leaf.polygon, slope.abs());
            if height > 0.0 && (hit.0, hit.1) < (front.0, front.1) {
                front = hit;
            }
            if (hit.0, hit.1) < (any.0, any.1) {
                any = hit;
                return self.reach(t, shift);
            }
            f32::INFINITY
        });
        if any.1 == u32::MAX {
            return None;
        }
        // The distance between two planes at the hit, not along the ray: a grazing ray tells them apart no better.
        let facing = front.1 != u32::MAX && (front.0 - any.0) * front.2 <= self.coincident;
        let (distance, polygon, _) = if facing { front } else { any };
        Some(Hit { owner: self.owners[polygon as usize], polygon, distance, front: facing })
    }

    /// Calls `visit` with every polygon whose box overlaps the box [lo, hi] or touches it, in no particular order.
    pub fn overlapping(&self, lo: DVec3, hi: DVec3, visit: &mut dyn FnMut(usize)) {
        if self.is_empty() {
            return;
        }
        let scaled =
            |v: DVec3, pad: f64| ((v - self.centre) * self.scale + pad).clamp(DVec3::splat(-4.0), DVec3::splat(4.0));
        let query = Aabb::new(scaled(lo, -PAD).as_vec3a(), scaled(hi, PAD).as_vec3a());
        let mut state = self.bvh.new_traversal(Vec3A::X);
        let mut node;
        obvhs::traverse!(self.bvh, node, state, node.intersect_aabb(&query, state.oct_inv4), {
            let k = self.leaves[state.primitive_id as usize].polygon as usize;
            let (a, b) = self.polygons[k].bounds();
            if a.cmple(hi).all() && b.cmpge(lo).all() {
                visit(k);
            }
        });
    }
}

/// The pieces of a scene that can block a segment between two points of the scene, with the index of their surface.
///
/// Left out are pieces with all vertices of the scene on one side of their plane or in it (within the margin of
/// [`Occluders::occluded`]): the walls of a convex room. Of an empty convex room nothing is left.
pub fn blocking_polygons(scene: &Scene) -> Vec<(usize, &Polygon)> {
    let vertices: Vec<DVec3> = scene.pieces().flat_map(|(_, p)| p.vertices().iter().copied()).collect();
    let rounding = Occluders::rounding(scene);
    // The extreme vertices of some directions first: they decide for most pieces.
    let mut order: Vec<DVec3> = Vec::new();
    for k in 0..27 {
        let direction = DVec3::new((k % 3) as f64 - 1.0, (k / 3 % 3) as f64 - 1.0, (k / 9) as f64 - 1.0);
        order.extend(vertices.iter().copied().max_by(|a, b| a.dot(direction).total_cmp(&b.dot(direction))));
    }
    order.extend(&vertices);
    let blocks = |p: &Polygon| {
        let margin = rounding + 2.0 * p.thickness();
        let (mut before, mut behind) = (false, false);
        order.iter().any(|v| {
            let d = p.signed_distance(*v);
            before |= d > margin;
            behind |= d < -margin;
            before && behind
        })
    };
    scene.pieces().filter(|(_, p)| blocks(p)).collect()
}

#[cfg(test)]
#[path = "occlusion_tests.rs"]
mod tests;
