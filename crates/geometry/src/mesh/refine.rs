//! A finer mesh from a mesh and what is to be cut in it.
//!
//! A marked element gives way to the four children of its node in the quadtree of its cell; where a contact has cut the
//! node into parts, all of them are cut along the edges of the children, so that every line of contact stays a line of the
//! mesh. The mesh is kept balanced: elements of one surface that share an edge differ by at most one level, so what is beside a node to be cut and coarser
//! than it is cut as well (B. Von Herzen and A. H. Barr, "Accurate triangulations of deformed, intersecting surfaces", SIGGRAPH 1987).
//! Patches stay as they are: children belong to the patch of their parent. [`Mesh::with_patches_split`] cuts patches, along lines along which
//! their elements are cut already.
//!
//! What is *not* here: what is worth refining.

use glam::DVec3;
use rayon::prelude::*;

use super::quadtree::Node;
use super::{Element, Mesh, Neighbours, Piece};
use crate::{Facets, Polygon};

/// A cut that leaves less than this share of a part is not made.
const SLIVER: f64 = 1e-9;

/// A new vertex closer to one of the lattice than this share of the part's size is that one.
const SNAP: f64 = 1e-12;

/// Where an element or a patch of a finer mesh comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// It is this one of the mesh before.
    Kept(u32),
    /// It is a part of this one.
    Part(u32),
}

impl Origin {
    /// The one it is, or is a part of.
    pub fn index(self) -> usize {
        match self {
            Self::Kept(index) | Self::Part(index) => index as usize,
        }
    }
}

/// A finer mesh, with the origin of each of what was cut: elements or patches.
#[derive(Clone, Debug, PartialEq)]
pub struct Refined {
    /// The mesh.
    pub mesh: Mesh,
    /// Where each of its elements (or patches) comes from, in ascending order of the index.
    pub origins: Vec<Origin>,
}

/// Polygons of the four children of a node, with the part of the node that each is cut from.
type Children = [Vec<(usize, Polygon)>; 4];

impl Mesh {
    /// The mesh with marked elements cut into four, and those that balance needs.
    ///
    /// Not cut are elements inside solids, at [`super::MAX_LEVEL`], in cells of more than four corners, and those whose children would
    /// have no area.
    ///
    /// # Panics
    ///
    /// If there is not one mark an element.
    pub fn refined(&self, marked: &[bool]) -> Refined {
        let m = self.elements.len();
        assert_eq!(marked.len(), m, "a mark for every element");
        let cut = self.balanced(marked);
        let mut children: Vec<Option<Children>> =
            (0..m).into_par_iter().map(|e| if cut[e] { self.children(e) } else { None }).collect();

        let mut mesh = Self { elements: Vec::with_capacity(m), ..self.clone() };
        mesh.element_facets = Facets::new();
        mesh.element_begins.clear();
        let mut origins = Vec::with_capacity(m);
        for cell in self.element_begins.windows(2) {
            mesh.element_begins.push(mesh.elements.len());
            let mut e = cell[0];
            while e < cell[1] {
                let (element, parts) = (&self.elements[e], self.leaf(cell[0]..cell[1], self.elements[e].path));
                match children[e].take() {
                    Some(children) => {
                        for (k, child) in (0..).zip(children) {
                            for (part, polygon) in child {
                                let (level, path) = (element.level + 1, element.path.child(element.level, k));
                                mesh.push_part(Element { level, path, ..self.elements[part] }, polygon);
                                origins.push(Origin::Part(part as u32));
                            }
                        }
                    }
                    None => {
                        for part in parts.clone() {
                            mesh.push_part(self.elements[part], self.element_facets.polygons(part)[0].clone());
                            origins.push(Origin::Kept(part as u32));
                        }
                    }
                }
                e = parts.end;
            }
        }
        mesh.element_begins.push(mesh.elements.len());
        Refined { mesh, origins }
    }

