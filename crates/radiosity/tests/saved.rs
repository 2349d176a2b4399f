//! Saved form factors solve the system they were saved from, and repair closes what is closed.

mod common;

use radiosity::{FitError, Geometry, Method, RunError, SavedCell, SavedFormFactors, Store, Strategy};
use radiosity::{assemble, run, run_saved};
use radiosity_core::{Form, RowBuf};
use radiosity_form_factors::Rows;
use radiosity_form_factors::repair::RepairError;
use radiosity_gallery::boxes::{empty_box, material};
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::Subdivision;

fn strategy(k: u32, method: Method) -> Strategy {
    Strategy { unshot: 1e-12, ..Strategy::new(Subdivision::Uniform(k), method) }
}

/// The matrix of a mesh as a file would hold it: a row an element, zeros for those inside solids.
fn saved(geometry: &Geometry<'_>, method: Method) -> SavedFormFactors {
    let (store, _) = assemble(geometry, method, Form::Full, Store::Dense, 1).unwrap();
    let (mesh, exposed, mut buf) = (geometry.mesh(), geometry.exposed(), RowBuf::default());
    let (n, areas) = (mesh.elements.len(), mesh.areas());
    let mut values = vec![0.0; n * n];
    for (s, &row) in exposed.iter().enumerate() {
        store.row(s, 0, &mut buf).unwrap().entries.for_each(|t, value| {
            values[row as usize * n + exposed[t] as usize] = value / areas[row as usize];
        });
    }
    let cells = mesh.elements.iter().map(|e| SavedCell { surface: e.surface, cell: Some([e.i, e.j]) }).collect();
    let row_wise = !matches!(method, Method::Analytic { .. });
    SavedFormFactors {
        values,
        rows: n,
        columns: n,
        areas: Some(areas),
        cells: Some(cells),
        row_wise,
        ..Default::default()
    }
}

fn geometry<'a>(scene: &'a Scene, strategy: &Strategy) -> Geometry<'a> {
    Geometry::new(scene, &strategy.mesh).unwrap()
}

/// Largest difference of irradiances, relative to the largest irradiance.
fn difference(a: &radiosity::Run<'_>, b: &radiosity::Run<'_>) -> f64 {
    let (a, b) = (a.solution.irradiance.values(), b.solution.irradiance.values());
    let level = b.iter().copied().fold(0.0, f64::max);
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / level
}

/// Covered floor under the blocks and three bands; F · A loses two roundings an entry, and both runs stop at 1e-12.
#[test]
fn a_saved_matrix_gives_the_solution_of_the_run_it_came_from() {
    let scene = common::cornell_box();
    for (method, solver, symmetric) in [(Method::sampled(1e-6, 16), "cg", true), (Method::rays(64), "jacobi", false)] {
        let strategy = Strategy { solver: solver.to_owned(), ..strategy(2, method) };
        let direct = run(&scene, &strategy, &mut ()).unwrap();
        let geometry = geometry(&scene, &strategy);
        let rows = saved(&geometry, method).fit(&geometry).unwrap();
        assert_eq!(rows.symmetric(), symmetric);
        let again = run_saved(geometry, &rows, &strategy, &mut ()).unwrap();
        assert!(difference(&again, &direct) < 1e-11, "{method:?}: {:e}", difference(&again, &direct));
    }
}

/// Two directions that differ by 1e-7: within bounds of 1e-6 they are one pair, without they are two.
#[test]
fn bounds_decide_whether_two_directions_are_one_pair() {
    let scene = furnace();
    let strategy = strategy(1, Method::ANALYTIC);
    let geometry = geometry(&scene, &strategy);
    let mut plain = saved(&geometry, Method::ANALYTIC);
    plain.values[1] += 1e-7;
    let bounded = SavedFormFactors { bounds: Some(vec![1e-6; 6]), ..plain.clone() };
    let (plain, bounded) = (plain.fit(&geometry).unwrap(), bounded.fit(&geometry).unwrap());
    assert_eq!((plain.symmetric(), bounded.symmetric()), (false, true));
    // Equal areas of opposed faces, and the difference in row 0 alone.
    assert!((plain.apart() - 1e-7).abs() < 1e-12 && plain.apart() == bounded.apart());
    let error = run_saved(geometry, &plain, &strategy, &mut ()).map(|_| ()).unwrap_err();
    assert!(error.to_string().contains("symmetric"), "{error}");
}

