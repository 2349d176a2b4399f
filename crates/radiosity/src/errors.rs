//! Errors of irradiance over a report grid, the same measure for every strategy.
//!
//! With cells c of area A_c (K × K on every surface), bands b and the mean level ⟨H*⟩ of the reference over all cells
//! and bands,
//!
//! ```text
//! rms = √( Σ_c A_c Σ_b (H_cb − H*_cb)² / (bands · Σ_c A_c) ) / ⟨H*⟩
//! ```
//!
//! A part of a cell that a solid covers counts as zero in both. A mean hides a bad cell: the worst cell and the signed
//! bias of each surface stand beside it. Comparing a solution with (a) the exact solution of the same system gives the
//! solver error, (b) the solution from the best form factors on the same mesh the form-factor error, (c) a closed form
//! or a much finer run the mesh error.

use glam::DVec3;
use radiosity_core::BandValues;
use radiosity_geometry::mesh::{MeshError, Reconstruction};
use radiosity_geometry::polygon::area_vector;
use radiosity_render::Camera;

use crate::Geometry;
use crate::asked::Pixels;

/// Irradiance on the cells of a report grid, or at points standing for equal parts of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct GridValues {
    /// Surface of every cell.
    pub surfaces: Vec<u32>,
    /// Indices (i, j) of every cell on its surface.
    pub indices: Vec<(u32, u32)>,
    /// Area of every cell.
    pub areas: Vec<f64>,
    /// Values of every cell, band after band.
    pub values: BandValues,
}

/// Signed mean error of one surface, relative to the mean level of the reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceBias {
    /// The surface.
    pub surface: u32,
    /// Area- and band-mean of H − H*, over ⟨H*⟩.
    pub bias: f64,
}

/// A cell of a report grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CellPlace {
    /// Its surface.
    pub surface: u32,
    /// Its column.
    pub i: u32,
    /// Its row.
    pub j: u32,
}

/// How far one grid of values is from another.
#[derive(Clone, Debug, PartialEq)]
pub struct ErrorMeasure {
    /// Area-weighted rms difference over the mean level.
    pub rms: f64,
    /// Largest |H − H*| of a cell and band over the mean level.
    pub worst: f64,
    /// Where the worst is; `None` where no cell differs.
    pub worst_cell: Option<CellPlace>,
    /// Mean level ⟨H*⟩ of the reference.
    pub level: f64,
    /// Signed bias of every surface.
    pub biases: Vec<SurfaceBias>,
}

impl GridValues {
    /// Area means of `values` (on exposed elements) over the K × K cells of every surface.
    ///
    /// # Errors
    ///
    /// [`MeshError`] if `k` is 0 or makes too many cells.
    pub fn means(geometry: &Geometry<'_>, values: &BandValues, k: u32) -> Result<Self, MeshError> {
        let all = geometry.spread(values);
        let grid = geometry.mesh().report_grid(geometry.scene(), k)?;
        let means = (0..all.count()).flat_map(|b| grid.means(all.band(b)));
        let values = BandValues::new(means.collect(), grid.cells.len());
        Ok(Self {
            surfaces: grid.cells.iter().map(|c| c.surface).collect(),
            indices: grid.cells.iter().map(|c| (c.i, c.j)).collect(),
            areas: grid.areas(),
            values,
        })
    }

    /// Values at K × K points of every piece of every surface: the piecewise constant solution as it is seen.
    pub fn points(geometry: &Geometry<'_>, values: &BandValues, k: u32) -> Self {
        let all = geometry.spread(values);
        Self::at_points(geometry, all.count(), k, |element, _, band| all.band(band)[element])
    }

    /// Values at the same points of a solution that is linear inside elements of the mesh.
    pub fn linear_points(geometry: &Geometry<'_>, values: &Reconstruction, k: u32) -> Self {
        Self::at_points(geometry, values.bands(), k, |element, point, band| values.at(element, point, band))
    }

    /// `value` of element, point and band at K × K points of every piece.
    fn at_points(geometry: &Geometry<'_>, bands: usize, k: u32, value: impl Fn(usize, DVec3, usize) -> f64) -> Self {
        let mesh = geometry.mesh();
        let (mut surfaces, mut indices, mut areas, mut found) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let at = |i: u32| (f64::from(i) + 0.5) / f64::from(k);
        for s in 0..geometry.scene().surfaces.len() {
            for (p, piece) in mesh.pieces(s).iter().enumerate() {
                let begin = found.len();
                for (i, j) in (0..k).flat_map(|j| (0..k).map(move |i| (i, j))) {
                    if let Some(element) = mesh.locate(s, p, at(i), at(j)) {
                        surfaces.push(s as u32);
                        indices.push((p as u32 * k + i, j));
                        found.push((element, piece.point(at(i), at(j))));
                    }
                }
                let share = area_vector(piece.corners()).length() / (found.len() - begin).max(1) as f64;
                areas.resize(found.len(), share);
            }
        }
        let value = &value;
        let values = (0..bands).flat_map(|b| found.iter().map(move |&(element, point)| value(element, point, b)));
        let values = BandValues::new(values.collect(), found.len());
        Self { surfaces, indices, areas, values }
    }

