//! Partly hidden pairs, exact to what is asked: against closed forms of what each point sees, integrated with the kinks split by hand,
//! and against a brute-force sum of point factors.

use glam::{DMat3, DQuat, DVec3};
use radiosity_form_factors::analytic::{Analytic, PartialVisibility, unoccluded};
use radiosity_form_factors::point::form_factors_from;
use radiosity_form_factors::{Estimate, Pairwise};
use radiosity_geometry::{Facets, Occluders, Polygon};

/// Error of the unoccluded factors: well below what is asked of the partial ones.
const UNOCCLUDED: f64 = 1e-11;

const UNIT: [f64; 4] = [-0.5, 0.5, -0.5, 0.5];

fn polygon(corners: &[DVec3]) -> Polygon {
    Polygon::new(corners).unwrap()
}

/// A rectangle [x₀, x₁] × [y₀, y₁] on z = height that looks up or down.
fn level([x0, x1, y0, y1]: [f64; 4], height: f64, up: bool) -> Polygon {
    let mut corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)].map(|(x, y)| DVec3::new(x, y, height));
    if !up {
        corners.reverse();
    }
    polygon(&corners)
}

/// A wall over the segment from a to b in the floor, from z = low to high; seen from above it looks to the left of the way from a to b.
fn wall((ax, ay): (f64, f64), (bx, by): (f64, f64), low: f64, high: f64) -> Polygon {
    let v = |x, y, z| DVec3::new(x, y, z);
    polygon(&[v(bx, by, low), v(ax, ay, low), v(ax, ay, high), v(bx, by, high)])
}

/// The unit squares one above the other.
fn squares() -> (Polygon, Polygon) {
    (level(UNIT, 0.0, true), level(UNIT, 1.0, false))
}

fn among(blockers: &[Polygon]) -> Occluders {
    Occluders::new(blockers.to_vec(), (0..blockers.len() as u32).collect())
}

fn exchange(i: &Polygon, j: &Polygon, blockers: &Occluders, tolerance: f64) -> Estimate {
    let exact = PartialVisibility::Exact { tolerance };
    Analytic::new(Some(blockers)).partial_visibility(exact).exchange(i, j, UNOCCLUDED, 1)
}

/// What is asked is met, whichever polygon comes first, and the stated error covers the true one.
fn check(name: &str, (i, j): (&Polygon, &Polygon), blockers: &[Polygon], truth: f64) {
    let occluders = among(blockers);
    for tolerance in [1e-3, 1e-5, 1e-7, 1e-9] {
        for (a, b) in [(i, j), (j, i)] {
            let found = exchange(a, b, &occluders, tolerance);
            let error = (found.value - truth).abs() / i.area().min(j.area());
            assert!(error <= tolerance && error <= found.bound, "{name} to {tolerance:e}: off by {error:e}, {found:?}");
            assert_eq!(found.cost.partial_pairs, 1, "{name}");
        }
    }
}

/// The form factor from a point to a parallel rectangle is a sum over its corners (Howell B-4). A blocker's projection, cut to the
/// receiver, is such a rectangle, and overlapping ones are joined by inclusion and exclusion; the integral over the lower square has
/// its kinks where projected edges meet edges. Gauss rules of 24 × 24 points between them, on whole and on halved panels,
/// agree to 1e-16.
#[test]
fn parallel_squares_with_sheets_between_are_right_to_what_is_asked() {
    let (i, j) = squares();
    let sheet = [-0.1, 0.3, -0.2, 0.25];
    let depths = [
        (0.001, 1.585_962_065_285_511e-1),
        (0.01, 1.580_491_502_395_713e-1),
        (0.1, 1.520_042_123_099_637e-1),
        (0.3, 1.352_606_277_817_343e-1),
        (0.7, 1.352_606_277_817_343e-1),
        (0.99, 1.580_491_502_395_712e-1),
        (0.999, 1.585_962_065_285_511e-1),
    ];
    for (depth, truth) in depths {
        check(&format!("at {depth}"), (&i, &j), &[level(sheet, depth, true)], truth);
    }
    let (a, b, c) = ([-0.3, 0.1, -0.2, 0.25], [-0.1, 0.35, -0.3, 0.1], [-0.2, 0.2, -0.15, 0.3]);
    let sheets = [level(a, 0.3, true), level(b, 0.6, false), level(c, 0.8, true)];
    check("two that overlap", (&i, &j), &sheets[..2], 9.418_138_295_848_924e-2);
    check("three that overlap", (&i, &j), &sheets, 7.879_218_918_423_553e-2);
}

