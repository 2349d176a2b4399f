//! What a scene does not need, as the program says it, and the faces that are asked for.

use radiosity::Store;
use radiosity::plan::{Counts, LeftOut, Omissions, Savings, StoreReason};
use radiosity_geometry::Scene;
use serde_json::{Value, json};

use crate::Failure;
use crate::args::PlanArgs;

/// What may be left out.
pub fn omissions(args: &PlanArgs) -> Omissions {
    if args.keep_everything { Omissions::NONE } else { Omissions::ALL }
}

/// Indices of the faces asked for, ascending; `None` if all are.
pub fn asked(args: &PlanArgs, scene: &Scene) -> Result<Option<Vec<u32>>, Failure> {
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

/// A line for each thing left out.
pub fn lines(savings: &Savings) -> Vec<String> {
    let line = |left: &LeftOut| {
        let p = &left.predicted;
        let saved = [
            (Some(p.unknowns), "unknowns"),
            (p.form_factors, "form factors"),
            (p.rows, "rows"),
            (p.rays, "rays"),
            (Some(p.bands), "bands"),
        ];
        let saved = saved.into_iter().filter_map(|(count, what)| Some((count.filter(|n| *n > 0)?, what)));
        let saved: Vec<String> = saved.map(|(count, what)| format!("{count} {what}")).collect();
        let saved = if saved.is_empty() { String::new() } else { format!("; saves {}", saved.join(", ")) };
        format!("left out: {}: {}{saved}", left.what, left.omission.reason())
    };
    savings.list.iter().map(line).collect()
}
