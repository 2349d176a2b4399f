//! Specular radiosity: a radiance for every element *and direction*, so that mirrors and gloss are part of the system (Immel, Cohen, Greenberg 1986).
//!
//! ```text
//! L_i(ω) = E_i/π + ρ_i H_i/π + Σ_k f_i(ω, ω_k) Ω⊥_k L_i,k,      H_i = Σ_k Ω⊥_k L_i,k,      L_i,k = mean of L_j(i,ω′)(−ω′) over ω′ in bin k
//! ```
//!
//! with j(i, ω′) the element that is seen from i in direction ω′. There are three parts: bins of directions ([`DirectionBins`]), what is seen in them (`visibility.rs`), and what surfaces
//! do with it (`scattering.rs`). Nothing of n·K × n·K is ever held. L is found by Jacobi's iteration: all elements gather, all scatter. It stands
//! apart from [`radiosity_core::System`], whose unknowns have no directions; a picture from anywhere is a look-up ([`SpecularSolution::expose`]).
//!
//! **Unknowns.** K for an element whose surface has a specular part, one for all others, which send the same into all directions. The paper keeps K for all; what is
//! measured here is the method at its best.
//!
//! **Errors.** Light that leaves in a bin is the mean over the element and over the bin, of solid angle 2π/K: what a mirror shows is blurred by about √(2π/K) in direction
//! and by the element's size, so pictures err like K^(−1/2) where they are smooth and like K^(−1/4) in rms over edges, and irradiance less, since it averages both over
//! bins. Lobes wider than a bin suffer less. Both blurs must fall together. Noise of rays comes on top. Energy and reciprocity hold bin by bin to rounding.
//!
//! **Convergence.** Sums of rows are ρ + a with a the directional albedo of a bin, so every sweep leaves at most that share q of the largest error:
//!
//! ```text
//! max |L* − L| ≤ max |r| q/(1 − q),      r what the last sweep changed
//! ```
//!
//! in the system that its rays make. The test of this page is `tests/specular_radiosity.rs`: a room whose mirror is a hole into its image, furnaces, the path tracer.
//!
//! What is *not* here: refraction, since nothing is seen through a surface; bins finer where light is concentrated, which later methods have for this one's cost.

mod bins;
mod scattering;
mod visibility;

use std::f64::consts::PI;
use std::time::Instant;

use glam::DVec3;
use radiosity_core::{BandValues, Cost, Outcome};
use radiosity_geometry::{Hit, Specular};
use radiosity_render::brdf::of_specular;
use radiosity_render::{Camera, Film, Stage};
use rayon::prelude::*;

pub use self::bins::DirectionBins;
use self::scattering::{Scattering, Turned, TurnedBins};
use self::visibility::{Frames, Visibility};
use crate::predict::Bytes;
use crate::{Geometry, Phase};

/// A run has lost its way if η is so many times what it once was.
const GROWN: f64 = 1e3;

/// Settings of specular radiosity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpecularRadiosity {
    /// Bins of directions.
    pub directions: DirectionBins,
    /// Rays of a bin along each of its edges: their square is cast.
    pub rays: u32,
    /// The iteration ends when η = Σ A_i ∫ |r_i| cosθ dω / Σ A_i E_i of the worst band, r what a sweep changes, is at most this.
    pub unshot: f64,
    /// Sweeps at most.
    pub steps: u64,
    /// Seed of the rays.
    pub seed: u64,
    /// Bytes that may be taken; more is refused before any ray is cast.
    pub memory: Option<u64>,
}

impl SpecularRadiosity {
    /// `edge` × `edge` bins with `rays` × `rays` rays each, to η = 10⁻⁶ in at most 1,000 sweeps.
    pub fn new(edge: u32, rays: u32) -> Self {
        Self { directions: DirectionBins::new(edge), rays, unshot: 1e-6, steps: 1_000, seed: 1, memory: None }
    }
}

