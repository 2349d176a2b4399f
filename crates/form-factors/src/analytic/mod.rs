//! The analytic estimator: exchange areas of pairs of convex polygons, exact but for visibility.
//!
//! | pair | rule | range | order | error bound |
//! |---|---|---|---|---|
//! | separated | 4-D Gauss product rule | every σ = h/D ≤ 0.4 and at most 2,500 points | 1 to 8 a direction, from the bound | proven (Gegenbauer series) and rounding |
//! | near, touching, tiny gap | contour integral, inner edge and corner logarithms closed, Gauss–Kronrod outside | all others | 7/15, panels bisected | difference of the two rules, singularities left alone, rounding |
//! | crossing a plane | clipped at the horizon, then as above | | | as above |
//! | partly blocked | exact hidden part of every point, product rules between visibility events (`partial`) | where the classification says so | 1, 2, 3, 5, 8 a direction, then cells halved | estimate: last difference of orders, and the above |
//! | the same, [`PartialVisibility::Rays`] | unoccluded value × Σ kV/Σ k (`sampling`) | likewise | segments doubled to a standard error | three standard errors and the above |
//!
//! h is half the length of a patch along one direction and D its distance from the partner (see `area_quadrature`). Both
//! rules aim at max(tolerance · min(A_i, A_j), rounding) and 1000 · tolerance relative. Nothing is clipped, split or compared at
//! an absolute length; coordinates are taken relative to the pair.
//!
//! What is *not* here: patches that are not flat, surfaces other than polygons, and a proven
//! bound for partly blocked pairs.

mod area_quadrature;
mod closed_forms;
mod contour;
mod differential;
mod gauss;
mod pair;
mod partial;
mod sampling;
mod unoccluded;
mod visibility;

use std::sync::Arc;

use radiosity_core::Cost;
use radiosity_geometry::{Occluders, Polygon};

pub use closed_forms::{opposed_rectangles, perpendicular_rectangles};
pub use differential::differential;
pub use unoccluded::unoccluded;

use crate::{Estimate, Pairwise};
use area_quadrature::Bounded;
use pair::FacingPair;
use partial::{Blocked, Bodies, Visible};
use sampling::visible_share;
use visibility::{Blocking, Screens, Visibility};

/// Error of the form factors of partial pairs, unless set otherwise.
const TOLERANCE: f64 = 1e-6;
/// Form factor (the larger of F_ij and F_ji) from which on a pair gets more segments, in proportion: the sum of variances
/// Σ F²/N at a given sum of N is least for N ∝ F, and the segments of a row stay below samples · (pairs + 300).
const LARGE: f64 = 1.0 / 300.0;

/// Exchange areas of pairs of convex polygons: unoccluded values to a tolerance, and the visible part where something may lie
/// between, by one of the rules of [`PartialVisibility`].
///
/// ```text
/// A_i F_ij = ∫_i ∫_j cos θ_i cos θ_j V / (π r²) dA_j dA_i
/// ```
///
/// [`Cost::form_factors`] counts pairs that face each other; each of them is also counted as clear, hidden or partial.
///
/// # Examples
///
/// Two opposite faces of the unit cube:
///
/// ```
/// # use radiosity_form_factors::{Pairwise, analytic::Analytic};
/// # use radiosity_geometry::Polygon;
/// # use glam::DVec3;
/// let floor = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 0.0));
/// let mut ceiling = floor.map(|v| v + DVec3::Z);
/// ceiling.reverse();
/// let (floor, ceiling) = (Polygon::new(&floor)?, Polygon::new(&ceiling)?);
/// let estimate = Analytic::new(None).exchange(&floor, &ceiling, 1e-10, 0);
/// assert!((estimate.value - 0.199_824_895_698_387_4).abs() < 1e-10);
/// # Ok::<(), radiosity_geometry::PolygonError>(())
/// ```
#[derive(Clone)]
pub struct Analytic<'a> {
    scene: Option<Blockers<'a>>,
    visibility: PartialVisibility,
}

/// Polygons that block, what sorting pairs needs of them, and the bodies among them.
#[derive(Clone)]
struct Blockers<'a> {
    occluders: &'a Occluders,
    screens: Arc<Screens>,
    bodies: Arc<Bodies>,
}

