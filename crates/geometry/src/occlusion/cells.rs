//! Which facet of a polygon a ray has met, from where it meets the polygon.
//!
//! Rays are followed to the polygons of a scene, which are few, and not to the facets that those are cut into, which are many. A
//! quadrilateral a b c d holds the points
//!
//! ```text
//! p = a + σ e₁ + τ e₂ + σ τ g,      e₁ = b − a,   e₂ = d − a,   g = a − b + c − d,
//! ```
//!
//! in a triangle or a polygon of more corners g is left out. With g = g₁ e₁ + g₂ e₂ and the coordinates x, y of p − a along e₁, e₂
//!
//! ```text
//! τ = 2y/(B + √(B² + 4 g₁ y)),   B = 1 + g₂ x − g₁ y,      σ = x/(1 + g₁ τ).
//! ```
//!
//! The rectangle of all (σ, τ) is cut into bins, about one a facet. A bin that one facet fills names it at once, as all do where a
//! quadrilateral is cut into a regular grid. The other
//! bins list the facets that may reach into them, and the one wins in which the point lies deepest.
//!
//! What is *not* here: hits. A point between facets that leave a hole (what a solid covers is none) belongs to nobody.

use glam::{DVec2, DVec3};

use super::NOBODY;
use crate::{Facets, Polygon};

/// Differences of σ and τ, in bins, that count as rounding.
const ROUNDING: f64 = 1e-9;

/// Bins of a polygon along an axis at most.
const MOST: f64 = 4096.0;

/// Least ratio of areas in a chart of a quadrilateral; flatter ones are charted like triangles.
const FLAT: f64 = 0.05;

/// A point outside all facets by more than this share of the polygon's diameter belongs to none: what mesh lines along contacts leave open.
const HOLE: f64 = 1e-6;

/// The facets of every polygon.
pub(super) struct Cells {
    grids: Vec<Grid>,
    /// Facets of all bins that are not filled by one, bin by bin.
    candidates: Vec<Candidate>,
}

/// The bins of a polygon.
pub(super) struct Grid {
    pub chart: Chart,
    /// Bins along both axes.
    pub count: [u32; 2],
    bins: Vec<Bin>,
    /// Distance by which a point may lie outside all facets.
    slack: f64,
}

/// σ and τ of the points of a polygon, in bins.
pub(super) struct Chart {
    /// a.
    pub corner: DVec3,
    /// x and y of p are these vectors times p − a.
    pub duals: [DVec3; 2],
    /// g₁ and g₂.
    pub twist: [f64; 2],
    /// Lowest σ and τ.
    pub least: [f64; 2],
    /// Bins a unit of σ and of τ.
    pub steps: [f64; 2],
    /// Largest change of σ or τ with x and y.
    pub steep: f64,
}

/// What lies in a bin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Bin {
    /// One facet fills it, or none reaches into it.
    One(u32),
    /// These candidates.
    Some { begin: u32, end: u32 },
}

/// A facet that may hold a point.
struct Candidate {
    owner: u32,
    /// A point of each edge, and the unit normal into the facet, in its plane.
    sides: Vec<(DVec3, DVec3)>,
}

/// A facet in the coordinates of its polygon.
struct Member<'a> {
    owner: u32,
    polygon: &'a Polygon,
    lo: DVec2,
    hi: DVec2,
    /// Whether it is the rectangle from `lo` to `hi`.
    rectangle: bool,
}

impl Cells {
    /// The facets on `polygons`; `carriers` names for every polygon of `facets` the one in which it lies.
    pub fn new(polygons: &[Polygon], facets: &Facets, carriers: &[u32]) -> Self {
        let mut members: Vec<Vec<(u32, &Polygon)>> = vec![Vec::new(); polygons.len()];
        for ((owner, part), &carrier) in facets.iter_polygons().zip(carriers) {
            members[carrier as usize].push((owner as u32, part));
        }
        let mut candidates = Vec::new();
        let grids = polygons.iter().zip(members).map(|(p, members)| Grid::new(p, &members, &mut candidates)).collect();
        Self { grids, candidates }
    }

