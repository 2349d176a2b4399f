//! Which pairs a change of blockers can reach.

use glam::DVec3;
use radiosity_form_factors::analytic::{Analytic, BlockerChange, facing_pairs};
use radiosity_form_factors::{Pairwise, PairwiseRows, Rows};
use radiosity_gallery::boxes;
use radiosity_geometry::{Facets, Occluders, Polygon};

/// SplitMix64 (Steele, Lea & Flood 2014): fixed random numbers.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit())
    }

    /// A parallelogram with edges of up to `size` in the unit cube.
    fn parallelogram(&mut self, size: f64) -> Polygon {
        loop {
            let (at, u, v) = (self.vector(), (self.vector() - 0.5) * size, (self.vector() - 0.5) * size);
            if let Ok(polygon) = Polygon::new(&[at, at + u, at + u + v, at + v]) {
                return polygon;
            }
        }
    }
}

fn occluders(polygons: &[Polygon]) -> Occluders {
    Occluders::new(polygons.to_vec(), (0..polygons.len() as u32).collect())
}

/// A box as blockers.
fn solid(lo: DVec3, hi: DVec3) -> Vec<Polygon> {
    boxes::faces(lo, hi, false).iter().map(|face| Polygon::new(face).unwrap()).collect()
}

/// Compares all pairs of `facets` among two lists of blockers: pairs out of reach must be equal to the last bit. Returns how many are within
/// reach, how many of those differ, and how many face each other.
fn compare(facets: &Facets, before: &[Polygon], after: &[Polygon]) -> (usize, usize, usize) {
    let (before, after) = (occluders(before), occluders(after));
    let (was, is) = (Analytic::new(Some(&before)), Analytic::new(Some(&after)));
    let change = BlockerChange::new(&was, &is);
    let sides = change.sides(facets);
    let (mut reached, mut different, mut facing) = (0, 0, 0);
    for s in 0..facets.len() {
        for t in s + 1..facets.len() {
            let (i, j) = (&facets.polygons(s)[0], &facets.polygons(t)[0]);
            let [old, new] = [&was, &is].map(|estimator| estimator.exchange(i, j, 1e-8, 1));
            let reaches = change.reaches((&sides, s), (&sides, t), std::iter::once((i, j)));
            assert!(reaches || (old.value, old.bound, old.cost) == (new.value, new.bound, new.cost), "pair ({s}, {t})");
            reached += usize::from(reaches);
            different += usize::from(old.value != new.value);
            facing += new.cost.form_factors as usize;
        }
    }
    (reached, different, facing)
}

#[test]
fn pairs_out_of_reach_of_a_moved_blocker_are_computed_alike_to_the_last_bit() {
    let mut random = Random(7);
    let mut facets = Facets::new();
    (0..60).for_each(|_| facets.push(vec![random.parallelogram(0.5)], false));
    let blockers: Vec<Polygon> = (0..10).map(|_| random.parallelogram(0.6)).collect();
    let mut after = blockers.clone();
    after[4] = random.parallelogram(0.6);
    let (reached, different, facing) = compare(&facets, &blockers, &after);
    // What is within reach has mostly changed: the test asks no more than the hull of a pair does.
    assert!(different > 50 && different <= reached, "{different} of {reached}");
    assert!(reached < 2 * different && reached < facing / 2, "{reached} of {facing} within reach, {different} differ");
}

/// Faces of a box hide as one body: without its lid the other five hide alone, for pairs that the lid is far from too.
#[test]
fn a_body_that_lost_a_face_blocks_otherwise_with_all_others() {
    let mut random = Random(11);
    let mut facets = Facets::new();
    (0..60).for_each(|_| facets.push(vec![random.parallelogram(0.4)], false));
    let body = solid(DVec3::splat(0.3), DVec3::splat(0.7));
    let mut after = body.clone();
    let lid: Vec<DVec3> = body[5].vertices().iter().map(|v| *v + DVec3::Z * 0.1).collect();
    after[5] = Polygon::new(&lid).unwrap();
    let (before, opened) = (occluders(&body), occluders(&after));
    let change = BlockerChange::new(&Analytic::new(Some(&before)), &Analytic::new(Some(&opened)));
    assert_eq!(change.len(), 12);
    let (reached, different, _) = compare(&facets, &body, &after);
    assert!(different > 50 && different <= reached, "{different} of {reached}");
}

/// Beyond 24 blockers they are found by their boxes and not body by body: a body may then be found in the way that was not.
#[test]
fn where_blockers_become_many_bodies_count_as_changed() {
    let mut random = Random(13);
    let mut facets = Facets::new();
    (0..60).for_each(|_| facets.push(vec![random.parallelogram(0.4)], false));
    let mut blockers = solid(DVec3::splat(0.4), DVec3::splat(0.6));
    blockers.extend((0..18).map(|_| random.parallelogram(0.05)));
    let mut after = blockers.clone();
    after.push(random.parallelogram(0.05));
    let (few, many) = (occluders(&blockers), occluders(&after));
    let change = BlockerChange::new(&Analytic::new(Some(&few)), &Analytic::new(Some(&many)));
    assert_eq!(change.len(), 6 + 6 + 1);
    compare(&facets, &blockers, &after);
    // Others that come or go leave it as it was.
    let fewer = occluders(&blockers[..20]);
    let change = BlockerChange::new(&Analytic::new(Some(&few)), &Analytic::new(Some(&fewer)));
    assert_eq!(change.len(), 4);
}

/// The count of rows, against pairs with one of two facets in all.
#[test]
fn facing_pairs_are_what_rows_count() {
    let mut random = Random(17);
    let mut facets = Facets::new();
    (0..70).for_each(|k| facets.push((0..1 + k % 3).map(|_| random.parallelogram(0.5)), false));
    let estimator = Analytic::new(None);
    let rows = PairwiseRows::new(&estimator, &facets, &facets, 1e-6, 1);
    let count = |first: usize| -> u64 {
        let mut values = vec![0.0; facets.len()];
        (first..facets.len()).map(|s| rows.upper_row(s, &mut values).unwrap().0.form_factors).sum()
    };
    let all: Vec<u32> = (0..70).collect();
    assert_eq!(facing_pairs(&facets, &facets, &all, &all), count(0));
    // Pairs of the first two: all but those of the rest among themselves.
    assert_eq!(facing_pairs(&facets, &facets, &[0, 1], &[0, 1]), count(0) - count(2));
    // Between two lists a pair is chosen by either of its ends.
    let others = facets.clone();
    let counted = |s: usize, t: usize| -> u64 {
        let pairs = facets.polygons(s).iter().flat_map(|i| others.polygons(t).iter().map(move |j| (i, j)));
        pairs.map(|(i, j)| estimator.exchange(i, j, 1e-6, 1).cost.form_factors).sum()
    };
    let either = (0..70).flat_map(|s| (0..70).map(move |t| (s, t))).filter(|&(s, t)| s < 2 || t < 3);
    assert_eq!(facing_pairs(&facets, &others, &[0, 1], &[0, 1, 2]), either.map(|(s, t)| counted(s, t)).sum());
}
