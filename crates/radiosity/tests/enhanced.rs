//! Light by way of specular surfaces, against rooms in which it is known and against the path tracer.

mod common;

use std::f64::consts::PI;

use radiosity::{Method, Shape, SpecularBy, SpecularTransport, Store, Strategy, run, run_enhanced};
use radiosity_form_factors::extended::SpecularBounces;
use radiosity_gallery::MirrorRoom;
use radiosity_gallery::boxes::{empty_box, material};
use radiosity_gallery::mirror::opened;
use radiosity_geometry::mesh::Subdivision;
use radiosity_geometry::{Material, Occluders, Polygon, Scene, Specular};
use radiosity_render::brdf::cosine_direction;
use radiosity_render::numbers::{Numbers, ROUND};
use radiosity_render::{PathClass, PathClasses, PathTracer, Stage};
use rayon::prelude::*;

fn strategy(elements: u32, rays: u32, shape: Shape) -> Strategy {
    let solver = if shape == Shape::PatchesToElements { "shooting" } else { "gauss-seidel" };
    let mut strategy = Strategy::new(Subdivision::Uniform(elements), Method::RayCast { rays, error: None });
    strategy.mesh.patches = (shape != Shape::Full).then_some(Subdivision::Uniform(elements / 2));
    Strategy { shape, store: Store::Sparse, solver: solver.to_owned(), ..strategy }
}

fn transport(bounces: SpecularBounces, rays: u32) -> SpecularTransport {
    SpecularTransport { bounces, by: SpecularBy::Rays(rays) }
}

/// A closed room of E = 3, ρ = 0.3 and mirrors of reflectance `mirror` in one or more bands, everywhere.
fn room(mirror: &[f64]) -> Scene {
    let specular = Some(Specular::Mirror { reflectance: mirror.to_vec() });
    let bands = mirror.len();
    empty_box([3.0, 2.0, 2.5], Material { specular, ..Material::diffuse("wall", vec![0.3; bands], vec![3.0; bands]) })
}

/// With the share s = ρ_s + ρ_s² + … of the bounces allowed, H = (1 + s) B and B = E/(1 − ρ (1 + s)), however it is cut into elements. Rays end on walls
/// always, and at random only after four bounces.
#[test]
fn a_furnace_with_mirrors_is_as_bright_as_its_mirrors_say() {
    for shape in [Shape::Full, Shape::ElementsToPatches, Shape::PatchesToElements] {
        for (bounces, share) in
            [(SpecularBounces::AtMost(1), 0.4), (SpecularBounces::AtMost(2), 0.56), (SpecularBounces::Any, 2.0 / 3.0)]
        {
            let scene = room(&[0.4]);
            let found = run_enhanced(&scene, &strategy(2, 512, shape), transport(bounces, 2048), &mut ()).unwrap();
            let b = 3.0 / (1.0 - 0.3 * (1.0 + share));
            let expected = [3.0, 3.0 * share, b - 3.0, (b - 3.0) * share];
            let areas = found.run.geometry.elements().areas();
            let total: f64 = areas.iter().sum();
            for (way, expected) in found.ways.iter().zip(expected) {
                let mean = way.band(0).iter().zip(&areas).map(|(h, a)| h * a).sum::<f64>() / total;
                assert!((mean - expected).abs() < 6e-3 * expected, "{shape:?}, {bounces:?}: {mean}, not {expected}");
            }
            for (e, h) in found.run.solution.irradiance.band(0).iter().enumerate() {
                let sum: f64 = found.ways.iter().map(|way| way.band(0)[e]).sum();
                assert!((sum - h).abs() < 1e-7 * h, "ways add up: {sum}, {h}");
            }
        }
    }
}

