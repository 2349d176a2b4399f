//! Slivers and patches of very unequal size: exact point factors, integrated over the smaller polygon.
//!
//! ```text
//! A_i F_ij = ∫_i F_dA→j dA_i,     F_dA→j = 1/(2π) Σ_k n_i·ê_k γ_k
//! ```
//!
//! over the edges of j, with ê_k the unit normal of the plane through the point and edge k, and γ_k the angle under which the edge
//! is seen. No difference of large terms is left: rounding is about 1e-16 of the area of the smaller polygon, however thin
//! or small it is.
//!
//! i is cut into cells x(s, t) = x₀ + s u + t v + s t w over [0, 1]² and these, where a corner of j or a crossing edge stands before
//! them, at its foot. A piece is bisected in one direction while it is more than eight times as long, in that direction,
//! as its distance from what makes the integrand singular (see [`Singularities`], on three lines); then while the product of two
//! Gauss–Kronrod pairs errs too much, in the direction that errs more. Directions are apart, so a sliver along an edge is cut
//! across only. Towards a shared corner, where the point factor depends on the direction alone, pieces shrink in
//! proportion until their area is below the tolerance.
//!
//! # Bound
//!
//! A piece counts with the differences of both Gauss–Kronrod pairs, or its area if that is less (0 ≤ F_dA→j ≤ 1). With the origin
//! at a corner of the smaller polygon, rounding moves a point x by ε |x|, and the line of edge k beside it by 2 ε times the distance of
//! its nearer end, r_k; so it turns ê_k by (|x| + 2 r_k) ε/h_k, with h_k the distance of the line. Per point that makes
//! ε/(2π) Σ_k γ_k [4 |n·ê_k| + √(1 − (n·ê_k)²) (|x| + 2 r_k)/h_k].

use std::f64::consts::TAU;

use glam::DVec3;

use super::area_quadrature::Bounded;
use super::gauss::KRONROD;
use super::singularities::{Edge, Singularities, edges};

/// Pieces are at most this many times as long as their distance from a singularity.
const PANEL: f64 = 8.0;
/// A piece may err by the tolerance over this number.
const SHARES: f64 = 64.0;
/// Pieces a pair may cost; those left then count with their area.
const MAX_PIECES: usize = 4000;

/// A_i F_ij of two loops that lie in front of each other, from points of the smaller one, with a quadrature error of about
/// `tolerance` (an area).
pub(super) fn integrate(i: &[DVec3], j: &[DVec3], tolerance: f64) -> Bounded {
    let (vector_i, vector_j) = (area_vector(i), area_vector(j));
    let first = vector_i.length_squared() <= vector_j.length_squared();
    let (i, j, vector) = if first { (i, j, vector_i) } else { (j, i, vector_j) };
    let normal = vector / vector.length();
    let targets: Vec<Edge> = edges(j).filter_map(|(a, b)| Edge::new(a, b)).collect();
    let share = tolerance / SHARES;
    let (mut sum, mut rounding, mut count) = (Bounded::default(), 0.0, 0);
    for cell in cells(i, normal) {
        let mut pieces = cell.pieces(&targets);
        while let Some(piece) = pieces.pop() {
            count += 1;
            let area = cell.area_of(&piece);
            let divisible = area > share && count < MAX_PIECES;
            if divisible && let Some(direction) = cell.too_long(&piece, &targets) {
                pieces.extend(piece.halves(direction));
                continue;
            }
            let found = cell.integrate(&piece, normal, &targets);
            let error = found.errors[0] + found.errors[1];
            if divisible && error > share.max(found.rounding) {
                pieces.extend(piece.halves(usize::from(found.errors[1] > found.errors[0])));
                continue;
            }
            sum.value += found.value;
            sum.bound += error.min(area);
            rounding += found.rounding;
        }
    }
    Bounded { value: sum.value, bound: sum.bound + rounding + 4.0 * f64::EPSILON * sum.value.abs() }
}

/// a × b, every component to full relative accuracy: the normal of a sliver is a difference of nearly equal products.
fn cross(a: DVec3, b: DVec3) -> DVec3 {
    let difference = |a: f64, b: f64, c: f64, d: f64| {
        let cd = c * d;
        a.mul_add(b, -cd) - c.mul_add(d, -cd)
    };
    DVec3::new(difference(a.y, b.z, a.z, b.y), difference(a.z, b.x, a.x, b.z), difference(a.x, b.y, a.y, b.x))
}

fn area_vector(corners: &[DVec3]) -> DVec3 {
    corners.windows(2).map(|pair| cross(pair[0] - corners[0], pair[1] - corners[0])).sum::<DVec3>() * 0.5
}

/// A convex quadrilateral or triangle as x(s, t) = x₀ + s u + t v + s t w over [0, 1]²: from a corner, so that thin ones keep
/// the digits of their width.
#[derive(Clone, Copy, Debug)]
struct Cell {
    x0: DVec3,
    /// u and v.
    along: [DVec3; 2],
    w: DVec3,
    /// Area per ds dt: j₀ + s j_s + t j_t.
    j0: f64,
    slopes: [f64; 2],
}

/// Quadrilaterals of a fan, and a triangle if one is left over.
fn cells(corners: &[DVec3], n: DVec3) -> impl Iterator<Item = Cell> + '_ {
    (1..corners.len() - 1).step_by(2).map(move |k| {
        let (a, b, c) = (corners[0], corners[k], corners[k + 1]);
        let d = corners.get(k + 2).copied().unwrap_or(a);
        let (u, v) = (b - a, d - a);
        let w = (c - b) - v;
        let slopes = [n.dot(cross(u, w)), n.dot(cross(w, v))];
        Cell { x0: a, along: [u, v], w, j0: n.dot(cross(u, v)), slopes }
    })
}

