//! Entries of a row from what a hemicube shows, analytic where it is no good.

use radiosity_core::Cost;
use radiosity_geometry::Polygon;
use rayon::prelude::*;

use super::estimate::{Moments, aliasing, kernel, middle};
use super::raster::{BACK, EMPTY};
use super::view::Frame;
use super::{Hemicube, Scratch};
use crate::analytic::unoccluded;

/// Error of F asked of an analytic factor.
const TOLERANCE: f64 = 1e-8;
/// Standard errors in a bound.
const SIGMAS: f64 = 3.0;
/// Pixels that a target must cover to be left to them.
const FEW: u64 = 16;
/// Targets handed out together.
const PIECE: usize = 16;

/// What a source's polygon exchanges with one of a target's.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry {
    /// Which polygon of the view.
    seen: u32,
    pub target: u32,
    /// A_s F_st.
    pub value: f64,
    /// Estimate of its error.
    pub bound: f64,
    kind: Kind,
}

/// Where an entry comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// Its pixels.
    Pixels,
    /// The analytic rule, all of it seen.
    Whole,
    /// The analytic rule and the share that is seen.
    Share,
}

impl Hemicube<'_> {
    /// Entries of the row of `source` from what `scratch` shows, and what the analytic ones cost.
    pub(super) fn entries(&self, source: &Polygon, frame: &Frame, scratch: &mut Scratch) -> Cost {
        let Scratch { view, faces, shown, entries } = scratch;
        let (area, moments) = (source.area(), Moments::of(source, frame));
        entries.clear();
        // Whatever else the pixels show: nothing, backs, and fronts that do not receive.
        let mut other: f64 = faces.iter().map(|face| face[EMPTY].factor + face[BACK].factor).sum::<f64>() * area;
        for (k, (seen, shown)) in view.seen.iter().zip(&*shown).enumerate() {
            if !seen.front {
                continue;
            }
            let Some(target) = self.polygons[seen.polygon as usize].1 else {
                other += area * shown.factor;
                continue;
            };
            let sides = &view.sides[seen.sides.clone()];
            let value = area * shown.factor;
            let proximity = moments.proximity(middle(sides), seen.plane);
            let unseen = if shown.whole_pixels == 0 { kernel(seen, sides) } else { 0.0 };
            let sigma = aliasing(shown).sqrt();
            let bound = area * (SIGMAS * sigma + proximity * shown.factor + unseen);
            let visible = shown.pixels > 0 || shown.glimpsed;
            let poor = proximity * shown.factor > sigma || shown.whole_pixels < FEW;
            let kind = match self.exact_near && visible && poor {
                false => Kind::Pixels,
                true if shown.pixels == shown.whole_pixels => Kind::Whole,
                true => Kind::Share,
            };
            entries.push(Entry { seen: k as u32, target, value, bound, kind });
        }
        if !self.exact_near {
            return Cost::default();
        }
        let shown = &*shown;
        let near: Vec<usize> = (0..entries.len()).filter(|&k| entries[k].kind != Kind::Pixels).collect();
        let exact: Vec<Entry> = near
            .par_iter()
            .with_min_len(PIECE)
            .map(|&k| {
                let (entry, shown) = (entries[k], &shown[entries[k].seen as usize]);
                let target = self.polygons[view.seen[entry.seen as usize].polygon as usize].0;
                let whole = unoccluded(source, target, TOLERANCE);
                match entry.kind {
                    Kind::Whole => Entry { value: whole.value, bound: whole.bound, ..entry },
                    _ => {
                        let share = shown.factor / shown.whole;
                        let error = SIGMAS * aliasing(shown).sqrt() / shown.whole;
                        Entry { value: whole.value * share, bound: whole.bound + whole.value * error, ..entry }
                    }
                }
            })
            .collect();
        let cost = Cost {
            clear_pairs: exact.iter().filter(|entry| entry.kind == Kind::Whole).count() as u64,
            partial_pairs: exact.iter().filter(|entry| entry.kind == Kind::Share).count() as u64,
            ..Cost::default()
        };
        for (k, entry) in near.into_iter().zip(exact) {
            entries[k] = entry;
        }
        close(entries, area, other);
        cost
    }
}

/// Makes entries sum to `area` where the pixels show nothing `other` than receivers, and to no more elsewhere.
///
/// Wholly seen pairs stay: the others give up, or take over, what these differ from their pixels, by one factor between
/// ½ and 2. Beyond that, and where no others are, all entries share what is left. In an open scene it is the rest of the
/// row, which is nobody's entry, that gives or takes.
fn close(entries: &mut [Entry], area: f64, other: f64) {
    let sum = |kind: fn(Kind) -> bool| entries.iter().filter(|e| kind(e.kind)).map(|e| e.value).sum::<f64>();
    let (known, rest) = (sum(|kind| kind == Kind::Whole), sum(|kind| kind != Kind::Whole));
    let closed = other == 0.0;
    let factor = if closed && rest > 0.0 { ((area - known) / rest).clamp(0.5, 2.0) } else { 1.0 };
    let total = known + factor * rest;
    let all = if total > area || (closed && total > 0.0) { area / total } else { 1.0 };
    for entry in entries {
        entry.value *= if entry.kind == Kind::Whole { all } else { all * factor };
    }
}
