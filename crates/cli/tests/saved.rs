//! Form factors through a file: `solve --form-factors` gives what `solve` gives, or says why the file does not fit.

mod common;

use common::{CUBE, CUBE_MTL, Folder, Ran, SQUARES, SQUARES_MTL};
use serde_json::Value;

fn done(ran: &Ran) {
    assert_eq!((ran.code, ran.stderr.as_str()), (0, ""));
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

/// The Cornell box with its blocks, whose floor is cut and partly covered, copied into a folder.
fn cornell_box(test: &str) -> Folder {
    let folder = Folder::new(test);
    let scenes = concat!(env!("CARGO_MANIFEST_DIR"), "/../../experiments/scenes/");
    for name in ["cornell_box.obj", "cornell_box.mtl"] {
        folder.write(name, &std::fs::read_to_string(format!("{scenes}{name}")).unwrap());
    }
    folder
}

fn cube(test: &str) -> Folder {
    let folder = Folder::new(test);
    folder.write("cube.obj", CUBE);
    folder.write("cube.mtl", CUBE_MTL);
    folder
}

/// Largest difference of two solutions, relative to the largest value of a column.
fn difference(a: &str, b: &str) -> f64 {
    let rows = |text: &str| -> Vec<Vec<f64>> {
        text.lines().skip(1).map(|line| line.split(',').map(|word| word.parse().unwrap()).collect()).collect()
    };
    let (a, b) = (rows(a), rows(b));
    assert_eq!((a.len(), a[0].len()), (b.len(), b[0].len()));
    let column = |c: usize| {
        let level = b.iter().map(|row| row[c].abs()).fold(f64::MIN_POSITIVE, f64::max);
        a.iter().zip(&b).map(|(a, b)| (a[c] - b[c]).abs()).fold(0.0, f64::max) / level
    };
    (0..b[0].len()).map(column).fold(0.0, f64::max)
}

/// Files hold every digit; F · A loses two roundings, and both runs stop at an unshot share of 1e-12.
#[test]
fn a_matrix_of_the_cornell_box_gives_its_solution_back() {
    let folder = cornell_box("saved_cornell");
    done(
        &folder.run("solve cornell_box.obj --subdivide 2 --method analytic --unshot 1e-12 --quiet --output direct.csv"),
    );
    for file in ["F.csv", "F.mtx", "F.npy", "F.vf"] {
        done(&folder.run(&format!("form-factors cornell_box.obj --subdivide 2 --contacts --quiet --output {file}")));
        // The file beside the matrix knows the subdivision.
        let solve = format!("solve cornell_box.obj --form-factors {file} --unshot 1e-12 --json --output again.csv");
        let ran = folder.run(&solve);
        done(&ran);
        let object = json(&ran.stdout);
        assert_eq!((object["solver"].as_str(), object["method"]["symmetric"].as_bool()), (Some("cg"), Some(true)));
        assert_eq!(object["method"]["made_by"]["name"], "analytic");
        let off = difference(&folder.read("again.csv"), &folder.read("direct.csv"));
        assert!(off < 1e-11, "{file}: {off:e}");
    }
}

/// Nothing touches in an empty cube, so that the plain matrix is that of the mesh; every store and solver takes it.
#[test]
fn a_plain_matrix_of_an_empty_cube_serves_every_store_and_solver() {
    let folder = cube("saved_cube");
    done(&folder.run("form-factors cube.obj --subdivide 3 --quiet --output F.csv"));
    done(&folder.run("solve cube.obj --subdivide 3 --unshot 1e-12 --quiet --output direct.csv"));
    for store in ["dense", "sparse", "packed", "packed-f32", "on-demand", "on-demand-kept"] {
        for solver in ["cg", "direct", "gauss-seidel"] {
            let options = format!("--form-factors F.csv --store {store} --solver {solver} --unshot 1e-12");
            done(&folder.run(&format!("solve cube.obj {options} --quiet --output again.csv")));
            let off = difference(&folder.read("again.csv"), &folder.read("direct.csv"));
            // Entries of single precision are off by up to 6e-8 of themselves.
            let allowed = if store == "packed-f32" { 1e-6 } else { 1e-11 };
            assert!(off < allowed, "{store} {solver}: {off:e}");
        }
    }
}

/// Six digits are not enough to be symmetric to rounding, but within the bounds that are then given.
#[test]
fn a_matrix_that_is_not_symmetric_is_used_row_by_row() {
    let folder = cube("saved_rows");
    done(&folder.run("form-factors cube.obj --subdivide 2 --method ray-cast --rays 256 --quiet --output F.csv"));
    let ran = folder.run("solve cube.obj --form-factors F.csv --json");
    done(&ran);
    let object = json(&ran.stdout);
    assert_eq!(
        (object["solver"].as_str(), object["method"]["symmetric"].as_bool()),
        (Some("gauss-seidel"), Some(false))
    );
    for (options, words) in [("--solver cg", ["cg", "symmetric"]), ("--store packed", ["packed", "symmetric"])] {
        let ran = folder.run(&format!("solve cube.obj --form-factors F.csv {options}"));
        assert_eq!(ran.code, 2, "{options}");
        assert!(words.iter().all(|word| ran.stderr.contains(word)), "{}", ran.stderr);
    }
    // Repaired it is symmetric.
    let ran = folder.run("solve cube.obj --form-factors F.csv --repair --json");
    done(&ran);
    let object = json(&ran.stdout);
    assert!(object["repair"]["closure_after"].as_f64().unwrap() < 1e-13);
    assert_eq!(
        (object["solver"].as_str(), object["repair"]["mean_of_both_directions_first"].as_bool()),
        (Some("cg"), Some(true))
    );
}

/// A face without an area has a row in the matrix and no element in the mesh.
#[test]
fn rows_of_zeros_are_left_out() {
    let folder = Folder::new("saved_flat");
    folder.write("squares.obj", &format!("{SQUARES}v 2 0 0\nv 3 0 0\nv 4 0 0\nf 9 10 11\n"));
    folder.write("squares.mtl", SQUARES_MTL);
    for file in ["F.csv", "F.vf"] {
        assert_eq!(folder.run(&format!("form-factors squares.obj --subdivide 2 --quiet --output {file}")).code, 0);
        let ran = folder.run(&format!("solve squares.obj --form-factors {file} --json"));
        assert_eq!(ran.code, 0, "{}", ran.stderr);
        assert_eq!(json(&ran.stdout)["elements"].as_u64(), Some(8));
    }
}

#[test]
fn a_file_that_does_not_fit_is_refused_in_one_sentence() {
    let folder = cornell_box("saved_refused");
    folder.write("cube.obj", CUBE);
    folder.write("cube.mtl", CUBE_MTL);
    done(&folder.run("form-factors cornell_box.obj --subdivide 2 --rays 16 --quiet --output plain.csv"));
    done(&folder.run("form-factors cube.obj --subdivide 2 --quiet --output cube.csv"));
    done(&folder.run("form-factors cube.obj --from 0.5,0.5,0.5,0,0,1 --quiet --output point.csv"));
    folder.write("alone.csv", &folder.read("cube.csv"));
    folder.write("text.csv", "F,1\n0,1\n");
    folder.write("broken.csv", "0,1\n1,0\n");
    folder.write("broken.csv.json", "{");
    folder.write("areas.csv", &folder.read("cube.csv"));
    folder.write("areas.csv.json", &folder.read("cube.csv.json").replace("0.25", "0.26"));
    folder.write("cells.csv", &folder.read("cube.csv"));
    folder.write("cells.csv.json", &folder.read("cube.csv.json").replace("[0,1]", "[1,1]"));
    let lines = |scene: &str, options: &str| {
        let before = folder.files();
        let ran = folder.run(&format!("solve {scene} --form-factors {options} --output out.csv"));
        assert_eq!(
            (ran.code, ran.stdout.as_str(), ran.stderr.lines().count()),
            (2, "", 1),
            "{options}: {}",
            ran.stderr
        );
        assert_eq!(folder.files(), before, "{options}: nothing written");
        ran.stderr
    };
    for (scene, options, words) in [
        // Cells are cut where the blocks stand.
        ("cornell_box.obj", "plain.csv", &["plain.csv", "76 rows", "90 elements", "--subdivide 2 --contacts"][..]),
        ("cube.obj", "cube.csv --subdivide 3", &["24 rows", "54 elements", "--subdivide 3 --contacts"]),
        ("cube.obj", "alone.csv", &["24 rows", "96 elements", "--subdivide 4"]),
        ("cube.obj", "point.csv", &["point.csv.json", "one row, from the point", "row = from"]),
        ("cube.obj", "text.csv", &["text.csv:1", "'F'"]),
        ("cube.obj", "broken.csv", &["broken.csv.json", "JSON", "make the matrix again"]),
        ("cube.obj", "areas.csv", &["row 0", "0.26", "0.25"]),
        ("cube.obj", "cells.csv", &["row 2", "cell (1, 1) of face 0", "cell (0, 1) of face 0"]),
        ("cube.obj", "none.npy", &["none.npy", "check the path"]),
        ("cube.obj", "F.xlsx", &["F.xlsx", ".npy"]),
    ] {
        let said = lines(scene, options);
        assert!(words.iter().all(|word| said.contains(word)), "{options}: {said}");
    }
}
