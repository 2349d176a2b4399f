//! Cornell boxes with specular surfaces.
//!
//! The room of the Cornell measurements to a few millimetres (lengths in decimetres: x to the left of its picture, y up, z away from the camera), open in front, with a
//! larger lamp: 3.6 × 3.2 of 3 W/(m² sr) in the ceiling, so that what it does by way of glass is within reach of a path tracer. A red block stands in
//! the place of the tall one. The wall on the left, x = 5.56, is a mirror.
//!
//! There is no closed form. Light reaches its surfaces in every class of paths, by way of an ideal mirror, of refraction and of a glossy lobe.

use glam::DVec3;
use radiosity_geometry::{Material, Scene, Specular};

use crate::boxes::{inward_face, scene_of_loops};
use crate::sphere;

/// Edges of the room.
const SIZE: DVec3 = DVec3::new(5.56, 5.488, 5.592);
/// The lamp along x and z.
const LAMP: [[f64; 2]; 2] = [[0.98, 4.58], [1.2, 4.4]];
/// Corners of the block's top along x and z, in millimetres as measured, in order so that the loop faces up; and its height.
const BLOCK: ([[u32; 2]; 4], f64) = ([[423, 247], [265, 296], [314, 456], [472, 406]], 3.3);
/// The sphere: its centre, its radius, and rings of facets.
const SPHERE: (DVec3, f64) = (DVec3::new(1.7, 2.2, 1.6), 0.8);
const RINGS: u32 = 10;

/// The surface that is the floor of [`cornell_specular`] and [`mirror_cornell`].
pub const CORNELL_FLOOR: usize = 0;

/// A Cornell box with a mirror for a wall, a glass sphere and a glossy floor.
///
/// Surface 0 is the floor (ρ = 0.3 and a Phong lobe of ρ_s = 0.3, exponent 60), 1 the mirror (ρ_s = 0.9), 2 the back wall, 3 the right one (green), 4 the lamp, 5 to 8
/// the ceiling around it, 9 to 13 the block, and from 14 on the facets of a sphere of clear glass, n = 1.5, that hovers so far above the floor that the
/// lamp's image on it, a caustic, is larger than the sphere.
pub fn cornell_specular() -> Scene {
    let gloss = Specular::Phong { reflectance: vec![0.3; 3], exponent: 60.0 };
    let floor = Material { specular: Some(gloss), ..diffuse("glossy", [0.3; 3]) };
    let mut room = room(floor);
    let glass = Specular::Dielectric { index: 1.5, tint: vec![1.0; 3], roughness: 0.0 };
    room.materials.push(Material { specular: Some(glass), ..diffuse("glass", [0.0; 3]) });
    room.surfaces.extend(sphere(SPHERE.0, SPHERE.1, RINGS, room.materials.len() - 1));
    room
}

/// A Cornell box with a mirror for a wall, and nothing else that is specular: surfaces 0 to 13 of [`cornell_specular`] with a white floor.
pub fn mirror_cornell() -> Scene {
    room(diffuse("floor", WHITE))
}

const WHITE: [f64; 3] = [0.73; 3];

fn diffuse(name: &str, reflectance: [f64; 3]) -> Material {
    Material::diffuse(name, reflectance.to_vec(), vec![0.0; 3])
}

/// Walls, lamp and block over a floor of its own material.
fn room(floor: Material) -> Scene {
    let mirror = Specular::Mirror { reflectance: vec![0.9; 3] };
    let mirror = Material { specular: Some(mirror), ..diffuse("mirror", [0.0; 3]) };
    let lamp = Material::diffuse("lamp", vec![0.0; 3], vec![3.0 * std::f64::consts::PI; 3]);
    let materials = vec![
        floor,
        mirror,
        diffuse("white", WHITE),
        diffuse("green", [0.12, 0.45, 0.15]),
        lamp,
        diffuse("red", [0.65, 0.05, 0.05]),
    ];
    let (white, green, lamp, red) = (2, 3, 4, 5);
    let wall = |axis, high| inward_face(DVec3::ZERO, SIZE, axis, high);
    let ceiling =
        |x: [f64; 2], z: [f64; 2]| inward_face(DVec3::new(x[0], 0.0, z[0]), DVec3::new(x[1], SIZE.y, z[1]), 1, true);
    let [x, z] = LAMP;
    let mut loops = vec![
        (wall(1, false), 0),
        (wall(0, true), 1),
        (wall(2, true), white),
        (wall(0, false), green),
        (ceiling(x, z), lamp),
        (ceiling([0.0, x[0]], [0.0, SIZE.z]), white),
        (ceiling([x[1], SIZE.x], [0.0, SIZE.z]), white),
        (ceiling(x, [0.0, z[0]]), white),
        (ceiling(x, [z[1], SIZE.z]), white),
    ];
    let (corners, height) = BLOCK;
    let decimetres = |millimetres: u32| f64::from(millimetres) / 100.0;
    let [base, top] = [0.0, height].map(|y| corners.map(|[x, z]| DVec3::new(decimetres(x), y, decimetres(z))));
    loops.push((top.to_vec(), red));
    loops.extend((0..4).map(|k| (vec![base[k], base[(k + 1) % 4], top[(k + 1) % 4], top[k]], red)));
    scene_of_loops(&loops, materials)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Area vectors of walls, lamp and ceiling add up to that of the open front; those of the block to its underside; the sphere's to nothing.
    #[test]
    fn the_room_is_closed_but_for_its_front_and_everything_faces_the_right_way() {
        let scene = cornell_specular();
        let sum = |surfaces: std::ops::Range<usize>| -> DVec3 {
            let pieces = scene.surfaces[surfaces].iter().flat_map(|s| &s.pieces);
            pieces.map(|p| p.normal() * p.area()).sum()
        };
        assert!((sum(0..9) - DVec3::NEG_Z * (SIZE.x * SIZE.y)).length() < 1e-12);
        let top = &scene.surfaces[9].pieces[0];
        assert!((sum(9..14) - DVec3::Y * top.area()).length() < 1e-12 && top.normal().y > 0.9);
        assert!(sum(14..scene.surfaces.len()).length() < 1e-12);
        let middle = DVec3::new(2.0, 4.5, 1.0);
        assert!(scene.surfaces[..9].iter().all(|s| s.pieces[0].signed_distance(middle) > 0.9));
        // Sides of the block face away from its middle.
        let inside = DVec3::new(3.7, 1.5, 3.5);
        assert!(scene.surfaces[9..14].iter().all(|s| s.pieces[0].signed_distance(inside) < -0.5));
    }

    #[test]
    fn with_a_mirror_alone_the_rest_is_the_same_room() {
        let (all, mirror) = (cornell_specular(), mirror_cornell());
        assert_eq!(mirror.surfaces[..], all.surfaces[..14]);
        assert_eq!(all.surfaces.len(), 14 + (2 * RINGS * RINGS) as usize);
        let specular =
            |scene: &Scene| scene.surfaces.iter().filter(|s| scene.materials[s.material].specular.is_some()).count();
        assert_eq!((specular(&mirror), specular(&all)), (1, 2 + (2 * RINGS * RINGS) as usize));
    }
}