    fn push_part(&mut self, element: Element, polygon: Polygon) {
        self.element_facets.push([polygon], element.covered);
        self.elements.push(element);
    }

    /// The first element of every leaf to be cut: marked ones and those that balance needs.
    fn balanced(&self, marked: &[bool]) -> Vec<bool> {
        let neighbours = Neighbours::new(self);
        let mut cut = vec![false; marked.len()];
        let mut open: Vec<usize> = Vec::new();
        let mut ask = |e: usize, node: &Node, open: &mut Vec<usize>| {
            let leaf = self.leaf(self.cell_of_node(node), self.elements[e].path);
            let sees = leaf.clone().any(|part| !self.elements[part].covered);
            if !cut[leaf.start] && sees && self.pieces[node.piece].divisible(self.elements[e].level) {
                cut[leaf.start] = true;
                open.push(leaf.start);
            }
        };
        for e in (0..marked.len()).filter(|&e| marked[e] && !self.elements[e].covered) {
            ask(e, &self.node(e), &mut open);
        }
        while let Some(e) = open.pop() {
            for beside in neighbours.beside(&self.node(e)) {
                let leaf = self.leaves(&beside).start;
                if self.elements[leaf].level < beside.level {
                    ask(leaf, &beside, &mut open);
                }
            }
        }
        cut
    }

    /// The children of the leaf whose first element is e, or `None` if one of them has no area.
    fn children(&self, e: usize) -> Option<Children> {
        let node = self.node(e);
        let piece = &self.pieces[node.piece];
        let cells = cells(piece, &node)?;
        let parts = self.leaf(self.cell_of_node(&node), self.elements[e].path);
        let own = piece.cell_of(node.level, node.at.0, node.at.1);
        if parts.len() == 1 && self.element_facets.polygons(e)[0].vertices() == &own[..] {
            return Some(cells.map(|cell| vec![(e, cell)]));
        }
        let mut children: Children = Default::default();
        for part in parts {
            let quarters = quarters(&self.element_facets.polygons(part)[0], &cells);
            children.iter_mut().zip(quarters).for_each(|(child, quarter)| child.extend(quarter.map(|q| (part, q))));
        }
        Some(children)
    }

    /// The mesh with marked patches cut into the up to four parts that hold their elements.
    ///
    /// The lines are those of the smallest node of a quadtree that holds the elements of the patch. Not cut are patches of one
    /// element, of parts of one leaf alone, and those that are made of several cells.
    ///
    /// # Panics
    ///
    /// If there is not one mark a patch.
    pub fn with_patches_split(&self, marked: &[bool]) -> Refined {
        let n = self.patch_facets.len();
        assert_eq!(marked.len(), n, "a mark for every patch");
        let mut members = vec![Vec::new(); n];
        for (e, element) in self.elements.iter().enumerate().filter(|(_, e)| marked[e.parent as usize]) {
            members[element.parent as usize].push(e);
        }
        let mut mesh = Self { patch_facets: Facets::new(), ..self.clone() };
        let mut origins = Vec::with_capacity(n);
        let mut number = vec![0; n];
        for (p, members) in members.iter().enumerate() {
            number[p] = mesh.patch_facets.len() as u32;
            match self.groups(members) {
                Some((node, groups)) => {
                    for (group, polygons) in groups.iter().zip(self.patch_parts(p, &node, &groups)) {
                        group.iter().for_each(|&e| mesh.elements[e].parent = mesh.patch_facets.len() as u32);
                        mesh.patch_facets.push(polygons, self.patch_facets.covered(p));
                        origins.push(Origin::Part(p as u32));
                    }
                }
                None => {
                    mesh.patch_facets.push(self.patch_facets.polygons(p).to_vec(), self.patch_facets.covered(p));
                    origins.push(Origin::Kept(p as u32));
                }
            }
        }
        // Elements of patches that are not split.
        for (element, old) in mesh.elements.iter_mut().zip(&self.elements) {
            let p = old.parent as usize;
            if matches!(origins[number[p] as usize], Origin::Kept(_)) {
                element.parent = number[p];
            }
        }
        Refined { mesh, origins }
    }

