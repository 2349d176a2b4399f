//! Near, stiff and degenerate pairs against 20-digit values from independent routes.
//!
//! `closed_forms.txt` holds the corners of both polygons and A_i F_ij of exactly these doubles; `closed_forms.py` says how the
//! values were computed.

use glam::DVec3;
use radiosity_form_factors::{Estimate, analytic::unoccluded};
use radiosity_geometry::Polygon;

const TABLE: &str = include_str!("closed_forms.txt");

/// A pair of the table.
struct Pair {
    name: &'static str,
    i: Polygon,
    j: Polygon,
    truth: f64,
}

impl Pair {
    fn smaller(&self) -> f64 {
        self.i.area().min(self.j.area())
    }

    /// Both orders of the pair, computed to `tolerance`.
    fn estimates(&self, tolerance: f64) -> [Estimate; 2] {
        [unoccluded(&self.i, &self.j, tolerance), unoccluded(&self.j, &self.i, tolerance)]
    }
}

fn table() -> Vec<Pair> {
    let polygon = |text: &str| {
        let corner = |text: &str| {
            let mut x = text.split_whitespace().map(|x| x.parse::<f64>().unwrap());
            std::array::from_fn::<f64, 3, _>(|_| x.next().unwrap())
        };
        Polygon::new(&text.split(',').map(|text| DVec3::from_array(corner(text))).collect::<Vec<_>>()).unwrap()
    };
    let pair = |line: &'static str| {
        let [name, i, j, truth] = line.split(" | ").collect::<Vec<_>>().try_into().unwrap();
        Pair { name, i: polygon(i), j: polygon(j), truth: truth.parse().unwrap() }
    };
    TABLE.lines().filter(|line| !line.starts_with('#')).map(pair).collect()
}

/// The default tolerance, and one near the rounding of the contour rule.
const TOLERANCES: [f64; 2] = [1e-10, 1e-13];

/// 1e-9 of the smaller area, and six digits.
#[test]
fn every_pair_is_right_to_1e_9_and_to_six_digits() {
    let pairs = table();
    assert!(pairs.len() >= 60, "{} pairs", pairs.len());
    for pair in &pairs {
        for tolerance in TOLERANCES {
            for Estimate { value, .. } in pair.estimates(tolerance) {
                let (error, name) = ((value - pair.truth).abs(), pair.name);
                assert!(error <= 1e-9 * pair.smaller(), "{name}: {:e} of the smaller area off", error / pair.smaller());
                assert!(error <= 1e-6 * pair.truth, "{name}: {:e} relative", error / pair.truth);
            }
        }
    }
}

/// A bound covers the error to the last bit, and in the median over the table it is at most 100 times the error, or 100
/// times 1e-14 of the smaller area where the error is below that.
#[test]
fn bounds_cover_the_errors_and_are_sharp_in_the_median() {
    for tolerance in TOLERANCES {
        let mut looseness = Vec::new();
        for pair in &table() {
            for Estimate { value, bound, .. } in pair.estimates(tolerance) {
                let error = (value - pair.truth).abs();
                assert!(error <= bound, "{}: error {error:e}, bound {bound:e}", pair.name);
                looseness.push(bound / error.max(1e-14 * pair.smaller()));
            }
        }
        looseness.sort_by(f64::total_cmp);
        let median = looseness[looseness.len() / 2];
        assert!(median <= 100.0, "{median} at a tolerance of {tolerance:e}");
    }
}

/// Nothing is compared with an absolute length: powers of two change no bit.
#[test]
fn scaling_by_powers_of_two_is_exact() {
    for pair in &table() {
        for exponent in [-60, 60] {
            let scale = 2.0_f64.powi(exponent);
            let scaled =
                |p: &Polygon| Polygon::new(&p.vertices().iter().map(|v| *v * scale).collect::<Vec<_>>()).unwrap();
            let (here, there) = (
                unoccluded(&pair.i, &pair.j, TOLERANCES[0]),
                unoccluded(&scaled(&pair.i), &scaled(&pair.j), TOLERANCES[0]),
            );
            assert_eq!(there.value, here.value * scale * scale, "{} by 2^{exponent}", pair.name);
            assert_eq!(there.bound, here.bound * scale * scale, "{} by 2^{exponent}", pair.name);
        }
    }
}

