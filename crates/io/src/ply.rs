//! Polygons with colours and radiosities as PLY (binary, little endian).
//!
//! Every face has the properties `red green blue` (0 to 255, ready for a viewer), `surface` and
//! `radiosity_r radiosity_g radiosity_b` (doubles, W/m²). Faces share vertices of equal coordinates.

use std::collections::HashMap;
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

/// Writes the faces as one PLY mesh.
///
/// # Errors
///
/// [`WriteError::File`] if the file cannot be written, [`WriteError::TooLarge`] if it has more vertices than 32-bit
/// signed indices reach.
pub fn write_ply(path: &Path, faces: &[PlyFace]) -> Result<(), WriteError> {
    // Vertices in order of first use.
    let (mut index_of, mut vertices) = (HashMap::new(), Vec::new());
    let mut corners = Vec::new();
    for vertex in faces.iter().flat_map(|face| &face.vertices) {
        let index = *index_of.entry(vertex.to_array().map(f64::to_bits)).or_insert_with(|| {
            vertices.push(*vertex);
            vertices.len() - 1
        });
        let too_large = |_| WriteError::TooLarge { path: path.to_owned(), what: "vertices", count: vertices.len() };
        corners.push(i32::try_from(index).map_err(too_large)?);
    }
    // Readers that know nothing but one-byte counts are served where one byte is enough.
    let wide = faces.iter().any(|face| face.vertices.len() > usize::from(u8::MAX));
    write_atomically(path, |out| {
        write_header(out, vertices.len(), faces.len(), wide)?;
        for vertex in &vertices {
            vertex.to_array().iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
        }
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
            face.radiosity.iter().try_for_each(|b| out.write_all(&b.to_le_bytes()))?;
        }
        Ok(())
    })
}

fn write_header(out: &mut dyn Write, vertices: usize, faces: usize, wide: bool) -> std::io::Result<()> {
    writeln!(out, "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}")?;
    writeln!(out, "property double x\nproperty double y\nproperty double z\nelement face {faces}")?;
    writeln!(out, "property list {} int vertex_indices", if wide { "uint" } else { "uchar" })?;
    writeln!(out, "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uint surface")?;
    writeln!(out, "property double radiosity_r\nproperty double radiosity_g\nproperty double radiosity_b\nend_header")
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
}
