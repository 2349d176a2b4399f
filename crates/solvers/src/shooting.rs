//! Progressive refinement: the brightest unshot power is shot first.

use std::ops::Range;

use radiosity_core::{
    BandValues, Bands, Cost, Direction, Entries, Form, Iterate, Needs, Progress, Row, RowBuf, Solver, StoreError,
    System,
};
use rayon::prelude::*;

use crate::ambient;

/// Progressive refinement by shooting (Southwell's relaxation).
///
/// One step takes the source p with the largest unshot power Σ_e∈p A_e r_e, summed over the bands, and shoots it:
///
/// ```text
/// ΔB_p = (1/A_p) Σ_{e in p} A_e r_e
/// x_e ← x_e + r_e,  r_e ← 0                     for the elements e of p
/// r_t ← r_t + ρ_t A_p F_pt ΔB_p / A_t           for every element t
/// ```
///
/// (M. F. Cohen, S. E. Chen, J. R. Wallace and D. P. Greenberg, "A progressive refinement approach to fast radiosity
/// image generation", SIGGRAPH 1988). In the full form a source is one element. Since H depends on patch means alone,
/// r = E + ρH(x) − x holds after every shot, with the deviations of the elements from their patch's mean absorbed into
/// x. F_pp ≠ 0 leaves ρ F_pp ΔB_p unshot.
///
/// **Overshooting** also shoots what a source is expected to receive later: with the ambient term H of the moment (see
/// [`crate::ambient`]),
///
/// ```text
/// x_e ← x_e + r_e + ρ_e H,  r_e ← −ρ_e H
/// ```
///
/// and sources are ranked by what they would shoot (M. Feda and W. Purgathofer, "Accelerating radiosity by overshooting", EG Workshop on
/// Rendering 1992; S. J. Gortler, M. F. Cohen and P. Slusallek, "Radiosity and relaxation methods", IEEE CG&A 14, 1994). What arrives
/// later pays the debt, and r stays true. It saves shots where reflectance is high and light is spread.
///
/// **Several sources a step** are shot one after another, ranked together; their rows are had in parallel.
///
/// - *Reads*: one row a step (or one for each of several sources); the full form in the shooting direction and patches → elements. Sources that never
///   become the brightest are never asked for.
/// - *Choice*: |r| counts where a start value makes r negative; of equal powers the lowest index shoots.
/// - *Convergence*: Σ A|r| falls in every step if ρ times the part of the power that arrives is below 1.
/// - *Accuracy*: r is carried from shot to shot. Once its rounding could be a hundredth of what is unshot (only near
///   rounding level), r is recomputed from x, at one product, at most once every n shots.
/// - *Memory*: a row, and the lists of elements by patch.
#[derive(Clone, Debug, Default)]
pub struct Shooting {
    /// Elements by source, the lists one after another.
    elements: Vec<u32>,
    /// Begin of each source's list in `elements`, and the end of the last.
    begins: Vec<usize>,
    /// ΔB of the source that shoots, in every band.
    delta: Vec<f64>,
    /// Bound of the rounding Σ A|error of r| since r was last computed from x.
    rounding: f64,
    /// Shots since then.
    shots: usize,
    /// Rows of the sources that shoot together.
    bufs: Vec<RowBuf>,
    /// Sources that shoot in one step, less one.
    others: usize,
    overshooting: bool,
    /// Irradiance expected later, of every band; zeros unless overshooting.
    expected: Vec<f64>,
}

impl Shooting {
    /// Progressive refinement that shoots `count` sources a step.
    ///
    /// # Panics
    ///
    /// If `count` is 0.
    pub fn several(count: usize) -> Self {
        assert!(count > 0, "a step shoots at least one source");
        Self { others: count - 1, ..Self::default() }
    }

    /// Progressive refinement with overshooting.
    pub fn overshooting() -> Self {
        Self { overshooting: true, ..Self::default() }
    }

    fn elements_of(&self, s: usize) -> &[u32] {
        &self.elements[self.begins[s]..self.begins[s + 1]]
    }

    /// Power Σ A|r + ρH| that source s would shoot in all bands, and Σ A|r| of it.
    fn power(&self, s: usize, system: &System<'_>, r: Bands<'_>) -> (f64, f64) {
        let (mut shot, mut unshot) = (0.0, 0.0);
        for b in 0..r.count() {
            let (r, rho, h) = (r.band(b), system.reflectance().band(b), self.expected[b]);
            for e in self.elements_of(s).iter().map(|&e| e as usize) {
                shot += system.areas()[e] * (r[e] + rho[e] * h).abs();
                unshot += system.areas()[e] * r[e].abs();
            }
        }
        (shot, unshot)
    }

    /// The brightest sources that have anything to shoot, of equal ones the first, and Σ A|r| of all.
    fn brightest(&self, system: &System<'_>, r: Bands<'_>) -> (Vec<usize>, f64) {
        let (mut ranked, mut unshot): (Vec<(f64, usize)>, f64) = (Vec::new(), 0.0);
        for s in 0..system.patch_areas().len() {
            let (power, own) = self.power(s, system, r);
            unshot += own;
            let full = ranked.len() > self.others;
            if power > 0.0 && !(full && ranked[self.others].0 >= power) {
                ranked.truncate(self.others);
                ranked.insert(ranked.partition_point(|kept| kept.0 >= power), (power, s));
            }
        }
        (ranked.into_iter().map(|(_, s)| s).collect(), unshot)
    }

