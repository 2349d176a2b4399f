//! Rows of exchange areas from an estimator: the seam between estimators and stores.

pub(crate) use radiosity_core::mix;
use radiosity_core::{Cost, Drawn, Draws, StoreError};
use radiosity_geometry::{Facets, Polygon};
use rayon::prelude::*;

use crate::analytic::FacetBlocks;
use crate::mirrored::Mirrors;

/// An exchange area A_i F_ij with a bound on its error.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// A_i F_ij, in units of area.
    pub value: f64,
    /// Bound of |error|, or three standard errors where visibility was sampled.
    pub bound: f64,
    /// What it cost.
    pub cost: Cost,
}

/// An estimator of single pairs; symmetric, since A_i F_ij = A_j F_ji is one number.
pub trait Pairwise: Sync {
    /// Short name for tables.
    fn name(&self) -> &'static str;

    /// A_i F_ij of two convex polygons, with an error of at most `tolerance` · min(A_i, A_j) where nothing is sampled;
    /// `seed` picks the points where something is.
    fn exchange(&self, i: &Polygon, j: &Polygon, tolerance: f64, seed: u64) -> Estimate;

    /// The targets of rows, laid out for [`Self::exchange_run`] if it takes several pairs at a time.
    fn lay_out(&self, _targets: &Facets) -> Option<FacetBlocks> {
        None
    }

    /// Exchange areas of one source with a run of targets, as many as there are `values`, with what they cost and the
    /// largest bound. A value depends on its pair alone.
    fn exchange_run(&self, run: &Run<'_>, values: &mut [f64]) -> (Cost, f64) {
        run.one_by_one(self, values)
    }
}

impl<P: Pairwise + ?Sized> Pairwise for &P {
    fn name(&self) -> &'static str {
        (**self).name()
    }

    fn exchange(&self, i: &Polygon, j: &Polygon, tolerance: f64, seed: u64) -> Estimate {
        (**self).exchange(i, j, tolerance, seed)
    }

    fn lay_out(&self, targets: &Facets) -> Option<FacetBlocks> {
        (**self).lay_out(targets)
    }

    fn exchange_run(&self, run: &Run<'_>, values: &mut [f64]) -> (Cost, f64) {
        (**self).exchange_run(run, values)
    }
}

/// A source and a run of targets, for [`Pairwise::exchange_run`].
#[derive(Clone, Copy, Debug)]
pub struct Run<'a> {
    /// Facets of the source.
    pub sources: &'a Facets,
    /// Facets of the targets; the same object as `sources` if rows are symmetric.
    pub targets: &'a Facets,
    /// What [`Pairwise::lay_out`] made of the targets.
    pub blocks: Option<&'a FacetBlocks>,
    /// The source.
    pub s: usize,
    /// The first target.
    pub from: usize,
    /// Error asked of each form factor.
    pub tolerance: f64,
    /// What seeds of pairs are mixed from.
    pub seed: u64,
    /// What the facets are called among those they were selected from, if they were.
    pub numbers: Option<&'a Numbers>,
}

/// Names of selected facets: which of all facets each of them is, so that a selection gives the entries that all of them give.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Numbers {
    /// Number of every source, ascending.
    pub sources: Vec<u32>,
    /// Number of every target, ascending.
    pub targets: Vec<u32>,
    /// Whether both are numbers in one list: then the lower one comes first in a pair.
    pub one_list: bool,
}

impl<'a> Run<'a> {
    /// Whether sources and targets are one list.
    pub fn symmetric(&self) -> bool {
        std::ptr::eq(self.sources, self.targets)
    }

    /// Targets, from the first of all, that come before the source in the order of every pair.
    pub fn swapped(&self) -> usize {
        match self.numbers {
            None if self.symmetric() => self.s,
            Some(numbers) if numbers.one_list => numbers.targets.partition_point(|t| *t < numbers.sources[self.s]),
            _ => 0,
        }
    }

