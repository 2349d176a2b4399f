//! The loop around a method: stopping, timing, verification and the bound.

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use crate::{BandValues, Bands, Certificate, Cost, Iterate, Progress, Sampled, SolveError, Solver, System};

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StopRule {
    /// Target of the unshot fraction η = Σ A|r| / Σ A E of the worst band; of the estimated error of a method that samples.
    pub unshot: f64,
    /// Largest number of steps.
    pub steps: u64,
    /// Largest time, of `start` and `step` alone.
    pub time: Option<Duration>,
    /// Whether the final residual is recomputed and the bound evaluated, with a handful of passes over the form
    /// factors. Without it, irradiance comes from (B − E)/ρ and there is no bound.
    pub verify: bool,
}

impl StopRule {
    /// Stops at unshot fraction `unshot`, verified.
    pub fn unshot(unshot: f64) -> Self {
        Self { unshot, steps: 1_000_000, time: None, verify: true }
    }

    /// At most `steps` steps.
    pub fn steps(self, steps: u64) -> Self {
        Self { steps, ..self }
    }

    /// At most `time` in the method.
    pub fn time(self, time: Duration) -> Self {
        Self { time: Some(time), ..self }
    }

    /// Without recomputing the residual at the end.
    pub fn unverified(self) -> Self {
        Self { verify: false, ..self }
    }
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Outcome {
    /// η reached the target, or the estimated error of a method that samples did.
    Converged,
    /// η stopped falling above the target: rounding level.
    Stagnated,
    /// η grew, far or steadily: the row sums times ρ exceed one.
    NotContracting,
    /// The method could not go on, or a value was not finite.
    Breakdown,
    /// The steps allowed were used up.
    StepLimit,
    /// The time allowed was used up.
    TimeLimit,
    /// The observer asked to stop.
    Cancelled,
}

impl std::fmt::Display for Outcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Converged => "converged",
            Self::Stagnated => "stagnated",
            Self::NotContracting => "not contracting",
            Self::Breakdown => "breakdown",
            Self::StepLimit => "step limit",
            Self::TimeLimit => "time limit",
            Self::Cancelled => "cancelled",
        })
    }
}

/// A run after `number` steps (0: after `start`), as an observer sees it. The clock stands while it looks.
#[derive(Debug)]
pub struct Step<'a> {
    /// Steps done.
    pub number: u64,
    /// Time in `start` and `step` so far.
    pub time: Duration,
    /// Spent so far.
    pub cost: Cost,
    /// η where known, or the estimated error of a method that samples.
    pub unshot: Option<f64>,
    /// x and r.
    pub iterate: &'a Iterate,
}

