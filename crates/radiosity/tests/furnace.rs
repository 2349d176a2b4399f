//! Furnaces end to end: in a closed room of one material B = E/(1 − ρ) everywhere, to the error of the row sums.
//!
//! If the sums that a method reads are 1 + δ_k, B = E + ρFB gives a relative error of B of at most
//! δρ/(1 − ρ(1 + δ)) with δ = max|δ_k|. For ρδ ≤ (1 − ρ)/3 that is at most 1.5·δ·ρ/(1 − ρ). What a method that shoots
//! reads are columns: those of a row-wise estimator miss 1 by up to a third on meshes as coarse as these, but with errors
//! of either sign, since their area mean is exact; the same bound holds with room to spare.

use radiosity::{Geometry, Method, Store, assemble, solve_on};
use radiosity_core::{BandValues, Direction, Form, FormFactors, StopRule};
use radiosity_gallery::furnace;
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::{MeshSettings, Subdivision};

const RHO: f64 = 0.9;
const EMISSION: f64 = 2.0;
/// What the solvers leave: η = 1e-13 times 1/(1 − ρ) = 10, on any element.
const SOLVER: f64 = 1e-12;
const METHODS: [Method; 4] =
    [Method::ANALYTIC, Method::rays(4096), Method::RaysAndEmitters { rays: 4096 }, Method::HEMICUBE];

/// Largest |sum − 1| of what a method in `direction` reads: rows over A_s, or columns over A_t.
fn closure_error(geometry: &Geometry<'_>, store: &dyn FormFactors, direction: Direction) -> f64 {
    let areas = geometry.elements().areas();
    let ones = |n: usize| BandValues::single(vec![1.0; n]);
    let mut sums = BandValues::zeros(1, areas.len());
    match direction {
        Direction::Gather => store.gather(ones(store.targets()).view(), sums.view_mut()),
        Direction::Shoot => store.scatter(ones(store.sources()).view(), sums.view_mut()),
    }
    .unwrap();
    sums.values().iter().zip(&areas).map(|(sum, area)| (sum / area - 1.0).abs()).fold(0.0, f64::max)
}

/// Solves by every solver that takes the system and compares with E/(1 − ρ); gives the number of solvers.
fn radiosity_is_right_to_the_closure_error(scene: &Scene, elements: u32, patches: Option<u32>) -> usize {
    let mesh = MeshSettings {
        elements: Subdivision::Uniform(elements),
        patches: patches.map(Subdivision::Uniform),
        contacts: true,
    };
    let geometry = Geometry::new(scene, &mesh).unwrap();
    let truth = furnace::radiosity(RHO, EMISSION);
    let mut solved = 0;
    for method in METHODS {
        for form in [Form::Full, Form::ElementsToPatches, Form::PatchesToElements] {
            let (store, _) = assemble(&geometry, method, form, Store::Dense, 3).unwrap();
            for name in radiosity_solvers::NAMES {
                let needs = radiosity_solvers::by_name(name).unwrap().needs();
                if !needs.forms.contains(&form) || needs.symmetric && !store.properties().symmetric {
                    continue;
                }
                let direction = match form {
                    Form::Full => needs.direction,
                    Form::ElementsToPatches => Direction::Gather,
                    Form::PatchesToElements => Direction::Shoot,
                };
                let delta = closure_error(&geometry, &*store, direction);
                let stop = StopRule::unshot(1e-13);
                let solution = solve_on(&geometry, &*store, form, name, &stop, &mut ()).unwrap();
                let worst = solution.radiosity.values().iter().map(|b| (b / truth - 1.0).abs()).fold(0.0, f64::max);
                let allowed = 1.5 * delta * RHO / (1.0 - RHO) + SOLVER;
                assert!(worst <= allowed, "{} {form:?} {name}: {worst:e} > {allowed:e}", method.name());
                solved += 1;
            }
        }
    }
    solved
}

/// Analytic: 11 solvers in the full form, 3 gather from patches, 4 shoot from them; three refuse row-wise stores.
const SOLVED: usize = 18 + 3 * 15;

#[test]
fn an_empty_furnace_room_is_right_to_its_closure_error() {
    let scene = furnace::room([3.0, 5.0, 2.0], RHO, EMISSION);
    assert_eq!(radiosity_is_right_to_the_closure_error(&scene, 4, Some(2)), SOLVED);
}

#[test]
fn a_furnace_with_a_box_inside_is_right_to_its_closure_error() {
    let scene = furnace::furnished(0.4, RHO, EMISSION);
    assert_eq!(radiosity_is_right_to_the_closure_error(&scene, 4, Some(2)), SOLVED);
}
