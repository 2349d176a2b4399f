//! Convex planar polygons.

use glam::DVec3;

/// A convex planar polygon; its front is the side from which the vertices run counter-clockwise.
///
/// Triangles and quadrilaterals, of which meshes hold millions, hold their vertices in place; others take an allocation.
#[derive(Clone, Debug, PartialEq)]
pub struct Polygon {
    vertices: Vertices,
    normal: DVec3,
    centroid: DVec3,
    area: f64,
    thickness: f64,
}

/// Vertices held in place up to four.
#[derive(Clone)]
enum Vertices {
    /// The first so many of them; the rest is zero.
    Few(u8, [DVec3; 4]),
    Many(Box<[DVec3]>),
}

impl From<&[DVec3]> for Vertices {
    fn from(vertices: &[DVec3]) -> Self {
        let mut few = [DVec3::ZERO; 4];
        match few.get_mut(..vertices.len()) {
            Some(own) => {
                own.copy_from_slice(vertices);
                Self::Few(vertices.len() as u8, few)
            }
            None => Self::Many(vertices.into()),
        }
    }
}

impl std::ops::Deref for Vertices {
    type Target = [DVec3];

    fn deref(&self) -> &[DVec3] {
        match self {
            Self::Few(count, few) => &few[..usize::from(*count)],
            Self::Many(many) => many,
        }
    }
}

impl PartialEq for Vertices {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl std::fmt::Debug for Vertices {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        (**self).fmt(f)
    }
}

/// Why vertices make no polygon.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PolygonError {
    /// Fewer than three vertices.
    #[error("a polygon needs at least 3 vertices, got {count}")]
    TooFew {
        /// Number given.
        count: usize,
    },
    /// A coordinate is not finite.
    #[error("vertex {vertex} of the polygon is not finite")]
    NotFinite {
        /// Position in the list.
        vertex: usize,
    },
    /// The area is zero to rounding.
    #[error("the polygon has no area")]
    NoArea,
    /// The square of a length overflows.
    #[error("the polygon's coordinates are too large to compute an area")]
    TooLarge,
}

/// Area vector of a closed loop: its length is the area, its direction the normal of the best plane (Newell).
///
/// Differences to the first vertex keep their digits when the loop lies far from the origin.
pub fn area_vector(vertices: &[DVec3]) -> DVec3 {
    let Some(&origin) = vertices.first() else { return DVec3::ZERO };
    vertices.windows(2).map(|pair| (pair[0] - origin).cross(pair[1] - origin)).sum::<DVec3>() * 0.5
}

/// Largest distance between two of the points.
pub fn diameter(points: &[DVec3]) -> f64 {
    let pairs = points.iter().enumerate().flat_map(|(k, a)| points[..k].iter().map(move |b| a.distance_squared(*b)));
    pairs.fold(0.0, f64::max).sqrt()
}

impl Polygon {
    /// A polygon of the given vertices, which the caller knows to be convex and planar.
    ///
    /// # Errors
    ///
    /// [`PolygonError`] if there are fewer than three vertices, one is not finite, or the area overflows or is below
    /// rounding of the coordinates times the diameter.
    pub fn new(vertices: &[DVec3]) -> Result<Self, PolygonError> {
        if vertices.len() < 3 {
            return Err(PolygonError::TooFew { count: vertices.len() });
        }
        if let Some(vertex) = vertices.iter().position(|v| !v.is_finite()) {
            return Err(PolygonError::NotFinite { vertex });
        }
        let vector = area_vector(vertices);
        let area = vector.length();
        if !area.is_finite() {
            return Err(PolygonError::TooLarge);
        }
        // Rounding of the input coordinates moves the area by about ε · coordinate · diameter.
        let (size, reach) = (diameter(vertices), vertices.iter().map(|v| v.abs().max_element()).fold(0.0, f64::max));
        if area <= 4.0 * f64::EPSILON * size * size.max(reach) {
            return Err(PolygonError::NoArea);
        }
        let normal = vector / area;
        let centroid = centroid(vertices, normal, area);
        let thickness = vertices.iter().map(|v| (*v - centroid).dot(normal).abs()).fold(0.0, f64::max);
        Ok(Self { vertices: vertices.into(), normal, centroid, area, thickness })
    }

    /// Vertices, counter-clockwise seen from the front.
    pub fn vertices(&self) -> &[DVec3] {
        &self.vertices
    }

    /// Unit normal, out of the front side.
    pub fn normal(&self) -> DVec3 {
        self.normal
    }

    /// Centre of area.
    pub fn centroid(&self) -> DVec3 {
        self.centroid
    }

