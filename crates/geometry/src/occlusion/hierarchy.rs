//! The hierarchy that rays descend: nodes of eight boxes, and blocks of up to eight polygons.
//!
//! A binary hierarchy by `obvhs` (PLOC, Meister & Bittner 2018, with reinsertion) over boxes rounded outward is cut into wide
//! nodes so that the expected cost of a random ray is least: with P the chance to meet a node, by area,
//!
//! ```text
//! C(n, 1) = min(P(n)·c_block, P(n)·c_node + min over k of C(left, k) + C(right, 8 − k))
//! C(n, i) = min(C(n, i − 1), min over k of C(left, k) + C(right, i − k))
//! ```
//!
//! is the cost of node n as a forest of at most i trees (Ylitie, Karras & Laine 2017, with blocks for leaves).

use obvhs::{
    Boundable,
    aabb::Aabb,
    bvh2::{Bvh2, reinsertion::ReinsertionOptimizer},
    ploc::{PlocBuilder, PlocSearchDistance, SortPrecision},
};

use super::lanes::{LANES, Row};

/// Cost of testing a block of polygons, that of a node being 1.
const BLOCK_COST: f32 = 1.0;

/// Share of the nodes that the builder tries to move to a better place in its first round.
const REINSERTION: f32 = 0.2;

/// Eight boxes, of which some may be empty.
#[derive(Clone, Debug)]
#[repr(C)]
pub(super) struct Node {
    /// Lower and upper planes along each axis.
    pub planes: [[Row; 2]; 3],
    /// Its [`Child`]ren.
    pub children: [u32; LANES],
}

/// What a box holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Child(pub u32);

/// What a box holds, taken apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Content {
    Node(usize),
    Block(Place),
}

/// A block by the list it is in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Place {
    Triangles(usize),
    Polygons(usize),
}

impl Child {
    /// The node where every ray begins.
    pub const ROOT: Self = Self(0);

    fn node(index: usize) -> Self {
        Self((index as u32) << 2)
    }

    fn block(place: Place) -> Self {
        match place {
            Place::Triangles(index) => Self((index as u32) << 2 | 1),
            Place::Polygons(index) => Self((index as u32) << 2 | 2),
        }
    }

    #[inline(always)]
    pub fn content(self) -> Content {
        let index = (self.0 >> 2) as usize;
        match self.0 & 3 {
            0 => Content::Node(index),
            1 => Content::Block(Place::Triangles(index)),
            _ => Content::Block(Place::Polygons(index)),
        }
    }
}

/// Boxes of polygons in a tree of wide nodes.
#[derive(Debug, Default)]
pub(super) struct Hierarchy {
    pub nodes: Vec<Node>,
    /// Children that a descent may have to come back to, at most.
    pub pending: usize,
}

/// The polygons of each block, at most [`LANES`].
#[derive(Debug, Default)]
pub(super) struct Members {
    /// Of blocks with nothing but triangles.
    pub triangles: Vec<Vec<u32>>,
    /// Of the others.
    pub polygons: Vec<Vec<u32>>,
}

impl Members {
    fn push(&mut self, members: Vec<u32>, triangles: bool) -> Place {
        let list = if triangles { &mut self.triangles } else { &mut self.polygons };
        list.push(members);
        let index = list.len() - 1;
        if triangles { Place::Triangles(index) } else { Place::Polygons(index) }
    }
}

/// Box of a polygon for the builder.
pub(super) struct OutwardBox(pub Aabb);

impl Boundable for OutwardBox {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

impl Hierarchy {
    /// The hierarchy over some boxes, given which of them hold triangles.
    pub fn new(boxes: &[OutwardBox], is_triangle: impl Fn(u32) -> bool) -> (Self, Members) {
        let (mut hierarchy, mut blocks) = (Self::default(), Members::default());
        if boxes.is_empty() {
            return (hierarchy, blocks);
        }
        let binary = binary(boxes);
        let plan = Plan::new(&binary);
        // Nodes to be made: their place, the binary node they stand for, and their depth.
        let mut open = vec![(0, 0, 1)];
        hierarchy.nodes.push(Node::empty());
        while let Some((place, root, depth)) = open.pop() {
            hierarchy.pending = hierarchy.pending.max(depth * (LANES - 1) + 1);
            for (slot, n) in plan.children(root).into_iter().enumerate() {
                let child = if plan.is_block[n] {
                    let members = plan.members(n);
                    let triangles = members.iter().all(|&k| is_triangle(k));
                    Child::block(blocks.push(members, triangles))
                } else {
                    open.push((hierarchy.nodes.len(), n, depth + 1));
                    hierarchy.nodes.push(Node::empty());
                    Child::node(hierarchy.nodes.len() - 1)
                };
                hierarchy.nodes[place].set(slot, binary.nodes[n].aabb(), child);
            }
        }
        (hierarchy, blocks)
    }

