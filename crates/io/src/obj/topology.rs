//! Faces given twice and edges that no other face shares, told by coordinates rather than by indices.

use std::collections::HashMap;

use glam::DVec3;

/// A face as a loop of points; points of equal coordinates have the same number.
pub(crate) type Loop = Vec<u32>;

/// Numbers points so that equal coordinates (0 and −0 alike) have equal numbers.
#[derive(Default)]
pub(crate) struct Points {
    numbers: HashMap<[u64; 3], u32>,
}

impl Points {
    /// The loop of these corners, corners that repeat their predecessor left out.
    pub fn close(&mut self, corners: &[DVec3]) -> Loop {
        let mut closed: Loop = corners.iter().map(|corner| self.number(*corner)).collect();
        closed.dedup();
        while closed.len() > 1 && closed.first() == closed.last() {
            closed.pop();
        }
        closed
    }

    fn number(&mut self, point: DVec3) -> u32 {
        let next = self.numbers.len() as u32;
        // Adding 0 turns −0 into 0.
        *self.numbers.entry(point.to_array().map(|x| (x + 0.0).to_bits())).or_insert(next)
    }
}

/// How a face relates to the ones before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Repeat {
    /// No other face has these corners.
    New,
    /// An earlier face has the same corners the other way round.
    OtherSide,
    /// An earlier face has the same corners the same way round.
    Same,
}

/// Finds faces that have the same corners in the same cyclic order, either way round.
#[derive(Default)]
pub(crate) struct Repeats {
    /// By the loop's normal form: whether it was met that way round, and the other.
    seen: HashMap<Loop, [bool; 2]>,
}

impl Repeats {
    /// Enters a face and says whether it repeats an earlier one.
    pub fn enter(&mut self, face: &[u32]) -> Repeat {
        let reversed: Loop = face.iter().rev().copied().collect();
        let (forward, backward) = (from_least(face), from_least(&reversed));
        let way = usize::from(backward < forward);
        let seen = self.seen.entry(forward.min(backward)).or_default();
        let repeat = match (seen[way], seen[1 - way]) {
            (true, _) => Repeat::Same,
            (false, true) => Repeat::OtherSide,
            (false, false) => Repeat::New,
        };
        seen[way] = true;
        repeat
    }
}

/// The loop turned so that it is the least of all its turns.
fn from_least(face: &[u32]) -> Loop {
    let turn = |k: usize| face[k..].iter().chain(&face[..k]);
    // Only turns that begin with the least point can be the least.
    let least = face.iter().min();
    let starts = (0..face.len()).filter(|k| Some(&face[*k]) == least);
    let best = starts.min_by(|a, b| turn(*a).cmp(turn(*b))).unwrap_or(0);
    turn(best).copied().collect()
}

/// Edges of one face only, and edges of several that do not run as often one way as the other.
pub(crate) fn edges<'a>(faces: impl Iterator<Item = &'a Loop>) -> (usize, usize) {
    let mut uses: HashMap<(u32, u32), [usize; 2]> = HashMap::new();
    for face in faces {
        for k in 0..face.len() {
            let (a, b) = (face[k], face[(k + 1) % face.len()]);
            uses.entry((a.min(b), a.max(b))).or_default()[usize::from(a > b)] += 1;
        }
    }
    let open = uses.values().filter(|[forward, backward]| forward + backward == 1).count();
    let unequal = uses.values().filter(|[forward, backward]| forward != backward).count();
    (open, unequal - open)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_loop_is_the_same_and_a_reversed_one_the_other_side() {
        let mut repeats = Repeats::default();
        assert_eq!(repeats.enter(&[4, 2, 7, 5]), Repeat::New);
        assert_eq!(repeats.enter(&[7, 5, 4, 2]), Repeat::Same);
        assert_eq!(repeats.enter(&[2, 4, 5, 7]), Repeat::OtherSide);
        assert_eq!(repeats.enter(&[4, 5, 7, 2]), Repeat::Same);
        assert_eq!(repeats.enter(&[4, 2, 5, 7]), Repeat::New, "other cyclic order, another polygon");
        assert_eq!(repeats.enter(&[4, 2, 7]), Repeat::New);
    }

    #[test]
    fn a_tetrahedron_is_closed_until_a_face_goes_or_turns() {
        let faces: Vec<Loop> = vec![vec![0, 2, 1], vec![0, 1, 3], vec![1, 2, 3], vec![2, 0, 3]];
        assert_eq!(edges(faces.iter()), (0, 0));
        assert_eq!(edges(faces[1..].iter()), (3, 0));
        let mut turned = faces;
        turned[0].reverse();
        assert_eq!(edges(turned.iter()), (0, 3));
    }

    #[test]
    fn points_are_told_by_coordinates_and_repeated_corners_go() {
        let mut points = Points::default();
        let (a, b, c) = (DVec3::ZERO, DVec3::X, DVec3::Y);
        assert_eq!(points.close(&[a, b, b, c, -a]), [0, 1, 2]);
        assert_eq!(points.close(&[c, a, DVec3::new(1.0, -0.0, 0.0)]), [2, 0, 1]);
        assert_eq!(points.close(&[a, a, a]), [0]);
    }
}
