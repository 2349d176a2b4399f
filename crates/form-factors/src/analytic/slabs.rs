//! Polygons cut across their longest edge: cells for quadrature that suit slivers.

use glam::DVec3;

/// The part of a convex polygon between two lines across its longest edge: x(s, t) = x₀ + s u + t v + s t w over [0, 1]², with s
/// along the edge and t across.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    x0: DVec3,
    /// u and v.
    along: [DVec3; 2],
    w: DVec3,
    /// Area per ds dt at s = 0 and 1.
    ends: [f64; 2],
}

impl Cell {
    pub fn at(&self, s: f64, t: f64) -> DVec3 {
        self.x0 + self.along[0] * s + self.along[1] * t + self.w * (s * t)
    }

    /// Area per ds dt; it does not depend on t.
    pub fn jacobian(&self, s: f64) -> f64 {
        self.ends[0] * (1.0 - s) + self.ends[1] * s
    }

    /// Ends of the line with the other coordinate at `across`, along `direction` (0 for s, 1 for t) from 0 to 1.
    pub fn line(&self, direction: usize, across: f64) -> (DVec3, DVec3) {
        let from = self.x0 + self.along[1 - direction] * across;
        (from, from + self.along[direction] + self.w * across)
    }
}

/// Cells of a convex loop with unit normal `n`, relative to a point near it; their areas keep all digits of a sliver's width.
pub(super) fn cells(corners: &[DVec3], n: DVec3) -> Vec<Cell> {
    let edge = |k: usize| corners[(k + 1) % corners.len()] - corners[k];
    let longest = (0..corners.len()).map(edge).fold(DVec3::ZERO, |a, b| if b.length() > a.length() { b } else { a });
    let Some(d) = longest.try_normalize() else { return Vec::new() };
    let levels = levels(corners, n, d);
    let between = |pair: &[Level]| {
        let [lo, hi] = [&pair[0], &pair[1]];
        let (u, v) = (hi.ends[0] - lo.ends[0], lo.ends[1] - lo.ends[0]);
        let w = (hi.ends[1] - hi.ends[0]) - v;
        Cell { x0: lo.ends[0], along: [u, v], w, ends: [lo.width, hi.width].map(|width| width * (hi.x - lo.x)) }
    };
    levels.windows(2).map(between).collect()
}

/// A line across the polygon through one of its corners.
#[derive(Clone, Copy, Debug)]
struct Level {
    /// Place along d.
    x: f64,
    /// Right and left border, seen along d from the front.
    ends: [DVec3; 2],
    width: f64,
}

/// Lines across through all corners, in order along d.
fn levels(corners: &[DVec3], n: DVec3, d: DVec3) -> Vec<Level> {
    let place = |v: DVec3| (v - corners[0]).dot(d);
    let mut places: Vec<f64> = corners.iter().map(|v| place(*v)).collect();
    places.sort_unstable_by(f64::total_cmp);
    // Corners that are level to rounding share a line.
    let same = 8.0 * f64::EPSILON * (places[places.len() - 1] - places[0]);
    places.dedup_by(|a, b| *a - *b <= same);
    let across = n.cross(d);
    let level = |x: f64| {
        let on: Vec<DVec3> = corners.iter().copied().filter(|v| (place(*v) - x).abs() <= same).collect();
        let (first, last) = (on[0], on[on.len() - 1]);
        let mut pair = [first, last];
        let mut width = (last - first).dot(across).abs();
        // One corner: the other end lies on an edge that passes the level.
        let passes = |k: &usize| {
            let (a, b) = (place(corners[*k]), place(corners[(k + 1) % corners.len()]));
            a.min(b) < x - same && a.max(b) > x + same
        };
        if let Some(k) = (0..corners.len()).find(passes) {
            let (p, along) = (corners[k], corners[(k + 1) % corners.len()] - corners[k]);
            pair[1] = p + along * ((x - place(p)) / along.dot(d));
            width = (n.dot(cross(along, first - p)) / along.dot(d)).abs();
        }
        if (pair[1] - pair[0]).dot(across) < 0.0 {
            pair.swap(0, 1);
        }
        Level { x, ends: pair, width }
    };
    places.iter().map(|x| level(*x)).collect()
}

/// a × b, every component to full relative accuracy: the area of a sliver is a difference of nearly equal products.
fn cross(a: DVec3, b: DVec3) -> DVec3 {
    let difference = |a: f64, b: f64, c: f64, d: f64| {
        let cd = c * d;
        a.mul_add(b, -cd) - c.mul_add(d, -cd)
    };
    DVec3::new(difference(a.y, b.z, a.z, b.y), difference(a.z, b.x, a.x, b.z), difference(a.x, b.y, a.y, b.x))
}

/// Area vector of a loop, to full relative accuracy for slivers too.
pub(super) fn area_vector(corners: &[DVec3]) -> DVec3 {
    corners.windows(2).map(|pair| cross(pair[0] - corners[0], pair[1] - corners[0])).sum::<DVec3>() * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area_of(corners: &[DVec3]) -> (f64, usize) {
        let cells = cells(corners, area_vector(corners).normalize());
        (cells.iter().map(|cell| 0.5 * (cell.ends[0] + cell.ends[1])).sum(), cells.len())
    }

    #[test]
    fn cells_cover_a_polygon() {
        let at = |k: i32| {
            let (y, x) = (f64::from(k) * 0.9).sin_cos();
            DVec3::new(x, 2.0 * y, 0.3 * x)
        };
        let heptagon: Vec<DVec3> = (0..7).map(at).collect();
        let area = area_vector(&heptagon).length();
        assert!((area_of(&heptagon).0 - area).abs() < 1e-14 * area);
    }

    #[test]
    fn a_rectangle_is_one_cell_and_a_triangle_two() {
        let (u, v) = (DVec3::new(0.3, 0.4, 1.2), DVec3::new(0.8, -0.6, 0.0) * 1e-7);
        let (area, count) = area_of(&[DVec3::ZERO, u, u + v, v]);
        assert!((area / (1.3 * 1e-7) - 1.0).abs() < 1e-8 && count == 1, "{area:e}, {count}");
        assert_eq!(area_of(&[DVec3::ZERO, u, u * 0.25 + v]).1, 2);
    }

    /// Differences and products of these corners are exact, so is the area; 1e-15 is the rounding of a few operations.
    #[test]
    fn slivers_keep_the_digits_of_their_area() {
        let thin = 0.5_f64.powi(40);
        let corners = [DVec3::ZERO, DVec3::new(1.0, 0.5, 0.25), DVec3::new(0.5, 0.25 + thin, 0.125)];
        let truth = 0.5 * thin * 1.0_f64.hypot(0.25);
        assert!((area_of(&corners).0 / truth - 1.0).abs() < 1e-14);
    }
}
