//! Rooms that do not see each other, proven by closed shells.
//!
//! A *shell* is a set of faces that closes a volume: at each of its edges every face meets the next one that is seen from its front, vertex on
//! vertex to the last bit, and nothing is left open. Every segment between a point inside and a point outside crosses it, and both
//! sides of a face block, so that
//!
//! ```text
//! i inside a shell and j not  ⇒  F_ij = 0.
//! ```
//!
//! Faces whose fronts lie inside the same shells are a room. In a room without an emitter everything is 0.
//!
//! *Shells*: at an edge of several faces, a face is joined with the first that one meets turning about the edge from its front, if that runs along
//! the edge the other way and the two choose each other. Components without an edge left over are closed; those whose fronts face
//! inward (their signed volume tells) are candidates. *Inside*: a ray from the centroid of a face into its front crosses the shell an odd number of
//! times. A crossing near an edge decides nothing, and another direction is taken. *Whole faces*: a face that
//! properly crosses one of the shell, or may do so along an edge, lies on both sides; then that shell proves nothing, and neither does one in which
//! some of its own faces are not inside. Where vertices do not match (a wall whose neighbour is cut elsewhere) nothing is
//! proven and nothing left out. (Polyhedra from faces: J. O'Rourke, Computational Geometry in C, 1998, ch. 7 for the parity of crossings.)
//!
//! What is *not* here: surfaces that one polygon hides from each other without a shell between, and walls that meet in a T, where a vertex of one
//! lies inside an edge of another. Whether it lies there is a matter of rounding, and so is whether a ray slips through the slit: only edges that two faces share bit for bit are tight to the
//! estimators. So F between such rooms is not 0 to the last bit, and leaving it out would not be exact. Cut at that vertex the longer edge matches.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use glam::DVec3;
use radiosity_geometry::{Occluders, Polygon, Scene};

/// Share of the scene's diagonal within which a crossing is too near an edge to count.
const NEAR: f64 = 1e-9;
/// Share of the scene's cubed diagonal below which a shell encloses nothing.
const FLAT: f64 = 1e-12;
/// Directions tried from a face, along its frame and its normal.
const DIRECTIONS: [[f64; 3]; 4] = [[0.0, 0.0, 1.0], [0.31, 0.17, 1.0], [-0.23, 0.41, 1.0], [0.13, -0.37, 1.0]];

/// The room of every surface, numbered in the order in which they occur; `None` if none is proven or the scene is too large to look.
///
/// `most` bounds the pairs of faces that meet at edges of more than two, and those of faces of shells and faces near them, that may be looked at.
pub(super) fn rooms(scene: &Scene, most: u64) -> Option<Vec<u32>> {
    let pieces: Vec<(usize, &Polygon)> = scene.pieces().collect();
    let faces: Vec<&Polygon> = pieces.iter().map(|(_, face)| *face).collect();
    let diagonal = scene.diagonal();
    let shells = shells(&faces, diagonal, most)?;
    let rounding = Occluders::rounding(scene);
    // Faces beside the box of a shell are told by it, sixteen for the price of one look at a face of the shell.
    let bounds: Vec<(DVec3, DVec3)> = faces.iter().map(|face| face.bounds()).collect();
    let looks = |shell: &Vec<usize>| {
        let (low, high) = common_bounds(shell.iter().map(|&face| bounds[face]));
        let meets = |(l, h): &&(DVec3, DVec3)| l.cmple(high).all() && h.cmpge(low).all();
        shell.len() as u64 * bounds.iter().filter(meets).count() as u64 + faces.len() as u64 / 16
    };
    // Where even boxes are too many to look at, they are not.
    let boxes = (shells.len() * faces.len()) as u64 / 16;
    if shells.is_empty() || boxes > most || shells.iter().map(looks).sum::<u64>() > most {
        return None;
    }
    // Inside which shells each face lies, of those that separate at all.
    let mut inside: Vec<Vec<bool>> = vec![Vec::new(); faces.len()];
    for shell in &shells {
        if let Some(of_faces) = (Shell { faces: &faces, of: shell, rounding, near: NEAR * diagonal }).contains() {
            inside.iter_mut().zip(of_faces).for_each(|(all, is)| all.push(is));
        }
    }
    Some(numbered(scene.surfaces.len(), &pieces, &inside))
}

/// The box around boxes.
fn common_bounds(boxes: impl Iterator<Item = (DVec3, DVec3)>) -> (DVec3, DVec3) {
    boxes.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), (l, h)| (low.min(l), high.max(h)))
}

