//! Stochastic Jacobi iteration: power is carried by rays, and no form factor is stored.

use radiosity_core::{
    BandValues, Bands, Cost, Direction, DrawBuf, Draws, Form, Iterate, LOST, Needs, Progress, Sampled, Solver,
    StoreError, System, mix, uniform,
};
use rayon::prelude::*;

use crate::{STOCHASTIC, fraction};

/// Stochastic Jacobi iteration: the products of [`Jacobi`](crate::Jacobi) in the shooting direction, each estimated by N rays.
///
/// To shoot y, source s gets n_s of the rays in proportion to its power, and each ray lands on t with probability F_st (or leaves the
/// scene):
///
/// ```text
/// n̄_s = N p_s / Σ p,   p_s = Σ_b A_s |y_sb| / Σ A E_b;      Ĥ_tb = (1/A_t) Σ_s A_s y_sb c_st / d_s,   d_s = n_s if n̄_s ≥ 1, else n̄_s
/// ```
///
/// with c_st of the rays of s on t. n_s is n̄_s rounded down or up at random with mean n̄_s (one comb over all sources), so E Ĥ = H(y) in
/// every band, whatever p: no power is lost by rounding where n̄_s ≥ 1, and no more than about that of one ray in all elsewhere.
///
/// ```text
/// incremental:  x₀ = 0,  r₀ = E;   x ← x + r,  r ← ρ Ĥ(r)      until what is left is small beside the standard error: B₀ = x + r
/// regular:      B_k = E + ρ Ĥ(B_{k−1}),   k = 1, 2, …          B = (B₀ + … + B_K)/(K + 1)
/// ```
///
/// Incremental steps take rays in proportion to what they shoot, N for E, so that each ray of the phase carries the same power and all
/// steps have the same relative error; regular ones take N. (L. Neumann, "Monte Carlo radiosity", Computing 55, 1995; L. Neumann, A. Neumann and
/// P. Bekaert, "Radiosity with well distributed ray sets", Computer Graphics Forum 16, 1997; P. Bekaert, *Hierarchical and stochastic
/// algorithms for radiosity*, thesis, Leuven 1999; P. Dutré, P. Bekaert and K. Bala, *Advanced Global Illumination*, 2nd ed., 2006,
/// chapter 6.)
///
/// **Bands** share the rays, which makes each n̄_s at least what band b alone would give with its share N Σ_s p_sb / Σ p of the rays, p_sb the
/// term of b in p_s: so its variance is at most that of those rays used for it alone. Bands that are lit alike lose nothing to each other.
///
/// **Error.** The rays are dealt to R = 8 replicates that run apart from the start, each on its own B_{k−1}. Their answers are independent, so
/// their spread gives the variance σ² of the mean with everything in it: the noise of a step goes on into later ones, by (I − ρF)⁻¹ in
/// the average. The mean is unbiased but for what was never shot. Estimated are, in the norm of power and relative to Σ A E of the worst band,
///
/// ```text
/// standard error = √((Σ A ρ σ(H))² + (max ρ · power of a ray/(K + 1))²),      left = Σ A|r| q/(1 − q) · min(1, 1/((1 − q)(K + 1)))
/// ```
///
/// where the second term stands for targets that no ray has met, and q is the part of the power carried by the rays of the last
/// incremental step that was reflected. Both are estimates, no bounds: σ has 7 degrees of freedom, and the size of a normal error is
/// 0.8 σ in the mean.
///
/// - *Reads*: targets drawn by [`FormFactors::sample`](radiosity_core::FormFactors::sample); the full form in the shooting direction and
///   patches → elements. A store of cast rays on demand never has a row; any other gives one row for every source that shoots.
/// - *Convergence*: σ falls like K^(−1/2) after about 1/(1 − ρ) steps, over which the errors of B_k forget the past; with N it falls like
///   N^(−1/2), and faster where a source has many rays for each of its targets, which draws of one call share more evenly than at random.
/// - *Accuracy*: no residual is known. The loop believes the estimate of the error; where rows are held it makes a last product and
///   certifies that.
/// - *Memory*: six vectors a replicate and band beside x and r, and four bytes a ray of one step.
#[derive(Clone, Debug)]
pub struct StochasticJacobi {
    seed: u64,
    rays: Option<u64>,
    replicates: Vec<Replicate>,
    /// What a band's powers are measured by: what it emits, or sends at the start if that is more.
    units: Vec<f64>,
    phase: Phase,
    /// Steps done.
    step: u64,
    /// Σ A|r| of every band.
    power: Vec<f64>,
    /// Power of every band that one ray carried in the last step of N rays, or would carry in one.
    ray: Vec<f64>,
    /// x, the mean over replicates and regular steps.
    shot: BandValues,
}

