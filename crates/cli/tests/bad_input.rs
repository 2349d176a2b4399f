//! Bad input ends with exit code 2 and one message that says where and what to do, and touches no file.

mod common;

use common::{CUBE, CUBE_MTL, Folder, SQUARES, SQUARES_MTL};

/// What stands in the output file before the program is run.
const EARLIER: &str = "an earlier result\n";

/// Runs `command` beside existing results; the first line of its message must hold every one of `words`.
fn refused(folder: &Folder, command: &str, words: &[&str]) {
    folder.write("out.csv", EARLIER);
    folder.write("F.csv", EARLIER);
    let before = folder.files();
    let ran = folder.run(command);
    assert_eq!(ran.code, 2, "{command}: {}{}", ran.stdout, ran.stderr);
    assert_eq!(ran.stdout, "", "{command}: nothing on standard output");
    let first = ran.stderr.lines().next().unwrap_or_default();
    assert!(first.starts_with("error: "), "{command}: {}", ran.stderr);
    assert_eq!(ran.stderr.matches("error:").count(), 1, "{command}: one message: {}", ran.stderr);
    for word in words {
        assert!(first.contains(word), "{command}: '{word}' is not in '{first}'");
    }
    assert_eq!((folder.read("out.csv").as_str(), folder.read("F.csv").as_str()), (EARLIER, EARLIER), "{command}");
    assert_eq!(folder.files(), before, "{command}: files");
}

/// A triangle of material `m` with the given library.
fn triangle(folder: &Folder, library: &str) {
    folder.write("m.mtl", library);
    folder.write("scene.obj", "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n");
}

const SOLVE: &str = "solve scene.obj --output out.csv";
const FORM_FACTORS: &str = "form-factors scene.obj --output F.csv";

#[test]
fn a_missing_file_is_named() {
    let folder = Folder::new("missing_file");
    for command in [SOLVE, FORM_FACTORS, "inspect scene.obj", "compare scene.obj"] {
        refused(&folder, command, &["scene.obj", "check the path"]);
    }
}

#[test]
fn a_coordinate_that_is_no_number_is_named_with_its_line() {
    let folder = Folder::new("nan");
    for word in ["nan", "inf", "1e999", "one"] {
        folder.write("scene.obj", &format!("v 0 0 0\nv 1 0 0\nv {word} 1 0\nf 1 2 3\n"));
        for command in [SOLVE, FORM_FACTORS, "inspect scene.obj"] {
            refused(&folder, command, &["scene.obj:3", word, "correct"]);
        }
    }
}

