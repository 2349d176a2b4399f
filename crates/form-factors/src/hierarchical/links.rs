//! Links between nodes, refined until what each of them may err by is small.
//!
//! A link (p, q) stands for every pair of an element of p with one of q and gives all of them one kernel κ. What a receiver p then
//! misses is known from the kernel's samples (`exchange`), with b the mean radiosity of a node, s its standard deviation over the node,
//! σ_p the standard deviation of F(x → q) over x ∈ p, and δκ what κ itself may be off by:
//!
//! ```text
//! ε_p² = A_p·[ (b_q σ_p)² + (s_q σ_q A_q/A_p)² + (b_q A_q δκ)² ],        accepted where ε_p² + ε_q² ≤ τ² Σ A
//! ```
//!
//! This is the oracle B·F·A in the norm in which errors are reported, Σ A (H − H*)²: a node's own size counts, so that small nodes may
//! see coarse partners. Refining the link with the largest ε² gains most for its cost, so all are brought below one threshold τ.
//!
//! δκ is c₄((R_p + R_q)/r)⁴ κ for the product rule, and the standard error of the visible share for pairs that are seen in part. Where nodes
//! are nearer than the rule can be trusted, or one is a cluster, a proven bound takes the place of all three:
//!
//! ```text
//! K ≤ cos⁺_p cos⁺_q / (π d²),      cos⁺_p = min(1, (height of q over p's plane) / d),      F ≤ min(1, A_q K)
//! ```
//!
//! with d the gap between the spheres; cos⁺ has the slack that a pair across a horizon needs, which cosines between centres miss. A
//! pair of elements that no refinement can make better goes to the exact pairwise estimator. Pairs that see each other in part go on while
//! a blocker passes through one of them, so that a link never spans what a partition parts.
//!
//! (Hanrahan, Salzman, Aupperle 1991; Smits, Arvo, Greenberg 1994 for clusters; Holzschuch, Sillion, Drettakis 1994 for links refined as
//! the solution becomes known.)

use glam::Vec3;
use radiosity_core::{BandValues, Cost};
use radiosity_geometry::{Facets, Occluders};
use rayon::prelude::*;

use super::exchange::{Points, kernel, kernel_between, statistics};
use super::shaft::{Between, FLAT, Screens};
use super::tree::{Hierarchy, NONE, Node};
use crate::Pairwise;
use crate::rows::mix;

/// (R_p + R_q)/r up to which the product rule is trusted.
const TRUSTED: f32 = 0.6;
/// δκ/κ of the product rule at (R_p + R_q)/r = 1.
const RULE: f32 = 0.3;
/// δκ of a pair one of which crosses the other's plane, as a share of the proven bound of the kernel.
const HORIZON: f32 = 0.1;
/// Share of a pair's segments that may differ though none of 16 did.
const LEAST: f32 = 1.0 / 18.0;
/// Pairs that are handed to threads; fixed, so that the work is cut alike at any number of them.
const TASKS: usize = 2048;

/// One kernel for all pairs of elements of two nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Link {
    pub p: u32,
    pub q: u32,
    pub kernel: f32,
    /// Standard deviation of F(x → q) over p, and of F(y → p) over q.
    pub varies: [f32; 2],
    /// What the kernel may be off by.
    pub wrong: f32,
}

/// Radiosity of every node as refinement sees it: the mean and the standard deviation over its elements, in units of the mean irradiance.
#[derive(Clone, Debug)]
pub struct Brightness {
    mean: Vec<f32>,
    deviation: Vec<f32>,
    /// Whether receivers get what is linear over them.
    linear: bool,
}

impl Brightness {
    /// Every node sends 1: links for any distribution of light that is as bright everywhere.
    pub fn uniform(hierarchy: &Hierarchy) -> Self {
        Self { mean: vec![1.0; hierarchy.len()], deviation: vec![0.0; hierarchy.len()], linear: false }
    }