/// Rooms of surfaces: those of faces, joined where one surface has faces in several.
fn numbered(surfaces: usize, pieces: &[(usize, &Polygon)], inside: &[Vec<bool>]) -> Vec<u32> {
    let mut of_signature: HashMap<&[bool], u32> = HashMap::new();
    let mut own = vec![u32::MAX; surfaces];
    let mut joined = Sets::new(pieces.len());
    for ((s, _), signature) in pieces.iter().zip(inside) {
        let next = of_signature.len() as u32;
        let room = *of_signature.entry(signature).or_insert(next);
        match own[*s] {
            u32::MAX => own[*s] = room,
            other => joined.join(other as usize, room as usize),
        }
    }
    // A surface without faces is in the first room: it does nothing anywhere.
    let mut names: HashMap<usize, u32> = HashMap::new();
    own.iter()
        .map(|&room| {
            let root = joined.root(if room == u32::MAX { 0 } else { room as usize });
            let next = names.len() as u32;
            *names.entry(root).or_insert(next)
        })
        .collect()
}

/// Disjoint sets.
struct Sets {
    parent: Vec<usize>,
}

impl Sets {
    fn new(count: usize) -> Self {
        Self { parent: (0..count).collect() }
    }

    fn root(&mut self, mut k: usize) -> usize {
        while self.parent[k] != k {
            self.parent[k] = self.parent[self.parent[k]];
            k = self.parent[k];
        }
        k
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b)] = a.min(b);
    }
}

/// A face at an edge, which it runs along forward or backward.
#[derive(Clone, Copy)]
struct Side {
    face: usize,
    forward: bool,
}

/// Closed shells of faces whose fronts face inward, each a list of faces; `None` if more than `most` pairs of faces meet at edges of more than two.
fn shells(faces: &[&Polygon], diagonal: f64, most: u64) -> Option<Vec<Vec<usize>>> {
    // Faces at every edge between two vertices that are equal to the last bit.
    let mut vertices: HashMap<[u64; 3], u32> = HashMap::new();
    let mut number = |v: DVec3| {
        let next = vertices.len() as u32;
        *vertices.entry((v + 0.0).to_array().map(f64::to_bits)).or_insert(next)
    };
    let mut places: HashMap<(u32, u32), usize> = HashMap::new();
    let mut edges: Vec<(DVec3, Vec<Side>)> = Vec::new();
    for (face, polygon) in faces.iter().enumerate() {
        for (a, b) in polygon.edges() {
            let (from, to) = (number(a), number(b));
            let (key, along) = if from < to { ((from, to), b - a) } else { ((to, from), a - b) };
            let place = match places.entry(key) {
                Entry::Occupied(place) => *place.get(),
                Entry::Vacant(place) => {
                    edges.push((along.normalize_or_zero(), Vec::new()));
                    *place.insert(edges.len() - 1)
                }
            };
            edges[place].1.push(Side { face, forward: from < to });
        }
    }
    let crowded = edges.iter().map(|(_, sides)| sides.len() as u64).filter(|&sides| sides > 2);
    if crowded.map(|sides| sides.saturating_mul(sides)).fold(0, u64::saturating_add) > most {
        return None;
    }
    // Neighbours seen from the front, and faces with an edge that has none.
    let mut joined = Sets::new(faces.len());
    let mut open = vec![false; faces.len()];
    for (along, sides) in &edges {
        let next: Vec<Option<usize>> = (0..sides.len()).map(|k| next_in_front(faces, *along, sides, k)).collect();
        for (k, side) in sides.iter().enumerate() {
            match next[k].filter(|&other| next[other] == Some(k)) {
                Some(other) => joined.join(side.face, sides[other].face),
                None => open[side.face] = true,
            }
        }
    }
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); faces.len()];
    (0..faces.len()).for_each(|face| members[joined.root(face)].push(face));
    let origin = faces.first().map_or(DVec3::ZERO, |face| face.vertices()[0]);
    let inward = |shell: &Vec<usize>| {
        // Volume by the divergence of x/3, fronts taken as outward.
        let cone = |face: &Polygon| (face.centroid() - origin).dot(face.normal()) * face.area() / 3.0;
        shell.iter().map(|&face| cone(faces[face])).sum::<f64>() < -FLAT * diagonal.powi(3)
    };
    let closed = |shell: &Vec<usize>| !shell.is_empty() && shell.iter().all(|&face| !open[face]);
    Some(members.into_iter().filter(|shell| closed(shell) && inward(shell)).collect())
}

