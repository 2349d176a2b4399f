//! Paths over stored light against a room in which every class of paths is known.

use std::f64::consts::PI;

use glam::DVec3;
use radiosity_core::BandValues;
use radiosity_gallery::boxes::{empty_box, material};
use radiosity_geometry::{Material, Occluders, Scene, Specular};
use radiosity_render::two_pass::TwoPassError;
use radiosity_render::{
    Camera, FacetIrradiance, Film, PathClass, PathClasses, PathTracer, Stage, Stored, TwoPass, TwoPassSettings,
};

/// A closed room of E = 3, diffuse ρ = 0.3 and an ideal mirror of 0.4 everywhere: the radiance is 10/π along every ray. Light arrives from
/// emitters with H = E, by way of mirrors with E (0.4 + 0.4² + …) = ⅔ E, and from diffuse reflection with ρH = 3 and ⅔ of that: H = 10.
fn room() -> Scene {
    let mirror = Specular::Mirror { reflectance: vec![0.4] };
    empty_box([3.0, 2.0, 2.5], Material { specular: Some(mirror), ..material("wall", 0.3, 3.0) })
}

/// H in the four ways.
const WAYS: [f64; 4] = [3.0, 2.0, 3.0, 2.0];

/// πL of a class: what the eye sees without S, and ⅔ of that by way of mirrors.
fn expected(class: PathClass) -> f64 {
    let seen = match class.index() / 2 {
        0 => 3.0,
        way => 0.3 * WAYS[way - 1],
    };
    if class.specular_eye { seen * 2.0 / 3.0 } else { seen }
}

fn camera() -> Camera {
    Camera::new(DVec3::new(1.1, 0.9, 1.4), DVec3::new(2.0, 0.1, 2.0), DVec3::Z, 80.0, 12, 8).unwrap()
}

/// Mean of π times a picture, and its standard error.
fn level(film: &Film) -> (f64, f64) {
    let n = film.means().len() as f64;
    let error = film.standard_errors().iter().map(|e| e * e).sum::<f64>().sqrt() / n;
    (PI * film.means().iter().sum::<f64>() / n, PI * error)
}

fn fields(values: &[f64]) -> Vec<BandValues> {
    values.iter().map(|h| BandValues::new(vec![*h; 6], 6)).collect()
}

const SETTINGS: [TwoPassSettings; 3] = [
    TwoPassSettings { light_points: 0, gather: 0 },
    TwoPassSettings { light_points: 2, gather: 0 },
    TwoPassSettings { light_points: 1, gather: 4 },
];

#[test]
fn every_class_alone_is_what_it_should_be_by_either_method() {
    let scene = room();
    let occluders = Occluders::of_scene(&scene);
    let stage = Stage::new(&scene, &occluders);
    let values = fields(&WAYS);
    let stored: Vec<FacetIrradiance<'_>> = values.iter().map(FacetIrradiance).collect();
    let apart = Stored::Apart([&stored[0], &stored[1], &stored[2], &stored[3]]);
    for class in PathClass::ALL {
        let classes = PathClasses::NONE.with(class);
        let truth = expected(class);
        let near = |film: &Film, what: &str| {
            let (value, error) = level(film);
            assert!(error < 0.05 * truth, "{class} {what}: {value} ± {error}");
            assert!((value - truth).abs() <= 4.0 * error + 1e-9, "{class} {what}: {value} ± {error}, not {truth}");
        };
        let mut film = Film::new(12, 8, 1);
        (0..20).for_each(|_| PathTracer::new(&stage, classes).expose(&camera(), 3, &mut film));
        near(&film, "path tracer");
        for settings in SETTINGS {
            let mut film = Film::new(12, 8, 1);
            let pass = TwoPass::new(&stage, apart, settings, classes).unwrap();
            (0..20).for_each(|_| pass.expose(&camera(), 3, &mut film));
            near(&film, &format!("{settings:?}"));
        }
    }
}

#[test]
fn classes_add_up_to_the_whole() {
    let scene = room();
    let occluders = Occluders::of_scene(&scene);
    let stage = Stage::new(&scene, &occluders);
    let values = fields(&WAYS);
    let stored: Vec<FacetIrradiance<'_>> = values.iter().map(FacetIrradiance).collect();
    let apart = Stored::Apart([&stored[0], &stored[1], &stored[2], &stored[3]]);
    for settings in SETTINGS {
        let picture = |classes| {
            let mut film = Film::new(12, 8, 1);
            TwoPass::new(&stage, apart, settings, classes).unwrap().expose(&camera(), 7, &mut film);
            film.means()
        };
        let whole = picture(PathClasses::ALL);
        let mut sum = vec![0.0; whole.len()];
        for class in PathClass::ALL {
            let part = picture(PathClasses::NONE.with(class));
            sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        }
        assert!(whole.iter().zip(&sum).all(|(w, s)| (w - s).abs() < 1e-12 * w), "{settings:?}");
    }
}

#[test]
fn what_one_sum_cannot_tell_apart_is_refused() {
    let scene = room();
    let occluders = Occluders::of_scene(&scene);
    let stage = Stage::new(&scene, &occluders);
    let values = fields(&[10.0]);
    let field = FacetIrradiance(&values[0]);
    let refused = |settings, classes| TwoPass::new(&stage, Stored::Whole(&field), settings, classes).err();
    let [mesh, lights, gather] = SETTINGS;
    let caustics = PathClasses::ALL.without(PathClass::named("LSDE").unwrap());
    assert_eq!((refused(mesh, PathClasses::ALL), refused(gather, caustics)), (None, None));
    assert_eq!(refused(mesh, caustics), Some(TwoPassError::OneSum));
    assert_eq!(refused(lights, PathClasses::ALL), Some(TwoPassError::OneSum));
    let bare = TwoPassSettings { light_points: 0, gather: 3 };
    assert_eq!(refused(bare, PathClasses::ALL), Some(TwoPassError::NoLightPoints));
}
