//! Systems, the loop around a method, and how runs end; with a two-element room solved by hand.

use std::ops::ControlFlow;
use std::time::Duration;

use radiosity_core::{
    BandValues, Bands, Cost, Direction, Entries, Form, FormFactors, Iterate, Needs, Observer, Outcome, Progress,
    Properties, Row, RowBuf, Snapshots, SolveError, Solver, Step, StopRule, StoreError, System, SystemError, Trace,
    solve,
};

/// Exchange areas in one table.
struct Rows {
    values: Vec<f64>,
    targets: usize,
    symmetric: bool,
}

impl FormFactors for Rows {
    fn name(&self) -> &'static str {
        "rows"
    }
    fn sources(&self) -> usize {
        self.values.len() / self.targets
    }
    fn targets(&self) -> usize {
        self.targets
    }
    fn properties(&self) -> Properties {
        Properties {
            symmetric: self.symmetric,
            per_band: false,
            stored_bytes: 8 * self.values.len() as u64,
            rounding: 0.0,
        }
    }
    fn row<'a>(&'a self, s: usize, _: usize, _: &'a mut RowBuf) -> Result<Row<'a>, StoreError> {
        let row = &self.values[s * self.targets..(s + 1) * self.targets];
        Ok(Row { entries: Entries::Dense(row), cost: Cost::default() })
    }
}

/// x ← x + r, in the smallest form; `lies` makes it claim η = 0 without a residual.
struct Series {
    direction: Direction,
    lies: bool,
}

const SERIES: Series = Series { direction: Direction::Gather, lies: false };

impl Solver for Series {
    fn name(&self) -> &'static str {
        "series"
    }
    fn needs(&self) -> Needs {
        Needs { forms: &[Form::Full], direction: self.direction, symmetric: false }
    }
    fn start(&mut self, system: &System<'_>, _: Option<Bands<'_>>) -> Result<(Iterate, Cost), StoreError> {
        let shot = BandValues::zeros(system.bands(), system.elements());
        let residual = (!self.lies).then(|| system.emission().to_owned());
        Ok((Iterate { shot, residual }, Cost::default()))
    }
    fn step(&mut self, system: &System<'_>, it: &mut Iterate) -> Result<(Progress, Cost), StoreError> {
        let mut r = it.shot.clone();
        system.residual(self.direction, it.shot.view(), r.view_mut())?;
        it.shot.values_mut().iter_mut().zip(r.values()).for_each(|(x, r)| *x += r);
        let cost = system.residual(self.direction, it.shot.view(), r.view_mut())?;
        if self.lies {
            return Ok((Progress::Claim { unshot: 0.0 }, cost));
        }
        it.residual = Some(r);
        Ok((Progress::Residual, cost))
    }
}

/// Two elements of areas 1 and 2 that send all to each other, times `scale`; the larger also sees itself.
fn pair(scale: f64) -> Rows {
    Rows { values: [0.0, 1.0, 1.0, 1.0].map(|v| v * scale).to_vec(), targets: 2, symmetric: true }
}

const AREAS: [f64; 2] = [1.0, 2.0];

fn system<'a>(store: &'a Rows, e: &'a [f64], rho: &'a [f64]) -> System<'a> {
    System::full(store, &AREAS, Bands::new(e, 2), Bands::new(rho, 2)).unwrap()
}

/// B1 = 3 + ½B2, B2 = ¼(B1 + B2): B2 = B1/3, B1 = 18/5, B2 = 6/5.
#[test]
fn the_room_of_two_elements_has_the_answer_found_by_hand() {
    let store = pair(1.0);
    let system = system(&store, &[3.0, 0.0], &[0.5, 0.5]);
    let solution = solve(&system, &mut { SERIES }, &StopRule::unshot(1e-15), &mut ()).unwrap();
    assert_eq!(solution.outcome, Outcome::Converged);
    for (b, wanted) in solution.radiosity.values().iter().zip([3.6, 1.2]) {
        assert!((b - wanted).abs() < 1e-14, "{b}");
    }
    // H1 = F12 B2 = B2; H2 = ½B1 + ½B2.
    for (h, wanted) in solution.irradiance.values().iter().zip([1.2, 2.4]) {
        assert!((h - wanted).abs() < 1e-14, "{h}");
    }
    assert_eq!(solution.contraction(), Some(0.5));
}

#[test]
fn the_bound_holds_after_every_number_of_steps_and_is_sharp_within_a_factor_three() {
    let store = pair(1.0);
    let system = system(&store, &[3.0, 0.0], &[0.5, 0.5]);
    for steps in 0..30 {
        let stop = StopRule::unshot(0.0).steps(steps);
        let solution = solve(&system, &mut { SERIES }, &stop, &mut ()).unwrap();
        let b = solution.radiosity.values();
        let error = ((b[0] - 3.6).abs() + 2.0 * (b[1] - 1.2).abs()) / 3.0;
        let bound = solution.bound().unwrap();
        assert!(error <= bound && bound <= 3.0 * error + 1e-13, "{steps} steps: {error:e} {bound:e}");
    }
}

