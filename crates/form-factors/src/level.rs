//! The instruction sets that kernels are compiled for.
//!
//! `pulp` holds the checks, so that nothing here is `unsafe`; a kernel is dispatched once for a row, a tile or a hemicube.

#[cfg(target_arch = "x86_64")]
use pulp::x86::{V3, V4};
use pulp::{Scalar, Simd, WithSimd};

/// An instruction set that this machine has.
#[doc(hidden)]
#[derive(Clone, Copy, Debug)]
pub enum Level {
    /// AVX-512: 8 doubles a register.
    #[cfg(target_arch = "x86_64")]
    Avx512(V4),
    /// AVX2 and FMA: 4 doubles.
    #[cfg(target_arch = "x86_64")]
    Avx2(V3),
    /// What every processor has.
    Plain,
}

impl Level {
    /// The best of this machine.
    pub fn best() -> Self {
        Self::all()[0]
    }

    /// All that this machine has, best first.
    pub fn all() -> Vec<Self> {
        let mut levels = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            levels.extend(V4::try_new().map(Self::Avx512));
            levels.extend(V3::try_new().map(Self::Avx2));
        }
        levels.push(Self::Plain);
        levels
    }

    /// Runs a kernel; plainly one number after another, without fused products, which would be calls.
    pub(crate) fn dispatch<W: WithSimd>(self, work: W) -> W::Output {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(simd) => Simd::vectorize(simd, work),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(simd) => Simd::vectorize(simd, work),
            Self::Plain => work.with_simd(Scalar::new()),
        }
    }
}
