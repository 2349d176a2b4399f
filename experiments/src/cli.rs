//! The command line of the runner.

use std::ffi::OsString;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use crate::experiment::{Experiment, Profile};
use crate::runner::{self, Request, State};
use radiosity_plot::numbers;

/// Differences of golden counts that are shown; more help nobody.
const SHOWN: usize = 10;

/// Runs the experiments and draws what they found.
#[derive(Debug, Parser)]
#[command(name = "experiments", version, about)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run experiments (all if none is named), draw them and write the page.
    Run(Run),
    /// Draw figures and page again from the tables alone.
    Plot {
        /// Directory of the results [default: results and results/quick, where they exist].
        #[arg(long, value_name = "DIR")]
        results: Option<PathBuf>,
    },
    /// Name the experiments and their questions.
    List,
}

#[derive(Args, Debug)]
struct Run {
    /// Experiments by name, number or slug: 01-patches, 01 or patches.
    names: Vec<String>,
    /// How much to spend: tiny takes seconds for all, quick about 15 s and full at most 15 minutes an experiment.
    #[arg(long, value_enum, default_value = "quick")]
    profile: Profile,
    /// Directory of the results [default: results for full, results/quick for quick, target/tiny for tiny].
    #[arg(long, value_name = "DIR")]
    results: Option<PathBuf>,
    /// Keep what is complete under the same profile, settings and threads.
    #[arg(long)]
    resume: bool,
    /// Compare the counts with those in DIR; exit code 1 if they differ.
    #[arg(long, value_name = "DIR")]
    check: Option<PathBuf>,
    /// Write the counts into the directory of --check instead of comparing.
    #[arg(long, requires = "check")]
    update: bool,
    /// Threads of the pool [default: one per core].
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// No progress bar, even on a terminal.
    #[arg(long)]
    no_progress: bool,
}

impl Default for Run {
    fn default() -> Self {
        Self {
            names: Vec::new(),
            profile: Profile::Quick,
            results: None,
            resume: false,
            check: None,
            update: false,
            threads: None,
            no_progress: false,
        }
    }
}

/// Does what `arguments` (the first is the program) ask with the experiments `all`.
///
/// Exit code 0: done; 1: an experiment failed or counts differ; 2: the arguments are wrong, nothing was touched.
pub fn main(all: &[&dyn Experiment], arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> ExitCode {
    ExitCode::from(execute(all, arguments))
}

fn execute(all: &[&dyn Experiment], arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> u8 {
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version come this way too; nothing can be done about a closed terminal.
            let _ = error.print();
            if error.use_stderr() {
                eprintln!("experiments: {}", names(all));
                return 2;
            }
            return 0;
        }
    };
    let root = workspace();
    match cli.command.unwrap_or_else(|| Command::Run(Run::default())) {
        Command::Run(run) => match choose(all, &run.names) {
            Ok(chosen) => execute_run(all, &chosen, &run, &root),
            Err(name) => {
                eprintln!("error: there is no experiment {name:?}; there are: {}", names(all));
                2
            }
        },
        Command::Plot { results } => plot(all, results, &root),
        Command::List => {
            all.iter().for_each(|e| println!("{:18} {}", e.name(), e.question()));
            0
        }
    }
}

fn names(all: &[&dyn Experiment]) -> String {
    if all.is_empty() { "none".into() } else { all.iter().map(|e| e.name()).collect::<Vec<_>>().join(", ") }
}

/// The experiments that are named, in their own order and once each; all if none is.
fn choose<'a>(all: &[&'a dyn Experiment], names: &[String]) -> Result<Vec<&'a dyn Experiment>, String> {
    let is = |experiment: &dyn Experiment, name: &str| {
        let (number, slug) = experiment.name().split_once('-').unwrap_or(("", experiment.name()));
        [experiment.name(), number, slug].contains(&name) && !name.is_empty()
    };
    match names.iter().find(|name| !all.iter().any(|e| is(*e, name))) {
        Some(unknown) => Err(unknown.clone()),
        None => Ok(all.iter().copied().filter(|e| names.is_empty() || names.iter().any(|name| is(*e, name))).collect()),
    }
}

