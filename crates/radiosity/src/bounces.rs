//! Bounces of light too weak to matter: how many a reflectance allows, and what is left when the solver stops.
//!
//! Each bounce loses at least 1 − ρ_max of the light, so that what is missing after k bounces of a closed or open scene, and what is missing when a
//! method stops at B = x + r with H = Fx, are
//!
//! ```text
//! ‖H* − H_k‖ = ‖Σ_{l>k} (Fρ)^l FE‖ ≤ ρ_max^{k+1}/(1 − ρ_max) ‖H*‖,
//! ‖H* − H‖   = ‖(I − Fρ)⁻¹ z‖     ≤ ‖z‖ / (1 − σ ρ_max),             z = F r = F B − H,
//! ```
//!
//! with ‖F‖ ≤ σ by its row and column sums f (1 but for errors), and in every element
//!
//! ```text
//! |H* − H|_e ≤ |z_e| + f_e ρ_max max|z| / (1 − ρ_max max f),
//! ```
//!
//! since what z brings comes by the row of e: where none does, nothing is missing. The smaller of both counts for what is asked for. The first tells the bounces before any work ([`bounces`]); the second takes three products after
//! it, and the solver goes on until it is the error asked for. Jacobi's steps are bounces; other methods take no more of them where they converge
//! faster, and what they took is counted.
//! A test compares the bound with a solution to rounding, and the steps with those of one.
//!
//! What is *not* here: methods that sample, the two-level form, and form factors that differ between bands.

use radiosity_core::{BandValues, Bands, Direction, Observer, Solution, StopRule, System, solve_from};

use crate::asked::Asked;
use crate::bounded::{Bounded, By, Missed, Norms, largest, relative};
use crate::run::{allowed, named, stop_rule};
use crate::{Geometry, RunError, Shape, Strategy};

/// By how much the unshot share falls where the solver stopped too early.
const FALL: f64 = 4.0;

/// The number k of bounces after the first light with ρ^{k+1}/(1 − ρ) ≤ `error`, for the largest reflectance of a scene.
///
/// # Panics
///
/// If the reflectance is not in [0, 1) or the error not positive.
///
/// # Examples
///
/// ```
/// // 0.5^{k+1}/0.5 ≤ 0.01 from k = 7 on: 0.5⁷ < 0.01 < 0.5⁶.
/// assert_eq!(radiosity::bounces(0.5, 0.01), 7);
/// assert_eq!(radiosity::bounces(0.0, 0.01), 0);
/// ```
pub fn bounces(reflectance: f64, error: f64) -> u64 {
    assert!((0.0..1.0).contains(&reflectance), "a reflectance of {reflectance}");
    assert!(error > 0.0, "an error of {error}");
    let powers = (error * (1.0 - reflectance)).ln() / reflectance.ln();
    if reflectance == 0.0 || powers <= 1.0 { 0 } else { (powers - 1.0).ceil() as u64 }
}

impl Strategy {
    /// The error that bounces may leave, if the solver is to stop by it.
    pub(crate) fn leaves_bounces(&self) -> Option<f64> {
        self.bounces.filter(|_| self.verify && !self.samples())
    }
}

/// [`bounces`], but no more than `steps`; those where no number of them leaves the error, since it is not positive or no light is lost.
fn followed(reflectance: f64, error: f64, steps: u64) -> u64 {
    if (0.0..1.0).contains(&reflectance) && error > 0.0 { bounces(reflectance, error).min(steps) } else { steps }
}

