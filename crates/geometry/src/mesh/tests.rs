use super::*;
use crate::testing::{Random, cornell_box, cube, quad, scene_of};

fn settings(k: u32, patches: Option<u32>) -> MeshSettings {
    MeshSettings { elements: Subdivision::Uniform(k), patches: patches.map(Subdivision::Uniform), contacts: true }
}

fn mesh(scene: &Scene, settings: &MeshSettings) -> Mesh {
    Mesh::new(scene, &Occluders::of_scene(scene), settings).unwrap()
}

/// Area of the elements of a surface that see something.
fn exposed(mesh: &Mesh, surface: u32) -> f64 {
    let open = |e: &usize| mesh.elements[*e].surface == surface && !mesh.elements[*e].covered;
    (0..mesh.elements.len()).filter(open).map(|e| mesh.element_facets.area(e)).sum()
}

/// The footprints are the shoelace areas of the blocks' tops, which are their bottoms moved up.
#[test]
fn the_floor_under_the_blocks_is_covered() {
    let faces = cornell_box();
    let scene = scene_of(&faces);
    let free = scene.surfaces[0].area() - scene.surfaces[9].area() - scene.surfaces[14].area();
    for k in [1, 3, 8, 17] {
        let mesh = mesh(&scene, &settings(k, None));
        assert!((exposed(&mesh, 0) / free - 1.0).abs() < 1e-9, "{k}: {} of {free}", exposed(&mesh, 0));
        for s in 1..19 {
            assert!((exposed(&mesh, s) / scene.surfaces[s as usize].area() - 1.0).abs() < 1e-12, "{k}: surface {s}");
        }
        // A cell's parts fill it.
        let total: f64 = mesh.areas().iter().sum();
        assert!((total / scene.area() - 1.0).abs() < 1e-12);
    }
}

#[test]
fn the_floor_is_covered_wherever_the_box_stands_and_however_large_it_is() {
    let turn = glam::DMat3::from_axis_angle(DVec3::new(2.0, -1.0, 0.5).normalize(), 1.1);
    for (scale, shift) in [(1e-3, 0.0), (1e3, 0.0), (1.0, 1e5)] {
        let mut faces = cornell_box();
        faces.iter_mut().flatten().for_each(|v| *v = turn * *v * scale + DVec3::splat(shift));
        let scene = scene_of(&faces);
        let free = scene.surfaces[0].area() - scene.surfaces[9].area() - scene.surfaces[14].area();
        let mesh = mesh(&scene, &settings(6, None));
        // 1e5 away coordinates are rounded by 1.5e-11 of 556: areas by 1e-13 or so, cuts by more where they are oblique.
        assert!((exposed(&mesh, 0) / free - 1.0).abs() < 1e-9);
    }
}

/// A box with a bottom, as most files have: what stands on the floor is the same.
#[test]
fn a_block_with_a_bottom_covers_the_floor_as_well() {
    let mut faces = cube(4.0);
    for mut face in cube(1.0) {
        face.reverse(); // fronts outward
        face.iter_mut().for_each(|v| *v += DVec3::new(0.3, -0.2, -1.5));
        faces.push(face);
    }
    let scene = scene_of(&faces);
    let mesh = mesh(&scene, &settings(5, None));
    let floor = (0..6).find(|&s| scene.surfaces[s].pieces[0].centroid().z == -2.0).unwrap();
    assert!((exposed(&mesh, floor as u32) - 15.0).abs() < 1e-12);
}

/// A block of side 1 sunk half into a wall: the half outside is seen, 0.5 of each side, and the wall lacks 1.
#[test]
fn what_crosses_is_cut_at_the_crossing() {
    let mut faces = cube(4.0);
    // The room's own wall is open behind, so a second shell makes it a solid that can hide something.
    let shell: Vec<Vec<DVec3>> = cube(6.0).into_iter().map(|f| f.into_iter().rev().collect()).collect();
    faces.extend(shell);
    for mut face in cube(1.0) {
        face.reverse();
        face.iter_mut().for_each(|v| *v += DVec3::new(2.0, 0.3, 0.1));
        faces.push(face);
    }
    let scene = scene_of(&faces);
    let mesh = mesh(&scene, &settings(3, None));
    let wall = (0..6).find(|&s| scene.surfaces[s].pieces[0].centroid().x == 2.0).unwrap();
    assert!((exposed(&mesh, wall as u32) - 15.0).abs() < 1e-12);
    let block: f64 = (12..18).map(|s| exposed(&mesh, s)).sum();
    assert!((block - (1.0 + 4.0 * 0.5)).abs() < 1e-12);
}

