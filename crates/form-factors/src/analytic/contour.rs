//! Near and touching pairs: the double contour integral, with everything that is singular in closed form.
//!
//! ```text
//! 2π A_i F_ij = ∮_i ∮_j ln r dy·dx
//! ```
//!
//! Over an edge a→b of j with direction u and length L the inner integral from a point x is elementary; with
//! s_v = u·(v − x), r_v = |v − x|, h the distance of x from the edge's line and θ the angle at x between a and b,
//!
//! ```text
//! ∫ ln r ds = s_b ln r_b − s_a ln r_a + h θ − L
//! ```
//!
//! The −L, and any unit of length inside ln, cancel around the loop. Along an edge of i (direction d) there remain
//!
//! - per corner v of j, with u₋ and u₊ the directions of its two edges, ∫ d·[u₋ u₋·(v − x) − u₊ u₊·(v − x)] ln r_v dt: a
//!   linear function times a logarithm, in closed form near v; by a Gauss rule where v is so far that the closed form cancels;
//! - per edge of j, d·u ∫ h θ dt: no closed form, but tame. It is 0 for coincident edges, analytic up to a shared corner, and
//!   otherwise singular only at complex t, where x comes near a corner or crosses near the edge, by an imaginary part g that is
//!   the distance there. Panels are bisected until none is more than eight times as long as its distance from these points,
//!   then until the Gauss–Kronrod pair agrees. A singularity with g² below the tolerance needs only a panel border: it
//!   changes the integral by O(g² ln g).
//!
//! The bound adds the differences of the Gauss–Kronrod pairs, g² (2 + ln(length/g)) of the singularities left alone, and
//! rounding of all terms. Rounding limits the rule: about 1e-15 of the product of the polygons' diameters.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::area_quadrature::Bounded;
use super::gauss::{KRONROD, gauss};

/// Corners at least this many half lengths from the middle of an edge are integrated by the Gauss rule of order 8, which
/// leaves a relative error of 4⁻¹⁶ times its coefficient 4.7e-5/16, below rounding.
const FAR_CORNER: f64 = 4.0;
/// Panels are at most this many times as long as their distance from a singularity.
const PANEL: f64 = 8.0;
/// Bisections of one panel: enough to go from the length of an edge to its rounding.
const DEPTH: u32 = 52;

/// A_i F_ij of two loops that lie in front of each other, with a quadrature error of about `tolerance` (an area).
pub(super) fn integrate(i: &[DVec3], j: &[DVec3], tolerance: f64) -> Bounded {
    // The outer integral runs over the shorter loop: its edges see the other loop's corners from farther away.
    let (outer, inner) = if perimeter(i) <= perimeter(j) { (i, j) } else { (j, i) };
    let unit = inner.iter().map(|v| v.distance(outer[0])).fold(0.0, f64::max);
    let inner_edges: Vec<Edge> = edges(inner).filter_map(|(a, b)| Edge::new(a, b)).collect();
    let share = TAU * tolerance / (outer.len() * inner_edges.len().max(1)) as f64;

    let mut sum = Sum { unit, ..Sum::default() };
    for edge in edges(outer).filter_map(|(p, q)| Edge::new(p, q)) {
        let mut before = inner_edges.last();
        for after in &inner_edges {
            if let Some(before) = before {
                sum.add_corner(&edge, before.u, after.u, after.a);
            }
            sum.add_edge(&edge, after, share);
            before = Some(after);
        }
    }
    Bounded { value: sum.value / TAU, bound: (sum.quadrature + 4.0 * f64::EPSILON * sum.terms) / TAU }
}

/// Length of a closed loop.
pub(super) fn perimeter(corners: &[DVec3]) -> f64 {
    edges(corners).map(|(a, b)| a.distance(b)).sum()
}

fn edges(corners: &[DVec3]) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
    let n = corners.len();
    (0..n).map(move |k| (corners[k], corners[(k + 1) % n]))
}

/// An edge from a to b with unit direction u.
#[derive(Clone, Copy, Debug)]
struct Edge {
    a: DVec3,
    b: DVec3,
    u: DVec3,
    length: f64,
}

