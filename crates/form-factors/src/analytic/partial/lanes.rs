//! Lambert's edge sum over clipped arcs at many points, a vector of points at a time.
//!
//! ```text
//! F = 1/(2π) Σ_arcs w · n·(b × a)/|b × a| · γ,     γ = atan2(|p₁ × p₀|, p₁·p₀)
//! ```
//!
//! with a, b the ends of an edge as seen from the point, and p₀, p₁ those of the part of it inside all half-spaces that clip it. A
//! half-space's boundary goes through the point, an edge and a corner, and the height of the edge's end over it is a determinant of four
//! points, linear in the point. With heights h_a < 0 < h_b the cut is at h_b a − h_a b up to a factor, which no angle depends on: nothing
//! is divided, and nothing branches. The angle comes from a polynomial for atan on [0, tan π/8] that is right to 2e-18.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};
use std::ops::Range;

use glam::DVec3;
use pulp::{Arch, Simd, WithSimd};

/// Multiple to which lists of points are padded: the widest vector.
pub(super) const LANES: usize = 8;

/// tan π/8.
const FOLD: f64 = std::f64::consts::SQRT_2 - 1.0;

/// atan(t)/t as a polynomial in t² on [0, tan² π/8]: interpolation at Chebyshev's points in 40 digits.
const ATAN: [f64; 12] = [
    1.0,
    -0.3333333333333312,
    0.19999999999940893,
    -0.14285714279250245,
    0.11111110744919658,
    -0.09090896809064027,
    0.07692045330902225,
    -0.06662951813629191,
    0.05846878297330872,
    -0.05035102456601552,
    0.03796525745386593,
    -0.017805397205419446,
];

/// Heights of the two ends of an edge over a plane through the point (s, t, 0): c + s·x + t·y, three numbers each.
pub(super) type Clip = [[f64; 3]; 2];

/// An edge from `a` to `a + e` with a weight, clipped by some of the planes of an [`Arcs`].
#[derive(Clone, Debug)]
struct Arc {
    a: DVec3,
    e: DVec3,
    weight: f64,
    clips: Range<usize>,
}

/// Edges whose clipped arcs make a form factor.
#[derive(Clone, Debug, Default)]
pub(super) struct Arcs {
    arcs: Vec<Arc>,
    clips: Vec<Clip>,
}

impl Arcs {
    /// Adds the edge from `a` to `b`, clipped by half-spaces.
    pub fn push(&mut self, a: DVec3, b: DVec3, weight: f64, clips: impl Iterator<Item = Clip>) {
        let begin = self.clips.len();
        self.clips.extend(clips);
        self.arcs.push(Arc { a, e: b - a, weight, clips: begin..self.clips.len() });
    }

    /// The form factor from every point (s, t, 0) with normal z, added to `sums`; all of one length, a multiple of [`LANES`].
    pub fn add(&self, arch: Arch, s: &[f64], t: &[f64], sums: &mut [f64]) {
        if !self.arcs.is_empty() {
            arch.dispatch(Sum { arcs: self, s, t, sums });
        }
    }
}

/// A call of [`Arcs::add`] for the dispatcher.
struct Sum<'a> {
    arcs: &'a Arcs,
    s: &'a [f64],
    t: &'a [f64],
    sums: &'a mut [f64],
}

impl WithSimd for Sum<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (s, _) = S::as_simd_f64s(self.s);
        let (t, _) = S::as_simd_f64s(self.t);
        let (sums, _) = S::as_mut_simd_f64s(self.sums);
        for ((&s, &t), sum) in s.iter().zip(t).zip(sums) {
            let mut f = simd.splat_f64s(0.0);
            for arc in &self.arcs.arcs {
                f = simd.add_f64s(f, share(simd, arc, &self.arcs.clips[arc.clips.clone()], s, t));
            }
            *sum = simd.mul_add_f64s(f, simd.splat_f64s(1.0 / TAU), *sum);
        }
    }
}

