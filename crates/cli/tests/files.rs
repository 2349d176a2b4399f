//! Scenes in the formats of View3D and STL, the file beside a matrix, and factors from a point.

mod common;

use std::f64::consts::PI;

use common::{Folder, Ran, SQUARES, SQUARES_MTL};
use serde_json::Value;

fn done(ran: &Ran) {
    assert_eq!((ran.code, ran.stderr.as_str()), (0, ""));
}

fn numbers(text: &str) -> Vec<Vec<f64>> {
    text.lines().map(|line| line.split([',', ' ']).map(|word| word.parse().unwrap()).collect()).collect()
}

/// A folder with opposed squares in it.
fn squares(test: &str) -> Folder {
    let folder = Folder::new(test);
    folder.write("squares.obj", SQUARES);
    folder.write("squares.mtl", SQUARES_MTL);
    folder
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

/// Opposed unit squares at distance 1.
const OPPOSED: f64 = 0.199_824_895_698_387_38;
/// Unit squares at right angles that share an edge.
const PERPENDICULAR: f64 = 0.200_043_776_075_404_06;

/// The unit cube seen from inside, its ceiling in two triangles that are one row, its floor with a subsurface of half its area.
const CUBE: &str = "T The unit cube\r\nC encl=1 list=3 eps=1e-9\r\nF 3\r\n\
    V 1 0 0 0\r\nV 2 1 0 0\r\nV 3 1 1 0\r\nV 4 0 1 0\r\nV 5 0 0 1\r\nV 6 1 0 1\r\nV 7 1 1 1\r\nV 8 0 1 1\r\n\
    V 9 0.5 0 0\r\nV 10 0.5 1 0\r\n\
    S 1 1 2 3 4 0 0 0.5 floor ! seen from above\r\ns 2 1 4 8 5 0 0 0.5 west\r\ns 3 1 5 6 2 0 0 0.5 south\r\n\
    S 4 7 6 5 0 0 0 0.25 ceiling\r\nS 5 7 3 2 6 0 0 0.5 east\r\nS 6 7 8 4 3 0 0 0.5 north\r\n\
    S 7 7 5 8 0 0 4 0.5 ceiling-2\r\nS 8 1 9 10 4 1 0 0.5 rug\r\nEnd of data\r\nS 9 nonsense\r\n";

#[test]
fn a_view3d_file_gives_rows_of_combined_surfaces_and_of_bases_without_their_subsurfaces() {
    let folder = Folder::new("vs3");
    folder.write("cube.VS3", CUBE);
    let ran = folder.run("form-factors cube.VS3 --json --output F.csv");
    done(&ran);
    let f = numbers(&folder.read("F.csv"));
    assert_eq!((f.len(), f[0].len()), (7, 7));
    // Rows: floor (its east half), west, south, ceiling, east, north, rug (its west half).
    assert!((f[3][0] + f[3][6] - OPPOSED).abs() < 1e-8 && (f[1][3] - PERPENDICULAR).abs() < 1e-8);
    assert!((f[4][1] - OPPOSED).abs() < 1e-8 && f[0][6] == 0.0);
    let report = json(&ran.stdout);
    assert_eq!((report["closed"].as_bool(), report["method"]["tolerance"].as_f64()), (Some(true), Some(1e-9)));
    // Seven factors of 1e-9 a row.
    assert!(report["checks"]["closure"]["row_sum_minus_1"].as_f64().unwrap().abs() < 1e-8);
    let beside = json(&folder.read("F.csv.json"));
    assert_eq!(beside["names"], serde_json::json!(["floor", "west", "south", "ceiling", "east", "north", "rug"]));
    assert_eq!(beside["areas"], serde_json::json!([0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5]));
    done(&folder.run("form-factors cube.VS3 --tolerance 1e-3 --json --output F.csv"));
    assert_eq!(json(&folder.read("F.csv.json"))["tolerance"].as_f64(), Some(1e-3));
}

#[test]
fn the_text_layout_of_view3d_holds_areas_rows_and_emittances() {
    let folder = Folder::new("vf");
    folder.write("cube.vs3", CUBE);
    done(&folder.run("form-factors cube.vs3 --quiet --output F.txt"));
    done(&folder.run("form-factors cube.vs3 --quiet --output F.csv"));
    let text = folder.read("F.txt");
    let (header, rest) = text.split_once('\n').unwrap();
    assert_eq!(header.split_whitespace().collect::<Vec<_>>(), ["View3D", "3.3", "0", "1", "0", "7"]);
    let lines = numbers(rest);
    assert_eq!(lines[0], [0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5]);
    assert_eq!(lines[1..8], numbers(&folder.read("F.csv")));
    assert_eq!(lines[8], [0.5, 0.5, 0.5, 0.25, 0.5, 0.5, 0.5]);
}

/// Two squares with a quarter-sized one that has no row: beside the pair it hides nothing, halfway between a quarter.
#[test]
fn an_obstruction_blocks_and_has_no_row() {
    let folder = Folder::new("obstruction");
    let squares = "F 3\nV 1 0 0 0\nV 2 1 0 0\nV 3 1 1 0\nV 4 0 1 0\nV 5 0 0 1\nV 6 1 0 1\nV 7 1 1 1\nV 8 0 1 1\n\
        S 1 1 2 3 4 0 0 0.5 a\nS 2 7 6 5 8 0 0 0.5 b\n";
    let value = |x: f64, method: &str| {
        let between = format!("V 9 {x} 0 .5\nV 10 {} 0 .5\nV 11 {} .5 .5\nV 12 {x} .5 .5\n", x + 0.5, x + 0.5);
        folder.write("a.vs3", &format!("{squares}{between}O 3 9 10 11 12 0 0 0 baffle\nEnd\n"));
        done(&folder.run(&format!("form-factors a.vs3 {method} --quiet --output F.csv")));
        let f = numbers(&folder.read("F.csv"));
        assert_eq!((f.len(), f[0].len()), (2, 2), "{method}");
        f[0][1]
    };
    assert!((value(7.0, "") - OPPOSED).abs() < 1e-9);
    // The kernel is the same for a segment and its mirror images in x and y, and the baffle stops those whose middle has both
    // coordinates below ½: a quarter. Sampled, with standard errors of 3e-4 and 3e-3; a hemicube looks from the middle, where F is
    // larger by a fifth.
    for (method, allowed) in [("", 1e-3), ("--rays 16384", 0.01), ("--method hemicube --resolution 512", 0.04)] {
        let found = value(0.0, method);
        assert!((found - 0.75 * OPPOSED).abs() < allowed, "{method}: {found}");
    }
}

#[test]
fn an_stl_file_gives_one_row_a_triangle() {
    let folder = Folder::new("stl");
    let facet = |corners: [[f64; 3]; 3]| {
        let vertex = |[x, y, z]: [f64; 3]| format!("vertex {x} {y} {z}\n");
        format!("facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n", corners.map(vertex).concat())
    };
    let (a, b) = ([[0., 0., 0.], [1., 0., 0.], [1., 1., 0.]], [[0., 0., 0.], [1., 1., 0.], [0., 1., 0.]]);
    let flat = [[0., 0., 0.], [1., 1., 0.], [1., 1., 0.]];
    let up = |t: [[f64; 3]; 3]| [t[2], t[1], t[0]].map(|[x, y, _]| [x, y, 1.0]);
    let text = [a, flat, b, up(a), up(b)].map(facet).concat();
    folder.write("a.stl", &format!("solid two squares\n{text}endsolid\n"));
    let ran = folder.run("form-factors a.stl --json --output F.csv");
    assert_eq!(ran.code, 0, "{}", ran.stderr);
    let f = numbers(&folder.read("F.csv"));
    assert_eq!(f.len(), 5);
    assert_eq!(f[1], [0.0; 5]);
    // Half of every factor to both triangles of the other square, weighted by equal areas.
    let sum: f64 = [0, 2].iter().flat_map(|s| [f[*s][3], f[*s][4]]).sum();
    assert!((0.5 * sum - OPPOSED).abs() < 1e-9);
    assert_eq!(json(&folder.read("F.csv.json"))["names"][4], "two squares");
}

#[test]
fn the_file_beside_a_matrix_says_what_it_holds() {
    let folder = squares("sidecar");
    done(&folder.run("form-factors squares.obj --subdivide 2 --quiet --output F.npy"));
    let beside = json(&folder.read("F.npy.json"));
    assert_eq!(beside["convention"], "row = from");
    assert_eq!((beside["rows"].as_u64(), beside["tolerance"].as_f64()), (Some(8), Some(1e-10)));
    assert_eq!((beside["method"]["name"].as_str(), beside["repair"].is_null()), (Some("analytic"), true));
    assert_eq!(beside["surfaces"], serde_json::json!([0, 0, 0, 0, 1, 1, 1, 1]));
    assert_eq!(beside["cells"][3], serde_json::json!([1, 1]));
    let bounds = beside["error_bound"].as_array().unwrap();
    assert!(
        bounds.len() == 8 && bounds.iter().all(|b| b.as_f64().is_some_and(|b| b > 0.0 && b <= 1e-10)),
        "{bounds:?}"
    );
}

/// A matrix that cannot be written leaves an earlier one and the file beside it as they were.
#[test]
fn a_failed_run_leaves_both_files() {
    let folder = squares("sidecar_kept");
    done(&folder.run("form-factors squares.obj --quiet --output F.csv"));
    let (matrix, beside) = (folder.read("F.csv"), folder.read("F.csv.json"));
    folder.write("squares.obj", "v 0 0 x\n");
    assert_eq!(folder.run("form-factors squares.obj --quiet --output F.csv").code, 2);
    assert_eq!((folder.read("F.csv"), folder.read("F.csv.json")), (matrix, beside));
}

/// From a point at height h under the corner of a unit square lifted by 1:
/// F = 1/(2π) · 2 · X/√(1+X²) · atan(1/√(1+X²)) with X = 1 (Howell, B-3).
#[test]
fn factors_from_a_point_are_exact_with_and_without_a_blocker() {
    let folder = squares("from");
    let corner = 1.0 / PI * 0.5_f64.sqrt() * 0.5_f64.sqrt().atan();
    let ran = folder.run("form-factors squares.obj --from 0,0,0,0,0,2 --json");
    done(&ran);
    let report = json(&ran.stdout);
    let f: Vec<f64> = report["form_factors"].as_array().unwrap().iter().map(|f| f.as_f64().unwrap()).collect();
    assert!(f[0] == 0.0 && (f[1] - corner).abs() < 1e-15, "{f:?}");
    assert!(report["method"]["visibility"].as_str().unwrap().contains("exact"));
    // A blocker halfway that covers the projection of the quarter next to the corner.
    let blocked = format!("{SQUARES}v 0 0 .5\nv .25 0 .5\nv .25 .25 .5\nv 0 .25 .5\nf 9 10 11 12\n");
    folder.write("blocked.obj", &blocked);
    // The quarter from the corner, with X = a/c = 1/2.
    let x: f64 = 0.5;
    let quarter = 1.0 / PI * x / x.hypot(1.0) * (x / x.hypot(1.0)).atan();
    let ran = folder.run("form-factors blocked.obj --from=-0,0,0,0,0,1 --output f.csv");
    assert_eq!(ran.code, 0, "{}", ran.stderr);
    let f = numbers(&folder.read("f.csv"));
    assert_eq!((f.len(), f[0].len()), (1, 3));
    assert!((f[0][1] - (corner - quarter)).abs() < 1e-15, "{f:?}");
    assert_eq!(json(&folder.read("f.csv.json"))["from"]["normal"], serde_json::json!([0.0, 0.0, 1.0]));
}

#[test]
fn factors_from_a_point_print_as_a_table() {
    let folder = Folder::new("from_table");
    folder.write("cube.vs3", CUBE);
    let ran = folder.run("form-factors cube.vs3 --from 0.5,0.5,0.5,-1,2,0.5");
    done(&ran);
    let lines: Vec<&str> = ran.stdout.lines().collect();
    assert_eq!((lines[0], lines.len()), ("surface,i,j,name,form_factor", 8));
    assert!(lines[7].starts_with("7,0,0,rug,"), "{}", lines[7]);
    // Inside a closed room every direction meets a face.
    let sum: f64 = lines[1..].iter().map(|line| line.rsplit(',').next().unwrap().parse::<f64>().unwrap()).sum();
    assert!((sum - 1.0).abs() < 1e-14, "{sum}");
}

#[test]
fn what_cannot_be_used_is_refused_with_its_place() {
    let folder = squares("refused");
    folder.write("a.vs3", "F 3\nV 1 0 0 0\nS 1 1 2 3 0 0 0 0.5 a\n");
    folder.write("a.stl", "no triangles");
    for (command, words) in [
        ("a.vs3 --output F.csv", &["a.vs3:3", "vertex 2"][..]),
        ("a.stl --output F.csv", &["a.stl", "84 bytes"]),
        ("squares.obj --from 1,2,3 --output F.csv", &["six numbers"]),
        ("squares.obj --from 1,2,3,0,0,0", &["normal"]),
        ("squares.obj --from 1,2,3,0,0,1 --rays 9", &["--rays"]),
        ("squares.obj --from 1,2,3,0,0,1 --output F.txt", &["F.txt", ".npy"]),
        ("squares.obj", &["--output"]),
    ] {
        let ran = folder.run(&format!("form-factors {command}"));
        assert_eq!((ran.code, ran.stdout.as_str()), (2, ""), "{command}: {}", ran.stderr);
        assert!(words.iter().all(|word| ran.stderr.contains(word)), "{command}: {}", ran.stderr);
    }
    assert_eq!(folder.files(), ["a.stl", "a.vs3", "squares.mtl", "squares.obj"]);
}
