//! `radiosity solve`: radiosity and irradiance of every element or report cell.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::DVec3;
use radiosity::Choice;
use radiosity::bounded::{Bounded, foreseen};
use radiosity::choice::Steps;
use radiosity::plan::{Off, Omissions, Savings, StoreReason};
use radiosity::{
    Adaptive, DirectLight, EnhancedRun, ErrorEstimate, FittedRows, Geometry, Goal, GridValues, LINK_ERROR,
    LinearRadiosity, Method, Phase, Plan, Prediction, Round, Run, RunError, Saving, SpecularBy, SpecularTransport,
};
use radiosity::{Shape, Solved, Store, Strategy, ToleranceStep};
use radiosity::{
    Size, admit, default_method, predict, run_adaptive, run_enhanced, run_planned, run_saved, run_to_tolerance,
};
use radiosity_core::{BandValues, Outcome};
use radiosity_form_factors::Rows;
use radiosity_form_factors::extended::SpecularBounces;
use radiosity_form_factors::repair::RepairError;
use radiosity_geometry::mesh::{MeshSettings, Place, Subdivision};
use radiosity_geometry::{Occluders, Scene, SceneChange};
use radiosity_io::{Imported, PlyFace, PlyTriangle, PlyVertex, SolutionRow};
use radiosity_io::{write_ply, write_shaded_ply, write_solution};
use radiosity_render::Exposure;
use serde_json::{Value, json};

use crate::args::{Common, Estimator, MeshArgs, Shading, SolveArgs, StoreName};
use crate::choice::Happened;
use crate::output::Names;
use crate::saved::Saved;
use crate::{Failure, Verdict, choice, memory, output, plan, saved, scene};

/// Largest number of elements that `--tolerance` refines to.
pub const MOST_ELEMENTS: usize = 40_000;

/// Cells of the report grid that a tolerance is of, if none is asked for.
pub const REPORT_GRID: u32 = 8;
/// The solver that stands for the hierarchical store.
pub const HIERARCHICAL: &str = "hierarchical";

/// Cells along an edge of a face if nothing is asked for.
const CELLS: u32 = 4;

/// Rays of a row of form factors by way of specular surfaces.
pub const SPECULAR_RAYS: u32 = 4096;

/// Part of a tolerance that dropped pairs may take, and bounces that are not followed.
const SHARE: f64 = 0.1;

/// Part of a tolerance that links may take.
const SHARE_OF_LINKS: f64 = 0.3;

/// Estimated error at which a solver that samples stops if nothing is asked for.
const SAMPLED_ERROR: f64 = 1e-2;

/// The mesh asked for; 4 × 4 elements a face if nothing is.
pub fn mesh_settings(mesh: &MeshArgs) -> MeshSettings {
    let elements = match (mesh.subdivide, mesh.element_size) {
        (Some(k), _) => Subdivision::Uniform(k),
        (None, Some(size)) => Subdivision::EdgeLength(size),
        (None, None) => Subdivision::Uniform(CELLS),
    };
    MeshSettings { elements, patches: mesh.patch_subdivide.map(Subdivision::Uniform), contacts: true }
}

/// The strategy asked for, with what is not asked for chosen by the number of elements and of polygons that may block.
pub fn strategy(
    (elements, blocking): (usize, usize),
    mesh: MeshSettings,
    estimator: &Estimator,
    common: &Common,
) -> Strategy {
    let (seed, memory) = (common.seed, memory::limit(common));
    let method = estimator.method(default_method(elements, blocking), blocking);
    let substructured = mesh.patches.is_some();
    let mut strategy = Strategy { mesh, seed, memory, ..Strategy::new(Subdivision::Uniform(1), method) };
    if substructured {
        strategy.shape = Shape::ElementsToPatches;
        "gauss-seidel".clone_into(&mut strategy.solver);
    }
    strategy
}

/// How a solution was come by.
enum Way<'a> {
    /// By one run, in a store that was chosen for this reason if none was asked for.
    Straight(Option<StoreReason>),
    /// By one run with light by way of specular surfaces, whose form factors took so much.
    Enhanced(SpecularBy, Phase),
    /// By refinement to a tolerance.
    Refined(Refinement),
    /// By the strategy that was chosen.
    Chosen(Box<Choice>, Happened, Refinement),
    /// From the solution of another scene, which took so many seconds.
    After { path: &'a Path, seconds: f64, saving: Saving },
}

/// Form factors from a file, fitted to the mesh.
struct FromFile {
    path: PathBuf,
    rows: FittedRows,
    beside: Value,
}

