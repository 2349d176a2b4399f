//! Adaptive substructuring: what it computes, what it says about its error, and where its mesh is fine.

mod common;

use glam::DVec3;
use radiosity::{Adaptive, AdaptiveRun, Criterion, Goal, GridValues, Method, Store, Strategy, run, run_adaptive};
use radiosity_core::BandValues;
use radiosity_gallery::boxes::{faces, material, scene_of_loops};
use radiosity_gallery::{BlockedLight, FloorUnderLight, crowded_room, rectangles};
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::Subdivision;

fn strategy(method: Method) -> Strategy {
    Strategy { solver: "gauss-seidel".to_owned(), ..Strategy::new(Subdivision::Uniform(1), method) }
}

fn adaptive<'a>(scene: &'a Scene, method: Method, settings: &Adaptive) -> AdaptiveRun<'a> {
    run_adaptive(scene, &strategy(method), settings).unwrap()
}

fn estimated(run: &AdaptiveRun<'_>) -> f64 {
    run.rounds.last().unwrap().estimate.total()
}

/// Irradiance over 8 × 8 cells a face from elements of 1/16 that send as well as receive.
fn truth(scene: &Scene) -> GridValues {
    let fine = run(scene, &Strategy::new(Subdivision::Uniform(16), Method::ANALYTIC), &mut ()).unwrap();
    GridValues::means(&fine.geometry, &fine.solution.irradiance, 8).unwrap()
}

fn true_error(run: &AdaptiveRun<'_>, truth: &GridValues) -> f64 {
    GridValues::means(&run.run.geometry, &run.run.solution.irradiance, 8).unwrap().error(truth).rms
}

/// A sheet with both sides.
fn sheet(corners: [DVec3; 4]) -> [Vec<DVec3>; 2] {
    [corners.to_vec(), corners.iter().rev().copied().collect()]
}

/// A room of 3 × 5 × 2 under a lamp, with a box on the floor and a sheet that hangs in the way.
fn furnished() -> Scene {
    let mut loops: Vec<(Vec<DVec3>, usize)> =
        faces(DVec3::ZERO, DVec3::new(3.0, 5.0, 2.0), true).into_iter().map(|f| (f, 0)).collect();
    let block = faces(DVec3::new(0.6, 1.1, 0.0), DVec3::new(1.5, 2.3, 0.8), false);
    loops.extend(block.into_iter().map(|f| (f, 1)));
    let hanging = [(2.0, 0.6), (2.0, 1.6), (2.6, 1.6), (2.6, 0.6)].map(|(x, z)| DVec3::new(x, 3.3, z));
    loops.extend(sheet(hanging).map(|f| (f, 1)));
    let lamp = [(1.0, 2.0), (1.0, 3.0), (2.0, 3.0), (2.0, 2.0)].map(|(x, y)| DVec3::new(x, y, 1.9));
    loops.push((lamp.to_vec(), 2));
    scene_of_loops(&loops, vec![material("room", 0.6, 0.0), material("grey", 0.3, 0.0), material("lamp", 0.0, 10.0)])
}

/// The reference has elements of 1/16; its own error is about a third of the smallest asked for.
#[test]
fn the_estimate_on_the_cornell_box_is_1_to_5_times_the_true_error() {
    let scene = common::cornell_box();
    let truth = truth(&scene);
    for (method, tolerance) in [(Method::ANALYTIC, 0.02), (Method::RAYS_AND_EMITTERS, 0.02)] {
        let run = adaptive(&scene, method, &Adaptive::new(Goal::Cells(8), tolerance));
        let (estimate, error) = (estimated(&run), true_error(&run, &truth));
        assert!(run.met && estimate <= tolerance);
        assert!((1.0..5.0).contains(&(estimate / error)), "{}: {estimate:e} of {error:e}", method.name());
    }
}

#[test]
fn the_estimate_in_a_furnished_room_is_1_to_5_times_the_true_error() {
    let scene = furnished();
    let run = adaptive(&scene, Method::ANALYTIC, &Adaptive::new(Goal::Cells(8), 0.01));
    let (estimate, error) = (estimated(&run), true_error(&run, &truth(&scene)));
    assert!(run.met && estimate <= 0.01);
    assert!((1.0..5.0).contains(&(estimate / error)), "{estimate:e} of {error:e}");
}

