//! Stochastic Jacobi iteration: unbiased, with a standard error that is one, and ends that say what happened.
//!
//! Seeds are fixed, so every test repeats; limits are those that a right method misses once in thousands of seeds.

use std::time::Duration;

use radiosity_core::{BandValues, Form, Outcome, Solution, Solver, StopRule, System, solve, solve_from};
use radiosity_gallery::{IntegratingSphere, RandomEnclosure, stiff};
use radiosity_solvers::{Direct, StochasticJacobi};

const AREAS: [f64; 7] = [0.5, 1.0, 2.0, 0.25, 3.0, 0.75, 1.5];
const E: [f64; 7] = [1.0, 0.0, 0.5, 0.0, 0.0, 2.0, 0.0];
const RHO: [f64; 7] = [0.0, 0.9, 0.5, 0.3, 0.7, 0.2, 0.6];

fn reference(system: &System<'_>) -> BandValues {
    solve(system, &mut Direct::default(), &StopRule::unshot(0.0).steps(4), &mut ()).unwrap().radiosity
}

/// As many steps as told, with the answer as it was sampled.
fn sampled(system: &System<'_>, solver: StochasticJacobi, steps: u64) -> Solution {
    let mut solver = solver;
    solve(system, &mut solver, &StopRule::unshot(0.0).steps(steps).unverified(), &mut ()).unwrap()
}

/// Σ A|B − B*| / Σ A E of the worst band.
fn error(system: &System<'_>, b: &BandValues, exact: &BandValues) -> f64 {
    let of_band = |k: usize| {
        let apart = b.band(k).iter().zip(exact.band(k)).zip(system.areas());
        let error: f64 = apart.map(|((b, exact), a)| a * (b - exact).abs()).sum();
        if error == 0.0 { 0.0 } else { error / system.power(system.emission().band(k)) }
    };
    (0..b.count()).map(of_band).fold(0.0, f64::max)
}

/// In a sphere B is known; 64 runs give the mean of the method and the spread that its standard error estimates.
#[test]
fn the_mean_of_64_seeds_is_the_exact_answer_and_the_standard_error_is_their_spread() {
    let sphere = IntegratingSphere::new(&AREAS);
    let wanted = sphere.radiosity(&E, &RHO);
    for store in sphere.stores() {
        let system = sphere.system(&*store, &E, &RHO);
        let runs: Vec<Solution> = (0..64).map(|seed| sampled(&system, StochasticJacobi::new(seed), 30)).collect();
        let mut spread_power = 0.0;
        for (e, wanted) in wanted.iter().enumerate() {
            let values: Vec<f64> = runs.iter().map(|run| run.radiosity.values()[e]).collect();
            let mean = values.iter().sum::<f64>() / 64.0;
            let spread = (values.iter().map(|b| (b - mean).powi(2)).sum::<f64>() / 63.0).sqrt();
            // What was never shot is known to be less than a tenth of the standard error of the first answer, and a 25th of that here.
            assert!((mean - wanted).abs() <= 4.0 * spread / 8.0, "{e} on {}: {mean} ± {spread}", store.name());
            spread_power += AREAS[e] * spread;
        }
        let spread = spread_power / system.power(&E);
        let claimed = runs.iter().map(|run| run.standard_error.unwrap()).sum::<f64>() / 64.0;
        // 64 runs know their spread to 9 %, and 8 replicates are 4 % low in the mean.
        assert!((0.75..1.25).contains(&(claimed / spread)), "{}: {claimed:e} for {spread:e}", store.name());
    }
}

/// Σ A|error| over several seeds.
fn mean_error(system: &System<'_>, exact: &BandValues, rays: u64, steps: u64) -> f64 {
    let runs = (0..8).map(|seed| sampled(system, StochasticJacobi::new(seed).rays(rays), steps));
    runs.map(|run| error(system, &run.radiosity, exact)).sum::<f64>() / 8.0
}

/// With at most 32 rays a source and replicate for 400 targets draws hardly know of each other: the order is ½ in rays as in steps.
#[test]
fn the_error_falls_like_the_root_of_rays_and_of_steps() {
    let enclosure = RandomEnclosure::new(400, 41);
    let store = enclosure.dense();
    let system = enclosure.system(&store);
    let exact = reference(&system);
    let order = |coarse: f64, fine: f64| (coarse / fine).ln() / 64.0_f64.ln();
    let few = mean_error(&system, &exact, 1_600, 30);
    let of_rays = order(few, mean_error(&system, &exact, 64 * 1_600, 30));
    let of_steps = order(few, mean_error(&system, &exact, 1_600, 64 * 30));
    assert!((0.4..0.6).contains(&of_rays), "order {of_rays} in rays");
    assert!((0.4..0.6).contains(&of_steps), "order {of_steps} in steps");
}

