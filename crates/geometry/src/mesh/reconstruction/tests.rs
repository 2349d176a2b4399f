use super::super::{MeshSettings, Subdivision};
use super::*;
use crate::testing::{Random, cornell_box, cube, quad, scene_of};
use crate::{Occluders, Scene};

fn mesh_of(scene: &Scene, k: u32) -> Mesh {
    let settings = MeshSettings { elements: Subdivision::Uniform(k), patches: None, contacts: true };
    Mesh::new(scene, &Occluders::of_scene(scene), &settings).unwrap()
}

/// Refined `rounds` times where `marked` says so of a centre.
fn refined(mut mesh: Mesh, rounds: usize, mut marked: impl FnMut(DVec3) -> bool) -> Mesh {
    for _ in 0..rounds {
        let marks: Vec<bool> = mesh.element_facets.iter_polygons().map(|(_, p)| marked(p.centroid())).collect();
        mesh = mesh.refined(&marks).mesh;
    }
    mesh
}

/// The Cornell box with a triangle beside it, refined at random to four levels.
fn uneven() -> Mesh {
    let mut faces = cornell_box();
    faces.push(vec![DVec3::new(0., 700., 9.), DVec3::new(400., 700., 9.), DVec3::new(100., 1000., 9.)]);
    let mut random = Random(5);
    refined(mesh_of(&scene_of(&faces), 3), 4, move |_| random.unit() < 0.2)
}

/// A square 0 … 1 by 0 … 1 at z = 0 that faces up.
fn square() -> Vec<DVec3> {
    quad(DVec3::ZERO, DVec3::X, DVec3::new(1., 1., 0.), DVec3::Y)
}

/// Values at the centres of area: means of what is linear.
fn at_centres(mesh: &Mesh, value: impl Fn(DVec3) -> f64) -> Vec<f64> {
    mesh.element_facets.iter_polygons().map(|(_, p)| value(p.centroid())).collect()
}

/// A point of an element.
fn random_point(mesh: &Mesh, e: usize, random: &mut Random) -> DVec3 {
    mesh.element_facets.polygons(e)[0].sample(random.unit(), random.unit())
}

fn exposed(mesh: &Mesh) -> impl Iterator<Item = usize> + '_ {
    (0..mesh.elements.len()).filter(|&e| !mesh.elements[e].covered)
}

/// Mean over an element by its triangles, in each of which the value is linear.
fn mean(linear: &Reconstruction, e: usize) -> f64 {
    let (mut sum, mut area) = (0.0, 0.0);
    for t in linear.triangles(e) {
        let part = (t[1].0 - t[0].0).cross(t[2].0 - t[0].0).length();
        sum += part * t.iter().map(|(_, place)| linear.value(place, 0)).sum::<f64>() / 3.0;
        area += part;
    }
    sum / area
}

/// To rounding of some tens of terms of up to 2000: in the middle, at borders, in corners and at vertices that hang on longer edges.
#[test]
fn linear_functions_are_reproduced_on_elements_of_any_level() {
    let mesh = uneven();
    let value = |x: DVec3| 2000.0 + x.dot(DVec3::new(0.7, -0.9, 0.4));
    let linear = Reconstruction::new(&mesh, &at_centres(&mesh, value));
    let mut random = Random(1);
    let mut worst = 0.0_f64;
    for e in exposed(&mesh) {
        for _ in 0..8 {
            let x = random_point(&mesh, e, &mut random);
            let d = (linear.at(e, x, 0) - value(x)).abs();
            worst = worst.max(d);
        }
        for (x, place) in linear.triangles(e).flatten() {
            worst = worst.max((linear.value(&place, 0) - value(x)).abs());
        }
    }
    assert!(worst < 1e-12 * 2000.0, "{worst:e}");
}

/// Random values are as rough as can be. 1e-13: sums of some ten terms.
#[test]
fn means_of_elements_are_kept_and_nothing_becomes_negative() {
    let mesh = uneven();
    let mut random = Random(2);
    let values: Vec<f64> = mesh.elements.iter().map(|_| random.unit().powi(4)).collect();
    let linear = Reconstruction::new(&mesh, &values);
    for e in exposed(&mesh) {
        assert!((mean(&linear, e) - values[e]).abs() < 1e-13, "element {e}");
        for (_, place) in linear.triangles(e).flatten() {
            assert!(linear.value(&place, 0) >= -1e-15, "element {e}");
        }
    }
}