/// Runs the command.
pub fn run(args: &SolveArgs) -> Result<Verdict, Failure> {
    if let Some(path) = args.output.as_deref() {
        format_of(path)?;
    }
    if args.forecast && (args.tolerance.is_some() || args.time.is_some()) {
        return Err("a forecast is of one system, and --tolerance and --time make many; leave out --forecast".into());
    }
    let specular = args.specular_bounces != SpecularBounces::None;
    let imported = if specular { scene::with_specular(&args.common)? } else { scene::with_materials(&args.common)? };
    let scene = &imported.scene;
    if args.repair && !scene.closed() {
        return Err(RepairError::Open.into());
    }
    match (&args.form_factors, &args.after) {
        (Some(path), _) => on_saved(args, &imported, path),
        (None, Some(before)) => after_change(args, &imported, before),
        (None, None) => on_computed(args, &imported),
    }
}

/// Computes form factors and solves.
fn on_computed(args: &SolveArgs, imported: &Imported) -> Result<Verdict, Failure> {
    let scene = &imported.scene;
    if let Some(wanted) = choice::wanted(args, scene)
        && let Some(chosen) = choice::choose(args, scene, &wanted)?
    {
        return on_chosen(args, imported, chosen);
    }
    let mesh = mesh_settings(&args.mesh);
    let program = memory::program();
    let transport = SpecularTransport { bounces: args.specular_bounces, by: args.specular_by.into() };
    let specular = transport.bounces != SpecularBounces::None && scene.is_specular();
    // Linear shading joins the irradiance of neighbours, and wants it of all.
    let whole = specular || args.tolerance.is_some() || (args.shading == Shading::Linear && !args.plan.ask.is_empty());
    let asked = plan::asked(&args.plan, scene)?;
    let omit = if whole { Omissions::NONE } else { plan::omissions(&args.plan) };
    let planned = |strategy: Strategy| Strategy { omit, asked: asked.clone(), ..strategy };
    // Which store is taken is a matter of what is computed once, for one scene.
    let choose = args.store.is_none() && args.tolerance.is_none() && !specular;
    let before = admitted(args, scene, mesh, &planned, choose)?;
    let clock = Instant::now();
    let mut plan = Plan::new(scene, &before);
    let mut geometry = plan.mesh(scene, &before)?;
    let (elements, blocking) = sizes(&geometry);
    let mut strategy = planned(strategy((elements, blocking), mesh, &args.estimator, &args.common));
    finish_strategy(&mut strategy, args, blocking);
    if specular && transport.by != SpecularBy::Images && args.solver.is_none() && strategy.shape == Shape::Full {
        // Extended form factors along rays are not symmetric.
        "gauss-seidel".clone_into(&mut strategy.solver);
    }
    if strategy.method != before.method {
        // Contacts made more elements than was thought, or fewer.
        plan = Plan::new(scene, &strategy);
        geometry = plan.mesh(scene, &strategy)?;
    }
    let choice = (choose && !by_links(args)).then(|| plan.store(&geometry, &strategy));
    strategy.store = choice.map_or(strategy.store, |choice| choice.store);
    let reason = choice.map(|choice| choice.reason);
    let meshing = Phase { time: clock.elapsed(), ..Phase::default() };
    strategy.check()?;
    if args.common.dry_run {
        let (savings, prediction) = (plan.left_out(&geometry, &strategy), plan.size(&geometry).predict(&strategy));
        // Refinement makes meshes of its own.
        let bounded = if args.tolerance.is_none() { foreseen(&plan, &geometry, &strategy) } else { Vec::new() };
        return Ok(dry_run(args, Foreseen { prediction, savings, bounded, reason }, &strategy, None, program));
    }
    let (run, way) = match args.tolerance {
        Some(tolerance) => {
            drop(geometry);
            to_tolerance(args, scene, &mut strategy, tolerance).map_err(memory::explained)?
        }
        None if specular => {
            drop(geometry);
            let EnhancedRun { run, specular, .. } =
                run_enhanced(scene, &strategy, transport, &mut ()).map_err(memory::explained)?;
            (run, Way::Enhanced(transport.by, specular))
        }
        None => {
            let run = run_planned(&plan, geometry, meshing, &strategy, &mut ()).map_err(memory::explained)?;
            (run, Way::Straight(reason))
        }
    };
    finish(args, imported, &strategy, None, &run, way)
}

/// Follows the procedure that was chosen.
fn on_chosen(args: &SolveArgs, imported: &Imported, choice: Choice) -> Result<Verdict, Failure> {
    if args.common.dry_run {
        let object = json!({ "dry_run": true, "choice": choice::json(&choice, None) });
        output::print(&args.common, &object, &choice::lines(&choice));
        return Ok(Verdict::Done);
    }
    let mut candidate = choice.chosen().candidate.clone();
    candidate.strategy.unshot = args.unshot.unwrap_or(candidate.strategy.unshot);
    candidate.strategy.steps = args.steps.into();
    let clock = Instant::now();
    let in_time = |seconds: f64| args.time.is_none_or(|time| seconds < time);
    let go_on = &mut || in_time(clock.elapsed().as_secs_f64());
    let reached = candidate.run(&imported.scene, &choice.target, go_on).map_err(memory::explained)?;
    let happened = Happened::new(&reached, clock.elapsed().as_secs_f64());
    let refinement = match reached.steps {
        Steps::Adaptive(rounds) => Refinement::Adaptive(rounds, reached.met),
        Steps::Uniform(steps) => Refinement::Uniform(steps, reached.met),
    };
    let way = Way::Chosen(Box::new(choice), happened, refinement);
    finish(args, imported, &reached.strategy, None, &reached.run, way)
}

