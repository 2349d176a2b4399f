//! What paths from the eye do alike, whoever follows them: find light, go on at specular surfaces, end.

use glam::DVec3;
use radiosity_core::Cost;

use crate::brdf::{Bsdf, Frame};
use crate::numbers::Numbers;
use crate::path_class::{Itinerary, PathClasses};
use crate::stage::{Place, RADIANCE, Stage};

/// Scatterings before a path may end at random.
const SURE: u32 = 3;

/// A path on its way from the eye.
#[derive(Clone, Debug)]
pub(crate) struct Walk {
    pub origin: DVec3,
    pub direction: DVec3,
    /// What radiance from ahead counts, in every band.
    pub weight: Vec<f64>,
    /// Density over solid angle of the direction; `None` where no light was drawn for it as well.
    pub density: Option<f64>,
    pub itinerary: Itinerary,
    /// How often it was scattered.
    pub scatterings: u32,
    /// Its largest weight at the beginning.
    pub worth: f64,
}

/// Where a path has arrived, seen from the surface.
pub(crate) struct Arrival<'a> {
    pub place: Place,
    pub frame: Frame,
    /// The direction back along the path, in the frame.
    pub o: DVec3,
    /// The specular part of the surface on this side.
    pub part: Option<&'a dyn Bsdf>,
}

impl Walk {
    /// A path of weight 1 that leaves the eye.
    pub fn from_eye(origin: DVec3, direction: DVec3, bands: usize) -> Self {
        let (weight, itinerary) = (vec![1.0; bands], Itinerary::default());
        Self { origin, direction, weight, density: None, itinerary, scatterings: 0, worth: 1.0 }
    }

    /// Goes to the next surface, and adds what it emits if paths of that class count, weighted against what drawing the light would have found.
    pub fn arrive<'s>(&self, stage: &'s Stage<'_>, classes: PathClasses, value: &mut [f64]) -> Option<Arrival<'s>> {
        let place = stage.first(self.origin, self.direction)?;
        let emission = stage.emission(place.surface);
        if place.front && emission.iter().any(|e| *e > 0.0) && classes.has(self.itinerary.class()) {
            let weight = self.density.map_or(1.0, |density| {
                let cos = -self.direction.dot(place.normal);
                heuristic(density, stage.light_density(place.piece, place.distance, cos))
            });
            for ((value, w), e) in value.iter_mut().zip(&self.weight).zip(emission) {
                *value += w * weight * e * RADIANCE;
            }
        }
        let frame = Frame::new(place.normal);
        let part = stage.specular().get(place.surface, place.front);
        Some(Arrival { frame, o: frame.local(-self.direction), part, place })
    }

    /// Goes on by the specular part where it has arrived; `false` where it ends there. Light is drawn as well where that part has a density.
    pub fn scatter(
        &mut self,
        stage: &Stage<'_>,
        classes: PathClasses,
        arrival: &Arrival<'_>,
        numbers: &mut Numbers,
        value: &mut [f64],
        cost: &mut Cost,
    ) -> bool {
        let Some(part) = arrival.part else { return false };
        let (u, o) = (numbers.draw(), arrival.o);
        self.itinerary = self.itinerary.specular();
        let before = self.weight.clone();
        let sampled = part.sample(o, [u[0], u[1], u[2]], &mut self.weight);
        // The sample may be lost though the part has a density.
        if sampled.is_none_or(|sampled| sampled.density.is_some()) {
            *cost += light(stage, classes, self.itinerary, arrival.place.point, numbers, value, |i, f| {
                let i = arrival.frame.local(i);
                part.evaluate(o, i, f);
                f.iter_mut().zip(&before).for_each(|(f, w)| *f *= w * i.z.abs());
                part.density(o, i)
            });
        }
        let Some(sampled) = sampled else { return false };
        self.leave(arrival, arrival.frame.scene(sampled.direction), sampled.density);
        true
    }

    /// Leaves for a new direction.
    pub fn leave(&mut self, arrival: &Arrival<'_>, direction: DVec3, density: Option<f64>) {
        (self.origin, self.direction, self.density) = (arrival.place.point, direction, density);
        self.scatterings += 1;
    }

    /// Whether the path goes on: what is left of its worth decides, and its weight grows by as much.
    pub fn survives(&mut self, numbers: &mut Numbers) -> bool {
        if self.scatterings <= SURE {
            return true;
        }
        let left = (self.weight.iter().copied().fold(0.0, f64::max) / self.worth).min(0.95);
        if numbers.draw()[0] >= left {
            return false;
        }
        self.weight.iter_mut().for_each(|w| *w /= left);
        true
    }
}

/// Adds the light of a point drawn on a light, as seen from `point`, if paths of that class count.
///
/// `scatter(i, f)` gives what of radiance from i counts (f cosθ times the weight of the path) and the density with which i is drawn there too, 0 where
/// it is not.
pub(crate) fn light(
    stage: &Stage<'_>,
    classes: PathClasses,
    itinerary: Itinerary,
    point: DVec3,
    numbers: &mut Numbers,
    value: &mut [f64],
    scatter: impl FnOnce(DVec3, &mut [f64]) -> f64,
) -> Cost {
    let u = numbers.draw();
    let Some(light) = stage.light_point([u[0], u[1], u[2]]) else { return Cost::default() };
    let to = light.point - point;
    let distance = to.length();
    let Some(i) = to.try_normalize() else { return Cost::default() };
    let cos = -i.dot(light.normal);
    if cos <= 0.0 || !classes.has(itinerary.class()) {
        return Cost::default();
    }
    let mut f = vec![0.0; stage.bands()];
    let density = scatter(i, &mut f);
    if f.iter().all(|f| *f == 0.0) {
        return Cost::default();
    }
    if !stage.occluded(point, light.point) {
        let drawn = stage.light_density(light.piece, distance, cos);
        let weight = heuristic(drawn, density) / drawn * RADIANCE;
        for ((value, f), e) in value.iter_mut().zip(&f).zip(stage.emission(light.surface)) {
            *value += f * weight * e;
        }
    }
    Cost { rays: 1, ..Cost::default() }
}

/// The weight of a sample drawn with density `own` where another way has density `other`: p²/(p² + q²) (Veach and Guibas 1995).
fn heuristic(own: f64, other: f64) -> f64 {
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}
