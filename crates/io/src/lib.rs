//! Readers of scenes and writers of matrices, tables, meshes and images.
//!
//! Readers turn files of other people into values or into a [`ReadError`] that names file and line; they never panic on
//! what they read. Writers write to a temporary file beside the target and rename it, so a failed write leaves the old
//! file as it was. What is *not* here: JSON (the program writes it from the plain structs of this crate), textures, and
//! any decision about what to do with a scene.

mod atomic;
mod error;
pub mod exr;
pub mod matrix;
pub mod obj;
pub mod ply;
pub mod png;
pub mod stl;
pub mod table;
pub mod view3d;

pub use atomic::write_atomically;
pub use error::{ReadError, WriteError};
pub use exr::{LinearPicture, read_exr, write_exr};
pub use matrix::{Matrix, MatrixFormat, MatrixView, read_matrix, write_matrix};
pub use obj::{ImportReport, Imported, ReadOptions, Texture, read_geometry, read_scene};
pub use ply::{PlyFace, PlyTriangle, PlyVertex, write_ply, write_shaded_ply};
pub use png::write_png;
pub use stl::{StlFault, read_stl, read_stl_geometry};
pub use table::{SolutionRow, write_solution};
pub use view3d::{
    Control, Role, SavedView3d, View3dFactors, View3dFault, View3dScene, read_view3d, read_view3d_factors,
    read_view3d_geometry, write_view3d,
};