impl Edge {
    fn new(a: DVec3, b: DVec3) -> Option<Self> {
        let length = a.distance(b);
        (length > 0.0).then(|| Self { a, b, u: (b - a) / length, length })
    }
}

/// Running sum of 2π A_i F_ij.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    /// Length inside the logarithm: near the largest r, so that logarithms stay small.
    unit: f64,
    value: f64,
    /// Bound of the quadrature errors.
    quadrature: f64,
    /// Sum of the magnitudes that were added and subtracted: rounding is ε times it.
    terms: f64,
}

impl Sum {
    /// ∫ d·[u₋ u₋·(v − x) − u₊ u₊·(v − x)] ln(r_v/unit) dt along an edge.
    fn add_corner(&mut self, edge: &Edge, before: DVec3, after: DVec3, v: DVec3) {
        let Edge { a: p, u: d, length, .. } = *edge;
        let k = before * before.dot(d) - after * after.dot(d);
        // With t measured from the foot of v the first factor is alpha − beta·t.
        let to_v = v - p;
        let foot = to_v.dot(d);
        let g = (to_v - d * foot).length();
        let (beta, alpha) = (k.dot(d), k.dot(to_v - d * foot));
        if alpha == 0.0 && beta == 0.0 {
            return;
        }
        let (t0, t1) = (-foot, length - foot);
        let half = 0.5 * length;
        if (0.5 * (t0 + t1)).hypot(g) >= FAR_CORNER * half {
            let (x, w) = gauss(8);
            for (x, w) in x.iter().zip(w) {
                let t = 0.5 * (t0 + t1) + half * x;
                let term = (alpha - beta * t) * (t.hypot(g) / self.unit).ln() * w * length;
                self.value += term;
                self.terms += term.abs();
            }
            self.terms += (alpha.abs() + (beta * t0).abs().max((beta * t1).abs())) * length;
            return;
        }
        let mut end = |t: f64, sign: f64| {
            let r = t.hypot(g);
            let log = if r > 0.0 { (r / self.unit).ln() } else { 0.0 };
            let arc = if g > 0.0 { g * t.atan2(g) } else { 0.0 };
            self.value += sign * (alpha * (t * log - t + arc) - beta * r * r * (0.5 * log - 0.25));
            self.terms +=
                alpha.abs() * ((t * log).abs() + t.abs() + arc.abs()) + beta.abs() * r * r * (log.abs() + 0.5);
        };
        end(t1, 1.0);
        end(t0, -1.0);
    }

    /// d·u ∫ h θ dt along an edge.
    fn add_edge(&mut self, edge: &Edge, other: &Edge, share: f64) {
        let Edge { a: p, u: d, length, .. } = *edge;
        let Edge { a, b, u, length: other_length } = *other;
        let c = d.dot(u);
        if c.abs() <= 2.0 * f64::EPSILON {
            // Perpendicular to rounding: what is left out is rounding of c.
            self.terms += PI * length * self.unit * c.abs() / f64::EPSILON;
            return;
        }
        let tolerance = share / c.abs();
        let integrand = |t: f64| {
            let x = p + d * t;
            let (to_a, to_b) = (a - x, b - x);
            let h = to_a.cross(u).length();
            let theta = (h * other_length).atan2(to_a.dot(to_b));
            (h * theta, theta)
        };
        let singular = Singularities::new(edge, other, tolerance);
        let mut borders = [0.0; 5];
        let count = singular.borders(length, &mut borders);
        let mut panels = Panels { tolerance: tolerance / 8.0, unit: self.unit, ..Panels::default() };
        for k in 1..count {
            panels.add(borders[k - 1], borders[k], &singular, &integrand);
        }
        self.value += c * panels.value;
        self.quadrature += c.abs() * (panels.error + singular.left_alone(length));
        self.terms += c.abs() * panels.angle * self.unit;
    }
}

/// Points re + i·im at which h θ is not analytic along an edge, in the order corner a, corner b, crossing.
#[derive(Clone, Copy, Debug)]
struct Singularities {
    at: [(f64, f64); 3],
    /// Those with a smaller imaginary part change the integral by less than the tolerance.
    least: f64,
}

