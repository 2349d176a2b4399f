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
//! cluster holds two nodes of different planes and is known by its sphere and four elements of it. Every node takes one cache line:
//! refinement looks at pairs of them in no order, and what it reads of a node it reads all at once.

use std::ops::Range;

use glam::{DVec2, DVec3, Vec3};
use radiosity_geometry::mesh::{Mesh, Piece};
use radiosity_geometry::polygon::area_vector;
use radiosity_geometry::{Facets, Polygon};
use rayon::prelude::*;

/// The plane of a cluster, the element of an inner node, the parent of the root.
pub(super) const NONE: u32 = u32::MAX;
/// Most parts of a cell that hang on one node.
const PARTS: usize = 4;
/// Share of its half axes by which the corners of a node may miss those of its parallelogram.
const SKEW: f32 = 0.01;
/// Length of an axis at which the longer side of a node is halved alone.
const LONG: f64 = 1.5;

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
    first: u32,
    count: u16,
    /// Whether it is the parallelogram of its axes, to [`SKEW`].
    parallelogram: bool,
    /// Its elements in the order of the hierarchy.
    begin: u32,
    end: u32,
}

impl Node {
    const EMPTY: Self = Self {
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

/// What a node sums over its elements, in the plane's coordinates about a point of the plane.
#[derive(Clone, Copy, Default)]
struct Moments {
    area: f64,
    first: DVec2,
    /// ∫ x², ∫ xy, ∫ y².
    second: [f64; 3],
}

impl std::ops::AddAssign for Moments {
    fn add_assign(&mut self, other: Self) {
        self.area += other.area;
        self.first += other.first;
        (0..3).for_each(|k| self.second[k] += other.second[k]);
    }
}

/// A plane with coordinates.
#[derive(Clone, Copy)]
struct Plane {
    origin: DVec3,
    x: DVec3,
    y: DVec3,
}

impl Plane {
    /// The plane of a piece, x along its first edge.
    fn of(piece: &Piece, normal: DVec3) -> Self {
        let corners = piece.corners();
        let along = corners[1] - corners[0];
        let x = (along - normal * along.dot(normal)).normalize_or(normal.any_orthonormal_vector());
        Self { origin: corners[0], x, y: normal.cross(x) }
    }

    fn at(&self, v: DVec3) -> DVec2 {
        DVec2::new((v - self.origin).dot(self.x), (v - self.origin).dot(self.y))
    }

    fn moments(&self, polygon: &Polygon) -> Moments {
        let mut sum = Moments::default();
        let corners = polygon.vertices();
        let a = self.at(corners[0]);
        for pair in corners[1..].windows(2) {
            let (b, c) = (self.at(pair[0]), self.at(pair[1]));
            let area = 0.5 * (b - a).perp_dot(c - a);
            let all = a + b + c;
            let of = |p: DVec2, q: DVec2| p.x * q.y;
            let swap = |p: DVec2| DVec2::new(p.y, p.x);
            let product = |f: &dyn Fn(DVec2) -> f64| area / 12.0 * (f(a) + f(b) + f(c) + f(all));
            sum += Moments {
                area,
                first: all * (area / 3.0),
                second: [product(&|p| p.x * p.x), product(&|p| of(p, p)), product(&|p| of(swap(p), p))],
            };
        }
        sum
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
    /// Children of the clusters, which come before all other nodes.
    pairs: Vec<[u32; 2]>,
    /// Nodes of every piece.
    pub(super) pieces: Vec<Range<usize>>,
    /// Points of the clusters with their normals.
    pub(super) spread: Vec<[(Vec3, Vec3); 4]>,
    pub(super) frame: Frame,
}

/// The nodes of one piece, numbered from 0.
struct Tree {
    nodes: Vec<Node>,
    parents: Vec<u32>,
    order: Vec<u32>,
    normal: DVec3,
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
        // Runs of elements of one piece, each with its place in the grid.
        let mut runs: Vec<(&Piece, Range<u32>)> = Vec::new();
        let mut places: Vec<[u32; 2]> = Vec::new();
        for (e, &k) in (0_u32..).zip(exposed) {
            let element = &mesh.elements[k as usize];
            let pieces = mesh.pieces(element.surface as usize);
            let piece = &pieces[pieces.partition_point(|piece| piece.offset() <= element.i) - 1];
            let column = element.i - piece.offset();
            places.push([if piece.corners().len() == 3 { column / 2 } else { column }, element.j]);
            match runs.last_mut() {
                Some((last, run)) if std::ptr::eq(*last, piece) => run.end = e + 1,
                _ => runs.push((piece, e..e + 1)),
            }
        }
        let trees: Vec<Tree> =
            runs.into_par_iter().map(|(piece, run)| Builder::tree(elements, &places, &frame, piece, run)).collect();
        Self::join(trees, elements, frame)
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

    /// Trees of pieces under clusters.
    fn join(mut trees: Vec<Tree>, facets: &Facets, frame: Frame) -> Self {
        let inner = (trees.len() - 1) as u32;
        let mut clusters =
            Clusters { inner, nodes: Vec::new(), parents: Vec::new(), pairs: Vec::new(), order: Vec::new() };
        let mut roots: Vec<(u32, Vec3, f32)> =
            trees.iter().enumerate().map(|(k, tree)| (k as u32, tree.nodes[0].centre, tree.nodes[0].radius)).collect();
        clusters.build(&mut roots, NONE);
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
        let (mut normals, mut pieces) = (Vec::new(), Vec::new());
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
        let mut all = Self { nodes, parents, elements, leaves, order, weights, normals, pairs, pieces, spread, frame };
        all.finish_clusters(inner);
        all
    }

    /// Spheres, areas, elements and sample points of the clusters.
    fn finish_clusters(&mut self, count: u32) {
        for k in (0..count).rev() {
            let [a, b] = self.pairs[k as usize].map(|child| self.nodes[child as usize]);
            let apart = b.centre - a.centre;
            let distance = apart.length();
            let radius = (0.5 * (a.radius + b.radius + distance)).max(a.radius).max(b.radius);
            let along = if distance > 0.0 { ((radius - a.radius) / distance).clamp(0.0, 1.0) } else { 0.0 };
            let node = &mut self.nodes[k as usize];
            (node.centre, node.radius) = (a.centre + apart * along, 1.0001 * radius);
            (node.area, node.begin, node.end) = (a.area + b.area, a.begin, b.end);
        }
        let spread = (0..count).map(|k| {
            [0.125, 0.375, 0.625, 0.875].map(|share| {
                let leaf = &self.nodes[self.leaf_at(k, share).0 as usize];
                (leaf.centre, self.normals[leaf.plane as usize])
            })
        });
        self.spread = spread.collect();
    }
}

/// A number rounded to 26 significant bits.
fn to_26_bits(x: f64) -> f64 {
    const LOW: u64 = 1 << 27;
    f64::from_bits((x.to_bits() + LOW / 2) & !(LOW - 1))
}

/// Whether corners are those of a parallelogram, to [`SKEW`].
fn is_parallelogram(corners: &[DVec3]) -> bool {
    let &[a, b, c, d] = corners else { return false };
    let shortest = a.distance(b).min(b.distance(c)).min(c.distance(d)).min(d.distance(a));
    (a - b + c - d).length() <= 2.0 * f64::from(SKEW) * shortest
}

/// Clusters while they are built: pieces in halves along the longest axis.
struct Clusters {
    /// Number of clusters there will be.
    inner: u32,
    nodes: Vec<Node>,
    parents: Vec<u32>,
    pairs: Vec<[u32; 2]>,
    /// Pieces in order, each with its cluster.
    order: Vec<(u32, u32)>,
}

impl Clusters {
    /// The node of some pieces: a cluster, or a piece by its number beyond that of the clusters.
    fn build(&mut self, roots: &mut [(u32, Vec3, f32)], parent: u32) -> u32 {
        if let [(piece, ..)] = roots {
            self.order.push((*piece, parent));
            return self.inner + *piece;
        }
        let (lo, hi) =
            roots.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), r| (lo.min(r.1), hi.max(r.1)));
        let size = hi - lo;
        let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b]).then(b.cmp(&a))).unwrap_or(0);
        roots.sort_by(|a, b| a.1[axis].total_cmp(&b.1[axis]).then(a.0.cmp(&b.0)));
        let own = self.nodes.len() as u32;
        self.nodes.push(Node { plane: NONE, first: own, count: 2, ..Node::EMPTY });
        self.parents.push(parent);
        self.pairs.push([0; 2]);
        let (left, right) = roots.split_at_mut(roots.len() / 2);
        self.pairs[own as usize] = [self.build(left, own), self.build(right, own)];
        own
    }
}

