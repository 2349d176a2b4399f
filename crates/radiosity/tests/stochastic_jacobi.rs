//! Stochastic Jacobi iteration by rays of its own, through the facade: right to its standard error, with no form factor at all.

mod common;

use radiosity::{GridValues, Method, Run, Store, Strategy, run};
use radiosity_core::Outcome;
use radiosity_gallery::boxes::{box_in_cube, material};
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::Subdivision;

fn strategy(k: u32, unshot: f64, seed: u64) -> Strategy {
    let plain = Strategy::new(Subdivision::Uniform(k), Method::RAY_CAST);
    Strategy { store: Store::KeepNone, solver: "stochastic".to_owned(), unshot, seed, ..plain }
}

fn exact(scene: &Scene, k: u32) -> Run<'_> {
    run(scene, &Strategy::new(Subdivision::Uniform(k), Method::ANALYTIC), &mut ()).unwrap()
}

/// Σ A|B − B*| / Σ A E of the worst band.
fn error(run: &Run<'_>, exact: &Run<'_>) -> f64 {
    let (areas, emission) = (run.geometry.elements().areas(), run.geometry.emission());
    let (found, wanted) = (&run.solution.radiosity, &exact.solution.radiosity);
    let of_band = |b: usize| {
        let apart = found.band(b).iter().zip(wanted.band(b)).zip(&areas).map(|((x, y), a)| a * (x - y).abs());
        apart.sum::<f64>() / emission.band(b).iter().zip(&areas).map(|(e, a)| a * e).sum::<f64>()
    };
    (0..emission.count()).map(of_band).fold(0.0, f64::max)
}

/// Nothing is stored, no row is ever had, no bound claimed; three bands, and shadows of two boxes.
#[test]
fn the_cornell_box_is_right_to_the_error_claimed_and_only_rays_were_cast() {
    let scene = common::cornell_box();
    let exact = exact(&scene, 3);
    for seed in [1, 2, 3] {
        let run = run(&scene, &strategy(3, 0.02, seed), &mut ()).unwrap();
        let (solution, cost) = (&run.solution, run.cost() + run.solution.verification);
        assert_eq!(solution.outcome, Outcome::Converged);
        assert_eq!((run.stored_bytes, cost.form_factors, cost.source_evaluations, cost.entries), (0, 0, 0, 0));
        assert!(cost.rays >= 64 * run.geometry.elements().len() as u64);
        assert!(solution.certificate.is_none() && solution.unshot.is_nan());
        let claimed = solution.standard_error.unwrap();
        let error = error(&run, &exact);
        assert!(claimed <= 0.02 && error <= 1.5 * claimed, "seed {seed}: {error:e}, claimed {claimed:e}");
        // On a report grid as well, black or not.
        let grids = [&run, &exact].map(|run| GridValues::means(&run.geometry, &run.solution.irradiance, 3).unwrap());
        assert!(grids[0].error(&grids[1]).rms < 0.1);
    }
}

/// On kept rows the rows are what is solved: a last product and a bound, as for every other method.
#[test]
fn rows_that_are_held_are_drawn_from_and_certify() {
    let scene = box_in_cube(0.4, material("room", 0.7, 0.0), material("lamp", 0.2, 3.0));
    for store in [Store::Dense, Store::KeepAll] {
        let drawn = run(&scene, &Strategy { store, ..strategy(3, 0.02, 1) }, &mut ()).unwrap();
        let solved = Strategy { store, solver: "shooting".to_owned(), ..strategy(3, 1e-10, 1) };
        let solved = run(&scene, &solved, &mut ()).unwrap();
        let error = error(&drawn, &solved);
        assert!(error <= drawn.solution.bound().unwrap() && error < 0.02, "{store:?}: {error:e}");
        assert!(drawn.solution.cost.rays <= solved.solution.cost.rays, "{store:?}");
    }
}
