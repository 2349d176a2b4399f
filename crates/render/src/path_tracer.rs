//! The reference: unbiased path tracing (Kajiya 1986), used to check.
//!
//! ```text
//! L = Σ over paths: E/π at the end · Π of what scatters on the way
//! ```
//!
//! Paths begin at the eye. At every surface one of its parts is followed, the diffuse or the specular one, in proportion to what they reflect, so that a
//! path has letters and a class. Where a part has a density, light is found both ways, by a point drawn on a light and by the direction drawn from the
//! part, weighted by the square of their densities (Veach and Guibas 1995); where it mirrors, by the direction alone. Paths end at
//! random once they carry little, with a weight that keeps the mean (Arvo and Kirk 1990). Every mean is unbiased, and its error falls like N^(−1/2).
//!
//! What is *not* here: anything that reuses light between paths, which would not be a reference.

use glam::DVec3;
use radiosity_core::Cost;

use crate::Camera;
use crate::brdf::{Frame, cosine_direction};
use crate::eye;
use crate::film::Film;
use crate::numbers::Numbers;
use crate::path_class::{Itinerary, PathClasses};
use crate::stage::{RADIANCE, Stage};
use crate::walk::{Arrival, Walk, light};

/// Traces paths through a stage.
pub struct PathTracer<'a> {
    stage: &'a Stage<'a>,
    classes: PathClasses,
    /// Largest directional albedo of the specular part of every surface, over a few angles: how often it is followed.
    albedos: Vec<f64>,
}

impl<'a> PathTracer<'a> {
    /// Paths of these classes on `stage`; the others are traced and left out, so that classes add up to the whole sample by sample.
    pub fn new(stage: &'a Stage<'a>, classes: PathClasses) -> Self {
        let bands = stage.bands();
        let albedo = |s: usize| {
            let Some(part) = stage.specular().get(s, true) else { return 0.0 };
            let mut a = vec![0.0; bands];
            let mut largest = 0.0_f64;
            for cos in [1.0, 0.5, 0.1_f64] {
                part.albedo(DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos), &mut a);
                largest = a.iter().copied().fold(largest, f64::max);
            }
            largest
        };
        // Surfaces of one material share what is computed.
        let scene = stage.scene();
        let mut of_material: Vec<Option<f64>> = vec![None; scene.materials.len()];
        let of_surface = |(s, surface): (usize, &radiosity_geometry::Surface)| {
            *of_material[surface.material].get_or_insert_with(|| albedo(s))
        };
        let albedos = scene.surfaces.iter().enumerate().map(of_surface).collect();
        Self { stage, classes, albedos }
    }

    /// Another round of samples of every pixel of a camera, in W/(m² sr).
    pub fn expose(&self, camera: &Camera, seed: u64, film: &mut Film) {
        eye::expose(self.stage, self.classes, (camera, seed), film, |walk, classes, numbers, value| {
            self.follow(walk, classes, numbers, value)
        });
    }

    /// Adds a sample of the radiance that arrives at `origin` against `direction` to `value`.
    pub fn radiance(&self, origin: DVec3, direction: DVec3, numbers: &mut Numbers, value: &mut [f64]) -> Cost {
        self.follow(Walk::from_eye(origin, direction, self.stage.bands()), self.classes, numbers, value)
    }

    /// Adds a sample of the irradiance in W/m² of a point with a normal to `value`; classes are those of a diffuse surface there.
    pub fn irradiance(&self, point: DVec3, normal: DVec3, numbers: &mut Numbers, value: &mut [f64]) -> Cost {
        let (u, frame) = (numbers.draw(), Frame::new(normal));
        let itinerary = Itinerary::AT_RECEIVER;
        let mut cost = light(self.stage, self.classes, itinerary, point, numbers, value, |i, f| {
            let cos = frame.local(i).z.max(0.0);
            f.fill(cos);
            cos * RADIANCE
        });
        // H = ∫ L cosθ dω = E[π L].
        let (local, weight) = (cosine_direction([u[0], u[1]]), vec![1.0 / RADIANCE; self.stage.bands()]);
        let (direction, density) = (frame.scene(local), Some(local.z * RADIANCE));
        cost += self.follow(
            Walk { origin: point, direction, weight, density, itinerary, scatterings: 0, worth: 1.0 / RADIANCE },
            self.classes,
            numbers,
            value,
        );
        cost
    }

    fn follow(&self, mut walk: Walk, classes: PathClasses, numbers: &mut Numbers, value: &mut [f64]) -> Cost {
        let mut cost = Cost::default();
        loop {
            cost.rays += 1;
            let Some(arrival) = walk.arrive(self.stage, classes, value) else { return cost };
            let Some(share) = self.share(&arrival) else { return cost };
            let goes_on = if numbers.draw()[0] < share {
                self.reflect(&mut walk, &arrival, share, numbers, value, &mut cost);
                true
            } else {
                walk.weight.iter_mut().for_each(|w| *w /= 1.0 - share);
                walk.scatter(self.stage, classes, &arrival, numbers, value, &mut cost)
            };
            if !goes_on || !walk.survives(numbers) {
                return cost;
            }
        }
    }

    /// How often the diffuse part is followed; `None` where there is nothing to follow.
    fn share(&self, arrival: &Arrival<'_>) -> Option<f64> {
        let surface = arrival.place.surface;
        let reflectance = self.stage.reflectance(surface).iter().copied().fold(0.0, f64::max);
        let diffuse = if arrival.place.front { reflectance } else { 0.0 };
        let specular = if arrival.part.is_some() { self.albedos[surface].max(f64::MIN_POSITIVE) } else { 0.0 };
        (diffuse + specular > 0.0).then(|| diffuse / (diffuse + specular))
    }

    /// Goes on by the diffuse part, which is followed with probability `share`.
    fn reflect(
        &self,
        walk: &mut Walk,
        arrival: &Arrival<'_>,
        share: f64,
        numbers: &mut Numbers,
        value: &mut [f64],
        cost: &mut Cost,
    ) {
        let (u, reflectance) = (numbers.draw(), self.stage.reflectance(arrival.place.surface));
        walk.weight.iter_mut().zip(reflectance).for_each(|(w, rho)| *w *= rho / share);
        walk.itinerary = walk.itinerary.diffuse();
        let weight = &walk.weight;
        *cost += light(self.stage, self.classes, walk.itinerary, arrival.place.point, numbers, value, |i, f| {
            let cos = arrival.frame.local(i).z.max(0.0) * RADIANCE;
            f.iter_mut().zip(weight).for_each(|(f, w)| *f = w * cos);
            cos
        });
        let local = cosine_direction([u[0], u[1]]);
        walk.leave(arrival, arrival.frame.scene(local), Some(local.z * RADIANCE));
    }
}
