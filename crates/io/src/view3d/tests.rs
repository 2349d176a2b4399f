//! Whole files, small.

use glam::DVec3;

use super::*;
use crate::atomic::tests::Folder;

/// A box of 3 × 5 × 4 seen from inside.
const BOX: &str = "V 1 0 0 0\nV 2 3 0 0\nV 3 3 5 0\nV 4 0 5 0\nV 5 0 0 4\nV 6 3 0 4\nV 7 3 5 4\nV 8 0 5 4\n\
    S 1 1 2 3 4 0 0 0.9 floor\nS 2 5 8 7 6 0 0 0.9 ceiling\nS 3 1 5 6 2 0 0 0.8 south\n\
    S 4 2 6 7 3 0 0 0.8 east\nS 5 3 7 8 4 0 0 0.8 north\nS 6 4 8 5 1 0 0 0.8 west\n";

fn read(test: &str, text: &str) -> Result<View3dScene, ReadError> {
    let folder = Folder::new(&format!("view3d-{test}"));
    read_view3d(&folder.file("a.vs3", text), &ReadOptions::default())
}

fn fault(test: &str, text: &str) -> (usize, View3dFault) {
    match read(test, text) {
        Err(ReadError::View3d { line, fault, .. }) => (line, fault),
        other => panic!("{text}: {other:?}"),
    }
}

#[test]
fn a_box_is_read_with_its_control_values() {
    let text = format!("T A room\nC encl=1 eps=1.e-5\nF 3\n{BOX}End of data\nS 7 anything goes here\n");
    let read = read("box", &text).unwrap();
    assert_eq!((read.title.as_str(), read.control.enclosure, read.control.tolerance), ("A room", true, Some(1e-5)));
    let scene = &read.imported.scene;
    // 2·(3·5 + 5·4 + 3·4).
    assert_eq!((scene.surfaces.len(), scene.area(), read.imported.report.closed()), (6, 94.0, true));
    assert_eq!((scene.surfaces[0].name.as_str(), scene.surfaces[0].line), ("floor", 12));
    assert_eq!(scene.surfaces[0].pieces[0].normal(), DVec3::Z);
    assert_eq!(read.rows, (0..6).map(Some).collect::<Vec<_>>());
    assert_eq!(read.emittances, [0.9, 0.9, 0.8, 0.8, 0.8, 0.8]);
    // ρ = 1 − ε to rounding of the difference.
    let reflectance = |k: usize| scene.materials[scene.surfaces[k].material].reflectance[0];
    assert!((reflectance(1) - 0.1).abs() < 1e-15 && (reflectance(2) - 0.2).abs() < 1e-15);
}

#[test]
fn lower_case_carriage_returns_and_typeset_dashes_change_nothing() {
    let plain = read("plain", &format!("C encl=1 eps=1.e-5\nF 3\n{BOX}E\n")).unwrap();
    let other = format!("c ENCL=1 EPS=1.e-5\nf 3\n{}end\n", BOX.replace('S', "s").replace('V', "v"));
    let other = other.replace('-', "\u{2011}").replace('\n', "  ! a remark\r\n");
    assert_eq!(read("other", &other).unwrap(), plain);
}

#[test]
fn a_fourth_vertex_of_0_makes_a_triangle_and_vertices_may_come_later() {
    let text = "F 3\nS 1 7 8 9 0 0 0 0 tri\nV 9 0 1 0\nV 8 1 0 0\nV 7 0 0 0\n";
    let folder = Folder::new("view3d-triangle");
    let read = read_view3d_geometry(&folder.file("a.vs3", text)).unwrap();
    assert_eq!(read.imported.scene.surfaces[0].pieces[0].vertices(), [DVec3::ZERO, DVec3::X, DVec3::Y]);
    assert_eq!(read.emittances, [0.0]);
}

#[test]
fn an_obstruction_has_no_row_and_absorbs_all() {
    let text = format!("F 3\n{BOX}O 7 1 2 7 8 0 0 0 baffle\nO 8 2 3 8 0\n");
    let read = read("obstruction", &text).unwrap();
    assert_eq!(read.roles[6..], [Role::Obstruction; 2]);
    assert_eq!(read.rows[5..], [Some(5), None, None]);
    let scene = &read.imported.scene;
    assert_eq!((scene.surfaces[6].name.as_str(), scene.surfaces[7].pieces[0].vertices().len()), ("baffle", 3));
    assert_eq!(scene.materials[scene.surfaces[6].material].reflectance, [0.0; 3]);
}

#[test]
fn combined_surfaces_share_the_row_of_the_first() {
    let text = BOX.replace("S 4 2 6 7 3 0 0", "S 4 2 6 7 3 0 3").replace("S 5 3 7 8 4 0 0", "S 5 3 7 8 4 0 3");
    let rows = read("combined", &format!("F 3\n{text}")).unwrap().rows;
    assert_eq!(rows, [0, 1, 2, 2, 2, 3].map(Some));
}

/// A door of 1 × 2 in the south wall of 3 × 4, and a null surface of 1 × 1 that faces the wall.
#[test]
fn subsurfaces_and_null_surfaces_are_cut_out_of_their_base() {
    let more = "V 9 1 0 0\nV 10 2 0 0\nV 11 2 0 2\nV 12 1 0 2\nV 13 1 0 3\nV 14 2 0 3\n\
        S 7 9 12 11 10 3 0 0.5 door\nN 8 12 11 14 13 3 0 0.5 hole\n";
    let read = read("door", &format!("F 3\n{BOX}{more}")).unwrap();
    let scene = &read.imported.scene;
    // The cuts run along lines of whole coordinates: 12 − 2 − 1, rounded in no digit.
    assert_eq!((scene.surfaces[2].area(), scene.surfaces[6].area(), scene.surfaces[7].area()), (9.0, 2.0, 1.0));
    assert_eq!(read.rows[6..], [Some(6), None]);
    assert!(read.imported.report.closed());
}

