//! Runs experiments, draws them from their tables, checks their counts.

use std::any::Any;
use std::error::Error;
use std::fmt;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::{Deserialize, Serialize};

use crate::experiment::{Context, Experiment, Picture, Profile};
use crate::golden;
use crate::machine::Machine;
use crate::page::{self, Section, Shown};
use crate::table::{COUNTS, Table, Tables};

/// Name of the file that says how a result was made.
pub const MANIFEST: &str = "run.json";

/// How a result was made: `run.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Name of the experiment.
    pub experiment: String,
    /// Whether it ran to its end; the file is written last.
    pub complete: bool,
    /// Profile it ran under.
    pub profile: Profile,
    /// Threads of the global pool.
    pub threads: usize,
    /// Settings of the experiment.
    pub settings: serde_json::Value,
    /// Records in `counts.csv`.
    pub runs: usize,
    /// Records that failed or were stopped early.
    pub failed: usize,
    /// Pictures, in the order they were made.
    pub pictures: Vec<Picture>,
    /// What was left out of runs on each scene, and what that saved; none in files of earlier versions.
    #[serde(default)]
    pub left_out: Vec<(String, String)>,
    /// Seconds the whole experiment took, everything included: the only value here that differs between two runs.
    pub seconds: f64,
    /// Machine, compiler, versions, commit.
    pub machine: Machine,
}

impl Manifest {
    /// Reads the file in `directory`; `None` if there is none or it is not readable.
    pub fn read(directory: &Path) -> Option<Self> {
        serde_json::from_slice(&fs::read(directory.join(MANIFEST)).ok()?).ok()
    }
}

/// What a run is asked to do.
#[derive(Clone, Debug)]
pub struct Request {
    /// How much to spend.
    pub profile: Profile,
    /// Directory of the results.
    pub results: PathBuf,
    /// Directory of the source, for the commit.
    pub root: PathBuf,
    /// Leave finished experiments as they are.
    pub resume: bool,
    /// Show a progress bar, on a terminal only.
    pub progress: bool,
}

/// What became of an experiment.
#[derive(Clone, Debug, PartialEq)]
pub enum State {
    /// It ran and was drawn.
    Done(Manifest),
    /// Its earlier results were kept.
    Kept(Manifest),
    /// It did not end; earlier results are untouched.
    Failed(String),
}

/// Why a part of the work could not be done.
#[derive(Debug)]
#[non_exhaustive]
pub enum RunError {
    /// A file or directory could not be read or written.
    File {
        /// Its path.
        path: PathBuf,
        /// What the system says.
        error: std::io::Error,
    },
    /// The experiment gave up, or panicked.
    Experiment(String),
}

impl fmt::Display for RunError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File { path, error } => write!(f, "{}: {error}", path.display()),
            Self::Experiment(message) => f.write_str(message),
        }
    }
}

impl Error for RunError {}

fn at<T>(path: &Path, result: std::io::Result<T>) -> Result<T, RunError> {
    result.map_err(|error| RunError::File { path: path.into(), error })
}

fn message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    format!("panicked: {}", text.unwrap_or("no message"))
}

/// Runs one experiment, draws it and puts its results in place.
pub fn run(experiment: &dyn Experiment, request: &Request) -> State {
    let directory = request.results.join(experiment.name());
    if request.resume
        && let Some(manifest) = Manifest::read(&directory)
        && is_same(&manifest, experiment, request)
        && Tables::read(&directory).is_ok()
    {
        return State::Kept(manifest);
    }
    match run_anew(experiment, request, &directory) {
        Ok(manifest) => State::Done(manifest),
        Err(error) => State::Failed(error.to_string()),
    }
}

fn is_same(manifest: &Manifest, experiment: &dyn Experiment, request: &Request) -> bool {
    manifest.complete
        && manifest.experiment == experiment.name()
        && manifest.profile == request.profile
        && manifest.threads == rayon::current_num_threads()
        && manifest.settings == experiment.settings(request.profile)
}

/// Works in a directory of its own, which takes the place of the earlier results only when all is there.
fn run_anew(experiment: &dyn Experiment, request: &Request, directory: &Path) -> Result<Manifest, RunError> {
    let partial = request.results.join(format!(".{}.partial", experiment.name()));
    if partial.exists() {
        at(&partial, fs::remove_dir_all(&partial))?;
    }
    at(&partial, fs::create_dir_all(&partial))?;
    let made = make(experiment, request, &partial);
    if made.is_err() {
        at(&partial, fs::remove_dir_all(&partial))?;
        return made;
    }
    if directory.exists() {
        at(directory, fs::remove_dir_all(directory))?;
    }
    at(directory, fs::rename(&partial, directory))?;
    made
}

fn make(experiment: &dyn Experiment, request: &Request, directory: &Path) -> Result<Manifest, RunError> {
    let failed = |error: &dyn fmt::Display| RunError::Experiment(error.to_string());
    let mut context = Context::new(experiment.name(), request.profile, directory.into(), request.progress);
    let clock = Instant::now();
    // A panic of one experiment must not lose the others.
    let ended = catch_unwind(AssertUnwindSafe(|| experiment.run(&mut context)));
    context.finish();
    match ended {
        Ok(Ok(())) => {}
        Ok(Err(error)) => return Err(failed(&error)),
        Err(panic) => return Err(RunError::Experiment(message(&*panic))),
    }
    let manifest = Manifest {
        experiment: experiment.name().into(),
        complete: true,
        profile: request.profile,
        threads: context.threads(),
        settings: experiment.settings(request.profile),
        runs: context.recorder.len(),
        failed: context.recorder.failed(),
        pictures: std::mem::take(&mut context.pictures),
        left_out: std::mem::take(&mut context.left_out),
        // To the millisecond: more digits mean nothing.
        seconds: (clock.elapsed().as_secs_f64() * 1e3).round() / 1e3,
        machine: Machine::here(&request.root),
    };
    context.recorder.write(directory).map_err(|e| failed(&e))?;
    draw(experiment, &manifest, directory)?;
    let json = serde_json::to_string_pretty(&manifest).map_err(|e| failed(&e))?;
    let path = directory.join(MANIFEST);
    at(&path, fs::write(&path, json + "\n"))?;
    Ok(manifest)
}