    /// The smallest node that holds some elements, and which of them each of its children holds, empty ones left out.
    fn groups(&self, members: &[usize]) -> Option<(Node, Vec<Vec<usize>>)> {
        let first = &self.elements[*members.first()?];
        let mut level = first.level;
        for &e in members {
            let element = &self.elements[e];
            if (element.surface, element.i, element.j) != (first.surface, first.i, first.j) {
                return None;
            }
            level = level.min(element.level).min(first.path.common(element.path, level));
        }
        if members.iter().any(|&e| self.elements[e].level == level) {
            return None;
        }
        let mut groups = vec![Vec::new(); 4];
        members.iter().for_each(|&e| groups[self.elements[e].path.step(level) as usize].push(e));
        groups.retain(|group| !group.is_empty());
        let mut node = self.node(members[0]);
        while node.level > level {
            node = self.parent(&node);
        }
        Some((node, groups))
    }

    /// Polygons of the parts of patch p in each child of a node that holds one of the groups of its elements.
    fn patch_parts(&self, p: usize, node: &Node, groups: &[Vec<usize>]) -> Vec<Vec<Polygon>> {
        let mut children: [Vec<Polygon>; 4] = Default::default();
        let piece = &self.pieces[node.piece];
        if let Some(cells) = cells(piece, node) {
            let own = piece.cell_of(node.level, node.at.0, node.at.1);
            match self.patch_facets.polygons(p) {
                [whole] if whole.vertices() == &own[..] => children = cells.map(|cell| vec![cell]),
                several => {
                    for polygon in several {
                        let quarters = quarters(polygon, &cells);
                        children.iter_mut().zip(quarters).for_each(|(child, quarter)| child.extend(quarter));
                    }
                }
            }
        }
        let part = |group: &Vec<usize>| {
            let k = self.elements[group[0]].path.step(node.level) as usize;
            // The few large parts serve if they are what the elements are; otherwise the elements themselves do.
            let wanted: f64 = group.iter().map(|&e| self.element_facets.area(e)).sum();
            let area: f64 = children[k].iter().map(Polygon::area).sum();
            if (area - wanted).abs() <= SLIVER * wanted {
                children[k].clone()
            } else {
                group.iter().map(|&e| self.element_facets.polygons(e)[0].clone()).collect()
            }
        };
        groups.iter().map(part).collect()
    }
}

/// The children of a node as whole cells, or `None` if one has no area.
fn cells(piece: &Piece, node: &Node) -> Option<[Polygon; 4]> {
    let cell = |k: u32| {
        let (i, j) = piece.child(node.at, k);
        Polygon::new(&piece.cell_of(node.level + 1, i, j)).ok()
    };
    Some([cell(0)?, cell(1)?, cell(2)?, cell(3)?])
}

/// What of a polygon lies in each of the four children of a node.
fn quarters(polygon: &Polygon, cells: &[Polygon; 4]) -> [Option<Polygon>; 4] {
    let corners: Vec<&[DVec3]> = cells.iter().map(Polygon::vertices).collect();
    let lattice: Vec<DVec3> = cells.iter().flat_map(Polygon::vertices).copied().collect();
    let cut =
        |polygon: Option<Polygon>, a: DVec3, b: DVec3| polygon.map_or((None, None), |p| halves(p, a, b, &lattice));
    if corners[0].len() == 4 {
        // Left of the line upwards between the columns, then of the line to the right between the rows.
        let (left, right) = cut(Some(polygon.clone()), corners[0][1], corners[2][2]);
        let [(left_up, left_low), (right_up, right_low)] =
            [left, right].map(|side| cut(side, corners[0][3], corners[1][2]));
        return [left_low, right_low, left_up, right_up];
    }
    // One corner after the other, each left of the line from the next middle to the last.
    let mut rest = Some(polygon.clone());
    let mut quarters = [const { None }; 4];
    for k in 0..3 {
        let (corner, others) = cut(rest, corners[k][(k + 1) % 3], corners[k][(k + 2) % 3]);
        (quarters[k], rest) = (corner, others);
    }
    quarters[3] = rest;
    quarters
}

