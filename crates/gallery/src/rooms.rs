//! Rooms of which a solution can leave parts out.

use glam::DVec3;
use radiosity_geometry::{Material, Scene};

use crate::boxes::{faces, scene_of_loops};

/// Edges of the first room of [`two_rooms`]; the second is a third as long.
const SIZE: [f64; 3] = [3.0, 4.0, 2.0];

fn bands(name: &str, reflectance: [f64; 3], emission: [f64; 3]) -> Material {
    Material::diffuse(name, reflectance.to_vec(), emission.to_vec())
}

/// Two rooms wall to wall, of coloured walls, each with a ceiling that emits if `lit` says so. Surfaces 0 to 5 are the first, 6 to 11 the second
/// room, ceilings last.
pub fn two_rooms(lit: [bool; 2]) -> Scene {
    let [x, y, z] = SIZE;
    let first = faces(DVec3::ZERO, DVec3::new(x, y, z), true);
    let second = faces(DVec3::new(x, 0.0, 0.0), DVec3::new(x / 3.0 + x, y, z), true);
    let rooms = [first, second].into_iter().zip(lit);
    let with_ceiling = |(room, lit): (Vec<Vec<DVec3>>, bool)| {
        (0..).zip(room).map(move |(k, face)| (face, if k == 5 && lit { 2 } else { k % 2 })).collect::<Vec<_>>()
    };
    let loops: Vec<_> = rooms.flat_map(with_ceiling).collect();
    let walls = [bands("red", [0.6, 0.2, 0.1], [0.0; 3]), bands("blue", [0.1, 0.3, 0.7], [0.0; 3])];
    let lamp = bands("lamp", [0.2, 0.3, 0.4], [3.0, 2.0, 1.0]);
    scene_of_loops(&loops, walls.into_iter().chain([lamp]).collect())
}

/// The first of [`two_rooms`] alone, lit.
pub fn one_room() -> Scene {
    let Scene { mut surfaces, materials } = two_rooms([true, false]);
    surfaces.truncate(6);
    Scene { surfaces, materials }
}

/// A grey room under a ceiling of white light, or of any other colour.
pub fn grey_room(light: [f64; 3]) -> Scene {
    let loops: Vec<_> = (0..).zip(faces(DVec3::ZERO, SIZE.into(), true)).map(|(k, face)| (face, k / 5)).collect();
    scene_of_loops(&loops, vec![bands("grey", [0.5; 3], [0.0; 3]), bands("lamp", [0.3; 3], light)])
}

/// A room with a black floor, surface 4, and a black sheet over a part of it, 6: the one receives light, the other takes it away as well.
pub fn black_floor() -> Scene {
    let mut loops: Vec<_> = faces(DVec3::ZERO, SIZE.into(), true).into_iter().map(|face| (face, 0)).collect();
    (loops[4].1, loops[5].1) = (1, 2);
    let sheet = [(1.0, 1.0), (2.0, 1.0), (2.0, 2.5), (1.0, 2.5)].map(|(x, y)| DVec3::new(x, y, 0.75));
    loops.push((sheet.to_vec(), 1));
    let walls = bands("walls", [0.6, 0.5, 0.1], [0.0; 3]);
    scene_of_loops(&loops, vec![walls, bands("black", [0.0; 3], [0.0; 3]), bands("lamp", [0.2; 3], [3.0, 2.0, 1.0])])
}

/// Surfaces of a storey of [`tower`].
pub const STOREY: usize = 12;

/// Rooms one over the other, each with a block on its floor, a black sheet beside it, and a ceiling that emits if `lit` says so, all of them grey
/// under light of one colour: a scene in which everything can be left out that a plan knows of. Of each [`STOREY`] surfaces 0 to 5 are the
/// room, ceiling last, 6 to 10 the block without its bottom, and 11 the sheet.
pub fn tower(lit: &[bool]) -> Scene {
    let [x, y, z] = SIZE;
    let storey = |(k, lit): (usize, &bool)| {
        let (floor, ceiling) = (z * k as f64, z * (k + 1) as f64);
        let room = faces(DVec3::new(0.0, 0.0, floor), DVec3::new(x, y, ceiling), true).into_iter();
        let mut loops: Vec<_> = room.map(|face| (face, 0)).collect();
        loops[5].1 = if *lit { 2 } else { 0 };
        let block = faces(DVec3::new(0.75, 2.0, floor), DVec3::new(1.75, 3.25, floor + 1.0), false).into_iter();
        loops.extend(block.enumerate().filter(|(face, _)| *face != 4).map(|(_, face)| (face, 1)));
        let sheet = [(1.0, 0.5), (2.5, 0.5), (2.5, 1.5), (1.0, 1.5)].map(|(x, y)| DVec3::new(x, y, floor + 0.75));
        loops.push((sheet.to_vec(), 3));
        loops
    };
    let loops: Vec<_> = lit.iter().enumerate().flat_map(storey).collect();
    let grey = |name, reflectance, emission: [f64; 3]| bands(name, [reflectance; 3], emission);
    let lamp = grey("lamp", 0.3, [4.0, 2.0, 1.0]);
    scene_of_loops(
        &loops,
        vec![grey("walls", 0.5, [0.0; 3]), grey("block", 0.7, [0.0; 3]), lamp, grey("black", 0.0, [0.0; 3])],
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_room_has_its_walls_and_the_lamps_asked_for() {
        let emitters = |scene: &Scene| -> Vec<usize> {
            let emits = |s: &usize| scene.materials[scene.surfaces[*s].material].emission[0] > 0.0;
            (0..scene.surfaces.len()).filter(emits).collect()
        };
        assert_eq!(emitters(&two_rooms([true, true])), [5, 11]);
        assert_eq!(emitters(&two_rooms([false, true])), [11]);
        assert_eq!(emitters(&one_room()), [5]);
        let tower = tower(&[true, false, true]);
        assert_eq!((tower.surfaces.len(), emitters(&tower)), (3 * STOREY, vec![5, 2 * STOREY + 5]));
        // 2·(12 + 6 + 8) and 2·(4 + 2 + 8), to the rounding of 3 + 3/3.
        assert!((two_rooms([true, true]).area() - 80.0).abs() < 1e-13);
    }
}
