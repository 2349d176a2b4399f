//! One reflecting floor under a parallel rectangular light: direct light with an exact answer at every point.

use glam::DVec3;
use radiosity_geometry::Scene;

use crate::boxes::{material, scene_of_loops};
use crate::{quadrature, rectangles};

/// A floor 0 … a by 0 … b at z = 0 and a light above it that faces down and reflects nothing.
///
/// Nothing comes back to the floor, so at each of its points
///
/// ```text
/// H = E · F_dA→light,      B = ρ H
/// ```
///
/// with the differential form factor of [`rectangles::parallel`]. The irradiance of the light itself is not given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloorUnderLight {
    /// Edges a, b of the floor.
    pub floor: [f64; 2],
    /// Range of the light along x.
    pub light_x: [f64; 2],
    /// Range of the light along y.
    pub light_y: [f64; 2],
    /// Height of the light over the floor.
    pub height: f64,
    /// Emission E of the light in W/m².
    pub emission: f64,
    /// Reflectance ρ of the floor.
    pub reflectance: f64,
}

impl Default for FloorUnderLight {
    /// A floor of 4 × 3 under a light of 1 × 0.6, off its middle, at height 1.5.
    fn default() -> Self {
        Self {
            floor: [4.0, 3.0],
            light_x: [1.0, 2.0],
            light_y: [1.4, 2.0],
            height: 1.5,
            emission: 10.0,
            reflectance: 0.5,
        }
    }
}

impl FloorUnderLight {
    /// Surface 0 is the floor, its parameters u along x and v along y; surface 1 is the light.
    ///
    /// # Panics
    ///
    /// If a length is not finite and positive.
    pub fn scene(&self) -> Scene {
        let [a, b] = self.floor;
        let ([x0, x1], [y0, y1], h) = (self.light_x, self.light_y, self.height);
        let floor = vec![DVec3::ZERO, DVec3::X * a, DVec3::new(a, b, 0.0), DVec3::Y * b];
        let light = vec![(x0, y0), (x0, y1), (x1, y1), (x1, y0)];
        let light = light.into_iter().map(|(x, y)| DVec3::new(x, y, h)).collect();
        let materials = vec![material("floor", self.reflectance, 0.0), material("light", 0.0, self.emission)];
        scene_of_loops(&[(floor, 0), (light, 1)], materials)
    }

    /// H at the point of the floor with parameters u, v in [0, 1].
    pub fn irradiance(&self, u: f64, v: f64) -> f64 {
        let (x, y) = (u * self.floor[0], v * self.floor[1]);
        let (x, y) = (self.light_x.map(|end| end - x), self.light_y.map(|end| end - y));
        self.emission * rectangles::parallel(x, y, self.height)
    }

    /// B at the point of the floor with parameters u, v in [0, 1].
    pub fn radiosity(&self, u: f64, v: f64) -> f64 {
        self.reflectance * self.irradiance(u, v)
    }

    /// Mean of H over a part of the floor, by 16 × 16 Gauss points: right to rounding for parts about as wide as the
    /// light is high, to 1e-10 relative for parts three times that.
    pub fn mean_irradiance(&self, u: [f64; 2], v: [f64; 2]) -> f64 {
        quadrature::mean(&quadrature::gauss(16), u, v, |u, v| self.irradiance(u, v))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_light_is_brightest_under_its_middle_and_the_floor_faces_it() {
        let case = FloorUnderLight::default();
        let middle = case.irradiance(1.5 / 4.0, 1.7 / 3.0);
        // 10 times four corners of 0.5 × 0.3 at 1.5.
        assert!((middle - 40.0 * rectangles::parallel_corner(0.5, 0.3, 1.5)).abs() < 1e-14);
        assert!(case.irradiance(0.9, 0.1) < 0.2 * middle);
        let scene = case.scene();
        let (floor, light) = (&scene.surfaces[0].pieces[0], &scene.surfaces[1].pieces[0]);
        assert!(floor.signed_distance(light.centroid()) == 1.5 && light.signed_distance(floor.centroid()) == 1.5);
    }

    /// A_floor F_floor→light = ∫ F_dA: the mean over the floor of parts and of the whole agree to the rule's accuracy.
    #[test]
    fn means_of_parts_add_up() {
        let case = FloorUnderLight::default();
        let at = |k: usize| [k as f64 / 3.0, (k + 1) as f64 / 3.0];
        let parts: f64 = (0..9).map(|k| case.mean_irradiance(at(k % 3), at(k / 3)) / 9.0).sum();
        let whole = case.mean_irradiance([0.0, 1.0], [0.0, 1.0]);
        assert!((parts - whole).abs() < 1e-10 * whole, "{parts} {whole}");
    }
}
