//! Elements that the shadow of a corner of an emitter ends in.
//!
//! Where the visibility of an emitter's corner changes, irradiance has a discontinuity of its second derivative, or for a small emitter
//! as good as a jump (P. S. Heckbert, "Discontinuity meshing for radiosity", EGWR 1992; D. Lischinski, F. Tampieri and D. P. Greenberg, IEEE
//! CG&A 12(6), 1992). Such a line crosses an element if its corners do not all see the same corners of the emitter. What is *not* here: lines from edges of emitters,
//! and shadows that lie between the corners of an element.

use glam::DVec3;
use radiosity_geometry::Polygon;
use rayon::prelude::*;

use crate::Geometry;

/// How far corners are moved towards the centre, so that what touches them does not decide.
const INSIDE: f64 = 1.0 / 256.0;
/// Emitters with less than this share of the power of the strongest are left out.
const STRONG: f64 = 0.1;

/// The elements crossed by a line, ascending.
pub(super) fn crossed(geometry: &Geometry<'_>) -> Vec<usize> {
    if geometry.blockers().is_empty() {
        return Vec::new();
    }
    let (emitters, surfaces) = geometry.emitters();
    let power = |k: usize| {
        let surface = &geometry.scene().surfaces[surfaces[k] as usize];
        geometry.scene().materials[surface.material].emission.iter().sum::<f64>() * emitters.area(k)
    };
    let most = (0..emitters.len()).map(power).fold(0.0, f64::max);
    let strong = emitters.iter_polygons().filter(|(k, _)| power(*k) >= STRONG * most);
    let lights: Vec<(&Polygon, Vec<DVec3>)> = strong.map(|(_, p)| (p, corners(p).collect())).collect();
    let is_crossed = |e: &usize| {
        let element = &geometry.elements().polygons(*e)[0];
        lights.iter().any(|(light, of_light)| of_light.iter().any(|&q| differs(geometry, element, light, q)))
    };
    (0..geometry.elements().len()).into_par_iter().filter(is_crossed).collect()
}

fn corners(polygon: &Polygon) -> impl Iterator<Item = DVec3> + '_ {
    polygon.vertices().iter().map(|v| v.lerp(polygon.centroid(), INSIDE))
}

/// Whether some corners of an element see point q of a light and others do not.
fn differs(geometry: &Geometry<'_>, element: &Polygon, light: &Polygon, q: DVec3) -> bool {
    let faces = |p: DVec3| element.signed_distance(q) > 0.0 && light.signed_distance(p) > 0.0;
    let mut seen = corners(element).map(|p| faces(p) && !geometry.blockers().occluded(p, q));
    let first = seen.next();
    seen.any(|s| Some(s) != first)
}
