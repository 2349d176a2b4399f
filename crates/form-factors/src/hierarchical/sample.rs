//! The kernel of a pair from points, and the share of it that blockers leave.
//!
//! Nodes of one plane have Gauss's four points each (`exchange`). Among blockers sixteen segments between points scattered over both
//! weigh what is seen, every quarter of a node meeting every quarter of the other once. Quarters do not tell what blockers smaller than the
//! node do within them, so those add the deviation √(S (1 − S)) of what a single segment sees.
//!
//! Where one of the nodes is a cluster, its surfaces face everywhere and four points say little: sixteen points each give 256 kernels k_ab,
//!
//! ```text
//! κ = ⟨k⟩ S,      σ²(⟨k⟩) = σ²_a(⟨k⟩_b)/16 + σ²_b(⟨k⟩_a)/16,      S = share of segments that are free
//! ```
//!
//! with sixteen segments drawn from all 256 in proportion to k, so that none is spent on surfaces that look away. That is the estimate of
//! scattering by a cluster (Sillion 1995), transmittance between the nodes included, from its surfaces themselves instead of a
//! phase function. How F varies over the receivers holds the kernels' own deviation and that of what is seen, √(S (1 − S)).

use glam::Vec3;
use radiosity_core::Cost;

use super::clusters::POINTS;
use super::exchange::{Points, kernel, kernel_between, statistics};
use super::oracle::COHERENT;
use super::refinement::Linking;
use super::tree::{Hierarchy, Node};
use crate::rows::mix;

/// Segments of a pair.
const SEGMENTS: usize = 16;
/// Share of a pair's segments that may differ though none did.
const LEAST: f32 = 1.0 / (SEGMENTS as f32 + 2.0);

/// How many times larger than their samples say the errors of links with clusters are: the same points serve all links of a cluster, and
/// those links are kept whose samples happen to agree.
const KEPT: f32 = 2.0;

/// A sampled kernel: its mean, its deviations over both nodes, and the standard error of the mean.
#[derive(Clone, Copy)]
pub(super) struct Sample {
    pub mean: f32,
    pub deviation: [f32; 2],
    pub noise: f32,
}

/// A point with its normal.
type Point = (Vec3, Vec3);

