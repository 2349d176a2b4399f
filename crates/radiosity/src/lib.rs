//! From a scene to a radiosity solution with its cost and its error: the facade of the workspace.
//!
//! ```text
//! Scene ─► Geometry ─► FormFactors ─► System ─► Solver ─► Run ─► errors
//! ```
//!
//! A [`Strategy`] names one choice at every arrow; [`run`] follows it. Nothing here touches files, the environment or
//! global state.

pub mod adaptive;
mod asked;
mod bounces;
pub mod bounded;
pub mod choice;
mod enhanced;
pub mod errors;
mod estimate;
mod geometry;
mod hierarchical;
mod importance;
mod linear;
mod mend;
pub mod plan;
mod predict;
mod resolve;
mod run;
mod saved;
mod senders;
pub mod specular_radiosity;
mod strategy;
mod thin;
mod tolerance;
mod yardstick;

pub use adaptive::{Adaptive, AdaptiveRun, Criterion, ErrorEstimate, Goal, Round, run_adaptive, run_adaptive_while};
pub use asked::{surfaces_in_view, view_weights};
pub use bounces::bounces;
pub use bounded::Bounded;
pub use choice::{Choice, Constants, Wanted};
pub use enhanced::{EnhancedRun, SpecularBy, SpecularTransport, predict_enhanced, run_enhanced};
pub use errors::{CellPlace, ErrorMeasure, GridValues, SurfaceBias};
pub use estimate::{Phase, assemble, cell_form_factors, rows};
pub use geometry::Geometry;
pub use hierarchical::HierarchicalReport;
pub use importance::Importance;
pub use linear::{LinearIrradiance, LinearRadiosity};
pub use mend::{Repair, mend, mend_dense};
pub use plan::Plan;
pub use predict::{Alternative, Bytes, Change, Prediction, Size, admit, coarser, predict};
pub use resolve::{Saving, Solved};
pub use run::{Checked, Forecasted, Run, RunError, forecast, run, run_meshed, run_planned, run_saved, solve_on};
pub use saved::{FitError, FittedRows, SavedCell, SavedFormFactors};
pub use specular_radiosity::{SpecularRadiosity, SpecularSolution, run_specular_radiosity};
pub use strategy::{DirectLight, LINK_ERROR, Method, Shape, Store, Strategy, default_method};
pub use tolerance::{ToleranceRun, ToleranceStep, run_to_tolerance, run_to_tolerance_while};
pub use yardstick::{HistoryPoint, Measured, Yardstick};
