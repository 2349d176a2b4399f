//! Vertices, faces and the names they hang on, line by line.
//!
//! Geometry is scanned here and not by `tobj`, which gives no line numbers, loses the order of faces across materials
//! and which material was asked for where none is defined, and stops at a `usemtl` without a name.

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;

use super::lines::{Line, logical_lines, words};
use crate::ReadError;
use crate::error::shown;

/// One `f` line.
pub(crate) struct RawFace {
    pub line: usize,
    /// Indices into the vertices, from 0.
    pub corners: Vec<usize>,
    /// Name given by `usemtl`; empty if there is none.
    pub material: String,
    /// Name given by `o` or `g`.
    pub group: String,
}

/// What an OBJ file says.
#[derive(Default)]
pub(crate) struct Raw {
    pub vertices: Vec<DVec3>,
    pub faces: Vec<RawFace>,
    /// `mtllib` lines: number and what they name.
    pub libraries: Vec<(usize, String)>,
    pub line_elements: usize,
    pub point_elements: usize,
    /// Keywords that are not understood: number of lines and first line.
    pub other: BTreeMap<String, (usize, usize)>,
}

/// Reads the bytes of an OBJ file.
///
/// # Errors
///
/// [`ReadError`] at the first coordinate, corner or index that cannot be used.
pub(super) fn scan(path: &Path, bytes: &[u8]) -> Result<Raw, ReadError> {
    let mut raw = Raw::default();
    let (mut material, mut group) = (String::new(), String::new());
    for line in logical_lines(bytes) {
        let Some((key, rest)) = line.key() else { continue };
        match key {
            "v" => raw.vertices.push(vertex(path, &line, rest)?),
            "f" | "fo" => {
                let before = raw.vertices.len();
                let corners = words(rest).map(|word| corner(path, line.number, word, before));
                let corners = corners.collect::<Result<_, _>>()?;
                let (material, group) = (material.clone(), group.clone());
                raw.faces.push(RawFace { line: line.number, corners, material, group });
            }
            "usemtl" => material = rest.to_owned(),
            "o" | "g" => group = rest.to_owned(),
            "mtllib" => raw.libraries.push((line.number, rest.to_owned())),
            "l" => raw.line_elements += 1,
            "p" => raw.point_elements += 1,
            // Shading, texture coordinates and display attributes say nothing about diffuse exchange.
            "vt" | "vn" | "vp" | "s" | "mg" | "bevel" | "c_interp" | "d_interp" | "lod" | "usemap" | "maplib"
            | "shadow_obj" | "trace_obj" => {}
            other => raw.other.entry(shown(other)).or_insert((0, line.number)).0 += 1,
        }
    }
    // Only now are all vertices known: some files put the faces first.
    let vertices = raw.vertices.len();
    for face in &raw.faces {
        if let Some(at) = face.corners.iter().find(|at| **at >= vertices) {
            let index = i64::try_from(*at).map_or(i64::MAX, |at| at.saturating_add(1));
            return Err(ReadError::Index { path: path.to_owned(), line: face.line, index, vertices });
        }
    }
    Ok(raw)
}

/// Largest coordinate that is taken for one: areas, and products of two of them, stay finite.
pub(crate) const LARGEST: f64 = 1e70;

/// The first three numbers of a `v` line; a weight or a colour may follow them.
fn vertex(path: &Path, line: &Line, rest: &str) -> Result<DVec3, ReadError> {
    let mut coordinates = [0.0; 3];
    let mut count = 0;
    for (coordinate, word) in coordinates.iter_mut().zip(words(rest)) {
        let refuse = || ReadError::Coordinate { path: path.to_owned(), line: line.number, word: shown(word) };
        *coordinate = word.parse().ok().filter(|x: &f64| x.abs() <= LARGEST).ok_or_else(refuse)?;
        count += 1;
    }
    if count < 3 {
        return Err(ReadError::FewCoordinates { path: path.to_owned(), line: line.number, count });
    }
    Ok(DVec3::from_array(coordinates))
}

