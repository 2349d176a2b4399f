//! Which elements are neighbours, and which of their corners have one value.

use glam::DVec3;
use rayon::prelude::*;

use super::super::Mesh;
use super::super::display::Conforming;
use crate::Facets;

/// Faces whose normals differ by less than this angle continue each other.
const FLAT: f64 = 1e-3;

/// Slopes at an edge, over those on both sides, from which on it is a shadow line.
const JUMP: f64 = 3.0;

/// Share of a value that is its rounding.
pub(super) const ROUNDING: f64 = 1e-12;

/// Least cosine of the angle between two directions that count as the same.
const AHEAD: f64 = 0.5;

/// An edge that two elements of one plane share.
#[derive(Clone, Copy, Debug)]
struct Joint {
    elements: [u32; 2],
    /// Corners of both at its two ends.
    ends: [[u32; 2]; 2],
}

/// Elements with what continues them in their planes.
pub(super) struct Plane {
    loops: Conforming,
    joints: Vec<Joint>,
    /// Joints of every element, by element.
    beside: Lists,
}

/// Lists of numbers one after the other.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Lists {
    begins: Vec<u32>,
    items: Vec<u32>,
}

impl Lists {
    /// From (list, item) pairs: in each list items in the order of the pairs.
    fn new(lists: usize, pairs: impl Iterator<Item = (u32, u32)> + Clone) -> Self {
        let mut begins = vec![0; lists + 1];
        pairs.clone().for_each(|(list, _)| begins[list as usize + 1] += 1);
        for k in 0..lists {
            begins[k + 1] += begins[k];
        }
        let mut next = begins.clone();
        let mut items = vec![0; begins[lists] as usize];
        for (list, item) in pairs {
            items[next[list as usize] as usize] = item;
            next[list as usize] += 1;
        }
        Self { begins, items }
    }

    pub(super) fn of(&self, list: usize) -> &[u32] {
        &self.items[self.begins[list] as usize..self.begins[list + 1] as usize]
    }

    pub(super) fn len(&self) -> usize {
        self.begins.len() - 1
    }
}

/// Corners with one value: nodes. A vertex is one, or several where planes meet or are cut.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Nodes {
    pub(super) positions: Vec<DVec3>,
    begins: Vec<u32>,
    /// Node of every corner, element after element.
    corners: Vec<u32>,
    pub(super) cuts: usize,
}

impl Nodes {
    /// Nodes of an element, counter-clockwise.
    pub(super) fn of(&self, element: usize) -> &[u32] {
        &self.corners[self.begins[element] as usize..self.begins[element + 1] as usize]
    }
}

/// Nodes with who is around them.
pub(super) struct Parted {
    pub(super) nodes: Nodes,
    /// Elements around every node.
    pub(super) around: Lists,
    /// Neighbours of every element that it is not parted from.
    pub(super) neighbours: Lists,
    /// For every node the plane's elements around its vertex, cuts or no cuts, where they surround it; else none.
    pub(super) surround: Lists,
}

impl Plane {
    pub(super) fn new(mesh: &Mesh) -> Self {
        let loops = mesh.conforming();
        let joints = joints(mesh, &loops);
        let ends = joints.iter().enumerate().flat_map(|(k, joint)| joint.elements.map(|e| (e, k as u32)));
        let beside = Lists::new(mesh.elements.len(), ends);
        Self { loops, joints, beside }
    }

