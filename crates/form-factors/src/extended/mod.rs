//! Extended form factors: what reaches a target by way of specular surfaces.
//!
//! The first pass of the two-pass method keeps radiosity diffuse and lets light take specular surfaces on its way (Wallace, Cohen, Greenberg 1987; Sillion and
//! Puech 1989, "extended form factors"):
//!
//! ```text
//! B = E + ρ (F + F′) B,      A_s F′_st = Σ over chains of specular scattering: power that arrives at t so, per unit of B_s
//! ```
//!
//! F is as always; F′ is here. It counts what arrives *at* a surface, so that light which goes on from there specularly has arrived there as well: with specular
//! reflectance ρ_s everywhere a closed room has rows of sum 1/(1 − ρ_s). That no light is made is a matter of ρ + ρ_s ≤ 1. F′ differs between bands where mirrors
//! are coloured; chains may lead back to where they began, so F′_ss ≠ 0.
//!
//! | estimator | what | error |
//! |---|---|---|
//! | [`SpecularRays`] | any specular surface, any number of scatterings | noise, N^(−1/2) |
//! | [`Images`] | planar, ideal mirrors; chains that end, or of a given length | that of the analytic estimator; symmetric |
//!
//! What is *not* here: scattering functions ([`radiosity_geometry::Scatter`] stands for them), and the sum of F and F′, which is a store
//! ([`crate::stores::ExtendedFormFactors`]).

mod images;
mod rays;

pub use images::{ImageRows, Images, ImagesError};
pub use rays::{Mirrors, SpecularRays};

/// How many specular scatterings in a row light may take between two diffuse ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum SpecularBounces {
    /// None: specular parts count as absent.
    #[default]
    None,
    /// At most so many.
    AtMost(u32),
    /// Any number.
    Any,
}

impl SpecularBounces {
    /// Whether light may be scattered once more after `taken` times.
    pub fn allow(self, taken: u32) -> bool {
        match self {
            Self::None => false,
            Self::AtMost(most) => taken < most,
            Self::Any => true,
        }
    }
}
