//! Meshes: surfaces cut into elements, which hold radiosity, and patches, which send it.
//!
//! What is *not* here: what decides where a mesh is refined. A mesh never changes: [`Mesh::refined`] makes another one.

mod contacts;
mod display;
mod quadtree;
pub mod reconstruction;
mod refine;
mod report_grid;
mod subdivide;

use glam::DVec3;
use rayon::prelude::*;

use crate::{Facets, Occluders, Polygon, Scene};
use contacts::{Contacts, Line, Part, Partitions};
use quadtree::Path;
use subdivide::{Grids, MAX_CELLS, count, grids};

pub use quadtree::{MAX_LEVEL, Neighbours};
pub use reconstruction::{Place, Reconstruction};
pub use refine::{Origin, Refined};
pub use report_grid::{ReportCell, ReportGrid};
pub use subdivide::{Piece, Subdivision};

/// How a scene is meshed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshSettings {
    /// Elements of every face.
    pub elements: Subdivision,
    /// Patches of every face; `None` makes every element a patch of its own.
    pub patches: Option<Subdivision>,
    /// Whether cells are cut where surfaces touch or cross, and those inside solids marked as covered.
    pub contacts: bool,
}

/// Why settings make no mesh.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// A subdivision into 0 × 0 cells.
    #[error("a face cannot be cut into 0 × 0 cells; use 1 or more")]
    NoCells,
    /// An edge length that is no length.
    #[error("the edge length is {length}; it must be finite and positive")]
    EdgeLength {
        /// The length given.
        length: f64,
    },
    /// Elements that do not nest in patches.
    #[error("{elements} elements along an edge do not nest in {patches} patches; use a multiple of {patches}")]
    Divide {
        /// Elements along an edge.
        elements: u64,
        /// Patches along it.
        patches: u64,
    },
    /// More cells than indices and memory bear.
    #[error("the mesh would have {cells} cells or more, beyond the limit of {limit}; use a coarser subdivision")]
    TooMany {
        /// Cells asked for.
        cells: u64,
        /// Cells allowed.
        limit: u64,
    },
}

/// A convex polygon that holds one radiosity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Element {
    /// Its surface.
    pub surface: u32,
    /// Column of its cell; the columns of a surface's pieces are numbered one after the other.
    pub i: u32,
    /// Row of its cell.
    pub j: u32,
    /// Its patch.
    pub parent: u32,
    /// Whether it lies inside a solid: it sends and receives nothing.
    pub covered: bool,
    /// How often its cell was halved along both directions to get it.
    pub level: u8,
    /// Its node in the quadtree of its cell; nodes of a cell are in ascending order.
    pub(crate) path: Path,
}

impl Element {
    /// Whether two elements are parts of one leaf of a cell's quadtree: the same, or cut apart by a contact.
    pub fn same_leaf(&self, other: &Self) -> bool {
        let place = |e: &Self| (e.surface, e.i, e.j, e.level, e.path);
        place(self) == place(other)
    }
}

/// How many cells and patches a mesh has before contacts cut or cover any of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshSize {
    /// Cells: about as many as elements, some of which are parts of cells.
    pub cells: u64,
    /// Patches; as many as cells where every element is one of its own.
    pub patches: u64,
}

impl MeshSize {
    /// The size of the mesh that [`Mesh::new`] makes of these settings, without making it: O(faces).
    ///
    /// # Errors
    ///
    /// [`MeshError`] as [`Mesh::new`].
    pub fn of(scene: &Scene, settings: &MeshSettings) -> Result<Self, MeshError> {
        let of_surfaces = Self::of_surfaces(scene, settings)?;
        let add = |a: Self, b: Self| Self { cells: a.cells + b.cells, patches: a.patches + b.patches };
        Ok(of_surfaces.into_iter().fold(Self { cells: 0, patches: 0 }, add))
    }

