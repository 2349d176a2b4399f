//! `radiosity solve`: radiosity and irradiance of every element or report cell.

use std::path::Path;

use radiosity::{Geometry, GridValues, Run, Shape, Strategy, ToleranceStep};
use radiosity::{default_method, predict, run as run_strategy, run_to_tolerance};
use radiosity_core::{BandValues, Outcome};
use radiosity_geometry::mesh::{MeshSettings, Subdivision};
use radiosity_io::{PlyFace, SolutionRow, write_ply, write_solution};
use radiosity_render::Exposure;
use serde_json::{Value, json};

use crate::args::{Estimator, MeshArgs, SolveArgs};
use crate::{Failure, Verdict, output, scene};

/// Largest number of elements that `--tolerance` refines to.
const MOST_ELEMENTS: usize = 40_000;

/// The mesh asked for; 4 × 4 elements a face if nothing is.
pub fn mesh_settings(mesh: &MeshArgs) -> MeshSettings {
    let elements = match (mesh.subdivide, mesh.element_size) {
        (Some(k), _) => Subdivision::Uniform(k),
        (None, Some(size)) => Subdivision::EdgeLength(size),
        (None, None) => Subdivision::Uniform(4),
    };
    MeshSettings { elements, patches: mesh.patch_subdivide.map(Subdivision::Uniform), contacts: true }
}

/// The strategy asked for, with what is not asked for chosen by the size of `geometry`.
pub fn strategy(geometry: &Geometry<'_>, mesh: MeshSettings, estimator: &Estimator, seed: u64) -> Strategy {
    let method = estimator.method(default_method(geometry.elements().len(), geometry.blockers().len()));
    let substructured = mesh.patches.is_some();
    let mut strategy = Strategy { mesh, seed, ..Strategy::new(Subdivision::Uniform(1), method) };
    if substructured {
        strategy.shape = Shape::ElementsToPatches;
        "gauss-seidel".clone_into(&mut strategy.solver);
    }
    strategy
}

