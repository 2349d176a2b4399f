//! The second, view-dependent pass: specular paths from the eye to surfaces whose diffuse light is stored.
//!
//! ```text
//! L(eye) = Σ over specular paths to a point x: (E + ρ H(x))/π · Π of what scatters on the way
//! ```
//!
//! (Wallace, Cohen, Greenberg 1987; Sillion and Puech 1989; Shirley 1990 for emitters sampled and the gather.) The first pass has computed H over a mesh, by way
//! of specular surfaces too if its form factors were extended. What it stands for at x is one of these, by settings:
//!
//! | part of H at x | stored | emitters sampled | final gather |
//! |---|---|---|---|
//! | from a light | from the mesh | points drawn on lights | points drawn on lights |
//! | from a light by way of S | from the mesh | from the mesh | from the mesh |
//! | from diffuse surfaces, by way of S or not | from the mesh | from the mesh | directions followed to their ρ H/π |
//!
//! So every path belongs to one pass whichever is chosen, and no path counts twice: light of the first kind is drawn and never stored as well, what a gather
//! meets counts ρ H and not E. Where H is stored by its ways of arriving ([`Stored::Apart`]), every class of paths ([`PathClass`]) can be had alone. Light by way of S stays
//! with the mesh: a direction in thousands meets it, at a thousand times the brightness of the rest.
//!
//! Errors: those of the mesh at x where H is stored; where it is gathered, those of the mesh at the surfaces around, averaged over directions, and noise. Indirect light
//! is smooth but near contacts and in corners, and a mesh holds it there at no cost a sample; [`Control`] tells where it does not, and is gathered from.
//!
//! What is *not* here: the first pass.

mod control;

pub use control::Control;

use glam::DVec3;
use radiosity_core::{BandValues, Cost};

use crate::Camera;
use crate::brdf::cosine_direction;
use crate::eye;
use crate::film::Film;
use crate::numbers::Numbers;
use crate::path_class::{Arrival as Way, PathClass, PathClasses};
use crate::stage::{RADIANCE, Stage};
use crate::walk::{Arrival, Walk, light};

/// Irradiance over facets.
pub trait Field: Sync {
    /// Adds H of every band in W/m² at a point of a facet, times `weight`, to `h`.
    fn add(&self, facet: u32, point: DVec3, weight: f64, h: &mut [f64]);
}

/// One irradiance a facet.
#[derive(Clone, Copy, Debug)]
pub struct FacetIrradiance<'a>(pub &'a BandValues);

impl Field for FacetIrradiance<'_> {
    fn add(&self, facet: u32, _: DVec3, weight: f64, h: &mut [f64]) {
        h.iter_mut().enumerate().for_each(|(b, h)| *h += weight * self.0.band(b)[facet as usize]);
    }
}

/// What the first pass has found.
#[derive(Clone, Copy)]
pub enum Stored<'a> {
    /// All of H, whichever way it arrived.
    Whole(&'a dyn Field),
    /// H by its ways of arriving, whose sum is H: from a light, from a light by way of S, from diffuse surfaces, and from those by way of S.
    Apart([&'a dyn Field; 4]),
}

/// The ways of [`Stored::Apart`].
const WAYS: [Way; 4] = [Way::Direct, Way::SpecularDirect, Way::Indirect, Way::SpecularIndirect];

/// What the second pass does beside following specular paths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TwoPassSettings {
    /// Points drawn on lights for every diffuse surface that is seen; 0 takes direct light from the mesh.
    pub light_points: u32,
    /// Directions gathered for every diffuse surface that is seen, where [`TwoPass::controlled`] allows; 0 takes indirect light from the mesh.
    pub gather: u32,
}

/// Why a second pass cannot be had.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TwoPassError {
    /// Parts of H are asked for that are not stored apart.
    #[error(
        "the irradiance of the first pass is one sum; to leave parts of it out, to sample lights or to gather, store it by its ways of arriving"
    )]
    OneSum,
    /// A gather without direct light.
    #[error("a final gather finds no direct light; draw at least one point on lights")]
    NoLightPoints,
}