impl<P> Linking<'_, P> {
    /// The mean kernel of a pair, the share that blockers hide taken off.
    pub(super) fn sample(&self, pair: [u32; 2], blockers: &[u32], finely: [bool; 2], cost: &mut Cost) -> Sample {
        *cost += if blockers.is_empty() {
            Cost { form_factors: 1, clear_pairs: 1, ..Cost::default() }
        } else {
            Cost { form_factors: 1, partial_pairs: 1, ..Cost::default() }
        };
        if pair.iter().any(|&k| self.hierarchy.nodes[k as usize].is_cluster()) {
            self.sample_cluster(pair, blockers, cost)
        } else {
            self.sample_planes(pair, blockers, finely, cost)
        }
    }

    /// Between nodes of one plane each.
    fn sample_planes(&self, [p, q]: [u32; 2], blockers: &[u32], finely: [bool; 2], cost: &mut Cost) -> Sample {
        let hierarchy = self.hierarchy;
        let [a, b] = [p, q].map(|k| Points::of(hierarchy, &hierarchy.nodes[k as usize]));
        let whole = statistics(&kernel(&a, &b));
        let Some(screens) = self.screens.as_ref().filter(|_| !blockers.is_empty()) else {
            return Sample { mean: whole.mean, deviation: whole.deviation, noise: 0.0 };
        };
        let seed = self.seed_of([p, q]);
        let points = [self.scattered(p, seed), self.scattered(q, mix(seed))];
        let (mut all, mut seen, mut cells) = ([[0.0; 4]; 4], [[0.0; 4]; 4], [(0, 0); SEGMENTS]);
        let (mut segments, mut blocked) = ([[(Vec3::ZERO, Vec3::ZERO); 2]; SEGMENTS], [false; SEGMENTS]);
        let mut count = 0;
        for (a, b) in (0..SEGMENTS).map(|k| (k / 4, k % 4)) {
            // Each time another sixteenth of the quarters' areas.
            let ends = [points[0][4 * a + b], points[1][4 * b + a]];
            all[a][b] = kernel_between(ends[0], ends[1]);
            if all[a][b] > 0.0 {
                (segments[count], cells[count]) = (ends, (a, b));
                count += 1;
            }
        }
        screens.blocked(blockers, &segments[..count], &mut blocked[..count]);
        cost.rays += count as u64;
        for (&(a, b), blocked) in cells.iter().zip(blocked).take(count) {
            seen[a][b] = if blocked { 0.0 } else { all[a][b] };
        }
        let (all, seen) = (statistics(&all), statistics(&seen));
        let share = if all.mean > 0.0 { seen.mean / all.mean } else { 0.0 };
        let uneven = COHERENT * whole.mean * (share * (1.0 - share)).sqrt();
        let deviation = [0, 1].map(|k| if finely[k] { seen.deviation[k].hypot(uneven) } else { seen.deviation[k] });
        Sample { mean: whole.mean * share, deviation, noise: whole.mean * doubt(share) }
    }

    /// Where one or both are clusters.
    fn sample_cluster(&self, [p, q]: [u32; 2], blockers: &[u32], cost: &mut Cost) -> Sample {
        let seed = self.seed_of([p, q]);
        let points = [self.sixteen(p, seed), self.sixteen(q, mix(seed))];
        let kernels = kernel(&Points::new(&points[0]), &Points::new(&points[1]));
        let whole = statistics(&kernels);
        let noise = KEPT * whole.deviation[0].hypot(whole.deviation[1]) / (POINTS as f32).sqrt();
        let Some(screens) = self.screens.as_ref().filter(|_| whole.mean > 0.0 && !blockers.is_empty()) else {
            return Sample { mean: whole.mean, deviation: whole.deviation, noise };
        };
        // Every draw stands for a sixteenth of the sum of all kernels.
        let step = whole.mean * (POINTS * POINTS / SEGMENTS) as f32;
        let mut next = step * ((seed >> 40) as f32 + 0.5) / (1_u32 << 24) as f32;
        let (mut segments, mut blocked) = ([[(Vec3::ZERO, Vec3::ZERO); 2]; SEGMENTS], [false; SEGMENTS]);
        let (mut sum, mut count) = (0.0, 0);
        for (row, x) in kernels.iter().zip(points[0]) {
            for (k, y) in row.iter().zip(points[1]) {
                sum += k;
                while sum > next && count < SEGMENTS {
                    segments[count] = [x, y];
                    (count, next) = (count + 1, next + step);
                }
            }
        }
        screens.blocked(blockers, &segments[..count], &mut blocked[..count]);
        cost.rays += count as u64;
        let free = blocked[..count].iter().filter(|blocked| !**blocked).count();
        let share = free as f32 / count.max(1) as f32;
        let uneven = whole.mean * (share * (1.0 - share)).sqrt();
        Sample {
            mean: whole.mean * share,
            deviation: whole.deviation.map(|deviation| (share * deviation).hypot(uneven)),
            noise: (share * noise).hypot(KEPT * whole.mean * doubt(share)),
        }
    }

    fn seed_of(&self, [p, q]: [u32; 2]) -> u64 {
        mix(self.seed ^ mix(u64::from(p) << 32 | u64::from(q)))
    }

    /// The points of a cluster, or as many scattered over a node of one plane.
    fn sixteen(&self, k: u32, seed: u64) -> [Point; POINTS] {
        if self.hierarchy.nodes[k as usize].is_cluster() {
            self.hierarchy.spread[k as usize]
        } else {
            self.scattered(k, seed)
        }
    }

    /// Sixteen points of a node of one plane with their normals: those of a quarter of its area after those of the one before, one in each
    /// quarter of it.
    fn scattered(&self, k: u32, seed: u64) -> [Point; POINTS] {
        let hierarchy: &Hierarchy = self.hierarchy;
        let node: &Node = &hierarchy.nodes[k as usize];
        let mut bits = seed;
        std::array::from_fn(|i| {
            bits = mix(bits);
            // The middle of one of 4096 cells: never so near the border that rounding puts it beyond.
            let unit = |bits: u64| ((bits & 0xfff) as f32 + 0.5) / 4096.0;
            let (s, t) = (unit(bits), unit(bits >> 32));
            if node.is_parallelogram() {
                let (quarter, part) = (i / 4, i % 4);
                let place =
                    |s: f32, bit: usize| (quarter >> bit & 1) as f32 - 1.0 + 0.5 * ((part >> bit & 1) as f32 + s);
                let x = node.centre + node.u * place(s, 0) + node.v * place(t, 1);
                return (x, hierarchy.normals[node.plane as usize]);
            }
            let (leaf, rest) = hierarchy.leaf_at(k, (i as f32 + s) / POINTS as f32);
            hierarchy.point(self.elements, leaf, [rest, t])
        })
    }
}

/// Standard error of a share of segments. Segments that all agree may miss what is narrower than their spacing.
fn doubt(share: f32) -> f32 {
    let likely = share.clamp(LEAST, 1.0 - LEAST);
    (likely * (1.0 - likely) / SEGMENTS as f32).sqrt()
}