/// What a mirror shows is behind the hole in its place; rays of both scenes err by about 2 % an element of the room.
#[test]
fn a_mirror_is_a_hole_into_a_mirrored_room() {
    let scene = MirrorRoom { opening: [[0.3, 1.6], [0.5, 2.0]], ..MirrorRoom::default() }.scene();
    let hole = opened(&scene, MirrorRoom::MIRROR);
    let strategy = Strategy { method: Method::RaysAndEmitters { rays: 4096 }, ..strategy(4, 4096, Shape::Full) };
    let here = run_enhanced(&scene, &strategy, transport(SpecularBounces::Any, 16384), &mut ()).unwrap().run;
    let there = run(&hole, &strategy, &mut ()).unwrap();
    let blind = run(&scene, &strategy, &mut ()).unwrap();
    // The floor is surface 5 with the mirror and 4 without it.
    let floor = |run: &radiosity::Run<'_>, surface: u32| -> Vec<f64> {
        let on = run.geometry.surfaces().into_iter().enumerate().filter(|(_, s)| *s == surface);
        on.map(|(e, _)| run.solution.irradiance.band(0)[e]).collect()
    };
    let (here, there, blind) = (floor(&here, 5), floor(&there, 4), floor(&blind, 5));
    let rms = |a: &[f64]| {
        assert_eq!(a.len(), there.len());
        let sum: f64 = a.iter().zip(&there).map(|(a, b)| (a - b).powi(2)).sum();
        (sum / there.iter().map(|b| b * b).sum::<f64>()).sqrt()
    };
    assert!(rms(&here) < 0.02, "{}", rms(&here));
    assert!(rms(&blind) > 0.1, "the mirror matters: {}", rms(&blind));
}

/// By images the same, to what is asked of the pairs: on every surface of the room, with its block before the mirror.
#[test]
fn images_are_a_hole_into_a_mirrored_room_to_1e_6() {
    for opening in [[[0.3, 1.6], [0.5, 2.0]], [[0.0, 2.0], [0.0, 2.5]]] {
        let scene = MirrorRoom { opening, ..MirrorRoom::default() }.scene();
        let hole = opened(&scene, MirrorRoom::MIRROR);
        let strategy = Strategy::new(Subdivision::Uniform(3), Method::exact(1e-9, 1e-8));
        for bounces in [SpecularBounces::AtMost(1), SpecularBounces::Any] {
            let transport = SpecularTransport { bounces, by: SpecularBy::Images };
            let here = run_enhanced(&scene, &strategy, transport, &mut ()).unwrap();
            let there = run(&hole, &strategy, &mut ()).unwrap();
            assert_eq!((strategy.solver.as_str(), here.specular.cost.rays), ("cg", 0));
            let count = scene.surfaces.len() as u32 - 1;
            let near = |run: &radiosity::Run<'_>, range: std::ops::Range<u32>| -> Vec<f64> {
                let on = run.geometry.surfaces().into_iter().enumerate().filter(|(_, s)| range.contains(s));
                on.map(|(e, _)| run.solution.irradiance.band(0)[e]).collect()
            };
            let (here, there) = (near(&here.run, 1..count + 1), near(&there, 0..count));
            assert_eq!(here.len(), there.len());
            let mean = there.iter().sum::<f64>() / there.len() as f64;
            let worst = here.iter().zip(&there).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-6 * mean, "{opening:?}, {bounces:?}: {worst:e} of {mean}");
        }
    }
}

