//! From a thousand elements to a million.
//!
//! Question: how do cost and memory grow with the elements, and what does a large scene cost at about 1 %? Theory: form factors of the full
//! form grow like m², under fixed patches like m; rays find a number of targets a row that m hardly changes; adaptive
//! meshes put elements where they count; links join groups, so that their number grows like m or slower. Measured on the Cornell
//! box (reference: a much finer run) and on generated cities, whose facets are the elements, of up to 22,745 facets
//! (reference: rows of many more rays). Rooms of 0 to 256 boxes show links alone, as surfaces and blockers grow. Read: slopes; a line ends
//! where a strategy's time or memory did. Memory is that of form factors or links, as counted by the store. Not shown: the memory of the mesh; errors of
//! a city beyond those of sampling, since its facets are the elements.

use std::error::Error;

use radiosity::{
    Adaptive, DirectLight, ErrorMeasure, Goal, GridValues, LINK_ERROR, Method, Run, Shape, Store, Strategy,
    run_adaptive,
};
use radiosity_core::BandValues;
use radiosity_experiments::{Context, Experiment, Profile, Record, Row, SeriesOfRows, Tables, group_by};
use radiosity_gallery::{city, crowded_room};
use radiosity_geometry::mesh::Subdivision;
use radiosity_geometry::{Occluders, Scene};
use radiosity_plot::fit::PowerLaw;
use radiosity_plot::numbers;
use radiosity_plot::{Axis, Figure, Panel, Series};

use crate::common::{GRID, cornell, cornell_truth, counts, exponent, left_out, value};

/// The experiment.
pub struct Scale;

/// Elements along an edge of a face of the Cornell box, by strategy; for adaptive runs tolerances.
fn sizes(profile: Profile, strategy: &str) -> Vec<u32> {
    match strategy {
        "full" => profile.pick(vec![2, 4], vec![4, 8], vec![8, 16, 24]),
        "elements-to-patches" => profile.pick(vec![4, 8], vec![8, 16, 32], vec![8, 16, 32, 64, 96]),
        "hierarchical" => profile.pick(vec![4, 8], vec![8, 16, 32, 64], vec![8, 16, 32, 64, 128, 232]),
        _ => profile.pick(vec![16, 32], vec![8, 16, 32, 64], vec![8, 16, 32, 64, 96]),
    }
}

/// Tolerances of adaptive runs.
fn tolerances(profile: Profile) -> Vec<f64> {
    profile.pick(vec![0.2], vec![0.04, 0.02], vec![0.04, 0.02, 0.01])
}

/// Buildings along an edge of the cities, and rays of a row; the last number of rays is that of the reference.
fn cities(profile: Profile) -> (Vec<u32>, Vec<u32>) {
    profile.pick(
        (vec![1], vec![64, 256]),
        (vec![2, 4], vec![128, 512, 4096]),
        (vec![4, 7, 10, 14], vec![128, 512, 2048, 8192]),
    )
}

/// Boxes in the rooms of which links are counted, and the longest edge of an element.
fn rooms(profile: Profile) -> (Vec<u32>, f64) {
    profile.pick((vec![1], 1.0), (vec![0, 16, 64], 0.5), (vec![0, 4, 16, 64, 256], 0.25))
}

/// Error asked of links in a city, for 1 %: among so many blockers they err by up to a fifth more than they estimate.
const CITY_LINK_ERROR: f64 = 0.009;

const STRATEGIES: [&str; 4] = ["full", "elements-to-patches", "rays+emitters", "hierarchical"];

fn strategy(name: &str, k: u32) -> Strategy {
    let plain = |method| Strategy { unshot: 1e-3, verify: false, ..Strategy::new(Subdivision::Uniform(k), method) };
    let jacobi = || "jacobi".to_owned();
    match name {
        "full" => Strategy { store: Store::Packed, ..plain(Method::exact(1e-6, 1e-4)) },
        "elements-to-patches" => {
            let mut strategy = plain(Method::RaysAndEmitters { rays: 256 });
            strategy.mesh.patches = Some(Subdivision::Uniform(4));
            Strategy { shape: Shape::ElementsToPatches, solver: jacobi(), ..strategy }
        }
        "hierarchical" => Strategy { store: Store::HIERARCHICAL, solver: jacobi(), ..plain(Method::OF_LINKS) },
        _ => Strategy { store: Store::Sparse, solver: jacobi(), ..plain(Method::RaysAndEmitters { rays: 256 }) },
    }
}

