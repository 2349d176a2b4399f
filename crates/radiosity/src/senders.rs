//! Surfaces that rows of rays are not left to find: those that emit, and the few that shine.
//!
//! A small surface much brighter than the rest is met by few rays of a row, and what its entry errs by counts as often as it is bright.
//! So is a light, and so is what stands close under one. By the light that comes to it straight from the emitters L, surface k reflects
//!
//! ```text
//! B_k = ρ_k Σ_L E_L A_L F_Lk / A_k,      B̄ = Σ_k A_k B_k / Σ_k A_k.
//! ```
//!
//! Its share F of a row of N rays has a variance of at most F/N with F ≈ A_k/A, and an error common to all surfaces does not matter, since the
//! sum of a row is kept: (B_k − B̄)² A_k is what each leaves in irradiance, in order. Taken are the first of those with B_k > 2 B̄, each no more than a
//! twentieth of all area: rays meet what is larger often enough, and many elements see it partly, which costs much in pairs.
//!
//! What is *not* here: light reflected more than once, and parts of surfaces.

use radiosity_form_factors::Pairwise;
use radiosity_form_factors::analytic::Analytic;
use radiosity_geometry::{Facets, Occluders, Scene};
use rayon::prelude::*;

use crate::estimate::analytic;
use crate::strategy::partial_among;

/// Surfaces taken beside the emitters, at most: each costs a pair of every row.
const MOST: usize = 4;
/// How much brighter than the mean they are.
const BRIGHTER: f64 = 2.0;
/// Their share of all area, at least and at most. So there are few to look at in scenes of many facets.
const SHARE: (f64, f64) = (0.001, 0.05);
/// Error of the form factors that decide, which pick and do not enter any answer.
const TOLERANCE: f64 = 1e-3;

/// Surfaces that shine, brightest in effect first, by the light of `emitters` (facets and their surfaces) among `blockers`.
pub(crate) fn shining(scene: &Scene, (emitters, surfaces): (&Facets, &[u32]), blockers: &Occluders) -> Vec<u32> {
    let areas: Vec<f64> =
        scene.surfaces.iter().map(|surface| surface.pieces.iter().map(|piece| piece.area()).sum()).collect();
    let total: f64 = areas.iter().sum();
    let analytic = analytic(blockers, partial_among(blockers.len(), TOLERANCE));
    // A_k B_k; what is too large to be taken counts for the mean as well.
    let reflects = |k: usize| {
        let emits = surfaces.binary_search(&(k as u32)).is_ok();
        if emits || areas[k] < SHARE.0 * total { 0.0 } else { reflected(scene, k, (emitters, surfaces), &analytic) }
    };
    let power: Vec<f64> = (0..areas.len()).into_par_iter().map(reflects).collect();
    let mean = power.iter().sum::<f64>() / total;
    let effect = |k: usize| (power[k] / areas[k] - mean).powi(2) * areas[k];
    let shines = |&k: &usize| areas[k] <= SHARE.1 * total && power[k] > BRIGHTER * mean * areas[k];
    let mut found: Vec<usize> = (0..areas.len()).filter(shines).collect();
    found.sort_by(|&a, &b| effect(b).total_cmp(&effect(a)));
    found.into_iter().take(MOST).map(|k| k as u32).collect()
}

/// A_k B_k of one surface, all bands together.
fn reflected(scene: &Scene, k: usize, (emitters, surfaces): (&Facets, &[u32]), analytic: &Analytic<'_>) -> f64 {
    let surface = &scene.surfaces[k];
    let of = |k: usize| &scene.materials[scene.surfaces[k].material];
    let light = |(emitter, &from): (usize, &u32)| {
        let weight: f64 = of(k).reflectance.iter().zip(&of(from as usize).emission).map(|(rho, e)| rho * e).sum();
        let pairs = surface.pieces.iter().flat_map(|i| emitters.polygons(emitter).iter().map(move |j| (i, j)));
        let exchange: f64 = pairs.map(|(i, j)| analytic.exchange(i, j, TOLERANCE, 1).value).sum();
        weight * exchange
    };
    surfaces.iter().enumerate().map(light).sum()
}

#[cfg(test)]
mod tests {
    use radiosity_gallery::boxes::{empty_box, material};
    use radiosity_geometry::mesh::{MeshSettings, Subdivision};
    use radiosity_io::{ReadOptions, read_scene};

    use super::*;
    use crate::Geometry;

    fn found(scene: &Scene) -> Vec<u32> {
        let settings = MeshSettings { elements: Subdivision::Uniform(1), patches: None, contacts: true };
        Geometry::new(scene, &settings).unwrap().senders().1.to_vec()
    }

    /// The light is surface 5; the tops of the tall and the short block, 14 and 9, are what is small and close under it.
    #[test]
    fn the_tops_of_the_blocks_shine_in_the_cornell_box() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../experiments/scenes/cornell_box.obj");
        let mut scene = read_scene(path.as_ref(), &ReadOptions::default()).unwrap().scene;
        assert_eq!(found(&scene), [5, 14, 9]);
        // Black, they reflect nothing.
        let of_tops = scene.surfaces[9].material;
        scene.materials[of_tops].reflectance.fill(0.0);
        assert_eq!(found(&scene), [5]);
    }

    #[test]
    fn nothing_shines_in_an_empty_room_or_in_the_dark() {
        let mut scene = empty_box([3.0, 5.0, 2.0], material("grey", 0.6, 0.0));
        assert!(found(&scene).is_empty());
        scene.materials.push(material("lamp", 0.2, 10.0));
        scene.surfaces[5].material = 1;
        assert_eq!(found(&scene), [5]);
    }
}
