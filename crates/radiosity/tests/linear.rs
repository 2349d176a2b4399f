//! Linear reconstruction of solutions with a known answer at points, against constants.

use radiosity::{Geometry, GridValues, LinearRadiosity};
use radiosity_core::BandValues;
use radiosity_gallery::{BlockedLight, FloorUnderLight, Hinge};
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::{Element, MeshSettings, Subdivision};

const POINTS: u32 = 128;

/// rms over the mean of H and the largest difference, of points of surface 0: of constants, and of the reconstruction; elements limited and cuts.
fn errors(
    scene: &Scene,
    k: u32,
    mean: impl Fn([f64; 2], [f64; 2]) -> f64,
    point: impl Fn(f64, f64) -> f64,
) -> ([f64; 2], [f64; 2], usize, usize) {
    let settings = MeshSettings { elements: Subdivision::Uniform(k), patches: None, contacts: true };
    let geometry = Geometry::new(scene, &settings).unwrap();
    let range = |i: u32| [f64::from(i) / f64::from(k), f64::from(i + 1) / f64::from(k)];
    let of = |e: &Element| if e.surface == 0 { mean(range(e.i), range(e.j)) } else { 0.0 };
    let irradiance = BandValues::single(geometry.mesh().elements.iter().map(of).collect());
    let linear = LinearRadiosity::new(&geometry, &irradiance);
    let constant = GridValues::points(&geometry, &irradiance, POINTS).on(&[0]);
    let found = GridValues::linear_points(&geometry, linear.irradiance(), POINTS).on(&[0]);
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(POINTS);
    let truth: Vec<f64> = constant.indices.iter().map(|&(i, j)| point(at(i), at(j))).collect();
    let truth = GridValues { values: BandValues::single(truth), ..constant.clone() };
    let (a, b) = (constant.error(&truth), found.error(&truth));
    ([a.rms, a.worst], [b.rms, b.worst], linear.irradiance().limited().count(), linear.irradiance().cuts())
}

#[test]
fn report() {
    for k in [4, 8, 16, 32] {
        let floor = FloorUnderLight::default();
        println!("floor {k} {:?}", errors(&floor.scene(), k, |u, v| floor.mean_irradiance(u, v), |u, v| floor.irradiance(u, v)));
    }
    for degrees in [30.0_f64, 90.0, 150.0] {
        for k in [4, 8, 16, 32] {
            let hinge = Hinge { angle: degrees.to_radians(), emission: 2.0, reflectance: 0.5 };
            println!("hinge {degrees} {k} {:?}", errors(&hinge.scene(), k, |u, v| hinge.mean_irradiance(u, v), |u, v| hinge.irradiance(u, v)));
        }
    }
    for height in [0.02, 0.1, 0.5, 0.9] {
        for k in [8, 16, 32, 64] {
            let case = BlockedLight::at(height);
            println!("blocked {height} {k} {:?}", errors(&case.scene(), k, |u, v| case.mean_irradiance(u, v, 64), |u, v| case.irradiance(u, v)));
        }
    }
}
