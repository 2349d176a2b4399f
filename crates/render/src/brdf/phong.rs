use std::f64::consts::TAU;

use glam::DVec3;

use super::{Bsdf, Frame, Sampled, mirrored, scale, weigh};

/// A lobe about the mirrored direction, on the front (Phong 1975, in the reciprocal form of Lafortune and Willems 1994):
///
/// ```text
/// f = ρ_s (n + 2)/(2π) · cosⁿα,      α the angle between i and o mirrored at the normal,
/// ```
///
/// with α up to 90°. The albedo is ρ_s at normal incidence and less elsewhere: the part of the lobe below the surface is lost, and at grazing angles about
/// half of it. Samples have density (n + 1)/(2π) cosⁿα, and end where they go below the surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Phong {
    reflectance: Vec<f64>,
    exponent: f64,
}

impl Phong {
    /// Of reflectance ρ_s in [0, 1], one a band, and exponent n.
    ///
    /// # Panics
    ///
    /// If n is not finite or negative.
    pub fn new(reflectance: Vec<f64>, exponent: f64) -> Self {
        assert!(exponent.is_finite() && exponent >= 0.0, "an exponent must be finite and not negative, got {exponent}");
        Self { reflectance, exponent }
    }

    /// cosⁿα, 0 beyond 90° and on the back.
    fn lobe(&self, o: DVec3, i: DVec3) -> f64 {
        let cos = mirrored(o, DVec3::Z).dot(i);
        if o.z > 0.0 && i.z > 0.0 && cos > 0.0 { cos.min(1.0).powf(self.exponent) } else { 0.0 }
    }
}

impl Bsdf for Phong {
    fn bands(&self) -> usize {
        self.reflectance.len()
    }

    fn evaluate(&self, o: DVec3, i: DVec3, f: &mut [f64]) {
        scale(f, &self.reflectance, (self.exponent + 2.0) / TAU * self.lobe(o, i));
    }

    fn sample(&self, o: DVec3, u: [f64; 3], weight: &mut [f64]) -> Option<Sampled> {
        let n = self.exponent;
        // 1 − u is never 0, so that a power of it is no 0⁰.
        let cos = (1.0 - u[0]).powf(1.0 / (n + 1.0));
        let (sin, phi) = ((1.0 - cos * cos).max(0.0).sqrt(), TAU * u[1]);
        let axis = Frame::new(mirrored(o, DVec3::Z));
        let i = axis.scene(DVec3::new(sin * phi.cos(), sin * phi.sin(), cos));
        if o.z <= 0.0 || i.z <= 0.0 {
            return None;
        }
        weigh(weight, &self.reflectance, (n + 2.0) / (n + 1.0) * i.z);
        Some(Sampled { direction: i, density: Some((n + 1.0) / TAU * cos.powf(n)) })
    }

    fn density(&self, o: DVec3, i: DVec3) -> f64 {
        (self.exponent + 1.0) / TAU * self.lobe(o, i)
    }
}
