//! Which elements and patches are cut next.
//!
//! Of patches the fewest are cut that carry nine tenths of Σ E_p² (`sender_errors`); one
//! whose elements are all in one node gets finer elements first, to be cut along. Of elements as many are cut as carry what has to go: cutting divides ε² by
//! four where H is smooth (bulk criterion; W. Dörfler, SIAM J. Numer. Anal. 33, 1996). What is *not* here: whether it is needed.

use radiosity_core::Solution;

use super::measure::level;
use super::sender_errors::SenderErrors;
use super::shadows::crossed;
use super::variation::Variation;
use super::{Adaptive, Criterion, ErrorEstimate, Goal, State};

/// Share of Σ E_p² that the patches to be cut carry.
const BULK: f64 = 0.9;
/// Largest share of the error that the elements to be cut carry: what is left over may have gone by itself.
const MOST: f64 = 0.75;
/// Least part of the tolerance that elements are refined to, as squares: the rest is for other errors.
const ELEMENTS: f64 = 0.3;
/// What of the error has to go, cut elements lose: a little less than the 3/4 of smooth ones.
const LOSS: f64 = 0.65;
/// Patches are cut before most rows are there, to be used by them: while the error of elements is more than twice the tolerance, they
/// may take this part of their share alone, and what is left of it afterwards.
const EARLY: f64 = 0.6;

/// What is to be cut, by element and by patch of the whole mesh.
pub(super) struct Marks {
    pub(super) elements: Vec<bool>,
    pub(super) patches: Vec<bool>,
}

/// Marks what carries the error of a solution.
pub(super) fn marks(
    state: &State<'_>,
    solved: &Solution,
    (variation, senders): (&Variation, &SenderErrors),
    (estimate, adaptive): (&ErrorEstimate, &Adaptive),
) -> Marks {
    let (geometry, mesh) = (&state.geometry, state.geometry.mesh());
    let mut marks = Marks { elements: vec![false; mesh.elements.len()], patches: vec![false; mesh.patch_facets.len()] };
    let (level, total) = level(state, &solved.irradiance);
    let early = adaptive.goal == Goal::Points && estimate.elements > 2.0 * adaptive.tolerance;
    let share = if early { EARLY * adaptive.senders } else { adaptive.senders };
    let cut_patches = estimate.senders > share * adaptive.tolerance;

    // Elements, of what is asked for.
    let asked = state.asked.squares();
    let mut cut: Vec<usize> = match adaptive.criterion {
        Criterion::Gradient(share) => {
            let most = geometry.reflectance().values().iter().copied().fold(0.0, f64::max);
            let rho = geometry.reflectance();
            let steep = |&e: &usize| {
                let rho = (0..rho.count()).map(|b| rho.band(b)[e]).fold(0.0, f64::max);
                asked[e] > 0.0 && rho * variation.steps[e] > share * most * level
            };
            (0..geometry.elements().len()).filter(steep).collect()
        }
        Criterion::Discontinuities => crossed(geometry).into_iter().filter(|&e| asked[e] > 0.0).collect(),
        Criterion::Estimate if adaptive.goal == Goal::Points => {
            let squares: Vec<f64> = (0..geometry.elements().len()).map(|e| asked[e] * variation.squares[e]).collect();
            let others = (estimate.total().powi(2) - estimate.elements.powi(2)) / adaptive.tolerance.powi(2);
            let wanted = (1.0 - others).max(ELEMENTS) * (adaptive.tolerance * level).powi(2) * total;
            let now = squares.iter().sum::<f64>();
            if early && cut_patches { Vec::new() } else { bulk(&squares, ((now - wanted) / LOSS).min(MOST * now)) }
        }
        Criterion::Estimate => Vec::new(),
    };

    // Patches, or their elements if there is nothing to cut them along.
    if cut_patches {
        let sum: f64 = senders.of_patches.iter().sum();
        let mut members = vec![Vec::new(); geometry.patches().len()];
        geometry.parent().iter().enumerate().for_each(|(e, &p)| members[p as usize].push(e));
        for p in bulk(&senders.of_patches, BULK * sum) {
            marks.patches[geometry.exposed_patches()[p] as usize] = true;
            let element = |e: usize| &mesh.elements[geometry.exposed()[e] as usize];
            if members[p].iter().all(|&e| element(e).same_leaf(element(members[p][0]))) {
                cut.extend(&members[p]);
            }
        }
    }
    for e in cut {
        let e = geometry.exposed()[e] as usize;
        marks.elements[e] = mesh.elements[e].level < adaptive.most_level;
    }
    marks
}

/// The fewest that carry at least `share` of the sum of some squares, largest first.
fn bulk(squares: &[f64], share: f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..squares.len()).collect();
    order.sort_by(|&a, &b| squares[b].total_cmp(&squares[a]).then(a.cmp(&b)));
    let mut carried = 0.0;
    order
        .into_iter()
        .take_while(|&k| {
            let more = carried < share && squares[k] > 0.0;
            carried += squares[k];
            more
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fewest_that_carry_a_share_are_taken() {
        assert_eq!(bulk(&[1.0, 5.0, 0.0, 3.0, 1.0], 8.5), [1, 3, 0]);
        assert_eq!(bulk(&[1.0, 5.0, 0.0, 3.0], 100.0), [1, 3, 0]);
        assert!(bulk(&[1.0, 2.0], 0.0).is_empty());
    }
}
