//! What a plan leaves out changes no answer, and saves what it was predicted to.

use glam::DVec3;
use radiosity::plan::{Off, Omission, Omissions, Role};
use radiosity::{Method, Plan, Run, Shape, Store, Strategy, run};
use radiosity_core::{BandValues, Outcome};
use radiosity_gallery::boxes::{material, scene_of_loops};
use radiosity_gallery::rooms::{STOREY, black_floor, grey_room, one_room, tower, two_rooms};
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::{MeshSettings, Subdivision};

/// 3 × 3 elements a face, solved to rounding: η = 1e-14 leaves less than the 1e-12 that is asked. Mirror images are tested apart (`symmetry.rs`).
fn strategy(method: Method) -> Strategy {
    let omit = Omissions::ALL - Omission::Symmetry.into();
    Strategy { unshot: 1e-14, omit, ..Strategy::new(Subdivision::Uniform(3), method) }
}

fn in_form(method: Method, shape: Shape) -> Strategy {
    let patches = Some(Subdivision::Uniform(1));
    let mesh = MeshSettings { elements: Subdivision::Uniform(3), patches, contacts: true };
    let solver = if shape == Shape::PatchesToElements { "shooting" } else { "gauss-seidel" };
    Strategy { mesh, shape, solver: solver.to_owned(), ..strategy(method) }
}

/// Largest |difference| over the largest value.
fn difference(a: &BandValues, b: &BandValues) -> f64 {
    assert_eq!((a.count(), a.len()), (b.count(), b.len()));
    let largest = a.values().iter().copied().fold(0.0, f64::max);
    a.values().iter().zip(b.values()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / largest
}

/// The run that keeps everything and the one that does not, which agree to 1e-12.
fn both<'a>(scene: &'a Scene, strategy: &Strategy) -> [Run<'a>; 2] {
    let everything = Strategy { omit: Omissions::NONE, ..strategy.clone() };
    let runs = [&everything, strategy].map(|strategy| run(scene, strategy, &mut ()).unwrap());
    let [whole, planned] = &runs;
    assert_eq!(planned.solution.outcome, Outcome::Converged);
    assert!(whole.left_out.list.is_empty() && !planned.left_out.list.is_empty());
    let (h, b) = (&whole.solution.irradiance, &whole.solution.radiosity);
    let differences =
        [(h, &planned.solution.irradiance), (b, &planned.solution.radiosity)].map(|(a, b)| difference(a, b));
    assert!(differences.iter().all(|d| *d < 1e-12), "{strategy:?}: {differences:?}");
    assert_eq!(Some(planned.left_out.predicted), planned.left_out.measured);
    runs
}

