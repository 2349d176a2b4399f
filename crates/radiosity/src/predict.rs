//! What a strategy will cost, before it runs: exact counts where they are known, bounds and estimates elsewhere; and what to do instead
//! where it would take too much memory.
//!
//! The peak of memory is predicted as
//!
//! ```text
//! mesh + a · form factors held + m · (8 bytes · bands · vectors + what the estimator keeps an element)
//! ```
//!
//! Form factors held are exact for the dense and the packed stores, a bound for the sparse one (rows of rays have no more entries than rays)
//! and for kept rows, and an estimate for links, whose number is that of the Cornell box. The other numbers are what runs on the Cornell box
//! take, which `predicted_peaks_are_those_of_runs` in the tests of the program compares with other scenes and sizes. What is *not* here: the memory of the
//! program itself, some megabytes, and of a solution while it is written, which is less than what solving took.

use radiosity_form_factors::hierarchical::{Hierarchy, Links};
use radiosity_form_factors::stores::{PackedFormFactors, SparseFormFactors};
use radiosity_geometry::mesh::{Mesh, MeshError, MeshSettings, MeshSize, Subdivision};
use radiosity_geometry::{Facets, Scene};

use crate::plan::Plan;
use crate::thin::PILOT_RAYS;
use crate::{DirectLight, Geometry, LINK_ERROR, Method, RunError, Shape, Store, Strategy};

/// Vectors of all bands alive at once: the system, the iterate, the answer and what checks it.
const VECTORS: u64 = 15;
/// Vectors of a hierarchical run, which holds direct light and the last round's answer as well.
const VECTORS_OF_LINKS: u64 = 20;
/// Vectors that a restarted Krylov space holds beyond those.
const VECTORS_OF_GMRES: u64 = 32;
/// Vectors that a solver that samples holds beyond those: sums, squares and what each batch draws.
const VECTORS_OF_SAMPLING: u64 = 44;
/// Bytes an element where each element ends rays: its place in the tree of cells.
const HIT: u64 = 230;
/// Bytes an element by which exact emitters exceed plain rays.
const EMITTERS: u64 = 110;
/// Bytes an element of item buffers.
const HEMICUBE: u64 = 1250;
/// Bytes an element of what says which pairs were dropped and bounds what they carried, beside vectors; and vectors of all bands in it.
const THINNED: u64 = 300;
const VECTORS_OF_THINNED: u64 = 12;
/// Links of 10⁴ elements at [`USUAL_ERROR`], and the power of the number of elements and of the error by which they grow.
const LINKS: f64 = 8e4;
const LINK_GROWTH: (f64, f64) = (0.65, -1.3);
const USUAL_ERROR: f64 = 0.02;
/// Bytes of both ends of a link in the store.
const ENDS: u64 = 16;

/// How large the mesh of a problem is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Elements of the mesh, those inside solids included.
    pub mesh_elements: u64,
    /// Elements m that take part.
    pub elements: u64,
    /// Patches n.
    pub patches: u64,
    /// Bands.
    pub bands: u64,
}

impl Size {
    /// The size of a mesh that is there.
    pub fn of(geometry: &Geometry<'_>) -> Self {
        Self {
            mesh_elements: geometry.mesh().elements.len() as u64,
            elements: geometry.elements().len() as u64,
            patches: geometry.patches().len() as u64,
            bands: geometry.scene().bands() as u64,
        }
    }

    /// The size of a mesh that is not made yet, as if no contact cut or covered a cell: O(faces).
    ///
    /// # Errors
    ///
    /// [`MeshError`] if the settings make no mesh.
    pub fn before_meshing(scene: &Scene, settings: &MeshSettings) -> Result<Self, MeshError> {
        let MeshSize { cells, patches } = MeshSize::of(scene, settings)?;
        Ok(Self { mesh_elements: cells, elements: cells, patches, bands: scene.bands() as u64 })
    }
}