/// Elements that take part, and polygons that may block.
pub fn sizes(geometry: &Geometry<'_>) -> (usize, usize) {
    (geometry.elements().len(), geometry.blockers().len())
}

/// The strategy by what is known before there is a mesh, with what `planned` leaves out, `choose` its store. Refuses what would take too much memory: of a dry run, the mesh alone.
fn admitted(
    args: &SolveArgs,
    scene: &Scene,
    mesh: MeshSettings,
    planned: &dyn Fn(Strategy) -> Strategy,
    choose: bool,
) -> Result<Strategy, Failure> {
    let cells = Size::before_meshing(scene, &mesh)?.elements as usize;
    let blocking = Occluders::blocking(scene).len();
    let mut strategy = strategy((cells, blocking), mesh, &args.estimator, &args.common);
    finish_strategy(&mut strategy, args, blocking);
    let mut strategy = planned(strategy);
    if choose && !by_links(args) {
        strategy.store = Plan::new(scene, &strategy).store_before_meshing(scene, &strategy)?.store;
    }
    strategy.check()?;
    if args.common.dry_run {
        admitted_mesh(scene, &strategy)?;
    } else {
        admit(scene, &strategy).map_err(memory::explained)?;
    }
    Ok(strategy)
}

/// Refuses a mesh that would take too much memory whatever is done on it.
pub fn admitted_mesh(scene: &Scene, strategy: &Strategy) -> Result<(), Failure> {
    let method = Method::ANALYTIC;
    let least = Strategy { store: Store::KeepNone, solver: "shooting".to_owned(), method, ..strategy.clone() };
    admit(scene, &least).map_err(memory::explained)
}

/// Solves the scene of another file first, and this one from its answer.
fn after_change(args: &SolveArgs, imported: &Imported, path: &Path) -> Result<Verdict, Failure> {
    let before = scene::read_with_materials(path, &args.common)?;
    let change = imported.scene.change_from(&before.scene).map_err(|error| format!("{}: {error}", path.display()))?;
    one_moved(&imported.scene, &change, path)?;
    let mesh = mesh_settings(&args.mesh);
    let program = memory::program();
    admitted(args, &imported.scene, mesh, &|strategy| strategy, false)?;
    // What is not asked for is chosen as without the scene before.
    let geometry = Geometry::new(&imported.scene, &mesh)?;
    let (elements, blocking) = sizes(&geometry);
    let mut strategy = strategy((elements, blocking), mesh, &args.estimator, &args.common);
    finish_strategy(&mut strategy, args, blocking);
    strategy.check()?;
    if args.common.dry_run {
        return Ok(dry_run(args, Foreseen::whole(&geometry, &strategy), &strategy, None, program));
    }
    drop(geometry);
    let first = Solved::new(&before.scene, &strategy, &mut ()).map_err(memory::explained)?;
    let (again, saving) = first.resolve(&imported.scene, &mut ())?;
    let seconds = first.run().seconds();
    finish(args, imported, &strategy, None, again.run(), Way::After { path, seconds, saving })
}

/// Refuses scenes in which more than one surface, or the faces of more than one object, moved.
fn one_moved(scene: &Scene, change: &SceneChange, before: &Path) -> Result<(), Failure> {
    let Some(&first) = change.moved.first() else { return Ok(()) };
    let object = &scene.surfaces[first].name;
    let other = |s: &&usize| object.is_empty() || scene.surfaces[**s].name != *object;
    let Some(&second) = change.moved[1..].iter().find(other) else { return Ok(()) };
    let name = |s: usize| {
        let surface = &scene.surfaces[s];
        if surface.name.is_empty() { format!("face {s}") } else { format!("face {s} ('{}')", surface.name) }
    };
    let (before, first, second) = (before.display(), name(first), name(second));
    Err(format!(
        "{second} is not where it was in {before}, and neither is {first}; --after takes scenes in which one face or one object moved"
    )
    .into())
}

/// How a mesh was refined to a tolerance, and whether that was met.
enum Refinement {
    Adaptive(Vec<Round>, bool),
    Uniform(Vec<ToleranceStep>, bool),
}

