//! Facts about the choice of a strategy.

use radiosity::choice::{Candidate, Choice, ChoiceError, Named, Steps, Target, Wanted, WhyNot};
use radiosity::{Constants, DirectLight, GridValues, Method, RunError, Store, Strategy, run, run_to_tolerance};
use radiosity_gallery::boxes::{box_in_cube, empty_box, material};
use radiosity_gallery::{BlockedLight, Hinge, furnace, rooms};
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::{MeshError, Subdivision};

const CONSTANTS: fn() -> Constants = Constants::default;

fn lit_box() -> Scene {
    let mut scene = box_in_cube(0.4, material("room", 0.6, 0.0), material("box", 0.4, 0.0));
    scene.materials.push(material("light", 0.2, 1.0));
    scene.surfaces[5].material = 2;
    scene
}

fn choose(scene: &Scene, wanted: &Wanted) -> Choice {
    Choice::new(scene, wanted, &CONSTANTS()).unwrap()
}

/// Names and expectations, all bits of them.
fn written(choice: &Choice) -> String {
    choice.ranking.iter().map(|r| format!("{} {:?} {:?}\n", r.candidate.name, r.expected, r.why_not)).collect()
}

#[test]
fn the_choice_is_the_same_with_any_number_of_threads() {
    let scene = lit_box();
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| written(&choose(&scene, &Wanted::tolerance(0.02))))
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(8));
}

#[test]
fn at_most_twelve_candidates_are_ranked_and_one_of_them_is_chosen() {
    for scene in [lit_box(), BlockedLight::at(0.3).scene(), rooms::one_room()] {
        let choice = choose(&scene, &Wanted::tolerance(0.01));
        assert!(choice.ranking.len() > 5 && choice.ranking.len() <= 12);
        assert_eq!(choice.ranking.iter().filter(|r| r.why_not.is_none()).count(), 1);
        assert!(choice.ranking[0].why_not.is_none());
        let mut names: Vec<_> = choice.ranking.iter().map(|r| r.candidate.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), choice.ranking.len());
        for ranked in &choice.ranking {
            let e = &ranked.expected;
            assert!(e.seconds > 0.0 && e.seconds.is_finite() && e.elements > 0 && e.rounds > 0, "{ranked:?}");
            assert!(e.stored_bytes > 0 && e.peak_bytes > e.stored_bytes && e.error >= 0.0, "{ranked:?}");
        }
    }
}

#[test]
fn a_smaller_tolerance_is_never_expected_to_take_less() {
    let scene = rooms::one_room();
    let expected = |tolerance: f64, name: &str| {
        let choice = choose(&scene, &Wanted::tolerance(tolerance));
        let found = choice.ranking.iter().find(|r| r.candidate.name == name).unwrap().expected;
        (found.seconds, found.elements)
    };
    let names: Vec<_> = choose(&scene, &Wanted::tolerance(0.05)).ranking.iter().map(|r| r.candidate.name).collect();
    for name in names {
        let mut before = (0.0, 0);
        for tolerance in [0.08, 0.04, 0.02, 0.01, 0.005] {
            let now = expected(tolerance, name);
            assert!(now.0 >= before.0 && now.1 >= before.1, "{name} at {tolerance}: {now:?} after {before:?}");
            before = now;
        }
    }
}

#[test]
fn a_refusal_says_what_is_nearest() {
    let scene = lit_box();
    let refused = |wanted: Wanted| Choice::new(&scene, &wanted, &CONSTANTS()).unwrap_err();
    let in_time = refused(Wanted { time: Some(1e-6), ..Wanted::tolerance(0.005) });
    let ChoiceError::NoneFits { nearest, expected, why } = &in_time else { panic!("{in_time}") };
    // The nearest in time is what would have been chosen without a limit.
    let free = choose(&scene, &Wanted::tolerance(0.005));
    assert_eq!((*nearest, **expected), (free.chosen().candidate.name, free.chosen().expected));
    assert_eq!(*why, WhyNot::Time { limit: 1e-6 });
    assert!(in_time.to_string().contains(nearest), "{in_time}");
    let in_memory = refused(Wanted { memory: Some(10_000), ..Wanted::tolerance(0.005) });
    assert!(matches!(in_memory, ChoiceError::NoneFits { why: WhyNot::Memory { limit: 10_000 }, .. }), "{in_memory}");
    let by_elements = refused(Wanted { most_elements: 100, ..Wanted::tolerance(0.005) });
    let ChoiceError::NoneFits { why: WhyNot::Error { .. } | WhyNot::Elements { limit: 100 }, .. } = &by_elements else {
        panic!("{by_elements}")
    };
    assert_eq!(refused(Wanted { tolerance: None, ..Wanted::tolerance(0.1) }), ChoiceError::NothingWanted);
}

