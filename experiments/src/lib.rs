//! The experiment runner: everything an experiment needs but its question.
//!
//! An [`Experiment`] records runs into two tables through its [`Context`]; its figures and what they say are made from
//! the tables as read back, so that `plot` can redraw them at any time. A directory of results is
//!
//! ```text
//! NN-slug/counts.csv    settings, counts, errors, outcomes: repeat exactly
//! NN-slug/times.csv     seconds, joined to the counts by the column `run`
//! NN-slug/run.json      profile, settings, machine, compiler, commit
//! NN-slug/*.svg, *.png  figures, and the pictures that run.json lists
//! index.html            all of it on one page, which shows the files beside it
//! ```
//!
//! What is *not* here: the experiments themselves, which the program beside this library lists.
//!
//! # Examples
//!
//! ```
//! use std::error::Error;
//!
//! use radiosity_plot::{Axis, Figure, Panel, Series};
//! use radiosity_experiments::{Context, Experiment, Record, SeriesOfRows, Tables, group_by, timed};
//!
//! struct Sums;
//!
//! impl Experiment for Sums {
//!     fn name(&self) -> &'static str {
//!         "00-sums"
//!     }
//!     fn question(&self) -> &str {
//!         "How does the time of a sum grow with its terms?"
//!     }
//!     fn expects(&self) -> &str {
//!         "Like n."
//!     }
//!     fn run(&self, context: &mut Context) -> Result<(), Box<dyn Error>> {
//!         let sizes = context.profile().pick(vec![10, 100], vec![1_000, 10_000], vec![10_000, 1_000_000]);
//!         context.begin(sizes.len());
//!         for n in sizes {
//!             let (sum, seconds) = timed(3, || (0..n).map(|k| 1.0 / f64::from(k + 1)).sum::<f64>());
//!             let record = Record::new(format!("direct/{n}")).text("solver", "direct").int("terms", n);
//!             context.record(record.float("sum", sum).text("outcome", "done").repetitions("time", &seconds));
//!             context.tick(n);
//!         }
//!         Ok(())
//!     }
//!     fn plots(&self, tables: &Tables) -> Vec<Figure> {
//!         let series = group_by(tables.rows(), "solver").into_iter().map(|(solver, rows)| {
//!             Series::new(&*solver, &*solver).rows(rows, |r| (r.number("terms"), r.seconds("time"))).fit()
//!         });
//!         let panel = Panel::new(Axis::log("terms n", ""), Axis::log("time", "s")).all_series(series);
//!         vec![Figure::new("time", "Time of a sum").caption("One mark a size.").panel(panel)]
//!     }
//!     fn reading(&self, tables: &Tables) -> Vec<String> {
//!         vec![format!("{} sums were measured.", tables.rows().count())]
//!     }
//! }
//!
//! let list = ["experiments", "list"];
//! assert_eq!(radiosity_experiments::cli::main(&[&Sums], list), std::process::ExitCode::SUCCESS);
//! ```

/// Folder beside the experiments' results where references that several of them need are kept during a run.
pub const REFERENCES: &str = "truth";

pub mod cli;
mod experiment;
pub mod golden;
pub mod machine;
pub mod page;
pub mod runner;
mod table;
#[cfg(test)]
mod testing;

pub use experiment::{Context, Experiment, Picture, Profile, timed};
pub use table::{COUNTS, Record, Recorder, Row, SeriesOfRows, TIMES, Table, TableError, Tables, group_by};