/// With many rays for every target each gets its share rounded, which is worth more than ½.
#[test]
fn many_rays_a_target_share_better_than_at_random() {
    let sphere = IntegratingSphere::new(&AREAS);
    let store = sphere.stores().remove(0);
    let system = sphere.system(&*store, &E, &RHO);
    let exact = BandValues::single(sphere.radiosity(&E, &RHO));
    let (few, many) = (mean_error(&system, &exact, 7_000, 20), mean_error(&system, &exact, 448_000, 20));
    let order = (few / many).ln() / 64.0_f64.ln();
    assert!((0.7..1.1).contains(&order), "{order}");
}

/// In a closed room all that is shot arrives: to rounding where every sender has a ray, to about a ray where few have one.
#[test]
fn power_is_conserved_in_every_step() {
    let enclosure = RandomEnclosure::new(100, 42);
    let store = enclosure.dense();
    let emission: Vec<f64> = (0..100).map(|k| 1.0 + (k % 7) as f64).collect();
    let system = enclosure.system_with(&store, &emission, &enclosure.reflectance);
    let arrived = |rays: u64, steps: u64| {
        let mut solver = StochasticJacobi::new(3).rays(rays);
        let (mut iterate, _) = solver.start(&system, None).unwrap();
        for _ in 0..steps {
            solver.step(&system, &mut iterate).unwrap();
        }
        let h = solver.sampled(&system).unwrap().irradiance;
        (system.power(h.values()), system.power(iterate.shot.values()))
    };
    for steps in [1, 2, 3] {
        let (h, x) = arrived(80_000, steps);
        assert!((h / x - 1.0).abs() < 1e-12, "{steps} steps: {h} of {x}");
    }
    // Ten rays a replicate.
    let (h, x) = arrived(80, 1);
    assert!((h / x - 1.0).abs() <= 0.1 + 1e-12, "{h} of {x}");
}

/// Three bands of one set of rays, one of them dark; every seventh element is black.
#[test]
fn every_band_has_its_own_answer_and_what_is_dark_or_black_is_exact() {
    let enclosure = RandomEnclosure::new(70, 43);
    let store = enclosure.dense();
    let tinted: Vec<f64> =
        enclosure.emission.iter().enumerate().map(|(k, e)| if k % 10 == 0 { 1e-3 * e } else { 0.0 }).collect();
    let emission = [&enclosure.emission[..], &[0.0; 70], &tinted].concat();
    let reflectance = [&enclosure.reflectance[..]; 3].concat();
    let system = enclosure.system_with(&store, &emission, &reflectance);
    let exact = reference(&system);
    let run = sampled(&system, StochasticJacobi::new(4), 60);
    let claimed = run.standard_error.unwrap();
    // The claim is that of the worst band, and each is within it.
    assert!(claimed < 0.05 && error(&system, &run.radiosity, &exact) < 2.0 * claimed, "{claimed:e}");
    assert!(run.radiosity.band(1).iter().all(|&b| b == 0.0));
    for (k, rho) in reflectance.iter().enumerate().filter(|(_, rho)| **rho == 0.0) {
        assert_eq!(run.radiosity.values()[k], emission[k], "{rho}");
        // Light falls on black elements as well.
        assert!((70..140).contains(&k) || run.irradiance.values()[k] > 0.0);
    }
}

#[test]
fn rooms_that_no_light_reaches_stay_dark_and_a_patch_alone_has_its_emission() {
    let cases = stiff();
    let run = |name: &str| {
        let case = cases.iter().find(|case| case.name == name).unwrap();
        let store = case.enclosure.dense();
        sampled(&case.enclosure.system(&store), StochasticJacobi::new(5), 50)
    };
    let isolated = run("isolated rooms");
    assert!(isolated.radiosity.values()[30..].iter().all(|&b| b == 0.0));
    assert!(isolated.radiosity.values()[1..30].iter().all(|&b| b > 0.0));
    for name in ["one patch", "all black", "nothing emits"] {
        let alone = run(name);
        let case = cases.iter().find(|case| case.name == name).unwrap();
        // That rays of a patch alone never land is known to a ray's power; that black elements and dark ones send nothing, for sure.
        let outcome = if name == "one patch" { Outcome::StepLimit } else { Outcome::Converged };
        assert_eq!((alone.outcome, alone.radiosity.values()), (outcome, &case.enclosure.emission[..]), "{name}");
    }
}

#[test]
fn patches_that_shoot_to_elements_have_the_answer_of_the_sphere() {
    let (sphere, parent) = (IntegratingSphere::new(&AREAS), [0, 1, 1, 2, 0, 2, 0]);
    let exact = BandValues::single(sphere.radiosity(&E, &RHO));
    for store in sphere.stores_of(Form::PatchesToElements, &parent) {
        let system = sphere.system_of(Form::PatchesToElements, &parent, &*store, &E, &RHO);
        let run = sampled(&system, StochasticJacobi::new(6), 100);
        let claimed = run.standard_error.unwrap();
        assert!(claimed < 0.02, "{claimed:e}");
        assert!(error(&system, &run.radiosity, &exact) < 3.0 * claimed, "{}: {claimed:e}", store.name());
    }
}

