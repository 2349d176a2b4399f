//! Scenes and form factors in the formats of View3D (NIST, public domain).
//!
//! **Input (`.vs3`).** A line is a statement; its first letter, upper or lower case, says which. `!` begins a comment.
//!
//! | statement | here |
//! |---|---|
//! | `T` title | kept |
//! | `C` control | [`Control`]: `encl` and `eps`; words that would change the answer give warnings |
//! | `F 3`, `F 3a` | vertices and surfaces apart, or shapes (`R`, `Q`, `T`) with origin, azimuth and tilt; shapes under `F 3` are read with a warning |
//! | `V # x y z` | a vertex, by its number in any order |
//! | `S # v1 v2 v3 v4 base cmb emit name` | a radiating surface; v4 = 0 makes a triangle |
//! | `O # v1 v2 v3 v4` | an obstruction: it blocks (and absorbs) and has no row |
//! | `N # …` | a null surface: cut out of its base, blocks, has no row |
//! | `M` masks, `X` transformations, format 2 | refused with the line |
//! | `E`, `*` | the end; what follows is not read |
//!
//! `base` names the surface that this one is a part of, a window in a wall: it must lie in the plane of the base, face the same
//! way (a null surface the other) and lie inside, and is cut out of it, so that area and form factors of the base are those of
//! the rest. Subsurfaces of one base must not overlap; a subsurface may be a base in its turn. `cmb` names an earlier surface that
//! this one is combined with: both share the row of that one, with the sum of their areas; chains are refused as in View3D. `emit`
//! is the emittance ε and makes the reflectance ρ = 1 − ε.
//!
//! Numbers need not be in sequence. Faces may be concave or not planar; they are split inside. Surface k of the scene is the k-th
//! surface statement of any kind.
//!
//! **Output.** [`write_view3d`] writes View3D's text layout, [`read_view3d_factors`] reads it back.

mod assemble;
mod control;
mod fault;
mod output;
mod scan;
mod subsurface;
#[cfg(test)]
mod tests;
mod words;

use std::path::Path;

use crate::ReadError;
use crate::obj::{Imported, ReadOptions};

pub use control::Control;
pub use fault::View3dFault;
pub use output::{SavedView3d, View3dFactors, read_view3d_factors, write_view3d};

/// What a surface does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Sends, receives and blocks.
    Radiating,
    /// Blocks and absorbs; has no row.
    Obstruction,
    /// Cut out of its base; blocks and absorbs there, has no row.
    Null,
}

/// A View3D file.
#[derive(Clone, Debug, PartialEq)]
pub struct View3dScene {
    /// Text of the last title line.
    pub title: String,
    /// The control line.
    pub control: Control,
    /// The scene, surface k from the k-th surface statement, and what was met in the file.
    pub imported: Imported,
    /// What each surface does.
    pub roles: Vec<Role>,
    /// Row of each surface in the matrix of form factors, from 0; combined surfaces share one.
    pub rows: Vec<Option<usize>>,
    /// Emittance ε of each surface, 1 where the file gives none.
    pub emittances: Vec<f64>,
}

/// Reads a View3D file; reflectances are 1 − emittance and nothing emits.
///
/// # Errors
///
/// [`ReadError`], naming file and line, if the file cannot be read, a statement cannot be used, no surface has an area, or an
/// emittance of 0 makes a reflectance of 1 (unless [`ReadOptions::clamp_reflectance`] is given).
pub fn read_view3d(path: &Path, options: &ReadOptions) -> Result<View3dScene, ReadError> {
    assemble::assemble(path, scan::scan(path, &crate::obj::read(path)?)?, Some(options))
}

/// [`read_view3d`] with one black material for all surfaces: form factors need no other.
///
/// # Errors
///
/// As [`read_view3d`], but for reflectances.
pub fn read_view3d_geometry(path: &Path) -> Result<View3dScene, ReadError> {
    assemble::assemble(path, scan::scan(path, &crate::obj::read(path)?)?, None)
}
