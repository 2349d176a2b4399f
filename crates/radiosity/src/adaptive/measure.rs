//! The error of a solution, from the solution.
//!
//! Relative to the mean level ⟨H⟩ over the area A of the scene, covered parts included as zeros:
//!
//! ```text
//! elements²      Σ_e A_e ε_e² w_e / A           a constant where H varies (see `variation`); w = 1 at points, and over cells the
//!                                                share (1 − A_c/A_e)₊ that an element larger than a cell of area A_c shows
//! senders²       a ⟨δ²⟩ / c²                    patches where radiosity varies: δ what they change, c = ¾
//! form factors²  ⟨(H_same − H)²⟩                 noise of rows
//! solver         Σ A|B* − B| / Σ A E · Σ A E / (A ⟨H⟩)
//! ```
//!
//! ⟨·⟩ is the mean over probes: receivers (`receivers`: report cells, or elements where these are no smaller), half of them spread evenly over the area and half by what is expected
//! of δ² there (`sender_errors`), with weights that undo it. From their elements go rows of rays with exact emitters to elements one level
//! finer than the mesh, on which B follows the recovered slopes, or direct light where a shadow ends (`edges`). H_fine gathers from those, H_same by the same rays from the patches they lie on, so that the rays'
//! own noise cancels in δ = H_fine − H_same. Dark gaps (`gaps`) are taken instead where they change more: both see what varies smoothly.
//!
//! Children have three quarters of the first moment of a slope, which is what far receivers see of it, and of the squares, which near ones see; hence c. An error of H is reflected, but what errs here one way and there the other cancels on
//! its way: with the importance Y of what errs to what is asked for (W = 1 there and 0 elsewhere, [`crate::Importance`]) squares add up to
//!
//! ```text
//! Σ A Y δ² / Σ A W  =  ⟨δ²⟩_W + Σ A (Y − W) / A_W ⟨δ²⟩_(Y−W)       = a ⟨δ²⟩,  a = Σ A B / Σ A E,  if all are asked for
//! ```
//!
//! by Jensen's inequality a bound of them less one more factor of at most a, which would hold if all errors had one sign. Where only some surfaces are asked for, sums over elements and ⟨H⟩ are theirs
//! alone; half of the probes are theirs, half spread evenly over A (Y − W).
//!
//! In a view a ⟨s²⟩ (`asked.rs`) takes the place of A, and ⟨s H⟩ that of ⟨H⟩. The total adds
//! the parts as squares. What is *not* here: the error of pairs, which is below the tolerance they were asked for, and edges of shadows in reflected light that are no gaps.

use radiosity_core::{BandValues, Form, Solution, StoreError};
use radiosity_form_factors::Receivers;
use radiosity_geometry::Facets;
use rayon::prelude::*;

use super::edges::differences;
use super::gaps::Gaps;
use super::receivers::{Receiver, cell_areas, spread_over};
use super::sender_errors::{SenderErrors, patch_means};
use super::variation::Variation;
use super::{Adaptive, Goal, NEAR, State};
use crate::estimate::with_emitters;
use crate::{Method, RunError};

/// Probes, and rays of each: few tell what senders cost, in which their noise cancels, more what that of other rows is.
const PROBES: usize = 128;
const RAYS: [u32; 2] = [512, 1024];

/// Share of the first moment of a slope that four children have, which is what others see of it.
const SEEN: f64 = 0.75;

/// Parts of the estimated rms error of irradiance, relative to its mean level.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorEstimate {
    /// Constants on elements in place of what varies there.
    pub elements: f64,
    /// Constants on patches in place of what varies there.
    pub senders: f64,
    /// Noise of the rows; `None` for pairs, each of which has a bound of its own.
    pub form_factors: Option<f64>,
    /// What is left unshot, as far as it is bounded.
    pub solver: Option<f64>,
}

impl ErrorEstimate {
    /// √(elements² + senders² + form factors² + solver²).
    pub fn total(&self) -> f64 {
        let square = |part: Option<f64>| part.unwrap_or(0.0).powi(2);
        (self.elements.powi(2) + self.senders.powi(2) + square(self.form_factors) + square(self.solver)).sqrt()
    }
}

/// ⟨H⟩ over what is asked for and the bands, and how much that is: an area, or 1 of a picture.
pub(super) fn level(state: &State<'_>, h: &BandValues) -> (f64, f64) {
    (state.asked.level(h), state.asked.total)
}

