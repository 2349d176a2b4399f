//! Pairs with something between: classification, the sampled share and its stated error.

use glam::DVec3;
use radiosity_core::Cost;
use radiosity_form_factors::analytic::{Analytic, PartialVisibility, unoccluded};
use radiosity_form_factors::{Pairwise, PairwiseRows, Rows};
use radiosity_geometry::{Facets, Occluders, Polygon};

const TOLERANCE: f64 = 1e-10;

/// A rectangle on z = height; faces up or down.
fn rectangle([x0, x1, y0, y1]: [f64; 4], height: f64, up: bool) -> Polygon {
    let mut corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)].map(|(x, y)| DVec3::new(x, y, height));
    if !up {
        corners.reverse();
    }
    Polygon::new(&corners).unwrap()
}

const UNIT: [f64; 4] = [-0.5, 0.5, -0.5, 0.5];

/// The unit squares 1 apart, and everything given between them as occluders (the squares themselves included).
fn between(blockers: &[Polygon]) -> (Polygon, Polygon, Occluders) {
    let (i, j) = (rectangle(UNIT, 0.0, true), rectangle(UNIT, 1.0, false));
    let mut all = blockers.to_vec();
    all.extend([i.clone(), j.clone()]);
    let owners = (0..all.len() as u32).collect();
    (i, j, Occluders::new(all, owners))
}

/// Name, distance of the unit squares, blocker parallel to them, its share of the distance, A_i F_ij by 20-digit integrals.
const ONE_BLOCKER: [(&str, f64, [f64; 4], f64, f64); 4] = [
    ("centred_half", 1.0, [-0.25, 0.25, -0.25, 0.25], 0.5, 0.099_506_294_598_984_79),
    ("off_centre", 1.0, [0.1, 0.6, -0.2, 0.35], 0.3, 0.148_601_074_323_251_7),
    ("far", 50.0, [-0.25, 0.25, -0.25, 0.25], 0.5, 5.569_415_281_217_112e-5),
    ("half_block", 1.0, [0.0, 2.0, -2.0, 2.0], 0.5, 0.099_912_447_849_193_69),
];

fn one_blocker(d: f64, blocker: [f64; 4], t: f64) -> (Polygon, Polygon, Occluders) {
    let (i, j) = (rectangle(UNIT, 0.0, true), rectangle(UNIT, d, false));
    let occluders = Occluders::new(vec![rectangle(blocker, t * d, true), i.clone(), j.clone()], vec![0, 1, 2]);
    (i, j, occluders)
}

/// Whatever is asked between 1e-3 and 1e-10 is met, and the stated error covers the true one.
#[test]
fn opposed_squares_with_one_blocker_are_right_to_what_is_asked() {
    for (name, d, blocker, t, truth) in ONE_BLOCKER {
        let (i, j, occluders) = one_blocker(d, blocker, t);
        for tolerance in [1e-3, 1e-5, 1e-7, 1e-10] {
            let exact = PartialVisibility::Exact { tolerance };
            let estimate = Analytic::new(Some(&occluders)).partial_visibility(exact).exchange(&i, &j, 1e-12, 0);
            let error = (estimate.value - truth).abs();
            assert!(error < tolerance && error <= estimate.bound, "{name}, {tolerance:e}: {error:e} {estimate:?}");
            assert_eq!((estimate.cost.partial_pairs, estimate.cost.form_factors), (1, 1), "{name}");
        }
    }
}

/// By 256 segments the error is below 1e-3 and inside the bound of three standard errors for several seeds (a bound may fail
/// once in 370, so the seeds are fixed).
#[test]
fn opposed_squares_with_one_blocker_are_right_to_1e_3_by_rays() {
    for (name, d, blocker, t, truth) in ONE_BLOCKER {
        let (i, j, occluders) = one_blocker(d, blocker, t);
        for seed in 0..5 {
            let estimate = Analytic::new(Some(&occluders)).samples(256).exchange(&i, &j, TOLERANCE, seed);
            let error = (estimate.value - truth).abs();
            assert!(error < 1e-3 && error <= estimate.bound, "{name}, seed {seed}: {error:e} {estimate:?}");
            assert_eq!((estimate.cost.partial_pairs, estimate.cost.form_factors), (1, 1), "{name}");
        }
    }
}

