//! Adaptive substructuring: solve, estimate the error, refine where it is, and start from the old answer.
//!
//! ```text
//! mesh ─► new rows ─► solve from the old B ─► estimate ─► met? ─► done
//!   ▲                                              │
//!   └── elements and patches that carry the error ◄┘
//! ```
//!
//! Elements gather from patches (M. F. Cohen, D. P. Greenberg, D. S. Immel and P. J. Brock, "An efficient radiosity approach for realistic
//! image synthesis", IEEE CG&A 6(3), 1986). Cells, cut at contacts, are the first patches and the roots of quadtrees; elements are
//! leaves. An element that is cut
//! gives way to four with rows of their own; every other row stays, so a round computes as many rows as it has new elements. A
//! patch is cut where it is too large for those it lights: of a pairwise estimator the columns of its parts are new work, of a row-wise one the
//! rows that see it are computed again, with the same rays. Both are counted ([`Round`]).
//!
//! Where only some surfaces are asked for ([`Strategy::asked`]) or a view of them ([`Strategy::view`]), the error is that of theirs or of the picture, and what other
//! elements err by counts by its importance to them ([`Importance`]): elsewhere the mesh stays as coarse as light needs.
//!
//! The error is estimated in parts, see [`ErrorEstimate`]. What is *not* here: uniform refinement ([`crate::run_to_tolerance`]), and links between
//! levels.

mod edges;
mod gaps;
mod marks;
mod measure;
mod receivers;
mod sender_errors;
mod shadows;
mod variation;

use std::time::{Duration, Instant};

use radiosity_core::{BandValues, Cost, Solution, StopRule, StoreError, System, solve_from};
use radiosity_form_factors::stores::{MovableFormFactors, Source};
use radiosity_form_factors::{Receivers, Rows};
use radiosity_geometry::mesh::{MAX_LEVEL, Mesh, MeshSettings, Origin, Subdivision};
use radiosity_geometry::{Facets, Scene};
use radiosity_render::Camera;

use crate::asked::Asked;
use crate::bounces::omission;
use crate::bounded::{Bounded, largest};
use crate::estimate::{build, patch_rows};
use crate::importance::{Importance, largest_of};
use crate::run::{allowed, named};
use crate::{Geometry, Method, Phase, Run, RunError, Shape, Strategy};

pub use measure::ErrorEstimate;
use measure::measure;
use sender_errors::SenderErrors;
use variation::Variation;

/// What the tolerance is a tolerance of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Goal {
    /// Means over K × K cells of every surface.
    Cells(u32),
    /// Every point: the piecewise constant solution as it is seen.
    Points,
}

/// Which elements are cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Criterion {
    /// Those whose radiosity differs from a neighbour's by more than this share of the mean irradiance times the largest
    /// reflectance (Cohen et al. 1986).
    Gradient(f64),
    /// The fewest that carry the estimated error, A_e times its square, that has to go.
    Estimate,
    /// Those that the shadow of a corner of a strong emitter ends in: its visibility differs between corners of the element.
    Discontinuities,
}

/// Settings of an adaptive run.
#[derive(Clone, Debug, PartialEq)]
pub struct Adaptive {
    /// Cells of every face: the first patches.
    pub cells: Subdivision,
    /// Level of the elements to begin with; deeper where the cells of the goal need it.
    pub level: u8,
    /// Deepest level of elements.
    pub most_level: u8,
    /// What the tolerance is of.
    pub goal: Goal,
    /// rms error of irradiance, relative to its mean level.
    pub tolerance: f64,
    /// Which elements are cut.
    pub criterion: Criterion,
    /// Share of the tolerance that patches may take before they are cut; infinite: they never are.
    pub senders: f64,
    /// Number of elements beyond which nothing is cut.
    pub most_elements: usize,
}

impl Adaptive {
    /// Defaults for a tolerance: elements by estimate, patches cut when they take more than half of it.
    ///
    /// For [`Goal::Cells`] elements nest in the cells, so that what lies inside an element does not matter.
    pub fn new(goal: Goal, tolerance: f64) -> Self {
        let (cells, level) = match goal {
            Goal::Points => (4, 0),
            Goal::Cells(k) => nested(k),
        };
        Self {
            cells: Subdivision::Uniform(cells),
            level,
            most_level: MAX_LEVEL,
            goal,
            tolerance,
            criterion: Criterion::Estimate,
            senders: 0.5,
            most_elements: 40_000,
        }
    }
}

