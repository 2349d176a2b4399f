//! Cells of the carrier, product rules on them, and their adaptive refinement.

use std::ops::Range;

use glam::{DVec2, DVec3};
use pulp::Arch;

use super::super::gauss::gauss;
use super::crowd::Crowd;
use super::events::{Region, Sight};
use super::lanes::{Arcs, LANES};

/// Orders of the product rules tried on a cell, one after another; the difference from the one before is the error estimate.
const ORDERS: [usize; 5] = [1, 2, 3, 5, 8];

/// Orders that a new cell gets at once.
const FIRST: usize = 3;

/// By so much the estimate falls at least from one order to the next where raising it further pays.
const CONVERGING: f64 = 0.1;

/// By so much the error may fall from one order to the next: a smaller difference is taken for a coincidence.
const COINCIDENCE: [f64; 5] = [1.0, 1.0, 1e-2, 1e-3, 1e-3];

/// Work on one pair, in points, beyond which the bound says what is open.
const MAX_WORK: u64 = 1 << 17;

/// Points that a shadow costs where the receiver is cut by one after another.
const CUTTING: u64 = 8;

/// Integrals of the hidden and of the visible form factor over cells, or estimates of their errors.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Parts {
    pub hidden: f64,
    pub visible: f64,
}

impl Parts {
    fn with(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Self { hidden: f(self.hidden, other.hidden), visible: f(self.visible, other.visible) }
    }

    fn worse_of(self, by_hidden: bool) -> f64 {
        if by_hidden { self.hidden } else { self.visible }
    }
}

impl std::iter::Sum for Parts {
    fn sum<I: Iterator<Item = Self>>(parts: I) -> Self {
        parts.fold(Self::default(), |a, b| a.with(b, |a, b| a + b))
    }
}

/// A quadrilateral of the carrier, or a triangle with two equal corners, in one region.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    corners: [DVec2; 4],
    region: usize,
    sight: Sight,
    /// Orders used so far.
    step: usize,
    value: Parts,
    /// Estimate of |error|, and the one before.
    error: Parts,
    before: Parts,
}

impl Cell {
    /// Cells of a convex loop.
    pub fn fan(part: &[DVec2], region: usize, sight: Sight) -> impl Iterator<Item = Self> + '_ {
        let last = part.len() - 1;
        let corners = move |k: usize| [part[0], part[k], part[k + 1], part[(k + 2).min(last)]];
        (1..last).step_by(2).map(move |k| Self::new(corners(k), region, sight))
    }

    fn new(corners: [DVec2; 4], region: usize, sight: Sight) -> Self {
        let none = Parts::default();
        Self { corners, region, sight, step: 0, value: none, error: none, before: none }
    }

    /// Takes the value of the next order.
    fn improve(&mut self, value: Parts) {
        if self.step > 0 {
            let difference = value.with(self.value, |new, old| (new - old).abs());
            let least = COINCIDENCE[self.step];
            // Where the differences fall fast, the error of the last value is as much below the last of them.
            let error = |now: f64, before: f64| (now * (now / (CONVERGING * before)).min(1.0)).max(least * before);
            self.before = self.error;
            self.error = if self.step > 1 { difference.with(self.error, error) } else { difference };
        }
        self.value = value;
        self.step += 1;
    }

    /// Whether a higher order is to be tried before cutting.
    fn converges(&self, by_hidden: bool) -> bool {
        self.step < ORDERS.len() && self.error.worse_of(by_hidden) <= CONVERGING * self.before.worse_of(by_hidden)
    }

    /// Two halves across the longer way.
    fn halves(&self) -> [[DVec2; 4]; 2] {
        let [a, b, c, d] = self.corners;
        if (b + c - a - d).length_squared() >= (c + d - a - b).length_squared() {
            let (m, n) = ((a + b) * 0.5, (c + d) * 0.5);
            [[a, m, n, d], [m, b, c, n]]
        } else {
            let (m, n) = ((b + c) * 0.5, (d + a) * 0.5);
            [[a, b, m, n], [n, m, c, d]]
        }
    }
}

/// The integral over all cells.
pub(super) struct Integration<'a> {
    pub arch: Arch,
    pub regions: &'a [Region],
    pub receiver: &'a [DVec3],
    /// Sums to the form factor of the whole receiver.
    pub whole: &'a Arcs,
    pub cells: Vec<Cell>,
    /// Points evaluated.
    pub points: u64,
    /// What they cost.
    pub work: u64,
    pub batch: Batch,
}

