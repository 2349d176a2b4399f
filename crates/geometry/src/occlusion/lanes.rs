//! Eight single-precision numbers at once: with AVX-512, with AVX2 and FMA, and without either, chosen at run time.
//!
//! `pulp` holds the checks of the processor, so that nothing here is `unsafe`. What is computed in eight lanes only rejects
//! what is far from a ray, with margins that cover its rounding: hits are the same whatever the instruction set.

#[cfg(target_arch = "x86_64")]
use pulp::x86::{V3, V4};
use pulp::{Arch, NullaryFnOnce};
#[cfg(target_arch = "x86_64")]
use pulp::{b8, cast, f32x8};

/// Numbers in a vector.
pub(super) const LANES: usize = 8;

/// One number a lane, aligned for a whole load.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct Row(pub [f32; LANES]);

/// An instruction set.
pub(super) trait Lanes: Copy {
    /// [`LANES`] numbers.
    type Floats: Copy;

    fn splat(self, x: f32) -> Self::Floats;
    fn load(self, row: &Row) -> Self::Floats;
    fn sub(self, x: Self::Floats, y: Self::Floats) -> Self::Floats;
    fn mul(self, x: Self::Floats, y: Self::Floats) -> Self::Floats;
    /// x·y + z, rounded once or twice.
    fn mul_add(self, x: Self::Floats, y: Self::Floats, z: Self::Floats) -> Self::Floats;
    fn min(self, x: Self::Floats, y: Self::Floats) -> Self::Floats;
    fn max(self, x: Self::Floats, y: Self::Floats) -> Self::Floats;
    /// A bit for every lane with x ≤ y; none where one is no number.
    fn at_most(self, x: Self::Floats, y: Self::Floats) -> u32;
    /// x in the lanes of a mask, ∞ in the others.
    fn only(self, mask: u32, x: Self::Floats) -> Self::Floats;
    /// The lane of the least number.
    fn least(self, x: Self::Floats) -> usize;
    /// The lanes of a mask one after another, then anything.
    fn packed(self, mask: u32, x: Self::Floats) -> Row;
    /// [`Self::packed`] of whole numbers.
    fn packed_words(self, mask: u32, x: &[u32; LANES]) -> [u32; LANES];
}

/// No vectors: what the compiler makes of plain loops.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plain;

impl Lanes for Plain {
    type Floats = [f32; LANES];

    #[inline(always)]
    fn splat(self, x: f32) -> Self::Floats {
        [x; LANES]
    }

    #[inline(always)]
    fn load(self, row: &Row) -> Self::Floats {
        row.0
    }

    #[inline(always)]
    fn sub(self, x: Self::Floats, y: Self::Floats) -> Self::Floats {
        std::array::from_fn(|k| x[k] - y[k])
    }

    #[inline(always)]
    fn mul(self, x: Self::Floats, y: Self::Floats) -> Self::Floats {
        std::array::from_fn(|k| x[k] * y[k])
    }

    #[inline(always)]
    fn mul_add(self, x: Self::Floats, y: Self::Floats, z: Self::Floats) -> Self::Floats {
        std::array::from_fn(|k| x[k] * y[k] + z[k])
    }

    #[inline(always)]
    fn min(self, x: Self::Floats, y: Self::Floats) -> Self::Floats {
        std::array::from_fn(|k| if x[k] < y[k] { x[k] } else { y[k] })
    }

    #[inline(always)]
    fn max(self, x: Self::Floats, y: Self::Floats) -> Self::Floats {
        std::array::from_fn(|k| if x[k] > y[k] { x[k] } else { y[k] })
    }

    #[inline(always)]
    fn at_most(self, x: Self::Floats, y: Self::Floats) -> u32 {
        (0..LANES).map(|k| u32::from(x[k] <= y[k]) << k).sum()
    }

    #[inline(always)]
    fn only(self, mask: u32, x: Self::Floats) -> Self::Floats {
        std::array::from_fn(|k| if mask >> k & 1 == 1 { x[k] } else { f32::INFINITY })
    }

    #[inline(always)]
    fn least(self, x: Self::Floats) -> usize {
        (1..LANES).fold(0, |least, k| if x[k] < x[least] { k } else { least })
    }

    #[inline(always)]
    fn packed(self, mask: u32, x: Self::Floats) -> Row {
        Row(self.packed_words(mask, &x.map(f32::to_bits)).map(f32::from_bits))
    }

    #[inline(always)]
    fn packed_words(self, mask: u32, x: &[u32; LANES]) -> [u32; LANES] {
        let (mut packed, mut next) = ([0; LANES], 0);
        for (k, &word) in x.iter().enumerate() {
            packed[next % LANES] = word;
            next += (mask >> k & 1) as usize;
        }
        packed
    }
}

