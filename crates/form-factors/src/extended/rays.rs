//! Extended form factors along rays.
//!
//! ```text
//! A_s F′_st ≈ A_s/N · Σ_rays Σ_{k ≥ 1} [t is where the ray arrives after k specular scatterings] · Π weights
//! ```
//!
//! Rays leave s as those of [`crate::ray_cast`] do. What they meet first is the business of F and not counted; from specular surfaces they go on, into one direction
//! each time, with the weight that it has there. Rays that carry little end at random, which keeps the mean (Arvo and Kirk 1990).
//!
//! **Error.** Unbiased. Rays are spread evenly, so small mirrors and lights seen in them are met by few of N: an entry of size F′ errs by about
//! √(F′ w / N), w the largest weight. The bound of a row is three standard errors of the worst share there can be, 1.5/√N.
//!
//! What is *not* here: caustics of small lights found from the light's side; there the second pass, or rows from patches to elements, do better.

use glam::DVec3;
use radiosity_core::{Cost, StoreError, uniform};
use radiosity_geometry::occlusion::{BUNDLE, Bundle};
use radiosity_geometry::{Facets, Hit, Occluders, Scatter};

use super::SpecularBounces;
use crate::ray_points::{Points, Spray, Square};
use crate::row_wise::Receivers;
use crate::rows::{Rows, SparseRow, mix};

/// Scatterings before a ray may end at random.
const SURE: u32 = 4;

/// What rays meet: polygons that report facets as owners, and the specular surface of each.
#[derive(Clone, Copy)]
pub struct Mirrors<'a> {
    /// Polygons of the scene, hits owned by the receivers' facets.
    pub occluders: &'a Occluders,
    /// The surface of every polygon.
    pub surface_of: &'a [u32],
    /// How surfaces scatter.
    pub scatter: &'a dyn Scatter,
}

/// Rows of F′ in one band, by rays.
pub struct SpecularRays<'a> {
    sources: &'a Facets,
    receivers: Receivers<'a>,
    mirrors: Mirrors<'a>,
    bounces: SpecularBounces,
    /// Bands of the scattering functions, and the one whose rows these are.
    band: (usize, usize),
    points: Points,
    rays: u32,
    seed: u64,
}

impl<'a> SpecularRays<'a> {
    /// Rows of `rays` rays each, in band `band.1` of `band.0`.
    ///
    /// # Panics
    ///
    /// If `rays` is 0, there is no such band, or polygons lack a surface.
    pub fn new(
        (sources, receivers): (&'a Facets, Receivers<'a>),
        mirrors: Mirrors<'a>,
        bounces: SpecularBounces,
        band: (usize, usize),
        rays: u32,
        seed: u64,
    ) -> Self {
        assert!(rays > 0, "a row needs at least one ray");
        assert!(band.1 < band.0, "band {} of {}", band.1, band.0);
        assert_eq!(mirrors.surface_of.len(), mirrors.occluders.len(), "a surface for every polygon");
        Self { sources, receivers, mirrors, bounces, band, points: Points::new(rays, seed), rays, seed }
    }

    /// Origins and directions of rays `first` and on, as many as fit a bundle.
    fn leave(&self, s: usize, spray: &Spray<'_>, first: usize, rays: &mut Vec<(DVec3, DVec3)>) {
        let len = BUNDLE.min(self.rays as usize - first);
        let (mut square, mut bundle) = (Square::default(), Bundle { len, ..Bundle::default() });
        spray.fill(first, &mut square, &mut bundle);
        let (polygons, area) = (self.sources.polygons(s), self.sources.area(s));
        for k in 0..len {
            // The first coordinate picks the polygon, and what is left of it a point there.
            let (mut u, mut which) = (f64::from(square.u[k]) * area, 0);
            while which + 1 < polygons.len() && u >= polygons[which].area() {
                u -= polygons[which].area();
                which += 1;
            }
            let polygon = &polygons[which];
            let (x, y) = polygon.frame();
            let [dx, dy, dz] = [0, 1, 2].map(|axis| f64::from(bundle.direction[axis][k]));
            let direction = x * dx + y * dy + polygon.normal() * dz;
            let u = (u / polygon.area()).clamp(0.0, 1.0);
            rays.push((polygon.sample(u, f64::from(square.v[k])), direction.normalize()));
        }
    }
}

