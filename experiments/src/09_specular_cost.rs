//! What radiances into directions cost, against two passes.
//!
//! Question: where does specular radiosity, n elements × K directions, become impractical? Theory: what a mirror shows is blurred over bins of √(2π/K) and over elements, so that
//! a picture errs like K^(−1/2) where it is smooth and like K^(−1/4) over edges, once elements are as small as bins; irradiance averages over bins and suffers far less.
//! Unknowns grow like n·K and what a glossy surface does like K², while two passes store no direction: their cost is that of rays. Measured in a closed room 3 × 2 × 2.5 with
//! a block and one shining wall: a perfect mirror or a glossy lobe (Phong, n = 40) under a ceiling that shines all over, which is kind to bins, and the mirror under a lamp of a seventeenth of its
//! area. Irradiance over 4 × 4 cells a face, against exact pairs through a hole into the mirrored room, in the glossy room against path tracing; a picture of the shining wall
//! against path tracing, of the mirror through the hole, rms over pixels relative to their mean. All runs of specular radiosity cast
//! as many rays, as long as that is one a bin at least, so that bins and elements are what differs; their noise is where curves over K level off. Two passes sample lights and gather, with 0, 1 or any number of specular bounces in the
//! first pass (a flat wall is not met twice in a row, so one bounce is as good as any here), and get finer in rays of both passes alike;
//! their pictures of the glossy wall have sparks next to the ceiling, which lead its error. Read: error at equal time, and at equal memory. Not shown: bins that adapt; further cameras, which cost two passes another second
//! pass and specular radiosity nothing but look-ups.

use std::error::Error;
use std::time::Instant;

use glam::DVec3;
use radiosity::{
    Geometry, GridValues, Method, SpecularBy, SpecularRadiosity, SpecularTransport, Store, Strategy, run_enhanced,
    run_specular_radiosity,
};
use radiosity_core::BandValues;
use radiosity_experiments::{Context, Experiment, Profile, Record, SeriesOfRows, Tables, group_by};
use radiosity_form_factors::extended::SpecularBounces;
use radiosity_gallery::MirrorRoom;
use radiosity_gallery::mirror::opened;
use radiosity_geometry::mesh::{MeshSettings, Subdivision};
use radiosity_geometry::{Occluders, Scene, Specular};
use radiosity_plot::fit::PowerLaw;
use radiosity_plot::{Axis, Dash, Figure, Panel, Series, numbers};
use radiosity_render::numbers::Numbers;
use radiosity_render::{
    Camera, Exposure, FacetIrradiance, Field, Film, PathClasses, PathTracer, Stage, Stored, TwoPass, TwoPassSettings,
};
use rayon::prelude::*;

use crate::common::{counts, exponent, left_out};

/// The experiment.
pub struct SpecularCost;

/// Cells of the report grid along an edge of a face.
const CELLS: u32 = 4;
/// Name of the method in tables and legends.
const DIRECTIONS: &str = "specular radiosity";
/// Two passes: name, bounces of the first.
const TWO_PASS: [(&str, SpecularBounces); 3] = [
    ("two passes, 0 bounces", SpecularBounces::None),
    ("two passes, 1 bounce", SpecularBounces::AtMost(1)),
    ("two passes, any bounces", SpecularBounces::Any),
];
const UNSHOT: f64 = 1e-4;
const SEED: u64 = 1;
/// Scenes: under a shining ceiling, but for the last.
const SCENES: [&str; 3] = ["mirror", "gloss", "mirror, lamp"];

/// Elements along an edge of a face, and bins along an edge of their square: K is that squared.
fn meshes(profile: Profile) -> Vec<(u32, Vec<u32>)> {
    profile.pick(
        vec![(2, vec![2, 8])],
        vec![(4, vec![4, 16]), (8, vec![8, 32])],
        vec![(4, vec![4, 8, 16, 32, 64]), (8, vec![4, 8, 16, 32, 64]), (16, vec![8, 16, 32, 64])],
    )
}

/// Rays along the edge of the square of all directions of an element, times elements along an edge: the same number of rays for all whose bins are not more.
fn rays_and_elements(profile: Profile) -> u32 {
    profile.pick(64, 256, 512)
}

