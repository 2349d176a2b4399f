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
//! the last factor because the mean over p holds A_e/A_p of it. F F' is a square: pairs far apart hardly count. In rooms of 4 to 256 boxes the error of irradiance is 0.7 to 1.0 of an estimate with this, and up to 4
//! times one without where cells are as large as faces (of 12 boxes in the test `adaptive`). What is *not* here: gaps between patches that
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

#[cfg(test)]
mod tests {
    use radiosity_gallery::boxes::{faces, material, scene_of_loops};
    use radiosity_geometry::mesh::Subdivision;

    use super::*;
    use crate::{Adaptive, Goal, GridValues, Method, Strategy, run};

    /// A box of 0.4 at a distance of 0.1 from a wall of 2, whose back is an element: it sees less than the wall's mean sends, by about what is said.
    #[test]
    fn the_back_of_a_box_close_to_a_wall_is_darker_than_the_wall_lets_it_be() {
        let (low, high) = (glam::DVec3::new(0.1, 0.8, 0.8), glam::DVec3::new(0.5, 1.2, 1.2));
        let room = faces(glam::DVec3::ZERO, glam::DVec3::splat(2.0), true).into_iter().map(|face| (face, 0));
        let mut loops: Vec<_> = room.chain(faces(low, high, false).into_iter().map(|face| (face, 1))).collect();
        loops[5].1 = 2;
        let materials = vec![material("room", 0.7, 0.0), material("box", 0.3, 0.0), material("light", 0.0, 1.0)];
        let scene = scene_of_loops(&loops, materials);
        let back = loops[6..].iter().position(|(face, _)| face.iter().all(|v| v.x == 0.1)).unwrap() + 6;

        let fine = run(&scene, &Strategy::new(Subdivision::Uniform(12), Method::ANALYTIC), &mut ()).unwrap();
        let truth = GridValues::means(&fine.geometry, &fine.solution.irradiance, 1).unwrap().values.band(0)[back];
        let strategy = Strategy {
            solver: "gauss-seidel".to_owned(),
            shape: crate::Shape::ElementsToPatches,
            ..Strategy::new(Subdivision::Uniform(1), Method::ANALYTIC)
        };
        let adaptive = Adaptive::new(Goal::Cells(1), 0.5).from_cells(1);
        let mut state = State::new(&scene, &strategy, &adaptive).unwrap();
        let solved = state.solve(&strategy).unwrap();
        let missing = truth - solved.irradiance.band(0)[back];
        let said = Gaps::new(&state, &solved).of_element(back)[0];
        assert!(missing < 0.0, "{missing}");
        assert!((0.4..2.5).contains(&(said / missing)), "{said} of {missing}");
    }
}
