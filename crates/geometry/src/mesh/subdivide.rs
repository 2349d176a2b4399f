//! Faces cut into grids of cells.

use glam::DVec3;

use crate::Polygon;

use super::MeshError;

/// How finely faces are cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Subdivision {
    /// K × K cells on a quadrilateral, K² on a triangle.
    Uniform(u32),
    /// As many cells as it takes to make no edge longer than this length.
    EdgeLength(f64),
}

impl Subdivision {
    pub(super) fn check(self) -> Result<(), MeshError> {
        match self {
            Self::Uniform(0) => Err(MeshError::NoCells),
            Self::EdgeLength(h) if !(h > 0.0 && h.is_finite()) => Err(MeshError::EdgeLength { length: h }),
            _ => Ok(()),
        }
    }

    /// Cells along an edge of the given length.
    fn along(self, length: f64) -> u64 {
        match self {
            Self::Uniform(k) => k.into(),
            // An edge longer than a multiple of h by rounding only takes no further cell.
            Self::EdgeLength(h) => (length / h * (1.0 - 1e-12)).ceil().max(1.0) as u64,
        }
    }

    /// Cells along an edge that is already cut into `coarse` parts: a multiple of `coarse`.
    fn within(self, length: f64, coarse: u64) -> u64 {
        match self {
            Self::Uniform(k) => k.into(),
            Self::EdgeLength(_) => coarse.saturating_mul(self.along(length / coarse as f64)),
        }
    }

    /// Cells along an edge, a divisor of `fine`.
    fn dividing(self, length: f64, fine: u64) -> u64 {
        let wanted = self.along(length).min(fine);
        (wanted..=fine).find(|n| fine.is_multiple_of(*n)).unwrap_or(fine)
    }
}

/// A grid of cells on a convex face or a part of one.
///
/// A quadrilateral a b c d is cut into bilinear sub-quadrilaterals (i, j), i along a→b, j along a→d; a triangle a b c
/// into rows j along a→c of upright (even i) and inverted (odd i) triangles; a polygon with more corners is one cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// Surface it belongs to.
    pub surface: u32,
    /// The whole polygon where there are more than four corners.
    face: Polygon,
    corners: Vec<DVec3>,
    /// Cells along a→b and a→d (of a triangle the same number twice).
    cells: (u32, u32),
    /// i of the first cell: the columns of all pieces of a surface are numbered one after the other.
    offset: u32,
}

/// Point k of n on the edge a b: the same bits whichever end is called a, and the ends themselves for k = 0 and n.
fn on_edge(a: DVec3, b: DVec3, k: u32, n: u32) -> DVec3 {
    let (lo, hi, k) = if (b.x, b.y, b.z) < (a.x, a.y, a.z) { (b, a, n - k) } else { (a, b, k) };
    if k == n { hi } else { lo + (hi - lo) * (f64::from(k) / f64::from(n)) }
}

impl Piece {
    /// Corners, counter-clockwise seen from the front.
    pub fn corners(&self) -> &[DVec3] {
        &self.corners
    }

    /// Cells along the first and the last edge.
    pub fn divisions(&self) -> (u32, u32) {
        self.cells
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.cells.0 as usize * self.cells.1 as usize
    }

    /// Never: a piece has a cell.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Columns that the piece takes of its surface's numbering.
    pub(super) fn width(&self) -> u32 {
        if self.corners.len() == 3 { 2 * self.cells.0 - 1 } else { self.cells.0 }
    }

    /// First column of the piece in its surface's numbering.
    pub fn offset(&self) -> u32 {
        self.offset
    }

    /// Cells (i, j) in order: row by row, i without the offset.
    pub(super) fn indices(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        (0..self.cells.1).flat_map(move |j| (0..self.row(j)).map(move |i| (i, j)))
    }

    /// Number of cells in row j.
    fn row(&self, j: u32) -> u32 {
        if self.corners.len() == 3 { 2 * (self.cells.1 - j) - 1 } else { self.cells.0 }
    }

    /// Position of cell (i, j) among [`Self::indices`].
    pub(super) fn position(&self, i: u32, j: u32) -> usize {
        let (i, j, n) = (i as usize, j as usize, self.cells.0 as usize);
        if self.corners.len() == 3 { j * (2 * n - j) + i } else { j * n + i }
    }