/// Draws the figures of the tables in `directory` as SVG and PNG; figures of an earlier version are removed.
///
/// # Errors
///
/// [`RunError`] if a table cannot be read, a figure cannot be made from it, or a file cannot be written.
pub fn draw(experiment: &dyn Experiment, manifest: &Manifest, directory: &Path) -> Result<(), RunError> {
    let failed = |error: &dyn fmt::Display| RunError::Experiment(error.to_string());
    let tables = Tables::read(directory).map_err(|e| failed(&e))?;
    let figures = figures(experiment, &tables)?;
    for entry in at(directory, fs::read_dir(directory))? {
        let path = at(directory, entry)?.path();
        let is = |extension: &str| path.extension().is_some_and(|e| e == extension);
        let is_picture = manifest.pictures.iter().any(|p| path.ends_with(&p.file));
        if is("svg") || (is("png") && !is_picture) {
            at(&path, fs::remove_file(&path))?;
        }
    }
    for figure in figures {
        let drawing = figure.draw();
        let svg = directory.join(format!("{}.svg", figure.name()));
        at(&svg, fs::write(&svg, drawing.to_svg().map_err(|e| failed(&e))?))?;
        drawing.write_png(&svg.with_extension("png")).map_err(|e| failed(&e))?;
    }
    Ok(())
}

fn figures(experiment: &dyn Experiment, tables: &Tables) -> Result<Vec<radiosity_plot::Figure>, RunError> {
    catch_unwind(AssertUnwindSafe(|| experiment.plots(tables))).map_err(|p| RunError::Experiment(message(&*p)))
}

/// Draws every experiment that has results in `results` again, then the page; gives the names drawn.
///
/// # Errors
///
/// As [`draw`]; the experiments before are drawn.
pub fn redraw(all: &[&dyn Experiment], results: &Path) -> Result<Vec<&'static str>, RunError> {
    let mut drawn = Vec::new();
    for experiment in all {
        let directory = results.join(experiment.name());
        if let Some(manifest) = Manifest::read(&directory) {
            draw(*experiment, &manifest, &directory)
                .map_err(|error| RunError::Experiment(format!("{}: {error}", experiment.name())))?;
            drawn.push(experiment.name());
        }
    }
    write_page(all, results)?;
    Ok(drawn)
}

/// Writes `index.html` over all experiments that have results in `results`; gives its path.
///
/// # Errors
///
/// As [`draw`].
pub fn write_page(all: &[&dyn Experiment], results: &Path) -> Result<PathBuf, RunError> {
    let mut sections = Vec::new();
    for experiment in all {
        if let Some(manifest) = Manifest::read(&results.join(experiment.name())) {
            let named = |error: RunError| RunError::Experiment(format!("{}: {error}", experiment.name()));
            sections.push(section(*experiment, manifest, results).map_err(named)?);
        }
    }
    let path = results.join("index.html");
    at(results, fs::create_dir_all(results))?;
    at(&path, fs::write(&path, page::html(&sections)))?;
    Ok(path)
}

fn section(experiment: &dyn Experiment, manifest: Manifest, results: &Path) -> Result<Section, RunError> {
    let directory = results.join(experiment.name());
    let tables = Tables::read(&directory).map_err(|e| RunError::Experiment(e.to_string()))?;
    let shown = figures(experiment, &tables)?.into_iter();
    let shown = shown.map(|figure| Shown { name: figure.name().into(), caption: figure.explanation().into() });
    let reading = catch_unwind(AssertUnwindSafe(|| experiment.reading(&tables)));
    let troubled = tables.rows().filter(|row| row.quality() != radiosity_plot::Quality::Good);
    Ok(Section {
        name: experiment.name(),
        question: experiment.question().into(),
        expects: experiment.expects().into(),
        figures: shown.collect(),
        reading: reading.map_err(|p| RunError::Experiment(message(&*p)))?,
        troubled: troubled.map(|row| (row.run().into(), row.text("outcome").into())).collect(),
        manifest,
    })
}

/// Compares the counts of an experiment in `results` with those in `golden`; empty if they agree. With `update` the golden
/// file is rewritten instead.
///
/// # Errors
///
/// [`RunError`] if a table cannot be read or written; a golden file that does not exist says how to make it.
pub fn check(
    experiment: &dyn Experiment,
    results: &Path,
    golden: &Path,
    update: bool,
) -> Result<Vec<golden::Difference>, RunError> {
    let new = results.join(experiment.name()).join(COUNTS);
    let old = golden.join(experiment.name()).join(COUNTS);
    if update {
        let directory = golden.join(experiment.name());
        at(&directory, fs::create_dir_all(&directory))?;
        at(&old, fs::copy(&new, &old))?;
        return Ok(Vec::new());
    }
    if !old.exists() {
        let message = format!("there are no golden counts {}; make them with --update", old.display());
        return Err(RunError::Experiment(message));
    }
    let read = |path: &Path| Table::read(path).map_err(|e| RunError::Experiment(e.to_string()));
    Ok(golden::compare(&read(&old)?, &read(&new)?, |column| experiment.slack(column)))
}

#[cfg(test)]
mod tests;
