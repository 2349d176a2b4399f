//! Which pairs are too small to matter, known before any of them is computed.
//!
//! The exchange area of two flat facets with areas A, unit normals n, centroids c and radii R about them is at most
//!
//! ```text
//! U_ij = A_i A_j min(1, h_i/g) min(1, h_j/g) / (π g²),      g = |c_j − c_i| − R_i − R_j,      U_ij = ∞ where g ≤ 0,
//! h_i = n_i·(c_j − c_i) + R_j |n_i × n_j|,                   h_j likewise
//! ```
//!
//! since no two points are nearer than g, none of j is higher over the plane of i than h_i, and what blocks only takes away. What a pair matters is what it
//! carries: with weights w_j of what each facet sends (1 for a share of the row itself), row i may lose β_i A_i. With τ_i the largest limit such that the U_ij w_j
//! of row i below it add up to at most β_i A_i, a pair is dropped if
//!
//! ```text
//! U_ij w_j < τ_i  and  U_ij w_i < τ_j      ⇒      Σ_{j dropped} A_i F_ij w_j ≤ Σ_{j dropped} U_ij w_j ≤ β_i A_i      for every i.
//! ```
//!
//! Both rows of a pair decide alike, so that what is left is symmetric. U is a geometric bound as hierarchical radiosity uses it (P. Hanrahan, D.
//! Salzman and L. Aupperle,
//! "A rapid hierarchical radiosity algorithm", Computer Graphics 25(4), 1991), and U w their BF; the budget of a row in place of a threshold of a pair is what
//! bounds the answer. What is dropped is given back by
//! [`ThinnedFormFactors`](crate::stores::ThinnedFormFactors).
//!
//! What dropped pairs carried of known x is bounded by what is known of them, 0 ≤ D_ij ≤ U_ij and, of a row of a closed scene, their sum d_i:
//!
//! ```text
//! Σ_j D_ij x_j ≤ min_λ ( λ d_i + Σ_{j dropped} U_ij (x_j − λ)₊ ),      and ≥ max_λ ( λ d_i − Σ_{j dropped} U_ij (λ − x_j)₊ )
//! ```
//!
//! (the dual of the linear programme; any λ bounds it, and a few levels come near the best). Tests compare U with exact pairs, the budget with the rows of an unthinned
//! store, the counts, and the bounds with what was dropped.
//!
//! What is *not* here: rows of rays or hemicubes, which are computed whole, and facets of several polygons, which keep all their pairs.

use glam::DVec3;
use pulp::{Simd, WithSimd};
use radiosity_core::{BandValues, Bands, Cost, FormFactors, RowBuf, StoreError};
use radiosity_geometry::Facets;
use rayon::prelude::*;

use crate::analytic::{faces, rounding};
use crate::level::Level;
use crate::rows::Rows;

/// Bits of a number that say in which bin it is: those of the exponent and three of the mantissa.
const BIN: u32 = 49;
/// Bins of one power of two.
const STEPS: usize = 8;
/// Powers of two below the budget of a row that have bins of their own; what is smaller is in the first.
const POWERS: usize = 64;
/// Levels λ at which what dropped pairs carried is bounded.
const LEVELS: usize = 64;
/// Rows that one task looks at; fixed, so that sums come out the same on any number of threads.
const PIECE: usize = 16;

/// What [`Thinning`] drops of the pairs of some facets.
#[derive(Clone, Debug)]
pub struct Thinning {
    places: Places,
    /// w_i.
    sent: Vec<f64>,
    /// τ_i; 0 where nothing is dropped.
    limits: Vec<f64>,
    /// u_i.
    spent: Vec<f64>,
    pairs: u64,
    level: Level,
}

/// Facets, number by number.
#[derive(Clone, Debug, Default)]
struct Places {
    centre: [Vec<f64>; 3],
    normal: [Vec<f64>; 3],
    radius: Vec<f64>,
    area: Vec<f64>,
    /// Heights that rounding and a facet's thickness make.
    slack: Vec<f64>,
}

