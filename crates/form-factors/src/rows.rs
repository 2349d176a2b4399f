//! Rows of exchange areas from an estimator: the seam between estimators and stores.

use radiosity_core::{Cost, StoreError};
use radiosity_geometry::{Facets, Polygon};
use rayon::prelude::*;

/// An exchange area A_i F_ij with a bound on its error.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// A_i F_ij, in units of area.
    pub value: f64,
    /// Bound of |error|, or three standard errors where visibility was sampled.
    pub bound: f64,
    /// What it cost.
    pub cost: Cost,
}

/// An estimator of single pairs; symmetric, since A_i F_ij = A_j F_ji is one number.
pub trait Pairwise: Sync {
    /// Short name for tables.
    fn name(&self) -> &'static str;

    /// A_i F_ij of two convex polygons, with an error of at most `tolerance` · min(A_i, A_j) where nothing is sampled;
    /// `seed` picks the points where something is.
    fn exchange(&self, i: &Polygon, j: &Polygon, tolerance: f64, seed: u64) -> Estimate;
}

impl<P: Pairwise + ?Sized> Pairwise for &P {
    fn name(&self) -> &'static str {
        (**self).name()
    }

    fn exchange(&self, i: &Polygon, j: &Polygon, tolerance: f64, seed: u64) -> Estimate {
        (**self).exchange(i, j, tolerance, seed)
    }
}

/// Rows of exchange areas A_s F_st, computed when asked.
pub trait Rows: Sync {
    /// Short name of the estimator, for tables.
    fn name(&self) -> &'static str;

    /// Number of sources.
    fn sources(&self) -> usize;

    /// Number of targets.
    fn targets(&self) -> usize;

    /// Whether A_s F_st = A_t F_ts to the last bit.
    fn symmetric(&self) -> bool;

    /// Fills `values` with A_s F_st of every target; the second value bounds the error of each entry of the row
    /// (three standard errors where sampled).
    ///
    /// # Errors
    ///
    /// [`StoreError`] if an entry is no form factor.
    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError>;

    /// [`Self::row`], of which only the entries t ≥ s are used: a symmetric store mirrors the rest.
    ///
    /// # Errors
    ///
    /// As [`Self::row`].
    fn upper_row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        self.row(s, values)
    }
}

impl<R: Rows + ?Sized> Rows for &R {
    fn name(&self) -> &'static str {
        (**self).name()
    }

    fn sources(&self) -> usize {
        (**self).sources()
    }

    fn targets(&self) -> usize {
        (**self).targets()
    }

    fn symmetric(&self) -> bool {
        (**self).symmetric()
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        (**self).row(s, values)
    }

    fn upper_row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        (**self).upper_row(s, values)
    }
}

/// The rows that a pairwise estimator gives between two lists of facets.
#[derive(Clone, Copy, Debug)]
pub struct PairwiseRows<'a, P> {
    estimator: P,
    sources: &'a Facets,
    targets: &'a Facets,
    tolerance: f64,
    seed: u64,
}

impl<'a, P: Pairwise> PairwiseRows<'a, P> {
    /// Rows from `sources` to `targets` with an error of each F of at most `tolerance` where nothing is sampled.
    pub fn new(estimator: P, sources: &'a Facets, targets: &'a Facets, tolerance: f64, seed: u64) -> Self {
        Self { estimator, sources, targets, tolerance, seed }
    }

    /// Exchange area of facets s and t: the sum over their polygons. A flat facet sees nothing of itself.
    fn pair(&self, s: usize, t: usize) -> Estimate {
        let same = std::ptr::eq(self.sources, self.targets);
        if self.sources.covered(s) || self.targets.covered(t) || (same && s == t && self.sources.polygons(s).len() == 1)
        {
            return Estimate::default();
        }
        // One order for both directions, so that the value and its samples are the same to the last bit.
        let swap = same && s > t;
        let (a, b) = if swap { (t, s) } else { (s, t) };
        let mut total = Estimate::default();
        for (k, i) in self.sources.polygons(a).iter().enumerate() {
            for (l, j) in self.targets.polygons(b).iter().enumerate() {
                if same && a == b && k == l {
                    continue;
                }
                let seed = mix(self.seed ^ mix((a as u64) << 32 | b as u64) ^ ((k as u64) << 32 | l as u64));
                let estimate = self.estimator.exchange(i, j, self.tolerance, seed);
                total.value += estimate.value;
                total.bound += estimate.bound;
                total.cost += estimate.cost;
            }
        }
        total
    }

    fn fill(&self, s: usize, from: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        assert_eq!(values.len(), self.targets(), "row: length");
        let piece = 64;
        let parts: Vec<(Cost, f64)> = values[from..]
            .par_chunks_mut(piece)
            .enumerate()
            .map(|(k, chunk)| {
                let (mut cost, mut bound) = (Cost::default(), 0.0_f64);
                for (l, value) in chunk.iter_mut().enumerate() {
                    let t = from + k * piece + l;
                    let estimate = self.pair(s, t);
                    if !(estimate.value.is_finite() && estimate.value >= 0.0) {
                        return Err(StoreError::Value { source_index: s, target_index: t, value: estimate.value });
                    }
                    *value = estimate.value;
                    cost += estimate.cost;
                    bound = bound.max(estimate.bound);
                }
                Ok((cost, bound))
            })
            .collect::<Result<_, _>>()?;
        let mut total = (Cost { source_evaluations: 1, ..Cost::default() }, 0.0_f64);
        for (cost, bound) in parts {
            total.0 += cost;
            total.1 = total.1.max(bound);
        }
        Ok(total)
    }
}

impl<P: Pairwise> Rows for PairwiseRows<'_, P> {
    fn name(&self) -> &'static str {
        self.estimator.name()
    }

    fn sources(&self) -> usize {
        self.sources.len()
    }

    fn targets(&self) -> usize {
        self.targets.len()
    }

    fn symmetric(&self) -> bool {
        std::ptr::eq(self.sources, self.targets)
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        self.fill(s, 0, values)
    }

    fn upper_row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        self.fill(s, if self.symmetric() { s } else { 0 }, values)
    }
}

/// A well-mixed 64-bit value (the finaliser of Steele, Lea and Flood's SplitMix, 2014): one seed for every purpose.
pub(crate) fn mix(seed: u64) -> u64 {
    let mut z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
