//! Few against many patches.
//!
//! Question: what does constant radiosity on m patches cost, and how wrong is it? Theory: the matrix has m² entries, so
//! memory grows like m² and time at least so; the error of a piecewise constant answer falls like the patch size h, so
//! like m^(−1/2), slower where shadows are sharp. Measured on the Cornell box (reference: a much finer run), on a
//! floor under a light and in a room with a manufactured solution (reference: exact, at 128 × 128 points a face, where
//! blockiness counts). Read: points of one method lie on a line whose slope is the order. Not shown: substructuring
//! (02), other solvers (04).

use std::error::Error;

use radiosity::{Geometry, GridValues, Method, Shape, Store, Strategy, Yardstick, rows};
use radiosity_core::{BandValues, Form, StopRule, System, solve};
use radiosity_experiments::{Context, Experiment, Profile, Record, SeriesOfRows, Tables, group_by, timed};
use radiosity_form_factors::stores::DenseFormFactors;
use radiosity_gallery::{FloorUnderLight, ManufacturedRoom};
use radiosity_geometry::mesh::{MeshSettings, Subdivision};
use radiosity_plot::fit::PowerLaw;
use radiosity_plot::numbers;
use radiosity_plot::{Axis, Figure, Panel, Series};
use radiosity_solvers::GaussSeidel;

use crate::common::{GRID, cornell, cornell_truth, exponent, left_out, picture, picture_side, record, times, value};

/// Points along an edge of a face where the exact scenes are compared.
const POINTS: u32 = 128;

/// The experiment.
pub struct Patches;

/// Estimators with their meshes of the Cornell box and of the exact scenes, elements along an edge of a face.
fn methods(profile: Profile) -> Vec<(Method, Vec<u32>, Vec<u32>)> {
    let analytic = Method::sampled(1e-8, 256);
    let rays = Method::rays(1024);
    let hemicube = Method::Hemicube { resolution: 64 };
    let both = Method::RaysAndEmitters { rays: 1024 };
    let few = || vec![1, 2, 4];
    let many = profile.pick(few(), vec![1, 2, 4, 8, 16], vec![1, 2, 4, 8, 16, 24]);
    let some = profile.pick(few(), vec![1, 2, 4, 8], vec![1, 2, 4, 8, 16]);
    let exact = profile.pick(few(), vec![1, 2, 4, 8, 16], vec![1, 2, 4, 8, 16, 32]);
    vec![
        (analytic, some.clone(), exact),
        (rays, some.clone(), some.clone()),
        (both, many, Vec::new()),
        (hemicube, some.clone(), some),
    ]
}

