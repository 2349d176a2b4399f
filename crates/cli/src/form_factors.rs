//! `radiosity form-factors`: the matrix F_ij between the cells of a scene, row = from.

use std::path::Path;
use std::time::Instant;

use radiosity::{Geometry, Method, Phase, Repair, RunError, Store, Strategy};
use radiosity::{admit, cell_form_factors, coarser, mend_dense, rows};
use radiosity_core::{Form, FormFactors};
use radiosity_form_factors::analytic::PartialVisibility;
use radiosity_form_factors::checks::{BlockedPairs, Checks, check, check_blocked};
use radiosity_form_factors::repair::RepairError;
use radiosity_form_factors::stores::DenseFormFactors;
use radiosity_geometry::mesh::{MeshSettings, Subdivision};
use radiosity_geometry::{Facets, Occluders, Scene};
use radiosity_io::{MatrixFormat, MatrixView, View3dFactors, WriteError, write_matrix, write_view3d};
use serde_json::{Value, json};

use crate::args::FormFactorsArgs;
use crate::cells::{Cells, Label};
use crate::output::Names;
use crate::scene::Faces;
use crate::{Failure, Verdict, from_point, memory, output, scene, sidecar};

/// Whether `path` names View3D's text layout.
pub fn is_view3d(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    matches!(extension.as_deref(), Some("vf" | "txt"))
}

const NOTHING_ASKED: &str = "give --output for the matrix or --from for the factors from a point";

/// Runs the command.
pub fn run(args: &FormFactorsArgs) -> Result<Verdict, Failure> {
    if let Some(path) = args.output.as_deref().filter(|path| MatrixFormat::of(path).is_none() && !is_view3d(path)) {
        return Err(format!("{}: a matrix file ends in .csv, .mtx, .npy, .vf or .txt", path.display()).into());
    }
    let faces = scene::faces_only(&args.common)?;
    if let Some(point) = &args.from {
        return from_point::run(args, point, &faces, &cells(args, &faces)?);
    }
    if args.output.is_none() {
        return Err(NOTHING_ASKED.into());
    }
    check_repair(args, &faces)?;
    admitted(args, &faces.imported.scene)?;
    if args.contacts { of_elements(args, &faces) } else { of_cells(args, &faces) }
}

/// Refuses a matrix that would take too much memory; its only alternative is a smaller one. A dry run needs the mesh alone.
fn admitted(args: &FormFactorsArgs, scene: &Scene) -> Result<(), Failure> {
    let plain = Strategy::new(Subdivision::Uniform(args.subdivide), args.estimator.method(Method::ANALYTIC, 0));
    let store = if args.common.dry_run { Store::KeepNone } else { Store::Dense };
    let strategy = Strategy { store, memory: memory::limit(&args.common), ..plain };
    let refused = match admit(scene, &strategy) {
        Err(RunError::Memory { needed, limit, .. }) => {
            let alternative = coarser(scene, &strategy, limit).map(Box::new);
            Err(RunError::Memory { needed, limit, alternative })
        }
        other => other,
    };
    refused.map_err(memory::explained)
}

fn cells(args: &FormFactorsArgs, faces: &Faces) -> Result<Cells, Failure> {
    if args.subdivide > 1 && combined(&faces.rows) && !args.common.quiet {
        eprintln!("warning: combined surfaces are rows of their own when subdivided");
    }
    Cells::new(&faces.imported.scene, &faces.rows, args.subdivide)
}

/// Whether faces share a row.
fn combined(rows: &[Option<usize>]) -> bool {
    let mut own: Vec<usize> = rows.iter().copied().flatten().collect();
    own.sort_unstable();
    own.windows(2).any(|pair| pair[0] == pair[1])
}

