//! What the program says of what it leaves out, and that it does.

mod common;

use std::fmt::Write;

use common::Folder;
use radiosity_gallery::rooms::{black_floor, one_room, two_rooms};
use radiosity_geometry::Scene;
use serde_json::Value;

/// A scene as an OBJ file with its MTL; the faces of a room are a group, numbered from 0.
fn with_scene(folder: &Folder, scene: &Scene) {
    let (mut obj, mut mtl) = ("mtllib scene.mtl\n".to_owned(), String::new());
    for (k, surface) in scene.surfaces.iter().enumerate() {
        writeln!(obj, "g room{}\nusemtl {}", k / 6, scene.materials[surface.material].name).unwrap();
        for v in surface.pieces[0].vertices() {
            writeln!(obj, "v {} {} {}", v.x, v.y, v.z).unwrap();
        }
        writeln!(obj, "f -4 -3 -2 -1").unwrap();
    }
    for material in &scene.materials {
        let text = |values: &[f64], by: f64| values.iter().map(|v| format!(" {}", v / by)).collect::<String>();
        let (kd, ke) = (text(&material.reflectance, 1.0), text(&material.emission, std::f64::consts::PI));
        writeln!(mtl, "newmtl {}\nKd{kd}\nKe{ke}", material.name).unwrap();
    }
    folder.write("scene.obj", &obj);
    folder.write("scene.mtl", &mtl);
}

fn object(folder: &Folder, arguments: &str) -> Value {
    let ran = folder.run(arguments);
    // Walls back to back are warned of.
    assert_eq!(ran.code, 0, "{arguments}: {}", ran.stderr);
    serde_json::from_str(&ran.stdout).unwrap()
}

fn table(folder: &Folder, name: &str) -> Vec<Vec<f64>> {
    let text = folder.read(name);
    text.lines().skip(1).map(|line| line.split(',').map(|word| word.parse().unwrap()).collect()).collect()
}

#[test]
fn a_dark_room_is_left_out_and_reported_with_what_that_saves() {
    let folder = Folder::new("plan_dark_room");
    with_scene(&folder, &two_rooms([true, false]));
    let solve = "solve scene.obj --subdivide 3 --unshot 1e-14 --json";
    let some = object(&folder, &format!("{solve} --output some.csv"));
    let all = object(&folder, &format!("{solve} --keep-everything --output all.csv"));
    let left = some["left_out"].as_array().unwrap();
    // Those of the dark room, mirror images in the other, and both: of 9 elements a face the 4 of a quarter are computed, on three faces.
    assert_eq!(left.len(), 3);
    assert!(left[0]["reason"].as_str().unwrap().contains("no light") && left[0]["predicted"]["unknowns"] == 54);
    assert!(left[1]["reason"].as_str().unwrap().contains("mirror") && left[1]["what"] == "42 of 54 rows");
    assert_eq!(left[2]["predicted"], left[2]["measured"]);
    let computed = |object: &Value| object["form_factors"]["counts"]["form_factors"].as_u64().unwrap();
    assert_eq!(left[2]["measured"]["form_factors"], computed(&all) - computed(&some));
    assert_eq!((&all["left_out"], &all["plan_off"]), (&Value::Array(vec![]), &"everything is to be kept".into()));
    assert_eq!(some["plan_off"], Value::Null);
    // The same lines; 1e-12 of the largest irradiance.
    let (some, all) = (table(&folder, "some.csv"), table(&folder, "all.csv"));
    assert_eq!((some.len(), all.len()), (108, 108));
    let largest = all.iter().flat_map(|row| &row[10..13]).copied().fold(0.0, f64::max);
    let differences = some.iter().flatten().zip(all.iter().flatten()).map(|(a, b)| (a - b).abs());
    assert!(differences.fold(0.0, f64::max) < 1e-12 * largest);
}

