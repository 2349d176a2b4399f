//! Blockers as seen from one side of a pair: its frame, the faces cut to what lies between, and the loops that bound their shadows.

use glam::{DVec2, DVec3};

use super::super::pair::{FacingPair, rounding};
use super::bodies::{Bodies, loops};
use radiosity_geometry::{Occluders, Polygon};

/// Coordinates in which the polygon that carries the points lies in the plane z = 0, seeing z > 0, and the pair has a size of about 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    origin: DVec3,
    axes: [DVec3; 3],
    /// Scene length of a unit: a power of two.
    pub unit: f64,
}

impl Frame {
    /// The frame of a loop with normal `n`, in which `other` is to lie as well.
    fn new(carrier: &[DVec3], n: DVec3, other: &[DVec3]) -> Self {
        let origin = carrier[0];
        let longest = carrier.iter().chain(other).map(|v| v.distance(origin)).fold(0.0, f64::max);
        let u = (1..carrier.len())
            .map(|k| carrier[k] - origin)
            .max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))
            .map_or(DVec3::X, |e| (e - n * e.dot(n)).normalize_or(n.any_orthonormal_vector()));
        Self { origin, axes: [u, n.cross(u), n], unit: longest.log2().ceil().exp2() }
    }

    fn local(&self, p: DVec3) -> DVec3 {
        self.turn(p - self.origin) / self.unit
    }

    fn turn(&self, d: DVec3) -> DVec3 {
        DVec3::from_array(self.axes.map(|axis| d.dot(axis)))
    }
}

/// A plane n·x = at.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    pub n: DVec3,
    pub at: f64,
}

impl Plane {
    fn through(p: DVec3, n: DVec3) -> Self {
        Self { n, at: n.dot(p) }
    }

    /// Height over the plane of the point (x, y, 0).
    pub fn height(&self, p: DVec2) -> f64 {
        self.n.truncate().dot(p) - self.at
    }
}

/// A blocking polygon, cut to what lies in front of both polygons of the pair.
#[derive(Clone, Debug)]
struct Face {
    corners: Vec<DVec3>,
    plane: Plane,
}

/// Blockers that hide together.
#[derive(Clone, Debug)]
enum Unit {
    Single(Face),
    Body { faces: Vec<Face>, holes: Vec<Plane> },
}

/// A pair with its blockers in the frame of the polygon that carries the points.
#[derive(Clone, Debug)]
pub(super) struct View {
    pub frame: Frame,
    /// The polygon that carries the points.
    pub carrier: Vec<DVec2>,
    /// The other one, counter-clockwise as seen by the first.
    pub receiver: Vec<DVec3>,
    /// Lengths that rounding makes.
    pub slack: f64,
    units: Vec<Unit>,
}

impl View {
    /// Looks from i at j, or from j at i if `swapped`.
    pub fn new(pair: &FacingPair, swapped: bool, occluders: &Occluders, bodies: &Bodies, blockers: &[usize]) -> Self {
        let (carrier, n, other, n_other) =
            if swapped { (&pair.j, pair.n_j, &pair.i, pair.n_i) } else { (&pair.i, pair.n_i, &pair.j, pair.n_j) };
        let frame = Frame::new(carrier, n, other);
        let receiver: Vec<DVec3> = other.iter().map(|v| frame.local(*v)).collect();
        let front = Plane::through(receiver[0], frame.turn(n_other));
        let slack = blockers
            .iter()
            .map(|&k| rounding(occluders.polygons()[k].vertices()) + 2.0 * occluders.polygons()[k].thickness())
            .fold(pair.slack, f64::max)
            / frame.unit;
        let carrier: Vec<DVec2> = carrier.iter().map(|v| frame.local(*v).truncate()).collect();
        let place = |v: DVec3| frame.local(v - pair.origin);
        let plane = |polygon: &Polygon| Plane::through(place(polygon.vertices()[0]), frame.turn(polygon.normal()));
        let face = |polygon: &Polygon| {
            let local = polygon.vertices().iter().map(|v| place(*v)).collect();
            let corners = cut(cut(local, Plane { n: DVec3::Z, at: 0.0 }, slack), front, slack);
            Face { corners, plane: plane(polygon) }
        };
        let (mut units, mut done) = (Vec::with_capacity(blockers.len()), Vec::new());
        for &k in blockers {
            match bodies.of(k) {
                Some(b) if done.contains(&b) => {}
                Some(b) => {
                    done.push(b);
                    let body = bodies.body(b);
                    let polygons = || body.faces.iter().map(|&k| &occluders.polygons()[k]);
                    let all = |plane: Plane, side: &dyn Fn(f64) -> bool| carrier.iter().all(|p| side(plane.height(*p)));
                    let holes: Vec<Plane> =
                        body.holes.iter().map(|(p, n)| Plane::through(place(*p), frame.turn(*n))).collect();
                    // From outside, and on the inner side of the holes, the back faces add nothing.
                    let outside = holes.iter().all(|hole| all(*hole, &|h| h <= slack))
                        && polygons().any(|p| all(plane(p), &|h| h >= -slack));
                    let seen = polygons().filter(|p| !(outside && all(plane(p), &|h| h <= slack)));
                    units.push(Unit::Body { faces: seen.map(face).collect(), holes });
                }
                None => units.push(Unit::Single(face(&occluders.polygons()[k]))),
            }
        }
        Self { frame, carrier, receiver, slack, units }
    }

