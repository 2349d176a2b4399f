//! `radiosity compare`: every strategy on the user's own scene, error against time.

use radiosity::plan::{Anyway, Omissions, Savings};
use radiosity::{Bytes, Change, GridValues, Measured, Method, Plan, RunError, Size, Store, Strategy, Yardstick};
use radiosity::{admit, coarser, default_method, run as run_strategy};
use radiosity_core::Outcome;
use radiosity_geometry::mesh::Subdivision;
use radiosity_geometry::{Occluders, Scene};
use radiosity_io::write_atomically;
use radiosity_plot::{Axis, Dash, Figure, Panel, Point, Quality, Series};
use radiosity_solvers::STOCHASTIC;
use serde_json::{Value, json};

use crate::args::CompareArgs;
use crate::{Failure, Verdict, choice, memory, output, plan, scene};

/// A strategy and how it went.
struct Compared<'a> {
    strategy: Strategy,
    result: Result<Measured<'a>, RunError>,
}

/// Cells of the report grid along an edge of a face.
const GRID: u32 = 8;
/// The estimators compared.
const METHODS: [Method; 4] = [Method::ANALYTIC, Method::RAY_CAST, Method::RAYS_AND_EMITTERS, Method::HEMICUBE];
/// Steps of the solver that samples, which reaches no such small error as the others.
const SAMPLED_STEPS: u64 = 256;
/// Pairs of a mesh up to which the best form factors are taken as a whole.
const MOST_PAIRS: u64 = 4 << 20;

/// The strategies of a comparison: every solver on every store of the pairwise estimator, and on the dense and the
/// recomputed store of the row-wise ones.
fn strategies(args: &CompareArgs, blocking: usize) -> Vec<Strategy> {
    let (subdivide, unshot, seed, memory) =
        (args.subdivide, args.unshot, args.common.seed, memory::limit(&args.common));
    let mut all = Vec::new();
    for method in METHODS {
        let pairwise = matches!(method, Method::Analytic { .. });
        let method = if pairwise { Method::analytic_among(blocking) } else { method };
        for store in Store::ALL.into_iter().chain(Store::SYMMETRIC) {
            for solver in radiosity_solvers::NAMES.into_iter().chain([STOCHASTIC]) {
                // Recomputed rows make sense for the one method that reads few of them, and for the one that casts its own rays.
                let sensible = match store {
                    Store::Dense => true,
                    Store::KeepNone => solver == "shooting" || (solver == STOCHASTIC && method.name() == "ray-cast"),
                    // In neither list: its answer is that of the error asked for.
                    Store::Hierarchical { .. } => false,
                    Store::Sparse | Store::Packed | Store::PackedSingle | Store::KeepAll => {
                        pairwise && solver != "direct" && solver != STOCHASTIC
                    }
                };
                if sensible {
                    let strategy = Strategy::new(Subdivision::Uniform(subdivide), method);
                    let steps = if solver == STOCHASTIC { SAMPLED_STEPS } else { strategy.steps };
                    all.push(Strategy { store, solver: solver.to_owned(), unshot, steps, seed, memory, ..strategy });
                }
            }
        }
    }
    all
}

