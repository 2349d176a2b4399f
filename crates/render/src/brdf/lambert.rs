use glam::DVec3;

use super::{Bsdf, INVERSE_PI, Sampled, cosine_direction, scale, weigh};

/// Ideal diffuse reflection of the front, f = ρ/π, with albedo ρ at every angle.
#[derive(Clone, Debug, PartialEq)]
pub struct Lambert {
    reflectance: Vec<f64>,
}

impl Lambert {
    /// Of reflectance ρ in [0, 1], one a band.
    pub fn new(reflectance: Vec<f64>) -> Self {
        Self { reflectance }
    }
}

impl Bsdf for Lambert {
    fn bands(&self) -> usize {
        self.reflectance.len()
    }

    fn evaluate(&self, o: DVec3, i: DVec3, f: &mut [f64]) {
        scale(f, &self.reflectance, if o.z > 0.0 && i.z > 0.0 { INVERSE_PI } else { 0.0 });
    }

    fn sample(&self, o: DVec3, u: [f64; 3], weight: &mut [f64]) -> Option<Sampled> {
        if o.z <= 0.0 {
            return None;
        }
        weigh(weight, &self.reflectance, 1.0);
        let direction = cosine_direction([u[0], u[1]]);
        Some(Sampled { direction, density: Some(direction.z * INVERSE_PI) })
    }

    fn density(&self, o: DVec3, i: DVec3) -> f64 {
        if o.z > 0.0 { i.z.max(0.0) * INVERSE_PI } else { 0.0 }
    }

    fn albedo(&self, o: DVec3, a: &mut [f64]) {
        scale(a, &self.reflectance, f64::from(u8::from(o.z > 0.0)));
    }
}