/// References as in the test above.
#[test]
fn thin_strips_and_windows_are_right_to_what_is_asked() {
    let (i, j) = squares();
    check("a strip", (&i, &j), &[level([-0.001, 0.001, -2.0, 2.0], 0.4, true)], 1.992_167_145_849_578e-1);
    check("a short strip", (&i, &j), &[level([0.1, 0.102, -0.3, 0.1], 0.4, true)], 1.994_939_719_556_331e-1);
    let window = |[x0, x1, y0, y1]: [f64; 4]| {
        [[-9.0, x0, -9.0, 9.0], [x1, 9.0, -9.0, 9.0], [x0, x1, -9.0, y0], [x0, x1, y1, 9.0]]
            .map(|r| level(r, 0.5, true))
    };
    check("a window", (&i, &j), &window([-0.2, 0.3, -0.1, 0.25]), 7.169_472_294_250_029e-2);
    check("a slit", (&i, &j), &window([-0.001, 0.001, -0.3, 0.3]), 5.366_885_409_459_681e-4);
}

/// A wall that hangs from the receiver hides from a point what lies between its foot and the projection of its lower edge: a rectangle.
/// References as above.
#[test]
fn a_wall_that_touches_the_receiver_is_right_to_what_is_asked() {
    let (i, j) = squares();
    for (low, truth) in [(0.6, 1.701_674_265_901_636e-1), (0.05, 1.226_544_778_635_079e-1)] {
        check(&format!("from {low}"), (&i, &j), &[wall((0.1, -2.0), (0.1, 2.0), low, 1.0)], truth);
    }
}

/// A square room of side 2 without a quarter: from one wing the other is seen past the corner at (1, 1). From (x, y) what is seen of the
/// ceiling lies below the line through that corner; its kinks are on the lines through the corner and those of the
/// receiver. References: Lambert's sum over the cut rectangle, Gauss rules of 24 × 24 points between these lines.
#[test]
fn wings_of_an_l_shaped_room_see_each_other_past_the_corner() {
    let (floor, ceiling) = (level([0.0, 1.0, 1.2, 2.0], 0.0, true), level([1.2, 2.0, 0.0, 1.0], 1.0, false));
    let corner = [wall((1.0, 2.0), (1.0, 1.0), 0.0, 1.0), wall((1.0, 1.0), (2.0, 1.0), 0.0, 1.0)];
    check("round the corner", (&floor, &ceiling), &corner, 5.262_815_349_487_397e-3);
}

/// All of the room of the test above: 20 patches, of whose factors each is asked for 1e-8, in rows that sum to 1.
#[test]
fn rows_of_an_l_shaped_room_sum_to_1() {
    let squares = [[0.0, 1.0, 0.0, 1.0], [1.0, 2.0, 0.0, 1.0], [0.0, 1.0, 1.0, 2.0]];
    let mut patches: Vec<Polygon> = squares.iter().flat_map(|&r| [level(r, 0.0, true), level(r, 1.0, false)]).collect();
    let plan = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0), (0.0, 0.0)];
    let walls: Vec<Polygon> = plan.windows(2).map(|w| wall(w[0], w[1], 0.0, 1.0)).collect();
    patches.extend(walls.iter().cloned());
    let occluders = among(&walls[2..4]);
    for (k, i) in patches.iter().enumerate() {
        let row = patches.iter().enumerate().filter(|(l, _)| *l != k);
        let sum: f64 = row.map(|(_, j)| exchange(i, j, &occluders, 1e-8).value).sum();
        // Eleven partners, each to 1e-8 of the smaller of two areas.
        assert!((sum / i.area() - 1.0).abs() < 1.1e-7, "row {k}: {sum}");
    }
}

