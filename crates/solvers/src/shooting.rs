//! Progressive refinement: the brightest unshot power is shot first.

use radiosity_core::{Bands, Cost, Direction, Form, Iterate, Needs, Progress, RowBuf, Solver, StoreError, System};

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
/// - *Reads*: one row a step; the full form in the shooting direction and patches → elements. Sources that never
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
    buf: RowBuf,
}

impl Shooting {
    /// Unshot power Σ A|r| of the elements of source s in all bands.
    fn power(&self, s: usize, areas: &[f64], r: Bands<'_>) -> f64 {
        let elements = &self.elements[self.begins[s]..self.begins[s + 1]];
        (0..r.count())
            .map(|b| {
                let r = r.band(b);
                elements.iter().map(|&e| areas[e as usize] * r[e as usize].abs()).sum::<f64>()
            })
            .sum()
    }
}

impl Solver for Shooting {
    fn name(&self) -> &'static str {
        "shooting"
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
        self.delta = vec![0.0; system.bands()];
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
        let (areas, bands, sources) = (system.areas(), system.bands(), system.patch_areas().len());
        // The brightest source.
        let (mut brightest, mut largest, mut unshot) = (0, 0.0, 0.0);
        for s in 0..sources {
            let power = self.power(s, areas, r.view());
            unshot += power;
            if power > largest {
                (brightest, largest) = (s, power);
            }
        }
        if largest == 0.0 {
            return Ok((Progress::Residual, Cost::default()));
        }
        // Its elements hand over what they have.
        let elements = &self.elements[self.begins[brightest]..self.begins[brightest + 1]];
        for (b, delta) in self.delta.iter_mut().enumerate() {
            let (x, r) = (shot.band_mut(b), r.band_mut(b));
            let mut power = 0.0;
            for e in elements.iter().map(|&e| e as usize) {
                power += areas[e] * r[e];
                x[e] += r[e];
                r[e] = 0.0;
            }
            *delta = power / system.patch_areas()[brightest];
        }
        // What arrives is reflected: unshot radiosity of every element that sees the source.
        let mut cost = Cost::default();
        let per_band = system.store().properties().per_band;
        for table in 0..if per_band { bands } else { 1 } {
            let served = if per_band { table..table + 1 } else { 0..bands };
            if self.delta[served.clone()].iter().all(|&delta| delta == 0.0) {
                continue;
            }
            let row = system.store().row(brightest, table, &mut self.buf)?;
            cost += row.cost + Cost::applied(row.entries.stored(), 8, served.len());
            for b in served {
                let (rho, r, delta) = (system.reflectance().band(b), r.band_mut(b), self.delta[b]);
                row.entries.for_each(|t, value| r[t] += rho[t] * value * delta / areas[t]);
            }
        }
        cost.flops += (4 * bands * areas.len()) as u64;
        // Each r_t took one rounding of the sum and a few of what was added, none larger than ε r_t.
        self.rounding += 4.0 * f64::EPSILON * unshot;
        self.shots += 1;
        if self.rounding > 0.01 * unshot && self.shots >= sources {
            cost += system.residual(Direction::Shoot, shot.view(), r.view_mut())?;
            (self.rounding, self.shots) = (0.0, 0);
        }
        Ok((Progress::Residual, cost))
    }

    fn passes_per_step(&self, system: &System<'_>) -> f64 {
        1.0 / system.patch_areas().len() as f64
    }
}
