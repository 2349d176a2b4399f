//! Elements as a substructure of patches.
//!
//! Question: what do m elements under n patches save against m patches, and what do they cost in accuracy? Theory: m·n
//! form factors instead of m²; gathering (elements → patches) and the two-level form start the estimator for every
//! element, shooting (patches → elements) only for every patch; the error of a patch's constant radiosity stays while
//! n is small and vanishes as n → m. Measured on the Cornell box by hemicube, as in the course (reference: a much finer run),
//! and in an empty room by analytic pairs (reference: pairs on a finer mesh, whose cost a pair does not depend on what
//! blocks), with the same elements and n = m, m/4, m/16, m/64 patches, and with m growing at fixed n. On the Cornell box also elements
//! and patches that are cut where the estimated error is, to given tolerances, with patches cut and with patches fixed; and what the same
//! accuracy costs without patches, where rows of rays meet few elements of many: elements and rays varied together, with the worst cell and
//! the signed bias of every face. Errors at points, where what varies inside elements counts, are in `points`.
//! Read: time against m·n; error against n and against time. Not shown: links between levels.

use std::error::Error;

use radiosity::{Adaptive, CellPlace, Goal, GridValues, LinearRadiosity, Method, Shape, Store, Strategy, run_adaptive};
use radiosity_experiments::{Context, Experiment, Profile, Record, Row, SeriesOfRows, Tables, group_by};
use radiosity_gallery::ManufacturedRoom;
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::Subdivision;
use radiosity_plot::fit::PowerLaw;
use radiosity_plot::numbers;
use radiosity_plot::{Axis, Dash, Figure, Panel, Series};

use crate::common::{GRID, cornell, cornell_truth, counts, described, exponent, left_out, record_of, times_of, value};
use crate::common::{linear_picture, picture, picture_side};
use crate::points;
use crate::truth::{Truth, pairs_truth};

/// The experiment.
pub struct Substructuring;

/// A scene with the estimator it is measured by.
struct Case {
    name: &'static str,
    scene: Scene,
    method: Method,
}

fn cases(profile: Profile) -> Result<Vec<Case>, Box<dyn Error>> {
    let mut room = ManufacturedRoom::default().scene();
    room.materials[5].emission = vec![10.0];
    Ok(vec![
        Case {
            name: "Cornell box",
            scene: cornell()?,
            method: Method::Hemicube { resolution: profile.pick(16, 32, 64) },
        },
        Case { name: "empty room", scene: room, method: Method::sampled(1e-6, 1) },
    ])
}

/// (elements, patches) along an edge of a face: n varied at fixed m, then m at fixed n.
fn meshes(profile: Profile) -> [Vec<(u32, u32)>; 2] {
    let k: u32 = profile.pick(4, 8, 16);
    let patches = (0..4).map(|step| k >> step).filter(|&p| p >= 1).map(|p| (k, p)).collect();
    let fixed = profile.pick(1, 2, 2);
    let elements = profile.pick(vec![1, 2, 4], vec![2, 4, 8], vec![2, 4, 8, 16]);
    [patches, elements.into_iter().map(|e| (e, fixed)).collect()]
}

/// Tolerances of adaptive runs.
fn tolerances(profile: Profile) -> Vec<f64> {
    profile.pick(vec![0.04, 0.02], vec![0.04, 0.02, 0.01], vec![0.04, 0.02, 0.01, 0.005])
}

/// The same solution of the Cornell box with each element in one radiosity, and linear inside elements.
fn pictures(context: &mut Context, scene: &Scene) -> Result<(), Box<dyn Error>> {
    let profile = context.profile();
    let (patches, elements) = profile.pick((1, 4), (4, 16), (4, 32));
    let mut strategy = Strategy::new(Subdivision::Uniform(elements), Method::exact(1e-6, 1e-4));
    strategy.mesh.patches = Some(Subdivision::Uniform(patches));
    (strategy.shape, strategy.verify) = (Shape::ElementsToPatches, false);
    "gauss-seidel".clone_into(&mut strategy.solver);
    let run = radiosity::run(scene, &strategy, &mut ())?;
    let linear = LinearRadiosity::new(&run.geometry, &run.solution.irradiance);
    let size = picture_side(profile);
    let flat = picture(&run.geometry, &run.solution.radiosity, size)?;
    let shaded = linear_picture(&run.geometry, &linear, size)?;
    for (name, how, image) in [("flat", "one radiosity an element", flat), ("linear", "linear inside elements", shaded)]
    {
        let caption = format!("{elements} × {elements} elements a face, {how}");
        context.picture(name, &caption, image.width, image.height, &image.rgb)?;
    }
    context.tick("pictures");
    Ok(())
}