    /// Of elements with radiosities `b` where the mean irradiance is `level`, all bands counted as their root mean square.
    ///
    /// # Panics
    ///
    /// If `b` does not fit the hierarchy.
    pub fn of(hierarchy: &Hierarchy, b: &BandValues, level: f64) -> Self {
        assert_eq!(b.len(), hierarchy.order.len(), "brightness of another hierarchy");
        let bands = b.count() as f64;
        let mut sums = vec![[0.0_f64; 3]; hierarchy.len()];
        for k in (0..hierarchy.len()).rev() {
            let element = hierarchy.elements[k] as usize;
            if hierarchy.nodes[k].is_leaf() {
                let square = (0..b.count()).map(|band| b.band(band)[element].powi(2)).sum::<f64>() / bands;
                let weight = hierarchy.weights[element];
                sums[k] = [weight, weight * square.sqrt(), weight * square];
            }
            if let Some(parent) = hierarchy.parents.get(k).map(|&p| p as usize).filter(|&p| p < k) {
                (0..3).for_each(|c| sums[parent][c] += sums[k][c]);
            }
        }
        let unit = if level > 0.0 { 1.0 / level } else { 0.0 };
        let mean = sums.iter().map(|[w, b, _]| (unit * b / w) as f32).collect();
        let variance = |[w, b, square]: &[f64; 3]| (square / w - (b / w).powi(2)).max(0.0);
        Self { mean, deviation: sums.iter().map(|sum| (unit * variance(sum).sqrt()) as f32).collect(), linear: false }
    }
}

impl Brightness {
    /// The same for links that vary linearly over their receivers ([`super::HierarchicalFormFactors::final_gather`]), which miss less.
    #[must_use]
    pub fn linear(self) -> Self {
        Self { linear: true, ..self }
    }
}

/// Links that cover every pair of elements that may see each other once.
#[derive(Clone, Debug, Default)]
pub struct Links {
    pub(super) links: Vec<Link>,
}

impl Links {
    /// Number of links.
    pub fn len(&self) -> usize {
        self.links.len()
    }

    /// Whether nothing sees anything.
    pub fn is_empty(&self) -> bool {
        self.links.is_empty()
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        size_of_val(&self.links[..]) as u64
    }

    /// Bytes of so many links.
    pub fn bytes_of(links: u64) -> u64 {
        size_of::<Link>() as u64 * links
    }

    /// Estimated rms error of the irradiance of elements with this brightness, relative to its mean.
    ///
    /// ```text
    /// √( Σ_links (ε_p² + ε_q²) / Σ A )       where receivers get what is linear over them ([`Brightness::linear`])
    /// √( Σ_e A_e (Σ_{p ∋ e} Σ_{links of p} ε_p/√A_p)² / Σ A )      where they hold one value
    /// ```
    ///
    /// What is left beyond a linear function, and what sampled visibility adds, hardly depend on each other; slopes of all links of a receiver
    /// may tend the same way, so that they are added by size.
    pub fn error(&self, hierarchy: &Hierarchy, brightness: &Brightness) -> f64 {
        let total = f64::from(hierarchy.nodes[0].area);
        let pairs = self.links.iter().map(|link| (link, Contributions::of(hierarchy, brightness, link.p, link.q)));
        if brightness.linear {
            let sum: f64 =
                pairs.map(|(link, pair)| pair.errors(link.varies, link.wrong)).map(|[p, q]| f64::from(p + q)).sum();
            return (sum / total).sqrt();
        }
        let mut off = vec![0.0_f64; hierarchy.len()];
        for (link, pair) in pairs {
            for (k, node) in [link.p, link.q].into_iter().enumerate() {
                off[node as usize] += f64::from(pair.missed(k, link.varies, link.wrong));
            }
        }
        let mut sum = 0.0;
        for (k, node) in hierarchy.nodes.iter().enumerate() {
            if hierarchy.parents[k] != NONE {
                off[k] += off[hierarchy.parents[k] as usize];
            }
            if node.is_leaf() {
                sum += f64::from(node.area) * off[k].powi(2);
            }
        }
        (sum / total).sqrt()
    }
}

/// What makes links: the nodes, what blocks, and the estimator of single pairs of elements.
pub struct Linking<'a, P> {
    hierarchy: &'a Hierarchy,
    elements: &'a Facets,
    screens: Option<Screens<'a>>,
    estimator: P,
    tolerance: f64,
    seed: u64,
}

/// What becomes of a pair of nodes.
enum Step {
    Nothing,
    Keep(Link),
    /// Child pairs of the first or second node.
    Split(usize),
}

/// What the oracle needs of a pair: areas, brightness and its deviation.
struct Contributions {
    area: [f32; 2],
    mean: [f32; 2],
    deviation: [f32; 2],
    /// What is left of σ on either receiver.
    left: [f32; 2],
}

