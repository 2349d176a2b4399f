//! What is left out of a scene that does not need it, and what that saves.
//!
//! Question: what does each exact omission save, alone and with all others, does it save what was predicted, and does the answer stay? Theory: what no light reaches, what
//! only blocks and what sends nothing are rows and columns of a system that change nothing in the others, so both systems have one solution and differ by rounding alone; work
//! saved follows from counts of elements, so it is known before. A plan looks at faces and not at elements, so that it should be lost in the time of a run. Measured on scenes from an empty
//! grey room to a tower of furnished rooms: everything kept, every omission that the scene allows alone, and all of them; counts are exact, times come from interleaved repeats and are those
//! of whole runs, plan and mesh included. The difference is the largest of irradiance over what is asked for, relative to the largest irradiance of its band; more than 1e-12, or a saving that is not
//! the one predicted, counts as failed. What estimators leave out by themselves is counted where everything is kept: polygons that can block nothing, pairs that face
//! away, and pairs with nothing between them. What scenes without mirrors save of light by way of them (extended form factors; directions and a second pass are never there) is measured by
//! mirrors on every surface that reflect nothing: the same light, with form factors that nobody knows to be 0. With true mirrors all of that is needed. The empty grey room is solved a second time as the program does it, and as a library call on a scene of one band with store and solver picked by hand, of
//! which the fastest counts; a call by hand computes all rows, and so does the program once more, since a room is a box and its rows mirror each other. Beside that, what an error allows:
//! pairs and bounces of a furnished room within some errors, with what they change beside the bound that was reported, and what
//! refinement for a view of one of two rooms computes. Read: bars below 1 are work that was not needed. Not shown: instructions of a plan, which a profiler counts.

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use glam::DVec3;
use radiosity::plan::{Omission, Omissions};
use radiosity::{Adaptive, Goal, GridValues, run_adaptive};
use radiosity::{Geometry, Method, Phase, Plan, Run, RunError, Store, Strategy, run_enhanced, run_meshed, run_planned};
use radiosity::{SpecularBy, SpecularTransport};
use radiosity_core::{Cost, Outcome};
use radiosity_experiments::{Context, Experiment, Profile, Record, Row, Tables, group_by};
use radiosity_form_factors::extended::SpecularBounces;
use radiosity_gallery::boxes::{faces, material, scene_of_loops, unit_cube};
use radiosity_gallery::rooms::{STOREY, black_floor, grey_room, one_room, tower, two_rooms};
use radiosity_gallery::{city, crowded_room};
use radiosity_geometry::mesh::Subdivision;
use radiosity_geometry::{Scene, Specular};
use radiosity_plot::{Axis, Figure, Panel, Point, Quality, Series, numbers};
use radiosity_render::Camera;

use crate::common::{cornell, counts, left_out};

/// The experiment.
pub struct LeftOut;

/// Unshot share at which solvers stop: what is left is less than the difference allowed.
const UNSHOT: f64 = 1e-14;
/// Largest difference of irradiance that rounding may make, relative.
const EXACT: f64 = 1e-12;
/// Names of the runs that leave out nothing and all they can.
const NOTHING: &str = "nothing";
const EVERYTHING: &str = "all";
/// Light by way of specular surfaces, where there are none.
const NOT_SPECULAR: &str = "specular light";
/// Rays of a row of form factors by way of specular surfaces.
const SPECULAR_RAYS: u32 = 64;
/// Diffuse scenes that are solved with and without light by way of specular surfaces.
const DIFFUSE: [&str; 3] = ["grey room", "Cornell box", "furnished"];
/// The lit one of two rooms, with no other beside it.
const ALONE: &str = "lit room alone";
/// The program, beside picks by hand, and the program without copies of mirror images.
const PROGRAM: &str = "program";
const ALL_ROWS: &str = "program, all rows";
/// Name of the scene that is solved by hand.
const BY_HAND: &str = "by hand";

/// What an error allows to be left out, and what refinement of everything is called beside that of a view.
const WITHIN: &str = "within an error";
const EVERY_POINT: &str = "every point";
const OF_THE_VIEW: &str = "a view";
/// Errors that dropped pairs may cause, that bounces may, and that a view is refined to.
const PAIRS: [f64; 3] = [0.1, 0.05, 0.02];
const BOUNCES: f64 = 0.01;
const VIEW: f64 = 0.05;