    /// Every two polygons of the source and target t, with their seed. A flat facet sees nothing of itself.
    ///
    /// One order for both directions, so that a value and its samples are the same to the last bit whichever side asks.
    pub fn polygons(&self, t: usize) -> impl Iterator<Item = (&'a Polygon, &'a Polygon, u64)> + use<'a> {
        let Self { sources, targets, s, seed, numbers, .. } = *self;
        let (from, to) = numbers.map_or((s, t), |n| (n.sources[s] as usize, n.targets[t] as usize));
        let same = (self.symmetric() || numbers.is_some_and(|n| n.one_list)) && from == to;
        let (own, other) = (sources.polygons(s), targets.polygons(t));
        let (first, second, a, b) = if t < self.swapped() { (other, own, to, from) } else { (own, other, from, to) };
        let none = sources.covered(s) || targets.covered(t);
        let first = if none { &[] } else { first };
        first.iter().enumerate().flat_map(move |(k, i)| {
            let others = second.iter().enumerate().filter(move |(l, _)| !(same && k == *l));
            others
                .map(move |(l, j)| (i, j, mix(seed ^ mix((a as u64) << 32 | b as u64) ^ ((k as u64) << 32 | l as u64))))
        })
    }

    /// What [`Pairwise::exchange_run`] gives, pair after pair.
    pub fn one_by_one<P: Pairwise + ?Sized>(&self, estimator: &P, values: &mut [f64]) -> (Cost, f64) {
        let (mut cost, mut bound) = (Cost::default(), 0.0_f64);
        for (t, value) in (self.from..).zip(values) {
            let estimate = self.pair(estimator, t);
            *value = estimate.value;
            cost += estimate.cost;
            bound = bound.max(estimate.bound);
        }
        (cost, bound)
    }

    /// Exchange area of the source and target t: the sum over their polygons.
    pub fn pair<P: Pairwise + ?Sized>(&self, estimator: &P, t: usize) -> Estimate {
        let mut total = Estimate::default();
        for (i, j, seed) in self.polygons(t) {
            let estimate = estimator.exchange(i, j, self.tolerance, seed);
            total.value += estimate.value;
            total.bound += estimate.bound;
            total.cost += estimate.cost;
        }
        total
    }
}

/// A row as the list of its entries that are not zero.
#[derive(Clone, Debug, Default)]
pub struct SparseRow {
    /// Targets, ascending, with their exchange areas.
    pub entries: Vec<(u32, f64)>,
    /// Space for the row in full.
    full: Vec<f64>,
}

impl SparseRow {
    /// Lists what `fill` puts into a row of that many targets, from target `first` on.
    fn list<T>(&mut self, targets: usize, first: usize, fill: impl FnOnce(&mut [f64]) -> T) -> T {
        self.full.resize(targets, 0.0);
        let filled = fill(&mut self.full);
        let nonzero = self.full.iter().enumerate().skip(first).filter(|(_, value)| **value != 0.0);
        self.entries.clear();
        self.entries.extend(nonzero.map(|(t, &value)| (t as u32, value)));
        filled
    }

    /// Fills `values` with the row in full.
    pub fn spread(&self, values: &mut [f64]) {
        values.fill(0.0);
        self.entries.iter().for_each(|&(t, value)| values[t as usize] = value);
    }
}

/// Rows of exchange areas A_s F_st, computed when asked.
pub trait Rows: Sync {
    /// Short name of the estimator, for tables.
    fn name(&self) -> &'static str;

    /// Number of sources.
    fn sources(&self) -> usize;

    /// Number of targets.
    fn targets(&self) -> usize;

    /// Whether A_s F_st = A_t F_ts to the last bit.
    fn symmetric(&self) -> bool;

    /// Fills `values` with A_s F_st of every target; the second value bounds the error of each entry of the row
    /// (three standard errors where sampled).
    ///
    /// # Errors
    ///
    /// [`StoreError`] if an entry is no form factor.
    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError>;

    /// [`Self::row`] as a list, in place of what `row` held: for estimators that find few entries of many.
    ///
    /// # Errors
    ///
    /// As [`Self::row`].
    fn sparse_row(&self, s: usize, row: &mut SparseRow) -> Result<(Cost, f64), StoreError> {
        row.list(self.targets(), 0, |values| self.row(s, values))
    }

