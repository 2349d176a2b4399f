//! Scenes from STL files, binary and text.
//!
//! Every triangle is one surface, in file order: surface k is triangle k. A triangle without an area, and one that repeats an
//! earlier triangle the same way round, is dropped by leaving its list of pieces empty, so that it keeps its index. The order of the
//! vertices says which side is the front; stored normals are not read, since many writers leave them 0 or wrong. Triangles of a text
//! file are named after their `solid`; binary files have no names. STL has no materials.
//!
//! Which of the two a file is follows from its content: a binary file has 84 + 50 n bytes with n its count of triangles. The word
//! `solid` alone says nothing, since many binary files begin with it.

use std::path::Path;

use glam::DVec3;

use crate::ReadError;
use crate::error::shown;
use crate::obj::assemble::assemble;
use crate::obj::library::Library;
use crate::obj::scan::{Raw, RawFace};
use crate::obj::{ImportReport, Imported, LARGEST, ReadOptions};

/// Bytes before the first triangle of a binary file: a free text of 80 bytes and the count.
const HEADER: usize = 84;
/// Bytes of a triangle of a binary file: normal and corners in single precision, and two spare bytes.
const TRIANGLE: usize = 50;

/// Why a file holds no STL triangles.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StlFault {
    /// Neither a binary nor a text file.
    #[error("neither binary STL (84 bytes and 50 a triangle) nor text that begins with 'solid'; export the file again")]
    Unknown,
    /// A binary file of another length than it says.
    #[error("the file announces {announced} triangles, which take {needs} bytes, but has {has}; export it again")]
    Length {
        /// Triangles announced.
        announced: u64,
        /// Bytes these take.
        needs: u64,
        /// Bytes there are.
        has: u64,
    },
    /// A coordinate that is no finite number.
    #[error("a corner of triangle {triangle} is no point: {value}; correct it or export the file again")]
    Coordinate {
        /// Index of the triangle, from 0.
        triangle: usize,
        /// What was read.
        value: String,
    },
    /// A facet of a text file with another number of vertices.
    #[error("the facet has {count} vertices; give it three")]
    Corners {
        /// Vertices found.
        count: usize,
    },
    /// A word that begins no line of a text file.
    #[error("'{word}' begins no line of an STL file; correct it")]
    Keyword {
        /// The word found.
        word: String,
    },
    /// A text file that ends inside a facet.
    #[error("the file ends inside a facet; export it again")]
    Truncated,
}

/// Reads an STL file; all faces take [`ReadOptions::default_reflectance`].
///
/// # Errors
///
/// [`ReadError`] if the file cannot be read, holds no STL triangles or none with an area, or no default reflectance is given.
pub fn read_stl(path: &Path, options: &ReadOptions) -> Result<Imported, ReadError> {
    let raw = scan(path, &crate::obj::read(path)?)?;
    assemble(path, raw, Some((&Library::default(), options)), ImportReport::default())
}

/// Reads an STL file and gives all triangles one black material: form factors need no other.
///
/// # Errors
///
/// [`ReadError`] if the file cannot be read, or holds no STL triangles or none with an area.
pub fn read_stl_geometry(path: &Path) -> Result<Imported, ReadError> {
    let raw = scan(path, &crate::obj::read(path)?)?;
    assemble(path, raw, None, ImportReport::default())
}

/// A triangle as it stands in the file.
struct Triangle {
    line: usize,
    name: String,
    corners: [DVec3; 3],
}

fn scan(path: &Path, bytes: &[u8]) -> Result<Raw, ReadError> {
    let fail = |(line, fault)| ReadError::Stl { path: path.to_owned(), line, fault };
    let triangles = triangles(bytes).map_err(fail)?;
    let mut raw = Raw::default();
    for triangle in triangles {
        let first = raw.vertices.len();
        raw.vertices.extend(triangle.corners);
        let corners = (first..first + 3).collect();
        raw.faces.push(RawFace { line: triangle.line, corners, material: String::new(), group: triangle.name });
    }
    Ok(raw)
}

/// Triangles announced by a binary file, if the bytes are long enough for one.
fn announced(bytes: &[u8]) -> Option<u64> {
    let count = bytes.get(HEADER - 4..HEADER)?;
    Some(u64::from(u32::from_le_bytes(count.try_into().ok()?)))
}

