//! Values at nodes and centres from the means over elements.

use glam::DVec3;
use rayon::prelude::*;

use super::joints::{Parted, ROUNDING};
use crate::{Facets, Polygon};

/// Least share of the weights of neighbours in the direction in which they spread less, from which on there is a slope that way.
const SPREAD: f64 = 1e-6;

/// Least share of an element's bend, for its size, that neighbours have where it is part of an extremum.
const SHARED: f64 = 0.2;

/// Steps, of those between elements, that a slope may make within one before it counts as that of a jump.
const ROOM: f64 = 2.0;

/// How often limited elements may move their vertices.
const ROUNDS: usize = 3;

/// One band of a reconstruction.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Values {
    /// u of every element.
    means: Vec<f64>,
    /// v of every node.
    nodes: Vec<f64>,
    /// Value at the centre of every element.
    pub(super) centres: Vec<f64>,
    /// s of every element: its share of what nodes differ from its mean by.
    pub(super) limits: Vec<f64>,
}

impl Values {
    /// The value at a node of an element as the element has it.
    pub(super) fn at_node(&self, element: usize, node: u32) -> f64 {
        self.means[element] + self.limits[element] * (self.nodes[node as usize] - self.means[element])
    }
}

/// Smallest and largest of some numbers.
fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)))
}

/// A range cut off at zero if its `values` all lie on one side.
fn of_one_sign((lo, hi): (f64, f64), values: (f64, f64)) -> (f64, f64) {
    (if values.0 >= 0.0 { lo.max(0.0) } else { lo }, if values.1 <= 0.0 { hi.min(0.0) } else { hi })
}

/// Reconstructs one band.
pub(super) fn values(facets: &Facets, parted: &Parted, u: &[f64]) -> Values {
    let polygon = |e: u32| &facets.polygons(e as usize)[0];
    let (m, count) = (u.len(), parted.around.len());
    let own = |elements: &[u32]| range(elements.iter().map(|&e| u[e as usize]));
    let slopes: Vec<DVec3> = (0..m as u32)
        .into_par_iter()
        .map(|e| {
            let step = |&k: &u32| (polygon(k).centroid() - polygon(e).centroid(), u[k as usize] - u[e as usize]);
            let beside = parted.neighbours.of(e as usize);
            let near = Slope::new(polygon(e), beside.iter().map(step));
            // In a corner, a triangle has but one neighbour: those of it tell the rest.
            let next = || beside.iter().flat_map(|&k| parted.neighbours.of(k as usize)).filter(|k| **k != e);
            if near.full() {
                near.slope()
            } else {
                Slope::new(polygon(e), beside.iter().chain(next()).map(step)).slope()
            }
        })
        .collect();
    let weight = |e: u32, node: usize| parted.nodes.positions[node].distance_squared(polygon(e).centroid()).recip();
    let mean = |node: usize, elements: &[(u32, f64)]| {
        let sums = elements.iter().fold((0.0, 0.0), |(sum, all), &(e, value)| {
            let weight = weight(e, node);
            (sum + weight * value, all + weight)
        });
        sums.0 / sums.1
    };
    let said = |e: u32, node: usize| slopes[e as usize].dot(parted.nodes.positions[node] - polygon(e).centroid());
    // Range of what surrounds a node; `None` at a border.
    let surrounding = |node: usize| {
        let ring = parted.surround.of(node);
        let near = ring.iter().flat_map(|&e| parted.neighbours.of(e as usize)).chain(ring);
        (!ring.is_empty()).then(|| range(near.map(|&e| u[e as usize])))
    };
    let bounds: Vec<Option<(f64, f64)>> = (0..count).into_par_iter().map(surrounding).collect();
    // Share of its slope with which an element stays in range at its nodes away from borders: by it values go on to the border.
    let steady = |e: u32| {
        let share = |&node: &u32| {
            let ((lo, hi), step) = (bounds[node as usize]?, said(e, node as usize));
            let room = ROOM * ((if step > 0.0 { hi } else { lo }) - u[e as usize]);
            Some(if room.abs() < step.abs() { room / step } else { 1.0 })
        };
        parted.nodes.of(e as usize).iter().filter_map(share).fold(1.0, f64::min)
    };
    let steady: Vec<f64> = (0..m as u32).into_par_iter().map(steady).collect();
    let extended = |node: usize| {
        let around = parted.around.of(node);
        let share = |e: u32| if bounds[node].is_some() { 1.0 } else { steady[e as usize] };
        let of = |&e: &u32| (e, u[e as usize] + share(e) * said(e, node));
        let value = mean(node, &around.iter().map(of).collect::<Vec<_>>());
        let (lo, hi) = of_one_sign(bounds[node].unwrap_or((f64::NEG_INFINITY, f64::INFINITY)), own(around));
        value.clamp(lo, hi)
    };
    let mut nodes: Vec<f64> = (0..count).into_par_iter().map(extended).collect();

    // Limiting.
    let ranges: Vec<(f64, f64)> = (0..count).map(|node| own(parted.around.of(node))).collect();
    let mut limited = limits(facets, parted, u, &nodes, &ranges);
    for _ in 0..ROUNDS {
        let moved = |node: usize| {
            let strict = |e: &&u32| limited[**e as usize].1 < 1.0;
            let said = |&e: &u32| (e, u[e as usize] + limited[e as usize].1 * (nodes[node] - u[e as usize]));
            let said: Vec<(u32, f64)> = parted.around.of(node).iter().filter(strict).map(said).collect();
            if said.is_empty() { nodes[node] } else { mean(node, &said) }
        };
        nodes = (0..count).into_par_iter().map(moved).collect();
        limited = limits(facets, parted, u, &nodes, &ranges);
    }
    let centre = |(u, (bend, limit)): (&f64, &(f64, f64))| u + limit * bend;
    Values {
        centres: u.iter().zip(&limited).map(centre).collect(),
        limits: limited.iter().map(|(_, limit)| *limit).collect(),
        means: u.to_vec(),
        nodes,
    }
}

