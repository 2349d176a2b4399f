//! Dense matrices of form factors as files: row = sender, column = receiver, row after row.
//!
//! Three formats, chosen by the file's extension: [`csv`] for spreadsheets, [`mtx`] (MatrixMarket) for sparse solvers,
//! [`npy`] for NumPy. All three give back the same bits. What the matrix belongs to (scene, method, bounds) is left to
//! whoever writes it.

pub mod csv;
pub mod mtx;
pub mod npy;

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use crate::{ReadError, WriteError};

/// A dense matrix to be written: borrowed as a whole, or given row by row, so that nobody needs to hold it for the file's sake.
#[derive(Clone, Copy)]
pub struct MatrixView<'a> {
    rows: usize,
    columns: usize,
    values: Values<'a>,
}

#[derive(Clone, Copy)]
enum Values<'a> {
    Whole(&'a [f64]),
    Rows(&'a dyn Fn(usize, &mut [f64])),
}

impl std::fmt::Debug for MatrixView<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "MatrixView {{ {} × {} }}", self.rows, self.columns)
    }
}

impl<'a> MatrixView<'a> {
    /// Views `values` as `rows` rows of `columns` values.
    ///
    /// # Panics
    ///
    /// If `values` does not hold `rows` · `columns` values.
    pub fn new(rows: usize, columns: usize, values: &'a [f64]) -> Self {
        assert_eq!(Some(values.len()), rows.checked_mul(columns), "values of a {rows} × {columns} matrix");
        Self { rows, columns, values: Values::Whole(values) }
    }

    /// `rows` rows of `columns` values, of which `fill(i, row)` sets row i, which is 0 before. A row is asked for two or three times
    /// while a file is written.
    pub fn by_rows(rows: usize, columns: usize, fill: &'a dyn Fn(usize, &mut [f64])) -> Self {
        Self { rows, columns, values: Values::Rows(fill) }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Calls `visit(i, row i)` for all rows in order, until one fails.
    ///
    /// # Errors
    ///
    /// What `visit` gives.
    pub fn try_for_each_row<E>(&self, mut visit: impl FnMut(usize, &[f64]) -> Result<(), E>) -> Result<(), E> {
        match self.values {
            Values::Whole(values) => {
                (0..self.rows).try_for_each(|i| visit(i, &values[i * self.columns..(i + 1) * self.columns]))
            }
            Values::Rows(fill) => {
                let mut row = vec![0.0; self.columns];
                (0..self.rows).try_for_each(|i| {
                    row.fill(0.0);
                    fill(i, &mut row);
                    visit(i, &row)
                })
            }
        }
    }

    /// Refuses values that no reader would take for a form factor.
    pub(crate) fn check(&self, path: &Path) -> Result<(), WriteError> {
        self.try_for_each_row(|i, row| match row.iter().position(|v| !v.is_finite()) {
            Some(column) => Err(WriteError::NotFinite { path: path.to_owned(), row: i, column, value: row[column] }),
            None => Ok(()),
        })
    }
}

/// An owned dense matrix, row after row.
#[derive(Clone, Debug, PartialEq)]
pub struct Matrix {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// Values, row after row.
    pub values: Vec<f64>,
}

impl Matrix {
    /// A borrowed view.
    ///
    /// # Panics
    ///
    /// If `values` does not hold `rows` · `columns` values.
    pub fn view(&self) -> MatrixView<'_> {
        MatrixView::new(self.rows, self.columns, &self.values)
    }
}

/// Formats of matrix files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MatrixFormat {
    /// Comma-separated values without a header.
    Csv,
    /// MatrixMarket coordinates.
    Mtx,
    /// NumPy array of doubles.
    Npy,
}

impl MatrixFormat {
    /// The format that the extension of `path` names, upper or lower case; `None` if it names none.
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "csv" => Some(Self::Csv),
            "mtx" => Some(Self::Mtx),
            "npy" => Some(Self::Npy),
            _ => None,
        }
    }
}

/// Writes a matrix in the format that the extension of `path` names.
///
/// # Errors
///
/// [`WriteError::Extension`] for another extension, [`WriteError::NotFinite`] for a value that is no number,
/// [`WriteError::File`] if the file cannot be written.
pub fn write_matrix(path: &Path, matrix: MatrixView<'_>) -> Result<(), WriteError> {
    match MatrixFormat::of(path) {
        Some(MatrixFormat::Csv) => csv::write(path, matrix),
        Some(MatrixFormat::Mtx) => mtx::write(path, matrix),
        Some(MatrixFormat::Npy) => npy::write(path, matrix),
        None => Err(WriteError::Extension { path: path.to_owned(), known: ".csv, .mtx or .npy" }),
    }
}

