//! Statements of a View3D file, line by line.

use std::collections::HashMap;
use std::path::Path;

use glam::DVec3;

use super::words::{Words, lines};
use super::{Control, Role, View3dFault};
use crate::ReadError;
use crate::error::shown;

/// One `S`, `O` or `N` statement.
pub(super) struct RawSurface {
    pub line: usize,
    pub number: u64,
    pub role: Role,
    pub corners: Vec<DVec3>,
    /// Number of its base surface, 0 for none.
    pub base: u64,
    /// Number of the surface it is combined with, 0 for none.
    pub combine: u64,
    pub emittance: f64,
    pub name: String,
}

/// What a file says.
#[derive(Default)]
pub(super) struct Raw {
    pub title: String,
    pub control: Control,
    pub vertices: usize,
    pub surfaces: Vec<RawSurface>,
}

/// Corners of surfaces of format 3 name vertices that may come later; those of format 3a are given by coordinates.
enum Loop {
    Vertices([u64; 4]),
    Corners(Vec<DVec3>),
}

/// Reads the bytes of a file up to its end statement.
///
/// # Errors
///
/// [`ReadError::View3d`] at the first line that cannot be used.
pub(super) fn scan(path: &Path, bytes: &[u8]) -> Result<Raw, ReadError> {
    let lines = lines(bytes);
    let mut words = Words::new(path, &lines);
    let mut raw = Raw::default();
    let mut vertices: HashMap<u64, DVec3> = HashMap::new();
    let mut loops: Vec<Loop> = Vec::new();
    let mut shapes = false;
    while let Some(line) = words.next_line() {
        let word = &line.words[0];
        // As in View3D the first letter decides: `End of data`, `Title …`.
        match word.chars().next().map(|c| c.to_ascii_uppercase()) {
            Some('E' | '*') => break,
            Some('T') => raw.title.clone_from(&line.rest),
            Some('C') => raw.control.read(&line.rest).map_err(|fault| words.fault(fault))?,
            Some('F') => {
                let format = words.on_line().unwrap_or_default();
                shapes = match format.to_ascii_lowercase().as_str() {
                    "3" => false,
                    "3a" => true,
                    _ => return Err(words.fault(View3dFault::Format { word: shown(format) })),
                };
            }
            Some('V') => {
                let number = words.whole("vertex number")?;
                let mut vertex = DVec3::ZERO;
                for k in 0..3 {
                    vertex[k] = words.number_on_line("coordinate")?;
                }
                if vertices.insert(number, vertex).is_some() {
                    return Err(words.fault(View3dFault::Twice { what: "vertex", number }));
                }
            }
            Some(kind @ ('S' | 'O' | 'N')) if word.len() == 1 => {
                let role = match kind {
                    'S' => Role::Radiating,
                    'O' => Role::Obstruction,
                    _ => Role::Null,
                };
                // A letter where the first vertex belongs says what the format line should have said.
                let lettered = line.words.get(2).is_some_and(|word| word.starts_with(|c: char| c.is_alphabetic()));
                if lettered && !shapes {
                    raw.control.warnings.push(format!(
                        "{}:{}: the surfaces are shapes, so the file is read as format 3a",
                        path.display(),
                        line.number
                    ));
                    shapes = true;
                }
                let (surface, corners) = if shapes { shape(&mut words, role) } else { vertex_loop(&mut words, role) }?;
                raw.surfaces.push(surface);
                loops.push(corners);
            }
            Some('M') => {
                return Err(words.fault(View3dFault::Unsupported {
                    what: "masking surfaces",
                    instead: "leave the masked part out of the base surface",
                }));
            }
            Some('X') => {
                return Err(words.fault(View3dFault::Unsupported {
                    what: "coordinate transformations",
                    instead: "write the transformed coordinates",
                }));
            }
            _ => return Err(words.fault(View3dFault::Keyword { word: shown(word) })),
        }
    }
    raw.vertices = vertices.len();
    for (surface, corners) in raw.surfaces.iter_mut().zip(loops) {
        surface.corners = match corners {
            Loop::Corners(corners) => corners,
            Loop::Vertices(numbers) => {
                // 0 in the fourth place makes a triangle.
                let count = if numbers[3] == 0 { 3 } else { 4 };
                let vertex = |number: &u64| {
                    let fault = View3dFault::Undefined { what: "vertex", number: *number };
                    let error = || ReadError::View3d { path: path.to_owned(), line: surface.line, fault };
                    vertices.get(number).copied().ok_or_else(error)
                };
                numbers[..count].iter().map(vertex).collect::<Result<_, _>>()?
            }
        };
    }
    Ok(raw)
}