/// Why specular radiosity cannot be had.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SpecularRadiosityError {
    /// Something is seen through a surface.
    #[error(
        "material '{material}' lets light through, which bins of directions over one side of a surface cannot hold"
    )]
    Transparent {
        /// Name of the material.
        material: String,
    },
    /// No rays.
    #[error("specular radiosity needs 1 to {most} rays along the edge of a bin of {edge} × {edge}, got {rays}")]
    Rays {
        /// The number given.
        rays: u32,
        /// Bins along an edge.
        edge: u32,
        /// The most there can be.
        most: u32,
    },
    /// The run would take more memory than it may.
    #[error("{elements} elements × {directions} directions take about {} of memory, and there are {}", Bytes(*.needed), Bytes(*.limit))]
    Memory {
        /// Elements.
        elements: u64,
        /// Directions of each.
        directions: u64,
        /// Bytes predicted.
        needed: u64,
        /// Bytes allowed.
        limit: u64,
    },
    /// More unknowns than the table can name.
    #[error("{unknowns} radiances are more than 32 bits can number")]
    Unknowns {
        /// Their number.
        unknowns: u64,
    },
}

/// How many of everything a run has, before it is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpecularSize {
    /// Elements.
    pub elements: u64,
    /// Elements with a specular part.
    pub specular: u64,
    /// Directions of each.
    pub directions: u64,
    /// Radiances to be found, a band.
    pub unknowns: u64,
    /// Rays.
    pub rays: u64,
    /// Bytes of what is seen, of what surfaces do, at most, and of two iterates.
    pub bytes: u64,
}

impl SpecularSize {
    /// Of `settings` on a mesh.
    pub fn of(geometry: &Geometry<'_>, settings: &SpecularRadiosity) -> Self {
        let scene = geometry.scene();
        let is_specular = |s: u32| scene.materials[scene.surfaces[s as usize].material].specular.is_some();
        let specular = geometry.surfaces().into_iter().filter(|&s| is_specular(s)).count() as u64;
        let (elements, bands, bins) = (geometry.elements().len() as u64, scene.bands(), settings.directions);
        let directions = bins.count() as u64;
        let unknowns = elements + specular * directions;
        let rays_each = directions.saturating_mul(u64::from(settings.rays).pow(2));
        let kinds = scene.materials.iter().filter(|material| material.specular.is_some()).count() as u64;
        let width = (size_of::<f64>() * bands) as u64;
        let bytes = Visibility::bytes_of(elements, rays_each)
            .saturating_add(kinds.saturating_mul(Scattering::most_bytes(bins, bands)))
            .saturating_add((2 * unknowns).saturating_mul(width));
        Self { elements, specular, directions, unknowns, rays: elements.saturating_mul(rays_each), bytes }
    }
}

/// Where radiances lie: the diffuse ones of all elements, then K for each element with a specular part, then a 0 for what sees nothing.
struct Slots {
    bins: DirectionBins,
    /// Of every element, its place among those with a specular part.
    block: Vec<Option<u32>>,
    /// Of every element, its piece of the scene.
    pieces: Vec<u32>,
    /// The last slot.
    nothing: u32,
}

impl Slots {
    fn new(geometry: &Geometry<'_>, bins: DirectionBins) -> Result<Self, SpecularRadiosityError> {
        let scene = geometry.scene();
        let mut specular = 0;
        let block = geometry.surfaces().into_iter().map(|s| {
            let is_specular = scene.materials[scene.surfaces[s as usize].material].specular.is_some();
            is_specular.then(|| {
                specular += 1;
                specular - 1
            })
        });
        let block: Vec<Option<u32>> = block.collect();
        let unknowns = block.len() as u64 + u64::from(specular) * bins.count() as u64;
        let nothing = u32::try_from(unknowns).map_err(|_| SpecularRadiosityError::Unknowns { unknowns })?;
        let faces = geometry.mesh().faces();
        let pieces = geometry.exposed().iter().map(|&e| faces[e as usize]).collect();
        Ok(Self { bins, block, pieces, nothing })
    }