    /// Area.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// Largest distance of a vertex from the plane through the centroid: 0 up to rounding for a planar polygon.
    pub fn thickness(&self) -> f64 {
        self.thickness
    }

    /// Edges as pairs of end points, in order.
    pub fn edges(&self) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
        let n = self.vertices.len();
        (0..n).map(move |k| (self.vertices[k], self.vertices[(k + 1) % n]))
    }

    /// Signed distance of a point from the plane, positive in front.
    pub fn signed_distance(&self, point: DVec3) -> f64 {
        (point - self.centroid).dot(self.normal)
    }

    /// Largest distance between two vertices.
    pub fn diameter(&self) -> f64 {
        diameter(&self.vertices)
    }

    /// Unit vectors u, v with u × v = normal, u along the first edge: a frame that moves with the polygon.
    pub fn frame(&self) -> (DVec3, DVec3) {
        let edge = self.edges().map(|(a, b)| b - a).find(|e| e.length_squared() > 0.0).unwrap_or(DVec3::X);
        let u = (edge - self.normal * edge.dot(self.normal)).normalize();
        (u, self.normal.cross(u))
    }

    /// A point spread uniformly over the area by (u, v) in [0, 1)²: the fan triangle that holds the share u of the
    /// area, then the triangle's square-root map.
    pub fn sample(&self, u: f64, v: f64) -> DVec3 {
        let a = self.vertices[0];
        let mut share = u * self.area;
        let last = self.vertices.len() - 2;
        for k in 1..=last {
            let (b, c) = (self.vertices[k], self.vertices[k + 1]);
            let part = 0.5 * (b - a).cross(c - a).length();
            if share < part || k == last {
                let r = (share / part).clamp(0.0, 1.0).sqrt();
                return a * (1.0 - r) + (b * (1.0 - v) + c * v) * r;
            }
            share -= part;
        }
        a
    }

    /// The part on the front side of a plane (point, normal), or `None` if nothing with an area is left.
    pub fn clip(&self, point: DVec3, normal: DVec3) -> Option<Self> {
        let d: Vec<f64> = self.vertices.iter().map(|v| (*v - point).dot(normal)).collect();
        if d.iter().all(|&d| d >= 0.0) {
            return Some(self.clone());
        }
        if d.iter().all(|&d| d <= 0.0) {
            return None;
        }
        self.half(&d, 1.0).ok()
    }

    /// The parts in front of and behind a plane (point, unit normal), or `None` if the plane does not pass through the
    /// inside or a part has no area. Vertices within `snap` of the plane count as on it; both parts share the new
    /// vertices bit for bit.
    pub fn split(&self, point: DVec3, normal: DVec3, snap: f64) -> Option<(Self, Self)> {
        let on_plane = |d: f64| if d.abs() <= snap { 0.0 } else { d };
        let d: Vec<f64> = self.vertices.iter().map(|v| on_plane((*v - point).dot(normal))).collect();
        if !(d.iter().any(|&d| d > 0.0) && d.iter().any(|&d| d < 0.0)) {
            return None;
        }
        Some((self.half(&d, 1.0).ok()?, self.half(&d, -1.0).ok()?))
    }

    /// The polygon mirrored at a plane (point, unit normal): its front faces what the front's image is, its area and thickness are those it has. Points
    /// of the plane stay where they are to the last bit where the plane is that of two axes.
    #[must_use]
    pub fn mirrored(&self, point: DVec3, normal: DVec3) -> Self {
        let image = |v: DVec3| v - normal * (2.0 * (v - point).dot(normal));
        // Mirroring turns the loop round: it is run through the other way, from the same corner.
        let (first, rest) = self.vertices.split_at(1);
        let vertices: Vec<DVec3> = first.iter().chain(rest.iter().rev()).map(|v| image(*v)).collect();
        Self {
            vertices: vertices[..].into(),
            normal: self.normal - normal * (2.0 * self.normal.dot(normal)),
            centroid: image(self.centroid),
            ..*self
        }
    }

    /// The part where `side` · d ≥ 0, with d the distances of the vertices from the cutting plane.
    fn half(&self, d: &[f64], side: f64) -> Result<Self, PolygonError> {
        let n = d.len();
        let mut kept = Vec::with_capacity(n + 1);
        for k in 0..n {
            let (a, b, da, db) = (self.vertices[k], self.vertices[(k + 1) % n], d[k], d[(k + 1) % n]);
            if side * da >= 0.0 {
                kept.push(a);
            }
            if (da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0) {
                // From the same end of the edge in both directions, so that neighbours share the new vertex exactly.
                let (p, q, dp, dq) = if da > 0.0 { (a, b, da, db) } else { (b, a, db, da) };
                kept.push(p + (q - p) * (dp / (dp - dq)));
            }
        }
        Self::new(&kept)
    }

    /// Smallest and largest corner of the box around the polygon.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        bounds(self.vertices.iter().copied())
    }
}

