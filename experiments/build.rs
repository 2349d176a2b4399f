//! Tells the program how it was built: `run.json` records it beside every result.

use std::env;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let compiler = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let version = Command::new(compiler).arg("--version").output().ok().filter(|output| output.status.success());
    let version = version.and_then(|output| String::from_utf8(output.stdout).ok()).unwrap_or_default();
    println!("cargo::rustc-env=BUILD_COMPILER={}", version.trim());
    for (name, variable) in [
        ("BUILD_TARGET", "TARGET"),
        ("BUILD_OPTIMISATION", "OPT_LEVEL"),
        ("BUILD_FEATURES", "CARGO_CFG_TARGET_FEATURE"),
    ] {
        println!("cargo::rustc-env={name}={}", env::var(variable).unwrap_or_default());
    }
}
