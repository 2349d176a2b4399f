//! `radiosity form-factors`: the matrix F_ij between the cells of a scene, row = from.

use std::path::Path;
use std::time::Instant;

use radiosity::{Method, cell_form_factors};
use radiosity_core::FormFactors;
use radiosity_form_factors::checks::{Checks, check};
use radiosity_form_factors::stores::DenseFormFactors;
use radiosity_geometry::{Occluders, Scene};
use radiosity_io::{MatrixFormat, MatrixView, View3dFactors, WriteError, write_matrix, write_view3d};
use serde_json::{Value, json};

use crate::args::FormFactorsArgs;
use crate::cells::{Cells, Label};
use crate::scene::Faces;
use crate::{Failure, Verdict, from_point, output, scene, sidecar};

/// Whether `path` names View3D's text layout.
fn is_view3d(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    matches!(extension.as_deref(), Some("vf" | "txt"))
}

/// Runs the command.
pub fn run(args: &FormFactorsArgs) -> Result<Verdict, Failure> {
    if let Some(path) = args.output.as_deref().filter(|path| MatrixFormat::of(path).is_none() && !is_view3d(path)) {
        return Err(format!("{}: a matrix file ends in .csv, .mtx, .npy, .vf or .txt", path.display()).into());
    }
    let faces = scene::faces_only(&args.common)?;
    if args.subdivide > 1 && combined(&faces.rows) && !args.common.quiet {
        eprintln!("warning: combined surfaces are rows of their own when subdivided");
    }
    let cells = Cells::new(&faces.imported.scene, &faces.rows, args.subdivide)?;
    match (&args.from, &args.output) {
        (Some(point), _) => from_point::run(args, point, &faces, &cells),
        (None, Some(path)) => matrix(args, &faces, &cells, path),
        (None, None) => Err("give --output for the matrix or --from for the factors from a point".into()),
    }
}

/// Whether faces share a row.
fn combined(rows: &[Option<usize>]) -> bool {
    let mut own: Vec<usize> = rows.iter().copied().flatten().collect();
    own.sort_unstable();
    own.windows(2).any(|pair| pair[0] == pair[1])
}

/// The whole matrix.
fn matrix(args: &FormFactorsArgs, faces: &Faces, cells: &Cells, path: &Path) -> Result<Verdict, Failure> {
    let scene = &faces.imported.scene;
    let (n, all) = (cells.labels.len(), cells.cells.len());
    let method = match args.estimator.method(Method::ANALYTIC) {
        Method::Analytic { tolerance, samples } => {
            // The flag, what the file asks for, the default.
            let tolerance = args.tolerance.or(faces.tolerance).unwrap_or(tolerance);
            Method::Analytic { tolerance, samples }
        }
        method => method,
    };
    let bytes = 8 * all as u64 * all as u64;
    if args.common.dry_run {
        let object = json!({
            "dry_run": true, "cells": n, "method": output::method(method),
            "predicted": { "form_factors": n * n, "bytes": bytes },
        });
        let line = format!("{n} rows by {}, {} in memory; nothing written", method.name(), output::bytes(bytes));
        output::print(&args.common, &object, &[line]);
        return Ok(Verdict::Done);
    }
    let blockers = Occluders::blocking(scene);
    let (store, phase) =
        cell_form_factors(&cells.cells, &cells.elements, &cells.cell, &blockers, method, args.common.seed)?;
    // Checks, in which what only blocks counts as nothing, and the matrix F_ij = A_i F_ij / A_i.
    let mut areas = cells.cells.areas();
    areas[n..].fill(0.0);
    let clock = Instant::now();
    let checks = check(&store, &areas, &areas, faces.closed)?;
    let mut values = vec![0.0; n * n];
    for (s, row) in values.chunks_exact_mut(n.max(1)).enumerate() {
        let area = areas[s];
        if area > 0.0 {
            row.iter_mut().enumerate().for_each(|(t, f)| *f = store.entry(s, t) / area);
        }
    }
    let view = MatrixView::new(n, n, &values);
    if is_view3d(path) {
        let emittances: Vec<f64> = cells.labels.iter().map(|label| emittance(faces, label)).collect();
        let (areas, enclosure) = (&areas[..n], faces.closed);
        write_view3d(path, &View3dFactors { areas, emittances: &emittances, enclosure, factors: view })?;
    } else {
        write_matrix(path, view)?;
    }
    let beside = write_sidecar(args, faces, cells, path, method, &store, &checks)?;
    let written = clock.elapsed();
    let object = json!({
        "cells": n,
        "file": path.display().to_string(),
        "sidecar": beside,
        "convention": "row = from",
        "method": output::method(method),
        "form_factors": output::phase(&phase),
        "seconds_checks_and_file": written.as_secs_f64(),
        "stored_bytes": store.properties().stored_bytes,
        "closed": faces.closed,
        "checks": checks_json(&checks),
        "scene": output::import(&faces.imported.report),
    });
    let lines = [
        format!(
            "{n} × {n} form factors by {} in {:.3} s → {}",
            method.name(),
            phase.time.as_secs_f64(),
            path.display()
        ),
        match checks.closure {
            Some((row, difference)) => format!("closed scene: worst row sum − 1 is {difference:.1e}, row {row}"),
            None => format!("open scene: largest row sum {:.6}", checks.largest_row_sum.map_or(0.0, |(_, sum)| sum)),
        },
        format!("worst reciprocity error {:.1e}", checks.reciprocity.map_or(0.0, |(_, _, error)| error)),
    ];
    output::print(&args.common, &object, &lines);
    Ok(Verdict::Done)
}