/// Refines where the error is, or everywhere alike if what is asked for works in the full form alone.
fn to_tolerance<'a>(
    args: &SolveArgs,
    scene: &'a Scene,
    strategy: &mut Strategy,
    tolerance: f64,
) -> Result<(Run<'a>, Way<'static>), RunError> {
    let report_grid = args.report_grid.unwrap_or(REPORT_GRID);
    strategy.omit = plan::omissions(&args.plan);
    let mut gathering = Strategy { shape: Shape::ElementsToPatches, ..strategy.clone() };
    if args.solver.is_none() {
        "gauss-seidel".clone_into(&mut gathering.solver);
    }
    if args.repair || strategy.store != Store::Dense || gathering.check().is_err() {
        let done = run_to_tolerance(scene, strategy, tolerance, report_grid, MOST_ELEMENTS)?;
        return Ok((done.run, Way::Refined(Refinement::Uniform(done.steps, done.met))));
    }
    let mut adaptive = Adaptive { most_elements: MOST_ELEMENTS, ..Adaptive::new(Goal::Cells(report_grid), tolerance) };
    if let Some(cells) = args.mesh.patch_subdivide {
        adaptive = adaptive.from_cells(cells);
    }
    let done = run_adaptive(scene, &gathering, &adaptive)?;
    *strategy = Strategy { method: done.method, ..gathering };
    Ok((done.run, Way::Refined(Refinement::Adaptive(done.rounds, done.met))))
}

/// Solves on form factors from a file.
fn on_saved(args: &SolveArgs, imported: &Imported, path: &Path) -> Result<Verdict, Failure> {
    let saved = saved::read(path)?;
    // A file that knows its subdivision need not be told.
    let k = args.mesh.subdivide.or(saved.subdivide()).unwrap_or(CELLS);
    let Saved { form_factors, beside } = saved;
    let mesh = MeshSettings { elements: Subdivision::Uniform(k), patches: None, contacts: true };
    let program = memory::program();
    let geometry = Geometry::new(&imported.scene, &mesh)?;
    let rows = form_factors.fit(&geometry).map_err(|error| {
        let scene = args.common.scene.display();
        format!(
            "{}: {error}; `radiosity form-factors {scene} --subdivide {k} --contacts --output FILE` writes the matrix of this mesh",
            path.display()
        )
    })?;
    let solver = if rows.symmetric() { "cg" } else { "gauss-seidel" };
    let plain = Strategy::new(mesh.elements, Method::ANALYTIC);
    let memory = memory::limit(&args.common);
    let mut strategy = Strategy { solver: solver.to_owned(), seed: args.common.seed, memory, ..plain };
    finish_strategy(&mut strategy, args, geometry.blockers().len());
    let file = FromFile { path: path.to_owned(), rows, beside };
    if args.common.dry_run {
        let mut whole = Foreseen::whole(&geometry, &strategy);
        (whole.prediction.form_factors, whole.prediction.source_evaluations) = (0, 0);
        return Ok(dry_run(args, whole, &strategy, Some(&file), program));
    }
    let run = run_saved(geometry, &file.rows, &strategy, &mut ()).map_err(memory::explained)?;
    finish(args, imported, &strategy, Some(&file), &run, Way::Straight(None))
}

/// Whether links are asked for.
fn by_links(args: &SolveArgs) -> bool {
    args.solver.as_deref() == Some(HIERARCHICAL) || args.store == Some(StoreName::Hierarchical)
}

/// Store, repair, stopping and solver as asked for, among `blocking` polygons that may block.
fn finish_strategy(strategy: &mut Strategy, args: &SolveArgs, blocking: usize) {
    (strategy.steps, strategy.repair) = (args.steps.into(), args.repair);
    strategy.store = args.store.map_or(Store::Dense, Store::from);
    strategy.forecast = if args.forecast { output::FORECAST } else { 0 };
    if args.repair && strategy.shape == Shape::Full {
        // What is repaired is symmetric.
        "cg".clone_into(&mut strategy.solver);
    }
    if by_links(args) {
        let share = args.tolerance.map(|tolerance| SHARE_OF_LINKS * tolerance);
        let error = args.link_error.or(share).unwrap_or(LINK_ERROR);
        strategy.store = Store::Hierarchical { error, direct: DirectLight::WhereFew };
        strategy.method = args.estimator.method(Method::of_links_among(blocking), blocking);
        "cg".clone_into(&mut strategy.solver);
    }
    if let Some(solver) = args.solver.as_ref().filter(|solver| *solver != HIERARCHICAL) {
        strategy.solver.clone_from(solver);
        if matches!(solver.as_str(), "shooting" | "stochastic") && strategy.shape == Shape::ElementsToPatches {
            strategy.shape = Shape::PatchesToElements;
        } else if matches!(solver.as_str(), "direct" | "cg") && strategy.shape == Shape::ElementsToPatches {
            strategy.shape = Shape::TwoLevel;
        }
    }
    if !args.plan.keep_everything {
        let share = args.tolerance.map(|tolerance| SHARE * tolerance);
        strategy.thin = args.thin_error.or(share);
        strategy.bounces = args.bounce_error.or(share.filter(|_| args.unshot.is_none()));
    }
    strategy.unshot = args.unshot.unwrap_or(if strategy.samples() { SAMPLED_ERROR } else { strategy.unshot });
}