impl Singularities {
    fn new(edge: &Edge, other: &Edge, tolerance: f64) -> Self {
        let Edge { a: p, u: d, .. } = *edge;
        let corner = |v: DVec3| {
            let t = (v - p).dot(d);
            (t, (v - p - d * t).length())
        };
        // Lines come nearest where the derivative of h² vanishes; h² = s²(t² …) has its complex zeros there.
        let normal = d.cross(other.u);
        let s2 = normal.length_squared();
        let to_a = other.a - p;
        let mut crossing = (f64::INFINITY, f64::INFINITY);
        if s2 > f64::EPSILON {
            let t = to_a.cross(other.u).dot(normal) / s2;
            let along = (p + d * t - other.a).dot(other.u);
            // Beyond the ends of the other edge h θ is even in h and stays analytic there.
            if along > 0.0 && along < other.length {
                crossing = (t, to_a.dot(normal).abs() / s2);
            }
        }
        Self { at: [corner(other.a), corner(other.b), crossing], least: (0.01 * tolerance).sqrt() }
    }

    /// Ends of the edge and, in order, the real parts that lie between them and are near.
    fn borders(&self, length: f64, borders: &mut [f64; 5]) -> usize {
        let mut count = 1;
        for &(re, im) in &self.at {
            if re > 0.0 && re < length && im < length {
                borders[count] = re;
                count += 1;
            }
        }
        borders[count] = length;
        borders[1..=count].sort_unstable_by(f64::total_cmp);
        count + 1
    }

    /// Whether the panel is too long for a singularity near it.
    fn too_near(&self, lo: f64, hi: f64) -> bool {
        self.at.iter().any(|&(re, im)| {
            let beside = (lo - re).max(re - hi).max(0.0);
            im > self.least && PANEL * beside.hypot(im) < hi - lo
        })
    }

    /// Bound of what singularities without panels of their own leave.
    fn left_alone(&self, length: f64) -> f64 {
        let near = self.at.iter().filter(|(_, im)| *im > 0.0 && *im <= self.least);
        near.map(|(_, im)| im * im * (2.0 + (length / im).ln().max(0.0))).sum()
    }
}

/// Adaptive Gauss–Kronrod integration of h θ.
#[derive(Clone, Copy, Debug, Default)]
struct Panels {
    tolerance: f64,
    unit: f64,
    value: f64,
    error: f64,
    /// ∫ θ dt, for the rounding of h.
    angle: f64,
}

impl Panels {
    fn add(&mut self, lo: f64, hi: f64, singular: &Singularities, f: &impl Fn(f64) -> (f64, f64)) {
        let mut stack = [(0.0, 0.0, 0); DEPTH as usize + 1];
        stack[0] = (lo, hi, DEPTH);
        let mut count = 1;
        while count > 0 {
            count -= 1;
            let (lo, hi, depth) = stack[count];
            let mid = 0.5 * (lo + hi);
            let divisible = depth > 0 && lo < mid && mid < hi;
            if !(divisible && singular.too_near(lo, hi)) {
                let (value, error, angle) = kronrod(lo, hi, f);
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

/// Value, difference from the embedded rule, and integral of the second component.
fn kronrod(lo: f64, hi: f64, f: &impl Fn(f64) -> (f64, f64)) -> (f64, f64, f64) {
    let (mid, half) = (0.5 * (lo + hi), 0.5 * (hi - lo));
    let (mut fine, mut coarse, mut second) = (0.0, 0.0, 0.0);
    for &(x, w_fine, w_coarse) in &KRONROD {
        let (mut value, mut angle) = f(mid + half * x);
        if x > 0.0 {
            let (left, left_angle) = f(mid - half * x);
            value += left;
            angle += left_angle;
        }
        fine += w_fine * value;
        coarse += w_coarse * value;
        second += w_fine * angle;
    }
    let width = hi - lo;
    (fine * width, (fine - coarse).abs() * width, second * width)
}
