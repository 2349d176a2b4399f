//! What a call spent, as exact counts.

use std::ops::{Add, AddAssign};

/// Work done by one call, in counts that repeat exactly; times are measured elsewhere.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    /// Form factors computed (one unordered pair of a pairwise estimator, or one entry of an estimated row).
    pub form_factors: u64,
    /// Rows for which an estimator was started: hemicubes, hemispheres of rays, rows of pairs.
    pub source_evaluations: u64,
    /// Rays and segments tested for visibility.
    pub rays: u64,
    /// Points at which the visible part of a polygon was cut exactly.
    pub visibility_points: u64,
    /// Pixels of hemicube item buffers.
    pub hemicube_pixels: u64,
    /// Pairs in which nothing can block.
    pub clear_pairs: u64,
    /// Pairs that cannot see each other at all.
    pub hidden_pairs: u64,
    /// Pairs that may see each other in part.
    pub partial_pairs: u64,
    /// Stored form factors read to apply them.
    pub entries: u64,
    /// Floating-point operations of solvers and of applying form factors.
    pub flops: u64,
    /// Bytes of form factors read to apply them.
    pub bytes: u64,
}

impl Cost {
    /// The cost of reading `entries` stored values of `width` bytes and applying them to `bands` bands.
    pub fn applied(entries: usize, width: usize, bands: usize) -> Self {
        let entries = entries as u64;
        Self { entries, flops: 2 * entries * bands as u64, bytes: entries * width as u64, ..Self::default() }
    }
}

impl Add for Cost {
    type Output = Self;

    fn add(mut self, other: Self) -> Self {
        self += other;
        self
    }
}

impl AddAssign for Cost {
    fn add_assign(&mut self, other: Self) {
        self.form_factors += other.form_factors;
        self.source_evaluations += other.source_evaluations;
        self.rays += other.rays;
        self.visibility_points += other.visibility_points;
        self.hemicube_pixels += other.hemicube_pixels;
        self.clear_pairs += other.clear_pairs;
        self.hidden_pairs += other.hidden_pairs;
        self.partial_pairs += other.partial_pairs;
        self.entries += other.entries;
        self.flops += other.flops;
        self.bytes += other.bytes;
    }
}

impl std::iter::Sum for Cost {
    fn sum<I: Iterator<Item = Self>>(costs: I) -> Self {
        costs.fold(Self::default(), Add::add)
    }
}
