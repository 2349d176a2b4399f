//! What the specular statements of an MTL material mean.
//!
//! | statements | read as |
//! |---|---|
//! | `illum 7` (or `6`) with `Ni` | glass of index `Ni`, tint `Tf` (1 if absent), roughness α = `Pr`²; its `Kd` is left out |
//! | `Pm` of ½ and more | metal that reflects `Kd` at normal incidence, α = `Pr`², or √(2/(`Ns` + 2)) without `Pr`; no diffuse part |
//! | `illum 3` (or `5`) with `Kd 0` | an ideal mirror of reflectance `Ks` |
//! | `Ks` else | a lobe of reflectance `Ks` and exponent `Ns`, or 2/`Pr`⁴ − 2 with `Pr`, over the diffuse `Kd` |
//!
//! α = `Pr`² is the usual meaning of a roughness slider (Burley 2012); a lobe of exponent n is about as wide as facets of α = √(2/(n + 2)) (Walter et
//! al. 2007). A material is one or the other, so a `Pm` in between counts as the nearer end. What is *not* read: `d` and `Tr`, coats, sheen, anisotropy.

use radiosity_geometry::Specular;

/// The statements of a material that say how it reflects, colours in three bands.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Optics {
    pub ns: Option<f64>,
    pub ni: Option<f64>,
    pub illum: Option<u8>,
    /// Transmission filter.
    pub tf: Option<[f64; 3]>,
    /// Roughness.
    pub pr: Option<f64>,
    /// Metal or not.
    pub pm: Option<f64>,
}

impl Optics {
    /// Whether the material is the boundary of a dielectric.
    pub fn is_glass(&self) -> bool {
        matches!(self.illum, Some(6 | 7)) && self.ni.is_some_and(|n| n > 0.0)
    }

    /// Whether the material is metal.
    pub fn is_metal(&self) -> bool {
        !self.is_glass() && self.pm.is_some_and(|pm| pm >= 0.5)
    }

    /// Whether all light that `Kd` stands for is specular or none of it counts.
    pub fn is_bare(&self) -> bool {
        self.is_glass() || self.is_metal()
    }

    /// Width of the distribution of microfacets.
    fn alpha(&self) -> f64 {
        match (self.pr, self.ns) {
            (Some(pr), _) => pr.clamp(0.0, 1.0).powi(2),
            (None, Some(ns)) if self.is_metal() => (2.0 / (ns.max(0.0) + 2.0)).sqrt(),
            _ => 0.0,
        }
    }

    /// The specular part of a material of these reflectances.
    pub fn specular(&self, kd: [f64; 3], ks: [f64; 3]) -> Option<Specular> {
        if self.is_glass() {
            let tint = self.tf.unwrap_or([1.0; 3]).map(|t| t.min(1.0)).to_vec();
            return Some(Specular::Dielectric { index: self.ni.unwrap_or(1.0), tint, roughness: self.alpha() });
        }
        if self.is_metal() {
            return Some(Specular::conductor(&kd, self.alpha()));
        }
        if ks.iter().all(|ks| *ks == 0.0) {
            return None;
        }
        let reflectance = ks.to_vec();
        if matches!(self.illum, Some(3 | 5)) && kd == [0.0; 3] {
            return Some(Specular::Mirror { reflectance });
        }
        let exponent = match self.pr {
            // A lobe needs some width.
            Some(pr) => (2.0 / pr.clamp(1e-3, 1.0).powi(4) - 2.0).max(0.0),
            None => self.ns.unwrap_or(0.0).max(0.0),
        };
        Some(Specular::Phong { reflectance, exponent })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GREY: [f64; 3] = [0.5; 3];
    const NONE: [f64; 3] = [0.0; 3];

    #[test]
    fn mirrors_glass_metal_and_lobes_are_told_apart() {
        let illum = |illum| Optics { illum: Some(illum), ns: Some(50.0), ni: Some(1.5), ..Optics::default() };
        assert_eq!(illum(3).specular(NONE, GREY), Some(Specular::Mirror { reflectance: vec![0.5; 3] }));
        let lobe = Some(Specular::Phong { reflectance: vec![0.5; 3], exponent: 50.0 });
        assert_eq!((illum(3).specular(GREY, GREY), illum(2).specular(NONE, GREY)), (lobe.clone(), lobe));
        let glass = Specular::Dielectric { index: 1.5, tint: vec![1.0; 3], roughness: 0.0 };
        assert_eq!(illum(7).specular(GREY, GREY), Some(glass));
        assert_eq!(Optics { ni: None, ..illum(7) }.specular(GREY, NONE), None);
        assert_eq!(illum(2).specular(GREY, NONE), None);
    }

    #[test]
    fn roughness_and_metal_are_read() {
        let optics = Optics { pr: Some(0.5), pm: Some(1.0), ..Optics::default() };
        assert_eq!(optics.specular(GREY, NONE), Some(Specular::conductor(&GREY, 0.25)));
        let lobe = Optics { pm: Some(0.2), ..optics };
        // α = 0.25 is that of an exponent of 2/α² − 2.
        assert_eq!(lobe.specular(GREY, GREY), Some(Specular::Phong { reflectance: vec![0.5; 3], exponent: 30.0 }));
    }
}
