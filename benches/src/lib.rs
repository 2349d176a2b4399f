//! Inputs shared by the benches: scenes, meshes, rows and values, the same bytes in every run.
//!
//! What is *not* here: anything that is timed.

use std::f64::consts::TAU;
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

/// The 38 triangles of the Cornell box.
pub fn cornell_triangles() -> Vec<Polygon> {
    let scene = cornell();
    scene.pieces().flat_map(|(_, piece)| halves(piece.vertices())).map(triangle).collect()
}

/// 10,254 triangles: the unit cube seen from inside, a lamp under its ceiling and 20 spheres of 512 triangles, which may cut one
/// another.
pub fn spheres() -> Vec<Polygon> {
    let lamp = [(0.4, 0.4), (0.4, 0.6), (0.6, 0.6), (0.6, 0.4)].map(|(x, y)| DVec3::new(x, y, 0.999));
    let room = faces(DVec3::ZERO, DVec3::ONE, true);
    let mut triangles: Vec<_> = room.iter().map(Vec::as_slice).chain([&lamp[..]]).flat_map(halves).collect();
    let mut random = Random(SEED);
    for _ in 0..20 {
        let radius = 0.04 + 0.08 * random.unit();
        let centre = DVec3::from_array([(); 3].map(|()| radius + (1.0 - 2.0 * radius) * random.unit()));
        triangles.extend(octahedral_sphere(8).into_iter().map(|t| t.map(|v| centre + v * radius)));
    }
    triangles.into_iter().map(triangle).collect()
}

/// The two triangles of a quadrilateral.
fn halves(loop_: &[DVec3]) -> [[DVec3; 3]; 2] {
    [[loop_[0], loop_[1], loop_[2]], [loop_[0], loop_[2], loop_[3]]]
}

/// A unit sphere seen from outside: each face of an octahedron cut into k² triangles.
fn octahedral_sphere(k: u32) -> Vec<[DVec3; 3]> {
    let mut triangles = Vec::new();
    for octant in 0..8_u32 {
        let sign = DVec3::from_array([0, 1, 2].map(|axis| if octant >> axis & 1 == 0 { 1.0 } else { -1.0 }));
        let at = |i: u32, j: u32| (DVec3::new(f64::from(i), f64::from(j), f64::from(k - i - j)) * sign).normalize();
        for (i, j) in (0..k).flat_map(|i| (0..k - i).map(move |j| (i, j))) {
            triangles.push([at(i, j), at(i + 1, j), at(i, j + 1)]);
            if i + j + 1 < k {
                triangles.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
    }
    let outward = |t: [DVec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]).dot(t[0]) > 0.0;
    triangles.into_iter().map(|t| if outward(t) { t } else { [t[0], t[2], t[1]] }).collect()
}

fn triangle(vertices: [DVec3; 3]) -> Polygon {
    Polygon::new(&vertices).unwrap_or_else(|fault| panic!("{fault}"))
}

/// Numbers without a pattern, the same in every run (Steele, Lea and Flood's SplitMix, 2014).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Points spread evenly over the area of polygons.
struct Surface<'a> {
    polygons: &'a [Polygon],
    /// Area up to each polygon.
    areas: Vec<f64>,
    random: Random,
}

impl<'a> Surface<'a> {
    fn new(polygons: &'a [Polygon]) -> Self {
        let mut area = 0.0;
        let areas = polygons.iter().map(|p| {
            area += p.area();
            area
        });
        Self { polygons, areas: areas.collect(), random: Random(SEED) }
    }

    fn point(&mut self) -> (DVec3, &'a Polygon) {
        let random = &mut self.random;
        let area = random.unit() * self.areas.last().copied().unwrap_or(0.0);
        let polygon = &self.polygons[self.areas.partition_point(|&a| a < area).min(self.areas.len() - 1)];
        (polygon.sample(random.unit(), random.unit()), polygon)
    }
}

/// `count` rays from points spread evenly over polygons, in directions distributed like the cosine.
///
/// # Panics
///
/// If there is no polygon.
pub fn surface_rays(polygons: &[Polygon], count: usize) -> Vec<(DVec3, DVec3)> {
    let mut surface = Surface::new(polygons);
    let ray = |_| {
        let (origin, polygon) = surface.point();
        let (x, y) = polygon.frame();
        let (square, (sin, cos)) = (surface.random.unit(), (surface.random.unit() * TAU).sin_cos());
        (origin, (x * cos + y * sin) * square.sqrt() + polygon.normal() * (1.0 - square).sqrt())
    };
    (0..count).map(ray).collect()
}

/// `count` segments between points spread evenly over polygons that face each other there.
///
/// # Panics
///
/// If there is no polygon.
pub fn facing_segments(polygons: &[Polygon], count: usize) -> Vec<(DVec3, DVec3)> {
    let mut surface = Surface::new(polygons);
    let pairs = std::iter::repeat_with(|| (surface.point(), surface.point()));
    let facing = pairs.filter(|((p, i), (q, j))| (*q - *p).dot(i.normal()) > 0.0 && (*p - *q).dot(j.normal()) > 0.0);
    facing.map(|((p, _), (q, _))| (p, q)).take(count).collect()
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
