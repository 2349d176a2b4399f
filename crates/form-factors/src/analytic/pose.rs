//! How two cells lie to each other, many pairs side by side: heights, orders, and the product rule.
//!
//! With R from the centre of the first cell to that of the second, points x = s u + t v + s t w of the first and
//! y = a u' + b v' + a b w' of the second,
//!
//! ```text
//! |R + y − x|² = (|R|² + 2 R·y + |y|²) + (|x|² − 2 R·x) − 2 x·y
//! ```
//!
//! in which every product of vectors is taken once a pair: a point pair costs two or three sums of products. Heights over
//! the partner's plane are linear in (s, t) up to s t. Quotients are summed over a common denominator, four at a time:
//! a division takes as long as ten sums. Lengths are scaled so that eighth powers of squared distances neither overflow nor vanish.

use std::f64::consts::PI;

use pulp::Simd;

use super::gauss::{MAX_ORDER, gauss};
use super::lanes::{Lane, Lane3, Load, Mask};
use super::order::{Line, Orders, orders};
use super::patch::Patch;

/// Kernel evaluations a pair may cost; beyond it the contour rule is cheaper.
pub(super) const MAX_EVALUATIONS: usize = 2500;

/// Rounding of a sum, relative: a squared distance is a sum of terms that may be some times larger than it.
pub(super) const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// Points of a cell at the highest order.
const CAPACITY: usize = MAX_ORDER * MAX_ORDER;

/// Terms that share one division.
const SHARED: usize = 4;

/// One cell of a pair as the other sees it.
#[derive(Clone, Copy)]
pub(super) struct Seen<S: Simd> {
    /// Products of the way between the centres with u, v and w.
    along: [Lane<S>; 3],
    /// Height of the centre over the partner's plane, and its slopes along u, v and w.
    height: [Lane<S>; 4],
}

impl<S: Simd> Seen<S> {
    /// A patch, `way` between the centres, the partner's normal, and the height of the centre over the partner's plane.
    #[inline(always)]
    fn new<T: Load<S>, const TWISTED: bool>(
        simd: S,
        patch: &Patch<T>,
        part: usize,
        way: Lane3<S>,
        normal: Lane3<S>,
        height: Lane<S>,
    ) -> Self {
        let (u, v) = (Lane3::load(simd, &patch.u, part), Lane3::load(simd, &patch.v, part));
        let zero = height.all(0.0);
        let mut seen =
            Self { along: [way.dot(u), way.dot(v), zero], height: [height, normal.dot(u), normal.dot(v), zero] };
        if TWISTED {
            let w = Lane3::load(simd, &patch.w, part);
            (seen.along[2], seen.height[3]) = (way.dot(w), normal.dot(w));
        }
        seen
    }

    /// Lowest and highest corner over the partner's plane.
    #[inline(always)]
    fn heights(&self) -> (Lane<S>, Lane<S>) {
        let [c, u, v, w] = self.height;
        let (odd, even) = ((u - v).abs(), (u + v).abs());
        (c - (odd + w).max(even - w), c + (odd - w).max(even + w))
    }
}

/// Two cells, and the numbers that all rules for them use.
pub(super) struct Pose<'a, S: Simd, A, B> {
    simd: S,
    a: &'a Patch<A>,
    b: &'a Patch<B>,
    part: usize,
    /// |R|².
    r2: Lane<S>,
    seen: [Seen<S>; 2],
    /// Lowest and highest corner of each cell over the partner's plane.
    heights: [(Lane<S>, Lane<S>); 2],
}