#[test]
fn twin_sheets_and_touching_rooms_are_not_covered() {
    let mut faces = cube(2.0);
    let sheet = quad(
        DVec3::new(-0.5, -0.5, 0.1),
        DVec3::new(0.5, -0.5, 0.1),
        DVec3::new(0.5, 0.5, 0.1),
        DVec3::new(-0.5, 0.5, 0.1),
    );
    faces.extend([sheet.iter().rev().copied().collect(), sheet]);
    let mesh = mesh(&scene_of(&faces), &settings(3, None));
    assert_eq!(mesh.elements.iter().filter(|e| e.covered).count(), 0);
    // Nothing is cut: the sheets coincide, edge upon edge.
    assert_eq!(mesh.elements.len(), 8 * 9);
}

#[test]
fn patches_end_at_contacts_and_have_the_areas_of_their_elements() {
    let scene = scene_of(&cornell_box());
    let of_floor = |mesh: &Mesh, p: usize| mesh.elements.iter().any(|e| e.parent as usize == p && e.surface == 0);
    for (k, p) in [(8, 2), (6, 3), (4, 4), (5, 1)] {
        let mesh = mesh(&scene, &settings(k, Some(p)));
        let mut areas = vec![0.0; mesh.patch_facets.len()];
        for ((e, element), area) in mesh.elements.iter().enumerate().zip(mesh.areas()) {
            let (patch, polygon) = (element.parent as usize, &mesh.element_facets.polygons(e)[0]);
            areas[patch] += area;
            assert_eq!(element.covered, mesh.patch_facets.covered(patch));
            assert!(depth(&mesh.patch_facets.polygons(patch)[0], polygon.centroid()) > 0.0, "{k}/{p}: element {e}");
        }
        for (n, area) in areas.iter().enumerate() {
            assert_eq!(mesh.patch_facets.polygons(n).len(), 1);
            assert!((area / mesh.patch_facets.area(n) - 1.0).abs() < 1e-9, "{k}/{p}: patch {n}");
        }
        // All but the floor is free of contacts.
        let floor = (0..areas.len()).filter(|&n| of_floor(&mesh, n)).count();
        assert_eq!(areas.len() - floor, 18 * (p * p) as usize);
        // Under the blocks, and around each at least four.
        assert!(floor >= 10, "{k}/{p}: {floor}");
    }
}

#[test]
fn without_patches_every_element_is_its_own() {
    let mesh = mesh(&scene_of(&cornell_box()), &settings(4, None));
    assert_eq!(mesh.parents(), (0..mesh.elements.len() as u32).collect::<Vec<_>>());
    assert_eq!(mesh.patch_facets, mesh.element_facets);
}

#[test]
fn patches_must_divide_elements() {
    let scene = scene_of(&cornell_box());
    let occluders = Occluders::of_scene(&scene);
    let new = |elements, patches| Mesh::new(&scene, &occluders, &MeshSettings { elements, patches, contacts: false });
    use Subdivision::{EdgeLength, Uniform};
    assert_eq!(new(Uniform(8), Some(Uniform(3))).unwrap_err(), MeshError::Divide { elements: 8, patches: 3 });
    assert_eq!(new(Uniform(0), None).unwrap_err(), MeshError::NoCells);
    assert_eq!(new(EdgeLength(-1.0), None).unwrap_err(), MeshError::EdgeLength { length: -1.0 });
    assert!(matches!(new(Uniform(100_000), None).unwrap_err(), MeshError::TooMany { .. }));
}

#[test]
fn cells_are_numbered_once_and_rows_count_them() {
    // A concave face of four triangles, and a pentagon, whole at K = 1 and in two pieces beyond.
    let l = [(3., 0.), (3., 1.), (1., 1.), (1., 3.), (0., 3.), (0., 0.)].map(|(x, y)| DVec3::new(x, y, 0.0));
    let pentagon = [(3., 0.), (4., 2.), (2., 4.), (0., 2.), (0., 0.)].map(|(x, y)| DVec3::new(x, y, 5.0));
    let scene = scene_of(&[l.to_vec(), pentagon.to_vec()]);
    for (k, cells) in [(1, 4 + 1), (2, 4 * 4 + 4 + 4), (5, 4 * 25 + 25 + 25)] {
        let mesh = mesh(&scene, &settings(k, None));
        let mut keys: Vec<_> = mesh.elements.iter().map(|e| (e.surface, e.i, e.j)).collect();
        keys.sort_unstable();
        keys.dedup();
        assert_eq!((keys.len(), mesh.cells(), mesh.rows().last().map(|r| r + 1)), (cells, cells, Some(cells as u32)));
        assert!((mesh.areas().iter().sum::<f64>() - scene.area()).abs() < 1e-12);
    }
}