/// A scene, and how it is solved.
struct Case {
    name: &'static str,
    scene: Scene,
    method: Method,
    asked: Option<Vec<u32>>,
}

/// All surfaces but the sheets of a tower.
fn without_sheets(scene: &Scene) -> Vec<u32> {
    (0..scene.surfaces.len() as u32).filter(|s| *s as usize % STOREY != STOREY - 1).collect()
}

/// A tube with square ends, one of which emits.
fn tube() -> Scene {
    let loops =
        (0..).zip(faces(DVec3::ZERO, DVec3::new(4.0, 1.0, 1.0), true)).map(|(k, face)| (face, usize::from(k == 0)));
    scene_of_loops(&loops.collect::<Vec<_>>(), vec![material("grey", 0.5, 0.0), material("lamp", 0.3, 1.0)])
}

fn cases() -> Result<Vec<Case>, Box<dyn Error>> {
    let case = |name, scene| Case { name, scene, method: Method::ANALYTIC, asked: None };
    let storeys = tower(&[true, false, true, false]);
    let (asked, storeys_by_rays) = (Some(without_sheets(&storeys)), storeys.clone());
    let sampled = Method::sampled(1e-10, 16);
    Ok(vec![
        case("grey room", grey_room([3.0; 3])),
        case("one dark band", grey_room([3.0, 0.0, 0.7])),
        case("coloured room", one_room()),
        case("cube", unit_cube(material("grey", 0.5, 1.0))),
        case("tube", tube()),
        case("black floor", black_floor()),
        Case { asked: Some(vec![0, 1, 2, 3, 5]), ..case("walls asked", black_floor()) },
        case("two rooms, one lit", two_rooms([true, false])),
        case("two rooms, lit", two_rooms([true, true])),
        Case { method: sampled, ..case("Cornell box", cornell()?) },
        Case { method: sampled, ..case("furnished", crowded_room(9, 1)) },
        Case { method: sampled, ..case("city", city(1, 2, 1)) },
        Case { method: sampled, ..case("tower", storeys.clone()) },
        Case { method: Method::rays(64), ..case("tower, rays", storeys_by_rays) },
        Case { method: sampled, asked, ..case("tower, asked", storeys) },
    ])
}

/// Elements of a scene, by longest edge: about so many whatever its faces.
fn mesh(scene: &Scene, profile: Profile) -> Subdivision {
    let most = profile.pick(150.0, 700.0, 2_000.0);
    Subdivision::EdgeLength((scene.area() / most).sqrt())
}

/// Elements along an edge of the grey room that is solved by hand.
fn sizes(profile: Profile) -> &'static [u32] {
    profile.pick(&[4], &[13, 20], &[13, 20, 29, 41])
}

/// Stores and solvers that a hand might pick for a symmetric matrix of one band.
const PICKS: [(Store, &str); 5] = [
    (Store::Packed, "cg"),
    (Store::Packed, "jacobi"),
    (Store::Packed, "chebyshev"),
    (Store::Dense, "cg"),
    (Store::Dense, "gauss-seidel"),
];

/// A run of the plan from the scene on, in the store that it chooses, as the program makes it; and its seconds.
fn planned<'a>(scene: &'a Scene, strategy: &Strategy) -> Result<(Run<'a>, Strategy, f64), RunError> {
    let clock = Instant::now();
    let plan = Plan::new(scene, strategy);
    let geometry = plan.mesh(scene, strategy)?;
    let strategy = Strategy { store: plan.store(&geometry, strategy).store, ..strategy.clone() };
    let run = run_planned(&plan, geometry, Phase::default(), &strategy, &mut ())?;
    let seconds = clock.elapsed().as_secs_f64();
    Ok((run, strategy, seconds))
}

/// A library call with nothing looked at beforehand, and its seconds.
fn by_hand<'a>(scene: &'a Scene, strategy: &Strategy) -> Result<(Run<'a>, f64), RunError> {
    let clock = Instant::now();
    let geometry = Geometry::of_strategy(scene, strategy)?;
    let run = run_meshed(geometry, Phase::default(), strategy, &mut ())?;
    Ok((run, clock.elapsed().as_secs_f64()))
}

