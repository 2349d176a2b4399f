//! Links between nodes, refined until what each of them may err by is small (`oracle`).

use std::ops::Range;

use radiosity_core::Cost;
use radiosity_geometry::{Facets, Occluders};
use rayon::prelude::*;

use super::brightness::Brightness;
use super::links::{Estimate, Link, Links};
use super::oracle::{Contributions, Reach, Step};
use super::screens::{Between, Seen};
use super::shaft::{Screens, Shaft};
use super::tree::Hierarchy;
use crate::Pairwise;

/// Links that one task looks at.
const PIECE: usize = 4096;
/// Pairs that are handed to threads; fixed, so that the work is cut alike at any number of them.
const TASKS: usize = 2048;

/// What makes links: the nodes, what blocks, and the estimator of single pairs of elements.
pub struct Linking<'a, P> {
    pub(super) hierarchy: &'a Hierarchy,
    pub(super) elements: &'a Facets,
    pub(super) screens: Option<Screens<'a>>,
    pub(super) estimator: P,
    pub(super) tolerance: f64,
    pub(super) seed: u64,
}

/// A pair still to be looked at.
#[derive(Clone, Copy)]
struct Pair {
    nodes: [u32; 2],
    /// Its link, if that errs too much.
    rejected: Option<Estimate>,
}

impl Pair {
    fn new(nodes: [u32; 2]) -> Self {
        Self { nodes, rejected: None }
    }
}

/// A pair, and the blockers that may stand between.
#[derive(Clone)]
struct Task {
    pair: Pair,
    blockers: Vec<u32>,
}

impl<'a, P: Pairwise> Linking<'a, P> {
    /// Links over `hierarchy` of `elements`, of which `occluders` may block; elements next to each other go to `estimator`, with an error of
    /// F of at most `tolerance`.
    ///
    /// # Panics
    ///
    /// If the elements are not those of the hierarchy.
    pub fn new(
        hierarchy: &'a Hierarchy,
        elements: &'a Facets,
        occluders: &'a Occluders,
        estimator: P,
        tolerance: f64,
        seed: u64,
    ) -> Self {
        assert_eq!(elements.len(), hierarchy.order.len(), "elements of another hierarchy");
        let screens = (!occluders.is_empty()).then(|| Screens::new(hierarchy, occluders));
        Self { hierarchy, elements, screens, estimator, tolerance, seed }
    }

    /// Links of which each errs by at most τ = `threshold` as the oracle says, and what they cost.
    pub fn links(&self, threshold: f64, brightness: &Brightness) -> (Links, Cost) {
        let mut pairs = Vec::new();
        let mut selves = vec![0];
        while let Some(k) = selves.pop() {
            // A node of one plane sees nothing of itself.
            if self.hierarchy.nodes[k as usize].is_cluster() {
                let children: Vec<u32> = self.hierarchy.children(k).collect();
                pairs.push(Pair::new([children[0], children[1]]));
                selves.extend(children);
            }
        }
        let mut links = Links::default();
        let cost = self.settle(&pairs, threshold, brightness, &mut links);
        (links, cost)
    }

    /// Refines the links that err by more than τ = `threshold` and leaves the others as they are; what that cost.
    pub fn refine(&self, links: &mut Links, threshold: f64, brightness: &Brightness) -> Cost {
        let limit = self.limit(threshold);
        let good = |link: &Link| {
            let [of_p, of_q] = Contributions::of(self.hierarchy, brightness, link.p, link.q).weighted(link.estimate);
            of_p + of_q <= limit
        };
        let keep: Vec<bool> = links.links.par_iter().with_min_len(PIECE).map(good).collect();
        let mut keep = keep.into_iter();
        let mut pairs = Vec::new();
        links.links.retain(|link| {
            let keep = keep.next() == Some(true);
            if !keep {
                pairs.push(Pair { nodes: [link.p, link.q], rejected: Some(link.estimate) });
            }
            keep
        });
        self.settle(&pairs, threshold, brightness, links)
    }

    /// Estimated rms error of irradiance by all links, see [`Links::error`].
    pub fn error(&self, links: &Links, brightness: &Brightness) -> f64 {
        links.error(self.hierarchy, brightness)
    }

    fn limit(&self, threshold: f64) -> f32 {
        (threshold * threshold * f64::from(self.hierarchy.nodes[0].area)) as f32
    }