/// What is known of a run that is not made.
struct Foreseen {
    prediction: Prediction,
    savings: Savings,
    bounded: Vec<Bounded>,
    reason: Option<StoreReason>,
}

impl Foreseen {
    /// A run that leaves nothing out.
    fn whole(geometry: &Geometry<'_>, strategy: &Strategy) -> Self {
        let prediction = predict(&Size::of(geometry), strategy);
        Self { prediction, savings: Savings::default(), bounded: Vec::new(), reason: None }
    }
}

fn dry_run(
    args: &SolveArgs,
    Foreseen { prediction, savings, bounded, reason }: Foreseen,
    strategy: &Strategy,
    file: Option<&FromFile>,
    program: u64,
) -> Verdict {
    let (mut object, line) = predicted(&prediction, strategy, file, program);
    object["left_out"] = plan::with_bounded(plan::json(&savings), &bounded);
    object["store_reason"] = reason.map(|reason| reason.to_string()).into();
    let mut lines = vec![line];
    lines.extend(reason.map(|reason| plan::store_line(strategy.store, reason)));
    lines.extend(plan::lines(&savings));
    lines.extend(bounded.iter().map(plan::bounded_line));
    output::print(&args.common, &object, &lines);
    Verdict::Done
}

/// Writes and reports.
fn finish(
    args: &SolveArgs,
    imported: &Imported,
    strategy: &Strategy,
    file: Option<&FromFile>,
    run: &Run<'_>,
    way: Way<'_>,
) -> Result<Verdict, Failure> {
    let target = args.output.as_deref();
    if let Some(path) = target {
        write(path, run, args)?;
    }
    let mut object = report(strategy, file, run);
    object["scene"] = output::import(&imported.report);
    object["left_out"] = plan::with_bounded(plan::json(&run.left_out), &run.bounded);
    object["left_out_error"] = run.bounded_error().into();
    object["plan_off"] = plan_off(args, strategy, file, &way).into();
    let mut lines = summary(strategy, file, run);
    lines.extend(plan::lines(&run.left_out));
    lines.extend(plan::bounded_lines(run));
    let mut verdict = if run.solution.outcome == Outcome::Converged { Verdict::Done } else { Verdict::CheckFailed };
    match way {
        Way::Straight(reason) => {
            object["store_reason"] = reason.map(|reason| reason.to_string()).into();
            lines.extend(reason.map(|reason| plan::store_line(strategy.store, reason)));
        }
        Way::Enhanced(by, phase) => {
            object["extended_form_factors"] = output::phase(&phase);
            object["extended_form_factors"]["by"] = by.name().into();
            let work = match by {
                SpecularBy::Rays(_) => format!("{} rays", phase.cost.rays),
                SpecularBy::Images => format!("{} pairs by images", phase.cost.form_factors),
            };
            lines.push(format!("by way of specular surfaces: {work} in {:.3} s", phase.time.as_secs_f64()));
        }
        Way::Refined(refinement) => {
            object["refinement"] = refinement.json();
            lines.push(refinement.line());
            if !refinement.result().1 {
                verdict = Verdict::CheckFailed;
            }
        }
        Way::Chosen(choice, happened, refinement) => {
            object["refinement"] = refinement.json();
            object["choice"] = choice::json(&choice, Some(&happened));
            lines.push(choice::line(&choice, &happened));
            lines.extend(if args.explain { choice::lines(&choice) } else { Vec::new() });
            lines.push(refinement.line());
            // Within a time alone the tolerance is one that nobody asked for.
            if !refinement.result().1 && args.tolerance.is_some() {
                verdict = Verdict::CheckFailed;
            }
        }
        Way::After { path, seconds, saving } => {
            object["after"] = output::saving(path, &saving);
            object["after"]["seconds_before"] = seconds.into();
            lines.push(format!(
                "after {} ({seconds:.3} s): {} faces of other material, {} moved; {saving}, {:.3} s",
                path.display(),
                saving.change.recoloured.len(),
                saving.change.moved.len(),
                run.seconds()
            ));
        }
    }
    if let Some(path) = target {
        lines.push(format!("→ {}", path.display()));
    }
    output::print(&args.common, &object, &lines);
    Ok(verdict)
}

/// Why nothing was left out, if nothing could be.
fn plan_off(args: &SolveArgs, strategy: &Strategy, file: Option<&FromFile>, way: &Way<'_>) -> Option<String> {
    match way {
        _ if file.is_some() => Some("form factors are given".to_owned()),
        Way::Straight(_) => Off::of(strategy).map(|off| off.to_string()),
        Way::Enhanced(..) => Some("light by way of specular surfaces takes all elements".to_owned()),
        // What is not asked for is refined by what it matters.
        Way::Refined(Refinement::Adaptive(..)) if strategy.asked.is_some() && !args.plan.keep_everything => None,
        Way::Refined(_) | Way::Chosen(..) => Some("refinement looks at all elements".to_owned()),
        Way::After { .. } => Some("what a change needs is not known before it".to_owned()),
    }
}

