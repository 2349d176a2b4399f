//! What a procedure will take: counts from a pilot, times a handful of constants.
//!
//! ```text
//! time = Σ_k c_k n_k,    k: elements meshed, pairs, pairs tested for blockers, points, segments, rays, entries read, rounds
//! ```
//!
//! On K elements along an edge a pilot of K₀ says, with u = K/K₀, the share i of reflected light and the edge d of what shines or blocks in units of the largest face's,
//!
//! ```text
//! adaptive, K patches     K₀ = 4: s₀ (K/4)^−p, among blockers s₀/r₀ (K/4)^−p;      K₀ = 2: i/(c + (K/x₀)^p) of dark gaps, or s₀ (1 − i)² /K of direct light
//! uniform meshes          K₀ = 4: s₀ (1 − i)^−¼ u^−p;                              K₀ = 2: s₀ (1 − i)^−¼ / (1 + (K d/x₀)^p), or gaps
//! receivers(K) = r₀ u^−1,   noise(N) = ν r₀ √i / √N,
//! partly blocked pairs ∝ m² u^−1,   points ∝ m² u^−1.45,   elements = α K² + β where contacts cut
//! ```
//!
//! shadows' edges being lines. Uniform meshes are doubled until senders, receivers (where elements are larger than report cells) and noise agree
//! with the tolerance; an adaptive run divides its error by a constant a round. Since a tolerance just met or just missed is a round more or less, the time is the
//! geometric mean of three: with the errors of the pilot, with larger and with smaller ones.
//!
//! Constants are of one machine and two threads, powers and falls of 700 runs on 76 scenes (hinges, tubes, boxes, rooms, cities) of the families of experiment 12-choice, none of which
//! but two is one of its own: nine in ten of their times lie within a factor of 2 of what is predicted. [`Constants::measured_on`] scales
//! constants to another machine. What is *not* here: counts that do not take time (vectors, the report), and memory traffic of several programs at once.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::time::Instant;

use radiosity_core::Form;
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::{MeshSettings, Subdivision};
use rayon::prelude::*;

use super::candidates::{Candidate, FEW_RAYS, Refine, Target, pairs_among};
use super::pilot::Pilot;
use crate::estimate::rows;
use crate::{Geometry, Method, RunError, Size, Store, Strategy, predict};

