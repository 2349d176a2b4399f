//! A view as what is asked for: its importance, bounds that are of its picture, and work that it does not need.

mod common;

use glam::DVec3;
use radiosity::plan::{Omissions, Role};
use radiosity::{Adaptive, DirectLight, Goal, GridValues, Importance, Method, Plan, Run, Store, Strategy};
use radiosity::{assemble, run, run_adaptive, run_to_tolerance, surfaces_in_view, view_weights};
use radiosity_core::{Form, StopRule, System};
use radiosity_gallery::rooms::{black_floor, one_room, two_rooms};
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::Subdivision;
use radiosity_render::Camera;

/// K × K elements a face, solved to rounding, omissions allowed.
fn strategy(k: u32) -> Strategy {
    Strategy {
        unshot: 1e-13,
        omit: Omissions::ALL,
        ..Strategy::new(Subdivision::Uniform(k), Method::exact(1e-9, 1e-7))
    }
}

/// From above the floor of the first of `two_rooms` into the corner of floor and back wall, not the ceiling.
fn down() -> Camera {
    Camera::new(DVec3::new(0.4, 0.5, 1.6), DVec3::new(2.0, 3.5, 0.0), DVec3::Z, 50.0, 60, 40).unwrap()
}

/// In the Cornell box, at the floor before the short block and a part of that.
fn close() -> Camera {
    Camera::new(DVec3::new(300.0, 200.0, 20.0), DVec3::new(180.0, 0.0, 150.0), DVec3::Y, 45.0, 80, 60).unwrap()
}

/// In the Cornell box, at the short block.
fn block() -> Camera {
    Camera::new(DVec3::new(278.0, 273.0, -400.0), DVec3::new(190.0, 100.0, 150.0), DVec3::Y, 18.0, 80, 60).unwrap()
}

fn seen(run: &Run<'_>, camera: &Camera) -> GridValues {
    GridValues::seen(&run.geometry, &run.solution.irradiance, camera)
}

/// Both sides are sums of the same products, solved to 1e-14; so is the mean of the picture.
#[test]
fn the_mean_of_a_picture_is_what_its_importance_makes_of_the_emission() {
    for (scene, camera) in [(one_room(), down()), (common::cornell_box(), close())] {
        let run = run(&scene, &Strategy { omit: Omissions::NONE, ..strategy(4) }, &mut ()).unwrap();
        let (store, _) = assemble(&run.geometry, Method::exact(1e-9, 1e-7), Form::Full, Store::Dense, 1).unwrap();
        let (areas, e, rho) = (run.geometry.elements().areas(), run.geometry.emission(), run.geometry.reflectance());
        let system = System::full(&*store, &areas, e.view(), rho.view()).unwrap();
        let weights = view_weights(&run.geometry, &camera);
        let (importance, _) = Importance::weighted(&system, &weights, "cg", &StopRule::unshot(1e-14)).unwrap();
        let picture = seen(&run, &camera);
        for b in 0..e.count() {
            let inner = |x: &[f64], y: &[f64]| -> f64 { areas.iter().zip(x).zip(y).map(|((a, x), y)| a * x * y).sum() };
            let direct = inner(weights.band(b), run.solution.irradiance.band(b));
            let adjoint = inner(importance.of_emission.band(b), e.band(b));
            let shown = picture.values.band(b).iter().sum::<f64>() / picture.areas.len() as f64;
            assert!((direct / adjoint - 1.0).abs() < 1e-12, "band {b}: {direct} and {adjoint}");
            assert!((direct / shown - 1.0).abs() < 1e-12, "band {b}: {direct} and {shown}");
        }
    }
}

/// The bound is of the rms over pixels, relative to their mean; pairs err by up to 1e-7 themselves.
#[test]
fn bounds_are_of_the_picture_where_a_view_is_asked_for() {
    let far = Camera::new(DVec3::new(1.0, 0.1, 1.5), DVec3::new(2.9, 3.9, 0.1), DVec3::Z, 8.0, 30, 30).unwrap();
    for (scene, camera, k) in [(one_room(), down(), 8), (black_floor(), far, 6), (common::cornell_box(), close(), 5)] {
        let whole = run(&scene, &strategy(k), &mut ()).unwrap();
        for (thin, bounces) in [(Some(0.1), None), (Some(0.02), None), (None, Some(0.1)), (None, Some(0.01))] {
            let view = Some(camera.clone());
            let asked = Strategy { thin, bounces, view, solver: "jacobi".to_owned(), ..strategy(k) };
            let some = run(&scene, &asked, &mut ()).unwrap();
            let bound = some.bounded_error().unwrap();
            let change = seen(&some, &camera).error(&seen(&whole, &camera)).rms;
            println!("{thin:?} {bounces:?}: {change:.2e} ≤ {bound:.2e}");
            assert!(change <= bound + 1e-7 && bound.is_finite(), "{thin:?} {bounces:?}: {change:e} and {bound:e}");
            assert!(bounces.is_none_or(|error| bound <= error), "{bound:e}");
        }
    }
}

