//! How irradiance varies inside elements, recovered from that of their neighbours.
//!
//! With the neighbours k of an element on its surface, at distances d_k between centres of area and with differences ΔH_k,
//!
//! ```text
//! g = argmin Σ_k (g·d_k − ΔH_k)² / |d_k|²,      ε² = (1/A) ∫ (g·(x − x_c))² dA,
//! ```
//!
//! ε is the rms error of a constant in place of a linear function (gradient recovery; O. C. Zienkiewicz and J. Z. Zhu, "A simple error
//! estimator", IJNME 24, 1987). At a jump a least-squares slope sees both sides: the largest single difference, ΔH_k²/12 for neighbours of
//! equal size, is taken if it is more. Neighbours beyond a partition that stands on the surface are none. What is *not* here: what varies
//! within an element and is seen by none of its neighbours.

use glam::{DMat2, DVec2, DVec3};
use radiosity_core::BandValues;
use radiosity_geometry::Polygon;
use radiosity_geometry::mesh::Neighbours;
use rayon::prelude::*;

use crate::Geometry;

/// Height of the line of sight between two neighbours over their surface, of their distance.
const LIFT: f64 = 1e-3;

/// Smaller eigenvalue of Σ d dᵀ/|d|², of the sum of both, below which neighbours lie on one line: half of that of two small ones side by side. Slopes
/// across it, from where contacts cut elements askew, would be differences over next to no distance.
const THIN: f64 = 0.05;

/// Slope and error of every exposed element.
pub(super) struct Variation {
    /// g of H, band after band, element after element.
    gradients: Vec<DVec3>,
    /// ε² of H, mean over the bands.
    pub(super) squares: Vec<f64>,
    /// Largest |ΔH| to a neighbour in any band.
    pub(super) steps: Vec<f64>,
}

impl Variation {
    /// Of `h` on the exposed elements.
    pub(super) fn new(geometry: &Geometry<'_>, h: &BandValues) -> Self {
        let (mesh, m) = (geometry.mesh(), h.len());
        let place = geometry.places();
        let neighbours = Neighbours::new(mesh);
        let polygon = |k: usize| &geometry.elements().polygons(k)[0];
        let of = |k: usize| {
            let own = polygon(k);
            let near = neighbours.of(geometry.exposed()[k] as usize).into_iter().map(|e| place[e]);
            let seen = near.filter(|&other| sees(geometry, own, polygon(other)));
            let near: Vec<(DVec3, usize)> = seen.map(|o| (polygon(o).centroid() - own.centroid(), o)).collect();
            let mut of = (Vec::with_capacity(h.count()), 0.0, 0.0_f64);
            for b in 0..h.count() {
                let steps: Vec<(DVec3, f64)> =
                    near.iter().map(|&(d, other)| (d, h.band(b)[other] - h.band(b)[k])).collect();
                let g = slope(own, &steps);
                let size = own.area();
                let jump = |&(d, step): &(DVec3, f64)| step * step / 12.0 * (size / d.length_squared()).min(1.0);
                of.1 += mean_square(own, g).max(steps.iter().map(jump).fold(0.0, f64::max)) / h.count() as f64;
                of.2 = steps.iter().fold(of.2, |most, (_, step)| most.max(step.abs()));
                of.0.push(g);
            }
            of
        };
        let all: Vec<(Vec<DVec3>, f64, f64)> = (0..m).into_par_iter().map(of).collect();
        Self {
            gradients: (0..h.count()).flat_map(|b| all.iter().map(move |of| of.0[b])).collect(),
            squares: all.iter().map(|of| of.1).collect(),
            steps: all.iter().map(|of| of.2).collect(),
        }
    }

    /// g of H of element e in band b.
    pub(super) fn gradient(&self, b: usize, e: usize) -> DVec3 {
        self.gradients[b * self.squares.len() + e]
    }
}

/// Whether nothing stands between two neighbours.
fn sees(geometry: &Geometry<'_>, a: &Polygon, b: &Polygon) -> bool {
    if geometry.blockers().is_empty() {
        return true;
    }
    let (p, q) = (a.centroid(), b.centroid());
    let lift = a.normal() * (LIFT * p.distance(q));
    !geometry.blockers().occluded(p + lift, q + lift)
}

