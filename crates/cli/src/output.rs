//! What commands print: one JSON object, or lines for people.

use std::io::Write;
use std::path::Path;

use radiosity::{Bytes, ErrorMeasure, Forecasted, Method, Phase, Repair, Saving};
use radiosity_core::{Cost, Forecast};
use radiosity_form_factors::analytic::PartialVisibility;
use radiosity_form_factors::checks::{BlockedPairs, Checks};
use radiosity_io::ImportReport;
use radiosity_solvers::NAMES;
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
        Method::Analytic { tolerance, partial: PartialVisibility::Exact { tolerance: partial } } => {
            json!({ "name": method.name(), "tolerance": tolerance, "partial_tolerance": partial })
        }
        Method::Analytic { tolerance, partial: PartialVisibility::Rays { samples, .. } } => {
            json!({ "name": method.name(), "tolerance": tolerance, "samples": samples })
        }
        Method::RayCast { rays, error: Some(error) } => {
            json!({ "name": method.name(), "most_rays": rays, "row_error": error })
        }
        Method::RayCast { rays, error: None } | Method::RaysAndEmitters { rays } => {
            json!({ "name": method.name(), "rays": rays })
        }
        Method::Hemicube { resolution } => json!({ "name": method.name(), "resolution": resolution }),
    }
}

/// Names of rows and columns of a store in the file or table that is written.
pub type Names<'a> = [&'a dyn Fn(usize) -> usize; 2];

/// Checks as JSON.
pub fn checks(checks: &Checks, blocked: Option<&BlockedPairs>, [row, column]: Names<'_>) -> Value {
    let pair = |s: usize, t: usize| json!([row(s), column(t)]);
    json!({
        "row_sums": checks.row_sums.map(|r| json!({ "smallest": r.smallest, "largest": r.largest, "mean": r.mean })),
        "worst_rows": checks.worst_rows.iter().map(|&(s, sum)| json!({ "row": row(s), "row_sum": sum })).collect::<Vec<_>>(),
        "rows_above_1": checks.rows_above_one,
        "closure": checks.closure.map(|(s, off)| json!({ "row": row(s), "row_sum_minus_1": off })),
        "largest_row_sum": checks.largest_row_sum.map(|(s, sum)| json!({ "row": row(s), "row_sum": sum })),
        "reciprocity": checks.reciprocity.map(|(s, t, error)| json!({ "pair": pair(s, t), "error": error })),
        "largest_share_of_smaller_area": checks.largest_share.map(|(s, t, share)| json!({ "pair": pair(s, t), "share": share })),
        "entries_above_area": checks.above_area,
        "entries_above_1": checks.above_one,
        "negative_entries": checks.negative,
        "blocked": blocked.map(|b| json!({
            "pairs_compared_with_unblocked": b.compared,
            "smaller": b.reduced,
            "larger": b.increased,
            "largest_excess": b.largest_excess.map(|(s, t, excess)| json!({ "pair": pair(s, t), "excess": excess })),
        })),
    })
}

/// Checks for people: the worst rows by name, and what else is wrong.
pub fn check_lines(
    checks: &Checks,
    blocked: Option<&BlockedPairs>,
    closed: bool,
    [row, column]: Names<'_>,
) -> Vec<String> {
    let deviation = |sum: f64| if closed { format!("1 {:+.1e}", sum - 1.0) } else { format!("{sum:.6}") };
    let worst: Vec<String> =
        checks.worst_rows.iter().map(|&(s, sum)| format!("{} ({})", row(s), deviation(sum))).collect();
    let kind = if closed { "closed scene: rows farthest from 1" } else { "open scene: largest row sums" };
    let mut lines = vec![format!("{kind}: {}", worst.join(", "))];
    let mut wrong = format!("{} rows above 1", checks.rows_above_one);
    if let Some((_, sum)) = checks.largest_row_sum.filter(|_| checks.rows_above_one > 0) {
        wrong += &format!(" (by up to {:.1e})", sum - 1.0);
    }
    wrong += &format!(
        ", {} entries above the smaller area, {} above 1, {} below 0",
        checks.above_area, checks.above_one, checks.negative
    );
    if let Some((s, t, error)) = checks.reciprocity {
        wrong += &format!("; worst reciprocity error {error:.1e}");
        if error > 0.0 {
            wrong += &format!(", pair ({}, {})", row(s), column(t));
        }
    }
    lines.push(wrong);
    if let Some(b) = blocked {
        let worst = b.largest_excess.filter(|_| b.increased > 0);
        lines.push(format!(
            "{} pairs compared with their unblocked values: {} smaller, {} larger{}",
            b.compared,
            b.reduced,
            b.increased,
            worst.map_or_else(String::new, |(s, t, e)| format!(", worst pair ({}, {}) by {e:.1e}", row(s), column(t)))
        ));
    }
    lines
}

