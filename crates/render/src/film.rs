//! Linear pictures with their noise.

use radiosity_core::Cost;
use rayon::prelude::*;

use crate::numbers::{Numbers, ROUND, STREAMS};

/// Means over rounds of samples, one a pixel and band, and what streams of rounds differ by.
///
/// Rounds are dealt to [`STREAMS`] streams in turn, and a stream goes on with its own sequence: the longer it is the more evenly spread. Streams are independent, rounds
/// of a stream are not. With r_s rounds of mean x̄_s in each of S streams, r in all, the standard error of the mean x̄ is √(Σ r_s (x̄_s − x̄)² / (r (S − 1))).
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// Pixels in a row.
    pub width: u32,
    /// Rows, from the top.
    pub height: u32,
    /// Bands.
    pub bands: usize,
    /// Rounds taken by every pixel.
    pub rounds: u64,
    /// Σ of the means of rounds: pixel after pixel, its bands together, of each the streams.
    sums: Vec<[f64; STREAMS]>,
    /// What the samples cost.
    pub cost: Cost,
}

impl Film {
    /// A film without samples.
    pub fn new(width: u32, height: u32, bands: usize) -> Self {
        let len = width as usize * height as usize * bands;
        Self { width, height, bands, rounds: 0, sums: vec![[0.0; STREAMS]; len], cost: Cost::default() }
    }

    /// A film with what [`Self::state`] gave.
    ///
    /// # Panics
    ///
    /// If the list does not fit.
    pub fn resume(width: u32, height: u32, bands: usize, rounds: u64, state: Vec<[f64; STREAMS]>, cost: Cost) -> Self {
        assert_eq!(state.len(), width as usize * height as usize * bands, "state of another film");
        Self { width, height, bands, rounds, sums: state, cost }
    }

    /// Sums over the rounds of every stream.
    pub fn state(&self) -> &[[f64; STREAMS]] {
        &self.sums
    }

    /// Takes another round: `sample(pixel, numbers, value)` adds a sample of a pixel (x, y) to `value` and says what it cost.
    pub fn expose(&mut self, seed: u64, sample: impl Fn([u32; 2], &mut Numbers, &mut [f64]) -> Cost + Sync) {
        let (bands, width, round) = (self.bands, self.width as usize, self.rounds);
        let stream = (round % STREAMS as u64) as usize;
        let row = |(y, sums): (usize, &mut [[f64; STREAMS]])| {
            let (mut cost, mut value) = (Cost::default(), vec![0.0; bands]);
            for (x, sums) in sums.chunks_exact_mut(bands).enumerate() {
                value.fill(0.0);
                for k in 0..u64::from(ROUND) {
                    let number = round * u64::from(ROUND) + k;
                    let mut numbers = Numbers::of_pixel(seed, (y * width + x) as u64, number);
                    cost += sample([x as u32, y as u32], &mut numbers, &mut value);
                }
                sums.iter_mut().zip(&value).for_each(|(sums, value)| sums[stream] += value / f64::from(ROUND));
            }
            cost
        };
        let costs: Vec<Cost> = self.sums.par_chunks_mut(width * bands).enumerate().map(row).collect();
        self.rounds += 1;
        self.cost += costs.into_iter().sum();
    }

    /// Mean values: pixel after pixel, its bands together. 0 without samples.
    pub fn means(&self) -> Vec<f64> {
        let rounds = self.rounds.max(1) as f64;
        self.sums.iter().map(|sums| sums.iter().sum::<f64>() / rounds).collect()
    }

    /// Standard errors of [`Self::means`]; infinite before the second round.
    pub fn standard_errors(&self) -> Vec<f64> {
        if self.rounds < 2 {
            return vec![f64::INFINITY; self.sums.len()];
        }
        let (r, all) = (self.rounds as f64, STREAMS as u64);
        let used = self.rounds.min(all) as usize;
        let rounds_of = |s: usize| (self.rounds / all + u64::from((s as u64) < self.rounds % all)) as f64;
        let error = |(sums, mean): (&[f64; STREAMS], f64)| {
            let squares =
                sums[..used].iter().enumerate().map(|(s, sum)| rounds_of(s) * (sum / rounds_of(s) - mean).powi(2));
            (squares.sum::<f64>() / (r * (used - 1) as f64)).sqrt()
        };
        self.sums.iter().zip(self.means()).map(error).collect()
    }

    /// Root mean square of the standard errors over pixels and bands, relative to the mean level.
    pub fn noise(&self) -> f64 {
        let errors = self.standard_errors();
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
        let mean = self.means().iter().sum::<f64>() / errors.len() as f64;
        if rms == 0.0 { 0.0 } else { rms / mean }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sample is one number of 0 to 1 and whether two lie in a quarter of a disc. Over 15 pixels the rms deviation from the truth is what the standard errors say; both
    /// have 45 degrees of freedom or fewer, so that their ratio is 1 ± 0.2. From rounds of one stream numbers are spread ever better: 400 independent ones would leave 1.4 %.
    #[test]
    fn errors_are_what_streams_differ_by() {
        let mut film = Film::new(5, 3, 2);
        assert!(film.standard_errors().iter().all(|e| e.is_infinite()));
        for _ in 0..50 {
            film.expose(3, |_, numbers, value| {
                let u = numbers.draw();
                value[0] += u[0];
                value[1] += if u[0] * u[0] + u[1] * u[1] < 1.0 { 1.0 } else { 0.0 };
                Cost { rays: 1, ..Cost::default() }
            });
        }
        assert_eq!((film.rounds, film.cost.rays), (50, 5 * 3 * 50 * u64::from(ROUND)));
        let (means, errors) = (film.means(), film.standard_errors());
        for (band, truth) in [0.5, std::f64::consts::FRAC_PI_4].into_iter().enumerate() {
            let rms =
                |of: &dyn Fn(usize) -> f64| ((0..15).map(|k| of(2 * k + band).powi(2)).sum::<f64>() / 15.0).sqrt();
            let (off, said) = (rms(&|k| means[k] - truth), rms(&|k| errors[k]));
            assert!(off < 1.6 * said && said < 1.6 * off, "{off} {said}");
            assert!(said < 0.005, "{said}");
        }
    }

    #[test]
    fn one_thread_and_three_make_the_same_film_and_a_film_can_go_on() {
        let expose = |threads: usize, rounds: usize, mut film: Film| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            for _ in 0..rounds {
                pool.install(|| {
                    film.expose(9, |[x, _], numbers, value| {
                        value[0] += numbers.draw()[2] * f64::from(x);
                        Cost::default()
                    });
                });
            }
            film
        };
        let whole = expose(1, 4, Film::new(7, 5, 1));
        let half = expose(3, 2, Film::new(7, 5, 1));
        let state = half.state().to_vec();
        assert_eq!(expose(3, 2, Film::resume(7, 5, 1, 2, state, half.cost)), whole);
    }
}