    /// Calls `visit` with every block whose box overlaps the box [least, most] or touches it.
    pub fn overlapping(&self, least: [f32; 3], most: [f32; 3], visit: &mut dyn FnMut(Place)) {
        let mut open = vec![Child::ROOT];
        while let Some(child) = open.pop() {
            match child.content() {
                Content::Block(place) => visit(place),
                Content::Node(index) => open.extend(self.nodes[index].overlapping(least, most)),
            }
        }
    }
}

/// The binary hierarchy, with one box in each of its leaves.
fn binary(boxes: &[OutwardBox]) -> Bvh2 {
    let indices = (0..boxes.len() as u32).collect();
    let (search, precision) = (PlocSearchDistance::Medium, SortPrecision::U64);
    let mut binary = PlocBuilder::with_capacity(boxes.len()).build(search, boxes, indices, precision, 3);
    ReinsertionOptimizer::default().run(&mut binary, REINSERTION, None);
    binary
}

impl Node {
    /// Boxes that no ray meets.
    fn empty() -> Self {
        let sides = [Row([f32::INFINITY; LANES]), Row([f32::NEG_INFINITY; LANES])];
        Self { planes: [sides; 3], children: [Child::ROOT.0; LANES] }
    }

    fn set(&mut self, slot: usize, bounds: &Aabb, child: Child) {
        for (axis, [lower, upper]) in self.planes.iter_mut().enumerate() {
            (lower.0[slot], upper.0[slot]) = (bounds.min[axis], bounds.max[axis]);
        }
        self.children[slot] = child.0;
    }

    /// Children whose boxes overlap a box or touch it.
    fn overlapping(&self, least: [f32; 3], most: [f32; 3]) -> impl Iterator<Item = Child> + '_ {
        let overlaps = move |slot: &usize| {
            let apart = |axis: usize| {
                let [lower, upper] = &self.planes[axis];
                lower.0[*slot] > most[axis] || upper.0[*slot] < least[axis]
            };
            !(0..3).any(apart)
        };
        (0..LANES).filter(overlaps).map(|slot| Child(self.children[slot]))
    }
}

/// Where to cut a binary hierarchy.
struct Plan<'a> {
    binary: &'a Bvh2,
    /// Whether a node is best one block of polygons.
    is_block: Vec<bool>,
    /// Trees that the left child gets if a node may have i + 1 of them; 0 if it does as well with one fewer.
    left: Vec<[u8; LANES]>,
}

impl<'a> Plan<'a> {
    fn new(binary: &'a Bvh2) -> Self {
        let len = binary.nodes.len();
        let mut plan = Self { binary, is_block: vec![true; len], left: vec![[0; LANES]; len] };
        let (mut cost, mut count) = (vec![[0.0_f32; LANES - 1]; len], vec![1_usize; len]);
        for n in plan.children_first() {
            let node = &binary.nodes[n];
            let area = node.aabb().half_area();
            let Some((l, r)) = plan.halves(n) else {
                cost[n] = [area * BLOCK_COST; LANES - 1];
                continue;
            };
            count[n] = count[l] + count[r];
            let best = |trees: usize| {
                let costs = (1..trees).map(|k| (cost[l][k - 1] + cost[r][trees - k - 1], k as u8));
                costs.fold((f32::INFINITY, 0), |a, b| if b.0 < a.0 { b } else { a })
            };
            let (inner, split) = best(LANES);
            let mut lowest = area + inner;
            plan.left[n][LANES - 1] = split;
            plan.is_block[n] = count[n] <= LANES && area * BLOCK_COST <= lowest;
            if plan.is_block[n] {
                lowest = area * BLOCK_COST;
            }
            let mut costs = [lowest; LANES - 1];
            for trees in 2..LANES {
                let (apart, split) = best(trees);
                if apart < lowest {
                    (lowest, plan.left[n][trees - 1]) = (apart, split);
                }
                costs[trees - 1] = lowest;
            }
            cost[n] = costs;
        }
        plan
    }

    fn halves(&self, n: usize) -> Option<(usize, usize)> {
        let node = &self.binary.nodes[n];
        (!node.is_leaf()).then(|| (node.first_index as usize, node.first_index as usize + 1))
    }

    /// All nodes, each after its children.
    fn children_first(&self) -> Vec<usize> {
        let (mut order, mut open) = (Vec::with_capacity(self.binary.nodes.len()), vec![0]);
        while let Some(n) = open.pop() {
            order.push(n);
            open.extend(self.halves(n).into_iter().flat_map(|(l, r)| [l, r]));
        }
        order.reverse();
        order
    }

    /// Roots of the trees that become the boxes of the wide node that stands for n.
    fn children(&self, n: usize) -> Vec<usize> {
        let Some((l, r)) = self.halves(n).filter(|_| !self.is_block[n]) else { return vec![n] };
        let k = usize::from(self.left[n][LANES - 1]);
        let (mut found, mut open) = (Vec::with_capacity(LANES), vec![(r, LANES - k), (l, k)]);
        while let Some((n, most)) = open.pop() {
            let trees = (2..=most.min(LANES - 1)).rev().find(|&i| self.left[n][i - 1] > 0);
            match (trees, self.halves(n)) {
                (Some(trees), Some((l, r))) => {
                    let k = usize::from(self.left[n][trees - 1]);
                    open.extend([(r, trees - k), (l, k)]);
                }
                _ => found.push(n),
            }
        }
        found
    }

    /// Polygons under a node.
    fn members(&self, n: usize) -> Vec<u32> {
        let (mut members, mut open) = (Vec::with_capacity(LANES), vec![n]);
        while let Some(n) = open.pop() {
            match self.halves(n) {
                Some((l, r)) => open.extend([l, r]),
                None => members.push(self.binary.primitive_indices[self.binary.nodes[n].first_index as usize]),
            }
        }
        members
    }
}