/// Means of a function over square elements by 32 × 32 points each.
fn means(mesh: &Mesh, value: impl Fn(DVec3) -> f64) -> Vec<f64> {
    let of = |(_, p): (usize, &crate::Polygon)| {
        let (v, at) = (p.vertices(), |i: u32| (f64::from(i) + 0.5) / 32.0);
        let points = (0..32).flat_map(|i| (0..32).map(move |j| (at(i), at(j))));
        points.map(|(a, b)| value(v[0] + (v[1] - v[0]) * a + (v[3] - v[0]) * b)).sum::<f64>() / 1024.0
    };
    mesh.element_facets.iter_polygons().map(of).collect()
}

/// rms error at random points of constants and of the reconstruction.
fn errors(mesh: &Mesh, means: &[f64], linear: &Reconstruction, value: impl Fn(DVec3) -> f64) -> [f64; 2] {
    let mut random = Random(3);
    let mut squares = [0.0; 2];
    for (e, &mean) in means.iter().enumerate() {
        for _ in 0..16 {
            let x = random_point(mesh, e, &mut random);
            squares[0] += (mean - value(x)).powi(2);
            squares[1] += (linear.at(e, x, 0) - value(x)).powi(2);
        }
    }
    squares.map(|sum: f64| (sum / (16 * means.len()) as f64).sqrt())
}

/// A quarter of the size divides the error of constants by 4 and that of linear functions by 16, or more as the share of borders falls.
#[test]
fn the_error_of_smooth_values_falls_like_the_square_of_the_size() {
    let value = |x: DVec3| 3.0 + x.x * x.x - 1.5 * x.x * x.y + (2.0 * x.y).sin();
    let of = |k: u32| {
        let mesh = mesh_of(&scene_of(&[square()]), k);
        let means = means(&mesh, value);
        let linear = Reconstruction::new(&mesh, &means);
        assert_eq!((linear.cuts(), linear.limited().count()), (0, 0));
        errors(&mesh, &means, &linear, value)
    };
    let (coarse, fine) = (of(8), of(32));
    assert!((coarse[0] / fine[0] - 4.0).abs() < 0.2, "{coarse:?} {fine:?}");
    assert!(coarse[1] / fine[1] > 16.0, "{coarse:?} {fine:?}");
}

/// At vertices, those that hang on longer edges included, elements agree to rounding, over two faces that continue each other as well.
#[test]
fn smooth_values_have_no_cracks() {
    let [a, b, c, d] = [DVec3::ZERO, DVec3::X, DVec3::new(1., 1., 0.), DVec3::Y];
    let mut random = Random(7);
    let mesh = mesh_of(&scene_of(&[vec![a, b, c], vec![a, c, d]]), 4);
    let mesh = refined(mesh, 3, move |_| random.unit() < 0.2);
    let linear = Reconstruction::new(&mesh, &at_centres(&mesh, |x| 2.0 + x.x * x.x + x.x * x.y));
    assert_eq!((linear.cuts(), linear.limited().count()), (0, 0));
    let mut known = std::collections::HashMap::new();
    for (x, place) in (0..linear.len()).flat_map(|e| linear.triangles(e)).flat_map(|[_, p, q]| [p, q]) {
        let (value, found) = (linear.value(&place, 0), x.to_array().map(f64::to_bits));
        let first = *known.entry(found).or_insert(value);
        assert!((value - first).abs() < 1e-14, "{x}: {value} and {first}");
    }
    // Both faces have the vertices of their common edge, each once.
    assert!(mesh.elements.iter().any(|e| e.level == 3) && known.len() < mesh.elements.len());
}

/// A partition off every mesh line, dark on one side: nothing of the light is on the other, and beside it linear functions stay exact.
#[test]
fn nothing_is_smoothed_across_a_partition() {
    let x = 0.37;
    let sheet = quad(DVec3::X * x, DVec3::new(x, 1., 0.), DVec3::new(x, 1., 1.), DVec3::new(x, 0., 1.));
    let back = sheet.iter().rev().copied().collect();
    let mesh = mesh_of(&scene_of(&[square(), sheet, back]), 5);
    let light = |p: DVec3| if p.x < x { 0.0 } else { 1.0 + 0.3 * p.x - 0.2 * p.y };
    let linear = Reconstruction::new(&mesh, &at_centres(&mesh, light));
    let mut random = Random(4);
    for e in (0..linear.len()).filter(|&e| mesh.elements[e].surface == 0) {
        for _ in 0..8 {
            let p = random_point(&mesh, e, &mut random);
            // Points of the partition itself are on either side.
            let known = if (p.x - x).abs() < 1e-9 { linear.at(e, p, 0) } else { light(p) };
            assert!((linear.at(e, p, 0) - known).abs() < 1e-14, "{p}: {}", linear.at(e, p, 0));
        }
    }
}