/// 16 times as many segments of a scrambled net bring the error down by more than the 4 of plain Monte Carlo.
#[test]
fn error_falls_faster_than_with_independent_samples() {
    let (i, j, occluders) = between(&[rectangle([-0.25, 0.25, -0.25, 0.25], 0.5, true)]);
    let rms = |samples| {
        let squares = (0..32).map(|seed| {
            let estimate = Analytic::new(Some(&occluders)).samples(samples).exchange(&i, &j, TOLERANCE, seed);
            (estimate.value - 0.099_506_294_598_984_79).powi(2)
        });
        (squares.sum::<f64>() / 32.0).sqrt()
    };
    let (few, many) = (rms(16), rms(256));
    assert!(many < few / 5.0, "{few:e} {many:e}");
}

/// Segments are doubled until the standard error is what is asked: it is, by the pair's own count, and the error is within five of
/// them for every seed; 1e-3 takes fewer segments than 1e-4.
#[test]
fn rays_are_doubled_to_the_standard_error_asked() {
    let (i, j, occluders) = between(&[rectangle([-0.25, 0.25, -0.25, 0.25], 0.5, true)]);
    let mut rays = Vec::new();
    for standard_error in [1e-3, 1e-4] {
        let rule = PartialVisibility::Rays { samples: 16, standard_error };
        for seed in 0..8 {
            let estimate = Analytic::new(Some(&occluders)).partial_visibility(rule).exchange(&i, &j, TOLERANCE, seed);
            let error = (estimate.value - 0.099_506_294_598_984_79).abs();
            assert!(estimate.bound <= 3.0 * standard_error + TOLERANCE, "seed {seed}: {estimate:?}");
            assert!(error < 5.0 * standard_error, "seed {seed}: {error:e} {estimate:?}");
            rays.push(estimate.cost.rays);
        }
    }
    assert!(rays[..8].iter().max() < rays[8..].iter().min(), "{rays:?}");
}

#[test]
fn a_sheet_that_covers_every_segment_hides_the_pair() {
    let (i, j, occluders) = between(&[rectangle([-0.6, 0.7, -0.8, 0.9], 0.4, true)]);
    let estimate = Analytic::new(Some(&occluders)).exchange(&i, &j, TOLERANCE, 1);
    let cost = Cost { form_factors: 1, hidden_pairs: 1, ..Cost::default() };
    assert_eq!((estimate.value, estimate.bound, estimate.cost), (0.0, 0.0, cost));
}

/// Beside the shaft, behind one of the squares, in the plane of one, or in line with the edges: nothing is sampled.
#[test]
fn what_cannot_block_leaves_the_pair_clear() {
    let wall = |x: f64, z0: f64, z1: f64| {
        let corner = |y, z| DVec3::new(x, y, z);
        Polygon::new(&[corner(-2.0, z0), corner(2.0, z0), corner(2.0, z1), corner(-2.0, z1)]).unwrap()
    };
    let cases = [
        ("beside", rectangle([0.6, 2.0, -1.0, 1.0], 0.5, true)),
        ("behind", rectangle([-1.0, 1.0, -1.0, 1.0], -0.1, true)),
        ("in the plane", rectangle([-1.0, 1.0, -1.0, 1.0], 1.0, true)),
        ("a side wall", wall(0.5, -1.0, 2.0)),
        ("a wall below the floor", wall(0.1, -1.0, 0.0)),
    ];
    for (name, blocker) in cases {
        let (i, j, occluders) = between(&[blocker]);
        let estimate = Analytic::new(Some(&occluders)).exchange(&i, &j, TOLERANCE, 1);
        let cost = Cost { form_factors: 1, clear_pairs: 1, ..Cost::default() };
        assert_eq!(estimate.cost, cost, "{name}");
        assert_eq!(estimate.value, unoccluded(&i, &j, TOLERANCE).value, "{name}");
    }
}

