//! Targets drawn from rows, for methods that sample.
//!
//! A store draws t from source s with probability A_s F_st / T. With c_t of n draws on t,
//!
//! ```text
//! A_s F_st ≈ T c_t / n,      T = max(A_s, Σ_t A_s F_st)
//! ```
//!
//! is unbiased. What a row lacks of A_s leaves the scene: such draws have no target. What is *not* here: the casting of rays, which
//! a store does whose estimator can (see [`FormFactors::sample`]).

use crate::{Cost, FormFactors, RowBuf, StoreError};

/// The target of a draw that leaves the scene.
pub const LOST: u32 = u32::MAX;

/// Draws that share a seed; those of different seeds are independent.
#[derive(Debug)]
pub struct Draws<'a> {
    /// What picks the targets.
    pub seed: u64,
    /// One target a draw, to be filled in; [`LOST`] where there is none.
    pub targets: &'a mut [u32],
}

/// What draws of one source stand for, and what they cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drawn {
    /// T, the exchange area that the draws of one seed share.
    pub exchange: f64,
    /// What *this call* spent.
    pub cost: Cost,
}

/// Scratch for [`FormFactors::sample`].
#[derive(Clone, Debug, Default)]
pub struct DrawBuf {
    row: RowBuf,
    /// Σ of the row up to and with every target that it holds.
    sums: Vec<(f64, u32)>,
}

/// [`FormFactors::sample`] from a row: n points at even distances from a random beginning, through the inverse of its running sum.
///
/// A target gets its share of the draws rounded down or up, so the variance of A_s F_st is at most T²/4n², and no more than that of
/// independent draws.
///
/// # Errors
///
/// As [`FormFactors::row`].
pub fn sample_by_rows<S: FormFactors + ?Sized>(
    store: &S,
    s: usize,
    band: usize,
    area: f64,
    draws: &mut [Draws<'_>],
    buf: &mut DrawBuf,
) -> Result<Drawn, StoreError> {
    let DrawBuf { row, sums } = buf;
    let row = store.row(s, band, row)?;
    let mut sum = 0.0;
    sums.clear();
    row.entries.for_each(|t, value| {
        sum += value;
        sums.push((sum, t as u32));
    });
    // A sum that is no number must show.
    let exchange = if sum <= area { area } else { sum };
    for draw in draws {
        let (n, begin) = (draw.targets.len() as f64, uniform(draw.seed));
        let mut rest = &sums[..];
        for (k, target) in draw.targets.iter_mut().enumerate() {
            let u = (k as f64 + begin) / n * exchange;
            rest = &rest[rest.partition_point(|(sum, _)| *sum <= u)..];
            *target = rest.first().map_or(LOST, |&(_, t)| t);
        }
    }
    Ok(Drawn { exchange, cost: row.cost + Cost::applied(row.entries.stored(), 8, 1) })
}

/// A well-mixed 64-bit value (the finaliser of Steele, Lea and Flood's SplitMix, 2014): one seed for every purpose.
pub fn mix(seed: u64) -> u64 {
    let mut z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A number in [0, 1) that a seed stands for, in steps of 2⁻⁵³.
pub fn uniform(seed: u64) -> f64 {
    (mix(seed) >> 11) as f64 / (1_u64 << 53) as f64
}
