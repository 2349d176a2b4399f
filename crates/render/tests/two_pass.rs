//! Paths over stored light against a room in which every class of paths is known.

use std::f64::consts::PI;

use glam::DVec3;
use radiosity_core::BandValues;
use radiosity_gallery::Hinge;
use radiosity_gallery::boxes::{empty_box, material, scene_of_loops};
use radiosity_geometry::{Facets, Material, Occluders, Polygon, Scene, Specular};
use radiosity_render::two_pass::TwoPassError;
use radiosity_render::{
    Camera, Control, FacetIrradiance, Field, Film, PathClass, PathClasses, PathTracer, Stage, Stored, TwoPass,
    TwoPassSettings,
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
    assert_eq!(refused(mesh, PathClasses::ALL), None);
    assert_eq!(refused(mesh, caustics), Some(TwoPassError::OneSum));
    assert_eq!(refused(lights, PathClasses::ALL), Some(TwoPassError::OneSum));
    assert_eq!(refused(gather, PathClasses::ALL), Some(TwoPassError::OneSum));
    let bare = TwoPassSettings { light_points: 0, gather: 3 };
    assert_eq!(refused(bare, PathClasses::ALL), Some(TwoPassError::NoLightPoints));
}

/// Two squares of ρ = ½ that meet at a right angle, each cut into strips along their common edge. The second sends back B = 1, which the first sees
/// as [`Hinge`] knows; what the second sees of the first is left out.
struct Corner {
    hinge: Hinge,
    scene: Scene,
    facets: Facets,
}

/// Strips of either square.
const STRIPS: u32 = 4;

fn strip(k: u32) -> [f64; 2] {
    [f64::from(k) / f64::from(STRIPS), f64::from(k + 1) / f64::from(STRIPS)]
}

impl Corner {
    fn new() -> Self {
        let rectangle = |wall: bool, [a, b]: [f64; 2]| {
            let at = |u: f64, v: f64| if wall { DVec3::new(0.0, 1.0 - v, u) } else { DVec3::new(u, v, 0.0) };
            vec![at(a, 0.0), at(b, 0.0), at(b, 1.0), at(a, 1.0)]
        };
        let loops = [false, true].map(|wall| (rectangle(wall, [0.0, 1.0]), 0));
        let mut facets = Facets::new();
        for wall in [false, true] {
            (0..STRIPS).for_each(|k| facets.push(vec![Polygon::new(&rectangle(wall, strip(k))).unwrap()], false));
        }
        let hinge = Hinge { angle: PI / 2.0, emission: 1.0, reflectance: 0.5 };
        Self { hinge, scene: scene_of_loops(&loops, vec![material("half", 0.5, 0.0)]), facets }
    }

    fn occluders(&self) -> Occluders {
        let carriers: Vec<u32> = (0..2 * STRIPS).map(|facet| facet / STRIPS).collect();
        Occluders::of_parts(&self.scene, &self.facets, &carriers)
    }

    /// ρ of the strips.
    fn reflectance(&self) -> BandValues {
        BandValues::single(vec![self.hinge.reflectance; 2 * STRIPS as usize])
    }

    /// Irradiance by its ways of arriving: the means of the first square are those of what it sees.
    fn ways(&self) -> [BandValues; 4] {
        let of = |facet: u32, wall: f64, floor: &dyn Fn(u32) -> f64| if facet < STRIPS { floor(facet) } else { wall };
        let field = |wall: f64, floor: &dyn Fn(u32) -> f64| {
            BandValues::single((0..2 * STRIPS).map(|facet| of(facet, wall, floor)).collect())
        };
        let none = || field(0.0, &|_| 0.0);
        let seen = field(0.0, &|k| self.hinge.mean_irradiance(strip(k), [0.0, 1.0]));
        [field(2.0, &|_| 0.0), none(), seen, none()]
    }
}

