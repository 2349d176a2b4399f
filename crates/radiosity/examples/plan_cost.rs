//! One planned run of a scene, for a profiler that counts instructions:
//!
//! ```text
//! cargo build --release -p radiosity --example plan_cost
//! RAYON_NUM_THREADS=1 valgrind --tool=callgrind target/release/examples/plan_cost tower 2000
//! callgrind_annotate --inclusive=yes callgrind.out.* | grep -E 'PROGRAM|Plan::'
//! ```
//!
//! The plan is `Plan::new`, `Plan::store`, `Plan::systems` and `Plan::left_out_of`; it should take at most 1 % of the instructions of the run.

use std::process::ExitCode;

use radiosity::plan::Omissions;
use radiosity::{Phase, Plan, Strategy, default_method, run_planned};
use radiosity_gallery::boxes::{material, unit_cube};
use radiosity_gallery::rooms::{grey_room, tower, two_rooms};
use radiosity_gallery::{city, crowded_room, mirror_cornell};
use radiosity_geometry::mesh::Subdivision;
use radiosity_geometry::{Occluders, Scene};

fn scene(name: &str) -> Option<Scene> {
    Some(match name {
        "grey" => grey_room([3.0; 3]),
        "cube" => unit_cube(material("grey", 0.5, 1.0)),
        "two-rooms" => two_rooms([true, false]),
        "tower" => tower(&[true, false, true, false]),
        "high-tower" => tower(&[true; 40]),
        "cornell" => mirror_cornell(),
        "furnished" => crowded_room(16, 1),
        "crowded" => crowded_room(200, 1),
        "city" => city(3, 2, 1),
        _ => return None,
    })
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [name, elements] = &arguments[..] else { return ExitCode::from(2) };
    let (Some(scene), Ok(elements)) = (scene(name), elements.parse::<f64>()) else { return ExitCode::from(2) };
    let method = default_method(elements as usize, Occluders::blocking(&scene).len());
    let cells = Subdivision::EdgeLength((scene.area() / elements).sqrt());
    let strategy = Strategy { omit: Omissions::ALL, ..Strategy::new(cells, method) };
    let plan = Plan::new(&scene, &strategy);
    let geometry = plan.mesh(&scene, &strategy).expect("a mesh of a sound scene");
    let strategy = Strategy { store: plan.store(&geometry, &strategy).store, ..strategy };
    let run = run_planned(&plan, geometry, Phase::default(), &strategy, &mut ()).expect("a sound scene");
    println!(
        "{} elements, {}, {}: {}",
        run.geometry.elements().len(),
        method.name(),
        strategy.store.name(),
        run.solution.outcome
    );
    ExitCode::SUCCESS
}