/// The side that is met first on turning about an edge from the front of side k, if it runs the other way.
fn next_in_front(faces: &[&Polygon], along: DVec3, sides: &[Side], k: usize) -> Option<usize> {
    /// Angles within which sides count as one, in radians.
    const EQUAL: f64 = 1e-9;
    let into = |side: &Side| {
        let normal = faces[side.face].normal();
        (normal.cross(if side.forward { along } else { -along }), normal)
    };
    let (own, normal) = into(&sides[k]);
    let angle = |side: &Side| {
        let (other, _) = into(side);
        let angle = other.dot(normal).atan2(other.dot(own)).rem_euclid(std::f64::consts::TAU);
        // What lies back to back with this side is met last.
        if angle < EQUAL { angle + std::f64::consts::TAU } else { angle }
    };
    let others = || sides.iter().enumerate().filter(|(other, _)| *other != k);
    let least = others().map(|(_, side)| angle(side)).fold(f64::INFINITY, f64::min);
    let mut met = others().filter(|(_, side)| side.forward != sides[k].forward && angle(side) <= least + EQUAL);
    let first = met.next()?;
    // Two sheets in one place: nobody can say which is in front.
    met.next().is_none().then_some(first.0)
}

/// A closed shell among all faces.
struct Shell<'a> {
    faces: &'a [&'a Polygon],
    of: &'a [usize],
    rounding: f64,
    near: f64,
}

impl Shell<'_> {
    /// Whether each face of all lies inside, seen from its front; `None` if the shell does not part them.
    fn contains(&self) -> Option<Vec<bool>> {
        let boxes: Vec<(DVec3, DVec3)> = self.of.iter().map(|&h| self.faces[h].bounds()).collect();
        let (low, high) = common_bounds(boxes.iter().copied());
        let mut own = vec![false; self.faces.len()];
        self.of.iter().for_each(|&face| own[face] = true);
        let of_face = |f: usize| {
            let face = self.faces[f];
            let (l, h) = face.bounds();
            // Beyond the box of the shell, at most touching it: not inside. What lies flat on the box may look into it.
            let above = l.cmpge(high) & h.cmpgt(high + self.rounding);
            let below = h.cmple(low) & l.cmplt(low - self.rounding);
            if !own[f] && (above.any() || below.any()) {
                return Some(false);
            }
            let meets = |k: &usize| boxes[*k].0.cmple(h).all() && boxes[*k].1.cmpge(l).all();
            if !own[f] && (0..self.of.len()).filter(meets).any(|k| self.may_cross(face, self.faces[self.of[k]])) {
                return None;
            }
            let inside = DIRECTIONS.iter().find_map(|along| self.odd_crossings(f, *along))?;
            (inside || !own[f]).then_some(inside)
        };
        (0..self.faces.len()).map(of_face).collect()
    }

    /// Distance from the plane of a face that rounding and its thickness make.
    fn margin(&self, face: &Polygon, other: &Polygon) -> f64 {
        self.rounding + 2.0 * (face.thickness() + other.thickness())
    }

    /// Whether two faces may cross, or one pass an edge of the other.
    fn may_cross(&self, f: &Polygon, h: &Polygon) -> bool {
        let margin = self.margin(f, h);
        let (low, high) = heights(f, h);
        if low >= -margin || high <= margin {
            // f on one side of h: at most it touches.
            return false;
        }
        let (low, high) = heights(h, f);
        if low > margin || high < -margin {
            return false;
        }
        // Both reach the line common to both planes: where on it?
        let line = f.normal().cross(h.normal());
        let Some(line) = line.try_normalize() else { return true };
        let (a, b) = (span(f, h, line, margin), span(h, f, line, margin));
        a.0 <= b.1 + self.near && b.0 <= a.1 + self.near
    }

    /// Whether a ray from the centroid of face f into its front crosses the shell an odd number of times; `None` if an edge is too near.
    fn odd_crossings(&self, f: usize, along: [f64; 3]) -> Option<bool> {
        let face = self.faces[f];
        let (x, y) = face.frame();
        let (from, to) = (face.centroid(), (x * along[0] + y * along[1] + face.normal() * along[2]).normalize());
        let mut odd = false;
        for &h in self.of {
            let shell = self.faces[h];
            let height = shell.signed_distance(from);
            // The ray leaves a face that it starts on.
            if h == f || height.abs() <= self.margin(face, shell) {
                continue;
            }
            let falls = -to.dot(shell.normal());
            let t = height / falls;
            if falls.abs() < 1e-9 {
                // Along the face: it may pass within rounding of it.
                let reach = |v: &DVec3| (*v - from).cross(to).length() <= 10.0 * shell.diameter();
                if shell.vertices().iter().any(reach) && height.abs() < self.near {
                    return None;
                }
                continue;
            }
            if t < 0.0 {
                continue;
            }
            let at = from + to * t;
            let depth = |(a, b): (DVec3, DVec3)| shell.normal().cross(b - a).normalize_or_zero().dot(at - a);
            let depth = shell.edges().map(depth).fold(f64::INFINITY, f64::min);
            if depth.abs() <= self.near {
                return None;
            }
            odd ^= depth > 0.0;
        }
        Some(odd)
    }
}

