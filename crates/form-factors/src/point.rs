//! Form factors from a point with a normal to facets among blockers, exact: nothing is sampled.
//!
//! Seen from a point, a convex blocker hides what lies behind it inside its cone, which the planes through the point and its edges
//! bound. Cutting the cones out of a target leaves convex parts, and the form factor is the sum over them of the closed form
//! [`differential`]. No blocker is missed, however small. The work grows like targets × blockers.

use glam::DVec3;
use radiosity_geometry::{Facets, Polygon};
use rayon::prelude::*;

use crate::analytic::differential;

/// Rounding of a point computed from scene coordinates, in units of ε times the largest coordinate.
const ROUNDING: f64 = 16.0;

/// Form factor F_dA→j from a surface element at `point` with unit `normal` to every group of `targets`, what `blockers` hide left
/// out.
///
/// ```text
/// F_dA→j = ∫_j max(cos θ, 0) max(cos θ_j, 0) V / (π r²) dA_j
/// ```
///
/// Unitless. Targets show their front alone, blockers hide with both sides; targets may be among the blockers. As everywhere a
/// polygon whose plane contains the point, or the part of the target at hand, does not block. The error is about 1e-16 for every
/// part that is left of a target, and where cuts are nearly edge-on the rounding of the blocker's corners as seen from the point.
///
/// # Panics
///
/// If `normal` is no unit vector to 1e-9.
///
/// # Examples
///
/// A lid at height 2, half of it hidden by a baffle at height 1:
///
/// ```
/// # use radiosity_form_factors::point::form_factors_from;
/// # use radiosity_geometry::{Facets, Polygon};
/// # use glam::DVec3;
/// let square = |lo: (f64, f64), hi: (f64, f64), z| {
///     Polygon::new(&[(lo.0, lo.1), (lo.0, hi.1), (hi.0, hi.1), (hi.0, lo.1)].map(|(x, y)| DVec3::new(x, y, z)))
/// };
/// let mut lid = Facets::new();
/// lid.push(vec![square((-2.0, -2.0), (2.0, 2.0), 2.0)?], false);
/// let open = form_factors_from(DVec3::ZERO, DVec3::Z, &lid, &[])[0];
/// let baffle = square((0.0, -9.0), (9.0, 9.0), 1.0)?;
/// assert!((form_factors_from(DVec3::ZERO, DVec3::Z, &lid, &[baffle])[0] - 0.5 * open).abs() < 1e-15);
/// # Ok::<(), radiosity_geometry::PolygonError>(())
/// ```
pub fn form_factors_from(point: DVec3, normal: DVec3, targets: &Facets, blockers: &[Polygon]) -> Vec<f64> {
    assert!((normal.length() - 1.0).abs() < 1e-9, "normal of length {}", normal.length());
    let polygons = targets.iter_polygons().map(|(_, p)| p).chain(blockers);
    let corners = polygons.flat_map(|p| p.vertices().iter().copied()).chain([point]);
    let rounding = ROUNDING * f64::EPSILON * corners.map(|v| v.abs().max_element()).fold(0.0, f64::max);
    let shadows: Vec<Shadow> = blockers.iter().filter_map(|b| Shadow::cast(point, normal, b, rounding)).collect();
    let from = |k: usize| {
        if targets.covered(k) {
            return 0.0;
        }
        let sum: f64 = targets.polygons(k).iter().map(|p| visible(point, normal, p, &shadows)).sum();
        // Rounding aside, that much is all there is.
        sum.min(1.0)
    };
    (0..targets.len()).into_par_iter().map(from).collect()
}

/// The form factor to the part of `target` that no shadow covers.
fn visible(point: DVec3, normal: DVec3, target: &Polygon, shadows: &[Shadow]) -> f64 {
    let mut sum = differential(point, normal, target);
    if sum == 0.0 {
        return 0.0;
    }
    let mut parts = vec![target.clone()];
    for shadow in shadows {
        if parts.iter().all(|part| shadow.misses(point, part)) {
            continue;
        }
        let mut left = Vec::with_capacity(parts.len() + 4);
        parts.into_iter().for_each(|part| shadow.cut(point, part, &mut left));
        parts = left;
        sum = parts.iter().map(|part| differential(point, normal, part)).sum();
        if sum == 0.0 {
            return 0.0;
        }
    }
    sum
}

/// What a blocker hides from a point.
struct Shadow {
    /// Inward unit normals of the planes through the point and the blocker's edges.
    sides: Vec<DVec3>,
    /// A point of the blocker's plane.
    corner: DVec3,
    /// Unit normal of that plane, towards the point.
    towards: DVec3,
    /// Distances from planes that rounding may make.
    slack: f64,
}

impl Shadow {
    /// The shadow of `blocker`; `None` if its plane contains the point or it lies below the horizon.
    fn cast(point: DVec3, normal: DVec3, blocker: &Polygon, rounding: f64) -> Option<Self> {
        let slack = rounding + 2.0 * blocker.thickness();
        let height = blocker.signed_distance(point);
        if height.abs() <= slack || blocker.vertices().iter().all(|v| (*v - point).dot(normal) <= slack) {
            return None;
        }
        let middle = blocker.centroid() - point;
        let side = |(a, b): (DVec3, DVec3)| {
            let plane = (a - point).cross(b - point).try_normalize()?;
            // Whichever side of the blocker the point sees.
            Some(if plane.dot(middle) < 0.0 { -plane } else { plane })
        };
        let sides = blocker.edges().filter_map(side).collect();
        Some(Self { sides, corner: blocker.centroid(), towards: blocker.normal() * height.signum(), slack })
    }

    /// Whether no vertex of `part` lies behind the blocker, or all lie outside one side of the cone.
    fn misses(&self, point: DVec3, part: &Polygon) -> bool {
        let vertices = part.vertices();
        vertices.iter().all(|v| (*v - self.corner).dot(self.towards) >= -self.slack)
            || self.sides.iter().any(|side| vertices.iter().all(|v| (*v - point).dot(*side) <= self.slack))
    }

    /// Puts what the shadow leaves of `part` into `left`.
    fn cut(&self, point: DVec3, part: Polygon, left: &mut Vec<Polygon>) {
        if self.misses(point, &part) {
            left.push(part);
            return;
        }
        let (mut inside, mut outside) = (part.clone(), Vec::new());
        for &side in &self.sides {
            if let Some((within, beyond)) = inside.split(point, side, self.slack) {
                outside.push(beyond);
                inside = within;
            } else if (inside.centroid() - point).dot(side) < 0.0 {
                // Nothing with an area lies inside this side, so nothing is hidden.
                left.push(part);
                return;
            }
        }
        left.append(&mut outside);
        // Inside the cone what lies before the blocker is seen.
        if let Some((before, _)) = inside.split(self.corner, self.towards, self.slack) {
            left.push(before);
        } else if (inside.centroid() - self.corner).dot(self.towards) >= 0.0 {
            left.push(inside);
        }
    }
}
