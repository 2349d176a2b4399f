use std::f64::consts::PI;

use glam::DVec3;

use super::{Bsdf, INVERSE_PI, Sampled, cosine_direction, scale, weigh};

/// Diffuse reflection of a surface of V-shaped grooves (Oren and Nayar 1994), in the form of Fujii (2012):
///
/// ```text
/// f = ρ/π · A (1 + σ s/t),    s = o·i − cosθ_o cosθ_i,    t = max(cosθ_o, cosθ_i) where s > 0, else 1,
/// A = 1 / (1 + (1/2 − 2/(3π)) σ)
/// ```
///
/// Roughness σ runs from 0, which is Lambert's, to 1. With μ = cosθ_o the directional albedo is (Portsmouth, Kutz, Hill 2025)
///
/// ```text
/// a = ρ A [ 1 + σ ( sinθ/π · (θ − sinθ cosθ) + 2/(3π)·(tanθ (1 − sin³θ) − sinθ) ) ]
/// ```
///
/// which is never above ρ; the first published approximation exceeds 1 at grazing angles where ρ is near 1.
#[derive(Clone, Debug, PartialEq)]
pub struct OrenNayar {
    reflectance: Vec<f64>,
    roughness: f64,
}

impl OrenNayar {
    /// Of reflectance ρ in [0, 1], one a band, and roughness σ.
    ///
    /// # Panics
    ///
    /// If σ is not in [0, 1].
    pub fn new(reflectance: Vec<f64>, roughness: f64) -> Self {
        assert!((0.0..=1.0).contains(&roughness), "a roughness must lie in [0, 1], got {roughness}");
        Self { reflectance, roughness }
    }

    /// A.
    fn level(&self) -> f64 {
        1.0 / (1.0 + (0.5 - 2.0 / (3.0 * PI)) * self.roughness)
    }

    /// f π / ρ.
    fn shape(&self, o: DVec3, i: DVec3) -> f64 {
        let s = o.dot(i) - o.z * i.z;
        let t = if s > 0.0 { o.z.max(i.z) } else { 1.0 };
        self.level() * (1.0 + self.roughness * s / t)
    }
}

impl Bsdf for OrenNayar {
    fn bands(&self) -> usize {
        self.reflectance.len()
    }

    fn evaluate(&self, o: DVec3, i: DVec3, f: &mut [f64]) {
        scale(f, &self.reflectance, if o.z > 0.0 && i.z > 0.0 { INVERSE_PI * self.shape(o, i) } else { 0.0 });
    }

    fn sample(&self, o: DVec3, u: [f64; 3], weight: &mut [f64]) -> Option<Sampled> {
        if o.z <= 0.0 {
            return None;
        }
        let direction = cosine_direction([u[0], u[1]]);
        weigh(weight, &self.reflectance, self.shape(o, direction));
        Some(Sampled { direction, density: Some(direction.z * INVERSE_PI) })
    }

    fn density(&self, o: DVec3, i: DVec3) -> f64 {
        if o.z > 0.0 { i.z.max(0.0) * INVERSE_PI } else { 0.0 }
    }

    fn albedo(&self, o: DVec3, a: &mut [f64]) {
        let (cos, sin) = (o.z, (1.0 - o.z * o.z).max(0.0).sqrt());
        if cos <= 0.0 {
            return a.fill(0.0);
        }
        let theta = sin.atan2(cos);
        // tanθ (1 − sin³θ) without the 0 · ∞ of grazing angles: 1 − sin³θ = cos²θ (1 + sinθ + sin²θ)/(1 + sinθ).
        let tangent = sin * cos * (1.0 + sin + sin * sin) / (1.0 + sin);
        let shape = sin * INVERSE_PI * (theta - sin * cos) + 2.0 / (3.0 * PI) * (tangent - sin);
        scale(a, &self.reflectance, self.level() * (1.0 + self.roughness * shape));
    }
}