/// Reads a matrix in the format that the extension of `path` names.
///
/// # Errors
///
/// [`ReadError::Extension`] for another extension, [`ReadError::Matrix`] if the file holds no matrix,
/// [`ReadError::File`] if it cannot be read.
pub fn read_matrix(path: &Path) -> Result<Matrix, ReadError> {
    let unread = |source| ReadError::File { path: path.to_owned(), source };
    let parse = match MatrixFormat::of(path) {
        Some(MatrixFormat::Csv) => csv::parse,
        Some(MatrixFormat::Mtx) => mtx::parse,
        Some(MatrixFormat::Npy) => npy::parse,
        None => return Err(ReadError::Extension { path: path.to_owned(), known: ".csv, .mtx or .npy" }),
    };
    let file = File::open(path).map_err(unread)?;
    let about = file.metadata().map_err(unread)?;
    let read = if MatrixFormat::of(path) == Some(MatrixFormat::Npy) && about.is_file() {
        // As large as its values: not held twice.
        npy::read(BufReader::new(file), about.len())
    } else {
        parse(&std::fs::read(path).map_err(unread)?)
    };
    read.map_err(|MatrixError { line, what }| ReadError::Matrix { path: path.to_owned(), line, what })
}

/// Why bytes hold no matrix.
#[derive(Clone, Debug, PartialEq)]
pub struct MatrixError {
    /// Line, 0 where the format has none.
    pub line: usize,
    /// What is wrong, as part of a sentence.
    pub what: String,
}

impl MatrixError {
    pub(crate) fn new(line: usize, what: impl Into<String>) -> Self {
        Self { line, what: what.into() }
    }
}

/// A finite number.
pub(crate) fn number(word: &str, line: usize) -> Result<f64, MatrixError> {
    match word.trim().parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(MatrixError::new(line, format!("'{}' is no finite number", crate::error::shown(word)))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic::tests::Folder;

    #[test]
    fn every_format_gives_back_the_same_bits() {
        let folder = Folder::new("matrix");
        let values = vec![0.0, 0.1 + 0.2, 1e-300, 5e-324, 1.0 / 3.0, 0.0, 1.0, 0.19982489569838738, 0.0, 0.0, 0.0, 0.0];
        let matrix = Matrix { rows: 4, columns: 3, values };
        for name in ["F.csv", "F.mtx", "F.npy", "F.CSV"] {
            let path = folder.0.join(name);
            write_matrix(&path, matrix.view()).unwrap();
            assert_eq!(read_matrix(&path).unwrap(), matrix, "{name}");
            // Row by row the same bytes.
            let whole = std::fs::read(&path).unwrap();
            let fill = |i: usize, row: &mut [f64]| row.copy_from_slice(&matrix.values[3 * i..3 * i + 3]);
            write_matrix(&path, MatrixView::by_rows(4, 3, &fill)).unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), whole, "{name}");
        }
    }

    #[test]
    fn another_extension_is_refused_with_the_known_ones() {
        let error = write_matrix(Path::new("F.xlsx"), MatrixView::new(1, 1, &[0.5])).unwrap_err();
        assert!(error.to_string().contains("F.xlsx") && error.to_string().contains(".npy"), "{error}");
    }

    #[test]
    fn a_value_that_is_no_number_is_refused_before_anything_is_written() {
        let folder = Folder::new("matrix-nan");
        for name in ["F.csv", "F.mtx", "F.npy"] {
            let path = folder.file(name, "old");
            let error = write_matrix(&path, MatrixView::new(2, 2, &[0.0, 0.5, f64::NAN, 0.0])).unwrap_err();
            assert!(matches!(error, WriteError::NotFinite { row: 1, column: 0, .. }));
            assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
        }
    }

    /// Bytes of a small multiplicative generator: the point is that no input panics, not what it is.
    #[test]
    fn garbage_and_truncated_files_give_errors_not_panics() {
        let folder = Folder::new("matrix-garbage");
        let mut state = 1_u64;
        let mut refused = 0;
        for name in ["F.csv", "F.mtx", "F.npy"] {
            let path = folder.0.join(name);
            write_matrix(&path, MatrixView::new(2, 3, &[0.5, 0.0, 0.25, 1e-9, 0.0, 1.0])).unwrap();
            let whole = std::fs::read(&path).unwrap();
            let parse = [csv::parse, mtx::parse, npy::parse]
                [["F.csv", "F.mtx", "F.npy"].iter().position(|n| *n == name).unwrap()];
            for end in 0..whole.len() {
                refused += usize::from(parse(&whole[..end]).is_err());
            }
            for _ in 0..2000 {
                let mut bytes = whole.clone();
                for _ in 0..3 {
                    state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                    let at = (state >> 33) as usize % bytes.len();
                    bytes[at] = (state >> 20) as u8;
                }
                refused += usize::from(parse(&bytes).is_err());
            }
        }
        assert!(refused > 1000, "{refused} of the damaged files were refused");
    }
}
