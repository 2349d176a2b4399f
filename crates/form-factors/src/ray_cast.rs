//! Rows by rays: points spread over the sender, directions distributed like the cosine.
//!
//! ```text
//! A_s F_st = ∫_{A_s} ∫_Ω [first hit of (x, ω) is on t] cosθ/π dω dx ≈ A_s · (rays that hit t) / N
//! ```
//!
//! Points and directions together are one four-dimensional sequence, shifted for every row (`ray_points.rs`), mapped to area and to the
//! cosine-weighted hemisphere in the polygon's own frame; the estimate is unbiased. Its error falls like
//! N^(−1/2) at worst and nearer N^(−3/4) for large targets; a row always sums to the share of rays that hit a front, so closure
//! says nothing about single entries. Rays that first hit a back are lost: the source, or that part of it, looks into a
//! solid.
//!
//! **Error.** The rays of a row are R = 8 replicates, an eighth of the sequence each (below 64 rays there is one). With c_r of
//! the n_r rays of replicate r on target t,
//!
//! ```text
//! F = Σ c_r / N,      σ²(F) = [ Σ c_r²/n_r / N − F² ] / (R − 1)
//! ```
//!
//! estimates the variance without assuming that rays are independent, which those of a sequence are not (Owen 1997). It would be without bias
//! were the eighths independent. They complete each other, so that what they err is correlated negatively on the mean, and the estimate is
//! too large by as much: it is the variance of eight scrambled anew, which err 1.2 to 1.4 × as much as the whole. The bound
//! of a row is 4.5 σ of its worst entry (Student's t with 7 degrees of freedom covers 99.73 % there, as three standard errors of a
//! known σ do), and at least 5.9/N, below which N rays may have missed a target altogether with the same chance.
//!
//! **Adaptive rows** take rays until √(Σ_t σ²(F_st) + 1/N²) ≤ the error asked for: the standard error of the irradiance that the row
//! gathers from targets whose radiosities differ at random by 1 W/m²; 1/N stands for targets that no ray has met.
//!
//! **Draws** for methods that sample are the rays of one sequence a seed, and nothing else.
//!
//! What is *not* here: importance sampling of small targets.

use glam::DVec3;
use radiosity_core::{Cost, Drawn, Draws, LOST, StoreError};
use radiosity_geometry::occlusion::{BUNDLE, Bundle, Outlook};
use radiosity_geometry::{Facets, Hit, Occluders, Polygon};
use rayon::prelude::*;

use crate::ray_points::{Points, Spray, Square};
use crate::row_wise::Receivers;
use crate::rows::{Rows, Sampler, SparseRow, mix};

/// Most rays handed to a thread at a time: whole bundles.
const PIECE: usize = 16 * BUNDLE;
/// Replicates of a row, and the bits that number them.
const REPLICATES: usize = 1 << REPLICATE_BITS;
const REPLICATE_BITS: u32 = 3;
/// Rays from which on a row has replicates, and with which an adaptive row begins.
const FEWEST: u32 = 64;
/// Student's t with 7 degrees of freedom beyond which 0.27 % lie, either way.
const QUANTILE: f64 = 4.53;
/// Expected hits of a target that is missed with a chance of 0.27 %: −ln 0.0027.
const MISSED: f64 = 5.9145;

/// Ray-cast rows from facets to facets.
#[derive(Clone)]
pub struct RayCast<'a> {
    sources: &'a Facets,
    receivers: Receivers<'a>,
    occluders: &'a Occluders,
    points: Points,
    rays: u32,
    error: Option<f64>,
    seed: u64,
}

impl<'a> RayCast<'a> {
    /// Rows of `rays` rays each from `sources`; `occluders` must report the receivers' facets as owners: [`Occluders::of_facets`], or
    /// [`Occluders::of_parts`] where they are parts of fewer polygons.
    ///
    /// # Panics
    ///
    /// If `rays` is 0, or there are 2²⁹ receivers or more.
    pub fn new(sources: &'a Facets, receivers: Receivers<'a>, occluders: &'a Occluders, rays: u32, seed: u64) -> Self {
        assert!(rays > 0, "a row needs at least one ray");
        assert!(receivers.count() < 1 << (u32::BITS - REPLICATE_BITS), "{} receivers", receivers.count());
        Self { sources, receivers, occluders, points: Points::new(rays, seed), rays, error: None, seed }
    }

