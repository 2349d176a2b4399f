//! What several experiments share: scenes, the record of a measured run, pictures.

use std::error::Error;
use std::path::{Path, PathBuf};

use glam::DVec3;
use radiosity::plan::{Anyway, Omissions, Savings};
use radiosity::{ErrorMeasure, Geometry, GridValues, LinearRadiosity, Measured, Method, Plan, Run, Strategy, run};
use radiosity_core::{BandValues, Cost};
use radiosity_form_factors::analytic::PartialVisibility;
use radiosity_geometry::{Occluders, Scene};
use radiosity_io::{ReadOptions, read_scene};
use radiosity_render::{Camera, Exposure, Image, View, ViewSettings};

use radiosity_experiments::{Context, Profile, REFERENCES, Record, Row};
use radiosity_plot::fit::PowerLaw;

use crate::truth::{Truth, nested_pairs_truth};

/// Cells of the report grid along an edge of a face.
pub const GRID: u32 = 8;

/// The Cornell box of this project's scenes.
pub fn cornell() -> Result<Scene, Box<dyn Error>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell_box.obj");
    Ok(read_scene(&path, &ReadOptions::default())?.scene)
}

/// The scene with every reflectance times `factor`.
pub fn with_reflectance(scene: &Scene, factor: f64) -> Scene {
    let mut scene = scene.clone();
    for rho in scene.materials.iter_mut().flat_map(|m| &mut m.reflectance) {
        *rho *= factor;
    }
    scene
}

/// The reference of the Cornell box, kept beside the results so that experiments share it.
pub fn cornell_truth(context: &Context, scene: &Scene) -> Result<Truth, Box<dyn Error>> {
    // Longest edge of an element, in the box's millimetres.
    let length = context.profile().pick(35.0, 28.0, 10.0);
    kept(context, &format!("cornell-pairs-{length}"), || nested_pairs_truth(scene, length, GRID))
}

/// The reference of that name beside the results, or else the one that `make` gives, which is kept there.
pub fn kept(
    context: &Context,
    name: &str,
    make: impl FnOnce() -> Result<Truth, Box<dyn Error>>,
) -> Result<Truth, Box<dyn Error>> {
    let folder = context.directory().parent().map_or_else(|| PathBuf::from("."), Path::to_path_buf).join(REFERENCES);
    let file = folder.join(format!("{name}.csv"));
    match read_truth(&file) {
        Ok(known) => Ok(known),
        Err(_) => {
            let known = make()?;
            std::fs::create_dir_all(&folder)?;
            write_truth(&file, &known)?;
            Ok(known)
        }
    }
}

fn write_truth(file: &Path, truth: &Truth) -> Result<(), Box<dyn Error>> {
    let grid = &truth.grid;
    let mut table = csv::Writer::from_path(file)?;
    let bands = grid.values.count();
    let names = (0..bands).map(|b| format!("H_{b}"));
    table.write_record(["surface", "i", "j", "area", "error"].map(str::to_owned).into_iter().chain(names))?;
    for (c, &(i, j)) in grid.indices.iter().enumerate() {
        let start = [grid.surfaces[c].to_string(), i.to_string(), j.to_string()];
        let reals = [grid.areas[c], truth.error].into_iter().chain((0..bands).map(|b| grid.values.band(b)[c]));
        table.write_record(start.into_iter().chain(reals.map(|v| format!("{v:e}"))))?;
    }
    table.flush()?;
    Ok(())
}

fn read_truth(file: &Path) -> Result<Truth, Box<dyn Error>> {
    let mut table = csv::Reader::from_path(file)?;
    let bands = table.headers()?.len().checked_sub(5).filter(|&b| b > 0).ok_or("no bands")?;
    let (mut surfaces, mut indices, mut areas) = (Vec::new(), Vec::new(), Vec::new());
    let (mut cells, mut error) = (Vec::new(), 0.0);
    for record in table.records() {
        let record = record?;
        let at = |k: usize| record.get(k).ok_or("a short line");
        surfaces.push(at(0)?.parse()?);
        indices.push((at(1)?.parse()?, at(2)?.parse()?));
        areas.push(at(3)?.parse()?);
        error = at(4)?.parse()?;
        cells.push((0..bands).map(|b| Ok(at(5 + b)?.parse()?)).collect::<Result<Vec<f64>, Box<dyn Error>>>()?);
    }
    let values = (0..bands).flat_map(|b| cells.iter().map(move |cell| cell[b])).collect();
    let grid = GridValues { surfaces, indices, values: BandValues::new(values, areas.len()), areas };
    Ok(Truth { grid, error })
}

