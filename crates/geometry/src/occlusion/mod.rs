//! What blocks: occlusion of segments and the first polygon along a ray.
//!
//! A hierarchy of single precision over boxes rounded outward proposes polygons (`hierarchy.rs`, `descent.rs`); a quick test of
//! eight of them rejects what the ray clearly passes beside, and the rest are tested in double precision (`leaf.rs`). The last test is
//! watertight: a segment through an edge or vertex that neighbours share bit for bit is blocked by one of them at least.
//!
//! Boxes and the quick test take eight numbers at once, with the instruction set found at run time (`lanes.rs`). They decide
//! nothing, so that answers do not depend on it.
//!
//! Rays that leave one polygon in a scene of few polygons go through all of those, many rays at once (`outlook.rs`). Where polygons are
//! cut into many facets, hits are found on the polygons, and the facet from the place of the hit (`cells.rs`).
//!
//! What is *not* here: which side of a polygon receives light, and anything about materials.

mod blocking;
mod cells;
mod descent;
mod hierarchy;
mod lanes;
mod leaf;
mod outlook;

use glam::DVec3;
use obvhs::aabb::Aabb;

use self::blocking::blocking_polygons_among;
pub use self::blocking::{Ends, blocking_polygons};
use self::cells::Cells;
use self::descent::{Slabs, Space, descend_in_order, descend_until};
use self::hierarchy::{Hierarchy, OutwardBox, Place};
use self::lanes::{Lanes, Level, Work};
use self::leaf::{Block, Frame, Leaf, Line, Shear};
pub use self::outlook::{BUNDLE, Bundle, Outlook};
use self::outlook::{Flat, flats};
use crate::{Facets, Polygon, Scene, polygon::bounds};

/// Boxes grow by this on all sides, the scene scaled to [−1, 1]³. Rounding of a ray (origin, direction, the clamp of its
/// inverse at 2⁻²⁴ over a path of 2√3), of the planes and of the box test moves them apart by at most 1.2e-6.
const PAD: f64 = 1.0 / (1 << 18) as f64;

/// The first polygon along a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Owner of the polygon: its surface, or its group of facets; the facet in which the hit lies with [`Occluders::of_parts`].
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
    hierarchy: Hierarchy,
    /// Blocks of triangles, and of all other polygons.
    triangles: Vec<Block<3>>,
    others: Vec<Block<4>>,
    /// In the order of the blocks.
    leaves: Vec<Leaf>,
    frame: Frame,
    /// A front hit no further behind the nearest hit than this, measured across its plane, counts as equally near.
    coincident: f64,
    level: Level,
    /// The facets that the polygons are cut into, if hits belong to those.
    cells: Option<Cells>,
    /// What is needed to go through all polygons, if they are few.
    flats: Option<Vec<Flat>>,
    /// The leaf of every polygon then.
    flat_leaves: Vec<u32>,
}

/// The owner of what belongs to no facet.
const NOBODY: u32 = u32::MAX;

