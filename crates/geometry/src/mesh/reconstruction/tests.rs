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

/// To rounding of some tens of terms, in rooms of size 1000 and slopes of 1; strips at contacts, of one element's width, have
/// no neighbours across and are left out.
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
    println!("cuts {} limited {}", linear.cuts(), linear.limited().count());
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

/// Means over elements of side h of x² and y² are x_c² + h²/12: the rounding of the points' own parabola is gone, and what
/// is left falls like h².
#[test]
fn the_error_of_smooth_values_falls_like_the_square_of_the_size() {
    let value = |x: DVec3| 3.0 + x.x * x.x - 1.5 * x.x * x.y + (2.0 * x.y).sin();
    let worst = |k: u32| {
        let mesh = mesh_of(&scene_of(&[square()]), k);
        // 8 × 8 midpoints an element: their own error is 1/64 of the difference of mean and centre.
        let of = |e: usize| {
            let h = 1.0 / f64::from(k);
            let corner = mesh.element_facets.polygons(e)[0].vertices()[0];
            let at = |i: usize| h * (i as f64 + 0.5) / 8.0;
            (0..64).map(|i| value(corner + DVec3::new(at(i % 8), at(i / 8), 0.0))).sum::<f64>() / 64.0
        };
        let means: Vec<f64> = (0..mesh.elements.len()).map(of).collect();
        let linear = Reconstruction::new(&mesh, &means);
        println!("k {k} cuts {} limited {}", linear.cuts(), linear.limited().count());
        let mut random = Random(3);
        let mut worst = [0.0_f64; 2];
        for e in 0..mesh.elements.len() {
            for _ in 0..16 {
                let x = random_point(&mesh, e, &mut random);
                worst[0] = worst[0].max((linear.at(e, x, 0) - value(x)).abs());
                worst[1] = worst[1].max((means[e] - value(x)).abs());
            }
        }
        worst
    };
    let all: Vec<[f64; 2]> = [8, 16, 32].map(worst).to_vec();
    println!("{all:?}");
}

#[test]
fn speed() {
    let mesh = mesh_of(&scene_of(&cornell_box()), 100);
    let mut random = Random(2);
    let values: Vec<f64> = at_centres(&mesh, |x| 2000.0 + x.x + 3.0 * x.y - 0.3 * x.z);
    let t = std::time::Instant::now();
    let c = mesh.conforming();
    println!("m {} conforming {:?} corners {}", values.len(), t.elapsed(), c.corners.len());
    let t = std::time::Instant::now();
    let linear = Reconstruction::new(&mesh, &[&values[..], &values[..], &values[..]].concat());
    println!("all {:?}", t.elapsed());
    let es: Vec<(usize, DVec3)> = (0..1_000_000).map(|_| { let e = (random.unit() * values.len() as f64) as usize; (e, random_point(&mesh, e, &mut random)) }).collect();
    let t = std::time::Instant::now();
    let s: f64 = es.iter().map(|&(e, x)| linear.at(e, x, 0)).sum();
    println!("at {:?} {s}", t.elapsed());
    let t = std::time::Instant::now();
    let s: f64 = es.iter().map(|&(e, x)| { let p = linear.place(e, x); linear.value(&p, 0) + linear.value(&p, 1) + linear.value(&p, 2) }).sum();
    println!("at 3 bands {:?} {s}", t.elapsed());
    let t = std::time::Instant::now();
    let few: Vec<(usize, DVec3)> = es.iter().filter(|(e, _)| *e < 4000).copied().collect();
    let s: f64 = (0..40).map(|_| few.iter().map(|&(e, x)| { let p = linear.place(e, x); linear.value(&p, 0) + linear.value(&p, 1) + linear.value(&p, 2) }).sum::<f64>()).sum();
    println!("cached {} points {:?} {s}", 40 * few.len(), t.elapsed());
}

/// Shares of elements on the dark side of a line, and what the reconstruction makes of them.
#[test]
fn steps() {
    for (k, angle, at) in [(16, 0.0, 0.5), (16, 0.0, 0.52), (16, 0.0, 0.53), (16, 0.0, 0.55), (16, 0.3, 0.52), (16, 0.7854, 0.7), (32, 0.3, 0.52), (32, 1.1, 0.55), (32, 1.1, 0.5)] {
        let mesh = mesh_of(&scene_of(&[square()]), k);
        let (s, c) = f64::sin_cos(angle);
        let n = DVec3::new(c, s, 0.0);
        for (name, smooth) in [("step", 0.0), ("slope", 0.5)] {
            let light = |x: DVec3| if x.dot(n) < at { 1.0 + smooth * x.y } else { smooth * (x.x + 0.1) };
            let means: Vec<f64> = mesh.element_facets.iter_polygons().map(|(_, p)| {
                let mut sum = 0.0;
                for i in 0..32 { for j in 0..32 {
                    let v = p.vertices();
                    let (a, b) = ((i as f64 + 0.5) / 32.0, (j as f64 + 0.5) / 32.0);
                    sum += light(v[0] + (v[1] - v[0]) * a + (v[3] - v[0]) * b);
                }}
                sum / 1024.0
            }).collect();
            let linear = Reconstruction::new(&mesh, &means);
            let (mut a, mut b, mut over) = (0.0, 0.0, 0.0_f64);
            let mut random = Random(1);
            for e in 0..means.len() {
                for _ in 0..32 {
                    let x = random_point(&mesh, e, &mut random);
                    a += (means[e] - light(x)).powi(2);
                    b += (linear.at(e, x, 0) - light(x)).powi(2);
                }
                for (x, place) in linear.triangles(e).flatten() {
                    let v = linear.value(&place, 0);
                    let c = mesh.element_facets.polygons(e)[0].centroid();
                    let h = 1.0 / f64::from(k);
                    let near = (0..means.len()).filter(|&o| mesh.element_facets.polygons(o)[0].centroid().distance(c) < 1.5 * h).map(|o| means[o]);
                    let (lo, hi) = near.fold((9.0_f64, -9.0_f64), |(l, h), v| (l.min(v), h.max(v)));
                    if (v - hi).max(lo - v) > 0.04 && at == 0.52 && angle == 0.0 { println!("  {x} v {v} of [{lo}, {hi}] u {} limit {} {:?}", means[e], linear.values[0].limits[e], place.shares); }
                    over = over.max(v - hi).max(lo - v);
                }
            }
            println!("{name} {k} {angle} {at}: {:.4} {:.4} over {over:.3} limited {} cuts {}", (a / 32.0 / means.len() as f64).sqrt(), (b / 32.0 / means.len() as f64).sqrt(), linear.limited().count(), linear.cuts());
        }
    }
    for k in [16] {
        let mesh = mesh_of(&scene_of(&[square()]), k);
        let mut random = Random(8);
        for noise in [0.0, 0.001, 0.01, 0.05] {
            let means: Vec<f64> = at_centres(&mesh, |x| 1.0 + (3.0 * x.x).sin() * x.y).iter().map(|v| v * (1.0 + noise * (random.unit() + random.unit() - 1.0))).collect();
            let linear = Reconstruction::new(&mesh, &means);
            println!("noise {noise}: limited {} cuts {} of {}", linear.limited().count(), linear.cuts(), (k - 1) * (k - 1));
        }
    }
}
