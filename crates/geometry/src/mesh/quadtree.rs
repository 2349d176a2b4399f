//! Quadtrees of cells: where an element is, and which elements are next to it.
//!
//! A cell is the root of a quadtree in its own parameters: a quadrilateral is halved along both, a triangle becomes three
//! triangles at its corners and one between them. Only leaves are kept, each by its level and by its path from the root, two bits
//! a step from the highest on, in ascending order (a linear quadtree: I. Gargantini, "An effective way to represent
//! quadtrees", CACM 25, 1982). So the leaf at a point is a binary search, the leaves under a node are a range, and what is next to a node is found by
//! arithmetic on the lattice of its level. What is *not* here: the polygons of nodes that contacts cut.

use std::collections::HashMap;
use std::ops::Range;

use glam::DVec3;

use super::{Mesh, Piece};

/// Deepest level of an element: an edge of 1 in 4096 of its cell's.
pub const MAX_LEVEL: u8 = 12;

/// Cells along an edge of a lattice, at most.
const MOST_ALONG: u64 = 1 << 30;

/// The way from the root of a quadtree to a node: the number of a child in two bits a step, the first step highest. A
/// node and its first descendants have one path, and differ in level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Path(u32);

impl Path {
    pub(super) const ROOT: Self = Self(0);

    /// Bits from which on the path of a node of this level is zero.
    fn shift(level: u8) -> u32 {
        2 * u32::from(MAX_LEVEL - level)
    }

    /// The path of child k of a node of the given level.
    pub(super) fn child(self, level: u8, k: u32) -> Self {
        Self(self.0 | k << Self::shift(level + 1))
    }

    /// Number of the child that is taken from a node of the given level.
    pub(super) fn step(self, level: u8) -> u32 {
        self.0 >> Self::shift(level + 1) & 3
    }

    /// Whether it passes through the node of the given level at `node`.
    fn within(self, level: u8, node: Self) -> bool {
        self.0 >> Self::shift(level) == node.0 >> Self::shift(level)
    }

    /// Steps that two paths have in common, at most `level`.
    pub(super) fn common(self, other: Self, level: u8) -> u8 {
        (0..=level).rev().find(|&l| self.within(l, other)).unwrap_or(0)
    }
}

/// A node by its place in the lattice of its level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Node {
    pub(super) piece: usize,
    pub(super) level: u8,
    /// Column and row in the piece's lattice of this level, numbered as cells are.
    pub(super) at: (u32, u32),
}

impl Piece {
    /// Whether cells of this piece have children at the level after this one.
    pub(super) fn divisible(&self, level: u8) -> bool {
        let along = u64::from(self.divisions().0.max(self.divisions().1));
        level < MAX_LEVEL && self.corners().len() <= 4 && along << (level + 1) <= MOST_ALONG
    }

    /// Child k of cell (i, j) of a lattice, in the lattice of the next level.
    ///
    /// Of a quadrilateral k = x + 2y; of a triangle the child at corner k of [`Self::cell_of`], or the middle one for k = 3.
    pub(super) fn child(&self, (i, j): (u32, u32), k: u32) -> (u32, u32) {
        if self.corners().len() != 3 {
            return (2 * i + (k & 1), 2 * j + (k >> 1));
        }
        let (column, inverted) = (i / 2, i % 2);
        let (x, y, inverted) = match (inverted, k) {
            (0, 0..3) => ([0, 1, 0][k as usize], [0, 0, 1][k as usize], 0),
            (0, _) => (0, 0, 1),
            (_, 0..3) => ([1, 1, 0][k as usize], [0, 1, 1][k as usize], 1),
            _ => (1, 1, 0),
        };
        (2 * (2 * column + x) + inverted, 2 * j + y)
    }

    /// The parent of cell (i, j) of a lattice, in the lattice of the level before.
    pub(super) fn parent(&self, (i, j): (u32, u32)) -> (u32, u32) {
        if self.corners().len() != 3 {
            return (i / 2, j / 2);
        }
        // Sixths of the parent's lattice steps: centres are 1/3 or 2/3 of a step beyond a corner.
        let third = 1 + i % 2;
        let (s, t) = (3 * u64::from(i / 2) + u64::from(third), 3 * u64::from(j) + u64::from(third));
        ((2 * (s / 6) + u64::from(s % 6 + t % 6 > 6)) as u32, (t / 6) as u32)
    }

