//! Mesh and strategy as the arguments ask for them, with what they leave open chosen by the size of the scene.

use radiosity::{DirectLight, Geometry, LINK_ERROR, Method, Plan, Shape, Size, Store, Strategy, admit, default_method};
use radiosity_geometry::mesh::{MeshSettings, Subdivision};
use radiosity_geometry::{Occluders, Scene};

use super::HIERARCHICAL;
use crate::args::{Common, Estimator, MeshArgs, SolveArgs, StoreName};
use crate::{Failure, memory, output};

/// Cells along an edge of a face if nothing is asked for.
pub(super) const CELLS: u32 = 4;

/// Part of a tolerance that dropped pairs may take, and bounces that are not followed.
const SHARE: f64 = 0.1;

/// Part of a tolerance that links may take.
const SHARE_OF_LINKS: f64 = 0.3;

/// Estimated error at which a solver that samples stops if nothing is asked for.
const SAMPLED_ERROR: f64 = 1e-2;

/// The mesh asked for; 4 × 4 elements a face if nothing is.
pub fn mesh_settings(mesh: &MeshArgs) -> MeshSettings {
    let elements = match (mesh.subdivide, mesh.element_size) {
        (Some(k), _) => Subdivision::Uniform(k),
        (None, Some(size)) => Subdivision::EdgeLength(size),
        (None, None) => Subdivision::Uniform(CELLS),
    };
    MeshSettings { elements, patches: mesh.patch_subdivide.map(Subdivision::Uniform), contacts: true }
}

/// The strategy asked for, with what is not asked for chosen by the number of elements and of polygons that may block.
pub fn strategy(
    (elements, blocking): (usize, usize),
    mesh: MeshSettings,
    estimator: &Estimator,
    common: &Common,
) -> Strategy {
    let (seed, memory) = (common.seed, memory::limit(common));
    let method = estimator.method(default_method(elements, blocking), blocking);
    let substructured = mesh.patches.is_some();
    let mut strategy = Strategy { mesh, seed, memory, ..Strategy::new(Subdivision::Uniform(1), method) };
    if substructured {
        strategy.shape = Shape::ElementsToPatches;
        "gauss-seidel".clone_into(&mut strategy.solver);
    }
    strategy
}

/// Elements that take part, and polygons that may block.
pub fn sizes(geometry: &Geometry<'_>) -> (usize, usize) {
    (geometry.elements().len(), geometry.blockers().len())
}

/// The strategy by what is known before there is a mesh, with what `planned` leaves out, `choose` its store. Refuses what would take too much memory: of a dry run, the mesh alone.
pub(super) fn admitted(
    args: &SolveArgs,
    scene: &Scene,
    mesh: MeshSettings,
    planned: &dyn Fn(Strategy) -> Strategy,
    choose: bool,
) -> Result<Strategy, Failure> {
    let cells = Size::before_meshing(scene, &mesh)?.elements as usize;
    let blocking = Occluders::blocking(scene).len();
    let mut strategy = strategy((cells, blocking), mesh, &args.estimator, &args.common);
    finish_strategy(&mut strategy, args, blocking);
    let mut strategy = planned(strategy);
    if choose && !by_links(args) {
        strategy.store = Plan::new(scene, &strategy).store_before_meshing(scene, &strategy)?.store;
    }
    strategy.check()?;
    if args.common.dry_run {
        admitted_mesh(scene, &strategy)?;
    } else {
        admit(scene, &strategy).map_err(memory::explained)?;
    }
    Ok(strategy)
}

/// Refuses a mesh that would take too much memory whatever is done on it.
pub fn admitted_mesh(scene: &Scene, strategy: &Strategy) -> Result<(), Failure> {
    let method = Method::ANALYTIC;
    let least = Strategy { store: Store::KeepNone, solver: "shooting".to_owned(), method, ..strategy.clone() };
    admit(scene, &least).map_err(memory::explained)
}

/// Whether links are asked for.
pub(super) fn by_links(args: &SolveArgs) -> bool {
    args.solver.as_deref() == Some(HIERARCHICAL) || args.store == Some(StoreName::Hierarchical)
}

/// Store, repair, stopping and solver as asked for, among `blocking` polygons that may block.
pub(super) fn finish_strategy(strategy: &mut Strategy, args: &SolveArgs, blocking: usize) {
    (strategy.steps, strategy.repair) = (args.steps.into(), args.repair);
    strategy.store = args.store.map_or(Store::Dense, Store::from);
    strategy.forecast = if args.forecast { output::FORECAST } else { 0 };
    if args.repair && strategy.shape == Shape::Full {
        // What is repaired is symmetric.
        "cg".clone_into(&mut strategy.solver);
    }
    if by_links(args) {
        let share = args.tolerance.map(|tolerance| SHARE_OF_LINKS * tolerance);
        let error = args.link_error.or(share).unwrap_or(LINK_ERROR);
        strategy.store = Store::Hierarchical { error, direct: DirectLight::WhereFew };
        strategy.method = args.estimator.method(Method::of_links_among(blocking), blocking);
        "cg".clone_into(&mut strategy.solver);
    }
    if let Some(solver) = args.solver.as_ref().filter(|solver| *solver != HIERARCHICAL) {
        strategy.solver.clone_from(solver);
        if matches!(solver.as_str(), "shooting" | "stochastic") && strategy.shape == Shape::ElementsToPatches {
            strategy.shape = Shape::PatchesToElements;
        } else if matches!(solver.as_str(), "direct" | "cg") && strategy.shape == Shape::ElementsToPatches {
            strategy.shape = Shape::TwoLevel;
        }
    }
    if !args.plan.keep_everything {
        let share = args.tolerance.map(|tolerance| SHARE * tolerance);
        strategy.thin = args.thin_error.or(share);
        strategy.bounces = args.bounce_error.or(share.filter(|_| args.unshot.is_none()));
    }
    strategy.unshot = args.unshot.unwrap_or(if strategy.samples() { SAMPLED_ERROR } else { strategy.unshot });
}
