//! What may stand between two nodes, narrowed from pair to pair on the way down.
//!
//! Blockers hang in a binary tree of boxes, and a pair's list holds nodes of that tree: polygons, and groups of which nothing more is known
//! than that their box meets the shaft. A group is opened where a polygon of it may part a node of the pair, or while the list is short. So the list of a pair is short among any number of blockers, and gets finer as
//! the nodes get smaller.
//!
//! A box is out of the way of two nodes if it misses the box around both, lies behind the plane of one, before or behind both
//! along the line of their centres, or outside the cone that touches both spheres (Haines, Wallace 1991, for shafts of boxes).

use std::ops::Range;

use glam::Vec3;
use radiosity_geometry::Occluders;

use super::screens::{Between, Bounds, FLAT, PARTING, Screen, Seen};
use super::tree::{Frame, Hierarchy, Node};
use super::walls::joined;

/// Entries of a list up to which groups are opened whatever their size.
const SHORT: usize = 8;
/// Blockers of a list up to which segments are tested against each of them; beyond, the hierarchy of all is asked.
const FEW: usize = 8;
/// Distance from a plane, in units of half the scene, within which the polygons of a wall lie: far below [`FLAT`].
const LEVEL: f64 = 1e-9;
/// By how much points are lifted off their surfaces before segments are tested, in units of half the scene: beyond their rounding.
const LIFT: f32 = 4.0 * FLAT;

/// Blockers as shafts see them.
pub(super) struct Screens<'a> {
    occluders: &'a Occluders,
    frame: Frame,
    screens: Vec<Screen>,
    /// Groups, each before its parts; the last is the root.
    groups: Vec<Group>,
}

/// Blockers in a box.
struct Group {
    bounds: Bounds,
    /// Largest radius of a part of its polygons.
    largest: f32,
    /// Polygons by their number, groups by theirs beyond that.
    parts: [u32; 2],
}

/// The convex hull of two nodes.
pub(super) struct Shaft<'n> {
    pub nodes: [&'n Node; 2],
    /// Normals of nodes of one plane.
    pub normals: [Option<Vec3>; 2],
    /// From the first centre to the second.
    pub along: Vec3,
    pub length_squared: f32,
    /// How far the nodes reach along the line, times its length.
    pub reach_along: [f32; 2],
    /// How far the nodes reach along the axes, and the box around both.
    extents: [Vec3; 2],
    middle: Vec3,
    half: Vec3,
}

impl<'n> Shaft<'n> {
    pub fn new(hierarchy: &'n Hierarchy, p: u32, q: u32) -> Self {
        let nodes = [p, q].map(|k| &hierarchy.nodes[k as usize]);
        let along = nodes[1].centre - nodes[0].centre;
        let extents = nodes.map(Node::extent);
        let lo = (nodes[0].centre - extents[0]).min(nodes[1].centre - extents[1]);
        let hi = (nodes[0].centre + extents[0]).max(nodes[1].centre + extents[1]);
        Self {
            nodes,
            normals: nodes.map(|node| (!node.is_cluster()).then(|| hierarchy.normals[node.plane as usize])),
            along,
            length_squared: along.length_squared(),
            reach_along: nodes.map(|node| node.reach(along)),
            extents,
            middle: 0.5 * (lo + hi),
            half: 0.5 * (hi - lo),
        }
    }

    /// Whether nothing in a box can be between the nodes.
    fn misses(&self, bounds: &Bounds) -> bool {
        if (bounds.centre - self.middle).abs().cmpgt(bounds.half + self.half + FLAT).any() {
            return true;
        }
        let behind = |(node, normal): (&Node, Option<Vec3>)| {
            // What lies in the plane may be what parts the other node.
            normal.is_some_and(|n| (bounds.centre - node.centre).dot(n) + bounds.half.dot(n.abs()) < -FLAT)
        };
        if self.nodes.into_iter().zip(self.normals).any(behind) {
            return true;
        }
        let [p, q] = self.nodes;
        let from = bounds.centre - p.centre;
        let (at, reach) = (from.dot(self.along), bounds.half.dot(self.along.abs()));
        if at + reach <= -self.reach_along[0] || at - reach >= self.length_squared + self.reach_along[1] {
            return true;
        }
        // At distance h from the axis and t along it, h cos φ − R_p − t (R_q − R_p) is the distance from the cone, sin φ = (R_q − R_p)/r.
        let wider = q.radius - p.radius;
        let cosine_squared = 1.0 - wider * wider / self.length_squared;
        let t = at / self.length_squared;
        let radius = p.radius + t * wider + bounds.half.length() + FLAT;
        cosine_squared > 0.0
            && (radius < 0.0 || (from.length_squared() - at * t) * cosine_squared > radius * radius * (1.0 + 1e-5))
    }

