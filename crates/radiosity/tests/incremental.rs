//! Solving again after a change: the answer of a run from nothing, for less.

mod common;

use glam::DVec3;
use radiosity::{Method, RunError, Saving, Shape, Solved, Store, Strategy};
use radiosity_core::RowBuf;
use radiosity_gallery::boxes;
use radiosity_geometry::mesh::Subdivision;
use radiosity_geometry::{CompareError, Material, Polygon, Scene, Surface};

fn strategy(k: u32) -> Strategy {
    Strategy::new(Subdivision::Uniform(k), Method::ANALYTIC)
}

fn solved<'a>(scene: &'a Scene, strategy: &Strategy) -> Solved<'a> {
    Solved::new(scene, strategy, &mut ()).unwrap()
}

fn resolved<'b>(before: &Solved<'_>, scene: &'b Scene) -> (Solved<'b>, Saving) {
    before.resolve(scene, &mut ()).unwrap()
}

/// The scene with `surfaces` moved by `by`.
fn moved(scene: &Scene, surfaces: &[usize], by: DVec3) -> Scene {
    let mut scene = scene.clone();
    for &s in surfaces {
        for piece in &mut scene.surfaces[s].pieces {
            let corners: Vec<DVec3> = piece.vertices().iter().map(|v| *v + by).collect();
            *piece = Polygon::new(&corners).unwrap();
        }
    }
    scene
}

/// The surfaces whose name begins with `name`.
fn named(scene: &Scene, name: &str) -> Vec<usize> {
    (0..scene.surfaces.len()).filter(|&s| scene.surfaces[s].name.starts_with(name)).collect()
}

/// A room 3 × 4 × 2 with a lamp hanging below its ceiling, a plate that stands on the floor and sees one half of it, another that sees
/// the other half, and a shelf at a wall. Surfaces 0 to 5 are the walls, 6 the lamp, 7 and 8 the plates, 9 the shelf.
fn room() -> Scene {
    let mut loops: Vec<(Vec<DVec3>, usize)> =
        boxes::faces(DVec3::ZERO, DVec3::new(3.0, 4.0, 2.0), true).into_iter().map(|face| (face, 0)).collect();
    let at = DVec3::new;
    loops.push((vec![at(1.0, 1.0, 1.9), at(1.0, 2.0, 1.9), at(2.0, 2.0, 1.9), at(2.0, 1.0, 1.9)], 1));
    let plate = vec![at(1.7, 1.0, 0.0), at(1.7, 3.0, 0.0), at(1.7, 3.0, 1.1), at(1.7, 1.0, 1.1)];
    let back = plate.iter().rev().map(|v| *v - DVec3::X * 0.2).collect();
    loops.extend([(plate, 0), (back, 2)]);
    loops.push((vec![at(0.0, 0.5, 0.6), at(0.4, 0.5, 0.6), at(0.4, 0.9, 0.6), at(0.0, 0.9, 0.6)], 2));
    let material = |name: &str, rho: [f64; 2], e: [f64; 2]| Material::diffuse(name, rho.to_vec(), e.to_vec());
    let materials = vec![
        material("wall", [0.7, 0.5], [0.0; 2]),
        material("lamp", [0.0, 0.1], [5.0, 2.0]),
        material("red", [0.6, 0.1], [0.0; 2]),
    ];
    boxes::scene_of_loops(&loops, materials)
}

/// Where the kept and computed form factors are those of a run from nothing, to the last bit.
fn assert_same_form_factors(again: &Solved<'_>, cold: &Solved<'_>) {
    let (found, wanted) = (again.form_factors(), cold.form_factors());
    assert_eq!((found.sources(), found.targets()), (wanted.sources(), wanted.targets()));
    let (mut a, mut b) = (RowBuf::default(), RowBuf::default());
    let largest = again.run().geometry.elements().areas().into_iter().fold(0.0, f64::max);
    let rounding = if found.properties().rounding > 0.0 { 2.0_f64.powi(-24) * largest } else { 0.0 };
    for s in 0..found.sources() {
        let (a, b) = (found.row(s, 0, &mut a).unwrap().entries, wanted.row(s, 0, &mut b).unwrap().entries);
        for t in 0..found.targets() {
            assert_eq!(a.get(t).to_bits(), b.get(t).to_bits(), "{} entry ({s}, {t})", found.name());
        }
        // What single precision rounds is added once to the worst bound of a row, and here to that of the entries computed.
        assert!(found.bound(s).unwrap() >= wanted.bound(s).unwrap() - rounding, "{} bound of row {s}", found.name());
    }
}

