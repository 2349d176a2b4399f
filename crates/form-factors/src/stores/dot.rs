//! Products of one row with several bands, at the speed of memory.
//!
//! Rows are read once for up to three bands, and up to four of them together, so that neither the latency of an addition nor the
//! reading of x holds them back: three bands of x are three times what a row is, and come from a second-level cache. The
//! instruction set is chosen at run time by `pulp`; the order of additions depends on it and on nothing else, so a row and a band
//! alone have the bytes that they have among others.

use std::ops::Range;

use radiosity_core::Bands;

use super::lanes::{Lanes, Work, run};
use crate::level::Level;

/// sums_sb = Σ_t row_st x_bt over the targets from `first` on, the bands of one of the `rows` (all of one length) after another.
pub(super) fn dense(rows: &[&[f64]], x: Bands<'_>, first: usize, sums: &mut [f64]) {
    assert_eq!(sums.len(), rows.len() * x.count(), "a sum for every row and band");
    run(Level::best(), Dense { rows, x, first, sums });
}

/// sums_b = Σ_k values_k x_b,targets_k, one for each band, with the bands of x as [`Abreast`] has them.
pub(super) fn sparse<const W: usize>(targets: &[u32], values: &[f64], x: &Abreast<W>, sums: &mut [f64]) {
    run(Level::best(), Sparse { targets, values, x, sums });
}

/// x with the values of a target in W bands side by side, so that one line of the cache serves them all: groups of W bands one after
/// another, 0 beyond the last band.
pub(super) struct Abreast<const W: usize> {
    values: Vec<[f64; W]>,
    len: usize,
}

impl<const W: usize> Abreast<W> {
    pub(super) fn new(x: Bands<'_>) -> Self {
        let mut abreast = Self { values: vec![[0.0; W]; x.count().div_ceil(W) * x.len()], len: x.len() };
        abreast.set(0..x.len(), x);
        abreast
    }

    /// Takes the values of x in `range`.
    pub(super) fn set(&mut self, range: Range<usize>, x: Bands<'_>) {
        for b in 0..x.count() {
            let of_group = &mut self.values[b / W * self.len..][range.clone()];
            of_group.iter_mut().zip(&x.band(b)[range.clone()]).for_each(|(values, x)| values[b % W] = *x);
        }
    }

    /// Sets the values in `range` to 0.
    pub(super) fn clear(&mut self, range: Range<usize>) {
        self.values.chunks_exact_mut(self.len).for_each(|group| group[range.clone()].fill([0.0; W]));
    }
}

struct Dense<'a> {
    rows: &'a [&'a [f64]],
    x: Bands<'a>,
    first: usize,
    sums: &'a mut [f64],
}

impl Work for Dense<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { mut rows, x, first, mut sums } = self;
        let bands = x.count();
        while !rows.is_empty() {
            let together = if rows.len() < L::ROWS { 1 } else { L::ROWS };
            let (now, later) = rows.split_at(together);
            let (sums_now, sums_later) = sums.split_at_mut(together * bands);
            match *now {
                [a, b, c, d] => rows_of(lanes, [a, b, c, d], x, first, sums_now),
                [a, b] => rows_of(lanes, [a, b], x, first, sums_now),
                _ => rows_of(lanes, [now[0]], x, first, sums_now),
            }
            (rows, sums) = (later, sums_later);
        }
    }
}

/// Every band of R rows.
#[inline(always)]
fn rows_of<L: Lanes, const R: usize>(lanes: L, rows: [&[f64]; R], x: Bands<'_>, first: usize, sums: &mut [f64]) {
    let mut band = 0;
    while band < x.count() {
        // As many bands at once as leave a register for every sum.
        band += match x.count() - band {
            1 => dense_group::<L, R, 1>(lanes, rows, x, first, band, sums),
            2 | 4 => dense_group::<L, R, 2>(lanes, rows, x, first, band, sums),
            _ => dense_group::<L, R, 3>(lanes, rows, x, first, band, sums),
        };
    }
}

/// Running sums of a row and band.
const SUMS: usize = 2;
/// Running sums of a band of a sparse row, whose values come one by one.
const SPARSE_SUMS: usize = 8;

