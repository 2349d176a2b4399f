//! `radiosity render`: a picture of a scene, by two passes or by tracing paths.
//!
//! What is not asked for is chosen so that any scene gives a picture: about 2,000 elements of equal size, rows of 4,096 rays with exact emitters, direct light from
//! a point drawn on a light, indirect light from the mesh, linear inside its elements. Rounds of 16 samples a pixel follow until the noise ([`Film::noise`]) is low enough. Rounds depend on their
//! number alone, so that a film that goes on from its state, the first pass computed again, ends with the same bytes.
//!
//! What is *not* here: the passes themselves (`radiosity`, `radiosity-render`), what to see of a scene ([`crate::viewpoint`]), and
//! numbers in false colours ([`crate::false_colour`]).

use std::f64::consts::PI;
use std::path::Path;
use std::time::{Duration, Instant};

use radiosity::plan::Anyway;
use radiosity::{
    EnhancedRun, LinearIrradiance, Method, Plan, Shape, Size, SpecularTransport, Store, Strategy, predict_enhanced,
    run_enhanced,
};
use radiosity_core::Outcome;
use radiosity_geometry::mesh::Subdivision;
use radiosity_geometry::{Occluders, Scene};
use radiosity_io::{Imported, write_exr, write_png};
use radiosity_render::numbers::ROUND;
use radiosity_render::{
    Camera, Control, Exposure, FacetIrradiance, Field, Film, PathClass, PathClasses, PathTracer, Stage, Stored, Tone,
    TwoPass, TwoPassSettings, fingerprint,
};
use serde_json::{Value, json};

use crate::args::{RenderArgs, Shading};
use crate::false_colour::{self, FalseColours};
use crate::film_state::{self, Settings};
use crate::solve::SPECULAR_RAYS;
use crate::viewpoint::Viewpoint;
use crate::{Failure, Verdict, memory, output, plan, scene, solve};

/// Elements of the first pass, about, if no mesh is asked for.
const ELEMENTS: f64 = 2000.0;

/// Rays of a row of straight form factors of the first pass, as many as by way of specular surfaces: neighbouring elements should not differ to the eye.
const RAYS: u32 = SPECULAR_RAYS;

/// Noise at which a picture is done if none is asked for.
const NOISE: f64 = 0.02;

/// Most samples a pixel below which it does not pay to find out where they are needed.
const ALLOTTED: u32 = 256;

/// Share of the pixels that show no light that are not brighter than white.
const BELOW_WHITE: f64 = 0.98;

/// Why the first pass takes what a plan would leave out.
const PLAN_OFF: &str = "pictures take light by each of its ways, of all elements in all bands";

/// Time between two previews.
const EVERY: Duration = Duration::from_secs(3);

