//! Symmetries of what exchanges light: rows that are mirror images of others.
//!
//! An isometry of space that maps the elements onto themselves, polygon by polygon, and what blocks as well, changes no form factor: of an orbit of elements
//! one row is computed ([`Mirrors`] says how, and that of orbits of q elements one pair in q remains). Materials do not matter, since F has only to do with geometry: a lamp
//! in one corner of a cube breaks nothing.
//!
//! *Which* are looked for: the 48 signed permutations of the axes about the centre of the box around all elements, the symmetries of a cube; not
//! rotations by other angles, those of a room that stands askew to the axes, of parts of a room, or translations. They are found *on the mesh*: elements are put in a table by their
//! centroids, and the image of each must be one of them, corner on corner, front on front, to 16 ε of the largest coordinate. With those that hold their products hold
//! as well, so that a cube takes three looks at its elements and not 48, and with one that does not hold a whole coset is out. O(m) each, and no more than
//! [`MOST_LOOKS`] · m altogether.
//!
//! *Where* they are exact: the estimator must give mirrored pairs the same value. The product and contour rules for whole quadrilaterals do, to rounding (1e-14 of the
//! smaller area), at any tolerance; those for triangles if the corner that comes first is mapped to the one that comes first. Pairs between which something lies are
//! integrated adaptively, by decisions that have no such symmetry, and are as good as the tolerance they are asked for: at 1e-6 copies differ by up to 1e-7 of the smaller area, at 1e-11 by
//! 3e-14. So where anything can block symmetry is used only if [`ROUNDING`] is asked for, and segments that are drawn never. Rows of rays and hemicubes have
//! directions of their own. Stores of lists and of nothing, links, and stores without small pairs compute all rows.

use std::collections::BTreeSet;

use glam::DVec3;
use radiosity_core::mix;
use radiosity_form_factors::Mirrors;
use radiosity_form_factors::analytic::PartialVisibility;
use radiosity_geometry::{Facets, Polygon};

use crate::{Geometry, Method, Shape, Store, Strategy};

/// Looks at elements, for each of them: five that succeed are all there can be, and those that fail are mostly told by a few elements.
const MOST_LOOKS: usize = 16;
/// Error of form factors, asked for, from which on copies of pairs that something blocks agree to rounding.
const ROUNDING: f64 = 1e-12;
/// Distance within which corners are the same, in units of the largest coordinate.
const NEAR: f64 = 16.0 * f64::EPSILON;
/// Cells of the table along the longest side of the box around all elements: a number without meaning to a mesh.
const CELLS: f64 = 761_539.3;
/// Elements from one to the next that is looked at, so that one that has no image is found soon.
const STRIDE: usize = 16;

/// x ↦ c + P(x − c), P a signed permutation of the axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Isometry {
    /// The axis that each axis is taken from.
    from: [usize; 3],
    /// Whether it is turned round.
    turned: [bool; 3],
}

impl Isometry {
    const IDENTITY: Self = Self { from: [0, 1, 2], turned: [false; 3] };

    /// All 48, those of which fewer make the others first: by falling order.
    fn all() -> Vec<Self> {
        let from = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
        let turned = (0..8).map(|bits| [bits & 1 != 0, bits & 2 != 0, bits & 4 != 0]);
        let mut all: Vec<Self> =
            turned.flat_map(|turned| from.into_iter().map(move |from| Self { from, turned })).collect();
        all.sort_by_key(|g| std::cmp::Reverse(g.order()));
        all
    }

    /// First `other`, then this.
    fn after(self, other: Self) -> Self {
        Self {
            from: self.from.map(|axis| other.from[axis]),
            turned: [0, 1, 2].map(|k| self.turned[k] != other.turned[self.from[k]]),
        }
    }

    /// How many times it is done until nothing has changed.
    fn order(self) -> usize {
        let powers = std::iter::successors(Some(self), |power| Some(self.after(*power)));
        powers.take_while(|power| *power != Self::IDENTITY).count() + 1
    }

