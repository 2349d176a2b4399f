//! `radiosity solve`: radiosity and irradiance of every element or report cell.

mod after;
mod asked;
mod by_choice;
mod files;
mod from_file;
mod from_scene;
mod predicted;
mod refinement;
mod report;

use std::path::Path;

use radiosity::plan::StoreReason;
use radiosity::{Choice, Phase, Saving, SpecularBy};
use radiosity_form_factors::extended::SpecularBounces;
use radiosity_form_factors::repair::RepairError;

use crate::args::SolveArgs;
use crate::choice::Happened;
use crate::{Failure, Verdict, scene};
use files::format_of;
use refinement::Refinement;

pub use asked::{admitted_mesh, mesh_settings, sizes, strategy};

/// Largest number of elements that `--tolerance` refines to.
pub const MOST_ELEMENTS: usize = 40_000;

/// Cells of the report grid that a tolerance is of, if none is asked for.
pub const REPORT_GRID: u32 = 8;
/// The solver that stands for the hierarchical store.
pub const HIERARCHICAL: &str = "hierarchical";

/// Rays of a row of form factors by way of specular surfaces.
pub const SPECULAR_RAYS: u32 = 4096;

/// How a solution was come by.
enum Way<'a> {
    /// By one run, in a store that was chosen for this reason if none was asked for.
    Straight(Option<StoreReason>),
    /// By one run with light by way of specular surfaces, whose form factors took so much.
    Enhanced(SpecularBy, Phase),
    /// By refinement to a tolerance.
    Refined(Refinement),
    /// By the strategy that was chosen.
    Chosen(Box<Choice>, Happened, Refinement),
    /// From the solution of another scene, which took so many seconds.
    After { path: &'a Path, seconds: f64, saving: Saving },
}

/// Runs the command.
pub fn run(args: &SolveArgs) -> Result<Verdict, Failure> {
    if let Some(path) = args.output.as_deref() {
        format_of(path)?;
    }
    if args.forecast && (args.tolerance.is_some() || args.time.is_some()) {
        return Err("a forecast is of one system, and --tolerance and --time make many; leave out --forecast".into());
    }
    let specular = args.specular_bounces != SpecularBounces::None;
    let imported = if specular { scene::with_specular(&args.common)? } else { scene::with_materials(&args.common)? };
    let scene = &imported.scene;
    if args.repair && !scene.closed() {
        return Err(RepairError::Open.into());
    }
    match (&args.form_factors, &args.after) {
        (Some(path), _) => from_file::on_saved(args, &imported, path),
        (None, Some(before)) => after::after_change(args, &imported, before),
        (None, None) => from_scene::on_computed(args, &imported),
    }
}