/// The directory of the workspace, from the current one upwards; the current one if there is none.
fn workspace() -> PathBuf {
    let here = std::env::current_dir().unwrap_or_default();
    let is_root = |directory: &&Path| directory.join("experiments/Cargo.toml").is_file();
    here.ancestors().find(is_root).map_or_else(|| here.clone(), Path::to_path_buf)
}

fn execute_run(all: &[&dyn Experiment], chosen: &[&dyn Experiment], run: &Run, root: &Path) -> u8 {
    if let Some(threads) = run.threads {
        // Fails only where a pool exists already, which then has the threads it has; run.json records them.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.get()).build_global();
    }
    let default = || root.join(run.profile.pick("target/tiny", "results/quick", "results"));
    let request = Request {
        profile: run.profile,
        results: run.results.clone().unwrap_or_else(default),
        root: root.into(),
        resume: run.resume,
        progress: !run.no_progress,
    };
    if !run.resume {
        // References are kept so that experiments share them, not so that one outlives a change of what makes it.
        let _ = std::fs::remove_dir_all(request.results.join(crate::REFERENCES));
    }
    let mut code = 0;
    println!("{:18} {:>6} {:>14} {:>12}  state", "experiment", "runs", "not converged", "took");
    for experiment in chosen {
        let state = runner::run(*experiment, &request);
        let (manifest, text) = match &state {
            State::Done(manifest) => (Some(manifest), "done".to_string()),
            State::Kept(manifest) => (Some(manifest), kept(manifest, root)),
            State::Failed(error) => (None, format!("failed: {error}")),
        };
        match manifest {
            Some(m) => {
                let took = numbers::seconds(m.seconds);
                println!("{:18} {:>6} {:>14} {:>12}  {text}", experiment.name(), m.runs, m.failed, took);
            }
            None => println!("{:18} {:>6} {:>14} {:>12}  {text}", experiment.name(), "–", "–", "–"),
        }
        if manifest.is_none() {
            code = 1;
        } else if let Some(golden) = &run.check {
            code = code.max(check(*experiment, &request.results, golden, run.update));
        }
    }
    match runner::write_page(all, &request.results) {
        Ok(path) => println!("{}", path.display()),
        Err(error) => {
            eprintln!("error: the page could not be written: {error}");
            code = 1;
        }
    }
    code
}

/// Says so when the results that are kept come from another version of the source.
fn kept(manifest: &runner::Manifest, root: &Path) -> String {
    let now = crate::machine::Machine::here(root);
    let same = manifest.machine.commit == now.commit && !manifest.machine.modified && !now.modified;
    if same { "kept".into() } else { "kept, from another state of the source".into() }
}

fn check(experiment: &dyn Experiment, results: &Path, golden: &Path, update: bool) -> u8 {
    match runner::check(experiment, results, golden, update) {
        Ok(differences) if differences.is_empty() => 0,
        Ok(differences) => {
            eprintln!("{}: {} golden counts differ", experiment.name(), differences.len());
            differences.iter().take(SHOWN).for_each(|difference| eprintln!("  {difference}"));
            1
        }
        Err(error) => {
            eprintln!("error: {error}");
            1
        }
    }
}

fn plot(all: &[&dyn Experiment], results: Option<PathBuf>, root: &Path) -> u8 {
    let has_results = |directory: &Path| all.iter().any(|e| directory.join(e.name()).join(runner::MANIFEST).is_file());
    let directories = match results {
        Some(directory) => vec![directory],
        None => ["results", "results/quick"].map(|name| root.join(name)).to_vec(),
    };
    let directories: Vec<PathBuf> = directories.into_iter().filter(|directory| has_results(directory)).collect();
    if directories.is_empty() {
        eprintln!("error: there are no results to plot; run the experiments first, or name a directory with --results");
        return 2;
    }
    let mut code = 0;
    for directory in directories {
        match runner::redraw(all, &directory) {
            Ok(drawn) => println!("{}: {}", directory.join("index.html").display(), drawn.join(", ")),
            Err(error) => {
                eprintln!("error: {error}");
                code = 1;
            }
        }
    }
    code
}

#[cfg(test)]
mod tests;
