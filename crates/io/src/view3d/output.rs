//! View3D's text layout of form factors.

use std::io::Write;
use std::path::Path;

use crate::{MatrixView, WriteError, write_atomically};

/// Columns of the header line: readers of the layout skip that many.
const HEADER: usize = 30;

/// Form factors with what View3D writes beside them.
#[derive(Clone, Copy, Debug, PartialEq)]
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
        (0..n).try_for_each(|i| line(out, view.factors.row(i)))?;
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
    }
}
