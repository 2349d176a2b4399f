//! Facts about the command line.

use std::sync::atomic::Ordering;

use super::*;
use crate::testing::{Demo, End, Scratch};

fn call(demo: &Demo, arguments: &[&str]) -> u8 {
    execute(&[demo], ["experiments"].iter().chain(arguments).copied())
}

#[test]
fn a_wrong_name_or_flag_ends_with_2_and_touches_nothing() {
    let scratch = Scratch::new();
    let results = scratch.path().join("results");
    let directory = results.to_str().unwrap();
    let demo = Demo::new(End::Well);
    for arguments in [
        &["run", "patches", "--results", directory][..],
        &["run", "", "--results", directory],
        &["run", "--profile", "huge", "--results", directory],
        &["run", "--threads", "0", "--results", directory],
        &["run", "--update", "--results", directory],
        &["run", "--fast", "--results", directory],
        &["plot", "--results", directory],
        &["draw"],
    ] {
        assert_eq!(call(&demo, arguments), 2, "{arguments:?}");
    }
    assert_eq!(demo.runs.load(Ordering::Relaxed), 0);
    assert!(!results.exists());
}

#[test]
fn an_experiment_is_found_by_name_number_or_slug() {
    let demo = Demo::new(End::Well);
    let all: [&dyn Experiment; 1] = [&demo];
    for name in ["09-demo", "09", "demo"] {
        assert_eq!(choose(&all, &[name.into(), "demo".into()]).map(|chosen| chosen.len()), Ok(1));
    }
    assert_eq!(choose(&all, &["dem".into()]).map(|chosen| chosen.len()), Err("dem".into()));
}

#[test]
fn exit_codes_tell_done_from_changed_and_failed() {
    let scratch = Scratch::new();
    let [results, golden] = ["results", "golden"].map(|name| scratch.path().join(name).to_str().unwrap().to_string());
    let run = ["run", "--profile", "tiny", "--no-progress", "--results", &results, "--check", &golden];
    let demo = Demo::new(End::Well);
    assert_eq!(call(&demo, &run), 1, "no golden counts yet");
    assert_eq!(call(&demo, &[&run[..], &["--update"]].concat()), 0);
    assert_eq!(call(&demo, &run), 0);
    assert_eq!(call(&Demo { value: 0.25, ..Demo::new(End::Well) }, &run), 1);
    assert_eq!(call(&Demo::new(End::Panic), &run), 1);
    assert_eq!(call(&demo, &["plot", "--results", &results]), 0);
    assert_eq!(call(&demo, &["list"]), 0);
    assert_eq!(call(&demo, &["--help"]), 0);
}
