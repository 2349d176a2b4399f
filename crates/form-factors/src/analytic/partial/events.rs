//! Where the hidden part of the receiver changes its shape: the visibility events of a pair, and the parts of the carrier between them.
//!
//! As a point x moves over the carrier, the outline of what is hidden from it stays made of the same edges until a corner of one loop
//! is seen on an edge of another: x is then on the plane through both, so in a straight line on the carrier. Only the segment of that
//! line counts from which the corner is seen on the edge and not on its extension: the projection of the edge through the corner.
//! Between such segments the hidden form factor is analytic. Edges of three loops that are seen in one point make curves; they occur
//! where shadows overlap, and are left to the adaptive rule.

use glam::{DVec2, DVec3};

use super::lanes::{Arcs, Clip};
use super::shade::{Plane, View};

/// Overlapping shadows are joined by inclusion and exclusion up to so many terms.
const MAX_TERMS: usize = 31;

/// Share of the least width of a part within which corners are moved to a line.
const NEEDLE: f64 = 1e-3;

/// An edge of one loop and the heights c + s·x + t·y of the corners of another over the plane through (x, y, 0) and the edge.
#[derive(Clone, Debug)]
struct Cut {
    edge: usize,
    heights: Vec<[f64; 3]>,
    /// Heights that rounding makes.
    slack: f64,
}

/// How the edges of a loop lie to the cone of another with which it has something in common, from a part of the carrier.
#[derive(Clone, Debug, Default)]
struct Overlap {
    /// Edges that cut the other; none if the other is inside.
    cuts: Vec<Cut>,
    /// Edges on which, seen from everywhere, an edge of the other lies, on the same side of both loops.
    flush: Vec<usize>,
}

/// What the carrier sees from a part of it that no plane of a blocker crosses.
pub(super) struct Region {
    /// The receiver, then the loops of the shadows.
    loops: Vec<Vec<DVec3>>,
    /// overlaps[a][b]: how the edges of loop a lie to loop b; `None` if the two have nothing in common.
    overlaps: Vec<Vec<Option<Overlap>>>,
    /// Whether one shadow covers the receiver.
    covered: bool,
    /// Sums to the hidden form factor.
    pub hidden: Arcs,
    /// Groups of overlapping shadows that are too many for inclusion and exclusion.
    pub crowds: Vec<Vec<Vec<DVec3>>>,
}

/// What is seen from a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sight {
    /// All of the receiver.
    Clear,
    /// Nothing.
    Hidden,
    /// A part of it, perhaps.
    Partial,
}

fn next(corners: &[DVec3], k: usize) -> DVec3 {
    corners[if k + 1 == corners.len() { 0 } else { k + 1 }]
}

/// det(q − x, p − x, b − x) of an edge p q and a corner b, linear in x = (s, t, 0): positive inside the edge.
fn height(p: DVec3, q: DVec3, b: DVec3) -> [f64; 3] {
    let n = (q - b).cross(p - b);
    [n.dot(b), -n.x, -n.y]
}

fn at(h: &[f64; 3], x: DVec2) -> f64 {
    h[0] + h[1] * x.x + h[2] * x.y
}

/// How the edges of loop a lie to loop b; `None` if one of them has all of b outside.
fn overlap(a: &[DVec3], b: &[DVec3], part: &[DVec2], slack: f64) -> Option<Overlap> {
    let mut found = Overlap::default();
    for edge in 0..a.len() {
        let (p, q) = (a[edge], next(a, edge));
        let slack = 8.0 * slack * p.distance(q);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        // Whether the last corner lies on the edge's plane, and whether two in a row do.
        let on = |range: (f64, f64)| range.0 >= -slack && range.1 <= slack;
        let range = |b: DVec3| {
            let h = height(p, q, b);
            part.iter().map(|x| at(&h, *x)).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, u), h| (l.min(h), u.max(h)))
        };
        let (mut before, mut flush) = (on(range(b[b.len() - 1])), false);
        for b in b {
            let range = range(*b);
            (low, high) = (low.min(range.0), high.max(range.1));
            flush |= before && on(range);
            before = on(range);
        }
        if high <= slack {
            return None;
        }
        if low < -slack {
            found.cuts.push(Cut { edge, heights: b.iter().map(|b| height(p, q, *b)).collect(), slack });
        } else if flush {
            found.flush.push(edge);
        }
    }
    Some(found)
}

impl Region {
    /// Sets up what is seen from a part of the carrier.
    pub fn new(view: &View, part: &[DVec2]) -> Self {
        let mut region = Self {
            loops: vec![view.receiver.clone()],
            overlaps: vec![vec![None]],
            covered: false,
            hidden: Arcs::default(),
            crowds: Vec::new(),
        };
        for shade in view.shades(part) {
            region.insert(shade, part, view.slack);
            if region.covered {
                return region;
            }
        }
        region.sum();
        region
    }