    /// The bins of polygon k.
    #[inline(always)]
    pub fn grid(&self, k: usize) -> &Grid {
        &self.grids[k]
    }

    /// The facet of polygon k at a point, or [`NOBODY`].
    pub fn owner(&self, k: usize, point: DVec3) -> u32 {
        let grid = &self.grids[k];
        let at = grid.chart.bins(grid.chart.place(point));
        // A point on the border may lie a little outside; conversion saturates.
        let [i, j] = [0, 1].map(|axis| (at[axis] as u32).min(grid.count[axis] - 1));
        match grid.bin(i, j) {
            Bin::One(owner) => owner,
            Bin::Some { begin, end } => {
                let candidates = &self.candidates[begin as usize..end as usize];
                let depths = candidates.iter().map(|c| (c.depth(point), c.owner));
                // The first of equals.
                let deepest = depths.fold((f64::NEG_INFINITY, NOBODY), |a, b| if b.0 > a.0 { b } else { a });
                if deepest.0 < -grid.slack { NOBODY } else { deepest.1 }
            }
        }
    }
}

impl Candidate {
    fn new(owner: u32, polygon: &Polygon) -> Self {
        let side = |(a, b): (DVec3, DVec3)| Some((a, polygon.normal().cross(b - a).try_normalize()?));
        Self { owner, sides: polygon.edges().filter_map(side).collect() }
    }

    /// Distance of a point from the nearest edge, negative outside.
    fn depth(&self, point: DVec3) -> f64 {
        self.sides.iter().map(|&(a, inward)| (point - a).dot(inward)).fold(f64::INFINITY, f64::min)
    }
}

impl Grid {
    fn new(polygon: &Polygon, members: &[(u32, &Polygon)], candidates: &mut Vec<Candidate>) -> Self {
        let mut chart = Chart::new(polygon);
        let members: Vec<Member> = members.iter().map(|&(owner, part)| Member::new(owner, part, &chart)).collect();
        let (lo, hi) = hull(polygon.vertices().iter().map(|v| chart.place(*v)));
        // As many bins as facets of the usual size go into the rectangle.
        let count = [0, 1].map(|axis| {
            let mut sizes: Vec<f64> = members.iter().map(|m| m.hi[axis] - m.lo[axis]).collect();
            let middle = sizes.len() / 2;
            let usual = if sizes.is_empty() { 1.0 } else { *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 };
            ((hi[axis] - lo[axis]) / usual).round().clamp(1.0, MOST)
        });
        chart.least = lo.to_array();
        chart.steps = [count[0] / (hi.x - lo.x), count[1] / (hi.y - lo.y)];
        let mut grid =
            Self { chart, count: count.map(|n| n as u32), bins: Vec::new(), slack: HOLE * polygon.diameter() };
        grid.fill(&members, candidates);
        grid
    }