/// A small deterministic generator (Marsaglia's xorshift).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    /// A quadrilateral or triangle about a point, turned any way.
    fn polygon(&mut self, at: DVec3, size: f64, tilt: f64) -> Polygon {
        let axis = DVec3::new(self.between(-1.0, 1.0), self.between(-1.0, 1.0), 0.0);
        let turn = DQuat::from_axis_angle(axis.normalize(), self.between(-tilt, tilt));
        let count = if self.next() < 0.3 { 3 } else { 4 };
        let radius = size * self.between(0.5, 1.0);
        let phase = self.between(0.0, 6.0);
        let corners: Vec<DVec3> = (0..count)
            .map(|k| {
                let angle = phase + (k as f64 + self.between(-0.2, 0.2)) * std::f64::consts::TAU / count as f64;
                at + turn * DVec3::new(radius * angle.cos(), radius * angle.sin(), 0.0)
            })
            .collect();
        polygon(&corners)
    }

    /// A pair one above the other with up to four blockers between.
    fn case(&mut self) -> (Polygon, Polygon, Vec<Polygon>) {
        let i = self.polygon(DVec3::ZERO, 0.7, 0.4);
        let above = DVec3::new(self.between(-0.5, 0.5), self.between(-0.5, 0.5), 1.5);
        let j = self.polygon(above, 0.7, 0.4);
        let j = polygon(&j.vertices().iter().rev().copied().collect::<Vec<_>>());
        let count = 1 + (self.next() * 4.0) as usize;
        let blockers = (0..count).map(|_| {
            let at = DVec3::new(self.between(-0.4, 0.4), self.between(-0.4, 0.4), self.between(0.5, 1.0));
            let size = self.between(0.05, 0.5);
            self.polygon(at, size, 3.0)
        });
        let blockers = blockers.collect();
        (i, j, blockers)
    }
}

/// 200 pairs with up to four blockers of any position: from 1e-3 to 1e-7 the error against an answer to 1e-9 is never more than asked.
#[test]
fn adaptive_answers_are_never_worse_than_asked() {
    let (mut random, mut partial) = (Random(0x2545_f491_4f6c_dd1d), 0);
    for case in 0..200 {
        let (i, j, blockers) = random.case();
        let occluders = among(&blockers);
        let smaller = i.area().min(j.area());
        let best = exchange(&i, &j, &occluders, 1e-9);
        partial += best.cost.partial_pairs;
        for tolerance in [1e-3, 1e-5, 1e-7] {
            let found = exchange(&i, &j, &occluders, tolerance);
            let error = (found.value - best.value).abs() / smaller;
            assert!(error <= tolerance, "case {case}, {tolerance:e}: {error:e} {found:?} {best:?}");
        }
    }
    assert!(partial > 150, "{partial} of 200 are partly hidden");
}

/// The same cases against the exact factors of [`form_factors_from`] from 48 × 48 points: with kinks anywhere such a sum is off by some
/// (1/48)² of what it sums.
#[test]
fn adaptive_answers_agree_with_a_sum_of_point_factors() {
    let mut random = Random(0x2545_f491_4f6c_dd1d);
    for case in 0..40 {
        let (i, j, blockers) = random.case();
        let found = exchange(&i, &j, &among(&blockers), 1e-7).value;
        let mut facets = Facets::new();
        facets.push(vec![j.clone()], false);
        let n = 48;
        let at = |k: usize| (k as f64 + 0.5) / n as f64;
        let points = (0..n * n).map(|k| i.sample(at(k / n), at(k % n)));
        let sum: f64 = points.map(|x| form_factors_from(x, i.normal(), &facets, &blockers)[0]).sum();
        let brute = sum * i.area() / (n * n) as f64;
        assert!((found - brute).abs() < 5e-4 * i.area(), "case {case}: {found} {brute}");
    }
}

