//! Pairs too small to matter: which of them may go, and what the answer is off by.
//!
//! [`Thinning`] drops pairs that carry little, none with an emitter, and what a closed scene's rows lost is given back ([`ThinnedFormFactors`]). With D what was
//! dropped, G what was given back (half of what may have been lost in an open scene), F = F̃ + D − G, and B̃ the radiosity found,
//!
//! ```text
//! H − H̃ = (I − Fρ)⁻¹ (D − G) B̃
//! ```
//!
//! **Before.** Which pairs go is decided by an estimate. A pilot solves the same elements by few rays a row; pairs are dropped by what they carry of its radiosity B⁰
//! beyond the mean b that replaces it, w_j = |B⁰_j − b| (B⁰_j in an open scene, whose rows' sums are not known), rows with equal budgets, or less of it the more important they are to what is asked for
//! (β ∝ Y^(−1/2), [`Importance`]). The budget is what makes the bound below, of the pilot, the error asked for.
//!
//! **After.** [`Thinning::carried`] bounds (D − G) x in every element for any x ≥ 0, as r⁻(x) ≤ (D − G) x ≤ r⁺(x). So
//!
//! ```text
//! g = max(r⁺(B̃), −r⁻(B̃)),      |H − H̃| ≤ (I − Fρ)⁻¹ g,
//! (I − Fρ)⁻¹ g = h + (I − Fρ)⁻¹ (D − G) ρh ≤ h + (I − Fρ)⁻¹ r⁺(ρh)₊,      h = g + F̃ρh,
//! ```
//!
//! one more solution, and another one of r⁺(ρh)₊ in place of g where that is not small; what is left then is at most its largest value q times 1 + f_e ρ_max/(1 −
//! ρ_max max f), with f the sums of rows of F, 1 in a closed scene. If the bound is more than was asked for, all is done again with less dropped, and in the end with nothing.
//! What pilot and bound take counts as verification. The bound holds for
//! the rows that the estimator would have given: what computed entries err by is not in it, nor what their rows' sums miss without any omission.
//! Tests see it above the difference from
//! the run without omissions, and below what was asked for.
//!
//! What is *not* here: forms with patches, estimators of whole rows, and rows that are not held, where nothing is dropped ([`Strategy::check_thinning`]); and links, which
//! are few as they are.

use std::time::Instant;

use radiosity_core::{BandValues, Cost, Direction, Form, Outcome, StopRule, System, solve_from};
use radiosity_form_factors::stores::{GivenBack, SparseFormFactors, ThinnedFormFactors};
use radiosity_form_factors::{Rows, ThinnedRows, Thinning};

use crate::asked::Asked;
use crate::bounded::{Bounded, By, FORM_FACTORS, Missed, Norms, largest, relative};
use crate::estimate::Filled;
use crate::importance::largest_of;
use crate::plan::{Plan, Role};
use crate::run::{Known, allowed, fill_checked, named};
use crate::{Geometry, Importance, Method, Run, RunError, Shape, Store, Strategy};

/// Unshot share to which the bound is solved for: it is no more certain than a few digits.
const BOUND_UNSHOT: f64 = 1e-6;
/// What is left over beside the bound so far, at most, without another solution; and how many there are at most.
const LEFT_OVER: f64 = 0.1;
const SOLUTIONS: usize = 3;
/// Rays a row of the pilot, the unshot share to which it is solved, and its solver.
pub(crate) const PILOT_RAYS: u32 = 64;
const PILOT_UNSHOT: f64 = 1e-3;
const PILOT_SOLVER: &str = "gauss-seidel";
/// Part of the error asked for that the estimate aims at, and that it aims at of the first bound where that was too large.
const AIM: f64 = 0.8;
const AGAIN: f64 = 0.7;
/// First budget of a row, in units of the error asked for.
const FIRST: f64 = 2.0;
/// Estimates made, and by how much the budget changes at most from one to the next.
const ESTIMATES: usize = 4;
const CHANGE: f64 = 16.0;
/// How the estimate follows the budget, at first and at least and most.
const ORDER: (f64, [f64; 2]) = (1.0, [0.5, 2.0]);
/// The estimate is good enough from this part of the aim on.
const NEAR: f64 = 0.8;
/// What is given back of what may have been lost in an open scene.
const HALF: f64 = 0.5;
/// Least importance that budgets know, of the largest.
const LEAST: f64 = 1e-4;
/// Runs that drop pairs, before one that drops none.
const RUNS: usize = 2;