#[test]
fn inspect_tells_each_omission_with_its_reason_and_counts() {
    let folder = Folder::new("plan_inspect");
    with_scene(&folder, &two_rooms([true, true]));
    let inspected = folder.run("inspect scene.obj --subdivide 3");
    // 54 unknowns each: walls of one room face those of the other across the walls between.
    let line = inspected.stdout.lines().find(|line| line.contains("between 2 rooms")).unwrap();
    assert!(line.starts_with("left out: ") && line.contains("closed walls part them") && line.contains("form factors"));
    let kept = object(&folder, "inspect scene.obj --keep-everything --json");
    assert_eq!(kept["plan"]["left_out"], Value::Array(vec![]));
    let planned = object(&folder, "solve scene.obj --dry-run --json");
    assert!(planned["left_out"][0]["predicted"]["form_factors"].as_u64().unwrap() > 0);
    let ran = folder.run("solve scene.obj --tolerance 0.3 --quiet --json");
    let refined: Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(refined["plan_off"], "refinement looks at all elements");
}

#[test]
fn only_what_is_asked_for_is_written_and_what_merely_blocks_has_no_elements() {
    let folder = Folder::new("plan_ask");
    with_scene(&folder, &black_floor());
    let solve = "solve scene.obj --subdivide 3 --unshot 1e-14 --json --output";
    let some = object(&folder, &format!("{solve} some.csv --ask 0,1,2,3,5"));
    object(&folder, &format!("{solve} all.csv"));
    assert_eq!(some["elements"], 45);
    assert!(some["left_out"][0]["what"].as_str().unwrap().contains("2 faces, not meshed"));
    assert!(some["power"]["absorbed"][0].as_f64().unwrap() > 0.0);
    let (some, mut all) = (table(&folder, "some.csv"), table(&folder, "all.csv"));
    all.retain(|row| row[0] != 4.0 && row[0] != 6.0);
    assert_eq!((some.len(), all.len()), (45, 45));
    let differences = some.iter().flatten().zip(all.iter().flatten()).map(|(a, b)| (a - b).abs());
    assert!(differences.fold(0.0, f64::max) < 1e-11);
    // A group by its name, cells of a grid, and a name that is none.
    object(&folder, &format!("{solve} grid.csv --report-grid 2 --ask room1"));
    assert_eq!(table(&folder, "grid.csv").len(), 4);
    object(&folder, &format!("{solve} flat.ply --ask 0,1,2,3,5"));
    object(&folder, &format!("{solve} shaded.ply --shading linear --ask 0"));
    let ran = folder.run("solve scene.obj --ask nobody");
    assert_eq!(ran.code, 2);
    assert!(ran.stderr.contains("--ask nobody") && ran.stderr.contains("0 to 6"));
}

/// Walls of two rooms of which one is lit: 2,400 unknowns of 4,800.
#[test]
fn memory_is_asked_for_what_the_plan_keeps() {
    let folder = Folder::new("plan_memory");
    with_scene(&folder, &two_rooms([true, false]));
    let solve = "solve scene.obj --subdivide 20 --store packed --memory 60M";
    let predicted = object(&folder, &format!("{solve} --dry-run --json"))["predicted"]["peak_bytes"].as_f64().unwrap();
    let taken = object(&folder, &format!("{solve} --json --output some.csv"))["peak_bytes"].as_f64().unwrap();
    assert!((0.9..=1.1).contains(&(predicted / taken)), "{predicted} bytes predicted, {taken} taken");
    let refused = folder.run(&format!("{solve} --keep-everything"));
    assert!(refused.code == 2 && refused.stderr.contains("of memory"), "{}", refused.stderr);
}

