//! Microfacets with the distribution of Trowbridge and Reitz ("GGX", Walter et al. 2007), of width α.
//!
//! ```text
//! D(m) = 1 / (π α² cos⁴θ (1 + tan²θ/α²)²),      Λ(w) = ½ (√(1 + α² tan²θ_w) − 1),
//! G₁(o) = 1 / (1 + Λ(o)),      G₂(o, i) = 1 / (1 + Λ(o) + Λ(i))
//! ```
//!
//! (Heitz 2014: facets of a height that is shadowed and masked together.) Facets are sampled in proportion to what o sees of them,
//! D_o(m) = G₁(o) D(m) max(0, o·m) / cosθ_o (Heitz 2018), so that samples weigh G₂/G₁.

use std::f64::consts::PI;

use glam::DVec3;

use super::disc;

/// A distribution of facets; directions are above it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Facets {
    alpha: f64,
}

impl Facets {
    /// Of width α > 0, or `None` where there is no roughness.
    pub fn new(alpha: f64) -> Option<Self> {
        (alpha > 0.0).then_some(Self { alpha })
    }

    /// D(m).
    pub fn density(self, m: DVec3) -> f64 {
        if m.z <= 0.0 {
            return 0.0;
        }
        let c2 = m.z * m.z;
        let t = (m.x * m.x + m.y * m.y) / (self.alpha * self.alpha) + c2;
        1.0 / (PI * self.alpha * self.alpha * t * t)
    }

    fn lambda(self, w: DVec3) -> f64 {
        let tan2 = (w.x * w.x + w.y * w.y) / (w.z * w.z);
        0.5 * ((1.0 + self.alpha * self.alpha * tan2).sqrt() - 1.0)
    }

    /// G₂(o, i), whichever sides they are on.
    pub fn both(self, o: DVec3, i: DVec3) -> f64 {
        1.0 / (1.0 + self.lambda(o) + self.lambda(i))
    }

    /// G₂/G₁, what a sample weighs.
    pub fn seen(self, o: DVec3, i: DVec3) -> f64 {
        (1.0 + self.lambda(o)) * self.both(o, i)
    }

    /// D_o(m).
    pub fn visible_density(self, o: DVec3, m: DVec3) -> f64 {
        self.density(m) * o.dot(m).max(0.0) / ((1.0 + self.lambda(o)) * o.z)
    }

    /// A facet m that o sees, with density D_o(m).
    ///
    /// The facets are those of a hemisphere stretched by α: its projection along o is sampled evenly.
    pub fn sample(self, o: DVec3, u: [f64; 2]) -> DVec3 {
        let v = DVec3::new(self.alpha * o.x, self.alpha * o.y, o.z).normalize();
        let across = v.x * v.x + v.y * v.y;
        let first = if across > 0.0 { DVec3::new(-v.y, v.x, 0.0) / across.sqrt() } else { DVec3::X };
        let second = v.cross(first);
        let p = disc(u);
        let s = 0.5 * (1.0 + v.z);
        let y = (1.0 - s) * (1.0 - p.x * p.x).max(0.0).sqrt() + s * p.y;
        let n = first * p.x + second * y + v * (1.0 - p.x * p.x - y * y).max(0.0).sqrt();
        DVec3::new(self.alpha * n.x, self.alpha * n.y, n.z.max(0.0)).normalize()
    }
}
