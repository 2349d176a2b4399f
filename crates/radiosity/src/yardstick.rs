//! Measures strategies on one scene: what each took, and its solver, form-factor and mesh error apart.
//!
//! For a strategy's answer H, the exact solution H_s of the same system (to η = 1e-13), the exact solution H_f with the
//! best form factors known on the same mesh, and a reference H* (a closed form or a much finer run), all on one report
//! grid,
//!
//! ```text
//! solver error = |H − H_s|,   form-factor error = |H_s − H_f|,   mesh error = |H_f − H*|,   error = |H − H*|
//! ```
//!
//! in the measure of [`crate::errors`]. A solver that casts its own rays solves the system of exact form factors: there H_s is H_f. Everything but the strategy itself happens outside its clock. Where the best form
//! factors of a mesh would take too many pairs, the form-factor error comes from sampled rows: H of some elements
//! gathered by the best rows from the strategy's own B, against its own H; the mesh error is then not known.

use std::collections::HashMap;

use radiosity_core::{BandValues, Cost, Direction, Form, FormFactors, RowBuf, Snapshot, Snapshots, StopRule, System};
use radiosity_form_factors::stores::{DenseFormFactors, Keep, OnDemand};
use radiosity_geometry::Scene;

use crate::predict::{admit, admit_beside_exact};
use crate::{ErrorMeasure, Geometry, GridValues, Method, Run, RunError, Shape, Strategy, mend_dense, rows};

/// A strategy's run and how wrong it is.
pub struct Measured<'a> {
    /// What it gave and took.
    pub run: Run<'a>,
    /// Its irradiance on the report grid.
    pub grid: GridValues,
    /// Against the reference.
    pub error: ErrorMeasure,
    /// Against the exact solution of the same system: rms.
    pub solver_error: f64,
    /// Of that exact solution against the one with the best form factors on the same mesh: rms.
    pub form_factor_error: f64,
    /// Of the best solution on the same mesh against the reference: rms; `None` where it would cost too much.
    pub mesh_error: Option<f64>,
    /// The state at geometric steps.
    pub history: Vec<HistoryPoint>,
}

/// The state of a run at one step.
#[derive(Clone, Debug)]
pub struct HistoryPoint {
    /// Steps done.
    pub step: u64,
    /// Seconds in filling the store and solving so far.
    pub seconds: f64,
    /// Seconds in the solver alone (with the rows it had computed, where they are computed on demand).
    pub solver_seconds: f64,
    /// Counts of both so far.
    pub cost: Cost,
    /// rms against the exact solution of the same system.
    pub solver_error: f64,
    /// rms against the reference.
    pub error: f64,
}

/// References for one scene.
pub struct Yardstick<'a> {
    scene: &'a Scene,
    truth: GridValues,
    grid: u32,
    surfaces: Option<Vec<u32>>,
    best: Method,
    most_pairs: u64,
    exact: HashMap<String, GridValues>,
    best_on: HashMap<String, GridValues>,
    /// The store of the system looked at last: strategies that differ in their solver come one after the other.
    last: Option<(String, DenseFormFactors)>,
}

/// η to which exact solutions are taken.
const EXACT: f64 = 1e-13;
/// Rows of which a form-factor error is estimated on large meshes.
const SAMPLED_ROWS: usize = 200;

impl<'a> Yardstick<'a> {
    /// Measures on `scene` against `truth` on a `grid` × `grid` report grid; `best` is the method whose form factors
    /// count as exact on any mesh, taken as a whole where that needs at most `most_pairs` of them.
    pub fn new(scene: &'a Scene, truth: GridValues, grid: u32, best: Method, most_pairs: u64) -> Self {
        let (exact, best_on) = (HashMap::new(), HashMap::new());
        Self { scene, truth, grid, surfaces: None, best, most_pairs, exact, best_on, last: None }
    }

    /// Measures on some surfaces only; `truth` must be of them alone.
    pub fn on_surfaces(self, surfaces: &[u32]) -> Self {
        Self { surfaces: Some(surfaces.to_vec()), ..self }
    }

    /// The reference.
    pub fn truth(&self) -> &GridValues {
        &self.truth
    }

    fn means(&self, geometry: &Geometry<'_>, irradiance: &BandValues) -> Result<GridValues, RunError> {
        let grid = GridValues::means(geometry, irradiance, self.grid)?;
        Ok(match &self.surfaces {
            Some(surfaces) => grid.on(surfaces),
            None => grid,
        })
    }

