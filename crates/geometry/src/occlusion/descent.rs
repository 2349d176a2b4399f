//! The way of a ray through the hierarchy.

use glam::DVec3;

use super::hierarchy::{Child, Content, Hierarchy, Node, Place};
use super::lanes::{LANES, Lanes};

/// Components of a direction are no smaller for the box test, so that no product is infinite or no number: over the
/// length of a ray in the scene, 2√3, they then lead 2.1e-7 aside at most.
const STEEP: f32 = 1.0 / (1 << 24) as f32;

/// A ray for the box test, in the scene scaled to [−1, 1]³: a plane is met at plane · inverse + shift.
pub(super) struct Slabs<L: Lanes> {
    inverse: [L::Floats; 3],
    shift: [L::Floats; 3],
    /// Which of a box's planes along each axis comes first.
    first: [usize; 3],
}

impl<L: Lanes> Slabs<L> {
    #[inline(always)]
    pub fn new(lanes: L, o: DVec3, d: DVec3) -> Self {
        let inverse = [d.x, d.y, d.z].map(|d| {
            let d = d as f32;
            if d.abs() < STEEP { STEEP.recip().copysign(d) } else { d.recip() }
        });
        Self {
            inverse: inverse.map(|inverse| lanes.splat(inverse)),
            shift: std::array::from_fn(|axis| lanes.splat(-(o[axis] as f32) * inverse[axis])),
            first: inverse.map(|inverse| usize::from(inverse < 0.0)),
        }
    }

    /// A bit for every child whose box the ray meets before `far`, and where it enters it.
    #[inline(always)]
    fn meets(&self, lanes: L, node: &Node, far: f32) -> (u32, L::Floats) {
        let mut enter = lanes.splat(0.0);
        let mut leave = lanes.splat(far);
        for axis in 0..3 {
            let first = self.first[axis] & 1;
            let (near, far) = (&node.planes[axis][first], &node.planes[axis][1 - first]);
            enter = lanes.max(enter, lanes.mul_add(lanes.load(near), self.inverse[axis], self.shift[axis]));
            leave = lanes.min(leave, lanes.mul_add(lanes.load(far), self.inverse[axis], self.shift[axis]));
        }
        (lanes.at_most(enter, leave), enter)
    }
}

/// Children that a descent can put off without asking for memory: eight levels of nodes.
const ROOM: usize = 64;

/// Space for the children to come back to, and for where the ray enters them. Kept between rays.
pub(super) struct Space {
    fixed: ([u32; ROOM], [f32; ROOM]),
    large: (Vec<u32>, Vec<f32>),
}

impl Space {
    #[inline(always)]
    pub fn of(hierarchy: &Hierarchy) -> Self {
        // A node's children are written eight at a time.
        let len = hierarchy.pending + LANES;
        let large = if len > ROOM { (vec![0; len], vec![0.0; len]) } else { (Vec::new(), Vec::new()) };
        Self { fixed: ([0; ROOM], [0.0; ROOM]), large }
    }

    #[inline(always)]
    fn lists(&mut self) -> (&mut [u32], &mut [f32]) {
        let Self { fixed, large } = self;
        if large.0.is_empty() { (&mut fixed.0, &mut fixed.1) } else { (&mut large.0, &mut large.1) }
    }
}

/// Visits the blocks that a ray meets before `far`, of a node's children the nearest first. `visit` says how far the ray still
/// goes.
#[inline(always)]
pub(super) fn descend_in_order<L: Lanes>(
    lanes: L,
    hierarchy: &Hierarchy,
    space: &mut Space,
    slabs: &Slabs<L>,
    mut far: f32,
    mut visit: impl FnMut(Place) -> f32,
) {
    let (children, enters) = space.lists();
    let (mut height, mut child) = (0, Child::ROOT);
    loop {
        match child.content() {
            Content::Node(index) => {
                let node = &hierarchy.nodes[index];
                let (met, enter) = slabs.meets(lanes, node, far);
                if met != 0 {
                    let nearest = lanes.least(lanes.only(met, enter)) % LANES;
                    let others = met & !(1 << nearest);
                    children[height..height + LANES].copy_from_slice(&lanes.packed_words(others, &node.children));
                    enters[height..height + LANES].copy_from_slice(&lanes.packed(others, enter).0);
                    height += others.count_ones() as usize;
                    child = Child(node.children[nearest]);
                    continue;
                }
            }
            Content::Block(place) => far = far.min(visit(place)),
        }
        loop {
            if height == 0 {
                return;
            }
            height -= 1;
            if enters[height] <= far {
                child = Child(children[height]);
                break;
            }
        }
    }
}

/// Visits the blocks that a ray meets before `far`, in no particular order, until `visit` is true; whether it was.
#[inline(always)]
pub(super) fn descend_until<L: Lanes>(
    lanes: L,
    hierarchy: &Hierarchy,
    space: &mut Space,
    slabs: &Slabs<L>,
    far: f32,
    mut visit: impl FnMut(Place) -> bool,
) -> bool {
    let (children, _) = space.lists();
    children[0] = Child::ROOT.0;
    let mut height = 1;
    while height > 0 {
        height -= 1;
        match Child(children[height]).content() {
            Content::Node(index) => {
                let node = &hierarchy.nodes[index];
                let (met, _) = slabs.meets(lanes, node, far);
                children[height..height + LANES].copy_from_slice(&lanes.packed_words(met, &node.children));
                height += met.count_ones() as usize;
            }
            Content::Block(place) => {
                if visit(place) {
                    return true;
                }
            }
        }
    }
    false
}