/// Irradiance in all bands of the mesh's elements on surfaces asked for, in the order of the mesh.
fn irradiance(run: &Run<'_>, asked: Option<&[u32]>) -> Vec<Vec<f64>> {
    let all = run.geometry.spread(&run.solution.irradiance);
    let elements = &run.geometry.mesh().elements;
    let is_asked = |e: &usize| asked.is_none_or(|asked| asked.binary_search(&elements[*e].surface).is_ok());
    let places: Vec<usize> = (0..elements.len()).filter(is_asked).collect();
    (0..all.count()).map(|b| places.iter().map(|&e| all.band(b)[e]).collect()).collect()
}

/// Largest difference of a band relative to its largest value, the worst band; infinite if they do not fit.
fn difference(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
    let of_band = |(a, b): (&Vec<f64>, &Vec<f64>)| {
        let largest = a.iter().copied().fold(0.0, f64::max);
        let apart = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        if a.len() != b.len() || apart.is_nan() {
            f64::INFINITY
        } else if apart == 0.0 {
            0.0
        } else {
            apart / largest
        }
    };
    a.iter().zip(b).map(of_band).fold(0.0, f64::max)
}

/// The runs of a scene: what they leave out, by name.
fn variants(case: &Case, plain: &Strategy) -> Result<Vec<(&'static str, Omissions)>, RunError> {
    let mut variants = vec![(NOTHING, Omissions::NONE)];
    for one in Omission::ALL {
        let alone = Strategy { omit: one.into(), ..plain.clone() };
        let plan = Plan::new(&case.scene, &alone);
        let geometry = plan.mesh(&case.scene, &alone)?;
        if !plan.left_out(&geometry, &alone).list.is_empty() {
            variants.push((one.name(), one.into()));
        }
    }
    variants.push((EVERYTHING, Omissions::ALL));
    Ok(variants)
}

/// Columns of what a run left out: predicted and measured, and whether they are the same.
fn savings(mut record: Record, run: &Run<'_>) -> (Record, bool) {
    let (predicted, measured) = (run.left_out.predicted, run.left_out.measured);
    let known = |count: Option<u64>| count.map_or_else(String::new, |count| count.to_string());
    let columns = [
        ("unknowns", Some(predicted.unknowns), measured.map(|m| m.unknowns)),
        ("form_factors", predicted.form_factors, measured.and_then(|m| m.form_factors)),
        ("rows", predicted.rows, measured.and_then(|m| m.rows)),
        ("rays", predicted.rays, measured.and_then(|m| m.rays)),
        ("bands", Some(predicted.bands), measured.map(|m| m.bands)),
    ];
    let mut as_predicted = true;
    for (name, predicted, measured) in columns {
        as_predicted &= measured.is_none() || predicted == measured;
        record =
            record.text(format!("predicted_{name}"), known(predicted)).text(format!("saved_{name}"), known(measured));
    }
    (record, as_predicted)
}

fn outcome(run: &Run<'_>, sound: bool) -> String {
    if sound { run.solution.outcome.to_string() } else { "failed".to_owned() }
}

/// Everything kept, each omission alone, and all of them.
fn omissions(context: &mut Context, case: &Case) -> Result<(), Box<dyn Error>> {
    let profile = context.profile();
    let elements = mesh(&case.scene, profile);
    let asked = case.asked.clone();
    let plain = Strategy { unshot: UNSHOT, asked, ..Strategy::new(elements, case.method) };
    let variants = variants(case, &plain)?;
    let of = |omit: Omissions| Strategy { omit, ..plain.clone() };
    let mut seconds = vec![Vec::new(); variants.len()];
    let mut runs = Vec::new();
    for repetition in 0..profile.pick(1, 3, 5) {
        for ((_, omit), seconds) in variants.iter().zip(&mut seconds) {
            let (run, strategy, time) = planned(&case.scene, &of(*omit))?;
            seconds.push(time);
            if repetition == 0 {
                runs.push((run, strategy));
            }
        }
    }
    let answer = irradiance(&runs[0].0, case.asked.as_deref());
    for (((name, omit), (run, strategy)), seconds) in variants.iter().zip(&runs).zip(&seconds) {
        let apart = difference(&answer, &irradiance(run, case.asked.as_deref()));
        let cost = run.cost();
        let mut plan_seconds = Vec::new();
        for _ in 0..seconds.len() {
            let clock = Instant::now();
            let plan = Plan::new(&case.scene, &of(*omit));
            // With the symmetries of the mesh, and what all is predicted to save.
            black_box(plan.left_out(&run.geometry, strategy));
            plan_seconds.push(clock.elapsed().as_secs_f64());
            assert_eq!(plan.off.is_some(), *name == NOTHING, "a strategy that can be planned");
        }
        let record = counts(Record::new(format!("{}/{name}", case.name)), &cost)
            .text("scene", case.name)
            .text("left_out", name)
            .text("method", case.method.name())
            .text("store", strategy.store.name())
            .int("elements", run.geometry.elements().len())
            .int("steps", run.solution.steps)
            .int("stored_bytes", run.stored_bytes)
            .int("flops", cost.flops);
        let (record, as_predicted) = savings(record, run);
        let sound = apart <= EXACT && as_predicted;
        if *name == EVERYTHING {
            left_out(context, case.name, strategy, &run.geometry, Some(run));
        }
        let mut record = record.float("difference", apart).text("outcome", outcome(run, sound));
        if *name == NOTHING {
            record = by_themselves(record, case, run);
        }
        context.record(record.repetitions("time", seconds).repetitions("plan_time", &plan_seconds));
    }
    context.tick(case.name);
    Ok(())
}