/// Columns that every measured run has.
pub fn record(key: String, strategy: &Strategy, measured: &Measured<'_>) -> Record {
    let record = record_of(key, strategy, &measured.run, &measured.error)
        .float("solver_error", measured.solver_error)
        .float("form_factor_error", measured.form_factor_error);
    match measured.mesh_error {
        Some(error) => record.float("mesh_error", error),
        None => record,
    }
}

/// Columns of a run whose error is known as a whole.
pub fn record_of(key: String, strategy: &Strategy, run: &Run<'_>, error: &ErrorMeasure) -> Record {
    counts(described(key, strategy), &run.cost())
        .int("elements", run.geometry.elements().len())
        .int("patches", run.geometry.patches().len())
        .text("outcome", run.solution.outcome)
        .int("steps", run.solution.steps)
        .int("stored_bytes", run.stored_bytes)
        .float("error", error.rms)
        .float("worst_cell", error.worst)
}

/// A record that names its strategy.
pub fn described(key: String, strategy: &Strategy) -> Record {
    Record::new(key)
        .text("method", strategy.method.name())
        .text("setting", setting(strategy.method))
        .text("store", strategy.store.name())
        .text("form", strategy.shape.name())
        .text("solver", &strategy.solver)
}

/// The number that says how fine an estimator is.
pub fn setting(method: Method) -> String {
    let count = match method {
        Method::Analytic { partial: PartialVisibility::Exact { tolerance }, .. } => return format!("{tolerance:e}"),
        Method::RayCast { error: Some(error), .. } => return format!("{error:e}"),
        Method::Analytic { partial: PartialVisibility::Rays { samples, .. }, .. } => samples,
        Method::RayCast { rays, .. } | Method::RaysAndEmitters { rays } => rays,
        Method::Hemicube { resolution } => resolution,
    };
    count.to_string()
}

/// A record with its counts.
pub fn counts(record: Record, cost: &Cost) -> Record {
    record
        .int("form_factors", cost.form_factors)
        .int("source_evaluations", cost.source_evaluations)
        .int("rays", cost.rays)
        .int("hemicube_pixels", cost.hemicube_pixels)
        .int("entries_read", cost.entries)
}

/// Times of a strategy: that of the measured run, and of more runs while they are short.
pub fn times(
    record: Record,
    scene: &Scene,
    strategy: &Strategy,
    measured: &Measured<'_>,
) -> Result<Record, Box<dyn Error>> {
    times_of(record, scene, strategy, &measured.run)
}

/// [`times`] of a run whose errors were measured apart.
pub fn times_of(record: Record, scene: &Scene, strategy: &Strategy, first: &Run<'_>) -> Result<Record, Box<dyn Error>> {
    let mut estimate = vec![first.form_factors.time.as_secs_f64()];
    let mut solve = vec![first.solution.time.as_secs_f64()];
    let mut total = vec![first.seconds()];
    // A short run is repeated: the smallest of several repeats best on a shared machine.
    let repetitions = if total[0] < 0.3 { 2 } else { 0 };
    for _ in 0..repetitions {
        let again = run(scene, &Strategy { verify: false, ..strategy.clone() }, &mut ())?;
        estimate.push(again.form_factors.time.as_secs_f64());
        solve.push(again.solution.time.as_secs_f64());
        total.push(again.seconds());
    }
    Ok(record.repetitions("form_factor_time", &estimate).repetitions("solve_time", &solve).repetitions("time", &total))
}

