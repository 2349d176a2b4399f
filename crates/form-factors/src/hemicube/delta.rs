//! Delta form factors: the exact form factor from a surface point to every pixel of its hemicube.
//!
//! With the top face at height 1 over the point and the sides at distance 1, the form factors from the point to the
//! rectangle between the axis and the corner (x, y) are (Howell, B-3 and B-4)
//!
//! ```text
//! top:   T(x, y) = 1/(2π) · [ x/√(1+x²) · atan(y/√(1+x²)) + y/√(1+y²) · atan(x/√(1+y²)) ]
//! side:  S(x, y) = 1/(2π) · [ atan x − 1/√(1+y²) · atan(x/√(1+y²)) ]      y = height over the surface
//! ```
//!
//! and a pixel is a difference of four corners. The corners telescope, so that all pixels sum to 1 to rounding.

use std::f64::consts::TAU;

/// Delta form factors of one resolution: `face(0)` is the top, `face(1)` to `face(4)` the sides, from the surface up.
#[derive(Clone, Debug)]
pub struct DeltaFormFactors {
    resolution: usize,
    top: Vec<f64>,
    side: Vec<f64>,
}

fn top_corner(x: f64, y: f64) -> f64 {
    let (rx, ry) = (x.hypot(1.0), y.hypot(1.0));
    (x / rx * (y / rx).atan() + y / ry * (x / ry).atan()) / TAU
}

fn side_corner(x: f64, y: f64) -> f64 {
    let ry = y.hypot(1.0);
    (x.atan() - (x / ry).atan() / ry) / TAU
}

impl DeltaFormFactors {
    /// Tables for `resolution` pixels along an edge of the top face.
    pub fn new(resolution: usize) -> Self {
        let at = |k: usize| 2.0 * k as f64 / resolution as f64 - 1.0;
        let table = |corner: fn(f64, f64) -> f64, first_row: usize| -> Vec<f64> {
            let pixels = (first_row..resolution).flat_map(|j| (0..resolution).map(move |i| (i, j)));
            pixels
                .map(|(i, j)| {
                    let (x0, x1, y0, y1) = (at(i), at(i + 1), at(j), at(j + 1));
                    (corner(x1, y1) - corner(x0, y1)) - (corner(x1, y0) - corner(x0, y0))
                })
                .collect()
        };
        Self { resolution, top: table(top_corner, 0), side: table(side_corner, resolution / 2) }
    }

    /// Pixels along an edge of the top face.
    pub fn resolution(&self) -> usize {
        self.resolution
    }

    /// Delta form factors of a face, row after row.
    pub fn face(&self, face: usize) -> &[f64] {
        if face == 0 { &self.top } else { &self.side }
    }

    /// The largest one: a pixel at the middle of the top.
    pub fn largest(&self) -> f64 {
        self.top.iter().copied().fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The corners telescope; what is left is rounding of about 1e-17 a pixel.
    #[test]
    fn delta_form_factors_sum_to_one() {
        for resolution in [2, 6, 50, 256] {
            let delta = DeltaFormFactors::new(resolution);
            let sum: f64 = (0..5).flat_map(|face| delta.face(face)).sum();
            assert!((sum - 1.0).abs() < 1e-12, "resolution {resolution}: {sum}");
        }
    }

    /// Midpoint values of Cohen and Greenberg, 1/(π(x²+y²+1)²)·ΔA and z/(π(y²+z²+1)²)·ΔA, agree to O(pixel²).
    #[test]
    fn small_pixels_agree_with_the_midpoint_rule() {
        let (n, pixel) = (200, 2.0 / 200.0);
        let delta = DeltaFormFactors::new(n);
        let at = |k: usize| (k as f64 + 0.5) * pixel - 1.0;
        let (i, j) = (31, 120);
        let top = pixel * pixel * 2.0 / TAU / (at(i).powi(2) + at(j).powi(2) + 1.0).powi(2);
        assert!((delta.face(0)[j * n + i] / top - 1.0).abs() < 1e-3);
        let z = at(j);
        let side = pixel * pixel * 2.0 / TAU * z / (at(i).powi(2) + z * z + 1.0).powi(2);
        assert!((delta.face(3)[(j - n / 2) * n + i] / side - 1.0).abs() < 1e-3);
    }
}
