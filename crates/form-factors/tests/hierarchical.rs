//! Links against the full matrix of pairs, closure, symmetry and partitions.

use std::sync::Arc;

use glam::DVec3;
use radiosity_core::{FormFactors, RowBuf};
use radiosity_form_factors::PairwiseRows;
use radiosity_form_factors::analytic::Analytic;
use radiosity_form_factors::hierarchical::{Brightness, HierarchicalFormFactors, Hierarchy, Linking, Links};
use radiosity_form_factors::stores::DenseFormFactors;
use radiosity_gallery::boxes::{box_in_cube, inward_face, material, scene_of_loops, unit_cube};
use radiosity_gallery::conformance;
use radiosity_geometry::mesh::{Mesh, MeshSettings, Subdivision};
use radiosity_geometry::{Facets, Material, Occluders, Scene};

const SEED: u64 = 3;

fn grey() -> Material {
    material("grey", 0.5, 1.0)
}

/// A meshed scene: exposed elements, what blocks, and the nodes over them.
struct Case {
    mesh: Mesh,
    exposed: Vec<u32>,
    elements: Facets,
    blockers: Occluders,
    hierarchy: Arc<Hierarchy>,
}

impl Case {
    fn new(scene: &Scene, divisions: u32) -> Self {
        let settings = MeshSettings { elements: Subdivision::Uniform(divisions), patches: None, contacts: true };
        let mesh = Mesh::new(scene, &Occluders::of_scene(scene), &settings).unwrap();
        let exposed: Vec<u32> =
            (0..mesh.elements.len() as u32).filter(|&e| !mesh.elements[e as usize].covered).collect();
        let elements = mesh.element_facets.select(&exposed);
        let hierarchy = Arc::new(Hierarchy::new(&mesh, &exposed, &elements));
        Self { mesh, exposed, elements, blockers: Occluders::blocking(scene), hierarchy }
    }

    fn links(&self, threshold: f64) -> (Links, f64) {
        let estimator = Analytic::new(Some(&self.blockers));
        let linking = Linking::new(&self.hierarchy, &self.elements, &self.blockers, estimator, 1e-8, SEED);
        let uniform = Brightness::uniform(&self.hierarchy);
        let links = linking.links(threshold, &uniform).0;
        let error = links.error(&self.hierarchy, &uniform);
        (links, error)
    }

    fn store(&self, threshold: f64) -> HierarchicalFormFactors {
        HierarchicalFormFactors::new(Arc::clone(&self.hierarchy), &self.links(threshold).0)
    }

    fn matrix(&self) -> DenseFormFactors {
        let estimator = Analytic::new(Some(&self.blockers));
        DenseFormFactors::assemble(&PairwiseRows::new(estimator, &self.elements, &self.elements, 1e-8, SEED)).unwrap().0
    }

    /// Rms over the elements of Σ_t F_st − 1, area-weighted.
    fn closure(&self, store: &HierarchicalFormFactors) -> f64 {
        let (sums, areas) = (store.row_sums().unwrap(), self.elements.areas());
        let square: f64 = sums.iter().zip(&areas).map(|(sum, a)| a * (sum - 1.0).powi(2)).sum();
        (square / areas.iter().sum::<f64>()).sqrt()
    }
}

/// Kernels are kept in single precision and areas to 26 bits: 6e-8 + 2 · 1.5e-8 of an entry.
#[test]
fn links_of_no_error_are_the_matrix_of_pairs() {
    for (scene, divisions) in [(unit_cube(grey()), 5), (box_in_cube(0.4, grey(), grey()), 3)] {
        let case = Case::new(&scene, divisions);
        let (links, full) = (case.store(0.0), case.matrix());
        let (mut a, mut b) = (RowBuf::default(), RowBuf::default());
        for s in 0..full.sources() {
            let (found, wanted) = (links.row(s, 0, &mut a).unwrap().entries, full.row(s, 0, &mut b).unwrap().entries);
            for t in 0..full.targets() {
                let (found, wanted) = (found.get(t), wanted.get(t));
                assert!((found - wanted).abs() <= 1e-7 * wanted, "{s} {t}: {found:e}, {wanted:e}");
            }
        }
    }
}

