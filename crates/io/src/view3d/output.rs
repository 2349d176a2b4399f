//! View3D's text layout of form factors, written and read.

use std::io::Write;
use std::path::Path;

use crate::matrix::{MatrixError, number};
use crate::{Matrix, MatrixView, ReadError, WriteError, write_atomically};

/// Columns of the header line: readers of the layout skip that many.
const HEADER: usize = 30;

/// Form factors with what View3D writes beside them.
#[derive(Clone, Copy, Debug)]
pub struct View3dFactors<'a> {
    /// Area of every row.
    pub areas: &'a [f64],
    /// Emittance of every row.
    pub emittances: &'a [f64],
    /// Whether the surfaces bound an enclosure (`encl`).
    pub enclosure: bool,
    /// F_ij, row = from.
    pub factors: MatrixView<'a>,
}

/// Writes form factors in View3D's text layout.
///
/// ```text
/// View3D 3.3 0 encl 0 n         header: version, text output, encl, plain factors (emit = 0), number of rows
/// A_1 … A_n                     areas
/// F_11 … F_1n                   n rows, row = from
/// …
/// ε_1 … ε_n                     emittances
/// ```
///
/// View3D rounds areas to 6 digits, factors to 6 decimals and emittances to 3; here every number is the shortest decimal that
/// reads back to the same bits.
///
/// # Errors
///
/// [`WriteError::NotFinite`] for a value that is no number, [`WriteError::File`] if the file cannot be written.
///
/// # Panics
///
/// If areas, emittances, rows and columns differ in number.
pub fn write_view3d(path: &Path, view: &View3dFactors<'_>) -> Result<(), WriteError> {
    let n = view.factors.rows();
    let sizes = (view.areas.len(), view.emittances.len(), view.factors.columns());
    assert_eq!(sizes, (n, n, n), "areas, emittances and columns of {n} rows");
    view.factors.check(path)?;
    write_atomically(path, |out| {
        writeln!(out, "{:<HEADER$}", format!("View3D 3.3 0 {} 0 {n}", u8::from(view.enclosure)))?;
        line(out, view.areas)?;
        view.factors.try_for_each_row(|_, row| line(out, row))?;
        line(out, view.emittances)
    })
}

fn line(out: &mut dyn Write, values: &[f64]) -> std::io::Result<()> {
    for (k, value) in values.iter().enumerate() {
        let blank = if k == 0 { "" } else { " " };
        if value.to_bits() == 0 { write!(out, "{blank}0") } else { write!(out, "{blank}{value:?}") }?;
    }
    writeln!(out)
}

/// Form factors read from View3D's text layout.
#[derive(Clone, Debug, PartialEq)]
pub struct SavedView3d {
    /// Area of every row.
    pub areas: Vec<f64>,
    /// F_ij, row = from.
    pub factors: Matrix,
}

/// Reads form factors in View3D's text layout: see [`write_view3d`].
///
/// # Errors
///
/// [`ReadError::Matrix`] if the header is another one, the file holds total interchange factors (emit = 1), a number is missing or none;
/// [`ReadError::File`] if it cannot be read.
pub fn read_view3d_factors(path: &Path) -> Result<SavedView3d, ReadError> {
    let bytes = std::fs::read(path).map_err(|source| ReadError::File { path: path.to_owned(), source })?;
    parse(&String::from_utf8_lossy(&bytes)).map_err(|MatrixError { line, what }| ReadError::Matrix {
        path: path.to_owned(),
        line,
        what,
    })
}

fn parse(text: &str) -> Result<SavedView3d, MatrixError> {
    let header: Vec<&str> = text.lines().next().unwrap_or_default().split_whitespace().collect();
    let ["View3D", _, "0", _, emit, n] = header[..] else {
        return Err(MatrixError::new(
            1,
            "the first line must be 'View3D', version, 0 (text), encl, emit and the number of rows",
        ));
    };
    if emit != "0" {
        return Err(MatrixError::new(1, "the factors include reflections (emit = 1); write plain ones with emit = 0"));
    }
    let n: usize =
        n.parse().map_err(|_| MatrixError::new(1, format!("'{}' is no number of rows", crate::error::shown(n))))?;
    // Numbers may be broken into lines at will; the emittances behind the factors say nothing here.
    let words = text.lines().enumerate().skip(1).flat_map(|(k, line)| line.split_whitespace().map(move |w| (k + 1, w)));
    let needed = n.checked_mul(n).and_then(|nn| nn.checked_add(n)).unwrap_or(usize::MAX);
    let mut values: Vec<f64> = words.take(needed).map(|(line, word)| number(word, line)).collect::<Result<_, _>>()?;
    if values.len() != needed {
        let what = format!("{} areas and factors where {n} rows need {needed}", values.len());
        return Err(MatrixError::new(0, what));
    }
    let factors = values.split_off(n);
    Ok(SavedView3d { areas: values, factors: Matrix { rows: n, columns: n, values: factors } })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic::tests::Folder;

    #[test]
    fn header_areas_rows_and_emittances_stand_in_this_order() {
        let folder = Folder::new("view3d-output");
        let path = folder.0.join("F.vf");
        let factors = MatrixView::new(2, 2, &[0.0, 0.25, 0.5, 0.0]);
        let view = View3dFactors { areas: &[2.0, 1.0], emittances: &[0.9, 1.0], enclosure: true, factors };
        write_view3d(&path, &view).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(text, "View3D 3.3 0 1 0 2            \n2.0 1.0\n0 0.25\n0.5 0\n0.9 1.0\n");
        let saved = read_view3d_factors(&path).unwrap();
        assert_eq!((saved.areas, saved.factors.values), (vec![2.0, 1.0], vec![0.0, 0.25, 0.5, 0.0]));
    }

    #[test]
    fn what_is_no_plain_matrix_is_refused_with_its_line() {
        let refused = |text: &str| parse(text).unwrap_err();
        assert_eq!(refused("1 2 3\n").line, 1);
        assert!(refused("View3D 3.3 0 1 1 2\n1 1\n0 1\n1 0\n").what.contains("emit"));
        assert_eq!(refused("View3D 3.3 0 1 0 x\n").line, 1);
        assert_eq!(refused("View3D 3.3 0 1 0 2\n1 1\n0 nan\n1 0\n").line, 3);
        assert!(refused("View3D 3.3 0 1 0 2\n1 1\n0 1\n1\n").what.contains("5 areas and factors where 2 rows need 6"));
        assert!(refused("View3D 3.3 0 1 0 99999999999\n1 1\n").what.contains("2 areas"));
    }
}
