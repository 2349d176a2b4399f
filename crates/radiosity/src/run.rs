//! Follows a strategy from geometry to a solution.

use std::time::{Duration, Instant};

use radiosity_core::{
    BandValues, Direction, Form, FormFactors, Observer, Solution, SolveError, StopRule, StoreError, System,
    SystemError, solve,
};
use radiosity_form_factors::Rows;
use radiosity_form_factors::checks::{BlockedPairs, Checks, check, check_blocked};
use radiosity_form_factors::hemicube::HemicubeError;
use radiosity_form_factors::repair::RepairError;
use radiosity_form_factors::stores::{DenseFormFactors, Held, aggregate_sources};
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::MeshError;

use crate::estimate::{Filled, fill};
use crate::hierarchical::{HierarchicalReport, solve_by_links};
use crate::{FittedRows, Geometry, Method, Phase, Repair, Shape, Store, Strategy, mend, mend_dense};

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
    /// The rows could not be repaired.
    #[error(transparent)]
    Repair(#[from] RepairError),
    /// The rows of patches carry no symmetry to scale.
    #[error("only form factors of the full form can be repaired, not those of the form {form}; leave out the patches")]
    RepairForm {
        /// Name of the form.
        form: &'static str,
    },
    /// The store holds nothing that could be scaled, or cannot take the mean of both directions.
    #[error("the {rows} form factors cannot be repaired in the {store} store; choose {instead}")]
    RepairStore {
        /// Name of the estimator.
        rows: &'static str,
        /// Name of the store.
        store: &'static str,
        /// Stores that will do.
        instead: &'static str,
    },
    /// Links cannot stand for these form factors.
    #[error(
        "links join elements of the full form by the analytic method, without repair; {rows} form factors need another store"
    )]
    Links {
        /// Name of the estimator.
        rows: &'static str,
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
    /// What checks of the store say, if it held its form factors.
    pub checked: Option<Checked>,
    /// The repair, if one was asked for.
    pub repair: Option<Repair>,
    /// What links came to, if the store held links.
    pub hierarchical: Option<HierarchicalReport>,
    /// The solution on the exposed elements.
    pub solution: Solution,
}

/// What checks of form factors say, as they were used: after a repair, if there was one.
#[derive(Clone, Debug, PartialEq)]
pub struct Checked {
    /// Closure, reciprocity, sign and size.
    pub checks: Checks,
    /// Whether rows should sum to 1: the edges of the scene match each other.
    pub closed: bool,
    /// Pairs of a pairwise estimator against what they would be if nothing blocked, before any repair; `None` where nothing blocks or
    /// the bounds of the entries are not known or statistical.
    pub blocked: Option<BlockedPairs>,
    /// Time taken, outside all phases.
    pub time: Duration,
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
        self.check_rows(matches!(self.method, Method::Analytic { .. }), self.method.name())
    }

    /// [`Self::check`] of rows of the name given, symmetric in the full form or not.
    pub(crate) fn check_rows(&self, symmetric: bool, rows: &'static str) -> Result<(), RunError> {
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
        if let Store::Hierarchical { .. } = self.store
            && !(rows == Method::ANALYTIC.name() && self.shape == Shape::Full && !self.repair)
        {
            return Err(RunError::Links { rows });
        }
        if self.repair {
            let instead = match (symmetric, self.store) {
                _ if self.shape != Shape::Full => return Err(RunError::RepairForm { form: self.shape.name() }),
                (true, Store::KeepAll | Store::KeepNone) => Some("dense, sparse or packed"),
                // The mean of both directions is taken of a whole matrix.
                (false, store) if store != Store::Dense => Some("dense"),
                _ => None,
            };
            return match instead {
                Some(instead) => Err(RunError::RepairStore { rows, store: self.store.name(), instead }),
                None => Ok(()),
            };
        }
        if needs.symmetric && !symmetric {
            return Err(SolveError::NeedsSymmetric { solver: name, store: self.store.name() }.into());
        }
        if self.store.needs_symmetric() && !(symmetric && self.shape == Shape::Full) {
            return Err(StoreError::NeedsSymmetric { store: self.store.name(), rows }.into());
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
    let made = match strategy.shape {
        _ if let Store::Hierarchical { error, direct } = strategy.store => {
            solve_by_links(&geometry, strategy, (error, direct), observer)
        }
        Shape::TwoLevel => two_level(&geometry, strategy, observer),
        shape => {
            let rows = crate::rows(&geometry, strategy.method, shape.form(), strategy.seed)?;
            let unblocked = match strategy.method {
                Method::Analytic { tolerance, .. } => Some(tolerance),
                _ => None,
            };
            direct_form(&geometry, rows, unblocked, strategy, observer)
        }
    }?;
    Ok(made.run(geometry, meshing))
}

/// Solves the scene of `geometry` on saved form factors, fitted to it by [`crate::SavedFormFactors::fit`]; store, solver, repair and
/// stopping as `strategy` says, in its full form. Its method is not used.
///
/// # Errors
///
/// [`RunError`] as [`run`].
pub fn run_saved<'a>(
    geometry: Geometry<'a>,
    saved: &FittedRows,
    strategy: &Strategy,
    observer: &mut dyn Observer,
) -> Result<Run<'a>, RunError> {
    strategy.check_rows(saved.symmetric(), saved.name())?;
    // Bounds as small as a tolerance are of no use to an unblocked value that is worse.
    let unblocked = (saved.symmetric() && saved.has_bounds()).then_some(1e-10);
    let made = direct_form(&geometry, Box::new(saved), unblocked, strategy, observer)?;
    Ok(made.run(geometry, Phase::default()))
}

