//! Radiosity that is linear inside elements, for pictures and for gathering at points.

use glam::DVec3;
use radiosity_core::BandValues;
use radiosity_geometry::mesh::{Place, Reconstruction};
use radiosity_render::Field;

use crate::Geometry;

/// Irradiance reconstructed linearly over the exposed elements of a geometry, to be looked up at points of them.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearIrradiance {
    irradiance: Reconstruction,
    /// Mesh element of every exposed element.
    exposed: Vec<u32>,
}

impl LinearIrradiance {
    /// From the irradiance H of the exposed elements in W/m².
    ///
    /// # Panics
    ///
    /// If `irradiance` is of another geometry.
    pub fn new(geometry: &Geometry<'_>, irradiance: &BandValues) -> Self {
        assert_eq!(irradiance.len(), geometry.elements().len(), "irradiance of the exposed elements");
        let irradiance = Reconstruction::new(geometry.mesh(), geometry.spread(irradiance).values());
        Self { irradiance, exposed: geometry.exposed().to_vec() }
    }

    fn place(&self, e: usize, point: DVec3) -> Place {
        self.irradiance.place(self.exposed[e] as usize, point)
    }
}

impl Field for LinearIrradiance {
    fn add(&self, facet: u32, point: DVec3, weight: f64, h: &mut [f64]) {
        let place = self.place(facet as usize, point);
        h.iter_mut().enumerate().for_each(|(b, h)| *h += weight * self.irradiance.value(&place, b));
    }
}

/// [`LinearIrradiance`] with the radiosity that follows from it.
///
/// ```text
/// B(x) = E_e + ρ_e H(x)
/// ```
///
/// for x in element e. E and ρ are constant on a surface and H is continuous across materials, so B jumps where it does and nowhere else; the
/// mean of B over each element is that of the solution. [`Reconstruction`] says what H is inside elements and where it is cut.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearRadiosity {
    irradiance: LinearIrradiance,
    emission: BandValues,
    reflectance: BandValues,
}

impl LinearRadiosity {
    /// From the irradiance H of the exposed elements in W/m².
    ///
    /// # Panics
    ///
    /// If `irradiance` is of another geometry.
    pub fn new(geometry: &Geometry<'_>, irradiance: &BandValues) -> Self {
        let irradiance = LinearIrradiance::new(geometry, irradiance);
        Self { irradiance, emission: geometry.emission(), reflectance: geometry.reflectance() }
    }

    /// H over the elements of the mesh.
    pub fn irradiance(&self) -> &Reconstruction {
        &self.irradiance.irradiance
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.emission.count()
    }

    /// Where a point of exposed element e lies in it, for all bands.
    ///
    /// # Panics
    ///
    /// If there is no such element.
    pub fn place(&self, e: usize, point: DVec3) -> Place {
        self.irradiance.place(e, point)
    }

    /// B in W/m² at a place of exposed element e in one band.
    ///
    /// # Panics
    ///
    /// If there is no such element or band.
    pub fn radiosity(&self, e: usize, place: &Place, band: usize) -> f64 {
        self.emission.band(band)[e] + self.reflectance.band(band)[e] * self.irradiance().value(place, band)
    }
}
