//! Separated pairs: a Gauss product rule in four dimensions whose order comes from a proven error bound.
//!
//! ```text
//! A_i F_ij = ∫_i ∫_j h_i(y) h_j(x) / (π |x − y|⁴) dy dx,      h_i(y) = n_i·(y − p_i), h_j(x) = n_j·(x − p_j)
//! ```
//!
//! Loops are cut into cells x(s, t) = c + s u + t v + s t w over [−1, 1]² (a triangle is a cell with two equal corners).
//! Along one direction, all else fixed, x moves on a line; with its half length h, and D the distance from its middle to
//! y, σ = h/D, the kernel 1/|x − y|⁴ = D⁻⁴ (1 − 2σ s cos γ + σ² s²)⁻² is the generating function of the Gegenbauer polynomials
//! C_k⁽²⁾(cos γ), of which none exceeds c_k = (k + 1)(k + 2)(k + 3)/6. h_i(y) does not depend on s; h_j and the Jacobian
//! are linear in s, with slopes of at most g (per unit s) and κ (relative to the mean). So the rule of q points errs by at most
//!
//! ```text
//! A_i A_j N_i / (π D⁴) · Σ_{k ≥ 2q, even} e_qk [ N_j c_k σᵏ + (g + κ N_j) c_{k−1} σᵏ⁻¹ + κ g c_{k−2} σᵏ⁻² ]
//! ```
//!
//! where e_qk ≥ 0 is the rule's error on the mean of sᵏ, and N_i, N_j are the largest h_i and h_j. Weights are positive
//! and sum to the area, so the errors of the four directions add up to a bound of the whole. Each direction gets its own order:
//! long slivers and small partners cost few points.

use std::f64::consts::PI;

use glam::DVec3;

use super::gauss::{MAX_ORDER, gauss};
use super::pair::FacingPair;

