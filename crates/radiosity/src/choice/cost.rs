//! What a procedure will take: counts from a pilot, times a handful of constants.
//!
//! ```text
//! time = Σ_k c_k n_k,    k: elements meshed, pairs, pairs tested for blockers, points, segments, rays, entries read, rounds
//! ```
//!
//! On K elements along an edge a pilot of K₀ says, with u = K/K₀ and the edge d of what shines or blocks in units of the largest face's,
//!
//! ```text
//! senders(K) = s₀ u^−p,                    K₀ = 4: the pilot sees how errors fall;  p is larger where elements are patches than where they are finer
//!            = s₀ / (1 + (K d/x₀)^p),      K₀ = 2: nothing is gained before elements resolve the detail
//! receivers(K) = r₀ u^−1,   noise(N) = ν r₀ √indirect / √N,
//! partly blocked pairs ∝ m² u^−1,   points ∝ m² u^−1.45,   elements = α K² + β where contacts cut
//! ```
//!
//! shadows' edges being lines. Uniform meshes are doubled until senders, receivers (where elements are larger than report cells) and noise agree
//! with the tolerance; an adaptive run divides its error by a constant a round. Since a tolerance just met or just missed is a round more or less, the time is the
//! geometric mean of three: with the errors of the pilot, with larger and with smaller ones.
//!
//! Constants are of one machine and two threads, fitted by non-negative least squares of relative errors to the counts of 190 runs on 26 scenes (hinges, tubes, boxes, rooms, cities), whose
//! times a sum of counts times constants meets within a factor of 1.3 in three quarters; powers and falls were fitted to the estimates of the same runs, before these saw shadows inside elements (`adaptive/edges.rs`): where lamps are
//! hidden in part, first errors and the time of estimates are predicted too small. [`Constants::measured_on`] scales
//! constants to another machine. What is *not* here: counts that do not take time (vectors, the report), and memory traffic of several programs at once.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::time::Instant;

use radiosity_core::Form;
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::{MeshSettings, Subdivision};

use super::candidates::{Candidate, FEW_RAYS, Refine, Target, pairs_among};
use super::pilot::Pilot;
use crate::{Geometry, Method, RunError, Size, Store, Strategy, assemble, predict};

