//! Rows by hemicube (Cohen and Greenberg 1985): the scene seen from the sender's centre, drawn on five faces.
//!
//! ```text
//! F_st ≈ Σ_{pixels q that show t} ΔF_q
//! ```
//!
//! ΔF_q is the exact form factor from the centre to the pixel's rectangle (see `delta`), so that the ΔF sum to 1
//! without normalising; `raster` decides which polygon each pixel shows. Three assumptions cost accuracy (Baum,
//! Rushmeier, Winget 1989): the sender is a point (wrong for receivers nearer than about five times its diameter),
//! visibility is that of the centre, and a receiver is resolved to whole pixels (aliasing, error of about one ΔF a
//! border pixel, so ∝ 1/resolution). Each source's hemicube is turned about its normal by an angle of its own, so that
//! no pixel centre lies on an edge by symmetry and aliasing differs between sources.
//!
//! What is *not* here: several centres a sender chosen by proximity, and an analytic rule for near receivers.

mod delta;
mod raster;

use std::f64::consts::TAU;

use radiosity_core::{Cost, StoreError};
use radiosity_geometry::{Facets, Polygon};
use rayon::prelude::*;

use crate::row_wise::Receivers;
use crate::rows::{Rows, mix};
use delta::DeltaFormFactors;
use raster::{Eye, Item};

/// Hemicube rows from facets to facets; several polygons of one source take a hemicube each, weighted by area.
#[derive(Clone)]
pub struct Hemicube<'a> {
    sources: &'a Facets,
    receivers: Receivers<'a>,
    delta: DeltaFormFactors,
    seed: u64,
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
        Ok(Self { sources, receivers, delta: DeltaFormFactors::new(resolution as usize), seed })
    }

    /// What the hemicubes of source `s` show.
    pub fn pixels(&self, s: usize) -> PixelCount {
        let mut count = PixelCount::default();
        for polygon in self.sources.polygons(s) {
            let eye = self.eye(s, polygon);
            for face in 0..5 {
                for item in raster::draw(&eye, self.receivers.all(), face, self.delta.resolution()) {
                    match item {
                        Item::Front(_) => count.front += 1,
                        Item::Back => count.back += 1,
                        Item::Empty => count.empty += 1,
                    }
                }
            }
        }
        count
    }

    fn eye(&self, s: usize, polygon: &Polygon) -> Eye {
        let turn = TAU * (mix(self.seed ^ s as u64) >> 11) as f64 / (1_u64 << 53) as f64;
        Eye::new(polygon, turn, self.receivers.all())
    }
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
        assert_eq!(values.len(), self.targets(), "row: length");
        values.fill(0.0);
        if self.sources.covered(s) {
            return Ok((Cost::default(), 0.0));
        }
        let resolution = self.delta.resolution();
        let mut cost = Cost { form_factors: values.len() as u64, source_evaluations: 1, ..Cost::default() };
        let mut bound = 0.0;
        for polygon in self.sources.polygons(s) {
            let eye = self.eye(s, polygon);
            let faces: Vec<Vec<Item>> =
                (0..5).into_par_iter().map(|face| raster::draw(&eye, self.receivers.all(), face, resolution)).collect();
            for (face, items) in faces.iter().enumerate() {
                for (item, delta) in items.iter().zip(self.delta.face(face)) {
                    let target = if let Item::Front(k) = *item { self.receivers.target(k as usize) } else { None };
                    if let Some(target) = target {
                        values[target] += polygon.area() * delta;
                    }
                }
                cost.hemicube_pixels += items.len() as u64;
            }
            // A target as wide as a face has about 4 · resolution border pixels, each wrong by half its ΔF; errors of
            // either sign add like a random walk.
            bound += polygon.area() * self.delta.largest() * (resolution as f64).sqrt();
        }
        Ok((cost, bound))
    }
}