    /// [`Self::upper_row`] as a list of the entries t ≥ s.
    ///
    /// # Errors
    ///
    /// As [`Self::row`].
    fn sparse_upper_row(&self, s: usize, row: &mut SparseRow) -> Result<(Cost, f64), StoreError> {
        row.list(self.targets(), s, |values| self.upper_row(s, values))
    }

    /// [`Self::row`], of which only the entries t ≥ s are used: a symmetric store mirrors the rest.
    ///
    /// # Errors
    ///
    /// As [`Self::row`].
    fn upper_row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        self.row(s, values)
    }

    /// [`Self::row`] of the targets t ≥ `first` that `wanted` names, 0 elsewhere; estimators of pairs compute no others.
    ///
    /// # Errors
    ///
    /// As [`Self::row`].
    fn row_of(&self, s: usize, first: usize, wanted: &[bool], values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        let spent = self.row(s, values)?;
        let unwanted = values.iter_mut().zip(wanted).enumerate().filter(|(t, (_, wanted))| *t < first || !**wanted);
        unwanted.for_each(|(_, (value, _))| *value = 0.0);
        Ok(spent)
    }

    /// Which rows are mirror images of others, where that is known: stores may copy those.
    fn mirrors(&self) -> Option<&Mirrors> {
        None
    }

    /// How targets are drawn without a row, where the estimator can.
    fn sampler(&self) -> Option<&dyn Sampler> {
        None
    }
}

/// Targets of sources, drawn one by one in proportion to their form factors.
pub trait Sampler: Sync {
    /// Draws targets of source s, t with probability F_st; see [`radiosity_core::FormFactors::sample`].
    fn sample(&self, s: usize, draws: &mut [Draws<'_>]) -> Drawn;
}

impl<R: Rows + ?Sized> Rows for &R {
    fn name(&self) -> &'static str {
        (**self).name()
    }

    fn sources(&self) -> usize {
        (**self).sources()
    }

    fn targets(&self) -> usize {
        (**self).targets()
    }

    fn symmetric(&self) -> bool {
        (**self).symmetric()
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        (**self).row(s, values)
    }

    fn sparse_row(&self, s: usize, row: &mut SparseRow) -> Result<(Cost, f64), StoreError> {
        (**self).sparse_row(s, row)
    }

    fn sparse_upper_row(&self, s: usize, row: &mut SparseRow) -> Result<(Cost, f64), StoreError> {
        (**self).sparse_upper_row(s, row)
    }

    fn upper_row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        (**self).upper_row(s, values)
    }

    fn row_of(&self, s: usize, first: usize, wanted: &[bool], values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        (**self).row_of(s, first, wanted, values)
    }

    fn mirrors(&self) -> Option<&Mirrors> {
        (**self).mirrors()
    }

    fn sampler(&self) -> Option<&dyn Sampler> {
        (**self).sampler()
    }
}

/// The rows that a pairwise estimator gives between two lists of facets.
#[derive(Clone, Debug)]
pub struct PairwiseRows<'a, P> {
    estimator: P,
    sources: &'a Facets,
    targets: &'a Facets,
    blocks: Option<FacetBlocks>,
    tolerance: f64,
    seed: u64,
    numbers: Option<Numbers>,
}

/// Targets that one task computes: work for longer than it takes to hand it over.
const PIECE: usize = 256;

impl<'a, P: Pairwise> PairwiseRows<'a, P> {
    /// Rows from `sources` to `targets` with an error of each F of at most `tolerance` where nothing is sampled.
    pub fn new(estimator: P, sources: &'a Facets, targets: &'a Facets, tolerance: f64, seed: u64) -> Self {
        let blocks = estimator.lay_out(targets);
        Self { estimator, sources, targets, blocks, tolerance, seed, numbers: None }
    }

    /// The same rows of facets that were selected from more: entries and their samples are those among all.
    ///
    /// # Panics
    ///
    /// If there is not a number for every facet.
    #[must_use]
    pub fn numbered(self, numbers: Numbers) -> Self {
        let counts = (numbers.sources.len(), numbers.targets.len());
        assert_eq!(counts, (self.sources.len(), self.targets.len()), "a number for every facet");
        Self { numbers: Some(numbers), ..self }
    }