/// Adds what the diffuse part of a surface where a path has arrived sends back along it.
type AtDiffuse<'d> = dyn Fn(&Walk, &Arrival<'_>, &mut Numbers, &mut [f64]) -> Cost + 'd;

/// Follows specular paths over stored irradiance.
pub struct TwoPass<'a> {
    stage: &'a Stage<'a>,
    stored: Stored<'a>,
    settings: TwoPassSettings,
    classes: PathClasses,
    control: Option<&'a Control>,
}

impl<'a> TwoPass<'a> {
    /// Pictures of paths of `classes`.
    ///
    /// # Errors
    ///
    /// [`TwoPassError`] if `stored` does not tell apart what `settings` or `classes` ask for.
    pub fn new(
        stage: &'a Stage<'a>,
        stored: Stored<'a>,
        settings: TwoPassSettings,
        classes: PathClasses,
    ) -> Result<Self, TwoPassError> {
        if settings.gather > 0 && settings.light_points == 0 {
            return Err(TwoPassError::NoLightPoints);
        }
        let has = |arrival, specular_eye| classes.has(PathClass { arrival, specular_eye });
        let mixed = |eye: bool| WAYS.iter().any(|way| has(*way, eye) != has(WAYS[0], eye));
        let apart = matches!(stored, Stored::Apart(_));
        let whole = settings.light_points == 0 && !mixed(false) && !mixed(true);
        if !apart && !whole {
            return Err(TwoPassError::OneSum);
        }
        Ok(Self { stage, stored, settings, classes, control: None })
    }

    /// Gathers from no facets but those that `control` names.
    #[must_use]
    pub fn controlled(self, control: &'a Control) -> Self {
        Self { control: Some(control), ..self }
    }

    /// Another round of samples of every pixel of a camera, in W/(m² sr).
    pub fn expose(&self, camera: &Camera, seed: u64, film: &mut Film) {
        eye::expose(self.stage, self.classes, (camera, seed), film, |walk, classes, numbers, value| {
            self.see(walk, classes, numbers, value)
        });
    }

    /// Adds a sample of the radiance that arrives at `origin` against `direction` to `value`.
    pub fn radiance(&self, origin: DVec3, direction: DVec3, numbers: &mut Numbers, value: &mut [f64]) -> Cost {
        self.see(Walk::from_eye(origin, direction, self.stage.bands()), self.classes, numbers, value)
    }

    /// Adds what a path from the eye finds.
    fn see(&self, walk: Walk, classes: PathClasses, numbers: &mut Numbers, value: &mut [f64]) -> Cost {
        self.follow(walk, classes, numbers, value, &|walk, arrival, numbers, value| {
            if self.gathers(arrival.place.owner) {
                self.gather(walk, arrival, numbers, value)
            } else {
                self.look_up(walk, arrival, numbers, value)
            }
        })
    }

    /// Follows the specular parts of surfaces until the path ends; `diffuse` sees to the diffuse part of each.
    fn follow(
        &self,
        mut walk: Walk,
        classes: PathClasses,
        numbers: &mut Numbers,
        value: &mut [f64],
        diffuse: &AtDiffuse<'_>,
    ) -> Cost {
        let mut cost = Cost::default();
        loop {
            cost.rays += 1;
            let Some(arrival) = walk.arrive(self.stage, classes, value) else { return cost };
            if arrival.place.front && self.stage.reflectance(arrival.place.surface).iter().any(|rho| *rho > 0.0) {
                cost += diffuse(&walk, &arrival, numbers, value);
            }
            if !walk.scatter(self.stage, classes, &arrival, numbers, value, &mut cost) || !walk.survives(numbers) {
                return cost;
            }
        }
    }

    /// Whether directions are gathered from a facet.
    fn gathers(&self, facet: u32) -> bool {
        self.settings.gather > 0 && self.control.is_none_or(|control| control.gathers(facet))
    }

