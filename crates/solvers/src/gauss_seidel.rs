//! Gauss–Seidel iteration: everything gathers in turn, from what is newest.

use radiosity_core::{
    BandValues, Bands, BandsMut, Block, Cost, Direction, Form, Iterate, Needs, Progress, Solver, StoreError, System,
};

use crate::fraction;

/// Gauss–Seidel iteration over [`radiosity_core::FormFactors::sweep`].
///
/// In order of s,
///
/// ```text
/// x_s ← (E_s + ρ_s Σ_{t ≠ s} F_st x_t) / (1 − ρ_s F_ss)
/// ```
///
/// with the newest x_t (M. F. Cohen and D. P. Greenberg, "The hemi-cube", SIGGRAPH 1985; Y. Saad, *Iterative Methods
/// for Sparse Linear Systems*, 2nd ed., 2003, section 4.1). From elements to patches an element gathers from the patch
/// means as they were when its block of rows began, and its change enters its own patch's mean at once.
///
/// - *Reads*: every row once a step, gathering; the full form and elements → patches.
/// - *Convergence*: whenever Jacobi's does in the maximum norm (ρ times the row sum below 1), in about half the steps
///   for symmetric F.
/// - *Residual*: none at hand. A step claims η = Σ A|x_new − x_old| / Σ A E of the worst band, which is above the true
///   η while row sums times ρ are below 1; the loop verifies it. Starts from x = E.
/// - *Breakdown*: if 1 − ρ_s F_ss is not positive.
/// - *Memory*: in the substructured form the patch means, else nothing beside x.
#[derive(Clone, Debug, Default)]
pub struct GaussSeidel {
    sweeps: Sweeps,
}

/// What a relaxation of a block needs to know of the system.
struct Equation<'s> {
    /// Share of the change that is made: 1 is Gauss–Seidel.
    omega: f64,
    areas: &'s [f64],
    e: Bands<'s>,
    rho: Bands<'s>,
}

impl Equation<'_> {
    /// Relaxes the rows of a block in order; false if a diagonal is not positive.
    fn relax(&self, block: &Block<'_>, mut x: BandsMut<'_>, changed: &mut [f64]) -> bool {
        let (len, begin) = (block.range.len(), block.range.start);
        let mut positive = true;
        for (b, changed) in changed.iter_mut().enumerate() {
            let (inside, outside) = (inside(block, b), block.outside.band(b));
            let x = &mut x.band(b)[block.range.clone()];
            let (e, rho) = (&self.e.band(b)[begin..], &self.rho.band(b)[begin..]);
            for k in 0..len {
                let (a, row) = (self.areas[begin + k], &inside[k * len..(k + 1) * len]);
                let others: f64 = row[..k].iter().zip(&x[..k]).map(|(f, x)| f * x).sum::<f64>()
                    + row[k + 1..].iter().zip(&x[k + 1..]).map(|(f, x)| f * x).sum::<f64>();
                let diagonal = 1.0 - rho[k] * row[k] / a;
                let change = (e[k] + rho[k] * (outside[k] + others) / a) / diagonal - x[k];
                *changed += a * change.abs();
                x[k] += self.omega * change;
                positive &= diagonal > 0.0;
            }
        }
        positive
    }

    /// Gathers the elements of a block from patch means p and carries their changes into the means.
    fn relax_elements(
        &self,
        block: &Block<'_>,
        (mut p, mut x): (BandsMut<'_>, BandsMut<'_>),
        (parent, patch_areas): (&[u32], &[f64]),
        changed: &mut [f64],
    ) {
        let len = block.range.len();
        for (b, changed) in changed.iter_mut().enumerate() {
            let (p, x, outside) = (p.band(b), x.band(b), block.outside.band(b));
            let (e, rho) = (self.e.band(b), self.rho.band(b));
            for (k, s) in block.range.clone().enumerate() {
                let mut sum = outside[k];
                if !block.inside.is_empty() {
                    // As many patches as elements: the store hands part of the row over as it does in the full form.
                    let inside = inside(block, b);
                    let row = inside[k * len..(k + 1) * len].iter().zip(&p[block.range.clone()]);
                    sum += row.map(|(f, p)| f * p).sum::<f64>();
                }
                let (a, patch) = (self.areas[s], parent[s] as usize);
                let change = e[s] + rho[s] * sum / a - x[s];
                x[s] += self.omega * change;
                p[patch] += a * self.omega * change / patch_areas[patch];
                *changed += a * change.abs();
            }
        }
    }
}

