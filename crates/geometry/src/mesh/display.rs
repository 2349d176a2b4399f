//! Polygons without cracks between them, for display.

use glam::DVec3;
use rayon::prelude::*;

use super::Mesh;
use super::contacts::{BoxTree, Line};
use crate::Polygon;

/// A vertex closer to an edge than this share of the mesh's size lies on it.
const ON_EDGE: f64 = 1e-9;

impl Mesh {
    /// The vertices of every element, with those of its neighbours that lie on its edges: where a coarse element meets finer ones, at
    /// contacts and across the edges of surfaces, polygons share all their vertices, so that nothing shows between them.
    ///
    /// Takes O(m log m) for m elements.
    pub fn without_cracks(&self) -> Vec<Vec<DVec3>> {
        let polygons: Vec<Polygon> =
            (0..self.elements.len()).map(|e| self.element_facets.polygons(e)[0].clone()).collect();
        let boxes = BoxTree::new(polygons.iter().map(Polygon::bounds));
        let (lo, hi) = crate::polygon::bounds(polygons.iter().flat_map(Polygon::vertices).copied());
        let slack = ON_EDGE * lo.distance(hi);
        let closed = |polygon: &Polygon| {
            let mut vertices = Vec::with_capacity(polygon.vertices().len() + 2);
            for (a, b) in polygon.edges() {
                vertices.push(a);
                let length = a.distance(b);
                let along = (b - a) / length;
                // Vertices on the edge with their distances from its beginning.
                let mut hanging: Vec<(f64, DVec3)> = Vec::new();
                boxes.visit(&Line::new(a, b), slack, &mut |other| {
                    for &v in polygons[other].vertices() {
                        let s = (v - a).dot(along);
                        if s > slack && s < length - slack && (v - a - along * s).length() <= slack {
                            hanging.push((s, v));
                        }
                    }
                });
                let order = |v: &DVec3| (v.x, v.y, v.z);
                hanging.sort_by(|p, q| {
                    p.0.total_cmp(&q.0).then(order(&p.1).partial_cmp(&order(&q.1)).unwrap_or(std::cmp::Ordering::Equal))
                });
                hanging.dedup_by(|later, kept| later.0 - kept.0 <= slack);
                vertices.extend(hanging.into_iter().map(|(_, v)| v));
            }
            vertices
        };
        polygons.par_iter().map(closed).collect()
    }
}
