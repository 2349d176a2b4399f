//! What a coarse solution tells of a scene before a strategy is chosen.
//!
//! On few elements e with patches p of twice their edge,
//!
//! ```text
//! senders²     a ⟨(F (B − B̄_p))²⟩ / ⟨H⟩²,   a = Σ A B / Σ A E     light sent by constants on patches in place of elements
//! receivers²   ⟨(H − H̄_p)²⟩ / ⟨H⟩²                                 irradiance held by constants on patches
//! ```
//!
//! with the area means B̄_p, H̄_p of a patch: both are what halving the edge of elements changed, so that they fall with the edge like the error of the mesh does. Beside them
//! stand counts: of sweeps, of the pairs towards exact emitters a row, and of what pairs of elements drawn at random take. No time is looked at, so that the
//! same scene gives the same choice. What is *not* here: the noise of rays, which is that of their number.

use radiosity_core::{BandValues, Cost, Form, StopRule, StoreError};
use radiosity_form_factors::Pairwise;
use radiosity_form_factors::analytic::PartialVisibility;
use radiosity_geometry::mesh::{MeshSettings, Subdivision};
use radiosity_geometry::{Facets, Scene, Surface};
use rayon::prelude::*;

use super::candidates::{FEW_RAYS, pairs_among};
use crate::estimate::{EMITTER_ERROR, analytic, emitter_rows, fill, rows};
use crate::strategy::partial_among;
use crate::{Geometry, Method, RunError, Size, Store, solve_on};

/// Cells of a face along an edge, at most; half as many for coarser report grids.
const CELLS: u32 = 4;
/// Elements of the pilot at most: of the most cells, and of two along an edge.
const MOST: [u64; 2] = [256, 8192];
/// Rays of a row of few elements, and of more than so many: what they leave in irradiance is less than what elements of that size do.
const RAYS: [u32; 2] = [64, 32];
const FEW_ROWS: usize = 256;
/// Exact emitters beyond which light comes from everywhere and rays meet it often enough.
const EMITTERS: usize = 8;
/// Error of pairs with exact emitters, and segments of those that are partly blocked: large ones have more.
const TO_EMITTERS: (f64, PartialVisibility) =
    (1e-3, PartialVisibility::Rays { samples: 1, standard_error: f64::INFINITY });
/// Pairs of elements drawn; three quarters as many of those whose visible part is cut out, which takes longer.
const PAIRS: usize = 64;
/// Pairs of an element and an exact emitter drawn.
const EMITTER_PAIRS: usize = 32;
/// By what the segments of those are fewer than they will be.
const FEWER: u32 = 8;
/// Errors by senders and receivers that are taken for granted on one element a face: that by senders of white faces, it takes two reflections.
const USUAL: (f64, f64) = (1.3, 0.3);
/// Rows of rays that tell how many elements they meet.
const ROWS: usize = 16;
/// Error of form factors where nothing blocks.
const COARSE: f64 = 1e-2;
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
    /// Elements of a mesh of twice as many along an edge, if contacts cut or cover some of the pilot.
    pub twice_as_fine: Option<usize>,
    /// Edge of what is seen as fine as that, in units of the edge of the largest face: the geometric mean of what shines and what blocks.
    pub detail: f64,
    /// Error by what patches send, see the module page.
    pub senders: f64,
    /// Error by what patches hold.
    pub receivers: f64,
    /// Share of the light that has been reflected, 1 − 1/a.
    pub indirect: f64,
    /// Sweeps to an unshot share of 1e-4.
    pub sweeps: u64,
    /// Elements that 256 rays from one meet, mean over some.
    pub met: f64,
    /// Pairs with exact emitters drawn, and their counts of pairs, points and segments; none where nothing blocks.
    pub to_emitters: (usize, Cost),
    /// Pairs drawn, and their counts by the pairwise estimator.
    pub drawn: (usize, Cost),
    /// Counts of the pilot.
    pub cost: Cost,
}

