//! Whether anything lies between two polygons: clear, hidden or partial, before any sampling.
//!
//! A polygon K blocks a segment that properly crosses it: the end points lie strictly on both sides of its plane (beyond
//! rounding and K's thickness) and the segment meets it in between. So K cannot block a pair
//!
//! - that lies wholly on one side of K's plane, or of which one polygon lies in that plane;
//! - if K lies wholly behind, or in, the plane of one of the two (they see each other's front only);
//! - if K's box misses the box of the pair.
//!
//! If i lies on one side of K's plane and j on the other, the segments between them meet the plane in the convex hull of
//! the points where the segments between *corners* do: with weights λ_a, μ_b of corners and heights d_a, d_b over the
//! plane, the crossing of any segment is the mean of the crossings p_ab with weights λ_a μ_b (|d_a| + |d_b|). So if all p_ab lie
//! inside K the pair is hidden, if all lie outside one edge K is out of the way, and both are exact. If a polygon straddles the plane, the
//! crossings of its own edges with the plane bound the hull instead; then K can be out of the way, but hides nothing.

use glam::DVec3;
use radiosity_geometry::{Occluders, Polygon};

use super::pair::{FacingPair, rounding};

/// Blockers of one pair whose segments are tested one by one; beyond that the hierarchy is asked.
const DIRECT: usize = 8;

/// What lies between the polygons of a pair.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Visibility {
    /// Nothing.
    Clear,
    /// A polygon that covers every segment.
    Hidden,
    /// These polygons, perhaps.
    Partial(Vec<usize>),
}

/// What to test a segment against.
#[derive(Clone)]
pub(super) enum Blocking<'a> {
    /// These polygons and no other.
    Few(Vec<Blocker>),
    /// All polygons there are.
    All {
        /// The polygons.
        occluders: &'a Occluders,
        /// What to add to points of the pair.
        origin: DVec3,
    },
}

impl<'a> Blocking<'a> {
    /// The polygons that [`classify`] found in the way of a pair.
    pub fn new(occluders: &'a Occluders, pair: &FacingPair, blockers: &[usize]) -> Self {
        if blockers.len() > DIRECT {
            return Self::All { occluders, origin: pair.origin };
        }
        let blocker = |&k: &usize| {
            let polygon = &occluders.polygons()[k];
            Blocker::new(polygon, pair.origin, slack(polygon, pair))
        };
        Self::Few(blockers.iter().map(blocker).collect())
    }

    /// Whether the segment between a point of i and one of j is crossed.
    pub fn blocks(&self, x: DVec3, y: DVec3) -> bool {
        match self {
            Self::Few(blockers) => blockers.iter().any(|blocker| blocker.crosses(x, y)),
            Self::All { occluders, origin } => occluders.occluded(*origin + x, *origin + y),
        }
    }
}

/// Sorts a pair by what lies between.
pub(super) fn classify(occluders: &Occluders, pair: &FacingPair) -> Visibility {
    let corners = pair.i.iter().chain(&pair.j);
    let (lo, hi) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
    let grow = DVec3::splat(pair.slack);
    let (mut blockers, mut hidden) = (Vec::new(), false);
    occluders.overlapping(pair.origin + lo - grow, pair.origin + hi + grow, &mut |k| {
        if hidden {
            return;
        }
        match between(&occluders.polygons()[k], pair) {
            Between::Nothing => {}
            Between::All => hidden = true,
            Between::Some => blockers.push(k),
        }
    });
    if hidden {
        Visibility::Hidden
    } else if blockers.is_empty() {
        Visibility::Clear
    } else {
        // The order of the hierarchy is of no meaning.
        blockers.sort_unstable();
        Visibility::Partial(blockers)
    }
}

/// How much of a pair one polygon blocks.
enum Between {
    Nothing,
    All,
    Some,
}

/// Heights over the plane of a polygon that rounding may make.
fn slack(polygon: &Polygon, pair: &FacingPair) -> f64 {
    2.0 * (pair.slack.max(rounding(polygon.vertices())) + polygon.thickness())
}