/// In a closed room every row sums to 1. The estimate adds what links may miss by size, while slopes of one receiver partly cancel: it
/// must be above, and is known to be more than it needs.
#[test]
fn rows_of_a_closed_room_sum_to_one_within_the_estimate() {
    for scene in [unit_cube(grey()), box_in_cube(0.4, grey(), grey())] {
        let case = Case::new(&scene, 16);
        for threshold in [1e-3, 3e-4, 1e-4] {
            let (links, estimate) = case.links(threshold);
            let store = HierarchicalFormFactors::new(Arc::clone(&case.hierarchy), &links);
            let closure = case.closure(&store);
            assert!(closure <= estimate, "{threshold:e}: rows are off by {closure:e}, estimated {estimate:e}");
            assert!(estimate < 40.0 * closure, "{threshold:e}: rows are off by {closure:e}, estimated {estimate:e}");
        }
    }
}

#[test]
fn the_store_of_links_conforms() {
    let case = Case::new(&box_in_cube(0.4, grey(), grey()), 3);
    for threshold in [3e-3, 0.0] {
        conformance(&case.store(threshold));
    }
    // One surface is a tree without clusters, and sees nothing.
    let alone = Case::new(&scene_of_loops(&[(inward_face(DVec3::ZERO, DVec3::ONE, 2, false), 0)], vec![grey()]), 3);
    conformance(&alone.store(1e-3));
    assert_eq!(alone.store(1e-3).links(), 0);
}

#[test]
fn links_have_the_same_bytes_at_1_2_and_8_threads() {
    let case = Case::new(&box_in_cube(0.4, grey(), grey()), 8);
    let rows = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let tree = Arc::new(Hierarchy::new(&case.mesh, &case.exposed, &case.elements));
            let estimator = Analytic::new(Some(&case.blockers));
            let linking = Linking::new(&tree, &case.elements, &case.blockers, estimator, 1e-8, SEED);
            let (links, cost) = linking.links(3e-4, &Brightness::uniform(&tree));
            (HierarchicalFormFactors::new(Arc::clone(&tree), &links).row_sums().unwrap(), links.len(), cost)
        })
    };
    let one = rows(1);
    assert!(one.1 > 1000, "{} links", one.1);
    assert!(one == rows(2) && one == rows(8));
}

/// A partition across the cube, off every line of the mesh, front and back.
#[test]
fn nothing_passes_a_closed_partition() {
    let at = 0.37;
    let cube = (0..6).map(|k| (inward_face(DVec3::ZERO, DVec3::ONE, k / 2, k % 2 == 1), 0));
    let sheet: Vec<DVec3> =
        [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(y, z)| DVec3::new(at, y, z)).to_vec();
    let mut back = sheet.clone();
    back.reverse();
    let scene = scene_of_loops(&cube.chain([(sheet, 0), (back, 0)]).collect::<Vec<_>>(), vec![grey()]);
    let case = Case::new(&scene, 8);
    let store = case.store(1e-3);
    let left: Vec<bool> = (0..case.elements.len())
        .map(|e| {
            let polygon = &case.elements.polygons(e)[0];
            let x = polygon.centroid().x;
            if (x - at).abs() < 1e-9 { polygon.normal().x < 0.0 } else { x < at }
        })
        .collect();
    let mut buf = RowBuf::default();
    for s in 0..case.elements.len() {
        let mut seen = 0.0;
        store.row(s, 0, &mut buf).unwrap().entries.for_each(|t, value| {
            assert!(left[s] == left[t] || value == 0.0, "{s} and {t} see each other by {value:e}");
            seen += value;
        });
        assert!(seen > 0.5 * case.elements.area(s), "element {s} sees {seen:e}");
    }
}

/// Where light is the same, a fine mesh needs hardly more links than a coarse one: 16 times the elements, at most twice the links; all
/// pairs are 256 times as many.
#[test]
fn links_hardly_grow_with_the_elements() {
    let scene = box_in_cube(0.4, grey(), grey());
    let count = |divisions: u32| Case::new(&scene, divisions).links(3e-3).0.len();
    let (coarse, fine) = (count(16), count(64));
    assert!(fine <= 6 * coarse, "{coarse} links of 3,072 elements, {fine} of 49,152");
}
