//! Faces as files hold them, made of convex planar pieces: kept if convex and planar, cut into triangles otherwise.
//!
//! What is *not* here: holes (a face is one loop, which may touch itself) and loops that cross themselves, whose
//! triangles cover some rounding of the loop and nothing sharper.

use glam::{DVec2, DVec3};

use crate::{
    Polygon, PolygonError, Surface,
    polygon::{area_vector, diameter},
};

/// A face is planar if no vertex is further from its best plane than this share of the diameter.
const PLANAR: f64 = 1e-6;

/// A corner is convex if it is turned in by no more than this share of the diameter.
const CONVEX: f64 = 1e-9;

/// What became of a face.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FaceKind {
    /// Convex and planar: kept as it is.
    Convex,
    /// Planar but not convex: cut into triangles.
    Concave,
    /// Not planar: cut into triangles.
    NonPlanar,
}

impl Surface {
    /// A surface of one face given by its vertices, counter-clockwise seen from the front, and what became of the face.
    ///
    /// Repeated vertices are dropped. A face that is planar within 1e-6 of its diameter (or rounding of its
    /// coordinates) and convex stays whole; any other is cut into triangles by clipping ears in its best plane.
    ///
    /// # Errors
    ///
    /// [`PolygonError`] as [`Polygon::new`].
    pub fn from_loop(
        name: impl Into<String>,
        line: usize,
        material: usize,
        vertices: &[DVec3],
    ) -> Result<(Self, FaceKind), PolygonError> {
        let (pieces, kind) = convex_pieces(vertices)?;
        Ok((Self { name: name.into(), line, material, pieces }, kind))
    }
}

/// The convex planar pieces of a face and what became of it; see [`Surface::from_loop`].
///
/// # Errors
///
/// [`PolygonError`] as [`Polygon::new`].
pub fn convex_pieces(vertices: &[DVec3]) -> Result<(Vec<Polygon>, FaceKind), PolygonError> {
    if vertices.len() < 3 {
        return Err(PolygonError::TooFew { count: vertices.len() });
    }
    if let Some(vertex) = vertices.iter().position(|v| !v.is_finite()) {
        return Err(PolygonError::NotFinite { vertex });
    }
    let reach = vertices.iter().map(|v| v.abs().max_element()).fold(0.0, f64::max);
    let rounding = 4.0 * f64::EPSILON * reach;
    let mut corners: Vec<DVec3> = Vec::with_capacity(vertices.len());
    for &v in vertices {
        if corners.last().is_none_or(|last| last.distance(v) > rounding) {
            corners.push(v);
        }
    }
    while corners.len() > 1 && corners[0].distance(corners[corners.len() - 1]) <= rounding {
        corners.pop();
    }
    if corners.len() < 3 {
        return Err(PolygonError::NoArea);
    }
    let whole = Polygon::new(&corners)?;
    let size = diameter(&corners);
    let (u, v) = whole.frame();
    let flat: Vec<DVec2> =
        corners.iter().map(|c| *c - whole.centroid()).map(|c| DVec2::new(c.dot(u), c.dot(v))).collect();
    let kind = if whole.thickness() > (PLANAR * size).max(rounding) {
        FaceKind::NonPlanar
    } else if !is_convex(&flat, (CONVEX * size).max(rounding)) {
        FaceKind::Concave
    } else {
        return Ok((vec![whole], FaceKind::Convex));
    };
    let normal = whole.normal();
    let pieces: Vec<Polygon> = clip_ears(&flat)
        .into_iter()
        .map(|triangle| triangle.map(|k| corners[k]))
        // A loop that crosses itself has parts turned over; they are no part of the front.
        .filter(|triangle| area_vector(triangle).dot(normal) > 0.0)
        .filter_map(|triangle| Polygon::new(&triangle).ok())
        .collect();
    if pieces.is_empty() { Err(PolygonError::NoArea) } else { Ok((pieces, kind)) }
}

