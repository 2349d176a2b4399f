//! The analytic estimator: exchange areas of pairs of convex polygons, exact but for visibility.
//!
//! | pair | rule | range | order | error bound |
//! |---|---|---|---|---|
//! | facing away | 0 | no corner of one more than rounding above the other's plane | | |
//! | separated | 4-D Gauss product rule | every σ = h/D ≤ 0.4 and at most 2,500 points | 1 to 8 a direction, from the bound | proven (Gegenbauer series, `order`) and rounding |
//! | near, touching, tiny gap | contour integral, corner logarithms and pairs of parallel edges closed, inner edge closed and Gauss–Kronrod outside for the rest | all others | 7/15, panels bisected | per panel proven (ellipse of analyticity) or the difference of the two rules; singularities left alone, rounding |
//! | near, and a sliver or of very unequal size | exact point factors, integrated over the smaller polygon | where the contour rule's rounding exceeds the tolerance and 1e-11 of the smaller area or 1e-7 of the value | 7/15 in two directions, pieces bisected in either | differences of the rules, area of what is left, rounding |
//! | crossing a plane | clipped at the horizon, then as above | | | as above, and the area that rounding moves across the cut |
//! | partly blocked | exact hidden part of every point, product rules between visibility events (`partial`) | where the classification says so | 1, 2, 3, 5, 8 a direction, then cells halved | estimate: last difference of orders, and the above |
//! | the same, [`PartialVisibility::Rays`] | unoccluded value × Σ kV/Σ k (`sampling`) | likewise | segments doubled to a standard error | three standard errors and the above |
//!
//! h is half the length of a patch along one direction and D its distance from the partner (see `order`). All
//! rules aim at max(tolerance · min(A_i, A_j), rounding) and 1000 · tolerance relative. Nothing is clipped, split or compared at
//! an absolute length; coordinates are taken relative to the pair. Equal squares side by side are separated from about two
//! sides between their centres on; at 1e-8 two points a direction do from about 15 sides on, three from 6.
//!
//! Rows take separated pairs of triangles and quadrilaterals several at a time ([`FacetBlocks`]) and all others one by one,
//! by the same bound. The bound is about 7 times the error in the median between the cells of a cube, and the worst error
//! a quarter to a half of the tolerance: asked for 3.5e-9, 16 × 16 cells a face err by at most 1.3e-9 and 24 × 24 by 0.9e-9.
//!
//! What is *not* here: patches that are not flat, surfaces other than polygons, and a proven
//! bound for partly blocked pairs.

mod area_quadrature;
mod blocks;
mod change;
mod closed_forms;
mod contour;
mod differential;
mod gauss;
mod lanes;
mod order;
mod pair;
mod partial;
mod patch;
mod point_quadrature;
mod pose;
mod sampling;
mod singularities;
mod slabs;
mod unoccluded;
mod visibility;

use std::sync::Arc;

use radiosity_core::Cost;
use radiosity_geometry::{Facets, Occluders, Polygon};

pub use blocks::FacetBlocks;
pub use change::{BlockerChange, Sides, facing_pairs};
pub use closed_forms::{opposed_rectangles, perpendicular_rectangles};
pub use differential::differential;
pub use unoccluded::unoccluded;

use crate::level::Level;
use crate::{Estimate, Pairwise, Run};
use area_quadrature::Bounded;
use blocks::{AWAY, Source};
use pair::FacingPair;
pub(crate) use pair::rounding;
use partial::{Blocked, Bodies, Visible};
use sampling::visible_share;
use visibility::{Blocking, Screens, Visibility};

/// Error of the form factors of partial pairs, unless set otherwise.
const TOLERANCE: f64 = 1e-6;
/// Form factor (the larger of F_ij and F_ji) from which on a pair gets more segments, in proportion: the sum of variances
/// Σ F²/N at a given sum of N is least for N ∝ F, and the segments of a row stay below samples · (pairs + 300).
pub const LARGE: f64 = 1.0 / 300.0;
/// Targets whose bounds are kept at once.
const RUN: usize = 256;

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
    level: Level,
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
        /// Segments of a pair at least; pairs with F > [`LARGE`] get 300 F times as many.
        samples: u32,
        /// Standard error of F_ij and F_ji down to which the segments are doubled, as far as 2¹⁹ of them; infinite for no more
        /// than `samples`. It is itself an estimate from 8 replicates, with a heavy tail where few segments are blocked.
        standard_error: f64,
    },
}

/// Whether two polygons face each other, as the estimator has it.
pub(crate) fn faces(i: &Polygon, j: &Polygon) -> bool {
    FacingPair::faces(i, j)
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
        Self { scene, visibility: PartialVisibility::default(), level: Level::best() }
    }

    /// Of pairs whose segments must pass each of these convex windows: none that passes beside one counts. The surroundings of the windows
    /// must be among the polygons that block; told of the windows, the estimator need not find out from many of them that a pair is hidden.
    #[must_use]
    pub fn through(mut self, windows: &[Polygon]) -> Self {
        if let Some(Blockers { screens, .. }) = &mut self.scene {
            Arc::make_mut(screens).set_windows(windows);
        }
        self
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

    /// Kernels of another instruction set than the best, to compare them.
    #[doc(hidden)]
    #[must_use]
    pub fn at_level(self, level: Level) -> Self {
        Self { level, ..self }
    }

    /// The estimate of target t, whose unoccluded value with the source is `whole`.
    fn visible(&self, run: &Run<'_>, t: usize, whole: Bounded) -> Estimate {
        let pair = run.polygons(t).next().and_then(|(i, j, seed)| {
            let pair = FacingPair::new(i, j)?;
            Some((pair, i.area().min(j.area()), seed))
        });
        pair.map_or(Estimate::default(), |(pair, smaller, seed)| self.finish(&pair, smaller, seed, || whole))
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

    fn lay_out(&self, targets: &Facets) -> Option<FacetBlocks> {
        Some(FacetBlocks::new(targets))
    }

    fn exchange_run(&self, run: &Run<'_>, values: &mut [f64]) -> (Cost, f64) {
        let Some(blocks) = run.blocks else { return run.one_by_one(self, values) };
        let source = Source { facets: run.sources, s: run.s, swapped: run.swapped(), tolerance: run.tolerance };
        let (mut cost, mut worst) = (Cost::default(), 0.0_f64);
        let mut bounds = [AWAY; RUN];
        for (from, values) in (run.from..).step_by(RUN).zip(values.chunks_mut(RUN)) {
            let bounds = &mut bounds[..values.len()];
            blocks.fill(self.level, source, from, values, bounds);
            let whole = bounds.iter().filter(|bound| **bound >= 0.0).count();
            worst = bounds.iter().fold(worst, |worst, bound| worst.max(*bound));
            if self.scene.is_none() {
                cost.form_factors += whole as u64;
                cost.clear_pairs += whole as u64;
            }
            let left = bounds.iter().filter(|bound| bound.is_nan()).count();
            if left == 0 && (whole == 0 || self.scene.is_none()) {
                continue;
            }
            for ((t, value), bound) in (from..).zip(values).zip(bounds.iter()) {
                let estimate = if bound.is_nan() {
                    run.pair(self, t)
                } else if *bound >= 0.0 && self.scene.is_some() {
                    self.visible(run, t, Bounded { value: *value, bound: *bound })
                } else {
                    continue;
                };
                *value = estimate.value;
                cost += estimate.cost;
                worst = worst.max(estimate.bound);
            }
        }
        (cost, worst)
    }
}
