//! What a link may err by, and what becomes of a pair of nodes.
//!
//! A link (p, q) stands for every pair of an element of p with one of q and gives all of them one kernel κ. What a receiver p then
//! misses is known from the kernel's samples (`exchange`), with b the mean radiosity of a node, s its standard deviation over the node,
//! σ_p the standard deviation of F(x → q) over x ∈ p, and δκ what κ itself may be off by:
//!
//! ```text
//! ε_p² = A_p·[ (b_q σ_p)² + (s_q σ_q A_q/A_p)² + (b_q A_q δκ)² ],        accepted where w_p ε_p² + w_q ε_q² ≤ τ² Σ A
//! ```
//!
//! This is the oracle B·F·A in the norm in which errors are reported, Σ A (H − H*)²: a node's own size counts, so that small nodes may
//! see coarse partners; w ≥ 1 gives a surface smaller than the mean of all as much weight as that has, since small surfaces are often the
//! bright ones and an area alone lets them err by several times what walls do; where errors of some elements count more than others
//! ([`Brightness::worth`]), w has the mean of that over
//! the node as a factor. Refining the link with the largest ε² gains most for its cost, so all are brought below one threshold τ.
//!
//! δκ is c₄((R_p + R_q)/r)⁴ κ for the product rule between nodes of one plane, and the standard error of what was sampled where
//! blockers or clusters take part (`sample`). Where nodes are nearer than samples can be trusted, a proven bound takes the place of all three:
//!
//! ```text
//! K ≤ cos⁺_p cos⁺_q / (π d²),      cos⁺_p = min(1, (height of q over p's plane) / d),      F ≤ min(1, A_q K)
//! ```
//!
//! with d the gap between the spheres; cos⁺ has the slack that a pair across a horizon needs, which cosines between centres miss, and is 1
//! for a cluster. A pair of elements that no refinement can make better goes to the exact pairwise estimator. Pairs that see each other in part go on
//! while a blocker about as large as one of the nodes passes through it, so that a link never spans what a partition parts.
//!
//! (Hanrahan, Salzman, Aupperle 1991; Smits, Arvo, Greenberg 1994 for clusters; Holzschuch, Sillion, Drettakis 1994 for links refined as
//! the solution becomes known.)

use radiosity_core::Cost;

use super::brightness::Brightness;
use super::links::{Estimate, Link};
use super::refinement::{Linking, Search};
use super::screens::{FLAT, Seen};
use super::tree::{Hierarchy, Node};
use crate::Pairwise;
use crate::rows::mix;

/// (R_p + R_q)/r up to which samples are trusted.
const TRUSTED: f32 = 0.6;
/// δκ/κ of the product rule at (R_p + R_q)/r = 1.
const RULE: f32 = 0.3;
/// δκ of a pair one of which crosses the other's plane, as a share of the proven bound of the kernel.
const HORIZON: f32 = 0.1;
/// How many times as much as by its square counts what links of a receiver miss alike, so that it adds up by size.
pub(super) const COHERENT: f32 = 3.0;
/// δκ of a pair with a cluster, as a share of the bound: what its points may have missed.
const UNSEEN: f32 = 1.0 / 64.0;

/// What the oracle needs of a pair: areas, brightness and its deviation.
pub(super) struct Contributions {
    area: [f32; 2],
    /// How much more errors on either count than its area says.
    share: [f32; 2],
    /// What it counts.
    worth: [f32; 2],
    mean: [f32; 2],
    deviation: [f32; 2],
    /// What is left of σ on either receiver.
    left: [f32; 2],
}

impl Contributions {
    pub fn of(hierarchy: &Hierarchy, brightness: &Brightness, p: u32, q: u32) -> Self {
        let (a, b) = (p as usize, q as usize);
        let worth = [a, b].map(|k| brightness.counts(k));
        let share = [hierarchy.share(p) * worth[0], hierarchy.share(q) * worth[1]];
        let (p, q) = (&hierarchy.nodes[a], &hierarchy.nodes[b]);
        let ratio = (p.radius + q.radius) / p.centre.distance(q.centre).max(f32::MIN_POSITIVE);
        let left = |node: &Node| if brightness.linear && node.is_parallelogram() { ratio.min(1.0) } else { 1.0 };
        Self {
            area: [p.area, q.area],
            share,
            worth,
            mean: [brightness.mean[a], brightness.mean[b]],
            deviation: [brightness.deviation[a], brightness.deviation[b]],
            left: [left(p), left(q)],
        }
    }

    /// ε_p/√A_p of the first node, or of the second: what its elements miss, in irradiance.
    pub fn missed(&self, k: usize, Estimate { varies, wrong }: Estimate) -> f32 {
        let (own, other, bright) = (self.area[k], self.area[1 - k], self.mean[1 - k]);
        let (missed, off) = (self.left[k] * bright * varies[k], bright * other * wrong);
        let uneven = self.deviation[1 - k] * varies[1 - k] * (other / own);
        (missed * missed + off * off + uneven * uneven).sqrt()
    }

    /// w_p ε_p² + w_q ε_q², shared out by which node must be split to take it away.
    pub fn weighted(&self, estimate: Estimate) -> [f32; 2] {
        self.errors(estimate, self.share)
    }

