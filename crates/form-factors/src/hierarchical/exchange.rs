//! The mean kernel between two nodes and how far it varies over either, from four points on each.
//!
//! ```text
//! K(x, y) = cos θ_x cos θ_y / (π r²),      κ = ⟨K⟩,      F(x → q) = A_q ⟨K(x, ·)⟩
//! ```
//!
//! On a node of one plane the points are c ± u/√3 ± v/√3: Gauss's rule, exact for cubic functions on a parallelogram. Squares of a
//! function that is linear over the node are integrated exactly, so the standard deviation of F(x → q) over the four points *is* the rms
//! of the linear part of what a receiver p loses by holding one irradiance.

use glam::Vec3;

use super::tree::{Hierarchy, Node};

/// Points with normals, one number of all of them after the other, so that loops over them become vector instructions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Points<const N: usize> {
    x: [[f32; N]; 3],
    n: [[f32; N]; 3],
}

impl<const N: usize> Points<N> {
    pub fn new(points: &[(Vec3, Vec3); N]) -> Self {
        let of = |number: &dyn Fn(&(Vec3, Vec3)) -> f32| std::array::from_fn(|k| number(&points[k]));
        Self { x: [0, 1, 2].map(|c| of(&|p| p.0[c])), n: [0, 1, 2].map(|c| of(&|p| p.1[c])) }
    }
}

impl Points<4> {
    /// Gauss's points of a node of one plane.
    pub fn of(hierarchy: &Hierarchy, node: &Node) -> Self {
        let (n, (u, v)) = (hierarchy.normals[node.plane as usize], axes(node));
        Self::new(&[(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)].map(|(s, t)| (node.centre + u * s + v * t, n)))
    }
}

fn axes(node: &Node) -> (Vec3, Vec3) {
    let third = 1.0 / 3.0_f32.sqrt();
    (node.u * third, node.v * third)
}

/// K of every two points, those of the first node along the rows; 0 where one does not see the other's front.
pub(super) fn kernel<const N: usize, const M: usize>(p: &Points<N>, q: &Points<M>) -> [[f32; M]; N] {
    let mut k = [[0.0; M]; N];
    for (a, row) in k.iter_mut().enumerate() {
        for (b, k) in row.iter_mut().enumerate() {
            let d = [q.x[0][b] - p.x[0][a], q.x[1][b] - p.x[1][a], q.x[2][b] - p.x[2][a]];
            let r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            let out = (p.n[0][a] * d[0] + p.n[1][a] * d[1] + p.n[2][a] * d[2]).max(0.0);
            let back = (-(q.n[0][b] * d[0] + q.n[1][b] * d[1] + q.n[2][b] * d[2])).max(0.0);
            *k = out * back / (std::f32::consts::PI * r2 * r2).max(f32::MIN_POSITIVE);
        }
    }
    k
}

/// K between Gauss's points of a node of one plane and those of any node: the mean over the other node at each of the four.
pub(super) fn means(hierarchy: &Hierarchy, p: &Points<4>, q: u32) -> [f32; 4] {
    fn rows<const M: usize>(k: [[f32; M]; 4]) -> [f32; 4] {
        k.map(|row| row.iter().sum::<f32>() / M as f32)
    }
    let node = &hierarchy.nodes[q as usize];
    if node.is_cluster() {
        rows(kernel(p, &Points::new(&hierarchy.spread[q as usize])))
    } else {
        rows(kernel(p, &Points::of(hierarchy, node)))
    }
}

/// How a function with the given values at Gauss's points varies along the half axes of a node: its best linear fit, held so flat that it is
/// nowhere negative on the parallelogram.
pub(super) fn slopes(rows: &[f32; 4]) -> [f32; 2] {
    let mean = 0.25 * (rows[0] + rows[1] + rows[2] + rows[3]);
    // The points are at ±1/√3 of the half axes.
    let third = 3.0_f32.sqrt();
    let along = 0.25 * third * (rows[1] + rows[3] - rows[0] - rows[2]);
    let across = 0.25 * third * (rows[2] + rows[3] - rows[0] - rows[1]);
    let steep = along.abs() + across.abs();
    if steep <= mean { [along, across] } else { [along * (mean / steep), across * (mean / steep)] }
}

/// K of two points with normals.
pub(super) fn kernel_between((x, n_x): (Vec3, Vec3), (y, n_y): (Vec3, Vec3)) -> f32 {
    let d = y - x;
    let r2 = d.length_squared();
    n_x.dot(d).max(0.0) * (-n_y.dot(d)).max(0.0) / (std::f32::consts::PI * r2 * r2).max(f32::MIN_POSITIVE)
}

/// Mean of a kernel and the standard deviations of its means over one side along the other.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Statistics {
    /// ⟨K⟩.
    pub mean: f32,
    /// Of ⟨K(x, ·)⟩ over x, and of ⟨K(·, y)⟩ over y.
    pub deviation: [f32; 2],
}

pub(super) fn statistics<const N: usize>(k: &[[f32; N]; N]) -> Statistics {
    let (mut rows, mut columns, share) = ([0.0; N], [0.0; N], 1.0 / N as f32);
    for (row, k) in rows.iter_mut().zip(k) {
        for (column, k) in columns.iter_mut().zip(k) {
            *row += share * k;
            *column += share * k;
        }
    }
    let mean = share * rows.iter().sum::<f32>();
    let deviation = |m: &[f32; N]| (share * m.iter().map(|m| (m - mean) * (m - mean)).sum::<f32>()).sqrt();
    Statistics { mean, deviation: [deviation(&rows), deviation(&columns)] }
}
