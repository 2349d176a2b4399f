//! Inputs shared by the benches: scenes, meshes, rows and values, the same bytes in every run.
//!
//! What is *not* here: anything that is timed.

use std::path::Path;

use glam::DVec3;
use radiosity::{Geometry, Method, Strategy};
use radiosity_core::{BandValues, Cost, StoreError};
use radiosity_form_factors::Rows;
use radiosity_gallery::RandomEnclosure;
use radiosity_gallery::boxes::{faces, material, unit_cube};
use radiosity_geometry::{Polygon, Scene, Subdivision};
use radiosity_io::{ReadOptions, read_scene};

/// Seed of everything random.
pub const SEED: u64 = 1;

/// The Cornell box of the experiments.
///
/// # Panics
///
/// If the file is not where the workspace has it.
pub fn cornell() -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../experiments/scenes/cornell_box.obj");
    read_scene(&path, &ReadOptions::default()).unwrap_or_else(|error| panic!("{error}")).scene
}

/// The inside of the unit cube, in which nothing blocks.
pub fn empty_cube() -> Scene {
    unit_cube(material("grey", 0.5, 1.0))
}

/// A scene cut into K × K elements a face.
///
/// # Panics
///
/// If K makes no mesh.
pub fn geometry(scene: &Scene, k: u32) -> Geometry<'_> {
    let mesh = Strategy::new(Subdivision::Uniform(k), Method::ANALYTIC).mesh;
    Geometry::new(scene, &mesh).unwrap_or_else(|error| panic!("{error}"))
}

/// 10,008 triangles: the unit cube seen from inside, and in it 833 small boxes at the places of a 10 × 10 × 10 grid.
pub fn furnished_cube() -> Vec<Polygon> {
    let mut boxes = vec![(DVec3::ZERO, DVec3::ONE, true)];
    for k in 0..833 {
        let cell = DVec3::new((k % 10) as f64, (k / 10 % 10) as f64, (k / 100) as f64);
        let lo = (cell + 0.3) / 10.0;
        boxes.push((lo, lo + DVec3::new(0.03, 0.04, 0.05), false));
    }
    let loops = boxes.into_iter().flat_map(|(lo, hi, inward)| faces(lo, hi, inward));
    loops.flat_map(|face| [[face[0], face[1], face[2]], [face[0], face[2], face[3]]]).map(triangle).collect()
}

fn triangle(vertices: [DVec3; 3]) -> Polygon {
    Polygon::new(&vertices).unwrap_or_else(|fault| panic!("{fault}"))
}

/// `count` pairs of points on two different polygons each, chosen evenly among the polygons.
///
/// # Panics
///
/// If there are fewer than two polygons.
pub fn segments(polygons: &[Polygon], count: usize) -> Vec<(DVec3, DVec3)> {
    assert!(polygons.len() >= 2, "segments run between two polygons, got {}", polygons.len());
    // Steps of the golden ratio and of others like it (R. Kronecker's sequence): spread without a pattern.
    let spread = |k: usize, step: f64| ((k + 1) as f64 * step).fract();
    let pick = |k: usize, step: f64| (spread(k, step) * polygons.len() as f64) as usize;
    let segment = |k: usize| {
        let i = pick(k, 0.618_033_988_749_895);
        let j = (i + 1 + pick(k, 0.754_877_666_246_693) % (polygons.len() - 1)) % polygons.len();
        let from = polygons[i].sample(spread(k, 0.569_840_290_998_053), spread(k, 0.819_172_513_396_164));
        let to = polygons[j].sample(spread(k, 0.671_043_606_703_789), spread(k, 0.856_674_883_854_503));
        (from, to)
    };
    (0..count).map(segment).collect()
}

/// Rows of a random enclosure as a row-wise estimator would give them: nothing says that they are symmetric, so a
/// scatter is no gather in disguise, and all but one entry of `one_in` may be hidden.
pub struct RowWise {
    enclosure: RandomEnclosure,
    one_in: usize,
}

impl RowWise {
    /// Rows of n elements, of which one entry in `one_in` is not zero.
    pub fn new(n: usize, one_in: usize) -> Self {
        Self { enclosure: RandomEnclosure::new(n, SEED), one_in }
    }
}

impl Rows for RowWise {
    fn name(&self) -> &'static str {
        "random-enclosure"
    }

    fn sources(&self) -> usize {
        self.enclosure.len()
    }

    fn targets(&self) -> usize {
        self.enclosure.len()
    }

    fn symmetric(&self) -> bool {
        false
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        let spent = self.enclosure.row(s, values)?;
        // Runs of targets in turn: what is hidden lies together, as behind a real blocker.
        let hidden = |t: &usize| !(s + t / 16).is_multiple_of(self.one_in);
        (0..values.len()).filter(hidden).for_each(|t| values[t] = 0.0);
        Ok(spent)
    }
}

/// Values in `bands` bands, none of them zero.
pub fn values(bands: usize, len: usize) -> BandValues {
    BandValues::new((0..bands * len).map(|k| ((k * 37 + 11) % 101 + 1) as f64 / 50.0).collect(), len)
}
