//! NumPy's array format, version 1.0: little-endian doubles, C order.

use std::path::Path;

use super::{Matrix, MatrixError, MatrixView};
use crate::{WriteError, write_atomically};

const MAGIC: &[u8] = b"\x93NUMPY";

/// Writes a matrix.
///
/// # Errors
///
/// [`WriteError::NotFinite`] for a value that is no number, [`WriteError::File`] if the file cannot be written.
pub fn write(path: &Path, matrix: MatrixView<'_>) -> Result<(), WriteError> {
    matrix.check(path)?;
    let (rows, columns) = (matrix.rows(), matrix.columns());
    let mut header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({rows}, {columns}), }}");
    // Magic, version, length and header fill a multiple of 64 bytes, the header ends with a line feed.
    let unpadded = MAGIC.len() + 4 + header.len() + 1;
    header.extend(std::iter::repeat_n(' ', unpadded.next_multiple_of(64) - unpadded));
    header.push('\n');
    write_atomically(path, |out| {
        out.write_all(MAGIC)?;
        out.write_all(&[1, 0])?;
        out.write_all(&(header.len() as u16).to_le_bytes())?;
        out.write_all(header.as_bytes())?;
        matrix.try_for_each_row(|_, row| row.iter().try_for_each(|v| out.write_all(&v.to_le_bytes())))
    })
}

/// Reads a matrix from the bytes of a file; a one-dimensional array becomes one row.
///
/// # Errors
///
/// [`MatrixError`] if the bytes are no array of doubles in C order, hold a value that is no finite number, or end early.
pub fn parse(bytes: &[u8]) -> Result<Matrix, MatrixError> {
    let refuse = |what: &str| MatrixError::new(0, what);
    // Magic, version, length of the header (2 bytes in version 1, 4 in versions 2 and 3).
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| refuse("the file does not begin as a NumPy array"))?;
    let (length, rest) = match rest {
        [1, _, a, b, rest @ ..] => (usize::from(u16::from_le_bytes([*a, *b])), rest),
        [2 | 3, _, a, b, c, d, rest @ ..] => (u32::from_le_bytes([*a, *b, *c, *d]) as usize, rest),
        _ => return Err(refuse("the version of the NumPy array is not 1, 2 or 3")),
    };
    let (header, data) = rest.split_at_checked(length).ok_or_else(|| refuse("the header is cut off"))?;
    let header = String::from_utf8_lossy(header).replace([' ', '"'], "").replace('\'', "");
    if !header.contains("descr:<f8") {
        return Err(refuse("the array does not hold little-endian doubles ('<f8')"));
    }
    if !header.contains("fortran_order:False") {
        return Err(refuse("the array is not stored row after row (fortran_order must be False)"));
    }
    let (rows, columns) = shape(&header).ok_or_else(|| refuse("the array does not have one or two dimensions"))?;
    // The size must be what the bytes hold before anything of that size is made.
    let needed = rows.checked_mul(columns).and_then(|n| n.checked_mul(8));
    if needed != Some(data.len()) {
        return Err(MatrixError::new(0, format!("{rows} × {columns} doubles do not fit {} bytes of data", data.len())));
    }
    let (chunks, _) = data.as_chunks::<8>();
    let values: Vec<f64> = chunks.iter().map(|b| f64::from_le_bytes(*b)).collect();
    if let Some(k) = values.iter().position(|v| !v.is_finite()) {
        let (i, j) = (k / columns, k % columns);
        return Err(MatrixError::new(0, format!("the value in row {i}, column {j} is {}", values[k])));
    }
    Ok(Matrix { rows, columns, values })
}

/// Sizes from `shape:(3,4)` or `shape:(4,)`.
fn shape(header: &str) -> Option<(usize, usize)> {
    let (inside, _) = header.split_once("shape:(")?.1.split_once(')')?;
    let sizes: Option<Vec<usize>> = inside.split(',').filter(|w| !w.is_empty()).map(|w| w.parse().ok()).collect();
    match sizes?[..] {
        [columns] => Some((1, columns)),
        [rows, columns] => Some((rows, columns)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic::tests::Folder;

    /// The layout as NumPy's own documentation gives it, written out by hand.
    #[test]
    fn a_1_by_2_array_has_these_bytes() {
        let folder = Folder::new("npy");
        let path = folder.0.join("F.npy");
        write(&path, MatrixView::new(1, 2, &[0.5, 1.0])).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (1, 2), }";
        let mut expected = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
        expected.extend(format!("{header:<117}\n").as_bytes());
        expected.extend(0.5_f64.to_le_bytes());
        expected.extend(1.0_f64.to_le_bytes());
        assert_eq!(bytes.len(), 128 + 16);
        assert_eq!(bytes, expected);
    }

    #[test]
    fn single_precision_and_columns_first_are_refused() {
        let file = |descr: &str, order: &str, shape: &str| {
            let header = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}\n");
            [MAGIC, &[1, 0], &(header.len() as u16).to_le_bytes(), header.as_bytes(), &[0; 16]].concat()
        };
        assert_eq!(parse(&file("<f8", "False", "(2,)")).unwrap().values, [0.0, 0.0]);
        assert!(parse(&file("<f4", "False", "(2, 2)")).is_err());
        assert!(parse(&file("<f8", "True", "(2, 1)")).is_err());
        assert!(parse(&file("<f8", "False", "(2, 1, 1)")).is_err());
        assert!(parse(&file("<f8", "False", "(99999999999, 99999999999)")).is_err());
    }
}
