//! MatrixMarket, `matrix coordinate real general`: the entries that are not zero, counted from 1.

use std::io::Write;
use std::path::Path;

use super::{Matrix, MatrixError, MatrixView, number};
use crate::{WriteError, write_atomically};

const BANNER: &str = "%%MatrixMarket matrix coordinate real general";

/// Largest dense matrix that is made from a file's own claim of its size, in values (8 GiB).
const LARGEST: usize = 1 << 30;

/// Writes the entries that are not zero, row after row.
///
/// # Errors
///
/// [`WriteError::NotFinite`] for a value that is no number, [`WriteError::File`] if the file cannot be written.
pub fn write(path: &Path, matrix: MatrixView<'_>) -> Result<(), WriteError> {
    matrix.check(path)?;
    let mut entries = 0;
    matrix.try_for_each_row(|_, row| {
        entries += row.iter().filter(|v| **v != 0.0).count();
        Ok::<(), WriteError>(())
    })?;
    write_atomically(path, |out| {
        writeln!(out, "{BANNER}")?;
        writeln!(out, "% entry (i, j): fraction of the power leaving i that arrives directly at j")?;
        writeln!(out, "{} {} {entries}", matrix.rows(), matrix.columns())?;
        matrix.try_for_each_row(|i, row| write_row(out, i, row))
    })
}

fn write_row(out: &mut dyn Write, i: usize, row: &[f64]) -> std::io::Result<()> {
    let filled = row.iter().enumerate().filter(|(_, v)| **v != 0.0);
    filled.into_iter().try_for_each(|(j, value)| writeln!(out, "{} {} {value:?}", i + 1, j + 1))
}

/// Reads a matrix from the bytes of a file into dense form; entries that are not listed are 0.
///
/// # Errors
///
/// [`MatrixError`] for another kind of MatrixMarket file, an index out of range, an entry given twice, a word that is
/// no finite number, or another number of entries than announced.
pub fn parse(bytes: &[u8]) -> Result<Matrix, MatrixError> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = text.lines().enumerate().map(|(k, line)| (k + 1, line.trim()));
    let banner = lines.next().map_or("", |(_, line)| line);
    if !banner.split_whitespace().map(str::to_ascii_lowercase).eq(BANNER.to_ascii_lowercase().split_whitespace()) {
        return Err(MatrixError::new(1, format!("the first line must be '{BANNER}'")));
    }
    let mut lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('%'));
    // The size line, then the entries.
    let (line, size) = lines.next().ok_or_else(|| MatrixError::new(1, "the line of sizes is missing"))?;
    let [rows, columns, entries] = words(size, line)?;
    let [rows, columns, entries] = [count(rows, line)?, count(columns, line)?, count(entries, line)?];
    let cells = rows.checked_mul(columns).filter(|cells| *cells <= LARGEST && entries <= *cells);
    let cells = cells.ok_or_else(|| {
        MatrixError::new(line, format!("{rows} × {columns} with {entries} entries is not a size that can be read"))
    })?;
    let mut values = vec![0.0; cells];
    let mut read = 0;
    for (line, entry) in lines {
        let [i, j, value] = words(entry, line)?;
        let (i, j, value) = (count(i, line)?, count(j, line)?, number(value, line)?);
        if !(1..=rows).contains(&i) || !(1..=columns).contains(&j) {
            return Err(MatrixError::new(line, format!("({i}, {j}) lies outside of {rows} × {columns}")));
        }
        let cell = &mut values[(i - 1) * columns + j - 1];
        if *cell != 0.0 {
            return Err(MatrixError::new(line, format!("entry ({i}, {j}) is given twice")));
        }
        *cell = value;
        read += 1;
    }
    if read != entries {
        return Err(MatrixError::new(line, format!("{entries} entries are announced, but there are {read}")));
    }
    Ok(Matrix { rows, columns, values })
}

fn words(text: &str, line: usize) -> Result<[&str; 3], MatrixError> {
    let words: Vec<&str> = text.split_whitespace().take(4).collect();
    words.try_into().map_err(|words: Vec<&str>| MatrixError::new(line, format!("{} words where 3 belong", words.len())))
}

fn count(word: &str, line: usize) -> Result<usize, MatrixError> {
    word.parse().map_err(|_| MatrixError::new(line, format!("'{}' is no count", crate::error::shown(word))))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(body: &str) -> Vec<u8> {
        format!("%%matrixmarket MATRIX coordinate real general\n% note\n{body}").into_bytes()
    }

    #[test]
    fn entries_count_from_1_and_the_rest_is_0() {
        let matrix = parse(&file("2 3 2\n1 3 0.5\n2 1 1e-9\n")).unwrap();
        assert_eq!(matrix, Matrix { rows: 2, columns: 3, values: vec![0.0, 0.0, 0.5, 1e-9, 0.0, 0.0] });
    }

    #[test]
    fn wrong_entries_are_refused_with_their_line() {
        for (body, line) in
            [("2 3 1\n3 1 1\n", 4), ("2 3 1\n0 1 1\n", 4), ("2 3 2\n1 1 1\n1 1 1\n", 5), ("2 3 1\n1 1\n", 4)]
        {
            assert_eq!(parse(&file(body)).unwrap_err().line, line, "{body}");
        }
        assert!(parse(&file("2 3 2\n1 1 1\n")).unwrap_err().what.contains("announced"));
        assert!(parse(&file("99999999999 99999999999 1\n")).is_err());
    }
}
