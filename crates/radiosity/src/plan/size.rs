//! How large the run of a plan is: what it computes, and what is there beside it.
//!
//! Form factors are held room by room. Their number, work and memory are those of one system of m elements and n patches with
//!
//! ```text
//! m² = Σ_r m_r²,      n² = Σ_r n_r²,      r over the rooms in which something is solved,
//! ```
//!
//! to the last entry in the full form, and about so where elements gather from patches, since patches are shared out as elements are.

use std::collections::BTreeMap;

use radiosity_geometry::mesh::{MeshError, MeshSize};
use radiosity_geometry::{Facets, Scene};

use super::{Plan, Role};
use crate::predict::estimator_bytes;
use crate::{Geometry, Prediction, Size, Strategy, predict};

/// Vectors of all bands on all elements that are alive when the answer of a plan is put together.
const ANSWERS: u64 = 4;

/// The size of a mesh, and of what a plan computes on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlannedSize {
    /// All that is meshed.
    pub all: Size,
    /// One system of as many entries as the plan keeps, in the bands that it solves.
    pub kept: Size,
    /// Pairs of an unknown and of an element of a black face that emits.
    pub given: u64,
}

impl PlannedSize {
    /// Predicts `strategy` by the plan; elements and patches are all there are.
    pub fn predict(&self, strategy: &Strategy) -> Prediction {
        let Self { all, kept, given } = self;
        let kept_alone = predict(kept, strategy);
        let beside = if all == kept {
            0
        } else {
            let answers = ANSWERS * 8 * all.bands * all.elements;
            let selected = Facets::selected_bytes_of(all.elements) + 8 * all.elements;
            answers + selected + 8 * given + estimator_bytes(strategy) * all.elements.saturating_sub(kept.elements)
        };
        let peak_bytes = kept_alone.peak_bytes.saturating_add(beside);
        Prediction { elements: all.elements, patches: all.patches, peak_bytes, ..kept_alone }
    }
}

impl Plan {
    /// The size of the run on `geometry`, which [`Plan::mesh`] made.
    pub fn size(&self, geometry: &Geometry<'_>) -> PlannedSize {
        let mut of_surface = vec![MeshSize { cells: 0, patches: 0 }; self.roles.len()];
        let surfaces = geometry.surfaces();
        let mut patch_surface = vec![0; geometry.patches().len()];
        for (&surface, &patch) in surfaces.iter().zip(geometry.parent()) {
            of_surface[surface as usize].cells += 1;
            patch_surface[patch as usize] = surface;
        }
        patch_surface.into_iter().for_each(|surface| of_surface[surface as usize].patches += 1);
        self.kept_of(Size::of(geometry), &of_surface)
    }

    /// The size of the run on a mesh that is not made yet, as if no contact cut or covered a cell: O(faces).
    ///
    /// # Errors
    ///
    /// [`MeshError`] if the settings make no mesh.
    pub fn size_before_meshing(&self, scene: &Scene, strategy: &Strategy) -> Result<PlannedSize, MeshError> {
        let mut of_surface = MeshSize::of_surfaces(scene, &strategy.mesh)?;
        let bare = (0..of_surface.len()).filter(|&s| self.is_bare(s));
        bare.collect::<Vec<_>>().into_iter().for_each(|s| of_surface[s] = MeshSize { cells: 0, patches: 0 });
        let cells = of_surface.iter().map(|size| size.cells).sum();
        let patches = of_surface.iter().map(|size| size.patches).sum();
        let all = Size { mesh_elements: cells, elements: cells, patches, bands: scene.bands() as u64 };
        Ok(self.kept_of(all, &of_surface))
    }

    /// What is kept of `all`, which is distributed over surfaces so.
    fn kept_of(&self, all: Size, of_surface: &[MeshSize]) -> PlannedSize {
        if !self.omits() {
            return PlannedSize { all, kept: all, given: 0 };
        }
        let mut of_room: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
        for (s, size) in of_surface.iter().enumerate().filter(|(s, _)| self.roles[*s] == Role::Exchanges) {
            let (m, n) = of_room.entry(self.room[s]).or_default();
            *m += size.cells as f64;
            *n += size.patches as f64;
        }
        let lamps = of_surface.iter().enumerate().filter(|(s, _)| self.roles[*s] == Role::Shines);
        let unknowns = |s: usize| of_room.get(&self.room[s]).map_or(0.0, |room| room.0);
        let given = lamps.map(|(s, size)| size.cells as f64 * unknowns(s)).sum::<f64>() as u64;
        let root = |of: fn(&(f64, f64)) -> f64| of_room.values().map(|room| of(room).powi(2)).sum::<f64>().sqrt();
        let (elements, patches) = (root(|room| room.0).ceil() as u64, root(|room| room.1).ceil() as u64);
        let kept = Size { elements, patches, bands: self.bands.solved.len() as u64, ..all };
        PlannedSize { all, kept, given }
    }
}