    /// Cell of a node's root, and the path to it.
    fn path_of(&self, level: u8, mut at: (u32, u32)) -> ((u32, u32), Path) {
        let mut path = Path::ROOT;
        for l in (0..level).rev() {
            let parent = self.parent(at);
            let k = (0..4).find(|&k| self.child(parent, k) == at).unwrap_or(0);
            (path, at) = (path.child(l, k), parent);
        }
        (at, path)
    }

    /// The deepest path to the parameters (u, v), which lie in cell (i, j).
    pub(super) fn path_at(&self, i: u32, j: u32, u: f64, v: f64) -> Path {
        let (nu, nv) = self.divisions();
        let triangle = self.corners().len() == 3;
        let (column, mut inverted) = if triangle { (i / 2, i % 2 == 1) } else { (i, false) };
        let (mut s, mut t) = (u * f64::from(nu) - f64::from(column), v * f64::from(nv) - f64::from(j));
        let mut path = Path::ROOT;
        for level in 0..MAX_LEVEL {
            let (x, y) = (s >= 0.5, t >= 0.5);
            let (k, x, y) = match (triangle, inverted) {
                (false, _) => (u32::from(x) + 2 * u32::from(y), x, y),
                (true, false) if x => (1, true, false),
                (true, false) if y => (2, false, true),
                (true, false) if s + t <= 0.5 => (0, false, false),
                (true, true) if !y => (0, true, false),
                (true, true) if !x => (2, false, true),
                (true, true) if s + t > 1.5 => (1, true, true),
                (true, was) => {
                    inverted = !was;
                    (3, was, was)
                }
            };
            path = path.child(level, k);
            (s, t) = (2.0 * s - f64::from(u8::from(x)), 2.0 * t - f64::from(u8::from(y)));
        }
        path
    }

    /// Cells of a lattice that share an edge with cell (i, j), in the lattice itself, or beyond an edge of the piece: its number, and
    /// how far along it.
    fn beside(&self, level: u8, (i, j): (u32, u32)) -> Vec<Result<(u32, u32), (usize, u32)>> {
        let (nu, nv) = self.lattice(level);
        if self.corners().len() != 3 {
            return vec![
                if j > 0 { Ok((i, j - 1)) } else { Err((0, i)) },
                if i + 1 < nu { Ok((i + 1, j)) } else { Err((1, j)) },
                if j + 1 < nv { Ok((i, j + 1)) } else { Err((2, i)) },
                if i > 0 { Ok((i - 1, j)) } else { Err((3, j)) },
            ];
        }
        let column = i / 2;
        if i % 2 == 1 {
            return vec![Ok((i - 1, j)), Ok((i + 1, j)), Ok((2 * column, j + 1))];
        }
        vec![
            if j > 0 { Ok((2 * column + 1, j - 1)) } else { Err((0, column)) },
            if column + j + 1 < nu { Ok((i + 1, j)) } else { Err((1, j)) },
            if i > 0 { Ok((i - 1, j)) } else { Err((2, j)) },
        ]
    }

    /// Corners that the edges of [`Self::beside`] run between, and cells along each at the given level.
    fn borders(&self, level: u8) -> Vec<([DVec3; 2], u32)> {
        let (c, (nu, nv)) = (self.corners(), self.lattice(level));
        match c.len() {
            3 => vec![([c[0], c[1]], nu), ([c[1], c[2]], nu), ([c[0], c[2]], nu)],
            4 => vec![([c[0], c[1]], nu), ([c[1], c[2]], nv), ([c[3], c[2]], nu), ([c[0], c[3]], nv)],
            _ => Vec::new(),
        }
    }

    /// The cell at place k along an edge.
    fn at_border(&self, level: u8, edge: usize, k: u32) -> (u32, u32) {
        let (nu, nv) = self.lattice(level);
        match (self.corners().len(), edge) {
            (3, 0) => (2 * k, 0),
            (3, 1) => (2 * (nu - 1 - k), k),
            (_, 0) => (k, 0),
            (_, 1) => (nu - 1, k),
            (4, 2) => (k, nv - 1),
            _ => (0, k),
        }
    }
}

/// An edge of a piece: the piece, its number there, and whether it runs from the larger to the smaller end.
type Border = (usize, usize, bool);

/// The same for both directions of an edge.
type Key = [[u64; 3]; 2];