    /// Point (i, j) of the grid whose cells are halved `level` times.
    fn vertex(&self, level: u8, i: u32, j: u32) -> DVec3 {
        let (nu, nv) = self.lattice(level);
        match self.corners[..] {
            [a, b, c] => {
                let (left, right) = (on_edge(a, c, j, nv), on_edge(b, c, j, nv));
                if j == nv { c } else { on_edge(left, right, i, nv - j) }
            }
            [a, b, c, d] => on_edge(on_edge(a, d, j, nv), on_edge(b, c, j, nv), i, nu),
            _ => self.corners[i as usize],
        }
    }

    /// Cells along both directions when each is halved `level` times.
    pub(super) fn lattice(&self, level: u8) -> (u32, u32) {
        (self.cells.0 << level, self.cells.1 << level)
    }

    /// Vertices of cell (i, j).
    pub(super) fn cell(&self, i: u32, j: u32) -> Vec<DVec3> {
        self.cell_of(0, i, j)
    }

    /// Vertices of cell (i, j) of the grid whose cells are halved `level` times: those that two levels have in common are the same
    /// bit for bit.
    pub(super) fn cell_of(&self, level: u8, i: u32, j: u32) -> Vec<DVec3> {
        let at = |p: [(u32, u32); 3]| p.map(|(i, j)| self.vertex(level, i, j)).to_vec();
        match self.corners.len() {
            3 if i.is_multiple_of(2) => at([(i / 2, j), (i / 2 + 1, j), (i / 2, j + 1)]),
            3 => at([(i / 2 + 1, j), (i / 2 + 1, j + 1), (i / 2, j + 1)]),
            4 => [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| self.vertex(level, i, j)).to_vec(),
            _ => self.corners.clone(),
        }
    }

    /// Polygons of all cells in order, or `None` if one has no area to rounding.
    pub(super) fn polygons(&self) -> Option<Vec<Polygon>> {
        self.indices().map(|(i, j)| Polygon::new(&self.cell(i, j)).ok()).collect()
    }

    /// The point with bilinear parameters (u, v) in [0, 1]², u along a→b and v along a→d; on a triangle u along a→b and
    /// v along a→c with u + v ≤ 1; on a polygon with more corners [`Polygon::sample`].
    pub fn point(&self, u: f64, v: f64) -> DVec3 {
        match self.corners[..] {
            [a, b, c] => a + (b - a) * u + (c - a) * v,
            [a, b, c, d] => (a * (1.0 - u) + b * u) * (1.0 - v) + (d * (1.0 - u) + c * u) * v,
            _ => self.face.sample(u, v),
        }
    }

    /// Cell (i, j) at the parameters of [`Self::point`].
    pub(super) fn cell_at(&self, u: f64, v: f64) -> Option<(u32, u32)> {
        let (nu, nv) = self.cells;
        let inside = (0.0..=1.0).contains(&u) && (0.0..=1.0).contains(&v);
        let floor = |x: f64, n: u32| (x as u32).min(n - 1);
        match self.corners.len() {
            _ if !inside => None,
            3 => {
                // A little beyond the long edge is rounding.
                let (s, t) = (u * f64::from(nu), v * f64::from(nu));
                let j = floor(t, nu);
                let i = floor(s, nu - j);
                let upright = (s - f64::from(i)) + (t - f64::from(j)) <= 1.0 || i + j + 1 == nu;
                (u + v <= 1.0 + 1e-9).then_some((2 * i + u32::from(!upright), j))
            }
            _ => Some((floor(u * f64::from(nu), nu), floor(v * f64::from(nv), nv))),
        }
    }

    /// The cell of a coarser grid on the same corners that holds cell (i, j).
    pub(super) fn parent_in(&self, coarse: &Self, i: u32, j: u32) -> (u32, u32) {
        let (ru, rv) = (self.cells.0 / coarse.cells.0, self.cells.1 / coarse.cells.1);
        if self.corners.len() != 3 {
            return (i / ru, j / rv);
        }
        // Thirds of lattice steps: the centre of an upright cell is 1/3, of an inverted one 2/3 beyond its corner.
        let third = 1 + i % 2;
        let (s, t, r) = (3 * (i / 2) + third, 3 * j + third, 3 * ru);
        (2 * (s / r) + u32::from(s % r + t % r > r), t / r)
    }

    /// Rows and lattice columns of this grid that may overlap cell (i, j) of another grid on the same corners.
    pub(super) fn overlapped(&self, other: &Self, i: u32, j: u32) -> (std::ops::Range<u32>, std::ops::Range<u32>) {
        let span = |k: u32, of: u32, n: u32| {
            let (k, of, n) = (u64::from(k), u64::from(of), u64::from(n));
            (k * n / of) as u32..((k + 1) * n).div_ceil(of) as u32
        };
        let column = if self.corners.len() == 3 { i / 2 } else { i };
        (span(column, other.cells.0, self.cells.0), span(j, other.cells.1, self.cells.1))
    }

