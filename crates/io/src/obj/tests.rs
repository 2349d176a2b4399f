//! Whole files, small and messy.

use std::f64::consts::PI;
use std::path::PathBuf;

use glam::DVec3;

use super::*;
use crate::atomic::tests::Folder;

/// A box of 3 × 5 × 4, faces turned inwards, the first face cut short so that each test adds its own `usemtl`.
const BOX: &str = "v 0 0 0\nv 3 0 0\nv 3 5 0\nv 0 5 0\nv 0 0 4\nv 3 0 4\nv 3 5 4\nv 0 5 4\n";
const FACES: &str = "f 1 2 3 4\nf 5 8 7 6\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n";
const WOOD: &str = "newmtl wood\nKd 0.5 0.25 0.125\nKe 0 1 2\n";

/// Writes `a.obj` and `a.mtl` into a folder of the test's own and reads them.
fn read(test: &str, obj: &str, mtl: &str, options: ReadOptions) -> Result<Imported, ReadError> {
    let folder = Folder::new(test);
    folder.file("a.mtl", mtl);
    read_scene(&folder.file("a.obj", obj), &options)
}

fn strict(test: &str, obj: &str, mtl: &str) -> Result<Imported, ReadError> {
    read(test, obj, mtl, ReadOptions::default())
}

#[test]
fn a_clean_box_is_closed_and_has_nothing_to_report() {
    let obj = format!("mtllib a.mtl\n{BOX}o room\nusemtl wood\n{FACES}");
    let Imported { scene, report } = strict("clean", &obj, WOOD).unwrap();
    assert_eq!((report.vertices, report.faces, report.quads, report.most_corners), (8, 6, 6, 4));
    assert!(report.closed() && report.warnings.is_empty(), "{report:?}");
    // 2·(3·5 + 5·4 + 3·4).
    assert_eq!((scene.area(), scene.materials.len()), (94.0, 1));
    assert_eq!(scene.surfaces[2].line, 14);
    assert_eq!(scene.surfaces[2].name, "room");
    assert_eq!(scene.surfaces[0].pieces[0].normal(), DVec3::Z);
}

#[test]
fn kd_is_reflectance_and_emission_is_pi_times_ke() {
    let obj = format!("mtllib a.mtl\n{BOX}usemtl wood\n{FACES}");
    let scene = strict("values", &obj, WOOD).unwrap().scene;
    assert_eq!(scene.materials[0].reflectance, [0.5, 0.25, 0.125]);
    assert_eq!(scene.materials[0].emission, [0.0, PI, 2.0 * PI]);
}

#[test]
fn carriage_returns_and_cyrillic_comments_change_nothing() {
    let clean = format!("mtllib a.mtl\n{BOX}usemtl wood\n{FACES}");
    let expected = strict("crlf-clean", &clean, WOOD).unwrap();
    let folder = Folder::new("crlf");
    // The MTL has Unix line ends, the OBJ those of DOS with one carriage return too many, and a comment in KOI8-R.
    folder.file("a.mtl", WOOD);
    let mut bytes = b"# \xcb\xcf\xcd\xce\xc1\xd4\xc1 ".to_vec();
    bytes.extend(clean.replace('\n', "\r\r\n").bytes());
    let read = read_scene(&folder.file("a.obj", bytes), &ReadOptions::default());
    // The first line is now a comment, so the library is missing: say so rather than guess.
    assert!(matches!(read, Err(ReadError::MissingMaterial { face: 0, .. })));
    let mut bytes = b"# \xcb\xcf\xcd\xce\xc1\xd4\xc1\r\n".to_vec();
    bytes.extend(clean.replace('\n', "\r\r\n").bytes());
    let mut read = read_scene(&folder.file("a.obj", bytes), &ReadOptions::default()).unwrap();
    read.scene.surfaces.iter_mut().for_each(|s| s.line -= 1);
    assert_eq!(read, expected);
}

