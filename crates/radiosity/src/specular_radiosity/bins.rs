//! Bins of directions over a hemisphere.
//!
//! The square [−1, 1]² is wound onto the disc, square rings to circles (Shirley and Chiu 1997), and the disc onto the hemisphere with areas kept (Lambert 1772):
//!
//! ```text
//! r = max(|a|, |b|),      φ = π/4 · b/a where |a| ≥ |b|, else π/2 − π/4 · a/b,      cosθ = 1 − r²
//! ```
//!
//! so that N × N cells of the square are K = N² bins of the solid angle 2π/K each. Why these, and not a global cube or rings of equal height:
//!
//! - Equal solid angles, and no slivers at any N: a bin is nowhere wider than 2.4 √(2π/K), so the blur of what a mirror shows falls like K^(−1/2) in all directions. Bins of
//!   equal *projected* solid angle would make all weights 1/K, but their width at the horizon falls like K^(−1/4) alone.
//! - The direction mirrored at the normal lies in the cell opposite, a whole cell whatever N: an ideal mirror is an exchange of bins and blurs nothing of its own.
//! - The eight ways of turning the square onto itself turn the hemisphere onto itself, so that a function of two bins of an isotropic surface is known from one bin in eight.
//! - Cells of 2N × 2N nest in those of N × N: rays stand for parts of bins, with weights that sum to those of the bins.
//! - They turn with the surface, whose frame they are in; a global cube would make the answer depend on how the scene stands.

use std::f64::consts::{FRAC_PI_4, PI};

use glam::{DVec2, DVec3};

/// K = N × N bins of equal solid angle over the hemisphere about z; bin k is cell (k mod N, k div N) of the square.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DirectionBins {
    edge: u32,
}

/// One of the eight ways of turning a square onto itself: an exchange of its axes, then of the ends of either.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Turn(u8);

impl Turn {
    /// All of them.
    pub const ALL: [Self; 8] = [Self(0), Self(1), Self(2), Self(3), Self(4), Self(5), Self(6), Self(7)];

    fn new(ends: [bool; 2], axes: bool) -> Self {
        Self(u8::from(ends[0]) | u8::from(ends[1]) << 1 | u8::from(axes) << 2)
    }
}

impl DirectionBins {
    /// `edge` × `edge` bins.
    ///
    /// # Panics
    ///
    /// If `edge` is 0 or more than 4096.
    pub fn new(edge: u32) -> Self {
        assert!((1..=4096).contains(&edge), "bins need 1 to 4096 cells along an edge, got {edge}");
        Self { edge }
    }

    /// N, cells along an edge of the square.
    pub fn edge(self) -> u32 {
        self.edge
    }

    /// K, their number.
    pub fn count(self) -> usize {
        let n = self.edge as usize;
        n * n
    }

    /// Solid angle of every bin, 2π/K.
    pub fn solid_angle(self) -> f64 {
        2.0 * PI / self.count() as f64
    }

    /// ∫ cosθ dω over bin k: exact, and π over all.
    pub fn projected(self, k: usize) -> f64 {
        let [i, j] = self.cell(k).map(|x| x.max(self.edge - 1 - x));
        // Seen from the middle, the cell lies between these along the axis on which it is further out; a middle one of odd N reaches both ways.
        let (n, out) = (f64::from(self.edge), i.max(j));
        let (lo, hi) = (f64::from((2 * out).saturating_sub(self.edge)) / n, f64::from(2 * out + 2 - self.edge) / n);
        // The mean of r² over the cell: r is its coordinate along that axis, or the larger of two.
        let square = if i == j {
            let h = hi - lo;
            lo * lo + 4.0 / 3.0 * lo * h + 0.5 * h * h
        } else {
            (lo * lo + lo * hi + hi * hi) / 3.0
        };
        self.solid_angle() * (1.0 - square)
    }

    /// The bin that holds a unit vector, of which z counts as 0 if it is less.
    pub fn bin(self, d: DVec3) -> usize {
        let n = f64::from(self.edge);
        let cell = |x: f64| ((0.5 * (x + 1.0) * n) as u32).min(self.edge - 1);
        let at = square(d);
        self.at([cell(at.x), cell(at.y)])
    }

