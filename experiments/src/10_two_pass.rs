//! Two passes.
//!
//! Question: what does each method miss of a scene with specular surfaces, and what do its rays and its time buy? Theory: radiosity alone has no mirrors, ray tracing alone no
//! interreflection; of two passes (Wallace, Cohen, Greenberg 1987; Sillion and Puech 1989) the first carries light from diffuse surfaces to diffuse ones, by way of as many specular
//! surfaces as it is allowed, and the second shows it; path tracing misses nothing and its noise falls like N^(−1/2), so that twice the accuracy takes four times
//! the rays. Glass takes two bounces to pass, a mirror one. Measured in a Cornell box with a mirror for a wall, a glass sphere and a glossy floor
//! ([`cornell_specular`]); every method takes rounds of 16 samples a pixel, whose seed no other picture has, and two of them also more where there is more noise
//! ([`Film::by_noise`]): of two passes that is in few pixels, of path tracing in most.
//!
//! Errors are rms over pixels and bands against a reference by our path tracer, relative to its mean. It has noise of its own, which is independent of the picture's and of known
//! variance, so
//!
//! ```text
//! error² = mean (L − L_ref)² − mean σ_ref²
//! ```
//!
//! is unbiased, and its own standard error is the spread of that difference over pixels. Signed mean errors come with the standard errors of both pictures (bands of a pixel
//! taken as one, which is more), and of two passes with the mean absolute difference from the picture on a mesh of twice the edge by the same numbers: more than what the mesh
//! still changes wherever halving the edge halves it. The lamp is not in the picture: at its edges all methods make the same noise, and more of it than anything else does. Its
//! images in the sphere are there.
//!
//! Read: lines that go on falling have noise to lose, lines that level off miss paths or err by their mesh; levels at 2 %. Time includes the first pass. Not shown: larger pictures, for which a
//! first pass serves more pixels; other views, for which it serves again.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::DVec3;
use radiosity::{
    EnhancedRun, Geometry, LinearIrradiance, Method, SpecularBy, SpecularTransport, Store, Strategy, run_enhanced,
};
use radiosity_core::Cost;
use radiosity_experiments::{Context, Experiment, Profile, REFERENCES, Record, Row, SeriesOfRows, Tables, group_by};
use radiosity_form_factors::extended::SpecularBounces;
use radiosity_gallery::cornell_specular;
use radiosity_geometry::mesh::Subdivision;
use radiosity_geometry::{Occluders, Scene};
use radiosity_plot::numbers;
use radiosity_plot::{Axis, Dash, Figure, Panel, Series};
use radiosity_render::numbers::STREAMS;
use radiosity_render::{
    Camera, Control, Exposure, FacetIrradiance, Field, Film, Image, PathClasses, PathTracer, Scale, Stage, Stored,
    Tone, TwoPass, TwoPassSettings,
};

use crate::classes;
use crate::common::{left_out, value};

/// The experiment.
pub struct TwoPasses;

/// Error at which rays and times are compared.
const TARGET: f64 = 0.02;
/// Seed of the reference and of the pictures, which must differ.
const REFERENCE_SEED: u64 = 2;
pub const SEED: u64 = 1;
/// Directions that a final gather takes for every sample.
const GATHERED: u32 = 4;
/// Share of the mean reflected radiosity by which an element is off that a gather takes.
const OFF: f64 = 0.02;
/// Rounds from which standard errors are believed.
const BELIEVED: u64 = 8;
/// Ends of the scale of pictures of differences, in per cent of the mean.
const DIFFERENCES: f64 = 50.0;
/// Radiosity shown as white, in W/m².
const WHITE: f64 = 3.0;
/// Width of a picture as shown.
const SHOWN: u32 = 384;

/// Pixels of the pictures.
pub fn size(profile: Profile) -> [u32; 2] {
    profile.pick([16, 12], [48, 36], [128, 96])
}

/// Rounds of the reference.
fn reference_rounds(profile: Profile) -> u64 {
    profile.pick(16, 80, 512)
}

/// Rays of a row of straight form factors, and of one by way of specular surfaces.
fn rays(profile: Profile) -> (u32, u32) {
    profile.pick((64, 64), (512, 1024), (2048, 4096))
}

