//! A closed room with any number of boxes standing in it.

use glam::DVec3;
use radiosity_geometry::Scene;

use crate::boxes::{faces, inward_face, material, scene_of_loops};
use crate::random_enclosure::uniform;

/// A room of 4 × 3 × 2.5 with a ceiling light of 1 × 0.75 and `boxes` boxes standing on its floor, no two of them touching.
///
/// Boxes stand in the cells of the squarest grid that has room for them, off its middle, and take about a quarter of the floor however
/// many there are; their heights lie between half and one and a half times their width. Surfaces 0 to 5 are the room, with
/// a hole of the light's size in its ceiling left by four strips (6 to 9 with the light), then five faces a box: the bottom stands on
/// the floor. Reflectances are 0.7 (room) and 0.5 (boxes); the light emits 20 W/m². The same seed gives the same bytes.
///
/// There is no closed form: what is known is that nothing leaves.
pub fn crowded_room(boxes: u32, seed: u64) -> Scene {
    let (lo, hi) = (DVec3::ZERO, DVec3::new(4.0, 3.0, 2.5));
    let mut loops: Vec<(Vec<DVec3>, usize)> = (0..5).map(|k| (inward_face(lo, hi, k / 2, k % 2 == 1), 0)).collect();
    // The ceiling: the light and four strips around it.
    let (x, y) = ([0.0, 1.5, 2.5, 4.0], [0.0, 1.125, 1.875, 3.0]);
    let down = |x: [f64; 2], y: [f64; 2]| {
        [(x[0], y[0]), (x[0], y[1]), (x[1], y[1]), (x[1], y[0])].map(|(x, y)| DVec3::new(x, y, hi.z)).to_vec()
    };
    loops.push((down([x[1], x[2]], [y[1], y[2]]), 1));
    loops.push((down([x[0], x[1]], [y[0], y[3]]), 0));
    loops.push((down([x[2], x[3]], [y[0], y[3]]), 0));
    loops.push((down([x[1], x[2]], [y[0], y[1]]), 0));
    loops.push((down([x[1], x[2]], [y[2], y[3]]), 0));
    // Boxes in a grid of cells nearly square.
    let columns = (f64::from(boxes) * 4.0 / 3.0).sqrt().ceil().max(1.0) as u32;
    let rows = boxes.div_ceil(columns).max(1);
    let cell = (4.0 / f64::from(columns), 3.0 / f64::from(rows));
    let mut state = seed;
    for k in 0..boxes {
        let (column, row) = (f64::from(k % columns), f64::from(k / columns));
        let mut within = |range: [f64; 2]| range[0] + (range[1] - range[0]) * uniform(&mut state);
        let size = (cell.0 * within([0.4, 0.6]), cell.1 * within([0.4, 0.6]));
        let height = (0.5 * (size.0 + size.1) * within([0.5, 1.5])).min(2.0);
        let corner = DVec3::new(
            column * cell.0 + (cell.0 - size.0) * within([0.1, 0.9]),
            row * cell.1 + (cell.1 - size.1) * within([0.1, 0.9]),
            0.0,
        );
        let top = corner + DVec3::new(size.0, size.1, height);
        // All faces but the bottom, which is number 4.
        let outside = faces(corner, top, false).into_iter().enumerate().filter(|(face, _)| *face != 4);
        loops.extend(outside.map(|(_, face)| (face, 2)));
    }
    scene_of_loops(&loops, vec![material("room", 0.7, 0.0), material("light", 0.0, 20.0), material("box", 0.5, 0.0)])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The inside of the room, and no box through another or a wall: their bounds are disjoint.
    #[test]
    fn any_number_of_boxes_stands_apart_on_the_floor() {
        for boxes in [0, 1, 5, 64, 256] {
            let scene = crowded_room(boxes, 7);
            assert_eq!(scene.surfaces.len(), 10 + 5 * boxes as usize);
            let ceiling: f64 = scene.surfaces[5..10].iter().map(|s| s.area()).sum();
            assert!((ceiling - 12.0).abs() < 1e-12);
            let bounds: Vec<_> = scene.surfaces[10..]
                .chunks(5)
                .map(|faces| {
                    let corners = || faces.iter().flat_map(|f| f.pieces[0].vertices());
                    corners().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), v| (lo.min(*v), hi.max(*v)))
                })
                .collect();
            for (k, (lo, hi)) in bounds.iter().enumerate() {
                assert!(lo.min_element() >= 0.0 && lo.z == 0.0 && hi.x < 4.0 && hi.y < 3.0 && hi.z < 2.5);
                let apart = |(l, h): &(DVec3, DVec3)| l.x > hi.x || h.x < lo.x || l.y > hi.y || h.y < lo.y;
                assert!(bounds[..k].iter().all(apart), "box {k} of {boxes}");
            }
        }
        assert_eq!(crowded_room(9, 3), crowded_room(9, 3));
    }
}
