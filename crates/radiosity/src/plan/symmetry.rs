//! Symmetries of what exchanges light: rows that are mirror images of others.
//!
//! An isometry of space that maps the elements onto themselves, polygon by polygon, and what blocks as well, changes no form factor: of an orbit of elements
//! one row is computed ([`Mirrors`] says how, and that of orbits of q elements one pair in q remains). Materials do not matter, since F has only to do with geometry: a lamp
//! in one corner of a cube breaks nothing.
//!
//! *Which* are looked for: the 48 signed permutations of the axes about the centre of the box around all elements, the symmetries of a cube; not
//! rotations by other angles, those of a room that stands askew to the axes, of parts of a room, or translations. They are found *on the mesh*: elements are put in a table by their
//! centroids, and the image of each must be one of them, corner on corner, front on front, to 16 ε of the largest coordinate. With those that hold their products hold
//! as well, and with one that does not hold a whole coset is out. If g maps a known group onto itself, g h = h' g, one element of each of its orbits tells where all go: a
//! cube takes two looks at each of its elements, not 48. O(m) each, and no more than [`MOST_LOOKS`] · m looks altogether.
//!
//! *Where* they are exact: the estimator must give mirrored pairs the same value. The product and contour rules for whole quadrilaterals do, to rounding (1e-14 of the
//! smaller area), at any tolerance; those for triangles if the corner that comes first is mapped to the one that comes first. Pairs between which something lies are
//! integrated adaptively, by decisions that have no such symmetry, and are as good as the tolerance they are asked for: at 1e-6 copies differ by up to 1e-7 of the smaller area, at 1e-11 by
//! 3e-14. So where anything can block symmetry is used only if [`ROUNDING`] is asked for, and segments that are drawn never. Rows of rays and hemicubes have
//! directions of their own. Stores of lists and of nothing, links, and stores without small pairs compute all rows.

use std::collections::BTreeSet;

use glam::{DMat3, DVec3};
use radiosity_core::mix;
use radiosity_form_factors::Mirrors;
use radiosity_form_factors::analytic::PartialVisibility;
use radiosity_geometry::{Facets, Polygon, Scene};

use crate::{Geometry, Method, Shape, Store, Strategy};

/// Looks at elements, for each of them: no more than five succeed, and those that fail are mostly told by a few elements.
const MOST_LOOKS: usize = 16;
/// Error of form factors, asked for, from which on copies of pairs that something blocks agree to rounding.
const ROUNDING: f64 = 1e-12;
/// Distance within which corners are the same, in units of the largest coordinate.
const NEAR: f64 = 16.0 * f64::EPSILON;
/// Cells of the table along the longest side of the box around all elements: a number without meaning to a mesh.
const CELLS: f64 = 761_539.3;
/// Elements from one to the next that is looked at before all are, so that one that has no image is found soon.
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

    /// All 48: reflections and what they make, then turns of three axes, then exchanges of two; those before make a group that the next
    /// ones map onto itself, so that these have to be looked at for one element an orbit.
    fn all() -> impl Iterator<Item = Self> {
        let from = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [1, 0, 2], [2, 1, 0]];
        from.into_iter().flat_map(|from| {
            (0..8).map(move |bits| Self { from, turned: [bits & 1 != 0, bits & 2 != 0, bits & 4 != 0] })
        })
    }

    /// First `other`, then this.
    fn after(self, other: Self) -> Self {
        Self {
            from: self.from.map(|axis| other.from[axis]),
            turned: [0, 1, 2].map(|k| self.turned[k] != other.turned[self.from[k]]),
        }
    }

    /// Whether it turns what runs counter-clockwise to clockwise.
    fn reflects(self) -> bool {
        let odd = self.from.iter().enumerate().filter(|(k, axis)| *k == **axis).count() == 1;
        self.turned.into_iter().fold(odd, |odd, turned| odd != turned)
    }
}

/// An isometry about a point.
#[derive(Clone, Copy, Debug)]
struct Motion {
    axes: DMat3,
    centre: DVec3,
    reflects: bool,
}

impl Motion {
    fn new(g: Isometry, centre: DVec3) -> Self {
        let row = |k: usize| DVec3::AXES[g.from[k]] * if g.turned[k] { -1.0 } else { 1.0 };
        let axes = DMat3::from_cols(row(0), row(1), row(2)).transpose();
        Self { axes, centre, reflects: g.reflects() }
    }

