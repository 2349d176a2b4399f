//! What is stored as a control of the final gather: directions are gathered only where the mesh cannot hold what they would find.
//!
//! Let f(x, u) be what is stored where the direction of u ∈ [0, 1)² from x arrives, ρH of that surface, and h(x) what is stored at x itself. Directions are distributed like the
//! cosine, so that a gather finds G(x) = ∫ f(x, u) du. Every facet looks around from K points x_k (9 of a quadrilateral) along M = 64 directions, one in each cell of a grid over
//! [0, 1)², the same from all points,
//!
//! ```text
//! D_k = (1/M) Σ_c (f(x_k, u_c) − f̄(u_c)) − (h(x_k) − h̄)          what the gather would add
//! r²  = (1/K) Σ_k (D_k² − v_k),      v_k = (1/M²) Σ over pairs of neighbouring cells of (difference of f(x_k, ·) − f̄)²
//! ```
//!
//! with f̄ and h̄ the means over the points: the mean over a facet is the solution's, and only its shape is in question. As a control variate (Lafortune and Willems 1995), f̄ takes
//! out whatever the points see alike, so that few directions tell what contacts and corners do. A facet of ρ r above a tolerance of the mean of ρH is gathered from; the others are shown
//! as stored, and the picture is off by about the tolerance there. A facet whose light varies between its points alone goes unnoticed.
//!
//! Pixel by pixel the same control does not pay: with f̄ as a step function over the cells what one direction finds spreads 0.7 times as far in the
//! Cornell box, which the even spread of a pixel's own directions gains as well, and no more than once.
//!
//! What is *not* here: the gather.

use glam::DVec3;
use radiosity_core::{BandValues, Cost, mix, uniform};
use radiosity_geometry::{Facets, Polygon};
use rayon::prelude::*;

use super::{Field, Stored, TwoPass, TwoPassSettings, WAYS, Way};
use crate::brdf::{Frame, cosine_direction};
use crate::numbers::Numbers;
use crate::path_class::{Itinerary, PathClasses};
use crate::stage::{RADIANCE, Stage};
use crate::walk::Walk;

/// Cells along either side of [0, 1)².
const CELLS: usize = 8;

/// Directions that a facet looks along.
const DIRECTIONS: usize = CELLS * CELLS;

/// Where points lie between the middle of a polygon and its border: so that those of a rectangle are the middles of 3 × 3 cells.
const OUTWARDS: f64 = 2.0 / 3.0;

/// Facets from which directions are gathered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Control {
    gathers: Vec<bool>,
    /// What looking around cost.
    pub cost: Cost,
}

/// What one facet sees.
struct Look {
    /// ρ² r², summed over bands.
    square: f64,
    /// ρH, summed over bands.
    level: f64,
    cost: Cost,
}

impl Control {
    /// Looks around from `facets`, which own the polygons of `stage` and have the given reflectance, to the irradiance stored by its ways of arriving ([`Stored::Apart`]).
    ///
    /// `tolerance` is relative to the mean of ρH over their area. Each facet has numbers of its own, so that nothing depends on the number of threads.
    ///
    /// # Panics
    ///
    /// If `reflectance` is that of other facets.
    pub fn new(
        stage: &Stage<'_>,
        (facets, reflectance): (&Facets, &BandValues),
        ways: [&dyn Field; 4],
        tolerance: f64,
        seed: u64,
    ) -> Self {
        assert_eq!(reflectance.len(), facets.len(), "reflectance of the facets");
        let (stored, settings) = (Stored::Apart(ways), TwoPassSettings::default());
        let pass = TwoPass { stage, stored, settings, classes: PathClasses::ALL, control: None };
        let look = |e: usize| {
            let rho: Vec<f64> = (0..stage.bands()).map(|b| reflectance.band(b)[e]).collect();
            pass.look((e as u32, &facets.polygons(e)[0]), &rho, mix(seed ^ mix(e as u64)))
        };
        let looks: Vec<Look> = (0..facets.len()).into_par_iter().map(look).collect();
        let areas = facets.areas();
        let mean = looks.iter().zip(&areas).map(|(look, a)| look.level * a).sum::<f64>() / areas.iter().sum::<f64>();
        let largest = (tolerance * mean).powi(2);
        Self {
            gathers: looks.iter().map(|look| look.square > largest).collect(),
            cost: looks.iter().map(|look| look.cost).sum(),
        }
    }

