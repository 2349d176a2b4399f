//! Form factors of whole rectangles through the facade, against values of 20 digits.

use std::f64::consts::PI;

use glam::DVec3;
use radiosity::{Method, cell_form_factors};
use radiosity_form_factors::stores::DenseFormFactors;
use radiosity_gallery::boxes::{
    hinged_rectangles, material, parallel_rectangles, perpendicular_rectangles, scene_of_loops,
};
use radiosity_geometry::{Facets, Material, Occluders, Scene};

fn grey() -> Material {
    material("grey", 0.5, 1.0)
}

/// Every surface a row, as the program makes them.
fn form_factors(scene: &Scene, method: Method, seed: u64) -> (DenseFormFactors, Vec<f64>) {
    let (mut cells, cell): (Facets, Vec<u32>) = (Facets::new(), (0..scene.surfaces.len() as u32).collect());
    for surface in &scene.surfaces {
        assert_eq!(surface.pieces.len(), 1);
        cells.push(surface.pieces.clone(), false);
    }
    let blockers = Occluders::blocking(scene);
    let (store, _) = cell_form_factors(&cells, &cells, &cell, &blockers, method, seed).unwrap();
    (store, cells.areas())
}

/// F_12 of unblocked pairs in arithmetic of 30 digits by two routes; 1e-9 is asked, the estimator is set to 1e-10.
#[test]
fn rectangles_that_nothing_hides_match_their_closed_forms() {
    let cases = [
        ("opposed 1, 1, 1", parallel_rectangles(1.0, 1.0, 1.0, grey()), 0.199_824_895_698_387_38),
        ("opposed 1, 1, 0.01", parallel_rectangles(1.0, 1.0, 0.01, grey()), 0.980_416_602_925_973_2),
        ("opposed 1, 1, 100", parallel_rectangles(1.0, 1.0, 100.0, grey()), 3.182_886_673_282_92e-5),
        ("perpendicular 1, 1, 1", perpendicular_rectangles(1.0, 1.0, 1.0, grey()), 0.200_043_776_075_403_16),
        ("perpendicular 2, 3, 4", perpendicular_rectangles(2.0, 3.0, 4.0, grey()), 0.274_884_972_027_518_44),
        ("hinged 30°", hinged_rectangles(1.0, 1.0, 1.0, PI / 6.0, grey()), 0.619_028_323_090_803_2),
        ("hinged 120°", hinged_rectangles(1.0, 1.0, 1.0, 2.0 * PI / 3.0, grey()), 0.086_615_001_118_276_06),
    ];
    for (name, scene, truth) in cases {
        let (store, areas) = form_factors(&scene, Method::ANALYTIC, 1);
        let (there, back) = (store.entry(0, 1) / areas[0], store.entry(1, 0) / areas[0]);
        assert!((there - truth).abs() < 1e-9, "{name}: {there}");
        assert_eq!(there, back, "{name}: one number for both directions");
        assert_eq!(store.entry(0, 0), 0.0, "{name}: a flat face sees nothing of itself");
    }
}

/// 2¹⁶ rays of a scrambled net err by 1e-3 at worst. A hemicube's centre stands for its face, so the faces are 20 widths
/// apart; 512 pixels leave some 1 / √(pixels that show the target) of it: 256 / 20 across, 13² of them.
#[test]
fn row_wise_estimators_meet_the_same_values_to_their_own_accuracy() {
    let corner = perpendicular_rectangles(1.0, 1.0, 1.0, grey());
    let (store, _) = form_factors(&corner, Method::rays(1 << 16), 1);
    assert!((store.entry(0, 1) - 0.200_043_776_075_403_16).abs() < 1e-3);
    let apart = parallel_rectangles(1.0, 1.0, 20.0, grey());
    let (truth, _) = form_factors(&apart, Method::ANALYTIC, 1);
    let (store, _) = form_factors(&apart, Method::Hemicube { resolution: 512 }, 1);
    let error = store.entry(0, 1) / truth.entry(0, 1) - 1.0;
    assert!(error.abs() < 1.0 / 13.0, "{error:e}");
}

/// Two unit squares `d` apart around z with an opaque rectangle at z = t·d between them; F from 0 to 1 without and with it.
struct Blocked {
    name: &'static str,
    d: f64,
    blocker: [f64; 4],
    t: f64,
    clear: f64,
    blocked: f64,
}