/// Looks on after every step and may stop the run.
pub trait Observer {
    /// Called after `start` (number 0) and after every step.
    fn observe(&mut self, step: &Step<'_>) -> ControlFlow<()>;
}

impl Observer for () {
    fn observe(&mut self, _: &Step<'_>) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// What a run gives.
#[derive(Clone, Debug)]
pub struct Solution {
    /// B = x + r of every element.
    pub radiosity: BandValues,
    /// H of every element, from x; B = E + ρH.
    pub irradiance: BandValues,
    /// How the run ended.
    pub outcome: Outcome,
    /// Steps done.
    pub steps: u64,
    /// Spent in `start` and `step`, and in passes made to verify claims on the way.
    pub cost: Cost,
    /// Spent after the run, on the final residual and the bound.
    pub verification: Cost,
    /// Time in `start` and `step`, and in passes made to verify claims on the way.
    pub time: Duration,
    /// η of the final residual (as recomputed, if verified); NaN if not known.
    pub unshot: f64,
    /// Σ A σ(B) / Σ A E of the worst band as a method that samples estimates it, before a last product where one was made; `None` of
    /// all others. No bound: an error of twice as much is no surprise.
    pub standard_error: Option<f64>,
    /// All that the final residual says; `None` if not verified, or where rows cannot verify what was sampled.
    pub certificate: Option<Certificate>,
}

impl Solution {
    /// q of the worst band; `None` if not verified.
    pub fn contraction(&self) -> Option<f64> {
        self.certificate.map(|certificate| certificate.contraction)
    }

    /// Bound of Σ A|B* − B| / Σ A E over all bands, rounding added; `None` if q ≥ 1 or not verified.
    pub fn bound(&self) -> Option<f64> {
        self.certificate.and_then(|certificate| certificate.bound)
    }
}

/// Growth of η over its first value at which a run counts as not contracting, however short; slower growth counts if
/// η rises from pass to pass until patience ends, which rounding never makes it do.
const GROWTH: f64 = 1e6;

/// Runs `solver` on `system` until `stop` says so, calling `observer` outside the clock.
///
/// # Errors
///
/// [`SolveError`] if the method cannot take the system, the rule is no rule, or the store fails. How a run that could
/// begin ended is [`Solution::outcome`].
pub fn solve(
    system: &System<'_>,
    solver: &mut dyn Solver,
    stop: &StopRule,
    observer: &mut dyn Observer,
) -> Result<Solution, SolveError> {
    solve_from(system, solver, stop, observer, None)
}

/// [`solve`], continuing from radiosities of a similar system.
///
/// # Errors
///
/// As [`solve`].
pub fn solve_from(
    system: &System<'_>,
    solver: &mut dyn Solver,
    stop: &StopRule,
    observer: &mut dyn Observer,
    from: Option<Bands<'_>>,
) -> Result<Solution, SolveError> {
    check(system, solver, stop, from)?;
    let direction = solver.needs().direction;
    let clock = Instant::now();
    let (mut iterate, mut cost) = solver.start(system, from)?;
    let mut time = clock.elapsed();
    let mut steps = 0;
    let mut watch = Watch::new(solver.passes_per_step(system));
    let mut progress = Progress::Residual;
    let outcome = loop {
        // η, where the method has it or where its claim is worth checking.
        let clock = Instant::now();
        let unshot = match (&iterate.residual, progress) {
            (_, Progress::Breakdown) => None,
            (_, Progress::Sampled { error, .. }) => Some(error),
            (Some(r), _) => Some(system.unshot(r.view())),
            (None, Progress::Claim { unshot }) if unshot <= stop.unshot || unshot.is_nan() || watch.due(unshot) => {
                let mut r = iterate.shot.clone();
                cost += system.residual(direction, iterate.shot.view(), r.view_mut())?;
                Some(system.unshot(r.view()))
            }
            _ => None,
        };
        time += clock.elapsed();
        if observer.observe(&Step { number: steps, time, cost, unshot, iterate: &iterate }).is_break() {
            break Outcome::Cancelled;
        }
        // Reasons to end, worst first.
        if progress == Progress::Breakdown || unshot.is_some_and(f64::is_nan) {
            break Outcome::Breakdown;
        }
        if unshot.is_some_and(|eta| eta <= stop.unshot) {
            break Outcome::Converged;
        }
        let ended = match progress {
            // An estimated error falls slowly and not in every step: it never counts as stuck.
            Progress::Sampled { unshot, .. } => watch.grown(unshot).then_some(Outcome::NotContracting),
            _ => unshot.and_then(|eta| watch.judge(eta, steps, solver.patience())),
        };
        if let Some(outcome) = ended {
            break outcome;
        }
        if steps >= stop.steps {
            break Outcome::StepLimit;
        }
        if stop.time.is_some_and(|limit| time >= limit) {
            break Outcome::TimeLimit;
        }
        let clock = Instant::now();
        let (next, spent) = solver.step(system, &mut iterate)?;
        time += clock.elapsed();
        progress = next;
        cost += spent;
        steps += 1;
    };
    let sampled = solver.sampled(system);
    solver.release();
    finish(system, iterate, sampled, stop, Ending { outcome, steps, cost, time, direction })
}

fn check(system: &System<'_>, solver: &dyn Solver, stop: &StopRule, from: Option<Bands<'_>>) -> Result<(), SolveError> {
    let needs = solver.needs();
    if !(stop.unshot.is_finite() && stop.unshot >= 0.0) {
        return Err(SolveError::Target { value: stop.unshot });
    }
    if !needs.forms.contains(&system.form()) {
        return Err(SolveError::NeedsForm { solver: solver.name(), form: system.form(), works_on: needs.forms });
    }
    if needs.symmetric && !system.store().properties().symmetric {
        return Err(SolveError::NeedsSymmetric { solver: solver.name(), store: system.store().name() });
    }
    let size = (system.bands(), system.elements());
    match from {
        Some(from) if (from.count(), from.len()) != size => {
            Err(SolveError::Start { has: from.values().len(), needs: size.0 * size.1 })
        }
        _ => Ok(()),
    }
}

/// Remembers η to tell slow from stuck and growing.
struct Watch {
    passes_per_step: f64,
    first: Option<f64>,
    best: f64,
    best_step: u64,
    /// η at the last whole pass, its step, and how often η has risen from pass to pass since it was smallest.
    pass: (f64, u64),
    rises: u32,
    best_claim: f64,
    idle_claims: u32,
}

impl Watch {
    fn new(passes_per_step: f64) -> Self {
        Self {
            passes_per_step,
            first: None,
            best: f64::INFINITY,
            best_step: 0,
            pass: (f64::INFINITY, 0),
            rises: 0,
            best_claim: f64::INFINITY,
            idle_claims: 0,
        }
    }

    /// Whether a claim stopped falling, so that the true η must be looked at.
    fn due(&mut self, claim: f64) -> bool {
        if claim < self.best_claim {
            (self.best_claim, self.idle_claims) = (claim, 0);
        } else {
            self.idle_claims += 1;
        }
        self.idle_claims >= 3
    }

    /// Whether η has grown far beyond its first value.
    fn grown(&mut self, eta: f64) -> bool {
        let first = *self.first.get_or_insert(eta);
        !eta.is_finite() || eta > GROWTH * first
    }

    fn judge(&mut self, eta: f64, step: u64, patience: f64) -> Option<Outcome> {
        let grown = self.grown(eta);
        if eta < self.best {
            (self.best, self.best_step) = (eta, step);
            (self.pass, self.rises) = ((eta, step), 0);
        } else if (step - self.pass.1) as f64 * self.passes_per_step >= 1.0 {
            self.rises = if eta > self.pass.0 { self.rises + 1 } else { 0 };
            self.pass = (eta, step);
        }
        if grown {
            return Some(Outcome::NotContracting);
        }
        let patient = (step - self.best_step) as f64 * self.passes_per_step <= patience;
        let rising = f64::from(self.rises) >= patience - 1.0;
        (!patient).then_some(if rising { Outcome::NotContracting } else { Outcome::Stagnated })
    }
}

struct Ending {
    outcome: Outcome,
    steps: u64,
    cost: Cost,
    time: Duration,
    direction: crate::Direction,
}

/// B, H, and what can be said about them.
fn finish(
    system: &System<'_>,
    iterate: Iterate,
    sampled: Option<Sampled>,
    stop: &StopRule,
    ending: Ending,
) -> Result<Solution, SolveError> {
    let Ending { outcome, steps, mut cost, mut time, direction } = ending;
    let Iterate { shot, mut residual } = iterate;
    let (bands, m) = (system.bands(), system.elements());
    let mut verification = Cost::default();
    let standard_error = sampled.as_ref().map(|sampled| sampled.standard_error);
    // What was drawn from rows has them for a last product and a check; what was not is all there is.
    let verify = stop.verify && (sampled.is_none() || system.store().draws_from_rows());
    let sampled = sampled.filter(|_| !verify);
    let known = sampled.is_none();
    let mut irradiance = BandValues::zeros(bands, m);
    let radiosity = if let Some(sampled) = sampled {
        irradiance = sampled.irradiance;
        system.radiosity(irradiance.view())
    } else if let (false, Some(r)) = (verify, &residual) {
        let mut b = shot.clone();
        b.values_mut().iter_mut().zip(r.values()).for_each(|(b, r)| *b += r);
        for band in 0..bands {
            let (e, rho) = (system.emission().band(band), system.reflectance().band(band));
            for (k, h) in irradiance.band_mut(band).iter_mut().enumerate() {
                *h = if rho[k] > 0.0 { (b.band(band)[k] - e[k]) / rho[k] } else { f64::NAN };
            }
        }
        b
    } else {
        // What the method made of r is not looked at: its memory goes to what follows.
        let had_residual = residual.take().is_some();
        // A method without r needs this pass for its answer, and one that samples has a better one of it; for the others it is a check.
        let clock = Instant::now();
        let spent = system.irradiance(direction, shot.view(), irradiance.view_mut())?;
        if !had_residual || standard_error.is_some() {
            cost += spent;
            time += clock.elapsed();
        } else {
            verification += spent;
        }
        system.radiosity(irradiance.view())
    };
    // r = B − x, from the recomputed B where there is one.
    let mut r = radiosity.clone();
    r.values_mut().iter_mut().zip(shot.values()).for_each(|(r, x)| *r -= x);
    let unshot = if known { system.unshot(r.view()) } else { f64::NAN };
    let mut certificate = None;
    if verify {
        let (found, spent) = Certificate::new(system, direction, shot.view(), r.view())?;
        verification += spent;
        certificate = Some(found);
    }
    Ok(Solution {
        radiosity,
        irradiance,
        outcome,
        steps,
        cost,
        verification,
        time,
        unshot,
        standard_error,
        certificate,
    })
}
