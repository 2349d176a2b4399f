//! From geometry to a store of form factors.

use std::time::{Duration, Instant};

use radiosity_core::{Cost, Form, FormFactors};
use radiosity_form_factors::analytic::{Analytic, PartialVisibility};
use radiosity_form_factors::emitters::{Emitter, ExactEmitters};
use radiosity_form_factors::hemicube::Hemicube;
use radiosity_form_factors::ray_cast::RayCast;
use radiosity_form_factors::stores::{DenseFormFactors, Held, Keep, OnDemand, PackedFormFactors, SparseFormFactors};
use radiosity_form_factors::{PairwiseRows, Receivers, Rows};
use radiosity_geometry::{Facets, Occluders};

use crate::hierarchical::fixed_links;
use crate::strategy::partial_among;
use crate::{Geometry, Method, RunError, Store};

/// What a phase of a run took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Phase {
    /// Counts.
    pub cost: Cost,
    /// Time.
    pub time: Duration,
}

/// Rows of `method` in `form` on the exposed elements and patches of `geometry`.
///
/// # Errors
///
/// [`RunError`] if the method's settings are out of range.
pub fn rows<'a>(
    geometry: &'a Geometry<'_>,
    method: Method,
    form: Form,
    seed: u64,
) -> Result<Box<dyn Rows + 'a>, RunError> {
    let (elements, patches) = (geometry.elements(), geometry.patches());
    let (sources, targets) = ends(geometry, form);
    let receivers = match form {
        Form::ElementsToPatches => Receivers::grouped(elements, geometry.parent(), patches.len()),
        Form::Full | Form::PatchesToElements => Receivers::facets(elements),
    };
    let hits = || geometry.element_occluders();
    with_emitters(geometry, method, form, (sources, targets), receivers, hits, seed)
}

/// Rows of `method` from any facets of the scene of `geometry` to its patches, at which rays end.
pub(crate) fn patch_rows<'a>(
    geometry: &'a Geometry<'_>,
    sources: &'a Facets,
    method: Method,
    seed: u64,
) -> Result<Box<dyn Rows + 'a>, RunError> {
    let patches = geometry.patches();
    let form = Form::ElementsToPatches;
    let hits = || geometry.patch_occluders();
    with_emitters(geometry, method, form, (sources, patches), Receivers::facets(patches), hits, seed)
}

pub(crate) fn with_emitters<'a>(
    geometry: &'a Geometry<'_>,
    method: Method,
    form: Form,
    (sources, targets): (&'a Facets, &'a Facets),
    receivers: Receivers<'a>,
    hits: impl Fn() -> &'a Occluders,
    seed: u64,
) -> Result<Box<dyn Rows + 'a>, RunError> {
    if let Method::RaysAndEmitters { rays } = method {
        let tolerance = EMITTER_ERROR / f64::from(rays);
        let rays = RayCast::new(sources, receivers, hits(), rays, seed);
        let partial = partial_among(geometry.blockers().len(), tolerance);
        return Ok(Box::new(exact_emitters(geometry, form, (rays, sources, targets), (tolerance, partial), seed)));
    }
    build(method, sources, targets, receivers, geometry.blockers(), hits, seed)
}

/// Rows of `rays` on the elements of `geometry` with the totals of pairs towards its [`Geometry::senders`], their visible parts by the rule `partial`.
pub(crate) fn emitter_rows<'a>(
    geometry: &'a Geometry<'_>,
    rays: u32,
    (tolerance, partial): (f64, PartialVisibility),
    seed: u64,
) -> Box<dyn Rows + 'a> {
    let elements = geometry.elements();
    let rays = RayCast::new(elements, Receivers::facets(elements), geometry.element_occluders(), rays, seed);
    Box::new(exact_emitters(geometry, Form::Full, (rays, elements, elements), (tolerance, partial), seed))
}

fn exact_emitters<'a>(
    geometry: &'a Geometry<'_>,
    form: Form,
    (rays, sources, targets): (RayCast<'a>, &'a Facets, &'a Facets),
    (tolerance, partial): (f64, PartialVisibility),
    seed: u64,
) -> ExactEmitters<RayCast<'a>, PairwiseRows<'a, Analytic<'a>>> {
    let analytic = analytic(geometry.blockers(), partial);
    let pairs = PairwiseRows::new(analytic, sources, geometry.senders().0, tolerance, seed);
    ExactEmitters::new(rays, pairs, senders(geometry, form, targets))
}

/// What the rows of a form run between: sources and targets.
pub(crate) fn ends<'g>(geometry: &'g Geometry<'_>, form: Form) -> (&'g Facets, &'g Facets) {
    let (elements, patches) = (geometry.elements(), geometry.patches());
    match form {
        Form::Full => (elements, elements),
        Form::ElementsToPatches => (elements, patches),
        Form::PatchesToElements => (patches, elements),
    }
}

/// The analytic estimator among `blockers`.
pub(crate) fn analytic(blockers: &Occluders, partial: PartialVisibility) -> Analytic<'_> {
    Analytic::new((!blockers.is_empty()).then_some(blockers)).partial_visibility(partial)
}

/// Error of the form factor from a source to an emitting surface that is asked of pairs, times the rays of a row: those
/// leave each entry uncertain by 6 over their number, and a light may be a few hundred times as bright as what it lights.
pub(crate) const EMITTER_ERROR: f64 = 0.01;

