//! `solve SCENE --after BEFORE`: the answer of `solve SCENE`, and what was saved.

mod common;

use common::{CUBE, CUBE_MTL, Folder, SQUARES, SQUARES_MTL};
use serde_json::Value;

fn folder(test: &str) -> Folder {
    let folder = Folder::new(test);
    folder.write("cube.obj", CUBE);
    folder.write("cube.mtl", CUBE_MTL);
    folder.write("squares.obj", SQUARES);
    folder.write("squares.mtl", SQUARES_MTL);
    folder
}

/// The numbers of a table after its header.
fn numbers(text: &str) -> Vec<f64> {
    text.lines().skip(1).flat_map(|line| line.split(',').map(|word| word.parse().unwrap())).collect()
}

#[test]
fn another_lamp_computes_no_form_factor_and_gives_the_answer_of_a_run_of_its_own() {
    let folder = folder("after_lamp");
    folder.write("bright.mtl", &CUBE_MTL.replace("Ke 2 3 4", "Ke 4 3 5"));
    folder.write("bright.obj", &CUBE.replace("cube.mtl", "bright.mtl"));
    let ran = folder.run("solve bright.obj --after cube.obj --subdivide 3 --unshot 1e-12 --json --output after.csv");
    assert_eq!((ran.code, ran.stderr.as_str()), (0, ""));
    let after: Value = serde_json::from_str::<Value>(&ran.stdout).unwrap()["after"].clone();
    assert_eq!(after["recoloured_faces"], serde_json::json!([5]));
    assert_eq!(after["moved_faces"], serde_json::json!([]));
    // All pairs of cells of different faces face each other: 15 pairs of faces, 81 of cells each.
    assert_eq!(after["form_factors"], serde_json::json!({ "computed": 0, "of": 15 * 81 }));
    assert_eq!(folder.run("solve bright.obj --subdivide 3 --unshot 1e-12 --quiet --output own.csv").code, 0);
    let pairs = numbers(&folder.read("after.csv")).into_iter().zip(numbers(&folder.read("own.csv")));
    // Both stop at 1e-12 of the emitted power.
    let worst = pairs.map(|(a, b)| (a - b).abs() / b.abs().max(1.0)).fold(0.0, f64::max);
    assert!(worst < 1e-10, "{worst:e}");
}

/// The upper of two opposed squares 0.2 to the side: all of the 16 pairs of 2 × 2 cells each change.
#[test]
fn a_moved_face_is_named_and_its_pairs_are_counted() {
    let folder = folder("after_face");
    folder.write(
        "moved.obj",
        &SQUARES.replace("v 0 0 1\nv 0 1 1\nv 1 1 1\nv 1 0 1", "v 0.2 0 1\nv 0.2 1 1\nv 1.2 1 1\nv 1.2 0 1"),
    );
    let ran = folder.run("solve moved.obj --after squares.obj --subdivide 2");
    assert_eq!((ran.code, ran.stderr.as_str()), (0, ""));
    let line = "0 faces of other material, 1 moved; 16 of 16 form factors in 8 of 8 rows";
    assert!(ran.stdout.contains("after squares.obj") && ran.stdout.contains(line), "{}", ran.stdout);
}

#[test]
fn scenes_that_are_not_after_each_other_are_refused_with_what_differs() {
    let folder = folder("after_refused");
    let both = SQUARES.replace(" 0\nv", " -0.5\nv").replace("v 0 0 1\nv 0 1 1", "v -1 0 1\nv -1 1 1");
    folder.write("both.obj", &both);
    let ran = folder.run("solve both.obj --after squares.obj --output out.csv");
    assert_eq!(ran.code, 2);
    assert!(ran.stderr.contains("face 1 is not where it was in squares.obj, and neither is face 0"), "{}", ran.stderr);
    // Faces of one object may move together.
    let object = |text: &str| text.replace("usemtl grey", "o pair\nusemtl grey");
    folder.write("squares_object.obj", &object(SQUARES));
    folder.write("both_object.obj", &object(&both));
    assert_eq!(folder.run("solve both_object.obj --after squares_object.obj --quiet").code, 0);
    let ran = folder.run("solve cube.obj --after squares.obj");
    assert_eq!(ran.code, 2);
    assert!(ran.stderr.contains("2 surfaces, the one after 6"), "{}", ran.stderr);
    let ran = folder.run("solve cube.obj --after cube.obj --store on-demand");
    assert_eq!(ran.code, 2);
    assert!(ran.stderr.contains("choose dense, sparse or a packed one"), "{}", ran.stderr);
    assert_eq!(folder.run("solve cube.obj --after cube.obj --tolerance 0.1").code, 2);
    assert!(!folder.files().contains(&"out.csv".to_owned()));
}