    /// Number of facets from which directions are gathered.
    pub fn count(&self) -> usize {
        self.gathers.iter().filter(|gathers| **gathers).count()
    }

    /// Whether directions are gathered from a facet.
    pub fn gathers(&self, facet: u32) -> bool {
        self.gathers.get(facet as usize).is_some_and(|gathers| *gathers)
    }
}

impl TwoPass<'_> {
    /// Looks around from a facet.
    fn look(&self, (facet, polygon): (u32, &Polygon), reflectance: &[f64], seed: u64) -> Look {
        let (bands, frame) = (reflectance.len(), Frame::new(polygon.normal()));
        if reflectance.iter().all(|rho| *rho == 0.0) {
            return Look { square: 0.0, level: 0.0, cost: Cost::default() };
        }
        let points = points(polygon);
        let count = points.len();
        // Σ over directions of f − f̄, and over pairs of neighbouring cells of the square of what these differ by; by points and bands.
        let mut sums = vec![[0.0; 2]; count * bands];
        let (mut found, mut before, mut cost) = (vec![0.0; count * bands], vec![0.0; count * bands], Cost::default());
        for c in 0..DIRECTIONS {
            let numbers = mix(seed ^ c as u64);
            let within = |cell: usize, k: u64| (cell as f64 + uniform(mix(numbers ^ k))) / CELLS as f64;
            let direction = frame.scene(cosine_direction([within(c % CELLS, 1), within(c / CELLS, 2)]));
            found.fill(0.0);
            for (point, f) in points.iter().zip(found.chunks_exact_mut(bands)) {
                cost += self.found(*point, direction, &mut Numbers::new(numbers, 0), f);
            }
            for b in 0..bands {
                let mean = found.iter().skip(b).step_by(bands).sum::<f64>() / count as f64;
                found.iter_mut().skip(b).step_by(bands).for_each(|f| *f -= mean);
            }
            for (([sum, squares], f), before) in sums.iter_mut().zip(&found).zip(&before) {
                *sum += f;
                *squares += if c % 2 == 1 { (f - before).powi(2) } else { 0.0 };
            }
            std::mem::swap(&mut found, &mut before);
        }
        // What is stored of what a gather finds, and all of it.
        let (mut stored, mut level) = (vec![0.0; count * bands], vec![0.0; bands]);
        for (point, h) in points.iter().zip(stored.chunks_exact_mut(bands)) {
            self.add_stored(facet, *point, h, |way| GATHERED.contains(&way));
            self.add_stored(facet, *point, &mut level, |_| true);
        }
        let m = DIRECTIONS as f64;
        let square_of = |b: usize| {
            let mean = stored.iter().skip(b).step_by(bands).sum::<f64>() / count as f64;
            let pairs = sums.iter().zip(&stored).skip(b).step_by(bands);
            let square = |([sum, squares], h): (&[f64; 2], &f64)| (sum / m - (h - mean)).powi(2) - squares / (m * m);
            pairs.map(square).sum::<f64>() / count as f64
        };
        let square = (0..bands).map(|b| reflectance[b].powi(2) * square_of(b)).sum();
        let level = reflectance.iter().zip(&level).map(|(rho, h)| rho * h).sum::<f64>() / count as f64;
        Look { square, level, cost }
    }

    /// Adds what a direction from a point finds, in W/m².
    fn found(&self, origin: DVec3, direction: DVec3, numbers: &mut Numbers, f: &mut [f64]) -> Cost {
        let weight = vec![1.0 / RADIANCE; f.len()];
        let itinerary = Itinerary::AT_RECEIVER;
        let walk = Walk { origin, direction, weight, density: None, itinerary, scatterings: 1, worth: 1.0 / RADIANCE };
        self.follow(walk, PathClasses::NONE, numbers, f, &|walk, arrival, _, f| {
            self.reflect_stored(walk, arrival, f, |_| true);
            Cost::default()
        })
    }
}

/// The middle of a polygon, and points towards each vertex and the middle of each edge.
fn points(polygon: &Polygon) -> Vec<DVec3> {
    let middle = polygon.centroid();
    let border = polygon.edges().flat_map(|(a, b)| [a, a.midpoint(b)]);
    std::iter::once(middle).chain(border.map(|p| middle.lerp(p, OUTWARDS))).collect()
}

/// The ways that a gather finds: the others begin at lights.
const GATHERED: [Way; 2] = [WAYS[2], WAYS[3]];
