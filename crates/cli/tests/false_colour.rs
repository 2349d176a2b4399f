//! Pictures in false colours by the built program.

mod common;

use std::f64::consts::PI;

use common::{CUBE, Folder, Ran};
use radiosity_render::{Image, Scale};
use serde_json::Value;

fn done(ran: &Ran) {
    assert_eq!((ran.code, ran.stderr.as_str()), (0, ""));
}

/// A cube of E = 3 and ρ = 0.5, in which H = 6 and B = 6 everywhere; its ceiling as `ceiling` says.
fn furnace(test: &str, ceiling: &str) -> Folder {
    let folder = Folder::new(test);
    folder.write("cube.obj", CUBE);
    let ke = 3.0 / PI;
    folder.write("cube.mtl", &format!("newmtl grey\nKd 0.5\nKe {ke}\nnewmtl lamp\n{ceiling}\n"));
    folder
}

/// The cube from its middle, 11 × 9 pixels.
const VIEW: &str =
    "render cube.obj --no-progress --size 11x9 --eye 0.5,0.5,0.4 --look-at 0.5,0.6,1 --up 0,1,0 --fov 80";

fn run(folder: &Folder, more: &str) {
    done(&folder.run(&format!("{VIEW} --quiet {more}")));
}

fn exr(folder: &Folder, name: &str) -> Vec<f64> {
    let picture = image::load_from_memory(&folder.bytes(name)).unwrap().into_rgb32f();
    assert_eq!(picture.dimensions(), (11, 9));
    picture.into_raw().into_iter().map(f64::from).collect()
}

fn png(folder: &Folder, name: &str) -> Image {
    let picture = image::load_from_memory(&folder.bytes(name)).unwrap().into_rgb8();
    Image { width: picture.width(), height: picture.height(), rgb: picture.into_raw() }
}

/// In a furnace both methods give one number for all surfaces, mirrors' irradiance included. 4,096 samples leave a standard error of 0.6 %, 4 of which are 2.5 %.
#[test]
fn radiosity_and_irradiance_of_a_furnace_are_its_own_by_either_method() {
    let folder = furnace("false_colour_furnace", "Kd 0\nKs 1 1 1\nillum 3");
    for (method, samples) in [("--subdivide 2", 16), ("--reference", 4096)] {
        let method = format!("{method} --noise 0");
        run(&folder, &format!("{method} --samples {samples} --false-colour irradiance --output h.exr"));
        assert!(exr(&folder, "h.exr").iter().all(|h| (h - 6.0).abs() < 0.15), "{method}");
        // The ceiling, a mirror, has no radiosity; walls do, and at edges a pixel shows some of both.
        run(&folder, &format!("{method} --samples {samples} --false-colour radiosity --output b.exr"));
        let b = exr(&folder, "b.exr");
        assert!(b.iter().all(|b| *b < 6.15) && b.contains(&0.0) && b.iter().any(|b| *b > 5.85), "{method}");
        // E alone is 3.
        run(&folder, &format!("{method} --samples 16 --false-colour radiosity --paths LE --output b.exr"));
        let e = exr(&folder, "b.exr");
        assert!(e.iter().all(|e| *e < 3.0 + 1e-6) && e.iter().any(|e| *e > 3.0 - 1e-6), "{method}");
    }
}

/// The colours of a given range are those of its scale, with a legend beside, and the report says what the range was if none was given.
#[test]
fn colours_are_those_of_the_range_and_a_legend_stands_beside() {
    let folder = furnace("false_colour_range", "Kd 0.5\nKe 0.954929658551372");
    for range in [[0.0, 8.0], [4.0, 6.5]] {
        let [low, high] = range;
        run(&folder, &format!("--subdivide 1 --false-colour irradiance --range {low},{high} --output h.png"));
        let (image, scale) = (png(&folder, "h.png"), Scale::linear(low, high).unwrap());
        assert!(image.width > 11 + 16 && image.height == 24, "{} × {}", image.width, image.height);
        for (x, y) in [(0, 0), (10, 0), (5, 4), (0, 8), (10, 8)] {
            let (shown, known) = (image.pixel(x, y), scale.colour(6.0));
            assert!(shown.iter().zip(known).all(|(a, b)| a.abs_diff(b) <= 4), "{shown:?}, not {known:?}");
        }
        let bar = image.width - scale.legend(24, 3, "W/m²").width;
        assert_eq!((image.pixel(bar, 0), image.pixel(bar, 23)), (scale.colour(high), scale.colour(low)));
    }
    let ran = folder.run(&format!("{VIEW} --json --subdivide 1 --false-colour irradiance --output h.png"));
    done(&ran);
    let object: Value = serde_json::from_str(&ran.stdout).unwrap();
    let ends: Vec<f64> = object["scale"].as_array().unwrap().iter().map(|end| end.as_f64().unwrap()).collect();
    assert!(ends[0] == 0.0 && (ends[1] - 6.0).abs() < 0.1 && object["white"].is_null(), "{ends:?}");
}

