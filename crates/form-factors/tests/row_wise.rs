//! Row-wise estimators: closed scenes, closed forms, observed order, invariance.

use glam::{DMat3, DQuat, DVec3};
use radiosity_core::{Cost, DrawBuf, Draws, FormFactors};
use radiosity_form_factors::analytic::Analytic;
use radiosity_form_factors::emitters::{Emitter, ExactEmitters};
use radiosity_form_factors::hemicube::{Hemicube, HemicubeError};
use radiosity_form_factors::ray_cast::RayCast;
use radiosity_form_factors::stores::{Keep, OnDemand};
use radiosity_form_factors::{PairwiseRows, Receivers, Rows};
use radiosity_geometry::{Facets, Occluders, Polygon};

/// The inside of a box a × b × c, each face k × k, mapped by `map`.
fn room(size: DVec3, k: u32, map: impl Fn(DVec3) -> DVec3) -> Facets {
    let mut facets = Facets::new();
    for axis in 0..3 {
        for side in [0.0, 1.0] {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let corner = |i: u32, j: u32| {
                let mut p = [0.0; 3];
                p[axis] = side;
                p[u] = f64::from(i) / f64::from(k);
                p[v] = f64::from(j) / f64::from(k);
                map(DVec3::from_array(p) * size)
            };
            for (i, j) in (0..k).flat_map(|j| (0..k).map(move |i| (i, j))) {
                let mut loop_ = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
                if side == 1.0 {
                    loop_.reverse();
                }
                facets.push(vec![Polygon::new(&loop_).unwrap()], false);
            }
        }
    }
    facets
}

fn turned(p: DVec3) -> DVec3 {
    DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.7).normalize(), 0.83)) * p
}

fn rows(estimator: &dyn Rows) -> Vec<Vec<f64>> {
    (0..estimator.sources())
        .map(|s| {
            let mut row = vec![0.0; estimator.targets()];
            estimator.row(s, &mut row).unwrap();
            row
        })
        .collect()
}

#[test]
fn a_closed_room_leaves_no_pixel_uncovered() {
    let moved = |p: DVec3| turned(p) + DVec3::splat(1e3);
    for facets in [room(DVec3::new(3.0, 4.0, 5.0), 3, |p| p), room(DVec3::new(1.0, 1.0, 1.0), 4, moved)] {
        for resolution in [2, 30, 128] {
            let hemicube = Hemicube::new(&facets, Receivers::facets(&facets), resolution, 1).unwrap();
            for s in 0..facets.len() {
                let pixels = hemicube.pixels(s);
                assert_eq!((pixels.empty, pixels.back), (0, 0), "source {s} at resolution {resolution}");
                assert_eq!(pixels.front, 3 * u64::from(resolution).pow(2));
            }
        }
    }
}

/// A closed room catches every ray and pixel: rows sum to A_s to the rounding of the sum.
#[test]
fn rows_of_a_closed_room_sum_to_the_area() {
    let facets = room(DVec3::new(3.0, 4.0, 5.0), 3, turned);
    let occluders = Occluders::of_facets(&facets);
    let hemicube = Hemicube::new(&facets, Receivers::facets(&facets), 32, 1).unwrap();
    let ray_cast = RayCast::new(&facets, Receivers::facets(&facets), &occluders, 500, 1);
    for estimator in [&hemicube as &dyn Rows, &ray_cast] {
        for (s, row) in rows(estimator).iter().enumerate() {
            let sum: f64 = row.iter().sum();
            assert!((sum / facets.area(s) - 1.0).abs() < 1e-12, "{} source {s}", estimator.name());
            assert_eq!(row[s], 0.0, "a flat facet sees nothing of itself");
        }
    }
}

/// Opposed unit squares 0.1998248957 (Howell C-11). Of 2¹⁶ independent rays σ is 1.6e-3; a scrambled net of a
/// discontinuous function in four dimensions errs like N^(−5/8) = 1e-3 at worst.
#[test]
fn rays_give_the_factor_of_opposed_squares() {
    let facets = room(DVec3::ONE, 1, turned);
    let occluders = Occluders::of_facets(&facets);
    let estimator = RayCast::new(&facets, Receivers::facets(&facets), &occluders, 1 << 16, 7);
    for (s, row) in rows(&estimator).iter().enumerate() {
        // Faces come in pairs (side 0, side 1) an axis: the opposite of s is s ^ 1.
        assert!((row[s ^ 1] - 0.199_824_895_7).abs() < 1e-3, "{}", row[s ^ 1]);
    }
}