/// Rows of a matrix file: what they stand for, and where their exchange areas are.
struct Layout {
    labels: Vec<Label>,
    /// Areas, also of what lies inside solids.
    areas: Vec<f64>,
    /// Row of the file of every row of the store; rows beyond only block.
    rows: Vec<usize>,
    /// Row of the store of every row of the file; `None` where there is nothing to exchange.
    of_store: Vec<Option<usize>>,
}

impl Layout {
    /// A row of the store is a row of the file as long as there are rows in the file.
    fn of_cells(cells: &Cells) -> Self {
        let n = cells.labels.len();
        let areas = cells.cells.areas()[..n].to_vec();
        Self { labels: cells.labels.clone(), areas, rows: (0..n).collect(), of_store: (0..n).map(Some).collect() }
    }

    /// The elements of the mesh that `solve` uses; those inside solids are rows of zeros.
    fn of_elements(geometry: &Geometry<'_>) -> Self {
        let mesh = geometry.mesh();
        let labels: Vec<Label> = mesh.elements.iter().map(|e| Label { surface: e.surface, i: e.i, j: e.j }).collect();
        let rows: Vec<usize> = geometry.exposed().iter().map(|&e| e as usize).collect();
        let mut of_store = vec![None; labels.len()];
        rows.iter().enumerate().for_each(|(k, &row)| of_store[row] = Some(k));
        Self { labels, areas: mesh.areas(), rows, of_store }
    }

    /// Sets row `row` of the file: F_st = A_s F_st / A_s.
    fn fill(&self, store: &DenseFormFactors, row: usize, values: &mut [f64]) {
        let (Some(s), true) = (self.of_store[row], self.areas[row] > 0.0) else { return };
        for (t, &column) in self.rows.iter().enumerate() {
            values[column] = store.entry(s, t) / self.areas[row];
        }
    }

    /// Bound of every entry of a row of the file; where there is nothing to exchange, 0 is exact.
    fn bound(&self, store: &DenseFormFactors, row: usize) -> Option<f64> {
        match self.of_store[row] {
            Some(s) if self.areas[row] > 0.0 => store.row_bound(s).map(|bound| bound / self.areas[row]),
            _ => Some(0.0),
        }
    }
}

/// A matrix with what was done to it and found out about it.
struct Made {
    store: DenseFormFactors,
    phase: Phase,
    repair: Option<Repair>,
    checks: Checks,
    blocked: Option<BlockedPairs>,
}

/// The estimator, with the tolerance of the flag, of the file, or by default.
fn method(args: &FormFactorsArgs, faces: &Faces, blocking: usize) -> Method {
    match args.estimator.method(Method::analytic_among(blocking), blocking) {
        Method::Analytic { tolerance, partial } => {
            let tolerance = args.tolerance.or(faces.tolerance).unwrap_or(tolerance);
            let partial = match (args.tolerance, partial) {
                (Some(tolerance), PartialVisibility::Exact { .. }) => PartialVisibility::Exact { tolerance },
                // As many segments as that takes, up to what the estimator allows: the bound says what is left.
                (Some(asked), PartialVisibility::Rays { samples, .. }) if args.estimator.samples.is_none() => {
                    PartialVisibility::Rays { samples, standard_error: asked / 3.0 }
                }
                (_, partial) => partial,
            };
            Method::Analytic { tolerance, partial }
        }
        method => method,
    }
}

/// Refuses a repair where row sums are not known.
fn check_repair(args: &FormFactorsArgs, faces: &Faces) -> Result<(), Failure> {
    if args.repair && !faces.closed {
        return Err(RepairError::Open.into());
    }
    if args.repair && !args.contacts && faces.rows.contains(&None) {
        return Err("surfaces that only block take light that has no column, so that the row sums to repair are not known; give them rows (S) or leave out --repair".into());
    }
    Ok(())
}