fn key([a, b]: [DVec3; 2]) -> (Key, bool) {
    let reversed = (b.x, b.y, b.z) < (a.x, a.y, a.z);
    let (a, b) = if reversed { (b, a) } else { (a, b) };
    ([a, b].map(|p| p.to_array().map(f64::to_bits)), reversed)
}

/// Who is next to whom on a surface.
///
/// Pieces of a surface are joined where they share an edge and are cut into equally many cells along it.
pub struct Neighbours<'a> {
    mesh: &'a Mesh,
    /// Edges of pieces that run between two corners.
    borders: HashMap<Key, Vec<Border>>,
}

impl<'a> Neighbours<'a> {
    /// Neighbours in a mesh.
    pub fn new(mesh: &'a Mesh) -> Self {
        let mut borders: HashMap<Key, Vec<Border>> = HashMap::new();
        for (k, piece) in mesh.pieces.iter().enumerate() {
            for (edge, (ends, _)) in piece.borders(0).into_iter().enumerate() {
                let (key, reversed) = key(ends);
                borders.entry(key).or_default().push((k, edge, reversed));
            }
        }
        Self { mesh, borders }
    }

    /// Elements of the same surface that share a part of an edge with element e, ascending; those inside solids left out.
    ///
    /// # Panics
    ///
    /// If there is no element e.
    pub fn of(&self, e: usize) -> Vec<usize> {
        let (mesh, node) = (self.mesh, self.mesh.node(e));
        let own = mesh.leaf(mesh.cell_of_node(&node), mesh.elements[e].path);
        let mut found: Vec<usize> = own.filter(|&other| other != e).collect();
        for beside in self.beside(&node) {
            found.extend(mesh.leaves(&beside));
        }
        found.sort_unstable();
        found.dedup();
        let polygon = |e: usize| &mesh.element_facets.polygons(e)[0];
        found.retain(|&other| !mesh.elements[other].covered && share_an_edge(polygon(e), polygon(other)));
        found
    }

    /// Nodes of the same level on the other side of a node's edges.
    pub(super) fn beside(&self, node: &Node) -> Vec<Node> {
        let pieces = &self.mesh.pieces;
        let piece = &pieces[node.piece];
        let mut all = Vec::with_capacity(4);
        for beside in piece.beside(node.level, node.at) {
            match beside {
                Ok(at) => all.push(Node { at, ..*node }),
                Err((edge, k)) => {
                    let (ends, along) = piece.borders(node.level)[edge];
                    let (key, reversed) = key(ends);
                    for &(other, edge, other_reversed) in self.borders.get(&key).into_iter().flatten() {
                        let to = &pieces[other];
                        let joined = to.surface == piece.surface && to.borders(node.level)[edge].1 == along;
                        if joined && (other != node.piece) {
                            let k = if reversed == other_reversed { k } else { along - 1 - k };
                            all.push(Node { piece: other, at: to.at_border(node.level, edge, k), ..*node });
                        }
                    }
                }
            }
        }
        all
    }
}

/// Whether two polygons of one plane lie on both sides of a common segment.
fn share_an_edge(p: &crate::Polygon, q: &crate::Polygon) -> bool {
    /// What counts as rounding, of the length of an edge.
    const SLACK: f64 = 1e-6;
    p.edges().any(|(a, b)| {
        let (length, along) = (a.distance(b), (b - a).normalize_or_zero());
        let slack = SLACK * length;
        q.edges().any(|(c, d)| {
            let (from, to) = ((d - a).dot(along), (c - a).dot(along));
            let off = |v: DVec3, s: f64| (v - a - along * s).length();
            to.min(length) - from.max(0.0) > slack && off(d, from) <= slack && off(c, to) <= slack
        })
    })
}

impl Mesh {
    /// The node of an element.
    pub(super) fn node(&self, e: usize) -> Node {
        let element = &self.elements[e];
        let faces = self.surface_begins[element.surface as usize]..self.surface_begins[element.surface as usize + 1];
        let (begin, end) = (self.face_begins[faces.start], self.face_begins[faces.end]);
        let piece = begin + self.pieces[begin..end].partition_point(|p| p.offset() <= element.i) - 1;
        let mut at = (element.i - self.pieces[piece].offset(), element.j);
        for level in 0..element.level {
            at = self.pieces[piece].child(at, element.path.step(level));
        }
        Node { piece, level: element.level, at }
    }

