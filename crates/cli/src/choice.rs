//! A choice of strategy for people and for scripts: the ranking, and predictions beside what happened.

use std::time::Instant;

use radiosity::choice::{Choice, ChoiceError, Expected, Named, Pilot, Ranked, Reached, Wanted, WhyNot};
use radiosity::{Constants, RunError, Store};
use radiosity_geometry::{Occluders, Scene};
use radiosity_io::write_atomically;
use serde_json::{Value, json};

use crate::args::{CompareArgs, SolveArgs};
use crate::solve::{HIERARCHICAL, MOST_ELEMENTS, REPORT_GRID};
use crate::{Failure, Verdict, memory, output};

/// What the arguments want, if it is something to choose a strategy for.
pub fn wanted(args: &SolveArgs, scene: &Scene) -> Option<Wanted> {
    let budget = args.tolerance.is_some() || args.time.is_some();
    // Patches of one's own are where an adaptive run begins, and a repair is made of whole matrices.
    let own = args.repair || args.mesh.patch_subdivide.is_some();
    // Candidates are ways to the error of all surfaces.
    let bounded = !args.plan.ask.is_empty() || args.thin_error.is_some() || args.bounce_error.is_some();
    if !budget || own || bounded {
        return None;
    }
    let by_links = args.solver.as_deref() == Some(HIERARCHICAL);
    let store = match args.store {
        _ if by_links => Some(Store::HIERARCHICAL),
        store => store.map(Store::from),
    };
    let method = args.estimator.named(Occluders::blocking(scene).len());
    let solver = args.solver.clone().filter(|_| !by_links);
    Some(Wanted {
        tolerance: args.tolerance,
        report_grid: args.report_grid.unwrap_or(REPORT_GRID),
        time: args.time,
        memory: memory::limit(&args.common).map(|limit| limit.saturating_sub(memory::program())),
        most_elements: MOST_ELEMENTS,
        seed: args.common.seed,
        named: Named { method, store, link_error: args.link_error, solver },
    })
}