/// Σ A|B − B'| / Σ A E of two answers of one system, all bands, lies within the sum of their proven bounds.
fn assert_same_answer(again: &Solved<'_>, cold: &Solved<'_>) {
    let (found, wanted) = (&again.run().solution, &cold.run().solution);
    let (areas, emission) = (again.run().geometry.elements().areas(), again.run().geometry.emission());
    for b in 0..emission.count() {
        let emitted: f64 = areas.iter().zip(emission.band(b)).map(|(a, e)| a * e).sum();
        let pairs = found.radiosity.band(b).iter().zip(wanted.radiosity.band(b));
        let apart: f64 = areas.iter().zip(pairs).map(|(a, (x, y))| a * (x - y).abs()).sum();
        // The sharper bound: columns of rows of rays may sum to more than 1/ρ, so that q has none.
        let [x, y] = [found, wanted].map(|solution| solution.certificate.and_then(|c| c.sharp_bound).unwrap());
        let bound = x + y;
        assert!(apart <= bound * emitted, "band {b}: {:e} apart, bounds {bound:e}", apart / emitted);
        // What single precision rounds off the entries is part of its bounds.
        let sharp = if again.form_factors().properties().rounding > 0.0 { 1e-5 } else { 1e-7 };
        assert!(bound < sharp, "{bound:e}");
    }
}

/// Solves `before`, then `after` from it; the answer, the form factors and the count of a whole run are those of a run from nothing.
fn after_change<'b>(before: &Scene, after: &'b Scene, strategy: &Strategy) -> (Solved<'b>, Saving) {
    let (again, saving) = resolved(&solved(before, strategy), after);
    let cold = solved(after, strategy);
    assert_same_form_factors(&again, &cold);
    assert_same_answer(&again, &cold);
    let whole = cold.run().form_factors.cost;
    assert_eq!((saving.of_form_factors, saving.of_rows), (whole.form_factors, whole.source_evaluations));
    let saving = again.count_cold_start(saving).unwrap();
    assert_eq!(saving.of_steps, Some(cold.run().solution.steps));
    assert!(saving.steps <= cold.run().solution.steps, "{saving}");
    (again, saving)
}

#[test]
fn other_emission_and_reflectance_compute_no_form_factor() {
    for scene in [common::cornell_box(), room()] {
        let mut after = scene.clone();
        after.materials[1].emission.iter_mut().for_each(|e| *e *= 1.5);
        after.materials[0].emission[1] = 0.02;
        after.materials[0].reflectance[0] = 0.4;
        let (again, saving) = after_change(&scene, &after, &strategy(3));
        assert_eq!((saving.form_factors, saving.rows), (0, 0));
        assert_eq!(saving.change.moved, []);
        assert_eq!(again.run().form_factors.cost, radiosity_core::Cost::default());
        assert!(again.run().checked.is_some());
    }
}

/// All light times 0.3 is all radiosity times 0.3: the start is the answer. Then a small lamp is added: its light is a thousandth of what
/// is there, and 3 of 9 decades are saved.
#[test]
fn dimming_all_lights_takes_no_step_and_a_small_lamp_few() {
    let scene = room();
    let mut dimmed = scene.clone();
    dimmed.materials[1].emission.iter_mut().for_each(|e| *e *= 0.3);
    let strategy = strategy(3);
    let before = solved(&scene, &strategy);
    let (after, saving) = resolved(&before, &dimmed);
    assert_eq!((saving.steps, saving.form_factors), (0, 0));
    let pairs = after.run().solution.radiosity.values().iter().zip(before.run().solution.radiosity.values());
    let worst = pairs.map(|(b, a)| (b / a / 0.3 - 1.0).abs()).fold(0.0, f64::max);
    // Both stopped at 1e-9 of the emitted power.
    assert!(worst < 1e-8, "{worst:e}");

    let mut lit = scene.clone();
    lit.materials.push(Material { emission: vec![0.02, 0.01], ..scene.materials[2].clone() });
    lit.surfaces[9].material = 3;
    let (_, saving) = after_change(&scene, &lit, &strategy);
    assert!(saving.steps < saving.of_steps.unwrap(), "{saving}");
    let (_, none) = after_change(&scene, &scene, &strategy);
    assert_eq!((none.steps, none.change.recoloured.len()), (0, 0));
}

