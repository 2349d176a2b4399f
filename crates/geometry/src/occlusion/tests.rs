use super::*;
use crate::testing::{Random, cornell_box, cube, quad, scene_of};
use crate::{Facets, Mesh, MeshSettings, Subdivision};
use glam::{DMat3, DQuat};

fn elements(scene: &Scene, k: u32) -> Facets {
    let settings = MeshSettings { elements: Subdivision::Uniform(k), patches: None, contacts: false };
    Mesh::new(scene, &Occluders::of_scene(scene), &settings).unwrap().element_facets
}

fn rotation() -> DMat3 {
    DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7))
}

/// Distance from inside a cube of side 2 about the origin, rotated by `turn`, to its walls: slabs in its own frame.
fn distance_to_walls(p: DVec3, d: DVec3, turn: DMat3) -> f64 {
    let (p, d) = (turn.transpose() * p, turn.transpose() * d);
    (0..3).map(|k| (d[k].signum() - p[k]) / d[k]).fold(f64::INFINITY, f64::min)
}

/// 100,000 rays from random points in random directions, half of them aimed at grid vertices and points of grid lines;
/// walls of 7 × 7 cells that share vertices bit for bit. The distance is exact to rounding of a few coordinates.
fn no_ray_escapes(turn: DMat3, shift: DVec3) {
    let mut faces = cube(2.0);
    faces.iter_mut().flatten().for_each(|v| *v = turn * *v + shift);
    let facets = elements(&scene_of(&faces), 7);
    let occluders = Occluders::of_facets(&facets);
    assert_eq!(occluders.len(), 6 * 49);
    let mut random = Random(1);
    let tolerance = 1e-13 + 64.0 * f64::EPSILON * shift.abs().max_element();
    for k in 0..100_000 {
        let p = turn * random.point(DVec3::splat(-0.9), DVec3::splat(0.9)) + shift;
        let mut d = random.direction();
        if k % 2 == 0 {
            let corners = facets.polygons(k / 2 % facets.len())[0].vertices();
            let share = if k % 4 == 0 { 0.0 } else { random.unit() };
            d = (corners[0].lerp(corners[1], share) - p).normalize();
        }
        let hit = occluders.first_hit(p, d).unwrap_or_else(|| panic!("ray {k} escapes"));
        assert!(hit.front, "ray {k} meets a back");
        let error = hit.distance - distance_to_walls(p - shift, d, turn);
        assert!(error.abs() < tolerance, "ray {k}: distance off by {error}");
    }
}

#[test]
fn no_ray_escapes_a_cube() {
    no_ray_escapes(DMat3::IDENTITY, DVec3::ZERO);
}

#[test]
fn no_ray_escapes_a_cube_turned_and_moved_far_away() {
    no_ray_escapes(rotation(), DVec3::new(1e5, -1e5, 1e5));
}

#[test]
fn rays_along_the_axes_hit_where_cells_meet() {
    let occluders = Occluders::of_facets(&elements(&scene_of(&cube(2.0)), 4));
    for (axis, sign) in [(DVec3::X, 1.0), (DVec3::Y, -1.0), (DVec3::Z, 1.0), (DVec3::X, -1.0)] {
        // From the centre straight at a vertex of four cells.
        let hit = occluders.first_hit(DVec3::ZERO, axis * sign).unwrap();
        assert_eq!((hit.distance, hit.front), (1.0, true));
    }
}

/// Every fourth segment runs through a vertex, every other one through a point of a cell's edge: of a sheet of 5 × 5 cells,
/// turned so that nothing lies on a lattice.
#[test]
fn segments_through_shared_edges_and_vertices_are_blocked_both_ways() {
    let turn = rotation();
    let corner = |x: f64, y: f64| turn * DVec3::new(x, y, 0.0);
    let sheet = scene_of(&[quad(corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0))]);
    let facets = elements(&sheet, 5);
    let occluders = Occluders::of_facets(&facets);
    let mut random = Random(2);
    for k in 0..20_000 {
        let inner = facets.polygons([6, 7, 8, 11, 12, 13, 16, 17, 18][k % 9])[0].vertices();
        let share = if k % 4 == 0 { 0.0 } else { random.unit() };
        let target = inner[k % 4].lerp(inner[(k + 1) % 4], share);
        let p = turn * random.point(DVec3::new(-0.9, -0.9, 0.1), DVec3::new(0.9, 0.9, 1.0));
        let q = target + (target - p) * (0.1 + random.unit());
        assert!(occluders.occluded(p, q) && occluders.occluded(q, p), "segment {k}");
    }
}