/// What geometry and estimators leave out without a plan.
fn by_themselves(record: Record, case: &Case, run: &Run<'_>) -> Record {
    let (m, cost) = (run.geometry.elements().len(), run.form_factors.cost);
    let record = record
        .int("polygons", case.scene.pieces().count())
        .int("blocking_polygons", run.geometry.blockers().len())
        .int("covered_elements", run.geometry.mesh().elements.len() - m);
    match case.method {
        Method::Analytic { .. } => record
            .int("pairs", m * (m - 1) / 2)
            .int("pairs_facing", cost.form_factors)
            .int("clear_pairs", cost.clear_pairs)
            .int("hidden_pairs", cost.hidden_pairs)
            .int("partial_pairs", cost.partial_pairs),
        _ => record,
    }
}

/// The lit one of two rooms alone, solved in the same way: what the two may cost.
fn lit_room_alone(context: &mut Context) -> Result<(), Box<dyn Error>> {
    let (two, one) = (two_rooms([true, false]), one_room());
    let elements = mesh(&two, context.profile());
    let strategy = Strategy { unshot: UNSHOT, omit: Omissions::ALL, ..Strategy::new(elements, Method::ANALYTIC) };
    let (both, chosen, _) = planned(&two, &strategy)?;
    let (alone, _, first) = planned(&one, &strategy)?;
    // Both in turn, since what else the machine does comes and goes.
    let (mut seconds, mut with_dark) = (vec![first], Vec::new());
    for repetition in 0..context.profile().pick(1, 7, 9) {
        with_dark.push(planned(&two, &strategy)?.2);
        if repetition > 0 {
            seconds.push(planned(&one, &strategy)?.2);
        }
    }
    // Of two rooms wall to wall the walls between may block, by what a face alone tells; none does.
    let counted = |run: &Run<'_>| {
        let cost = run.cost();
        (cost.form_factors, cost.source_evaluations, cost.rays, cost.entries, cost.flops, run.stored_bytes)
    };
    let sound = counted(&both) == counted(&alone);
    let room = [0, 1, 2, 3, 4, 5];
    let apart = difference(&irradiance(&alone, Some(&room)), &irradiance(&both, Some(&room)));
    let record = counts(Record::new(format!("two rooms, one lit/{ALONE}")), &alone.cost())
        .text("scene", "two rooms, one lit")
        .text("left_out", ALONE)
        .text("method", chosen.method.name())
        .text("store", chosen.store.name())
        .int("elements", alone.geometry.elements().len())
        .int("steps", alone.solution.steps)
        .int("stored_bytes", alone.stored_bytes)
        .int("flops", alone.cost().flops)
        .float("difference", apart)
        .text("outcome", outcome(&alone, sound && apart <= EXACT));
    context.record(record.repetitions("time", &seconds).repetitions("with_dark_time", &with_dark));
    context.tick(ALONE);
    Ok(())
}

