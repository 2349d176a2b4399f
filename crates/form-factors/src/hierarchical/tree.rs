//! Elements under the cells of a surface's grid, cells in quarters, surfaces in clusters: the nodes that links join.
//!
//! A node of one plane is known by its area, its centroid c, its radius about c and the two half axes u, v of the parallelogram with
//! the same second moments,
//!
//! ```text
//! ∫ (x − c)(x − c)ᵀ dA = A/3 · (u uᵀ + v vᵀ)
//! ```
//!
//! which for a parallelogram are its own. So cells that a contact cuts, triangles and quarters with covered parts are nodes like any other. A
//! cluster holds two nodes of different planes and is known by its sphere and a few points (`clusters`). Every node takes one cache line:
//! refinement looks at pairs of them in no order, and what it reads of a node it reads all at once.

use std::collections::BTreeMap;
use std::ops::Range;

use glam::{DVec3, Vec3};
use radiosity_geometry::Facets;
use radiosity_geometry::mesh::{Mesh, Piece};
use rayon::prelude::*;

use super::clusters::{Clusters, POINTS};
use super::pieces::{Builder, Tree};

/// The plane of a cluster, the element of an inner node, the parent of the root.
pub(super) const NONE: u32 = u32::MAX;
/// Share of its half axes by which the corners of a node may miss those of its parallelogram.
pub(super) const SKEW: f32 = 0.01;

/// One node, in the units of the hierarchy.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    /// Centroid, or centre of a cluster's sphere.
    pub centre: Vec3,
    /// Half axes; 0 for clusters.
    pub u: Vec3,
    pub v: Vec3,
    /// All of the node lies no further from its centre.
    pub radius: f32,
    pub area: f32,
    /// Its plane, or [`NONE`] for a cluster.
    pub plane: u32,
    /// First child (of a cluster: its children's place in a list) and their number; a leaf has none.
    pub first: u32,
    pub count: u16,
    /// Whether it is the parallelogram of its axes, to [`SKEW`].
    pub parallelogram: bool,
    /// Its elements in the order of the hierarchy.
    pub begin: u32,
    pub end: u32,
}

impl Node {
    pub const EMPTY: Self = Self {
        centre: Vec3::ZERO,
        u: Vec3::ZERO,
        v: Vec3::ZERO,
        radius: 0.0,
        area: 0.0,
        plane: 0,
        first: 0,
        count: 0,
        parallelogram: false,
        begin: 0,
        end: 0,
    };

    /// Cluster number k, of two nodes within a sphere.
    pub fn cluster(k: u32, centre: Vec3, radius: f32) -> Self {
        Self { centre, radius, plane: NONE, first: k, count: 2, ..Self::EMPTY }
    }

    pub fn is_leaf(&self) -> bool {
        self.count == 0
    }

    pub fn is_cluster(&self) -> bool {
        self.plane == NONE
    }

    /// Whether the node is the parallelogram of its axes, to [`SKEW`].
    pub fn is_parallelogram(&self) -> bool {
        self.parallelogram
    }

    /// How far the node reaches from its centre along the axes.
    pub fn extent(&self) -> Vec3 {
        Vec3::new(self.reach(Vec3::X), self.reach(Vec3::Y), self.reach(Vec3::Z))
    }

    /// How far the node reaches from its centre along `n`, times the length of n.
    pub fn reach(&self, n: Vec3) -> f32 {
        let sphere = self.radius * n.length();
        if self.parallelogram {
            sphere.min((1.0 + 2.0 * SKEW) * (self.u.dot(n).abs() + self.v.dot(n).abs()))
        } else {
            sphere
        }
    }
}

/// Scene coordinates to those of the hierarchy: about the middle, scaled by a power of two into [−1, 1]³.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub middle: DVec3,
    pub scale: f64,
}

impl Frame {
    fn of(elements: &Facets) -> Self {
        let corners = elements.iter_polygons().flat_map(|(_, p)| p.vertices());
        let (lo, hi) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
        let size = (0.5 * (hi - lo)).max_element();
        let scale = if size > 0.0 && size.is_finite() { (-size.log2().ceil()).exp2() } else { 1.0 };
        Self { middle: 0.5 * (lo + hi), scale }
    }

    pub fn point(&self, v: DVec3) -> Vec3 {
        ((v - self.middle) * self.scale).as_vec3()
    }

    /// Back to the coordinates of the scene.
    pub fn space(&self, v: DVec3) -> DVec3 {
        v / self.scale + self.middle
    }
}