impl Adaptive {
    /// The same from `cells` × `cells` patches a face on, with elements at least as fine as the cells of the goal.
    pub fn from_cells(self, cells: u32) -> Self {
        let wanted = match self.goal {
            Goal::Points => cells,
            Goal::Cells(k) => k,
        };
        let level =
            (0..self.most_level).find(|&l| u64::from(cells) << l >= u64::from(wanted)).unwrap_or(self.most_level);
        Self { cells: Subdivision::Uniform(cells), level, ..self }
    }

    /// Level from which on the elements of every face that can be cut are at least as fine as the cells of the goal: the estimate does not
    /// see what varies inside an element.
    fn nesting(&self, geometry: &Geometry<'_>) -> u8 {
        let Goal::Cells(k) = self.goal else { return 0 };
        let pieces = (0..geometry.scene().surfaces.len()).flat_map(|s| geometry.mesh().pieces(s));
        let along = pieces.filter(|piece| piece.corners().len() <= 4).map(|piece| piece.divisions());
        let coarsest = along.map(|(first, last)| first.min(last)).min().unwrap_or(k);
        (0..self.most_level).find(|&l| u64::from(coarsest) << l >= u64::from(k)).unwrap_or(self.most_level)
    }
}

/// Few cells, and the level at which elements nest in k × k others.
fn nested(k: u32) -> (u32, u8) {
    match k {
        1 | 2 => (4, 0),
        _ => {
            let level = (0..k.trailing_zeros()).take_while(|l| k >> (l + 1) >= 3).count();
            (k >> level, level as u8)
        }
    }
}

/// One solution on the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Round {
    /// Elements m.
    pub elements: usize,
    /// Patches n.
    pub patches: usize,
    /// Elements that were not there before: rows to be computed.
    pub new_elements: usize,
    /// Rows of elements that were there before and had to be computed again or added to, since patches were cut or more rays were needed.
    pub rows_again: usize,
    /// What the rows of this round took: its source evaluations are `new_elements + rows_again`.
    pub cost: Cost,
    /// Steps of the solver.
    pub steps: u64,
    /// Error of the solution.
    pub estimate: ErrorEstimate,
}

/// A run whose estimated error meets the tolerance, or whose limits were reached.
pub struct AdaptiveRun<'a> {
    /// The last solution, with the cost and the time of all rounds.
    pub run: Run<'a>,
    /// Every round, first to last.
    pub rounds: Vec<Round>,
    /// Time taken by estimates.
    pub estimating: Duration,
    /// The estimator as it was used in the end.
    pub method: Method,
    /// Whether the last estimate met the tolerance.
    pub met: bool,
}

/// Solves `scene` to the tolerance of `adaptive`, with the method, solver, stopping rule, seed and asked surfaces of `strategy`, which gathers from patches.
///
/// # Errors
///
/// [`RunError`] if a setting is out of range, the solver cannot gather from patches or a row cannot be had.
pub fn run_adaptive<'a>(
    scene: &'a Scene,
    strategy: &Strategy,
    adaptive: &Adaptive,
) -> Result<AdaptiveRun<'a>, RunError> {
    run_adaptive_while(scene, strategy, adaptive, &mut |_| true)
}

