//! Classes of paths, each alone, and light that a mirror throws: a part of experiment 10.
//!
//! Every class of paths is rendered by itself with the seed of the whole. A method leaves out of a sample what does not count and draws the same numbers, so that classes add
//! up to the whole to rounding; their means, against those of the path tracer, say what each method misses.
//!
//! In the Cornell box whose only specular surface is a mirror ([`mirror_cornell`]), the irradiance of the floor by way of the mirror (LSDE and LDSDE) after the first pass is
//! compared with paths from points of the same 8 × 8 cells.

use std::error::Error;

use radiosity::{GridValues, Method, SpecularBy, SpecularTransport, Store, Strategy, run_enhanced};
use radiosity_core::BandValues;
use radiosity_experiments::{Profile, Record, Row, Tables, group_by};
use radiosity_form_factors::extended::SpecularBounces;
use radiosity_gallery::{CORNELL_FLOOR, mirror_cornell};
use radiosity_geometry::mesh::Subdivision;
use radiosity_geometry::{Occluders, Scene};
use radiosity_plot::numbers;
use radiosity_plot::{Axis, Figure, Panel, Series};
use radiosity_render::{Film, PathClass, PathClasses, PathTracer, Stage};

use crate::common::GRID;
use crate::two_pass::{Kind, SEED, Way, camera, error_of_mean, first_pass, mean, size, with_pass};

/// Pixels of pictures of one class: half as many along each side.
fn class_size(profile: Profile) -> [u32; 2] {
    size(profile).map(|pixels| pixels / 2)
}

/// Rounds of pictures of one class; of paths and of final gathers, whose samples take more rays, half as many.
fn class_rounds(profile: Profile) -> u64 {
    profile.pick(2, 4, 16)
}

/// Rounds of every cell of the floor, its longest edge of an element, and rays of its rows.
fn floor(profile: Profile) -> (u64, f64, u32) {
    profile.pick((8, 1.4, 256), (256, 0.7, 1024), (8192, 0.35, 4096))
}

/// What decides the counts.
pub fn settings(profile: Profile) -> serde_json::Value {
    serde_json::json!({ "size": class_size(profile), "rounds": class_rounds(profile), "floor": floor(profile) })
}

/// Means of pictures of each class alone, of those methods that know classes, and how far their sum is from the whole.
pub fn by_class(ways: &[Way], scenes: (&Scene, &Scene), profile: Profile) -> Result<Vec<Record>, Box<dyn Error>> {
    let [width, height] = class_size(profile);
    let camera = camera([width, height])?;
    let mut records = Vec::new();
    for way in ways.iter().filter(|way| way.kind != Kind::Radiosity) {
        let first = first_pass(*way, scenes, profile)?;
        let rounds = class_rounds(profile) / if way.gather > 0 { 2 } else { 1 };
        let picture = |classes: PathClasses| -> Result<Film, Box<dyn Error>> {
            let mut film = Film::new(width, height, scenes.0.bands());
            let scene = (scenes.0, first.as_ref().map(|(first, _)| first));
            with_pass(*way, scene, classes, &camera, &mut |_, round| (0..rounds).for_each(|_| round(&mut film)))?;
            Ok(film)
        };
        let whole = picture(PathClasses::ALL)?;
        let level = mean(whole.means().into_iter());
        let mut left = whole.means();
        let record = |class: &str, film: &Film| {
            Record::new(format!("classes/{}/{class}", way.method()))
                .text("series", "classes")
                .text("method", way.method())
                .text("class", class)
                .float("mean", mean(film.means().into_iter()))
                .float("mean_error_error", error_of_mean(film))
        };
        for class in PathClass::ALL {
            let film = picture(PathClasses::NONE.with(class))?;
            left.iter_mut().zip(film.means()).for_each(|(left, part)| *left -= part);
            records.push(record(class.name(), &film));
        }
        let most = left.iter().map(|left| left.abs()).fold(0.0, f64::max);
        records.push(record("whole", &whole).float("sum_difference", most / level));
    }
    Ok(records)
}

/// Irradiance of the cells of the floor by way of the mirror, after the first pass and by paths.
pub fn floor_cells(profile: Profile) -> Result<Vec<Record>, Box<dyn Error>> {
    let (rounds, edge, rays) = floor(profile);
    let scene = mirror_cornell();
    let strategy = Strategy {
        store: Store::Sparse,
        verify: false,
        ..Strategy::new(Subdivision::EdgeLength(edge), Method::RaysAndEmitters { rays })
    };
    let first = run_enhanced(
        &scene,
        &strategy,
        SpecularTransport { bounces: SpecularBounces::Any, by: SpecularBy::Rays(rays) },
        &mut (),
    )?;
    let [_, by_way, _, more] = &first.ways;
    let sum = by_way.values().iter().zip(more.values()).map(|(a, b)| a + b).collect();
    let by_way = BandValues::new(sum, by_way.len());
    let cells = GridValues::means(&first.run.geometry, &by_way, GRID)?.on(&[CORNELL_FLOOR as u32]);

    let occluders = Occluders::of_scene(&scene);
    let stage = Stage::new(&scene, &occluders);
    let classes = ["LSDE", "LDSDE"].into_iter().filter_map(PathClass::named);
    let tracer = PathTracer::new(&stage, classes.fold(PathClasses::NONE, PathClasses::with));
    let corners = scene.surfaces[CORNELL_FLOOR].pieces[0].vertices();
    let (origin, along, across) = (corners[0], corners[1] - corners[0], corners[3] - corners[0]);
    let mut film = Film::new(GRID, GRID, scene.bands());
    for _ in 0..rounds {
        film.expose(SEED, |[i, j], numbers, value| {
            let u = numbers.draw();
            let [x, y] = [(f64::from(i) + u[0]) / f64::from(GRID), (f64::from(j) + u[1]) / f64::from(GRID)];
            let normal = stage.scene().surfaces[CORNELL_FLOOR].pieces[0].normal();
            tracer.irradiance(origin + along * x + across * y, normal, numbers, value)
        });
    }
    let (paths, errors) = (film.means(), film.standard_errors());
    // Where the block stands there is no light.
    let record = |(c, &(i, j)): (usize, &(u32, u32))| {
        let at = (j * GRID + i) as usize * film.bands;
        let of = |values: &[f64]| mean(values[at..at + film.bands].iter().copied());
        let (known, error) = (of(&paths), of(&errors));
        let found = mean((0..film.bands).map(|b| cells.values.band(b)[c]));
        let record = Record::new(format!("floor/{i}/{j}"))
            .text("series", "floor")
            .float("mean", found)
            .float("paths", known)
            .float("error", found / known - 1.0)
            .float("noise", error / known)
            .text("outcome", "done");
        (known > 0.0).then_some(record)
    };
    Ok(cells.indices.iter().enumerate().filter_map(record).collect())
}