/// Smallest and largest corner of the box around some points; (∞, −∞) for none.
pub(crate) fn bounds(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)))
}

/// Centre of area of a planar loop with unit `normal` and `area`.
fn centroid(vertices: &[DVec3], normal: DVec3, area: f64) -> DVec3 {
    let a = vertices[0];
    let moment: DVec3 =
        vertices.windows(2).map(|w| (w[0] - a + (w[1] - a)) * (w[0] - a).cross(w[1] - a).dot(normal) * 0.5).sum();
    a + moment / (3.0 * area)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rectangle() -> Polygon {
        Polygon::new(&[DVec3::ZERO, DVec3::X * 3.0, DVec3::new(3.0, 5.0, 0.0), DVec3::Y * 5.0]).unwrap()
    }

    #[test]
    fn rectangle_has_area_15_and_faces_up() {
        let r = rectangle();
        assert_eq!((r.area(), r.normal(), r.centroid()), (15.0, DVec3::Z, DVec3::new(1.5, 2.5, 0.0)));
    }

    #[test]
    fn clipping_at_a_third_leaves_two_thirds() {
        let r = rectangle().clip(DVec3::X, DVec3::X).unwrap();
        assert!((r.area() - 10.0).abs() < 1e-14);
        assert!(rectangle().clip(DVec3::X * 3.0, DVec3::X).is_none());
    }

    #[test]
    fn a_split_gives_two_parts_that_share_their_new_edge() {
        let normal = DVec3::new(0.6, 0.8, 0.0);
        let (front, back) = rectangle().split(DVec3::new(1.0, 2.0, 0.0), normal, 0.0).unwrap();
        // 15 up to rounding of two sums of four terms.
        assert!((front.area() + back.area() - 15.0).abs() < 1e-14);
        let shared = front.vertices().iter().filter(|v| back.vertices().contains(v)).count();
        assert_eq!(shared, 2);
    }

    #[test]
    fn samples_spread_evenly_over_an_uneven_fan() {
        // The mean of a function linear in position is its value at the centroid.
        let p = Polygon::new(&[DVec3::ZERO, DVec3::X * 4.0, DVec3::new(5.0, 1.0, 0.0), DVec3::Y * 2.0]).unwrap();
        let n = 256;
        let at = |k: usize| (k as f64 + 0.5) / n as f64;
        let sum: DVec3 = (0..n * n).map(|k| p.sample(at(k % n), at(k / n))).sum();
        // Where one fan triangle ends and the next begins the sample jumps by the spoke of length √26; the midpoint rule
        // errs there by at most half a step.
        assert!((sum / (n * n) as f64 - p.centroid()).length() < 26.0_f64.sqrt() / (2.0 * n as f64) + 1e-4);
    }

    #[test]
    fn a_sliver_keeps_its_area_far_from_the_origin() {
        let at = DVec3::splat(1e5);
        let p = Polygon::new(&[at, at + DVec3::X, at + DVec3::new(1.0, 1e-3, 0.0)]).unwrap();
        assert!((p.area() - 5e-4).abs() < 1e-10);
    }

    #[test]
    fn a_mirrored_polygon_faces_what_its_front_does_in_the_mirror() {
        let (point, normal) = (DVec3::new(0.2, 0.1, -0.7), DVec3::new(2.0, 3.0, 6.0) / 7.0);
        let r = rectangle();
        let image = r.mirrored(point, normal);
        let again = Polygon::new(image.vertices()).unwrap();
        assert!((again.normal() - image.normal()).length() < 1e-15 && (again.area() - image.area()).abs() < 1e-13);
        assert!((again.centroid() - image.centroid()).length() < 1e-14);
        // A point before the front has its image before the image's front, as far.
        let before = DVec3::new(1.0, 1.0, 2.0);
        let there = before - normal * (2.0 * (before - point).dot(normal));
        assert!((image.signed_distance(there) - 2.0).abs() < 1e-14);
        assert!((image.mirrored(point, normal).centroid() - r.centroid()).length() < 1e-14);
    }

    #[test]
    fn collinear_vertices_make_no_polygon() {
        assert_eq!(Polygon::new(&[DVec3::ZERO, DVec3::ONE, DVec3::ONE * 2.0]), Err(PolygonError::NoArea));
    }
}
