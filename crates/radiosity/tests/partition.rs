//! What a closed partition parts stays dark, wherever the partition stands and whichever way light is computed.

use glam::DVec3;
use radiosity::{Adaptive, DirectLight, Goal, Method, Run, Shape, Store, Strategy, run, run_adaptive};
use radiosity_gallery::boxes::{faces, material, scene_of_loops};
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::Subdivision;

/// Places of the partition in a room of side 4: on no line of six elements or two patches along an edge, and on one of elements that is none of
/// patches.
const PLACES: [f64; 2] = [0.37 * 4.0, 4.0 / 3.0];

/// Every estimator, with little effort: what a partition hides is hidden however few rays or pixels there are.
const METHODS: [Method; 5] = [
    Method::ANALYTIC,
    Method::sampled(1e-6, 16),
    Method::rays(256),
    Method::RaysAndEmitters { rays: 256 },
    Method::Hemicube { resolution: 32 },
];

/// A room parted at x by a sheet that has two sides; the wall at x = 0 is a light.
fn parted(x: f64) -> Scene {
    let mut loops: Vec<(Vec<DVec3>, usize)> = faces(DVec3::ZERO, DVec3::splat(4.0), true)
        .into_iter()
        .map(|f| (f.clone(), usize::from(f.iter().all(|v| v.x == 0.0))))
        .collect();
    let corners = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)].map(|(y, z)| DVec3::new(x, y, z));
    loops.push((corners.to_vec(), 0));
    loops.push((corners.into_iter().rev().collect(), 0));
    scene_of_loops(&loops, vec![material("room", 0.7, 0.0), material("light", 0.2, 5.0)])
}

/// Exactly nothing arrives behind the partition, and something everywhere before it.
fn assert_parted(run: &Run<'_>, x: f64, name: &str) {
    let (mut dark, mut lit) = (0, 0);
    for (e, h) in run.solution.irradiance.band(0).iter().enumerate() {
        let polygon = &run.geometry.elements().polygons(e)[0];
        let (lo, hi) = polygon.bounds();
        let behind = lo.x > x - 1e-9 && (hi.x > x + 1e-9 || polygon.normal().x > 0.5);
        if behind {
            assert_eq!(*h, 0.0, "{name} at {}", polygon.centroid());
            dark += 1;
        } else {
            assert!(*h > 0.0, "{name} at {}", polygon.centroid());
            lit += 1;
        }
    }
    assert!(dark > 50 && lit > 50, "{name}: {dark} and {lit}");
}

#[test]
fn pairs_and_rays_leave_it_dark_in_every_form() {
    let forms = [
        (Shape::Full, "gauss-seidel"),
        (Shape::ElementsToPatches, "gauss-seidel"),
        (Shape::PatchesToElements, "shooting"),
        (Shape::TwoLevel, "direct"),
    ];
    for x in PLACES {
        let scene = parted(x);
        for (method, (shape, solver)) in METHODS.into_iter().flat_map(|method| forms.map(|form| (method, form))) {
            let mut strategy =
                Strategy { shape, solver: solver.to_owned(), ..Strategy::new(Subdivision::Uniform(6), method) };
            strategy.mesh.patches = (shape != Shape::Full).then_some(Subdivision::Uniform(2));
            let run = run(&scene, &strategy, &mut ()).unwrap();
            assert_parted(&run, x, &format!("{} {} at {x}", method.name(), shape.name()));
        }
    }
}

#[test]
fn links_leave_it_dark() {
    for (x, direct) in PLACES.into_iter().flat_map(|x| [(x, DirectLight::Exact), (x, DirectLight::ByLinks)]) {
        let scene = parted(x);
        let plain = Strategy::new(Subdivision::Uniform(6), Method::OF_LINKS);
        let strategy =
            Strategy { store: Store::Hierarchical { error: 0.05, direct }, solver: "cg".to_owned(), ..plain };
        assert_parted(&run(&scene, &strategy, &mut ()).unwrap(), x, &format!("{direct:?} at {x}"));
    }
}

#[test]
fn adaptive_runs_leave_it_dark() {
    for (x, method) in
        PLACES.into_iter().flat_map(|x| [(x, Method::ANALYTIC), (x, Method::RaysAndEmitters { rays: 256 })])
    {
        let scene = parted(x);
        let strategy = Strategy { solver: "gauss-seidel".to_owned(), ..Strategy::new(Subdivision::Uniform(1), method) };
        let settings = Adaptive { most_elements: 2000, ..Adaptive::new(Goal::Points, 0.05) };
        let adaptive = run_adaptive(&scene, &strategy, &settings).unwrap();
        assert_parted(&adaptive.run, x, &format!("{} at {x}", method.name()));
    }
}
