//! Pictures of small scenes by the built program.

mod common;

use std::f64::consts::PI;

use common::{CUBE, CUBE_MTL, Folder, Ran};
use serde_json::Value;

const ROOM: &str = include_str!("data/specular_room.obj");
const ROOM_MTL: &str = include_str!("data/specular_room.mtl");

/// A few elements and pixels of the room.
const SMALL: &str = "render specular_room.obj --quiet --subdivide 1 --size 20x15 --fov 100 --noise 0";

fn room(test: &str) -> Folder {
    let folder = Folder::new(test);
    folder.write("specular_room.obj", ROOM);
    folder.write("specular_room.mtl", ROOM_MTL);
    folder
}

fn cube(test: &str, library: &str) -> Folder {
    let folder = Folder::new(test);
    folder.write("cube.obj", CUBE);
    folder.write("cube.mtl", library);
    folder
}

fn done(ran: &Ran) {
    assert_eq!((ran.code, ran.stderr.as_str()), (0, ""));
}

/// Red, green and blue of every pixel.
fn pixels(folder: &Folder, name: &str, (width, height): (u32, u32)) -> Vec<[f64; 3]> {
    let picture = image::load_from_memory(&folder.bytes(name)).unwrap().into_rgb32f();
    assert_eq!(picture.dimensions(), (width, height));
    picture.pixels().map(|p| p.0.map(f64::from)).collect()
}

#[test]
fn the_same_bytes_are_written_at_one_thread_and_two() {
    let folder = room("render_threads");
    for (threads, name) in [(1, "one"), (2, "two")] {
        for format in ["png", "exr"] {
            let more = format!("--samples 32 --gather 2 --state {name}.film --threads {threads}");
            done(&folder.run(&format!("{SMALL} {more} --preview {name}.preview.{format} --output {name}.{format}")));
            assert_eq!(folder.bytes(&format!("{name}.preview.{format}")), folder.bytes(&format!("{name}.{format}")));
        }
    }
    for kind in ["png", "exr", "film"] {
        assert!(folder.bytes(&format!("one.{kind}")) == folder.bytes(&format!("two.{kind}")), "{kind}");
    }
    assert_eq!(pixels(&folder, "one.png", (20, 15)).len(), 300);
}

#[test]
fn a_picture_that_goes_on_is_that_of_one_run() {
    let folder = room("render_resume");
    done(&folder.run(&format!("{SMALL} --samples 64 --state whole.film --output whole.exr")));
    done(&folder.run(&format!("{SMALL} --samples 32 --state part.film --output part.exr")));
    assert!(folder.bytes("part.exr") != folder.bytes("whole.exr"));
    done(&folder.run(&format!("{SMALL} --samples 64 --state part.film --resume --output part.exr")));
    assert!(folder.bytes("part.exr") == folder.bytes("whole.exr"));
    assert!(folder.bytes("part.film") == folder.bytes("whole.film"));

    for (change, word) in [
        ("--seed 2", "--seed"),
        ("--paths LDE", "--paths"),
        ("--gather 1", "method"),
        ("--shading flat", "method"),
        ("--eye 1,1,1", "camera"),
    ] {
        let ran = folder.run(&format!("{SMALL} {change} --state part.film --resume --output part.exr"));
        assert_eq!(ran.code, 2);
        assert!(ran.stderr.starts_with("error: part.film") && ran.stderr.contains(word), "{}", ran.stderr);
    }
    folder.write("part.film", "radiosity film 2\n{}\n");
    assert_eq!(folder.run(&format!("{SMALL} --state part.film --resume --output part.exr")).code, 2);
    assert!(folder.bytes("part.exr") == folder.bytes("whole.exr"), "a refusal leaves pictures as they were");
}