/// Least and greatest height of the corners of `of` over the plane of `over`.
fn heights(of: &Polygon, over: &Polygon) -> (f64, f64) {
    let heights = of.vertices().iter().map(|v| over.signed_distance(*v));
    heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)))
}

/// Where on `line` the part of `of` lies that meets the plane of `over` within `margin`.
fn span(of: &Polygon, over: &Polygon, line: DVec3, margin: f64) -> (f64, f64) {
    let mut span = (f64::INFINITY, f64::NEG_INFINITY);
    let mut add = |v: DVec3| span = (span.0.min(v.dot(line)), span.1.max(v.dot(line)));
    for (a, b) in of.edges() {
        let (d_a, d_b) = (over.signed_distance(a), over.signed_distance(b));
        if d_a.abs() <= margin {
            add(a);
        }
        if d_a.min(d_b) < -margin && d_a.max(d_b) > margin {
            add(a + (b - a) * (d_a / (d_a - d_b)));
        }
    }
    span
}

#[cfg(test)]
mod tests {
    use radiosity_gallery::boxes::{faces, material, scene_of_loops};

    use super::*;

    fn cuboid(lo: [f64; 3], hi: [f64; 3], inward: bool) -> Vec<Vec<DVec3>> {
        faces(lo.into(), hi.into(), inward)
    }

    fn rooms_of(loops: &[Vec<Vec<DVec3>>]) -> Option<Vec<u32>> {
        let loops: Vec<_> = loops.iter().flatten().map(|face| (face.clone(), 0)).collect();
        rooms(&scene_of_loops(&loops, vec![material("grey", 0.5, 1.0)]), u64::MAX)
    }

    #[test]
    fn rooms_wall_to_wall_are_two_and_what_stands_in_each_belongs_to_it() {
        let (left, right) = (cuboid([0.0; 3], [3.0, 4.0, 2.0], true), cuboid([3.0, 0.0, 0.0], [5.0, 4.0, 2.0], true));
        // A block on the floor of the left room and a sheet against the wall of the right one.
        let block = cuboid([1.0, 1.0, 0.0], [2.0, 2.0, 1.0], false);
        let sheet = vec![[(3.0, 1.0), (4.0, 1.0), (4.0, 2.0), (3.0, 2.0)].map(|(x, y)| DVec3::new(x, y, 1.0)).to_vec()];
        let found = rooms_of(&[left, right, block, sheet]).unwrap();
        // The block's bottom looks into the floor it stands on, out of both rooms.
        let expected = [&[0; 6][..], &[1; 6], &[0, 0, 0, 0, 2, 0], &[1]].concat();
        assert_eq!(found, expected);
    }

    #[test]
    fn a_lamp_flat_on_a_ceiling_shines_into_the_room_under_it() {
        let room = cuboid([0.0; 3], [3.0, 4.0, 2.0], true);
        let lamp = |z: f64| [(1.0, 1.0), (1.0, 2.0), (2.0, 2.0), (2.0, 1.0)].map(|(x, y)| DVec3::new(x, y, z)).to_vec();
        let up: Vec<DVec3> = lamp(2.0).into_iter().rev().collect();
        assert_eq!(rooms_of(&[room, vec![lamp(2.0), up]]).unwrap(), [0, 0, 0, 0, 0, 0, 0, 1]);
    }

