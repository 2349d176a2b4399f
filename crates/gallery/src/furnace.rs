//! Furnaces: closed rooms of one material, in which radiosity is the same everywhere.
//!
//! In any closed scene of uniform emission E and reflectance ρ the rows of F sum to 1, so
//!
//! ```text
//! B = E + ρB = E/(1 − ρ),      H = B
//! ```
//!
//! whatever its shape. An error δ of the row sums shows in B amplified to about δρ/(1 − ρ).

use radiosity_geometry::Scene;

use crate::boxes::{box_in_cube, empty_box, material};

/// An empty furnace room of edges `size`.
///
/// # Panics
///
/// If a length is not finite and positive.
pub fn room(size: [f64; 3], reflectance: f64, emission: f64) -> Scene {
    empty_box(size, material("furnace", reflectance, emission))
}

/// A furnace with a box of edge `side` in the middle of the unit cube.
///
/// # Panics
///
/// If `side` is not between 0 and 1.
pub fn furnished(side: f64, reflectance: f64, emission: f64) -> Scene {
    let same = || material("furnace", reflectance, emission);
    box_in_cube(side, same(), same())
}

/// B = H = E/(1 − ρ) of any furnace.
pub fn radiosity(reflectance: f64, emission: f64) -> f64 {
    emission / (1.0 - reflectance)
}
