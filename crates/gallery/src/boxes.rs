//! Boxes and pairs of rectangles.

use glam::DVec3;
use radiosity_geometry::{Material, Polygon, Scene, Surface};

/// A material of one band.
pub fn material(name: &str, reflectance: f64, emission: f64) -> Material {
    Material::diffuse(name, vec![reflectance], vec![emission])
}

/// A scene of convex planar loops, each with the index of its material; surface k is loop k.
///
/// # Panics
///
/// If a loop is no polygon, a material is missing, or the materials do not fit each other.
pub fn scene_of_loops(loops: &[(Vec<DVec3>, usize)], materials: Vec<Material>) -> Scene {
    let surfaces = loops.iter().enumerate().map(|(k, (vertices, material))| {
        let polygon = Polygon::new(vertices).unwrap_or_else(|fault| panic!("loop {k}: {fault}"));
        Surface { name: format!("surface {k}"), line: 0, material: *material, pieces: vec![polygon] }
    });
    Scene::new(surfaces.collect(), materials).unwrap_or_else(|fault| panic!("{fault}"))
}

/// The face `axis` (0 to 2), low or high, of the box between two corners, as a loop that faces inward.
///
/// With u, v the two axes that follow `axis` (swapped on the high side, so that u × v points inward) the loop runs
/// corner, +u, +u+v, +v: the bilinear parameters of the face are the fractions of its lengths along u and v.
pub fn inward_face(lo: DVec3, hi: DVec3, axis: usize, high: bool) -> Vec<DVec3> {
    let (u, v) = in_plane(axis, high);
    let mut corner = lo;
    if high {
        corner[axis] = hi[axis];
    }
    let along = |axes: &[usize]| {
        let mut vertex = corner;
        axes.iter().for_each(|&axis| vertex[axis] = hi[axis]);
        vertex
    };
    vec![corner, along(&[u]), along(&[u, v]), along(&[v])]
}

/// The axes u, v in a face with u × v inward.
pub(crate) fn in_plane(axis: usize, high: bool) -> (usize, usize) {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    if high { (v, u) } else { (u, v) }
}

/// The six faces of a box in the order x low, x high, y low, y high, z low, z high, facing inward or outward.
pub fn faces(lo: DVec3, hi: DVec3, inward: bool) -> Vec<Vec<DVec3>> {
    (0..6)
        .map(|k| {
            let mut face = inward_face(lo, hi, k / 2, k % 2 == 1);
            if !inward {
                face.reverse();
            }
            face
        })
        .collect()
}

/// The inside of an empty box of edges `size`, one material; row sums of form factors are 1.
///
/// # Panics
///
/// If a length is not finite and positive.
pub fn empty_box(size: [f64; 3], inside: Material) -> Scene {
    let loops: Vec<_> = faces(DVec3::ZERO, DVec3::from(size), true).into_iter().map(|face| (face, 0)).collect();
    scene_of_loops(&loops, vec![inside])
}

/// The inside of the unit cube: F of opposite faces 0.1998248957, of adjacent ones 0.2000437761.
pub fn unit_cube(inside: Material) -> Scene {
    empty_box([1.0; 3], inside)
}

/// A box of edge `side`, seen from outside, in the middle of the unit cube, seen from inside; surfaces 0 to 5 are the
/// cube's, 6 to 11 the box's. Row sums of form factors are 1, and many pairs are partly hidden.
///
/// # Panics
///
/// If `side` is not between 0 and 1.
pub fn box_in_cube(side: f64, room: Material, inner: Material) -> Scene {
    assert!(side > 0.0 && side < 1.0, "a box of side {side} does not fit the unit cube");
    let (lo, hi) = (DVec3::splat(0.5 - 0.5 * side), DVec3::splat(0.5 + 0.5 * side));
    let cube = faces(DVec3::ZERO, DVec3::ONE, true).into_iter().map(|face| (face, 0));
    let inside = faces(lo, hi, false).into_iter().map(|face| (face, 1));
    scene_of_loops(&cube.chain(inside).collect::<Vec<_>>(), vec![room, inner])
}