impl Pilot {
    /// Solves `scene` coarsely, for a report grid of `report_grid` cells along an edge, and draws pairs.
    ///
    /// # Errors
    ///
    /// [`RunError`] if there is no mesh or a row cannot be had.
    pub(super) fn new(scene: &Scene, report_grid: u32, seed: u64) -> Result<Self, RunError> {
        let cells = cells_of(scene, report_grid)?;
        let patches = Some(Subdivision::Uniform((cells / 2).max(1)));
        let settings = MeshSettings { elements: Subdivision::Uniform(cells), patches, contacts: true };
        let geometry = Geometry::new(scene, &settings)?;
        let solved = if cells > 1 { solve(&geometry, seed)? } else { Solved::guess(&geometry) };
        let blocking = geometry.blockers().len();
        let drawn = draw(&geometry, geometry.elements(), (pairs_among(blocking), PAIRS), seed);
        let to_emitters = draw(&geometry, geometry.senders().0, (to_emitters_among(blocking), EMITTER_PAIRS), seed);
        Ok(Self {
            surfaces: scene.surfaces.len(),
            blocking,
            closed: geometry.closed(),
            most_reflectance: geometry.reflectance().values().iter().copied().fold(0.0, f64::max),
            emitters: geometry.senders().1.len(),
            bands: scene.bands(),
            cells,
            elements: geometry.elements().len(),
            twice_as_fine: twice_as_fine(scene, cells, geometry.elements().len())?,
            drawn,
            cost: solved.cost + drawn.1 + to_emitters.1,
            detail: detail(scene, blocking),
            senders: solved.senders,
            receivers: solved.receivers,
            indirect: solved.indirect,
            sweeps: solved.sweeps,
            met: met(&geometry, seed)?,
            to_emitters,
        })
    }
}

/// Elements of a mesh of twice `cells` along an edge, unless the `elements` of `cells` are those of faces that nothing cuts.
fn twice_as_fine(scene: &Scene, cells: u32, elements: usize) -> Result<Option<usize>, RunError> {
    let uniform = |k| MeshSettings { elements: Subdivision::Uniform(k), patches: None, contacts: true };
    if Size::before_meshing(scene, &uniform(cells))?.elements == elements as u64 {
        return Ok(None);
    }
    Ok(Some(Geometry::new(scene, &uniform(2 * cells))?.elements().len()))
}

/// Edge of the largest face that shines, and where something blocks the geometric mean of it and of the median of all faces, in units of the edge of the largest.
fn detail(scene: &Scene, blocking: usize) -> f64 {
    let mut areas: Vec<f64> = scene.surfaces.iter().map(Surface::area).collect();
    areas.sort_by(f64::total_cmp);
    let Some(&largest) = areas.last().filter(|area| **area > 0.0) else { return 1.0 };
    let shines = |surface: &&Surface| scene.materials[surface.material].emission.iter().any(|&e| e > 0.0);
    let lit = scene.surfaces.iter().filter(shines).map(Surface::area).fold(0.0, f64::max);
    let of_lit = if lit > 0.0 { (lit / largest).sqrt() } else { 1.0 };
    let usual = (areas[areas.len() / 2] / largest).sqrt();
    if blocking > 0 { (of_lit * usual).sqrt() } else { of_lit }
}

/// Elements that rays from one meet, mean over [`ROWS`] of them.
fn met(geometry: &Geometry<'_>, seed: u64) -> Result<f64, RunError> {
    let m = geometry.elements().len();
    let rows = rows(geometry, Method::rays(FEW_RAYS), Form::Full, seed)?;
    let count = ROWS.min(m);
    let entries = |k: usize| -> Result<usize, StoreError> {
        let mut row = vec![0.0; m];
        rows.row(k * m / count, &mut row)?;
        Ok(row.iter().filter(|f| **f > 0.0).count())
    };
    let all: Result<Vec<usize>, StoreError> = (0..count).into_par_iter().map(entries).collect();
    Ok(all?.iter().sum::<usize>() as f64 / count.max(1) as f64)
}

/// What a coarse solution tells.
struct Solved {
    senders: f64,
    receivers: f64,
    indirect: f64,
    sweeps: u64,
    cost: Cost,
}

