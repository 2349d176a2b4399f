//! Every store conforms on rows of every estimator in every form, on a mesh where much is hidden.

use radiosity_core::{Form, FormFactors};
use radiosity_form_factors::analytic::Analytic;
use radiosity_form_factors::hemicube::Hemicube;
use radiosity_form_factors::ray_cast::RayCast;
use radiosity_form_factors::stores::{
    DenseFormFactors, ExtendedFormFactors, Keep, OnDemand, PackedFormFactors, SparseFormFactors,
};
use radiosity_form_factors::{PairwiseRows, Receivers, Rows};
use radiosity_gallery::boxes::{box_in_cube, material};
use radiosity_gallery::{RandomEnclosure, conformance};
use radiosity_geometry::mesh::{Mesh, MeshSettings, Subdivision};
use radiosity_geometry::{Occluders, Scene};

const SEED: u64 = 5;

/// A box of side 0.4 in the unit cube: 12 faces of 2 × 2 elements, a patch each.
struct Case {
    mesh: Mesh,
    parents: Vec<u32>,
    blockers: Occluders,
    elements: Occluders,
}

impl Case {
    fn new() -> Self {
        let grey = || material("grey", 0.5, 1.0);
        let scene: Scene = box_in_cube(0.4, grey(), grey());
        let (elements, patches) = (Subdivision::Uniform(2), Some(Subdivision::Uniform(1)));
        let settings = MeshSettings { elements, patches, contacts: true };
        let mesh = Mesh::new(&scene, &Occluders::of_scene(&scene), &settings).unwrap();
        let (parents, elements) = (mesh.parents(), Occluders::of_facets(&mesh.element_facets));
        Self { parents, blockers: Occluders::blocking(&scene), elements, mesh }
    }

    fn rows(&self, estimator: &str, form: Form) -> Box<dyn Rows + '_> {
        let (elements, patches) = (&self.mesh.element_facets, &self.mesh.patch_facets);
        let (sources, targets, receivers) = match form {
            Form::Full => (elements, elements, Receivers::facets(elements)),
            Form::ElementsToPatches => (elements, patches, Receivers::grouped(elements, &self.parents, patches.len())),
            Form::PatchesToElements => (patches, elements, Receivers::facets(elements)),
        };
        match estimator {
            // Few segments, rays and pixels: the stores are tested here, not the numbers.
            "analytic" => {
                let pairwise = Analytic::new(Some(&self.blockers)).samples(16);
                Box::new(PairwiseRows::new(pairwise, sources, targets, 1e-6, SEED))
            }
            "ray-cast" => Box::new(RayCast::new(sources, receivers, &self.elements, 256, SEED)),
            _ => Box::new(Hemicube::new(sources, receivers, 32, SEED).unwrap()),
        }
    }

    fn conforms(&self, estimator: &str) {
        for form in [Form::Full, Form::ElementsToPatches, Form::PatchesToElements] {
            let rows = self.rows(estimator, form);
            assert_eq!(rows.symmetric(), estimator == "analytic" && form == Form::Full);
            let mut stores: Vec<Box<dyn FormFactors + '_>> = vec![
                Box::new(DenseFormFactors::assemble(&*rows).unwrap().0),
                Box::new(SparseFormFactors::assemble(&*rows).unwrap().0),
                Box::new(OnDemand::new(self.rows(estimator, form), Keep::All)),
                Box::new(OnDemand::new(self.rows(estimator, form), Keep::None)),
            ];
            if rows.symmetric() {
                stores.push(Box::new(PackedFormFactors::<f64>::assemble(&*rows).unwrap().0));
                stores.push(Box::new(PackedFormFactors::<f32>::assemble(&*rows).unwrap().0));
            }
            for store in stores {
                conformance(&*store);
            }
        }
    }
}

#[test]
fn stores_of_analytic_rows_conform_in_every_form() {
    Case::new().conforms("analytic");
}

#[test]
fn stores_of_ray_cast_rows_conform_in_every_form() {
    Case::new().conforms("ray-cast");
}

#[test]
fn stores_of_hemicube_rows_conform_in_every_form() {
    Case::new().conforms("hemicube");
}

/// F in any store and F′ in one table for all bands, in two for three bands, or in two of which both count in all.
#[test]
fn sums_of_straight_and_extended_form_factors_conform_in_every_form() {
    let case = Case::new();
    for form in [Form::Full, Form::ElementsToPatches, Form::PatchesToElements] {
        let table = |estimator: &str| SparseFormFactors::assemble(&*case.rows(estimator, form)).unwrap().0;
        let straight = DenseFormFactors::assemble(&*case.rows("ray-cast", form)).unwrap().0;
        conformance(&ExtendedFormFactors::new(&straight, vec![(table("hemicube"), vec![1.0; 3])]));
        for weights in [[vec![1.0, 0.0, 1.0], vec![0.0, 1.0, 0.0]], [vec![0.5, 0.25, 1.0], vec![1.0, 0.75, 0.0]]] {
            let [first, second] = weights;
            let tables = vec![(table("hemicube"), first), (table("analytic"), second)];
            conformance(&ExtendedFormFactors::new(&straight, tables));
        }
        // Symmetric in every band, where both are.
        let straight = DenseFormFactors::assemble(&*case.rows("analytic", form)).unwrap().0;
        let coloured = ExtendedFormFactors::new(&straight, vec![(table("analytic"), vec![0.5, 0.25, 1.0])]);
        assert_eq!(coloured.properties().symmetric, form == Form::Full);
        conformance(&coloured);
    }
}

/// Larger than a tile, and no multiple of anything.
#[test]
fn packed_stores_of_several_tiles_conform() {
    let enclosure = RandomEnclosure::new(523, SEED);
    conformance(&PackedFormFactors::<f64>::assemble(&enclosure).unwrap().0);
    conformance(&PackedFormFactors::<f32>::assemble(&enclosure).unwrap().0);
}

/// What makes the mesh a case: the sparse store has something to leave out, and row sums are known.
#[test]
fn more_than_a_third_of_the_entries_are_zero_and_rows_still_sum_to_their_areas() {
    let case = Case::new();
    let rows = case.rows("ray-cast", Form::Full);
    let store = SparseFormFactors::assemble(&*rows).unwrap().0;
    let zeros = 1.0 - store.matrix().nnz() as f64 / (48.0 * 48.0);
    assert!(zeros > 1.0 / 3.0, "{zeros}");
    // Every ray of a closed scene hits a front; 256 shares of A/256 add up exactly but for the rounding of A.
    let sums = radiosity_form_factors::checks::row_sums(&store).unwrap();
    let areas = case.mesh.areas();
    assert!(sums.iter().zip(&areas).all(|(sum, area)| (sum / area - 1.0).abs() < 1e-14));
}