/// What was dropped in a store of some elements.
#[derive(Clone, Debug)]
pub(crate) struct Thinned {
    thinning: Thinning,
    /// d_i: what rows lost, or the most of it in an open scene.
    lost: Vec<f64>,
    /// What rows got back.
    given: GivenBack,
    /// Whether what rows lost is known exactly.
    closed: bool,
    /// Their numbers in the system.
    elements: Vec<u32>,
    /// What finding what to drop took.
    pilot: Cost,
}

impl Strategy {
    /// The error that dropped pairs may cause, if any are dropped.
    pub(crate) fn thins(&self) -> Option<f64> {
        self.thin.filter(|_| self.check_thinning().is_ok())
    }

    /// Whether pairs can be dropped ([`Self::thin`]); a strategy with which they cannot runs without.
    ///
    /// # Errors
    ///
    /// [`RunError::Thin`] with what stands in the way.
    pub fn check_thinning(&self) -> Result<(), RunError> {
        let held = !matches!(self.store, Store::KeepAll | Store::KeepNone | Store::Hierarchical { .. });
        let (what, instead) = match self.method {
            _ if self.shape != Shape::Full => ("between elements and patches", "leave out the patches"),
            Method::Analytic { .. } if self.repair => ("repaired", "leave out the repair"),
            Method::Analytic { .. } if !held => {
                ("not held pair by pair", "choose the store dense, sparse or a packed one")
            }
            Method::Analytic { .. } if self.samples() => {
                ("drawn from", "choose another solver than the stochastic one")
            }
            Method::Analytic { .. } => return Ok(()),
            _ => ("whole rows", "choose the analytic method"),
        };
        Err(RunError::Thin { what, instead })
    }
}

/// Which exposed elements emit: light that comes straight from them is left as it is.
fn emits(geometry: &Geometry<'_>) -> Vec<bool> {
    let e = geometry.emission();
    (0..e.len()).map(|k| (0..e.count()).any(|b| e.band(b)[k] > 0.0)).collect()
}

/// A coarse solution on the elements of a geometry.
struct Pilot {
    store: SparseFormFactors,
    b: BandValues,
    h: BandValues,
    /// What budgets are divided by.
    worth: Vec<f64>,
    asked: Asked,
    norms: Norms,
    cost: Cost,
}

impl Pilot {
    fn new(geometry: &Geometry<'_>, strategy: &Strategy) -> Result<Self, RunError> {
        let rays = Method::RaysAndEmitters { rays: PILOT_RAYS };
        let (store, mut cost) = SparseFormFactors::assemble(&*crate::rows(geometry, rays, Form::Full, strategy.seed)?)?;
        let (areas, e, rho) = (geometry.elements().areas(), geometry.emission(), geometry.reflectance());
        let system = System::full(&store, &areas, e.view(), rho.view())?;
        let stop = StopRule::unshot(PILOT_UNSHOT).unverified();
        let solution = solve_from(&system, &mut *named(PILOT_SOLVER, 1)?, &stop, &mut (), None)?;
        cost += solution.cost;
        let asked = Asked::new(geometry, strategy.named());
        let mut worth = vec![1.0; areas.len()];
        if strategy.asks() {
            let (found, solved) = Importance::new(&system, &asked.weights(&areas), PILOT_SOLVER, &stop)?;
            cost += solved.cost;
            worth = largest_of(&found.of_irradiance);
            let least = LEAST * worth.iter().copied().fold(0.0, f64::max);
            worth.iter_mut().for_each(|worth| *worth = worth.max(least).sqrt());
        }
        let norms = Norms::new(&system)?;
        cost += norms.cost;
        Ok(Self { b: solution.radiosity, h: solution.irradiance, store, worth, asked, norms, cost })
    }

    /// w_j.
    fn sent(&self, areas: &[f64], emits: &[bool], closed: bool) -> Vec<f64> {
        let mut squares = vec![0.0; areas.len()];
        for b in 0..self.b.count() {
            let own = || areas.iter().zip(self.b.band(b)).zip(emits).filter(|(_, emits)| !**emits);
            let area: f64 = own().map(|((area, _), _)| area).sum();
            let mean =
                if closed && area > 0.0 { own().map(|((area, b), _)| area * b).sum::<f64>() / area } else { 0.0 };
            squares.iter_mut().zip(self.b.band(b)).for_each(|(square, b)| *square += (b - mean).powi(2));
        }
        squares.into_iter().map(f64::sqrt).collect()
    }