/// Conjugate gradients of a kept answer and of a cold start end in different roundings, so only the bounds agree; form factors do to the
/// last bit, though the short block's contact cuts the floor otherwise and the tall one keeps its body.
#[test]
fn a_moved_block_of_the_cornell_box_leaves_the_pairs_that_do_not_meet_it() {
    let scene = common::cornell_box();
    let block = named(&scene, "short");
    assert_eq!(block.len(), 5);
    let after = moved(&scene, &block, DVec3::new(-20.0, 0.0, 15.0));
    let (_, saving) = after_change(&scene, &after, &strategy(4));
    assert_eq!(saving.change.moved, block);
    assert!(2 * saving.form_factors < saving.of_form_factors, "{saving}");
    // One face alone: the block is no body any more, and its other faces block otherwise than before.
    let after = moved(&scene, &block[..1], DVec3::new(0.0, 40.0, 0.0));
    let (_, saving) = after_change(&scene, &after, &strategy(3));
    assert!(2 * saving.form_factors < saving.of_form_factors, "{saving}");
}

#[test]
fn moved_plates_and_lamps_of_a_room_leave_the_pairs_that_do_not_meet_them() {
    let scene = room();
    let shapes = [
        (moved(&scene, &[9], DVec3::new(0.0, 0.7, 0.2)), "shelf"),
        (moved(&scene, &[7], DVec3::new(0.1, 0.3, 0.0)), "plate, along the floor"),
        (moved(&scene, &[7], DVec3::new(0.0, 0.0, 0.1)), "plate, off the floor"),
        (moved(&scene, &[6], DVec3::new(0.3, 0.0, 0.05)), "lamp"),
        // Twice the size of the scene: other units inside.
        (moved(&scene, &[0], DVec3::new(-6.0, 0.0, 0.0)), "wall, so that the room is open and other walls may block"),
    ];
    for (after, what) in &shapes {
        let (_, saving) = after_change(&scene, after, &strategy(3));
        assert!(saving.form_factors < saving.of_form_factors, "{what}: {saving}");
    }
    // Another shape: the shelf as a triangle.
    let mut after = scene.clone();
    let corners = after.surfaces[9].pieces[0].vertices()[..3].to_vec();
    after.surfaces[9] = Surface { pieces: vec![Polygon::new(&corners).unwrap()], ..after.surfaces[9].clone() };
    let (_, saving) = after_change(&scene, &after, &strategy(3));
    assert!(3 * saving.form_factors < saving.of_form_factors, "{saving}");
}

/// An open box of unit edge with a lid 0.4 × 0.4 hovering over it, which nothing is behind of: it blocks nothing, whatever its place. So the
/// pairs computed are those of its 9 cells with the 45 of the box, beside which there are 4 · 81 of the floor and 6 · 81 of the walls.
#[test]
fn what_blocks_nothing_changes_its_own_pairs_alone() {
    let mut loops: Vec<_> =
        boxes::faces(DVec3::ZERO, DVec3::ONE, true).into_iter().take(5).map(|face| (face, 0)).collect();
    let at = DVec3::new;
    loops.push((vec![at(0.2, 0.2, 1.1), at(0.2, 0.6, 1.1), at(0.6, 0.6, 1.1), at(0.6, 0.2, 1.1)], 1));
    let scene =
        boxes::scene_of_loops(&loops, vec![boxes::material("grey", 0.5, 0.0), boxes::material("lid", 0.0, 1.0)]);
    let after = moved(&scene, &[5], at(0.1, 0.2, 0.0));
    let (_, saving) = after_change(&scene, &after, &strategy(3));
    assert_eq!((saving.form_factors, saving.of_form_factors), (9 * 45, 10 * 81 + 9 * 45));
}