#[cfg(target_arch = "x86_64")]
macro_rules! vectors {
    ($level:ty, |$simd:ident, $x:ident, $y:ident| $at_most:expr, |$mask:ident| $only:expr, $packed:expr) => {
        impl Lanes for $level {
            type Floats = f32x8;

            #[inline(always)]
            fn splat(self, x: f32) -> f32x8 {
                self.splat_f32x8(x)
            }

            #[inline(always)]
            fn load(self, row: &Row) -> f32x8 {
                cast(row.0)
            }

            #[inline(always)]
            fn sub(self, x: f32x8, y: f32x8) -> f32x8 {
                self.sub_f32x8(x, y)
            }

            #[inline(always)]
            fn mul(self, x: f32x8, y: f32x8) -> f32x8 {
                self.mul_f32x8(x, y)
            }

            #[inline(always)]
            fn mul_add(self, x: f32x8, y: f32x8, z: f32x8) -> f32x8 {
                self.mul_add_f32x8(x, y, z)
            }

            #[inline(always)]
            fn min(self, x: f32x8, y: f32x8) -> f32x8 {
                self.min_f32x8(x, y)
            }

            #[inline(always)]
            fn max(self, x: f32x8, y: f32x8) -> f32x8 {
                self.max_f32x8(x, y)
            }

            #[inline(always)]
            fn at_most(self, $x: f32x8, $y: f32x8) -> u32 {
                let $simd = self;
                $at_most
            }

            #[inline(always)]
            fn only(self, $mask: u32, $x: f32x8) -> f32x8 {
                let $simd = self;
                $only
            }

            #[inline(always)]
            fn least(self, x: f32x8) -> usize {
                let halves = self.min_f32x8(x, cast(self.avx._mm256_permute2f128_ps::<1>(cast(x), cast(x))));
                let pairs = self.min_f32x8(halves, cast(self.avx._mm256_permute_ps::<0x4e>(cast(halves))));
                let all = self.min_f32x8(pairs, cast(self.avx._mm256_permute_ps::<0xb1>(cast(pairs))));
                self.at_most(x, all).trailing_zeros() as usize
            }

            #[inline(always)]
            fn packed(self, mask: u32, x: f32x8) -> Row {
                Row(cast(self.packed_words(mask, &cast(x))))
            }

            #[inline(always)]
            fn packed_words(self, $mask: u32, x: &[u32; LANES]) -> [u32; LANES] {
                let ($simd, $x) = (self, *x);
                $packed
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
vectors!(
    V3,
    |simd, x, y| simd.avx._mm256_movemask_ps(cast(simd.cmp_le_f32x8(x, y))) as u32,
    |mask| {
        let bits = simd.and_u32x8(simd.splat_u32x8(mask), cast(BITS));
        simd.select_f32x8(simd.cmp_eq_u32x8(bits, cast(BITS)), x, simd.splat_f32x8(f32::INFINITY))
    },
    {
        let places = simd.avx2._mm256_cvtepu8_epi32(cast([PLACES[(mask & 0xff) as usize], 0]));
        cast(simd.avx2._mm256_permutevar8x32_epi32(cast(x), places))
    }
);
#[cfg(target_arch = "x86_64")]
vectors!(
    V4,
    |simd, x, y| {
        let b8(mask) = simd.cmp_le_f32x8(x, y);
        u32::from(mask)
    },
    |mask| simd.select_f32x8(b8(mask as u8), x, simd.splat_f32x8(f32::INFINITY)),
    cast(simd.avx512f._mm256_maskz_compress_epi32(mask as u8, cast(x)))
);

/// A bit for each lane.
#[cfg(target_arch = "x86_64")]
const BITS: [u32; LANES] = [1, 2, 4, 8, 16, 32, 64, 128];

/// The lanes of every mask one after another, a byte each.
#[cfg(target_arch = "x86_64")]
static PLACES: [u64; 256] = {
    let (mut places, mut mask) = ([0_u64; 256], 0);
    while mask < 256 {
        let (mut next, mut lane) = (0, 0);
        while lane < LANES {
            if mask >> lane & 1 == 1 {
                places[mask] |= (lane as u64) << (8 * next);
                next += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    places
};

/// The instruction set that this machine has.
#[derive(Clone, Copy, Debug)]
pub(super) enum Level {
    #[cfg(target_arch = "x86_64")]
    Avx512(V4),
    #[cfg(target_arch = "x86_64")]
    Avx2(V3),
    Plain,
}

/// Work that is compiled for every instruction set. All it calls must be inlined.
pub(super) trait Work {
    type Output;

    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

struct On<L, W>(L, W);

impl<L: Lanes, W: Work> NullaryFnOnce for On<L, W> {
    type Output = W::Output;

    #[inline(always)]
    fn call(self) -> W::Output {
        self.1.run(self.0)
    }
}

impl Level {
    /// The best of this machine.
    pub fn best() -> Self {
        match Arch::new() {
            #[cfg(target_arch = "x86_64")]
            Arch::V4(simd) => Self::Avx512(simd),
            #[cfg(target_arch = "x86_64")]
            Arch::V3(simd) => Self::Avx2(simd),
            _ => Self::Plain,
        }
    }

    /// All that this machine has.
    #[cfg(test)]
    pub fn all() -> Vec<Self> {
        let mut levels = vec![Self::Plain];
        #[cfg(target_arch = "x86_64")]
        {
            levels.extend(V3::try_new().map(Self::Avx2));
            levels.extend(V4::try_new().map(Self::Avx512));
        }
        levels
    }

    /// Does some work.
    #[inline]
    pub fn run<W: Work>(self, work: W) -> W::Output {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(simd) => simd.vectorize(On(simd, work)),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(simd) => simd.vectorize(On(simd, work)),
            Self::Plain => On(Plain, work).call(),
        }
    }
}
