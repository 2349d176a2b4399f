//! The numbers in [0, 1) that a path draws.

use radiosity_core::{mix, uniform};
use sobol_burley::{NUM_DIMENSION_SETS_4D, sample_4d};

/// Points of a round: a power of two, so that a round is a whole net.
pub const ROUND: u32 = 16;

/// The numbers of one path, four at a time.
///
/// The paths of a pixel come in rounds of [`ROUND`], each a Sobol sequence scrambled anew (Owen 1995; Burley 2020): evenly spread within a round,
/// independent between rounds, so that rounds tell their own variance. Beyond 256 numbers they are independent.
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
        let round = sample / u64::from(ROUND);
        Self::new(mix(seed ^ mix(pixel ^ mix(round))), (sample % u64::from(ROUND)) as u32)
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

    /// Of 16 points of a net every sixteenth of the first coordinate has one, in each round, and rounds differ.
    #[test]
    fn a_round_is_spread_evenly_and_rounds_differ() {
        let first = |pixel: u64, sample: u64| Numbers::of_pixel(1, pixel, sample).draw()[0];
        let mut sixteenths: Vec<u32> = (0..16).map(|k| (16.0 * first(3, k)) as u32).collect();
        sixteenths.sort_unstable();
        assert_eq!(sixteenths, (0..16).collect::<Vec<_>>());
        assert_ne!(first(3, 0), first(3, 16));
        assert_ne!(first(3, 0), first(4, 0));
    }

    #[test]
    fn numbers_do_not_end() {
        let mut numbers = Numbers::new(7, 5);
        let sum: f64 = (0..1000).flat_map(|_| numbers.draw()).inspect(|u| assert!((0.0..1.0).contains(u))).sum();
        assert!((sum / 4000.0 - 0.5).abs() < 0.02);
    }
}
