//! The program `radiosity`: form factors, solutions, pictures and comparisons of people's own scenes.
//!
//! Exit codes: 0 done, 1 a check failed, 2 bad usage or input.

mod args;
mod cells;
mod choice;
mod compare;
mod false_colour;
mod film_state;
mod form_factors;
mod from_point;
mod inspect;
mod memory;
mod output;
mod plan;
mod render;
mod saved;
mod scene;
mod sidecar;
mod solve;
mod viewpoint;

use std::process::ExitCode;

use clap::Parser;

use args::{Args, Command};

/// How a command that could run ended.
pub enum Verdict {
    /// Everything asked for was done.
    Done,
    /// The work was done, but a check failed.
    CheckFailed,
}

/// An error on its way to the user: one sentence that says where and what to do.
type Failure = Box<dyn std::error::Error + Send + Sync>;

fn main() -> ExitCode {
    let args = Args::parse();
    let threads = args.common().threads;
    let work = move || match &args.command {
        Command::FormFactors(args) => form_factors::run(args),
        Command::Solve(args) => solve::run(args),
        Command::Render(args) => render::run(args),
        Command::Compare(args) => compare::run(args),
        Command::Inspect(args) => inspect::run(args),
    };
    // A pool of our own, so that nothing global is set up.
    let result = match rayon::ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0)).build() {
        Ok(pool) => pool.install(work),
        Err(error) => Err(format!("cannot start {} threads: {error}", threads.unwrap_or(0)).into()),
    };
    match result {
        Ok(Verdict::Done) => ExitCode::SUCCESS,
        Ok(Verdict::CheckFailed) => ExitCode::from(1),
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}
