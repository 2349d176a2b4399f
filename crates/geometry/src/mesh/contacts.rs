//! Where surfaces touch or cross: cells cut along the contact, and cells that end up inside a solid.
//!
//! The mean of a cell that is half under a box is diluted by the dark half, and the box's side next to it goes dark too;
//! with the cell cut at the contact and its inner part left out the error is gone. What is *not* here: coplanar faces
//! that look the same way (both stay), and solids whose faces look inward (nothing in them counts as covered).

use glam::DVec3;

use crate::{Occluders, Polygon};

/// An edge closer to a plane than this share of the scene's diagonal lies in it.
const CONTACT: f64 = 1e-7;

/// A cut that leaves less than this share of a cell's area is not made, nor one along less than this share of the
/// scene's diagonal.
const SLIVER: f64 = 1e-9;

/// Rays that decide whether a point is inside a solid.
const RAYS: usize = 16;

/// A segment in the plane of a face along which something touches or crosses it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Line {
    a: DVec3,
    b: DVec3,
    /// Whether something stands on the front of the face there: light differs on both sides.
    stands: bool,
}

impl Line {
    pub(super) fn new(a: DVec3, b: DVec3) -> Self {
        Self { a, b, stands: false }
    }

    /// Whether the segment p q lies on this one, within `slack`.
    fn holds(&self, p: DVec3, q: DVec3, slack: f64) -> bool {
        let (along, length) = ((self.b - self.a).normalize_or_zero(), self.a.distance(self.b));
        let off = |v: DVec3| (v - self.a - along * (v - self.a).dot(along)).length();
        let middle = (p.midpoint(q) - self.a).dot(along);
        off(p).max(off(q)) <= slack && middle >= -slack && middle <= length + slack
    }
}

/// Lines along which something stands on the front of a face: what is on one side of them does not see the other.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Partitions {
    lines: Vec<Line>,
    slack: f64,
}

impl Partitions {
    /// For the search of the line on which an edge lies.
    pub(super) fn index(&self) -> PartitionIndex<'_> {
        let bounds = |line: &Line| (line.a.min(line.b), line.a.max(line.b));
        PartitionIndex { of: self, boxes: BoxTree::new(self.lines.iter().map(bounds)) }
    }
}

/// [`Partitions`] with the boxes of their lines.
pub(super) struct PartitionIndex<'a> {
    of: &'a Partitions,
    boxes: BoxTree,
}

impl PartitionIndex<'_> {
    /// Whether something stands on the edge p q.
    pub(super) fn on(&self, p: DVec3, q: DVec3) -> bool {
        let (lines, slack) = (&self.of.lines, self.of.slack);
        let mut found = false;
        if !lines.is_empty() {
            self.boxes.visit(&Line::new(p, q), slack, &mut |k| found |= lines[k].holds(p, q, slack));
        }
        found
    }
}

/// A convex part of a face, and the finer cells that nest in it, each with its number.
///
/// A line that ends inside a part is lengthened to the part's boundary, for the cells as well, so that they go on to nest.
pub(super) struct Part {
    pub(super) polygon: Polygon,
    pub(super) cells: Vec<(usize, Polygon)>,
}

impl Part {
    /// Both sides of a line, of which the part itself is `left` and `right`.
    fn halved(self, line: &Line, left: Polygon, right: Polygon) -> [Self; 2] {
        let [mut left, mut right] = [left, right].map(|polygon| Self { polygon, cells: Vec::new() });
        let across = self.polygon.normal().cross(line.b - line.a).normalize_or_zero();
        for (number, cell) in self.cells {
            match cell.split(line.a, across, SLIVER * cell.diameter()) {
                Some((l, r)) if l.area().min(r.area()) > SLIVER * cell.area() => {
                    left.cells.push((number, l));
                    right.cells.push((number, r));
                }
                _ if (cell.centroid() - line.a).dot(across) > 0.0 => left.cells.push((number, cell)),
                _ => right.cells.push((number, cell)),
            }
        }
        [left, right]
    }
}

/// Contacts of a scene.
pub(super) struct Contacts<'a> {
    occluders: &'a Occluders,
    /// Length of the scene's diagonal.
    diagonal: f64,
}