/// Where a ray begins in the scaled scene: distance s along it is t · scale − skipped.
struct Start {
    point: DVec3,
    skipped: f64,
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
        let frame = Frame::new(lo, hi);
        let outward = |p: &Polygon| {
            let (lo, hi) = p.bounds();
            OutwardBox(Aabb::new((frame.scaled(lo) - PAD).as_vec3a(), (frame.scaled(hi) + PAD).as_vec3a()))
        };
        let boxes: Vec<OutwardBox> = polygons.iter().map(outward).collect();
        let (hierarchy, members) = Hierarchy::new(&boxes, |k| polygons[k as usize].vertices().len() == 3);
        let all = members.triangles.iter().chain(&members.polygons).flatten();
        let leaves = all.map(|&k| Leaf::new(&polygons[k as usize], k, frame.rounding)).collect();
        let mut first = 0;
        let triangles = blocks(&polygons, &members.triangles, &mut first, &frame);
        let others = blocks(&polygons, &members.polygons, &mut first, &frame);
        let coincident = frame.rounding + if polygons.is_empty() { 0.0 } else { 1e-12 * (hi - lo).length() };
        let (level, flats) = (Level::best(), flats(&polygons));
        let mut flat_leaves = vec![0; if flats.is_some() { polygons.len() } else { 0 }];
        if flats.is_some() {
            (0..).zip(&leaves).for_each(|(k, leaf): (u32, &Leaf)| flat_leaves[leaf.polygon as usize] = k);
        }
        let cells = None;
        Self {
            polygons,
            owners,
            hierarchy,
            triangles,
            others,
            leaves,
            frame,
            coincident,
            level,
            cells,
            flats,
            flat_leaves,
        }
    }

    /// All pieces of a scene, cut into `facets`: a hit is owned by the facet in which it lies, or by `u32::MAX` where there is none.
    ///
    /// `carriers` names for every polygon of `facets`, in order, the piece ([`Scene::pieces`]) of which it is a part.
    ///
    /// # Panics
    ///
    /// If there is not one carrier a polygon, or no such piece.
    pub fn of_parts(scene: &Scene, facets: &Facets, carriers: &[u32]) -> Self {
        let mut occluders = Self::of_scene(scene);
        occluders.cells = Some(Cells::new(&occluders.polygons, facets, carriers));
        occluders
    }

    /// The owner of a point of a polygon.
    fn owner_at(&self, polygon: u32, point: DVec3) -> u32 {
        match &self.cells {
            Some(cells) => cells.owner(polygon as usize, point),
            None => self.owners[polygon as usize],
        }
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
        Self::blocking_among(scene, &|_| true)
    }

    /// [`Self::blocking`] for segments between points of the surfaces that `picked` names.
    pub fn blocking_among(scene: &Scene, picked: &dyn Fn(usize) -> bool) -> Self {
        let blocking = blocking_polygons_among(scene, picked).into_iter();
        let (owners, polygons) = blocking.map(|(s, p)| (s as u32, p.clone())).unzip();
        Self::new(polygons, owners)
    }

    /// Distance within which rounding moves a point computed from the coordinates of a scene: 16 ε times the largest.
    pub fn rounding(scene: &Scene) -> f64 {
        let (lo, hi) = scene.bounds();
        Frame::new(lo, hi).rounding
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

    /// Where the ray from `origin` along the unit vector `d` begins: at the scene's box if it begins outside; `None` if it
    /// misses the box.
    #[inline(always)]
    fn start(&self, origin: DVec3, d: DVec3) -> Option<Start> {
        let o = self.frame.scaled(origin);
        if o.abs().max_element() <= 1.5 {
            return Some(Start { point: o, skipped: 0.0 });
        }
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
        (enter <= leave).then(|| Start { point: o + d * enter, skipped: enter })
    }

    /// Single-precision distance along a scaled ray, rounded up.
    #[inline(always)]
    fn reach(&self, t: f64, skipped: f64) -> f32 {
        ((t * self.frame.scale - skipped) * (1.0 + 1e-6) + PAD) as f32
    }

    /// Whether a polygon properly crosses the open segment p q.
    ///
    /// A polygon whose plane contains an end point does not block: one no further from it than 16 ε times the scene's
    /// largest coordinate plus twice the polygon's thickness. Swapping p and q changes nothing.
    pub fn occluded(&self, p: DVec3, q: DVec3) -> bool {
        let mut blocked = [false];
        self.occluded_many(&[(p, q)], &mut blocked);
        blocked[0]
    }

    /// [`Self::occluded`] of many segments.
    ///
    /// # Panics
    ///
    /// If the lists differ in length.
    pub fn occluded_many(&self, segments: &[(DVec3, DVec3)], blocked: &mut [bool]) {
        assert_eq!(segments.len(), blocked.len(), "{} segments, {} answers", segments.len(), blocked.len());
        self.level.run(Segments { occluders: self, segments, blocked });
    }

    /// The first polygon along a ray of any direction but 0.
    ///
    /// Polygons whose plane contains the origin (as in [`Self::occluded`]) are not hit. Where a front and a back face
    /// coincide the one whose front faces the ray wins; among equals the smaller index, so that the answer does not depend on
    /// the order of traversal.
    pub fn first_hit(&self, origin: DVec3, direction: DVec3) -> Option<Hit> {
        let mut hit = [None];
        self.first_hits(&[(origin, direction)], &mut hit);
        hit[0]
    }

    /// [`Self::first_hit`] along many rays, each an origin and a direction.
    ///
    /// # Panics
    ///
    /// If the lists differ in length.
    pub fn first_hits(&self, rays: &[(DVec3, DVec3)], hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), hits.len(), "{} rays, {} hits", rays.len(), hits.len());
        self.level.run(Rays { occluders: self, rays, hits });
    }

    /// Calls `visit` with every polygon whose box overlaps the box [lo, hi] or touches it, in no particular order.
    pub fn overlapping(&self, lo: DVec3, hi: DVec3, visit: &mut dyn FnMut(usize)) {
        if self.is_empty() {
            return;
        }
        let scaled = |v: DVec3, pad: f64| {
            let v = (self.frame.scaled(v) + pad).clamp(DVec3::splat(-4.0), DVec3::splat(4.0));
            v.as_vec3().to_array()
        };
        let (least, most) = (scaled(lo, -PAD), scaled(hi, PAD));
        self.hierarchy.overlapping(least, most, &mut |place| {
            let leaves = match place {
                Place::Triangles(index) => self.triangles[index].leaves(),
                Place::Polygons(index) => self.others[index].leaves(),
            };
            for leaf in &self.leaves[leaves] {
                let (a, b) = self.polygons[leaf.polygon as usize].bounds();
                if a.cmple(hi).all() && b.cmpge(lo).all() {
                    visit(leaf.polygon as usize);
                }
            }
        });
    }

    /// A bit for every polygon of a block that the line does not clearly pass beside, and the leaf of the first.
    #[inline(always)]
    fn candidates<L: Lanes>(&self, lanes: L, place: Place, line: &Line<L>) -> (u32, usize) {
        match place {
            Place::Triangles(index) => self.triangles[index].candidates(lanes, line),
            Place::Polygons(index) => self.others[index].candidates(lanes, line),
        }
    }

    #[inline(always)]
    fn is_blocked<L: Lanes>(&self, lanes: L, space: &mut Space, p: DVec3, q: DVec3) -> bool {
        // One order of the end points, so that both directions round alike.
        let swap = (q.x, q.y, q.z) < (p.x, p.y, p.z);
        let (p, q) = if swap { (q, p) } else { (p, q) };
        let length = (q - p).length();
        if !(length > 0.0 && length.is_finite()) {
            return false;
        }
        let d = (q - p) / length;
        let Some(Start { point, skipped }) = self.start(p, d) else { return false };
        let shear = Shear::along(d);
        let line = Line::new(lanes, &shear, point);
        let slabs = Slabs::new(lanes, point, d);
        descend_until(lanes, &self.hierarchy, space, &slabs, self.reach(length, skipped), |place| {
            let (mut candidates, first) = self.candidates(lanes, place, &line);
            while candidates != 0 {
                let leaf = &self.leaves[first + candidates.trailing_zeros() as usize];
                candidates &= candidates - 1;
                let (dp, dq) = ((p - leaf.centroid).dot(leaf.normal), (q - leaf.centroid).dot(leaf.normal));
                let crosses = dp.abs() > leaf.margin && dq.abs() > leaf.margin && (dp > 0.0) != (dq > 0.0);
                if crosses && leaf.passed(&shear, p, &self.polygons) {
                    return true;
                }
            }
            false
        })
    }

    #[inline(always)]
    fn nearest<L: Lanes>(&self, lanes: L, space: &mut Space, origin: DVec3, direction: DVec3) -> Option<Hit> {
        let d = direction.try_normalize()?;
        if !origin.is_finite() {
            return None;
        }
        let Start { point, skipped } = self.start(origin, d)?;
        let shear = Shear::along(d);
        let line = Line::new(lanes, &shear, point);
        let slabs = Slabs::new(lanes, point, d);
        let mut found = Nearest::default();
        descend_in_order(lanes, &self.hierarchy, space, &slabs, f32::INFINITY, |place| {
            let (mut candidates, first) = self.candidates(lanes, place, &line);
            let before = found.any.0;
            while candidates != 0 {
                let leaf = &self.leaves[first + candidates.trailing_zeros() as usize];
                candidates &= candidates - 1;
                let (height, slope) = ((origin - leaf.centroid).dot(leaf.normal), d.dot(leaf.normal));
                // Not on the plane, nor parallel to it or leaving it.
                let towards = height.abs() > leaf.margin && height * slope < 0.0;
                if towards && leaf.passed(&shear, origin, &self.polygons) {
                    let t = self.distance(leaf, origin, d, height, slope);
                    found.add(t, leaf.polygon, height > 0.0, slope.abs());
                }
            }
            if found.any.0 < before { self.reach(found.any.0, skipped) } else { f32::INFINITY }
        });
        found.hit(self.coincident).map(|(distance, polygon, front)| {
            let owner = self.owner_at(polygon, origin + d * distance);
            Hit { owner, polygon, distance, front }
        })
    }

    /// Distance along the unit vector d to a polygon that it passes.
    #[inline(always)]
    fn distance(&self, leaf: &Leaf, origin: DVec3, d: DVec3, height: f64, slope: f64) -> f64 {
        let t = -height / slope;
        if slope.abs() >= 1e-3 {
            return t;
        }
        // Nearly edge-on the quotient is ill-conditioned; the hit lies between the vertices all the same.
        let along = self.polygons[leaf.polygon as usize].vertices().iter().map(|v| (*v - origin).dot(d));
        let (near, far) = along.fold((f64::INFINITY, 0.0), |(a, b): (f64, f64), s| (a.min(s), b.max(s)));
        t.clamp(near.clamp(0.0, far), far)
    }
}