/// What takes a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Elements in the one radiosity each has; specular surfaces count as absent.
    Radiosity,
    /// Specular paths and direct light.
    RayTracing,
    /// A first pass with so many specular bounces, then specular paths.
    TwoPasses(SpecularBounces),
    /// Paths.
    PathTracing,
}

/// A way to take a picture.
#[derive(Clone, Copy, Debug)]
pub struct Way {
    pub kind: Kind,
    /// Directions of a final gather; 0 looks irradiance up.
    pub gather: u32,
    /// Longest edge of an element; 0 without a mesh.
    edge: f64,
    /// Whether pixels take samples by their noise.
    by_noise: bool,
    rounds: u64,
}

impl Way {
    /// Its colour and marker.
    fn style(self) -> &'static str {
        match self.kind {
            Kind::Radiosity => "radiosity alone",
            Kind::RayTracing => "ray tracing alone",
            Kind::TwoPasses(SpecularBounces::None) => "two passes, 0 bounces",
            Kind::TwoPasses(SpecularBounces::AtMost(_)) => "two passes, 1 bounce",
            Kind::TwoPasses(SpecularBounces::Any) => "two passes, any bounces",
            Kind::PathTracing => "path tracing",
        }
    }

    /// Its name.
    pub fn method(self) -> String {
        let gathered = if self.gather > 0 { ", gathered" } else { "" };
        let by_noise = if self.by_noise { ", by noise" } else { "" };
        format!("{}{gathered}{by_noise}", self.style())
    }

    /// Its name with its mesh.
    fn line(self) -> String {
        if self.edge > 0.0 { format!("{}, edge {}", self.method(), self.edge) } else { self.method() }
    }

    /// Whether no class of paths is missing.
    fn is_complete(self) -> bool {
        matches!(self.kind, Kind::PathTracing | Kind::TwoPasses(SpecularBounces::Any))
    }
}

/// All ways of a profile; those of one kind from the coarsest mesh to the finest, each of half the edge.
fn ways(profile: Profile) -> Vec<Way> {
    use SpecularBounces::{Any, AtMost, None};
    let coarse = profile.pick(1.6, 0.8, 0.8);
    let [few, some, many, most] = profile.pick([1, 2, 8, 8], [4, 8, 16, 32], [16, 32, 64, 128]);
    let plain = |kind, edge, rounds| Way { kind, gather: 0, edge, by_noise: false, rounds };
    let two = |bounces, gather, edge, rounds| Way { gather, ..plain(Kind::TwoPasses(bounces), edge, rounds) };
    let by_noise = |way: Way| Way { by_noise: true, ..way };
    let mut all = vec![
        plain(Kind::Radiosity, 0.5 * coarse, some),
        plain(Kind::RayTracing, 0.0, many),
        two(None, 0, 0.5 * coarse, some),
        two(None, GATHERED, 0.5 * coarse, few),
        two(AtMost(1), 0, 0.5 * coarse, some),
        two(AtMost(1), GATHERED, 0.5 * coarse, few),
    ];
    let halvings = profile.pick(1, 1, 2);
    for halving in 0..=halvings {
        let rounds = if halving == 0 { some } else { most };
        all.push(two(Any, 0, coarse / f64::from(1 << halving), rounds));
    }
    for halving in 0..2 {
        all.push(two(Any, GATHERED, coarse / f64::from(1 << halving), many / 2));
    }
    for halving in 1..=halvings {
        all.push(by_noise(two(Any, 0, coarse / f64::from(1 << halving), some)));
    }
    all.push(plain(Kind::PathTracing, 0.0, profile.pick(4, 16, 512)));
    all.push(by_noise(plain(Kind::PathTracing, 0.0, profile.pick(8, 16, 128))));
    all
}

/// The view: over the floor, below the lamp.
pub fn camera([width, height]: [u32; 2]) -> Result<Camera, Box<dyn Error>> {
    let (eye, look_at) = (DVec3::new(2.78, 2.6, -5.2), DVec3::new(2.78, 1.87, 0.0));
    Ok(Camera::new(eye, look_at, DVec3::Y, 37.0, width, height)?)
}

