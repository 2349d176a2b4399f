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
//! most |Δ| more than before, one that is a whole emitter by no more than its pair: the bound of the row follows. Surfaces that are bright by
//! reflection may be named as well; nothing here asks where their light comes from. What is *not*
//! here: the choice of what counts as an emitter, and shares within an emitter that are exact.

use radiosity_core::{Cost, StoreError};

use crate::rows::{Rows, SparseRow};

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
    /// The emitter that each target belongs to, or [`NONE`].
    emitter_of: Vec<u32>,
}

/// Of no emitter.
const NONE: u32 = u32::MAX;

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
        let mut emitter_of = vec![NONE; rows.targets()];
        for (k, emitter) in (0..).zip(&emitters) {
            emitter.targets.iter().for_each(|&(t, _)| emitter_of[t as usize] = k);
        }
        Self { rows, pairs, emitters, emitter_of }
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
        let mut row = SparseRow::default();
        let spent = self.sparse_row(s, &mut row)?;
        row.spread(values);
        Ok(spent)
    }

    fn sparse_row(&self, s: usize, row: &mut SparseRow) -> Result<(Cost, f64), StoreError> {
        let (mut cost, bound) = self.rows.sparse_row(s, row)?;
        let mut exact = vec![0.0; self.emitters.len()];
        let (spent, exact_bound) = self.pairs.row(s, &mut exact)?;
        cost += Cost { source_evaluations: 0, ..spent };
        // What the row sees in all, and what of it the emitters take.
        let mut found = vec![0.0; self.emitters.len()];
        let (mut total, mut seen) = (0.0, 0.0);
        for &(t, value) in &row.entries {
            total += value;
            if let Some(found) = found.get_mut(self.emitter_of[t as usize] as usize) {
                *found += value;
                seen += value;
            }
        }
        let known: f64 = exact.iter().sum();
        // The rest of the row gives up, or takes over, the difference.
        let rest = total - seen;
        let others = if rest > 0.0 { ((total - known) / rest).max(0.0) } else { 1.0 };
        let mut moved = 0.0_f64;
        for (t, value) in &mut row.entries {
            let emitter = self.emitter_of[*t as usize] as usize;
            let factor = found.get(emitter).map_or(others, |found| exact[emitter] / found);
            if emitter == NONE as usize || self.emitters[emitter].targets.len() > 1 {
                moved = moved.max(*value * (factor - 1.0).abs());
            }
            *value *= factor;
        }
        // Emitters that the row has missed.
        let before = row.entries.len();
        for ((emitter, &exact), _) in self.emitters.iter().zip(&exact).zip(&found).filter(|(_, found)| **found == 0.0) {
            let area: f64 = emitter.targets.iter().map(|&(_, area)| area).sum();
            for &(t, share) in emitter.targets.iter().filter(|_| exact > 0.0) {
                let value = exact * share / area;
                if emitter.targets.len() > 1 {
                    moved = moved.max(value);
                }
                row.entries.push((t, value));
            }
        }
        if row.entries.len() > before {
            // A stable sort merges what is in order already.
            row.entries.sort_by_key(|&(t, _)| t);
        }
        if others == 0.0 || exact.contains(&0.0) {
            row.entries.retain(|&(_, value)| value != 0.0);
        }
        Ok((cost, (bound + moved).max(exact_bound)))
    }
}
