//! Products of one row with several bands, at the speed of memory.
//!
//! A row is read once for up to three bands, with four sums a band, so that neither the latency of an addition nor a second reading holds
//! it back. The instruction set is chosen at run time by `pulp`; the order of additions depends on it and on nothing else, so a band
//! alone has the bytes that it has among others.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};
use radiosity_core::Bands;

/// sums_b = Σ_t row_t x_bt over the targets from `first` on, one for each band.
pub(super) fn dense(row: &[f64], x: Bands<'_>, first: usize, sums: &mut [f64]) {
    Arch::new().dispatch(Dense { row, x, first, sums });
}

/// sums_b = Σ_k values_k x_b,targets_k, one for each band, with the bands of x as [`Abreast`] has them.
pub(super) fn sparse<const W: usize>(targets: &[u32], values: &[f64], x: &Abreast<W>, sums: &mut [f64]) {
    Arch::new().dispatch(Sparse { targets, values, x, sums });
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
    row: &'a [f64],
    x: Bands<'a>,
    first: usize,
    sums: &'a mut [f64],
}

impl WithSimd for Dense<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let mut band = 0;
        while band < self.sums.len() {
            // As many bands at once as leave a register for every sum.
            band += match self.sums.len() - band {
                1 => dense_group::<S, 1>(simd, self.row, self.x, self.first, band, self.sums),
                2 | 4 => dense_group::<S, 2>(simd, self.row, self.x, self.first, band, self.sums),
                _ => dense_group::<S, 3>(simd, self.row, self.x, self.first, band, self.sums),
            };
        }
    }
}

/// Running sums of a band.
const SUMS: usize = 4;
/// Running sums of a band of a sparse row, whose values come one by one.
const SPARSE_SUMS: usize = 8;

#[inline(always)]
fn dense_group<S: Simd, const B: usize>(
    simd: S,
    row: &[f64],
    x: Bands<'_>,
    first: usize,
    band: usize,
    sums: &mut [f64],
) -> usize {
    let x: [&[f64]; B] = std::array::from_fn(|b| &x.band(band + b)[first..first + row.len()]);
    let (vectors, rest) = S::as_simd_f64s(row);
    let x_vectors: [&[S::f64s]; B] = x.map(|x| S::as_simd_f64s(x).0);
    let mut running = [[simd.splat_f64s(0.0); SUMS]; B];
    let whole = vectors.len() / SUMS * SUMS;
    for (k, v) in vectors[..whole].chunks_exact(SUMS).enumerate() {
        let at = k * SUMS;
        for (running, x) in running.iter_mut().zip(&x_vectors) {
            let x = &x[at..at + SUMS];
            for l in 0..SUMS {
                running[l] = simd.mul_add_e_f64s(v[l], x[l], running[l]);
            }
        }
    }
    for (k, v) in vectors.iter().enumerate().skip(whole) {
        for (running, x) in running.iter_mut().zip(&x_vectors) {
            running[0] = simd.mul_add_e_f64s(*v, x[k], running[0]);
        }
    }
    for (b, running) in running.into_iter().enumerate() {
        let pairs = (simd.add_f64s(running[0], running[1]), simd.add_f64s(running[2], running[3]));
        let tail: f64 = rest.iter().zip(&x[b][row.len() - rest.len()..]).map(|(v, x)| v * x).sum();
        sums[band + b] = simd.reduce_sum_f64s(simd.add_f64s(pairs.0, pairs.1)) + tail;
    }
    B
}

struct Sparse<'a, const W: usize> {
    targets: &'a [u32],
    values: &'a [f64],
    x: &'a Abreast<W>,
    sums: &'a mut [f64],
}

impl<const W: usize> WithSimd for Sparse<'_, W> {
    type Output = ();

    // Plain code, without fused products: the same bytes with every instruction set.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
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
                dense(&row, x.view(), 2, &mut plain);
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
