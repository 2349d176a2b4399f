//! Linear pictures with their noise, and where samples are spent.
//!
//! A pixel whose samples differ by σ needs samples in proportion to σ for the least noise of the picture: with N pixels and n samples each the mean square of the standard
//! errors is mean(σ²)/n, with n σ/mean(σ) of them (mean σ)²/n. Where few pixels make most of the noise (edges, and images of lamps in glass) that is many times less. σ
//! is known from the samples themselves, which would bias what they show: an unlucky pixel that has seen no light would get few more. So
//!
//! - samples are allotted when the number of rounds has doubled, the first time after one round a stream, and from then on begin with numbers that no round before had;
//! - what a round weighs depends on its number alone: twice as much after each allotment, since early ones know little of where the noise is. Given all that was seen
//!   before, what it adds then has the right mean.
//!
//! Variances are those of the pixel, and in equal parts of the 3 × 3 pixels around it, so that what few samples have overlooked is found beside it. Every pixel takes
//! at least one net of [`ROUND`] a round, and where σ is its mean two, up to 256. With σ of a Cornell box with a glass sphere known, samples in proportion leave an eighth of the
//! variance of even ones; these rules leave three tenths after a thousand samples a pixel (experiment 10). What is *not* here: what samples cost, which is taken as the same everywhere.

use radiosity_core::{Cost, mix};
use rayon::prelude::*;

use crate::numbers::{Numbers, ROUND, STREAMS};

/// Rounds before the first allotment: one a stream.
const FIRST: u64 = STREAMS as u64;

/// Nets that a pixel of mean σ takes in a round.
const MEAN: f64 = 2.0;

/// Most nets that a pixel takes in a round.
const MOST: f64 = 256.0;

/// Means over rounds of samples, of every pixel and band, and what streams of rounds differ by.
///
/// Rounds are dealt to [`STREAMS`] streams in turn, and a stream goes on with its own sequence: the longer it is the more evenly spread. Streams are independent, rounds
/// of a stream are not. With rounds of weight r_s and mean x̄_s in each of S streams, r in all, the standard error of the mean x̄ is √(Σ r_s (x̄_s − x̄)² / (r (S − 1))).
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// Pixels in a row.
    pub width: u32,
    /// Rows, from the top.
    pub height: u32,
    /// Bands.
    pub bands: usize,
    /// Rounds taken.
    pub rounds: u64,
    /// Samples of all pixels.
    pub samples: u64,
    /// Σ of the means of rounds times their weights: pixel after pixel, its bands together, of each the streams.
    sums: Vec<[f64; STREAMS]>,
    /// How many samples each pixel takes.
    allotment: Allotment,
    /// What the samples cost.
    pub cost: Cost,
}

/// How many nets of [`ROUND`] samples every pixel takes in a round.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Allotment {
    /// One.
    Even,
    /// So many, by the noise of the rounds before; one before there is an allotment.
    ByNoise(Vec<u16>),
}

impl Allotment {
    fn nets(&self, pixel: usize) -> u64 {
        match self {
            Self::Even => 1,
            Self::ByNoise(nets) => nets[pixel].into(),
        }
    }
}

impl Film {
    /// A film without samples; every pixel will take as many as any other.
    pub fn new(width: u32, height: u32, bands: usize) -> Self {
        Self::with(Allotment::Even, [width, height], bands)
    }

    /// A film without samples; pixels will take them where the noise is, see the module page.
    pub fn by_noise(width: u32, height: u32, bands: usize) -> Self {
        Self::with(Allotment::ByNoise(vec![1; width as usize * height as usize]), [width, height], bands)
    }

    fn with(allotment: Allotment, [width, height]: [u32; 2], bands: usize) -> Self {
        let sums = vec![[0.0; STREAMS]; width as usize * height as usize * bands];
        Self { width, height, bands, rounds: 0, samples: 0, sums, allotment, cost: Cost::default() }
    }

    /// This film, still without samples, with what [`Self::state`], [`Self::allotment`] and the public counts of another gave.
    ///
    /// # Panics
    ///
    /// If the lists do not fit.
    #[must_use]
    pub fn resume(
        self,
        [rounds, samples]: [u64; 2],
        state: Vec<[f64; STREAMS]>,
        allotment: Allotment,
        cost: Cost,
    ) -> Self {
        assert_eq!(state.len(), self.sums.len(), "state of another film");
        if let Allotment::ByNoise(nets) = &allotment {
            assert_eq!(nets.len(), self.pixels(), "allotment of another film");
        }
        Self { rounds, samples, sums: state, allotment, cost, ..self }
    }

    /// Sums over the rounds of every stream.
    pub fn state(&self) -> &[[f64; STREAMS]] {
        &self.sums
    }

