//! References for scenes without a closed form: much finer runs, by exact pairs where a matrix of them can be held, else by rays.
//!
//! **Pairs.** Elements nest in the cells of the report grid, so that a cell's mean is that of its elements and only what varies inside them is
//! wrong: it falls by 4 with half the edge where nothing is singular, and by 2 in cells at the foot of a block. So the difference from a run
//! of twice the edge is more than the error left. Edges are equal on all faces: where faces meet, the error is that of the coarser side.
//!
//! **Rays** split light in two. Direct irradiance is the exact unoccluded form factor of the whole emitter times a finely sampled visibility; it
//! becomes the emission ρH_direct of a system for indirect light, whose rows from elements to patches are cast as many
//! rays. The two errors that dominate a plain fine run (a small light met by few rays, blocky first shadows) do not
//! occur.

use std::error::Error;

use radiosity::{Geometry, GridValues, Method, Store, Strategy};
use radiosity_core::{BandValues, Form, StopRule, StoreError, System, solve};
use radiosity_form_factors::analytic::Analytic;
use radiosity_form_factors::point::form_factors_from;
use radiosity_form_factors::ray_cast::RayCast;
use radiosity_form_factors::stores::DenseFormFactors;
use radiosity_form_factors::{PairwiseRows, Receivers, Rows, SparseRow};
use radiosity_geometry::mesh::{MeshSettings, Subdivision};
use radiosity_geometry::{Facets, Scene};
use radiosity_solvers::GaussSeidel;
use rayon::prelude::*;

/// How fine a reference is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fineness {
    /// Elements.
    pub elements: Subdivision,
    /// Patches, in which elements must nest. Where surfaces touch, coarse patches are what is wrong with a fine mesh.
    pub patches: Subdivision,
    /// Rays of every element for indirect light.
    pub rays: u32,
    /// Segments between an element and a partly hidden emitter.
    pub segments: u32,
}

impl Fineness {
    /// So many elements and patches along an edge of every face.
    pub const fn uniform(elements: u32, patches: u32, rays: u32, segments: u32) -> Self {
        Self { elements: Subdivision::Uniform(elements), patches: Subdivision::Uniform(patches), rays, segments }
    }

    /// Half the elements and patches along an edge, and half the rays.
    fn half(self) -> Self {
        Self { elements: coarser(self.elements), patches: coarser(self.patches), rays: self.rays / 2, ..self }
    }
}

/// Half as many cells along an edge.
fn coarser(subdivision: Subdivision) -> Subdivision {
    match subdivision {
        Subdivision::Uniform(k) => Subdivision::Uniform(k / 2),
        Subdivision::EdgeLength(h) => Subdivision::EdgeLength(2.0 * h),
    }
}

/// Irradiance of a fine mesh.
pub struct Fine<'a> {
    /// The mesh.
    pub geometry: Geometry<'a>,
    /// H of its exposed elements.
    pub irradiance: BandValues,
}

/// Solves `scene` finely.
///
/// # Errors
///
/// Whatever meshing, estimating or solving may meet.
pub fn fine(scene: &Scene, fineness: Fineness, seed: u64) -> Result<Fine<'_>, Box<dyn Error>> {
    let mesh = MeshSettings { elements: fineness.elements, patches: Some(fineness.patches), contacts: true };
    let geometry = Geometry::new(scene, &mesh)?;
    let (elements, patches) = (geometry.elements(), geometry.patches());
    let areas = elements.areas();
    let reflectance = geometry.reflectance();
    let bands = scene.bands();

    // Direct light of every emitting face, each face as a whole.
    let mut emitters = Facets::new();
    let mut emission = Vec::new();
    for surface in &scene.surfaces {
        let e = &scene.materials[surface.material].emission;
        if e.iter().any(|&e| e > 0.0) && !surface.pieces.is_empty() {
            emitters.push(surface.pieces.clone(), false);
            emission.push(e.clone());
        }
    }
    let analytic = Analytic::new(Some(geometry.blockers())).samples(fineness.segments);
    let rows = PairwiseRows::new(&analytic, &emitters, elements, 1e-10, seed);
    let mut direct = BandValues::zeros(bands, areas.len());
    let mut row = vec![0.0; areas.len()];
    for (s, e) in emission.iter().enumerate() {
        rows.row(s, &mut row)?;
        for (b, e) in e.iter().enumerate() {
            let band = direct.band_mut(b);
            row.iter().zip(&areas).enumerate().for_each(|(k, (f, area))| band[k] += e * f / area);
        }
    }

    // Indirect light: what the direct light makes the elements send.
    let mut sent = direct.clone();
    sent.values_mut().iter_mut().zip(reflectance.values()).for_each(|(sent, rho)| *sent *= rho);
    let receivers = Receivers::grouped(elements, geometry.parent(), patches.len());
    let rays = RayCast::new(elements, receivers, geometry.element_occluders(), fineness.rays, seed);
    let (store, _) = DenseFormFactors::assemble(&rays)?;
    let form = Form::ElementsToPatches;
    let system = System::substructured(&store, form, &areas, geometry.parent(), sent.view(), reflectance.view())?;
    let solution = solve(&system, &mut GaussSeidel::default(), &StopRule::unshot(1e-9), &mut ())?;
    let mut irradiance = direct;
    irradiance.values_mut().iter_mut().zip(solution.irradiance.values()).for_each(|(h, indirect)| *h += indirect);
    Ok(Fine { geometry, irradiance })
}

