//! Follows a strategy from geometry to a solution.

use std::time::{Duration, Instant};

use radiosity_core::{
    BandValues, Bands, Cost, Direction, Forecast, Form, FormFactors, Observer, Solution, SolveError, Solver, StopRule,
    StoreError, System, SystemError, solve_from,
};
use radiosity_form_factors::Rows;
use radiosity_form_factors::checks::{BlockedPairs, Checks, check_beside, check_blocked};
use radiosity_form_factors::extended::ImagesError;
use radiosity_form_factors::hemicube::HemicubeError;
use radiosity_form_factors::repair::RepairError;
use radiosity_form_factors::stores::{DenseFormFactors, Held, aggregate_sources};
use radiosity_geometry::mesh::MeshError;
use radiosity_geometry::{CompareError, Scene};
use radiosity_render::Camera;
use radiosity_solvers::{NAMES, STOCHASTIC, seeded};

use crate::asked::Asked;
use crate::bounces::solve_until;
use crate::bounded::{Bounded, Missed};
use crate::estimate::{Filled, fill};
use crate::hierarchical::{HierarchicalReport, solve_by_links};
use crate::plan::{Omissions, Plan, Savings, follow};
use crate::predict::{Alternative, Bytes, admit};
use crate::thin::{self, Thinned, fill_thinned};
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
    /// Two scenes that cannot be compared.
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// A store from which nothing could be taken over.
    #[error(
        "solving again after a change takes form factors that are held, and the store {store} computes them when asked; choose dense, sparse or a packed one"
    )]
    NothingHeld {
        /// Name of the store.
        store: &'static str,
    },
    /// The run would take more memory than it may.
    #[error("this takes about {} of memory, and there are {}{}", Bytes(*.needed), Bytes(*.limit), instead(.alternative.as_deref()))]
    Memory {
        /// Bytes predicted.
        needed: u64,
        /// Bytes allowed.
        limit: u64,
        /// What fits, if anything does.
        alternative: Option<Box<Alternative>>,
    },
    /// Links cannot stand for these form factors.
    #[error(
        "links join elements of the full form by the analytic method, without repair; {rows} form factors need another store"
    )]
    Links {
        /// Name of the estimator.
        rows: &'static str,
    },
    /// Extended form factors of a form or in a store that does not take them.
    #[error(
        "specular bounces need the full form or patches, in a store of rows; not the form {shape} in the store {store}"
    )]
    Extended {
        /// Name of the form.
        shape: &'static str,
        /// Name of the store.
        store: &'static str,
    },
    /// Specular surfaces show no images.
    #[error(transparent)]
    Images(#[from] ImagesError),
    /// Rows that count arrivals by way of specular surfaces do not sum to 1.
    #[error("form factors with specular bounces are not repaired: their rows need not sum to 1; leave out the repair")]
    RepairExtended,
    /// Pairs that are not dropped one by one.
    #[error(
        "small pairs are left out of form factors of the analytic method in the full form that are held and used once; these are {what}: {instead}"
    )]
    Thin {
        /// What stands in the way.
        what: &'static str,
        /// What to do.
        instead: &'static str,
    },
    /// An asked error that cannot be asked.
    #[error("the tolerance is {value}; it must lie in (0, 1)")]
    Tolerance {
        /// The value given.
        value: f64,
    },
}

fn instead(alternative: Option<&Alternative>) -> String {
    let Some(Alternative { change, prediction, .. }) = alternative else { return String::new() };
    format!("; with {change} it takes about {}", Bytes(prediction.peak_bytes))
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
    /// What was forecast of the solution, if that was asked for.
    pub forecast: Option<Forecasted>,
    /// What links came to, if the store held links.
    pub hierarchical: Option<HierarchicalReport>,
    /// What the scene does not need and was left out.
    pub left_out: Savings,
    /// What the error asked for does not need and was left out.
    pub bounded: Vec<Bounded>,
    /// The solution on the exposed elements.
    pub solution: Solution,
}

