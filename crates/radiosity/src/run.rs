//! Follows a strategy from geometry to a solution.

use std::time::Instant;

use radiosity_core::{
    BandValues, Direction, Form, FormFactors, Observer, Solution, SolveError, StopRule, StoreError, System,
    SystemError, solve,
};
use radiosity_form_factors::hemicube::HemicubeError;
use radiosity_form_factors::stores::{DenseFormFactors, aggregate_sources};
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::MeshError;

use crate::{Geometry, Method, Phase, Shape, Strategy, assemble};

/// Why a run could not be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The mesh could not be made.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The hemicube could not be set up.
    #[error(transparent)]
    Hemicube(#[from] HemicubeError),
    /// A row could not be had.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The data make no system.
    #[error(transparent)]
    System(#[from] SystemError),
    /// The solver could not begin.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// No solver of that name.
    #[error("there is no solver '{name}'; choose one of {known}")]
    Solver {
        /// The name asked for.
        name: String,
        /// The names there are.
        known: String,
    },
    /// An asked error that cannot be asked.
    #[error("the tolerance is {value}; it must lie in (0, 1)")]
    Tolerance {
        /// The value given.
        value: f64,
    },
}

/// A scene solved by a strategy.
pub struct Run<'a> {
    /// Mesh and facets.
    pub geometry: Geometry<'a>,
    /// Meshing.
    pub meshing: Phase,
    /// Filling the store; on-demand stores are filled while solving.
    pub form_factors: Phase,
    /// Bytes of form factors held at the end.
    pub stored_bytes: u64,
    /// Largest |row sum − 1| and mean row sum of the store, if it was held.
    pub row_sums: Option<RowSums>,
    /// The solution on the exposed elements.
    pub solution: Solution,
}

/// Row sums of a store, relative to the areas of its sources.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowSums {
    /// Smallest.
    pub smallest: f64,
    /// Largest.
    pub largest: f64,
    /// Area-weighted mean.
    pub mean: f64,
}

impl Run<'_> {
    /// Time of all phases, in seconds.
    pub fn seconds(&self) -> f64 {
        (self.meshing.time + self.form_factors.time + self.solution.time).as_secs_f64()
    }

    /// Counts of all phases but verification.
    pub fn cost(&self) -> radiosity_core::Cost {
        self.form_factors.cost + self.solution.cost
    }
}

impl Strategy {
    /// Whether the solver can take this strategy's form and form factors: told before any of them is computed.
    ///
    /// # Errors
    ///
    /// [`RunError`] if there is no such solver, it does not read the form, or it or the store needs symmetric form factors
    /// and the method gives none.
    pub fn check(&self) -> Result<(), RunError> {
        let solver = named(&self.solver)?;
        let (name, needs) = (solver.name(), solver.needs());
        let form = match self.shape {
            Shape::Full | Shape::TwoLevel => Form::Full,
            Shape::ElementsToPatches => Form::ElementsToPatches,
            Shape::PatchesToElements => Form::PatchesToElements,
        };
        if !needs.forms.contains(&form) {
            return Err(SolveError::NeedsForm { solver: name, form, works_on: needs.forms }.into());
        }
        if needs.symmetric && !matches!(self.method, Method::Analytic { .. }) {
            return Err(SolveError::NeedsSymmetric { solver: name, store: self.store.name() }.into());
        }
        let symmetric = matches!(self.method, Method::Analytic { .. }) && self.shape == Shape::Full;
        if self.store.needs_symmetric() && !symmetric {
            return Err(StoreError::NeedsSymmetric { store: self.store.name(), rows: self.method.name() }.into());
        }
        Ok(())
    }
}

/// Solves `scene` by `strategy`.
///
/// # Errors
///
/// [`RunError`] if a setting is out of range, the solver cannot take the system or a store fails.
pub fn run<'a>(scene: &'a Scene, strategy: &Strategy, observer: &mut dyn Observer) -> Result<Run<'a>, RunError> {
    strategy.check()?;
    let clock = Instant::now();
    let geometry = Geometry::new(scene, &strategy.mesh)?;
    let meshing = Phase { time: clock.elapsed(), ..Phase::default() };
    let (form_factors, stored_bytes, row_sums, solution) = match strategy.shape {
        Shape::TwoLevel => two_level(&geometry, strategy, observer),
        shape => direct_form(&geometry, strategy, shape.form(), observer),
    }?;
    Ok(Run { geometry, meshing, form_factors, stored_bytes, row_sums, solution })
}

type Solved = (Phase, u64, Option<RowSums>, Solution);

fn stop_rule(strategy: &Strategy) -> StopRule {
    let rule = StopRule::unshot(strategy.unshot).steps(strategy.steps);
    if strategy.verify { rule } else { rule.unverified() }
}

