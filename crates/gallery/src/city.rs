//! A generated city block: many facets of which most do not see each other.

use glam::DVec3;
use radiosity_geometry::Scene;

use crate::boxes::{material, scene_of_loops};
use crate::random_enclosure::uniform;

/// Edge of a building in metres, and width of a street.
const BUILDING: f64 = 16.0;
const STREET: f64 = 12.0;

/// `blocks` × `blocks` buildings of 16 × 16 m between streets of 12 m, every wall and roof in `panels` × `panels` facets, the ground in
/// tiles: the scene of an urban energy balance (facets exchange what they emit at their own temperature; the sky takes the rest).
///
/// Heights lie between 8 and 40 m. Ground tiles are 4 m wide (streets and crossings) and none lie under a building, so facets touch along
/// edges only. Everything reflects 0.2 and emits between 350 and 550 W/m² in four steps. The number of surfaces is
///
/// ```text
/// 5 · panels² · blocks² + ((28·blocks + 12)² − 256·blocks²)/16
/// ```
///
/// which is 22,745 for 14 blocks and 4 panels. The same seed gives the same bytes. No answer is known in closed form.
pub fn city(blocks: u32, panels: u32, seed: u64) -> Scene {
    let mut state = seed;
    let mut loops = Vec::new();
    let pitch = BUILDING + STREET;
    // A rectangle from a corner along u and v, facing u × v, in cells; its temperature is drawn cell by cell.
    let mut tiled = |state: &mut u64, corner: DVec3, u: DVec3, v: DVec3, cells: [u32; 2]| {
        let at = |i: u32, j: u32| {
            corner + u * (f64::from(i) / f64::from(cells[0])) + v * (f64::from(j) / f64::from(cells[1]))
        };
        for j in 0..cells[1] {
            for i in 0..cells[0] {
                let warmth = (4.0 * uniform(state)) as usize;
                loops.push((vec![at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)], warmth));
            }
        }
    };
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    for row in 0..blocks {
        for column in 0..blocks {
            let corner = x * (STREET + pitch * f64::from(column)) + y * (STREET + pitch * f64::from(row));
            let height = 8.0 + 32.0 * uniform(&mut state);
            let (u, v, up) = (x * BUILDING, y * BUILDING, z * height);
            let cells = [panels; 2];
            tiled(&mut state, corner + up, u, v, cells);
            tiled(&mut state, corner, u, up, cells);
            tiled(&mut state, corner + u, v, up, cells);
            tiled(&mut state, corner + u + v, -u, up, cells);
            tiled(&mut state, corner + v, -v, up, cells);
        }
    }
    // Streets along x over the whole width, and between them the parts along y.
    let tiles = |length: f64| (length / 4.0) as u32;
    let width = pitch * f64::from(blocks) + STREET;
    for street in 0..=blocks {
        let begin = y * (pitch * f64::from(street));
        tiled(&mut state, begin, x * width, y * STREET, [tiles(width), tiles(STREET)]);
        if street < blocks {
            for column in 0..=blocks {
                let corner = begin + y * STREET + x * (pitch * f64::from(column));
                tiled(&mut state, corner, x * STREET, y * BUILDING, [tiles(STREET), tiles(BUILDING)]);
            }
        }
    }
    let materials = (0..4).map(|k| material(&format!("warmth {k}"), 0.2, 350.0 + 200.0 / 3.0 * f64::from(k)));
    scene_of_loops(&loops, materials.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Walls and roofs of three buildings' heights aside, areas are known: ground (28·3 + 12)² − 9·256, roofs 9·256.
    #[test]
    fn a_city_has_the_facets_and_the_ground_it_says() {
        let scene = city(3, 2, 5);
        assert_eq!(scene.surfaces.len(), 5 * 4 * 9 + (96 * 96 - 256 * 9) / 16);
        let up = |z: bool| {
            let flat = scene.pieces().filter(move |(_, p)| p.normal().z > 0.5 && (p.centroid().z > 0.0) == z);
            flat.map(|(_, p)| p.area()).sum::<f64>()
        };
        assert!((up(false) - (96.0 * 96.0 - 2304.0)).abs() < 1e-9 && (up(true) - 2304.0).abs() < 1e-9);
        // Nothing faces down, and walls face away from their building's middle.
        assert!(scene.pieces().all(|(_, p)| p.normal().z > -1e-12));
        let first = &scene.surfaces[4].pieces[0];
        assert!(first.normal().y < -0.99 && first.centroid().y == 12.0);
        assert_eq!(scene, city(3, 2, 5));
    }

    #[test]
    fn fourteen_blocks_of_four_panels_have_22_745_facets() {
        assert_eq!(city(14, 4, 1).surfaces.len(), 22_745);
    }
}
