//! All solvers agree on the Cornell box: on a symmetric store whatever they do, on a row-wise one if they read the same
//! way.

mod common;

use radiosity::{Geometry, Method, Store, assemble};
use radiosity_core::{BandValues, Direction, Form, FormFactors, Outcome, StopRule, System, solve};
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::{MeshSettings, Subdivision};

/// η = 1e-12 with 1/(1 − ρ) below 5 bounds Σ A|ΔB|/Σ A E by 4e-12; an element has more than 1e-3 of the area, and the
/// mean of B is about that of E. 1e-8 is asked; what is left is near 1e-12.
const UNSHOT: f64 = 1e-12;
const AGREE: f64 = 1e-8;

fn geometry(scene: &Scene) -> Geometry<'_> {
    let settings = MeshSettings { elements: Subdivision::Uniform(3), patches: None, contacts: true };
    Geometry::new(scene, &settings).unwrap()
}

/// B by every solver that can read `store` in `direction`, with its name.
fn solutions(
    geometry: &Geometry<'_>,
    store: &dyn FormFactors,
    direction: Direction,
) -> Vec<(&'static str, BandValues)> {
    let (areas, e, rho) = (geometry.elements().areas(), geometry.emission(), geometry.reflectance());
    let system = System::full(store, &areas, e.view(), rho.view()).unwrap();
    let mut all = Vec::new();
    for name in radiosity_solvers::NAMES {
        let Ok(Some(mut solver)) = radiosity_solvers::by_name_in(name, direction) else { continue };
        if solver.needs().symmetric && !store.properties().symmetric {
            continue;
        }
        let solution = solve(&system, &mut *solver, &StopRule::unshot(UNSHOT), &mut ()).unwrap();
        assert_eq!(solution.outcome, Outcome::Converged, "{name} on {}", store.name());
        all.push((name, solution.radiosity));
    }
    all
}

/// Largest |difference| over the mean of the first.
fn difference(a: &BandValues, b: &BandValues) -> f64 {
    let mean = a.values().iter().sum::<f64>() / a.values().len() as f64;
    a.values().iter().zip(b.values()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / mean
}

#[test]
fn every_solver_on_every_symmetric_store_gives_one_answer_in_both_directions() {
    let scene = common::cornell_box();
    let geometry = geometry(&scene);
    // Few segments: what is solved is another system then, but the same for all.
    let method = Method::sampled(1e-6, 64);
    let mut reference: Option<BandValues> = None;
    for kind in Store::ALL.into_iter().chain(Store::SYMMETRIC) {
        // Recomputed rows would take most of a minute for nothing new: one estimator call more for each entry read.
        if kind == Store::KeepNone {
            continue;
        }
        let (store, _) = assemble(&geometry, method, Form::Full, kind, 1).unwrap();
        for direction in [Direction::Gather, Direction::Shoot] {
            let solutions = solutions(&geometry, &*store, direction);
            let names: Vec<&str> = solutions.iter().map(|(name, _)| *name).collect();
            let wanted: &[&str] = match direction {
                Direction::Gather => &radiosity_solvers::NAMES[..9],
                Direction::Shoot => &[
                    "direct",
                    "direct-f32",
                    "jacobi",
                    "chebyshev",
                    "cg",
                    "deflated-cg",
                    "gmres",
                    "shooting",
                    "overshooting",
                ],
            };
            assert_eq!(names, wanted);
            for (name, b) in solutions {
                let reference = reference.get_or_insert_with(|| b.clone());
                let difference = difference(reference, &b);
                // Single precision solves a system rounded by 2⁻²⁴ = 6e-8, whose answer is off by 1/(1 − ρ) of that.
                let agree = if kind == Store::PackedSingle { 1e-6 } else { AGREE };
                assert!(difference < agree, "{name} on {}, {direction:?}: {difference:e}", kind.name());
            }
        }
    }
}

#[test]
fn solvers_on_row_wise_stores_agree_with_those_that_read_the_same_way_and_with_no_other() {
    let scene = common::cornell_box();
    let geometry = geometry(&scene);
    for method in [Method::RAY_CAST, Method::RAYS_AND_EMITTERS, Method::Hemicube { resolution: 64 }] {
        let mut per_direction: Vec<Vec<BandValues>> = vec![Vec::new(); 2];
        for kind in [Store::Dense, Store::Sparse, Store::KeepAll] {
            let (store, _) = assemble(&geometry, method, Form::Full, kind, 1).unwrap();
            for (k, direction) in [Direction::Gather, Direction::Shoot].into_iter().enumerate() {
                let solutions = solutions(&geometry, &*store, direction);
                // Direct twice, jacobi, gmres, and two that go element by element.
                assert_eq!(solutions.len(), 6, "{direction:?}");
                per_direction[k].extend(solutions.into_iter().map(|(_, b)| b));
            }
        }
        for same in &per_direction {
            for b in same {
                let difference = difference(&same[0], b);
                assert!(difference < AGREE, "{}: {difference:e}", method.name());
            }
        }
        // Two systems: reading along rows and along columns differ by several percent of the mean.
        let apart = difference(&per_direction[0][0], &per_direction[1][0]);
        assert!(apart > 1e-3, "{}: {apart:e}", method.name());
    }
}