/// Kinds of output file.
enum Format {
    Csv,
    Ply,
}

fn format_of(path: &Path) -> Result<Format, Failure> {
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("csv") => Ok(Format::Csv),
        Some("ply") => Ok(Format::Ply),
        _ => Err(format!("{}: a solution file ends in .csv or .ply", path.display()).into()),
    }
}

/// The estimator with its settings, or the file and what stands beside it.
fn method(strategy: &Strategy, file: Option<&FromFile>) -> Value {
    let Some(file) = file else { return output::method(strategy.method) };
    json!({
        "name": file.rows.name(),
        "file": file.path.display().to_string(),
        "symmetric": file.rows.symmetric(),
        "largest_reciprocity_error": file.rows.apart(),
        "made_by": file.beside["method"],
        "tolerance": file.beside["tolerance"],
        "repair": file.beside["repair"],
    })
}

fn method_name(strategy: &Strategy, file: Option<&FromFile>) -> String {
    match file {
        Some(file) if file.rows.symmetric() => format!(
            "{} (the mean of both directions, which differ by up to {:.1e})",
            file.path.display(),
            file.rows.apart()
        ),
        Some(file) => format!(
            "{} (row by row: the two directions of a pair differ by up to {:.1e})",
            file.path.display(),
            file.rows.apart()
        ),
        None => strategy.method.name().to_owned(),
    }
}

fn predicted(p: &Prediction, strategy: &Strategy, file: Option<&FromFile>, program: u64) -> (Value, String) {
    let object = json!({
        "dry_run": true,
        "elements": p.elements, "patches": p.patches,
        "method": method(strategy, file), "store": strategy.store.name(), "solver": strategy.solver,
        "form": strategy.shape.name(),
        "predicted": {
            "form_factors": p.form_factors, "source_evaluations": p.source_evaluations, "rays": p.rays,
            "hemicube_pixels": p.hemicube_pixels, "stored_bytes": p.stored_bytes, "mesh_bytes": p.mesh_bytes,
            "peak_bytes": p.peak_bytes + program,
        },
    });
    let line = format!(
        "{} elements, {} patches; {} form factors by {} in {}, {} of memory in all, solver {}; nothing written",
        p.elements,
        p.patches,
        p.form_factors,
        method_name(strategy, file),
        output::bytes(p.stored_bytes),
        output::bytes(p.peak_bytes + program),
        strategy.solver
    );
    (object, line)
}

fn power(run: &Run<'_>) -> (Vec<f64>, Vec<f64>) {
    let areas = run.geometry.elements().areas();
    let (e, rho) = (run.geometry.emission(), run.geometry.reflectance());
    let h = &run.solution.irradiance;
    let emitted = |b: usize| areas.iter().zip(e.band(b)).map(|(a, e)| a * e).sum();
    // By what is asked for, and what that needed.
    let absorbed = |b: usize| {
        let by_element = areas.iter().zip(rho.band(b)).zip(h.band(b)).map(|((a, rho), h)| a * (1.0 - rho) * h);
        by_element.filter(|power| !power.is_nan()).sum()
    };
    ((0..e.count()).map(emitted).collect(), (0..e.count()).map(absorbed).collect())
}

fn report(strategy: &Strategy, file: Option<&FromFile>, run: &Run<'_>) -> Value {
    let (emitted, absorbed) = power(run);
    let s = &run.solution;
    json!({
        "elements": run.geometry.elements().len(),
        "patches": run.geometry.patches().len(),
        "covered_elements": run.geometry.mesh().elements.len() - run.geometry.elements().len(),
        "method": method(strategy, file),
        "form": strategy.shape.name(),
        "store": strategy.store.name(),
        "solver": strategy.solver,
        "outcome": s.outcome.to_string(),
        "steps": s.steps,
        "forecast": run.forecast.as_ref().map(|f| output::forecast(f, strategy.unshot)),
        "unshot": s.unshot,
        "standard_error": s.standard_error,
        "contraction": s.contraction(),
        "bound": s.bound(),
        "sharp_bound": s.certificate.and_then(|certificate| certificate.sharp_bound),
        "backward_error": s.certificate.map(|certificate| certificate.backward_error),
        "meshing": output::phase(&run.meshing),
        "form_factors": output::phase(&run.form_factors),
        "solve": { "seconds": s.time.as_secs_f64(), "counts": output::cost(&s.cost) },
        "verification": output::cost(&s.verification),
        "stored_bytes": run.stored_bytes,
        "links": run.hierarchical.as_ref().map(|links| json!({
            "nodes": links.nodes, "links": links.links, "rounds": links.rounds, "estimated_error": links.error,
            "exact_emitters": links.exact_emitters,
        })),
        "peak_bytes": output::peak_bytes(),
        "closed": run.checked.as_ref().map(|c| c.closed),
        "checks": run.checked.as_ref().map(|c| {
            with_names(strategy, run, |names| output::checks(&c.checks, c.blocked.as_ref(), names))
        }),
        "seconds_checks": run.checked.as_ref().map(|c| c.time.as_secs_f64()),
        "repair": run.repair.as_ref().map(output::repair),
        "power": { "emitted": emitted, "absorbed": absorbed },
    })
}