    /// Cells of row j in a range of lattice columns.
    pub(super) fn columns(&self, range: std::ops::Range<u32>, j: u32) -> std::ops::Range<u32> {
        if self.corners.len() == 3 { 2 * range.start..(2 * range.end).min(self.row(j)) } else { range }
    }

    /// The same corners with other divisions.
    pub(super) fn with_divisions(&self, cells: (u32, u32)) -> Self {
        Self { cells, ..self.clone() }
    }
}

/// Elements of a piece, and patches if they are cut apart from them.
pub(super) struct Grids {
    pub(super) elements: Piece,
    /// `None` where the whole face is one patch of several pieces, or where there are no patches.
    pub(super) patches: Option<Piece>,
}

/// How a face is cut, before any of its cells is made.
struct Layout {
    /// Corners of its parts, with the divisions of elements and of patches.
    parts: Vec<(Vec<DVec3>, Divisions, Option<Divisions>)>,
    /// Whether the parts are one patch.
    one_patch: bool,
}

/// How elements and patches cut a face of the scene.
fn layout(face: &Polygon, elements: Subdivision, patches: Option<Subdivision>) -> Result<Layout, MeshError> {
    let size = face.diameter();
    let vertices = face.vertices();
    let whole = vertices.len() <= 4 || (elements.along(size) == 1 && patches.is_none_or(|p| p.along(size) == 1));
    // Quadrilaterals and at most one triangle, all from vertex 0.
    let parts: Vec<Vec<DVec3>> = if whole {
        vec![vertices.to_vec()]
    } else {
        let fan = |k: usize| [0, k, k + 1, k + 2].iter().filter_map(|&v| vertices.get(v)).copied().collect();
        (1..vertices.len() - 1).step_by(2).map(fan).collect()
    };
    let one_patch = !whole && patches.is_some_and(|p| p.along(size) == 1);
    // Without those of collinear vertices of the face.
    let parts = parts.into_iter().filter(|corners| corners.len() > 4 || Polygon::new(corners).is_ok());
    let divided = parts.map(|corners| {
        let (fine, coarse) = divisions(&corners, elements, patches)?;
        Ok((corners, fine, coarse))
    });
    Ok(Layout { parts: divided.collect::<Result<_, _>>()?, one_patch })
}

/// Cells and patches of a face, whatever touches it; cells too thin to have an area count.
///
/// # Errors
///
/// As [`grids`].
pub(super) fn count(
    face: &Polygon,
    elements: Subdivision,
    patches: Option<Subdivision>,
) -> Result<(u64, u64), MeshError> {
    let Layout { parts, one_patch } = layout(face, elements, patches)?;
    let product = |(u, v): Divisions| u64::from(u) * u64::from(v);
    let cells = parts.iter().map(|(_, fine, _)| product(*fine)).sum();
    let coarse = parts.iter().map(|(_, fine, coarse)| product(coarse.unwrap_or(*fine))).sum();
    Ok((cells, if one_patch { 1 } else { coarse }))
}

/// Grids of elements and patches on a face of the scene; columns are numbered from `offset` on.
///
/// # Errors
///
/// [`MeshError::Divide`] and [`MeshError::TooMany`].
pub(super) fn grids(
    surface: u32,
    face: &Polygon,
    elements: Subdivision,
    patches: Option<Subdivision>,
    mut offset: u32,
) -> Result<Vec<Grids>, MeshError> {
    let Layout { parts, one_patch } = layout(face, elements, patches)?;
    let mut all = Vec::with_capacity(parts.len());
    for (corners, fine, coarse) in parts {
        let mut piece = Piece { surface, face: face.clone(), corners, cells: fine, offset };
        let mut coarse = (!one_patch).then_some(coarse).flatten();
        if !piece.indices().all(|(i, j)| Polygon::new(&piece.cell(i, j)).is_ok()) {
            // Too thin for its cells to have an area: it stays whole.
            piece.cells = (1, 1);
            coarse = coarse.map(|_| (1, 1));
        }
        offset += piece.width();
        let patches = coarse.map(|cells| piece.with_divisions(cells));
        all.push(Grids { elements: piece, patches });
    }
    Ok(all)
}

/// Divisions of a grid along its first and last edge.
type Divisions = (u32, u32);