    /// Rows of as many rays as bring their standard error to `error` (see the module), doubled from 64 on; the number of rays given
    /// before becomes the most that a row takes.
    ///
    /// # Panics
    ///
    /// If `error` is not finite and positive.
    #[must_use]
    pub fn until(self, error: f64) -> Self {
        assert!(error.is_finite() && error > 0.0, "a standard error to reach must be finite and positive, got {error}");
        Self { error: Some(error), ..self }
    }

    /// Rays of source s until the rule is met, and how many.
    fn tally(&self, s: usize) -> (Tally, usize) {
        let source = Source::new(self.sources, s, self.occluders);
        let spray = Spray::new(&self.points, mix(self.seed ^ s as u64));
        let mut targets = Vec::new();
        let mut rays = if self.error.is_some() { FEWEST.min(self.rays) } else { self.rays };
        loop {
            self.extend(&mut targets, &source, &spray, rays as usize);
            let tally = Tally::new(&targets, self.receivers.count());
            match self.error {
                Some(error) if rays < self.rays && tally.standard_error() > error => {
                    rays = rays.saturating_mul(2).min(self.rays);
                }
                _ => return (tally, targets.len()),
            }
        }
    }

    /// Casts rays until there are `rays` in all.
    fn extend(&self, targets: &mut Vec<u32>, source: &Source<'_>, spray: &Spray<'_>, rays: usize) {
        let begin = targets.len();
        targets.resize(rays, LOST);
        let new = &mut targets[begin..];
        if new.len() <= PIECE {
            self.land(source, spray, begin, new);
        } else {
            let pieces = new.par_chunks_mut(PIECE).enumerate();
            pieces.for_each(|(k, found)| self.land(source, spray, begin + k * PIECE, found));
        }
    }

    /// The targets that the rays from number `first` on land on, [`LOST`] where there is none.
    fn land(&self, source: &Source<'_>, spray: &Spray<'_>, first: usize, found: &mut [u32]) {
        let (mut square, mut bundle) = (Square::default(), Bundle::default());
        for (k, found) in found.chunks_mut(BUNDLE).enumerate() {
            bundle.len = found.len();
            spray.fill(first + k * BUNDLE, &mut square, &mut bundle);
            source.cast(&square, &mut bundle, self.occluders, found);
        }
        for owner in found.iter_mut().filter(|owner| **owner != LOST) {
            *owner = self.receivers.target(*owner as usize).map_or(LOST, |t| t as u32);
        }
    }
}

/// A sender.
struct Source<'a> {
    parts: Vec<Part<'a>>,
}

/// A polygon of a sender.
struct Part<'a> {
    polygon: &'a Polygon,
    axes: [DVec3; 2],
    spread: Spread,
    outlook: Option<Outlook<'a>>,
    /// Share of the sender's area that this polygon and those before it have.
    until: f64,
}

/// How the unit square is spread evenly over a polygon.
enum Spread {
    /// A corner of a parallelogram and the edges from it.
    Parallelogram([DVec3; 3]),
    /// The triangles between the first corner and the other edges: the share of the area that they and those before them have, and the edge's
    /// ends from the first corner.
    Fan(DVec3, Vec<(f64, DVec3, DVec3)>),
}

impl<'a> Source<'a> {
    fn new(facets: &'a Facets, s: usize, occluders: &'a Occluders) -> Self {
        let mut before = 0.0;
        let part = |polygon: &'a Polygon| {
            before += polygon.area();
            Part::new(polygon, occluders, before / facets.area(s))
        };
        Self { parts: facets.polygons(s).iter().map(part).collect() }
    }

    /// The owners of the fronts that rays hit first.
    fn cast(&self, square: &Square, bundle: &mut Bundle, occluders: &Occluders, found: &mut [u32]) {
        if let [part] = &self.parts[..] {
            return part.cast(square, bundle, occluders, found);
        }
        // The first coordinate picks the polygon, and what is left of it a point there.
        let mut from = 0.0;
        let last = self.parts.len() - 1;
        for (which, part) in self.parts.iter().enumerate() {
            let (begin, end) = (from, if which == last { f64::INFINITY } else { part.until });
            let own: Vec<usize> =
                (0..found.len()).filter(|&k| (begin..end).contains(&f64::from(square.u[k]))).collect();
            let (mut points, mut rays) = (Square::default(), Bundle { len: own.len(), ..Bundle::default() });
            for (to, &k) in own.iter().enumerate() {
                let share = (f64::from(square.u[k]) - begin) / (part.until - begin);
                (points.u[to], points.v[to]) = (share.clamp(0.0, 1.0) as f32, square.v[k]);
                (0..3).for_each(|axis| rays.direction[axis][to] = bundle.direction[axis][k]);
            }
            let mut owners = vec![LOST; own.len()];
            part.cast(&points, &mut rays, occluders, &mut owners);
            own.iter().zip(owners).for_each(|(&k, owner)| found[k] = owner);
            from = part.until;
        }
    }
}

