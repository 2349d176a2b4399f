//! The same inputs give the same bytes: in a second run, and in pools of 1, 2 and 8 threads.

use radiosity::{Method, Run, Shape, Store, Strategy, run};
use radiosity_core::Cost;
use radiosity_gallery::boxes::{box_in_cube, material};
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::Subdivision;

const METHODS: [Method; 4] = [Method::sampled(1e-8, 32), Method::RAY_CAST, Method::RAYS_AND_EMITTERS, Method::HEMICUBE];

/// Everything that a run gives but times, floats by their bits.
#[derive(Debug, PartialEq)]
struct Bytes {
    radiosity: Vec<u64>,
    irradiance: Vec<u64>,
    scalars: [u64; 3],
    costs: [Cost; 3],
    steps: u64,
    stored_bytes: u64,
}

fn bytes(run: &Run<'_>) -> Bytes {
    let (s, bits) = (&run.solution, |values: &[f64]| values.iter().map(|v| v.to_bits()).collect());
    Bytes {
        radiosity: bits(s.radiosity.values()),
        irradiance: bits(s.irradiance.values()),
        scalars: [s.unshot, s.contraction().unwrap_or(-1.0), s.bound().unwrap_or(-1.0)].map(f64::to_bits),
        costs: [run.form_factors.cost, s.cost, s.verification],
        steps: s.steps,
        stored_bytes: run.stored_bytes,
    }
}

fn in_pool(threads: usize, scene: &Scene, strategy: &Strategy) -> Bytes {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| bytes(&run(scene, strategy, &mut ()).unwrap()))
}

fn repeats(scene: &Scene, strategy: &Strategy) {
    let one = in_pool(1, scene, strategy);
    for (what, threads) in [("a second run", 1), ("2 threads", 2), ("8 threads", 8)] {
        let same = in_pool(threads, scene, strategy) == one;
        let Strategy { method, store, shape, solver, .. } = strategy;
        assert!(same, "{what} of {solver}, {shape:?} on {store:?} of {} rows gives other bytes", method.name());
    }
}

/// A lit room with a box inside, unequal reflectances.
fn scene() -> Scene {
    box_in_cube(0.4, material("room", 0.7, 0.0), material("lamp", 0.2, 3.0))
}

#[test]
fn every_solver_on_every_estimator_gives_the_same_bytes_in_any_pool() {
    let scene = scene();
    for method in METHODS {
        for solver in radiosity_solvers::NAMES {
            let pairwise = matches!(method, Method::Analytic { .. });
            if radiosity_solvers::by_name(solver).unwrap().needs().symmetric && !pairwise {
                continue;
            }
            let strategy = Strategy { solver: solver.to_owned(), ..Strategy::new(Subdivision::Uniform(3), method) };
            repeats(&scene, &strategy);
        }
    }
}

#[test]
fn every_store_and_form_gives_the_same_bytes_in_any_pool() {
    let scene = scene();
    for method in METHODS {
        for (shape, solver, store) in [
            (Shape::Full, "jacobi", Store::Sparse),
            (Shape::Full, "shooting", Store::KeepAll),
            (Shape::Full, "shooting", Store::KeepNone),
            (Shape::Full, "stochastic", Store::KeepNone),
            (Shape::PatchesToElements, "stochastic", Store::Dense),
            (Shape::ElementsToPatches, "gauss-seidel", Store::Sparse),
            (Shape::PatchesToElements, "shooting", Store::KeepAll),
            (Shape::TwoLevel, "direct", Store::Dense),
        ] {
            let plain = Strategy::new(Subdivision::Uniform(2), method);
            let mut strategy = Strategy { shape, store, solver: solver.to_owned(), unshot: 1e-2, steps: 200, ..plain };
            strategy.mesh.patches = Some(Subdivision::Uniform(1));
            repeats(&scene, &strategy);
        }
    }
}

#[test]
fn another_seed_gives_other_bytes_where_something_is_sampled() {
    let scene = scene();
    for method in METHODS {
        let strategy = Strategy::new(Subdivision::Uniform(2), method);
        let other = Strategy { seed: strategy.seed + 1, ..strategy.clone() };
        assert_ne!(in_pool(1, &scene, &strategy), in_pool(1, &scene, &other), "{}", method.name());
    }
}
