//! Which store keeps the form factors, where none is asked for: dense or sparse, packed or not, single or double precision, stored or
//! recomputed.
//!
//! | store | is taken where |
//! |---|---|
//! | `packed` | form factors are symmetric, the solver reads them by products alone, and a pair kept once takes less than both of its entries |
//! | `packed-f32` | so, and its rounding of 2⁻²⁴ of an entry is at most a sixteenth of the unshot share that is asked for |
//! | `sparse` | entries that are not zero, with their places, take less than half of what the others would |
//! | `dense` | nothing of that holds, or the strategy needs whole rows |
//! | `on-demand` | no other fits in the memory there is: rows are computed again in every step |
//!
//! Rounding of entries and an unshot rest both reach the answer through the same bounces, at most 1/(1 − ρ) times themselves, so they are compared as
//! they are. Bytes are exact but for sparse stores, which are taken by a bound of their entries: a row of N rays has no more than N, and pairs of
//! which one lies behind the other have none. Pairs that something hides are not known before they are computed, and count as entries here. Gathers read a packed
//! store in half the time; sweeps, shots and factorisations go through it row by row and lose that (ARCHITECTURE, "Packed tiles"): for them it is only what fits
//! where `dense` does not.
//!
//! What is *not* here: links, which have an error of their own and are asked for.

use radiosity_form_factors::stores::PackedFormFactors;
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::MeshError;

use super::Plan;
use super::counts::Tally;
use crate::{Bytes, Geometry, Method, Shape, Size, Store, Strategy, predict};

/// A store, and why it is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StoreChoice {
    /// The store.
    pub store: Store,
    /// Why.
    pub reason: StoreReason,
}

/// Why a store is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StoreReason {
    /// What the strategy does with the form factors needs all entries in rows.
    WholeRows,
    /// No other is smaller, or as quick for the solver.
    Plain,
    /// Pairs kept once take `bytes`, and `dense` as a matrix.
    Once {
        /// Bytes of the store.
        bytes: u64,
        /// Bytes of the dense one.
        dense: u64,
    },
    /// Pairs kept once in single precision: its rounding is small beside what the solver leaves.
    Rounded {
        /// Bytes of the store.
        bytes: u64,
        /// Unshot share at which the solver stops.
        unshot: f64,
    },
    /// Most entries are zero.
    Fill {
        /// Largest share of entries that are not.
        most: f64,
    },
    /// Nothing that holds entries fits.
    Memory {
        /// Bytes of the whole run with the smallest of them.
        needed: u64,
        /// Bytes there are.
        limit: u64,
    },
}

impl std::fmt::Display for StoreReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            Self::WholeRows => f.write_str("whole rows are needed"),
            Self::Plain => f.write_str("no other is smaller and as quick"),
            Self::Once { bytes, dense } => {
                write!(f, "the two directions of a pair are kept once: {} instead of {}", Bytes(bytes), Bytes(dense))
            }
            Self::Rounded { bytes, unshot } => write!(
                f,
                "pairs are kept once and rounded by 6e-8 of themselves, which is little beside the unshot share {unshot:.0e}: {}",
                Bytes(bytes)
            ),
            Self::Fill { most } => write!(f, "at most {:.1} % of the entries are not zero", 100.0 * most),
            Self::Memory { needed, limit } => write!(
                f,
                "held form factors would take about {}, and there are {}: rows are computed in every step",
                Bytes(needed),
                Bytes(limit)
            ),
        }
    }
}

/// Solvers that read row by row, not whole products: sweeps, shots, and factorisations, which copy every row.
const READS_ROWS: [&str; 6] = ["direct", "direct-f32", "gauss-seidel", "sor", "shooting", "overshooting"];
/// Share of the unshot rest that the rounding of entries may be.
const ROUNDING_SHARE: f64 = 1.0 / 16.0;
/// Relative rounding of an entry in single precision.
const SINGLE: f64 = 1.0 / (1_u64 << 24) as f64;
/// Share of the bytes of another store below which a sparse one is taken: its products are slower for an entry.
const SPARSE_SHARE: f64 = 0.5;