/// One arc's part of 2π F.
#[inline(always)]
fn share<S: Simd>(simd: S, arc: &Arc, clips: &[Clip], s: S::f64s, t: S::f64s) -> S::f64s {
    let splat = |x: f64| simd.splat_f64s(x);
    let (add, sub, mul) =
        (|a, b| simd.add_f64s(a, b), |a, b| simd.sub_f64s(a, b), |a: S::f64s, b: S::f64s| simd.mul_f64s(a, b));
    let fma = |a, b, c| simd.mul_add_f64s(a, b, c);
    let zero = splat(0.0);
    // p₀ = α a + β b and p₁ = γ a + δ b.
    let (mut alpha, mut beta, mut gamma, mut delta) = (splat(1.0), zero, zero, splat(1.0));
    for [at_a, at_b] in clips {
        let height = |c: &[f64; 3]| fma(splat(c[1]), s, fma(splat(c[2]), t, splat(c[0])));
        let (h_a, h_b) = (height(at_a), height(at_b));
        // The later of two beginnings and the earlier of two ends. An edge wholly outside begins at b, or ends at a, for good.
        let (up, down) = (simd.max_f64s(h_b, zero), sub(zero, h_a));
        let later = simd.greater_than_f64s(mul(down, alpha), mul(beta, up));
        let begins = simd.and_m64s(later, simd.less_than_f64s(h_a, zero));
        alpha = simd.select_f64s(begins, up, alpha);
        beta = simd.select_f64s(begins, down, beta);
        let (up, down) = (simd.max_f64s(h_a, zero), sub(zero, h_b));
        let earlier = simd.less_than_f64s(mul(up, gamma), mul(delta, down));
        let ends = simd.and_m64s(earlier, simd.less_than_f64s(h_b, zero));
        gamma = simd.select_f64s(ends, down, gamma);
        delta = simd.select_f64s(ends, up, delta);
    }
    let (x, y, z) = (sub(splat(arc.a.x), s), sub(splat(arc.a.y), t), arc.a.z);
    let e = arc.e;
    // b × a = e × a, with the same digits however short the edge.
    let cross_x = sub(splat(e.y * z), mul(splat(e.z), y));
    let cross_y = sub(mul(splat(e.z), x), splat(e.x * z));
    let cross_z = sub(mul(splat(e.x), y), mul(splat(e.y), x));
    let length2 = fma(cross_x, cross_x, fma(cross_y, cross_y, mul(cross_z, cross_z)));
    let length = simd.sqrt_f64s(length2);
    let aa = fma(x, x, fma(y, y, splat(z * z)));
    let ae = fma(splat(e.x), x, fma(splat(e.y), y, splat(e.z * z)));
    let ab = add(aa, ae);
    let bb = add(ab, add(ae, splat(e.length_squared())));
    let (ad, bc) = (mul(alpha, delta), mul(beta, gamma));
    let sine = mul(sub(ad, bc), length);
    let cosine = fma(mul(alpha, gamma), aa, fma(add(ad, bc), ab, mul(mul(beta, delta), bb)));
    let angle = angle(simd, sine, cosine);
    let part = mul(simd.div_f64s(mul(cross_z, splat(arc.weight)), length), angle);
    simd.select_f64s(simd.greater_than_f64s(sine, zero), part, zero)
}

/// atan2(sine, cosine) for sine > 0.
#[inline(always)]
fn angle<S: Simd>(simd: S, sine: S::f64s, cosine: S::f64s) -> S::f64s {
    let splat = |x: f64| simd.splat_f64s(x);
    let adjacent = simd.max_f64s(cosine, simd.sub_f64s(splat(0.0), cosine));
    let (small, large) = (simd.min_f64s(sine, adjacent), simd.max_f64s(sine, adjacent));
    // atan t = π/4 + atan((t − 1)/(t + 1)) above tan π/8.
    let folded = simd.greater_than_f64s(small, simd.mul_f64s(splat(FOLD), large));
    let over = simd.select_f64s(folded, simd.sub_f64s(small, large), small);
    let under = simd.select_f64s(folded, simd.add_f64s(small, large), large);
    let r = simd.div_f64s(over, under);
    let u = simd.mul_f64s(r, r);
    let mut p = splat(ATAN[ATAN.len() - 1]);
    for &c in ATAN[..ATAN.len() - 1].iter().rev() {
        p = simd.mul_add_f64s(p, u, splat(c));
    }
    let base = simd.select_f64s(folded, splat(FRAC_PI_4), splat(0.0));
    let first = simd.mul_add_f64s(p, r, base);
    let steep = simd.greater_than_f64s(sine, adjacent);
    let quarter = simd.select_f64s(steep, simd.sub_f64s(splat(FRAC_PI_2), first), first);
    simd.select_f64s(simd.less_than_f64s(cosine, splat(0.0)), simd.sub_f64s(splat(PI), quarter), quarter)
}