impl<'a, S: Simd, A: Load<S>, B: Load<S>> Pose<'a, S, A, B> {
    /// Lanes `part` of the pairs of `a` with `b`; with TWISTED false every w is zero.
    #[inline(always)]
    pub fn new<const TWISTED: bool>(simd: S, a: &'a Patch<A>, b: &'a Patch<B>, part: usize) -> Self {
        let r = (Lane3::load(simd, &b.p, part) - Lane3::load(simd, &a.p, part))
            + (Lane3::load(simd, &b.c, part) - Lane3::load(simd, &a.c, part));
        let (n_a, n_b) = (Lane3::load(simd, &a.n, part), Lane3::load(simd, &b.n, part));
        let first = Seen::new::<A, TWISTED>(simd, a, part, r, n_b, b.offset.lane(simd, part) - r.dot(n_b));
        let second = Seen::new::<B, TWISTED>(simd, b, part, r, n_a, a.offset.lane(simd, part) + r.dot(n_a));
        let heights = [first.heights(), second.heights()];
        Self { simd, a, b, part, r2: r.dot(r), seen: [first, second], heights }
    }

    #[inline(always)]
    fn a<const N: usize>(&self, of: &[A; N]) -> [Lane<S>; N] {
        load(self.simd, of, self.part)
    }

    #[inline(always)]
    fn b<const N: usize>(&self, of: &[B; N]) -> [Lane<S>; N] {
        load(self.simd, of, self.part)
    }

    #[inline(always)]
    fn both(&self, of_a: &A, of_b: &B) -> [Lane<S>; 2] {
        [of_a.lane(self.simd, self.part), of_b.lane(self.simd, self.part)]
    }

    /// Pairs of which one lies wholly behind the other's plane; and of the others those whose place is not certain beyond
    /// rounding, that need clipping, or that are no cells.
    #[inline(always)]
    pub fn sides(&self) -> (Mask<S>, Mask<S>) {
        let [r_a, r_b] = self.both(&self.a.rounding, &self.b.rounding);
        let [t_a, t_b] = self.both(&self.a.thickness, &self.b.thickness);
        let [e_a, e_b] = self.both(&self.a.edge, &self.b.edge);
        let [ready_a, ready_b] = self.both(&self.a.ready, &self.b.ready);
        let slack = r_a.max(r_b) + (t_a + t_b) * t_a.all(2.0);
        let (half, twice) = (slack * slack.all(0.5), slack + slack);
        let [(low_a, high_a), (low_b, high_b)] = self.heights;
        let behind = high_a.min(high_b).at_most(half);
        let doubtful = high_a.min(high_b).min(e_a.min(e_b)).at_most(twice).or(low_a.min(low_b).at_most(-half));
        // Products of sixteen distances must stay numbers.
        let extreme = self.r2.at_most(half.all(1e-30)).or(half.all(1e30).at_most(self.r2));
        let ready = ready_a * ready_b;
        let single = ready.at_most(ready.all(0.5)).or(doubtful).or(extreme);
        (ready.all(1.0).at_most(ready).and(behind), single)
    }

    /// The smaller area.
    #[inline(always)]
    pub fn smaller(&self) -> Lane<S> {
        let [a, b] = self.both(&self.a.area, &self.b.area);
        a.min(b)
    }

    /// By how much corners that miss a plane move the value.
    #[inline(always)]
    pub fn uneven(&self) -> Lane<S> {
        let [t_a, t_b] = self.both(&self.a.thickness, &self.b.thickness);
        let [p_a, p_b] = self.both(&self.a.perimeter, &self.b.perimeter);
        (t_a + t_b) * t_a.all(2.0) * p_a.min(p_b)
    }

