//! Linear reconstruction at points, against constants, where irradiance is known there.

mod common;

use radiosity::{Geometry, GridValues, LinearRadiosity, Method, Run, Shape, Strategy, run};
use radiosity_core::BandValues;
use radiosity_form_factors::point::form_factors_from;
use radiosity_gallery::{BlockedLight, FloorUnderLight, Hinge};
use radiosity_geometry::mesh::{Element, MeshSettings, Subdivision};
use radiosity_geometry::{Polygon, Scene};

/// Points along an edge of a surface.
const POINTS: u32 = 128;

/// Errors of points of surface 0, relative to the mean of H: rms and the largest.
struct Errors {
    constant: [f64; 2],
    linear: [f64; 2],
    /// Elements that are limited, and vertices at which the surface is cut.
    limited: usize,
    cuts: usize,
}

/// From the exact means of H over K × K elements of surface 0, and H at points.
fn errors(scene: &Scene, k: u32, mean: impl Fn([f64; 2], [f64; 2]) -> f64, point: impl Fn(f64, f64) -> f64) -> Errors {
    let settings = MeshSettings { elements: Subdivision::Uniform(k), patches: None, contacts: true };
    let geometry = Geometry::new(scene, &settings).unwrap();
    let range = |i: u32| [f64::from(i) / f64::from(k), f64::from(i + 1) / f64::from(k)];
    let of = |e: &Element| if e.surface == 0 { mean(range(e.i), range(e.j)) } else { 0.0 };
    let irradiance = BandValues::single(geometry.mesh().elements.iter().map(of).collect());
    let linear = LinearRadiosity::new(&geometry, &irradiance);
    let constant = GridValues::points(&geometry, &irradiance, POINTS).on(&[0]);
    let found = GridValues::linear_points(&geometry, linear.irradiance(), POINTS).on(&[0]);
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(POINTS);
    let truth: Vec<f64> = constant.indices.iter().map(|&(i, j)| point(at(i), at(j))).collect();
    let truth = GridValues { values: BandValues::single(truth), ..constant.clone() };
    let [constant, found] = [constant, found].map(|values| values.error(&truth)).map(|e| [e.rms, e.worst]);
    let (limited, cuts) = (linear.irradiance().limited().count(), linear.irradiance().cuts());
    Errors { constant, linear: found, limited, cuts }
}

/// From 8 to 32 elements along an edge constants go from 0.143 to 0.035, like h; the reconstruction like h² and better. It is continuous: nothing is limited
/// or cut.
#[test]
fn under_a_light_the_error_falls_like_the_square_of_the_size() {
    let floor = FloorUnderLight::default();
    let scene = floor.scene();
    let of = |k: u32| errors(&scene, k, |u, v| floor.mean_irradiance(u, v), |u, v| floor.irradiance(u, v));
    let (coarse, fine) = (of(8), of(32));
    let gain = |of: fn(&Errors) -> f64| of(&coarse) / of(&fine);
    assert!(gain(|e| e.constant[0]) < 4.5, "constants gain {}", gain(|e| e.constant[0]));
    assert!(gain(|e| e.linear[0]) > 16.0 && gain(|e| e.linear[1]) > 12.0, "{:?} {:?}", coarse.linear, fine.linear);
    assert!(fine.linear[0] < 0.05 * fine.constant[0], "{:?} {:?}", fine.linear, fine.constant);
    assert_eq!([coarse.limited, coarse.cuts, fine.limited, fine.cuts], [0; 4]);
}

/// H is steep without bound at the common edge, within an element of which constants and linear functions err alike; elsewhere not: the rms is less than
/// half, at every angle.
#[test]
fn at_a_hinge_the_error_is_less_than_half_that_of_constants() {
    for degrees in [30.0_f64, 90.0, 150.0] {
        let hinge = Hinge { angle: degrees.to_radians(), emission: 2.0, reflectance: 0.5 };
        for k in [8, 32] {
            let mean = |u, v| hinge.mean_irradiance(u, v);
            let found = errors(&hinge.scene(), k, mean, |u, v| hinge.irradiance(u, v));
            assert!(
                found.linear[0] < 0.5 * found.constant[0],
                "{degrees}, {k}: {:?} {:?}",
                found.linear,
                found.constant
            );
            assert!(found.linear[1] < found.constant[1], "{degrees}, {k}");
        }
    }
}

/// A blocker at 0.02 of the light's height throws a shadow with an edge of 0.006, at 0.1 of 0.033: narrower than elements until
/// there are 32 or more along an edge. There the error is that of where the edge is in an element, for both; what is smooth beside it counts for constants
/// alone. At 0.5 and above the penumbra is resolved.
#[test]
fn at_shadow_edges_from_hard_to_soft_it_is_better_than_constants() {
    for (height, k, share) in
        [(0.02, 8, 0.9), (0.02, 32, 0.75), (0.1, 16, 0.7), (0.1, 64, 0.3), (0.5, 16, 0.3), (0.9, 32, 0.2)]
    {
        let case = BlockedLight::at(height);
        let found = errors(&case.scene(), k, |u, v| case.mean_irradiance(u, v, 64), |u, v| case.irradiance(u, v));
        assert!(found.linear[0] < share * found.constant[0], "{height}, {k}: {:?} {:?}", found.linear, found.constant);
    }
}