    /// The node that a node is a child of.
    pub(super) fn parent(&self, node: &Node) -> Node {
        Node { level: node.level - 1, at: self.pieces[node.piece].parent(node.at), ..*node }
    }

    /// Elements of the cell that holds a node.
    pub(super) fn cell_of_node(&self, node: &Node) -> Range<usize> {
        let ((i, j), _) = self.pieces[node.piece].path_of(node.level, node.at);
        self.cell_elements(node.piece, i, j)
    }

    /// Elements of the leaf of a cell (given by its elements) through which a path runs.
    pub(super) fn leaf(&self, cell: Range<usize>, path: Path) -> Range<usize> {
        let elements = &self.elements[cell.clone()];
        let end = elements.partition_point(|e| e.path <= path).max(1);
        let begin = elements.partition_point(|e| e.path < elements[end - 1].path);
        cell.start + begin..cell.start + end
    }

    /// Elements of the leaves under a node, or of the leaf that holds it.
    pub(super) fn leaves(&self, node: &Node) -> Range<usize> {
        let ((i, j), path) = self.pieces[node.piece].path_of(node.level, node.at);
        let cell = self.cell_elements(node.piece, i, j);
        let leaf = self.leaf(cell.clone(), path);
        if self.elements[leaf.start].level <= node.level {
            return leaf;
        }
        let elements = &self.elements[cell.clone()];
        let begin = elements.partition_point(|e| e.path < path);
        let len = elements[begin..].partition_point(|e| e.path.within(node.level, path));
        cell.start + begin..cell.start + begin + len
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Subdivision;
    use crate::mesh::subdivide::grids;
    use crate::{Polygon, mesh::subdivide};

    fn piece(corners: usize) -> Piece {
        let quad = [DVec3::ZERO, DVec3::new(4.0, 0.5, 0.0), DVec3::new(3.5, 3.0, 0.0), DVec3::new(-0.5, 2.0, 0.0)];
        let face = Polygon::new(&quad[..corners]).unwrap();
        let grids: Vec<subdivide::Grids> = grids(0, &face, Subdivision::Uniform(3), None, 0).unwrap();
        grids.into_iter().next().unwrap().elements
    }

    #[test]
    fn children_fill_their_parent_and_know_it() {
        for piece in [piece(3), piece(4)] {
            for at in piece.indices() {
                let area = |level: u8, (i, j): (u32, u32)| Polygon::new(&piece.cell_of(level, i, j)).unwrap().area();
                let children = [0, 1, 2, 3].map(|k| piece.child(at, k));
                let sum: f64 = children.iter().map(|&child| area(1, child)).sum();
                // Four areas of order 1 added.
                assert!((sum - area(0, at)).abs() < 1e-14);
                assert!(children.iter().all(|&child| piece.parent(child) == at));
                for (k, &child) in children.iter().enumerate() {
                    assert_eq!(piece.path_of(1, child), (at, Path::ROOT.child(0, k as u32)));
                }
            }
        }
    }

    #[test]
    fn the_path_to_the_centre_of_a_node_is_its_path() {
        for piece in [piece(3), piece(4)] {
            let (level, (nu, nv)) = (3, piece.lattice(3));
            let fine = piece.with_divisions((nu, nv));
            for (i, j) in fine.indices() {
                let third = f64::from(1 + i % 2) / 3.0;
                let (x, y) = match piece.corners().len() {
                    3 => (f64::from(i / 2) + third, f64::from(j) + third),
                    _ => (f64::from(i) + 0.5, f64::from(j) + 0.5),
                };
                let (cell, path) = piece.path_of(level, (i, j));
                let deep = piece.path_at(cell.0, cell.1, x / f64::from(nu), y / f64::from(nv));
                assert!(deep.within(level, path), "{i} {j}");
            }
        }
    }

    #[test]
    fn who_is_beside_a_cell_has_it_beside() {
        for piece in [piece(3), piece(4)] {
            let fine = piece.with_divisions(piece.lattice(1));
            let mut pairs = 0;
            for at in fine.indices() {
                for beside in piece.beside(1, at).into_iter().flatten() {
                    assert!(piece.beside(1, beside).contains(&Ok(at)));
                    pairs += 1;
                }
            }
            // 6 × 6 cells: 2·6·5 inner edges, of triangles 3·6·5/2; each from both sides.
            assert_eq!(pairs, if piece.corners().len() == 3 { 90 } else { 120 });
        }
    }
}
