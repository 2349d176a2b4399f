//! Direct solution: one factorisation, then refinement.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::{cholesky::llt, lu::partial_pivoting as lu};
use faer::perm::PermRef;
use faer::{Conj, Mat, Par};
use radiosity_core::{
    BandValues, Bands, Cost, Direction, Form, Iterate, Needs, Progress, RowBuf, Solver, StoreError, System,
};
use rayon::prelude::*;

/// Which factorisation [`Direct`] uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Factorisation {
    /// Cholesky on a symmetric store, LU on any other.
    Automatic,
    /// Cholesky; refuses stores that are not symmetric.
    Cholesky,
    /// LU with partial pivoting.
    Lu,
}

/// Direct solution by dense factorisation (faer).
///
/// On a symmetric store the scaled symmetric positive definite form is factored, with D = √(ρ/A),
///
/// ```text
/// M = I − D (AF) D = L Lᵀ,      correction c of x:  M z = D⁻¹ r,  c = D z   (0 where ρ = 0)
/// ```
///
/// and otherwise G = I − ρF (or its shooting counterpart) = P⁻¹ L U with G c = r. Each step adds c to x = E and
/// recomputes r = E + ρFx − x, so the first is the solution and every further one an iterative refinement (G. H. Golub
/// and C. F. Van Loan, *Matrix Computations*, 4th ed., 2013, sections 3.4, 3.5 and 4.2).
///
/// - *Reads*: every row once in the first step, and one product a step; the full form, in either direction.
/// - *Work*: n³/3 multiplications and additions each (Cholesky; LU twice that) for every *distinct* reflectance
///   vector: a grey scene is factored once. Then n² a band and step.
/// - *Memory*: 8n² bytes for every distinct reflectance vector, beside the store.
/// - *Breakdown*: if M is not positive definite (row sums times ρ above 1); a singular G gives values that are not
///   finite. LU of a system that does not contract gives a solution of it, which no bound covers.
/// - *Start values* are not used. The degree of parallelism is fixed, so bytes do not depend on the number of threads.
#[derive(Debug)]
pub struct Direct {
    factorisation: Factorisation,
    direction: Direction,
    factors: Vec<Factor>,
}

/// A factored matrix and the bands it serves.
#[derive(Debug)]
struct Factor {
    bands: Vec<usize>,
    /// D of the symmetric form.
    scale: Option<Vec<f64>>,
    matrix: Mat<f64>,
    /// Row permutation of LU and its inverse.
    permutation: (Vec<usize>, Vec<usize>),
}

/// Pieces into which faer cuts its work, whatever the number of threads: equal bytes. More pieces than
/// threads cost little, waiting for busy threads does.
const PAR: usize = 4;
/// Rows that are held at once while matrices are filled.
const BLOCK: usize = 64;

impl Direct {
    /// A direct solver that reads the full form in `direction` (the same on a symmetric store).
    pub fn new(factorisation: Factorisation, direction: Direction) -> Self {
        Self { factorisation, direction, factors: Vec::new() }
    }

    /// Reads all rows once and factors; the cost, and whether every factorisation succeeded.
    fn factor(&mut self, system: &System<'_>) -> Result<(bool, Cost), StoreError> {
        let (n, properties) = (system.elements(), system.store().properties());
        let symmetric = match self.factorisation {
            Factorisation::Automatic => properties.symmetric,
            Factorisation::Cholesky => true,
            Factorisation::Lu => false,
        };
        self.factors = distinct(system, properties.per_band)
            .into_iter()
            .map(|bands| {
                let rho = system.reflectance().band(bands[0]).iter().zip(system.areas());
                let scale = symmetric.then(|| rho.map(|(rho, a)| (rho / a).sqrt()).collect());
                Factor { bands, scale, matrix: Mat::zeros(n, n), permutation: (vec![0; n], vec![0; n]) }
            })
            .collect();
        let mut cost = self.fill(system, properties.per_band)?;
        let mut sound = true;
        for factor in &mut self.factors {
            let cubed = (n as u64).pow(3);
            cost.flops += if factor.scale.is_some() { cubed / 3 } else { 2 * cubed / 3 };
            sound &= factor.decompose();
        }
        Ok((sound, cost))
    }

    /// Column s of every matrix from row s of the exchange areas, each row asked for once.
    fn fill(&mut self, system: &System<'_>, per_band: bool) -> Result<Cost, StoreError> {
        let (n, areas, store) = (system.elements(), system.areas(), system.store());
        let mut total = Cost::default();
        for begin in (0..n).step_by(BLOCK) {
            let range = begin..(begin + BLOCK).min(n);
            let rows_of = |band: usize| -> Result<Vec<(Vec<f64>, Cost)>, StoreError> {
                let row = |buf: &mut RowBuf, s: usize| {
                    let row = store.row(s, band, buf)?;
                    let mut values = vec![0.0; n];
                    row.entries.for_each(|t, value| values[t] = value);
                    Ok((values, row.cost + Cost::applied(row.entries.stored(), 8, 1)))
                };
                range.clone().into_par_iter().map_init(RowBuf::default, row).collect()
            };
            let mut rows = Vec::new();
            for (k, factor) in self.factors.iter_mut().enumerate() {
                if k == 0 || per_band {
                    rows = rows_of(factor.bands[0])?;
                    total += rows.iter().map(|row| row.1).sum();
                }
                let rho = system.reflectance().band(factor.bands[0]);
                let block = factor.matrix.as_mut().subcols_mut(begin, range.len());
                let columns = block.par_col_iter_mut().zip(&rows).enumerate();
                columns.for_each(|(l, (mut column, (values, _)))| {
                    let s = begin + l;
                    for (t, &value) in values.iter().enumerate() {
                        let coupling = match (&factor.scale, self.direction) {
                            (Some(d), _) => d[s] * value * d[t],
                            // The transpose of G: its column s is row s of G.
                            (None, Direction::Gather) => rho[s] * value / areas[s],
                            (None, Direction::Shoot) => rho[t] * value / areas[t],
                        };
                        column[t] = if s == t { 1.0 - coupling } else { -coupling };
                    }
                });
            }
        }
        Ok(total)
    }
}