/// The tree of one piece while it is built.
struct Builder<'a> {
    facets: &'a Facets,
    places: &'a [[u32; 2]],
    frame: &'a Frame,
    plane: Plane,
    /// Size of a cell along the grid's two directions.
    cell: [f64; 2],
    /// Area of a cell if the piece is a parallelogram.
    grid: Option<f64>,
    tree: Tree,
}

impl<'a> Builder<'a> {
    fn tree(facets: &'a Facets, places: &'a [[u32; 2]], frame: &'a Frame, piece: &Piece, run: Range<u32>) -> Tree {
        let normal = facets.polygons(run.start as usize)[0].normal();
        let (n, corners) = (piece.divisions(), piece.corners());
        let last = corners[corners.len() - 1];
        let cell = [corners[0].distance(corners[1]) / f64::from(n.0), corners[0].distance(last) / f64::from(n.1)];
        let tree = Tree { nodes: Vec::new(), parents: Vec::new(), order: run.collect(), normal };
        let grid = is_parallelogram(corners).then(|| area_vector(corners).length() / piece.len() as f64);
        let mut builder = Self { facets, places, frame, plane: Plane::of(piece, normal), cell, grid, tree };
        builder.push(NONE);
        let all = 0..builder.tree.order.len();
        builder.expand(0, all, [0..n.0, 0..n.1]);
        builder.tree
    }

