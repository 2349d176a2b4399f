//! What the hemicube's assumptions cost an entry, estimated.
//!
//! | error | where from | estimate |
//! |---|---|---|
//! | aliasing | a border moves by up to half a pixel in every row and column that it crosses | a random walk of crossings, each of variance ΔF²/12 |
//! | proximity | the factor of the source's centre stands for the mean over the source | second moments of the source times second derivatives of the kernel, signs dropped |
//!
//! What is *not* here: visibility that differs between the points of a source.

use std::f64::consts::PI;

use glam::DVec3;
use radiosity_geometry::Polygon;
use radiosity_geometry::polygon::area_vector;

use super::raster::Shown;
use super::view::{Frame, Seen, Side};

/// Variance of the factor Σ ΔF of what is shown, from the pixels on its border.
///
/// A border that is turned at random crosses each row at a place that is uniform in its pixel, which moves the sum by a
/// variance of ΔF²/12. A run has two crossings, and a shape of N pixels in R rows about 2N/R more along its columns.
pub(super) fn aliasing(shown: &Shown) -> f64 {
    if shown.pixels > 0 {
        let (runs, pixels) = (shown.runs as f64, shown.pixels as f64);
        return shown.ends / 12.0 * (1.0 + pixels / (runs * runs));
    }
    // Hidden: a corner of it may be left between the pixel centres.
    let pixel = if shown.whole_pixels > 0 { shown.whole / shown.whole_pixels as f64 } else { 0.0 };
    pixel * pixel / 6.0
}

/// Second moments of a source about its centroid in its frame, over its area.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moments {
    xx: f64,
    xy: f64,
    yy: f64,
}

impl Moments {
    /// Moments of `source` in `frame`, which has its eye at the centroid.
    ///
    /// A triangle of area T with corners a, b, c has ∫ x xᵀ = T/12 · [Σ v vᵀ + (Σ v)(Σ v)ᵀ]; triangles with a corner at the centroid
    /// make up the polygon.
    pub fn of(source: &Polygon, frame: &Frame) -> Self {
        let mut sum = Self { xx: 0.0, xy: 0.0, yy: 0.0 };
        for (a, b) in source.edges() {
            let (a, b) = (frame.turned(a - frame.eye), frame.turned(b - frame.eye));
            let share = (a.x * b.y - a.y * b.x) / 24.0 / source.area();
            let c = a + b;
            sum.xx += share * (a.x * a.x + b.x * b.x + c.x * c.x);
            sum.xy += share * (a.x * a.y + b.x * b.y + c.x * c.y);
            sum.yy += share * (a.y * a.y + b.y * b.y + c.y * c.y);
        }
        sum
    }

    /// Relative error of taking the source for its centre, towards a small target at `d` on the plane plane·x = 1.
    ///
    /// With M the moments, ρ = d² and the kernel k ∝ (plane·d) d_z/ρ², the mean over the source exceeds k by ½ M:∇∇k, so that
    ///
    /// ```text
    /// δ = ½ · (24 dᵀMd/ρ² − 8 planeᵀMd/ρ − 4 tr M/ρ)
    /// ```
    ///
    /// to leading order. The terms are added without their signs: large targets spread over places where they differ.
    pub fn proximity(&self, d: DVec3, plane: DVec3) -> f64 {
        let rho = d.length_squared();
        let d = d / rho;
        let m_d = DVec3::new(self.xx * d.x + self.xy * d.y, self.xy * d.x + self.yy * d.y, 0.0);
        12.0 * d.dot(m_d) + 4.0 * plane.dot(m_d).abs() + 2.0 * (self.xx + self.yy) / rho
    }
}

/// Form factor to a small target at a distance, k = cos θ cos θ' A/(π r²), from its sides as seen from the eye.
pub(super) fn kernel(seen: &Seen, sides: &[Side]) -> f64 {
    let corners: Vec<DVec3> = sides.iter().map(|side| side.corner).collect();
    let d = middle(sides);
    let rho = d.length_squared();
    // The height of the eye over the target's plane is 1/|plane|.
    area_vector(&corners).length() / rho * (d.z.max(0.0) / (seen.plane.length() * PI * rho))
}

/// Mean of the corners.
pub(super) fn middle(sides: &[Side]) -> DVec3 {
    sides.iter().map(|side| side.corner).sum::<DVec3>() / sides.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rectangle 1 × 2 has moments 1/12 and 4/12 over its area. Straight over its middle k = z²/(π d⁴) has second derivatives
    /// −4k/z² along x and along y. On the horizon along x, towards a target that faces the source, the three terms are 24, 8 and 4
    /// along x and 4 along y.
    #[test]
    fn moments_and_proximity_of_a_rectangle() {
        let corners = [(-0.5, -1.0), (0.5, -1.0), (0.5, 1.0), (-0.5, 1.0)].map(|(x, y)| DVec3::new(x + 3.0, y, 2.0));
        let source = Polygon::new(&corners).unwrap();
        let frame = Frame::new(&source, 0.0);
        let moments = Moments::of(&source, &frame);
        assert!((moments.xx - 1.0 / 12.0).abs() < 1e-15 && (moments.yy - 4.0 / 12.0).abs() < 1e-15);
        assert!(moments.xy.abs() < 1e-15);
        let over = moments.proximity(DVec3::Z * 10.0, DVec3::Z / 10.0);
        assert!((over - 0.5 * 5.0 / 12.0 * 4.0 / 100.0).abs() < 1e-15, "{over}");
        let beside = moments.proximity(DVec3::X * 10.0, DVec3::X / 10.0);
        assert!((beside - 0.5 * ((24.0 + 8.0 + 4.0) / 12.0 + 4.0 * 4.0 / 12.0) / 100.0).abs() < 1e-15, "{beside}");
    }

    /// A hidden receiver may show up to its share of a pixel; a run of 3 pixels in one row has 2 crossings along the row
    /// and 6 along columns.
    #[test]
    fn aliasing_counts_crossings_along_rows_and_columns() {
        let pixel = 1e-3;
        let row = Shown { factor: 3.0 * pixel, pixels: 3, runs: 1, ends: 2.0 * pixel * pixel, ..Shown::default() };
        assert!((aliasing(&row) / (8.0 * pixel * pixel / 12.0) - 1.0).abs() < 1e-12);
        let hidden = Shown { whole: 5.0 * pixel, whole_pixels: 5, ..Shown::default() };
        assert!((aliasing(&hidden) / (2.0 * pixel * pixel / 12.0) - 1.0).abs() < 1e-12);
    }
}