/// Power by which the difference of two uniform meshes falls with the edge.
const ORDER: f64 = 1.7;
/// Error of rows over report cells times the root of their rays, in units of how irradiance varies between halves of quarters of a face: of what it varies up to
/// the second value, and the share of the rest. Where everything is equally bright, it does not matter what rays meet.
const NOISE: (f64, f64, f64) = (0.47, 0.25, 0.15);
/// Variation that a pilot of two elements along an edge may overlook: times its own, at most the second value.
const OVERLOOKED: (f64, f64) = (4.0, 0.2);
/// Share of indirect light below which rows err less, exact emitters being most of the light.
const INDIRECT: f64 = 0.5;
/// By what a round divides the error of an adaptive run: where nothing blocks, where something does, and while elements do not resolve it.
const FALL: [f64; 3] = [1.8, 1.55, 1.4];
/// Elements along what shines and blocks below which they do not.
const RESOLVED: f64 = 0.6;
/// By what the first round multiplies patches, by how much more the next ones do, and the most of it: the same three. By how much more where elements are finer.
const GROWTHS: [[f64; 3]; 3] = [[1.3, 0.15, 1.65], [1.15, 0.1, 1.5], [1.02, 0.01, 1.1]];
const FINER_GROWTH: f64 = 1.2;
/// By what the first rounds divide the error of patches of finer elements.
const FIRST_FALLS: [f64; 2] = [2.6, 2.0];
/// Error by senders of the first patches, 4 along an edge, of an adaptive run and power by which it falls with their number, in units of the pilot's: where nothing blocks;
/// where something does, also in units of how irradiance varies.
const FIRST: (f64, f64) = (0.6, 2.1);
const FIRST_BLOCKED: (f64, f64) = (0.145, 2.2);
/// The same of a pilot of two elements along an edge: of reflected light, most of which dark gaps between boxes err by, in units of its share, by patches along an edge: 1/(c + (x/x₀)^p);
/// and of direct light, of two patches.
const GAPS: [f64; 3] = [6.5, 0.95, 1.75];
const DIRECT: (f64, f64) = (0.9, 1.0);
/// What uniform meshes differ by from those of half as many elements along an edge, in units of what patches of those err by in gaps.
const DIFFERENT: f64 = 0.45;
/// Difference of uniform meshes in units of the senders of such a pilot: 1/(1 + (x/x₀)^p) of x elements along what shines or blocks, with x₀ and p.
const DETAIL_OF_UNIFORM: [f64; 2] = [0.75, 2.3];
/// Factor by which errors may be larger or smaller than a pilot says, each with a third of the probability: one of two elements along an edge, and one of four.
const UNSURE: [f64; 2] = [1.25, 1.15];
/// Power of the elements by which noise falls.
const SMOOTHED: f64 = 0.35;
/// Share of the tolerance that is left for senders.
const SHARE: f64 = 0.97;
/// Elements of which entries of sparse rows take twice the time, being read from further away.
const SCATTERED: f64 = 8000.0;
/// Powers of elements and rays by which those grow that rays meet alike often.
const MET: [f64; 2] = [0.62, 0.4];
/// Growth of elements a round after the first, while they are more than patches.
const GROWTH: f64 = 1.15;
/// Sweeps of a round that starts from the answer before.
const AGAIN: f64 = 0.6;
/// Products of conjugate gradients for a sweep of Gauss and Seidel.
const PRODUCTS: f64 = 0.7;
/// Power by which points of partly blocked pairs thin out with the edge.
const POINTS: f64 = 1.45;
/// Elements that are probed in a round, at most, and rays of each: of exact rows, and of noisy ones.
const PROBES: (f64, [f64; 2]) = (128.0, [512.0, 1024.0]);
/// Time of a ray in a round of an adaptive run, in units of that of a uniform one, where nothing blocks and where something does: trees are built of new elements each time.
const OF_ROUND: [f64; 2] = [1.1, 2.1];
/// Power by which the boxes that a ray crosses grow with the polygons that may block.
const CROSSED: f64 = 0.7;
/// Time of a ray in an open scene, most of which meet nothing.
const OPEN: f64 = 0.6;
/// Error of an adaptive run, in units of the tolerance, below which noise is told.
const NEAR: f64 = 3.0;

/// Seconds a count, on all threads together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Constants {
    /// An element of a mesh, with its vectors, and its cells of the report.
    pub element: f64,
    /// An element in a round of an adaptive run: neighbours, a finer mesh to probe.
    pub estimate: f64,
    /// A pair of an element and a patch in a round of an adaptive run: what it errs by.
    pub seen: f64,
    /// A pair where nothing blocks.
    pub clear: f64,
    /// A pair that may be blocked, before it is known to face each other.
    pub culled: f64,
    /// A pair that faces each other, looked at for blockers.
    pub tested: f64,
    /// An exact emitter of a row of rays.
    pub emitter: f64,
    /// A point at which the visible part is cut out.
    pub point: f64,
    /// A segment of a partly blocked pair.
    pub segment: f64,
    /// A ray for each doubling of the elements that it may meet, and more for one polygon that may block; of B of them B^0.7 times.
    pub ray: (f64, f64),
    /// An entry read for all bands, of a full row, by Gauss and Seidel.
    pub entry: f64,
    /// The same by products.
    pub product: f64,
    /// An entry of a sparse row.
    pub sparse_entry: f64,
    /// A link made and refined.
    pub link: f64,
    /// A mesh, whatever its size.
    pub mesh: f64,
}