impl<'a> Contacts<'a> {
    pub(super) fn new(occluders: &'a Occluders, diagonal: f64) -> Self {
        Self { occluders, diagonal }
    }

    /// Lines of contact on polygon k of the occluders with those of other owners.
    pub(super) fn lines(&self, k: usize) -> Vec<Line> {
        let (face, tolerance) = (&self.occluders.polygons()[k], CONTACT * self.diagonal);
        let (lo, hi) = face.bounds();
        let mut others = Vec::new();
        self.occluders.overlapping(lo - tolerance, hi + tolerance, &mut |other| {
            if self.occluders.owner(other) != self.occluders.owner(k) {
                others.push(other);
            }
        });
        others.sort_unstable(); // traversal has no order of its own
        let mut lines = Vec::new();
        for other in others {
            lines_between(face, &self.occluders.polygons()[other], tolerance, &mut lines);
        }
        lines
    }

    /// Those of some lines on which something stands.
    pub(super) fn partitions(&self, lines: &[Line]) -> Partitions {
        Partitions { lines: lines.iter().filter(|line| line.stands).copied().collect(), slack: CONTACT * self.diagonal }
    }

    /// The parts of each cell of a face, cut along the lines together with what nests in it.
    pub(super) fn cut(&self, cells: Vec<Part>, lines: &[Line]) -> Vec<Vec<Part>> {
        let boxes = BoxTree::new(cells.iter().map(|cell| cell.polygon.bounds()));
        let areas: Vec<f64> = cells.iter().map(|cell| cell.polygon.area()).collect();
        let mut parts: Vec<Vec<Part>> = cells.into_iter().map(|c| vec![c]).collect();
        for line in lines {
            boxes.visit(line, CONTACT * self.diagonal, &mut |cell| {
                let mut after = Vec::with_capacity(parts[cell].len() + 1);
                for part in parts[cell].drain(..) {
                    match self.split(&part.polygon, line, areas[cell]) {
                        Some((left, right)) => after.extend(part.halved(line, left, right)),
                        None => after.push(part),
                    }
                }
                parts[cell] = after;
            });
        }
        parts
    }

    /// Both sides of a line that passes through a part of a cell of the given area.
    fn split(&self, part: &Polygon, line: &Line, cell: f64) -> Option<(Polygon, Polygon)> {
        let length = line.a.distance(line.b);
        let along = (line.b - line.a) / length;
        let across = part.normal().cross(along).try_normalize()?;
        let snap = SLIVER * part.diameter();
        // Where the polygon's boundary meets the line, measured along it.
        let (mut near, mut far) = (f64::INFINITY, f64::NEG_INFINITY);
        for (a, b) in part.edges() {
            let (da, db) = ((a - line.a).dot(across), (b - line.a).dot(across));
            if da.abs() <= snap || (da > 0.0) != (db > 0.0) {
                let at = if da.abs() <= snap { a } else { a + (b - a) * (da / (da - db)) };
                let s = (at - line.a).dot(along);
                (near, far) = (near.min(s), far.max(s));
            }
        }
        // A line that ends on the boundary, to rounding, only touches.
        if far.min(length) - near.max(0.0) <= SLIVER * self.diagonal.min(far - near) {
            return None;
        }
        let (left, right) = part.split(line.a, across, snap)?;
        (left.area().min(right.area()) > SLIVER * cell).then_some((left, right))
    }

    /// Whether a polygon lies inside a solid: from its centroid and three more points every one of 16 fixed rays over
    /// the front hemisphere ends on the back of a face.
    pub(super) fn covered(&self, polygon: &Polygon) -> bool {
        let (u, v) = polygon.frame();
        let (n, vertices, centre) = (polygon.normal(), polygon.vertices(), polygon.centroid());
        let points = [0, vertices.len() / 3, 2 * vertices.len() / 3].map(|k| centre.lerp(vertices[k], 0.6));
        [centre].iter().chain(&points).all(|&point| {
            (0..RAYS).all(|k| {
                // A golden spiral: generic angles, so that no ray follows an edge of a rectangular scene.
                let height = 0.07 + 0.88 * (k as f64 + 0.5) / RAYS as f64;
                let (sin, cos) = (2.399_963_229_728_653 * k as f64 + 0.7).sin_cos();
                let side = (1.0 - height * height).sqrt();
                let direction = u * (side * cos) + v * (side * sin) + n * height;
                self.occluders.first_hit(point, direction).is_some_and(|hit| !hit.front)
            })
        })
    }
}

