//! Direct light inside elements in which a shadow ends.
//!
//! Where the edge of a shadow crosses an element, slopes recovered from its neighbours (`variation`) say little of how irradiance varies inside: the
//! children of one that is half lit differ from it by an eighth of the jump by its slope, and by half of the jump in truth. Form factors tell more. With
//! F_eL of the row of element e to emitter L and F°_eL of the same pair with nothing between, a shadow ends in e where 0 < F_eL < F°_eL, between its corners as well as
//! at them, and its children c differ by
//!
//! ```text
//! H_c − H_e ≈ Σ_L E_L (F_cL − Σ_c A_c F_cL / A_e),      E_L² F_eL (F°_eL − F_eL) > (LEAST ⟨H⟩)²
//! ```
//!
//! where the second, the mean square of H over a lit and a dark part, says that it matters. These differences are taken where they are larger, as squares over the element, than those
//! of the slopes, which have reflected light in them. To find the cell that holds an edge and keep its two sides apart, where a slope would smear them, is the idea of subcell
//! resolution (A. Harten, "ENO schemes with subcell resolution", J. Comput. Phys. 83, 1989); here it need not be guessed from means where the edge lies.
//!
//! Children are constant in their turn. With a share t of an element lit, evenly spread, they carry half of the mean square t(1 − t) J² of a jump J, and √⅝ of the rms
//! first moment: the error of far receivers goes by moments, that of near ones by squares, so that an estimate by children is 0.71 to 0.79 of the truth at
//! hard edges (and by moments 0.75 of it at slopes).
//!
//! What is *not* here: edges of shadows in reflected light and in that of emitters no brighter than what they light, which are as soft; and what lies inside a part of an element
//! between contacts that the lines of the next level do not cut.

use radiosity_core::{BandValues, StoreError};
use radiosity_form_factors::analytic::{LARGE, PartialVisibility, unoccluded};
use radiosity_form_factors::{PairwiseRows, Rows};
use radiosity_geometry::Facets;
use rayon::prelude::*;

use super::State;
use super::variation::Variation;
use crate::estimate::analytic;
use crate::{Geometry, Method};

/// E in units of the mean irradiance from which on an emitter counts, as of surfaces that shine.
const BRIGHTER: f64 = 2.0;
/// Least rms variation by an edge, in units of the mean irradiance.
const LEAST: f64 = 0.25;
/// Error of form factors with nothing between, which enter nothing but the estimate.
const TOLERANCE: f64 = 1e-4;
/// Segments of a partly hidden child, about: a quarter as many add 5 % of noise to the estimate of the Cornell box, half as many 60 % to that of a soft shadow in a room of 192 elements.
const SEGMENTS: f64 = 128.0;
/// Powers of two of segments that pairs are given, the first ones.
const POWERS: u32 = 5;

/// An emitter that counts.
struct Light {
    /// Its place among the emitters.
    place: u32,
    /// The patches it sends from.
    patches: Vec<usize>,
    /// E of every band.
    emission: Vec<f64>,
}

