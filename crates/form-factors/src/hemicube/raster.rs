//! Item buffers: which polygon each pixel of a hemicube face shows.
//!
//! A pixel centre is a direction d = forward + x·right + y·up from the eye. A polygon with corners a, b, … as seen from
//! the eye covers d when every edge function (a × b)·d has the sign of the polygon's side; this is the homogeneous
//! test of Olano and Greer (1997): linear in x and y, with no division by a depth, so that polygons that reach behind
//! the eye need no clipping. In a row of pixels each edge leaves a half line of x, and a convex polygon one run. Neighbours
//! find the end of their runs from the same edge function by operations that keep order, so no pixel slips between them.
//!
//! Depth is 1/t = (n·d)/(n·a), also linear. Depth and item share one word: the depth's leading bits above the number of
//! the item. The nearer of two is then the larger word, so that a run is drawn by `max` alone, on any number of lanes, and
//! neither the order of drawing nor the instruction set changes a bit of the result.
//!
//! A front that covers no pixel centre is looked at along one more direction, that of its own centre: it is seen there unless a
//! polygon that covers the direction is nearer, by the edge functions and depths above. What the pixels around it show does not
//! say, since what is nearer may itself end, or lie, between them. So nothing is seen of what others hide wholly, by one polygon or
//! by several that meet.

use pulp::{Simd, WithSimd};

use super::delta::DeltaFormFactors;
use super::view::{Seen, Side, View, on_face};

/// Bits of a word that hold the item: at least so many, and more where a face has more polygons.
///
/// The 32 bits of the depth that are left tell depths apart to 2⁻³²; what is closer is the same surface.
const ITEM_BITS: u32 = 20;
/// Backs are set behind the fronts of the same sheet by this share of their depth.
const BEHIND: f64 = 1.0 - 1.0 / (1 << 30) as f64;
/// Places of right and up among the axes of a face.
const RIGHT: usize = 1;
const UP: usize = 2;
/// Item of pixels that show nothing.
pub(super) const EMPTY: usize = 0;
/// Item of pixels that show the back of something.
pub(super) const BACK: usize = 1;
/// Item of the first polygon of a face.
pub(super) const FIRST: usize = 2;

/// What the pixels of one or more faces show of an item.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Shown {
    /// Σ ΔF over the pixels that show it.
    pub factor: f64,
    /// Pixels that show it.
    pub pixels: u64,
    /// Runs of pixels in a row that show it.
    pub runs: u64,
    /// Σ ΔF² over the first and the last pixel of the runs.
    pub ends: f64,
    /// Σ ΔF over the pixels that would show it if nothing were before it.
    pub whole: f64,
    /// Number of these pixels.
    pub whole_pixels: u64,
    /// Of a polygon between pixel centres: whether nothing lies before its centre.
    pub glimpsed: bool,
}

impl Shown {
    /// Adds a run of pixels, given the sums of ΔF from before its first to after its last.
    #[inline(always)]
    fn add_run(&mut self, sums: &[f64]) {
        let last = sums.len() - 1;
        let (first_factor, last_factor) = (sums[1] - sums[0], sums[last] - sums[last - 1]);
        self.factor += sums[last] - sums[0];
        self.pixels += last as u64;
        self.runs += 1;
        self.ends += first_factor * first_factor + last_factor * last_factor;
    }

    /// Adds what another face shows of the item.
    pub fn add(&mut self, other: &Self) {
        self.factor += other.factor;
        self.pixels += other.pixels;
        self.runs += other.runs;
        self.ends += other.ends;
        self.whole += other.whole;
        self.whole_pixels += other.whole_pixels;
        self.glimpsed |= other.glimpsed;
    }
}

/// An edge function in the rows of a face: the pixels on its inner side.
#[derive(Clone, Copy, Debug)]
struct Edge {
    /// Value at x = y = 0, slack included, and its change with y.
    at: f64,
    up: f64,
    /// Pixels per value: half the resolution over the change with x, negative where the inner side is to the right.
    scale: f64,
}

/// The centre of a front between the pixel centres: the direction forward + x·right + y·up and the depth there.
#[derive(Clone, Copy, Debug)]
struct Glimpse {
    item: usize,
    x: f64,
    y: f64,
    depth: f64,
}