/// The store for `strategy` on a mesh of this size of which at most the share `fill` of entries is not zero; that of the strategy is not looked at.
pub fn choose_store(size: &Size, fill: f64, strategy: &Strategy) -> StoreChoice {
    let pairwise = matches!(strategy.method, Method::Analytic { .. });
    let whole_rows = strategy.shape == Shape::TwoLevel || strategy.repair && !pairwise || strategy.samples();
    let of = |store: Store| predict(size, &Strategy { store, ..strategy.clone() });
    let dense = of(Store::Dense).stored_bytes;
    let gathers = !READS_ROWS.contains(&strategy.solver.as_str());
    let m = size.elements as usize;
    let (double, single) = (PackedFormFactors::<f64>::bytes(m), PackedFormFactors::<f32>::bytes(m));
    // Stores with their bytes, the best first.
    let plain = (Store::Dense, if whole_rows { StoreReason::WholeRows } else { StoreReason::Plain }, dense);
    let once = (Store::Packed, StoreReason::Once { bytes: double, dense }, double);
    let mut choices = vec![plain];
    if pairwise && strategy.shape == Shape::Full && !whole_rows && double < dense {
        choices.insert(if gathers { 0 } else { 1 }, once);
        if gathers && SINGLE <= ROUNDING_SHARE * strategy.unshot {
            let reason = StoreReason::Rounded { bytes: single, unshot: strategy.unshot };
            choices.insert(0, (Store::PackedSingle, reason, single));
        }
    }
    let sparse = (fill * 12.0 * (dense / 8) as f64) as u64;
    if !whole_rows && (sparse as f64) < SPARSE_SHARE * choices[0].2 as f64 {
        choices.insert(0, (Store::Sparse, StoreReason::Fill { most: fill }, sparse));
    }
    let choice = |&(store, reason, _): &(Store, StoreReason, u64)| StoreChoice { store, reason };
    let Some(limit) = strategy.memory.filter(|_| !whole_rows) else { return choice(&choices[0]) };
    let beside = of(Store::KeepNone).peak_bytes;
    // Entries of a sparse store are copied where it grows.
    let peak = |(store, _, bytes): &(Store, StoreReason, u64)| {
        beside.saturating_add(if *store == Store::Sparse { 2 * bytes } else { *bytes })
    };
    choices.iter().find(|choice| peak(choice) <= limit).map_or_else(
        || {
            let needed = choices.iter().map(peak).min().unwrap_or(u64::MAX);
            StoreChoice { store: Store::KeepNone, reason: StoreReason::Memory { needed, limit } }
        },
        choice,
    )
}

/// Largest share of entries that are not zero, of rows of `strategy` on a mesh of this size of which nothing else is known.
fn fill_before_meshing(size: &Size, strategy: &Strategy) -> f64 {
    let targets = if strategy.shape == Shape::Full { size.elements } else { size.patches };
    let hits = match strategy.method {
        Method::Analytic { .. } => targets,
        Method::RayCast { rays, .. } | Method::RaysAndEmitters { rays } => u64::from(rays),
        Method::Hemicube { resolution } => 3 * u64::from(resolution).pow(2),
    };
    (hits as f64 / targets.max(1) as f64).min(1.0)
}

impl Plan {
    /// The store for `strategy` by what is known before there is a mesh.
    ///
    /// # Errors
    ///
    /// [`MeshError`] if the settings make no mesh.
    pub fn store_before_meshing(&self, scene: &Scene, strategy: &Strategy) -> Result<StoreChoice, MeshError> {
        let size = self.size_before_meshing(scene, strategy)?.kept;
        Ok(choose_store(&size, fill_before_meshing(&size, strategy), strategy))
    }

    /// The store for `strategy` on `geometry`, which [`Plan::mesh`] made: by what the plan keeps.
    pub fn store(&self, geometry: &Geometry<'_>, strategy: &Strategy) -> StoreChoice {
        let size = self.size(geometry).kept;
        let counts = Tally::new(geometry, strategy, self).counts(std::slice::from_ref(self))[0];
        let fill = match (counts.form_factors, strategy.method, strategy.shape) {
            (Some(pairs), Method::Analytic { .. }, Shape::Full) => {
                (2.0 * pairs as f64 / (size.elements as f64).powi(2)).min(1.0)
            }
            _ => fill_before_meshing(&size, strategy),
        };
        choose_store(&size, fill, strategy)
    }
}