fn between(polygon: &Polygon, pair: &FacingPair) -> Between {
    let local = |v: &DVec3| *v - pair.origin;
    // Behind one of the two planes: nothing that the two see of each other passes there.
    let behind = |p: DVec3, n: DVec3| polygon.vertices().iter().all(|v| (local(v) - p).dot(n) <= pair.slack);
    if behind(pair.i[0], pair.n_i) || behind(pair.j[0], pair.n_j) {
        return Between::Nothing;
    }
    let (p, n) = (local(&polygon.vertices()[0]), polygon.normal());
    let slack = slack(polygon, pair);
    let heights = |v: &[DVec3]| -> Side { Side::of(v.iter().map(|v| (*v - p).dot(n)), slack) };
    let (side_i, side_j) = (heights(&pair.i), heights(&pair.j));
    if !((side_i.above && side_j.below) || (side_i.below && side_j.above)) {
        return Between::Nothing;
    }
    let crossings = Crossings { p, n, slack, pair };
    let straddles = (side_i.above && side_i.below) || (side_j.above && side_j.below);
    let mut inside = !straddles;
    for (a, b) in polygon.edges() {
        let Some((m, at)) = side(a - pair.origin, b - pair.origin, n) else { continue };
        let (mut all_outside, mut all_inside) = (true, true);
        crossings.visit(straddles, &mut |crossing| {
            let depth = crossing.dot(m) - at;
            all_outside &= depth <= slack;
            all_inside &= depth >= -slack;
        });
        if all_outside {
            return Between::Nothing;
        }
        inside &= all_inside;
    }
    if inside { Between::All } else { Between::Some }
}

/// Unit normal m into a polygon, in its plane, on the edge a b, and m·x on the edge.
fn side(a: DVec3, b: DVec3, n: DVec3) -> Option<(DVec3, f64)> {
    let m = n.cross(b - a).try_normalize()?;
    Some((m, m.dot(a)))
}

/// On which sides of a plane points lie.
#[derive(Clone, Copy, Debug)]
struct Side {
    above: bool,
    below: bool,
}

impl Side {
    fn of(heights: impl Iterator<Item = f64>, slack: f64) -> Self {
        let none = Self { above: false, below: false };
        heights.fold(none, |s, h| Self { above: s.above || h > slack, below: s.below || h < -slack })
    }
}

/// The points whose convex hull holds every crossing of a plane by a segment between the polygons.
struct Crossings<'a> {
    p: DVec3,
    n: DVec3,
    slack: f64,
    pair: &'a FacingPair,
}

impl Crossings<'_> {
    fn visit(&self, straddles: bool, visit: &mut dyn FnMut(DVec3)) {
        let height = |v: DVec3| {
            let h = (v - self.p).dot(self.n);
            if h.abs() <= self.slack { 0.0 } else { h }
        };
        let meet = |a: DVec3, d_a: f64, b: DVec3, d_b: f64| a + (b - a) * (d_a / (d_a - d_b));
        for &a in &self.pair.i {
            let d_a = height(a);
            for &b in &self.pair.j {
                let d_b = height(b);
                // Corners in the plane are crossings themselves; two of them carry no weight.
                if d_a * d_b < 0.0 || ((d_a == 0.0) != (d_b == 0.0)) {
                    visit(meet(a, d_a, b, d_b));
                }
            }
        }
        if straddles {
            for corners in [&self.pair.i, &self.pair.j] {
                for k in 0..corners.len() {
                    let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
                    let (d_a, d_b) = (height(a), height(b));
                    if d_a * d_b < 0.0 {
                        visit(meet(a, d_a, b, d_b));
                    }
                }
            }
        }
    }
}

/// A polygon that may block, in the coordinates of a pair.
#[derive(Clone, Debug)]
pub(super) struct Blocker {
    p: DVec3,
    n: DVec3,
    slack: f64,
    /// Inward unit normals m of the edges in the polygon's plane, and m·x on the edge.
    sides: Vec<(DVec3, f64)>,
}

impl Blocker {
    fn new(polygon: &Polygon, origin: DVec3, slack: f64) -> Self {
        let n = polygon.normal();
        let sides = polygon.edges().filter_map(|(a, b)| side(a - origin, b - origin, n)).collect();
        Self { p: polygon.vertices()[0] - origin, n, slack, sides }
    }

    /// Whether the open segment x y properly crosses the polygon.
    fn crosses(&self, x: DVec3, y: DVec3) -> bool {
        let (d_x, d_y) = ((x - self.p).dot(self.n), (y - self.p).dot(self.n));
        if d_x * d_y >= 0.0 || d_x.abs() <= self.slack || d_y.abs() <= self.slack {
            return false;
        }
        let meet = x + (y - x) * (d_x / (d_x - d_y));
        self.sides.iter().all(|(m, at)| m.dot(meet) >= *at)
    }
}