/// A forecast and what it took, outside all phases.
#[derive(Clone, Debug, PartialEq)]
pub struct Forecasted {
    /// The forecast, of the system that the solver is given: in the two-level shape that of the patches.
    pub forecast: Forecast,
    /// Counts; on-demand stores compute rows for it.
    pub cost: Cost,
    /// Time.
    pub time: Duration,
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

impl Checked {
    /// What was found in a system of selected rows and columns, by their numbers among all.
    pub(crate) fn renamed(self, [sources, targets]: [&[u32]; 2]) -> Self {
        let (row, column) = (|s: usize| sources[s] as usize, |t: usize| targets[t] as usize);
        let of_row = |(s, value): (usize, f64)| (row(s), value);
        let of_pair = |(s, t, value): (usize, usize, f64)| (row(s), column(t), value);
        let found = self.checks;
        let checks = Checks {
            worst_rows: found.worst_rows.into_iter().map(of_row).collect(),
            closure: found.closure.map(of_row),
            largest_row_sum: found.largest_row_sum.map(of_row),
            reciprocity: found.reciprocity.map(of_pair),
            largest_share: found.largest_share.map(of_pair),
            ..found
        };
        let pairs = |pairs: BlockedPairs| BlockedPairs { largest_excess: pairs.largest_excess.map(of_pair), ..pairs };
        Self { checks, blocked: self.blocked.map(pairs), ..self }
    }
}

impl Run<'_> {
    /// Time of all phases, in seconds.
    pub fn seconds(&self) -> f64 {
        (self.meshing.time + self.form_factors.time + self.solution.time).as_secs_f64()
    }

    /// Bound of the rms change of irradiance by all bounded omissions, relative to its mean level, over what is asked for; `None` if one has no bound.
    pub fn bounded_error(&self) -> Option<f64> {
        self.bounded.iter().try_fold(0.0, |sum, omission| Some(sum + omission.bound?))
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
    /// [`RunError`] if there is no such solver, it does not read the form, it or the store needs symmetric form factors
    /// and the method gives none, or an error that may be left out is not in (0, 1).
    pub fn check(&self) -> Result<(), RunError> {
        self.check_rows(matches!(self.method, Method::Analytic { .. }), self.method.name())
    }

    /// [`Self::check`] of rows of the name given, symmetric in the full form or not.
    pub(crate) fn check_rows(&self, symmetric: bool, rows: &'static str) -> Result<(), RunError> {
        let solver = named(&self.solver, self.seed)?;
        let (name, needs) = (solver.name(), solver.needs());
        [self.thin, self.bounces].into_iter().flatten().try_for_each(allowed)?;
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
    admit(scene, strategy)?;
    let clock = Instant::now();
    let plan = Plan::new(scene, strategy);
    let geometry = plan.mesh(scene, strategy)?;
    let meshing = Phase { time: clock.elapsed(), ..Phase::default() };
    run_planned(&plan, geometry, meshing, strategy, observer)
}

/// [`run`] by a plan that is there already, on the mesh that it made in a phase of its own.
///
/// # Errors
///
/// [`RunError`] as [`run`].
pub fn run_planned<'a>(
    plan: &Plan,
    geometry: Geometry<'a>,
    meshing: Phase,
    strategy: &Strategy,
    observer: &mut dyn Observer,
) -> Result<Run<'a>, RunError> {
    strategy.check()?;
    if plan.may_omit() {
        return thin::held(strategy, geometry, |strategy, geometry| {
            follow(plan, geometry, meshing, strategy, observer)
        });
    }
    run_meshed(geometry, meshing, strategy, observer)
}

/// [`run`] on a mesh that is there already, made as `strategy` says in a phase of its own; nothing is left out.
///
/// # Errors
///
/// [`RunError`] as [`run`].
pub fn run_meshed<'a>(
    geometry: Geometry<'a>,
    meshing: Phase,
    strategy: &Strategy,
    observer: &mut dyn Observer,
) -> Result<Run<'a>, RunError> {
    strategy.check()?;
    if let Store::Hierarchical { error, direct } = strategy.store {
        let made = solve_by_links(&geometry, strategy, (error, direct), observer)?;
        return Ok(made.run(geometry, meshing));
    }
    thin::held(strategy, geometry, |strategy, geometry| {
        let rows = crate::rows(&geometry, strategy.method, strategy.shape.form(), strategy.seed)?;
        let (store, known) = fill_thinned(&geometry, rows, unblocked(strategy.method), strategy)?;
        let made = solve_stored(&geometry, store.store(), known, strategy, None, observer)?;
        drop(store);
        Ok(made.run(geometry, meshing))
    })
}