/// Of two passes: elements along an edge of a face; rays of every row, and rounds of the picture.
fn passes(profile: Profile) -> (u32, Vec<(u32, u32)>) {
    profile.pick((2, vec![(64, 1)]), (8, vec![(64, 1), (512, 4)]), (8, vec![(64, 1), (256, 2), (1024, 8), (4096, 20)]))
}

/// Pixels along an edge of the picture, rounds of its reference, paths of a cell of the glossy room, and elements along an edge of a face of the mirrored room.
fn reference(profile: Profile) -> (u32, u32, u64, u32) {
    profile.pick((12, 4, 64, 4), (32, 24, 1024, 8), (64, 64, 8192, 12))
}

/// Rounds of a picture of look-ups: noise of edges is all there is.
const LOOK_UPS: u32 = 4;

/// The lamp and the ceiling of a [`MirrorRoom`].
const LAMP: usize = 1;
const CEILING: usize = 6;

/// A room with one shining wall.
fn room(name: &str) -> Scene {
    let mut scene = MirrorRoom::default().scene();
    if name == "gloss" {
        let wall = scene.surfaces[MirrorRoom::MIRROR].material;
        scene.materials[wall].specular = Some(Specular::Phong { reflectance: vec![0.9], exponent: 40.0 });
    }
    let (light, wall) = (scene.surfaces[LAMP].material, scene.surfaces[CEILING].material);
    // What shines reflects as well, so that its irradiance is asked for and known.
    scene.materials[light].reflectance = scene.materials[wall].reflectance.clone();
    if name != "mirror, lamp" {
        // The ceiling takes the material of the lamp, which becomes a board.
        (scene.surfaces[LAMP].material, scene.surfaces[CEILING].material) = (wall, light);
        scene.materials[light].emission = vec![1.0];
    }
    scene
}

/// Whether light is thrown by a perfect mirror, which is a hole into its image.
fn has_hole(name: &str) -> bool {
    name != "gloss"
}

/// Looks at the shining wall from the other one, a little downwards, past the lamp.
fn camera(side: u32) -> Result<Camera, Box<dyn Error>> {
    Ok(Camera::new(DVec3::new(2.9, 1.1, 1.9), DVec3::new(0.0, 1.0, 0.6), DVec3::Z, 50.0, side, side)?)
}

/// What is known of a scene.
struct Known {
    /// Irradiance over cells of all surfaces but the shining wall, and its own error.
    irradiance: (GridValues, f64),
    /// Radiance of every pixel, and the rms of its noise relative to the mean.
    picture: (Vec<f64>, f64),
}

impl Known {
    fn of(name: &str, scene: &Scene, profile: Profile) -> Result<Self, Box<dyn Error>> {
        let (side, rounds, paths, k) = reference(profile);
        let irradiance = if has_hole(name) { through_the_hole(scene, k)? } else { by_paths(scene, paths)? };
        // Through the hole all light can be drawn, and noise is less.
        let seen = if has_hole(name) { opened(scene, MirrorRoom::MIRROR) } else { scene.clone() };
        let occluders = Occluders::of_scene(&seen);
        let stage = Stage::new(&seen, &occluders);
        let tracer = PathTracer::new(&stage, PathClasses::ALL);
        let (mut film, camera) = (Film::new(side, side, 1), camera(side)?);
        (0..rounds).for_each(|_| tracer.expose(&camera, SEED, &mut film));
        Ok(Self { irradiance, picture: (film.means(), film.noise()) })
    }

    /// rms error of irradiance over cells.
    fn error(&self, geometry: &Geometry<'_>, irradiance: &BandValues) -> Result<f64, Box<dyn Error>> {
        Ok(diffuse(GridValues::means(geometry, irradiance, CELLS)?).error(&self.irradiance.0).rms)
    }

    /// rms difference of a picture over pixels, relative to their mean.
    fn picture_error(&self, film: &Film) -> f64 {
        let (truth, pixels) = (&self.picture.0, self.picture.0.len() as f64);
        let square: f64 = film.means().iter().zip(truth).map(|(a, b)| (a - b) * (a - b)).sum();
        (square / pixels).sqrt() / (truth.iter().sum::<f64>() / pixels)
    }
}

