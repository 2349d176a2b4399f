//! From a scene to a radiosity solution with its cost and its error: the facade of the workspace.
//!
//! ```text
//! Scene ─► Geometry ─► FormFactors ─► System ─► Solver ─► Run ─► errors
//! ```
//!
//! A [`Strategy`] names one choice at every arrow; [`run`] follows it. Nothing here touches files, the environment or
//! global state.

pub mod errors;
mod estimate;
mod geometry;
mod predict;
mod run;
mod strategy;
mod tolerance;
mod yardstick;

pub use errors::{ErrorMeasure, GridValues, SurfaceBias};
pub use estimate::{Phase, assemble, cell_form_factors, rows};
pub use geometry::Geometry;
pub use predict::{Prediction, predict};
pub use run::{Run, RunError, run, solve_on};
pub use strategy::{Method, Shape, Store, Strategy, default_method};
pub use tolerance::{ToleranceRun, ToleranceStep, run_to_tolerance};
pub use yardstick::{HistoryPoint, Measured, Yardstick};
