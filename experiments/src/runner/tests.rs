//! Facts about running, resuming, drawing and checking.

use std::sync::atomic::Ordering;

use super::*;
use crate::testing::{Demo, End, Scratch};

fn request(scratch: &Scratch, resume: bool) -> Request {
    let (results, root) = (scratch.path().join("results"), scratch.path().to_path_buf());
    Request { profile: Profile::Tiny, results, root, resume, progress: false }
}

fn files(directory: &Path) -> Vec<String> {
    let entries = fs::read_dir(directory).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = entries.collect();
    names.sort();
    names
}

#[test]
fn a_run_leaves_tables_manifest_figures_and_pictures() {
    let scratch = Scratch::new();
    let request = request(&scratch, false);
    let State::Done(manifest) = run(&Demo::new(End::Well), &request) else { panic!("the demo runs") };
    assert_eq!((manifest.runs, manifest.failed, manifest.pictures.len()), (3, 2, 1));
    let expected = ["counts.csv", "error.png", "error.svg", "grey.png", "run.json", "times.csv"];
    assert_eq!(files(&request.results.join("09-demo")), expected);
    assert_eq!(files(&request.results), ["09-demo"]);
    assert_eq!(Manifest::read(&request.results.join("09-demo")), Some(manifest));
}

/// All but `times.csv` and the seconds in `run.json`, which this demo keeps equal as well.
#[test]
fn two_runs_give_the_same_bytes() {
    let (a, b) = (Scratch::new(), Scratch::new());
    for scratch in [&a, &b] {
        assert!(matches!(run(&Demo::new(End::Well), &request(scratch, false)), State::Done(_)));
    }
    for name in ["counts.csv", "times.csv", "error.svg", "error.png", "grey.png"] {
        let read = |scratch: &Scratch| fs::read(scratch.path().join("results/09-demo").join(name)).unwrap();
        assert_eq!(read(&a), read(&b), "{name}");
    }
}

#[test]
fn an_experiment_that_ends_badly_leaves_earlier_results_untouched() {
    let scratch = Scratch::new();
    let request = request(&scratch, false);
    run(&Demo::new(End::Well), &request);
    let counts = request.results.join("09-demo/counts.csv");
    let before = fs::read(&counts).unwrap();
    for (end, text) in [(End::Error, "the scene is empty"), (End::Panic, "panicked: index 7 of 3")] {
        let demo = Demo { value: 0.5, ..Demo::new(end) };
        assert_eq!(run(&demo, &request), State::Failed(text.into()));
        assert_eq!(fs::read(&counts).unwrap(), before);
        assert_eq!(files(&request.results), ["09-demo"]);
    }
}

#[test]
fn resume_keeps_what_is_complete_under_the_same_profile() {
    let scratch = Scratch::new();
    let demo = Demo::new(End::Well);
    run(&demo, &request(&scratch, true));
    assert!(matches!(run(&demo, &request(&scratch, true)), State::Kept(_)));
    assert_eq!(demo.runs.load(Ordering::Relaxed), 1);
    let quick = Request { profile: Profile::Quick, ..request(&scratch, true) };
    assert!(matches!(run(&demo, &quick), State::Done(_)));
    assert!(matches!(run(&demo, &request(&scratch, false)), State::Done(_)));
    assert_eq!(demo.runs.load(Ordering::Relaxed), 3);
}

#[test]
fn resume_does_not_keep_an_incomplete_run() {
    let scratch = Scratch::new();
    let demo = Demo::new(End::Well);
    run(&demo, &request(&scratch, false));
    let path = scratch.path().join("results/09-demo/run.json");
    let text = fs::read_to_string(&path).unwrap().replace("\"complete\": true", "\"complete\": false");
    fs::write(&path, text).unwrap();
    assert!(matches!(run(&demo, &request(&scratch, true)), State::Done(_)));
}

#[test]
fn figures_are_redrawn_from_the_tables_alone() {
    let scratch = Scratch::new();
    let request = request(&scratch, false);
    let demo = Demo::new(End::Well);
    run(&demo, &request);
    let directory = request.results.join("09-demo");
    let before = fs::read(directory.join("error.svg")).unwrap();
    fs::remove_file(directory.join("error.svg")).unwrap();
    fs::write(directory.join("old.svg"), "").unwrap();
    assert_eq!(redraw(&[&demo], &request.results).unwrap(), ["09-demo"]);
    assert_eq!(fs::read(directory.join("error.svg")).unwrap(), before);
    assert!(!directory.join("old.svg").exists() && directory.join("grey.png").exists());
    assert_eq!(demo.runs.load(Ordering::Relaxed), 1);
}

#[test]
fn the_page_tells_everything_and_loads_only_what_lies_beside_it() {
    let scratch = Scratch::new();
    let request = request(&scratch, false);
    let demo = Demo::new(End::Well);
    run(&demo, &request);
    let page = fs::read_to_string(write_page(&[&demo], &request.results).unwrap()).unwrap();
    for part in [
        "Is 1 &lt; 2 &amp; 2 &gt; 1?",
        "The least error is 0.041666666666666664.",
        "<img src=\"09-demo/error.svg\"",
        "src=\"09-demo/grey.png\"",
        "A grey picture",
        "nothing &lt; everything",
        "2 of 3 runs failed or were stopped early",
        "href=\"09-demo/counts.csv\"",
        "rustc",
    ] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("src=\"http") && !page.contains("@import") && !page.contains("<script"));
}

#[test]
fn golden_counts_are_made_by_update_and_catch_a_change() {
    let scratch = Scratch::new();
    let request = request(&scratch, false);
    let golden = scratch.path().join("golden");
    let demo = Demo::new(End::Well);
    run(&demo, &request);
    let missing = check(&demo, &request.results, &golden, false).unwrap_err().to_string();
    assert!(missing.contains("--update"), "{missing}");
    assert!(check(&demo, &request.results, &golden, true).unwrap().is_empty());
    assert!(check(&demo, &request.results, &golden, false).unwrap().is_empty());
    // 1e-8 relative in all three errors.
    run(&Demo { value: 0.125 * (1.0 + 1e-8), ..Demo::new(End::Well) }, &request);
    assert_eq!(check(&demo, &request.results, &golden, false).unwrap().len(), 3);
}
