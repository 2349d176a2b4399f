//! What a scene does not need, as the program says it, and the faces that are asked for.

use radiosity::plan::{Anyway, Counts, LeftOut, Omissions, Savings, StoreReason};
use radiosity::{Bounded, Run, Store, surfaces_in_view};
use radiosity_geometry::Scene;
use serde_json::{Value, json};

use crate::Failure;
use crate::args::PlanArgs;
use crate::viewpoint::Viewpoint;

/// What may be left out.
pub fn omissions(args: &PlanArgs) -> Omissions {
    if args.keep_everything { Omissions::NONE } else { Omissions::ALL }
}

/// The camera whose picture is asked for, if one is.
pub fn view(args: &PlanArgs, scene: &Scene) -> Result<Option<Viewpoint>, Failure> {
    args.ask_view.then(|| Viewpoint::new(&args.view, scene)).transpose()
}

/// Indices of the faces asked for, ascending: those named, those in view, or those that are both; `None` if all are.
pub fn asked(args: &PlanArgs, scene: &Scene) -> Result<Option<Vec<u32>>, Failure> {
    let named = named(args, scene)?;
    let Some(view) = view(args, scene)? else { return Ok(named) };
    let mut seen = surfaces_in_view(scene, &view.camera);
    seen.retain(|s| named.as_ref().is_none_or(|named| named.binary_search(s).is_ok()));
    if seen.is_empty() {
        let what = if named.is_some() { "none of the faces of --ask" } else { "no face" };
        return Err(
            format!("--ask-view: the camera shows the front of {what}; choose another --eye or --look-at").into()
        );
    }
    Ok(Some(seen))
}

/// Indices of the faces that --ask names.
fn named(args: &PlanArgs, scene: &Scene) -> Result<Option<Vec<u32>>, Failure> {
    if args.ask.is_empty() {
        return Ok(None);
    }
    let mut asked = Vec::new();
    for name in &args.ask {
        let index = name.parse::<usize>().ok().filter(|k| *k < scene.surfaces.len());
        let named = (0..scene.surfaces.len()).filter(|k| index == Some(*k) || scene.surfaces[*k].name == *name);
        let before = asked.len();
        asked.extend(named.map(|k| k as u32));
        if asked.len() == before {
            let last = scene.surfaces.len() - 1;
            return Err(format!("--ask {name}: no face is in a group of that name, and faces are 0 to {last}").into());
        }
    }
    asked.sort_unstable();
    asked.dedup();
    Ok(Some(asked))
}

fn counts(counts: &Counts) -> Value {
    json!({
        "unknowns": counts.unknowns,
        "form_factors": counts.form_factors,
        "rows": counts.rows,
        "rays": counts.rays,
        "bands": counts.bands,
    })
}

/// What is left out, one by one and in all.
pub fn json(savings: &Savings) -> Value {
    let one = |left: &LeftOut, measured: Option<Value>| {
        let predicted = counts(&left.predicted);
        json!({ "reason": left.omission.reason(), "what": left.what, "predicted": predicted, "measured": measured })
    };
    let measured = savings.measured.as_ref().map(counts);
    // Several together are measured together.
    let mut list: Vec<Value> = match &savings.list[..] {
        [alone] => vec![one(alone, measured.clone())],
        several => several.iter().map(|left| one(left, None)).collect(),
    };
    if list.len() > 1 {
        let predicted = counts(&savings.predicted);
        list.push(json!({ "reason": "all of these", "what": "in all", "predicted": predicted, "measured": measured }));
    }
    list.into()
}

/// The store that was chosen, and why.
pub fn store_line(store: Store, reason: StoreReason) -> String {
    format!("store {}: {reason}", store.name())
}

/// A line for each thing left out, and one on what all of them saved.
pub fn lines(savings: &Savings) -> Vec<String> {
    let line = |left: &LeftOut| {
        let saved = left.predicted.to_string();
        let saved = if saved.is_empty() { saved } else { format!("; saves {saved}") };
        format!("left out: {}: {}{saved}", left.what, left.omission.reason())
    };
    let mut lines: Vec<String> = savings.list.iter().map(line).collect();
    if let (Some(measured), false) = (&savings.measured, lines.is_empty()) {
        let predicted = &savings.predicted;
        lines.push(if predicted == measured {
            format!("saved: {measured}, as predicted")
        } else {
            format!("saved: {measured}; predicted: {predicted}")
        });
    }
    lines
}

/// What no run computes, planned or not: what geometry and estimators leave out.
pub fn anyway_json(left: &[Anyway]) -> Value {
    let one = |left: &Anyway| {
        let counts = |count: Option<u64>| count.map(|count| json!({ left.counted: count }));
        json!({
            "reason": left.reason, "what": left.what,
            "predicted": counts(left.predicted), "measured": counts(left.measured),
        })
    };
    left.iter().map(one).collect::<Vec<_>>().into()
}

/// The same in one line, but for what saves nothing.
pub fn anyway_line(left: &[Anyway]) -> Option<String> {
    let some: Vec<String> = left.iter().filter(|left| left.count() != Some(0)).map(Anyway::to_string).collect();
    (!some.is_empty()).then(|| format!("left out anyway: {}", some.join("; ")))
}

/// The list with what was left out within an error: with its bounds, before and after.
pub fn with_bounded(list: Value, bounded: &[Bounded]) -> Value {
    let Value::Array(mut list) = list else { return list };
    list.extend(bounded.iter().map(|omission| {
        let saved = |count: Option<u64>| count.map(|count| json!({ omission.counted: count }));
        json!({
            "reason": omission.reason,
            "what": omission.what,
            "predicted": saved(Some(omission.predicted)),
            "measured": saved(omission.measured),
            "bounded": { "before": omission.prior, "after": omission.bound },
        })
    }));
    list.into()
}

/// The line of one thing left out within an error.
pub fn bounded_line(omission: &Bounded) -> String {
    let Bounded { reason, what, counted, predicted, measured, prior, bound } = omission;
    // What refinement would have done is not known where it is led by points.
    let known = *predicted > 0 || measured.is_some();
    let measured = measured.filter(|count| count != predicted);
    let measured = measured.map_or_else(String::new, |count| format!(" ({count} in the end)"));
    let saves = if known { format!("saves {predicted} {counted}{measured}, ") } else { String::new() };
    let after = bound.map_or_else(String::new, |bound| format!(", {bound:.1e} in the end"));
    format!("left out: {what}: {reason}; {saves}error at most {prior:.1e}{after}")
}

/// A line for each thing left out within an error, and what all of them change.
pub fn bounded_lines(run: &Run<'_>) -> Vec<String> {
    let mut lines: Vec<String> = run.bounded.iter().map(bounded_line).collect();
    if let (Some(error), true) = (run.bounded_error(), run.bounded.len() > 1) {
        lines.push(format!("what is left out changes irradiance by at most {error:.1e} of its mean (rms)"));
    }
    lines
}
