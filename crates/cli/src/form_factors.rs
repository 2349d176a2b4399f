//! `radiosity form-factors`: the matrix F_ij between the cells of a scene, row = from.

use std::time::Instant;

use radiosity::{Method, cell_form_factors};
use radiosity_core::FormFactors;
use radiosity_form_factors::checks::{Checks, check};
use radiosity_geometry::mesh::{Mesh, MeshSettings, Subdivision};
use radiosity_geometry::{Facets, Occluders, Scene};
use radiosity_io::{MatrixFormat, MatrixView, write_matrix};
use serde_json::json;

use crate::args::FormFactorsArgs;
use crate::{Failure, Verdict, output, scene};

/// Cells of a scene: the rows of the matrix.
struct Cells {
    /// The polygons of every cell; none for a face without an area.
    cells: Facets,
    /// Every polygon alone, in the order of the cells.
    elements: Facets,
    /// Cell of every element.
    cell: Vec<u32>,
}

impl Cells {
    /// The cells of `scene`: its faces at K = 1, K² a quadrilateral or triangle otherwise.
    fn new(scene: &Scene, subdivide: u32) -> Result<Self, Failure> {
        let occluders = Occluders::of_scene(scene);
        let settings = MeshSettings { elements: Subdivision::Uniform(subdivide), patches: None, contacts: false };
        let mesh = Mesh::new(scene, &occluders, &settings)?;
        let (mut cells, mut elements, mut cell) = (Facets::new(), Facets::new(), Vec::new());
        let mut next = 0;
        for s in 0..scene.surfaces.len() as u32 {
            let begin = next;
            while mesh.elements.get(next).is_some_and(|e| e.surface == s) {
                next += 1;
            }
            if begin == next {
                // A face without an area keeps its rows, which are 0.
                (0..subdivide * subdivide).for_each(|_| cells.push(Vec::new(), false));
                continue;
            }
            // At K = 1 a face is one cell, whatever it is split into.
            let key = |e: usize| if subdivide == 1 { (0, 0) } else { (mesh.elements[e].i, mesh.elements[e].j) };
            let mut e = begin;
            while e < next {
                let mut polygons = Vec::new();
                let here = key(e);
                while e < next && key(e) == here {
                    polygons.push(mesh.element_facets.polygons(e)[0].clone());
                    elements.push(vec![mesh.element_facets.polygons(e)[0].clone()], false);
                    cell.push(cells.len() as u32);
                    e += 1;
                }
                cells.push(polygons, false);
            }
        }
        Ok(Self { cells, elements, cell })
    }
}

/// Runs the command.
pub fn run(args: &FormFactorsArgs) -> Result<Verdict, Failure> {
    if MatrixFormat::of(&args.output).is_none() {
        return Err(format!("{}: a matrix file ends in .csv, .mtx or .npy", args.output.display()).into());
    }
    let imported = scene::faces_only(&args.common)?;
    let scene = &imported.scene;
    let cells = Cells::new(scene, args.subdivide)?;
    let n = cells.cells.len();
    let method = match (args.estimator.method(Method::ANALYTIC), args.tolerance) {
        (Method::Analytic { samples, .. }, Some(tolerance)) => Method::Analytic { tolerance, samples },
        (method, _) => method,
    };
    let bytes = 8 * n as u64 * n as u64;
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
    // Checks and the matrix F_ij = A_i F_ij / A_i.
    let areas = cells.cells.areas();
    let closed = imported.report.closed();
    let clock = Instant::now();
    let checks = check(&store, &areas, &areas, closed)?;
    let mut values = vec![0.0; n * n];
    for (s, row) in values.chunks_exact_mut(n.max(1)).enumerate() {
        let area = areas[s];
        if area > 0.0 {
            row.iter_mut().enumerate().for_each(|(t, f)| *f = store.entry(s, t) / area);
        }
    }
    write_matrix(&args.output, MatrixView::new(n, n, &values))?;
    let written = clock.elapsed();
    let object = json!({
        "cells": n,
        "file": args.output.display().to_string(),
        "convention": "row = from",
        "method": output::method(method),
        "form_factors": output::phase(&phase),
        "seconds_checks_and_file": written.as_secs_f64(),
        "stored_bytes": store.properties().stored_bytes,
        "closed": closed,
        "checks": checks_json(&checks),
        "scene": output::import(&imported.report),
    });
    let lines = [
        format!(
            "{n} × {n} form factors by {} in {:.3} s → {}",
            method.name(),
            phase.time.as_secs_f64(),
            args.output.display()
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

fn checks_json(checks: &Checks) -> serde_json::Value {
    json!({
        "closure": checks.closure.map(|(row, difference)| json!({ "row": row, "row_sum_minus_1": difference })),
        "largest_row_sum": checks.largest_row_sum.map(|(row, sum)| json!({ "row": row, "row_sum": sum })),
        "reciprocity": checks.reciprocity.map(|(s, t, error)| json!({ "pair": [s, t], "error": error })),
        "entries_above_area": checks.above_area,
        "negative_entries": checks.negative,
    })
}