#[test]
fn less_memory_changes_the_choice_to_what_fits() {
    let scene = lit_box();
    let free = choose(&scene, &Wanted::tolerance(0.01));
    let least = free.ranking.iter().map(|r| r.expected.peak_bytes).min().unwrap();
    let tight = choose(&scene, &Wanted { memory: Some(least), ..Wanted::tolerance(0.01) });
    assert_eq!(tight.chosen().expected.peak_bytes, least);
    assert!(tight.ranking[1..].iter().all(|r| r.why_not.is_some()));
}

#[test]
fn more_time_alone_gives_a_smaller_error() {
    let scene = lit_box();
    let within = |time| choose(&scene, &Wanted { tolerance: None, time: Some(time), ..Wanted::tolerance(0.1) });
    let (short, long) = (within(0.05), within(1.0));
    assert!(long.target.tolerance < short.target.tolerance);
    assert!(short.chosen().expected.seconds <= 0.05 && long.chosen().expected.seconds <= 1.0);
}

#[test]
fn candidates_agree_with_what_is_named() {
    let scene = lit_box();
    let named = |named| choose(&scene, &Wanted { named, ..Wanted::tolerance(0.02) });
    let all = |choice: Choice, is: fn(&Candidate) -> bool| choice.ranking.iter().all(|r| is(&r.candidate));
    let method = Some(Method::RAYS_AND_EMITTERS);
    assert!(all(named(Named { method, ..Named::default() }), |c| c.strategy.method == Method::RAYS_AND_EMITTERS));
    let store = Some(Store::PackedSingle);
    assert!(all(named(Named { store, ..Named::default() }), |c| c.strategy.store == Store::PackedSingle));
    let solver = Some("jacobi".to_owned());
    assert!(all(named(Named { solver, ..Named::default() }), |c| c.strategy.solver == "jacobi"));
    let method = Some(Method::HEMICUBE);
    let wanted = Wanted { named: Named { method, ..Named::default() }, ..Wanted::tolerance(0.02) };
    assert_eq!(Choice::new(&scene, &wanted, &CONSTANTS()).unwrap_err(), ChoiceError::NoneAgrees);
}

/// The error of links of every candidate that has them.
fn link_errors(choice: &Choice) -> Vec<f64> {
    let error = |candidate: &Candidate| match candidate.strategy.store {
        Store::Hierarchical { error, .. } => Some(error),
        _ => None,
    };
    choice.ranking.iter().filter_map(|r| error(&r.candidate)).collect()
}

#[test]
fn links_that_are_named_err_by_less_than_the_tolerance_unless_their_error_is_named_too() {
    let scene = lit_box();
    let named = |tolerance, link_error| {
        let named = Named { store: Some(Store::HIERARCHICAL), link_error, ..Named::default() };
        choose(&scene, &Wanted { named, ..Wanted::tolerance(tolerance) })
    };
    for tolerance in [0.004, 0.04] {
        let choice = named(tolerance, None);
        assert_eq!(choice.ranking.len(), 1);
        let error = link_errors(&choice)[0];
        assert!(error > 0.1 * tolerance && error < 0.5 * tolerance, "{error} at {tolerance}");
        // What links err by is part of what is expected.
        assert!(choice.chosen().expected.error > error);
    }
    assert_eq!(link_errors(&named(0.04, Some(0.007))), [0.007]);
    let by_name = Named { link_error: Some(0.007), ..Named::default() };
    assert_eq!(link_errors(&choose(&scene, &Wanted { named: by_name, ..Wanted::tolerance(0.04) })), [0.007]);
    // Links worse than the tolerance never meet it.
    let worse = Named { store: Some(Store::HIERARCHICAL), link_error: Some(0.05), ..Named::default() };
    let refused = Choice::new(&scene, &Wanted { named: worse, ..Wanted::tolerance(0.04) }, &CONSTANTS()).unwrap_err();
    assert!(matches!(refused, ChoiceError::NoneFits { why: WhyNot::Error { .. }, .. }), "{refused}");
}

#[test]
fn a_tolerance_counts_the_error_of_links() {
    let scene = lit_box();
    let tolerance = 0.012;
    let by_links = |error| {
        let store = Store::Hierarchical { error, direct: DirectLight::WhereFew };
        let strategy = Strategy { store, ..Strategy::new(Subdivision::Uniform(2), Method::OF_LINKS) };
        run_to_tolerance(&scene, &strategy, tolerance, 8, 4000).unwrap()
    };
    let (fine, coarse) = (by_links(0.3 * tolerance), by_links(0.95 * tolerance));
    for done in [&fine, &coarse] {
        let (last, links) = (done.steps.last().unwrap(), done.run.hierarchical.as_ref().unwrap().error);
        let (estimate, difference) = (last.estimate().unwrap(), last.difference.as_ref().unwrap().rms);
        assert!(links > 0.0 && estimate >= links + difference);
        assert_eq!(done.met, estimate <= tolerance);
    }
    assert!(fine.met, "{:?}", fine.steps);
    // Two answers of coarse links differ by less than the tolerance long before their own error leaves room for that.
    let agree = coarse.steps.iter().find(|s| s.difference.as_ref().is_some_and(|d| d.rms <= tolerance)).unwrap();
    assert!(agree.estimate().unwrap() > tolerance, "{agree:?}");
}