    /// The estimator.
    pub fn estimator(&self) -> &P {
        &self.estimator
    }

    /// Facets of the sources.
    pub fn source_facets(&self) -> &'a Facets {
        self.sources
    }

    /// Facets of the targets.
    pub fn target_facets(&self) -> &'a Facets {
        self.targets
    }

    /// Source s and the targets from `from` on.
    pub(crate) fn run(&self, s: usize, from: usize) -> Run<'_> {
        let &Self { sources, targets, tolerance, seed, .. } = self;
        Run { sources, targets, blocks: self.blocks.as_ref(), s, from, tolerance, seed, numbers: self.numbers.as_ref() }
    }

    /// Exchange areas of source s with the targets from `from` on, as many as there are `values`.
    pub(crate) fn part(&self, s: usize, from: usize, values: &mut [f64]) -> (Cost, f64) {
        self.estimator.exchange_run(&self.run(s, from), values)
    }

    /// [`Self::part`] of what is wanted, runs of neighbours at a time, 0 elsewhere.
    fn wanted_part(&self, s: usize, from: usize, wanted: &[bool], values: &mut [f64]) -> (Cost, f64) {
        let wanted = &wanted[from..from + values.len()];
        let (mut begin, mut total) = (0, (Cost::default(), 0.0_f64));
        while begin < wanted.len() {
            let length = wanted[begin..].iter().take_while(|is| **is == wanted[begin]).count();
            let run = &mut values[begin..begin + length];
            if wanted[begin] {
                let (cost, bound) = self.part(s, from + begin, run);
                total = (total.0 + cost, total.1.max(bound));
            } else {
                run.fill(0.0);
            }
            begin += length;
        }
        total
    }

    fn fill(
        &self,
        s: usize,
        from: usize,
        wanted: Option<&[bool]>,
        values: &mut [f64],
    ) -> Result<(Cost, f64), StoreError> {
        assert_eq!(values.len(), self.targets(), "row: length");
        let targets = self.targets;
        // Pieces begin at multiples of their length, so that blocks of targets are not cut.
        let (head, tail) = values[from..].split_at_mut((from.next_multiple_of(PIECE) - from).min(targets.len() - from));
        let run = |from: usize, values: &mut [f64]| {
            let spent = match wanted {
                Some(wanted) => self.wanted_part(s, from, wanted, values),
                None => self.part(s, from, values),
            };
            let all = values.iter().fold(true, |all, value| all & (*value >= 0.0) & (*value < f64::INFINITY));
            if !all && let Some(k) = values.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
                return Err(StoreError::Value { source_index: s, target_index: from + k, value: values[k] });
            }
            Ok(spent)
        };
        let next = from + head.len();
        let first = run(from, head);
        let parts: Vec<_> =
            tail.par_chunks_mut(PIECE).enumerate().map(|(k, values)| run(next + k * PIECE, values)).collect();
        let mut total = (Cost { source_evaluations: 1, ..Cost::default() }, 0.0_f64);
        for spent in std::iter::once(first).chain(parts) {
            let (cost, bound) = spent?;
            total.0 += cost;
            total.1 = total.1.max(bound);
        }
        Ok(total)
    }
}

impl<P: Pairwise> Rows for PairwiseRows<'_, P> {
    fn name(&self) -> &'static str {
        self.estimator.name()
    }

    fn sources(&self) -> usize {
        self.sources.len()
    }

    fn targets(&self) -> usize {
        self.targets.len()
    }

    fn symmetric(&self) -> bool {
        std::ptr::eq(self.sources, self.targets)
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        self.fill(s, 0, None, values)
    }

    fn row_of(&self, s: usize, first: usize, wanted: &[bool], values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        values[..first].fill(0.0);
        self.fill(s, first, Some(wanted), values)
    }

    fn upper_row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        self.fill(s, if self.symmetric() { s } else { 0 }, None, values)
    }
}
