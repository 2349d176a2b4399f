//! The procedures to choose among: each refines until its own estimate of the error meets a tolerance.
//!
//! | name | refines | estimator | form, store, solver |
//! |---|---|---|---|
//! | pairs, adaptive | where the error is, from K × K patches a face | exact pairs | elements → patches, dense, `gauss-seidel` |
//! | pairs, adaptive, few patches | the same from K/2 × K/2 | | |
//! | rays, adaptive | from K × K patches | 256 rays a row and exact emitters | elements → patches, dense, `gauss-seidel` |
//! | rays, adaptive, few patches | from K/2 × K/2 | | |
//! | rays, adaptive, many patches | from 2K × 2K | | |
//! | many rays, adaptive | from K × K patches | 1,024 rays a row | |
//! | pairs, uniform | everywhere, 2, 4, 8, … elements along an edge | exact pairs | full, dense, `cg` |
//! | packed pairs, uniform | | | full, packed-f32, `cg` |
//! | rays, uniform | | 256 rays a row | full, sparse, `gauss-seidel` |
//! | many rays, uniform | | 1,024 rays a row | full, sparse, `gauss-seidel` |
//! | links, uniform | | pairs of nodes, erring by 0.3 of the tolerance | full, hierarchical, `cg` |
//!
//! K is the number of report cells along an edge. What is *not* here: hemicubes, whose error of centres stays at 1 to 2 % of irradiance however fine they are;
//! solvers of the same system that differ by less than the form factors take; and solvers that sample, whose time grows like the inverse square of an error that
//! must lie far below the tolerance.

use radiosity_core::Cost;
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::Subdivision;

use crate::adaptive::run_adaptive_while;
use crate::tolerance::run_to_tolerance_while;
use crate::{Adaptive, DirectLight, Goal, Method, Round, Run, RunError, Shape, Store, Strategy, ToleranceStep};

/// Form factors nobody sees the error of at a tolerance of a percent.
const PAIRS: (f64, f64) = (1e-6, 1e-4);
/// Segments of a partly blocked pair among many blockers.
const SEGMENTS: u32 = 64;
/// Rays of a row, few and many.
pub(super) const FEW_RAYS: u32 = 256;
const MANY_RAYS: u32 = 1024;
/// Unshot share at which solvers stop, in units of the tolerance.
const UNSHOT: f64 = 0.01;
/// Error of links, in units of the tolerance; the rest of that is for the difference of two meshes.
const LINKS: f64 = 0.3;

/// How a procedure comes to its tolerance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refine {
    /// Everywhere: 2, 4, 8, … elements along an edge, until two answers agree.
    Uniform,
    /// Where the error is, beginning with so many patches along an edge.
    Adaptive {
        /// Patches along an edge.
        cells: u32,
    },
}

/// What a procedure is to reach, and with which limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// rms error of irradiance over the report grid, relative to its mean.
    pub tolerance: f64,
    /// Cells of the report grid along an edge of a face.
    pub report_grid: u32,
    /// Elements beyond which nothing is refined.
    pub most_elements: usize,
}

/// A procedure to a tolerance.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Its name in tables.
    pub name: &'static str,
    /// Estimator, store, form and solver; its mesh is set by the refinement.
    pub strategy: Strategy,
    /// How it refines.
    pub refine: Refine,
}

/// What was asked for by name: candidates must agree with it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Named {
    /// The estimator with its settings.
    pub method: Option<Method>,
    /// The store; of links what light they carry, their error being [`Self::link_error`].
    pub store: Option<Store>,
    /// Error of links; the share of the tolerance that candidates leave to them if not given.
    pub link_error: Option<f64>,
    /// The solver.
    pub solver: Option<String>,
}

/// The meshes on the way.
#[derive(Clone, Debug, PartialEq)]
pub enum Steps {
    /// Of an adaptive run.
    Adaptive(Vec<Round>),
    /// Of uniform ones.
    Uniform(Vec<ToleranceStep>),
}

impl Steps {
    /// The last estimate of the error; NaN if there was none yet.
    pub fn estimate(&self) -> f64 {
        match self {
            Self::Adaptive(rounds) => rounds.last().map_or(f64::NAN, |round| round.estimate.total()),
            Self::Uniform(steps) => steps.last().and_then(ToleranceStep::estimate).unwrap_or(f64::NAN),
        }
    }

    /// Counts of all meshes.
    fn cost(&self, run: &Run<'_>) -> Cost {
        match self {
            Self::Adaptive(_) => run.cost(),
            Self::Uniform(steps) => steps.iter().map(|step| step.cost).sum(),
        }
    }
}

/// What a procedure came to.
pub struct Reached<'a> {
    /// The last run.
    pub run: Run<'a>,
    /// The strategy as it was followed in the end.
    pub strategy: Strategy,
    /// Every mesh, coarsest first.
    pub steps: Steps,
    /// Counts of all meshes.
    pub cost: Cost,
    /// Whether the last estimate met the tolerance.
    pub met: bool,
}