/// Constants on strips miss ρ r of ρH, by the closed form at the points from which the control looks. Strips at less than
/// half or more than twice the tolerance are told apart.
#[test]
fn directions_are_gathered_where_what_is_stored_is_off() {
    let corner = Corner::new();
    let (occluders, values) = (corner.occluders(), corner.ways());
    let stage = Stage::new(&corner.scene, &occluders);
    let fields = values.each_ref().map(FacetIrradiance);
    let ways = fields.each_ref().map(|field| -> &dyn Field { field });
    let level = 0.5 * (0.5 * values[2].band(0)[..STRIPS as usize].iter().sum::<f64>() / f64::from(STRIPS) + 1.0);
    let missed: Vec<f64> = (0..STRIPS)
        .map(|k| {
            let at = |i: u32, [a, b]: [f64; 2]| a + (b - a) * (f64::from(i) + 0.5) / 3.0;
            let points = (0..9).map(|i| corner.hinge.irradiance(at(i % 3, strip(k)), at(i / 3, [0.0, 1.0])));
            let h: Vec<f64> = points.collect();
            let mean = h.iter().sum::<f64>() / 9.0;
            0.5 * (h.iter().map(|h| (h - mean).powi(2)).sum::<f64>() / 9.0).sqrt() / level
        })
        .collect();
    assert!(missed[0] > 4.0 * missed[3], "{missed:?}");
    let mut told = 0;
    for tolerance in [0.01, 0.02, 0.04, 0.08, 0.16] {
        let control = Control::new(&stage, (&corner.facets, &corner.reflectance()), ways, tolerance, 3);
        assert_eq!(control.cost.rays, u64::from(2 * STRIPS) * 9 * 64);
        for (k, missed) in missed.iter().enumerate().filter(|(_, m)| !(tolerance / 2.0..2.0 * tolerance).contains(*m)) {
            assert_eq!(control.gathers(k as u32), *missed > tolerance, "{tolerance}: strip {k} of {missed}");
            told += 1;
        }
    }
    assert!(told >= 10, "{told}");
}

/// L = ρH/π at points of the first square: by gathering the closed form at the point, as stored that of the strip.
#[test]
fn a_gather_finds_what_strips_cannot_hold_and_leaves_the_rest() {
    let corner = Corner::new();
    let (occluders, values) = (corner.occluders(), corner.ways());
    let stage = Stage::new(&corner.scene, &occluders);
    let fields = values.each_ref().map(FacetIrradiance);
    let ways = fields.each_ref().map(|field| -> &dyn Field { field });
    let control = Control::new(&stage, (&corner.facets, &corner.reflectance()), ways, 0.05, 3);
    assert_eq!((0..STRIPS).map(|k| control.gathers(k)).collect::<Vec<_>>(), [true, false, false, false]);
    let settings = TwoPassSettings { light_points: 1, gather: 2 };
    let pass = TwoPass::new(&stage, Stored::Apart(ways), settings, PathClasses::ALL).unwrap().controlled(&control);
    for (u, gathered) in [(0.04, true), (0.2, true), (0.9, false)] {
        // A telescope: half a millionth of the square to a side.
        let point = DVec3::new(u, 0.4, 0.0);
        let camera = Camera::new(point + DVec3::Z, point, DVec3::Y, 1e-5, 1, 1).unwrap();
        let mut film = Film::new(1, 1, 1);
        (0..64).for_each(|_| pass.expose(&camera, 5, &mut film));
        let h = if gathered { corner.hinge.irradiance(u, 0.4) } else { values[2].band(0)[(u * 4.0) as usize] };
        let (found, error) = level(&film);
        let truth = 0.5 * h;
        assert!(error < 0.01 * truth, "{found} ± {error}");
        assert!((found - truth).abs() <= 8.0 * error + 1e-9, "at {u}: {found} ± {error}, not {truth}");
    }
}

/// A small light is far brighter than the wall on which it is. The grid of looks leaves the mean what it is: the share of a pixel that the light covers, by areas.
#[test]
fn outlines_of_lights_keep_their_means() {
    let square =
        |a: f64, z: f64| vec![DVec3::new(-a, -a, z), DVec3::new(a, -a, z), DVec3::new(a, a, z), DVec3::new(-a, a, z)];
    let scene = scene_of_loops(&[(square(0.3, 0.0), 0)], vec![material("lamp", 0.0, PI)]);
    let occluders = Occluders::of_scene(&scene);
    let stage = Stage::new(&scene, &occluders);
    // Of 3 × 3 pixels of side ⅔ in the plane of the light that in the middle shows 0.6² of (⅔)².
    let camera = Camera::new(DVec3::Z, DVec3::ZERO, DVec3::Y, 90.0, 3, 3).unwrap();
    for classes in [PathClasses::ALL, PathClasses::NONE.with(PathClass::named("LE").unwrap())] {
        let mut film = Film::new(3, 3, 1);
        (0..8).for_each(|_| PathTracer::new(&stage, classes).expose(&camera, 2, &mut film));
        let means = film.means();
        assert!((means[4] - 0.81).abs() < 2e-3, "{}", means[4]);
        assert!(means.iter().enumerate().all(|(k, mean)| k == 4 || *mean == 0.0));
        // A ray of each sample and 16 looks where the edges are: in that pixel alone.
        assert_eq!(film.cost.rays, 128 * (9 + 16));
    }
}
