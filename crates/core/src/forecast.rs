//! What can be said of a solution before it is computed.

use crate::{BandValues, Cost, Direction, Form, StoreError, System};

/// How fast methods will converge on a system, from a few products.
///
/// With T the adjoint of G = ρF in the inner product ⟨a, b⟩ = Σ A a b (the same eigenvalues) and v_k = Tᵏ 1, the inclusion of Collatz and
/// Wielandt
///
/// ```text
/// min (Tv)_i / v_i  ≤  μ  ≤  max (Tv)_i / v_i
/// ```
///
/// holds of the spectral radius μ of Jacobi's iteration for every v > 0 (L. Collatz, Math. Z. 48, 1942; H. Wielandt, Math. Z. 52, 1950). Its
/// residual after k steps from x = 0 is Gᵏ E ≥ 0, so that
///
/// ```text
/// η_k = Σ A GᵏE / Σ A E = ⟨E, v_k⟩ / ⟨E, 1⟩
/// ```
///
/// is known for as many steps as there were products, and from there on lies between the two bounds of μ to the power of the further steps,
/// since T has no negative entry.
///
/// On a symmetric store the scaled symmetric form I − D(AF)D has its eigenvalues in [1 − μ, 1 + μ] and, where no element sees itself, their
/// mean is 1. So its condition number κ lies between 1/(1 − μ) and (1 + μ)/(1 − μ).
#[derive(Clone, Debug, PartialEq)]
pub struct Forecast {
    /// q of the worst band: the first upper bound, by which errors are bounded too.
    pub contraction: f64,
    /// Bounds of the spectral radius of the worst band.
    pub radius: (f64, f64),
    symmetric: bool,
    bands: Vec<Decay>,
}

/// Jacobi's iteration in one band.
#[derive(Clone, Debug, PartialEq)]
struct Decay {
    /// η_0, η_1, …, as far as products went.
    unshot: Vec<f64>,
    radius: (f64, f64),
}

impl Forecast {
    /// Spends `products` products, at least one, on all bands at once; the bounds of μ close in like the ratio of the two largest
    /// eigenvalues to that power.
    ///
    /// # Errors
    ///
    /// [`StoreError`] if a row cannot be had.
    pub fn new(system: &System<'_>, direction: Direction, products: usize) -> Result<(Self, Cost), StoreError> {
        let (bands, m) = (system.bands(), system.elements());
        let mut v = BandValues::new(vec![1.0; bands * m], m);
        let mut cost = Cost::default();
        let decay = |b: usize| {
            let lit = system.power(system.emission().band(b)) > 0.0;
            Decay { unshot: vec![f64::from(lit)], radius: (0.0, f64::INFINITY) }
        };
        let mut decays: Vec<Decay> = (0..bands).map(decay).collect();
        let (mut contraction, mut units) = (0.0, vec![1.0; bands]);
        for product in 0..products.max(1) {
            let (mut image, spent) = system.adjoint(direction, v.view())?;
            cost += spent;
            for (b, decay) in decays.iter_mut().enumerate() {
                let ratios = image.band(b).iter().zip(v.band(b)).filter(|(_, v)| **v > 0.0).map(|(image, v)| image / v);
                let (least, most) =
                    ratios.fold((f64::INFINITY, 0.0_f64), |(lo, hi), ratio| (lo.min(ratio), hi.max(ratio)));
                decay.radius = (decay.radius.0.max(least.min(most)), decay.radius.1.min(most));
                let e = system.emission().band(b);
                let (lit, emitted) = (e.iter().zip(image.band(b)).zip(system.areas()), system.power(e));
                let unshot = units[b] * lit.map(|((e, v), a)| a * e * v).sum::<f64>();
                decay.unshot.push(if unshot > 0.0 { unshot / emitted } else { 0.0 });
                // Largest value 1: nothing over- or underflows.
                let largest = image.band(b).iter().copied().fold(0.0, f64::max);
                if largest > 0.0 {
                    image.band_mut(b).iter_mut().for_each(|v| *v /= largest);
                    units[b] *= largest;
                }
            }
            if product == 0 {
                contraction = decays.iter().map(|decay| decay.radius.1).fold(0.0, f64::max);
            }
            v = image;
        }
        let worst = |of: fn(&Decay) -> f64| decays.iter().map(of).fold(0.0, f64::max);
        let radius = (worst(|decay| decay.radius.0), worst(|decay| decay.radius.1));
        let symmetric = system.form() == Form::Full && system.store().properties().symmetric;
        Ok((Self { contraction, radius, symmetric, bands: decays }, cost))
    }

