//! The scene that several tests share.

use radiosity_geometry::Scene;
use radiosity_io::{ReadOptions, read_scene};

/// The Cornell box with its two blocks, open at the front: three bands, many pairs partly hidden, covered floor.
pub fn cornell_box() -> Scene {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../experiments/scenes/cornell_box.obj");
    read_scene(path.as_ref(), &ReadOptions::default()).unwrap().scene
}