/// What solving gives beside the geometry.
pub(crate) struct Made {
    form_factors: Phase,
    stored_bytes: u64,
    checked: Option<Checked>,
    repair: Option<Repair>,
    hierarchical: Option<HierarchicalReport>,
    solution: Solution,
}

impl Made {
    /// What links give: their entries are no estimates that checks of rows could judge.
    pub(crate) fn of_links(
        form_factors: Phase,
        stored_bytes: u64,
        links: HierarchicalReport,
        solution: Solution,
    ) -> Self {
        Self { form_factors, stored_bytes, checked: None, repair: None, hierarchical: Some(links), solution }
    }

    fn run(self, geometry: Geometry<'_>, meshing: Phase) -> Run<'_> {
        let Self { form_factors, stored_bytes, checked, repair, hierarchical, solution } = self;
        Run { geometry, meshing, form_factors, stored_bytes, checked, repair, hierarchical, solution }
    }
}

pub(crate) fn stop_rule(strategy: &Strategy) -> StopRule {
    let rule = StopRule::unshot(strategy.unshot).steps(strategy.steps);
    if strategy.verify { rule } else { rule.unverified() }
}

/// Fills a store with `rows`, repairs it if that is asked for, and solves; `unblocked` is the tolerance of unblocked values to compare with.
fn direct_form<'r>(
    geometry: &Geometry<'_>,
    rows: Box<dyn Rows + 'r>,
    unblocked: Option<f64>,
    strategy: &Strategy,
    observer: &mut dyn Observer,
) -> Result<Made, RunError> {
    let (form, closed) = (strategy.shape.form(), geometry.scene().closed());
    let areas = if form == Form::PatchesToElements { geometry.patches() } else { geometry.elements() }.areas();
    if strategy.repair && !closed {
        return Err(RepairError::Open.into());
    }
    let clock = Instant::now();
    let mut repair = None;
    let ((mut store, cost), time) = if strategy.repair && !rows.symmetric() {
        let (store, cost) = DenseFormFactors::assemble(&*rows)?;
        let time = clock.elapsed();
        let (store, mended) = mend_dense(store, &areas, closed)?;
        repair = Some(mended);
        ((Filled::Held(Box::new(store)), cost), time)
    } else {
        (fill(rows, strategy.store)?, clock.elapsed())
    };
    let form_factors = Phase { cost, time };
    let clock = Instant::now();
    let blocked = match (&store, unblocked) {
        (Filled::Held(store), Some(tolerance)) if form == Form::Full && strategy.verify => {
            blocked_pairs(&**store, geometry, tolerance)?
        }
        _ => None,
    };
    let checking = clock.elapsed();
    if let (true, None, Filled::Held(store)) = (strategy.repair, &repair, &mut store) {
        repair = Some(mend(&mut **store, &areas, closed)?);
    }
    let solution = solve_on(geometry, store.store(), form, &strategy.solver, &stop_rule(strategy), observer)?;
    let stored_bytes = store.store().properties().stored_bytes;
    let checked = if stored_bytes > 0 && strategy.verify {
        let mut checked = checked(geometry, store.store(), form, closed)?;
        checked.time += checking;
        Some(Checked { blocked, ..checked })
    } else {
        None
    };
    Ok(Made { form_factors, stored_bytes, checked, repair, hierarchical: None, solution })
}

/// Checks a store between the elements or patches that `form` says.
fn checked(geometry: &Geometry<'_>, store: &dyn FormFactors, form: Form, closed: bool) -> Result<Checked, StoreError> {
    let clock = Instant::now();
    let (elements, patches) = (geometry.elements().areas(), geometry.patches().areas());
    let (sources, targets) = match form {
        Form::Full => (&elements, &elements),
        Form::ElementsToPatches => (&elements, &patches),
        Form::PatchesToElements => (&patches, &elements),
    };
    let checks = check(store, sources, targets, closed)?;
    Ok(Checked { checks, closed, blocked: None, time: clock.elapsed() })
}

/// Pairs of the full form against their unblocked values; `None` where nothing blocks.
fn blocked_pairs(
    store: &dyn Held,
    geometry: &Geometry<'_>,
    tolerance: f64,
) -> Result<Option<BlockedPairs>, StoreError> {
    if geometry.blockers().is_empty() {
        return Ok(None);
    }
    let bound = |s: usize| store.bound(s).unwrap_or(f64::INFINITY);
    check_blocked(store, geometry.elements(), &bound, tolerance).map(Some)
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

pub(crate) fn named(solver: &str) -> Result<Box<dyn radiosity_core::Solver>, RunError> {
    radiosity_solvers::by_name(solver)
        .ok_or_else(|| RunError::Solver { name: solver.to_owned(), known: radiosity_solvers::NAMES.join(", ") })
}

/// Form factors from elements to patches only, area-weighted to the parents; the n × n system solved; one gather.
fn two_level(geometry: &Geometry<'_>, strategy: &Strategy, observer: &mut dyn Observer) -> Result<Made, RunError> {
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
    let form_factors = Phase { cost, time: clock.elapsed() };
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
    let stored_bytes = store.properties().stored_bytes + patches.properties().stored_bytes;
    let closed = geometry.scene().closed();
    let checked =
        if strategy.verify { Some(checked(geometry, &store, Form::ElementsToPatches, closed)?) } else { None };
    Ok(Made { form_factors, stored_bytes, checked, repair: None, hierarchical: None, solution })
}

/// The value of its patch for every element.
pub(crate) fn spread(values: &BandValues, parent: &[u32]) -> BandValues {
    let all = (0..values.count()).flat_map(|b| parent.iter().map(move |&p| values.band(b)[p as usize]));
    BandValues::new(all.collect(), parent.len())
}
