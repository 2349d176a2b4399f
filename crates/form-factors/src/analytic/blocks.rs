//! Facets laid out for many pairs at a time, and a row of exchange areas over them.
//!
//! Targets lie in blocks of eight, number by number ([`Patch`]), 376 bytes a facet. For a source and a block, pairs that face
//! away are 0; each of the others gets the orders that its bound asks for ([`Pose`]), and the block is integrated once for
//! each set of orders that occurs in it. Neighbours of a mesh are neighbours in its list, so that is mostly once. So a
//! value depends on its pair alone: not on the block, the side that asks, or the number of threads. It does depend, by
//! rounding, on the instruction set, which is chosen at run time.
//!
//! Pairs that need clipping, touch, are too near, or are not two facets of one triangle or quadrilateral each, are left to
//! be taken one by one.

use glam::DVec3;
use pulp::{Simd, WithSimd};
use radiosity_geometry::{Facets, Polygon};
use rayon::prelude::*;

use super::area_quadrature::Cell;
use super::lanes::{BLOCK, Eight, Lane, Load};
use super::pair::rounding;
use super::patch::{Patch, set_lane};
use super::pose::{MAX_EVALUATIONS, Pose, ROUNDING};
use crate::level::Level;

/// Blocks that one task lays out.
const PIECE: usize = 64;
/// Base of the number that stands for a set of orders: more than the largest order.
const BASE: f64 = 16.0;

/// Facets laid out for estimators that take several pairs at a time.
#[derive(Clone, Debug)]
pub struct FacetBlocks {
    blocks: Vec<Block>,
    /// Power of two that brings the facets to a size of about 1.
    scale: f64,
}

/// Eight facets side by side.
#[derive(Clone, Debug, Default)]
struct Block {
    patch: Patch<Eight>,
    /// Whether all are parallelograms.
    flat: bool,
}

impl FacetBlocks {
    /// Lays out `facets`, in parallel.
    pub fn new(facets: &Facets) -> Self {
        let corners = facets.iter_polygons().flat_map(|(_, polygon)| polygon.vertices());
        let (lo, hi) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
        let size = (hi - lo).max_element();
        let scale = if size > 0.0 && size.is_finite() { 2.0_f64.powi(-(size.log2() as i32)) } else { 1.0 };
        let mut blocks = vec![Block::default(); facets.len().div_ceil(BLOCK)];
        blocks.par_chunks_mut(PIECE).enumerate().for_each(|(piece, blocks)| {
            for (k, block) in blocks.iter_mut().enumerate() {
                for lane in 0..BLOCK {
                    let t = (piece * PIECE + k) * BLOCK + lane;
                    let patch = if t < facets.len() { patch(facets, t, scale) } else { Patch::absent() };
                    set_lane(&mut block.patch, lane, &patch);
                }
                block.flat = block.patch.w.iter().all(|w| w.0 == [0.0; BLOCK]);
            }
        });
        Self { blocks, scale }
    }

    /// Exchange areas of facet s of `sources` with the facets from `from` on, as many as there are `values`. `swapped`
    /// counts the targets, from the first of all, that come before the source in the order of every pair.
    pub(super) fn fill(&self, level: Level, source: Source<'_>, from: usize, values: &mut [f64], bounds: &mut [f64]) {
        let Source { facets, s, swapped, tolerance } = source;
        let source = patch(facets, s, self.scale);
        level.dispatch(Fill { blocks: self, source, swapped, tolerance, from, values, bounds });
    }
}

/// The bound of a pair that faces away.
pub(super) const AWAY: f64 = -1.0;

/// A source of a row.
#[derive(Clone, Copy)]
pub(super) struct Source<'a> {
    pub facets: &'a Facets,
    pub s: usize,
    /// Targets below this index come first in the order of their pair.
    pub swapped: usize,
    pub tolerance: f64,
}

/// Facet t in the units of the blocks.
fn patch(facets: &Facets, t: usize, scale: f64) -> Patch<f64> {
    if facets.covered(t) {
        return Patch::absent();
    }
    // Not ready: left to those who take polygon by polygon.
    let [polygon] = facets.polygons(t) else { return Patch::default() };
    patch_of(polygon, scale).unwrap_or_default()
}

fn patch_of(polygon: &Polygon, scale: f64) -> Option<Patch<f64>> {
    let p = polygon.vertices()[0];
    let mut corners = [DVec3::ZERO; 4];
    let count = polygon.vertices().len();
    let corners = corners.get_mut(..count)?;
    corners.iter_mut().zip(polygon.vertices()).for_each(|(corner, v)| *corner = (*v - p) * scale);
    let cell = Cell::of(corners, polygon.normal());
    let lengths = polygon.edges().map(|(a, b)| a.distance(b) * scale);
    let (edge, perimeter) = lengths.fold((f64::INFINITY, 0.0), |(edge, sum): (f64, f64), l| (edge.min(l), sum + l));
    let patch = Patch {
        rounding: rounding(polygon.vertices()) * scale,
        thickness: polygon.thickness() * scale,
        perimeter,
        edge,
        ..Patch::of(&cell, p * scale)
    };
    (cell.area() > 0.0 && patch.stretch.is_finite()).then_some(patch)
}

