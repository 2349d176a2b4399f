//! What blocks only takes away: no obstruction raises a form factor, wherever it stands.

use glam::DVec3;
use radiosity_form_factors::analytic::Analytic;
use radiosity_form_factors::{Estimate, Pairwise};
use radiosity_geometry::{Occluders, Polygon};

/// The next of a sequence of numbers in [0, 1) (Steele, Lea and Flood's SplitMix, 2014).
fn uniform(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// A point with coordinates in [0, size).
fn point(state: &mut u64, size: f64) -> DVec3 {
    size * DVec3::new(uniform(state), uniform(state), uniform(state))
}

/// A triangle with corners in the cube of side `size` around `centre`.
fn triangle(state: &mut u64, centre: DVec3, size: f64) -> Polygon {
    loop {
        let corner = |state: &mut u64| point(state, size) - DVec3::splat(0.5 * size);
        let corners = [corner(state), corner(state), corner(state)];
        if let Ok(triangle) = Polygon::new(&corners.map(|c| centre + c)) {
            return triangle;
        }
    }
}

fn exchange(i: &Polygon, j: &Polygon, blockers: Vec<Polygon>) -> Estimate {
    let owners = (0..blockers.len() as u32).collect();
    Analytic::new(Some(&Occluders::new(blockers, owners))).exchange(i, j, 1e-10, 7)
}

/// Obstructions of all sizes, at a corner of one of the two surfaces, between them and anywhere: those beside a pair leave it as it
/// is, the others take something. Allowed is what both bounds leave open.
#[test]
fn no_obstruction_raises_a_form_factor() {
    let (mut state, mut seen, mut reduced) = (5, 0, 0);
    while seen < 150 {
        let (i, j) = (triangle(&mut state, DVec3::ZERO, 2.0), triangle(&mut state, DVec3::X * 2.5, 2.0));
        let without = exchange(&i, &j, vec![i.clone(), j.clone()]);
        if without.value == 0.0 {
            continue;
        }
        for size in [1e-3, 0.1, 1.0] {
            for at in [i.vertices()[0], 0.5 * (i.centroid() + j.centroid()), point(&mut state, 3.0)] {
                let with = exchange(&i, &j, vec![i.clone(), j.clone(), triangle(&mut state, at, size)]);
                let allowed = with.bound + without.bound;
                assert!(with.value <= without.value + allowed, "{i:?} {j:?} size {size} at {at}: {with:?} {without:?}");
                reduced += u32::from(with.value < without.value - allowed);
            }
        }
        seen += 1;
    }
    // A large triangle halfway hides something more often than not.
    assert!(reduced > 100, "{reduced}");
}
