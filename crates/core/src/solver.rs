//! One method: how it begins and what one step does.

use crate::{BandValues, Bands, Cost, Direction, Form, StoreError, System};

/// What a method asks of a system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Needs {
    /// Forms it reads.
    pub forms: &'static [Form],
    /// Direction in which it reads the full form.
    pub direction: Direction,
    /// Whether it needs A_s F_st = A_t F_ts.
    pub symmetric: bool,
}

/// The state of a run: x, what has been shot, and r = E + ρFx − x where the method has it at hand.
#[derive(Clone, Debug)]
pub struct Iterate {
    /// x of every element.
    pub shot: BandValues,
    /// r of every element, if the method keeps it true; that of the estimate so far of a method that samples.
    pub residual: Option<BandValues>,
}

/// What a step says about itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress {
    /// The iterate carries its residual: read it there.
    Residual,
    /// The method has no residual at hand but guesses η from its own step; the loop verifies before it believes.
    Claim {
        /// The guess.
        unshot: f64,
    },
    /// The method samples: it has no residual, only an estimate of its error, which the loop believes.
    Sampled {
        /// Estimate of Σ A|B* − B| / Σ A E of the worst band: the standard error, and what was never shot; infinite while not known.
        error: f64,
        /// Σ A|r| / Σ A E of the worst band as sampled: it only falls where the system contracts.
        unshot: f64,
    },
    /// The method broke down (a pivot or a curvature that is not positive) and can do no more.
    Breakdown,
}

/// What a method that samples knows of its answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Sampled {
    /// H of every element; B = E + ρH.
    pub irradiance: BandValues,
    /// Σ A σ(B) / Σ A E of the worst band, σ the standard error of each element's mean.
    pub standard_error: f64,
}

/// A solution method for B = E + ρFB.
///
/// A solver keeps its own work space between [`Solver::start`] and [`Solver::release`]; it never times itself,
/// never checks for convergence and never computes an error: [`crate::solve`] does, the same for all.
pub trait Solver {
    /// Short name for tables and flags: `jacobi`, `cg`, …
    fn name(&self) -> &'static str;

    /// What the method asks of a system.
    fn needs(&self) -> Needs;

    /// The first iterate: `from` (radiosities of a similar system) or the method's own choice.
    ///
    /// # Errors
    ///
    /// [`StoreError`] if a row cannot be had.
    fn start(&mut self, system: &System<'_>, from: Option<Bands<'_>>) -> Result<(Iterate, Cost), StoreError>;

    /// One sweep, product, shot or factorisation.
    ///
    /// # Errors
    ///
    /// [`StoreError`] if a row cannot be had.
    fn step(&mut self, system: &System<'_>, iterate: &mut Iterate) -> Result<(Progress, Cost), StoreError>;

    /// Part of a whole pass over the form factors that a step is: 1 for a sweep, 1/n for a shot of one of n patches.
    fn passes_per_step(&self, _system: &System<'_>) -> f64 {
        1.0
    }

    /// The answer so far of a method that samples; `None` before the first step and of all other methods.
    fn sampled(&self, _system: &System<'_>) -> Option<Sampled> {
        None
    }

    /// Gives back the work space: the loop calls it after the last step, before the answer is checked.
    fn release(&mut self) {}

    /// Passes over the form factors without a new smallest η after which the run counts as stagnated: more for a method
    /// whose η rises for a while before it falls.
    fn patience(&self) -> f64 {
        20.0
    }
}
