//! Conjugate gradients on the scaled symmetric form.

use radiosity_core::{BandValues, Bands, Cost, Direction, Form, Iterate, Needs, Progress, Solver, StoreError, System};

use crate::rounding_level;

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
/// **Deflated**, the slow mode of a closed room, light spread evenly and reflected (H constant, so w = √(ρA)), is solved for at once and
/// kept out of every direction (Y. Saad, M. Yeung, J. Erhel and F. Guyomarc'h, "A deflated version of the conjugate gradient
/// algorithm", SIAM J. Sci. Comput. 21, 2000):
///
/// ```text
/// y⁰ += w (w·r)/(w·Mw),      p = r + β p − w (Mw·r)/(w·Mw)
/// ```
///
/// The number of steps then hardly depends on ρ. D w = ρ is gathered in the same pass over the rows as x at the start, so that this costs no
/// product more. Every nearly isolated room brings a slow mode of its own, of which this takes the one that all share.
///
/// - *Reads*: every row once a step; the full form of a symmetric store, where both directions are one.
/// - *Convergence*: error in the energy norm falls at least by (√κ − 1)/(√κ + 1) a step, in closed rooms far faster
///   (all eigenvalues but one lie well inside); η need not fall in every step.
/// - *Accuracy*: r is carried by recurrence, which does not see how x is rounded: by about ε|x|/4 in a step, and √k times that in k
///   steps that are independent. Once a quarter of η may be that, η < √k ε Σ A|x| / Σ A E, it is recomputed from x, at one product more,
///   and k begins anew (H. A. van der Vorst and Q. Ye, "Residual replacement strategies for Krylov subspace iterative methods for the
///   convergence of true residuals", SIAM J. Sci. Comput. 22, 2000, who replace at a smaller share). An η far above rounding costs nothing.
/// - *Breakdown*: if p·Mp < 0, where the matrix is not positive definite (row sums times ρ above 1).
/// - *Memory*: four vectors a band beside x and r, deflated six. A start value's digits where ρ = 0 are not used: there B = E.
#[derive(Clone, Debug, Default)]
pub struct ConjugateGradient {
    deflated: bool,
    work: Option<Work>,
}

impl ConjugateGradient {
    /// Conjugate gradients with the slow mode of a closed room deflated.
    pub fn deflated() -> Self {
        Self { deflated: true, work: None }
    }
}

/// Vectors of all bands, in the variables of the scaled form.
#[derive(Clone, Debug)]
struct Work {
    /// D = √(ρ/A).
    d: BandValues,
    /// Unit of r_cg and p in every band, a power of 2 near their size: squares neither over- nor underflow.
    units: Vec<f64>,
    /// Residual r_cg.
    r: BandValues,
    /// Search direction.
    p: BandValues,
    /// D p.
    dp: BandValues,
    /// M p, M = I − D (AF) D.
    mp: BandValues,
    /// Updates of r since it was computed from x.
    updates: u32,
    /// The mode that is kept out.
    slow: Option<SlowMode>,
}

/// w = √(ρA) of every band, M w and w·Mw.
#[derive(Clone, Debug)]
struct SlowMode {
    w: BandValues,
    mw: BandValues,
    curvature: Vec<f64>,
}

impl SlowMode {
    /// The mode from (AF) D w, D w = ρ.
    fn new(system: &System<'_>, d: &BandValues, gathered: Bands<'_>) -> Self {
        let (mut w, mut mw) = (d.clone(), gathered.to_owned());
        (0..system.bands()).for_each(|b| w.band_mut(b).iter_mut().zip(system.areas()).for_each(|(w, a)| *w *= a));
        let scaled = w.values().iter().zip(d.values());
        mw.values_mut().iter_mut().zip(scaled).for_each(|(mw, (w, d))| *mw = w - d * *mw);
        let curvature = (0..system.bands()).map(|b| dot(w.band(b), mw.band(b))).collect();
        Self { w, mw, curvature }
    }

    /// v·r/(w·Mw), or nothing where a band has no such mode (ρ = 0) or the matrix is not positive along it.
    fn part(&self, b: usize, v: &BandValues, r: &[f64]) -> f64 {
        if self.curvature[b] > 0.0 { dot(v.band(b), r) / self.curvature[b] } else { 0.0 }
    }
}

impl Work {
    fn new(d: BandValues, r: Bands<'_>) -> Self {
        let zeros = BandValues::zeros(r.count(), r.len());
        let unit = |b: usize| {
            let scaled = d.band(b).iter().zip(r.band(b)).filter(|(d, _)| **d > 0.0).map(|(d, r)| (r / d).abs());
            let largest = scaled.fold(0.0, f64::max);
            if largest > 0.0 && largest.is_finite() { largest.log2().floor().exp2() } else { 1.0 }
        };
        let units = (0..r.count()).map(unit).collect();
        let (p, dp, mp) = (zeros.clone(), zeros.clone(), zeros.clone());
        let mut work = Self { d, units, r: zeros, p, dp, mp, updates: 0, slow: None };
        work.scale_residual(r);
        work
    }

