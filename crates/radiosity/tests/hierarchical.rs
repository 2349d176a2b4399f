//! Hierarchical runs against the full matrix on the same mesh, and what their cost grows like.

mod common;

use radiosity::{DirectLight, ErrorMeasure, GridValues, HierarchicalReport, Method, Run, Store, Strategy, run};
use radiosity_core::{BandValues, Outcome};
use radiosity_gallery::boxes::{empty_box, material};
use radiosity_gallery::city;
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::Subdivision;

/// Pairs to 1e-6, partly blocked ones to 1e-5 of F.
const METHOD: Method = Method::exact(1e-6, 1e-5);

fn solved<'a>(scene: &'a Scene, divisions: u32, store: Store, solver: &str) -> Run<'a> {
    let strategy = Strategy {
        store,
        solver: solver.to_owned(),
        unshot: 1e-6,
        ..Strategy::new(Subdivision::Uniform(divisions), METHOD)
    };
    let run = run(scene, &strategy, &mut ()).unwrap();
    assert_eq!(run.solution.outcome, Outcome::Converged);
    run
}

fn links(error: f64, direct: DirectLight) -> Store {
    Store::Hierarchical { error, direct }
}

fn report<'r>(run: &'r Run<'_>) -> &'r HierarchicalReport {
    run.hierarchical.as_ref().unwrap()
}

fn cells(run: &Run<'_>) -> GridValues {
    GridValues::means(&run.geometry, &run.solution.irradiance, 8).unwrap()
}

/// Both runs have the same mesh and the same pairs, so that links alone make the difference. The estimate takes them to err independently
/// of each other and counts what varies within the cells of the report: it is right within a factor of three either way.
#[test]
fn the_cornell_box_errs_by_about_what_is_estimated() {
    let scene = common::cornell_box();
    let exact = cells(&solved(&scene, 16, Store::Dense, "cg"));
    let mut before = f64::INFINITY;
    for asked in [0.02, 0.01, 0.005] {
        let run = solved(&scene, 16, links(asked, DirectLight::WhereFew), "cg");
        let report = report(&run);
        assert!(report.error <= asked && report.exact_emitters == 1, "{report:?}");
        let ErrorMeasure { rms: error, worst, .. } = cells(&run).error(&exact);
        assert!(error < asked && report.error < 5.0 * error, "{error:e} of {report:?}");
        // Small surfaces count as much as the mean of all, so that no cell of the blocks' tops is several times as far off as the walls'.
        assert!(worst < 5.0 * asked, "a cell is off by {worst:e} of {report:?}");
        assert!(error < before, "{error:e} after {before:e}");
        before = error;
    }
}

/// Against rows of 4096 rays, which err by 0.4 % themselves. Every wall is 16 panels, which hide what one alone does not; each emits, so that links
/// carry all light, most of it between clusters among blockers.
#[test]
fn a_city_is_within_the_estimate_and_its_panels_block_as_walls() {
    let scene = city(3, 4, 1);
    let rays = Strategy {
        store: Store::Sparse,
        solver: "jacobi".to_owned(),
        unshot: 1e-6,
        ..Strategy::new(Subdivision::Uniform(1), Method::rays(4096))
    };
    let reference = run(&scene, &rays, &mut ()).unwrap();
    let grid = |run: &Run<'_>| GridValues::means(&run.geometry, &run.solution.irradiance, 1).unwrap();
    let method = Method::of_links_among(scene.surfaces.len());
    let by_links = Strategy { store: links(0.01, DirectLight::WhereFew), method, ..rays };
    let run = run(&scene, &by_links, &mut ()).unwrap();
    let error = grid(&run).error(&grid(&reference));
    assert!(error.rms < 0.012 && error.worst < 0.06, "{error:?} of {:?}", report(&run));
    assert!(report(&run).error <= 0.01 && report(&run).exact_emitters == 0, "{:?}", report(&run));
}

/// A light of a sixteenth of the ceiling would need its own links to every element; with them the answer is the same.
#[test]
fn direct_light_is_counted_once_whichever_way_it_goes() {
    let scene = common::cornell_box();
    let exact = cells(&solved(&scene, 8, Store::Dense, "cg"));
    for direct in [DirectLight::Exact, DirectLight::ByLinks] {
        let run = solved(&scene, 8, links(0.02, direct), "cg");
        let error = cells(&run).error(&exact).rms;
        assert!(error < 0.02, "{direct:?}: {error:e}");
        assert_eq!(report(&run).exact_emitters, usize::from(direct == DirectLight::Exact));
    }
}