/// A picture has no error against itself, grey all over; against one of half the light its error is π L/2.
#[test]
fn errors_are_those_against_the_other_picture() {
    let folder = furnace("false_colour_error", "Kd 0.5\nKe 0.954929658551372");
    let small = "--subdivide 1 --light-points 0 --noise 0 --samples 16";
    run(&folder, &format!("{small} --output whole.exr"));
    run(&folder, &format!("{small} --false-colour error --against whole.exr --range -1,1 --output none.png"));
    let (image, scale) = (png(&folder, "none.png"), Scale::signed(1.0).unwrap());
    assert!((0..11 * 9).all(|k| image.pixel(k % 11, k / 11) == scale.colour(0.0)));

    run(&folder, &format!("{small} --paths LE --output emitted.exr"));
    run(&folder, &format!("{small} --false-colour error --against emitted.exr --output error.exr"));
    let error = exr(&folder, "error.exr");
    assert!(error.iter().all(|l| (l * PI - 3.0).abs() < 0.06), "{error:?}");
    run(&folder, &format!("{small} --false-colour error --against emitted.exr --range -12,12 --output error.png"));
    let (shown, known) = (png(&folder, "error.png").pixel(5, 4), Scale::signed(12.0).unwrap().colour(3.0));
    assert!(shown.iter().zip(known).all(|(a, b)| a.abs_diff(b) <= 4), "{shown:?}, not {known:?}");
}

/// A film of B or H is not one of the picture; errors are those of the picture's own film.
#[test]
fn a_film_goes_on_only_as_what_it_is() {
    let folder = furnace("false_colour_state", "Kd 0.5\nKe 1");
    let small = "--subdivide 1 --noise 0 --samples 32";
    run(&folder, &format!("{small} --state a.film --output a.exr"));
    run(&folder, &format!("{small} --state a.film --resume --false-colour error --against a.exr --output e.exr"));
    assert!(exr(&folder, "e.exr").iter().all(|error| *error == 0.0));
    let ran = folder.run(&format!("{VIEW} {small} --state a.film --resume --false-colour irradiance --output h.exr"));
    assert!(ran.code == 2 && ran.stderr.contains("a.film"), "{}", ran.stderr);
}

#[test]
fn one_thread_and_two_make_the_same_bytes() {
    let folder = furnace("false_colour_threads", "Kd 0\nKs 0.8 0.8 0.8\nillum 3");
    for quantity in ["radiosity", "irradiance"] {
        for method in ["--subdivide 2", "--reference"] {
            for threads in [1, 2] {
                let more = format!("--false-colour {quantity} --noise 0 --samples 32 --threads {threads}");
                run(&folder, &format!("{method} {more} --output {threads}.png"));
            }
            assert!(folder.bytes("1.png") == folder.bytes("2.png"), "{quantity} {method}");
        }
    }
}

#[test]
fn what_makes_no_such_picture_is_refused_in_one_sentence() {
    let folder = furnace("false_colour_refused", "Kd 0.5\nKe 1");
    run(&folder, "--subdivide 1 --samples 16 --noise 0 --output good.exr");
    folder.write("broken.exr", "no picture\n");
    folder.write("out.png", "an earlier result\n");
    for (arguments, word) in [
        ("--false-colour error", "--against"),
        ("--against good.exr", "--false-colour error"),
        ("--false-colour irradiance --against good.exr", "--false-colour error"),
        ("--false-colour error --against nowhere.exr", "nowhere.exr"),
        ("--false-colour error --against broken.exr", "broken.exr"),
        ("--false-colour error --against good.exr --size 5x5", "--size 11x9"),
        ("--false-colour error --against good.exr --range -1,2", "--range=-2,2"),
        ("--false-colour irradiance --range 2,1", "LOW,HIGH"),
        ("--false-colour irradiance --range 1", "LOW,HIGH"),
        ("--false-colour irradiance --gather 4", "--gather"),
        ("--false-colour irradiance --white 3", "cannot be used with"),
        ("--range 0,1", "--false-colour"),
        ("--false-colour temperature", "temperature"),
    ] {
        let view = if arguments.contains("--size") { VIEW.replace(" --size 11x9", "") } else { VIEW.to_owned() };
        let ran = folder.run(&format!("{view} {arguments} --output out.png"));
        assert_eq!((ran.code, ran.stdout.as_str()), (2, ""), "{arguments}: {}", ran.stderr);
        assert!(ran.stderr.starts_with("error: ") && ran.stderr.contains(word), "{arguments}: {}", ran.stderr);
        assert_eq!(folder.read("out.png"), "an earlier result\n", "{arguments}");
    }
}