    /// Whether it turns what runs counter-clockwise to clockwise.
    fn reflects(self) -> bool {
        let odd = self.from.iter().enumerate().filter(|(k, axis)| *k == **axis).count() == 1;
        self.turned.into_iter().fold(odd, |odd, turned| odd != turned)
    }

    /// The image of a point; `twice` is 2c.
    fn of(self, x: DVec3, twice: DVec3) -> DVec3 {
        let half = 0.5 * twice;
        let along = |k: usize| {
            let from = self.from[k];
            match (self.turned[k], from == k) {
                (false, true) => x[k],
                (true, true) => twice[k] - x[k],
                (turned, false) => half[k] + if turned { half[from] - x[from] } else { x[from] - half[from] },
            }
        };
        DVec3::new(along(0), along(1), along(2))
    }
}

/// The box around all elements and what follows from it.
#[derive(Clone, Copy, Debug)]
struct Frame {
    low: DVec3,
    high: DVec3,
    /// Distance within which corners are the same.
    near: f64,
    /// Whether it matters at which corner a loop begins.
    begins: bool,
}

impl Frame {
    fn around(facets: &Facets, begins: bool) -> Option<Self> {
        let corners = facets.iter_polygons().flat_map(|(_, polygon)| polygon.vertices());
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = corners.fold(none, |(low, high), v| (low.min(*v), high.max(*v)));
        let near = NEAR * low.abs().max(high.abs()).max_element();
        (high - low).is_finite().then_some(Self { low, high, near, begins })
    }

    /// Isometries of the box.
    fn allows(&self, g: Isometry) -> bool {
        let size = self.high - self.low;
        (0..3).all(|k| (size[k] - size[g.from[k]]).abs() <= 2.0 * self.near)
    }

    fn same(&self, a: DVec3, b: DVec3) -> bool {
        (a - b).abs().max_element() <= self.near
    }

    /// Whether `g` takes polygon `p` to `q`, with its front if `front`.
    fn maps(&self, g: Isometry, p: &Polygon, q: &Polygon, front: bool) -> bool {
        let (p, q) = (p.vertices(), q.vertices());
        let n = p.len();
        let image = |k: usize| g.of(p[k], self.low + self.high);
        let first = image(0);
        let Some(begin) = (q.len() == n).then(|| q.iter().position(|v| self.same(*v, first))).flatten() else {
            return false;
        };
        let runs = |back: bool| {
            (1..n).all(|k| self.same(image(k), q[if back { (begin + n - k) % n } else { (begin + k) % n }]))
        };
        if !front {
            return runs(false) || runs(true);
        }
        // Loops that are no quadrilaterals are cut into such from their first corner on, and all but triangles in one direction.
        let alike = n == 4 || (begin == 0 && (n == 3 || !g.reflects()));
        (alike || !self.begins) && runs(g.reflects())
    }
}

/// Polygons by the places of their centroids.
struct Places<'a> {
    frame: Frame,
    /// Polygons, each with what it belongs to.
    polygons: Vec<(u32, &'a Polygon)>,
    /// One more than a polygon, or 0: open addressing.
    slots: Vec<u32>,
}

