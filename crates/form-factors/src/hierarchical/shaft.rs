//! What may stand between two nodes, narrowed from pair to pair on the way down.
//!
//! All segments between two nodes lie in the convex hull of both. A polygon K is out of their way if the hull lies on one side of
//! K's plane, beyond the plane through one of K's edges along the line of centres, before or behind K along that line, or if K lies behind
//! the plane of a node. It hides them if the nodes are on different sides of its plane and the hull inside all planes of its
//! edges. Both are exact (a node reaches no further than [`Node::reach`] says), and what is out of the way of two nodes is out of the way of their
//! children. What is left is tested segment by segment.

use glam::{DVec3, Vec3};
use radiosity_geometry::Occluders;

use super::tree::{Hierarchy, Node};

/// Distance, in units of half the scene, within which points count as lying in a plane: a few times the rounding of single precision.
pub(super) const FLAT: f32 = 1e-6;

/// Blockers up to which a search begins with all of them; beyond, the box of the pair picks those to begin with.
const FEW: usize = 256;

/// Polygons that block, as shafts see them.
pub(super) struct Screens<'a> {
    occluders: &'a Occluders,
    screens: Vec<Screen>,
}

struct Screen {
    normal: Vec3,
    height: f32,
    middle: Vec3,
    corners: Vec<Vec3>,
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
    /// Polygons that may; `through[k]` if one of them passes through node k, so that parts of it lie on different sides.
    Some { through: [bool; 2] },
}

impl<'a> Screens<'a> {
    pub fn new(hierarchy: &Hierarchy, occluders: &'a Occluders) -> Self {
        let frame = hierarchy.frame;
        let screen = |polygon: &radiosity_geometry::Polygon| {
            let exact = |v: DVec3| (v - frame.middle) * frame.scale;
            let normal = polygon.normal();
            let side = |(a, b): (DVec3, DVec3)| {
                let inward = normal.cross(b - a).try_normalize()?;
                Some((inward, inward.dot(exact(a))))
            };
            let middle = frame.point(polygon.centroid());
            Screen {
                normal: normal.as_vec3(),
                height: normal.dot(exact(polygon.centroid())) as f32,
                middle,
                corners: polygon.vertices().iter().map(|v| frame.point(*v)).collect(),
                point: exact(polygon.centroid()),
                exact_normal: normal,
                sides: polygon.edges().filter_map(side).collect(),
            }
        };
        Self { occluders, screens: occluders.polygons().iter().map(screen).collect() }
    }

    /// Blockers to begin a search with for two nodes.
    pub fn around(&self, hierarchy: &Hierarchy, p: &Node, q: &Node) -> Vec<u32> {
        if self.screens.len() <= FEW {
            return (0..self.screens.len() as u32).collect();
        }
        let frame = hierarchy.frame;
        let corner = |node: &Node, side: f32| {
            (node.centre + side * (node.radius + FLAT)).as_dvec3() / frame.scale + frame.middle
        };
        let (lo, hi) = (corner(p, -1.0).min(corner(q, -1.0)), corner(p, 1.0).max(corner(q, 1.0)));
        let mut found = Vec::new();
        self.occluders.overlapping(lo, hi, &mut |k| found.push(k as u32));
        // Traversal has no order of its own.
        found.sort_unstable();
        found
    }

    /// Those of the blockers given that may stand between two nodes, appended to `found`.
    pub fn narrow(
        &self,
        hierarchy: &Hierarchy,
        (p, q): (&Node, &Node),
        given: impl Iterator<Item = u32>,
        mut found: impl FnMut(u32),
    ) -> Between {
        let (along, mut any, mut through) = (q.centre - p.centre, false, [false; 2]);
        let normals = [p, q].map(|n| (!n.is_cluster()).then(|| hierarchy.normals[n.plane as usize]));
        for k in given {
            match self.screens[k as usize].between((p, q), along, normals) {
                Between::Nothing => {}
                Between::All => return Between::All,
                Between::Some { through: also } => {
                    any = true;
                    through = [through[0] || also[0], through[1] || also[1]];
                    found(k);
                }
            }
        }
        if any { Between::Some { through } } else { Between::Nothing }
    }

    /// Whether one of the blockers given properly crosses the segment x y.
    pub fn blocked(&self, given: &[u32], x: Vec3, y: Vec3) -> bool {
        let (x, y) = (x.as_dvec3(), y.as_dvec3());
        given.iter().any(|&k| self.screens[k as usize].crosses(x, y))
    }
}

impl Screen {
    fn between(&self, (p, q): (&Node, &Node), along: Vec3, normals: [Option<Vec3>; 2]) -> Between {
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
        for (k, node) in [p, q].into_iter().enumerate() {
            let Some(n) = normals[k] else { continue };
            let heights = || self.corners.iter().map(|v| (*v - node.centre).dot(n));
            if heights().all(|h| h <= FLAT) {
                // The surface of one node may be what parts the other.
                let parts = through[1 - k] && heights().all(|h| h >= -FLAT);
                return if parts { Between::Some { through } } else { Between::Nothing };
            }
        }
        let (a_p, a_q, length) = (p.reach(along), q.reach(along), along.length_squared());
        if self.corners.iter().all(|v| (*v - p.centre).dot(along) <= -a_p)
            || self.corners.iter().all(|v| (*v - p.centre).dot(along) >= length + a_q)
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
        Between::Some { through }
    }

    /// Whether the polygon passes through a node of one plane, as far as spheres tell.
    fn passes(&self, node: &Node, height: f32, reach: f32, normal: Option<Vec3>) -> bool {
        let Some(normal) = normal else { return false };
        if height.abs() >= reach - FLAT || node.is_leaf() {
            return false;
        }
        let (x, radius) = (node.centre.as_dvec3(), f64::from(node.radius));
        let near = self.sides.iter().all(|(m, at)| m.dot(x) - at > -radius);
        let lowest = self.corners.iter().map(|v| (*v - node.centre).dot(normal)).fold(f32::INFINITY, f32::min);
        near && lowest <= FLAT
    }

    /// Whether the open segment x y properly crosses the polygon; what passes an edge within rounding is held to meet it. Nodes in the
    /// polygon's plane have been sorted out before, so that no distance from the plane is too small to count.
    fn crosses(&self, x: DVec3, y: DVec3) -> bool {
        let height = |v: DVec3| (v - self.point).dot(self.exact_normal);
        let (d_x, d_y) = (height(x), height(y));
        if d_x * d_y >= 0.0 {
            return false;
        }
        let meet = x + (y - x) * (d_x / (d_x - d_y));
        self.sides.iter().all(|(m, at)| m.dot(meet) - at >= -1e-12)
    }
}
