use glam::DVec3;

use super::{Bsdf, Sampled, scale, weigh};

/// An ideal mirror on the front of reflectance ρ_s at every angle: L(o) = ρ_s L(o mirrored at the normal).
#[derive(Clone, Debug, PartialEq)]
pub struct Mirror {
    reflectance: Vec<f64>,
}

impl Mirror {
    /// Of reflectance ρ_s in [0, 1], one a band.
    pub fn new(reflectance: Vec<f64>) -> Self {
        Self { reflectance }
    }
}

impl Bsdf for Mirror {
    fn bands(&self) -> usize {
        self.reflectance.len()
    }

    fn evaluate(&self, _: DVec3, _: DVec3, f: &mut [f64]) {
        f.fill(0.0);
    }

    fn sample(&self, o: DVec3, _: [f64; 3], weight: &mut [f64]) -> Option<Sampled> {
        if o.z <= 0.0 {
            return None;
        }
        weigh(weight, &self.reflectance, 1.0);
        Some(Sampled { direction: DVec3::new(-o.x, -o.y, o.z), density: None })
    }

    fn density(&self, _: DVec3, _: DVec3) -> f64 {
        0.0
    }

    fn albedo(&self, o: DVec3, a: &mut [f64]) {
        scale(a, &self.reflectance, f64::from(u8::from(o.z > 0.0)));
    }
}
