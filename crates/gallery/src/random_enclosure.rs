//! A random closed enclosure: symmetric exchange areas whose rows sum to the areas.

use radiosity_core::{Bands, Cost, FormFactors, StoreError, System};
use radiosity_form_factors::Rows;
use radiosity_form_factors::stores::{DenseFormFactors, Keep, OnDemand, PackedFormFactors, SparseFormFactors};

/// Symmetric exchange areas A_s F_st with zero diagonal and row sums A_s, to rounding, at any size.
///
/// A symmetric random matrix K with entries in [0.1, 1) is scaled to D K D with the positive D that gives the row sums
/// (R. Sinkhorn and P. Knopp, "Concerning nonnegative matrices and doubly stochastic matrices", 1967, in its symmetric
/// form d_s ← √(d_s A_s / (K d)_s)). There is no geometry behind it: F is well mixed, and all eigenvalues but one are
/// small.
#[derive(Clone, Debug)]
pub struct RandomEnclosure {
    /// Areas, in [1, 2).
    pub areas: Vec<f64>,
    /// A_s F_st, row after row.
    pub exchange: Vec<f64>,
    /// E of one band: every fifth element emits.
    pub emission: Vec<f64>,
    /// ρ of one band, in [0.1, 0.9), and 0 for every seventh element.
    pub reflectance: Vec<f64>,
}

/// The next of a sequence of numbers in [0, 1) (Steele, Lea and Flood's SplitMix, 2014).
pub(crate) fn uniform(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

impl RandomEnclosure {
    /// An enclosure of n elements; the same seed gives the same bytes.
    ///
    /// # Panics
    ///
    /// If n is below 4: three areas in [1, 2) need not close.
    pub fn new(n: usize, seed: u64) -> Self {
        assert!(n >= 4, "a random enclosure needs at least 4 elements, got {n}");
        let mut state = seed;
        let areas: Vec<f64> = (0..n).map(|_| 1.0 + uniform(&mut state)).collect();
        let mut exchange = vec![0.0; n * n];
        for s in 0..n {
            for t in 0..s {
                let k = 0.1 + 0.9 * uniform(&mut state);
                (exchange[s * n + t], exchange[t * n + s]) = (k, k);
            }
        }
        scale_rows(&mut exchange, &areas);
        let emission = (0..n).map(|s| if s % 5 == 0 { 1.0 + 9.0 * uniform(&mut state) } else { 0.0 }).collect();
        let reflectance = (0..n).map(|s| if s % 7 == 3 { 0.0 } else { 0.1 + 0.8 * uniform(&mut state) }).collect();
        Self { areas, exchange, emission, reflectance }
    }

    /// Exchange areas with the zeros of `exchange`, a symmetric table that is not negative, scaled to the row sums of a closed room;
    /// nothing emits or reflects yet.
    pub fn closed(areas: Vec<f64>, mut exchange: Vec<f64>) -> Self {
        let n = areas.len();
        scale_rows(&mut exchange, &areas);
        Self { areas, exchange, emission: vec![0.0; n], reflectance: vec![0.0; n] }
    }

    /// The same enclosure with another emission, and one reflectance everywhere.
    pub fn lit(self, emission: Vec<f64>, reflectance: f64) -> Self {
        Self { emission, ..self }.with_reflectance(reflectance)
    }

    /// The same enclosure with all exchange areas times `factor`: row sums are no longer 1.
    pub fn scaled(mut self, factor: f64) -> Self {
        self.exchange.iter_mut().for_each(|value| *value *= factor);
        self
    }

    /// The same enclosure with one reflectance everywhere.
    pub fn with_reflectance(mut self, reflectance: f64) -> Self {
        self.reflectance.fill(reflectance);
        self
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.areas.len()
    }

    /// Whether there is no element (never).
    pub fn is_empty(&self) -> bool {
        self.areas.is_empty()
    }

    /// A dense symmetric store.
    ///
    /// # Panics
    ///
    /// If the exchange areas were changed to something that is none.
    pub fn dense(&self) -> DenseFormFactors {
        DenseFormFactors::assemble(self).expect("exchange areas are positive and symmetric").0
    }

    /// Every store in double precision.
    ///
    /// # Panics
    ///
    /// As [`Self::dense`].
    pub fn stores(&self) -> Vec<Box<dyn FormFactors + '_>> {
        let sparse = SparseFormFactors::assemble(self).expect("exchange areas are positive and symmetric").0;
        let packed = PackedFormFactors::<f64>::assemble(self).expect("exchange areas are positive and symmetric").0;
        vec![
            Box::new(self.dense()),
            Box::new(sparse),
            Box::new(packed),
            Box::new(OnDemand::new(Box::new(self), Keep::None)),
            Box::new(OnDemand::new(Box::new(self), Keep::All)),
        ]
    }

    /// The system of one band.
    ///
    /// # Panics
    ///
    /// If the values are no system.
    pub fn system<'a>(&'a self, store: &'a dyn FormFactors) -> System<'a> {
        self.system_with(store, &self.emission, &self.reflectance)
    }

    /// A system of other emission and reflectance, all bands one after another.
    ///
    /// # Panics
    ///
    /// If the values are no system.
    pub fn system_with<'a>(
        &'a self,
        store: &'a dyn FormFactors,
        emission: &'a [f64],
        reflectance: &'a [f64],
    ) -> System<'a> {
        let (e, rho) = (Bands::new(emission, self.len()), Bands::new(reflectance, self.len()));
        System::full(store, &self.areas, e, rho).unwrap_or_else(|fault| panic!("{fault}"))
    }
}

