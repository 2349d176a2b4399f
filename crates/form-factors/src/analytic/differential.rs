//! Form factor from a point with a normal to a polygon, exact.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use radiosity_geometry::Polygon;

use super::gauss::gauss;
use super::slabs::cells;

/// Form factor F_dA→j from a surface element at `point` with unit `normal` to the front of a convex polygon.
///
/// ```text
/// F_dA→j = 1/(2π) Σ_k n·(v_{k+1} × v_k)/|v_{k+1} × v_k| · γ_k,     γ_k = atan2(|v_{k+1} × v_k|, v_{k+1}·v_k)
/// ```
///
/// over the edges of the part above the element's horizon, with v_k from the element to the corners (Lambert 1760; Baum et
/// al. 1989). Unitless; 0 if the point lies behind the polygon or on its plane, edges included. Nothing else is in the way.
/// The sum cancels for polygons that look small: its error is about 1e-16 of the angle under which the polygon is seen, η.
/// Where η is at most 0.01 the kernel cos θ cos θ'/(π r²) is integrated over the polygon by a Gauss rule of 4 × 4 points a
/// quadrilateral instead, whose own error is below 1e-16 relative. So what is about as wide as long has 14 digits at
/// any distance. Slivers keep the absolute error of 1e-16.
///
/// # Examples
///
/// An element under a corner of a parallel 1 × 2 rectangle at distance 1.5:
///
/// ```
/// # use radiosity_form_factors::analytic::differential;
/// # use radiosity_geometry::Polygon;
/// # use glam::DVec3;
/// let ceiling = [(0.0, 0.0), (0.0, 2.0), (1.0, 2.0), (1.0, 0.0)].map(|(x, y)| DVec3::new(x, y, 1.5));
/// let f = differential(DVec3::ZERO, DVec3::Z, &Polygon::new(&ceiling)?);
/// assert!((f - 0.122_359_661_642_333_07).abs() < 1e-15);
/// # Ok::<(), radiosity_geometry::PolygonError>(())
/// ```
pub fn differential(point: DVec3, normal: DVec3, polygon: &Polygon) -> f64 {
    let corners = polygon.vertices();
    if (point - corners[0]).dot(polygon.normal()) <= 0.0 {
        return 0.0;
    }
    let distance = (polygon.centroid() - point).length();
    if polygon.diameter() <= SMALL * distance {
        return seen_small(point, normal, polygon);
    }
    let mut sum = 0.0;
    // Where the loop goes below the horizon and where it comes up again; a convex loop does each at most once.
    let (mut exit, mut entry) = (None, None);
    for (start, end) in polygon.edges() {
        let (a, b, along) = (start - point, end - point, end - start);
        let (h_a, h_b) = (a.dot(normal), b.dot(normal));
        // From the upper end both ways, so that exact corners on the horizon stay where they are.
        match (h_a >= 0.0, h_b >= 0.0) {
            (true, true) => sum += edge(a, b, along, normal),
            (true, false) => {
                let c = a + along * (h_a / (h_a - h_b));
                sum += edge(a, c, along * (h_a / (h_a - h_b)), normal);
                exit = Some(c);
            }
            (false, true) => {
                let c = b - along * (h_b / (h_b - h_a));
                sum += edge(c, b, along * (h_b / (h_b - h_a)), normal);
                entry = Some(c);
            }
            (false, false) => {}
        }
    }
    if let (Some(exit), Some(entry)) = (exit, entry) {
        sum += edge(exit, entry, entry - exit, normal);
    }
    (sum / TAU).max(0.0)
}

/// One edge's share of 2π F, from a along `along` to b; an edge that is seen end-on spans no angle.
///
/// b × a = along × a = along × b, from the nearer end: the difference of the corners is exact where b − a has rounding of
/// the distance.
fn edge(a: DVec3, b: DVec3, along: DVec3, normal: DVec3) -> f64 {
    let cross = along.cross(if a.length_squared() <= b.length_squared() { a } else { b });
    let sine = cross.length();
    if sine > 0.0 { normal.dot(cross) / sine * sine.atan2(a.dot(b)) } else { 0.0 }
}

/// Diameter by distance up to which the kernel is integrated: with h/D ≤ 0.005 the rule of order [`ORDER`] leaves
/// c₈ (h/D)⁸ < 1e-16 (see `area_quadrature`).
const SMALL: f64 = 0.01;
const ORDER: usize = 4;

/// The kernel integrated over the part of a polygon above the horizon.
fn seen_small(point: DVec3, normal: DVec3, polygon: &Polygon) -> f64 {
    let Some(seen) = polygon.clip(point, normal) else { return 0.0 };
    let corners: Vec<DVec3> = seen.vertices().iter().map(|v| *v - point).collect();
    let height = (point - polygon.vertices()[0]).dot(polygon.normal());
    let (x, w) = gauss(ORDER);
    let mut sum = 0.0;
    for cell in cells(&corners, polygon.normal()) {
        for (s, w_s) in x.iter().zip(w) {
            for (t, w_t) in x.iter().zip(w) {
                let (s, t) = (0.5 + 0.5 * s, 0.5 + 0.5 * t);
                let to = cell.at(s, t);
                let r2 = to.length_squared();
                sum += w_s * w_t * cell.jacobian(s) * to.dot(normal).max(0.0) / (r2 * r2);
            }
        }
    }
    sum * height / PI
}