/// An adaptive run over the report grid, whose patches are cut or stay as they are.
fn adaptive(
    scene: &Scene,
    (truth, at_points): (&Truth, &Truth),
    (tolerance, cut): (f64, bool),
    profile: Profile,
) -> Result<Record, Box<dyn Error>> {
    let plain = Strategy::new(Subdivision::Uniform(1), Method::exact(1e-6, 1e-4));
    let strategy = Strategy { shape: Shape::ElementsToPatches, solver: "gauss-seidel".to_owned(), ..plain };
    let mut settings = Adaptive::new(Goal::Cells(GRID), tolerance);
    if !cut {
        settings.senders = f64::INFINITY;
    }
    let done = run_adaptive(scene, &strategy, &settings)?;
    let (run, rounds) = (&done.run, &done.rounds);
    let error = GridValues::means(&run.geometry, &run.solution.irradiance, GRID)?.error(&truth.grid);
    let sum = |count: &dyn Fn(&radiosity::Round) -> usize| rounds.iter().map(count).sum::<usize>();
    let estimate = rounds.last().ok_or("no round")?.estimate;
    let patches = if cut { "patches cut" } else { "patches fixed" };
    let record = counts(described(format!("Cornell box/adaptive/{tolerance}/{patches}"), &strategy), &run.cost())
        .text("scene", "Cornell box")
        .text("series", "adaptive")
        .text("refinement", patches)
        .float("tolerance", tolerance)
        .text("met", done.met)
        .int("rounds", rounds.len())
        .int("elements", run.geometry.elements().len())
        .int("patches", run.geometry.patches().len())
        .int("rows_new", sum(&|round| round.new_elements))
        .int("rows_recomputed", sum(&|round| round.rows_again))
        .int("stored_bytes", run.stored_bytes)
        .float("error", error.rms)
        .float("error_points", points::error(&run.geometry, &run.solution.irradiance, at_points, profile))
        .float("worst_cell", error.worst)
        .float("estimate", estimate.total())
        .float("estimated_senders", estimate.senders)
        .float("reference_error", truth.error);
    Ok(record.repetitions("time", &[run.seconds() + done.estimating.as_secs_f64()]))
}

fn strategies(elements: u32, patches: u32, method: Method) -> Vec<Strategy> {
    let forms = [
        (Shape::Full, "gauss-seidel"),
        (Shape::ElementsToPatches, "gauss-seidel"),
        (Shape::PatchesToElements, "shooting"),
        (Shape::TwoLevel, "direct"),
    ];
    let mut all = Vec::new();
    for (shape, solver) in forms {
        // The full form has no patches of its own: it stands at n = m alone.
        if shape == Shape::Full && patches != elements {
            continue;
        }
        let mut strategy = Strategy::new(Subdivision::Uniform(elements), method);
        strategy.mesh.patches = (shape != Shape::Full).then_some(Subdivision::Uniform(patches));
        all.push(Strategy { shape, solver: solver.to_owned(), unshot: 1e-4, store: Store::Dense, ..strategy });
    }
    all
}

/// (elements along an edge of the box, rays a row).
fn rays(profile: Profile) -> Vec<(u32, u32)> {
    match profile {
        Profile::Tiny => vec![(8, 64), (16, 64)],
        Profile::Quick => vec![(8, 256), (16, 128), (16, 256), (16, 384), (24, 256)],
        Profile::Full => {
            let coarse = [(8, 256), (8, 512), (16, 128), (16, 192), (16, 256), (16, 384), (16, 512)];
            coarse.into_iter().chain([(24, 192), (24, 256), (24, 512), (32, 256), (32, 768)]).collect()
        }
    }
}

/// An edge of the box, in its millimetres.
const EDGE: f64 = 560.0;

/// Rows of rays with exact totals towards what shines, of which what is not zero is kept. Elements are equally large on all faces, nest in the
/// cells of the report and are halved at contacts.
fn ray_strategy(elements: u32, rays: u32) -> Strategy {
    let along = Subdivision::EdgeLength(EDGE / f64::from(elements));
    let mut strategy = Strategy::new(along, Method::RaysAndEmitters { rays });
    strategy.mesh.patches = Some(Subdivision::Uniform(GRID));
    Strategy {
        contact_level: 1,
        store: Store::Sparse,
        solver: "gmres".to_owned(),
        unshot: UNSHOT,
        verify: false,
        ..strategy
    }
}

