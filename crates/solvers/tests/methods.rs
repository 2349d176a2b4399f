//! What each method claims: contraction, conservation, refusals, bounds and how runs end.

use std::ops::ControlFlow;

use radiosity_core::{
    BandValues, Bands, Direction, Form, FormFactors, Observer, Outcome, SolveError, Solver, Step, StopRule, System,
    solve, solve_from,
};
use radiosity_form_factors::stores::{DenseFormFactors, SparseFormFactors, aggregate};
use radiosity_gallery::RandomEnclosure;
use radiosity_solvers::{
    Chebyshev, ConjugateGradient, Direct, Factorisation, GaussSeidel, Gmres, Jacobi, NAMES, OverRelaxation, Shooting,
    all, by_name, by_name_in,
};

/// Σ A|v| of all bands.
fn norm(system: &System<'_>, v: &[f64]) -> f64 {
    system.areas().iter().cycle().zip(v).map(|(a, v)| a * v.abs()).sum()
}

/// B of an enclosure by Cholesky with three refinements.
fn reference(system: &System<'_>) -> BandValues {
    let stop = StopRule::unshot(0.0).steps(4);
    solve(system, &mut Direct::default(), &stop, &mut ()).unwrap().radiosity
}

/// An enclosure whose rows carry errors of their own, as a row-wise estimator gives them: not symmetric.
fn unsymmetric(enclosure: &RandomEnclosure) -> DenseFormFactors {
    let (n, noise) = (enclosure.len(), |k: usize| 1.0 + 0.1 * (((k * 29) % 17) as f64 / 16.0 - 0.5));
    let rows: Vec<f64> = enclosure.exchange.iter().enumerate().map(|(k, value)| value * noise(k)).collect();
    DenseFormFactors::from_rows(&rows, n, n, false).unwrap()
}

#[test]
fn all_methods_agree_on_a_random_enclosure_and_their_error_is_within_the_bound() {
    let enclosure = RandomEnclosure::new(150, 1);
    let wanted = reference(&enclosure.system(&enclosure.dense()));
    for store in enclosure.stores() {
        let system = enclosure.system(&*store);
        for mut solver in all() {
            let solution = solve(&system, &mut *solver, &StopRule::unshot(1e-6), &mut ()).unwrap();
            assert_eq!(solution.outcome, Outcome::Converged, "{}", solver.name());
            let error: Vec<f64> = solution.radiosity.values().iter().zip(wanted.values()).map(|(b, w)| b - w).collect();
            let error = norm(&system, &error) / system.power(&enclosure.emission);
            let bound = solution.bound().unwrap();
            assert!(error <= bound, "{} on {}: error {error:e}, bound {bound:e}", solver.name(), store.name());
            // q ≤ 0.9 makes of η = 1e-6 a bound of 9e-6.
            assert!(bound < 1e-5, "{}: {bound:e}", solver.name());
        }
    }
}

/// Gathering and shooting solve different systems on rows that carry errors; each direction has one answer.
#[test]
fn methods_agree_per_direction_on_a_store_that_is_not_symmetric() {
    let enclosure = RandomEnclosure::new(60, 2);
    let store = unsymmetric(&enclosure);
    let system = enclosure.system(&store);
    let mut answers = Vec::new();
    for direction in [Direction::Gather, Direction::Shoot] {
        let mut first: Option<BandValues> = None;
        for name in NAMES.into_iter().filter(|name| !by_name(name).unwrap().needs().symmetric) {
            let Ok(Some(mut solver)) = by_name_in(name, direction) else { continue };
            let b = solve(&system, &mut *solver, &StopRule::unshot(1e-13), &mut ()).unwrap().radiosity;
            let first = first.get_or_insert_with(|| b.clone());
            let apart = first.values().iter().zip(b.values()).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
            // η of 1e-13 of about 100 W, times 10 for 1/(1 − q).
            assert!(apart < 1e-10, "{name}, {direction:?}: {apart:e}");
        }
        answers.push(first.unwrap());
    }
    let apart = answers[0].values().iter().zip(answers[1].values()).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
    assert!(apart > 1e-3, "noise of 5 % on the rows must show between directions, got {apart:e}");
}

