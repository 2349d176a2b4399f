//! Every method on every stiff system: no silent wrong answer.

use radiosity_core::{FormFactors, Outcome, SolveError, StopRule, StoreError, solve};
use radiosity_form_factors::stores::PackedFormFactors;
use radiosity_gallery::stiff;
use radiosity_solvers::all;

/// An answer has a bound that holds, or no bound; a run that says it converged has a residual that says so too. 400 steps do not
/// bring every method to the end, and what they leave must be under the bound as well.
#[test]
fn no_method_is_wrong_without_saying_so() {
    for case in stiff() {
        let exact = case.exact().unwrap();
        let mut stores: Vec<Box<dyn FormFactors + '_>> = case.enclosure.stores();
        match PackedFormFactors::<f32>::assemble(&case.enclosure) {
            Ok((store, _)) => stores.push(Box::new(store)),
            Err(error) => assert!(matches!(error, StoreError::Underflow { .. }), "{}: {error}", case.name),
        }
        for store in &stores {
            let system = case.enclosure.system(&**store);
            for mut solver in all() {
                let place = format!("{}: {} on {}", case.name, solver.name(), store.name());
                let stop = StopRule::unshot(1e-10).steps(400);
                let solution = match solve(&system, &mut *solver, &stop, &mut ()) {
                    Ok(solution) => solution,
                    Err(SolveError::Store(error)) => panic!("{place}: {error}"),
                    Err(error) => panic!("{place}: {error}"),
                };
                if solution.outcome == Outcome::Converged {
                    // Recomputed: what a recurrence claims may be off by its rounding.
                    assert!(solution.unshot < 2e-10, "{place}: {:e}", solution.unshot);
                }
                let apart = solution.radiosity.values().iter().zip(&exact).zip(system.areas());
                let error: f64 = apart.map(|((b, exact), a)| a * (b - exact).abs()).sum();
                let emitted = system.power(system.emission().band(0));
                let error = if error == 0.0 { 0.0 } else { error / emitted };
                let certificate = solution.certificate.unwrap();
                for bound in [certificate.bound, certificate.sharp_bound].into_iter().flatten() {
                    assert!(error <= bound, "{place}: error {error:e}, {certificate:?}");
                }
            }
        }
    }
}