    /// [`Self::of`] surface by surface.
    ///
    /// # Errors
    ///
    /// [`MeshError`] as [`Mesh::new`].
    pub fn of_surfaces(scene: &Scene, settings: &MeshSettings) -> Result<Vec<Self>, MeshError> {
        settings.elements.check()?;
        settings.patches.map_or(Ok(()), Subdivision::check)?;
        let mut sizes = vec![Self { cells: 0, patches: 0 }; scene.surfaces.len()];
        let mut total = 0;
        for (surface, face) in scene.pieces() {
            let (cells, patches) = count(face, settings.elements, settings.patches)?;
            sizes[surface].cells += cells;
            sizes[surface].patches += patches;
            total += cells;
            if total > MAX_CELLS {
                return Err(MeshError::TooMany { cells: total, limit: MAX_CELLS });
            }
        }
        Ok(sizes)
    }
}

/// Elements and patches of a scene.
///
/// A cell (surface, i, j) is one element, or several where it is cut at a contact or refined: it is the root of a quadtree
/// whose leaves are whole elements, or several where they are cut. Patches end at contacts too: one that a line of contact
/// passes is several, and so are the cells that the line, lengthened to the bounds of the patch, passes there. So elements
/// nest, a patch sees or is covered as a whole, and its area is the sum of its elements' areas.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    /// Elements in the order of surfaces, pieces, rows, columns and nodes of a cell's quadtree.
    pub elements: Vec<Element>,
    /// One polygon an element.
    pub element_facets: Facets,
    /// One or more polygons a patch.
    pub patch_facets: Facets,
    /// Grids of elements, in the order of surfaces and of their faces.
    pieces: Vec<Piece>,
    /// First piece of every face of the scene, and the number of pieces.
    face_begins: Vec<usize>,
    /// First face of every surface, and the number of faces.
    surface_begins: Vec<usize>,
    /// First cell of every piece, and the number of cells.
    cell_begins: Vec<usize>,
    /// First element of every cell, and the number of elements.
    element_begins: Vec<usize>,
    /// What stands on every face of the scene; empty if contacts were not looked for.
    partitions: Vec<Partitions>,
}

/// Polygons in which cells are cut, cell by cell, in one allocation for all.
struct Parts {
    polygons: Vec<Polygon>,
    /// First part of every cell, and the number of parts.
    begins: Vec<usize>,
}

impl Parts {
    fn of(cut: Vec<Vec<Polygon>>) -> Self {
        let mut begins = vec![0];
        begins.extend(cut.iter().scan(0, |end, parts| {
            *end += parts.len();
            Some(*end)
        }));
        Self { polygons: cut.into_iter().flatten().collect(), begins }
    }

    /// Parts of each cell.
    fn iter(&self) -> impl Iterator<Item = &[Polygon]> {
        self.begins.windows(2).map(|cell| &self.polygons[cell[0]..cell[1]])
    }
}

/// Cells of one face before they are numbered.
struct FaceCells {
    grids: Vec<Grids>,
    /// Parts of every cell, piece by piece.
    elements: Parts,
    /// The patch of every part; none if every element is its own.
    parents: Vec<usize>,
    /// Patches as lines of contact bound them.
    patches: Vec<Polygon>,
    /// What stands on the face, if contacts are looked for.
    partitions: Option<Partitions>,
}

impl Mesh {
    /// Cuts a scene into elements and patches; `occluders` are those of the same scene.
    ///
    /// A face too thin for its cells to have an area stays whole. Takes O(m log m) for m elements.
    ///
    /// # Errors
    ///
    /// [`MeshError`] if a subdivision makes no cells, too many, or elements that do not nest in patches.
    ///
    /// # Panics
    ///
    /// If `occluders` are not [`Occluders::of_scene`] of the same scene.
    pub fn new(scene: &Scene, occluders: &Occluders, settings: &MeshSettings) -> Result<Self, MeshError> {
        Self::on_surfaces(scene, occluders, settings, &|_| true)
    }