/// From the centre of a 1 × 1 floor element to the ceiling 1 × 1 at height 1: 4·T(½, ½) of Howell B-3,
/// T(x, y) = 1/(2π)·[x/√(1+x²)·atan(y/√(1+x²)) + y/√(1+y²)·atan(x/√(1+y²))] = 0.239 354 5… Border pixels are
/// wrong by half a ΔF ≤ 4/(π res²) with random signs along about 2·res of them.
#[test]
fn hemicube_error_falls_with_resolution() {
    let facets = room(DVec3::ONE, 1, turned);
    let exact = {
        let r = 1.25_f64.sqrt();
        4.0 * 2.0 * (0.5 / r * (0.5 / r).atan()) / std::f64::consts::TAU
    };
    let error = |resolution: u32| {
        let hemicube = Hemicube::new(&facets, Receivers::facets(&facets), resolution, 1).unwrap().exact_near(false);
        let worst = rows(&hemicube).iter().enumerate().map(|(s, row)| (row[s ^ 1] - exact).abs()).fold(0.0, f64::max);
        assert!(worst < 2.0 / f64::from(resolution).powf(1.5), "resolution {resolution}: {worst}");
        worst
    };
    assert!(error(512) < error(16) / 20.0);
}

#[test]
fn turning_moving_and_scaling_change_no_row_beyond_rounding() {
    let size = DVec3::new(2.0, 1.0, 1.5);
    let plain = room(size, 2, |p| p);
    let maps: [&dyn Fn(DVec3) -> DVec3; 3] = [&|p| turned(p), &|p| p * 1e3, &|p| turned(p) * 1e-3 + DVec3::splat(1e2)];
    let areas: Vec<f64> = plain.areas();
    let all = |facets: &Facets| {
        let occluders = Occluders::of_facets(facets);
        let hemicube = Hemicube::new(facets, Receivers::facets(facets), 64, 3).unwrap();
        let ray_cast = RayCast::new(facets, Receivers::facets(facets), &occluders, 512, 3);
        [rows(&hemicube), rows(&ray_cast)]
    };
    let expected = all(&plain);
    for map in maps {
        let facets = room(size, 2, map);
        for (found, expected) in all(&facets).iter().zip(&expected) {
            for (s, (found, expected)) in found.iter().zip(expected).enumerate() {
                for (f, e) in found.iter().zip(expected) {
                    // The last map leaves vertices with 1e-16·1e2/1e-3 = 1e-11 of their size.
                    let (f, e) = (f / facets.area(s), e / areas[s]);
                    assert!((f - e).abs() < 1e-9, "source {s}: {f} instead of {e}");
                }
            }
        }
    }
}

/// Rows of the unit cube with faces of 4 × 4, exact to 1e-10.
fn exact_rows(facets: &Facets) -> Vec<Vec<f64>> {
    rows(&PairwiseRows::new(Analytic::new(None), facets, facets, 1e-10, 1))
}

/// The bound of a row is for its worst entry at 99.73 %, so it covers more than 99 % of all entries; a median that is 10 × the
/// largest error of its row would be of no use. In a row of 80 entries that largest error is some 2.5 σ, the bound 4.5 σ or more.
#[test]
fn bounds_from_replicates_cover_the_error_and_are_no_more_than_10_times_too_large() {
    let facets = room(DVec3::ONE, 4, turned);
    let (occluders, exact) = (Occluders::of_facets(&facets), exact_rows(&facets));
    for rays in [40, 100, 1024, 4096] {
        let (mut covered, mut entries, mut ratios) = (0, 0, Vec::new());
        for seed in 0..4 {
            let estimator = RayCast::new(&facets, Receivers::facets(&facets), &occluders, rays, seed);
            for (s, exact) in exact.iter().enumerate() {
                let mut row = vec![0.0; facets.len()];
                let (_, bound) = estimator.row(s, &mut row).unwrap();
                let errors: Vec<f64> = row.iter().zip(exact).map(|(f, e)| (f - e).abs()).collect();
                covered += errors.iter().filter(|&&error| error <= bound).count();
                entries += errors.len();
                ratios.push(bound / errors.iter().copied().fold(0.0, f64::max));
            }
        }
        ratios.sort_unstable_by(f64::total_cmp);
        let (share, median) = (covered as f64 / entries as f64, ratios[ratios.len() / 2]);
        assert!(share >= 0.99, "{rays} rays: {share} of the entries within the bound");
        assert!(median <= 10.0, "{rays} rays: a median bound is {median} times the largest error");
    }
}

