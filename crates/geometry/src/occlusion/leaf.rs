//! Polygons as rays meet them: a quick test of eight that only rejects, and the exact test of one.
//!
//! The exact test is watertight in the sense of Woop, Benthin & Wald (2013): every vertex is sheared to a point (x, y) of
//! the plane across the ray, rounded once and the same for all polygons that share the vertex, and the origin is on the side of
//! an edge that the comparison of two rounded products a_x b_y ≷ a_y b_x gives. Rounding is monotonic, so the
//! comparison is right or a tie; ties count as inside.
//!
//! The quick test does the same in single precision, in the scene scaled to [−1, 1]³. The line passes beside a polygon if the
//! cross products of its edges have either sign beyond the error
//!
//! ```text
//! |Δ(a_x b_y − a_y b_x)| ≤ 4Mδ + 2δ² + 2⁻²² M²
//! ```
//!
//! with δ the error of a sheared coordinate and M the largest of them, which is at most twice the side of a box that holds the
//! outlines of the block, since only lines that meet the box of its polygons come here.

use glam::DVec3;

use super::lanes::{LANES, Lanes, Row};
use crate::{Polygon, polygon::bounds};

/// Error of a sheared coordinate in single precision, the scene scaled to [−1, 1]³ and outlines no further out than 3: of two
/// coordinates of a vertex 2⁻²³ each, of the shear 3 · 2⁻²⁵, of the origin 2⁻²³, of a difference up to 6 2⁻²², of a product
/// 2⁻²³ and of a sum up to 9 2⁻²¹; 43 · 2⁻²⁵ in all.
const SHEARED: f64 = 1.0 / (1 << 19) as f64;

/// Vertices of an outline.
const CORNERS: usize = 4;

/// Rounding of a point computed from scene coordinates, in units of ε times the largest coordinate.
const ROUNDING: f64 = 16.0;

/// How a scene is scaled to [−1, 1]³.
#[derive(Debug)]
pub(super) struct Frame {
    centre: DVec3,
    pub scale: f64,
    /// Rounding of a point computed from scene coordinates.
    pub rounding: f64,
}

impl Frame {
    /// Of a scene in the box [lo, hi]; as it is if the scene is empty.
    pub fn new(lo: DVec3, hi: DVec3) -> Self {
        if !(lo.is_finite() && hi.is_finite()) {
            return Self { centre: DVec3::ZERO, scale: 1.0, rounding: ROUNDING * f64::EPSILON };
        }
        let rounding = ROUNDING * f64::EPSILON * lo.abs().max(hi.abs()).max_element();
        Self { centre: lo * 0.5 + hi * 0.5, scale: ((hi - lo) * 0.5).max_element().recip(), rounding }
    }

    #[inline(always)]
    pub fn scaled(&self, point: DVec3) -> DVec3 {
        (point - self.centre) * self.scale
    }
}

/// A line's projection along itself onto the plane of the two axes it is least parallel to.
#[derive(Clone, Copy)]
pub(super) struct Shear {
    /// The two axes, and the one along which is sheared.
    axes: [usize; 3],
    /// Shears, at most 1 since the axis dropped is the line's largest.
    x: f64,
    y: f64,
}

impl Shear {
    #[inline(always)]
    pub fn along(d: DVec3) -> Self {
        let a = d.abs();
        if a.x >= a.y && a.x >= a.z {
            Self { axes: [1, 2, 0], x: -d.y / d.x, y: -d.z / d.x }
        } else if a.y >= a.z {
            Self { axes: [2, 0, 1], x: -d.z / d.y, y: -d.x / d.y }
        } else {
            Self { axes: [0, 1, 2], x: -d.x / d.z, y: -d.y / d.z }
        }
    }