/// Bend z − u and limit s of every element.
fn limits(facets: &Facets, parted: &Parted, u: &[f64], nodes: &[f64], ranges: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let positions = &parted.nodes.positions;
    let bends: Vec<f64> = (0..u.len())
        .into_par_iter()
        .map(|e| {
            let (polygon, corners) = (&facets.polygons(e)[0], parted.nodes.of(e));
            let (centre, normal) = (polygon.centroid(), polygon.normal());
            let (mut sum, mut area) = (0.0, 0.0);
            for (k, &a) in corners.iter().enumerate() {
                let b = corners[(k + 1) % corners.len()];
                let part = (positions[a as usize] - centre).cross(positions[b as usize] - centre).dot(normal);
                sum += part * ((nodes[a as usize] - u[e]) + (nodes[b as usize] - u[e]));
                area += part;
            }
            -sum / area
        })
        .collect();
    let surrounded = |node: &u32| !parted.surround.of(*node as usize).is_empty();
    let inside: Vec<bool> = (0..u.len()).map(|e| parted.nodes.of(e).iter().all(surrounded)).collect();
    let limit = |e: usize| {
        let (own, bend) = (parted.nodes.of(e), bends[e]);
        let near = range(own.iter().flat_map(|&node| [ranges[node as usize].0, ranges[node as usize].1]));
        let values = range(own.iter().map(|&node| nodes[node as usize]));
        let size = |k: u32| (facets.area(k as usize) / facets.area(e)).min(1.0);
        let shares = |&k: &u32| bends[k as usize] * bend.signum() >= SHARED * size(k) * bend.abs();
        // At a border values go on in a straight line, which bends nothing: only there this says something about neighbours there.
        let extremum = parted.neighbours.of(e).iter().filter(|k| inside[**k as usize] || !inside[e]).all(shares);
        let bounds =
            if extremum { (f64::NEG_INFINITY, f64::INFINITY) } else { (near.0.min(values.0), near.1.max(values.1)) };
        let (lo, hi) = of_one_sign(bounds, near);
        let (centre, slack) = (u[e] + bend, ROUNDING * near.0.abs().max(near.1.abs()));
        if centre < lo - slack {
            (bend, (lo - u[e]) / bend)
        } else if centre > hi + slack {
            (bend, (hi - u[e]) / bend)
        } else {
            (bend, 1.0)
        }
    };
    (0..u.len()).into_par_iter().map(limit).collect()
}

/// The least squares of the module page, in a frame (u, v) of the element.
struct Slope {
    frame: (DVec3, DVec3),
    /// Σ d dᵀ/|d|²: entries uu, uv and vv.
    matrix: (f64, f64, f64),
    /// Σ d Δ/|d|².
    right: (f64, f64),
}

impl Slope {
    /// From distances and differences of neighbours.
    fn new(polygon: &Polygon, steps: impl Iterator<Item = (DVec3, f64)>) -> Self {
        let (u, v) = polygon.frame();
        let mut sums = Self { frame: (u, v), matrix: (0.0, 0.0, 0.0), right: (0.0, 0.0) };
        for (d, difference) in steps {
            let (x, y, weight) = (d.dot(u), d.dot(v), d.length_squared().recip());
            sums.matrix.0 += weight * x * x;
            sums.matrix.1 += weight * x * y;
            sums.matrix.2 += weight * y * y;
            sums.right.0 += weight * x * difference;
            sums.right.1 += weight * y * difference;
        }
        sums
    }

    /// Half the sum of the eigenvalues of the matrix, and half their difference.
    fn eigenvalues(&self) -> (f64, f64) {
        let (uu, uv, vv) = self.matrix;
        (0.5 * (uu + vv), (0.5 * (uu - vv)).hypot(uv))
    }

    /// Whether the neighbours lie in more than one direction.
    fn full(&self) -> bool {
        let (half, apart) = self.eigenvalues();
        half - apart > SPREAD * half
    }

    /// g; nothing across the one direction in which all neighbours lie.
    fn slope(&self) -> DVec3 {
        let ((u, v), (uu, uv, vv), (p, q)) = (self.frame, self.matrix, self.right);
        let (half, apart) = self.eigenvalues();
        if self.full() {
            return (u * (vv * p - uv * q) + v * (uu * q - uv * p)) / (uu * vv - uv * uv);
        }
        if half == 0.0 {
            return DVec3::ZERO;
        }
        // The eigenvector of the larger eigenvalue.
        let large = half + apart;
        let (x, y) = if uu >= vv { (large - vv, uv) } else { (uv, large - uu) };
        (u * x + v * y) * ((x * p + y * q) / ((x * x + y * y) * large))
    }
}
