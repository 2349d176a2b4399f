//! Extended form factors by mirror images, against rooms that are there where the images are, and against rays.

use glam::DVec3;
use radiosity_core::{FormFactors, RowBuf};
use radiosity_form_factors::analytic::{Analytic, PartialVisibility};
use radiosity_form_factors::extended::{Images, ImagesError, Mirrors, SpecularBounces, SpecularRays};
use radiosity_form_factors::stores::SparseFormFactors;
use radiosity_form_factors::{Pairwise, Receivers, Rows};
use radiosity_gallery::MirrorRoom;
use radiosity_gallery::boxes::{faces, material, scene_of_loops};
use radiosity_gallery::mirror::opened;
use radiosity_geometry::mesh::{Mesh, MeshSettings, Subdivision};
use radiosity_geometry::{Facets, Material, Occluders, Polygon, Scatter, Scene, Specular};

const TOLERANCE: f64 = 1e-10;
const PARTIAL: PartialVisibility = PartialVisibility::Exact { tolerance: 1e-8 };

fn mirror(reflectance: &[f64]) -> Material {
    let specular = Some(Specular::Mirror { reflectance: reflectance.to_vec() });
    let none = vec![0.0; reflectance.len()];
    Material { specular, ..Material::diffuse("mirror", none.clone(), none) }
}

/// Exposed elements of a scene, with the occluders at which rays end.
struct Meshed {
    scene: Scene,
    elements: Facets,
    carriers: Vec<u32>,
}

impl Meshed {
    fn new(scene: Scene, k: u32) -> Self {
        let settings = MeshSettings { elements: Subdivision::Uniform(k), patches: None, contacts: true };
        let mesh = Mesh::new(&scene, &Occluders::of_scene(&scene), &settings).unwrap();
        let exposed: Vec<u32> = (0..).zip(&mesh.elements).filter(|(_, e)| !e.covered).map(|(k, _)| k).collect();
        let faces = mesh.faces();
        let carriers = exposed.iter().map(|&e| faces[e as usize]).collect();
        Self { elements: mesh.element_facets.select(&exposed), carriers, scene }
    }

    /// F′ of every pair in one band, by images.
    fn images(&self, bounces: SpecularBounces, band: usize) -> Vec<f64> {
        let images = Images::new(&self.scene, bounces).unwrap();
        let m = self.elements.len();
        let (mut all, mut row) = (vec![0.0; m * m], vec![0.0; m]);
        for (colour, shares) in images.colours().iter().enumerate() {
            let rows = images.rows((&self.elements, &self.elements), colour, TOLERANCE, PARTIAL, 1);
            for s in 0..m {
                rows.row(s, &mut row).unwrap();
                all[s * m..(s + 1) * m].iter_mut().zip(&row).for_each(|(sum, value)| *sum += shares[band] * value);
            }
        }
        all
    }

    /// The same by rays.
    fn rays(&self, bounces: SpecularBounces, band: usize, rays: u32) -> Vec<f64> {
        let occluders = Occluders::of_parts(&self.scene, &self.elements, &self.carriers);
        let surface_of: Vec<u32> = self.scene.pieces().map(|(s, _)| s as u32).collect();
        let mirrors = Mirrors { occluders: &occluders, surface_of: &surface_of, scatter: &Ideal(&self.scene) };
        let ends = (&self.elements, Receivers::facets(&self.elements));
        let rows = SpecularRays::new(ends, mirrors, bounces, (self.scene.bands(), band), rays, 7);
        let m = self.elements.len();
        let mut all = vec![0.0; m * m];
        for (s, row) in all.chunks_exact_mut(m).enumerate() {
            rows.row(s, row).unwrap();
        }
        all
    }

    /// Exchange areas of every element with every image of an element, mirrored at the planes of axes where `flip` is −1, in `room`, where both are.
    fn seen(&self, room: &Scene, flip: DVec3) -> Vec<f64> {
        let blockers = Occluders::blocking(room);
        let analytic = Analytic::new(Some(&blockers)).partial_visibility(PARTIAL);
        let polygon = |k: usize| &self.elements.polygons(k)[0];
        let images: Vec<Polygon> = (0..self.elements.len())
            .map(|k| {
                let mut vertices: Vec<DVec3> = polygon(k).vertices().iter().map(|v| *v * flip).collect();
                if flip.element_product() < 0.0 {
                    vertices.reverse();
                }
                Polygon::new(&vertices).unwrap()
            })
            .collect();
        let pairs = (0..images.len()).flat_map(|s| images.iter().map(move |t| (s, t)));
        pairs.map(|(s, t)| analytic.exchange(polygon(s), t, TOLERANCE, 1).value).collect()
    }

