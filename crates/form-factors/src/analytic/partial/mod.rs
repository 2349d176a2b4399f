//! Partly blocked pairs: the hidden part is exact from every point, and integrated adaptively between visibility events.
//!
//! ```text
//! A_i F_ij = ∫_i [F(x → j) − hidden(x)] dA,      hidden(x) = F(x → j ∩ ∪_K cone(x, K))
//! ```
//!
//! Seen from a point x of i, what lies between hides cones. Both polygons and every blocker, cut to what lies in front of both planes,
//! are convex cones of directions, so a common part of them is bounded by arcs, and Lambert's sum over these arcs is its form factor
//! (`lanes`). Overlapping shadows are joined by inclusion and exclusion, and by cutting where they are many (`crowd`). Faces of a convex body
//! count as one shadow (`bodies`, `shade`).
//!
//! hidden(x) is analytic between *visibility events* (`events`): i is cut along them, and product rules on the cells of the cut,
//! raised in order and then halved, give the integral (`cells`). What all of a cell sees, or none, is known beforehand. Both ∫ hidden and
//! ∫ visible are summed; the value is the unoccluded one less the first, or the second, whichever has the smaller error.
//!
//! The bound is an *estimate*: the sum over the cells of the difference between the last two orders. It does not grow smaller
//! than what was asked except by luck, since a pair stops being refined there.
//!
//! What is *not* here: sampling (`sampling`), proven bounds, and blockers that are not polygons.

mod bodies;
mod cells;
mod crowd;
mod events;
mod lanes;
mod shade;

use glam::DVec3;
use pulp::Arch;
use radiosity_geometry::Occluders;

pub(super) use bodies::Bodies;

use super::area_quadrature::Bounded;
use super::pair::FacingPair;
use cells::{Batch, Cell, Integration};
use events::{Region, cut_at_planes};
use lanes::Arcs;
use shade::View;

/// Events that come this near to the border of a part are left out, in units of the size of the carrier, at the tightest.
const SNAP: f64 = 1e-7;

/// Parts into which events cut a carrier at most.
const MAX_PARTS: usize = 512;

/// What blocks a pair, and how well it is to be known.
pub(super) struct Blocked<'a> {
    pub occluders: &'a Occluders,
    pub bodies: &'a Bodies,
    /// Polygons that may block.
    pub blockers: &'a [usize],
    /// Error of A_i F_ij to aim at.
    pub absolute: f64,
}

/// A visible exchange area and the points that it took.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Visible {
    pub area: Bounded,
    pub points: u64,
}

impl Blocked<'_> {
    /// A_i F_ij of a pair whose unoccluded value is `whole`.
    pub fn visible(&self, pair: &FacingPair, whole: Bounded) -> Visible {
        self.visible_from(pair, whole, self.second_carries(pair))
    }

    /// As [`Self::visible`], with the points on j if `second`.
    fn visible_from(&self, pair: &FacingPair, whole: Bounded, second: bool) -> Visible {
        let view = View::new(pair, second, self.occluders, self.bodies, self.blockers);
        let area = view.frame.unit * view.frame.unit;
        let wanted = self.absolute / area;
        let size = view.carrier.iter().map(|v| v.distance(view.carrier[0])).fold(0.0, f64::max);
        // A kink this near to a border bends the integrand in a strip as narrow, by as little.
        let snap = size * (0.1 * (self.absolute / whole.value).sqrt()).clamp(SNAP, 0.05);
        let (mut regions, mut cells) = (Vec::new(), Vec::new());
        for part in cut_at_planes(&view, snap) {
            let region = Region::new(&view, &part);
            for cell in region.split(part, snap, MAX_PARTS.saturating_sub(cells.len())) {
                let sight = region.sight(&cell);
                cells.extend(Cell::fan(&cell, regions.len(), sight));
            }
            regions.push(region);
        }
        let mut whole_arcs = Arcs::default();
        for k in 0..view.receiver.len() {
            let next = view.receiver[(k + 1) % view.receiver.len()];
            whole_arcs.push(view.receiver[k], next, 1.0, std::iter::empty());
        }
        let mut integration = Integration {
            arch: Arch::new(),
            regions: &regions,
            receiver: &view.receiver,
            whole: &whole_arcs,
            cells,
            points: 0,
            work: 0,
            batch: Batch::default(),
        };
        let (value, error) = integration.run(wanted);
        let by_hidden = Bounded { value: whole.value - area * value.hidden, bound: whole.bound + area * error.hidden };
        let by_visible = Bounded { value: area * value.visible, bound: area * error.visible };
        let area = if by_visible.bound < by_hidden.bound { by_visible } else { by_hidden };
        Visible {
            area: Bounded { value: area.value.clamp(0.0, whole.value + whole.bound), ..area },
            points: integration.points,
        }
    }

    /// Which polygon is to carry the points: shadows of a large polygon through a near blocker are blurred, and so made of few parts.
    fn second_carries(&self, pair: &FacingPair) -> bool {
        let bounds =
            |v: &[DVec3]| v.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
        let (i, j) = (bounds(&pair.i), bounds(&pair.j));
        let away = |(lo, hi): (DVec3, DVec3)| {
            let distances = self.blockers.iter().map(|&k| {
                let (a, b) = self.occluders.polygons()[k].bounds();
                (a - pair.origin - hi).max(lo - (b - pair.origin)).max(DVec3::ZERO).length()
            });
            distances.fold(f64::INFINITY, f64::min)
        };
        let size = |(lo, hi): (DVec3, DVec3)| (hi - lo).length();
        size(i) * away(j) > size(j) * away(i)
    }
}

#[cfg(test)]
mod tests;