    /// The diffuse part of a surface from what is stored there, and from points drawn on lights.
    fn look_up(&self, walk: &Walk, arrival: &Arrival<'_>, numbers: &mut Numbers, value: &mut [f64]) -> Cost {
        let itinerary = walk.itinerary.diffuse();
        self.reflect_stored(walk, arrival, value, |way| {
            let drawn = way == Way::Direct && self.settings.light_points > 0;
            !drawn && self.classes.has(PathClass { arrival: way, ..itinerary.class() })
        });
        self.draw_lights(walk, arrival, numbers, value)
    }

    /// Adds what the diffuse part of a surface sends back of the irradiance stored there, if it arrived in the ways wanted.
    fn reflect_stored(&self, walk: &Walk, arrival: &Arrival<'_>, value: &mut [f64], wanted: impl Fn(Way) -> bool) {
        let (place, mut h) = (&arrival.place, vec![0.0; value.len()]);
        self.add_stored(place.owner, place.point, &mut h, wanted);
        let reflectance = self.stage.reflectance(place.surface);
        for (((value, w), rho), h) in value.iter_mut().zip(&walk.weight).zip(reflectance).zip(&h) {
            *value += w * rho * RADIANCE * h;
        }
    }

    /// Adds the stored irradiance that arrived in the ways wanted; all of it if it is one sum and the first way is wanted.
    fn add_stored(&self, owner: u32, point: DVec3, h: &mut [f64], wanted: impl Fn(Way) -> bool) {
        if owner == u32::MAX {
            return;
        }
        match self.stored {
            Stored::Whole(field) if wanted(WAYS[0]) => field.add(owner, point, 1.0, h),
            Stored::Whole(_) => {}
            Stored::Apart(fields) => {
                for (field, _) in fields.iter().zip(WAYS).filter(|(_, way)| wanted(*way)) {
                    field.add(owner, point, 1.0, h);
                }
            }
        }
    }

    /// Direct light of the diffuse part of a surface by points drawn on lights.
    fn draw_lights(&self, walk: &Walk, arrival: &Arrival<'_>, numbers: &mut Numbers, value: &mut [f64]) -> Cost {
        let points = self.settings.light_points;
        let reflectance = self.stage.reflectance(arrival.place.surface);
        let itinerary = walk.itinerary.diffuse();
        let draw = |_| {
            light(self.stage, self.classes, itinerary, arrival.place.point, numbers, value, |i, f| {
                let cos = arrival.frame.local(i).z.max(0.0) * RADIANCE / f64::from(points);
                f.iter_mut().zip(&walk.weight).zip(reflectance).for_each(|((f, w), rho)| *f = w * rho * cos);
                0.0
            })
        };
        (0..points).map(draw).sum()
    }

    /// The diffuse part of a surface from what is stored of lights by way of S, points drawn on lights, and directions followed to what is stored around.
    fn gather(&self, walk: &Walk, arrival: &Arrival<'_>, numbers: &mut Numbers, value: &mut [f64]) -> Cost {
        let itinerary = walk.itinerary.diffuse();
        let wanted = |way| self.classes.has(PathClass { arrival: way, ..itinerary.class() });
        self.reflect_stored(walk, arrival, value, |way| way == Way::SpecularDirect && wanted(way));
        let mut cost = self.draw_lights(walk, arrival, numbers, value);
        let reflectance = self.stage.reflectance(arrival.place.surface);
        let rays = f64::from(self.settings.gather);
        for _ in 0..self.settings.gather {
            let u = numbers.draw();
            let mut inner = Walk { itinerary, ..walk.clone() };
            inner.weight.iter_mut().zip(reflectance).for_each(|(w, rho)| *w *= rho / rays);
            inner.worth /= rays;
            inner.leave(arrival, arrival.frame.scene(cosine_direction([u[0], u[1]])), None);
            // Light that is met has been drawn, or is stored.
            cost += self.follow(inner, PathClasses::NONE, numbers, value, &|walk, arrival, _, value| {
                if self.classes.has(walk.itinerary.diffuse().class()) {
                    self.reflect_stored(walk, arrival, value, |_| true);
                }
                Cost::default()
            });
        }
        cost
    }
}
