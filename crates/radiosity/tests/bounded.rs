//! Omissions within an asked error: the bound lies above what they change, what was asked for above the bound, and the counts are those predicted.

mod common;

use glam::DVec3;
use radiosity::bounded::foreseen;
use radiosity::plan::{Omission, Omissions};
use radiosity::{Adaptive, DirectLight, Goal, Importance, Plan, RunError, assemble, run_adaptive};
use radiosity::{Bounded, GridValues, Method, Run, Shape, Solved, Store, Strategy, run};
use radiosity_core::{Form, Outcome, StopRule, System};
use radiosity_gallery::boxes::{faces, material, scene_of_loops};
use radiosity_gallery::rooms::{black_floor, one_room, two_rooms};
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::Subdivision;

/// K × K elements a face, solved to rounding, omissions allowed, but for copies of mirror images, which have all their pairs.
fn strategy(k: u32) -> Strategy {
    Strategy {
        unshot: 1e-13,
        omit: Omissions::ALL - Omission::Symmetry.into(),
        ..Strategy::new(Subdivision::Uniform(k), Method::exact(1e-9, 1e-7))
    }
}

/// rms difference of the irradiance of elements, relative to its mean over the scene, and that of report cells.
fn differences(a: &Run<'_>, b: &Run<'_>) -> [f64; 2] {
    let areas = a.geometry.elements().areas();
    let total: f64 = a.geometry.mesh().areas().iter().sum();
    let (x, y) = (&a.solution.irradiance, &b.solution.irradiance);
    let sum = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
        let band = |b: usize| areas.iter().zip(x.band(b)).zip(y.band(b)).map(|((a, x), y)| a * of(*x, *y)).sum::<f64>();
        (0..x.count()).map(band).sum::<f64>() / (x.count() as f64 * total)
    };
    let cells = |run: &Run<'_>| GridValues::means(&run.geometry, &run.solution.irradiance, 4).unwrap();
    [sum(&|x, y| (x - y).powi(2)).sqrt() / sum(&|_, y| y), cells(a).error(&cells(b)).rms]
}

fn only<'r>(run: &'r Run<'_>) -> &'r Bounded {
    assert_eq!(run.bounded.len(), 1);
    &run.bounded[0]
}