    /// How many samples each pixel takes.
    pub fn allotment(&self) -> &Allotment {
        &self.allotment
    }

    fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Mean number of samples that a pixel has taken.
    pub fn samples_of_a_pixel(&self) -> f64 {
        self.samples as f64 / self.pixels().max(1) as f64
    }

    /// Takes another round: `sample(pixel, numbers, value)` adds a sample of a pixel (x, y) to `value` and says what it cost.
    pub fn expose(&mut self, seed: u64, sample: impl Fn([u32; 2], &mut Numbers, &mut [f64]) -> Cost + Sync) {
        self.allot();
        let (bands, width) = (self.bands, self.width as usize);
        let (since, weight) = (self.rounds - self.allotted_at(self.rounds), self.weight(self.rounds));
        let (seed, stream) = (self.numbers_of(seed), self.rounds % STREAMS as u64);
        let nets = |pixel: usize| self.allotment.nets(pixel);
        let row = |(y, sums): (usize, &mut [[f64; STREAMS]])| {
            let (mut cost, mut value) = (Cost::default(), vec![0.0; bands]);
            for (x, sums) in sums.chunks_exact_mut(bands).enumerate() {
                value.fill(0.0);
                let pixel = y * width + x;
                for net in 0..nets(pixel) {
                    let round = (since / STREAMS as u64 * nets(pixel) + net) * STREAMS as u64 + stream;
                    for k in 0..u64::from(ROUND) {
                        let number = round * u64::from(ROUND) + k;
                        let mut numbers = Numbers::of_pixel(seed, pixel as u64, number);
                        cost += sample([x as u32, y as u32], &mut numbers, &mut value);
                    }
                }
                let count = (nets(pixel) * u64::from(ROUND)) as f64;
                sums.iter_mut().zip(&value).for_each(|(sums, value)| sums[stream as usize] += weight * (value / count));
            }
            cost
        };
        let costs: Vec<Cost> = self.sums.par_chunks_mut(width * bands).enumerate().map(row).collect();
        let taken: u64 = (0..self.width as usize * self.height as usize).map(|pixel| self.allotment.nets(pixel)).sum();
        self.samples += taken * u64::from(ROUND);
        self.rounds += 1;
        self.cost += costs.into_iter().sum();
    }

    /// The round at which samples were allotted as they are in `round`.
    fn allotted_at(&self, round: u64) -> u64 {
        match self.allotment {
            Allotment::ByNoise(_) if round >= FIRST => FIRST << (round / FIRST).ilog2(),
            _ => 0,
        }
    }

    /// What a round counts.
    fn weight(&self, round: u64) -> f64 {
        match self.allotted_at(round) {
            0 => 1.0,
            begin => (2 * begin / FIRST) as f64,
        }
    }

    /// The seed of the numbers of this allotment.
    fn numbers_of(&self, seed: u64) -> u64 {
        match self.allotted_at(self.rounds) {
            0 => seed,
            begin => mix(seed ^ mix(begin)),
        }
    }

    /// Allots samples by the noise where that is due.
    fn allot(&mut self) {
        if self.rounds == 0 || self.allotted_at(self.rounds) != self.rounds {
            return;
        }
        let deviations = self.deviations();
        let mean = deviations.iter().sum::<f64>() / deviations.len().max(1) as f64;
        let nets = |sigma: f64| if mean > 0.0 { (MEAN * sigma / mean).round().clamp(1.0, MOST) as u16 } else { 1 };
        self.allotment = Allotment::ByNoise(deviations.into_iter().map(nets).collect());
    }

    /// By how much samples of each pixel differ, over its bands and 3 × 3 pixels around it, but for a common factor; as if all rounds had had as many as the last, which
    /// weigh most.
    fn deviations(&self) -> Vec<f64> {
        let (width, height) = (self.width as usize, self.height as usize);
        let errors = self.standard_errors();
        let variance = |(pixel, errors): (usize, &[f64])| {
            self.allotment.nets(pixel) as f64 * errors.iter().map(|e| e * e).sum::<f64>()
        };
        let variances: Vec<f64> = errors.chunks_exact(self.bands).enumerate().map(variance).collect();
        let around = |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
        let deviation = |pixel: usize| {
            let (rows, columns) = (around(pixel / width, height), around(pixel % width, width));
            let count = (rows.len() * columns.len()) as f64;
            let sum: f64 = rows.map(|y| variances[y * width..][columns.clone()].iter().sum::<f64>()).sum();
            (0.5 * (variances[pixel] + sum / count)).sqrt()
        };
        (0..variances.len()).map(deviation).collect()
    }