/// Counts and memory of a strategy on a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Prediction {
    /// Elements m.
    pub elements: u64,
    /// Patches n.
    pub patches: u64,
    /// Sources for which the estimator starts once.
    pub source_evaluations: u64,
    /// Form factors computed by one pass over all sources.
    pub form_factors: u64,
    /// Rays of a row-wise estimator by one pass; of a pairwise one this depends on what blocks and is not counted.
    pub rays: u64,
    /// Pixels of all hemicubes of one pass.
    pub hemicube_pixels: u64,
    /// Bytes of form factors held, at most; of links an estimate.
    pub stored_bytes: u64,
    /// Bytes of the mesh.
    pub mesh_bytes: u64,
    /// Bytes of the whole run where it takes most, the program itself not counted: an estimate, see the module page.
    pub peak_bytes: u64,
}

/// Predicts `strategy` on a mesh of this size.
pub fn predict(size: &Size, strategy: &Strategy) -> Prediction {
    let (m, n) = (size.elements, size.patches);
    let (sources, targets) = match strategy.shape {
        Shape::Full => (m, m),
        Shape::ElementsToPatches | Shape::TwoLevel => (m, n),
        Shape::PatchesToElements => (n, m),
    };
    let pairwise = matches!(strategy.method, Method::Analytic { .. });
    let rays = match strategy.method {
        Method::RayCast { rays, .. } | Method::RaysAndEmitters { rays } => sources.saturating_mul(u64::from(rays)),
        _ => 0,
    };
    // Products of counts may pass 2⁶⁴ where nothing would fit anyway.
    let entries = sources.saturating_mul(targets);
    let coarse = if strategy.shape == Shape::TwoLevel { n.saturating_mul(8 * n) } else { 0 };
    let links = links(m, strategy);
    let (held, filling) = match strategy.store {
        Store::Dense | Store::KeepAll => (entries.saturating_mul(8), 0),
        // A sparse entry also names its target. Upper triangles are copied to both sides, other rows are put together a few at a time.
        Store::Sparse => {
            let bytes = entries.min(if pairwise || rays == 0 { entries } else { rays }).saturating_mul(12);
            let pieces = bytes / sources.max(1) * sources.min(SparseFormFactors::ROWS_AT_ONCE as u64);
            (bytes, if pairwise { bytes } else { pieces })
        }
        Store::Packed => (PackedFormFactors::<f64>::bytes(m as usize), 0),
        Store::PackedSingle => (PackedFormFactors::<f32>::bytes(m as usize), 0),
        Store::KeepNone => (0, 0),
        // A tree of nodes with links, which are refined in a list of their own.
        Store::Hierarchical { .. } => (Hierarchy::bytes_of(m as usize) + ENDS * links, Links::bytes_of(links)),
    };
    let stored_bytes = held.saturating_add(coarse);
    let patches = (n != m).then_some(n);
    // What takes part is selected from the mesh where not all of it does, and named by its places there.
    let mesh_bytes = Mesh::bytes_of(size.mesh_elements, patches) + Facets::selected_bytes_of(m) + 8 * m;
    let peak_bytes = [filling, mesh_bytes, factored(size, strategy), workspace(size, strategy)];
    Prediction {
        elements: m,
        patches: n,
        source_evaluations: sources,
        // A symmetric store asks for each unordered pair once.
        form_factors: if pairwise && strategy.shape == Shape::Full {
            m.saturating_mul(m.saturating_sub(1)) / 2
        } else {
            entries
        },
        rays,
        hemicube_pixels: match strategy.method {
            Method::Hemicube { resolution } => sources.saturating_mul(3 * u64::from(resolution).pow(2)),
            _ => 0,
        },
        stored_bytes,
        mesh_bytes,
        peak_bytes: peak_bytes
            .into_iter()
            .fold(stored_bytes, u64::saturating_add)
            .max(mesh_bytes + before_filling(size, strategy)),
    }
}

/// Links that a hierarchical store of m elements may hold.
fn links(m: u64, strategy: &Strategy) -> u64 {
    let Store::Hierarchical { error, .. } = strategy.store else { return 0 };
    (LINKS * (m as f64 / 1e4).powf(LINK_GROWTH.0) * (error / USUAL_ERROR).powf(LINK_GROWTH.1)) as u64
}