    /// A direction of bin k, from (u, v) in [0, 1)² with equal density over solid angle.
    pub fn direction(self, k: usize, u: f64, v: f64) -> DVec3 {
        let [i, j] = self.cell(k).map(f64::from);
        let scale = 2.0 / f64::from(self.edge);
        direction(DVec2::new((i + u) * scale - 1.0, (j + v) * scale - 1.0))
    }

    /// The middle of bin k.
    pub fn centre(self, k: usize) -> DVec3 {
        self.direction(k, 0.5, 0.5)
    }

    /// The bin of what is mirrored at the normal: the cell opposite.
    pub fn mirrored(self, k: usize) -> usize {
        self.count() - 1 - k
    }

    /// The bins that the cells of a grid `times` as fine are parts of, part by part: bin k has its parts k · times² and on.
    pub(super) fn parts(self, times: u32) -> impl Iterator<Item = usize> {
        let fine = Self { edge: self.edge * times };
        (0..self.count()).flat_map(move |k| {
            let [i, j] = self.cell(k);
            let part = move |p: u32| fine.at([i * times + p % times, j * times + p / times]);
            (0..times * times).map(part)
        })
    }

    /// The one bin of those that turns carry into each other which stands for all, and the turn from there to k.
    pub(super) fn folded(self, k: usize) -> (usize, Turn) {
        let cell = self.cell(k);
        let ends = cell.map(|x| x < self.edge - 1 - x);
        let [i, j] = cell.map(|x| x.max(self.edge - 1 - x));
        (self.at([i.max(j), i.min(j)]), Turn::new(ends, i < j))
    }

    /// Bin k turned.
    pub(super) fn turned(self, k: usize, turn: Turn) -> usize {
        let [i, j] = self.cell(k);
        let mut cell = if turn.0 & 4 == 0 { [i, j] } else { [j, i] };
        for (axis, x) in cell.iter_mut().enumerate() {
            if turn.0 >> axis & 1 == 1 {
                *x = self.edge - 1 - *x;
            }
        }
        self.at(cell)
    }

    pub(super) fn cell(self, k: usize) -> [u32; 2] {
        let k = k as u32;
        [k % self.edge, k / self.edge]
    }

    fn at(self, [i, j]: [u32; 2]) -> usize {
        (j * self.edge + i) as usize
    }
}

/// The direction at a point of the square.
fn direction(at: DVec2) -> DVec3 {
    let (a, b) = (at.x, at.y);
    let disc = if a.abs() >= b.abs() {
        let (sin, cos) = if a == 0.0 { (0.0, 1.0) } else { (FRAC_PI_4 * b / a).sin_cos() };
        DVec2::new(cos, sin) * a
    } else {
        let (sin, cos) = (FRAC_PI_4 * a / b).sin_cos();
        DVec2::new(sin, cos) * b
    };
    let r2 = a.abs().max(b.abs()).powi(2);
    // sinθ = r √(2 − r²).
    let flat = disc * (2.0 - r2).sqrt();
    DVec3::new(flat.x, flat.y, 1.0 - r2)
}