/// r^{k+1} = ρF r^k and the norm of ρF is q; 1e-12 for rounding of r near x.
#[test]
fn jacobi_contracts_by_at_most_q_in_every_step() {
    let enclosure = RandomEnclosure::new(80, 3);
    for (direction, store) in
        [(Direction::Gather, unsymmetric(&enclosure)), (Direction::Shoot, unsymmetric(&enclosure))]
    {
        let system = enclosure.system(&store);
        let q = system.contraction(direction).unwrap().0[0];
        let mut solver = Jacobi::new(direction);
        let (mut iterate, _) = solver.start(&system, None).unwrap();
        let mut last = norm(&system, iterate.residual.as_ref().unwrap().values());
        for step in 0..60 {
            solver.step(&system, &mut iterate).unwrap();
            let now = norm(&system, iterate.residual.as_ref().unwrap().values());
            assert!(now <= q * last + 1e-12, "{direction:?}, step {step}: {now:e} after {last:e}, q = {q}");
            last = now;
        }
    }
}

/// Five patches of unequal size: squares modulo 13 leave all remainders modulo 5.
fn parent(m: usize) -> Vec<u32> {
    (0..m).map(|e| (e * e % 13 % 5) as u32).collect()
}

/// Form factors of the two substructured forms, summed exactly from those of the elements.
fn substructured(enclosure: &RandomEnclosure, parent: &[u32], n: usize) -> (DenseFormFactors, DenseFormFactors) {
    let (m, full) = (enclosure.len(), enclosure.dense());
    let own: Vec<u32> = (0..m as u32).collect();
    let to_patches = aggregate(&full, (&own, m), (parent, n)).unwrap().0;
    let to_elements = aggregate(&full, (parent, n), (&own, m)).unwrap().0;
    (to_patches, to_elements)
}

/// After each shot the r that is carried must be E + ρH(x) − x with the operator of the form; n shots of relative
/// rounding ε each stay far below 1e-12.
#[test]
fn shooting_keeps_the_residual_true_in_both_forms() {
    let m = 90;
    let enclosure = RandomEnclosure::new(m, 4);
    let parent = parent(m);
    let n = 5;
    let (_, to_elements) = substructured(&enclosure, &parent, n);
    let full = enclosure.dense();
    let (e, rho) = ([&enclosure.emission[..], &enclosure.reflectance].concat(), vec![0.6; 2 * m]);
    let (e, rho) = (Bands::new(&e, m), Bands::new(&rho, m));
    let forms = [
        System::full(&full, &enclosure.areas, e, rho).unwrap(),
        System::substructured(&to_elements, Form::PatchesToElements, &enclosure.areas, &parent, e, rho).unwrap(),
    ];
    let kinds = || [Shooting::default(), Shooting::overshooting(), Shooting::several(3)];
    for (system, mut solver) in forms.iter().flat_map(|system| kinds().map(|solver| (system, solver))) {
        let (mut iterate, _) = solver.start(system, None).unwrap();
        let mut true_r = iterate.shot.clone();
        for shot in 0..200 {
            solver.step(system, &mut iterate).unwrap();
            system.residual(Direction::Shoot, iterate.shot.view(), true_r.view_mut()).unwrap();
            let r = iterate.residual.as_ref().unwrap();
            let apart = r.values().iter().zip(true_r.values()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(apart < 1e-12, "{:?}, shot {shot}: {apart:e}", system.form());
        }
    }
}

/// The first shots are the brightest emitters, in order of power; a tie goes to the lowest index.
#[test]
fn shooting_begins_with_the_brightest_power() {
    let values = [0.5; 16];
    let store = DenseFormFactors::from_rows(&values, 4, 4, true).unwrap();
    let (areas, e, rho) = ([1.0, 2.0, 4.0, 1.0], [3.0, 2.0, 1.0, 4.0], [0.0; 4]);
    let system = System::full(&store, &areas, Bands::new(&e, 4), Bands::new(&rho, 4)).unwrap();
    let mut solver = Shooting::default();
    let (mut iterate, _) = solver.start(&system, None).unwrap();
    let mut order = Vec::new();
    for _ in 0..4 {
        let before = iterate.shot.clone();
        solver.step(&system, &mut iterate).unwrap();
        order.extend((0..4).filter(|&e| iterate.shot.values()[e] != before.values()[e]));
    }
    // Powers 3, 4, 4, 4.
    assert_eq!(order, [1, 2, 3, 0]);
}

/// A small dense reference: u = (I − ρ F P)⁻¹ E with P the patch means, by Gaussian elimination here.
fn eliminate(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs())).unwrap();
        a.swap(k, pivot);
        b.swap(k, pivot);
        for i in k + 1..n {
            let factor = a[i][k] / a[k][k];
            let (upper, lower) = a.split_at_mut(i);
            lower[0].iter_mut().zip(&upper[k]).for_each(|(x, y)| *x -= factor * y);
            b[i] -= factor * b[k];
        }
    }
    for k in (0..n).rev() {
        let sum: f64 = (k + 1..n).map(|j| a[k][j] * b[j]).sum();
        b[k] = (b[k] - sum) / a[k][k];
    }
    b
}