/// The Cornell box: H gathered at points from the very patches that sent it, by exact factors among exact blockers, rms over points and bands relative to
/// the mean. With 8 × 8 elements a face 0.101 by constants and 0.035 by the reconstruction, with 16 × 16 0.053 and 0.014, with 32 × 32 0.029 and 0.0044.
#[test]
fn in_the_cornell_box_the_error_at_points_is_a_third_of_that_of_constants_and_falls_faster() {
    let scene = common::cornell_box();
    for (k, share) in [(8, 0.45), (16, 0.35)] {
        let elements = Subdivision::Uniform(k);
        let mesh = MeshSettings { elements, patches: Some(Subdivision::Uniform(4)), contacts: true };
        let plain = Strategy::new(elements, Method::exact(1e-6, 1e-4));
        let solver = "gauss-seidel".to_owned();
        let strategy = Strategy { mesh, shape: Shape::ElementsToPatches, solver, ..plain };
        let run = run(&scene, &strategy, &mut ()).unwrap();
        let [constant, found] = cornell_errors(&scene, &run);
        assert!(found < share * constant, "{k}: {found} of {constant}");
    }
}

/// rms error of H at about 800 points, of constants and of the reconstruction, over the mean.
fn cornell_errors(scene: &Scene, run: &Run<'_>) -> [f64; 2] {
    let (geometry, h) = (&run.geometry, &run.solution.irradiance);
    // What patches send.
    let mut sent = BandValues::zeros(h.count(), geometry.patches().len());
    for b in 0..h.count() {
        for (e, &p) in geometry.parent().iter().enumerate() {
            let share = geometry.elements().area(e) / geometry.patches().area(p as usize);
            sent.band_mut(b)[p as usize] += share * run.solution.radiosity.band(b)[e];
        }
    }
    let linear = LinearRadiosity::new(geometry, h);
    let blockers: Vec<Polygon> = scene.pieces().map(|(_, p)| p.clone()).collect();
    let mut exposed = vec![None; geometry.mesh().elements.len()];
    geometry.exposed().iter().enumerate().for_each(|(k, &e)| exposed[e as usize] = Some(k));
    let (mut squares, mut level, mut count) = ([0.0; 2], 0.0, 0.0);
    for (s, surface) in scene.surfaces.iter().enumerate() {
        let piece = &geometry.mesh().pieces(s)[0];
        let points = (800.0 * surface.area() / scene.area()) as u32;
        for i in 0..points {
            // A lattice of the golden ratio is even over the face, and no point of it lies on an edge.
            let (u, v) =
                ((f64::from(i) + 0.5) / f64::from(points), (0.5 + f64::from(i) * 0.618_033_988_749_895).fract());
            let Some(e) = exposed[geometry.mesh().locate(s, 0, u, v).unwrap()] else { continue };
            let (x, normal) = (piece.point(u, v), geometry.elements().polygons(e)[0].normal());
            let factors = form_factors_from(x, normal, geometry.patches(), &blockers);
            let place = linear.place(e, x);
            for b in 0..h.count() {
                let truth: f64 = factors.iter().zip(sent.band(b)).map(|(f, b)| f * b).sum();
                let found = [h.band(b)[e], linear.irradiance().value(&place, b)];
                squares.iter_mut().zip(found).for_each(|(square, found)| *square += (found - truth).powi(2));
                (level, count) = (level + truth, count + 1.0);
            }
        }
    }
    squares.map(|square: f64| (square / count).sqrt() / (level / count))
}

/// B = E + ρH, so the mean over an element is that of the solution, and a light is shown as one.
#[test]
fn the_mean_of_radiosity_over_each_element_is_that_of_the_solution() {
    let scene = common::cornell_box();
    let strategy = Strategy::new(Subdivision::Uniform(4), Method::OF_LINKS);
    let run = run(&scene, &strategy, &mut ()).unwrap();
    let linear = LinearRadiosity::new(&run.geometry, &run.solution.irradiance);
    for (e, &element) in run.geometry.exposed().iter().enumerate() {
        for b in 0..linear.bands() {
            let (mut sum, mut area) = (0.0, 0.0);
            for corners in linear.irradiance().triangles(element as usize) {
                let part = (corners[1].0 - corners[0].0).cross(corners[2].0 - corners[0].0).length();
                sum += part * corners.iter().map(|(_, place)| linear.radiosity(e, place, b)).sum::<f64>() / 3.0;
                area += part;
            }
            let known = run.solution.radiosity.band(b)[e];
            // η = 1e-9 of what is emitted may be unshot: there B is not quite E + ρH.
            assert!((sum / area - known).abs() < 1e-6 * (1.0 + known), "{e}: {} instead of {known}", sum / area);
        }
    }
}