/// [`run_adaptive`] that refines only while `go_on` says so of the rounds so far.
///
/// # Errors
///
/// As [`run_adaptive`].
pub fn run_adaptive_while<'a>(
    scene: &'a Scene,
    strategy: &Strategy,
    adaptive: &Adaptive,
    go_on: &mut dyn FnMut(&[Round]) -> bool,
) -> Result<AdaptiveRun<'a>, RunError> {
    let tolerance = adaptive.tolerance;
    allowed(tolerance)?;
    Strategy { shape: Shape::ElementsToPatches, ..strategy.clone() }.check()?;
    let mut state = State::new(scene, strategy, adaptive)?;
    loop {
        let solved = state.solve(strategy)?;
        let clock = Instant::now();
        let variation = Variation::new(&state.geometry, &solved.irradiance);
        let worth = state.worth(strategy)?;
        let worths = (&variation, worth.as_deref());
        let receivers = receivers::receivers(&state, adaptive)?;
        let senders = SenderErrors::new(&state, &solved, worths, &receivers);
        let estimate = measure(&state, &solved, worths, (&receivers, &senders), (adaptive, strategy.seed))?;
        state.estimating += clock.elapsed();
        state.rounds.push(Round { steps: solved.steps, estimate, ..state.round });
        let met = estimate.total() <= tolerance;
        let plan = if met || !go_on(&state.rounds) {
            None
        } else {
            state.plan(&solved, (&variation, &senders), (&estimate, adaptive))
        };
        match plan {
            Some(plan) => state.follow(plan, &solved.radiosity)?,
            None => return Ok(state.finish(solved, met, strategy, tolerance)),
        }
    }
}

/// What a round begins with.
struct State<'a> {
    geometry: Geometry<'a>,
    /// Every element that ever was: its index is the number of its row to the estimator, whatever is cut around it.
    ledger: Facets,
    /// The place of every exposed element in the ledger.
    numbers: Vec<u32>,
    store: MovableFormFactors,
    method: Method,
    seed: u64,
    /// What is asked for on the mesh there is.
    asked: Asked,
    /// Surfaces and camera that it is named by, if that is not everything.
    named: Option<(Option<Vec<u32>>, Option<Camera>)>,
    /// Elements that the first mesh would have beside its own if all were.
    coarse: u64,
    /// B to start from.
    start: Option<BandValues>,
    round: Round,
    rounds: Vec<Round>,
    meshing: Phase,
    form_factors: Phase,
    solving: Phase,
    estimating: Duration,
}

impl<'a> State<'a> {
    /// Cells, halved to the first level.
    fn new(scene: &'a Scene, strategy: &Strategy, adaptive: &Adaptive) -> Result<Self, RunError> {
        let clock = Instant::now();
        let cells = adaptive.cells;
        // Every part of a cell that a contact cuts is a patch of its own: light does not pass a partition within one.
        let mut geometry = Geometry::new(scene, &MeshSettings { elements: cells, patches: None, contacts: true })?;
        let asks = strategy.asks() && Asked::some(&geometry, strategy.named()).is_some();
        let named = asks.then(|| (strategy.asked.clone(), strategy.view.clone()));
        let (surfaces, mut coarse) = (strategy.asked_surfaces(scene).filter(|_| asks), 0);
        for _ in 0..adaptive.level.max(adaptive.nesting(&geometry)) {
            let is_asked = |surface: u32| surfaces.as_ref().is_none_or(|all| all.binary_search(&surface).is_ok());
            let some: Vec<bool> = geometry.mesh().elements.iter().map(|element| is_asked(element.surface)).collect();
            let left = some.iter().filter(|asked| !**asked).count() as u64;
            // Each would be four, as would those that are missing already.
            coarse = 4 * coarse + 3 * left;
            geometry = geometry.on(geometry.mesh().refined(&some).mesh);
        }
        let mut state = Self {
            asked: asked_on(&geometry, named.as_ref()),
            named,
            geometry,
            ledger: Facets::new(),
            numbers: Vec::new(),
            store: MovableFormFactors::default(),
            method: strategy.method,
            seed: strategy.seed,
            coarse,
            start: None,
            round: Round {
                elements: 0,
                patches: 0,
                new_elements: 0,
                rows_again: 0,
                cost: Cost::default(),
                steps: 0,
                estimate: ErrorEstimate::default(),
            },
            rounds: Vec::new(),
            meshing: Phase::default(),
            form_factors: Phase::default(),
            solving: Phase::default(),
            estimating: Duration::ZERO,
        };
        state.meshing.time = clock.elapsed();
        let m = state.geometry.elements().len();
        state.number(&vec![Origin::Part(0); m]);
        state.compute(&vec![Source::New; m], None)?;
        Ok(state)
    }

