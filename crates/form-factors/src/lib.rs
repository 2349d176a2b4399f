//! Form-factor estimators, stores, checks and repair.
//!
//! Everything here is about exchange areas A_s F_st. [`Pairwise`] estimators give the exchange area of any two polygons
//! and so symmetric rows; row-wise ones ([`Rows`] directly) give the whole row of a source. Stores keep rows
//! ([`stores`]), [`checks`] tell what is wrong with them, and [`repair`] closes the rows of a closed scene.

pub mod analytic;
pub mod checks;
pub mod emitters;
pub mod extended;
pub mod hemicube;
pub mod hierarchical;
#[doc(hidden)]
pub mod level;
mod mirrored;
pub mod point;
pub mod ray_cast;
mod ray_points;
pub mod repair;
mod row_wise;
mod rows;
mod selected;
pub mod stores;
pub mod thinning;
pub mod update;

pub use mirrored::{MirroredRows, Mirrors};
pub use row_wise::Receivers;
pub use rows::{Estimate, Numbers, Pairwise, PairwiseRows, Rows, Run, Sampler, SparseRow};
pub use selected::SelectedRows;
pub use thinning::{ThinnedRows, Thinning};