#[test]
fn substructured_forms_match_a_small_dense_elimination() {
    let m = 45;
    let enclosure = RandomEnclosure::new(m, 5);
    let parent = parent(m);
    let n = 5;
    let (to_patches, to_elements) = substructured(&enclosure, &parent, n);
    let (e, rho) = (Bands::new(&enclosure.emission, m), Bands::new(&enclosure.reflectance, m));
    let stores: [(Form, &dyn FormFactors); 2] =
        [(Form::ElementsToPatches, &to_patches), (Form::PatchesToElements, &to_elements)];
    for (form, store) in stores {
        let system = System::substructured(store, form, &enclosure.areas, &parent, e, rho).unwrap();
        let exchange = |i: usize, p: usize| match form {
            Form::ElementsToPatches => to_patches.entry(i, p),
            _ => to_elements.entry(p, i),
        };
        let coefficient = |i: usize, j: usize| {
            let (a, p) = (&enclosure.areas, parent[j] as usize);
            let mean = a[j] / system.patch_areas()[p];
            f64::from(i == j) - enclosure.reflectance[i] * exchange(i, p) / a[i] * mean
        };
        let matrix = (0..m).map(|i| (0..m).map(|j| coefficient(i, j)).collect()).collect();
        let wanted = eliminate(matrix, enclosure.emission.clone());
        for mut solver in all().into_iter().filter(|solver| solver.needs().forms.contains(&form)) {
            let solution = solve(&system, &mut *solver, &StopRule::unshot(1e-14), &mut ()).unwrap();
            let apart = solution.radiosity.values().iter().zip(&wanted).map(|(b, w)| (b - w).abs()).fold(0.0, f64::max);
            // Both sides are right to about κ ε · |B| = 10 · 2e-16 · 30.
            assert!(apart < 1e-12, "{} {form:?}: {apart:e}", solver.name());
        }
    }
}

#[test]
fn methods_that_need_symmetry_or_another_form_refuse_the_rest() {
    let enclosure = RandomEnclosure::new(12, 6);
    let store = unsymmetric(&enclosure);
    let refusal = |solver: &mut dyn Solver, system: &System<'_>| {
        solve(system, solver, &StopRule::unshot(1e-6), &mut ()).map(|_| ()).unwrap_err()
    };
    let system = enclosure.system(&store);
    let cholesky = &mut Direct::new(Factorisation::Cholesky, Direction::Gather);
    assert_eq!(refusal(cholesky, &system), SolveError::NeedsSymmetric { solver: "cholesky", store: "dense" });
    let cg = &mut ConjugateGradient::default();
    assert_eq!(refusal(cg, &system), SolveError::NeedsSymmetric { solver: "cg", store: "dense" });

    let parent = [0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 2];
    let (to_patches, _) = substructured(&enclosure, &parent, 3);
    let (e, rho) = (Bands::new(&enclosure.emission, 12), Bands::new(&enclosure.reflectance, 12));
    let form = Form::ElementsToPatches;
    let system = System::substructured(&to_patches, form, &enclosure.areas, &parent, e, rho).unwrap();
    for (solver, works_on) in [
        (Box::new(Direct::default()) as Box<dyn Solver>, &[Form::Full][..]),
        (Box::new(Shooting::default()), &[Form::Full, Form::PatchesToElements]),
    ] {
        let mut solver = solver;
        let error = SolveError::NeedsForm { solver: solver.name(), form, works_on };
        assert_eq!(refusal(&mut *solver, &system), error);
    }
}