    /// ε_p² + ε_q², each as often as it counts.
    pub fn square(&self, estimate: Estimate) -> f32 {
        let [p, q] = self.errors(estimate, self.worth);
        p + q
    }

    fn errors(&self, Estimate { varies, wrong }: Estimate, share: [f32; 2]) -> [f32; 2] {
        let of = |k: usize| {
            let (own, other, bright) = (self.area[k], self.area[1 - k], self.mean[1 - k]);
            let (missed, off) = (self.left[k] * bright * varies[k], bright * other * wrong);
            let uneven = COHERENT * self.deviation[k] * varies[k];
            own * (share[k] * (missed * missed + off * off) + share[1 - k] * uneven * uneven * (own / other))
        };
        [of(0), of(1)]
    }
}

/// What two nodes' places say of the kernel between them.
pub(super) struct Reach {
    /// No kernel of the pair is larger.
    pub most: f32,
    /// (R_p + R_q)/r.
    pub ratio: f32,
    /// Whether a node crosses the other's plane.
    pub straddles: bool,
}

impl Reach {
    /// `None` if one lies behind the other.
    pub fn of(hierarchy: &Hierarchy, p: u32, q: u32) -> Option<Self> {
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

/// What becomes of a pair of nodes.
pub(super) enum Step {
    Nothing,
    Keep(Link),
    /// Child pairs of the first or second node.
    Split(usize),
}

impl<P: Pairwise> Search<'_, P> {
    /// What becomes of a pair that blockers may stand between.
    pub(super) fn judge(&self, [p, q]: [u32; 2], reach: &Reach, seen: Seen, blockers: &[u32], cost: &mut Cost) -> Step {
        let hierarchy = self.linking.hierarchy;
        let nodes = [p, q].map(|k| &hierarchy.nodes[k as usize]);
        let pair = Contributions::of(hierarchy, self.brightness, p, q);
        if seen.through != [false; 2] {
            let larger = nodes[1].area > nodes[0].area;
            return Step::Split(usize::from(seen.through[1] && (larger || !seen.through[0])));
        }
        // What is known without a sample.
        let clusters = nodes.iter().any(|node| node.is_cluster());
        let bound = [(reach.most * pair.area[1]).min(1.0), (reach.most * pair.area[0]).min(1.0)];
        // A cluster's elements hold what its links bring alike, whichever way they face.
        let held = nodes.map(|node| if node.is_cluster() { COHERENT } else { 1.0 });
        let mut estimate = Estimate {
            varies: [0.5 * held[0] * bound[0], 0.5 * held[1] * bound[1]],
            wrong: 0.5 * (bound[0] / pair.area[1]).min(bound[1] / pair.area[0]),
        };
        if reach.ratio >= TRUSTED && !self.accepts(&pair, estimate) {
            return self.split([p, q], reach, estimate, cost);
        }
        let found = self.linking.sample([p, q], blockers, seen.finely, cost);
        if reach.ratio < TRUSTED {
            let missed = if clusters {
                UNSEEN * reach.most
            } else {
                let rule = RULE * reach.ratio * reach.ratio * reach.ratio * reach.ratio * found.mean;
                rule.max(if reach.straddles { HORIZON * reach.most } else { 0.0 })
            };
            estimate.wrong = missed.hypot(found.noise).min(estimate.wrong);
            for k in 0..2 {
                // One element holds one value: what varies over it is no fault of a link.
                let over = found.deviation[k] * pair.area[1 - k] * held[k];
                estimate.varies[k] = if nodes[k].is_leaf() { 0.0 } else { over.min(estimate.varies[k]) };
            }
        }
        if self.accepts(&pair, estimate) {
            // No form factor is above 1, and no kernel above its bound; points that nearly touch do not know.
            let kernel = found.mean.min(reach.most).min(1.0 / pair.area[0].max(pair.area[1]));
            return Step::Keep(Link { p, q, kernel, estimate });
        }
        self.split([p, q], reach, estimate, cost)
    }

    /// What becomes of a pair whose link would err too much: two elements go to the exact estimator.
    pub(super) fn split(&self, [p, q]: [u32; 2], reach: &Reach, estimate: Estimate, cost: &mut Cost) -> Step {
        let hierarchy = self.linking.hierarchy;
        let nodes = [p, q].map(|k| &hierarchy.nodes[k as usize]);
        let leaf = nodes.map(Node::is_leaf);
        if leaf == [true; 2] {
            return self.exact(p, q, cost);
        }
        // The node that takes away more; where nothing is known but a bound, the larger.
        let split = if reach.ratio < TRUSTED {
            let errors = Contributions::of(hierarchy, self.brightness, p, q).weighted(estimate);
            usize::from(errors[1] > errors[0])
        } else if nodes.iter().any(|node| node.is_cluster()) {
            usize::from(nodes[1].radius > nodes[0].radius)
        } else {
            usize::from(nodes[1].area > nodes[0].area)
        };
        Step::Split(if leaf[split] { 1 - split } else { split })
    }

    fn accepts(&self, pair: &Contributions, estimate: Estimate) -> bool {
        let errors = pair.weighted(estimate);
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
        if kernel > 0.0 { Step::Keep(Link { p, q, kernel, estimate: Estimate::EXACT }) } else { Step::Nothing }
    }
}
