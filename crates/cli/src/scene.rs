//! Reading the scene a command names.

use radiosity_io::{Imported, ReadOptions, read_geometry, read_scene};

use crate::Failure;
use crate::args::Common;

/// The scene with its materials.
pub fn with_materials(common: &Common) -> Result<Imported, Failure> {
    let options =
        ReadOptions { clamp_reflectance: common.clamp_reflectance, default_reflectance: common.default_reflectance };
    let imported = read_scene(&common.scene, &options)?;
    warn(common, &imported);
    Ok(imported)
}

/// The scene's faces alone.
pub fn faces_only(common: &Common) -> Result<Imported, Failure> {
    let imported = read_geometry(&common.scene)?;
    warn(common, &imported);
    Ok(imported)
}

fn warn(common: &Common, imported: &Imported) {
    if !common.quiet {
        imported.report.warnings.iter().for_each(|warning| eprintln!("warning: {warning}"));
    }
}