/// Forecasts a run of `strategy` without making it: computes its form factors, of what its plan keeps, and solves nothing. At least one product is spent; the phase is
/// that of the form factors. Where nothing is to be solved the forecast is of all elements.
///
/// # Errors
///
/// [`RunError`] as [`run`].
pub fn forecast(scene: &Scene, strategy: &Strategy) -> Result<(Forecasted, Phase), RunError> {
    let forecast = strategy.forecast.max(1);
    let asked = Strategy { forecast, steps: 0, verify: false, ..strategy.clone() };
    let mut run = self::run(scene, &asked, &mut ())?;
    if run.forecast.is_none() {
        run = self::run(scene, &Strategy { omit: Omissions::NONE, ..asked }, &mut ())?;
    }
    Ok((run.forecast.expect("a forecast was asked for"), run.form_factors))
}

/// The tolerance of unblocked values that those of a method can be compared with.
pub(crate) fn unblocked(method: Method) -> Option<f64> {
    match method {
        Method::Analytic { tolerance, .. } => Some(tolerance),
        _ => None,
    }
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
    let (store, known) = fill_checked(&geometry, Box::new(saved), unblocked, strategy)?;
    let made = solve_stored(&geometry, store.store(), known, strategy, None, observer)?;
    drop(store);
    Ok(made.run(geometry, Phase::default()))
}

/// What solving gives beside the geometry.
pub(crate) struct Made {
    pub(crate) form_factors: Phase,
    pub(crate) stored_bytes: u64,
    pub(crate) checked: Option<Checked>,
    repair: Option<Repair>,
    forecast: Option<Forecasted>,
    hierarchical: Option<HierarchicalReport>,
    pub(crate) left_out: Savings,
    pub(crate) missed: Vec<Missed>,
    /// What error bounds are to be of, if not of everything.
    asked: (Option<Vec<u32>>, Option<Camera>),
    pub(crate) solution: Solution,
}

impl Made {
    pub(crate) fn radiosity(&self) -> &BandValues {
        &self.solution.radiosity
    }

    pub(crate) fn steps(&self) -> u64 {
        self.solution.steps
    }

    /// A solution for which no form factor was needed.
    pub(crate) fn of_solution(solution: Solution) -> Self {
        Self {
            form_factors: Phase::default(),
            stored_bytes: 0,
            checked: None,
            repair: None,
            forecast: None,
            hierarchical: None,
            left_out: Savings::default(),
            missed: Vec::new(),
            asked: (None, None),
            solution,
        }
    }

    /// What links give: their entries are no estimates that checks of rows could judge.
    pub(crate) fn of_links(
        form_factors: Phase,
        stored_bytes: u64,
        links: HierarchicalReport,
        solution: Solution,
    ) -> Self {
        Self { form_factors, stored_bytes, hierarchical: Some(links), ..Self::of_solution(solution) }
    }