/// The light that a mirror throws on the floor of the Cornell box, its right wall an ideal mirror: each of 8 × 8 cells within 2 % of path tracing (of the mean of all cells
/// where there is less than a fifth of it) and three standard errors.
///
/// Paths are traced in the room with a hole: through a mirror they would meet lights by chance only. Half the directions are drawn in proportion to the cosine, half over
/// the hole; lights seen in them directly are left out and drawn by themselves, those behind the hole alone.
#[test]
fn a_mirror_wall_of_the_cornell_box_throws_light_on_the_floor() {
    let mut scene = common::cornell_box();
    let wall = scene.surfaces.iter().position(|s| s.name == "right_green").unwrap();
    let none = vec![0.0; 3];
    let specular = Some(Specular::Mirror { reflectance: vec![1.0; 3] });
    scene.materials.push(Material { specular, ..Material::diffuse("mirror", none.clone(), none.clone()) });
    scene.surfaces[wall].material = scene.materials.len() - 1;
    let window = scene.surfaces[wall].pieces[0].clone();

    let hole = opened(&scene, wall);
    let mut behind = hole.clone();
    for surface in &mut behind.surfaces[..scene.surfaces.len() - 1] {
        let dark = Material { emission: none.clone(), ..behind.materials[surface.material].clone() };
        surface.material = behind.materials.len();
        behind.materials.push(dark);
    }
    let [occluders, hole_occluders, behind_occluders] = [&scene, &hole, &behind].map(Occluders::of_scene);
    let hole_stage = Stage::new(&hole, &hole_occluders);
    let behind_stage = Stage::new(&behind, &behind_occluders);
    let classes =
        |names: &[&str]| names.iter().fold(PathClasses::NONE, |set, name| set.with(PathClass::named(name).unwrap()));
    let indirect = PathTracer::new(&hole_stage, classes(&["LDE", "LDDE"]));
    let direct = PathTracer::new(&behind_stage, classes(&["LDE"]));

    let sample = |floor: &Polygon, k: u64, numbers: &mut Numbers, value: &mut [f64]| {
        let u = numbers.draw();
        let x = floor.sample(u[0], u[1]);
        direct.irradiance(x, floor.normal(), numbers, value);
        let (a, b) = floor.frame();
        let local = cosine_direction([u[2], u[3]]);
        let w = if k.is_multiple_of(2) {
            (window.sample(u[2], u[3]) - x).normalize()
        } else {
            a * local.x + b * local.y + floor.normal() * local.z
        };
        let (cos, toward) = (w.dot(floor.normal()), -w.dot(window.normal()));
        let first = occluders.first_hit(x, w).filter(|hit| hit.owner as usize == wall);
        let Some(hit) = first.filter(|_| cos > 0.0 && toward > 0.0) else { return };
        let density = 0.5 * (cos / PI + hit.distance.powi(2) / (toward * window.area()));
        let mut radiance = [0.0; 3];
        indirect.radiance(x, w, numbers, &mut radiance);
        value.iter_mut().zip(radiance).for_each(|(value, l)| *value += l * cos / density);
    };
    const PATHS: u64 = 32768;
    let traced = |cell: usize, polygon: &Polygon| -> (f64, f64) {
        let (mut sum, mut squares, rounds) = (0.0, 0.0, PATHS / u64::from(ROUND));
        for round in 0..rounds {
            let mut value = [0.0; 3];
            for k in round * u64::from(ROUND)..(round + 1) * u64::from(ROUND) {
                sample(polygon, k, &mut Numbers::of_pixel(5, cell as u64, k), &mut value);
            }
            let mean = value[0] / f64::from(ROUND);
            (sum, squares) = (sum + mean, squares + mean * mean);
        }
        let mean = sum / rounds as f64;
        (mean, ((squares / rounds as f64 - mean * mean).max(0.0) / rounds as f64).sqrt())
    };

    let strategy = Strategy::new(Subdivision::Uniform(8), Method::exact(1e-6, 1e-4));
    let transport = SpecularTransport { bounces: SpecularBounces::Any, by: SpecularBy::Images };
    let found = run_enhanced(&scene, &strategy, transport, &mut ()).unwrap();
    let grid = found.run.geometry.mesh().report_grid(&scene, 8).unwrap();
    let thrown = [1, 3].map(|way| grid.means(found.run.geometry.spread(&found.ways[way]).band(0)));
    let floor: Vec<usize> = (0..grid.cells.len()).filter(|&c| grid.cells[c].surface == 0).collect();
    let truth: Vec<(f64, f64)> = floor.par_iter().map(|&c| traced(c, &grid.cells[c].polygon)).collect();
    let mean = truth.iter().map(|(h, _)| h).sum::<f64>() / truth.len() as f64;
    for (&c, (truth, error)) in floor.iter().zip(&truth) {
        let h = thrown[0][c] + thrown[1][c];
        let base = if *truth < 0.2 * mean { mean } else { *truth };
        assert!(
            (h - truth).abs() < 0.02 * base + 3.0 * error,
            "cell {c}: {h}, {truth} ± {error} by paths, mean {mean}"
        );
        assert!(*error < 0.02 * base, "cell {c}: {truth} ± {error}");
    }
}