    /// Products spent.
    pub fn products(&self) -> usize {
        self.bands.first().map_or(0, |decay| decay.unshot.len() - 1)
    }

    /// Estimate from below and bound from above of the condition number of the scaled symmetric form, of which the second is infinite if
    /// μ may be 1 or more; at most a factor 2 apart once μ is known. `None` of a store that is not symmetric.
    pub fn condition(&self) -> Option<(f64, f64)> {
        let over = |numerator: f64, mu: f64| if mu < 1.0 { numerator / (1.0 - mu) } else { f64::INFINITY };
        self.symmetric.then(|| (over(1.0, self.radius.0), over(1.0 + self.radius.1, self.radius.1)))
    }

    /// Steps, at least and at most, to be rounded up, that the method called `name` will need to bring η to `unshot`; infinite if it may not converge,
    /// `None` if nothing is known of the method on this store.
    ///
    /// | method | steps |
    /// |---|---|
    /// | `jacobi` | as above: bounds |
    /// | `gauss-seidel` | half of Jacobi's and one to see it (factor μ²: true of consistently ordered matrices, about true in rooms) |
    /// | `sor` | factor ω − 1 with ω = 2/(1 + √(1 − μ²)) a step, once ω is found |
    /// | `chebyshev` | factor q/(1 + √(1 − q²)) a step, whatever μ |
    /// | `cg`, `deflated-cg` | factor at most (√κ − 1)/(√κ + 1) a step |
    pub fn steps(&self, name: &str, unshot: f64) -> Option<(f64, f64)> {
        let sor = |mu: f64| 2.0 / (1.0 + (1.0 - mu * mu).max(0.0).sqrt()) - 1.0;
        let half_interval = |q: f64| q / (1.0 + (1.0 - q * q).max(0.0).sqrt());
        let factors = match name {
            "jacobi" => return Some(self.jacobi(unshot)),
            "gauss-seidel" => {
                let (least, most) = self.jacobi(unshot);
                return Some((0.5 * least + 1.0, 0.5 * most + 1.0));
            }
            "sor" => (sor(self.radius.0.min(1.0)), sor(self.radius.1.min(1.0))),
            "chebyshev" if self.symmetric => {
                (half_interval(self.contraction.min(1.0)), half_interval(self.contraction.min(1.0)))
            }
            "cg" | "deflated-cg" => {
                let root = self.condition()?.1.sqrt();
                (0.0, if root.is_finite() { (root - 1.0) / (root + 1.0) } else { 1.0 })
            }
            _ => return None,
        };
        let steps = |factor: f64| further(1.0, factor, unshot).max(1.0);
        Some((steps(factors.0), steps(factors.1)))
    }

    /// Steps of Jacobi's iteration from x = 0, those of the band that needs most.
    fn jacobi(&self, unshot: f64) -> (f64, f64) {
        self.bands.iter().fold((0.0, 0.0), |(least, most), decay| {
            if let Some(steps) = decay.unshot.iter().position(|&eta| eta <= unshot) {
                return (f64::max(least, steps as f64), f64::max(most, steps as f64));
            }
            let known = decay.unshot.len() as f64 - 1.0;
            let last = decay.unshot.last().copied().unwrap_or(0.0);
            let steps = |factor: f64| known + further(last, factor, unshot);
            (least.max(steps(decay.radius.0)), most.max(steps(decay.radius.1)))
        })
    }
}

/// Steps of `factor` each that bring η from `now` to `wanted`.
fn further(now: f64, factor: f64, wanted: f64) -> f64 {
    if now <= wanted {
        0.0
    } else if factor >= 1.0 {
        f64::INFINITY
    } else if factor <= 0.0 {
        1.0
    } else {
        (wanted / now).ln() / factor.ln()
    }
}