    /// [`Self::new`] with elements on the surfaces that `meshed` names alone. The others cut and cover cells all the same.
    ///
    /// # Errors
    ///
    /// As [`Self::new`].
    ///
    /// # Panics
    ///
    /// As [`Self::new`].
    pub fn on_surfaces(
        scene: &Scene,
        occluders: &Occluders,
        settings: &MeshSettings,
        meshed: &dyn Fn(usize) -> bool,
    ) -> Result<Self, MeshError> {
        let faces: Vec<(usize, &Polygon)> = scene.pieces().collect();
        assert_eq!(occluders.len(), faces.len(), "occluders of another scene: {} of {}", occluders.len(), faces.len());
        settings.elements.check()?;
        settings.patches.map_or(Ok(()), Subdivision::check)?;

        // Grids: columns of a surface are numbered through its faces.
        let mut face_grids: Vec<Vec<Grids>> = Vec::with_capacity(faces.len());
        let (mut cells, mut last, mut offset) = (0, usize::MAX, 0);
        for &(s, face) in &faces {
            if s != last {
                (last, offset) = (s, 0);
            }
            if !meshed(s) {
                face_grids.push(Vec::new());
                continue;
            }
            let grids = grids(s as u32, face, settings.elements, settings.patches, offset)?;
            offset += grids.iter().map(|g| g.elements.width()).sum::<u32>();
            cells += grids.iter().map(|g| g.elements.len() as u64).sum::<u64>();
            if cells > MAX_CELLS {
                return Err(MeshError::TooMany { cells, limit: MAX_CELLS });
            }
            face_grids.push(grids);
        }

        // Cells and their parts; which of them are covered.
        let contacts = Contacts::new(occluders, scene.diagonal());
        let contacts = settings.contacts.then_some(&contacts);
        let has_patches = settings.patches.is_some();
        let of_face =
            |(k, grids): (usize, _)| FaceCells::new(faces[k].1, grids, has_patches, contacts.map(|c| (c, c.lines(k))));
        let face_cells: Vec<FaceCells> = face_grids.into_par_iter().enumerate().map(of_face).collect();
        let parts: Vec<&Polygon> = face_cells.iter().flat_map(|f| &f.elements.polygons).collect();
        let covered: Vec<bool> = parts.par_iter().map(|p| contacts.is_some_and(|c| c.covered(p))).collect();

        let mut mesh = Self::empty();
        let mut covered = covered.into_iter();
        for (k, face) in face_cells.into_iter().enumerate() {
            mesh.surface_begins.resize(faces[k].0 + 1, mesh.face_begins.len());
            mesh.face_begins.push(mesh.pieces.len());
            mesh.push_face(face, &mut covered);
        }
        mesh.surface_begins.resize(scene.surfaces.len() + 1, mesh.face_begins.len());
        mesh.face_begins.push(mesh.pieces.len());
        mesh.cell_begins.push(mesh.element_begins.len());
        mesh.element_begins.push(mesh.elements.len());
        if settings.patches.is_none() {
            // Every element is a patch of its own, on the same polygons.
            mesh.patch_facets = mesh.element_facets.clone();
        }
        Ok(mesh)
    }

    /// Bytes of a mesh of `elements` quadrilaterals and, unless every element is its own, of `patches`.
    pub fn bytes_of(elements: u64, patches: Option<u64>) -> u64 {
        let own = size_of::<Element>() + size_of::<usize>();
        elements * own as u64 + Facets::bytes_of(elements + patches.unwrap_or(0))
    }

    fn empty() -> Self {
        Self {
            elements: Vec::new(),
            element_facets: Facets::new(),
            patch_facets: Facets::new(),
            pieces: Vec::new(),
            face_begins: Vec::new(),
            surface_begins: Vec::new(),
            cell_begins: Vec::new(),
            element_begins: Vec::new(),
            partitions: Vec::new(),
        }
    }