/// Bytes of factored matrices: one for every distinct reflectance, at most one a band.
fn factored(size: &Size, strategy: &Strategy) -> u64 {
    let unknowns = if strategy.shape == Shape::TwoLevel { size.patches } else { size.elements };
    let matrix = |entry: u64| unknowns.saturating_mul(unknowns).saturating_mul(entry * size.bands);
    match strategy.solver.as_str() {
        "direct" => matrix(8),
        "direct-f32" => matrix(4),
        _ => 0,
    }
}

/// Bytes of vectors, and of what the estimator keeps for each element.
fn workspace(size: &Size, strategy: &Strategy) -> u64 {
    let vectors = match (strategy.store, strategy.solver.as_str()) {
        (Store::Hierarchical { .. }, _) => VECTORS_OF_LINKS,
        (_, "gmres") => VECTORS + VECTORS_OF_GMRES,
        _ if strategy.samples() => VECTORS + VECTORS_OF_SAMPLING,
        _ => VECTORS,
    };
    let thinned = if strategy.thins().is_some() {
        // The elements end the rays of its pilot.
        THINNED + 8 * size.bands * VECTORS_OF_THINNED + HIT + EMITTERS
    } else {
        0
    };
    size.elements * (8 * size.bands * vectors + estimator_bytes(strategy) + thinned)
}

/// Bytes beyond those of the mesh that are taken before the store is filled: the pilot of dropped pairs, its rows held and copied where they grow.
fn before_filling(size: &Size, strategy: &Strategy) -> u64 {
    let rows = if strategy.thins().is_some() { 2 * 12 * u64::from(PILOT_RAYS) } else { 0 };
    if rows > 0 { size.elements * rows + workspace(size, strategy) } else { 0 }
}

/// Bytes that the estimator keeps for each element.
pub(crate) fn estimator_bytes(strategy: &Strategy) -> u64 {
    let elements_end_rays = !matches!(strategy.shape, Shape::ElementsToPatches | Shape::TwoLevel);
    let hit = if elements_end_rays { HIT } else { 0 };
    match strategy.method {
        Method::Analytic { .. } => 0,
        Method::RayCast { .. } => hit,
        Method::RaysAndEmitters { .. } => hit + EMITTERS,
        Method::Hemicube { .. } => HEMICUBE,
    }
}

/// What is different in an [`Alternative`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// Every pair once, in this store.
    Packed(Store),
    /// Links instead of pairs.
    Links,
    /// Rows of rays, without their zeros.
    SparseRays,
    /// Rows of rays that are cast whenever they are asked for.
    RaysOnDemand,
    /// Fewer elements.
    Coarser(Subdivision),
}

impl std::fmt::Display for Change {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Packed(store) => write!(f, "the {} store", store.name()),
            Self::Links => f.write_str("the hierarchical store"),
            Self::SparseRays => f.write_str("rows of rays in the sparse store"),
            Self::RaysOnDemand => f.write_str("rows of rays computed on demand"),
            Self::Coarser(Subdivision::Uniform(k)) => write!(f, "{k} × {k} elements a face"),
            Self::Coarser(Subdivision::EdgeLength(h)) => write!(f, "elements of edge length {h}"),
        }
    }
}

/// A way to solve a scene in the memory there is.
#[derive(Clone, Debug, PartialEq)]
pub struct Alternative {
    /// What is different from the strategy asked for.
    pub change: Change,
    /// The strategy with that change.
    pub strategy: Strategy,
    /// What it will cost.
    pub prediction: Prediction,
}

/// Refuses `strategy` on `scene` before anything is computed if the peak predicted is beyond its memory, with an alternative that fits.
///
/// # Errors
///
/// [`RunError::Memory`], and [`RunError::Mesh`] if the settings make no mesh.
pub fn admit(scene: &Scene, strategy: &Strategy) -> Result<(), RunError> {
    let Some(limit) = strategy.memory else { return Ok(()) };
    let needed = planned(&Plan::new(scene, strategy), scene, strategy)?.peak_bytes;
    if needed <= limit {
        return Ok(());
    }
    let alternative = alternative(scene, strategy, limit).map(Box::new);
    Err(RunError::Memory { needed, limit, alternative })
}

