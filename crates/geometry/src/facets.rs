//! Groups of convex polygons: what sends and receives.

use crate::{Polygon, Scene};

/// Groups of convex polygons, each group one sender and receiver.
///
/// An element is a group of one polygon; a patch, or a whole surface of several pieces, is a group of one or more.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Facets {
    polygons: Vec<Polygon>,
    /// One past the last polygon of every group.
    ends: Vec<usize>,
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
    pub fn push(&mut self, polygons: Vec<Polygon>, covered: bool) {
        self.areas.push(polygons.iter().map(Polygon::area).sum());
        self.polygons.extend(polygons);
        self.ends.push(self.polygons.len());
        self.covered.push(covered);
    }

    /// Number of groups.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Whether there is no group.
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// Polygons of group k.
    ///
    /// # Panics
    ///
    /// If there is no group k.
    pub fn polygons(&self, k: usize) -> &[Polygon] {
        let begin = if k == 0 { 0 } else { self.ends[k - 1] };
        &self.polygons[begin..self.ends[k]]
    }

    /// Area of group k: the sum over its polygons.
    ///
    /// # Panics
    ///
    /// If there is no group k.
    pub fn area(&self, k: usize) -> f64 {
        self.areas[k]
    }

    /// Areas of all groups.
    pub fn areas(&self) -> Vec<f64> {
        self.areas.clone()
    }

    /// Whether group k lies inside a solid: it sends and receives nothing.
    ///
    /// # Panics
    ///
    /// If there is no group k.
    pub fn covered(&self, k: usize) -> bool {
        self.covered[k]
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
    }
}
