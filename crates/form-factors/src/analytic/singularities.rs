//! Edges, and where integrands along one edge that see another stop being analytic.

use glam::DVec3;

/// An edge from a to b with unit direction u.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    pub a: DVec3,
    pub b: DVec3,
    pub u: DVec3,
    pub length: f64,
}

impl Edge {
    /// `None` if the edge has no length.
    pub fn new(a: DVec3, b: DVec3) -> Option<Self> {
        let length = a.distance(b);
        (length > 0.0).then(|| Self { a, b, u: (b - a) / length, length })
    }
}

/// Edges of a closed loop as pairs of corners.
pub(super) fn edges(corners: &[DVec3]) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
    let n = corners.len();
    (0..n).map(move |k| (corners[k], corners[(k + 1) % n]))
}

/// Points re ± i·im at which what an edge sees of another is not analytic, in the order corner a, corner b, crossing.
///
/// With x = p + t d, the distances r_a, r_b of the corners vanish there, or the distance h from the line of the other edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct Singularities(pub [(f64, f64); 3]);

impl Singularities {
    pub fn new(edge: &Edge, other: &Edge) -> Self {
        let Edge { a: p, u: d, .. } = *edge;
        let corner = |v: DVec3| {
            let t = (v - p).dot(d);
            (t, (v - p - d * t).length())
        };
        // h² is a quadratic in t with its complex zeros where the lines come nearest.
        let normal = d.cross(other.u);
        let s2 = normal.length_squared();
        let to_a = other.a - p;
        let mut crossing = (f64::INFINITY, f64::INFINITY);
        if s2 > f64::EPSILON {
            let t = to_a.cross(other.u).dot(normal) / s2;
            let along = (p + d * t - other.a).dot(other.u);
            // Beyond the ends of the other edge all is even in h and stays analytic there.
            if along > 0.0 && along < other.length {
                crossing = (t, to_a.dot(normal).abs() / s2);
            }
        }
        Self([corner(other.a), corner(other.b), crossing])
    }

    /// Real parts inside (0, length) of those that are nearer than the length.
    pub fn borders(&self, length: f64) -> impl Iterator<Item = f64> + '_ {
        self.0.iter().filter(move |(re, im)| *re > 0.0 && *re < length && *im < length).map(|(re, _)| *re)
    }

    /// Whether [lo, hi] is more than `ratio` times as long as its distance from a singularity with an imaginary part above
    /// `least`.
    pub fn too_near(&self, lo: f64, hi: f64, ratio: f64, least: f64) -> bool {
        self.0.iter().any(|&(re, im)| {
            let beside = (lo - re).max(re - hi).max(0.0);
            im > least && ratio * beside.hypot(im) < hi - lo
        })
    }

    /// Sum of the half axes of the smallest ellipse with foci lo and hi through a singularity, by the half length: the
    /// integrand is analytic inside it.
    pub fn ellipse(&self, lo: f64, hi: f64) -> f64 {
        let reach = |&(re, im): &(f64, f64)| (im.hypot(re - lo) + im.hypot(re - hi)) / (hi - lo);
        let least = self.0.iter().map(reach).fold(f64::INFINITY, f64::min).max(1.0);
        least + (least * least - 1.0).sqrt()
    }
}
