//! Item buffers: which polygon each pixel of a hemicube face shows.
//!
//! A pixel centre is a direction d = forward + x·right + y·up from the eye. A polygon with vertices a, b, … as seen from
//! the eye covers d when every edge function (a × b)·d has the sign of the polygon's side; this is the homogeneous
//! test of Olano and Greer (1997): linear in x and y, with no division by a depth, so that polygons that reach behind
//! the eye need no clipping to be drawn right. Clipping to the face's pyramid only finds the pixel rows and columns
//! worth testing. Neighbours compute a × b from the same ordered end points, so no pixel slips between them.
//! Depth is 1/t = (n·d)/(n·a), also linear.

use glam::DVec3;
use radiosity_geometry::{Facets, Polygon};

/// What a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Item {
    /// Nothing.
    Empty,
    /// The back of some polygon.
    Back,
    /// The front of a facet.
    Front(u32),
}

/// A polygon as seen from the eye, in coordinates (u, v, normal) of the source.
struct Seen {
    facet: u32,
    front: bool,
    vertices: Vec<DVec3>,
    /// Edge functions, positive inside, and the rounding of each.
    edges: Vec<(DVec3, f64)>,
    /// n/(n·a): 1/t = plane·d.
    plane: DVec3,
}

/// A source's centre with everything that can be seen from it.
pub struct Eye {
    seen: Vec<Seen>,
}

impl Eye {
    /// The facets seen from the centroid of `source`, its frame turned by `turn` about the normal.
    pub fn new(source: &Polygon, turn: f64, facets: &Facets) -> Self {
        let ((u0, v0), n) = (source.frame(), source.normal());
        let (sin, cos) = turn.sin_cos();
        let (u, v) = (u0 * cos + v0 * sin, v0 * cos - u0 * sin);
        let eye = source.centroid();
        let local = |p: DVec3| DVec3::new((p - eye).dot(u), (p - eye).dot(v), (p - eye).dot(n));
        let reach = eye.abs().max_element();
        let seen = facets.iter_polygons().filter_map(|(facet, polygon)| see(facet as u32, polygon, eye, reach, local));
        Self { seen: seen.collect() }
    }
}

fn see(facet: u32, polygon: &Polygon, eye: DVec3, reach: f64, local: impl Fn(DVec3) -> DVec3) -> Option<Seen> {
    let vertices: Vec<DVec3> = polygon.vertices().iter().map(|&p| local(p)).collect();
    let size = vertices.iter().map(|v| v.length()).fold(0.0, f64::max);
    // A plane that holds the eye, to rounding, shows no area; neither does what lies below the horizon.
    let side = polygon.signed_distance(eye);
    let rounding = 32.0 * f64::EPSILON * size.max(reach);
    if side.abs() <= rounding + 2.0 * polygon.thickness() || vertices.iter().all(|v| v.z <= rounding) {
        return None;
    }
    let front = side > 0.0;
    // Inside is negative seen from the front, since (a × b)·c = n·a · 2·area and n·a = −side.
    let sign = if front { -1.0 } else { 1.0 };
    let count = vertices.len();
    let points = polygon.vertices();
    let edges = (0..count).map(|k| {
        let l = (k + 1) % count;
        // One order of the end points for both neighbours.
        let ordered = points[k].to_array() <= points[l].to_array();
        let (a, b) = if ordered { (vertices[k], vertices[l]) } else { (vertices[l], vertices[k]) };
        let edge = a.cross(b) * if ordered { sign } else { -sign };
        // Coordinates are off by ε · reach, which moves a × b by that times |a| + |b|.
        (edge, 8.0 * f64::EPSILON * (a.length() * b.length() + reach * (a.length() + b.length())))
    });
    let edges = edges.collect();
    let normal = local(eye + polygon.normal());
    let plane = normal / -side;
    Some(Seen { facet, front, vertices, edges, plane })
}

/// Axes (forward, right, up) of a face: 0 is the top, 1 to 4 the sides with up along the normal.
fn axes(face: usize) -> [DVec3; 3] {
    match face {
        0 => [DVec3::Z, DVec3::X, DVec3::Y],
        1 => [DVec3::X, DVec3::Y, DVec3::Z],
        2 => [DVec3::Y, DVec3::NEG_X, DVec3::Z],
        3 => [DVec3::NEG_X, DVec3::NEG_Y, DVec3::Z],
        _ => [DVec3::NEG_Y, DVec3::X, DVec3::Z],
    }
}

/// Depths this close to each other are the same surface: the two sides of a sheet.
const TWIN: f64 = 1e-10;

