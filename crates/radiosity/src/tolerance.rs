//! Refines a uniform mesh until two successive answers differ by less than the error asked for.
//!
//! The error of piecewise constant elements falls like the element size h, or like h^½ where shadows are sharp, so the
//! difference between the answers on h and h/2 estimates the error on h and lies above the error on h/2 in either case
//! but the worst, in which it is 0.4 of it. What was left out within an error ([`crate::bounded`]) adds its bound, and links
//! ([`crate::Store::Hierarchical`]), which err alike on both meshes, add their own; where only some surfaces or a view are asked for,
//! the difference is theirs. What is *not* here: refinement where the error sits ([`crate::adaptive`]).

use radiosity_core::Cost;
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::Subdivision;

use crate::{ErrorMeasure, GridValues, Run, RunError, Strategy, run};

/// One refinement.
#[derive(Clone, Debug, PartialEq)]
pub struct ToleranceStep {
    /// Elements along an edge of a face.
    pub subdivision: u32,
    /// Elements.
    pub elements: usize,
    /// What the run on this mesh took.
    pub cost: Cost,
    /// Difference from the refinement before, over the report grid of what is asked for, or over the pixels of the view.
    pub difference: Option<ErrorMeasure>,
    /// Bound of what was left out, see [`Run::bounded_error`]; infinite if there is none.
    pub left_out: f64,
    /// Estimated error of links; 0 if there are none.
    pub links: f64,
}

impl ToleranceStep {
    /// Estimate of the error on this mesh: the difference, what was left out and what links err by; `None` of the first mesh.
    pub fn estimate(&self) -> Option<f64> {
        self.difference.as_ref().map(|difference| difference.rms + self.left_out + self.links)
    }
}

/// A run whose estimated error meets the tolerance, or the finest allowed.
pub struct ToleranceRun<'a> {
    /// The last run.
    pub run: Run<'a>,
    /// Every refinement, coarsest first.
    pub steps: Vec<ToleranceStep>,
    /// Whether the last [`ToleranceStep::estimate`] met the tolerance.
    pub met: bool,
}

/// Runs `strategy` on 2, 4, 8, … elements along an edge until the estimated rms error on a `report_grid` is at
/// most `tolerance`, or the next mesh would have more than `most_elements`.
///
/// # Errors
///
/// [`RunError`] as [`run`], or if the tolerance is not in (0, 1).
pub fn run_to_tolerance<'a>(
    scene: &'a Scene,
    strategy: &Strategy,
    tolerance: f64,
    report_grid: u32,
    most_elements: usize,
) -> Result<ToleranceRun<'a>, RunError> {
    run_to_tolerance_while(scene, strategy, tolerance, report_grid, most_elements, &mut |_| true)
}

/// [`run_to_tolerance`] that goes on to a finer mesh only while `go_on` says so of the refinements so far.
///
/// # Errors
///
/// As [`run_to_tolerance`].
pub fn run_to_tolerance_while<'a>(
    scene: &'a Scene,
    strategy: &Strategy,
    tolerance: f64,
    report_grid: u32,
    most_elements: usize,
    go_on: &mut dyn FnMut(&[ToleranceStep]) -> bool,
) -> Result<ToleranceRun<'a>, RunError> {
    if !(tolerance > 0.0 && tolerance < 1.0) {
        return Err(RunError::Tolerance { value: tolerance });
    }
    let mut steps: Vec<ToleranceStep> = Vec::new();
    let mut before: Option<GridValues> = None;
    let mut subdivision = 2;
    loop {
        let mut strategy = strategy.clone();
        strategy.mesh.elements = Subdivision::Uniform(subdivision);
        let run = run(scene, &strategy, &mut ())?;
        let h = &run.solution.irradiance;
        let mut grid = match &strategy.view {
            Some(camera) => GridValues::seen(&run.geometry, h, camera),
            None => GridValues::means(&run.geometry, h, report_grid)?,
        };
        if let Some(asked) = &strategy.asked {
            grid = grid.on(asked);
        }
        let left_out = run.bounded_error().unwrap_or(f64::INFINITY);
        let difference = before.as_ref().map(|before| before.error(&grid));
        let elements = run.geometry.elements().len();
        let links = run.hierarchical.as_ref().map_or(0.0, |links| links.error);
        let step = ToleranceStep { subdivision, elements, cost: run.cost(), difference, left_out, links };
        let met = step.estimate().is_some_and(|estimate| estimate <= tolerance);
        steps.push(step);
        if met || elements * 4 > most_elements || !go_on(&steps) {
            return Ok(ToleranceRun { run, steps, met });
        }
        before = Some(grid);
        subdivision *= 2;
    }
}
