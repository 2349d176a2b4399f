//! GMRES: the smallest residual over a Krylov space, for systems that are not symmetric.

use radiosity_core::{BandValues, Bands, Cost, Direction, Form, Iterate, Needs, Progress, Solver, StoreError, System};

use crate::rounding_level;

/// Restarted GMRES in the norm of power.
///
/// In the inner product ⟨u, v⟩ = Σ A u v, Arnoldi's process makes an orthonormal basis v₁ … v_{k+1} of the space spanned by r⁰, Gr⁰, …, Gᵏr⁰,
/// G = I − ρF, with G V_k = V_{k+1} H; Givens rotations solve
///
/// ```text
/// y = argmin ‖ ‖r⁰‖ e₁ − H y ‖,      x = x⁰ + V_k y,      r = V_{k+1} (‖r⁰‖ e₁ − H y)
/// ```
///
/// (Y. Saad and M. H. Schultz, "GMRES: a generalized minimal residual algorithm for solving nonsymmetric linear systems", SIAM J.
/// Sci. Stat. Comput. 7, 1986). x and r are formed after every step, so the loop sees a true iterate; each band has a space of its own, and all
/// share the product. After 30 steps, or once the space holds the solution, the process begins anew from r recomputed.
///
/// - *Reads*: every row once a step, and once more a restart; all forms, in either direction of the full form.
/// - *Convergence*: √(Σ A r²) never grows; without symmetry there is no rate, but a system that contracts by q loses at least that factor a
///   step, and outliers cost one step each. Needs no bound on row sums: it solves systems on which Jacobi diverges, if G is
///   not singular.
/// - *Accuracy*: Gram–Schmidt twice, so V is orthonormal to rounding; once η is below 10⁴ ε Σ A|x| / Σ A E each step restarts.
/// - *Memory*: up to 31 vectors a band beside x and r.
#[derive(Clone, Debug)]
pub struct Gmres {
    direction: Direction,
    restart: usize,
    spaces: Vec<Krylov>,
    product: Option<BandValues>,
}

/// Vectors of a space before it is begun anew.
const RESTART: usize = 30;

impl Gmres {
    /// GMRES that reads the full form in `direction`.
    pub fn new(direction: Direction) -> Self {
        Self { direction, restart: RESTART, spaces: Vec::new(), product: None }
    }
}

impl Gmres {
    /// Begins anew after `steps` steps.
    ///
    /// # Panics
    ///
    /// If `steps` is 0.
    #[must_use]
    pub fn restart(self, steps: usize) -> Self {
        assert!(steps > 0, "a space has at least one vector");
        Self { restart: steps, ..self }
    }
}

impl Default for Gmres {
    fn default() -> Self {
        Self::new(Direction::Gather)
    }
}

/// The Krylov space of one band.
#[derive(Clone, Debug, Default)]
struct Krylov {
    /// x at the restart.
    x: Vec<f64>,
    /// v₁, v₂, …
    basis: Vec<Vec<f64>>,
    /// Columns of R, of H after the rotations.
    columns: Vec<Vec<f64>>,
    /// Cosines and sines of the rotations.
    rotations: Vec<(f64, f64)>,
    /// ‖r⁰‖ e₁ after the rotations.
    right: Vec<f64>,
    /// Whether the space holds the solution: nothing is left to add.
    closed: bool,
}

fn dot(areas: &[f64], u: &[f64], v: &[f64]) -> f64 {
    areas.iter().zip(u).zip(v).map(|((a, u), v)| a * u * v).sum()
}

/// √⟨u, u⟩, in the unit of the largest value: squares neither over- nor underflow.
fn norm(areas: &[f64], u: &[f64]) -> f64 {
    let largest = u.iter().fold(0.0_f64, |most, u| most.max(u.abs()));
    if largest == 0.0 || !largest.is_finite() {
        return largest;
    }
    let sum: f64 = areas.iter().zip(u).map(|(a, u)| a * (u / largest).powi(2)).sum();
    largest * sum.sqrt()
}

fn add(y: &mut [f64], factor: f64, x: &[f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += factor * x);
}

impl Krylov {
    fn new(areas: &[f64], x: &[f64], r: &[f64]) -> Self {
        let norm = norm(areas, r);
        let mut space = Self { x: x.to_vec(), right: vec![norm], closed: norm == 0.0, ..Self::default() };
        if norm > 0.0 {
            space.basis.push(r.iter().map(|r| r / norm).collect());
        }
        space
    }