/// Nodes over the elements of a mesh.
#[derive(Debug)]
pub struct Hierarchy {
    pub(super) nodes: Vec<Node>,
    /// Parent of every node; a parent comes before its children.
    pub(super) parents: Vec<u32>,
    /// Element of every leaf, [`NONE`] for other nodes.
    pub(super) elements: Vec<u32>,
    /// Leaf of every element.
    pub(super) leaves: Vec<u32>,
    /// Elements in the order of the hierarchy: those of a node are consecutive.
    pub(super) order: Vec<u32>,
    /// Area of every element in the hierarchy's unit, to 26 bits, so that products with a single-precision number are exact.
    pub(super) weights: Vec<f64>,
    pub(super) normals: Vec<Vec3>,
    /// What the error of a piece counts more than its area says, see [`Self::share`]; of a cluster the mean over its pieces.
    pub(super) shares: Vec<f32>,
    /// Children of the clusters, which come before all other nodes.
    pub(super) pairs: Vec<[u32; 2]>,
    /// Nodes of every piece.
    pub(super) pieces: Vec<Range<usize>>,
    /// Points of the clusters with their normals.
    pub(super) spread: Vec<[(Vec3, Vec3); POINTS]>,
    pub(super) frame: Frame,
}

impl Hierarchy {
    /// The hierarchy of `elements`, which are the elements `exposed` of `mesh`.
    ///
    /// # Panics
    ///
    /// If there is no element, or the lists do not fit each other.
    pub fn new(mesh: &Mesh, exposed: &[u32], elements: &Facets) -> Self {
        assert!(!exposed.is_empty(), "a hierarchy of no elements");
        assert_eq!(exposed.len(), elements.len(), "{} indices of {} elements", exposed.len(), elements.len());
        let frame = Frame::of(elements);
        // Runs of elements of one piece, each with its surface; places of elements in the grid.
        let mut runs: Vec<(&Piece, u32, Range<u32>)> = Vec::new();
        let mut places: Vec<[u32; 2]> = Vec::new();
        for (e, &k) in (0_u32..).zip(exposed) {
            let element = &mesh.elements[k as usize];
            let pieces = mesh.pieces(element.surface as usize);
            let piece = &pieces[pieces.partition_point(|piece| piece.offset() <= element.i) - 1];
            let column = element.i - piece.offset();
            places.push([if piece.corners().len() == 3 { column / 2 } else { column }, element.j]);
            match runs.last_mut() {
                Some((last, _, run)) if std::ptr::eq(*last, piece) => run.end = e + 1,
                _ => runs.push((piece, element.surface, e..e + 1)),
            }
        }
        let surfaces: Vec<u32> = runs.iter().map(|(_, surface, _)| *surface).collect();
        let trees: Vec<Tree> =
            runs.into_par_iter().map(|(piece, _, run)| Builder::tree(elements, &places, &frame, piece, run)).collect();
        let shares = shares(&surfaces, &trees);
        Self::join(trees, &shares, elements, frame)
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Never: there is an element.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        Self::bytes_with(self.nodes.len(), self.order.len())
    }

    /// Bytes of a hierarchy of m elements in large grids, which have a third as many nodes again.
    pub fn bytes_of(m: usize) -> u64 {
        Self::bytes_with(m + m / 3, m)
    }

    fn bytes_with(nodes: usize, elements: usize) -> u64 {
        let (node, element) = (size_of::<Node>() + 2 * size_of::<u32>(), size_of::<f64>() + 2 * size_of::<u32>());
        (node * nodes + element * elements) as u64
    }

