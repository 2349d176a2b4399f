//! Rows by rays: points spread over the sender, directions distributed like the cosine.
//!
//! ```text
//! A_s F_st = ∫_{A_s} ∫_Ω [first hit of (x, ω) is on t] cosθ/π dω dx ≈ A_s · (rays that hit t) / N
//! ```
//!
//! Points and directions together are four-dimensional Owen-scrambled Sobol sequences (Owen 1995, Burley 2020), mapped to
//! area and to the cosine-weighted hemisphere in the polygon's own frame; the estimate is unbiased. Its error falls like
//! N^(−1/2) at worst and nearer N^(−3/4) for large targets; a row always sums to the share of rays that hit a front, so closure
//! says nothing about single entries. Rays that first hit a back are lost: the source, or that part of it, looks into a
//! solid.
//!
//! **Error.** The rays of a row are R = 8 replicates, each the same sequence scrambled anew (below 64 rays there is one). With c_r of
//! the n_r rays of replicate r on target t,
//!
//! ```text
//! F = Σ c_r / N,      σ²(F) = [ Σ c_r²/n_r / N − F² ] / (R − 1)
//! ```
//!
//! estimates the variance without assuming that rays are independent, which those of a sequence are not (Owen 1997). Eight replicates
//! err 1.2 to 1.4 × as much as one sequence of as many rays (256 to 16,384, between the 4 × 4 elements of a cube's faces). The bound
//! of a row is 4.5 σ of its worst entry (Student's t with 7 degrees of freedom covers 99.73 % there, as three standard errors of a
//! known σ do), and at least 5.9/N, below which N rays may have missed a target altogether with the same chance.
//!
//! **Adaptive rows** take rays until √(Σ_t σ²(F_st) + 1/N²) ≤ the error asked for: the standard error of the irradiance that the row
//! gathers from targets whose radiosities differ at random by 1 W/m²; 1/N stands for targets that no ray has met.
//!
//! **Draws** for methods that sample are the rays of one sequence a seed, and nothing else.
//!
//! What is *not* here: importance sampling of small targets.

use std::f64::consts::TAU;
use std::ops::Range;

use glam::DVec3;
use radiosity_core::{Cost, Drawn, Draws, LOST, StoreError};
use radiosity_geometry::{Facets, Hit, Occluders, Polygon};
use rayon::prelude::*;
use sobol_burley::sample_4d;

use crate::row_wise::Receivers;
use crate::rows::{Rows, Sampler, mix};

/// Longest sequence the sampler has: more rays take further, independently scrambled sequences.
const SEQUENCE: u32 = 1 << 16;
/// Most rays handed to a thread at a time.
const PIECE: u32 = 1 << 12;
/// Replicates of a row.
const REPLICATES: u32 = 8;
/// Rays from which on a row has replicates, and with which an adaptive row begins.
const FEWEST: u32 = 64;
/// Student's t with 7 degrees of freedom beyond which 0.27 % lie, either way.
const QUANTILE: f64 = 4.53;
/// Expected hits of a target that is missed with a chance of 0.27 %: −ln 0.0027.
const MISSED: f64 = 5.9145;

/// Ray-cast rows from facets to facets.
#[derive(Clone, Copy)]
pub struct RayCast<'a> {
    sources: &'a Facets,
    receivers: Receivers<'a>,
    occluders: &'a Occluders,
    rays: u32,
    error: Option<f64>,
    seed: u64,
}

impl<'a> RayCast<'a> {
    /// Rows of `rays` rays each from `sources`; `occluders` must have been built of the receivers' facets.
    ///
    /// # Panics
    ///
    /// If `rays` is 0.
    pub fn new(sources: &'a Facets, receivers: Receivers<'a>, occluders: &'a Occluders, rays: u32, seed: u64) -> Self {
        assert!(rays > 0, "a row needs at least one ray");
        Self { sources, receivers, occluders, rays, error: None, seed }
    }

    /// Rows of as many rays as bring their standard error to `error` (see the module), doubled from 64 on; the number of rays given
    /// before becomes the most that a row takes.
    ///
    /// # Panics
    ///
    /// If `error` is not finite and positive.
    pub fn until(self, error: f64) -> Self {
        assert!(error.is_finite() && error > 0.0, "a standard error to reach must be finite and positive, got {error}");
        Self { error: Some(error), ..self }
    }

