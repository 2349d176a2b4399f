//! Rows by rays: points spread over the sender, directions distributed like the cosine.
//!
//! ```text
//! A_s F_st = ∫_{A_s} ∫_Ω [first hit of (x, ω) is on t] cosθ/π dω dx ≈ A_s · (rays that hit t) / N
//! ```
//!
//! Points and directions together are a four-dimensional Owen-scrambled Sobol sequence (Owen 1995, Burley 2020) with a
//! scramble of its own for every source, mapped to area and to the cosine-weighted hemisphere in the polygon's own
//! frame; the estimate is unbiased. Its error falls like N^(−1/2) at worst and nearer N^(−3/4) for large targets; a row
//! always sums to the share of rays that hit a front, so closure says nothing about single entries. Rays that first
//! hit a back are lost: the source, or that part of it, looks into a solid.
//!
//! What is *not* here: adaptive ray counts and importance sampling of small targets.

use std::f64::consts::TAU;

use glam::DVec3;
use radiosity_core::{Cost, StoreError};
use radiosity_geometry::{Facets, Occluders, Polygon};
use rayon::prelude::*;
use sobol_burley::sample_4d;

use crate::row_wise::Receivers;
use crate::rows::{Rows, mix};

/// Longest sequence the sampler has: more rays take further, independently scrambled sequences.
const SEQUENCE: u32 = 1 << 16;
/// Rays handed to a thread at a time.
const PIECE: u32 = 1 << 12;

/// Ray-cast rows from facets to facets.
#[derive(Clone, Copy)]
pub struct RayCast<'a> {
    sources: &'a Facets,
    receivers: Receivers<'a>,
    occluders: &'a Occluders,
    rays: u32,
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
        Self { sources, receivers, occluders, rays, seed }
    }

    /// Where rays `range` of source `s` land, a count for every target.
    fn cast(&self, s: usize, range: std::ops::Range<u32>) -> Vec<u32> {
        let polygons = self.sources.polygons(s);
        let frames: Vec<(DVec3, DVec3)> = polygons.iter().map(Polygon::frame).collect();
        let area = self.sources.area(s);
        let mut counts = vec![0; self.receivers.count()];
        for k in range {
            let seed = mix(mix(self.seed ^ s as u64) ^ u64::from(k / SEQUENCE)) as u32;
            // Half a step off the lattice of single-precision samples: no point falls on the border of the sender.
            let [u, v, r, phi] = sample_4d(k % SEQUENCE, 0, seed).map(|x| f64::from(x) + 0.5 / f64::from(1 << 24));
            let (which, u) = pick(polygons, area, u);
            let (polygon, (x, y)) = (&polygons[which], frames[which]);
            let (sin_phi, cos_phi) = (TAU * phi).sin_cos();
            let direction = (x * cos_phi + y * sin_phi) * r.sqrt() + polygon.normal() * (1.0 - r).max(0.0).sqrt();
            let hit = self.occluders.first_hit(polygon.sample(u, v), direction);
            if let Some(target) = hit.filter(|hit| hit.front).and_then(|hit| self.receivers.target(hit.owner as usize))
            {
                counts[target] += 1;
            }
        }
        counts
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
        // Counts are whole numbers: any order of adding gives the same.
        let pieces: Vec<Vec<u32>> = (0..self.rays.div_ceil(PIECE))
            .into_par_iter()
            .map(|k| self.cast(s, k * PIECE..((k + 1) * PIECE).min(self.rays)))
            .collect();
        let (area, n) = (self.sources.area(s), f64::from(self.rays));
        let mut largest = 0;
        for (t, value) in values.iter_mut().enumerate() {
            let count: u32 = pieces.iter().map(|piece| piece[t]).sum();
            largest = largest.max(count);
            *value = area * f64::from(count) / n;
        }
        // Three standard errors of independent rays for the entry that varies most; stratified ones do better.
        let share = (f64::from(largest) / n).min(0.5);
        let bound = 3.0 * area * (share * (1.0 - share) / n).sqrt();
        let cost = Cost {
            form_factors: values.len() as u64,
            source_evaluations: 1,
            rays: u64::from(self.rays),
            ..Cost::default()
        };
        Ok((cost, bound))
    }
}
