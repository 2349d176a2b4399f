//! Links between nodes, refined until what each of them may err by is small (`oracle`).

use std::ops::Range;

use radiosity_core::Cost;
use radiosity_geometry::{Facets, Occluders};
use rayon::prelude::*;

use super::brightness::Brightness;
use super::links::{Link, Links};
use super::oracle::{Contributions, Reach, Step};
use super::screens::{Between, Seen};
use super::shaft::{Screens, Shaft};
use super::tree::Hierarchy;
use crate::Pairwise;

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

/// A pair still to be looked at, and the blockers that may stand between.
#[derive(Clone)]
struct Task {
    pair: [u32; 2],
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
                pairs.push([children[0], children[1]]);
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
        let mut pairs = Vec::new();
        links.links.retain(|link| {
            let pair = Contributions::of(self.hierarchy, brightness, link.p, link.q);
            let [of_p, of_q] = pair.errors(link.varies, link.wrong);
            let keep = of_p + of_q <= limit;
            if !keep {
                pairs.push([link.p, link.q]);
            }
            keep
        });
        self.settle(&pairs, threshold, brightness, links)
    }

    fn limit(&self, threshold: f64) -> f32 {
        (threshold * threshold * f64::from(self.hierarchy.nodes[0].area)) as f32
    }

    /// Adds links of all pairs and those below them: in breadth until there are enough of them, then in depth, in parallel.
    fn settle(&self, pairs: &[[u32; 2]], threshold: f64, brightness: &Brightness, links: &mut Links) -> Cost {
        let search = Search { linking: self, brightness, limit: self.limit(threshold) };
        let all: Vec<u32> = self.screens.iter().map(Screens::root).collect();
        let task = |&pair: &[u32; 2]| Task { pair, blockers: all.clone() };
        // Many pairs get their lists when they are looked at: all lists at once take more than the links.
        if pairs.len() >= TASKS {
            return search.descend_all(pairs, task, links);
        }
        let mut cost = Cost::default();
        let mut tasks: Vec<Task> = pairs.iter().map(task).collect();
        while !tasks.is_empty() && tasks.len() < TASKS {
            let mut next = Vec::new();
            for Task { pair: [p, q], blockers: mut list } in tasks {
                let given = list.len();
                match search.step(p, q, 0..given, &mut list, &mut cost) {
                    Step::Nothing => {}
                    Step::Keep(link) => links.links.push(link),
                    Step::Split(side) => {
                        let found = &list[given..];
                        let pairs = search.child_pairs(p, q, side);
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
    fn child_pairs(&self, p: u32, q: u32, side: usize) -> impl Iterator<Item = [u32; 2]> + use<'a, P> {
        let hierarchy = self.linking.hierarchy;
        hierarchy
            .children(if side == 0 { p } else { q })
            .map(move |child| if side == 0 { [child, q] } else { [p, child] })
    }

    /// Adds links of all of a list and those below them, each in depth, in parallel over pieces of the list.
    fn descend_all<T: Sync>(&self, all: &[T], task: impl Fn(&T) -> Task + Sync, links: &mut Links) -> Cost {
        let parts: Vec<(Vec<Link>, Cost)> = all
            .par_chunks(all.len().div_ceil(TASKS).max(1))
            .map(|piece| {
                let (mut links, mut cost) = (Vec::new(), Cost::default());
                for Task { pair: [p, q], blockers: mut list } in piece.iter().map(&task) {
                    let given = list.len();
                    self.descend(p, q, 0..given, &mut list, &mut links, &mut cost);
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
    fn descend(
        &self,
        p: u32,
        q: u32,
        given: Range<usize>,
        list: &mut Vec<u32>,
        links: &mut Vec<Link>,
        cost: &mut Cost,
    ) {
        let top = list.len();
        match self.step(p, q, given, list, cost) {
            Step::Nothing => {}
            Step::Keep(link) => links.push(link),
            Step::Split(side) => {
                let found = top..list.len();
                for [p, q] in self.child_pairs(p, q, side) {
                    self.descend(p, q, found.clone(), list, links, cost);
                }
            }
        }
        list.truncate(top);
    }

    /// What becomes of a pair among the blockers at `given` of the list; those that may stand between are appended.
    fn step(&self, p: u32, q: u32, given: Range<usize>, list: &mut Vec<u32>, cost: &mut Cost) -> Step {
        let hierarchy = self.linking.hierarchy;
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
        self.judge([p, q], &reach, seen, &list[top..], cost)
    }
}