impl<'a> Part<'a> {
    fn new(polygon: &'a Polygon, occluders: &'a Occluders, until: f64) -> Self {
        let (x, y) = polygon.frame();
        Self { polygon, axes: [x, y], spread: Spread::new(polygon), outlook: occluders.outlook(polygon), until }
    }

    /// The point of the polygon that a point of the unit square stands for.
    fn point(&self, square: &Square, k: usize) -> DVec3 {
        self.spread.point(f64::from(square.u[k]), f64::from(square.v[k]))
    }

    fn cast(&self, square: &Square, bundle: &mut Bundle, occluders: &Occluders, found: &mut [u32]) {
        let Some(outlook) = &self.outlook else {
            let [x, y] = self.axes;
            let ray = |k: usize| {
                let [dx, dy, dz] = [0, 1, 2].map(|axis| f64::from(bundle.direction[axis][k]));
                (self.point(square, k), x * dx + y * dy + self.polygon.normal() * dz)
            };
            let rays: Vec<(DVec3, DVec3)> = (0..found.len()).map(ray).collect();
            let mut hits = vec![None; rays.len()];
            occluders.first_hits(&rays, &mut hits);
            let owner = |hit: Option<Hit>| hit.filter(|hit| hit.front).map_or(LOST, |hit| hit.owner);
            return found.iter_mut().zip(hits).for_each(|(found, hit)| *found = owner(hit));
        };
        let centre = self.polygon.centroid();
        for (begin, axis) in bundle.begin.iter_mut().zip(self.axes) {
            let along = |v: DVec3| (v.dot(axis) * outlook.scale()) as f32;
            match &self.spread {
                Spread::Parallelogram([corner, first, last]) => {
                    let (at, first, last) = (along(*corner - centre), along(*first), along(*last));
                    for ((begin, u), v) in begin.iter_mut().zip(&square.u).zip(&square.v) {
                        *begin = at + first * u + last * v;
                    }
                }
                Spread::Fan(..) => (0..found.len()).for_each(|k| begin[k] = along(self.point(square, k) - centre)),
            }
        }
        outlook.owners(bundle, |k| self.point(square, k), found);
    }
}

impl Spread {
    fn new(polygon: &Polygon) -> Self {
        let vertices = polygon.vertices();
        let corner = vertices[0];
        if let &[a, b, c, d] = vertices {
            // To rounding, whatever the distance from the origin: points then lie as evenly over the area.
            let gap = ((c - d) - (b - a)).length();
            if gap <= 1e-9 * (b - a).length().max((d - a).length()) {
                return Self::Parallelogram([a, b - a, d - a]);
            }
        }
        let mut before = 0.0;
        let triangle = |edge: &[DVec3]| {
            let (first, last) = (edge[0] - corner, edge[1] - corner);
            before += 0.5 * first.cross(last).length() / polygon.area();
            (before, first, last)
        };
        Self::Fan(corner, vertices[1..].windows(2).map(triangle).collect())
    }

    /// The point for (u, v): of a fan in the triangle that holds the share u, where the root keeps areas even.
    fn point(&self, u: f64, v: f64) -> DVec3 {
        match self {
            Self::Parallelogram([corner, first, last]) => *corner + *first * u + *last * v,
            Self::Fan(corner, triangles) => {
                let k = triangles.iter().position(|&(until, ..)| u < until).unwrap_or(triangles.len() - 1);
                let (until, first, last) = triangles[k];
                let before = if k == 0 { 0.0 } else { triangles[k - 1].0 };
                let r = ((u - before) / (until - before)).clamp(0.0, 1.0).sqrt();
                *corner + (first * (1.0 - v) + last * v) * r
            }
        }
    }
}

/// Where the rays of a row have landed.
struct Tally {
    /// Targets that were met, ascending: c = Σ c_r and Σ c_r²/n_r.
    met: Vec<(u32, u32, f64)>,
    rays: usize,
    replicates: usize,
}

