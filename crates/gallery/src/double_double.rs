//! Linear systems solved in twice the working precision: answers to measure double precision by.
//!
//! A number is an unevaluated sum of two doubles, about 106 bits (T. J. Dekker, "A floating-point technique for extending the available
//! precision", Numer. Math. 18, 1971; D. E. Knuth's two-sum). Products of entries beyond 1e150 or below 1e-150 lose that precision.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// high + low, with |low| at most half a unit in the last place of high.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DoubleDouble {
    high: f64,
    low: f64,
}

impl From<f64> for DoubleDouble {
    fn from(high: f64) -> Self {
        Self { high, low: 0.0 }
    }
}

impl From<DoubleDouble> for f64 {
    fn from(value: DoubleDouble) -> Self {
        value.high + value.low
    }
}

/// a + b and its rounding error.
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let part = sum - a;
    (sum, (a - (sum - part)) + (b - part))
}

/// The upper 26 bits of a number, and the rest.
fn split(a: f64) -> (f64, f64) {
    let scaled = 134_217_729.0 * a;
    let high = scaled - (scaled - a);
    (high, a - high)
}

/// a · b and its rounding error.
fn two_product(a: f64, b: f64) -> (f64, f64) {
    let product = a * b;
    let ((a_high, a_low), (b_high, b_low)) = (split(a), split(b));
    (product, ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low)
}

impl DoubleDouble {
    fn normal(high: f64, low: f64) -> Self {
        let sum = high + low;
        Self { high: sum, low: low - (sum - high) }
    }
}

impl Add for DoubleDouble {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let (high, error) = two_sum(self.high, other.high);
        let (low, rest) = two_sum(self.low, other.low);
        let first = Self::normal(high, error + low);
        Self::normal(first.high, first.low + rest)
    }
}

impl Neg for DoubleDouble {
    type Output = Self;

    fn neg(self) -> Self {
        Self { high: -self.high, low: -self.low }
    }
}

impl Sub for DoubleDouble {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for DoubleDouble {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let (high, error) = two_product(self.high, other.high);
        Self::normal(high, error + (self.high * other.low + self.low * other.high))
    }
}

impl Div for DoubleDouble {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        let first = Self::from(self.high / other.high);
        let rest = self - first * other;
        first + Self::from((rest.high + rest.low) / other.high)
    }
}

/// x of a x = b by Gaussian elimination with row pivoting, `a` row after row; `None` if a is singular.
///
/// The error is about κ · 1e-31.
///
/// # Panics
///
/// If `a` is not square or does not fit `b`.
pub fn solve(mut a: Vec<DoubleDouble>, mut b: Vec<DoubleDouble>) -> Option<Vec<f64>> {
    let n = b.len();
    assert_eq!(a.len(), n * n, "a matrix of {} entries for {n} unknowns", a.len());
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| a[i * n + k].high.abs().total_cmp(&a[j * n + k].high.abs()))?;
        if a[pivot * n + k].high == 0.0 {
            return None;
        }
        if pivot != k {
            (0..n).for_each(|t| a.swap(k * n + t, pivot * n + t));
            b.swap(k, pivot);
        }
        let (upper, lower) = a.split_at_mut((k + 1) * n);
        let row = &upper[k * n..];
        for (i, below) in lower.chunks_exact_mut(n).enumerate() {
            let factor = below[k] / row[k];
            if factor.high != 0.0 {
                below[k + 1..].iter_mut().zip(&row[k + 1..]).for_each(|(x, y)| *x = *x - factor * *y);
                b[k + 1 + i] = b[k + 1 + i] - factor * b[k];
            }
        }
    }
    for k in (0..n).rev() {
        let known = (k + 1..n).fold(b[k], |sum, t| sum - a[k * n + t] * b[t]);
        b[k] = known / a[k * n + k];
    }
    Some(b.into_iter().map(f64::from).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// (1 + 2⁻⁶⁰)² = 1 + 2⁻⁵⁹ + 2⁻¹²⁰, of which two doubles hold all but the last term.
    #[test]
    fn products_keep_what_a_double_drops() {
        let x = DoubleDouble::from(1.0) + DoubleDouble::from(2.0_f64.powi(-60));
        let square = x * x - DoubleDouble::from(1.0);
        assert_eq!(f64::from(square), 2.0_f64.powi(-59));
        let third = DoubleDouble::from(1.0) / DoubleDouble::from(3.0);
        let left = third * DoubleDouble::from(3.0) - DoubleDouble::from(1.0);
        assert!(f64::from(left).abs() < 1e-31);
    }

    /// Hilbert's matrix of order 10 has κ = 1.6e13 and the sum of its inverse's entries is 100.
    #[test]
    fn an_ill_conditioned_system_is_solved_to_double_precision() {
        let n = 10;
        let entry = |k: usize| DoubleDouble::from(1.0) / DoubleDouble::from((k / n + k % n + 1) as f64);
        let x = solve((0..n * n).map(entry).collect(), vec![1.0.into(); n]).unwrap();
        let sum: f64 = x.iter().sum();
        // Entries reach 5e6: the sum in double precision is right to 1e-9.
        assert!((sum - 100.0).abs() < 1e-8, "{sum}");
        assert_eq!(solve(vec![0.0.into(); 4], vec![1.0.into(); 2]), None);
    }
}
