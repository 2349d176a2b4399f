//! What is seen from an element in every bin of directions: directional form factors, as the slots of the radiances that rays look up.
//!
//! ```text
//! L_i(k) = 1/A_i Ω⊥_k ∫_{A_i} ∫_k L(x, −ω) cosθ dω dx ≈ Σ_p w_p x[slot of ray p],      w_p = Ω⊥_p / Ω⊥_k,
//! ```
//!
//! p the parts of bin k, one ray each: its direction has density cosθ over the part, so that every mean is unbiased, and weights are those of all elements. The
//! slots are all that is kept, four bytes a ray: the n × n × K directional form factors of Immel et al. 1986 are how often a bin's rays meet an element's.
//!
//! Neighbouring parts start at points of a Sobol sequence that complete each other: points are numbered along a curve that fills the square (Morton 1966), so that every
//! square of 2ʲ × 2ʲ parts has one point in every cell of equal shares of the element.
//!
//! **Error.** Noise of N rays an element, spread in four dimensions: of H nearly N^(−3/4), of one bin that of its few rays.

use glam::DVec3;
use radiosity_core::{Cost, mix};
use radiosity_geometry::{Hit, Polygon};
use radiosity_render::numbers::Numbers;
use rayon::prelude::*;

use super::Slots;
use super::bins::DirectionBins;
use crate::Geometry;

/// Rays followed at a time.
const BUNDLE: usize = 256;
/// Points of one sequence.
const SEQUENCE: u32 = 1 << 16;

/// Frames of the polygons that rays meet: x, y and normal.
pub(super) struct Frames(Vec<[DVec3; 3]>);

impl Frames {
    /// Of the pieces of the scene.
    pub fn new(geometry: &Geometry<'_>) -> Self {
        let frame = |polygon: &Polygon| {
            let (x, y) = polygon.frame();
            [x, y, polygon.normal()]
        };
        Self(geometry.scene().pieces().map(|(_, polygon)| frame(polygon)).collect())
    }

    /// A vector of the scene in the frame of a piece.
    pub fn local(&self, piece: usize, v: DVec3) -> DVec3 {
        let [x, y, z] = self.0[piece];
        DVec3::new(v.dot(x), v.dot(y), v.dot(z))
    }

    fn scene(&self, piece: usize, v: DVec3) -> DVec3 {
        let [x, y, z] = self.0[piece];
        x * v.x + y * v.y + z * v.z
    }
}

/// Slots that rays look up.
pub(super) struct Visibility {
    /// Rays of an element.
    rays: usize,
    /// Element after element, bin after bin, part after part.
    seen: Vec<u32>,
    /// Ω⊥_p of the rays of an element.
    weights: Vec<f64>,
    /// What the rays cost.
    pub cost: Cost,
}

impl Visibility {
    /// Bytes for so many elements.
    pub fn bytes_of(elements: u64, rays: u64) -> u64 {
        rays.saturating_mul(elements.saturating_mul(size_of::<u32>() as u64) + size_of::<f64>() as u64)
    }

    /// Casts `times` × `times` rays a bin from every element.
    pub fn new(geometry: &Geometry<'_>, frames: &Frames, slots: &Slots, times: u32, seed: u64) -> Self {
        let bins = slots.bins;
        let fine = DirectionBins::new(bins.edge() * times);
        let parts: Vec<u32> = bins.parts(times).map(|p| p as u32).collect();
        let weights: Vec<f64> = parts.iter().map(|&p| fine.projected(p as usize)).collect();
        let (elements, rays) = (geometry.elements().len(), parts.len());
        let occluders = geometry.element_occluders();
        let mut seen = vec![0; elements * rays];
        // A piece of the table is as long as the rays of an element, whatever the number of threads.
        seen.par_chunks_mut(rays).enumerate().for_each(|(e, seen)| {
            let (polygon, piece, seed) =
                (&geometry.elements().polygons(e)[0], slots.pieces[e] as usize, mix(seed ^ e as u64));
            let (mut bundle, mut hits) = (Vec::with_capacity(BUNDLE), Vec::with_capacity(BUNDLE));
            for (parts, seen) in parts.chunks(BUNDLE).zip(seen.chunks_mut(BUNDLE)) {
                bundle.clear();
                bundle.extend(parts.iter().map(|&p| {
                    let (origin, direction) = ray(fine, p as usize, polygon, seed);
                    (origin, frames.scene(piece, direction).normalize())
                }));
                hits.clear();
                hits.resize(bundle.len(), None::<Hit>);
                occluders.first_hits(&bundle, &mut hits);
                for ((seen, hit), (_, direction)) in seen.iter_mut().zip(&hits).zip(&bundle) {
                    *seen = slots.seen(frames, hit.as_ref(), *direction);
                }
            }
        });
        let rows = elements as u64;
        let form_factors = rows * bins.count() as u64;
        let cost = Cost { rays: rows * rays as u64, source_evaluations: rows, form_factors, ..Cost::default() };
        Self { rays, seen, weights, cost }
    }