/// Calls `with` with the names of rows and columns: lines of the output (from 0) for elements, numbers for patches.
fn with_names<T>(strategy: &Strategy, run: &Run<'_>, with: impl FnOnce(Names<'_>) -> T) -> T {
    let element = |e: usize| run.geometry.exposed()[e] as usize;
    let patch = |p: usize| p;
    match strategy.shape {
        Shape::Full => with([&element, &element]),
        Shape::ElementsToPatches | Shape::TwoLevel => with([&element, &patch]),
        Shape::PatchesToElements => with([&patch, &element]),
    }
}

impl Refinement {
    /// The last estimate of the error, and whether it met the tolerance.
    fn result(&self) -> (f64, bool) {
        match self {
            Self::Adaptive(rounds, met) => (rounds.last().map_or(f64::NAN, |round| round.estimate.total()), *met),
            Self::Uniform(steps, met) => (steps.last().and_then(ToleranceStep::estimate).unwrap_or(f64::NAN), *met),
        }
    }

    fn line(&self) -> String {
        let (estimate, met) = self.result();
        let met = if met { "met" } else { "not met" };
        format!("estimated rms error of irradiance {estimate:.2e}; tolerance {met}")
    }

    fn json(&self) -> Value {
        let (estimate, met) = self.result();
        let steps: Vec<Value> = match self {
            Self::Adaptive(rounds, _) => rounds.iter().map(round_json).collect(),
            Self::Uniform(steps, _) => steps.iter().map(step_json).collect(),
        };
        let kind = if matches!(self, Self::Adaptive(..)) { "adaptive" } else { "uniform" };
        json!({ "kind": kind, "met": met, "estimate": estimate, "steps": steps })
    }
}

fn round_json(round: &Round) -> Value {
    let ErrorEstimate { elements, senders, form_factors, solver } = round.estimate;
    json!({
        "elements": round.elements,
        "patches": round.patches,
        "new_elements": round.new_elements,
        "rows_again": round.rows_again,
        "counts": output::cost(&round.cost),
        "steps": round.steps,
        "estimate": {
            "total": round.estimate.total(),
            "elements": elements, "senders": senders, "form_factors": form_factors, "solver": solver,
        },
    })
}

fn step_json(step: &ToleranceStep) -> Value {
    json!({
        "subdivision": step.subdivision,
        "elements": step.elements,
        "difference": step.difference.as_ref().map(output::error),
        "left_out_error": step.left_out,
        "links_error": step.links,
    })
}

fn summary(strategy: &Strategy, file: Option<&FromFile>, run: &Run<'_>) -> Vec<String> {
    let s = &run.solution;
    let (emitted, absorbed) = power(run);
    let (emitted, absorbed): (f64, f64) = (emitted.iter().sum(), absorbed.iter().sum());
    let mut lines = vec![format!(
        "{} elements, {} patches; form factors by {} in {:.3} s, {}",
        run.geometry.elements().len(),
        run.geometry.patches().len(),
        method_name(strategy, file),
        run.form_factors.time.as_secs_f64(),
        output::bytes(run.stored_bytes)
    )];
    lines.extend(run.repair.as_ref().map(output::repair_line));
    if let Some(c) = &run.checked {
        lines.extend(with_names(strategy, run, |names| {
            output::check_lines(&c.checks, c.blocked.as_ref(), c.closed, names)
        }));
    }
    lines.extend(run.forecast.as_ref().map(|f| output::forecast_line(f, strategy.unshot)));
    let residual = match s.standard_error {
        Some(error) => format!("standard error {error:.1e} of the power emitted"),
        None => format!("unshot {:.1e}", s.unshot),
    };
    lines.extend([
        format!(
            "{} ({}): {}, {} steps in {:.3} s, {}{}",
            strategy.solver,
            strategy.shape.name(),
            s.outcome,
            s.steps,
            s.time.as_secs_f64(),
            residual,
            s.bound().map_or_else(|| ", no bound".to_owned(), |b| format!(", error of the solver at most {b:.1e}")),
        ),
        format!("power emitted {emitted:.6e}, absorbed {absorbed:.6e} (the rest leaves an open scene)"),
    ]);
    lines
}

