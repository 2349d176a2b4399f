//! What nodes send, as refinement sees it.

use radiosity_core::BandValues;

use super::tree::Hierarchy;

/// Radiosity of every node as refinement sees it: the mean and the standard deviation over its elements, in units of the mean irradiance.
#[derive(Clone, Debug)]
pub struct Brightness {
    pub(super) mean: Vec<f32>,
    pub(super) deviation: Vec<f32>,
    /// Whether receivers get what is linear over them.
    pub(super) linear: bool,
    /// What the square of an error on every node counts; empty if 1.
    worth: Vec<f32>,
}

impl Brightness {
    /// Every node sends 1: links for any distribution of light that is as bright everywhere.
    pub fn uniform(hierarchy: &Hierarchy) -> Self {
        Self {
            mean: vec![1.0; hierarchy.len()],
            deviation: vec![0.0; hierarchy.len()],
            linear: false,
            worth: Vec::new(),
        }
    }

    /// Of elements with radiosities `b` where the mean irradiance is `level`, all bands counted as their root mean square.
    ///
    /// # Panics
    ///
    /// If `b` does not fit the hierarchy.
    pub fn of(hierarchy: &Hierarchy, b: &BandValues, level: f64) -> Self {
        assert_eq!(b.len(), hierarchy.order.len(), "brightness of another hierarchy");
        let bands = b.count() as f64;
        let mut sums = vec![[0.0_f64; 3]; hierarchy.len()];
        for k in (0..hierarchy.len()).rev() {
            let element = hierarchy.elements[k] as usize;
            if hierarchy.nodes[k].is_leaf() {
                let square = (0..b.count()).map(|band| b.band(band)[element].powi(2)).sum::<f64>() / bands;
                let weight = hierarchy.weights[element];
                sums[k] = [weight, weight * square.sqrt(), weight * square];
            }
            if let Some(parent) = hierarchy.parents.get(k).map(|&p| p as usize).filter(|&p| p < k) {
                (0..3).for_each(|c| sums[parent][c] += sums[k][c]);
            }
        }
        let unit = if level > 0.0 { 1.0 / level } else { 0.0 };
        let mean = sums.iter().map(|[w, b, _]| (unit * b / w) as f32).collect();
        let variance = |[w, b, square]: &[f64; 3]| (square / w - (b / w).powi(2)).max(0.0);
        let deviation = sums.iter().map(|sum| (unit * variance(sum).sqrt()) as f32).collect();
        Self { mean, deviation, linear: false, worth: Vec::new() }
    }

    /// The same for links that vary linearly over their receivers ([`super::HierarchicalFormFactors::final_gather`]), which miss less.
    #[must_use]
    pub fn linear(self) -> Self {
        Self { linear: true, ..self }
    }

    /// The same where the square of an error on an element counts `worth` times its area, and that on a node the mean over its elements: refinement
    /// and the error of
    /// all links go by it.
    ///
    /// # Panics
    ///
    /// If there is not one number an element.
    #[must_use]
    pub fn worth(self, hierarchy: &Hierarchy, worth: &[f64]) -> Self {
        assert_eq!(worth.len(), hierarchy.order.len(), "worth in another hierarchy");
        let mut sums = vec![[0.0_f64; 2]; hierarchy.len()];
        for k in (0..hierarchy.len()).rev() {
            let element = hierarchy.elements[k] as usize;
            if hierarchy.nodes[k].is_leaf() {
                let weight = hierarchy.weights[element];
                sums[k] = [weight, weight * worth[element]];
            }
            if let Some(parent) = hierarchy.parents.get(k).map(|&p| p as usize).filter(|&p| p < k) {
                (0..2).for_each(|c| sums[parent][c] += sums[k][c]);
            }
        }
        Self { worth: sums.iter().map(|[weight, worth]| (worth / weight) as f32).collect(), ..self }
    }

    /// What the square of an error on a node counts.
    pub(super) fn counts(&self, node: usize) -> f32 {
        self.worth.get(node).copied().unwrap_or(1.0)
    }
}
