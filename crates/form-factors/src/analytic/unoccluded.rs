//! A_i F_ij of two convex polygons with nothing between them: clipping at the horizons, then the cheapest rule that
//! meets the tolerance.

use radiosity_core::Cost;
use radiosity_geometry::Polygon;

use super::area_quadrature::{self, Bounded};
use super::contour::{self, perimeter};
use super::pair::FacingPair;
use crate::Estimate;

/// Relative error asked for, as a multiple of the absolute tolerance on F: far pairs, whose F may lie below the tolerance,
/// keep 7 digits at the default 1e-10.
pub(super) const RELATIVE: f64 = 1e3;

/// A_i F_ij of two convex polygons, as if nothing lay between them.
///
/// ```text
/// A_i F_ij = ∫_i ∫_j max(cos θ_i, 0) max(cos θ_j, 0) / (π r²) dA_j dA_i
/// ```
///
/// Parts behind the other polygon's plane are cut off first. The error is at most `tolerance` · min(A_i, A_j), and
/// about 1000 · `tolerance` relative, unless rounding is larger: about 1e-15 of the product of the diameters for near pairs.
/// [`Estimate::bound`] holds the bound of the rule used and of rounding.
pub fn unoccluded(i: &Polygon, j: &Polygon, tolerance: f64) -> Estimate {
    let Some(pair) = FacingPair::new(i, j) else { return Estimate::default() };
    let Bounded { value, bound } = exchange_area(&pair, i.area().min(j.area()), tolerance);
    Estimate { value, bound, cost: Cost { form_factors: 1, ..Cost::default() } }
}

/// [`unoccluded`] of a pair that is already clipped; `smaller` is the smaller of the whole areas.
pub(super) fn exchange_area(pair: &FacingPair, smaller: f64, tolerance: f64) -> Bounded {
    let (absolute, relative) = (tolerance * smaller, (RELATIVE * tolerance).min(1.0));
    let found = area_quadrature::integrate(pair, absolute, relative).unwrap_or_else(|| near(pair, absolute, relative));
    // Moving the corners of a polygon by δ moves A_i F_ij by at most the area its border sweeps: so much is open where
    // corners miss a common plane.
    let uneven = if pair.thickness > 0.0 { pair.thickness * perimeter(&pair.i).min(perimeter(&pair.j)) } else { 0.0 };
    // 0 ≤ A_i F_ij ≤ min(A_i, A_j): cutting at a limit that the truth keeps only brings the value nearer.
    Bounded { value: found.value.clamp(0.0, smaller), bound: found.bound + uneven }
}

/// The contour rule, once more where the value turns out to be so small that the absolute tolerance says little.
fn near(pair: &FacingPair, absolute: f64, relative: f64) -> Bounded {
    let first = contour::integrate(&pair.i, &pair.j, absolute);
    let wanted = relative * first.value;
    if first.bound <= wanted || wanted >= absolute || first.value <= 0.0 {
        return first;
    }
    let second = contour::integrate(&pair.i, &pair.j, 0.5 * wanted);
    if second.bound < first.bound { second } else { first }
}