impl Default for Constants {
    /// Those of two cores of an AMD EPYC with AVX-512.
    fn default() -> Self {
        Self {
            element: 3.1e-6,
            estimate: 8e-6,
            seen: 5e-9,
            clear: 34e-9,
            culled: 15e-9,
            tested: 200e-9,
            emitter: 0.1e-6,
            point: 150e-9,
            segment: 0.05e-6,
            ray: (1.04e-9, 1.96e-9),
            entry: 0.4e-9,
            product: 0.1e-9,
            sparse_entry: 1.6e-9,
            link: 0.3e-6,
            mesh: 0.4e-3,
        }
    }
}

impl Constants {
    /// The default constants, times what some rows of pairs and some of rays take on `scene` on this machine as it is now, in units of what the
    /// defaults say: those of geometry and pairs by the one, of rays by the other, of the rest by the geometric mean. Counts are the same in each call, times are not.
    ///
    /// # Errors
    ///
    /// [`RunError`] if there is no mesh or a row cannot be had.
    pub fn measured_on(scene: &Scene, seed: u64) -> Result<Self, RunError> {
        let plain = Self::default();
        let pilot = Pilot::new(scene, GRID, seed)?;
        let elements = Subdivision::Uniform(pilot.cells);
        let geometry = Geometry::new(scene, &MeshSettings { elements, patches: None, contacts: true })?;
        let model = Model::new(&pilot, &plain);
        let m = geometry.elements().len();
        let ratio = |method, expected: f64| -> Result<f64, RunError> {
            let rows = rows(&geometry, method, Form::Full, seed)?;
            // Rows of few elements are computed over and over, so that it is not threads being woken that is measured.
            let count = ((CALIBRATION / expected * m as f64) as usize).max(LEAST_ROWS);
            let row = |k: usize| rows.row(k * m / count, &mut vec![0.0; m]).map(drop);
            let mut least = f64::INFINITY;
            for _ in 0..if m > 0 { REPEATS } else { 0 } {
                let clock = Instant::now();
                (0..count).into_par_iter().try_for_each(row)?;
                least = least.min(clock.elapsed().as_secs_f64());
            }
            Ok(if least.is_finite() { least * m as f64 / (count as f64 * expected) } else { 1.0 })
        };
        let cells = f64::from(pilot.cells);
        let of_pairs = ratio(pairs_among(pilot.blocking), model.pairs((m * m) as f64, cells))?;
        let of_rays =
            ratio(Method::RaysAndEmitters { rays: FEW_RAYS }, model.rays(m as f64, f64::from(FEW_RAYS), cells))?;
        let rest = (of_pairs * of_rays).sqrt();
        Ok(Self {
            element: plain.element * rest,
            estimate: plain.estimate * rest,
            seen: plain.seen * rest,
            clear: plain.clear * of_pairs,
            culled: plain.culled * of_pairs,
            tested: plain.tested * of_pairs,
            emitter: plain.emitter * of_rays,
            point: plain.point * of_pairs,
            segment: plain.segment * of_pairs,
            ray: (plain.ray.0 * of_rays, plain.ray.1 * of_rays),
            entry: plain.entry * rest,
            product: plain.product * rest,
            sparse_entry: plain.sparse_entry * rest,
            link: plain.link * of_pairs,
            mesh: plain.mesh * rest,
        })
    }
}

/// Report grid of the pilot that measurements are made on.
const GRID: u32 = 8;
/// Seconds that the rows of a measurement should take, the fewest of them, and how often they are computed: the shortest time counts.
const CALIBRATION: f64 = 0.01;
const LEAST_ROWS: usize = 8;
const REPEATS: u32 = 3;

/// What is expected of a candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Seconds.
    pub seconds: f64,
    /// Bytes of form factors held at the end.
    pub stored_bytes: u64,
    /// Bytes of the whole run where it takes most, the program not counted.
    pub peak_bytes: u64,
    /// rms error of irradiance, as the procedure will estimate it.
    pub error: f64,
    /// Elements at the end.
    pub elements: u64,
    /// Meshes on the way.
    pub rounds: u32,
}

/// A pilot and constants.
pub(super) struct Model<'p> {
    pilot: &'p Pilot,
    constants: &'p Constants,
    /// Elements of uniform meshes that were asked for, by their number along an edge.
    meshes: RefCell<BTreeMap<u32, u64>>,
}