/// As above, with two emitters of two elements and of one: their totals are exact, and the bound makes up for what was scaled.
#[test]
fn bounds_with_exact_emitters_cover_the_error() {
    let facets = room(DVec3::ONE, 4, turned);
    let (occluders, exact) = (Occluders::of_facets(&facets), exact_rows(&facets));
    let (mut lights, mut emitters) = (Facets::new(), Vec::new());
    for members in [&[21, 22][..], &[50]] {
        lights.push(members.iter().flat_map(|&t| facets.polygons(t).to_vec()), false);
        emitters.push(Emitter { targets: members.iter().map(|&t| (t as u32, facets.area(t))).collect() });
    }
    let rays = RayCast::new(&facets, Receivers::facets(&facets), &occluders, 128, 2);
    let pairs = PairwiseRows::new(Analytic::new(None), &facets, &lights, 1e-10, 1);
    let estimator = ExactEmitters::new(rays, pairs, emitters);
    let (mut covered, mut whole) = (0, 0);
    for (s, exact) in exact.iter().enumerate() {
        let mut row = vec![0.0; facets.len()];
        let (_, bound) = estimator.row(s, &mut row).unwrap();
        covered += row.iter().zip(exact).filter(|(f, e)| (*f - *e).abs() <= bound).count();
        whole += usize::from((row[50] - exact[50]).abs() <= 2e-10 * facets.area(s));
    }
    assert_eq!(whole, facets.len(), "a whole emitter is exact within both tolerances");
    assert!(covered as f64 >= 0.99 * (facets.len() * facets.len()) as f64, "{covered} entries within their bounds");
}

/// Over 96 rows the mean of Σ (F − exact)² is the square of the standard error asked for at most, since rays come in
/// doubling numbers; stopping early where the estimate happens to be low leaves at most a few percent more.
#[test]
fn adaptive_rows_reach_their_standard_error_with_no_more_rays_than_needed() {
    let facets = room(DVec3::ONE, 4, turned);
    let (occluders, exact) = (Occluders::of_facets(&facets), exact_rows(&facets));
    let plain = RayCast::new(&facets, Receivers::facets(&facets), &occluders, 1 << 16, 3);
    let mut spent = Vec::new();
    for asked in [0.04, 0.02, 0.01] {
        let (mut squares, mut rays) = (0.0, 0);
        for (s, exact) in exact.iter().enumerate() {
            let mut row = vec![0.0; facets.len()];
            let (cost, _) = plain.clone().until(asked).row(s, &mut row).unwrap();
            squares += row.iter().zip(exact).map(|(f, e)| ((f - e) / facets.area(s)).powi(2)).sum::<f64>();
            rays += cost.rays;
        }
        let error = (squares / exact.len() as f64).sqrt();
        assert!(error < 1.05 * asked && error > 0.4 * asked, "{error} where {asked} was asked");
        spent.push(rays as f64 / exact.len() as f64);
    }
    // Independent rays would take Σ F(1 − F)/N = σ², about 0.97/σ² rays: 606, 2425, 9700.
    assert!(spent[0] < 606.0 && spent[1] < 2425.0 && spent[2] < 9700.0, "{spent:?} rays a row");
}

#[test]
fn the_most_rays_bound_an_adaptive_row_and_threads_change_nothing() {
    let facets = room(DVec3::new(3.0, 4.0, 5.0), 3, turned);
    let occluders = Occluders::of_facets(&facets);
    let estimator = |rays| RayCast::new(&facets, Receivers::facets(&facets), &occluders, rays, 5);
    let mut row = vec![0.0; facets.len()];
    for most in [1, 63, 64, 1000] {
        assert_eq!(estimator(most).until(1e-6).row(7, &mut row).unwrap().0.rays, u64::from(most));
        let (adaptive, fixed) = (row.clone(), rows(&estimator(most)));
        assert_eq!(adaptive, fixed[7], "the same rays, whether they came at once or not");
    }
    let all = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| (rows(&estimator(20_000)), rows(&estimator(20_000).until(0.01))))
    };
    assert!(all(1) == all(3));
}