/// On the floor irradiance is known at every point; the light, 1/21 of the area and evenly lit, adds next to nothing.
#[test]
fn the_estimate_of_the_error_at_points_under_a_light_is_1_to_5_times_the_true_one() {
    let exact = FloorUnderLight::default();
    let scene = exact.scene();
    for tolerance in [0.1, 0.03] {
        let run = adaptive(&scene, Method::ANALYTIC, &Adaptive::new(Goal::Points, tolerance));
        let points = GridValues::points(&run.run.geometry, &run.run.solution.irradiance, 128);
        let at = |c: usize| points.indices[c];
        let centre = |k: u32| (f64::from(k) + 0.5) / 128.0;
        let square = |c: usize| {
            let (i, j) = at(c);
            points.areas[c] * (points.values.band(0)[c] - exact.irradiance(centre(i), centre(j))).powi(2)
        };
        let floor: f64 = (0..points.areas.len()).filter(|&c| points.surfaces[c] == 0).map(square).sum();
        let error = (floor / points.areas.iter().sum::<f64>()).sqrt() / points.level();
        let estimate = estimated(&run);
        assert!(run.met && estimate <= tolerance);
        assert!((1.0..5.0).contains(&(estimate / error)), "{estimate:e} of {error:e}");
    }
}

/// Irradiance over the cells of a floor under a blocked light and of the blocker, which sees nothing but the floor: in closed form, and by closed forms
/// from 128 × 128 parts of the floor. To 1e-3 of the mean level. What the light receives, from afar, is left as it is.
fn under_a_blocked_light(case: &BlockedLight, cells: u32, run: &AdaptiveRun<'_>) -> GridValues {
    const PARTS: u32 = 128;
    let grid = GridValues::means(&run.run.geometry, &run.run.solution.irradiance, cells).unwrap();
    let part = |range: [f64; 2], k: u32, of: u32| {
        let width = (range[1] - range[0]) / f64::from(of);
        [range[0] + width * f64::from(k), range[0] + width * f64::from(k + 1)]
    };
    let (across, all) = (|k: u32| part([0.0, 1.0], k, PARTS), || (0..PARTS * PARTS).map(|k| (k % PARTS, k / PARTS)));
    let floor: Vec<f64> = all().map(|(i, j)| case.mean_irradiance(across(i), across(j), 2)).collect();
    let at = |x: f64, y: f64| {
        let seen = |range: [f64; 2], from: f64| range.map(|end| end - from);
        let form_factor = |i, j| rectangles::parallel(seen(across(i), x), seen(across(j), y), case.height);
        all().zip(&floor).map(|((i, j), h)| case.reflectance * h * form_factor(i, j)).sum::<f64>()
    };
    let cell = |c: usize| {
        let (i, j) = grid.indices[c];
        match grid.surfaces[c] {
            0 => case.mean_irradiance(part([0.0, 1.0], i, cells), part([0.0, 1.0], j, cells), 64),
            2 => {
                // Its second parameter runs down y.
                let (x, y) = (part(case.blocker_x, i, cells), part(case.blocker_y, cells - 1 - j, cells));
                let points = (0..9).map(|k| {
                    at(part(x, k % 3, 3).iter().sum::<f64>() / 2.0, part(y, k / 3, 3).iter().sum::<f64>() / 2.0)
                });
                points.sum::<f64>() / 9.0
            }
            _ => grid.values.band(0)[c],
        }
    };
    let values = BandValues::single((0..grid.areas.len()).map(cell).collect());
    GridValues { values, ..grid }
}

