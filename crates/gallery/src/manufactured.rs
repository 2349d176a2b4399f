//! A room with a manufactured solution: choose B, and let E be what makes it right.

use glam::DVec3;
use radiosity_geometry::{Material, Scene};

use crate::boxes::{faces, in_plane, material, scene_of_loops};
use crate::{quadrature, rectangles};

/// An empty box room whose radiosity is constant on each of its six faces.
///
/// With B chosen, at a point of face f
///
/// ```text
/// H = Σ_{g ≠ f} B_g F_dA→g,      E = B_f − ρ_f H
/// ```
///
/// with exact differential form factors ([`rectangles`]). So H, and with it E, varies over a face while B does not;
/// interreflection is fully part of the answer. Faces are in the order x low, x high, y low, y high, z low, z high.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ManufacturedRoom {
    size: [f64; 3],
    radiosity: [f64; 6],
    reflectance: [f64; 6],
}

/// Points a direction of the graded rule for means: 1e-13 relative, and more where three faces meet and H jumps with
/// the direction from which the corner is approached: there 1e-9.
const POINTS: usize = 16;
const POINTS_AT_CORNER: usize = 32;

impl ManufacturedRoom {
    /// A room of edges `size` with radiosity B (W/m²) and reflectance ρ of its faces.
    ///
    /// # Panics
    ///
    /// If E could be negative: B_f ≥ ρ_f · max B must hold on every face.
    pub fn new(size: [f64; 3], radiosity: [f64; 6], reflectance: [f64; 6]) -> Self {
        let largest = radiosity.iter().copied().fold(0.0, f64::max);
        for (face, (b, rho)) in radiosity.iter().zip(&reflectance).enumerate() {
            assert!(*b >= rho * largest, "face {face}: B = {b} is below ρ max B = {}", rho * largest);
        }
        Self { size, radiosity, reflectance }
    }

    /// Surface f is face f, its material named after it; emission is left 0, since it varies over a face.
    ///
    /// The parameters u, v of a face are those of [`crate::boxes::inward_face`].
    ///
    /// # Panics
    ///
    /// If a length is not finite and positive.
    pub fn scene(&self) -> Scene {
        let materials: Vec<Material> =
            self.reflectance.iter().enumerate().map(|(f, &rho)| material(&format!("face {f}"), rho, 0.0)).collect();
        let loops = faces(DVec3::ZERO, DVec3::from(self.size), true);
        scene_of_loops(&loops.into_iter().zip(0..).collect::<Vec<_>>(), materials)
    }

    /// The point of a face with parameters u, v in [0, 1].
    pub fn point(&self, face: usize, u: f64, v: f64) -> DVec3 {
        let (axis, high) = (face / 2, face % 2 == 1);
        let (along_u, along_v) = in_plane(axis, high);
        let mut point = DVec3::ZERO;
        point[axis] = if high { self.size[axis] } else { 0.0 };
        point[along_u] = u * self.size[along_u];
        point[along_v] = v * self.size[along_v];
        point
    }

    /// F from the point u, v of `face` to each of the six faces; their sum is 1.
    pub fn form_factors(&self, face: usize, u: f64, v: f64) -> [f64; 6] {
        let (point, axis) = (self.point(face, u, v), face / 2);
        let height = self.size[axis];
        let mut f = [0.0; 6];
        let others = [(axis + 1) % 3, (axis + 2) % 3];
        let ends = |axis: usize| [-point[axis], self.size[axis] - point[axis]];
        f[face ^ 1] = rectangles::parallel(ends(others[0]), ends(others[1]), height);
        for (wall, along) in [(others[0], others[1]), (others[1], others[0])] {
            let [low, high] = ends(wall);
            let [left, right] = ends(along);
            for (side, c) in [(0, -low), (1, high)] {
                let corner = |x: f64| rectangles::perpendicular_corner(x, height, c);
                f[2 * wall + side] = corner(right) + corner(-left);
            }
        }
        f
    }

    /// B of a face.
    pub fn radiosity(&self, face: usize) -> f64 {
        self.radiosity[face]
    }

    /// ρ of a face.
    pub fn reflectance(&self, face: usize) -> f64 {
        self.reflectance[face]
    }

    /// H at the point u, v of a face.
    pub fn irradiance(&self, face: usize, u: f64, v: f64) -> f64 {
        self.form_factors(face, u, v).iter().zip(&self.radiosity).map(|(f, b)| f * b).sum()
    }