/// The matrix between the cells of the faces.
fn of_cells(args: &FormFactorsArgs, faces: &Faces) -> Result<Verdict, Failure> {
    let cells = cells(args, faces)?;
    let layout = Layout::of_cells(&cells);
    let blockers = Occluders::blocking(&faces.imported.scene);
    let method = method(args, faces, blockers.len());
    if args.common.dry_run {
        return Ok(dry_run(args, method, layout.labels.len(), cells.cells.len()));
    }
    let filled = cell_form_factors(&cells.cells, &cells.elements, &cells.cell, &blockers, method, args.common.seed)?;
    // What only blocks counts as nothing in checks.
    let mut areas = cells.cells.areas();
    areas[layout.labels.len()..].fill(0.0);
    let blocks = !blockers.is_empty();
    let made = finish(args, faces, filled, &areas, blocks.then_some(&cells.cells), method)?;
    write(args, faces, &layout, method, &made)
}

/// The matrix between the elements that `solve` uses.
fn of_elements(args: &FormFactorsArgs, faces: &Faces) -> Result<Verdict, Failure> {
    let elements = Subdivision::Uniform(args.subdivide);
    let settings = MeshSettings { elements, patches: None, contacts: true };
    let geometry = Geometry::new(&faces.imported.scene, &settings)?;
    let layout = Layout::of_elements(&geometry);
    let method = method(args, faces, geometry.blockers().len());
    if args.common.dry_run {
        return Ok(dry_run(args, method, layout.labels.len(), layout.rows.len()));
    }
    let clock = Instant::now();
    let rows = rows(&geometry, method, Form::Full, args.common.seed)?;
    let (store, cost) = DenseFormFactors::assemble(&*rows)?;
    let filled = (store, Phase { cost, time: clock.elapsed() });
    let blocks = !geometry.blockers().is_empty();
    let facets = blocks.then_some(geometry.elements());
    let made = finish(args, faces, filled, &geometry.elements().areas(), facets, method)?;
    write(args, faces, &layout, method, &made)
}

fn dry_run(args: &FormFactorsArgs, method: Method, n: usize, all: usize) -> Verdict {
    let bytes = 8 * all as u64 * all as u64;
    let object = json!({
        "dry_run": true, "cells": n, "method": output::method(method),
        "predicted": { "form_factors": n * n, "bytes": bytes },
    });
    let line = format!("{n} rows by {}, {} in memory; nothing written", method.name(), output::bytes(bytes));
    output::print(&args.common, &object, &[line]);
    Verdict::Done
}

/// Compares with unblocked values, repairs if that is asked for, and checks.
fn finish(
    args: &FormFactorsArgs,
    faces: &Faces,
    (mut store, phase): (DenseFormFactors, Phase),
    areas: &[f64],
    facets: Option<&Facets>,
    method: Method,
) -> Result<Made, Failure> {
    let blocked = match (facets, method) {
        (Some(facets), Method::Analytic { tolerance, .. }) => {
            let bound = |s: usize| store.row_bound(s).unwrap_or(f64::INFINITY);
            Some(check_blocked(&store, facets, &bound, tolerance)?)
        }
        _ => None,
    };
    let mut repair = None;
    if args.repair {
        let mended = mend_dense(store, areas, faces.closed)?;
        store = mended.0;
        repair = Some(mended.1);
    }
    let checks = check(&store, areas, areas, faces.closed)?;
    Ok(Made { store, phase, repair, checks, blocked })
}

