//! Polygons that block, as pairs of nodes see them.
//!
//! All segments between two nodes lie in the convex hull of both. A polygon K is out of their way if the hull lies on one side of
//! K's plane, beyond the plane through one of K's edges along the line of centres, before or behind K along that line, or if K lies behind
//! the plane of a node. It hides them if the nodes are on different sides of its plane and the hull inside all planes of its
//! edges. Both are exact (a node reaches no further than [`Node::reach`] says), and what is out of the way of two nodes is out of the way of their
//! children. What is left is tested segment by segment.

use glam::{DVec3, Vec3};

use super::shaft::Shaft;
use super::tree::{Frame, Node};
use super::walls::Wall;

/// Distance, in units of half the scene, within which points count as lying in a plane: a few times the rounding of single precision.
pub(super) const FLAT: f32 = 1e-6;

/// Rounding of the points of nodes, which are known to single precision, in units of half the scene.
const POINT: f64 = 2e-7;
/// Radius, in units of a node's, from which on a polygon may part the node.
pub(super) const PARTING: f32 = 0.5;

/// A box, by its centre and half its size.
pub(super) struct Bounds {
    pub centre: Vec3,
    pub half: Vec3,
}

impl Bounds {
    pub fn of(points: impl Iterator<Item = Vec3>) -> Self {
        let (lo, hi) = points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
        Self { centre: 0.5 * (lo + hi), half: 0.5 * (hi - lo) }
    }
}

/// A polygon that blocks.
pub(super) struct Screen {
    pub bounds: Bounds,
    normal: Vec3,
    height: f32,
    pub middle: Vec3,
    pub corners: Vec<Vec3>,
    /// The polygon lies no further from its middle.
    radius: f32,
    /// The same of the largest of the polygons that it was joined from.
    pub part: f32,
    /// A point and the normal of the plane, and inward normals m of the edges with m·x on them, for segments.
    point: DVec3,
    exact_normal: DVec3,
    sides: Vec<(DVec3, f64)>,
}

/// What lies between two nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Between {
    /// Nothing.
    Nothing,
    /// A polygon that covers every segment.
    All,
    /// Polygons that may.
    Some(Seen),
}

/// What polygons between two nodes do to either of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Seen {
    /// One about as large as the node passes through it, so that parts of it lie on different sides.
    pub through: [bool; 2],
    /// One is smaller than the node, so that what is seen varies within quarters of it.
    pub finely: [bool; 2],
}

impl Seen {
    pub fn and(self, other: Self) -> Self {
        let or = |a: [bool; 2], b: [bool; 2]| [a[0] || b[0], a[1] || b[1]];
        Self { through: or(self.through, other.through), finely: or(self.finely, other.finely) }
    }
}

impl Screen {
    pub fn new(wall: &Wall, frame: &Frame) -> Self {
        let polygon = &wall.polygon;
        let exact = |v: DVec3| (v - frame.middle) * frame.scale;
        let normal = polygon.normal();
        let side = |(a, b): (DVec3, DVec3)| {
            let inward = normal.cross(b - a).try_normalize()?;
            Some((inward, inward.dot(exact(a))))
        };
        let middle = frame.point(polygon.centroid());
        let corners: Vec<Vec3> = polygon.vertices().iter().map(|v| frame.point(*v)).collect();
        Self {
            bounds: Bounds::of(corners.iter().copied()),
            normal: normal.as_vec3(),
            height: normal.dot(exact(polygon.centroid())) as f32,
            middle,
            radius: corners.iter().map(|v| v.distance(middle)).fold(0.0, f32::max),
            part: (wall.part * frame.scale) as f32,
            corners,
            point: exact(polygon.centroid()),
            exact_normal: normal,
            sides: polygon.edges().filter_map(side).collect(),
        }
    }