/// Without the shining wall, which does nothing with irradiance.
fn diffuse(grid: GridValues) -> GridValues {
    let surfaces = grid.surfaces.iter().copied().max().unwrap_or(0);
    let others: Vec<u32> = (0..=surfaces).filter(|&s| s != MirrorRoom::MIRROR as u32).collect();
    grid.on(&others)
}

/// Exact pairs in the room whose mirror is a hole, on `k` × `k` elements a face; the error is the difference from those of a coarser mesh that nests in the cells too, which is more.
fn through_the_hole(scene: &Scene, k: u32) -> Result<(GridValues, f64), Box<dyn Error>> {
    let hole = opened(scene, MirrorRoom::MIRROR);
    // Surfaces of the room follow its mirror, which is surface 0; then come those of its image.
    let near: Vec<u32> = (0..scene.surfaces.len() as u32 - 1).collect();
    let cells = |k: u32| -> Result<GridValues, Box<dyn Error>> {
        let plain = Strategy::new(Subdivision::Uniform(k), Method::ANALYTIC);
        let run = radiosity::run(&hole, &Strategy { store: Store::Packed, ..plain }, &mut ())?;
        Ok(GridValues::means(&run.geometry, &run.solution.irradiance, CELLS)?.on(&near))
    };
    let mut fine = cells(k)?;
    let coarser = if k > 2 * CELLS { k - CELLS } else { k / 2 };
    let error = cells(coarser)?.error(&fine).rms;
    fine.surfaces.iter_mut().for_each(|s| *s += 1);
    Ok((fine, error))
}

/// Path tracing to points of every cell; the error is that of the mean of two halves, half their difference.
fn by_paths(scene: &Scene, paths: u64) -> Result<(GridValues, f64), Box<dyn Error>> {
    let elements = Subdivision::Uniform(CELLS);
    let geometry = Geometry::new(scene, &MeshSettings { elements, patches: None, contacts: true })?;
    let occluders = Occluders::of_scene(scene);
    let stage = Stage::new(scene, &occluders);
    let tracer = PathTracer::new(&stage, PathClasses::ALL);
    let half = |which: u64| -> Result<GridValues, Box<dyn Error>> {
        let mean = |e: usize| {
            let (polygon, mut value) = (&geometry.elements().polygons(e)[0], [0.0]);
            for k in 0..paths / 2 {
                let mut numbers = Numbers::of_pixel(SEED + which, e as u64, k);
                let u = numbers.draw();
                tracer.irradiance(polygon.sample(u[0], u[1]), polygon.normal(), &mut numbers, &mut value);
            }
            value[0] / (paths / 2) as f64
        };
        let means = (0..geometry.elements().len()).into_par_iter().map(mean).collect();
        Ok(diffuse(GridValues::means(&geometry, &BandValues::single(means), CELLS)?))
    };
    let (one, other) = (half(0)?, half(1)?);
    let error = 0.5 * one.error(&other).rms;
    let mut mean = one;
    mean.values.values_mut().iter_mut().zip(other.values.values()).for_each(|(a, b)| *a = 0.5 * (*a + b));
    Ok((mean, error))
}

/// A run as a line of the tables.
fn line(key: String, scene: &str, method: &str, known: &Known) -> Record {
    Record::new(key)
        .text("scene", scene)
        .text("method", method)
        .float("reference_error", known.irradiance.1)
        .float("picture_noise", known.picture.1)
}