/// One of the independent runs.
#[derive(Clone, Debug)]
struct Replicate {
    /// r.
    unshot: BandValues,
    /// H of the newest step.
    irradiance: BandValues,
    /// Mean of H over B₀ and all regular steps.
    mean: BandValues,
}

#[derive(Clone, Debug, PartialEq)]
enum Phase {
    /// H of the start value is not known yet.
    Start,
    /// What is unshot is shot.
    Incremental,
    /// All is shot again; `averaged` answers so far, B₀ among them.
    Regular { averaged: u64, left: Vec<Left> },
}

/// What was never shot of a band.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Left {
    /// Σ A of all light that would still come of it.
    power: f64,
    /// Its part that is left after a reflection.
    ratio: f64,
}

/// Independent runs that share the rays.
const REPLICATES: usize = 8;
/// Rays a step for each element, if nothing else is asked for.
const RAYS: u64 = 64;
/// Sources whose rays one task casts.
const PIECE: usize = 64;
/// Part of the standard error below which what is left unshot is small.
const SMALL: f64 = 0.1;

impl Replicate {
    /// Takes the irradiance that all of B brings as one more answer, the one of number `count`.
    fn average(&mut self, irradiance: BandValues, count: u64) {
        let pairs = self.mean.values_mut().iter_mut().zip(irradiance.values());
        pairs.for_each(|(mean, h)| *mean += (h - *mean) / count as f64);
        self.irradiance = irradiance;
    }

    /// Adds the irradiance that the unshot radiosity brings, or all of the start value, and makes it unshot.
    fn accumulate(&mut self, system: &System<'_>, arrived: BandValues, start: Option<&BandValues>) {
        self.irradiance.values_mut().iter_mut().zip(arrived.values()).for_each(|(sum, h)| *sum += h);
        self.mean.clone_from(&self.irradiance);
        let r = self.unshot.values_mut().iter_mut();
        match start {
            None => {
                let reflected = arrived.values().iter().zip(system.reflectance().values());
                r.zip(reflected).for_each(|(r, (h, rho))| *r = rho * h);
            }
            Some(x) => {
                let b = system.radiosity(arrived.view());
                r.zip(b.values().iter().zip(x.values())).for_each(|(r, (b, x))| *r = b - x);
            }
        }
    }
}

impl Left {
    /// What Σ A|r| that falls by `ratio` a step leaves in all.
    fn new(unshot: f64, ratio: f64) -> Self {
        let power = if unshot == 0.0 {
            0.0
        } else if ratio < 1.0 {
            unshot * ratio / (1.0 - ratio)
        } else {
            f64::INFINITY
        };
        Self { power, ratio }
    }

    /// What is missing in the mean of so many answers, the first of which lacks all of it.
    fn after(&self, averaged: u64) -> f64 {
        // Without end if it does not fall.
        let share = if self.ratio < 1.0 { 1.0 / ((1.0 - self.ratio) * averaged as f64) } else { 1.0 };
        self.power * share.min(1.0)
    }
}

/// Σ A|x|.
fn size(system: &System<'_>, x: &[f64]) -> f64 {
    system.areas().iter().zip(x).map(|(a, x)| a * x.abs()).sum()
}

impl StochasticJacobi {
    /// 64 rays a step for each element; the same seed gives the same bytes.
    pub fn new(seed: u64) -> Self {
        let shot = BandValues::zeros(0, 0);
        let (replicates, units, power, ray) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { seed, rays: None, replicates, units, phase: Phase::Start, step: 0, power, ray, shot }
    }

    /// With N rays a step, an eighth of them a replicate.
    ///
    /// # Panics
    ///
    /// If there are fewer than 8, one a replicate.
    pub fn rays(self, rays: u64) -> Self {
        assert!(rays >= REPLICATES as u64, "a step needs a ray for each of {REPLICATES} replicates, got {rays}");
        Self { rays: Some(rays), ..self }
    }

    /// Rays of one replicate in a whole step.
    fn share(&self, system: &System<'_>) -> f64 {
        self.rays.unwrap_or(RAYS * system.elements() as u64) as f64 / REPLICATES as f64
    }