/// What `strategy` will take by its plan, before there is a mesh.
fn planned(plan: &Plan, scene: &Scene, strategy: &Strategy) -> Result<Prediction, MeshError> {
    Ok(plan.size_before_meshing(scene, strategy)?.predict(strategy))
}

/// [`admit`] where every entry of the system is held as well, to solve it exactly.
pub(crate) fn admit_beside_exact(scene: &Scene, strategy: &Strategy) -> Result<(), RunError> {
    let Some(limit) = strategy.memory else { return Ok(()) };
    let size = Size::before_meshing(scene, &strategy.mesh)?;
    let exact = predict(&size, &Strategy { store: Store::Dense, ..strategy.clone() }).stored_bytes;
    let needed = predict(&size, strategy).peak_bytes.saturating_add(exact);
    if needed <= limit { Ok(()) } else { Err(RunError::Memory { needed, limit, alternative: None }) }
}

/// Refuses to go on with so many links if they and all else are beyond the memory of `strategy`.
pub(crate) fn admit_links(geometry: &Geometry<'_>, strategy: &Strategy, found: usize) -> Result<(), RunError> {
    let Some(limit) = strategy.memory else { return Ok(()) };
    let size = Size::of(geometry);
    let bytes = |links: u64| ENDS * links + Links::bytes_of(links);
    let predicted = predict(&size, strategy).peak_bytes;
    let needed = predicted - bytes(links(size.elements, strategy)) + bytes(found as u64);
    if needed <= limit { Ok(()) } else { Err(RunError::Memory { needed, limit, alternative: None }) }
}

/// The first of a short list of changes with which a run fits: the nearest to what was asked for comes first, and fewer elements last.
fn alternative(scene: &Scene, asked: &Strategy, limit: u64) -> Option<Alternative> {
    let rays = match asked.method {
        Method::RayCast { .. } => asked.method,
        _ => Method::RAY_CAST,
    };
    let solver =
        |name: &str, method: Method, store: Store| Strategy { method, store, solver: name.to_owned(), ..asked.clone() };
    let links = Store::Hierarchical { error: LINK_ERROR, direct: DirectLight::WhereFew };
    let full = asked.shape == Shape::Full;
    let mut changes: Vec<(Change, Strategy)> =
        Store::SYMMETRIC.map(|store| (Change::Packed(store), Strategy { store, ..asked.clone() })).into();
    changes.push((Change::Links, solver("cg", Method::OF_LINKS, links)));
    changes.push((Change::SparseRays, solver("gauss-seidel", rays, Store::Sparse)));
    changes.push((Change::RaysOnDemand, solver("shooting", rays, Store::KeepNone)));
    let fitting =
        changes.into_iter().filter(|(_, strategy)| full && strategy.check().is_ok()).find_map(|(change, strategy)| {
            let prediction = planned(&Plan::new(scene, &strategy), scene, &strategy).ok()?;
            (prediction.peak_bytes <= limit).then_some(Alternative { change, strategy, prediction })
        });
    fitting.or_else(|| coarser(scene, asked, limit))
}

