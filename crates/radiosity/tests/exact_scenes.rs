//! Scenes whose irradiance is known at every point, through the facade.

use radiosity::{Geometry, GridValues, Method, Store, Strategy, assemble, run};
use radiosity_core::{BandValues, Form, Solution, StopRule, System, solve};
use radiosity_gallery::{FloorUnderLight, ManufacturedRoom};
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::{MeshSettings, Subdivision};

/// The ranges of u and v of element (i, j) of K × K.
fn cell(i: u32, j: u32, k: u32) -> ([f64; 2], [f64; 2]) {
    let range = |i: u32| [f64::from(i) / f64::from(k), f64::from(i + 1) / f64::from(k)];
    (range(i), range(j))
}

/// A manufactured room of 4 × 4 elements and 2 × 2 patches a face, with the exact means of its elements.
struct Room<'a> {
    geometry: Geometry<'a>,
    emission: BandValues,
    irradiance: Vec<f64>,
    radiosity: Vec<f64>,
}

impl<'a> Room<'a> {
    fn new(room: &ManufacturedRoom, scene: &'a Scene) -> Self {
        let (elements, patches) = (Subdivision::Uniform(4), Some(Subdivision::Uniform(2)));
        let geometry = Geometry::new(scene, &MeshSettings { elements, patches, contacts: true }).unwrap();
        let of_elements = |value: &dyn Fn(usize, [f64; 2], [f64; 2]) -> f64| -> Vec<f64> {
            let ranges = geometry.mesh().elements.iter().map(|e| (e.surface as usize, cell(e.i, e.j, 4)));
            ranges.map(|(face, (u, v))| value(face, u, v)).collect()
        };
        Self {
            emission: BandValues::single(of_elements(&|face, u, v| room.mean_emission(face, u, v))),
            irradiance: of_elements(&|face, u, v| room.mean_irradiance(face, u, v)),
            radiosity: of_elements(&|face, _, _| room.radiosity(face)),
            geometry,
        }
    }

    /// Solved by Jacobi's method to η = 1e-13.
    fn solved(&self, method: Method, form: Form) -> Solution {
        let (store, _) = assemble(&self.geometry, method, form, Store::Dense, 1).unwrap();
        let (areas, rho) = (self.geometry.elements().areas(), self.geometry.reflectance());
        let (parent, e) = (self.geometry.parent(), self.emission.view());
        let system = System::substructured(&*store, form, &areas, parent, e, rho.view()).unwrap();
        let mut solver = radiosity_solvers::by_name("jacobi").unwrap();
        solve(&system, &mut *solver, &StopRule::unshot(1e-13), &mut ()).unwrap()
    }

    /// Mean of H, the level that errors refer to.
    fn level(&self) -> f64 {
        self.irradiance.iter().sum::<f64>() / self.irradiance.len() as f64
    }
}

fn worst(found: &BandValues, truth: &[f64]) -> f64 {
    found.values().iter().zip(truth).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
}

/// B is constant on every face, so elements and patches lose nothing: with the mean of E over each element its mean of
/// H is exact but for form factors (1e-10 each), the solver (1e-13 times 1/(1 − ρ)) and the mean of E itself (1e-9
/// relative where three faces meet, 1e-13 elsewhere).
#[test]
fn a_manufactured_room_of_4_by_4_elements_is_right_to_1e_8() {
    let manufactured = ManufacturedRoom::default();
    let scene = manufactured.scene();
    let room = Room::new(&manufactured, &scene);
    for form in [Form::Full, Form::ElementsToPatches, Form::PatchesToElements] {
        let solution = room.solved(Method::ANALYTIC, form);
        let of_h = worst(&solution.irradiance, &room.irradiance) / room.level();
        let of_b = worst(&solution.radiosity, &room.radiosity) / room.level();
        assert!(of_h < 1e-8 && of_b < 1e-8, "{form:?}: H {of_h:e}, B {of_b:e}");
    }
}

/// By their own errors, rms of H over the elements: 4096 rays of a scrambled net leave 1e-3, and a hemicube's single
/// centre on elements that meet at edges 1e-2.
#[test]
fn row_wise_estimators_solve_the_manufactured_room_to_a_few_per_mille() {
    let manufactured = ManufacturedRoom::default();
    let scene = manufactured.scene();
    let room = Room::new(&manufactured, &scene);
    for (method, allowed) in [(Method::rays(4096), 0.002), (Method::HEMICUBE, 0.012)] {
        let h = room.solved(method, Form::Full).irradiance;
        let squares: f64 = h.values().iter().zip(&room.irradiance).map(|(x, y)| (x - y).powi(2)).sum();
        let rms = (squares / h.len() as f64).sqrt() / room.level();
        assert!(rms < allowed, "{}: {rms:e}", method.name());
    }
}

/// Direct light alone: H of an element is E_light F_element→light, the mean of the point values. 8 × 8 elements of the
/// floor are 0.5 × 0.375 wide, where the rule for means is right to rounding.
#[test]
fn the_floor_under_a_light_has_the_mean_of_its_point_values() {
    let case = FloorUnderLight::default();
    let scene = case.scene();
    let strategy = Strategy { unshot: 1e-13, ..Strategy::new(Subdivision::Uniform(8), Method::ANALYTIC) };
    let run = run(&scene, &strategy, &mut ()).unwrap();
    let mesh = run.geometry.mesh();
    let grid = GridValues::means(&run.geometry, &run.solution.irradiance, 4).unwrap();
    let mut floor = 0;
    for (e, element) in mesh.elements.iter().enumerate().filter(|(_, e)| e.surface == 0) {
        let (u, v) = cell(element.i, element.j, 8);
        let truth = case.mean_irradiance(u, v);
        let found = run.solution.irradiance.band(0)[e];
        // F within 1e-10, E = 10; the smallest H is 3e-2.
        assert!((found - truth).abs() < 1e-9, "element {e}: {found}, {truth}");
        floor += 1;
    }
    assert_eq!(floor, 64);
    // And on a report grid of another fineness.
    let mut worst = 0.0_f64;
    for c in (0..grid.areas.len()).filter(|&c| grid.surfaces[c] == 0) {
        let (i, j) = grid.indices[c];
        let (u, v) = cell(i, j, 4);
        worst = worst.max((grid.values.band(0)[c] / case.mean_irradiance(u, v) - 1.0).abs());
    }
    assert!(worst < 1e-8, "{worst:e}");
}
