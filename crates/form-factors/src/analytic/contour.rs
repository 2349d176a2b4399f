//! Near and touching pairs: the double contour integral, with everything that is singular in closed form.
//!
//! ```text
//! 2π A_i F_ij = ∮_i ∮_j ln r dy·dx
//! ```
//!
//! Any constant may be added to ln r: it cancels around the loops. So does the unit of length inside it. An edge pair with
//! directions d and u contributes nothing if they are perpendicular. If they are parallel, with x the distances along d between
//! their ends, h the distance of their lines and Δ the second difference over the four ends,
//!
//! ```text
//! ∫∫ (ln r + 1) ds dt = −Δ G,     G(x) = ½ (x² − h²) ln √(x² + h²) + h x atan(x/h) − ¼ x²
//! ```
//!
//! In all other cases the inner integral from a point x to the edge a→b of length L is elementary; with s_v = u·(v − x),
//! r_v = |v − x|, h the distance of x from the edge's line and θ the angle at x between a and b,
//!
//! ```text
//! ∫ (ln r + 1) ds = s_b ln r_b − s_a ln r_a + h θ
//! ```
//!
//! and along an edge of i there remain
//!
//! - per corner v of j, with u₋ and u₊ the directions of those of its two edges that are neither parallel nor perpendicular,
//!   ∫ d·[u₋ u₋·(v − x) − u₊ u₊·(v − x)] ln r_v dt: a linear function times a logarithm, in closed form near v; by a Gauss
//!   rule where v is so far that the closed form cancels;
//! - per edge of j, d·u ∫ h θ dt: no closed form, but tame. It is analytic up to a shared corner, and singular only at complex
//!   t, where x comes near a corner or crosses near the edge, by an imaginary part g that is the distance there. Panels are
//!   bisected until none is more than twice as long as its distance from these points, then until its error is
//!   small. A singularity with g² below the tolerance needs only a panel border: it changes the integral by O(g² ln g).
//!
//! # Bound
//!
//! A panel counts with the smaller of two: the difference of the Gauss–Kronrod pair, which is far above the error of the finer
//! rule; and a proven bound. On a panel with half length H and middle m let ρ H be the sum of the half axes of the ellipse
//! through the nearest singularity, and ρ' = 0.97 ρ. Inside the smaller ellipse
//!
//! ```text
//! |h| ≤ h(m) + H ρ' sin(d, u),     |θ| ≤ π + ln(X_a/δ) + ln(X_b/δ),     δ = ½ H (ρ − ρ') (1 − 1/(ρ ρ'))
//! ```
//!
//! with X_v = |s_v| + |h| at most r_v(m) + h(m) + 2 H ρ' there and δ the distance between the ellipses: by
//! θ = (1/2i) ln[(s_a + ih)(s_b − ih) / ((s_a − ih)(s_b + ih))] and (s + ih)(s − ih) = r². With M the product, the rule of degree 23
//! errs by at most 4 M ρ'⁻²³/(ρ' − 1) of the panel's length (Trefethen 2008). Added are g² (2 + ln(length/g)) of the singularities
//! left alone, and 4 ε times the sum of the magnitudes of all terms: about 1e-15 of the product of the polygons' diameters. Where
//! that is too much (slivers, unequal sizes), [`point_quadrature`](super::point_quadrature) does better.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::DVec3;

use super::area_quadrature::Bounded;
use super::gauss::{KRONROD, gauss};
use super::singularities::{Edge, Singularities, edges};

/// Corners at least this many half lengths from the middle of an edge are integrated by the Gauss rule of order
/// [`FAR_ORDER`], which leaves a relative error of 32⁻¹⁰ times its coefficient 1.5e-4, below rounding.
const FAR_CORNER: f64 = 32.0;
const FAR_ORDER: usize = 5;
/// Parallel edges use their closed form up to this ratio of the largest distance of their ends to the shorter length: the
/// second difference loses as many times the rounding.
const PARALLEL_REACH: f64 = 32.0;
/// Panels are at most this many times as long as their distance from a singularity.
const PANEL: f64 = 2.0;
/// Bisections of one panel: enough to go from the length of an edge to its rounding.
const DEPTH: u32 = 52;

/// A value of A_i F_ij with the parts of its bound.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contour {
    pub value: f64,
    /// Bound of the quadrature error.
    pub quadrature: f64,
    /// Bound of the rounding.
    pub rounding: f64,
}

impl From<Contour> for Bounded {
    fn from(Contour { value, quadrature, rounding }: Contour) -> Self {
        Self { value, bound: quadrature + rounding }
    }
}

