//! The instruction sets that products are compiled for, and what they need of one.
//!
//! AVX-512, AVX2 with FMA, and neither, chosen at run time; `pulp` holds the checks, so that nothing here is `unsafe`.

use pulp::bytemuck::Pod;
#[cfg(target_arch = "x86_64")]
use pulp::x86::{V3, V4};
use pulp::{NullaryFnOnce, Scalar256b, Simd};

use crate::level::Level;

/// An instruction set that can widen single precision, sum vectors and ask for memory ahead.
pub trait Lanes: Simd {
    /// As many single-precision values as a vector holds doubles.
    type Singles: Pod;
    /// Rows taken together, 4 or 2: as many as their sums and multipliers of three bands leave registers for.
    const ROWS: usize;

    /// The values as doubles.
    fn widen(self, singles: Self::Singles) -> Self::f64s;

    /// The sums of R vectors, each over its lanes.
    #[inline(always)]
    fn reduce<const R: usize>(self, vectors: [Self::f64s; R]) -> [f64; R] {
        vectors.map(|v| self.reduce_sum_f64s(v))
    }

    /// Asks for the cache line at an address, if the machine can be asked; the address need not be valid.
    fn prefetch<T>(self, _address: *const T) {}
}

#[cfg(target_arch = "x86_64")]
impl Lanes for V4 {
    type Singles = [f32; 8];
    const ROWS: usize = 4;

    #[inline(always)]
    fn widen(self, singles: [f32; 8]) -> Self::f64s {
        pulp::cast(self.avx512f._mm512_cvtps_pd(pulp::cast(singles)))
    }

    /// Four vectors together, by halves: 12 instructions instead of 28 at the end of every row.
    #[inline(always)]
    fn reduce<const R: usize>(self, vectors: [Self::f64s; R]) -> [f64; R] {
        let mut sums = [0.0; R];
        for (sums, v) in sums.chunks_mut(4).zip(vectors.chunks(4)) {
            if let [a, b, c, d] = *v {
                let (f, [a, b, c, d]) = (self.avx512f, [a, b, c, d].map(pulp::cast));
                let ab = f._mm512_add_pd(f._mm512_unpacklo_pd(a, b), f._mm512_unpackhi_pd(a, b));
                let cd = f._mm512_add_pd(f._mm512_unpacklo_pd(c, d), f._mm512_unpackhi_pd(c, d));
                let quarters = f._mm512_add_pd(
                    f._mm512_shuffle_f64x2::<0b10_00_10_00>(ab, cd),
                    f._mm512_shuffle_f64x2::<0b11_01_11_01>(ab, cd),
                );
                let halves = f._mm512_add_pd(quarters, f._mm512_shuffle_f64x2::<0b11_11_01_01>(quarters, quarters));
                let whole: [f64; 8] = pulp::cast(f._mm512_shuffle_f64x2::<0b10_00_10_00>(halves, halves));
                sums.copy_from_slice(&whole[..4]);
            } else {
                sums.iter_mut().zip(v).for_each(|(sum, v)| *sum = self.reduce_sum_f64s(*v));
            }
        }
        sums
    }

    #[inline(always)]
    fn prefetch<T>(self, address: *const T) {
        self.sse._mm_prefetch::<3>(address.cast());
    }
}

#[cfg(target_arch = "x86_64")]
impl Lanes for V3 {
    type Singles = [f32; 4];
    const ROWS: usize = 2;

    #[inline(always)]
    fn widen(self, singles: [f32; 4]) -> Self::f64s {
        pulp::cast(self.avx._mm256_cvtps_pd(pulp::cast(singles)))
    }

    #[inline(always)]
    fn prefetch<T>(self, address: *const T) {
        self.sse._mm_prefetch::<3>(address.cast());
    }
}

impl Lanes for Scalar256b {
    type Singles = [f32; 4];
    const ROWS: usize = 2;

    #[inline(always)]
    fn widen(self, singles: [f32; 4]) -> Self::f64s {
        pulp::cast(singles.map(f64::from))
    }
}

/// Something to do on an instruction set.
pub(super) trait Work {
    /// Does it.
    fn run<L: Lanes>(self, lanes: L);
}

/// Work with the instruction set it is compiled for.
struct On<L, W>(L, W);

impl<L: Lanes, W: Work> NullaryFnOnce for On<L, W> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.1.run(self.0);
    }
}

/// Does some work on an instruction set.
pub(super) fn run<W: Work>(level: Level, work: W) {
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx512(simd) => simd.vectorize(On(simd, work)),
        #[cfg(target_arch = "x86_64")]
        Level::Avx2(simd) => simd.vectorize(On(simd, work)),
        Level::Plain => On(Scalar256b, work).call(),
    }
}