/// Pairs and bounces left out of a furnished room, and what refinement for a view computes.
fn within_an_error(context: &mut Context) -> Result<(), Box<dyn Error>> {
    let scene = crowded_room(9, 1);
    let elements = mesh(&scene, context.profile());
    let store = Store::Packed;
    let plain = Strategy { store, omit: Omissions::ALL, ..Strategy::new(elements, Method::sampled(1e-10, 16)) };
    let cells = |run: &Run<'_>| GridValues::means(&run.geometry, &run.solution.irradiance, 4);
    let whole = radiosity::run(&scene, &plain, &mut ())?;
    let ways = PAIRS.map(|error| ("pairs", error, Strategy { thin: Some(error), ..plain.clone() }));
    let bounces = ("bounces", BOUNCES, Strategy { bounces: Some(BOUNCES), ..plain.clone() });
    for (name, error, strategy) in [(NOTHING, 0.0, plain.clone())].into_iter().chain(ways).chain([bounces]) {
        let clock = Instant::now();
        let run = radiosity::run(&scene, &strategy, &mut ())?;
        let seconds = clock.elapsed().as_secs_f64();
        let (change, bound) = (cells(&run)?.error(&cells(&whole)?).rms, run.bounded_error().unwrap_or(f64::INFINITY));
        let record = counts(Record::new(format!("{WITHIN}/{name}, {error}")), &run.cost())
            .text("scene", WITHIN)
            .text("left_out", name)
            .int("elements", run.geometry.elements().len())
            .int("steps", run.solution.steps)
            .float("asked", error)
            .float("bound", bound)
            .float("change", change)
            .text("outcome", outcome(&run, change <= bound && bound <= error));
        context.record(record.seconds("time", seconds));
    }
    let scene = two_rooms([true, true]);
    let camera = Camera::new(DVec3::new(0.4, 0.5, 1.6), DVec3::new(2.0, 3.5, 0.0), DVec3::Z, 50.0, 60, 40)?;
    let every = Strategy {
        solver: "gauss-seidel".to_owned(),
        omit: Omissions::ALL,
        ..Strategy::new(Subdivision::Uniform(1), Method::exact(1e-9, 1e-7))
    };
    let view = Strategy { view: Some(camera), ..every.clone() };
    for (name, strategy) in [(EVERY_POINT, every), (OF_THE_VIEW, view)] {
        let clock = Instant::now();
        let done = run_adaptive(&scene, &strategy, &Adaptive::new(Goal::Points, VIEW))?;
        let seconds = clock.elapsed().as_secs_f64();
        let record = counts(Record::new(format!("{WITHIN}/{name}, {VIEW}")), &done.run.cost())
            .text("scene", WITHIN)
            .text("left_out", name)
            .int("elements", done.run.geometry.elements().len())
            .float("asked", VIEW)
            .text("outcome", outcome(&done.run, done.met));
        context.record(record.seconds("time", seconds));
    }
    context.tick(WITHIN);
    Ok(())
}

/// The scene with a mirror that reflects nothing on every surface: light by way of it is 0, which nobody is told.
fn with_black_mirrors(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    for material in &mut scene.materials {
        material.specular = Some(Specular::Mirror { reflectance: vec![0.0; material.emission.len()] });
    }
    scene
}

/// A diffuse scene solved with light by way of specular surfaces: with mirrors that reflect nothing, whose form factors are computed, and without any, where they are left out.
fn specular_light(context: &mut Context, case: &Case) -> Result<(), Box<dyn Error>> {
    let (kept, profile) = (with_black_mirrors(&case.scene), context.profile());
    let elements = mesh(&case.scene, profile);
    let plain = Strategy { unshot: UNSHOT, verify: false, ..Strategy::new(elements, case.method) };
    let strategy = Strategy { solver: "gauss-seidel".to_owned(), ..plain };
    let transport = SpecularTransport { bounces: SpecularBounces::Any, by: SpecularBy::Rays(SPECULAR_RAYS) };
    let ways = [(NOTHING, &kept), (NOT_SPECULAR, &case.scene)];
    let (mut seconds, mut runs) = ([Vec::new(), Vec::new()], Vec::new());
    for repetition in 0..profile.pick(1, 3, 5) {
        for ((_, scene), seconds) in ways.iter().zip(&mut seconds) {
            let clock = Instant::now();
            let run = run_enhanced(scene, &strategy, transport, &mut ())?;
            seconds.push(clock.elapsed().as_secs_f64());
            if repetition == 0 {
                runs.push(run.run);
            }
        }
    }
    let answer = irradiance(&runs[0], None);
    let rows = runs[1].form_factors.cost.source_evaluations;
    let left = transport.left_out(&case.scene, rows, Some(0));
    let predicted = left.and_then(|left| left.predicted);
    let saved = runs[0].cost().rays - runs[1].cost().rays;
    let name = format!("{}, mirrors", case.name);
    for (((left_out, _), run), seconds) in ways.iter().zip(&runs).zip(&seconds) {
        let apart = difference(&answer, &irradiance(run, None));
        let mut record = counts(Record::new(format!("{name}/{left_out}")), &run.cost())
            .text("scene", &name)
            .text("left_out", left_out)
            .text("method", case.method.name())
            .text("store", strategy.store.name())
            .int("elements", run.geometry.elements().len())
            .int("steps", run.solution.steps)
            .int("stored_bytes", run.stored_bytes)
            .int("flops", run.cost().flops)
            .float("difference", apart);
        let mut sound = apart <= EXACT;
        if *left_out == NOT_SPECULAR {
            sound &= predicted == Some(saved);
            let known = |count: Option<u64>| count.map_or_else(String::new, |count| count.to_string());
            record = record.text("predicted_rays", known(predicted)).text("saved_rays", known(Some(saved)));
        }
        context.record(record.text("outcome", outcome(run, sound)).repetitions("time", seconds));
    }
    context.tick(name);
    Ok(())
}

