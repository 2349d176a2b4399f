//! Many shadows that overlap: the receiver is cut, point by point, into pieces that no shadow covers.

use std::f64::consts::TAU;

use glam::DVec3;

/// Pieces of a receiver as seen from a point, kept from point to point.
#[derive(Default)]
pub(super) struct Crowd {
    pieces: Loops,
    left: Loops,
    inside: Vec<DVec3>,
    beyond: Vec<DVec3>,
    rest: Vec<DVec3>,
}

/// Loops one after another.
#[derive(Default)]
struct Loops {
    corners: Vec<DVec3>,
    ends: Vec<usize>,
}

impl Loops {
    fn clear(&mut self) {
        self.corners.clear();
        self.ends.clear();
    }

    fn push(&mut self, corners: &[DVec3]) {
        if corners.len() > 2 {
            self.corners.extend_from_slice(corners);
            self.ends.push(self.corners.len());
        }
    }

    fn iter(&self) -> impl Iterator<Item = &[DVec3]> {
        let begins = std::iter::once(0).chain(self.ends.iter().copied());
        begins.zip(&self.ends).map(|(begin, &end)| &self.corners[begin..end])
    }
}

impl Crowd {
    /// Form factor from the point (s, t, 0), normal z, to what no shadow covers of a receiver.
    pub fn visible(&mut self, s: f64, t: f64, receiver: &[DVec3], shadows: &[Vec<DVec3>]) -> f64 {
        let x = DVec3::new(s, t, 0.0);
        self.pieces.clear();
        self.rest.clear();
        self.rest.extend(receiver.iter().map(|v| *v - x));
        self.pieces.push(&self.rest);
        for shadow in shadows {
            self.left.clear();
            for piece in self.pieces.iter() {
                self.inside.clear();
                self.inside.extend_from_slice(piece);
                for k in 0..shadow.len() {
                    // The half-space of an edge: what is beyond stays seen, what is inside goes on to the next edge.
                    let (p, q) = (shadow[k] - x, shadow[(k + 1) % shadow.len()] - x);
                    split(&self.inside, q.cross(p), &mut self.rest, &mut self.beyond);
                    self.left.push(&self.beyond);
                    std::mem::swap(&mut self.inside, &mut self.rest);
                    if self.inside.len() < 3 {
                        break;
                    }
                }
            }
            std::mem::swap(&mut self.pieces, &mut self.left);
        }
        self.pieces.iter().map(lambert).sum()
    }
}

/// The parts of a loop on both sides of a plane through the origin.
fn split(corners: &[DVec3], n: DVec3, inside: &mut Vec<DVec3>, beyond: &mut Vec<DVec3>) {
    inside.clear();
    beyond.clear();
    for k in 0..corners.len() {
        let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
        let (h_a, h_b) = (a.dot(n), b.dot(n));
        if h_a >= 0.0 {
            inside.push(a);
        }
        if h_a <= 0.0 {
            beyond.push(a);
        }
        if h_a * h_b < 0.0 {
            let meet = a + (b - a) * (h_a / (h_a - h_b));
            inside.push(meet);
            beyond.push(meet);
        }
    }
    // All on one side: the other has touching corners at most.
    if corners.iter().all(|v| v.dot(n) >= 0.0) {
        beyond.clear();
    } else if corners.iter().all(|v| v.dot(n) <= 0.0) {
        inside.clear();
    }
}

fn lambert(corners: &[DVec3]) -> f64 {
    let share = |k: usize| {
        let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
        let cross = b.cross(a);
        let sine = cross.length();
        if sine > 0.0 { cross.z / sine * sine.atan2(a.dot(b)) } else { 0.0 }
    };
    (0..corners.len()).map(share).sum::<f64>() / TAU
}
