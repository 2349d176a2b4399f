//! Errors of readers and writers: one sentence that names file and line, and what to do.

use std::io;
use std::path::PathBuf;

use crate::stl::StlFault;
use crate::view3d::View3dFault;

/// A piece of a file, cut to a length that fits a message and without control characters.
pub(crate) fn shown(text: &str) -> String {
    const LONGEST: usize = 40;
    let mut cut: String = text.chars().map(|c| if c.is_control() { '\u{fffd}' } else { c }).take(LONGEST).collect();
    if text.chars().nth(LONGEST).is_some() {
        cut.push('…');
    }
    cut
}

/// The material of a face that is nowhere defined, as a message shows it.
fn missing(material: &str) -> String {
    if material.is_empty() { "no material".into() } else { format!("material '{material}', which is not defined") }
}

/// Where materials were looked for, as a message shows it.
fn searched(not_found: &[String]) -> String {
    if not_found.is_empty() { String::new() } else { format!(" (not found: {})", not_found.join(", ")) }
}

/// A file that cannot be used as it is.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The file cannot be opened or read.
    #[error("{}: cannot be read ({source}); check the path", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Bytes that are no picture of the kind that the file's name says.
    #[error("{}: is no picture that can be read ({fault}); give an OpenEXR file with red, green and blue", path.display())]
    Picture {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        fault: String,
    },
    /// A word where a coordinate belongs.
    #[error("{}:{line}: '{word}' is no coordinate (a finite number); correct this vertex", path.display())]
    Coordinate {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// The word found.
        word: String,
    },
    /// A vertex with fewer than three coordinates.
    #[error("{}:{line}: the vertex has {count} coordinates; give it three", path.display())]
    FewCoordinates {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// Coordinates found.
        count: usize,
    },
    /// A word where the corner of a face belongs.
    #[error(
        "{}:{line}: '{word}' is no corner of a face; write n, n/n, n//n or n/n/n with whole numbers other than 0",
        path.display()
    )]
    Corner {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// The word found.
        word: String,
    },
    /// A face that names a vertex which is not there.
    #[error(
        "{}:{line}: the face names vertex {index}, but there are only {vertices} vertices to count from; correct the index",
        path.display()
    )]
    Index {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// The index as written.
        index: i64,
        /// Vertices the index counts from: all, or those above the line if it is negative.
        vertices: usize,
    },
    /// Nothing to work on.
    #[error("{}: none of its {faces} faces has an area{}; give the scene at least one face",
        path.display(), first_line.filter(|line| *line > 0).map_or(String::new(), |line| format!(" (the first is on line {line})")))]
    Empty {
        /// The file.
        path: PathBuf,
        /// Faces read.
        faces: usize,
        /// Line of the first face, if there is one.
        first_line: Option<usize>,
    },
    /// A face whose material is not defined anywhere.
    #[error(
        "{}:{line}: face {face} has {}{}; add it to the material library or give --default-reflectance 0.5",
        path.display(), missing(material), searched(not_found)
    )]
    MissingMaterial {
        /// The file.
        path: PathBuf,
        /// Line of the face.
        line: usize,
        /// Index of the face, from 0.
        face: usize,
        /// Name of the material, empty if the face has none.
        material: String,
        /// Material libraries named by the file but not found.
        not_found: Vec<String>,
    },
    /// A colour that cannot be read as numbers.
    #[error(
        "{}:{line}: {key} '{words}' of material '{material}' is no colour; give one or three numbers",
        path.display()
    )]
    Colour {
        /// The material library.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// Name of the material.
        material: String,
        /// `Kd`, `Ks` or `Ke`.
        key: String,
        /// What stands there.
        words: String,
    },
    /// A colour that is negative or not finite.
    #[error(
        "{}:{line}: {key} of material '{material}' is {value}; it must be finite and not negative, correct it",
        path.display()
    )]
    ColourRange {
        /// The material library.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// Name of the material.
        material: String,
        /// `Kd`, `Ks` or `Ke`.
        key: String,
        /// The value found.
        value: f64,
    },
    /// ρ ≥ 1: light in an enclosure of it would never settle.
    #[error(
        "{}:{line}: Kd of material '{material}' is {value}; it must be below 1, correct it or give --clamp-reflectance 0.95",
        path.display()
    )]
    Reflectance {
        /// The material library.
        path: PathBuf,
        /// Line of `Kd`.
        line: usize,
        /// Name of the material.
        material: String,
        /// Largest component.
        value: f64,
    },
    /// Kd + Ks > 1: the material would reflect more than it receives.
    #[error(
        "{}:{line}: Kd + Ks of material '{material}' is {value}; it must not exceed 1, correct it or give --clamp-reflectance 0.95",
        path.display()
    )]
    ReflectanceSum {
        /// The material library.
        path: PathBuf,
        /// Line of `Ks`.
        line: usize,
        /// Name of the material.
        material: String,
        /// Largest sum of components.
        value: f64,
    },
    /// An option of the reader that is out of range.
    #[error("{option} is {value}; it must lie in [0, 1)")]
    Setting {
        /// Name of the option on the command line.
        option: &'static str,
        /// The value given.
        value: f64,
    },
    /// A file name that tells no format.
    #[error("{}: the format is not known; name the file {known}", path.display())]
    Extension {
        /// The file.
        path: PathBuf,
        /// Extensions that are.
        known: &'static str,
    },
    /// A statement of a View3D file that cannot be used.
    #[error("{}:{line}: {fault}", path.display())]
    View3d {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// What is wrong.
        fault: View3dFault,
    },
    /// A file that holds no STL triangles.
    #[error("{}{}: {fault}", path.display(), if *line == 0 { String::new() } else { format!(":{line}") })]
    Stl {
        /// The file.
        path: PathBuf,
        /// Its line, from 1; 0 for binary files.
        line: usize,
        /// What is wrong.
        fault: StlFault,
    },
    /// A matrix file that holds no matrix.
    #[error("{}{}: {what}; correct or make the file again", path.display(), if *line == 0 { String::new() } else { format!(":{line}") })]
    Matrix {
        /// The file.
        path: PathBuf,
        /// Its line, from 1; 0 where there is none to name.
        line: usize,
        /// What is wrong.
        what: String,
    },
}

/// A file that could not be written; whatever was there before is unchanged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// The file cannot be made, filled or renamed.
    #[error("{}: cannot be written ({source}); check that the folder exists and has room", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A matrix entry that is no number.
    #[error("{}: the entry in row {row}, column {column} is {value}; nothing was written", path.display())]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// Row, from 0.
        row: usize,
        /// Column, from 0.
        column: usize,
        /// The value.
        value: f64,
    },
    /// A file name that tells no format.
    #[error("{}: the format is not known; name the file {known}", path.display())]
    Extension {
        /// The file.
        path: PathBuf,
        /// Extensions that are.
        known: &'static str,
    },
    /// A picture without pixels.
    #[error("{}: a picture of {width} × {height} pixels cannot be written; ask for at least one pixel", path.display())]
    Picture {
        /// The file.
        path: PathBuf,
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// More than the format can count.
    #[error("{}: {count} {what} are more than the format can hold; use a coarser mesh", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// What there is too much of.
        what: &'static str,
        /// How much of it.
        count: usize,
    },
}