    /// The slot of what element `e` sends into the direction `d` of its frame.
    fn of(&self, e: usize, d: impl FnOnce() -> DVec3) -> u32 {
        match self.block[e] {
            None => e as u32,
            Some(block) => (self.block.len() + block as usize * self.bins.count() + self.bins.bin(d())) as u32,
        }
    }

    /// The slot of what a ray sees.
    fn seen(&self, frames: &Frames, hit: Option<&Hit>, direction: DVec3) -> u32 {
        match hit {
            Some(hit) if hit.front && hit.owner != u32::MAX => {
                self.of(hit.owner as usize, || frames.local(hit.polygon as usize, -direction))
            }
            _ => self.nothing,
        }
    }
}

/// A scene solved with radiances into directions.
pub struct SpecularSolution<'g, 's> {
    geometry: &'g Geometry<'s>,
    frames: Frames,
    slots: Slots,
    visibility: Visibility,
    /// Slot after slot, the bands of a slot together.
    radiance: Vec<f64>,
    /// Irradiance H of the exposed elements in W/m².
    pub irradiance: BandValues,
    /// Radiosity B = E + ρH of the diffuse part of the exposed elements in W/m².
    pub radiosity: BandValues,
    /// How it ended.
    pub outcome: Outcome,
    /// Sweeps.
    pub steps: u64,
    /// η of the last sweep.
    pub unshot: f64,
    /// Largest error of any radiance in the system of these rays, where albedos are below 1.
    pub bound: Option<f64>,
    /// How many of everything there were.
    pub size: SpecularSize,
    /// Bytes of rays, of what surfaces do, and of two iterates.
    pub held_bytes: u64,
    /// Rays, and what surfaces do.
    pub form_factors: Phase,
    /// The iteration.
    pub solution: Phase,
}

/// Solves the scene of `geometry`.
///
/// # Errors
///
/// [`SpecularRadiosityError`] if something is transparent, or more memory would be taken than may be: before any ray is cast.
pub fn run_specular_radiosity<'g, 's>(
    geometry: &'g Geometry<'s>,
    settings: &SpecularRadiosity,
) -> Result<SpecularSolution<'g, 's>, SpecularRadiosityError> {
    let size = admit(geometry, settings)?;
    let (scene, bins, bands) = (geometry.scene(), settings.directions, geometry.scene().bands());
    let slots = Slots::new(geometry, bins)?;

    // What is seen, and what each kind of surface does with it.
    let clock = Instant::now();
    let frames = Frames::new(geometry);
    let visibility = Visibility::new(geometry, &frames, &slots, settings.rays, settings.seed);
    let of_material: Vec<Option<Scattering>> = scene
        .materials
        .iter()
        .map(|material| material.specular.as_ref().map(|specular| Scattering::new(bins, &*of_specular(specular))))
        .collect();
    let surfaces = geometry.surfaces();
    let material = |e: usize| scene.surfaces[surfaces[e] as usize].material;
    let form_factors = Phase { cost: visibility.cost, time: clock.elapsed() };

    // Elements by their places among those with a specular part.
    let specular: Vec<usize> = (0..surfaces.len()).filter(|&e| slots.block[e].is_some()).collect();
    let sweep = Sweep {
        slots: &slots,
        visibility: &visibility,
        specular: specular
            .iter()
            .map(|&e| (e, of_material[material(e)].as_ref().expect("it has a specular part")))
            .collect(),
        turns: TurnedBins::new(bins),
        emission: geometry.emission(),
        reflectance: geometry.reflectance(),
        areas: geometry.elements().areas(),
        projected: (0..bins.count()).map(|k| bins.projected(k)).collect(),
    };
    let clock = Instant::now();
    let solved = sweep.solve(settings, bands);
    let held = of_material.iter().flatten().map(Scattering::stored_bytes).sum::<u64>();
    let held_bytes = visibility.stored_bytes() + held + 2 * (size_of::<f64>() * solved.radiance.len()) as u64;
    let Solved { radiance, irradiance, outcome, steps, unshot, bound, cost } = solved;
    let radiosity = sweep.radiosity(&irradiance);
    let solution = Phase { cost, time: clock.elapsed() };
    Ok(SpecularSolution {
        geometry,
        frames,
        slots,
        visibility,
        radiance,
        irradiance,
        radiosity,
        outcome,
        steps,
        unshot,
        bound,
        size,
        held_bytes,
        form_factors,
        solution,
    })
}

