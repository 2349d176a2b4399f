//! Form factors: error against time of the estimators and their settings.
//!
//! Question: which estimator reaches a given error of its form factors first, without and with something that blocks?
//! Theory: analytic pairs are exact where nothing blocks, at a cost that hardly depends on the tolerance, and where something
//! blocks their cost grows slowly with it; segments and rays fall like N^(−1/2) to N^(−3/4); hemicubes like 1/resolution until their assumption that a sender is a
//! point shows as a floor. Measured in an empty cube and in one with a box inside, 4 × 4 elements a face, every entry
//! against analytic pairs at tolerance 1e-12, partly blocked ones at 1e-10. Read: down and to the left is better. Not shown: time
//! to solve, and rows that are asked for one at a time.

use std::error::Error;

use radiosity::{Geometry, Method, Store, Strategy, assemble};
use radiosity_core::{Form, FormFactors, RowBuf};
use radiosity_experiments::{Context, Experiment, Profile, Record, Row, SeriesOfRows, Tables, group_by, timed};
use radiosity_form_factors::analytic::PartialVisibility;
use radiosity_gallery::boxes::{box_in_cube, material, unit_cube};
use radiosity_geometry::mesh::Subdivision;
use radiosity_plot::numbers;
use radiosity_plot::{Axis, Figure, Panel, Series};

use crate::common::{counts, described, left_out};

/// The experiment.
pub struct FormFactorErrors;

fn methods(profile: Profile) -> Vec<Method> {
    let mut all: Vec<Method> = Vec::new();
    for power in profile.pick(3..=4, 2..=7, 2..=9) {
        let tolerance = 10.0_f64.powi(-power);
        all.push(Method::exact(0.01 * tolerance, tolerance));
    }
    for power in profile.pick(4..=6, 4..=12, 4..=14) {
        all.push(Method::sampled(1e-9, 1 << power));
    }
    for power in profile.pick(6..=8, 6..=16, 6..=20) {
        all.push(Method::rays(1 << power));
    }
    for power in profile.pick(1..=1, 1..=2, 1..=3) {
        all.push(Method::RayCast { rays: 1 << 22, error: Some(10.0_f64.powi(-power)) });
    }
    for power in profile.pick(3..=5, 3..=10, 3..=11) {
        all.push(Method::Hemicube { resolution: 1 << power });
    }
    all
}

const REFERENCE: Method = Method::exact(1e-12, 1e-10);

/// How tables and figures call a method with the rule that it uses here.
fn estimator(method: Method) -> &'static str {
    match method {
        Method::Analytic { partial: PartialVisibility::Rays { .. }, .. } => "analytic, segments",
        Method::RayCast { error: Some(_), .. } => "ray-cast, adaptive",
        method => method.name(),
    }
}