/// Twice the signed area of a triangle.
fn cross(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

/// Whether a counter-clockwise loop turns left everywhere, or right by less than `slack`, and goes round once.
fn is_convex(flat: &[DVec2], slack: f64) -> bool {
    let n = flat.len();
    let mut turned = 0.0;
    for k in 0..n {
        let (a, b, c) = (flat[(k + n - 1) % n], flat[k], flat[(k + 1) % n]);
        let depth = -cross(a, b, c) / (c - a).length();
        // A spike (c = a) turns by half a circle; NaN is no convex corner.
        if depth.is_nan() || depth > slack {
            return false;
        }
        turned += (b - a).angle_to(c - b);
    }
    turned < 3.0 * std::f64::consts::PI
}

/// Triangles of a simple counter-clockwise loop, as indices into it: n − 2 of them, fewer if vertices are collinear.
///
/// Of all ears the one with the largest smallest angle goes first, so that slivers are left only where the loop has
/// them. If none is left (collinear rest, or a loop that crosses itself) the flattest corner is dropped.
fn clip_ears(flat: &[DVec2]) -> Vec<[usize; 3]> {
    let mut rest: Vec<usize> = (0..flat.len()).collect();
    let mut triangles = Vec::with_capacity(flat.len() - 2);
    while rest.len() >= 3 {
        let n = rest.len();
        let corner = |k: usize| [rest[(k + n - 1) % n], rest[k], rest[(k + 1) % n]];
        let best = (0..n)
            .map(|k| (k, quality(corner(k).map(|v| flat[v]))))
            .filter(|&(k, q)| q > 0.0 && (n == 3 || is_ear(flat, &rest, corner(k))))
            .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
        let drop = match best {
            Some((k, _)) => {
                triangles.push(corner(k));
                k
            }
            None => {
                let flatness = |k: usize| quality(corner(k).map(|v| flat[v])).abs();
                (0..n).min_by(|&a, &b| flatness(a).total_cmp(&flatness(b)).then(a.cmp(&b))).unwrap_or(0)
            }
        };
        rest.remove(drop);
    }
    triangles
}

/// Area over the sum of the squared sides: positive for a left turn, 0 for a flat corner, at most 1/(4√3).
fn quality([a, b, c]: [DVec2; 3]) -> f64 {
    let sides = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
    let q = 0.5 * cross(a, b, c) / sides;
    // Rounding of coordinates about the centroid: flatter than this is flat.
    if q.abs() > 8.0 * f64::EPSILON { q } else { 0.0 }
}

/// Whether no other vertex of the rest lies in the triangle; those at its corners (bridges to holes) do not count.
fn is_ear(flat: &[DVec2], rest: &[usize], triangle: [usize; 3]) -> bool {
    let [a, b, c] = triangle.map(|k| flat[k]);
    rest.iter().filter(|k| !triangle.contains(k)).map(|&k| flat[k]).filter(|p| ![a, b, c].contains(p)).all(|p| {
        let outside = cross(a, b, p) < 0.0 || cross(b, c, p) < 0.0 || cross(c, a, p) < 0.0;
        // On the edges beside the ear a vertex does no harm; on or before the new edge c a it would be cut off.
        outside || (cross(c, a, p) > 0.0 && (cross(a, b, p) == 0.0 || cross(b, c, p) == 0.0))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn loop_of(points: &[(f64, f64)]) -> Vec<DVec3> {
        points.iter().map(|&(x, y)| DVec3::new(x, y, 0.0)).collect()
    }

    fn area(pieces: &[Polygon]) -> f64 {
        pieces.iter().map(Polygon::area).sum()
    }

    #[test]
    fn a_convex_pentagon_stays_whole() {
        let (surface, kind) =
            Surface::from_loop("p", 7, 0, &loop_of(&[(0., 0.), (3., 0.), (4., 2.), (2., 4.), (0., 2.)])).unwrap();
        assert_eq!((kind, surface.pieces.len(), surface.line), (FaceKind::Convex, 1, 7));
    }

    /// An L of area 5: 3 × 1 plus 1 × 2. A fan from its first vertex would cover 3 × 3 in part.
    #[test]
    fn an_l_is_cut_into_triangles_of_the_same_area_inside_it() {
        let l = loop_of(&[(3., 0.), (3., 1.), (1., 1.), (1., 3.), (0., 3.), (0., 0.)]);
        let (pieces, kind) = convex_pieces(&l).unwrap();
        assert_eq!((kind, pieces.len()), (FaceKind::Concave, 4));
        assert!((area(&pieces) - 5.0).abs() < 1e-14);
        assert!(pieces.iter().all(|p| p.centroid().x < 1.0 || p.centroid().y < 1.0));
    }

    #[test]
    fn repeated_and_collinear_vertices_change_nothing() {
        let l = loop_of(&[
            (3., 0.),
            (3., 0.),
            (3., 0.5),
            (3., 1.),
            (1., 1.),
            (1., 2.),
            (1., 3.),
            (0., 3.),
            (0., 1.),
            (0., 0.),
            (3., 0.),
        ]);
        let (pieces, kind) = convex_pieces(&l).unwrap();
        assert_eq!(kind, FaceKind::Concave);
        assert!((area(&pieces) - 5.0).abs() < 1e-14);
    }

    /// A square ring cut open by a bridge that the loop runs along twice: 16 − 4.
    #[test]
    fn a_hole_joined_by_a_bridge_stays_open() {
        let ring = loop_of(&[
            (0., 0.),
            (4., 0.),
            (4., 4.),
            (0., 4.),
            (0., 0.),
            (1., 1.),
            (1., 3.),
            (3., 3.),
            (3., 1.),
            (1., 1.),
        ]);
        let (pieces, _) = convex_pieces(&ring).unwrap();
        assert!((area(&pieces) - 12.0).abs() < 1e-13);
        assert!(pieces.iter().all(|p| (p.centroid() - DVec3::new(2.0, 2.0, 0.0)).abs().max_element() > 0.9));
    }

    /// The star's signed area: shoelace sum, independent of the triangles.
    #[test]
    fn a_star_of_269_corners_keeps_its_area() {
        let star: Vec<(f64, f64)> = (0..269)
            .map(|k| (k as f64 * std::f64::consts::TAU / 269.0, [1.0, 0.3, 0.8][k % 3]))
            .map(|(angle, r)| (1e3 + r * angle.cos(), r * angle.sin()))
            .collect();
        let shoelace: f64 = (0..269)
            .map(|k| (star[k], star[(k + 1) % 269]))
            .map(|(a, b)| 0.5 * ((a.0 - 1e3) * b.1 - (b.0 - 1e3) * a.1))
            .sum();
        let (pieces, kind) = convex_pieces(&loop_of(&star)).unwrap();
        assert_eq!((kind, pieces.len()), (FaceKind::Concave, 267));
        assert!((area(&pieces) - shoelace).abs() < 1e-12);
    }

    #[test]
    fn a_bent_quadrilateral_becomes_two_triangles() {
        let mut quad = loop_of(&[(0., 0.), (3., 0.), (3., 5.), (0., 5.)]);
        quad[2].z = 0.1;
        let (pieces, kind) = convex_pieces(&quad).unwrap();
        assert_eq!((kind, pieces.len()), (FaceKind::NonPlanar, 2));
        assert!(pieces.iter().all(|p| p.thickness() < 1e-15));
    }

    /// 1e5 from the origin coordinates carry 1.5e-11: a face of side 1e-4 is flat to rounding only.
    #[test]
    fn rounding_of_the_coordinates_bends_no_face() {
        let at = DVec3::new(1e5, -1e5, 1e5);
        let (u, v) = (DVec3::new(0.6, 0.64, 0.48) * 1e-4, DVec3::new(-0.8, 0.48, 0.36) * 1e-4);
        let (_, kind) = convex_pieces(&[at, at + u, at + u + v, at + v]).unwrap();
        assert_eq!(kind, FaceKind::Convex);
    }

    #[test]
    fn a_pentagram_goes_round_twice_and_is_not_convex() {
        let point = |k: usize| (k as f64 * 0.8 * std::f64::consts::PI).sin_cos();
        let (pieces, kind) = convex_pieces(&loop_of(&[point(0), point(4), point(3), point(2), point(1)])).unwrap();
        assert_eq!(kind, FaceKind::Concave);
        assert!(area(&pieces) > 0.0);
    }

    #[test]
    fn a_line_and_a_point_have_no_area() {
        assert_eq!(convex_pieces(&loop_of(&[(0., 0.), (1., 1.), (2., 2.), (3., 3.)])), Err(PolygonError::NoArea));
        assert_eq!(convex_pieces(&loop_of(&[(1., 1.), (1., 1.), (1., 1.)])), Err(PolygonError::NoArea));
    }
}