    /// Replicate r shoots `sent[r]`; `whole` is whether N rays are taken whatever is sent.
    fn shoot(&self, system: &System<'_>, sent: &[BandValues], whole: bool) -> Result<Shot, StoreError> {
        let bands = system.bands();
        let means: Vec<BandValues> = sent.iter().map(|y| system.patch_means(y.view())).collect();
        let mut arrived = vec![BandValues::zeros(bands, system.elements()); sent.len()];
        let (mut cost, mut carried) = (Cost::default(), vec![0.0; bands]);
        // Bands that share their rows share their rays.
        let tables = if system.store().properties().per_band { bands } else { 1 };
        let rays = self.share(system) / tables as f64;
        for table in 0..tables {
            let served = if tables == 1 { 0..bands } else { table..table + 1 };
            let lit: Vec<usize> = served.filter(|&b| self.units[b] > 0.0).collect();
            let seed = mix(mix(mix(self.seed) ^ self.step) ^ table as u64);
            let deal = |(r, y): (u64, &BandValues)| {
                let of_band = |s: usize, b: usize| system.patch_areas()[s] * y.band(b)[s].abs() / self.units[b];
                let powers: Vec<f64> = (0..y.len()).map(|s| lit.iter().map(|&b| of_band(s, b)).sum()).collect();
                let sent: f64 = powers.iter().sum();
                let rays = if whole { rays } else { rays * (sent / lit.len() as f64).min(1.0) };
                Deal::new(&powers, sent, rays, uniform(seed ^ mix(r)))
            };
            let deals: Vec<Deal> = (0..).zip(&means).map(deal).collect();
            let pieces = cast(system, table, seed, &deals)?;
            let rays: usize = pieces.iter().map(|piece| piece.targets.len()).sum();
            cost += pieces.iter().map(|piece| piece.cost).sum();
            cost.flops += 2 * (rays * lit.len()) as u64;
            for (&b, (deal, y)) in lit.iter().flat_map(|b| deals.iter().zip(&means).map(move |of| (b, of))) {
                carried[b] += deal.carried(system.patch_areas(), y.band(b)) / REPLICATES as f64;
            }
            arrived.par_iter_mut().enumerate().for_each(|(r, h)| land(&pieces, &deals, r, &means[r], &lit, h));
        }
        for h in &mut arrived {
            for b in 0..bands {
                h.band_mut(b).iter_mut().zip(system.areas()).for_each(|(h, area)| *h /= area);
            }
        }
        Ok(Shot { arrived, carried, cost })
    }

    /// Answers of every replicate that are averaged.
    fn averaged(&self) -> u64 {
        if let Phase::Regular { averaged, .. } = self.phase { averaged } else { 1 }
    }

    /// Mean over the replicates of H, and the standard error of A B of every band in power.
    fn mean_and_error(&self, system: &System<'_>) -> (BandValues, Vec<f64>) {
        let (bands, m, count) = (system.bands(), system.elements(), self.replicates.len() as f64);
        let mut mean = BandValues::zeros(bands, m);
        let error = |b: usize| {
            // Squares of powers may underflow, those of shares do not; a dark band has nothing to share.
            let (rho, unit) = (system.reflectance().band(b), self.units[b].max(f64::MIN_POSITIVE));
            let of_element = |(e, mean): (usize, &mut f64)| {
                let values = || self.replicates.iter().map(|replicate| replicate.mean.band(b)[e]);
                *mean = values().sum::<f64>() / count;
                let share = system.areas()[e] * rho[e] / unit;
                let spread: f64 = values().map(|h| (share * (h - *mean)).powi(2)).sum();
                (spread / (count * (count - 1.0))).sqrt()
            };
            let seen: f64 = mean.band_mut(b).iter_mut().enumerate().map(of_element).sum();
            let missed = rho.iter().copied().fold(0.0, f64::max) * self.ray[b] / unit / self.averaged() as f64;
            unit * seen.hypot(missed)
        };
        let errors = (0..bands).map(error).collect();
        (mean, errors)
    }

    /// Adds the mean of what the replicates have shot to x, with weight `1/count` against what is there if there is a count.
    fn add(&mut self, sent: &[BandValues], count: Option<u64>) {
        let replicates = sent.len() as f64;
        for (k, x) in self.shot.values_mut().iter_mut().enumerate() {
            let y = sent.iter().map(|y| y.values()[k]).sum::<f64>() / replicates;
            *x += count.map_or(y, |count| (y - *x) / count as f64);
        }
    }
}

/// What shooting gives.
#[derive(Debug)]
struct Shot {
    /// H of every replicate.
    arrived: Vec<BandValues>,
    /// Σ A|y| of every band as the rays carry it, the mean over the replicates: what was to be shot, up to the rounding of rays.
    carried: Vec<f64>,
    cost: Cost,
}

