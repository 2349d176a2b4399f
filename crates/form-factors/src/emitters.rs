//! Row-wise rows with the entries of the emitters taken from pairs.
//!
//! A small light is met by few of a row's rays or pixels, and its entry carries nearly all of the error of direct light.
//! Pairs cost little for few emitters: for an emitting surface L with targets t ∈ L,
//!
//! ```text
//! A_s F_sL exact from the pair (s, L);    A_s F_st = A_s F_sL · (estimated share of t in L, by area where none was seen)
//! ```
//!
//! and the entries of all other targets are scaled by one factor, so that the row keeps its sum. An entry that moves by Δ is off by at
//! most |Δ| more than before, one that is a whole emitter by no more than its pair: the bound of the row follows. What is *not*
//! here: the choice of what counts as an emitter, and shares within an emitter that are exact.

use radiosity_core::{Cost, StoreError};

use crate::Rows;

/// Targets that belong to one emitting surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Emitter {
    /// Its targets with their areas.
    pub targets: Vec<(u32, f64)>,
}

/// Rows of a row-wise estimator with exact totals towards emitters.
pub struct ExactEmitters<R, P> {
    rows: R,
    pairs: P,
    emitters: Vec<Emitter>,
}

impl<R: Rows, P: Rows> ExactEmitters<R, P> {
    /// `rows` with the entries of `emitters` replaced by those of `pairs`, whose targets are the emitters as a whole.
    ///
    /// # Panics
    ///
    /// If `pairs` does not run from the sources of `rows` to the emitters, or an emitter names a target beyond the rows'.
    pub fn new(rows: R, pairs: P, emitters: Vec<Emitter>) -> Self {
        assert_eq!((pairs.sources(), pairs.targets()), (rows.sources(), emitters.len()), "pairs to the emitters");
        let last = emitters.iter().flat_map(|e| &e.targets).map(|&(t, _)| t as usize).max();
        assert!(last.is_none_or(|t| t < rows.targets()), "an emitter names target {last:?} of {}", rows.targets());
        Self { rows, pairs, emitters }
    }
}

impl<R: Rows, P: Rows> Rows for ExactEmitters<R, P> {
    fn name(&self) -> &'static str {
        self.rows.name()
    }

    fn sources(&self) -> usize {
        self.rows.sources()
    }

    fn targets(&self) -> usize {
        self.rows.targets()
    }

    fn symmetric(&self) -> bool {
        false
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        let (mut cost, bound) = self.rows.row(s, values)?;
        let mut exact = vec![0.0; self.emitters.len()];
        let (spent, exact_bound) = self.pairs.row(s, &mut exact)?;
        cost += Cost { source_evaluations: 0, ..spent };
        // What the row sees in all, and what of it the emitters take.
        let total: f64 = values.iter().sum();
        let (mut seen, mut known, mut moved) = (0.0, 0.0, 0.0_f64);
        for (emitter, exact) in self.emitters.iter().zip(&exact) {
            let found: f64 = emitter.targets.iter().map(|&(t, _)| values[t as usize]).sum();
            let area: f64 = emitter.targets.iter().map(|&(_, area)| area).sum();
            for &(t, share) in &emitter.targets {
                let value = &mut values[t as usize];
                let new = if found > 0.0 { *value * (exact / found) } else { exact * share / area };
                if emitter.targets.len() > 1 {
                    moved = moved.max((new - *value).abs());
                }
                *value = new;
            }
            seen += found;
            known += exact;
        }
        // The rest of the row gives up, or takes over, the difference.
        let rest = total - seen;
        if rest > 0.0 {
            let factor = ((total - known) / rest).max(0.0);
            let mut is_emitter = vec![false; values.len()];
            self.emitters.iter().flat_map(|e| &e.targets).for_each(|&(t, _)| is_emitter[t as usize] = true);
            for (value, _) in values.iter_mut().zip(is_emitter).filter(|(_, emits)| !emits) {
                moved = moved.max(*value * (factor - 1.0).abs());
                *value *= factor;
            }
        }
        Ok((cost, (bound + moved).max(exact_bound)))
    }
}