    /// Largest difference between two tables, as an error of form factors: over the smaller area of the pair.
    fn differ(&self, a: &[f64], b: &[f64]) -> f64 {
        let areas = self.elements.areas();
        let m = areas.len();
        let smaller = |k: usize| areas[k / m].min(areas[k % m]);
        (0..m * m).map(|k| (a[k] - b[k]).abs() / smaller(k)).fold(0.0, f64::max)
    }

    /// Rows of rays agree with rows of images: the sums over rows and the entries within their noise.
    fn agree(&self, images: &[f64], rays: &[f64], count: u32) {
        let (areas, m) = (self.elements.areas(), self.elements.len());
        for (s, area) in areas.iter().enumerate() {
            let range = s * m..(s + 1) * m;
            let [exact, found] = [images, rays].map(|all| all[range.clone()].iter().sum::<f64>() / area);
            // Rays spread evenly: binomial noise is an upper bound.
            let noise = ((exact * (1.0 - exact)).max(0.0) / f64::from(count)).sqrt() + 1.0 / f64::from(count);
            assert!((exact - found).abs() < 4.5 * noise, "row {s}: {exact} by images, {found} by rays");
            for (exact, found) in images[range.clone()].iter().zip(&rays[range]).map(|(a, b)| (a / area, b / area)) {
                let noise = (exact / f64::from(count)).sqrt() + 1.0 / f64::from(count);
                assert!((exact - found).abs() < 6.0 * noise, "row {s}: {exact} by images, {found} by rays");
            }
        }
    }
}

/// Ideal mirrors.
struct Ideal<'a>(&'a Scene);

impl Scatter for Ideal<'_> {
    fn is_specular(&self, surface: usize, front: bool) -> bool {
        front && self.0.materials[self.0.surfaces[surface].material].specular.is_some()
    }

    fn scatter(&self, surface: usize, normal: DVec3, d: DVec3, _: [f64; 3], weight: &mut [f64]) -> Option<DVec3> {
        let material = &self.0.materials[self.0.surfaces[surface].material];
        let Some(Specular::Mirror { reflectance }) = &material.specular else { return None };
        weight.iter_mut().zip(reflectance).for_each(|(w, r)| *w *= r);
        Some(d - normal * (2.0 * d.dot(normal)))
    }
}

const ONCE: SpecularBounces = SpecularBounces::AtMost(1);

/// A block before the mirror hides parts of itself and of others, with a mirror as large as the wall and one that is a part of it.
#[test]
fn an_image_is_seen_as_through_a_hole_into_the_mirrored_room() {
    let part = MirrorRoom { opening: [[0.3, 1.6], [0.5, 2.0]], ..MirrorRoom::default() };
    for room in [MirrorRoom::default(), MirrorRoom { mirror: 0.7, ..part }] {
        let meshed = Meshed::new(room.scene(), 3);
        let hole = opened(&meshed.scene, MirrorRoom::MIRROR);
        let expected = meshed.seen(&hole, DVec3::new(-1.0, 1.0, 1.0));
        let expected: Vec<f64> = expected.iter().map(|value| room.mirror * value).collect();
        for bounces in [ONCE, SpecularBounces::Any] {
            let found = meshed.images(bounces, 0);
            let differ = meshed.differ(&found, &expected);
            assert!(differ < 4e-8, "{:?}: {differ}", room.opening);
        }
    }
}

/// Mirrors on the walls x = 0 and y = 0: rooms in three quadrants, the one across seen by way of one mirror and then the other, in either order.
#[test]
fn two_mirrors_at_a_right_angle_show_three_rooms() {
    let mut scene = MirrorRoom::default().scene();
    scene.surfaces[3].material = 2;
    let mut beside = opened(&scene, MirrorRoom::MIRROR);
    // The other mirror is surface 2 now; its image lies in the same plane, and is open as well.
    let count = beside.surfaces.len() / 2;
    beside.surfaces.remove(2 + count);
    let four = opened(&beside, 2);
    let meshed = Meshed::new(scene, 2);
    let flips = [DVec3::new(-1.0, 1.0, 1.0), DVec3::new(1.0, -1.0, 1.0), DVec3::new(-1.0, -1.0, 1.0)];
    let mut expected = vec![0.0; meshed.elements.len().pow(2)];
    for flip in flips {
        expected.iter_mut().zip(meshed.seen(&four, flip)).for_each(|(sum, value)| *sum += value);
    }
    let images = Images::new(&meshed.scene, SpecularBounces::Any).unwrap();
    assert_eq!((images.chains(), images.colours()), (4, &[vec![1.0]][..]));
    let found = meshed.images(SpecularBounces::Any, 0);
    let differ = meshed.differ(&found, &expected);
    assert!(differ < 1e-7, "{differ}");
}

