//! What geometry and estimators leave out of every run, planned or not, in counts: nobody has to ask for it, and nothing keeps it.
//!
//! | left out | because | found in |
//! |---|---|---|
//! | polygons in visibility tests | the whole scene lies on one side of them | [`Occluders::blocking`] |
//! | elements as unknowns | they lie inside solids | [`Geometry::new`] |
//! | pairs | they face away from each other, or lie in one plane | the analytic estimator |
//! | visibility tests of pairs | nothing is between them | the analytic estimator |
//!
//! Pairs that face away are predicted by faces, like those of a plan, and measured as what is left of all pairs less what was computed and what
//! the plan and a threshold left out; so a wrong prediction of either shows. Of m elements there are m(m − 1)/2 pairs. That nothing is between a pair is known
//! beforehand where nothing can block at all.

use std::fmt;

use radiosity_geometry::Occluders;

use super::Plan;
use super::counts::Tally;
use crate::bounded::FORM_FACTORS;
use crate::{Geometry, Method, Run, Shape, Store, Strategy};

/// Something that no run of a scene computes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Anyway {
    /// What is left out.
    pub what: String,
    /// Why it changes nothing.
    pub reason: &'static str,
    /// What is counted.
    pub counted: &'static str,
    /// How many are not computed, as said before; `None` where that is not known before.
    pub predicted: Option<u64>,
    /// How many were not; `None` before a run and where that cannot be told.
    pub measured: Option<u64>,
}

impl Anyway {
    fn new(what: impl Into<String>, reason: &'static str, counted: &'static str) -> Self {
        Self { what: what.into(), reason, counted, predicted: None, measured: None }
    }

    fn counts(self, predicted: Option<u64>, measured: Option<u64>) -> Self {
        Self { predicted, measured, ..self }
    }

    /// What light by way of specular surfaces would take where nothing is specular: extended form factors, directions of light on surfaces, and a second pass along
    /// mirrors. Of the rays that would be `needed`, so many were `cast`.
    pub(crate) fn specular(needed: Option<u64>, cast: Option<u64>) -> Self {
        let what = "form factors by way of specular surfaces, directional storage, a second pass along mirrors";
        let measured = needed.zip(cast).map(|(needed, cast)| needed.saturating_sub(cast));
        Self::new(what, "nothing in the scene is specular", "rays").counts(needed, measured)
    }

    /// The ambient term of solutions that are shown before they are done, after so many steps.
    pub fn ambient(steps: Option<u64>) -> Self {
        let what = "ambient term of the light that is still unshot";
        Self::new(what, "nothing is displayed before the solution is done", "terms").counts(None, steps)
    }

    /// How many, as measured if that is known and else as predicted.
    pub fn count(&self) -> Option<u64> {
        self.measured.or(self.predicted)
    }
}

impl fmt::Display for Anyway {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { what, reason, counted, .. } = self;
        match self.count() {
            Some(count) => write!(f, "{what}: {reason} ({count} {counted})"),
            None => write!(f, "{what}: {reason}"),
        }
    }
}

impl Plan {
    /// What is left out of a run of `strategy` on `geometry`, which [`Plan::mesh`] made, whatever the plan: before it, or as `run` counted it.
    pub fn anyway(&self, geometry: &Geometry<'_>, strategy: &Strategy, run: Option<&Run<'_>>) -> Vec<Anyway> {
        let mut left = Vec::new();
        let scene = geometry.scene();
        let (pieces, blocking) = (scene.pieces().count() as u64, geometry.blockers().len() as u64);
        if blocking < pieces {
            let predicted = pieces - Occluders::blocking(scene).len() as u64;
            let reason = match blocking {
                0 => "nothing in the scene can block",
                _ => "the whole scene lies on one side of them",
            };
            let line = Anyway::new("polygons in visibility tests", reason, "polygons");
            left.push(line.counts(Some(predicted), Some(pieces - blocking)));
        }
        let covered = (geometry.mesh().elements.len() - geometry.elements().len()) as u64;
        if covered > 0 {
            let line = Anyway::new("elements as unknowns", "they lie inside solids", "covered elements");
            left.push(line.counts(None, Some(covered)));
        }
        left.extend(self.pairs(geometry, strategy, run).into_iter().flatten());
        if run.is_some_and(|_| matches!(strategy.solver.as_str(), "shooting" | "overshooting")) {
            left.push(Anyway::ambient(run.map(|run| run.solution.steps)));
        }
        left
    }

    /// Pairs that face away, and those that nothing is between; `None` of methods that know no pairs.
    fn pairs(&self, geometry: &Geometry<'_>, strategy: &Strategy, run: Option<&Run<'_>>) -> Option<[Anyway; 2]> {
        let held = !matches!(strategy.store, Store::KeepAll | Store::KeepNone | Store::Hierarchical { .. });
        if !matches!(strategy.method, Method::Analytic { .. }) || strategy.shape != Shape::Full || !held {
            return None;
        }
        let plans = [Self::everything(geometry.scene()), self.clone()];
        let [all, kept] = Tally::new(geometry, strategy, self).counts(&plans)[..] else { return None };
        let pairs = all.unknowns * all.unknowns.saturating_sub(1) / 2;
        let predicted = all.form_factors.map(|facing| pairs.saturating_sub(facing));
        let computed = run.and_then(|run| {
            let planned = if run.left_out.list.is_empty() { 0 } else { run.left_out.predicted.form_factors? };
            // What is dropped within an error would have been computed.
            let thinned = run.bounded.iter().filter(|bounded| bounded.counted == FORM_FACTORS);
            Some(run.cost().form_factors + planned + thinned.filter_map(|bounded| bounded.measured).sum::<u64>())
        });
        let measured = computed.and_then(|computed| pairs.checked_sub(computed));
        let away = Anyway::new("pairs", "they face away from each other, or lie in one plane", "pairs");
        let clear = Anyway::new("visibility tests of pairs", "nothing is between them", "tests");
        // Beforehand that is known of all pairs or of none.
        let untested = kept.form_factors.filter(|_| geometry.blockers().is_empty());
        let found = run.map(|run| run.cost().clear_pairs);
        Some([away.counts(predicted, measured), clear.counts(untested, found)])
    }
}