    #[inline(always)]
    fn of(&self, x: DVec3) -> DVec3 {
        self.centre + self.axes * (x - self.centre)
    }
}

/// The box around all elements and what follows from it.
#[derive(Clone, Copy, Debug)]
struct Frame {
    low: DVec3,
    high: DVec3,
    /// Distance within which corners are the same.
    near: f64,
    /// Cells of tables in a unit of length.
    scale: f64,
    /// Whether it matters at which corner a loop begins.
    begins: bool,
}

impl Frame {
    fn around(facets: &Facets, begins: bool) -> Option<Self> {
        let corners = facets.iter_polygons().flat_map(|(_, polygon)| polygon.vertices());
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = corners.fold(none, |(low, high), v| (low.min(*v), high.max(*v)));
        let near = NEAR * low.abs().max(high.abs()).max_element();
        let scale = CELLS / (high - low).max_element();
        scale.is_finite().then_some(Self { low, high, near, scale, begins })
    }

    fn centre(&self) -> DVec3 {
        0.5 * (self.low + self.high)
    }

    /// Isometries of the box.
    fn allows(&self, g: Isometry) -> bool {
        let size = self.high - self.low;
        (0..3).all(|k| (size[k] - size[g.from[k]]).abs() <= 2.0 * self.near)
    }

    #[inline(always)]
    fn same(&self, a: DVec3, b: DVec3) -> bool {
        let way = a - b;
        (way.x.abs() <= self.near) & (way.y.abs() <= self.near) & (way.z.abs() <= self.near)
    }