/// Item buffer of one face and what it takes to draw it.
#[derive(Debug, Default)]
pub(super) struct Canvas {
    /// Words of depth and item, row after row, rows padded to whole vectors.
    words: Vec<f64>,
    /// Edges that bound the polygon at hand to the left, and to the right.
    left: Vec<Edge>,
    right: Vec<Edge>,
    /// Fronts between the pixel centres.
    glimpses: Vec<Glimpse>,
}

/// Pixels to which rows are padded: the widest vector.
const LANES: usize = 8;

/// Drawing of one face.
pub(super) struct Draw<'a> {
    pub view: &'a View,
    pub face: usize,
    pub delta: &'a DeltaFormFactors,
    /// x of the pixel centres, padded to whole vectors.
    pub centres: &'a [f64],
    pub canvas: &'a mut Canvas,
    /// Empty pixels, backs, then every polygon of the face.
    pub shown: &'a mut Vec<Shown>,
    /// Whether to look for polygons between the pixel centres.
    pub glimpse: bool,
}

/// x (and y) of the pixel centres of a row, padded to whole vectors.
pub(super) fn centres(resolution: usize) -> Vec<f64> {
    let at = |k: usize| (2 * k + 1) as f64 / resolution as f64 - 1.0;
    (0..resolution.next_multiple_of(LANES)).map(at).collect()
}

impl WithSimd for Draw<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (rows, width) = (self.delta.rows(self.face), self.centres.len());
        self.canvas.words.clear();
        self.canvas.words.resize(rows * width, 0.0);
        let polygons = &self.view.faces[self.face];
        self.shown.clear();
        self.shown.resize(FIRST + polygons.len(), Shown::default());
        let item_mask = (1_u64 << ITEM_BITS.max(u64::BITS - (self.shown.len() as u64).leading_zeros())) - 1;
        for (k, &seen) in polygons.iter().enumerate() {
            self.polygon(simd, &self.view.seen[seen as usize], FIRST + k, item_mask);
        }
        for row in 0..rows {
            let words = &self.canvas.words[row * width..][..self.delta.resolution()];
            scan(words, self.delta.row(self.face, row), item_mask, self.shown);
        }
        if self.glimpse {
            self.find_glimpses();
            self.hide_glimpses();
        }
    }
}