    /// r_cg = r / D, in its unit; where ρ = 0 both are 0.
    fn scale_residual(&mut self, r: Bands<'_>) {
        for (b, unit) in self.units.iter().enumerate() {
            for ((scaled, d), r) in self.r.band_mut(b).iter_mut().zip(self.d.band(b)).zip(r.band(b)) {
                *scaled = if *d > 0.0 { r / unit / d } else { 0.0 };
            }
        }
    }

    /// r = D r_cg.
    fn unscale_residual(&self, residual: &mut BandValues) {
        for (b, unit) in self.units.iter().enumerate() {
            let scaled = self.r.band(b).iter().zip(self.d.band(b));
            residual.band_mut(b).iter_mut().zip(scaled).for_each(|(r, (scaled, d))| *r = d * scaled * unit);
        }
    }

    /// Solves for the slow mode at once: y += c w, so x += c ρ and r_cg −= c M w, with c = w·r/(w·Mw).
    fn solve_slow_mode(&mut self, shot: &mut BandValues, rho: Bands<'_>) {
        let Some(slow) = &self.slow else { return };
        for (b, unit) in self.units.iter().enumerate() {
            let r = self.r.band_mut(b);
            let c = slow.part(b, &slow.w, r);
            shot.band_mut(b).iter_mut().zip(rho.band(b)).for_each(|(x, rho)| *x += c * rho * unit);
            r.iter_mut().zip(slow.mw.band(b)).for_each(|(r, mw)| *r -= c * mw);
        }
    }

    /// Takes the slow mode out of the direction p of band b.
    fn deflate(&mut self, b: usize) {
        if let Some(slow) = &self.slow {
            let part = slow.part(b, &slow.mw, self.r.band(b));
            self.p.band_mut(b).iter_mut().zip(slow.w.band(b)).for_each(|(p, w)| *p -= part * w);
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
        if self.deflated { "deflated-cg" } else { "cg" }
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
        let (slow, cost) = if self.deflated {
            // Sums of x and of ρ in one pass over the rows.
            let sent = [shot.values(), rho.values()].concat();
            let mut gathered = BandValues::zeros(2 * bands, m);
            let cost = system.store().gather(Bands::new(&sent, m), gathered.view_mut())?;
            let (of_shot, of_rho) = gathered.values().split_at(bands * m);
            for b in 0..bands {
                let (e, rho, x, sums) = (e.band(b), rho.band(b), shot.band(b), &of_shot[b * m..]);
                for (k, r) in residual.band_mut(b).iter_mut().enumerate() {
                    *r = e[k] + rho[k] * (sums[k] / system.areas()[k]) - x[k];
                }
            }
            (Some(SlowMode::new(system, &d, Bands::new(of_rho, m))), cost)
        } else {
            (None, system.residual(Direction::Gather, shot.view(), residual.view_mut())?)
        };
        let mut work = Work::new(d, residual.view());
        work.slow = slow;
        if self.deflated {
            work.solve_slow_mode(&mut shot, rho);
            work.unscale_residual(&mut residual);
        }
        work.p.values_mut().copy_from_slice(work.r.values());
        (0..bands).for_each(|b| work.deflate(b));
        self.work = Some(work);
        Ok((Iterate { shot, residual: Some(residual) }, cost))
    }

    fn release(&mut self) {
        self.work = None;
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
            let unit = work.units[b];
            shot.band_mut(b).iter_mut().zip(dp).for_each(|(x, dp)| *x += alpha * dp * unit);
            work.r.band_mut(b).iter_mut().zip(mp).for_each(|(r, mp)| *r -= alpha * mp);
        }
        work.unscale_residual(residual);
        work.updates += 1;
        if system.unshot(residual.view()) < f64::from(work.updates).sqrt() * rounding_level(system, shot.view()) {
            work.updates = 0;
            cost += system.residual(Direction::Gather, shot.view(), residual.view_mut())?;
            work.scale_residual(residual.view());
        }
        // The next direction, with the β that makes it conjugate to p even if r was recomputed.
        for (b, &curvature) in curvatures.iter().enumerate().filter(|band| *band.1 > 0.0) {
            let beta = -dot(work.r.band(b), work.mp.band(b)) / curvature;
            work.p.band_mut(b).iter_mut().zip(work.r.band(b)).for_each(|(p, r)| *p = r + beta * *p);
            work.deflate(b);
        }
        cost.flops += 16 * shot.values().len() as u64;
        Ok((Progress::Residual, cost))
    }
}
