//! Which polygons can block anything.

use glam::DVec3;

use super::Occluders;
use crate::{Polygon, Scene};

/// The pieces of a scene that can block a segment between two points of the scene, with the index of their surface.
///
/// Left out are pieces with all vertices of the scene on one side of their plane or in it (within the margin of
/// [`Occluders::occluded`]): the walls of a convex room. Of an empty convex room nothing is left.
pub fn blocking_polygons(scene: &Scene) -> Vec<(usize, &Polygon)> {
    blocking_polygons_among(scene, &|_| true)
}

/// [`blocking_polygons`] for segments between two points of the surfaces that `picked` names: what lies beside the box of these blocks none either.
pub fn blocking_polygons_among<'s>(scene: &'s Scene, picked: &dyn Fn(usize) -> bool) -> Vec<(usize, &'s Polygon)> {
    let pieces = || scene.pieces().filter(|(s, _)| picked(*s)).map(|(_, p)| p);
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (lo, hi) = pieces().map(Polygon::bounds).fold(none, |(lo, hi), (a, b)| (lo.min(a), hi.max(b)));
    let rounding = Occluders::rounding(scene);
    let ends = Ends::new(pieces().flat_map(|p| p.vertices().iter().copied()).collect(), rounding);
    let beside = |p: &Polygon| {
        let ((from, to), margin) = (p.bounds(), rounding + 2.0 * p.thickness());
        from.cmpgt(hi + margin).any() || to.cmplt(lo - margin).any()
    };
    scene.pieces().filter(|(_, p)| !beside(p) && ends.parted_by(p)).collect()
}

/// Points between which segments may run.
#[derive(Clone, Debug)]
pub struct Ends {
    points: Vec<DVec3>,
    rounding: f64,
}

impl Ends {
    /// Segments between any of `points` and those of their convex hull, whose coordinates err by `rounding`.
    pub fn new(mut points: Vec<DVec3>, rounding: f64) -> Self {
        // The extreme points of some directions first: they decide for most polygons.
        let mut order: Vec<DVec3> = Vec::with_capacity(points.len() + 27);
        for k in 0..27 {
            let direction = DVec3::new((k % 3) as f64 - 1.0, (k / 3 % 3) as f64 - 1.0, (k / 9) as f64 - 1.0);
            order.extend(points.iter().copied().max_by(|a, b| a.dot(direction).total_cmp(&b.dot(direction))));
        }
        order.append(&mut points);
        Self { points: order, rounding }
    }

    /// Whether points lie on both sides of a polygon's plane, beyond rounding: if not, it blocks none of the segments.
    pub fn parted_by(&self, polygon: &Polygon) -> bool {
        let margin = self.rounding + 2.0 * polygon.thickness();
        let (mut before, mut behind) = (false, false);
        self.points.iter().any(|v| {
            let d = polygon.signed_distance(*v);
            before |= d > margin;
            behind |= d < -margin;
            before && behind
        })
    }
}
