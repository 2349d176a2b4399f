//! Direct solution: one factorisation, then refinement.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::{cholesky::llt, lu::partial_pivoting as lu};
use faer::perm::PermRef;
use faer::traits::RealField;
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

/// A number that factors may be held in: `f64` or `f32`.
trait Real: RealField + Copy + 'static {
    fn round(value: f64) -> Self;
    fn widen(self) -> f64;
}

impl Real for f64 {
    fn round(value: f64) -> Self {
        value
    }

    fn widen(self) -> f64 {
        self
    }
}

impl Real for f32 {
    fn round(value: f64) -> Self {
        value as f32
    }

    fn widen(self) -> f64 {
        self.into()
    }
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
/// **In single precision** the matrix is rounded and factored in half the memory and about half the time; residuals are those of the
/// store, in double precision, so refinement goes on to the double answer (J. H. Wilkinson, *Rounding Errors in Algebraic Processes*, 1963;
/// E. Carson and N. J. Higham, SIAM J. Sci. Comput. 40, 2018). A step then gains a factor of about 10⁷/κ, where κ ≤ (1 + ρ)/(1 − ρ):
/// two or three steps in ordinary rooms; beyond κ = 10⁷ it stagnates or breaks down, and says so.
///
/// - *Reads*: every row once in the first step, and one product a step; the full form, in either direction.
/// - *Work*: n³/3 multiplications and additions each (Cholesky; LU twice that) for every *distinct* reflectance
///   vector: a grey scene is factored once. Then n² a band and step.
/// - *Memory*: 8n² bytes (4n² in single precision) for every distinct reflectance vector, beside the store.
/// - *Breakdown*: if M is not positive definite (row sums times ρ above 1); a singular G gives values that are not
///   finite. LU of a system that does not contract gives a solution of it, which no bound covers.
/// - *Start values* are not used. The degree of parallelism is fixed, so bytes do not depend on the number of threads.
#[derive(Debug)]
pub struct Direct {
    factorisation: Factorisation,
    direction: Direction,
    single: bool,
    factors: Vec<Box<dyn Factored>>,
}

/// What is asked of a factored matrix, whatever its numbers.
trait Factored: std::fmt::Debug + Send + Sync {
    /// Bands that it serves.
    fn bands(&self) -> &[usize];

    /// Corrections of x for the residuals of these bands.
    fn solve(&self, direction: Direction, r: Bands<'_>) -> Mat<f64>;
}

/// A factored matrix and the bands it serves.
#[derive(Debug)]
struct Factor<T> {
    bands: Vec<usize>,
    /// D of the symmetric form.
    scale: Option<Vec<f64>>,
    matrix: Mat<T>,
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
        Self { factorisation, direction, single: false, factors: Vec::new() }
    }

    /// Factors in single precision.
    #[must_use]
    pub fn single(self) -> Self {
        Self { single: true, ..self }
    }

    /// Reads all rows once and factors; the cost, and whether every factorisation succeeded.
    fn factor<T: Real>(&mut self, system: &System<'_>) -> Result<(bool, Cost), StoreError> {
        let (n, properties) = (system.elements(), system.store().properties());
        let symmetric = match self.factorisation {
            Factorisation::Automatic => properties.symmetric,
            Factorisation::Cholesky => true,
            Factorisation::Lu => false,
        };
        let mut factors: Vec<Factor<T>> = distinct(system, properties.per_band)
            .into_iter()
            .map(|bands| {
                let rho = system.reflectance().band(bands[0]).iter().zip(system.areas());
                let scale = symmetric.then(|| rho.map(|(rho, a)| (rho / a).sqrt()).collect());
                Factor { bands, scale, matrix: Mat::zeros(n, n), permutation: (vec![0; n], vec![0; n]) }
            })
            .collect();
        let mut cost = self.fill(&mut factors, system, properties.per_band)?;
        let mut sound = true;
        for factor in &mut factors {
            let cubed = (n as u64).pow(3);
            cost.flops += if factor.scale.is_some() { cubed / 3 } else { 2 * cubed / 3 };
            sound &= factor.decompose();
        }
        self.factors = factors.into_iter().map(|factor| Box::new(factor) as Box<dyn Factored>).collect();
        Ok((sound, cost))
    }

