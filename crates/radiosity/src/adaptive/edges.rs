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
//! where the right side, the mean square of H over a lit and a dark part, says that it matters: the rest of H is taken as alike for all children. To find the cell
//! that holds an edge and keep its two sides apart, where a slope would smear them, is the idea of subcell resolution (A. Harten, "ENO schemes with subcell
//! resolution", J. Comput. Phys. 83, 1989); here it need not be guessed from means where the edge lies.
//!
//! Children are constant in their turn. With a share t of an element lit, evenly spread, they carry half of the mean square t(1 − t) J² of a jump J, and √⅝ of the rms
//! first moment: the error of far receivers goes by moments, that of near ones by squares, so that an estimate by children is 0.71 to 0.79 of the truth at
//! hard edges (and by moments 0.75 of it at slopes).
//!
//! What is *not* here: edges of shadows in reflected light and in that of emitters no brighter than what they light, which are as soft.

use radiosity_core::{BandValues, StoreError};
use radiosity_form_factors::analytic::{PartialVisibility, unoccluded};
use radiosity_form_factors::{PairwiseRows, Rows};
use rayon::prelude::*;

use super::State;
use crate::estimate::analytic;
use crate::strategy::partial_among;
use crate::{Geometry, Method};

/// E in units of the mean irradiance from which on an emitter counts, as of surfaces that shine.
const BRIGHTER: f64 = 2.0;
/// Least rms variation by an edge, in units of the mean irradiance.
const LEAST: f64 = 0.05;
/// Error of form factors without and with something between, which enter nothing but the estimate.
const TOLERANCE: (f64, f64) = (1e-4, 1e-3);
/// Segments of a partly hidden pair among many blockers.
const SEGMENTS: u32 = 4;

/// An emitter that counts.
struct Light {
    /// Its place among the emitters.
    place: u32,
    /// The patches it sends from.
    patches: Vec<usize>,
    /// E of every band.
    emission: Vec<f64>,
}

/// How irradiance differs between the children of elements in which a shadow ends.
pub(super) struct Edges {
    /// Whether one ends in each of the elements.
    pub(super) crossed: Vec<bool>,
    /// H_c − H_e of every child of those, 0 of others.
    steps: BandValues,
}

impl Edges {
    /// On `fine`, in which element k is a child of `of[k]`; `level` is the mean irradiance.
    pub(super) fn new(state: &State<'_>, fine: &Geometry<'_>, of: &[usize], level: f64) -> Result<Self, StoreError> {
        let geometry = &state.geometry;
        let lights = if geometry.blockers().is_empty() { Vec::new() } else { lights(geometry, level) };
        let (m, reflectance) = (geometry.elements().len(), geometry.reflectance());
        let crossed = (0..m).into_par_iter().map(|e| is_crossed(state, (&lights, &reflectance), e, level)).collect();
        let bands = reflectance.count();
        let mut edges = Self { crossed, steps: BandValues::zeros(bands, of.len()) };
        let children: Vec<u32> = (0..of.len() as u32).filter(|&k| edges.crossed[of[k as usize]]).collect();
        if children.is_empty() {
            return Ok(edges);
        }
        let sources = fine.elements().select(&children);
        let places: Vec<u32> = lights.iter().map(|light| light.place).collect();
        let targets = geometry.emitters().0.select(&places);
        let blockers = geometry.blockers();
        let partial = match partial_among(blockers.len(), TOLERANCE.1) {
            PartialVisibility::Rays { standard_error, .. } => {
                PartialVisibility::Rays { samples: SEGMENTS, standard_error }
            }
            exact => exact,
        };
        let rows = PairwiseRows::new(analytic(blockers, partial), &sources, &targets, TOLERANCE.0, state.seed);
        let direct = |j: usize| -> Result<Vec<f64>, StoreError> {
            let mut row = vec![0.0; lights.len()];
            rows.row(j, &mut row)?;
            let of_band = |band: usize| lights.iter().zip(&row).map(|(light, f)| light.emission[band] * f).sum::<f64>();
            Ok((0..bands).map(of_band).collect())
        };
        // A_c H_c by these lights.
        let direct: Result<Vec<Vec<f64>>, StoreError> = (0..children.len()).into_par_iter().map(direct).collect();
        let direct = direct?;
        for band in 0..bands {
            let mut sums = vec![(0.0, 0.0); geometry.elements().len()];
            for ((&k, direct), area) in children.iter().zip(&direct).zip(sources.areas()) {
                let sum = &mut sums[of[k as usize]];
                *sum = (sum.0 + direct[band], sum.1 + area);
            }
            let steps = edges.steps.band_mut(band);
            for ((&k, direct), area) in children.iter().zip(&direct).zip(sources.areas()) {
                let (sum, whole) = sums[of[k as usize]];
                steps[k as usize] = direct[band] / area - sum / whole;
            }
        }
        Ok(edges)
    }

    /// H_c − H_e of child k in a band.
    pub(super) fn step(&self, band: usize, k: usize) -> f64 {
        self.steps.band(band)[k]
    }
}

fn lights(geometry: &Geometry<'_>, level: f64) -> Vec<Light> {
    let (of_elements, emission) = (geometry.surfaces(), geometry.emission());
    let light = |(place, &surface): (u32, &u32)| {
        let on: Vec<usize> = (0..of_elements.len()).filter(|&e| of_elements[e] == surface).collect();
        let first = *on.first()?;
        let emission: Vec<f64> = (0..emission.count()).map(|b| emission.band(b)[first]).collect();
        let mut patches: Vec<usize> = on.iter().map(|&e| geometry.parent()[e] as usize).collect();
        patches.dedup();
        let mean = emission.iter().sum::<f64>() / emission.len() as f64;
        (mean > BRIGHTER * level).then_some(Light { place, patches, emission })
    };
    (0..).zip(geometry.emitters().1).filter_map(light).collect()
}

/// Whether some light is partly hidden from an element, and that is seen in what the element sends.
fn is_crossed(state: &State<'_>, (lights, reflectance): (&[Light], &BandValues), e: usize, level: f64) -> bool {
    let geometry = &state.geometry;
    let black = (0..reflectance.count()).all(|b| reflectance.band(b)[e] == 0.0);
    if lights.is_empty() || black {
        return false;
    }
    let (element, area) = (&geometry.elements().polygons(e)[0], geometry.elements().area(e));
    let noise = match state.method {
        // The totals of emitters have none.
        Method::RaysAndEmitters { .. } => 0.0,
        _ => state.store.bound(e),
    };
    let entries = state.store.entries(e);
    lights.iter().any(|light| {
        let pieces = geometry.emitters().0.polygons(light.place as usize);
        let open: f64 = pieces.iter().map(|piece| unoccluded(element, piece, TOLERANCE.0).value).sum();
        let seen: f64 = light.patches.iter().map(|&p| entries[p]).sum();
        let hidden = open - seen;
        let mean = light.emission.iter().sum::<f64>() / light.emission.len() as f64;
        let varies = mean * (seen * hidden).max(0.0).sqrt() / area;
        seen.min(hidden) > noise && varies > LEAST * level
    })
}