    /// Adds a shadow unless it misses the receiver or lies in another one; takes out those that lie in it.
    fn insert(&mut self, shade: Vec<DVec3>, part: &[DVec2], slack: f64) {
        let (mut over, mut under, mut inner) = (Vec::new(), Vec::new(), Vec::new());
        for (k, other) in self.loops.iter().enumerate() {
            let overlaps = (overlap(&shade, other, part, slack), overlap(other, &shade, part, slack));
            let (Some(mine), Some(its)) = overlaps else {
                if k == 0 {
                    return;
                }
                over.push(None);
                under.push(None);
                continue;
            };
            match (k, mine.cuts.is_empty(), its.cuts.is_empty()) {
                (0, true, _) => {
                    self.covered = true;
                    return;
                }
                (0, ..) => {}
                (_, _, true) => return,
                (_, true, _) => inner.push(k),
                _ => {}
            }
            over.push(Some(mine));
            under.push(Some(its));
        }
        over.push(None);
        for (row, under) in self.overlaps.iter_mut().zip(under) {
            row.push(under);
        }
        self.overlaps.push(over);
        self.loops.push(shade);
        for &k in inner.iter().rev() {
            self.loops.remove(k);
            self.overlaps.remove(k);
            self.overlaps.iter_mut().for_each(|row| {
                row.remove(k);
            });
        }
    }

    /// Hidden form factor = Σ over sets of overlapping shadows of ± what all of the set hide.
    fn sum(&mut self) {
        let mut grouped = vec![false; self.loops.len()];
        for first in 1..self.loops.len() {
            if std::mem::replace(&mut grouped[first], true) {
                continue;
            }
            let (mut group, mut k) = (vec![first], 0);
            while k < group.len() {
                for (other, grouped) in grouped.iter_mut().enumerate().skip(1) {
                    if !*grouped && self.overlaps[group[k]][other].is_some() {
                        *grouped = true;
                        group.push(other);
                    }
                }
                k += 1;
            }
            match self.cliques(&group) {
                Some(cliques) => cliques.iter().for_each(|clique| self.intersect(clique)),
                None => self.crowds.push(group.iter().map(|&k| self.loops[k].clone()).collect()),
            }
        }
    }

    /// Sets of shadows of a group that overlap pairwise, each with the receiver in front; `None` if they are too many.
    fn cliques(&self, group: &[usize]) -> Option<Vec<Vec<usize>>> {
        let mut sets: Vec<Vec<usize>> = Vec::new();
        for &k in group {
            for known in 0..sets.len() {
                if sets[known][1..].iter().all(|&other| self.overlaps[other][k].is_some()) {
                    let mut set = sets[known].clone();
                    set.push(k);
                    sets.push(set);
                }
            }
            sets.push(vec![0, k]);
            if sets.len() > MAX_TERMS {
                return None;
            }
        }
        Some(sets)
    }

    /// Adds the arcs around what a set of loops, the receiver among them, have in common.
    fn intersect(&mut self, set: &[usize]) {
        let weight = if set.len().is_multiple_of(2) { 1.0 } else { -1.0 };
        for &a in set {
            let others = || set.iter().copied().filter(move |&b| b != a);
            for edge in 0..self.loops[a].len() {
                // An edge that does not cut another loop runs outside of it, or on its border: there the first of the two counts.
                let bounds = |b: usize| {
                    let overlap = self.overlaps[a][b].as_ref();
                    overlap.is_some_and(|o| {
                        o.cuts.iter().any(|cut| cut.edge == edge) || (a < b && o.flush.contains(&edge))
                    })
                };
                if !others().all(bounds) {
                    continue;
                }
                let end = if edge + 1 == self.loops[a].len() { 0 } else { edge + 1 };
                let clips = others().flat_map(|b| cuts(&self.overlaps[b][a]));
                let clips = clips.map(|cut| -> Clip { [cut.heights[edge], cut.heights[end]] });
                self.hidden.push(self.loops[a][edge], self.loops[a][end], weight, clips);
            }
        }
    }

    /// The part cut along the events in it; events that only come within `snap` of a border are left out, and those after `most` parts
    /// are left to the adaptive rule.
    pub fn split(&self, part: Vec<DVec2>, snap: f64, most: usize) -> Vec<Vec<DVec2>> {
        let mut parts = vec![part];
        if self.covered {
            return parts;
        }
        for (a, row) in self.overlaps.iter().enumerate() {
            for (b, overlap) in row.iter().enumerate() {
                for cut in cuts(overlap) {
                    let (p, q) = (self.loops[a][cut.edge], next(&self.loops[a], cut.edge));
                    for (v, h) in self.loops[b].iter().zip(&cut.heights) {
                        if let Some(event) = Event::new(p, q, *v, h) {
                            event.split(&mut parts, snap, most);
                        }
                    }
                }
            }
        }
        parts
    }

    /// Shadows that the receiver is cut by one after another.
    pub fn crowded(&self) -> u64 {
        self.crowds.iter().map(Vec::len).sum::<usize>() as u64
    }

