//! Rows of unoccluded pairs, taken several at a time: their values, bounds and counts.

use glam::{DMat3, DVec3};
use radiosity_core::Cost;
use radiosity_form_factors::analytic::{Analytic, FacetBlocks};
use radiosity_form_factors::level::Level;
use radiosity_form_factors::{Estimate, Pairwise, PairwiseRows, Rows, Run};
use radiosity_geometry::{Facets, Polygon};
use rayon::prelude::*;

/// A generator of numbers in [0, 1): a linear congruence (Knuth's multiplier), high bits.
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1u64 << 53) as f64
}

fn polygon(corners: &[DVec3]) -> Polygon {
    Polygon::new(corners).unwrap()
}

/// The inside of a turned and shifted unit cube, k × k cells a face; some cells are two triangles, a pentagon and a triangle, or
/// covered.
fn cube(k: usize) -> Facets {
    let turn = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(1.1);
    let mut facets = Facets::new();
    for (face, cell) in (0..6).flat_map(|face| (0..k * k).map(move |cell| (face, cell))) {
        let (axis, high) = (face / 2, face % 2 == 1);
        let at = |i: f64, j: f64| {
            let mut x = [f64::from(u8::from(high)); 3];
            let (u, v) = if high { (axis + 2, axis + 1) } else { (axis + 1, axis + 2) };
            (x[u % 3], x[v % 3]) = (i / k as f64, j / k as f64);
            turn * DVec3::from(x) + DVec3::new(3.0, -2.0, 5.0)
        };
        let (i, j) = ((cell / k) as f64, (cell % k) as f64);
        let [a, b, c, d] = [at(i, j), at(i + 1.0, j), at(i + 1.0, j + 1.0), at(i, j + 1.0)];
        match (face * k * k + cell) % 23 {
            5 => facets.push(vec![polygon(&[a, b, c]), polygon(&[a, c, d])], false),
            9 => {
                let (near, far) = (at(i + 1.0, j + 0.5), at(i + 0.5, j + 1.0));
                facets.push(vec![polygon(&[a, b, near, far, d]), polygon(&[near, c, far])], false);
            }
            13 => {
                facets.push(vec![polygon(&[a, b, c])], false);
                facets.push(vec![polygon(&[a, c, d])], false);
            }
            17 => facets.push(vec![polygon(&[a, b, c, d])], true),
            _ => facets.push(vec![polygon(&[a, b, c, d])], false),
        }
    }
    facets
}

fn all_rows(rows: &dyn Rows) -> (Vec<Vec<f64>>, Cost) {
    let mut cost = Cost::default();
    let row = |s: usize| {
        let mut values = vec![0.0; rows.targets()];
        let (spent, _) = rows.row(s, &mut values).unwrap();
        (values, spent)
    };
    let rows = (0..rows.sources()).map(row).map(|(values, spent)| {
        cost += spent;
        values
    });
    (rows.collect(), cost)
}

/// The same estimator without its kernel of many pairs.
struct OneByOne<'a>(Analytic<'a>);

impl Pairwise for OneByOne<'_> {
    fn name(&self) -> &'static str {
        "one by one"
    }

    fn exchange(&self, i: &Polygon, j: &Polygon, tolerance: f64, seed: u64) -> Estimate {
        self.0.exchange(i, j, tolerance, seed)
    }
}

#[test]
fn a_value_is_the_same_to_the_last_bit_whichever_side_asks_on_any_number_of_threads() {
    let facets = cube(5);
    for level in Level::all() {
        let rows = PairwiseRows::new(Analytic::new(None).at_level(level), &facets, &facets, 1e-7, 1);
        let (values, _) = all_rows(&rows);
        for s in 0..facets.len() {
            assert!((0..s).all(|t| values[s][t] == values[t][s]), "row {s}");
            let mut upper = vec![0.0; facets.len()];
            rows.upper_row(s, &mut upper).unwrap();
            assert_eq!(upper[s..], values[s][s..], "row {s}");
        }
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        assert!(pool.install(|| all_rows(&rows).0 == values));
    }
}