    /// Whether the line through `p` passes the inside of a loop, by counting the edges that cross the half line
    /// y = 0, x > 0.
    #[inline(always)]
    fn passes(&self, p: DVec3, corners: impl ExactSizeIterator<Item = DVec3> + Clone) -> bool {
        let [i, j, k] = self.axes;
        let project = |v: DVec3| {
            let v = v - p;
            (v[i] + self.x * v[k], v[j] + self.y * v[k])
        };
        let Some((mut ax, mut ay)) = corners.clone().last().map(project) else { return false };
        let mut inside = false;
        for corner in corners {
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

    /// [`Self::passes`] for four corners by axis, the last of which may be repeated.
    #[inline(always)]
    fn passes_four(&self, p: DVec3, corners: &[[f64; CORNERS]; 3]) -> bool {
        let [i, j, k] = self.axes;
        let z: [f64; CORNERS] = std::array::from_fn(|c| corners[k][c] - p[k]);
        let x: [f64; CORNERS] = std::array::from_fn(|c| (corners[i][c] - p[i]) + self.x * z[c]);
        let y: [f64; CORNERS] = std::array::from_fn(|c| (corners[j][c] - p[j]) + self.y * z[c]);
        let (mut inside, mut tie) = (false, false);
        for a in 0..CORNERS {
            let b = (a + 1) % CORNERS;
            let (left, right) = (x[a] * y[b], y[a] * x[b]);
            let crosses = (y[a] > 0.0) != (y[b] > 0.0);
            tie |= crosses & (left == right);
            inside ^= crosses & ((left > right) == (y[b] > 0.0));
        }
        inside | tie
    }
}

/// A polygon, as the exact test reads it.
///
/// What tells on which side of the plane a point is fills one line of the cache.
#[derive(Debug)]
#[repr(C, align(64))]
pub(super) struct Leaf {
    pub centroid: DVec3,
    pub normal: DVec3,
    /// A plane no further away contains the point: rounding plus twice the thickness.
    pub margin: f64,
    pub polygon: u32,
    /// Whether there are more than four vertices.
    many: bool,
    /// Up to four vertices by axis, the last repeated; unused if there are more.
    corners: [[f64; CORNERS]; 3],
}

impl Leaf {
    pub fn new(p: &Polygon, polygon: u32, rounding: f64) -> Self {
        let vertex = |c: usize| p.vertices()[c.min(p.vertices().len() - 1)];
        Self {
            corners: std::array::from_fn(|axis| std::array::from_fn(|c| vertex(c)[axis])),
            centroid: p.centroid(),
            normal: p.normal(),
            margin: rounding + 2.0 * p.thickness(),
            polygon,
            many: p.vertices().len() > CORNERS,
        }
    }

    /// Whether the line through `p` passes the inside.
    #[inline(always)]
    pub fn passed(&self, shear: &Shear, p: DVec3, polygons: &[Polygon]) -> bool {
        if self.many {
            return shear.passes(p, polygons[self.polygon as usize].vertices().iter().copied());
        }
        shear.passes_four(p, &self.corners)
    }
}

/// Four points around a polygon, in order: its vertices, the last repeated, or of more than four a rectangle in its plane.
fn outline(p: &Polygon) -> [DVec3; CORNERS] {
    let vertices = p.vertices();
    if vertices.len() <= CORNERS {
        return std::array::from_fn(|c| vertices[c.min(vertices.len() - 1)]);
    }
    let ((x, y), centre) = (p.frame(), p.centroid());
    let within = vertices.iter().map(|v| DVec3::new((*v - centre).dot(x), (*v - centre).dot(y), 0.0));
    let (lo, hi) = bounds(within);
    [(lo.x, lo.y), (hi.x, lo.y), (hi.x, hi.y), (lo.x, hi.y)].map(|(u, v)| centre + x * u + y * v)
}

/// Up to eight polygons of C vertices at most, for the quick test.
#[derive(Debug)]
#[repr(C)]
pub(super) struct Block<const C: usize> {
    /// Error of a cross product.
    error: f32,
    /// The first of its polygons among the leaves.
    first: u32,
    /// A bit for each polygon.
    members: u32,
    /// Vertices of outlines by axis, scaled.
    corners: [[Row; 3]; C],
}

impl<const C: usize> Block<C> {
    /// A block of polygons whose leaves begin at `first`.
    pub fn new(members: &[&Polygon], first: u32, frame: &Frame) -> Self {
        let outlines: Vec<[DVec3; CORNERS]> = members.iter().map(|p| outline(p)).collect();
        let mut corners = [[Row([0.0; LANES]); 3]; C];
        for (lane, outline) in outlines.iter().enumerate() {
            for (corner, vertex) in corners.iter_mut().zip(outline) {
                let vertex = frame.scaled(*vertex);
                for (axis, row) in corner.iter_mut().enumerate() {
                    row.0[lane] = vertex[axis] as f32;
                }
            }
        }
        let (lo, hi) = bounds(outlines.iter().flatten().copied());
        let thickness = members.iter().map(|p| p.thickness()).fold(0.0, f64::max);
        // Vertices off the plane of a polygon move its outline by up to twice that.
        let delta = SHEARED + (frame.rounding + 4.0 * thickness) * frame.scale;
        let largest = 2.0 * ((hi - lo).max_element() * frame.scale + 1e-4);
        let error = 4.0 * largest * delta + 2.0 * delta * delta + largest * largest / f64::from(1 << 22);
        Self { corners, error: (error * (1.0 + 1e-6)) as f32, first, members: (1 << members.len()) - 1 }
    }

    /// Its polygons among the leaves.
    pub fn leaves(&self) -> std::ops::Range<usize> {
        self.first as usize..(self.first + self.members.count_ones()) as usize
    }

    /// A bit for every polygon that the line does not clearly pass beside, and the leaf of the first.
    #[inline(always)]
    pub fn candidates<L: Lanes>(&self, lanes: L, line: &Line<L>) -> (u32, usize) {
        let [i, j, k] = line.axes;
        let (mut x, mut y) = ([line.origin[0]; C], [line.origin[1]; C]);
        for c in 0..C {
            let corner = &self.corners[c];
            let z = lanes.load(&corner[k]);
            x[c] = lanes.mul_add(line.shear[0], z, lanes.sub(lanes.load(&corner[i]), x[c]));
            y[c] = lanes.mul_add(line.shear[1], z, lanes.sub(lanes.load(&corner[j]), y[c]));
        }
        let mut least = lanes.splat(f32::INFINITY);
        let mut most = lanes.splat(f32::NEG_INFINITY);
        for a in 0..C {
            let b = (a + 1) % C;
            let side = lanes.sub(lanes.mul(x[a], y[b]), lanes.mul(y[a], x[b]));
            (least, most) = (lanes.min(least, side), lanes.max(most, side));
        }
        let (below, above) = (lanes.splat(-self.error), lanes.splat(self.error));
        let beside = lanes.at_most(least, below) & lanes.at_most(above, most);
        (self.members & !beside, self.first as usize)
    }
}

/// A line for the quick test.
pub(super) struct Line<L: Lanes> {
    axes: [usize; 3],
    shear: [L::Floats; 2],
    /// The origin, sheared.
    origin: [L::Floats; 2],
}

impl<L: Lanes> Line<L> {
    /// The line through the scaled point `o`.
    #[inline(always)]
    pub fn new(lanes: L, shear: &Shear, o: DVec3) -> Self {
        let [i, j, k] = shear.axes;
        let splat = |x: f64| lanes.splat(x as f32);
        Self {
            axes: shear.axes,
            shear: [splat(shear.x), splat(shear.y)],
            origin: [splat(o[i] + shear.x * o[k]), splat(o[j] + shear.y * o[k])],
        }
    }
}
