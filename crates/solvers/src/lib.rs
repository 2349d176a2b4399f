//! Solution methods for the radiosity system, one file a method.
//!
//! | name | method | reads | forms | symmetric stores only |
//! |---|---|---|---|---|
//! | `direct` | [`Direct`] | every row once, then one product a step | full | no (Cholesky or LU) |
//! | `direct-f32` | [`Direct::single`] | as `direct`, factors in single precision | full | no |
//! | `jacobi` | [`Jacobi`] | one product a step | all | no |
//! | `gauss-seidel` | [`GaussSeidel`] | one sweep a step | full, elements → patches | no |
//! | `sor` | [`OverRelaxation`] | one sweep a step | full | no |
//! | `chebyshev` | [`Chebyshev`] | one product a step | full | yes |
//! | `cg` | [`ConjugateGradient`] | one product a step | full | yes |
//! | `deflated-cg` | [`ConjugateGradient::deflated`] | one product a step | full | yes |
//! | `gmres` | [`Gmres`] | one product a step | all | no |
//! | `shooting` | [`Shooting`] | one row a step | full, patches → elements | no |
//! | `overshooting` | [`Shooting::overshooting`] | one row a step | full, patches → elements | no |
//! | `stochastic` | [`StochasticJacobi`] | rays, or every row once a step | full, patches → elements | no |
//!
//! All bands are solved at once. Stopping, timing and verification are [`radiosity_core::solve`]'s. [`ambient`] is for
//! display. What is *not* here: geometry, and how form factors are had or kept.

pub mod ambient;
mod chebyshev;
mod conjugate_gradient;
mod direct;
mod gauss_seidel;
mod gmres;
mod jacobi;
mod over_relaxation;
mod shooting;
mod stochastic_jacobi;

use radiosity_core::{Bands, Direction, SolveError, Solver, System};

pub use chebyshev::Chebyshev;
pub use conjugate_gradient::ConjugateGradient;
pub use direct::{Direct, Factorisation};
pub use gauss_seidel::GaussSeidel;
pub use gmres::Gmres;
pub use jacobi::Jacobi;
pub use over_relaxation::OverRelaxation;
pub use shooting::Shooting;
pub use stochastic_jacobi::StochasticJacobi;

/// Name of the method that samples: its answers carry a standard error instead of a residual.
pub const STOCHASTIC: &str = "stochastic";

/// Names of the methods that solve a system to rounding, in the order of [`all`]. [`by_name`] knows [`STOCHASTIC`] as well.
pub const NAMES: [&str; 11] = [
    "direct",
    "direct-f32",
    "jacobi",
    "gauss-seidel",
    "sor",
    "chebyshev",
    "cg",
    "deflated-cg",
    "gmres",
    "shooting",
    "overshooting",
];

/// One of each method of [`NAMES`], in the direction it is made for.
pub fn all() -> Vec<Box<dyn Solver>> {
    NAMES.into_iter().filter_map(by_name).collect()
}

/// The method called `name`, in the direction it is made for: shooting, overshooting and the stochastic
/// one shoot, all others gather.
pub fn by_name(name: &str) -> Option<Box<dyn Solver>> {
    let shoots = name.ends_with("shooting") || name == STOCHASTIC;
    let direction = if shoots { Direction::Shoot } else { Direction::Gather };
    by_name_in(name, direction).ok().flatten()
}

/// [`by_name`], with the seed of what is random in the method.
pub fn seeded(name: &str, seed: u64) -> Option<Box<dyn Solver>> {
    if name == STOCHASTIC { Some(Box::new(StochasticJacobi::new(seed))) } else { by_name(name) }
}

/// The method called `name`, reading the full form in `direction`; `None` if there is no such method.
///
/// On a symmetric store the direction changes nothing. On rows of a row-wise estimator gathering and shooting solve
/// different systems, and only methods that read the same way can be compared.
///
/// # Errors
///
/// [`SolveError::NeedsDirection`] if the method cannot read that way.
pub fn by_name_in(name: &str, direction: Direction) -> Result<Option<Box<dyn Solver>>, SolveError> {
    let solver: Box<dyn Solver> = match name {
        "direct" => Box::new(Direct::new(Factorisation::Automatic, direction)),
        "direct-f32" => Box::new(Direct::new(Factorisation::Automatic, direction).single()),
        "jacobi" => Box::new(Jacobi::new(direction)),
        "gauss-seidel" => Box::new(GaussSeidel::default()),
        "sor" => Box::new(OverRelaxation::default()),
        "chebyshev" => Box::new(Chebyshev::default()),
        "gmres" => Box::new(Gmres::new(direction)),
        "cg" => Box::new(ConjugateGradient::default()),
        "deflated-cg" => Box::new(ConjugateGradient::deflated()),
        "shooting" => Box::new(Shooting::default()),
        "overshooting" => Box::new(Shooting::overshooting()),
        STOCHASTIC => Box::new(StochasticJacobi::default()),
        _ => return Ok(None),
    };
    let needs = solver.needs();
    if needs.direction != direction && !needs.symmetric {
        return Err(SolveError::NeedsDirection { solver: solver.name(), direction });
    }
    Ok(Some(solver))
}

/// ε Σ A|x| / Σ A E of the worst band: what the rounding of x is in terms of η.
fn rounding_level(system: &System<'_>, x: Bands<'_>) -> f64 {
    let band = |b: usize| {
        let size: f64 = system.areas().iter().zip(x.band(b)).map(|(a, x)| a * x.abs()).sum();
        fraction(size, system.power(system.emission().band(b)))
    };
    f64::EPSILON * (0..x.count()).map(band).fold(0.0, f64::max)
}

/// Σ A|x| of a band over what the band emits; 0 when nothing is left, also of a band in which nothing emits.
fn fraction(left: f64, emitted: f64) -> f64 {
    if left == 0.0 { 0.0 } else { left / emitted }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_gives_the_solver_of_that_name() {
        assert_eq!(all().iter().map(|solver| solver.name()).collect::<Vec<_>>(), NAMES);
        assert_eq!(by_name(STOCHASTIC).map(|solver| solver.name()), Some(STOCHASTIC));
        assert!(by_name("gauss").is_none());
    }

    #[test]
    fn a_direction_that_a_method_cannot_read_is_refused() {
        let refused = by_name_in("shooting", Direction::Gather).map(|_| ());
        assert_eq!(refused, Err(SolveError::NeedsDirection { solver: "shooting", direction: Direction::Gather }));
        assert!(by_name_in("gauss-seidel", Direction::Shoot).is_err());
        // On the symmetric systems that it takes, conjugate gradients solve both.
        assert!(by_name_in("cg", Direction::Shoot).is_ok());
    }
}
