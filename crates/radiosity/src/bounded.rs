//! Omissions that change the answer by a bounded amount: what they save, and the bound.
//!
//! Exact omissions are those of [`crate::plan`]. These take a part of the error that is asked for:
//!
//! | left out | setting | file |
//! |---|---|---|
//! | pairs too small to matter | [`Strategy::thin`] | `thin.rs` |
//! | bounces of light too weak to matter | [`Strategy::bounces`] | `bounces.rs` |
//! | refinement that what is asked for does not see | [`Strategy::asked`] | `importance.rs` |
//!
//! Of the first two the bound is known before (`prior`, from reflectances alone) and sharper afterwards (`bound`, from the answer). Bounds of
//! several add. The third is part of
//! the estimate that refinement stops by, and has none of its own. Norms are area-weighted root mean squares,
//!
//! ```text
//! ‖h‖² = Σ_e A_e h_e²,      prior ≥ ‖H − H*‖ / ‖H‖,      bound ≥ ‖H − H*‖ √(Σ A) / Σ A H
//! ```
//!
//! in all bands together; the second is the measure of a report, whose means over cells make it no larger.

use radiosity_core::{BandValues, Cost, System};

use crate::{Geometry, Plan, RunError, Strategy, bounces, thin};

/// A bounded omission.
#[derive(Clone, Debug, PartialEq)]
pub struct Bounded {
    /// Why it changes little.
    pub reason: &'static str,
    /// What is left out.
    pub what: String,
    /// What is counted.
    pub counted: &'static str,
    /// How many of them are not computed, as said before.
    pub predicted: u64,
    /// How many were not; `None` where that cannot be told.
    pub measured: Option<u64>,
    /// Bound of the rms change of irradiance relative to its rms level, before anything is computed.
    pub prior: f64,
    /// Bound of the rms change of irradiance relative to its mean level, after the solution; `None` if there is none.
    pub bound: Option<f64>,
}

/// What a run of `strategy` by `plan` on the mesh that it made will leave out within the errors allowed, before anything is computed.
pub fn foreseen(plan: &Plan, geometry: &Geometry<'_>, strategy: &Strategy) -> Vec<Bounded> {
    thin::foreseen(plan, geometry, strategy).into_iter().chain(bounces::foreseen(geometry, strategy)).collect()
}

/// A bounded omission and a vector that bounds |H − H*|, or has the norm of such a vector.
pub(crate) struct Missed {
    pub(crate) omission: Bounded,
    pub(crate) by: Option<BandValues>,
}

/// What [`Bounded::counted`] says of form factors.
pub(crate) const FORM_FACTORS: &str = "form factors";

impl Missed {
    /// Form factors that were not computed.
    pub(crate) fn dropped_pairs(&self) -> Option<u64> {
        self.omission.measured.filter(|_| self.omission.counted == FORM_FACTORS)
    }

    /// With the bound relative to irradiance `h` on the exposed elements; what is not a number there was not asked for.
    pub(crate) fn relative_to(self, geometry: &Geometry<'_>, h: &BandValues) -> Bounded {
        let areas = geometry.elements().areas();
        let total: f64 = geometry.mesh().areas().iter().sum();
        Bounded { bound: self.by.as_ref().map(|by| relative(by, h, &areas, total)), ..self.omission }
    }
}

/// ‖by‖ √(Σ A) / Σ A H over all bands.
pub(crate) fn relative(by: &BandValues, h: &BandValues, areas: &[f64], total: f64) -> f64 {
    let bands = h.count() as f64;
    let sum = |values: &BandValues, of: &dyn Fn(f64) -> f64| -> f64 {
        let weighted = |b: usize| areas.iter().zip(values.band(b)).map(|(a, value)| a * of(*value)).sum::<f64>();
        (0..values.count()).map(weighted).sum()
    };
    let square = sum(by, &|by| by * by);
    let level = sum(h, &|h| if h.is_nan() { 0.0 } else { h }) / (bands * total);
    if square == 0.0 { 0.0 } else { (square / (bands * total)).sqrt() / level }
}

/// Largest reflectance of every band.
pub(crate) fn largest(reflectance: &BandValues) -> Vec<f64> {
    (0..reflectance.count()).map(|b| reflectance.band(b).iter().copied().fold(0.0, f64::max)).collect()
}

/// σ ≥ ‖F‖: the root of the largest row sum times the largest column sum of a system's form factors (I. Schur 1911), and what the products took, one where they are
/// the same. It is
/// 1 but for errors of the form factors.
pub(crate) fn norm(system: &System<'_>) -> Result<(f64, Cost), RunError> {
    let store = system.store();
    let (own, patches) = (system.areas(), system.patch_areas());
    let (sources, targets) = match system.form() {
        radiosity_core::Form::PatchesToElements => (patches, own),
        _ => (own, patches),
    };
    let mut largest = [0.0_f64; 2];
    let mut cost = Cost::default();
    let ones = |count: usize| BandValues::single(vec![1.0; count]);
    let mut sums = BandValues::zeros(1, sources.len());
    cost += store.gather(ones(targets.len()).view(), sums.view_mut())?;
    largest[0] = sums.values().iter().zip(sources).map(|(sum, area)| sum / area).fold(0.0, f64::max);
    if store.properties().symmetric {
        return Ok((largest[0], cost));
    }
    let mut sums = BandValues::zeros(1, targets.len());
    cost += store.scatter(ones(sources.len()).view(), sums.view_mut())?;
    largest[1] = sums.values().iter().zip(targets).map(|(sum, area)| sum / area).fold(0.0, f64::max);
    Ok(((largest[0] * largest[1]).sqrt(), cost))
}
