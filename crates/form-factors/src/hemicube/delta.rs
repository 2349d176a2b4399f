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
//! and a pixel is a difference of four corners. The tables hold what lies left of each pixel in its row, so that a run of
//! pixels is one difference; everything telescopes, and all pixels sum to 1 to rounding.

use std::f64::consts::TAU;

/// Delta form factors of one resolution, summed along rows: face 0 is the top, 1 to 4 are the sides, from the surface up.
#[derive(Clone, Debug)]
pub(super) struct DeltaFormFactors {
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
            let sums = |j: usize| {
                let (y0, y1) = (at(j), at(j + 1));
                let begin = corner(-1.0, y1) - corner(-1.0, y0);
                (0..=resolution).map(move |i| (corner(at(i), y1) - corner(at(i), y0)) - begin)
            };
            (first_row..resolution).flat_map(sums).collect()
        };
        Self { resolution, top: table(top_corner, 0), side: table(side_corner, resolution / 2) }
    }

    /// Pixels along an edge of the top face.
    pub fn resolution(&self) -> usize {
        self.resolution
    }

    /// Row `row` of a face: value k is the form factor to its first k pixels.
    #[inline(always)]
    pub fn row(&self, face: usize, row: usize) -> &[f64] {
        let table = if face == 0 { &self.top } else { &self.side };
        &table[row * (self.resolution + 1)..][..self.resolution + 1]
    }

    /// Rows of a face.
    pub fn rows(&self, face: usize) -> usize {
        if face == 0 { self.resolution } else { self.resolution / 2 }
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
            let rows = (0..5).flat_map(|face| (0..delta.rows(face)).map(move |row| (face, row)));
            let sum: f64 = rows.map(|(face, row)| delta.row(face, row)[resolution]).sum();
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
        let found = |face: usize, row: usize| delta.row(face, row)[i + 1] - delta.row(face, row)[i];
        let top = pixel * pixel * 2.0 / TAU / (at(i).powi(2) + at(j).powi(2) + 1.0).powi(2);
        assert!((found(0, j) / top - 1.0).abs() < 1e-3);
        let z = at(j);
        let side = pixel * pixel * 2.0 / TAU * z / (at(i).powi(2) + z * z + 1.0).powi(2);
        assert!((found(3, j - n / 2) / side - 1.0).abs() < 1e-3);
    }
}