    pub(crate) fn run(self, geometry: Geometry<'_>, meshing: Phase) -> Run<'_> {
        let h = &self.solution.irradiance;
        let named = (self.asked.0.as_deref(), self.asked.1.as_ref());
        let relative = |missed: Missed| missed.relative_to(&geometry, named, h);
        let bounded = self.missed.into_iter().map(relative).collect();
        Run {
            geometry,
            meshing,
            form_factors: self.form_factors,
            stored_bytes: self.stored_bytes,
            checked: self.checked,
            repair: self.repair,
            forecast: self.forecast,
            hierarchical: self.hierarchical,
            left_out: self.left_out,
            bounded,
            solution: self.solution,
        }
    }
}

/// Whether an error can be asked for.
pub(crate) fn allowed(error: f64) -> Result<(), RunError> {
    if error > 0.0 && error < 1.0 { Ok(()) } else { Err(RunError::Tolerance { value: error }) }
}

pub(crate) fn stop_rule(strategy: &Strategy) -> StopRule {
    let rule = StopRule::unshot(strategy.unshot).steps(strategy.steps);
    if strategy.verify { rule } else { rule.unverified() }
}

/// What is known of a store before anything is solved on it.
#[derive(Clone, Debug)]
pub(crate) struct Known {
    pub form_factors: Phase,
    pub repair: Option<Repair>,
    pub checks: Check,
    pub thinned: Vec<Thinned>,
}

/// What checks of a store are to say.
#[derive(Clone, Debug)]
pub(crate) enum Check {
    /// What they find; blocked pairs were compared, in this time, before any repair.
    Find(Option<BlockedPairs>, Duration),
    /// What they found before, of the same store.
    Known(Option<Box<Checked>>),
}

/// Fills a store with `rows` and repairs it if that is asked for; `unblocked` is the tolerance of unblocked values to compare with.
pub(crate) fn fill_checked<'r>(
    geometry: &Geometry<'_>,
    rows: Box<dyn Rows + 'r>,
    unblocked: Option<f64>,
    strategy: &Strategy,
) -> Result<(Filled<'r>, Known), RunError> {
    let (form, closed) = (strategy.shape.form(), geometry.closed());
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
        // Rows that are summed to those of patches are all read.
        let kind = if strategy.shape == Shape::TwoLevel { Store::Dense } else { strategy.store };
        (fill(rows, kind, strategy.memory)?, clock.elapsed())
    };
    let form_factors = Phase { cost, time };
    let clock = Instant::now();
    let blocked = match (&store, unblocked) {
        (Filled::Held(store), Some(tolerance)) if form == Form::Full && strategy.verify => {
            blocked_pairs(&**store, geometry, tolerance)?
        }
        _ => None,
    };
    let checks = Check::Find(blocked, clock.elapsed());
    if let (true, None, Filled::Held(store)) = (strategy.repair, &repair, &mut store) {
        repair = Some(mend(&mut **store, &areas, closed)?);
    }
    Ok((store, Known { form_factors, repair, checks, thinned: Vec::new() }))
}

/// Solves on a store in the shape of `strategy`, from radiosities of a similar scene if they are given, and checks it.
pub(crate) fn solve_stored(
    geometry: &Geometry<'_>,
    store: &dyn FormFactors,
    known: Known,
    strategy: &Strategy,
    from: Option<Bands<'_>>,
    observer: &mut dyn Observer,
) -> Result<Made, RunError> {
    let Known { mut form_factors, repair, checks, thinned } = known;
    let mut missed = Vec::new();
    let form = strategy.shape.form();
    let (forecast, solution, patch_bytes) = match strategy.shape {
        Shape::TwoLevel => {
            let Coarse { forecast, solution, aggregation, patch_bytes } =
                two_level(geometry, store, strategy, from, observer)?;
            form_factors.cost += aggregation.cost;
            form_factors.time += aggregation.time;
            (forecast, solution, patch_bytes)
        }
        _ => with_system(geometry, store, form, |system| {
            let forecast = foresee(system, strategy)?;
            let asked = Asked::of(geometry, strategy.named());
            let (mut solution, unfollowed) = solve_until(system, &asked, strategy, observer, from)?;
            let (dropped, cost) = thin::missed(system, &thinned, &solution.radiosity, strategy)?;
            solution.verification += cost;
            missed.extend(dropped.into_iter().chain(unfollowed));
            Ok((forecast, solution, 0))
        })?,
    };
    let held = store.properties().stored_bytes;
    let checked = match checks {
        Check::Known(checked) => checked.map(|checked| *checked),
        Check::Find(blocked, time) if held > 0 && strategy.verify => {
            let mut checked = checked(geometry, store, form, geometry.closed())?;
            checked.time += time;
            Some(Checked { blocked, ..checked })
        }
        Check::Find(..) => None,
    };
    let stored_bytes = held + patch_bytes;
    let asked = (strategy.asked.clone(), strategy.view.clone());
    Ok(Made { form_factors, stored_bytes, checked, repair, forecast, missed, asked, ..Made::of_solution(solution) })
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
    let beside = geometry.given().map_or(&[][..], |given| &given.exchange);
    let checks = check_beside(store, sources, targets, closed, beside)?;
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
    with_system(geometry, store, form, |system| Ok(solve_from(system, &mut *named(solver, 1)?, stop, observer, None)?))
}