/// Where every surface sends and reflects the same, H = E/(1 − ρ) everywhere: row sums of links err by no more than the estimate.
#[test]
fn a_furnace_is_even_within_the_estimate() {
    let scene = empty_box([3.0, 5.0, 2.0], material("grey", 0.5, 1.0));
    for direct in [DirectLight::Exact, DirectLight::ByLinks] {
        let run = solved(&scene, 12, links(0.01, direct), "cg");
        let areas = run.geometry.elements().areas();
        let square: f64 =
            run.solution.irradiance.band(0).iter().zip(&areas).map(|(h, a)| a * (0.5 * h - 1.0).powi(2)).sum();
        let rms = (square / areas.iter().sum::<f64>()).sqrt();
        assert!(rms < 0.01, "{direct:?}: {rms:e}");
    }
}

/// Power that leaves arrives: Σ A (1 − ρ) H = Σ A E in a closed room, to the closure of the links.
#[test]
fn a_closed_room_keeps_its_power() {
    let mut scene = empty_box([3.0, 5.0, 2.0], material("grey", 0.6, 0.0));
    scene.materials.push(material("lamp", 0.2, 10.0));
    scene.surfaces[5].material = 1;
    let run = solved(&scene, 12, links(0.01, DirectLight::WhereFew), "cg");
    let areas = run.geometry.elements().areas();
    let total = |x: &BandValues| -> f64 { x.band(0).iter().zip(&areas).map(|(x, a)| x * a).sum() };
    let (emission, reflectance) = (run.geometry.emission(), run.geometry.reflectance());
    let mut absorbed = run.solution.irradiance.clone();
    absorbed.values_mut().iter_mut().zip(reflectance.values()).for_each(|(h, rho)| *h *= 1.0 - rho);
    let (in_, out) = (total(&emission), total(&absorbed));
    assert!((out / in_ - 1.0).abs() < 0.01, "{out} of {in_}");
}

#[test]
fn every_symmetric_solver_gives_the_same_answer_on_links() {
    let scene = common::cornell_box();
    let reference = solved(&scene, 4, links(0.02, DirectLight::WhereFew), "cg").solution.irradiance;
    for solver in ["jacobi", "chebyshev", "deflated-cg", "gmres"] {
        let other = solved(&scene, 4, links(0.02, DirectLight::WhereFew), solver).solution.irradiance;
        let mean = reference.values().iter().sum::<f64>() / reference.values().len() as f64;
        let pairs = reference.values().iter().zip(other.values());
        let apart = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / mean;
        // Rounds before the last end at different x and may refine different links.
        assert!(apart < 0.02, "{solver}: {apart:e}");
    }
}

#[test]
fn the_same_bytes_come_at_1_2_and_8_threads() {
    let scene = common::cornell_box();
    let irradiance = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| solved(&scene, 6, links(0.02, DirectLight::WhereFew), "cg").solution.irradiance)
    };
    let one = irradiance(1);
    assert!(one == irradiance(2) && one == irradiance(8));
}

/// From 4,849 to 77,193 elements at the same error: pairs grow 250 times.
#[test]
fn links_an_element_fall_as_the_mesh_gets_finer() {
    let scene = common::cornell_box();
    let per_element = |divisions: u32| {
        let run = solved(&scene, divisions, links(0.03, DirectLight::WhereFew), "cg");
        report(&run).links as f64 / run.geometry.elements().len() as f64
    };
    let (coarse, fine) = (per_element(16), per_element(64));
    assert!(fine < 0.5 * coarse, "{coarse} links an element, then {fine}");
}

#[test]
fn links_refuse_what_they_cannot_hold() {
    let scene = common::cornell_box();
    let strategy = Strategy { store: Store::HIERARCHICAL, ..Strategy::new(Subdivision::Uniform(2), Method::RAY_CAST) };
    let refused = run(&scene, &strategy, &mut ()).map(|_| ()).unwrap_err().to_string();
    assert!(refused.contains("links") && refused.contains("ray-cast"), "{refused}");
    let strategy =
        Strategy { store: links(2.0, DirectLight::ByLinks), ..Strategy::new(Subdivision::Uniform(2), METHOD) };
    assert!(run(&scene, &strategy, &mut ()).is_err());
}
