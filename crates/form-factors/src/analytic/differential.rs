//! Form factor from a point with a normal to a polygon, exact.

use std::f64::consts::TAU;

use glam::DVec3;
use radiosity_geometry::Polygon;

/// Form factor F_dA→j from a surface element at `point` with unit `normal` to the front of a convex polygon.
///
/// ```text
/// F_dA→j = 1/(2π) Σ_k n·(v_{k+1} × v_k)/|v_{k+1} × v_k| · γ_k,     γ_k = atan2(|v_{k+1} × v_k|, v_{k+1}·v_k)
/// ```
///
/// over the edges of the part above the element's horizon, with v_k from the element to the corners (Lambert 1760; Baum et
/// al. 1989). Unitless; 0 if the point lies behind the polygon or on its plane, edges included. Nothing else is in the way.
/// The angles keep full accuracy at any size and distance, but the sum cancels for polygons that look small: the error is
/// about 1e-16 absolute.
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
    let mut sum = 0.0;
    // Where the loop goes below the horizon and where it comes up again; a convex loop does each at most once.
    let (mut exit, mut entry) = (None, None);
    for k in 0..corners.len() {
        let (a, b) = (corners[k] - point, corners[(k + 1) % corners.len()] - point);
        let (h_a, h_b) = (a.dot(normal), b.dot(normal));
        // From the upper end both ways, so that exact corners on the horizon stay where they are.
        match (h_a >= 0.0, h_b >= 0.0) {
            (true, true) => sum += edge(a, b, normal),
            (true, false) => {
                let c = a + (b - a) * (h_a / (h_a - h_b));
                sum += edge(a, c, normal);
                exit = Some(c);
            }
            (false, true) => {
                let c = b + (a - b) * (h_b / (h_b - h_a));
                sum += edge(c, b, normal);
                entry = Some(c);
            }
            (false, false) => {}
        }
    }
    if let (Some(exit), Some(entry)) = (exit, entry) {
        sum += edge(exit, entry, normal);
    }
    (sum / TAU).max(0.0)
}

/// One edge's share of 2π F; an edge that is seen end-on spans no angle.
fn edge(a: DVec3, b: DVec3, normal: DVec3) -> f64 {
    let cross = b.cross(a);
    let sine = cross.length();
    if sine > 0.0 { normal.dot(cross) / sine * sine.atan2(a.dot(b)) } else { 0.0 }
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

    #[test]
    fn the_back_of_a_polygon_is_not_seen() {
        let away = polygon(&[(0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, 1.0), (0.0, 1.0, 1.0)]);
        assert_eq!(differential(DVec3::ZERO, DVec3::Z, &away), 0.0);
    }
}