/// Both are within the tolerance of the truth.
#[test]
fn rows_agree_with_single_pairs_and_count_alike() {
    let (facets, tolerance) = (cube(5), 1e-8);
    let (single, wanted) = all_rows(&PairwiseRows::new(OneByOne(Analytic::new(None)), &facets, &facets, tolerance, 1));
    for level in Level::all() {
        let rows = PairwiseRows::new(Analytic::new(None).at_level(level), &facets, &facets, tolerance, 1);
        let (values, cost) = all_rows(&rows);
        assert_eq!(cost, wanted, "{level:?}");
        for (s, t) in (0..facets.len()).flat_map(|s| (0..facets.len()).map(move |t| (s, t))) {
            let smaller = facets.area(s).min(facets.area(t));
            let pieces = (facets.polygons(s).len() * facets.polygons(t).len()) as f64;
            let difference = (values[s][t] - single[s][t]).abs();
            assert!(difference <= 2.0 * pieces * tolerance * smaller, "{level:?}, {s} {t}: {difference:e}");
        }
    }
}

/// Nodes and weights of the Gauss rule of q points on [−1, 1], by Newton's method on Legendre's recurrence.
fn gauss(q: usize) -> Vec<(f64, f64)> {
    let legendre = |x: f64| {
        let (mut p, mut last) = (x, 1.0);
        for k in 2..=q {
            (p, last) = (((2 * k - 1) as f64 * x * p - (k - 1) as f64 * last) / k as f64, p);
        }
        (p, q as f64 * (x * p - last) / (x * x - 1.0))
    };
    let node = |k: usize| {
        let mut x = (std::f64::consts::PI * (k as f64 + 0.75) / (q as f64 + 0.5)).cos();
        (0..10).for_each(|_| x -= legendre(x).0 / legendre(x).1);
        let slope = legendre(x).1;
        (x, 2.0 / ((1.0 - x * x) * slope * slope))
    };
    (0..q).map(node).collect()
}

/// A_i F_ij by its definition, a product rule of 14 points a direction over bilinear maps of both: where no line of one is longer
/// than 0.8 of its distance from the other, the 28th power of 0.4 leaves less than 1e-11 relative, mostly 1e-15.
fn brute_force(i: &Polygon, j: &Polygon, rule: &[(f64, f64)]) -> f64 {
    let points = |p: &Polygon| {
        let v = p.vertices();
        let (a, b, c, d) = (v[0], v[1], v[2], if v.len() == 3 { v[0] } else { v[3] });
        let mut points = Vec::new();
        for (&(s, w_s), &(t, w_t)) in rule.iter().flat_map(|s| rule.iter().map(move |t| (s, t))) {
            let (s, t) = (0.5 * (1.0 + s), 0.5 * (1.0 + t));
            let (low, high) = ((b - a) * (1.0 - t) + (c - d) * t, (d - a) * (1.0 - s) + (c - b) * s);
            let x = (a * (1.0 - s) + b * s) * (1.0 - t) + (d * (1.0 - s) + c * s) * t;
            points.push((x, 0.25 * w_s * w_t * low.cross(high).length()));
        }
        points
    };
    let (first, second) = (points(i), points(j));
    let mut sum = 0.0;
    for (x, w_x) in &first {
        for (y, w_y) in &second {
            let r = *y - *x;
            let r2 = r.length_squared();
            sum += w_x * w_y * r.dot(i.normal()) * -r.dot(j.normal()) / (r2 * r2);
        }
    }
    sum / std::f64::consts::PI
}

/// Rows of single pairs: value and bound of each.
fn estimate(
    analytic: Analytic<'_>,
    blocks: &FacetBlocks,
    facets: &Facets,
    (s, t): (usize, usize),
    tolerance: f64,
) -> (f64, f64) {
    let mut value = [0.0];
    let run =
        Run { sources: facets, targets: facets, blocks: Some(blocks), s, from: t, tolerance, seed: 1, numbers: None };
    let (_, bound) = analytic.exchange_run(&run, &mut value);
    (value[0], bound)
}