impl Tally {
    /// Of the targets of rays in order, of which there are `count`.
    fn new(targets: &[u32], count: usize) -> Self {
        let rays = targets.len();
        let replicates = if rays < FEWEST as usize { 1 } else { REPLICATES };
        // The first ray of a replicate: all have as many, or one more.
        let first = |r: usize| r * rays / replicates;
        let mut keys = Vec::with_capacity(rays);
        for r in 0..replicates {
            let own = targets[first(r)..first(r + 1)].iter().filter(|&&t| t != LOST);
            keys.extend(own.map(|&t| t << REPLICATE_BITS | r as u32));
        }
        let keys = sorted(keys, count);
        let weights: [f64; REPLICATES] =
            std::array::from_fn(|r| if r < replicates { 1.0 / (first(r + 1) - first(r)) as f64 } else { 0.0 });
        let (mut met, mut rest) = (Vec::with_capacity(keys.len()), &keys[..]);
        while let Some(&key) = rest.first() {
            let (target, mut hits, mut squares) = (key >> REPLICATE_BITS, 0, 0.0);
            while let Some(&key) = rest.first().filter(|&&key| key >> REPLICATE_BITS == target) {
                let alike = rest.iter().take_while(|&&other| other == key).count();
                hits += alike as u32;
                squares += (alike * alike) as f64 * weights[key as usize % REPLICATES];
                rest = &rest[alike..];
            }
            met.push((target, hits, squares));
        }
        Self { met, rays, replicates }
    }

    /// σ²(F) of every target that was met; there must be replicates.
    fn variances(&self) -> impl Iterator<Item = f64> + '_ {
        let (n, others) = (self.rays as f64, self.replicates as f64 - 1.0);
        self.met.iter().map(move |&(_, hits, squares)| {
            let f = f64::from(hits) / n;
            // Rounding may leave a little less than 0.
            ((squares / n - f * f) / others).max(0.0)
        })
    }

    /// Variance of any share of independent rays, at most.
    fn independent(&self) -> f64 {
        0.25 / self.rays as f64
    }

    /// √(Σ_t σ²(F_st) + 1/N²), or what independent rays have at most if there are no replicates.
    fn standard_error(&self) -> f64 {
        let sum = if self.replicates > 1 { self.variances().sum() } else { self.independent() };
        (sum + (self.rays as f64).powi(-2)).sqrt()
    }

    /// Bound of the error of every F.
    fn bound(&self) -> f64 {
        let sampled = if self.replicates > 1 {
            QUANTILE * self.variances().fold(0.0, f64::max).sqrt()
        } else {
            3.0 * self.independent().sqrt()
        };
        sampled.max(MISSED / self.rays as f64)
    }
}

/// Keys in ascending order, digit after digit: those of one target are in order before.
fn sorted(mut keys: Vec<u32>, targets: usize) -> Vec<u32> {
    const DIGIT: u32 = 8;
    let digits = (usize::BITS - targets.leading_zeros()).div_ceil(DIGIT);
    let mut spare = vec![0; keys.len()];
    for digit in 0..digits {
        let place = |key: u32| (key >> (REPLICATE_BITS + digit * DIGIT)) as usize % (1 << DIGIT);
        let mut ends = [0_u32; 1 << DIGIT];
        keys.iter().for_each(|&key| ends[place(key)] += 1);
        let mut begin = 0;
        ends.iter_mut().for_each(|end| begin += std::mem::replace(end, begin));
        for &key in &keys {
            let next = &mut ends[place(key)];
            spare[*next as usize] = key;
            *next += 1;
        }
        std::mem::swap(&mut keys, &mut spare);
    }
    keys
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
        let mut row = SparseRow::default();
        let spent = self.sparse_row(s, &mut row)?;
        row.spread(values);
        Ok(spent)
    }

    fn sparse_row(&self, s: usize, row: &mut SparseRow) -> Result<(Cost, f64), StoreError> {
        row.entries.clear();
        if self.sources.covered(s) {
            return Ok((Cost::default(), 0.0));
        }
        let (tally, rays) = self.tally(s);
        let area = self.sources.area(s);
        let entry = |&(t, hits, _): &(u32, u32, f64)| (t, area * f64::from(hits) / rays as f64);
        row.entries.extend(tally.met.iter().map(entry));
        let form_factors = self.targets() as u64;
        let cost = Cost { form_factors, source_evaluations: 1, rays: rays as u64, ..Cost::default() };
        Ok((cost, area * tally.bound()))
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
        let source = Source::new(self.sources, s, self.occluders);
        let mut rays = 0;
        for Draws { seed, targets } in draws {
            targets.fill(LOST);
            self.land(&source, &Spray::new(&self.points, mix(self.seed ^ *seed)), 0, targets);
            rays += targets.len() as u64;
        }
        Drawn { exchange, cost: Cost { rays, ..Cost::default() } }
    }
}
