//! The parts of two polygons that can see each other's front, in coordinates of their own.

use glam::DVec3;
use radiosity_geometry::Polygon;

/// Two convex loops, each wholly in front of the other's plane, relative to a vertex of the smaller polygon.
///
/// Differences of input coordinates carry no rounding of their own where the polygons are near each other, so a pair
/// far from the origin keeps all the digits that its rounded coordinates hold, and a sliver those of its width.
#[derive(Clone, Debug)]
pub(super) struct FacingPair {
    /// What to add to get scene coordinates back.
    pub origin: DVec3,
    /// First loop, counter-clockwise seen from its front.
    pub i: Vec<DVec3>,
    /// Second loop, likewise.
    pub j: Vec<DVec3>,
    /// Unit normal of the first.
    pub n_i: DVec3,
    /// Unit normal of the second.
    pub n_j: DVec3,
    /// Distance below which rounding decides on which side of a plane a point lies.
    pub slack: f64,
    /// Distance by which corners may miss the planes used (through one corner, hence twice the thickness): rounding of
    /// coordinates far from the origin.
    pub thickness: f64,
    /// Distance along their planes by which corners may be misplaced: those that count as on the other's plane and lie below
    /// it, and those cut there.
    pub misplaced: f64,
}

impl FacingPair {
    /// Clips i by the front half-space of j and j by that of i; `None` if nothing is left of one.
    ///
    /// Points within rounding of a plane count as on it: without that, sheets back to back would see each other across
    /// a gap of one rounding error with F = 1.
    pub fn new(i: &Polygon, j: &Polygon) -> Option<Self> {
        let (p_i, p_j) = (i.vertices()[0], j.vertices()[0]);
        let (n_i, n_j) = (i.normal(), j.normal());
        let (slack, thickness) = slack(i, j);
        let above = |v: &[DVec3], p: DVec3, n: DVec3| v.iter().any(|v| (*v - p).dot(n) > slack);
        if !(above(i.vertices(), p_j, n_j) && above(j.vertices(), p_i, n_i)) {
            return None;
        }
        let origin = if i.area() <= j.area() { p_i } else { p_j };
        let (loop_i, placed_i) = clip(i.vertices(), origin, p_j, n_j, slack)?;
        let (loop_j, placed_j) = clip(j.vertices(), origin, p_i, n_i, slack)?;
        let mut misplaced = placed_i.depth.max(placed_j.depth);
        if placed_i.cut || placed_j.cut {
            // Heights at a cut round with the distance and with the normals, which lose digits for slivers.
            let height = 4.0 * f64::EPSILON * i.diameter().max(j.diameter()) * stretch(i).max(stretch(j));
            misplaced += height + thickness;
        }
        if misplaced > 0.0 {
            // Where planes meet at a small angle, a height moves their common line by as much more.
            misplaced /= n_i.cross(n_j).length().max(f64::EPSILON);
        }
        Some(Self { origin, i: loop_i, j: loop_j, n_i, n_j, slack, thickness, misplaced })
    }

    /// Whether [`Self::new`] gives a pair: without building it where both lie wholly in front of each other, or one behind.
    pub fn faces(i: &Polygon, j: &Polygon) -> bool {
        let (slack, _) = slack(i, j);
        let range = |of: &Polygon, over: &Polygon| {
            let (p, n) = (over.vertices()[0], over.normal());
            let heights = of.vertices().iter().map(|v| (*v - p).dot(n));
            heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)))
        };
        let (above_j, above_i) = (range(i, j), range(j, i));
        if above_j.1 <= slack || above_i.1 <= slack {
            return false;
        }
        let whole = above_j.0 >= 0.0 && above_i.0 >= 0.0;
        let broad = |p: &Polygon| p.edges().all(|(a, b)| a.distance_squared(b) > slack * slack);
        (whole && broad(i) && broad(j)) || Self::new(i, j).is_some()
    }
}