/// Says in one line what was left out of runs on `scene`, by geometry and by the plan of `strategy`, and what that saved: predicted, and as counted in a `run` if there is one. Of runs
/// that keep everything, so that their counts are of whole systems, it says what a plan would leave out.
pub fn left_out(
    context: &mut Context,
    scene: &str,
    strategy: &Strategy,
    geometry: &Geometry<'_>,
    run: Option<&Run<'_>>,
) {
    context.left_out(scene, || {
        let mut parts: Vec<String> = Plan::new(geometry.scene(), strategy)
            .anyway(geometry, strategy, run)
            .iter()
            .filter(|left| left.count() != Some(0))
            .map(Anyway::to_string)
            .collect();
        let followed = strategy.omit != Omissions::NONE;
        let savings = match run {
            Some(run) if followed => run.left_out.clone(),
            _ => {
                let planned = Strategy { omit: Omissions::ALL, ..strategy.clone() };
                Plan::new(geometry.scene(), &planned).left_out(geometry, &planned)
            }
        };
        parts.push(by_plan(&savings, followed));
        parts.join("; ")
    });
}

/// What a plan leaves out, if it is `followed`, or would.
fn by_plan(savings: &Savings, followed: bool) -> String {
    let list: Vec<String> =
        savings.list.iter().map(|left| format!("{} ({})", left.what, left.omission.reason())).collect();
    let plan =
        if followed { "a plan leaves out" } else { "kept for the sake of counts, though a plan would leave out" };
    if list.is_empty() {
        return format!(
            "{} leaves out nothing more",
            if followed { "a plan" } else { "a plan, which was not followed," }
        );
    }
    let predicted = &savings.predicted;
    let measured = match savings.measured {
        Some(measured) if measured == *predicted => ", as predicted",
        Some(_) => ", not as predicted",
        None => "",
    };
    format!("{plan} {}, which saves {predicted}{measured}", list.join(", "))
}

/// The view into the Cornell box that its measurements were made for.
pub fn cornell_camera(side: u32) -> Result<Camera, Box<dyn Error>> {
    let (eye, look_at) = (DVec3::new(278.0, 273.0, -800.0), DVec3::new(278.0, 273.0, 0.0));
    Ok(Camera::new(eye, look_at, DVec3::Y, 39.3, side, side)?)
}

/// Radiosity shown as white in every picture of the Cornell box, in W/m².
pub const WHITE: f64 = 1.2;

/// A picture of radiosities on the exposed elements, with the exposure that all pictures share.
pub fn picture(geometry: &Geometry<'_>, radiosity: &BandValues, side: u32) -> Result<Image, Box<dyn Error>> {
    let values: Vec<[f64; 3]> =
        (0..geometry.elements().len()).map(|e| [0, 1, 2].map(|b| radiosity.band(b)[e])).collect();
    Ok(view(geometry, side)?.picture(&values, Exposure::white_at(WHITE)))
}

/// The same with radiosity that is linear inside elements.
pub fn linear_picture(geometry: &Geometry<'_>, linear: &LinearRadiosity, side: u32) -> Result<Image, Box<dyn Error>> {
    let value = |e: usize, point: DVec3| {
        let place = linear.place(e, point);
        [0, 1, 2].map(|b| linear.radiosity(e, &place, b))
    };
    Ok(view(geometry, side)?.picture_of(value, Exposure::white_at(WHITE)))
}

fn view(geometry: &Geometry<'_>, side: u32) -> Result<View, Box<dyn Error>> {
    let facets = geometry.elements();
    Ok(View::new(facets, &Occluders::of_facets(facets), &cornell_camera(side)?, ViewSettings::default()))
}

/// Side of a picture in pixels.
pub fn picture_side(profile: Profile) -> u32 {
    profile.pick(48, 360, 480)
}

/// A number or, in the column `time`, seconds.
pub fn value(row: &Row<'_>, column: &str) -> f64 {
    if column == "time" { row.seconds(column) } else { row.number(column) }
}

/// An exponent with its 95 % interval, as it stands behind `m^` in a sentence.
pub fn exponent(law: Option<PowerLaw>) -> String {
    match law {
        Some(law) if law.interval.is_finite() => format!("({:.2} ± {:.2})", law.slope, law.interval),
        Some(law) => format!("{:.2} (two sizes)", law.slope),
        None => "? (too few sizes)".to_owned(),
    }
}