/// The targets that each surface with exact totals is made of.
fn senders(geometry: &Geometry<'_>, form: Form, targets: &Facets) -> Vec<Emitter> {
    // The surface of a patch is that of its elements.
    let mut surface_of = vec![0; targets.len()];
    for (e, surface) in geometry.surfaces().into_iter().enumerate() {
        let target = if form == Form::ElementsToPatches { geometry.parent()[e] as usize } else { e };
        surface_of[target] = surface;
    }
    let members = |surface: u32| {
        let of_surface = (0..targets.len()).filter(|&t| surface_of[t] == surface);
        Emitter { targets: of_surface.map(|t| (t as u32, targets.area(t))).collect() }
    };
    geometry.senders().1.iter().map(|&surface| members(surface)).collect()
}

/// Form factors between cells, each a list of polygons: rows of a matrix file. `elements` are single polygons, `cell`
/// names the cell of each; `cells` holds the same polygons cell by cell.
///
/// # Errors
///
/// [`RunError`] if the method's settings are out of range or an entry is no form factor.
pub fn cell_form_factors(
    cells: &Facets,
    elements: &Facets,
    cell: &[u32],
    blockers: &Occluders,
    method: Method,
    seed: u64,
) -> Result<(DenseFormFactors, Phase), RunError> {
    let clock = Instant::now();
    let receivers = Receivers::grouped(elements, cell, cells.len());
    let element_occluders = match method {
        Method::RayCast { .. } | Method::RaysAndEmitters { .. } => Some(Occluders::of_facets(elements)),
        _ => None,
    };
    let hits = || element_occluders.as_ref().expect("built for the one method that asks");
    let rows = build(method, cells, cells, receivers, blockers, hits, seed)?;
    let (store, cost) = DenseFormFactors::assemble(&*rows)?;
    Ok((store, Phase { cost, time: clock.elapsed() }))
}

pub(crate) fn build<'a>(
    method: Method,
    sources: &'a Facets,
    targets: &'a Facets,
    receivers: Receivers<'a>,
    blockers: &'a Occluders,
    hits: impl Fn() -> &'a Occluders,
    seed: u64,
) -> Result<Box<dyn Rows + 'a>, RunError> {
    Ok(match method {
        Method::Analytic { tolerance, partial } => {
            Box::new(PairwiseRows::new(analytic(blockers, partial), sources, targets, tolerance, seed))
        }
        // Between cells there is no emission: plain rays.
        Method::RayCast { rays, error } => {
            let rows = RayCast::new(sources, receivers, hits(), rays, seed);
            Box::new(if let Some(error) = error { rows.until(error) } else { rows })
        }
        Method::RaysAndEmitters { rays } => Box::new(RayCast::new(sources, receivers, hits(), rays, seed)),
        Method::Hemicube { resolution } => Box::new(Hemicube::new(sources, receivers, resolution, seed)?),
    })
}

/// A store of `method`'s form factors in `form`, and what filling it took (nothing yet for the on-demand ones). Links are those for
/// light that is equally bright everywhere.
///
/// # Errors
///
/// [`RunError`] if the method's settings are out of range, an entry is no form factor, or links cannot hold the form factors.
pub fn assemble<'a>(
    geometry: &'a Geometry<'_>,
    method: Method,
    form: Form,
    store: Store,
    seed: u64,
) -> Result<(Box<dyn FormFactors + 'a>, Phase), RunError> {
    let clock = Instant::now();
    if let (Store::Hierarchical { error, .. }, Method::Analytic { .. }, Form::Full) = (store, method, form) {
        let (store, cost) = fixed_links(geometry, method, error, seed)?;
        return Ok((Box::new(store), Phase { cost, time: clock.elapsed() }));
    }
    let (store, cost) = fill(rows(geometry, method, form, seed)?, store, None)?;
    Ok((store.boxed(), Phase { cost, time: clock.elapsed() }))
}

/// A store of the kind asked for.
pub(crate) enum Filled<'a> {
    /// It holds its entries.
    Held(Box<dyn Held>),
    /// It computes its rows when they are asked for.
    OnDemand(OnDemand<'a>),
}

impl<'a> Filled<'a> {
    pub(crate) fn store(&self) -> &(dyn FormFactors + 'a) {
        match self {
            Self::Held(store) => &**store,
            Self::OnDemand(store) => store,
        }
    }

    pub(crate) fn boxed(self) -> Box<dyn FormFactors + 'a> {
        match self {
            Self::Held(store) => store,
            Self::OnDemand(store) => Box::new(store),
        }
    }
}

/// A store of rows, and what filling it took; refused if it takes more than `limit` bytes.
pub(crate) fn fill<'a>(
    rows: Box<dyn Rows + 'a>,
    store: Store,
    limit: Option<u64>,
) -> Result<(Filled<'a>, Cost), RunError> {
    let (store, cost): (Box<dyn Held>, Cost) = match store {
        Store::Dense => held(DenseFormFactors::assemble_within(&*rows, limit)?),
        Store::Sparse => held(SparseFormFactors::assemble_within(&*rows, limit)?),
        Store::Packed => held(PackedFormFactors::<f64>::assemble_within(&*rows, limit)?),
        Store::PackedSingle => held(PackedFormFactors::<f32>::assemble_within(&*rows, limit)?),
        Store::KeepAll => {
            return Ok((Filled::OnDemand(OnDemand::within(rows, Keep::All, limit)?), Cost::default()));
        }
        Store::KeepNone => return Ok((Filled::OnDemand(OnDemand::new(rows, Keep::None)), Cost::default())),
        Store::Hierarchical { .. } => return Err(RunError::Links { rows: rows.name() }),
    };
    Ok((Filled::Held(store), cost))
}

fn held(filled: (impl Held + 'static, Cost)) -> (Box<dyn Held>, Cost) {
    (Box::new(filled.0), filled.1)
}
