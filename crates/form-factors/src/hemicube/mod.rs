//! Rows by hemicube (Cohen and Greenberg 1985): the scene seen from the sender's centre, drawn on five faces.
//!
//! ```text
//! F_st ≈ Σ_{pixels q that show t} ΔF_q
//! ```
//!
//! ΔF_q is the exact form factor from the centre to the pixel's rectangle (see `delta`), so that the ΔF sum to 1
//! without normalising. Polygons are sorted into `clusters` once; `view` turns what can be seen into the source's frame, and
//! `raster` decides which polygon each pixel shows.
//!
//! Three assumptions cost accuracy (Baum, Rushmeier, Winget 1989):
//!
//! - **Aliasing.** A receiver is resolved to whole pixels: an error of half a ΔF a border pixel. Each source's hemicube is
//!   turned about its normal by an angle of its own, which makes noise of it.
//! - **Proximity.** The sender is a point, which is wrong for receivers nearer than about five times its diameter.
//! - **Visibility** is that of the centre. No bound covers that; [`Hemicube::quartered`] looks from more points.
//!
//! The first two are estimated for every entry (see `estimate`). Where proximity is the larger, and for receivers of few
//! pixels or none, the pixels say only what share of the receiver is seen, and `near` multiplies the analytic factor of
//! the pair with it:
//!
//! ```text
//! A_s F_st = A_s F_st (unoccluded) · Σ_{pixels that show t} ΔF / Σ_{pixels that t covers} ΔF
//! ```
//!
//! So receivers that are wholly seen have no error but the rule's tolerance of 1e-8. In a closed scene the other entries
//! are scaled so that the row sums to A_s as before; in an open one the row's sum changes with its entries.
//!
//! Rows have the same bytes on any number of threads and every instruction set.

mod clusters;
mod delta;
mod estimate;
mod near;
mod raster;
mod solids;
mod view;

use std::borrow::Cow;
use std::f64::consts::TAU;
use std::sync::Mutex;

use pulp::Arch;
use radiosity_core::{Cost, StoreError};
use radiosity_geometry::{Facets, Polygon};
use rayon::prelude::*;

use crate::row_wise::Receivers;
use crate::rows::{Rows, mix};
use clusters::Clusters;
use delta::DeltaFormFactors;
use near::Entry;
use raster::{BACK, Canvas, Draw, EMPTY, FIRST, Shown};
use view::{Frame, Look, View};

/// Hemicube rows from facets to facets; several polygons of one source take a hemicube each, weighted by area.
pub struct Hemicube<'a> {
    sources: &'a Facets,
    receivers: Receivers<'a>,
    /// Polygons of all receivers, with the target of each.
    polygons: Vec<(&'a Polygon, Option<u32>)>,
    clusters: Clusters,
    delta: DeltaFormFactors,
    centres: Vec<f64>,
    seed: u64,
    arch: Arch,
    exact_near: bool,
    quarterings: u32,
    canvases: Spare<Canvas>,
    scratch: Spare<Scratch>,
}

/// Why a hemicube cannot be set up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum HemicubeError {
    /// Half faces need whole rows of pixels.
    #[error("the hemicube resolution is {resolution}; it must be even and between 2 and 4096")]
    Resolution {
        /// The value given.
        resolution: u32,
    },
}

/// What the pixels of one hemicube show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PixelCount {
    /// Pixels that show a front.
    pub front: u64,
    /// Pixels that show a back: the light is lost there.
    pub back: u64,
    /// Pixels that show nothing: an open scene.
    pub empty: u64,
}

/// Buffers that are used again: one each for as many as work at once.
struct Spare<T>(Mutex<Vec<T>>);

impl<T: Default> Spare<T> {
    fn with<R>(&self, work: impl FnOnce(&mut T) -> R) -> R {
        let stack = || self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let mut buffer = stack().pop().unwrap_or_default();
        let result = work(&mut buffer);
        stack().push(buffer);
        result
    }
}

/// What one hemicube needs while it is made.
#[derive(Default)]
struct Scratch {
    view: View,
    /// What each face shows: empty pixels, backs, then its polygons.
    faces: [Vec<Shown>; 5],
    /// What all faces show of every polygon of the view.
    shown: Vec<Shown>,
    entries: Vec<Entry>,
}

impl<'a> Hemicube<'a> {
    /// Hemicubes of `resolution` × `resolution` pixels on the top face and half of that on each side.
    ///
    /// # Errors
    ///
    /// [`HemicubeError`] if the resolution is odd or out of range.
    pub fn new(
        sources: &'a Facets,
        receivers: Receivers<'a>,
        resolution: u32,
        seed: u64,
    ) -> Result<Self, HemicubeError> {
        if !resolution.is_multiple_of(2) || !(2..=4096).contains(&resolution) {
            return Err(HemicubeError::Resolution { resolution });
        }
        let target = |k: usize| receivers.target(k).map(|target| target as u32);
        let polygons: Vec<_> = receivers.all().iter_polygons().map(|(k, polygon)| (polygon, target(k))).collect();
        Ok(Self {
            sources,
            receivers,
            clusters: Clusters::new(&polygons.iter().map(|(polygon, _)| *polygon).collect::<Vec<_>>()),
            polygons,
            delta: DeltaFormFactors::new(resolution as usize),
            centres: raster::centres(resolution as usize),
            seed,
            arch: Arch::new(),
            exact_near: true,
            quarterings: 0,
            canvases: Spare(Mutex::default()),
            scratch: Spare(Mutex::default()),
        })
    }

