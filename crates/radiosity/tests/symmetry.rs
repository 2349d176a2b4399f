//! Rows that mirror others are copied where that changes no answer, and the rows and form factors that are saved are those predicted.

use glam::DVec3;
use radiosity::plan::{Omission, Omissions, Savings};
use radiosity::{Method, Plan, Run, Shape, Store, Strategy, run};
use radiosity_core::{BandValues, Outcome};
use radiosity_gallery::boxes::{box_in_cube, empty_box, faces, material, scene_of_loops, unit_cube};
use radiosity_gallery::rooms::two_rooms;
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::{MeshSettings, Subdivision};

fn strategy(k: u32) -> Strategy {
    let omit = Omission::Symmetry.into();
    Strategy { unshot: 1e-14, omit, ..Strategy::new(Subdivision::Uniform(k), Method::ANALYTIC) }
}

fn in_form(k: u32, shape: Shape, solver: &str) -> Strategy {
    let mesh =
        MeshSettings { elements: Subdivision::Uniform(k), patches: Some(Subdivision::Uniform(2)), contacts: true };
    Strategy { mesh, shape, solver: solver.to_owned(), ..strategy(k) }
}

/// The inside of a box of which each face reflects otherwise and one emits: form factors do not know of it.
fn painted(size: [f64; 3]) -> Scene {
    let loops = faces(DVec3::new(0.3, -1.1, 2.7), DVec3::new(0.3, -1.1, 2.7) + DVec3::from(size), true);
    let materials = (0..6).map(|k| material("paint", 0.2 + 0.1 * f64::from(k), if k == 3 { 1.0 } else { 0.0 }));
    scene_of_loops(&(0..).zip(loops).map(|(k, face)| (face, k)).collect::<Vec<_>>(), materials.collect())
}

/// A room over a floor with these corners, 1.3 high.
fn over(floor: &[[f64; 2]]) -> Scene {
    let at = |z: f64| -> Vec<DVec3> { floor.iter().map(|[x, y]| DVec3::new(*x, *y, z)).collect() };
    let (low, mut high) = (at(0.0), at(1.3));
    let n = low.len();
    let wall = |k: usize| (vec![low[(k + 1) % n], low[k], high[k], high[(k + 1) % n]], 0);
    let mut loops: Vec<_> = (0..n).map(wall).collect();
    high.reverse();
    loops.extend([(low, 0), (high, 1)]);
    scene_of_loops(&loops, vec![material("grey", 0.5, 0.0), material("lamp", 0.3, 1.0)])
}

/// Largest |difference| over the largest value.
fn difference(a: &BandValues, b: &BandValues) -> f64 {
    assert_eq!((a.count(), a.len()), (b.count(), b.len()));
    let largest = a.values().iter().copied().fold(0.0, f64::max);
    a.values().iter().zip(b.values()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / largest
}

/// The run that computes all rows and the one that copies, which agree to 1e-12 and in what was predicted.
fn both<'a>(scene: &'a Scene, strategy: &Strategy) -> [Run<'a>; 2] {
    let everything = Strategy { omit: Omissions::NONE, ..strategy.clone() };
    let runs = [&everything, strategy].map(|strategy| run(scene, strategy, &mut ()).unwrap());
    let [whole, planned] = &runs;
    assert_eq!(planned.solution.outcome, Outcome::Converged);
    let (h, b) = (&whole.solution.irradiance, &whole.solution.radiosity);
    let differences =
        [(h, &planned.solution.irradiance), (b, &planned.solution.radiosity)].map(|(a, b)| difference(a, b));
    assert!(differences.iter().all(|d| *d < 1e-12), "{strategy:?}: {differences:?}");
    let left = &planned.left_out;
    assert_eq!(left.list.iter().map(|left| left.omission).collect::<Vec<_>>(), [Omission::Symmetry]);
    assert_eq!(Some(left.predicted), left.measured);
    let (all, some) = (whole.cost(), planned.cost());
    assert_eq!(left.predicted.form_factors, Some(all.form_factors - some.form_factors));
    assert_eq!(left.predicted.rows, Some(all.source_evaluations - some.source_evaluations));
    assert_eq!((all.entries, whole.stored_bytes), (some.entries, planned.stored_bytes));
    runs
}