/// Runs the command.
pub fn run(args: &CompareArgs) -> Result<Verdict, Failure> {
    let imported = scene::with_materials(&args.common)?;
    let scene = &imported.scene;
    if let Some(tolerance) = args.tolerance {
        return choice::compare(args, scene, tolerance);
    }
    let blocking = Occluders::blocking(scene).len();
    let all = strategies(args, blocking);
    let fine = reference(args, scene, &all, blocking)?;
    if args.common.dry_run {
        let plan = Plan::new(scene, &fine);
        let geometry = plan.mesh(scene, &fine)?;
        let left_out = LeftOut::new(&plan.left_out(&geometry, &fine), plan.anyway(&geometry, &fine, None));
        let mut object = json!({ "dry_run": true, "strategies": all.len() });
        left_out.tell(&mut object);
        let lines: Vec<String> =
            std::iter::once(format!("{} strategies; nothing run", all.len())).chain(left_out.lines).collect();
        output::print(&args.common, &object, &lines);
        return Ok(Verdict::Done);
    }
    let reference = run_strategy(scene, &fine, &mut ()).map_err(memory::explained)?;
    let truth = GridValues::means(&reference.geometry, &reference.solution.irradiance, GRID)?;
    let anyway = Plan::new(scene, &fine).anyway(&reference.geometry, &fine, Some(&reference));
    let left_out = LeftOut::new(&reference.left_out, anyway);
    drop(reference);
    let best = match Method::analytic_among(blocking) {
        Method::ANALYTIC => Method::exact(1e-10, 1e-7),
        _ => Method::sampled(1e-10, 1024),
    };
    let mut yardstick = Yardstick::new(scene, truth, GRID, best, MOST_PAIRS);
    let compared: Vec<Compared<'_>> = all
        .into_iter()
        .map(|strategy| {
            if !(args.common.quiet || args.common.no_progress || args.common.json) {
                eprintln!("running {}", label(&strategy));
            }
            let result = yardstick.measure(&strategy, true);
            Compared { strategy, result }
        })
        .collect();
    std::fs::create_dir_all(&args.output).map_err(|e| format!("{}: {e}", args.output.display()))?;
    write_table(args, &compared)?;
    let figure = figure(&compared);
    let drawing = figure.draw();
    let svg = drawing.to_svg()?;
    write_atomically(&args.output.join("comparison.svg"), |out| out.write_all(svg.as_bytes()))?;
    drawing.write_png(&args.output.join("comparison.png"))?;
    let mut object = json!({
        "reference": output::method(fine.method),
        "strategies": compared.iter().map(compared_json).collect::<Vec<_>>(),
        "folder": args.output.display().to_string(),
    });
    left_out.tell(&mut object);
    let mut lines =
        vec![format!("{:<46} {:>10} {:>10} {:>10} {:>10}  outcome", "strategy", "seconds", "solver", "F", "total")];
    lines.extend(compared.iter().map(line));
    lines.extend(left_out.lines);
    lines.push(format!("→ {}", args.output.display()));
    output::print(&args.common, &object, &lines);
    Ok(Verdict::Done)
}

/// Why strategies take what a plan would leave out.
const PLAN_OFF: &str =
    "strategies are compared on whole systems; the reference leaves out what the scene does not need";

/// What the reference leaves out.
struct LeftOut {
    list: Value,
    anyway: Value,
    lines: Vec<String>,
}

impl LeftOut {
    fn new(savings: &Savings, anyway: Vec<Anyway>) -> Self {
        let lines = plan::anyway_line(&anyway).into_iter().chain(plan::lines(savings));
        let lines = lines.map(|line| format!("reference, {line}")).collect();
        Self { list: plan::json(savings), anyway: plan::anyway_json(&anyway), lines }
    }

    fn tell(&self, object: &mut Value) {
        object["left_out"] = self.list.clone();
        object["left_out_anyway"] = self.anyway.clone();
        object["plan_off"] = PLAN_OFF.into();
    }
}

/// The reference: a mesh twice as fine, by the method that suits its size, or by what fits in memory. Refused where none of the
/// strategies fits with all entries of its system, against which it is measured.
fn reference(args: &CompareArgs, scene: &Scene, all: &[Strategy], blocking: usize) -> Result<Strategy, Failure> {
    let elements = Subdivision::Uniform(2 * args.subdivide);
    let plain = Strategy::new(elements, Method::ANALYTIC);
    let method = match default_method(Size::before_meshing(scene, &plain.mesh)?.elements as usize, blocking) {
        Method::RaysAndEmitters { .. } => Method::RaysAndEmitters { rays: 8192 },
        method => method,
    };
    let memory = memory::limit(&args.common);
    let dense = Strategy { memory, omit: Omissions::ALL, ..Strategy::new(elements, method) };
    let Err(error) = admit(scene, &dense) else { return Ok(dense) };
    let RunError::Memory { needed, limit, alternative } = error else { return Err(error.into()) };
    let measured = |strategy: &&Strategy| !strategy.casts_rays() && Yardstick::admits(scene, strategy).is_ok();
    match alternative.filter(|other| !matches!(other.change, Change::Coarser(_))) {
        Some(other) if all.iter().any(|strategy| measured(&strategy)) => Ok(other.strategy),
        _ => {
            let smaller = coarser(scene, &dense, limit).map(|other| other.strategy.mesh.elements);
            let instead = match smaller {
                Some(Subdivision::Uniform(k)) if k >= 2 => format!("--subdivide {} fits", k / 2),
                _ => "`radiosity solve` needs none".to_owned(),
            };
            let (needed, limit) = (Bytes(needed), Bytes(limit));
            Err(format!("the reference of a comparison, twice as fine, takes about {needed} of memory, and there are {limit}; {instead}").into())
        }
    }
}

fn label(strategy: &Strategy) -> String {
    format!("{} · {} · {}", strategy.solver, strategy.store.name(), strategy.method.name())
}

