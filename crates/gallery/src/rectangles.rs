//! Differential form factors from a point to rectangles that are parallel or perpendicular to its plane.
//!
//! Both are the fraction of the power leaving an infinitesimal element that arrives at the rectangle (J. R. Howell,
//! *A Catalog of Radiation Heat Transfer Configuration Factors*, B-3 and B-4), written for one corner so that any
//! rectangle is a sum over its corners. Independent of the estimators: these are the truths they are measured with.

use std::f64::consts::PI;

/// Form factor to a rectangle 0 … `x` by 0 … `y` in the parallel plane at distance `c`, its corner on the normal.
///
/// With X = x/c and Y = y/c,
///
/// ```text
/// F = 1/(2π) · { X/√(1+X²)·atan(Y/√(1+X²)) + Y/√(1+Y²)·atan(X/√(1+Y²)) }
/// ```
///
/// Odd in x and in y, so that differences over the corners give any rectangle. Lengths share any one unit; `c` is
/// positive.
pub fn parallel_corner(x: f64, y: f64, c: f64) -> f64 {
    let (rx, ry) = (x.hypot(c), y.hypot(c));
    (x / rx * (y / rx).atan() + y / ry * (x / ry).atan()) / (2.0 * PI)
}

/// Form factor to the rectangle `x` × `y` (each from … to, seen from the foot of the normal) in the parallel plane at
/// distance `c`.
///
/// Loses digits like (c/width)² far away or far aside, since four corners are subtracted.
pub fn parallel(x: [f64; 2], y: [f64; 2], c: f64) -> f64 {
    let corner = |i: usize, j: usize| parallel_corner(x[i], y[j], c);
    corner(1, 1) - corner(0, 1) - corner(1, 0) + corner(0, 0)
}

/// Form factor to a rectangle in a perpendicular plane at distance `c`, from the element's own plane up to `height`
/// and 0 … `x` along it, its corner at the foot of the perpendicular.
///
/// ```text
/// F = 1/(2π) · { atan(x/c) − c/√(c²+h²)·atan(x/√(c²+h²)) }
/// ```
///
/// Odd in x. At c = 0 it is ¼, the limit of an element at the foot of the wall. Loses digits like (c/h)² far away.
pub fn perpendicular_corner(x: f64, height: f64, c: f64) -> f64 {
    let r = c.hypot(height);
    (x.atan2(c) - c / r * (x / r).atan()) / (2.0 * PI)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reference: element under a corner of a parallel 1 × 2 rectangle at distance 1.5, computed elsewhere in 30 digits.
    #[test]
    fn the_corner_of_a_parallel_rectangle_matches_its_reference() {
        assert!((parallel_corner(1.0, 2.0, 1.5) - 0.122_359_661_642_333_07).abs() < 1e-16);
    }

    /// The kernel cosθ cosθ′/(πr²) summed by a 40-point product rule: its own error is below 1e-13 at these distances.
    #[test]
    fn both_formulas_match_a_quadrature_of_the_kernel() {
        let rule = crate::quadrature::gauss(40);
        let (x, y, c) = ([-0.7, 1.9], [0.4, 2.1], 1.3);
        let kernel = |u: f64, v: f64| c * c / (PI * (u * u + v * v + c * c).powi(2));
        let area = (x[1] - x[0]) * (y[1] - y[0]);
        let sum = area * crate::quadrature::mean(&rule, x, y, kernel);
        assert!((parallel(x, y, c) - sum).abs() < 1e-13);

        let (x, h) = (1.7, 2.4);
        let kernel = |u: f64, z: f64| z * c / (PI * (u * u + z * z + c * c).powi(2));
        let sum = x * h * crate::quadrature::mean(&rule, [0.0, x], [0.0, h], kernel);
        assert!((perpendicular_corner(x, h, c) - sum).abs() < 1e-13);
    }

    #[test]
    fn an_element_at_the_foot_of_a_wall_sends_it_a_quarter_each_way() {
        assert_eq!(perpendicular_corner(1.0, 2.0, 0.0), 0.25);
        assert_eq!(perpendicular_corner(-1.0, 2.0, 0.0), -0.25);
    }
}
