//! Separated pairs: a Gauss product rule in four dimensions whose order comes from a proven error bound.
//!
//! ```text
//! A_i F_ij = ∫_i ∫_j h_i(y) h_j(x) / (π |x − y|⁴) dy dx,      h_i(y) = n_i·(y − p_i), h_j(x) = n_j·(x − p_j)
//! ```
//!
//! Loops are cut into cells x(s, t) = c + s u + t v + s t w over [−1, 1]² (a triangle is a cell with two equal corners). Each of
//! the four directions gets its own order from the bound of [`super::order`]: long slivers and small partners cost few
//! points. The rule itself is that of [`Pose`], here for one pair; rows take several at a time ([`super::blocks`]).

use glam::DVec3;
use pulp::Scalar;

use super::lanes::Lane;
use super::pair::FacingPair;
use super::patch::Patch;
use super::pose::{MAX_EVALUATIONS, Pose, ROUNDING};

/// A value of A_i F_ij, and a bound on its error.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Bounded {
    /// A_i F_ij.
    pub value: f64,
    /// Bound of |error|.
    pub bound: f64,
}

/// Integrates by product rules, or `None` if the pair is too near for the tolerance.
///
/// The error stays below `absolute` (an area) and below `relative` times what the value would be if both patches were at
/// their centres with the largest cosines.
pub(super) fn integrate(pair: &FacingPair, absolute: f64, relative: f64) -> Option<Bounded> {
    let apart = pair.i[0].distance(pair.j[0]).max(pair.i[0].distance(pair.i[1]));
    // A power of two rounds nothing.
    let scale = if apart.is_normal() { 2.0_f64.powi(-(apart.log2() as i32)) } else { 1.0 };
    let patches = |corners: &[DVec3], n: DVec3| -> Vec<Patch<f64>> {
        cells(corners, n).iter().map(|cell| Patch::of(&cell.scaled(scale), DVec3::ZERO)).collect()
    };
    let (first, second) = (patches(&pair.i, pair.n_i), patches(&pair.j, pair.n_j));
    let share = absolute * scale * scale / (first.len() * second.len()) as f64;
    let lane = |v: f64| Lane { simd: Scalar::new(), v };
    let (mut plans, mut evaluations) = (Vec::with_capacity(first.len() * second.len()), 0);
    for (a, b) in first.iter().flat_map(|a| second.iter().map(move |b| (a, b))) {
        let pose = Pose::new::<true>(Scalar::new(), a, b, 0);
        let found = pose.orders::<true>(lane(share), relative, lane(0.0));
        let q = found.q.map(|q| q.v as usize);
        let points: usize = q.iter().product();
        evaluations += points;
        if points == 0 || evaluations > MAX_EVALUATIONS {
            return None;
        }
        plans.push((pose, q, found.bound.v));
    }
    if plans.is_empty() {
        return None;
    }
    let mut sum = Bounded::default();
    for (pose, q, bound) in &plans {
        let value = pose.integrate::<true>(*q).v;
        sum.value += value;
        sum.bound += bound + ROUNDING * value.abs();
    }
    let area = 1.0 / (scale * scale);
    Some(Bounded { value: sum.value * area, bound: sum.bound * area })
}

/// A convex quadrilateral or triangle as x(s, t) = c + s u + t v + s t w.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    pub c: DVec3,
    pub u: DVec3,
    pub v: DVec3,
    pub w: DVec3,
    pub n: DVec3,
    /// Jacobian j₀ + s j_s + t j_t: it is linear because the cell is flat.
    pub j0: f64,
    pub js: f64,
    pub jt: f64,
    pub corners: [DVec3; 4],
}

impl Cell {
    /// The cell of a loop of three or four vertices with unit normal `n`.
    pub fn of(corners: &[DVec3], n: DVec3) -> Self {
        match *corners {
            [a, b, c] => Self::new([a, b, c, a], n),
            [a, b, c, d] => Self::new([a, b, c, d], n),
            _ => unreachable!("a cell has 3 or 4 corners, got {}", corners.len()),
        }
    }

    fn new([a, b, c, d]: [DVec3; 4], n: DVec3) -> Self {
        let (u, v) = ((b + c - a - d) * 0.25, (c + d - a - b) * 0.25);
        let w = (a + c - b - d) * 0.25;
        let (j0, js, jt) = (n.dot(u.cross(v)), n.dot(u.cross(w)), n.dot(w.cross(v)));
        Self { c: (a + b + c + d) * 0.25, u, v, w, n, j0, js, jt, corners: [a, b, c, d] }
    }

    /// Point at (s, t) in [−1, 1]² and the area per ds dt there.
    pub fn at(&self, s: f64, t: f64) -> (DVec3, f64) {
        (self.c + self.u * s + (self.v + self.w * s) * t, self.j0 + self.js * s + self.jt * t)
    }

    pub fn area(&self) -> f64 {
        4.0 * self.j0
    }

    /// The cell with all lengths multiplied by a power of two.
    fn scaled(&self, by: f64) -> Self {
        let corners = self.corners.map(|x| x * by);
        let (j0, js, jt) = (self.j0 * by * by, self.js * by * by, self.jt * by * by);
        Self { c: self.c * by, u: self.u * by, v: self.v * by, w: self.w * by, n: self.n, j0, js, jt, corners }
    }
}

/// Cells of a loop: quadrilaterals of a fan, and a triangle if one is left over.
pub(super) fn cells(corners: &[DVec3], n: DVec3) -> Vec<Cell> {
    let last = corners.len() - 1;
    let fan = |k: usize| {
        if k + 2 <= last {
            Cell::new([corners[0], corners[k], corners[k + 1], corners[k + 2]], n)
        } else {
            Cell::new([corners[0], corners[k], corners[k + 1], corners[0]], n)
        }
    };
    // A piece of the fan between collinear vertices has no area and nothing to integrate.
    (1..last).step_by(2).map(fan).filter(|cell| cell.j0 > 0.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_of_a_heptagon_cover_it() {
        let at = |k: i32| DVec3::new((f64::from(k) * 0.9).cos(), 2.0 * (f64::from(k) * 0.9).sin(), 0.0);
        let heptagon: Vec<DVec3> = (0..7).map(at).collect();
        let area = radiosity_geometry::polygon::area_vector(&heptagon).length();
        let sum: f64 = cells(&heptagon, DVec3::Z).iter().map(Cell::area).sum();
        assert!((sum - area).abs() < 1e-14);
    }
}