/// A reference on a report grid with its own error.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Irradiance over the cells.
    pub grid: GridValues,
    /// rms difference from a reference half as fine (and of another seed, if by rays), relative to the mean level: more than the error of
    /// this one.
    pub error: f64,
}

/// The reference of `scene` on a `cells` × `cells` report grid.
///
/// # Errors
///
/// As [`fine`].
pub fn truth(scene: &Scene, fineness: Fineness, cells: u32) -> Result<Truth, Box<dyn Error>> {
    let finest = fine(scene, fineness, 1)?;
    let grid = GridValues::means(&finest.geometry, &finest.irradiance, cells)?;
    drop(finest);
    let half = fine(scene, fineness.half(), 2)?;
    let error = GridValues::means(&half.geometry, &half.irradiance, cells)?.error(&grid).rms;
    Ok(Truth { grid, error })
}

/// The reference of `scene` at `points` × `points` points of every piece of every surface: direct light is exact at each point; indirect light
/// comes by `rays` rays from the cell of the point to the elements of a solution of the given fineness.
///
/// # Errors
///
/// As [`fine`].
pub fn points_truth(scene: &Scene, fineness: Fineness, points: u32, rays: u32) -> Result<Truth, Box<dyn Error>> {
    let mesh = MeshSettings { elements: Subdivision::Uniform(points), patches: None, contacts: true };
    let cells = Geometry::new(scene, &mesh)?;
    let direct = direct_at_centres(&cells);
    let gathered = |fineness: Fineness, rays: u32, seed: u64| -> Result<GridValues, Box<dyn Error>> {
        let mut irradiance = indirect(&cells, &fine(scene, fineness, seed)?, rays, seed)?;
        irradiance.values_mut().iter_mut().zip(direct.values()).for_each(|(h, direct)| *h += direct);
        Ok(GridValues::points(&cells, &irradiance, points))
    };
    let grid = gathered(fineness, rays, 1)?;
    let error = gathered(fineness.half(), rays / 2, 2)?.error(&grid).rms;
    Ok(Truth { grid, error })
}

/// Direct light at the centroids of the elements.
fn direct_at_centres(geometry: &Geometry<'_>) -> BandValues {
    let (elements, (emitters, surfaces)) = (geometry.elements(), geometry.emitters());
    let (bands, m) = (geometry.scene().bands(), elements.len());
    let blockers = geometry.blockers().polygons();
    let at = |e: usize| {
        let polygon = &elements.polygons(e)[0];
        form_factors_from(polygon.centroid(), polygon.normal(), emitters, blockers)
    };
    let factors: Vec<Vec<f64>> = (0..m).into_par_iter().map(at).collect();
    let mut direct = BandValues::zeros(bands, m);
    for (k, &surface) in surfaces.iter().enumerate() {
        let emission = &geometry.scene().materials[geometry.scene().surfaces[surface as usize].material].emission;
        for (band, e) in emission.iter().enumerate() {
            direct.band_mut(band).iter_mut().zip(&factors).for_each(|(h, factors)| *h += e * factors[k]);
        }
    }
    direct
}

