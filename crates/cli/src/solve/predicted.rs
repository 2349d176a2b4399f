//! What is known of a run before it is made, for `--dry-run`.

use radiosity::bounded::Bounded;
use radiosity::plan::{Anyway, Savings, StoreReason};
use radiosity::{Geometry, Prediction, Size, Strategy, predict};
use serde_json::{Value, json};

use super::from_file::{FromFile, method, method_name};
use crate::args::SolveArgs;
use crate::{Verdict, output, plan};

/// What is known of a run that is not made.
pub(super) struct Foreseen {
    pub(super) prediction: Prediction,
    pub(super) savings: Savings,
    pub(super) anyway: Vec<Anyway>,
    pub(super) bounded: Vec<Bounded>,
    pub(super) reason: Option<StoreReason>,
}

impl Foreseen {
    /// A run that leaves nothing out.
    pub(super) fn whole(geometry: &Geometry<'_>, strategy: &Strategy) -> Self {
        let prediction = predict(&Size::of(geometry), strategy);
        Self { prediction, savings: Savings::default(), anyway: Vec::new(), bounded: Vec::new(), reason: None }
    }
}

/// Tells what is known, and makes nothing.
pub(super) fn dry_run(
    args: &SolveArgs,
    Foreseen { prediction, savings, anyway, bounded, reason }: Foreseen,
    strategy: &Strategy,
    file: Option<&FromFile>,
    program: u64,
) -> Verdict {
    let (mut object, line) = predicted(&prediction, strategy, file, program);
    object["left_out"] = plan::with_bounded(plan::json(&savings), &bounded);
    object["left_out_anyway"] = plan::anyway_json(&anyway);
    object["store_reason"] = reason.map(|reason| reason.to_string()).into();
    let mut lines = vec![line];
    lines.extend(reason.map(|reason| plan::store_line(strategy.store, reason)));
    lines.extend(plan::anyway_line(&anyway));
    lines.extend(plan::lines(&savings));
    lines.extend(bounded.iter().map(plan::bounded_line));
    output::print(&args.common, &object, &lines);
    Verdict::Done
}

fn predicted(p: &Prediction, strategy: &Strategy, file: Option<&FromFile>, program: u64) -> (Value, String) {
    let object = json!({
        "dry_run": true,
        "elements": p.elements, "patches": p.patches,
        "method": method(strategy, file), "store": strategy.store.name(), "solver": strategy.solver,
        "form": strategy.shape.name(),
        "predicted": {
            "form_factors": p.form_factors, "source_evaluations": p.source_evaluations, "rays": p.rays,
            "hemicube_pixels": p.hemicube_pixels, "stored_bytes": p.stored_bytes, "mesh_bytes": p.mesh_bytes,
            "peak_bytes": p.peak_bytes + program,
        },
    });
    let line = format!(
        "{} elements, {} patches; {} form factors by {} in {}, {} of memory in all, solver {}; nothing written",
        p.elements,
        p.patches,
        p.form_factors,
        method_name(strategy, file),
        output::bytes(p.stored_bytes),
        output::bytes(p.peak_bytes + program),
        strategy.solver
    );
    (object, line)
}