/// How many rays each source gets of a replicate.
#[derive(Debug)]
struct Deal {
    counts: Vec<u32>,
    /// d: rays that the power of a source is divided by.
    divisors: Vec<f64>,
}

impl Deal {
    /// Deals about `rays` rays in proportion to `powers`, which sum to `sent`: n_s is the number of teeth, at distance 1 from `begin` in
    /// [0, 1), on the piece of length n̄_s.
    fn new(powers: &[f64], sent: f64, rays: f64, begin: f64) -> Self {
        let (mut end, mut teeth) = (begin, 0.0_f64);
        let deal = |power: &f64| {
            let expected = if *power > 0.0 { rays * (power / sent) } else { 0.0 };
            end += expected;
            let count = end.floor() - teeth;
            teeth += count;
            (count as u32, if expected >= 1.0 { count } else { expected })
        };
        let (counts, divisors) = powers.iter().map(deal).unzip();
        Self { counts, divisors }
    }

    /// Σ A|y| n_s/d_s.
    fn carried(&self, areas: &[f64], y: &[f64]) -> f64 {
        let dealt = (0..y.len()).filter(|&s| self.counts[s] > 0);
        dealt.map(|s| areas[s] * y[s].abs() * (f64::from(self.counts[s]) / self.divisors[s])).sum()
    }
}

/// Where the rays of some sources have landed.
#[derive(Debug)]
struct Landed {
    /// Targets of the rays, source after source, replicate after replicate.
    targets: Vec<u32>,
    /// T of every source.
    exchange: Vec<f64>,
    cost: Cost,
}

/// Casts what was dealt, in pieces of sources.
fn cast(system: &System<'_>, table: usize, seed: u64, deals: &[Deal]) -> Result<Vec<Landed>, StoreError> {
    let (areas, store) = (system.patch_areas(), system.store());
    (0..areas.len().div_ceil(PIECE))
        .into_par_iter()
        .map_init(DrawBuf::default, |buf, piece| {
            let sources = piece * PIECE..((piece + 1) * PIECE).min(areas.len());
            let rays = sources.clone().map(|s| deals.iter().map(|deal| deal.counts[s] as usize).sum::<usize>());
            let mut targets = vec![LOST; rays.sum()];
            let (mut exchange, mut cost, mut rest) =
                (Vec::with_capacity(sources.len()), Cost::default(), &mut targets[..]);
            for s in sources {
                let mut draws = Vec::with_capacity(deals.len());
                for (r, deal) in (0..).zip(deals).filter(|(_, deal)| deal.counts[s] > 0) {
                    let (own, others) = rest.split_at_mut(deal.counts[s] as usize);
                    rest = others;
                    draws.push(Draws { seed: mix(mix(seed ^ s as u64) ^ r), targets: own });
                }
                let drawn = match &mut draws[..] {
                    [] => None,
                    draws => Some(store.sample(s, table, areas[s], draws, buf)?),
                };
                cost += drawn.map_or(Cost::default(), |drawn| drawn.cost);
                exchange.push(drawn.map_or(0.0, |drawn| drawn.exchange));
            }
            Ok(Landed { targets, exchange, cost })
        })
        .collect()
}

/// Adds to A H of replicate r what its rays bring from all sources, which send `y`, in the bands `lit`.
fn land(pieces: &[Landed], deals: &[Deal], r: usize, y: &BandValues, lit: &[usize], h: &mut BandValues) {
    let mut s = 0;
    for piece in pieces {
        let mut rest = &piece.targets[..];
        for exchange in &piece.exchange {
            for (other, deal) in deals.iter().enumerate() {
                let (own, others) = rest.split_at(deal.counts[s] as usize);
                rest = others;
                if other == r && !own.is_empty() {
                    for &b in lit {
                        let (each, h) = (exchange * y.band(b)[s] / deal.divisors[s], h.band_mut(b));
                        own.iter().filter(|&&t| t != LOST).for_each(|&t| h[t as usize] += each);
                    }
                }
            }
            s += 1;
        }
    }
}

/// The largest value, or NaN if there is one.
fn worst(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |worst, value| if worst.is_nan() || value <= worst { worst } else { value })
}

impl Default for StochasticJacobi {
    fn default() -> Self {
        Self::new(1)
    }
}