/// The same strategy on the finest mesh that fits in `limit` bytes.
pub fn coarser(scene: &Scene, asked: &Strategy, limit: u64) -> Option<Alternative> {
    // What a plan leaves out is a matter of faces: that of one mesh serves all.
    let plan = Plan::new(scene, asked);
    let with = |elements: Subdivision| -> Option<Alternative> {
        let mut strategy = asked.clone();
        strategy.mesh.elements = elements;
        let prediction = planned(&plan, scene, &strategy).ok()?;
        let change = Change::Coarser(elements);
        (prediction.peak_bytes <= limit).then_some(Alternative { change, strategy, prediction })
    };
    match asked.mesh.elements {
        Subdivision::Uniform(k) => {
            // Elements nest in patches.
            let unit = match asked.mesh.patches {
                Some(Subdivision::Uniform(patches)) => patches,
                _ => 1,
            };
            let (mut fits, mut too_many) = (0, k / unit);
            while too_many - fits > 1 {
                let middle = fits + (too_many - fits) / 2;
                if with(Subdivision::Uniform(unit * middle)).is_some() { fits = middle } else { too_many = middle }
            }
            (fits > 0).then(|| with(Subdivision::Uniform(unit * fits))).flatten()
        }
        Subdivision::EdgeLength(h) => {
            // To two digits, so that it can be typed.
            let rounded = |h: f64| format!("{h:.1e}").parse::<f64>().unwrap_or(h);
            (1..200).find_map(|k| with(Subdivision::EdgeLength(rounded(h * 1.2_f64.powi(k)))))
        }
    }
}

/// A number of bytes, written for people: `1.2 MB`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bytes(pub u64);

impl std::fmt::Display for Bytes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 as f64 {
            b if b >= 1e12 => write!(f, "{:.2} TB", b / 1e12),
            b if b >= 1e9 => write!(f, "{:.2} GB", b / 1e9),
            b if b >= 1e6 => write!(f, "{:.1} MB", b / 1e6),
            b if b >= 1e3 => write!(f, "{:.1} kB", b / 1e3),
            b => write!(f, "{b} B"),
        }
    }
}

#[cfg(test)]
mod tests {
    use radiosity_gallery::boxes::{material, unit_cube};

    use super::*;

    fn admitted(strategy: Strategy, limit: u64) -> Result<(), RunError> {
        let scene = unit_cube(material("grey", 0.5, 1.0));
        admit(&scene, &Strategy { memory: Some(limit), ..strategy })
    }

    fn changed(strategy: Strategy, limit: u64) -> Change {
        let Err(RunError::Memory { alternative: Some(found), needed, .. }) = admitted(strategy, limit) else {
            panic!("nothing else fits in {limit}")
        };
        assert!(found.prediction.peak_bytes <= limit && limit < needed, "{found:?}");
        found.change
    }

    /// 6 × 40² elements: 737 MB of entries, half and a quarter of that in packed stores, and 8 MB of vectors.
    #[test]
    fn what_fits_and_is_nearest_to_what_was_asked_for_is_offered() {
        let pairs = Strategy::new(Subdivision::Uniform(40), Method::ANALYTIC);
        assert_eq!(admitted(pairs.clone(), 800_000_000), Ok(()));
        assert_eq!(changed(pairs.clone(), 500_000_000), Change::Packed(Store::Packed));
        assert_eq!(changed(pairs.clone(), 300_000_000), Change::Packed(Store::PackedSingle));
        assert_eq!(changed(pairs, 100_000_000), Change::Links);
        let rays = Strategy::new(Subdivision::Uniform(40), Method::RAY_CAST);
        assert_eq!(changed(rays.clone(), 500_000_000), Change::Links);
        assert_eq!(changed(rays, 8_000_000), Change::RaysOnDemand);
    }

    #[test]
    fn a_coarser_mesh_is_the_finest_that_fits_and_nests_in_its_patches() {
        let mut strategy = Strategy::new(Subdivision::Uniform(64), Method::RAY_CAST);
        (strategy.shape, strategy.solver) = (Shape::ElementsToPatches, "gauss-seidel".to_owned());
        strategy.mesh.patches = Some(Subdivision::Uniform(8));
        let Change::Coarser(Subdivision::Uniform(k)) = changed(strategy.clone(), 40_000_000) else { panic!() };
        assert!(k.is_multiple_of(8) && k < 64, "{k}");
        strategy.mesh.elements = Subdivision::Uniform(k + 8);
        assert!(admitted(strategy, 40_000_000).is_err());
    }

    #[test]
    fn a_limit_below_everything_leaves_nothing_to_offer() {
        let strategy = Strategy::new(Subdivision::Uniform(64), Method::ANALYTIC);
        assert!(matches!(admitted(strategy, 1_000), Err(RunError::Memory { alternative: None, .. })));
    }
}