/// Divisions of elements and of patches on a piece.
fn divisions(
    corners: &[DVec3],
    elements: Subdivision,
    patches: Option<Subdivision>,
) -> Result<(Divisions, Option<Divisions>), MeshError> {
    let length = |a: usize, b: usize| corners[a].distance(corners[b]);
    let lengths = match corners.len() {
        3 => [length(0, 1).max(length(1, 2)).max(length(2, 0)); 2],
        4 => [length(0, 1).max(length(2, 3)), length(1, 2).max(length(3, 0))],
        _ => return Ok(((1, 1), patches.map(|_| (1, 1)))),
    };
    let (mut fine, mut coarse) = ([0_u64; 2], [0_u64; 2]);
    for (k, &length) in lengths.iter().enumerate() {
        (fine[k], coarse[k]) = match (elements, patches) {
            (_, None) => (elements.along(length), 1),
            (Subdivision::Uniform(of), Some(Subdivision::EdgeLength(_))) => {
                (of.into(), patches.map_or(1, |p| p.dividing(length, of.into())))
            }
            (_, Some(patches)) => {
                let coarse = patches.along(length);
                (elements.within(length, coarse), coarse)
            }
        };
        if !fine[k].is_multiple_of(coarse[k]) {
            return Err(MeshError::Divide { elements: fine[k], patches: coarse[k] });
        }
    }
    let cells = fine[0].saturating_mul(fine[1]);
    if cells > MAX_CELLS {
        return Err(MeshError::TooMany { cells, limit: MAX_CELLS });
    }
    let small = |n: [u64; 2]| (n[0] as u32, n[1] as u32); // at most MAX_CELLS
    Ok((small(fine), patches.map(|_| small(coarse))))
}

/// Cells a mesh may have: what 32-bit indices and memory bear.
pub(super) const MAX_CELLS: u64 = 1 << 28;

#[cfg(test)]
mod tests {
    use super::*;

    fn quad() -> Vec<DVec3> {
        vec![DVec3::ZERO, DVec3::X * 3.0, DVec3::new(4.0, 2.0, 0.0), DVec3::Y * 1.5]
    }

    fn only(face: &[DVec3], elements: Subdivision, patches: Option<Subdivision>) -> Grids {
        let mut all = grids(0, &Polygon::new(face).unwrap(), elements, patches, 0).unwrap();
        assert_eq!(all.len(), 1);
        all.remove(0)
    }

    /// 15 cells: sums of their areas round 15 times.
    #[test]
    fn bilinear_cells_fill_a_quadrilateral() {
        let piece = only(&quad(), Subdivision::Uniform(1), None).elements.with_divisions((3, 5));
        let sum: f64 = piece.polygons().unwrap().iter().map(Polygon::area).sum();
        assert!((sum - Polygon::new(&quad()).unwrap().area()).abs() < 1e-14);
        // Cell (2, 0) is the last along a→b.
        assert_eq!(piece.cell(2, 0)[1], DVec3::X * 3.0);
        assert_eq!(piece.cell(0, 4)[3], DVec3::Y * 1.5);
    }

    #[test]
    fn a_triangle_has_k_squared_cells_of_equal_area_in_the_order_of_position() {
        let piece = only(&quad()[..3], Subdivision::Uniform(5), None).elements;
        let polygons = piece.polygons().unwrap();
        assert_eq!(polygons.len(), 25);
        let area = Polygon::new(&quad()[..3]).unwrap().area() / 25.0;
        assert!(polygons.iter().all(|p| (p.area() - area).abs() < 1e-15 * 25.0));
        assert!(piece.indices().enumerate().all(|(k, (i, j))| piece.position(i, j) == k));
    }

    #[test]
    fn neighbours_share_vertices_bit_for_bit_from_both_sides_of_an_edge() {
        let (a, b) = (DVec3::new(0.1, 0.7, -0.3), DVec3::new(1.3, -0.2, 0.9));
        assert!((0..=7).all(|k| on_edge(a, b, k, 7) == on_edge(b, a, 7 - k, 7)));
        assert_eq!((on_edge(a, b, 0, 7), on_edge(a, b, 7, 7)), (a, b));
        assert_eq!(on_edge(a, b, 2, 6), on_edge(a, b, 1, 3));
    }

