use glam::DVec3;

use super::microfacets::Facets;
use super::{Bsdf, Sampled, fresnel, mirrored};

/// Metal, on the front. Smooth, or with microfacets that mirror by Fresnel's equations (Walter et al. 2007):
///
/// ```text
/// f = F(o·m) D(m) G₂(o, i) / (4 cosθ_o cosθ_i),      m = (o + i)/|o + i|
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Conductor {
    index: Vec<f64>,
    absorption: Vec<f64>,
    facets: Option<Facets>,
}

impl Conductor {
    /// Of index η + iκ, one a band, and roughness α; 0 is smooth.
    ///
    /// # Panics
    ///
    /// If there are not as many κ as η.
    pub fn new(index: Vec<f64>, absorption: Vec<f64>, roughness: f64) -> Self {
        assert_eq!(index.len(), absorption.len(), "bands of the index of a conductor");
        Self { index, absorption, facets: Facets::new(roughness) }
    }

    /// F of every band.
    fn fresnel(&self, cos: f64) -> impl Iterator<Item = f64> + '_ {
        self.index.iter().zip(&self.absorption).map(move |(eta, kappa)| fresnel::conductor(cos, *eta, *kappa))
    }
}

impl Bsdf for Conductor {
    fn bands(&self) -> usize {
        self.index.len()
    }

    fn evaluate(&self, o: DVec3, i: DVec3, f: &mut [f64]) {
        let Some(facets) = self.facets.filter(|_| o.z > 0.0 && i.z > 0.0) else { return f.fill(0.0) };
        let m = (o + i).normalize();
        let shape = facets.density(m) * facets.both(o, i) / (4.0 * o.z * i.z);
        f.iter_mut().zip(self.fresnel(o.dot(m).min(1.0))).for_each(|(f, fresnel)| *f = fresnel * shape);
    }

    fn sample(&self, o: DVec3, u: [f64; 3], weight: &mut [f64]) -> Option<Sampled> {
        if o.z <= 0.0 {
            return None;
        }
        let m = self.facets.map_or(DVec3::Z, |facets| facets.sample(o, [u[0], u[1]]));
        let i = mirrored(o, m);
        if i.z <= 0.0 {
            return None;
        }
        let seen = self.facets.map_or(1.0, |facets| facets.seen(o, i));
        weight.iter_mut().zip(self.fresnel(o.dot(m).min(1.0))).for_each(|(w, fresnel)| *w *= fresnel * seen);
        let density = self.facets.map(|facets| facets.visible_density(o, m) / (4.0 * o.dot(m)));
        Some(Sampled { direction: i, density })
    }

    fn density(&self, o: DVec3, i: DVec3) -> f64 {
        let Some(facets) = self.facets.filter(|_| o.z > 0.0 && i.z > 0.0) else { return 0.0 };
        let m = (o + i).normalize();
        facets.visible_density(o, m) / (4.0 * o.dot(m))
    }
}
