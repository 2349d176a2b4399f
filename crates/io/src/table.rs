//! The table of a solution: one line an element or a cell of the report grid.

use std::io::Write;
use std::path::Path;

use glam::DVec3;

use crate::{WriteError, write_atomically};

/// The columns of the table, in order.
pub const SOLUTION_COLUMNS: [&str; 16] =
    ["surface", "i", "j", "x", "y", "z", "area", "E_r", "E_g", "E_b", "H_r", "H_g", "H_b", "B_r", "B_g", "B_b"];

/// One line of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolutionRow {
    /// Index of the face in the file, from 0.
    pub surface: u32,
    /// Cell along the first edge.
    pub i: u32,
    /// Cell along the last edge.
    pub j: u32,
    /// Centre of area, in the unit of the file.
    pub centroid: DVec3,
    /// Area, in the unit of the file squared.
    pub area: f64,
    /// Emission E in W/m², red, green and blue.
    pub emission: [f64; 3],
    /// Irradiance H in W/m².
    pub irradiance: [f64; 3],
    /// Radiosity B in W/m².
    pub radiosity: [f64; 3],
}

/// Writes rows as CSV with the header [`SOLUTION_COLUMNS`]; numbers are the shortest that read back to the same value.
///
/// # Errors
///
/// [`WriteError::File`] if the file cannot be written.
pub fn write_solution(path: &Path, rows: &[SolutionRow]) -> Result<(), WriteError> {
    write_atomically(path, |out| {
        writeln!(out, "{}", SOLUTION_COLUMNS.join(","))?;
        rows.iter().try_for_each(|row| write_row(out, row))
    })
}

fn write_row(out: &mut dyn Write, row: &SolutionRow) -> std::io::Result<()> {
    write!(out, "{},{},{}", row.surface, row.i, row.j)?;
    let place = row.centroid.to_array();
    let bands = row.emission.iter().chain(&row.irradiance).chain(&row.radiosity);
    for value in place.iter().chain([&row.area]).chain(bands) {
        write!(out, ",{value:?}")?;
    }
    writeln!(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic::tests::Folder;

    #[test]
    fn a_row_reads_back_to_the_same_bits() {
        let folder = Folder::new("table");
        let path = folder.0.join("out.csv");
        let row = SolutionRow {
            surface: 7,
            i: 1,
            j: 2,
            centroid: DVec3::new(0.1, -1e-300, 1e5 / 3.0),
            area: 0.1 + 0.2,
            emission: [std::f64::consts::PI * 15.0, 0.0, 1e-7],
            irradiance: [1.0 / 3.0, 2.0 / 3.0, 1e17],
            radiosity: [5e-324, 1.0, f64::MAX],
        };
        write_solution(&path, &[row]).unwrap();
        let mut reader = csv::Reader::from_path(&path).unwrap();
        assert_eq!(reader.headers().unwrap().iter().collect::<Vec<_>>(), SOLUTION_COLUMNS);
        let line = reader.records().next().unwrap().unwrap();
        let read: Vec<f64> = line.iter().map(|word| word.parse().unwrap()).collect();
        let expected = [
            &[7.0, 1.0, 2.0][..],
            &row.centroid.to_array(),
            &[row.area],
            &row.emission,
            &row.irradiance,
            &row.radiosity,
        ]
        .concat();
        assert_eq!(read, expected);
    }

    #[test]
    fn no_row_leaves_the_header() {
        let folder = Folder::new("table-empty");
        let path = folder.0.join("out.csv");
        write_solution(&path, &[]).unwrap();
        assert_eq!(
            std::fs::read_to_string(&path).unwrap(),
            "surface,i,j,x,y,z,area,E_r,E_g,E_b,H_r,H_g,H_b,B_r,B_g,B_b\n"
        );
    }
}