/// Calls `with` with the system that `store` makes of `geometry` in `form`.
fn with_system<T>(
    geometry: &Geometry<'_>,
    store: &dyn FormFactors,
    form: Form,
    with: impl FnOnce(&System<'_>) -> Result<T, RunError>,
) -> Result<T, RunError> {
    let (emission, reflectance) = (geometry.emission(), geometry.reflectance());
    let areas = geometry.elements().areas();
    with(&System::substructured(store, form, &areas, geometry.parent(), emission.view(), reflectance.view())?)
}

/// The forecast of a system that `strategy` asks for, in the direction of its solver.
fn foresee(system: &System<'_>, strategy: &Strategy) -> Result<Option<Forecasted>, RunError> {
    if strategy.forecast == 0 {
        return Ok(None);
    }
    let clock = Instant::now();
    let direction = named(&strategy.solver, strategy.seed)?.needs().direction;
    let (forecast, cost) = Forecast::new(system, direction, strategy.forecast)?;
    Ok(Some(Forecasted { forecast, cost, time: clock.elapsed() }))
}

pub(crate) fn named(solver: &str, seed: u64) -> Result<Box<dyn Solver>, RunError> {
    let known = || format!("{}, {STOCHASTIC}", NAMES.join(", "));
    seeded(solver, seed).ok_or_else(|| RunError::Solver { name: solver.to_owned(), known: known() })
}

/// The solution of the two-level form, and what its n × n matrix took.
struct Coarse {
    forecast: Option<Forecasted>,
    solution: Solution,
    aggregation: Phase,
    patch_bytes: u64,
}

/// Form factors from elements to patches, area-weighted to the parents; the n × n system solved; one gather.
fn two_level(
    geometry: &Geometry<'_>,
    store: &dyn FormFactors,
    strategy: &Strategy,
    from: Option<Bands<'_>>,
    observer: &mut dyn Observer,
) -> Result<Coarse, RunError> {
    let clock = Instant::now();
    // Both triangles of a pairwise estimator estimate the same numbers, so a method that needs symmetry may have it;
    // those of a row-wise one stay as they are.
    let pairwise = matches!(strategy.method, Method::Analytic { .. });
    let symmetric = pairwise && named(&strategy.solver, strategy.seed)?.needs().symmetric;
    let (patches, cost) = aggregate_sources(store, geometry.parent(), geometry.patches().len())?;
    let patches = if symmetric { patches.symmetrised() } else { patches };
    let aggregation = Phase { cost, time: clock.elapsed() };
    // Patch means of the elements' data.
    let areas = geometry.elements().areas();
    let (e, rho) = (geometry.emission(), geometry.reflectance());
    let elements =
        System::substructured(store, Form::ElementsToPatches, &areas, geometry.parent(), e.view(), rho.view())?;
    let (e, rho) = (elements.patch_means(elements.emission()), elements.patch_means(elements.reflectance()));
    let coarse = System::full(&patches, elements.patch_areas(), e.view(), rho.view())?;
    let forecast = foresee(&coarse, strategy)?;
    let from = from.map(|from| elements.patch_means(from));
    let from = from.as_ref().map(BandValues::view);
    let solver = &mut *named(&strategy.solver, strategy.seed)?;
    let mut solution = solve_from(&coarse, solver, &stop_rule(strategy), observer, from)?;
    // One gather from the patches to the elements.
    let clock = Instant::now();
    let mut h = BandValues::zeros(elements.bands(), elements.elements());
    let spread = spread(&solution.radiosity, geometry.parent());
    solution.cost += elements.irradiance(Direction::Gather, spread.view(), h.view_mut())?;
    let b = elements.radiosity(h.view());
    solution.time += clock.elapsed();
    (solution.radiosity, solution.irradiance) = (b, h);
    Ok(Coarse { forecast, solution, aggregation, patch_bytes: patches.properties().stored_bytes })
}

/// The value of its patch for every element.
pub(crate) fn spread(values: &BandValues, parent: &[u32]) -> BandValues {
    let all = (0..values.count()).flat_map(|b| parent.iter().map(move |&p| values.band(b)[p as usize]));
    BandValues::new(all.collect(), parent.len())
}