fn uses_none(scene: &Scene, strategy: &Strategy) {
    let everything = Strategy { omit: Omissions::NONE, ..strategy.clone() };
    let [whole, planned] = [&everything, strategy].map(|strategy| run(scene, strategy, &mut ()).unwrap());
    assert_eq!(planned.left_out, Savings::default());
    assert_eq!(planned.solution.radiosity, whole.solution.radiosity);
    assert_eq!(planned.cost(), whole.cost());
}

/// The rows of elements that are first in their orbits. In a cube those of an eighth of a face between a side's middle and its diagonal, in a box a
/// quarter of three faces, with a square end that quarter of one side and an eighth of the end.
#[test]
fn one_row_of_each_orbit_is_computed() {
    let (even, odd, tube) = (6, 5, [4.0, 1.0, 1.0]);
    for (size, k, rows) in [
        ([1.0; 3], even, 6),
        ([1.0; 3], odd, 6),
        ([3.0, 2.0, 1.1], even, 27),
        ([3.0, 2.0, 1.1], odd, 27),
        (tube, even, 9 + 6),
        (tube, odd, 9 + 6),
    ] {
        let scene = painted(size);
        for store in [Store::Dense, Store::Packed, Store::PackedSingle] {
            let [whole, planned] = both(&scene, &Strategy { store, ..strategy(k) });
            assert_eq!(planned.cost().source_evaluations, rows, "{size:?} {k}");
            // Of 48 images of a pair in a cube, and 8 in a box, one remains but on planes of symmetry.
            let images = whole.cost().form_factors as f64 / planned.cost().form_factors as f64;
            let order = if size == [1.0; 3] {
                48.0
            } else if size == tube {
                16.0
            } else {
                8.0
            };
            assert!(images > 0.5 * order && images <= order, "{size:?} {k}: {images}");
        }
    }
}

/// 1,350 and 2,166 elements: rows of several tiles.
#[test]
fn stores_of_many_tiles_are_filled_alike() {
    for (size, k) in [([1.0; 3], 15), ([1.3, 0.7, 1.1], 19)] {
        for store in [Store::Dense, Store::Packed, Store::PackedSingle] {
            both(&painted(size), &Strategy { store, ..strategy(k) });
        }
    }
}

#[test]
fn patches_have_symmetries_of_their_own() {
    let scene = painted([1.0; 3]);
    for strategy in [
        in_form(6, Shape::ElementsToPatches, "gauss-seidel"),
        in_form(6, Shape::PatchesToElements, "shooting"),
        in_form(6, Shape::TwoLevel, "cg"),
        Strategy { store: Store::Sparse, ..in_form(6, Shape::TwoLevel, "direct") },
    ] {
        let [_, planned] = both(&scene, &strategy);
        let rows = if strategy.shape == Shape::PatchesToElements { 1 } else { 6 };
        assert_eq!(planned.cost().source_evaluations, rows, "{:?}", strategy.shape);
    }
}

/// Walls at angles, quadrilaterals that are no rectangles, and floors of other corners, which are cut into parts that mirror each other.
#[test]
fn rooms_that_are_no_boxes_have_symmetries() {
    let frustum = {
        let ring = |r: f64, z: f64| [[-r, -r], [r, -r], [r, r], [-r, r]].map(|[x, y]| DVec3::new(x, y, z));
        let (low, mut high) = (ring(1.0, 0.0), ring(0.6, 0.9));
        let wall = |k: usize| (vec![low[(k + 1) % 4], low[k], high[k], high[(k + 1) % 4]], 0);
        let mut loops: Vec<_> = (0..4).map(wall).collect();
        high.reverse();
        loops.extend([(low.to_vec(), 0), (high.to_vec(), 1)]);
        scene_of_loops(&loops, vec![material("grey", 0.5, 0.0), material("lamp", 0.3, 1.0)])
    };
    let trapezium = over(&[[-1.0, 0.0], [1.0, 0.0], [0.4, 0.9], [-0.4, 0.9]]);
    for (scene, order) in [(frustum, 8.0), (trapezium, 4.0)] {
        let [whole, planned] = both(&scene, &strategy(4));
        let images = whole.cost().form_factors as f64 / planned.cost().form_factors as f64;
        assert!(images > 0.6 * order && images <= order, "{images} of {order}");
    }
}