    /// Column s of every matrix from row s of the exchange areas, each row asked for once.
    fn fill<T: Real>(
        &self,
        factors: &mut [Factor<T>],
        system: &System<'_>,
        per_band: bool,
    ) -> Result<Cost, StoreError> {
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
            for (k, factor) in factors.iter_mut().enumerate() {
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
                        column[t] = T::round(if s == t { 1.0 - coupling } else { -coupling });
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

impl<T: Real> Factor<T> {
    /// Replaces the matrix by its factors; false if it is not positive definite where it should be.
    fn decompose(&mut self) -> bool {
        let (n, par) = (self.matrix.nrows(), Par::rayon(PAR));
        if self.scale.is_some() {
            let mut memory = MemBuffer::new(llt::factor::cholesky_in_place_scratch::<T>(n, par, Default::default()));
            let stack = MemStack::new(&mut memory);
            let matrix = self.matrix.as_mut();
            llt::factor::cholesky_in_place(matrix, Default::default(), par, stack, Default::default()).is_ok()
        } else {
            let scratch = lu::factor::lu_in_place_scratch::<usize, T>(n, n, par, Default::default());
            let mut memory = MemBuffer::new(scratch);
            let (forward, inverse) = &mut self.permutation;
            let stack = MemStack::new(&mut memory);
            lu::factor::lu_in_place(self.matrix.as_mut(), forward, inverse, par, stack, Default::default());
            true
        }
    }
}

impl<T: Real> Factored for Factor<T> {
    fn bands(&self) -> &[usize] {
        &self.bands
    }

    fn solve(&self, direction: Direction, r: Bands<'_>) -> Mat<f64> {
        let (n, count, par) = (self.matrix.nrows(), self.bands.len(), Par::rayon(PAR));
        // Residuals of any size fit single precision once their largest is 1.
        let sizes: Vec<f64> =
            self.bands.iter().map(|&b| r.band(b).iter().fold(f64::MIN_POSITIVE, |most, r| most.max(r.abs()))).collect();
        let unscaled = |e: usize, k: usize| -> f64 { r.band(self.bands[k])[e] / sizes[k] };
        let f = self.matrix.as_ref();
        let Some(d) = &self.scale else {
            let mut c = Mat::from_fn(n, count, |e, k| T::round(unscaled(e, k)));
            let mut memory = MemBuffer::new(
                lu::solve::solve_in_place_scratch::<usize, T>(n, count, par)
                    .or(lu::solve::solve_transpose_in_place_scratch::<usize, T>(n, count, par)),
            );
            let stack = MemStack::new(&mut memory);
            let permutation = PermRef::new_checked(&self.permutation.0, &self.permutation.1, n);
            match direction {
                Direction::Gather => {
                    lu::solve::solve_transpose_in_place_with_conj(f, f, permutation, Conj::No, c.as_mut(), par, stack);
                }
                Direction::Shoot => {
                    lu::solve::solve_in_place_with_conj(f, f, permutation, Conj::No, c.as_mut(), par, stack);
                }
            }
            return Mat::from_fn(n, count, |e, k| c[(e, k)].widen() * sizes[k]);
        };
        // The largest of r/D is 1, whatever the areas.
        let largest = |k: usize| {
            let scaled = (0..n).filter(|&e| d[e] > 0.0).map(|e| (unscaled(e, k) / d[e]).abs());
            scaled.fold(f64::MIN_POSITIVE, f64::max)
        };
        let most: Vec<f64> = (0..count).map(largest).collect();
        let scaled = |e: usize, k: usize| if d[e] > 0.0 { unscaled(e, k) / d[e] / most[k] } else { 0.0 };
        let mut c = Mat::from_fn(n, count, |e, k| T::round(scaled(e, k)));
        let mut memory = MemBuffer::new(llt::solve::solve_in_place_scratch::<T>(n, count, par));
        llt::solve::solve_in_place_with_conj(f, Conj::No, c.as_mut(), par, MemStack::new(&mut memory));
        Mat::from_fn(n, count, |e, k| d[e] * c[(e, k)].widen() * most[k] * sizes[k])
    }
}

impl Default for Direct {
    fn default() -> Self {
        Self::new(Factorisation::Automatic, Direction::Gather)
    }
}

impl Solver for Direct {
    fn name(&self) -> &'static str {
        match (self.factorisation, self.single) {
            (Factorisation::Automatic, false) => "direct",
            (Factorisation::Cholesky, false) => "cholesky",
            (Factorisation::Lu, false) => "lu",
            (Factorisation::Automatic, true) => "direct-f32",
            (Factorisation::Cholesky, true) => "cholesky-f32",
            (Factorisation::Lu, true) => "lu-f32",
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

    fn release(&mut self) {
        self.factors.clear();
    }

    fn step(&mut self, system: &System<'_>, iterate: &mut Iterate) -> Result<(Progress, Cost), StoreError> {
        let mut cost = Cost::default();
        if self.factors.is_empty() {
            let (sound, spent) = if self.single { self.factor::<f32>(system) } else { self.factor::<f64>(system) }?;
            cost += spent;
            if !sound {
                return Ok((Progress::Breakdown, cost));
            }
        }
        let Iterate { shot, residual } = iterate;
        let r = residual.as_mut().expect("start gave one");
        for factor in &self.factors {
            let c = factor.solve(self.direction, r.view());
            for (k, &b) in factor.bands().iter().enumerate() {
                shot.band_mut(b).iter_mut().zip(c.col_as_slice(k)).for_each(|(x, c)| *x += c);
            }
        }
        let squared = (system.elements() as u64).pow(2);
        cost.flops += 2 * squared * system.bands() as u64;
        cost += system.residual(self.direction, shot.view(), r.view_mut())?;
        Ok((Progress::Residual, cost))
    }
}
