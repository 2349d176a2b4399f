//! Radiances into directions, against rooms in which they are known, against diffuse radiosity of the same rays, and against the path tracer.

use glam::DVec3;
use radiosity::specular_radiosity::{SpecularRadiosityError, SpecularSize};
use radiosity::{Geometry, Method, SpecularRadiosity, SpecularSolution, Strategy, run, run_specular_radiosity};
use radiosity_core::Outcome;
use radiosity_gallery::MirrorRoom;
use radiosity_gallery::boxes::{empty_box, material};
use radiosity_gallery::mirror::opened;
use radiosity_geometry::mesh::{MeshSettings, Subdivision};
use radiosity_geometry::{Material, Occluders, Scene, Specular};
use radiosity_render::numbers::Numbers;
use radiosity_render::{PathClasses, PathTracer, Stage};

fn meshed(scene: &Scene, k: u32) -> Geometry<'_> {
    let elements = Subdivision::Uniform(k);
    Geometry::new(scene, &MeshSettings { elements, patches: None, contacts: true }).unwrap()
}

fn settings(edge: u32, rays: u32) -> SpecularRadiosity {
    SpecularRadiosity { unshot: 1e-12, ..SpecularRadiosity::new(edge, rays) }
}

fn solve<'g, 's>(geometry: &'g Geometry<'s>, settings: &SpecularRadiosity) -> SpecularSolution<'g, 's> {
    let solution = run_specular_radiosity(geometry, settings).unwrap();
    assert_eq!(solution.outcome, Outcome::Converged);
    solution
}

/// `scene` with `specular` added to the material of surface `surface`, whose diffuse reflectance becomes `reflectance`.
fn with_specular(mut scene: Scene, surface: usize, reflectance: f64, specular: Specular) -> Scene {
    scene.surfaces[surface].material = scene.materials.len();
    scene.materials.push(Material { specular: Some(specular), ..material("shining", reflectance, 0.0) });
    scene
}

/// Solved directly by elimination on the form factors that the same rays found: B = E + ρFB; η = 10⁻¹² over 1 − ρ = ½.
#[test]
fn without_specular_surfaces_it_is_the_diffuse_radiosity_of_its_rays() {
    let scene = MirrorRoom { mirror: 0.0, ..MirrorRoom::default() }.scene();
    let scene = Scene {
        materials: scene.materials.iter().map(|m| Material { specular: None, ..m.clone() }).collect(),
        ..scene
    };
    let geometry = meshed(&scene, 2);
    let found = solve(&geometry, &settings(6, 2));
    let m = geometry.elements().len();
    assert_eq!(
        found.size,
        SpecularSize {
            elements: m as u64,
            specular: 0,
            directions: 36,
            unknowns: m as u64,
            rays: 144 * m as u64,
            ..found.size
        }
    );
    assert_eq!((found.cost().rays, found.cost().form_factors), (144 * m as u64, 36 * m as u64));
    // Gauss–Seidel in place, row by row, until nothing changes.
    let (emission, reflectance) = (geometry.emission(), geometry.reflectance());
    let rows: Vec<Vec<f64>> = (0..m).map(|e| found.form_factors_from(e)).collect();
    let mut b = vec![0.0; m];
    for _ in 0..200 {
        for e in 0..m {
            let h: f64 = rows[e].iter().zip(&b).map(|(f, b)| f * b).sum();
            b[e] = emission.band(0)[e] + reflectance.band(0)[e] * h;
        }
    }
    for (e, b) in b.iter().enumerate() {
        assert!((found.radiosity.band(0)[e] - b).abs() < 1e-10, "element {e}: {}, {b}", found.radiosity.band(0)[e]);
        // The same into every direction.
        assert!((found.radiance(e, DVec3::Z)[0] * std::f64::consts::PI - b).abs() < 1e-10);
    }
}

/// Closed rooms of E = 3, ρ = 0.3 and mirrors of ρ_s: B of the diffuse part is E + ρH with H = E/(1 − ρ − ρ_s) everywhere, since every ray ends on a wall and all weights sum to π.
#[test]
fn furnaces_of_mirrors_are_exact_at_any_number_of_bins() {
    let mirror = vec![0.4, 0.0, 0.6];
    let specular = Some(Specular::Mirror { reflectance: mirror.clone() });
    let scene =
        empty_box([3.0, 2.0, 2.5], Material { specular, ..Material::diffuse("wall", vec![0.3; 3], vec![3.0; 3]) });
    let geometry = meshed(&scene, 2);
    for (edge, rays) in [(1, 5), (3, 1), (8, 2)] {
        let found = solve(&geometry, &settings(edge, rays));
        for (b, mirror) in mirror.iter().enumerate() {
            let h = 3.0 / (1.0 - 0.3 - mirror);
            let worst = found.irradiance.band(b).iter().map(|found| (found / h - 1.0).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-10, "{edge}, band {b}: {worst}");
        }
        assert!(found.bound.unwrap() < 1e-10);
    }
}