impl Draw<'_> {
    /// Draws a polygon.
    #[inline(always)]
    fn polygon<S: Simd>(&mut self, simd: S, seen: &Seen, number: usize, item_mask: u64) {
        let Some((begin, end)) = self.rows(seen) else { return };
        self.edges(seen);
        let [forward, right, up] = on_face(self.face, seen.plane);
        let (item, keep) = if seen.front { (number, 1.0) } else { (BACK, BEHIND) };
        let (item, depth_bits) = (simd.splat_u64s(item as u64), simd.splat_u64s(!item_mask));
        let slope = simd.splat_f64s(right * keep);
        let (first_row, resolution) = (self.delta.resolution() - self.delta.rows(self.face), self.delta.resolution());
        let (width, shift) = (self.centres.len(), 0.5 * (resolution as f64 - 1.0));
        let centres = S::as_simd_f64s(self.centres).0;
        let (mut whole, mut pixels) = (0.0, 0);
        for row in begin..end {
            let y = self.centres[row + first_row];
            // First and last pixel, as real numbers; slack moves them outward.
            let (mut lo, mut hi) = (0.0_f64, resolution as f64 - 1.0);
            for edge in &self.canvas.left {
                lo = lo.max((edge.at + edge.up * y) * edge.scale + shift);
            }
            for edge in &self.canvas.right {
                hi = hi.min((edge.at + edge.up * y) * edge.scale + shift);
            }
            let (lo, hi) = (lo.ceil(), hi.floor());
            if lo > hi {
                continue;
            }
            let (from, to) = (lo as usize, hi as usize + 1);
            let at = simd.splat_f64s((forward + up * y) * keep);
            let line = Line { simd, at, right: slope, depth_bits, item };
            let words = S::as_mut_simd_f64s(&mut self.canvas.words[row * width..][..width]).0;
            line.draw(words, centres, from, to);
            if seen.front {
                let sums = self.delta.row(self.face, row);
                whole += sums[to] - sums[from];
                pixels += to - from;
            }
        }
        if seen.front {
            (self.shown[number].whole, self.shown[number].whole_pixels) = (whole, pixels as u64);
        }
    }

    /// The rows of pixels from the lowest to above the highest corner.
    #[inline(always)]
    fn rows(&self, seen: &Seen) -> Option<(usize, usize)> {
        let (lo, hi) = self.extent(seen, UP);
        let rows = self.delta.rows(self.face);
        let (half, first) = (0.5 * self.delta.resolution() as f64, self.delta.resolution() - rows);
        let at = |y: f64| (y + 1.0) * half - 0.5 - first as f64;
        let (begin, end) = (at(lo).ceil().max(0.0), at(hi).floor().min(rows as f64 - 1.0));
        (begin <= end).then_some((begin as usize, end as usize + 1))
    }

    /// Where a polygon begins and ends in x or y, or all directions if it reaches behind the face.
    #[inline(always)]
    fn extent(&self, seen: &Seen, axis: usize) -> (f64, f64) {
        let (mut ahead, mut lo, mut hi) = (true, f64::INFINITY, f64::NEG_INFINITY);
        for side in &self.view.sides[seen.sides.clone()] {
            let corner = on_face(self.face, side.corner);
            ahead &= corner[0] > 0.0;
            (lo, hi) = (lo.min(corner[axis] / corner[0]), hi.max(corner[axis] / corner[0]));
        }
        if !ahead {
            return (f64::NEG_INFINITY, f64::INFINITY);
        }
        // A millionth of a pixel is far more than rounding, and far less than a row.
        let margin = 2e-6 / self.delta.resolution() as f64;
        (lo - margin, hi + margin)
    }

    /// Edges of a polygon on this face, by the side that they bound.
    #[inline(always)]
    fn edges(&mut self, seen: &Seen) {
        self.canvas.left.clear();
        self.canvas.right.clear();
        let half = 0.5 * self.delta.resolution() as f64;
        for side in &self.view.sides[seen.sides.clone()] {
            let [forward, right, up] = on_face(self.face, side.edge);
            // An edge along the rows takes all of a row or nothing: its end lies beyond either border.
            let scale = (half / right.abs()).min(f64::MAX);
            let edge = |scale| Edge { at: forward + side.slack, up, scale };
            if right >= 0.0 {
                self.canvas.left.push(edge(-scale));
            } else {
                self.canvas.right.push(edge(scale));
            }
        }
    }

    /// Finds the fronts that cover no pixel centre and have their own centre on this face, from the lowest to the highest.
    #[inline(always)]
    fn find_glimpses(&mut self) {
        let bottom = if self.face == 0 { -1.0 } else { 0.0 };
        self.canvas.glimpses.clear();
        for (k, &number) in self.view.faces[self.face].iter().enumerate() {
            let (seen, item) = (&self.view.seen[number as usize], FIRST + k);
            if !seen.front || self.shown[item].whole_pixels > 0 {
                continue;
            }
            let sides = &self.view.sides[seen.sides.clone()];
            let [forward, right, up] = on_face(self.face, sides.iter().map(|side| side.corner).sum());
            let (x, y) = (right / forward, up / forward);
            if forward > 0.0 && (-1.0..1.0).contains(&x) && (bottom..1.0).contains(&y) {
                self.shown[item].glimpsed = true;
                self.canvas.glimpses.push(Glimpse { item, x, y, depth: linear(on_face(self.face, seen.plane), x, y) });
            }
        }
        self.canvas.glimpses.sort_unstable_by(|a, b| a.y.total_cmp(&b.y));
    }

    /// Takes back the glimpses that lie behind some polygon.
    #[inline(always)]
    fn hide_glimpses(&mut self) {
        let glimpses = &self.canvas.glimpses;
        if glimpses.is_empty() {
            return;
        }
        for &number in &self.view.faces[self.face] {
            let seen = &self.view.seen[number as usize];
            let (lo, hi) = self.extent(seen, UP);
            let from = glimpses.partition_point(|glimpse| glimpse.y < lo);
            let level = &glimpses[from..from + glimpses[from..].partition_point(|glimpse| glimpse.y <= hi)];
            if level.is_empty() {
                continue;
            }
            let (lo, hi) = self.extent(seen, RIGHT);
            // What is nearer by less is the same surface.
            let keep = if seen.front { BEHIND } else { BEHIND * BEHIND };
            let (plane, sides) = (on_face(self.face, seen.plane), &self.view.sides[seen.sides.clone()]);
            for &Glimpse { item, x, y, depth } in level.iter().filter(|glimpse| (lo..=hi).contains(&glimpse.x)) {
                let inside = |side: &Side| linear(on_face(self.face, side.edge), x, y) + side.slack >= 0.0;
                if linear(plane, x, y) * keep > depth && sides.iter().all(inside) {
                    self.shown[item].glimpsed = false;
                }
            }
        }
    }
}