#[cfg(test)]
mod tests {
    use super::*;

    fn polygon(corners: &[(f64, f64, f64)]) -> Polygon {
        Polygon::new(&corners.iter().map(|&(x, y, z)| DVec3::new(x, y, z)).collect::<Vec<_>>()).unwrap()
    }

    /// A wall that rises from the floor, seen from its foot's middle line at distance 1: the part below the floor adds
    /// nothing, so the wall that reaches down gives the same to rounding.
    #[test]
    fn what_lies_below_the_horizon_adds_nothing() {
        let above = polygon(&[(1.0, -1.0, 0.0), (1.0, -1.0, 2.0), (1.0, 1.0, 2.0), (1.0, 1.0, 0.0)]);
        let through = polygon(&[(1.0, -1.0, -3.0), (1.0, -1.0, 2.0), (1.0, 1.0, 2.0), (1.0, 1.0, -3.0)]);
        let (a, b) = (differential(DVec3::ZERO, DVec3::Z, &above), differential(DVec3::ZERO, DVec3::Z, &through));
        assert!(a > 0.1 && (a - b).abs() < 1e-15);
    }

    /// The faces of a cube fill the half-space of a point on the floor; 5 faces of 4 edges round to about 1e-15.
    #[test]
    fn faces_of_a_cube_sum_to_one_from_a_point_of_its_floor() {
        let faces = [
            polygon(&[(0.0, 0.0, 1.0), (0.0, 1.0, 1.0), (1.0, 1.0, 1.0), (1.0, 0.0, 1.0)]),
            polygon(&[(0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 1.0), (0.0, 0.0, 1.0)]),
            polygon(&[(1.0, 0.0, 0.0), (1.0, 0.0, 1.0), (1.0, 1.0, 1.0), (1.0, 1.0, 0.0)]),
            polygon(&[(0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (1.0, 0.0, 0.0)]),
            polygon(&[(0.0, 1.0, 0.0), (1.0, 1.0, 0.0), (1.0, 1.0, 1.0), (0.0, 1.0, 1.0)]),
        ];
        let sum: f64 = faces.iter().map(|face| differential(DVec3::new(0.3, 0.1, 0.0), DVec3::Z, face)).sum();
        assert!((sum - 1.0).abs() < 3e-15);
    }

    /// A square of side 2a straight ahead at distance 1: F = (4/π) a/√(1 + a²) · atan(a/√(1 + a²)), a product without
    /// cancellation. The edges round to 1e-16 of the angle 2a, and below 0.01 the kernel is integrated.
    #[test]
    fn squares_keep_13_digits_however_small_they_look() {
        for step in 0..80 {
            let a = 0.7_f64.powi(step);
            let square = polygon(&[(-a, -a, 1.0), (-a, a, 1.0), (a, a, 1.0), (a, -a, 1.0)]);
            let x = a / a.hypot(1.0);
            let truth = 4.0 / std::f64::consts::PI * x * x.atan();
            let f = differential(DVec3::ZERO, DVec3::Z, &square);
            assert!((f / truth - 1.0).abs() < 1e-13, "a = {a:e}: {:e}", f / truth - 1.0);
        }
    }

    /// Aslant, over the horizon and far from the origin both routes give the same parts: their borders are at a hundredth
    /// of the distance, which the halves pass one step after the whole. Rounding of the corners at 4096 is 1e-12 of the size 0.5.
    #[test]
    fn halves_make_a_whole_at_any_distance() {
        let away = DVec3::splat(4096.0);
        for step in 0..30 {
            let point = DVec3::new(1.0, 0.5, 0.125) * 1.5_f64.powi(step);
            let part = |x0: f64, x1: f64| {
                let corners =
                    [(x0, 0.0), (x1, 0.0), (x1, 0.5), (x0, 0.5)].map(|(x, y)| DVec3::new(0.25 * x, x, y) + away);
                Polygon::new(&corners).unwrap()
            };
            let normal = DVec3::new(-0.6, 0.0, 0.8);
            let f = |p: &Polygon| differential(point + away, normal, p);
            let (whole, halves) = (f(&part(0.0, 0.5)), f(&part(0.0, 0.25)) + f(&part(0.25, 0.5)));
            assert!((whole - halves).abs() <= 1e-12 * whole, "step {step}: {whole:e}, {halves:e}");
        }
    }

    #[test]
    fn the_back_of_a_polygon_is_not_seen() {
        let away = polygon(&[(0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, 1.0), (0.0, 1.0, 1.0)]);
        assert_eq!(differential(DVec3::ZERO, DVec3::Z, &away), 0.0);
    }
}
