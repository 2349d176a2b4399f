//! The contracts of the workspace: what geometry hands to solvers, and what a solver hands back.
//!
//! The radiosity equation of a closed or open scene of diffuse elements is
//!
//! ```text
//! B_s = E_s + ρ_s H_s,      H_s = Σ_t F_st B_t = (1/A_s) Σ_t A_s F_st B_t
//! ```
//!
//! with radiosity B, emission E and irradiance H in W/m², reflectance ρ, areas A and form factors F_st (the
//! fraction of the power leaving s that arrives directly at t). The one primitive is the exchange area A_s F_st;
//! [`FormFactors`] lends its rows, [`System`] adds areas, emission and reflectance, [`Solver`] is one method and
//! [`solve`] the loop that owns stopping, timing, verification and bounds.
//!
//! What is *not* here: geometry, estimators, matrix libraries and any particular method.

mod bands;
mod bounds;
mod cost;
mod error;
mod forecast;
mod form_factors;
mod sampling;
mod solve;
mod solver;
mod system;
mod trace;

pub use bands::{BandValues, Bands, BandsMut};
pub use bounds::Certificate;
pub use cost::Cost;
pub use error::{SolveError, StoreError, SystemError};
pub use forecast::Forecast;
pub use form_factors::{
    Block, Entries, FormFactors, Properties, Relax, Row, RowBuf, gather_by_rows, scatter_by_rows, sweep_by_rows,
};
pub use sampling::{DrawBuf, Drawn, Draws, LOST, mix, sample_by_rows, uniform};
pub use solve::{Observer, Outcome, Solution, Step, StopRule, solve, solve_from};
pub use solver::{Iterate, Needs, Progress, Sampled, Solver};
pub use system::{Direction, Form, System};
pub use trace::{Snapshot, Snapshots, Trace, TracePoint};
