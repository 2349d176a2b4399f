//! Polygons with colours and radiosities as PLY (binary, little endian).
//!
//! Every face, or of shaded triangles every vertex, has the properties `red green blue` (0 to 255, ready for a viewer) and
//! `radiosity_r radiosity_g radiosity_b` (doubles, W/m²); every face has its `surface`. Faces share vertices of equal coordinates and, where
//! vertices are shaded, equal radiosities.

use std::collections::HashMap;
use std::hash::Hash;
use std::io::Write;
use std::path::Path;

use glam::DVec3;

use crate::{WriteError, write_atomically};

/// One polygon of a PLY file.
#[derive(Clone, Debug, PartialEq)]
pub struct PlyFace {
    /// Corners, counter-clockwise seen from the front.
    pub vertices: Vec<DVec3>,
    /// Index of the face in the scene file, from 0.
    pub surface: u32,
    /// Colour as a screen shows it.
    pub colour: [u8; 3],
    /// Radiosity B in W/m², red, green and blue.
    pub radiosity: [f64; 3],
}

/// A vertex with the radiosity that is shown there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlyVertex {
    /// Where it is.
    pub position: DVec3,
    /// Colour as a screen shows it.
    pub colour: [u8; 3],
    /// Radiosity B in W/m², red, green and blue.
    pub radiosity: [f64; 3],
}

/// A triangle whose radiosity is linear between its vertices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlyTriangle {
    /// Corners, counter-clockwise seen from the front.
    pub vertices: [PlyVertex; 3],
    /// Index of the face in the scene file, from 0.
    pub surface: u32,
}

/// Writes the faces as one PLY mesh.
///
/// # Errors
///
/// [`WriteError::File`] if the file cannot be written, [`WriteError::TooLarge`] if it has more vertices than 32-bit
/// signed indices reach.
pub fn write_ply(path: &Path, faces: &[PlyFace]) -> Result<(), WriteError> {
    let key = |vertex: &DVec3| vertex.to_array().map(f64::to_bits);
    let (vertices, corners) = shared(path, faces.iter().flat_map(|face| face.vertices.iter().copied()), key)?;
    // Readers that know nothing but one-byte counts are served where one byte is enough.
    let wide = faces.iter().any(|face| face.vertices.len() > usize::from(u8::MAX));
    let list = format!("property list {} int vertex_indices\n", if wide { "uint" } else { "uchar" });
    write_atomically(path, |out| {
        write_header(out, [vertices.len(), faces.len()], "", &format!("{list}{COLOUR}{SURFACE}{RADIOSITY}"))?;
        vertices.iter().try_for_each(|vertex| write_doubles(out, vertex.to_array()))?;
        let mut rest = &corners[..];
        for face in faces {
            let (own, after) = rest.split_at(face.vertices.len());
            rest = after;
            if wide {
                out.write_all(&(own.len() as u32).to_le_bytes())?;
            } else {
                out.write_all(&[own.len() as u8])?;
            }
            own.iter().try_for_each(|corner| out.write_all(&corner.to_le_bytes()))?;
            out.write_all(&face.colour)?;
            out.write_all(&face.surface.to_le_bytes())?;
            write_doubles(out, face.radiosity)?;
        }
        Ok(())
    })
}

/// Writes triangles whose vertices have radiosities as one PLY mesh; viewers shade them linearly.
///
/// # Errors
///
/// As [`write_ply`].
pub fn write_shaded_ply(path: &Path, triangles: &[PlyTriangle]) -> Result<(), WriteError> {
    let key = |v: &PlyVertex| (v.position.to_array().map(f64::to_bits), v.radiosity.map(f64::to_bits), v.colour);
    let (vertices, corners) = shared(path, triangles.iter().flat_map(|triangle| triangle.vertices), key)?;
    write_atomically(path, |out| {
        let list = "property list uchar int vertex_indices\n";
        let counts = [vertices.len(), triangles.len()];
        write_header(out, counts, &format!("{COLOUR}{RADIOSITY}"), &format!("{list}{SURFACE}"))?;
        for vertex in &vertices {
            write_doubles(out, vertex.position.to_array())?;
            out.write_all(&vertex.colour)?;
            write_doubles(out, vertex.radiosity)?;
        }
        for (own, triangle) in corners.chunks_exact(3).zip(triangles) {
            out.write_all(&[3])?;
            own.iter().try_for_each(|corner| out.write_all(&corner.to_le_bytes()))?;
            out.write_all(&triangle.surface.to_le_bytes())?;
        }
        Ok(())
    })
}

