//! Blockers that make one polygon together, as nodes see them.
//!
//! A wall is often given in panels, and no panel hides what the wall does: pairs behind it are never known to be hidden, and lists are as
//! long as panels are many. So polygons of one plane that share an edge become one where their union is convex, as often as that goes: two
//! loops a … b and b … a that meet in the edge a b are spliced, and a vertex at which the joint loop is straight is left out. Shadows are
//! those of the panels, since the union covers the same points.
//!
//! Edges are shared if their ends are equal to the last bit, as those of a tessellation are; what only nearly touches stays apart. (Fusing
//! blockers into larger ones that hide more: Schaufler, Dorsey, Décoret, Sillion, SIGGRAPH 2000, there by volumes.)

use std::collections::HashMap;

use glam::DVec3;
use radiosity_geometry::Polygon;

/// Sine of the turn up to which an outline counts as straight.
const STRAIGHT: f64 = 1e-9;

/// A convex polygon and the parts that it was made of.
pub(super) struct Wall {
    pub polygon: Polygon,
    /// Largest distance of a corner of a part from that part's centroid.
    pub part: f64,
}

/// Both ends of a directed edge, as bits.
type Edge = [u64; 6];

/// `polygons` with neighbours joined; corners within `flat` of a plane count as lying in it. The order is that of the first part of each.
pub(super) fn joined(polygons: &[Polygon], flat: f64) -> Vec<Wall> {
    let mut walls: Vec<Option<Wall>> = polygons
        .iter()
        .map(|polygon| {
            let part = polygon.vertices().iter().map(|v| v.distance(polygon.centroid())).fold(0.0, f64::max);
            Some(Wall { polygon: polygon.clone(), part })
        })
        .collect();
    let mut owners: HashMap<Edge, usize> = HashMap::new();
    for (k, polygon) in polygons.iter().enumerate() {
        owners.extend(polygon.edges().map(|(a, b)| (edge(a, b), k)));
    }
    for k in 0..walls.len() {
        let Some(mut wall) = walls[k].take() else { continue };
        while let Some((other, polygon)) = neighbour(&wall, &walls, &owners, flat) {
            let Some(part) = walls[other].take() else { break };
            for (a, b) in wall.polygon.edges().chain(part.polygon.edges()) {
                owners.remove(&edge(a, b));
            }
            owners.extend(polygon.edges().map(|(a, b)| (edge(a, b), k)));
            wall = Wall { polygon, part: wall.part.max(part.part) };
        }
        walls[k] = Some(wall);
    }
    walls.into_iter().flatten().collect()
}

/// The first polygon across an edge of a wall that makes a convex one with it, and that one.
fn neighbour(
    wall: &Wall,
    walls: &[Option<Wall>],
    owners: &HashMap<Edge, usize>,
    flat: f64,
) -> Option<(usize, Polygon)> {
    wall.polygon.edges().find_map(|(a, b)| {
        let &other = owners.get(&edge(b, a))?;
        Some((other, union(&wall.polygon, &walls[other].as_ref()?.polygon, (a, b), flat)?))
    })
}

/// The union of two polygons, of which the first has the edge a → b and the other b → a, if it is convex and they lie in one plane.
fn union(first: &Polygon, second: &Polygon, (a, b): (DVec3, DVec3), flat: f64) -> Option<Polygon> {
    let normal = first.normal();
    let level = |v: &DVec3| first.signed_distance(*v).abs() <= flat;
    if normal.dot(second.normal()) <= 0.0 || !second.vertices().iter().all(level) {
        return None;
    }
    // From b around the first to a, on around the second to b.
    let [from_b, from_a] = [(first, b), (second, a)].map(|(polygon, start)| {
        let corners = polygon.vertices();
        let at = corners.iter().position(|v| *v == start)?;
        Some([&corners[at..], &corners[..at]].concat())
    });
    let (from_b, from_a) = (from_b?, from_a?);
    let outline = [&from_b[..from_b.len() - 1], &from_a[..from_a.len() - 1]].concat();
    let n = outline.len();
    let mut corners = Vec::with_capacity(n);
    for (k, &v) in outline.iter().enumerate() {
        let (before, after) = (v - outline[(k + n - 1) % n], outline[(k + 1) % n] - v);
        let turn = before.cross(after).dot(normal) / (before.length() * after.length());
        if turn < -STRAIGHT {
            return None;
        }
        // Only at the ends of the common edge may the outline have become straight, or turn inward.
        if turn > STRAIGHT || (k != 0 && k != from_b.len() - 1) {
            corners.push(v);
        }
    }
    Polygon::new(&corners).ok()
}