/// The samples are the same, so that only the rounding of single precision remains: 10 times 6e-8 of a pixel.
#[test]
fn classes_add_up_to_the_whole_by_either_method() {
    let folder = room("render_classes");
    for method in ["--gather 2", "--reference"] {
        let small = if method == "--reference" { SMALL.replace("--subdivide 1", "") } else { SMALL.to_owned() };
        let picture = |more: &str| {
            done(&folder.run(&format!("{small} --samples 16 {method} {more} --output p.exr")));
            pixels(&folder, "p.exr", (20, 15)).concat()
        };
        let add = |sum: &mut Vec<f64>, part: &[f64]| sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        let agree = |a: &[f64], b: &[f64]| assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-6 * a), "{method}");
        let whole = picture("");
        let (mut sum, mut first_three) = (vec![0.0; whole.len()], vec![0.0; whole.len()]);
        for class in ["LE", "LSE", "LDE", "LDSE", "LSDE", "LSDSE", "LDDE", "LDDSE", "LDSDE", "LDSDSE"] {
            let part = picture(&format!("--paths {class}"));
            assert!(part.iter().any(|l| *l > 0.0), "{method}: there is {class}");
            add(&mut sum, &part);
            if matches!(class, "LE" | "LSE" | "LDE") {
                add(&mut first_three, &part);
            }
        }
        agree(&whole, &sum);
        agree(&picture("--paths LE,LSE,LDE"), &first_three);
    }
}

/// A cube of E = 3, ρ = 0.5 is lit by B = 6 from everywhere, and a perfect mirror in place of one wall shows just that. Rays of F′ leave about half a percent. At the outline
/// of a wall, itself a light, it and what the mirror shows beside it are sampled apart, so that noise is to be less.
#[test]
fn a_mirror_in_a_furnace_shows_what_is_everywhere() {
    let ke = 3.0 / PI;
    let mtl = format!("newmtl grey\nKd 0.5\nKe {ke}\nnewmtl lamp\nKd 0 0 0\nKs 1 1 1\nillum 3\n");
    let folder = cube("render_furnace", &mtl);
    let run = |more: &str| done(&folder.run(&format!("render cube.obj --quiet --subdivide 2 --size 9x7 {more}")));
    // The ceiling is the mirror.
    let up = "--eye 0.3,0.4,0.2 --look-at 0.5,0.5,1 --up 1,0,0 --light-points 0 --noise 0.001";
    run(&format!("{up} --output p.exr"));
    for l in pixels(&folder, "p.exr", (9, 7)).concat() {
        assert!((l * PI - 6.0).abs() < 0.02 * 6.0, "{}", l * PI);
    }
    // Without bounces the walls lack what came by way of the mirror.
    run(&format!("{up} --specular-bounces 0 --output p.exr"));
    assert!(pixels(&folder, "p.exr", (9, 7)).concat().iter().all(|l| l * PI < 5.8));
    run(&format!("{up} --specular-bounces 0 --paths LSDE --output p.exr"));
    assert!(pixels(&folder, "p.exr", (9, 7)).concat().iter().all(|l| *l == 0.0));
    // Half of white is the signal 188; by Reinhard with l = 2 it is 0.75 of white, 225.
    for (tone, byte) in [("clamp", 188), ("reinhard", 225)] {
        run(&format!("{up} --white 12 --tone {tone} --output p.png"));
        let bytes = image::load_from_memory(&folder.bytes("p.png")).unwrap().into_rgb8().into_raw();
        assert!(bytes.iter().all(|b| b.abs_diff(byte) <= 2), "{tone}: {bytes:?}");
    }
}

