//! Whether a scene is closed, estimated from its edges.

use std::collections::HashMap;

use glam::{DVec3, I64Vec3};

use crate::Scene;

/// Vertices closer than this share of the scene's diagonal are one, and a vertex closer to an edge lies on it.
const WELD: f64 = 1e-9;

impl Scene {
    /// Whether every edge of every piece is matched by an edge that runs the other way: see [`Self::open_edges`].
    pub fn closed(&self) -> bool {
        self.open_edges() == 0
    }

    /// Number of edges, or parts of edges between vertices on them, that no other piece runs along the other way.
    ///
    /// 0 says that the pieces bound solids or rooms without a gap at an edge, whatever their number. It does not say that
    /// everything is in one room, nor which side is inside; a sheet given twice, once each way round, counts as a
    /// closed flat bag. More than 0 does not say that light escapes: a box without a bottom that stands on a floor
    /// has open edges, and so has a sheet that hangs in a closed room. Rays that hit nothing are the other estimate.
    ///
    /// Vertices within 1e-9 of the scene's diagonal count as one.
    pub fn open_edges(&self) -> usize {
        let tolerance = WELD * self.diagonal();
        let mut weld = Weld { points: Vec::new(), cells: HashMap::new(), tolerance };
        // Directed edges; an edge and its opposite cancel.
        let mut count: HashMap<(usize, usize), i64> = HashMap::new();
        for (_, piece) in self.pieces() {
            for (a, b) in piece.edges() {
                add(&mut count, weld.index(a), weld.index(b), 1);
            }
        }
        let mut open: Vec<((usize, usize), i64)> = count.into_iter().filter(|(_, n)| *n != 0).collect();
        open.sort_unstable();

        // The rest cut at the vertices on them, which are ends of other open edges, and matched once more.
        let mut ends: Vec<usize> = open.iter().flat_map(|&((a, b), _)| [a, b]).collect();
        ends.sort_unstable_by(|&a, &b| weld.points[a].x.total_cmp(&weld.points[b].x).then(a.cmp(&b)));
        ends.dedup();
        let mut count: HashMap<(usize, usize), i64> = HashMap::new();
        for ((a, b), n) in open {
            let (p, q) = (weld.points[a], weld.points[b]);
            let along = (q - p) / p.distance(q);
            let begin = ends.partition_point(|&v| weld.points[v].x < p.x.min(q.x) - tolerance);
            let mut stops: Vec<(f64, usize)> = ends[begin..]
                .iter()
                .take_while(|&&v| weld.points[v].x <= p.x.max(q.x) + tolerance)
                .filter(|&&v| v != a && v != b)
                .map(|&v| ((weld.points[v] - p).dot(along), v))
                .filter(|&(s, v)| s > 0.0 && s < p.distance(q) && (p + along * s).distance(weld.points[v]) <= tolerance)
                .collect();
            stops.sort_unstable_by(|x, y| x.0.total_cmp(&y.0));
            let mut from = a;
            for to in stops.into_iter().map(|(_, v)| v).chain([b]) {
                add(&mut count, from, to, n);
                from = to;
            }
        }
        count.values().map(|n| n.unsigned_abs() as usize).sum()
    }
}

/// Adds `n` edges from a to b: edges the other way count negative.
fn add(count: &mut HashMap<(usize, usize), i64>, a: usize, b: usize, n: i64) {
    match a.cmp(&b) {
        std::cmp::Ordering::Less => *count.entry((a, b)).or_default() += n,
        std::cmp::Ordering::Greater => *count.entry((b, a)).or_default() -= n,
        std::cmp::Ordering::Equal => {}
    }
}

/// Points that are equal within a tolerance, found by cells of that size.
struct Weld {
    points: Vec<DVec3>,
    cells: HashMap<I64Vec3, Vec<usize>>,
    tolerance: f64,
}

impl Weld {
    fn index(&mut self, point: DVec3) -> usize {
        let size = 2.0 * self.tolerance;
        let cell = |p: DVec3| (p / size).floor().as_i64vec3();
        // A ball of the tolerance meets at most the two cells on either side along each axis.
        let (lo, hi) = (cell(point - self.tolerance), cell(point + self.tolerance));
        for x in lo.x..=hi.x {
            for y in lo.y..=hi.y {
                for z in lo.z..=hi.z {
                    let near = self.cells.get(&I64Vec3::new(x, y, z)).into_iter().flatten();
                    for &k in near {
                        if self.points[k].distance(point) <= self.tolerance {
                            return k;
                        }
                    }
                }
            }
        }
        self.points.push(point);
        self.cells.entry(cell(point)).or_default().push(self.points.len() - 1);
        self.points.len() - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{cube, quad, scene_of};

    #[test]
    fn a_cube_is_closed_wherever_it_stands() {
        let at = DVec3::new(1e5, -3e4, 7.0);
        let mut faces = cube(3.0);
        faces.iter_mut().flatten().for_each(|v| *v += at);
        assert_eq!(scene_of(&faces).open_edges(), 0);
    }

    #[test]
    fn a_cube_without_a_lid_has_four_open_edges() {
        let faces = cube(3.0);
        assert_eq!(scene_of(&faces[..5]).open_edges(), 4);
    }

    #[test]
    fn a_face_cut_in_two_against_whole_neighbours_is_closed() {
        let mut faces = cube(1.0);
        let [a, b, c, d] = faces.remove(5)[..] else { unreachable!() };
        // A third of the way, which rounds: the new vertices lie beside the edges by an ulp.
        let (p, q) = (a.lerp(b, 1.0 / 3.0), d.lerp(c, 1.0 / 3.0));
        faces.extend([quad(a, p, q, d), quad(p, b, c, q)]);
        assert!(scene_of(&faces).closed());
    }

    #[test]
    fn a_sheet_is_open_and_its_twin_closes_it() {
        let face = cube(2.0).remove(0);
        let back: Vec<DVec3> = face.iter().rev().copied().collect();
        assert_eq!(scene_of(std::slice::from_ref(&face)).open_edges(), 4);
        assert_eq!(scene_of(&[face, back]).open_edges(), 0);
    }
}