    /// The rays of an element: Ω⊥ and slot.
    pub fn of(&self, e: usize) -> impl Iterator<Item = (f64, u32)> + '_ {
        self.weights.iter().copied().zip(self.seen[e * self.rays..(e + 1) * self.rays].iter().copied())
    }

    /// The slots of an element's rays, and their Ω⊥: bin after bin.
    pub fn row(&self, e: usize) -> (&[u32], &[f64]) {
        (&self.seen[e * self.rays..(e + 1) * self.rays], &self.weights)
    }

    /// Entries of the table.
    pub fn entries(&self) -> u64 {
        self.seen.len() as u64
    }

    /// Bytes held.
    pub fn stored_bytes(&self) -> u64 {
        (size_of::<u32>() * self.seen.len() + size_of::<f64>() * self.weights.len()) as u64
    }
}

/// Where ray p of an element starts, and its direction in the frame of the surface.
fn ray(fine: DirectionBins, p: usize, polygon: &Polygon, seed: u64) -> (DVec3, DVec3) {
    let [i, j] = fine.cell(p);
    let index = spread(i) | spread(j) << 1;
    let mut numbers = Numbers::new(mix(seed ^ u64::from(index / SEQUENCE)), index % SEQUENCE);
    let [u, v, mut a, mut b] = numbers.draw();
    // Even density over solid angle, of which the share cosθ over the largest cosθ is kept. In the middle of the square that is 1, elsewhere the corner next to it.
    let nearest = [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)].map(|(u, v)| fine.direction(p, u, v).z);
    let largest = if fine.edge() % 2 == 1 { 1.0 } else { nearest.into_iter().fold(0.0, f64::max) };
    loop {
        let direction = fine.direction(p, a, b);
        let accept;
        [accept, a, b, _] = numbers.draw();
        if accept * largest <= direction.z {
            return (polygon.sample(u, v), direction);
        }
    }
}

/// Puts a 0 between the bits of a number below 2¹⁶.
fn spread(x: u32) -> u32 {
    let mut x = x & 0xffff;
    for (shift, mask) in [(8, 0x00ff_00ff), (4, 0x0f0f_0f0f), (2, 0x3333_3333), (1, 0x5555_5555)] {
        x = (x | x << shift) & mask;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_of_both_indices_alternate() {
        assert_eq!(spread(0b1011), 0b100_0101);
        assert_eq!(spread(0xffff), 0x5555_5555);
    }

    /// Over a bin at the horizon, the pole and the whole hemisphere of odd N: the mean of cosθ is ∫ cos²θ / ∫ cosθ, by 200 × 200 points of the bin.
    #[test]
    fn directions_have_density_cosine_over_their_part() {
        let square = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y];
        let polygon = Polygon::new(&square).unwrap();
        for (edge, p) in [(1, 0), (2, 3), (3, 4), (5, 0), (8, 60)] {
            let bins = DirectionBins::new(edge);
            let at = |k: u32| (f64::from(k) + 0.5) / 200.0;
            let heights: Vec<f64> = (0..40_000).map(|q| bins.direction(p, at(q % 200), at(q / 200)).z).collect();
            let expected = heights.iter().map(|z| z * z).sum::<f64>() / heights.iter().sum::<f64>();
            let count = 200_000;
            let mut mean = 0.0;
            for seed in 0..count {
                let (origin, d) = ray(bins, p, &polygon, mix(seed));
                assert_eq!(bins.bin(d), p);
                assert!(origin.min_element() >= 0.0 && origin.max_element() <= 1.0);
                mean += d.z / count as f64;
            }
            assert!((mean - expected).abs() < 0.003 * expected, "{edge}, {p}: {mean}, {expected}");
        }
    }
}