    /// The planes of all blockers: a blocker turns its other side where the carrier crosses one.
    pub fn planes(&self) -> impl Iterator<Item = Plane> + '_ {
        self.units
            .iter()
            .flat_map(|unit| match unit {
                Unit::Single(face) => std::slice::from_ref(face),
                Unit::Body { faces, .. } => faces.as_slice(),
            })
            .filter(|face| face.corners.len() > 2)
            .map(|face| face.plane)
    }

    /// The loops that bound the shadows, counter-clockwise as seen from `part` of the carrier, which crosses none of [`Self::planes`].
    pub fn shades(&self, part: &[DVec2]) -> Vec<Vec<DVec3>> {
        let middle = part.iter().sum::<DVec2>() / part.len() as f64;
        let mut shades = Vec::with_capacity(self.units.len());
        for unit in &self.units {
            match unit {
                Unit::Single(face) => shades.extend(self.facing(face, middle)),
                Unit::Body { faces, holes } => {
                    let inside = holes.iter().all(|hole| part.iter().all(|p| hole.height(*p) <= self.slack));
                    let fronts: Vec<&Face> =
                        faces.iter().filter(|f| f.plane.height(middle) > self.slack && f.corners.len() > 2).collect();
                    // From within the body every face shows its back, and hides what lies outside.
                    let outside = faces.iter().any(|f| f.plane.height(middle) > self.slack);
                    if !(inside && outside) {
                        shades.extend(faces.iter().filter_map(|face| self.facing(face, middle)));
                    } else if let Some(outline) = outline(&fronts) {
                        shades.extend(self.tidy(outline));
                    } else {
                        shades.extend(fronts.into_iter().filter_map(|face| self.facing(face, middle)));
                    }
                }
            }
        }
        shades
    }

    /// A face as seen from a point, whichever side that is; nothing if it is seen edge-on.
    fn facing(&self, face: &Face, point: DVec2) -> Option<Vec<DVec3>> {
        let height = face.plane.height(point);
        if face.corners.len() < 3 || height.abs() <= self.slack {
            return None;
        }
        let mut corners = face.corners.clone();
        if height < 0.0 {
            corners.reverse();
        }
        self.tidy(corners)
    }

    /// The loop without edges that are mere rounding.
    fn tidy(&self, mut corners: Vec<DVec3>) -> Option<Vec<DVec3>> {
        corners.dedup_by(|b, a| a.distance_squared(*b) <= self.slack * self.slack);
        while corners.len() > 1 && corners[0].distance_squared(corners[corners.len() - 1]) <= self.slack * self.slack {
            corners.pop();
        }
        (corners.len() > 2).then_some(corners)
    }
}

/// The outline of faces that share edges, if it is one loop.
fn outline(faces: &[&Face]) -> Option<Vec<DVec3>> {
    if let [face] = faces {
        return Some(face.corners.clone());
    }
    let edges: Vec<(DVec3, DVec3)> = faces
        .iter()
        .flat_map(|f| (0..f.corners.len()).map(move |k| (f.corners[k], f.corners[(k + 1) % f.corners.len()])))
        .collect();
    let outer: Vec<(DVec3, DVec3)> =
        edges.iter().copied().filter(|(a, b)| !edges.iter().any(|(p, q)| p == b && q == a)).collect();
    let mut loops = loops(&outer)?;
    (loops.len() == 1).then(|| loops.swap_remove(0))
}

/// The part of a loop in front of a plane; corners within `slack` of it count as on it. The new corners of an edge are the same from both sides.
fn cut(corners: Vec<DVec3>, plane: Plane, slack: f64) -> Vec<DVec3> {
    let height = |v: DVec3| {
        let h = v.dot(plane.n) - plane.at;
        if h.abs() <= slack { 0.0 } else { h }
    };
    if corners.iter().all(|v| height(*v) >= 0.0) && corners.iter().any(|v| height(*v) > 0.0) {
        return corners;
    }
    let mut kept = Vec::with_capacity(corners.len() + 2);
    if corners.iter().all(|v| height(*v) <= 0.0) {
        return kept;
    }
    for k in 0..corners.len() {
        let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
        let (h_a, h_b) = (height(a), height(b));
        if h_a >= 0.0 {
            kept.push(a);
        }
        if h_a * h_b < 0.0 {
            let (p, q, h_p, h_q) = if h_a > 0.0 { (a, b, h_a, h_b) } else { (b, a, h_b, h_a) };
            kept.push(p + (q - p) * (h_p / (h_p - h_q)));
        }
    }
    kept
}
