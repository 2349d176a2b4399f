//! Jacobi iteration: everything gathers at once.

use radiosity_core::{Bands, Cost, Direction, Form, Iterate, Needs, Progress, Solver, StoreError, System};

/// Jacobi iteration: x ← x + r, one product of all rows a step.
///
/// ```text
/// x⁰ = 0,  r⁰ = E;      xᵏ⁺¹ = xᵏ + rᵏ,      rᵏ⁺¹ = E + ρ F xᵏ⁺¹ − xᵏ⁺¹ = ρ F rᵏ
/// ```
///
/// so that xᵏ is the light reflected fewer than k times: the Neumann series. (C. M. Goral, K. E. Torrance, D. P.
/// Greenberg and B. Battaile, "Modeling the interaction of light between diffuse surfaces", SIGGRAPH 1984, for the
/// system; Y. Saad, *Iterative Methods for Sparse Linear Systems*, 2nd ed., 2003, section 4.1, for the iteration.)
///
/// - *Reads*: every row once a step; all forms, in either direction of the full form.
/// - *Convergence*: Σ A|r| falls at least by q a step (see [`System::contraction`]); q ≤ ρ_max when row sums are 1.
/// - *Accuracy*: r is recomputed from x in each step, so it is true to rounding.
/// - *Memory*: nothing beside x and r.
#[derive(Clone, Copy, Debug)]
pub struct Jacobi {
    direction: Direction,
}

impl Jacobi {
    /// Jacobi iteration that reads the full form in `direction`.
    pub fn new(direction: Direction) -> Self {
        Self { direction }
    }
}

impl Default for Jacobi {
    fn default() -> Self {
        Self::new(Direction::Gather)
    }
}

impl Solver for Jacobi {
    fn name(&self) -> &'static str {
        "jacobi"
    }

    fn needs(&self) -> Needs {
        let forms = &[Form::Full, Form::ElementsToPatches, Form::PatchesToElements];
        Needs { forms, direction: self.direction, symmetric: false }
    }

    fn start(&mut self, system: &System<'_>, from: Option<Bands<'_>>) -> Result<(Iterate, Cost), StoreError> {
        let mut residual = system.emission().to_owned();
        let mut shot = residual.clone();
        let mut cost = Cost::default();
        match from {
            None => shot.values_mut().fill(0.0),
            Some(from) => {
                shot = from.to_owned();
                cost = system.residual(self.direction, shot.view(), residual.view_mut())?;
            }
        }
        Ok((Iterate { shot, residual: Some(residual) }, cost))
    }

    fn step(&mut self, system: &System<'_>, iterate: &mut Iterate) -> Result<(Progress, Cost), StoreError> {
        let Iterate { shot, residual } = iterate;
        let residual = residual.as_mut().expect("start gave one");
        shot.values_mut().iter_mut().zip(residual.values()).for_each(|(x, r)| *x += r);
        let mut cost = system.residual(self.direction, shot.view(), residual.view_mut())?;
        cost.flops += 4 * shot.values().len() as u64;
        Ok((Progress::Residual, cost))
    }
}
