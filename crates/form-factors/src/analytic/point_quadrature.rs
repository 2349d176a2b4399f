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
//! i is cut across its longest edge into cells x(s, t), s along and t across, and these, where a corner of j or a crossing edge
//! stands before them, at its foot. A piece is bisected in one direction while it is more than four times as long, in that direction,
//! as its distance from what makes the integrand singular (see [`Singularities`], on three lines); then while the product of two
//! Gauss–Kronrod pairs errs too much, in the direction that errs more. Directions are apart, so a sliver along an edge is cut
//! across only. Towards a shared corner, where the point factor depends on the direction alone, pieces shrink in
//! proportion until their area is below the tolerance.
//!
//! # Bound
//!
//! A piece counts with the differences of both Gauss–Kronrod pairs, or its area if that is less (0 ≤ F_dA→j ≤ 1). An edge of j at a
//! distance g from a line of length L on i, g far below the tolerance by L or rounding, is left alone: the point factor differs from
//! its limit by O((g/r)²) at a distance r from the edge, which makes 2 g L. With the origin at a corner of the smaller polygon,
//! rounding moves a point x by ε |x|, and the line of edge k beside it by 2 ε times the distance of
//! its nearer end, r_k; so it turns ê_k by (|x| + 2 r_k) ε/h_k, with h_k the distance of the line. Per point that makes
//! ε/(2π) Σ_k γ_k [4 |n·ê_k| + √(1 − (n·ê_k)²) (|x| + 2 r_k)/h_k].

use std::f64::consts::TAU;

use glam::DVec3;

use super::area_quadrature::Bounded;
use super::gauss::KRONROD;
use super::singularities::{Edge, Singularities, edges};
use super::slabs::{Cell, area_vector, cells};

/// Pieces are at most this many times as long as their distance from a singularity.
const PANEL: f64 = 4.0;
/// Singularities nearer than this share of the tolerance by the length across are left alone.
const ALONE: f64 = 1.0 / 16.0;
/// A piece may err by the tolerance over this number.
const SHARES: f64 = 64.0;
/// Pieces a pair may cost; those left then count with their area.
const MAX_PIECES: usize = 1500;

/// A_i F_ij of two loops that lie in front of each other, from points of the smaller one, with a quadrature error of about
/// `tolerance` (an area).
pub(super) fn integrate(i: &[DVec3], j: &[DVec3], tolerance: f64) -> Bounded {
    let (vector_i, vector_j) = (area_vector(i), area_vector(j));
    let first = vector_i.length_squared() <= vector_j.length_squared();
    let (i, j, vector) = if first { (i, j, vector_i) } else { (j, i, vector_j) };
    // Clipping may leave a line, whose direction says nothing: the contour integral's bound is better.
    let Some(normal) = vector.try_normalize() else { return Bounded { value: 0.0, bound: f64::INFINITY } };
    let targets: Vec<Edge> = edges(j).filter_map(|(a, b)| Edge::new(a, b)).collect();
    let share = tolerance / SHARES;
    let (mut sum, mut rounding, mut count) = (Bounded::default(), 0.0, 0);
    for cell in cells(i, normal) {
        let Outlook { pieces: mut left, least, alone } = Outlook::new(&cell, &targets, tolerance);
        sum.bound += alone;
        while let Some(piece) = left.pop() {
            count += 1;
            let area = area_of(&cell, &piece);
            let divisible = area > share && count < MAX_PIECES;
            if divisible && let Some(direction) = too_long(&cell, &piece, &targets, least) {
                left.extend(piece.halves(direction));
                continue;
            }
            let found = product_rule(&cell, &piece, normal, &targets);
            let error = found.errors[0] + found.errors[1];
            if divisible && error > share.max(found.rounding) {
                left.extend(piece.halves(usize::from(found.errors[1] > found.errors[0])));
                continue;
            }
            sum.value += found.value;
            sum.bound += if count < MAX_PIECES { error.min(area) } else { area };
            rounding += found.rounding;
        }
    }
    Bounded { value: sum.value, bound: sum.bound + rounding + 4.0 * f64::EPSILON * sum.value.abs() }
}

/// Area of a piece.
fn area_of(cell: &Cell, piece: &Piece) -> f64 {
    let [[s0, s1], [t0, t1]] = piece.0;
    cell.jacobian(0.5 * (s0 + s1)) * (s1 - s0) * (t1 - t0)
}

