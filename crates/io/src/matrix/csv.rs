//! Comma-separated values: one line a row, no header, shortest decimal that reads back to the same bits.

use std::io::Write;
use std::path::Path;

use super::{Matrix, MatrixError, MatrixView, number};
use crate::{WriteError, write_atomically};

/// Writes a matrix.
///
/// # Errors
///
/// [`WriteError::NotFinite`] for a value that is no number, [`WriteError::File`] if the file cannot be written.
pub fn write(path: &Path, matrix: MatrixView<'_>) -> Result<(), WriteError> {
    matrix.check(path)?;
    write_atomically(path, |out| matrix.try_for_each_row(|_, row| write_row(out, row)))
}

fn write_row(out: &mut dyn Write, row: &[f64]) -> std::io::Result<()> {
    for (j, value) in row.iter().enumerate() {
        // Exact zeros are most of an occluded matrix; one byte instead of three.
        let comma = if j == 0 { "" } else { "," };
        if value.to_bits() == 0 { write!(out, "{comma}0") } else { write!(out, "{comma}{value:?}") }?;
    }
    writeln!(out)
}

/// Reads a matrix from the bytes of a file; empty lines are skipped.
///
/// # Errors
///
/// [`MatrixError`] at a word that is no finite number, a line of another length, or in an empty file.
pub fn parse(bytes: &[u8]) -> Result<Matrix, MatrixError> {
    let text = String::from_utf8_lossy(bytes);
    let (mut columns, mut rows, mut values) = (0, 0, Vec::new());
    for (k, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let before = values.len();
        for word in line.split(',') {
            values.push(number(word, k + 1)?);
        }
        let count = values.len() - before;
        if rows == 0 {
            columns = count;
        } else if count != columns {
            return Err(MatrixError::new(k + 1, format!("{count} values where the first line has {columns}")));
        }
        rows += 1;
    }
    if rows == 0 {
        return Err(MatrixError::new(0, "there is no line of values"));
    }
    Ok(Matrix { rows, columns, values })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_is_refused_with_its_line() {
        let error = parse(b"a,b\n1,2\n").unwrap_err();
        assert_eq!((error.line, error.what.as_str()), (1, "'a' is no finite number"));
    }

    #[test]
    fn a_short_line_is_refused_with_its_line() {
        assert_eq!(parse(b"1,2\r\n\r\n3\r\n").unwrap_err().line, 3);
    }
}