/// What is recorded of one way to solve the grey room.
struct Solved {
    label: String,
    strategy: Strategy,
    cost: Cost,
    steps: u64,
    elements: usize,
    outcome: Outcome,
    /// Irradiance in the first band.
    answer: Vec<f64>,
    seconds: Vec<f64>,
}

impl Solved {
    fn new(label: String, strategy: Strategy, run: &Run<'_>) -> Self {
        let solution = &run.solution;
        Self {
            label,
            strategy,
            cost: run.cost(),
            steps: solution.steps,
            elements: run.geometry.elements().len(),
            outcome: solution.outcome,
            answer: solution.irradiance.band(0).to_vec(),
            seconds: Vec::new(),
        }
    }
}

/// The grey room as the program solves it, and by hand.
fn grey_room_by_hand(context: &mut Context, k: u32) -> Result<(), Box<dyn Error>> {
    let grey = grey_room([3.0; 3]);
    let materials = vec![material("grey", 0.5, 0.0), material("lamp", 0.3, 3.0)];
    let one_band = Scene { surfaces: grey.surfaces.clone(), materials };
    let plain = Strategy { unshot: UNSHOT, ..Strategy::new(Subdivision::Uniform(k), Method::ANALYTIC) };
    let picks = PICKS.map(|(store, solver)| Strategy { store, solver: solver.to_owned(), ..plain.clone() });
    let program = Strategy { omit: Omissions::ALL, ..plain };
    let all_rows = Strategy { omit: Omissions::ALL - Omission::Symmetry.into(), ..program.clone() };
    let mut ways: Vec<Solved> = Vec::new();
    for repetition in 0..context.profile().pick(1, 7, 9) {
        let mut keep = |n: usize, label: &dyn Fn() -> String, strategy: &Strategy, (run, seconds): (Run<'_>, f64)| {
            if repetition == 0 {
                ways.push(Solved::new(label(), strategy.clone(), &run));
            }
            ways[n].seconds.push(seconds);
        };
        for (n, (label, strategy)) in [(PROGRAM, &program), (ALL_ROWS, &all_rows)].into_iter().enumerate() {
            let (run, chosen, time) = planned(&grey, strategy)?;
            keep(n, &|| label.to_owned(), &chosen, (run, time));
        }
        for (n, pick) in (2..).zip(&picks) {
            keep(n, &|| format!("{}, {}", pick.store.name(), pick.solver), pick, by_hand(&one_band, pick)?);
        }
    }
    for way in &ways {
        let apart = difference(std::slice::from_ref(&ways[0].answer), std::slice::from_ref(&way.answer));
        let record = counts(Record::new(format!("{BY_HAND}/{k}/{}", way.label)), &way.cost)
            .text("scene", BY_HAND)
            .text("left_out", &way.label)
            .text("method", way.strategy.method.name())
            .text("store", way.strategy.store.name())
            .text("solver", &way.strategy.solver)
            .int("elements", way.elements)
            .int("steps", way.steps)
            .float("difference", apart)
            .text("outcome", if apart <= EXACT { way.outcome.to_string() } else { "failed".to_owned() });
        context.record(record.repetitions("time", &way.seconds));
    }
    context.tick(format!("{BY_HAND}, {k}"));
    Ok(())
}

/// The median of the repetitions of a time.
fn median(row: &Row<'_>) -> f64 {
    row.number("time_median")
}

