//! How surfaces scatter light: distribution functions with one interface.
//!
//! Directions are unit vectors that point away from the surface, in a frame whose z axis is the front normal: o towards the viewer, i towards where light
//! comes from. A function f(o, i) in 1/sr gives
//!
//! ```text
//! L(o) = ∫ f(o, i) L(i) |cosθ_i| dω_i
//! ```
//!
//! with L the radiance over n², the square of the index of the medium, which no refraction changes. So f(o, i)/n_i² = f(i, o)/n_o² for all of them, which without
//! refraction is f(o, i) = f(i, o). What passes in ideal directions alone has no f, only samples.
//!
//! | function | what | reference |
//! |---|---|---|
//! | [`Lambert`] | ideal diffuse reflection | Lambert 1760 |
//! | [`OrenNayar`] | rough diffuse reflection | Oren and Nayar 1994, in the form of Fujii 2012 |
//! | [`Phong`] | a lobe about the mirrored direction | Phong 1975, normalised as by Lafortune and Willems 1994 |
//! | [`Conductor`] | metal, smooth or with microfacets | Trowbridge and Reitz 1975; Walter et al. 2007; Heitz 2014, 2018 |
//! | [`Dielectric`] | glass, smooth or with microfacets, both ways | the same |
//! | [`Mirror`] | an ideal mirror of any reflectance | |
//!
//! What is *not* here: light scattered more than once between microfacets, which is lost (a few per cent at roughness 0.5, a third at 1), polarisation, textures.

mod conductor;
mod dielectric;
pub mod fresnel;
mod lambert;
mod microfacets;
mod mirror;
mod oren_nayar;
mod phong;
#[cfg(test)]
mod tests;

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};
use radiosity_geometry::{Scatter, Scene, Specular};

pub use conductor::Conductor;
pub use dielectric::Dielectric;
pub use lambert::Lambert;
pub use mirror::Mirror;
pub use oren_nayar::OrenNayar;
pub use phong::Phong;

/// A sampled direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampled {
    /// The direction i, a unit vector.
    pub direction: DVec3,
    /// Its density over solid angle in 1/sr; `None` in an ideal direction, which no other way of sampling finds.
    pub density: Option<f64>,
}

/// A distribution function of reflection and transmission, with one value a band.
pub trait Bsdf: Send + Sync {
    /// Number of bands.
    fn bands(&self) -> usize;

    /// f(o, i) in 1/sr, written to `f`; 0 where ideal directions carry all.
    fn evaluate(&self, o: DVec3, i: DVec3, f: &mut [f64]);

    /// A direction i for o, from `u` in [0, 1)³. `weight` is *multiplied* by f(o, i) |cosθ_i| / density. `None` where the path ends.
    fn sample(&self, o: DVec3, u: [f64; 3], weight: &mut [f64]) -> Option<Sampled>;

    /// The density with which [`Self::sample`] draws i for o, in 1/sr; 0 for ideal directions.
    fn density(&self, o: DVec3, i: DVec3) -> f64;

    /// The directional albedo ∫ f(o, i) |cosθ_i| dω_i, written to `a`, to a few 10⁻³ where it has no closed form.
    fn albedo(&self, o: DVec3, a: &mut [f64]) {
        // The mean weight over an even spread of samples: multiples of powers of 1/x with x⁴ = x + 1 (Roberts 2018).
        const COUNT: usize = 4096;
        a.fill(0.0);
        let mut weight = vec![0.0; self.bands()];
        for k in 0..COUNT {
            let u = [0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_3]
                .map(|step: f64| (0.5 + step * k as f64).fract());
            weight.fill(1.0);
            if self.sample(o, u, &mut weight).is_some() {
                a.iter_mut().zip(&weight).for_each(|(a, w)| *a += w / COUNT as f64);
            }
        }
    }
}

/// The function that a material's specular part stands for.
pub fn of_specular(specular: &Specular) -> Box<dyn Bsdf> {
    match specular.clone() {
        Specular::Mirror { reflectance } => Box::new(Mirror::new(reflectance)),
        Specular::Phong { reflectance, exponent } => Box::new(Phong::new(reflectance, exponent)),
        Specular::Conductor { index, absorption, roughness } => Box::new(Conductor::new(index, absorption, roughness)),
        Specular::Dielectric { index, tint, roughness } => Box::new(Dielectric::new(index, tint, roughness)),
    }
}

