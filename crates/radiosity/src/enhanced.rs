//! Enhanced radiosity: the first pass, in which light may take specular surfaces between diffuse ones.
//!
//! ```text
//! B = E + ρ (F + F′) B
//! ```
//!
//! with F of any method, as without specular surfaces, and F′ along rays or by mirror images ([`radiosity_form_factors::extended`]). The answer is as view-independent as before. H is also
//! given by the ways in which it arrived, for a second pass that replaces some of them:
//!
//! ```text
//! H = F E + F′ E + F (B − E) + F′ (B − E)
//! ```

use std::time::Instant;

use radiosity_core::{BandValues, Cost, Form, FormFactors, Observer, SolveError, System};
use radiosity_form_factors::Receivers;
use radiosity_form_factors::extended::{Images, Mirrors, SpecularBounces, SpecularRays};
use radiosity_form_factors::stores::{ExtendedFormFactors, SparseFormFactors};
use radiosity_geometry::Scene;
use radiosity_render::brdf::SpecularSurfaces;

use crate::estimate::{ends, fill};
use crate::plan::Anyway;
use crate::predict::{Prediction, Size, predict};
use crate::run::{Check, Known, named, solve_stored};
use crate::strategy::partial_among;
use crate::{Geometry, Method, Phase, Run, RunError, Shape, Strategy};

/// Vectors of all bands beyond those of other runs: H by its ways, and what they are found from.
const VECTORS: u64 = 8;
/// Bytes of an entry of F′: its value and its target.
const ENTRY: u64 = 12;

/// Errors of form factors by images asked for where the straight ones are not analytic: of clear pairs, and of those partly blocked.
const PAIR_ERROR: f64 = 1e-10;
const PARTIAL_ERROR: f64 = 1e-6;

/// How F′ is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpecularBy {
    /// By so many rays a row: any specular surface, any number of bounces, with noise.
    Rays(u32),
    /// By mirror images: planar, ideal mirrors, exact and symmetric, with the settings of the analytic method.
    Images,
}

impl SpecularBy {
    /// Rays of a row unless set otherwise.
    pub const RAYS: Self = Self::Rays(1024);

    /// The name used in flags and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rays(_) => "rays",
            Self::Images => "images",
        }
    }
}

/// How light takes specular surfaces between diffuse ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpecularTransport {
    /// How many in a row.
    pub bounces: SpecularBounces,
    /// How its form factors are found.
    pub by: SpecularBy,
}

impl SpecularTransport {
    /// Any number of bounces, by 1,024 rays a row.
    pub const ANY: Self = Self { bounces: SpecularBounces::Any, by: SpecularBy::RAYS };
    /// Specular parts count as absent.
    pub const NONE: Self = Self { bounces: SpecularBounces::None, by: SpecularBy::RAYS };

    /// What a first pass of so many rows leaves out if nothing in `scene` is specular, though such light is asked for; `cast` rays went by way of specular surfaces.
    pub fn left_out(self, scene: &Scene, rows: u64, cast: Option<u64>) -> Option<Anyway> {
        let needed = match self.by {
            SpecularBy::Rays(rays) => Some(rows.saturating_mul(u64::from(rays))),
            SpecularBy::Images => None,
        };
        (self.bounces != SpecularBounces::None && !scene.is_specular()).then(|| Anyway::specular(needed, cast))
    }
}

/// A first pass.
pub struct EnhancedRun<'a> {
    /// The run; its phases include the extended form factors.
    pub run: Run<'a>,
    /// H of the exposed elements by its ways of arriving: from lights, from lights by way of specular surfaces, from diffuse surfaces, and from those by way of
    /// specular ones.
    pub ways: [BandValues; 4],
    /// What the extended form factors alone took.
    pub specular: Phase,
}