/// Elements, the program's median times with and without copies, and the hand of the least median.
fn against_hands(tables: &Tables) -> Vec<(f64, [f64; 2], Row<'_>)> {
    let mut known = Vec::new();
    for (m, rows) in group_by(tables.select_eq("scene", BY_HAND), "elements") {
        let is = |row: &Row<'_>, label: &str| row.text("left_out") == label;
        let of = |label: &str| rows.iter().find(|row| is(row, label)).map(median);
        let program = [of(PROGRAM), of(ALL_ROWS)];
        let hands = rows.into_iter().filter(|row| !is(row, PROGRAM) && !is(row, ALL_ROWS));
        let best = hands.min_by(|a, b| median(a).total_cmp(&median(b)));
        if let (Ok(m), [Some(program), Some(all_rows)], Some(best)) = (m.parse(), program, best) {
            known.push((m, [program, all_rows], best));
        }
    }
    known
}

/// What a run took, as a share of the run of its scene that keeps everything: 1 where that took nothing.
fn share(row: &Row<'_>, whole: &Row<'_>, column: &str) -> f64 {
    let of = |row: &Row<'_>| if column == "time" { median(row) } else { row.number(column) };
    if of(whole) > 0.0 { of(row) / of(whole) } else { 1.0 }
}

/// Scenes of which a plan leaves something out, with their rows: first the one that keeps everything.
fn scenes(tables: &Tables) -> Vec<(String, Vec<Row<'_>>)> {
    let mut scenes = group_by(tables.rows(), "scene");
    let specular = |rows: &[Row<'_>]| rows.iter().any(|row| row.text("left_out") == NOT_SPECULAR);
    scenes.retain(|(name, rows)| ![BY_HAND, WITHIN].contains(&&**name) && (rows.len() > 2 || specular(rows)));
    scenes
}

impl Experiment for LeftOut {
    fn name(&self) -> &'static str {
        "11-left-out"
    }

    fn question(&self) -> &str {
        "What does each exact omission save, alone and with the others, is that what was predicted, and does the answer stay?"
    }

    fn expects(&self) -> &str {
        "Answers that differ by rounding, savings known beforehand to the last count, and a grey empty room solved as fast as by hand."
    }

    fn settings(&self, profile: Profile) -> serde_json::Value {
        let elements = profile.pick(150, 700, 2_000);
        serde_json::json!({
            "elements": elements, "by_hand": sizes(profile), "unshot": UNSHOT, "exact": EXACT, "seed": 1,
            "pairs": PAIRS, "bounces": BOUNCES, "view": VIEW,
        })
    }

    /// Differences are rounding alone.
    fn slack(&self, column: &str) -> f64 {
        if column == "difference" { EXACT } else { 0.0 }
    }

    fn run(&self, context: &mut Context) -> Result<(), Box<dyn Error>> {
        let (cases, sizes) = (cases()?, sizes(context.profile()));
        context.begin(cases.len() + 2 + DIFFUSE.len() + sizes.len());
        for case in &cases {
            omissions(context, case)?;
        }
        lit_room_alone(context)?;
        within_an_error(context)?;
        for case in cases.iter().filter(|case| DIFFUSE.contains(&case.name)) {
            specular_light(context, case)?;
        }
        sizes.iter().try_for_each(|&k| grey_room_by_hand(context, k))
    }

    fn plots(&self, tables: &Tables) -> Vec<Figure> {
        let scenes = scenes(tables);
        let bars = |name: &str, title: &str, column: &str| {
            let names = Omission::ALL.map(|one| one.name()).into_iter().chain([NOT_SPECULAR, EVERYTHING]);
            let series = names.map(|left_out| {
                let points = (0..).zip(&scenes).filter_map(|(n, (_, rows))| {
                    let row = rows.iter().find(|row| row.text("left_out") == left_out)?;
                    Some(Point { x: f64::from(n), y: share(row, &rows[0], column), quality: row.quality() })
                });
                Series::new(left_out, left_out).points(points)
            });
            let axis = Axis::linear("share of a run that keeps everything", "");
            let panel = Panel::bars(scenes.iter().map(|(name, _)| name.clone()), axis).all_series(series);
            Figure::new(name, title).caption("Each omission alone, and all of them; 1 is everything kept.").panel(panel)
        };
        let hands = against_hands(tables);
        let line = |label: &str, values: Vec<(f64, f64)>| Series::new(label, label).values(values);
        let program = line(PROGRAM, hands.iter().map(|(m, [program, _], _)| (*m, *program)).collect());
        let all_rows = line(ALL_ROWS, hands.iter().map(|(m, [_, all_rows], _)| (*m, *all_rows)).collect());
        let best = line("best by hand", hands.iter().map(|(m, _, best)| (*m, median(best))).collect());
        vec![
            bars("form-factors", "Form factors left to compute", "form_factors"),
            bars("arithmetic", "Arithmetic left to products", "flops"),
            bars("time", "Time left", "time"),
            Figure::new("by-hand", "An empty grey room, by the program and by hand")
                .caption("Medians of whole runs: three equal bands as the program solves them, and one band with the best store and solver picked by hand.")
                .panel(Panel::new(Axis::log("elements", ""), Axis::log("time", "s")).all_series([program, all_rows, best])),
        ]
    }

    fn reading(&self, tables: &Tables) -> Vec<String> {
        let omitting = tables.select(|row| !row.text("predicted_unknowns").is_empty());
        let sound = omitting.iter().filter(|row| row.quality() == Quality::Good).count();
        let worst = omitting.iter().map(|row| row.number("difference")).fold(0.0, f64::max);
        let best = scenes(tables).into_iter().filter_map(|(name, rows)| {
            let all = rows.iter().find(|row| row.text("left_out") == EVERYTHING)?;
            Some((share(all, &rows[0], "time"), name))
        });
        let best = best.min_by(|a, b| a.0.total_cmp(&b.0));
        let plans = omitting.iter().map(|row| row.seconds("plan_time") / row.seconds("time")).fold(0.0, f64::max);
        let hands = against_hands(tables).into_iter().map(|(m, [program, all_rows], best)| {
            format!(
                "{} elements {:.2} ×, {:.2} × if it computes all rows ({})",
                numbers::grouped(m as i64),
                program / median(&best),
                all_rows / median(&best),
                best.text("left_out")
            )
        });
        let within = tables.select_eq("scene", WITHIN);
        let of = |name: &str| within.iter().filter(|row| row.text("left_out") == name).collect::<Vec<_>>();
        let whole = of(NOTHING).first().map_or(f64::NAN, |row| row.number("form_factors"));
        let pairs = of("pairs").into_iter().map(|row| {
            let [asked, bound, change] =
                ["asked", "bound", "change"].map(|column| numbers::percent(row.number(column)));
            let gone = numbers::percent(1.0 - row.number("form_factors") / whole);
            format!("{gone} of the pairs at {asked} (bound {bound}, change {change})")
        });
        let pairs = pairs.collect::<Vec<_>>().join(", ");
        let computed = |name: &str| of(name).first().map_or(f64::NAN, |row| row.number("form_factors"));
        let view = numbers::percent(computed(OF_THE_VIEW) / computed(EVERY_POINT));
        let mirrors = scenes(tables).into_iter().filter_map(|(name, rows)| {
            let row = rows.iter().find(|row| row.text("left_out") == NOT_SPECULAR && row.quality() == Quality::Good)?;
            Some(format!("{name} {} rays of {}", row.text("saved_rays"), rows[0].text("rays")))
        });
        let mirrors: Vec<String> = mirrors.collect();
        let two_rooms = tables.select(|row| row.text("left_out") == ALONE);
        let alone =
            two_rooms.first().map_or("?", |row| if row.quality() == Quality::Good { "those" } else { "not those" });
        vec![
            format!(
                "{sound} of {} runs save what was predicted and differ from everything kept by at most {worst:.0e}; {} A plan takes at most {} of the time of a run.",
                omitting.len(),
                best.map_or_else(String::new, |(share, name)| format!(
                    "most is left out of the scene {name}: {} of the time remain.",
                    numbers::percent(share)
                )),
                numbers::percent(plans),
            ),
            format!(
                "Within an error a furnished room is left {pairs}; refinement for a view of one of two rooms takes {view} of the form factors of every point."
            ),
            format!(
                "Counts of two rooms of which one is lit are {alone} of the lit one alone{}.",
                two_rooms.first().map_or_else(String::new, |row| format!(
                    ", and their time {:.2} times its",
                    row.number("with_dark_time_median") / median(row)
                ))
            ),
            format!("Without mirrors light by way of them saves what was predicted: {}.", mirrors.join(", ")),
            format!("The empty grey room against the fastest pick by hand: {}.", hands.collect::<Vec<_>>().join(", ")),
        ]
    }
}