impl Thinning {
    /// Drops pairs of `facets` that take at most `share` of each row's sum in all; none of those in `kept`.
    ///
    /// # Panics
    ///
    /// If `kept` does not say of every facet whether it keeps its pairs, or the share is not in (0, 1].
    pub fn new(facets: &Facets, kept: &[bool], share: f64) -> Self {
        assert!(share > 0.0 && share <= 1.0, "a share of a row, not {share}");
        Self::weighted(facets, kept, vec![1.0; facets.len()], &vec![share; facets.len()])
    }

    /// Drops pairs of `facets` of which each row gets at most its budget β in all, of what the facets have `sent`; none of those in `kept`.
    ///
    /// # Panics
    ///
    /// If there is not of every facet whether it keeps its pairs, a weight and a budget, all of them finite and not negative.
    pub fn weighted(facets: &Facets, kept: &[bool], sent: Vec<f64>, budgets: &[f64]) -> Self {
        let m = facets.len();
        assert_eq!(
            (kept.len(), sent.len(), budgets.len()),
            (m, m, m),
            "whether it keeps its pairs, a weight and a budget of every facet"
        );
        assert!(sent.iter().chain(budgets).all(|x| x.is_finite() && *x >= 0.0), "weights and budgets are not negative");
        let places = Places::new(facets, kept);
        let (limits, spent, level) = (vec![0.0; m], vec![0.0; m], Level::best());
        let mut thinning = Self { places, sent, limits, spent, pairs: 0, level };
        thinning.limits = thinning.by_rows(|i, bounds| {
            let carried = bounds.iter().zip(&thinning.sent).map(|(bound, sent)| bound * sent);
            limit(carried, budgets[i] * thinning.places.area[i])
        });
        let dropped: Vec<(u64, f64)> = thinning.by_rows(|i, bounds| {
            let of_row = (0..m).filter(|&j| thinning.drops(i, j, bounds[j]));
            // Bounds do not know what lies behind a plane that a sphere crosses; the estimator does.
            let paired = |j: usize| u64::from(j > i && thinning.faces(facets, i, j));
            of_row.fold((0, 0.0), |(count, sum), j| (count + paired(j), sum + bounds[j]))
        });
        thinning.pairs = dropped.iter().map(|(count, _)| count).sum();
        thinning.spent = dropped.into_iter().map(|(_, sum)| sum).collect();
        thinning
    }

    /// Number of facets.
    fn len(&self) -> usize {
        self.limits.len()
    }

    /// Number of pairs that face each other and are dropped.
    pub fn pairs(&self) -> u64 {
        self.pairs
    }

    /// u_i of every row: what it may have lost.
    pub fn spent(&self) -> &[f64] {
        &self.spent
    }

    /// Largest u_i/A_i.
    pub fn share(&self) -> f64 {
        self.spent.iter().zip(&self.places.area).filter(|(_, a)| **a > 0.0).map(|(u, a)| u / a).fold(0.0, f64::max)
    }

    /// Bounds of Σ_{j dropped} D_ij x_j of every row and band, least and largest, over all D_ij that are not negative, at most U_ij and in every row `lost` in
    /// sum; or no more than that if it is not known `exactly`.
    ///
    /// # Panics
    ///
    /// If x is negative, or it or what was lost does not fit the facets.
    pub fn carried(&self, x: Bands<'_>, lost: &[f64], exactly: bool) -> [BandValues; 2] {
        let m = self.len();
        assert_eq!((x.len(), lost.len()), (m, m), "carried: lengths");
        assert!(x.values().iter().all(|x| *x >= 0.0), "carried: negative values");
        let levels: Vec<Levels> = (0..x.count()).map(|b| self.levels(x.band(b))).collect();
        let rows: Vec<Vec<[f64; 2]>> = self.by_rows(|i, bounds| {
            let dropped: Vec<usize> = (0..m).filter(|&j| self.drops(i, j, bounds[j])).collect();
            let of_band = |(b, levels): (usize, &Levels)| {
                let mut sums = [[0.0; 2]; LEVELS];
                for &j in &dropped {
                    let sum = &mut sums[levels.of[j] as usize];
                    sum[0] += bounds[j];
                    sum[1] += bounds[j] * x.band(b)[j];
                }
                levels.bounds(&sums, lost[i], exactly)
            };
            levels.iter().enumerate().map(of_band).collect()
        });
        let ends = |b: usize, end: usize| rows.iter().map(move |row| row[b][end]);
        [0, 1].map(|end| BandValues::new((0..x.count()).flat_map(|b| ends(b, end)).collect(), m))
    }

