//! What an experiment is, and what it is given to run with.

use std::error::Error;
use std::fmt::Display;
use std::path::PathBuf;
use std::time::Instant;

use indicatif::{ProgressBar, ProgressStyle};
use serde::{Deserialize, Serialize};

use crate::table::{Record, Recorder, Tables};
use radiosity_plot::{Figure, write_png};

/// How much an experiment may spend.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Profile {
    /// Seconds for all experiments: a check that counts have not changed.
    Tiny,
    /// About 15 s an experiment.
    Quick,
    /// At most 15 minutes an experiment; what is published.
    Full,
}

impl Profile {
    /// The value for this profile.
    pub fn pick<T>(self, tiny: T, quick: T, full: T) -> T {
        match self {
            Self::Tiny => tiny,
            Self::Quick => quick,
            Self::Full => full,
        }
    }

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        self.pick("tiny", "quick", "full")
    }
}

/// One question, how it is measured, and how the answer is shown.
pub trait Experiment: Sync {
    /// Number and slug, such as `01-patches`: also the name of its directory.
    fn name(&self) -> &'static str;

    /// The question.
    fn question(&self) -> &str;

    /// What theory expects.
    fn expects(&self) -> &str;

    /// Sizes, tolerances, seeds and whatever else decides the counts; kept in `run.json`, and a finished run is resumed
    /// only under equal settings.
    fn settings(&self, _profile: Profile) -> serde_json::Value {
        serde_json::Value::Null
    }

    /// Absolute difference allowed in a float column of golden counts, beside 1e-9 relative: for differences of nearly
    /// equal numbers, whose digits depend on the processor.
    fn slack(&self, _column: &str) -> f64 {
        0.0
    }

    /// Measures. A method that fails is a record with its outcome; an error ends the experiment and leaves the results of
    /// an earlier run in place.
    ///
    /// # Errors
    ///
    /// Whatever makes going on pointless.
    fn run(&self, context: &mut Context) -> Result<(), Box<dyn Error>>;

    /// Figures, from the tables alone.
    fn plots(&self, tables: &Tables) -> Vec<Figure>;

    /// What the numbers say, in about two sentences, from the tables alone.
    fn reading(&self, tables: &Tables) -> Vec<String>;
}

/// A picture an experiment made, as `run.json` lists it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Picture {
    /// Name of the PNG file.
    pub file: String,
    /// What it shows.
    pub caption: String,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
}

/// What an experiment runs with: profile, progress, and where records and pictures go.
#[derive(Debug)]
pub struct Context {
    profile: Profile,
    threads: usize,
    directory: PathBuf,
    bar: ProgressBar,
    pub(crate) recorder: Recorder,
    pub(crate) pictures: Vec<Picture>,
    /// Scenes, with what was left out of runs on them.
    pub(crate) left_out: Vec<(String, String)>,
}

impl Context {
    /// A context that writes into `directory`. `visible`: whether a progress bar is shown, on a terminal only.
    pub fn new(name: &'static str, profile: Profile, directory: PathBuf, visible: bool) -> Self {
        let bar = if visible { ProgressBar::new(0) } else { ProgressBar::hidden() };
        let template = "{prefix:18} {bar:24} {percent:>3} %  {eta:>4} left  {wide_msg}";
        bar.set_style(ProgressStyle::with_template(template).expect("the template names known keys"));
        bar.set_prefix(name);
        let threads = rayon::current_num_threads();
        Self {
            profile,
            threads,
            directory,
            bar,
            recorder: Recorder::default(),
            pictures: Vec::new(),
            left_out: Vec::new(),
        }
    }

    /// How much may be spent.
    pub fn profile(&self) -> Profile {
        self.profile
    }

    /// The directory of this experiment's results.
    pub fn directory(&self) -> &std::path::Path {
        &self.directory
    }

    /// Threads of the global pool.
    pub fn threads(&self) -> usize {
        self.threads
    }

    /// Announces the work: the sum of all later [`tick`](Self::tick)s and [`advance`](Self::advance)s.
    pub fn begin(&mut self, total: usize) {
        self.bar.set_length(total as u64);
        self.bar.reset_eta();
        self.bar.tick();
    }

    /// One unit of work is done, `label` says which.
    pub fn tick(&mut self, label: impl Display) {
        self.advance(1, label);
    }

    /// `work` units are done: weights make the time left right where units differ.
    pub fn advance(&mut self, work: usize, label: impl Display) {
        self.bar.set_message(label.to_string());
        self.bar.inc(work as u64);
    }

    /// Adds a record to the tables.
    ///
    /// # Panics
    ///
    /// If its key was used before.
    pub fn record(&mut self, record: Record) {
        self.recorder.push(record);
    }

    /// Says once in one `line` what was left out of runs on `scene`, for the report beside the tables.
    pub fn left_out(&mut self, scene: &str, line: impl FnOnce() -> String) {
        if !self.left_out.iter().any(|(known, _)| known == scene) {
            self.left_out.push((scene.to_owned(), line()));
        }
    }

    /// Writes `name.png` from 8-bit sRGB pixels, row by row from the top.
    ///
    /// # Errors
    ///
    /// If the file cannot be written.
    ///
    /// # Panics
    ///
    /// If `rgb` does not hold 3 · width · height bytes.
    pub fn picture(
        &mut self,
        name: &str,
        caption: &str,
        width: u32,
        height: u32,
        rgb: &[u8],
    ) -> Result<(), Box<dyn Error>> {
        let file = format!("{name}.png");
        write_png(&self.directory.join(&file), (width, height), rgb)?;
        self.pictures.push(Picture { file, caption: caption.into(), width, height });
        Ok(())
    }

    /// Ends the progress bar.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// Does `work` `repetitions` times (at least once): its last result and the seconds each took.
pub fn timed<T>(repetitions: usize, mut work: impl FnMut() -> T) -> (T, Vec<f64>) {
    let mut seconds = Vec::with_capacity(repetitions);
    loop {
        let clock = Instant::now();
        let result = work();
        seconds.push(clock.elapsed().as_secs_f64());
        if seconds.len() >= repetitions {
            return (result, seconds);
        }
    }
}