/// Two equal, directly opposed `a` × `b` rectangles a distance `c` apart, facing each other.
///
/// # Panics
///
/// If a length is not finite and positive.
pub fn parallel_rectangles(a: f64, b: f64, c: f64, material: Material) -> Scene {
    let (lo, hi) = (DVec3::ZERO, DVec3::new(a, b, c));
    let loops = [(inward_face(lo, hi, 2, false), 0), (inward_face(lo, hi, 2, true), 0)];
    scene_of_loops(&loops, vec![material])
}

/// Two rectangles at a right angle with the common edge `edge`: surface 0 reaches `depth` from it, surface 1 `height`.
///
/// # Panics
///
/// If a length is not finite and positive.
pub fn perpendicular_rectangles(depth: f64, height: f64, edge: f64, material: Material) -> Scene {
    let (lo, hi) = (DVec3::ZERO, DVec3::new(depth, edge, height));
    let loops = [(inward_face(lo, hi, 2, false), 0), (inward_face(lo, hi, 0, false), 0)];
    scene_of_loops(&loops, vec![material])
}

/// Two rectangles with the common edge `edge`, which reach `first` and `second` from it and open at `angle` (radians,
/// between 0 and π), facing each other.
///
/// # Panics
///
/// If a length is not finite and positive or the angle makes no hinge.
pub fn hinged_rectangles(first: f64, second: f64, edge: f64, angle: f64, material: Material) -> Scene {
    assert!(angle > 0.0 && angle < std::f64::consts::PI, "an angle of {angle} is no hinge");
    let along = DVec3::Y * edge;
    let (p, q) = (DVec3::X * first, DVec3::new(angle.cos(), 0.0, angle.sin()) * second);
    let loops = [(vec![DVec3::ZERO, p, p + along, along], 0), (vec![DVec3::ZERO, along, along + q, q], 0)];
    scene_of_loops(&loops, vec![material])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey() -> Material {
        material("grey", 0.5, 1.0)
    }

    #[test]
    fn faces_of_a_box_face_its_middle_and_have_its_area() {
        let scene = empty_box([3.0, 5.0, 2.0], grey());
        let middle = DVec3::new(1.5, 2.5, 1.0);
        assert!(scene.pieces().all(|(_, face)| face.signed_distance(middle) > 0.9));
        assert_eq!(scene.area(), 2.0 * (15.0 + 10.0 + 6.0));
    }

    #[test]
    fn a_box_in_a_cube_shows_its_outside() {
        let scene = box_in_cube(0.4, grey(), grey());
        let outward = scene.pieces().filter(|(s, face)| *s >= 6 && face.signed_distance(DVec3::splat(0.5)) < 0.0);
        assert_eq!(outward.count(), 6);
        // 6 + 6 · 0.16, to a few roundings of 0.7 − 0.3.
        assert!((scene.area() - 6.96).abs() < 1e-14);
    }

    #[test]
    fn both_rectangles_of_a_pair_see_each_other() {
        for scene in [
            parallel_rectangles(3.0, 5.0, 2.0, grey()),
            perpendicular_rectangles(2.0, 3.0, 4.0, grey()),
            hinged_rectangles(2.0, 3.0, 4.0, 0.5, grey()),
            hinged_rectangles(2.0, 3.0, 4.0, 2.5, grey()),
        ] {
            let (a, b) = (&scene.surfaces[0].pieces[0], &scene.surfaces[1].pieces[0]);
            assert!(a.signed_distance(b.centroid()) > 0.4 && b.signed_distance(a.centroid()) > 0.4);
        }
        let pair = perpendicular_rectangles(2.0, 3.0, 4.0, grey());
        assert_eq!(pair.surfaces.iter().map(Surface::area).collect::<Vec<_>>(), [8.0, 12.0]);
    }
}
