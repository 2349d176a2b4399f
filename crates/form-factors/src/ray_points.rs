//! The points and directions of rays: one low-discrepancy sequence, shifted for every row.
//!
//! A sequence of points x_k in [0, 1)⁴ is computed once and shared by all rows. A row adds a random shift δ to the binary digits of each
//! coordinate,
//!
//! ```text
//! x_k ⊕ δ,      δ uniform,
//! ```
//!
//! which makes every point uniform, so that estimates are unbiased, and leaves the sequence as evenly spread as it was: of a digital net in base 2
//! every elementary interval keeps its number of points (Kollig & Keller 2002, "Efficient multidimensional sampling"). Two
//! coordinates spread rays over the source and two over the hemisphere, distributed like the cosine:
//!
//! ```text
//! sin²θ = x₃,      φ = 2π x₄.
//! ```
//!
//! Digits are 23, and a point stands in the middle of what they leave open. Sums and products are rounded one by one, never fused, so that
//! rays are the same bits on every machine. Directions are unit vectors to 10⁻⁶: the polynomials for sine and cosine are good to 4·10⁻⁷.
//!
//! What is *not* here: where rays go.

use std::sync::Arc;

use pulp::{Arch, Simd, WithSimd};
use radiosity_geometry::occlusion::{BUNDLE, Bundle};
use sobol_burley::sample_4d;

use crate::rows::mix;

/// Longest sequence the sampler has: more points are the same sequence with further shifts.
const SEQUENCE: usize = 1 << 16;

/// Where rays may begin in the sequence: so that registers can be filled.
const GRAIN: usize = 64;

/// Coordinates of a point.
const DIMENSIONS: usize = 4;

/// Binary digits of a coordinate: those of a single-precision number between 1 and 2.
const DIGITS: u32 = 23;

/// Bits of 1.0.
const ONE: u32 = 0x3f80_0000;

/// A sequence of points, by coordinate, as whole numbers of [`DIGITS`] digits.
#[derive(Clone, Debug)]
pub(crate) struct Points {
    digits: Arc<[Vec<u32>; DIMENSIONS]>,
}

impl Points {
    /// At least `count` points, or as many as there are: a Sobol sequence, scrambled as Owen (1995) does.
    pub fn new(count: u32, seed: u64) -> Self {
        // Whole bundles, so that registers can be filled.
        let count = (count as usize).next_multiple_of(BUNDLE).min(SEQUENCE);
        let mut digits = [(); DIMENSIONS].map(|()| Vec::with_capacity(count));
        for k in 0..count as u32 {
            let point = sample_4d(k, 0, mix(seed) as u32);
            for (digits, x) in digits.iter_mut().zip(point) {
                // Samples have 24 digits.
                digits.push((x * (1 << (DIGITS + 1)) as f32) as u32 >> 1);
            }
        }
        Self { digits: Arc::new(digits) }
    }
}

/// The rays of a row, a bundle at a time: points of the unit square and directions.
pub(crate) struct Spray<'a> {
    points: &'a Points,
    seed: u64,
}

/// Points of the unit square, side by side.
#[repr(C, align(64))]
pub(crate) struct Square {
    pub u: [f32; BUNDLE],
    pub v: [f32; BUNDLE],
}

impl Default for Square {
    fn default() -> Self {
        Self { u: [0.0; BUNDLE], v: [0.0; BUNDLE] }
    }
}

impl<'a> Spray<'a> {
    /// Rays that `seed` shifts.
    pub fn new(points: &'a Points, seed: u64) -> Self {
        Self { points, seed }
    }

    /// The points of rays `first` and on, as many as `bundle` is long, and their directions.
    ///
    /// # Panics
    ///
    /// If `first` is no multiple of [`GRAIN`], or the rays pass the end of the sequence.
    pub fn fill(&self, first: usize, square: &mut Square, bundle: &mut Bundle) {
        assert!(first.is_multiple_of(GRAIN), "rays from {first} on");
        let length = self.points.digits[0].len();
        let (round, at) = (first / length, first % length);
        let seed = mix(self.seed ^ mix(round as u64));
        let bits = [seed, mix(seed)];
        let shift = [bits[0], bits[0] >> 32, bits[1], bits[1] >> 32].map(|bits| bits as u32 >> (32 - DIGITS));
        let digits = self.points.digits.each_ref().map(|digits| &digits[at..(at + BUNDLE).min(length)]);
        Arch::new().dispatch(Fill { digits, shift, square, bundle });
    }
}

struct Fill<'a> {
    digits: [&'a [u32]; DIMENSIONS],
    shift: [u32; DIMENSIONS],
    square: &'a mut Square,
    bundle: &'a mut Bundle,
}