/// Specular radiosity on `k` × `k` elements a face with `edge` × `edge` bins.
fn directions(
    scene: (&str, &Scene, &Known),
    (k, edge): (u32, u32),
    profile: Profile,
) -> Result<(Record, Film), Box<dyn Error>> {
    let (name, scene, known) = scene;
    let clock = Instant::now();
    let elements = Subdivision::Uniform(k);
    let geometry = Geometry::new(scene, &MeshSettings { elements, patches: None, contacts: true })?;
    let meshing = clock.elapsed().as_secs_f64();
    let rays = (rays_and_elements(profile) / k).div_ceil(edge);
    let settings = SpecularRadiosity { unshot: UNSHOT, seed: SEED, ..SpecularRadiosity::new(edge, rays) };
    let found = run_specular_radiosity(&geometry, &settings)?;
    let time = meshing + found.seconds();
    let side = reference(profile).0;
    let stage = Stage::new(scene, geometry.element_occluders());
    let (camera, mut film) = (camera(side)?, Film::new(side, side, 1));
    let clock = Instant::now();
    (0..LOOK_UPS).for_each(|_| found.expose(&stage, &camera, SEED, &mut film));
    let record = line(format!("{name}/{DIRECTIONS}/{k}/{}", found.size.directions), name, DIRECTIONS, known);
    let record = counts(record, &found.cost())
        .text("mesh", format!("{k} × {k} elements a face"))
        .text("outcome", found.outcome)
        .int("elements", found.size.elements)
        .int("directions", found.size.directions)
        .int("unknowns", found.size.unknowns)
        .int("steps", found.steps)
        .int("bytes", found.held_bytes)
        .float("error", known.error(&geometry, &found.irradiance)?)
        .float("picture_error", known.picture_error(&film))
        .seconds("form_factor_time", found.form_factors.time.as_secs_f64())
        .seconds("time", time)
        .seconds("picture_time", time + clock.elapsed().as_secs_f64());
    Ok((record, film))
}

/// Two passes with `rays` a row in the first and `rounds` of the picture in the second.
fn two_pass(
    scene: (&str, &Scene, &Known),
    (method, bounces): (&str, SpecularBounces),
    (rays, rounds): (u32, u32),
    profile: Profile,
) -> Result<(Record, Film), Box<dyn Error>> {
    let (name, scene, known) = scene;
    let plain = Strategy::new(Subdivision::Uniform(passes(profile).0), Method::RaysAndEmitters { rays });
    let strategy = Strategy { store: Store::Sparse, unshot: UNSHOT, verify: false, seed: SEED, ..plain };
    let found = run_enhanced(scene, &strategy, SpecularTransport { bounces, by: SpecularBy::Rays(rays) }, &mut ())?;
    let (run, time) = (&found.run, found.run.seconds());
    let side = reference(profile).0;
    let stage = Stage::new(scene, run.geometry.element_occluders());
    let fields = found.ways.each_ref().map(FacetIrradiance);
    let stored = Stored::Apart(fields.each_ref().map(|field| field as &dyn Field));
    let settings = TwoPassSettings { light_points: 1, gather: 4 };
    let (camera, mut film) = (camera(side)?, Film::new(side, side, 1));
    let clock = Instant::now();
    let second = TwoPass::new(&stage, stored, settings, PathClasses::ALL)?;
    (0..rounds).for_each(|_| second.expose(&camera, SEED, &mut film));
    let unknowns = run.geometry.elements().len();
    let record = line(format!("{name}/{method}/{rays}"), name, method, known);
    let record = counts(record, &(run.cost() + film.cost))
        .text("outcome", run.solution.outcome)
        .int("elements", unknowns)
        .int("unknowns", unknowns)
        .int("steps", run.solution.steps)
        .int("bytes", run.stored_bytes)
        .float("error", known.error(&run.geometry, &run.solution.irradiance)?)
        .float("picture_error", known.picture_error(&film))
        .seconds("form_factor_time", run.form_factors.time.as_secs_f64())
        .seconds("time", time)
        .seconds("picture_time", time + clock.elapsed().as_secs_f64());
    Ok((record, film))
}

/// Writes a grey picture.
fn show(context: &mut Context, name: &str, caption: &str, side: u32, radiance: &[f64]) -> Result<(), Box<dyn Error>> {
    const WHITE: f64 = 1.2;
    let colour = |l: &f64| Exposure::white_at(WHITE).colour([std::f64::consts::PI * l; 3]);
    let rgb: Vec<u8> = radiance.iter().flat_map(colour).collect();
    context.picture(name, caption, side, side, &rgb)
}