#[test]
fn every_element_is_found_at_its_centroid() {
    let scene = scene_of(&cornell_box());
    let mesh = mesh(&scene, &settings(5, None));
    let mut random = Random(7);
    for _ in 0..5000 {
        let (s, u, v) = ((random.unit() * 19.0) as usize, random.unit(), random.unit());
        let e = mesh.locate(s, 0, u, v).unwrap();
        let (element, point) = (mesh.elements[e], mesh.pieces(s)[0].point(u, v));
        assert_eq!(element.surface as usize, s);
        assert!(depth(&mesh.element_facets.polygons(e)[0], point) > -1e-10);
    }
    assert_eq!(mesh.locate(0, 0, 1.5, 0.5), None);
}

#[test]
fn report_cells_sum_to_what_is_not_covered() {
    let mut faces = cornell_box();
    faces.push(
        [(300., 0.), (300., 100.), (100., 100.), (100., 300.), (0., 300.), (0., 0.)]
            .map(|(x, y)| DVec3::new(x, 500.0, y))
            .to_vec(),
    );
    let scene = scene_of(&faces);
    for (k, report) in [(1, 8), (8, 8), (6, 4), (4, 6), (9, 1), (7, 5)] {
        let mesh = mesh(&scene, &settings(k, None));
        let grid = mesh.report_grid(&scene, report).unwrap();
        assert_eq!(grid.cells.len() as u32, (19 + 4) * report * report);
        assert!((grid.areas().iter().sum::<f64>() / scene.area() - 1.0).abs() < 1e-12);
        // From the side of the elements: each open one is shared out fully.
        let mut shared = vec![0.0; mesh.elements.len()];
        grid.cells.iter().flat_map(|c| &c.overlaps).for_each(|&(e, area)| shared[e as usize] += area);
        for (e, shared) in shared.iter().enumerate() {
            let expected = if mesh.elements[e].covered { 0.0 } else { mesh.element_facets.area(e) };
            assert!((shared - expected).abs() <= 1e-10 * mesh.element_facets.area(e), "{k}/{report}: element {e}");
        }
        // The mean of 1 is the share that is not covered: nowhere above 1.
        assert!(grid.means(&vec![1.0; mesh.elements.len()]).iter().all(|m| (0.0..=1.0 + 1e-12).contains(m)));
    }
}

#[test]
fn covered_elements_neither_emit_nor_reflect() {
    let scene = scene_of(&cornell_box());
    let mesh = mesh(&scene, &settings(4, None));
    let reflectance = mesh.reflectance(&scene);
    assert!(mesh.elements.iter().zip(&reflectance).all(|(e, &rho)| rho == if e.covered { 0.0 } else { 0.5 }));
    assert_eq!(mesh.emission(&scene), vec![0.0; mesh.elements.len()]);
}

/// A sliver with an area just above rounding would have cells without one: it stays whole.
#[test]
fn a_face_too_thin_to_cut_stays_whole() {
    let sliver = vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1e-14, 0.0)];
    let mesh = mesh(&scene_of(&[sliver]), &settings(64, Some(2)));
    assert_eq!((mesh.elements.len(), mesh.patch_facets.len()), (1, 1));
}

#[test]
fn one_and_two_threads_give_the_same_mesh() {
    let scene = scene_of(&cornell_box());
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| mesh(&scene, &settings(9, Some(3))))
    };
    assert_eq!(with(1), with(2));
}

/// Across a room of side 4 a sheet at a place that no regular line of the mesh has, and one on a line of elements that is none of patches:
/// no element and no patch lies on both sides.
#[test]
fn a_partition_across_a_room_is_a_line_of_elements_and_patches() {
    for x in [0.37, 0.5] {
        let mut faces = cube(4.0);
        let corner = |y: f64, z: f64| DVec3::new(x, y, z);
        let sheet = quad(corner(-2.0, -2.0), corner(2.0, -2.0), corner(2.0, 2.0), corner(-2.0, 2.0));
        faces.extend([sheet.iter().rev().copied().collect(), sheet]);
        let scene = scene_of(&faces);
        for (k, patches) in [(1, None), (3, None), (8, None), (3, Some(1)), (8, Some(1)), (8, Some(2))] {
            let mesh = mesh(&scene, &settings(k, patches));
            let all = mesh.element_facets.iter_polygons().chain(mesh.patch_facets.iter_polygons());
            for (_, polygon) in all {
                let (lo, hi) = polygon.bounds();
                assert!(hi.x <= x + 1e-12 || lo.x >= x - 1e-12, "{k}/{patches:?}: from {} to {}", lo.x, hi.x);
            }
            for facets in [&mesh.element_facets, &mesh.patch_facets] {
                assert!((facets.areas().iter().sum::<f64>() - scene.area()).abs() < 1e-12);
            }
        }
    }
}

