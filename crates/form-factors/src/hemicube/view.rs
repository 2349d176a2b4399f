//! What can be seen from a source's centre, before anything is drawn: corners and edge functions in the source's frame,
//! sorted by the faces of the hemicube that they touch.
//!
//! Left out are clusters and polygons below the horizon, polygons whose plane holds the eye, and backs of closed bodies that
//! the eye lies outside of, which are never the first thing that a ray meets.

use glam::DVec3;
use pulp::{Simd, WithSimd};
use radiosity_geometry::Polygon;

use super::clusters::{Cluster, Clusters, Member};
use super::solids::NONE;

/// A source's centre and its frame: u and v in its plane, n its normal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub eye: DVec3,
    axes: [DVec3; 3],
}

impl Frame {
    /// The frame at the centroid of `source`, turned by `turn` about the normal.
    pub fn new(source: &Polygon, turn: f64) -> Self {
        let ((u0, v0), n) = (source.frame(), source.normal());
        let (sin, cos) = turn.sin_cos();
        Self { eye: source.centroid(), axes: [u0 * cos + v0 * sin, v0 * cos - u0 * sin, n] }
    }

    /// A direction in the frame.
    #[inline(always)]
    pub fn turned(&self, d: DVec3) -> DVec3 {
        let along = |axis: DVec3| d.x * axis.x + d.y * axis.y + d.z * axis.z;
        DVec3::new(along(self.axes[0]), along(self.axes[1]), along(self.axes[2]))
    }
}

/// A side of a polygon as seen from the eye.
#[derive(Clone, Copy, Debug)]
pub(super) struct Side {
    pub corner: DVec3,
    /// Edge function: edge·d ≥ 0 on the polygon's side.
    ///
    /// It is ± a × b, and to the last bit the opposite for the neighbour, which runs from b to a.
    pub edge: DVec3,
    /// What rounding may make of the edge function.
    pub slack: f64,
}

/// A polygon that can be seen.
#[derive(Clone, Debug)]
pub(super) struct Seen {
    /// Which polygon of the scene.
    pub polygon: u32,
    pub front: bool,
    pub sides: std::ops::Range<usize>,
    /// n/(n·a): the plane is plane·d = 1/t at the distance t along d.
    pub plane: DVec3,
}

/// Everything that can be seen from one eye.
#[derive(Debug, Default)]
pub(super) struct View {
    pub seen: Vec<Seen>,
    pub sides: Vec<Side>,
    /// Which of `seen` each face of the hemicube may show.
    pub faces: [Vec<u32>; 5],
    /// Corners of the cluster at hand in the frame.
    local: [Vec<f64>; 3],
    outside: Vec<bool>,
}

/// Axes (forward, right, up) of a face: 0 is the top, 1 to 4 are the sides with up along the normal.
#[inline(always)]
pub(super) fn on_face(face: usize, d: DVec3) -> [f64; 3] {
    match face {
        0 => [d.z, d.x, d.y],
        1 => [d.x, d.y, d.z],
        2 => [d.y, -d.x, d.z],
        3 => [-d.x, -d.y, d.z],
        _ => [-d.y, d.x, d.z],
    }
}

/// For the planes z = x, z = −x, z = y, z = −y, x = y and x = −y, which bound the faces' pyramids: bit k says that
/// the point lies on the upper side of plane k, bit 8 + k on the lower; on the plane it lies on both.
#[inline(always)]
fn sides_of_planes(d: DVec3) -> u32 {
    let heights = [d.z - d.x, d.z + d.x, d.z - d.y, d.z + d.y, d.x - d.y, d.x + d.y];
    let bit = |k: usize| u32::from(heights[k] >= 0.0) << k | u32::from(heights[k] <= 0.0) << (8 + k);
    bit(0) | bit(1) | bit(2) | bit(3) | bit(4) | bit(5)
}

/// Sides of the planes that the pyramid of each face lies on: a polygon without a corner on one of them misses the face.
const PYRAMIDS: [u32; 5] =
    [0b00_1111, 0b11_0000 | 0b00_0001 << 8, 0b10_0000 | 0b01_0100 << 8, 0b11_0010 << 8, 0b01_0000 | 0b10_1000 << 8];

/// Looking from a frame at all clusters, compiled for an instruction set.
pub(super) struct Look<'a> {
    pub view: &'a mut View,
    pub frame: &'a Frame,
    pub clusters: &'a Clusters,
}