/// Shadows from hard to soft, in elements that nest in the cells: all of the error is that of patches that send one value where a shadow ends. Children have 0.71 to 0.79 of
/// a jump's error and 0.75 of a slope's, which the estimate undoes; noise of its own, from 128 probes, takes the rest.
#[test]
fn the_estimate_sees_the_edges_of_shadows_inside_elements() {
    for height in [0.1, 0.2, 0.4, 0.7] {
        let case = BlockedLight::at(height);
        let scene = case.scene();
        for patches in [8, 4] {
            let settings = Adaptive::new(Goal::Cells(8), 0.5).from_cells(patches);
            let run = adaptive(&scene, Method::ANALYTIC, &settings);
            let (estimate, error) = (estimated(&run), true_error(&run, &under_a_blocked_light(&case, 8, &run)));
            assert_eq!(run.rounds.len(), 1);
            assert!((0.7..1.5).contains(&(estimate / error)), "{height}, {patches}: {estimate:e} of {error:e}");
        }
    }
}

/// One element a face: its corners all see the light, and it has no neighbour to tell of the shadow.
#[test]
fn the_estimate_sees_a_shadow_between_the_corners_of_an_element() {
    let case = BlockedLight { blocker_x: [0.1, 0.4], ..BlockedLight::at(0.1) };
    let scene = case.scene();
    let run = adaptive(&scene, Method::ANALYTIC, &Adaptive::new(Goal::Cells(1), 0.5).from_cells(1));
    let means = GridValues::means(&run.run.geometry, &run.run.solution.irradiance, 1).unwrap();
    let (estimate, error) = (estimated(&run), means.error(&under_a_blocked_light(&case, 1, &run)).rms);
    assert_eq!(run.run.geometry.elements().len(), 3);
    assert!((0.6..1.6).contains(&(estimate / error)), "{estimate:e} of {error:e}");
}

/// Boxes close to walls and to each other, in cells as large as faces and smaller: the backs of boxes see a dark part of a wall that is bright.
#[test]
fn the_estimate_sees_dark_gaps_between_small_faces_and_large_ones() {
    let scene = crowded_room(12, 2);
    let strategy =
        Strategy { store: Store::Sparse, ..Strategy::new(Subdivision::Uniform(8), Method::RAYS_AND_EMITTERS) };
    let finest = run(&scene, &strategy, &mut ()).unwrap();
    for cells in [1, 2, 4] {
        let truth = GridValues::means(&finest.geometry, &finest.solution.irradiance, cells).unwrap();
        let settings = Adaptive::new(Goal::Cells(cells), 0.5).from_cells(cells);
        let coarse = adaptive(&scene, Method::RAYS_AND_EMITTERS, &settings);
        let means = GridValues::means(&coarse.run.geometry, &coarse.run.solution.irradiance, cells).unwrap();
        let (estimate, error) = (estimated(&coarse), means.error(&truth).rms);
        assert_eq!(coarse.rounds.len(), 1);
        assert!((0.9..2.5).contains(&(estimate / error)), "{cells}: {estimate:e} of {error:e}");
    }
}

/// Counts are exact: a row is started for every new element, and none for one that was there.
#[test]
fn new_elements_cost_their_own_rows_and_no_others() {
    let scene = common::cornell_box();
    for method in [Method::sampled(1e-6, 16), Method::RaysAndEmitters { rays: 64 }] {
        let settings = Adaptive { senders: f64::INFINITY, most_elements: 1500, ..Adaptive::new(Goal::Points, 0.02) };
        let run = adaptive(&scene, method, &settings);
        let growing: Vec<_> = run.rounds.iter().filter(|round| round.rows_again == 0).collect();
        assert!(growing.len() >= 3);
        for round in growing {
            assert_eq!(round.cost.source_evaluations, round.new_elements as u64);
            assert_eq!(round.patches, run.rounds[0].patches);
        }
        for pair in run.rounds.windows(2) {
            // At least four for one: a cut at a contact makes more.
            let cut = pair[0].elements + pair[1].new_elements - pair[1].elements;
            assert!(pair[1].new_elements >= 3 * cut && cut > 0 || pair[1].rows_again > 0);
        }
    }
}

