//! Polygons, scenes, meshes of patches and elements, and visibility queries.
//!
//! Lengths share any one unit; no tolerance is absolute, so scaling, moving or rotating a scene changes nothing beyond
//! rounding. What is *not* here: files (see `radiosity-io`) and form factors (see `radiosity-form-factors`).

mod closed;
pub mod facets;
pub mod mesh;
pub mod occlusion;
pub mod optics;
pub mod polygon;
pub mod replace;
pub mod scene;
#[cfg(test)]
mod testing;
pub mod triangulate;

pub use facets::Facets;
pub use mesh::{Element, Mesh, MeshError, MeshSettings, MeshSize, Piece, ReportCell, ReportGrid, Subdivision};
pub use occlusion::{Hit, Occluders, blocking_polygons};
pub use optics::{Scatter, Specular};
pub use polygon::{Polygon, PolygonError};
pub use replace::{Change, CompareError, Disturbed, FacetMap, SceneChange};
pub use scene::{Material, Scene, SceneError, Surface};
pub use triangulate::{FaceKind, convex_pieces};