    /// Where the polygon is as the nodes of a shaft see it.
    pub fn between(&self, shaft: &Shaft<'_>) -> Between {
        let ([p, q], along, normals) = (shaft.nodes, shaft.along, shaft.normals);
        // Heights of the nodes over the plane.
        let (h_p, h_q) = (self.normal.dot(p.centre) - self.height, self.normal.dot(q.centre) - self.height);
        let (e_p, e_q) = (p.reach(self.normal), q.reach(self.normal));
        let above = h_p - e_p >= -FLAT && h_q - e_q >= -FLAT;
        let below = h_p + e_p <= FLAT && h_q + e_q <= FLAT;
        if above || below {
            return Between::Nothing;
        }
        // Behind a node, or not between the two along their line.
        let through = [self.passes(p, h_p, e_p, normals[0]), self.passes(q, h_q, e_q, normals[1])];
        let some = Between::Some(Seen { through, finely: [p, q].map(|node| self.radius < node.radius) });
        for (k, node) in [p, q].into_iter().enumerate() {
            let Some(n) = normals[k] else { continue };
            let heights = || self.corners.iter().map(|v| (*v - node.centre).dot(n));
            if heights().all(|h| h <= FLAT) {
                // The surface of one node may be what parts the other.
                let parts = through[1 - k] && heights().all(|h| h >= -FLAT);
                return if parts { some } else { Between::Nothing };
            }
        }
        let [a_p, a_q] = shaft.reach_along;
        if self.corners.iter().all(|v| (*v - p.centre).dot(along) <= -a_p)
            || self.corners.iter().all(|v| (*v - p.centre).dot(along) >= shaft.length_squared + a_q)
        {
            return Between::Nothing;
        }
        // Beside an edge, as seen along the line.
        let n = self.corners.len();
        let mut inside = true;
        for (k, &a) in self.corners.iter().enumerate() {
            let edge = self.corners[(k + 1) % n] - a;
            let across = along.cross(edge);
            let size = across.length();
            let depth = across.dot(self.middle - a);
            if depth.abs() <= FLAT * size {
                // Seen edge-on: no side to tell.
                inside = false;
                continue;
            }
            let across = if depth > 0.0 { across } else { -across };
            let (d_p, d_q) = (across.dot(p.centre - a), across.dot(q.centre - a));
            let (r_p, r_q) = (p.reach(across), q.reach(across));
            if d_p + r_p <= -FLAT * size && d_q + r_q <= -FLAT * size {
                return Between::Nothing;
            }
            inside = inside && d_p - r_p >= FLAT * size && d_q - r_q >= FLAT * size;
        }
        let apart = (h_p - e_p > FLAT && h_q + e_q < -FLAT) || (h_p + e_p < -FLAT && h_q - e_q > FLAT);
        if inside && apart {
            return Between::All;
        }
        some
    }

    /// Whether the polygon passes through a node, as far as spheres tell, and its parts are not much smaller than the node: what smaller
    /// things hide is for segments to find.
    fn passes(&self, node: &Node, height: f32, reach: f32, normal: Option<Vec3>) -> bool {
        if self.part < PARTING * node.radius || height.abs() >= reach - FLAT || node.is_leaf() {
            return false;
        }
        let (x, radius) = (node.centre.as_dvec3(), f64::from(node.radius));
        let near = self.sides.iter().all(|(m, at)| m.dot(x) - at > -radius);
        near && normal.is_none_or(|normal| {
            let lowest = self.corners.iter().map(|v| (*v - node.centre).dot(normal)).fold(f32::INFINITY, f32::min);
            lowest <= FLAT
        })
    }

    /// Whether the open segment x y properly crosses the polygon; what passes an edge within rounding is held to meet it. Its ends are lifted off
    /// their surfaces, so that no distance from the plane is too small to count.
    pub fn crosses(&self, x: DVec3, y: DVec3) -> bool {
        let height = |v: DVec3| (v - self.point).dot(self.exact_normal);
        let (d_x, d_y) = (height(x), height(y));
        if d_x * d_y >= 0.0 {
            return false;
        }
        let meet = x + (y - x) * (d_x / (d_x - d_y));
        self.sides.iter().all(|(m, at)| m.dot(meet) - at >= -POINT)
    }
}
