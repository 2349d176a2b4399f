//! Entries of a row from what a hemicube shows, from pairs where pixels are no good.
//!
//! A pair takes about as long as some hundred pixels. It is taken where the estimate of proximity exceeds a standard error of
//! aliasing, so that finer pixels would not help, and where a receiver covers too few pixels to be told from its neighbours.

use radiosity_core::Cost;
use radiosity_geometry::Polygon;
use rayon::prelude::*;

use super::estimate::{Moments, aliasing, kernel, middle};
use super::raster::{BACK, EMPTY, Shown};
use super::view::{Frame, View};
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

/// A polygon that sends, with what its hemicube sees.
struct Sender<'a> {
    polygon: &'a Polygon,
    moments: Moments,
    view: &'a View,
    exact_near: bool,
}

impl Sender<'_> {
    /// The entry that the pixels give, with whether it is to come from the pair.
    fn by_pixels(&self, seen: u32, target: u32, shown: &Shown) -> Entry {
        let (area, of) = (self.polygon.area(), &self.view.seen[seen as usize]);
        let sides = &self.view.sides[of.sides.clone()];
        let (sigma, proximity) =
            (aliasing(shown).sqrt(), shown.factor * self.moments.proximity(middle(sides), of.plane));
        let between_pixels = if shown.whole_pixels == 0 { kernel(of, sides) } else { 0.0 };
        let visible = shown.pixels > 0 || shown.glimpsed;
        let kind = match self.exact_near && visible && (proximity > sigma || shown.whole_pixels < FEW) {
            false => Kind::Pixels,
            true if shown.pixels == shown.whole_pixels => Kind::Whole,
            true => Kind::Share,
        };
        let bound = area * (SIGMAS * sigma + proximity + between_pixels);
        Entry { seen, target, value: area * shown.factor, bound, kind }
    }

    /// The entry that the pair with `target` gives.
    fn by_pair(&self, entry: Entry, target: &Polygon, shown: &Shown) -> Entry {
        let whole = unoccluded(self.polygon, target, TOLERANCE);
        if entry.kind == Kind::Whole {
            return Entry { value: whole.value, bound: whole.bound, ..entry };
        }
        let (share, error) = (shown.factor / shown.whole, SIGMAS * aliasing(shown).sqrt() / shown.whole);
        Entry { value: whole.value * share, bound: whole.bound + whole.value * error, ..entry }
    }
}

impl Hemicube<'_> {
    /// Entries of the row of `source` from what `scratch` shows, and the pairs that some of them took.
    pub(super) fn entries(&self, source: &Polygon, frame: &Frame, scratch: &mut Scratch) -> Cost {
        let Scratch { view, faces, shown, entries } = scratch;
        let (view, shown) = (&*view, &shown[..]);
        let sender = Sender { polygon: source, moments: Moments::of(source, frame), view, exact_near: self.exact_near };
        entries.clear();
        // What else the pixels show: nothing, backs, and fronts that do not receive.
        let mut other: f64 = faces.iter().map(|face| face[EMPTY].factor + face[BACK].factor).sum();
        for (k, (seen, shown)) in view.seen.iter().zip(shown).enumerate().filter(|(_, (seen, _))| seen.front) {
            match self.polygons[seen.polygon as usize].1 {
                Some(target) => entries.push(sender.by_pixels(k as u32, target, shown)),
                None => other += shown.factor,
            }
        }
        let near: Vec<usize> = (0..entries.len()).filter(|&k| entries[k].kind != Kind::Pixels).collect();
        let by_pair = |&k: &usize| {
            let (entry, seen) = (entries[k], entries[k].seen as usize);
            sender.by_pair(entry, self.polygons[view.seen[seen].polygon as usize].0, &shown[seen])
        };
        let pairs: Vec<Entry> = near.par_iter().with_min_len(PIECE).map(by_pair).collect();
        let of_kind = |kind: Kind| pairs.iter().filter(|entry| entry.kind == kind).count() as u64;
        let (clear_pairs, partial_pairs) = (of_kind(Kind::Whole), of_kind(Kind::Share));
        near.into_iter().zip(pairs).for_each(|(k, entry)| entries[k] = entry);
        if self.exact_near {
            close(entries, source.area(), other);
        }
        Cost { clear_pairs, partial_pairs, ..Cost::default() }
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