    /// Orders for an error of at most `absolute`, and of `relative` times what the value would be if both patches were at
    /// their centres with the largest cosines. Lanes where `idle` is not 0 need none.
    #[inline(always)]
    pub fn orders<const TWISTED: bool>(&self, absolute: Lane<S>, relative: f64, idle: Lane<S>) -> Orders<S> {
        let one = absolute.all(1.0);
        let distance = self.r2.sqrt();
        let way = one / distance;
        let [area_a, area_b] = self.both(&self.a.area, &self.b.area);
        let areas = area_a * area_b * one.all(1.0 / PI);
        let (top_a, top_b) = (self.heights[0].1, self.heights[1].1); // N_j, N_i
        let way2 = way * way;
        let centred = areas * top_a * top_b * (way2 * way2);
        let target = absolute.min(centred * one.all(relative)) * one.all(0.25);
        let mut shares = [[one; 3]; 2];
        for (shares, seen) in shares.iter_mut().zip(&self.seen) {
            for (share, along) in shares.iter_mut().zip(&seen.along) {
                *share = along.abs() * way;
            }
        }
        let [radius_a, radius_b] = self.both(&self.a.radius, &self.b.radius);
        let shape_a = Shape {
            half: self.a(&self.a.half),
            length: self.a(&self.a.length),
            inverse: self.a(&self.a.inverse),
            turn: self.a(&self.a.turn),
            kappa: self.a(&self.a.kappa),
            radius: radius_b,
            shares: shares[0],
            room: distance - shares[1][0] - shares[1][1] - shares[1][2],
            height: self.seen[0].height,
            way,
            scale: areas * top_b,
            top: top_a,
        };
        let shape_b = Shape {
            half: self.b(&self.b.half),
            length: self.b(&self.b.length),
            inverse: self.b(&self.b.inverse),
            turn: self.b(&self.b.turn),
            kappa: self.b(&self.b.kappa),
            radius: radius_a,
            shares: shares[1],
            room: distance - shares[0][0] - shares[0][1] - shares[0][2],
            height: self.seen[1].height,
            way,
            scale: areas * top_a,
            top: top_b,
        };
        let lines = [
            shape_a.line::<TWISTED>(0),
            shape_a.line::<TWISTED>(1),
            shape_b.line::<TWISTED>(0),
            shape_b.line::<TWISTED>(1),
        ];
        let mut found = orders::<S, TWISTED>(&lines, target, idle);
        // Rounding turns a normal by about ε · size²/area, which moves the heights over its plane.
        let [stretch_a, stretch_b] = self.both(&self.a.stretch, &self.b.stretch);
        let turned = stretch_a.fma(top_a, stretch_b * top_b) * one.all(f64::EPSILON);
        found.bound = found.bound + areas * turned * (way2 * way);
        found
    }

    /// The product rule of orders q over the first and q over the second cell: A_i F_ij.
    #[inline(always)]
    pub fn integrate<const TWISTED: bool>(&self, q: [usize; 4]) -> Lane<S> {
        match q {
            [2, 2, 2, 2] => self.product::<TWISTED, 2, 4>(q),
            [3, 3, 3, 3] => self.product::<TWISTED, 3, 9>(q),
            [q_s, q_t, ..] if q_s * q_t <= 16 => self.product::<TWISTED, 0, 16>(q),
            _ => self.product::<TWISTED, 0, CAPACITY>(q),
        }
    }

