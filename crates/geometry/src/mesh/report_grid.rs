//! A fixed grid of cells on every surface, on which meshes of any fineness are compared.

use glam::DVec3;
use rayon::prelude::*;

use crate::{Polygon, Scene, polygon::area_vector};

use super::{Mesh, MeshError, Piece, Subdivision, subdivide::grids};

/// One cell of a report grid.
#[derive(Clone, Debug, PartialEq)]
pub struct ReportCell {
    /// Its surface.
    pub surface: u32,
    /// Column, numbered as elements are.
    pub i: u32,
    /// Row.
    pub j: u32,
    /// The cell itself.
    pub polygon: Polygon,
    /// Its area.
    pub area: f64,
    /// Elements that overlap it and are not covered, with the areas of overlap.
    pub overlaps: Vec<(u32, f64)>,
}

/// K × K cells on each surface with the elements under them.
#[derive(Clone, Debug, PartialEq)]
pub struct ReportGrid {
    /// Cells in the order of surfaces, pieces, rows and columns.
    pub cells: Vec<ReportCell>,
}

impl ReportGrid {
    /// Areas of the cells.
    pub fn areas(&self) -> Vec<f64> {
        self.cells.iter().map(|c| c.area).collect()
    }

    /// Means over the cells of values on the elements, v̄ = Σ_e a_e v_e / A; covered parts count as zero.
    ///
    /// # Panics
    ///
    /// If there are fewer values than elements.
    pub fn means(&self, values: &[f64]) -> Vec<f64> {
        let sum = |c: &ReportCell| c.overlaps.iter().map(|&(e, area)| area * values[e as usize]).sum::<f64>();
        self.cells.iter().map(|c| sum(c) / c.area).collect()
    }
}

impl Mesh {
    /// The grid of K × K cells on each surface (K² on a triangle) and its overlaps with the elements.
    ///
    /// # Errors
    ///
    /// [`MeshError`] if K is 0 or makes too many cells.
    ///
    /// # Panics
    ///
    /// If the mesh is of another scene.
    pub fn report_grid(&self, scene: &Scene, k: u32) -> Result<ReportGrid, MeshError> {
        let subdivision = Subdivision::Uniform(k);
        subdivision.check()?;
        let faces: Vec<(usize, &Polygon)> = scene.pieces().collect();
        assert_eq!(faces.len() + 1, self.face_begins.len(), "the mesh is of another scene");
        let mut work: Vec<(usize, Vec<Piece>)> = Vec::with_capacity(faces.len());
        let (mut last, mut offset) = (usize::MAX, 0);
        for (f, &(s, face)) in faces.iter().enumerate() {
            if s != last {
                (last, offset) = (s, 0);
            }
            let pieces: Vec<Piece> =
                grids(s as u32, face, subdivision, None, offset)?.into_iter().map(|g| g.elements).collect();
            offset += pieces.iter().map(Piece::width).sum::<u32>();
            work.push((f, pieces));
        }
        let cells: Vec<Vec<ReportCell>> = work.par_iter().map(|(f, pieces)| self.report_face(*f, pieces)).collect();
        Ok(ReportGrid { cells: cells.into_iter().flatten().collect() })
    }

    /// Cells on one face of the scene.
    fn report_face(&self, face: usize, pieces: &[Piece]) -> Vec<ReportCell> {
        let own = self.face_begins[face]..self.face_begins[face + 1];
        // Where both are cut into the same pieces only the cells at the same parameters can overlap.
        let alike = own.len() == pieces.len()
            && own.clone().zip(pieces).all(|(k, p)| self.pieces[k].corners().len() == p.corners().len());
        let mut cells = Vec::new();
        for (at, piece) in pieces.iter().enumerate() {
            let polygons = piece.polygons().into_iter().flatten();
            for ((i, j), polygon) in piece.indices().zip(polygons) {
                let mut overlaps = Vec::new();
                let mut add = |elements: std::ops::Range<usize>| {
                    for e in elements.filter(|&e| !self.elements[e].covered) {
                        let area = overlap(&polygon, &self.element_facets.polygons(e)[0]);
                        if area > 0.0 {
                            overlaps.push((e as u32, area));
                        }
                    }
                };
                if alike {
                    let k = own.start + at;
                    let (columns, rows) = self.pieces[k].overlapped(piece, i, j);
                    for row in rows {
                        for column in self.pieces[k].columns(columns.clone(), row) {
                            add(self.cell_elements(k, column, row));
                        }
                    }
                } else {
                    own.clone().for_each(|k| {
                        self.pieces[k].indices().for_each(|(i, j)| add(self.cell_elements(k, i, j)));
                    });
                }
                let (surface, area) = (piece.surface, polygon.area());
                cells.push(ReportCell { surface, i: piece.offset() + i, j, polygon, area, overlaps });
            }
        }
        cells
    }
}

/// Area of the intersection of two convex polygons of one plane; 0 below 1e-12 of the smaller area, all of the second
/// within 1e-12 of it.
fn overlap(cell: &Polygon, element: &Polygon) -> f64 {
    let mut rest: Vec<DVec3> = element.vertices().to_vec();
    for (a, b) in cell.edges() {
        let inward = cell.normal().cross(b - a);
        let d: Vec<f64> = rest.iter().map(|v| (*v - a).dot(inward)).collect();
        if d.iter().all(|&d| d <= 0.0) {
            return 0.0;
        }
        let mut kept = Vec::with_capacity(rest.len() + 1);
        for (k, &p) in rest.iter().enumerate() {
            let next = (k + 1) % rest.len();
            if d[k] >= 0.0 {
                kept.push(p);
            }
            if (d[k] > 0.0 && d[next] < 0.0) || (d[k] < 0.0 && d[next] > 0.0) {
                kept.push(p + (rest[next] - p) * (d[k] / (d[k] - d[next])));
            }
        }
        rest = kept;
    }
    let area = area_vector(&rest).length();
    if area >= element.area() * (1.0 - 1e-12) {
        element.area()
    } else if area > 1e-12 * element.area().min(cell.area()) {
        area
    } else {
        0.0
    }
}