/// Vertices of different keys in order of first use, and which of them every corner is.
fn shared<V, K: Hash + Eq>(
    path: &Path,
    corners: impl Iterator<Item = V>,
    key: impl Fn(&V) -> K,
) -> Result<(Vec<V>, Vec<i32>), WriteError> {
    let (mut index_of, mut vertices, mut indices) = (HashMap::new(), Vec::new(), Vec::new());
    for vertex in corners {
        let index = *index_of.entry(key(&vertex)).or_insert_with(|| {
            vertices.push(vertex);
            vertices.len() - 1
        });
        let too_large = |_| WriteError::TooLarge { path: path.to_owned(), what: "vertices", count: vertices.len() };
        indices.push(i32::try_from(index).map_err(too_large)?);
    }
    Ok((vertices, indices))
}

const COLOUR: &str = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
const RADIOSITY: &str = "property double radiosity_r\nproperty double radiosity_g\nproperty double radiosity_b\n";
const SURFACE: &str = "property uint surface\n";

fn write_header(
    out: &mut dyn Write,
    [vertices, faces]: [usize; 2],
    of_vertices: &str,
    of_faces: &str,
) -> std::io::Result<()> {
    writeln!(out, "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}")?;
    write!(out, "property double x\nproperty double y\nproperty double z\n{of_vertices}")?;
    writeln!(out, "element face {faces}\n{of_faces}end_header")
}

fn write_doubles(out: &mut dyn Write, values: [f64; 3]) -> std::io::Result<()> {
    values.iter().try_for_each(|value| out.write_all(&value.to_le_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic::tests::Folder;

    fn written(faces: &[PlyFace], test: &str) -> (String, Vec<u8>) {
        let folder = Folder::new(test);
        let path = folder.0.join("out.ply");
        write_ply(&path, faces).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let end = b"end_header\n";
        let header = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
        (String::from_utf8(bytes[..header].to_vec()).unwrap(), bytes[header..].to_vec())
    }

    fn face(corners: usize) -> PlyFace {
        let vertices = (0..corners).map(|k| DVec3::new(k as f64, (k * k) as f64, 0.0)).collect();
        PlyFace { vertices, surface: 3, colour: [1, 2, 3], radiosity: [0.5, 0.25, 0.125] }
    }

    #[test]
    fn a_triangle_and_a_quad_with_three_common_corners_store_four_vertices() {
        let (header, body) = written(&[face(3), face(4)], "ply");
        assert!(header.contains("element vertex 4\n") && header.contains("element face 2\n"));
        // 3 doubles a vertex; a face: 1 byte of count, 4 bytes a corner, 3 of colour, 4 of surface, 3 doubles.
        assert_eq!(body.len(), 4 * 24 + 2 * (1 + 3 + 4 + 24) + 7 * 4);
        let first = &body[4 * 24..];
        assert_eq!(first[..13], [3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
        assert_eq!(first[13..20], [1, 2, 3, 3, 0, 0, 0]);
        assert_eq!(first[20..28], 0.5_f64.to_le_bytes());
    }

    #[test]
    fn a_polygon_of_269_corners_gets_a_count_of_four_bytes() {
        let (header, body) = written(&[face(269)], "ply-wide");
        assert!(header.contains("property list uint int vertex_indices\n"));
        assert_eq!(body[269 * 24..269 * 24 + 4], 269_u32.to_le_bytes());
    }

    /// Of two triangles that share an edge, one end of which has two radiosities.
    #[test]
    fn shaded_triangles_share_vertices_of_equal_radiosity_alone() {
        let vertex = |x: f64, y: f64, b: f64| {
            let (position, colour) = (DVec3::new(x, y, 0.0), [1, 2, 3]);
            PlyVertex { position, colour, radiosity: [b, 0.25, 0.125] }
        };
        let (a, b) = (vertex(0.0, 0.0, 0.5), vertex(1.0, 0.0, 0.5));
        let triangle = |vertices: [PlyVertex; 3]| PlyTriangle { vertices, surface: 3 };
        let triangles = [
            triangle([a, b, vertex(0.0, 1.0, 1.0)]),
            triangle([b, a, vertex(0.0, -1.0, 1.0)]),
            triangle([vertex(1.0, 0.0, 2.0), a, vertex(0.0, -1.0, 1.0)]),
        ];
        let folder = Folder::new("ply-shaded");
        let path = folder.0.join("out.ply");
        write_shaded_ply(&path, &triangles).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let header = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let (header, body) = (String::from_utf8(bytes[..header].to_vec()).unwrap(), &bytes[header..]);
        assert!(header.contains("element vertex 5\n") && header.contains("element face 3\n"));
        // A vertex: 3 doubles, 3 bytes of colour, 3 doubles; a face: 1 byte of count, 3 indices, surface.
        assert_eq!(body.len(), 5 * (24 + 3 + 24) + 3 * (1 + 12 + 4));
        assert_eq!(body[24..27], [1, 2, 3]);
        assert_eq!(body[27..35], 0.5_f64.to_le_bytes());
        let last = &body[5 * 51 + 2 * 17..];
        assert_eq!(last, [3, 4, 0, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0, 3, 0, 0, 0]);
    }
}