/// Two rooms joined by a door: a plate moved in one of them leaves nearly all pairs of the other.
#[test]
fn what_moves_out_of_sight_of_most_pairs_saves_most() {
    let wall = |x: f64, up: f64, (y, to): (f64, f64), z: f64| {
        let mut corners =
            vec![DVec3::new(x, y, z), DVec3::new(x, to, z), DVec3::new(x, to, 2.0), DVec3::new(x, y, 2.0)];
        if up < 0.0 {
            corners.reverse();
        }
        (corners, 0)
    };
    let (lo, hi) = (DVec3::ZERO, DVec3::new(6.0, 3.0, 2.0));
    let mut loops: Vec<_> = boxes::faces(lo, hi, true).into_iter().map(|face| (face, 0)).collect();
    // A wall of two sheets at x = 3, open for y < 0.3.
    loops.extend([wall(3.05, 1.0, (0.3, 3.0), 0.0), wall(2.95, -1.0, (0.3, 3.0), 0.0)]);
    let at = DVec3::new;
    loops.push((vec![at(1.0, 2.5, 1.0), at(1.3, 2.5, 1.0), at(1.3, 2.8, 1.0), at(1.0, 2.8, 1.0)], 1));
    let materials = vec![boxes::material("grey", 0.5, 0.0), boxes::material("lamp", 0.3, 1.0)];
    let scene = boxes::scene_of_loops(&loops, materials);
    let near = moved(&scene, &[8], at(0.1, -0.1, 0.2));
    let (_, out_of_sight) = after_change(&scene, &near, &strategy(4));
    let middle = moved(&near, &[8], at(1.2, -1.2, 0.0));
    let (_, in_the_middle) = after_change(&near, &middle, &strategy(4));
    assert!(4 * out_of_sight.form_factors < out_of_sight.of_form_factors, "{out_of_sight}");
    assert!(out_of_sight.form_factors < in_the_middle.form_factors, "{out_of_sight}; {in_the_middle}");
}

#[test]
fn moving_there_and_back_gives_the_first_answer() {
    let scene = common::cornell_box();
    let block = named(&scene, "tall");
    for by in [DVec3::new(30.0, 0.0, -25.0), DVec3::new(0.0, 7.0, 0.0)] {
        let there = moved(&scene, &block, by);
        let first = solved(&scene, &strategy(3));
        let (away, _) = resolved(&first, &there);
        let (back, saving) = resolved(&away, &scene);
        assert_same_form_factors(&back, &first);
        assert_same_answer(&back, &first);
        assert_eq!(saving.of_form_factors, first.run().form_factors.cost.form_factors);
    }
}

#[test]
fn every_store_that_holds_and_every_form_is_updated() {
    let scene = room();
    let after = moved(&scene, &[7], DVec3::new(0.1, 0.3, 0.0));
    for store in [Store::Dense, Store::Sparse, Store::Packed, Store::PackedSingle] {
        let (_, saving) = after_change(&scene, &after, &Strategy { store, ..strategy(2) });
        assert!(saving.form_factors < saving.of_form_factors, "{store:?}: {saving}");
    }
    for (shape, solver) in
        [(Shape::ElementsToPatches, "gauss-seidel"), (Shape::PatchesToElements, "jacobi"), (Shape::TwoLevel, "cg")]
    {
        let mut strategy = Strategy { shape, solver: solver.to_owned(), ..strategy(4) };
        strategy.mesh.patches = Some(Subdivision::Uniform(2));
        let (_, saving) = after_change(&scene, &after, &strategy);
        assert!(saving.form_factors < saving.of_form_factors, "{shape:?}: {saving}");
    }
    let on_demand = Strategy { store: Store::KeepAll, ..strategy(2) };
    let refused = Solved::new(&scene, &on_demand, &mut ()).map(|_| ()).unwrap_err();
    assert_eq!(refused, RunError::NothingHeld { store: "on-demand, kept" });
}

