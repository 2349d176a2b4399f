//! Every method, store and precision on systems that are stiff or extreme.
//!
//! Question: which method can be trusted when light hardly fades, rooms hardly touch, or numbers leave their usual range?
//! Theory: stationary methods need 1/(1 − μ) sweeps, over-relaxation and Chebyshev their square root, Krylov methods as many products
//! as there are slow modes; rounding reaches the answer as ε/(1 − ρ), and single-precision entries as 6·10⁻⁸/(1 − ρ). Row sums
//! above 1/ρ leave no answer that means anything. Measured on the gallery's stiff systems of up to about 100 elements; error
//! against elimination in twice the working precision, η asked 1e-10; and, for conjugate gradients, in a closed room 4 × 3 × 5 of 6,144
//! elements at ρ = 0.999 and 0.99999 with one element or a panel lit, against an iteration in twice the working precision that ends
//! by its own bound. There every pass over the form factors counts: start, deflation and residuals that are recomputed. Read: an
//! error must lie under its bound, and a run that did not converge must say so. Not shown: times on large systems (experiment 04).

use std::error::Error;

use radiosity_core::{
    Direction, Forecast, FormFactors, Outcome, Solution, SolveError, StopRule, StoreError, System, solve,
};
use radiosity_experiments::{Context, Experiment, Profile, Record, Row, SeriesOfRows, Tables, group_by};
use radiosity_form_factors::stores::{DenseFormFactors, PackedFormFactors, SparseFormFactors};
use radiosity_gallery::{Light, RandomEnclosure, bright_room, exact_in_closed_room, stiff, with_light};
use radiosity_plot::{Axis, Figure, Panel, Series};
use radiosity_solvers::{NAMES, by_name};

use crate::common::counts;

/// The experiment.
pub struct Stability;

const UNSHOT: f64 = 1e-10;
/// Errors below this are drawn at it: what remains is rounding.
const FLOOR: f64 = 1e-17;

fn steps(profile: Profile) -> u64 {
    profile.pick(200, 3_000, 30_000)
}

/// Stores of every case, and of the large room, where each is held alone.
const STORES: [&str; 4] = ["dense", "sparse", "packed", "packed-f32"];
const LARGE_STORES: [&str; 3] = ["dense", "packed", "packed-f32"];

/// The store called `name` of an enclosure.
fn assemble(name: &str, rows: &RandomEnclosure) -> Result<Box<dyn FormFactors>, StoreError> {
    Ok(match name {
        "dense" => Box::new(DenseFormFactors::assemble(rows)?.0),
        "sparse" => Box::new(SparseFormFactors::assemble(rows)?.0),
        "packed" => Box::new(PackedFormFactors::<f64>::assemble(rows)?.0),
        "packed-f32" => Box::new(PackedFormFactors::<f32>::assemble(rows)?.0),
        name => unreachable!("no store of the list is called {name}"),
    })
}

/// Σ A|B − exact| over Σ A E; 0 if there is no difference.
fn error(system: &System<'_>, solution: &Solution, exact: &[f64]) -> f64 {
    let apart = solution.radiosity.values().iter().zip(exact).zip(system.areas());
    let error: f64 = apart.map(|((b, exact), a)| a * (b - exact).abs()).sum();
    if error == 0.0 { 0.0 } else { error / system.power(system.emission().band(0)) }
}

/// A real number where there is one.
fn known(record: Record, column: &str, value: Option<f64>) -> Record {
    match value {
        Some(value) if value.is_finite() => record.float(column, value),
        _ => record,
    }
}

/// Elements along a wall of the large room, whose 6 K² elements are too many for elimination.
fn wall(profile: Profile) -> u32 {
    profile.pick(4, 16, 32)
}

/// Reflectances of the large room.
const BRIGHT: [f64; 2] = [0.999, 0.999_99];

/// Names of cases in the large room begin so.
const LARGE: &str = "large room";

/// Conjugate gradients in a large bright room, with the products they make.
fn large_rooms(context: &mut Context) -> Result<(), Box<dyn Error>> {
    let mut room = bright_room(wall(context.profile()));
    for rho in BRIGHT {
        for (light, lit) in [(Light::Element, "an element"), (Light::Panel, "a panel")] {
            room = with_light(room, light, rho);
            let name = format!("{LARGE}, {lit} lit, ρ = {rho}");
            let exact = exact_in_closed_room(&room).ok_or_else(|| format!("{name}: no exact answer"))?;
            for store in LARGE_STORES {
                let held = assemble(store, &room)?;
                let system = room.system(&*held);
                let (forecast, _) = Forecast::new(&system, Direction::Gather, 1)?;
                for solver in ["cg", "deflated-cg"] {
                    let record = run(&system, (&name, store, solver), &forecast, &exact, 1_000)?;
                    let record = record.int("elements", room.len() as u64);
                    context.record(known(record, "forecast_jacobi", forecast.steps("jacobi", UNSHOT).map(|s| s.1)));
                }
            }
            context.tick(name);
        }
    }
    Ok(())
}

