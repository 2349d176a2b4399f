//! The JSON file beside a matrix file that says what the numbers are.

use std::path::{Path, PathBuf};

use radiosity_io::{WriteError, write_atomically};
use serde_json::Value;

/// `F.csv.json` for `F.csv`.
pub fn path_beside(matrix: &Path) -> PathBuf {
    let mut name = matrix.as_os_str().to_owned();
    name.push(".json");
    name.into()
}

/// Writes `object` beside `matrix`, one line a key, and gives its path.
pub fn write(matrix: &Path, object: &Value) -> Result<PathBuf, WriteError> {
    let path = path_beside(matrix);
    let empty = serde_json::Map::new();
    let fields = object.as_object().unwrap_or(&empty);
    let lines: Vec<String> =
        fields.iter().map(|(key, value)| format!("  {}: {value}", Value::from(key.as_str()))).collect();
    write_atomically(&path, |out| writeln!(out, "{{\n{}\n}}", lines.join(",\n")))?;
    Ok(path)
}