/// A_i F_ij of two loops that lie in front of each other, with a quadrature error of about `tolerance` (an area).
pub(super) fn integrate(i: &[DVec3], j: &[DVec3], tolerance: f64) -> Contour {
    // The outer integral runs over the shorter loop: its edges see the other loop's corners from farther away.
    let (outer, inner) = if perimeter(i) <= perimeter(j) { (i, j) } else { (j, i) };
    let ends = Ends::new(outer, inner);
    let inner_edges: Vec<Option<Edge>> = edges(inner).map(|(a, b)| Edge::new(a, b)).collect();
    let share = TAU * tolerance / (outer.len() * inner.len()) as f64;

    let mut sum = Sum { unit: ends.unit, ..Sum::default() };
    for (m, edge) in edges(outer).enumerate() {
        let Some(edge) = Edge::new(edge.0, edge.1) else { continue };
        // The direction of the edge before a corner, where its inner integral has the corner's term.
        let last = inner_edges.last().copied().flatten();
        let mut before = last.and_then(|other| {
            let ends = ends.of(m, inner.len() - 1);
            (relation(&edge, &other, &ends) == Relation::Skew).then_some(other.u)
        });
        for (k, other) in inner_edges.iter().enumerate() {
            let ends = ends.of(m, k);
            let mut after = None;
            if let Some(other) = other {
                match relation(&edge, other, &ends) {
                    Relation::Perpendicular(rounding) => sum.terms += PI * edge.length * sum.unit * rounding,
                    Relation::Parallel => sum.add_parallel(&edge, other, &ends),
                    Relation::Skew => {
                        sum.add_edge(&edge, other, share);
                        after = Some(other.u);
                    }
                }
            }
            if before.is_some() || after.is_some() {
                sum.add_corner(&edge, before, after, inner[k], [ends[0][0], ends[1][0]]);
            }
            before = after;
        }
    }
    Contour { value: sum.value / TAU, quadrature: sum.quadrature / TAU, rounding: 4.0 * f64::EPSILON * sum.terms / TAU }
}

/// Length of a closed loop.
pub(super) fn perimeter(corners: &[DVec3]) -> f64 {
    edges(corners).map(|(a, b)| a.distance(b)).sum()
}

/// Distance between two corners, and its logarithm in units of the largest.
#[derive(Clone, Copy, Debug, Default)]
struct End {
    r: f64,
    log: f64,
}

/// [`End`]s of all pairs of corners: every one serves four pairs of edges.
struct Ends {
    outer: usize,
    inner: usize,
    /// Length inside the logarithm: the largest r, so that logarithms of large distances are small.
    unit: f64,
    all: Vec<End>,
}

impl Ends {
    fn new(outer: &[DVec3], inner: &[DVec3]) -> Self {
        let pairs = outer.iter().flat_map(|p| inner.iter().map(move |v| End { r: p.distance(*v), log: 0.0 }));
        let mut all: Vec<End> = pairs.collect();
        let unit = all.iter().map(|end| end.r).fold(0.0, f64::max);
        // At r = 0 every factor of the logarithm vanishes faster.
        for end in all.iter_mut().filter(|end| end.r > 0.0) {
            end.log = (end.r / unit).ln();
        }
        Self { outer: outer.len(), inner: inner.len(), unit, all }
    }