    /// The bound as it would be if the pilot were the answer.
    fn estimate(&self, system: &System<'_>, thinning: Thinning, closed: bool) -> Result<(f64, Cost), RunError> {
        let mut lost = thinning.of_dropped(&self.store)?;
        for (e, (lost, spent)) in lost.iter_mut().zip(thinning.spent()).enumerate() {
            // What else a row of an open scene misses may have been lost as well.
            let missing = if closed { 0.0 } else { (1.0 - self.norms.sums[e]) * system.areas()[e] };
            *lost = (*lost + missing).clamp(0.0, *spent);
        }
        let share = if closed { 1.0 } else { HALF };
        let given = GivenBack::to_all(lost.iter().map(|lost| share * lost).collect());
        let elements = (0..lost.len() as u32).collect();
        let thinned = Thinned { thinning, lost, given, closed, elements, pilot: Cost::default() };
        let stop = StopRule::unshot(PILOT_UNSHOT).unverified();
        let (by, cost) = bound(system, &[thinned], &self.b, (PILOT_SOLVER, &stop))?;
        Ok((by.map_or(f64::INFINITY, |by| relative(&by, &self.h, system.areas(), &self.asked)), cost))
    }
}

/// What to drop for an error of the answer, and what finding that took.
fn thinning(geometry: &Geometry<'_>, strategy: &Strategy, error: f64) -> Result<(Thinning, Cost), RunError> {
    let pilot = Pilot::new(geometry, strategy)?;
    let (areas, e, rho) = (geometry.elements().areas(), geometry.emission(), geometry.reflectance());
    let system = System::full(&pilot.store, &areas, e.view(), rho.view())?;
    let (emits, closed) = (emits(geometry), geometry.closed());
    let sent = pilot.sent(&areas, &emits, closed);
    let level = pilot.asked.level(&pilot.h);
    let of = |budget: f64| {
        let budgets: Vec<f64> = pilot.worth.iter().map(|worth| budget / worth).collect();
        Thinning::weighted(geometry.elements(), &emits, sent.clone(), &budgets)
    };
    let (aim, mut cost) = (AIM * error, pilot.cost);
    let (mut budget, mut order) = (FIRST * error * level, ORDER.0);
    let mut best: Option<(f64, Thinning)> = None;
    let mut before: Option<(f64, f64)> = None;
    for _ in 0..ESTIMATES {
        let thinning = of(budget);
        let (estimate, spent) = pilot.estimate(&system, thinning.clone(), closed)?;
        cost += spent;
        if estimate <= aim && best.as_ref().is_none_or(|(best, _)| *best < budget) {
            best = Some((budget, thinning));
        }
        if estimate == 0.0 || (NEAR * aim..=aim).contains(&estimate) {
            break;
        }
        if let Some((budget_before, estimate_before)) = before.replace((budget, estimate)) {
            let [least, most] = ORDER.1;
            let found = (estimate / estimate_before).ln() / (budget / budget_before).ln();
            order = if found.is_nan() { order } else { found.clamp(least, most) };
        }
        budget *= (0.5 * (1.0 + NEAR) * aim / estimate).powf(1.0 / order).clamp(1.0 / CHANGE, CHANGE);
    }
    Ok((best.map_or_else(|| of(0.0), |(_, thinning)| thinning), cost))
}

/// [`fill_checked`] without the pairs that `strategy` lets go.
pub(crate) fn fill_thinned<'r>(
    geometry: &Geometry<'_>,
    rows: Box<dyn Rows + 'r>,
    unblocked: Option<f64>,
    strategy: &Strategy,
) -> Result<(Filled<'r>, Known), RunError> {
    let Some(error) = strategy.thins() else {
        return fill_checked(geometry, rows, unblocked, strategy);
    };
    let clock = Instant::now();
    let (thinning, pilot) = thinning(geometry, strategy, error)?;
    let looked = clock.elapsed();
    let kept = Box::new(ThinnedRows::new(rows, &thinning));
    let (Filled::Held(mut store), mut known) = fill_checked(geometry, kept, unblocked, strategy)? else {
        unreachable!("strategies that drop pairs hold their form factors");
    };
    let clock = Instant::now();
    let closed = geometry.closed();
    let share = if closed { 1.0 } else { HALF };
    let (whole, cost) = ThinnedFormFactors::new(store, &geometry.elements().areas(), thinning.spent(), share)?;
    known.form_factors.cost += cost;
    let given = whole.given().clone();
    let lost = given.areas().iter().map(|given| given / share).collect();
    store = Box::new(whole);
    known.form_factors.time += looked + clock.elapsed();
    let elements = (0..geometry.elements().len() as u32).collect();
    known.thinned.push(Thinned { thinning, lost, given, closed, elements, pilot });
    Ok((Filled::Held(store), known))
}

