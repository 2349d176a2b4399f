//! What solving again after a change saves against a run from nothing.

use std::error::Error;

use glam::DVec3;
use radiosity::{Solved, Strategy};
use radiosity_experiments::{Context, Record, Row, Tables};
use radiosity_geometry::{Material, Polygon, Scene};
use radiosity_plot::numbers;
use radiosity_plot::{Axis, Figure, Panel, Series};

use crate::common::described;

/// Changes of the Cornell box: of light, of paint, of one face, of a block of five faces.
pub const CHANGES: [&str; 5] = [
    "lamp dimmed to a half",
    "short block's top glows",
    "left wall painted white",
    "ceiling strip lowered",
    "short block shifted",
];

/// The scene after the change of that name.
fn after(scene: &Scene, change: &str) -> Scene {
    let mut scene = scene.clone();
    let named = |scene: &Scene, name: &str| -> Vec<usize> {
        (0..scene.surfaces.len()).filter(|&s| scene.surfaces[s].name.starts_with(name)).collect()
    };
    let material = |scene: &Scene, name: &str| scene.surfaces[named(scene, name)[0]].material;
    match change {
        "lamp dimmed to a half" => {
            let lamp = material(&scene, "light");
            scene.materials[lamp].emission.iter_mut().for_each(|e| *e *= 0.5);
        }
        "short block's top glows" => {
            // A hundredth of the lamp's emission.
            let (top, lamp) = (named(&scene, "short_top")[0], material(&scene, "light"));
            let emission = scene.materials[lamp].emission.iter().map(|e| 0.01 * e).collect();
            scene.materials.push(Material { emission, ..scene.materials[scene.surfaces[top].material].clone() });
            scene.surfaces[top].material = scene.materials.len() - 1;
        }
        "left wall painted white" => {
            let (wall, white) = (named(&scene, "left")[0], material(&scene, "floor"));
            scene.surfaces[wall].material = white;
        }
        "ceiling strip lowered" => shift(&mut scene, "ceiling_2", DVec3::new(0.0, -20.0, 0.0)),
        _ => shift(&mut scene, "short", DVec3::new(-20.0, 0.0, 15.0)),
    }
    scene
}

/// Moves the surfaces whose name begins with `name`.
fn shift(scene: &mut Scene, name: &str, by: DVec3) {
    let moved = scene.surfaces.iter_mut().filter(|surface| surface.name.starts_with(name));
    for piece in moved.flat_map(|surface| &mut surface.pieces) {
        let corners: Vec<DVec3> = piece.vertices().iter().map(|v| *v + by).collect();
        *piece = Polygon::new(&corners).expect("a polygon stays one where it is moved");
    }
}

/// Solves `scene`, then each changed scene from its answer and from nothing: a record a change.
pub fn run(context: &mut Context, scene: &Scene, strategy: &Strategy) -> Result<(), Box<dyn Error>> {
    let strategy = Strategy { verify: false, ..strategy.clone() };
    let before = Solved::new(scene, &strategy, &mut ())?;
    for change in CHANGES {
        let after = after(scene, change);
        let (mut again, mut full) = (Vec::new(), Vec::new());
        let (first, saving) = before.resolve(&after, &mut ())?;
        let cold = Solved::new(&after, &strategy, &mut ())?;
        again.push(first.run().seconds());
        full.push(cold.run().seconds());
        // Short runs: the smallest of several repeats best on a shared machine.
        for _ in 0..2 {
            again.push(before.resolve(&after, &mut ())?.0.run().seconds());
            full.push(Solved::new(&after, &strategy, &mut ())?.run().seconds());
        }
        let record: Record = described(format!("change/{change}"), &strategy)
            .text("kind", "change")
            .int("elements", first.run().geometry.elements().len())
            .text("outcome", first.run().solution.outcome)
            .int("form_factors", saving.form_factors)
            .int("of_form_factors", cold.run().form_factors.cost.form_factors)
            .int("steps", saving.steps)
            .int("of_steps", cold.run().solution.steps)
            .repetitions("time", &again)
            .repetitions("of_time", &full);
        context.record(record);
        context.tick(change);
    }
    Ok(())
}

/// What was done after each change, as shares of what a run from nothing does.
pub fn figure(tables: &Tables) -> Figure {
    let rows = tables.select(|r| r.text("kind") == "change");
    let share = |label: &str, colour: &str, share: &dyn Fn(&Row<'_>) -> f64| {
        let heights: Vec<(f64, f64)> = rows.iter().enumerate().map(|(k, r)| (k as f64, share(r))).collect();
        Series::new(label, colour).values(heights)
    };
    let series = [
        share("form factors", "analytic", &|r| r.number("form_factors") / r.number("of_form_factors")),
        share("steps", "cg", &|r| r.number("steps") / r.number("of_steps")),
        share("time", "dense", &|r| r.seconds("time") / r.seconds("of_time")),
    ];
    let names = ["dim lamp", "glow", "paint", "ceiling", "block"];
    let panel = Panel::bars(names, Axis::linear("share of a run from nothing", "")).all_series(series);
    Figure::new("changes", "What is left to do after a change")
        .caption("Changes of the Cornell box, in the order of the reading: two of emission, one of paint, one face moved, five faces of a block moved.")
        .panel(panel)
}

/// One sentence a change: what was computed of what a run from nothing computes.
pub fn reading(tables: &Tables) -> Vec<String> {
    let rows = tables.select(|r| r.text("kind") == "change");
    let parts = rows.iter().map(|r| {
        format!(
            "{}: {} of {} form factors, {} of {} steps, {} of {}",
            r.text("run").trim_start_matches("change/"),
            r.text("form_factors"),
            r.text("of_form_factors"),
            r.text("steps"),
            r.text("of_steps"),
            numbers::seconds(r.seconds("time")),
            numbers::seconds(r.seconds("of_time"))
        )
    });
    let parts: Vec<String> = parts.collect();
    if parts.is_empty() {
        Vec::new()
    } else {
        vec![format!("After a change, from the old answer and of a run from nothing: {}.", parts.join("; "))]
    }
}