/// Solves `scene` by `strategy` with specular surfaces between diffuse ones. A scene without any gives the bytes of [`crate::run`].
///
/// # Errors
///
/// [`RunError`] as [`crate::run`]; extended form factors along rays are not symmetric, none are repaired, and the two-level form and links do not take them. Images are
/// refused where a specular surface is no ideal mirror, or mirrors show each other without end.
pub fn run_enhanced<'a>(
    scene: &'a Scene,
    strategy: &Strategy,
    transport: SpecularTransport,
    observer: &mut dyn Observer,
) -> Result<EnhancedRun<'a>, RunError> {
    let specular = transport.bounces != SpecularBounces::None && scene.is_specular();
    if specular {
        check(strategy, transport.by)?;
    } else {
        strategy.check()?;
    }
    if let Some(limit) = strategy.memory {
        let size = Size::before_meshing(scene, &strategy.mesh)?;
        let needed = predict_enhanced(scene, &size, strategy, transport)?.peak_bytes;
        if needed > limit {
            return Err(RunError::Memory { needed, limit, alternative: None });
        }
    }
    let clock = Instant::now();
    let geometry = Geometry::of_strategy(scene, strategy)?;
    let meshing = Phase { time: clock.elapsed(), ..Phase::default() };
    let form = strategy.shape.form();
    let clock = Instant::now();
    let (straight, cost) =
        fill(crate::rows(&geometry, strategy.method, form, strategy.seed)?, strategy.store, strategy.memory)?;
    let mut form_factors = Phase { cost, time: clock.elapsed() };
    let extended = if specular { Some(extend(&geometry, straight.store(), strategy, transport)?) } else { None };
    let of_specular = extended.as_ref().map_or(Phase::default(), |(_, phase)| *phase);
    form_factors.cost += of_specular.cost;
    form_factors.time += of_specular.time;
    let store: &dyn FormFactors = extended.as_ref().map_or(straight.store(), |(store, _)| store);
    let known = Known { form_factors, repair: None, checks: Check::Known(None), thinned: Vec::new() };
    let made = solve_stored(&geometry, store, known, strategy, None, observer)?;
    let extended_store = extended.as_ref().map(|(store, _)| store as &dyn FormFactors);
    let ways = ways(&geometry, (straight.store(), extended_store), strategy, made.radiosity())?;
    drop(extended);
    drop(straight);
    Ok(EnhancedRun { run: made.run(geometry, meshing), ways, specular: of_specular })
}

/// Predicts a first pass on a mesh of this size: as [`predict`], with as many entries of F′ as rays find specular surfaces by their share of the area, or as there are pairs by images, once for each group of bands
/// in which specular surfaces are alike, and once more while a table is filled.
///
/// # Errors
///
/// [`RunError::Images`] if specular surfaces show no images.
pub fn predict_enhanced(
    scene: &Scene,
    size: &Size,
    strategy: &Strategy,
    transport: SpecularTransport,
) -> Result<Prediction, RunError> {
    let mut p = predict(size, strategy);
    p.peak_bytes = p.peak_bytes.saturating_add(8 * VECTORS * size.bands * size.elements);
    if transport.bounces == SpecularBounces::None || !scene.is_specular() {
        return Ok(p);
    }
    let targets = if strategy.shape.form() == Form::ElementsToPatches { p.patches } else { p.elements };
    let (tables, of_row) = match transport.by {
        SpecularBy::Rays(rays) => {
            let tables = groups(scene).1.len() as u64;
            p.rays = p.rays.saturating_add(p.source_evaluations.saturating_mul(u64::from(rays) * tables));
            // Rays that find a specular surface first, if all surfaces are as easily found.
            let reached = (f64::from(rays) * specular_share(scene)).ceil() as u64;
            (tables, targets.min(reached))
        }
        SpecularBy::Images => (Images::new(scene, transport.bounces)?.colours().len() as u64, targets),
    };
    let table = p.source_evaluations.saturating_mul(of_row * ENTRY);
    p.stored_bytes = p.stored_bytes.saturating_add(table.saturating_mul(tables));
    p.peak_bytes = p.peak_bytes.saturating_add(table.saturating_mul(tables + 1));
    Ok(p)
}

/// Share of the area that is specular.
fn specular_share(scene: &Scene) -> f64 {
    let area = |specular: bool| -> f64 {
        let of = scene
            .pieces()
            .filter(|(s, _)| !specular || scene.materials[scene.surfaces[*s].material].specular.is_some());
        of.map(|(_, piece)| piece.area()).sum()
    };
    area(true) / area(false)
}

/// Refuses what extended form factors cannot serve, before any is computed.
fn check(strategy: &Strategy, by: SpecularBy) -> Result<(), RunError> {
    if strategy.shape == Shape::TwoLevel || matches!(strategy.store, crate::Store::Hierarchical { .. }) {
        return Err(RunError::Extended { shape: strategy.shape.name(), store: strategy.store.name() });
    }
    if strategy.repair {
        return Err(RunError::RepairExtended);
    }
    let solver = named(&strategy.solver, strategy.seed)?;
    if by != SpecularBy::Images && solver.needs().symmetric {
        return Err(SolveError::NeedsSymmetric { solver: solver.name(), store: "extended" }.into());
    }
    strategy.check()
}

/// The form factors of `straight` with those by way of specular surfaces.
fn extend<'s>(
    geometry: &Geometry<'_>,
    straight: &'s dyn FormFactors,
    strategy: &Strategy,
    transport: SpecularTransport,
) -> Result<(ExtendedFormFactors<'s>, Phase), RunError> {
    let clock = Instant::now();
    let (tables, cost) = match transport.by {
        SpecularBy::Rays(rays) => tables_of_rays(geometry, strategy, transport.bounces, rays)?,
        SpecularBy::Images => tables_of_images(geometry, strategy, transport.bounces)?,
    };
    let phase = Phase { cost, time: clock.elapsed() };
    Ok((ExtendedFormFactors::new(straight, tables), phase))
}

/// Parts of F′ with what they count in each band, and what they took.
type Tables = (Vec<(SparseFormFactors, Vec<f64>)>, Cost);