/// The brute-force answer over all polygons, by the triple products of every edge: a route of its own. Random
/// segments come within rounding of an edge with a probability of about 1e-12.
#[test]
fn the_hierarchy_misses_nothing() {
    let occluders = Occluders::of_scene(&scene_of(&cornell_box()));
    let crosses = |polygon: &Polygon, p: DVec3, q: DVec3| {
        let (dp, dq) = (polygon.signed_distance(p), polygon.signed_distance(q));
        let sides: Vec<f64> = polygon.edges().map(|(a, b)| (a - p).cross(b - p).dot(q - p)).collect();
        dp * dq < 0.0 && (sides.iter().all(|&s| s > 0.0) || sides.iter().all(|&s| s < 0.0))
    };
    let mut random = Random(3);
    let (lo, hi) = (DVec3::splat(1.0), DVec3::splat(545.0));
    let mut blocked = 0;
    for k in 0..20_000 {
        let p = random.point(lo, hi);
        // From a thousandth of the box to all of it.
        let q = p + random.direction() * 545.0 * 10.0_f64.powf(-3.0 * random.unit());
        let expected = occluders.polygons().iter().any(|polygon| crosses(polygon, p, q));
        blocked += usize::from(expected);
        assert_eq!(occluders.occluded(p, q), expected, "segment {k}");
        let distance = |polygon: &Polygon| {
            polygon.signed_distance(p) / (polygon.signed_distance(p) - polygon.signed_distance(q)) * p.distance(q)
        };
        let crossed = occluders.polygons().iter().filter(|polygon| crosses(polygon, p, q));
        let nearest = crossed.map(distance).fold(f64::INFINITY, f64::min);
        let hit = occluders.first_hit(p, q - p).filter(|hit| hit.distance < p.distance(q));
        assert_eq!(hit.is_some(), expected, "ray {k}");
        assert!(hit.is_none_or(|hit| (hit.distance - nearest).abs() < 1e-10), "ray {k}");
    }
    assert!(blocked > 2_000, "{blocked}");
}

/// Segments of 1e-6 of the scene cross a sheet; single precision alone could not tell their ends apart at 1e5.
#[test]
fn short_segments_are_blocked() {
    let shift = DVec3::splat(1e5);
    let mut faces = cube(2.0);
    faces.push(quad(
        DVec3::new(-0.5, -0.5, 0.1),
        DVec3::new(0.5, -0.5, 0.1),
        DVec3::new(0.5, 0.5, 0.1),
        DVec3::new(-0.5, 0.5, 0.1),
    ));
    faces.iter_mut().flatten().for_each(|v| *v += shift);
    let occluders = Occluders::of_scene(&scene_of(&faces));
    let mut random = Random(4);
    for _ in 0..1000 {
        let middle = DVec3::new(random.unit() - 0.5, random.unit() - 0.5, 0.1) * DVec3::new(0.9, 0.9, 1.0) + shift;
        let half = DVec3::new(random.unit(), random.unit(), 1.0 + random.unit()) * 1e-6;
        assert!(occluders.occluded(middle - half, middle + half));
        assert!(!occluders.occluded(middle + half, middle + 3.0 * half));
        let hit = occluders.first_hit(middle + half, -half).unwrap();
        assert!(hit.front && (hit.distance - half.length()).abs() < 1e-10);
    }
}

#[test]
fn polygons_through_an_end_point_do_not_block() {
    let occluders = Occluders::of_scene(&scene_of(&cube(2.0)));
    let (floor, ceiling) = (DVec3::new(0.3, 0.2, -1.0), DVec3::new(-0.4, 0.1, 1.0));
    assert!(!occluders.occluded(floor, ceiling));
    // Along a wall, and from wall to outside through another.
    assert!(!occluders.occluded(floor, DVec3::new(-0.9, 0.9, -1.0)));
    assert!(occluders.occluded(floor, DVec3::new(0.3, 0.2, 1.5)));
    // Back to back: the neighbour's wall coincides with this one.
    let mut faces = cube(2.0);
    let moved: Vec<Vec<DVec3>> = cube(2.0).iter().map(|f| f.iter().map(|v| *v + DVec3::Z * 2.0).collect()).collect();
    faces.extend(moved);
    let twins = Occluders::of_scene(&scene_of(&faces));
    assert!(!twins.occluded(floor, ceiling));
    assert!(twins.occluded(floor, ceiling + DVec3::Z * 0.5));
}

