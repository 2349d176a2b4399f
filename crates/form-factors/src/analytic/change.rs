//! Which pairs a change among the blocking polygons can reach.
//!
//! Between two polygons that stayed where they were, the estimator's answer depends on what its classification finds in the way
//! ([`super::visibility`]): these polygons, in their order, and the convex bodies they belong to. So a pair is as it was, to the last bit,
//! if no polygon that came or went, or whose body did, would be found in the way of it. That test is a search for a plane that separates
//! the polygon from the shaft of the pair, its convex hull: the polygon's own plane with the pair on one side, the plane of either partner
//! with the polygon behind it, a side of the box around the pair, or a plane through an edge of the polygon with all crossings beyond.
//!
//! The first two are bits of a facet and a polygon, set once: then most pairs take a few operations on 64 polygons at once, and only
//! the rest are looked at one by one.

use std::collections::{HashMap, HashSet};

use radiosity_geometry::{Facets, Polygon};
use rayon::prelude::*;

use super::Analytic;
use super::pair::{FacingPair, rounding};
use super::visibility::{Screen, any_in_the_way};

/// The polygons that block otherwise for one estimator than for another.
#[derive(Clone, Debug)]
pub struct BlockerChange {
    screens: Vec<Screen>,
}

/// On which sides of the changed polygons facets lie, and which of them lie before the facets: a bit a polygon.
#[derive(Clone, Debug)]
pub struct Sides {
    above: Vec<u64>,
    below: Vec<u64>,
    ahead: Vec<u64>,
    /// Words of 64 polygons for every facet.
    words: usize,
}

/// Numbers of what occurs in two lists of blockers: equal things have one number.
#[derive(Default)]
struct Numbers {
    /// Polygons: owner and corners.
    polygons: HashMap<(u32, Vec<[u64; 3]>), u32>,
    /// Bodies: their faces, and whether a pair beside a body is found to be before its faces are looked at.
    bodies: HashMap<(Vec<u32>, bool), u32>,
}

/// How a polygon blocks: its number, and that of its body, if it is of one.
type Role = (u32, Option<u32>);

impl BlockerChange {
    /// Compares the blocking polygons of two estimators with their owners, in time proportional to their number.
    pub fn new(before: &Analytic<'_>, after: &Analytic<'_>) -> Self {
        let mut numbers = Numbers::default();
        let roles = [before, after].map(|estimator| roles(estimator, &mut numbers));
        let known = roles.each_ref().map(|roles| roles.iter().collect::<HashSet<_>>());
        let mut screens = Vec::new();
        for (estimator, roles, others) in [(before, &roles[0], &known[1]), (after, &roles[1], &known[0])] {
            let Some(scene) = &estimator.scene else { continue };
            let changed = (0..roles.len()).filter(|&k| !others.contains(&roles[k]));
            screens.extend(changed.map(|k| scene.screens.screen(k).clone()));
        }
        Self { screens }
    }

    /// Number of polygons that came or went, or whose body did.
    pub fn len(&self) -> usize {
        self.screens.len()
    }

    /// Whether the same polygons block.
    pub fn is_empty(&self) -> bool {
        self.screens.is_empty()
    }

    /// Where facets lie, in parallel; takes time proportional to their number times that of changed polygons.
    pub fn sides(&self, facets: &Facets) -> Sides {
        let words = self.screens.len().div_ceil(64);
        let masks: Vec<[u64; 3]> = (0..facets.len() * words)
            .into_par_iter()
            .map(|place| {
                let (k, word) = (place / words, place % words);
                let mut mask = [0; 3];
                for (bit, screen) in self.screens.iter().skip(64 * word).take(64).enumerate() {
                    for polygon in facets.polygons(k) {
                        let (above, below) = screen.sides_of(polygon.vertices());
                        for (mask, is) in mask.iter_mut().zip([above, below, ahead(polygon, screen)]) {
                            *mask |= u64::from(is) << bit;
                        }
                    }
                }
                mask
            })
            .collect();
        let [above, below, ahead] = [0, 1, 2].map(|kind| masks.iter().map(|mask| mask[kind]).collect());
        Sides { above, below, ahead, words }
    }