    /// Numbers the elements and patches of a face.
    fn push_face(&mut self, face: FaceCells, covered: &mut impl Iterator<Item = bool>) {
        self.partitions.extend(face.partitions);
        let flags: Vec<Vec<bool>> =
            face.elements.iter().map(|parts| covered.by_ref().take(parts.len()).collect()).collect();

        // Patches: what is open of every one, and what is covered.
        let mut sides = vec![[Vec::new(), Vec::new()]; face.patches.len()];
        for ((part, &patch), &covered) in face.elements.polygons.iter().zip(&face.parents).zip(flags.iter().flatten()) {
            sides[patch][usize::from(covered)].push(part);
        }
        let mut numbers = vec![[None; 2]; face.patches.len()];
        for ((patch, sides), numbers) in face.patches.iter().zip(sides).zip(&mut numbers) {
            // Between lines of contact all is open or all is covered, but for what rounding made of tangled ones.
            let mixed = sides.iter().all(|side| !side.is_empty());
            for (side, elements) in sides.into_iter().enumerate().filter(|(_, elements)| !elements.is_empty()) {
                numbers[side] = Some(self.patch_facets.len() as u32);
                let polygons = if mixed { elements.into_iter().cloned().collect() } else { vec![patch.clone()] };
                self.patch_facets.push(polygons, side == 1);
            }
        }

        // Elements.
        let mut parents = face.parents.iter();
        let mut cells = face.elements.iter().zip(flags);
        for grid in face.grids {
            let piece = grid.elements;
            self.cell_begins.push(self.element_begins.len());
            for ((i, j), (parts, flags)) in piece.indices().zip(&mut cells) {
                self.element_begins.push(self.elements.len());
                for (part, covered) in parts.iter().zip(flags) {
                    let own = self.elements.len() as u32;
                    let parent = parents.next().and_then(|&patch| numbers[patch][usize::from(covered)]).unwrap_or(own);
                    let (surface, i) = (piece.surface, piece.offset() + i);
                    self.elements.push(Element { surface, i, j, parent, covered, level: 0, path: Path::ROOT });
                    self.element_facets.push([part.clone()], covered);
                }
            }
            self.pieces.push(piece);
        }
    }

    /// The patch of every element.
    pub fn parents(&self) -> Vec<u32> {
        self.elements.iter().map(|e| e.parent).collect()
    }

    /// The face of every element: its place in [`Scene::pieces`].
    pub fn faces(&self) -> Vec<u32> {
        let first = |piece: usize| self.element_begins[self.cell_begins[piece]];
        let face = |f: usize| {
            let elements = first(self.face_begins[f])..first(self.face_begins[f + 1]);
            elements.map(move |_| f as u32)
        };
        (0..self.face_begins.len() - 1).flat_map(face).collect()
    }

    /// Whether each element is a part of a cell, or of a leaf of its quadtree, that a contact cuts.
    pub fn cut_by_contacts(&self) -> Vec<bool> {
        let leaves = self.elements.chunk_by(Element::same_leaf);
        leaves.flat_map(|parts| std::iter::repeat_n(parts.len() > 1, parts.len())).collect()
    }

    /// Areas of the elements.
    pub fn areas(&self) -> Vec<f64> {
        self.element_facets.areas()
    }

    /// Emission E of the elements, band after band; 0 where covered.
    pub fn emission(&self, scene: &Scene) -> Vec<f64> {
        self.of_materials(scene, |m| &scene.materials[m].emission)
    }

    /// Reflectance ρ of the elements, band after band; 0 where covered.
    pub fn reflectance(&self, scene: &Scene) -> Vec<f64> {
        self.of_materials(scene, |m| &scene.materials[m].reflectance)
    }

    fn of_materials<'a>(&self, scene: &Scene, bands: impl Fn(usize) -> &'a [f64] + Copy) -> Vec<f64> {
        let value = |e: &Element, b: usize| match e.covered {
            true => 0.0,
            false => bands(scene.surfaces[e.surface as usize].material)[b],
        };
        (0..scene.bands()).flat_map(|b| self.elements.iter().map(move |e| value(e, b))).collect()
    }

    /// Number of cells (surface, i, j).
    pub fn cells(&self) -> usize {
        self.element_begins.len() - 1
    }

    /// The cell of every element: the row it belongs to when all elements of one cell count as one row.
    pub fn rows(&self) -> Vec<u32> {
        let cell = |k: usize| (self.element_begins[k]..self.element_begins[k + 1]).map(move |_| k as u32);
        (0..self.cells()).flat_map(cell).collect()
    }

    /// Grids of elements on a surface.
    ///
    /// # Panics
    ///
    /// If there is no such surface.
    pub fn pieces(&self, surface: usize) -> &[Piece] {
        let faces = self.surface_begins[surface]..self.surface_begins[surface + 1];
        &self.pieces[self.face_begins[faces.start]..self.face_begins[faces.end]]
    }

    /// The element at parameters (u, v) of a surface's piece (see [`Piece::point`]), or `None` outside it; takes a time that
    /// grows with the level of the elements there, and with the parts that a contact cuts them into.
    ///
    /// # Panics
    ///
    /// If there is no such piece.
    pub fn locate(&self, surface: usize, piece: usize, u: f64, v: f64) -> Option<usize> {
        let k = self.face_begins[self.surface_begins[surface]] + piece;
        let at = &self.pieces[k];
        let (i, j) = at.cell_at(u, v)?;
        let cell = self.cell_elements(k, i, j);
        if cell.len() == 1 {
            return Some(cell.start);
        }
        let parts = self.leaf(cell, at.path_at(i, j, u, v));
        // Of the parts of a cut cell the one in which the point lies deepest.
        let point = at.point(u, v);
        let depth = |e: usize| depth(&self.element_facets.polygons(e)[0], point);
        parts.max_by(|&a, &b| depth(a).total_cmp(&depth(b)).then(b.cmp(&a)))
    }

    /// Elements of a cell.
    fn cell_elements(&self, piece: usize, i: u32, j: u32) -> std::ops::Range<usize> {
        let cell = self.cell_begins[piece] + self.pieces[piece].position(i, j);
        self.element_begins[cell]..self.element_begins[cell + 1]
    }
}