/// A sheet given twice, once each way round, in either order and starting at any vertex.
#[test]
fn of_twin_sheets_the_one_that_faces_the_ray_is_hit() {
    let turn = rotation();
    let corners: Vec<DVec3> = [(-1.0, -1.0), (1.0, -1.0), (1.3, 1.0), (-1.0, 1.0)]
        .iter()
        .map(|&(x, y)| turn * DVec3::new(x, y, 0.5) + DVec3::splat(1e4))
        .collect();
    let mut random = Random(5);
    for start in 0..4 {
        let mut twin: Vec<DVec3> = corners.iter().rev().copied().collect();
        twin.rotate_left(start);
        for (faces, upper) in [([corners.clone(), twin.clone()], 0), ([twin, corners.clone()], 1)] {
            let occluders = Occluders::of_scene(&scene_of(&faces));
            for _ in 0..2000 {
                let target =
                    turn * random.point(DVec3::new(-0.9, -0.9, 0.5), DVec3::new(0.9, 0.9, 0.5)) + DVec3::splat(1e4);
                let p = target + random.direction();
                let above = (turn.transpose() * (p - target)).z > 0.0;
                let hit = occluders.first_hit(p, target - p).unwrap();
                assert!(hit.front && hit.owner == if above { upper } else { 1 - upper });
            }
        }
    }
}

#[test]
fn among_equal_polygons_the_smaller_index_is_hit() {
    let face = quad(DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y);
    let polygon = Polygon::new(&face).unwrap();
    let occluders = Occluders::new(vec![polygon; 9], (10..19).collect());
    let hit = occluders.first_hit(DVec3::new(0.3, 0.4, 5.0), DVec3::NEG_Z * 3.0).unwrap();
    assert_eq!(hit, Hit { owner: 10, polygon: 0, distance: 5.0, front: true });
}

#[test]
fn no_polygon_and_one_polygon_work() {
    let none = Occluders::new(Vec::new(), Vec::new());
    assert!(!none.occluded(DVec3::ZERO, DVec3::ONE) && none.first_hit(DVec3::ZERO, DVec3::X).is_none());
    none.overlapping(DVec3::NEG_INFINITY, DVec3::INFINITY, &mut |k| panic!("polygon {k} of none"));
    let one = Occluders::new(vec![Polygon::new(&[DVec3::ZERO, DVec3::X, DVec3::Y]).unwrap()], vec![7]);
    assert!(one.occluded(DVec3::new(0.2, 0.2, -1.0), DVec3::new(0.2, 0.2, 1.0)));
    assert!(!one.occluded(DVec3::new(0.8, 0.8, -1.0), DVec3::new(0.8, 0.8, 1.0)));
    // From far outside: a million times the scene's size.
    let hit = one.first_hit(DVec3::new(0.2, 0.2, 1e6), DVec3::NEG_Z).unwrap();
    assert_eq!((hit.owner, hit.distance), (7, 1e6));
    assert!(one.first_hit(DVec3::new(0.2, 0.2, 1e6), DVec3::Z).is_none());
    assert!(one.first_hit(DVec3::ZERO, DVec3::ZERO).is_none());
    let mut found = Vec::new();
    one.overlapping(DVec3::NEG_INFINITY, DVec3::INFINITY, &mut |k| found.push(k));
    assert_eq!(found, [0]);
}

/// Eight lanes decide nothing: every hit is the same to the bit, singly and in a batch.
#[test]
fn every_instruction_set_gives_the_same_hits() {
    let mut occluders = Occluders::of_facets(&elements(&scene_of(&cornell_box()), 6));
    let mut random = Random(7);
    let (lo, hi) = (DVec3::splat(1.0), DVec3::splat(545.0));
    let rays: Vec<(DVec3, DVec3)> = (0..5000).map(|_| (random.point(lo, hi), random.point(lo, hi))).collect();
    let directions: Vec<(DVec3, DVec3)> = rays.iter().map(|&(p, q)| (p, q - p)).collect();
    let mut answers = Vec::new();
    for level in Level::all() {
        occluders.level = level;
        let (mut hits, mut blocked) = (vec![None; rays.len()], vec![false; rays.len()]);
        occluders.first_hits(&directions, &mut hits);
        occluders.occluded_many(&rays, &mut blocked);
        for (k, &(p, q)) in rays.iter().enumerate() {
            assert_eq!((hits[k], blocked[k]), (occluders.first_hit(p, q - p), occluders.occluded(p, q)), "{level:?}");
        }
        answers.push((hits, blocked));
    }
    assert!(answers.iter().all(|answer| *answer == answers[0]));
    assert!(answers[0].1.iter().filter(|&&blocked| blocked).count() > 1000);
}

