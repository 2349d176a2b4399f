//! Rows that are mirror images of others: stores that hold their entries copy them.
//!
//! An isometry g of space that maps the sources onto themselves, the targets onto themselves, and what blocks as well, changes no exchange area:
//!
//! ```text
//! A_gs F_(gs)(gt) = A_s F_st.
//! ```
//!
//! So one row of every orbit of sources is computed, its *original*, and the others are that row with its targets in another order. Where sources
//! and targets are one list and A_s F_st = A_t F_ts, pairs have orbits too, and of a pair of orbits only one original's row is needed: that of the
//! earlier one. With r(s) the original of s, the first of its orbit, and g_s s = r(s),
//!
//! ```text
//! (s, t) is computed  ⇔  s = r(s) ≤ r(t),      A_s F_st = A_r(s) F_(r(s))(g_s t) for s ≤ t,
//! ```
//!
//! which is a pair that is computed, or, where r(t) < r(s), the copy (r(t), g_t r(s)) of one. Orbits of q elements leave one pair in q. A pair that an
//! isometry other than the identity maps onto itself is computed more often than it must be: elements on a plane of symmetry, a few rows of a mesh.
//!
//! The entries of a symmetric store stay symmetric to the last bit, since only those with s ≤ t are copied. What is *not* here: finding the
//! isometries, and stores of lists or of nothing, which compute all rows.

use radiosity_core::{Cost, StoreError};
use rayon::prelude::*;

use crate::rows::{Rows, SparseRow};

/// Which rows are mirror images of which.
#[derive(Clone, Debug, PartialEq)]
pub struct Mirrors {
    /// Original of every source, and which of the maps leads there.
    sources: Vec<(u32, u32)>,
    /// Where each isometry takes every target.
    maps: Vec<Vec<u32>>,
}

impl Mirrors {
    /// Source s is a copy of `sources[s].0`, its original, which is no later and its own original: entry t of its row is entry `maps[sources[s].1][t]` there.
    ///
    /// # Panics
    ///
    /// If an original is none, or there is no such map.
    pub fn new(sources: Vec<(u32, u32)>, maps: Vec<Vec<u32>>) -> Self {
        for (s, &(original, map)) in sources.iter().enumerate() {
            assert!(
                original as usize <= s && sources[original as usize].0 == original,
                "source {original} is no original"
            );
            assert!((map as usize) < maps.len(), "map {map} of {}", maps.len());
        }
        Self { sources, maps }
    }

    /// The original of source s, s itself if it is computed, and what its targets are in that row.
    pub fn original(&self, s: usize) -> (usize, &[u32]) {
        let (original, map) = self.sources[s];
        (original as usize, &self.maps[map as usize])
    }

    /// Whether the row of source s is computed.
    pub fn computes(&self, s: usize) -> bool {
        self.original(s).0 == s
    }

    /// Rows that are computed.
    pub fn computed(&self) -> usize {
        (0..self.sources.len()).filter(|&s| self.computes(s)).count()
    }

    /// Number of sources.
    pub fn sources(&self) -> usize {
        self.sources.len()
    }
}

/// Rows of an estimator of which it is known which are mirror images.
///
/// Asked for one by one they are computed like others; a dense or packed store computes the originals and copies ([`Rows::mirrors`]).
pub struct MirroredRows<'a> {
    rows: Box<dyn Rows + 'a>,
    mirrors: Mirrors,
}

impl<'a> MirroredRows<'a> {
    /// `rows`, which `mirrors` holds of.
    ///
    /// # Panics
    ///
    /// If there is not a row for every source and a target for every entry of a map.
    pub fn new(rows: Box<dyn Rows + 'a>, mirrors: Mirrors) -> Self {
        assert_eq!(mirrors.sources(), rows.sources(), "an original of every source");
        assert!(mirrors.maps.iter().all(|map| map.len() == rows.targets()), "a place of every target");
        Self { rows, mirrors }
    }
}

