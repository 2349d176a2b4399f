//! Solutions by the procedure that was chosen for a tolerance or a time.

use std::time::Instant;

use radiosity::Choice;
use radiosity::choice::Steps;
use radiosity_io::Imported;
use serde_json::json;

use super::Way;
use super::refinement::Refinement;
use super::report::finish;
use crate::args::SolveArgs;
use crate::choice::Happened;
use crate::{Failure, Verdict, choice, memory, output};

/// Follows the procedure that was chosen.
pub(super) fn on_chosen(args: &SolveArgs, imported: &Imported, choice: Choice) -> Result<Verdict, Failure> {
    if args.common.dry_run {
        let object = json!({ "dry_run": true, "choice": choice::json(&choice, None) });
        output::print(&args.common, &object, &choice::lines(&choice));
        return Ok(Verdict::Done);
    }
    let mut candidate = choice.chosen().candidate.clone();
    candidate.strategy.unshot = args.unshot.unwrap_or(candidate.strategy.unshot);
    candidate.strategy.steps = args.steps.into();
    let clock = Instant::now();
    let in_time = |seconds: f64| args.time.is_none_or(|time| seconds < time);
    let go_on = &mut || in_time(clock.elapsed().as_secs_f64());
    let reached = candidate.run(&imported.scene, &choice.target, go_on).map_err(memory::explained)?;
    let happened = Happened::new(&reached, clock.elapsed().as_secs_f64());
    let refinement = match reached.steps {
        Steps::Adaptive(rounds) => Refinement::Adaptive(rounds, reached.met),
        Steps::Uniform(steps) => Refinement::Uniform(steps, reached.met),
    };
    let way = Way::Chosen(Box::new(choice), happened, refinement);
    finish(args, imported, &reached.strategy, None, &reached.run, way)
}