#[test]
fn json_counts_both_passes() {
    let folder = room("render_json");
    let small = SMALL.replace("--quiet", "--json").replace("--noise 0", "--noise 0.5");
    let ran = folder.run(&format!("{small} --output p.png"));
    done(&ran);
    let object: Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(
        (object["first_pass"]["outcome"].as_str(), object["noise_met"].as_bool()),
        (Some("converged"), Some(true))
    );
    assert!(object["noise"].as_f64().unwrap() <= 0.5 && object["samples"].as_u64().unwrap() >= 32);
    let rays = |pass: &str| object[pass]["counts"]["rays"].as_u64().unwrap();
    let samples = 300 * object["samples"].as_u64().unwrap();
    assert!(rays("first_pass") > 0 && rays("second_pass") > samples);
    let specular = &object["first_pass"]["extended_form_factors"]["counts"]["rays"];
    assert!(specular.as_u64().unwrap() > 0);

    // A look around of 9 × 64 rays an element, of which mirrors and glass make more.
    let ran = folder.run(&format!("{small} --gather 1 --gather-tolerance 0.05 --output p.png"));
    let object: Value = serde_json::from_str(&ran.stdout).unwrap();
    let gathering = |key: &str| object["gathering"][key].as_u64().unwrap();
    let elements = object["first_pass"]["elements"].as_u64().unwrap();
    assert!(gathering("elements") > 0 && gathering("elements") < elements);
    assert!(object["gathering"]["counts"]["rays"].as_u64().unwrap() > 0);

    // What was asked for and not reached is a failed check.
    let ran = folder.run(&format!("{SMALL} --samples 16 --output p.png").replace("--noise 0", "--noise 0.001"));
    assert_eq!((ran.code, ran.stderr.as_str()), (1, ""));
}

/// The eye that `--dry-run` tells.
fn eye(folder: &Folder, scene: &str) -> Vec<f64> {
    let ran = folder.run(&format!("render {scene} --dry-run --json --output p.png"));
    done(&ran);
    let object: Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(object["camera"]["up"], serde_json::json!([0.0, 0.0, 1.0]), "lamps hang from the ceiling");
    object["camera"]["eye"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

#[test]
fn the_camera_stands_inside_closed_rooms_and_before_open_ones() {
    let folder = cube("render_camera", CUBE_MTL);
    let near = |a: &[f64], b: [f64; 3]| assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12), "{a:?}");
    near(&eye(&folder, "cube.obj"), [0.05, 0.5, 0.5]);
    // Without the wall at x = 1; the sphere around the cube fills 60° at twice its radius of √3/2.
    folder.write("open.obj", &CUBE.replace("\nf 7 3 2 6", ""));
    near(&eye(&folder, "open.obj"), [0.5 + 3.0_f64.sqrt(), 0.5, 0.5]);
}

#[test]
fn what_makes_no_picture_is_refused_in_one_sentence() {
    let folder = cube("render_refused", CUBE_MTL);
    folder.write("out.png", "an earlier result\n");
    folder.write("flat.obj", "mtllib cube.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nusemtl lamp\nf 1 2 3\n");
    for (arguments, word) in [
        ("cube.obj --output out.jpg", ".png or .exr"),
        ("cube.obj --preview out.gif --output out.png", "out.gif"),
        ("cube.obj --state nowhere/a.film --output out.png", "no folder nowhere"),
        ("cube.obj --paths LDE,LSX --output out.png", "LSX"),
        ("cube.obj --size 0x5 --output out.png", "0x5"),
        ("cube.obj --eye 1,2 --output out.png", "three numbers"),
        ("cube.obj --eye 0,0,0 --look-at 0,0,0 --output out.png", "looks at itself"),
        ("cube.obj --fov 180 --output out.png", "180"),
        ("cube.obj --specular-bounces two --output out.png", "whole number, or any"),
        ("cube.obj --gather 4 --light-points 0 --output out.png", "one point on lights"),
        ("cube.obj --reference --gather 4 --output out.png", "cannot be used with"),
        ("cube.obj --gather 4 --gather-tolerance 2 --output out.png", "[0, 1)"),
        ("cube.obj --reference --shading flat --output out.png", "cannot be used with"),
        ("cube.obj --resume --output out.png", "--state"),
        ("cube.obj --resume --state no.film --output out.png", "no.film"),
        ("cube.obj --noise 1 --output out.png", "[0, 1)"),
        ("flat.obj --output out.png", "--eye"),
    ] {
        let ran = folder.run(&format!("render {arguments}"));
        assert_eq!((ran.code, ran.stdout.as_str()), (2, ""), "{arguments}: {}", ran.stderr);
        assert!(ran.stderr.starts_with("error: ") && ran.stderr.contains(word), "{arguments}: {}", ran.stderr);
        assert_eq!(folder.read("out.png"), "an earlier result\n", "{arguments}");
    }
}
