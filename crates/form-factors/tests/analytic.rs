//! Unoccluded exchange areas against values from independent routes.

// References are given to the digits they were computed to.
#![allow(clippy::excessive_precision)]

use glam::{DMat3, DVec3};
use radiosity_form_factors::analytic::{opposed_rectangles, perpendicular_rectangles, unoccluded};
use radiosity_form_factors::{Estimate, PairwiseRows, Rows, analytic::Analytic};
use radiosity_geometry::{Facets, Polygon};

const TOLERANCE: f64 = 1e-10;

fn polygon(corners: &[[f64; 3]]) -> Polygon {
    Polygon::new(&corners.iter().map(|c| DVec3::from_array(*c)).collect::<Vec<_>>()).unwrap()
}

fn moved(polygon: &Polygon, map: impl Fn(DVec3) -> DVec3) -> Polygon {
    Polygon::new(&polygon.vertices().iter().map(|v| map(*v)).collect::<Vec<_>>()).unwrap()
}

fn reversed(polygon: &Polygon) -> Polygon {
    Polygon::new(&polygon.vertices().iter().rev().copied().collect::<Vec<_>>()).unwrap()
}

/// The unit square on z = 0, facing up.
fn floor() -> Polygon {
    polygon(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
}

/// A rectangle a × b on z = height, facing down.
fn ceiling(a: f64, b: f64, height: f64) -> Polygon {
    polygon(&[[0.0, 0.0, height], [0.0, b, height], [a, b, height], [a, 0.0, height]])
}

/// A square hinged to [`floor`] along the x axis at an angle in degrees.
fn hinged(degrees: f64) -> Polygon {
    let (s, c) = degrees.to_radians().sin_cos();
    polygon(&[[0.0, 0.0, 0.0], [0.0, c, s], [1.0, c, s], [1.0, 0.0, 0.0]])
}

/// Both directions are within `absolute` · min(A) of A_i F_ij = `truth`, within 1e-6 relative, and inside their bound.
fn assert_exchange(i: &Polygon, j: &Polygon, truth: f64, absolute: f64, what: &str) {
    let smaller = i.area().min(j.area());
    for (i, j) in [(i, j), (j, i)] {
        let Estimate { value, bound, .. } = unoccluded(i, j, TOLERANCE);
        let error = (value - truth).abs();
        assert!(
            error <= absolute * smaller,
            "{what}: {value} instead of {truth}, {:e} of the area off",
            error / smaller
        );
        assert!(error <= 1e-6 * truth, "{what}: {value} instead of {truth}, {:e} relative", error / truth);
        assert!(error <= bound, "{what}: error {error:e} above its bound {bound:e}");
    }
}

/// Reference values to 20 digits; the sums of closed forms round to a few 1e-15, the 1e-13 covers area rules, whose
/// bound of 1e-10 they undercut by far.
#[test]
fn reference_pairs_are_exact_to_1e_13() {
    let (floor, side) = (floor(), polygon(&[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 1.0, 0.0]]));
    let side = if side.normal().x > 0.0 { side } else { reversed(&side) };
    assert_exchange(&floor, &ceiling(1.0, 1.0, 1.0), 0.199_824_895_698_387_383_04, 1e-13, "PR-1-1-1");
    assert_exchange(&floor, &ceiling(1.0, 1.0, 0.01), 0.980_416_602_925_973_267_84, 1e-13, "PR-1-1-0.01");
    assert_exchange(&floor, &ceiling(1.0, 1.0, 100.0), 0.000_031_828_866_732_829_196_444, 1e-13, "PR-1-1-100");
    assert_exchange(&floor, &side, 0.200_043_776_075_403_154_24, 1e-13, "PE-1-1-1");
    let large = moved(&floor, |v| v * 3.0);
    let wall = moved(&side, |v| v * 3.0);
    assert_exchange(&large, &wall, 9.0 * 0.200_043_776_075_403_154_24, 1e-13, "LROOM-1-6-open");
    let low = polygon(&[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 4.0, 0.0], [0.0, 4.0, 0.0]]);
    let high = polygon(&[[0.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 4.0, 3.0], [0.0, 0.0, 3.0]]);
    assert_exchange(&low, &high, 8.0 * 0.274_884_972_027_518_436_21, 1e-13, "PE-2-3-4");
    let (a, b, c, d) = ([1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]);
    let (abc, abd) = (polygon(&[a, c, b]), polygon(&[a, b, d]));
    assert_exchange(&abc, &abd, abc.area() / 3.0, 1e-13, "TET");
}