#[test]
fn grouped_receivers_sum_their_members() {
    let facets = room(DVec3::new(3.0, 4.0, 5.0), 2, |p| p);
    let group: Vec<u32> = (0..facets.len() as u32).map(|k| k / 4).collect();
    let hemicube = |receivers| rows(&Hemicube::new(&facets, receivers, 32, 1).unwrap());
    let (single, grouped) = (hemicube(Receivers::facets(&facets)), hemicube(Receivers::grouped(&facets, &group, 6)));
    for (single, grouped) in single.iter().zip(&grouped) {
        for (g, sum) in grouped.iter().enumerate() {
            assert!((single[4 * g..4 * g + 4].iter().sum::<f64>() - sum).abs() < 1e-12);
        }
    }
}

#[test]
fn odd_resolutions_are_refused() {
    let facets = room(DVec3::ONE, 1, |p| p);
    let made = Hemicube::new(&facets, Receivers::facets(&facets), 31, 1);
    assert_eq!(made.err(), Some(HemicubeError::Resolution { resolution: 31 }));
}

/// The entry towards the light is that of the pair (both sums round to 1e-16 of the row), whatever the rays met.
#[test]
fn exact_emitters_replace_the_entry_of_the_light_and_keep_the_row_sum() {
    let facets = room(DVec3::new(3.0, 4.0, 5.0), 3, turned);
    let occluders = Occluders::of_facets(&facets);
    let plain = || RayCast::new(&facets, Receivers::facets(&facets), &occluders, 64, 1);
    // The light is two elements of one face, known as one surface.
    let members = [9_usize, 10];
    let mut light = Facets::new();
    light.push(members.iter().flat_map(|&t| facets.polygons(t).to_vec()), false);
    let analytic = Analytic::new(None);
    let targets = members.map(|t| (t as u32, facets.area(t))).to_vec();
    let pairs = PairwiseRows::new(&analytic, &facets, &light, 1e-10, 1);
    let exact = ExactEmitters::new(plain(), &pairs, vec![Emitter { targets }]);
    let whole: Vec<f64> = rows(&pairs).into_iter().map(|row| row[0]).collect();
    for (s, (exact, plain)) in rows(&exact).iter().zip(rows(&plain())).enumerate() {
        let towards: f64 = members.iter().map(|&t| exact[t]).sum();
        assert!((towards - whole[s]).abs() <= 1e-12 * facets.area(s), "source {s}");
        let (sum, before): (f64, f64) = (exact.iter().sum(), plain.iter().sum());
        assert!((sum - before).abs() <= 1e-12 * before, "source {s}: {sum} instead of {before}");
        assert!(exact.iter().all(|&value| value >= 0.0));
    }
}

/// A store that keeps nothing casts the rays that are drawn, and only those; one that keeps rows draws from them.
#[test]
fn draws_are_rays_where_no_row_is_kept() {
    let facets = room(DVec3::new(3.0, 4.0, 5.0), 2, turned);
    let occluders = Occluders::of_facets(&facets);
    let rays = || Box::new(RayCast::new(&facets, Receivers::facets(&facets), &occluders, 200, 7));
    let [casts, kept] = [Keep::None, Keep::All].map(|keep| OnDemand::new(rays(), keep));
    assert!(!casts.draws_from_rows() && kept.draws_from_rows());
    let mut exact = vec![0.0; facets.len()];
    PairwiseRows::new(Analytic::new(None), &facets, &facets, 1e-9, 1).row(3, &mut exact).unwrap();
    let n = 4096;
    let (mut first, mut second) = (vec![0; n], vec![0; n]);
    let draws = &mut [Draws { seed: 1, targets: &mut first }, Draws { seed: 2, targets: &mut second }];
    let drawn = casts.sample(3, 0, facets.area(3), draws, &mut DrawBuf::default()).unwrap();
    assert_eq!(drawn.cost, Cost { rays: 2 * n as u64, ..Cost::default() });
    assert_eq!(drawn.exchange, facets.area(3));
    for targets in [&first, &second] {
        for (t, exact) in exact.iter().enumerate() {
            let share = targets.iter().filter(|&&hit| hit == t as u32).count() as f64 / n as f64;
            // Four standard errors of independent rays of the largest factor, which those of a sequence keep well below.
            assert!((share - exact / drawn.exchange).abs() < 0.025, "{share} for {}", exact / drawn.exchange);
        }
    }
    assert_ne!(first, second);
    let draws = &mut [Draws { seed: 1, targets: &mut first }];
    let drawn = kept.sample(3, 0, facets.area(3), draws, &mut DrawBuf::default()).unwrap();
    assert_eq!((drawn.cost.rays, kept.rows_held()), (200, 1));
}