    /// Levels of x between the extremes of what may be dropped.
    fn levels(&self, x: &[f64]) -> Levels {
        let droppable = x.iter().zip(&self.places.radius).filter(|(_, radius)| radius.is_finite());
        let (least, most) = droppable.fold((f64::INFINITY, 0.0_f64), |(a, b), (x, _)| (a.min(*x), b.max(*x)));
        let (least, step) = if least <= most { (least, (most - least) / LEVELS as f64) } else { (0.0, 0.0) };
        let level = |x: &f64| if step > 0.0 { ((x - least) / step).clamp(0.0, (LEVELS - 1) as f64) as u8 } else { 0 };
        Levels { least, step, of: x.iter().map(level).collect() }
    }

    /// What each row of `store` has of dropped pairs.
    ///
    /// # Errors
    ///
    /// [`StoreError`] if a row cannot be had.
    pub fn of_dropped(&self, store: &dyn FormFactors) -> Result<Vec<f64>, StoreError> {
        let of_row = |i: usize, bounds: &[f64]| -> Result<f64, StoreError> {
            let (mut buf, mut sum) = (RowBuf::default(), 0.0);
            store.row(i, 0, &mut buf)?.entries.for_each(|j, value| {
                sum += if self.drops(i, j, bounds[j]) { value } else { 0.0 };
            });
            Ok(sum)
        };
        self.by_rows(of_row).into_iter().collect()
    }

    /// `of_row(i, U_i)` of every row.
    fn by_rows<T: Send>(&self, of_row: impl Fn(usize, &[f64]) -> T + Sync) -> Vec<T> {
        let m = self.len();
        let of = |bounds: &mut Vec<f64>, i: usize| {
            bounds.resize(m, 0.0);
            self.bound(i, 0, bounds);
            of_row(i, bounds)
        };
        (0..m).into_par_iter().with_min_len(PIECE).map_init(Vec::new, of).collect()
    }

    /// U_ij of the facets from `first` on.
    fn bound(&self, i: usize, first: usize, bounds: &mut [f64]) {
        self.level.dispatch(Fill { places: &self.places, i, first, bounds });
    }

    /// Whether a pair with this bound is dropped, if it faces each other at all.
    fn drops(&self, i: usize, j: usize, bound: f64) -> bool {
        bound > 0.0 && bound * self.sent[j] < self.limits[i] && bound * self.sent[i] < self.limits[j]
    }

    /// As the estimator has it: decided by the corners where a sphere reaches below a plane.
    fn faces(&self, facets: &Facets, i: usize, j: usize) -> bool {
        let clear = self.places.clears(i, j) && self.places.clears(j, i);
        clear || faces(&facets.polygons(i)[0], &facets.polygons(j)[0])
    }
}

impl Places {
    fn new(facets: &Facets, kept: &[bool]) -> Self {
        let mut places = Self::default();
        for (k, kept) in kept.iter().enumerate() {
            match facets.polygons(k) {
                // It has no pairs.
                _ if facets.covered(k) => places.push(DVec3::ZERO, DVec3::ZERO, 0.0, 0.0, 0.0),
                [polygon] if !kept => {
                    let centre = polygon.centroid();
                    let radius = polygon.vertices().iter().map(|v| v.distance(centre)).fold(0.0, f64::max);
                    let slack = rounding(polygon.vertices()) + 2.0 * polygon.thickness();
                    places.push(centre, polygon.normal(), radius, polygon.area(), slack);
                }
                // Near everything, so that no bound holds.
                _ => places.push(DVec3::ZERO, DVec3::ZERO, f64::INFINITY, facets.area(k), 0.0),
            }
        }
        places
    }

