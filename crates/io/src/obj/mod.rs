//! Scenes from Wavefront OBJ files and their material libraries, as they are found in the wild.
//!
//! **Faces.** Every `f` line is one surface, in file order: surface k is face k, whatever happens to it. A convex planar
//! face stays one polygon; a concave or non-planar one is split into convex pieces inside. A face without an area, and one
//! that repeats an earlier face the same way round, is dropped by leaving its list of pieces empty: it keeps its index, has
//! no area, and its row and column of form factors are 0. A sheet given once each way round keeps both sides.
//!
//! **Materials.** `Kd` is the reflectance ρ, `Ke` the radiance L in W/(m² sr); a diffuse emitter of radiance L has the
//! emission E = π·L in W/m². Three bands. Mirrors, glass, metal and lobes are read as `optics.rs` says; textures and `d` are left out, and all
//! are named in the report. ρ ≥ 1 and Kd + Ks > 1 are refused, or scaled down where [`ReadOptions::clamp_reflectance`] allows it.
//!
//! Geometry is scanned line by line here so that errors name lines; materials are read by `tobj`, see `library.rs`. What is *not*
//! here: normals and texture coordinates (not needed), curves and free-form surfaces (named in the report).

pub(crate) mod assemble;
pub(crate) mod library;
mod lines;
mod optics;

mod report;
pub(crate) mod scan;
#[cfg(test)]
mod tests;
pub(crate) mod topology;

use std::path::Path;

use radiosity_geometry::Scene;

use crate::ReadError;
use library::Library;
pub(crate) use scan::LARGEST;
use scan::Raw;

pub use report::{ImportReport, Texture};

/// What to do where a file's materials cannot be used as they are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// Scale materials with ρ ≥ 1 or Kd + Ks > 1 down instead of refusing them, to ρ of at most this; in [0, 1).
    ///
    /// `Kd` and `Ks` of a material are scaled by one factor for all bands, the largest with which Kd ≤ this value and
    /// Kd + Ks ≤ 1 in every band: the hue stays, and so does the share of the diffuse part.
    pub clamp_reflectance: Option<f64>,
    /// Reflectance of faces whose material is not defined, instead of refusing them; in [0, 1).
    pub default_reflectance: Option<f64>,
    /// Whether specular parts will count, so that none needs a warning.
    pub specular: bool,
}

/// A scene and what was met in its file.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// The scene; surface k is face k of the file.
    pub scene: Scene,
    /// Counts and warnings.
    pub report: ImportReport,
}

/// Reads an OBJ file and the material libraries it names.
///
/// # Errors
///
/// [`ReadError`], naming file and line, if a file cannot be read, a coordinate or index is wrong, no face has an area, a
/// material is not defined (unless a default is given), a colour is negative or no number, or a material reflects more
/// than it receives (unless a clamp is given).
pub fn read_scene(path: &Path, options: &ReadOptions) -> Result<Imported, ReadError> {
    for (option, value) in
        [("--clamp-reflectance", options.clamp_reflectance), ("--default-reflectance", options.default_reflectance)]
    {
        if let Some(value) = value.filter(|v| !(0.0..1.0).contains(v)) {
            return Err(ReadError::Setting { option, value });
        }
    }
    let raw = scan::scan(path, &read(path)?)?;
    let mut report = ImportReport::default();
    let library = libraries(path, &raw, &mut report)?;
    assemble::assemble(path, raw, Some((&library, options)), report)
}

/// Reads the faces of an OBJ file and gives all of them one black material: form factors need no other.
///
/// Material libraries are not opened, so nothing in them can be wrong.
///
/// # Errors
///
/// [`ReadError`], naming file and line, if the file cannot be read, a coordinate or index is wrong, or no face has an area.
pub fn read_geometry(path: &Path) -> Result<Imported, ReadError> {
    let raw = scan::scan(path, &read(path)?)?;
    assemble::assemble(path, raw, None, ImportReport::default())
}

pub(crate) fn read(path: &Path) -> Result<Vec<u8>, ReadError> {
    std::fs::read(path).map_err(|source| ReadError::File { path: path.to_owned(), source })
}

/// Reads the libraries that `mtllib` lines name, each once, beside the OBJ file.
fn libraries(path: &Path, raw: &Raw, report: &mut ImportReport) -> Result<Library, ReadError> {
    let mut library = Library::default();
    let mut read_already = Vec::new();
    for (_, named) in &raw.libraries {
        // A name may hold blanks, or the line may list several files.
        let names: Vec<&str> = match library::beside(path, named) {
            Some(_) => vec![named],
            None => named.split_whitespace().collect(),
        };
        for name in names {
            match library::beside(path, name) {
                Some(file) if read_already.contains(&file) => {}
                Some(file) => {
                    library.add(&file, &read(&file)?)?;
                    read_already.push(file);
                }
                None if report.libraries_not_found.iter().any(|known| known == name) => {}
                None => report.libraries_not_found.push(name.to_owned()),
            }
        }
    }
    Ok(library)
}
