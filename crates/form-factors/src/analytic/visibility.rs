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
use super::partial::Bodies;

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
    /// The polygons that [`Screens::classify`] found in the way of a pair.
    pub fn new(occluders: &'a Occluders, pair: &FacingPair, blockers: &[usize]) -> Self {
        if blockers.len() > DIRECT {
            return Self::All { occluders, origin: pair.origin };
        }
        let blocker = |&k: &usize| {
            let polygon = &occluders.polygons()[k];
            let slack = 2.0 * (pair.slack.max(rounding(polygon.vertices())) + polygon.thickness());
            Blocker::new(polygon, pair.origin, slack)
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

/// Scenes of so few blockers are gone through; beyond that the hierarchy is asked.
const SHORT: usize = 24;

/// What is needed of every blocking polygon to sort pairs.
#[derive(Clone, Debug)]
pub(super) struct Screens {
    screens: Vec<Screen>,
    /// Faces of convex bodies, body by body.
    bodies: Vec<Vec<usize>>,
    /// The other polygons.
    singles: Vec<usize>,
    /// Convex polygons through each of which every segment must pass; what surrounds them is among the others.
    windows: Vec<Screen>,
}

/// A polygon with what its planes need.
#[derive(Clone, Debug)]
pub(super) struct Screen {
    vertices: Vec<DVec3>,
    normal: DVec3,
    thickness: f64,
    rounding: f64,
    low: DVec3,
    high: DVec3,
    /// A point of each edge, and the unit normal into the polygon, in its plane.
    sides: Vec<(DVec3, DVec3)>,
}

impl Screens {
    /// The screens of all polygons of a scene, and its convex bodies.
    pub fn new(occluders: &Occluders, bodies: &Bodies) -> Self {
        Self {
            screens: occluders.polygons().iter().map(Screen::new).collect(),
            bodies: bodies.iter().map(|body| body.faces.clone()).collect(),
            singles: (0..occluders.len()).filter(|&k| bodies.of(k).is_none()).collect(),
            windows: Vec::new(),
        }
    }

    /// Hides pairs of which no segment passes one of `windows`. What blocks the segments that pass beside it must be a screen itself.
    pub fn set_windows(&mut self, windows: &[Polygon]) {
        self.windows = windows.iter().map(Screen::new).collect();
    }

    /// Sorts a pair by what lies between.
    pub fn classify(&self, occluders: &Occluders, pair: &FacingPair) -> Visibility {
        let mut search = Search::new(pair);
        // Out of the way of a pair is a window through which no segment passes.
        if self.windows.iter().any(|window| matches!(search.between(window), Between::Nothing)) {
            return Visibility::Hidden;
        }
        if self.takes_bodies() {
            self.singles.iter().for_each(|&k| search.visit(k, &self.screens[k]));
            self.bodies.iter().filter(|faces| !self.beside(faces, pair)).for_each(|faces| {
                faces.iter().for_each(|&k| search.visit(k, &self.screens[k]));
            });
        } else {
            occluders.overlapping(search.low, search.high, &mut |k| search.visit(k, &self.screens[k]));
        }
        search.result()
    }

    /// The screen of polygon k.
    pub fn screen(&self, k: usize) -> &Screen {
        &self.screens[k]
    }

    /// Whether polygons beside a pair are left out body by body.
    pub fn takes_bodies(&self) -> bool {
        self.screens.len() <= SHORT
    }

    /// Whether both polygons are in front of one face of a body: then all of it is behind that face, and out of the way.
    fn beside(&self, faces: &[usize], pair: &FacingPair) -> bool {
        faces.iter().any(|&k| {
            let screen = &self.screens[k];
            let (p, slack) = (screen.vertices[0] - pair.origin, screen.slack(pair));
            pair.i.iter().chain(&pair.j).all(|v| (*v - p).dot(screen.normal) >= -slack)
        })
    }
}

impl Screen {
    fn new(polygon: &Polygon) -> Self {
        let (low, high) = polygon.bounds();
        let normal = polygon.normal();
        let sides = polygon.edges().filter_map(|(a, b)| Some((a, side(a, b, normal)?))).collect();
        let (vertices, thickness) = (polygon.vertices().to_vec(), polygon.thickness());
        Self { rounding: rounding(&vertices), vertices, normal, thickness, low, high, sides }
    }

    /// The corners of the polygon.
    pub fn vertices(&self) -> &[DVec3] {
        &self.vertices
    }

    /// Whether points lie above and below the plane by more than a part of the slack of any pair.
    pub fn sides_of(&self, points: &[DVec3]) -> (bool, bool) {
        let side = Side::of(points.iter().map(|v| (*v - self.vertices[0]).dot(self.normal)), self.rounding);
        (side.above, side.below)
    }

    /// Heights over the plane that rounding may make.
    fn slack(&self, pair: &FacingPair) -> f64 {
        2.0 * (pair.slack.max(self.rounding) + self.thickness)
    }
}

/// The blockers of a pair found so far.
struct Search<'a> {
    pair: &'a FacingPair,
    /// The box around the pair, in scene coordinates.
    low: DVec3,
    high: DVec3,
    hidden: bool,
    blockers: Vec<usize>,
    /// Points whose convex hull holds every crossing of a plane by a segment between the polygons.
    crossings: Vec<DVec3>,
}

/// Whether any of some polygons, each looked at alone, would be found in the way of a pair.
pub(super) fn any_in_the_way<'s>(pair: &FacingPair, mut screens: impl Iterator<Item = &'s Screen>) -> bool {
    let mut search = Search::new(pair);
    screens.any(|screen| {
        search.visit(0, screen);
        search.hidden || !search.blockers.is_empty()
    })
}