    fn push(&mut self, centre: DVec3, normal: DVec3, radius: f64, area: f64, slack: f64) {
        self.centre.iter_mut().zip(centre.to_array()).for_each(|(all, x)| all.push(x));
        self.normal.iter_mut().zip(normal.to_array()).for_each(|(all, x)| all.push(x));
        self.radius.push(radius);
        self.area.push(area);
        self.slack.push(slack);
    }

    /// Whether all of j lies above the plane of i.
    fn clears(&self, i: usize, j: usize) -> bool {
        let of = |all: &[Vec<f64>; 3], k: usize| DVec3::new(all[0][k], all[1][k], all[2][k]);
        let (n, m) = (of(&self.normal, i), of(&self.normal, j));
        let height = n.dot(of(&self.centre, j) - of(&self.centre, i));
        height - self.radius[j] * n.cross(m).length() > self.slack[i] + self.slack[j]
    }
}

/// U_ij of one facet and a run of others.
struct Fill<'a> {
    places: &'a Places,
    i: usize,
    first: usize,
    bounds: &'a mut [f64],
}

impl WithSimd for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let Self { places, i, first, bounds } = self;
        let run = first..first + bounds.len();
        let [x, y, z] = [0, 1, 2].map(|k| &places.centre[k][run.clone()]);
        let [u, v, w] = [0, 1, 2].map(|k| &places.normal[k][run.clone()]);
        let (radius, area, slack) = (&places.radius[run.clone()], &places.area[run.clone()], &places.slack[run]);
        let ([xi, yi, zi], [ui, vi, wi]) =
            ([0, 1, 2].map(|k| places.centre[k][i]), [0, 1, 2].map(|k| places.normal[k][i]));
        let (radius_i, area_i, slack_i) = (places.radius[i], places.area[i], places.slack[i]);
        for k in 0..bounds.len() {
            let (dx, dy, dz) = (x[k] - xi, y[k] - yi, z[k] - zi);
            let (cx, cy, cz) = (vi * w[k] - wi * v[k], wi * u[k] - ui * w[k], ui * v[k] - vi * u[k]);
            let sine = (cx * cx + cy * cy + cz * cz).sqrt();
            let low = slack_i + slack[k];
            let over_i = ui * dx + vi * dy + wi * dz + radius[k] * sine;
            let over_k = radius_i * sine - (u[k] * dx + v[k] * dy + w[k] * dz);
            let gap = (dx * dx + dy * dy + dz * dz).sqrt() - (radius_i + radius[k]);
            let cosines = ((over_i + low) / gap).min(1.0) * ((over_k + low) / gap).min(1.0);
            let bound = (area_i * area[k]) * cosines / (std::f64::consts::PI * (gap * gap));
            let near = if gap > 0.0 { bound } else { f64::INFINITY };
            let away = (over_i <= low) | (over_k <= low) | (area_i * area[k] == 0.0);
            bounds[k] = if away { 0.0 } else { near };
        }
    }
}

/// Levels λ of some values, evenly apart, and the one below each value.
struct Levels {
    least: f64,
    step: f64,
    of: Vec<u8>,
}

