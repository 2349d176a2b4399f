//! Cells of a scene: the rows of a matrix of form factors.

use radiosity_geometry::mesh::{Mesh, MeshSettings, Subdivision};
use radiosity_geometry::{Facets, Occluders, Polygon, Scene};

use crate::Failure;

/// What one row stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Label {
    /// The face, from 0; the first one where several share the row.
    pub surface: u32,
    /// Column of the cell on the face.
    pub i: u32,
    /// Row of the cell on the face.
    pub j: u32,
}

/// What a cell stands for, and its polygons.
type Cell = (Label, Vec<Polygon>);

/// Cells of a scene.
pub struct Cells {
    /// The polygons of every cell, none for a face without an area; rows first, then what only blocks, marked covered.
    pub cells: Facets,
    /// Every polygon alone, in the order of the cells.
    pub elements: Facets,
    /// Cell of every element.
    pub cell: Vec<u32>,
    /// What the rows stand for; cells beyond have no row.
    pub labels: Vec<Label>,
}

impl Cells {
    /// The cells of `scene`: at K = 1 the rows of its faces, else K² a quadrilateral or triangle of each face that has a row.
    pub fn new(scene: &Scene, rows: &[Option<usize>], subdivide: u32) -> Result<Self, Failure> {
        let pieces = pieces(scene, subdivide)?;
        let mut new = Self { cells: Facets::new(), elements: Facets::new(), cell: Vec::new(), labels: Vec::new() };
        if subdivide == 1 {
            let count = rows.iter().flatten().max().map_or(0, |last| last + 1);
            let mut shared: Vec<Option<Cell>> = vec![None; count];
            for ((label, polygons), row) in pieces.iter().flatten().zip(rows) {
                let Some(row) = row else { continue };
                shared[*row].get_or_insert((*label, Vec::new())).1.extend(polygons.iter().cloned());
            }
            for (label, polygons) in shared.into_iter().flatten() {
                new.labels.push(label);
                new.push(polygons, false);
            }
        } else {
            for (label, polygons) in pieces.iter().zip(rows).filter(|(_, row)| row.is_some()).flat_map(|(own, _)| own) {
                new.labels.push(*label);
                new.push(polygons.clone(), false);
            }
        }
        for (_, polygons) in pieces.into_iter().zip(rows).filter(|(_, row)| row.is_none()).flat_map(|(own, _)| own) {
            new.push(polygons, true);
        }
        Ok(new)
    }

    fn push(&mut self, polygons: Vec<Polygon>, covered: bool) {
        for polygon in &polygons {
            self.elements.push(vec![polygon.clone()], covered);
            self.cell.push(self.cells.len() as u32);
        }
        self.cells.push(polygons, covered);
    }
}

/// The cells of every face with their polygons: one at K = 1, whatever the face is split into.
fn pieces(scene: &Scene, subdivide: u32) -> Result<Vec<Vec<Cell>>, Failure> {
    let occluders = Occluders::of_scene(scene);
    let settings = MeshSettings { elements: Subdivision::Uniform(subdivide), patches: None, contacts: false };
    let mesh = Mesh::new(scene, &occluders, &settings)?;
    let mut faces: Vec<Vec<Cell>> = vec![Vec::new(); scene.surfaces.len()];
    for (e, element) in mesh.elements.iter().enumerate() {
        let surface = element.surface;
        let label =
            if subdivide == 1 { Label { surface, i: 0, j: 0 } } else { Label { surface, i: element.i, j: element.j } };
        let polygon = mesh.element_facets.polygons(e)[0].clone();
        match faces[surface as usize].last_mut() {
            Some((known, polygons)) if *known == label => polygons.push(polygon),
            _ => faces[surface as usize].push((label, vec![polygon])),
        }
    }
    for (surface, face) in (0..).zip(&mut faces).filter(|(_, face)| face.is_empty()) {
        // A face without an area keeps its rows, which are 0.
        let empty = |k| (Label { surface, i: k % subdivide, j: k / subdivide }, Vec::new());
        face.extend((0..subdivide * subdivide).map(empty));
    }
    Ok(faces)
}
