//! Closing the rows of a store by symmetric scaling, in place.

use std::time::Instant;

use radiosity_core::FormFactors;
use radiosity_form_factors::checks::check;
use radiosity_form_factors::repair::{RepairError, Scaling, repair};
use radiosity_form_factors::stores::{DenseFormFactors, Held};

use crate::Phase;

/// A repair that was made.
#[derive(Clone, Debug, PartialEq)]
pub struct Repair {
    /// The largest |A_s F_st − A_t F_ts| / min(A_s, A_t) of the two directions of a pair, of which the mean was taken before
    /// scaling; `None` where they were one number.
    pub symmetrised: Option<f64>,
    /// The scaling and the size of the change, against the store after the mean was taken.
    pub scaling: Scaling,
    /// What finding and applying it took.
    pub phase: Phase,
}

/// Finds the scaling that closes the rows of a symmetric store of a closed scene, and applies it.
///
/// # Errors
///
/// [`RepairError`] if the scene is open, the store is not symmetric, or there is no such scaling.
///
/// # Panics
///
/// If there is not one area a source.
pub fn mend(store: &mut dyn Held, areas: &[f64], closed: bool) -> Result<Repair, RepairError> {
    let clock = Instant::now();
    let scaling = repair(&*store, areas, closed)?;
    scaling.apply(store);
    let phase = Phase { cost: scaling.cost, time: clock.elapsed() };
    Ok(Repair { symmetrised: None, scaling, phase })
}

/// [`mend`] of any square store: one that is not symmetric first gets the mean of both directions of every pair.
///
/// Rows of rays or hemicubes carry errors of their own, so that the two directions differ; their mean keeps reciprocity and loses the
/// row sums, which the scaling gives back.
///
/// # Errors
///
/// As [`mend`].
///
/// # Panics
///
/// If the store is not square, or there is not one area a source.
pub fn mend_dense(
    mut store: DenseFormFactors,
    areas: &[f64],
    closed: bool,
) -> Result<(DenseFormFactors, Repair), RepairError> {
    if !closed {
        return Err(RepairError::Open);
    }
    let mut apart = None;
    if !store.properties().symmetric {
        apart = Some(check(&store, areas, areas, closed)?.reciprocity.map_or(0.0, |(.., apart)| apart));
        store = store.symmetrised();
    }
    let repair = Repair { symmetrised: apart, ..mend(&mut store, areas, closed)? };
    Ok((store, repair))
}
