//! Every solver on every store.
//!
//! Question: which method solves the radiosity system first, as the reflectance grows, and when does keeping form factors
//! pay? Theory: Jacobi contracts by the spectral radius of ρF, which ρ bounds; Gauss–Seidel takes about half its
//! sweeps; conjugate gradients follow the few eigenvalues apart from the rest; shooting reads one row a step and is
//! ahead while little has been shot; a direct method does not see ρ. Recomputed form factors make each pass as dear as
//! the first. Stochastic Jacobi iteration needs none, and its error falls like the root of the rays.
//! Measured on the Cornell box with all reflectances scaled so that the largest is 0.1 to 0.99, analytic pairs;
//! error of irradiance against the exact solution of the same system. Read: curves of error inside a run. Not shown:
//! the mesh's own error, a level in the figure. The stochastic method runs for a fixed number of steps, on held rows and by rays of
//! its own; the error of the latter is against the exact form factors.
//!
//! Then, after a change of light, of paint, of one face or of a block: what continuing from the old answer computes of what a run from
//! nothing computes. Theory: materials change no form factor; a moved surface changes those of its own cells and of the pairs between
//! which it lay or lies; the start is as near to the answer as the light that changed is small.

use std::error::Error;

use radiosity::{Method, Store, Strategy, Yardstick};
use radiosity_experiments::{Context, Experiment, Profile, Record, SeriesOfRows, Tables, group_by};
use radiosity_geometry::mesh::Subdivision;
use radiosity_plot::numbers;
use radiosity_plot::{Axis, Dash, Figure, Panel, Series};
use radiosity_solvers::{NAMES, STOCHASTIC};

use crate::changes;
use crate::common::{GRID, cornell, counts, described, left_out, record, times, with_reflectance};
use crate::truth::{Fineness, truth};

/// The experiment.
pub struct Solvers;

const METHOD: Method = Method::sampled(1e-8, 64);
const UNSHOT: f64 = 1e-8;
/// Methods that run on every store; all others on the dense one.
const ON_ALL_STORES: [&str; 5] = ["direct", "jacobi", "gauss-seidel", "cg", "shooting"];
/// Solver errors below this are drawn at it: what remains is rounding.
const FLOOR: f64 = 1e-10;

fn elements(profile: Profile) -> u32 {
    profile.pick(1, 2, 4)
}

/// Elements of the changed scenes, whose form factors are exact.
fn changed_elements(profile: Profile) -> u32 {
    profile.pick(2, 6, 8)
}

fn largest_reflectances(profile: Profile) -> Vec<f64> {
    profile.pick(vec![0.5], vec![0.5, 0.9, 0.99], vec![0.1, 0.3, 0.5, 0.7, 0.9, 0.99])
}

/// Steps of the method that samples, which reaches no such small error.
fn sampled_steps(profile: Profile) -> u64 {
    profile.pick(32, 512, 2048)
}

fn strategies(k: u32, sampled_steps: u64) -> Vec<Strategy> {
    let mut all = Vec::new();
    let sampled = |method, store| {
        let strategy = Strategy::new(Subdivision::Uniform(k), method);
        let solver = STOCHASTIC.to_owned();
        Strategy { store, solver, unshot: UNSHOT, steps: sampled_steps, ..strategy }
    };
    // Solvers of one system come one after the other: its exact solution is taken once.
    for store in Store::ALL {
        // What a store costs shows with one method of each kind.
        let solvers = if store == Store::Dense { &NAMES[..] } else { &ON_ALL_STORES };
        for &solver in solvers {
            let strategy = Strategy::new(Subdivision::Uniform(k), METHOD);
            all.push(Strategy { store, solver: solver.to_owned(), unshot: UNSHOT, ..strategy });
        }
        if store == Store::Dense {
            all.push(sampled(METHOD, store));
        }
    }
    all.push(sampled(Method::RAY_CAST, Store::KeepNone));
    all
}