#[inline(always)]
fn dense_group<L: Lanes, const R: usize, const B: usize>(
    lanes: L,
    rows: [&[f64]; R],
    x: Bands<'_>,
    first: usize,
    band: usize,
    sums: &mut [f64],
) -> usize {
    let len = rows[0].len();
    let x_rest: [&[f64]; B] = std::array::from_fn(|b| &x.band(band + b)[first..first + len]);
    let vectors: [&[L::f64s]; R] = rows.map(|row| L::as_simd_f64s(&row[..len]).0);
    let whole = vectors[0].len() / SUMS * SUMS;
    let x_vectors: [&[L::f64s]; B] = x_rest.map(|x| &L::as_simd_f64s(x).0[..vectors[0].len()]);
    let mut running = [[[lanes.splat_f64s(0.0); SUMS]; B]; R];
    for k in (0..whole).step_by(SUMS) {
        for l in 0..SUMS {
            let x: [L::f64s; B] = std::array::from_fn(|b| x_vectors[b][k + l]);
            for (running, row) in running.iter_mut().zip(&vectors) {
                let v = row[k + l];
                for (running, x) in running.iter_mut().zip(x) {
                    running[l] = lanes.mul_add_e_f64s(v, x, running[l]);
                }
            }
        }
    }
    for k in whole..vectors[0].len() {
        for (running, row) in running.iter_mut().zip(&vectors) {
            for (running, x) in running.iter_mut().zip(&x_vectors) {
                running[0] = lanes.mul_add_e_f64s(row[k], x[k], running[0]);
            }
        }
    }
    let done = vectors[0].len() * L::F64_LANES;
    for (s, running) in running.into_iter().enumerate() {
        for (b, running) in running.into_iter().enumerate() {
            let tail: f64 = rows[s][done..].iter().zip(&x_rest[b][done..]).map(|(v, x)| v * x).sum();
            sums[s * x.count() + band + b] = lanes.reduce_sum_f64s(lanes.add_f64s(running[0], running[1])) + tail;
        }
    }
    B
}

struct Sparse<'a, const W: usize> {
    targets: &'a [u32],
    values: &'a [f64],
    x: &'a Abreast<W>,
    sums: &'a mut [f64],
}

impl<const W: usize> Work for Sparse<'_, W> {
    // Plain code, without fused products: the same bytes with every instruction set.
    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        for (group, sums) in self.sums.chunks_mut(W).enumerate() {
            let x = &self.x.values[group * self.x.len..][..self.x.len];
            sparse_group(self.targets, self.values, x, sums);
        }
    }
}

#[inline(always)]
fn sparse_group<const W: usize>(targets: &[u32], values: &[f64], x: &[[f64; W]], sums: &mut [f64]) {
    let (targets, last_targets) = targets.as_chunks::<SPARSE_SUMS>();
    let (values, last_values) = values.as_chunks::<SPARSE_SUMS>();
    let mut running = [[0.0; W]; SPARSE_SUMS];
    for (t, v) in targets.iter().zip(values) {
        for l in 0..SPARSE_SUMS {
            let x = x[t[l] as usize];
            for b in 0..W {
                running[l][b] += v[l] * x[b];
            }
        }
    }
    for ((t, v), running) in last_targets.iter().zip(last_values).zip(&mut running) {
        let x = x[*t as usize];
        for b in 0..W {
            running[b] += v * x[b];
        }
    }
    for (b, sum) in sums.iter_mut().enumerate() {
        let [r0, r1, r2, r3, r4, r5, r6, r7] = running.map(|of_bands| of_bands[b]);
        *sum = ((r0 + r1) + (r2 + r3)) + ((r4 + r5) + (r6 + r7));
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::values;
    use super::*;

    /// Lengths around whole vectors and whole groups of them; sums of at most 70 terms of size 50 in any order.
    #[test]
    fn rows_of_any_length_and_any_number_of_bands_are_summed() {
        for len in [0, 1, 3, 7, 8, 9, 31, 32, 33, 67] {
            let row: Vec<f64> = (0..len).map(|t| 1.0 / (t + 1) as f64).collect();
            let targets: Vec<u32> = (0..len as u32).rev().collect();
            for bands in 1..=7 {
                let x = values(bands, len.max(1) + 2);
                let (mut plain, mut listed) = (vec![f64::NAN; bands], vec![f64::NAN; bands]);
                dense(&[&row], x.view(), 2, &mut plain);
                sparse(&targets, &row, &Abreast::<2>::new(x.view()), &mut listed);
                for b in 0..bands {
                    let along: f64 = (0..len).map(|t| row[t] * x.band(b)[t + 2]).sum();
                    let back: f64 = (0..len).map(|t| row[t] * x.band(b)[len - 1 - t]).sum();
                    assert!((plain[b] - along).abs() < 1e-12, "{len}, band {b} of {bands}");
                    assert!((listed[b] - back).abs() < 1e-12, "{len}, band {b} of {bands}");
                }
            }
        }
    }
}
