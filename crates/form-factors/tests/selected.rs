//! Rows of selected facets have the entries that they have among all, to the last bit.

use radiosity_core::FormFactors;
use radiosity_form_factors::analytic::Analytic;
use radiosity_form_factors::hemicube::Hemicube;
use radiosity_form_factors::ray_cast::RayCast;
use radiosity_form_factors::stores::{DenseFormFactors, DiagonalBlocks};
use radiosity_form_factors::{Numbers, PairwiseRows, Receivers, Rows, SelectedRows};
use radiosity_gallery::boxes::{box_in_cube, material};
use radiosity_gallery::conformance;
use radiosity_geometry::mesh::{Mesh, MeshSettings, Subdivision};
use radiosity_geometry::{Facets, Occluders, Scene};

fn mesh(scene: &Scene) -> Facets {
    let settings = MeshSettings { elements: Subdivision::Uniform(2), patches: None, contacts: true };
    Mesh::new(scene, &Occluders::of_scene(scene), &settings).unwrap().element_facets
}

fn scene() -> Scene {
    box_in_cube(0.4, material("grey", 0.5, 1.0), material("grey", 0.5, 1.0))
}

fn rows(rows: &dyn Rows) -> Vec<Vec<f64>> {
    let row = |s| {
        let mut values = vec![0.0; rows.targets()];
        rows.row(s, &mut values).unwrap();
        values
    };
    (0..rows.sources()).map(row).collect()
}

fn same(all: &dyn Rows, some: &dyn Rows, sources: &[u32], targets: &[u32]) {
    let (all, some) = (rows(all), rows(some));
    for (row, &s) in some.iter().zip(sources) {
        let expected: Vec<f64> = targets.iter().map(|&t| all[s as usize][t as usize]).collect();
        assert_eq!(*row, expected, "row {s}");
    }
}

/// Segments are drawn by the numbers of a pair, in the order of the list.
#[test]
fn pairs_keep_their_samples_within_a_list_and_between_two_parts_of_it() {
    let scene = scene();
    let (facets, blockers) = (mesh(&scene), Occluders::blocking(&scene));
    let pairwise = || Analytic::new(Some(&blockers)).samples(16);
    let all = PairwiseRows::new(pairwise(), &facets, &facets, 1e-6, 7);
    let evens: Vec<u32> = (0..facets.len() as u32).step_by(2).collect();
    let odds: Vec<u32> = (1..facets.len() as u32).step_by(3).collect();
    let (even, odd) = (facets.select(&evens), facets.select(&odds));
    let numbers = |sources: &[u32], targets: &[u32]| Numbers {
        sources: sources.to_vec(),
        targets: targets.to_vec(),
        one_list: true,
    };
    let one = PairwiseRows::new(pairwise(), &even, &even, 1e-6, 7).numbered(numbers(&evens, &evens));
    assert!(one.symmetric());
    same(&all, &one, &evens, &evens);
    let two = PairwiseRows::new(pairwise(), &odd, &even, 1e-6, 7).numbered(numbers(&odds, &evens));
    same(&all, &two, &odds, &evens);
}

#[test]
fn rows_of_rays_and_hemicubes_keep_their_entries_and_count_those_given() {
    let scene = scene();
    let facets = mesh(&scene);
    let occluders = Occluders::of_facets(&facets);
    let (sources, targets): (Vec<u32>, Vec<u32>) = ((3..20).step_by(4).collect(), (5..40).collect());
    let rays = || RayCast::new(&facets, Receivers::facets(&facets), &occluders, 256, 7);
    let cubes = || Hemicube::new(&facets, Receivers::facets(&facets), 32, 7).unwrap();
    for pair in [[Box::new(rays()) as Box<dyn Rows>, Box::new(rays())], [Box::new(cubes()), Box::new(cubes())]] {
        let [all, some] = pair;
        let some = SelectedRows::new(some, sources.clone(), &targets);
        same(&*all, &some, &sources, &targets);
        let (_, cost) = DenseFormFactors::assemble(&some).unwrap();
        assert_eq!((cost.form_factors, cost.source_evaluations), (5 * 35, 5));
    }
}

/// Blocks whose sources lie between each other, and blocks that follow each other, the last one given first.
#[test]
fn blocks_conform_and_are_zero_beside_them() {
    blocks_of(&|f| f % 3 % 2);
    blocks_of(&|f| u32::from(f < 17));
}

fn blocks_of(part_of: &dyn Fn(u32) -> u32) {
    let scene = scene();
    let (facets, blockers) = (mesh(&scene), Occluders::blocking(&scene));
    let part = |k: u32| -> Vec<u32> { (0..facets.len() as u32).filter(|f| part_of(*f) == k).collect() };
    let block = |list: Vec<u32>| -> (Box<dyn FormFactors>, Vec<u32>, Vec<u32>) {
        let own = facets.select(&list);
        let rows = PairwiseRows::new(Analytic::new(Some(&blockers)), &own, &own, 1e-6, 7);
        (Box::new(DenseFormFactors::assemble(&rows).unwrap().0), list.clone(), list)
    };
    let store = DiagonalBlocks::new(vec![block(part(0)), block(part(1))], facets.len(), facets.len());
    conformance(&store);
    let mut buf = radiosity_core::RowBuf::default();
    let row = store.row(0, 0, &mut buf).unwrap();
    let other = part(1 - part_of(0));
    assert!(other.iter().all(|&t| row.entries.get(t as usize) == 0.0) && row.entries.sum() > 0.0);
}