impl WithSimd for Look<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.view.look(self.frame, self.clusters);
    }
}

impl View {
    /// Looks from `frame` at all clusters.
    #[inline(always)]
    fn look(&mut self, frame: &Frame, clusters: &Clusters) {
        self.seen.clear();
        self.sides.clear();
        self.faces.iter_mut().for_each(Vec::clear);
        clusters.solids.outside(frame.eye, &mut self.outside);
        let reach = frame.eye.abs().max_element();
        for cluster in &clusters.clusters {
            // Coordinates relative to the eye are off by this at most.
            let rounding = 32.0 * f64::EPSILON * reach.max(cluster.reach);
            if frame.turned(cluster.centre - frame.eye).z + cluster.radius <= rounding {
                continue;
            }
            let mut transformed = false;
            for member in &clusters.members[cluster.polygons.clone()] {
                let height = (frame.eye - member.centroid).dot(member.normal);
                let hidden = height < 0.0 && member.body != NONE && self.outside[member.body as usize];
                if hidden || height.abs() <= rounding + 2.0 * member.thickness {
                    continue;
                }
                if !std::mem::replace(&mut transformed, true) {
                    self.transform(frame, clusters, cluster);
                }
                self.add(frame, &clusters.loops[member.loop_.clone()], member, height, (rounding, reach));
            }
        }
    }

    /// Corners of a cluster in the frame.
    #[inline(always)]
    fn transform(&mut self, frame: &Frame, clusters: &Clusters, cluster: &Cluster) {
        let [x, y, z] = [0, 1, 2].map(|axis| &clusters.corners[axis][cluster.corners.clone()]);
        for (local, axis) in self.local.iter_mut().zip(frame.axes) {
            local.clear();
            local.resize(x.len(), 0.0);
            for (((local, x), y), z) in local.iter_mut().zip(x).zip(y).zip(z) {
                *local = (x - frame.eye.x) * axis.x + (y - frame.eye.y) * axis.y + (z - frame.eye.z) * axis.z;
            }
        }
    }

    /// Adds a polygon that has its eye at `height` over its plane, if it is above the horizon and in some face.
    #[inline(always)]
    fn add(&mut self, frame: &Frame, corners: &[u32], member: &Member, height: f64, (rounding, reach): (f64, f64)) {
        let first = self.sides.len();
        let (mut planes, mut top) = (0, f64::NEG_INFINITY);
        let [x, y, z] = &self.local;
        for &place in corners {
            let corner = DVec3::new(x[place as usize], y[place as usize], z[place as usize]);
            planes |= sides_of_planes(corner);
            top = corner.z.max(top);
            self.sides.push(Side { corner, edge: DVec3::ZERO, slack: 0.0 });
        }
        let touches = PYRAMIDS.map(|pyramid| planes & pyramid == pyramid);
        if top <= rounding || touches == [false; 5] {
            self.sides.truncate(first);
            return;
        }
        let front = height > 0.0;
        // Seen from the front inside is where (a × b)·d is negative, since (a × b)·c = n·a · 2·area and n·a = −height.
        edge_functions(&mut self.sides[first..], if front { -1.0 } else { 1.0 }, reach);
        let plane = frame.turned(member.normal) / -height;
        let number = self.seen.len() as u32;
        self.seen.push(Seen { polygon: member.polygon, front, sides: first..self.sides.len(), plane });
        for (face, _) in self.faces.iter_mut().zip(touches).filter(|(_, touches)| *touches) {
            face.push(number);
        }
    }
}

/// Edge functions from the corners, with what rounding may make of them.
#[inline(always)]
fn edge_functions(sides: &mut [Side], sign: f64, reach: f64) {
    let last = sides.len() - 1;
    let mut a = sides[last].corner;
    let mut length_a = a.length();
    for k in 0..=last {
        let b = sides[k].corner;
        let length_b = b.length();
        let side = &mut sides[if k == 0 { last } else { k - 1 }];
        side.edge = a.cross(b) * sign;
        // Coordinates are off by ε · reach, which moves a × b by that times |a| + |b|.
        side.slack = 16.0 * f64::EPSILON * (length_a * length_b + reach * (length_a + length_b));
        (a, length_a) = (b, length_b);
    }
}