impl Experiment for Patches {
    fn name(&self) -> &'static str {
        "01-patches"
    }

    fn question(&self) -> &str {
        "What does constant radiosity on few or on many patches cost, and how wrong is it?"
    }

    fn expects(&self) -> &str {
        "Form factors and memory grow like m². The error falls like the patch size, m^(−1/2), and slower where shadows \
         are sharp; random errors of an estimator that do not fall with m show as a floor."
    }

    fn settings(&self, profile: Profile) -> serde_json::Value {
        serde_json::json!({ "methods": format!("{:?}", methods(profile)), "unshot": 1e-8, "points": POINTS, "seed": 1 })
    }

    fn slack(&self, column: &str) -> f64 {
        // Differences of nearly equal answers: their last digits depend on the processor.
        if column.starts_with("solver_error") || column == "form_factor_error" { 1e-12 } else { 0.0 }
    }

    fn run(&self, context: &mut Context) -> Result<(), Box<dyn Error>> {
        let profile = context.profile();
        let methods = methods(profile);
        context.begin(methods.iter().map(|(_, sizes, exact)| sizes.len() + 2 * exact.len()).sum::<usize>() + 3);
        let scene = cornell()?;
        let truth = cornell_truth(context, &scene)?;
        let reference_error = truth.error;
        let best = Method::exact(1e-10, 1e-7);
        let most_pairs = profile.pick(1 << 14, 1 << 20, 16 << 20);
        let mut yardstick = Yardstick::new(&scene, truth.grid, GRID, best, most_pairs);
        for (method, sizes, _) in &methods {
            for &k in sizes {
                let strategy = strategy(k, *method);
                let measured = yardstick.measure(&strategy, false)?;
                let line = record(format!("cornell/{}/{k}", method.name()), &strategy, &measured)
                    .text("scene", "Cornell box")
                    .float("reference_error", reference_error);
                left_out(context, "Cornell box", &strategy, &measured.run.geometry, Some(&measured.run));
                context.record(times(line, &scene, &strategy, &measured)?);
                context.tick(format!("Cornell box, {k} × {k} by {}", method.name()));
            }
        }
        for (method, _, exact) in &methods {
            for &k in exact {
                context.record(floor(k, *method)?);
                context.tick(format!("floor, {k} × {k} by {}", method.name()));
                context.record(room(k, *method)?);
                context.tick(format!("room, {k} × {k} by {}", method.name()));
            }
        }
        // Pictures: few patches, many, and few patches with many elements.
        let (few, many) = profile.pick((1, 2), (2, 16), (2, 24));
        let fine = Method::rays(profile.pick(64, 4096, 16_384));
        for (name, caption, elements, patches) in [
            ("few", format!("{few} × {few} patches a face"), few, None),
            ("many", format!("{many} × {many} patches a face"), many, None),
            ("substructured", format!("{few} × {few} patches a face, {many} × {many} elements"), many, Some(few)),
        ] {
            let mut strategy = strategy(elements, fine);
            if let Some(patches) = patches {
                strategy.mesh.patches = Some(Subdivision::Uniform(patches));
                strategy.shape = Shape::ElementsToPatches;
            }
            let run = radiosity::run(&scene, &Strategy { verify: false, ..strategy }, &mut ())?;
            let image = picture(&run.geometry, &run.solution.radiosity, picture_side(profile))?;
            context.picture(name, &caption, image.width, image.height, &image.rgb)?;
            context.tick(caption);
        }
        Ok(())
    }

    fn plots(&self, tables: &Tables) -> Vec<Figure> {
        let m = || Axis::log("elements m", "");
        let by_scene = |y: &'static str, label: &str, unit: &str, fitted: bool| {
            let panels = group_by(tables.rows(), "scene").into_iter().map(|(scene, rows)| {
                let series = group_by(rows, "method").into_iter().map(|(method, rows)| {
                    let series = Series::new(&*method, &*method).rows(rows, |r| (r.number("elements"), value(r, y)));
                    if fitted { series.fit_from(50.0) } else { series }
                });
                Panel::new(m(), Axis::log(label, unit)).title(scene).all_series(series)
            });
            panels.collect::<Vec<_>>()
        };
        let error = Figure::new("error", "Error of irradiance against the number of patches")
            .caption("rms over 8 × 8 cells a face (Cornell box) or 128 × 128 points a face (exact scenes), relative to the mean.")
            .panels(by_scene("error", "error", "share of the mean", false));
        let time = Figure::new("time", "Time and memory of a solution")
            .caption("Slopes are fitted from 50 elements on. In the room nothing blocks, so a pair costs the same on every mesh.")
            .panel(panel_of(tables, "manufactured room", "time", "time", "s"))
            .panel(panel_of(tables, "Cornell box", "time", "time", "s"))
            .panel(panel_of(tables, "Cornell box", "stored_bytes", "memory of form factors", "bytes"));
        let both = Figure::new("error-time", "Error against time")
            .caption("One mark a mesh; down and to the left is better.")
            .panels(group_by(tables.rows(), "scene").into_iter().map(|(scene, rows)| {
                let series = group_by(rows, "method").into_iter().map(|(method, rows)| {
                    Series::new(&*method, &*method).rows(rows, |r| (r.seconds("time"), r.number("error")))
                });
                let axes = (Axis::log("time", "s"), Axis::log("error", "share of the mean"));
                Panel::new(axes.0, axes.1).title(scene).all_series(series)
            }));
        vec![error, time, both]
    }

    fn reading(&self, tables: &Tables) -> Vec<String> {
        let say = |scene: &str, method: &str, column: &str| {
            let rows = tables.select(|r| r.text("scene") == scene && r.text("method") == method);
            let large = rows.iter().filter(|r| r.number("elements") >= 50.0);
            exponent(PowerLaw::through(large.map(|r| (r.number("elements"), value(r, column)))))
        };
        let finest = |method: &str| {
            let rows = tables.select(|r| r.text("scene") == "Cornell box" && r.text("method") == method);
            let last = rows.last().map(|r| (r.number("error"), r.seconds("time"), r.number("elements")));
            last.map_or_else(String::new, |(error, time, m)| {
                format!("{} at {m} elements in {}", numbers::percent(error), numbers::seconds(time))
            })
        };
        vec![
            format!(
                "With nothing in the way, time grows like m^{} for analytic pairs, m^{} for 1,024 rays a row and m^{} for hemicubes; \
                 the memory of a dense matrix grows like m^{}.",
                say("manufactured room", "analytic", "time"),
                say("manufactured room", "ray-cast", "time"),
                say("manufactured room", "hemicube", "time"),
                say("Cornell box", "analytic", "stored_bytes"),
            ),
            format!(
                "On the Cornell box the finest runs reach {} (analytic), {} (rays), {} (rays with exact emitters) and {} (hemicubes).",
                finest("analytic"),
                finest("ray-cast"),
                finest("rays+emitters"),
                finest("hemicube")
            ),
        ]
    }
}

