//! Bounds of the error of an answer, from its residual.
//!
//! The error of B = x + r is B* − B = G (I − G)⁻¹ r with G = ρF. In the norm of power, with |r| its size element by element,
//!
//! ```text
//! Σ A|B* − B| ≤ Σ A (w − 1) |r|      for any w ≥ 0 with w ≥ 1 + T w,      T = A⁻¹ Gᵀ A
//! ```
//!
//! since (I − Gᵀ)⁻¹ A ≤ A w. w_j says how much power in all comes of one unit that leaves j: its *importance*. T is the
//! product of [`System::irradiance`] read the other way. w = 1/(1 − q), with q = max T1, is such a vector if q < 1 and gives the
//! rigorous bound Σ A|r| q/(1 − q). Any v with v − Tv > 0 gives another, v / min(v − Tv), also where q ≥ 1; and w ← 1 + T w makes
//! every such w smaller and keeps it one. The bounds hold for the form factors that the store was given: what it rounded is added (L. Collatz 1952 for the inclusion; Oettli and Prager, Numer. Math. 6, 1964, for the
//! backward error).

use crate::{BandValues, Bands, Cost, Direction, StoreError, System};

/// What the residual of an answer says of its error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Certificate {
    /// q of the worst band.
    pub contraction: f64,
    /// Bound of Σ A|B* − B| / Σ A E of the worst band by q alone, rounding added; `None` if q ≥ 1.
    pub bound: Option<f64>,
    /// The same by importance: never larger (up to rounding), and there even for some q ≥ 1. `None` if none was found.
    pub sharp_bound: Option<f64>,
    /// max |r| / (E + ρH + |x|), element by element: the smallest relative change of E, ρF and 1 that makes x exact.
    pub backward_error: f64,
}

/// Products spent on finding a w where q ≥ 1.
const SEARCH: usize = 8;
/// Products spent on making w smaller.
const SHARPEN: usize = 2;

impl Certificate {
    /// Certifies B = x + r of a system read in `direction`; r must be E + ρH(x) − x as computed now.
    pub(crate) fn new(
        system: &System<'_>,
        direction: Direction,
        x: Bands<'_>,
        r: Bands<'_>,
    ) -> Result<(Self, Cost), StoreError> {
        let ones = BandValues::new(vec![1.0; system.bands() * system.elements()], system.elements());
        let (reflected, mut cost) = system.adjoint(direction, ones.view())?;
        let q: Vec<f64> = (0..system.bands()).map(|b| reflected.band(b).iter().copied().fold(0.0, f64::max)).collect();
        let (w, spent) = importance(system, direction, ones, reflected)?;
        cost += spent;
        // A sum of m products is off by at most m ε Σ|terms|; entries that were rounded move ρH by that much of itself.
        let unit = (system.elements() as f64 + 4.0) * f64::EPSILON;
        let kept = 2.0 * system.store().properties().rounding;
        let (mut bound, mut sharp) = (Some(0.0), Some(0.0));
        let mut backward = 0.0_f64;
        for (b, &q) in q.iter().enumerate() {
            let emitted = system.power(system.emission().band(b));
            let (areas, x, r) = (system.areas(), x.band(b), r.band(b));
            let sum = |term: &dyn Fn(usize) -> f64| -> f64 { areas.iter().enumerate().map(|(e, a)| a * term(e)).sum() };
            let reflected = |e: usize| (x[e] + r[e] - system.emission().band(b)[e]).abs();
            let q = q * (1.0 + kept);
            let plain = (q * sum(&|e| r[e].abs()) + unit * sum(&|e| x[e].abs()) + kept * sum(&reflected)) / (1.0 - q);
            bound = worst(bound, plain, emitted, q < 1.0);
            match w.as_ref().map(|w| w.band(b)) {
                // r itself is known to the rounding of its terms, B and x.
                Some(w) => {
                    let power = |e: usize| {
                        let rounding = unit * ((x[e] + r[e]).abs() + x[e].abs()) + kept * reflected(e);
                        (w[e] - 1.0).max(0.0) * r[e].abs() + w[e] * rounding
                    };
                    sharp = worst(sharp, sum(&power), emitted, true);
                }
                None => sharp = None,
            }
            let size = |e: usize| (x[e] + r[e]).abs() + x[e].abs();
            let relative = (0..r.len()).filter(|&e| r[e] != 0.0).map(|e| r[e].abs() / size(e));
            backward = relative.fold(backward, |most, part| if part <= most { most } else { part });
        }
        let contraction = q.into_iter().fold(0.0, f64::max);
        Ok((Self { contraction, bound, sharp_bound: sharp, backward_error: backward }, cost))
    }
}

/// The larger of a bound so far and `error` over `emitted`; `None` if there is none.
fn worst(so_far: Option<f64>, error: f64, emitted: f64, holds: bool) -> Option<f64> {
    let relative = if error > 0.0 { error / emitted } else { 0.0 };
    so_far.filter(|_| holds && error.is_finite() && relative.is_finite()).map(|bound| bound.max(relative))
}

/// w ≥ 1 + T w of every band, or `None` if a few products find none in some band; `reflected` is T1.
fn importance(
    system: &System<'_>,
    direction: Direction,
    ones: BandValues,
    reflected: BandValues,
) -> Result<(Option<BandValues>, Cost), StoreError> {
    // Rounding of a product, which must not make a bound of what is none.
    let rounding = (system.elements() as f64 + 4.0) * f64::EPSILON + system.store().properties().rounding;
    let room = 1.0 + 4.0 * rounding;
    let (mut v, mut image, mut cost) = (ones, reflected, Cost::default());
    let mut w = None;
    for pass in 0..=SEARCH {
        let margin = |b: usize| {
            let pairs = v.band(b).iter().zip(image.band(b));
            pairs.map(|(v, image)| v - room * image).fold(f64::INFINITY, f64::min)
        };
        let margins: Vec<f64> = (0..system.bands()).map(margin).collect();
        if margins.iter().all(|margin| *margin > 0.0) {
            let mut found = v;
            for (b, margin) in margins.into_iter().enumerate() {
                found.band_mut(b).iter_mut().for_each(|w| *w *= room / margin);
            }
            w = Some(found);
            break;
        }
        if pass < SEARCH {
            v.values_mut().iter_mut().zip(image.values()).for_each(|(v, image)| *v = 1.0 + image);
            let (next, spent) = system.adjoint(direction, v.view())?;
            image = next;
            cost += spent;
        }
    }
    if let Some(w) = &mut w {
        for _ in 0..SHARPEN {
            let (image, spent) = system.adjoint(direction, w.view())?;
            cost += spent;
            let sharper = image.values().iter().map(|image| room * (1.0 + image));
            w.values_mut().iter_mut().zip(sharper).for_each(|(w, sharper)| *w = w.min(sharper));
        }
    }
    Ok((w, cost))
}
