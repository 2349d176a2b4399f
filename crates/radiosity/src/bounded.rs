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
//! The first two are held to what they may change and have a bound of what they did (`bound`, from the answer). Bounds of several add. The third is part of
//! the estimate that refinement stops by, and has none of its own. Norms are area-weighted root mean squares over what is asked for: all surfaces, some
//! ([`Strategy::asked`]), or the pixels of a view ([`Strategy::view`]), with the weights a and s that `asked.rs` says,
//!
//! ```text
//! bound ≥ √( Σ_e a_e ⟨s_e² (H − H*)_e²⟩ / Σ a ) / ( Σ_e a_e ⟨s_e H_e⟩ / Σ a ),      ⟨·⟩ the mean over the bands
//! ```
//!
//! which over surfaces is the measure of a report, whose means over cells make it no larger. Omissions bound the change in every element; where one bounds the
//! mean square over all surfaces more sharply, what is asked for has at most the largest a s²/A of that. Where nothing that is asked for has an exposed area nothing
//! is relative to it, and all surfaces count. What no light reaches is 0 exactly: its bound is 0.

use radiosity_core::{BandValues, Cost, System};

use crate::asked::{Asked, Named};
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
    /// The rms change of irradiance, relative to its mean level over what is asked for, that it is held to.
    pub prior: f64,
    /// Bound of that change, after the solution; `None` if there is none.
    pub bound: Option<f64>,
}

/// What a run of `strategy` by `plan` on the mesh that it made will leave out within the errors allowed, before anything is computed.
pub fn foreseen(plan: &Plan, geometry: &Geometry<'_>, strategy: &Strategy) -> Vec<Bounded> {
    thin::foreseen(plan, geometry, strategy).into_iter().chain(bounces::foreseen(geometry, strategy)).collect()
}

/// What bounds H − H*.
pub(crate) struct By {
    /// No less than |H − H*| in any element.
    pub(crate) values: BandValues,
    /// No less than Σ A (H − H*)² over all elements of each band; infinite where the values say all that is known.
    pub(crate) squares: Vec<f64>,
}

impl By {
    /// What bounds it in every element, and nothing else.
    pub(crate) fn pointwise(values: BandValues) -> Self {
        Self { squares: vec![f64::INFINITY; values.count()], values }
    }
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

    /// With the bound relative to irradiance `h`, on the exposed elements, of what is `named`; what is not a number there was not asked for.
    pub(crate) fn relative_to(self, geometry: &Geometry<'_>, named: Named<'_>, h: &BandValues) -> Bounded {
        let areas = geometry.elements().areas();
        let bound = self.by.as_ref().map(|by| relative(by, h, &areas, &Asked::new(geometry, named)));
        Bounded { bound, ..self.omission }
    }
}

/// The bound of a change of `h` relative to what is asked for of it; infinite where no light arrives there and some might.
pub(crate) fn relative(by: &By, h: &BandValues, areas: &[f64], asked: &Asked) -> f64 {
    let bands = h.count();
    let square = |b: usize| asked.square(&by.values, b).min(asked.densest(areas, b) * by.squares[b]);
    let square: f64 = (0..bands).map(square).sum();
    let level = asked.level(h);
    if square == 0.0 { 0.0 } else { (square / (bands as f64 * asked.total)).sqrt() / level }
}

/// Largest reflectance of every band.
pub(crate) fn largest(reflectance: &BandValues) -> Vec<f64> {
    (0..reflectance.count()).map(|b| reflectance.band(b).iter().copied().fold(0.0, f64::max)).collect()
}

/// What is known of the form factors of a system by their sums.
pub(crate) struct Norms {
    /// Σ_t F_et of every element: what it gathers of light that is 1 everywhere.
    pub(crate) sums: Vec<f64>,
    /// σ ≥ ‖F‖: the root of the largest of those times the largest sum of a target (I. Schur 1911), 1 but for errors of the form factors.
    pub(crate) sigma: f64,
    /// What the products took, one where both sums are the same.
    pub(crate) cost: Cost,
}

impl Norms {
    pub(crate) fn new(system: &System<'_>) -> Result<Self, RunError> {
        let store = system.store();
        let (own, patches) = (system.areas(), system.patch_areas());
        let shoots = system.form() == radiosity_core::Form::PatchesToElements;
        let (sources, targets) = if shoots { (patches, own) } else { (own, patches) };
        let ones = |count: usize| BandValues::single(vec![1.0; count]);
        let over = |sums: &BandValues, areas: &[f64]| -> Vec<f64> {
            sums.values().iter().zip(areas).map(|(sum, area)| if *area > 0.0 { sum / area } else { 0.0 }).collect()
        };
        let largest = |sums: &[f64]| sums.iter().copied().fold(0.0, f64::max);
        let mut sums = BandValues::zeros(1, sources.len());
        let mut cost = store.gather(ones(targets.len()).view(), sums.view_mut())?;
        let rows = over(&sums, sources);
        if store.properties().symmetric {
            return Ok(Self { sigma: largest(&rows), sums: rows, cost });
        }
        let mut sums = BandValues::zeros(1, targets.len());
        cost += store.scatter(ones(sources.len()).view(), sums.view_mut())?;
        let columns = over(&sums, targets);
        let sigma = (largest(&rows) * largest(&columns)).sqrt();
        Ok(Self { sums: if shoots { columns } else { rows }, sigma, cost })
    }

    /// Largest sum of an element: the norm of F in the largest value.
    pub(crate) fn largest(&self) -> f64 {
        self.sums.iter().copied().fold(0.0, f64::max)
    }
}