fn triangles(bytes: &[u8]) -> Result<Vec<Triangle>, (usize, StlFault)> {
    let has = bytes.len() as u64;
    let length = |count: u64| HEADER as u64 + TRIANGLE as u64 * count;
    let announced = announced(bytes);
    if announced.is_some_and(|count| length(count) == has) {
        return binary(bytes).map_err(|fault| (0, fault));
    }
    // Text holds no zero bytes, and the header of a binary file is padded with something and followed by numbers that do.
    let text = !bytes.contains(&0);
    let solid = bytes.trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    match announced {
        _ if text && solid => self::text(&String::from_utf8_lossy(bytes)),
        Some(count) if !text => Err((0, StlFault::Length { announced: count, needs: length(count), has })),
        _ => Err((0, StlFault::Unknown)),
    }
}

fn binary(bytes: &[u8]) -> Result<Vec<Triangle>, StlFault> {
    let single = |at: &[u8]| f32::from_le_bytes([at[0], at[1], at[2], at[3]]);
    let triangle = |(k, record): (usize, &[u8])| {
        // Twelve bytes of normal, then the corners.
        let corner = |c: usize| {
            let at = |axis: usize| single(&record[12 + 12 * c + 4 * axis..]);
            DVec3::new(at(0).into(), at(1).into(), at(2).into())
        };
        let corners = [corner(0), corner(1), corner(2)];
        match corners.iter().find(|v| !v.is_finite()) {
            Some(v) => Err(StlFault::Coordinate { triangle: k, value: v.to_string() }),
            None => Ok(Triangle { line: 0, name: String::new(), corners }),
        }
    };
    bytes[HEADER..].chunks_exact(TRIANGLE).enumerate().map(triangle).collect()
}