/// Runs the command.
pub fn run(args: &RenderArgs) -> Result<Verdict, Failure> {
    for path in [Some(&args.output), args.preview.as_ref()].into_iter().flatten() {
        format_of(path)?;
    }
    for path in [Some(&args.output), args.preview.as_ref(), args.state.as_ref()].into_iter().flatten() {
        in_a_folder(path)?;
    }
    let colours = FalseColours::new(args)?;
    let imported = scene::with_specular(&args.common)?;
    let scene = &imported.scene;
    if !matches!(scene.bands(), 1 | 3) {
        return Err(format!("a picture shows 1 or 3 bands; this scene has {}", scene.bands()).into());
    }
    let view = Viewpoint::new(&args.view, scene)?;
    let classes = classes(args);
    let strategy = strategy(args, scene);
    let transport = args.transport();
    if args.common.dry_run {
        return dry_run(args, scene, &strategy, transport, &view);
    }
    let settings = settings(args, scene, &strategy, &view);
    let [width, height] = args.view.size;
    let new = if args.even || args.samples < ALLOTTED { Film::new } else { Film::by_noise };
    let empty = new(width, height, scene.bands());
    let mut film = match &args.state {
        Some(path) if args.resume => film_state::read(path, empty, &settings)?,
        _ => empty,
    };
    let of_surfaces = colours.as_ref().and_then(FalseColours::of_surfaces);
    let mut studio = Studio { args, settings, colours, seconds: 0.0, look: None };
    let seed = args.common.seed;
    if args.reference {
        let occluders = Occluders::of_scene(scene);
        let stage = Stage::new(scene, &occluders);
        let tracer = PathTracer::new(&stage, classes);
        studio.expose(&mut film, &stage, &view, |film| match of_surfaces {
            Some(quantity) => {
                false_colour::expose(quantity, (&stage, &view.camera), classes, seed, film, |place, numbers, h| {
                    tracer.irradiance(place.point, place.normal, numbers, h)
                });
            }
            None => tracer.expose(&view.camera, seed, film),
        })?;
        return studio.finish(&imported, &film, &stage, &view, None);
    }
    let first = run_enhanced(scene, &strategy, transport, &mut ()).map_err(memory::explained)?;
    let stage = Stage::new(scene, first.run.geometry.element_occluders());
    let geometry = &first.run.geometry;
    let stored = first.ways.each_ref().map(|h| -> Box<dyn Field + '_> {
        match args.shading {
            Shading::Flat => Box::new(FacetIrradiance(h)),
            Shading::Linear => Box::new(LinearIrradiance::new(geometry, h)),
        }
    });
    let ways = stored.each_ref().map(|field| &**field);
    let pass = TwoPassSettings { light_points: args.light_points, gather: args.gather };
    let mut pass = TwoPass::new(&stage, Stored::Apart(ways), pass, classes)?;
    let control = (args.gather > 0 && args.gather_tolerance > 0.0).then(|| {
        let clock = Instant::now();
        let elements = (geometry.elements(), &geometry.reflectance());
        let control = Control::new(&stage, elements, ways, args.gather_tolerance, seed);
        studio.look = Some(Look { control: control.clone(), seconds: clock.elapsed().as_secs_f64() });
        control
    });
    if let Some(control) = &control {
        pass = pass.controlled(control);
    }
    studio.expose(&mut film, &stage, &view, |film| match of_surfaces {
        Some(quantity) => {
            false_colour::expose(quantity, (&stage, &view.camera), classes, seed, film, |place, _, h| {
                false_colour::stored(ways, classes, place, h)
            });
        }
        None => pass.expose(&view.camera, seed, film),
    })?;
    studio.finish(&imported, &film, &stage, &view, Some((&strategy, &first)))
}

/// The classes asked for; all if none is.
fn classes(args: &RenderArgs) -> PathClasses {
    if args.paths.is_empty() {
        return PathClasses::ALL;
    }
    args.paths.iter().fold(PathClasses::NONE, |set, class| set.with(*class))
}

/// How the first pass is solved: rows of rays with exact emitters, of which most entries are 0 where there are many elements.
fn strategy(args: &RenderArgs, scene: &Scene) -> Strategy {
    let mut mesh = solve::mesh_settings(&args.mesh);
    if args.mesh.subdivide.is_none() && args.mesh.element_size.is_none() {
        mesh.elements = Subdivision::EdgeLength((scene.area() / ELEMENTS).sqrt());
    }
    let shape = if mesh.patches.is_some() { Shape::ElementsToPatches } else { Shape::Full };
    let plain = Strategy::new(mesh.elements, Method::RaysAndEmitters { rays: RAYS });
    let memory = memory::limit(&args.common);
    Strategy { mesh, shape, store: Store::Sparse, seed: args.common.seed, memory, ..plain }
}

/// What samples depend on.
fn settings(args: &RenderArgs, scene: &Scene, strategy: &Strategy, view: &Viewpoint) -> Settings {
    let method = if args.reference {
        "--reference".to_owned()
    } else {
        format!(
            "{:?} on {:?}, bounces {:?} by {:?}, light points {}, gather {} above {}, {:?}",
            strategy.method,
            strategy.mesh,
            args.specular_bounces,
            args.specular_by,
            args.light_points,
            args.gather,
            args.gather_tolerance,
            args.shading
        )
    };
    // A film of B or H is another; one of errors is that of the picture.
    let shown = args.false_colours.false_colour.filter(|quantity| quantity.is_of_surfaces());
    let method = match shown {
        Some(quantity) => format!("{} by {method}", quantity.name()),
        None => method,
    };
    let classes: Vec<&str> =
        PathClass::ALL.into_iter().filter(|c| classes(args).has(*c)).map(PathClass::name).collect();
    vec![
        ("scene", format!("{:016x}", fingerprint(scene))),
        ("camera", view.json().to_string()),
        ("--seed", args.common.seed.to_string()),
        ("--paths", classes.join(",")),
        ("method", method),
        ("--even", (args.even || args.samples < ALLOTTED).to_string()),
        ("version of the program", env!("CARGO_PKG_VERSION").to_owned()),
    ]
}