    /// Those of the ends (p, q) of outer edge m against the ends (a, b) of inner edge k.
    fn of(&self, m: usize, k: usize) -> [[End; 2]; 2] {
        let at = |m: usize, k: usize| self.all[(m % self.outer) * self.inner + k % self.inner];
        [[at(m, k), at(m, k + 1)], [at(m + 1, k), at(m + 1, k + 1)]]
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Relation {
    /// To rounding, which is what is left out (in units of ε).
    Perpendicular(f64),
    /// To rounding, and near enough for the closed form.
    Parallel,
    Skew,
}

fn relation(edge: &Edge, other: &Edge, ends: &[[End; 2]; 2]) -> Relation {
    let c = edge.u.dot(other.u);
    if c.abs() <= 2.0 * f64::EPSILON {
        return Relation::Perpendicular(c.abs() / f64::EPSILON);
    }
    let reach = ends.iter().flatten().map(|end| end.r).fold(0.0, f64::max);
    let near = reach <= PARALLEL_REACH * edge.length.min(other.length);
    let parallel = near && edge.u.cross(other.u).length_squared() <= (4.0 * f64::EPSILON).powi(2);
    if parallel { Relation::Parallel } else { Relation::Skew }
}

/// Running sum of 2π A_i F_ij.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    /// Length inside the logarithm.
    unit: f64,
    value: f64,
    /// Bound of the quadrature errors.
    quadrature: f64,
    /// Sum of the magnitudes that were added and subtracted: rounding is ε times it.
    terms: f64,
}

impl Sum {
    /// ∫∫ (ln(r/unit) + 1) dy·dx over two parallel edges.
    fn add_parallel(&mut self, edge: &Edge, other: &Edge, ends: &[[End; 2]; 2]) {
        let d = edge.u;
        let to_a = other.a - edge.a;
        let h = (to_a - d * to_a.dot(d)).length();
        let h2 = h * h;
        // −Δ over the ends; the sign of d·u is in the order of a and b along d.
        for (m, p) in [edge.a, edge.b].into_iter().enumerate() {
            for (k, v) in [other.a, other.b].into_iter().enumerate() {
                let (x, End { log, .. }) = ((v - p).dot(d), ends[m][k]);
                let (x2, arc) = (x * x, if h > 0.0 { h * x * (x / h).atan() } else { 0.0 });
                let log_factor = 0.5 * (x2 - h2);
                let g = log_factor * log + arc - 0.25 * x2;
                self.value += if m == k { -g } else { g };
                self.terms += log_factor.abs() * (log.abs() + 1.0) + arc + 0.25 * x2;
            }
        }
        // Rounding of h, and of directions that are parallel but for it.
        self.terms += FRAC_PI_2 * (h + ends[0][0].r) * edge.length.min(other.length);
    }

    /// ∫ d·[u₋ u₋·(v − x) − u₊ u₊·(v − x)] ln(r_v/unit) dt along an edge.
    fn add_corner(&mut self, edge: &Edge, before: Option<DVec3>, after: Option<DVec3>, v: DVec3, ends: [End; 2]) {
        let Edge { a: p, u: d, length, .. } = *edge;
        let k = before.map_or(DVec3::ZERO, |u| u * u.dot(d)) - after.map_or(DVec3::ZERO, |u| u * u.dot(d));
        // With t measured from the foot of v the first factor is alpha − beta·t.
        let to_v = v - p;
        let foot = to_v.dot(d);
        let aside = to_v - d * foot;
        let g = aside.length();
        let (beta, alpha) = (k.dot(d), k.dot(aside));
        if alpha == 0.0 && beta == 0.0 {
            return;
        }
        let (t0, t1) = (-foot, length - foot);
        let half = 0.5 * length;
        if (0.5 * (t0 + t1)).hypot(g) >= FAR_CORNER * half {
            let (x, w) = gauss(FAR_ORDER);
            for (x, w) in x.iter().zip(w) {
                let t = 0.5 * (t0 + t1) + half * x;
                let term = (alpha - beta * t) * (t.hypot(g) / self.unit).ln() * w * length;
                self.value += term;
                self.terms += term.abs();
            }
            self.terms += (alpha.abs() + (beta * t0).abs().max((beta * t1).abs())) * length;
            return;
        }
        // Both ends of the arc in one angle.
        let arc = if g > 0.0 { g * (g * length).atan2(t0 * t1 + g * g) } else { 0.0 };
        self.value += alpha * (arc - length);
        self.terms += alpha.abs() * (arc + length);
        for (t, End { r, log }, sign) in [(t1, ends[1], 1.0), (t0, ends[0], -1.0)] {
            let r2 = r * r;
            self.value += sign * (alpha * t * log - beta * r2 * (0.5 * log - 0.25));
            self.terms += alpha.abs() * t.abs() * (log.abs() + 1.0) + beta.abs() * r2 * (0.5 * log.abs() + 0.75);
        }
    }