#[test]
fn a_dropped_face_keeps_its_index() {
    let obj =
        format!("mtllib a.mtl\n{BOX}usemtl wood\nf 1 2 2\nf 1 2\n{FACES}v 1 0 0\nf 1 9 2\nf 2 3 4 1\nf 1 4 3 2\n");
    let Imported { scene, report } = strict("dropped", &obj, WOOD).unwrap();
    let empty: Vec<usize> = (0..11).filter(|k| scene.surfaces[*k].pieces.is_empty()).collect();
    // Two faces without three distinct corners, one of collinear corners, one that repeats the first wall.
    assert_eq!(empty, [0, 1, 8, 9]);
    assert_eq!((report.zero_area_dropped, report.repeated_dropped), (3, 1));
    assert_eq!((report.duplicate_faces, report.two_sided_sheets), (2, 1));
    assert_eq!((report.faces, report.triangles, report.quads), (11, 2, 8));
    // Without the dropped faces the box and its extra sheet leave four edges with two faces one way, one the other.
    assert_eq!((report.open_edges, report.turned_edges), (0, 4));
}

#[test]
fn concave_and_non_planar_faces_are_split_and_stay_one_surface() {
    // An L of area 5·3 − 2·2 = 11 in the plane z = 0, and a quad with one corner lifted.
    let obj = "mtllib a.mtl\nv 0 0 0\nv 5 0 0\nv 5 1 0\nv 3 1 0\nv 3 3 0\nv 0 3 0\nv 5 3 1\nusemtl wood\n\
               f 1 2 3 4 5 6\nf 1 2 7 6\n";
    let Imported { scene, report } = strict("split", obj, WOOD).unwrap();
    assert_eq!((report.concave_split, report.non_planar_split, report.polygons, report.most_corners), (1, 1, 1, 6));
    assert_eq!(scene.surfaces.len(), 2);
    assert!((scene.surfaces[0].area() - 11.0).abs() < 1e-12, "{}", scene.surfaces[0].area());
    assert!(scene.surfaces.iter().all(|s| s.pieces.len() > 1));
}

#[test]
fn open_edges_are_told_by_coordinates() {
    // The lid is missing, and one wall has corners of its own at the same places.
    let open = FACES.replace("f 5 8 7 6\n", "").replace("f 4 8 5 1", "f -4 -3 -2 -1");
    let obj = format!("{BOX}v 0 5 0\nv 0 5 4\nv -0 0 4\nv 0 -0 0\n{open}");
    let report = read_geometry(&Folder::new("open-edges").file("a.obj", obj)).unwrap().report;
    assert_eq!((report.open_edges, report.turned_edges), (4, 0));
}

#[test]
fn lines_points_and_unknown_statements_are_counted() {
    let obj = format!("{BOX}g a b\ns off\nl 1 2 3\nl 2 3\np 4\ncurv2 1 2\nfoo\nfoo bar\n{FACES}");
    let report = read_geometry(&Folder::new("statements").file("a.obj", obj)).unwrap().report;
    assert_eq!((report.line_elements, report.point_elements, report.other_lines), (2, 1, 3));
    assert!(report.warnings.iter().any(|w| w.contains("a.obj:15: lines 'foo' are left out (2 of them)")), "{report:?}");
}

#[test]
fn a_missing_material_names_line_and_face_or_takes_the_default() {
    let obj = format!("mtllib b.mtl\n{BOX}f 1 2 3 4\nusemtl (null)\nf 5 8 7 6\nusemtl oak\n{}", &FACES[20..]);
    let error = strict("missing", &obj, WOOD).unwrap_err().to_string();
    assert!(error.contains("a.obj:10: face 0 has no material (not found: b.mtl)"), "{error}");
    assert!(error.contains("--default-reflectance"), "{error}");
    let error = strict("missing-2", &obj.replace("f 1 2 3 4\nusemtl (null)\nf 5 8 7 6\n", ""), WOOD).unwrap_err();
    assert!(error.to_string().contains("a.obj:11: face 0 has material 'oak', which is not defined"), "{error}");
    let options = ReadOptions { default_reflectance: Some(0.3), ..ReadOptions::default() };
    let Imported { scene, report } = read("missing-3", &obj, WOOD, options).unwrap();
    assert_eq!((report.faces_without_material, report.faces_of_missing_materials), (2, 4));
    assert_eq!(
        (report.materials_missing, report.libraries_not_found),
        (vec!["oak".to_owned()], vec!["b.mtl".to_owned()])
    );
    assert!(scene.materials.iter().all(|m| m.reflectance == [0.3; 3] && m.emission == [0.0; 3]));
}

