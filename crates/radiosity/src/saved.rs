//! Form factors that were computed before and saved, fitted to the mesh they belong to.
//!
//! What is *not* here: files, and any form but the full one: sums over patches can be had from the elements again.

use radiosity_core::{Cost, StoreError};
use radiosity_form_factors::Rows;
use rayon::prelude::*;

use crate::Geometry;

/// Face and cell that a row stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SavedCell {
    /// The face, from 0.
    pub surface: u32,
    /// Column and row of the cell on the face, where faces are subdivided.
    pub cell: Option<[u32; 2]>,
}

impl std::fmt::Display for SavedCell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.cell {
            Some([i, j]) => write!(f, "cell ({i}, {j}) of face {}", self.surface),
            None => write!(f, "face {}", self.surface),
        }
    }
}

/// A matrix of form factors, row = from, and what is known of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SavedFormFactors {
    /// F_st, row after row.
    pub values: Vec<f64>,
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// Area of every row, if known.
    pub areas: Option<Vec<f64>>,
    /// Relative error of those areas, as they were written.
    pub area_error: f64,
    /// What every row stands for, if known.
    pub cells: Option<Vec<SavedCell>>,
    /// Bound of the error of every entry of each row, if known.
    pub bounds: Option<Vec<f64>>,
    /// Whether a row-wise estimator made them: then the two directions of a pair carry errors of their own, and taking their
    /// mean would spoil the row sums.
    pub row_wise: bool,
}

/// Why saved form factors do not belong to a mesh.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// Not square.
    #[error("the matrix has {rows} rows and {columns} columns; form factors between elements are square")]
    Square {
        /// Rows.
        rows: usize,
        /// Columns.
        columns: usize,
    },
    /// As many of something as rows.
    #[error("the matrix has {rows} rows, but there are {has} {what} beside it")]
    Length {
        /// What there is too much or too little of.
        what: &'static str,
        /// How many there are.
        has: usize,
        /// Rows of the matrix.
        rows: usize,
    },
    /// Another mesh.
    #[error("the matrix has {rows} rows of some area, but the mesh has {elements} elements")]
    Rows {
        /// Rows with an area.
        rows: usize,
        /// Elements of the mesh, covered ones included.
        elements: usize,
    },
    /// Another order, or another scene.
    #[error("row {row} is of {saved}, but element {element} of the mesh is {mesh}")]
    Cell {
        /// Row of the matrix.
        row: usize,
        /// What it stands for.
        saved: SavedCell,
        /// Element in its place.
        element: usize,
        /// What that is.
        mesh: SavedCell,
    },
    /// Another scene.
    #[error("row {row} is of an area of {saved}, but element {element} of the mesh has {mesh}")]
    Area {
        /// Row of the matrix.
        row: usize,
        /// Its area.
        saved: f64,
        /// Element in its place.
        element: usize,
        /// Its area.
        mesh: f64,
    },
    /// What has no area, or lies inside a solid, exchanges nothing.
    #[error("entry ({row}, {column}) is {value}, but {what}, so that it must be 0")]
    Nothing {
        /// Row.
        row: usize,
        /// Column.
        column: usize,
        /// The entry.
        value: f64,
        /// Why there can be nothing.
        what: &'static str,
    },
}

/// Relative difference of areas that is rounding of the coordinates they were computed from.
const AREA: f64 = 1e-9;
/// Relative rounding of an entry that was divided by an area, written, read and multiplied again, twice for safety.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

impl SavedFormFactors {
    /// The rows of the exposed elements of `geometry`, in their order.
    ///
    /// The rows must be those of its mesh: one an element, in order, covered ones included, and rows of zeros for faces without
    /// an area. They are symmetric, with the mean of A_s F_st and A_t F_ts on both sides, where the two differ nowhere by more
    /// than rounding and, unless a row-wise estimator made them, their bounds; otherwise they stay as they are.
    ///
    /// # Errors
    ///
    /// [`FitError`] if they belong to another mesh.
    pub fn fit(self, geometry: &Geometry<'_>) -> Result<FittedRows, FitError> {
        let (rows, elements) = (self.rows, &geometry.mesh().elements);
        if rows != self.columns {
            return Err(FitError::Square { rows, columns: self.columns });
        }
        let lengths = [
            ("areas", self.areas.as_ref().map(Vec::len)),
            ("names of faces and cells", self.cells.as_ref().map(Vec::len)),
            ("error bounds", self.bounds.as_ref().map(Vec::len)),
        ];
        for (what, has) in lengths {
            if let Some(has) = has.filter(|has| *has != rows) {
                return Err(FitError::Length { what, has, rows });
            }
        }
        // Faces without an area have rows, but no elements.
        let has_area = |row: &usize| self.areas.as_ref().is_none_or(|areas| areas[*row] != 0.0);
        let kept: Vec<usize> = (0..rows).filter(has_area).collect();
        if kept.len() != elements.len() {
            return Err(FitError::Rows { rows: kept.len(), elements: elements.len() });
        }
        let mismatch = self.compare(geometry, &kept)?;
        let flat: Vec<usize> = (0..rows).filter(|row| !has_area(row)).collect();
        self.nothing(&flat, "one of the two has no area")?;
        let covered: Vec<usize> = kept.iter().zip(elements).filter(|(_, e)| e.covered).map(|(&row, _)| row).collect();
        self.nothing(&covered, "one of the two elements lies inside a solid")?;
        let rows = geometry.exposed().iter().map(|&e| kept[e as usize]).collect();
        Ok(FittedRows::new(self, rows, geometry.elements().areas(), ROUNDING + 2.0 * mismatch))
    }