impl<'a> Places<'a> {
    fn new(frame: Frame, polygons: Vec<(u32, &'a Polygon)>) -> Self {
        let slots = vec![0; (2 * polygons.len()).next_power_of_two()];
        let mut places = Self { frame, polygons, slots };
        for k in 0..places.polygons.len() {
            let cell = places.cell(places.polygons[k].1.centroid(), 0.0);
            let free = places.probe(cell).find(|slot| places.slots[*slot] == 0).expect("twice as many slots");
            places.slots[free] = k as u32 + 1;
        }
        places
    }

    /// The cell of a point moved by a distance along all axes.
    fn cell(&self, x: DVec3, by: f64) -> [i64; 3] {
        let scale = CELLS / (self.frame.high - self.frame.low).max_element();
        ((x + DVec3::splat(by) - self.frame.low) * scale).to_array().map(|x| x.floor() as i64)
    }

    /// Slots where polygons of a cell may be, to the first that is free.
    fn probe(&self, cell: [i64; 3]) -> impl Iterator<Item = usize> + use<> {
        let [x, y, z] = cell.map(|x| x as u64);
        let (hash, mask) = (mix(x ^ y.rotate_left(21) ^ z.rotate_left(42)) as usize, self.slots.len() - 1);
        (0..=mask).map(move |k| (hash + k) & mask)
    }

    /// What the image of `polygon` belongs to.
    fn image(&self, g: Isometry, polygon: &Polygon, front: bool) -> Option<u32> {
        let frame = &self.frame;
        let at = g.of(polygon.centroid(), frame.low + frame.high);
        // Centroids round as corners do. A cell is much larger than that, so that there are seldom two along an axis.
        let (low, high) = (self.cell(at, -2.0 * frame.near), self.cell(at, 2.0 * frame.near));
        let in_cell = |cell: [i64; 3]| {
            let taken = self.probe(cell).map(|slot| self.slots[slot]).take_while(|taken| *taken > 0);
            let mut candidates = taken.map(|k| self.polygons[k as usize - 1]);
            candidates.find(|(_, candidate)| frame.maps(g, polygon, candidate, front)).map(|(of, _)| of)
        };
        if low == high {
            return in_cell(low);
        }
        let either = |k: usize| low[k]..=high[k];
        either(0).flat_map(|x| either(1).flat_map(move |y| either(2).map(move |z| [x, y, z]))).find_map(in_cell)
    }
}

/// Facets, and where isometries take them.
struct Images<'a> {
    facets: &'a Facets,
    places: Places<'a>,
}

impl<'a> Images<'a> {
    fn new(frame: Frame, facets: &'a Facets) -> Self {
        let polygons = facets.iter_polygons().map(|(k, polygon)| (k as u32, polygon)).collect();
        Self { facets, places: Places::new(frame, polygons) }
    }

    /// Where `g` takes every facet, if they are mapped onto themselves; each look is taken from `looks`, and none is left if they have gone.
    fn of(&self, g: Isometry, looks: &mut usize) -> Option<Vec<u32>> {
        const NONE: u32 = u32::MAX;
        let m = self.facets.len();
        let (mut map, mut taken) = (vec![NONE; m], vec![false; m]);
        for k in (0..STRIDE).flat_map(|begin| (begin..m).step_by(STRIDE)) {
            *looks = looks.checked_sub(1)?;
            let polygons = self.facets.polygons(k);
            for polygon in polygons {
                let image = self.places.image(g, polygon, true)?;
                if map[k] == NONE {
                    map[k] = image;
                }
                if map[k] != image {
                    return None;
                }
            }
            let image = map[k] as usize;
            if polygons.is_empty() {
                continue;
            }
            let alike = self.facets.polygons(image).len() == polygons.len()
                && self.facets.covered(image) == self.facets.covered(k);
            if !alike || std::mem::replace(&mut taken[image], true) {
                return None;
            }
        }
        // What has no polygons is where it was.
        map.iter_mut().enumerate().filter(|(_, image)| **image == NONE).for_each(|(k, image)| *image = k as u32);
        Some(map)
    }
}

/// A symmetry and where it takes sources and targets.
#[derive(Clone)]
struct Found {
    g: Isometry,
    maps: Vec<Vec<u32>>,
}

impl Found {
    fn after(&self, other: &Self) -> Self {
        let compose = |(own, other): (&Vec<u32>, &Vec<u32>)| other.iter().map(|&k| own[k as usize]).collect();
        Self { g: self.g.after(other.g), maps: self.maps.iter().zip(&other.maps).map(compose).collect() }
    }
}

