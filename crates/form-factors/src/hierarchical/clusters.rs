//! Clusters: pieces of different planes, two by two.
//!
//! Pieces are parted by size first, so that the walls of a room do not blow up the spheres of what stands in it, then in halves along
//! the longest axis of their centres. A cluster's sphere is about the middle of its pieces' box, and what light it exchanges is
//! known from [`POINTS`] points that stand for equal parts of its area.

use glam::Vec3;
use radiosity_geometry::Facets;

use super::tree::{Hierarchy, NONE, Node};

/// Points that stand for a cluster.
pub(super) const POINTS: usize = 16;
/// Radii this many times smaller than the largest are of another size, if at least half of the pieces are.
const SMALLER: f32 = 4.0;

/// A piece: its number, centre and radius.
pub(super) type Root = (u32, Vec3, f32);

/// Clusters while they are built.
pub(super) struct Clusters {
    /// Number of clusters there will be.
    pub inner: u32,
    pub nodes: Vec<Node>,
    pub parents: Vec<u32>,
    /// Children of every cluster: clusters, or pieces by their number beyond that of the clusters.
    pub pairs: Vec<[u32; 2]>,
    /// Pieces in order, each with its cluster.
    pub order: Vec<(u32, u32)>,
}

impl Clusters {
    /// Clusters of all pieces.
    pub fn of(mut roots: Vec<Root>) -> Self {
        let inner = (roots.len() - 1) as u32;
        let mut clusters = Self { inner, nodes: Vec::new(), parents: Vec::new(), pairs: Vec::new(), order: Vec::new() };
        clusters.build(&mut roots, NONE);
        clusters
    }

    /// The node of some pieces: a cluster, or a piece by its number beyond that of the clusters.
    fn build(&mut self, roots: &mut [Root], parent: u32) -> u32 {
        if let [(piece, ..)] = roots {
            self.order.push((*piece, parent));
            return self.inner + *piece;
        }
        let reach = |sign: f32| roots.iter().map(move |(_, centre, radius)| *centre + sign * *radius);
        let (lo, hi) = (reach(-1.0).fold(Vec3::INFINITY, Vec3::min), reach(1.0).fold(Vec3::NEG_INFINITY, Vec3::max));
        let centre = 0.5 * (lo + hi);
        let radius = roots.iter().map(|(_, c, radius)| c.distance(centre) + radius).fold(0.0, f32::max);
        let own = self.nodes.len() as u32;
        self.nodes.push(Node::cluster(own, centre, 1.0001 * radius));
        self.parents.push(parent);
        self.pairs.push([0; 2]);
        let middle = part(roots);
        let (left, right) = roots.split_at_mut(middle);
        self.pairs[own as usize] = [self.build(left, own), self.build(right, own)];
        own
    }
}

/// Sorts pieces into two groups, neither of them empty; how many are in the first.
fn part(roots: &mut [Root]) -> usize {
    let largest = roots.iter().map(|r| r.2).fold(0.0, f32::max);
    let small = roots.iter().filter(|r| SMALLER * r.2 < largest).count();
    if 2 * small >= roots.len() {
        // Stable: those of one size keep their order.
        roots.sort_by_key(|r| SMALLER * r.2 < largest);
        return roots.len() - small;
    }
    let (lo, hi) = roots.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), r| (lo.min(r.1), hi.max(r.1)));
    let size = hi - lo;
    let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b]).then(b.cmp(&a))).unwrap_or(0);
    roots.sort_by(|a, b| a.1[axis].total_cmp(&b.1[axis]).then(a.0.cmp(&b.0)));
    roots.len() / 2
}

impl Hierarchy {
    /// Areas, elements and points of the clusters.
    pub(super) fn finish_clusters(&mut self, facets: &Facets, count: u32) {
        for k in (0..count).rev() {
            let [a, b] = self.pairs[k as usize].map(|child| self.nodes[child as usize]);
            let node = &mut self.nodes[k as usize];
            (node.area, node.begin, node.end) = (a.area + b.area, a.begin, b.end);
            let [of_a, of_b] = self.pairs[k as usize].map(|child| self.share(child));
            self.shares[k as usize] = (a.area * of_a + b.area * of_b) / (a.area + b.area);
        }
        let unit = 1.0 / POINTS as f32;
        let points = |k: u32| {
            std::array::from_fn(|i| {
                let (leaf, rest) = self.leaf_at(k, (i as f32 + 0.5) * unit);
                // Across the leaf in the order of van der Corput, whatever its share of the cluster.
                let across = (i.reverse_bits() >> (usize::BITS - POINTS.ilog2())) as f32 + 0.5;
                self.point(facets, leaf, [rest, across * unit])
            })
        };
        self.spread = (0..count).map(points).collect();
    }
}