/// Lists of bands with bit-equal reflectance; every band by itself if the store's rows differ between bands.
fn distinct(system: &System<'_>, per_band: bool) -> Vec<Vec<usize>> {
    let rho = system.reflectance();
    let mut lists: Vec<Vec<usize>> = Vec::new();
    for b in 0..rho.count() {
        match lists.iter_mut().find(|list| !per_band && rho.band(list[0]) == rho.band(b)) {
            Some(list) => list.push(b),
            None => lists.push(vec![b]),
        }
    }
    lists
}

impl Factor {
    /// Replaces the matrix by its factors; false if it is not positive definite where it should be.
    fn decompose(&mut self) -> bool {
        let (n, par) = (self.matrix.nrows(), Par::rayon(PAR));
        if self.scale.is_some() {
            let mut memory = MemBuffer::new(llt::factor::cholesky_in_place_scratch::<f64>(n, par, Default::default()));
            let stack = MemStack::new(&mut memory);
            let matrix = self.matrix.as_mut();
            llt::factor::cholesky_in_place(matrix, Default::default(), par, stack, Default::default()).is_ok()
        } else {
            let scratch = lu::factor::lu_in_place_scratch::<usize, f64>(n, n, par, Default::default());
            let mut memory = MemBuffer::new(scratch);
            let (forward, inverse) = &mut self.permutation;
            let stack = MemStack::new(&mut memory);
            lu::factor::lu_in_place(self.matrix.as_mut(), forward, inverse, par, stack, Default::default());
            true
        }
    }

    /// Corrections of x for the residuals of this factor's bands.
    fn solve(&self, direction: Direction, r: Bands<'_>) -> Mat<f64> {
        let (n, count, par) = (self.matrix.nrows(), self.bands.len(), Par::rayon(PAR));
        let unscaled = |e: usize, k: usize| -> f64 { r.band(self.bands[k])[e] };
        let Some(d) = &self.scale else {
            let mut c = Mat::from_fn(n, count, unscaled);
            let mut memory = MemBuffer::new(
                lu::solve::solve_in_place_scratch::<usize, f64>(n, count, par)
                    .or(lu::solve::solve_transpose_in_place_scratch::<usize, f64>(n, count, par)),
            );
            let (stack, f) = (MemStack::new(&mut memory), self.matrix.as_ref());
            let permutation = PermRef::new_checked(&self.permutation.0, &self.permutation.1, n);
            match direction {
                Direction::Gather => {
                    lu::solve::solve_transpose_in_place_with_conj(f, f, permutation, Conj::No, c.as_mut(), par, stack);
                }
                Direction::Shoot => {
                    lu::solve::solve_in_place_with_conj(f, f, permutation, Conj::No, c.as_mut(), par, stack);
                }
            }
            return c;
        };
        let mut c = Mat::from_fn(n, count, |e, k| if d[e] > 0.0 { unscaled(e, k) / d[e] } else { 0.0 });
        let mut memory = MemBuffer::new(llt::solve::solve_in_place_scratch::<f64>(n, count, par));
        llt::solve::solve_in_place_with_conj(
            self.matrix.as_ref(),
            Conj::No,
            c.as_mut(),
            par,
            MemStack::new(&mut memory),
        );
        for k in 0..count {
            (0..n).for_each(|e| c[(e, k)] *= d[e]);
        }
        c
    }
}

impl Default for Direct {
    fn default() -> Self {
        Self::new(Factorisation::Automatic, Direction::Gather)
    }
}

impl Solver for Direct {
    fn name(&self) -> &'static str {
        match self.factorisation {
            Factorisation::Automatic => "direct",
            Factorisation::Cholesky => "cholesky",
            Factorisation::Lu => "lu",
        }
    }

    fn needs(&self) -> Needs {
        let symmetric = self.factorisation == Factorisation::Cholesky;
        Needs { forms: &[Form::Full], direction: self.direction, symmetric }
    }

    fn start(&mut self, system: &System<'_>, _from: Option<Bands<'_>>) -> Result<(Iterate, Cost), StoreError> {
        self.factors.clear();
        let shot = system.emission().to_owned();
        let mut residual = BandValues::zeros(system.bands(), system.elements());
        let cost = system.residual(self.direction, shot.view(), residual.view_mut())?;
        Ok((Iterate { shot, residual: Some(residual) }, cost))
    }

    fn step(&mut self, system: &System<'_>, iterate: &mut Iterate) -> Result<(Progress, Cost), StoreError> {
        let mut cost = Cost::default();
        if self.factors.is_empty() {
            let (sound, spent) = self.factor(system)?;
            cost += spent;
            if !sound {
                return Ok((Progress::Breakdown, cost));
            }
        }
        let Iterate { shot, residual } = iterate;
        let r = residual.as_mut().expect("start gave one");
        for factor in &self.factors {
            let c = factor.solve(self.direction, r.view());
            for (k, &b) in factor.bands.iter().enumerate() {
                shot.band_mut(b).iter_mut().zip(c.col_as_slice(k)).for_each(|(x, c)| *x += c);
            }
        }
        let squared = (system.elements() as u64).pow(2);
        cost.flops += 2 * squared * system.bands() as u64;
        cost += system.residual(self.direction, shot.view(), r.view_mut())?;
        Ok((Progress::Residual, cost))
    }
}