    /// Rays of source s until the rule is met.
    fn landed(&self, s: usize) -> Landed {
        let source = Source::new(self.sources, s);
        let seed = mix(self.seed ^ s as u64);
        let mut landed = Landed::new(self.receivers.count(), if self.rays < FEWEST { 1 } else { REPLICATES });
        let mut rays = if self.error.is_some() { FEWEST.min(self.rays) } else { self.rays };
        loop {
            self.extend(&mut landed, &source, seed, rays);
            landed.count();
            match self.error {
                Some(error) if rays < self.rays && landed.standard_error() > error => {
                    rays = rays.saturating_mul(2).min(self.rays);
                }
                _ => return landed,
            }
        }
    }

    /// Continues every replicate until there are `rays` rays in all.
    fn extend(&self, landed: &mut Landed, source: &Source<'_>, seed: u64, rays: u32) {
        let replicates = landed.targets.len() as u32;
        let mut pieces = Vec::new();
        for (r, targets) in (0..).zip(&landed.targets) {
            // The first ones take what does not divide.
            let (begin, end) = (targets.len() as u32, rays / replicates + u32::from(r < rays % replicates));
            pieces.extend((begin..end).step_by(PIECE as usize).map(|k| (r, k..end.min(k + PIECE))));
        }
        let cast = |(r, range): &(u32, Range<u32>)| self.cast(source, mix(seed ^ u64::from(*r) << 32), range.clone());
        let found: Vec<Vec<u32>> = pieces.par_iter().map(cast).collect();
        for ((r, _), found) in pieces.iter().zip(found) {
            landed.targets[*r as usize].extend(found);
        }
    }

    /// The targets that some rays of a sequence land on.
    fn cast(&self, source: &Source<'_>, seed: u64, range: Range<u32>) -> Vec<u32> {
        let rays: Vec<_> = range.map(|k| source.nth_ray(k, seed)).collect();
        self.land(&rays)
    }

    /// The targets that rays land on, [`LOST`] where there is none.
    fn land(&self, rays: &[(DVec3, DVec3)]) -> Vec<u32> {
        let mut hits = vec![None; rays.len()];
        self.occluders.first_hits(rays, &mut hits);
        let target = |hit: Option<Hit>| self.receivers.target(hit.filter(|hit| hit.front)?.owner as usize);
        hits.into_iter().map(|hit| target(hit).map_or(LOST, |t| t as u32)).collect()
    }
}

/// A sender with the frames of its polygons.
struct Source<'a> {
    polygons: &'a [Polygon],
    frames: Vec<(DVec3, DVec3)>,
    area: f64,
}

impl<'a> Source<'a> {
    fn new(facets: &'a Facets, s: usize) -> Self {
        let polygons = facets.polygons(s);
        Self { polygons, frames: polygons.iter().map(Polygon::frame).collect(), area: facets.area(s) }
    }

    /// Ray k of the sequence of a seed.
    fn nth_ray(&self, k: u32, seed: u64) -> (DVec3, DVec3) {
        let seed = mix(seed ^ u64::from(k / SEQUENCE)) as u32;
        self.ray(sample_4d(k % SEQUENCE, 0, seed))
    }

    /// The ray that a point of the unit cube stands for.
    fn ray(&self, point: [f32; 4]) -> (DVec3, DVec3) {
        // Half a step off the lattice of single-precision samples: no point falls on the border of the sender.
        let [u, v, r, phi] = point.map(|x| f64::from(x) + 0.5 / f64::from(1 << 24));
        let (which, u) = pick(self.polygons, self.area, u);
        let (polygon, (x, y)) = (&self.polygons[which], self.frames[which]);
        let (sin_phi, cos_phi) = (TAU * phi).sin_cos();
        let direction = (x * cos_phi + y * sin_phi) * r.sqrt() + polygon.normal() * (1.0 - r).max(0.0).sqrt();
        (polygon.sample(u, v), direction)
    }
}

/// The polygon that holds the share `u` of the whole `area`, and the share within it.
fn pick(polygons: &[Polygon], area: f64, u: f64) -> (usize, f64) {
    let mut before = 0.0;
    let last = polygons.len() - 1;
    for (k, polygon) in polygons.iter().enumerate() {
        let share = polygon.area() / area;
        if u < before + share || k == last {
            return (k, ((u - before) / share).clamp(0.0, 1.0));
        }
        before += share;
    }
    (last, u)
}

