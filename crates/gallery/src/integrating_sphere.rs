//! The inside of a sphere: form factors and radiosity are exact for any subdivision, with no geometry at all.

use radiosity_core::{Bands, Cost, Form, FormFactors, StoreError, System};
use radiosity_form_factors::Rows;
use radiosity_form_factors::stores::{DenseFormFactors, Keep, OnDemand, PackedFormFactors, SparseFormFactors};

/// A sphere cut into elements of given areas.
///
/// Two points of a sphere exchange cosθ cosθ′/(πr²) = 1/A whatever their places, so
///
/// ```text
/// F_st = A_t/A (also for s = t),      B = E + ρH,      H = ⟨E⟩/(1 − ⟨ρ⟩)      ⟨·⟩ the area mean
/// ```
///
/// The substructured forms have the same answer, since patch means keep the area mean.
#[derive(Clone, Debug, PartialEq)]
pub struct IntegratingSphere {
    areas: Vec<f64>,
}

/// Exchange areas A_s A_t/A between two lists of parts of one sphere.
struct SphereRows {
    sources: Vec<f64>,
    targets: Vec<f64>,
    total: f64,
}

impl Rows for SphereRows {
    fn name(&self) -> &'static str {
        "sphere"
    }

    fn sources(&self) -> usize {
        self.sources.len()
    }

    fn targets(&self) -> usize {
        self.targets.len()
    }

    fn symmetric(&self) -> bool {
        self.sources == self.targets
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        values.iter_mut().zip(&self.targets).for_each(|(value, a_t)| *value = self.sources[s] * a_t / self.total);
        let cost = Cost { form_factors: values.len() as u64, source_evaluations: 1, ..Cost::default() };
        Ok((cost, 2.0 * f64::EPSILON * self.sources[s]))
    }
}

impl IntegratingSphere {
    /// A sphere of elements with the given areas.
    pub fn new(areas: &[f64]) -> Self {
        Self { areas: areas.to_vec() }
    }

    /// Areas of the elements.
    pub fn areas(&self) -> &[f64] {
        &self.areas
    }

    /// Area mean of values on the elements.
    pub fn mean(&self, values: &[f64]) -> f64 {
        let sum: f64 = self.areas.iter().zip(values).map(|(a, v)| a * v).sum();
        sum / self.areas.iter().sum::<f64>()
    }

    /// H of every element.
    pub fn irradiance(&self, emission: &[f64], reflectance: &[f64]) -> f64 {
        self.mean(emission) / (1.0 - self.mean(reflectance))
    }

    /// B of every element.
    pub fn radiosity(&self, emission: &[f64], reflectance: &[f64]) -> Vec<f64> {
        let h = self.irradiance(emission, reflectance);
        emission.iter().zip(reflectance).map(|(e, rho)| e + rho * h).collect()
    }

    /// Areas of the patches under a parent map.
    pub fn patch_areas(&self, parent: &[u32]) -> Vec<f64> {
        let mut areas = vec![0.0; parent.iter().max().map_or(0, |&p| p as usize + 1)];
        parent.iter().zip(&self.areas).for_each(|(&p, a)| areas[p as usize] += a);
        areas
    }

    /// Rows of exchange areas between the elements.
    pub fn rows(&self) -> Box<dyn Rows> {
        self.rows_of(Form::Full, &[])
    }

    /// Rows of exchange areas as a form needs them, with patches under a parent map (not used in the full form).
    pub fn rows_of(&self, form: Form, parent: &[u32]) -> Box<dyn Rows> {
        let (elements, patches) = (self.areas.clone(), self.patch_areas(parent));
        let (sources, targets) = match form {
            Form::Full => (elements.clone(), elements),
            Form::ElementsToPatches => (elements, patches),
            Form::PatchesToElements => (patches, elements),
        };
        Box::new(SphereRows { sources, targets, total: self.areas.iter().sum() })
    }

    /// Every store, in double precision, of the exchange areas between elements.
    pub fn stores(&self) -> Vec<Box<dyn FormFactors>> {
        self.stores_of(Form::Full, &[])
    }

    /// Every store, in double precision, of the exchange areas that a form needs; the packed one only of the full form.
    ///
    /// # Panics
    ///
    /// If an area is not finite and positive.
    pub fn stores_of(&self, form: Form, parent: &[u32]) -> Vec<Box<dyn FormFactors>> {
        let rows = || self.rows_of(form, parent);
        let dense = DenseFormFactors::assemble(&*rows()).expect("areas are finite and positive").0;
        let sparse = SparseFormFactors::assemble(&*rows()).expect("areas are finite and positive").0;
        let mut all: Vec<Box<dyn FormFactors>> = vec![
            Box::new(dense),
            Box::new(sparse),
            Box::new(OnDemand::new(rows(), Keep::None)),
            Box::new(OnDemand::new(rows(), Keep::All)),
        ];
        if form == Form::Full {
            all.push(Box::new(PackedFormFactors::<f64>::assemble(&*rows()).expect("areas are finite and positive").0));
        }
        all
    }

    /// The system of every element with every element; all bands of E and ρ one after another.
    ///
    /// # Panics
    ///
    /// If the values are no system.
    pub fn system<'a>(&'a self, store: &'a dyn FormFactors, emission: &'a [f64], reflectance: &'a [f64]) -> System<'a> {
        self.system_of(Form::Full, &[], store, emission, reflectance)
    }

    /// The system of a form, with patches under a parent map.
    ///
    /// # Panics
    ///
    /// If the values are no system.
    pub fn system_of<'a>(
        &'a self,
        form: Form,
        parent: &'a [u32],
        store: &'a dyn FormFactors,
        emission: &'a [f64],
        reflectance: &'a [f64],
    ) -> System<'a> {
        let m = self.areas.len();
        let (e, rho) = (Bands::new(emission, m), Bands::new(reflectance, m));
        System::substructured(store, form, &self.areas, parent, e, rho).unwrap_or_else(|fault| panic!("{fault}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reference: 80 % of a sphere has ρ = 0.7, the rest ρ = 0.2 and E = 1: H = 0.2/(1 − 0.6) = 0.5.
    #[test]
    fn irradiance_matches_its_reference() {
        let sphere = IntegratingSphere::new(&[8.0, 2.0]);
        assert!((sphere.irradiance(&[0.0, 1.0], &[0.7, 0.2]) - 0.5).abs() < 1e-15);
    }

    #[test]
    fn every_store_of_every_form_conforms() {
        let sphere = IntegratingSphere::new(&(0..75).map(|k| 1.0 + (k % 7) as f64).collect::<Vec<_>>());
        let parent: Vec<u32> = (0..75).map(|e| e / 8).collect();
        for form in [Form::Full, Form::ElementsToPatches, Form::PatchesToElements] {
            let stores = sphere.stores_of(form, &parent);
            assert_eq!(stores.len(), if form == Form::Full { 5 } else { 4 });
            stores.iter().for_each(|store| crate::conformance(&**store));
        }
    }
}