/// LU where Cholesky cannot go: the second step refines and the error is at rounding level.
#[test]
fn a_second_direct_step_refines() {
    let enclosure = RandomEnclosure::new(200, 7).with_reflectance(0.999_999);
    let store = enclosure.dense();
    let system = enclosure.system(&store);
    for factorisation in [Factorisation::Cholesky, Factorisation::Lu] {
        let mut eta = Vec::new();
        for steps in 1..=3 {
            let mut solver = Direct::new(factorisation, Direction::Gather);
            let stop = StopRule::unshot(0.0).steps(steps);
            let solution = solve(&system, &mut solver, &stop, &mut ()).unwrap();
            assert_eq!((solution.outcome, solution.steps), (Outcome::StepLimit, steps));
            eta.push(solution.unshot);
        }
        // |x| is E/(1 − ρ) = 1e6 times E: its rounding alone makes η about 1e-10.
        assert!(eta[0] < 1e-8 && eta[1] < 1e-9 && eta[2] < 1e-9, "{factorisation:?}: {eta:?}");
    }
}

#[test]
fn a_grey_scene_is_factored_once_for_all_bands() {
    let enclosure = RandomEnclosure::new(50, 8);
    let store = enclosure.dense();
    let flops = |bands: usize, grey: bool| {
        let e = enclosure.emission.repeat(bands);
        let mut rho = enclosure.reflectance.repeat(bands);
        if !grey {
            (0..bands).for_each(|b| rho[b * 50] = 0.1 * b as f64);
        }
        let system = enclosure.system_with(&store, &e, &rho);
        let stop = StopRule::unshot(1e-12);
        solve(&system, &mut Direct::default(), &stop, &mut ()).unwrap().cost.flops
    };
    assert_eq!(flops(3, false) - flops(3, true), 2 * (50_u64.pow(3) / 3));
}

/// Row sums of 1.02 and ρ = 0.99: the series grows by about 1 % a step.
#[test]
fn a_system_that_does_not_contract_is_told_apart() {
    let enclosure = RandomEnclosure::new(40, 9).with_reflectance(0.99).scaled(1.02);
    let store = enclosure.dense();
    let system = enclosure.system(&store);
    let run = |solver: &mut dyn Solver| solve(&system, solver, &StopRule::unshot(1e-8), &mut ()).unwrap();
    for name in ["jacobi", "gauss-seidel", "sor", "shooting", "overshooting"] {
        let solution = run(&mut *by_name(name).unwrap());
        assert_eq!(solution.outcome, Outcome::NotContracting, "{name}");
        assert!(solution.bound().is_none() && solution.contraction().unwrap() > 1.0);
    }
    // Not positive definite: the factorisation and the curvature say so.
    let cholesky = run(&mut Direct::default());
    assert_eq!((cholesky.outcome, cholesky.bound()), (Outcome::Breakdown, None));
    assert_eq!(run(&mut ConjugateGradient::default()).outcome, Outcome::Breakdown);
    assert_eq!(run(&mut ConjugateGradient::deflated()).outcome, Outcome::Breakdown);
    // Beyond its interval the polynomial grows slowly at first, and not in every step.
    let chebyshev = run(&mut Chebyshev::default());
    assert!(matches!(chebyshev.outcome, Outcome::NotContracting | Outcome::Stagnated) && chebyshev.bound().is_none());
    // A minimal residual needs no contraction: the system has an answer, if no meaning.
    assert_eq!(run(&mut Gmres::default()).outcome, Outcome::Converged);
    // Row sums 2 % above one do no harm at ρ = 0.9.
    let tame = RandomEnclosure::new(40, 9).with_reflectance(0.9).scaled(1.02);
    let system = tame.system(&store);
    for mut solver in all() {
        let outcome = solve(&system, &mut *solver, &StopRule::unshot(1e-8), &mut ()).unwrap().outcome;
        assert_eq!(outcome, Outcome::Converged, "{}", solver.name());
    }
}