impl Rows for MirroredRows<'_> {
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
        self.rows.symmetric()
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        self.rows.row(s, values)
    }

    fn sparse_row(&self, s: usize, row: &mut SparseRow) -> Result<(Cost, f64), StoreError> {
        self.rows.sparse_row(s, row)
    }

    fn sparse_upper_row(&self, s: usize, row: &mut SparseRow) -> Result<(Cost, f64), StoreError> {
        self.rows.sparse_upper_row(s, row)
    }

    fn upper_row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        self.rows.upper_row(s, values)
    }

    fn row_of(&self, s: usize, first: usize, wanted: &[bool], values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        self.rows.row_of(s, first, wanted, values)
    }

    fn mirrors(&self) -> Option<&Mirrors> {
        Some(&self.mirrors)
    }
}

/// The computed row that row s has the entries of, and where each of its targets is there.
pub(crate) type RowOf<'r> = dyn Fn(usize) -> Option<(&'r [f64], &'r [u32])> + Sync + 'r;

/// A store while it is filled with rows and their copies.
pub(crate) trait Copies: Sync {
    /// A_s F_st, s ≤ t, once it was put there.
    fn entry(&self, s: usize, t: usize) -> f64;

    /// Puts in the rows that `row` has; of a symmetric store their entries from the diagonal on.
    fn put(&mut self, row: &RowOf<'_>);
}

/// Originals computed before they are copied: the scratch, 256 bytes a target.
const ROWS_AT_ONCE: usize = 32;

/// Not among the rows that are copied.
const NONE: u32 = u32::MAX;

/// Fills `store` with the rows that `compute(s, wanted, values)` gives of the wanted targets of originals, and with their copies; what was found of each original, in
/// order.
///
/// The first fault, in the order of sources, is the same on any number of threads.
pub(crate) fn fill<T: Send>(
    store: &mut impl Copies,
    mirrors: &Mirrors,
    (targets, symmetric): (usize, bool),
    compute: impl Fn(usize, &[bool], &mut [f64]) -> Result<T, StoreError> + Sync,
) -> Result<Vec<T>, StoreError> {
    let sources = mirrors.sources();
    let originals: Vec<usize> = (0..sources).filter(|&s| mirrors.computes(s)).collect();
    let identity: Vec<u32> = (0..targets as u32).collect();
    let mut found = Vec::with_capacity(originals.len());
    let mut rows = vec![0.0; ROWS_AT_ONCE.min(originals.len()) * targets];
    let mut place = vec![NONE; sources];
    // Of symmetric rows: whether row s is the one that has the pairs of its orbit and that of target t.
    let own = |s: usize, t: usize| !symmetric || mirrors.original(t).0 >= s;
    for batch in originals.chunks(ROWS_AT_ONCE) {
        let rows = &mut rows[..batch.len() * targets];
        let computed: Vec<Result<T, StoreError>> = rows
            .par_chunks_mut(targets.max(1))
            .zip(batch)
            .map_init(
                || vec![true; targets],
                |wanted, (values, &s)| {
                    wanted.iter_mut().enumerate().for_each(|(t, wanted)| *wanted = own(s, t));
                    compute(s, wanted, values)
                },
            )
            .collect();
        for one in computed {
            found.push(one?);
        }
        batch.iter().enumerate().for_each(|(k, &s)| place[s] = k as u32);
        if symmetric {
            let row = |s: usize| Some((&rows[place[s] as usize * targets..][..targets], &identity[..]));
            store.put(&|s| if place[s] == NONE { None } else { row(s) });
            // The rest of their rows comes from rows of earlier orbits.
            rows.par_chunks_mut(targets).zip(batch).for_each(|(values, &s)| {
                for (t, value) in values.iter_mut().enumerate() {
                    let (original, map) = mirrors.original(t);
                    if original < s {
                        *value = store.entry(original, map[s] as usize);
                    }
                }
            });
        }
        for s in 0..sources {
            place[s] = place[mirrors.original(s).0];
        }
        let row = |s: usize| Some((&rows[place[s] as usize * targets..][..targets], mirrors.original(s).1));
        store.put(&|s| if place[s] == NONE { None } else { row(s) });
        place.fill(NONE);
    }
    Ok(found)
}