    /// Numbers the exposed elements: old ones as they were, parts of others anew.
    fn number(&mut self, origins: &[Origin]) {
        let numbers = origins.iter().enumerate().map(|(e, origin)| match origin {
            Origin::Kept(old) => self.numbers[*old as usize],
            Origin::Part(_) => {
                self.ledger.push(self.geometry.elements().polygons(e).to_vec(), false);
                self.ledger.len() as u32 - 1
            }
        });
        self.numbers = numbers.collect();
    }

    /// Fills the store: rows that are new, and those that change with the patches (given by where each patch comes from).
    fn compute(&mut self, sources: &[Source], patches: Option<&[Origin]>) -> Result<(), RunError> {
        let clock = Instant::now();
        let store = std::mem::take(&mut self.store);
        let (geometry, ledger, numbers) = (&self.geometry, &self.ledger, &self.numbers);
        let rows = patch_rows(geometry, ledger, self.method, self.seed)?;
        let n = geometry.patches().len();
        let is_part = |t: &usize| matches!(patches.map(|origins| origins[*t]), Some(Origin::Part(_)));
        let parts: Vec<usize> = (0..n).filter(is_part).collect();
        let mut facets = Facets::new();
        parts.iter().for_each(|&t| facets.push(geometry.patches().polygons(t).to_vec(), false));
        let pairwise = matches!(self.method, Method::Analytic { .. }) && !parts.is_empty();
        let receivers = Receivers::facets(&facets);
        let hits = || geometry.patch_occluders();
        let to_parts = || build(self.method, ledger, &facets, receivers, geometry.blockers(), hits, self.seed);
        let to_parts = if pairwise { Some(to_parts()?) } else { None };
        let columns = Columns { origins: patches.unwrap_or_default(), parts, rows: to_parts };
        let (store, cost) = store.rearranged(sources, n, |s, old, values| {
            let number = numbers[s] as usize;
            match old {
                Some(old) => columns.change(number, &*rows, old, values),
                None => rows.row(number, values),
            }
        })?;
        let new_elements = sources.iter().filter(|&&s| s == Source::New).count();
        let rows_again = cost.source_evaluations as usize - new_elements;
        self.round = Round { elements: sources.len(), patches: n, new_elements, rows_again, cost, ..self.round };
        self.store = store;
        self.form_factors.cost += cost;
        self.form_factors.time += clock.elapsed();
        Ok(())
    }

    fn solve(&mut self, strategy: &Strategy) -> Result<Solution, RunError> {
        let (emission, reflectance) = (self.geometry.emission(), self.geometry.reflectance());
        let areas = self.geometry.elements().areas();
        let form = Shape::ElementsToPatches.form();
        let parent = self.geometry.parent();
        let system = System::substructured(&self.store, form, &areas, parent, emission.view(), reflectance.view())?;
        let rule = StopRule::unshot(self.unshot(strategy)).steps(strategy.steps);
        let from = self.start.as_ref().map(BandValues::view);
        let solved = solve_from(&system, &mut *named(&strategy.solver, strategy.seed)?, &rule, &mut (), from)?;
        self.solving.cost += solved.cost;
        self.solving.time += solved.time;
        Ok(solved)
    }

    /// η at which the bounces that are left err by what they may, or that asked for.
    fn unshot(&self, strategy: &Strategy) -> f64 {
        let error = strategy.leaves_bounces();
        error.map_or(strategy.unshot, |error| (error * (1.0 - self.reflectance())).max(strategy.unshot))
    }

    /// ρ_max.
    fn reflectance(&self) -> f64 {
        largest(&self.geometry.reflectance()).into_iter().fold(0.0, f64::max)
    }

    /// What an error of the irradiance of each element is worth; `None` if everything is asked for alike.
    fn worth(&mut self, strategy: &Strategy) -> Result<Option<Vec<f64>>, RunError> {
        if self.named.is_none() {
            return Ok(None);
        }
        let (emission, reflectance) = (self.geometry.emission(), self.geometry.reflectance());
        let (areas, parent) = (self.geometry.elements().areas(), self.geometry.parent());
        let form = Shape::ElementsToPatches.form();
        let system = System::substructured(&self.store, form, &areas, parent, emission.view(), reflectance.view())?;
        let stop = StopRule::unshot(WORTH).unverified();
        let (importance, solved) = Importance::new(&system, &self.asked.weights(&areas), &strategy.solver, &stop)?;
        self.solving.cost += solved.cost;
        self.solving.time += solved.time;
        Ok(Some(largest_of(&importance.of_irradiance)))
    }