/// Mirrors that face each other, of two colours; a pane in the room that is a mirror on one side and cuts elements of the walls by its plane.
#[test]
fn rays_agree() {
    let room = |more: &[(Vec<DVec3>, usize)], of_wall: [usize; 6]| {
        let walls = faces(DVec3::ZERO, DVec3::new(2.0, 1.5, 1.0), true).into_iter().zip(of_wall);
        let loops: Vec<_> = walls.chain(more.iter().cloned()).collect();
        let grey = Material::diffuse("grey", vec![0.5; 2], vec![1.0; 2]);
        scene_of_loops(&loops, vec![grey, mirror(&[0.8, 0.4]), mirror(&[0.5, 0.5])])
    };
    let pane = [(0.7, 0.2, 0.1), (1.3, 0.4, 0.1), (1.3, 0.4, 0.8), (0.7, 0.2, 0.8)].map(DVec3::from).to_vec();
    let back = pane.iter().rev().copied().collect();
    let facing = Meshed::new(room(&[], [1, 2, 0, 0, 0, 0]), 2);
    let standing = Meshed::new(room(&[(pane, 1), (back, 0)], [0, 0, 2, 0, 0, 0]), 2);
    const RAYS: u32 = 1 << 14;
    for (meshed, bounces) in [(facing, SpecularBounces::AtMost(3)), (standing, SpecularBounces::AtMost(2))] {
        for band in 0..2 {
            let images = meshed.images(bounces, band);
            meshed.agree(&images, &meshed.rays(bounces, band, RAYS), RAYS);
        }
    }
}

/// Rows from the diagonal on are parts of whole rows, and a store of them is symmetric to the last bit, in one thread as in more.
#[test]
fn rows_are_symmetric_to_the_last_bit_in_any_number_of_threads() {
    let mut scene = MirrorRoom { mirror: 0.9, ..MirrorRoom::default() }.scene();
    scene.surfaces[3].material = 2;
    let meshed = Meshed::new(scene, 2);
    let m = meshed.elements.len();
    let images = Images::new(&meshed.scene, SpecularBounces::Any).unwrap();
    let table = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let rows = images.rows((&meshed.elements, &meshed.elements), 0, TOLERANCE, PARTIAL, 1);
            SparseFormFactors::assemble(&rows).unwrap().0
        })
    };
    let whole = meshed.images(SpecularBounces::Any, 0);
    for s in 0..m {
        assert!((0..s).all(|t| whole[s * m + t] == whole[t * m + s]), "row {s}");
    }
    for threads in [1, 2, 8] {
        let (store, mut buf) = (table(threads), RowBuf::default());
        assert!(store.properties().symmetric);
        for s in 0..m {
            let mut row = vec![0.0; m];
            store.row(s, 0, &mut buf).unwrap().entries.for_each(|t, value| row[t] = value);
            assert_eq!(row, whole[s * m..(s + 1) * m], "row {s} in {threads} threads");
        }
    }
}

/// A corner of three mirrors ends after three; two that face each other do not.
#[test]
fn chains_end_by_geometry_or_are_refused() {
    let cube = |mirrors: &[usize]| {
        let mut loops: Vec<_> = faces(DVec3::ZERO, DVec3::ONE, true).into_iter().map(|face| (face, 0)).collect();
        mirrors.iter().for_each(|&k| loops[k].1 = 1);
        scene_of_loops(&loops, vec![material("grey", 0.5, 1.0), mirror(&[1.0])])
    };
    let chains = |mirrors: &[usize], bounces| Images::new(&cube(mirrors), bounces).map(|images| images.chains());
    use SpecularBounces::{Any, AtMost, None};
    assert_eq!(chains(&[0, 2, 4], Any), Ok(15));
    assert_eq!(chains(&[0, 1], AtMost(5)), Ok(10));
    assert_eq!(chains(&[0, 1], None), Ok(0));
    assert_eq!(chains(&[], Any), Ok(0));
    assert_eq!(chains(&[0, 1], Any), Err(ImagesError::Chains { most: 1024 }));
    assert!(chains(&[0, 1], Any).unwrap_err().to_string().contains("fewer specular bounces"));
    // Of mirrors that reflect nothing there is nothing to see.
    let mut black = cube(&[0, 1]);
    black.materials[1] = mirror(&[0.0]);
    assert_eq!(Images::new(&black, Any).map(|images| images.chains()), Ok(0));
    let mut glossy = cube(&[3]);
    glossy.materials[1].specular = Some(Specular::Phong { reflectance: vec![0.5], exponent: 5.0 });
    let refused = Images::new(&glossy, Any).map(|images| images.chains()).unwrap_err().to_string();
    assert!(refused.contains("'surface 3' is glossy") && refused.contains("rays"), "{refused}");
}