    /// Whether `g` takes polygon `p` to `q`, with its front if `front`.
    fn maps(&self, g: &Motion, p: &Polygon, q: &Polygon, front: bool) -> bool {
        let (p, q) = (p.vertices(), q.vertices());
        let n = p.len();
        let first = g.of(p[0]);
        let Some(begin) = (q.len() == n).then(|| q.iter().position(|v| self.same(*v, first))).flatten() else {
            return false;
        };
        let runs = |back: bool| {
            // Round the loop from where it begins, one way or the other.
            let (before, after) = q.split_at(begin);
            let maps = |(v, q): (&DVec3, &DVec3)| self.same(g.of(*v), *q);
            if back {
                p[1..].iter().zip(before.iter().rev().chain(after.iter().rev())).all(maps)
            } else {
                p[1..].iter().zip(after[1..].iter().chain(before)).all(maps)
            }
        };
        if !front {
            return runs(false) || runs(true);
        }
        // Loops that are no quadrilaterals are cut into such from their first corner on, and all but triangles in one direction.
        let alike = n == 4 || (begin == 0 && (n == 3 || !g.reflects));
        (alike || !self.begins) && runs(g.reflects)
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
            let cell = places.cells(places.polygons[k].1.centroid(), 0.0)[0];
            let free = places.probe(cell).find(|slot| places.slots[*slot] == 0).expect("twice as many slots");
            places.slots[free] = k as u32 + 1;
        }
        places
    }

    /// The first and the last cell along each axis of what is so near a point.
    #[inline]
    fn cells(&self, x: DVec3, near: f64) -> [[u32; 3]; 2] {
        // Cells are counted from 1, so that what is rounded towards zero is rounded down.
        let (at, near) = ((x - self.frame.low) * self.frame.scale + 1.0, near * self.frame.scale);
        [at - near, at + near].map(|at| at.to_array().map(|at| at as u32))
    }

    /// Slots where polygons of a cell may be, to the first that is free.
    fn probe(&self, [x, y, z]: [u32; 3]) -> impl Iterator<Item = usize> + use<> {
        let hash = mix(u64::from(x) ^ u64::from(y) << 21 ^ u64::from(z) << 42) as usize;
        let mask = self.slots.len() - 1;
        (0..=mask).map(move |k| (hash + k) & mask)
    }

    /// What the image of `polygon` belongs to.
    fn image(&self, g: &Motion, polygon: &Polygon, front: bool) -> Option<u32> {
        let frame = &self.frame;
        let in_cell = |cell: [u32; 3]| {
            let taken = self.probe(cell).map(|slot| self.slots[slot]).take_while(|taken| *taken > 0);
            let mut candidates = taken.map(|k| self.polygons[k as usize - 1]);
            candidates.find(|(_, candidate)| frame.maps(g, polygon, candidate, front)).map(|(of, _)| of)
        };
        // Centroids round as corners do. A cell is much larger than that, so that there are seldom two along an axis.
        let [low, high] = self.cells(g.of(polygon.centroid()), 2.0 * frame.near);
        if low == high {
            return in_cell(low);
        }
        let along = |k: usize| low[k]..=high[k];
        along(0).flat_map(|x| along(1).flat_map(move |y| along(2).map(move |z| [x, y, z]))).find_map(in_cell)
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
    ///
    /// Of symmetries h that are known, as maps, `known` has the h' with g h = h' g: where one facet of their orbits goes says where all go.
    fn of(&self, g: &Motion, known: &[[&[u32]; 2]], looks: &mut usize) -> Option<Vec<u32>> {
        const NONE: u32 = u32::MAX;
        let m = self.facets.len();
        let (mut map, mut taken) = (vec![NONE; m], vec![false; m]);
        // A few of all facets first, then one after the other.
        let mut last = [0, 0];
        for k in (0..m).step_by(STRIDE).chain(0..m) {
            if map[k] != NONE {
                continue;
            }
            *looks = looks.checked_sub(1)?;
            let polygons = self.facets.polygons(k);
            let Some((first, others)) = polygons.split_first() else {
                // What has no polygons is where it was.
                map[k] = k as u32;
                continue;
            };
            // Mostly the image is as far from the one before as that was from the one before it.
            let guess = (2 * last[1] - last[0]) as usize;
            let guessed = guess < m && {
                let there = self.facets.polygons(guess);
                there.first().is_some_and(|there| self.places.frame.maps(g, first, there, true))
            };
            let image = if guessed { guess as u32 } else { self.places.image(g, first, true)? };
            last = [last[1], i64::from(image)];
            let place = image as usize;
            let alike = self.facets.polygons(place).len() == polygons.len()
                && self.facets.covered(place) == self.facets.covered(k)
                && others.iter().all(|polygon| self.places.image(g, polygon, true) == Some(image));
            if !alike {
                return None;
            }
            for [h, partner] in known {
                let (of, image) = (h[k] as usize, partner[place]);
                if map[of] == NONE {
                    map[of] = image;
                    if std::mem::replace(&mut taken[image as usize], true) {
                        return None;
                    }
                }
            }
        }
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
    for g in Isometry::all().filter(|g| frame.allows(*g)) {
        if decided.contains(&g) {
            continue;
        }
        let motion = Motion::new(g, frame.centre());
        let blocks = blockers.iter().all(|wall| walls.image(&motion, wall, false).is_some());
        let partner = |h: &Found| found.iter().position(|k| k.g.after(g) == g.after(h.g));
        // Of a group that is not mapped onto itself the identity alone is used.
        let partners: Vec<usize> = found.iter().map(partner).collect::<Option<_>>().unwrap_or_else(|| vec![0]);
        let of_list = |(l, images): (usize, &Images<'_>)| {
            let known = found.iter().zip(&partners).map(|(h, &k)| [&h.maps[l][..], &found[k].maps[l]]);
            images.of(&motion, &known.collect::<Vec<_>>(), &mut looks)
        };
        let maps = blocks.then(|| images.iter().enumerate().map(of_list).collect()).flatten();
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
    // The first of every orbit, the identity first of all.
    let mut originals: Vec<(u32, u32)> = (0..lists[sources].len() as u32).map(|s| (s, 0)).collect();
    for (k, found) in group.iter().enumerate() {
        for (original, &image) in originals.iter_mut().zip(&found.maps[sources]) {
            if image < original.0 {
                *original = (image, k as u32);
            }
        }
    }
    Some(Mirrors::new(originals, group.into_iter().map(|mut found| found.maps.swap_remove(targets)).collect()))
}

/// Whether some faces of a scene, each taken as a whole, are mapped onto themselves: then their elements mostly are.
pub(super) fn of_faces(scene: &Scene, strategy: &Strategy, faces: &mut dyn Iterator<Item = usize>) -> bool {
    let mut facets = Facets::new();
    faces.for_each(|s| facets.push(scene.surfaces[s].pieces.iter().cloned(), false));
    group(&[&facets], &[], !agrees(strategy.method)).is_some()
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

#[cfg(test)]
mod tests {
    use super::*;

    fn square(at: [f64; 2], size: f64, z: f64) -> Polygon {
        let corner = |x: f64, y: f64| DVec3::new(at[0] + size * x, at[1] + size * y, z);
        Polygon::new(&[corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)]).unwrap()
    }

    fn order(facets: &Facets, blockers: &[Polygon]) -> usize {
        group(&[facets], blockers, true).map_or(1, |group| group.len())
    }

    #[test]
    fn signed_permutations_are_a_group_of_48_of_which_half_reflect() {
        let all: Vec<Isometry> = Isometry::all().collect();
        assert_eq!(all.iter().collect::<BTreeSet<_>>().len(), 48);
        assert_eq!(all.iter().filter(|g| g.reflects()).count(), 24);
        let x = DVec3::new(0.3, -1.0, 2.5);
        for a in &all {
            for b in &all {
                let [of_a, of_b, of_both] = [*a, *b, a.after(*b)].map(|g| Motion::new(g, DVec3::splat(0.5)));
                assert!(of_a.of(of_b.of(x)).distance(of_both.of(x)) < 1e-14);
                assert_eq!(of_both.reflects, of_a.reflects != of_b.reflects);
            }
        }
    }

    /// Maps of all elements, and products of what was found: a group whatever was looked at.
    #[test]
    fn what_is_found_maps_elements_onto_elements_and_holds_its_products() {
        let mut facets = Facets::new();
        // A square of 4 × 4 cells: the symmetries of a square, which keep its front.
        (0..16)
            .for_each(|k| facets.push([square([0.25 * f64::from(k % 4), 0.25 * f64::from(k / 4)], 0.25, 1.0)], false));
        let group = group(&[&facets], &[], true).unwrap();
        assert_eq!(group.len(), 8);
        for found in &group {
            let motion = Motion::new(found.g, DVec3::new(0.5, 0.5, 1.0));
            for (k, &image) in found.maps[0].iter().enumerate() {
                let (from, to) = (&facets.polygons(k)[0], &facets.polygons(image as usize)[0]);
                assert!(motion.of(from.centroid()).distance(to.centroid()) < 1e-14);
            }
            let products = group.iter().map(|other| other.after(found));
            assert!(products.into_iter().all(|p| group.iter().any(|g| g.g == p.g && g.maps == p.maps)));
        }
    }

    /// Two squares each, in the one order and in the other; then with a polygon of the one in the other, and one of them covered.
    #[test]
    fn polygons_of_a_facet_may_come_in_any_order_but_stay_together() {
        let at = |x: f64, y: f64| square([x, y], 1.0, 0.0);
        let facets = |left: [Polygon; 2], right: [Polygon; 2], covered: bool| {
            let mut facets = Facets::new();
            facets.push(left, false);
            facets.push(right, covered);
            facets
        };
        let (left, right) = ([at(0.0, 0.0), at(0.0, 2.0)], [at(2.0, 0.0), at(2.0, 2.0)]);
        let turned = [right[1].clone(), right[0].clone()];
        assert_eq!(order(&facets(left.clone(), right.clone(), false), &[]), 4);
        assert_eq!(order(&facets(left.clone(), turned, false), &[]), 4);
        assert_eq!(order(&facets(left.clone(), right.clone(), true), &[]), 2);
        // Three squares of one facet and one of another: nothing keeps them together but the diagonal through both.
        let mut uneven = Facets::new();
        uneven.push([left[0].clone(), left[1].clone(), right[0].clone()], false);
        uneven.push([right[1].clone()], false);
        assert_eq!(order(&uneven, &[]), 2);
    }

    /// Fronts are turned by what takes the other side up; blockers have none.
    #[test]
    fn elements_keep_their_fronts_and_blockers_need_not() {
        let mut sheet = Facets::new();
        sheet.push([square([0.0, 0.0], 1.0, 0.0)], false);
        assert_eq!(order(&sheet, &[]), 8);
        let mut back = square([0.25, 0.25], 0.5, 0.0).vertices().to_vec();
        back.reverse();
        assert_eq!(order(&sheet, &[Polygon::new(&back).unwrap()]), 8);
        assert_eq!(order(&sheet, &[square([0.0, 0.25], 0.5, 0.0)]), 2);
        // Back to back with its other side, all that keeps the pair.
        let mut reversed = square([0.0, 0.0], 1.0, 0.0).vertices().to_vec();
        reversed.reverse();
        sheet.push([Polygon::new(&reversed).unwrap()], false);
        assert_eq!(order(&sheet, &[]), 16);
    }
}
