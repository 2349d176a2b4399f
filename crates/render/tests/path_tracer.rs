//! The reference against scenes with closed forms; every assertion is in standard errors of its own.

use glam::DVec3;
use radiosity_gallery::boxes::{empty_box, material, scene_of_loops};
use radiosity_gallery::mirror::opened;
use radiosity_gallery::{FloorUnderLight, Hinge, MirrorRoom, sphere};
use radiosity_geometry::{Material, Occluders, Scene, Specular};
use radiosity_render::film::Film;
use radiosity_render::numbers::Numbers;
use radiosity_render::{Camera, PathClass, PathClasses, PathTracer, Stage};

/// Mean and standard error of `rounds` rounds of a sample of one number.
fn mean(rounds: u64, sample: impl Fn(&mut Numbers, &mut [f64])) -> (f64, f64) {
    let means: Vec<f64> = (0..rounds)
        .map(|round| {
            let mut value = [0.0];
            (0..16).for_each(|k| sample(&mut Numbers::of_pixel(1, 0, 16 * round + k), &mut value));
            value[0] / 16.0
        })
        .collect();
    let n = rounds as f64;
    let mean = means.iter().sum::<f64>() / n;
    (mean, (means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))).sqrt())
}

/// Irradiance at a point of a scene by paths of some classes.
fn irradiance(scene: &Scene, classes: PathClasses, rounds: u64, point: DVec3, normal: DVec3) -> (f64, f64) {
    let occluders = Occluders::of_scene(scene);
    let stage = Stage::new(scene, &occluders);
    let tracer = PathTracer::new(&stage, classes);
    mean(rounds, |numbers, value| {
        tracer.irradiance(point, normal, numbers, value);
    })
}

fn assert_near((value, error): (f64, f64), truth: f64, what: &str) {
    assert!((value - truth).abs() <= 4.0 * error + 1e-12 * truth, "{what}: {value} ± {error}, not {truth}");
}

#[test]
fn the_irradiance_under_a_light_is_that_of_the_closed_form() {
    let case = FloorUnderLight::default();
    for [u, v] in [[0.4, 0.5], [0.9, 0.1]] {
        let point = DVec3::new(u * case.floor[0], v * case.floor[1], 0.0);
        let found = irradiance(&case.scene(), PathClasses::ALL, 400, point, DVec3::Z);
        assert!(found.1 < 0.01 * found.0);
        assert_near(found, case.irradiance(u, v), "floor");
    }
    // A light that touches: most of it is found by directions, not by points.
    let hinge = Hinge { angle: 1.0, emission: 2.0, reflectance: 0.5 };
    let found = irradiance(&hinge.scene(), PathClasses::ALL, 400, DVec3::new(0.02, 0.5, 0.0), DVec3::Z);
    assert!(found.1 < 0.01 * found.0);
    assert_near(found, hinge.irradiance(0.02, 0.5), "hinge");
}

/// In a furnace the radiance is E/(π(1 − ρ)) along every ray, whatever part of ρ is specular: ρ counts as a whole.
#[test]
fn furnaces_of_diffuse_mirroring_and_shining_walls_are_one_colour() {
    let specular = [
        None,
        Some((Specular::Mirror { reflectance: vec![0.4] }, 0.3)),
        Some((Specular::Mirror { reflectance: vec![0.7] }, 0.0)),
    ];
    for specular in specular {
        let (part, diffuse) = specular.map_or((None, 0.7), |(part, diffuse)| (Some(part), diffuse));
        let wall = Material { specular: part, ..material("wall", diffuse, 3.0) };
        let scene = empty_box([3.0, 2.0, 2.5], wall);
        let occluders = Occluders::of_scene(&scene);
        let stage = Stage::new(&scene, &occluders);
        let tracer = PathTracer::new(&stage, PathClasses::ALL);
        let (eye, direction) = (DVec3::new(1.1, 0.9, 1.4), DVec3::new(0.3, -0.5, 0.8).normalize());
        let found = mean(600, |numbers, value| {
            tracer.radiance(eye, direction, numbers, value);
        });
        assert!(found.1 < 0.02 * found.0);
        assert_near(found, 10.0 / std::f64::consts::PI, "furnace");
    }
}

/// A ball of clear glass in a white furnace cannot be seen: what it reflects and refracts is as bright as what it hides.
#[test]
fn glass_in_a_furnace_is_invisible() {
    let mut scene = empty_box([3.0, 2.0, 2.5], material("wall", 0.5, 3.0));
    for roughness in [0.0, 0.1] {
        let glass = Specular::Dielectric { index: 1.5, tint: vec![1.0], roughness };
        scene.materials.push(Material { specular: Some(glass), ..material("glass", 0.0, 0.0) });
        let last = scene.materials.len() - 1;
        let ball = Scene {
            surfaces: scene
                .surfaces
                .iter()
                .take(6)
                .cloned()
                .chain(sphere(DVec3::new(1.5, 1.0, 1.2), 0.6, 8, last))
                .collect(),
            materials: scene.materials.clone(),
        };
        let occluders = Occluders::of_scene(&ball);
        let stage = Stage::new(&ball, &occluders);
        let tracer = PathTracer::new(&stage, PathClasses::ALL);
        let (eye, direction) = (DVec3::new(0.1, 0.9, 1.4), DVec3::new(1.0, 0.05, -0.1).normalize());
        let found = mean(300, |numbers, value| {
            tracer.radiance(eye, direction, numbers, value);
        });
        let truth = 6.0 / std::f64::consts::PI;
        if roughness == 0.0 {
            assert_near(found, truth, "smooth glass");
        } else {
            // Light scattered twice between facets is lost.
            assert!(found.0 < truth + 4.0 * found.1 && found.0 > 0.9 * truth, "{found:?}");
        }
    }
}