/// Power by which the difference of two uniform meshes falls with the edge.
const ORDER: f64 = 1.9;
/// The same of the estimate of an adaptive run: of patches that are elements, and of patches of finer elements.
const ORDERS: [f64; 2] = [1.7, 1.2];
/// Error of rows over report cells times the root of their rays, in units of how irradiance varies between halves of quarters of a face: of what it varies up to
/// the second value, and the share of the rest. Where everything is equally bright, it does not matter what rays meet.
const NOISE: (f64, f64, f64) = (0.47, 0.25, 0.15);
/// Variation that a pilot of two elements along an edge may overlook: times its own, at most the second value.
const OVERLOOKED: (f64, f64) = (4.0, 0.2);
/// Share of indirect light below which rows err less, exact emitters being most of the light.
const INDIRECT: f64 = 0.5;
/// By what a round divides the error of an adaptive run: where nothing blocks, where something does, and while elements do not resolve it.
const FALL: [f64; 3] = [1.55, 1.45, 1.25];
/// By what the first round multiplies patches, by how much more the next ones do, and the most of it: the same two.
const GROWTHS: [[f64; 3]; 2] = [[1.3, 0.15, 1.65], [1.1, 0.1, 1.5]];
/// The same division in the first rounds of patches of finer elements, and how many those are.
const FIRST_FALLS: (f64, u32) = (1.9, 2);
/// Error by senders of a pilot of two elements along an edge in units of that by elements, and by patches of finer elements: 1/(1 + (x/x₀)^p) of x elements
/// along what shines or blocks, with x₀ and p, of adaptive runs and of the difference of uniform ones; and a factor, a power and the most of it.
const DETAIL: [f64; 2] = [1.15, 3.0];
const DETAIL_OF_UNIFORM: [f64; 2] = [0.75, 2.3];
const DETAIL_OF_PATCHES: [f64; 3] = [0.6, -1.3, 3.0];
/// Factor by which errors may be larger or smaller than a pilot says, each with a third of the probability: one of two elements along an edge, and one of four.
const UNSURE: [f64; 2] = [1.35, 1.15];
/// Power of the elements by which noise falls.
const SMOOTHED: f64 = 0.35;
/// Share of the tolerance that is left for senders.
const SHARE: f64 = 0.97;
/// Elements of which entries of sparse rows take twice the time, being read from further away.
const SCATTERED: f64 = 8000.0;
/// Growth of elements a round, while they are more than patches.
const GROWTH: f64 = 1.08;
/// Sweeps of a round that starts from the answer before.
const AGAIN: f64 = 0.6;
/// Products of conjugate gradients for a sweep of Gauss and Seidel.
const PRODUCTS: f64 = 0.7;
/// Power by which points of partly blocked pairs thin out with the edge.
const POINTS: f64 = 1.45;
/// Elements that are probed in a round, at most, and rays of each: of exact rows, and of noisy ones.
const PROBES: (f64, [f64; 2]) = (128.0, [512.0, 2048.0]);
/// Time of a ray of a probe, in units of that of a row, which has fewer of them.
const OF_PROBE: f64 = 0.5;
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
    /// A pair where nothing blocks.
    pub clear: f64,
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
            estimate: 5e-6,
            clear: 22e-9,
            tested: 130e-9,
            emitter: 0.1e-6,
            point: 96e-9,
            segment: 0.03e-6,
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
    /// The default constants, times what rows of pairs and rows of rays take on `scene` on this machine as it is now, in units of what the
    /// defaults say: those of geometry and pairs by the one, of rays by the other, of the rest by the geometric mean. Counts are the same in each call, times are not.
    ///
    /// # Errors
    ///
    /// [`RunError`] if there is no mesh or a row cannot be had.
    pub fn measured_on(scene: &Scene, seed: u64) -> Result<Self, RunError> {
        let plain = Self::default();
        let pilot = Pilot::new(scene, GRID, seed)?;
        let pairs = pairs_among(pilot.blocking);
        let elements = Subdivision::Uniform(pilot.cells);
        let geometry = Geometry::new(scene, &MeshSettings { elements, patches: None, contacts: true })?;
        let model = Model::new(&pilot, &plain);
        let ratio = |method, store, expected: f64| -> Result<f64, RunError> {
            let clock = Instant::now();
            let mut times = 0.0;
            while times < 8.0 && clock.elapsed().as_secs_f64() < CALIBRATION {
                assemble(&geometry, method, Form::Full, store, seed)?;
                times += 1.0;
            }
            Ok(clock.elapsed().as_secs_f64() / (times * expected).max(f64::MIN_POSITIVE))
        };
        let m = geometry.elements().len() as f64;
        let cells = f64::from(pilot.cells);
        let of_pairs = ratio(pairs, Store::Dense, model.pairs(0.5 * m * m, cells))?;
        let rays = Method::RaysAndEmitters { rays: FEW_RAYS };
        let of_rays = ratio(rays, Store::Sparse, model.rays(m, f64::from(FEW_RAYS), cells))?;
        let rest = (of_pairs * of_rays).sqrt();
        Ok(Self {
            element: plain.element * rest,
            estimate: plain.estimate * rest,
            clear: plain.clear * of_pairs,
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
/// Seconds that each measurement takes at most, beyond its first run.
const CALIBRATION: f64 = 0.05;

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
        match pilot.cells {
            2 => pilot.senders * resolved(0.5 * cells * pilot.detail, DETAIL_OF_UNIFORM),
            _ => pilot.senders * self.finer(cells).powf(-ORDER),
        }
    }

    /// Error by senders that an adaptive run estimates first, of patches so many along an edge that are elements or not.
    fn first(&self, patches: f64, elements: bool) -> f64 {
        let pilot = self.pilot;
        let x = patches * pilot.detail;
        pilot.senders
            * match (pilot.cells, elements) {
                (2, true) => resolved(x, DETAIL),
                (2, false) => (DETAIL_OF_PATCHES[0] * x.powf(DETAIL_OF_PATCHES[1])).min(DETAIL_OF_PATCHES[2]),
                // Senders of the pilot are patches of twice its edge.
                _ => self.finer(2.0 * patches).powf(-ORDERS[usize::from(!elements)]),
            }
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
            * (facing * c.tested
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
                    m * m.min(0.7 * rays) * (sweeps + 3.0) * c.sparse_entry * (1.0 + m / SCATTERED)
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
                let (stored_bytes, peak_bytes) = (predicted.stored_bytes, predicted.peak_bytes);
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
                links * c.link + 0.12 * all + self.rays(m, 0.0, cells)
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
        let first = unsure * self.first(patches, patches >= own);
        let blocked = usize::from(self.pilot.blocking > 0);
        let unresolved = usize::from(blocked > 0 && patches * self.pilot.detail < 1.0);
        let (fall, [begin, more, most]) = (FALL[blocked + unresolved], GROWTHS[blocked]);
        let rays = rays_of(strategy.method);
        let noise = |rays: f64| unsure * self.noise(rays) * (report / own);
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
                Some(rays) => self.rays(m_now, rays, k),
                None => {
                    let kept = if rounds == 0 { 0.0 } else { kept(m_before, m_now) * kept(n_before, n_now) };
                    self.pairs(m_now * n_now - kept, (k * column).sqrt())
                }
            };
            let told = error <= NEAR * target.tolerance;
            let probes = PROBES.0.min(m_now) * PROBES.1[usize::from(rays.is_some())];
            let ray = OF_PROBE * self.ray(4.0 * m_now);
            let again = if rounds == 0 { 1.0 } else { AGAIN };
            seconds +=
                m_now * (c.element + c.estimate) + probes * ray + m_now * n_now * (again * sweeps + 3.0) * c.entry;
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
            error /= if patches < own && rounds <= FIRST_FALLS.1 { FIRST_FALLS.0 } else { fall };
            (m_before, n_before) = (m_now, n_now);
            n_now *= (begin + more * f64::from(rounds - 1)).min(most);
            m_now = (m_now * GROWTH).max(n_now);
        }
    }
}

/// Share of an error that is left where elements are so many along what matters.
fn resolved(x: f64, [half, power]: [f64; 2]) -> f64 {
    (1.0 + (x / half).powf(power)).recip()
}

/// Links an element at an error of 0.5 %, if all light were indirect.
const LINKS: f64 = 160.0;

fn rays_of(method: Method) -> Option<f64> {
    match method {
        Method::RayCast { rays, .. } | Method::RaysAndEmitters { rays } => Some(f64::from(rays)),
        _ => None,
    }
}
