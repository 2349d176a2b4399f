//! Scenes that several tests share.

use glam::DVec3;

use crate::{Material, Scene, Surface};

/// Corners of a quadrilateral as a loop.
pub(crate) fn quad(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> Vec<DVec3> {
    vec![a, b, c, d]
}

/// Six faces of a cube of the given side about the origin, fronts inward.
pub(crate) fn cube(side: f64) -> Vec<Vec<DVec3>> {
    let h = 0.5 * side;
    let v = |k: usize| {
        DVec3::new(if k & 1 == 0 { -h } else { h }, if k & 2 == 0 { -h } else { h }, if k & 4 == 0 { -h } else { h })
    };
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        .iter()
        .map(|face| face.map(v).to_vec())
        .collect()
}

/// A scene of one grey material with a surface for every loop.
pub(crate) fn scene_of(loops: &[Vec<DVec3>]) -> Scene {
    let grey = Material::diffuse("grey", vec![0.5], vec![0.0]);
    let surfaces = loops.iter().map(|l| Surface::from_loop("face", 0, 0, l).unwrap().0).collect();
    Scene::new(surfaces, vec![grey]).unwrap()
}

/// The faces of the Cornell box in its own file.
pub(crate) fn cornell_box() -> Vec<Vec<DVec3>> {
    let text = include_str!("../../../experiments/scenes/cornell_box.obj");
    let mut vertices = Vec::new();
    let mut faces = Vec::new();
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let x: Vec<f64> = words.map(|w| w.parse().unwrap()).collect();
                vertices.push(DVec3::new(x[0], x[1], x[2]));
            }
            Some("f") => faces.push(words.map(|w| vertices[w.parse::<usize>().unwrap() - 1]).collect()),
            _ => {}
        }
    }
    faces
}

/// SplitMix64 (Steele, Lea & Flood 2014): fixed random numbers for tests.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in a box.
    pub(crate) fn point(&mut self, lo: DVec3, hi: DVec3) -> DVec3 {
        lo + (hi - lo) * DVec3::new(self.unit(), self.unit(), self.unit())
    }

    /// Uniform over the sphere of directions.
    pub(crate) fn direction(&mut self) -> DVec3 {
        let (z, phi) = (2.0 * self.unit() - 1.0, std::f64::consts::TAU * self.unit());
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * phi.cos(), r * phi.sin(), z)
    }
}