/// A target of 0 cannot be met; every method stops by itself near rounding level, or is exactly there.
#[test]
fn a_target_of_zero_ends_at_rounding_level() {
    let enclosure = RandomEnclosure::new(40, 10);
    let store = enclosure.dense();
    let system = enclosure.system(&store);
    for mut solver in all() {
        let solution = solve(&system, &mut *solver, &StopRule::unshot(0.0), &mut ()).unwrap();
        assert!(matches!(solution.outcome, Outcome::Stagnated | Outcome::Converged), "{}", solver.name());
        // A hundred roundings.
        assert!(solution.unshot < 100.0 * f64::EPSILON, "{}: {:e}", solver.name(), solution.unshot);
    }
}

#[test]
fn the_step_limit_ends_a_run_with_what_there_is() {
    let enclosure = RandomEnclosure::new(40, 11);
    let store = SparseFormFactors::assemble(&&enclosure).unwrap().0;
    let system = enclosure.system(&store);
    for mut solver in all().into_iter().filter(|solver| !solver.name().starts_with("direct")) {
        let solution = solve(&system, &mut *solver, &StopRule::unshot(1e-12).steps(2), &mut ()).unwrap();
        assert_eq!((solution.outcome, solution.steps), (Outcome::StepLimit, 2), "{}", solver.name());
        assert!(solution.unshot > 1e-12 && solution.unshot < 1.0);
    }
}

/// Counts the steps.
struct Count(u64);

impl Observer for Count {
    fn observe(&mut self, _: &Step<'_>) -> ControlFlow<()> {
        self.0 += 1;
        ControlFlow::Continue(())
    }
}

/// After a small change of emission a run from the old answer needs fewer steps than one from nothing.
#[test]
fn a_start_from_the_old_answer_saves_steps() {
    let enclosure = RandomEnclosure::new(100, 12);
    let store = enclosure.dense();
    let old = reference(&enclosure.system(&store));
    let mut emission = enclosure.emission.clone();
    emission[5] *= 1.001;
    let system = enclosure.system_with(&store, &emission, &enclosure.reflectance);
    let wanted = reference(&system);
    for mut solver in all().into_iter().filter(|solver| !solver.name().starts_with("direct")) {
        let (mut cold, mut warm) = (Count(0), Count(0));
        let stop = StopRule::unshot(1e-9);
        solve(&system, &mut *solver, &stop, &mut cold).unwrap();
        let solution = solve_from(&system, &mut *solver, &stop, &mut warm, Some(old.view())).unwrap();
        assert!(warm.0 < cold.0, "{}: {} steps, {} from nothing", solver.name(), warm.0, cold.0);
        let apart = solution.radiosity.values().iter().zip(wanted.values()).map(|(b, w)| (b - w).abs());
        // η = 1e-9 of about 1000 W with 1/(1 − q) = 10 bounds A|B* − B| by 1e-5.
        assert!(apart.fold(0.0, f64::max) < 1e-5, "{}", solver.name());
    }
}

#[test]
fn bytes_are_equal_in_pools_of_1_2_and_8_threads() {
    // Above the sizes at which faer begins to cut its work.
    let enclosure = RandomEnclosure::new(700, 13);
    let symmetric = enclosure.dense();
    let rows = unsymmetric(&enclosure);
    let e = [&enclosure.emission[..], &enclosure.reflectance].concat();
    let rho = [&enclosure.reflectance[..], &[0.7; 700]].concat();
    for (store, names) in [
        (&symmetric, &NAMES[..]),
        (&rows, &["direct", "jacobi", "gauss-seidel", "sor", "gmres", "shooting", "overshooting"]),
    ] {
        let system = enclosure.system_with(store, &e, &rho);
        for name in names {
            let run = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| {
                    let mut solver = by_name(name).unwrap();
                    let solution = solve(&system, &mut *solver, &StopRule::unshot(1e-9), &mut ()).unwrap();
                    (solution.radiosity, solution.steps, solution.cost)
                })
            };
            let one = run(1);
            assert!(one == run(2) && one == run(8), "{name}");
        }
    }
}