fn panel_of(tables: &Tables, scene: &str, column: &'static str, label: &str, unit: &str) -> Panel {
    let rows = tables.select_eq("scene", scene);
    let series = group_by(rows, "method").into_iter().map(|(method, rows)| {
        Series::new(&*method, &*method).rows(rows, |r| (r.number("elements"), value(r, column))).fit_from(50.0)
    });
    Panel::new(Axis::log("elements m", ""), Axis::log(label, unit)).title(scene).all_series(series)
}

fn strategy(k: u32, method: Method) -> Strategy {
    Strategy { unshot: 1e-8, store: Store::Dense, ..Strategy::new(Subdivision::Uniform(k), method) }
}

/// Direct light with an exact answer at every point of the floor.
fn floor(k: u32, method: Method) -> Result<Record, Box<dyn Error>> {
    let case = FloorUnderLight::default();
    let scene = case.scene();
    let strategy = strategy(k, method);
    let ((run, points), seconds) = {
        let (result, seconds) =
            timed(3, || radiosity::run(&scene, &Strategy { verify: false, ..strategy.clone() }, &mut ()));
        let run = result?;
        let points = GridValues::points(&run.geometry, &run.solution.radiosity, POINTS).on(&[0]);
        ((run, points), seconds)
    };
    // H = B/ρ on the floor, where nothing is emitted.
    let points = map_values(&points, |_, b| b / case.reflectance);
    let truth = map_values(&points, |c, _| {
        let (i, j) = points.indices[c];
        case.irradiance(centre(i), centre(j))
    });
    let error = points.error(&truth);
    Ok(crate::common::counts(crate::common::described(format!("floor/{}/{k}", method.name()), &strategy), &run.cost())
        .text("scene", "floor under a light")
        .text("outcome", run.solution.outcome)
        .int("elements", run.geometry.elements().len())
        .int("stored_bytes", run.stored_bytes)
        .float("error", error.rms)
        .float("worst_cell", error.worst)
        .repetitions("time", &seconds))
}

/// A room whose emission is chosen so that the radiosity is constant on each face.
fn room(k: u32, method: Method) -> Result<Record, Box<dyn Error>> {
    let case = ManufacturedRoom::default();
    let scene = case.scene();
    let strategy = strategy(k, method);
    let settings = MeshSettings { elements: Subdivision::Uniform(k), patches: None, contacts: true };
    // The means of E are data of the case, not work of the method.
    let mesh = Geometry::new(&scene, &settings)?;
    let mean_emission = |&e: &u32| {
        let element = mesh.mesh().elements[e as usize];
        let range = |i: u32| [f64::from(i) / f64::from(k), f64::from(i + 1) / f64::from(k)];
        case.mean_emission(element.surface as usize, range(element.i), range(element.j))
    };
    let emission = BandValues::single(mesh.exposed().iter().map(mean_emission).collect());
    let work = || -> Result<_, Box<dyn Error>> {
        let geometry = Geometry::new(&scene, &settings)?;
        let (store, cost) = DenseFormFactors::assemble(&*rows(&geometry, method, Form::Full, 1)?)?;
        let (e, rho) = (&emission, geometry.reflectance());
        let areas = geometry.elements().areas();
        let system = System::full(&store, &areas, e.view(), rho.view())?;
        let solution = solve(&system, &mut GaussSeidel::default(), &StopRule::unshot(strategy.unshot), &mut ())?;
        drop(system);
        Ok((geometry, cost, solution, store))
    };
    let (result, seconds) = timed(1, work);
    let (geometry, cost, solution, store) = result?;
    let points = GridValues::points(&geometry, &solution.irradiance, POINTS);
    let truth = map_values(&points, |c, _| {
        let (i, j) = points.indices[c];
        case.irradiance(points.surfaces[c] as usize, centre(i), centre(j))
    });
    let error = points.error(&truth);
    let bytes = radiosity_core::FormFactors::properties(&store).stored_bytes;
    Ok(crate::common::counts(
        crate::common::described(format!("room/{}/{k}", method.name()), &strategy),
        &(cost + solution.cost),
    )
    .text("scene", "manufactured room")
    .text("outcome", solution.outcome)
    .int("elements", geometry.elements().len())
    .int("stored_bytes", bytes)
    .float("error", error.rms)
    .float("worst_cell", error.worst)
    .repetitions("time", &seconds))
}

fn centre(i: u32) -> f64 {
    (f64::from(i) + 0.5) / f64::from(POINTS)
}

fn map_values(grid: &GridValues, f: impl Fn(usize, f64) -> f64) -> GridValues {
    let values = grid.values.values().iter().enumerate().map(|(c, &v)| f(c % grid.areas.len(), v)).collect();
    GridValues { values: BandValues::new(values, grid.areas.len()), ..grid.clone() }
}
