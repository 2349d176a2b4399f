//! What an error is worth to the surfaces that are asked for: the adjoint of the radiosity equation.
//!
//! H = F(E + ρH) is asked for where W = 1 (and not where W = 0). In the inner product ⟨a, b⟩ = Σ A a b the form factors are their own adjoint, since
//! A_i F_ij = A_j F_ji, so
//!
//! ```text
//! ⟨W, H⟩ = ⟨W, (I − Fρ)⁻¹ FE⟩ = ⟨Y, FE⟩ = ⟨I, E⟩,      Y = W + ρFY,      I = FY
//! ```
//!
//! Y is the *importance of irradiance*: an error δ of H in an element changes ⟨W, H⟩ by A Y δ, all reflections counted. I is the importance of what an element
//! emits (B. E. Smits, J. R. Arvo and D. H. Salesin, "An importance-driven radiosity algorithm", Computer Graphics 26(2), 1992). Both come from one
//! solution of the system itself, with the
//! surfaces that are asked for as its lamps: Y is its radiosity and I its irradiance. Errors δ of irradiance reach the asked surfaces with
//!
//! ```text
//! ‖(I − Fρ)⁻¹ δ‖_W ≤ ‖δ‖_W + √( κ Σ A (Y − W) δ² ),      κ = ρ_max/(1 − ρ_max),
//! ```
//!
//! by Jensen's inequality on the rows of Σ_{k ≥ 1} (Fρ)^k, so that squares of errors count by Y as well. Refinement takes A Y δ² in place of A δ²:
//! it need not look at what is
//! neither asked for nor seen by it. A test has both sides of the first line equal to rounding. On forms with patches the equality holds as far as
//! reciprocity does.
//!
//! W may be any weights: those of a picture are [`view_weights`](crate::view_weights). What is *not* here: importance by direction, which diffuse surfaces do
//! not need.

use radiosity_core::{BandValues, Direction, Solution, StopRule, System, solve_from};

use crate::RunError;
use crate::run::named;

/// Importances of the elements of a system.
#[derive(Clone, Debug, PartialEq)]
pub struct Importance {
    /// Y, of irradiance.
    pub of_irradiance: BandValues,
    /// I = FY, of emission.
    pub of_emission: BandValues,
}

/// The largest value of any band, element by element.
pub(crate) fn largest_of(y: &BandValues) -> Vec<f64> {
    (0..y.len()).map(|e| (0..y.count()).map(|b| y.band(b)[e]).fold(0.0, f64::max)).collect()
}

impl Importance {
    /// The importances for `asked`, W of every element and at least 0, and the solution they came from.
    ///
    /// # Errors
    ///
    /// [`RunError`] if there is no such solver, it cannot take the system, or the store fails.
    ///
    /// # Panics
    ///
    /// If there is not one weight an element.
    pub fn new(
        system: &System<'_>,
        asked: &[f64],
        solver: &str,
        stop: &StopRule,
    ) -> Result<(Self, Solution), RunError> {
        assert_eq!(asked.len(), system.elements(), "a weight of every element");
        Self::weighted(system, &BandValues::new(asked.repeat(system.bands()), asked.len()), solver, stop)
    }

    /// [`Self::new`] for weights W that differ between bands.
    ///
    /// # Errors
    ///
    /// [`RunError`] as [`Self::new`].
    ///
    /// # Panics
    ///
    /// If there is not one weight an element and band.
    pub fn weighted(
        system: &System<'_>,
        lamps: &BandValues,
        solver: &str,
        stop: &StopRule,
    ) -> Result<(Self, Solution), RunError> {
        assert_eq!(
            (lamps.len(), lamps.count()),
            (system.elements(), system.bands()),
            "a weight of every element and band"
        );
        let (areas, rho) = (system.areas(), system.reflectance());
        let adjoint = match system.parent() {
            None => System::full(system.store(), areas, lamps.view(), rho)?,
            Some(parent) => System::substructured(system.store(), system.form(), areas, parent, lamps.view(), rho)?,
        };
        let mut solved = solve_from(&adjoint, &mut *named(solver, 1)?, stop, &mut (), None)?;
        let mut of_emission = BandValues::zeros(system.bands(), lamps.len());
        solved.cost += adjoint.irradiance(Direction::Gather, solved.radiosity.view(), of_emission.view_mut())?;
        Ok((Self { of_irradiance: solved.radiosity.clone(), of_emission }, solved))
    }
}