    /// What to cut, or `None` if nothing can be cut that would help.
    fn plan(
        &mut self,
        solved: &Solution,
        found: (&Variation, &SenderErrors),
        (estimate, adaptive): (&ErrorEstimate, &Adaptive),
    ) -> Option<Plan> {
        let clock = Instant::now();
        let method = more_rays(self.method, estimate, adaptive.tolerance);
        let marks = marks::marks(self, solved, found, (estimate, adaptive));
        let elements = self.geometry.mesh().refined(&marks.elements);
        let patches = elements.mesh.with_patches_split(&marks.patches);
        let cut = |origins: &[Origin]| origins.iter().any(|o| matches!(o, Origin::Part(_)));
        let helps = cut(&elements.origins) || cut(&patches.origins) || method != self.method;
        self.meshing.time += clock.elapsed();
        let plan = Plan { elements: elements.origins, patches: patches.origins, mesh: patches.mesh, method };
        (helps && plan.mesh.elements.len() <= adaptive.most_elements).then_some(plan)
    }

    /// Takes the next mesh, with the rows that can be kept and radiosity `b` to start from.
    fn follow(&mut self, plan: Plan, b: &BandValues) -> Result<(), RunError> {
        let clock = Instant::now();
        let again = plan.method != self.method;
        self.method = plan.method;
        let next = self.geometry.on(plan.mesh);
        let geometry = std::mem::replace(&mut self.geometry, next);
        self.asked = asked_on(&self.geometry, self.named.as_ref());

        // Exposed elements and patches in terms of those of the mesh before.
        let places = |of: &[u32], count: usize| {
            let mut place = vec![0; count];
            of.iter().zip(0..).for_each(|(&index, k)| place[index as usize] = k);
            place
        };
        let renamed = |origin: Origin, place: &[u32]| match origin {
            Origin::Kept(old) => Origin::Kept(place[old as usize]),
            Origin::Part(old) => Origin::Part(place[old as usize]),
        };
        let (old, new) = (geometry.mesh(), &self.geometry);
        let place = places(geometry.exposed(), old.elements.len());
        let elements: Vec<Origin> = new.exposed().iter().map(|&e| renamed(plan.elements[e as usize], &place)).collect();
        let place = places(geometry.exposed_patches(), old.patch_facets.len());
        let patches: Vec<Origin> =
            new.exposed_patches().iter().map(|&p| renamed(plan.patches[p as usize], &place)).collect();
        drop(geometry);

        let changed = patches.iter().any(|origin| matches!(origin, Origin::Part(_)));
        let source = |origin: &Origin| match origin {
            Origin::Kept(old) if !again && changed => Source::Changed(*old as usize),
            Origin::Kept(old) if !again => Source::Moved(*old as usize),
            _ => Source::New,
        };
        let sources: Vec<Source> = elements.iter().map(source).collect();
        let values = (0..b.count()).flat_map(|band| elements.iter().map(move |o| b.band(band)[o.index()]));
        self.start = Some(BandValues::new(values.collect(), elements.len()));
        self.number(&elements);
        self.meshing.time += clock.elapsed();
        self.compute(&sources, changed.then_some(&patches))?;
        let new_elements = elements.iter().filter(|o| matches!(o, Origin::Part(_))).count();
        self.round.rows_again += self.round.new_elements - new_elements;
        self.round.new_elements = new_elements;
        Ok(())
    }

