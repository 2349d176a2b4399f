//! Every method on every store of the integrating sphere, whose answer is exact; F_ss ≠ 0 throughout.

use radiosity_core::{Direction, Form, Outcome, Solver, StopRule, solve};
use radiosity_gallery::IntegratingSphere;
use radiosity_solvers::{Direct, Factorisation, Jacobi, all, ambient};

const AREAS: [f64; 7] = [0.5, 1.0, 2.0, 0.25, 3.0, 0.75, 1.5];
const PARENT: [u32; 7] = [0, 1, 1, 2, 0, 2, 0];
const E: [f64; 7] = [1.0, 0.0, 0.5, 0.0, 0.0, 2.0, 0.0];
const RHO: [f64; 7] = [0.0, 0.9, 0.5, 0.3, 0.7, 0.2, 0.6];

fn sphere() -> IntegratingSphere {
    IntegratingSphere::new(&AREAS)
}

/// Every method, in each direction and factorisation that it has.
fn solvers() -> Vec<Box<dyn Solver>> {
    let mut solvers = all();
    solvers.push(Box::new(Jacobi::new(Direction::Shoot)));
    for factorisation in [Factorisation::Cholesky, Factorisation::Lu] {
        solvers.push(Box::new(Direct::new(factorisation, Direction::Gather)));
        solvers.push(Box::new(Direct::new(factorisation, Direction::Shoot)));
    }
    solvers
}

/// Inside a sphere F_s,t = A_t/A for any subdivision, so B_e = E_e + ρ_e H with H = ⟨E⟩/(1 − ⟨ρ⟩), ⟨·⟩ the
/// area mean. η ≤ 1e-14 and 1/(1 − ρ_max) = 10 bound the summed error; 1e-11 leaves room for 7 unequal areas.
#[test]
fn every_solver_on_every_store_matches_the_integrating_sphere() {
    let sphere = sphere();
    let wanted = sphere.radiosity(&E, &RHO);
    for store in sphere.stores() {
        for mut solver in solvers() {
            let stop = StopRule::unshot(1e-14);
            let solution = solve(&sphere.system(&*store, &E, &RHO), &mut *solver, &stop, &mut ()).unwrap();
            let place = format!("{} on {}", solver.name(), store.name());
            assert_eq!(solution.outcome, Outcome::Converged, "{place}");
            assert!(solution.unshot <= 1e-14, "{place}: recomputed η is {}", solution.unshot);
            for (e, b) in solution.radiosity.values().iter().enumerate() {
                assert!((b - wanted[e]).abs() < 1e-11, "{place}, element {e}: {b} for {}", wanted[e]);
            }
        }
    }
}

/// As above: patch means keep the area mean, so the substructured forms have the same answer.
#[test]
fn every_solver_that_reads_a_substructured_form_matches_the_integrating_sphere() {
    let sphere = sphere();
    let wanted = sphere.radiosity(&E, &RHO);
    for form in [Form::ElementsToPatches, Form::PatchesToElements] {
        let mut run = Vec::new();
        for store in sphere.stores_of(form, &PARENT) {
            for mut solver in all().into_iter().filter(|solver| solver.needs().forms.contains(&form)) {
                let system = sphere.system_of(form, &PARENT, &*store, &E, &RHO);
                let solution = solve(&system, &mut *solver, &StopRule::unshot(1e-14), &mut ()).unwrap();
                let place = format!("{} on {} {form:?}", solver.name(), store.name());
                assert_eq!(solution.outcome, Outcome::Converged, "{place}");
                for (e, b) in solution.radiosity.values().iter().enumerate() {
                    assert!((b - wanted[e]).abs() < 1e-11, "{place}, element {e}: {b} for {}", wanted[e]);
                }
                run.push(solver.name());
            }
        }
        // Jacobi, GMRES, and Gauss–Seidel or both kinds of shooting, on four stores.
        let methods = if form == Form::ElementsToPatches { 3 } else { 4 };
        assert_eq!(run.len(), 4 * methods, "{form:?}: {run:?}");
    }
}

/// With as many patches as elements the store hands out blocks as in the full form, whatever the parent map.
#[test]
fn one_patch_an_element_in_another_order_changes_nothing() {
    let sphere = sphere();
    let parent = [3, 0, 6, 1, 5, 2, 4];
    let wanted = sphere.radiosity(&E, &RHO);
    for form in [Form::ElementsToPatches, Form::PatchesToElements] {
        for store in sphere.stores_of(form, &parent) {
            for mut solver in all().into_iter().filter(|solver| solver.needs().forms.contains(&form)) {
                let system = sphere.system_of(form, &parent, &*store, &E, &RHO);
                let solution = solve(&system, &mut *solver, &StopRule::unshot(1e-14), &mut ()).unwrap();
                let error = solution.radiosity.values().iter().zip(&wanted).map(|(b, w)| (b - w).abs());
                assert!(error.fold(0.0, f64::max) < 1e-11, "{} on {} {form:?}", solver.name(), store.name());
            }
        }
    }
}

/// Four bands: two share a reflectance, one is dark, one has no reflection at all.
#[test]
fn every_band_has_its_own_answer() {
    let sphere = sphere();
    let grey = [0.5; 7];
    let e = [E, E.map(|e| 3.0 - e), [0.0; 7], E].concat();
    let rho = [RHO, grey, RHO, [0.0; 7]].concat();
    let store = &sphere.stores()[0];
    for mut solver in solvers() {
        let system = sphere.system(&**store, &e, &rho);
        let solution = solve(&system, &mut *solver, &StopRule::unshot(1e-13), &mut ()).unwrap();
        assert_eq!(solution.outcome, Outcome::Converged, "{}", solver.name());
        for band in 0..4 {
            let part = band * 7..(band + 1) * 7;
            let wanted = sphere.radiosity(&e[part.clone()], &rho[part]);
            let error = solution.radiosity.band(band).iter().zip(&wanted).map(|(b, w)| (b - w).abs());
            assert!(error.fold(0.0, f64::max) < 1e-11, "{}, band {band}", solver.name());
        }
    }
}

/// In a sphere unshot light does spread evenly, so the ambient term is exact after any number of shots.
#[test]
fn the_ambient_term_is_exact_in_a_sphere_after_any_number_of_shots() {
    let sphere = sphere();
    let store = &sphere.stores()[0];
    let system = sphere.system(&**store, &E, &RHO);
    let wanted = sphere.radiosity(&E, &RHO);
    let mut solver = radiosity_solvers::Shooting::default();
    let (mut iterate, _) = solver.start(&system, None).unwrap();
    for shot in 0..20 {
        let shown = ambient::display(&system, &iterate).unwrap();
        for (e, shown) in shown.values().iter().enumerate() {
            assert!((shown - wanted[e]).abs() < 1e-14 * 20.0, "after {shot} shots, element {e}");
        }
        solver.step(&system, &mut iterate).unwrap();
    }
}
