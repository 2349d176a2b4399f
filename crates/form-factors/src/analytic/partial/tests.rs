use super::super::unoccluded;
use super::super::visibility::{Screens, Visibility};
use super::*;
use radiosity_geometry::Polygon;

/// Faces of an axis-parallel cube from lo to hi, each k × k.
fn cube(lo: f64, hi: f64, k: usize, inward: bool) -> Vec<Polygon> {
    let mut faces = Vec::new();
    for (axis, side) in (0..6).map(|f| (f / 2, f % 2)) {
        for (i, j) in (0..k * k).map(|c| (c / k, c % k)) {
            let at = |i: usize, j: usize| {
                let mut x = [if side == 1 { hi } else { lo }; 3];
                let along = |i: usize| lo + (hi - lo) * i as f64 / k as f64;
                (x[(axis + 1) % 3], x[(axis + 2) % 3]) = (along(i), along(j));
                DVec3::from_array(x)
            };
            let mut corners = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            if (side == 1) == inward {
                corners.reverse();
            }
            faces.push(Polygon::new(&corners).unwrap());
        }
    }
    faces
}

/// The points lie on one polygon or on the other: two integrals that have nothing in common but the pair. Each is asked for 1e-8.
#[test]
fn points_on_either_polygon_give_the_same() {
    let elements: Vec<Polygon> = cube(0.0, 1.0, 4, true).into_iter().chain(cube(0.3, 0.7, 2, false)).collect();
    let occluders = Occluders::new(cube(0.3, 0.7, 1, false), (0..6).collect());
    let bodies = Bodies::find(&occluders);
    let screens = Screens::new(&occluders, &bodies);
    let mut pairs = 0;
    for (a, b) in (0..elements.len()).flat_map(|a| (0..a).map(move |b| (a, b))) {
        let (i, j) = (&elements[a], &elements[b]);
        let Some(pair) = FacingPair::new(i, j) else { continue };
        let Visibility::Partial(blockers) = screens.classify(&occluders, &pair) else { continue };
        let smaller = i.area().min(j.area());
        let whole = unoccluded::exchange_area(&pair, smaller, 1e-12);
        let absolute = smaller * 1e-8;
        let blocked = Blocked { occluders: &occluders, bodies: &bodies, blockers: &blockers, absolute };
        let [one, other] = [false, true].map(|second| blocked.visible_from(&pair, whole, second).area);
        let difference = (one.value - other.value).abs() / smaller;
        assert!(difference < 2e-8, "{a} {b}: {difference:e} {one:?} {other:?}");
        pairs += 1;
    }
    assert_eq!(pairs, 1560);
}
