//! Linear pictures with their noise.

use radiosity_core::Cost;
use rayon::prelude::*;

use crate::numbers::{Numbers, ROUND};

/// Means over rounds of samples, one a pixel and band, and what rounds differ by.
///
/// With r rounds of mean x̄_k the standard error of their mean is √(Σ (x̄_k − x̄)² / (r (r − 1))): rounds are independent, samples of a round are not.
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
    /// Σ of the means of rounds: pixel after pixel, its bands together.
    sums: Vec<f64>,
    /// Σ of their squares.
    squares: Vec<f64>,
    /// What the samples cost.
    pub cost: Cost,
}

impl Film {
    /// A film without samples.
    pub fn new(width: u32, height: u32, bands: usize) -> Self {
        let len = width as usize * height as usize * bands;
        Self { width, height, bands, rounds: 0, sums: vec![0.0; len], squares: vec![0.0; len], cost: Cost::default() }
    }

    /// A film with what [`Self::state`] gave.
    ///
    /// # Panics
    ///
    /// If the lists do not fit.
    pub fn resume(width: u32, height: u32, bands: usize, rounds: u64, state: [Vec<f64>; 2], cost: Cost) -> Self {
        let [sums, squares] = state;
        let len = width as usize * height as usize * bands;
        assert_eq!([sums.len(), squares.len()], [len; 2], "state of another film");
        Self { width, height, bands, rounds, sums, squares, cost }
    }

    /// Sums over rounds, and of their squares.
    pub fn state(&self) -> [&[f64]; 2] {
        [&self.sums, &self.squares]
    }

    /// Takes another round: `sample(pixel, numbers, value)` adds a sample of a pixel (x, y) to `value` and says what it cost.
    pub fn expose(&mut self, seed: u64, sample: impl Fn([u32; 2], &mut Numbers, &mut [f64]) -> Cost + Sync) {
        let (bands, width, round) = (self.bands, self.width as usize, self.rounds);
        let row = width * bands;
        let rows = self.sums.par_chunks_mut(row).zip(self.squares.par_chunks_mut(row)).enumerate();
        let costs: Vec<Cost> = rows
            .map(|(y, (sums, squares))| {
                let (mut cost, mut value) = (Cost::default(), vec![0.0; bands]);
                let pixels = sums.chunks_exact_mut(bands).zip(squares.chunks_exact_mut(bands)).enumerate();
                for (x, (sums, squares)) in pixels {
                    value.fill(0.0);
                    for k in 0..u64::from(ROUND) {
                        let number = round * u64::from(ROUND) + k;
                        let mut numbers = Numbers::of_pixel(seed, (y * width + x) as u64, number);
                        cost += sample([x as u32, y as u32], &mut numbers, &mut value);
                    }
                    for ((sum, square), value) in sums.iter_mut().zip(squares).zip(&value) {
                        let mean = value / f64::from(ROUND);
                        *sum += mean;
                        *square += mean * mean;
                    }
                }
                cost
            })
            .collect();
        self.rounds += 1;
        self.cost += costs.into_iter().sum();
    }

    /// Mean values: pixel after pixel, its bands together. 0 without samples.
    pub fn means(&self) -> Vec<f64> {
        let rounds = self.rounds.max(1) as f64;
        self.sums.iter().map(|sum| sum / rounds).collect()
    }

    /// Standard errors of [`Self::means`]; infinite before the second round.
    pub fn standard_errors(&self) -> Vec<f64> {
        if self.rounds < 2 {
            return vec![f64::INFINITY; self.sums.len()];
        }
        let r = self.rounds as f64;
        let pairs = self.sums.iter().zip(&self.squares);
        pairs.map(|(sum, square)| ((square / r - (sum / r).powi(2)).max(0.0) / (r - 1.0)).sqrt()).collect()
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

    /// A sample is one number of 0 to 1; the mean is ½ within the error that is stated, which is that of rounds of 16.
    #[test]
    fn means_and_errors_are_those_of_rounds() {
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
        for k in 0..means.len() {
            let truth = [0.5, std::f64::consts::FRAC_PI_4][k % 2];
            assert!((means[k] - truth).abs() < 5.0 * errors[k], "{}", means[k]);
            assert!(errors[k] > 0.0 && errors[k] < 0.02);
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
        let state = half.state().map(<[f64]>::to_vec);
        assert_eq!(expose(3, 2, Film::resume(7, 5, 1, 2, state, half.cost)), whole);
    }
}