/// A mirror shows what a hole into its image shows: irradiance of the floor, over all paths and by way of the mirror alone.
#[test]
fn a_mirror_is_a_hole_into_a_mirrored_room() {
    let room = MirrorRoom { opening: [[0.3, 1.6], [0.5, 2.0]], ..MirrorRoom::default() };
    let scene = room.scene();
    let hole = opened(&scene, MirrorRoom::MIRROR);
    for point in [DVec3::new(0.4, 0.7, 0.0), DVec3::new(2.3, 1.5, 0.0)] {
        let here = irradiance(&scene, PathClasses::ALL, 8000, point, DVec3::Z);
        let there = irradiance(&hole, PathClasses::ALL, 8000, point, DVec3::Z);
        assert!(here.1 < 0.02 * here.0);
        assert_near((here.0, here.1.hypot(there.1)), there.0, "mirror");
    }
}

/// Irradiance of a floor by a lamp it only sees in a mirror: L from behind the mirror, exact as a light at its image.
#[test]
fn light_from_a_mirror_is_light_from_an_image() {
    let floor = vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y];
    // The mirror at y = 1.1 faces −y; the lamp faces it.
    let mirror = vec![
        DVec3::new(-3.0, 1.1, 0.0),
        DVec3::new(3.0, 1.1, 0.0),
        DVec3::new(3.0, 1.1, 4.0),
        DVec3::new(-3.0, 1.1, 4.0),
    ];
    let lamp = vec![
        DVec3::new(0.2, -0.5, 1.0),
        DVec3::new(0.2, -0.5, 1.5),
        DVec3::new(0.8, -0.5, 1.5),
        DVec3::new(0.8, -0.5, 1.0),
    ];
    let shine =
        Material { specular: Some(Specular::Mirror { reflectance: vec![0.8] }), ..material("mirror", 0.0, 0.0) };
    let image: Vec<DVec3> = lamp.iter().rev().map(|v| DVec3::new(v.x, 2.2 - v.y, v.z)).collect();
    let materials = || vec![material("floor", 0.0, 0.0), material("lamp", 0.0, 5.0), shine.clone()];
    let scene = scene_of_loops(&[(floor.clone(), 0), (lamp, 1), (mirror, 2)], materials());
    let straight = scene_of_loops(&[(floor, 0), (image, 1)], materials());
    let point = DVec3::new(0.5, 0.6, 0.0);
    let caustic = PathClasses::NONE.with(PathClass::named("LSDE").unwrap());
    let found = irradiance(&scene, caustic, 30000, point, DVec3::Z);
    let (truth, error) = irradiance(&straight, PathClasses::ALL, 400, point, DVec3::Z);
    assert!(found.1 < 0.03 * found.0, "{found:?}");
    assert_near((found.0, found.1.hypot(0.8 * error)), 0.8 * truth, "image");
}

/// Pictures of single classes, with the same numbers, add up to the picture of all.
#[test]
fn classes_add_up_to_the_whole() {
    let mut scene = MirrorRoom { mirror: 0.9, ..MirrorRoom::default() }.scene();
    let glossy = Specular::Phong { reflectance: vec![0.3], exponent: 20.0 };
    scene.materials.push(Material { specular: Some(glossy), ..material("floor", 0.4, 0.0) });
    scene.surfaces[5].material = 3;
    let occluders = Occluders::of_scene(&scene);
    let stage = Stage::new(&scene, &occluders);
    let camera = Camera::new(DVec3::new(2.8, 0.3, 1.2), DVec3::new(0.3, 1.0, 1.2), DVec3::Z, 95.0, 24, 16).unwrap();
    let picture = |classes| {
        let mut film = Film::new(24, 16, 1);
        (0..2).for_each(|_| PathTracer::new(&stage, classes).expose(&camera, 5, &mut film));
        film.means()
    };
    let whole = picture(PathClasses::ALL);
    let mut sum = vec![0.0; whole.len()];
    let mut seen = 0;
    for class in PathClass::ALL {
        let part = picture(PathClasses::NONE.with(class));
        seen += usize::from(part.iter().any(|v| *v > 0.0));
        sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
    }
    let level = whole.iter().sum::<f64>() / whole.len() as f64;
    assert!(whole.iter().zip(&sum).all(|(w, s)| (w - s).abs() < 1e-12 * level.max(*w)));
    assert_eq!(seen, PathClass::ALL.len(), "every class is in the picture");
}