/// A ray on its way.
struct Path {
    ray: (DVec3, DVec3),
    weight: f64,
    taken: u32,
    seed: u64,
}

impl Rows for SpecularRays<'_> {
    fn name(&self) -> &'static str {
        "specular rays"
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
        let seed = mix(self.seed ^ s as u64);
        let spray = Spray::new(&self.points, seed);
        let (mut rays, mut cost) = (Vec::new(), Cost { source_evaluations: 1, ..Cost::default() });
        let mut arrived: Vec<(u32, f64)> = Vec::new();
        for first in (0..self.rays as usize).step_by(BUNDLE) {
            rays.clear();
            self.leave(s, &spray, first, &mut rays);
            let path = |(k, &ray): (usize, &(DVec3, DVec3))| Path {
                ray,
                weight: 1.0,
                taken: 0,
                seed: mix(seed ^ mix((first + k) as u64)),
            };
            let mut paths: Vec<Path> = rays.iter().enumerate().map(path).collect();
            while !paths.is_empty() {
                cost.rays += paths.len() as u64;
                paths = self.advance(&paths, &mut arrived);
            }
        }
        // Paths of one target add up in the order they came.
        arrived.sort_by_key(|(t, _)| *t);
        let scale = self.sources.area(s) / f64::from(self.rays);
        for (t, weight) in arrived {
            match row.entries.last_mut() {
                Some(last) if last.0 == t => last.1 += weight * scale,
                _ => row.entries.push((t, weight * scale)),
            }
        }
        cost.form_factors = self.targets() as u64;
        Ok((cost, self.sources.area(s) * 1.5 / f64::from(self.rays).sqrt()))
    }
}

impl SpecularRays<'_> {
    /// Lets every path arrive, counts those that were scattered before, and gives those that go on.
    fn advance(&self, paths: &[Path], arrived: &mut Vec<(u32, f64)>) -> Vec<Path> {
        let Mirrors { occluders, surface_of, scatter } = self.mirrors;
        let rays: Vec<(DVec3, DVec3)> = paths.iter().map(|path| path.ray).collect();
        let mut hits: Vec<Option<Hit>> = vec![None; rays.len()];
        occluders.first_hits(&rays, &mut hits);
        let mut next = Vec::new();
        let mut weights = vec![1.0; self.band.0];
        for (path, hit) in paths.iter().zip(hits) {
            let Some(hit) = hit else { continue };
            if path.taken > 0 && hit.front && hit.owner != u32::MAX {
                arrived.extend(self.receivers.target(hit.owner as usize).map(|t| (t as u32, path.weight)));
            }
            let surface = surface_of[hit.polygon as usize] as usize;
            if !(self.bounces.allow(path.taken) && scatter.is_specular(surface, hit.front)) {
                continue;
            }
            let (origin, d) = path.ray;
            let normal = occluders.polygons()[hit.polygon as usize].normal();
            weights.fill(1.0);
            let u = [1, 2, 3].map(|k| uniform(path.seed ^ k));
            let Some(direction) = scatter.scatter(surface, normal, d, u, &mut weights) else { continue };
            let mut weight = path.weight * weights[self.band.1];
            if path.taken >= SURE {
                let left = weight.min(0.95);
                if uniform(path.seed ^ 4) >= left {
                    continue;
                }
                weight /= left;
            }
            if weight > 0.0 {
                let ray = (origin + d * hit.distance, direction);
                next.push(Path { ray, weight, taken: path.taken + 1, seed: mix(path.seed) });
            }
        }
        next
    }
}