/// A sheet of half the width of a wall ends inside a patch: its line goes on to the patch's edge, for elements as well.
#[test]
fn elements_nest_in_patches_where_a_contact_ends_inside_one() {
    let mut faces = cube(4.0);
    let corner = |y: f64, z: f64| DVec3::new(0.37, y, z);
    let sheet = quad(corner(-2.0, -2.0), corner(0.1, -2.0), corner(0.1, 1.3), corner(-2.0, 1.3));
    faces.extend([sheet.iter().rev().copied().collect(), sheet]);
    let scene = scene_of(&faces);
    let mesh = mesh(&scene, &settings(6, Some(2)));
    // Across floor and wall in y, two patches each of which the sheet passes through or ends in.
    assert_eq!(mesh.patch_facets.len(), 8 * 4 + 2 + 2);
    for (e, element) in mesh.elements.iter().enumerate() {
        let patch = &mesh.patch_facets.polygons(element.parent as usize)[0];
        let inside = |v: &DVec3| depth(patch, *v) > -1e-12;
        assert!(mesh.element_facets.polygons(e)[0].vertices().iter().all(inside), "element {e}");
    }
}

/// With a triangle, a pentagon that is cut into two pieces, and faces of every length.
#[test]
fn cells_are_counted_without_making_them() {
    let mut faces = cornell_box();
    let at = |points: &[(f64, f64)]| points.iter().map(|&(x, y)| DVec3::new(x, y, 10.0)).collect();
    faces.push(at(&[(0., 700.), (400., 700.), (100., 1000.)]));
    faces.push(at(&[(500., 700.), (600., 900.), (400., 1100.), (200., 900.), (250., 700.)]));
    let scene = scene_of(&faces);
    let length = |h: f64| Some(Subdivision::EdgeLength(h));
    for (elements, patches) in [
        (Subdivision::Uniform(1), None),
        (Subdivision::Uniform(6), Some(Subdivision::Uniform(3))),
        (Subdivision::Uniform(6), Some(Subdivision::Uniform(1))),
        (Subdivision::EdgeLength(90.0), None),
        (Subdivision::EdgeLength(40.0), length(130.0)),
    ] {
        let settings = MeshSettings { elements, patches, contacts: false };
        let (size, mesh) = (MeshSize::of(&scene, &settings).unwrap(), mesh(&scene, &settings));
        let counted = (size.cells as usize, size.patches as usize);
        assert_eq!(counted, (mesh.cells(), mesh.patch_facets.len()), "{settings:?}");
    }
}

/// A cube of side 2 on the middle of a floor of 4 × 4 unit cells. Aligned with the grid it cuts none. Turned by half a right angle its foot is
/// |x| + |y| < √2, which cuts the four cells around the middle and two beyond each of them along an axis.
#[test]
fn cells_that_a_contact_cuts_are_told_from_others() {
    let turned = |angle: f64| {
        let mut faces = vec![quad(
            DVec3::new(-2.0, -2.0, 0.0),
            DVec3::new(2.0, -2.0, 0.0),
            DVec3::new(2.0, 2.0, 0.0),
            DVec3::new(-2.0, 2.0, 0.0),
        )];
        let turn = glam::DMat3::from_rotation_z(angle);
        for mut face in cube(2.0) {
            face.reverse(); // fronts outward
            face.iter_mut().for_each(|v| *v = turn * (*v + DVec3::Z));
            faces.push(face);
        }
        let mesh = mesh(&scene_of(&faces), &settings(4, None));
        let cut = mesh.cut_by_contacts();
        let on_floor = (0..cut.len()).filter(|&e| mesh.elements[e].surface == 0);
        on_floor.filter(|&e| cut[e]).map(|e| mesh.element_facets.area(e)).sum::<f64>()
    };
    assert_eq!(turned(0.0), 0.0);
    let area = turned(std::f64::consts::FRAC_PI_4);
    assert!((area - 12.0).abs() < 1e-9, "{area}");
}