/// The choice for what is wanted, by constants measured on the scene if that is asked for; `None` if no candidate agrees with what is named.
pub fn choose(args: &SolveArgs, scene: &Scene, wanted: &Wanted) -> Result<Option<Choice>, Failure> {
    let constants = if args.calibrate {
        Constants::measured_on(scene, wanted.seed).map_err(memory::explained)?
    } else {
        Constants::default()
    };
    match Choice::new(scene, wanted, &constants) {
        Ok(choice) => Ok(Some(choice)),
        Err(ChoiceError::NoneAgrees) if wanted.tolerance.is_some() => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// What happened beside what was expected of it.
pub struct Happened {
    seconds: f64,
    stored_bytes: u64,
    error: f64,
    elements: usize,
}

impl Happened {
    fn json(&self) -> Value {
        json!({
            "seconds": self.seconds, "stored_bytes": self.stored_bytes, "error": self.error, "elements": self.elements,
        })
    }

    /// Of a procedure that took so many seconds.
    pub fn new(reached: &Reached<'_>, seconds: f64) -> Self {
        Self {
            seconds,
            stored_bytes: reached.run.stored_bytes,
            error: reached.steps.estimate(),
            elements: reached.run.geometry.elements().len(),
        }
    }
}

/// The choice as JSON.
pub fn json(choice: &Choice, happened: Option<&Happened>) -> Value {
    let Pilot { surfaces, blocking, closed, most_reflectance, emitters, cells, elements, .. } = choice.pilot;
    json!({
        "chosen": choice.chosen().candidate.name,
        "tolerance": choice.target.tolerance,
        "report_grid": choice.target.report_grid,
        "seconds": choice.time.as_secs_f64(),
        "pilot": {
            "faces": surfaces, "blocking_polygons": blocking, "closed": closed, "largest_reflectance": most_reflectance,
            "exact_emitters": emitters, "subdivision": cells, "elements": elements,
            "senders": choice.pilot.senders, "receivers": choice.pilot.receivers, "sweeps": choice.pilot.sweeps,
            "counts": output::cost(&choice.pilot.cost),
        },
        "predicted": expected(&choice.chosen().expected),
        "measured": happened.map(Happened::json),
        "ranking": choice.ranking.iter().map(ranked).collect::<Vec<_>>(),
    })
}

fn expected(expected: &Expected) -> Value {
    json!({
        "seconds": expected.seconds, "stored_bytes": expected.stored_bytes, "peak_bytes": expected.peak_bytes,
        "error": expected.error, "elements": expected.elements, "meshes": expected.rounds,
    })
}

fn ranked(ranked: &Ranked) -> Value {
    let strategy = &ranked.candidate.strategy;
    json!({
        "name": ranked.candidate.name,
        "method": output::method(strategy.method),
        "store": strategy.store.name(),
        "form": strategy.shape.name(),
        "solver": strategy.solver,
        "predicted": expected(&ranked.expected),
        "why_not": ranked.why_not.map(|why| why.to_string()),
    })
}

/// The ranking for people.
pub fn lines(choice: &Choice) -> Vec<String> {
    let heading = format!("{:<34} {:>9} {:>10} {:>9} {:>9}", "strategy", "seconds", "memory", "error", "elements");
    let line = |ranked: &Ranked| {
        let Expected { seconds, peak_bytes, error, elements, .. } = ranked.expected;
        let why = ranked.why_not.map_or_else(|| "chosen".to_owned(), |why| why.to_string());
        let memory = output::bytes(peak_bytes);
        format!("{:<34} {seconds:>9.4} {memory:>10} {error:>9.1e} {elements:>9}  {why}", ranked.candidate.name)
    };
    std::iter::once(heading).chain(choice.ranking.iter().map(line)).collect()
}

/// A candidate that was run, or why it was not.
struct Ran<'c> {
    ranked: &'c Ranked,
    result: Result<(Happened, bool), RunError>,
}

/// `radiosity compare --tolerance`: runs the candidates in the order of their ranking.
pub fn compare(args: &CompareArgs, scene: &Scene, tolerance: f64) -> Result<Verdict, Failure> {
    let memory = memory::limit(&args.common).map(|limit| limit.saturating_sub(memory::program()));
    let wanted = Wanted { memory, seed: args.common.seed, ..Wanted::tolerance(tolerance) };
    let choice = Choice::new(scene, &wanted, &Constants::default())?;
    if args.common.dry_run {
        let object = json!({ "dry_run": true, "choice": json(&choice, None) });
        output::print(&args.common, &object, &lines(&choice));
        return Ok(Verdict::Done);
    }
    let mut best = f64::INFINITY;
    let mut all: Vec<Ran<'_>> = Vec::new();
    // What is not expected to fit is not run.
    for ranked in choice.ranking.iter().filter(|r| matches!(r.why_not, None | Some(WhyNot::Slower))) {
        let clock = Instant::now();
        let go_on = &mut || clock.elapsed().as_secs_f64() < CUT_OFF * best;
        let reached = ranked.candidate.run(scene, &choice.target, go_on);
        let seconds = clock.elapsed().as_secs_f64();
        let result = reached.map(|reached| (Happened::new(&reached, seconds), reached.met));
        best = if matches!(result, Ok((_, true))) { best.min(seconds) } else { best };
        all.push(Ran { ranked, result });
    }
    std::fs::create_dir_all(&args.output).map_err(|e| format!("{}: {e}", args.output.display()))?;
    let table = table(&all)?;
    write_atomically(&args.output.join("comparison.csv"), |out| out.write_all(&table))?;
    let mut object = json!({ "choice": json(&choice, None), "folder": args.output.display().to_string() });
    object["strategies"] = all.iter().map(ran_json).collect::<Vec<_>>().into();
    let heading = ["predicted", "seconds", "predicted", "memory", "estimate"];
    let mut lines =
        vec![heading.into_iter().fold(format!("{:<34}", "strategy"), |line, word| format!("{line} {word:>10}"))];
    lines.extend(all.iter().map(ran_line));
    lines.push(format!("→ {}", args.output.display()));
    output::print(&args.common, &object, &lines);
    Ok(Verdict::Done)
}

/// Times the best beyond which a run is cut off.
const CUT_OFF: f64 = 10.0;

fn ran_json(ran: &Ran<'_>) -> Value {
    let mut object = ranked(ran.ranked);
    match &ran.result {
        Ok((happened, met)) => {
            object["measured"] = happened.json();
            object["met"] = (*met).into();
        }
        Err(why) => object["not_run"] = why.to_string().into(),
    }
    object
}

fn ran_line(ran: &Ran<'_>) -> String {
    let (name, expected) = (ran.ranked.candidate.name, &ran.ranked.expected);
    match &ran.result {
        Ok((h, met)) => format!(
            "{name:<34} {:>10.4} {:>10.4} {:>10} {:>10} {:>10.1e}  {}",
            expected.seconds,
            h.seconds,
            output::bytes(expected.stored_bytes),
            output::bytes(h.stored_bytes),
            h.error,
            if *met { "met" } else { "cut off or not met" }
        ),
        Err(why) => format!("{name:<34} not run: {why}"),
    }
}

fn table(all: &[Ran<'_>]) -> Result<Vec<u8>, Failure> {
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record([
        "strategy",
        "predicted_seconds",
        "seconds",
        "predicted_bytes",
        "stored_bytes",
        "estimate",
        "met",
    ])?;
    for ran in all {
        let expected = &ran.ranked.expected;
        let mut record = vec![ran.ranked.candidate.name.to_owned(), format!("{:.6}", expected.seconds)];
        match &ran.result {
            Ok((h, met)) => record.extend([
                format!("{:.6}", h.seconds),
                expected.stored_bytes.to_string(),
                h.stored_bytes.to_string(),
                format!("{:e}", h.error),
                met.to_string(),
            ]),
            Err(why) => {
                record.push(format!("not run: {why}"));
                record.resize(7, String::new());
            }
        }
        table.write_record(&record)?;
    }
    Ok(table.into_inner().map_err(|e| e.to_string())?)
}

/// One line on the choice, and what became of its predictions.
pub fn line(choice: &Choice, happened: &Happened) -> String {
    let Ranked { candidate, expected, .. } = choice.chosen();
    format!(
        "chosen: {} (of {}, in {:.1} ms); predicted {:.3} s, {} of form factors, took {:.3} s, {}",
        candidate.name,
        choice.ranking.len(),
        1e3 * choice.time.as_secs_f64(),
        expected.seconds,
        output::bytes(expected.stored_bytes),
        happened.seconds,
        output::bytes(happened.stored_bytes)
    )
}