#[test]
fn a_start_from_an_old_answer_is_no_less_right() {
    let enclosure = RandomEnclosure::new(60, 44);
    let store = enclosure.dense();
    let old = reference(&enclosure.system(&store));
    let emission: Vec<f64> = enclosure.emission.iter().map(|e| 0.5 * e).collect();
    let system = enclosure.system_with(&store, &emission, &enclosure.reflectance);
    let stop = StopRule::unshot(0.01).unverified();
    let run = solve_from(&system, &mut StochasticJacobi::new(7), &stop, &mut (), Some(old.view())).unwrap();
    assert_eq!(run.outcome, Outcome::Converged);
    let error = error(&system, &run.radiosity, &reference(&system));
    assert!(error < 2.0 * run.standard_error.unwrap(), "{error:e}");
}

#[test]
fn runs_end_by_their_estimate_or_by_a_limit() {
    let enclosure = RandomEnclosure::new(60, 45);
    let store = enclosure.dense();
    let system = enclosure.system(&store);
    let exact = reference(&system);
    let run = |stop: StopRule| solve(&system, &mut StochasticJacobi::new(8), &stop, &mut ()).unwrap();
    let met = run(StopRule::unshot(0.01));
    assert_eq!(met.outcome, Outcome::Converged);
    assert!(met.standard_error.unwrap() <= 0.01);
    // The rows are there: a last product, and bounds that are no estimates.
    let error = error(&system, &met.radiosity, &exact);
    assert!(error <= met.bound().unwrap() && error < 0.01, "{error:e}, {:?}", met.bound());
    assert!(met.unshot < 0.03, "{:e}", met.unshot);
    // Errors of 1e-9 would take 1e14 times as many rays.
    assert_eq!(run(StopRule::unshot(1e-9).steps(70)).outcome, Outcome::StepLimit);
    let timed = run(StopRule::unshot(1e-9).time(Duration::from_millis(20)));
    assert_eq!(timed.outcome, Outcome::TimeLimit);
    // Without verification there is the answer as sampled and no residual.
    let plain = run(StopRule::unshot(0.01).unverified());
    assert!(plain.unshot.is_nan() && plain.certificate.is_none() && plain.standard_error == met.standard_error);
}

/// Row sums of 1.02 and ρ = 0.99: light grows by 1 % a step.
#[test]
fn a_system_that_does_not_contract_is_told_apart() {
    let enclosure = RandomEnclosure::new(40, 9).with_reflectance(0.99).scaled(1.02);
    let store = enclosure.dense();
    let run = sampled(&enclosure.system(&store), StochasticJacobi::new(9), 3_000);
    assert_eq!(run.outcome, Outcome::NotContracting);
    // At ρ = 0.9 the same rows do no harm.
    let tame = RandomEnclosure::new(40, 9).with_reflectance(0.9).scaled(1.02);
    let system = tame.system(&store);
    let run = sampled(&system, StochasticJacobi::new(9), 300);
    let error = error(&system, &run.radiosity, &reference(&system));
    assert!(
        error < 3.0 * run.standard_error.unwrap() && run.standard_error.unwrap() < 0.1,
        "{error:e} {:?}",
        run.standard_error
    );
}

#[test]
fn bytes_are_equal_in_pools_of_1_2_and_8_threads() {
    let enclosure = RandomEnclosure::new(300, 46);
    for which in 0..enclosure.stores().len() {
        let run = |threads: usize| {
            // Anew, since one of them keeps rows.
            let store = enclosure.stores().remove(which);
            let system = enclosure.system(&*store);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let run = sampled(&system, StochasticJacobi::new(10), 12);
                (run.radiosity, run.irradiance, run.standard_error, run.cost)
            })
        };
        let one = run(1);
        assert!(one == run(2) && one == run(8), "store {which}");
    }
}

/// 400 steps end most stiff systems by the limit; the answer is within five times the error that was claimed, or the claim says that
/// nothing is known.
#[test]
fn stiff_systems_end_with_an_honest_claim() {
    for case in stiff() {
        let exact = BandValues::single(case.exact().unwrap());
        let store = case.enclosure.dense();
        let system = case.enclosure.system(&store);
        let mut claims = Claims::default();
        let stop = StopRule::unshot(1e-3).steps(400).unverified();
        let run = solve(&system, &mut StochasticJacobi::new(11), &stop, &mut claims).unwrap();
        let error = error(&system, &run.radiosity, &exact);
        assert!(
            run.outcome != Outcome::Stagnated && run.outcome != Outcome::Breakdown,
            "{}: {}",
            case.name,
            run.outcome
        );
        assert!(
            error <= 5.0 * claims.last,
            "{}: {}, error {error:e}, claimed {:e}",
            case.name,
            run.outcome,
            claims.last
        );
    }
}

/// Keeps the error claimed last.
#[derive(Default)]
struct Claims {
    last: f64,
}

impl radiosity_core::Observer for Claims {
    fn observe(&mut self, step: &radiosity_core::Step<'_>) -> std::ops::ControlFlow<()> {
        self.last = step.unshot.unwrap();
        std::ops::ControlFlow::Continue(())
    }
}