impl Solved {
    /// What is taken for granted of a scene of so many faces that solving it once would cost too much: usual errors, and sweeps by the mean reflectance.
    fn guess(geometry: &Geometry<'_>) -> Self {
        let rho = mean(&geometry.elements().areas(), &geometry.reflectance(), |rho| rho);
        let sweeps = (UNSHOT.ln() / rho.clamp(0.05, 0.99).ln()).ceil() as u64;
        Self { senders: USUAL.0 * rho * rho, receivers: USUAL.1, indirect: rho, sweeps, cost: Cost::default() }
    }
}

/// Solves on the elements of a pilot.
fn solve(geometry: &Geometry<'_>, seed: u64) -> Result<Solved, RunError> {
    let rays = RAYS[usize::from(geometry.elements().len() > FEW_ROWS)];
    let (rows, kind) = if geometry.blockers().is_empty() {
        (rows(geometry, Method::sampled(COARSE, 1), Form::Full, seed)?, Store::Dense)
    } else if geometry.senders().1.len() <= EMITTERS {
        (emitter_rows(geometry, rays, TO_EMITTERS, seed), Store::Sparse)
    } else {
        (rows(geometry, Method::rays(rays), Form::Full, seed)?, Store::Sparse)
    };
    let (filled, filling) = fill(rows, kind, None)?;
    let (store, rule) = (filled.store(), StopRule::unshot(UNSHOT));
    let solution = solve_on(geometry, store, Form::Full, "gauss-seidel", &rule, &mut ())?;

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
    Ok(Solved {
        senders: reflected.max(0.0).sqrt() * rms(&lost),
        receivers: rms(&apart(geometry, &areas, h)),
        indirect: 1.0 - reflected.max(1.0).recip(),
        sweeps: solution.steps,
        cost: filling + solution.cost + reading,
    })
}

/// Cells along an edge: as many as the report grid and the number of elements allow.
fn cells_of(scene: &Scene, report_grid: u32) -> Result<u32, RunError> {
    let few = |(cells, most): (u32, u64)| -> Result<Option<u32>, RunError> {
        let elements = Subdivision::Uniform(cells);
        let size = Size::before_meshing(scene, &MeshSettings { elements, patches: None, contacts: true })?;
        Ok((size.elements <= most).then_some(cells))
    };
    let coarse = few((2, MOST[1]))?;
    let fine = if coarse.is_some() && report_grid >= CELLS { few((CELLS, MOST[0]))? } else { None };
    Ok(fine.or(coarse).unwrap_or(1))
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

/// The estimator of the pairs with exact emitters in rows of rays.
fn to_emitters_among(blocking: usize) -> Method {
    let tolerance = EMITTER_ERROR / f64::from(FEW_RAYS);
    Method::Analytic { tolerance, partial: partial_among(blocking, tolerance) }
}

/// Counts of `most` pairs of an element and a target drawn at even steps from all of them, as `pairs` will have them.
fn draw(geometry: &Geometry<'_>, targets: &Facets, (pairs, most): (Method, usize), seed: u64) -> (usize, Cost) {
    let Method::Analytic { tolerance, partial } = pairs else { return (0, Cost::default()) };
    let (elements, m) = (geometry.elements(), geometry.elements().len());
    if geometry.blockers().is_empty() || m == 0 || targets.is_empty() {
        return (0, Cost::default());
    }
    // How many segments a pair takes is known without testing all of them.
    let (partial, fewer, most) = match partial {
        PartialVisibility::Rays { samples, standard_error } => {
            let fewer = samples.min(FEWER);
            (PartialVisibility::Rays { samples: samples / fewer, standard_error }, fewer, most)
        }
        exact @ PartialVisibility::Exact { .. } => (exact, 1, most * 3 / 4),
    };
    let analytic = analytic(geometry.blockers(), partial);
    // Steps of the golden section meet sources and targets evenly.
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    let counts = (0..most).into_par_iter().map(|k| {
        let at = (k as f64 + 0.5) / most as f64;
        let s = (at * m as f64) as usize;
        let t = ((k as f64 * golden).fract() * targets.len() as f64) as usize;
        let exchange = |j| analytic.exchange(&elements.polygons(s)[0], j, tolerance, seed ^ k as u64).cost;
        targets.polygons(t).iter().map(exchange).sum::<Cost>()
    });
    let mut cost: Cost = counts.sum();
    cost.rays *= u64::from(fewer);
    (most, cost)
}