/// Errors that are asserted against bounds, and their ratios: none above its bound, and a median bound of at most
/// 100 · max(error, 1e-14 of the smaller area).
fn assert_bounds(facets: &Facets, pairs: &[(usize, usize)], tolerances: &[f64], what: &str) {
    let (rule, blocks) = (gauss(14), FacetBlocks::new(facets));
    let polygon = |k: usize| &facets.polygons(k)[0];
    let ratios = pairs.par_iter().flat_map_iter(|&(s, t)| {
        let truth = brute_force(polygon(s), polygon(t), &rule);
        let smaller = facets.area(s).min(facets.area(t));
        let blocks = &blocks;
        tolerances.iter().map(move |&tolerance| {
            let (value, bound) = estimate(Analytic::new(None), blocks, facets, (s, t), tolerance);
            let error = (value - truth).abs();
            // The reference rounds, too: 196² terms.
            assert!(error <= bound + 1e-13 * truth, "{what}, {s} {t}, {tolerance:e}: error {error:e}, bound {bound:e}");
            // Beyond the tolerance rounding counts: of near pairs 1e-15 of the product of the diameters, and corners that miss
            // a plane times the border they move.
            let (p, q) = (polygon(s), polygon(t));
            let uneven = 8.0 * (p.thickness() + q.thickness()) * p.diameter().min(q.diameter());
            let rounding = 2e-15 * p.diameter() * q.diameter() + uneven;
            assert!(bound <= tolerance * smaller + rounding, "{what}, {s} {t}, {tolerance:e}: bound {bound:e}");
            bound / error.max(1e-14 * smaller)
        })
    });
    let mut ratios: Vec<f64> = ratios.collect();
    ratios.sort_by(f64::total_cmp);
    let median = ratios[ratios.len() / 2];
    assert!(median <= 100.0, "{what}: bounds are {median} times the error");
}

/// Every 90th pair of different faces, apart by at least 2.5 sides.
#[test]
fn bounds_hold_between_the_cells_of_a_cube() {
    let facets = cube(9);
    let centre = |k: usize| facets.polygons(k)[0].centroid();
    let usable = |k: usize| !facets.covered(k) && facets.polygons(k).len() == 1;
    let pairs: Vec<_> = (0..facets.len())
        .flat_map(|s| (s + 1..facets.len()).map(move |t| (s, t)))
        .filter(|&(s, t)| usable(s) && usable(t))
        .filter(|&(s, t)| facets.polygons(s)[0].normal().dot(facets.polygons(t)[0].normal()) < 0.5)
        .filter(|&(s, t)| centre(s).distance(centre(t)) * 9.0 > 2.5)
        .step_by(90)
        .collect();
    assert!(pairs.len() > 900, "{}", pairs.len());
    assert_bounds(&facets, &pairs, &[1e-4, 1e-7, 1e-10], "cube");
}

/// Triangles and quadrilaterals of any shape, sizes from 1 to 1/100, turned by up to 60° from facing each other, from 2.5 to 250
/// sizes apart: every border between orders is passed many times.
#[test]
fn bounds_hold_between_cells_of_any_shape() {
    let mut state = 0x2545_f491_4f6c_dd1d;
    let mut facets = Facets::new();
    let mut pairs = Vec::new();
    while pairs.len() < 1000 {
        let mut cell = |centre: DVec3, towards: DVec3, size: f64| {
            let tilt = DVec3::new(random(&mut state) - 0.5, random(&mut state) - 0.5, random(&mut state) - 0.5);
            let (u, v) = (towards + tilt * 1.7).normalize().any_orthonormal_pair();
            let count = 3 + usize::from(random(&mut state) > 0.4);
            let mut angles: Vec<f64> = (0..count).map(|_| random(&mut state) * std::f64::consts::TAU).collect();
            angles.sort_by(f64::total_cmp);
            let flat = 0.1 + 0.9 * random(&mut state);
            let corner = |a: &f64| centre + (u * a.cos() + v * (flat * a.sin())) * (0.5 * size);
            let p = Polygon::new(&angles.iter().map(corner).collect::<Vec<_>>()).ok()?;
            (p.area() > 0.02 * size * size && p.normal().dot(towards) > 0.3).then_some(p)
        };
        let size = 0.01_f64.powf((pairs.len() % 7) as f64 / 6.0);
        let distance = 2.5 * 100.0_f64.powf((pairs.len() % 11) as f64 / 10.0);
        let way = DVec3::new(0.48, -0.6, 0.64);
        let (Some(i), Some(j)) = (cell(DVec3::ZERO, way, 1.0), cell(way * distance, -way, size)) else { continue };
        pairs.push((facets.len(), facets.len() + 1));
        facets.push(vec![i], false);
        facets.push(vec![j], false);
    }
    assert_bounds(&facets, &pairs, &[1e-4, 1e-7, 1e-10], "any shape");
}
