//! What is said of an answer before and after it is computed, against exact answers.

use radiosity_core::{BandValues, Direction, Forecast, StopRule, System, solve};
use radiosity_form_factors::stores::DenseFormFactors;
use radiosity_gallery::{IntegratingSphere, RandomEnclosure};
use radiosity_solvers::{Direct, all, by_name};

fn reference(system: &System<'_>) -> BandValues {
    solve(system, &mut Direct::default(), &StopRule::unshot(0.0).steps(4), &mut ()).unwrap().radiosity
}

/// Σ A|B − B*| / Σ A E of a system of one band.
fn error(system: &System<'_>, b: &BandValues, exact: &BandValues) -> f64 {
    let apart = b.values().iter().zip(exact.values()).zip(system.areas());
    apart.map(|((b, exact), a)| a * (b - exact).abs()).sum::<f64>() / system.power(system.emission().band(0))
}

#[test]
fn the_error_stays_under_the_sharp_bound_and_that_under_the_plain_one() {
    let enclosure = RandomEnclosure::new(120, 21);
    let store = enclosure.dense();
    let system = enclosure.system(&store);
    let exact = reference(&system);
    for eta in [1e-2, 1e-5, 1e-9] {
        for mut solver in all() {
            let solution = solve(&system, &mut *solver, &StopRule::unshot(eta), &mut ()).unwrap();
            let certificate = solution.certificate.unwrap();
            let (error, sharp, plain) = (
                error(&system, &solution.radiosity, &exact),
                certificate.sharp_bound.unwrap(),
                certificate.bound.unwrap(),
            );
            // The reference itself is right to a few hundred roundings.
            assert!(error <= sharp + 1e-13, "{} at {eta:e}: error {error:e}, {sharp:e}", solver.name());
            // Rounding is accounted for element by element in one and in all in the other.
            assert!(sharp <= 1.01 * plain + 1e-12, "{} at {eta:e}: {sharp:e}, {plain:e}", solver.name());
        }
    }
}

/// Bright elements that see each other more than a closed room allows make q > 1; the room as a whole still contracts.
#[test]
fn a_system_with_q_above_1_that_contracts_has_a_sharp_bound() {
    let enclosure = RandomEnclosure::new(90, 22).scaled(1.08);
    let (n, store) = (enclosure.len(), enclosure.dense());
    let rho: Vec<f64> = (0..n).map(|k| if k % 9 == 0 { 0.95 } else { 0.3 }).collect();
    // The bright elements see each other more than their share: their own rows sum to more.
    let mut table: Vec<f64> = (0..n * n).map(|k| store.entry(k / n, k % n)).collect();
    for (k, value) in table.iter_mut().enumerate() {
        let (s, t) = (k / n, k % n);
        *value *= if s % 9 == 0 && t % 9 == 0 { 6.0 } else { 1.0 };
    }
    let store = DenseFormFactors::from_rows(&table, n, n, true).unwrap();
    let system = enclosure.system_with(&store, &enclosure.emission, &rho);
    let solution = solve(&system, &mut *by_name("jacobi").unwrap(), &StopRule::unshot(1e-6), &mut ()).unwrap();
    let certificate = solution.certificate.unwrap();
    let (forecast, _) = Forecast::new(&system, Direction::Gather, 12).unwrap();
    assert!(certificate.contraction > 1.0 && certificate.bound.is_none(), "{certificate:?}");
    assert!(forecast.radius.1 < 1.0, "{forecast:?}");
    let error = error(&system, &solution.radiosity, &reference(&system));
    assert!(error <= certificate.sharp_bound.unwrap(), "{error:e} {certificate:?}");
}

/// In a sphere F_st = A_t/A, so ρF has the one eigenvalue ⟨ρ⟩, and two products find it.
#[test]
fn the_forecast_of_a_sphere_is_its_mean_reflectance() {
    let sphere = IntegratingSphere::new(&[0.5, 1.0, 2.0, 0.25, 3.0]);
    let rho = [0.9, 0.2, 0.5, 0.7, 0.4];
    let store = sphere.stores().remove(0);
    let system = sphere.system(&*store, &[1.0, 0.0, 0.0, 0.0, 0.0], &rho);
    let (forecast, cost) = Forecast::new(&system, Direction::Gather, 3).unwrap();
    let mean = sphere.mean(&rho);
    assert!((forecast.radius.0 - mean).abs() < 1e-14 && (forecast.radius.1 - mean).abs() < 1e-14, "{forecast:?}");
    assert_eq!(cost.entries, 3 * 25);
}

/// In a well-mixed room Jacobi's sweeps are those of the largest eigenvalue, which lies inside its bounds; the others need no more
/// than forecast.
#[test]
fn forecast_steps_hold() {
    for rho in [0.5, 0.9, 0.99] {
        let enclosure = RandomEnclosure::new(200, 23).with_reflectance(rho);
        let store = enclosure.dense();
        let system = enclosure.system(&store);
        let (forecast, _) = Forecast::new(&system, Direction::Gather, 6).unwrap();
        let eta = 1e-9;
        let taken = |name: &str| {
            let solution = solve(&system, &mut *by_name(name).unwrap(), &StopRule::unshot(eta), &mut ()).unwrap();
            solution.steps as f64
        };
        let (least, most) = forecast.steps("jacobi", eta).unwrap();
        let jacobi = taken("jacobi");
        // η is evaluated to rounding: it may meet its target a step sooner or later.
        assert!(least - 1.0 <= jacobi && jacobi <= most + 1.0, "{jacobi} sweeps at {rho}, forecast {least} to {most}");
        // What is not asymptotic costs a few sweeps more.
        let (_, most) = forecast.steps("gauss-seidel", eta).unwrap();
        assert!(taken("gauss-seidel") <= 1.2 * most + 5.0, "{rho}");
        assert!(taken("cg") <= forecast.steps("cg", eta).unwrap().1, "{rho}");
        assert_eq!(forecast.steps("shooting", eta), None);
    }
}

/// A perturbed answer has the backward error of its perturbation, within the size of the terms.
#[test]
fn the_backward_error_is_the_relative_change_that_makes_the_answer_exact() {
    let enclosure = RandomEnclosure::new(80, 24);
    let store = enclosure.dense();
    let system = enclosure.system(&store);
    let solved = solve(&system, &mut Direct::default(), &StopRule::unshot(0.0).steps(3), &mut ()).unwrap();
    assert!(solved.certificate.unwrap().backward_error < 1e-14, "{:?}", solved.certificate);
    let loose = solve(&system, &mut *by_name("jacobi").unwrap(), &StopRule::unshot(1e-4), &mut ()).unwrap();
    let backward = loose.certificate.unwrap().backward_error;
    assert!(backward > 1e-7 && backward < 1e-3, "{backward:e}");
}
