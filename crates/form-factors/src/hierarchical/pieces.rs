//! The tree over the elements of one piece of a surface: its grid in quarters of quarters.

use std::ops::Range;

use glam::{DVec2, DVec3};
use radiosity_geometry::mesh::Piece;
use radiosity_geometry::polygon::area_vector;
use radiosity_geometry::{Facets, Polygon};

use super::tree::{Frame, NONE, Node, SKEW};

/// Most parts of a cell that hang on one node.
const PARTS: usize = 4;
/// Length of an axis at which the longer side of a node is halved alone.
const LONG: f64 = 1.5;

/// What a node sums over its elements, in the plane's coordinates about a point of the plane.
#[derive(Clone, Copy, Default)]
struct Moments {
    area: f64,
    first: DVec2,
    /// ∫ x², ∫ xy, ∫ y².
    second: [f64; 3],
}

impl std::ops::AddAssign for Moments {
    fn add_assign(&mut self, other: Self) {
        self.area += other.area;
        self.first += other.first;
        (0..3).for_each(|k| self.second[k] += other.second[k]);
    }
}

/// A plane with coordinates.
#[derive(Clone, Copy)]
struct Plane {
    origin: DVec3,
    x: DVec3,
    y: DVec3,
}

impl Plane {
    /// The plane of a piece, x along its first edge.
    fn of(piece: &Piece, normal: DVec3) -> Self {
        let corners = piece.corners();
        let along = corners[1] - corners[0];
        let x = (along - normal * along.dot(normal)).normalize_or(normal.any_orthonormal_vector());
        Self { origin: corners[0], x, y: normal.cross(x) }
    }

    fn at(&self, v: DVec3) -> DVec2 {
        DVec2::new((v - self.origin).dot(self.x), (v - self.origin).dot(self.y))
    }

    fn moments(&self, polygon: &Polygon) -> Moments {
        let mut sum = Moments::default();
        let corners = polygon.vertices();
        let a = self.at(corners[0]);
        for pair in corners[1..].windows(2) {
            let (b, c) = (self.at(pair[0]), self.at(pair[1]));
            let area = 0.5 * (b - a).perp_dot(c - a);
            let all = a + b + c;
            let of = |p: DVec2, q: DVec2| p.x * q.y;
            let swap = |p: DVec2| DVec2::new(p.y, p.x);
            let product = |f: &dyn Fn(DVec2) -> f64| area / 12.0 * (f(a) + f(b) + f(c) + f(all));
            sum += Moments {
                area,
                first: all * (area / 3.0),
                second: [product(&|p| p.x * p.x), product(&|p| of(p, p)), product(&|p| of(swap(p), p))],
            };
        }
        sum
    }
}

/// The nodes of one piece, numbered from 0.
pub(super) struct Tree {
    pub nodes: Vec<Node>,
    pub parents: Vec<u32>,
    pub order: Vec<u32>,
    pub normal: DVec3,
}

/// Whether corners are those of a parallelogram, to [`SKEW`].
fn is_parallelogram(corners: &[DVec3]) -> bool {
    let &[a, b, c, d] = corners else { return false };
    let shortest = a.distance(b).min(b.distance(c)).min(c.distance(d)).min(d.distance(a));
    (a - b + c - d).length() <= 2.0 * f64::from(SKEW) * shortest
}

/// The tree of one piece while it is built.
pub(super) struct Builder<'a> {
    facets: &'a Facets,
    places: &'a [[u32; 2]],
    frame: &'a Frame,
    plane: Plane,
    /// Size of a cell along the grid's two directions.
    cell: [f64; 2],
    /// Area of a cell if the piece is a parallelogram.
    grid: Option<f64>,
    tree: Tree,
}

impl<'a> Builder<'a> {
    pub fn tree(facets: &'a Facets, places: &'a [[u32; 2]], frame: &'a Frame, piece: &Piece, run: Range<u32>) -> Tree {
        let normal = facets.polygons(run.start as usize)[0].normal();
        let (n, corners) = (piece.divisions(), piece.corners());
        let last = corners[corners.len() - 1];
        let cell = [corners[0].distance(corners[1]) / f64::from(n.0), corners[0].distance(last) / f64::from(n.1)];
        let tree = Tree { nodes: Vec::new(), parents: Vec::new(), order: run.collect(), normal };
        let grid = is_parallelogram(corners).then(|| area_vector(corners).length() / piece.len() as f64);
        let mut builder = Self { facets, places, frame, plane: Plane::of(piece, normal), cell, grid, tree };
        builder.push(NONE);
        let all = 0..builder.tree.order.len();
        builder.expand(0, all, [0..n.0, 0..n.1]);
        builder.tree
    }

    fn push(&mut self, parent: u32) {
        self.tree.nodes.push(Node::EMPTY);
        self.tree.parents.push(parent);
    }