/// Estimates the error of a solution.
pub(super) fn measure(
    state: &State<'_>,
    solved: &Solution,
    (variation, worth): (&Variation, Option<&[f64]>),
    (receivers, seen): (&[Receiver], &SenderErrors),
    (adaptive, seed): (&Adaptive, u64),
) -> Result<ErrorEstimate, RunError> {
    let (areas, asked) = (state.geometry.elements().areas(), state.asked.squares());
    let (level, total) = level(state, &solved.irradiance);
    if level == 0.0 {
        return Ok(ErrorEstimate { solver: Some(0.0), ..ErrorEstimate::default() });
    }
    let cells = match adaptive.goal {
        Goal::Cells(k) => Some(cell_areas(state, k)),
        Goal::Points => None,
    };
    let shown = |e: usize| cells.as_ref().map_or(1.0, |cells| (1.0 - cells[e] * (1.0 + 1e-9) / areas[e]).max(0.0));
    let inside: f64 = variation.squares.iter().enumerate().map(|(e, square)| asked[e] * square * shown(e)).sum();

    let emitted: f64 = power(&areas, &state.geometry.emission());
    let reflected = power(&areas, &solved.radiosity) / emitted;
    let noisy = !matches!(state.method, Method::Analytic { .. });
    let elements = (inside / total).sqrt() / level;
    let rays = RAYS[usize::from(noisy && elements <= NEAR * adaptive.tolerance)];
    // What is asked for, in the units of its importance, and what it sees by that.
    let weights = state.asked.weights(&areas);
    let asked: Vec<f64> = weights.iter().zip(&areas).map(|(w, area)| w * area).collect();
    let indirect: Option<Vec<f64>> = worth.map(|worth| {
        let beyond = areas.iter().zip(&asked).zip(worth).map(|((area, asked), worth)| area * worth - asked);
        beyond.map(|area| area.max(0.0)).collect()
    });
    let of_receivers: Vec<f64> = receivers.iter().map(|r| r.area * weights[r.parts[0].0]).collect();
    let near = |count: usize| -> Vec<(Receiver, f64)> {
        let density = densities(&of_receivers, &seen.of_receivers);
        let drawn: Vec<f64> = of_receivers.iter().zip(&density).map(|(area, density)| area * density).collect();
        let weighed = |(r, steps): (usize, f64)| (receivers[r].sketch(), steps / density[r]);
        spread_over(&drawn, count).into_iter().map(weighed).collect()
    };
    let (probes, far) = match &indirect {
        None => (near(PROBES), Vec::new()),
        Some(weights) => {
            let far = spread_over(weights, PROBES / 2).into_iter();
            (near(PROBES / 2), far.map(|(e, steps)| (Receiver::element(e, areas[e]), steps)).collect())
        }
    };
    let [near, far] = probe(state, solved, (variation, [&probes, &far]), (rays, seed), level)?;
    let beyond = match &indirect {
        None => (reflected - 1.0).max(0.0) * near.senders,
        Some(weights) => weights.iter().sum::<f64>() / asked.iter().sum::<f64>() * far.senders,
    };
    let senders = SEEN.recip() * (near.senders + beyond).sqrt();
    let shade = state.asked.shade();
    // In a picture as if it were the same everywhere.
    let spread_over = if state.asked.is_view() { areas.iter().sum::<f64>() / shade } else { total };
    Ok(ErrorEstimate {
        elements,
        senders: shade * senders / level,
        form_factors: noisy.then(|| shade * near.rows.sqrt() / level),
        solver: solved.bound().map(|bound| bound * emitted / (spread_over * level * solved.radiosity.count() as f64)),
    })
}

/// Σ A x over all bands.
fn power(areas: &[f64], x: &BandValues) -> f64 {
    (0..x.count()).flat_map(|b| areas.iter().zip(x.band(b)).map(|(a, x)| a * x)).sum()
}

/// How many more probes there are an area where more is erred by: half of them by area, half by what is expected of squares there. The area mean is 1.
fn densities(areas: &[f64], squares: &[f64]) -> Vec<f64> {
    let weighed: f64 = areas.iter().zip(squares).map(|(area, square)| area * square).sum();
    let mean = weighed / areas.iter().sum::<f64>();
    squares.iter().map(|square| if mean > 0.0 { 0.5 + 0.5 * square / mean } else { 1.0 }).collect()
}