impl Contributions {
    fn of(hierarchy: &Hierarchy, brightness: &Brightness, p: u32, q: u32) -> Self {
        let (a, b) = (p as usize, q as usize);
        let (p, q) = (&hierarchy.nodes[a], &hierarchy.nodes[b]);
        let ratio = (p.radius + q.radius) / p.centre.distance(q.centre).max(f32::MIN_POSITIVE);
        let left = |node: &Node| if brightness.linear && node.is_parallelogram() { ratio.min(1.0) } else { 1.0 };
        Self {
            area: [p.area, q.area],
            mean: [brightness.mean[a], brightness.mean[b]],
            deviation: [brightness.deviation[a], brightness.deviation[b]],
            left: [left(p), left(q)],
        }
    }

    /// ε_p/√A_p of the first node, or of the second: what its elements miss, in irradiance.
    fn missed(&self, k: usize, varies: [f32; 2], wrong: f32) -> f32 {
        let (own, other, bright) = (self.area[k], self.area[1 - k], self.mean[1 - k]);
        let (missed, off) = (self.left[k] * bright * varies[k], bright * other * wrong);
        let uneven = self.deviation[1 - k] * varies[1 - k] * (other / own);
        (missed * missed + off * off + uneven * uneven).sqrt()
    }

    /// ε_p² + ε_q², shared out by which node must be split to take it away.
    fn errors(&self, varies: [f32; 2], wrong: f32) -> [f32; 2] {
        let of = |k: usize| {
            let (own, other, bright) = (self.area[k], self.area[1 - k], self.mean[1 - k]);
            let (missed, off) = (self.left[k] * bright * varies[k], bright * other * wrong);
            let uneven = self.deviation[k] * varies[k];
            own * (missed * missed + off * off + uneven * uneven * (own / other))
        };
        [of(0), of(1)]
    }
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

    /// Links of which each errs by at most τ = `threshold` as the module says, and what they cost.
    pub fn links(&self, threshold: f64, brightness: &Brightness) -> (Links, Cost) {
        let mut tasks = Vec::new();
        let mut selves = vec![0];
        while let Some(k) = selves.pop() {
            // A node of one plane sees nothing of itself.
            if self.hierarchy.nodes[k as usize].is_cluster() {
                let pair: Vec<u32> = self.hierarchy.children(k).collect();
                tasks.push(self.task(pair[0], pair[1]));
                selves.extend(pair);
            }
        }
        let mut links = Links::default();
        let cost = self.settle(tasks, threshold, brightness, &mut links);
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
        let task = |k: usize| self.task(pairs[k][0], pairs[k][1]);
        if pairs.len() < TASKS {
            let tasks = (0..pairs.len()).into_par_iter().map(task).collect();
            return self.settle(tasks, threshold, brightness, links);
        }
        // Lists of blockers are made when they are needed: all at once they take more than the links.
        self.descend_all(pairs.len(), task, threshold, brightness, links)
    }

    fn limit(&self, threshold: f64) -> f32 {
        (threshold * threshold * f64::from(self.hierarchy.nodes[0].area)) as f32
    }

    fn task(&self, p: u32, q: u32) -> Task {
        let nodes = [p, q].map(|k| &self.hierarchy.nodes[k as usize]);
        let around = |screens: &Screens<'_>| screens.around(self.hierarchy, nodes[0], nodes[1]);
        Task { pair: [p, q], blockers: self.screens.as_ref().map_or_else(Vec::new, around) }
    }

    /// Adds links of all pairs of the tasks: in breadth until there are enough of them, then in depth, in parallel.
    fn settle(&self, mut tasks: Vec<Task>, threshold: f64, brightness: &Brightness, links: &mut Links) -> Cost {
        let search = Search { linking: self, brightness, limit: self.limit(threshold) };
        let mut cost = Cost::default();
        while !tasks.is_empty() && tasks.len() < TASKS {
            let mut next = Vec::new();
            for Task { pair: [p, q], blockers } in tasks {
                let mut found = Vec::new();
                match search.step(p, q, &blockers, &mut found, &mut cost) {
                    Step::Nothing => {}
                    Step::Keep(link) => links.links.push(link),
                    Step::Split(side) => {
                        next.extend(search.child_pairs(p, q, side).map(|pair| Task { pair, blockers: found.clone() }));
                    }
                }
            }
            tasks = next;
        }
        cost + self.descend_all(tasks.len(), |k| tasks[k].clone(), threshold, brightness, links)
    }

