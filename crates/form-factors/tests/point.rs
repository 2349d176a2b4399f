//! Form factors from a point among blockers, against other sums of closed forms.

use glam::DVec3;
use radiosity_form_factors::analytic::differential;
use radiosity_form_factors::point::form_factors_from;
use radiosity_geometry::{Facets, Polygon};

fn polygon(corners: &[(f64, f64, f64)]) -> Polygon {
    Polygon::new(&corners.iter().map(|&(x, y, z)| DVec3::new(x, y, z)).collect::<Vec<_>>()).unwrap()
}

/// A rectangle at height z that looks down.
fn lid(x: (f64, f64), y: (f64, f64), z: f64) -> Polygon {
    polygon(&[(x.0, y.0, z), (x.0, y.1, z), (x.1, y.1, z), (x.1, y.0, z)])
}

fn facets(polygons: impl IntoIterator<Item = Polygon>) -> Facets {
    let mut facets = Facets::new();
    polygons.into_iter().for_each(|p| facets.push(vec![p], false));
    facets
}

/// The faces of a box, looking out (`out`) or in.
fn cuboid(lo: DVec3, hi: DVec3, out: bool) -> Vec<Polygon> {
    let v = |k: usize| DVec3::new([lo.x, hi.x][k & 1], [lo.y, hi.y][k >> 1 & 1], [lo.z, hi.z][k >> 2 & 1]);
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let face = |f: [usize; 4]| {
        let mut corners = f.map(v);
        if !out {
            corners.reverse();
        }
        Polygon::new(&corners).unwrap()
    };
    faces.map(face).to_vec()
}

const P: DVec3 = DVec3::new(0.3, -0.2, 0.0);

/// A blocker halfway up hides the rectangle twice its size about the point: the lid less that rectangle. Sums of 8 and 32 angles.
#[test]
fn a_blocker_hides_its_projection() {
    let (whole, blocker) = (lid((-3.0, 5.0), (-4.0, 3.0), 2.0), lid((-0.5, 1.0), (-0.25, 0.5), 1.0));
    let hidden = lid((2.0 * -0.5 - P.x, 2.0 - P.x), (2.0 * -0.25 - P.y, 1.0 - P.y), 2.0);
    let expected = differential(P, DVec3::Z, &whole) - differential(P, DVec3::Z, &hidden);
    let found = form_factors_from(P, DVec3::Z, &facets([whole]), &[blocker])[0];
    assert!((found - expected).abs() < 2e-15, "{found} {expected}");
}

/// Both sides block, and a blocker cut in two, one half given twice, blocks the same.
#[test]
fn turning_and_splitting_a_blocker_changes_nothing() {
    let whole = facets([lid((-3.0, 5.0), (-4.0, 3.0), 2.0)]);
    let blocker = [(-0.5, -0.25, 1.0), (1.0, -0.25, 1.25), (1.0, 0.5, 1.25), (-0.5, 0.5, 1.0)];
    let turned: Vec<_> = blocker.iter().rev().copied().collect();
    let halves = [[0, 1, 2], [0, 2, 3], [2, 3, 0]].map(|t| polygon(&t.map(|k: usize| blocker[k])));
    let expected = form_factors_from(P, DVec3::Z, &whole, &[polygon(&blocker)])[0];
    for blockers in [&[polygon(&turned)][..], &halves] {
        assert!((form_factors_from(P, DVec3::Z, &whole, blockers)[0] - expected).abs() < 2e-15);
    }
    assert!(expected < form_factors_from(P, DVec3::Z, &whole, &[])[0] - 0.1);
}

/// A wall that stands through the lid hides only what lies behind it: of the lid beyond x = 1 nothing is seen above the wall's top, as
/// the wall reaches higher than the lid. What is left is the lid before the wall.
#[test]
fn what_lies_before_a_blocker_that_pierces_the_target_is_seen() {
    let wall = polygon(&[(1.0, -99.0, -1.0), (1.0, 99.0, -1.0), (1.0, 99.0, 3.0), (1.0, -99.0, 3.0)]);
    let found = form_factors_from(P, DVec3::Z, &facets([lid((-3.0, 5.0), (-4.0, 3.0), 2.0)]), &[wall])[0];
    let expected = differential(P, DVec3::Z, &lid((-3.0, 1.0), (-4.0, 3.0), 2.0));
    assert!((found - expected).abs() < 1e-15);
}

/// In a closed room with a box every direction ends on a front: the factors sum to 1, to the rounding of some 60 parts, from
/// points on walls and on the box, turned and far from the origin.
#[test]
fn factors_in_a_closed_room_sum_to_one() {
    for at in [DVec3::ZERO, DVec3::new(1e3, -2e3, 500.0)] {
        let room = cuboid(at, at + DVec3::new(3.0, 5.0, 4.0), false);
        let block = cuboid(at + DVec3::new(1.0, 1.5, 0.5), at + DVec3::new(1.75, 3.0, 2.0), true);
        let all = facets(room.into_iter().chain(block));
        let blockers: Vec<Polygon> = all.iter_polygons().map(|(_, p)| p.clone()).collect();
        for (point, normal) in [
            (DVec3::new(0.4, 0.7, 0.0), DVec3::Z),
            (DVec3::new(0.0, 2.0, 1.0), DVec3::X),
            (DVec3::new(1.2, 2.0, 2.0), DVec3::Z),
            (DVec3::new(2.5, 2.0, 1.0), DVec3::new(-0.6, 0.64, 0.48)),
        ] {
            let sum: f64 = form_factors_from(at + point, normal, &all, &blockers).iter().sum();
            // Coordinates of 2e3 carry 2e-13, seen from a distance of about 1.
            let allowed = if at == DVec3::ZERO { 1e-14 } else { 2e-12 };
            assert!((sum - 1.0).abs() < allowed, "{point} {normal}: {:e}", sum - 1.0);
        }
    }
}

/// A blocker of 1e-6 × 1e-6 hides what the closed form of its own takes, to 1e-9 of it: rounding of 1e-16 on 1e-13 and more.
#[test]
fn the_smallest_blocker_is_not_missed() {
    let s = 1e-6;
    let lid_ = facets([lid((-3.0, 5.0), (-4.0, 3.0), 2.0)]);
    let blocker = lid((0.1, 0.1 + s), (0.2, 0.2 + s), 1.0);
    let open = form_factors_from(P, DVec3::Z, &lid_, &[])[0];
    let hidden = open - form_factors_from(P, DVec3::Z, &lid_, std::slice::from_ref(&blocker))[0];
    // cos θ cos θ' A / (π r²) with r² = 0.04 + 0.16 + 1 from the point to the blocker.
    let expected = s * s / (std::f64::consts::PI * 1.2 * 1.2);
    assert!((hidden - expected).abs() < 1e-15, "{hidden:e} {expected:e}");
}

#[test]
fn a_sheet_in_the_plane_of_the_point_or_of_the_target_hides_nothing() {
    let whole = lid((-3.0, 5.0), (-4.0, 3.0), 2.0);
    let expected = differential(P, DVec3::Z, &whole);
    let blockers = [whole.clone(), lid((-9.0, 9.0), (-9.0, 9.0), 0.0), lid((-9.0, 9.0), (-9.0, 9.0), 2.0)];
    assert_eq!(form_factors_from(P, DVec3::Z, &facets([whole]), &blockers), [expected]);
}
