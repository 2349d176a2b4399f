//! Products of one row with several bands, at the speed of memory.
//!
//! A row is read once for up to three bands, with four sums a band, so that neither the latency of an addition nor a second reading holds
//! it back. The instruction set is chosen at run time by `pulp`; the order of additions depends on it and on nothing else, so a band
//! alone has the bytes that it has among others.

use pulp::{Arch, Simd, WithSimd};
use radiosity_core::Bands;

/// sums_b = Σ_t row_t x_bt over the targets from `first` on, one for each band.
pub(super) fn dense(row: &[f64], x: Bands<'_>, first: usize, sums: &mut [f64]) {
    Arch::new().dispatch(Dense { row, x, first, sums });
}

/// sums_b = Σ_k values_k x_b,targets_k, one for each band.
pub(super) fn sparse(targets: &[u32], values: &[f64], x: Bands<'_>, sums: &mut [f64]) {
    let mut band = 0;
    while band < sums.len() {
        band += match sums.len() - band {
            1 => sparse_group::<1>(targets, values, x, band, sums),
            2 | 4 => sparse_group::<2>(targets, values, x, band, sums),
            _ => sparse_group::<3>(targets, values, x, band, sums),
        };
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

fn sparse_group<const B: usize>(targets: &[u32], values: &[f64], x: Bands<'_>, band: usize, sums: &mut [f64]) -> usize {
    let x: [&[f64]; B] = std::array::from_fn(|b| x.band(band + b));
    let mut running = [[0.0; SUMS]; B];
    let whole = values.len() / SUMS * SUMS;
    for (t, v) in targets[..whole].chunks_exact(SUMS).zip(values.chunks_exact(SUMS)) {
        for (running, x) in running.iter_mut().zip(&x) {
            for l in 0..SUMS {
                running[l] += v[l] * x[t[l] as usize];
            }
        }
    }
    for (b, running) in running.into_iter().enumerate() {
        let rest = targets[whole..].iter().zip(&values[whole..]);
        let tail: f64 = rest.map(|(&t, v)| v * x[b][t as usize]).sum();
        sums[band + b] = (running[0] + running[1]) + (running[2] + running[3]) + tail;
    }
    B
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
                sparse(&targets, &row, x.view(), &mut listed);
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