#[test]
fn a_store_that_is_not_asked_for_is_chosen_and_said_why() {
    let folder = Folder::new("plan_store");
    with_scene(&folder, &one_room());
    let solve = |options: &str, name: &str| {
        object(&folder, &format!("solve scene.obj --subdivide 8 --unshot 1e-14 {options} --json --output {name}.csv"))
    };
    let (chosen, dense) = (solve("", "chosen"), solve("--store dense", "dense"));
    assert_eq!((&chosen["store"], &dense["store"]), (&"packed".into(), &"dense".into()));
    assert!(chosen["store_reason"].as_str().unwrap().contains("kept once") && dense["store_reason"].is_null());
    assert!(chosen["stored_bytes"].as_u64() < dense["stored_bytes"].as_u64());
    let (chosen, dense) = (table(&folder, "chosen.csv"), table(&folder, "dense.csv"));
    let largest = dense.iter().flat_map(|row| &row[10..13]).copied().fold(0.0, f64::max);
    let differences = chosen.iter().flatten().zip(dense.iter().flatten()).map(|(a, b)| (a - b).abs());
    assert!(differences.fold(0.0, f64::max) < 1e-12 * largest);
    assert_eq!(solve("--rays 16", "rays")["store"], "sparse");
    let inspected = object(&folder, "inspect scene.obj --subdivide 8 --json");
    assert_eq!(inspected["predicted"]["store"], "packed");
}

fn errors(object: &Value) -> Vec<(f64, f64)> {
    let bounded = object["left_out"].as_array().unwrap().iter().map(|left| &left["bounded"]).filter(|b| !b.is_null());
    bounded.map(|b| (b["before"].as_f64().unwrap(), b["after"].as_f64().unwrap())).collect()
}

#[test]
fn pairs_and_bounces_within_an_error_are_left_out_with_their_bounds() {
    let folder = Folder::new("plan_bounded");
    with_scene(&folder, &black_floor());
    let solve = "solve scene.obj --subdivide 6 --json --output";
    let all = object(&folder, &format!("{solve} all.csv --unshot 1e-12"));
    let some = object(&folder, &format!("{solve} some.csv --thin-error 0.1 --bounce-error 0.01"));
    let found = errors(&some);
    assert_eq!(found.len(), 2);
    assert!(found[0].0 <= 0.1 && found[0].1 < 0.1 && found[1].0 == 0.01);
    let sum = found.iter().map(|found| found.1).sum::<f64>();
    assert_eq!(some["left_out_error"].as_f64(), Some(sum));
    let computed = |object: &Value| object["form_factors"]["counts"]["form_factors"].as_u64().unwrap();
    let dropped =
        some["left_out"].as_array().unwrap().iter().find_map(|left| left["measured"]["form factors"].as_u64());
    let foreseen = object(&folder, &format!("{solve} no.csv --thin-error 0.1 --bounce-error 0.01 --dry-run"));
    let first = &foreseen["left_out"].as_array().unwrap()[foreseen["left_out"].as_array().unwrap().len() - 2];
    assert_eq!((first["predicted"]["form factors"].as_u64(), &first["measured"]), (dropped, &Value::Null));
    assert!(dropped.unwrap() > 0 && computed(&all) == computed(&some) + dropped.unwrap());
    // Column 10 is the irradiance of the first band; areas are in column 6.
    let (some, all) = (table(&folder, "some.csv"), table(&folder, "all.csv"));
    let area: f64 = all.iter().map(|row| row[6]).sum();
    let square: f64 =
        some.iter().zip(&all).flat_map(|(a, b)| (10..13).map(move |k| b[6] * (a[k] - b[k]).powi(2))).sum();
    let mean = all.iter().flat_map(|row| row[10..13].iter().map(|h| row[6] * h)).sum::<f64>() / (3.0 * area);
    assert!((square / (3.0 * area)).sqrt() / mean <= sum);
    let kept = object(&folder, &format!("{solve} kept.csv --thin-error 0.1 --bounce-error 0.01 --keep-everything"));
    assert!(errors(&kept).is_empty() && kept["left_out_error"] == 0.0);
    for (more, instead) in [
        ("--method ray-cast", "analytic"),
        ("--patch-subdivide 2", "leave out the patches"),
        ("--store on-demand", "packed"),
    ] {
        let refused = folder.run(&format!("solve scene.obj --subdivide 4 --thin-error 0.1 {more}"));
        assert!(refused.code == 2 && refused.stderr.contains(instead), "{more}: {}", refused.stderr);
    }
    let text = folder.run("solve scene.obj --subdivide 4 --thin-error 0.3 --bounce-error 0.01").stdout;
    assert!(text.contains("too small to matter") && text.contains("bounces beyond") && text.contains("at most"));
}

