//! Two unit squares that share an edge and open at an angle: direct light with an exact answer up to a singular edge.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use radiosity_geometry::Scene;

use crate::boxes::{hinged_rectangles, material};
use crate::quadrature;

/// A square that reflects, hinged to a square that emits E and reflects nothing.
///
/// Nothing comes back to the first square from itself, so at each of its points, with the corners c_k of the second seen from there,
///
/// ```text
/// H = E/(2π) Σ_k n · (c_k × c_{k+1})/|c_k × c_{k+1}| · ∠(c_k, c_{k+1})
/// ```
///
/// (Lambert 1760; the square stands above the point's horizon as a whole). H is bounded, but its slope is not where the squares
/// touch: the sharper the angle, the harder for constant elements and for points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hinge {
    /// The angle between the squares in radians, between 0 and π.
    pub angle: f64,
    /// Emission E of the second square in W/m².
    pub emission: f64,
    /// Reflectance ρ of the first.
    pub reflectance: f64,
}

impl Hinge {
    /// Surface 0 reflects, its parameters u away from the common edge and v along it; surface 1 emits.
    ///
    /// # Panics
    ///
    /// If the angle makes no hinge.
    pub fn scene(&self) -> Scene {
        let mut scene = hinged_rectangles(1.0, 1.0, 1.0, self.angle, material("floor", self.reflectance, 0.0));
        scene.materials.push(material("light", 0.0, self.emission));
        scene.surfaces[1].material = 1;
        scene
    }

    /// H at the point of the first square at a distance `u` in (0, 1) from the edge and at `v` in (0, 1) along it.
    pub fn irradiance(&self, u: f64, v: f64) -> f64 {
        let (x, up) = (DVec3::new(u, v, 0.0), DVec3::new(self.angle.cos(), 0.0, self.angle.sin()));
        let corners = [DVec3::ZERO, DVec3::Y, DVec3::Y + up, up].map(|c| c - x);
        let side = |k: usize| {
            let (a, b) = (corners[k], corners[(k + 1) % 4]);
            let normal = a.cross(b);
            normal.z / normal.length() * normal.length().atan2(a.dot(b))
        };
        // The loop faces the point, so it runs counter-clockwise as seen from there: the sum is negative.
        -self.emission / TAU * (0..4).map(side).sum::<f64>()
    }

    /// Mean of H over a part of the first square, by 24 × 24 points graded towards the ends: to about 1e-9 of H.
    pub fn mean_irradiance(&self, u: [f64; 2], v: [f64; 2]) -> f64 {
        quadrature::mean(&quadrature::graded(24), u, v, |u, v| self.irradiance(u, v))
    }

    /// F from the first square to the second at an angle of π/2 (J. R. Howell's catalogue, C-14): 0.2000437761.
    pub const RIGHT_ANGLE: f64 = 0.200_043_776_1;

    /// The angle in degrees.
    pub fn degrees(&self) -> f64 {
        self.angle * 180.0 / PI
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rectangles::perpendicular_corner;

    fn hinge(angle: f64) -> Hinge {
        Hinge { angle, emission: 2.0, reflectance: 0.5 }
    }

    /// At a right angle the light is a rectangle in the perpendicular plane, known in closed form.
    #[test]
    fn at_a_right_angle_points_match_the_formula_of_a_perpendicular_wall() {
        for (u, v) in [(0.01, 0.5), (0.3, 0.2), (0.9, 0.97)] {
            let known = perpendicular_corner(v, 1.0, u) + perpendicular_corner(1.0 - v, 1.0, u);
            assert!((hinge(PI / 2.0).irradiance(u, v) - 2.0 * known).abs() < 1e-14, "{u} {v}");
        }
    }

    #[test]
    fn the_mean_over_the_square_is_the_form_factor() {
        let mean = hinge(PI / 2.0).mean_irradiance([0.0, 1.0], [0.0, 1.0]);
        // Ten digits are known.
        assert!((mean / 2.0 - Hinge::RIGHT_ANGLE).abs() < 1e-9, "{mean}");
    }

    /// Near the edge the light fills a wedge of the sky: H → E (1 + cos angle)/2.
    #[test]
    fn points_near_the_edge_see_a_wedge() {
        for degrees in [30.0_f64, 60.0, 90.0, 120.0, 150.0] {
            let hinge = hinge(degrees.to_radians());
            let wedge = hinge.emission * 0.5 * (1.0 + hinge.angle.cos());
            assert!((hinge.irradiance(1e-7, 0.5) - wedge).abs() < 1e-6, "{degrees}");
            assert!((hinge.degrees() - degrees).abs() < 1e-12);
            let scene = hinge.scene();
            assert_eq!(scene.surfaces.iter().map(|s| s.material).collect::<Vec<_>>(), [0, 1]);
        }
    }
}
