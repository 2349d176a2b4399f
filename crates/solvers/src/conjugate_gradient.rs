//! Conjugate gradients on the scaled symmetric form.

use radiosity_core::{BandValues, Bands, Cost, Direction, Form, Iterate, Needs, Progress, Solver, StoreError, System};

/// Conjugate gradients on the symmetric positive definite form, all bands in one product.
///
/// With D = √(ρ/A) and B = E + D y the system is
///
/// ```text
/// (I − D (AF) D) y = D (AF) E,      condition number ≤ (1 + ρ)/(1 − ρ)
/// ```
///
/// (M. R. Hestenes and E. Stiefel, "Methods of conjugate gradients for solving linear systems", J. Res. NBS 49, 1952).
/// Each band has its own α and β; rows with ρ = 0 are rows of the identity. In terms of radiosity x = E + D y and
/// r = D r_cg.
///
/// - *Reads*: every row once a step; the full form of a symmetric store, where both directions are one.
/// - *Convergence*: error in the energy norm falls at least by (√κ − 1)/(√κ + 1) a step, in closed rooms far faster
///   (all eigenvalues but one lie well inside); η need not fall in every step.
/// - *Accuracy*: r is carried by recurrence, which adds a few ε a step; once η is below 10⁵ ε (2·10⁻¹¹) it is
///   recomputed from x in every step, at one product more.
/// - *Breakdown*: if p·Mp < 0, where the matrix is not positive definite (row sums times ρ above 1).
/// - *Memory*: four vectors a band beside x and r. A start value's digits where ρ = 0 are not used: there B = E.
#[derive(Clone, Debug, Default)]
pub struct ConjugateGradient {
    work: Option<Work>,
}

/// Vectors of all bands, in the variables of the scaled form.
#[derive(Clone, Debug)]
struct Work {
    /// D = √(ρ/A).
    d: BandValues,
    /// Residual r_cg.
    r: BandValues,
    /// Search direction.
    p: BandValues,
    /// D p.
    dp: BandValues,
    /// M p, M = I − D (AF) D.
    mp: BandValues,
}

/// η below which the recurrence's own rounding could show in r.
const RECURRENCE: f64 = 1e5 * f64::EPSILON;

impl Work {
    /// r_cg = r / D; where ρ = 0 both are 0.
    fn scale_residual(&mut self, r: Bands<'_>) {
        for ((scaled, d), r) in self.r.values_mut().iter_mut().zip(self.d.values()).zip(r.values()) {
            *scaled = if *d > 0.0 { r / d } else { 0.0 };
        }
    }

    /// M p from (AF) D p, which `mp` holds.
    fn finish_product(&mut self) {
        let scaled = self.p.values().iter().zip(self.d.values());
        self.mp.values_mut().iter_mut().zip(scaled).for_each(|(mp, (p, d))| *mp = p - d * *mp);
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Solver for ConjugateGradient {
    fn name(&self) -> &'static str {
        "cg"
    }

    fn needs(&self) -> Needs {
        Needs { forms: &[Form::Full], direction: Direction::Gather, symmetric: true }
    }

    fn start(&mut self, system: &System<'_>, from: Option<Bands<'_>>) -> Result<(Iterate, Cost), StoreError> {
        let (bands, m) = (system.bands(), system.elements());
        let (e, rho) = (system.emission(), system.reflectance());
        let mut d = rho.to_owned();
        let mut shot = from.unwrap_or(e).to_owned();
        for b in 0..bands {
            d.band_mut(b).iter_mut().zip(system.areas()).for_each(|(d, a)| *d = (*d / a).sqrt());
            // x = E + D y for some y: without reflection x is E.
            for (k, x) in shot.band_mut(b).iter_mut().enumerate() {
                if rho.band(b)[k] == 0.0 {
                    *x = e.band(b)[k];
                }
            }
        }
        let mut residual = BandValues::zeros(bands, m);
        let cost = system.residual(Direction::Gather, shot.view(), residual.view_mut())?;
        let zeros = BandValues::zeros(bands, m);
        let mut work = Work { d, r: zeros.clone(), p: zeros.clone(), dp: zeros.clone(), mp: zeros };
        work.scale_residual(residual.view());
        work.p = work.r.clone();
        self.work = Some(work);
        Ok((Iterate { shot, residual: Some(residual) }, cost))
    }

    fn step(&mut self, system: &System<'_>, iterate: &mut Iterate) -> Result<(Progress, Cost), StoreError> {
        let work = self.work.as_mut().expect("start comes before step");
        let Iterate { shot, residual } = iterate;
        let residual = residual.as_mut().expect("start gave one");
        // M p, all bands in one pass over the rows.
        let scaled = work.p.values().iter().zip(work.d.values());
        work.dp.values_mut().iter_mut().zip(scaled).for_each(|(dp, (p, d))| *dp = d * p);
        let mut cost = system.store().gather(work.dp.view(), work.mp.view_mut())?;
        work.finish_product();
        let curvatures: Vec<f64> = (0..system.bands()).map(|b| dot(work.p.band(b), work.mp.band(b))).collect();
        if curvatures.iter().any(|c| *c < 0.0 || c.is_nan()) {
            return Ok((Progress::Breakdown, cost));
        }
        // x += α D p and r −= α M p, with the α that makes the new r orthogonal to p even if r was recomputed. A band
        // without curvature is solved to the last bit (p = 0) and stays as it is.
        for (b, &curvature) in curvatures.iter().enumerate().filter(|band| *band.1 > 0.0) {
            let (p, dp, mp) = (work.p.band(b), work.dp.band(b), work.mp.band(b));
            let alpha = dot(work.r.band(b), p) / curvature;
            shot.band_mut(b).iter_mut().zip(dp).for_each(|(x, dp)| *x += alpha * dp);
            work.r.band_mut(b).iter_mut().zip(mp).for_each(|(r, mp)| *r -= alpha * mp);
        }
        let unscaled = work.r.values().iter().zip(work.d.values());
        residual.values_mut().iter_mut().zip(unscaled).for_each(|(r, (scaled, d))| *r = d * scaled);
        if system.unshot(residual.view()) < RECURRENCE {
            cost += system.residual(Direction::Gather, shot.view(), residual.view_mut())?;
            work.scale_residual(residual.view());
        }
        // The next direction, with the β that makes it conjugate to p even if r was recomputed.
        for (b, &curvature) in curvatures.iter().enumerate().filter(|band| *band.1 > 0.0) {
            let beta = -dot(work.r.band(b), work.mp.band(b)) / curvature;
            work.p.band_mut(b).iter_mut().zip(work.r.band(b)).for_each(|(p, r)| *p = r + beta * *p);
        }
        cost.flops += 16 * shot.values().len() as u64;
        Ok((Progress::Residual, cost))
    }
}
