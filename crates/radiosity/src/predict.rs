//! What a strategy will cost, before it runs: exact counts where they are known, bounds elsewhere.

use radiosity_form_factors::hierarchical::Hierarchy;
use radiosity_form_factors::stores::PackedFormFactors;

use crate::{Geometry, Method, Shape, Store, Strategy};

/// Counts and memory of a strategy on a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Prediction {
    /// Elements m.
    pub elements: u64,
    /// Patches n.
    pub patches: u64,
    /// Sources for which the estimator starts once.
    pub source_evaluations: u64,
    /// Form factors computed by one pass over all sources.
    pub form_factors: u64,
    /// Rays of a row-wise estimator by one pass; of a pairwise one this depends on what blocks and is not counted.
    pub rays: u64,
    /// Pixels of all hemicubes of one pass.
    pub hemicube_pixels: u64,
    /// Bytes of form factors held, at most.
    pub stored_bytes: u64,
}

/// Predicts `strategy` on `geometry`.
pub fn predict(geometry: &Geometry<'_>, strategy: &Strategy) -> Prediction {
    let (m, n) = (geometry.elements().len() as u64, geometry.patches().len() as u64);
    let (sources, targets) = match strategy.shape {
        Shape::Full => (m, m),
        Shape::ElementsToPatches | Shape::TwoLevel => (m, n),
        Shape::PatchesToElements => (n, m),
    };
    let pairwise = matches!(strategy.method, Method::Analytic { .. });
    let held = match strategy.store {
        Store::Dense | Store::KeepAll => 8 * sources * targets,
        // A sparse entry also names its target.
        Store::Sparse => 12 * sources * targets,
        Store::Packed => PackedFormFactors::<f64>::bytes(m as usize),
        Store::PackedSingle => PackedFormFactors::<f32>::bytes(m as usize),
        Store::KeepNone => 0,
        // A tree of nodes; links come as the light needs them.
        Store::Hierarchical { .. } => Hierarchy::bytes_of(m as usize),
    };
    let coarse = if strategy.shape == Shape::TwoLevel { 8 * n * n } else { 0 };
    Prediction {
        elements: m,
        patches: n,
        source_evaluations: sources,
        // A symmetric store asks for each unordered pair once.
        form_factors: if pairwise && strategy.shape == Shape::Full { m * (m - 1) / 2 } else { sources * targets },
        rays: match strategy.method {
            Method::RayCast { rays, .. } | Method::RaysAndEmitters { rays } => sources * u64::from(rays),
            _ => 0,
        },
        hemicube_pixels: match strategy.method {
            Method::Hemicube { resolution } => sources * 3 * u64::from(resolution).pow(2),
            _ => 0,
        },
        stored_bytes: held + coarse,
    }
}