/// In a furnace of glossy walls light is no longer the same into all directions, but none may be lost: what the room emits is what its walls take, Σ A E = Σ A [(1 − ρ) H −
/// specular part that leaves]. Elements gather by rays of their own, which carry what others send with the noise of columns: 2 % with 1,024 rays.
#[test]
fn a_glossy_furnace_keeps_its_power() {
    let specular = Some(Specular::Phong { reflectance: vec![0.6], exponent: 20.0 });
    let scene = empty_box([3.0, 2.0, 2.5], Material { specular, ..material("wall", 0.3, 3.0) });
    let geometry = meshed(&scene, 2);
    let found = solve(&geometry, &settings(8, 4));
    let bins = found.bins();
    let (mut emitted, mut net) = (0.0, 0.0);
    for e in 0..geometry.elements().len() {
        let area = geometry.elements().area(e);
        let polygon = &geometry.elements().polygons(e)[0];
        let (x, y) = polygon.frame();
        let leaving: f64 = (0..bins.count())
            .map(|k| {
                let d = bins.centre(k);
                found.radiance(e, x * d.x + y * d.y + polygon.normal() * d.z)[0] * bins.projected(k)
            })
            .sum();
        emitted += 3.0 * area;
        net += area * (leaving - found.irradiance.band(0)[e]);
        // Power in, power out of one element: E + (ρ + a) H with a between the albedo at the horizon and at the normal.
        let a = (leaving - 3.0) / found.irradiance.band(0)[e] - 0.3;
        assert!((0.3..0.6).contains(&a), "element {e} gives back {a}");
    }
    // All that leaves arrives.
    assert!(net.abs() < 0.02 * emitted, "{net} of {emitted}");
}

/// Irradiance of the floor (surface 5) in the room of which the mirror is a hole in `there` (surface 4), exact pairs: rms over elements.
fn floor_error(found: &SpecularSolution<'_, '_>, truth: &[f64]) -> f64 {
    let on = found.geometry().surfaces().into_iter().enumerate().filter(|(_, s)| *s == 5);
    let floor: Vec<f64> = on.map(|(e, _)| found.irradiance.band(0)[e]).collect();
    assert_eq!(floor.len(), truth.len());
    let sum: f64 = floor.iter().zip(truth).map(|(a, b)| (a - b).powi(2)).sum();
    (sum / truth.iter().map(|b| b * b).sum::<f64>()).sqrt()
}

/// As bins and elements get finer the mirror becomes the hole; rays are as many at every K, so that bins are what differs;
/// those of a small lamp, of which 9,216 meet two hundred, leave about 2 %.
#[test]
fn a_mirror_becomes_a_hole_into_a_mirrored_room_as_bins_get_finer() {
    let scene = MirrorRoom { block: false, opening: [[0.3, 1.6], [0.5, 2.0]], ..MirrorRoom::default() }.scene();
    let hole = opened(&scene, MirrorRoom::MIRROR);
    let there = run(&hole, &Strategy::new(Subdivision::Uniform(6), Method::ANALYTIC), &mut ()).unwrap();
    let on = there.geometry.surfaces().into_iter().enumerate().filter(|(_, s)| *s == 4);
    let truth: Vec<f64> = on.map(|(e, _)| there.solution.irradiance.band(0)[e]).collect();
    let geometry = meshed(&scene, 6);
    let settings = |edge: u32| SpecularRadiosity { unshot: 1e-6, ..SpecularRadiosity::new(edge, 96 / edge) };
    let error = |edge: u32| floor_error(&solve(&geometry, &settings(edge)), &truth);
    let errors = [2, 6, 24].map(error);
    assert!(errors[1] < errors[0] && errors[2] < 0.5 * errors[0] && errors[2] < 0.035, "{errors:?}");
}

/// Irradiance by the path tracer in a room with a mirror and a glossy floor; every fifth element of walls and ceiling.
#[test]
fn the_path_tracer_agrees() {
    let room = MirrorRoom { mirror: 0.8, block: false, ..MirrorRoom::default() }.scene();
    let scene = with_specular(room, 5, 0.3, Specular::Phong { reflectance: vec![0.4], exponent: 10.0 });
    let geometry = meshed(&scene, 6);
    let found = solve(&geometry, &SpecularRadiosity { unshot: 1e-6, ..SpecularRadiosity::new(24, 3) });
    let occluders = Occluders::of_scene(&scene);
    let stage = Stage::new(&scene, &occluders);
    let tracer = PathTracer::new(&stage, PathClasses::ALL);
    let surfaces = geometry.surfaces();
    let (mut squares, mut count) = (0.0, 0);
    for e in (0..geometry.elements().len()).step_by(5).filter(|&e| [2, 3, 4, 6].contains(&surfaces[e])) {
        let polygon = &geometry.elements().polygons(e)[0];
        let mut value = [0.0];
        const PATHS: u64 = 8192;
        for k in 0..PATHS {
            let mut numbers = Numbers::of_pixel(5, e as u64, k);
            let u = numbers.draw();
            tracer.irradiance(polygon.sample(u[0], u[1]), polygon.normal(), &mut numbers, &mut value);
        }
        squares += (found.irradiance.band(0)[e] / (value[0] / PATHS as f64) - 1.0).powi(2);
        count += 1;
    }
    let rms = (squares / f64::from(count)).sqrt();
    assert!(count > 20 && rms < 0.04, "{count} elements differ by {rms}");
}