/// Refuses what cannot be held.
fn admit(geometry: &Geometry<'_>, settings: &SpecularRadiosity) -> Result<SpecularSize, SpecularRadiosityError> {
    // Parts of bins are numbered in 32 bits, as cells of a square of at most 4096.
    let (rays, edge) = (settings.rays, settings.directions.edge());
    let most = 4096 / edge;
    if !(1..=most).contains(&rays) {
        return Err(SpecularRadiosityError::Rays { rays, edge, most });
    }
    for material in &geometry.scene().materials {
        if matches!(material.specular, Some(Specular::Dielectric { .. })) {
            return Err(SpecularRadiosityError::Transparent { material: material.name.clone() });
        }
    }
    let size = SpecularSize::of(geometry, settings);
    match settings.memory {
        Some(limit) if size.bytes > limit => {
            let SpecularSize { elements, directions, bytes, .. } = size;
            Err(SpecularRadiosityError::Memory { elements, directions, needed: bytes, limit })
        }
        _ => Ok(size),
    }
}

/// What a sweep reads.
struct Sweep<'a> {
    slots: &'a Slots,
    visibility: &'a Visibility,
    /// Elements with a specular part, and what it does.
    specular: Vec<(usize, &'a Scattering)>,
    turns: TurnedBins,
    emission: BandValues,
    reflectance: BandValues,
    areas: Vec<f64>,
    /// Ω⊥ of every bin.
    projected: Vec<f64>,
}

/// What sweeps lead to.
struct Solved {
    radiance: Vec<f64>,
    irradiance: BandValues,
    outcome: Outcome,
    steps: u64,
    unshot: f64,
    bound: Option<f64>,
    cost: Cost,
}

/// What a sweep has changed of an element: ∫ |r| cosθ dω of every band, and the largest |r|.
#[derive(Clone)]
struct Changed {
    power: Vec<f64>,
    most: f64,
}