/// v·d for the direction d = forward + x·right + y·up, given v on the axes of the face.
#[inline(always)]
fn linear([forward, right, up]: [f64; 3], x: f64, y: f64) -> f64 {
    forward + right * x + up * y
}

/// Depth and item of one polygon in one row, as vectors.
#[derive(Clone, Copy)]
struct Line<S: Simd> {
    simd: S,
    /// Depth 1/t at x = 0 and its change with x.
    at: S::f64s,
    right: S::f64s,
    /// Bits of a word that hold depth.
    depth_bits: S::u64s,
    item: S::u64s,
}

impl<S: Simd> Line<S> {
    /// Words of a vector of pixels.
    ///
    /// Multiplication and addition stay apart, so that every instruction set rounds alike.
    #[inline(always)]
    fn words(self, centres: S::f64s) -> S::f64s {
        let simd = self.simd;
        let depth = simd.transmute_u64s_f64s(simd.add_f64s(self.at, simd.mul_f64s(self.right, centres)));
        simd.transmute_f64s_u64s(simd.or_u64s(simd.and_u64s(depth, self.depth_bits), self.item))
    }

    /// Draws the pixels from `from` to before `to` of a vector.
    #[inline(always)]
    fn part(self, word: &mut S::f64s, centres: S::f64s, from: usize, to: usize) {
        let simd = self.simd;
        let inside = simd.mask_between_m64s(from as u64, to as u64).mask();
        *word = simd.max_f64s(*word, simd.select_f64s(inside, self.words(centres), simd.splat_f64s(0.0)));
    }

    /// Draws the pixels from `from` to before `to` of a row.
    #[inline(always)]
    fn draw(self, words: &mut [S::f64s], centres: &[S::f64s], from: usize, to: usize) {
        let lanes = S::F64_LANES;
        let (first, last) = (from / lanes, (to - 1) / lanes);
        if first == last {
            self.part(&mut words[first], centres[first], from - first * lanes, to - first * lanes);
            return;
        }
        self.part(&mut words[first], centres[first], from - first * lanes, lanes);
        self.part(&mut words[last], centres[last], 0, to - last * lanes);
        for (word, &x) in words[first + 1..last].iter_mut().zip(&centres[first + 1..last]) {
            *word = self.simd.max_f64s(*word, self.words(x));
        }
    }
}

/// Adds a row of the item buffer to what is shown of its items.
#[inline(always)]
fn scan(words: &[f64], sums: &[f64], item_mask: u64, shown: &mut [Shown]) {
    let (mut item, mut from) = (words[0].to_bits() & item_mask, 0);
    for (k, chunk) in words.chunks(LANES).enumerate() {
        let mut differ = 0;
        for word in chunk {
            differ |= word.to_bits() ^ item;
        }
        if differ & item_mask == 0 {
            continue;
        }
        for (l, word) in chunk.iter().enumerate() {
            let next = word.to_bits() & item_mask;
            if next != item {
                shown[item as usize].add_run(&sums[from..=k * LANES + l]);
                (item, from) = (next, k * LANES + l);
            }
        }
    }
    shown[item as usize].add_run(&sums[from..=words.len()]);
}