/// Scales symmetric positive rows to the wanted sums.
fn scale_rows(k: &mut [f64], sums: &[f64]) {
    let n = sums.len();
    let mut d = vec![1.0; n];
    for _ in 0..10_000 {
        let kd = |s: usize, d: &[f64]| -> f64 { k[s * n..(s + 1) * n].iter().zip(d).map(|(k, d)| k * d).sum() };
        let products: Vec<f64> = (0..n).map(|s| kd(s, &d)).collect();
        let error = (0..n).map(|s| (d[s] * products[s] / sums[s] - 1.0).abs()).fold(0.0, f64::max);
        // A row of n products is not better than this.
        if error <= 4.0 * f64::EPSILON {
            break;
        }
        (0..n).for_each(|s| d[s] = (d[s] * sums[s] / products[s]).sqrt());
    }
    for s in 0..n {
        for t in 0..n {
            // The product of the two scales first: the same for (s, t) and (t, s) to the last bit.
            k[s * n + t] *= d[s] * d[t];
        }
    }
}

impl Rows for RandomEnclosure {
    fn name(&self) -> &'static str {
        "random-enclosure"
    }

    fn sources(&self) -> usize {
        self.len()
    }

    fn targets(&self) -> usize {
        self.len()
    }

    fn symmetric(&self) -> bool {
        true
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        let n = self.len();
        values.copy_from_slice(&self.exchange[s * n..(s + 1) * n]);
        Ok((Cost { form_factors: n as u64, source_evaluations: 1, ..Cost::default() }, 0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_sum_to_the_areas_and_are_symmetric() {
        for n in [4, 5, 63] {
            let enclosure = RandomEnclosure::new(n, 7);
            for s in 0..n {
                let sum: f64 = enclosure.exchange[s * n..(s + 1) * n].iter().sum();
                // The scaling stops at 4ε; n roundings of the sum come on top.
                assert!((sum / enclosure.areas[s] - 1.0).abs() < 1e-14, "row {s} of {n}: {sum}");
                assert!((0..n).all(|t| enclosure.exchange[s * n + t] == enclosure.exchange[t * n + s]));
            }
        }
    }

    #[test]
    fn every_store_conforms() {
        let enclosure = RandomEnclosure::new(67, 3);
        assert_eq!(enclosure.stores().len(), 5);
        enclosure.stores().iter().for_each(|store| crate::conformance(&**store));
    }
}