/// H_c − H_e of the children on `fine`, child k of element `of[k]`: by the slopes of `variation`, and by direct light where a shadow ends; `level` is the
/// mean irradiance of what is asked for.
pub(super) fn differences(
    state: &State<'_>,
    variation: &Variation,
    (fine, of): (&Geometry<'_>, &[usize]),
    level: f64,
) -> Result<BandValues, StoreError> {
    let geometry = &state.geometry;
    let (m, bands) = (geometry.elements().len(), geometry.reflectance().count());
    let centre = |facets: &Facets, k: usize| facets.polygons(k)[0].centroid();
    let along = |band: usize, k: usize| {
        let apart = centre(fine.elements(), k) - centre(geometry.elements(), of[k]);
        variation.gradient(band, of[k]).dot(apart)
    };
    let all = (0..bands).flat_map(|band| (0..of.len()).map(move |k| (band, k)));
    let mut found = BandValues::new(all.map(|(band, k)| along(band, k)).collect(), of.len());

    let lights = lights(geometry, level);
    let crossed = crossed(state, &lights, level);
    let children: Vec<u32> = (0..of.len() as u32).filter(|&k| crossed[of[k as usize]].is_some()).collect();
    if children.is_empty() {
        return Ok(found);
    }
    let sources = fine.elements().select(&children);
    let places: Vec<u32> = lights.iter().map(|light| light.place).collect();
    let targets = geometry.emitters().0.select(&places);
    let with_samples = |power: u32| {
        let partial = PartialVisibility::Rays { samples: 1 << power, standard_error: f64::INFINITY };
        PairwiseRows::new(analytic(geometry.blockers(), partial), &sources, &targets, TOLERANCE, state.seed)
    };
    let rows: Vec<_> = (0..POWERS).map(with_samples).collect();
    // A_c H_c by these lights.
    let direct = |j: usize| -> Result<Vec<f64>, StoreError> {
        let mut row = vec![0.0; lights.len()];
        let open = crossed[of[children[j] as usize]].expect("children of what is crossed");
        let samples = SEGMENTS / (open / LARGE).max(1.0);
        let power = (samples.max(1.0).log2().round() as usize).min(rows.len() - 1);
        rows[power].row(j, &mut row)?;
        let of_band = |band: usize| lights.iter().zip(&row).map(|(light, f)| light.emission[band] * f).sum::<f64>();
        Ok((0..bands).map(of_band).collect())
    };
    let direct: Result<Vec<Vec<f64>>, StoreError> = (0..children.len()).into_par_iter().map(direct).collect();
    let direct = direct?;
    let each = || children.iter().map(|&k| k as usize).zip(&direct).zip(sources.areas());

    // Σ_c A_c H_c, and Σ_c A_c (H_c − H_e)² by direct light less that by slopes.
    let mut sums = BandValues::zeros(bands, m);
    let (mut whole, mut more) = (vec![0.0; m], vec![0.0; m]);
    for ((k, direct), area) in each() {
        whole[of[k]] += area;
        (0..bands).for_each(|band| sums.band_mut(band)[of[k]] += direct[band]);
    }
    let step = |band: usize, k: usize, direct: f64, area: f64| direct / area - sums.band(band)[of[k]] / whole[of[k]];
    for ((k, direct), area) in each() {
        let square = |band: usize| step(band, k, direct[band], area).powi(2) - found.band(band)[k].powi(2);
        more[of[k]] += area * (0..bands).map(square).sum::<f64>();
    }
    for ((k, direct), area) in each().filter(|((k, _), _)| more[of[*k]] > 0.0) {
        (0..bands).for_each(|band| found.band_mut(band)[k] = step(band, k, direct[band], area));
    }
    Ok(found)
}

/// The largest form factor, with nothing between, of each element to a light whose shadow ends there, if any does.
fn crossed(state: &State<'_>, lights: &[Light], level: f64) -> Vec<Option<f64>> {
    let (m, reflectance) = (state.geometry.elements().len(), state.geometry.reflectance());
    let sends = |e: usize| (0..reflectance.count()).any(|band| reflectance.band(band)[e] > 0.0);
    let open = |e: usize| {
        let partly = lights.iter().filter_map(|light| partly_hidden(state, light, e, level));
        partly.filter(|_| sends(e)).reduce(f64::max)
    };
    (0..m).into_par_iter().map(open).collect()
}

/// The form factor of an element to a light with nothing between, if the light is partly hidden from it and so much of it that it matters.
fn partly_hidden(state: &State<'_>, light: &Light, e: usize, level: f64) -> Option<f64> {
    let elements = state.geometry.elements();
    let noise = match state.method {
        // The totals of emitters have none.
        Method::RaysAndEmitters { .. } => 0.0,
        _ => state.store.bound(e),
    };
    let pieces = state.geometry.emitters().0.polygons(light.place as usize);
    let open: f64 = pieces.iter().map(|piece| unoccluded(&elements.polygons(e)[0], piece, TOLERANCE).value).sum();
    let entries = state.store.entries(e);
    let seen: f64 = light.patches.iter().map(|&p| entries[p]).sum();
    let (hidden, area) = (open - seen, elements.area(e));
    let varies = mean(&light.emission) * (seen * hidden).max(0.0).sqrt() / area;
    (seen.min(hidden) > noise && varies > LEAST * level).then_some(open / area)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The emitters that count, if anything can come between.
fn lights(geometry: &Geometry<'_>, level: f64) -> Vec<Light> {
    if geometry.blockers().is_empty() {
        return Vec::new();
    }
    let (of_elements, emission) = (geometry.surfaces(), geometry.emission());
    let light = |(place, &surface): (u32, &u32)| {
        let on = || (0..of_elements.len()).filter(|&e| of_elements[e] == surface);
        let first = on().next()?;
        let emission: Vec<f64> = (0..emission.count()).map(|b| emission.band(b)[first]).collect();
        let mut patches: Vec<usize> = on().map(|e| geometry.parent()[e] as usize).collect();
        patches.sort_unstable();
        patches.dedup();
        (mean(&emission) > BRIGHTER * level).then_some(Light { place, patches, emission })
    };
    (0..).zip(geometry.emitters().1).filter_map(light).collect()
}
