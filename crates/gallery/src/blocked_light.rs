//! A floor, a light over it and a blocker between: shadows from soft to hard, exact at every point.

use glam::DVec3;
use radiosity_geometry::Scene;

use crate::boxes::{material, scene_of_loops};
use crate::rectangles;

/// A floor 0 … 1 by 0 … 1 at z = 0, a square light that faces down at z = 1, and a square blocker that reflects nothing between them.
///
/// Seen from a point of the floor the blocker covers a rectangle of the light's plane, so what is left of the light is a rectangle less a
/// rectangle and
///
/// ```text
/// H = E · (F_dA→light − F_dA→(light ∩ shadow))
/// ```
///
/// in closed form. The nearer the blocker to the floor, the harder its shadow: the penumbra is as wide as the light times
/// height/(1 − height).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockedLight {
    /// Range of the light along x and along y.
    pub light: [f64; 2],
    /// Range of the blocker along x.
    pub blocker_x: [f64; 2],
    /// Range of the blocker along y.
    pub blocker_y: [f64; 2],
    /// Height of the blocker over the floor, between 0 and 1.
    pub height: f64,
    /// Emission E of the light in W/m².
    pub emission: f64,
    /// Reflectance ρ of the floor.
    pub reflectance: f64,
}

impl BlockedLight {
    /// A light of 0.3 × 0.3 over the middle and a blocker of 0.36 × 0.31, off the middle and off regular mesh lines, at this height.
    pub fn at(height: f64) -> Self {
        Self {
            light: [0.35, 0.65],
            blocker_x: [0.287, 0.647],
            blocker_y: [0.361, 0.671],
            height,
            emission: 10.0,
            reflectance: 0.5,
        }
    }

    /// Surface 0 is the floor, its parameters u along x and v along y; surface 1 the light, surface 2 the blocker.
    ///
    /// # Panics
    ///
    /// If a length is not positive.
    pub fn scene(&self) -> Scene {
        let plate = |x: [f64; 2], y: [f64; 2], z: f64, up: bool| {
            let mut corners =
                [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])].map(|(x, y)| DVec3::new(x, y, z));
            if !up {
                corners.reverse();
            }
            corners.to_vec()
        };
        let loops = [
            (plate([0.0, 1.0], [0.0, 1.0], 0.0, true), 0),
            (plate(self.light, self.light, 1.0, false), 1),
            (plate(self.blocker_x, self.blocker_y, self.height, false), 2),
        ];
        let materials = vec![
            material("floor", self.reflectance, 0.0),
            material("light", 0.0, self.emission),
            material("blocker", 0.0, 0.0),
        ];
        scene_of_loops(&loops, materials)
    }

    /// H at the point of the floor with parameters u, v in [0, 1].
    pub fn irradiance(&self, u: f64, v: f64) -> f64 {
        // Ranges in the light's plane, from the foot of the normal.
        let light = |at: f64| self.light.map(|end| end - at);
        let shadow = |range: [f64; 2], at: f64| range.map(|end| (end - at) / self.height);
        let meet = |a: [f64; 2], b: [f64; 2]| [a[0].max(b[0]), a[1].min(b[1])];
        let (x, y) = (light(u), light(v));
        let (hidden_x, hidden_y) = (meet(x, shadow(self.blocker_x, u)), meet(y, shadow(self.blocker_y, v)));
        let hidden = hidden_x[0] < hidden_x[1] && hidden_y[0] < hidden_y[1];
        let hidden = if hidden { rectangles::parallel(hidden_x, hidden_y, 1.0) } else { 0.0 };
        self.emission * (rectangles::parallel(x, y, 1.0) - hidden)
    }

    /// Mean of H over a part of the floor, by midpoints of `points` × `points` parts: H has kinks along the shadow's edges, so that the
    /// error falls like points⁻².
    pub fn mean_irradiance(&self, u: [f64; 2], v: [f64; 2], points: u32) -> f64 {
        let at = |range: [f64; 2], k: u32| range[0] + (range[1] - range[0]) * (f64::from(k) + 0.5) / f64::from(points);
        let all = (0..points).flat_map(|j| (0..points).map(move |i| (i, j)));
        let sum: f64 = all.map(|(i, j)| self.irradiance(at(u, i), at(v, j))).sum();
        sum / f64::from(points).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use radiosity_form_factors::point::form_factors_from;
    use radiosity_geometry::{Facets, Polygon};

    /// The light cut by what the blocker hides, polygon by polygon: another route to the same number.
    #[test]
    fn points_match_what_clipping_leaves_of_the_light() {
        for height in [0.1, 0.5, 0.9] {
            let case = BlockedLight::at(height);
            let scene = case.scene();
            let facets = Facets::of_surfaces(&scene);
            let blockers: Vec<Polygon> = scene.pieces().map(|(_, p)| p.clone()).collect();
            for (u, v) in [(0.5, 0.5), (0.31, 0.42), (0.7, 0.66), (0.05, 0.9)] {
                let row = form_factors_from(DVec3::new(u, v, 0.0), DVec3::Z, &facets, &blockers);
                assert!((case.irradiance(u, v) - case.emission * row[1]).abs() < 1e-13, "{height}: {u} {v}");
            }
        }
    }

    #[test]
    fn a_blocker_near_the_floor_leaves_darkness_under_it_and_one_near_the_light_none() {
        let under = |height: f64| BlockedLight::at(height).irradiance(0.46, 0.51);
        assert_eq!(under(0.1), 0.0);
        assert!(
            under(0.9) < 0.2 * BlockedLight { blocker_x: [0.9, 0.95], ..BlockedLight::at(0.1) }.irradiance(0.46, 0.51)
        );
        // Twice the points, a quarter of the error.
        let mean = |points| BlockedLight::at(0.3).mean_irradiance([0.25, 0.375], [0.25, 0.375], points);
        let exact = mean(512);
        assert!((mean(32) - exact).abs() < 2e-3 * exact && (mean(128) - exact).abs() < 2e-4 * exact);
    }
}
