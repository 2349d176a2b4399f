//! The invariants of the workspace that can be read off its files.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Crates that may touch files, the environment or the terminal.
const OUTSIDE: [&str; 4] = ["crates/io", "crates/cli", "crates/plot", "experiments"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Folders of all crates but the benches, relative to the workspace.
fn folders() -> Vec<String> {
    let crates = fs::read_dir(root().join("crates")).unwrap().map(|entry| entry.unwrap().file_name());
    let mut folders: Vec<String> = crates.map(|name| format!("crates/{}", name.to_str().unwrap())).collect();
    folders.push("experiments".to_owned());
    folders.sort();
    folders
}

/// Names of the crates of ours in the section `[dependencies]` of every manifest, by the name of its crate.
fn dependencies() -> BTreeMap<String, Vec<String>> {
    let mut all = BTreeMap::new();
    for folder in folders() {
        let manifest = fs::read_to_string(root().join(&folder).join("Cargo.toml")).unwrap();
        let (mut section, mut name, mut ours) = (String::new(), String::new(), Vec::new());
        for line in manifest.lines().map(str::trim) {
            if line.starts_with('[') {
                section = line.to_owned();
            } else if section == "[package]" && line.starts_with("name") {
                name = line.split('"').nth(1).unwrap().to_owned();
            } else if section == "[dependencies]" && line.starts_with("radiosity") {
                ours.push(line.split(['.', ' ', '=']).next().unwrap().to_owned());
            }
        }
        assert!(!name.is_empty(), "{folder} has no name");
        all.insert(name, ours);
    }
    all
}

/// What `from` reaches through normal dependencies.
fn reached(all: &BTreeMap<String, Vec<String>>, from: &str) -> Vec<String> {
    let (mut reached, mut next) = (Vec::new(), all[from].clone());
    while let Some(name) = next.pop() {
        if !reached.contains(&name) {
            next.extend(all[&name].iter().cloned());
            reached.push(name);
        }
    }
    reached.sort();
    reached
}

#[test]
fn core_depends_on_no_crate_of_ours() {
    assert_eq!(dependencies()["radiosity-core"], [""; 0]);
}

#[test]
fn solvers_reach_core_and_nothing_else_of_ours() {
    assert_eq!(reached(&dependencies(), "radiosity-solvers"), ["radiosity-core"]);
}

#[test]
fn the_facade_reaches_no_crate_that_touches_files() {
    let reached = reached(&dependencies(), "radiosity");
    assert_eq!(
        reached,
        ["radiosity-core", "radiosity-form-factors", "radiosity-geometry", "radiosity-render", "radiosity-solvers"]
            .map(str::to_owned)
    );
}

/// Geometry, core, form factors, facade: types to the right of the flow never point back to the left.
#[test]
fn no_crate_depends_on_one_that_depends_on_it() {
    let all = dependencies();
    for name in all.keys() {
        assert!(!reached(&all, name).contains(name), "{name} reaches itself");
    }
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn only_the_outer_crates_touch_files_the_environment_or_the_terminal() {
    let outside = ["std::fs", "std::env", "fs::", "env::var", "File::", "println!", "print!", "dbg!", "std::process"];
    let mut looked_at = 0;
    for folder in folders().iter().filter(|folder| !OUTSIDE.contains(&folder.as_str())) {
        let mut files = Vec::new();
        sources(&root().join(folder).join("src"), &mut files);
        for file in files {
            let text = fs::read_to_string(&file).unwrap();
            for (k, line) in text.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with("//")) {
                let found = outside.iter().find(|word| line.contains(*word));
                assert_eq!(found, None, "{}:{}: {line}", file.display(), k + 1);
            }
            looked_at += 1;
        }
    }
    // A wrong path would make this test pass: there are some tens of files.
    assert!(looked_at > 30, "only {looked_at} files found");
}