/// Elements 0 and 1 form patch 0, element 2 patch 1.
#[test]
fn substructured_irradiance_comes_from_patch_means() {
    let (areas, parent) = ([1.0, 3.0, 2.0], [0, 0, 1]);
    let (e, rho) = (Bands::new(&[0.0; 3], 3), Bands::new(&[0.5; 3], 3));
    let x = Bands::new(&[8.0, 4.0, 1.0], 3);
    let mut h = BandValues::zeros(1, 3);
    // Means 5 and 1.
    let to_patches = Rows { values: vec![0.0, 1.0, 1.0, 2.0, 0.5, 0.25], targets: 2, symmetric: false };
    let gather = System::substructured(&to_patches, Form::ElementsToPatches, &areas, &parent, e, rho).unwrap();
    gather.irradiance(Direction::Gather, x, h.view_mut()).unwrap();
    assert_eq!(h.values(), [1.0, 7.0 / 3.0, 2.75 / 2.0]);
    assert_eq!(gather.patch_areas(), [4.0, 2.0]);
    let to_elements = Rows { values: vec![0.0, 1.0, 0.5, 1.0, 2.0, 0.25], targets: 3, symmetric: false };
    let shoot = System::substructured(&to_elements, Form::PatchesToElements, &areas, &parent, e, rho).unwrap();
    shoot.irradiance(Direction::Shoot, x, h.view_mut()).unwrap();
    assert_eq!(h.values(), [1.0, 7.0 / 3.0, 2.75 / 2.0]);
    // Patch 0 loses ½(0 + 1 + ½)/4 a unit when shooting, patch 1 ½(1 + 2 + ¼)/2.
    assert_eq!(shoot.contraction(Direction::Shoot).unwrap().0, [0.8125]);
}

#[test]
fn data_that_are_no_system_are_refused_with_their_place() {
    let store = pair(1.0);
    let build = |areas: &[f64], e: &[f64], rho: &[f64]| {
        System::full(&store, areas, Bands::new(e, areas.len()), Bands::new(rho, areas.len())).map(|_| ()).unwrap_err()
    };
    let reflectance = SystemError::Reflectance { element: 1, band: 0, value: 1.0 };
    assert_eq!(build(&AREAS, &[1.0, 0.0], &[0.5, 1.0]), reflectance);
    assert!(matches!(build(&AREAS, &[1.0, 0.0], &[f64::NAN, 0.0]), SystemError::Reflectance { element: 0, .. }));
    assert_eq!(build(&AREAS, &[1.0, -1.0], &[0.5, 0.5]), SystemError::Emission { element: 1, band: 0, value: -1.0 });
    assert_eq!(build(&[0.0, 1.0], &[1.0, 0.0], &[0.5; 2]), SystemError::Area { element: 0, value: 0.0 });
    assert_eq!(build(&[], &[], &[]), SystemError::Empty);
    assert!(matches!(build(&[1.0; 3], &[0.0; 3], &[0.5; 3]), SystemError::Shape { needs_sources: 3, .. }));
    let (e, rho) = (Bands::new(&[0.0; 3], 3), Bands::new(&[0.5; 3], 3));
    let wide = Rows { values: vec![0.0; 6], targets: 2, symmetric: false };
    for (parent, at) in [([0, 2, 1], 1), ([0, 0, 0], 1)] {
        let form = Form::ElementsToPatches;
        let error = System::substructured(&wide, form, &[1.0; 3], &parent, e, rho).map(|_| ()).unwrap_err();
        assert_eq!(error, SystemError::Parent { at, patches: 2 });
    }
}

#[test]
fn the_worst_band_counts_and_a_dark_band_is_done() {
    let store = pair(1.0);
    let system = system(&store, &[1.0, 0.0, 0.0, 4.0, 0.0, 0.0], &[0.5; 6]);
    assert_eq!(system.unshot(Bands::new(&[0.5, 0.0, 0.0, 1.0, 0.0, 0.0], 2)), 0.5);
    assert_eq!(system.unshot(Bands::new(&[0.0, 0.0, 0.0, 0.0, 0.1, 0.0], 2)), f64::INFINITY);
    assert!(system.unshot(Bands::new(&[f64::NAN, 0.0, 0.0, 1.0, 0.0, 0.0], 2)).is_nan());
}

#[test]
fn a_claim_is_not_believed_without_a_look() {
    let store = pair(1.0);
    let system = system(&store, &[3.0, 0.0], &[0.5, 0.5]);
    let mut liar = Series { lies: true, ..SERIES };
    let solution = solve(&system, &mut liar, &StopRule::unshot(1e-9), &mut ()).unwrap();
    assert_eq!(solution.outcome, Outcome::Converged);
    assert!(solution.steps > 10 && solution.unshot <= 1e-9, "{} steps, η {}", solution.steps, solution.unshot);
}

