//! Chebyshev semi-iteration: Jacobi's residuals, combined by the best polynomial of a known interval.

use radiosity_core::{BandValues, Bands, Cost, Direction, Form, Iterate, Needs, Progress, Solver, StoreError, System};

/// Chebyshev semi-iteration with the interval that the row sums give.
///
/// On a symmetric store ρF has real eigenvalues, and none exceeds q = max_t (1/A_t) Σ_s A_s ρ_s F_st in size. With δ = min(q, 1),
///
/// ```text
/// d⁰ = r⁰,  c⁰ = δ;      xᵏ⁺¹ = xᵏ + dᵏ,      rᵏ⁺¹ = E + ρ F xᵏ⁺¹ − xᵏ⁺¹,
/// cᵏ⁺¹ = δ / (2 − δ cᵏ),      dᵏ⁺¹ = cᵏ cᵏ⁺¹ dᵏ + 2/(2 − δ cᵏ) rᵏ⁺¹
/// ```
///
/// makes r a Chebyshev polynomial of I − ρF on [1 − δ, 1 + δ] (G. H. Golub and R. S. Varga, "Chebyshev semi-iterative methods",
/// Numer. Math. 3, 1961; Y. Saad, *Iterative Methods for Sparse Linear Systems*, 2nd ed., 2003, section 12.3). There are no inner products:
/// nothing but the product couples elements.
///
/// - *Reads*: every row once a step and once more for q; the full form of a symmetric store.
/// - *Convergence*: the error in the energy norm falls by δ/(1 + √(1 − δ²)) a step in the end: steps grow like 1/√(1 − q) where Jacobi's grow
///   like 1/(1 − q). Where q > 1 but the spectral radius is below 1 it still converges, like 1/k².
/// - *Accuracy*: r is recomputed from x in each step, so it is true to rounding.
/// - *Memory*: one vector a band beside x and r.
#[derive(Clone, Debug, Default)]
pub struct Chebyshev {
    /// d, and δ and c of every band.
    work: Option<(BandValues, Vec<(f64, f64)>)>,
}

/// Steps without progress that are waited for where the interval reaches 0.
const LONGEST: f64 = 1e4;

impl Solver for Chebyshev {
    fn name(&self) -> &'static str {
        "chebyshev"
    }

    fn needs(&self) -> Needs {
        Needs { forms: &[Form::Full], direction: Direction::Gather, symmetric: true }
    }

    fn start(&mut self, system: &System<'_>, from: Option<Bands<'_>>) -> Result<(Iterate, Cost), StoreError> {
        let (q, mut cost) = system.contraction(Direction::Gather)?;
        let mut residual = system.emission().to_owned();
        let mut shot = residual.clone();
        match from {
            None => shot.values_mut().fill(0.0),
            Some(from) => {
                shot = from.to_owned();
                cost += system.residual(Direction::Gather, shot.view(), residual.view_mut())?;
            }
        }
        let intervals = q.into_iter().map(|q| (q.min(1.0), q.min(1.0))).collect();
        self.work = Some((residual.clone(), intervals));
        Ok((Iterate { shot, residual: Some(residual) }, cost))
    }

    fn release(&mut self) {
        self.work = None;
    }

    fn step(&mut self, system: &System<'_>, iterate: &mut Iterate) -> Result<(Progress, Cost), StoreError> {
        let (d, intervals) = self.work.as_mut().expect("start comes before step");
        let Iterate { shot, residual } = iterate;
        let r = residual.as_mut().expect("start gave one");
        shot.values_mut().iter_mut().zip(d.values()).for_each(|(x, d)| *x += d);
        let mut cost = system.residual(Direction::Gather, shot.view(), r.view_mut())?;
        for (b, (delta, c)) in intervals.iter_mut().enumerate() {
            let weight = 2.0 / (2.0 - *delta * *c);
            let next = 0.5 * *delta * weight;
            let kept = *c * next;
            d.band_mut(b).iter_mut().zip(r.band(b)).for_each(|(d, r)| *d = kept * *d + weight * r);
            *c = next;
        }
        cost.flops += 7 * shot.values().len() as u64;
        Ok((Progress::Residual, cost))
    }

    /// The residual swells before the polynomial is small, for about 1/(1 − σ) steps, σ = δ/(1 + √(1 − δ²)).
    fn patience(&self) -> f64 {
        let largest =
            self.work.iter().flat_map(|(_, intervals)| intervals).map(|(delta, _)| *delta).fold(0.0, f64::max);
        let sigma = largest / (1.0 + (1.0 - largest * largest).sqrt());
        (20.0 / (1.0 - sigma)).min(LONGEST)
    }
}