/// Steps to η = 1e-10 at reflectance ρ.
fn steps_at(rho: f64, solver: &mut dyn Solver) -> u64 {
    let enclosure = RandomEnclosure::new(300, 14).with_reflectance(rho);
    let store = enclosure.dense();
    let solution = solve(&enclosure.system(&store), solver, &StopRule::unshot(1e-10), &mut ()).unwrap();
    assert_eq!(solution.outcome, Outcome::Converged, "{} at {rho}", solver.name());
    solution.steps
}

/// The factor that is found while running is worth what Young's theory promises, √ of the number of sweeps: 125 for 1183.
#[test]
fn over_relaxation_finds_its_factor() {
    let (plain, relaxed) =
        (steps_at(0.99, &mut GaussSeidel::default()), steps_at(0.99, &mut OverRelaxation::default()));
    assert!(relaxed < plain / 6, "{relaxed} sweeps for {plain}");
    // A fixed factor of 1 is Gauss–Seidel.
    assert_eq!(steps_at(0.9, &mut OverRelaxation::new(1.0)), steps_at(0.9, &mut GaussSeidel::default()));
}

/// |T_k(1/δ)|⁻¹ ≤ 2 σᵏ with σ = δ/(1 + √(1 − δ²)) reaches 1e-10 · (E, 1/(1 − δ)) in ln(2e10/(1 − δ))/ln(1/σ) steps.
#[test]
fn chebyshev_needs_no_more_steps_than_its_interval_promises() {
    for delta in [0.5_f64, 0.9, 0.99, 0.999] {
        let sigma = delta / (1.0 + (1.0 - delta * delta).sqrt());
        let promised = (2e10 / (1.0 - delta)).ln() / -sigma.ln();
        let steps = steps_at(delta, &mut Chebyshev::default());
        assert!((steps as f64) < promised + 2.0, "{steps} steps at ρ = {delta}, {promised} promised");
    }
}

/// With the even mode gone the steps are those of the rest of the spectrum, whatever ρ.
#[test]
fn deflated_conjugate_gradients_do_not_feel_a_high_reflectance() {
    let steps = [0.9, 0.999, 0.99999].map(|rho| steps_at(rho, &mut ConjugateGradient::deflated()));
    assert!(steps.iter().all(|&s| s.abs_diff(steps[0]) <= 2), "{steps:?}");
}

/// GMRES and conjugate gradients of a symmetric system differ by the norm that falls, not by more than a few steps.
#[test]
fn gmres_restarts_without_losing_its_way() {
    let enclosure = RandomEnclosure::new(300, 14).with_reflectance(0.99);
    let store = unsymmetric(&enclosure);
    let system = enclosure.system(&store);
    let run = |solver: &mut dyn Solver| solve(&system, solver, &StopRule::unshot(1e-11), &mut ()).unwrap();
    let (long, short) = (run(&mut Gmres::default()), run(&mut Gmres::default().restart(3)));
    assert_eq!((long.outcome, short.outcome), (Outcome::Converged, Outcome::Converged));
    assert!(long.steps <= short.steps && long.steps < 40, "{} and {}", long.steps, short.steps);
}

/// Light spread over a bright room: what is expected later is shot at once.
#[test]
fn overshooting_saves_shots_in_a_bright_room() {
    let shots = |solver: &mut dyn Solver| {
        let enclosure = RandomEnclosure::new(300, 15).with_reflectance(0.9);
        let store = enclosure.dense();
        solve(&enclosure.system(&store), solver, &StopRule::unshot(1e-3), &mut ()).unwrap().steps
    };
    let (plain, over) = (shots(&mut Shooting::default()), shots(&mut Shooting::overshooting()));
    assert!(4 * over < 3 * plain, "{over} shots for {plain}");
}