/// The item buffer of a face, row after row; sides begin at the horizon.
pub fn draw(eye: &Eye, facets: &Facets, face: usize, resolution: usize) -> Vec<Item> {
    let axes = axes(face);
    let first_row = if face == 0 { 0 } else { resolution / 2 };
    let rows = resolution - first_row;
    let mut items = vec![Item::Empty; rows * resolution];
    let mut depths = vec![0.0; rows * resolution];
    let pixel = 2.0 / resolution as f64;
    let at = |k: usize| (k as f64 + 0.5) * pixel - 1.0;
    for seen in &eye.seen {
        let Some([x0, x1, y0, y1]) = extent(&seen.vertices, &axes, face == 0) else { continue };
        // A pixel more on every side: the edge functions decide.
        let index = |x: f64| ((x + 1.0) / pixel).floor();
        let column = |x: f64| index(x).clamp(0.0, resolution as f64 - 1.0) as usize;
        let (i0, i1) = (column(x0 - pixel), column(x1 + pixel));
        let row = |y: f64| index(y).clamp(first_row as f64, resolution as f64 - 1.0) as usize;
        let (j0, j1) = (row(y0 - pixel), row(y1 + pixel));
        for j in j0..=j1 {
            let start = axes[0] + axes[2] * at(j);
            let covers = |i: usize| {
                let d = start + axes[1] * at(i);
                seen.edges.iter().all(|(edge, rounding)| edge.dot(d) >= -rounding)
            };
            // A convex polygon covers one run of pixels in a row.
            let Some((begin, end)) = run(seen, start, axes[1], i0, i1, pixel, covers) else { continue };
            let (w0, dw) = (seen.plane.dot(start), seen.plane.dot(axes[1]));
            let line = (j - first_row) * resolution;
            for i in begin..=end {
                let w = w0 + dw * at(i);
                let (item, depth) = (&mut items[line + i], &mut depths[line + i]);
                let nearer = w > *depth * (1.0 + TWIN);
                let twin = seen.front && *item == Item::Back && w >= *depth * (1.0 - TWIN);
                if nearer || twin {
                    *item = if seen.front { Item::Front(seen.facet) } else { Item::Back };
                    *depth = w;
                }
            }
        }
    }
    debug_assert!(items.iter().all(|item| !matches!(item, Item::Front(k) if *k as usize >= facets.len())));
    items
}

/// First and last pixel of the run that the edge functions cover between columns i0 and i1.
fn run(
    seen: &Seen,
    start: DVec3,
    right: DVec3,
    i0: usize,
    i1: usize,
    pixel: f64,
    covers: impl Fn(usize) -> bool,
) -> Option<(usize, usize)> {
    // Each edge function α + βx ≥ 0 leaves a half line of x.
    let (mut lo, mut hi) = (f64::NEG_INFINITY, f64::INFINITY);
    for (edge, rounding) in &seen.edges {
        let (alpha, beta) = (edge.dot(start) + rounding, edge.dot(right));
        if beta > 0.0 {
            lo = lo.max(-alpha / beta);
        } else if beta < 0.0 {
            hi = hi.min(-alpha / beta);
        } else if alpha < 0.0 {
            return None;
        }
    }
    // Rounding of the quotient moves an end by at most one pixel: begin one outside and let the test decide.
    let index = |x: f64| ((x + 1.0) / pixel - 0.5).clamp(i0 as f64, i1 as f64);
    let (mut begin, mut end) = ((index(lo).ceil() as usize).max(i0 + 1) - 1, (index(hi).floor() as usize + 1).min(i1));
    while begin <= end && !covers(begin) {
        begin += 1;
    }
    while end > begin && !covers(end) {
        end -= 1;
    }
    (begin <= end).then_some((begin, end))
}

/// Smallest and largest x and y of the part of a polygon inside the face's pyramid, or `None` if nothing is.
fn extent(vertices: &[DVec3], axes: &[DVec3; 3], top: bool) -> Option<[f64; 4]> {
    let mut points: Vec<DVec3> =
        vertices.iter().map(|v| DVec3::new(v.dot(axes[1]), v.dot(axes[2]), v.dot(axes[0]))).collect();
    let below = if top { DVec3::new(0.0, 1.0, 1.0) } else { DVec3::Y };
    for plane in [DVec3::new(1.0, 0.0, 1.0), DVec3::new(-1.0, 0.0, 1.0), below, DVec3::new(0.0, -1.0, 1.0)] {
        points = clip(&points, plane);
        if points.is_empty() {
            return None;
        }
    }
    let mut bounds = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
    for p in points.iter().filter(|p| p.z > 0.0) {
        let (x, y) = (p.x / p.z, p.y / p.z);
        bounds = [bounds[0].min(x), bounds[1].max(x), bounds[2].min(y), bounds[3].max(y)];
    }
    bounds[0].is_finite().then_some(bounds)
}

/// The part of a loop with plane·p ≥ 0.
fn clip(points: &[DVec3], plane: DVec3) -> Vec<DVec3> {
    let mut kept = Vec::with_capacity(points.len() + 1);
    for (k, &a) in points.iter().enumerate() {
        let b = points[(k + 1) % points.len()];
        let (da, db) = (plane.dot(a), plane.dot(b));
        if da >= 0.0 {
            kept.push(a);
        }
        if (da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0) {
            kept.push(a + (b - a) * (da / (da - db)));
        }
    }
    kept
}