/// The point of the square at a direction.
fn square(d: DVec3) -> DVec2 {
    // 1 − cosθ without cancellation near the normal.
    let r = ((d.x * d.x + d.y * d.y) / (1.0 + d.z.max(0.0))).sqrt().min(1.0);
    if r == 0.0 {
        DVec2::ZERO
    } else if d.x.abs() >= d.y.abs() {
        let a = r.copysign(d.x);
        DVec2::new(a, a * (d.y / d.x).atan() / FRAC_PI_4)
    } else {
        let b = r.copysign(d.y);
        DVec2::new(b * (d.x / d.y).atan() / FRAC_PI_4, b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EDGES: [u32; 6] = [1, 2, 3, 5, 8, 31];

    /// Every bin against 64 × 64 of its points, which stand for equal solid angles: the midpoint rule errs by less than 10⁻³ of a bin.
    #[test]
    fn projected_solid_angles_are_those_of_their_points_and_sum_to_pi() {
        for edge in EDGES {
            let bins = DirectionBins::new(edge);
            let mut sum = 0.0;
            for k in 0..bins.count() {
                let at = |p: u32| (f64::from(p) + 0.5) / 64.0;
                let heights = (0..64 * 64).map(|p| bins.direction(k, at(p % 64), at(p / 64)).z);
                let mean = heights.sum::<f64>() / 4096.0;
                let exact = bins.projected(k) / bins.solid_angle();
                assert!((mean - exact).abs() < 1e-3 * exact, "{edge}: bin {k}, {mean}, {exact}");
                sum += bins.projected(k);
            }
            assert!((sum - PI).abs() < 1e-13, "{edge}: {sum}");
        }
    }

    #[test]
    fn a_direction_lies_in_its_bin_and_its_mirror_image_in_the_one_opposite() {
        for edge in EDGES {
            let bins = DirectionBins::new(edge);
            for k in 0..bins.count() {
                for (u, v) in [(0.1, 0.2), (0.5, 0.4), (0.97, 0.03), (0.02, 0.6)] {
                    let d = bins.direction(k, u, v);
                    assert!((d.length() - 1.0).abs() < 1e-15 && d.z >= 0.0);
                    assert_eq!(bins.bin(d), k);
                    assert_eq!(bins.bin(DVec3::new(-d.x, -d.y, d.z)), bins.mirrored(k));
                }
            }
        }
        // What lies below the surface by rounding is at the horizon, and the poles are somewhere.
        let bins = DirectionBins::new(4);
        assert_eq!(bins.bin(DVec3::new(1.0, 1e-3, -1e-17)), bins.bin(DVec3::new(1.0, 1e-3, 0.0)));
        assert!(bins.bin(DVec3::Z) < 16);
    }

    /// No two of the corners of a bin lie further apart than 2.4 √(2π/K).
    #[test]
    fn bins_have_no_slivers() {
        for edge in [2, 3, 8, 31, 100] {
            let bins = DirectionBins::new(edge);
            for k in 0..bins.count() {
                let corners = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(u, v)| bins.direction(k, u, v));
                let far = corners.iter().flat_map(|p| corners.iter().map(move |q| p.angle_between(*q)));
                let width = far.fold(0.0, f64::max) / bins.solid_angle().sqrt();
                assert!(width < 2.4, "{edge}: bin {k} is {width} wide");
            }
        }
    }

    /// A turn of bins is a turn of their middles: it keeps heights and the angle between any two.
    #[test]
    fn turns_are_turns_of_the_hemisphere_and_reach_every_bin_from_one_in_eight() {
        for edge in [1, 4, 5, 8] {
            let bins = DirectionBins::new(edge);
            let mut standing = Vec::new();
            for k in 0..bins.count() {
                let (folded, turn) = bins.folded(k);
                assert_eq!(bins.turned(folded, turn), k);
                assert_eq!(bins.folded(folded).0, folded);
                standing.push(folded);
                for turn in Turn::ALL {
                    let other = (k * 7 + 3) % bins.count();
                    let angle = |k: usize, l: usize| bins.centre(k).dot(bins.centre(l));
                    let turned = angle(bins.turned(k, turn), bins.turned(other, turn));
                    assert!((turned - angle(k, other)).abs() < 1e-14);
                    assert!((bins.centre(bins.turned(k, turn)).z - bins.centre(k).z).abs() < 1e-15);
                }
            }
            standing.sort_unstable();
            standing.dedup();
            let half = edge.div_ceil(2) as usize;
            assert_eq!(standing.len(), half * (half + 1) / 2);
        }
    }

    #[test]
    fn parts_of_a_bin_fill_it() {
        let bins = DirectionBins::new(5);
        let fine = DirectionBins::new(15);
        let parts: Vec<usize> = bins.parts(3).collect();
        for (k, parts) in parts.chunks_exact(9).enumerate() {
            assert!(parts.iter().all(|&p| bins.bin(fine.centre(p)) == k));
            let sum: f64 = parts.iter().map(|&p| fine.projected(p)).sum();
            assert!((sum - bins.projected(k)).abs() < 1e-15);
        }
    }
}