/// Solves by the method called `solver`: how it ended, what it cost and how far it is from the exact answer.
fn run(
    system: &System<'_>,
    (case, store, solver): (&str, &'static str, &'static str),
    forecast: &Forecast,
    exact: &[f64],
    limit: u64,
) -> Result<Record, SolveError> {
    let mut method = by_name(solver).expect("a name from the list of names");
    let solution = solve(system, &mut *method, &StopRule::unshot(UNSHOT).steps(limit), &mut ())?;
    let certificate = solution.certificate.expect("runs are verified");
    let error = error(system, &solution, exact);
    let bounds = [certificate.bound, certificate.sharp_bound];
    let held = match bounds.into_iter().flatten().all(|bound| error <= bound) {
        _ if bounds == [None, None] => "no bound",
        true => "yes",
        false => "NO",
    };
    let record = Record::new(format!("{case}/{store}/{solver}"))
        .text("case", case)
        .text("store", store)
        .text("solver", solver)
        .text("outcome", solution.outcome)
        .int("steps", solution.steps)
        .float("error", error)
        .text("bound_held", held)
        .float("backward_error", certificate.backward_error)
        .float("contraction", certificate.contraction)
        .float("radius_low", forecast.radius.0)
        .float("radius_high", forecast.radius.1);
    let record = known(record, "unshot", Some(solution.unshot));
    let record = known(record, "bound", certificate.bound);
    let record = known(record, "sharp_bound", certificate.sharp_bound);
    let record = known(record, "forecast_steps", forecast.steps(solver, UNSHOT).map(|steps| steps.1));
    Ok(counts(record, &solution.cost).seconds("time", solution.time.as_secs_f64()))
}