/// 30° and 120° from the reference table; the rest by both contour integrals done numerically (tanh–sinh, 20 digits), a
/// route that agrees with the table to 18 digits.
#[test]
fn hinged_squares_are_exact_from_1_to_179_degrees() {
    let table = [
        (1.0, 0.982_997_178_574_648_776),
        (5.0, 0.920_261_908_111_222_39),
        (30.0, 0.619_028_323_090_803_253_40),
        (60.0, 0.370_905_321_150_051_436),
        (90.0, 0.200_043_776_075_403_154),
        (120.0, 0.086_615_001_118_276_058_831),
        (150.0, 0.021_345_325_412_689_370_4),
        (175.0, 0.000_590_290_917_433_045_284),
        (179.0, 0.000_023_608_783_114_983_361_7),
    ];
    for (degrees, truth) in table {
        assert_exchange(&floor(), &hinged(degrees), truth, 1e-13, &format!("hinge of {degrees} degrees"));
    }
}

/// Closed form in 60 digits: gaps over ten decades, where the textbook formula in doubles is wrong by 100 % at the end.
#[test]
fn opposed_squares_keep_their_digits_at_any_gap() {
    let table = [
        (1e-6, 0.999_998_000_010_029_524_12),
        (1e-4, 0.999_800_070_977_788_487_15),
        (1e4, 3.183_098_840_617_247_816_8e-9),
    ];
    for (gap, truth) in table {
        assert_exchange(&floor(), &ceiling(1.0, 1.0, gap), truth, 1e-13, &format!("gap of {gap}"));
    }
}

/// Closed forms in 60 digits for side ratios of 1e3 and 1e5. The corners of long edges round to 1e-16 · 1000², per
/// area of 1000.
#[test]
fn narrow_rectangles_are_exact() {
    let strip = |a, b| polygon(&[[0.0, 0.0, 0.0], [a, 0.0, 0.0], [a, b, 0.0], [0.0, b, 0.0]]);
    let truth = 1000.0 * 0.617_809_647_393_752_792_73;
    assert_exchange(&strip(1.0, 1000.0), &ceiling(1.0, 1000.0, 0.5), truth, 1e-12, "1 × 1000 opposed");
    assert_exchange(&strip(3.0, 5.0), &ceiling(3.0, 5.0, 2.0), 15.0 * 0.393_999_695_339_317_084_45, 1e-13, "3 × 5");
    let wall = |h: f64| polygon(&[[0.0, 0.0, 0.0], [0.0, 0.0, h], [1.0, 0.0, h], [1.0, 0.0, 0.0]]);
    let cases = [(1e-5, 4.999_785_908_748_820_354_9e-6), (1e-3, 1e-3 * 0.498_592_023_105_068_250_07)];
    for (height, truth) in cases {
        assert_exchange(&floor(), &wall(height), truth, 1e-11, &format!("wall of height {height}"));
    }
}