impl Sweep<'_> {
    /// Sweeps until what they change is little.
    fn solve(&self, settings: &SpecularRadiosity, bands: usize) -> Solved {
        let m = self.areas.len();
        let mut x = vec![0.0; (self.slots.nothing as usize + 1) * bands];
        let mut next = x.clone();
        let emitted: Vec<f64> = (0..bands).map(|b| self.power(self.emission.band(b))).collect();
        let mut h = vec![0.0; m * bands];
        let (mut steps, mut least, mut cost) = (0, f64::INFINITY, Cost::default());
        let q = self.largest_sum();
        loop {
            let changed = self.step(&x, &mut next, &mut h, bands);
            std::mem::swap(&mut x, &mut next);
            steps += 1;
            cost += self.cost(bands);
            let eta = (0..bands).map(|b| {
                let power: f64 = changed.iter().zip(&self.areas).map(|(changed, area)| area * changed.power[b]).sum();
                if power == 0.0 { 0.0 } else { power / emitted[b] }
            });
            let eta = eta.fold(0.0, f64::max);
            least = eta.min(least);
            let outcome = match eta {
                _ if !eta.is_finite() => Some(Outcome::Breakdown),
                _ if eta <= settings.unshot => Some(Outcome::Converged),
                _ if eta > GROWN * least => Some(Outcome::NotContracting),
                _ if steps >= settings.steps => Some(Outcome::StepLimit),
                _ => None,
            };
            if let Some(outcome) = outcome {
                let most = changed.iter().map(|changed| changed.most).fold(0.0, f64::max);
                let bound = (q < 1.0).then(|| most * q / (1.0 - q));
                let values = (0..bands).flat_map(|b| h.iter().skip(b).step_by(bands)).copied().collect();
                let irradiance = BandValues::new(values, m);
                return Solved { radiance: x, irradiance, outcome, steps, unshot: eta, bound, cost };
            }
        }
    }

    /// B = E + ρH.
    fn radiosity(&self, irradiance: &BandValues) -> BandValues {
        let terms = self.emission.values().iter().zip(self.reflectance.values()).zip(irradiance.values());
        BandValues::new(terms.map(|((e, rho), h)| e + rho * h).collect(), self.areas.len())
    }

    fn power(&self, values: &[f64]) -> f64 {
        values.iter().zip(&self.areas).map(|(value, area)| value * area).sum()
    }

    /// Largest ρ + a.
    fn largest_sum(&self) -> f64 {
        let diffuse = self.reflectance.values().iter().copied().fold(0.0, f64::max);
        let rho = |e: usize| (0..self.reflectance.count()).map(|b| self.reflectance.band(b)[e]).fold(0.0, f64::max);
        self.specular.iter().map(|(e, scattering)| rho(*e) + scattering.largest_albedo()).fold(diffuse, f64::max)
    }

    /// What a sweep reads.
    fn cost(&self, bands: usize) -> Cost {
        let scattered: u64 = self.specular.iter().map(|(_, scattering)| scattering.entries()).sum();
        let entries = self.visibility.entries() + scattered;
        Cost { entries, flops: 2 * entries * bands as u64, ..Cost::default() }
    }

    /// All elements gather from x, and scatter into `next`; H of all goes to `h`, the bands of an element together.
    fn step(&self, x: &[f64], next: &mut [f64], h: &mut [f64], bands: usize) -> Vec<Changed> {
        let m = self.areas.len();
        let (diffuse, directed) = next.split_at_mut(m * bands);
        // The part that goes everywhere alike.
        let each = diffuse.par_chunks_mut(bands).zip(h.par_chunks_mut(bands)).enumerate();
        let mut changed: Vec<Changed> = each
            .map(|(e, (next, h))| {
                h.fill(0.0);
                for (weight, slot) in self.visibility.of(e) {
                    let seen = &x[slot as usize * bands..][..bands];
                    h.iter_mut().zip(seen).for_each(|(h, seen)| *h += weight * seen);
                }
                let mut changed = Changed { power: vec![0.0; bands], most: 0.0 };
                for b in 0..bands {
                    next[b] = (self.emission.band(b)[e] + self.reflectance.band(b)[e] * h[b]) / PI;
                    let r = (next[b] - x[e * bands + b]).abs();
                    (changed.power[b], changed.most) = (PI * r, changed.most.max(r));
                }
                changed
            })
            .collect();
        // All of what leaves surfaces with a specular part, bin by bin.
        let count = self.slots.bins.count() * bands;
        let of_specular: Vec<Changed> = directed
            .par_chunks_mut(count)
            .zip(&self.specular)
            .enumerate()
            .map_init(
                || (vec![0.0; count], Turned::default()),
                |(incoming, space), (block, (next, (e, scattering)))| {
                    self.incoming(*e, x, incoming, bands);
                    next.chunks_exact_mut(bands).for_each(|next| next.copy_from_slice(&diffuse[e * bands..][..bands]));
                    scattering.scatter(&self.turns, incoming, next, space);
                    let mut changed = Changed { power: vec![0.0; bands], most: 0.0 };
                    let before = &x[m * bands + block * count..][..count];
                    for (k, (next, before)) in next.iter().zip(before).enumerate() {
                        let r = (next - before).abs();
                        changed.power[k % bands] += r * self.projected[k / bands];
                        changed.most = changed.most.max(r);
                    }
                    changed
                },
            )
            .collect();
        self.specular.iter().zip(of_specular).for_each(|(&(e, _), of)| changed[e] = of);
        changed
    }

    /// Mean radiance that element `e` sees in every bin.
    fn incoming(&self, e: usize, x: &[f64], incoming: &mut [f64], bands: usize) {
        let (seen, weights) = self.visibility.row(e);
        let rays = seen.len() / self.projected.len();
        let bins = incoming.chunks_exact_mut(bands).zip(&self.projected);
        for ((incoming, projected), (seen, weights)) in
            bins.zip(seen.chunks_exact(rays).zip(weights.chunks_exact(rays)))
        {
            incoming.fill(0.0);
            for (slot, weight) in seen.iter().zip(weights) {
                let share = weight / projected;
                let seen = &x[*slot as usize * bands..][..bands];
                incoming.iter_mut().zip(seen).for_each(|(incoming, seen)| *incoming += share * seen);
            }
        }
    }
}