#[test]
fn libraries_may_have_blanks_in_their_names_or_share_a_line() {
    let folder = Folder::new("libraries");
    folder.file("my room.mtl", "newmtl a\nKd 0.1\n");
    folder.file("b.mtl", "newmtl b\nKd 0.2\n");
    folder.file("c.mtl", "newmtl c\nKd 0.3\n");
    let obj = format!(
        "mtllib my room.mtl\nmtllib .\\b.mtl c.mtl gone.mtl\n{BOX}usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\nusemtl c\nf 5 6 7\n"
    );
    let Imported { scene, report } = read_scene(&folder.file("a.obj", obj), &ReadOptions::default()).unwrap();
    let reflectances: Vec<f64> = scene.materials.iter().map(|m| m.reflectance[0]).collect();
    assert_eq!((reflectances, report.libraries_not_found), (vec![0.1, 0.2, 0.3], vec!["gone.mtl".to_owned()]));
}

#[test]
fn too_much_reflectance_is_refused_with_its_line_or_clamped() {
    let mtl = "newmtl white\nKd 1 0.5 0.5\nnewmtl gloss\nKd 0.6 0.6 0.3\nKs 0.6 0.6 0.6\nnewmtl fine\nKd 0.3\nKs 0.7\nnewmtl unused\nKd 3\n";
    let obj = |material: &str| format!("mtllib a.mtl\n{BOX}usemtl {material}\n{FACES}");
    let error = strict("clamp", &obj("white"), mtl).unwrap_err();
    assert!(matches!(error, ReadError::Reflectance { line: 2, value: 1.0, .. }), "{error}");
    assert!(error.to_string().contains("--clamp-reflectance 0.95"), "{error}");
    let error = strict("clamp-2", &obj("gloss"), mtl).unwrap_err();
    assert!(matches!(error, ReadError::ReflectanceSum { line: 5, value: 1.2, .. }), "{error}");
    assert_eq!(strict("clamp-3", &obj("fine"), mtl).unwrap().scene.materials[0].reflectance, [0.3; 3]);

    let options = ReadOptions { clamp_reflectance: Some(0.9), ..ReadOptions::default() };
    let clamped = |test, material| read(test, &obj(material), mtl, options).unwrap();
    // One factor for all bands: 0.9/1 for white, 1/1.2 for gloss.
    assert_eq!(clamped("clamp-4", "white").scene.materials[0].reflectance, [0.9, 0.45, 0.45]);
    let Imported { scene, report } = clamped("clamp-5", "gloss");
    let (rho, expected) = (&scene.materials[0].reflectance, [0.5, 0.5, 0.25]);
    assert!(rho.iter().zip(expected).all(|(r, x)| (r - x).abs() < 1e-15), "{rho:?}");
    assert_eq!(
        (report.clamped, report.kd_ks_above_1.len(), report.kd_at_least_1.len()),
        (vec!["gloss".to_owned()], 1, 0)
    );
    assert_eq!(clamped("clamp-6", "fine").report.clamped.len(), 0);
}

#[test]
fn negative_colours_are_refused_even_with_a_clamp() {
    let obj = format!("mtllib a.mtl\n{BOX}usemtl wood\n{FACES}");
    let options =
        ReadOptions { clamp_reflectance: Some(0.9), default_reflectance: Some(0.5), ..ReadOptions::default() };
    let error = read("negative", &obj, "newmtl wood\nKd 0.5 -0.1 0\n", options).unwrap_err();
    assert!(error.to_string().contains("a.mtl:2: Kd of material 'wood' is -0.1"), "{error}");
}

#[test]
fn settings_out_of_range_are_refused() {
    for value in [1.0, -0.1, f64::NAN] {
        let options = ReadOptions { clamp_reflectance: Some(value), ..ReadOptions::default() };
        assert!(matches!(read("setting", FACES, "", options), Err(ReadError::Setting { .. })), "{value}");
    }
}

#[test]
fn textures_and_specular_parts_are_named() {
    let mtl = "newmtl wood\nKd 0.5\nKs 0.25\nmap_Kd no/such.jpg\nnewmtl light\nKe 7\nnewmtl unused\nmap_Kd x.jpg\n";
    let obj = format!("mtllib a.mtl\n{BOX}usemtl wood\nf 1 2 3 4\nusemtl light\nf 5 8 7 6\n");
    let Imported { scene, report } = strict("textures", &obj, mtl).unwrap();
    assert_eq!(report.specular, ["wood: Ks 0.25"]);
    let warned = |report: &ImportReport| report.warnings.iter().any(|warning| warning.contains("wood: Ks 0.25"));
    let counting = ReadOptions { specular: true, ..ReadOptions::default() };
    assert!(warned(&report) && !warned(&read("textures_counted", &obj, mtl, counting).unwrap().report));
    assert_eq!(report.textures.len(), 1);
    assert!(
        report.warnings.contains(&"textures left out (1 of them not found): wood map_Kd no/such.jpg".to_owned()),
        "{report:?}"
    );
    // A light without Kd is black.
    assert_eq!(
        (report.materials_without_kd, &scene.materials[1].reflectance[..]),
        (vec!["light".to_owned()], &[0.0; 3][..])
    );
}

