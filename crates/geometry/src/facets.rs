//! Groups of convex polygons: what sends and receives.

use std::sync::Arc;

use crate::{Polygon, Scene};

/// Groups of convex polygons, each group one sender and receiver.
///
/// An element is a group of one polygon; a patch, or a whole surface of several pieces, is a group of one or more. Clones and
/// selections share the polygons, which are most of the memory of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Facets {
    polygons: Arc<Vec<Polygon>>,
    groups: Arc<Groups>,
}

/// Which polygons a group has, and what holds for it.
#[derive(Clone, Debug, Default, PartialEq)]
struct Groups {
    /// First polygon and one past the last of every group.
    ranges: Vec<[u32; 2]>,
    areas: Vec<f64>,
    covered: Vec<bool>,
}

impl Facets {
    /// No groups.
    pub fn new() -> Self {
        Self::default()
    }

    /// One group a surface, in the order of the scene, none covered.
    pub fn of_surfaces(scene: &Scene) -> Self {
        let mut facets = Self::new();
        scene.surfaces.iter().for_each(|s| facets.push(s.pieces.clone(), false));
        facets
    }

    /// Adds a group; a covered one lies inside a solid.
    ///
    /// # Panics
    ///
    /// If there are 2³² polygons or more.
    pub fn push(&mut self, polygons: impl IntoIterator<Item = Polygon>, covered: bool) {
        let (all, groups) = (Arc::make_mut(&mut self.polygons), Arc::make_mut(&mut self.groups));
        let index = |k: usize| u32::try_from(k).expect("polygons are numbered in 32 bits");
        let begin = index(all.len());
        all.extend(polygons);
        groups.areas.push(all[begin as usize..].iter().map(Polygon::area).sum());
        groups.ranges.push([begin, index(all.len())]);
        groups.covered.push(covered);
    }

    /// The groups named, in that order, on the same polygons.
    ///
    /// # Panics
    ///
    /// If there is no such group.
    pub fn select(&self, groups: &[u32]) -> Self {
        if groups.iter().copied().eq(0..self.len() as u32) {
            return self.clone();
        }
        let of = &self.groups;
        let selected = Groups {
            ranges: groups.iter().map(|&k| of.ranges[k as usize]).collect(),
            areas: groups.iter().map(|&k| of.areas[k as usize]).collect(),
            covered: groups.iter().map(|&k| of.covered[k as usize]).collect(),
        };
        Self { polygons: Arc::clone(&self.polygons), groups: Arc::new(selected) }
    }

    /// Bytes of so many groups of one polygon of at most four vertices.
    pub fn bytes_of(groups: u64) -> u64 {
        size_of::<Polygon>() as u64 * groups + Self::selected_bytes_of(groups)
    }

    /// Bytes that a selection of so many groups takes beside the polygons it shares.
    pub fn selected_bytes_of(groups: u64) -> u64 {
        (size_of::<[u32; 2]>() + size_of::<f64>() + size_of::<bool>()) as u64 * groups
    }

    /// Number of groups.
    pub fn len(&self) -> usize {
        self.groups.ranges.len()
    }

    /// Whether there is no group.
    pub fn is_empty(&self) -> bool {
        self.groups.ranges.is_empty()
    }

    /// Polygons of group k.
    ///
    /// # Panics
    ///
    /// If there is no group k.
    pub fn polygons(&self, k: usize) -> &[Polygon] {
        let [begin, end] = self.groups.ranges[k];
        &self.polygons[begin as usize..end as usize]
    }

    /// Area of group k: the sum over its polygons.
    ///
    /// # Panics
    ///
    /// If there is no group k.
    pub fn area(&self, k: usize) -> f64 {
        self.groups.areas[k]
    }

    /// Areas of all groups.
    pub fn areas(&self) -> Vec<f64> {
        self.groups.areas.clone()
    }

    /// Whether group k lies inside a solid: it sends and receives nothing.
    ///
    /// # Panics
    ///
    /// If there is no group k.
    pub fn covered(&self, k: usize) -> bool {
        self.groups.covered[k]
    }

    /// Every polygon with the index of its group, group by group.
    pub fn iter_polygons(&self) -> impl Iterator<Item = (usize, &Polygon)> + '_ {
        (0..self.len()).flat_map(move |k| self.polygons(k).iter().map(move |p| (k, p)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn a_group_of_two_has_the_area_of_both() {
        let triangle = |size: f64| Polygon::new(&[DVec3::ZERO, DVec3::X * size, DVec3::Y * size]).unwrap();
        let mut facets = Facets::new();
        facets.push(vec![triangle(1.0)], false);
        facets.push(vec![triangle(2.0), triangle(4.0)], true);
        assert_eq!(facets.areas(), [0.5, 10.0]);
        assert_eq!(
            facets.iter_polygons().map(|(k, p)| (k, p.area())).collect::<Vec<_>>(),
            [(0, 0.5), (1, 2.0), (1, 8.0)]
        );
        assert_eq!((facets.covered(0), facets.covered(1), facets.polygons(1).len()), (false, true, 2));
        let second = facets.select(&[1]);
        assert_eq!((second.areas(), second.covered(0), second.polygons(0)), (vec![10.0], true, facets.polygons(1)));
        assert!(std::ptr::eq(second.polygons(0), facets.polygons(1)));
    }
}