    /// Makes node k of the elements at `range` of the order, all of them in the given columns and rows.
    fn expand(&mut self, k: u32, range: Range<usize>, grid: [Range<u32>; 2]) -> Moments {
        let (begin, end) = (range.start as u32, range.end as u32);
        let (mut moments, mut radius, mut first, mut count) = (Moments::default(), 0.0_f64, 0, 0);
        let cells = grid[0].len() * grid[1].len();
        let mut parallelogram = range.len() == cells;
        if range.len() == 1 {
            let polygon = self.polygon(range.start);
            moments = self.plane.moments(polygon);
            let centre = self.plane.origin + self.in_space(moments.first / moments.area);
            radius = polygon.vertices().iter().map(|v| v.distance(centre)).fold(0.0, f64::max) * self.frame.scale;
            parallelogram = is_parallelogram(polygon.vertices());
        } else {
            let parts = self.split(range, &grid);
            (first, count) = (self.tree.nodes.len() as u32, parts.len() as u16);
            parts.iter().for_each(|_| self.push(k));
            for (child, (range, grid)) in (first..).zip(parts) {
                moments += self.expand(child, range, grid);
            }
            // Whole cells of a grid that is a parallelogram make another one.
            let whole = |cell: f64| (moments.area / (cells as f64 * cell) - 1.0).abs() <= f64::from(SKEW);
            parallelogram = parallelogram && self.grid.is_some_and(whole);
        }
        // Centre, axes and radius.
        let mean = moments.first / moments.area;
        let centre = self.frame.point(self.plane.origin + self.in_space(mean));
        let [xx, xy, yy] = moments.second.map(|m| m / moments.area);
        let (xx, xy, yy) = (xx - mean.x * mean.x, xy - mean.x * mean.y, (yy - mean.y * mean.y).max(0.0));
        let high = yy.sqrt();
        let lean = if high > 0.0 { xy / high } else { 0.0 };
        let wide = (xx - lean * lean).max(0.0).sqrt();
        let axis = |v: DVec2| (self.in_space(v) * (3.0_f64.sqrt() * self.frame.scale)).as_vec3();
        let (u, v) = (axis(DVec2::new(wide, 0.0)), axis(DVec2::new(lean, high)));
        for child in first..first + u32::from(count) {
            let node = &self.tree.nodes[child as usize];
            parallelogram = parallelogram && node.parallelogram;
            radius = radius.max(f64::from(node.centre.distance(centre) + node.radius));
        }
        let area = (moments.area * self.frame.scale * self.frame.scale) as f32;
        let mut radius = 1.00001 * radius as f32;
        if parallelogram {
            radius = (1.0 + SKEW) * (u + v).length().max((u - v).length());
        }
        self.tree.nodes[k as usize] =
            Node { centre, u, v, radius, area, plane: 0, first, count, parallelogram, begin, end };
        moments
    }

    fn polygon(&self, place: usize) -> &'a Polygon {
        &self.facets.polygons(self.tree.order[place] as usize)[0]
    }

    fn in_space(&self, v: DVec2) -> DVec3 {
        self.plane.x * v.x + self.plane.y * v.y
    }

    /// Quarters of the grid, or halves of its longer side; parts of one cell by themselves, many of them in halves. The order is sorted
    /// accordingly.
    fn split(&mut self, range: Range<usize>, grid: &[Range<u32>; 2]) -> Vec<(Range<usize>, [Range<u32>; 2])> {
        let cells = [grid[0].len(), grid[1].len()];
        if cells == [1, 1] {
            let one = |range: Range<usize>| (range, grid.clone());
            if range.len() <= PARTS {
                return range.map(|k| one(k..k + 1)).collect();
            }
            let middle = range.start + range.len() / 2;
            return vec![one(range.start..middle), one(middle..range.end)];
        }
        let size = [0, 1].map(|k| cells[k] as f64 * self.cell[k]);
        let halve = |k: usize| cells[k] > 1 && (cells[1 - k] == 1 || size[k] * LONG > size[1 - k]);
        let middle = [0, 1].map(|k| if halve(k) { (grid[k].start + grid[k].end) / 2 } else { grid[k].end });
        let places = self.places;
        let quarter = |e: u32| {
            let [i, j] = places[e as usize];
            usize::from(i >= middle[0]) + 2 * usize::from(j >= middle[1])
        };
        self.tree.order[range.clone()].sort_by_key(|&e| quarter(e));
        let mut parts = Vec::with_capacity(4);
        let mut begin = range.start;
        for q in 0..4 {
            let len = self.tree.order[begin..range.end].partition_point(|&e| quarter(e) <= q);
            let side = |k: usize, upper: bool| if upper { middle[k]..grid[k].end } else { grid[k].start..middle[k] };
            if len > 0 {
                parts.push((begin..begin + len, [side(0, q & 1 == 1), side(1, q & 2 == 2)]));
            }
            begin += len;
        }
        parts
    }
}
