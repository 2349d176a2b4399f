//! What is asked for: everything, some surfaces, or what the pixels of a camera show.
//!
//! An error of irradiance counts by squares over what is asked for, relative to its mean over it and over the bands,
//!
//! ```text
//! error² = Σ_e a_e ⟨s_e² δ_e²⟩ / Σ a / level²,      level = Σ_e a_e ⟨s_e H_e⟩ / Σ a,      ⟨·⟩ the mean over the bands
//! ```
//!
//! | asked for | a_e | s_e |
//! |---|---|---|
//! | surfaces ([`Strategy::asked`]) | A_e on them, 0 elsewhere | 1 |
//! | a view ([`Strategy::view`]) | share of the pixels in whose middle the front of e is seen | ρ_e |
//!
//! So of a view it is the rms over pixels of what they show wrongly, relative to the mean over pixels of what they show of light that is reflected: what lamps
//! emit is known, and would hide any error in a picture that shows one. Pixels that show no front do not count. If both are given, pixels count that show one of
//! the surfaces. A pixel is the point in its middle; the mean over more points of a pixel has no larger error, by Jensen's inequality.
//!
//! In units of areas W = a s²/A weighs squares of errors and W = a s/A irradiance itself: ⟨W, H⟩ = Σ A W H is the picture's mean, and the importances for it those of
//! [`Importance`](crate::Importance).
//!
//! What is *not* here: what mirrors and glass show, which takes all elements, and pixels that filter.

use radiosity_core::BandValues;
use radiosity_geometry::{Occluders, Scene};
use radiosity_render::Camera;
use rayon::prelude::*;

use crate::plan::Omissions;
use crate::{Geometry, Strategy};

/// Weights of what is asked for on the exposed elements of a geometry.
#[derive(Clone, Debug)]
pub(crate) struct Asked {
    /// a_e.
    pub(crate) parts: Vec<f64>,
    /// Σ a, covered parts of surfaces included.
    pub(crate) total: f64,
    /// s_e, band after band, where it is not 1.
    shown: Option<BandValues>,
}

/// Surfaces and camera by which something is asked for.
pub(crate) type Named<'a> = (Option<&'a [u32]>, Option<&'a Camera>);

impl Strategy {
    /// What it asks for.
    pub(crate) fn named(&self) -> Named<'_> {
        (self.asked.as_deref(), self.view.as_ref())
    }

    /// The surfaces that alone are asked for, if any are: those named, or those in view.
    pub(crate) fn asked_surfaces(&self, scene: &Scene) -> Option<Vec<u32>> {
        self.asked.clone().or_else(|| Some(surfaces_in_view(scene, self.view.as_ref()?)))
    }

    /// Whether less than all is asked for, and anything may be left out: errors elsewhere count by their importance then.
    pub(crate) fn asks(&self) -> bool {
        (self.asked.is_some() || self.view.is_some()) && self.omit != Omissions::NONE
    }
}

impl Asked {
    /// What is `named`; everything if nothing of it has an exposed area, to which an error could be relative.
    pub(crate) fn new(geometry: &Geometry<'_>, named: Named<'_>) -> Self {
        Self::some(geometry, named).unwrap_or_else(|| Self::surfaces(geometry, None))
    }

    /// What is `named` of the elements that take part, if that is less than everything and not nothing.
    pub(crate) fn some(geometry: &Geometry<'_>, named: Named<'_>) -> Option<Self> {
        let less = named.0.is_some() || named.1.is_some();
        let found = less.then(|| Self::of(geometry, named))?;
        found.parts.iter().any(|part| *part > 0.0).then_some(found)
    }

    /// What is `named` of the elements that take part, be it nothing.
    pub(crate) fn of(geometry: &Geometry<'_>, (asked, view): Named<'_>) -> Self {
        match view {
            Some(camera) => Self::view(geometry, camera, asked),
            None => Self::surfaces(geometry, asked),
        }
    }

    fn surfaces(geometry: &Geometry<'_>, asked: Option<&[u32]>) -> Self {
        let is_asked = |surface: u32| asked.is_none_or(|asked| asked.binary_search(&surface).is_ok());
        let (mesh, own) = (geometry.mesh(), geometry.surfaces());
        // Covered parts are part of a report.
        let all = mesh.elements.iter().zip(mesh.areas());
        let total = all.filter(|(element, _)| is_asked(element.surface)).map(|(_, area)| area).sum();
        let parts = geometry.elements().areas().into_iter().zip(own);
        let parts = parts.map(|(area, surface)| if is_asked(surface) { area } else { 0.0 }).collect();
        Self { parts, total, shown: None }
    }

    fn view(geometry: &Geometry<'_>, camera: &Camera, asked: Option<&[u32]>) -> Self {
        let mut parts = vec![0.0; geometry.elements().len()];
        let pixels = Pixels::new(geometry, camera, asked);
        pixels.elements().for_each(|e| parts[e] += 1.0);
        let total = pixels.seen.len() as f64;
        if total > 0.0 {
            parts.iter_mut().for_each(|part| *part /= total);
        }
        Self { parts, total: 1.0, shown: Some(geometry.reflectance()) }
    }

    /// Whether it is a picture.
    pub(crate) fn is_view(&self) -> bool {
        self.shown.is_some()
    }

    /// s_e in a band.
    fn shown(&self, band: usize, e: usize) -> f64 {
        self.shown.as_ref().map_or(1.0, |shown| shown.band(band)[e])
    }

