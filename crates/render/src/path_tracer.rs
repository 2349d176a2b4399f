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
use crate::film::Film;
use crate::numbers::Numbers;
use crate::path_class::{Itinerary, PathClasses};
use crate::stage::{Place, RADIANCE, Stage};

/// Scatterings before a path may end at random.
const SURE: u32 = 3;

/// Traces paths through a stage.
pub struct PathTracer<'a> {
    stage: &'a Stage<'a>,
    classes: PathClasses,
    /// Largest directional albedo of the specular part of every surface, over a few angles: how often it is followed.
    albedos: Vec<f64>,
}

/// A path on its way from the eye.
struct Walk {
    origin: DVec3,
    direction: DVec3,
    weight: Vec<f64>,
    /// Density over solid angle of the direction; `None` where no light was drawn for it as well.
    density: Option<f64>,
    itinerary: Itinerary,
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
        film.expose(seed, |[x, y], numbers, value| {
            let u = numbers.next();
            let direction = camera.direction(f64::from(x) + u[0], f64::from(y) + u[1]);
            self.radiance(camera.eye(), direction, numbers, value)
        });
    }

    /// Adds a sample of the radiance that arrives at `origin` against `direction` to `value`.
    pub fn radiance(&self, origin: DVec3, direction: DVec3, numbers: &mut Numbers, value: &mut [f64]) -> Cost {
        let weight = vec![1.0; self.stage.bands()];
        self.walk(Walk { origin, direction, weight, density: None, itinerary: Itinerary::default() }, numbers, value)
    }

    /// Adds a sample of the irradiance in W/m² of a point with a normal to `value`; classes are those of a diffuse surface there.
    pub fn irradiance(&self, point: DVec3, normal: DVec3, numbers: &mut Numbers, value: &mut [f64]) -> Cost {
        let (u, frame) = (numbers.next(), Frame::new(normal));
        let local = cosine_direction([u[0], u[1]]);
        // H = ∫ L cosθ dω = E[π L]; as at a diffuse surface of reflectance π.
        let weight = vec![1.0 / RADIANCE; self.stage.bands()];
        let itinerary = Itinerary::AT_RECEIVER;
        let mut cost = self.light(point, numbers, value, itinerary, |i, f, density| {
            let cos = frame.local(i).z.max(0.0);
            f.fill(cos);
            *density = cos * RADIANCE;
        });
        let density = Some(local.z * RADIANCE);
        let walk = Walk { origin: point, direction: frame.scene(local), weight, density, itinerary };
        cost += self.walk(walk, numbers, value);
        cost
    }

    fn walk(&self, mut walk: Walk, numbers: &mut Numbers, value: &mut [f64]) -> Cost {
        let (stage, mut cost, mut scatterings) = (self.stage, Cost::default(), 0);
        loop {
            cost.rays += 1;
            let Some(place) = stage.first(walk.origin, walk.direction) else { return cost };
            self.arrive(&walk, &place, value);
            let u = numbers.next();
            let frame = Frame::new(place.normal);
            let o = frame.local(-walk.direction);
            let reflectance = stage.reflectance(place.surface);
            let diffuse = if place.front { reflectance.iter().copied().fold(0.0, f64::max) } else { 0.0 };
            let specular = stage.specular().get(place.surface, place.front);
            let share = self.share(diffuse, specular.is_some(), place.surface);
            let Some(share) = share else { return cost };
            if u[3] < share {
                walk.weight.iter_mut().zip(reflectance).for_each(|(w, rho)| *w *= rho / share);
                walk.itinerary = walk.itinerary.diffuse();
                let weight = &walk.weight;
                cost += self.light(place.point, numbers, value, walk.itinerary, |i, f, density| {
                    let cos = frame.local(i).z.max(0.0) * RADIANCE;
                    f.iter_mut().zip(weight).for_each(|(f, w)| *f = w * cos);
                    *density = cos;
                });
                let local = cosine_direction([u[0], u[1]]);
                (walk.direction, walk.density) = (frame.scene(local), Some(local.z * RADIANCE));
            } else {
                let Some(part) = specular else { return cost };
                walk.weight.iter_mut().for_each(|w| *w /= 1.0 - share);
                walk.itinerary = walk.itinerary.specular();
                let before = walk.weight.clone();
                let sampled = part.sample(o, [u[0], u[1], u[2]], &mut walk.weight);
                // Where the part has a density, light is drawn as well, whether the sample goes on or not.
                if sampled.is_none_or(|sampled| sampled.density.is_some()) {
                    cost += self.light(place.point, numbers, value, walk.itinerary, |i, f, density| {
                        let i = frame.local(i);
                        part.evaluate(o, i, f);
                        f.iter_mut().zip(&before).for_each(|(f, w)| *f *= w * i.z.abs());
                        *density = part.density(o, i);
                    });
                }
                let Some(sampled) = sampled else { return cost };
                (walk.direction, walk.density) = (frame.scene(sampled.direction), sampled.density);
            }
            walk.origin = place.point;
            scatterings += 1;
            if scatterings > SURE {
                // What is left of a path that began with weight 1 decides whether it goes on.
                let left = walk.weight.iter().copied().fold(0.0, f64::max).min(0.95);
                if numbers.next()[0] >= left {
                    return cost;
                }
                walk.weight.iter_mut().for_each(|w| *w /= left);
            }
        }
    }

    /// How often the diffuse part is followed; `None` where there is nothing to follow.
    fn share(&self, diffuse: f64, specular: bool, surface: usize) -> Option<f64> {
        let other = if specular { self.albedos[surface].max(f64::MIN_POSITIVE) } else { 0.0 };
        (diffuse + other > 0.0).then(|| diffuse / (diffuse + other))
    }

    /// Adds what a path finds where it arrives, weighted against what drawing the light would have found.
    fn arrive(&self, walk: &Walk, place: &Place, value: &mut [f64]) {
        let emission = self.stage.emission(place.surface);
        if !place.front || emission.iter().all(|e| *e == 0.0) || !self.classes.has(walk.itinerary.class()) {
            return;
        }
        let weight = walk.density.map_or(1.0, |density| {
            let cos = -walk.direction.dot(place.normal);
            heuristic(density, self.stage.light_density(place.piece, place.distance, cos))
        });
        for ((value, w), e) in value.iter_mut().zip(&walk.weight).zip(emission) {
            *value += w * weight * e * RADIANCE;
        }
    }

    /// Adds the light of a point drawn on a light, as seen from `point`. `scatter(i, f, density)` gives what of radiance from i counts (f cosθ times the weight
    /// of the path), and the density with which i would be drawn there.
    fn light(
        &self,
        point: DVec3,
        numbers: &mut Numbers,
        value: &mut [f64],
        itinerary: Itinerary,
        scatter: impl FnOnce(DVec3, &mut [f64], &mut f64),
    ) -> Cost {
        let u = numbers.next();
        let Some(light) = self.stage.light_point([u[0], u[1], u[2]]) else { return Cost::default() };
        if !self.classes.has(itinerary.class()) {
            return Cost::default();
        }
        let to = light.point - point;
        let distance = to.length();
        let Some(i) = to.try_normalize() else { return Cost::default() };
        let cos = -i.dot(light.normal);
        if cos <= 0.0 {
            return Cost::default();
        }
        let (mut f, mut density) = (vec![0.0; self.stage.bands()], 0.0);
        scatter(i, &mut f, &mut density);
        if f.iter().all(|f| *f == 0.0) {
            return Cost::default();
        }
        if !self.stage.occluded(point, light.point) {
            let drawn = self.stage.light_density(light.piece, distance, cos);
            let weight = heuristic(drawn, density) / drawn * RADIANCE;
            for ((value, f), e) in value.iter_mut().zip(&f).zip(self.stage.emission(light.surface)) {
                *value += f * weight * e;
            }
        }
        Cost { rays: 1, ..Cost::default() }
    }
}

/// The weight of a sample drawn with density `own` where another way has density `other`: p²/(p² + q²).
fn heuristic(own: f64, other: f64) -> f64 {
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}
