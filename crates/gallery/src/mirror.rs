//! Rooms with a mirror, and what they look like through it.
//!
//! Behind a perfect planar mirror there is the same room once more, mirrored: a scene in which the mirror is a hole into that copy has the same light on
//! the near side, surface by surface, and needs no specular transport. So any two ways of solving the two check each other.

use glam::DVec3;
use radiosity_geometry::{Material, Scene, Specular, Surface};

use crate::boxes::{faces, inward_face, material, scene_of_loops};

/// A room of 3 × 2 × 2.5 with a mirror in its wall x = 0, a lamp below its ceiling and a block on its floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorRoom {
    /// Reflectance ρ_s of the mirror; 1 is perfect.
    pub mirror: f64,
    /// Range of the mirror along y, from 0 to 2, and along z, from 0 to 2.5; as large as the wall, or a part of it.
    pub opening: [[f64; 2]; 2],
    /// Reflectance ρ of everything else.
    pub reflectance: f64,
    /// Whether the block is there.
    pub block: bool,
}

impl Default for MirrorRoom {
    /// A perfect mirror as large as the wall, ρ = 0.5, with the block.
    fn default() -> Self {
        Self { mirror: 1.0, opening: [[0.0, 2.0], [0.0, 2.5]], reflectance: 0.5, block: true }
    }
}

/// The room's edges.
const SIZE: DVec3 = DVec3::new(3.0, 2.0, 2.5);

impl MirrorRoom {
    /// The surface that is the mirror.
    pub const MIRROR: usize = 0;

    /// Surface 0 is the mirror, 1 the lamp, 2 to 6 the walls x high, y low, y high, z low, z high; then what is left of the mirror's wall, and the block.
    ///
    /// # Panics
    ///
    /// If the opening is no rectangle of the wall.
    pub fn scene(&self) -> Scene {
        let [[y0, y1], [z0, z1]] = self.opening;
        assert!(0.0 <= y0 && y0 < y1 && y1 <= SIZE.y && 0.0 <= z0 && z0 < z1 && z1 <= SIZE.z, "{:?}", self.opening);
        let wall = |y: [f64; 2], z: [f64; 2]| {
            inward_face(DVec3::new(0.0, y[0], z[0]), DVec3::new(SIZE.x, y[1], z[1]), 0, false)
        };
        let (wall_material, lamp_material, mirror_material) = (0, 1, 2);
        let (lo, hi) = (DVec3::new(1.2, 0.8, 0.0), DVec3::new(1.9, 1.3, 2.4));
        let lamp = inward_face(lo, hi, 2, true);
        let mut loops = vec![(wall([y0, y1], [z0, z1]), mirror_material), (lamp, lamp_material)];
        loops.extend((1..6).map(|k| (inward_face(DVec3::ZERO, SIZE, k / 2, k % 2 == 1), wall_material)));
        // Beside the opening, over its height; then over its whole width above and below.
        let rest = [
            ([0.0, y0], [z0, z1]),
            ([y1, SIZE.y], [z0, z1]),
            ([0.0, SIZE.y], [0.0, z0]),
            ([0.0, SIZE.y], [z1, SIZE.z]),
        ];
        let rest = rest.into_iter().filter(|(y, z)| y[0] < y[1] && z[0] < z[1]);
        loops.extend(rest.map(|(y, z)| (wall(y, z), wall_material)));
        if self.block {
            let block = faces(DVec3::new(0.7, 0.5, 0.0), DVec3::new(1.3, 1.1, 0.9), false);
            // Its underside stands on the floor.
            loops.extend((0..6).filter(|k| *k != 4).map(|k| (block[k].clone(), wall_material)));
        }
        let mirror = Material {
            specular: Some(Specular::Mirror { reflectance: vec![self.mirror] }),
            ..material("mirror", 0.0, 0.0)
        };
        scene_of_loops(&loops, vec![material("wall", self.reflectance, 0.0), material("lamp", 0.0, 10.0), mirror])
    }
}

/// `scene` with its surface `mirror` taken out, and beyond it everything else once more, mirrored: surface k < `mirror` stays surface k, those after it move up
/// by one, and images follow in the same order.
///
/// All of the scene must lie on the front of that surface, which is one piece.
///
/// # Panics
///
/// If there is no such surface, or it has not one piece.
pub fn opened(scene: &Scene, mirror: usize) -> Scene {
    let [plane] = &scene.surfaces[mirror].pieces[..] else { panic!("a mirror of one piece") };
    let kept = || scene.surfaces.iter().enumerate().filter(|(k, _)| *k != mirror).map(|(_, s)| s);
    let image = |surface: &Surface| Surface {
        pieces: surface.pieces.iter().map(|p| p.mirrored(plane.centroid(), plane.normal())).collect(),
        ..surface.clone()
    };
    let surfaces = kept().cloned().chain(kept().map(image)).collect();
    Scene { surfaces, materials: scene.materials.clone() }
}

#[cfg(test)]
mod tests {
    use radiosity_geometry::Polygon;

    use super::*;

    #[test]
    fn the_opened_room_is_twice_as_long_and_closed() {
        let scene = MirrorRoom::default().scene();
        let opened = opened(&scene, MirrorRoom::MIRROR);
        assert_eq!(opened.surfaces.len(), 2 * (scene.surfaces.len() - 1));
        let (lo, hi) = opened.bounds();
        assert_eq!((lo, hi), (DVec3::new(-3.0, 0.0, 0.0), SIZE));
        // Closed: the area vectors of walls (without lamp and block) add up to nothing.
        let walls = (2..7).flat_map(|k| [k - 1, k - 1 + scene.surfaces.len() - 1]);
        let sum: DVec3 = walls.map(|k| &opened.surfaces[k].pieces[0]).map(|p| p.normal() * p.area()).sum();
        assert!(sum.length() < 1e-12);
    }

    #[test]
    fn what_is_left_of_the_wall_fills_it() {
        let part = MirrorRoom { opening: [[0.3, 1.6], [0.5, 2.5]], ..MirrorRoom::default() };
        let scene = part.scene();
        let wall: f64 = scene
            .surfaces
            .iter()
            .flat_map(|s| &s.pieces)
            .filter(|p| p.normal() == DVec3::X && p.centroid().x == 0.0)
            .map(Polygon::area)
            .sum();
        assert!((wall - 5.0).abs() < 1e-14);
    }
}