/// A scene in which specular parts are absent.
pub fn diffuse(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    scene.materials.iter_mut().for_each(|material| material.specular = None);
    scene
}

/// The first pass that a way needs, and the seconds it took; `scenes` are the scene and the one without specular parts.
pub fn first_pass<'a>(
    way: Way,
    (scene, plain): (&'a Scene, &'a Scene),
    profile: Profile,
) -> Result<Option<(EnhancedRun<'a>, f64)>, Box<dyn Error>> {
    let (straight, rays) = rays(profile);
    let (scene, bounces, method) = match way.kind {
        Kind::Radiosity => (plain, SpecularBounces::None, Method::RaysAndEmitters { rays: straight }),
        // Direct light is drawn in the second pass: here it only feeds interreflection, over which its noise is averaged.
        Kind::TwoPasses(bounces) => (scene, bounces, Method::rays(straight)),
        Kind::RayTracing | Kind::PathTracing => return Ok(None),
    };
    let strategy = Strategy {
        store: Store::Sparse,
        unshot: 1e-4,
        verify: false,
        ..Strategy::new(Subdivision::EdgeLength(way.edge), method)
    };
    let clock = Instant::now();
    let first = run_enhanced(scene, &strategy, SpecularTransport { bounces, by: SpecularBy::Rays(rays) }, &mut ())?;
    Ok(Some((first, clock.elapsed().as_secs_f64())))
}

/// No light.
struct Dark;

impl Field for Dark {
    fn add(&self, _: u32, _: DVec3, _: f64, _: &mut [f64]) {}
}

/// What finding the elements to gather from took.
pub type Look = (Cost, f64);
/// Takes a round of a picture.
type Round<'r> = &'r dyn Fn(&mut Film);

