//! What can be said of a solution before it is computed.

use crate::{BandValues, Cost, Direction, StoreError, System};

/// How fast methods will converge on a system, from a few products.
///
/// With v ← T v from v = 1 (T as ρF read the other way, the same eigenvalues), the inclusion of Collatz and Wielandt
///
/// ```text
/// min (Tv)_i / v_i  ≤  μ  ≤  max (Tv)_i / v_i
/// ```
///
/// holds of the spectral radius μ of Jacobi's iteration at every step (L. Collatz, Math. Z. 48, 1942; H. Wielandt, Math. Z. 52, 1950).
/// The scaled symmetric form has its eigenvalues in [1 − μ, 1 + μ], so its condition number is at most (1 + μ)/(1 − μ).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forecast {
    /// q of the worst band: the first upper bound, by which errors are bounded too.
    pub contraction: f64,
    /// Bounds of the spectral radius of the worst band.
    pub radius: (f64, f64),
}

impl Forecast {
    /// Spends `products` products, at least one, on the worst band's spectral radius; the bounds close in like the ratio of the two
    /// largest eigenvalues to that power.
    ///
    /// # Errors
    ///
    /// [`StoreError`] if a row cannot be had.
    pub fn new(system: &System<'_>, direction: Direction, products: usize) -> Result<(Self, Cost), StoreError> {
        let (bands, m) = (system.bands(), system.elements());
        let mut v = BandValues::new(vec![1.0; bands * m], m);
        let (mut cost, mut contraction) = (Cost::default(), 0.0);
        let mut radius = vec![(0.0_f64, f64::INFINITY); bands];
        for product in 0..products.max(1) {
            let (mut image, spent) = system.adjoint(direction, v.view())?;
            cost += spent;
            for (b, (low, high)) in radius.iter_mut().enumerate() {
                let ratios = image.band(b).iter().zip(v.band(b)).filter(|(_, v)| **v > 0.0).map(|(image, v)| image / v);
                let (least, most) =
                    ratios.fold((f64::INFINITY, 0.0_f64), |(lo, hi), ratio| (lo.min(ratio), hi.max(ratio)));
                (*low, *high) = (low.max(least.min(most)), high.min(most));
                // Largest value 1: nothing over- or underflows.
                let largest = image.band(b).iter().copied().fold(0.0, f64::max);
                if largest > 0.0 {
                    image.band_mut(b).iter_mut().for_each(|v| *v /= largest);
                }
            }
            if product == 0 {
                contraction = radius.iter().map(|radius| radius.1).fold(0.0, f64::max);
            }
            v = image;
        }
        let worst = |of: fn(&(f64, f64)) -> f64| radius.iter().map(of).fold(0.0, f64::max);
        Ok((Self { contraction, radius: (worst(|r| r.0), worst(|r| r.1)) }, cost))
    }

    /// Bound of the condition number of the scaled symmetric form; infinite if μ may be 1 or more.
    pub fn condition(&self) -> f64 {
        let mu = self.radius.1;
        if mu < 1.0 { (1.0 + mu) / (1.0 - mu) } else { f64::INFINITY }
    }

    /// Steps, at least and at most, that the stationary method called `name` will need to bring η to `unshot`, as far as its
    /// asymptotic rate says; infinite if it may not converge, `None` if the method has no such rate.
    ///
    /// | method | factor a step |
    /// |---|---|
    /// | `jacobi` | μ |
    /// | `gauss-seidel` | μ² (consistently ordered matrices; about that in rooms) |
    /// | `sor` | ω − 1 with ω = 2/(1 + √(1 − μ²)) |
    /// | `chebyshev` | q/(1 + √(1 − q²)), whatever μ |
    /// | `cg`, `deflated-cg` | at most (√κ − 1)/(√κ + 1) |
    pub fn steps(&self, name: &str, unshot: f64) -> Option<(f64, f64)> {
        let sor = |mu: f64| 2.0 / (1.0 + (1.0 - mu * mu).max(0.0).sqrt()) - 1.0;
        let half_interval = |q: f64| q / (1.0 + (1.0 - q * q).max(0.0).sqrt());
        let (low, high) = match name {
            "jacobi" => self.radius,
            "gauss-seidel" => (self.radius.0.powi(2), self.radius.1.powi(2)),
            "sor" => (sor(self.radius.0.min(1.0)), sor(self.radius.1.min(1.0))),
            "chebyshev" => (half_interval(self.contraction.min(1.0)), half_interval(self.contraction.min(1.0))),
            "cg" | "deflated-cg" => {
                let root = self.condition().sqrt();
                (0.0, if root.is_finite() { (root - 1.0) / (root + 1.0) } else { 1.0 })
            }
            _ => return None,
        };
        let steps = |factor: f64| {
            if factor >= 1.0 {
                f64::INFINITY
            } else if factor <= 0.0 {
                1.0
            } else {
                (unshot.ln() / factor.ln()).max(1.0)
            }
        };
        Some((steps(low), steps(high)))
    }
}