#[cfg(test)]
mod tests {
    use radiosity_geometry::mesh::Subdivision;
    use radiosity_solvers::{NAMES, STOCHASTIC};

    use super::*;

    const SIZE: Size = Size { mesh_elements: 4000, elements: 4000, patches: 4000, bands: 3 };

    fn chosen(fill: f64, change: impl Fn(&mut Strategy)) -> Store {
        let mut strategy = Strategy::new(Subdivision::Uniform(1), Method::ANALYTIC);
        change(&mut strategy);
        choose_store(&SIZE, fill, &strategy).store
    }

    #[test]
    fn symmetric_entries_are_packed_where_the_solver_gathers_and_a_tile_is_not_larger_than_the_matrix() {
        assert_eq!(chosen(1.0, |_| ()), Store::Packed);
        assert_eq!(chosen(1.0, |s| s.solver = "gauss-seidel".to_owned()), Store::Dense);
        let few = Size { mesh_elements: 150, elements: 150, patches: 150, bands: 3 };
        let strategy = Strategy::new(Subdivision::Uniform(1), Method::ANALYTIC);
        assert_eq!(choose_store(&few, 1.0, &strategy).store, Store::Dense);
    }

    #[test]
    fn every_solver_gets_the_store_that_it_reads_best() {
        for name in NAMES.into_iter().chain([STOCHASTIC]) {
            let mut strategy = Strategy::new(Subdivision::Uniform(1), Method::ANALYTIC);
            strategy.solver = name.to_owned();
            let found = choose_store(&SIZE, 1.0, &strategy);
            let (dense, bytes) = (8 * SIZE.elements.pow(2), PackedFormFactors::<f64>::bytes(SIZE.elements as usize));
            let expected = match name {
                // Products alone.
                "jacobi" | "chebyshev" | "cg" | "deflated-cg" | "gmres" => {
                    (Store::Packed, StoreReason::Once { bytes, dense })
                }
                // Rows in turn; dense ones are no larger than what a factorisation holds beside them.
                "direct" | "direct-f32" | "gauss-seidel" | "sor" | "shooting" | "overshooting" => {
                    (Store::Dense, StoreReason::Plain)
                }
                // Draws from whole rows.
                "stochastic" => (Store::Dense, StoreReason::WholeRows),
                other => panic!("which store does {other} read best?"),
            };
            assert_eq!((found.store, found.reason), expected, "{name}");
        }
    }

    /// 2⁻²⁴ = 6·10⁻⁸ is a sixteenth of 9.5·10⁻⁷.
    #[test]
    fn single_precision_is_taken_only_where_it_is_small_beside_what_the_solver_leaves() {
        assert_eq!(chosen(1.0, |s| s.unshot = 9e-7), Store::Packed);
        assert_eq!(chosen(1.0, |s| s.unshot = 1e-6), Store::PackedSingle);
    }

    /// 12 bytes an entry against 4 of the packed and 8 of the dense store, of which half is the limit.
    #[test]
    fn sparse_is_taken_by_a_bound_of_the_entries() {
        assert_eq!([0.16, 0.18].map(|fill| chosen(fill, |_| ())), [Store::Sparse, Store::Packed]);
        let rays = |rays| {
            let strategy = Strategy::new(Subdivision::Uniform(1), Method::rays(rays));
            choose_store(&SIZE, fill_before_meshing(&SIZE, &strategy), &strategy).store
        };
        assert_eq!([1300, 1400].map(rays), [Store::Sparse, Store::Dense]);
    }

    #[test]
    fn rows_are_computed_again_only_if_no_store_fits_and_whole_rows_are_kept_whole() {
        // Packed 64 MB, dense 128 MB.
        let within = |megabytes: u64| {
            chosen(1.0, |s| {
                s.memory = Some(megabytes * 1_000_000);
                s.solver = "gauss-seidel".to_owned();
            })
        };
        assert_eq!([200, 100, 30].map(within), [Store::Dense, Store::Packed, Store::KeepNone]);
        let repaired = |s: &mut Strategy| (s.method, s.repair, s.memory) = (Method::rays(16), true, Some(1));
        assert_eq!(chosen(0.01, repaired), Store::Dense);
    }
}