/// Through the mirror a bin shows what lies behind the hole: the lamp of the image is as bright as the lamp, 10/π in every direction in which a whole bin sees it.
#[test]
fn a_picture_looks_up_what_the_mirror_shows() {
    let scene = MirrorRoom { block: false, ..MirrorRoom::default() }.scene();
    let geometry = meshed(&scene, 8);
    let found = solve(&geometry, &SpecularRadiosity { unshot: 1e-6, ..SpecularRadiosity::new(64, 1) });
    // From the point (2.9, 1, 1.2) towards the image of the lamp at (−1.55, 1.05, 2.4).
    let eye = DVec3::new(2.9, 1.0, 1.2);
    let direction = (DVec3::new(-1.55, 1.05, 2.4) - eye).normalize();
    let occluders = geometry.element_occluders();
    let hit = occluders.first_hit(eye, direction).unwrap();
    assert_eq!(geometry.surfaces()[hit.owner as usize], MirrorRoom::MIRROR as u32);
    let seen = found.radiance(hit.owner as usize, -direction)[0];
    let lamp = 10.0 / std::f64::consts::PI;
    // The lamp is seen at a grazing angle: neighbouring bins hold a part of it.
    assert!(seen > 0.2 * lamp && seen < 1.05 * lamp, "{seen} of {lamp}");
}

#[test]
fn too_much_memory_glass_and_no_rays_are_refused_before_any_ray_is_cast() {
    let scene = MirrorRoom::default().scene();
    let geometry = meshed(&scene, 4);
    let refused = |settings: &SpecularRadiosity| run_specular_radiosity(&geometry, settings).err().expect("refused");
    let asked = SpecularRadiosity { memory: Some(1 << 30), ..SpecularRadiosity::new(1024, 2) };
    let needed = SpecularSize::of(&geometry, &asked).bytes;
    let SpecularRadiosityError::Memory { elements, directions, limit, .. } = refused(&asked) else { panic!("memory") };
    assert_eq!((elements, directions, limit), (geometry.elements().len() as u64, 1 << 20, 1 << 30));
    // What rays see, at least: four bytes each.
    assert!(needed > 16 * elements * directions);
    assert!(refused(&asked).to_string().contains("elements × 1048576 directions"), "{}", refused(&asked));
    assert!(matches!(refused(&SpecularRadiosity::new(64, 0)), SpecularRadiosityError::Rays { rays: 0, most: 64, .. }));
    let glass = Specular::Dielectric { index: 1.5, tint: vec![1.0], roughness: 0.0 };
    let scene = with_specular(scene, 5, 0.0, glass);
    let geometry = meshed(&scene, 2);
    let refused = run_specular_radiosity(&geometry, &SpecularRadiosity::new(4, 1)).err().expect("refused");
    assert_eq!(refused, SpecularRadiosityError::Transparent { material: "shining".to_owned() });
}

/// What is predicted is what is held, but for what scattering leaves out; mirrors take next to nothing.
#[test]
fn memory_is_predicted() {
    let scene =
        with_specular(MirrorRoom::default().scene(), 5, 0.2, Specular::Phong { reflectance: vec![0.4], exponent: 3.0 });
    let geometry = meshed(&scene, 3);
    let asked = settings(16, 2);
    let found = solve(&geometry, &asked);
    let predicted = SpecularSize::of(&geometry, &asked).bytes;
    assert!(found.held_bytes <= predicted && 2 * found.held_bytes > predicted, "{}, {predicted}", found.held_bytes);
}

/// Sums are taken in one order.
#[test]
fn the_same_in_one_thread_and_in_three() {
    let scene = with_specular(MirrorRoom::default().scene(), 5, 0.2, Specular::conductor(&[0.7], 0.4));
    let geometry = meshed(&scene, 2);
    let solve = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let found = solve(&geometry, &settings(5, 2));
            let towards = DVec3::new(0.3, 0.4, 0.8).normalize();
            let radiance: Vec<f64> = (0..geometry.elements().len()).map(|e| found.radiance(e, towards)[0]).collect();
            (found.irradiance, radiance, found.steps)
        })
    };
    assert_eq!(solve(1), solve(3));
}