    /// d·u ∫ h θ dt along an edge.
    fn add_edge(&mut self, edge: &Edge, other: &Edge, share: f64) {
        let Edge { a: p, u: d, length, .. } = *edge;
        let c = d.dot(other.u);
        let tolerance = share / c.abs();
        let singular = Singularities::new(edge, other);
        // Those with a smaller imaginary part change the integral by less than the tolerance.
        let least = (0.01 * tolerance).sqrt();
        let mut borders = [0.0, 0.0, 0.0, 0.0, length];
        let mut count = 1;
        for at in singular.borders(length) {
            borders[count] = at;
            count += 1;
        }
        borders[count] = length;
        borders[1..count].sort_unstable_by(f64::total_cmp);

        let sight = Sight { p, d, other, sine: d.cross(other.u).length() };
        let mut panels = Panels { tolerance: tolerance / 8.0, least, unit: self.unit, ..Panels::default() };
        for k in 0..count {
            panels.add(borders[k], borders[k + 1], &singular, &sight);
        }
        let alone = singular.0.iter().filter(|(_, im)| *im > 0.0 && *im <= least);
        let left_alone: f64 = alone.map(|(_, im)| im * im * (2.0 + (length / im).ln().max(0.0))).sum();
        self.value += c * panels.value;
        self.quadrature += c.abs() * (panels.error + left_alone);
        self.terms += c.abs() * panels.angle * self.unit;
    }
}

/// What points of an edge see of another.
#[derive(Clone, Copy, Debug)]
struct Sight<'a> {
    p: DVec3,
    d: DVec3,
    other: &'a Edge,
    /// Sine of the angle between the two.
    sine: f64,
}

impl Sight<'_> {
    /// h and θ at t.
    fn at(&self, t: f64) -> (f64, f64) {
        let x = self.p + self.d * t;
        let (to_a, to_b) = (self.other.a - x, self.other.b - x);
        let h = to_a.cross(self.other.u).length();
        (h, (h * self.other.length).atan2(to_a.dot(to_b)))
    }

    /// Proven bound of the Gauss–Kronrod rule's error on the mean of h θ.
    fn bound(&self, lo: f64, hi: f64, ellipse: f64) -> f64 {
        let (rho, half) = (0.97 * ellipse, 0.5 * (hi - lo));
        if rho <= 1.0 {
            return f64::INFINITY;
        }
        let x = self.p + self.d * (0.5 * (lo + hi));
        let (to_a, to_b) = (self.other.a - x, self.other.b - x);
        let h = to_a.cross(self.other.u).length();
        let apart = 0.5 * half * (ellipse - rho) * (1.0 - 1.0 / (ellipse * rho));
        let grown = h + 2.0 * half * rho;
        let logs = ((to_a.length() + grown) * (to_b.length() + grown) / (apart * apart)).ln();
        4.0 * (h + half * rho * self.sine) * (PI + logs) * rho.powi(-23) / (rho - 1.0)
    }
}

/// Adaptive Gauss–Kronrod integration of h θ.
#[derive(Clone, Copy, Debug, Default)]
struct Panels {
    tolerance: f64,
    /// Imaginary part up to which a singularity is left alone.
    least: f64,
    unit: f64,
    value: f64,
    error: f64,
    /// ∫ θ dt, for the rounding of h.
    angle: f64,
}

impl Panels {
    fn add(&mut self, lo: f64, hi: f64, singular: &Singularities, sight: &Sight) {
        let mut stack = [(0.0, 0.0, 0); DEPTH as usize + 1];
        stack[0] = (lo, hi, DEPTH);
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let (lo, hi, depth) = stack[count];
            let mid = 0.5 * (lo + hi);
            let divisible = depth > 0 && lo < mid && mid < hi;
            if !(divisible && singular.too_near(lo, hi, PANEL, self.least)) {
                let (value, difference, angle) = kronrod(lo, hi, sight);
                let proven = (hi - lo) * sight.bound(lo, hi, singular.ellipse(lo, hi));
                let error = difference.min(proven);
                if !divisible || error <= self.tolerance.max(2.0 * f64::EPSILON * self.unit * angle) {
                    self.value += value;
                    self.error += error;
                    self.angle += angle;
                    continue;
                }
            }
            stack[count] = (mid, hi, depth - 1);
            stack[count + 1] = (lo, mid, depth - 1);
            count += 2;
        }
    }
}

/// Value, difference from the embedded rule, and the integral of θ.
fn kronrod(lo: f64, hi: f64, sight: &Sight) -> (f64, f64, f64) {
    let (mid, half) = (0.5 * (lo + hi), 0.5 * (hi - lo));
    let (mut fine, mut coarse, mut angle) = (0.0, 0.0, 0.0);
    for &(x, w_fine, w_coarse) in &KRONROD {
        let (h, theta) = sight.at(mid + half * x);
        let (mut value, mut both) = (h * theta, theta);
        if x > 0.0 {
            let (h, theta) = sight.at(mid - half * x);
            value += h * theta;
            both += theta;
        }
        fine += w_fine * value;
        coarse += w_coarse * value;
        angle += w_fine * both;
    }
    let width = hi - lo;
    (fine * width, (fine - coarse).abs() * width, angle * width)
}