/// Hands `work` what takes a round of a way's picture, and what came before the first.
pub fn with_pass(
    way: Way,
    (scene, first): (&Scene, Option<&EnhancedRun<'_>>),
    classes: PathClasses,
    camera: &Camera,
    work: &mut dyn FnMut(Look, Round<'_>),
) -> Result<(), Box<dyn Error>> {
    let nothing = (Cost::default(), 0.0);
    let Some(first) = first else {
        let occluders = Occluders::of_scene(scene);
        let stage = Stage::new(scene, &occluders);
        if way.kind == Kind::PathTracing {
            let tracer = PathTracer::new(&stage, classes);
            work(nothing, &|film| tracer.expose(camera, SEED, film));
        } else {
            let settings = TwoPassSettings { light_points: 1, gather: 0 };
            let pass = TwoPass::new(&stage, Stored::Apart([&Dark; 4]), settings, classes)?;
            work(nothing, &|film| pass.expose(camera, SEED, film));
        }
        return Ok(());
    };
    let geometry = &first.run.geometry;
    let stage = Stage::new(geometry.scene(), geometry.element_occluders());
    let fields = first.ways.each_ref().map(|h| -> Box<dyn Field + '_> {
        if way.kind == Kind::Radiosity {
            Box::new(FacetIrradiance(h))
        } else {
            Box::new(LinearIrradiance::new(geometry, h))
        }
    });
    let fields = fields.each_ref().map(|field| &**field);
    let settings = TwoPassSettings { light_points: u32::from(way.kind != Kind::Radiosity), gather: way.gather };
    let pass = TwoPass::new(&stage, Stored::Apart(fields), settings, classes)?;
    if way.gather == 0 {
        work(nothing, &|film| pass.expose(camera, SEED, film));
        return Ok(());
    }
    let clock = Instant::now();
    let control = Control::new(&stage, (geometry.elements(), &geometry.reflectance()), fields, OFF, SEED);
    let look = (control.cost, clock.elapsed().as_secs_f64());
    let pass = pass.controlled(&control);
    work(look, &|film| pass.expose(camera, SEED, film));
    Ok(())
}

/// A picture with what it took.
struct Reference {
    film: Film,
    seconds: f64,
}

/// The reference, kept beside the results: a line of JSON, then the sums of the film as doubles, little-endian.
fn reference(context: &Context, scene: &Scene) -> Result<Reference, Box<dyn Error>> {
    let folder = context.directory().parent().map_or_else(|| PathBuf::from("."), Path::to_path_buf).join(REFERENCES);
    let ([width, height], rounds) = (size(context.profile()), reference_rounds(context.profile()));
    let file = folder.join(format!("cornell-specular-{width}x{height}-{rounds}x{STREAMS}.film"));
    if let Some(known) = read_film(&file, [width, height], scene.bands(), rounds) {
        return Ok(known);
    }
    let occluders = Occluders::of_scene(scene);
    let stage = Stage::new(scene, &occluders);
    let (tracer, camera) = (PathTracer::new(&stage, PathClasses::ALL), camera([width, height])?);
    let mut film = Film::new(width, height, scene.bands());
    let clock = Instant::now();
    (0..rounds).for_each(|_| tracer.expose(&camera, REFERENCE_SEED, &mut film));
    let seconds = clock.elapsed().as_secs_f64();
    std::fs::create_dir_all(&folder)?;
    let mut bytes =
        format!("{}\n", serde_json::json!({ "rays": film.cost.rays, "samples": film.samples, "seconds": seconds }))
            .into_bytes();
    film.state().iter().flatten().for_each(|sum| bytes.extend(sum.to_le_bytes()));
    std::fs::write(&file, bytes)?;
    Ok(Reference { film, seconds })
}

/// What [`reference`] has kept, if it is there and whole.
fn read_film(file: &Path, [width, height]: [u32; 2], bands: usize, rounds: u64) -> Option<Reference> {
    let bytes = std::fs::read(file).ok()?;
    let end = bytes.iter().position(|byte| *byte == b'\n')?;
    let header: serde_json::Value = serde_json::from_slice(&bytes[..end]).ok()?;
    let sums: Vec<f64> =
        bytes[end + 1..].chunks_exact(8).filter_map(|b| Some(f64::from_le_bytes(b.try_into().ok()?))).collect();
    let cost = Cost { rays: header["rays"].as_u64()?, ..Cost::default() };
    let state: Vec<[f64; STREAMS]> = sums.chunks_exact(STREAMS).filter_map(|sums| sums.try_into().ok()).collect();
    if state.len() != width as usize * height as usize * bands {
        return None;
    }
    let film = Film::new(width, height, bands);
    let allotment = film.allotment().clone();
    Some(Reference {
        film: film.resume([rounds, header["samples"].as_u64()?], state, allotment, cost),
        seconds: header["seconds"].as_f64()?,
    })
}

/// Mean of values.
pub fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

/// Standard error of the mean of a picture; bands of a pixel may come from the same samples, so that their errors add up.
pub fn error_of_mean(film: &Film) -> f64 {
    let errors = film.standard_errors();
    let pixels = errors.chunks_exact(film.bands);
    let count = pixels.len() as f64;
    pixels.map(|bands| mean(bands.iter().copied()).powi(2)).sum::<f64>().sqrt() / count
}

/// A picture against the reference.
struct Compared {
    /// rms over pixels and bands without the reference's noise, and the standard error of its square.
    error: f64,
    error_of_square: f64,
    /// Signed error of the mean, and its standard error.
    mean_error: f64,
    mean_error_error: f64,
}

/// All relative to the mean of the reference.
fn compare(film: &Film, reference: &Film) -> Compared {
    let (means, known) = (film.means(), reference.means());
    let level = mean(known.iter().copied());
    let noise = reference.standard_errors();
    let square = |k: usize| ((means[k] - known[k]).powi(2) - noise[k].powi(2)) / (level * level);
    let bands = film.bands;
    let pixels: Vec<f64> = (0..means.len() / bands).map(|p| mean((bands * p..bands * (p + 1)).map(square))).collect();
    let (count, whole) = (pixels.len() as f64, mean(pixels.iter().copied()));
    let spread = pixels.iter().map(|p| (p - whole).powi(2)).sum::<f64>() / (count * (count - 1.0));
    Compared {
        error: whole.max(0.0).sqrt(),
        error_of_square: spread.sqrt(),
        mean_error: mean(means.iter().zip(&known).map(|(a, b)| a - b)) / level,
        mean_error_error: error_of_mean(film).hypot(error_of_mean(reference)) / level,
    }
}

/// Mean absolute difference of two pictures, relative to `level`.
fn difference(a: &[f64], b: &[f64], level: f64) -> f64 {
    mean(a.iter().zip(b).map(|(a, b)| (a - b).abs())) / level
}

/// A way's picture, its records, and its means after the rounds that all meshes of its kind have taken.
struct Taken {
    way: Way,
    film: Film,
    records: Vec<Record>,
    at_common: Vec<f64>,
}

/// Takes the picture of a way, and compares it after each doubling of the rounds.
fn take(
    way: Way,
    common: u64,
    scenes: (&Scene, &Scene),
    reference: &Film,
    profile: Profile,
) -> Result<Taken, Box<dyn Error>> {
    let camera = camera(size(profile))?;
    let first = first_pass(way, scenes, profile)?;
    let (cost, before) = first.as_ref().map_or((Cost::default(), 0.0), |(first, seconds)| (first.run.cost(), *seconds));
    let elements = first.as_ref().map_or(0, |(first, _)| first.run.geometry.elements().len());
    let new = if way.by_noise { Film::by_noise } else { Film::new };
    let mut film = new(reference.width, reference.height, reference.bands);
    let (mut records, mut at_common) = (Vec::new(), Vec::new());
    with_pass(
        way,
        (scenes.0, first.as_ref().map(|(first, _)| first)),
        PathClasses::ALL,
        &camera,
        &mut |look, round| {
            let (cost, mut seconds) = (cost + look.0, before + look.1);
            for target in (0..).map(|k| 1 << k).take_while(|rounds| *rounds <= way.rounds) {
                let clock = Instant::now();
                while film.rounds < target {
                    round(&mut film);
                }
                seconds += clock.elapsed().as_secs_f64();
                if film.rounds == common {
                    at_common = film.means();
                }
                let compared = compare(&film, reference);
                let samples = samples(&film);
                let record = Record::new(format!("{}/{samples}", way.line()))
                    .text("series", "pictures")
                    .text("method", way.method())
                    .text("style", way.style())
                    .text("line", way.line())
                    .float("edge", way.edge)
                    .int("elements", elements)
                    .text("complete", if way.is_complete() { "yes" } else { "no" })
                    .text("last", if 2 * target > way.rounds { "yes" } else { "no" })
                    .int("samples", samples)
                    .int("first_rays", cost.rays)
                    .int("rays", cost.rays + film.cost.rays)
                    .float("error", compared.error)
                    .float("error_of_square", compared.error_of_square)
                    .text("outcome", "done")
                    .seconds("first_time", before)
                    .seconds("time", seconds);
                let record = if film.rounds >= BELIEVED {
                    record
                        .float("noise", film.noise())
                        .float("mean_error", compared.mean_error)
                        .float("mean_error_error", compared.mean_error_error)
                } else {
                    record
                };
                records.push(record);
            }
        },
    )?;
    Ok(Taken { way, film, records, at_common })
}

/// A picture as it looks.
fn toned(film: &Film) -> Image {
    let exposure = Exposure::white_at(WHITE).toned(Tone::Filmic);
    let means = film.means();
    let colour = |bands: &[f64]| exposure.colour([0, 1, 2].map(|b| std::f64::consts::PI * bands[b]));
    let rgb = means.chunks_exact(film.bands).flat_map(colour).collect();
    Image { width: film.width, height: film.height, rgb }
}

/// The scale of all pictures of differences.
fn scale() -> Scale {
    Scale::signed(DIFFERENCES).expect("the ends are constants in order")
}

/// Differences from the reference, means over bands, in per cent of its mean.
fn differences(film: &Film, reference: &Film) -> Image {
    let (means, known) = (film.means(), reference.means());
    let level = mean(known.iter().copied());
    let pairs = means.chunks_exact(film.bands).zip(known.chunks_exact(film.bands));
    let values: Vec<f64> = pairs.map(|(a, b)| 100.0 * mean(a.iter().zip(b).map(|(a, b)| a - b)) / level).collect();
    scale().picture(film.width, film.height, &values)
}

/// Writes every picture and its differences, and all of them on one sheet.
fn pictures(context: &mut Context, taken: &[&Taken], reference: &Film) -> Result<(), Box<dyn Error>> {
    let factor = SHOWN.div_ceil(reference.width);
    let shown: Vec<[Image; 2]> = taken
        .iter()
        .map(|t| [toned(&t.film), differences(&t.film, reference)].map(|image| image.enlarged(factor)))
        .collect();
    let known = toned(reference).enlarged(factor);
    let legend = scale().legend(known.height, 5, "%");
    let mut write = |name: &str, caption: String, image: &Image| {
        context.picture(name, &caption, image.width, image.height, &image.rgb)
    };
    write("reference", format!("Reference: path tracing, {} samples a pixel", samples(reference)), &known)?;
    for (taken, [picture, difference]) in taken.iter().zip(&shown) {
        let (name, file) = (taken.way.method(), taken.way.method().replace(", ", "-").replace(' ', "-"));
        write(&file, format!("{name}, {} samples a pixel", samples(&taken.film)), picture)?;
        let image = Image::sheet(&[vec![difference, &legend]], 8);
        write(&format!("{file}-difference"), format!("{name} less the reference, in % of its mean"), &image)?;
    }
    // Two rows of pictures, each over its differences, with a legend at their end.
    let (left, right) = shown.split_at(shown.len().div_ceil(2));
    let mut rows: Vec<Vec<&Image>> = Vec::new();
    for half in [left, right] {
        rows.push(half.iter().map(|[picture, _]| picture).collect());
        rows.push(half.iter().map(|[_, difference]| difference).chain([&legend]).collect());
    }
    let names: Vec<String> = taken.iter().map(|t| t.way.method()).collect();
    let caption =
        format!("Pictures and, below each, differences from the reference in % of its mean: {}", names.join("; "));
    write("sheet", caption, &Image::sheet(&rows, 8))
}

/// Samples that a pixel has taken in the mean.
fn samples(film: &Film) -> u64 {
    film.samples_of_a_pixel().round() as u64
}

impl Experiment for TwoPasses {
    fn name(&self) -> &'static str {
        "10-two-pass"
    }

    fn question(&self) -> &str {
        "What do radiosity alone, ray tracing alone, two passes and path tracing miss of a scene with mirror, glass and gloss, and what do rays and time buy?"
    }

    fn expects(&self) -> &str {
        "Radiosity alone shows no specular surface, ray tracing alone no interreflection; two passes lack what their bounces leave out: without bounces light by way of \
         mirrors and glass, with one that through glass. Path tracing lacks nothing, and its noise falls like N^(−1/2)."
    }

    fn settings(&self, profile: Profile) -> serde_json::Value {
        let ways = ways(profile).into_iter().map(|way| format!("{} × {}", way.line(), way.rounds));
        serde_json::json!({
            "picture": size(profile), "reference_rounds": reference_rounds(profile), "rays": rays(profile), "gathered": GATHERED,
            "ways": ways.collect::<Vec<_>>(), "classes": classes::settings(profile), "seeds": [SEED, REFERENCE_SEED]
        })
    }

    fn slack(&self, column: &str) -> f64 {
        // Differences of nearly equal numbers: their last digits depend on the processor.
        if matches!(column, "mean_error" | "mesh_bound" | "sum_difference" | "error") { 1e-9 } else { 0.0 }
    }

    fn run(&self, context: &mut Context) -> Result<(), Box<dyn Error>> {
        let profile = context.profile();
        let ways = ways(profile);
        context.begin(ways.len() + 3);
        let scene = cornell_specular();
        let plain = diffuse(&scene);
        let reference = reference(context, &scene)?;
        context.tick("reference");
        let edge = ways.iter().map(|way| way.edge).fold(0.0, f64::max);
        let coarse = Strategy::new(Subdivision::EdgeLength(edge), Method::rays(1));
        left_out(context, "Cornell box of mirrors", &coarse, &Geometry::of_strategy(&scene, &coarse)?, None);
        let level = mean(reference.film.means().into_iter());
        let path_tracing =
            Way { kind: Kind::PathTracing, gather: 0, edge: 0.0, by_noise: false, rounds: reference.film.rounds };
        context.record(
            Record::new("reference")
                .text("series", "reference")
                .text("line", path_tracing.line())
                .text("style", path_tracing.style())
                .int("samples", samples(&reference.film))
                .int("rays", reference.film.cost.rays)
                .float("noise", reference.film.noise())
                .float("mean_error_error", error_of_mean(&reference.film) / level)
                .float("level", level)
                .text("outcome", "done")
                .seconds("time", reference.seconds),
        );
        let mut taken: Vec<Taken> = Vec::new();
        for way in ways {
            // Pictures on all meshes of a kind have at least as many rounds as that on the coarsest, of which they are a part.
            let coarsest = taken.iter().find(|other| other.way.method() == way.method());
            let common = coarsest.map_or(way.rounds, |other| other.way.rounds);
            let mut new = take(way, common, (&scene, &plain), &reference.film, profile)?;
            let coarser = taken.last().filter(|other| other.way.method() == way.method());
            let bound = match (way.kind, coarser) {
                (Kind::PathTracing, _) => Some(0.0),
                (_, coarser) => coarser.map(|other| difference(&new.at_common, &other.at_common, level)),
            };
            for record in std::mem::take(&mut new.records) {
                context.record(match bound {
                    Some(bound) => record.float("mesh_bound", bound),
                    None => record,
                });
            }
            context.tick(way.line());
            taken.push(new);
        }
        // Of every method the picture on its finest mesh.
        let finest = |k: &usize| taken.get(k + 1).is_none_or(|next| next.way.method() != taken[*k].way.method());
        let shown: Vec<&Taken> = (0..taken.len()).filter(finest).map(|k| &taken[k]).collect();
        pictures(context, &shown, &reference.film)?;
        // Allotment changes no class.
        let shown: Vec<Way> = shown.iter().map(|t| t.way).filter(|way| !way.by_noise).collect();
        drop(taken);
        for record in classes::by_class(&shown, (&scene, &plain), profile)? {
            context.record(record);
        }
        context.tick("classes of paths");
        for record in classes::floor_cells(profile)? {
            context.record(record);
        }
        context.tick("cells of the floor");
        Ok(())
    }

    fn plots(&self, tables: &Tables) -> Vec<Figure> {
        let panel = |x: &'static str, unit: &str| {
            let line = |(name, rows): (String, Vec<Row<'_>>)| {
                let style = rows.first().map_or("", |r| r.text("style"));
                let dash = match name {
                    _ if name.contains("by noise") => Some(Dash::Dotted),
                    _ if name.contains("gathered") => Some(Dash::Dashed),
                    _ => None,
                };
                let at = |r: &Row<'_>| (value(r, x), r.number("error"));
                let series = Series::new(&*name, style).rows(rows, at);
                match dash {
                    Some(dash) => series.dash(dash),
                    None => series,
                }
            };
            let lines = group_by(tables.select_eq("series", "pictures"), "line").into_iter().map(line);
            Panel::new(Axis::log(x, unit), Axis::log("error", "share of the mean"))
                .all_series(lines.collect::<Vec<_>>())
                .level(TARGET, "2 %")
        };
        vec![
            Figure::new("work-precision", "Error against rays and time")
                .caption("rms over pixels against the reference, whose noise is subtracted; one mark each doubling of the rounds; by noise: more samples where there is more noise. Rays and time include the first pass.")
                .panel(panel("rays", ""))
                .panel(panel("time", "s"))
                .shared_y(),
            classes::figure(tables),
        ]
    }

    fn reading(&self, tables: &Tables) -> Vec<String> {
        let mut reading: Vec<String> = at_target(tables).into_iter().chain(missed(tables)).collect();
        reading.extend(means(tables));
        reading.extend(classes::reading(tables));
        reading
    }
}