/// Means of classes by method.
pub fn figure(tables: &Tables) -> Figure {
    // A gather changes no class but those that the first pass has missed; the table has them.
    let shown = |r: &Row<'_>| r.text("class") != "whole" && !r.text("method").contains("gathered");
    let rows = tables.select(|r| r.text("series") == "classes" && shown(r));
    let level = whole(tables).map_or(1.0, |r| r.number("mean"));
    let series = group_by(rows, "method").into_iter().map(|(method, rows)| {
        let values = rows.iter().enumerate().map(|(k, r)| (k as f64, r.number("mean") / level));
        Series::new(&*method, &*method).values(values.collect::<Vec<_>>())
    });
    let classes = PathClass::ALL.map(PathClass::name);
    Figure::new("classes", "Classes of paths, each rendered alone")
        .caption("Share of the path tracer's mean; two passes look irradiance up. Without bounces they lack what arrives by way of specular surfaces.")
        .panel(Panel::bars(classes, Axis::linear("mean", "share of the whole").from_zero()).all_series(series.collect::<Vec<_>>()))
}

/// The path tracer's whole picture.
fn whole(tables: &Tables) -> Option<Row<'_>> {
    let rows = tables.select(|r| r.text("series") == "classes" && r.text("class") == "whole");
    rows.into_iter().find(|r| r.text("method") == "path tracing")
}

/// What the classes and the cells say.
pub fn reading(tables: &Tables) -> Vec<String> {
    let mut reading = Vec::new();
    let sums = tables.select(|r| r.text("series") == "classes" && r.text("class") == "whole");
    let worst = sums.iter().map(|r| r.number("sum_difference")).fold(0.0, f64::max);
    if let Some(whole) = whole(tables) {
        let level = whole.number("mean");
        let known = tables.select(|r| r.text("series") == "classes" && r.text("method") == "path tracing");
        let parts =
            group_by(tables.select_eq("series", "classes"), "method").into_iter().filter_map(|(method, rows)| {
                let lacks = |row: &Row<'_>| {
                    let other = known.iter().find(|k| k.text("class") == row.text("class"))?;
                    let missing = other.number("mean") - row.number("mean");
                    let error = other.number("mean_error_error").hypot(row.number("mean_error_error"));
                    let tells = row.text("class") != "whole" && missing > 3.0 * error && missing > 0.001 * level;
                    tells.then(|| format!("{} of {}", numbers::percent(missing / level), row.text("class")))
                };
                let lacking: Vec<String> = rows.iter().filter_map(lacks).collect();
                (!lacking.is_empty()).then(|| format!("{method} lacks {}", lacking.join(", ")))
            });
        let parts: Vec<String> = parts.collect();
        let none = || "no method lacks a class".to_owned();
        let lacking = if parts.is_empty() { none() } else { parts.join("; ") };
        reading.push(format!(
            "Classes rendered alone add up to the whole within {worst:.0e} of the mean in every pixel. In shares of the mean, {lacking}."
        ));
    }
    let cells = tables.select_eq("series", "floor");
    if !cells.is_empty() {
        let [found, paths, noise] = ["mean", "paths", "noise"].map(|column| {
            let values = cells.iter().map(|r| r.number(column));
            values.collect::<Vec<f64>>()
        });
        let level = mean(paths.iter().copied());
        let square = |of: &dyn Fn(usize) -> f64| mean((0..cells.len()).map(|c| of(c).powi(2))) / (level * level);
        let differences = square(&|c| found[c] - paths[c]);
        let of_paths = square(&|c| noise[c] * paths[c]);
        let within = cells.iter().filter(|r| r.number("error").abs() <= 0.02 + 3.0 * r.number("noise")).count();
        reading.push(format!(
            "What a mirror throws on the floor is after the first pass off by {} rms over {} cells, relative to their mean and without the noise of the paths ({}); {within} of \
             them are within 2 % of their own and three standard errors.",
            numbers::percent((differences - of_paths).max(0.0).sqrt()),
            cells.len(),
            numbers::percent(of_paths.sqrt()),
        ));
    }
    reading
}