    /// What is seen from a convex cell of the carrier.
    pub fn sight(&self, cell: &[DVec2]) -> Sight {
        if self.covered {
            return Sight::Hidden;
        }
        let mut sight = Sight::Clear;
        for a in 1..self.loops.len() {
            let (over, under) = (&self.overlaps[a][0], &self.overlaps[0][a]);
            let heights = |cut: &Cut| {
                cell.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |range, x| {
                    let h = cut.heights.iter().map(|h| at(h, *x));
                    h.fold(range, |(low, high), h| (low.min(h), high.max(h)))
                })
            };
            let (mut apart, mut covers) = (false, true);
            for cut in cuts(over) {
                let (low, high) = heights(cut);
                apart |= high <= cut.slack;
                covers &= low >= -cut.slack;
            }
            if covers {
                return Sight::Hidden;
            }
            if !(apart || cuts(under).any(|cut| heights(cut).1 <= cut.slack)) {
                sight = Sight::Partial;
            }
        }
        sight
    }
}

fn cuts(overlap: &Option<Overlap>) -> impl Iterator<Item = &Cut> {
    overlap.iter().flat_map(|overlap| &overlap.cuts)
}

/// A segment or a line on the carrier: c + s·x + t·y = 0.
struct Event {
    /// Divided by the length of (s, t), so that its values are distances.
    line: [f64; 3],
    /// The part that is real; `None` for all of the line.
    ends: Option<[DVec2; 2]>,
}

impl Event {
    /// The points that see the corner `v` and the edge p q in one place.
    fn new(p: DVec3, q: DVec3, v: DVec3, h: &[f64; 3]) -> Option<Self> {
        let slope = h[1].hypot(h[2]);
        let line = h.map(|c| c / slope);
        if !line.iter().all(|c| c.is_finite()) {
            return None;
        }
        // Where the line through the corner and a point of the edge meets the carrier.
        let project = |y: DVec3| (y.truncate() * v.z - v.truncate() * y.z) / (v.z - y.z);
        let ends = ((v.z - p.z) * (v.z - q.z) > 0.0).then(|| [project(p), project(q)]);
        Some(Self { line, ends })
    }

    /// Cuts the parts that it crosses, while they are fewer than `most`.
    fn split(&self, parts: &mut Vec<Vec<DVec2>>, snap: f64, most: usize) {
        for k in 0..parts.len() {
            if parts.len() >= most {
                return;
            }
            let cut = split(&parts[k], &self.line, snap);
            if let Some((front, back)) = cut.filter(|_| self.ends.is_none_or(|ends| crosses(&parts[k], ends, snap))) {
                parts[k] = front;
                parts.push(back);
            }
        }
    }
}

/// The parts of a convex loop on both sides of a line, if none is narrower than `snap`.
fn split(part: &[DVec2], line: &[f64; 3], snap: f64) -> Option<(Vec<DVec2>, Vec<DVec2>)> {
    let (low, high) = part.iter().map(|x| at(line, *x)).fold((0.0, 0.0), |(a, b): (f64, f64), d| (a.min(d), b.max(d)));
    if low >= -snap || high <= snap {
        return None;
    }
    let (mut front, mut back) = (Vec::with_capacity(part.len() + 2), Vec::with_capacity(part.len() + 2));
    // A corner next to the line counts as on it: no needles.
    let distance = |x: DVec2| {
        let d = at(line, x);
        if d.abs() <= NEEDLE * snap { 0.0 } else { d }
    };
    for k in 0..part.len() {
        let (a, b) = (part[k], part[(k + 1) % part.len()]);
        let (d_a, d_b) = (distance(a), distance(b));
        if d_a >= 0.0 {
            front.push(a);
        }
        if d_a <= 0.0 {
            back.push(a);
        }
        if d_a * d_b < 0.0 {
            let meet = a + (b - a) * (d_a / (d_a - d_b));
            front.push(meet);
            back.push(meet);
        }
    }
    Some((front, back))
}

/// Whether more than `snap` of a segment lies inside a convex loop, counter-clockwise.
fn crosses(part: &[DVec2], [p, q]: [DVec2; 2], snap: f64) -> bool {
    let (mut begin, mut end) = (0.0_f64, 1.0_f64);
    for k in 0..part.len() {
        let (a, b) = (part[k], part[(k + 1) % part.len()]);
        let side = |x: DVec2| (b - a).perp_dot(x - a);
        let (h_p, h_q) = (side(p), side(q));
        if h_p < 0.0 && h_q < 0.0 {
            return false;
        }
        if h_p < 0.0 {
            begin = begin.max(h_p / (h_p - h_q));
        } else if h_q < 0.0 {
            end = end.min(h_p / (h_p - h_q));
        }
    }
    (end - begin) * p.distance(q) > snap
}

/// The carrier cut along the planes of its blockers.
pub(super) fn cut_at_planes(view: &View, snap: f64) -> Vec<Vec<DVec2>> {
    let mut parts = vec![view.carrier.clone()];
    for Plane { n, at } in view.planes() {
        let slope = n.x.hypot(n.y);
        // A plane along the carrier's own leaves no line on it.
        if slope > view.slack {
            let line = [-at / slope, n.x / slope, n.y / slope];
            Event { line, ends: None }.split(&mut parts, snap, usize::MAX);
        }
    }
    parts
}
