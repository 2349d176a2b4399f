//! A_i F_ij of two convex polygons with nothing between them: clipping at the horizons, then the cheapest rule that
//! meets the tolerance.

use radiosity_core::Cost;
use radiosity_geometry::Polygon;

use super::area_quadrature::{self, Bounded};
use super::contour::{self, perimeter};
use super::pair::FacingPair;
use super::point_quadrature;
use crate::Estimate;

/// Relative error asked for, as a multiple of the absolute tolerance on F: far pairs, whose F may lie below the tolerance,
/// keep 7 digits at the default 1e-10.
pub(super) const RELATIVE: f64 = 1e3;
/// Error as a share of the smaller area below which nothing is gained: a few times the rounding of the contour rule for
/// squares.
const LEAST: f64 = 4e-14;
/// Bounds of the rounding, as a share of the smaller area and of the value, up to which the contour rule is kept whatever the
/// tolerance: the error itself is a hundredth.
const FINE: f64 = 1e-11;
const FINE_RELATIVE: f64 = 1e-7;

/// A_i F_ij of two convex polygons, as if nothing lay between them.
///
/// ```text
/// A_i F_ij = ∫_i ∫_j max(cos θ_i, 0) max(cos θ_j, 0) / (π r²) dA_j dA_i
/// ```
///
/// Parts behind the other polygon's plane are cut off first. The error is at most `tolerance` · min(A_i, A_j), and
/// about 1000 · `tolerance` relative, unless rounding is larger: about 1e-13 of the smaller area, for slivers and patches of
/// very unequal size as well, and more where rounding of the corners themselves matters. [`Estimate::bound`] holds the bound of the rule used and of rounding.
pub fn unoccluded(i: &Polygon, j: &Polygon, tolerance: f64) -> Estimate {
    let Some(pair) = FacingPair::new(i, j) else { return Estimate::default() };
    let Bounded { value, bound } = exchange_area(&pair, i.area().min(j.area()), tolerance);
    Estimate { value, bound, cost: Cost { form_factors: 1, ..Cost::default() } }
}

/// [`unoccluded`] of a pair that is already clipped; `smaller` is the smaller of the whole areas.
pub(super) fn exchange_area(pair: &FacingPair, smaller: f64, tolerance: f64) -> Bounded {
    let (absolute, relative) = (tolerance * smaller, (RELATIVE * tolerance).min(1.0));
    let found =
        area_quadrature::integrate(pair, absolute, relative).unwrap_or_else(|| near(pair, smaller, absolute, relative));
    // Moving the corners of a polygon by δ moves A_i F_ij by at most the area its border sweeps: so much is open where
    // corners miss a common plane, or the other's.
    let moved = pair.thickness + pair.misplaced;
    let uneven = if moved > 0.0 { moved * perimeter(&pair.i).min(perimeter(&pair.j)) } else { 0.0 };
    // 0 ≤ A_i F_ij ≤ min(A_i, A_j): cutting at a limit that the truth keeps only brings the value nearer.
    Bounded { value: found.value.clamp(0.0, smaller), bound: found.bound + uneven }
}

/// The contour rule; once more where the value turns out to be so small that the absolute tolerance says little; and by point
/// factors where its rounding is too much for the smaller polygon.
fn near(pair: &FacingPair, smaller: f64, absolute: f64, relative: f64) -> Bounded {
    let mut contour = contour::integrate(&pair.i, &pair.j, absolute);
    let value = contour.value.max(0.0);
    let wanted = absolute.min(relative * value).max(LEAST * smaller);
    if contour.quadrature > wanted {
        contour = contour::integrate(&pair.i, &pair.j, 0.5 * wanted);
    }
    let found = Bounded::from(contour);
    if contour.rounding <= wanted.max((FINE * smaller).min(FINE_RELATIVE * value)) {
        return found;
    }
    let other = point_quadrature::integrate(&pair.i, &pair.j, 0.5 * wanted);
    if other.bound < found.bound { other } else { found }
}
