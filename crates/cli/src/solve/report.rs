//! What a run is written and told as.

use radiosity::plan::{Anyway, Off};
use radiosity::{Plan, Run, Shape, SpecularBy, Strategy};
use radiosity_core::Outcome;
use radiosity_io::Imported;
use serde_json::{Value, json};

use super::Way;
use super::files::write;
use super::from_file::{FromFile, method, method_name};
use super::refinement::Refinement;
use crate::args::SolveArgs;
use crate::output::Names;
use crate::{Failure, Verdict, choice, output, plan};

/// Writes and reports.
pub(super) fn finish(
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
    object["view"] = plan::view(&args.plan, &imported.scene)?.map(|view| view.json()).into();
    object["plan_off"] = plan_off(args, strategy, file, &way).into();
    let anyway = left_out_anyway(args, strategy, file, run, &way);
    object["left_out_anyway"] = plan::anyway_json(&anyway);
    let mut lines = summary(strategy, file, run);
    lines.extend(plan::anyway_line(&anyway));
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

/// What the run did not compute, planned or not; pairs are counted where all of them are of one mesh.
fn left_out_anyway(
    args: &SolveArgs,
    strategy: &Strategy,
    file: Option<&FromFile>,
    run: &Run<'_>,
    way: &Way<'_>,
) -> Vec<Anyway> {
    let scene = run.geometry.scene();
    let whole = matches!(way, Way::Straight(_)) && file.is_none();
    let mut left = Plan::new(scene, strategy).anyway(&run.geometry, strategy, whole.then_some(run));
    let rows = run.form_factors.cost.source_evaluations;
    left.extend(args.transport().left_out(scene, rows, Some(0)));
    left
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

/// Power emitted and absorbed, of every band.
fn power(run: &Run<'_>) -> (Vec<f64>, Vec<f64>) {
    let areas = run.geometry.elements().areas();
    let (e, rho) = (run.geometry.emission(), run.geometry.reflectance());
    let h = &run.solution.irradiance;
    // By what is asked for, and what that needed.
    let emitted = |b: usize| {
        let by_element = areas.iter().zip(e.band(b)).zip(h.band(b)).filter(|(_, h)| !h.is_nan());
        by_element.map(|((a, e), _)| a * e).sum()
    };
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
