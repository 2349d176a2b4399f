//! Pictures of a camera: where in a pixel paths begin, and the outlines of lights.
//!
//! A light is far brighter than what it lights, so that pixels on its outline are most of the error of a picture whose other light is found well. There the light
//! itself (class `LE`) is looked at along [`LOOKS`]² rays a sample, one in each cell of a grid of the pixel, and the path that follows adds everything but it. Which
//! pixels these are is known from the scene before any sample, so that every mean stays what it was.
//!
//! What is *not* here: what paths do once they have left the eye, and outlines of lights behind glass, in mirrors or behind what hides a part of them.

use radiosity_core::Cost;

use crate::Camera;
use crate::film::Film;
use crate::numbers::Numbers;
use crate::path_class::{Itinerary, PathClasses};
use crate::stage::Stage;
use crate::walk::Walk;

/// Cells of a pixel along either side.
const LOOKS: u32 = 4;

/// Takes another round of samples of every pixel: `follow(walk, classes, numbers, value)` adds a sample of what a path from the eye finds to `value`.
pub(crate) fn expose(
    stage: &Stage<'_>,
    classes: PathClasses,
    (camera, seed): (&Camera, u64),
    film: &mut Film,
    follow: impl Fn(Walk, PathClasses, &mut Numbers, &mut [f64]) -> Cost + Sync,
) {
    let outlines = outlines(stage, camera);
    let lights = classes.has(Itinerary::default().class());
    film.expose(seed, |[x, y], numbers, value| {
        let look = |u: [f64; 2]| {
            let direction = camera.direction(f64::from(x) + u[0], f64::from(y) + u[1]);
            Walk::from_eye(camera.eye(), direction, stage.bands())
        };
        let u = numbers.draw();
        if !outlines[(y * camera.width() + x) as usize] {
            return follow(look([u[0], u[1]]), classes, numbers, value);
        }
        let mut cost = Cost::default();
        if lights {
            let mut seen = vec![0.0; value.len()];
            for cell in 0..LOOKS * LOOKS {
                let at = |k: u32, u: f64| (f64::from(k) + u) / f64::from(LOOKS);
                look([at(cell % LOOKS, u[2]), at(cell / LOOKS, u[3])]).arrive(stage, PathClasses::ALL, &mut seen);
                cost.rays += 1;
            }
            value.iter_mut().zip(seen).for_each(|(value, seen)| *value += seen / f64::from(LOOKS * LOOKS));
        }
        cost + follow(look([u[0], u[1]]), classes.without(Itinerary::default().class()), numbers, value)
    });
}

/// Which pixels of a camera the edges of lights cross.
fn outlines(stage: &Stage<'_>, camera: &Camera) -> Vec<bool> {
    let mut crossed = vec![false; camera.width() as usize * camera.height() as usize];
    let eye = camera.eye();
    for polygon in stage.lights().filter(|polygon| polygon.signed_distance(eye) > 0.0) {
        for (a, b) in polygon.edges() {
            if let Some(ends) = camera.project(a, b) {
                cross(ends, [camera.width(), camera.height()], &mut crossed);
            }
        }
    }
    crossed
}

/// Marks the pixels that a segment crosses.
fn cross([a, b]: [[f64; 2]; 2], [width, height]: [u32; 2], crossed: &mut [bool]) {
    let (top, bottom) = if a[1] <= b[1] { (a, b) } else { (b, a) };
    // Pixels of a row or column that lie in a range, if any does.
    let pixels = |from: f64, to: f64, count: u32| {
        let within = |x: f64| x.clamp(0.0, f64::from(count) - 0.5) as u32;
        if to < 0.0 || from >= f64::from(count) { 0..0 } else { within(from)..within(to) + 1 }
    };
    for y in pixels(top[1], bottom[1], height) {
        // Where the segment enters and leaves the row.
        let at = |row: f64| {
            let share = (row - top[1]) / (bottom[1] - top[1]);
            top[0] + (bottom[0] - top[0]) * if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 }
        };
        let level = top[1] == bottom[1];
        let (p, q) = if level { (top[0], bottom[0]) } else { (at(f64::from(y)), at(f64::from(y) + 1.0)) };
        for x in pixels(p.min(q), p.max(q), width) {
            crossed[(y * width + x) as usize] = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against small steps along the segment: what they touch is marked, and nothing that is not a pixel away from them.
    #[test]
    fn a_segment_crosses_the_pixels_it_touches() {
        for ends in
            [[[0.5, 0.5], [6.5, 4.2]], [[5.2, 4.9], [-3.0, 1.1]], [[2.5, -9.0], [2.5, 20.0]], [[-1.0, 2.5], [9.0, 2.5]]]
        {
            let mut crossed = vec![false; 7 * 5];
            cross(ends, [7, 5], &mut crossed);
            let mut touched = vec![false; 7 * 5];
            for k in 0..=10_000 {
                let at = |c: usize| ends[0][c] + (ends[1][c] - ends[0][c]) * f64::from(k) / 10_000.0;
                let (x, y) = (at(0).floor(), at(1).floor());
                if (0.0..7.0).contains(&x) && (0.0..5.0).contains(&y) {
                    touched[y as usize * 7 + x as usize] = true;
                }
            }
            assert_eq!(crossed, touched, "{ends:?}");
        }
        let mut crossed = vec![false; 7 * 5];
        cross([[8.0, 1.0], [8.0, 3.0]], [7, 5], &mut crossed);
        assert!(crossed.iter().all(|crossed| !crossed));
    }
}