/// Links to an estimated error among whatever blocks in a scene.
fn by_links(scene: &Scene, elements: Subdivision, error: f64) -> Strategy {
    let store = Store::Hierarchical { error, direct: DirectLight::WhereFew };
    let method = Method::of_links_among(Occluders::blocking(scene).len());
    let plain = Strategy::new(elements, method);
    Strategy { store, solver: "jacobi".to_owned(), unshot: 1e-3, verify: false, ..plain }
}

fn line(key: String, name: &str, run: &Run<'_>, error: &ErrorMeasure, reference_error: f64) -> Record {
    described(key, name, run)
        .float("error", error.rms)
        .float("worst_cell", error.worst)
        .float("reference_error", reference_error)
}

/// What a run took.
fn described(key: String, name: &str, run: &Run<'_>) -> Record {
    counts(Record::new(key), &run.cost())
        .text("form", name)
        .text("outcome", run.solution.outcome)
        .int("elements", run.geometry.elements().len())
        .int("stored_bytes", run.stored_bytes)
        .int("links", run.hierarchical.as_ref().map_or(0, |links| links.links))
        .seconds("time", run.seconds())
}

impl Experiment for Scale {
    fn name(&self) -> &'static str {
        "07-scale"
    }

    fn question(&self) -> &str {
        "How do cost and memory grow from a thousand elements to a million?"
    }

    fn expects(&self) -> &str {
        "The full form like m², fixed patches and rows of rays like m, links like m or slower; adaptive meshes need fewer elements."
    }

    fn settings(&self, profile: Profile) -> serde_json::Value {
        let of = |name: &&str| serde_json::json!([name, sizes(profile, name)]);
        serde_json::json!({
            "sizes": STRATEGIES.iter().map(of).collect::<Vec<_>>(), "tolerances": tolerances(profile),
            "cities": cities(profile), "city_link_error": CITY_LINK_ERROR, "rooms": rooms(profile), "unshot": 1e-3, "seed": 1
        })
    }

    fn run(&self, context: &mut Context) -> Result<(), Box<dyn Error>> {
        let profile = context.profile();
        let (blocks, rays) = cities(profile);
        let boxes: usize = STRATEGIES.iter().map(|name| sizes(profile, name).len()).sum();
        context.begin(boxes + tolerances(profile).len() + blocks.len() * (rays.len() + 1) + rooms(profile).0.len());
        let scene = cornell()?;
        let truth = cornell_truth(context, &scene)?;
        for name in STRATEGIES {
            for k in sizes(profile, name) {
                let run = radiosity::run(&scene, &strategy(name, k), &mut ())?;
                let error = GridValues::means(&run.geometry, &run.solution.irradiance, GRID)?.error(&truth.grid);
                let record = line(format!("Cornell box/{name}/{k}"), name, &run, &error, truth.error);
                left_out(context, "Cornell box", &strategy(name, k), &run.geometry, Some(&run));
                context.record(record.text("scene", "Cornell box"));
                context.tick(format!("Cornell box, {k} × {k}, {name}"));
            }
        }
        for tolerance in tolerances(profile) {
            let plain = strategy("elements-to-patches", 4);
            let gathering = Strategy { method: Method::RAYS_AND_EMITTERS, ..plain };
            let done = run_adaptive(&scene, &gathering, &Adaptive::new(Goal::Cells(GRID), tolerance))?;
            let error = GridValues::means(&done.run.geometry, &done.run.solution.irradiance, GRID)?.error(&truth.grid);
            let record = line(format!("Cornell box/adaptive/{tolerance}"), "adaptive", &done.run, &error, truth.error);
            context.record(record.text("scene", "Cornell box"));
            context.tick(format!("Cornell box, adaptive to {tolerance}"));
        }
        for blocks in blocks {
            let scene = city(blocks, 4, 1);
            let mut runs = Vec::new();
            for &rays in &rays {
                let method = Method::rays(rays);
                let plain = Strategy { unshot: 1e-6, verify: false, ..Strategy::new(Subdivision::Uniform(1), method) };
                let strategy = Strategy { store: Store::Sparse, solver: "jacobi".to_owned(), ..plain };
                let run = radiosity::run(&scene, &strategy, &mut ())?;
                let name = format!("city of {} facets", scene.surfaces.len());
                left_out(context, &name, &strategy, &run.geometry, Some(&run));
                runs.push((rays, grid(&run), run));
                context.tick(format!("city of {} facets, {rays} rays", scene.surfaces.len()));
            }
            let links = radiosity::run(&scene, &by_links(&scene, Subdivision::Uniform(1), CITY_LINK_ERROR), &mut ())?;
            context.tick(format!("city of {} facets, links", scene.surfaces.len()));
            let Some((_, truth, _)) = runs.last() else { continue };
            // The error of rays falls at least like the root of their number, which quadruples: the reference errs half as much.
            let errors: Vec<ErrorMeasure> = runs.iter().map(|(_, grid, _)| grid.error(truth)).collect();
            let reference_error = errors.iter().rev().nth(1).map_or(0.0, |error| 0.5 * error.rms);
            for ((rays, _, run), error) in runs.iter().zip(&errors).take(runs.len() - 1) {
                let record = line(format!("city/{blocks}/{rays}"), "ray-cast", run, error, reference_error);
                context.record(record.text("scene", "city").text("city_by", format!("{rays} rays a row")));
            }
            let error = grid(&links).error(truth);
            let record = line(format!("city/{blocks}/links"), "hierarchical", &links, &error, reference_error);
            context.record(record.text("scene", "city").text("city_by", "links"));
        }
        let (boxes, edge) = rooms(profile);
        for boxes in boxes {
            let scene = crowded_room(boxes, 1);
            let strategy = by_links(&scene, Subdivision::EdgeLength(edge), LINK_ERROR);
            let run = radiosity::run(&scene, &strategy, &mut ())?;
            left_out(context, &format!("room of {boxes} boxes"), &strategy, &run.geometry, Some(&run));
            let record = described(format!("crowded room/{boxes}/links"), "hierarchical", &run);
            context.record(record.text("scene", "crowded room").int("boxes", boxes as usize));
            context.tick(format!("room of {boxes} boxes, links"));
        }
        Ok(())
    }

    fn plots(&self, tables: &Tables) -> Vec<Figure> {
        let cornell = |column: &'static str, label: &str, unit: &str| {
            let series = group_by(tables.select_eq("scene", "Cornell box"), "form").into_iter().map(|(form, rows)| {
                let line = Series::new(&*form, &*form).rows(rows, |r| (r.number("elements"), value(r, column)));
                if form == "adaptive" { line } else { line.fit() }
            });
            Panel::new(Axis::log("elements m", ""), Axis::log(label, unit)).title("Cornell box").all_series(series)
        };
        let city = |x: &'static str, x_label: &str, column: &'static str, label: &str, unit: &str| {
            let series = group_by(tables.select_eq("scene", "city"), "city_by")
                .into_iter()
                .map(|(rays, rows)| Series::new(&*rays, &*rays).rows(rows, |r| (value(r, x), value(r, column))));
            Panel::new(Axis::log(x_label, if x == "time" { "s" } else { "" }), Axis::log(label, unit))
                .title("city")
                .all_series(series)
        };
        vec![
            Figure::new("cost", "Time and memory against elements")
                .caption("Slopes are fitted. Time includes mesh, form factors and solution; memory is that of form factors or links.")
                .panel(cornell("time", "time", "s"))
                .panel(cornell("stored_bytes", "memory", "bytes")),
            Figure::new("error-time", "Error against time")
                .caption("rms of irradiance over 8 × 8 cells a face; one mark a mesh.")
                .panels({
                    let series = group_by(tables.select_eq("scene", "Cornell box"), "form");
                    let series = series.into_iter().map(|(form, rows)| {
                        Series::new(&*form, &*form).rows(rows, |r| (r.seconds("time"), r.number("error")))
                    });
                    let axes = (Axis::log("time", "s"), Axis::log("error", "share of the mean"));
                    [Panel::new(axes.0, axes.1).title("Cornell box").all_series(series)]
                }),
            Figure::new("city", "Cities of facets: rows of rays in the sparse store, and links")
                .caption("Error of irradiance of every facet against rows of many more rays.")
                .panel(city("elements", "facets", "time", "time", "s"))
                .panel(city("elements", "facets", "stored_bytes", "memory of form factors", "bytes"))
                .panel(city("time", "time", "error", "error", "share of the mean")),
        ]
    }

    fn reading(&self, tables: &Tables) -> Vec<String> {
        let slope = |form: &str, column: &str| {
            let rows = tables.select(|r| r.text("scene") == "Cornell box" && r.text("form") == form);
            exponent(PowerLaw::through(rows.iter().map(|r| (r.number("elements"), value(r, column)))))
        };
        let mut reading = vec![format!(
            "On the Cornell box time grows like m^{} in the full form, m^{} for rows of rays, m^{} under fixed patches and m^{} with links; \
             memory like m^{}, m^{}, m^{} and m^{}.",
            slope("full", "time"),
            slope("rays+emitters", "time"),
            slope("elements-to-patches", "time"),
            slope("hierarchical", "time"),
            slope("full", "stored_bytes"),
            slope("rays+emitters", "stored_bytes"),
            slope("elements-to-patches", "stored_bytes"),
            slope("hierarchical", "stored_bytes"),
        )];
        let links = tables.select(|r| r.text("scene") == "Cornell box" && r.text("form") == "hierarchical");
        if let Some(last) = links.last() {
            reading.push(format!(
                "{} elements take {} links and {}, at an error of {}.",
                last.number("elements"),
                last.number("links"),
                numbers::seconds(last.seconds("time")),
                numbers::percent(last.number("error"))
            ));
        }
        let cities = tables.select_eq("scene", "city");
        let largest = cities.iter().map(|r| r.number("elements")).fold(0.0, f64::max);
        let good = cities.iter().filter(|r| r.number("elements") == largest && r.number("error") <= 0.01);
        if let Some(first) = good.min_by(|a, b| a.seconds("time").total_cmp(&b.seconds("time"))) {
            reading.push(format!(
                "A city of {largest} facets is at {} with {} in {}, its form factors in {} MB.",
                numbers::percent(first.number("error")),
                first.text("city_by"),
                numbers::seconds(first.seconds("time")),
                (first.number("stored_bytes") / 1e6).round()
            ));
        }
        let a_facet = |rows: Vec<Row<'_>>, of: &str| {
            let each =
                rows.iter().map(|r| format!("{:.0} ({})", r.number("links") / r.number("elements"), r.number(of)));
            each.collect::<Vec<_>>().join(", ")
        };
        let by_links =
            |scene: &'static str| tables.select(move |r| r.text("scene") == scene && r.text("form") == "hierarchical");
        reading.push(format!(
            "Links an element: {} in cities (of so many facets), {} in rooms (of so many boxes); all pairs would be half as many as elements.",
            a_facet(by_links("city"), "elements"),
            a_facet(by_links("crowded room"), "boxes")
        ));
        reading
    }
}

/// Irradiance of the facets of a run, each one cell.
fn grid(run: &Run<'_>) -> GridValues {
    let irradiance: &BandValues = &run.solution.irradiance;
    GridValues {
        surfaces: run.geometry.surfaces(),
        indices: vec![(0, 0); irradiance.len()],
        areas: run.geometry.elements().areas(),
        values: irradiance.clone(),
    }
}
