//! NumPy's array format, version 1.0: little-endian doubles, C order.

use std::io::Read;
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
    read(bytes, bytes.len() as u64)
}

/// [`parse`] of what `input` gives, `length` bytes, of which no more than a piece is held beside the values.
pub(super) fn read(mut input: impl Read, length: u64) -> Result<Matrix, MatrixError> {
    let refuse = |what: &str| MatrixError::new(0, what);
    // Magic, version, length of the header (2 bytes in version 1, 4 in versions 2 and 3).
    let magic: [u8; 8] = take(&mut input).ok_or_else(|| refuse(NO_ARRAY))?;
    if !magic.starts_with(MAGIC) {
        return Err(refuse(NO_ARRAY));
    }
    let size = match magic[6] {
        1 => take::<2>(&mut input).map(|size| u64::from(u16::from_le_bytes(size))),
        2 | 3 => take::<4>(&mut input).map(|size| u64::from(u32::from_le_bytes(size))),
        _ => return Err(refuse("the version of the NumPy array is not 1, 2 or 3")),
    };
    let before = if magic[6] == 1 { 10 } else { 12 };
    let fits = size.filter(|size| before + size <= length);
    let size = fits.ok_or_else(|| refuse("the header is cut off"))?;
    let mut header = Vec::new();
    input.by_ref().take(size).read_to_end(&mut header).map_err(|_| refuse("the header is cut off"))?;
    let header = String::from_utf8_lossy(&header).replace([' ', '"'], "").replace('\'', "");
    if !header.contains("descr:<f8") {
        return Err(refuse("the array does not hold little-endian doubles ('<f8')"));
    }
    if !header.contains("fortran_order:False") {
        return Err(refuse("the array is not stored row after row (fortran_order must be False)"));
    }
    let (rows, columns) = shape(&header).ok_or_else(|| refuse("the array does not have one or two dimensions"))?;
    // The size must be what the bytes hold before anything of that size is made.
    let (data, needed) = (length - before - size, rows.checked_mul(columns).and_then(|n| n.checked_mul(8)));
    if needed.map(|needed| needed as u64) != Some(data) {
        return Err(MatrixError::new(0, format!("{rows} × {columns} doubles do not fit {data} bytes of data")));
    }
    let mut values = Vec::with_capacity(rows * columns);
    for k in 0..rows * columns {
        let value = take(&mut input).map(f64::from_le_bytes).ok_or_else(|| refuse("the data are cut off"))?;
        if !value.is_finite() {
            let (i, j) = (k / columns, k % columns);
            return Err(MatrixError::new(0, format!("the value in row {i}, column {j} is {value}")));
        }
        values.push(value);
    }
    Ok(Matrix { rows, columns, values })
}

const NO_ARRAY: &str = "the file does not begin as a NumPy array";

/// The next N bytes; `None` if there are not so many.
fn take<const N: usize>(input: &mut impl Read) -> Option<[u8; N]> {
    let mut bytes = [0; N];
    input.read_exact(&mut bytes).is_ok().then_some(bytes)
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