    #[test]
    fn a_room_inside_another_is_one_of_its_own_and_the_world_outside_a_third() {
        let (outer, inner) = (cuboid([0.0; 3], [9.0; 3], true), cuboid([3.0; 3], [4.0; 3], true));
        let shell_of_inner = cuboid([2.5; 3], [4.5; 3], false);
        let outside = vec![[(20.0, 0.0), (21.0, 0.0), (20.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 4.0)).to_vec()];
        let found = rooms_of(&[outer, inner, shell_of_inner, outside]).unwrap();
        let expected: Vec<u32> = [[0; 6], [1; 6], [0; 6]].concat().into_iter().chain([2]).collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn a_door_joins_rooms() {
        // The wall between is missing in both.
        let (mut left, mut right) =
            (cuboid([0.0; 3], [3.0, 4.0, 2.0], true), cuboid([3.0, 0.0, 0.0], [5.0, 4.0, 2.0], true));
        left.remove(1);
        right.remove(0);
        // What is left is one closed room.
        assert_eq!(rooms_of(&[left.clone(), right.clone()]), Some(vec![0; 10]));
        // With a hole in the roof it is none.
        left.pop();
        assert_eq!(rooms_of(&[left, right]), None);
    }

    #[test]
    fn what_pokes_through_a_wall_joins_both_sides_of_it() {
        let (left, right) = (cuboid([0.0; 3], [3.0, 4.0, 2.0], true), cuboid([3.0, 0.0, 0.0], [5.0, 4.0, 2.0], true));
        let sheet = |corners: [(f64, f64); 4]| vec![corners.map(|(x, y)| DVec3::new(x, y, 1.0)).to_vec()];
        let through = sheet([(2.0, 1.0), (4.0, 1.0), (4.0, 2.0), (2.0, 2.0)]);
        let found = rooms_of(&[left.clone(), right, through]).unwrap();
        assert_eq!(found, [0; 13]);
        // Through an edge of the shell and nowhere else.
        let corner = |x: f64, z: f64| DVec3::new(x, x, z);
        let diagonal = vec![vec![corner(-1.0, 0.5), corner(1.0, 0.5), corner(1.0, 1.5), corner(-1.0, 1.5)]];
        assert_eq!(rooms_of(&[left, diagonal]).unwrap(), [0; 7]);
    }

    /// 40 shells of 480 faces, each near 36 of them at most: 40·6·36 looks and 40·480/16 boxes, not 40·12·480.
    #[test]
    fn a_high_tower_is_parted_storey_by_storey_in_few_looks() {
        let tower = radiosity_gallery::rooms::tower(&[true; 40]);
        let found = rooms(&tower, 40 * 6 * 36 + 1200).unwrap();
        let storey = |s: usize| s / radiosity_gallery::rooms::STOREY;
        assert!((0..found.len()).all(|s| found[s] as usize == storey(s)), "{found:?}");
    }

    /// 100 sheets hinged on one edge of a room: 102² pairs there, and 12 edges of 2.
    #[test]
    fn an_edge_of_many_faces_is_not_looked_at_beyond_what_may_be() {
        let leaf = |k: u32| {
            let (y, z) = (f64::from(k) * 0.015 + 0.01).sin_cos();
            [(0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (3.0, y, z), (0.0, y, z)].map(|(x, y, z)| DVec3::new(x, y, z)).to_vec()
        };
        let all = cuboid([0.0; 3], [3.0, 4.0, 2.0], true).into_iter().chain((0..100).map(leaf));
        let loops: Vec<_> = all.map(|face| (face, 0)).collect();
        let scene = scene_of_loops(&loops, vec![material("grey", 0.5, 1.0)]);
        let faces: Vec<&Polygon> = scene.pieces().map(|(_, face)| face).collect();
        let found = [102 * 102 - 1, 102 * 102].map(|most| shells(&faces, scene.diagonal(), most).is_some());
        assert_eq!(found, [false, true]);
    }

    #[test]
    fn solids_and_open_scenes_prove_nothing() {
        assert_eq!(rooms_of(&[cuboid([0.0; 3], [1.0; 3], false)]), None);
        assert_eq!(rooms_of(&[cuboid([0.0; 3], [1.0; 3], true)[..5].to_vec()]), None);
        let scene_too_large = {
            let loops: Vec<_> = cuboid([0.0; 3], [1.0; 3], true).into_iter().map(|face| (face, 0)).collect();
            rooms(&scene_of_loops(&loops, vec![material("grey", 0.5, 1.0)]), 35)
        };
        assert_eq!(scene_too_large, None);
    }
}
