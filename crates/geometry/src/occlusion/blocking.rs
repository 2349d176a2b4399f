//! Which pieces of a scene can block anything.

use glam::DVec3;

use super::Occluders;
use crate::{Polygon, Scene};

/// The pieces of a scene that can block a segment between two points of the scene, with the index of their surface.
///
/// Left out are pieces with all vertices of the scene on one side of their plane or in it (within the margin of
/// [`Occluders::occluded`]): the walls of a convex room. Of an empty convex room nothing is left.
pub fn blocking_polygons(scene: &Scene) -> Vec<(usize, &Polygon)> {
    let vertices: Vec<DVec3> = scene.pieces().flat_map(|(_, p)| p.vertices().iter().copied()).collect();
    let rounding = Occluders::rounding(scene);
    // The extreme vertices of some directions first: they decide for most pieces.
    let mut order: Vec<DVec3> = Vec::new();
    for k in 0..27 {
        let direction = DVec3::new((k % 3) as f64 - 1.0, (k / 3 % 3) as f64 - 1.0, (k / 9) as f64 - 1.0);
        order.extend(vertices.iter().copied().max_by(|a, b| a.dot(direction).total_cmp(&b.dot(direction))));
    }
    order.extend(&vertices);
    let blocks = |p: &Polygon| {
        let margin = rounding + 2.0 * p.thickness();
        let (mut before, mut behind) = (false, false);
        order.iter().any(|v| {
            let d = p.signed_distance(*v);
            before |= d > margin;
            behind |= d < -margin;
            before && behind
        })
    };
    scene.pieces().filter(|(_, p)| blocks(p)).collect()
}