/// Exchange areas inside the block that serve band b: from its own table, or the one for all bands.
fn inside<'b>(block: &Block<'b>, b: usize) -> &'b [f64] {
    let size = block.range.len().pow(2);
    let at = if block.inside.len() > size { b * size } else { 0 };
    &block.inside[at..at + size]
}

/// Sweeps that relax by ω, and how much they changed: what Gauss–Seidel and over-relaxation share.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sweeps {
    /// Σ A E of every band.
    emitted: Vec<f64>,
    /// Σ A|change| of every band in the last sweep, before ω.
    changed: Vec<f64>,
}

impl Sweeps {
    /// Sweeps of a system.
    pub fn new(system: &System<'_>) -> Self {
        let emitted = (0..system.bands()).map(|b| system.power(system.emission().band(b))).collect();
        Self { emitted, changed: vec![0.0; system.bands()] }
    }

    /// One sweep: x_s ← x_s + ω (x_s of Gauss–Seidel − x_s), in order.
    pub fn relax(
        &mut self,
        system: &System<'_>,
        x: &mut BandValues,
        omega: f64,
    ) -> Result<(Progress, Cost), StoreError> {
        let Self { emitted, changed } = self;
        let equation = Equation { omega, areas: system.areas(), e: system.emission(), rho: system.reflectance() };
        changed.fill(0.0);
        let (store, mut sound) = (system.store(), true);
        let mut cost = match (system.form(), system.parent()) {
            (Form::ElementsToPatches, Some(parent)) => {
                // Anew in each sweep, so that rounding of the running means does not add up.
                let mut means: BandValues = system.patch_means(x.view());
                let patches = (parent, system.patch_areas());
                store.sweep(means.view_mut(), &mut |block, p| {
                    equation.relax_elements(block, (p, x.view_mut()), patches, changed);
                })?
            }
            _ => store.sweep(x.view_mut(), &mut |block, x| sound &= equation.relax(block, x, changed))?,
        };
        cost.flops += 8 * x.values().len() as u64;
        if !sound {
            return Ok((Progress::Breakdown, cost));
        }
        let fractions = changed.iter().zip(emitted.iter()).map(|(&left, &emitted)| fraction(left, emitted));
        // A NaN must not be lost in a maximum.
        let unshot = fractions.fold(0.0, |worst: f64, eta| if worst.is_nan() || eta <= worst { worst } else { eta });
        Ok((Progress::Claim { unshot }, cost))
    }
}

impl Solver for GaussSeidel {
    fn name(&self) -> &'static str {
        "gauss-seidel"
    }

    fn needs(&self) -> Needs {
        let forms = &[Form::Full, Form::ElementsToPatches];
        Needs { forms, direction: Direction::Gather, symmetric: false }
    }

    fn start(&mut self, system: &System<'_>, from: Option<Bands<'_>>) -> Result<(Iterate, Cost), StoreError> {
        self.sweeps = Sweeps::new(system);
        let shot = from.unwrap_or(system.emission()).to_owned();
        Ok((Iterate { shot, residual: None }, Cost::default()))
    }

    fn step(&mut self, system: &System<'_>, iterate: &mut Iterate) -> Result<(Progress, Cost), StoreError> {
        self.sweeps.relax(system, &mut iterate.shot, 1.0)
    }
}