const BLOCKED: [Blocked; 4] = [
    Blocked {
        name: "centred half",
        d: 1.0,
        blocker: [-0.25, 0.25, -0.25, 0.25],
        t: 0.5,
        clear: 0.199_824_895_698_387_4,
        blocked: 0.099_506_294_598_984_79,
    },
    Blocked {
        name: "off centre",
        d: 1.0,
        blocker: [0.1, 0.6, -0.2, 0.35],
        t: 0.3,
        clear: 0.199_824_895_698_387_4,
        blocked: 0.148_601_074_323_251_7,
    },
    Blocked {
        name: "far",
        d: 50.0,
        blocker: [-0.25, 0.25, -0.25, 0.25],
        t: 0.5,
        clear: 0.000_127_290_012_958_529_3,
        blocked: 5.569_415_281_217_112e-5,
    },
    Blocked {
        name: "half block",
        d: 1.0,
        blocker: [0.0, 2.0, -2.0, 2.0],
        t: 0.5,
        clear: 0.199_824_895_698_387_4,
        blocked: 0.099_912_447_849_193_69,
    },
];

impl Blocked {
    fn scene(&self, with_blocker: bool) -> Scene {
        let rectangle = |[x0, x1, y0, y1]: [f64; 4], z: f64, up: bool| {
            let mut corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)].map(|(x, y)| DVec3::new(x, y, z));
            if !up {
                corners.reverse();
            }
            (corners.to_vec(), 0)
        };
        let unit = [-0.5, 0.5, -0.5, 0.5];
        let mut loops = vec![rectangle(unit, 0.0, true), rectangle(unit, self.d, false)];
        if with_blocker {
            loops.push(rectangle(self.blocker, self.t * self.d, true));
        }
        scene_of_loops(&loops, vec![grey()])
    }

    /// |error| of F at defaults, and the bound stated for its row.
    fn error(&self, seed: u64) -> (f64, f64) {
        let (store, areas) = form_factors(&self.scene(true), Method::ANALYTIC, seed);
        ((store.entry(0, 1) / areas[0] - self.blocked).abs(), store.row_bound(0).unwrap() / areas[0])
    }
}

/// At defaults and with the default seed: within 1e-3, and within the three standard errors that the row states.
#[test]
fn blocked_rectangles_match_their_reference_within_the_error_stated() {
    for case in &BLOCKED {
        let (error, bound) = case.error(1);
        assert!(error < 1e-3 && error <= bound, "{}: {error:e}, stated {bound:e}", case.name);
        let (store, _) = form_factors(&case.scene(false), Method::ANALYTIC, 1);
        assert!((store.entry(0, 1) - case.clear).abs() < 1e-9, "{} without its blocker", case.name);
    }
}

/// A bound of three standard errors may fail once in 370 seeds: of 400 more than 4 beyond it have a chance of 0.5 %, and
/// the seeds are fixed. The standard error comes from 8 replicates and is widened for that.
#[test]
fn stated_standard_errors_cover_the_errors_of_many_seeds() {
    for case in &BLOCKED {
        let errors: Vec<(f64, f64)> = (1..=400).map(|seed| case.error(seed)).collect();
        let beyond = errors.iter().filter(|(error, bound)| error > bound).count();
        let rms = |values: &mut dyn Iterator<Item = f64>| (values.map(|v| v * v).sum::<f64>() / 400.0).sqrt();
        let (found, stated) = (rms(&mut errors.iter().map(|e| e.0)), rms(&mut errors.iter().map(|e| e.1 / 3.0)));
        assert!(beyond <= 4, "{}: {beyond} of 400 beyond three standard errors", case.name);
        assert!(found < stated, "{}: rms error {found:e}, stated {stated:e}", case.name);
        assert!(errors.iter().all(|(error, _)| *error < 1e-3), "{}", case.name);
    }
}

/// Independent rays, σ = √(F(1 − F)/N) = 1.2e-3 at most; four of them.
#[test]
fn rays_meet_the_blocked_rectangles_too() {
    for case in &BLOCKED {
        let (store, _) = form_factors(&case.scene(true), Method::rays(1 << 16), 1);
        let error = (store.entry(0, 1) - case.blocked).abs();
        assert!(error < 4.0 * 1.2e-3, "{}: {error:e}", case.name);
    }
}