    /// Puts the facets into the bins.
    fn fill(&mut self, members: &[Member<'_>], candidates: &mut Vec<Candidate>) {
        let (width, height) = (self.count[0] as usize, self.count[1] as usize);
        let mut reach: Vec<(u32, u32)> = Vec::with_capacity(members.len());
        let mut filled = vec![0_u32; width * height];
        for (k, member) in (0..).zip(members) {
            let (lo, hi) = (self.chart.bins(member.lo), self.chart.bins(member.hi));
            let first = |x: f64| (x + ROUNDING).max(0.0) as usize;
            let end = |x: f64, n: usize| ((x - ROUNDING).ceil().max(0.0) as usize).min(n);
            let whole = |x: f64| (x - x.round()).abs() <= ROUNDING;
            let fills = member.rectangle && whole(lo.x) && whole(lo.y) && whole(hi.x) && whole(hi.y);
            for j in first(lo.y)..end(hi.y, height) {
                for i in first(lo.x)..end(hi.x, width) {
                    let bin = j * width + i;
                    reach.push((bin as u32, k));
                    filled[bin] += if fills { 1 } else { 2 };
                }
            }
        }
        self.bins = vec![Bin::One(NOBODY); width * height];
        reach.retain(|&(bin, k)| {
            let alone = filled[bin as usize] == 1;
            if alone {
                self.bins[bin as usize] = Bin::One(members[k as usize].owner);
            }
            !alone
        });
        reach.sort_unstable();
        for bin in reach.chunk_by(|a, b| a.0 == b.0) {
            let begin = candidates.len() as u32;
            candidates.extend(bin.iter().map(|&(_, k)| {
                let Member { owner, polygon, .. } = members[k as usize];
                Candidate::new(owner, polygon)
            }));
            self.bins[bin[0].0 as usize] = Bin::Some { begin, end: candidates.len() as u32 };
        }
    }

    /// Bin (i, j).
    #[inline(always)]
    pub fn bin(&self, i: u32, j: u32) -> Bin {
        self.bins[j as usize * self.count[0] as usize + i as usize]
    }
}

impl<'a> Member<'a> {
    fn new(owner: u32, polygon: &'a Polygon, chart: &Chart) -> Self {
        let places: Vec<DVec2> = polygon.vertices().iter().map(|v| chart.place(*v)).collect();
        let (mut lo, mut hi) = hull(places.iter().copied());
        let on_border = |p: &DVec2, axis: usize| {
            let size = hi[axis] - lo[axis];
            (p[axis] - lo[axis]).min(hi[axis] - p[axis]) <= ROUNDING * size
        };
        // Convex, and all vertices in corners of the box.
        let rectangle = places.len() == 4 && places.iter().all(|p| on_border(p, 0) && on_border(p, 1));
        if !rectangle {
            // Edges across the grid are curved in σ and τ.
            let bulge =
                2.0 * chart.steep * (chart.twist[0].abs() + chart.twist[1].abs()) * (hi.x - lo.x) * (hi.y - lo.y);
            (lo, hi) = (lo - bulge, hi + bulge);
        }
        Self { owner, polygon, lo, hi, rectangle }
    }
}

fn hull(places: impl Iterator<Item = DVec2>) -> (DVec2, DVec2) {
    places.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)))
}

impl Chart {
    /// The chart with a bin a unit.
    fn new(polygon: &Polygon) -> Self {
        let (v, n) = (polygon.vertices(), polygon.normal());
        let (first, last) = (v[1] - v[0], v[v.len() - 1] - v[0]);
        let span = first.cross(last).dot(n);
        let mut chart = Self {
            corner: v[0],
            duals: [DVec3::ZERO; 2],
            twist: [0.0; 2],
            least: [0.0; 2],
            steps: [1.0; 2],
            steep: 1.0,
        };
        if span <= 1e-6 * first.length() * last.length() {
            let (x, y) = polygon.frame();
            return Self { duals: [x, y], ..chart };
        }
        chart.duals = [last.cross(n) / span, n.cross(first) / span];
        if let &[a, b, c, d] = v {
            let twist = chart.duals.map(|dual| dual.dot((a - b) + (c - d)));
            // The determinant of ∂(x, y)/∂(σ, τ) is linear.
            let least = 1.0 + twist[0].min(twist[1]).min(twist[0] + twist[1]).min(0.0);
            if least > FLAT {
                (chart.twist, chart.steep) = (twist, (1.0 + twist[0].abs() + twist[1].abs()) / least);
            }
        }
        chart
    }

    /// (σ, τ) of a point.
    fn place(&self, point: DVec3) -> DVec2 {
        let [x, y] = self.duals.map(|dual| dual.dot(point - self.corner));
        let [g1, g2] = self.twist;
        let b = 1.0 + g2 * x - g1 * y;
        let tau = 2.0 * y / (b + (b * b + 4.0 * g1 * y).max(0.0).sqrt());
        DVec2::new(x / (1.0 + g1 * tau), tau)
    }

