//! Closed bodies among the polygons: whose backs nobody sees from outside.

use std::collections::HashMap;

use glam::DVec3;
use radiosity_geometry::Polygon;

/// Boxes around closed bodies.
#[derive(Clone, Debug, Default)]
pub(super) struct Solids {
    boxes: Vec<(DVec3, DVec3)>,
}

/// Number of polygons that belong to no closed body.
pub(super) const NONE: u32 = u32::MAX;

impl Solids {
    /// Finds them: parts that hang together by edges, in which every edge is run along once in each direction by corners
    /// that are equal to the last bit, and which enclose a positive volume. The second value names the body of every polygon.
    pub fn of(polygons: &[&Polygon]) -> (Self, Vec<u32>) {
        let mut number: HashMap<[u64; 3], u32> = HashMap::new();
        // Adding zero makes one of the two zeros.
        let mut corner = |v: DVec3| {
            let next = number.len() as u32;
            *number.entry((v + DVec3::ZERO).to_array().map(f64::to_bits)).or_insert(next)
        };
        let loops: Vec<Vec<u32>> = polygons.iter().map(|p| p.vertices().iter().map(|&v| corner(v)).collect()).collect();
        let edges = |k: usize| {
            let corners = &loops[k];
            (0..corners.len()).map(move |c| (corners[c], corners[(c + 1) % corners.len()]))
        };
        // The polygon that runs along each directed edge, and how many do.
        let mut runs: HashMap<(u32, u32), (usize, u32)> = HashMap::new();
        for k in 0..polygons.len() {
            edges(k).for_each(|edge| runs.entry(edge).or_insert((k, 0)).1 += 1);
        }
        let once = |edge: (u32, u32)| runs.get(&edge).filter(|(_, count)| *count == 1).map(|(k, _)| *k);
        let (mut body, mut solids, mut stack) = (vec![NONE; polygons.len()], Self::default(), Vec::new());
        let mut visited = vec![false; polygons.len()];
        for first in 0..polygons.len() {
            if visited[first] {
                continue;
            }
            let (mut members, mut closed) = (Vec::new(), true);
            visited[first] = true;
            stack.push(first);
            while let Some(k) = stack.pop() {
                members.push(k);
                for (a, b) in edges(k) {
                    match (once((a, b)), once((b, a))) {
                        (Some(_), Some(next)) if !std::mem::replace(&mut visited[next], true) => stack.push(next),
                        (Some(_), Some(_)) => {}
                        _ => closed = false,
                    }
                }
            }
            if closed && volume(polygons, &members) > 0.0 {
                members.iter().for_each(|&k| body[k] = solids.boxes.len() as u32);
                let bounds = members.iter().map(|&k| polygons[k].bounds());
                let around = bounds.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
                solids.boxes.push(around);
            }
        }
        (solids, body)
    }

    /// Puts into `outside` which bodies `eye` lies outside of for certain.
    ///
    /// From there the first polygon of the body along any ray shows its front, unless the body's surface cuts itself.
    pub fn outside(&self, eye: DVec3, outside: &mut Vec<bool>) {
        outside.clear();
        outside.extend(self.boxes.iter().map(|(lo, hi)| eye.cmplt(*lo).any() || eye.cmpgt(*hi).any()));
    }
}

/// Volume that some polygons enclose, positive if they face outward.
fn volume(polygons: &[&Polygon], members: &[usize]) -> f64 {
    let origin = polygons[members[0]].centroid();
    members
        .iter()
        .map(|&k| (polygons[k].centroid() - origin).dot(polygons[k].normal()) * polygons[k].area() / 3.0)
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use radiosity_gallery::boxes::faces;

    fn polygons(lo: f64, hi: f64, inward: bool) -> Vec<Polygon> {
        faces(DVec3::splat(lo), DVec3::splat(hi), inward).iter().map(|face| Polygon::new(face).unwrap()).collect()
    }

    /// A room, a box in it and a box without its last face: only the whole box hides its backs, and only from outside.
    #[test]
    fn a_box_is_a_body_and_a_room_or_an_open_box_is_none() {
        let mut all = [polygons(0.0, 1.0, true), polygons(0.2, 0.4, false), polygons(0.5, 0.9, false)].concat();
        all.pop();
        let (solids, body) = Solids::of(&all.iter().collect::<Vec<_>>());
        assert_eq!(
            body.iter().map(|&b| b == 0).collect::<Vec<_>>(),
            (0..17).map(|k| (6..12).contains(&k)).collect::<Vec<_>>()
        );
        let mut outside = Vec::new();
        for (at, expected) in [(0.1, true), (0.3, false), (0.6, true)] {
            solids.outside(DVec3::splat(at), &mut outside);
            assert_eq!(outside, [expected], "eye at {at}");
        }
    }

    #[test]
    fn a_sheet_given_both_ways_round_encloses_nothing() {
        let sheet = polygons(0.0, 1.0, true).swap_remove(0);
        let back = Polygon::new(&sheet.vertices().iter().rev().copied().collect::<Vec<_>>()).unwrap();
        assert_eq!(Solids::of(&[&sheet, &back]).1, [NONE, NONE]);
    }
}