#[test]
fn a_tolerance_of_some_faces_is_refined_for_them_alone() {
    let folder = Folder::new("plan_ask_tolerance");
    with_scene(&folder, &black_floor());
    let solve = "solve scene.obj --method analytic --tolerance 0.03 --json --output";
    let all = object(&folder, &format!("{solve} all.csv"));
    let some = object(&folder, &format!("{solve} some.csv --ask 0"));
    assert_eq!((&some["plan_off"], &some["refinement"]["met"]), (&Value::Null, &true.into()));
    let computed = |object: &Value| object["form_factors"]["counts"]["form_factors"].as_u64().unwrap();
    assert!(2 * computed(&some) < computed(&all));
    let asked = some["left_out"]
        .as_array()
        .unwrap()
        .iter()
        .find(|left| left["what"].as_str().unwrap().contains("not asked for"));
    assert!(asked.unwrap()["predicted"]["rows"].as_u64().unwrap() > 0);
    assert!(table(&folder, "some.csv").iter().all(|row| row[0] == 0.0));
    // Of the full form: by successive meshes, with pairs dropped in addition.
    let full = object(
        &folder,
        "solve scene.obj --method analytic --tolerance 0.1 --ask 0,1 --store packed --solver cg --json",
    );
    assert!(full["refinement"]["kind"] == "uniform" && full["refinement"]["met"] == true);
    assert!(full["left_out_error"].as_f64().unwrap() > 0.0);
}

/// The picture is held to the errors asked for, and what is in view is written.
#[test]
fn a_view_is_refined_for_what_its_pixels_show() {
    let folder = Folder::new("plan_view");
    with_scene(&folder, &two_rooms([true, true]));
    let corner = "--eye 0.4,0.5,1.6 --look-at 2,3.5,0 --up 0,0,1 --fov 50 --size 60x40";
    let view =
        object(&folder, &format!("solve scene.obj --subdivide 6 --ask-view {corner} --bounce-error 0.01 --json"));
    assert_eq!(view["view"]["fov"], 50.0);
    assert!(view["left_out_error"].as_f64().unwrap() <= 0.01);
    let refine =
        format!("solve scene.obj --method analytic --tolerance 0.05 --ask-view {corner} --json --output view.csv");
    let refined = object(&folder, &refine);
    assert_eq!(refined["refinement"]["met"], true);
    let left = refined["left_out"].as_array().unwrap();
    assert!(left.iter().any(|left| left["what"] == "refinement that the view does not show"));
    // Floor and the walls around the corner: of the first room, and not its ceiling.
    let surfaces: Vec<f64> = table(&folder, "view.csv").iter().map(|row| row[0]).collect();
    assert!(surfaces.iter().all(|s| *s < 5.0) && surfaces.contains(&4.0));
    // A camera is nothing without the picture being asked for, and must show something.
    let refused = folder.run(&format!("solve scene.obj {corner}"));
    assert!(refused.code == 2 && refused.stderr.contains("--ask-view"), "{}", refused.stderr);
    let refused = folder.run("solve scene.obj --ask-view --eye 9,9,9 --look-at 19,9,9 --up 0,0,1");
    assert!(refused.code == 2 && refused.stderr.contains("--eye"), "{}", refused.stderr);
}