    /// Whether a polygon in a group may pass through a node and is large enough to part it.
    fn parted(&self, group: &Group) -> bool {
        self.nodes.into_iter().zip(self.extents).any(|(node, extent)| {
            !node.is_leaf()
                && group.largest >= PARTING * node.radius
                && (group.bounds.centre - node.centre).abs().cmple(group.bounds.half + extent).all()
        })
    }
}

impl<'a> Screens<'a> {
    /// Of the polygons of `occluders` in the units of `hierarchy`.
    ///
    /// # Panics
    ///
    /// If there is nothing that blocks.
    pub fn new(hierarchy: &Hierarchy, occluders: &'a Occluders) -> Self {
        let frame = hierarchy.frame;
        let walls = joined(occluders.polygons(), LEVEL / frame.scale);
        let screens: Vec<Screen> = walls.iter().map(|wall| Screen::new(wall, &frame)).collect();
        let mut all = Self { occluders, frame, groups: Vec::with_capacity(screens.len()), screens };
        let mut members: Vec<u32> = (0..all.screens.len() as u32).collect();
        all.group(&mut members);
        all
    }

    /// What a search begins with.
    pub fn root(&self) -> u32 {
        (self.screens.len() + self.groups.len() - 1) as u32
    }

    /// The polygon or the group of some polygons.
    fn group(&mut self, members: &mut [u32]) -> u32 {
        if let [one] = members {
            return *one;
        }
        let of = |k: &u32| &self.screens[*k as usize];
        let bounds = Bounds::of(members.iter().flat_map(|k| of(k).corners.iter().copied()));
        let largest = members.iter().map(|k| of(k).part).fold(0.0, f32::max);
        let size = bounds.half;
        let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b]).then(b.cmp(&a))).unwrap_or(0);
        members.sort_by(|a, b| of(a).middle[axis].total_cmp(&of(b).middle[axis]).then(a.cmp(b)));
        let (left, right) = members.split_at_mut(members.len() / 2);
        let parts = [self.group(left), self.group(right)];
        self.groups.push(Group { bounds, largest, parts });
        self.root()
    }

    /// What of the blockers at `given` of the list may stand between the nodes of a shaft; those are appended to the list.
    pub fn narrow(&self, shaft: &Shaft<'_>, list: &mut Vec<u32>, given: Range<usize>) -> Between {
        let mut found = Found { begin: list.len(), left: 0, seen: Seen::default() };
        for at in given.clone() {
            found.left = given.end - at;
            if self.add(list[at], shaft, list, &mut found) {
                return Between::All;
            }
        }
        if list.len() == found.begin { Between::Nothing } else { Between::Some(found.seen) }
    }

    /// Appends what of a blocker or group may be in the way; whether it is one that hides all.
    fn add(&self, k: u32, shaft: &Shaft<'_>, list: &mut Vec<u32>, found: &mut Found) -> bool {
        let Some(group) = (k as usize).checked_sub(self.screens.len()).map(|k| &self.groups[k]) else {
            // Most of a list misses the shafts of children altogether, which a box tells in a third of the time.
            if shaft.misses(&self.screens[k as usize].bounds) {
                return false;
            }
            match self.screens[k as usize].between(shaft) {
                Between::Nothing => {}
                Between::All => return true,
                Between::Some(seen) => {
                    found.seen = found.seen.and(seen);
                    list.push(k);
                }
            }
            return false;
        };
        if shaft.misses(&group.bounds) {
            return false;
        }
        if shaft.parted(group) || list.len() - found.begin + found.left < SHORT {
            return group.parts.into_iter().any(|part| self.add(part, shaft, list, found));
        }
        // Nothing is known of what stays closed.
        found.seen.finely = [true; 2];
        list.push(k);
        false
    }

    /// Which of the segments between points with normals are properly crossed by a blocker of the list.
    ///
    /// A blocker may be the very surface that a point of a cluster lies on, whose rounded point is as likely behind it as before it: hence the
    /// lift.
    pub fn blocked(&self, list: &[u32], segments: &[[(Vec3, Vec3); 2]], blocked: &mut [bool]) {
        let lifted = |(x, n): (Vec3, Vec3)| x.as_dvec3() + (n * LIFT).as_dvec3();
        if list.len() <= FEW && list.iter().all(|k| (*k as usize) < self.screens.len()) {
            for (blocked, [x, y]) in blocked.iter_mut().zip(segments) {
                let (x, y) = (lifted(*x), lifted(*y));
                *blocked = list.iter().any(|&k| self.screens[k as usize].crosses(x, y));
            }
            return;
        }
        let in_space = |point| self.frame.space(lifted(point));
        let segments: Vec<_> = segments.iter().map(|[x, y]| (in_space(*x), in_space(*y))).collect();
        self.occluders.occluded_many(&segments, blocked);
    }
}

/// What a search has found so far.
struct Found {
    /// Where its list begins.
    begin: usize,
    /// Entries still to be looked at.
    left: usize,
    seen: Seen,
}
