//! Reading the scene a command names, in the format its extension names.

use std::path::Path;

use radiosity_io::{
    Imported, ReadOptions, Role, View3dScene, read_geometry, read_scene, read_stl, read_stl_geometry, read_view3d,
    read_view3d_geometry,
};

use crate::Failure;
use crate::args::Common;

/// Formats of scenes.
#[derive(Clone, Copy)]
enum Format {
    Obj,
    View3d,
    Stl,
}

impl Format {
    /// By extension, upper or lower case; anything unknown is read as OBJ.
    fn of(path: &Path) -> Self {
        match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("vs3") => Self::View3d,
            Some("stl") => Self::Stl,
            _ => Self::Obj,
        }
    }
}

/// The scene with its materials.
pub fn with_materials(common: &Common) -> Result<Imported, Failure> {
    read_with_materials(&common.scene, common)
}

/// The scene with its materials, of which specular parts will count.
pub fn with_specular(common: &Common) -> Result<Imported, Failure> {
    read(&common.scene, common, true)
}

/// Another scene with its materials, read as `common` says.
pub fn read_with_materials(path: &Path, common: &Common) -> Result<Imported, Failure> {
    read(path, common, false)
}

fn read(path: &Path, common: &Common, specular: bool) -> Result<Imported, Failure> {
    let (clamp_reflectance, default_reflectance) = (common.clamp_reflectance, common.default_reflectance);
    let options = ReadOptions { clamp_reflectance, default_reflectance, specular };
    let imported = match Format::of(path) {
        Format::Obj => read_scene(path, &options)?,
        Format::View3d => read_view3d(path, &options)?.imported,
        Format::Stl => read_stl(path, &options)?,
    };
    warn(common, &imported);
    Ok(imported)
}

/// Faces of a scene and which of them are rows of form factors.
pub struct Faces {
    /// Faces, and what was met in the file.
    pub imported: Imported,
    /// Row of every face; faces of one row are taken together. `None`: the face blocks and has no row.
    pub rows: Vec<Option<usize>>,
    /// Emittance of every row, 1 where the file gives none.
    pub emittances: Vec<f64>,
    /// Whether every row of form factors should sum to 1: the file says so, or its edges do.
    pub closed: bool,
    /// Error of a form factor that the file asks for.
    pub tolerance: Option<f64>,
}

impl Faces {
    /// Every face is a row.
    fn all(imported: Imported) -> Self {
        let n = imported.scene.surfaces.len();
        let closed = imported.scene.closed();
        Self { imported, rows: (0..n).map(Some).collect(), emittances: vec![1.0; n], closed, tolerance: None }
    }

    /// Rows as the file defines them.
    fn of_view3d(view: View3dScene) -> Self {
        let closed = view.control.enclosure || view.imported.scene.closed();
        let mut emittances = Vec::new();
        for (k, row) in view.rows.iter().enumerate() {
            // The first surface of a row gives its emittance, as in View3D.
            if row.is_some_and(|row| row == emittances.len()) && view.roles[k] == Role::Radiating {
                emittances.push(view.emittances[k]);
            }
        }
        Self { closed, tolerance: view.control.tolerance, emittances, rows: view.rows, imported: view.imported }
    }
}

/// The scene's faces alone.
pub fn faces_only(common: &Common) -> Result<Faces, Failure> {
    let path = &common.scene;
    let faces = match Format::of(path) {
        Format::Obj => Faces::all(read_geometry(path)?),
        Format::View3d => Faces::of_view3d(read_view3d_geometry(path)?),
        Format::Stl => Faces::all(read_stl_geometry(path)?),
    };
    warn(common, &faces.imported);
    Ok(faces)
}

fn warn(common: &Common, imported: &Imported) {
    if !common.quiet {
        imported.report.warnings.iter().for_each(|warning| eprintln!("warning: {warning}"));
    }
}