impl Experiment for SpecularCost {
    fn name(&self) -> &'static str {
        "09-specular-cost"
    }

    fn question(&self) -> &str {
        "Radiances of n elements into K directions, so that mirrors and gloss are part of the system: where does that become impractical, against two passes?"
    }

    fn expects(&self) -> &str {
        "Irradiance needs few directions, since it averages over them. Pictures err like K^(−1/4) to K^(−1/2) and only as long as elements shrink with bins, so that n·K \
         grows like the inverse fourth power of the error or faster; two passes store no direction and show mirrors sharply at any error."
    }

    fn settings(&self, profile: Profile) -> serde_json::Value {
        serde_json::json!({
            "elements_and_bins": meshes(profile), "rays_and_elements": rays_and_elements(profile), "two_pass": passes(profile),
            "reference": reference(profile), "cells": CELLS, "unshot": UNSHOT, "seed": SEED
        })
    }

    fn run(&self, context: &mut Context) -> Result<(), Box<dyn Error>> {
        let profile = context.profile();
        let (meshes, side) = (meshes(profile), reference(profile).0);
        let sizes: usize = meshes.iter().map(|(_, edges)| edges.len()).sum();
        context.begin(SCENES.len() * (1 + sizes + TWO_PASS.len() * passes(profile).1.len()));
        for name in SCENES {
            let (scene, slug) = (room(name), name.replace(", ", "-"));
            let known = Known::of(name, &scene, profile)?;
            show(context, &format!("{slug}-reference"), &format!("{name}: path tracing"), side, &known.picture.0)?;
            context.tick(format!("{name}, references"));
            let plain = Strategy::new(Subdivision::Uniform(meshes[0].0), Method::rays(1));
            left_out(context, name, &plain, &Geometry::of_strategy(&scene, &plain)?, None);
            let of = (name, &scene, &known);
            for (k, edges) in &meshes {
                for &edge in edges {
                    let (record, film) = directions(of, (*k, edge), profile)?;
                    context.record(record);
                    let (file, bins) = (format!("{slug}-{k}-{}", edge * edge), edge * edge);
                    let caption = format!("{name}: {DIRECTIONS}, {k} × {k} elements a face, {bins} directions");
                    if edge == edges[0] || Some(&edge) == edges.last() {
                        show(context, &file, &caption, side, &film.means())?;
                    }
                    context.tick(caption);
                }
            }
            for method in TWO_PASS {
                for &pass in &passes(profile).1 {
                    let (record, film) = two_pass(of, method, pass, profile)?;
                    context.record(record);
                    let caption = format!("{name}: {}, {} rays a row", method.0, pass.0);
                    if method.1 == SpecularBounces::Any && Some(&pass) == passes(profile).1.last() {
                        show(context, &format!("{slug}-two-pass"), &caption, side, &film.means())?;
                    }
                    context.tick(caption);
                }
            }
        }
        Ok(())
    }

    fn plots(&self, tables: &Tables) -> Vec<Figure> {
        // Specular radiosity has a line a mesh, two passes one each.
        let series = |scene: &'static str, x: &'static str, y: &'static str, two: bool| {
            let of = move |row: &radiosity_experiments::Row<'_>, column: &str| {
                if column.ends_with("time") { row.seconds(column) } else { row.number(column) }
            };
            let rows = tables.select(|r| r.text("scene") == scene && r.text("method") == DIRECTIONS);
            let dashes = [Dash::Dotted, Dash::Dashed, Dash::Solid];
            let meshes = group_by(rows, "mesh").into_iter().zip(dashes.into_iter().cycle());
            let lines = meshes.map(move |((mesh, rows), dash)| {
                Series::new(format!("{DIRECTIONS}, {mesh}"), DIRECTIONS).rows(rows, |r| (of(r, x), of(r, y))).dash(dash)
            });
            let rows = tables.select(|r| two && r.text("scene") == scene && r.text("method") != DIRECTIONS);
            let others = group_by(rows, "method")
                .into_iter()
                .map(move |(method, rows)| Series::new(&*method, &*method).rows(rows, |r| (of(r, x), of(r, y))));
            lines.chain(others).collect::<Vec<_>>()
        };
        let figure = |name: &str, title: &str, x: (&'static str, Axis), y: (&'static str, Axis), two: bool| {
            let panel = |scene: &'static str| {
                Panel::new(x.1.clone(), y.1.clone()).title(scene).all_series(series(scene, x.0, y.0, two))
            };
            Figure::new(name, title).panels(SCENES.map(panel)).shared_y()
        };
        let time = || Axis::log("time", "s");
        let share = |what: &str| Axis::log(what, "share of the mean");
        vec![
            figure(
                "picture-time",
                "Error of a picture against the time of all passes",
                ("picture_time", time()),
                ("picture_error", share("error over pixels")),
                true,
            )
            .caption("Marks of specular radiosity are numbers of directions, of two passes numbers of rays. The noise of the reference is in the tables."),
            figure(
                "irradiance-time",
                "Error of irradiance against time",
                ("time", time()),
                ("error", share("error over cells")),
                true,
            )
            .caption("rms over 4 × 4 cells a face. Marks of specular radiosity cast the same number of rays until bins outnumber them: lines stand upright until then."),
            figure(
                "picture-unknowns",
                "Error of a picture against unknowns",
                ("unknowns", Axis::log("unknowns", "")),
                ("picture_error", share("error over pixels")),
                true,
            )
            .caption("Two passes know one number an element, and rays do the rest."),
            figure(
                "picture-memory",
                "Error of a picture against memory",
                ("bytes", Axis::log("memory of form factors and radiances", "bytes")),
                ("picture_error", share("error over pixels")),
                true,
            )
            .caption("Of specular radiosity what rays see, what the surface does and two iterates; of two passes the stored form factors."),
            figure(
                "directions",
                "Error of a picture against directions",
                ("directions", Axis::log("directions K", "")),
                ("picture_error", share("error over pixels")),
                false,
            )
            .caption("A line levels off where its elements are what blurs."),
        ]
    }

    fn reading(&self, tables: &Tables) -> Vec<String> {
        let mut reading = Vec::new();
        for scene in SCENES {
            let of = |method: &str| tables.select(|r| r.text("scene") == scene && r.text("method") == method);
            let rows = of(DIRECTIONS);
            let least = |rows: &[radiosity_experiments::Row<'_>], column: &str| {
                rows.iter().map(|r| r.number(column)).fold(f64::INFINITY, f64::min)
            };
            let two = of(TWO_PASS[2].0);
            // The law of the best mesh at every K, and how much would be needed for a picture as good as the other method's.
            let best = |column: &str| rows.iter().min_by(|a, b| a.number(column).total_cmp(&b.number(column)));
            let (Some(best), Some(finest)) = (best("picture_error"), two.last()) else { continue };
            let mut envelope: Vec<(f64, f64)> = Vec::new();
            for row in &rows {
                let (n, error) = (row.number("unknowns"), row.number("picture_error"));
                if !rows.iter().any(|r| r.number("unknowns") <= n && r.number("picture_error") < error) {
                    envelope.push((n, error));
                }
            }
            let law = PowerLaw::through(envelope.iter().copied());
            // A line in logarithms, continued.
            let needed = law.map(|law| ((finest.number("picture_error").ln() - law.log_factor) / law.slope).exp());
            reading.push(format!(
                "{scene}: the best picture of specular radiosity errs by {} with {} unknowns ({} directions), {} and {}; two passes err by {} after {}. \
                 At best the error falls like unknowns^{}; as good a picture as that of two passes would need about {} of them.",
                numbers::percent(best.number("picture_error")),
                numbers::grouped(best.number("unknowns") as i64),
                numbers::grouped(best.number("directions") as i64),
                numbers::bytes(best.number("bytes")),
                numbers::seconds(best.seconds("picture_time")),
                numbers::percent(finest.number("picture_error")),
                numbers::seconds(finest.seconds("picture_time")),
                exponent(law),
                needed.filter(|n| n.is_finite()).map_or("?".to_owned(), |n| numbers::significant(n, 1)),
            ));
            // The fewest directions with which irradiance is within a quarter of the best of its mesh.
            let floor = least(&rows, "error");
            let enough = rows.iter().filter(|r| r.number("error") <= 1.25 * floor);
            if let Some(first) = enough.min_by(|a, b| a.number("directions").total_cmp(&b.number("directions"))) {
                let as_good = two.iter().filter(|r| r.number("error") <= first.number("error"));
                let other = as_good.map(|r| r.seconds("time")).fold(f64::INFINITY, f64::min);
                let other = if other.is_finite() {
                    format!("after {}", numbers::seconds(other))
                } else {
                    "not at all".to_owned()
                };
                reading.push(format!(
                    "{scene}: irradiance is within a quarter of its best, at {}, from {} directions on and in {}; two passes get there {other}.",
                    numbers::percent(first.number("error")),
                    numbers::grouped(first.number("directions") as i64),
                    numbers::seconds(first.seconds("time")),
                ));
            }
        }
        reading
    }
}
