//! Successive over-relaxation: Gauss–Seidel that goes further than it is told.

use radiosity_core::{Bands, Cost, Direction, Form, Iterate, Needs, Progress, Solver, StoreError, System};

use crate::gauss_seidel::Sweeps;

/// Successive over-relaxation, with a factor given or found while it runs.
///
/// In order of s, with the newest x_t,
///
/// ```text
/// x_s ← x_s + ω [ (E_s + ρ_s Σ_{t ≠ s} F_st x_t) / (1 − ρ_s F_ss) − x_s ]
/// ```
///
/// (D. M. Young, *Iterative Solution of Large Linear Systems*, 1971; for radiosity S. J. Gortler, M. F. Cohen and P. Slusallek,
/// "Radiosity and relaxation methods", IEEE CG&A 14, 1994). A factor that is not given begins at 1. Once the changes of two sweeps have
/// settled at a ratio λ, Young's relation of a consistently ordered matrix gives the spectral radius μ of Jacobi's iteration and from it
/// the factor (L. A. Hageman and D. M. Young, *Applied Iterative Methods*, 1981, chapter 9),
///
/// ```text
/// μ² = (λ + ω − 1)² / (λ ω²),      ω = 2 / (1 + √(1 − μ²))
/// ```
///
/// and again whenever changes fall more slowly than that promises. ρF is not consistently ordered, so this is a guess; in closed
/// rooms it comes within a factor of two of the best number of sweeps.
///
/// - *Reads*: every row once a step, gathering; the full form. (From elements to patches a block of elements moves at once, and a
///   factor above 1 need not converge.)
/// - *Convergence*: for 0 < ω < 2 on symmetric positive definite systems; sweeps grow like 1/√(1 − ρ) where Gauss–Seidel's grow like
///   1/(1 − ρ). Below ρ = 0.5 there is nothing to gain.
/// - *Residual*: none at hand; a step claims the change of Gauss–Seidel, and the loop verifies it.
/// - *Breakdown*: if 1 − ρ_s F_ss is not positive.
/// - *Memory*: as Gauss–Seidel.
#[derive(Clone, Debug, Default)]
pub struct OverRelaxation {
    fixed: Option<f64>,
    factor: Factor,
    sweeps: Sweeps,
}

impl OverRelaxation {
    /// Over-relaxation by a fixed factor ω.
    ///
    /// # Panics
    ///
    /// If ω does not lie in (0, 2).
    pub fn new(omega: f64) -> Self {
        assert!(omega > 0.0 && omega < 2.0, "the relaxation factor lies between 0 and 2, got {omega}");
        Self { fixed: Some(omega), ..Self::default() }
    }
}

/// The factor in use, and what the sweeps since it was set tell of it.
#[derive(Clone, Copy, Debug)]
struct Factor {
    omega: f64,
    /// Change of the last sweep, its ratio to the one before, and the number of sweeps.
    change: f64,
    ratio: f64,
    sweeps: u32,
}

impl Default for Factor {
    fn default() -> Self {
        Self { omega: 1.0, change: f64::NAN, ratio: f64::NAN, sweeps: 0 }
    }
}

/// Sweeps after which a ratio may be believed.
const SETTLED: u32 = 5;

impl Factor {
    /// Takes in the change of a sweep.
    fn learn(&mut self, change: f64) {
        let (ratio, before) = (change / self.change, self.ratio);
        (self.change, self.ratio, self.sweeps) = (change, ratio, self.sweeps + 1);
        let settled = self.sweeps > SETTLED && (ratio - before).abs() < 0.1 * (1.0 - ratio);
        // With the best factor changes fall by ω − 1 a sweep; Hageman and Young's 3/4 leaves room for noise.
        if settled && ratio < 1.0 && ratio > (self.omega - 1.0).powf(0.75) {
            let mu2 = (ratio + self.omega - 1.0).powi(2) / (ratio * self.omega * self.omega);
            if mu2 < 1.0 {
                let omega = 2.0 / (1.0 + (1.0 - mu2).sqrt());
                *self = Self { omega: omega.max(self.omega), ..Self::default() };
            }
        }
    }
}

impl Solver for OverRelaxation {
    fn name(&self) -> &'static str {
        "sor"
    }

    fn needs(&self) -> Needs {
        Needs { forms: &[Form::Full], direction: Direction::Gather, symmetric: false }
    }

    fn start(&mut self, system: &System<'_>, from: Option<Bands<'_>>) -> Result<(Iterate, Cost), StoreError> {
        self.factor = Factor { omega: self.fixed.unwrap_or(1.0), ..Factor::default() };
        self.sweeps = Sweeps::new(system);
        let shot = from.unwrap_or(system.emission()).to_owned();
        Ok((Iterate { shot, residual: None }, Cost::default()))
    }

    fn step(&mut self, system: &System<'_>, iterate: &mut Iterate) -> Result<(Progress, Cost), StoreError> {
        let (progress, cost) = self.sweeps.relax(system, &mut iterate.shot, self.factor.omega)?;
        if let (Progress::Claim { unshot }, None) = (progress, self.fixed) {
            self.factor.learn(unshot);
        }
        Ok((progress, cost))
    }

    /// Changes swell for a few times 1/(2 − ω) sweeps before they fall.
    fn patience(&self) -> f64 {
        20.0 / (2.0 - self.factor.omega)
    }
}