/// The vertex of a corner `n`, `n/n`, `n//n` or `n/n/n`; n counts from 1, or back from the last of the `before` vertices
/// above the line if negative.
fn corner(path: &Path, line: usize, word: &str, before: usize) -> Result<usize, ReadError> {
    let mut parts = word.split('/');
    let first: Option<i64> = parts.next().and_then(|n| n.parse().ok()).filter(|n| *n != 0);
    // Texture coordinate and normal must be numbers or absent, but what they name is of no interest here.
    let others = parts.clone().count() <= 2 && parts.all(|n| n.is_empty() || n.parse::<i64>().is_ok());
    let Some(index) = first.filter(|_| others) else {
        return Err(ReadError::Corner { path: path.to_owned(), line, word: shown(word) });
    };
    let distance = usize::try_from(index.unsigned_abs()).ok();
    let at = distance.and_then(|d| if index > 0 { d.checked_sub(1) } else { before.checked_sub(d) });
    at.ok_or_else(|| ReadError::Index { path: path.to_owned(), line, index, vertices: before })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: &str = "v 0 0 0\nv 3 0 0\nv 3 5 0\nv 0 5 0\n";

    fn faces(text: &str) -> Result<Vec<Vec<usize>>, ReadError> {
        let raw = scan(Path::new("a.obj"), format!("{SQUARE}{text}").as_bytes())?;
        Ok(raw.faces.into_iter().map(|face| face.corners).collect())
    }

    #[test]
    fn every_form_of_a_corner_names_its_vertex() {
        let read =
            faces("f 1 2 3 4\nf 1/9 2/9 3/9\nf 1//7 2//7 4//7\nf 1/2/3 -3/1/1 -1//1\nf 1/ 2/ 3/ # quad").unwrap();
        assert_eq!(read, [vec![0, 1, 2, 3], vec![0, 1, 2], vec![0, 1, 3], vec![0, 1, 3], vec![0, 1, 2]]);
    }

    #[test]
    fn faces_may_come_before_their_vertices() {
        assert_eq!(faces("f 1 2 5\nv 7 7 7").unwrap(), [[0, 1, 4]]);
    }

    #[test]
    fn an_index_out_of_range_names_its_line() {
        for (text, line, index) in
            [("f 1 2 5", 5, 5), ("\nf 1 2 -5", 6, -5), ("f 1 2 9223372036854775807", 5, i64::MAX)]
        {
            match faces(text) {
                Err(ReadError::Index { line: l, index: i, vertices: 4, .. }) => assert_eq!((l, i), (line, index)),
                other => panic!("{text}: {other:?}"),
            }
        }
        assert!(matches!(faces("f -1 -2 -9223372036854775808"), Err(ReadError::Index { index: i64::MIN, .. })));
    }

    #[test]
    fn words_that_are_no_corner_name_their_line() {
        for text in
            ["f 0 1 2", "f 1 2 x", "f 1 2 3/a", "f 1 2 3/1/1/1", "f 1 2 /3", "f 1.5 2 3", "f 1 2 99999999999999999999"]
        {
            assert!(matches!(faces(text), Err(ReadError::Corner { line: 5, .. })), "{text}");
        }
    }

    #[test]
    fn a_coordinate_that_is_no_number_names_its_line() {
        for (word, text) in [
            ("nan", "v nan 1 0"),
            ("inf", "v 0 inf 0"),
            ("1e999", "v 0 0 1e999"),
            ("-1e99", "v 0 -1e99 0"),
            ("1,5", "v 1,5 0 0"),
        ] {
            match faces(text) {
                Err(ReadError::Coordinate { line: 5, word: found, .. }) => assert_eq!(found, word),
                other => panic!("{text}: {other:?}"),
            }
        }
        assert!(matches!(faces("v 1 2"), Err(ReadError::FewCoordinates { line: 5, count: 2, .. })));
    }

    #[test]
    fn weights_and_vertex_colours_are_left_alone() {
        assert_eq!(faces("v 1 2 3 1.0\nv 1 2 3 0.5 0.5 0.5\nf 1 5 6").unwrap(), [[0, 4, 5]]);
    }

    /// `tobj` on the same clean file is the independent route.
    #[test]
    fn a_clean_file_reads_as_tobj_reads_it() {
        let text =
            "v 0.1 0 -1e-3\nv 3 0 0\nv 3 5.25 0\nv 0 5 0\no a\nf 1/1 2/1 3/1\nf -4 -2 -1 -3\nf 4 3 2 1\nvt 0 0\n";
        let text = text.replace("o a\n", "vt 0 0\no a\n");
        let raw = scan(Path::new("a.obj"), text.as_bytes()).unwrap();
        let options = tobj::LoadOptions::default();
        let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, |_| unreachable!()).unwrap();
        let mesh = &models[0].mesh;
        // tobj keeps the vertices that faces use, in order of use.
        let at = |k: u32| DVec3::from_slice(&mesh.positions[3 * k as usize..]);
        let theirs: Vec<DVec3> = mesh.indices.iter().map(|k| at(*k)).collect();
        let ours: Vec<DVec3> = raw.faces.iter().flat_map(|f| f.corners.iter().map(|k| raw.vertices[*k])).collect();
        assert_eq!(ours, theirs);
        assert_eq!(mesh.face_arities, [3, 4, 4]);
    }
}