/// Rows that refinement computes, by the room they are in: the one that is not seen gets those of the first mesh.
#[test]
fn a_room_that_is_not_seen_is_hardly_refined() {
    let scene = two_rooms([true, true]);
    let camera = down();
    let fine = run(&scene, &Strategy { unshot: 1e-8, ..strategy(32) }, &mut ()).unwrap();
    let truth = seen(&fine, &camera);
    for tolerance in [0.05, 0.03] {
        let settings = Adaptive { most_elements: 6_000, ..Adaptive::new(Goal::Points, tolerance) };
        let all = Strategy { solver: "gauss-seidel".to_owned(), unshot: 1e-6, ..strategy(1) };
        let some = Strategy { view: Some(camera.clone()), ..all.clone() };
        let [all, some] = [all, some].map(|strategy| run_adaptive(&scene, &strategy, &settings).unwrap());
        let [whole, own] = [&all, &some].map(|run| seen(&run.run, &camera).error(&truth).rms);
        let [many, few] = [&all, &some].map(|run| run.run.form_factors.cost.form_factors);
        let elements = |room: bool| some.run.geometry.surfaces().iter().filter(|s| (**s < 6) == room).count();
        let estimate = some.rounds.last().unwrap().estimate;
        println!(
            "{tolerance}: {few} of {many} form factors, error {own:.2e} (estimate {:.2e}), {whole:.2e} of the whole; {} and {} elements",
            estimate.total(),
            elements(true),
            elements(false)
        );
        assert!(some.met && own <= tolerance, "{tolerance}: {own:e}, {estimate:?}");
        // 4 × 4 cells on each of six faces.
        assert!(elements(false) == 96 && elements(true) > 96);
        assert!(3 * few < many, "{tolerance}: {few} of {many}");
    }
}

/// A part of one room: what is not seen is refined by what it is worth to the picture.
#[test]
fn refinement_for_a_view_meets_its_tolerance_with_fewer_form_factors() {
    let (scene, camera) = (common::cornell_box(), block());
    // Four times as fine as what is to meet the tolerance, by links.
    let store = Store::Hierarchical { error: 0.005, direct: DirectLight::WhereFew };
    let fine = Strategy { store, unshot: 1e-6, ..Strategy::new(Subdivision::Uniform(48), Method::OF_LINKS) };
    let fine = run(&scene, &fine, &mut ()).unwrap();
    let truth = seen(&fine, &camera);
    let settings = Adaptive { most_elements: 3_000, ..Adaptive::new(Goal::Points, 0.1) };
    let all = Strategy {
        solver: "gauss-seidel".to_owned(),
        omit: Omissions::ALL,
        ..Strategy::new(Subdivision::Uniform(1), Method::exact(1e-8, 1e-5))
    };
    let some = Strategy { view: Some(camera.clone()), ..all.clone() };
    let [all, some] = [all, some].map(|strategy| run_adaptive(&scene, &strategy, &settings).unwrap());
    let [whole, own] = [&all, &some].map(|run| seen(&run.run, &camera).error(&truth).rms);
    let [many, few] = [&all, &some].map(|run| run.run.form_factors.cost.form_factors);
    let estimate = some.rounds.last().unwrap().estimate;
    println!("{few} of {many} form factors, error {own:.2e} ({estimate:?}), {whole:.2e} of the whole");
    assert!(some.met && own <= 0.1, "{own:e}");
    assert!(3 * few < 2 * many, "{few} of {many}");
}