impl Experiment for Solvers {
    fn name(&self) -> &'static str {
        "04-solvers"
    }

    fn question(&self) -> &str {
        "Which method solves the radiosity system first as the reflectance grows, and when does keeping form factors pay?"
    }

    fn expects(&self) -> &str {
        "Jacobi contracts by at most ρ, Gauss–Seidel takes about half its sweeps, conjugate gradients a number that hardly \
         grows, a direct method does not see ρ. Shooting leads early. Recomputing form factors pays only for a method that \
         reads few rows. The error of the stochastic method falls like the inverse root of time, with or without form factors."
    }

    fn settings(&self, profile: Profile) -> serde_json::Value {
        serde_json::json!({
            "elements": elements(profile), "reflectances": largest_reflectances(profile), "unshot": UNSHOT,
            "method": format!("{METHOD:?}"), "sampled_steps": sampled_steps(profile),
            "changed_elements": changed_elements(profile), "changes": changes::CHANGES,
        })
    }

    fn slack(&self, column: &str) -> f64 {
        // Solver errors near rounding differ in their digits between processors.
        if column == "solver_error" { 1e-9 } else { 0.0 }
    }

    fn run(&self, context: &mut Context) -> Result<(), Box<dyn Error>> {
        let profile = context.profile();
        let reflectances = largest_reflectances(profile);
        let strategies = strategies(elements(profile), sampled_steps(profile));
        context.begin(reflectances.len() * (strategies.len() + 4) + changes::CHANGES.len());
        let scene = cornell()?;
        let largest = scene.materials.iter().flat_map(|m| &m.reflectance).copied().fold(0.0, f64::max);
        for rho in reflectances {
            let scene = with_reflectance(&scene, rho / largest);
            let fineness = profile.pick(
                Fineness::uniform(4, 4, 64, 32),
                Fineness::uniform(8, 8, 512, 128),
                Fineness::uniform(16, 16, 2048, 256),
            );
            let truth = truth(&scene, fineness, GRID)?;
            let reference_error = truth.error;
            context.advance(4, format!("ρ = {rho}: reference"));
            let best = Method::exact(1e-10, 1e-7);
            let mut yardstick = Yardstick::new(&scene, truth.grid, GRID, best, 4 << 20);
            for strategy in &strategies {
                let key = format!("{rho}/{}/{}", strategy.store.name(), strategy.solver);
                let measured = yardstick.measure(strategy, true)?;
                for point in &measured.history {
                    let line = described(format!("{key}/step {}", point.step), strategy)
                        .text("kind", "step")
                        .float("reflectance", rho)
                        .int("step", point.step)
                        .float("solver_error", point.solver_error)
                        .float("error", point.error);
                    let line = counts(line, &point.cost).seconds("time", point.seconds);
                    context.record(line.seconds("solve_time", point.solver_seconds));
                }
                let line: Record = record(key.clone(), strategy, &measured)
                    .text("kind", "run")
                    .float("reflectance", rho)
                    .float("reference_error", reference_error);
                left_out(context, "Cornell box", strategy, &measured.run.geometry, Some(&measured.run));
                context.record(times(line, &scene, strategy, &measured)?);
                context.tick(key);
            }
        }
        let exact = Strategy::new(Subdivision::Uniform(changed_elements(profile)), Method::ANALYTIC);
        changes::run(context, &scene, &exact)
    }

    fn plots(&self, tables: &Tables) -> Vec<Figure> {
        // Histories on the dense store, one panel a reflectance.
        let history = |x: &'static str, label: &str, unit: &str, store: &str, y: (&'static str, &str)| {
            let steps =
                tables.select(|r| r.text("kind") == "step" && r.text("store") == store && r.number("step") >= 1.0);
            let picked = group_by(steps, "reflectance")
                .into_iter()
                .filter(|(rho, _)| ["0.5", "0.9", "0.99"].contains(&rho.as_str()));
            let panels = picked.map(|(rho, rows)| {
                let series = group_by(rows, "solver").into_iter().map(|(solver, rows)| {
                    Series::new(&*solver, &*solver).rows(rows, |r| {
                        (if x.ends_with("time") { r.seconds(x) } else { r.number(x) }, r.number(y.0).max(FLOOR))
                    })
                });
                let level = Axis::log(y.1, "share of the mean");
                let level = if y.0 == "solver_error" { level.limits(FLOOR, 2.0) } else { level };
                let axes = (Axis::log(label, unit), level);
                Panel::new(axes.0, axes.1).title(format!("largest ρ = {rho}")).all_series(series)
            });
            panels.collect::<Vec<_>>()
        };
        let sweeps = {
            let converged =
                |r: &radiosity_experiments::Row<'_>| r.text("kind") == "run" && r.text("solver") != STOCHASTIC;
            let rows = tables.select(|r| converged(r) && r.text("store") == "dense");
            let series = group_by(rows, "solver").into_iter().map(|(solver, rows)| {
                let passes = move |r: &radiosity_experiments::Row<'_>| {
                    let m = r.number("elements");
                    (1.0 / (1.0 - r.number("reflectance")), (r.number("entries_read") / (m * m)).max(1.0))
                };
                Series::new(&*solver, &*solver).rows(rows, passes)
            });
            let series: Vec<_> = series.collect();
            Panel::new(Axis::log("1/(1 − ρ)", ""), Axis::log("passes over the form factors", ""))
                .title("passes")
                .all_series(series)
        };
        let stores = {
            let rows = tables.select(|r| r.text("kind") == "run" && r.text("reflectance") == "0.9");
            let bars = [("kept, dense", "dense"), ("recomputed", "on-demand, recomputed")].map(|(label, store)| {
                let time = |solver: &str| {
                    let run = rows.iter().find(|r| r.text("store") == store && r.text("solver") == solver);
                    run.map_or(f64::NAN, |r| r.seconds("time"))
                };
                let heights = ON_ALL_STORES.iter().enumerate().map(|(k, solver)| (k as f64, time(solver)));
                Series::new(label, if store == "dense" { "dense" } else { "on-demand" }).values(heights)
            });
            Panel::bars(ON_ALL_STORES, Axis::linear("time", "s")).title("kept or recomputed, ρ = 0.9").all_series(bars)
        };
        let sampling = ["0.5", "0.9", "0.99"].into_iter().filter_map(|rho| {
            let steps = |store: &str| {
                tables.select(|r| {
                    let own = r.text("kind") == "step" && r.text("solver") == STOCHASTIC && r.text("store") == store;
                    own && r.text("reflectance") == rho && r.number("step") >= 1.0
                })
            };
            let series = [
                ("rows held", STOCHASTIC, "dense", Dash::Solid),
                ("rays of its own", "ray-cast", "on-demand, recomputed", Dash::Dashed),
            ];
            let series = series.map(|(label, colour, store, dash)| {
                let time = |r: &radiosity_experiments::Row<'_>| (r.seconds("solve_time"), r.number("solver_error"));
                Series::new(label, colour).rows(steps(store), time).dash(dash)
            });
            let axes = (Axis::log("time in the solver", "s"), Axis::log("solver error", "share of the mean"));
            let panel = Panel::new(axes.0, axes.1).title(format!("largest ρ = {rho}")).all_series(series);
            (!steps("dense").is_empty()).then(|| panel.slope(-0.5, "slope −½"))
        });
        let sampling: Vec<_> = sampling.collect();
        let solver_error = ("solver_error", "solver error");
        vec![
            Figure::new("solver-error-time", "Solver error against time in the solver, dense store")
                .caption("Without the time to fill the store, which is the same for all. Marks lie at geometric steps of one run; errors below 10⁻¹⁰ are drawn there.")
                .panels(history("solve_time", "time in the solver", "s", "dense", solver_error))
                .shared_y(),
            Figure::new("solver-error-entries", "Solver error against entries read, dense store")
                .caption("Entries read are exact counts: m² is one pass.")
                .panels(history("entries_read", "entries read", "", "dense", solver_error))
                .shared_y(),
            Figure::new("error-time", "Error against the whole time, rows computed on demand and kept")
                .caption("Error against the reference, so that it ends at the level of the mesh; time includes form factors.")
                .panels(history("time", "time", "s", "on-demand, kept", ("error", "error")))
                .shared_y(),
            Figure::new("error-form-factors", "Error against form factors computed, rows computed on demand and kept")
                .caption("Shooting has an answer before most rows have been computed; the others need all of them for their first step.")
                .panels(history("form_factors", "form factors computed", "", "on-demand, kept", ("error", "error")))
                .shared_y(),
            Figure::new("reflectance", "Passes against reflectance, and form factors kept or recomputed")
                .caption("Passes: entries read over m². Right: time of a whole run to η = 10⁻⁸, form factors included.")
                .panel(sweeps)
                .panel(stores),
            Figure::new("sampling", "Stochastic Jacobi iteration: error of the answer as sampled, against time")
                .caption("On rows that are held, and by rays of its own without any form factor, against the exact form factors. The first steps shoot what is unshot; the later ones shoot all of it, and their answers are averaged.")
                .panels(sampling)
                .shared_y(),
            changes::figure(tables),
        ]
    }

    fn reading(&self, tables: &Tables) -> Vec<String> {
        let runs = tables.select(|r| r.text("kind") == "run");
        let find = |rho: &str, store: &str, solver: &str| {
            runs.iter()
                .find(|r| r.text("reflectance") == rho && r.text("store") == store && r.text("solver") == solver)
                .copied()
        };
        let steps = |rho: &str, solver: &str| {
            find(rho, "dense", solver).map_or_else(|| "?".into(), |r| r.text("steps").to_owned())
        };
        let last = runs.last().map_or("0.9", |r| r.text("reflectance"));
        let first = runs.first().map_or("0.9", |r| r.text("reflectance"));
        let sampled = |store: &str| {
            let error = find(last, store, STOCHASTIC).map_or(f64::NAN, |r| r.number("solver_error"));
            format!("{error:.1e}")
        };
        let seconds = |store: &str, solver: &str| {
            find(last, store, solver).map_or_else(|| "?".into(), |r| numbers::seconds(r.seconds("time")))
        };
        let mut reading = vec![
            format!(
                "From ρ = {first} to {last} Jacobi goes from {} to {} sweeps, Gauss–Seidel from {} to {}, conjugate gradients from {} to \
                 {} products.",
                steps(first, "jacobi"),
                steps(last, "jacobi"),
                steps(first, "gauss-seidel"),
                steps(last, "gauss-seidel"),
                steps(first, "cg"),
                steps(last, "cg")
            ),
            format!(
                "At ρ = {last}, recomputing form factors takes Jacobi {} instead of {}, shooting {} instead of {}.",
                seconds("on-demand, recomputed", "jacobi"),
                seconds("dense", "jacobi"),
                seconds("on-demand, recomputed", "shooting"),
                seconds("dense", "shooting")
            ),
            format!(
                "At ρ = {last}, the stochastic method is at {} in {} on held rows and at {} in {} by rays of its own.",
                sampled("dense"),
                seconds("dense", STOCHASTIC),
                sampled("on-demand, recomputed"),
                seconds("on-demand, recomputed", STOCHASTIC)
            ),
        ];
        reading.extend(changes::reading(tables));
        reading
    }
}