/// A wall in the middle, from floor to ceiling, is crossed by squares on both sides: left half sees left half only. The
/// truth is twice the exchange area of the halves, to 1e-10 each; 1e-6 is asked of what is partly hidden.
#[test]
fn a_wall_across_both_polygons_leaves_each_side_its_own() {
    let corner = |y, z| DVec3::new(0.0, y, z);
    let wall = Polygon::new(&[corner(-1.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(-1.0, 1.0)]).unwrap();
    let (i, j, occluders) = between(&[wall]);
    let left = [-0.5, 0.0, -0.5, 0.5];
    let truth = 2.0 * unoccluded(&rectangle(left, 0.0, true), &rectangle(left, 1.0, false), TOLERANCE).value;
    let estimate = Analytic::new(Some(&occluders)).exchange(&i, &j, TOLERANCE, 3);
    let error = (estimate.value - truth).abs();
    assert!(error < 1e-6 && error <= estimate.bound, "{error:e} {estimate:?}");
}

/// Sixteen sheets go through the hierarchy, their union through the direct test: same segments, same answer.
#[test]
fn many_blockers_give_what_their_union_gives() {
    let whole = [-0.25, 0.25, -0.25, 0.25];
    let at = |k: usize| -0.25 + 0.125 * k as f64;
    let parts: Vec<Polygon> =
        (0..16).map(|c| rectangle([at(c / 4), at(c / 4 + 1), at(c % 4), at(c % 4 + 1)], 0.5, true)).collect();
    let value = |blockers: &[Polygon]| {
        let (i, j, occluders) = between(blockers);
        Analytic::new(Some(&occluders)).samples(256).exchange(&i, &j, TOLERANCE, 5).value
    };
    assert_eq!(value(&parts), value(&[rectangle(whole, 0.5, true)]));
}

/// Faces of an axis-parallel cube from lo to hi, each k × k.
fn cube(lo: f64, hi: f64, k: usize, inward: bool) -> Vec<Polygon> {
    let mut faces = Vec::new();
    for (axis, side) in (0..6).map(|f| (f / 2, f % 2)) {
        for (i, j) in (0..k * k).map(|c| (c / k, c % k)) {
            let at = |i: usize, j: usize| {
                let mut x = [if side == 1 { hi } else { lo }; 3];
                let along = |i: usize| lo + (hi - lo) * i as f64 / k as f64;
                (x[(axis + 1) % 3], x[(axis + 2) % 3]) = (along(i), along(j));
                DVec3::from_array(x)
            };
            let mut corners = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            if (side == 1) == inward {
                corners.reverse();
            }
            faces.push(Polygon::new(&corners).unwrap());
        }
    }
    faces
}

/// The closed scene of a box of side 0.4 in the unit cube: rows sum to 1 within errors of at most 1e-6 of either sign of some thirty
/// partial pairs each, and a row is the same whichever of the two polygons is asked.
#[test]
fn rows_of_a_box_in_a_cube_sum_to_one_within_1e_6() {
    let mut facets = Facets::new();
    cube(0.0, 1.0, 4, true).into_iter().chain(cube(0.3, 0.7, 2, false)).for_each(|p| facets.push(vec![p], false));
    let faces: Vec<Polygon> = cube(0.0, 1.0, 1, true).into_iter().chain(cube(0.3, 0.7, 1, false)).collect();
    let occluders = Occluders::new(faces, (0..12).collect());
    let estimator = Analytic::new(Some(&occluders));
    let rows = PairwiseRows::new(&estimator, &facets, &facets, TOLERANCE, 1);
    let n = facets.len();
    let (mut matrix, mut cost) = (vec![vec![0.0; n]; n], Cost::default());
    for (s, row) in matrix.iter_mut().enumerate() {
        cost += rows.row(s, row).unwrap().0;
        let closure = row.iter().sum::<f64>() / facets.area(s) - 1.0;
        assert!(closure.abs() < 1e-6, "row {s}: {closure:e}");
    }
    for (s, t) in (0..n * n).map(|k| (k / n, k % n)) {
        assert_eq!(matrix[s][t], matrix[t][s]);
    }
    assert_eq!(cost.form_factors, cost.clear_pairs + cost.hidden_pairs + cost.partial_pairs);
    assert!(cost.hidden_pairs > 0 && cost.partial_pairs > 0 && cost.clear_pairs > cost.partial_pairs, "{cost:?}");
}
