//! Runs the experiments: `cargo run --release`, or `-- run NAME…`, `-- plot`, `-- list`.

mod changes;
#[path = "12_choice.rs"]
mod choice;
mod classes;
mod common;
#[path = "03_form_factors.rs"]
mod form_factors;
#[path = "11_left_out.rs"]
mod left_out;
#[path = "08_parametric.rs"]
mod parametric;
#[path = "01_patches.rs"]
mod patches;
mod points;
#[path = "05_progressive.rs"]
mod progressive;
#[path = "07_scale.rs"]
mod scale;
#[path = "04_solvers.rs"]
mod solvers;
#[path = "09_specular_cost.rs"]
mod specular_cost;
#[path = "06_stability.rs"]
mod stability;
#[path = "02_substructuring.rs"]
mod substructuring;
mod truth;
#[path = "10_two_pass.rs"]
mod two_pass;

use std::process::ExitCode;

use radiosity_experiments::{Experiment, cli};

/// All experiments, in the order of their numbers.
const EXPERIMENTS: &[&dyn Experiment] = &[
    &patches::Patches,
    &substructuring::Substructuring,
    &form_factors::FormFactorErrors,
    &solvers::Solvers,
    &progressive::Progressive,
    &stability::Stability,
    &scale::Scale,
    &parametric::Parametric,
    &specular_cost::SpecularCost,
    &two_pass::TwoPasses,
    &left_out::LeftOut,
    &choice::StrategyChoice,
];

/// All within one pool: work that is begun outside is handed over each time it is shared, which the shortest runs would be measured with.
fn main() -> ExitCode {
    match rayon::ThreadPoolBuilder::new().build() {
        Ok(pool) => pool.install(|| cli::main(EXPERIMENTS, std::env::args_os())),
        Err(error) => {
            eprintln!("error: no threads: {error}");
            ExitCode::FAILURE
        }
    }
}