    /// Adds links of all pairs and those below them: in breadth until there are enough of them, then in depth, in parallel.
    fn settle(&self, pairs: &[Pair], threshold: f64, brightness: &Brightness, links: &mut Links) -> Cost {
        let search = Search { linking: self, brightness, limit: self.limit(threshold) };
        let all: Vec<u32> = self.screens.iter().map(Screens::root).collect();
        let task = |&pair: &Pair| Task { pair, blockers: all.clone() };
        // Many pairs get their lists when they are looked at: all lists at once take more than the links.
        if pairs.len() >= TASKS {
            return search.descend_all(pairs, task, links);
        }
        let mut cost = Cost::default();
        let mut tasks: Vec<Task> = pairs.iter().map(task).collect();
        while !tasks.is_empty() && tasks.len() < TASKS {
            let mut next = Vec::new();
            for Task { pair, blockers: mut list } in tasks {
                let given = list.len();
                match search.step(pair, 0..given, &mut list, &mut cost) {
                    Step::Nothing => {}
                    Step::Keep(link) => links.links.push(link),
                    Step::Split(side) => {
                        let found = &list[given..];
                        let pairs = search.child_pairs(pair, side);
                        next.extend(pairs.map(|pair| Task { pair, blockers: found.to_vec() }));
                    }
                }
            }
            tasks = next;
        }
        cost + search.descend_all(&tasks, Task::clone, links)
    }
}

/// One refinement.
pub(super) struct Search<'a, P> {
    pub linking: &'a Linking<'a, P>,
    pub brightness: &'a Brightness,
    /// τ² Σ A.
    pub limit: f32,
}

impl<'a, P: Pairwise> Search<'a, P> {
    fn child_pairs(&self, pair: Pair, side: usize) -> impl Iterator<Item = Pair> + use<'a, P> {
        let [p, q] = pair.nodes;
        let children = self.linking.hierarchy.children(pair.nodes[side]);
        children.map(move |child| Pair::new(if side == 0 { [child, q] } else { [p, child] }))
    }

    /// Adds links of all of a list and those below them, each in depth, in parallel over pieces of the list.
    fn descend_all<T: Sync>(&self, all: &[T], task: impl Fn(&T) -> Task + Sync, links: &mut Links) -> Cost {
        let parts: Vec<(Vec<Link>, Cost)> = all
            .par_chunks(all.len().div_ceil(TASKS).max(1))
            .map(|piece| {
                let (mut links, mut cost) = (Vec::new(), Cost::default());
                for Task { pair, blockers: mut list } in piece.iter().map(&task) {
                    let given = list.len();
                    self.descend(pair, 0..given, &mut list, &mut links, &mut cost);
                }
                (links, cost)
            })
            .collect();
        links.links.reserve_exact(parts.iter().map(|(links, _)| links.len()).sum());
        let mut cost = Cost::default();
        for (part, spent) in parts {
            links.links.extend(part);
            cost += spent;
        }
        cost
    }

    /// Links of a pair and all below it; the blockers are a range of the list.
    fn descend(&self, pair: Pair, given: Range<usize>, list: &mut Vec<u32>, links: &mut Vec<Link>, cost: &mut Cost) {
        let top = list.len();
        match self.step(pair, given, list, cost) {
            Step::Nothing => {}
            Step::Keep(link) => links.push(link),
            Step::Split(side) => {
                let found = top..list.len();
                for child in self.child_pairs(pair, side) {
                    self.descend(child, found.clone(), list, links, cost);
                }
            }
        }
        list.truncate(top);
    }

    /// What becomes of a pair among the blockers at `given` of the list; those that may stand between are appended.
    fn step(&self, pair: Pair, given: Range<usize>, list: &mut Vec<u32>, cost: &mut Cost) -> Step {
        let (hierarchy, [p, q]) = (self.linking.hierarchy, pair.nodes);
        let Some(reach) = Reach::of(hierarchy, p, q) else { return Step::Nothing };
        let (top, mut seen) = (list.len(), Seen::default());
        if let Some(screens) = self.linking.screens.as_ref().filter(|_| !given.is_empty()) {
            match screens.narrow(&Shaft::new(hierarchy, p, q), list, given) {
                Between::Nothing => {}
                Between::All => {
                    *cost += Cost { hidden_pairs: 1, ..Cost::default() };
                    return Step::Nothing;
                }
                Between::Some(found) => seen = found,
            }
        }
        match pair.rejected {
            Some(estimate) => self.split([p, q], &reach, estimate, cost),
            None => self.judge([p, q], &reach, seen, &list[top..], cost),
        }
    }
}