/// Solves until what is unshot changes irradiance of what is `asked` for by at most what `strategy` allows, or to its unshot share.
pub(crate) fn solve_until(
    system: &System<'_>,
    asked: &Asked,
    strategy: &Strategy,
    observer: &mut dyn Observer,
    from: Option<Bands<'_>>,
) -> Result<(Solution, Option<Missed>), RunError> {
    let solver = &mut *named(&strategy.solver, strategy.seed)?;
    let plain = stop_rule(strategy);
    // Row sums of every band would have to be known.
    let per_band = system.store().properties().per_band;
    let Some(error) = strategy.leaves_bounces().filter(|_| !per_band) else {
        return Ok((solve_from(system, solver, &plain, observer, from)?, None));
    };
    let rho = largest(&system.reflectance().to_owned());
    let most = rho.iter().copied().fold(0.0, f64::max);
    let norms = Norms::new(system)?;
    let left: Vec<f64> = rho.iter().map(|rho| 1.0 - norms.sigma * rho).collect();
    if left.iter().any(|left| *left <= 0.0) {
        return Ok((solve_from(system, solver, &plain, observer, from)?, None));
    }
    let areas = system.areas();
    // If none of what is asked for has an unknown, a black face say, its error is not known here, and the solver goes on to its unshot share.
    let known = asked.parts.iter().any(|part| *part > 0.0);
    let mut unshot = (error * (1.0 - most)).max(strategy.unshot);
    let mut done: Option<Solution> = None;
    loop {
        let before = done.as_ref().map(|solution| solution.radiosity.view()).or(from);
        let steps = strategy.steps - done.as_ref().map_or(0, |done| done.steps);
        let stop = StopRule { unshot, steps, ..plain };
        let mut solution = solve_from(system, &mut *named(&strategy.solver, strategy.seed)?, &stop, observer, before)?;
        if let Some(done) = &done {
            solution.steps += done.steps;
            solution.cost += done.cost;
            solution.time += done.time;
            solution.verification += done.verification;
        }
        // z, and what it bounds.
        let mut values = BandValues::zeros(system.bands(), system.elements());
        solution.verification += system.irradiance(Direction::Gather, solution.radiosity.view(), values.view_mut())?;
        let mut squares = Vec::with_capacity(values.count());
        for (b, (left, rho)) in left.iter().zip(&rho).enumerate() {
            let z = values.band_mut(b);
            z.iter_mut().zip(solution.irradiance.band(b)).for_each(|(again, h)| *again = (*again - h).abs());
            let square: f64 = z.iter().zip(areas).map(|(z, area)| area * z * z).sum();
            squares.push(square / (left * left));
            let largest = z.iter().copied().fold(0.0, f64::max);
            let reflected = rho * largest / (1.0 - rho * norms.largest());
            let everywhere = if reflected >= 0.0 { reflected } else { f64::INFINITY };
            z.iter_mut().zip(&norms.sums).filter(|(_, sum)| **sum > 0.0).for_each(|(z, sum)| *z += sum * everywhere);
        }
        let by = By { values, squares };
        let missed = if known { relative(&by, &solution.irradiance, areas, asked) } else { f64::INFINITY };
        let stopped = unshot <= strategy.unshot || solution.steps >= strategy.steps;
        if missed <= error || stopped || solution.outcome != radiosity_core::Outcome::Converged {
            solution.verification += norms.cost;
            let omission = omission(strategy, most, error, solution.steps);
            return Ok((solution, Some(Missed { omission, by: Some(by) })));
        }
        unshot = (unshot / FALL).max(strategy.unshot);
        done = Some(solution);
    }
}

/// What a run of `strategy` on `geometry` will not follow, before anything is computed.
pub(crate) fn foreseen(geometry: &Geometry<'_>, strategy: &Strategy) -> Option<Bounded> {
    let error =
        strategy.leaves_bounces().filter(|&error| strategy.shape != Shape::TwoLevel && allowed(error).is_ok())?;
    let rho = largest(&geometry.reflectance()).into_iter().fold(0.0, f64::max);
    Some(Bounded { measured: None, ..omission(strategy, rho, error, 0) })
}

/// What following bounces to an error of `error` leaves out, for the largest reflectance of a scene and so many steps taken.
pub(crate) fn omission(strategy: &Strategy, reflectance: f64, error: f64, steps: u64) -> Bounded {
    let [some, all] = [error, strategy.unshot].map(|error| followed(reflectance, error, strategy.steps));
    // A shot is no bounce.
    let products = !matches!(strategy.solver.as_str(), "shooting" | "overshooting" | "direct" | "direct-f32");
    Bounded {
        reason: "what they bring is less than the error asked for",
        what: format!("bounces beyond {some}"),
        counted: "bounces",
        predicted: all.saturating_sub(some),
        measured: products.then(|| all.saturating_sub(steps)),
        prior: error,
        bound: None,
    }
}
