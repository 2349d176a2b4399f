//! `radiosity inspect`: what is in a scene, what will be left out and why, and what a solution would cost.

use radiosity::plan::Anyway;
use radiosity::{Plan, Size, Strategy, forecast};
use radiosity_geometry::{Occluders, Scene};
use serde_json::json;

use crate::args::InspectArgs;
use crate::solve::{admitted_mesh, mesh_settings, sizes, strategy};
use crate::{Failure, Verdict, memory, output, plan, scene};

/// Runs the command.
pub fn run(args: &InspectArgs) -> Result<Verdict, Failure> {
    let imported = scene::with_materials(&args.common)?;
    let scene = &imported.scene;
    let mesh = mesh_settings(&args.mesh);
    let program = memory::program();
    let (omit, asked) = (plan::omissions(&args.plan), plan::asked(&args.plan, scene)?);
    let view = plan::view(&args.plan, scene)?.map(|view| view.camera);
    let strategy = |sizes: (usize, usize)| Strategy {
        omit,
        asked: asked.clone(),
        view: view.clone(),
        ..strategy(sizes, mesh, &args.estimator, &args.common)
    };
    let cells = Size::before_meshing(scene, &mesh)?.elements as usize;
    let before = strategy((cells, Occluders::blocking(scene).len()));
    admitted_mesh(scene, &before)?;
    let mut plan = Plan::new(scene, &before);
    let mut geometry = plan.mesh(scene, &before)?;
    let mut strategy = strategy(sizes(&geometry));
    if strategy.method != before.method {
        // Contacts made more elements than was thought, or fewer.
        plan = Plan::new(scene, &strategy);
        geometry = plan.mesh(scene, &strategy)?;
    }
    let savings = plan.left_out(&geometry, &strategy);
    let choice = plan.store(&geometry, &strategy);
    strategy.store = choice.store;
    let prediction = plan.size(&geometry).predict(&strategy);
    let (lo, hi) = scene.bounds();
    let closed = imported.report.closed();
    let anyway = plan.anyway(&geometry, &strategy, None);
    let nothing = (emitters(scene) == 0).then(|| "everything: nothing emits, the answer is 0".to_owned());
    let left_out: Vec<String> = anyway.iter().map(Anyway::to_string).chain(nothing.clone()).collect();
    let forecasted = if args.forecast {
        let asked = Strategy { forecast: output::FORECAST, ..strategy.clone() };
        Some(forecast(scene, &asked).map_err(memory::explained)?.0)
    } else {
        None
    };
    let object = json!({
        "faces": scene.surfaces.len(),
        "area": scene.area(),
        "bounds": [lo.to_array(), hi.to_array()],
        "closed": closed,
        "blocking_polygons": geometry.blockers().len(),
        "emitters": emitters(scene),
        "emitted_power": emitted_power(scene),
        "largest_reflectance": largest_reflectance(scene),
        "materials": scene.materials.iter().map(|m| json!({
            "name": m.name, "reflectance": m.reflectance, "emission": m.emission,
        })).collect::<Vec<_>>(),
        "file": output::import(&imported.report),
        "left_out": left_out,
        "left_out_anyway": plan::anyway_json(&anyway),
        "plan": { "off": plan.off.map(|off| off.to_string()), "left_out": plan::json(&savings) },
        "mesh": {
            "elements": prediction.elements,
            "patches": prediction.patches,
            "covered_elements": geometry.mesh().elements.len() - geometry.elements().len(),
        },
        "predicted": {
            "method": output::method(strategy.method),
            "form": strategy.shape.name(),
            "solver": strategy.solver,
            "store": strategy.store.name(),
            "store_reason": choice.reason.to_string(),
            "form_factors": prediction.form_factors,
            "source_evaluations": prediction.source_evaluations,
            "rays": prediction.rays,
            "hemicube_pixels": prediction.hemicube_pixels,
            "stored_bytes": prediction.stored_bytes,
            "mesh_bytes": prediction.mesh_bytes,
            "peak_bytes": prediction.peak_bytes + program,
        },
        "forecast": forecasted.as_ref().map(|f| output::forecast(f, args.unshot)),
    });
    let r = &imported.report;
    let mut lines = vec![
        format!(
            "{} faces ({} triangles, {} quadrilaterals, {} polygons of up to {} corners), area {:.6}",
            r.faces,
            r.triangles,
            r.quads,
            r.polygons,
            r.most_corners,
            scene.area()
        ),
        format!(
            "{}: {} open edges, {} between faces turned against each other",
            if closed { "closed" } else { "open" },
            r.open_edges,
            r.turned_edges
        ),
        format!("{} emitting faces; largest reflectance {:.4}", emitters(scene), largest_reflectance(scene)),
        format!(
            "defects: {} faces without area, {} concave, {} non-planar, {} duplicates ({} two-sided sheets), {} line elements",
            r.zero_area_dropped,
            r.concave_split,
            r.non_planar_split,
            r.duplicate_faces,
            r.two_sided_sheets,
            r.line_elements
        ),
        format!(
            "mesh: {} elements, {} patches; predicted {} form factors by {} in {}, {} of memory in all",
            prediction.elements,
            prediction.patches,
            prediction.form_factors,
            strategy.method.name(),
            output::bytes(prediction.stored_bytes),
            output::bytes(prediction.peak_bytes + program)
        ),
    ];
    lines.push(plan::store_line(choice.store, choice.reason));
    lines.extend(forecasted.as_ref().map(|f| output::forecast_line(f, args.unshot)));
    lines.extend(plan::anyway_line(&anyway));
    lines.extend(nothing.map(|what| format!("left out: {what}")));
    lines.extend(plan::lines(&savings));
    output::print(&args.common, &object, &lines);
    Ok(Verdict::Done)
}

fn emitters(scene: &Scene) -> usize {
    scene.surfaces.iter().filter(|s| scene.materials[s.material].emission.iter().any(|&e| e > 0.0)).count()
}

/// Σ A E of every band.
fn emitted_power(scene: &Scene) -> Vec<f64> {
    let power = |b: usize| scene.surfaces.iter().map(|s| s.area() * scene.materials[s.material].emission[b]).sum();
    (0..scene.bands()).map(power).collect()
}

fn largest_reflectance(scene: &Scene) -> f64 {
    let used = scene.surfaces.iter().flat_map(|s| &scene.materials[s.material].reflectance);
    used.copied().fold(0.0, f64::max)
}