/// The band a column shows: of one band all three columns show it; further bands than three are not written.
fn three(values: &BandValues, at: usize) -> [f64; 3] {
    [0, 1, 2].map(|b| values.band(b.min(values.count() - 1))[at])
}

/// Writes what is asked for.
fn write(path: &Path, run: &Run<'_>, args: &SolveArgs) -> Result<(), Failure> {
    let asked = plan::asked(&args.plan, run.geometry.scene())?;
    let is_asked = |surface: u32| asked.as_ref().is_none_or(|asked| asked.binary_search(&surface).is_ok());
    match format_of(path)? {
        Format::Csv => {
            let mut rows = match args.report_grid {
                Some(k) => cell_rows(run, k)?,
                None => element_rows(run),
            };
            rows.retain(|row| is_asked(row.surface));
            write_solution(path, &rows)?;
        }
        Format::Ply => match args.shading {
            Shading::Flat => {
                let mut faces = ply_faces(run);
                faces.retain(|face| is_asked(face.surface));
                write_ply(path, &faces)?;
            }
            Shading::Linear => write_shaded_ply(path, &ply_triangles(run, &is_asked))?,
        },
    }
    Ok(())
}

fn element_rows(run: &Run<'_>) -> Vec<SolutionRow> {
    let g = &run.geometry;
    let [e, h, b] = [&g.emission(), &run.solution.irradiance, &run.solution.radiosity].map(|v| g.spread(v));
    let mesh = g.mesh();
    let row = |k: usize| {
        let (element, polygon) = (&mesh.elements[k], &mesh.element_facets.polygons(k)[0]);
        SolutionRow {
            surface: element.surface,
            i: element.i,
            j: element.j,
            centroid: polygon.centroid(),
            area: polygon.area(),
            emission: three(&e, k),
            irradiance: three(&h, k),
            radiosity: three(&b, k),
        }
    };
    (0..mesh.elements.len()).map(row).collect()
}

fn cell_rows(run: &Run<'_>, k: u32) -> Result<Vec<SolutionRow>, Failure> {
    let g = &run.geometry;
    let means = |values: &BandValues| GridValues::means(g, values, k);
    let (e, h, b) = (means(&g.emission())?, means(&run.solution.irradiance)?, means(&run.solution.radiosity)?);
    let cells = g.mesh().report_grid(g.scene(), k)?.cells;
    let row = |(c, cell): (usize, &radiosity_geometry::ReportCell)| SolutionRow {
        surface: cell.surface,
        i: cell.i,
        j: cell.j,
        centroid: cell.polygon.centroid(),
        area: cell.polygon.area(),
        emission: three(&e.values, c),
        irradiance: three(&h.values, c),
        radiosity: three(&b.values, c),
    };
    Ok(cells.iter().enumerate().map(row).collect())
}

/// Radiosity of every element of the mesh, and the exposure that shows it.
fn shown(run: &Run<'_>) -> (Vec<[f64; 3]>, Exposure) {
    let mesh = run.geometry.mesh();
    let b = run.geometry.spread(&run.solution.radiosity);
    let values: Vec<[f64; 3]> = (0..mesh.elements.len()).map(|k| three(&b, k)).collect();
    // Lights are far brighter than what they light: white is what 2 % of the area exceeds.
    let exposure = Exposure::of_share(&values, &mesh.areas(), 0.98);
    (values, exposure)
}

fn ply_faces(run: &Run<'_>) -> Vec<PlyFace> {
    let (mesh, (values, exposure)) = (run.geometry.mesh(), shown(run));
    let face = |((k, value), vertices): ((usize, &[f64; 3]), Vec<_>)| PlyFace {
        vertices,
        surface: mesh.elements[k].surface,
        colour: exposure.colour(*value),
        radiosity: *value,
    };
    values.iter().enumerate().zip(mesh.without_cracks()).map(face).collect()
}

fn ply_triangles(run: &Run<'_>, is_asked: &dyn Fn(u32) -> bool) -> Vec<PlyTriangle> {
    let (mesh, (_, exposure)) = (run.geometry.mesh(), shown(run));
    let linear = LinearRadiosity::new(&run.geometry, &run.solution.irradiance);
    let vertex = |e: usize, (position, place): (DVec3, Place)| {
        let radiosity = [0, 1, 2].map(|b: usize| linear.radiosity(e, &place, b.min(linear.bands() - 1)));
        PlyVertex { position, colour: exposure.colour(radiosity), radiosity }
    };
    let exposed = run.geometry.exposed().iter().enumerate();
    exposed
        .filter(|(_, element)| is_asked(mesh.elements[**element as usize].surface))
        .flat_map(|(e, &element)| {
            let surface = mesh.elements[element as usize].surface;
            let triangles = linear.irradiance().triangles(element as usize);
            triangles.map(move |corners| PlyTriangle { vertices: corners.map(|corner| vertex(e, corner)), surface })
        })
        .collect()
}
