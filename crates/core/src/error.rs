//! Errors of stores, systems and solves; each carries the data its message names.

use crate::{Direction, Form};

/// A store could not lend a row.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StoreError {
    /// Exchange areas are too small for the precision they are to be kept in.
    #[error(
        "the largest exchange area is {largest:e}, but {store} keeps none below {least:e} to full precision; scale the scene up or keep double precision"
    )]
    Underflow {
        /// Name of the store.
        store: &'static str,
        /// The largest value.
        largest: f64,
        /// What it must reach.
        least: f64,
    },
    /// An estimator gave a value that is no form factor.
    #[error(
        "the exchange area from source {source_index} to target {target_index} is {value}; it must be finite and not negative"
    )]
    Value {
        /// Source of the entry.
        source_index: usize,
        /// Target of the entry.
        target_index: usize,
        /// The value found.
        value: f64,
    },
    /// Exchange areas given as symmetric are not.
    #[error(
        "the exchange area from {source_index} to {target_index} is {value}, but the mirrored one is {mirrored}; they were given as symmetric"
    )]
    NotSymmetric {
        /// Source of the entry.
        source_index: usize,
        /// Target of the entry.
        target_index: usize,
        /// The value found.
        value: f64,
        /// The value of the mirrored entry.
        mirrored: f64,
    },
    /// The store keeps one number for both directions of a pair.
    #[error(
        "the {store} store keeps each pair once and needs symmetric rows of as many sources as targets, but the {rows} rows are not; choose a pairwise estimator with every element its own patch, or another store"
    )]
    NeedsSymmetric {
        /// Name of the store.
        store: &'static str,
        /// Name of the rows' estimator.
        rows: &'static str,
    },
    /// The store would need more memory than the limit given.
    #[error(
        "storing {sources} × {targets} form factors takes {needed} bytes, more than the {limit} allowed; use fewer elements, substructuring or a store that keeps none"
    )]
    Memory {
        /// Rows of the store.
        sources: usize,
        /// Columns of the store.
        targets: usize,
        /// Bytes needed.
        needed: u64,
        /// Bytes allowed.
        limit: u64,
    },
}

/// The data given are no radiosity system.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SystemError {
    /// There is nothing to solve.
    #[error("the system has no elements")]
    Empty,
    /// ρ must lie in [0, 1): with ρ = 1 an enclosure never settles.
    #[error("reflectance of element {element} in band {band} is {value}; it must lie in [0, 1)")]
    Reflectance {
        /// Element.
        element: usize,
        /// Band.
        band: usize,
        /// The value given.
        value: f64,
    },
    /// E must be finite and not negative.
    #[error("emission of element {element} in band {band} is {value}; it must be finite and not negative")]
    Emission {
        /// Element.
        element: usize,
        /// Band.
        band: usize,
        /// The value given.
        value: f64,
    },
    /// A must be finite and positive.
    #[error("area of element {element} is {value}; it must be finite and positive")]
    Area {
        /// Element.
        element: usize,
        /// The value given.
        value: f64,
    },
    /// Vectors of different length.
    #[error("{what} has {has} entries, but the system needs {needs}")]
    Length {
        /// Which vector.
        what: &'static str,
        /// Its length.
        has: usize,
        /// The length needed.
        needs: usize,
    },
    /// The store's rows do not fit the mesh in the form wanted.
    #[error(
        "form {form:?} needs form factors of {needs_sources} sources × {needs_targets} targets, but the store has {has_sources} × {has_targets}"
    )]
    Shape {
        /// Form asked for.
        form: Form,
        /// Sources needed.
        needs_sources: usize,
        /// Targets needed.
        needs_targets: usize,
        /// Sources of the store.
        has_sources: usize,
        /// Targets of the store.
        has_targets: usize,
    },
    /// An element names a patch that does not exist, or a patch has no element.
    #[error(
        "the parent map is wrong at {at}: every element needs one of the {patches} patches and every patch an element"
    )]
    Parent {
        /// Element or patch at fault.
        at: usize,
        /// Number of patches.
        patches: usize,
    },
}

/// A solve that could not begin or whose store failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SolveError {
    /// The method needs A_s F_st = A_t F_ts.
    #[error(
        "{solver} needs symmetric exchange areas, but the {store} store of a row-wise estimator is not symmetric; choose a pairwise estimator or another solver"
    )]
    NeedsSymmetric {
        /// Name of the method.
        solver: &'static str,
        /// Name of the store.
        store: &'static str,
    },
    /// The method does not read rows in this form.
    #[error("{solver} cannot read form factors in the form {form:?}; it works on {works_on:?}")]
    NeedsForm {
        /// Name of the method.
        solver: &'static str,
        /// Form of the system.
        form: Form,
        /// Forms the method reads.
        works_on: &'static [Form],
    },
    /// The start value does not fit the system.
    #[error("the start has {has} values, but the system needs {needs}")]
    Start {
        /// Values given.
        has: usize,
        /// Values needed.
        needs: usize,
    },
    /// The stop rule asks for nothing reachable.
    #[error("the stop rule's unshot fraction is {value}; it must be finite and not negative")]
    Target {
        /// The value given.
        value: f64,
    },
    /// The method cannot take the system in this direction.
    #[error("{solver} cannot solve in direction {direction:?}")]
    NeedsDirection {
        /// Name of the method.
        solver: &'static str,
        /// The direction asked for.
        direction: Direction,
    },
    /// A row could not be had.
    #[error(transparent)]
    Store(#[from] StoreError),
}
