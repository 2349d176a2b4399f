//! Solving again after a change: of emission, of reflectance, or of the shape or place of surfaces.
//!
//! **Form factors** depend on geometry alone, so a change of materials computes none: the store is shared. Where surfaces moved, a new store
//! is filled with what cannot have changed ([`radiosity_form_factors::update`]): pair by pair for pairwise estimators, row by row for
//! row-wise ones; meanwhile both stores are held. What a run from nothing would compute is known without it: facing pairs that went are
//! taken off, and those that came are added.
//!
//! **The start** is one reflection of the old irradiance H, element by element, under the new emission E' and reflectance ρ':
//!
//! ```text
//! x = E' + ρ' α H,      α = Σ A' E' E / Σ A E²   over the surfaces, band by band
//! ```
//!
//! Elements that were not there before take the mean of H over their surface. While F is the same, x leaves the residual
//! ρF(E' − αE) after a change of emission, which α makes small in the mean square; with all lights dimmed alike it is rounding, and
//! the solver has nothing to do. Against a start from E', whose residual ρFE' is the light reflected once, that is what changed
//! against what is there: the steps saved are about ln(‖E'‖ / ‖E' − αE‖) over the logarithm of the method's contraction, so a change
//! of a tenth of the light saves a tenth of the steps to 1e-10, and one of a surface that few see more. Least squares because a
//! lamp that is added, moved or put out is no multiple of what was there, and a part of it would be. Direct methods do not start anywhere.

use std::sync::Arc;
use std::time::Instant;

use radiosity_core::{BandValues, Form, Observer, Outcome};
use radiosity_form_factors::analytic::{BlockerChange, facing_pairs};
use radiosity_form_factors::stores::Held;
use radiosity_form_factors::update::{Before, UpdatedPairs, UpdatedRows};
use radiosity_form_factors::{PairwiseRows, Rows};
use radiosity_geometry::{Disturbed, FacetMap, Scene, SceneChange};

use crate::estimate::{Filled, analytic, ends};
use crate::run::{Check, Known, fill_checked, solve_stored, unblocked};
use crate::{Geometry, Method, Phase, Run, RunError, Strategy};

/// A solved scene with its store, from which a similar scene can be solved.
pub struct Solved<'a> {
    run: Run<'a>,
    strategy: Strategy,
    store: Arc<dyn Held>,
    /// Form factors that filling the store from nothing counts.
    whole: u64,
}

/// What solving again saved: exact counts, which repeat. Times are those of the [`Run`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Saving {
    /// Surfaces that changed.
    pub change: SceneChange,
    /// Form factors computed.
    pub form_factors: u64,
    /// Form factors that a run from nothing computes.
    pub of_form_factors: u64,
    /// Sources for which the estimator was started.
    pub rows: u64,
    /// Sources for which a run from nothing starts it.
    pub of_rows: u64,
    /// Steps of the solver from the old answer.
    pub steps: u64,
    /// Steps from nothing, if they were counted: see [`Solved::count_cold_start`].
    pub of_steps: Option<u64>,
}

impl std::fmt::Display for Saving {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { form_factors, of_form_factors, rows, of_rows, steps, .. } = self;
        write!(f, "{form_factors} of {of_form_factors} form factors in {rows} of {of_rows} rows, {steps} steps")?;
        self.of_steps.map_or(Ok(()), |of| write!(f, " of {of}"))
    }
}

/// Where the facets of a geometry were in an earlier one.
struct Maps {
    elements: FacetMap,
    patches: FacetMap,
}

impl Maps {
    fn new(before: &Geometry<'_>, after: &Geometry<'_>) -> Self {
        let elements = [before, after].map(Geometry::surfaces);
        let patches = [before, after].map(surfaces_of_patches);
        Self {
            elements: FacetMap::new((before.elements(), &elements[0]), (after.elements(), &elements[1])),
            patches: FacetMap::new((before.patches(), &patches[0]), (after.patches(), &patches[1])),
        }
    }

    /// The maps of sources and targets.
    fn ends(&self, form: Form) -> (&FacetMap, &FacetMap) {
        match form {
            Form::Full => (&self.elements, &self.elements),
            Form::ElementsToPatches => (&self.elements, &self.patches),
            Form::PatchesToElements => (&self.patches, &self.elements),
        }
    }
}

/// The surface of a patch is that of its elements.
fn surfaces_of_patches(geometry: &Geometry<'_>) -> Vec<u32> {
    let mut surfaces = vec![0; geometry.patches().len()];
    let elements = geometry.parent().iter().zip(geometry.surfaces());
    elements.for_each(|(&patch, surface)| surfaces[patch as usize] = surface);
    surfaces
}

