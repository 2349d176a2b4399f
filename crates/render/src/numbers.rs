//! The numbers in [0, 1) that a path draws.

use radiosity_core::{mix, uniform};
use sobol_burley::{NUM_DIMENSION_SETS_4D, sample_4d};

/// Points of a round: a power of two, so that a round is a whole net.
pub const ROUND: u32 = 16;

/// Sequences of a pixel, which rounds go on with in turn.
pub const STREAMS: usize = 4;

/// Longest sequence the sampler has.
const SEQUENCE: u64 = 1 << 16;

/// The numbers of one path, four at a time.
///
/// The paths of a pixel come in rounds of [`ROUND`], dealt in turn to [`STREAMS`] Sobol sequences scrambled apart (Owen 1995; Burley 2020): evenly spread within
/// a sequence, the better the longer it is (what jumps along a line in a pixel is off by N^(−3/4), not N^(−1/2)), and independent between them, so that they
/// tell their own variance. Beyond 256 numbers they are independent.
#[derive(Clone, Debug)]
pub struct Numbers {
    seed: u64,
    index: u32,
    set: u32,
}

impl Numbers {
    /// Of path `index` of a round that `seed` picks.
    pub fn new(seed: u64, index: u32) -> Self {
        Self { seed, index, set: 0 }
    }

    /// Of sample `sample` of pixel `pixel`.
    pub fn of_pixel(seed: u64, pixel: u64, sample: u64) -> Self {
        let (round, streams) = (sample / u64::from(ROUND), STREAMS as u64);
        let index = round / streams * u64::from(ROUND) + sample % u64::from(ROUND);
        // Where a sequence ends another begins.
        let sequence = index / SEQUENCE * streams + round % streams;
        Self::new(mix(seed ^ mix(pixel ^ mix(sequence))), (index % SEQUENCE) as u32)
    }

    /// The next four.
    pub fn draw(&mut self) -> [f64; 4] {
        let set = self.set;
        self.set += 1;
        if set < NUM_DIMENSION_SETS_4D {
            return sample_4d(self.index, set, self.seed as u32 ^ (self.seed >> 32) as u32).map(f64::from);
        }
        let base = mix(self.seed ^ mix(u64::from(self.index) << 32 | u64::from(set)));
        [0, 1, 2, 3].map(|k| uniform(base ^ k))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of 16 points of a net every sixteenth of the first coordinate has one, and of 64 in four rounds of a stream every 64th; streams and pixels differ.
    #[test]
    fn streams_are_spread_ever_more_evenly_and_differ() {
        let first = |pixel: u64, sample: u64| Numbers::of_pixel(1, pixel, sample).draw()[0];
        let bins = |rounds: &[u64]| {
            let samples = rounds.iter().flat_map(|round| (0..16).map(move |k| 16 * round + k));
            let mut bins: Vec<u32> = samples.map(|k| (16.0 * rounds.len() as f64 * first(3, k)) as u32).collect();
            bins.sort_unstable();
            bins
        };
        assert_eq!(bins(&[0]), (0..16).collect::<Vec<_>>());
        assert_eq!(bins(&[0, 4, 8, 12]), (0..64).collect::<Vec<_>>());
        assert_ne!(bins(&[0, 1, 2, 3]), (0..64).collect::<Vec<_>>());
        assert_ne!(first(3, 0), first(3, 16));
        assert_ne!(first(3, 0), first(4, 0));
    }

    #[test]
    fn a_sequence_that_ends_is_followed_by_another() {
        let last = Numbers::of_pixel(1, 3, SEQUENCE * STREAMS as u64).draw();
        assert_ne!(last, Numbers::of_pixel(1, 3, 0).draw());
    }

    #[test]
    fn numbers_do_not_end() {
        let mut numbers = Numbers::new(7, 5);
        let sum: f64 = (0..1000).flat_map(|_| numbers.draw()).inspect(|u| assert!((0.0..1.0).contains(u))).sum();
        assert!((sum / 4000.0 - 0.5).abs() < 0.02);
    }
}