fn line(cell: &Cell, direction: usize, across: f64) -> Option<Edge> {
    let (from, to) = cell.line(direction, across);
    Edge::new(from, to)
}

/// What is known of a cell before any integration.
struct Outlook {
    /// The cell, cut at the feet of what stands before its middle lines.
    pieces: Vec<Piece>,
    /// Distances up to which singularities are left alone, along s and along t.
    least: [f64; 2],
    /// What that leaves as error.
    alone: f64,
}

impl Outlook {
    fn new(cell: &Cell, targets: &[Edge], tolerance: f64) -> Self {
        let middle = [0, 1].map(|direction| line(cell, direction, 0.5));
        let length = |direction: usize| middle[direction].map_or(0.0, |line| line.length);
        let reach = cell.at(0.0, 0.0).length() + length(0) + length(1);
        let mut outlook = Self { pieces: Vec::new(), least: [0.0; 2], alone: 0.0 };
        let mut borders = [vec![0.0, 1.0], vec![0.0, 1.0]];
        for (direction, line) in middle.iter().enumerate() {
            let Some(line) = line else { continue };
            let across = length(1 - direction);
            let least = (ALONE * tolerance / across).max(2.0 * f64::EPSILON * reach);
            for target in targets {
                let singular = Singularities::new(line, target);
                borders[direction].extend(singular.borders(line.length).map(|re| re / line.length));
                let near = singular.0.iter().filter(|(_, im)| *im <= least);
                outlook.alone += near.map(|(_, im)| 2.0 * im * across).sum::<f64>();
            }
            outlook.least[direction] = least;
        }
        for borders in &mut borders {
            borders.sort_unstable_by(f64::total_cmp);
            borders.dedup();
        }
        let spans = |k: usize| borders[k].windows(2).map(|pair| [pair[0], pair[1]]);
        outlook.pieces = spans(0).flat_map(|s| spans(1).map(move |t| Piece([s, t]))).collect();
        outlook
    }
}

/// The direction in which a piece is too long for what is near it, if there is one; the longer one of two.
fn too_long(cell: &Cell, piece: &Piece, targets: &[Edge], least: [f64; 2]) -> Option<usize> {
    let length = |direction: usize| {
        let ([lo, hi], [from, to]) = (piece.0[direction], piece.0[1 - direction]);
        let lines = [from, 0.5 * (from + to), to].into_iter().filter_map(|across| line(cell, direction, across));
        let near = |line: Edge| {
            let (lo, hi, least) = (lo * line.length, hi * line.length, least[direction]);
            let near = targets.iter().any(|target| Singularities::new(&line, target).too_near(lo, hi, PANEL, least));
            near.then_some(hi - lo)
        };
        lines.filter_map(near).fold(0.0, f64::max)
    };
    let lengths = [length(0), length(1)];
    let longer = usize::from(lengths[1] > lengths[0]);
    (lengths[longer] > 0.0).then_some(longer)
}

/// Product of two Gauss–Kronrod rules over a piece.
fn product_rule(cell: &Cell, piece: &Piece, normal: DVec3, targets: &[Edge]) -> Found {
    let [[s0, s1], [t0, t1]] = piece.0;
    let mut found = Found::default();
    // Per line of constant s, differences of the pairs along it; per t, the differences across.
    let mut across = [0.0; 15];
    for (s, w_s, g_s) in nodes() {
        let s = s0 + (s1 - s0) * s;
        let jacobian = cell.jacobian(s);
        let (mut fine, mut coarse) = (0.0, 0.0);
        for (k, (t, w_t, g_t)) in nodes().enumerate() {
            let t = t0 + (t1 - t0) * t;
            let (factor, rounding) = point_factor(cell.at(s, t), normal, targets);
            let value = factor * jacobian;
            fine += w_t * value;
            coarse += g_t * value;
            across[k] += (w_s - g_s) * w_t * value;
            found.rounding += w_s * w_t * rounding * jacobian;
        }
        found.value += w_s * fine;
        found.errors[1] += w_s * (fine - coarse).abs();
    }
    found.errors[0] = across.iter().map(|x| x.abs()).sum();
    found.scaled((s1 - s0) * (t1 - t0))
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