impl Thinned {
    /// The same of elements that have other numbers in the system.
    pub(crate) fn renumbered(self, elements: Vec<u32>) -> Self {
        Self { elements, ..self }
    }

    /// r⁻(x) and r⁺(x), put where the elements are.
    fn off(&self, areas: &[f64], x: &BandValues, [low, high]: &mut [BandValues; 2]) {
        let m = self.elements.len();
        let own = (0..x.count()).flat_map(|band| self.elements.iter().map(move |&e| x.band(band)[e as usize]));
        let own = BandValues::new(own.collect(), m);
        let carried = self.thinning.carried(own.view(), &self.lost, self.closed);
        for band in 0..own.count() {
            let around = self.given.means(own.band(band));
            for (k, &e) in self.elements.iter().enumerate() {
                let e = e as usize;
                let given = self.given.areas()[k] * around[k];
                low.band_mut(band)[e] = (carried[0].band(band)[k] - given) / areas[e];
                high.band_mut(band)[e] = (carried[1].band(band)[k] - given) / areas[e];
            }
        }
    }
}

fn omission(pairs: u64, error: f64) -> Bounded {
    Bounded {
        reason: "what they carry is within the error asked for, and rows get their sums back if the scene is closed",
        what: format!("{pairs} pairs too small to matter"),
        counted: FORM_FACTORS,
        predicted: pairs,
        measured: None,
        prior: error,
        bound: None,
    }
}

/// What a run of `strategy` by `plan` on the mesh it made will drop, before any of these pairs is computed: as its pilot says.
pub(crate) fn foreseen(plan: &Plan, geometry: &Geometry<'_>, strategy: &Strategy) -> Option<Bounded> {
    let error = strategy.thins().filter(|&error| allowed(error).is_ok())?;
    let of = |part: &Geometry<'_>| thinning(part, strategy, error).ok().map(|(thinning, _)| thinning.pairs());
    let all: Vec<u64> = if plan.omits() {
        let surfaces = geometry.surfaces();
        let of_room = |room: u32| {
            let in_room = |s: usize| plan.room[s] == room;
            let sends = |s: usize| in_room(s) && plan.roles[s] == Role::Exchanges;
            let own: Vec<u32> = (0..surfaces.len() as u32).filter(|&e| sends(surfaces[e as usize] as usize)).collect();
            of(&geometry.part(&own, &plan.bands.solved, plan.keeps_rows()).among(&in_room))
        };
        plan.lit_rooms().into_iter().filter_map(of_room).collect()
    } else {
        of(geometry).into_iter().collect()
    };
    (!all.is_empty()).then(|| omission(all.into_iter().sum(), error))
}

/// What all dropped pairs change of an answer with radiosity `b`, and what finding that took.
pub(crate) fn missed(
    system: &System<'_>,
    thinned: &[Thinned],
    b: &BandValues,
    strategy: &Strategy,
) -> Result<(Option<Missed>, Cost), RunError> {
    let Some(error) = strategy.thin.filter(|_| !thinned.is_empty()) else { return Ok((None, Cost::default())) };
    let pairs: u64 = thinned.iter().map(|thinned| thinned.thinning.pairs()).sum();
    let omission = Bounded { measured: Some(pairs), ..omission(pairs, error) };
    let stop = StopRule::unshot(BOUND_UNSHOT).steps(strategy.steps).unverified();
    let (by, cost) = bound(system, thinned, b, (&strategy.solver, &stop))?;
    Ok((Some(Missed { omission, by }), cost + thinned.iter().map(|thinned| thinned.pilot).sum()))
}