    /// The elements of source s hand over what they have: their mean in every band goes to `delta`.
    fn load(&mut self, s: usize, system: &System<'_>, shot: &mut BandValues, r: &mut BandValues) {
        let elements = &self.elements[self.begins[s]..self.begins[s + 1]];
        for (b, delta) in self.delta.iter_mut().enumerate() {
            let (x, r, rho, h) = (shot.band_mut(b), r.band_mut(b), system.reflectance().band(b), self.expected[b]);
            let mut power = 0.0;
            for e in elements.iter().map(|&e| e as usize) {
                let debt = rho[e] * h;
                power += system.areas()[e] * (r[e] + debt);
                x[e] += r[e] + debt;
                r[e] = if debt == 0.0 { 0.0 } else { -debt };
            }
            *delta = power / system.patch_areas()[s];
        }
    }
}

/// What arrives of `delta` in the bands `served` is reflected: unshot radiosity of every element that sees the source.
fn arrive(system: &System<'_>, entries: &Entries<'_>, delta: &[f64], served: Range<usize>, r: &mut BandValues) {
    for b in served {
        let (rho, r, delta) = (system.reflectance().band(b), r.band_mut(b), delta[b]);
        entries.for_each(|t, value| r[t] += rho[t] * value * delta / system.areas()[t]);
    }
}

impl Solver for Shooting {
    fn name(&self) -> &'static str {
        if self.overshooting { "overshooting" } else { "shooting" }
    }

    fn needs(&self) -> Needs {
        let forms = &[Form::Full, Form::PatchesToElements];
        Needs { forms, direction: Direction::Shoot, symmetric: false }
    }

    fn start(&mut self, system: &System<'_>, from: Option<Bands<'_>>) -> Result<(Iterate, Cost), StoreError> {
        // Elements by source, ascending.
        let sources = system.patch_areas().len();
        let mut members = vec![Vec::new(); sources];
        for e in 0..system.elements() {
            members[system.parent().map_or(e, |parent| parent[e] as usize)].push(e as u32);
        }
        self.begins = vec![0];
        members.iter().for_each(|list| self.begins.push(self.begins[self.begins.len() - 1] + list.len()));
        self.elements = members.concat();
        (self.delta, self.expected) = (vec![0.0; system.bands()], vec![0.0; system.bands()]);
        (self.rounding, self.shots) = (0.0, 0);
        let mut residual = system.emission().to_owned();
        let mut shot = residual.clone();
        let mut cost = Cost::default();
        match from {
            None => shot.values_mut().fill(0.0),
            Some(from) => {
                shot = from.to_owned();
                cost = system.residual(Direction::Shoot, shot.view(), residual.view_mut())?;
            }
        }
        Ok((Iterate { shot, residual: Some(residual) }, cost))
    }

    fn step(&mut self, system: &System<'_>, iterate: &mut Iterate) -> Result<(Progress, Cost), StoreError> {
        let Iterate { shot, residual } = iterate;
        let r = residual.as_mut().expect("start gave one");
        let (bands, sources) = (system.bands(), system.patch_areas().len());
        if self.overshooting {
            // A debt that is larger than what is left to come promises nothing.
            self.expected = ambient::irradiance(system, r.view()).into_iter().map(|h| h.max(0.0)).collect();
        }
        let (brightest, unshot) = self.brightest(system, r.view());
        if brightest.is_empty() {
            return Ok((Progress::Residual, Cost::default()));
        }
        let mut cost = Cost::default();
        let mut bufs = std::mem::take(&mut self.bufs);
        bufs.resize_with(brightest.len().max(bufs.len()), RowBuf::default);
        if system.store().properties().per_band {
            for &s in &brightest {
                self.load(s, system, shot, r);
                for b in (0..bands).filter(|&b| self.delta[b] != 0.0) {
                    let row = system.store().row(s, b, &mut bufs[0])?;
                    cost += row.cost + Cost::applied(row.entries.stored(), 8, 1);
                    arrive(system, &row.entries, &self.delta, b..b + 1, r);
                }
            }
        } else {
            let row = |(&s, buf)| system.store().row(s, 0, buf);
            let rows: Vec<Row<'_>> = match &brightest[..] {
                // One row is left to the store's own threads.
                [s] => vec![row((s, &mut bufs[0]))?],
                all => all.par_iter().zip(&mut bufs).map(row).collect::<Result<_, _>>()?,
            };
            for (&s, row) in brightest.iter().zip(&rows) {
                self.load(s, system, shot, r);
                cost += row.cost + Cost::applied(row.entries.stored(), 8, bands);
                arrive(system, &row.entries, &self.delta, 0..bands, r);
            }
        }
        self.bufs = bufs;
        cost.flops += (4 * bands * system.elements() * brightest.len()) as u64;
        // Each r_t took a rounding of the sum and a few of what was added a shot, none larger than ε r_t.
        self.rounding += 4.0 * brightest.len() as f64 * f64::EPSILON * unshot;
        self.shots += brightest.len();
        if self.rounding > 0.01 * unshot && self.shots >= sources {
            cost += system.residual(Direction::Shoot, shot.view(), r.view_mut())?;
            (self.rounding, self.shots) = (0.0, 0);
        }
        Ok((Progress::Residual, cost))
    }

    /// What is expected later is a multiple 1/(1 − ρ̄) of what is left, and so are debts until they are paid.
    fn patience(&self) -> f64 {
        if self.overshooting { 200.0 } else { 20.0 }
    }

    fn passes_per_step(&self, system: &System<'_>) -> f64 {
        (1 + self.others) as f64 / system.patch_areas().len() as f64
    }
}