/// What rays from the elements gather of the light that those of a solution reflect.
fn indirect(geometry: &Geometry<'_>, from: &Fine<'_>, rays: u32, seed: u64) -> Result<BandValues, Box<dyn Error>> {
    let mut sent = from.irradiance.clone();
    sent.values_mut().iter_mut().zip(from.geometry.reflectance().values()).for_each(|(h, rho)| *h *= rho);
    let (elements, bands) = (geometry.elements(), sent.count());
    let receivers = Receivers::facets(from.geometry.elements());
    let rows = RayCast::new(elements, receivers, from.geometry.element_occluders(), rays, seed);
    let gather = |e: usize| -> Result<Vec<f64>, StoreError> {
        let mut row = SparseRow::default();
        rows.sparse_row(e, &mut row)?;
        let sum = |band: usize| row.entries.iter().map(|&(t, f)| f * sent.band(band)[t as usize]).sum::<f64>();
        Ok((0..bands).map(|band| sum(band) / elements.area(e)).collect())
    };
    let gathered: Vec<Vec<f64>> = (0..elements.len()).into_par_iter().map(gather).collect::<Result<_, _>>()?;
    let values = (0..bands).flat_map(|band| gathered.iter().map(move |h| h[band]));
    Ok(BandValues::new(values.collect(), gathered.len()))
}

/// The reference of a scene in which nothing blocks: analytic pairs on a fine mesh, against half as many elements along an edge.
///
/// # Errors
///
/// As [`radiosity::run`].
pub fn pairs_truth(scene: &Scene, fine: Subdivision, cells: u32) -> Result<Truth, Box<dyn Error>> {
    let strategy = |elements| Strategy { store: Store::Packed, ..Strategy::new(elements, Method::sampled(1e-8, 1)) };
    against_coarser(scene, (&strategy(fine), &strategy(coarser(fine))), cells)
}

/// The reference of a scene in which few surfaces block: exact pairs on elements with edges of at most `length` that nest in the cells, those cut by
/// contacts halved once more, against twice the length. Holds 2 bytes for each pair of elements.
///
/// # Errors
///
/// As [`radiosity::run`].
pub fn nested_pairs_truth(scene: &Scene, length: f64, cells: u32) -> Result<Truth, Box<dyn Error>> {
    let strategy = |length| {
        let mut strategy = Strategy::new(Subdivision::EdgeLength(length), Method::exact(1e-7, 1e-5));
        strategy.mesh.patches = Some(Subdivision::Uniform(cells));
        let verify = has_black(scene);
        Strategy { contact_level: 1, store: Store::PackedSingle, unshot: 1e-7, verify, ..strategy }
    };
    against_coarser(scene, (&strategy(length), &strategy(2.0 * length)), cells)
}

/// The reference of a scene in which hundreds of surfaces block: rows of `rays` rays and exact emitters on elements that nest as in
/// [`nested_pairs_truth`], against twice the length and half the rays of another seed.
///
/// # Errors
///
/// As [`radiosity::run`].
pub fn nested_rays_truth(scene: &Scene, length: f64, rays: u32, cells: u32) -> Result<Truth, Box<dyn Error>> {
    let strategy = |length, rays, seed| {
        let mut strategy = Strategy::new(Subdivision::EdgeLength(length), Method::RaysAndEmitters { rays });
        strategy.mesh.patches = Some(Subdivision::Uniform(cells));
        Strategy { contact_level: 1, store: Store::Sparse, unshot: 1e-5, verify: has_black(scene), seed, ..strategy }
    };
    against_coarser(scene, (&strategy(length, rays, 1), &strategy(2.0 * length, rays / 2, 2)), cells)
}

/// Whether some surface is black in a band: without a last product the irradiance of its elements is not known.
fn has_black(scene: &Scene) -> bool {
    let of = |surface: &radiosity_geometry::Surface| &scene.materials[surface.material].reflectance;
    scene.surfaces.iter().any(|surface| of(surface).contains(&0.0))
}

/// The irradiance of the first strategy, and the difference of the second from it.
fn against_coarser(scene: &Scene, (fine, coarse): (&Strategy, &Strategy), cells: u32) -> Result<Truth, Box<dyn Error>> {
    let grid = |strategy: &Strategy| -> Result<GridValues, Box<dyn Error>> {
        let run = radiosity::run(scene, strategy, &mut ())?;
        Ok(GridValues::means(&run.geometry, &run.solution.irradiance, cells)?)
    };
    let finest = grid(fine)?;
    let error = grid(coarse)?.error(&finest).rms;
    Ok(Truth { grid: finest, error })
}