/// Where a line of two passes meets the target: rays and seconds, on the straight line in log–log between two marks. Errors below what the reference can tell do not count.
fn meets(rows: &[Row<'_>]) -> Option<[f64; 2]> {
    let marks: Vec<[f64; 3]> = rows.iter().map(|r| [r.number("error"), r.number("rays"), r.seconds("time")]).collect();
    let pair = marks.windows(2).find(|pair| pair[0][0] >= TARGET && pair[1][0] <= TARGET && pair[1][0] > 0.0)?;
    let part = (TARGET / pair[0][0]).ln() / (pair[1][0] / pair[0][0]).ln();
    Some([1, 2].map(|k| pair[0][k] * (pair[1][k] / pair[0][k]).powf(part)))
}

/// Rays and seconds of a line at the target: where it meets it, or, of path tracing that has not, from its noise, which is all its error and falls like N^(−1/2).
fn takes(rows: &[Row<'_>]) -> Option<[f64; 2]> {
    let last = rows.last()?;
    let factor = (last.number("noise") / TARGET).powi(2);
    let extrapolated = || Some([factor * last.number("rays"), factor * last.seconds("time")]);
    meets(rows).or_else(|| if last.text("style") == "path tracing" && factor > 1.0 { extrapolated() } else { None })
}

/// Rays and time at the target, of the path tracer and of two passes, each with the same samples in all pixels and with samples by noise.
fn at_target(tables: &Tables) -> Vec<String> {
    let lines = group_by(tables.select(|r| r.text("series") == "pictures" && r.text("complete") == "yes"), "line");
    let best = |style: &str, by_noise: bool| {
        let of = lines.iter().filter(|(name, _)| name.starts_with(style) && name.contains("by noise") == by_noise);
        of.filter_map(|(name, rows)| Some((name, takes(rows)?))).min_by(|a, b| a.1[0].total_cmp(&b.1[0]))
    };
    let amounts = |name: &str, [rays, seconds]: [f64; 2]| {
        let million = numbers::significant(rays / 1e6, 3);
        format!("{name} takes {million} million rays and {}", numbers::seconds(seconds))
    };
    let Some((traced_by, traced)) = best("path tracing", false) else { return Vec::new() };
    let shares = |name: &str, two: [f64; 2], of: [f64; 2]| {
        let share = |k: usize| numbers::significant(two[k] / of[k], 2);
        format!("{}, a share of {} and {}", amounts(name, two), share(0), share(1))
    };
    let mut reading = Vec::new();
    for by_noise in [false, true] {
        let found = match best("two passes", by_noise) {
            Some((name, two)) => shares(name, two, traced),
            None => "no two passes get there".to_owned(),
        };
        let target = numbers::percent(TARGET);
        reading.push(format!("At an error of {target} over pixels {}; {found}.", amounts(traced_by, traced)));
    }
    if let (Some((name, traced)), Some((other, two))) = (best("path tracing", true), best("two passes", true)) {
        reading.push(format!("There {}; {} of that.", amounts(name, traced), shares(other, two, traced)));
    }
    reading
}

/// What the incomplete methods end with.
fn missed(tables: &Tables) -> Vec<String> {
    let last =
        tables.select(|r| r.text("series") == "pictures" && r.text("last") == "yes" && r.text("complete") == "no");
    let part = |r: &Row<'_>| format!("{}: {}", r.text("method"), numbers::percent(r.number("error")));
    let parts: Vec<String> = last.iter().map(part).collect();
    if parts.is_empty() { parts } else { vec![format!("Errors of what misses paths: {}.", parts.join("; "))] }
}

/// Whether mean errors are within what is stated.
fn means(tables: &Tables) -> Vec<String> {
    let stated = tables.select(|r| {
        r.text("complete") == "yes"
            && r.text("last") == "yes"
            && r.number("mean_error").is_finite()
            && r.number("mesh_bound").is_finite()
    });
    let part = |r: &Row<'_>| {
        let [error, of_mean, bound] = ["mean_error", "mean_error_error", "mesh_bound"].map(|c| 100.0 * r.number(c));
        let within = if error.abs() <= 3.0 * of_mean + bound { "within" } else { "beyond" };
        format!("{}: {error:+.3} % ± {of_mean:.3} %, mesh {bound:.3} %, {within}", r.text("line"))
    };
    let parts: Vec<String> = stated.iter().map(part).collect();
    if parts.is_empty() {
        return parts;
    }
    vec![format!("Mean errors against three combined standard errors and the mesh's bound: {}.", parts.join("; "))]
}