    /// What of `values` is asked for: a_e, s_e and the value of each element of a band that counts.
    fn of_band<'v>(&'v self, values: &'v BandValues, band: usize) -> impl Iterator<Item = (f64, f64)> + 'v {
        let parts = self.parts.iter().zip(values.band(band)).enumerate();
        // What is not asked for may be no number.
        parts.filter(|(_, (part, _))| **part > 0.0).map(move |(e, (part, value))| (*part, self.shown(band, e) * value))
    }

    /// Mean over what is asked for and the bands, of `h` or what it makes of it.
    pub(crate) fn level(&self, h: &BandValues) -> f64 {
        let sum: f64 = (0..h.count()).flat_map(|b| self.of_band(h, b).map(|(part, h)| part * h)).sum();
        sum / (h.count() as f64 * self.total)
    }

    /// Σ_e a_e s_e² δ_e² in a band.
    pub(crate) fn square(&self, by: &BandValues, band: usize) -> f64 {
        self.of_band(by, band).map(|(part, by)| part * by * by).sum()
    }

    /// Largest a_e s_e²/A_e in a band: by how much a square over all areas exceeds that over what is asked for at least.
    pub(crate) fn densest(&self, areas: &[f64], band: usize) -> f64 {
        let densities = self.parts.iter().zip(areas).enumerate();
        densities.map(|(e, (part, area))| part * self.shown(band, e).powi(2) / area).fold(0.0, f64::max)
    }

    /// a_e ⟨s_e²⟩: what squares of errors that bands share count by.
    pub(crate) fn squares(&self) -> Vec<f64> {
        let Some(shown) = &self.shown else { return self.parts.clone() };
        let bands = shown.count();
        let of = |e: usize| (0..bands).map(|b| shown.band(b)[e].powi(2)).sum::<f64>() / bands as f64;
        self.parts.iter().enumerate().map(|(e, part)| part * of(e)).collect()
    }

    /// √(Σ a ⟨s²⟩ / Σ a) over exposed elements: what is seen of an error that is the same everywhere.
    pub(crate) fn shade(&self) -> f64 {
        if self.shown.is_none() {
            return 1.0;
        }
        (self.squares().iter().sum::<f64>() / self.parts.iter().sum::<f64>()).sqrt()
    }

    /// W of squares, in units in which its mean weighted by itself is 1: 1 on surfaces that are asked for.
    pub(crate) fn weights(&self, areas: &[f64]) -> Vec<f64> {
        if self.shown.is_none() {
            return self.parts.iter().map(|part| f64::from(u8::from(*part > 0.0))).collect();
        }
        let squares = self.squares();
        let sum: f64 = squares.iter().sum();
        let own: f64 = squares.iter().zip(areas).map(|(a, area)| a * a / area).sum();
        squares.iter().zip(areas).map(|(a, area)| a / area * (sum / own)).collect()
    }
}

/// The pixels of a camera in whose middle the front of a surface is seen.
pub(crate) struct Pixels {
    /// Number of the pixel, counted row by row, its surface, and the exposed element that is seen, `u32::MAX` if it has none.
    pub(crate) seen: Vec<(u32, u32, u32)>,
}

impl Pixels {
    /// Those that show one of the surfaces `asked` for.
    pub(crate) fn new(geometry: &Geometry<'_>, camera: &Camera, asked: Option<&[u32]>) -> Self {
        let surfaces: Vec<u32> = geometry.scene().pieces().map(|(s, _)| s as u32).collect();
        let seen = fronts(geometry.element_occluders(), camera).into_iter();
        let named = seen.map(|(pixel, polygon, element)| (pixel, surfaces[polygon as usize], element));
        Self { seen: named.filter(|(_, s, _)| asked.is_none_or(|asked| asked.binary_search(s).is_ok())).collect() }
    }

    /// The exposed elements they show.
    fn elements(&self) -> impl Iterator<Item = usize> + '_ {
        self.seen.iter().filter(|seen| seen.2 != u32::MAX).map(|seen| seen.2 as usize)
    }
}

/// Pixel, polygon and owner of what each pixel shows of the front of `occluders`.
fn fronts(occluders: &Occluders, camera: &Camera) -> Vec<(u32, u32, u32)> {
    let (width, height) = (camera.width(), camera.height());
    let row = |y: u32| {
        (0..width).filter_map(move |x| {
            let direction = camera.direction(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let hit = occluders.first_hit(camera.eye(), direction).filter(|hit| hit.front)?;
            Some((y * width + x, hit.polygon, hit.owner))
        })
    };
    (0..height).into_par_iter().flat_map_iter(row).collect()
}

/// The surfaces of which a pixel of `camera` shows the front, ascending.
pub fn surfaces_in_view(scene: &Scene, camera: &Camera) -> Vec<u32> {
    let seen = fronts(&Occluders::of_scene(scene), camera);
    let mut surfaces: Vec<u32> = seen.into_iter().map(|(.., surface)| surface).collect();
    surfaces.sort_unstable();
    surfaces.dedup();
    surfaces
}

/// W = a ρ/A of every exposed element: ⟨W, H⟩ = Σ A W H is, band by band, the mean over the pixels of `camera` of what they show of reflected light.
/// Its importances are those of the picture ([`Importance::weighted`](crate::Importance::weighted)).
pub fn view_weights(geometry: &Geometry<'_>, camera: &Camera) -> BandValues {
    let Asked { parts, .. } = Asked::view(geometry, camera, None);
    let (areas, mut weights) = (geometry.elements().areas(), geometry.reflectance());
    for band in 0..weights.count() {
        let of_band = weights.band_mut(band).iter_mut().zip(&parts).zip(&areas);
        of_band.for_each(|((weight, part), area)| *weight *= part / area);
    }
    weights
}
