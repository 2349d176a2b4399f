//! Polygons without cracks between them, for display.

use std::cmp::Ordering;
use std::collections::HashMap;

use glam::DVec3;
use rayon::prelude::*;

use super::Mesh;
use super::contacts::{BoxTree, Line};
use crate::Polygon;

/// A vertex closer to an edge or to another vertex than this share of the mesh's size lies on it.
const ON_EDGE: f64 = 1e-9;

/// A direction, of a length below 1, that no edge of a regular mesh is perpendicular to.
const GENERIC: DVec3 = DVec3::new(0.512_3, 0.631_1, 0.582_2);

/// Elements as loops of numbered vertices which those that touch share, corners of neighbours on their edges included.
pub(super) struct Conforming {
    pub(super) positions: Vec<DVec3>,
    /// First corner of every element, and the number of corners.
    pub(super) begins: Vec<u32>,
    /// Vertex of every corner.
    pub(super) corners: Vec<u32>,
}

impl Mesh {
    /// The vertices of every element, with those of its neighbours that lie on its edges: where a coarse element meets finer ones, at
    /// contacts and across the edges of surfaces, polygons share all their vertices, so that nothing shows between them.
    ///
    /// Takes O(m log m) for m elements.
    pub fn without_cracks(&self) -> Vec<Vec<DVec3>> {
        let Conforming { positions, begins, corners } = self.conforming();
        let loop_ = |ends: &[u32]| &corners[ends[0] as usize..ends[1] as usize];
        begins.windows(2).map(|ends| loop_(ends).iter().map(|&v| positions[v as usize]).collect()).collect()
    }

    /// [`Self::without_cracks`] with its vertices numbered.
    ///
    /// # Panics
    ///
    /// If there are 2³² corners or more.
    pub(super) fn conforming(&self) -> Conforming {
        let polygons: Vec<&Polygon> = self.element_facets.iter_polygons().map(|(_, polygon)| polygon).collect();
        let (lo, hi) = crate::polygon::bounds(polygons.iter().flat_map(|p| p.vertices()).copied());
        let slack = ON_EDGE * lo.distance(hi);
        let loops = closed(&polygons, slack);

        // Vertices in order of first use; those that are apart by rounding are one.
        let (mut number, mut positions) = (HashMap::new(), Vec::new());
        let mut begins = vec![0];
        let mut corners: Vec<u32> = Vec::new();
        for vertex in loops.iter().flatten() {
            corners.push(*number.entry(vertex.to_array().map(f64::to_bits)).or_insert_with(|| {
                positions.push(*vertex);
                positions.len() as u32 - 1
            }));
        }
        let same = welded(&positions, slack);
        corners.iter_mut().for_each(|corner| *corner = same[*corner as usize]);
        for loop_ in &loops {
            begins
                .push(begins[begins.len() - 1] + u32::try_from(loop_.len()).expect("corners are numbered in 32 bits"));
        }
        Conforming { positions, begins, corners }
    }
}

/// Polygons with the vertices of others that lie on their edges within `slack`.
fn closed(polygons: &[&Polygon], slack: f64) -> Vec<Vec<DVec3>> {
    let boxes = BoxTree::new(polygons.iter().map(|polygon| polygon.bounds()));
    let closed = |polygon: &&Polygon| {
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
                p.0.total_cmp(&q.0).then(order(&p.1).partial_cmp(&order(&q.1)).unwrap_or(Ordering::Equal))
            });
            hanging.dedup_by(|later, kept| later.0 - kept.0 <= slack);
            vertices.extend(hanging.into_iter().map(|(_, v)| v));
        }
        vertices
    };
    polygons.par_iter().map(closed).collect()
}

/// For every vertex the first in the order of a sweep of those closer to it than `slack`.
fn welded(positions: &[DVec3], slack: f64) -> Vec<u32> {
    let mut order: Vec<(f64, u32)> = (0..).zip(positions).map(|(k, v)| (v.dot(GENERIC), k)).collect();
    order.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut same: Vec<u32> = (0..positions.len() as u32).collect();
    // The direction is no longer than 1, so what is near in space is near in the sweep.
    for (at, &(key, k)) in order.iter().enumerate() {
        let before = order[..at].iter().rev().take_while(|(other, _)| key - other <= slack);
        let near = before.map(|&(_, other)| same[other as usize]);
        if let Some(first) = near.filter(|&o| positions[o as usize].distance(positions[k as usize]) <= slack).last() {
            same[k as usize] = first;
        }
    }
    same
}