impl Integration<'_> {
    /// Refines until the estimated error of the hidden or of the visible part is at most `absolute`: both parts, and their errors.
    pub fn run(&mut self, absolute: f64) -> (Parts, Parts) {
        let all: Vec<usize> = (0..self.cells.len()).collect();
        self.raise(&all, FIRST);
        loop {
            let error: Parts = self.cells.iter().map(|cell| cell.error).sum();
            if error.hidden.min(error.visible) <= absolute || self.work >= MAX_WORK {
                return (self.cells.iter().map(|cell| cell.value).sum(), error);
            }
            self.refine(error.hidden <= error.visible, absolute);
        }
    }

    /// Raises the order of the worst cells, or halves them.
    fn refine(&mut self, by_hidden: bool, absolute: f64) {
        let error = |cell: &Cell| cell.error.worse_of(by_hidden);
        let mut worst: Vec<usize> = (0..self.cells.len()).filter(|&k| error(&self.cells[k]) > 0.0).collect();
        worst.sort_by(|&a, &b| error(&self.cells[b]).total_cmp(&error(&self.cells[a])).then(a.cmp(&b)));
        // The largest errors, until those of the others sum to half of what is allowed.
        let mut rest: f64 = worst.iter().map(|&k| error(&self.cells[k])).sum();
        let (mut raised, mut fresh) = (Vec::new(), Vec::new());
        for k in worst {
            if rest <= 0.5 * absolute {
                break;
            }
            let cell = self.cells[k];
            rest -= error(&cell);
            if cell.converges(by_hidden) {
                raised.push(k);
                continue;
            }
            let sight = |corners: &[DVec2; 4]| {
                if cell.sight == Sight::Partial { self.regions[cell.region].sight(corners) } else { cell.sight }
            };
            let [first, second] = cell.halves().map(|corners| Cell::new(corners, cell.region, sight(&corners)));
            fresh.extend([k, self.cells.len()]);
            self.cells[k] = first;
            self.cells.push(second);
        }
        self.raise(&raised, 1);
        self.raise(&fresh, FIRST);
    }

    /// Computes the next `count` orders of some cells.
    fn raise(&mut self, which: &[usize], count: usize) {
        let group = |cells: &[Cell], k: usize| (cells[k].region, cells[k].sight == Sight::Partial);
        let mut order: Vec<usize> = which.to_vec();
        // Points with the same arcs fill vectors together.
        order.sort_by_key(|&k| group(&self.cells, k));
        let mut batch = std::mem::take(&mut self.batch);
        let mut rest = &order[..];
        while let Some(&first) = rest.first() {
            let alike = |&&k: &&usize| group(&self.cells, k) == group(&self.cells, first);
            let (cells, others) = rest.split_at(rest.iter().take_while(alike).count());
            rest = others;
            let points = batch.compute(self, cells, count);
            let region = &self.regions[self.cells[first].region];
            let crowded = if self.cells[first].sight == Sight::Partial { region.crowded() } else { 0 };
            self.points += points;
            self.work += points * (1 + CUTTING * crowded);
            for (&k, values) in cells.iter().zip(batch.values.chunks(count)) {
                values.iter().for_each(|value| self.cells[k].improve(*value));
            }
        }
        self.batch = batch;
    }
}

/// Points of some cells, and what is found there.
#[derive(Default)]
pub(super) struct Batch {
    s: Vec<f64>,
    t: Vec<f64>,
    weights: Vec<f64>,
    whole: Vec<f64>,
    hidden: Vec<f64>,
    values: Vec<Parts>,
}

impl Batch {
    /// Evaluates the next orders of cells that are all of one region, and all partial or none; the number of points.
    fn compute(&mut self, on: &Integration<'_>, cells: &[usize], orders: usize) -> u64 {
        for list in [&mut self.s, &mut self.t, &mut self.weights, &mut self.whole, &mut self.hidden] {
            list.clear();
        }
        self.values.clear();
        for &k in cells {
            let cell = &on.cells[k];
            ORDERS[cell.step..cell.step + orders].iter().for_each(|&order| self.place(cell, order));
        }
        let first = &on.cells[cells[0]];
        let region = &on.regions[first.region];
        let count = self.s.len();
        let padded = count.next_multiple_of(LANES);
        let (s, t) = (self.s[0], self.t[0]);
        self.s.resize(padded, s);
        self.t.resize(padded, t);
        self.whole.resize(padded, 0.0);
        self.hidden.resize(padded, 0.0);
        on.whole.add(on.arch, &self.s, &self.t, &mut self.whole);
        if first.sight == Sight::Partial {
            region.hidden.add(on.arch, &self.s, &self.t, &mut self.hidden);
            let mut crowd = Crowd::default();
            for shadows in &region.crowds {
                for k in 0..count {
                    self.hidden[k] += self.whole[k] - crowd.visible(self.s[k], self.t[k], on.receiver, shadows);
                }
            }
        }
        let mut begin = 0;
        for &k in cells {
            let cell = &on.cells[k];
            for order in &ORDERS[cell.step..cell.step + orders] {
                let end = begin + order * order;
                self.values.push(self.sum(cell.sight, begin..end));
                begin = end;
            }
        }
        count as u64
    }

    /// The integrals over some points that see so much.
    fn sum(&self, sight: Sight, points: Range<usize>) -> Parts {
        let mut sum = Parts::default();
        for p in points {
            let (w, whole) = (self.weights[p], self.whole[p]);
            let hidden = match sight {
                Sight::Clear => 0.0,
                Sight::Hidden => whole,
                Sight::Partial => self.hidden[p],
            };
            sum.hidden += w * hidden;
            sum.visible += w * (whole - hidden);
        }
        sum
    }

    /// Adds the points of a rule on a cell.
    fn place(&mut self, cell: &Cell, order: usize) {
        let (nodes, shares) = gauss(order);
        let [a, b, c, d] = cell.corners;
        let (u, v, w) = ((b + c - a - d) * 0.25, (c + d - a - b) * 0.25, (a + c - b - d) * 0.25);
        let middle = (a + b + c + d) * 0.25;
        for (x, w_x) in nodes.iter().zip(shares) {
            for (y, w_y) in nodes.iter().zip(shares) {
                let at = middle + u * *x + v * *y + w * (x * y);
                self.s.push(at.x);
                self.t.push(at.y);
                self.weights.push(4.0 * w_x * w_y * (u + w * *y).perp_dot(v + w * *x));
            }
        }
    }
}