    /// Compares what rows stand for and their areas with the elements in their place; the largest relative difference of areas.
    fn compare(&self, geometry: &Geometry<'_>, kept: &[usize]) -> Result<f64, FitError> {
        let mesh = geometry.mesh();
        let mut worst = 0.0_f64;
        for (element, &row) in kept.iter().enumerate() {
            if let Some(saved) = self.cells.as_ref().map(|cells| cells[row]) {
                let e = &mesh.elements[element];
                let mesh = SavedCell { surface: e.surface, cell: saved.cell.map(|_| [e.i, e.j]) };
                if saved != mesh {
                    return Err(FitError::Cell { row, saved, element, mesh });
                }
            }
            if let Some(saved) = self.areas.as_ref().map(|areas| areas[row]) {
                let area = mesh.element_facets.area(element);
                let difference = (saved / area - 1.0).abs();
                if difference.is_nan() || difference > AREA.max(self.area_error) {
                    return Err(FitError::Area { row, saved, element, mesh: area });
                }
                worst = worst.max(difference);
            }
        }
        Ok(worst)
    }

    /// Refuses entries in the rows and columns named.
    fn nothing(&self, named: &[usize], what: &'static str) -> Result<(), FitError> {
        for &k in named {
            for l in 0..self.rows {
                for (row, column) in [(k, l), (l, k)] {
                    let value = self.values[row * self.rows + column];
                    if value != 0.0 {
                        return Err(FitError::Nothing { row, column, value, what });
                    }
                }
            }
        }
        Ok(())
    }
}

/// Exchange areas between the exposed elements of a mesh, from saved form factors.
#[derive(Clone, Debug)]
pub struct FittedRows {
    saved: SavedFormFactors,
    /// Row of the matrix of every exposed element.
    rows: Vec<usize>,
    areas: Vec<f64>,
    symmetric: bool,
    apart: f64,
}

impl FittedRows {
    fn new(saved: SavedFormFactors, rows: Vec<usize>, areas: Vec<f64>, rounding: f64) -> Self {
        let mut new = Self { saved, rows, areas, symmetric: false, apart: 0.0 };
        let of_row = |s: usize| {
            let (mut symmetric, mut apart) = (true, 0.0_f64);
            for t in 0..s {
                let (there, back) = (new.exchange(s, t), new.exchange(t, s));
                let difference = (there - back).abs();
                let bounds = if new.saved.row_wise { 0.0 } else { new.known_bound(s) + new.known_bound(t) };
                symmetric &= difference <= rounding * there.max(back) + bounds;
                apart = apart.max(difference / new.areas[s].min(new.areas[t]));
            }
            (symmetric, apart)
        };
        let all: Vec<(bool, f64)> = (0..new.areas.len()).into_par_iter().map(of_row).collect();
        new.symmetric = all.iter().all(|(symmetric, _)| *symmetric);
        new.apart = all.iter().fold(0.0, |worst, (_, apart)| worst.max(*apart));
        new
    }

    /// The largest |A_s F_st − A_t F_ts| / min(A_s, A_t) between the two directions of a pair, as they were saved.
    pub fn apart(&self) -> f64 {
        self.apart
    }

    /// Whether the error of entries is bounded.
    pub fn has_bounds(&self) -> bool {
        self.saved.bounds.is_some()
    }

    /// A_s F_st as it was saved.
    fn exchange(&self, s: usize, t: usize) -> f64 {
        self.areas[s] * self.saved.values[self.rows[s] * self.saved.rows + self.rows[t]]
    }

    /// Bound of the exchange areas of row s; 0 if none is known.
    fn known_bound(&self, s: usize) -> f64 {
        self.saved.bounds.as_ref().map_or(0.0, |bounds| self.areas[s] * bounds[self.rows[s]])
    }
}

impl Rows for FittedRows {
    fn name(&self) -> &'static str {
        "saved"
    }

    fn sources(&self) -> usize {
        self.areas.len()
    }

    fn targets(&self) -> usize {
        self.areas.len()
    }

    fn symmetric(&self) -> bool {
        self.symmetric
    }

    /// The bound is infinite where none is known.
    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        let mean = |t: usize| 0.5 * (self.exchange(s, t) + self.exchange(t, s));
        for (t, value) in values.iter_mut().enumerate() {
            *value = if self.symmetric { mean(t) } else { self.exchange(s, t) };
        }
        // The mean is off by no more than the worse of the two.
        let other = |t: usize| if self.symmetric { self.known_bound(t) } else { 0.0 };
        let bound = (0..self.areas.len()).map(other).fold(self.known_bound(s), f64::max);
        Ok((Cost::default(), if self.has_bounds() { bound } else { f64::INFINITY }))
    }
}