    fn bins(&self, place: DVec2) -> DVec2 {
        (place - DVec2::from(self.least)) * DVec2::from(self.steps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Random, cornell_box, scene_of};
    use crate::{Mesh, MeshSettings, Occluders, Scene, Subdivision};

    fn mesh(scene: &Scene, k: u32) -> (Mesh, Occluders) {
        let occluders = Occluders::of_scene(scene);
        let settings = MeshSettings { elements: Subdivision::Uniform(k), patches: None, contacts: true };
        let mesh = Mesh::new(scene, &occluders, &settings).unwrap();
        let parts = Occluders::of_parts(scene, &mesh.element_facets, &mesh.faces());
        (mesh, parts)
    }

    /// A slanted quadrilateral, a triangle and a heptagon, apart from each other, and the Cornell box with what its blocks cut.
    fn scenes() -> [Scene; 2] {
        let heptagon = (0..7).map(|k| {
            let (y, x) = (f64::from(k) / 7.0 * std::f64::consts::TAU).sin_cos();
            DVec3::new(x, y, 3.0)
        });
        let at = |z: f64, points: &[(f64, f64)]| points.iter().map(|&(x, y)| DVec3::new(x, y, z)).collect::<Vec<_>>();
        let loops = [
            at(0.0, &[(0.0, 0.0), (3.0, 0.0), (4.0, 2.0), (0.2, 1.5)]),
            at(1.0, &[(0.0, 0.0), (3.0, 0.5), (1.0, 2.0)]),
            heptagon.collect(),
        ];
        [scene_of(&loops), scene_of(&cornell_box())]
    }

    /// Points between the corners, a hundredth of the way or more from each edge.
    #[test]
    fn a_point_inside_a_facet_belongs_to_it() {
        let mut random = Random(3);
        for scene in scenes() {
            for k in [1, 4, 7] {
                let (mesh, parts) = mesh(&scene, k);
                let (cells, faces) = (parts.cells.as_ref().unwrap(), mesh.faces());
                for (e, polygon) in mesh.element_facets.iter_polygons() {
                    for _ in 0..4 {
                        let corner = polygon.sample(random.unit(), random.unit());
                        let point = polygon.centroid().lerp(corner, 0.99);
                        assert_eq!(cells.owner(faces[e] as usize, point), e as u32, "element {e} of {k} × {k}");
                    }
                }
            }
        }
    }

    /// Cells of a quadrilateral that is no parallelogram are straight in σ and τ: only cut cells have lists.
    #[test]
    fn whole_cells_of_quadrilaterals_fill_their_bins() {
        let [slanted, cornell] = scenes();
        let lists = |scene: &Scene, polygon: usize| {
            let (_, parts) = mesh(scene, 6);
            let bins = &parts.cells.as_ref().unwrap().grid(polygon).bins;
            (bins.len(), bins.iter().filter(|bin| matches!(bin, Bin::Some { .. })).count())
        };
        assert_eq!(lists(&slanted, 0), (36, 0));
        // Upright and inverted triangles share bins, beyond the long edge there are none.
        assert_eq!(lists(&slanted, 1), (36, 21));
        assert_eq!(lists(&cornell, 6), (36, 0));
        let (bins, cut) = lists(&cornell, 0);
        assert!(bins == 36 && (1..24).contains(&cut), "{cut} cells cut by blocks");
    }

    /// The floor under the middle of the short block, when what it covers is left out.
    #[test]
    fn what_no_facet_holds_belongs_to_nobody() {
        let scene = scene_of(&cornell_box());
        let (mesh, _) = mesh(&scene, 8);
        let (mut exposed, mut carriers) = (Facets::new(), Vec::new());
        for (e, element) in mesh.elements.iter().enumerate().filter(|(_, element)| !element.covered) {
            exposed.push(mesh.element_facets.polygons(e).to_vec(), false);
            carriers.push(element.surface);
        }
        let cells = Cells::new(Occluders::of_scene(&scene).polygons(), &exposed, &carriers);
        assert_eq!(cells.owner(0, DVec3::new(186.0, 0.0, 168.0)), NOBODY);
        assert_ne!(cells.owner(0, DVec3::new(30.0, 0.0, 168.0)), NOBODY);
    }
}