#[test]
fn links_for_a_view_are_fewer_and_err_by_what_is_estimated_there() {
    let (scene, camera) = (common::cornell_box(), close());
    let exact = Strategy::new(Subdivision::Uniform(16), Method::exact(1e-6, 1e-5));
    let exact = run(&scene, &Strategy { unshot: 1e-6, ..exact }, &mut ()).unwrap();
    let store = Store::Hierarchical { error: 0.01, direct: DirectLight::WhereFew };
    let all = Strategy {
        store,
        unshot: 1e-6,
        omit: Omissions::ALL,
        ..Strategy::new(Subdivision::Uniform(16), Method::exact(1e-6, 1e-5))
    };
    let some = Strategy { view: Some(camera.clone()), ..all.clone() };
    let [all, some] = [all, some].map(|strategy| run(&scene, &strategy, &mut ()).unwrap());
    let reports = [&all, &some].map(|run| run.hierarchical.clone().unwrap());
    let [whole, own] = [&all, &some].map(|run| seen(run, &camera).error(&seen(&exact, &camera)).rms);
    println!("{} of {} links, error {own:.2e}, {whole:.2e} of the whole", reports[1].links, reports[0].links);
    assert!(own <= 0.01 && reports[1].error <= 0.01, "{own:e}, {reports:?}");
    assert!(10 * reports[1].links < 9 * reports[0].links, "{reports:?}");
}

/// Two meshes differ over the picture by what they differ there, and not elsewhere.
#[test]
fn a_tolerance_of_a_view_is_of_its_pixels() {
    let (scene, camera) = (one_room(), down());
    let asked = Strategy { view: Some(camera.clone()), unshot: 1e-8, ..strategy(1) };
    let done = run_to_tolerance(&scene, &asked, 0.1, 4, 2_000).unwrap();
    let before =
        run(&scene, &Strategy { unshot: 1e-8, ..strategy(done.steps.last().unwrap().subdivision / 2) }, &mut ());
    let apart = seen(&before.unwrap(), &camera).error(&seen(&done.run, &camera)).rms;
    let difference = done.steps.last().unwrap().difference.as_ref().unwrap().rms;
    assert!(done.met && (apart / difference - 1.0).abs() < 1e-6, "{apart} and {difference}");
}

/// A camera that looks up sees neither the black floor nor the sheet over it: they have no elements, and the picture is the same.
#[test]
fn what_sends_nothing_and_is_not_in_view_only_blocks() {
    let scene = black_floor();
    let up = Camera::new(DVec3::new(1.5, 2.0, 1.2), DVec3::new(1.5, 2.5, 2.0), DVec3::X, 60.0, 20, 20).unwrap();
    assert_eq!(surfaces_in_view(&scene, &up), [5]);
    let asked = Strategy { view: Some(up.clone()), ..strategy(5) };
    let plan = Plan::new(&scene, &asked);
    assert_eq!([plan.roles[4], plan.roles[6]], [Role::Blocks; 2]);
    let [some, all] = [asked, strategy(5)].map(|strategy| run(&scene, &strategy, &mut ()).unwrap());
    assert!(some.geometry.elements().len() < all.geometry.elements().len());
    assert!(seen(&some, &up).error(&seen(&all, &up)).worst < 1e-12);
    assert!(some.cost().form_factors < all.cost().form_factors);
}

/// A camera in the open that looks away: as if everything were asked for.
#[test]
fn a_view_of_nothing_asks_for_nothing_less() {
    let scene: Scene = one_room();
    let away = Camera::new(DVec3::new(9.0, 9.0, 9.0), DVec3::new(19.0, 9.0, 9.0), DVec3::Z, 40.0, 8, 8).unwrap();
    let whole = Strategy { bounces: Some(0.01), ..strategy(3) };
    let none = Strategy { view: Some(away), ..whole.clone() };
    let [whole, none] = [whole, none].map(|strategy| run(&scene, &strategy, &mut ()).unwrap());
    assert_eq!(none.solution.irradiance.band(0).len(), whole.solution.irradiance.band(0).len());
    assert!(none.bounded_error().unwrap() <= 0.01);
}

/// Rays of the pilot, rows and bounds are pieces of a fixed size: what is dropped and what is said of it are the same bytes.
#[test]
fn a_view_with_pairs_dropped_is_the_same_in_any_pool() {
    let scene = common::cornell_box();
    let asked = Strategy { view: Some(block()), thin: Some(0.1), bounces: Some(0.01), ..strategy(4) };
    let in_pool = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let run = pool.install(|| run(&scene, &asked, &mut ()).unwrap());
        (run.bounded.clone(), run.solution.irradiance)
    };
    let (bounded, irradiance) = in_pool(1);
    assert!(bounded[0].measured.unwrap() > 0 && bounded[0].bound.unwrap() <= 0.1);
    assert!((bounded, irradiance) == in_pool(3));
}