/// Irradiance of an element's points by the path tracer, through a glossy floor and off a mirror.
#[test]
fn the_path_tracer_agrees() {
    let mut scene = MirrorRoom { mirror: 0.8, block: false, ..MirrorRoom::default() }.scene();
    let glossy = Specular::Phong { reflectance: vec![0.4], exponent: 10.0 };
    scene.materials.push(Material { specular: Some(glossy), ..material("floor", 0.3, 0.0) });
    scene.surfaces[5].material = 3;
    let strategy = Strategy { method: Method::RaysAndEmitters { rays: 4096 }, ..strategy(8, 4096, Shape::Full) };
    let found = run_enhanced(&scene, &strategy, transport(SpecularBounces::Any, 16384), &mut ()).unwrap().run;
    let (occluders, facets) = (Occluders::of_scene(&scene), found.geometry.elements());
    let stage = Stage::new(&scene, &occluders);
    let tracer = PathTracer::new(&stage, PathClasses::ALL);
    let surfaces = found.geometry.surfaces();
    let (mut squares, mut count) = (0.0, 0);
    // Every fifth element of the walls and the ceiling.
    for e in (0..facets.len()).step_by(5).filter(|&e| [2, 3, 4, 6].contains(&surfaces[e])) {
        let polygon = &facets.polygons(e)[0];
        let mut value = [0.0];
        const PATHS: u64 = 16384;
        for k in 0..PATHS {
            let mut numbers = Numbers::of_pixel(5, e as u64, k);
            let u = numbers.draw();
            tracer.irradiance(polygon.sample(u[0], u[1]), polygon.normal(), &mut numbers, &mut value);
        }
        let truth = value[0] / PATHS as f64;
        squares += (found.solution.irradiance.band(0)[e] / truth - 1.0).powi(2);
        count += 1;
    }
    let rms = (squares / f64::from(count)).sqrt();
    assert!(count > 40 && rms < 0.03, "{count} elements differ by {rms}");
}

/// One table of images serves all bands of one mirror, and conjugate gradients take them: each band is that of a grey mirror.
#[test]
fn coloured_images_are_grey_ones_side_by_side() {
    let strategy = Strategy::new(Subdivision::Uniform(2), Method::exact(1e-8, 1e-6));
    let solve = |mirror: &[f64]| {
        let mut scene = MirrorRoom { opening: [[0.3, 1.6], [0.5, 2.0]], ..MirrorRoom::default() }.scene();
        for material in &mut scene.materials {
            material.reflectance = vec![material.reflectance[0]; mirror.len()];
            material.emission = vec![material.emission[0]; mirror.len()];
        }
        scene.materials[2].specular = Some(Specular::Mirror { reflectance: mirror.to_vec() });
        let transport = SpecularTransport { bounces: SpecularBounces::Any, by: SpecularBy::Images };
        let run = run_enhanced(&scene, &strategy, transport, &mut ()).unwrap();
        (run.run.solution.radiosity, run.specular.cost)
    };
    let (coloured, cost) = solve(&[0.9, 0.3, 0.0]);
    for (b, mirror) in [0.9, 0.3, 0.0].into_iter().enumerate() {
        let (grey, own) = solve(&[mirror]);
        let differs = coloured.band(b).iter().zip(grey.band(0)).map(|(a, b)| (a - b).abs() / b.abs().max(0.1));
        assert!(differs.fold(0.0, f64::max) < 1e-7, "band {b}");
        assert_eq!(own, if mirror > 0.0 { cost } else { radiosity_core::Cost::default() });
    }
}

/// Bands do not know of each other: a coloured mirror is a grey one in every band.
#[test]
fn coloured_mirrors_are_grey_ones_side_by_side() {
    let transport = transport(SpecularBounces::AtMost(2), 256);
    let solve = |mirror: &[f64]| {
        run_enhanced(&room(mirror), &strategy(2, 256, Shape::Full), transport, &mut ()).unwrap().run.solution.radiosity
    };
    let coloured = solve(&[0.4, 0.1, 0.4]);
    for (b, mirror) in [0.4, 0.1, 0.4].into_iter().enumerate() {
        let grey = solve(&[mirror]);
        let differs = coloured.band(b).iter().zip(grey.band(0)).map(|(a, b)| (a / b - 1.0).abs());
        assert!(differs.fold(0.0, f64::max) < 1e-8, "band {b}");
    }
}