impl<'a> Solved<'a> {
    /// Solves `scene` as [`crate::run`] does and keeps the store.
    ///
    /// # Errors
    ///
    /// [`RunError`] as [`crate::run`], and if the store of `strategy` holds nothing.
    pub fn new(scene: &'a Scene, strategy: &Strategy, observer: &mut dyn Observer) -> Result<Self, RunError> {
        strategy.check()?;
        if strategy.thin.is_some() {
            // Which pairs are small is a matter of light, and that changes.
            let instead = "leave out the error of small pairs, or solve the changed scene anew";
            return Err(RunError::Thin { what: "kept for a change of the scene", instead });
        }
        crate::admit(scene, strategy)?;
        let clock = Instant::now();
        let geometry = Geometry::of_strategy(scene, strategy)?;
        let meshing = Phase { time: clock.elapsed(), ..Phase::default() };
        let (store, known) = filled(&geometry, None, strategy)?;
        let whole = known.form_factors.cost.form_factors;
        let made = solve_stored(&geometry, &*store, known, strategy, None, observer)?;
        Ok(Self { run: made.run(geometry, meshing), strategy: strategy.clone(), store, whole })
    }

    /// The run.
    pub fn run(&self) -> &Run<'a> {
        &self.run
    }

    /// The store of form factors, from sources to targets of the strategy's form.
    pub fn form_factors(&self) -> &dyn Held {
        &*self.store
    }

    /// Solves `scene`, which lists the same surfaces, by the same strategy from this answer, and says what that saved.
    ///
    /// Whatever changed, the answer is that of a run from nothing, within the bounds of both; a `scene` that did not change keeps its answer.
    /// With `repair`, a move computes everything: entries that were scaled to close other rows are not those of the new scene. With
    /// rays and exact emitters so does a change of which surfaces emit or shine, since rows are made for them.
    ///
    /// # Errors
    ///
    /// [`RunError`] as [`crate::run`], and if the scenes cannot be compared.
    pub fn resolve<'b>(&self, scene: &'b Scene, observer: &mut dyn Observer) -> Result<(Solved<'b>, Saving), RunError> {
        let (strategy, before) = (&self.strategy, &self.run.geometry);
        let change = scene.change_from(before.scene())?;
        let clock = Instant::now();
        let geometry = Geometry::of_strategy(scene, strategy)?;
        let maps = Maps::new(before, &geometry);
        let meshing = Phase { time: clock.elapsed(), ..Phase::default() };
        let same_method = match strategy.method {
            Method::RaysAndEmitters { .. } => before.senders().1 == geometry.senders().1,
            _ => true,
        };
        let (store, known, whole) = if change.moved.is_empty() && same_method {
            let checks = Check::Known(self.run.checked.clone().map(Box::new));
            let known =
                Known { form_factors: Phase::default(), repair: self.run.repair.clone(), checks, thinned: Vec::new() };
            (Arc::clone(&self.store), known, self.whole)
        } else if strategy.repair || !same_method {
            let (store, known) = filled(&geometry, None, strategy)?;
            let whole = known.form_factors.cost.form_factors;
            (store, known, whole)
        } else {
            let clock = Instant::now();
            let update = Update { before: self, after: &geometry, maps: &maps, change: &change };
            let rows = update.rows()?;
            let prepared = clock.elapsed();
            let (store, mut known) = filled(&geometry, Some(rows), strategy)?;
            known.form_factors.time += prepared;
            (store, known, update.whole())
        };
        let form_factors = known.form_factors.cost;
        // What a method left that diverged or broke down is no light.
        let usable = !matches!(self.run.solution.outcome, Outcome::NotContracting | Outcome::Breakdown);
        let start = usable.then(|| self.start(&geometry, &maps.elements));
        let from = start.as_ref().map(BandValues::view);
        let made = solve_stored(&geometry, &*store, known, strategy, from, observer)?;
        let run = made.run(geometry, meshing);
        let saving = Saving {
            change,
            form_factors: form_factors.form_factors,
            of_form_factors: whole,
            rows: form_factors.source_evaluations,
            of_rows: store.sources() as u64,
            steps: run.solution.steps,
            of_steps: None,
        };
        Ok((Solved { run, strategy: strategy.clone(), store, whole }, saving))
    }

    /// Solves once more on the same store without the old answer, to count the steps that it saved.
    ///
    /// # Errors
    ///
    /// [`RunError`] as [`Self::resolve`].
    pub fn count_cold_start(&self, saving: Saving) -> Result<Saving, RunError> {
        let strategy = Strategy { verify: false, ..self.strategy.clone() };
        let known =
            Known { form_factors: Phase::default(), repair: None, checks: Check::Known(None), thinned: Vec::new() };
        let made = solve_stored(&self.run.geometry, &*self.store, known, &strategy, None, &mut ())?;
        Ok(Saving { of_steps: Some(made.steps()), ..saving })
    }

    /// Radiosities to begin with: one reflection of the old irradiance under the new materials.
    fn start(&self, after: &Geometry<'_>, elements: &FacetMap) -> BandValues {
        let (before, old) = (&self.run.geometry, &self.run.solution.irradiance);
        let (areas, surfaces) = (before.elements().areas(), before.surfaces());
        let (mut start, rho) = (after.emission(), after.reflectance());
        for band in 0..start.count() {
            let h = old.band(band);
            // An unverified run does not know H where nothing is reflected.
            let known = |e: usize| h[e].is_finite();
            let mut means = vec![(0.0, 0.0); before.scene().surfaces.len()];
            for e in (0..h.len()).filter(|&e| known(e)) {
                let mean = &mut means[surfaces[e] as usize];
                *mean = (mean.0 + areas[e] * h[e], mean.1 + areas[e]);
            }
            let mean = |surface: u32| {
                let (sum, area) = means[surface as usize];
                if area > 0.0 { sum / area } else { 0.0 }
            };
            let share = share(before.scene(), after.scene(), band);
            let of_surface = after.surfaces();
            for (e, x) in start.band_mut(band).iter_mut().enumerate() {
                let was = elements.earlier()[e].map(|e| e as usize).filter(|&e| known(e));
                *x += rho.band(band)[e] * share * was.map_or_else(|| mean(of_surface[e]), |e| h[e]);
            }
        }
        start
    }
}