impl WithSimd for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { digits, shift, square, bundle } = self;
        let digits = digits.map(|digits| S::as_simd_u32s(digits).0);
        let shift = shift.map(|shift| simd.splat_u32s(shift));
        let (us, vs) = (S::as_mut_simd_f32s(&mut square.u).0, S::as_mut_simd_f32s(&mut square.v).0);
        let direction = bundle.direction.each_mut().map(|x| S::as_mut_simd_f32s(x).0);
        let (float, word) = (|x: f32| simd.splat_f32s(x), |x: u32| simd.splat_u32s(x));
        let times = |x, y| simd.mul_f32s(x, y);
        let plus = |x, y| simd.add_f32s(x, y);
        // Digits after the point to a number between 0 and 1, less `offset`, the middle of the last digit added.
        let middle = 0.5 / (1 << DIGITS) as f32;
        let number = |digits, offset: f32| {
            let above = simd.transmute_f32s_u32s(simd.or_u32s(digits, word(ONE)));
            simd.add_f32s(simd.sub_f32s(above, float(1.0 + offset)), float(middle))
        };
        for k in 0..bundle.len.div_ceil(S::F32_LANES) {
            let x: [S::u32s; DIMENSIONS] = std::array::from_fn(|d| simd.xor_u32s(digits[d][k], shift[d]));
            us[k] = number(x[0], 0.0);
            vs[k] = number(x[1], 0.0);
            let square = number(x[2], 0.0);
            let (sin, cos) = (simd.sqrt_f32s(square), simd.sqrt_f32s(simd.sub_f32s(float(1.0), square)));
            // The first two digits of φ are the quadrant, the others an angle a from its middle.
            let quadrant = simd.wrapping_dyn_shr_u32s(x[3], word(DIGITS - 2));
            let within = simd.wrapping_dyn_shl_u32s(simd.and_u32s(x[3], word((1 << (DIGITS - 2)) - 1)), word(2));
            let a = times(number(within, 0.5), float(std::f32::consts::FRAC_PI_2));
            let aa = times(a, a);
            let sin_a = [1.0 / 120.0, -1.0 / 6.0, 1.0].iter();
            let sin_a = sin_a.fold(float(-1.0 / 5040.0), |sum, &c| plus(times(sum, aa), float(c)));
            let sin_a = times(sin_a, a);
            let cos_a = [-1.0 / 720.0, 1.0 / 24.0, -0.5, 1.0].iter();
            let cos_a = cos_a.fold(float(1.0 / 40320.0), |sum, &c| plus(times(sum, aa), float(c)));
            let odd = simd.equal_u32s(simd.and_u32s(quadrant, word(1)), word(1));
            let sign = |of: S::u32s, x: S::f32s| {
                let bit = simd.wrapping_dyn_shl_u32s(simd.and_u32s(of, word(2)), word(30));
                simd.transmute_f32s_u32s(simd.xor_u32s(simd.transmute_u32s_f32s(x), bit))
            };
            let cos_phi = sign(simd.add_u32s(quadrant, word(1)), simd.select_f32s(odd, sin_a, cos_a));
            let sin_phi = sign(quadrant, simd.select_f32s(odd, cos_a, sin_a));
            direction[0][k] = times(sin, cos_phi);
            direction[1][k] = times(sin, sin_phi);
            direction[2][k] = cos;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::level::Level;

    fn bundle(points: &Points, seed: u64, first: usize) -> (Square, Bundle) {
        let (mut square, mut bundle) = (Square::default(), Bundle { len: BUNDLE, ..Bundle::default() });
        Spray::new(points, seed).fill(first, &mut square, &mut bundle);
        (square, bundle)
    }

    /// 256 points of a (0, 8)-sequence: 16 in every sixteenth of an axis, and one in every cell of 16 × 16 of the first two.
    #[test]
    fn a_shift_keeps_the_points_of_every_elementary_interval() {
        let points = Points::new(256, 4);
        for seed in 0..20 {
            let (square, bundle) = bundle(&points, seed, 0);
            let sixteenth = |x: f32| (x * 16.0) as usize;
            let (mut cells, mut heights) = ([0; 256], [0; 16]);
            for k in 0..BUNDLE {
                cells[16 * sixteenth(square.v[k]) + sixteenth(square.u[k])] += 1;
                // sin²θ; a value within 10⁻⁶ of a border may have been rounded across it.
                let [x, y] = [0, 1].map(|axis| bundle.direction[axis][k]);
                heights[sixteenth(x * x + y * y)] += 1;
            }
            assert_eq!(cells, [1; 256], "seed {seed}");
            assert_eq!(heights, [16; 16], "seed {seed}");
        }
    }

    /// Over N = 20 · 256 points the mean of cos θ is 2/3, of the others 0, to a few parts in N.
    #[test]
    fn directions_are_unit_vectors_distributed_like_the_cosine() {
        let (points, mut mean) = (Points::new(256, 1), [0.0; 3]);
        for seed in 0..20 {
            let (_, bundle) = bundle(&points, seed, 0);
            for k in 0..BUNDLE {
                let d = [0, 1, 2].map(|axis| f64::from(bundle.direction[axis][k]));
                assert!((d.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-6 && d[2] > 0.0);
                (0..3).for_each(|axis| mean[axis] += d[axis] / 5120.0);
            }
        }
        assert!((mean[2] - 2.0 / 3.0).abs() < 1e-3 && mean[0].abs() < 1e-3 && mean[1].abs() < 1e-3, "{mean:?}");
    }

    #[test]
    fn further_points_and_other_rows_are_shifted_otherwise() {
        let points = Points::new(1 << 20, 1);
        assert_eq!(points.digits[0].len(), SEQUENCE);
        let first = bundle(&points, 1, 0).0.u;
        for (seed, at) in [(1, SEQUENCE), (1, BUNDLE), (2, 0)] {
            assert_ne!(bundle(&points, seed, at).0.u, first);
        }
        // What a row has begun with does not depend on how many points there may be.
        assert_eq!(bundle(&Points::new(100, 1), 1, 0).0.u, first);
    }

    #[test]
    fn points_and_directions_are_the_same_bits_on_every_instruction_set() {
        let points = Points::new(256, 2);
        let digits = points.digits.each_ref().map(|digits| &digits[..]);
        let all = Level::all().into_iter().map(|level| {
            let (mut square, mut bundle) = (Square::default(), Bundle { len: BUNDLE, ..Bundle::default() });
            let shift = [0x1234, 0x7f_ffff, 0x55_5555, 0x40_0001];
            level.dispatch(Fill { digits, shift, square: &mut square, bundle: &mut bundle });
            (square.u, square.v, bundle.direction)
        });
        let all: Vec<_> = all.collect();
        assert!(all.iter().all(|found| *found == all[0]));
    }
}