/// Stops when it has seen `0` steps.
struct StopAfter(u64);

impl Observer for StopAfter {
    fn observe(&mut self, step: &Step<'_>) -> ControlFlow<()> {
        if step.number >= self.0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

#[test]
fn every_way_to_end_is_told_apart() {
    let store = pair(1.0);
    let calm = system(&store, &[3.0, 0.0], &[0.5, 0.5]);
    let end = |system: &System<'_>, stop: StopRule, observer: &mut dyn Observer| {
        solve(system, &mut { SERIES }, &stop, observer).unwrap()
    };
    let tight = StopRule::unshot(1e-12);
    assert_eq!(end(&calm, tight, &mut ()).outcome, Outcome::Converged);
    assert_eq!(end(&calm, tight, &mut StopAfter(3)).outcome, Outcome::Cancelled);
    assert_eq!(end(&calm, tight.steps(4), &mut ()).outcome, Outcome::StepLimit);
    assert_eq!(end(&calm, tight.time(Duration::ZERO), &mut ()).outcome, Outcome::TimeLimit);
    // At ρ = 0.9 the last digit may never come to rest.
    let stiff = system(&store, &[3.0, 0.1], &[0.9, 0.9]);
    assert!(matches!(end(&stiff, StopRule::unshot(0.0), &mut ()).outcome, Outcome::Stagnated | Outcome::Converged));
    // A factor of 1.5 a step, and one of 1.001.
    for (scale, steps) in [(3.0, 60), (1.000_1 / 0.99, 60)] {
        let store = pair(scale);
        let growing = system(&store, &[3.0, 0.1], &[0.99, 0.99]);
        let solution = end(&growing, StopRule::unshot(1e-9), &mut ());
        assert_eq!((solution.outcome, solution.bound()), (Outcome::NotContracting, None), "{scale}");
        assert!(solution.steps <= steps, "{} steps at {scale}", solution.steps);
    }
    let broken = Rows { values: vec![0.0, f64::NAN, 1.0, 1.0], targets: 2, symmetric: false };
    assert_eq!(end(&system(&broken, &[3.0, 0.0], &[0.5; 2]), tight, &mut ()).outcome, Outcome::Breakdown);
}

#[test]
fn a_rule_or_a_start_that_is_none_is_an_error() {
    let store = pair(1.0);
    let system = system(&store, &[3.0, 0.0], &[0.5, 0.5]);
    let error = solve(&system, &mut { SERIES }, &StopRule::unshot(-1.0), &mut ()).map(|_| ()).unwrap_err();
    assert_eq!(error, SolveError::Target { value: -1.0 });
    let from = Some(Bands::new(&[1.0; 4], 2));
    let stop = StopRule::unshot(1e-6);
    let error = radiosity_core::solve_from(&system, &mut { SERIES }, &stop, &mut (), from).map(|_| ()).unwrap_err();
    assert_eq!(error, SolveError::Start { has: 4, needs: 2 });
}

#[test]
fn snapshots_are_taken_at_geometric_steps_and_a_trace_at_each() {
    let store = pair(1.0);
    let system = system(&store, &[3.0, 0.0], &[0.5, 0.5]);
    let (mut snapshots, mut trace) = (Snapshots::every(2.0), Trace::default());
    let stop = StopRule::unshot(0.0).steps(20);
    solve(&system, &mut { SERIES }, &stop, &mut snapshots).unwrap();
    solve(&system, &mut { SERIES }, &stop, &mut trace).unwrap();
    assert_eq!(snapshots.taken.iter().map(|s| s.at.step).collect::<Vec<_>>(), [0, 1, 2, 4, 8, 16]);
    assert_eq!(trace.points.len(), 21);
    // Power of B = x + r after k steps, from the snapshot: ½ · the remaining error, not the answer of the run.
    let two = &snapshots.taken[2];
    assert_eq!((two.shot.values(), two.at.unshot), (&[3.0, 0.75][..], trace.points[2].unshot));
}

#[test]
fn without_verification_irradiance_is_what_was_reflected() {
    let store = pair(1.0);
    let system = system(&store, &[3.0, 0.0], &[0.5, 0.0]);
    let stop = StopRule::unshot(1e-12).unverified();
    let solution = solve(&system, &mut { SERIES }, &stop, &mut ()).unwrap();
    assert_eq!((solution.verification, solution.bound()), (Cost::default(), None));
    // Nothing comes back from the black element; where ρ = 0 the method knows no H.
    assert_eq!(solution.irradiance.values()[0], 0.0);
    assert!(solution.irradiance.values()[1].is_nan());
}