/// Form factors, rows and rays that vanished are those predicted.
fn saves_what_was_predicted([whole, planned]: &[Run<'_>; 2]) {
    let (all, some, predicted) = (whole.cost(), planned.cost(), planned.left_out.predicted);
    assert_eq!(predicted.form_factors, Some(all.form_factors - some.form_factors));
    assert_eq!(predicted.rows, Some(all.source_evaluations - some.source_evaluations));
    assert!(predicted.rays.is_none_or(|rays| rays == all.rays - some.rays));
}

#[test]
fn bands_of_one_colour_are_solved_once_and_dark_ones_not_at_all() {
    for (light, solved) in [([3.0; 3], 1), ([3.0, 0.0, 0.7], 1), ([0.0; 3], 0)] {
        let scene = grey_room(light);
        let plan = Plan::new(&scene, &strategy(Method::ANALYTIC));
        assert_eq!(plan.bands.solved.len(), solved);
        if solved == 0 {
            continue;
        }
        let runs = both(&scene, &strategy(Method::ANALYTIC));
        saves_what_was_predicted(&runs);
        let [whole, planned] = runs;
        assert_eq!(planned.left_out.predicted.bands, 2);
        // As many steps, of a third of the arithmetic; the same form factors.
        assert_eq!(planned.solution.steps, whole.solution.steps);
        assert_eq!(planned.solution.cost.entries, whole.solution.cost.entries);
        let third = whole.solution.cost.flops as f64 / 3.0;
        assert!((planned.solution.cost.flops as f64 / third - 1.0).abs() < 0.01);
    }
}

/// The counts of a grey room in three bands are those of a library call on one band, and so is the answer.
#[test]
fn a_grey_room_costs_what_one_band_alone_does() {
    let grey = grey_room([3.0; 3]);
    let materials = vec![material("grey", 0.5, 0.0), material("lamp", 0.3, 3.0)];
    let one_band = Scene { surfaces: grey.surfaces.clone(), materials };
    let planned = run(&grey, &strategy(Method::ANALYTIC), &mut ()).unwrap();
    let by_hand = Strategy { omit: Omissions::NONE, ..strategy(Method::ANALYTIC) };
    let alone = run(&one_band, &by_hand, &mut ()).unwrap();
    assert_eq!((planned.cost(), planned.solution.steps), (alone.cost(), alone.solution.steps));
    for b in 0..3 {
        assert_eq!(planned.solution.radiosity.band(b), alone.solution.radiosity.band(0));
    }
}

#[test]
fn what_emits_nowhere_is_zero_without_any_form_factor() {
    let scene = grey_room([0.0; 3]);
    let planned = run(&scene, &strategy(Method::ANALYTIC), &mut ()).unwrap();
    let solution = &planned.solution;
    assert!(solution.radiosity.values().iter().chain(solution.irradiance.values()).all(|value| *value == 0.0));
    assert_eq!((solution.radiosity.count(), solution.radiosity.len()), (3, 54));
    assert_eq!((solution.outcome, planned.cost()), (Outcome::Converged, radiosity_core::Cost::default()));
    // 5 of 6 faces are seen by each: 9·9 pairs for each of 15 pairs of faces.
    assert_eq!(planned.left_out.predicted.form_factors, Some(15 * 81));
}

#[test]
fn black_faces_are_no_unknowns_and_receive_at_the_end() {
    let scene = black_floor();
    let rays = Method::rays(64);
    for strategy in [
        strategy(Method::ANALYTIC),
        Strategy { store: Store::Packed, ..strategy(Method::ANALYTIC) },
        strategy(Method::sampled(1e-10, 64)),
        strategy(rays),
        strategy(Method::HEMICUBE),
        in_form(Method::ANALYTIC, Shape::ElementsToPatches),
        in_form(rays, Shape::ElementsToPatches),
    ] {
        let runs = both(&scene, &strategy);
        assert_eq!(runs[1].left_out.predicted.unknowns, 18, "{}", strategy.method.name());
        saves_what_was_predicted(&runs);
    }
    // Rows that shoot are those of senders alone, and rays with exact emitters are not predicted; the answer is the same.
    both(&scene, &strategy(Method::RaysAndEmitters { rays: 64 }));
}

/// Every lamp with ρ = 0: B = E there.
fn with_black_lamps(mut scene: Scene) -> Scene {
    for material in scene.materials.iter_mut().filter(|material| material.emission.iter().any(|e| *e > 0.0)) {
        material.reflectance.fill(0.0);
    }
    scene
}

/// 9 elements on a ceiling that emits, 18 on a black floor and a sheet; two ceilings of two rooms; and lamps that shine on each other.
#[test]
fn black_lamps_are_no_unknowns_and_their_light_is_known() {
    let mut opposed = one_room();
    opposed.surfaces[0].material = opposed.surfaces[5].material;
    let cases = [(black_floor(), 27), (one_room(), 9), (two_rooms([true, true]), 18), (opposed, 18)];
    for (scene, known) in cases.map(|(scene, known)| (with_black_lamps(scene), known)) {
        for strategy in [
            strategy(Method::ANALYTIC),
            Strategy { store: Store::Packed, ..strategy(Method::ANALYTIC) },
            Strategy { solver: "shooting".to_owned(), ..strategy(Method::ANALYTIC) },
            Strategy { omit: Omission::Black.into(), ..strategy(Method::sampled(1e-10, 64)) },
            Strategy {
                asked: Some((0..scene.surfaces.len() as u32).filter(|s| s % 6 != 5).collect()),
                ..strategy(Method::ANALYTIC)
            },
        ] {
            let runs = both(&scene, &strategy);
            assert_eq!(runs[1].left_out.predicted.unknowns, known, "{}", strategy.solver);
            saves_what_was_predicted(&runs);
            let [whole, planned] = runs;
            assert!(planned.solution.bound().unwrap() <= 1e-13);
            // Rows are as closed as they were: 1 with what goes to lamps.
            let closure = |run: &Run<'_>| run.checked.as_ref().unwrap().checks.closure.map(|(_, off)| off.abs());
            if known != 27 {
                assert!(closure(&planned).unwrap() <= 2.0 * closure(&whole).unwrap());
            }
        }
    }
}

/// Rows of rays see lamps with all else, and a room in which nothing else sends light has no other unknowns.
#[test]
fn black_lamps_stay_where_their_light_comes_with_rows_or_nothing_reflects() {
    let scene = with_black_lamps(one_room());
    let all_black = {
        let mut scene = scene.clone();
        scene.materials.iter_mut().for_each(|material| material.reflectance.fill(0.0));
        scene
    };
    let cases = [
        (&scene, strategy(Method::rays(64))),
        (&scene, in_form(Method::ANALYTIC, Shape::ElementsToPatches)),
        (&scene, Strategy { thin: Some(0.1), ..strategy(Method::ANALYTIC) }),
        (&scene, Strategy { bounces: Some(0.1), ..strategy(Method::ANALYTIC) }),
        (&all_black, strategy(Method::ANALYTIC)),
    ];
    for (scene, strategy) in cases {
        let plan = Plan::new(scene, &strategy);
        assert_eq!(plan.roles[5], Role::Exchanges, "{strategy:?}");
    }
    let runs = both(&all_black, &strategy(Method::ANALYTIC));
    assert_eq!(runs[1].left_out.predicted.unknowns, 45);
    saves_what_was_predicted(&runs);
}

/// Of a room that is a box one pair in 8 is computed with its ceiling, one in 4 without.
#[test]
fn black_lamps_stay_where_rows_mirror_each_other_with_them() {
    let scene = with_black_lamps(one_room());
    let strategy = Strategy { omit: Omissions::ALL, ..strategy(Method::ANALYTIC) };
    assert_eq!(Plan::new(&scene, &strategy).roles[5], Role::Exchanges);
    let runs = both(&scene, &strategy);
    assert!(runs[1].left_out.list.iter().all(|left| left.omission == Omission::Symmetry));
    saves_what_was_predicted(&runs);
}

/// A floor and a ceiling with the symmetries of a cube that keep its axis, and a lamp beside them that none of these leaves where it is.
#[test]
fn rows_beside_black_lamps_are_copied() {
    let at = |corners: [[f64; 3]; 4]| corners.map(DVec3::from).to_vec();
    let floor = at([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    let ceiling = at([[0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 0.0, 1.0]]);
    let lamp = at([[2.0, 0.1, 0.2], [2.0, 0.1, 0.5], [2.0, 0.4, 0.5], [2.0, 0.4, 0.2]]);
    let materials = vec![material("grey", 0.5, 0.0), material("white", 0.8, 0.0), material("lamp", 0.0, 1.0)];
    let scene = scene_of_loops(&[(floor, 0), (ceiling, 1), (lamp, 2)], materials);
    for store in [Store::Dense, Store::Packed] {
        let runs = both(&scene, &Strategy { omit: Omissions::ALL, store, ..strategy(Method::ANALYTIC) });
        let left = &runs[1].left_out.list;
        assert_eq!(left.iter().map(|left| left.omission).collect::<Vec<_>>(), [Omission::Black, Omission::Symmetry]);
        // Of 3 × 3 cells a corner, an edge and the middle are computed, for both squares.
        assert_eq!((left[0].predicted.unknowns, left[1].predicted.rows), (9, Some(15)));
        saves_what_was_predicted(&runs);
    }
}

#[test]
fn black_faces_stay_where_patches_shoot_or_rows_are_made_on_demand() {
    let scene = black_floor();
    for strategy in [
        in_form(Method::ANALYTIC, Shape::PatchesToElements),
        Strategy { store: Store::KeepAll, ..strategy(Method::ANALYTIC) },
        Strategy { solver: "shooting".to_owned(), ..strategy(Method::RAY_CAST) },
    ] {
        assert!(Plan::new(&scene, &strategy).roles.iter().all(|role| *role == Role::Exchanges));
    }
}

/// The counts of two rooms with one lit are those of the lit one alone.
#[test]
fn a_dark_room_costs_nothing() {
    let (two, one) = (two_rooms([true, false]), one_room());
    let shooting = Strategy { solver: "shooting".to_owned(), ..strategy(Method::rays(64)) };
    for strategy in [
        strategy(Method::ANALYTIC),
        strategy(Method::rays(64)),
        strategy(Method::HEMICUBE),
        shooting,
        in_form(Method::ANALYTIC, Shape::ElementsToPatches),
        in_form(Method::ANALYTIC, Shape::PatchesToElements),
        Strategy { solver: "direct".to_owned(), ..in_form(Method::ANALYTIC, Shape::TwoLevel) },
    ] {
        let runs = both(&two, &strategy);
        saves_what_was_predicted(&runs);
        let alone = run(&one, &Strategy { omit: Omissions::NONE, ..strategy.clone() }, &mut ()).unwrap();
        let planned = &runs[1];
        // Walls between the rooms count as pairs that may be blocked where there are two of them.
        assert_eq!(planned.cost().form_factors, alone.cost().form_factors);
        assert_eq!((planned.cost().rays, planned.cost().entries), (alone.cost().rays, alone.cost().entries));
        assert_eq!(
            (planned.solution.cost.flops, planned.solution.steps),
            (alone.solution.cost.flops, alone.solution.steps)
        );
        assert_eq!(planned.stored_bytes, alone.stored_bytes);
        assert!(planned.solution.radiosity.band(0)[54..].iter().all(|b| *b == 0.0));
    }
}

#[test]
fn rooms_that_do_not_see_each_other_are_separate_systems() {
    let scene = two_rooms([true, true]);
    for strategy in [
        strategy(Method::ANALYTIC),
        Strategy { store: Store::Packed, ..strategy(Method::ANALYTIC) },
        Strategy { solver: "direct".to_owned(), ..strategy(Method::ANALYTIC) },
        Strategy { solver: "gauss-seidel".to_owned(), store: Store::Sparse, ..strategy(Method::rays(64)) },
        Strategy { solver: "gmres".to_owned(), ..strategy(Method::HEMICUBE) },
        in_form(Method::ANALYTIC, Shape::ElementsToPatches),
        in_form(Method::rays(64), Shape::PatchesToElements),
        Strategy { solver: "direct".to_owned(), ..in_form(Method::ANALYTIC, Shape::TwoLevel) },
    ] {
        let runs = both(&scene, &strategy);
        saves_what_was_predicted(&runs);
        let [whole, planned] = runs;
        // Two blocks of half the size; tiles of packed stores are larger than both, and sparse rows have no zeros.
        assert!(strategy.store != Store::Dense || planned.stored_bytes < whole.stored_bytes * 3 / 4);
    }
    let on_demand = Strategy { store: Store::KeepAll, solver: "shooting".to_owned(), ..strategy(Method::ANALYTIC) };
    let [whole, planned] = both(&scene, &on_demand);
    assert!(planned.cost().form_factors < whole.cost().form_factors);
}

/// The sheet (6) and the floor (4) are black: not asked for, they have no elements, and still take light from what lies behind.
#[test]
fn what_is_not_asked_for_and_sends_nothing_only_blocks() {
    let scene = black_floor();
    for method in [Method::ANALYTIC, Method::rays(64), Method::HEMICUBE] {
        let strategy = Strategy { asked: Some(vec![0, 1, 2, 3, 5]), ..strategy(method) };
        let everything = Strategy { omit: Omissions::NONE, ..strategy.clone() };
        let [whole, planned] = [&everything, &strategy].map(|strategy| run(&scene, strategy, &mut ()).unwrap());
        // Rows of rays and hemicubes are drawn by the numbers of elements, which therefore stay.
        let exact = method == Method::ANALYTIC;
        assert_eq!(planned.geometry.elements().len(), if exact { 45 } else { 63 });
        let asked = |e: &usize| !(36..45).contains(e) && *e < 54;
        for (all, some) in [
            (&whole.solution.radiosity, &planned.solution.radiosity),
            (&whole.solution.irradiance, &planned.solution.irradiance),
        ] {
            for b in 0..3 {
                let (all, some) = (all.band(b), some.band(b));
                let places = (0..63).filter(asked).enumerate();
                let differences = places.map(|(k, e)| (all[e] - some[if exact { k } else { e }]).abs());
                assert!(differences.fold(0.0, f64::max) < 1e-12 * all.iter().copied().fold(0.0, f64::max));
            }
        }
        let (all, some) = (whole.cost(), planned.cost());
        if let Some(predicted) = planned.left_out.predicted.form_factors {
            assert_eq!(predicted, all.form_factors - some.form_factors);
        }
        assert_eq!(Some(planned.left_out.predicted), planned.left_out.measured);
        assert_eq!(planned.left_out.predicted.rows, Some(18));
        assert_eq!(all.source_evaluations - some.source_evaluations, 18);
    }
}

/// Both rooms are lit, and only the floor of the first is asked for: the answer there is that of both, and the run that of the first alone.
#[test]
fn a_lit_room_that_holds_nothing_asked_for_costs_what_no_room_costs() {
    let (two, one) = (two_rooms([true, true]), one_room());
    for method in [Method::ANALYTIC, Method::rays(64), Method::HEMICUBE] {
        let strategy = Strategy { asked: Some(vec![0]), ..strategy(method) };
        let everything = Strategy { omit: Omissions::NONE, ..strategy.clone() };
        let [whole, planned] = [&everything, &strategy].map(|strategy| run(&two, strategy, &mut ()).unwrap());
        for (all, some) in [
            (&whole.solution.radiosity, &planned.solution.radiosity),
            (&whole.solution.irradiance, &planned.solution.irradiance),
        ] {
            for b in 0..all.count() {
                let differences = all.band(b)[..9].iter().zip(some.band(b)).map(|(all, some)| (all - some).abs());
                let largest = all.band(b).iter().copied().fold(0.0, f64::max);
                assert!(differences.fold(0.0, f64::max) < 1e-12 * largest, "{method:?}");
            }
        }
        saves_what_was_predicted(&[whole, planned]);
    }
    let asked = Strategy { asked: Some(vec![0]), ..strategy(Method::ANALYTIC) };
    let [planned, alone] = [&two, &one].map(|scene| run(scene, &asked, &mut ()).unwrap());
    assert_eq!(planned.geometry.elements().len(), alone.geometry.elements().len());
    assert_eq!(planned.cost(), alone.cost());
}

/// Two storeys, the upper one dark, without their sheets asked for: all that a plan knows of can be left out, and each alone.
#[test]
fn every_omission_alone_and_all_together_change_nothing_and_save_what_was_predicted() {
    let scene = tower(&[true, false]);
    let is_sheet = |s: &u32| *s as usize % STOREY == STOREY - 1;
    let asked: Vec<u32> = (0..scene.surfaces.len() as u32).filter(|s| !is_sheet(s)).collect();
    let plain = Strategy { unshot: 1e-14, ..Strategy::new(Subdivision::Uniform(2), Method::ANALYTIC) };
    let everything = run(&scene, &plain, &mut ()).unwrap();
    // A tower has blocks, and pairs that something blocks have no exact copies.
    let all = Omission::ALL.into_iter().filter(|one| *one != Omission::Symmetry).map(Omissions::from);
    for omit in all.chain([Omissions::ALL]) {
        // Black faces are gathered where they are asked for, and only block where not.
        let asked = (omit != Omissions::from(Omission::Black)).then(|| asked.clone());
        let strategy = Strategy { omit, asked, ..plain.clone() };
        let planned = run(&scene, &strategy, &mut ()).unwrap();
        let left: Vec<Omission> = planned.left_out.list.iter().map(|left| left.omission).collect();
        // Of sheets that only block none is left to be gathered, and of two rooms one is dark.
        let expected = if omit == Omissions::ALL {
            vec![Omission::Blockers, Omission::Dark, Omission::Bands]
        } else {
            Omission::ALL.into_iter().filter(|one| omit.contains(*one)).collect()
        };
        assert_eq!(left, expected);
        assert_eq!(Some(planned.left_out.predicted), planned.left_out.measured, "{left:?}");
        let (h, all) = (planned.geometry.spread(&planned.solution.irradiance), &everything.solution.irradiance);
        let all = everything.geometry.spread(all);
        let places = |run: &Run<'_>| -> Vec<usize> {
            let elements = run.geometry.mesh().elements.iter().enumerate();
            elements.filter(|(_, element)| !is_sheet(&element.surface)).map(|(e, _)| e).collect()
        };
        let (some_places, all_places) = (places(&planned), places(&everything));
        assert_eq!(some_places.len(), all_places.len());
        for b in 0..3 {
            let (some, all) = (h.band(b), all.band(b));
            let largest = all.iter().copied().fold(0.0, f64::max);
            let pairs = some_places.iter().zip(&all_places);
            assert!(pairs.map(|(s, a)| (some[*s] - all[*a]).abs()).fold(0.0, f64::max) < 1e-12 * largest, "{left:?}");
        }
    }
}

/// Nodes are those of the lit room alone. Links are not to the last one: walls of two rooms are looked at as if they might block. Both runs err by at most
/// the 1 % that is asked for.
#[test]
fn dark_rooms_have_no_links() {
    let strategy = Strategy { store: Store::HIERARCHICAL, unshot: 1e-9, ..strategy(Method::OF_LINKS) };
    let (two, one) = (two_rooms([true, false]), one_room());
    let planned = run(&two, &strategy, &mut ()).unwrap();
    let alone = run(&one, &Strategy { omit: Omissions::NONE, ..strategy }, &mut ()).unwrap();
    assert_eq!((planned.left_out.list[0].omission, planned.left_out.predicted.unknowns), (Omission::Dark, 54));
    assert_eq!(Some(planned.left_out.predicted), planned.left_out.measured);
    let [some, all] = [&planned, &alone].map(|run| run.hierarchical.as_ref().unwrap());
    assert_eq!(some.nodes, all.nodes);
    let areas = alone.geometry.elements().areas();
    for b in 0..3 {
        let (some, all) = (planned.solution.irradiance.band(b), alone.solution.irradiance.band(b));
        let sum = |of: &dyn Fn(usize) -> f64| areas.iter().enumerate().map(|(e, area)| area * of(e)).sum::<f64>();
        let (total, apart) = (sum(&|_| 1.0), sum(&|e| (some[e] - all[e]).powi(2)));
        assert!((apart / total).sqrt() < 0.02 * sum(&|e| all[e]) / total);
        assert!(some[54..].iter().all(|h| *h == 0.0));
    }
}

#[test]
fn what_needs_everything_says_so() {
    let scene = two_rooms([true, false]);
    let plain = strategy(Method::ANALYTIC);
    let off = |strategy: Strategy| Plan::new(&scene, &strategy).off;
    assert_eq!(off(plain.clone()), None);
    assert_eq!(off(Strategy { omit: Omissions::NONE, ..plain.clone() }), Some(Off::KeepEverything));
    assert_eq!(off(Strategy { repair: true, ..plain.clone() }), Some(Off::Repair));
    assert_eq!(off(Strategy { solver: "stochastic".to_owned(), ..plain }), Some(Off::Samples));
}