/// Edges of `other` in the plane of `face`, and the segment in which `other` crosses it.
fn lines_between(face: &Polygon, other: &Polygon, tolerance: f64, lines: &mut Vec<Line>) {
    let n = other.vertices().len();
    let d: Vec<f64> = other.vertices().iter().map(|v| face.signed_distance(*v)).collect();
    let side = |k: usize| if d[k].abs() <= tolerance { 0 } else { d[k].signum() as i32 };
    if (0..n).all(|k| side(k) > 0) || (0..n).all(|k| side(k) < 0) {
        return;
    }
    let stands = (0..n).any(|k| side(k) > 0);
    let mut push = |a: DVec3, b: DVec3| {
        if a.distance(b) > tolerance {
            lines.push(Line { a, b, stands });
        }
    };
    let mut crossings: Vec<DVec3> = Vec::new();
    for (k, (a, b)) in other.edges().enumerate() {
        let next = (k + 1) % n;
        match (side(k), side(next)) {
            (0, 0) => push(a - face.normal() * d[k], b - face.normal() * d[next]),
            (0, _) => crossings.push(a),
            (p, q) if p * q < 0 => crossings.push(a + (b - a) * (d[k] / (d[k] - d[next]))),
            _ => {}
        }
    }
    if stands && (0..n).any(|k| side(k) < 0) {
        // The two crossings furthest apart: rounding may leave more than two near a vertex.
        let pairs = crossings.iter().enumerate().flat_map(|(k, a)| crossings[..k].iter().map(move |b| (*a, *b)));
        if let Some((a, b)) = pairs.max_by(|p, q| p.0.distance(p.1).total_cmp(&q.0.distance(q.1))) {
            push(a, b);
        }
    }
}

/// Boxes of cells in pairs, pairs of pairs and so on: neighbours in the list are neighbours in space.
pub(super) struct BoxTree {
    levels: Vec<Vec<(DVec3, DVec3)>>,
}

impl BoxTree {
    pub(super) fn new(cells: impl Iterator<Item = (DVec3, DVec3)>) -> Self {
        let mut levels = vec![cells.collect::<Vec<_>>()];
        while levels[levels.len() - 1].len() > 1 {
            let union = |pair: &[(DVec3, DVec3)]| pair.iter().copied().reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
            let next = levels[levels.len() - 1].chunks(2).filter_map(union).collect();
            levels.push(next);
        }
        Self { levels }
    }

    /// Calls `found` with every cell whose box, grown by `slack`, meets the line.
    pub(super) fn visit(&self, line: &Line, slack: f64, found: &mut dyn FnMut(usize)) {
        let mut stack = vec![(self.levels.len() - 1, 0)];
        while let Some((level, k)) = stack.pop() {
            let Some(&(lo, hi)) = self.levels[level].get(k) else { continue };
            if !meets(line, lo - slack, hi + slack) {
                continue;
            }
            if level == 0 {
                found(k);
            } else {
                stack.extend([(level - 1, 2 * k + 1), (level - 1, 2 * k)]);
            }
        }
    }
}

/// Whether a segment meets a box (slabs).
fn meets(line: &Line, lo: DVec3, hi: DVec3) -> bool {
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    for k in 0..3 {
        let d = line.b[k] - line.a[k];
        if d == 0.0 {
            if line.a[k] < lo[k] || line.a[k] > hi[k] {
                return false;
            }
        } else {
            let (s, t) = ((lo[k] - line.a[k]) / d, (hi[k] - line.a[k]) / d);
            (enter, leave) = (enter.max(s.min(t)), leave.min(s.max(t)));
        }
    }
    enter <= leave
}