fn text(text: &str) -> Result<Vec<Triangle>, (usize, StlFault)> {
    let (mut triangles, mut name) = (Vec::new(), String::new());
    // Line and corners of the facet being read.
    let mut facet: Option<(usize, Vec<DVec3>)> = None;
    // Line feeds end lines where there are any; carriage returns beside them are blanks.
    let end = if text.contains('\n') { '\n' } else { '\r' };
    for (number, line) in (1..).zip(text.split(end)) {
        let mut words = line.split_whitespace();
        let Some(key) = words.next() else { continue };
        match key.to_ascii_lowercase().as_str() {
            "solid" => name = words.collect::<Vec<_>>().join(" "),
            "facet" => facet = Some((number, Vec::new())),
            "vertex" => {
                let index = triangles.len();
                let wrong = |value: &str| (number, StlFault::Coordinate { triangle: index, value: shown(value) });
                let mut corner = DVec3::ZERO;
                for axis in 0..3 {
                    let word = words.next().ok_or_else(|| wrong(line.trim()))?;
                    let number = word.parse().ok().filter(|x: &f64| x.abs() <= LARGEST);
                    corner[axis] = number.ok_or_else(|| wrong(word))?;
                }
                let (_, corners) =
                    facet.as_mut().ok_or_else(|| (number, StlFault::Keyword { word: key.to_owned() }))?;
                corners.push(corner);
            }
            "endfacet" => {
                let (line, corners) =
                    facet.take().ok_or_else(|| (number, StlFault::Keyword { word: key.to_owned() }))?;
                let count = corners.len();
                let corners = corners.try_into().map_err(|_| (line, StlFault::Corners { count }))?;
                triangles.push(Triangle { line, name: name.clone(), corners });
            }
            "outer" | "endloop" | "endsolid" => {}
            _ => return Err((number, StlFault::Keyword { word: shown(key) })),
        }
    }
    match facet {
        Some((line, _)) => Err((line, StlFault::Truncated)),
        None => Ok(triangles),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic::tests::Folder;

    /// A tetrahedron with legs 1, 2 and 3, faces outwards, and a triangle without an area after its first face.
    const CORNERS: [[[f32; 3]; 3]; 5] = [
        [[0., 0., 0.], [0., 2., 0.], [1., 0., 0.]],
        [[0., 0., 0.], [1., 0., 0.], [1., 0., 0.]],
        [[0., 0., 0.], [1., 0., 0.], [0., 0., 3.]],
        [[0., 0., 0.], [0., 0., 3.], [0., 2., 0.]],
        [[1., 0., 0.], [0., 2., 0.], [0., 0., 3.]],
    ];

    fn binary_file(header: &str) -> Vec<u8> {
        let mut bytes = vec![b' '; 80];
        bytes[..header.len()].copy_from_slice(header.as_bytes());
        bytes.extend((CORNERS.len() as u32).to_le_bytes());
        for triangle in CORNERS {
            bytes.extend([0; 12]);
            bytes.extend(triangle.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
            bytes.extend([7, 7]);
        }
        bytes
    }

    fn text_file() -> String {
        let mut text = "solid A box\n".to_owned();
        for triangle in CORNERS {
            text += "  facet normal 0 0 0\n    outer loop\n";
            for [x, y, z] in triangle {
                text += &format!("      vertex {x} {y:e} {z}\n");
            }
            text += "    endloop\n  endfacet\n";
        }
        text + "endsolid A box\n"
    }

    fn read(name: &str, bytes: impl AsRef<[u8]>) -> Result<Imported, ReadError> {
        let folder = Folder::new(&format!("stl-{name}"));
        read_stl_geometry(&folder.file("a.stl", bytes))
    }

    /// Faces of 1, 3 and 3/2 and the slanted one of 7/2: half of |(−1, 2, 0) × (−1, 0, 3)| = |(6, 3, 2)| = 7.
    #[test]
    fn binary_and_text_give_the_same_triangles_and_keep_the_index_of_a_dropped_one() {
        let binary = read("binary", binary_file("made by a program")).unwrap();
        let text = read("text", text_file()).unwrap();
        for read in [&binary, &text] {
            assert_eq!((read.report.faces, read.report.zero_area_dropped, read.report.closed()), (5, 1, true));
            let areas: Vec<f64> = read.scene.surfaces.iter().map(|s| s.area()).collect();
            assert_eq!(areas, [1.0, 0.0, 1.5, 3.0, 3.5]);
        }
        let corners = |read: &Imported| read.scene.pieces().map(|(_, p)| p.vertices().to_vec()).collect::<Vec<_>>();
        assert_eq!(corners(&binary), corners(&text));
        assert_eq!((text.scene.surfaces[2].name.as_str(), text.scene.surfaces[2].line), ("A box", 16));
    }

    #[test]
    fn a_binary_file_that_begins_with_solid_is_binary() {
        assert_eq!(read("solid", binary_file("solid lie\nfacet normal")).unwrap().report.faces, 5);
    }

    #[test]
    fn the_line_ends_and_case_of_other_systems_change_nothing() {
        let text = text_file();
        for other in [text.replace('\n', "\r\n"), text.to_uppercase(), format!("\n  {text}")] {
            assert_eq!(read("line-ends", &other).unwrap().scene.area(), 9.0);
        }
    }

    #[test]
    fn a_truncated_or_lengthened_binary_file_says_both_lengths() {
        let whole = binary_file("x");
        for bytes in [&whole[..whole.len() - 1], &[&whole[..], &[0]].concat(), &whole[..HEADER]] {
            match read("truncated", bytes) {
                Err(ReadError::Stl { fault: StlFault::Length { announced: 5, needs: 334, has }, .. }) => {
                    assert_eq!(has, bytes.len() as u64);
                }
                other => panic!("{other:?}"),
            }
        }
    }

    #[test]
    fn damaged_text_is_refused_with_its_line() {
        let text = text_file();
        let damaged = [
            (text.replacen("vertex 0 2e0 0", "vertex 0 x 0", 1), 5),
            (text.replacen("vertex 0 2e0 0", "vertex 0 1e99 0", 1), 5),
            (text.replacen("vertex 0 2e0 0", "vertex 0", 1), 5),
            (text.replacen("vertex 0 2e0 0", "corner 0 2 0", 1), 5),
            (text.replacen("      vertex 0 2e0 0\n", "", 1), 2),
            (text.replacen("endfacet", "endloop", 10), 30),
        ];
        for (text, line) in damaged {
            match read("damaged", &text) {
                Err(ReadError::Stl { line: l, .. }) => assert_eq!(l, line, "{text}"),
                other => panic!("{other:?}"),
            }
        }
    }

    #[test]
    fn what_is_no_stl_or_has_no_area_is_refused() {
        assert!(matches!(read("obj", "v 0 0 0\n"), Err(ReadError::Stl { fault: StlFault::Unknown, .. })));
        assert!(matches!(read("none", ""), Err(ReadError::Stl { fault: StlFault::Unknown, .. })));
        assert!(matches!(read("hollow", "solid\nendsolid\n"), Err(ReadError::Empty { faces: 0, .. })));
        let mut bytes = binary_file("x");
        bytes[HEADER + 12..HEADER + 16].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(matches!(
            read("nan", bytes),
            Err(ReadError::Stl { fault: StlFault::Coordinate { triangle: 0, .. }, .. })
        ));
    }

    #[test]
    fn without_a_default_reflectance_there_is_no_material() {
        let folder = Folder::new("stl-material");
        let path = folder.file("a.stl", text_file());
        assert!(matches!(read_stl(&path, &ReadOptions::default()), Err(ReadError::MissingMaterial { face: 0, .. })));
        let options = ReadOptions { default_reflectance: Some(0.5), ..ReadOptions::default() };
        assert_eq!(read_stl(&path, &options).unwrap().scene.materials[0].reflectance, [0.5; 3]);
    }
}