#[test]
fn a_file_without_any_area_is_refused() {
    for (text, faces) in [("", 0), (BOX, 0), ("v 0 0 0\nf 1 1 1\n", 1)] {
        match read_geometry(&Folder::new("empty").file("a.obj", text)) {
            Err(ReadError::Empty { faces: found, .. }) => assert_eq!(found, faces),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn a_file_that_is_not_there_is_named() {
    for path in ["no/such.obj", "."].map(PathBuf::from) {
        let error = read_geometry(&path).unwrap_err().to_string();
        assert!(error.starts_with(&format!("{}: cannot be read", path.display())), "{error}");
    }
}

#[test]
fn a_polygon_of_269_corners_is_one_surface() {
    let angle = |k: i32| f64::from(k) * 2.0 * PI / 269.0;
    let vertices: String = (0..269).map(|k| format!("v {} {} 2\n", angle(k).cos(), angle(k).sin())).collect();
    let corners: String = (1..=269).map(|k| format!(" {k}")).collect();
    let Imported { scene, report } =
        read_geometry(&Folder::new("many").file("a.obj", format!("{vertices}f{corners}\n"))).unwrap();
    assert_eq!((report.most_corners, scene.surfaces.len()), (269, 1));
    // A regular polygon of n corners has the area n/2·sin(2π/n).
    assert!((scene.area() - 134.5 * (2.0 * PI / 269.0).sin()).abs() < 1e-12);
}

/// The generator only has to reach odd places; what it hits does not matter. In memory, as files would take most of the time.
#[test]
fn garbage_and_truncated_files_never_panic() {
    let obj =
        format!("mtllib a.mtl\n{BOX}o a\nusemtl wood\n{FACES}f 1/1/1 2//2 \\\n -1\nl 1 2\nusemtl (null)\nf 1 2 7 3\n");
    let mtl = format!("{WOOD}Ks 0.1\nNs 5\nillum 2\nd -halo 0.5\nTr 0.5\nmap_Kd -s 1 1 1 a b.jpg\nbump x\nKa 1\n");
    let options =
        ReadOptions { clamp_reflectance: Some(0.95), default_reflectance: Some(0.5), ..ReadOptions::default() };
    let import = |obj: &[u8], mtl: &[u8]| {
        let raw = scan::scan(Path::new("a.obj"), obj)?;
        let mut library = Library::default();
        library.add(Path::new("a.mtl"), mtl)?;
        assemble::assemble(Path::new("a.obj"), raw, Some((&library, &options)), ImportReport::default())
    };
    assert!(import(obj.as_bytes(), mtl.as_bytes()).is_ok());
    let (mut read, mut refused) = (0, 0);
    for (in_obj, whole) in [(true, obj.as_bytes()), (false, mtl.as_bytes())] {
        let mut check =
            |bytes: &[u8]| match if in_obj { import(bytes, mtl.as_bytes()) } else { import(obj.as_bytes(), bytes) } {
                Ok(_) => read += 1,
                Err(e) => {
                    refused += 1;
                    assert!(!e.to_string().contains('\n'), "one line: {e}");
                }
            };
        (0..whole.len()).for_each(|end| check(&whole[..end]));
        let mut state = 7_u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as usize
        };
        for round in 0..10_000 {
            let mut bytes = whole.to_vec();
            // Bytes of the file's own alphabet more often than any byte, and stretches cut out now and then.
            for _ in 0..1 + round % 5 {
                let (at, from) = (next() % bytes.len(), next() % bytes.len());
                bytes[at] = if next() % 3 == 0 { next() as u8 } else { bytes[from] };
            }
            if round % 7 == 0 {
                let (start, end) = (next() % bytes.len(), next() % bytes.len());
                bytes.drain(start.min(end)..start.max(end));
            }
            check(&bytes);
        }
        for _ in 0..1000 {
            check(&(0..next() % 200).map(|_| next() as u8).collect::<Vec<u8>>());
        }
    }
    assert!(read > 1000 && refused > 1000, "{read} read, {refused} refused");
}