/// The parts left and right of the line from a to b; a sliver is not cut off. New vertices that are points of the lattice but for
/// rounding are made so.
fn halves(polygon: Polygon, a: DVec3, b: DVec3, lattice: &[DVec3]) -> (Option<Polygon>, Option<Polygon>) {
    let Some(left) = polygon.normal().cross(b - a).try_normalize() else { return (Some(polygon), None) };
    let size = polygon.diameter();
    let snapped = |part: Polygon| {
        let near = |v: &DVec3| lattice.iter().find(|p| p.distance(*v) <= SNAP * size).copied().unwrap_or(*v);
        Polygon::new(&part.vertices().iter().map(near).collect::<Vec<_>>()).unwrap_or(part)
    };
    match polygon.split(a, left, SLIVER * size) {
        Some((front, back)) if front.area().min(back.area()) > SLIVER * polygon.area() => {
            (Some(snapped(front)), Some(snapped(back)))
        }
        _ if (polygon.centroid() - a).dot(left) > 0.0 => (Some(polygon), None),
        _ => (None, Some(polygon)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{MeshSettings, Subdivision};
    use crate::testing::{Random, cornell_box, cube, scene_of};
    use crate::{Occluders, Scene};

    fn coarse(scene: &Scene, k: u32, patches: Option<u32>) -> Mesh {
        let patches = patches.map(Subdivision::Uniform);
        let settings = MeshSettings { elements: Subdivision::Uniform(k), patches, contacts: true };
        Mesh::new(scene, &Occluders::of_scene(scene), &settings).unwrap()
    }

    /// The Cornell box, with a triangle and a pentagon beside it.
    fn scene() -> Scene {
        let mut faces = cornell_box();
        let at = |points: &[(f64, f64)], z: f64| points.iter().map(|&(x, y)| DVec3::new(x, y, z)).collect();
        faces.push(at(&[(0., 700.), (400., 700.), (100., 1000.)], 10.0));
        faces.push(at(&[(500., 700.), (600., 900.), (400., 1100.), (200., 900.), (250., 700.)], 20.0));
        scene_of(&faces)
    }

    /// Refined `rounds` times at random, with the share of the elements marked each time.
    fn refined(mesh: &Mesh, rounds: usize, share: f64) -> Mesh {
        let mut random = Random(3);
        (0..rounds).fold(mesh.clone(), |mesh, _| {
            let marked: Vec<bool> = mesh.elements.iter().map(|_| random.unit() < share).collect();
            mesh.refined(&marked).mesh
        })
    }

    fn areas(mesh: &Mesh, index: impl Fn(&Element) -> usize) -> Vec<f64> {
        let count = mesh.elements.iter().map(&index).max().unwrap() + 1;
        let mut areas = vec![0.0; count];
        mesh.elements.iter().zip(mesh.areas()).for_each(|(e, area)| areas[index(e)] += area);
        areas
    }

    fn depth_at(mesh: &Mesh, e: usize, point: DVec3) -> f64 {
        super::super::depth(&mesh.element_facets.polygons(e)[0], point)
    }

    #[test]
    fn all_cut_is_the_mesh_of_twice_as_many_cells() {
        for scene in [scene_of(&cube(2.0)), scene_of(&[scene().surfaces[19].pieces[0].vertices().to_vec()])] {
            let (mesh, finer) = (coarse(&scene, 3, None), coarse(&scene, 6, None));
            let mesh = mesh.refined(&vec![true; mesh.elements.len()]).mesh;
            let corners = |mesh: &Mesh| {
                let corners =
                    |(_, p): (usize, &Polygon)| p.vertices().iter().map(|v| v.to_array().map(f64::to_bits)).collect();
                let mut all: Vec<Vec<[u64; 3]>> = mesh.element_facets.iter_polygons().map(corners).collect();
                all.sort_unstable();
                all
            };
            assert_eq!(corners(&mesh), corners(&finer));
        }
    }

    /// 1e-9 is what a sliver that is not cut off may leave on the wrong side.
    #[test]
    fn areas_of_patches_and_of_what_is_covered_stay() {
        let scene = scene();
        for (k, patches) in [(3, None), (4, Some(2)), (2, Some(1))] {
            let before = coarse(&scene, k, patches);
            let after = refined(&before, 4, 0.2);
            assert!(after.elements.len() > 3 * before.elements.len());
            assert_eq!(after.patch_facets, before.patch_facets);
            for index in [|e: &Element| e.parent as usize, |e: &Element| usize::from(e.covered)] {
                let pairs = areas(&before, index).into_iter().zip(areas(&after, index)).enumerate();
                pairs.for_each(|(p, (a, b))| assert!((a - b).abs() <= 1e-9 * a, "{k}: {p} has {b} instead of {a}"));
            }
        }
    }

    #[test]
    fn what_is_not_cut_is_kept_and_parts_name_what_they_are_parts_of() {
        let before = coarse(&scene(), 3, Some(3));
        let marked: Vec<bool> = (0..before.elements.len()).map(|e| e % 7 == 2).collect();
        let Refined { mesh, origins } = before.refined(&marked);
        assert_eq!(origins.len(), mesh.elements.len());
        assert!(origins.iter().filter(|o| matches!(o, Origin::Part(_))).count() > 20);
        for (e, origin) in origins.iter().enumerate() {
            let (new, old) = (&mesh.elements[e], &before.elements[origin.index()]);
            let (polygon, before) =
                (&mesh.element_facets.polygons(e)[0], &before.element_facets.polygons(origin.index())[0]);
            assert_eq!(
                (new.surface, new.i, new.j, new.parent, new.covered),
                (old.surface, old.i, old.j, old.parent, old.covered)
            );
            match origin {
                Origin::Kept(_) => assert_eq!((new, polygon), (old, before)),
                Origin::Part(_) => {
                    assert_eq!(new.level, old.level + 1);
                    assert!(super::super::depth(before, polygon.centroid()) > 0.0);
                }
            }
        }
    }

    #[test]
    fn neighbours_differ_by_one_level_and_know_each_other() {
        let mesh = refined(&coarse(&scene(), 2, None), 5, 0.08);
        let neighbours = Neighbours::new(&mesh);
        let all: Vec<Vec<usize>> = (0..mesh.elements.len()).map(|e| neighbours.of(e)).collect();
        let deepest = mesh.elements.iter().map(|e| e.level).max().unwrap();
        assert!(deepest >= 4, "{deepest}");
        for (e, of) in all.iter().enumerate().filter(|(e, _)| !mesh.elements[*e].covered) {
            assert!(!of.is_empty());
            for &other in of {
                assert!(mesh.elements[e].level.abs_diff(mesh.elements[other].level) <= 1, "{e} and {other}");
                assert!(all[other].contains(&e), "{e} and {other}");
            }
        }
        // Across the seam of the two pieces of the pentagon.
        let pieces = mesh.pieces(20);
        let column = pieces[1].offset();
        let across = |e: usize| mesh.elements[e].surface == 20 && mesh.elements[e].i < column;
        assert!((0..all.len()).filter(|&e| across(e)).any(|e| all[e].iter().any(|&o| !across(o))));
    }

    #[test]
    fn every_element_is_found_where_it_is() {
        let mesh = refined(&coarse(&scene(), 2, None), 5, 0.1);
        let mut random = Random(11);
        for _ in 0..20_000 {
            let s = (random.unit() * 21.0) as usize;
            let piece = (random.unit() * mesh.pieces(s).len() as f64) as usize;
            let (u, mut v) = (random.unit(), random.unit());
            if mesh.pieces(s)[piece].corners().len() == 3 {
                v *= 1.0 - u;
            }
            let (e, point) = (mesh.locate(s, piece, u, v).unwrap(), mesh.pieces(s)[piece].point(u, v));
            assert_eq!(mesh.elements[e].surface as usize, s);
            assert!(depth_at(&mesh, e, point) > -1e-9, "{s} {u} {v}: {}", depth_at(&mesh, e, point));
        }
    }

    #[test]
    fn report_cells_share_out_refined_elements() {
        let scene = scene();
        let mesh = refined(&coarse(&scene, 3, None), 3, 0.2);
        let grid = mesh.report_grid(&scene, 5).unwrap();
        let mut shared = vec![0.0; mesh.elements.len()];
        grid.cells.iter().flat_map(|c| &c.overlaps).for_each(|&(e, area)| shared[e as usize] += area);
        for (e, shared) in shared.iter().enumerate().filter(|(e, _)| !mesh.elements[*e].covered) {
            assert!((shared / mesh.element_facets.area(e) - 1.0).abs() < 1e-9, "element {e}");
        }
    }

    /// A cube is closed: each edge of each polygon is there once in the other direction.
    #[test]
    fn the_display_of_a_refined_cube_has_no_cracks() {
        let mesh = refined(&coarse(&scene_of(&cube(2.0)), 3, None), 4, 0.1);
        let mut edges = std::collections::HashMap::new();
        let mut hanging = 0;
        for (e, loop_) in mesh.without_cracks().iter().enumerate() {
            hanging += loop_.len() - mesh.element_facets.polygons(e)[0].vertices().len();
            for (k, a) in loop_.iter().enumerate() {
                let key = |v: &DVec3| v.to_array().map(f64::to_bits);
                *edges.entry((key(a), key(&loop_[(k + 1) % loop_.len()]))).or_insert(0) += 1;
            }
        }
        assert!(hanging > 50);
        assert!(edges.iter().all(|((a, b), &count)| count == 1 && edges.get(&(*b, *a)) == Some(&1)));
    }

    #[test]
    fn split_patches_have_the_areas_of_their_elements() {
        let scene = scene();
        let mut mesh = refined(&coarse(&scene, 2, Some(2)), 3, 0.5);
        for round in 0..3 {
            let n = mesh.patch_facets.len();
            let marked: Vec<bool> = (0..n).map(|p| p % 3 != 1).collect();
            let Refined { mesh: after, origins } = mesh.with_patches_split(&marked);
            assert!(after.patch_facets.len() > n, "round {round}");
            assert_eq!(origins.len(), after.patch_facets.len());
            let areas = areas(&after, |e| e.parent as usize);
            for (p, area) in areas.iter().enumerate() {
                assert!((after.patch_facets.area(p) / area - 1.0).abs() < 1e-8, "round {round}, patch {p}");
            }
            for (element, old) in after.elements.iter().zip(&mesh.elements) {
                assert_eq!(origins[element.parent as usize].index(), old.parent as usize);
                assert_eq!(after.patch_facets.covered(element.parent as usize), element.covered);
            }
            mesh = after;
        }
    }

    #[test]
    fn one_and_two_threads_refine_alike() {
        let mesh = coarse(&scene(), 3, Some(3));
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let fine = refined(&mesh, 3, 0.2);
                (fine.without_cracks(), fine.with_patches_split(&vec![true; fine.patch_facets.len()]))
            })
        };
        assert_eq!(with(1), with(2));
    }
}