    /// [`Self::integrate`] with at most N points of the first cell; where Q is not 0 it is the order of all directions, so that
    /// the loops are unrolled.
    #[inline(always)]
    fn product<const TWISTED: bool, const Q: usize, const N: usize>(&self, q: [usize; 4]) -> Lane<S> {
        let q = if Q > 0 { [Q; 4] } else { q };
        let x = self.first_points::<TWISTED, N>(q[0], q[1]);
        let x = &x[..q[0] * q[1]];
        let zero = self.r2.all(0.0);
        let (u, v) = (Lane3::load(self.simd, &self.b.u, self.part), Lane3::load(self.simd, &self.b.v, self.part));
        let (cross_u, cross_v) = (self.with_first::<TWISTED>(u), self.with_first::<TWISTED>(v));
        let cross_w =
            if TWISTED { self.with_first::<TWISTED>(Lane3::load(self.simd, &self.b.w, self.part)) } else { [zero; 3] };
        let Seen { along: [along_u, along_v, along_w], height } = self.seen[1];
        let (kappa, gram) = (self.b(&self.b.kappa), self.b(&self.b.gram));
        let ((nodes_s, weights_s), (nodes_t, weights_t)) = (gauss(q[2]), gauss(q[3]));
        let mut total = zero;
        for (&s, &w_s) in nodes_s.iter().zip(weights_s) {
            for (&t, &w_t) in nodes_t.iter().zip(weights_t) {
                let (ls, lt, st) = (zero.all(s), zero.all(t), zero.all(s * t));
                let mut along = along_u.fma(ls, along_v * lt);
                let mut ways = [zero; 3];
                for k in 0..3 {
                    ways[k] = cross_u[k].fma(ls, cross_v[k] * lt);
                    if TWISTED {
                        ways[k] = cross_w[k].fma(st, ways[k]);
                    }
                }
                if TWISTED {
                    along = along_w.fma(st, along);
                }
                let form = self.r2 + (along + along) + square::<S, TWISTED>(&gram, s, t);
                let weight = weight::<S, TWISTED>(&height, &kappa, s, t, w_s * w_t);
                total = weight.fma(quotients::<S, TWISTED>(x, form, &ways), total);
            }
        }
        let [area_a, area_b] = self.both(&self.a.area, &self.b.area);
        total * (area_a * area_b) * zero.all(1.0 / PI)
    }

    /// Products of a vector with u, v and w of the first cell.
    #[inline(always)]
    fn with_first<const TWISTED: bool>(&self, y: Lane3<S>) -> [Lane<S>; 3] {
        let (u, v) = (Lane3::load(self.simd, &self.a.u, self.part), Lane3::load(self.simd, &self.a.v, self.part));
        let w = if TWISTED { Lane3::load(self.simd, &self.a.w, self.part).dot(y) } else { self.r2.all(0.0) };
        [u.dot(y), v.dot(y), w]
    }

    #[inline(always)]
    fn first_points<const TWISTED: bool, const N: usize>(&self, q_s: usize, q_t: usize) -> [Point<S>; N] {
        let ((nodes_s, weights_s), (nodes_t, weights_t)) = (gauss(q_s), gauss(q_t));
        let (gram, kappa, seen) = (self.a(&self.a.gram), self.a(&self.a.kappa), self.seen[0]);
        let zero = self.r2.all(0.0);
        let mut points = [Point { form: zero, weight: zero, s: 0.0, t: 0.0 }; N];
        let mut k = 0;
        for (&s, &w_s) in nodes_s.iter().zip(weights_s) {
            for (&t, &w_t) in nodes_t.iter().zip(weights_t) {
                let mut along = seen.along[0].fma(zero.all(s), seen.along[1] * zero.all(t));
                if TWISTED {
                    along = seen.along[2].fma(zero.all(s * t), along);
                }
                let form = square::<S, TWISTED>(&gram, s, t) - (along + along);
                let weight = weight::<S, TWISTED>(&seen.height, &kappa, s, t, w_s * w_t);
                points[k] = Point { form, weight, s, t };
                k += 1;
            }
        }
        points
    }
}

/// All lanes of some numbers.
#[inline(always)]
fn load<S: Simd, T: Load<S>, const N: usize>(simd: S, of: &[T; N], part: usize) -> [Lane<S>; N] {
    let mut lanes = [of[0].lane(simd, part); N];
    for (lane, number) in lanes.iter_mut().zip(of) {
        *lane = number.lane(simd, part);
    }
    lanes
}

/// One cell of a pair as the bound sees it; indices are those of its two directions.
struct Shape<S: Simd> {
    half: [Lane<S>; 2],
    length: [Lane<S>; 2],
    inverse: [Lane<S>; 2],
    turn: [Lane<S>; 2],
    kappa: [Lane<S>; 2],
    /// Radius of the partner.
    radius: Lane<S>,
    /// |u|, |v| and |w| along the way between the centres.
    shares: [Lane<S>; 3],
    /// Distance between the centres less the reach of the partner.
    room: Lane<S>,
    height: [Lane<S>; 4],
    /// 1 / distance between the centres.
    way: Lane<S>,
    scale: Lane<S>,
    top: Lane<S>,
}

