//! Numbers side by side: one vector register, written with operators.

use std::ops::{Add, Div, Mul, Neg, Sub};

use pulp::Simd;
use pulp::bytemuck::cast_slice;

/// Numbers that a block of pairs keeps side by side, whatever the width of a register.
pub(super) const BLOCK: usize = 8;

/// [`BLOCK`] numbers, aligned so that no register straddles a cache line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(64))]
pub(super) struct Eight(pub [f64; BLOCK]);

/// As many numbers as a register holds.
#[derive(Clone, Copy)]
pub(super) struct Lane<S: Simd> {
    pub simd: S,
    pub v: S::f64s,
}

/// What a register can be filled from: one number for all lanes, or a part of [`Eight`].
pub(super) trait Load<S: Simd> {
    /// Lanes `part` · width to (`part` + 1) · width − 1.
    fn lane(&self, simd: S, part: usize) -> Lane<S>;
}

impl<S: Simd> Load<S> for f64 {
    #[inline(always)]
    fn lane(&self, simd: S, _part: usize) -> Lane<S> {
        Lane { simd, v: simd.splat_f64s(*self) }
    }
}

impl<S: Simd> Load<S> for Eight {
    #[inline(always)]
    fn lane(&self, simd: S, part: usize) -> Lane<S> {
        Lane { simd, v: S::as_simd_f64s(&self.0).0[part] }
    }
}

impl<S: Simd> Lane<S> {
    /// One number in all lanes.
    #[inline(always)]
    pub fn all(self, value: f64) -> Self {
        Self { v: self.simd.splat_f64s(value), ..self }
    }

    /// self · factor + term.
    #[inline(always)]
    pub fn fma(self, factor: Self, term: Self) -> Self {
        Self { v: self.simd.mul_add_e_f64s(self.v, factor.v, term.v), ..self }
    }

    #[inline(always)]
    pub fn abs(self) -> Self {
        Self { v: self.simd.abs_f64s(self.v), ..self }
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        Self { v: self.simd.sqrt_f64s(self.v), ..self }
    }

    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        Self { v: self.simd.max_f64s(self.v, other.v), ..self }
    }

    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        Self { v: self.simd.min_f64s(self.v, other.v), ..self }
    }

    /// Lanes in which self ≤ other; none where one of them is no number.
    #[inline(always)]
    pub fn at_most(self, other: Self) -> Mask<S> {
        Mask { simd: self.simd, m: self.simd.less_than_or_equal_f64s(self.v, other.v) }
    }

    /// Least of all lanes.
    #[inline(always)]
    pub fn least(self) -> f64 {
        self.simd.reduce_min_f64s(self.v)
    }

    /// Greatest of all lanes.
    #[inline(always)]
    pub fn greatest(self) -> f64 {
        self.simd.reduce_max_f64s(self.v)
    }

    /// The lanes as an array of which the first are used.
    #[inline(always)]
    pub fn to_array(self) -> [f64; BLOCK] {
        let mut values = [0.0; BLOCK];
        let lanes = [self.v];
        let lanes: &[f64] = cast_slice(&lanes);
        values[..lanes.len()].copy_from_slice(lanes);
        values
    }
}

macro_rules! operator {
    ($operator:ident, $name:ident, $simd:ident) => {
        impl<S: Simd> $operator for Lane<S> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Self { v: self.simd.$simd(self.v, other.v), ..self }
            }
        }
    };
}

operator!(Add, add, add_f64s);
operator!(Sub, sub, sub_f64s);
operator!(Mul, mul, mul_f64s);
operator!(Div, div, div_f64s);

impl<S: Simd> Neg for Lane<S> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self { v: self.simd.neg_f64s(self.v), ..self }
    }
}

/// A yes or no a lane.
#[derive(Clone, Copy)]
pub(super) struct Mask<S: Simd> {
    simd: S,
    m: S::m64s,
}

impl<S: Simd> Mask<S> {
    #[inline(always)]
    pub fn and(self, other: Self) -> Self {
        Self { m: self.simd.and_m64s(self.m, other.m), ..self }
    }

    #[inline(always)]
    pub fn or(self, other: Self) -> Self {
        Self { m: self.simd.or_m64s(self.m, other.m), ..self }
    }

    /// `yes` where the mask is set, `no` elsewhere.
    #[inline(always)]
    pub fn select(self, yes: Lane<S>, no: Lane<S>) -> Lane<S> {
        Lane { v: self.simd.select_f64s(self.m, yes.v, no.v), ..yes }
    }
}

/// A vector a lane.
#[derive(Clone, Copy)]
pub(super) struct Lane3<S: Simd>(pub [Lane<S>; 3]);

impl<S: Simd> Lane3<S> {
    #[inline(always)]
    pub fn load<T: Load<S>>(simd: S, vector: &[T; 3], part: usize) -> Self {
        Self([vector[0].lane(simd, part), vector[1].lane(simd, part), vector[2].lane(simd, part)])
    }

    #[inline(always)]
    pub fn dot(self, other: Self) -> Lane<S> {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        a.fma(x, b.fma(y, c * z))
    }
}

impl<S: Simd> Add for Lane3<S> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([a + x, b + y, c + z])
    }
}

impl<S: Simd> Sub for Lane3<S> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([a - x, b - y, c - z])
    }
}