    /// Takes in w = G v_k.
    fn extend(&mut self, areas: &[f64], mut w: Vec<f64>) {
        let (k, size) = (self.basis.len(), dot(areas, &w, &w).sqrt());
        // Gram–Schmidt, twice: once leaves ε κ of the old directions.
        let mut h = vec![0.0; k + 1];
        for _ in 0..2 {
            for (h, v) in h.iter_mut().zip(&self.basis) {
                let part = dot(areas, &w, v);
                add(&mut w, -part, v);
                *h += part;
            }
        }
        let norm = dot(areas, &w, &w).sqrt();
        // What rounding leaves of a vector that lies in the space is no direction.
        self.closed = norm.is_nan() || norm <= k as f64 * f64::EPSILON * size;
        h[k] = if self.closed { 0.0 } else { norm };
        // Old rotations, then the one that clears the new entry.
        for (l, &(c, s)) in self.rotations.iter().enumerate() {
            (h[l], h[l + 1]) = (c * h[l] + s * h[l + 1], c * h[l + 1] - s * h[l]);
        }
        let radius = h[k - 1].hypot(h[k]);
        let (c, s) = if radius > 0.0 { (h[k - 1] / radius, h[k] / radius) } else { (1.0, 0.0) };
        (h[k - 1], h[k]) = (radius, 0.0);
        let last = self.right[k - 1];
        self.right[k - 1] = c * last;
        self.right.push(-s * last);
        self.rotations.push((c, s));
        h.truncate(k);
        self.columns.push(h);
        if !self.closed {
            self.basis.push(w.into_iter().map(|w| w / norm).collect());
        }
    }

    /// x and r of the smallest residual in the space; false if G is singular on it.
    fn solution(&self, x: &mut [f64], r: &mut [f64]) -> bool {
        let k = self.columns.len();
        let mut y = self.right[..k].to_vec();
        for l in (0..k).rev() {
            let sum: f64 = (l + 1..k).map(|j| self.columns[j][l] * y[j]).sum();
            y[l] = (y[l] - sum) / self.columns[l][l];
        }
        if y.iter().any(|y| !y.is_finite()) {
            return false;
        }
        x.copy_from_slice(&self.x);
        y.iter().zip(&self.basis).for_each(|(y, v)| add(x, *y, v));
        // r = V Qᵀ (0, …, 0, last): the rotations undone.
        let mut turned = vec![0.0; k + 1];
        turned[k] = self.right[k];
        for (l, &(c, s)) in self.rotations.iter().enumerate().rev() {
            (turned[l], turned[l + 1]) = (c * turned[l] - s * turned[l + 1], s * turned[l] + c * turned[l + 1]);
        }
        r.fill(0.0);
        turned.iter().zip(&self.basis).for_each(|(factor, v)| add(r, *factor, v));
        true
    }
}

impl Solver for Gmres {
    fn name(&self) -> &'static str {
        "gmres"
    }

    fn needs(&self) -> Needs {
        let forms = &[Form::Full, Form::ElementsToPatches, Form::PatchesToElements];
        Needs { forms, direction: self.direction, symmetric: false }
    }

    fn start(&mut self, system: &System<'_>, from: Option<Bands<'_>>) -> Result<(Iterate, Cost), StoreError> {
        let shot = from.unwrap_or(system.emission()).to_owned();
        let mut residual = shot.clone();
        let cost = system.residual(self.direction, shot.view(), residual.view_mut())?;
        self.product = Some(shot.clone());
        self.begin(system, &shot, &residual);
        Ok((Iterate { shot, residual: Some(residual) }, cost))
    }

    fn release(&mut self) {
        (self.spaces, self.product) = (Vec::new(), None);
    }

    fn step(&mut self, system: &System<'_>, iterate: &mut Iterate) -> Result<(Progress, Cost), StoreError> {
        let Iterate { shot, residual } = iterate;
        let r = residual.as_mut().expect("start gave one");
        // G v of every band in one product; a closed space takes part with zeros.
        let mut last = BandValues::zeros(system.bands(), system.elements());
        for (b, space) in self.spaces.iter().enumerate().filter(|(_, space)| !space.closed) {
            last.band_mut(b).copy_from_slice(&space.basis[space.basis.len() - 1]);
        }
        let product = self.product.as_mut().expect("start comes before step");
        let mut cost = system.irradiance(self.direction, last.view(), product.view_mut())?;
        let mut sound = true;
        for (b, space) in self.spaces.iter_mut().enumerate().filter(|(_, space)| !space.closed) {
            let (h, rho) = (product.band(b), system.reflectance().band(b));
            let w = last.band(b).iter().zip(rho.iter().zip(h)).map(|(v, (rho, h))| v - rho * h).collect();
            cost.flops += (12 * space.basis.len() as u64 + 8) * system.elements() as u64;
            space.extend(system.areas(), w);
            sound &= space.solution(shot.band_mut(b), r.band_mut(b));
        }
        if !sound {
            return Ok((Progress::Breakdown, cost));
        }
        let full = self.spaces.iter().any(|space| space.columns.len() >= self.restart);
        if full
            || self.spaces.iter().all(|space| space.closed)
            || system.unshot(r.view()) < 1e4 * rounding_level(system, shot.view())
        {
            cost += system.residual(self.direction, shot.view(), r.view_mut())?;
            self.begin(system, shot, r);
        }
        Ok((Progress::Residual, cost))
    }
}

impl Gmres {
    fn begin(&mut self, system: &System<'_>, x: &BandValues, r: &BandValues) {
        self.spaces = (0..system.bands()).map(|b| Krylov::new(system.areas(), x.band(b), r.band(b))).collect();
    }
}