/// The rule for triangles begins at a corner, which mirrors of a triangle do not keep: copies are off by as much as is asked for.
#[test]
fn triangles_are_copied_where_their_first_corners_are_or_rounding_is_asked_for() {
    let triangle = over(&[[0.0, 0.0], [1.0, 0.0], [0.5, 0.7]]);
    uses_none(&triangle, &strategy(4));
    let [whole, planned] = both(&triangle, &Strategy { method: Method::exact(1e-12, 1e-12), ..strategy(4) });
    let images = whole.cost().form_factors as f64 / planned.cost().form_factors as f64;
    assert!(images > 3.0 && images <= 4.0, "{images}");
    // Half a turn about the ridge takes one end of a tent to the other, corner by corner.
    let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    let (floor, roof) = ([at(-1.0, -1.0, 0.0), at(1.0, -1.0, 0.0), at(1.0, 1.0, 0.0), at(-1.0, 1.0, 0.0)], 1.2);
    let half = |k: usize| {
        let turned = |v: DVec3| if k == 0 { v } else { at(-v.x, -v.y, v.z) };
        let end = [at(1.0, -1.0, 0.0), at(-1.0, -1.0, 0.0), at(0.0, -1.0, roof)];
        let side = [at(1.0, 1.0, 0.0), at(1.0, -1.0, 0.0), at(0.0, -1.0, roof), at(0.0, 1.0, roof)];
        [(end.map(turned).to_vec(), 0), (side.map(turned).to_vec(), k)]
    };
    let loops: Vec<_> = (0..2).flat_map(half).chain([(floor.to_vec(), 0)]).collect();
    let tent = scene_of_loops(&loops, vec![material("grey", 0.5, 0.0), material("lamp", 0.3, 1.0)]);
    let [whole, planned] = both(&tent, &strategy(3));
    let images = whole.cost().form_factors as f64 / planned.cost().form_factors as f64;
    assert!(images > 1.8 && images <= 2.0, "{images}");
}

/// 10⁻⁹ of the size moves one corner, or one element's edge: nothing is exact any more.
#[test]
fn a_scene_that_is_nearly_symmetric_is_not() {
    let mut loops = faces(DVec3::ZERO, DVec3::ONE, true);
    for face in &mut loops {
        face.iter_mut().filter(|v| **v == DVec3::ONE).for_each(|v| *v += DVec3::new(1e-9, 2e-9, 0.0));
    }
    let loops: Vec<_> = (0..).zip(loops).map(|(k, face)| (face, usize::from(k == 5))).collect();
    let materials = || vec![material("grey", 0.5, 0.0), material("lamp", 0.3, 1.0)];
    // Planar within their thickness, as files have them.
    uses_none(&scene_of_loops(&loops, materials()), &strategy(3));
    // The same to rounding is the same.
    let mut askew = faces(DVec3::ZERO, DVec3::ONE, true);
    askew.iter_mut().flatten().filter(|v| **v == DVec3::ONE).for_each(|v| v.x += f64::EPSILON);
    let askew: Vec<_> = (0..).zip(askew).map(|(k, face)| (face, usize::from(k == 5))).collect();
    let scene = scene_of_loops(&askew, materials());
    let [_, planned] = both(&scene, &strategy(3));
    assert_eq!(planned.cost().source_evaluations, 3);
}