fn quad(corners: [[f64; 3]; 4]) -> Polygon {
    Polygon::new(&corners.map(DVec3::from_array)).unwrap()
}

/// Asserts that the parts of j have the exchange area of the whole, within all bounds.
fn assert_additive(i: &Polygon, j: &Polygon, parts: &[Polygon], what: &str) {
    for tolerance in TOLERANCES {
        let whole = unoccluded(i, j, tolerance);
        let (mut value, mut bound) = (0.0, whole.bound);
        for part in parts {
            let part = unoccluded(i, part, tolerance);
            value += part.value;
            bound += part.bound;
        }
        let error = (whole.value - value).abs();
        assert!(error <= bound, "{what}, {tolerance:e}: {error:e} apart, bounds {bound:e}");
        assert!(error <= 1e-9 * j.area(), "{what}, {tolerance:e}: {:e} apart", error / j.area());
    }
}

/// Halves of a wall are narrower than the whole, so that every border between contour integrals and point factors lies
/// between a whole and its parts: on the floor, and above it.
#[test]
fn contour_and_point_factors_agree_across_their_border() {
    let floor = quad([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    let wall = |lo: f64, hi: f64| quad([[0.0, 0.0, lo], [0.0, 1.0, lo], [0.0, 1.0, hi], [0.0, 0.0, hi]]);
    for step in 0..50 {
        let h = 0.7_f64.powi(step);
        for lo in [0.0, 0.3 * h, 0.1] {
            let parts = [wall(lo, lo + 0.4 * h), wall(lo + 0.4 * h, lo + h)];
            assert_additive(&floor, &wall(lo, lo + h), &parts, &format!("wall of {h:e} at {lo:e}"));
        }
    }
}

/// Smaller and smaller patches under a corner and beside it: closed forms of parallel edges give way to Gauss rules, and
/// contour integrals to point factors.
#[test]
fn near_rules_agree_as_sizes_part() {
    let floor = quad([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    for step in 0..40 {
        let a = 0.6_f64.powi(step);
        for (x, z) in [(-0.5 * a, a), (0.3, a), (1.0, 0.3)] {
            // Parts and whole share their corners to the last bit.
            let borders = [x, x + 0.5 * a, x + a];
            let patch = |[k0, k1]: [usize; 2], [l0, l1]: [usize; 2]| {
                let (x0, x1, y0, y1) = (borders[k0], borders[k1], borders[l0], borders[l1]);
                quad([[x0, y0, z], [x0, y1, z], [x1, y1, z], [x1, y0, z]])
            };
            let halves = [[0, 1], [1, 2]];
            let parts = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(k, l)| patch(halves[k], halves[l]));
            assert_additive(&floor, &patch([0, 2], [0, 2]), &parts, &format!("patch of {a:e} at {x:e}, {z:e}"));
        }
    }
}

/// Edges that are parallel to rounding have a closed form, others a quadrature: turning by less and less passes the border.
#[test]
fn nearly_parallel_edges_agree_with_parallel_ones() {
    let floor = quad([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    for step in 0..60 {
        let (s, c) = (0.5_f64.powi(step)).sin_cos();
        let turned = |x: f64, y: f64| [0.3 + c * x - s * y, 0.2 + s * x + c * y, 0.25];
        let lid = |lo: f64, hi: f64| quad([turned(lo, 0.0), turned(lo, 1.0), turned(hi, 1.0), turned(hi, 0.0)]);
        let parts = [lid(0.0, 0.35), lid(0.35, 1.0)];
        assert_additive(&floor, &lid(0.0, 1.0), &parts, &format!("turned by 2^-{step}"));
    }
}
