//! One cell and all that is needed of it in pairs: computed once, read by every pair.

use glam::DVec3;

use super::area_quadrature::Cell;
use super::lanes::{BLOCK, Eight};

/// A cell x(s, t) = p + c + s u + t v + s t w over [−1, 1]²; `T` is one number, or one a lane.
///
/// p is a corner as it was given, so that differences between cells far from the origin lose nothing.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Patch<T> {
    pub p: [T; 3],
    pub c: [T; 3],
    pub u: [T; 3],
    pub v: [T; 3],
    pub w: [T; 3],
    /// Unit normal; zero for what takes no part.
    pub n: [T; 3],
    /// Height of the centre over the plane through the first corner.
    pub offset: T,
    pub area: T,
    /// Relative slopes of the Jacobian along s and t.
    pub kappa: [T; 2],
    /// u·u, u·v, v·v, w·w, u·w, v·w.
    pub gram: [T; 6],
    /// Largest half lengths of lines along s and t.
    pub half: [T; 2],
    /// |u| and |v|, and their reciprocals.
    pub length: [T; 2],
    pub inverse: [T; 2],
    /// Sine of the largest angle between a line along s (t) and u (v).
    pub turn: [T; 2],
    /// Largest distance of a corner from the centre.
    pub radius: T,
    /// Size² / area: 4 for a square, large for slivers.
    pub stretch: T,
    /// Rounding of the coordinates, distance by which corners miss a plane, and length of the border.
    pub rounding: T,
    pub thickness: T,
    pub perimeter: T,
    /// Shortest edge.
    pub edge: T,
    /// 1 for a cell, 0 for what has to be taken polygon by polygon.
    pub ready: T,
}

impl Patch<f64> {
    /// The cell relative to `p`, without what clipping and rounding need.
    pub fn of(cell: &Cell, p: DVec3) -> Self {
        let Cell { c, u, v, w, n, j0, js, jt, ref corners } = *cell;
        // Twists within rounding are those of a parallelogram's corners.
        let size = u.length() + v.length();
        let w = if w.length() <= 4.0 * f64::EPSILON * size { DVec3::ZERO } else { w };
        let flat = w == DVec3::ZERO;
        let turn = |line: DVec3| {
            let at = |end: DVec3| {
                let sine = line.cross(w).length() / (line.length() * end.length());
                if line.dot(end) < 0.0 {
                    1.0
                } else if sine.is_finite() {
                    sine
                } else {
                    0.0
                }
            };
            if flat { 0.0 } else { at(line + w).max(at(line - w)) }
        };
        let half = |line: DVec3| (line + w).length().max((line - w).length());
        Self {
            p: p.to_array(),
            c: c.to_array(),
            u: u.to_array(),
            v: v.to_array(),
            w: w.to_array(),
            n: n.to_array(),
            offset: n.dot(c - corners[0]),
            area: 4.0 * j0,
            kappa: if flat { [0.0; 2] } else { [js / j0, jt / j0] },
            gram: [u.dot(u), u.dot(v), v.dot(v), w.dot(w), u.dot(w), v.dot(w)],
            half: [half(u), half(v)],
            length: [u.length(), v.length()],
            inverse: [1.0 / u.length(), 1.0 / v.length()],
            turn: [turn(u), turn(v)],
            radius: corners.iter().map(|x| x.distance(c)).fold(0.0, f64::max),
            stretch: size * size / j0,
            ready: 1.0,
            ..Self::default()
        }
    }

    /// What takes no part: it faces nothing.
    pub fn absent() -> Self {
        Self { ready: 1.0, ..Self::default() }
    }
}

/// Writes one patch into a lane of a block.
pub(super) fn set_lane(block: &mut Patch<Eight>, lane: usize, patch: &Patch<f64>) {
    debug_assert!(lane < BLOCK);
    let vectors = [
        (&mut block.p, &patch.p),
        (&mut block.c, &patch.c),
        (&mut block.u, &patch.u),
        (&mut block.v, &patch.v),
        (&mut block.w, &patch.w),
        (&mut block.n, &patch.n),
    ];
    for (to, from) in vectors {
        to.iter_mut().zip(from).for_each(|(to, from)| to.0[lane] = *from);
    }
    let couples = [
        (&mut block.kappa, &patch.kappa),
        (&mut block.half, &patch.half),
        (&mut block.length, &patch.length),
        (&mut block.inverse, &patch.inverse),
        (&mut block.turn, &patch.turn),
    ];
    for (to, from) in couples {
        to.iter_mut().zip(from).for_each(|(to, from)| to.0[lane] = *from);
    }
    block.gram.iter_mut().zip(&patch.gram).for_each(|(to, from)| to.0[lane] = *from);
    let numbers = [
        (&mut block.offset, patch.offset),
        (&mut block.area, patch.area),
        (&mut block.radius, patch.radius),
        (&mut block.stretch, patch.stretch),
        (&mut block.rounding, patch.rounding),
        (&mut block.thickness, patch.thickness),
        (&mut block.perimeter, patch.perimeter),
        (&mut block.edge, patch.edge),
        (&mut block.ready, patch.ready),
    ];
    numbers.into_iter().for_each(|(to, from)| to.0[lane] = from);
}
