//! Spheres of flat facets.

use std::f64::consts::{PI, TAU};

use glam::DVec3;
use radiosity_geometry::{Polygon, Surface};

/// A sphere of `rings` rings of facets between its poles and twice as many around, facing outwards: triangles at the poles, planar quadrilaterals
/// elsewhere. Its corners lie on the sphere. One surface a facet, of material `material`.
///
/// # Panics
///
/// If there are fewer than 3 rings or the radius is not finite and positive.
pub fn sphere(centre: DVec3, radius: f64, rings: u32, material: usize) -> Vec<Surface> {
    assert!(rings >= 3 && radius.is_finite() && radius > 0.0, "a sphere of {rings} rings and radius {radius}");
    let around = 2 * rings;
    let corner = |ring: u32, k: u32| {
        let (theta, phi) = (PI * f64::from(ring) / f64::from(rings), TAU * f64::from(k % around) / f64::from(around));
        let pole = ring == 0 || ring == rings;
        let across = if pole { 0.0 } else { theta.sin() };
        centre + radius * DVec3::new(across * phi.cos(), across * phi.sin(), theta.cos())
    };
    let facet = |(ring, k): (u32, u32)| {
        let corners = [corner(ring, k), corner(ring + 1, k), corner(ring + 1, k + 1), corner(ring, k + 1)];
        let corners = match ring {
            0 => corners[..3].to_vec(),
            _ if ring + 1 == rings => vec![corners[0], corners[1], corners[3]],
            _ => corners.to_vec(),
        };
        let polygon = Polygon::new(&corners).unwrap_or_else(|fault| panic!("a facet of a sphere: {fault}"));
        Surface { name: "sphere".into(), line: 0, material, pieces: vec![polygon] }
    };
    (0..rings).flat_map(|ring| (0..around).map(move |k| (ring, k))).map(facet).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Its area vectors add up to nothing, its volume to that of the ball less what flat facets cut off, about 4/rings².
    #[test]
    fn a_sphere_is_closed_and_faces_outwards() {
        for rings in [3, 8, 24] {
            let centre = DVec3::new(1.0, 2.0, 3.0);
            let facets = sphere(centre, 2.0, rings, 0);
            let polygons = || facets.iter().flat_map(|s| &s.pieces);
            let sum: DVec3 = polygons().map(|p| p.normal() * p.area()).sum();
            let volume: f64 = polygons().map(|p| p.area() * p.normal().dot(p.centroid() - centre) / 3.0).sum();
            let ball = 4.0 / 3.0 * PI * 8.0;
            assert!(sum.length() < 1e-12 && volume < ball && volume > ball * (1.0 - 6.0 / f64::from(rings * rings)));
        }
    }
}
