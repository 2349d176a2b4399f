//! The visible share of a partial pair, from scrambled low-discrepancy point pairs.
//!
//! ```text
//! A_i F_ij = F₀ · ⟨V⟩,      ⟨V⟩ ≈ Σ k V / Σ k,      k = cos θ_i cos θ_j / r²
//! ```
//!
//! with the exact unoccluded value F₀. Numerator and denominator use the same points, so what the points do badly on the kernel
//! cancels and only the shadow's edge is left to chance. The points are doubled until the standard error is small enough.
//!
//! The standard error has a heavy tail: where all segments agree it says nothing of what is narrower than their spacing,
//! and one that is small by chance stops the doubling early. So it is never taken to be below one segment's share, and no pair begins with
//! fewer than it is given.

use glam::DVec3;
use radiosity_geometry::Polygon;
use sobol_burley::sample_4d;

use super::area_quadrature::Cell;
use super::pair::FacingPair;
use super::visibility::Blocking;
use crate::rows::mix;

/// Independent scrambles of the same sequence: their spread gives the standard error.
const REPLICATES: usize = 8;
/// Student's t with 7 degrees of freedom covers ±4.53 where a normal distribution covers ±3 (99.73 %).
const SMALL_SAMPLE: f64 = 4.53 / 3.0;
/// Longest sequence.
const MAX_POINTS: u32 = 1 << 16;

/// A visible share and its standard error.
#[derive(Clone, Copy, Debug)]
pub(super) struct Share {
    /// Kernel-weighted mean of V, in [0, 1].
    pub visible: f64,
    /// Standard error, widened so that three of it cover what three of a known one would.
    pub error: f64,
    /// Segments tested.
    pub rays: u64,
}

/// Estimates the visible share of a pair from at least `samples` segments, and as many more as its standard error takes to come down to
/// `wanted`, the longest sequence permitting.
pub(super) fn visible_share(pair: &FacingPair, blocking: &Blocking<'_>, samples: u32, wanted: f64, seed: u64) -> Share {
    let unknown = Share { visible: 0.5, error: 0.5, rays: 0 };
    let (Some(i), Some(j)) = (Spread::new(&pair.i, pair.n_i), Spread::new(&pair.j, pair.n_j)) else { return unknown };
    let kernel = |point: u32, scramble: u32| {
        // The middle of the sequence's 2⁻²⁴ wide cells: never on an edge.
        let [a, b, c, d] = sample_4d(point, 0, scramble).map(|u| f64::from(u) + 0.5_f64.powi(25));
        let ((x, w_x), (y, w_y)) = (i.at(a, b), j.at(c, d));
        let apart = y - x;
        let r2 = apart.length_squared();
        let k = w_x * w_y * apart.dot(pair.n_i).max(0.0) * (-apart.dot(pair.n_j)).max(0.0) / (r2 * r2);
        (k > 0.0 && k.is_finite()).then_some((k, x, y))
    };
    let mut sums = [(0.0, 0.0); REPLICATES]; // Σ k V and Σ k
    let (mut begin, mut end) = (0, samples.div_ceil(REPLICATES as u32).clamp(1, MAX_POINTS).next_power_of_two());
    loop {
        for (r, (visible, all)) in sums.iter_mut().enumerate() {
            let scramble = (mix(mix(seed) ^ r as u64) >> 32) as u32;
            for (k, x, y) in (begin..end).filter_map(|point| kernel(point, scramble)) {
                *all += k;
                if !blocking.blocks(x, y) {
                    *visible += k;
                }
            }
        }
        let share = share(&sums, u64::from(end) * REPLICATES as u64);
        if share.error <= wanted || end >= MAX_POINTS {
            return share;
        }
        (begin, end) = (end, 2 * end);
    }
}

/// The share and its error, from the sums Σ k V and Σ k of the replicates.
fn share(sums: &[(f64, f64); REPLICATES], rays: u64) -> Share {
    let (seen, all) = sums.iter().fold((0.0, 0.0), |(seen, all), (v, k)| (seen + v, all + k));
    if all <= 0.0 {
        return Share { visible: 0.5, error: 0.5, rays };
    }
    let visible = seen / all;
    // Variance of a ratio, by its linearisation over the replicates.
    let spread: f64 = sums.iter().map(|(v, k)| (v - visible * k).powi(2)).sum();
    let n = REPLICATES as f64;
    let replicated = SMALL_SAMPLE * (n / (n - 1.0) * spread).sqrt() / all;
    // Samples that all agree still miss what is narrower than their spacing: at least one in `rays` may differ.
    Share { visible, error: replicated.max(1.0 / (rays as f64 + 2.0)), rays }
}

/// Points spread over a loop.
enum Spread {
    /// Bilinear map of a quadrilateral; the weight is the Jacobian.
    Quad(Cell),
    /// Area-preserving map.
    Even(Polygon),
}

impl Spread {
    fn new(corners: &[DVec3], n: DVec3) -> Option<Self> {
        if corners.len() == 4 {
            Some(Self::Quad(Cell::of(corners, n)))
        } else {
            Polygon::new(corners).ok().map(Self::Even)
        }
    }

    /// The point of (u, v) in (0, 1)² and its weight.
    fn at(&self, u: f64, v: f64) -> (DVec3, f64) {
        match self {
            Self::Quad(cell) => cell.at(2.0 * u - 1.0, 2.0 * v - 1.0),
            Self::Even(polygon) => (polygon.sample(u, v), 1.0),
        }
    }
}