    /// Nodes and neighbours where `bands` of values on the elements part them.
    pub(super) fn parted(&self, facets: &Facets, bands: &[&[f64]]) -> Parted {
        let (m, corners) = (self.beside.len(), self.loops.corners.len());
        let centres: Vec<DVec3> = (0..m).map(|e| facets.polygons(e)[0].centroid()).collect();
        let whole: Vec<bool> =
            self.joints.par_iter().map(|joint| !self.jumps(joint.elements, &centres, bands)).collect();
        let joined = || self.joints.iter().zip(&whole).filter(|(_, whole)| **whole).map(|(joint, _)| joint);

        // Corners joined around a vertex are one node.
        let element_of: Vec<u32> =
            (0..m).flat_map(|e| (self.loops.begins[e]..self.loops.begins[e + 1]).map(move |_| e as u32)).collect();
        let mut sets = Sets::new(corners);
        joined().flat_map(|joint| joint.ends).for_each(|[a, b]| sets.join(a, b));
        let (node_of, count) = sets.numbered();
        let mut positions = vec![DVec3::ZERO; count];
        for (&node, &vertex) in node_of.iter().zip(&self.loops.corners) {
            positions[node as usize] = self.loops.positions[vertex as usize];
        }
        let around = Lists::new(count, node_of.iter().copied().zip(element_of.iter().copied()));
        let pairs = joined().flat_map(|joint| [joint.elements, [joint.elements[1], joint.elements[0]]]);
        let neighbours = Lists::new(m, pairs.map(|[e, other]| (e, other)));

        // The same without cuts; as many joints as corners close a ring around a vertex.
        let mut sets = Sets::new(corners);
        self.joints.iter().flat_map(|joint| joint.ends).for_each(|[a, b]| sets.join(a, b));
        let (vertex_of, vertices) = sets.numbered();
        let ring = Lists::new(vertices, vertex_of.iter().copied().zip(element_of.iter().copied()));
        let mut links = vec![0_usize; vertices];
        self.joints.iter().flat_map(|joint| joint.ends).for_each(|[a, _]| links[vertex_of[a as usize] as usize] += 1);
        let mut first = vec![u32::MAX; count];
        for (&node, &vertex) in node_of.iter().zip(&vertex_of) {
            first[node as usize] = vertex;
        }
        let of_node = |(node, &vertex): (u32, &u32)| {
            let elements = ring.of(vertex as usize);
            let closed = links[vertex as usize] >= elements.len();
            elements.iter().filter(move |_| closed).map(move |&e| (node, e))
        };
        let surround = Lists::new(count, (0..).zip(&first).flat_map(of_node));

        let begins = self.loops.begins.clone();
        let nodes = Nodes { positions, begins, corners: node_of, cuts: count - vertices };
        Parted { nodes, around, neighbours, surround }
    }

    /// The criterion of the module page.
    fn jumps(&self, [a, b]: [u32; 2], centres: &[DVec3], bands: &[&[f64]]) -> bool {
        let apart = |a: u32, b: u32| bands.iter().map(|u| (u[a as usize] - u[b as usize]).powi(2)).sum::<f64>().sqrt();
        let size = bands.iter().map(|u| u[a as usize].powi(2).max(u[b as usize].powi(2))).sum::<f64>().sqrt();
        let difference = apart(a, b);
        if difference <= ROUNDING * size {
            return false;
        }
        let distance = |a: u32, b: u32| centres[b as usize] - centres[a as usize];
        // Largest slope on the side of a away from b; `None` where nothing is there.
        let slope = |a: u32, b: u32| {
            let ahead = distance(b, a);
            let others = self.beside.of(a as usize).iter().map(|&joint| {
                let [p, q] = self.joints[joint as usize].elements;
                if p == a { q } else { p }
            });
            let others = others.map(|k| (k, distance(a, k)));
            let away = others.filter(|(_, d)| d.dot(ahead) >= AHEAD * d.length() * ahead.length());
            away.map(|(k, d)| apart(a, k) / d.length()).reduce(f64::max)
        };
        match (slope(a, b), slope(b, a)) {
            (Some(p), Some(q)) => difference / distance(a, b).length() > JUMP * p.max(q),
            _ => false,
        }
    }
}