    /// Whether targets that a hemicube is no good for get their analytic factor (see the module); they do by default.
    #[must_use]
    pub fn exact_near(self, exact_near: bool) -> Self {
        Self { exact_near, ..self }
    }

    /// Cuts every polygon of a source into 4 parts, and those again, `times` times (8 at most), with a hemicube for each.
    ///
    /// Visibility is then that of 4^`times` points, which is what is wrong at shadows; proximity falls by 4 each time.
    #[must_use]
    pub fn quartered(self, times: u32) -> Self {
        Self { quarterings: times.min(8), ..self }
    }

    /// Compiled for `arch` instead of the best instruction set of the machine. No bit of any row depends on it.
    #[must_use]
    pub fn on(self, arch: Arch) -> Self {
        Self { arch, ..self }
    }

    /// What the hemicubes of source `s` show.
    pub fn pixels(&self, s: usize) -> PixelCount {
        let mut count = PixelCount::default();
        for (k, part) in self.parts(s).iter().enumerate() {
            self.scratch.with(|scratch| {
                self.draw(&self.frame(s, k, part), scratch);
                for face in &scratch.faces {
                    count.empty += face[EMPTY].pixels;
                    count.back += face[BACK].pixels;
                    count.front += face[FIRST..].iter().map(|shown| shown.pixels).sum::<u64>();
                }
            });
        }
        count
    }

    /// Row `s` as [`Rows::row`] gives it, with an estimate of the error of every entry in `bounds`: three standard errors of
    /// aliasing and the size of proximity. Visibility that differs between the points of the source is not in it.
    ///
    /// [`Cost::clear_pairs`] and [`Cost::partial_pairs`] count the entries that came from pairs, wholly seen or in part.
    ///
    /// # Panics
    ///
    /// If `values` or `bounds` has not one place for every target.
    pub fn row_with_bounds(&self, s: usize, values: &mut [f64], bounds: &mut [f64]) -> Cost {
        assert_eq!((values.len(), bounds.len()), (self.targets(), self.targets()), "row: lengths");
        values.fill(0.0);
        bounds.fill(0.0);
        if self.sources.covered(s) {
            return Cost::default();
        }
        let mut cost = Cost { form_factors: values.len() as u64, source_evaluations: 1, ..Cost::default() };
        for (k, part) in self.parts(s).iter().enumerate() {
            let frame = self.frame(s, k, part);
            self.scratch.with(|scratch| {
                self.draw(&frame, scratch);
                cost += self.entries(part, &frame, scratch);
                for entry in &scratch.entries {
                    values[entry.target as usize] += entry.value;
                    bounds[entry.target as usize] += entry.bound;
                }
            });
            cost.hemicube_pixels += 3 * (self.delta.resolution() as u64).pow(2);
        }
        cost
    }

    /// What takes a hemicube each: the polygons of source `s` or the parts they are cut into.
    fn parts(&self, s: usize) -> Cow<'a, [Polygon]> {
        let mut parts = Cow::Borrowed(self.sources.polygons(s));
        for _ in 0..self.quarterings {
            parts = Cow::Owned(parts.iter().flat_map(quarters).collect());
        }
        parts
    }

    /// The frame of part `k` of source `s`.
    fn frame(&self, s: usize, k: usize, part: &Polygon) -> Frame {
        let random = mix(mix(self.seed ^ s as u64).wrapping_add(k as u64));
        Frame::new(part, TAU * (random >> 11) as f64 / (1_u64 << 53) as f64)
    }

    /// Draws the five faces from `frame` and puts together what they show.
    fn draw(&self, frame: &Frame, scratch: &mut Scratch) {
        let Scratch { view, faces, shown, .. } = scratch;
        self.arch.dispatch(Look { view, frame, clusters: &self.clusters });
        let (view, delta, centres) = (&*view, &self.delta, &self.centres[..]);
        faces.par_iter_mut().enumerate().for_each(|(face, shown)| {
            self.canvases.with(|canvas| {
                self.arch.dispatch(Draw { view, face, delta, centres, canvas, shown, glimpse: self.exact_near });
            });
        });
        shown.clear();
        shown.resize(view.seen.len(), Shown::default());
        for (face, of_face) in view.faces.iter().zip(faces) {
            face.iter().zip(&of_face[FIRST..]).for_each(|(&k, more)| shown[k as usize].add(more));
        }
    }
}

/// A polygon cut through its centroid along the axes of its frame; fewer parts where one would have no area.
fn quarters(polygon: &Polygon) -> Vec<Polygon> {
    let (u, v) = polygon.frame();
    // Corners as near to a cut as that count as on it, whatever rounding says.
    let snap = 1e-9 * polygon.diameter();
    let cut = |part: Polygon, normal| match part.split(part.centroid(), normal, snap) {
        Some((front, back)) => vec![front, back],
        None => vec![part],
    };
    cut(polygon.clone(), u).into_iter().flat_map(|half| cut(half, v)).collect()
}

impl Rows for Hemicube<'_> {
    fn name(&self) -> &'static str {
        "hemicube"
    }

    fn sources(&self) -> usize {
        self.sources.len()
    }

    fn targets(&self) -> usize {
        self.receivers.count()
    }

    fn symmetric(&self) -> bool {
        false
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        let mut bounds = vec![0.0; values.len()];
        let cost = self.row_with_bounds(s, values, &mut bounds);
        Ok((cost, bounds.into_iter().fold(0.0, f64::max)))
    }
}
