//! Pairs too small to matter: how much of a row may go, and what the answer may be off by.
//!
//! [`Thinning`] drops pairs of which each row loses a share δ at most, none with an emitter, and what a closed scene's rows lost is given back
//! ([`ThinnedFormFactors`]). With ΔF what that changes, c = 2 (dropped and given back) or 1 (an open scene, whose row sums are not known), and B =
//! ρH where nothing emits,
//!
//! ```text
//! H̃ − H = (I − F̃ρ)⁻¹ ΔF ρH,      ‖ΔF‖ ≤ c δ,      ‖H̃ − H‖/‖H‖ ≤ c δ ρ_max / (1 − ρ_max),
//! ```
//!
//! since ΔF is symmetric in the areas and its rows change by c δ at most (I. Schur 1911). δ is what makes that the error asked for. When B̃ is
//! known, what is missing in element i is
//!
//! ```text
//! g_i = (1/A_i) Σ_{j dropped} U_ij |B̃_j − b_i| ≥ |Σ_j ΔF_ij B̃_j|,      b_i the mean that i exchanges with instead, 0 in an open scene,
//! h = g + F̃ρh,      |H̃ − H| ≤ h + s,      s = δ max(ρh) / (1 − ρ_max (σ + δ)),
//! ```
//!
//! one more solution; s makes up for F̃ in place of F there, and σ is the largest row sum of F̃. That bound is sharper by what reflectances and
//! radiosities differ. It holds for
//! the rows that the estimator would have given: what computed entries err by is not in it, nor what their rows' sums miss without any omission.
//! Tests see it above the difference from
//! the run without omissions, and the prior above both.
//!
//! What is *not* here: forms with patches and estimators of whole rows, where nothing is dropped.

use std::time::Instant;

use radiosity_core::{BandValues, Cost, Direction, Outcome, StopRule, System, solve_from};
use radiosity_form_factors::stores::{GivenBack, ThinnedFormFactors};
use radiosity_form_factors::{Rows, ThinnedRows, Thinning};

use crate::bounded::{Bounded, By, FORM_FACTORS, Missed, Norms, largest};
use crate::estimate::Filled;
use crate::plan::{Plan, Role};
use crate::run::{Known, allowed, fill_checked, named};
use crate::{Geometry, Method, RunError, Shape, Store, Strategy};

/// Largest share of a row that is dropped, however little it reflects.
const MOST: f64 = 0.5;
/// Unshot share to which the bound is solved for: it is no more certain than a few digits.
const BOUND_UNSHOT: f64 = 1e-6;

/// What was dropped in a store of some elements.
#[derive(Clone, Debug)]
pub(crate) struct Thinned {
    thinning: Thinning,
    /// What rows got back; `None` in an open scene.
    given: Option<GivenBack>,
    /// Their numbers in the system.
    elements: Vec<u32>,
    prior: f64,
}

impl Strategy {
    /// The error that dropped pairs may cause, if any are dropped.
    pub(crate) fn thins(&self) -> Option<f64> {
        let pairs = matches!(self.method, Method::Analytic { .. }) && self.shape == Shape::Full && !self.repair;
        let held = !matches!(self.store, Store::KeepAll | Store::KeepNone | Store::Hierarchical { .. });
        self.thin.filter(|_| pairs && held && !self.samples())
    }
}

/// δ for an error of the answer, and the error that it bounds; `None` where none does: a reflectance is no less than 1, which makes no system, or
/// the share vanishes.
fn share(geometry: &Geometry<'_>, error: f64) -> Option<(f64, f64)> {
    let rho = largest(&geometry.reflectance()).into_iter().fold(0.0, f64::max);
    if rho >= 1.0 {
        return None;
    }
    let twice = if geometry.closed() { 2.0 } else { 1.0 };
    let per_share = twice * rho / (1.0 - rho);
    let share = if per_share > 0.0 { (error / per_share).min(MOST) } else { MOST };
    (share > 0.0).then_some((share, share * per_share))
}

/// Which exposed elements emit: light that comes straight from them is left as it is.
fn emits(geometry: &Geometry<'_>) -> Vec<bool> {
    let e = geometry.emission();
    (0..e.len()).map(|k| (0..e.count()).any(|b| e.band(b)[k] > 0.0)).collect()
}

/// [`fill_checked`] without the pairs that `strategy` lets go.
pub(crate) fn fill_thinned<'r>(
    geometry: &Geometry<'_>,
    rows: Box<dyn Rows + 'r>,
    unblocked: Option<f64>,
    strategy: &Strategy,
) -> Result<(Filled<'r>, Known), RunError> {
    let Some((delta, prior)) = strategy.thins().and_then(|error| share(geometry, error)) else {
        return fill_checked(geometry, rows, unblocked, strategy);
    };
    let clock = Instant::now();
    let thinning = Thinning::new(geometry.elements(), &emits(geometry), delta);
    let looked = clock.elapsed();
    let kept = Box::new(ThinnedRows::new(rows, &thinning));
    let (Filled::Held(mut store), mut known) = fill_checked(geometry, kept, unblocked, strategy)? else {
        unreachable!("strategies that drop pairs hold their form factors");
    };
    let clock = Instant::now();
    let mut given = None;
    if geometry.closed() {
        let (whole, cost) = ThinnedFormFactors::new(store, &geometry.elements().areas(), thinning.spent())?;
        known.form_factors.cost += cost;
        given = Some(whole.given().clone());
        store = Box::new(whole);
    }
    known.form_factors.time += looked + clock.elapsed();
    let elements = (0..geometry.elements().len() as u32).collect();
    known.thinned.push(Thinned { thinning, given, elements, prior });
    Ok((Filled::Held(store), known))
}

