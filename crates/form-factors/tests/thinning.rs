//! Small pairs are dropped within the budget of their rows, never computed, and given back without loss of symmetry or closure.

use radiosity_core::{BandValues, FormFactors};
use radiosity_form_factors::analytic::Analytic;
use radiosity_form_factors::checks::check;
use radiosity_form_factors::stores::{
    DenseFormFactors, Held, PackedFormFactors, SparseFormFactors, ThinnedFormFactors,
};
use radiosity_form_factors::{PairwiseRows, Rows, ThinnedRows, Thinning};
use radiosity_gallery::boxes::{box_in_cube, empty_box, material};
use radiosity_gallery::conformance;
use radiosity_gallery::rooms::two_rooms;
use radiosity_geometry::mesh::{Mesh, MeshSettings, Subdivision};
use radiosity_geometry::{Facets, Occluders, Scene};

/// Share of a row that may go.
const SHARE: f64 = 0.02;

fn mesh(scene: &Scene, k: u32) -> Facets {
    let settings = MeshSettings { elements: Subdivision::Uniform(k), patches: None, contacts: true };
    Mesh::new(scene, &Occluders::of_scene(scene), &settings).unwrap().element_facets
}

fn rooms() -> [Scene; 2] {
    let grey = || material("grey", 0.5, 1.0);
    [empty_box([3.0, 5.0, 2.0], grey()), box_in_cube(0.3, grey(), grey())]
}

fn pairs<'a>(facets: &'a Facets, blockers: &'a Occluders) -> PairwiseRows<'a, Analytic<'a>> {
    PairwiseRows::new(Analytic::new(Some(blockers)), facets, facets, 1e-8, 1)
}

/// Entries are those of the whole store or 0, and what a row lost is within what it was said to have lost at most, itself within the budget;
/// 1e-6 of an area is what partly blocked pairs may err by.
#[test]
fn a_row_loses_no_more_than_its_budget_and_what_stays_is_what_it_was() {
    for scene in rooms() {
        let (facets, blockers) = (mesh(&scene, 6), Occluders::blocking(&scene));
        let kept = vec![false; facets.len()];
        let thinning = Thinning::new(&facets, &kept, SHARE);
        assert!(thinning.share() <= SHARE && thinning.share() > 0.5 * SHARE);
        let (whole, _) = DenseFormFactors::assemble(&pairs(&facets, &blockers)).unwrap();
        let rows = ThinnedRows::new(Box::new(pairs(&facets, &blockers)), &thinning);
        let (thinned, _) = DenseFormFactors::assemble(&rows).unwrap();
        for s in 0..facets.len() {
            let mut lost = 0.0;
            for t in 0..facets.len() {
                let (all, some) = (whole.entry(s, t), thinned.entry(s, t));
                assert!(some == all || some == 0.0, "({s}, {t}): {some} of {all}");
                assert_eq!(some, thinned.entry(t, s));
                lost += all - some;
            }
            assert!(lost <= thinning.spent()[s] + 1e-6 * facets.area(s), "row {s} lost {lost}");
            assert!(thinning.spent()[s] <= SHARE * facets.area(s));
        }
    }
}

/// Of a smooth x and of one that jumps: what was dropped carried of it lies in the bounds by its sum, and those are within the ones that only know that no more was lost.
#[test]
fn what_dropped_pairs_carried_lies_within_its_bounds() {
    for scene in rooms() {
        let (facets, blockers) = (mesh(&scene, 6), Occluders::blocking(&scene));
        let m = facets.len();
        let weights: Vec<f64> = (0..m).map(|k| facets.polygons(k)[0].centroid().x + 0.1).collect();
        let budgets: Vec<f64> = (0..m).map(|k| if k % 7 == 0 { 0.01 } else { 0.1 }).collect();
        let thinning = Thinning::weighted(&facets, &vec![false; m], weights.clone(), &budgets);
        let (whole, _) = DenseFormFactors::assemble(&pairs(&facets, &blockers)).unwrap();
        let rows = ThinnedRows::new(Box::new(pairs(&facets, &blockers)), &thinning);
        let (kept, _) = DenseFormFactors::assemble(&rows).unwrap();
        let jumps = (0..m).map(|k| f64::from(u8::from(k % 5 < 2)));
        let x = BandValues::new(weights.iter().copied().chain(jumps).collect(), m);
        let dropped = |s: usize, t: usize| whole.entry(s, t) - kept.entry(s, t);
        let lost: Vec<f64> = (0..m).map(|s| (0..m).map(|t| dropped(s, t)).sum()).collect();
        assert_eq!(thinning.of_dropped(&whole).unwrap(), lost);
        let [exactly, at_most] = [true, false].map(|exactly| thinning.carried(x.view(), &lost, exactly));
        let mut inside = 0;
        for (s, budget) in budgets.iter().enumerate() {
            let spent: f64 = (0..m).map(|t| dropped(s, t) * weights[t]).sum();
            assert!(spent <= budget * facets.area(s), "row {s}");
            for band in 0..2 {
                let carried: f64 = (0..m).map(|t| dropped(s, t) * x.band(band)[t]).sum();
                let [low, high] = [0, 1].map(|end| exactly[end].band(band)[s]);
                // A sum of some hundred entries rounds.
                let slack = 1e-12 * facets.area(s);
                assert!(low <= carried + slack && carried <= high + slack, "row {s}: {low} {carried} {high}");
                assert!(at_most[0].band(band)[s] == 0.0 && high <= at_most[1].band(band)[s] + slack);
                inside += u32::from(high - low < 0.5 * at_most[1].band(band)[s]);
            }
        }
        assert!(inside > 0);
    }
}

