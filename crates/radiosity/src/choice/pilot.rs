//! What a coarse solution tells of a scene before a strategy is chosen.
//!
//! On few elements e with patches p of twice their edge,
//!
//! ```text
//! senders²     a² ⟨(F (B − B̄_p))²⟩ / ⟨H⟩²,   a = Σ A B / Σ A E    light sent by constants on patches in place of elements
//! receivers²   ⟨(H − H̄_p)²⟩ / ⟨H⟩²                                 irradiance held by constants on patches
//! ```
//!
//! with the area means B̄_p, H̄_p of a patch: both are what halving the edge of elements changed, so that they fall with the edge like the error of the mesh does. Beside them
//! stand counts: of sweeps, of the pairs towards exact emitters a row, and of what pairs of elements drawn at random take. No time is looked at, so that the
//! same scene gives the same choice. What is *not* here: the noise of rays, which is that of their number.

use radiosity_core::{BandValues, Cost, Form, StopRule};
use radiosity_form_factors::Pairwise;
use radiosity_geometry::mesh::{MeshSettings, Subdivision};
use radiosity_geometry::{Facets, Scene};

use super::cost::PILOT_RAYS;
use crate::estimate::analytic;
use crate::{Geometry, Method, RunError, Size, Store, assemble, solve_on};

/// Elements of the pilot, if faces allow.
const MOST: u64 = 200;
/// Cells of a face along an edge, at most.
const CELLS: u32 = 4;
/// Pairs of elements drawn.
const PAIRS: usize = 128;
/// Errors by senders and receivers that are taken for granted on one element a face: that by senders of white faces, it takes two reflections.
const USUAL: (f64, f64) = (1.3, 0.3);
/// Error of form factors where nothing blocks.
const COARSE: f64 = 1e-3;
/// Unshot share of the solution.
const UNSHOT: f64 = 1e-4;

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Pilot {
    /// Faces of the scene.
    pub surfaces: usize,
    /// Polygons that may block.
    pub blocking: usize,
    /// Whether the edges of the scene match each other.
    pub closed: bool,
    /// Largest reflectance.
    pub most_reflectance: f64,
    /// Surfaces with exact totals: those that emit, and the few that shine.
    pub emitters: usize,
    /// Bands.
    pub bands: usize,
    /// Elements of the pilot along an edge of a face.
    pub cells: u32,
    /// Elements of the pilot.
    pub elements: usize,
    /// Error by what patches send, see the module page.
    pub senders: f64,
    /// Error by what patches hold.
    pub receivers: f64,
    /// Share of the light that has been reflected, 1 − 1/a.
    pub indirect: f64,
    /// Sweeps to an unshot share of 1e-4.
    pub sweeps: u64,
    /// Rows towards exact emitters, and their counts of pairs, points and segments; not used where nothing blocks.
    pub to_emitters: (f64, Cost),
    /// Pairs drawn, and their counts by the pairwise estimator.
    pub drawn: (usize, Cost),
    /// Counts of the pilot.
    pub cost: Cost,
}

impl Pilot {
    /// Solves `scene` coarsely and draws pairs for the estimator of pairs `pairs`.
    ///
    /// # Errors
    ///
    /// [`RunError`] if there is no mesh or a row cannot be had.
    pub(super) fn new(scene: &Scene, pairs: Method, seed: u64) -> Result<Self, RunError> {
        let cells = cells_of(scene)?;
        let patches = Some(Subdivision::Uniform((cells / 2).max(1)));
        let settings = MeshSettings { elements: Subdivision::Uniform(cells), patches, contacts: true };
        let geometry = Geometry::new(scene, &settings)?;
        let solved = if cells > 1 { solve(&geometry, seed)? } else { Solved::guess(&geometry, seed) };
        let drawn = draw(&geometry, geometry.elements(), pairs, seed);
        Ok(Self {
            surfaces: scene.surfaces.len(),
            blocking: geometry.blockers().len(),
            closed: geometry.closed(),
            most_reflectance: geometry.reflectance().values().iter().copied().fold(0.0, f64::max),
            emitters: geometry.senders().1.len(),
            bands: scene.bands(),
            cells,
            elements: geometry.elements().len(),
            drawn,
            cost: solved.cost + drawn.1,
            senders: solved.senders,
            receivers: solved.receivers,
            indirect: solved.indirect,
            sweeps: solved.sweeps,
            to_emitters: solved.to_emitters,
        })
    }
}

/// What a coarse solution tells.
struct Solved {
    senders: f64,
    receivers: f64,
    indirect: f64,
    sweeps: u64,
    to_emitters: (f64, Cost),
    cost: Cost,
}