impl Candidate {
    /// Follows the procedure; it goes on to another mesh while `go_on` says so.
    ///
    /// # Errors
    ///
    /// [`RunError`] as [`crate::run`] and [`crate::run_adaptive`].
    pub fn run<'a>(
        &self,
        scene: &'a Scene,
        target: &Target,
        go_on: &mut dyn FnMut() -> bool,
    ) -> Result<Reached<'a>, RunError> {
        let Target { tolerance, report_grid, most_elements } = *target;
        let (run, method, steps, met) = match self.refine {
            Refine::Uniform => {
                let go_on = &mut |_: &[ToleranceStep]| go_on();
                let done = run_to_tolerance_while(scene, &self.strategy, tolerance, report_grid, most_elements, go_on)?;
                (done.run, self.strategy.method, Steps::Uniform(done.steps), done.met)
            }
            Refine::Adaptive { cells } => {
                let adaptive = Adaptive { most_elements, ..Adaptive::new(Goal::Cells(report_grid), tolerance) };
                let adaptive = adaptive.from_cells(cells);
                let done = run_adaptive_while(scene, &self.strategy, &adaptive, &mut |_| go_on())?;
                (done.run, done.method, Steps::Adaptive(done.rounds), done.met)
            }
        };
        let strategy = Strategy { method, ..self.strategy.clone() };
        let cost = steps.cost(&run);
        Ok(Reached { run, strategy, steps, cost, met })
    }

    /// The candidate as what was named by the user makes it, or `None` if it does not agree.
    fn agreeing(mut self, named: &Named) -> Option<Self> {
        if let Some(method) = named.method {
            if method.name() != self.strategy.method.name() {
                return None;
            }
            self.strategy.method = method;
        }
        if let Some(store) = named.store {
            self.strategy.store = match (store, self.strategy.store) {
                (Store::Hierarchical { direct, .. }, Store::Hierarchical { error, .. }) => {
                    Store::Hierarchical { error, direct }
                }
                (Store::Hierarchical { .. }, _) | (_, Store::Hierarchical { .. }) => return None,
                // Rows that meshes change under are kept in a store of their own, which is dense.
                (store, own) if store != own && self.refine != Refine::Uniform => return None,
                (store, _) => store,
            };
        }
        if let (Some(asked), Store::Hierarchical { error, .. }) = (named.link_error, &mut self.strategy.store) {
            *error = asked;
        }
        if let Some(solver) = &named.solver {
            self.strategy.solver.clone_from(solver);
        }
        (!self.strategy.samples() && self.strategy.check().is_ok()).then_some(self)
    }
}

/// The estimator of pairs among `blocking` polygons that may block.
pub(super) fn pairs_among(blocking: usize) -> Method {
    match Method::analytic_among(blocking) {
        Method::ANALYTIC => Method::exact(PAIRS.0, PAIRS.1),
        _ => Method::sampled(PAIRS.0, SEGMENTS),
    }
}

/// The candidates for a target among `blocking` polygons that may block, those alone that agree with what is named.
pub(super) fn candidates(
    target: &Target,
    blocking: usize,
    (seed, memory): (u64, Option<u64>),
    named: &Named,
) -> Vec<Candidate> {
    let tolerance = target.tolerance;
    let pairs = pairs_among(blocking);
    let [few, many] = [FEW_RAYS, MANY_RAYS].map(|rays| Method::RaysAndEmitters { rays });
    let links = Store::Hierarchical { error: LINKS * tolerance, direct: DirectLight::WhereFew };
    let plain = |method| {
        let strategy = Strategy::new(Subdivision::Uniform(2), method);
        Strategy { unshot: UNSHOT * tolerance, seed, memory, ..strategy }
    };
    let adaptive = |name, method, cells: u32| {
        let (shape, solver) = (Shape::ElementsToPatches, "gauss-seidel".to_owned());
        let strategy = Strategy { shape, solver, ..plain(method) };
        Candidate { name, strategy, refine: Refine::Adaptive { cells } }
    };
    let uniform = |name, method, store| Candidate {
        name,
        strategy: Strategy { store, ..plain(method) },
        refine: Refine::Uniform,
    };
    let k = target.report_grid;
    let all = [
        adaptive("pairs, adaptive", pairs, k),
        adaptive("pairs, adaptive, few patches", pairs, (k / 2).max(1)),
        adaptive("rays, adaptive", few, k),
        adaptive("rays, adaptive, few patches", few, (k / 2).max(1)),
        adaptive("rays, adaptive, many patches", few, k.saturating_mul(2)),
        adaptive("many rays, adaptive", many, k),
        uniform("pairs, uniform", pairs, Store::Dense),
        uniform("packed pairs, uniform", pairs, Store::PackedSingle),
        uniform("rays, uniform", few, Store::Sparse),
        uniform("many rays, uniform", many, Store::Sparse),
        uniform("links, uniform", Method::of_links_among(blocking), links),
    ];
    let mut found: Vec<Candidate> = Vec::new();
    for candidate in all.into_iter().filter_map(|candidate| candidate.agreeing(named)) {
        // What is named may make two the same.
        let same = |other: &Candidate| other.strategy == candidate.strategy && other.refine == candidate.refine;
        if !found.iter().any(same) {
            found.push(candidate);
        }
    }
    found
}