/// Pairs to the parts of a patch are new, those to the others stay: far fewer than all.
#[test]
fn a_patch_that_is_cut_costs_the_pairs_to_its_parts() {
    let scene = furnished();
    let run = adaptive(&scene, Method::ANALYTIC, &Adaptive::new(Goal::Cells(4), 0.004));
    let cut: Vec<_> = run.rounds.windows(2).filter(|pair| pair[1].patches > pair[0].patches).collect();
    assert!(!cut.is_empty());
    for pair in cut {
        let (old, new) = (pair[0].patches, pair[1].patches);
        // A patch becomes at least two, so parts are at most twice the patches that are more.
        let (rows, parts) = (pair[1].rows_again, 2 * (new - old));
        assert!(rows > 0 && rows <= pair[0].elements);
        let most = rows * parts + pair[1].new_elements * new;
        assert!(pair[1].cost.form_factors <= most as u64, "{pair:?}");
    }
}

/// A sheet of 1 × 1 halfway between a floor and a light of 0.02 × 0.02: its shadow is 2 × 2 and its penumbra 0.02 wide, less than the
/// finest elements. Nothing but the floor reflects, so the shadow is black.
#[test]
fn a_hard_shadow_ends_within_one_of_the_finest_elements() {
    let at = |x: [f64; 2], y: [f64; 2], z: f64| {
        [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])].map(|(x, y)| DVec3::new(x, y, z))
    };
    let (light, blocker) = ([2.045, 1.95], 0.5);
    let mut loops = vec![(at([0.0, 4.0], [0.0, 4.0], 0.0).to_vec(), 0)];
    let around = |c: f64, half: f64| [c - half, c + half];
    loops.extend(sheet(at(around(light[0], blocker), around(light[1], blocker), 1.0)).map(|f| (f, 1)));
    let lamp: Vec<DVec3> = at(around(light[0], 0.01), around(light[1], 0.01), 2.0).into_iter().rev().collect();
    loops.push((lamp, 2));
    let scene = scene_of_loops(
        &loops,
        vec![material("floor", 0.5, 0.0), material("sheet", 0.0, 0.0), material("lamp", 0.0, 1e4)],
    );
    let settings = Adaptive {
        criterion: Criterion::Discontinuities,
        most_level: 5,
        senders: f64::INFINITY,
        ..Adaptive::new(Goal::Points, 1e-6)
    };
    let run = adaptive(&scene, Method::ANALYTIC, &settings).run;
    let finest = 4.0 / (4.0 * 32.0);
    let (mesh, exposed) = (run.geometry.mesh(), run.geometry.exposed());
    let mut crossing = 0;
    for (k, &e) in exposed.iter().enumerate().filter(|(_, e)| mesh.elements[**e as usize].surface == 0) {
        let (polygon, h) = (&mesh.element_facets.polygons(e as usize)[0], run.solution.irradiance.band(0)[k]);
        // How far outside the shadow: ends of the range over the element.
        let outside = |v: &DVec3| (v.x - light[0]).abs().max((v.y - light[1]).abs()) - 1.0;
        let all = polygon.vertices().iter().map(outside);
        let (least, most) = (all.clone().fold(f64::INFINITY, f64::min), all.fold(f64::NEG_INFINITY, f64::max));
        if least < -0.011 && most > 0.011 {
            assert_eq!(mesh.elements[e as usize].level, 5, "at {}", polygon.centroid());
            crossing += 1;
        }
        // An emitter this small is a point: H = E A cos⁴θ/(π h²).
        let c = polygon.centroid();
        let r2 = (c - DVec3::new(light[0], light[1], 2.0)).length_squared();
        let open = 1e4 * 0.02 * 0.02 * 4.0 / (std::f64::consts::PI * r2 * r2);
        if most < -finest {
            assert_eq!(h, 0.0, "dark at {c}");
        } else if least > finest {
            assert!(h > 0.9 * open, "lit at {c}: {h} of {open}");
        }
    }
    // 4 × 2/(1/32) elements along the edge.
    assert!((250..=270).contains(&crossing), "{crossing}");
}

/// Steeper than a tenth of the mean level from one element to the next: cut until they are not.
#[test]
fn the_gradient_criterion_levels_the_steps_between_elements() {
    let scene = FloorUnderLight::default().scene();
    let settings =
        Adaptive { criterion: Criterion::Gradient(0.2), senders: f64::INFINITY, ..Adaptive::new(Goal::Points, 1e-6) };
    let rounds = adaptive(&scene, Method::ANALYTIC, &settings).rounds;
    let (first, last) = (rounds[0].estimate.elements, rounds[rounds.len() - 1].estimate.elements);
    // Steps of 0.2 along both directions: √(2/12) · 0.2.
    assert!(last < 0.2 * (2.0_f64 / 12.0).sqrt() && first > 2.0 * last, "{first} to {last}");
}