/// A repair as JSON.
pub fn repair(repair: &Repair) -> Value {
    let s = &repair.scaling;
    json!({
        "kind": "symmetric scaling",
        "mean_of_both_directions_first": repair.symmetrised.is_some(),
        "largest_reciprocity_error_before": repair.symmetrised,
        "closure_before": s.closure_before,
        "closure_after": s.closure_after,
        "largest_relative_change": s.largest_relative_change,
        "rms_relative_change": s.rms_relative_change,
        "largest_change": s.largest_change,
        "newton_steps": s.steps,
        "seconds": repair.phase.time.as_secs_f64(),
    })
}

/// A repair for people.
pub fn repair_line(repair: &Repair) -> String {
    let s = &repair.scaling;
    let first = repair.symmetrised.map_or_else(String::new, |apart| {
        format!("the mean of both directions taken, which differed by up to {apart:.1e}; ")
    });
    format!(
        "repair: {first}row sums from within {:.1e} to within {:.1e} of 1; form factors change by up to {:.1e} of themselves (rms {:.1e}), by up to {:.1e} at most",
        s.closure_before, s.closure_after, s.largest_relative_change, s.rms_relative_change, s.largest_change
    )
}

/// Products of the store that a forecast spends.
pub const FORECAST: usize = 12;

/// Solvers of which steps to η = `unshot` can be forecast, with least and most.
fn forecast_steps(forecast: &Forecast, unshot: f64) -> Vec<(&'static str, (f64, f64))> {
    NAMES.into_iter().filter_map(|name| Some((name, forecast.steps(name, unshot)?))).collect()
}

/// A forecast as JSON; what is infinite is null.
pub fn forecast(forecasted: &Forecasted, unshot: f64) -> Value {
    let f = &forecasted.forecast;
    let steps = forecast_steps(f, unshot)
        .into_iter()
        .map(|(name, (least, most))| (name.to_owned(), json!({ "least": least, "most": most })));
    json!({
        "contraction": f.contraction,
        "spectral_radius": [f.radius.0, f.radius.1],
        "condition": f.condition().map(|c| c.0),
        "condition_bound": f.condition().map(|c| c.1),
        "unshot": unshot,
        "steps": steps.collect::<serde_json::Map<_, _>>(),
        "products": f.products(),
        "counts": cost(&forecasted.cost),
        "seconds": forecasted.time.as_secs_f64(),
    })
}

/// A forecast for people.
pub fn forecast_line(forecasted: &Forecasted, unshot: f64) -> String {
    let f = &forecasted.forecast;
    let count = |steps: f64| if steps.is_finite() { format!("{:.0}", steps.ceil()) } else { "no end".to_owned() };
    let steps = forecast_steps(f, unshot).into_iter().map(|(name, (least, most))| match name {
        "cg" | "deflated-cg" => format!("{name} at most {}", count(most)),
        _ if count(least) == count(most) => format!("{name} {}", count(most)),
        _ => format!("{name} {} to {}", count(least), count(most)),
    });
    let condition = f.condition().map_or_else(String::new, |(estimate, bound)| {
        format!(", condition number about {estimate:.3e}, at most {bound:.3e}")
    });
    format!(
        "forecast from {} products: q = {:.6}, spectral radius {:.6} to {:.6}{condition}; steps to η = {unshot:.0e}: {}",
        f.products(),
        f.contraction,
        f.radius.0,
        f.radius.1,
        steps.collect::<Vec<_>>().join(", ")
    )
}

/// What solving again after a change saved, as JSON; `before` is the file solved first.
pub fn saving(before: &Path, saving: &Saving) -> Value {
    json!({
        "before": before.display().to_string(),
        "recoloured_faces": saving.change.recoloured,
        "moved_faces": saving.change.moved,
        "form_factors": { "computed": saving.form_factors, "of": saving.of_form_factors },
        "rows": { "computed": saving.rows, "of": saving.of_rows },
        "steps": saving.steps,
    })
}

/// An error as JSON.
pub fn error(error: &ErrorMeasure) -> Value {
    json!({
        "rms": error.rms,
        "worst_cell": error.worst,
        "worst_cell_at": error.worst_cell.map(|at| json!({ "surface": at.surface, "i": at.i, "j": at.j })),
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

/// Largest memory that the program has held so far, in bytes (VmHWM); `None` where the system does not say.
pub fn peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse().ok().map(|kilobytes: u64| 1024 * kilobytes)
}

/// `1.2 MB` for people.
pub fn bytes(bytes: u64) -> String {
    Bytes(bytes).to_string()
}
