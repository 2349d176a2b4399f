//! The JSON file beside a matrix file that says what the numbers are.

use std::path::{Path, PathBuf};

use radiosity_io::{WriteError, write_atomically};
use serde_json::Value;

use crate::Failure;

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

/// The object beside `matrix`; null if there is no such file.
pub fn read(matrix: &Path) -> Result<Value, Failure> {
    let path = path_beside(matrix);
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Value::Null),
        Err(error) => return Err(format!("{}: cannot be read ({error}); check the file", path.display()).into()),
    };
    match serde_json::from_str(&text) {
        Ok(object @ Value::Object(_)) => Ok(object),
        Ok(_) => {
            Err(format!("{}: it holds no JSON object; make the matrix again or remove this file", path.display())
                .into())
        }
        Err(error) => {
            Err(format!("{}: no JSON ({error}); make the matrix again or remove this file", path.display()).into())
        }
    }
}