    #[test]
    fn cells_lie_in_their_parents() {
        for corners in [&quad()[..], &quad()[..3]] {
            let grids = only(corners, Subdivision::Uniform(12), Some(Subdivision::Uniform(3)));
            let (fine, coarse) = (grids.elements, grids.patches.unwrap());
            let parents = coarse.polygons().unwrap();
            for (i, j) in fine.indices() {
                let (pi, pj) = fine.parent_in(&coarse, i, j);
                let parent = &parents[coarse.position(pi, pj)];
                let centre = Polygon::new(&fine.cell(i, j)).unwrap().centroid();
                assert!(parent.edges().all(|(a, b)| (b - a).cross(centre - a).z > 0.0), "{i} {j} in {pi} {pj}");
            }
        }
    }

    #[test]
    fn the_cell_at_a_cell_s_centre_is_that_cell() {
        for corners in [&quad()[..], &quad()[..3]] {
            let piece = only(corners, Subdivision::Uniform(7), None).elements;
            let n = 7.0;
            for (i, j) in piece.indices() {
                let (u, v) = match corners.len() {
                    4 => ((f64::from(i) + 0.5) / n, (f64::from(j) + 0.5) / n),
                    _ => {
                        let third = f64::from(1 + i % 2) / 3.0;
                        ((f64::from(i / 2) + third) / n, (f64::from(j) + third) / n)
                    }
                };
                assert_eq!(piece.cell_at(u, v), Some((i, j)));
            }
            assert_eq!(piece.cell_at(1.5, 0.0), None);
        }
    }

    #[test]
    fn edge_length_bounds_every_edge_and_patches_divide() {
        let (h, coarse) = (Subdivision::EdgeLength(0.3), Some(Subdivision::EdgeLength(1.1)));
        let grids = only(&quad(), h, coarse);
        // Longest of opposite edges: √(2.5² + ...) = 4.03 and 2.24; patches 4 × 3, elements 4·4 × 3·3.
        assert_eq!(grids.patches.unwrap().divisions(), (4, 3));
        assert_eq!(grids.elements.divisions(), (16, 9));
        let longest = grids
            .elements
            .polygons()
            .unwrap()
            .iter()
            .flat_map(|p| p.edges().map(|(a, b)| a.distance(b)).collect::<Vec<_>>())
            .fold(0.0, f64::max);
        assert!(longest <= 0.3 + 1e-12);
        let grids = only(&quad(), Subdivision::Uniform(12), Some(Subdivision::EdgeLength(0.5)));
        // 4.03/0.5 → 9, next divisor of 12 is 12; 2.24/0.5 → 5, next is 6.
        assert_eq!(grids.patches.unwrap().divisions(), (12, 6));
    }

    #[test]
    fn a_heptagon_is_whole_at_one_and_three_pieces_beyond() {
        let face: Vec<DVec3> = (0..7).map(|k| DVec3::from_angle_xy(k as f64 * std::f64::consts::TAU / 7.0)).collect();
        let polygon = Polygon::new(&face).unwrap();
        assert_eq!(grids(0, &polygon, Subdivision::Uniform(1), None, 0).unwrap().len(), 1);
        let parts = grids(0, &polygon, Subdivision::Uniform(2), Some(Subdivision::Uniform(1)), 3).unwrap();
        // Quadrilaterals (0 1 2 3) and (0 3 4 5), triangle (0 5 6): columns 2 + 2 + 3, all in one patch.
        let shape: Vec<_> = parts.iter().map(|g| (g.elements.corners().len(), g.elements.offset())).collect();
        assert_eq!(shape, [(4, 3), (4, 5), (3, 7)]);
        assert!(parts.iter().all(|g| g.patches.is_none()));
        let sum: f64 = parts.iter().flat_map(|g| g.elements.polygons().unwrap()).map(|p| p.area()).sum();
        // 16 areas of order 1 summed.
        assert!((sum - polygon.area()).abs() < 1e-14);
    }

    trait AngleXy {
        fn from_angle_xy(angle: f64) -> DVec3;
    }

    impl AngleXy for DVec3 {
        fn from_angle_xy(angle: f64) -> DVec3 {
            let (y, x) = angle.sin_cos();
            DVec3::new(x, y, 0.0)
        }
    }

    #[test]
    fn divisions_that_do_not_nest_are_refused() {
        let polygon = Polygon::new(&quad()).unwrap();
        let result = grids(0, &polygon, Subdivision::Uniform(8), Some(Subdivision::Uniform(3)), 0);
        assert_eq!(result.err(), Some(MeshError::Divide { elements: 8, patches: 3 }));
        let result = grids(0, &polygon, Subdivision::EdgeLength(1e-9), None, 0);
        assert!(matches!(result.err(), Some(MeshError::TooMany { limit: MAX_CELLS, .. })));
    }
}
