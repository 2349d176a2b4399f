//! How much memory a command may take, and what to ask for instead where that is too little.

use std::fs::read_to_string;

use radiosity::{Alternative, Bytes, Change, RunError, Store};
use radiosity_geometry::mesh::Subdivision;

use crate::Failure;
use crate::args::Common;

/// What threads and the work of any command take beside the scene.
const PROGRAM: u64 = 4_000_000;

/// Bytes that a command may take: those asked for, or what the machine has left; `None` where the system does not say.
pub fn limit(common: &Common) -> Option<u64> {
    common.memory.or_else(available)
}

/// Bytes that the program takes itself once the scene is read.
pub fn program() -> u64 {
    crate::output::peak_bytes().unwrap_or(0) + PROGRAM
}

/// Memory that is free or can be freed, of the machine and of the group of processes that this one is in.
fn available() -> Option<u64> {
    let machine = read_to_string("/proc/meminfo").ok().and_then(|text| {
        let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
        line.trim().strip_suffix("kB")?.trim().parse().ok().map(|kilobytes: u64| 1024 * kilobytes)
    });
    let number = |path: &str| read_to_string(path).ok()?.trim().parse::<u64>().ok();
    let left = |limit: &str, used: &str| Some(number(limit)?.saturating_sub(number(used).unwrap_or(0)));
    let group = left("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current")
        .or_else(|| left("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"));
    machine.into_iter().chain(group).min()
}

/// A number of bytes with a suffix k, M, G or T, each a thousand times the one before.
pub fn parse(text: &str) -> Result<u64, String> {
    let wrong = || "must be a number of bytes such as 500M, 1.5G or 2e9".to_owned();
    let unit = text.chars().last().and_then(|last| match last.to_ascii_lowercase() {
        'k' => Some(1e3),
        'm' => Some(1e6),
        'g' => Some(1e9),
        't' => Some(1e12),
        _ => None,
    });
    let number = if unit.is_some() { &text[..text.len() - 1] } else { text };
    let bytes = number.parse::<f64>().map_err(|_| wrong())? * unit.unwrap_or(1.0);
    if bytes >= 1.0 && bytes < u64::MAX as f64 { Ok(bytes as u64) } else { Err(wrong()) }
}

/// An error of a run for people: where memory is short, with the flags that ask for what fits.
pub fn explained(error: RunError) -> Failure {
    let RunError::Memory { needed, limit, alternative } = error else { return error.into() };
    let instead = match alternative.as_deref() {
        Some(Alternative { change, prediction, .. }) => {
            format!("{} takes about {}", flags(change), Bytes(prediction.peak_bytes))
        }
        None => "a coarser mesh takes less".to_owned(),
    };
    format!("this takes about {} of memory, and there are {}; {instead}", Bytes(needed), Bytes(limit)).into()
}

/// The flags that make a change.
fn flags(change: &Change) -> String {
    match change {
        Change::Packed(Store::PackedSingle) => "--store packed-f32".to_owned(),
        Change::Packed(_) => "--store packed".to_owned(),
        Change::Links => "--method analytic --solver hierarchical".to_owned(),
        Change::SparseRays => "--method ray-cast --store sparse --solver gauss-seidel".to_owned(),
        Change::RaysOnDemand => "--method ray-cast --store on-demand --solver shooting".to_owned(),
        Change::Coarser(Subdivision::Uniform(k)) => format!("--subdivide {k}"),
        Change::Coarser(Subdivision::EdgeLength(h)) => format!("--element-size {h}"),
    }
}