#[test]
fn a_corner_that_does_not_exist_is_named_with_its_line() {
    let folder = Folder::new("index");
    for (corner, said) in [("7", "7"), ("-9", "-9"), ("0", "0"), ("x", "'x'")] {
        folder.write("scene.obj", &format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 {corner}\n"));
        refused(&folder, FORM_FACTORS, &["scene.obj:4", said]);
    }
}

#[test]
fn a_reflectance_of_1_or_more_is_refused_with_a_way_out() {
    let folder = Folder::new("reflectance");
    for kd in ["1 1 1", "0.5 1.5 0.5"] {
        triangle(&folder, &format!("newmtl m\nKd {kd}\n"));
        refused(&folder, SOLVE, &["m.mtl:2", "'m'", "--clamp-reflectance 0.95"]);
    }
    triangle(&folder, "newmtl m\nKd 0.7 0.7 0.7\nKs 0.5 0.5 0.5\n");
    refused(&folder, SOLVE, &["m.mtl:3", "Kd + Ks", "--clamp-reflectance 0.95"]);
    let ran = folder.run(&format!("{SOLVE} --clamp-reflectance 0.95"));
    assert_eq!(ran.code, 0, "{}", ran.stderr);
    for command in ["--clamp-reflectance 1", "--clamp-reflectance nan", "--default-reflectance -0.1"] {
        let ran = folder.run(&format!("{SOLVE} {command}"));
        assert_eq!(ran.code, 2, "{command}");
    }
}

#[test]
fn a_negative_colour_or_one_that_is_no_number_is_named_with_its_line() {
    let folder = Folder::new("colour");
    for (line, key) in
        [("Kd -0.1 0.1 0.1", "Kd"), ("Kd nan 0 0", "Kd"), ("Kd red", "Kd"), ("Ke -1 0 0", "Ke"), ("Ke 1 2", "Ke")]
    {
        triangle(&folder, &format!("newmtl m\n{line}\n"));
        refused(&folder, SOLVE, &["m.mtl:2", key, "'m'"]);
    }
}

#[test]
fn a_face_without_a_material_is_named_with_its_line() {
    let folder = Folder::new("no_material");
    folder.write("scene.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    refused(&folder, SOLVE, &["scene.obj:4", "face 0", "--default-reflectance"]);
    folder.write("scene.obj", "mtllib gone.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl paint\nf 1 2 3\n");
    refused(&folder, SOLVE, &["scene.obj:6", "'paint'", "gone.mtl", "--default-reflectance"]);
}

#[test]
fn a_scene_of_which_nothing_has_an_area_is_refused() {
    let folder = Folder::new("no_area");
    folder.write("scene.obj", "# nothing\n");
    for command in [SOLVE, FORM_FACTORS, "inspect scene.obj"] {
        refused(&folder, command, &["scene.obj", "area", "at least one face"]);
    }
    folder.write("scene.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n");
    refused(&folder, FORM_FACTORS, &["scene.obj", "area", "line 4"]);
    refused(&folder, &format!("{SOLVE} --default-reflectance 0.5"), &["scene.obj", "area", "line 4"]);
}

fn squares(test: &str) -> Folder {
    let folder = Folder::new(test);
    folder.write("scene.obj", SQUARES);
    folder.write("squares.mtl", SQUARES_MTL);
    folder
}

#[test]
fn settings_out_of_range_are_refused() {
    let folder = squares("settings");
    for (options, words) in [
        ("--method hemicube --resolution 31", &["31", "even"][..]),
        ("--resolution 0", &["0", "even"]),
        ("--rays 0", &["0", "at least 1"]),
        ("--subdivide 0", &["0", "at least 1"]),
        ("--subdivide 5 --patch-subdivide 2", &["5", "2", "multiple"]),
        ("--subdivide 1000000", &["cells", "coarser"]),
        ("--element-size 1e-9", &["cells", "coarser"]),
        ("--element-size=-1", &["-1", "positive"]),
        ("--tolerance 2", &["2", "between 0 and 1"]),
        ("--threads 0", &["0", "at least 1"]),
        ("--store attic", &["attic"]),
        ("--store packed --method ray-cast", &["packed", "symmetric", "another store"]),
        (
            "--store packed-f32 --patch-subdivide 2 --solver gauss-seidel",
            &["packed-f32", "every element its own patch"],
        ),
        ("--repair", &["closed", "open"]),
        ("--form-factors out.csv --method analytic", &["--form-factors", "--method"]),
        ("--form-factors out.csv --patch-subdivide 2", &["--form-factors", "--patch-subdivide"]),
        ("--form-factors out.csv", &["out.csv:1", "no finite number"]),
        ("--form-factors none.csv", &["none.csv", "check the path"]),
        ("--form-factors F.xlsx", &["F.xlsx", ".npy"]),
        ("--no-such-flag", &["--no-such-flag"]),
        ("--method guess", &["guess"]),
    ] {
        refused(&folder, &format!("{SOLVE} {options}"), words);
    }
}

/// With and without a dry run: a wrong name costs no form factors.
#[test]
fn solvers_that_cannot_take_the_system_are_refused_before_anything_is_computed() {
    let folder = squares("solver");
    for dry in ["", "--dry-run"] {
        let command = |options: &str| format!("{SOLVE} {options} {dry}");
        refused(&folder, &command("--solver gauss"), &["'gauss'", "gauss-seidel"]);
        for method in ["ray-cast", "hemicube"] {
            let options = format!("--solver cg --method {method}");
            refused(&folder, &command(&options), &["cg", "symmetric", "another solver"]);
            refused(&folder, &command(&format!("{options} --patch-subdivide 2")), &["cg", "symmetric"]);
        }
    }
}

/// Of a closed room, where row sums are known; on demand nothing is held that could be scaled.
#[test]
fn a_repair_that_cannot_be_made_is_refused_with_a_way_out() {
    let folder = Folder::new("repair");
    folder.write("scene.obj", CUBE);
    folder.write("cube.mtl", CUBE_MTL);
    for (options, words) in [
        ("--store on-demand", &["analytic", "on-demand", "choose dense"][..]),
        ("--method ray-cast --store sparse", &["ray-cast", "sparse", "choose dense"]),
        ("--patch-subdivide 2", &["elements-to-patches", "leave out the patches"]),
    ] {
        refused(&folder, &format!("{SOLVE} --repair {options}"), words);
    }
    let folder = squares("repair_open");
    refused(&folder, &format!("{FORM_FACTORS} --repair"), &["closed", "open"]);
    refused(&folder, &format!("{FORM_FACTORS} --repair --from 0,0,0,0,0,1"), &["--repair", "--from"]);
    refused(&folder, &format!("{FORM_FACTORS} --contacts --from 0,0,0,0,0,1"), &["--contacts", "--from"]);
    // A closed room, but what its obstruction takes has no column.
    let squares = "V 1 0 0 0\nV 2 1 0 0\nV 3 1 1 0\nV 4 0 1 1\nS 1 1 2 3 0 0 0 0.5 a\nO 2 1 3 4 0 0 0 0 b\n";
    folder.write("scene.vs3", &format!("C encl=1\nF 3\n{squares}End\n"));
    refused(&folder, "form-factors scene.vs3 --repair --output F.csv", &["only block", "leave out --repair"]);
}

#[test]
fn an_output_that_tells_no_format_is_refused() {
    let folder = squares("format");
    for name in ["out", "out.txt", "out.mtx"] {
        refused(&folder, &format!("solve scene.obj --output {name}"), &[name, ".csv", ".ply"]);
    }
    for name in ["F", "F.xlsx", "F.ply"] {
        refused(&folder, &format!("form-factors scene.obj --output {name}"), &[name, ".csv", ".mtx", ".npy"]);
    }
}

#[test]
fn an_output_that_cannot_be_written_is_named() {
    let folder = squares("unwritable");
    refused(&folder, "solve scene.obj --subdivide 1 --output no/such/folder.csv", &["no/such/folder.csv"]);
    refused(&folder, "form-factors scene.obj --output no/such/folder.npy", &["no/such/folder.npy"]);
}