/// The pairs of a room with a sheet before a wall are all predicted face by face and counted by what was computed.
#[test]
fn what_geometry_leaves_out_is_predicted_and_counted() {
    let folder = Folder::new("plan_anyway");
    with_scene(&folder, &black_floor());
    let solve = "solve scene.obj --subdivide 3 --json --solver shooting --store dense";
    let [foreseen, ran] = ["--dry-run", ""].map(|dry| object(&folder, &format!("{solve} {dry}")));
    let of = |object: &Value, key: &str, counted: &str| {
        let list = object["left_out_anyway"].as_array().unwrap().iter();
        list.filter_map(|left| left[key][counted].as_u64()).next()
    };
    // 63 elements: a sheet in a room of six faces.
    let pairs = of(&ran, "measured", "pairs").unwrap();
    let saved = ran["left_out"].as_array().unwrap().iter().filter_map(|left| left["measured"]["form_factors"].as_u64());
    let computed = ran["form_factors"]["counts"]["form_factors"].as_u64().unwrap();
    let gathered = ran["solve"]["counts"]["form_factors"].as_u64().unwrap();
    assert_eq!(pairs + computed + gathered + saved.sum::<u64>(), 63 * 62 / 2);
    assert_eq!((of(&foreseen, "predicted", "pairs"), of(&ran, "predicted", "pairs")), (Some(pairs), Some(pairs)));
    assert_eq!(of(&ran, "predicted", "polygons"), of(&ran, "measured", "polygons"));
    // Shooting is shown at its end alone.
    assert_eq!(of(&ran, "measured", "terms"), ran["steps"].as_u64());
    let text = folder.run("solve scene.obj --subdivide 3").stdout;
    assert!(text.lines().filter(|line| line.starts_with("left out anyway: ")).count() == 1);
    assert!(text.contains("face away") && text.contains(", as predicted"), "{text}");
}

#[test]
fn a_diffuse_picture_needs_nothing_of_specular_light_and_says_so() {
    let folder = Folder::new("plan_render");
    with_scene(&folder, &one_room());
    let render = "render scene.obj --subdivide 2 --size 8x8 --samples 16 --json --output picture.png";
    let [foreseen, ran] = ["--dry-run", ""].map(|dry| object(&folder, &format!("{render} {dry}")));
    let left = |object: &Value| object["left_out_anyway"].as_array().unwrap().clone();
    let specular = left(&ran).into_iter().find(|left| left["what"].as_str().unwrap().contains("second pass")).unwrap();
    assert!(specular["reason"].as_str().unwrap().contains("nothing in the scene is specular"));
    // 24 elements, 4,096 rays each.
    assert_eq!((&specular["predicted"]["rays"], &specular["measured"]["rays"]), (&98_304.into(), &98_304.into()));
    assert_eq!(left(&foreseen)[0]["predicted"], specular["predicted"]);
    assert!(left(&ran).iter().any(|left| left["what"].as_str().unwrap().contains("ambient term")));
    assert!(ran["plan_off"].as_str().unwrap().contains("by each of its ways"));
    assert_eq!(ran["first_pass"]["extended_form_factors"]["counts"]["rays"], 0);
    let text = folder.run("render scene.obj --subdivide 2 --size 8x8 --samples 16 --output picture.png").stdout;
    assert!(text.contains("left out anyway: ") && text.contains("nothing in the scene is specular"), "{text}");
}

#[test]
fn a_comparison_tells_what_its_reference_leaves_out() {
    let folder = Folder::new("plan_compare");
    with_scene(&folder, &two_rooms([true, false]));
    let compare = "compare scene.obj --subdivide 1 --no-progress";
    let ran = object(&folder, &format!("{compare} --json"));
    let dark = &ran["left_out"][0];
    // 2 × 2 elements on each of the six faces of the dark room.
    assert!(dark["reason"].as_str().unwrap().contains("no light") && dark["predicted"]["unknowns"] == 24);
    // The lit room is its own mirror image; both are measured together.
    let in_all = ran["left_out"].as_array().unwrap().last().unwrap();
    assert!(
        in_all["what"] == "in all"
            && in_all["predicted"]["form_factors"].as_u64() > dark["predicted"]["form_factors"].as_u64()
    );
    assert_eq!(in_all["predicted"], in_all["measured"]);
    assert!(ran["plan_off"].as_str().unwrap().contains("whole systems"));
    let foreseen = &object(&folder, &format!("{compare} --dry-run --json"))["left_out"];
    assert_eq!(foreseen[0]["predicted"], dark["predicted"]);
    let foreseen = foreseen.as_array().unwrap().last().unwrap();
    assert_eq!((&foreseen["predicted"], &foreseen["measured"]), (&in_all["predicted"], &Value::Null));
    let text = folder.run(compare).stdout;
    assert!(text.contains("reference, left out: 6 faces: no light") && text.contains(", as predicted"), "{text}");
}