/// Blocks of the given polygons, whose leaves begin at `first`.
fn blocks<const C: usize>(polygons: &[Polygon], members: &[Vec<u32>], first: &mut u32, frame: &Frame) -> Vec<Block<C>> {
    let block = |members: &Vec<u32>| {
        let begin = *first;
        *first += members.len() as u32;
        let members: Vec<&Polygon> = members.iter().map(|&k| &polygons[k as usize]).collect();
        Block::new(&members, begin, frame)
    };
    members.iter().map(block).collect()
}

/// The nearest hit, and the nearest of a front: distance, polygon and cosine.
struct Nearest {
    any: (f64, u32, f64),
    front: (f64, u32, f64),
}

impl Default for Nearest {
    fn default() -> Self {
        let none = (f64::INFINITY, u32::MAX, 0.0);
        Self { any: none, front: none }
    }
}

impl Nearest {
    #[inline(always)]
    fn add(&mut self, t: f64, polygon: u32, front: bool, cosine: f64) {
        if front && (t, polygon) < (self.front.0, self.front.1) {
            self.front = (t, polygon, cosine);
        }
        if (t, polygon) < (self.any.0, self.any.1) {
            self.any = (t, polygon, cosine);
        }
    }

    /// Distance, polygon and whether its front is met.
    #[inline(always)]
    fn hit(&self, coincident: f64) -> Option<(f64, u32, bool)> {
        if self.any.1 == u32::MAX {
            return None;
        }
        // The distance between two planes at the hit, not along the ray: a grazing ray tells them apart no better.
        let facing = self.front.1 != u32::MAX && (self.front.0 - self.any.0) * self.front.2 <= coincident;
        let (distance, polygon, _) = if facing { self.front } else { self.any };
        Some((distance, polygon, facing))
    }
}

/// Rays to be followed with one instruction set.
struct Rays<'a> {
    occluders: &'a Occluders,
    rays: &'a [(DVec3, DVec3)],
    hits: &'a mut [Option<Hit>],
}

impl Work for Rays<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        if self.occluders.is_empty() {
            return self.hits.fill(None);
        }
        let mut space = Space::of(&self.occluders.hierarchy);
        for (hit, &(origin, direction)) in self.hits.iter_mut().zip(self.rays) {
            *hit = self.occluders.nearest(lanes, &mut space, origin, direction);
        }
    }
}

/// Segments to be tested with one instruction set.
struct Segments<'a> {
    occluders: &'a Occluders,
    segments: &'a [(DVec3, DVec3)],
    blocked: &'a mut [bool],
}

impl Work for Segments<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        if self.occluders.is_empty() {
            return self.blocked.fill(false);
        }
        let mut space = Space::of(&self.occluders.hierarchy);
        for (blocked, &(p, q)) in self.blocked.iter_mut().zip(self.segments) {
            *blocked = self.occluders.is_blocked(lanes, &mut space, p, q);
        }
    }
}

#[cfg(test)]
mod tests;
