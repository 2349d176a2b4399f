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
//! in all bands together; the second is the measure of a report, whose means over cells make it no larger. Where only some surfaces W are asked for
//! ([`Strategy::asked`]), it is a bound of their error relative to their own mean,
//!
//! ```text
//! bound ≥ ‖H − H*‖_W √(Σ_W A) / Σ_W A H,      ‖H − H*‖_W ≤ ‖by‖_W if |H − H*| ≤ by in every element, else ≤ ‖H − H*‖ ≤ ‖by‖
//! ```
//!
//! with sums over W alone; the prior stays one of all surfaces. Where W has no exposed area nothing is relative to it, and all surfaces count.

use radiosity_core::{BandValues, Cost, System};

use crate::importance::{exposed, is_asked};
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
    /// Bound of the rms change of irradiance relative to its rms level, over all surfaces, before anything is computed.
    pub prior: f64,
    /// Bound of the rms change of irradiance relative to its mean level, over the surfaces asked for, after the solution; `None` if there is none.
    pub bound: Option<f64>,
}

/// What a run of `strategy` by `plan` on the mesh that it made will leave out within the errors allowed, before anything is computed.
pub fn foreseen(plan: &Plan, geometry: &Geometry<'_>, strategy: &Strategy) -> Vec<Bounded> {
    thin::foreseen(plan, geometry, strategy).into_iter().chain(bounces::foreseen(geometry, strategy)).collect()
}

/// A vector that bounds |H − H*|.
pub(crate) struct By {
    pub(crate) values: BandValues,
    /// Whether it does in every element, or has only the norm of such a vector.
    pub(crate) pointwise: bool,
}

/// A bounded omission and what bounds its effect, if anything does.
pub(crate) struct Missed {
    pub(crate) omission: Bounded,
    pub(crate) by: Option<By>,
}

/// What [`Bounded::counted`] says of form factors.
pub(crate) const FORM_FACTORS: &str = "form factors";

impl Missed {
    /// Form factors that were not computed.
    pub(crate) fn dropped_pairs(&self) -> Option<u64> {
        self.omission.measured.filter(|_| self.omission.counted == FORM_FACTORS)
    }

    /// With the bound relative to irradiance `h` of the surfaces `asked` for, on the exposed elements; what is not a number there was not asked for.
    pub(crate) fn relative_to(self, geometry: &Geometry<'_>, asked: Option<&[u32]>, h: &BandValues) -> Bounded {
        let (areas, surfaces) = (geometry.elements().areas(), geometry.surfaces());
        let asked = exposed(asked, &surfaces);
        // Covered parts are part of a report.
        let all: Vec<u32> = geometry.mesh().elements.iter().map(|element| element.surface).collect();
        let total = area_of(&geometry.mesh().areas(), &is_asked(asked, &all));
        let asked = is_asked(asked, &surfaces);
        Bounded { bound: self.by.as_ref().map(|by| relative(by, h, &areas, (&asked, total))), ..self.omission }
    }
}

/// Σ_W A.
pub(crate) fn area_of(areas: &[f64], asked: &[bool]) -> f64 {
    areas.iter().zip(asked).filter(|(_, asked)| **asked).map(|(area, _)| area).sum()
}

/// ‖by‖_W √A_W / Σ_W A H over all bands, W being what is asked for and A_W its area; infinite where no light arrives there.
pub(crate) fn relative(by: &By, h: &BandValues, areas: &[f64], (asked, total): (&[bool], f64)) -> f64 {
    let bands = h.count() as f64;
    let sum = |values: &BandValues, all: bool, of: &dyn Fn(f64) -> f64| -> f64 {
        let weighted = |b: usize| -> f64 {
            let of_band = areas.iter().zip(values.band(b)).zip(asked);
            of_band.filter(|(_, asked)| all || **asked).map(|((a, value), _)| a * of(*value)).sum()
        };
        (0..values.count()).map(weighted).sum()
    };
    let square = sum(&by.values, !by.pointwise, &|by| by * by);
    let light = sum(h, false, &|h| if h.is_nan() { 0.0 } else { h });
    match (square == 0.0, light == 0.0) {
        (true, _) => 0.0,
        (_, true) => f64::INFINITY,
        _ => (square / (bands * total)).sqrt() / (light / (bands * total)),
    }
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