impl Thinned {
    /// The same of elements that have other numbers in the system.
    pub(crate) fn renumbered(self, elements: Vec<u32>) -> Self {
        Self { elements, ..self }
    }

    /// g_i, put where the elements are.
    fn missing(&self, areas: &[f64], b: &BandValues, g: &mut BandValues) {
        let m = self.elements.len();
        let own = (0..b.count()).flat_map(|band| self.elements.iter().map(move |&e| b.band(band)[e as usize]));
        let own = BandValues::new(own.collect(), m);
        let around = match &self.given {
            Some(given) => BandValues::new((0..own.count()).flat_map(|band| given.means(own.band(band))).collect(), m),
            None => BandValues::zeros(own.count(), m),
        };
        let missed = self.thinning.missed(own.view(), around.view());
        for band in 0..own.count() {
            let to = g.band_mut(band);
            self.elements.iter().zip(missed.band(band)).for_each(|(&e, by)| to[e as usize] = by / areas[e as usize]);
        }
    }
}

fn omission(pairs: u64, prior: f64) -> Bounded {
    Bounded {
        reason: "a row loses no more than the error asked for allows, and gets its sum back if the scene is closed",
        what: format!("{pairs} pairs too small to matter"),
        counted: FORM_FACTORS,
        predicted: pairs,
        measured: None,
        prior,
        bound: None,
    }
}

/// What a run of `strategy` by `plan` on the mesh it made will drop, before anything is computed.
pub(crate) fn foreseen(plan: &Plan, geometry: &Geometry<'_>, strategy: &Strategy) -> Option<Bounded> {
    let error = strategy.thins().filter(|&error| allowed(error).is_ok())?;
    let of = |part: &Geometry<'_>| {
        let (delta, prior) = share(part, error)?;
        Some((Thinning::new(part.elements(), &emits(part), delta).pairs(), prior))
    };
    let all: Vec<(u64, f64)> = if plan.omits() {
        let surfaces = geometry.surfaces();
        let of_room = |room: u32| {
            let sends = |s: usize| plan.room[s] == room && plan.roles[s] == Role::Exchanges;
            let own: Vec<u32> = (0..surfaces.len() as u32).filter(|&e| sends(surfaces[e as usize] as usize)).collect();
            of(&geometry.part(&own, &plan.bands.solved, plan.keeps_rows()))
        };
        plan.lit_rooms().into_iter().filter_map(of_room).collect()
    } else {
        of(geometry).into_iter().collect()
    };
    if all.is_empty() {
        return None;
    }
    let (pairs, prior) = all.into_iter().fold((0, 0.0_f64), |(n, most), (pairs, prior)| (n + pairs, most.max(prior)));
    Some(omission(pairs, prior))
}

/// What all dropped pairs change of an answer with radiosity `b`, and what finding that took.
pub(crate) fn missed(
    system: &System<'_>,
    thinned: &[Thinned],
    b: &BandValues,
    strategy: &Strategy,
) -> Result<(Option<Missed>, Cost), RunError> {
    let (areas, rho) = (system.areas(), system.reflectance());
    let pairs: u64 = thinned.iter().map(|thinned| thinned.thinning.pairs()).sum();
    let most = |of: &dyn Fn(&Thinned) -> f64| thinned.iter().map(of).fold(0.0, f64::max);
    if thinned.is_empty() {
        return Ok((None, Cost::default()));
    }
    let omission = Bounded { measured: Some(pairs), ..omission(pairs, most(&|thinned| thinned.prior)) };
    let mut g = BandValues::zeros(system.bands(), areas.len());
    thinned.iter().for_each(|thinned| thinned.missing(areas, b, &mut g));
    let Norms { sigma, mut cost, .. } = Norms::new(system)?;
    let (delta, rho_max) =
        (most(&|thinned| thinned.thinning.share()), rho.values().iter().copied().fold(0.0, f64::max));
    let left = 1.0 - rho_max * (sigma + delta);
    if left <= 0.0 {
        return Ok((Some(Missed { omission, by: None }), cost));
    }
    // x = ρh solves x = ρg + ρF̃x, and h = g + F̃x.
    let mut light = g.clone();
    light.values_mut().iter_mut().zip(rho.values()).for_each(|(light, rho)| *light *= rho);
    let mut values = BandValues::zeros(system.bands(), areas.len());
    if light.values().iter().any(|light| *light > 0.0) {
        let again = System::full(system.store(), areas, light.view(), rho)?;
        let stop = StopRule::unshot(BOUND_UNSHOT).steps(strategy.steps).unverified();
        let found = solve_from(&again, &mut *named(&strategy.solver, strategy.seed)?, &stop, &mut (), None)?;
        cost += found.cost;
        if found.outcome != Outcome::Converged {
            return Ok((Some(Missed { omission, by: None }), cost));
        }
        cost += again.irradiance(Direction::Gather, found.radiosity.view(), values.view_mut())?;
    }
    for band in 0..values.count() {
        let (h, g, rho) = (values.band_mut(band), g.band(band), rho.band(band));
        h.iter_mut().zip(g).for_each(|(h, g)| *h += g);
        let s = delta * h.iter().zip(rho).map(|(h, rho)| rho * h).fold(0.0, f64::max) / left;
        h.iter_mut().for_each(|h| *h += s);
    }
    Ok((Some(Missed { omission, by: Some(By::pointwise(values)) }), cost))
}