#[test]
fn the_estimate_of_a_candidate_of_links_is_not_below_their_error() {
    let scene = lit_box();
    let named = Named { store: Some(Store::HIERARCHICAL), ..Named::default() };
    let choice = choose(&scene, &Wanted { named, ..Wanted::tolerance(0.03) });
    let reached = choice.chosen().candidate.run(&scene, &choice.target, &mut || true).unwrap();
    let (links, estimate) = (reached.run.hierarchical.as_ref().unwrap().error, reached.steps.estimate());
    assert!(links > 0.0 && estimate > links && reached.met && estimate <= 0.03, "{estimate}, of which {links}");
}

#[test]
fn no_candidate_agrees_with_a_solver_that_samples() {
    let named = Named { solver: Some("stochastic".to_owned()), ..Named::default() };
    let wanted = Wanted { named, ..Wanted::tolerance(0.02) };
    assert_eq!(Choice::new(&lit_box(), &wanted, &CONSTANTS()).unwrap_err(), ChoiceError::NoneAgrees);
}

#[test]
fn candidates_of_too_many_elements_leave_the_choice_to_the_others() {
    let scene = lit_box();
    let names = |report_grid| -> Vec<_> {
        let choice = choose(&scene, &Wanted { report_grid, ..Wanted::tolerance(0.05) });
        choice.ranking.iter().map(|r| r.candidate.name).collect()
    };
    let (few, some) = (names(8), names(3000));
    let left: Vec<_> = few.iter().filter(|name| !some.contains(name)).collect();
    assert_eq!(left, [&"rays, adaptive, many patches"]);
    let uniform = names(u32::MAX);
    assert!(!uniform.is_empty() && uniform.iter().all(|name| name.ends_with("uniform")), "{uniform:?}");
    // No mesh of all that there are.
    let endless = Wanted { report_grid: u32::MAX, most_elements: usize::MAX, ..Wanted::tolerance(1e-9) };
    let refused = Choice::new(&scene, &endless, &CONSTANTS()).unwrap_err();
    assert!(matches!(refused, ChoiceError::Run(RunError::Mesh(MeshError::TooMany { .. }))), "{refused}");
}

fn chosen_error(scene: &Scene, tolerance: f64, truth: &GridValues) -> f64 {
    let choice = choose(scene, &Wanted::tolerance(tolerance));
    let reached = choice.chosen().candidate.run(scene, &choice.target, &mut || true).unwrap();
    assert!(reached.met && reached.steps.estimate() <= tolerance);
    let run = &reached.run;
    GridValues::means(&run.geometry, &run.solution.irradiance, 8).unwrap().error(truth).rms
}

/// Pairs on 4 elements along the edge of a report cell, whose own error is below a tenth of the tolerance.
fn fine(scene: &Scene) -> GridValues {
    let strategy =
        Strategy { store: Store::PackedSingle, ..Strategy::new(Subdivision::Uniform(32), Method::exact(1e-7, 1e-5)) };
    let run = run(scene, &strategy, &mut ()).unwrap();
    GridValues::means(&run.geometry, &run.solution.irradiance, 8).unwrap()
}

#[test]
fn the_chosen_strategy_meets_its_tolerance() {
    // In a furnace every irradiance is E/(1 − ρ).
    let room = furnace::room([3.0, 2.0, 4.0], 0.5, 1.0);
    let at = run(&room, &Strategy::new(Subdivision::Uniform(8), Method::ANALYTIC), &mut ()).unwrap();
    let mut exact = GridValues::means(&at.geometry, &at.solution.irradiance, 8).unwrap();
    exact.values.values_mut().fill(2.0);
    assert!(chosen_error(&room, 0.01, &exact) <= 0.01);
    let hinge = Hinge { angle: 1.2, emission: 1.0, reflectance: 0.5 }.scene();
    assert!(chosen_error(&hinge, 0.01, &fine(&hinge)) <= 0.01);
    let tube = {
        let mut scene = empty_box([1.0, 1.0, 1.5], material("wall", 0.6, 0.0));
        scene.materials.push(material("light", 0.0, 1.0));
        scene.surfaces[4].material = 1;
        scene
    };
    assert!(chosen_error(&tube, 0.02, &fine(&tube)) <= 0.02);
}

#[test]
fn a_procedure_stops_between_meshes_when_it_is_told_to() {
    let scene = lit_box();
    let choice = choose(&scene, &Wanted::tolerance(0.005));
    let target = Target { tolerance: 1e-4, ..choice.target };
    for ranked in &choice.ranking[..2] {
        let reached = ranked.candidate.run(&scene, &target, &mut || false).unwrap();
        let meshes = match &reached.steps {
            Steps::Adaptive(rounds) => rounds.len(),
            Steps::Uniform(steps) => steps.len(),
        };
        assert!(!reached.met && meshes == 1);
    }
}