/// Where something lies between, copies are as good as what is asked for: exact only if that is.
#[test]
fn pairs_that_something_blocks_are_copied_only_where_rounding_is_asked_for() {
    let scene = box_in_cube(0.4, material("room", 0.5, 0.0), material("box", 0.3, 1.0));
    let exact = Strategy { method: Method::exact(1e-12, 1e-12), ..strategy(3) };
    let [_, planned] = both(&scene, &exact);
    assert!(planned.cost().partial_pairs > 0);
    // Three of each cube's faces: corner, side and middle.
    assert_eq!(planned.cost().source_evaluations, 6);
    uses_none(&scene, &strategy(3));
    uses_none(&scene, &Strategy { method: Method::sampled(1e-12, 64), ..strategy(3) });
}

/// A box off the middle leaves the plane through both middles.
#[test]
fn blockers_have_to_be_symmetric_as_well() {
    let cube = faces(DVec3::ZERO, DVec3::ONE, true).into_iter().map(|face| (face, 0));
    let inner = faces(DVec3::new(0.3, 0.2, 0.0), DVec3::new(0.7, 0.5, 0.3), false).into_iter().map(|face| (face, 1));
    let scene = scene_of_loops(
        &cube.chain(inner).collect::<Vec<_>>(),
        vec![material("room", 0.5, 0.0), material("box", 0.3, 1.0)],
    );
    let [whole, planned] = both(&scene, &Strategy { method: Method::exact(1e-12, 1e-12), ..strategy(2) });
    let share = planned.cost().form_factors as f64 / whole.cost().form_factors as f64;
    assert!(share > 0.4 && share < 0.6, "{share}");
}

#[test]
fn rows_of_rays_lists_and_stores_that_compute_again_are_left_alone() {
    let scene = unit_cube(material("grey", 0.5, 1.0));
    let plain = strategy(3);
    for strategy in [
        Strategy { store: Store::Sparse, ..plain.clone() },
        Strategy { store: Store::KeepAll, ..plain.clone() },
        Strategy { method: Method::rays(32), solver: "gauss-seidel".to_owned(), ..plain.clone() },
        Strategy { method: Method::HEMICUBE, solver: "gauss-seidel".to_owned(), ..plain.clone() },
        Strategy { omit: Omissions::ALL - Omission::Symmetry.into(), ..plain.clone() },
    ] {
        let run = run(&scene, &strategy, &mut ()).unwrap();
        assert_eq!(run.left_out, Savings::default());
    }
    // Nothing lies between the walls, so that nothing would be sampled.
    let sampled = Strategy { method: Method::sampled(1e-10, 64), ..plain };
    assert_eq!(both(&scene, &sampled)[1].cost().source_evaluations, 3);
}

/// Two rooms are two systems, each with the symmetries of a box; what a plan says before the run is what it says after it.
#[test]
fn rooms_apart_have_each_their_own() {
    let scene = two_rooms([true, true]);
    let strategy = Strategy { omit: Omissions::ALL, ..strategy(4) };
    let everything = Strategy { omit: Omissions::NONE, ..strategy.clone() };
    let [whole, planned] = [&everything, &strategy].map(|strategy| run(&scene, strategy, &mut ()).unwrap());
    assert!(difference(&whole.solution.irradiance, &planned.solution.irradiance) < 1e-12);
    assert_eq!(Some(planned.left_out.predicted), planned.left_out.measured);
    assert_eq!(planned.cost().source_evaluations, 2 * 3 * 4);
    let plan = Plan::new(&scene, &strategy);
    let geometry = plan.mesh(&scene, &strategy).unwrap();
    let said = plan.left_out(&geometry, &strategy);
    assert_eq!((said.list, said.predicted), (planned.left_out.list, planned.left_out.predicted));
}

#[test]
fn copies_have_the_same_bytes_in_pools_of_1_2_and_8_threads() {
    let scene = empty_box([1.3, 0.7, 1.1], material("grey", 0.5, 1.0));
    for store in [Store::Dense, Store::Packed, Store::PackedSingle] {
        let strategy = Strategy { store, ..strategy(9) };
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let run = pool.install(|| run(&scene, &strategy, &mut ()).unwrap());
            (run.solution.radiosity.clone(), run.cost(), run.checked.unwrap().checks)
        };
        let one = run(1);
        assert!(one == run(2) && one == run(8), "{}", store.name());
    }
}