/// Rows are kept whole: those of the cells that look away from the shelf in its old and new place, where the seed of a row is as it was.
#[test]
fn rows_that_look_away_from_a_change_are_kept() {
    // A black shelf shines neither here nor there.
    let mut scene = room();
    scene.materials[2].reflectance.fill(0.0);
    let after = moved(&scene, &[9], DVec3::new(0.0, 0.7, 0.2));
    for method in [Method::rays(64), Method::RaysAndEmitters { rays: 64 }, Method::Hemicube { resolution: 16 }] {
        let strategy = Strategy { solver: "gauss-seidel".into(), method, ..strategy(2) };
        let (_, saving) = after_change(&scene, &after, &strategy);
        // The ceiling lamp and its neighbours see the shelf; the plate that looks away from it, and itself from below, do not.
        assert!(saving.rows < saving.of_rows, "{method:?}: {saving}");
    }
}

/// Moved under the lamp, the shelf is one of the surfaces whose totals are exact.
#[test]
fn what_begins_to_shine_is_a_new_target_for_rays_with_exact_emitters() {
    let scene = room();
    let after = moved(&scene, &[9], DVec3::new(0.0, 0.7, 0.2));
    let method = Method::RaysAndEmitters { rays: 64 };
    let (_, saving) = after_change(&scene, &after, &Strategy { solver: "gauss-seidel".into(), method, ..strategy(2) });
    assert_eq!(saving.form_factors, saving.of_form_factors);
}

#[test]
fn a_new_emitter_is_a_new_target_for_rays_with_exact_emitters() {
    let scene = room();
    let mut after = scene.clone();
    after.materials[2].emission[0] = 1.0;
    let method = Method::RaysAndEmitters { rays: 64 };
    let strategy = Strategy { solver: "gauss-seidel".into(), method, ..strategy(2) };
    let (_, saving) = after_change(&scene, &after, &strategy);
    assert_eq!(saving.form_factors, saving.of_form_factors);
    after.materials[2].emission[0] = 0.0;
    after.materials[1].emission[0] = 9.0;
    let (_, saving) = after_change(&scene, &after, &strategy);
    assert_eq!(saving.form_factors, 0);
}

/// Segments of a pair are drawn by its indices: where the mesh keeps its cells, they are the same.
#[test]
fn sampled_pairs_are_kept_where_nothing_reaches_them() {
    let scene = room();
    let after = moved(&scene, &[9], DVec3::new(0.0, 0.7, 0.2));
    let (_, saving) = after_change(&scene, &after, &Strategy { method: Method::sampled(1e-8, 32), ..strategy(2) });
    assert!(saving.form_factors < saving.of_form_factors, "{saving}");
}

#[test]
fn a_repaired_store_serves_other_materials_and_is_computed_again_after_a_move() {
    let scene = boxes::box_in_cube(0.4, boxes::material("room", 0.9, 0.0), boxes::material("lamp", 0.2, 1.0));
    let strategy = Strategy { repair: true, ..strategy(2) };
    let mut after = scene.clone();
    after.materials[0].reflectance[0] = 0.8;
    let (again, saving) = after_change(&scene, &after, &strategy);
    assert_eq!((saving.form_factors, again.run().repair.is_some()), (0, true));
    let after = moved(&scene, &(6..12).collect::<Vec<_>>(), DVec3::X * 0.1);
    let (_, saving) = after_change(&scene, &after, &strategy);
    assert_eq!(saving.form_factors, saving.of_form_factors);
}

#[test]
fn scenes_of_other_surfaces_are_refused_and_the_old_answer_stays() {
    let scene = room();
    let mut fewer = scene.clone();
    fewer.surfaces.pop();
    let before = solved(&scene, &strategy(1));
    let refused = before.resolve(&fewer, &mut ()).map(|_| ()).unwrap_err();
    assert_eq!(refused, RunError::Compare(CompareError::Surfaces { before: 10, after: 9 }));
    assert_eq!(resolved(&before, &scene).1.steps, 0);
}