/// Writes the matrix and the file beside it, row by row, and reports.
fn write(
    args: &FormFactorsArgs,
    faces: &Faces,
    layout: &Layout,
    method: Method,
    made: &Made,
) -> Result<Verdict, Failure> {
    let path = args.output.as_deref().ok_or(NOTHING_ASKED)?;
    let (n, clock) = (layout.labels.len(), Instant::now());
    let fill = |row: usize, values: &mut [f64]| layout.fill(&made.store, row, values);
    let view = MatrixView::by_rows(n, n, &fill);
    if is_view3d(path) {
        let emittances: Vec<f64> = layout.labels.iter().map(|label| emittance(faces, label)).collect();
        let (areas, enclosure) = (&layout.areas[..], faces.closed);
        write_view3d(path, &View3dFactors { areas, emittances: &emittances, enclosure, factors: view })?;
    } else {
        write_matrix(path, view)?;
    }
    let beside = write_sidecar(args, faces, layout, path, method, made)?;
    let Made { store, phase, repair, checks, blocked } = made;
    let row = |s: usize| layout.rows[s];
    let names: Names<'_> = [&row, &row];
    let object = json!({
        "cells": n,
        "file": path.display().to_string(),
        "sidecar": beside,
        "convention": "row = from",
        "method": output::method(method),
        "form_factors": output::phase(phase),
        "seconds_file": clock.elapsed().as_secs_f64(),
        "stored_bytes": store.properties().stored_bytes,
        "peak_bytes": output::peak_bytes(),
        "closed": faces.closed,
        "checks": output::checks(checks, blocked.as_ref(), names),
        "repair": repair.as_ref().map(output::repair),
        "scene": output::import(&faces.imported.report),
    });
    let seconds = phase.time.as_secs_f64();
    let mut lines = vec![format!("{n} × {n} form factors by {} in {seconds:.3} s → {}", method.name(), path.display())];
    lines.extend(repair.as_ref().map(output::repair_line));
    lines.extend(output::check_lines(checks, blocked.as_ref(), faces.closed, names));
    output::print(&args.common, &object, &lines);
    Ok(Verdict::Done)
}

/// Emittance of the row that a cell belongs to.
fn emittance(faces: &Faces, label: &Label) -> f64 {
    faces.rows[label.surface as usize].map_or(1.0, |row| faces.emittances[row])
}

/// What rows stand for: names, faces, and cells where faces are subdivided.
pub fn rows_json(scene: &Scene, labels: &[Label], areas: &[f64], subdivide: u32) -> Value {
    let names: Vec<&str> = labels.iter().map(|l| scene.surfaces[l.surface as usize].name.as_str()).collect();
    let surfaces: Vec<u32> = labels.iter().map(|l| l.surface).collect();
    let mut object = json!({ "names": names, "surfaces": surfaces, "areas": areas });
    if subdivide > 1 {
        object["cells"] = labels.iter().map(|l| json!([l.i, l.j])).collect();
    }
    object
}

/// The file beside the matrix that says what it holds; gives its path.
fn write_sidecar(
    args: &FormFactorsArgs,
    faces: &Faces,
    layout: &Layout,
    path: &Path,
    method: Method,
    made: &Made,
) -> Result<String, WriteError> {
    let tolerance = if let Method::Analytic { tolerance, .. } = method { Some(tolerance) } else { None };
    let (n, row) = (layout.labels.len(), |s: usize| layout.rows[s]);
    let mut object = rows_json(&faces.imported.scene, &layout.labels, &layout.areas, args.subdivide);
    object["file"] = json!(path.display().to_string());
    object["scene"] = json!(args.common.scene.display().to_string());
    object["convention"] = json!("row = from");
    object["rows"] = json!(n);
    object["subdivide"] = json!(args.subdivide);
    object["contacts"] = json!(args.contacts);
    object["method"] = output::method(method);
    object["seed"] = json!(args.common.seed);
    object["tolerance"] = json!(tolerance);
    object["error_bound"] = (0..n).map(|row| layout.bound(&made.store, row)).collect::<Vec<_>>().into();
    object["error_bound_of"] =
        json!("each form factor of the row; three standard errors where rays, pixels or visibility are sampled");
    object["closed"] = json!(faces.closed);
    object["checks"] = output::checks(&made.checks, made.blocked.as_ref(), [&row, &row]);
    object["repair"] = made.repair.as_ref().map(output::repair).into();
    Ok(sidecar::write(path, &object)?.display().to_string())
}