/// Where the rays of a row have landed.
struct Landed {
    /// The target of every ray, by replicate.
    targets: Vec<Vec<u32>>,
    /// Σ c_r of every target.
    hits: Vec<u32>,
    /// Σ c_r²/n_r of every target.
    squares: Vec<f64>,
}

impl Landed {
    fn new(targets: usize, replicates: u32) -> Self {
        Self { targets: vec![Vec::new(); replicates as usize], hits: vec![0; targets], squares: vec![0.0; targets] }
    }

    /// N.
    fn rays(&self) -> usize {
        self.targets.iter().map(Vec::len).sum()
    }

    /// Counts all rays anew.
    fn count(&mut self) {
        let Self { targets, hits, squares } = self;
        hits.fill(0);
        squares.fill(0.0);
        let mut counts = vec![0_u32; hits.len()];
        for replicate in targets {
            let met = || replicate.iter().filter(|&&t| t != LOST).map(|&t| t as usize);
            met().for_each(|t| counts[t] += 1);
            for t in met() {
                let c = std::mem::take(&mut counts[t]);
                hits[t] += c;
                squares[t] += f64::from(c) * f64::from(c) / replicate.len() as f64;
            }
        }
    }

    /// σ²(F) of every target; there must be replicates.
    fn variances(&self) -> impl Iterator<Item = f64> + '_ {
        let (n, others) = (self.rays() as f64, self.targets.len() as f64 - 1.0);
        self.hits.iter().zip(&self.squares).map(move |(&c, &square)| {
            let f = f64::from(c) / n;
            // Rounding may leave a little less than 0.
            ((square / n - f * f) / others).max(0.0)
        })
    }

    /// Variance of any share of independent rays, at most.
    fn independent(&self) -> f64 {
        0.25 / self.rays() as f64
    }

    /// √(Σ_t σ²(F_st) + 1/N²), or what independent rays have at most if there are no replicates.
    fn standard_error(&self) -> f64 {
        let sum = if self.targets.len() > 1 { self.variances().sum() } else { self.independent() };
        (sum + (self.rays() as f64).powi(-2)).sqrt()
    }

    /// Bound of the error of every F.
    fn bound(&self) -> f64 {
        let sampled = if self.targets.len() > 1 {
            QUANTILE * self.variances().fold(0.0, f64::max).sqrt()
        } else {
            3.0 * self.independent().sqrt()
        };
        sampled.max(MISSED / self.rays() as f64)
    }
}

impl Rows for RayCast<'_> {
    fn name(&self) -> &'static str {
        "ray-cast"
    }

    fn sources(&self) -> usize {
        self.sources.len()
    }

    fn targets(&self) -> usize {
        self.receivers.count()
    }

    fn symmetric(&self) -> bool {
        false
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        assert_eq!(values.len(), self.targets(), "row: length");
        values.fill(0.0);
        if self.sources.covered(s) {
            return Ok((Cost::default(), 0.0));
        }
        let landed = self.landed(s);
        let (area, rays) = (self.sources.area(s), landed.rays());
        for (value, &hits) in values.iter_mut().zip(&landed.hits) {
            *value = area * f64::from(hits) / rays as f64;
        }
        let cost =
            Cost { form_factors: values.len() as u64, source_evaluations: 1, rays: rays as u64, ..Cost::default() };
        Ok((cost, area * landed.bound()))
    }

    fn sampler(&self) -> Option<&dyn Sampler> {
        Some(self)
    }
}

impl Sampler for RayCast<'_> {
    fn sample(&self, s: usize, draws: &mut [Draws<'_>]) -> Drawn {
        let exchange = self.sources.area(s);
        if self.sources.covered(s) {
            draws.iter_mut().for_each(|draws| draws.targets.fill(LOST));
            return Drawn { exchange, cost: Cost::default() };
        }
        let source = Source::new(self.sources, s);
        let sequence = |draws: &Draws<'_>| {
            let seed = mix(self.seed ^ draws.seed);
            (0..draws.targets.len() as u32).map(move |k| (k, seed))
        };
        let rays: Vec<_> = draws.iter().flat_map(sequence).map(|(k, seed)| source.nth_ray(k, seed)).collect();
        let mut landed = &self.land(&rays)[..];
        for draws in draws {
            let (own, rest) = landed.split_at(draws.targets.len());
            draws.targets.copy_from_slice(own);
            landed = rest;
        }
        Drawn { exchange, cost: Cost { rays: rays.len() as u64, ..Cost::default() } }
    }
}
