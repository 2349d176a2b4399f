//! Convex bodies among the blocking polygons, found once.
//!
//! From outside, a convex body hides what the faces hide that show their front, and these together are one cone: the inner edges
//! and the back faces need not be looked at. A body may have holes, each in a plane of its own with all of the body on one side (a box
//! without its bottom): from the inner side of these planes, or on them, a lid over the hole would show its back, so it need not be there.

use std::collections::HashMap;

use glam::DVec3;
use radiosity_geometry::{Occluders, Polygon};

use super::super::pair::rounding;

/// A convex body: its faces and its holes.
#[derive(Clone, Debug)]
pub(in super::super) struct Body {
    /// Indices of its polygons.
    pub faces: Vec<usize>,
    /// A point of each hole's plane and its unit normal, out of the body.
    pub holes: Vec<(DVec3, DVec3)>,
}

/// The convex bodies among some polygons.
#[derive(Clone, Debug, Default)]
pub(in super::super) struct Bodies {
    bodies: Vec<Body>,
    /// The body of every polygon, if any.
    of: Vec<Option<usize>>,
}

/// The bits of a vertex: edges are shared where their ends are equal to the last bit.
type Key = [u64; 3];

fn key(v: DVec3) -> Key {
    // Adding 0 makes −0 and +0 the same.
    [v.x, v.y, v.z].map(|x| (x + 0.0).to_bits())
}

impl Bodies {
    /// Finds the bodies.
    pub fn find(occluders: &Occluders) -> Self {
        let polygons = occluders.polygons();
        let mut edges: HashMap<(Key, Key), Vec<usize>> = HashMap::new();
        for (k, polygon) in polygons.iter().enumerate() {
            for (a, b) in polygon.edges() {
                edges.entry((key(a), key(b))).or_default().push(k);
            }
        }
        let across = |a: DVec3, b: DVec3| match edges.get(&(key(b), key(a))).map(Vec::as_slice) {
            Some(&[other]) => Some(other),
            _ => None,
        };
        let mut found = Self { bodies: Vec::new(), of: vec![None; polygons.len()] };
        let mut seen = vec![false; polygons.len()];
        for first in 0..polygons.len() {
            if std::mem::replace(&mut seen[first], true) {
                continue;
            }
            let (mut faces, mut next, mut open) = (vec![first], 0, Vec::new());
            while next < faces.len() {
                for (a, b) in polygons[faces[next]].edges() {
                    match across(a, b) {
                        Some(other) if !std::mem::replace(&mut seen[other], true) => faces.push(other),
                        Some(_) => {}
                        None => open.push((a, b)),
                    }
                }
                next += 1;
            }
            if let Some(body) = convex(polygons, faces, &open) {
                body.faces.iter().for_each(|&face| found.of[face] = Some(found.bodies.len()));
                found.bodies.push(body);
            }
        }
        found
    }

    /// The body of a polygon.
    pub fn of(&self, polygon: usize) -> Option<usize> {
        self.of[polygon]
    }

    /// All bodies.
    pub fn iter(&self) -> impl Iterator<Item = &Body> {
        self.bodies.iter()
    }

    /// Body number `k`.
    pub fn body(&self, k: usize) -> &Body {
        &self.bodies[k]
    }
}

/// The body of connected faces with `open` edges, if it is convex.
fn convex(polygons: &[Polygon], faces: Vec<usize>, open: &[(DVec3, DVec3)]) -> Option<Body> {
    if faces.len() < 2 {
        return None;
    }
    let vertices: Vec<DVec3> = faces.iter().flat_map(|&k| polygons[k].vertices().iter().copied()).collect();
    let slack = rounding(&vertices) + 2.0 * faces.iter().map(|&k| polygons[k].thickness()).fold(0.0, f64::max);
    let behind = |p: DVec3, n: DVec3| vertices.iter().all(|v| (*v - p).dot(n) <= slack);
    if !faces.iter().all(|&k| behind(polygons[k].centroid(), polygons[k].normal())) {
        return None;
    }
    let mut holes = Vec::new();
    for rim in loops(open)? {
        // Against the sense of the faces the rim runs around a lid that would close the hole.
        let lid = Polygon::new(&rim.iter().rev().copied().collect::<Vec<_>>()).ok()?;
        let flat = rim.iter().all(|v| lid.signed_distance(*v).abs() <= slack);
        if !(flat && behind(lid.centroid(), lid.normal())) {
            return None;
        }
        holes.push((lid.centroid(), lid.normal()));
    }
    Some(Body { faces, holes })
}

/// Directed edges joined to closed loops; `None` if they do not close, or a vertex has several ways on.
pub(super) fn loops(edges: &[(DVec3, DVec3)]) -> Option<Vec<Vec<DVec3>>> {
    let mut left: Vec<(DVec3, DVec3)> = edges.to_vec();
    let mut found = Vec::new();
    while let Some((begin, mut end)) = left.pop() {
        let mut rim = vec![begin];
        while end != begin {
            rim.push(end);
            let mut on = left.iter().enumerate().filter(|(_, edge)| edge.0 == end);
            let (k, _) = on.next()?;
            if on.next().is_some() {
                return None;
            }
            end = left.swap_remove(k).1;
        }
        found.push(rim);
    }
    Some(found)
}