/// How pairs are computed between which something may lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PartialVisibility {
    /// The hidden part is exact from every point, and integrated adaptively; [`Estimate::bound`] holds an estimate of the error.
    Exact {
        /// Error of F_ij and F_ji to aim at. A pair among very many blockers may stop short of it after some 10⁵ points: its bound says
        /// what is open.
        tolerance: f64,
    },
    /// The unoccluded value times the visible share of segments; [`Estimate::bound`] holds three standard errors.
    Rays {
        /// Segments of a pair at least; pairs with F > 1/300 get 300 F times as many.
        samples: u32,
        /// Standard error of F_ij and F_ji down to which the segments are doubled, as far as 2¹⁹ of them; infinite for no more
        /// than `samples`. It is itself an estimate from 8 replicates, with a heavy tail where few segments are blocked.
        standard_error: f64,
    },
}

impl Default for PartialVisibility {
    fn default() -> Self {
        Self::Exact { tolerance: TOLERANCE }
    }
}

impl<'a> Analytic<'a> {
    /// An estimator among blocking polygons; `None` if nothing can block.
    ///
    /// The polygons of the pairs themselves may be among them: a polygon does not block what lies in its plane.
    pub fn new(occluders: Option<&'a Occluders>) -> Self {
        let occluders = occluders.filter(|occluders| !occluders.is_empty());
        let scene = occluders.map(|occluders| {
            let bodies = Bodies::find(occluders);
            let screens = Screens::new(occluders, &bodies);
            Blockers { occluders, screens: Arc::new(screens), bodies: Arc::new(bodies) }
        });
        Self { scene, visibility: PartialVisibility::default() }
    }

    /// Computes partial pairs by this rule.
    #[must_use]
    pub fn partial_visibility(self, visibility: PartialVisibility) -> Self {
        Self { visibility, ..self }
    }

    /// Tests partial pairs with `samples` segments, and more where F is large: [`PartialVisibility::Rays`].
    #[must_use]
    pub fn samples(self, samples: u32) -> Self {
        self.partial_visibility(PartialVisibility::Rays { samples, standard_error: f64::INFINITY })
    }

    /// The estimate of a pair whose unoccluded value is `whole()`: that, nothing, or what is seen of it. `smaller` is the smaller of the
    /// whole areas.
    fn finish(&self, pair: &FacingPair, smaller: f64, seed: u64, whole: impl FnOnce() -> Bounded) -> Estimate {
        let cost = Cost { form_factors: 1, ..Cost::default() };
        let clear = |whole: Bounded| {
            let cost = Cost { clear_pairs: 1, ..cost };
            Estimate { value: whole.value, bound: whole.bound, cost }
        };
        let Some(Blockers { occluders, screens, bodies }) = &self.scene else { return clear(whole()) };
        let blockers = match screens.classify(occluders, pair) {
            Visibility::Clear => return clear(whole()),
            Visibility::Hidden => return Estimate { cost: Cost { hidden_pairs: 1, ..cost }, ..Estimate::default() },
            Visibility::Partial(blockers) => blockers,
        };
        let (whole, cost) = (whole(), Cost { partial_pairs: 1, ..cost });
        match self.visibility {
            PartialVisibility::Exact { tolerance } => {
                let blocked = Blocked { occluders, bodies, blockers: &blockers, absolute: tolerance * smaller };
                let Visible { area, points } = blocked.visible(pair, whole);
                Estimate { value: area.value, bound: area.bound, cost: Cost { visibility_points: points, ..cost } }
            }
            PartialVisibility::Rays { samples, standard_error } => {
                let more = (whole.value / (smaller * LARGE)).max(1.0);
                let blocking = Blocking::new(occluders, pair, &blockers);
                // Conversion saturates: more segments than there are points in the sequence are not used.
                let (samples, wanted) = ((f64::from(samples) * more) as u32, standard_error * smaller / whole.value);
                let share = visible_share(pair, &blocking, samples, wanted, seed);
                Estimate {
                    value: whole.value * share.visible,
                    bound: 3.0 * share.error * whole.value + whole.bound,
                    cost: Cost { rays: share.rays, ..cost },
                }
            }
        }
    }
}

impl Pairwise for Analytic<'_> {
    fn name(&self) -> &'static str {
        "analytic"
    }

    fn exchange(&self, i: &Polygon, j: &Polygon, tolerance: f64, seed: u64) -> Estimate {
        let Some(pair) = FacingPair::new(i, j) else { return Estimate::default() };
        let smaller = i.area().min(j.area());
        let whole = || unoccluded::exchange_area(&pair, smaller, tolerance);
        self.finish(&pair, smaller, seed, whole)
    }
}
