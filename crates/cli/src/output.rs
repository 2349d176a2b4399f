//! What commands print: one JSON object, or lines for people.

use std::io::Write;

use radiosity::{ErrorMeasure, Method, Phase};
use radiosity_core::Cost;
use radiosity_io::ImportReport;
use serde_json::{Value, json};

use crate::args::Common;

/// Prints `object` if JSON was asked for, else `lines` unless quiet.
pub fn print(common: &Common, object: &Value, lines: &[String]) {
    let mut out = std::io::stdout().lock();
    // A reader that has seen enough closes the pipe: the work is done all the same.
    let _ = if common.json {
        writeln!(out, "{object}")
    } else if common.quiet {
        Ok(())
    } else {
        lines.iter().try_for_each(|line| writeln!(out, "{line}"))
    };
}

/// Counts as JSON.
pub fn cost(cost: &Cost) -> Value {
    json!({
        "form_factors": cost.form_factors,
        "source_evaluations": cost.source_evaluations,
        "rays": cost.rays,
        "hemicube_pixels": cost.hemicube_pixels,
        "pairs": { "clear": cost.clear_pairs, "hidden": cost.hidden_pairs, "partial": cost.partial_pairs },
        "entries_read": cost.entries,
        "flops": cost.flops,
        "bytes_read": cost.bytes,
    })
}

/// A phase as JSON.
pub fn phase(phase: &Phase) -> Value {
    json!({ "seconds": phase.time.as_secs_f64(), "counts": cost(&phase.cost) })
}

/// An estimator with its settings as JSON.
pub fn method(method: Method) -> Value {
    match method {
        Method::Analytic { tolerance, samples } => {
            json!({ "name": method.name(), "tolerance": tolerance, "samples": samples })
        }
        Method::RayCast { rays } | Method::RaysAndEmitters { rays } => json!({ "name": method.name(), "rays": rays }),
        Method::Hemicube { resolution } => json!({ "name": method.name(), "resolution": resolution }),
    }
}

/// An error as JSON.
pub fn error(error: &ErrorMeasure) -> Value {
    json!({
        "rms": error.rms,
        "worst_cell": error.worst,
        "mean_irradiance": error.level,
        "bias_per_surface": error.biases.iter().map(|b| json!({ "surface": b.surface, "bias": b.bias })).collect::<Vec<_>>(),
    })
}

/// What was met in a scene file as JSON.
pub fn import(report: &ImportReport) -> Value {
    json!({
        "vertices": report.vertices,
        "faces": report.faces,
        "triangles": report.triangles,
        "quadrilaterals": report.quads,
        "polygons": report.polygons,
        "most_corners": report.most_corners,
        "concave_split": report.concave_split,
        "non_planar_split": report.non_planar_split,
        "zero_area_dropped": report.zero_area_dropped,
        "duplicate_faces": report.duplicate_faces,
        "two_sided_sheets": report.two_sided_sheets,
        "repeated_dropped": report.repeated_dropped,
        "open_edges": report.open_edges,
        "turned_edges": report.turned_edges,
        "line_elements": report.line_elements,
        "point_elements": report.point_elements,
        "other_lines": report.other_lines,
        "libraries_not_found": report.libraries_not_found,
        "faces_without_material": report.faces_without_material,
        "materials_missing": report.materials_missing,
        "faces_of_missing_materials": report.faces_of_missing_materials,
        "materials_without_kd": report.materials_without_kd,
        "kd_at_least_1": report.kd_at_least_1,
        "kd_plus_ks_above_1": report.kd_ks_above_1,
        "clamped": report.clamped,
        "textures": report.textures.iter().map(|t| json!({
            "material": t.material, "key": t.key, "file": t.file, "found": t.found,
        })).collect::<Vec<_>>(),
        "specular_left_out": report.specular,
        "warnings": report.warnings,
    })
}

/// `1.2 MB` for people.
pub fn bytes(bytes: u64) -> String {
    match bytes as f64 {
        b if b >= 1e9 => format!("{:.2} GB", b / 1e9),
        b if b >= 1e6 => format!("{:.1} MB", b / 1e6),
        b if b >= 1e3 => format!("{:.1} kB", b / 1e3),
        b => format!("{b} B"),
    }
}
