//! Refinement to a tolerance, and what is told of it.

use radiosity::{Adaptive, ErrorEstimate, Goal, Round, Run, RunError, Shape, Store, Strategy, ToleranceStep};
use radiosity::{run_adaptive, run_to_tolerance};
use radiosity_geometry::Scene;
use serde_json::{Value, json};

use super::{MOST_ELEMENTS, REPORT_GRID, Way};
use crate::args::SolveArgs;
use crate::{output, plan};

/// How a mesh was refined to a tolerance, and whether that was met.
pub(super) enum Refinement {
    Adaptive(Vec<Round>, bool),
    Uniform(Vec<ToleranceStep>, bool),
}

impl Refinement {
    /// The last estimate of the error, and whether it met the tolerance.
    pub(super) fn result(&self) -> (f64, bool) {
        match self {
            Self::Adaptive(rounds, met) => (rounds.last().map_or(f64::NAN, |round| round.estimate.total()), *met),
            Self::Uniform(steps, met) => (steps.last().and_then(ToleranceStep::estimate).unwrap_or(f64::NAN), *met),
        }
    }

    pub(super) fn line(&self) -> String {
        let (estimate, met) = self.result();
        let met = if met { "met" } else { "not met" };
        format!("estimated rms error of irradiance {estimate:.2e}; tolerance {met}")
    }

    pub(super) fn json(&self) -> Value {
        let (estimate, met) = self.result();
        let steps: Vec<Value> = match self {
            Self::Adaptive(rounds, _) => rounds.iter().map(round_json).collect(),
            Self::Uniform(steps, _) => steps.iter().map(step_json).collect(),
        };
        let kind = if matches!(self, Self::Adaptive(..)) { "adaptive" } else { "uniform" };
        json!({ "kind": kind, "met": met, "estimate": estimate, "steps": steps })
    }
}

/// Refines where the error is, or everywhere alike if what is asked for works in the full form alone.
pub(super) fn to_tolerance<'a>(
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
    // Pairs are dropped in the full form.
    let whole = args.repair || args.thin_error.is_some() || strategy.store != Store::Dense;
    if whole || gathering.check().is_err() {
        let done = run_to_tolerance(scene, strategy, tolerance, report_grid, MOST_ELEMENTS)?;
        return Ok((done.run, Way::Refined(Refinement::Uniform(done.steps, done.met))));
    }
    // A picture shows points.
    let goal = if strategy.view.is_some() { Goal::Points } else { Goal::Cells(report_grid) };
    let mut adaptive = Adaptive { most_elements: MOST_ELEMENTS, ..Adaptive::new(goal, tolerance) };
    if let Some(cells) = args.mesh.patch_subdivide {
        adaptive = adaptive.from_cells(cells);
    }
    let done = run_adaptive(scene, &gathering, &adaptive)?;
    *strategy = Strategy { method: done.method, ..gathering };
    Ok((done.run, Way::Refined(Refinement::Adaptive(done.rounds, done.met))))
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