/// Both contour integrals numerically (tanh–sinh, 20 digits), over the parts in front of each other: no symmetry, every
/// kind of nearness.
#[test]
fn general_polygons_are_exact_however_they_touch() {
    let cases: [(&str, &[[f64; 3]], f64); 10] = [
        ("skew triangle", &[[0.3, 0.2, 1.0], [0.2, 1.3, 1.4], [1.5, 1.2, 1.8]], 0.076_957_822_019_979_718_79),
        ("shared corner", &[[2.0, 1.0, 1.0], [1.0, 2.0, 1.0], [1.0, 1.0, 0.0]], 0.030_525_820_451_065_087_8),
        ("corner near an edge", &[[1.3, 2.0, 1.0], [0.2, 2.0, 1.0], [0.5, 1.001, 0.0]], 0.017_206_152_266_264_704),
        (
            "near the face, crossing its plane",
            &[[0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [0.25, 0.25, 0.25]],
            0.106_881_234_574_615_944,
        ),
        (
            "gap of 1e-6, crossing its plane",
            &[[0.2, 0.2, 1e-6], [0.3, 0.9, 0.002], [0.8, 0.3, 0.001]],
            0.204_998_807_699_740_163,
        ),
        ("size 1e-3", &[[0.2, 0.2, 0.01], [0.2, 0.201, 0.01], [0.201, 0.201, 0.0105]], 5.262_810_588_476_080_22e-7),
        (
            "sliver",
            &[[0.0, 0.5, 0.1], [0.0, 0.501, 0.1], [1.0, 0.501, 0.1], [1.0, 0.5, 0.1]],
            0.000_894_154_512_095_258_181,
        ),
        (
            "low wall",
            &[[0.0, 0.0, 0.0], [0.0, 0.0, 0.001], [1.0, 0.0, 0.001], [1.0, 0.0, 0.0]],
            0.000_498_592_023_105_068_25,
        ),
        ("corner on an edge", &[[0.9, 1.4, 1.0], [0.2, 1.5, 1.0], [0.4, 1.0, 0.0]], 0.025_112_917_829_697_396),
        (
            "part of an edge",
            &[[0.75, 1.0, 0.0], [0.75, 1.0, 1.0], [0.25, 1.0, 1.0], [0.25, 1.0, 0.0]],
            0.109_284_434_553_405_568,
        ),
    ];
    for (what, corners, truth) in cases {
        assert_exchange(&floor(), &polygon(corners), truth, 1e-11, what);
    }
}

/// What lies behind the other's plane takes no part: the closed form of the part in front is the truth.
#[test]
fn polygons_that_cross_each_others_plane_are_cut_at_the_horizon() {
    let truth = 0.200_043_776_075_403_154_24;
    let through = polygon(&[[0.0, 0.0, -2.0], [0.0, 1.0, -2.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]]);
    assert_exchange(&floor(), &through, truth, 1e-13, "wall through the floor");
    let wide = polygon(&[[-3.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [-3.0, 1.0, 0.0]]);
    assert_exchange(&wide, &through, truth, 1e-13, "each through the other's plane");
    assert_eq!(unoccluded(&floor(), &reversed(&through), TOLERANCE).value, 0.0);
}

#[test]
fn polygons_that_face_away_or_lie_in_one_plane_exchange_nothing() {
    let beside = moved(&floor(), |v| v + DVec3::X);
    let none = Estimate::default();
    assert_eq!(unoccluded(&floor(), &beside, TOLERANCE), none);
    assert_eq!(unoccluded(&floor(), &reversed(&floor()), TOLERANCE), none);
    assert_eq!(unoccluded(&floor(), &reversed(&ceiling(1.0, 1.0, 1.0)), TOLERANCE), none);
}

/// F has no unit. A turn by an arbitrary angle rounds the corners to 1e-16 of their size.
#[test]
fn scaling_and_turning_change_nothing() {
    let turn = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(1.1);
    for (i, j) in [(floor(), hinged(30.0)), (floor(), ceiling(1.0, 1.0, 20.0)), (floor(), ceiling(1.0, 1.0, 0.7))] {
        let f = unoccluded(&i, &j, TOLERANCE).value;
        for scale in [1e-3, 1e3] {
            let map = |v| turn * (v * scale);
            let g = unoccluded(&moved(&i, map), &moved(&j, map), TOLERANCE).value / (scale * scale);
            assert!((f - g).abs() < 1e-13, "{f} {g}");
        }
    }
}

/// Moving by 1e5 rounds the corners to 1.5e-11; where the moved corners are exact (multiples of 2⁻¹⁰) nothing is lost.
#[test]
fn moving_by_1e5_costs_only_the_rounding_of_the_corners() {
    let away = DVec3::new(1e5, -1e5, 1e5);
    for j in [ceiling(1.0, 1.0, 1.0), ceiling(1.0, 1.0, 32.0), ceiling(1.0, 1.0, 0.5_f64.powi(10)), hinged(90.0)] {
        // cos 90° is 6e-17 in doubles; it is meant to be 0.
        let j = moved(&j, |v| (v * 1024.0).round() / 1024.0);
        let (here, there) = (
            unoccluded(&floor(), &j, TOLERANCE),
            unoccluded(&moved(&floor(), |v| v + away), &moved(&j, |v| v + away), TOLERANCE),
        );
        assert!((here.value - there.value).abs() <= 1e-15, "{here:?} {there:?}");
    }
    let turned = |v: DVec3| DMat3::from_rotation_y(0.3) * v + away;
    let there = unoccluded(&moved(&floor(), turned), &moved(&hinged(30.0), turned), TOLERANCE);
    let error = (there.value - 0.619_028_323_090_803_253_4).abs();
    assert!(error < 1e-9 && error <= there.bound, "{error:e} {there:?}");
}

/// Cutting one square into four must not change the sum, whichever rules the whole and the parts use: the distances
/// pass every border between orders and between the two rules. Errors stay inside the bounds of both.
#[test]
fn rules_agree_across_their_borders() {
    let floor = floor();
    let quarter = |p: &Polygon, k: usize| moved(p, |v| (v + p.vertices()[k]) * 0.5);
    for step in 0..120 {
        // From contact to 100 sides, sideways and tilted so that no symmetry helps.
        let distance = 0.01 * 10.0_f64.powf(f64::from(step) / 30.0);
        let turn = DMat3::from_rotation_x(0.4) * DMat3::from_rotation_y(0.3);
        let j = moved(&ceiling(1.3, 0.7, 0.0), |v| turn * v + DVec3::new(0.2 + 0.3 * distance, -0.1, distance + 0.5));
        for tolerance in [1e-4, 1e-7, 1e-10] {
            let whole = unoccluded(&floor, &j, tolerance);
            let (mut sum, mut bound) = (0.0, whole.bound);
            for (k, l) in (0..16).map(|k| (k / 4, k % 4)) {
                let part = unoccluded(&quarter(&floor, k), &quarter(&j, l), 1e-13);
                sum += part.value;
                bound += part.bound;
            }
            let error = (whole.value - sum).abs();
            assert!(error <= bound, "distance {distance}, {tolerance:e}: error {error:e}, bound {bound:e}");
            assert!(error <= tolerance * j.area(), "distance {distance}, {tolerance:e}: error {error:e}");
        }
    }
}

/// Inside any closed convex solid the rows sum to 1: here an n-gon prism with a floor, a ceiling and n sides.
fn prism(base: &[(f64, f64)], height: f64) -> Vec<Polygon> {
    let at = |k: usize, z: f64| [base[k % base.len()].0, base[k % base.len()].1, z];
    let n = base.len();
    let mut faces = vec![
        polygon(&(0..n).map(|k| at(k, 0.0)).collect::<Vec<_>>()),
        polygon(&(0..n).rev().map(|k| at(k, height)).collect::<Vec<_>>()),
    ];
    faces.extend((0..n).map(|k| polygon(&[at(k, 0.0), at(k, height), at(k + 1, height), at(k + 1, 0.0)])));
    faces
}

/// Every face has closed-form neighbours at dihedral angles down to 3°; 1e-12 leaves room for 8 terms of 1e-13.
#[test]
fn rows_of_prisms_sum_to_one() {
    let heptagon: Vec<(f64, f64)> =
        (0..7).map(|k| (f64::from(k) * std::f64::consts::TAU / 7.0).sin_cos()).map(|(s, c)| (2.0 * c, s)).collect();
    let wedge = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.05)];
    for (what, faces) in [("heptagon", prism(&heptagon, 0.7)), ("wedge", prism(&wedge, 3.0))] {
        for (s, i) in faces.iter().enumerate() {
            let others = faces.iter().enumerate().filter(|(t, _)| *t != s);
            let sum: f64 = others.map(|(_, j)| unoccluded(i, j, 1e-13).value).sum();
            assert!((sum / i.area() - 1.0).abs() < 1e-12, "{what}, face {s}: {:e}", sum / i.area() - 1.0);
        }
    }
}