    /// Adds links of all pairs of `count` tasks, each in depth, in parallel over pieces of the list.
    fn descend_all(
        &self,
        count: usize,
        task: impl Fn(usize) -> Task + Sync,
        threshold: f64,
        brightness: &Brightness,
        links: &mut Links,
    ) -> Cost {
        let search = Search { linking: self, brightness, limit: self.limit(threshold) };
        let piece = count.div_ceil(TASKS).max(1);
        let parts: Vec<(Vec<Link>, Cost)> = (0..count.div_ceil(piece))
            .into_par_iter()
            .map(|k| {
                let (mut links, mut cost) = (Vec::new(), Cost::default());
                for k in k * piece..((k + 1) * piece).min(count) {
                    let Task { pair: [p, q], blockers: mut stack } = task(k);
                    let given = stack.len();
                    search.descend(p, q, 0..given, &mut stack, &mut links, &mut cost);
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
}

/// One refinement.
struct Search<'a, P> {
    linking: &'a Linking<'a, P>,
    brightness: &'a Brightness,
    /// τ² Σ A.
    limit: f32,
}

impl<'a, P: Pairwise> Search<'a, P> {
    fn child_pairs(&self, p: u32, q: u32, side: usize) -> impl Iterator<Item = [u32; 2]> + use<'a, P> {
        let hierarchy = self.linking.hierarchy;
        hierarchy
            .children(if side == 0 { p } else { q })
            .map(move |child| if side == 0 { [child, q] } else { [p, child] })
    }

    /// Links of a pair and all below it; the blockers are a range of the stack.
    fn descend(
        &self,
        p: u32,
        q: u32,
        given: std::ops::Range<usize>,
        stack: &mut Vec<u32>,
        links: &mut Vec<Link>,
        cost: &mut Cost,
    ) {
        let top = stack.len();
        match self.step_on(p, q, given, stack, cost) {
            Step::Nothing => {}
            Step::Keep(link) => links.push(link),
            Step::Split(side) => {
                let found = top..stack.len();
                for [p, q] in self.child_pairs(p, q, side) {
                    self.descend(p, q, found.clone(), stack, links, cost);
                }
            }
        }
        stack.truncate(top);
    }

    /// [`Self::step`] with the blockers on a stack.
    fn step_on(&self, p: u32, q: u32, given: std::ops::Range<usize>, stack: &mut Vec<u32>, cost: &mut Cost) -> Step {
        let top = stack.len();
        let Some(reach) = Reach::of(self.linking.hierarchy, p, q) else { return Step::Nothing };
        let mut between = Between::Nothing;
        if let Some(screens) = self.linking.screens.as_ref().filter(|_| !given.is_empty()) {
            // Found blockers go on top, while those given are read below.
            let mut found = std::mem::take(stack);
            let mut at = given.start;
            between = {
                let cell = std::cell::RefCell::new(&mut found);
                let next = std::iter::from_fn(|| {
                    let k = (at < given.end).then(|| cell.borrow()[at])?;
                    at += 1;
                    Some(k)
                });
                let nodes = [p, q].map(|k| &self.linking.hierarchy.nodes[k as usize]);
                screens.narrow(self.linking.hierarchy, (nodes[0], nodes[1]), next, |k| cell.borrow_mut().push(k))
            };
            *stack = found;
        }
        self.judge(p, q, &reach, between, &stack[top..], cost)
    }

    /// What becomes of a pair among the given blockers; those that may stand between are appended to `found`.
    fn step(&self, p: u32, q: u32, given: &[u32], found: &mut Vec<u32>, cost: &mut Cost) -> Step {
        let mut stack = given.to_vec();
        let step = self.step_on(p, q, 0..given.len(), &mut stack, cost);
        found.extend_from_slice(&stack[given.len()..]);
        step
    }

    fn judge(&self, p: u32, q: u32, reach: &Reach, between: Between, blockers: &[u32], cost: &mut Cost) -> Step {
        let hierarchy = self.linking.hierarchy;
        let nodes = [p, q].map(|k| &hierarchy.nodes[k as usize]);
        let leaf = nodes.map(Node::is_leaf);
        let pair = Contributions::of(hierarchy, self.brightness, p, q);
        let through = match between {
            Between::All => {
                *cost += Cost { hidden_pairs: 1, ..Cost::default() };
                return Step::Nothing;
            }
            Between::Some { through } => through,
            Between::Nothing => [false; 2],
        };
        let larger = |among: [bool; 2]| match among {
            [true, true] => usize::from(nodes[1].area > nodes[0].area),
            [_, second] => usize::from(second),
        };
        if through != [false; 2] {
            return Step::Split(larger(through));
        }
        // What is known without a sample.
        let both_leaves = leaf == [true; 2];
        let cluster = [nodes[0].is_cluster(), nodes[1].is_cluster()];
        let trusted = cluster == [false; 2] && reach.ratio < TRUSTED;
        let bound = [(reach.most * pair.area[1]).min(1.0), (reach.most * pair.area[0]).min(1.0)];
        let mut varies = [0.5 * bound[0], 0.5 * bound[1]];
        let mut wrong = (varies[0] / pair.area[1]).min(varies[1] / pair.area[0]);
        let mut sample = None;
        if trusted && !self.accepts(&pair, varies, wrong) {
            let found = self.sample(p, q, between, blockers, cost);
            let rule = RULE * reach.ratio * reach.ratio * reach.ratio * reach.ratio * found.mean;
            let horizon = if reach.straddles { HORIZON * reach.most } else { 0.0 };
            wrong = rule.max(horizon).hypot(found.noise).min(wrong);
            for k in 0..2 {
                // One element holds one value: what varies over it is no fault of a link.
                varies[k] = if leaf[k] { 0.0 } else { (found.deviation[k] * pair.area[1 - k]).min(varies[k]) };
            }
            sample = Some(found);
        }
        if self.accepts(&pair, varies, wrong) {
            let found = sample.unwrap_or_else(|| self.sample(p, q, between, blockers, cost));
            return Step::Keep(Link { p, q, kernel: found.mean, varies, wrong });
        }
        if both_leaves {
            return self.exact(p, q, cost);
        }
        if cluster != [false; 2] {
            return Step::Split(match cluster {
                [true, true] => usize::from(nodes[1].radius > nodes[0].radius),
                [_, second] => usize::from(second),
            });
        }
        // The node that takes away more; where nothing is known but a bound, the larger.
        let split = if trusted {
            let errors = pair.errors(varies, wrong);
            usize::from(errors[1] > errors[0])
        } else {
            larger([true; 2])
        };
        Step::Split(if leaf[split] { 1 - split } else { split })
    }

    fn accepts(&self, pair: &Contributions, varies: [f32; 2], wrong: f32) -> bool {
        let errors = pair.errors(varies, wrong);
        errors[0] + errors[1] <= self.limit
    }

    /// A pair of elements by the pairwise estimator.
    fn exact(&self, p: u32, q: u32, cost: &mut Cost) -> Step {
        let Linking { hierarchy, elements, estimator, tolerance, seed, .. } = self.linking;
        let [a, b] = [p, q].map(|k| hierarchy.elements[k as usize]);
        // The order and the seed of rows of pairs.
        let (a, b) = (a.min(b), a.max(b));
        let own = mix(seed ^ mix(u64::from(a) << 32 | u64::from(b)));
        let [i, j] = [a, b].map(|e| &elements.polygons(e as usize)[0]);
        let estimate = estimator.exchange(i, j, *tolerance, own);
        *cost += estimate.cost;
        let areas = hierarchy.weights[a as usize] * hierarchy.weights[b as usize];
        let kernel = (estimate.value * hierarchy.frame.scale.powi(2) / areas) as f32;
        if kernel > 0.0 { Step::Keep(Link { p, q, kernel, varies: [0.0; 2], wrong: 0.0 }) } else { Step::Nothing }
    }

    /// The mean kernel of a pair, the share that blockers hide taken off.
    fn sample(&self, p: u32, q: u32, between: Between, blockers: &[u32], cost: &mut Cost) -> Sample {
        let hierarchy = self.linking.hierarchy;
        let whole = statistics(&kernel(&Points::of(hierarchy, p), &Points::of(hierarchy, q)));
        let screens = match (between, &self.linking.screens) {
            (Between::Some { .. }, Some(screens)) => screens,
            _ => {
                *cost += Cost { form_factors: 1, clear_pairs: 1, ..Cost::default() };
                return Sample { mean: whole.mean, deviation: whole.deviation, noise: 0.0 };
            }
        };
        *cost += Cost { form_factors: 1, partial_pairs: 1, ..Cost::default() };
        let seed = mix(self.linking.seed ^ mix(u64::from(p) << 32 | u64::from(q)));
        // Every quarter of a node meets every quarter of the other once, each time in another sixteenth of its area.
        let points = [self.scattered(p, seed), self.scattered(q, mix(seed))];
        let (mut all, mut seen) = ([[0.0; 4]; 4], [[0.0; 4]; 4]);
        for (a, b) in (0..16).map(|k| (k / 4, k % 4)) {
            let (x, y) = (points[0][a][b], points[1][b][a]);
            all[a][b] = kernel_between(x, y);
            if all[a][b] > 0.0 {
                cost.rays += 1;
                seen[a][b] = if screens.blocked(blockers, x.0, y.0) { 0.0 } else { all[a][b] };
            }
        }
        let (all, seen) = (statistics(&all), statistics(&seen));
        let share = if all.mean > 0.0 { seen.mean / all.mean } else { 0.0 };
        // Segments that all agree may miss what is narrower than their spacing.
        let likely = share.clamp(LEAST, 1.0 - LEAST);
        let noise = whole.mean * (likely * (1.0 - likely) / 16.0).sqrt();
        Sample { mean: whole.mean * share, deviation: seen.deviation, noise }
    }

    /// Sixteen points of a node with their normals, one in each quarter of each quarter of its area.
    fn scattered(&self, k: u32, seed: u64) -> [[(Vec3, Vec3); 4]; 4] {
        let hierarchy = self.linking.hierarchy;
        let node = &hierarchy.nodes[k as usize];
        let mut bits = seed;
        let mut points = [[(Vec3::ZERO, Vec3::ZERO); 4]; 4];
        for (quarter, points) in (0_u8..).zip(&mut points) {
            for (part, point) in (0_u8..).zip(points) {
                bits = mix(bits);
                // The middle of one of 4096 cells: never so near the border that rounding puts it beyond.
                let unit = |bits: u64| ((bits & 0xfff) as f32 + 0.5) / 4096.0;
                let (s, t) = (unit(bits), unit(bits >> 32));
                *point = if node.is_parallelogram() {
                    let place =
                        |s: f32, bit: u8| f32::from(quarter >> bit & 1) - 1.0 + 0.5 * (f32::from(part >> bit & 1) + s);
                    let x = node.centre + node.u * place(s, 0) + node.v * place(t, 1);
                    (x, hierarchy.normals[node.plane as usize])
                } else {
                    let share = (f32::from(4 * quarter + part) + s) / 16.0;
                    let (leaf, rest) = hierarchy.leaf_at(k, share);
                    let node = &hierarchy.nodes[leaf as usize];
                    let x = if node.is_parallelogram() {
                        node.centre + node.u * (2.0 * rest - 1.0) + node.v * (2.0 * t - 1.0)
                    } else {
                        let element = hierarchy.elements[leaf as usize] as usize;
                        hierarchy.frame.point(self.linking.elements.polygons(element)[0].sample(rest.into(), t.into()))
                    };
                    (x, hierarchy.normals[node.plane as usize])
                };
            }
        }
        points
    }
}

/// A sampled kernel: its mean, its deviations over both nodes, and the standard error of the mean.
#[derive(Clone, Copy)]
struct Sample {
    mean: f32,
    deviation: [f32; 2],
    noise: f32,
}

/// What two nodes' places say of the kernel between them.
struct Reach {
    /// No kernel of the pair is larger.
    most: f32,
    /// (R_p + R_q)/r.
    ratio: f32,
    /// Whether a node crosses the other's plane.
    straddles: bool,
}

impl Reach {
    /// `None` if one lies behind the other.
    fn of(hierarchy: &Hierarchy, p: u32, q: u32) -> Option<Self> {
        let [p, q] = [p, q].map(|k| &hierarchy.nodes[k as usize]);
        let along = q.centre - p.centre;
        let (r, radii) = (along.length(), p.radius + q.radius);
        let gap = r - radii;
        let (mut cosines, mut straddles) = (1.0, false);
        for (node, other, along) in [(p, q, along), (q, p, -along)] {
            if node.is_cluster() {
                continue;
            }
            let n = hierarchy.normals[node.plane as usize];
            let (height, reach) = (n.dot(along), other.reach(n));
            if height + reach <= FLAT {
                return None;
            }
            straddles |= height - reach < -FLAT;
            cosines *= ((height + reach) / gap.max(f32::MIN_POSITIVE)).min(1.0);
        }
        let most = if gap > 0.0 { cosines / (std::f32::consts::PI * gap * gap) } else { f32::INFINITY };
        Some(Self { most, ratio: radii / r.max(f32::MIN_POSITIVE), straddles })
    }
}
