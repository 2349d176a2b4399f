//! What a result was made on and with: processor, memory, compiler, versions, commit.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use serde::{Deserialize, Serialize};

/// Libraries whose version can move a number.
const LIBRARIES: [&str; 6] = ["faer", "glam", "obvhs", "rayon", "sobol_burley", "sprs"];

/// Machine, compiler and source of a run. Nothing here depends on when it was made.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    /// Model of the processor; empty if the system does not tell.
    pub processor: String,
    /// Threads the processor runs at once for this program.
    pub cores: usize,
    /// Memory in bytes; 0 if the system does not tell.
    pub memory_bytes: u64,
    /// Processor family and system the program was built for.
    pub target: String,
    /// Compiler and its version.
    pub compiler: String,
    /// Level of optimisation.
    pub optimisation: String,
    /// Instruction sets the whole program was built for; kernels that choose at run time may use more.
    pub target_features: String,
    /// Version of this workspace.
    pub version: String,
    /// Versions of the libraries that compute.
    pub libraries: BTreeMap<String, String>,
    /// Commit of the source; empty outside of a repository.
    pub commit: String,
    /// Whether the source differed from the commit.
    pub modified: bool,
}

impl Machine {
    /// Looks at this machine and at the source in `root`.
    pub fn here(root: &Path) -> Self {
        let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
        let processor = field(&read("/proc/cpuinfo"), "model name").unwrap_or_default();
        let kibibytes = field(&read("/proc/meminfo"), "MemTotal")
            .and_then(|value| value.split_whitespace().next()?.parse::<u64>().ok());
        let lock = std::fs::read_to_string(root.join("Cargo.lock")).unwrap_or_default();
        // Results are written by this program, so they do not count as a change of the source.
        let changes = git(root, &["status", "--porcelain", "--", ".", ":(exclude)results"]);
        Self {
            processor,
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            memory_bytes: kibibytes.unwrap_or(0) * 1024,
            target: env!("BUILD_TARGET").into(),
            compiler: env!("BUILD_COMPILER").into(),
            optimisation: env!("BUILD_OPTIMISATION").into(),
            target_features: env!("BUILD_FEATURES").into(),
            version: env!("CARGO_PKG_VERSION").into(),
            libraries: versions(&lock),
            commit: git(root, &["rev-parse", "HEAD"]).unwrap_or_default(),
            modified: changes.is_some_and(|changes| !changes.is_empty()),
        }
    }
}

/// Value of the first line `name : value`.
fn field(text: &str, name: &str) -> Option<String> {
    let line = text.lines().find(|line| line.split(':').next().map(str::trim) == Some(name))?;
    Some(line.split_once(':')?.1.trim().into())
}

/// What a git command prints; `None` if there is no git or no repository.
fn git(root: &Path, arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").arg("-C").arg(root).args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_string())
}

/// Versions of [`LIBRARIES`] in a lock file; several of one library are all named.
fn versions(lock: &str) -> BTreeMap<String, String> {
    let quoted = |line: &str| line.split('"').nth(1).unwrap_or_default().to_string();
    let mut versions: BTreeMap<String, String> = BTreeMap::new();
    let mut name = String::new();
    for line in lock.lines() {
        if line.starts_with("name = ") {
            name = quoted(line);
        } else if line.starts_with("version = ") && LIBRARIES.contains(&&*name) {
            let entry = versions.entry(name.clone()).or_default();
            let separator = if entry.is_empty() { "" } else { ", " };
            entry.push_str(separator);
            entry.push_str(&quoted(line));
        }
    }
    versions
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_come_from_the_lock_file() {
        let lock = "version = 4\n[[package]]\nname = \"faer\"\nversion = \"0.24.4\"\n[[package]]\nname = \"csv\"\nversion = \"1.4.0\"\n";
        assert_eq!(versions(lock), BTreeMap::from([("faer".to_string(), "0.24.4".to_string())]));
    }

    #[test]
    fn a_field_is_found_by_its_whole_name() {
        let text = "model\t\t: 17\nmodel name\t: Some CPU @ 3:1\n";
        assert_eq!(field(text, "model name").as_deref(), Some("Some CPU @ 3:1"));
        assert_eq!(field(text, "name"), None);
    }
}