fn line(compared: &Compared<'_>) -> String {
    match &compared.result {
        Ok(m) => format!(
            "{:<46} {:>10.4} {:>10.1e} {:>10.1e} {:>10.1e}  {}",
            label(&compared.strategy),
            m.run.seconds(),
            m.solver_error,
            m.form_factor_error,
            m.error.rms,
            m.run.solution.outcome
        ),
        Err(why) => format!("{:<46} not run: {why}", label(&compared.strategy)),
    }
}

fn compared_json(compared: &Compared<'_>) -> Value {
    let s = &compared.strategy;
    let mut object = json!({ "method": output::method(s.method), "store": s.store.name(), "solver": s.solver });
    match &compared.result {
        Ok(m) => {
            let solution = &m.run.solution;
            object["elements"] = json!(m.run.geometry.elements().len());
            object["outcome"] = json!(solution.outcome.to_string());
            object["steps"] = json!(solution.steps);
            object["form_factors"] = output::phase(&m.run.form_factors);
            object["solve"] = json!({
                "seconds": solution.time.as_secs_f64(), "counts": output::cost(&solution.cost),
            });
            object["stored_bytes"] = json!(m.run.stored_bytes);
            object["unshot"] = json!(solution.unshot);
            object["standard_error"] = json!(solution.standard_error);
            object["bound"] = json!(solution.bound());
            object["errors"] = json!({
                "solver": m.solver_error, "form_factors": m.form_factor_error, "mesh": m.mesh_error,
                "total": output::error(&m.error),
            });
        }
        Err(why) => object["not_run"] = json!(why.to_string()),
    }
    object
}

/// Error against time inside every run on the dense and the recomputed store, one panel an estimator.
fn figure(compared: &[Compared<'_>]) -> Figure {
    let panels = METHODS.map(|method| {
        let shown = compared.iter().filter(|c| {
            c.strategy.method.name() == method.name() && matches!(c.strategy.store, Store::Dense | Store::KeepNone)
        });
        let series = shown.filter_map(|c| {
            let m = c.result.as_ref().ok()?;
            let recomputed = c.strategy.store == Store::KeepNone;
            let name =
                if recomputed { format!("{}, recomputed", c.strategy.solver) } else { c.strategy.solver.clone() };
            let quality = match m.run.solution.outcome {
                Outcome::Converged => Quality::Good,
                Outcome::NotContracting | Outcome::Breakdown => Quality::Failed,
                _ => Quality::Limited,
            };
            let points = m.history.iter().map(|p| Point { x: p.seconds, y: p.error, quality });
            let dash = if recomputed { Dash::Dashed } else { Dash::Solid };
            Some(Series::new(name, &*c.strategy.solver).points(points).dash(dash))
        });
        let axes = (Axis::log("time", "s"), Axis::log("error of irradiance", "share of the mean"));
        Panel::new(axes.0, axes.1).title(method.name()).all_series(series)
    });
    Figure::new("comparison", "Error against time").panels(panels).shared_y()
}

fn write_table(args: &CompareArgs, compared: &[Compared<'_>]) -> Result<(), Failure> {
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record([
        "method",
        "store",
        "solver",
        "outcome",
        "steps",
        "seconds_form_factors",
        "seconds_solve",
        "form_factors",
        "rays",
        "hemicube_pixels",
        "entries_read",
        "stored_bytes",
        "solver_error",
        "form_factor_error",
        "error",
        "worst_cell",
        "worst_surface",
        "worst_i",
        "worst_j",
    ])?;
    for c in compared {
        let s = &c.strategy;
        let mut record = vec![s.method.name().to_owned(), s.store.name().to_owned(), s.solver.clone()];
        match &c.result {
            Ok(m) => {
                let (run, cost) = (&m.run, m.run.cost());
                record.push(run.solution.outcome.to_string());
                record.push(run.solution.steps.to_string());
                record.extend([run.form_factors.time, run.solution.time].map(|t| format!("{:.6}", t.as_secs_f64())));
                let counts = [cost.form_factors, cost.rays, cost.hemicube_pixels, cost.entries, run.stored_bytes];
                record.extend(counts.map(|n| n.to_string()));
                let errors = [m.solver_error, m.form_factor_error, m.error.rms, m.error.worst];
                record.extend(errors.map(|e| format!("{e:e}")));
                let at = m.error.worst_cell.map(|at| [at.surface, at.i, at.j].map(|index| index.to_string()));
                record.extend(at.unwrap_or_default());
            }
            Err(why) => {
                record.push(format!("not run: {why}"));
                record.resize(19, String::new());
            }
        }
        table.write_record(&record)?;
    }
    let bytes = table.into_inner().map_err(|e| e.to_string())?;
    write_atomically(&args.output.join("comparison.csv"), |out| out.write_all(&bytes))?;
    Ok(())
}