fn edge(a: DVec3, b: DVec3) -> Edge {
    // 0 and −0 are one number.
    [a.x, a.y, a.z, b.x, b.y, b.z].map(|x| (x + 0.0).to_bits())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rectangle(x: [f64; 2], y: [f64; 2], z: f64) -> Polygon {
        let corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])];
        Polygon::new(&corners.map(|(x, y)| DVec3::new(x, y, z))).unwrap()
    }

    fn reversed(polygon: &Polygon) -> Polygon {
        let mut corners = polygon.vertices().to_vec();
        corners.reverse();
        Polygon::new(&corners).unwrap()
    }

    /// Thirds are not exact, so that outlines are straight to rounding only.
    #[test]
    fn panels_of_a_wall_become_the_wall_and_keep_their_size() {
        let at = |k: u32| f64::from(k) / 3.0;
        let panel = |i: u32, j: u32| rectangle([at(i), at(i + 1)], [0.7 * at(j), 0.7 * at(j + 1)], 0.1);
        let panels: Vec<Polygon> = (0..15).map(|k| panel(k % 5, k / 5)).collect();
        let walls = joined(&panels, 1e-9);
        assert_eq!(walls.len(), 1);
        let (wall, whole) = (&walls[0].polygon, rectangle([0.0, at(5)], [0.0, 0.7], 0.1));
        assert_eq!((wall.vertices().len(), wall.bounds()), (4, whole.bounds()));
        assert!((wall.area() - whole.area()).abs() < 1e-14 && wall.normal() == whole.normal());
        assert!((walls[0].part - 0.5 * (1.0_f64 + 0.49).sqrt() / 3.0).abs() < 1e-15);
    }

    #[test]
    fn two_triangles_become_their_rectangle() {
        let corners = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)].map(|(x, y)| DVec3::new(x, y, 0.0));
        let triangle = |k: [usize; 3]| Polygon::new(&k.map(|k| corners[k])).unwrap();
        let walls = joined(&[triangle([0, 1, 2]), triangle([2, 3, 0])], 1e-9);
        assert_eq!(walls.len(), 1);
        assert!((walls[0].polygon.area() - 2.0).abs() < 1e-15 && walls[0].polygon.vertices().len() == 4);
    }

    /// What is convex in two ways is joined in one of them; areas add up whichever it is.
    #[test]
    fn corners_planes_and_sides_are_kept_apart() {
        let (a, b, c) = (
            rectangle([0.0, 1.0], [0.0, 1.0], 0.0),
            rectangle([1.0, 2.0], [0.0, 1.0], 0.0),
            rectangle([0.0, 1.0], [1.0, 2.0], 0.0),
        );
        let corner = joined(&[a.clone(), b.clone(), c], 1e-9);
        assert_eq!(corner.len(), 2);
        assert!((corner.iter().map(|w| w.polygon.area()).sum::<f64>() - 3.0).abs() < 1e-15);
        // A sheet and its other side, a fold, and a neighbour whose edge is longer.
        let fold =
            [(1.0, 0.0, 0.0), (2.0, 0.0, 1e-3), (2.0, 1.0, 1e-3), (1.0, 1.0, 0.0)].map(|(x, y, z)| DVec3::new(x, y, z));
        for other in [reversed(&a), Polygon::new(&fold).unwrap(), rectangle([1.0, 2.0], [0.0, 2.0], 0.0)] {
            assert_eq!(joined(&[a.clone(), other], 1e-9).len(), 2);
        }
    }
}
