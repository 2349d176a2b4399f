//! What surfaces do to light beside reflecting it diffusely.
//!
//! A [`Specular`] is the description that a material carries; [`Scatter`] is what the tracing of rays needs to know of all of them. What is
//! *not* here: the distribution functions themselves (`radiosity-render` has them, and implements [`Scatter`]).

use glam::DVec3;

/// What a material does to light beside reflecting it diffusely. A polygon does it on its front; a boundary of glass on both sides.
///
/// Reflectances and tints have one value a band. Diffuse reflectance and the largest directional albedo together may not exceed 1.
#[derive(Clone, Debug, PartialEq)]
pub enum Specular {
    /// An ideal mirror.
    Mirror {
        /// Share ρ_s of light that is reflected, at every angle.
        reflectance: Vec<f64>,
    },
    /// A lobe about the mirrored direction, f = ρ_s (n + 2)/(2π) cosⁿα (Phong 1975, normalised by Lafortune and Willems 1994).
    Phong {
        /// ρ_s, the albedo at normal incidence.
        reflectance: Vec<f64>,
        /// Exponent n ≥ 0.
        exponent: f64,
    },
    /// A conductor of index η + iκ.
    Conductor {
        /// η.
        index: Vec<f64>,
        /// κ.
        absorption: Vec<f64>,
        /// Width α of the distribution of microfacets (Trowbridge and Reitz 1975); 0 for a smooth surface.
        roughness: f64,
    },
    /// The boundary of a dielectric that lies behind the polygon, so that its surface must be closed and face outwards.
    Dielectric {
        /// Index of refraction n inside over that outside.
        index: f64,
        /// Share of transmitted light that is not absorbed.
        tint: Vec<f64>,
        /// Width α of the distribution of microfacets; 0 for a smooth boundary.
        roughness: f64,
    },
}

impl Specular {
    /// Bands of its reflectances.
    pub fn bands(&self) -> usize {
        match self {
            Self::Mirror { reflectance } | Self::Phong { reflectance, .. } => reflectance.len(),
            Self::Conductor { index, .. } => index.len(),
            Self::Dielectric { tint, .. } => tint.len(),
        }
    }

    /// Whether bands `a` and `b` are treated alike.
    pub fn alike(&self, a: usize, b: usize) -> bool {
        match self {
            Self::Mirror { reflectance } | Self::Phong { reflectance, .. } => reflectance[a] == reflectance[b],
            Self::Conductor { index, absorption, .. } => index[a] == index[b] && absorption[a] == absorption[b],
            Self::Dielectric { tint, .. } => tint[a] == tint[b],
        }
    }

    /// A conductor that reflects `reflectance` of every band at normal incidence.
    ///
    /// Of the conductors that do, the one with η = 1, κ = 2√(ρ/(1 − ρ)): since ρ = κ²/(4 + κ²) then. ρ must be below 1.
    pub fn conductor(reflectance: &[f64], roughness: f64) -> Self {
        let absorption = reflectance.iter().map(|rho| 2.0 * (rho / (1.0 - rho)).sqrt()).collect();
        Self::Conductor { index: vec![1.0; reflectance.len()], absorption, roughness }
    }
}

/// What becomes of rays at specular surfaces.
///
/// Rays carry importance from a receiver towards what sends, or light the other way: specular scattering is the same both ways, since radiance is
/// counted as L/n², which no refraction changes.
pub trait Scatter: Sync {
    /// Whether anything but diffuse reflection happens where a ray meets this side of surface `surface`.
    fn is_specular(&self, surface: usize, front: bool) -> bool;

    /// The direction into which a ray goes on from `surface` with front normal `normal`, having arrived along `d`; `weight` (one value a band) is
    /// multiplied by f cosθ over the density. `None` where it ends; directions are unit vectors, `u` lies in [0, 1)³.
    fn scatter(&self, surface: usize, normal: DVec3, d: DVec3, u: [f64; 3], weight: &mut [f64]) -> Option<DVec3>;
}
