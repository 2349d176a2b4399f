//! What a procedure will take: counts from a pilot, times a handful of constants.
//!
//! ```text
//! time = Σ_k c_k n_k,    k: elements meshed, pairs, pairs tested for blockers, points, segments, rays, entries read, rounds
//! ```
//!
//! On K elements along an edge a pilot of K₀ says, with u = K/K₀,
//!
//! ```text
//! senders(K) = s₀ u^−p,  receivers(K) = r₀ u^−1,  noise(N) = ν r(4) / √N,
//! partly blocked pairs ∝ m² u^−1,  points ∝ m² u^−3/2,
//! ```
//!
//! shadows' edges being lines; p is larger where elements are patches, whose slopes the estimate of an adaptive run follows, than where they are finer. Uniform meshes are doubled until senders, receivers (where elements are larger than report cells) and noise agree
//! with the tolerance; an adaptive run divides its error by a constant a round. Constants are of one machine and two threads; [`Constants::measured_on`] scales them to another.
//! What is *not* here: counts that do not take time (vectors, the report), and memory traffic of several programs at once.

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
const ORDER: f64 = 1.7;
/// The same of the estimate of an adaptive run: of patches that are elements, and of patches of finer elements.
const ORDERS: [f64; 2] = [1.65, 1.2];
/// Error of rows over report cells times the root of their rays, in units of how irradiance varies between halves of quarters of a face, and the most of that:
/// where everything is equally bright, it does not matter what rays meet.
const NOISE: (f64, f64) = (0.5, 0.2);
/// Power by which that falls with the edge from a pilot of fewer cells.
const OUTLINES: f64 = 0.3;
/// By what a round divides the error of an adaptive run, and multiplies patches: where nothing blocks, and where something does.
const FALL: [(f64, f64); 2] = [(1.55, 1.5), (1.45, 1.27)];
/// By how much a pilot of two elements along an edge, which sees no shadow's edge, falls short of one of four.
const COARSE: f64 = 2.5;
/// Share of the tolerance that is left for senders.
const SHARE: f64 = 0.97;
/// Growth of elements a round, while they are more than patches.
const GROWTH: f64 = 1.08;
/// Sweeps of a round that starts from the answer before.
const AGAIN: f64 = 0.6;
/// Products of conjugate gradients for a sweep of Gauss and Seidel.
const PRODUCTS: f64 = 0.7;
/// Power by which points of partly blocked pairs thin out with the edge.
const POINTS: f64 = 1.45;
/// Rays of the probes of a round, while coarse and at the end of noisy runs.
const PROBES: [f64; 2] = [128.0 * 512.0, 128.0 * 2048.0];
/// Time of a ray of a probe, in units of that of a row, which has fewer of them.
const OF_PROBE: f64 = 0.5;
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
    /// A pair of polygons, whether they face each other or not.
    pub pair: f64,
    /// A pair that faces each other where nothing blocks.
    pub clear: f64,
    /// A pair looked at for blockers, and more for each polygon that may block.
    pub tested: (f64, f64),
    /// An exact emitter of a row of rays.
    pub emitter: f64,
    /// A point at which the visible part is cut out.
    pub point: f64,
    /// A segment of a partly blocked pair.
    pub segment: f64,
    /// A ray for each doubling of the elements that it may meet, and more for each polygon that may block.
    pub ray: (f64, f64),
    /// An entry read for all bands, of a full row.
    pub entry: f64,
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
            element: 1.5e-6,
            estimate: 8e-6,
            pair: 5e-9,
            clear: 45e-9,
            tested: (280e-9, 3e-9),
            emitter: 0.18e-6,
            point: 0.38e-6,
            segment: 0.11e-6,
            ray: (3.7e-9, 0.4e-9),
            entry: 0.4e-9,
            sparse_entry: 1.5e-9,
            link: 0.6e-6,
            mesh: 0.3e-3,
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
            pair: plain.pair * of_pairs,
            clear: plain.clear * of_pairs,
            tested: (plain.tested.0 * of_pairs, plain.tested.1 * of_pairs),
            emitter: plain.emitter * of_rays,
            point: plain.point * of_pairs,
            segment: plain.segment * of_pairs,
            ray: (plain.ray.0 * of_rays, plain.ray.1 * of_rays),
            entry: plain.entry * rest,
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
    /// What `candidate` will take to reach `target` on `scene`.
    pub(super) fn expect(&self, scene: &Scene, candidate: &Candidate, target: &Target) -> Result<Expected, RunError> {
        match candidate.refine {
            Refine::Uniform => self.uniform(scene, &candidate.strategy, target),
            Refine::Adaptive { cells } => self.adaptive(scene, &candidate.strategy, cells, target),
        }
    }

    /// Edge of the elements of the pilot over that of elements `cells` along an edge.
    fn finer(&self, cells: f64) -> f64 {
        cells / f64::from(self.pilot.cells)
    }

    /// What changes on the way from half as many elements along an edge to `cells`: the error that senders of half as many make.
    fn senders(&self, cells: f64) -> f64 {
        self.level() * self.finer(cells).powf(-ORDER)
    }

    /// Error by senders of the pilot, as it would go on to finer elements.
    fn level(&self) -> f64 {
        self.pilot.senders * if self.pilot.cells == 2 { COARSE } else { 1.0 }
    }

    /// Error of rows of so many rays over report cells.
    fn noise(&self, rays: f64) -> f64 {
        // The outlines of lights and shadows stay as sharp while cells become smaller.
        let varies = self.pilot.receivers * self.finer(4.0).powf(-OUTLINES);
        NOISE.0 * varies.min(NOISE.1) / rays.sqrt()
    }

    /// Elements of a uniform mesh: those of the pilot, which contacts cut, times those of faces.
    fn elements(&self, scene: &Scene, cells: u32) -> Result<f64, RunError> {
        let mesh = |k: u32| -> Result<f64, RunError> {
            if let Some(&known) = self.meshes.borrow().get(&k) {
                return Ok(known as f64);
            }
            let elements = Subdivision::Uniform(k);
            let size = Size::before_meshing(scene, &MeshSettings { elements, patches: None, contacts: true })?;
            self.meshes.borrow_mut().insert(k, size.elements);
            Ok(size.elements as f64)
        };
        let covered = self.pilot.elements as f64 / mesh(self.pilot.cells)?;
        // What is cut beyond the mesh lies along lines.
        let cut = 1.0 + (covered - 1.0) * if covered > 1.0 { self.finer(f64::from(cells)).recip() } else { 1.0 };
        Ok(mesh(cells)? * cut)
    }

    /// Seconds for `pairs` pairs between elements `cells` along an edge (of sources and targets of different sizes their geometric mean).
    fn pairs(&self, pairs: f64, cells: f64) -> f64 {
        let (c, u, (count, cost)) = (self.constants, self.finer(cells), self.pilot.drawn);
        if self.pilot.blocking == 0 {
            return pairs * (c.pair + c.clear);
        }
        let share = |counted: u64| counted as f64 / count.max(1) as f64;
        let facing = share(cost.clear_pairs + cost.hidden_pairs + cost.partial_pairs);
        let tested = c.tested.0 + c.tested.1 * self.pilot.blocking as f64;
        pairs
            * (c.pair
                + facing * tested
                + share(cost.visibility_points) * u.powf(-POINTS) * c.point
                + share(cost.rays) / u * c.segment)
    }

    /// Seconds for `rows` rows of `rays` rays and of pairs with exact emitters, from elements `cells` along an edge.
    fn rays(&self, rows: f64, rays: f64, cells: f64) -> f64 {
        let (c, u, pilot) = (self.constants, self.finer(cells), self.pilot);
        let (drawn, cost) = pilot.to_emitters;
        let a_row = |counted: u64| (pilot.emitters * counted as usize) as f64 / drawn.max(1) as f64;
        let tested = c.tested.0 + c.tested.1 * pilot.blocking as f64;
        let pairs = if pilot.blocking == 0 {
            pilot.emitters as f64 * c.emitter
        } else {
            pilot.emitters as f64 * c.emitter
                + a_row(cost.clear_pairs + cost.hidden_pairs + cost.partial_pairs) * tested
                + a_row(cost.visibility_points) / u * c.point
                + a_row(cost.rays) / u * c.segment
        };
        rows * (rays * self.ray(rows) + pairs)
    }

    /// Seconds for a ray that may meet so many elements.
    fn ray(&self, elements: f64) -> f64 {
        let (c, pilot) = (self.constants, self.pilot);
        let meets = if pilot.closed { 1.0 } else { OPEN };
        meets * (c.ray.0 * elements.max(2.0).log2() + c.ray.1 * pilot.blocking as f64)
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

    fn uniform(&self, scene: &Scene, strategy: &Strategy, target: &Target) -> Result<Expected, RunError> {
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
                (Store::Sparse, Some(rays)) => m * m.min(0.7 * rays) * (sweeps + 3.0) * c.sparse_entry,
                _ if strategy.solver == "cg" => m * m * (PRODUCTS * sweeps + 3.0) * c.entry,
                _ => m * m * (sweeps + 3.0) * c.entry,
            };
            let report = f64::from(target.report_grid);
            let noise = rays.map_or(0.0, |rays| self.noise(rays) * 1.2 * (2.0 * report / k).min(2.0));
            let held = if k <= report { self.pilot.receivers * self.finer(k).recip() } else { 0.0 };
            let links = if let Store::Hierarchical { error, .. } = strategy.store { error } else { 0.0 };
            let error = (self.senders(k).powi(2) + held.powi(2) + noise.powi(2)).sqrt() + links;
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
                links * c.link + 0.3 * all + self.rays(m, 0.0, cells)
            }
            _ if rays_of(strategy.method).is_none() => self.pairs(0.5 * m * m, cells),
            _ => self.rows(strategy.method, (m, cells), (m, cells)) + 0.1 * m * m * c.entry,
        }
    }

    fn adaptive(&self, scene: &Scene, strategy: &Strategy, cells: u32, target: &Target) -> Result<Expected, RunError> {
        let c = self.constants;
        let report = f64::from(target.report_grid);
        let (own, patches) = (f64::from(cells).max(report), f64::from(cells));
        let m = self.elements(scene, own as u32)?;
        let n = self.elements(scene, cells)?;
        // Senders of the pilot are patches of twice its edge.
        let order = ORDERS[usize::from(patches < own)];
        let first = self.level() * self.finer(2.0 * patches).powf(-order);
        let (fall, growth) = FALL[usize::from(self.pilot.blocking > 0)];
        let rays = rays_of(strategy.method);
        let noise = |rays: f64| self.noise(rays) * (report / own);
        let mut cast = rays;
        let (mut seconds, mut rounds, mut error) = (c.mesh, 0, first);
        let (mut m_now, mut n_now, mut n_before) = (m, n, 0.0);
        let sweeps = self.sweeps(strategy.unshot) * (self.pilot.bands as f64).sqrt();
        loop {
            let (grown, k) = (m_now / m, own * (m_now / m).sqrt());
            let column = patches * (n_now / n).sqrt();
            seconds += match cast {
                Some(rays) => self.rays(m_now, rays, k),
                // Parts of patches are new columns, all rows of which are pairs.
                None if rounds == 0 => self.pairs(m * n, (own * patches).sqrt()),
                None => self.pairs(grown * m * (n_now - n_before) * 4.0 / 3.0, (k * column).sqrt()),
            };
            let told = error <= NEAR * target.tolerance;
            let probes = PROBES[usize::from(rays.is_some() && told)];
            let ray = OF_PROBE * self.ray(4.0 * m_now);
            let again = if rounds == 0 { 1.0 } else { AGAIN };
            seconds +=
                m_now * (c.element + c.estimate) + probes * ray + m_now * n_now * (again * sweeps + 3.0) * c.entry;
            rounds += 1;
            let of_rows = cast.map_or(0.0, noise);
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
            error /= fall;
            n_before = n_now;
            n_now *= growth;
            m_now = (m_now * GROWTH).max(n_now);
        }
    }
}

/// Links an element at an error of 0.5 %, if all light were indirect.
const LINKS: f64 = 160.0;

fn rays_of(method: Method) -> Option<f64> {
    match method {
        Method::RayCast { rays, .. } | Method::RaysAndEmitters { rays } => Some(f64::from(rays)),
        _ => None,
    }
}