    /// Children of a node.
    pub(super) fn children(&self, k: u32) -> impl Iterator<Item = u32> + '_ {
        let node = &self.nodes[k as usize];
        (0..u32::from(node.count))
            .map(move |i| if node.is_cluster() { self.pairs[node.first as usize][i as usize] } else { node.first + i })
    }

    /// Elements under a node.
    pub(super) fn elements_of(&self, k: u32) -> &[u32] {
        let node = &self.nodes[k as usize];
        &self.order[node.begin as usize..node.end as usize]
    }

    /// The leaf in which the share in [0, 1) of a node's area ends, area counted in the order of the hierarchy, and the share of its own
    /// area that is left.
    pub(super) fn leaf_at(&self, mut k: u32, share: f32) -> (u32, f32) {
        let mut rest = share * self.nodes[k as usize].area;
        while !self.nodes[k as usize].is_leaf() {
            let mut next = k;
            for child in self.children(k) {
                next = child;
                let area = self.nodes[child as usize].area;
                if rest < area {
                    break;
                }
                rest -= area;
            }
            // Beyond the last child by rounding only.
            rest = rest.clamp(0.0, self.nodes[next as usize].area);
            k = next;
        }
        (k, (rest / self.nodes[k as usize].area).min(1.0 - f32::EPSILON))
    }

    /// A point of a leaf of `facets` with its normal, from a point of the unit square; areas map to areas.
    pub(super) fn point(&self, facets: &Facets, leaf: u32, [s, t]: [f32; 2]) -> (Vec3, Vec3) {
        let node = &self.nodes[leaf as usize];
        let x = if node.is_parallelogram() {
            node.centre + node.u * (2.0 * s - 1.0) + node.v * (2.0 * t - 1.0)
        } else {
            let element = self.elements[leaf as usize] as usize;
            self.frame.point(facets.polygons(element)[0].sample(s.into(), t.into()))
        };
        (x, self.normals[node.plane as usize])
    }

    /// How much more an error on a node counts than its area says: a surface smaller than the mean of all surfaces counts as much as that.
    /// A norm that is over areas alone leaves small surfaces to err by several times what large ones do.
    pub(super) fn share(&self, k: u32) -> f32 {
        let plane = self.nodes[k as usize].plane;
        self.shares[if plane == NONE { k as usize } else { self.pairs.len() + plane as usize }]
    }

    /// Trees of pieces, whose errors count so many times, under clusters.
    fn join(mut trees: Vec<Tree>, shares: &[f32], facets: &Facets, frame: Frame) -> Self {
        let roots = (0..).zip(&trees).map(|(k, tree)| (k, tree.nodes[0].centre, tree.nodes[0].radius));
        let clusters = Clusters::of(roots.collect());
        let inner = clusters.inner;
        // Pieces in the order in which clusters hold them.
        let (mut at_node, mut at_place) = (inner, 0);
        let mut of_tree = vec![(0, 0); trees.len()];
        for &(k, _) in &clusters.order {
            of_tree[k as usize] = (at_node, at_place);
            at_node += trees[k as usize].nodes.len() as u32;
            at_place += trees[k as usize].order.len() as u32;
        }
        let (mut nodes, mut parents) = (clusters.nodes, clusters.parents);
        nodes.reserve_exact(at_node as usize - nodes.len());
        parents.reserve_exact(at_node as usize - parents.len());
        let mut order = Vec::with_capacity(at_place as usize);
        let (mut normals, mut pieces, mut counted) = (Vec::new(), Vec::new(), vec![0.0; inner as usize]);
        for &(k, parent) in &clusters.order {
            let tree = &mut trees[k as usize];
            let (node_base, place_base) = of_tree[k as usize];
            for node in &mut tree.nodes {
                node.first += node_base;
                (node.begin, node.end) = (node.begin + place_base, node.end + place_base);
                node.plane = normals.len() as u32;
            }
            tree.parents.iter_mut().for_each(|p| *p = if *p == NONE { parent } else { *p + node_base });
            pieces.push(nodes.len()..nodes.len() + tree.nodes.len());
            nodes.append(&mut tree.nodes);
            parents.append(&mut tree.parents);
            order.append(&mut tree.order);
            normals.push(tree.normal.as_vec3());
            counted.push(shares[k as usize]);
        }
        // Clusters name pieces by their number beyond that of the clusters.
        let mut pairs = clusters.pairs;
        pairs.iter_mut().flatten().filter(|k| **k >= inner).for_each(|k| *k = of_tree[(*k - inner) as usize].0);
        let (mut leaves, mut elements) = (vec![NONE; order.len()], vec![NONE; nodes.len()]);
        for (k, node) in nodes.iter().enumerate().filter(|(_, node)| node.is_leaf()) {
            let element = order[node.begin as usize];
            elements[k] = element;
            leaves[element as usize] = k as u32;
        }
        let square = frame.scale * frame.scale;
        let weights = (0..order.len()).map(|e| to_26_bits(facets.area(e) * square)).collect();
        let spread = Vec::new();
        let shares = counted;
        let mut all =
            Self { nodes, parents, elements, leaves, order, weights, normals, shares, pairs, pieces, spread, frame };
        all.finish_clusters(facets, inner);
        all
    }
}

/// max(1, ⟨A⟩/A) of the surface of every tree, A its area and ⟨A⟩ the mean over surfaces.
fn shares(surfaces: &[u32], trees: &[Tree]) -> Vec<f32> {
    let mut areas: BTreeMap<u32, f64> = BTreeMap::new();
    for (surface, tree) in surfaces.iter().zip(trees) {
        *areas.entry(*surface).or_default() += f64::from(tree.nodes[0].area);
    }
    let mean = areas.values().sum::<f64>() / areas.len() as f64;
    surfaces.iter().map(|surface| (mean / areas[surface]).max(1.0) as f32).collect()
}

/// A number rounded to 26 significant bits.
fn to_26_bits(x: f64) -> f64 {
    const LOW: u64 = 1 << 27;
    f64::from_bits((x.to_bits() + LOW / 2) & !(LOW - 1))
}
