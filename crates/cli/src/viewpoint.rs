//! Where the camera stands if nobody says.
//!
//! - Up is the coordinate axis from which most light comes, since lamps hang from ceilings; y, as is usual in OBJ files, if the scene has no light.
//! - The view runs along the longest of the other two axes of the box around the scene, at half height, and looks at its middle.
//! - An end of the box where nothing closes the scene is a window: the camera stands outside of it, where the whole box fits into the picture. Where both ends are closed,
//!   it stands inside, before the middle of the lower end.
//!
//! What is *not* here: a search for the best view. A camera that ends up inside a solid needs `--eye`.

use glam::DVec3;
use radiosity_geometry::{Occluders, Scene};
use radiosity_render::Camera;
use serde_json::{Value, json};

use crate::Failure;
use crate::args::ViewArgs;

/// Distance from the end of a closed scene as a share of its length.
const BEFORE_THE_END: f64 = 0.05;

/// A camera with what it was made from.
pub struct Viewpoint {
    /// The camera.
    pub camera: Camera,
    eye: DVec3,
    look_at: DVec3,
    up: DVec3,
    fov: f64,
}

impl Viewpoint {
    /// The camera asked for, with what is not asked for chosen to suit the scene.
    pub fn new(view: &ViewArgs, scene: &Scene) -> Result<Self, Failure> {
        let (lo, hi) = scene.bounds();
        let middle = lo + (hi - lo) * 0.5;
        let up = view.up.unwrap_or_else(|| light_side(scene));
        let [width, height] = view.size;
        let look_at = view.look_at.unwrap_or(middle);
        let eye = match view.eye {
            Some(eye) => eye,
            None => stand(scene, up, view)?,
        };
        let camera = Camera::new(eye, look_at, up, view.fov, width, height)?;
        Ok(Self { camera, eye, look_at, up, fov: view.fov })
    }

    /// The camera as JSON.
    pub fn json(&self) -> Value {
        let list = |v: DVec3| v.to_array();
        let size = [self.camera.width(), self.camera.height()];
        json!({ "eye": list(self.eye), "look_at": list(self.look_at), "up": list(self.up), "fov": self.fov, "size": size })
    }
}

/// The axis from which most light comes; y if there is none.
fn light_side(scene: &Scene) -> DVec3 {
    let power = |s: usize| scene.materials[scene.surfaces[s].material].emission.iter().sum::<f64>();
    let flow: DVec3 = scene.pieces().map(|(s, p)| p.normal() * (p.area() * power(s))).sum();
    // Sums in which directions cancel to rounding point nowhere.
    let total: f64 = scene.pieces().map(|(s, p)| p.area() * power(s)).sum();
    let k = flow.abs().max_position();
    if flow.abs()[k] <= 1e-9 * total {
        return DVec3::Y;
    }
    -DVec3::AXES[k] * flow[k].signum()
}

/// The default place of the eye.
fn stand(scene: &Scene, up: DVec3, view: &ViewArgs) -> Result<DVec3, Failure> {
    let (lo, hi) = scene.bounds();
    let (size, middle) = (hi - lo, lo + (hi - lo) * 0.5);
    if size.min_element() <= 0.0 {
        return Err("the scene is flat, so that no view of it suggests itself; give --eye and --look-at".into());
    }
    let vertical = up.abs().max_position();
    let along = (0..3).filter(|k| *k != vertical).max_by(|a, b| size[*a].total_cmp(&size[*b]).then(b.cmp(a)));
    let axis = along.map_or(DVec3::X, |k| DVec3::AXES[k]);
    let length = size.dot(axis);
    let inside = |towards: DVec3| middle + towards * (length * (0.5 - BEFORE_THE_END));
    let walls = Occluders::of_scene(scene);
    let open = [-axis, axis].into_iter().find(|towards| walls.first_hit(inside(*towards), *towards).is_none());
    match open {
        Some(towards) => {
            let [width, height] = view.size;
            Ok(Camera::framing((lo, hi), -towards, up, view.fov, width, height)?.eye())
        }
        None => Ok(inside(-axis)),
    }
}
