//! Solutions with light by way of specular surfaces.

mod common;

use std::f64::consts::PI;

use common::{CUBE, CUBE_MTL, Folder, Ran};
use serde_json::Value;

/// A cube of E = 3, ρ = 0.5 whose ceiling is a perfect mirror.
fn furnace(test: &str) -> Folder {
    let folder = Folder::new(test);
    folder.write("cube.obj", CUBE);
    folder.write(
        "cube.mtl",
        &format!("newmtl grey\nKd 0.5\nKe {}\nnewmtl lamp\nKd 0 0 0\nKs 1 1 1\nillum 3\n", 3.0 / PI),
    );
    folder
}

/// Green irradiance of the elements of the five walls.
fn irradiance(folder: &Folder, more: &str) -> Vec<f64> {
    let ran = folder.run(&format!("solve cube.obj --quiet --subdivide 3 --output out.csv {more}"));
    assert_eq!((ran.code, ran.stderr.as_str()), (0, ""), "{more}");
    let text = folder.read("out.csv");
    let rows = text.lines().skip(1).map(|line| -> Vec<f64> { line.split(',').map(|w| w.parse().unwrap()).collect() });
    rows.filter(|row| row[0] < 5.0).map(|row| row[11]).collect()
}

/// With the mirror the cube is a furnace, H = B = 6, and one mirror is taken once in a row at most. A fifth of that comes by way of it: of 4,096 rays that
/// an element gathers by some 800 do, 0.04 of 6; of those that a patch shoots some 20 arrive at an element, 0.13 from five patches. 45 elements stay
/// within four of these.
#[test]
fn a_mirror_closes_a_furnace_by_one_bounce() {
    let folder = furnace("specular_furnace");
    for (more, noise) in [
        ("any", 0.04),
        ("1", 0.04),
        ("any --store packed", 0.04),
        ("1 --patch-subdivide 1", 0.04),
        ("any --patch-subdivide 1 --solver shooting", 0.13),
    ] {
        for h in irradiance(&folder, &format!("--specular-bounces {more}")) {
            assert!((h - 6.0).abs() < 4.0 * noise, "{more}: {h}");
        }
    }
    let run = |more: &str| folder.run(&format!("solve cube.obj --json --subdivide 3 {more}"));
    let (with, without) = (run("--specular-bounces any"), run(""));
    let rays = |ran: &Ran| {
        let object: Value = serde_json::from_str(&ran.stdout).unwrap();
        object["extended_form_factors"]["counts"]["rays"].as_u64()
    };
    assert!(rays(&with).is_some_and(|rays| rays > 54 * 4096) && rays(&without).is_none());
    assert_eq!(with.stderr, "");
    assert!(without.stderr.contains("specular parts count only where specular bounces are asked for"));
}

/// Images are exact: no noise, and conjugate gradients unless another solver is asked for.
#[test]
fn images_close_a_furnace_exactly() {
    let folder = furnace("specular_images");
    for more in ["any", "1 --solver gauss-seidel", "any --store packed", "1 --patch-subdivide 1"] {
        for h in irradiance(&folder, &format!("--specular-by images --specular-bounces {more}")) {
            assert!((h - 6.0).abs() < 1e-6, "{more}: {h}");
        }
    }
    let ran = folder.run("solve cube.obj --json --subdivide 3 --specular-bounces any --specular-by images");
    let object: Value = serde_json::from_str(&ran.stdout).unwrap();
    let extended = &object["extended_form_factors"];
    assert_eq!((extended["by"].as_str(), object["solver"].as_str()), (Some("images"), Some("cg")));
    assert_eq!(extended["counts"]["rays"].as_u64(), Some(0));
}

#[test]
fn what_needs_symmetry_is_refused_and_diffuse_scenes_keep_their_bytes() {
    let folder = furnace("specular_refused");
    for (more, word) in [
        ("--solver cg", "symmetric"),
        ("--tolerance 0.1", "cannot be used with"),
        ("--patch-subdivide 1 --solver direct", "two-level"),
    ] {
        let ran =
            folder.run(&format!("solve cube.obj --quiet --subdivide 3 --specular-bounces any --output out.csv {more}"));
        assert_eq!(ran.code, 2, "{more}");
        assert!(ran.stderr.starts_with("error: ") && ran.stderr.contains(word), "{more}: {}", ran.stderr);
    }
    folder.write("cube.mtl", CUBE_MTL);
    irradiance(&folder, "");
    let plain = folder.read("out.csv");
    irradiance(&folder, "--specular-bounces any");
    assert!(folder.read("out.csv") == plain);
}
