//! The analytic estimator: exchange areas of pairs of convex polygons, exact but for visibility.
//!
//! | pair | rule | range | order | error bound |
//! |---|---|---|---|---|
//! | separated | 4-D Gauss product rule | every σ = h/D ≤ 0.4 and at most 2,500 points | 1 to 8 a direction, from the bound | proven (Gegenbauer series) and rounding |
//! | near, touching, tiny gap | contour integral, corner logarithms and pairs of parallel edges closed, inner edge closed and Gauss–Kronrod outside for the rest | all others | 7/15, panels bisected | per panel proven (ellipse of analyticity) or the difference of the two rules; singularities left alone, rounding |
//! | near, and a sliver or of very unequal size | exact point factors, integrated over the smaller polygon | where the contour rule's rounding exceeds the tolerance and 1e-11 of the smaller area or 1e-7 of the value | 7/15 in two directions, pieces bisected in either | differences of the rules, area of what is left, rounding |
//! | crossing a plane | clipped at the horizon, then as above | | | as above, and the area that rounding moves across the cut |
//! | partly blocked | unoccluded value × Σ kV/Σ k | where the classification says so | 256 segments a pair and more for large F | three standard errors and the above |
//!
//! h is half the length of a patch along one direction and D its distance from the partner (see `area_quadrature`). All
//! rules aim at max(tolerance · min(A_i, A_j), rounding) and 1000 · tolerance relative. Nothing is clipped, split or compared at
//! an absolute length; coordinates are taken relative to the pair.
//!
//! What is *not* here: patches that are not flat, surfaces other than polygons, and exact partial visibility.

mod area_quadrature;
mod closed_forms;
mod contour;
mod differential;
mod gauss;
mod pair;
mod partial;
mod point_quadrature;
mod sampling;
mod singularities;
mod slabs;
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
use visibility::{Blocking, Visibility, classify};

/// Error of the form factors of partial pairs, unless set otherwise.
const TOLERANCE: f64 = 1e-6;
/// Form factor (the larger of F_ij and F_ji) from which on a pair gets more segments, in proportion: the sum of variances
/// Σ F²/N at a given sum of N is least for N ∝ F, and the segments of a row stay below samples · (pairs + 300).
const LARGE: f64 = 1.0 / 300.0;

/// Exchange areas of pairs of convex polygons: unoccluded values to a tolerance, times a sampled visible share where
/// something may lie between.
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

/// Polygons that block, and the bodies among them.
#[derive(Clone)]
struct Blockers<'a> {
    occluders: &'a Occluders,
    bodies: Arc<Bodies>,
}

/// How pairs are computed between which something may lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PartialVisibility {
    /// The hidden part is exact from every point, and integrated adaptively.
    Exact {
        /// Error of F_ij and F_ji to aim at, or what the pair is asked for if that is more.
        tolerance: f64,
    },
    /// The unoccluded value times the visible share of segments.
    Rays {
        /// Segments of a pair at least; pairs with F > 1/300 get 300 F times as many.
        samples: u32,
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
        let scene = occluders.map(|occluders| Blockers { occluders, bodies: Arc::new(Bodies::find(occluders)) });
        Self { scene, visibility: PartialVisibility::default() }
    }

    /// Computes partial pairs by this rule.
    #[must_use]
    pub fn partial_visibility(self, visibility: PartialVisibility) -> Self {
        Self { visibility, ..self }
    }

    /// Tests partial pairs with at least `samples` segments: [`PartialVisibility::Rays`].
    #[must_use]
    pub fn samples(self, samples: u32) -> Self {
        self.partial_visibility(PartialVisibility::Rays { samples })
    }

    /// Completes the estimate of a pair whose unoccluded value is `whole`; `smaller` is the smaller of the whole areas.
    fn finish(
        &self,
        pair: &FacingPair,
        whole: impl FnOnce() -> Bounded,
        smaller: f64,
        tolerance: f64,
        seed: u64,
    ) -> Estimate {
        let cost = Cost { form_factors: 1, ..Cost::default() };
        let clear = |whole: Bounded| {
            let cost = Cost { clear_pairs: 1, ..cost };
            Estimate { value: whole.value, bound: whole.bound, cost }
        };
        let Some(Blockers { occluders, bodies }) = &self.scene else { return clear(whole()) };
        let blockers = match classify(occluders, pair) {
            Visibility::Clear => return clear(whole()),
            Visibility::Hidden => return Estimate { cost: Cost { hidden_pairs: 1, ..cost }, ..Estimate::default() },
            Visibility::Partial(blockers) => blockers,
        };
        let (whole, cost) = (whole(), Cost { partial_pairs: 1, ..cost });
        match self.visibility {
            PartialVisibility::Exact { tolerance: exact } => {
                let absolute = smaller * exact.max(tolerance);
                let blocked = Blocked { occluders, bodies, blockers: &blockers, absolute };
                let Visible { area, points } = blocked.visible(pair, whole);
                Estimate { value: area.value, bound: area.bound, cost: Cost { visibility_points: points, ..cost } }
            }
            PartialVisibility::Rays { samples } => {
                let more = (whole.value / (smaller * LARGE)).max(1.0);
                let blocking = Blocking::new(occluders, pair, &blockers);
                // Conversion saturates: more segments than there are points in the sequence are not used.
                let share = visible_share(pair, &blocking, (f64::from(samples) * more) as u32, seed);
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
        self.finish(&pair, whole, smaller, tolerance, seed)
    }
}