/// Squares that halve in size 100 times towards a corner, of which a hierarchy is as deep as it gets, and a heptagon behind them.
/// Each square is met by the ray at its own middle, and the heptagon by rays that pass beside them all.
#[test]
fn deep_hierarchies_and_polygons_of_many_corners_are_found() {
    let square = |k: i32| {
        let corner = |x: f64, y: f64| DVec3::new(1.0 + x, 1.0 + y, 1.0) * 0.5_f64.powi(k + 1);
        Polygon::new(&[corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)]).unwrap()
    };
    let heptagon: Vec<DVec3> = (0..7)
        .map(|k| {
            let (sin, cos) = (f64::from(k) / 7.0 * std::f64::consts::TAU).sin_cos();
            DVec3::new(4.0 * cos, 4.0 * sin, 1.0)
        })
        .collect();
    let mut polygons: Vec<Polygon> = (0..100).map(square).collect();
    polygons.push(Polygon::new(&heptagon).unwrap());
    let occluders = Occluders::new(polygons, (0..101).collect());
    for k in 0..100 {
        let middle = DVec3::new(1.5, 1.5, 0.0) * 0.5_f64.powi(k + 1) - DVec3::Z;
        assert_eq!(occluders.first_hit(middle, DVec3::Z).map(|hit| hit.owner), Some(k as u32), "square {k}");
        let beside = DVec3::new(-f64::from(k) / 30.0, 0.1, -1.0);
        assert_eq!(occluders.first_hit(beside, DVec3::Z).map(|hit| hit.owner), Some(100));
        assert!(occluders.occluded(beside, beside + DVec3::Z * 3.0));
    }
    assert!(occluders.first_hit(DVec3::new(-3.9, 1.6, -1.0), DVec3::Z).is_none(), "outside an edge of the heptagon");
}

#[test]
fn overlapping_finds_what_every_box_test_finds() {
    let occluders = Occluders::of_facets(&elements(&scene_of(&cornell_box()), 5));
    let mut random = Random(6);
    for _ in 0..200 {
        let lo = random.point(DVec3::splat(-50.0), DVec3::splat(550.0));
        let hi = lo + random.point(DVec3::ZERO, DVec3::splat(100.0));
        let mut found = Vec::new();
        occluders.overlapping(lo, hi, &mut |k| found.push(k));
        found.sort_unstable();
        let overlaps = |p: &Polygon| p.bounds().0.cmple(hi).all() && p.bounds().1.cmpge(lo).all();
        let expected: Vec<usize> = (0..occluders.len()).filter(|&k| overlaps(&occluders.polygons()[k])).collect();
        assert_eq!(found, expected);
    }
}

/// Of a cube no wall can block; of the Cornell box the ten sides and tops of its blocks.
#[test]
fn walls_of_a_convex_room_block_nothing() {
    assert!(blocking_polygons(&scene_of(&cube(1.0))).is_empty());
    assert!(Occluders::blocking(&scene_of(&cube(1.0))).is_empty());
    let scene = scene_of(&cornell_box());
    let surfaces: Vec<usize> = blocking_polygons(&scene).into_iter().map(|(s, _)| s).collect();
    // Its left wall leans: x = 552.8 at the floor, 556 at the ceiling, so the ceiling's edge is its boundary still.
    assert_eq!(surfaces, (9..19).collect::<Vec<_>>());
}

/// Of a cube beside another nothing lies between two points of that one; the walls of a cube within it do.
#[test]
fn what_lies_beside_a_room_blocks_nothing_in_it() {
    let moved =
        |cube: Vec<Vec<DVec3>>, by: DVec3| cube.into_iter().map(move |face| face.into_iter().map(|v| v + by).collect());
    let with = |side: f64, by: DVec3| {
        let loops: Vec<Vec<DVec3>> = cube(1.0).into_iter().chain(moved(cube(side), by)).collect();
        scene_of(&loops)
    };
    let in_the_first = |scene: &Scene| Occluders::blocking_among(scene, &|s| s < 6).len();
    let (beside, within) = (with(1.0, DVec3::new(1.5, 0.25, 0.0)), with(0.5, DVec3::ZERO));
    assert_eq!((in_the_first(&beside), in_the_first(&within)), (0, 6));
    assert!(!Occluders::blocking(&beside).is_empty());
}