/// Faces of the unit cube, each cut into k × k patches, seen from inside.
fn cube(k: usize) -> Facets {
    let mut facets = Facets::new();
    for (axis, side) in (0..6).map(|f| (f / 2, f % 2)) {
        for (i, j) in (0..k * k).map(|c| (c / k, c % k)) {
            let at = |i: usize, j: usize| {
                let mut x = [side as f64; 3];
                (x[(axis + 1) % 3], x[(axis + 2) % 3]) = (i as f64 / k as f64, j as f64 / k as f64);
                x
            };
            let patch = polygon(&[at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
            facets.push(vec![if side == 1 { reversed(&patch) } else { patch }], false);
        }
    }
    facets
}

/// 320 form factors of a row are not zero. Each may err by 1e-10; most err by a hundredth of that, so the sum by less than 1e-9.
#[test]
fn rows_of_the_cube_of_8_by_8_patches_sum_to_one() {
    let (facets, estimator) = (cube(8), Analytic::new(None));
    let rows = PairwiseRows::new(&estimator, &facets, &facets, TOLERANCE, 1);
    let mut values = vec![0.0; facets.len()];
    for s in 0..facets.len() {
        rows.row(s, &mut values).unwrap();
        let closure = values.iter().sum::<f64>() / facets.area(s) - 1.0;
        assert!(closure.abs() < 1e-9, "row {s}: {closure:e}");
    }
}

/// The references are the formulas in 60 digits. The estimator's route shares nothing with the closed forms; its error is
/// below 1e-13 by its bound.
#[test]
fn closed_forms_match_their_references() {
    assert!((opposed_rectangles(3.0, 5.0, 2.0) - 0.393_999_695_339_317_084_45).abs() < 1e-15);
    assert!((perpendicular_rectangles(2.0, 3.0, 4.0) - 0.274_884_972_027_518_436_21).abs() < 1e-15);
    for gap in [0.3, 1.0, 3.0] {
        let value = unoccluded(&floor(), &ceiling(1.0, 1.0, gap), 1e-13).value;
        assert!((value - opposed_rectangles(1.0, 1.0, gap)).abs() < 1e-12, "gap {gap}");
    }
}

/// Deterministic pseudo-random pairs, also touching and crossing: the truth is the sum over the parts of both polygons, cut
/// at their centroids, at a thousandth of the tolerance.
#[test]
fn bounds_hold_on_random_pairs() {
    let mut state = 0x9e37_79b9_u64;
    let mut random = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let (mut pairs, mut exceeded) = (0, Vec::new());
    while pairs < 300 {
        let mut loop_of = |centre: DVec3, size: f64| {
            let normal = DVec3::new(random() - 0.5, random() - 0.5, random() - 0.5).try_normalize()?;
            let (u, v) = normal.any_orthonormal_pair();
            let count = 3 + (random() * 4.0) as usize;
            let mut angles: Vec<f64> = (0..count).map(|_| random() * std::f64::consts::TAU).collect();
            angles.sort_by(f64::total_cmp);
            let corner = |angle: &f64| centre + (u * angle.cos() + v * 0.5 * angle.sin()) * size;
            let p = Polygon::new(&angles.iter().map(corner).collect::<Vec<_>>()).ok()?;
            (p.area() > 1e-3 * size * size).then_some(p)
        };
        let Some(i) = loop_of(DVec3::ZERO, 1.0) else { continue };
        let Some(j) = loop_of(DVec3::ZERO, 0.03_f64.powf(i.area() % 1.0)) else { continue };
        // Touching at a corner, over a face, or apart by up to 100.
        let shift = match pairs % 3 {
            0 => i.vertices()[0] - j.vertices()[0],
            1 => i.centroid() + i.normal() * (j.area() * 0.1),
            _ => j.normal() * -(10.0_f64.powf(4.0 * (j.area() % 1.0) - 2.0)),
        };
        let j = moved(&j, |v| v + shift);
        let whole = unoccluded(&i, &j, TOLERANCE);
        if whole.value == 0.0 {
            continue;
        }
        pairs += 1;
        let parts = |p: &Polygon| -> Vec<Polygon> {
            p.edges().filter_map(|(a, b)| Polygon::new(&[a, b, p.centroid()]).ok()).collect()
        };
        let (mut sum, mut bound) = (0.0, whole.bound);
        for (a, b) in parts(&i).iter().flat_map(|a| parts(&j).into_iter().map(move |b| (a.clone(), b))) {
            let part = unoccluded(&a, &b, 1e-13);
            sum += part.value;
            bound += part.bound;
        }
        let error = (whole.value - sum).abs();
        if error > bound || error > 1e-10 * i.area().min(j.area()) {
            exceeded.push((pairs, error, bound, sum));
        }
    }
    assert_eq!(exceeded, []);
}