#[test]
fn what_belongs_to_another_mesh_is_refused_with_both_numbers() {
    let scene = common::cornell_box();
    let strategy = strategy(1, Method::rays(16));
    let geometry = geometry(&scene, &strategy);
    let good = saved(&geometry, strategy.method);
    let n = good.rows;
    let refused = |change: &dyn Fn(&mut SavedFormFactors)| {
        let mut bad = good.clone();
        change(&mut bad);
        bad.fit(&geometry).map(|_| ()).unwrap_err()
    };
    assert_eq!(refused(&|s| s.columns = 3), FitError::Square { rows: n, columns: 3 });
    let fewer = refused(&|s| *s = SavedFormFactors { values: vec![0.0; 4], rows: 2, columns: 2, ..Default::default() });
    assert_eq!(fewer, FitError::Rows { rows: 2, elements: n });
    let area = refused(&|s| s.areas.as_mut().unwrap()[3] *= 1.0 + 1e-6);
    assert!(matches!(area, FitError::Area { row: 3, element: 3, .. }), "{area}");
    let cell = refused(&|s| s.cells.as_mut().unwrap()[5].surface = 999);
    assert!(matches!(cell, FitError::Cell { row: 5, saved: SavedCell { surface: 999, .. }, .. }), "{cell}");
    assert!(matches!(refused(&|s| s.bounds = Some(vec![0.0])), FitError::Length { has: 1, .. }));
    let covered = geometry.mesh().elements.iter().position(|e| e.covered).unwrap();
    let inside = refused(&|s| s.values[covered * n] = 0.5);
    assert!(matches!(inside, FitError::Nothing { row, column: 0, .. } if row == covered), "{inside}");
    // Rows of zeros for faces without an area belong to no element.
    let flat = SavedFormFactors {
        areas: Some(vec![0.0, 0.0]),
        values: vec![0.0; 4],
        rows: 2,
        columns: 2,
        ..Default::default()
    };
    assert_eq!(flat.fit(&geometry).map(|_| ()), Err(FitError::Rows { rows: 0, elements: n }));
}

/// A negative entry is no form factor, wherever it comes from.
#[test]
fn an_entry_below_0_is_refused_by_its_place() {
    let scene = furnace();
    let strategy = Strategy { solver: "jacobi".to_owned(), ..strategy(1, Method::ANALYTIC) };
    let geometry = geometry(&scene, &strategy);
    let mut bad = saved(&geometry, Method::ANALYTIC);
    bad.values[2] = -0.25;
    let rows = bad.fit(&geometry).unwrap();
    let error = run_saved(geometry, &rows, &strategy, &mut ()).map(|_| ()).unwrap_err();
    assert!(error.to_string().contains("from source 0 to target 2"), "{error}");
}

/// With E and ρ everywhere the same, B = E/(1 − ρ) if the rows close: sampled rows miss that, repaired ones do not.
#[test]
fn a_repaired_furnace_is_exact_whatever_the_estimator() {
    let scene = furnace();
    for method in [Method::ANALYTIC, Method::rays(64), Method::Hemicube { resolution: 32 }] {
        for store in [Store::Dense, Store::Sparse, Store::Packed, Store::PackedSingle] {
            let strategy = Strategy { repair: true, solver: "cg".to_owned(), store, ..strategy(2, method) };
            let made = match run(&scene, &strategy, &mut ()) {
                // The mean of both directions is taken of a dense matrix.
                Err(RunError::RepairStore { .. }) => {
                    assert!(!matches!(method, Method::Analytic { .. }) && store != Store::Dense);
                    continue;
                }
                made => made.unwrap(),
            };
            // Rounding of single precision, 6e-8 an entry, grows by 1/(1 − ρ) = 10.
            let allowed = if store == Store::PackedSingle { 1e-6 } else { 1e-10 };
            let b = made.solution.radiosity.values();
            assert!(b.iter().all(|b| (b / 10.0 - 1.0).abs() < allowed), "{method:?} {store:?}");
            let repair = made.repair.unwrap();
            assert_eq!(repair.symmetrised.is_some(), !matches!(method, Method::Analytic { .. }));
            assert!(repair.scaling.closure_after < 1e-13);
            let worst = made.checked.unwrap().checks.worst_rows[0].1;
            assert!((worst - 1.0).abs() < allowed, "{worst}");
        }
    }
}

/// A box of unequal sides, E = 1 and ρ = 0.9 on all of it.
fn furnace() -> Scene {
    empty_box([1.0, 2.0, 3.0], material("wall", 0.9, 1.0))
}

#[test]
fn an_open_scene_is_not_repaired() {
    let scene = common::cornell_box();
    let strategy = Strategy { repair: true, ..strategy(1, Method::ANALYTIC) };
    assert_eq!(run(&scene, &strategy, &mut ()).map(|_| ()), Err(RunError::Repair(RepairError::Open)));
}

/// Checks come with every run: row sums of a closed box, and pairs that the blocks only make smaller.
#[test]
fn every_run_with_a_store_is_checked() {
    let closed = run(&furnace(), &strategy(2, Method::ANALYTIC), &mut ()).unwrap().checked.unwrap();
    assert!(closed.closed && closed.blocked.is_none());
    assert!(closed.checks.closure.unwrap().1.abs() < 1e-9 && closed.checks.worst_rows.len() == 5);
    let scene = common::cornell_box();
    let open = run(&scene, &strategy(1, Method::sampled(1e-6, 64)), &mut ()).unwrap();
    let open = open.checked.unwrap();
    let blocked = open.blocked.unwrap();
    assert!(!open.closed && blocked.compared > 100 && blocked.reduced > 0, "{blocked:?}");
    assert_eq!((blocked.increased, open.checks.closure), (0, None));
    let recomputed =
        Strategy { store: Store::KeepNone, solver: "shooting".to_owned(), ..strategy(1, Method::HEMICUBE) };
    assert!(run(&scene, &Strategy { unshot: 1e-2, ..recomputed }, &mut ()).unwrap().checked.is_none());
}