    /// Refuses a strategy that would take too much memory together with every entry of its system, which is solved exactly to measure it.
    ///
    /// # Errors
    ///
    /// [`RunError::Memory`], and [`RunError::Mesh`] if the settings make no mesh.
    pub fn admits(scene: &Scene, strategy: &Strategy) -> Result<(), RunError> {
        if strategy.casts_rays() { admit(scene, strategy) } else { admit_beside_exact(scene, strategy) }
    }

    /// Runs `strategy` and measures it; with `history`, also its state at geometric steps.
    ///
    /// # Errors
    ///
    /// [`RunError`] as [`crate::run`].
    pub fn measure(&mut self, strategy: &Strategy, history: bool) -> Result<Measured<'a>, RunError> {
        Self::admits(self.scene, strategy)?;
        let mut snapshots = Snapshots::every(1.5);
        let unwatched: &mut dyn radiosity_core::Observer = &mut ();
        let run = crate::run(self.scene, strategy, if history { &mut snapshots } else { unwatched })?;
        let grid = self.means(&run.geometry, &run.solution.irradiance)?;
        // The best form factors on the same mesh.
        let best = self.best_solution(&run.geometry, strategy)?;
        // The exact solution of the same system, where it is known.
        let exact = if strategy.casts_rays() {
            best.clone()
        } else {
            let solver = radiosity_solvers::by_name(&strategy.solver);
            let direction = solver.map_or(Direction::Gather, |solver| solver.needs().direction);
            let key = self.solve_exactly(&run.geometry, strategy, direction)?;
            Some(self.exact[&key].clone())
        };
        let against_exact = |values: &GridValues| exact.as_ref().map_or(f64::NAN, |exact| values.error(exact).rms);
        let (form_factor_error, mesh_error) = match &best {
            Some(best) => {
                let error = exact.as_ref().map_or(f64::NAN, |exact| exact.error(best).rms);
                (error, Some(best.error(&self.truth).rms))
            }
            None => (self.sampled_error(&run, strategy)?, None),
        };
        let mut points = Vec::with_capacity(snapshots.taken.len());
        for snapshot in &snapshots.taken {
            // B = E + ρFx for every method that knows F, so the irradiance of a snapshot is Fx.
            let irradiance = if strategy.samples() && strategy.shape != Shape::TwoLevel {
                sampled_irradiance(&run, snapshot)
            } else {
                self.irradiance(&run.geometry, strategy, &snapshot.shot)?
            };
            let values = self.means(&run.geometry, &irradiance)?;
            points.push(HistoryPoint {
                step: snapshot.at.step,
                seconds: (run.form_factors.time + snapshot.at.time).as_secs_f64(),
                solver_seconds: snapshot.at.time.as_secs_f64(),
                cost: run.form_factors.cost + snapshot.at.cost,
                solver_error: against_exact(&values),
                error: values.error(&self.truth).rms,
            });
        }
        let error = grid.error(&self.truth);
        let solver_error = against_exact(&grid);
        Ok(Measured { run, grid, error, solver_error, form_factor_error, mesh_error, history: points })
    }

    /// Solves the strategy's system exactly, once, and keeps its store; gives its key.
    fn solve_exactly(
        &mut self,
        geometry: &Geometry<'_>,
        strategy: &Strategy,
        direction: Direction,
    ) -> Result<String, RunError> {
        let form = strategy.shape.form();
        let rows = rows(geometry, strategy.method, form, strategy.seed)?;
        // On symmetric rows both directions are one system.
        let (repair, seed) = (strategy.repair, strategy.seed);
        let turned = form == Form::Full && direction == Direction::Shoot && !rows.symmetric() && !repair;
        let key = format!("{} {:?} {seed} {turned} {repair}", on_mesh(strategy, form), strategy.method);
        if self.last.as_ref().is_none_or(|(last, _)| *last != key) {
            let (mut store, _) = DenseFormFactors::assemble(&*rows)?;
            if repair {
                store = mend_dense(store, &geometry.elements().areas(), geometry.scene().closed())?.0;
            }
            self.last = Some((key.clone(), if turned { store.transposed() } else { store }));
        }
        if !self.exact.contains_key(&key) {
            let irradiance = self.exact_irradiance(geometry, form)?;
            self.exact.insert(key.clone(), self.means(geometry, &irradiance)?);
        }
        Ok(key)
    }

    fn exact_irradiance(&self, geometry: &Geometry<'_>, form: Form) -> Result<BandValues, RunError> {
        let (_, store) = self.last.as_ref().expect("set by the caller");
        exact_irradiance(geometry, store, form)
    }

    /// H = Fx on the store looked at last.
    fn irradiance(&self, geometry: &Geometry<'_>, strategy: &Strategy, x: &BandValues) -> Result<BandValues, RunError> {
        let (_, store) = self.last.as_ref().expect("set when the system was solved exactly");
        let (emission, reflectance) = (geometry.emission(), geometry.reflectance());
        let areas = geometry.elements().areas();
        let (e, rho) = (emission.view(), reflectance.view());
        let system = System::substructured(store, strategy.shape.form(), &areas, geometry.parent(), e, rho)?;
        let mut h = BandValues::zeros(x.count(), geometry.elements().len());
        let x = if x.len() == h.len() { x.clone() } else { crate::run::spread(x, geometry.parent()) };
        system.irradiance(Direction::Gather, x.view(), h.view_mut())?;
        Ok(h)
    }

    /// The exact solution with the best form factors on the strategy's mesh, if it is within the limit.
    fn best_solution(&mut self, geometry: &Geometry<'_>, strategy: &Strategy) -> Result<Option<GridValues>, RunError> {
        // Gathering from patches, shooting from them and two levels are one system with exact form factors.
        let form = if strategy.shape == Shape::Full { Form::Full } else { Form::ElementsToPatches };
        let key = on_mesh(strategy, form);
        if let Some(known) = self.best_on.get(&key) {
            return Ok(Some(known.clone()));
        }
        let (m, n) = (geometry.elements().len() as u64, geometry.patches().len() as u64);
        let pairs = if form == Form::Full { m * m / 2 } else { m * n };
        if pairs > self.most_pairs {
            return Ok(None);
        }
        let rows = rows(geometry, self.best, form, strategy.seed)?;
        let (store, _) = DenseFormFactors::assemble(&*rows)?;
        let best = self.means(geometry, &exact_irradiance(geometry, &store, form)?)?;
        self.best_on.insert(key, best.clone());
        Ok(Some(best))
    }

    /// rms difference of H on sampled elements, relative to the mean level: their rows by the best method applied to the
    /// run's own B, against the run's own H.
    fn sampled_error(&self, run: &Run<'_>, strategy: &Strategy) -> Result<f64, RunError> {
        let geometry = &run.geometry;
        let form = if strategy.shape == Shape::Full { Form::Full } else { Form::ElementsToPatches };
        let store = OnDemand::new(rows(geometry, self.best, form, strategy.seed)?, Keep::None);
        let areas = geometry.elements().areas();
        let (emission, reflectance) = (geometry.emission(), geometry.reflectance());
        let (e, rho) = (emission.view(), reflectance.view());
        let system = System::substructured(&store, form, &areas, geometry.parent(), e, rho)?;
        let sent = system.patch_means(run.solution.radiosity.view());
        let (m, bands) = (areas.len(), sent.count());
        let step = m.div_ceil(SAMPLED_ROWS);
        let (mut square, mut level, mut weight, mut buf) = (0.0, 0.0, 0.0, RowBuf::default());
        for s in (step / 2..m).step_by(step) {
            let row = store.row(s, 0, &mut buf)?;
            for b in 0..bands {
                let best = row.entries.dot(sent.band(b)) / areas[s];
                square += areas[s] * (best - run.solution.irradiance.band(b)[s]).powi(2);
                level += areas[s] * best;
                weight += areas[s];
            }
        }
        Ok((square / weight).sqrt() / (level / weight))
    }
}