impl<S: Simd> Shape<S> {
    #[inline(always)]
    fn line<const TWISTED: bool>(&self, l: usize) -> Line<S> {
        let one = self.way.all(1.0);
        let mut spread = (self.length[1 - l] + self.radius) * self.way;
        let mut slope = self.height[1 + l].abs();
        if TWISTED {
            spread = spread + self.turn[l];
            slope = slope + self.height[3].abs();
        }
        Line {
            scale: self.scale,
            half: self.half[l],
            // Middles of the lines run along the other direction. Where nothing is left of the distance, σ = 1.
            distance: (self.room - self.shares[1 - l]).max(self.half[l]),
            cosine: (self.shares[l] * self.inverse[l]).min(one),
            spread: spread.min(one),
            top: self.top,
            slope,
            kappa: self.kappa[l].abs(),
        }
    }
}

/// A point of the first cell.
#[derive(Clone, Copy)]
struct Point<S: Simd> {
    /// |x|² − 2 R·x.
    form: Lane<S>,
    /// Weight, height over the partner's plane and Jacobian.
    weight: Lane<S>,
    s: f64,
    t: f64,
}

/// |s u + t v + s t w|².
#[inline(always)]
fn square<S: Simd, const TWISTED: bool>(gram: &[Lane<S>; 6], s: f64, t: f64) -> Lane<S> {
    let [uu, uv, vv, ww, uw, vw] = *gram;
    let flat = uu.fma(uu.all(s * s), uv.fma(uu.all(2.0 * s * t), vv * uu.all(t * t)));
    if TWISTED {
        let twist = uw.fma(uu.all(2.0 * s), vw.fma(uu.all(2.0 * t), ww * uu.all(s * t)));
        twist.fma(uu.all(s * t), flat)
    } else {
        flat
    }
}

/// Weight times height over the partner's plane times relative Jacobian.
#[inline(always)]
fn weight<S: Simd, const TWISTED: bool>(
    [c, u, v, w]: &[Lane<S>; 4],
    kappa: &[Lane<S>; 2],
    s: f64,
    t: f64,
    weight: f64,
) -> Lane<S> {
    let height = u.fma(c.all(s), v.fma(c.all(t), *c));
    if TWISTED {
        let height = w.fma(c.all(s * t), height);
        let jacobian = kappa[0].fma(c.all(s), kappa[1].fma(c.all(t), c.all(1.0)));
        height * c.all(weight) * jacobian
    } else {
        height * c.all(weight)
    }
}

/// Σ weight / r⁴ over the points x of the first cell, for a point y with `form` = |R|² + 2 R·y + |y|² and products `ways` of y
/// with u, v and w.
#[inline(always)]
fn quotients<S: Simd, const TWISTED: bool>(x: &[Point<S>], form: Lane<S>, ways: &[Lane<S>; 3]) -> Lane<S> {
    let mut sum = form.all(0.0);
    let mut k = 0;
    while k < x.len() {
        let mut numerator = form.all(0.0);
        let mut denominator = form.all(1.0);
        for (l, point) in x[k..(k + SHARED).min(x.len())].iter().enumerate() {
            let mut r2 = ways[0].fma(form.all(-2.0 * point.s), form + point.form);
            r2 = ways[1].fma(form.all(-2.0 * point.t), r2);
            if TWISTED {
                r2 = ways[2].fma(form.all(-2.0 * point.s * point.t), r2);
            }
            let r4 = r2 * r2;
            if l == 0 {
                (numerator, denominator) = (point.weight, r4);
            } else {
                numerator = numerator.fma(r4, point.weight * denominator);
                denominator = denominator * r4;
            }
        }
        sum = sum + numerator / denominator;
        k += SHARED;
    }
    sum
}