    /// Whether the exchange area of facets s and t, each with its sides, can differ: `pairs` are their polygons in the order in which the
    /// estimator takes them.
    pub fn reaches<'p>(
        &self,
        (of_s, s): (&Sides, usize),
        (of_t, t): (&Sides, usize),
        pairs: impl Iterator<Item = (&'p Polygon, &'p Polygon)>,
    ) -> bool {
        let between = |word: usize| {
            let (i, j) = (s * of_s.words + word, t * of_t.words + word);
            let opposite = (of_s.above[i] & of_t.below[j]) | (of_s.below[i] & of_t.above[j]);
            opposite & of_s.ahead[i] & of_t.ahead[j]
        };
        if (0..of_s.words).all(|word| between(word) == 0) {
            return false;
        }
        let left = |k: usize| between(k / 64) >> (k % 64) & 1 == 1;
        let screens = || (0..self.screens.len()).filter(|&k| left(k)).map(|k| &self.screens[k]);
        pairs.filter_map(|(i, j)| FacingPair::new(i, j)).any(|pair| any_in_the_way(&pair, screens()))
    }
}

/// Whether a screen is not wholly behind the plane of a polygon, by less than the slack of any pair.
fn ahead(polygon: &Polygon, screen: &Screen) -> bool {
    let (p, n, slack) = (polygon.vertices()[0], polygon.normal(), 0.5 * rounding(polygon.vertices()));
    screen.vertices().iter().any(|v| (*v - p).dot(n) > slack)
}

/// The role of every blocking polygon.
fn roles(estimator: &Analytic<'_>, numbers: &mut Numbers) -> Vec<Role> {
    let Some(scene) = &estimator.scene else { return Vec::new() };
    let occluders = scene.occluders;
    let mut number = |k: usize| {
        // Adding 0 makes −0 and +0 the same.
        let corners = occluders.polygons()[k].vertices().iter().map(|v| v.to_array().map(|x| (x + 0.0).to_bits()));
        let next = numbers.polygons.len() as u32;
        *numbers.polygons.entry((occluders.owner(k), corners.collect())).or_insert(next)
    };
    let mut roles: Vec<Role> = (0..occluders.len()).map(|k| (number(k), None)).collect();
    for body in scene.bodies.iter() {
        let faces = body.faces.iter().map(|&face| roles[face].0).collect();
        let next = numbers.bodies.len() as u32;
        let body_number = *numbers.bodies.entry((faces, scene.screens.takes_bodies())).or_insert(next);
        body.faces.iter().for_each(|&face| roles[face].1 = Some(body_number));
    }
    roles
}

/// Number of pairs of polygons that face each other, each unordered pair once if sources and targets are one list: what a full computation
/// counts as form factors. Of all pairs with `s` or `t` chosen by the two lists; in parallel.
pub fn facing_pairs(sources: &Facets, targets: &Facets, chosen_sources: &[u32], chosen_targets: &[u32]) -> u64 {
    let symmetric = std::ptr::eq(sources, targets);
    let is_chosen = |chosen: &[u32], count: usize| {
        let mut is = vec![false; count];
        chosen.iter().for_each(|&k| is[k as usize] = true);
        is
    };
    let count = |s: usize, t: usize| {
        let pairs = sources.polygons(s).iter().enumerate().flat_map(|(k, i)| {
            targets
                .polygons(t)
                .iter()
                .enumerate()
                .filter(move |(l, _)| !(symmetric && s == t && k == *l))
                .map(move |(_, j)| (i, j))
        });
        pairs.filter(|(i, j)| FacingPair::faces(i, j)).count() as u64
    };
    let in_sources = is_chosen(chosen_sources, sources.len());
    let rows = chosen_sources.par_iter().map(|&s| {
        let s = s as usize;
        // The pair of two chosen ones belongs to the smaller index.
        let owned = |t: &usize| !(symmetric && *t < s && in_sources[*t]);
        (0..targets.len()).filter(owned).map(|t| count(s, t)).sum::<u64>()
    });
    let rows: u64 = rows.sum();
    if symmetric {
        return rows;
    }
    let columns = chosen_targets
        .par_iter()
        .map(|&t| (0..sources.len()).filter(|&s| !in_sources[s]).map(|s| count(s, t as usize)).sum::<u64>());
    rows + columns.sum::<u64>()
}