#[test]
fn one_and_two_threads_give_the_same_run() {
    let scene = common::cornell_box();
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let settings = Adaptive { most_elements: 1500, ..Adaptive::new(Goal::Points, 0.05) };
            let run = adaptive(&scene, Method::RaysAndEmitters { rays: 64 }, &settings);
            (run.rounds, run.run.solution.irradiance)
        })
    };
    assert!(with(1) == with(2));
}

/// A light close to the floor. Points are more than the elements along an edge and no multiple of them: one in each would see no error.
#[test]
fn a_fifth_of_the_elements_reaches_the_same_error_at_points() {
    let exact = FloorUnderLight { light_x: [1.0, 1.4], light_y: [1.4, 1.8], height: 0.4, ..FloorUnderLight::default() };
    let scene = exact.scene();
    let error = |geometry: &radiosity::Geometry<'_>, h: &BandValues| {
        let points = GridValues::points(geometry, h, 250).on(&[0]);
        let centre = |k: u32| (f64::from(k) + 0.5) / 250.0;
        let truth: Vec<f64> = points.indices.iter().map(|&(i, j)| exact.irradiance(centre(i), centre(j))).collect();
        points.error(&GridValues { values: BandValues::single(truth), ..points.clone() }).rms
    };
    let settings = Adaptive { senders: f64::INFINITY, ..Adaptive::new(Goal::Points, 0.12) };
    let adaptive = adaptive(&scene, Method::ANALYTIC, &settings).run;
    let reached = error(&adaptive.geometry, &adaptive.solution.irradiance);
    let elements = adaptive.geometry.elements().len();
    // Uniform elements, five times as many.
    let k = (5.0 * elements as f64 / 2.0).sqrt().ceil() as u32;
    let mut uniform = strategy(Method::ANALYTIC);
    uniform.mesh.elements = Subdivision::Uniform(k.next_multiple_of(4));
    uniform.mesh.patches = Some(Subdivision::Uniform(4));
    uniform.shape = radiosity::Shape::ElementsToPatches;
    let uniform = run(&scene, &uniform, &mut ()).unwrap();
    let worse = error(&uniform.geometry, &uniform.solution.irradiance);
    assert!(uniform.geometry.elements().len() >= 5 * elements);
    assert!(reached < worse, "{elements} elements reach {reached:e}, five times as many uniform ones {worse:e}");
}

/// A tube of 1 × 1 × 4 in cells of ½: two along its ends, which must be halved twice before eight report cells can be told apart.
#[test]
fn elements_are_as_fine_as_the_report_cells_whatever_the_patches() {
    let mut loops: Vec<_> = faces(DVec3::ZERO, DVec3::new(1.0, 1.0, 4.0), true).into_iter().map(|f| (f, 0)).collect();
    loops[4].1 = 1;
    let scene = scene_of_loops(&loops, vec![material("wall", 0.3, 0.0), material("light", 0.0, 1.0)]);
    let cells = Subdivision::EdgeLength(0.5);
    let settings = Adaptive { cells, level: 0, ..Adaptive::new(Goal::Cells(8), 0.02) };
    let run = adaptive(&scene, Method::ANALYTIC, &settings);
    let mesh = run.run.geometry.mesh();
    assert!((0..6).all(|s| mesh.elements.iter().filter(|e| e.surface == s).count() >= 64));
    let fine = run_adaptive(
        &scene,
        &strategy(Method::ANALYTIC),
        &Adaptive { cells: Subdivision::EdgeLength(0.25), ..Adaptive::new(Goal::Cells(8), 0.002) },
    );
    let fine = fine.unwrap().run;
    let truth = GridValues::means(&fine.geometry, &fine.solution.irradiance, 8).unwrap();
    let (estimate, error) = (estimated(&run), true_error(&run, &truth));
    assert!((1.0..5.0).contains(&(estimate / error)), "estimate {estimate:e}, error {error:e}");
}