fn scenes() -> [(&'static str, Scene, u32); 4] {
    [
        ("one room", one_room(), 8),
        ("two rooms", two_rooms([true, true]), 6),
        ("black floor", black_floor(), 8),
        ("Cornell box", common::cornell_box(), 5),
    ]
}

/// 1e-7 is what partly blocked pairs err by.
#[test]
fn dropped_pairs_change_less_than_their_bound_and_that_is_less_than_was_asked_for() {
    for (name, scene, k) in scenes() {
        let whole = run(&scene, &strategy(k), &mut ()).unwrap();
        for error in [0.3, 0.03, 0.003] {
            for store in [Store::Dense, Store::Packed] {
                let thin = Strategy { thin: Some(error), store, ..strategy(k) };
                let thinned = run(&scene, &thin, &mut ()).unwrap();
                let omission = only(&thinned);
                let ([elements, cells], bound) = (differences(&thinned, &whole), omission.bound.unwrap());
                println!(
                    "{name} {error}: {elements:.2e} ≤ {bound:.2e} ≤ {:.2e}; {} pairs of {}",
                    omission.prior,
                    omission.predicted,
                    whole.cost().form_factors
                );
                assert!(
                    elements <= bound + 1e-7 && cells <= bound + 1e-7,
                    "{name}, {error}: {elements} and {cells}, {bound}"
                );
                assert!(bound <= error && omission.prior == error, "{name}, {error}: {bound}");
                let saved = whole.cost().form_factors - thinned.cost().form_factors;
                assert_eq!((omission.predicted, omission.measured), (saved, Some(saved)), "{name}, {error}");
                assert!(error < 0.03 || saved > 0, "{name}");
            }
        }
    }
}

/// Of 2,016 elements among nine boxes, 6 × 6 a face, half of the pairs go within 5 %: the scene is tight but not of matching edges, so that it counts as open.
#[test]
fn half_of_the_pairs_of_a_furnished_room_may_go_for_five_percent() {
    let scene = radiosity_gallery::crowded_room(9, 1);
    let plain = Strategy { store: Store::Packed, ..Strategy::new(Subdivision::Uniform(6), Method::sampled(1e-10, 16)) };
    let plain = Strategy { omit: Omissions::ALL, unshot: 1e-8, ..plain };
    let whole = run(&scene, &plain, &mut ()).unwrap();
    let thinned = run(&scene, &Strategy { thin: Some(0.05), ..plain }, &mut ()).unwrap();
    let ([elements, cells], bound) = (differences(&thinned, &whole), only(&thinned).bound.unwrap());
    let all = whole.cost().form_factors;
    println!("{} of {all} pairs; {elements:.2e} and {cells:.2e} ≤ {bound:.2e}", thinned.cost().form_factors);
    assert!(2 * thinned.cost().form_factors < all && bound <= 0.05);
    assert!(elements <= bound && cells <= bound);
}

/// What nobody can drop pairs of is refused with what to do instead; a run goes on without.
#[test]
fn strategies_that_drop_no_pairs_say_why() {
    let allowed = Strategy { thin: Some(0.1), ..strategy(2) };
    assert_eq!(allowed.check_thinning(), Ok(()));
    let gathers = Strategy { solver: "gauss-seidel".to_owned(), ..allowed.clone() };
    for (strategy, instead) in [
        (Strategy { method: Method::rays(64), ..gathers.clone() }, "analytic"),
        (Strategy { store: Store::KeepAll, ..gathers.clone() }, "packed"),
        (Strategy { shape: Shape::ElementsToPatches, ..gathers.clone() }, "patches"),
        (Strategy { repair: true, ..allowed.clone() }, "repair"),
    ] {
        let refused = strategy.check_thinning().unwrap_err().to_string();
        assert!(refused.contains(instead), "{refused}");
    }
    let scene = one_room();
    let kept = Solved::new(&scene, &allowed, &mut ()).err();
    assert!(matches!(kept, Some(RunError::Thin { .. })), "{kept:?}");
}

#[test]
fn rows_without_their_small_pairs_still_sum_to_one() {
    let scene = one_room();
    let strategy = Strategy { thin: Some(0.3), store: Store::Sparse, ..strategy(8) };
    let run = run(&scene, &strategy, &mut ()).unwrap();
    let checks = run.checked.unwrap().checks;
    assert!(checks.closure.unwrap().1.abs() < 1e-7 && checks.negative == 0);
    assert!(checks.reciprocity.is_none_or(|(.., apart)| apart == 0.0));
}

#[test]
fn nothing_is_dropped_where_everything_is_kept_or_rows_are_whole() {
    let scene = one_room();
    let allowed = Strategy { thin: Some(0.3), bounces: Some(0.3), ..strategy(4) };
    for strategy in [
        Strategy { method: Method::rays(64), bounces: None, ..allowed.clone() },
        Strategy { store: Store::KeepAll, bounces: None, ..allowed.clone() },
    ] {
        let strategy = Strategy { solver: "gauss-seidel".to_owned(), ..strategy };
        assert!(run(&scene, &strategy, &mut ()).unwrap().bounded.is_empty());
    }
    let refused = run(&scene, &Strategy { thin: Some(1.5), ..strategy(2) }, &mut ());
    assert!(refused.err().unwrap().to_string().contains("1.5"));
}

/// Jacobi's steps are bounces: as many as said, of those that the unshot share takes at most.
#[test]
fn bounces_left_out_change_less_than_their_bound_and_the_solver_stops_by_their_number() {
    for (name, scene, k) in scenes() {
        for solver in ["jacobi", "gauss-seidel", "cg"] {
            let strategy = Strategy { solver: solver.to_owned(), unshot: 1e-11, ..strategy(k.min(4)) };
            let whole = run(&scene, &strategy, &mut ()).unwrap();
            for error in [0.1, 0.01, 0.001] {
                let some = Strategy { bounces: Some(error), ..strategy.clone() };
                let some = run(&scene, &some, &mut ()).unwrap();
                assert_eq!(some.solution.outcome, Outcome::Converged);
                let omission = only(&some);
                let ([elements, cells], bound) = (differences(&some, &whole), omission.bound.unwrap());
                println!(
                    "{name} {solver} {error}: {elements:.2e} ≤ {bound:.2e}, {} of {} steps, {}",
                    some.solution.steps, whole.solution.steps, omission.what
                );
                assert!(
                    elements <= bound && cells <= bound && bound <= error * 1.5,
                    "{name}, {solver}, {error}: {elements}, {bound}"
                );
                assert!(some.solution.steps < whole.solution.steps);
                assert!(omission.measured.unwrap() >= omission.predicted, "{name}, {solver}, {error}");
            }
        }
    }
}

#[test]
fn bounds_of_several_omissions_add() {
    let scene = one_room();
    let whole = run(&scene, &strategy(6), &mut ()).unwrap();
    let some = Strategy { thin: Some(0.03), bounces: Some(0.01), ..strategy(6) };
    let some = run(&scene, &some, &mut ()).unwrap();
    let sum: f64 = some.bounded.iter().map(|omission| omission.bound.unwrap()).sum();
    assert_eq!((some.bounded.len(), some.bounded_error()), (2, Some(sum)));
    let [elements, cells] = differences(&some, &whole);
    assert!(elements <= sum && cells <= sum);
}

/// A corridor six times as long as wide: an end of this reflectance, surface 0, where only a hundredth of the light of the lamp at the other end arrives, and grey walls.
fn corridor(end: f64) -> Scene {
    let all = faces(DVec3::ZERO, DVec3::new(6.0, 1.0, 1.0), true).into_iter().zip([2, 0, 1, 1, 1, 1]);
    let loops: Vec<_> = all.collect();
    scene_of_loops(&loops, vec![material("lamp", 0.2, 5.0), material("walls", 0.6, 0.0), material("end", end, 0.0)])
}

/// What is little beside the light of a scene can be much beside that of one face: a bound relative to the scene lies below the face's error.
#[test]
fn bounds_are_of_the_face_that_is_asked_for_however_dim_it_is() {
    let mut beyond_that_of_all = 0;
    // A face that is an unknown, and one that is gathered at the end.
    for end in [0.3, 0.0] {
        let scene = corridor(end);
        let whole = run(&scene, &strategy(6), &mut ()).unwrap();
        let level = |run: &Run<'_>, asked: &[u32]| on(run, asked).level();
        assert!(4.0 * level(&whole, &[0]) < level(&whole, &[0, 1, 2, 3, 4, 5]));
        for (thin, bounces) in [(Some(0.1), None), (Some(0.01), None), (None, Some(0.1)), (None, Some(0.01))] {
            let all = Strategy { thin, bounces, solver: "jacobi".to_owned(), ..strategy(6) };
            let some = Strategy { asked: Some(vec![0]), ..all.clone() };
            let [all, some] = [all, some].map(|strategy| run(&scene, &strategy, &mut ()).unwrap());
            let errors = [&all, &some].map(|run| on(run, &[0]).error(&on(&whole, &[0])).rms);
            let bounds = [&all, &some].map(|run| run.bounded_error().unwrap());
            println!("{end} {thin:?} {bounces:?}: errors {errors:?}, bounds {bounds:?}");
            assert!(errors[1] <= bounds[1] && bounds[1].is_finite(), "{end} {thin:?} {bounces:?}");
            beyond_that_of_all += u32::from(errors[0] > bounds[0]);
            // The solver goes on until the error of the face is what is asked for; where the face is no unknown, to the end.
            if let Some(error) = bounces {
                assert!(bounds[1] <= error && some.solution.steps > all.solution.steps);
            }
        }
    }
    assert!(beyond_that_of_all > 0);
}

/// Nothing asked for, or a sheet inside a block, which has no exposed area: as if all were asked for.
#[test]
fn surfaces_without_exposed_area_are_as_good_as_not_asked_for() {
    let (size, top) = (DVec3::new(3.0, 4.0, 2.0), DVec3::new(2.0, 2.0, 1.0));
    let sheet = [(1.2, 1.2), (1.8, 1.2), (1.8, 1.8), (1.2, 1.8)].map(|(x, y)| DVec3::new(x, y, 0.5)).to_vec();
    let room = faces(DVec3::ZERO, size, true).into_iter().zip([0, 0, 0, 0, 0, 1]);
    let block = faces(DVec3::new(1.0, 1.0, 0.0), top, false).into_iter().chain([sheet]).map(|face| (face, 0));
    let loops: Vec<_> = room.chain(block).collect();
    let scene = scene_of_loops(&loops, vec![material("grey", 0.5, 0.0), material("lamp", 0.5, 3.0)]);
    let whole = run(&scene, &strategy(4), &mut ()).unwrap();
    assert!(!whole.geometry.surfaces().contains(&12));
    let links = Store::Hierarchical { error: 0.02, direct: DirectLight::WhereFew };
    for asked in [vec![], vec![12]] {
        let some = Strategy { asked: Some(asked.clone()), unshot: 1e-8, ..strategy(4) };
        let thinned = run(&scene, &Strategy { thin: Some(0.1), bounces: Some(0.01), ..some.clone() }, &mut ()).unwrap();
        assert!(thinned.bounded_error().unwrap().is_finite(), "{asked:?}");
        let by_links = Strategy { store: links, ..some.clone() };
        let everything = Strategy { asked: None, ..by_links.clone() };
        let [linked, all] = [&by_links, &everything].map(|strategy| run(&scene, strategy, &mut ()).unwrap());
        assert_eq!(linked.hierarchical, all.hierarchical, "{asked:?}");
        let settings = Adaptive { most_elements: 400, ..Adaptive::new(Goal::Cells(4), 0.05) };
        let some = Strategy { solver: "gauss-seidel".to_owned(), ..some };
        let everything = Strategy { asked: None, ..some.clone() };
        let [adapted, all] = [&some, &everything].map(|strategy| run_adaptive(&scene, strategy, &settings).unwrap());
        let estimate = adapted.rounds.last().unwrap().estimate;
        assert!(estimate.total().is_finite() && estimate.total() > 0.0, "{asked:?}: {estimate:?}");
        assert_eq!(estimate, all.rounds.last().unwrap().estimate, "{asked:?}");
    }
}

/// A black face gets what it gathers of what others may be off by: no more than twice what a grey one in its place is bounded by.
#[test]
fn the_bound_of_a_dim_black_face_is_as_sharp_as_that_of_a_grey_one() {
    for (thin, bounces) in [(Some(0.05), None), (None, Some(1e-3))] {
        let of = |end: f64| {
            let scene = corridor(end);
            let asked = Strategy { thin, bounces, asked: Some(vec![0]), ..strategy(6) };
            let asked = Strategy { solver: "jacobi".to_owned(), unshot: 1e-6, ..asked };
            run(&scene, &asked, &mut ()).unwrap().bounded_error().unwrap()
        };
        let (black, grey) = (of(0.0), of(1e-9));
        println!("{black:e} and {grey:e}");
        assert!(black <= 2.0 * grey, "{black} and {grey}");
    }
}

/// No light reaches the second room: nothing of it is off.
#[test]
fn what_no_light_reaches_is_exact() {
    let scene = two_rooms([true, false]);
    for (thin, bounces) in [(Some(0.1), None), (None, Some(0.1))] {
        let asked = Strategy { thin, bounces, asked: Some(vec![7, 8]), ..strategy(4) };
        let run = run(&scene, &asked, &mut ()).unwrap();
        assert_eq!(run.bounded_error(), Some(0.0), "{thin:?} {bounces:?}");
    }
}

/// One step is no solution of the system of the bound.
#[test]
fn a_bound_that_was_not_solved_for_is_none() {
    let scene = one_room();
    let run = run(&scene, &Strategy { thin: Some(0.1), steps: 1, ..strategy(6) }, &mut ()).unwrap();
    assert!(only(&run).measured.unwrap() > 0);
    assert_eq!((only(&run).bound, run.bounded_error()), (None, None));
}

#[test]
fn errors_that_cannot_be_asked_are_refused_and_other_settings_do_not_panic() {
    let scene = one_room();
    let settings = Adaptive::new(Goal::Points, 0.1);
    for error in [0.0, -0.1, 1.0, f64::NAN, f64::INFINITY] {
        for (thin, bounces) in [(Some(error), None), (None, Some(error))] {
            let solver = "gauss-seidel".to_owned();
            let asked = Strategy { thin, bounces, solver, ..strategy(2) };
            let refusals = [
                asked.check().err(),
                run(&scene, &asked, &mut ()).err(),
                run_adaptive(&scene, &asked, &settings).err(),
            ];
            for refused in refusals {
                assert!(matches!(refused, Some(RunError::Tolerance { value }) if value.to_bits() == error.to_bits()));
            }
            let plan = Plan::new(&scene, &asked);
            assert!(foreseen(&plan, &plan.mesh(&scene, &asked).unwrap(), &asked).is_empty());
        }
    }
    // To no unshot share, in so many steps.
    let endless = Strategy { bounces: Some(0.1), unshot: 0.0, steps: 40, ..strategy(2) };
    let omission = run(&scene, &endless, &mut ()).unwrap().bounded.remove(0);
    assert!(omission.bound.unwrap() <= 0.1 && omission.predicted < 40, "{omission:?}");
    // Walls that lose nothing make no system, and it is the system that says so.
    let mut lossless = one_room();
    lossless.materials.iter_mut().for_each(|material| material.reflectance.fill(1.0));
    let both = Strategy { thin: Some(0.1), bounces: Some(0.1), ..strategy(2) };
    let plan = Plan::new(&lossless, &both);
    assert_eq!(foreseen(&plan, &plan.mesh(&lossless, &both).unwrap(), &both).len(), 1);
    assert!(matches!(run(&lossless, &both, &mut ()).err(), Some(RunError::System(_))));
}

/// The adjoint by the light of the asked surfaces: both sides are sums of the same products, solved to 1e-14.
#[test]
fn what_is_asked_for_is_what_importance_makes_of_the_emission() {
    let scene = one_room();
    let run = run(&scene, &Strategy { omit: Omissions::NONE, ..strategy(4) }, &mut ()).unwrap();
    let (store, _) = assemble(&run.geometry, Method::exact(1e-9, 1e-7), Form::Full, Store::Dense, 1).unwrap();
    let (areas, e, rho) = (run.geometry.elements().areas(), run.geometry.emission(), run.geometry.reflectance());
    let system = System::full(&*store, &areas, e.view(), rho.view()).unwrap();
    let stop = StopRule::unshot(1e-14);
    let asked: Vec<f64> = run.geometry.surfaces().iter().map(|&s| if s == 1 { 1.0 } else { 0.0 }).collect();
    let (importance, _) = Importance::new(&system, &asked, "cg", &stop).unwrap();
    for b in 0..e.count() {
        let inner = |x: &[f64], y: &[f64]| -> f64 { areas.iter().zip(x).zip(y).map(|((a, x), y)| a * x * y).sum() };
        let (direct, adjoint) =
            (inner(&asked, run.solution.irradiance.band(b)), inner(importance.of_emission.band(b), e.band(b)));
        assert!((direct / adjoint - 1.0).abs() < 1e-12, "band {b}: {direct} and {adjoint}");
        // An error in what is asked for counts once, and by what comes back of it.
        assert!(importance.of_irradiance.band(b).iter().zip(&asked).all(|(y, w)| y >= w));
    }
}

fn on(run: &Run<'_>, asked: &[u32]) -> GridValues {
    GridValues::means(&run.geometry, &run.solution.irradiance, 8).unwrap().on(asked)
}

/// The floor of the Cornell box, the wall behind its blocks, or the one at their side: what is computed less is the rows of other faces and the
/// patches they would need.
#[test]
fn refinement_for_a_wall_meets_its_tolerance_with_fewer_form_factors() {
    let scene = common::cornell_box();
    // Elements of 1/16 that all see each other.
    let fine = Strategy::new(Subdivision::Uniform(16), Method::exact(1e-7, 1e-5));
    let fine = run(&scene, &fine, &mut ()).unwrap();
    for asked in [vec![0], vec![6]] {
        let truth = on(&fine, &asked);
        for tolerance in [0.05, 0.02] {
            let settings = Adaptive::new(Goal::Cells(8), tolerance);
            let solver = "gauss-seidel".to_owned();
            let all = Strategy {
                solver,
                omit: Omissions::ALL,
                ..Strategy::new(Subdivision::Uniform(1), Method::exact(1e-8, 1e-5))
            };
            let some = Strategy { asked: Some(asked.clone()), ..all.clone() };
            let [all, some] = [all, some].map(|strategy| run_adaptive(&scene, &strategy, &settings).unwrap());
            let [whole, own] = [&all, &some].map(|run| on(&run.run, &asked).error(&truth).rms);
            let [many, few] = [&all, &some].map(|run| run.run.form_factors.cost.form_factors);
            let estimate = some.rounds.last().unwrap().estimate.total();
            println!(
                "{asked:?} to {tolerance}: {few} of {many} form factors, error {own:.2e} (estimate {estimate:.2e}), {whole:.2e} of the whole"
            );
            assert!(some.met && own <= tolerance && estimate <= tolerance, "{asked:?}, {tolerance}: {own:e}");
            assert!(2 * few < many, "{asked:?}, {tolerance}: {few} of {many}");
        }
    }
}

/// Fewer links meet the same error over what is asked for.
#[test]
fn links_for_a_wall_are_fewer_and_err_by_what_is_estimated_there() {
    let scene = common::cornell_box();
    let exact = Strategy::new(Subdivision::Uniform(16), Method::exact(1e-6, 1e-5));
    let exact = run(&scene, &Strategy { unshot: 1e-6, ..exact }, &mut ()).unwrap();
    for asked in [vec![0], vec![6]] {
        let store = Store::Hierarchical { error: 0.005, direct: DirectLight::WhereFew };
        let all = Strategy {
            store,
            unshot: 1e-6,
            omit: Omissions::ALL,
            ..Strategy::new(Subdivision::Uniform(16), Method::exact(1e-6, 1e-5))
        };
        let some = Strategy { asked: Some(asked.clone()), ..all.clone() };
        let [all, some] = [all, some].map(|strategy| run(&scene, &strategy, &mut ()).unwrap());
        let reports = [&all, &some].map(|run| run.hierarchical.clone().unwrap());
        let error = on(&some, &asked).error(&on(&exact, &asked)).rms;
        let whole = on(&all, &asked).error(&on(&exact, &asked)).rms;
        println!(
            "{asked:?}: {} of {} links, error {error:.2e} (estimate {:.2e}), {whole:.2e} of the whole",
            reports[1].links, reports[0].links, reports[1].error
        );
        assert!(error <= 0.005 && reports[1].error <= 0.005, "{asked:?}: {error:e}");
        assert!(10 * reports[1].links < 9 * reports[0].links, "{asked:?}: {reports:?}");
    }
}