fn direct_form(
    geometry: &Geometry<'_>,
    strategy: &Strategy,
    form: Form,
    observer: &mut dyn Observer,
) -> Result<Solved, RunError> {
    let (store, phase) = assemble(geometry, strategy.method, form, strategy.store, strategy.seed)?;
    let solution = solve_on(geometry, &*store, form, &strategy.solver, &stop_rule(strategy), observer)?;
    let bytes = store.properties().stored_bytes;
    let held = bytes > 0 && strategy.verify;
    let areas = if form == Form::PatchesToElements { geometry.patches() } else { geometry.elements() }.areas();
    let row_sums = if held { Some(row_sums(&*store, &areas)?) } else { None };
    Ok((phase, bytes, row_sums, solution))
}

/// Solves the system that `store` makes of `geometry` in `form`.
///
/// # Errors
///
/// [`RunError`] if there is no such solver, it cannot take the system, or the store fails.
pub fn solve_on(
    geometry: &Geometry<'_>,
    store: &dyn FormFactors,
    form: Form,
    solver: &str,
    stop: &StopRule,
    observer: &mut dyn Observer,
) -> Result<Solution, RunError> {
    let (emission, reflectance) = (geometry.emission(), geometry.reflectance());
    let areas = geometry.elements().areas();
    let system = System::substructured(store, form, &areas, geometry.parent(), emission.view(), reflectance.view())?;
    Ok(solve(&system, &mut *named(solver)?, stop, observer)?)
}

fn named(solver: &str) -> Result<Box<dyn radiosity_core::Solver>, RunError> {
    radiosity_solvers::by_name(solver)
        .ok_or_else(|| RunError::Solver { name: solver.to_owned(), known: radiosity_solvers::NAMES.join(", ") })
}

/// Form factors from elements to patches only, area-weighted to the parents; the n × n system solved; one gather.
fn two_level(geometry: &Geometry<'_>, strategy: &Strategy, observer: &mut dyn Observer) -> Result<Solved, RunError> {
    let clock = Instant::now();
    let rows = crate::rows(geometry, strategy.method, Form::ElementsToPatches, strategy.seed)?;
    let (store, mut cost) = DenseFormFactors::assemble(&*rows)?;
    // Both triangles of a pairwise estimator estimate the same numbers, so a method that needs symmetry may have it;
    // those of a row-wise one stay as they are.
    let pairwise = matches!(strategy.method, Method::Analytic { .. });
    let symmetric = pairwise && named(&strategy.solver)?.needs().symmetric;
    let (patches, spent) = aggregate_sources(&store, geometry.parent(), geometry.patches().len())?;
    cost += spent;
    let patches = if symmetric { patches.symmetrised() } else { patches };
    let phase = Phase { cost, time: clock.elapsed() };
    // Patch means of the elements' data.
    let areas = geometry.elements().areas();
    let elements = System::substructured(
        &store,
        Form::ElementsToPatches,
        &areas,
        geometry.parent(),
        geometry.emission().view(),
        geometry.reflectance().view(),
    )?;
    let (e, rho) = (elements.patch_means(elements.emission()), elements.patch_means(elements.reflectance()));
    let coarse = System::full(&patches, elements.patch_areas(), e.view(), rho.view())?;
    let mut solution = solve(&coarse, &mut *named(&strategy.solver)?, &stop_rule(strategy), observer)?;
    // One gather from the patches to the elements.
    let clock = Instant::now();
    let mut h = BandValues::zeros(elements.bands(), elements.elements());
    let spread = spread(&solution.radiosity, geometry.parent());
    solution.cost += elements.irradiance(Direction::Gather, spread.view(), h.view_mut())?;
    let b = elements.radiosity(h.view());
    solution.time += clock.elapsed();
    (solution.radiosity, solution.irradiance) = (b, h);
    let bytes = store.properties().stored_bytes + patches.properties().stored_bytes;
    let row_sums = Some(row_sums(&store, &areas)?);
    Ok((phase, bytes, row_sums, solution))
}

/// The value of its patch for every element.
pub(crate) fn spread(values: &BandValues, parent: &[u32]) -> BandValues {
    let all = (0..values.count()).flat_map(|b| parent.iter().map(move |&p| values.band(b)[p as usize]));
    BandValues::new(all.collect(), parent.len())
}

fn row_sums(store: &dyn FormFactors, areas: &[f64]) -> Result<RowSums, StoreError> {
    let ones = BandValues::single(vec![1.0; store.targets()]);
    let mut sums = BandValues::zeros(1, store.sources());
    store.gather(ones.view(), sums.view_mut())?;
    let total: f64 = sums.values().iter().sum();
    let relative = sums.values().iter().zip(areas).map(|(sum, area)| sum / area);
    let (smallest, largest) = relative.fold((f64::INFINITY, 0.0_f64), |(lo, hi), sum| (lo.min(sum), hi.max(sum)));
    Ok(RowSums { smallest, largest, mean: total / areas.iter().sum::<f64>() })
}