    fn finish(self, solution: Solution, met: bool, strategy: &Strategy, tolerance: f64) -> AdaptiveRun<'a> {
        let bounded = self.bounded(&solution, strategy, tolerance);
        let solution = Solution { cost: self.solving.cost, time: self.solving.time, ..solution };
        let run = Run {
            hierarchical: None,
            forecast: None,
            geometry: self.geometry,
            meshing: self.meshing,
            form_factors: self.form_factors,
            stored_bytes: radiosity_core::FormFactors::properties(&self.store).stored_bytes,
            checked: None,
            repair: None,
            left_out: crate::plan::Savings::default(),
            bounded,
            solution,
        };
        AdaptiveRun { run, rounds: self.rounds, estimating: self.estimating, method: self.method, met }
    }

    /// What was left out within the tolerance; its bounds are parts of the estimate.
    fn bounded(&self, solution: &Solution, strategy: &Strategy, tolerance: f64) -> Vec<Bounded> {
        let coarse = self.named.as_ref().map(|(_, view)| Bounded {
            reason: "what they err by counts by its importance to what is asked for",
            what: match view {
                Some(_) => "refinement that the view does not show".to_owned(),
                None => "refinement to the report of faces not asked for".to_owned(),
            },
            counted: "rows",
            predicted: self.coarse,
            measured: None,
            prior: tolerance,
            bound: None,
        });
        let estimate = self.rounds.last().and_then(|round| round.estimate.solver);
        let bounces = strategy
            .leaves_bounces()
            .map(|error| Bounded { bound: estimate, ..omission(strategy, self.reflectance(), error, solution.steps) });
        coarse.into_iter().chain(bounces).collect()
    }
}

/// What is named, or everything, on a mesh.
fn asked_on(geometry: &Geometry<'_>, named: Option<&(Option<Vec<u32>>, Option<Camera>)>) -> Asked {
    let named = named.map_or((None, None), |(asked, view)| (asked.as_deref(), view.as_ref()));
    Asked::new(geometry, named)
}

/// Error of the elements, in units of the tolerance, below which the mesh is nearly as fine as it has to be.
const NEAR: f64 = 3.0;

/// The next mesh, and where its elements and patches come from.
struct Plan {
    elements: Vec<Origin>,
    patches: Vec<Origin>,
    mesh: Mesh,
    method: Method,
}

/// Unshot share to which importance is solved for.
const WORTH: f64 = 1e-3;

/// Rays a row, at most.
const MOST_RAYS: u32 = 1 << 17;

/// Shares of the tolerance: noise beyond the first is brought below the second.
const NOISE: [f64; 2] = [0.6, 0.5];

/// The method with as many rays as its noise asks for, once the mesh is fine enough to tell: errors of rows fall at least like N^(−1/2).
fn more_rays(method: Method, estimate: &ErrorEstimate, tolerance: f64) -> Method {
    let told = estimate.elements <= NEAR * tolerance;
    let noise = estimate.form_factors.filter(|&noise| told && noise > NOISE[0] * tolerance);
    let Some(noise) = noise else { return method };
    let factor = (noise / (NOISE[1] * tolerance)).powi(2).min(64.0);
    let more = |rays: u32| ((f64::from(rays) * factor) as u32).next_power_of_two().min(MOST_RAYS).max(rays);
    match method {
        Method::RayCast { rays, error: None } => Method::rays(more(rays)),
        Method::RaysAndEmitters { rays } => Method::RaysAndEmitters { rays: more(rays) },
        other => other,
    }
}

/// Columns of patches that were cut.
struct Columns<'a> {
    /// Where each patch comes from.
    origins: &'a [Origin],
    /// The parts of cut patches.
    parts: Vec<usize>,
    /// Rows to those parts alone, of a pairwise estimator.
    rows: Option<Box<dyn Rows + 'a>>,
}

impl Columns<'_> {
    /// A row to the new patches from the one to the old: new entries are computed, all of a row-wise estimator's if it saw what was cut.
    fn change(
        &self,
        number: usize,
        whole: &dyn Rows,
        (old, bound): (&[f64], f64),
        values: &mut [f64],
    ) -> Result<(Cost, f64), StoreError> {
        if self.rows.is_none() && self.parts.iter().any(|&t| old[self.origins[t].index()] > 0.0) {
            return whole.row(number, values);
        }
        for (value, origin) in values.iter_mut().zip(self.origins) {
            if let Origin::Kept(t) = origin {
                *value = old[*t as usize];
            }
        }
        let Some(rows) = &self.rows else { return Ok((Cost::default(), bound)) };
        let mut entries = vec![0.0; self.parts.len()];
        let (cost, of_parts) = rows.row(number, &mut entries)?;
        self.parts.iter().zip(entries).for_each(|(&t, entry)| values[t] = entry);
        Ok((cost, bound.max(of_parts)))
    }
}