impl Levels {
    /// The bounds of a row from Σ U and Σ U x of its dropped pairs by level.
    fn bounds(&self, sums: &[[f64; 2]; LEVELS], lost: f64, exactly: bool) -> [f64; 2] {
        let above = sums.iter().fold([0.0; 2], |all, sum| [all[0] + sum[0], all[1] + sum[1]]);
        // λ = 0 where less may have been lost: all of it, as it was.
        let (mut least, mut largest) = (0.0_f64, if exactly { f64::INFINITY } else { above[1] });
        let (mut above, mut below) = (above, [0.0; 2]);
        for k in 0..=LEVELS {
            let level = self.least + self.step * k as f64;
            largest = largest.min(level * lost + (above[1] - level * above[0]).max(0.0));
            least = least.max(level * lost - (level * below[0] - below[1]).max(0.0));
            if let Some(sum) = sums.get(k) {
                (above, below) = ([above[0] - sum[0], above[1] - sum[1]], [below[0] + sum[0], below[1] + sum[1]]);
            }
        }
        [if exactly { least } else { 0.0 }, largest]
    }
}

/// τ: the largest limit, in steps of an eighth of a power of two, below which what is `carried` adds up to at most `budget`.
fn limit(carried: impl Iterator<Item = f64>, budget: f64) -> f64 {
    let highest = 1.0_f64.to_bits() >> BIN;
    let lowest = highest - (POWERS * STEPS) as u64;
    let mut sums = [0.0; POWERS * STEPS];
    for carried in carried {
        let share = carried / budget;
        if share < 1.0 {
            sums[(share.to_bits() >> BIN).saturating_sub(lowest) as usize] += share;
        }
    }
    let mut spent = 0.0;
    let full = sums.iter().position(|sum| {
        spent += sum;
        spent > 1.0
    });
    let bins = full.unwrap_or(sums.len()) as u64;
    if bins == 0 { 0.0 } else { f64::from_bits((lowest + bins) << BIN) * budget }
}

/// The rows of a symmetric estimator without what is dropped, which is not computed.
pub struct ThinnedRows<'a> {
    rows: Box<dyn Rows + 'a>,
    thinning: &'a Thinning,
}

impl<'a> ThinnedRows<'a> {
    /// `rows` between the facets of `thinning`.
    ///
    /// # Panics
    ///
    /// If the rows are not symmetric, or of another number of facets.
    pub fn new(rows: Box<dyn Rows + 'a>, thinning: &'a Thinning) -> Self {
        assert!(rows.symmetric(), "only pairs are dropped in both of their rows");
        assert_eq!(rows.sources(), thinning.len(), "rows of other facets");
        Self { rows, thinning }
    }

    fn fill(&self, s: usize, first: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        let thinning = self.thinning;
        let mut bounds = vec![0.0; values.len() - first];
        thinning.bound(s, first, &mut bounds);
        let mut wanted = vec![true; values.len()];
        let mut largest = 0.0_f64;
        for (t, bound) in (first..).zip(bounds).filter(|&(t, bound)| thinning.drops(s, t, bound)) {
            (wanted[t], largest) = (false, largest.max(bound));
        }
        let (cost, bound) = self.rows.row_of(s, first, &wanted, values)?;
        // What is not there is off by what it is.
        Ok((cost, bound.max(largest)))
    }
}

impl Rows for ThinnedRows<'_> {
    fn name(&self) -> &'static str {
        self.rows.name()
    }

    fn sources(&self) -> usize {
        self.rows.sources()
    }

    fn targets(&self) -> usize {
        self.rows.targets()
    }

    fn symmetric(&self) -> bool {
        true
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        self.fill(s, 0, values)
    }

    fn upper_row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        self.fill(s, s, values)
    }
}

#[cfg(test)]
mod tests {
    /// Below the limit lie 0.25 + 0.25 + 0.4375 = 0.9375 of a budget of 2; the bin of 0.5 would take it past.
    #[test]
    fn the_limit_of_a_row_takes_what_fits_its_budget() {
        let bounds = [0.5, 0.5, 0.875, 1.0, 7.0, f64::INFINITY, 0.0];
        let limit = |bounds: &[f64], budget| super::limit(bounds.iter().copied(), budget);
        let found = limit(&bounds, 2.0);
        assert!(found > 0.875 && found <= 1.0, "{found}");
        assert_eq!(limit(&[0.5, 1e-40], 0.25), 0.25);
        assert_eq!(limit(&[3.0; 4], 1.0), 1.0);
    }
}