/// The group of all isometries that map facets and blockers onto themselves; the identity first. `begins` tells whether it matters at which corner a loop begins.
fn group(lists: &[&Facets], blockers: &[Polygon], begins: bool) -> Option<Vec<Found>> {
    let frame = Frame::around(lists[0], begins)?;
    let images: Vec<Images<'_>> = lists.iter().map(|facets| Images::new(frame, facets)).collect();
    let walls = Places::new(frame, (0..).zip(blockers).collect());
    let mut looks = MOST_LOOKS * lists.iter().map(|facets| facets.len()).sum::<usize>();
    let identity = lists.iter().map(|facets| (0..facets.len() as u32).collect()).collect();
    let mut found = vec![Found { g: Isometry::IDENTITY, maps: identity }];
    let mut decided = BTreeSet::from([Isometry::IDENTITY]);
    for g in Isometry::all().into_iter().filter(|g| frame.allows(*g)) {
        if decided.contains(&g) {
            continue;
        }
        let blocks = blockers.iter().all(|wall| walls.image(g, wall, false).is_some());
        let maps = blocks.then(|| images.iter().map(|images| images.of(g, &mut looks)).collect()).flatten();
        let Some(maps) = maps else {
            // If g h or h g held, so would g.
            decided.extend(found.iter().flat_map(|h| [g.after(h.g), h.g.after(g)]));
            continue;
        };
        extend(&mut found, Found { g, maps });
        decided.extend(found.iter().map(|h| h.g));
    }
    (found.len() > 1).then_some(found)
}

/// Makes a group larger by one more symmetry and all products with it: coset by coset (Dimino's algorithm, G. Butler 1991).
fn extend(group: &mut Vec<Found>, by: Found) {
    let order = group.len();
    let mut known: BTreeSet<Isometry> = group.iter().map(|found| found.g).collect();
    let mut begin = 0;
    while begin < group.len() {
        // What the first element of a coset is taken to by the group and by the new symmetry begins the others.
        for k in 0..=order {
            let (after, first) = (if k < order { &group[k] } else { &by }, &group[begin]);
            if known.contains(&after.g.after(first.g)) {
                continue;
            }
            let product = after.after(first);
            let coset: Vec<Found> = group[..order].iter().map(|h| product.after(h)).collect();
            known.extend(coset.iter().map(|found| found.g));
            group.extend(coset);
        }
        begin += order;
    }
}

/// Which rows of `strategy` between the facets of `geometry` are mirror images of others, if any are.
pub(super) fn mirrors(geometry: &Geometry<'_>, strategy: &Strategy) -> Option<Mirrors> {
    let agrees = agrees(strategy.method);
    if !copies(strategy) || !(geometry.blockers().is_empty() || agrees) {
        return None;
    }
    let (elements, patches) = (geometry.elements(), geometry.patches());
    let (lists, sources, targets) = match strategy.shape {
        Shape::Full => (vec![elements], 0, 0),
        Shape::ElementsToPatches | Shape::TwoLevel => (vec![elements, patches], 0, 1),
        Shape::PatchesToElements => (vec![elements, patches], 1, 0),
    };
    let group = group(&lists, geometry.blockers().polygons(), !agrees)?;
    let first = |s: usize| {
        let images = group.iter().enumerate().map(|(k, found)| (found.maps[sources][s], k as u32));
        images.min().expect("a group has an identity")
    };
    let originals = (0..lists[sources].len()).map(first).collect();
    Some(Mirrors::new(originals, group.into_iter().map(|mut found| found.maps.swap_remove(targets)).collect()))
}

/// Whether a run by `strategy` copies rows in its store.
pub(super) fn copies(strategy: &Strategy) -> bool {
    let held = matches!(strategy.store, Store::Dense | Store::Packed | Store::PackedSingle);
    matches!(strategy.method, Method::Analytic { .. })
        && (held || strategy.shape == Shape::TwoLevel)
        && strategy.thins().is_none()
}

/// Whether pairs have the value of their mirror images to rounding, whatever lies between and wherever loops begin: that is asked for.
fn agrees(method: Method) -> bool {
    match method {
        Method::Analytic { tolerance, partial: PartialVisibility::Exact { tolerance: partial } } => {
            tolerance.max(partial) <= ROUNDING
        }
        _ => false,
    }
}