impl<'p> Model<'p> {
    /// What follows from `pilot` by `constants`.
    pub(super) fn new(pilot: &'p Pilot, constants: &'p Constants) -> Self {
        Self { pilot, constants, meshes: RefCell::default() }
    }

    /// What was found by looking.
    pub(super) fn pilot(&self) -> &'p Pilot {
        self.pilot
    }
}

impl Model<'_> {
    /// What `candidate` will take to reach `target` on `scene`: the time is the geometric mean of those with errors that a pilot may have found too large or too small.
    pub(super) fn expect(&self, scene: &Scene, candidate: &Candidate, target: &Target) -> Result<Expected, RunError> {
        let with = |unsure: f64| match candidate.refine {
            Refine::Uniform => self.uniform(scene, &candidate.strategy, (target, unsure)),
            Refine::Adaptive { cells } => self.adaptive(scene, &candidate.strategy, cells, (target, unsure)),
        };
        let unsure = UNSURE[usize::from(self.pilot.cells > 2)];
        let middle = with(1.0)?;
        let seconds = (middle.seconds * with(unsure.recip())?.seconds * with(unsure)?.seconds).cbrt();
        Ok(Expected { seconds, ..middle })
    }

    /// Edge of the elements of the pilot over that of elements `cells` along an edge.
    fn finer(&self, cells: f64) -> f64 {
        cells / f64::from(self.pilot.cells)
    }

    /// What changes on the way from half as many elements along an edge to `cells`: the error that senders of half as many make.
    fn senders(&self, cells: f64) -> f64 {
        let pilot = self.pilot;
        // Differences of meshes have all of the reflected light that the error of one loses on its way.
        let agreeing = pilot.senders * (1.0 - pilot.indirect).max(0.05).powf(-0.25);
        match pilot.cells {
            2 => {
                let gaps = DIFFERENT * self.gaps(0.5 * cells);
                gaps.max(agreeing * resolved(0.5 * cells * pilot.detail, DETAIL_OF_UNIFORM))
            }
            _ => agreeing * self.finer(cells).powf(-ORDER),
        }
    }

    /// Error by dark gaps between boxes, and what else so many patches along an edge lose of reflected light.
    fn gaps(&self, patches: f64) -> f64 {
        let [most, along, power] = GAPS;
        self.pilot.indirect / (most + (patches / along).powf(power))
    }

    /// Error by senders that an adaptive run estimates first, of so many patches along an edge.
    fn first(&self, patches: f64) -> f64 {
        let pilot = self.pilot;
        if pilot.cells > 2 {
            let of_pilot = |(share, power): (f64, f64)| share * (patches / 4.0).powf(-power);
            return pilot.senders
                * match pilot.blocking {
                    0 => of_pilot(FIRST),
                    _ => of_pilot(FIRST_BLOCKED) / pilot.receivers.max(FIRST_BLOCKED.0),
                };
        }
        let direct = pilot.senders * (1.0 - pilot.indirect).powi(2) * DIRECT.0 * (0.5 * patches).powf(-DIRECT.1);
        self.gaps(patches).max(direct)
    }

    /// Error of rows of so many rays over report cells.
    fn noise(&self, rays: f64) -> f64 {
        let pilot = self.pilot;
        let overlooked = if pilot.cells == 2 { (OVERLOOKED.0 * pilot.receivers).min(OVERLOOKED.1) } else { 0.0 };
        let varies = pilot.receivers.max(overlooked);
        let counts = varies.min(NOISE.1) + NOISE.2 * (varies - NOISE.1).max(0.0);
        NOISE.0 * counts * (pilot.indirect / INDIRECT).min(1.0).sqrt() / rays.sqrt()
    }

    /// Elements of a uniform mesh: those of all faces, and where contacts cut or cover some α K² + β by the pilot and a mesh of twice as many along an edge.
    fn elements(&self, scene: &Scene, cells: u32) -> Result<f64, RunError> {
        let of_faces = |k: u32| -> Result<f64, RunError> {
            if let Some(&known) = self.meshes.borrow().get(&k) {
                return Ok(known as f64);
            }
            let elements = Subdivision::Uniform(k);
            let size = Size::before_meshing(scene, &MeshSettings { elements, patches: None, contacts: true })?;
            self.meshes.borrow_mut().insert(k, size.elements);
            Ok(size.elements as f64)
        };
        let (faces, coarse) = (of_faces(cells)?, self.pilot.elements as f64);
        let Some(fine) = self.pilot.twice_as_fine else {
            return Ok(faces * coarse / of_faces(self.pilot.cells)?);
        };
        let squares = (fine as f64 - coarse) / 3.0;
        Ok((squares * self.finer(f64::from(cells)).powi(2) + coarse - squares).max(1.0))
    }

    /// Seconds for `pairs` pairs between elements `cells` along an edge (of sources and targets of different sizes their geometric mean).
    fn pairs(&self, pairs: f64, cells: f64) -> f64 {
        let (c, u, (count, cost)) = (self.constants, self.finer(cells), self.pilot.drawn);
        if self.pilot.blocking == 0 {
            return pairs * c.clear;
        }
        let share = |counted: u64| counted as f64 / count.max(1) as f64;
        let facing = share(cost.clear_pairs + cost.hidden_pairs + cost.partial_pairs);
        pairs
            * (c.culled
                + facing * c.tested
                + share(cost.visibility_points) * u.powf(-POINTS) * c.point
                + share(cost.rays) / u * c.segment)
    }

    /// Seconds for `rows` rows of `rays` rays and of pairs with exact emitters, from elements `cells` along an edge.
    fn rays(&self, rows: f64, rays: f64, cells: f64) -> f64 {
        let (c, u, pilot) = (self.constants, self.finer(cells), self.pilot);
        let (drawn, cost) = pilot.to_emitters;
        let a_row = |counted: u64| (pilot.emitters * counted as usize) as f64 / drawn.max(1) as f64;
        let ray = self.ray(rows);
        let pairs = pilot.emitters as f64 * c.emitter
            + a_row(cost.visibility_points) / u * c.point
            + a_row(cost.rays) / u * ray;
        rows * (rays * ray + pairs)
    }

    /// Seconds for a ray that may meet so many elements.
    fn ray(&self, elements: f64) -> f64 {
        let (c, pilot) = (self.constants, self.pilot);
        let meets = if pilot.closed { 1.0 } else { OPEN };
        meets * (c.ray.0 * elements.max(2.0).log2() + c.ray.1 * (pilot.blocking as f64).powf(CROSSED))
    }

    /// Share of the entries that rows of so many rays to m elements could have, which is no more than one a ray or an element: rays of the pilot meet as many as if there were n of one
    /// size, n (1 − e^(−N/n)); n grows with elements and rays, by powers below 1 since near elements take most of the rays.
    fn fill(&self, m: f64, rays: f64) -> f64 {
        let met = |n: f64, rays: f64| n * (1.0 - (-rays / n).exp());
        let few = f64::from(FEW_RAYS);
        let (mut low, mut high) = (1e-3, 1e6 * few);
        for _ in 0..60 {
            let middle = (low * high).sqrt();
            if met(middle, few) < self.pilot.met { low = middle } else { high = middle }
        }
        let finer = (m / self.pilot.elements.max(1) as f64).powf(MET[0]);
        let alike = high * finer * (rays / few).powf(MET[1]);
        (met(alike, rays) / rays.min(m)).min(1.0)
    }

    /// Seconds for the rows of `method` from m elements to n patches of a uniform mesh.
    fn rows(&self, method: Method, (m, cells): (f64, f64), (n, patches): (f64, f64)) -> f64 {
        match rays_of(method) {
            Some(rays) => self.rays(m, rays, cells),
            None => self.pairs(m * n, (cells * patches).sqrt()),
        }
    }

    /// Sweeps to an unshot share: those of the pilot, in proportion to their digits.
    fn sweeps(&self, unshot: f64) -> f64 {
        self.pilot.sweeps as f64 * (unshot.ln() / 1e-4_f64.ln()).max(0.25)
    }

    fn uniform(
        &self,
        scene: &Scene,
        strategy: &Strategy,
        (target, unsure): (&Target, f64),
    ) -> Result<Expected, RunError> {
        let c = self.constants;
        let bands = self.pilot.bands as f64;
        let rays = rays_of(strategy.method);
        let (mut cells, mut seconds, mut rounds) = (2_u32, 0.0, 1);
        let mut m = self.elements(scene, cells)?;
        loop {
            let k = f64::from(cells);
            seconds += c.mesh + m * c.element + self.uniform_mesh(strategy, m, k);
            let sweeps = self.sweeps(strategy.unshot) * bands.sqrt();
            seconds += match (strategy.store, rays) {
                (Store::Hierarchical { .. }, _) => 0.0,
                // Checks and their bound read what is held twice more.
                (Store::Sparse, Some(rays)) => {
                    m * m.min(rays) * self.fill(m, rays) * (sweeps + 3.0) * c.sparse_entry * (1.0 + m / SCATTERED)
                }
                _ if strategy.solver == "cg" => m * m * (PRODUCTS * sweeps + 3.0) * c.product,
                _ => m * m * (sweeps + 3.0) * c.entry,
            };
            let report = f64::from(target.report_grid);
            let noise = rays.map_or(0.0, |rays| self.noise(rays) * 1.2 * (2.0 * report / k).min(2.0));
            let held = if k <= report { self.pilot.receivers * self.finer(k).recip() } else { 0.0 };
            let links = if let Store::Hierarchical { error, .. } = strategy.store { error } else { 0.0 };
            let error = unsure * (self.senders(k).powi(2) + held.powi(2) + noise.powi(2)).sqrt() + links;
            let next = self.elements(scene, 2 * cells)?;
            // The pilot is the difference of the first two meshes, and one alone says nothing.
            if rounds > 1 && error <= target.tolerance || next > target.most_elements as f64 {
                let size = Size {
                    mesh_elements: m as u64,
                    elements: m as u64,
                    patches: m as u64,
                    bands: self.pilot.bands as u64,
                };
                let predicted = predict(&size, strategy);
                let stored_bytes = match (strategy.store, rays) {
                    (Store::Sparse, Some(rays)) => (predicted.stored_bytes as f64 * self.fill(m, rays)) as u64,
                    _ => predicted.stored_bytes,
                };
                // A part of the rows is there twice while they are put together, at most.
                let peak_bytes = predicted.peak_bytes - (predicted.stored_bytes - stored_bytes);
                return Ok(Expected { seconds, stored_bytes, peak_bytes, error, elements: m as u64, rounds });
            }
            (cells, m, rounds) = (2 * cells, next, rounds + 1);
        }
    }

    /// Seconds for the form factors of one uniform mesh.
    fn uniform_mesh(&self, strategy: &Strategy, m: f64, cells: f64) -> f64 {
        let c = self.constants;
        match strategy.store {
            Store::Hierarchical { error, .. } => {
                // As many links as a matrix has pairs at first, and then what the error asks for.
                let links = (0.5 * m * m).min(LINKS * self.pilot.indirect * m * (error / 0.005).powf(-0.7));
                let all = self.pairs(links, f64::from(self.pilot.cells).min(cells));
                links * c.link + BOUNDED[usize::from(self.pilot.cells == 2)] * all + self.rays(m, 0.0, cells)
            }
            _ if rays_of(strategy.method).is_none() => self.pairs(0.5 * m * m, cells),
            _ => self.rows(strategy.method, (m, cells), (m, cells)) + 0.1 * m * m * c.entry,
        }
    }

    fn adaptive(
        &self,
        scene: &Scene,
        strategy: &Strategy,
        cells: u32,
        (target, unsure): (&Target, f64),
    ) -> Result<Expected, RunError> {
        let c = self.constants;
        let report = f64::from(target.report_grid);
        let (own, patches) = (f64::from(cells).max(report), f64::from(cells));
        let m = self.elements(scene, own as u32)?;
        let n = self.elements(scene, cells)?;
        let first = unsure * self.first(patches);
        let blocked = usize::from(self.pilot.blocking > 0);
        let unresolved = usize::from(blocked > 0 && own * self.pilot.detail < RESOLVED);
        let (fall, [begin, more, most]) = (FALL[blocked + unresolved], GROWTHS[blocked + unresolved]);
        let rays = rays_of(strategy.method);
        let noise = |rays: f64| unsure * self.noise(rays) * (report / own);
        let slower = OF_ROUND[blocked];
        let mut cast = rays;
        let (mut seconds, mut rounds, mut error) = (c.mesh, 0, first);
        let (mut m_now, mut n_now, mut m_before, mut n_before) = (m, n, m, n);
        // Four take the place of one that is cut.
        let kept = |before: f64, now: f64| before - (now - before) / 3.0;
        let sweeps = self.sweeps(strategy.unshot) * (self.pilot.bands as f64).sqrt();
        loop {
            let (grown, k) = (m_now / m, own * (m_now / m).sqrt());
            let column = patches * (n_now / n).sqrt();
            seconds += match cast {
                Some(rays) => slower * self.rays(m_now, rays, k),
                None => {
                    let kept = if rounds == 0 { 0.0 } else { kept(m_before, m_now) * kept(n_before, n_now) };
                    self.pairs(m_now * n_now - kept, (k * column).sqrt())
                }
            };
            let told = error <= NEAR * target.tolerance;
            let probes = PROBES.0.min(m_now) * PROBES.1[usize::from(rays.is_some())];
            let ray = slower * self.ray(4.0 * m_now);
            let again = if rounds == 0 { 1.0 } else { AGAIN };
            seconds += m_now * (c.element + c.estimate)
                + probes * ray
                + m_now * n_now * (c.seen + (again * sweeps + 3.0) * c.entry);
            rounds += 1;
            let of_rows = cast.map_or(0.0, noise) * grown.powf(-SMOOTHED);
            let total = error.hypot(of_rows);
            if total <= SHARE * target.tolerance || m_now > target.most_elements as f64 || rounds > 40 {
                let size = Size {
                    mesh_elements: m_now as u64,
                    elements: m_now as u64,
                    patches: n_now as u64,
                    bands: self.pilot.bands as u64,
                };
                let predicted = predict(&size, strategy);
                let (stored_bytes, peak_bytes) = (predicted.stored_bytes, predicted.peak_bytes);
                return Ok(Expected {
                    seconds,
                    stored_bytes,
                    peak_bytes,
                    error: total,
                    elements: m_now as u64,
                    rounds,
                });
            }
            if told && of_rows > 0.6 * target.tolerance {
                let factor = (of_rows / (0.5 * target.tolerance)).powi(2);
                cast = cast.map(|rays| 2.0_f64.powf((rays * factor).log2().ceil()));
            }
            let early = FIRST_FALLS.get(rounds as usize - 1).filter(|_| patches < own && unresolved == 0);
            error /= early.copied().unwrap_or(fall);
            (m_before, n_before) = (m_now, n_now);
            let finer = if patches < own && unresolved == 0 { FINER_GROWTH } else { 1.0 };
            n_now *= finer * (begin + more * f64::from(rounds - 1)).min(most);
            m_now = (m_now * if rounds > 1 { GROWTH } else { 1.0 }).max(n_now);
        }
    }
}

/// Share of an error that is left where elements are so many along what matters.
fn resolved(x: f64, [half, power]: [f64; 2]) -> f64 {
    (1.0 + (x / half).powf(power)).recip()
}

/// Time of a link's pairs in units of that of a pair of elements, by the elements of the pilot along an edge, four and two.
const BOUNDED: [f64; 2] = [0.1, 0.3];
/// Links an element at an error of 0.5 %, if all light were indirect.
const LINKS: f64 = 160.0;

fn rays_of(method: Method) -> Option<f64> {
    match method {
        Method::RayCast { rays, .. } | Method::RaysAndEmitters { rays } => Some(f64::from(rays)),
        _ => None,
    }
}
