//! What errors of irradiance are means over.
//!
//! The report shows means over cells: of elements smaller than a cell c, cut there by a contact or for the sake of patches, it shows
//!
//! ```text
//! δ_c = Σ_e a_ce δ_e / A_c,      error² = Σ_c A_c δ_c² / Σ_c A_c,      a_ce the area of e in c
//! ```
//!
//! so that what errs in a sliver alone, at a lamp's edge or under a box, counts by the square of its share of the cell, and what errs one way here and the other way there
//! cancels. Where no element is smaller than a cell, at points, and in a picture, elements are receivers themselves. What is *not* here: covered parts, which err by nothing.

use radiosity_geometry::mesh::ReportCell;

use super::{Adaptive, Goal, State};
use crate::RunError;

/// Elements of a receiver that tell its error, at most.
const PARTS: usize = 16;

/// One cell, or one element.
pub(super) struct Receiver {
    /// Its area that is not covered, of what is asked for.
    pub(super) area: f64,
    /// Exposed elements in it with weights w: A δ² = area · (Σ_e w_e δ_e)².
    pub(super) parts: Vec<(usize, f64)>,
}

impl Receiver {
    /// An element by itself.
    pub(super) fn element(e: usize, area: f64) -> Self {
        Self { area, parts: vec![(e, 1.0)] }
    }

    /// The same by the most elements that are looked at, evenly spread over its area.
    pub(super) fn sketch(&self) -> Self {
        if self.parts.len() <= PARTS {
            return Self { area: self.area, parts: self.parts.clone() };
        }
        let weights: Vec<f64> = self.parts.iter().map(|part| part.1).collect();
        let step = weights.iter().sum::<f64>() / PARTS as f64;
        let drawn = spread_over(&weights, PARTS).into_iter();
        Self { area: self.area, parts: drawn.map(|(k, steps)| (self.parts[k].0, steps * step)).collect() }
    }
}

/// All receivers of the elements there are, for the goal of a run.
///
/// # Errors
///
/// [`RunError`] if the goal has no cells or too many.
pub(super) fn receivers(state: &State<'_>, adaptive: &Adaptive) -> Result<Vec<Receiver>, RunError> {
    let geometry = &state.geometry;
    let areas = geometry.elements().areas();
    let elements = || areas.iter().enumerate().map(|(e, &area)| Receiver::element(e, area)).collect();
    let Goal::Cells(k) = adaptive.goal else { return Ok(elements()) };
    let cells = cell_areas(state, k);
    if state.asked.is_view() || areas.iter().zip(&cells).all(|(area, cell)| *area >= cell * (1.0 - 1e-9)) {
        return Ok(elements());
    }
    let place = geometry.places();
    let grid = geometry.mesh().report_grid(geometry.scene(), k)?;
    let receiver = |cell: ReportCell| {
        let area: f64 = cell.overlaps.iter().map(|overlap| overlap.1).sum();
        let whole = (area * cell.area).sqrt();
        let parts = cell.overlaps.iter().map(|&(e, overlap)| (place[e as usize], overlap / whole)).collect();
        Receiver { area, parts }
    };
    Ok(grid.cells.into_iter().map(receiver).filter(|receiver| receiver.area > 0.0).collect())
}

/// Area of a report cell on the surface of every exposed element.
pub(super) fn cell_areas(state: &State<'_>, k: u32) -> Vec<f64> {
    let geometry = &state.geometry;
    let of_surface = |s: usize| {
        geometry.scene().surfaces[s].area() / (geometry.mesh().pieces(s).len() as f64 * f64::from(k).powi(2))
    };
    geometry.surfaces().into_iter().map(|s| of_surface(s as usize)).collect()
}

/// At most `count` of some areas at equal steps of their sum, with the number of steps that fall into each.
pub(super) fn spread_over(areas: &[f64], count: usize) -> Vec<(usize, f64)> {
    let total: f64 = areas.iter().sum();
    let (mut found, mut before) = (Vec::with_capacity(count), 0.0);
    for (e, area) in areas.iter().enumerate() {
        let at = |area: f64| (area / total * count as f64 - 0.5).ceil();
        let steps = at(before + area) - at(before);
        if steps > 0.0 {
            found.push((e, steps));
        }
        before += area;
    }
    found
}
