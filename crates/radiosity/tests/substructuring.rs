//! What the forms of substructuring have in common, and where they become the full form.

mod common;

use radiosity::{Method, Shape, Strategy, run};
use radiosity_core::BandValues;
use radiosity_gallery::boxes::{faces, material, scene_of_loops};
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::Subdivision;

use glam::DVec3;

/// An empty room of 3 × 5 × 2 whose six faces differ in reflectance; the ceiling and one wall emit.
fn empty_room() -> Scene {
    let loops = faces(DVec3::ZERO, DVec3::new(3.0, 5.0, 2.0), true);
    let values = [(0.4, 0.0), (0.7, 0.0), (0.3, 0.5), (0.6, 0.0), (0.8, 0.0), (0.2, 2.0)];
    let materials = values.map(|(rho, e)| material(&format!("{rho}"), rho, e)).to_vec();
    scene_of_loops(&loops.into_iter().zip(0..).collect::<Vec<_>>(), materials)
}

/// B and H of a strategy, solved to η = 1e-13. `None`: every element is a patch of its own.
fn solved(
    scene: &Scene,
    method: Method,
    shape: Shape,
    solver: &str,
    elements: u32,
    patches: Option<u32>,
) -> (BandValues, BandValues) {
    let plain = Strategy::new(Subdivision::Uniform(elements), method);
    let mut strategy = Strategy { shape, solver: solver.to_owned(), unshot: 1e-13, ..plain };
    strategy.mesh.patches = patches.map(Subdivision::Uniform);
    let solution = run(scene, &strategy, &mut ()).unwrap().solution;
    (solution.radiosity, solution.irradiance)
}

/// Largest |difference| over the mean.
fn difference(a: &BandValues, b: &BandValues) -> f64 {
    let mean = a.values().iter().sum::<f64>() / a.values().len() as f64;
    a.values().iter().zip(b.values()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / mean
}

const METHODS: [Method; 4] = [Method::sampled(1e-8, 64), Method::RAY_CAST, Method::RAYS_AND_EMITTERS, Method::HEMICUBE];

/// ρ is constant on a patch, so the mean over a patch of B = E + ρH is Ē + ρH̄ with H̄ from area-weighted rows: both are one
/// system. 1e-13 unshot of 1/(1 − ρ) ≤ 5 leaves 1e-12.
#[test]
fn the_two_level_form_equals_gathering_from_patches() {
    let scene = common::cornell_box();
    for method in METHODS {
        let (b, h) = solved(&scene, method, Shape::ElementsToPatches, "gauss-seidel", 4, Some(2));
        // Shooting reads columns: on the aggregated rows of a row-wise estimator that is another system.
        for solver in ["direct", "jacobi", "gauss-seidel"] {
            let (b2, h2) = solved(&scene, method, Shape::TwoLevel, solver, 4, Some(2));
            let apart = difference(&b, &b2).max(difference(&h, &h2));
            assert!(apart < 1e-10, "{} by {solver}: {apart:e}", method.name());
        }
    }
}

/// Rows of the same sources with the same rays and pixels. (A cell that is cut at a contact is several elements but one
/// patch, so patches as fine as the cells would be fewer than the elements.)
#[test]
fn as_many_patches_as_elements_is_the_full_form_on_row_wise_estimators() {
    let scene = common::cornell_box();
    for method in [Method::RAY_CAST, Method::RAYS_AND_EMITTERS, Method::HEMICUBE] {
        for (shape, solver) in [
            (Shape::ElementsToPatches, "gauss-seidel"),
            (Shape::TwoLevel, "gauss-seidel"),
            (Shape::PatchesToElements, "shooting"),
        ] {
            let (b, h) = solved(&scene, method, Shape::Full, solver, 3, None);
            let (b2, h2) = solved(&scene, method, shape, solver, 3, None);
            let apart = difference(&b, &b2).max(difference(&h, &h2));
            assert!(apart < 1e-10, "{} {shape:?}: {apart:e}", method.name());
        }
    }
}

/// Nothing is sampled, so it does not matter that the rectangular forms compute every pair twice.
#[test]
fn as_many_patches_as_elements_is_the_full_form_on_exact_form_factors() {
    let scene = empty_room();
    let full = solved(&scene, Method::ANALYTIC, Shape::Full, "cg", 3, None);
    for (shape, solver) in
        [(Shape::ElementsToPatches, "jacobi"), (Shape::TwoLevel, "cg"), (Shape::PatchesToElements, "shooting")]
    {
        let (b, h) = solved(&scene, Method::ANALYTIC, shape, solver, 3, None);
        let apart = difference(&full.0, &b).max(difference(&full.1, &h));
        assert!(apart < 1e-10, "{shape:?}: {apart:e}");
    }
}

/// A_e F_ep of all e and A_p F_pe of all p are the same numbers where nothing is sampled: each within 1e-10 of F.
#[test]
fn gathering_from_patches_and_shooting_from_them_agree_without_occluders() {
    let scene = empty_room();
    let gathered = solved(&scene, Method::ANALYTIC, Shape::ElementsToPatches, "gauss-seidel", 6, Some(2));
    for solver in ["jacobi", "shooting"] {
        let shot = solved(&scene, Method::ANALYTIC, Shape::PatchesToElements, solver, 6, Some(2));
        let apart = difference(&gathered.0, &shot.0).max(difference(&gathered.1, &shot.1));
        assert!(apart < 1e-9, "{solver}: {apart:e}");
    }
}

/// Patches whose radiosity is a mean are an approximation: the forms are not simply ignored.
#[test]
fn fewer_patches_than_elements_change_the_answer() {
    let scene = empty_room();
    let full = solved(&scene, Method::ANALYTIC, Shape::Full, "cg", 6, None);
    let coarse = solved(&scene, Method::ANALYTIC, Shape::ElementsToPatches, "gauss-seidel", 6, Some(2));
    let apart = difference(&full.0, &coarse.0);
    assert!(apart > 1e-4 && apart < 0.1, "{apart:e}");
}
