//! What a command would take is predicted, and what there is no memory for is refused before it begins, with flags that fit.

mod common;

use std::time::{Duration, Instant};

use common::{CUBE, CUBE_MTL, Folder};
use serde_json::Value;

fn cube(name: &str) -> Folder {
    let folder = Folder::new(name);
    folder.write("cube.obj", CUBE);
    folder.write("cube.mtl", CUBE_MTL);
    folder
}

/// Runs `command` with `--json`; what it printed.
fn object(folder: &Folder, command: &str) -> Value {
    let ran = folder.run(&format!("{command} --json"));
    assert!(ran.code == 0 || ran.code == 1, "{command}: {}", ran.stderr);
    serde_json::from_str(&ran.stdout).unwrap()
}

/// The peak is an estimate good to 10 % from 10⁴ elements on, where form factors are what they are predicted to be: rows to patches,
/// rows of rays without zeros, links to the error that their number is known for; and earlier where every entry is held.
#[cfg(target_os = "linux")]
#[test]
fn predicted_peaks_are_those_of_runs() {
    let folder = cube("predicted_peaks");
    let scenes = concat!(env!("CARGO_MANIFEST_DIR"), "/../../experiments/scenes/");
    for name in ["cornell_box.obj", "cornell_box.mtl"] {
        folder.write(name, &std::fs::read_to_string(format!("{scenes}{name}")).unwrap());
    }
    for command in [
        "solve cornell_box.obj --subdivide 24 --method analytic --patch-subdivide 1",
        "solve cornell_box.obj --subdivide 40 --rays 64 --patch-subdivide 2",
        "solve cornell_box.obj --subdivide 40 --method rays+emitters --rays 64 --patch-subdivide 2",
        "solve cornell_box.obj --subdivide 40 --rays 64 --store sparse",
        "solve cornell_box.obj --subdivide 40 --solver hierarchical --link-error 0.02",
        "solve cube.obj --subdivide 60 --rays 64 --patch-subdivide 4",
        "solve cube.obj --subdivide 30 --rays 64 --store dense",
        "solve cornell_box.obj --subdivide 16 --method analytic --store packed --thin-error 0.05",
        "solve cornell_box.obj --subdivide 16 --method analytic --store dense --thin-error 0.05",
    ] {
        let command = format!("{command} --threads 2");
        let predicted = object(&folder, &format!("{command} --dry-run"))["predicted"]["peak_bytes"].as_f64().unwrap();
        let taken = object(&folder, &format!("{command} --output out.csv"))["peak_bytes"].as_f64().unwrap();
        let ratio = predicted / taken;
        assert!((0.9..=1.1).contains(&ratio), "{command}: {predicted} bytes predicted, {taken} taken: {ratio}");
    }
}

/// The words of a refusal's message between its last semicolon and what follows the flags.
fn flags(message: &str, end: &str) -> String {
    let said = message.rsplit("; ").next().unwrap();
    said.split(end).next().unwrap().trim().to_owned()
}

/// Six faces of 500 × 500 elements: 18 TB of form factors with their zeros. What the message says instead is taken at its word.
#[test]
fn what_does_not_fit_is_refused_at_once_with_flags_that_run() {
    let folder = cube("refused_memory");
    let cases = [
        ("solve cube.obj --rays 16 --store dense", "--subdivide 500", "--memory 300M", " takes about", "--subdivide 3"),
        (
            "solve cube.obj --rays 16 --store dense",
            "--subdivide 40",
            "--memory 300M",
            " takes about",
            "--solver hierarchical",
        ),
        ("solve cube.obj", "--subdivide 500", "--memory 20M", " takes about", "--subdivide"),
        (
            "form-factors cube.obj --rays 16 --output F.npy",
            "--subdivide 500",
            "--memory 50M",
            " takes about",
            "--subdivide",
        ),
        ("compare cube.obj", "--subdivide 500", "--memory 400k", " fits", "--subdivide"),
    ];
    for (command, asked, memory, end, expected) in cases {
        let clock = Instant::now();
        let ran = folder.run(&format!("{command} {asked} {memory}"));
        let took = clock.elapsed();
        assert_eq!(ran.code, 2, "{command} {asked}: {}", ran.stdout);
        assert!(took < Duration::from_millis(500), "{command} {asked}: refused after {took:?}");
        assert!(ran.stderr.contains("of memory, and there are"), "{}", ran.stderr);
        let instead = flags(&ran.stderr, end);
        assert!(instead.contains(expected), "{command} {asked}: {instead}");
        // A flag given again takes the place of the one that was refused.
        let asked = if instead.contains("--subdivide") { "" } else { asked };
        let ran = folder.run(&format!("{command} {asked} {memory} {instead} --quiet"));
        assert!(ran.code == 0, "{command} {asked} {memory} {instead}: {}", ran.stderr);
    }
    assert!(!folder.files().contains(&"out.csv".to_owned()));
}

/// 150 elements: matrices factored for three bands do not fit beside the system, the iterative methods do.
#[test]
fn compare_leaves_out_what_does_not_fit_and_says_why() {
    let folder = cube("compare_memory");
    let object = object(&folder, "compare cube.obj --subdivide 5 --memory 600k --output comparison");
    let strategies = object["strategies"].as_array().unwrap();
    let left_out = |solver: &str| {
        let of = |s: &&Value| s["solver"] == solver && s["store"] == "dense";
        let analytic = strategies.iter().filter(of).find(|s| s["method"]["name"] == "analytic").unwrap();
        analytic["not_run"].as_str().map(ToOwned::to_owned)
    };
    assert!(left_out("direct").unwrap().contains("of memory"));
    assert_eq!(left_out("gauss-seidel"), None);
    assert!(folder.read("comparison/comparison.csv").contains("of memory"));
}

#[test]
fn a_limit_that_is_no_number_of_bytes_is_refused() {
    let folder = cube("no_bytes");
    for wrong in ["12x", "G", "-3", "nan", "0"] {
        let ran = folder.run(&format!("inspect cube.obj --memory={wrong}"));
        assert!(ran.code == 2 && ran.stderr.contains("500M"), "{wrong}: {}", ran.stderr);
    }
    for right in ["500M", "1.5G", "2e9", "1T"] {
        assert_eq!(folder.run(&format!("inspect cube.obj --memory {right}")).code, 0, "{right}");
    }
}