/// A name for the mesh of a strategy and the form on it.
fn on_mesh(strategy: &Strategy, form: Form) -> String {
    format!("{:?} {} {form:?}", strategy.mesh, strategy.contact_level)
}

/// H = (B − E)/ρ of a snapshot with B = x + r as sampled; on black elements, which show nothing of H, that of the end.
fn sampled_irradiance(run: &Run<'_>, snapshot: &Snapshot) -> BandValues {
    let (geometry, mut h) = (&run.geometry, run.solution.irradiance.clone());
    let (emission, reflectance) = (geometry.emission(), geometry.reflectance());
    let data = emission.values().iter().zip(reflectance.values());
    let residual = snapshot.residual.as_ref().map_or(&[][..], |r| r.values());
    let radiosity = snapshot.shot.values().iter().zip(residual).map(|(x, r)| x + r);
    for ((h, b), (e, rho)) in h.values_mut().iter_mut().zip(radiosity).zip(data) {
        if *rho > 0.0 {
            *h = (b - e) / rho;
        }
    }
    h
}

/// The irradiance of a system's solution to η = 1e-13, gathering.
fn exact_irradiance(geometry: &Geometry<'_>, store: &dyn FormFactors, form: Form) -> Result<BandValues, RunError> {
    // Gauss–Seidel takes half the sweeps but no rows of patches.
    let solver = if form == Form::PatchesToElements { "jacobi" } else { "gauss-seidel" };
    Ok(crate::solve_on(geometry, store, form, solver, &StopRule::unshot(EXACT), &mut ())?.irradiance)
}
