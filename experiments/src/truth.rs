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
use radiosity_core::{BandValues, Form, StopRule, System, solve};
use radiosity_form_factors::analytic::Analytic;
use radiosity_form_factors::ray_cast::RayCast;
use radiosity_form_factors::stores::DenseFormFactors;
use radiosity_form_factors::{PairwiseRows, Receivers, Rows};
use radiosity_geometry::mesh::{MeshSettings, Subdivision};
use radiosity_geometry::{Facets, Scene};
use radiosity_solvers::GaussSeidel;

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
        Strategy { contact_level: 1, store: Store::PackedSingle, unshot: 1e-7, verify: false, ..strategy }
    };
    against_coarser(scene, (&strategy(length), &strategy(2.0 * length)), cells)
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