impl SpecularSolution<'_, '_> {
    /// Time of all phases but meshing, in seconds.
    pub fn seconds(&self) -> f64 {
        (self.form_factors.time + self.solution.time).as_secs_f64()
    }

    /// Counts of all phases.
    pub fn cost(&self) -> Cost {
        self.form_factors.cost + self.solution.cost
    }

    /// Radiance in W/(m² sr), one value a band, that element `e` sends into `direction`, a unit vector of the scene: that of the element and bin, the same at all their points.
    ///
    /// # Panics
    ///
    /// If there is no such element.
    pub fn radiance(&self, e: usize, direction: DVec3) -> &[f64] {
        let slot = self.slots.of(e, || self.frames.local(self.slots.pieces[e] as usize, direction));
        self.of_slot(slot)
    }

    fn of_slot(&self, slot: u32) -> &[f64] {
        let bands = self.irradiance.count();
        &self.radiance[slot as usize * bands..][..bands]
    }

    /// Form factors F_et from element `e` to all elements, as its rays have found them.
    ///
    /// # Panics
    ///
    /// If there is no such element.
    pub fn form_factors_from(&self, e: usize) -> Vec<f64> {
        let (m, count) = (self.slots.block.len(), self.slots.bins.count());
        let mut element_of_block = vec![0; m];
        self.slots.block.iter().enumerate().for_each(|(e, block)| {
            if let Some(block) = block {
                element_of_block[*block as usize] = e;
            }
        });
        let mut f = vec![0.0; m];
        for (weight, slot) in self.visibility.of(e).filter(|(_, slot)| *slot != self.slots.nothing) {
            let slot = slot as usize;
            let t = if slot < m { slot } else { element_of_block[(slot - m) / count] };
            f[t] += weight / PI;
        }
        f
    }

    /// Another round of samples of every pixel of a camera, in W/(m² sr): a look-up each. `stage` is that of the scene with [`Geometry::element_occluders`].
    pub fn expose(&self, stage: &Stage<'_>, camera: &Camera, seed: u64, film: &mut Film) {
        film.expose(seed, |[x, y], numbers, value| {
            let u = numbers.draw();
            let direction = camera.direction(f64::from(x) + u[0], f64::from(y) + u[1]);
            if let Some(place) =
                stage.first(camera.eye(), direction).filter(|place| place.front && place.owner != u32::MAX)
            {
                let radiance = self.radiance(place.owner as usize, -direction);
                value.iter_mut().zip(radiance).for_each(|(value, radiance)| *value += radiance);
            }
            Cost { rays: 1, ..Cost::default() }
        });
    }

    /// The bins, in the frame of every element: x along the first edge of its surface's piece, z its normal.
    pub fn bins(&self) -> DirectionBins {
        self.slots.bins
    }

    /// The mesh.
    pub fn geometry(&self) -> &Geometry<'_> {
        self.geometry
    }
}
