//! The error of a solution, from the solution.
//!
//! Relative to the mean level ⟨H⟩ over the area A of the scene, covered parts included as zeros:
//!
//! ```text
//! elements²      Σ_e A_e ε_e² w_e / A           a constant where H varies (see `variation`); w = 1 at points, and over cells the
//!                                                share (1 − A_c/A_e)₊ that an element larger than a cell of area A_c shows
//! senders²       a² ⟨δ²⟩,  δ = H_fine − H_same   patches where radiosity varies
//! form factors²  ⟨(H_same − H)² w'⟩              noise of rows, w' = min(A_e/A_c, 1) since those of the elements of a cell are independent
//! solver         Σ A|B* − B| / Σ A E · Σ A E / (A ⟨H⟩)
//! ```
//!
//! ⟨·⟩ is the mean over probes, elements spread evenly over the area: rows of rays with exact emitters to elements one level
//! finer than the mesh, on which B follows the recovered slopes, or direct light where a shadow ends (see `edges`). H_fine gathers from those, H_same by the same rays from the patches they lie on, so that the rays'
//! own noise cancels in δ. An error of H is reflected: a = Σ A B / Σ A E, as all light is. Where only some surfaces are asked for, of area A_W, sums
//! over elements and ⟨H⟩ are theirs alone,
//! and what errs elsewhere counts by its importance Y to them ([`crate::Importance`]); half of the probes are theirs, half spread evenly over A (Y − W):
//!
//! ```text
//! senders        ⟨δ²⟩_W^½ + ( (a − 1) Σ A (Y − W) / A_W ⟨δ²⟩_(Y−W) )^½      = a ⟨δ²⟩^½ if all are asked for
//! ```
//!
//! In a view a ⟨s²⟩ (`asked.rs`) takes the place of A, and ⟨s H⟩ that of ⟨H⟩. The total adds
//! the parts as squares. What is *not* here: the error of pairs, which is below the tolerance they were asked for, and shadows that no element has seen.

use radiosity_core::{BandValues, Form, Solution, StoreError};
use radiosity_form_factors::Receivers;
use radiosity_geometry::Facets;
use rayon::prelude::*;

use super::edges::differences;
use super::variation::Variation;
use super::{Adaptive, Goal, NEAR, State};
use crate::estimate::with_emitters;
use crate::{Method, RunError};

/// Probes, and rays of each: few tell what senders cost, in which their noise cancels, more what that of other rows is.
const PROBES: usize = 128;
const RAYS: [u32; 2] = [512, 2048];

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

/// Area of a report cell on the surface of every exposed element.
fn cell_areas(state: &State<'_>, k: u32) -> Vec<f64> {
    let geometry = &state.geometry;
    let of_surface = |s: usize| {
        geometry.scene().surfaces[s].area() / (geometry.mesh().pieces(s).len() as f64 * f64::from(k).powi(2))
    };
    geometry.surfaces().into_iter().map(|s| of_surface(s as usize)).collect()
}