/// A picture being taken.
struct Studio<'a> {
    args: &'a RenderArgs,
    settings: Settings,
    /// How it is shown if not as it looks.
    colours: Option<FalseColours>,
    /// Time of all rounds of this run.
    seconds: f64,
    /// Where directions are gathered, unless everywhere or nowhere.
    look: Option<Look>,
}

/// How elements that need a gather were found.
struct Look {
    control: Control,
    seconds: f64,
}

impl Studio<'_> {
    fn noise(&self) -> f64 {
        self.args.noise.unwrap_or(NOISE)
    }

    /// Whether a film is good enough.
    fn good(&self, film: &Film) -> bool {
        film.rounds > 1 && self.noise() > 0.0 && film.noise() <= self.noise()
    }

    /// Takes rounds until the film is good enough or has as many samples as it may have.
    fn expose(
        &mut self,
        film: &mut Film,
        stage: &Stage<'_>,
        view: &Viewpoint,
        mut round: impl FnMut(&mut Film),
    ) -> Result<(), Failure> {
        let common = &self.args.common;
        let most = f64::from(self.args.samples);
        let mut shown = Instant::now();
        while film.samples_of_a_pixel() < most && !self.good(film) {
            let clock = Instant::now();
            round(film);
            self.seconds += clock.elapsed().as_secs_f64();
            if shown.elapsed() >= EVERY {
                self.keep(film, stage, view)?;
                if !(common.quiet || common.no_progress || common.json) {
                    eprintln!("{:.0} samples a pixel, noise {}", film.samples_of_a_pixel(), percent(film.noise()));
                }
                shown = Instant::now();
            }
        }
        self.keep(film, stage, view)
    }

    /// Writes preview and state, where asked for.
    fn keep(&self, film: &Film, stage: &Stage<'_>, view: &Viewpoint) -> Result<(), Failure> {
        if let Some(path) = &self.args.preview {
            self.write(path, film, stage, view)?;
        }
        if let Some(path) = &self.args.state {
            film_state::write(path, film, &self.settings)?;
        }
        Ok(())
    }

    /// White as asked for, or what few of the pixels that show no light exceed; lights are far brighter than what they light.
    fn exposure(&self, film: &Film, stage: &Stage<'_>, view: &Viewpoint) -> Exposure {
        let tone = self.args.tone.into();
        let exposure = match self.args.white {
            Some(white) => Exposure::white_at(white),
            None => {
                let values = radiosities(film);
                let shown = |k: usize| !shows_light(stage, &view.camera, k);
                let mut counts: Vec<f64> = (0..values.len()).map(|k| f64::from(u8::from(shown(k)))).collect();
                if counts.iter().all(|count| *count == 0.0) {
                    counts.fill(1.0);
                }
                let white = Exposure::of_share(&values, &counts, BELOW_WHITE).white();
                Exposure::white_at(white * Tone::headroom(tone))
            }
        };
        exposure.toned(tone)
    }

    /// Writes a picture; gives the radiosity shown as white if there is one.
    fn write(&self, path: &Path, film: &Film, stage: &Stage<'_>, view: &Viewpoint) -> Result<Option<f64>, Failure> {
        if let Some(colours) = &self.colours {
            return colours.write(path, film, stage, &view.camera).map(|()| None);
        }
        match format_of(path)? {
            Format::Png => {
                let exposure = self.exposure(film, stage, view);
                let rgb: Vec<u8> = radiosities(film).into_iter().flat_map(|b| exposure.colour(b)).collect();
                write_png(path, film.width, film.height, &rgb)?;
                Ok(Some(exposure.white()))
            }
            Format::Exr => {
                let rgb: Vec<[f32; 3]> = radiances(film).into_iter().map(|l| l.map(|l| l as f32)).collect();
                write_exr(path, film.width, film.height, &rgb)?;
                Ok(None)
            }
        }
    }

    /// Writes the picture and reports.
    fn finish(
        &self,
        imported: &Imported,
        film: &Film,
        stage: &Stage<'_>,
        view: &Viewpoint,
        first: Option<(&Strategy, &EnhancedRun<'_>)>,
    ) -> Result<Verdict, Failure> {
        let args = self.args;
        let white = self.write(&args.output, film, stage, view)?;
        let scale = self.colours.as_ref().map(|colours| colours.ends(film, stage, &view.camera));
        let converged = first.is_none_or(|(_, first)| first.run.solution.outcome == Outcome::Converged);
        let met = args.noise.is_none_or(|noise| noise == 0.0 || self.good(film));
        let left_out = match first {
            Some((strategy, first)) => left_out(args, strategy, first),
            None => Vec::new(),
        };
        let object = json!({
            "picture": args.output.display().to_string(),
            "camera": view.json(),
            "white": white,
            "scale": scale,
            "method": if args.reference { "path tracing" } else { "two passes" },
            "first_pass": first.map(first_json),
            "left_out": [],
            "plan_off": PLAN_OFF,
            "left_out_anyway": plan::anyway_json(&left_out),
            "second_pass": { "seconds": self.seconds, "counts": output::cost(&film.cost) },
            "gathering": self.look.as_ref().map(|look| json!({
                "elements": look.control.count(), "seconds": look.seconds, "counts": output::cost(&look.control.cost),
            })),
            "samples": film.samples_of_a_pixel().round() as u64,
            "noise": finite(film.noise()),
            "noise_met": self.good(film),
            "peak_bytes": output::peak_bytes(),
            "scene": output::import(&imported.report),
        });
        let mut lines: Vec<String> = first.map(first_line).into_iter().collect();
        lines.extend(plan::anyway_line(&left_out));
        lines.extend(self.look.as_ref().map(|look| {
            let (count, rays) = (look.control.count(), look.control.cost.rays);
            format!("gathering from {count} elements, found by {rays} rays in {:.3} s", look.seconds)
        }));
        lines.push(format!(
            "{} × {} pixels: {:.0} samples a pixel in {:.3} s, {} rays, noise {}{}",
            film.width,
            film.height,
            film.samples_of_a_pixel(),
            self.seconds,
            film.cost.rays,
            percent(film.noise()),
            white.map_or_else(String::new, |white| format!("; white is {white:.4e} W/m²"))
        ));
        lines.extend(
            scale.map(|[low, high]| format!("colours from {low:.4e} to {high:.4e} W/m² (--range={low},{high})")),
        );
        lines.push(format!("→ {}", args.output.display()));
        output::print(&args.common, &object, &lines);
        Ok(if converged && met { Verdict::Done } else { Verdict::CheckFailed })
    }
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn percent(noise: f64) -> String {
    finite(noise).map_or_else(|| "not known".to_owned(), |noise| format!("{:.2} %", 100.0 * noise))
}

/// What was not computed: by geometry, for want of specular surfaces, and since nothing is shown before the first pass is done.
fn left_out(args: &RenderArgs, strategy: &Strategy, first: &EnhancedRun<'_>) -> Vec<Anyway> {
    let (geometry, scene) = (&first.run.geometry, first.run.geometry.scene());
    let mut left = Plan::new(scene, strategy).anyway(geometry, strategy, None);
    let rows = first.run.form_factors.cost.source_evaluations - first.specular.cost.source_evaluations;
    left.extend(args.transport().left_out(scene, rows, Some(first.specular.cost.rays)));
    left.push(Anyway::ambient(Some(first.run.solution.steps)));
    left
}

fn first_json((strategy, first): (&Strategy, &EnhancedRun<'_>)) -> Value {
    let (run, solution) = (&first.run, &first.run.solution);
    json!({
        "elements": run.geometry.elements().len(),
        "patches": run.geometry.patches().len(),
        "method": output::method(strategy.method),
        "store": strategy.store.name(),
        "solver": strategy.solver,
        "outcome": solution.outcome.to_string(),
        "steps": solution.steps,
        "seconds": run.seconds(),
        "meshing": output::phase(&run.meshing),
        "form_factors": output::phase(&run.form_factors),
        "extended_form_factors": output::phase(&first.specular),
        "solve": { "seconds": solution.time.as_secs_f64(), "counts": output::cost(&solution.cost) },
        "counts": output::cost(&run.cost()),
        "stored_bytes": run.stored_bytes,
    })
}

fn first_line((strategy, first): (&Strategy, &EnhancedRun<'_>)) -> String {
    let run = &first.run;
    format!(
        "first pass: {} elements, form factors by {} in {:.3} s, {:.3} s of that by way of specular surfaces; {}: {}, {} steps",
        run.geometry.elements().len(),
        strategy.method.name(),
        run.form_factors.time.as_secs_f64(),
        first.specular.time.as_secs_f64(),
        strategy.solver,
        run.solution.outcome,
        run.solution.steps
    )
}

fn dry_run(
    args: &RenderArgs,
    scene: &Scene,
    strategy: &Strategy,
    transport: SpecularTransport,
    view: &Viewpoint,
) -> Result<Verdict, Failure> {
    let [width, height] = args.view.size;
    let most = u64::from(width) * u64::from(height) * u64::from(args.samples.div_ceil(ROUND) * ROUND);
    let mut object = json!({ "dry_run": true, "camera": view.json(), "most_samples": most });
    let mut lines = vec![format!("{width} × {height} pixels, {most} samples at most; nothing written")];
    if !args.reference {
        // What would not fit is not meshed either.
        let p = predict_enhanced(scene, &Size::before_meshing(scene, &strategy.mesh)?, strategy, transport)?;
        let left_out = [transport.left_out(scene, p.source_evaluations, None), Some(Anyway::ambient(None))];
        let left_out: Vec<Anyway> = left_out.into_iter().flatten().collect();
        object["left_out_anyway"] = plan::anyway_json(&left_out);
        lines.extend(plan::anyway_line(&left_out));
        object["predicted"] = json!({
            "elements": p.elements, "form_factors": p.form_factors, "rays": p.rays, "stored_bytes": p.stored_bytes,
            "peak_bytes": p.peak_bytes + memory::program(),
        });
        lines[0] = format!(
            "{} elements, {} rays for their form factors, {} of memory; {}",
            p.elements,
            p.rays,
            output::bytes(p.peak_bytes + memory::program()),
            lines[0]
        );
    }
    output::print(&args.common, &object, &lines);
    Ok(Verdict::Done)
}

/// Refuses a file that could not be written after all the work.
fn in_a_folder(path: &Path) -> Result<(), Failure> {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() && !folder.is_dir() => {
            Err(format!("{}: there is no folder {}; make it first", path.display(), folder.display()).into())
        }
        _ => Ok(()),
    }
}

/// Whether the middle of pixel `k` of a camera, counted row by row, shows a light.
pub(crate) fn shows_light(stage: &Stage<'_>, camera: &Camera, k: usize) -> bool {
    let (x, y) = (k % camera.width() as usize, k / camera.width() as usize);
    let direction = camera.direction(x as f64 + 0.5, y as f64 + 0.5);
    let place = stage.first(camera.eye(), direction).filter(|place| place.front);
    place.is_some_and(|place| stage.emission(place.surface).iter().any(|e| *e > 0.0))
}

/// Kinds of pictures.
pub(crate) enum Format {
    Png,
    Exr,
}

/// The kind that a file's name asks for.
pub(crate) fn format_of(path: &Path) -> Result<Format, Failure> {
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("png") => Ok(Format::Png),
        Some("exr") => Ok(Format::Exr),
        _ => Err(format!("{}: a picture ends in .png or .exr", path.display()).into()),
    }
}

/// Radiance of every pixel as red, green and blue; of one band all three show it.
fn radiances(film: &Film) -> Vec<[f64; 3]> {
    film.means().chunks_exact(film.bands).map(|bands| [0, 1, 2].map(|b| bands[b.min(film.bands - 1)])).collect()
}

/// B = πL of every pixel.
fn radiosities(film: &Film) -> Vec<[f64; 3]> {
    radiances(film).into_iter().map(|l| l.map(|l| PI * l)).collect()
}
