//! What several tests need: a directory that is removed afterwards, and a small experiment.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::{Context, Experiment, Profile, Record, SeriesOfRows, Tables};
use radiosity_plot::{Axis, Figure, Panel, Series};

pub(crate) struct Scratch(PathBuf);

impl Scratch {
    pub(crate) fn new() -> Self {
        static NEXT: AtomicUsize = AtomicUsize::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("radiosity-experiments-{}-{number}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    pub(crate) fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // A directory left behind in the temporary folder harms nobody.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A small experiment: one good, one stopped and one failed run, a picture, and an end on demand.
pub(crate) struct Demo {
    pub(crate) runs: AtomicUsize,
    pub(crate) value: f64,
    pub(crate) end: End,
}

#[derive(Clone, Copy, PartialEq)]
pub(crate) enum End {
    Well,
    Error,
    Panic,
}

impl Demo {
    pub(crate) fn new(end: End) -> Self {
        Self { runs: AtomicUsize::new(0), value: 0.125, end }
    }
}

impl Experiment for Demo {
    fn name(&self) -> &'static str {
        "09-demo"
    }

    fn question(&self) -> &str {
        "Is 1 < 2 & 2 > 1?"
    }

    fn expects(&self) -> &str {
        "Yes."
    }

    fn settings(&self, profile: Profile) -> serde_json::Value {
        serde_json::json!({ "sizes": profile.pick(1, 2, 3) })
    }

    fn run(&self, context: &mut Context) -> Result<(), Box<dyn Error>> {
        self.runs.fetch_add(1, Ordering::Relaxed);
        context.begin(3);
        for (k, outcome) in ["converged", "step limit", "breakdown"].into_iter().enumerate() {
            let record = Record::new(outcome).text("solver", "jacobi").int("n", 10 * (k + 1)).text("outcome", outcome);
            context.record(record.float("error", self.value / (k + 1) as f64).seconds("time", 0.5 * (k + 1) as f64));
            context.tick(outcome);
        }
        context.left_out("a demo", || "nothing < everything".to_owned());
        context.picture("grey", "A grey picture", 3, 2, &[128; 18])?;
        match self.end {
            End::Well => Ok(()),
            End::Error => Err("the scene is empty".into()),
            End::Panic => panic!("index 7 of 3"),
        }
    }

    fn plots(&self, tables: &Tables) -> Vec<Figure> {
        let series = Series::new("Jacobi", "jacobi").rows(tables.rows(), |r| (r.seconds("time"), r.number("error")));
        let panel = Panel::new(Axis::log("time", "s"), Axis::log("error", "")).series(series);
        vec![Figure::new("error", "Error against time").caption("One mark a run.").panel(panel)]
    }

    fn reading(&self, tables: &Tables) -> Vec<String> {
        vec![format!("The least error is {}.", tables.rows().map(|r| r.number("error")).fold(f64::INFINITY, f64::min))]
    }
}