    /// Weights of the rounds of every stream.
    fn weights(&self) -> [f64; STREAMS] {
        std::array::from_fn(|stream| {
            // Rounds of a stream that are over, by allotments: an allotment has as many of every stream.
            let taken = |end: u64| end.saturating_sub(stream as u64).div_ceil(STREAMS as u64);
            let (mut weight, mut begin) = (0.0, 0);
            while begin < self.rounds {
                let end = match self.allotment {
                    Allotment::Even => self.rounds,
                    Allotment::ByNoise(_) => self.rounds.min(if begin == 0 { FIRST } else { begin.saturating_mul(2) }),
                };
                weight += self.weight(begin) * (taken(end) - taken(begin)) as f64;
                begin = end;
            }
            weight
        })
    }

    /// Mean values: pixel after pixel, its bands together. 0 without samples.
    pub fn means(&self) -> Vec<f64> {
        let weight = if self.rounds == 0 { 1.0 } else { self.weights().iter().sum() };
        self.sums.iter().map(|sums| sums.iter().sum::<f64>() / weight).collect()
    }

    /// Standard errors of [`Self::means`]; infinite before the second round.
    pub fn standard_errors(&self) -> Vec<f64> {
        if self.rounds < 2 {
            return vec![f64::INFINITY; self.sums.len()];
        }
        let used = self.rounds.min(STREAMS as u64) as usize;
        let weights = self.weights();
        let weight: f64 = weights.iter().sum();
        let error = |(sums, mean): (&[f64; STREAMS], f64)| {
            let squares = sums[..used].iter().zip(weights).map(|(sum, weight)| weight * (sum / weight - mean).powi(2));
            (squares.sum::<f64>() / (weight * (used - 1) as f64)).sqrt()
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
        let resumed = Film::new(7, 5, 1).resume([2, half.samples], state, half.allotment().clone(), half.cost);
        assert_eq!(expose(3, 2, resumed), whole);
    }

    /// Of 24 × 24 pixels nine in a corner see, one time in 50, a light of 50, as often as if numbers were not evenly spread; the others see 1 and hardly a difference.
    fn expose_rare_light(film: &mut Film, seed: u64, rounds: u64) {
        for _ in 0..rounds {
            film.expose(seed, |[x, y], numbers, value| {
                let u = numbers.draw();
                let sees = x < 3 && y < 3;
                value[0] +=
                    if sees { 50.0 * f64::from(u8::from((4099.0 * u[1]).fract() < 0.02)) } else { 1.0 + 1e-3 * u[0] };
                Cost { rays: 1, ..Cost::default() }
            });
        }
    }

    /// Means over 400 films: an allotment that favoured what pixels have seen would be off by many of their standard errors.
    #[test]
    fn samples_go_where_the_noise_is_and_leave_the_mean_as_it_is() {
        let (mut mean, mut square) = (0.0, 0.0);
        for seed in 0..400 {
            let mut film = Film::by_noise(24, 24, 1);
            expose_rare_light(&mut film, seed, FIRST + 2);
            assert_eq!(film.cost.rays, film.samples);
            let [quiet, noisy] = [24 * 24 - 1, 24 + 1].map(|pixel| film.allotment().nets(pixel));
            assert!(quiet == 1 && noisy > 10, "{quiet} {noisy}");
            let seen: f64 = (0..9).map(|k| film.means()[k / 3 * 24 + k % 3]).sum::<f64>() / 9.0;
            mean += seen / 400.0;
            square += seen * seen / 400.0;
        }
        let error = ((square - mean * mean) / 400.0).sqrt();
        assert!(error < 0.01 && (mean - 1.0).abs() < 3.0 * error, "{mean} ± {error}");
    }

    /// σ is 7 in nine pixels, and in seven around them that are taken for some of them: by noise these take some 70 nets a round, where the mean is 3.
    #[test]
    fn samples_by_noise_leave_less_of_it() {
        let (mut even, mut by_noise) = (Film::new(24, 24, 1), Film::by_noise(24, 24, 1));
        expose_rare_light(&mut by_noise, 5, FIRST + 16);
        expose_rare_light(&mut even, 5, by_noise.samples / (24 * 24 * u64::from(ROUND)));
        assert!(by_noise.noise() < 0.4 * even.noise(), "{} {}", by_noise.noise(), even.noise());
    }

    #[test]
    fn a_film_by_noise_goes_on_to_the_same_picture() {
        let whole = |rounds: u64, mut film: Film| {
            expose_rare_light(&mut film, 3, rounds);
            film
        };
        for begun in [2, FIRST, FIRST + 5] {
            let half = whole(begun, Film::by_noise(24, 24, 1));
            let resumed = Film::by_noise(24, 24, 1).resume(
                [half.rounds, half.samples],
                half.state().to_vec(),
                half.allotment().clone(),
                half.cost,
            );
            assert_eq!(whole(2 * FIRST + 9 - begun, resumed), whole(2 * FIRST + 9, Film::by_noise(24, 24, 1)));
        }
    }
}