/// Edges between exposed elements of one plane on which nothing stands.
fn joints(mesh: &Mesh, loops: &Conforming) -> Vec<Joint> {
    let (faces, m) = (&mesh.faces(), mesh.elements.len());
    let polygon = |e: u32| &mesh.element_facets.polygons(e as usize)[0];

    // The normal of a face is that of its largest element: parts may be slivers.
    let mut largest: Vec<Option<u32>> = vec![None; mesh.face_begins.len()];
    for e in 0..m as u32 {
        let known = &mut largest[faces[e as usize] as usize];
        if known.is_none_or(|other| polygon(e).area() > polygon(other).area()) {
            *known = Some(e);
        }
    }
    let normal = |e: u32| largest[faces[e as usize] as usize].map_or(DVec3::ZERO, |e| polygon(e).normal());
    let one_plane = |a: u32, b: u32| {
        let (p, q) = (normal(a), normal(b));
        faces[a as usize] == faces[b as usize] || (p.dot(q) > 0.0 && p.cross(q).length() <= FLAT)
    };

    // Edges by their vertices, each with its element and its first corner, and whether it runs from the larger number to the smaller.
    let edges = |e: usize| {
        let (begin, end) = (loops.begins[e], loops.begins[e + 1]);
        (begin..end).map(move |corner| {
            let next = if corner + 1 == end { begin } else { corner + 1 };
            let (a, b) = (loops.corners[corner as usize], loops.corners[next as usize]);
            ([a.min(b), a.max(b)], e as u32, [corner, next], a > b)
        })
    };
    let mut all: Vec<_> = (0..m).filter(|&e| !mesh.elements[e].covered).flat_map(edges).collect();
    all.par_sort_unstable();

    let partitions: Vec<_> = mesh.partitions.iter().map(|partitions| partitions.index()).collect();
    let stands = |e: u32, [a, b]: [u32; 2]| {
        let at = |vertex: u32| loops.positions[vertex as usize];
        partitions.get(faces[e as usize] as usize).is_some_and(|face| face.on(at(a), at(b)))
    };
    let groups: Vec<_> = all.chunk_by(|a, b| a.0 == b.0).collect();
    let joint = |group: &&[([u32; 2], u32, [u32; 2], bool)]| {
        // Who else runs along an edge the other way in the same plane; of several, of sheets that lie on each other, the only one of the same
        // face.
        let partner = |k: usize| {
            let (_, e, _, reversed) = group[k];
            let others = || (0..group.len()).filter(move |&o| group[o].3 != reversed && one_plane(e, group[o].1));
            let own = || others().filter(move |&o| faces[group[o].1 as usize] == faces[e as usize]);
            if others().count() == 1 {
                others().next()
            } else if own().count() == 1 {
                own().next()
            } else {
                None
            }
        };
        let pairs = (0..group.len()).filter(|&k| !group[k].3).filter_map(|k| {
            let other = partner(k).filter(|&o| partner(o) == Some(k))?;
            let ((vertices, e, [a, b], _), (_, f, [p, q], _)) = (group[k], group[other]);
            let free = e != f && !stands(e, vertices) && !stands(f, vertices);
            free.then_some(Joint { elements: [e, f], ends: [[a, q], [b, p]] })
        });
        pairs.collect::<Vec<_>>()
    };
    groups.par_iter().flat_map_iter(joint).collect()
}

/// Disjoint sets of numbers (union by smaller root, paths halved: R. E. Tarjan and J. van Leeuwen, JACM 31, 1984).
struct Sets {
    parent: Vec<u32>,
}

impl Sets {
    fn new(count: usize) -> Self {
        Self { parent: (0..count as u32).collect() }
    }

    fn root(&mut self, mut k: u32) -> u32 {
        while self.parent[k as usize] != k {
            let above = self.parent[self.parent[k as usize] as usize];
            self.parent[k as usize] = above;
            k = above;
        }
        k
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }

    /// The set of every number, sets numbered by their smallest member, and how many there are.
    fn numbered(mut self) -> (Vec<u32>, usize) {
        let mut number = vec![0; self.parent.len()];
        let mut count = 0;
        for k in 0..self.parent.len() as u32 {
            let root = self.root(k);
            number[k as usize] = if root == k {
                count += 1;
                count - 1
            } else {
                number[root as usize]
            };
        }
        (number, count as usize)
    }
}