/// Scaling, turning and moving a scene changes nothing but rounding, and the refinement may take another way within what is asked.
#[test]
fn scale_and_rotation_change_nothing() {
    let mut random = Random(99);
    let turn = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 1.1));
    for case in 0..30 {
        let (i, j, blockers) = random.case();
        let here = exchange(&i, &j, &among(&blockers), 1e-8).value;
        for scale in [1e-3, 1.0, 1e3] {
            let place = |p: &Polygon| {
                let corners = p.vertices().iter().map(|v| turn * *v * scale + DVec3::new(3.0, -1.0, 2.0) * scale);
                polygon(&corners.collect::<Vec<_>>())
            };
            let moved: Vec<Polygon> = blockers.iter().map(place).collect();
            let there = exchange(&place(&i), &place(&j), &among(&moved), 1e-8).value / (scale * scale);
            let difference = (here - there).abs() / i.area().min(j.area());
            assert!(difference < 2e-8, "case {case}, scale {scale}: {difference:e}");
        }
    }
}

/// 6 × 6 sheets at different heights, far more overlaps than inclusion and exclusion could list, cover a rectangle: they hide what it hides.
#[test]
fn many_sheets_at_different_heights_hide_what_they_cover() {
    let (i, j) = squares();
    let sheet = |k: usize| {
        let x = -0.3 + 0.1 * (k % 6) as f64;
        // Each reaches under the next and rises a little: together no light gets through but round the outside.
        level([x, x + 0.12, -0.3, 0.3], 0.5 + 1e-9 * k as f64, true)
    };
    let sheets: Vec<Polygon> = (0..36).map(sheet).collect();
    let one = [level([-0.3, 0.32, -0.3, 0.3], 0.5, true)];
    let (many, whole) = (exchange(&i, &j, &among(&sheets), 1e-6), exchange(&i, &j, &among(&one), 1e-9));
    // Heights differ by 4e-8, and so do the shadows.
    assert!((many.value - whole.value).abs() < 1.1e-6, "{many:?} {whole:?}");
}

/// What no point sees is exactly 0, even where it takes two sheets to hide it.
#[test]
fn what_two_sheets_hide_together_is_0() {
    let (i, j) = squares();
    let halves = [level([-2.0, 0.0, -2.0, 2.0], 0.5, true), level([0.0, 2.0, -2.0, 2.0], 0.5, true)];
    let found = exchange(&i, &j, &among(&halves), 1e-6);
    assert!(found.value < 1e-12, "{found:?}");
}

/// A closed box between the squares hides what its silhouette hides: the same faces with their edges not shared are looked at one by
/// one, and give the same; so does the box without its top, which points below do not see.
#[test]
fn bodies_hide_what_their_faces_hide() {
    let (i, j) = squares();
    let (lo, hi) = (DVec3::new(-0.2, -0.15, 0.3), DVec3::new(0.25, 0.3, 0.6));
    let v = |k: usize| DVec3::new([lo.x, hi.x][k & 1], [lo.y, hi.y][k >> 1 & 1], [lo.z, hi.z][k >> 2 & 1]);
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let body: Vec<Polygon> = faces.iter().map(|f| polygon(&f.map(v))).collect();
    // Moved by less than any tolerance, so that no corners are equal.
    let loose: Vec<Polygon> = (0..6)
        .map(|k| polygon(&body[k].vertices().iter().map(|v| *v + DVec3::splat(1e-13 * k as f64)).collect::<Vec<_>>()))
        .collect();
    let topless: Vec<Polygon> = [0, 2, 3, 4, 5].map(|k| body[k].clone()).to_vec();
    let [whole, apart, open] = [&body, &loose, &topless].map(|b| exchange(&i, &j, &among(b), 1e-9).value);
    assert!((whole - apart).abs() < 2e-9 && (whole - open).abs() < 2e-9, "{whole} {apart} {open}");
    assert!(whole < 0.9 * unoccluded(&i, &j, 1e-9).value);
}
