//! Textbook closed forms of two configurations: reference values by a route of their own, not an estimator.
//!
//! Both are sums of terms that cancel as the rectangles get small against their distance, so
//! [`unoccluded`](super::unoccluded) never uses them.

use std::f64::consts::PI;

/// Form factor between two equal, directly opposed `a` × `b` rectangles a distance `c` apart.
///
/// With X = a/c and Y = b/c,
///
/// ```text
/// F₁₂ = 2/(πXY) · { ½ ln[(1+X²)(1+Y²)/(1+X²+Y²)] + X√(1+Y²)·atan(X/√(1+Y²))
///                   + Y√(1+X²)·atan(Y/√(1+X²)) − X·atan X − Y·atan Y }
/// ```
///
/// (Howell, C-11). Lengths share any one unit. Cancels when far apart: relative error is 5·10⁻⁴ at
/// c = 10³·a, and the result is 0 at 10⁴.
///
/// # Panics
///
/// If a length is not finite and positive.
///
/// # Examples
///
/// ```
/// # use radiosity_form_factors::analytic::opposed_rectangles;
/// assert!((opposed_rectangles(1.0, 1.0, 1.0) - 0.199_824_895_7).abs() < 1e-10);
/// ```
pub fn opposed_rectangles(a: f64, b: f64, c: f64) -> f64 {
    check([a, b, c]);
    let (x, y) = (a / c, b / c);
    let (rx, ry) = (x.hypot(1.0), y.hypot(1.0)); // √(1+X²), √(1+Y²)
    let log = (rx * ry / (1.0 + x * x + y * y).sqrt()).ln();
    let arcs = x * ry * (x / ry).atan() + y * rx * (y / rx).atan() - x * x.atan() - y * y.atan();
    2.0 / (PI * x * y) * (log + arcs)
}

/// Form factor from a `width` × `edge` rectangle to a perpendicular `height` × `edge` one that shares the side `edge`.
///
/// With W = width/edge, H = height/edge and S = 1 + W² + H²,
///
/// ```text
/// F₁₂ = 1/(πW) · { W·atan(1/W) + H·atan(1/H) − √(W²+H²)·atan(1/√(W²+H²))
///                  + ¼ ln[ (1+W²)(1+H²)/S ] + ¼W² ln[ W²S/((1+W²)(W²+H²)) ] + ¼H² ln[ H²S/((1+H²)(W²+H²)) ] }
/// ```
///
/// (Howell, C-14). Lengths share any one unit. Cancels when both rectangles are long and narrow sideways, W and H far above
/// 1: the result is of order 1/W while the terms are of order W² ln, so digits are lost like W³.
///
/// # Panics
///
/// If a length is not finite and positive.
///
/// # Examples
///
/// ```
/// # use radiosity_form_factors::analytic::perpendicular_rectangles;
/// assert!((perpendicular_rectangles(1.0, 1.0, 1.0) - 0.200_043_776_1).abs() < 1e-10);
/// ```
pub fn perpendicular_rectangles(width: f64, height: f64, edge: f64) -> f64 {
    check([width, height, edge]);
    let (w, h) = (width / edge, height / edge);
    let (w2, h2) = (w * w, h * h);
    let (wh, s) = (w2 + h2, 1.0 + w2 + h2);
    let arcs = w * w.recip().atan() + h * h.recip().atan() - wh.sqrt() * wh.sqrt().recip().atan();
    let logs = ((1.0 + w2) * (1.0 + h2) / s).ln()
        + w2 * (w2 * s / ((1.0 + w2) * wh)).ln()
        + h2 * (h2 * s / ((1.0 + h2) * wh)).ln();
    (arcs + 0.25 * logs) / (PI * w)
}

fn check(lengths: [f64; 3]) {
    for length in lengths {
        assert!(length.is_finite() && length > 0.0, "lengths must be finite and positive, got {length}");
    }
}
