//! Scenes: surfaces with materials, before any subdivision.

use glam::DVec3;

use crate::{Polygon, Specular, polygon::bounds};

/// A material: a diffuse reflectance and an emission for every band, and what else it does to light.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name in the file.
    pub name: String,
    /// Diffuse reflectance ρ of every band, in [0, 1).
    pub reflectance: Vec<f64>,
    /// Emission E of every band in W/m².
    pub emission: Vec<f64>,
    /// What it does to light beside reflecting it diffusely.
    pub specular: Option<Specular>,
}

impl Material {
    /// A diffuse material.
    pub fn diffuse(name: &str, reflectance: Vec<f64>, emission: Vec<f64>) -> Self {
        Self { name: name.to_owned(), reflectance, emission, specular: None }
    }
}

/// One face of the scene: a single surface to its user, whatever it is split into inside.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Name of the object or group, for messages.
    pub name: String,
    /// Line of the file, 0 if there is none.
    pub line: usize,
    /// Index of its material.
    pub material: usize,
    /// Convex planar pieces: one for a convex planar face, triangles for a concave or non-planar one.
    pub pieces: Vec<Polygon>,
}

impl Surface {
    /// Sum of the areas of the pieces.
    pub fn area(&self) -> f64 {
        self.pieces.iter().map(Polygon::area).sum()
    }
}

/// Surfaces and materials.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Surfaces in file order.
    pub surfaces: Vec<Surface>,
    /// Materials.
    pub materials: Vec<Material>,
}

/// Why a scene cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// No surface with an area.
    #[error("the scene has no surface with an area")]
    Empty,
    /// Materials with different numbers of bands.
    #[error("material '{name}' has {has} bands, the first one {needs}")]
    Bands {
        /// The material.
        name: String,
        /// Its bands.
        has: usize,
        /// Bands of the first.
        needs: usize,
    },
}

impl Scene {
    /// A scene of surfaces and materials.
    ///
    /// # Errors
    ///
    /// [`SceneError`] if there is no surface or the materials differ in their number of bands.
    ///
    /// # Panics
    ///
    /// If a surface names a material that is not in the list.
    pub fn new(surfaces: Vec<Surface>, materials: Vec<Material>) -> Result<Self, SceneError> {
        if surfaces.iter().all(|s| s.pieces.is_empty()) {
            return Err(SceneError::Empty);
        }
        for s in &surfaces {
            assert!(s.material < materials.len(), "material {} of {}", s.material, materials.len());
        }
        let needs = materials[0].reflectance.len();
        for m in &materials {
            for has in [Some(m.reflectance.len()), Some(m.emission.len()), m.specular.as_ref().map(Specular::bands)]
                .into_iter()
                .flatten()
            {
                if has != needs {
                    return Err(SceneError::Bands { name: m.name.clone(), has, needs });
                }
            }
        }
        Ok(Self { surfaces, materials })
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.materials[0].reflectance.len()
    }

    /// Whether a surface does anything but emit and reflect diffusely.
    pub fn is_specular(&self) -> bool {
        self.surfaces.iter().any(|s| self.materials[s.material].specular.is_some())
    }

    /// The convex pieces of all surfaces with the index of their surface.
    pub fn pieces(&self) -> impl Iterator<Item = (usize, &Polygon)> + '_ {
        self.surfaces.iter().enumerate().flat_map(|(s, surface)| surface.pieces.iter().map(move |p| (s, p)))
    }

    /// Smallest and largest corner.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        bounds(self.pieces().flat_map(|(_, p)| p.vertices().iter().copied()))
    }

    /// Length of the diagonal of the box around the scene: the length that relative tolerances refer to.
    pub fn diagonal(&self) -> f64 {
        let (lo, hi) = self.bounds();
        (hi - lo).length()
    }

    /// Sum of all areas.
    pub fn area(&self) -> f64 {
        self.surfaces.iter().map(Surface::area).sum()
    }
}