/// `S # v1 v2 v3 v4 base cmb emit name`; of an obstruction only the vertices count.
fn vertex_loop(words: &mut Words<'_>, role: Role) -> Result<(RawSurface, Loop), ReadError> {
    let (line, number) = (words.number(), words.whole("surface number")?);
    let mut numbers = [0; 4];
    for vertex in &mut numbers {
        *vertex = words.whole("vertex number")?;
    }
    let mut surface = RawSurface {
        line,
        number,
        role,
        corners: Vec::new(),
        base: 0,
        combine: 0,
        emittance: 1.0,
        name: String::new(),
    };
    if role == Role::Obstruction {
        let rest: Vec<&str> = std::iter::from_fn(|| words.on_line()).collect();
        // A name stands behind the three columns that mean nothing here, or where they are left out.
        surface.name = rest.get(3).or(rest.last()).copied().unwrap_or_default().to_owned();
    } else {
        columns(words, &mut surface)?;
    }
    Ok((surface, Loop::Vertices(numbers)))
}

/// `S # shape base cmb emit name`, then origin, azimuth, tilt and the sizes of the shape.
fn shape(words: &mut Words<'_>, role: Role) -> Result<(RawSurface, Loop), ReadError> {
    let (line, number) = (words.number(), words.whole("surface number")?);
    let letter = words.on_line().unwrap_or_default();
    let corners = match letter.to_ascii_uppercase().as_str() {
        "R" => 0,
        "T" => 3,
        "Q" => 4,
        _ => return Err(words.fault(View3dFault::Number { what: "shape (R, T or Q)", word: shown(letter) })),
    };
    let mut surface = RawSurface {
        line,
        number,
        role,
        corners: Vec::new(),
        base: 0,
        combine: 0,
        emittance: 1.0,
        name: String::new(),
    };
    if role == Role::Obstruction {
        while words.on_line().is_some() {}
    } else {
        columns(words, &mut surface)?;
        while words.on_line().is_some() {}
    }
    let mut origin = DVec3::ZERO;
    for k in 0..3 {
        origin[k] = words.number_anywhere("coordinate of the origin")?;
    }
    let (sin_a, cos_a) = sin_cos_degrees(words.number_anywhere("azimuth")?);
    let (sin_t, cos_t) = sin_cos_degrees(words.number_anywhere("tilt")?);
    // To the right and up, seen from the front.
    let (right, up) = (DVec3::new(-cos_a, sin_a, 0.0), DVec3::new(-sin_a * cos_t, -cos_a * cos_t, sin_t));
    let mut flat = Vec::new();
    if corners == 0 {
        let (width, height) = (words.number_anywhere("width")?, words.number_anywhere("height")?);
        flat.extend([(0.0, height), (0.0, 0.0), (width, 0.0), (width, height)]);
    }
    for _ in 0..corners {
        flat.push((words.number_anywhere("coordinate")?, words.number_anywhere("coordinate")?));
    }
    let loop_ = flat.into_iter().map(|(x, y)| origin + right * x + up * y).collect();
    Ok((surface, Loop::Corners(loop_)))
}

/// `base cmb emit name`.
fn columns(words: &mut Words<'_>, surface: &mut RawSurface) -> Result<(), ReadError> {
    surface.base = words.whole("number of the base surface")?;
    surface.combine = words.whole("number of the surface to combine with")?;
    surface.emittance = words.number_on_line("emittance")?;
    if !(0.0..=1.0).contains(&surface.emittance) {
        return Err(words.fault(View3dFault::Emittance { value: surface.emittance }));
    }
    surface.name = words.on_line().unwrap_or_default().to_owned();
    Ok(())
}

/// Sine and cosine, exact at right angles so that neighbours share their vertices to the last bit.
fn sin_cos_degrees(degrees: f64) -> (f64, f64) {
    match degrees.rem_euclid(360.0) {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        angle => angle.to_radians().sin_cos(),
    }
}