/// How much of a pair one polygon blocks.
enum Between {
    Nothing,
    All,
    Some,
}

impl<'a> Search<'a> {
    fn new(pair: &'a FacingPair) -> Self {
        let corners = pair.i.iter().chain(&pair.j);
        let (low, high) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
        let (low, high) = (pair.origin + low - DVec3::splat(pair.slack), pair.origin + high + DVec3::splat(pair.slack));
        Self { pair, low, high, hidden: false, blockers: Vec::new(), crossings: Vec::new() }
    }

    fn visit(&mut self, k: usize, screen: &Screen) {
        let near = screen.low.cmple(self.high).all() && screen.high.cmpge(self.low).all();
        if self.hidden || !near {
            return;
        }
        match self.between(screen) {
            Between::Nothing => {}
            Between::All => self.hidden = true,
            Between::Some => self.blockers.push(k),
        }
    }

    fn result(mut self) -> Visibility {
        if self.hidden {
            Visibility::Hidden
        } else if self.blockers.is_empty() {
            Visibility::Clear
        } else {
            // The order of the hierarchy is of no meaning.
            self.blockers.sort_unstable();
            Visibility::Partial(self.blockers)
        }
    }

    fn between(&mut self, screen: &Screen) -> Between {
        let pair = self.pair;
        let (p, n) = (screen.vertices[0] - pair.origin, screen.normal);
        let slack = screen.slack(pair);
        let side = |v: &[DVec3]| Side::of(v.iter().map(|v| (*v - p).dot(n)), slack);
        let (i, j) = (side(&pair.i), side(&pair.j));
        if !((i.above && j.below) || (i.below && j.above)) {
            return Between::Nothing;
        }
        // Behind one of the two planes: nothing that the two see of each other passes there.
        let behind = |p: DVec3, n: DVec3| screen.vertices.iter().all(|v| (*v - pair.origin - p).dot(n) <= pair.slack);
        if behind(pair.i[0], pair.n_i) || behind(pair.j[0], pair.n_j) {
            return Between::Nothing;
        }
        let straddles = (i.above && i.below) || (j.above && j.below);
        self.cross(p, n, slack, straddles);
        let mut inside = !straddles;
        for (a, m) in &screen.sides {
            let a = *a - pair.origin;
            let (low, high) = self.crossings.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                let depth = (*x - a).dot(*m);
                (low.min(depth), high.max(depth))
            });
            if high <= slack {
                return Between::Nothing;
            }
            inside &= low >= -slack;
        }
        if inside { Between::All } else { Between::Some }
    }

    /// Collects the crossings of the plane through `p` with normal `n`.
    fn cross(&mut self, p: DVec3, n: DVec3, slack: f64, straddles: bool) {
        self.crossings.clear();
        let height = |v: DVec3| {
            let h = (v - p).dot(n);
            if h.abs() <= slack { 0.0 } else { h }
        };
        let meet = |a: DVec3, d_a: f64, b: DVec3, d_b: f64| a + (b - a) * (d_a / (d_a - d_b));
        for &a in &self.pair.i {
            let d_a = height(a);
            for &b in &self.pair.j {
                let d_b = height(b);
                // Corners in the plane are crossings themselves; two of them carry no weight.
                if d_a * d_b < 0.0 || ((d_a == 0.0) != (d_b == 0.0)) {
                    self.crossings.push(meet(a, d_a, b, d_b));
                }
            }
        }
        if straddles {
            for corners in [&self.pair.i, &self.pair.j] {
                for k in 0..corners.len() {
                    let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
                    let (d_a, d_b) = (height(a), height(b));
                    if d_a * d_b < 0.0 {
                        self.crossings.push(meet(a, d_a, b, d_b));
                    }
                }
            }
        }
    }
}

/// Unit normal into a polygon with normal `n`, in its plane, on the edge a b.
fn side(a: DVec3, b: DVec3, n: DVec3) -> Option<DVec3> {
    n.cross(b - a).try_normalize()
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
        let side = |(a, b)| side(a, b, n).map(|m| (m, m.dot(a - origin)));
        let sides = polygon.edges().filter_map(side).collect();
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