/// g of the module page; no slope across directions in which there is no neighbour, or next to none.
fn slope(polygon: &Polygon, steps: &[(DVec3, f64)]) -> DVec3 {
    let (u, v) = polygon.frame();
    let (mut matrix, mut right) = (DMat2::ZERO, DVec2::ZERO);
    for &(d, step) in steps {
        let (d, weight) = (DVec2::new(d.dot(u), d.dot(v)), d.length_squared().recip());
        matrix += DMat2::from_cols(weight * d.x * d, weight * d.y * d);
        right += weight * step * d;
    }
    let trace = matrix.x_axis.x + matrix.y_axis.y;
    if trace <= 0.0 {
        return DVec3::ZERO;
    }
    let (half, det) = (0.5 * trace, matrix.determinant());
    let largest = half + (half * half - det).max(0.0).sqrt();
    let g = if det > THIN * trace * largest {
        matrix.inverse() * right
    } else {
        // Columns of M − λ_min, where λ_min = tr M − λ_max, lie along the other axis.
        let across = matrix - DMat2::from_diagonal(DVec2::splat(trace - largest));
        let columns = [across.x_axis, across.y_axis];
        let longer = columns[usize::from(columns[1].length_squared() > columns[0].length_squared())];
        let axis = longer.normalize_or(DVec2::X);
        axis * (axis.dot(right) / largest)
    };
    u * g.x + v * g.y
}

/// (1/A) ∫ (g·(x − x_c))² dA, triangle by triangle: a linear f has ∫f² = A (Σ f_i² + (Σ f_i)²)/12 there.
fn mean_square(polygon: &Polygon, g: DVec3) -> f64 {
    let (vertices, centre) = (polygon.vertices(), polygon.centroid());
    let f: Vec<f64> = vertices.iter().map(|v| g.dot(*v - centre)).collect();
    let triangle = |k: usize| {
        let area = 0.5 * (vertices[k] - vertices[0]).cross(vertices[k + 1] - vertices[0]).dot(polygon.normal());
        let (a, b, c) = (f[0], f[k], f[k + 1]);
        area * (a * a + b * b + c * c + (a + b + c).powi(2)) / 12.0
    };
    (1..vertices.len() - 1).map(triangle).sum::<f64>() / polygon.area()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On a rectangle of a × b the mean square of x is a²/12.
    #[test]
    fn a_slope_along_an_edge_errs_by_its_length_over_the_root_of_12() {
        let rectangle =
            Polygon::new(&[DVec3::ZERO, DVec3::X * 3.0, DVec3::new(3.0, 5.0, 0.0), DVec3::Y * 5.0]).unwrap();
        assert!((mean_square(&rectangle, DVec3::X * 2.0) - 4.0 * 9.0 / 12.0).abs() < 1e-14);
        assert!((mean_square(&rectangle, DVec3::Y) - 25.0 / 12.0).abs() < 1e-14);
    }

    #[test]
    fn the_slope_of_a_linear_function_is_found_from_uneven_neighbours() {
        let own = Polygon::new(&[DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y]).unwrap();
        let g = DVec3::new(0.7, -1.3, 0.0);
        let near = [DVec3::X, DVec3::new(-0.75, 0.25, 0.0), DVec3::new(-0.75, -0.25, 0.0), DVec3::Y * 1.5];
        let steps = near.map(|d| (d, g.dot(d)));
        assert!((slope(&own, &steps) - g).length() < 1e-14);
        // In a corner, with neighbours on one side alone, nothing is said about the other.
        assert!((slope(&own, &steps[..1]) - DVec3::X * 0.7).length() < 1e-14);
    }

    #[test]
    fn neighbours_on_nearly_one_line_say_nothing_of_what_lies_across() {
        let own = Polygon::new(&[DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y]).unwrap();
        let steps = [(DVec3::X, 0.7), (DVec3::new(-1.0, 0.01, 0.0), -0.6)];
        let g = slope(&own, &steps);
        assert!((g.x - 0.65).abs() < 1e-3 && g.y.abs() < 1e-2, "{g}");
        assert_eq!(slope(&own, &[]), DVec3::ZERO);
    }
}