/// Mean squares over some probes and the bands.
#[derive(Default)]
struct Probed {
    senders: f64,
    rows: f64,
}

fn probe(
    state: &State<'_>,
    solved: &Solution,
    (variation, groups): (&Variation, [&Vec<(Receiver, f64)>; 2]),
    (rays, seed): (u32, u64),
    level: f64,
) -> Result<[Probed; 2], RunError> {
    let (geometry, b) = (&state.geometry, &solved.radiosity);
    let mut probes: Vec<usize> =
        groups.iter().flat_map(|group| group.iter().flat_map(|(r, _)| r.parts.iter().map(|part| part.0))).collect();
    probes.sort_unstable();
    probes.dedup();
    let mut sources = Facets::new();
    probes.iter().for_each(|&e| sources.push(geometry.elements().polygons(e).to_vec(), false));

    // One level finer, with B linear inside the elements, less the means that their patches send.
    let mesh = geometry.mesh();
    let refined = mesh.refined(&vec![true; mesh.elements.len()]);
    let fine = geometry.on(refined.mesh);
    let place = geometry.places();
    let of: Vec<usize> = fine.exposed().iter().map(|&e| place[refined.origins[e as usize].index()]).collect();
    let (rho, means) = (geometry.reflectance(), patch_means(state, b));
    let apart = differences(state, variation, (&fine, &of), level)?;
    let at = |band: usize, k: usize| (b.band(band)[of[k]] + rho.band(band)[of[k]] * apart.band(band)[k]).max(0.0);
    let m = of.len();
    let values: Vec<[f64; 2]> = (0..b.count())
        .flat_map(|band| (0..m).map(move |k| (band, k)))
        .map(|(band, k)| [at(band, k), means.band(band)[geometry.parent()[of[k]] as usize]])
        .collect();

    let receivers = Receivers::facets(fine.elements());
    let method = Method::RaysAndEmitters { rays };
    let targets = (&sources, fine.elements());
    // Rays of their own: not those of the rows that are tested.
    let rows = with_emitters(&fine, method, Form::Full, targets, receivers, || fine.element_occluders(), !seed)?;
    let gaps = (!geometry.blockers().is_empty()).then(|| Gaps::new(state, solved));
    // δ and H_same − H of each band.
    let errors = |k: usize| -> Result<Vec<[f64; 2]>, StoreError> {
        let (e, mut row) = (probes[k], vec![0.0; m]);
        rows.row(k, &mut row)?;
        let area = sources.area(k);
        let dark = gaps.as_ref().map(|gaps| gaps.of_element(e));
        let of_band = |band: usize| {
            let of_band = &values[band * m..][..m];
            let [fine, same] =
                [0, 1].map(|which| row.iter().zip(of_band).map(|(f, v)| f * v[which]).sum::<f64>() / area);
            let gap = dark.as_ref().map_or(0.0, |dark| dark[band]);
            // Both see what varies smoothly.
            let sent = if gap.abs() > (fine - same).abs() { gap } else { fine - same };
            [sent, same - solved.irradiance.band(band)[e]]
        };
        Ok((0..b.count()).map(of_band).collect())
    };
    let done: Result<Vec<Vec<[f64; 2]>>, StoreError> = (0..probes.len()).into_par_iter().map(errors).collect();
    let done = done?;
    let square = |receiver: &Receiver, band: usize, which: usize| {
        let of_part = |&(e, weight): &(usize, f64)| {
            let k = probes.binary_search(&e).expect("parts of receivers are probed");
            weight * done[k][band][which]
        };
        receiver.parts.iter().map(of_part).sum::<f64>().powi(2)
    };
    Ok(groups.map(|group| {
        let total: f64 = group.iter().map(|(_, weight)| weight).sum();
        let mean = |which: usize| {
            let of = |(receiver, weight): &(Receiver, f64)| {
                weight * (0..b.count()).map(|band| square(receiver, band, which)).sum::<f64>()
            };
            group.iter().map(of).sum::<f64>() / (total * b.count() as f64)
        };
        if group.is_empty() { Probed::default() } else { Probed { senders: mean(0), rows: mean(1) } }
    }))
}