/// Unshot fraction at which rows of rays are good enough: a tenth of the error that they leave.
const UNSHOT: f64 = 1e-3;

impl Substructuring {
    /// Elements and rays varied, with the errors of cells and faces.
    fn rays(context: &mut Context, scene: &Scene, truth: &Truth) -> Result<(), Box<dyn Error>> {
        for (elements, rays) in rays(context.profile()) {
            let strategy = ray_strategy(elements, rays);
            let run = radiosity::run(scene, &strategy, &mut ())?;
            let error = GridValues::means(&run.geometry, &run.solution.irradiance, GRID)?.error(&truth.grid);
            let key = format!("Cornell box/{RAYS}/{elements}/{rays}");
            let mut line = record_of(key.clone(), &strategy, &run, &error)
                .text("scene", "Cornell box")
                .text("series", RAYS)
                .int("along_an_edge", elements)
                .float("reference_error", truth.error);
            if let Some(CellPlace { surface, i, j }) = error.worst_cell {
                line = line.text("worst_at", format!("{} {i} {j}", scene.surfaces[surface as usize].name));
            }
            for face in &error.biases {
                line = line.float(format!("bias_{}", scene.surfaces[face.surface as usize].name), face.bias);
            }
            context.record(times_of(line, scene, &strategy, &run)?);
            context.tick(key);
        }
        Ok(())
    }
}

/// Error of a path tracer on the Cornell box after one second, in the same measure, as stated of Mitsuba 3 and not measured here: it falls with the root
/// of time.
const PATH_TRACER: f64 = 0.038;

/// Seconds in which the path tracer comes to an error.
fn path_tracer(error: f64) -> f64 {
    (PATH_TRACER / error).powi(2)
}

/// Name of the series in which elements and rays vary.
const RAYS: &str = "rays varied";

