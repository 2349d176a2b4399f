//! Reading form factors back that were saved: the matrix and the JSON file beside it.

use std::path::Path;

use radiosity::{SavedCell, SavedFormFactors};
use radiosity_io::{MatrixFormat, read_matrix, read_view3d_factors};
use serde_json::Value;

use crate::form_factors::is_view3d;
use crate::{Failure, sidecar};

/// Relative error of areas that View3D writes with 6 digits, and error of its factors with 6 decimals.
const VIEW3D: (f64, f64) = (5e-6, 5e-7);

/// A matrix and what the file beside it says.
pub struct Saved {
    /// The matrix with its areas, cells and bounds.
    pub form_factors: SavedFormFactors,
    /// The file beside it; null if there is none.
    pub beside: Value,
}

impl Saved {
    /// The subdivision of the faces, if it is known.
    pub fn subdivide(&self) -> Option<u32> {
        self.beside["subdivide"].as_u64().and_then(|k| u32::try_from(k).ok()).filter(|k| *k > 0)
    }
}

/// Reads a matrix of form factors and the file beside it, if there is one.
pub fn read(path: &Path) -> Result<Saved, Failure> {
    if MatrixFormat::of(path).is_none() && !is_view3d(path) {
        return Err(format!("{}: a matrix file ends in .csv, .mtx, .npy, .vf or .txt", path.display()).into());
    }
    let beside = sidecar::read(path)?;
    let name = sidecar::path_beside(path);
    let fault = |what: String| -> Failure { format!("{}: {what}", name.display()).into() };
    let mut form_factors = SavedFormFactors::default();
    let matrix = if is_view3d(path) {
        let view = read_view3d_factors(path)?;
        form_factors.areas = Some(view.areas);
        form_factors.area_error = VIEW3D.0;
        if beside.is_null() {
            form_factors.bounds = Some(vec![VIEW3D.1; view.factors.rows]);
        }
        view.factors
    } else {
        read_matrix(path)?
    };
    (form_factors.rows, form_factors.columns, form_factors.values) = (matrix.rows, matrix.columns, matrix.values);
    if beside.is_null() {
        return Ok(Saved { form_factors, beside });
    }
    match beside["convention"].as_str() {
        Some("row = from") => {}
        other => {
            let found = other.map_or_else(|| "no convention".to_owned(), |words| format!("the convention '{words}'"));
            return Err(fault(format!("the file gives {found}; only a matrix with 'row = from' can be solved")));
        }
    }
    if let Some(areas) = numbers(&beside["areas"]).map_err(|what| fault(format!("areas: {what}")))? {
        form_factors.areas = Some(areas);
    }
    form_factors.cells = cells(&beside).map_err(fault)?;
    if let Some(bounds) = numbers(&beside["error_bound"]).map_err(|what| fault(format!("error_bound: {what}")))? {
        form_factors.bounds = Some(bounds);
    }
    let method = beside["method"]["name"].as_str();
    form_factors.row_wise = method.is_some_and(|name| name != "analytic") && beside["repair"].is_null();
    Ok(Saved { form_factors, beside })
}

/// A list of numbers that are finite and not negative; `None` if there is no list, or one of nothing known.
fn numbers(list: &Value) -> Result<Option<Vec<f64>>, String> {
    let Some(list) = list.as_array() else { return Ok(None) };
    if !list.is_empty() && list.iter().all(Value::is_null) {
        return Ok(None);
    }
    let number = |value: &Value| {
        value.as_f64().filter(|v| *v >= 0.0).ok_or_else(|| format!("{value} is no number of at least 0; correct it"))
    };
    list.iter().map(number).collect::<Result<_, _>>().map(Some)
}

/// What rows stand for, if the file says so.
fn cells(beside: &Value) -> Result<Option<Vec<SavedCell>>, String> {
    let Some(surfaces) = beside["surfaces"].as_array() else { return Ok(None) };
    let small = |value: &Value| value.as_u64().and_then(|k| u32::try_from(k).ok());
    let cell = |(k, surface): (usize, &Value)| {
        let surface = small(surface).ok_or_else(|| format!("surfaces: {surface} is no index of a face; correct it"))?;
        let cell = match beside["cells"].get(k) {
            None => None,
            Some(pair) => match (small(&pair[0]), small(&pair[1])) {
                (Some(i), Some(j)) => Some([i, j]),
                _ => return Err(format!("cells: {pair} is no cell [i, j]; correct it")),
            },
        };
        Ok(SavedCell { surface, cell })
    };
    surfaces.iter().enumerate().map(cell).collect::<Result<_, _>>().map(Some)
}
