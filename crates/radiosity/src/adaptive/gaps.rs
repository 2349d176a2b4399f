//! Dark gaps between small elements and large patches close by.
//!
//! A wall behind a box is dark where it sees little but the box, and the back of the box sees little but that part of the wall; a patch larger than the box
//! sends it the light of its other parts. Form factors tell without a finer mesh. Element e sees patch p, over the plane of which it lies at a height d, by F; the part of p opposite of e, as large as
//! that, sees e by F', as much where they touch and less from afar, and by the rest what all of p sees:
//!
//! ```text
//! F' ≈ F A_e/(A_e + π d²),      H_there ≈ (1 − F') H_p + F' B_e
//! δ_ep = F ρ_p (H_there − H_p) (1 − A_e/A_p)₊ = −F F' ρ_p (H_p − B_e) (1 − A_e/A_p)₊
//! ```
//!
//! the last factor because the mean over p holds A_e/A_p of it. F F' is a square: pairs far apart hardly count. In rooms of 5 to 256 boxes the error of irradiance is 0.6 to 0.9 of an estimate with this, and up to 4
//! times one without where cells are as large as faces (test `adaptive`). What is *not* here: gaps between patches that
//! are alike, whose form factors have all of it, and lamps, which emit alike everywhere.

use std::f64::consts::PI;

use radiosity_core::{BandValues, Solution};

use super::State;
use super::sender_errors::patch_means;

/// What patches reflect, and the elements that see it.
pub(super) struct Gaps<'s> {
    state: &'s State<'s>,
    b: &'s BandValues,
    /// ρ of every patch, and ρ H.
    reflectance: BandValues,
    reflected: BandValues,
}

impl<'s> Gaps<'s> {
    /// Of a solution.
    pub(super) fn new(state: &'s State<'s>, solved: &'s Solution) -> Self {
        let means = |of: &BandValues| patch_means(state, of);
        let (mut reflected, emitted) = (means(&solved.radiosity), means(&state.geometry.emission()));
        for band in 0..reflected.count() {
            reflected.band_mut(band).iter_mut().zip(emitted.band(band)).for_each(|(b, e)| *b -= e);
        }
        Self { state, b: &solved.radiosity, reflectance: means(&state.geometry.reflectance()), reflected }
    }

    /// F F' (1 − A_e/A_p)₊ where e sees p by F.
    fn square(&self, (e, p): (usize, usize), f: f64) -> f64 {
        let (elements, patches) = (self.state.geometry.elements(), self.state.geometry.patches());
        let area = elements.area(e);
        let part = 1.0 - area / patches.area(p);
        if part <= 0.0 {
            return 0.0;
        }
        let height = patches.polygons(p)[0].signed_distance(elements.polygons(e)[0].centroid());
        part * f * f * area / (area + PI * height * height)
    }

    /// ρ_p (H_p − B_e) in a band.
    fn darker(&self, band: usize, (e, p): (usize, usize)) -> f64 {
        self.reflected.band(band)[p] - self.reflectance.band(band)[p] * self.b.band(band)[e]
    }

    /// δ_ep where e sees p by F, mean over the bands.
    pub(super) fn of_pair(&self, pair: (usize, usize), f: f64) -> f64 {
        let square = self.square(pair, f);
        if square == 0.0 {
            return 0.0;
        }
        let bands = self.b.count();
        -square * (0..bands).map(|band| self.darker(band, pair)).sum::<f64>() / bands as f64
    }

    /// Σ_p δ_ep of every band.
    pub(super) fn of_element(&self, e: usize) -> Vec<f64> {
        let area = self.state.geometry.elements().area(e);
        let mut sums = vec![0.0; self.b.count()];
        for (p, &exchange) in self.state.store.entries(e).iter().enumerate().filter(|(_, f)| **f > 0.0) {
            let square = self.square((e, p), exchange / area);
            if square > 0.0 {
                (0..).zip(&mut sums).for_each(|(band, sum)| *sum -= square * self.darker(band, (e, p)));
            }
        }
        sums
    }
}