/// Distance below which rounding decides on which side of a plane a point lies, and the part of it that the corners' own distances from
/// their planes make.
fn slack(i: &Polygon, j: &Polygon) -> (f64, f64) {
    let thickness = 2.0 * (i.thickness() + j.thickness());
    (rounding(i.vertices()).max(rounding(j.vertices())) + thickness, thickness)
}

/// Distances that rounding of the coordinates can produce: 8 ε times the largest coordinate.
pub(crate) fn rounding(vertices: &[DVec3]) -> f64 {
    8.0 * f64::EPSILON * vertices.iter().map(|v| v.abs().max_element()).fold(0.0, f64::max)
}

/// Size² / area: 2 for a square, large for slivers.
fn stretch(polygon: &Polygon) -> f64 {
    polygon.diameter().powi(2) / polygon.area()
}

/// How well a clipped loop is placed.
#[derive(Clone, Copy, Debug, Default)]
struct Placed {
    /// How far below the plane corners reach that count as on it.
    depth: f64,
    /// Whether an edge passes the plane.
    cut: bool,
}

/// The part of a loop in front of the plane (point, normal), relative to `origin`.
fn clip(vertices: &[DVec3], origin: DVec3, point: DVec3, normal: DVec3, slack: f64) -> Option<(Vec<DVec3>, Placed)> {
    let mut placed = Placed::default();
    let mut height = |v: DVec3| {
        let h = (v - point).dot(normal);
        if h.abs() > slack {
            return h;
        }
        placed.depth = placed.depth.max(-h);
        0.0
    };
    let mut cut = false;
    let mut kept: Vec<DVec3> = Vec::with_capacity(vertices.len() + 1);
    let mut push = |v: DVec3| {
        // Vertices closer than rounding make an edge without a direction; the loop stays closed without it.
        if kept.last().is_none_or(|last| last.distance_squared(v) > slack * slack) {
            kept.push(v);
        }
    };
    let last = vertices[vertices.len() - 1];
    let (mut a, mut h_a) = (last, height(last));
    for &b in vertices {
        let h_b = height(b);
        if h_a * h_b < 0.0 {
            cut = true;
            // From the upper end in both directions, so that neighbours get the same point.
            let (p, q, t) = if h_a > 0.0 { (a, b, h_a / (h_a - h_b)) } else { (b, a, h_b / (h_b - h_a)) };
            push(p - origin + (q - p) * t);
        }
        if h_b >= 0.0 {
            push(b - origin);
        }
        (a, h_a) = (b, h_b);
    }
    while kept.len() > 1 && kept[0].distance_squared(kept[kept.len() - 1]) <= slack * slack {
        kept.pop();
    }
    placed.cut = cut;
    (kept.len() >= 3).then_some((kept, placed))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(at: DVec3, u: DVec3, v: DVec3) -> Polygon {
        Polygon::new(&[at, at + u, at + u + v, at + v]).unwrap()
    }

    #[test]
    fn sheets_back_to_back_do_not_see_each_other() {
        // Same corners, opposite normals, in a plane on which rounding puts corners on both sides.
        let (at, u, v) = (DVec3::new(0.1, 0.2, 0.3), DVec3::new(0.7, 0.1, 0.3), DVec3::new(-0.2, 0.9, 0.17));
        assert!(FacingPair::new(&square(at, u, v), &square(at, v, u)).is_none());
    }

    #[test]
    fn a_wall_through_the_floor_is_cut_at_the_floor() {
        let floor = square(DVec3::ZERO, DVec3::X, DVec3::Y);
        let wall = square(DVec3::new(0.0, 0.0, -1.0), DVec3::Y, DVec3::Z * 3.0);
        let pair = FacingPair::new(&floor, &wall).unwrap();
        let (lo, hi) = pair.j.iter().fold((f64::MAX, f64::MIN), |(lo, hi), v| (lo.min(v.z), hi.max(v.z)));
        assert_eq!((lo, hi, pair.j.len()), (0.0, 2.0, 4));
    }
}