/// Runs the command.
pub fn run(args: &SolveArgs) -> Result<Verdict, Failure> {
    let target = args.output.as_deref();
    if let Some(path) = target {
        format_of(path)?;
    }
    let imported = scene::with_materials(&args.common)?;
    let scene = &imported.scene;
    let mesh = mesh_settings(&args.mesh);
    let geometry = Geometry::new(scene, &mesh)?;
    let mut strategy = strategy(&geometry, mesh, &args.estimator, args.common.seed);
    strategy.unshot = args.unshot;
    if let Some(solver) = &args.solver {
        strategy.solver.clone_from(solver);
        if solver == "shooting" && strategy.shape == Shape::ElementsToPatches {
            strategy.shape = Shape::PatchesToElements;
        } else if matches!(solver.as_str(), "direct" | "cg") && strategy.shape == Shape::ElementsToPatches {
            strategy.shape = Shape::TwoLevel;
        }
    }
    strategy.check()?;
    if args.common.dry_run {
        let (object, line) = prediction(&geometry, &strategy);
        output::print(&args.common, &object, &[line]);
        return Ok(Verdict::Done);
    }
    drop(geometry);
    let (run, refinement) = match args.tolerance {
        Some(tolerance) => {
            let report_grid = args.report_grid.unwrap_or(8);
            let done = run_to_tolerance(scene, &strategy, tolerance, report_grid, MOST_ELEMENTS)?;
            (done.run, Some((done.steps, done.met)))
        }
        None => (run_strategy(scene, &strategy, &mut ())?, None),
    };
    if let Some(path) = target {
        write(path, &run, args.report_grid)?;
    }
    let mut object = report(&strategy, &run);
    object["scene"] = output::import(&imported.report);
    let mut lines = summary(&strategy, &run);
    let mut verdict = if run.solution.outcome == Outcome::Converged { Verdict::Done } else { Verdict::CheckFailed };
    if let Some((steps, met)) = refinement {
        object["refinement"] = refinement_json(&steps, met);
        let last = steps.last().and_then(|s| s.difference.as_ref()).map_or(f64::NAN, |d| d.rms);
        lines.push(format!(
            "estimated rms error of irradiance {last:.2e}; tolerance {}",
            if met { "met" } else { "not met" }
        ));
        if !met {
            verdict = Verdict::CheckFailed;
        }
    }
    if let Some(path) = target {
        lines.push(format!("→ {}", path.display()));
    }
    output::print(&args.common, &object, &lines);
    Ok(verdict)
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

fn prediction(geometry: &Geometry<'_>, strategy: &Strategy) -> (Value, String) {
    let p = predict(geometry, strategy);
    let object = json!({
        "dry_run": true,
        "elements": p.elements, "patches": p.patches,
        "method": output::method(strategy.method), "solver": strategy.solver, "form": strategy.shape.name(),
        "predicted": {
            "form_factors": p.form_factors, "source_evaluations": p.source_evaluations, "rays": p.rays,
            "hemicube_pixels": p.hemicube_pixels, "stored_bytes": p.stored_bytes,
        },
    });
    let line = format!(
        "{} elements, {} patches; {} form factors by {}, {} of memory, solver {}; nothing written",
        p.elements,
        p.patches,
        p.form_factors,
        strategy.method.name(),
        output::bytes(p.stored_bytes),
        strategy.solver
    );
    (object, line)
}

fn power(run: &Run<'_>) -> (Vec<f64>, Vec<f64>) {
    let areas = run.geometry.elements().areas();
    let (e, rho) = (run.geometry.emission(), run.geometry.reflectance());
    let h = &run.solution.irradiance;
    let emitted = |b: usize| areas.iter().zip(e.band(b)).map(|(a, e)| a * e).sum();
    let absorbed =
        |b: usize| areas.iter().zip(rho.band(b)).zip(h.band(b)).map(|((a, rho), h)| a * (1.0 - rho) * h).sum();
    ((0..e.count()).map(emitted).collect(), (0..e.count()).map(absorbed).collect())
}

fn report(strategy: &Strategy, run: &Run<'_>) -> Value {
    let (emitted, absorbed) = power(run);
    let s = &run.solution;
    json!({
        "elements": run.geometry.elements().len(),
        "patches": run.geometry.patches().len(),
        "covered_elements": run.geometry.mesh().elements.len() - run.geometry.elements().len(),
        "method": output::method(strategy.method),
        "form": strategy.shape.name(),
        "store": strategy.store.name(),
        "solver": strategy.solver,
        "outcome": s.outcome.to_string(),
        "steps": s.steps,
        "unshot": s.unshot,
        "contraction": s.contraction,
        "bound": s.bound,
        "meshing": output::phase(&run.meshing),
        "form_factors": output::phase(&run.form_factors),
        "solve": { "seconds": s.time.as_secs_f64(), "counts": output::cost(&s.cost) },
        "verification": output::cost(&s.verification),
        "stored_bytes": run.stored_bytes,
        "row_sums": run.row_sums.map(|r| json!({ "smallest": r.smallest, "largest": r.largest, "mean": r.mean })),
        "power": { "emitted": emitted, "absorbed": absorbed },
    })
}

fn refinement_json(steps: &[ToleranceStep], met: bool) -> Value {
    let steps: Vec<Value> = steps
        .iter()
        .map(|s| {
            json!({
                "subdivision": s.subdivision,
                "elements": s.elements,
                "difference": s.difference.as_ref().map(output::error),
            })
        })
        .collect();
    json!({ "met": met, "steps": steps })
}

fn summary(strategy: &Strategy, run: &Run<'_>) -> Vec<String> {
    let s = &run.solution;
    let (emitted, absorbed) = power(run);
    let (emitted, absorbed): (f64, f64) = (emitted.iter().sum(), absorbed.iter().sum());
    vec![
        format!(
            "{} elements, {} patches; form factors by {} in {:.3} s, {}",
            run.geometry.elements().len(),
            run.geometry.patches().len(),
            strategy.method.name(),
            run.form_factors.time.as_secs_f64(),
            output::bytes(run.stored_bytes)
        ),
        format!(
            "{} ({}): {}, {} steps in {:.3} s, unshot {:.1e}{}",
            strategy.solver,
            strategy.shape.name(),
            s.outcome,
            s.steps,
            s.time.as_secs_f64(),
            s.unshot,
            s.bound.map_or_else(|| ", no bound".to_owned(), |b| format!(", error of the solver at most {b:.1e}")),
        ),
        format!("power emitted {emitted:.6e}, absorbed {absorbed:.6e} (the rest leaves an open scene)"),
    ]
}

/// The band a column shows: of one band all three columns show it; further bands than three are not written.
fn three(values: &BandValues, at: usize) -> [f64; 3] {
    [0, 1, 2].map(|b| values.band(b.min(values.count() - 1))[at])
}

fn write(path: &Path, run: &Run<'_>, report_grid: Option<u32>) -> Result<(), Failure> {
    match format_of(path)? {
        Format::Csv => {
            let rows = match report_grid {
                Some(k) => cell_rows(run, k)?,
                None => element_rows(run),
            };
            write_solution(path, &rows)?;
        }
        Format::Ply => write_ply(path, &ply_faces(run))?,
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

fn ply_faces(run: &Run<'_>) -> Vec<PlyFace> {
    let mesh = run.geometry.mesh();
    let b = run.geometry.spread(&run.solution.radiosity);
    let values: Vec<[f64; 3]> = (0..mesh.elements.len()).map(|k| three(&b, k)).collect();
    // Lights are far brighter than what they light: white is what 2 % of the area exceeds.
    let exposure = Exposure::of_share(&values, &mesh.areas(), 0.98);
    let face = |(k, value): (usize, &[f64; 3])| PlyFace {
        vertices: mesh.element_facets.polygons(k)[0].vertices().to_vec(),
        surface: mesh.elements[k].surface,
        colour: exposure.colour(*value),
        radiosity: *value,
    };
    values.iter().enumerate().map(face).collect()
}