#[test]
fn scenes_without_specular_surfaces_pay_nothing() {
    let scene = MirrorRoom::default().scene();
    let plain = empty_box([3.0, 2.0, 2.5], material("wall", 0.5, 1.0));
    let strategy = strategy(3, 64, Shape::Full);
    let images = SpecularTransport { by: SpecularBy::Images, ..SpecularTransport::ANY };
    for (scene, transport) in [(&scene, SpecularTransport::NONE), (&plain, SpecularTransport::ANY), (&plain, images)] {
        let found = run_enhanced(scene, &strategy, transport, &mut ()).unwrap();
        let known = run(scene, &strategy, &mut ()).unwrap();
        assert_eq!(found.run.solution.radiosity, known.solution.radiosity);
        assert_eq!((found.run.form_factors.cost, found.specular.cost.rays), (known.form_factors.cost, 0));
        assert_eq!(found.specular.cost, radiosity_core::Cost::default());
        assert!(found.ways[1].values().iter().chain(found.ways[3].values()).all(|h| *h == 0.0));
    }
}

#[test]
fn methods_that_need_symmetry_refuse_mirrors() {
    let scene = MirrorRoom::default().scene();
    let exact = Strategy::new(Subdivision::Uniform(2), Method::ANALYTIC);
    let refused = |strategy: &Strategy| {
        run_enhanced(&scene, strategy, SpecularTransport::ANY, &mut ()).err().expect("refused").to_string()
    };
    assert!(refused(&exact).contains("cg"), "{}", refused(&exact));
    let gathers = Strategy { solver: "gauss-seidel".into(), ..exact };
    assert!(run_enhanced(&scene, &gathers, transport(SpecularBounces::Any, 64), &mut ()).is_ok());
    assert!(refused(&Strategy { shape: Shape::TwoLevel, ..gathers.clone() }).contains("specular"));
    assert!(refused(&Strategy { repair: true, ..gathers }).contains("not repaired"));
}

#[test]
fn images_are_refused_where_there_are_none() {
    let refused = |scene: &Scene, strategy: &Strategy| {
        let transport = SpecularTransport { bounces: SpecularBounces::Any, by: SpecularBy::Images };
        run_enhanced(scene, strategy, transport, &mut ()).err().expect("refused").to_string()
    };
    let exact = Strategy::new(Subdivision::Uniform(2), Method::ANALYTIC);
    let mut scene = MirrorRoom::default().scene();
    // Rows of rays are not symmetric, whatever is added to them.
    let rays = Strategy { method: Method::RAY_CAST, ..exact.clone() };
    assert!(refused(&scene, &rays).contains("cg"), "{}", refused(&scene, &rays));
    // The wall x high faces the mirror.
    scene.surfaces[2].material = 2;
    assert!(refused(&scene, &exact).contains("fewer specular bounces"));
    scene.materials[2].specular = Some(Specular::Dielectric { index: 1.5, tint: vec![1.0], roughness: 0.0 });
    assert!(refused(&scene, &exact).contains("'surface 0' is glass"), "{}", refused(&scene, &exact));
}

/// In every form, images and rays give the same light within the noise of the rays.
#[test]
fn images_and_rays_agree_in_every_form() {
    let scene = MirrorRoom { mirror: 0.8, ..MirrorRoom::default() }.scene();
    for shape in [Shape::Full, Shape::ElementsToPatches, Shape::PatchesToElements] {
        let strategy = Strategy { method: Method::exact(1e-6, 1e-4), ..strategy(4, 1, shape) };
        let solve = |by| {
            let transport = SpecularTransport { bounces: SpecularBounces::Any, by };
            run_enhanced(&scene, &strategy, transport, &mut ()).unwrap().run.solution.irradiance
        };
        let (images, rays) = (solve(SpecularBy::Images), solve(SpecularBy::Rays(1 << 14)));
        let squares = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
        let differ = squares(&mut images.values().iter().zip(rays.values()).map(|(a, b)| a - b))
            / squares(&mut images.values().iter().copied());
        assert!(differ < 0.02, "{shape:?}: {differ}");
    }
}

/// Sums are taken in one order.
#[test]
fn the_same_in_any_number_of_threads() {
    let scene = MirrorRoom::default().scene();
    let solve = |by: SpecularBy, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let strategy = strategy(3, 128, Shape::Full);
            run_enhanced(&scene, &strategy, SpecularTransport { by, ..SpecularTransport::ANY }, &mut ())
                .unwrap()
                .run
                .solution
                .radiosity
        })
    };
    for by in [SpecularBy::Rays(128), SpecularBy::Images] {
        let one = solve(by, 1);
        assert!([2, 8].into_iter().all(|threads| solve(by, threads) == one), "{by:?}");
    }
}