impl Solver for StochasticJacobi {
    fn name(&self) -> &'static str {
        STOCHASTIC
    }

    fn needs(&self) -> Needs {
        let forms = &[Form::Full, Form::PatchesToElements];
        Needs { forms, direction: Direction::Shoot, symmetric: false }
    }

    fn start(&mut self, system: &System<'_>, from: Option<Bands<'_>>) -> Result<(Iterate, Cost), StoreError> {
        let emission = system.emission().to_owned();
        let nothing = BandValues::zeros(system.bands(), system.elements());
        self.shot = from.map_or_else(|| nothing.clone(), |from| from.to_owned());
        let unit = |b: usize| system.power(system.emission().band(b)).max(size(system, self.shot.band(b)));
        self.units = (0..system.bands()).map(unit).collect();
        self.power = self.units.clone();
        self.ray = vec![0.0; system.bands()];
        let fresh = Replicate { unshot: emission.clone(), irradiance: nothing.clone(), mean: nothing };
        self.replicates = vec![fresh; REPLICATES];
        self.phase = if from.is_none() { Phase::Incremental } else { Phase::Start };
        self.step = 0;
        let residual = from.is_none().then_some(emission);
        Ok((Iterate { shot: self.shot.clone(), residual }, Cost::default()))
    }

    fn step(&mut self, system: &System<'_>, iterate: &mut Iterate) -> Result<(Progress, Cost), StoreError> {
        let sent: Vec<BandValues> = match self.phase {
            Phase::Start => vec![self.shot.clone(); REPLICATES],
            Phase::Incremental => self.replicates.iter().map(|replicate| replicate.unshot.clone()).collect(),
            Phase::Regular { .. } => {
                self.replicates.iter().map(|replicate| system.radiosity(replicate.irradiance.view())).collect()
            }
        };
        let Shot { arrived, carried, cost } = self.shoot(system, &sent, self.phase != Phase::Incremental)?;
        self.step += 1;
        let rays = self.share(system) * REPLICATES as f64;
        let of_step = if self.phase == Phase::Incremental { &self.units } else { &carried };
        self.ray = of_step.iter().map(|power| power / rays).collect();
        let bands = 0..system.bands();
        let emitted: Vec<f64> = bands.clone().map(|b| system.power(system.emission().band(b))).collect();
        // What arrived becomes the answer; what of it is new becomes unshot.
        let left: Vec<Left> = match &mut self.phase {
            Phase::Regular { averaged, left } => {
                *averaged += 1;
                let (count, left) = (*averaged, left.clone());
                self.replicates.iter_mut().zip(arrived).for_each(|(replicate, h)| replicate.average(h, count));
                self.add(&sent, Some(count));
                left
            }
            phase => {
                let first = std::mem::replace(phase, Phase::Incremental) == Phase::Start;
                for (replicate, h) in self.replicates.iter_mut().zip(arrived) {
                    replicate.accumulate(system, h, first.then_some(&self.shot));
                }
                if !first {
                    self.add(&sent, None);
                }
                let power = |b: usize| {
                    let sizes = self.replicates.iter().map(|replicate| size(system, replicate.unshot.band(b)));
                    sizes.sum::<f64>() / REPLICATES as f64
                };
                self.power = bands.clone().map(power).collect();
                // Nothing is known of how fast a first residual falls.
                let ratio = |b: usize| if first { 1.0 } else { self.power[b] / carried[b] };
                bands.clone().map(|b| Left::new(self.power[b], ratio(b))).collect()
            }
        };
        let (mean, errors) = self.mean_and_error(system);
        let small = |(left, error): (&Left, &f64)| left.power <= SMALL * error;
        if self.phase == Phase::Incremental && left.iter().zip(&errors).all(small) {
            self.phase = Phase::Regular { averaged: 1, left: left.clone() };
        }
        let averaged = self.averaged();
        let error = bands.clone().map(|b| fraction(errors[b] + left[b].after(averaged), emitted[b]));
        let unshot = bands.map(|b| fraction(self.power[b], emitted[b]));
        let progress = Progress::Sampled { error: worst(error), unshot: worst(unshot) };
        iterate.shot.clone_from(&self.shot);
        let mut residual = system.radiosity(mean.view());
        residual.values_mut().iter_mut().zip(self.shot.values()).for_each(|(r, x)| *r -= x);
        iterate.residual = Some(residual);
        Ok((progress, cost))
    }

    fn sampled(&self, system: &System<'_>) -> Option<Sampled> {
        (self.step > 0).then(|| {
            let (irradiance, errors) = self.mean_and_error(system);
            let emitted = |b: usize| system.power(system.emission().band(b));
            let standard_error = worst((0..).zip(errors).map(|(b, error)| fraction(error, emitted(b))));
            Sampled { irradiance, standard_error }
        })
    }
}