/// Emittance of the row that a cell belongs to.
fn emittance(faces: &Faces, label: &Label) -> f64 {
    faces.rows[label.surface as usize].map_or(1.0, |row| faces.emittances[row])
}

/// What rows stand for: names, faces, and cells where faces are subdivided.
pub fn rows_json(scene: &Scene, cells: &Cells, subdivide: u32) -> Value {
    let labels = &cells.labels;
    let names: Vec<&str> = labels.iter().map(|l| scene.surfaces[l.surface as usize].name.as_str()).collect();
    let surfaces: Vec<u32> = labels.iter().map(|l| l.surface).collect();
    let mut object = json!({ "names": names, "surfaces": surfaces, "areas": cells.cells.areas()[..labels.len()] });
    if subdivide > 1 {
        object["cells"] = labels.iter().map(|l| json!([l.i, l.j])).collect();
    }
    object
}

/// The file beside the matrix that says what it holds; gives its path.
fn write_sidecar(
    args: &FormFactorsArgs,
    faces: &Faces,
    cells: &Cells,
    path: &Path,
    method: Method,
    store: &DenseFormFactors,
    checks: &Checks,
) -> Result<String, WriteError> {
    let tolerance = if let Method::Analytic { tolerance, .. } = method { Some(tolerance) } else { None };
    let bound = |s: usize| {
        let area = cells.cells.area(s);
        // A face without an area has a row of zeros, which is exact.
        store.row_bound(s).map(|bound| if area > 0.0 { bound / area } else { 0.0 })
    };
    let mut object = rows_json(&faces.imported.scene, cells, args.subdivide);
    object["file"] = json!(path.display().to_string());
    object["scene"] = json!(args.common.scene.display().to_string());
    object["convention"] = json!("row = from");
    object["rows"] = json!(cells.labels.len());
    object["subdivide"] = json!(args.subdivide);
    object["method"] = output::method(method);
    object["seed"] = json!(args.common.seed);
    object["tolerance"] = json!(tolerance);
    object["error_bound"] = (0..cells.labels.len()).map(bound).collect::<Vec<_>>().into();
    object["error_bound_of"] =
        json!("each form factor of the row; three standard errors where rays, pixels or visibility are sampled");
    object["closed"] = json!(faces.closed);
    object["checks"] = checks_json(checks);
    object["repair"] = Value::Null;
    Ok(sidecar::write(path, &object)?.display().to_string())
}

fn checks_json(checks: &Checks) -> Value {
    json!({
        "closure": checks.closure.map(|(row, difference)| json!({ "row": row, "row_sum_minus_1": difference })),
        "largest_row_sum": checks.largest_row_sum.map(|(row, sum)| json!({ "row": row, "row_sum": sum })),
        "reciprocity": checks.reciprocity.map(|(s, t, error)| json!({ "pair": [s, t], "error": error })),
        "entries_above_area": checks.above_area,
        "negative_entries": checks.negative,
    })
}
