//! `radiosity form-factors --from`: factors from a point with a normal to every row of a scene, exact.

use std::time::Instant;

use radiosity_form_factors::point::form_factors_from;
use radiosity_geometry::Polygon;
use radiosity_io::{MatrixFormat, MatrixView, write_matrix};
use serde_json::json;

use crate::args::{FormFactorsArgs, PointNormal};
use crate::cells::Cells;
use crate::form_factors::rows_json;
use crate::scene::Faces;
use crate::{Failure, Verdict, output, sidecar};

/// How visibility is decided, for the record.
const VISIBILITY: &str = "exact: what every blocker hides from the point is cut out of the faces, nothing is sampled";

/// Runs the command: a matrix of one row where a file is asked for, else a table.
pub fn run(args: &FormFactorsArgs, from: &PointNormal, faces: &Faces, cells: &Cells) -> Result<Verdict, Failure> {
    let scene = &faces.imported.scene;
    let n = cells.labels.len();
    if let Some(path) = args.output.as_deref().filter(|path| MatrixFormat::of(path).is_none()) {
        return Err(format!("{}: a row of factors ends in .csv, .mtx or .npy", path.display()).into());
    }
    if args.common.dry_run {
        let object = json!({ "dry_run": true, "cells": n });
        output::print(&args.common, &object, &[format!("{n} factors from a point; nothing written")]);
        return Ok(Verdict::Done);
    }
    let clock = Instant::now();
    // All faces, since the point may lie outside the room whose walls block nothing inside.
    let blockers: Vec<Polygon> = scene.pieces().map(|(_, piece)| piece.clone()).collect();
    let mut factors = form_factors_from(from.point, from.normal, &cells.cells, &blockers);
    factors.truncate(n);
    let seconds = clock.elapsed().as_secs_f64();
    let sum: f64 = factors.iter().sum();

    let mut object = rows_json(scene, &cells.labels, &cells.cells.areas()[..n], args.subdivide);
    object["scene"] = json!(args.common.scene.display().to_string());
    object["convention"] = json!("one row, from the point");
    object["from"] = json!({ "point": from.point.to_array(), "normal": from.normal.to_array() });
    object["method"] = json!({ "name": "point to polygon", "visibility": VISIBILITY });
    object["sum"] = json!(sum);
    let written = match &args.output {
        Some(path) => {
            write_matrix(path, MatrixView::new(1, n, &factors))?;
            object["file"] = json!(path.display().to_string());
            let mut beside = object.clone();
            beside["repair"] = json!(null);
            Some((path, sidecar::write(path, &beside)?))
        }
        None => None,
    };
    object["seconds"] = json!(seconds);
    object["form_factors"] = json!(factors);
    let lines = match &written {
        Some((path, _)) => vec![format!("{n} form factors from a point, sum {sum:.6} → {}", path.display())],
        None => vec![table(scene, cells, &factors)?.trim_end().to_owned()],
    };
    output::print(&args.common, &object, &lines);
    Ok(Verdict::Done)
}

/// One line a row: face, cell, name, factor.
fn table(scene: &radiosity_geometry::Scene, cells: &Cells, factors: &[f64]) -> Result<String, Failure> {
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record(["surface", "i", "j", "name", "form_factor"])?;
    for (label, factor) in cells.labels.iter().zip(factors) {
        let name = scene.surfaces[label.surface as usize].name.clone();
        let number = |k: u32| k.to_string();
        table.write_record([number(label.surface), number(label.i), number(label.j), name, format!("{factor:?}")])?;
    }
    Ok(String::from_utf8(table.into_inner().map_err(|e| e.to_string())?)?)
}