#[test]
fn dropped_pairs_are_not_computed_and_counted_beforehand() {
    for scene in rooms() {
        let (facets, blockers) = (mesh(&scene, 6), Occluders::blocking(&scene));
        let thinning = Thinning::new(&facets, &vec![false; facets.len()], SHARE);
        let (_, all) = PackedFormFactors::<f64>::assemble(&pairs(&facets, &blockers)).unwrap();
        let rows = ThinnedRows::new(Box::new(pairs(&facets, &blockers)), &thinning);
        let (_, some) = PackedFormFactors::<f64>::assemble(&rows).unwrap();
        assert!(thinning.pairs() > all.form_factors / 50);
        assert_eq!(all.form_factors - some.form_factors, thinning.pairs());
    }
}

#[test]
fn facets_that_keep_their_pairs_lose_none() {
    let [scene, _] = rooms();
    let facets = mesh(&scene, 5);
    // The ceiling is the last of six faces.
    let kept: Vec<bool> = (0..facets.len()).map(|k| k >= facets.len() / 6 * 5).collect();
    let thinning = Thinning::new(&facets, &kept, SHARE);
    assert!(thinning.pairs() > 0);
    for (k, kept) in kept.iter().enumerate() {
        assert!(!kept || thinning.spent()[k] == 0.0);
    }
}

/// The row sums of the room are 1 to the tolerance of its pairs; what is given back makes up for what was dropped to rounding.
#[test]
fn rows_get_back_what_they_lost_in_every_store() {
    let [scene, _] = rooms();
    let (facets, blockers) = (mesh(&scene, 5), Occluders::blocking(&scene));
    let areas: Vec<f64> = (0..facets.len()).map(|k| facets.area(k)).collect();
    let thinning = Thinning::new(&facets, &vec![false; facets.len()], SHARE);
    let rows = ThinnedRows::new(Box::new(pairs(&facets, &blockers)), &thinning);
    let stores: [Box<dyn Held>; 3] = [
        Box::new(DenseFormFactors::assemble(&rows).unwrap().0),
        Box::new(SparseFormFactors::assemble(&rows).unwrap().0),
        Box::new(PackedFormFactors::<f64>::assemble(&rows).unwrap().0),
    ];
    for store in stores {
        let before = check(&*store, &areas, &areas, true).unwrap().closure.unwrap().1;
        let (store, _) = ThinnedFormFactors::new(store, &areas, thinning.spent(), 1.0).unwrap();
        let found = check(&store, &areas, &areas, true).unwrap();
        let after = found.closure.unwrap().1;
        assert!(before.abs() > 1e-3 && after.abs() < 1e-6, "{before} and {after}");
        assert_eq!((found.reciprocity.map_or(0.0, |(.., apart)| apart), found.negative), (0.0, 0));
        conformance(&store);
    }
}

/// Between two rooms wall to wall no entry is made where there was none.
#[test]
fn what_a_partition_parts_stays_apart() {
    let scene = two_rooms([true, false]);
    let (facets, blockers) = (mesh(&scene, 4), Occluders::blocking(&scene));
    let areas: Vec<f64> = (0..facets.len()).map(|k| facets.area(k)).collect();
    let thinning = Thinning::new(&facets, &vec![false; facets.len()], SHARE);
    let rows = ThinnedRows::new(Box::new(pairs(&facets, &blockers)), &thinning);
    assert_eq!(rows.name(), "analytic");
    let (store, _) = DenseFormFactors::assemble(&rows).unwrap();
    let (store, _) = ThinnedFormFactors::new(Box::new(store), &areas, thinning.spent(), 1.0).unwrap();
    let (half, mut buf) = (facets.len() / 2, radiosity_core::RowBuf::default());
    for (s, area) in areas[..half].iter().enumerate() {
        let row = store.row(s, 0, &mut buf).unwrap();
        assert!((half..facets.len()).all(|t| row.entries.get(t) == 0.0), "row {s}");
        assert!(row.entries.sum() > 0.9 * area);
    }
}