/// Estimates the error of a solution.
pub(super) fn measure(
    state: &State<'_>,
    solved: &Solution,
    (variation, worth): (&Variation, Option<&[f64]>),
    adaptive: &Adaptive,
    seed: u64,
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
    let averaged = |e: usize| cells.as_ref().map_or(1.0, |cells| (areas[e] / cells[e]).min(1.0));
    let inside: f64 = variation.squares.iter().enumerate().map(|(e, square)| asked[e] * square * shown(e)).sum();

    let emitted: f64 = power(&areas, &state.geometry.emission());
    let reflected = power(&areas, &solved.radiosity) / emitted;
    let noisy = !matches!(state.method, Method::Analytic { .. });
    let elements = (inside / total).sqrt() / level;
    let rays = RAYS[usize::from(noisy && elements <= NEAR * adaptive.tolerance)];
    // What is asked for, in the units of its importance, and what it sees by that.
    let asked: Vec<f64> = state.asked.weights(&areas).iter().zip(&areas).map(|(w, area)| w * area).collect();
    let indirect: Option<Vec<f64>> = worth.map(|worth| {
        let beyond = areas.iter().zip(&asked).zip(worth).map(|((area, asked), worth)| area * worth - asked);
        beyond.map(|area| area.max(0.0)).collect()
    });
    let share = |weights: &[f64]| weights.iter().sum::<f64>() / asked.iter().sum::<f64>();
    let (probes, far) = match &indirect {
        None => (spread_over(&areas, PROBES), Vec::new()),
        Some(weights) => (spread_over(&asked, PROBES / 2), spread_over(weights, PROBES / 2)),
    };
    let [near, far] = probe(state, solved, (variation, [&probes, &far]), (rays, seed), (&averaged, level))?;
    let senders = match &indirect {
        None => reflected * near.senders.sqrt(),
        Some(weights) => near.senders.sqrt() + ((reflected - 1.0).max(0.0) * share(weights) * far.senders).sqrt(),
    };
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

/// Mean squares over some probes and the bands.
#[derive(Default)]
struct Probed {
    senders: f64,
    rows: f64,
}

fn probe(
    state: &State<'_>,
    solved: &Solution,
    (variation, groups): (&Variation, [&Vec<usize>; 2]),
    (rays, seed): (u32, u64),
    (averaged, level): (&(dyn Fn(usize) -> f64 + Sync), f64),
) -> Result<[Probed; 2], RunError> {
    let (geometry, b) = (&state.geometry, &solved.radiosity);
    let probes = groups.map(|group| &group[..]).concat();
    let mut sources = Facets::new();
    probes.iter().for_each(|&e| sources.push(geometry.elements().polygons(e).to_vec(), false));

    // One level finer, with B linear inside the elements, less the means that their patches send.
    let mesh = geometry.mesh();
    let refined = mesh.refined(&vec![true; mesh.elements.len()]);
    let fine = geometry.on(refined.mesh);
    let mut place = vec![0; mesh.elements.len()];
    geometry.exposed().iter().enumerate().for_each(|(k, &e)| place[e as usize] = k);
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
    let squares = |k: usize| -> Result<[f64; 2], StoreError> {
        let (e, mut row) = (probes[k], vec![0.0; m]);
        rows.row(k, &mut row)?;
        let area = sources.area(k);
        let mut sums = [0.0; 2];
        for band in 0..b.count() {
            let of_band = &values[band * m..][..m];
            let [fine, same] =
                [0, 1].map(|which| row.iter().zip(of_band).map(|(f, v)| f * v[which]).sum::<f64>() / area);
            sums[0] += (fine - same).powi(2);
            sums[1] += (same - solved.irradiance.band(band)[e]).powi(2) * averaged(e);
        }
        Ok(sums)
    };
    let done: Result<Vec<[f64; 2]>, StoreError> = (0..probes.len()).into_par_iter().map(squares).collect();
    let done = done?;
    let (near, far) = done.split_at(groups[0].len());
    let of_group = |of: &[[f64; 2]]| {
        let mean = |which: usize| of.iter().map(|s| s[which]).sum::<f64>() / (of.len() * b.count()) as f64;
        if of.is_empty() { Probed::default() } else { Probed { senders: mean(0), rows: mean(1) } }
    };
    Ok([of_group(near), of_group(far)])
}

/// At most `count` elements at equal steps of the area, each once.
fn spread_over(areas: &[f64], count: usize) -> Vec<usize> {
    let total: f64 = areas.iter().sum();
    let (mut found, mut before) = (Vec::with_capacity(count), 0.0);
    for (e, area) in areas.iter().enumerate() {
        let at = |area: f64| (area / total * count as f64 - 0.5).ceil();
        if at(before + area) > at(before) {
            found.push(e);
        }
        before += area;
    }
    found
}

/// Area means of B over the patches.
pub(super) fn patch_means(state: &State<'_>, b: &BandValues) -> BandValues {
    let geometry = &state.geometry;
    let (areas, patches) = (geometry.elements().areas(), geometry.patches().areas());
    let mut means = BandValues::zeros(b.count(), patches.len());
    for band in 0..b.count() {
        let to = means.band_mut(band);
        let own = geometry.parent().iter().zip(&areas).zip(b.band(band));
        own.for_each(|((&p, area), b)| to[p as usize] += area * b / patches[p as usize]);
    }
    means
}