/// A bound of |H − H̃| for an answer with radiosity `b`, and what finding it took; `None` if there is none.
fn bound(
    system: &System<'_>,
    thinned: &[Thinned],
    b: &BandValues,
    (solver, stop): (&str, &StopRule),
) -> Result<(Option<By>, Cost), RunError> {
    let (areas, rho, bands) = (system.areas(), system.reflectance(), system.bands());
    let Norms { mut sums, mut cost, .. } = Norms::new(system)?;
    // Rows of an open scene may have lost what they did not get back.
    for thinned in thinned {
        let ends = thinned.lost.iter().zip(thinned.given.areas());
        thinned
            .elements
            .iter()
            .zip(ends)
            .for_each(|(&e, (lost, given))| sums[e as usize] += (lost - given) / areas[e as usize]);
    }
    let longest = sums.iter().copied().fold(0.0, f64::max);
    let rho_max = largest(&rho.to_owned());
    if rho_max.iter().any(|rho| rho * longest >= 1.0) {
        return Ok((None, cost));
    }
    let zeros = || BandValues::zeros(bands, areas.len());
    let mut off = [zeros(), zeros()];
    thinned.iter().for_each(|thinned| thinned.off(areas, b, &mut off));
    let mut g = zeros();
    let ends = off[0].values().iter().zip(off[1].values());
    g.values_mut().iter_mut().zip(ends).for_each(|(g, (low, high))| *g = high.max(-low).max(0.0));
    let mut all = zeros();
    for solution in 1.. {
        let mut light = g.clone();
        light.values_mut().iter_mut().zip(rho.values()).for_each(|(light, rho)| *light *= rho);
        // x = ρh solves x = ρg + ρF̃x, and h = g + F̃x.
        let mut h = zeros();
        if light.values().iter().any(|light| *light > 0.0) {
            let again = System::full(system.store(), areas, light.view(), rho)?;
            let found = solve_from(&again, &mut *named(solver, 1)?, stop, &mut (), None)?;
            cost += found.cost;
            if found.outcome != Outcome::Converged {
                return Ok((None, cost));
            }
            cost += again.irradiance(Direction::Gather, found.radiosity.view(), h.view_mut())?;
            light = found.radiosity;
        }
        let of_all = all.values_mut().iter_mut().zip(h.values()).zip(g.values());
        of_all.for_each(|((all, h), g)| *all += h + g);
        // r⁺(ρh)₊ is g of what is left, and what that comes to at most.
        thinned.iter().for_each(|thinned| thinned.off(areas, &light, &mut off));
        g.values_mut().iter_mut().zip(off[1].values()).for_each(|(g, high)| *g = high.max(0.0));
        let mut left = g.clone();
        for (b, rho) in rho_max.iter().enumerate() {
            let most = g.band(b).iter().copied().fold(0.0, f64::max) * rho / (1.0 - rho * longest);
            left.band_mut(b).iter_mut().zip(&sums).for_each(|(left, sum)| *left += sum * most);
        }
        let square = |x: &BandValues| -> f64 {
            (0..bands).map(|b| areas.iter().zip(x.band(b)).map(|(a, x)| a * x * x).sum::<f64>()).sum()
        };
        if solution == SOLUTIONS || square(&left) <= LEFT_OVER * LEFT_OVER * square(&all) {
            all.values_mut().iter_mut().zip(left.values()).for_each(|(all, left)| *all += left);
            return Ok((Some(By::pointwise(all)), cost));
        }
    }
    unreachable!("solutions are counted")
}

/// Runs `once` with less dropped for as long as the bound of what was dropped is more than `strategy` allows, in the end with nothing.
pub(crate) fn held<'a>(
    strategy: &Strategy,
    geometry: Geometry<'a>,
    mut once: impl FnMut(&Strategy, Geometry<'a>) -> Result<Run<'a>, RunError>,
) -> Result<Run<'a>, RunError> {
    let mut run = once(strategy, geometry)?;
    let Some(error) = strategy.thins() else { return Ok(run) };
    let (mut aim, mut again) = (error, 0);
    let first = run.bounded.iter().find(|omission| omission.counted == FORM_FACTORS).map(|first| first.predicted);
    for runs in 1..=RUNS {
        let dropped = run.bounded.iter().find(|omission| omission.counted == FORM_FACTORS);
        let Some(bound) = dropped.and_then(|dropped| dropped.bound).filter(|bound| *bound > error) else { break };
        aim *= (AGAIN * error / bound).max(1.0 / CHANGE);
        let less = Strategy { thin: (runs < RUNS).then_some(aim), ..strategy.clone() };
        let Run { geometry, form_factors, solution, .. } = run;
        again += form_factors.cost.form_factors;
        run = once(&less, geometry)?;
        run.form_factors.cost += form_factors.cost;
        run.form_factors.time += form_factors.time;
        run.solution.cost += solution.cost;
        run.solution.time += solution.time;
        if less.thin.is_none() {
            run.bounded.insert(0, Bounded { measured: Some(0), bound: Some(0.0), ..omission(0, error) });
        }
    }
    if let Some(dropped) = run.bounded.iter_mut().find(|omission| omission.counted == FORM_FACTORS) {
        dropped.prior = error;
        dropped.predicted = first.unwrap_or(dropped.predicted);
        dropped.measured = dropped.measured.map(|pairs| pairs.saturating_sub(again));
    }
    Ok(run)
}