impl Solved {
    /// What is taken for granted of a scene of so many faces that solving it once would cost too much: usual errors, and sweeps by the mean reflectance.
    fn guess(geometry: &Geometry<'_>, seed: u64) -> Self {
        let rho = mean(&geometry.elements().areas(), &geometry.reflectance(), |rho| rho);
        let sweeps = (UNSHOT.ln() / rho.clamp(0.05, 0.99).ln()).ceil() as u64;
        let (emitters, _) = geometry.senders();
        let (pairs, cost) = draw(geometry, emitters, Method::analytic_among(geometry.blockers().len()), seed);
        let to_emitters = (pairs as f64 / emitters.len().max(1) as f64, cost);
        Self { senders: USUAL.0 * rho * rho, receivers: USUAL.1, indirect: rho, sweeps, to_emitters, cost }
    }
}

/// Solves on the elements of a pilot.
fn solve(geometry: &Geometry<'_>, seed: u64) -> Result<Solved, RunError> {
    let free = geometry.blockers().is_empty();
    let rays = Method::RaysAndEmitters { rays: PILOT_RAYS };
    let (method, kind) = if free { (Method::sampled(COARSE, 1), Store::Dense) } else { (rays, Store::Sparse) };
    let (store, filling) = assemble(geometry, method, Form::Full, kind, seed)?;
    let rule = StopRule::unshot(UNSHOT);
    let solution = solve_on(geometry, &*store, Form::Full, "gauss-seidel", &rule, &mut ())?;

    let areas = geometry.elements().areas();
    let (b, h) = (&solution.radiosity, &solution.irradiance);
    let mut lost = BandValues::zeros(b.count(), areas.len());
    let reading = store.gather(apart(geometry, &areas, b).view(), lost.view_mut())?;
    for band in 0..lost.count() {
        lost.band_mut(band).iter_mut().zip(&areas).for_each(|(lost, area)| *lost /= area);
    }
    let level = mean(&areas, h, |h| h);
    let rms = |of: &BandValues| if level > 0.0 { mean(&areas, of, |x| x * x).sqrt() / level } else { 0.0 };
    let emitted = mean(&areas, &geometry.emission(), |e| e);
    let reflected = if emitted > 0.0 { mean(&areas, b, |b| b) / emitted } else { 1.0 };
    let mut to_emitters = (areas.len() as f64, filling.cost);
    let cast = if free { 0 } else { areas.len() as u64 * u64::from(PILOT_RAYS) };
    to_emitters.1.rays = to_emitters.1.rays.saturating_sub(cast);
    Ok(Solved {
        senders: reflected * rms(&lost),
        receivers: rms(&apart(geometry, &areas, h)),
        indirect: 1.0 - reflected.max(1.0).recip(),
        sweeps: solution.steps,
        to_emitters,
        cost: filling.cost + solution.cost + reading,
    })
}

/// Cells along an edge: as many as the number of elements allows.
fn cells_of(scene: &Scene) -> Result<u32, RunError> {
    let mut cells = CELLS;
    while cells > 1 {
        let elements = Subdivision::Uniform(cells);
        let size = Size::before_meshing(scene, &MeshSettings { elements, patches: None, contacts: true })?;
        if size.elements <= MOST {
            break;
        }
        cells /= 2;
    }
    Ok(cells)
}

/// Values less their area means over the patches.
fn apart(geometry: &Geometry<'_>, areas: &[f64], of: &BandValues) -> BandValues {
    let (parent, patches) = (geometry.parent(), geometry.patches().areas());
    let mut apart = of.clone();
    for band in 0..of.count() {
        let mut means = vec![0.0; patches.len()];
        let own = parent.iter().zip(areas).zip(of.band(band));
        own.for_each(|((&p, area), value)| means[p as usize] += area * value / patches[p as usize]);
        apart.band_mut(band).iter_mut().zip(parent).for_each(|(value, &p)| *value -= means[p as usize]);
    }
    apart
}

/// Area mean over all bands of f(value).
fn mean(areas: &[f64], of: &BandValues, f: impl Fn(f64) -> f64) -> f64 {
    let total: f64 = areas.iter().sum();
    let sum: f64 = (0..of.count()).flat_map(|b| areas.iter().zip(of.band(b))).map(|(area, &x)| area * f(x)).sum();
    sum / (total * of.count() as f64)
}

/// Counts of pairs of an element and a target drawn at even steps from all of them.
fn draw(geometry: &Geometry<'_>, targets: &Facets, pairs: Method, seed: u64) -> (usize, Cost) {
    let Method::Analytic { tolerance, partial } = pairs else { return (0, Cost::default()) };
    let (elements, m) = (geometry.elements(), geometry.elements().len());
    if geometry.blockers().is_empty() || m == 0 || targets.is_empty() {
        return (0, Cost::default());
    }
    let analytic = analytic(geometry.blockers(), partial);
    // Steps of the golden section meet sources and targets evenly.
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    let cost = (0..PAIRS).map(|k| {
        let at = (k as f64 + 0.5) / PAIRS as f64;
        let s = (at * m as f64) as usize;
        let t = ((k as f64 * golden).fract() * targets.len() as f64) as usize;
        let exchange = |j| analytic.exchange(&elements.polygons(s)[0], j, tolerance, seed ^ k as u64).cost;
        targets.polygons(t).iter().map(exchange).sum::<Cost>()
    });
    (PAIRS, cost.sum())
}
