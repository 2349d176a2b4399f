//! Light by way of specular surfaces, against rooms in which it is known and against the path tracer.

use radiosity::{Method, Shape, SpecularBy, SpecularTransport, Store, Strategy, run, run_enhanced};
use radiosity_form_factors::extended::SpecularBounces;
use radiosity_gallery::MirrorRoom;
use radiosity_gallery::boxes::{empty_box, material};
use radiosity_gallery::mirror::opened;
use radiosity_geometry::mesh::Subdivision;
use radiosity_geometry::{Material, Occluders, Scene, Specular};
use radiosity_render::numbers::Numbers;
use radiosity_render::{PathClasses, PathTracer, Stage};

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
    for (scene, transport) in [(&scene, SpecularTransport::NONE), (&plain, SpecularTransport::ANY)] {
        let found = run_enhanced(scene, &strategy, transport, &mut ()).unwrap();
        let known = run(scene, &strategy, &mut ()).unwrap();
        assert_eq!(found.run.solution.radiosity, known.solution.radiosity);
        assert_eq!((found.run.form_factors.cost, found.specular.cost.rays), (known.form_factors.cost, 0));
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
    assert!(refused(&Strategy { shape: Shape::TwoLevel, ..gathers }).contains("specular"));
}

/// Sums are taken in one order.
#[test]
fn the_same_in_one_thread_and_in_three() {
    let scene = MirrorRoom::default().scene();
    let solve = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let strategy = strategy(3, 128, Shape::Full);
            run_enhanced(&scene, &strategy, transport(SpecularBounces::Any, 128), &mut ())
                .unwrap()
                .run
                .solution
                .radiosity
        })
    };
    assert_eq!(solve(1), solve(3));
}
