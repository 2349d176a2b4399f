//! What patches err by that send one value, by patch and by receiver, without new form factors.
//!
//! A patch p of size s_p = √A_p whose radiosity varies by v_p (rms over its elements and inside them) is seen by a receiver r (`receivers`), of
//! elements e with weights w_e at distances d_ep, with an error of about
//!
//! ```text
//! δ_rp = v_p Σ_e w_e F_ep min(1, s_p/d_ep),      E_p² = Σ_r A_r Y_r δ_rp²,      δ_r² = Σ_p δ_rp²
//! ```
//!
//! since from afar only the mean counts, and parts weigh differently by about s_p/d_ep; Y is the importance of r to what is asked for
//! ([`crate::Importance`]), 1 if that is all. E_p tells what to cut (`marks`), δ_r where to look (`measure`). What is *not* here: signs, so that both are too large,
//! and the edges of shadows.

use glam::DVec3;
use radiosity_core::{BandValues, Solution};
use rayon::prelude::*;

use super::State;
use super::gaps::Gaps;
use super::receivers::Receiver;
use super::variation::Variation;

/// Receivers that one task sums over.
const PIECE: usize = 64;

/// Both sums.
pub(super) struct SenderErrors {
    /// E_p² of every patch.
    pub(super) of_patches: Vec<f64>,
    /// δ_r² of every receiver, whatever it is worth.
    pub(super) of_receivers: Vec<f64>,
}

impl SenderErrors {
    /// Of a solution.
    pub(super) fn new(
        state: &State<'_>,
        solved: &Solution,
        (variation, worth): (&Variation, Option<&[f64]>),
        receivers: &[Receiver],
    ) -> Self {
        let (elements, patches) = (state.geometry.elements(), state.geometry.patches());
        let (v2, centres) = variations(state, solved, variation);
        let gaps = (!state.geometry.blockers().is_empty()).then(|| Gaps::new(state, solved));
        let pieces: Vec<(Vec<f64>, Vec<f64>)> = receivers
            .par_chunks(PIECE)
            .map(|piece| {
                let mut sums = vec![0.0; v2.len()];
                // Of each patch the share by slopes and the gap, and which patches are seen.
                let (mut shares, mut touched) = (vec![[0.0; 2]; v2.len()], Vec::new());
                let of_receiver = |receiver: &Receiver| {
                    let mut worthy = 0.0;
                    for &(e, weight) in &receiver.parts {
                        let (centre, area) = (elements.polygons(e)[0].centroid(), elements.area(e));
                        worthy += weight * worth.map_or(1.0, |worth| worth[e]);
                        for (p, &exchange) in state.store.entries(e).iter().enumerate().filter(|(_, f)| **f > 0.0) {
                            let near = (patches.area(p) / centres[p].distance_squared(centre)).min(1.0);
                            let dark = gaps.as_ref().map_or(0.0, |gaps| gaps.of_pair((e, p), exchange / area));
                            if shares[p][0] == 0.0 {
                                touched.push(p);
                            }
                            shares[p][0] += weight / area * exchange * near.sqrt();
                            shares[p][1] += weight * dark;
                        }
                    }
                    worthy *= receiver.area / receiver.parts.iter().map(|part| part.1).sum::<f64>();
                    let mut seen = 0.0;
                    for p in touched.drain(..) {
                        let [share, dark] = std::mem::take(&mut shares[p]);
                        let square = share * share * v2[p] + dark * dark;
                        sums[p] += worthy * square;
                        seen += square;
                    }
                    seen
                };
                let seen = piece.iter().map(of_receiver).collect();
                (sums, seen)
            })
            .collect();
        let mut of_patches = vec![0.0; patches.len()];
        pieces.iter().for_each(|(sums, _)| of_patches.iter_mut().zip(sums).for_each(|(error, sum)| *error += sum));
        Self { of_patches, of_receivers: pieces.into_iter().flat_map(|(_, seen)| seen).collect() }
    }
}

/// v_p² and the centres of the patches.
fn variations(state: &State<'_>, solved: &Solution, variation: &Variation) -> (Vec<f64>, Vec<DVec3>) {
    let (geometry, b) = (&state.geometry, &solved.radiosity);
    let (elements, patches) = (geometry.elements(), geometry.patches());
    let (means, rho, bands) = (patch_means(state, b), geometry.reflectance(), b.count());
    let mut v2 = vec![0.0; patches.len()];
    let mut centres = vec![DVec3::ZERO; patches.len()];
    for (e, &p) in geometry.parent().iter().enumerate() {
        let (p, weight) = (p as usize, elements.area(e) / patches.area(p as usize));
        for band in 0..bands {
            let (apart, rho) = (b.band(band)[e] - means.band(band)[p], rho.band(band)[e]);
            v2[p] += weight * (apart * apart + rho * rho * variation.squares[e]) / bands as f64;
        }
        centres[p] += elements.polygons(e)[0].centroid() * weight;
    }
    (v2, centres)
}

/// Area means of B over the patches.
pub(super) fn patch_means(state: &State<'_>, b: &BandValues) -> BandValues {
    let geometry = &state.geometry;
    let (areas, patches) = (geometry.elements().areas(), geometry.patches().areas());
    let mut means = BandValues::zeros(b.count(), patches.len());
    for band in 0..b.count() {
        let to = means.band_mut(band);
        let own = geometry.parent().iter().zip(&areas).zip(b.band(band));
        own.for_each(|((&p, area), b)| to[p as usize] += area * b / patches[p as usize]);
    }
    means
}