    /// What every pixel of a camera shows of light that is reflected, ρH of the element in its middle, a cell a pixel: those that show a front, row by row.
    /// Elements of which nothing is known show 0.
    pub fn seen(geometry: &Geometry<'_>, irradiance: &BandValues, camera: &Camera) -> Self {
        let (rho, pixels) = (geometry.reflectance(), Pixels::new(geometry, camera, None).seen);
        let shown = |b: usize, e: u32| match (rho.band(b).get(e as usize), irradiance.band(b).get(e as usize)) {
            (Some(rho), Some(h)) if !h.is_nan() => rho * h,
            _ => 0.0,
        };
        let values = (0..irradiance.count()).flat_map(|b| pixels.iter().map(move |pixel| (b, pixel.2)));
        let values = values.map(|(b, e)| shown(b, e)).collect();
        Self {
            surfaces: pixels.iter().map(|pixel| pixel.1).collect(),
            indices: pixels.iter().map(|pixel| (pixel.0 % camera.width(), pixel.0 / camera.width())).collect(),
            areas: vec![1.0; pixels.len()],
            values: BandValues::new(values, pixels.len()),
        }
    }

    /// The cells of some surfaces only.
    pub fn on(&self, surfaces: &[u32]) -> Self {
        let kept: Vec<usize> = (0..self.areas.len()).filter(|&c| surfaces.contains(&self.surfaces[c])).collect();
        let values = (0..self.values.count()).flat_map(|b| kept.iter().map(move |&c| (b, c)));
        Self {
            surfaces: kept.iter().map(|&c| self.surfaces[c]).collect(),
            indices: kept.iter().map(|&c| self.indices[c]).collect(),
            areas: kept.iter().map(|&c| self.areas[c]).collect(),
            values: BandValues::new(values.map(|(b, c)| self.values.band(b)[c]).collect(), kept.len()),
        }
    }

    /// Area mean over all cells and bands.
    pub fn level(&self) -> f64 {
        let bands = self.values.count();
        let sum: f64 =
            (0..bands).flat_map(|b| self.areas.iter().zip(self.values.band(b))).map(|(area, v)| area * v).sum();
        sum / (bands as f64 * self.areas.iter().sum::<f64>())
    }

    /// The error of these values against `truth` on the same cells.
    ///
    /// # Panics
    ///
    /// If the two grids differ in their number of cells or bands.
    pub fn error(&self, truth: &Self) -> ErrorMeasure {
        let (bands, cells) = (self.values.count(), self.areas.len());
        assert_eq!((truth.values.count(), truth.areas.len()), (bands, cells), "grids of the same shape");
        let level = truth.level();
        let (mut square, mut worst, mut worst_cell) = (0.0, 0.0, None);
        let last = self.surfaces.iter().max().map_or(0, |&s| s as usize + 1);
        let mut per_surface = vec![(0.0, 0.0); last];
        for b in 0..bands {
            for c in 0..cells {
                let (area, difference) = (self.areas[c], self.values.band(b)[c] - truth.values.band(b)[c]);
                square += area * difference * difference;
                if difference.abs() > worst {
                    let (i, j) = self.indices[c];
                    (worst, worst_cell) = (difference.abs(), Some(CellPlace { surface: self.surfaces[c], i, j }));
                }
                let (sum, weight) = &mut per_surface[self.surfaces[c] as usize];
                *sum += area * difference;
                *weight += area;
            }
        }
        let weight = bands as f64 * self.areas.iter().sum::<f64>();
        let biases = per_surface.iter().enumerate().filter(|(_, (_, weight))| *weight > 0.0);
        // No difference is no error, also in the dark.
        let relative = |difference: f64| if difference == 0.0 { 0.0 } else { difference / level };
        let biases = biases.map(|(s, (sum, weight))| SurfaceBias { surface: s as u32, bias: relative(sum / weight) });
        ErrorMeasure {
            rms: relative((square / weight).sqrt()),
            worst: relative(worst),
            worst_cell,
            level,
            biases: biases.collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(values: &[f64]) -> GridValues {
        GridValues {
            surfaces: vec![0, 0, 1],
            indices: vec![(0, 0), (1, 0), (0, 0)],
            areas: vec![1.0, 1.0, 2.0],
            values: BandValues::single(values.to_vec()),
        }
    }

    /// Level (1 + 3 + 2·2)/4 = 2; differences 0.2, 0, −0.4: rms √((0.04 + 2·0.16)/4)/2 = 0.15.
    #[test]
    fn rms_is_area_weighted_and_relative_to_the_mean_level() {
        let error = grid(&[1.2, 3.0, 1.6]).error(&grid(&[1.0, 3.0, 2.0]));
        assert!((error.level - 2.0).abs() < 1e-15);
        assert!((error.rms - 0.15).abs() < 1e-15);
        assert!((error.worst - 0.2).abs() < 1e-15);
        assert_eq!(error.worst_cell, Some(CellPlace { surface: 1, i: 0, j: 0 }));
        let biases: Vec<f64> = error.biases.iter().map(|b| b.bias).collect();
        assert!((biases[0] - 0.05).abs() < 1e-15 && (biases[1] + 0.2).abs() < 1e-15);
    }

    #[test]
    fn two_dark_grids_do_not_differ() {
        let error = grid(&[0.0; 3]).error(&grid(&[0.0; 3]));
        assert_eq!((error.rms, error.worst, error.worst_cell, error.biases[1].bias), (0.0, 0.0, None, 0.0));
    }
}
