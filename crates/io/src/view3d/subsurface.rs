//! Windows in walls: subsurfaces cut out of their base surfaces.

use radiosity_geometry::Polygon;

/// A subsurface lies in the plane of its base if no vertex is further from it than this share of its diameter.
const PLANE: f64 = 1e-5;
/// Cosine from which on two normals count as parallel.
const PARALLEL: f64 = 0.999;
/// Share of the area of a subsurface that may stick out of its base.
const OUTSIDE: f64 = 1e-6;
/// Vertices closer to a cut than this share of the diameter lie on it.
const SNAP: f64 = 1e-9;

/// Cuts `window` out of the convex pieces `wall`, to which it turns the same side if `same_side` and its back otherwise.
///
/// # Errors
///
/// What is wrong, as part of a sentence: "subsurface k … its base surface".
pub(super) fn cut_out(
    wall: &[Polygon],
    plane: &Polygon,
    window: &Polygon,
    same_side: bool,
) -> Result<Vec<Polygon>, &'static str> {
    let size = window.diameter();
    if window.vertices().iter().any(|v| plane.signed_distance(*v).abs() > PLANE * size) {
        return Err("does not lie in the plane of");
    }
    let cosine = window.normal().dot(plane.normal());
    match same_side {
        true if cosine < PARALLEL => return Err("does not face the same way as"),
        false if cosine > -PARALLEL => return Err("is a null surface and does not face"),
        _ => {}
    }
    let mut left = Vec::with_capacity(wall.len() + 4);
    let mut removed = 0.0;
    for piece in wall {
        removed += subtract(piece, window, &mut left);
    }
    let missing = window.area() - removed;
    if missing.abs() > OUTSIDE * window.area() { Err("does not lie within what is left of") } else { Ok(left) }
}

/// Puts the convex parts of `piece` outside `window` into `left` and gives the area of what lies inside.
fn subtract(piece: &Polygon, window: &Polygon, left: &mut Vec<Polygon>) -> f64 {
    let snap = SNAP * piece.diameter();
    let (mut inside, mut outside) = (piece.clone(), Vec::new());
    for (a, b) in window.edges() {
        let Some(inward) = window.normal().cross(b - a).try_normalize() else { continue };
        let depths = || inside.vertices().iter().map(|v| (*v - a).dot(inward));
        if depths().all(|d| d >= -snap) {
            continue;
        }
        if depths().all(|d| d <= snap) {
            left.push(piece.clone());
            return 0.0;
        }
        // A part without an area stays with the rest.
        if let Some((within, beyond)) = inside.split(a, inward, snap) {
            outside.push(beyond);
            inside = within;
        }
    }
    left.append(&mut outside);
    inside.area()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn rectangle(x: (f64, f64), y: (f64, f64), z: f64) -> Polygon {
        let corners = [(x.0, y.0), (x.1, y.0), (x.1, y.1), (x.0, y.1)];
        Polygon::new(&corners.map(|(x, y)| DVec3::new(x, y, z))).unwrap()
    }

    fn reversed(polygon: &Polygon) -> Polygon {
        Polygon::new(&polygon.vertices().iter().rev().copied().collect::<Vec<_>>()).unwrap()
    }

    fn area(pieces: &[Polygon]) -> f64 {
        pieces.iter().map(Polygon::area).sum()
    }

    /// 6 × 3 less 1 × 2 at the lower edge less 2 × 1 inside: 14.
    #[test]
    fn a_door_and_a_window_leave_the_rest_of_the_wall() {
        let wall = rectangle((0.0, 6.0), (0.0, 3.0), 0.0);
        let (door, window) = (rectangle((1.0, 2.0), (0.0, 2.0), 0.0), rectangle((3.0, 5.0), (1.0, 2.0), 0.0));
        let left = cut_out(std::slice::from_ref(&wall), &wall, &door, true).unwrap();
        let left = cut_out(&left, &wall, &window, true).unwrap();
        assert!((area(&left) - 14.0).abs() < 1e-13);
        for hole in [&door, &window] {
            let inside = hole.centroid();
            let holds = |p: &Polygon| p.edges().all(|(a, b)| (b - a).cross(inside - a).dot(p.normal()) > 0.0);
            assert!(!left.iter().any(holds));
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let wall = rectangle((0.0, 6.0), (0.0, 3.0), 0.0);
        let cut = |window: &Polygon, same: bool| cut_out(std::slice::from_ref(&wall), &wall, window, same);
        assert!(cut(&rectangle((5.0, 7.0), (1.0, 2.0), 0.0), true).unwrap_err().contains("within"));
        assert!(cut(&rectangle((7.0, 8.0), (1.0, 2.0), 0.0), true).unwrap_err().contains("within"));
        assert!(cut(&rectangle((1.0, 2.0), (1.0, 2.0), 0.1), true).unwrap_err().contains("plane"));
        let window = rectangle((1.0, 2.0), (1.0, 2.0), 0.0);
        assert!(cut(&reversed(&window), true).unwrap_err().contains("same way"));
        assert!(cut(&window, false).unwrap_err().contains("null"));
        assert!((area(&cut(&reversed(&window), false).unwrap()) - 17.0).abs() < 1e-13);
    }

    /// The second of two windows that overlap no longer finds all of its wall.
    #[test]
    fn windows_that_overlap_are_refused() {
        let wall = rectangle((0.0, 6.0), (0.0, 3.0), 0.0);
        let (a, b) = (rectangle((1.0, 3.0), (1.0, 2.0), 0.0), rectangle((2.0, 4.0), (1.0, 2.0), 0.0));
        let left = cut_out(std::slice::from_ref(&wall), &wall, &a, true).unwrap();
        assert!(cut_out(&left, &wall, &b, true).unwrap_err().contains("within"));
    }
}