/// Kernel evaluations a pair may cost; beyond it the contour rule is cheaper.
const MAX_EVALUATIONS: usize = 2500;

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
    // The usual case of one cell each needs no list.
    if pair.i.len() <= 4 && pair.j.len() <= 4 {
        let (a, b) = (Cell::of(&pair.i, pair.n_i), Cell::of(&pair.j, pair.n_j));
        let plan = Plan::new(&a, &b, absolute, relative)?;
        return (plan.evaluations() <= MAX_EVALUATIONS).then(|| plan.integrate(&a, &b));
    }
    let (first, second) = (cells(&pair.i, pair.n_i), cells(&pair.j, pair.n_j));
    let share = absolute / (first.len() * second.len()) as f64;
    let mut plans = Vec::with_capacity(first.len() * second.len());
    for a in &first {
        for b in &second {
            plans.push((a, b, Plan::new(a, b, share, relative)?));
        }
    }
    if plans.iter().map(|(.., plan)| plan.evaluations()).sum::<usize>() > MAX_EVALUATIONS {
        return None;
    }
    let parts = plans.iter().map(|(a, b, plan)| plan.integrate(a, b));
    Some(
        parts.fold(Bounded::default(), |sum, part| Bounded {
            value: sum.value + part.value,
            bound: sum.bound + part.bound,
        }),
    )
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

    /// Size² / area: 4 for a square, large for slivers.
    fn stretch(&self) -> f64 {
        (self.u.length() + self.v.length()).powi(2) / self.j0
    }

    /// Largest height of a corner above the plane of `other`.
    fn height_above(&self, other: &Self) -> f64 {
        self.corners.iter().map(|x| (*x - other.corners[0]).dot(other.n)).fold(0.0, f64::max)
    }

    /// The two directions: half vector at the middle, its twist, and relative slope of the Jacobian.
    fn directions(&self) -> [(DVec3, DVec3, f64); 2] {
        [(self.u, self.v, (self.js / self.j0).abs()), (self.v, self.u, (self.jt / self.j0).abs())]
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

/// Orders of the four directions and what they leave as error.
#[derive(Clone, Copy, Debug)]
struct Plan {
    q: [usize; 4],
    bound: f64,
}

impl Plan {
    fn new(a: &Cell, b: &Cell, absolute: f64, relative: f64) -> Option<Self> {
        let apart = b.c - a.c;
        let distance = apart.length();
        let along = apart / distance;
        let (n_a, n_b) = (b.height_above(a), a.height_above(b)); // N_i, N_j
        let areas = a.area() * b.area() / PI;
        if !(areas > 0.0 && distance > 0.0) {
            return None;
        }
        let target = 0.25 * absolute.min(relative * areas * n_a * n_b / distance.powi(4));
        let reach = |cell: &Cell, e: DVec3| cell.corners.iter().map(|x| (*x - cell.c).dot(e)).fold(0.0, f64::max);
        let mut plan = Self { q: [1; 4], bound: 0.0 };
        for (k, (x, y, n_x, n_y, e)) in [(a, b, n_a, n_b, along), (b, a, n_b, n_a, -along)].into_iter().enumerate() {
            let room = distance - reach(y, -e);
            for (l, (half, across, kappa)) in x.directions().into_iter().enumerate() {
                // Middles of the lines run along the other direction; D is their least distance from the partner.
                let d = room - across.dot(e).abs();
                let h = (half + x.w).length().max((half - x.w).length());
                let g = (half + x.w).dot(y.n).abs().max((half - x.w).dot(y.n).abs());
                let line = Line { scale: areas * n_x / d.powi(4), sigma: h / d, top: n_y, slope: g, kappa };
                let (q, bound) = line.order(target)?;
                plan.q[2 * k + l] = q;
                plan.bound += bound;
            }
        }
        // Rounding turns a normal by about ε · size²/area, which moves the heights over its plane; the sum carries that
        // of its terms.
        let turned = f64::EPSILON * (a.stretch() * n_b + b.stretch() * n_a) * distance;
        plan.bound += areas * turned / distance.powi(4);
        Some(plan)
    }

    fn evaluations(&self) -> usize {
        self.q.iter().product()
    }

    fn integrate(&self, a: &Cell, b: &Cell) -> Bounded {
        let x = Points::new(a, b, self.q[0], self.q[1]);
        let y = Points::new(b, a, self.q[2], self.q[3]);
        let value = kernel_sum(&x, &y) / PI;
        Bounded { value, bound: self.bound + 32.0 * f64::EPSILON * value.abs() }
    }
}

/// One direction of a pair, as the bound sees it.
#[derive(Clone, Copy, Debug)]
struct Line {
    /// A_i A_j N_i / (π D⁴).
    scale: f64,
    /// h/D.
    sigma: f64,
    /// N_j.
    top: f64,
    /// g.
    slope: f64,
    /// κ.
    kappa: f64,
}

impl Line {
    /// Least order whose bound is below `target`, and that bound.
    fn order(&self, target: f64) -> Option<(usize, f64)> {
        let Self { scale, sigma, top, slope, kappa } = *self;
        let bin = SIGMA_LIMITS.iter().position(|&limit| sigma > 0.0 && sigma <= limit)?;
        let mut power = scale; // σ^(2q − 2), scaled
        for q in 1..=MAX_ORDER {
            let [p0, p1, p2] = SERIES[bin][q - 1];
            let bound = power * ((top * p0 * sigma + (slope + kappa * top) * p1) * sigma + kappa * slope * p2);
            if bound <= target {
                return Some((q, bound));
            }
            power *= sigma * sigma;
        }
        None
    }
}

/// Upper ends of the ranges of σ for which [`SERIES`] holds.
const SIGMA_LIMITS: [f64; 3] = [0.05, 0.15, 0.4];

/// Σ_{k ≥ 2q, even} e_qk c_{k−l} σ^{k−2q} at the upper end of each range of σ, for q = 1..=8 and l = 0, 1, 2.
#[rustfmt::skip]
static SERIES: [[[f64; 3]; MAX_ORDER]; 3] = [
    [
        [3.35091, 1.34338, 0.338365], [3.13344, 1.79267, 0.898201], [1.93622, 1.2918, 0.808264],
        [0.967096, 0.703733, 0.492972], [0.423826, 0.326161, 0.244752], [0.169954, 0.136012, 0.106912],
        [0.0639036, 0.0526423, 0.0427868], [0.0228832, 0.019275, 0.0160673],
    ],
    [
        [3.49713, 1.42754, 0.380975], [3.31966, 1.91734, 0.976592], [2.07238, 1.39113, 0.878078],
        [1.04537, 0.764086, 0.53837], [0.462666, 0.357294, 0.26927], [0.187374, 0.150381, 0.118609],
        [0.0711567, 0.0587587, 0.0478919], [0.0257354, 0.0217228, 0.0181508],
    ],
    [
        [4.85729, 2.24958, 0.832344], [5.08063, 3.13046, 1.77069], [3.42602, 2.3998, 1.60666],
        [1.8585, 1.40158, 1.02778], [0.884202, 0.699815, 0.543406], [0.384999, 0.315289, 0.254654],
        [0.15723, 0.132074, 0.109786], [0.0611659, 0.0524, 0.0445225],
    ],
];

/// Lanes that [`kernel_sum`] adds side by side.
const LANES: usize = 4;
/// Points of a cell at the highest order, a multiple of [`LANES`].
const CAPACITY: usize = MAX_ORDER * MAX_ORDER;

/// Quadrature points of a cell, coordinate by coordinate; weights hold the area and the height above the partner's plane.
struct Points {
    len: usize,
    x: [f64; CAPACITY],
    y: [f64; CAPACITY],
    z: [f64; CAPACITY],
    weight: [f64; CAPACITY],
}

impl Points {
    fn new(cell: &Cell, other: &Cell, q_s: usize, q_t: usize) -> Self {
        let mut points =
            Self { len: 0, x: [0.0; CAPACITY], y: [0.0; CAPACITY], z: [0.0; CAPACITY], weight: [0.0; CAPACITY] };
        let ((s, w_s), (t, w_t)) = (gauss(q_s), gauss(q_t));
        let mut k = 0;
        for (s, w_s) in s.iter().zip(w_s) {
            for (t, w_t) in t.iter().zip(w_t) {
                let (at, jacobian) = cell.at(*s, *t);
                let height = (at - other.corners[0]).dot(other.n);
                (points.x[k], points.y[k], points.z[k]) = (at.x, at.y, at.z);
                points.weight[k] = 4.0 * w_s * w_t * jacobian * height;
                k += 1;
            }
        }
        points.len = k;
        // Full lanes: copies of the last point with no weight.
        while k % LANES != 0 {
            (points.x[k], points.y[k], points.z[k]) = (points.x[k - 1], points.y[k - 1], points.z[k - 1]);
            k += 1;
        }
        points
    }
}

/// Σ w_k w_l / |x_k − y_l|⁴.
fn kernel_sum(x: &Points, y: &Points) -> f64 {
    let full = y.len.next_multiple_of(LANES);
    let (y_x, y_y, y_z, y_w) = (&y.x[..full], &y.y[..full], &y.z[..full], &y.weight[..full]);
    let mut total = 0.0;
    for k in 0..x.len {
        let mut sums = [0.0; LANES];
        let lanes = y_x.chunks_exact(LANES).zip(y_y.chunks_exact(LANES));
        let lanes = lanes.zip(y_z.chunks_exact(LANES).zip(y_w.chunks_exact(LANES)));
        for ((y_x, y_y), (y_z, y_w)) in lanes {
            for l in 0..LANES {
                let (dx, dy, dz) = (x.x[k] - y_x[l], x.y[k] - y_y[l], x.z[k] - y_z[l]);
                let r2 = dx * dx + dy * dy + dz * dz;
                sums[l] += y_w[l] / (r2 * r2);
            }
        }
        total += x.weight[k] * ((sums[0] + sums[1]) + (sums[2] + sums[3]));
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table against its definition, term by term: 6 printed digits, rounded up by at most 1e-5 relative.
    #[test]
    fn series_constants_match_their_definition() {
        let c = |k: i32| if k < 0 { 0.0 } else { f64::from((k + 1) * (k + 2) * (k + 3)) / 6.0 };
        for (bin, &limit) in SIGMA_LIMITS.iter().enumerate() {
            for q in 1..=MAX_ORDER {
                let (x, w) = gauss(q);
                for l in 0..3 {
                    let mut sum = 0.0;
                    for k in (2 * q as i32..200).step_by(2) {
                        let rule: f64 = x.iter().zip(w).map(|(x, w)| w * x.powi(k)).sum();
                        sum += (1.0 / f64::from(k + 1) - rule) * c(k - l) * limit.powi(k - 2 * q as i32);
                    }
                    let table = SERIES[bin][q - 1][l as usize];
                    assert!((table / sum - 1.0).abs() < 1e-5, "range {bin}, order {q}, {l}: {table} {sum}");
                }
            }
        }
    }

    #[test]
    fn cells_of_a_heptagon_cover_it() {
        let at = |k: i32| DVec3::new((f64::from(k) * 0.9).cos(), 2.0 * (f64::from(k) * 0.9).sin(), 0.0);
        let heptagon: Vec<DVec3> = (0..7).map(at).collect();
        let area = radiosity_geometry::polygon::area_vector(&heptagon).length();
        let sum: f64 = cells(&heptagon, DVec3::Z).iter().map(Cell::area).sum();
        assert!((sum - area).abs() < 1e-14);
    }
}