/// A run of a row.
struct Fill<'a> {
    blocks: &'a FacetBlocks,
    source: Patch<f64>,
    swapped: usize,
    tolerance: f64,
    from: usize,
    values: &'a mut [f64],
    bounds: &'a mut [f64],
}

impl WithSimd for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { blocks: FacetBlocks { blocks, scale }, source, swapped, tolerance, from, values, bounds } = self;
        let end = from + values.len();
        let setting = Setting { tolerance, area: 1.0 / (scale * scale) };
        let width = S::F64_LANES;
        let source_flat = source.w == [0.0; 3];
        let mut first = from / width * width;
        while first < end {
            let (block, part) = (&blocks[first / BLOCK], first % BLOCK / width);
            let (flat, block) = (source_flat && block.flat, &block.patch);
            let (begin, stop) = (from.max(first), end.min(first + width));
            let middle = swapped.clamp(begin, stop);
            if begin < middle {
                let found = if flat {
                    pairs::<S, _, _, false>(simd, block, &source, part, setting)
                } else {
                    pairs::<S, _, _, true>(simd, block, &source, part, setting)
                };
                found.write(begin - first..middle - first, &mut values[begin - from..], &mut bounds[begin - from..]);
            }
            if middle < stop {
                let found = if flat {
                    pairs::<S, _, _, false>(simd, &source, block, part, setting)
                } else {
                    pairs::<S, _, _, true>(simd, &source, block, part, setting)
                };
                found.write(middle - first..stop - first, &mut values[middle - from..], &mut bounds[middle - from..]);
            }
            first += width;
        }
    }
}

/// What all pairs of a row share.
#[derive(Clone, Copy)]
struct Setting {
    tolerance: f64,
    /// What an area in the units of the blocks is in those of the scene.
    area: f64,
}

/// Values and bounds of the pairs of one register: [`AWAY`] where they face away, no number where they are left to others.
struct Found<S: Simd> {
    value: Lane<S>,
    bound: Lane<S>,
}

impl<S: Simd> Found<S> {
    #[inline(always)]
    fn write(&self, lanes: std::ops::Range<usize>, values: &mut [f64], bounds: &mut [f64]) {
        let count = lanes.len();
        if count == S::F64_LANES {
            S::as_mut_simd_f64s(&mut values[..count]).0[0] = self.value.v;
            S::as_mut_simd_f64s(&mut bounds[..count]).0[0] = self.bound.v;
        } else {
            values[..count].copy_from_slice(&self.value.to_array()[lanes.clone()]);
            bounds[..count].copy_from_slice(&self.bound.to_array()[lanes]);
        }
    }
}

#[inline(always)]
fn pairs<S: Simd, A: Load<S>, B: Load<S>, const TWISTED: bool>(
    simd: S,
    a: &Patch<A>,
    b: &Patch<B>,
    part: usize,
    setting: Setting,
) -> Found<S> {
    let pose = Pose::new::<TWISTED>(simd, a, b, part);
    let (away, single) = pose.sides();
    let smaller = pose.smaller();
    let (zero, one) = (smaller.all(0.0), smaller.all(1.0));
    let (away_bound, no_number) = (one.all(AWAY), one.all(f64::NAN));
    let idle = away.or(single).select(one, zero);
    if idle.least() > 0.0 {
        return Found { value: zero, bound: away.select(away_bound, no_number) };
    }
    let relative = (super::unoccluded::RELATIVE * setting.tolerance).min(1.0);
    let found = pose.orders::<TWISTED>(smaller * one.all(setting.tolerance), relative, idle);
    let count = (found.q[0] * found.q[1]) * (found.q[2] * found.q[3]);
    let key =
        found.q[0].fma(one.all(BASE), found.q[1]).fma(one.all(BASE * BASE), found.q[2].fma(one.all(BASE), found.q[3]));
    // Too near for any order, or for so many points.
    let near = count.at_most(zero).or(one.all(MAX_EVALUATIONS as f64 + 0.5).at_most(count));
    let mut key = near.or(one.at_most(idle)).select(zero, key);
    let mut value = zero;
    loop {
        let highest = key.greatest();
        if highest == 0.0 {
            break;
        }
        let these = one.all(highest).at_most(key);
        value = these.select(pose.integrate::<TWISTED>(digits(highest)), value);
        key = these.select(zero, key);
    }
    let value = value.max(zero).min(smaller);
    let bound = value.fma(one.all(ROUNDING), found.bound + pose.uneven());
    let area = one.all(setting.area);
    let left = single.or(near).select(no_number, bound * area);
    Found { value: value * area, bound: away.select(away_bound, left) }
}

/// The orders that a key stands for.
#[inline(always)]
fn digits(key: f64) -> [usize; 4] {
    let (key, base) = (key as usize, BASE as usize);
    [key / (base * base * base), key / (base * base) % base, key / base % base, key % base]
}