impl Experiment for FormFactorErrors {
    fn name(&self) -> &'static str {
        "03-form-factors"
    }

    fn question(&self) -> &str {
        "Which estimator reaches a given error of its form factors first, without and with something that blocks?"
    }

    fn expects(&self) -> &str {
        "Without a blocker analytic pairs are exact at once, rays fall like N^(−1/2) or a little faster, hemicubes like \
         1/resolution down to the floor of a sender taken as a point. With a blocker exact visibility costs more the smaller the \
         tolerance, but far less than segments do."
    }

    fn settings(&self, profile: Profile) -> serde_json::Value {
        serde_json::json!({ "methods": format!("{:?}", methods(profile)), "reference": format!("{REFERENCE:?}"), "elements": 4 })
    }

    fn slack(&self, column: &str) -> f64 {
        // The error of the exact estimator is rounding against rounding.
        if column == "error" || column == "worst_entry" { 1e-10 } else { 0.0 }
    }

    fn run(&self, context: &mut Context) -> Result<(), Box<dyn Error>> {
        let methods = methods(context.profile());
        let grey = |name| material(name, 0.5, 0.0);
        let scenes =
            [("empty cube", unit_cube(grey("room"))), ("box in the cube", box_in_cube(0.4, grey("room"), grey("box")))];
        context.begin(2 * (methods.len() + 1));
        let elements = context.profile().pick(2, 4, 4);
        for (name, scene) in &scenes {
            let mesh = Strategy::new(Subdivision::Uniform(elements), REFERENCE).mesh;
            let geometry = Geometry::new(scene, &mesh)?;
            let (reference, _) = assemble(&geometry, REFERENCE, Form::Full, Store::Dense, 99)?;
            left_out(context, name, &Strategy::new(Subdivision::Uniform(elements), REFERENCE), &geometry, None);
            context.tick(format!("{name}: reference"));
            for &method in &methods {
                // Where nothing blocks there are no segments.
                if estimator(method) == "analytic, segments" && geometry.blockers().is_empty() {
                    context.tick("");
                    continue;
                }
                let (result, mut seconds) = timed(1, || assemble(&geometry, method, Form::Full, Store::Dense, 1));
                let (store, phase) = result?;
                if seconds[0] < 0.2 {
                    seconds.extend(timed(4, || assemble(&geometry, method, Form::Full, Store::Dense, 1).map(drop)).1);
                }
                let (rms, worst) = difference(&*store, &*reference, &geometry.elements().areas())?;
                let strategy = Strategy::new(Subdivision::Uniform(elements), method);
                let tolerance = if let Method::Analytic { tolerance, .. } = method { tolerance } else { 0.0 };
                let record =
                    described(format!("{name}/{}/{}", estimator(method), crate::common::setting(method)), &strategy);
                let record: Record = counts(record, &phase.cost)
                    .text("scene", name)
                    .text("estimator", estimator(method))
                    .float("tolerance", tolerance)
                    .int("elements", geometry.elements().len())
                    .int("clear_pairs", phase.cost.clear_pairs)
                    .int("hidden_pairs", phase.cost.hidden_pairs)
                    .int("partial_pairs", phase.cost.partial_pairs)
                    .text("outcome", "done")
                    .float("error", rms)
                    .float("worst_entry", worst);
                context.record(record.repetitions("time", &seconds));
                context.tick(format!("{name}: {method:?}"));
            }
        }
        Ok(())
    }

    fn plots(&self, tables: &Tables) -> Vec<Figure> {
        let panels = group_by(tables.rows(), "scene").into_iter().map(|(scene, rows)| {
            let series = group_by(rows, "estimator").into_iter().map(|(method, mut rows)| {
                rows.sort_by(|a, b| b.number("error").total_cmp(&a.number("error")));
                Series::new(&*method, &*method).rows(rows, |r| (r.seconds("time"), r.number("error")))
            });
            Panel::new(Axis::log("time", "s"), Axis::log("error of form factors", "relative rms"))
                .title(scene)
                .all_series(series)
        });
        let panels: Vec<_> = panels.collect();
        let order = ["analytic", "analytic, segments", "ray-cast", "hemicube"].map(|method| {
            let series = group_by(tables.select(|r: &Row<'_>| r.text("estimator") == method), "scene").into_iter().map(
                |(scene, rows)| {
                    let dash =
                        if scene == "empty cube" { radiosity_plot::Dash::Solid } else { radiosity_plot::Dash::Dashed };
                    Series::new(format!("{method}, {scene}"), method)
                        .rows(rows, |r| (r.number("setting"), r.number("error")))
                        .dash(dash)
                        .fit()
                },
            );
            let label = match method {
                "ray-cast" => "rays a row",
                "hemicube" => "resolution (pixels)",
                "analytic" => "tolerance of partly blocked pairs",
                _ => "segments a partly blocked pair",
            };
            Panel::new(Axis::log(label, ""), Axis::log("error of form factors", "relative rms"))
                .title(method)
                .all_series(series)
        });
        vec![
            Figure::new("error-time", "Error of form factors against time")
                .caption("All rows of the mesh; relative rms over all entries, weighted by the area of the sender.")
                .panels(panels),
            Figure::new("order", "Error against the setting of each estimator")
                .caption("The fitted slope is the observed order.")
                .panels(order)
                .shared_y(),
        ]
    }

    fn reading(&self, tables: &Tables) -> Vec<String> {
        group_by(tables.rows(), "scene")
            .into_iter()
            .map(|(scene, rows)| {
                let first = |method: &str, limit: f64| {
                    let reached = rows.iter().filter(|r| r.text("estimator") == method && r.number("error") <= limit);
                    reached.map(|r| r.seconds("time")).min_by(f64::total_cmp).map_or_else(|| "not at all".to_owned(), |time| format!("in {}", numbers::seconds(time)))
                };
                let best = |method: &str| {
                    let errors = rows.iter().filter(|r| r.text("estimator") == method).map(|r| r.number("error"));
                    numbers::significant(errors.fold(f64::INFINITY, f64::min), 2)
                };
                format!(
                    "In the {scene}, 1 % is reached by the analytic estimator {}, by rays {}, by hemicubes {}; 0.01 % {}, {} and {}. \
                     Their best errors here are {}, {} and {}.",
                    first("analytic", 1e-2), first("ray-cast", 1e-2), first("hemicube", 1e-2),
                    first("analytic", 1e-4), first("ray-cast", 1e-4), first("hemicube", 1e-4),
                    best("analytic"), best("ray-cast"), best("hemicube")
                )
            })
            .collect()
    }
}

/// rms over all entries of F − F* relative to that of F*, rows weighted by area, and the largest |F − F*|.
fn difference(
    store: &dyn FormFactors,
    reference: &dyn FormFactors,
    areas: &[f64],
) -> Result<(f64, f64), Box<dyn Error>> {
    let (mut square, mut norm, mut worst) = (0.0, 0.0, 0.0_f64);
    let (mut buf, mut reference_buf) = (RowBuf::default(), RowBuf::default());
    for (s, &area) in areas.iter().enumerate() {
        let row = store.row(s, 0, &mut buf)?;
        let expected = reference.row(s, 0, &mut reference_buf)?;
        for t in 0..areas.len() {
            let (f, exact) = (row.entries.get(t) / area, expected.entries.get(t) / area);
            square += area * (f - exact).powi(2);
            norm += area * exact.powi(2);
            worst = worst.max((f - exact).abs());
        }
    }
    Ok(((square / norm).sqrt(), worst))
}