impl Experiment for Stability {
    fn name(&self) -> &'static str {
        "06-stability"
    }

    fn question(&self) -> &str {
        "Which method can be trusted when light hardly fades, rooms hardly touch, or numbers leave their usual range?"
    }

    fn expects(&self) -> &str {
        "Stationary methods need 1/(1 − μ) sweeps, over-relaxation and Chebyshev the square root of that, Krylov methods as many products \
         as there are slow modes. No error lies above its bound. Where row sums times ρ exceed 1, everything but a minimal residual \
         stops and says so."
    }

    fn settings(&self, profile: Profile) -> serde_json::Value {
        serde_json::json!({ "unshot": UNSHOT, "steps": steps(profile), "large_room_wall": wall(profile) })
    }

    fn slack(&self, column: &str) -> f64 {
        // What is left of an error at rounding level, and of its bound, differs between instruction sets.
        match column {
            "error" | "bound" | "sharp_bound" | "backward_error" | "unshot" => 1e-8,
            _ => 0.0,
        }
    }

    fn run(&self, context: &mut Context) -> Result<(), Box<dyn Error>> {
        let (mut cases, limit) = (stiff(), steps(context.profile()));
        // Every fourth is enough to see that counts have not changed.
        let mut number = 0;
        cases.retain(|_| {
            number += 1;
            context.profile() != Profile::Tiny || number % 4 == 1
        });
        context.begin(cases.len() + 4);
        for case in &cases {
            let exact = case.exact().ok_or_else(|| format!("{} is singular", case.name))?;
            for name in STORES {
                let store = match assemble(name, &case.enclosure) {
                    Ok(store) => store,
                    Err(reason) => {
                        let refused = Record::new(format!("{}/{name}", case.name)).text("case", &case.name);
                        context.record(
                            refused.text("store", name).text("outcome", "refused").text("reason", reason.to_string()),
                        );
                        continue;
                    }
                };
                let system = case.enclosure.system(&*store);
                let (forecast, _) = Forecast::new(&system, Direction::Gather, 12)?;
                for solver in NAMES {
                    context.record(run(&system, (&case.name, name, solver), &forecast, &exact, limit)?);
                }
            }
            context.tick(case.name.clone());
        }
        large_rooms(context)
    }

    fn plots(&self, tables: &Tables) -> Vec<Figure> {
        let passes = |family: &'static str| {
            let rows = tables.select(|r| r.text("store") == "dense" && r.text("case").starts_with(family));
            let series = group_by(rows, "solver").into_iter().map(|(solver, rows)| {
                Series::new(&*solver, &*solver).rows(rows, |r| {
                    let rho: f64 =
                        r.text("case").rsplit(' ').next().and_then(|rho| rho.parse().ok()).unwrap_or(f64::NAN);
                    (1.0 / (1.0 - rho), r.number("steps"))
                })
            });
            Panel::new(Axis::log("1/(1 − ρ)", ""), Axis::log("steps to η = 10⁻¹⁰", "")).title(family).all_series(series)
        };
        let bounds = |store: &'static str| {
            let rows = tables.select(|r| r.text("store") == store && !r.text("sharp_bound").is_empty());
            let series = group_by(rows, "solver").into_iter().map(|(solver, rows)| {
                Series::new(&*solver, &*solver)
                    .rows(rows, |r| (r.number("error").max(FLOOR), r.number("sharp_bound").max(FLOOR)))
                    .scatter()
            });
            let axes = (Axis::log("true error", "share of the emitted power"), Axis::log("bound", ""));
            Panel::new(axes.0, axes.1).title(store).all_series(series)
        };
        vec![
            Figure::new("steps-reflectance", "Steps against 1/(1 − ρ) in a closed room and in a duct")
                .caption("A step is a sweep or a product; of shooting it is one row. Hollow marks were stopped at the step limit.")
                .panel(passes("room"))
                .panel(passes("duct"))
                .shared_y(),
            Figure::new("bounds", "The bound against the true error, all cases")
                .caption("A mark below the diagonal would be an error above its bound. In single precision the rounding of the entries is part of both.")
                .panel(bounds("dense"))
                .panel(bounds("packed-f32"))
                .shared_y(),
        ]
    }

    fn reading(&self, tables: &Tables) -> Vec<String> {
        let runs = tables.select(|r| r.text("outcome") != "refused");
        let broken = runs.iter().filter(|r| r.text("bound_held") == "NO").count();
        let bounded = runs.iter().filter(|r| r.text("bound_held") != "no bound").count();
        let converged = |solver: &str| {
            let small = |r: &Row| r.text("store") == "dense" && !r.text("case").starts_with(LARGE);
            let of = tables.select(|r| r.text("solver") == solver && small(r));
            let done = of.iter().filter(|r| r.text("outcome") == Outcome::Converged.to_string()).count();
            format!("{solver} {done}")
        };
        let cases = tables.select(|r| r.text("solver") == "direct" && r.text("store") == "dense").len();
        let refused = tables.select(|r| r.text("outcome") == "refused").len();
        let large = tables.select(|r| r.text("case").starts_with(LARGE));
        let elements = large.iter().map(|r| r.number("elements")).fold(0.0, f64::max);
        let most_products = |solver: &str| {
            let of = large.iter().filter(|r| r.text("solver") == solver && r.text("store") != "packed-f32");
            BRIGHT.map(|rho| {
                let at = of.clone().filter(|r| r.text("case").ends_with(&format!("ρ = {rho}")));
                at.map(|r| r.number("entries_read") / elements.powi(2)).fold(0.0, f64::max)
            })
        };
        let (plain, deflated) = (most_products("cg"), most_products("deflated-cg"));
        let jacobi = BRIGHT.map(|rho| {
            let at = large.iter().filter(|r| r.text("case").ends_with(&format!("ρ = {rho}")));
            at.map(|r| r.number("forecast_jacobi")).fold(0.0, f64::max)
        });
        vec![
            format!(
                "Of {} runs {bounded} have a bound, and in {broken} of them the error lies above it; {refused} stores refused a case.",
                runs.len()
            ),
            format!(
                "Cases of {cases} solved to η = 10⁻¹⁰ within the step limit, double precision: {}.",
                NAMES.map(converged).join(", ")
            ),
            format!(
                "In a closed room 4 × 3 × 5 of {elements} elements with one element or a panel lit, conjugate gradients reach η = 10⁻¹⁰ with at most {} products at ρ = {} and {} at ρ = {}, deflated {} and {}, start, deflation and recomputed residuals included; Jacobi is forecast to need {:.0} and {:.0}.",
                plain[0], BRIGHT[0], plain[1], BRIGHT[1], deflated[0], deflated[1], jacobi[0], jacobi[1]
            ),
        ]
    }
}