impl Cell {
    fn at(&self, s: f64, t: f64) -> DVec3 {
        self.x0 + self.along[0] * s + self.along[1] * t + self.w * (s * t)
    }

    fn jacobian(&self, s: f64, t: f64) -> f64 {
        self.j0 + self.slopes[0] * s + self.slopes[1] * t
    }

    fn area_of(&self, piece: &Piece) -> f64 {
        let [[s0, s1], [t0, t1]] = piece.0;
        self.jacobian(0.5 * (s0 + s1), 0.5 * (t0 + t1)).abs() * (s1 - s0) * (t1 - t0)
    }

    /// The line with the other coordinate at `across`, along `direction` from 0 to 1.
    fn line(&self, direction: usize, across: f64) -> Option<Edge> {
        let from = self.x0 + self.along[1 - direction] * across;
        Edge::new(from, from + self.along[direction] + self.w * across)
    }

    /// The cell, cut at the feet of what stands before its middle lines.
    fn pieces(&self, targets: &[Edge]) -> Vec<Piece> {
        let borders = [0, 1].map(|direction| {
            let mut borders = vec![0.0, 1.0];
            if let Some(line) = self.line(direction, 0.5) {
                for target in targets {
                    borders.extend(Singularities::new(&line, target).borders(line.length).map(|re| re / line.length));
                }
            }
            borders.sort_unstable_by(f64::total_cmp);
            borders.dedup();
            borders
        });
        let spans = |k: usize| borders[k].windows(2).map(|pair| [pair[0], pair[1]]);
        spans(0).flat_map(|s| spans(1).map(move |t| Piece([s, t]))).collect()
    }

    /// The direction in which a piece is too long for what is near it, if there is one.
    fn too_long(&self, piece: &Piece, targets: &[Edge]) -> Option<usize> {
        (0..2).find(|&direction| {
            let ([lo, hi], [from, to]) = (piece.0[direction], piece.0[1 - direction]);
            [from, 0.5 * (from + to), to].into_iter().filter_map(|across| self.line(direction, across)).any(|line| {
                let (lo, hi) = (lo * line.length, hi * line.length);
                targets.iter().any(|target| Singularities::new(&line, target).too_near(lo, hi, PANEL, 0.0))
            })
        })
    }

    /// Product of two Gauss–Kronrod rules over a piece.
    fn integrate(&self, piece: &Piece, normal: DVec3, targets: &[Edge]) -> Found {
        let [[s0, s1], [t0, t1]] = piece.0;
        let mut found = Found::default();
        // Per line of constant s, differences of the pairs along it; per t, the differences across.
        let mut across = [0.0; 15];
        for (s, w_s, g_s) in nodes() {
            let s = s0 + (s1 - s0) * s;
            let (mut fine, mut coarse) = (0.0, 0.0);
            for (k, (t, w_t, g_t)) in nodes().enumerate() {
                let t = t0 + (t1 - t0) * t;
                let (factor, rounding) = point_factor(self.at(s, t), normal, targets);
                let value = factor * self.jacobian(s, t);
                fine += w_t * value;
                coarse += g_t * value;
                across[k] += (w_s - g_s) * w_t * value;
                found.rounding += w_s * w_t * rounding * self.jacobian(s, t).abs();
            }
            found.value += w_s * fine;
            found.errors[1] += w_s * (fine - coarse).abs();
        }
        found.errors[0] = across.iter().map(|x| x.abs()).sum();
        found.scaled((s1 - s0) * (t1 - t0))
    }
}

/// Ranges of s and t.
#[derive(Clone, Copy, Debug)]
struct Piece([[f64; 2]; 2]);

impl Piece {
    fn halves(self, direction: usize) -> [Self; 2] {
        let (mut low, mut high) = (self, self);
        let [lo, hi] = self.0[direction];
        (low.0[direction][1], high.0[direction][0]) = (0.5 * (lo + hi), 0.5 * (lo + hi));
        [high, low]
    }
}

/// What a product rule found.
#[derive(Clone, Copy, Debug, Default)]
struct Found {
    value: f64,
    /// Differences of the pairs along s and along t.
    errors: [f64; 2],
    rounding: f64,
}

impl Found {
    fn scaled(self, by: f64) -> Self {
        Self { value: self.value * by, errors: self.errors.map(|error| error * by), rounding: self.rounding * by }
    }
}

/// Nodes in [0, 1], Kronrod and Gauss weights, in order.
fn nodes() -> impl Iterator<Item = (f64, f64, f64)> {
    let half = |sign: f64| move |&(x, w, g): &(f64, f64, f64)| (0.5 + 0.5 * sign * x, w, g);
    KRONROD[1..].iter().rev().map(half(-1.0)).chain(KRONROD.iter().map(half(1.0)))
}

/// F_dA→j at x, and a bound on its rounding.
fn point_factor(x: DVec3, normal: DVec3, targets: &[Edge]) -> (f64, f64) {
    let (mut sum, mut rounding) = (0.0, 0.0);
    let moved = x.length();
    for edge in targets {
        let (a, b) = (edge.a - x, edge.b - x);
        let (a2, b2) = (a.length_squared(), b.length_squared());
        // b × a = L u × a = L u × b: from the nearer end.
        let across = edge.u.cross(if a2 <= b2 { a } else { b });
        let h = across.length();
        if h > 0.0 {
            let gamma = (h * edge.length).atan2(a.dot(b));
            let cosine = normal.dot(across) / h;
            sum += cosine * gamma;
            let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
            rounding += gamma * (4.0 * cosine.abs() + sine * (moved + 2.0 * a2.min(b2).sqrt()) / h);
        }
    }
    (sum / TAU, rounding * f64::EPSILON / TAU)
}