impl Experiment for Substructuring {
    fn name(&self) -> &'static str {
        "02-substructuring"
    }

    fn question(&self) -> &str {
        "What do m elements under n patches save against m patches, and what do they cost in accuracy?"
    }

    fn expects(&self) -> &str {
        "m·n form factors instead of m², so time and memory linear in m at fixed n and in n at fixed m. Shooting starts \
         the estimator n times, gathering and the two-level form m times. The error falls with n until the elements' own \
         error is reached."
    }

    fn settings(&self, profile: Profile) -> serde_json::Value {
        serde_json::json!({ "meshes": format!("{:?}", meshes(profile)), "unshot": 1e-4, "tolerances": tolerances(profile), "seed": 1 })
    }

    fn slack(&self, column: &str) -> f64 {
        // Differences of nearly equal answers: their last digits depend on the processor.
        if column.starts_with("estimate") { 1e-12 } else { 0.0 }
    }

    fn run(&self, context: &mut Context) -> Result<(), Box<dyn Error>> {
        let profile = context.profile();
        let [varied_n, varied_m] = meshes(profile);
        let cases = cases(profile)?;
        let tolerances = tolerances(profile);
        let at_points = points::cases(profile);
        let others = rays(profile).len() + 2 * tolerances.len() + at_points.len() + 1;
        context.begin(cases.len() * 4 * (varied_n.len() + varied_m.len()) + others);
        for case in &cases {
            let truth = if case.name == "Cornell box" {
                cornell_truth(context, &case.scene)?
            } else {
                pairs_truth(&case.scene, Subdivision::Uniform(profile.pick(8, 16, 32)), GRID)?
            };
            if case.name == "Cornell box" {
                Self::rays(context, &case.scene, &truth)?;
            }
            let reference_error = truth.error;
            for (series, meshes) in [("n varied", &varied_n), ("m varied", &varied_m)] {
                for &(elements, patches) in meshes {
                    for strategy in strategies(elements, patches, case.method) {
                        if series == "m varied" && strategy.shape == Shape::Full {
                            continue;
                        }
                        let run = radiosity::run(&case.scene, &strategy, &mut ())?;
                        let error =
                            GridValues::means(&run.geometry, &run.solution.irradiance, GRID)?.error(&truth.grid);
                        let key = format!("{}/{series}/{elements}/{patches}/{}", case.name, strategy.shape.name());
                        let line = record_of(key.clone(), &strategy, &run, &error)
                            .text("scene", case.name)
                            .text("series", series)
                            .float("reference_error", reference_error);
                        left_out(context, case.name, &strategy, &run.geometry, Some(&run));
                        context.record(times_of(line, &case.scene, &strategy, &run)?);
                        context.tick(key);
                    }
                }
            }
            if case.name == "Cornell box" {
                let pointwise = points::truth(&case.scene, profile)?;
                for (&tolerance, cut) in tolerances.iter().flat_map(|t| [(t, true), (t, false)]) {
                    context.record(adaptive(&case.scene, (&truth, &pointwise), (tolerance, cut), profile)?);
                    context.tick(format!("adaptive {tolerance}"));
                }
                points::bounds(&pointwise, profile).into_iter().for_each(|bound| context.record(bound));
                for points in &at_points {
                    context.record(points.record(&case.scene, (&pointwise, &truth), profile)?);
                    context.tick(points.key());
                }
                pictures(context, &case.scene)?;
            }
        }
        Ok(())
    }

    fn plots(&self, tables: &Tables) -> Vec<Figure> {
        let panel = |scene: &str, series: &str, x: (&str, &str), y: (&'static str, &str, &str), fitted: bool| {
            let rows = tables.select(|r| r.text("series") == series && r.text("scene") == scene);
            let lines = group_by(rows, "form").into_iter().map(|(form, rows)| {
                let line = Series::new(&*form, &*form).rows(rows, |r| (value(r, x.0), value(r, y.0)));
                if fitted { line.fit() } else { line }
            });
            let unit = if x.0 == "time" { "s" } else { "" };
            let lines: Vec<_> = lines.collect();
            Panel::new(Axis::log(x.1, unit), Axis::log(y.1, y.2)).title(scene).all_series(lines)
        };
        let of_rays = |column: &'static str, label: &str| {
            let lines = group_by(tables.select_eq("series", RAYS), "along_an_edge").into_iter().map(|(k, rows)| {
                Series::new(format!("{k} elements along an edge"), format!("{k} elements"))
                    .rows(rows, |r| (r.seconds("time"), r.number(column)))
            });
            let mut lines: Vec<_> = lines.collect();
            if column == "error" {
                let line = Series::new("path tracer (stated)", "path tracer");
                lines.push(line.values([0.02, 0.002].map(|error| (path_tracer(error), error))).dash(Dash::Dashed));
            }
            Panel::new(Axis::log("time", "s"), Axis::log(label, "share of the mean")).all_series(lines)
        };
        let refined = |x: &str, title: &str| {
            let rows = tables.select_eq("series", "adaptive");
            let line = |(name, rows): (String, Vec<Row<'_>>)| {
                Series::new(&*name, &*name).rows(rows, |r| (value(r, x), r.number("error")))
            };
            let lines: Vec<_> =
                group_by(rows, "refinement").into_iter().map(|(name, rows)| line((name.to_string(), rows))).collect();
            let unit = if x == "time" { "s" } else { "" };
            Panel::new(Axis::log(title, unit), Axis::log("error", "share of the mean"))
                .title("Cornell box")
                .all_series(lines)
        };
        let n = ("patches", "patches n, m fixed");
        let m = ("elements", "elements m, n fixed");
        let (room, cornell) = ("empty room", "Cornell box");
        let error = ("error", "error", "share of the mean");
        let figures = vec![
            Figure::new("cost", "Form factors and time, by analytic pairs")
                .caption("Form factors are exact counts; slopes are fitted. Full stands at n = m. Gathering and two-level count alike and cover each other.")
                .panel(panel(room, "n varied", n, ("form_factors", "form factors", ""), true))
                .panel(panel(room, "m varied", m, ("form_factors", "form factors", ""), true))
                .panel(panel(room, "m varied", m, ("time", "time", "s"), true)),
            Figure::new("evaluations", "Source evaluations, time and memory, by hemicube")
                .caption("A source evaluation is one hemicube: shooting needs one a patch, gathering one an element.")
                .panel(panel(cornell, "n varied", n, ("source_evaluations", "source evaluations", ""), false))
                .panel(panel(cornell, "n varied", n, ("time", "time", "s"), false))
                .panel(panel(cornell, "n varied", n, ("stored_bytes", "memory of form factors", "bytes"), false)),
            Figure::new("error", "Error against patches")
                .caption("rms of irradiance over 8 × 8 cells a face, m fixed and n varied. Gathering and two-level solve one system and cover each other.")
                .panel(panel(cornell, "n varied", n, error, false))
                .panel(panel(room, "n varied", n, error, false)),
            Figure::new("error-time", "Error against time")
                .caption("One mark a number of patches, m fixed.")
                .panel(panel(cornell, "n varied", ("time", "time"), error, false))
                .panel(panel(room, "n varied", ("time", "time"), error, false)),
            Figure::new("rays", "Rows of rays: error against time")
                .caption("Cornell box, rays with exact emitters, sparse rows; a line an element size, a mark a number of rays. Mesh, form factors and solution. The line of a path tracer, 3.8 %/√s, is stated of Mitsuba 3 and was not measured here.")
                .panel(of_rays("error", "rms error"))
                .panel(of_rays("worst_cell", "worst cell")),
            Figure::new("adaptive", "Refined where the error is")
                .caption("One mark a tolerance, over 8 × 8 cells a face; pairs are exact. Fixed patches stay where they began: their error does not fall.")
                .panel(refined("patches", "patches n"))
                .panel(refined("form_factors", "form factors"))
                .panel(refined("time", "time")),
        ];
        figures.into_iter().chain(points::figures(tables)).collect()
    }

    fn reading(&self, tables: &Tables) -> Vec<String> {
        let slope = |series: &str, x: &str, y: &str| {
            let rows = tables.select(|r| {
                r.text("scene") == "empty room" && r.text("series") == series && r.text("form") == "elements-to-patches"
            });
            exponent(PowerLaw::through(rows.iter().map(|r| (r.number(x), value(r, y)))))
        };
        let rows = |form: &str| {
            tables.select(|r| {
                r.text("scene") == "Cornell box" && r.text("series") == "n varied" && r.text("form") == form
            })
        };
        let mut reading = vec![format!(
            "In the empty room, gathering from patches, form factors grow like m^{} at fixed n and like n^{} at fixed m, and time \
             like m^{}.",
            slope("m varied", "elements", "form_factors"),
            slope("n varied", "patches", "form_factors"),
            slope("m varied", "elements", "time"),
        )];
        // The first run below each error.
        let of_rays = tables.select_eq("series", RAYS);
        for wanted in [0.01, 0.005, 0.003] {
            let good = of_rays.iter().filter(|r| r.number("error") <= wanted);
            let cheapest = good.min_by(|a, b| a.seconds("time").total_cmp(&b.seconds("time")));
            reading.extend(cheapest.map(|r| {
                format!(
                    "On the Cornell box rows of rays with exact emitters reach {} with {} elements, {} along an edge of the box, and {} rays a row in \
                     {}, the worst cell ({}) off by {}; a path tracer of 3.8 %/√s, as stated of Mitsuba 3 on this scene and not measured here, \
                     would take {} to {}, {:.0} times as long.",
                    numbers::percent(r.number("error")),
                    r.number("elements"),
                    r.number("along_an_edge"),
                    r.text("setting"),
                    numbers::seconds(r.seconds("time")),
                    r.text("worst_at"),
                    numbers::percent(r.number("worst_cell")),
                    numbers::seconds(path_tracer(wanted)),
                    numbers::percent(wanted),
                    path_tracer(wanted) / r.seconds("time"),
                )
            }));
        }
        let refined = tables.select(|r| r.text("series") == "adaptive" && r.text("refinement") == "patches cut");
        if let Some(last) = refined.last() {
            reading.push(format!(
                "Refined where the error is to a tolerance of {}, {} elements under {} patches have an error of {}; {} rows were computed for \
                 them, and {} were added to when patches were cut.",
                numbers::percent(last.number("tolerance")),
                last.number("elements"),
                last.number("patches"),
                numbers::percent(last.number("error")),
                last.number("rows_new"),
                last.number("rows_recomputed"),
            ));
        }
        reading.extend(points::reading(tables));
        let shoot = rows("patches-to-elements");
        if let (Some(full), Some(some)) = (rows("full").first(), shoot.get(1)) {
            reading.push(format!(
                "On the Cornell box, {} patches shooting to {} elements take {} hemicubes and {} instead of {} and {} for every \
                 element, at an error of {} instead of {}.",
                some.number("patches"),
                some.number("elements"),
                some.number("source_evaluations"),
                numbers::seconds(some.seconds("time")),
                full.number("source_evaluations"),
                numbers::seconds(full.seconds("time")),
                numbers::percent(some.number("error")),
                numbers::percent(full.number("error"))
            ));
        }
        reading
    }
}