/// α = Σ A' E' E / Σ A E² over the surfaces of two scenes: the multiple of the old light nearest to the new; 1 where there was none.
fn share(before: &Scene, after: &Scene, band: usize) -> f64 {
    let emission = |scene: &Scene, s: usize| scene.materials[scene.surfaces[s].material].emission[band];
    let (mut both, mut old) = (0.0, 0.0);
    for (s, (was, is)) in before.surfaces.iter().zip(&after.surfaces).enumerate() {
        let e = emission(before, s);
        both += is.area() * emission(after, s) * e;
        old += was.area() * e * e;
    }
    if old > 0.0 { both / old } else { 1.0 }
}

/// A store of the kind that `strategy` names, filled with `rows` or with all that its method gives.
fn filled(
    geometry: &Geometry<'_>,
    rows: Option<Box<dyn Rows + '_>>,
    strategy: &Strategy,
) -> Result<(Arc<dyn Held>, Known), RunError> {
    let rows = match rows {
        Some(rows) => rows,
        None => crate::rows(geometry, strategy.method, strategy.shape.form(), strategy.seed)?,
    };
    match fill_checked(geometry, rows, unblocked(strategy.method), strategy)? {
        (Filled::Held(store), known) => Ok((Arc::from(store), known)),
        (Filled::OnDemand(_), _) => Err(RunError::NothingHeld { store: strategy.store.name() }),
    }
}

/// What is needed to fill a store after surfaces moved.
#[derive(Clone, Copy)]
struct Update<'u> {
    before: &'u Solved<'u>,
    after: &'u Geometry<'u>,
    maps: &'u Maps,
    change: &'u SceneChange,
}

impl<'u> Update<'u> {
    /// Rows that compute what can have changed and copy the rest.
    fn rows(&self) -> Result<Box<dyn Rows + 'u>, RunError> {
        let &Self { before: Solved { run, strategy, store, .. }, after, maps, .. } = self;
        let form = strategy.shape.form();
        let (sources, targets) = ends(after, form);
        let (source_map, target_map) = maps.ends(form);
        let before = Before { store: &**store, sources: source_map, targets: target_map };
        if let Method::Analytic { tolerance, partial } = strategy.method {
            let [was, is] = [run.geometry.blockers(), after.blockers()].map(|blockers| analytic(blockers, partial));
            let change = BlockerChange::new(&was, &is);
            let rows = PairwiseRows::new(is, sources, targets, tolerance, strategy.seed);
            return Ok(Box::new(UpdatedPairs::new(rows, before, change)));
        }
        let rows = crate::rows(after, strategy.method, form, strategy.seed)?;
        let disturbed = self.disturbed();
        let kept = (0..sources.len()).map(|s| !disturbed.in_front_of(sources.polygons(s)));
        Ok(Box::new(UpdatedRows::new(rows, before, kept.collect())))
    }

    fn disturbed(&self) -> Disturbed {
        let (before, after) = (&self.before.run.geometry, self.after);
        let mut disturbed = Disturbed::new(before.scene(), after.scene(), &self.change.moved);
        disturbed.add_facets(&self.maps.elements, before.elements(), after.elements());
        disturbed.add_facets(&self.maps.patches, before.patches(), after.patches());
        disturbed
    }

    /// Form factors that a run from nothing computes.
    fn whole(&self) -> u64 {
        let (before, after, form) = (&self.before.run.geometry, self.after, self.before.strategy.shape.form());
        let (sources, targets) = ends(after, form);
        let entries = (sources.len() * targets.len()) as u64;
        match self.before.strategy.method {
            Method::Analytic { .. } => {
                let (source_map, target_map) = self.maps.ends(form);
                let (old_sources, old_targets) = ends(before, form);
                let gone = facing_pairs(old_sources, old_targets, &source_map.gone(), &target_map.gone());
                let new = facing_pairs(sources, targets, &source_map.new_facets(), &target_map.new_facets());
                self.before.whole - gone + new
            }
            Method::RayCast { .. } | Method::Hemicube { .. } => entries,
            Method::RaysAndEmitters { .. } => {
                let (senders, _) = after.senders();
                let all: Vec<u32> = (0..sources.len() as u32).collect();
                entries + facing_pairs(sources, senders, &all, &[])
            }
        }
    }
}