#[test]
fn nothing_is_smoothed_across_the_edges_of_a_room() {
    let mesh = mesh_of(&scene_of(&cube(2.0)), 3);
    let values: Vec<f64> = mesh.elements.iter().map(|e| f64::from(e.surface)).collect();
    let linear = Reconstruction::new(&mesh, &values);
    for (e, known) in values.iter().enumerate() {
        assert!(linear.triangles(e).flatten().all(|(_, place)| (linear.value(&place, 0) - known).abs() < 1e-15));
    }
}

/// A step along a mesh line stays one, and what is smooth on both sides of it stays so.
#[test]
fn a_shadow_line_between_elements_is_cut() {
    let mesh = mesh_of(&scene_of(&[square()]), 16);
    let light = |x: DVec3| if x.x < 0.5 { 1.0 + 0.5 * x.y } else { 0.5 * (x.x + 0.1) };
    let means = means(&mesh, light);
    let linear = Reconstruction::new(&mesh, &means);
    // 17 vertices of the line.
    assert_eq!(linear.cuts(), 17);
    let [constant, found] = errors(&mesh, &means, &linear, light);
    assert!(found < 0.4 * constant, "{found} of {constant}");
}

/// Steps that run through elements, at several angles: better than constants by 5 to 45 %, and over what lies next to an element by no more than a
/// quarter of the jump; hardly at all (by the slope of 0.5 over half an element) where the step is parallel to the mesh.
#[test]
fn a_shadow_line_through_elements_neither_overshoots_nor_blurs() {
    let cases = [
        (16, 0.0, 0.52, 0.02),
        (16, 0.0, 0.53, 0.02),
        (16, 0.0, 0.55, 0.02),
        (16, 0.3, 0.52, 0.2),
        (16, std::f64::consts::FRAC_PI_4, 0.7, 0.25),
        (32, 1.1, 0.5, 0.1),
    ];
    for (k, angle, at, most) in cases {
        let mesh = mesh_of(&scene_of(&[square()]), k);
        let n = DVec3::new(f64::cos(angle), f64::sin(angle), 0.0);
        let light = |x: DVec3| if x.dot(n) < at { 1.0 + 0.5 * x.y } else { 0.5 * (x.x + 0.1) };
        let means = means(&mesh, light);
        let linear = Reconstruction::new(&mesh, &means);
        let [constant, found] = errors(&mesh, &means, &linear, light);
        assert!(found < 0.95 * constant, "{angle} {at}: {found} of {constant}");
        let centre = |e: usize| mesh.element_facets.polygons(e)[0].centroid();
        for e in 0..means.len() {
            let near =
                (0..means.len()).filter(|&o| centre(o).distance(centre(e)) < 1.5 / f64::from(k)).map(|o| means[o]);
            let (lo, hi) = near.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
            for (x, place) in linear.triangles(e).flatten() {
                let value = linear.value(&place, 0);
                assert!(value > lo - most && value < hi + most, "{angle} {at}, {x}: {value} beyond {lo} … {hi}");
            }
        }
    }
}

/// Noise parts edges here and there, and hardly a vertex.
#[test]
fn noise_of_a_percent_cuts_next_to_nothing() {
    let mesh = mesh_of(&scene_of(&[square()]), 16);
    let mut random = Random(8);
    let mut noise = || 1.0 + 0.01 * (random.unit() + random.unit() - 1.0);
    let values: Vec<f64> =
        at_centres(&mesh, |x| 1.0 + (3.0 * x.x).sin() * x.y).into_iter().map(|v| v * noise()).collect();
    let linear = Reconstruction::new(&mesh, &values);
    assert!(linear.cuts() <= 4 && linear.limited().count() <= 4, "{} {}", linear.cuts(), linear.limited().count());
}

/// Values of three bands, as rough as they can be; a scaled and shifted mesh rounds its lengths anew.
#[test]
fn threads_change_nothing_and_neither_does_scale() {
    let faces = cornell_box();
    let moved = faces.iter().map(|f| f.iter().map(|v| *v * 1e-3 + DVec3::splat(2.0)).collect()).collect::<Vec<_>>();
    let mesh = mesh_of(&scene_of(&faces), 4);
    let mut random = Random(6);
    let values: Vec<f64> = (0..3 * mesh.elements.len()).map(|_| random.unit()).collect();
    let with = |mesh: &Mesh, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Reconstruction::new(mesh, &values))
    };
    let one = with(&mesh, 1);
    assert_eq!(one, with(&mesh, 3));
    let small = with(&mesh_of(&scene_of(&moved), 4), 2);
    for e in exposed(&mesh) {
        for (p, q) in one.triangles(e).flatten().zip(small.triangles(e).flatten()) {
            for band in 0..3 {
                let (a, b) = (one.value(&p.1, band), small.value(&q.1, band));
                assert!((a - b).abs() < 1e-9, "element {e}: {a} and {b}");
            }
        }
    }
}