    fn push(&mut self, parent: u32) {
        self.tree.nodes.push(Node::EMPTY);
        self.tree.parents.push(parent);
    }

    /// Makes node k of the elements at `range` of the order, all of them in the given columns and rows.
    fn expand(&mut self, k: u32, range: Range<usize>, grid: [Range<u32>; 2]) -> Moments {
        let (begin, end) = (range.start as u32, range.end as u32);
        let (mut moments, mut radius, mut first, mut count) = (Moments::default(), 0.0_f64, 0, 0);
        let cells = grid[0].len() * grid[1].len();
        let mut parallelogram = range.len() == cells;
        if range.len() == 1 {
            let polygon = self.polygon(range.start);
            moments = self.plane.moments(polygon);
            let centre = self.plane.origin + self.in_space(moments.first / moments.area);
            radius = polygon.vertices().iter().map(|v| v.distance(centre)).fold(0.0, f64::max) * self.frame.scale;
            parallelogram = is_parallelogram(polygon.vertices());
        } else {
            let parts = self.split(range, &grid);
            (first, count) = (self.tree.nodes.len() as u32, parts.len() as u16);
            parts.iter().for_each(|_| self.push(k));
            for (child, (range, grid)) in (first..).zip(parts) {
                moments += self.expand(child, range, grid);
            }
            // Whole cells of a grid that is a parallelogram make another one.
            let whole = |cell: f64| (moments.area / (cells as f64 * cell) - 1.0).abs() <= f64::from(SKEW);
            parallelogram = parallelogram && self.grid.is_some_and(whole);
        }
        // Centre, axes and radius.
        let mean = moments.first / moments.area;
        let centre = self.frame.point(self.plane.origin + self.in_space(mean));
        let [xx, xy, yy] = moments.second.map(|m| m / moments.area);
        let (xx, xy, yy) = (xx - mean.x * mean.x, xy - mean.x * mean.y, (yy - mean.y * mean.y).max(0.0));
        let high = yy.sqrt();
        let lean = if high > 0.0 { xy / high } else { 0.0 };
        let wide = (xx - lean * lean).max(0.0).sqrt();
        let axis = |v: DVec2| (self.in_space(v) * (3.0_f64.sqrt() * self.frame.scale)).as_vec3();
        let (u, v) = (axis(DVec2::new(wide, 0.0)), axis(DVec2::new(lean, high)));
        for child in first..first + u32::from(count) {
            let node = &self.tree.nodes[child as usize];
            parallelogram = parallelogram && node.parallelogram;
            radius = radius.max(f64::from(node.centre.distance(centre) + node.radius));
        }
        let area = (moments.area * self.frame.scale * self.frame.scale) as f32;
        let mut radius = 1.00001 * radius as f32;
        if parallelogram {
            radius = (1.0 + SKEW) * (u + v).length().max((u - v).length());
        }
        self.tree.nodes[k as usize] =
            Node { centre, u, v, radius, area, plane: 0, first, count, parallelogram, begin, end };
        moments
    }

    fn polygon(&self, place: usize) -> &'a Polygon {
        &self.facets.polygons(self.tree.order[place] as usize)[0]
    }

    fn in_space(&self, v: DVec2) -> DVec3 {
        self.plane.x * v.x + self.plane.y * v.y
    }

    /// Quarters of the grid, or halves of its longer side; parts of one cell by themselves, many of them in halves. The order is sorted
    /// accordingly.
    fn split(&mut self, range: Range<usize>, grid: &[Range<u32>; 2]) -> Vec<(Range<usize>, [Range<u32>; 2])> {
        let cells = [grid[0].len(), grid[1].len()];
        if cells == [1, 1] {
            let one = |range: Range<usize>| (range, grid.clone());
            if range.len() <= PARTS {
                return range.map(|k| one(k..k + 1)).collect();
            }
            let middle = range.start + range.len() / 2;
            return vec![one(range.start..middle), one(middle..range.end)];
        }
        let size = [0, 1].map(|k| cells[k] as f64 * self.cell[k]);
        let halve = |k: usize| cells[k] > 1 && (cells[1 - k] == 1 || size[k] * LONG > size[1 - k]);
        let middle = [0, 1].map(|k| if halve(k) { (grid[k].start + grid[k].end) / 2 } else { grid[k].end });
        let places = self.places;
        let quarter = |e: u32| {
            let [i, j] = places[e as usize];
            usize::from(i >= middle[0]) + 2 * usize::from(j >= middle[1])
        };
        self.tree.order[range.clone()].sort_by_key(|&e| quarter(e));
        let mut parts = Vec::with_capacity(4);
        let mut begin = range.start;
        for q in 0..4 {
            let len = self.tree.order[begin..range.end].partition_point(|&e| quarter(e) <= q);
            let side = |k: usize, upper: bool| if upper { middle[k]..grid[k].end } else { grid[k].start..middle[k] };
            if len > 0 {
                parts.push((begin..begin + len, [side(0, q & 1 == 1), side(1, q & 2 == 2)]));
            }
            begin += len;
        }
        parts
    }
}