/// A frame about a unit normal: x, y, z = normal (Duff et al. 2017).
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    x: DVec3,
    y: DVec3,
    z: DVec3,
}

impl Frame {
    /// The frame of a normal.
    pub fn new(normal: DVec3) -> Self {
        let sign = 1.0_f64.copysign(normal.z);
        let a = -1.0 / (sign + normal.z);
        let b = normal.x * normal.y * a;
        let x = DVec3::new(1.0 + sign * normal.x * normal.x * a, sign * b, -sign * normal.x);
        Self { x, y: DVec3::new(b, sign + normal.y * normal.y * a, -normal.y), z: normal }
    }

    /// A vector of the scene in the frame.
    pub fn local(&self, v: DVec3) -> DVec3 {
        DVec3::new(v.dot(self.x), v.dot(self.y), v.dot(self.z))
    }

    /// A vector of the frame in the scene.
    pub fn scene(&self, v: DVec3) -> DVec3 {
        self.x * v.x + self.y * v.y + self.z * v.z
    }
}

/// A direction about z with density cosθ/π.
pub fn cosine_direction(u: [f64; 2]) -> DVec3 {
    let (r, phi) = (u[0].sqrt(), TAU * u[1]);
    DVec3::new(r * phi.cos(), r * phi.sin(), (1.0 - u[0]).max(0.0).sqrt())
}

/// The specular parts of all surfaces of a scene.
pub struct SpecularSurfaces {
    /// Of every surface, the place of its function.
    of: Vec<Option<usize>>,
    functions: Vec<(Box<dyn Bsdf>, bool)>,
    bands: usize,
}

impl SpecularSurfaces {
    /// Of `scene`.
    pub fn new(scene: &Scene) -> Self {
        let (mut functions, mut place) = (Vec::<(Box<dyn Bsdf>, bool)>::new(), Vec::new());
        for material in &scene.materials {
            place.push(material.specular.as_ref().map(|specular| {
                functions.push((of_specular(specular), matches!(specular, Specular::Dielectric { .. })));
                functions.len() - 1
            }));
        }
        let of = scene.surfaces.iter().map(|s| place[s.material]).collect();
        Self { of, functions, bands: scene.bands() }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.of.iter().all(Option::is_none)
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.bands
    }

    /// The specular part of a surface on its front or back.
    pub fn get(&self, surface: usize, front: bool) -> Option<&dyn Bsdf> {
        let (function, both) = &self.functions[self.of[surface]?];
        (front || *both).then_some(&**function)
    }
}

impl Scatter for SpecularSurfaces {
    fn is_specular(&self, surface: usize, front: bool) -> bool {
        self.get(surface, front).is_some()
    }

    fn scatter(&self, surface: usize, normal: DVec3, d: DVec3, u: [f64; 3], weight: &mut [f64]) -> Option<DVec3> {
        let frame = Frame::new(normal);
        let o = frame.local(-d);
        let sampled = self.get(surface, o.z > 0.0)?.sample(o, u, weight)?;
        Some(frame.scene(sampled.direction))
    }
}

/// o mirrored at the unit vector m.
fn mirrored(o: DVec3, m: DVec3) -> DVec3 {
    m * (2.0 * o.dot(m)) - o
}

/// A point of the unit disc, areas kept.
fn disc(u: [f64; 2]) -> DVec2 {
    let (r, phi) = (u[0].sqrt(), TAU * u[1]);
    DVec2::new(r * phi.cos(), r * phi.sin())
}

/// Writes the same value times `reflectance` for every band.
fn scale(f: &mut [f64], reflectance: &[f64], by: f64) {
    f.iter_mut().zip(reflectance).for_each(|(f, rho)| *f = rho * by);
}

/// Multiplies every band by `reflectance` times the same value.
fn weigh(weight: &mut [f64], reflectance: &[f64], by: f64) {
    weight.iter_mut().zip(reflectance).for_each(|(w, rho)| *w *= rho * by);
}

/// 1/π.
const INVERSE_PI: f64 = 1.0 / PI;