/// The box once more, as shapes; the south wall as a quadrilateral and the north wall as two triangles.
#[test]
fn format_3a_gives_the_same_box() {
    let text = "F 3a\n\
        S 1 R 0 0 0.9 floor\n 0 0 0 180 0 3 5\n\
        S 2 R 0 0 0.9 ceiling\n 3 0 4 0 180 3 5\n\
        s 3 q 0 0 0.8 south\n 3 0 0 0 90\n 3 4  3 0  0 0  0 4\n"
        .replace("3 4  3 0  0 0  0 4", "0 0 3 0 3 4 0 4")
        + "S 4 R 0 0 0.8 east\n 3 5 0 270 90 5 4\n\
        S 5 T 0 0 0.8 north\n 0 5 0 180 90 0 0 3 0 3 4\n\
        S 6 T 0 5 0.8 north2\n 0 5 0 180 90 0 0\n 3 4 0 4\n\
        S 7 R 0 0 0.8 west\n 0 0 0 90 90 5 4\n";
    let shapes = read("3a", &text).unwrap();
    let mislabelled = read("3a-as-3", &text.replace("F 3a", "F 3")).unwrap();
    assert_eq!(mislabelled.imported.scene, shapes.imported.scene);
    assert_eq!((mislabelled.control.warnings.len(), shapes.control.warnings.len()), (1, 0));
    assert!(shapes.imported.report.closed());
    assert_eq!(shapes.rows, [0, 1, 2, 3, 4, 4, 5].map(Some));
    let plain = read("3", &format!("F 3\n{BOX}")).unwrap();
    let normals = |scene: &View3dScene| {
        let of = |s: &radiosity_geometry::Surface| s.pieces[0].normal();
        scene.imported.scene.surfaces.iter().filter(|s| s.name != "north2").map(of).collect::<Vec<_>>()
    };
    assert_eq!(normals(&shapes), normals(&plain));
    assert_eq!(shapes.imported.scene.bounds(), plain.imported.scene.bounds());
}

#[test]
fn what_cannot_be_used_is_named_with_its_line() {
    let with = |more: &str| format!("F 3\n{BOX}{more}");
    // BOX takes lines 2 to 15.
    for (more, words) in [
        ("V 9 0 0\n", "coordinate is missing"),
        ("V 9 0 0 1e99\n", "'1e99'"),
        ("V 8 0 0 0\n", "vertex 8 is defined twice"),
        ("S 7 1 2 3\n", "vertex number is missing"),
        ("S 7 1 2 9 0 0 0 0.5 a\n", "vertex 9 is not defined"),
        ("S 6 1 2 3 0 0 0 0.5 a\n", "surface 6 is defined twice"),
        ("S 7 1 2 3 0 0 0 1.5 a\n", "emittance is 1.5"),
        ("S 7 1 2 3 0 0 0 0 a\n", "--clamp-reflectance"),
        ("S 7 1 2 3 0 0 9 0.5 a\n", "surface to combine with 9 is not defined"),
        ("S 7 1 2 3 0 0 7 0.5 a\n", "must come before surface 7"),
        ("S 7 1 2 3 0 9 0 0.5 a\n", "base surface 9 is not defined"),
        ("S 7 1 2 3 0 7 0 0.5 a\n", "must come before surface 7"),
        ("S 7 1 2 6 0 1 0 0.5 a\n", "subsurface 7 does not lie in the plane"),
        ("S 7 3 2 1 0 1 0 0.5 a\n", "same way"),
        ("N 7 3 2 1 0 0 0 0.5 a\n", "no base surface"),
        ("M 7 3 2 1 0 1 0 0.5 a\n", "not supported"),
        ("X 1 2\n", "not supported"),
        ("F 2\n", "3 or 3a"),
        ("C eps=x\n", "'x'"),
        ("1 2 3\n", "'1' begins no statement"),
    ] {
        let (line, fault) = fault("faults", &with(more));
        assert!(line == 16 && fault.to_string().contains(words), "{more}: line {line}: {fault}");
    }
    let chain = "S 7 1 2 3 0 0 1 0.5 a\nS 8 1 2 3 0 0 7 0.5 a\n";
    assert!(matches!(fault("chain", &with(chain)), (17, View3dFault::Combined { number: 7, .. })));
    assert!(matches!(fault("3a", "F 3a\nS 1 C 0 0 0.9 disc\n"), (2, View3dFault::Number { .. })));
    assert!(matches!(fault("short", "F 3a\nS 1 R 0 0 0.9 a\n 0 0 0 0 90 1\n"), (3, View3dFault::Missing { .. })));
    assert!(matches!(read("empty", "T nothing\nE\n"), Err(ReadError::Empty { faces: 0, first_line: None, .. })));
}

/// Bytes of a small multiplicative generator: the point is that no input panics, not what it is.
#[test]
fn damaged_files_give_errors_not_panics() {
    let whole = format!("C encl=1\nF 3\n{BOX}S 7 1 2 3 0 1 1 0.5 a\nE\n").into_bytes();
    let folder = Folder::new("view3d-garbage");
    let (mut state, mut refused) = (1_u64, 0);
    for k in 0..2000 {
        let mut bytes = whole[..whole.len() - k % whole.len()].to_vec();
        for _ in 0..3 {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let at = (state >> 33) as usize % bytes.len();
            bytes[at] = (state >> 20) as u8;
        }
        refused += usize::from(read_view3d(&folder.file("a.vs3", bytes), &ReadOptions::default()).is_err());
    }
    assert!(refused > 500, "{refused} of the damaged files were refused");
}
