//! Facts about choosing a strategy on the command line.

mod common;

use common::Folder;
use serde_json::Value;

/// A closed cube of which one face shines.
const CUBE: &str = "mtllib cube.mtl\n\
    v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
    usemtl grey\nf 1 2 3 4\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\nusemtl lamp\nf 5 8 7 6\n";

fn cube(name: &str) -> Folder {
    let folder = Folder::new(name);
    folder.write("cube.obj", CUBE);
    folder.write("cube.mtl", "newmtl grey\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 1 1 1\n");
    folder
}

fn object(folder: &Folder, command: &str) -> Value {
    let ran = folder.run(command);
    assert_eq!(ran.code, 0, "{}", ran.stderr);
    serde_json::from_str(&ran.stdout).unwrap()
}

#[test]
fn predictions_stand_beside_what_happened() {
    let folder = cube("choice_json");
    let choice = &object(&folder, "solve cube.obj --tolerance 0.02 --json")["choice"];
    let ranking = choice["ranking"].as_array().unwrap();
    assert!(ranking.len() > 5 && ranking.len() <= 12);
    assert_eq!((&choice["chosen"], &ranking[0]["why_not"]), (&ranking[0]["name"], &Value::Null));
    assert!(ranking[1..].iter().all(|r| r["why_not"] == "slower"), "{choice}");
    for of in ["seconds", "stored_bytes", "elements"] {
        let [predicted, measured] = ["predicted", "measured"].map(|which| choice[which][of].as_f64().unwrap());
        assert!(predicted > 0.0 && measured > 0.0);
    }
    assert!(choice["measured"]["error"].as_f64().unwrap() <= 0.02);
}

#[test]
fn the_ranking_is_explained_without_a_run() {
    let folder = cube("choice_explain");
    let ran = folder.run("solve cube.obj --tolerance 0.02 --dry-run");
    assert_eq!(ran.code, 0, "{}", ran.stderr);
    let names: Vec<&str> = ran.stdout.lines().skip(1).collect();
    assert!(names.len() > 5 && names[0].ends_with("chosen"), "{}", ran.stdout);
    assert!(names[1..].iter().all(|line| line.ends_with("slower")), "{}", ran.stdout);
    let explained = folder.run("solve cube.obj --tolerance 0.02 --explain").stdout;
    assert!(names.iter().all(|line| explained.contains(line)), "{explained}");
    // There is nothing to explain without something that is wanted.
    assert_eq!(folder.run("solve cube.obj --explain").code, 2);
}

#[test]
fn time_alone_is_a_budget_and_too_little_of_it_is_refused() {
    let folder = cube("choice_time");
    let done = object(&folder, "solve cube.obj --time 5 --json --dry-run");
    assert!(done["choice"]["tolerance"].as_f64().unwrap() < 0.02);
    assert!(done["choice"]["predicted"]["seconds"].as_f64().unwrap() <= 5.0);
    let refused = folder.run("solve cube.obj --tolerance 0.01 --time 1e-6");
    assert_eq!((refused.code, refused.stderr.lines().count()), (2, 1));
    assert!(refused.stderr.contains("nearest is '") && refused.stderr.contains("0.000001"), "{}", refused.stderr);
    assert_eq!(folder.run("solve cube.obj --time 1 --subdivide 4").code, 2);
}

#[test]
fn a_tolerance_by_links_counts_their_error() {
    let folder = cube("choice_links");
    let solve = |options: &str| -> (i32, Value) {
        let ran = folder.run(&format!("solve cube.obj --tolerance 0.004 --solver hierarchical --json {options}"));
        (ran.code, serde_json::from_str(&ran.stdout).unwrap_or(Value::Null))
    };
    // Faces that are asked for are refined without a choice.
    for options in ["", "--ask 0,1", "--link-error 0.002"] {
        let (code, done) = solve(options);
        let refinement = &done["refinement"];
        let [estimate, links] =
            [&refinement["estimate"], &done["links"]["estimated_error"]].map(|value| value.as_f64().unwrap());
        assert!(links > 0.0 && links < 0.004 && estimate > links, "{estimate}, of which {links}");
        assert_eq!((refinement["met"] == true, code == 0), (estimate <= 0.004, estimate <= 0.004));
        assert_eq!(refinement["steps"].as_array().unwrap().last().unwrap()["links_error"].as_f64(), Some(links));
    }
    // What is asked of links is kept, and says what it does not reach.
    assert_eq!(solve("--link-error 0.01").0, 2);
}

#[test]
fn a_solver_that_samples_is_not_chosen_for() {
    let folder = cube("choice_samples");
    let done = object(&folder, "solve cube.obj --tolerance 0.2 --solver stochastic --json");
    assert_eq!((&done["choice"], &done["solver"]), (&Value::Null, &"stochastic".into()));
    let refused = folder.run("solve cube.obj --time 1 --solver stochastic");
    assert_eq!((refused.code, refused.stderr.lines().count()), (2, 1), "{}", refused.stderr);
}

#[test]
fn time_that_runs_out_is_no_failure_where_no_tolerance_was_asked_for() {
    let folder = cube("choice_clock");
    // So few rays are noisier than expected: what the time is expected to allow is not met on any mesh.
    let done = object(&folder, "solve cube.obj --time 0.1 --method rays+emitters --rays 2 --store sparse --json");
    let (estimate, tolerance) = (&done["refinement"]["estimate"], &done["choice"]["tolerance"]);
    assert_eq!(done["refinement"]["met"], false);
    assert!(estimate.as_f64().is_none_or(|estimate| estimate > tolerance.as_f64().unwrap()), "{estimate}");
}

#[test]
fn a_forecast_is_refused_where_meshes_are_many() {
    let folder = cube("choice_forecast");
    for budget in ["--tolerance 0.1", "--time 1", "--tolerance 0.1 --time 1"] {
        let refused = folder.run(&format!("solve cube.obj --forecast {budget}"));
        assert_eq!((refused.code, refused.stderr.lines().count()), (2, 1), "{}", refused.stderr);
        assert!(refused.stderr.contains("--forecast"), "{}", refused.stderr);
    }
}

#[test]
fn a_comparison_at_a_tolerance_lists_predicted_and_measured() {
    let folder = cube("choice_compare");
    let done = object(&folder, "compare cube.obj --tolerance 0.05 --json");
    let strategies = done["strategies"].as_array().unwrap();
    assert_eq!(strategies.len(), done["choice"]["ranking"].as_array().unwrap().len());
    assert_eq!(folder.read("comparison/comparison.csv").lines().count(), strategies.len() + 1);
    let met = strategies.iter().filter(|s| s["met"] == true);
    assert!(met.clone().count() > 0);
    assert!(met.clone().all(|s| s["measured"]["seconds"].as_f64().unwrap() > 0.0));
}