/// Distance of a point of the plane from the nearest edge, negative outside.
fn depth(polygon: &Polygon, point: DVec3) -> f64 {
    let inward = |a: DVec3, b: DVec3| polygon.normal().cross(b - a).normalize_or_zero();
    polygon.edges().map(|(a, b)| (point - a).dot(inward(a, b))).fold(f64::INFINITY, f64::min)
}

impl FaceCells {
    fn new(face: &Polygon, grids: Vec<Grids>, has_patches: bool, contacts: Option<(&Contacts<'_>, Vec<Line>)>) -> Self {
        // Patches with the cells that nest in them; without patches cells in which nothing nests.
        let (mut coarse, mut cells) = (Vec::new(), 0);
        let partitions = contacts.as_ref().map(|(contacts, lines)| contacts.partitions(lines));
        let whole = |polygon: Polygon| Part { polygon, cells: Vec::new() };
        for grid in &grids {
            let piece = &grid.elements;
            // Pieces whose cells have no area are left whole by `grids`.
            let polygons = piece.polygons().into_iter().flatten();
            let numbered = (cells..).zip(polygons);
            cells += piece.len();
            if !has_patches {
                coarse.extend(numbered.map(|(_, polygon)| whole(polygon)));
                continue;
            }
            let first = match &grid.patches {
                Some(patches) => {
                    coarse.extend(patches.polygons().into_iter().flatten().map(whole));
                    coarse.len() - patches.len()
                }
                None => {
                    if coarse.is_empty() {
                        coarse.push(whole(face.clone()));
                    }
                    0
                }
            };
            for ((i, j), cell) in piece.indices().zip(numbered) {
                let of = grid.patches.as_ref().map_or(0, |patches| {
                    let (i, j) = piece.parent_in(patches, i, j);
                    patches.position(i, j)
                });
                coarse[first + of].cells.push(cell);
            }
        }
        let parts: Vec<Vec<Part>> = match contacts {
            Some((contacts, lines)) if !lines.is_empty() => contacts.cut(coarse, &lines),
            _ => coarse.into_iter().map(|part| vec![part]).collect(),
        };
        if !has_patches {
            let elements =
                parts.into_iter().map(|parts| parts.into_iter().map(|part| part.polygon).collect()).collect();
            return Self { grids, elements: Parts::of(elements), parents: Vec::new(), patches: Vec::new(), partitions };
        }
        // Parts in the order of cells, each with its patch; those of one cell stay in the order of patches.
        let (mut placed, mut patches) = (Vec::with_capacity(cells), Vec::new());
        for part in parts.into_iter().flatten() {
            placed.extend(part.cells.into_iter().map(|(cell, polygon)| (cell, patches.len(), polygon)));
            patches.push(part.polygon);
        }
        placed.sort_by_key(|(cell, ..)| *cell);
        let parents = placed.iter().map(|(_, patch, _)| *patch).collect();
        let begins = (0..=cells).map(|cell| placed.partition_point(|(of, ..)| *of < cell)).collect();
        let elements = Parts { polygons: placed.into_iter().map(|(.., polygon)| polygon).collect(), begins };
        Self { grids, elements, parents, patches, partitions }
    }
}

#[cfg(test)]
mod tests;