    /// E at the point u, v of a face.
    pub fn emission(&self, face: usize, u: f64, v: f64) -> f64 {
        self.radiosity[face] - self.reflectance[face] * self.irradiance(face, u, v)
    }

    /// Mean of H over the part `u` × `v` of a face, to 1e-9 relative.
    pub fn mean_irradiance(&self, face: usize, u: [f64; 2], v: [f64; 2]) -> f64 {
        let touches_end = |range: [f64; 2]| range.contains(&0.0) || range.contains(&1.0);
        let points = if touches_end(u) && touches_end(v) { POINTS_AT_CORNER } else { POINTS };
        quadrature::mean(&quadrature::graded(points), u, v, |u, v| self.irradiance(face, u, v))
    }

    /// Mean of E over the part `u` × `v` of a face: the emission of an element, with which its mean B is exact if its
    /// form factors are and every B is constant on what sends it.
    pub fn mean_emission(&self, face: usize, u: [f64; 2], v: [f64; 2]) -> f64 {
        self.radiosity[face] - self.reflectance[face] * self.mean_irradiance(face, u, v)
    }
}

impl Default for ManufacturedRoom {
    /// A room of 3 × 5 × 2 with six different radiosities and reflectances.
    fn default() -> Self {
        Self::new([3.0, 5.0, 2.0], [4.0, 6.0, 3.5, 5.0, 7.0, 8.0], [0.4, 0.7, 0.3, 0.6, 0.8, 0.0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn form_factors_of_any_point_sum_to_one() {
        let room = ManufacturedRoom::default();
        for face in 0..6 {
            for (u, v) in [(0.5, 0.5), (0.01, 0.3), (0.999, 0.001), (0.0, 0.5), (0.25, 1.0)] {
                let sum: f64 = room.form_factors(face, u, v).iter().sum();
                // Five terms of order 1, each right to a few roundings.
                assert!((sum - 1.0).abs() < 4e-15, "face {face} at {u}, {v}: {sum}");
            }
        }
    }

    /// Means of differential form factors over a face are form factors of faces: unit squares opposed and sharing an
    /// edge. 1e-9 is what the rule for means claims.
    #[test]
    fn means_over_faces_of_the_unit_cube_are_its_form_factors() {
        for (sender, wanted) in [(5, 0.199_824_895_698_387_4), (0, 0.200_043_776_075_403_15)] {
            let mut b = [0.0; 6];
            b[sender] = 1.0;
            let cube = ManufacturedRoom::new([1.0; 3], b, [0.0; 6]);
            let mean = cube.mean_irradiance(4, [0.0, 1.0], [0.0, 1.0]);
            assert!((mean - wanted).abs() < 1e-9 * wanted, "{mean}");
        }
    }

    #[test]
    fn the_mean_over_a_corner_cell_is_the_sum_of_its_quarters() {
        let room = ManufacturedRoom::default();
        let half = |k: usize| [k as f64 / 16.0, (k + 1) as f64 / 16.0];
        for face in 0..6 {
            let quarters: f64 = (0..4).map(|k| room.mean_irradiance(face, half(k % 2), half(k / 2)) / 4.0).sum();
            let whole = room.mean_irradiance(face, [0.0, 0.125], [0.0, 0.125]);
            assert!((quarters - whole).abs() < 1e-9 * whole);
        }
    }

    /// ρ H = B − E and ⟨E⟩ + ⟨ρH⟩ = ⟨B⟩: what is emitted and reflected is what leaves.
    #[test]
    fn power_balances() {
        let room = ManufacturedRoom::default();
        let areas: Vec<f64> = room.scene().surfaces.iter().map(|s| s.area()).collect();
        let whole = [0.0, 1.0];
        let leaving: f64 = (0..6).map(|f| areas[f] * room.radiosity(f)).sum();
        let arriving: f64 = (0..6).map(|f| areas[f] * room.mean_irradiance(f, whole, whole)).sum();
        // Closed room: all that leaves arrives.
        assert!((leaving - arriving).abs() < 1e-9 * leaving);
    }

    #[test]
    fn points_lie_on_the_surfaces_of_the_scene() {
        let room = ManufacturedRoom::default();
        for (face, surface) in room.scene().surfaces.iter().enumerate() {
            let v = surface.pieces[0].vertices();
            assert_eq!([room.point(face, 0.0, 0.0), room.point(face, 1.0, 0.0)], [v[0], v[1]]);
            assert_eq!([room.point(face, 1.0, 1.0), room.point(face, 0.0, 1.0)], [v[2], v[3]]);
        }
    }
}