/// A table for each group of bands in which all specular surfaces are alike.
fn tables_of_rays(
    geometry: &Geometry<'_>,
    strategy: &Strategy,
    bounces: SpecularBounces,
    rays: u32,
) -> Result<Tables, RunError> {
    let (scene, form) = (geometry.scene(), strategy.shape.form());
    let scatter = SpecularSurfaces::new(scene);
    let surface_of: Vec<u32> = scene.pieces().map(|(s, _)| s as u32).collect();
    let mirrors = Mirrors { occluders: geometry.element_occluders(), surface_of: &surface_of, scatter: &scatter };
    let elements = geometry.elements();
    let receivers = match form {
        Form::ElementsToPatches => Receivers::grouped(elements, geometry.parent(), geometry.patches().len()),
        Form::Full | Form::PatchesToElements => Receivers::facets(elements),
    };
    let (sources, _) = ends(geometry, form);
    let (of_band, firsts) = groups(scene);
    let (mut tables, mut total) = (Vec::with_capacity(firsts.len()), Cost::default());
    for (group, band) in firsts.into_iter().enumerate() {
        let band = (scene.bands(), band);
        let rows = SpecularRays::new((sources, receivers), mirrors, bounces, band, rays, strategy.seed);
        let (table, cost) = SparseFormFactors::assemble(&rows)?;
        total += cost;
        tables.push((table, of_band.iter().map(|&g| f64::from(u8::from(g == group))).collect()));
    }
    Ok((tables, total))
}

/// A table for each colour of chains of mirrors.
fn tables_of_images(
    geometry: &Geometry<'_>,
    strategy: &Strategy,
    bounces: SpecularBounces,
) -> Result<Tables, RunError> {
    let images = Images::new(geometry.scene(), bounces)?;
    let (tolerance, partial) = match strategy.method {
        Method::Analytic { tolerance, partial } => (tolerance, partial),
        // What is straight need not be exact for this to be.
        _ => (PAIR_ERROR, partial_among(images.blockers(), PARTIAL_ERROR)),
    };
    let ends = ends(geometry, strategy.shape.form());
    let (mut tables, mut total) = (Vec::with_capacity(images.colours().len()), Cost::default());
    for (k, shares) in images.colours().iter().enumerate() {
        let rows = images.rows(ends, k, tolerance, partial, strategy.seed);
        let (table, cost) = SparseFormFactors::assemble(&rows)?;
        total += cost;
        tables.push((table, shares.clone()));
    }
    Ok((tables, total))
}

/// The group of every band, and the first band of every group: bands in which all specular surfaces are alike.
fn groups(scene: &Scene) -> (Vec<usize>, Vec<usize>) {
    let specular: Vec<_> = scene.materials.iter().filter_map(|m| m.specular.as_ref()).collect();
    let (mut of_band, mut firsts): (Vec<usize>, Vec<usize>) = (Vec::new(), Vec::new());
    for b in 0..scene.bands() {
        let known = firsts.iter().position(|&a| specular.iter().all(|s| s.alike(a, b)));
        of_band.push(known.unwrap_or(firsts.len()));
        if known.is_none() {
            firsts.push(b);
        }
    }
    (of_band, firsts)
}

/// H by its ways of arriving, from the radiosity of the solution; `whole` has F + F′ if there is an F′.
fn ways(
    geometry: &Geometry<'_>,
    (straight, whole): (&dyn FormFactors, Option<&dyn FormFactors>),
    strategy: &Strategy,
    radiosity: &BandValues,
) -> Result<[BandValues; 4], RunError> {
    let (emission, reflectance) = (geometry.emission(), geometry.reflectance());
    let areas = geometry.elements().areas();
    let direction = named(&strategy.solver, strategy.seed)?.needs().direction;
    let irradiance = |store: &dyn FormFactors, x: &BandValues| -> Result<BandValues, RunError> {
        let form = strategy.shape.form();
        let system =
            System::substructured(store, form, &areas, geometry.parent(), emission.view(), reflectance.view())?;
        let mut h = BandValues::zeros(emission.count(), emission.len());
        system.irradiance(direction, x.view(), h.view_mut())?;
        Ok(h)
    };
    let minus = |a: &BandValues, b: &BandValues| {
        let values = a.values().iter().zip(b.values()).map(|(a, b)| a - b).collect();
        BandValues::new(values, a.len())
    };
    let reflected = minus(radiosity, &emission);
    let (direct, indirect) = (irradiance(straight, &emission)?, irradiance(straight, &reflected)?);
    let Some(whole) = whole else {
        let nothing = BandValues::zeros(emission.count(), emission.len());
        return Ok([direct, nothing.clone(), indirect, nothing]);
    };
    // Sums of both parts less the one, so as not to read tables in a way of their own.
    let (by_way, more) =
        (minus(&irradiance(whole, &emission)?, &direct), minus(&irradiance(whole, &reflected)?, &indirect));
    Ok([direct, by_way, indirect, more])
}
