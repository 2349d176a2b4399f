//! What the commands give on input that is right.

mod common;

use std::f64::consts::PI;

use common::{CUBE, CUBE_MTL, Folder, Ran, SQUARES, SQUARES_MTL};
use serde_json::Value;

fn squares(test: &str) -> Folder {
    let folder = Folder::new(test);
    folder.write("squares.obj", SQUARES);
    folder.write("squares.mtl", SQUARES_MTL);
    folder
}

fn done(ran: &Ran) {
    assert_eq!((ran.code, ran.stderr.as_str()), (0, ""));
}

fn numbers(text: &str) -> Vec<Vec<f64>> {
    text.lines().map(|line| line.split(',').map(|word| word.parse().unwrap()).collect()).collect()
}

fn table(text: &str) -> (String, Vec<Vec<f64>>) {
    let (header, rest) = text.split_once('\n').unwrap();
    (header.to_owned(), numbers(rest))
}

const COLUMNS: &str = "surface,i,j,x,y,z,area,E_r,E_g,E_b,H_r,H_g,H_b,B_r,B_g,B_b";
/// Opposed unit squares at distance 1.
const OPPOSED: f64 = 0.199_824_895_698_387_38;

#[test]
fn form_factors_are_a_matrix_without_header_row_from() {
    let folder = squares("form_factors");
    done(&folder.run("form-factors squares.obj --quiet --output F.csv"));
    let f = numbers(&folder.read("F.csv"));
    assert_eq!((f.len(), f[0].len()), (2, 2));
    assert_eq!((f[0][0], f[1][1]), (0.0, 0.0));
    assert!((f[0][1] - OPPOSED).abs() < 1e-9 && (f[1][0] - OPPOSED).abs() < 1e-9);
}

/// Rows of the cells of face 0 come first; the mean of their sums is F of the face.
#[test]
fn subdivided_form_factors_sum_to_those_of_the_faces() {
    let folder = squares("form_factors_subdivided");
    for method in ["analytic", "ray-cast --rays 4096", "hemicube --resolution 256"] {
        done(&folder.run(&format!("form-factors squares.obj --subdivide 3 --method {method} --quiet --output F.csv")));
        let f = numbers(&folder.read("F.csv"));
        assert_eq!((f.len(), f[0].len()), (18, 18), "{method}");
        let sum: f64 = f[..9].iter().flat_map(|row| &row[9..]).sum::<f64>() / 9.0;
        // 9 · 4096 rays: σ below 2e-3; the centre of a cell of 1/3 for the cell: 1 % of F.
        let allowed = if method == "analytic" { 1e-9 } else { 4e-3 };
        assert!((sum - OPPOSED).abs() < allowed, "{method}: {sum}");
    }
}

#[test]
fn json_is_one_object_with_counts_and_checks() {
    let folder = squares("json");
    let ran = folder.run("form-factors squares.obj --json --output F.csv");
    done(&ran);
    let object: Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!((object["cells"].as_u64(), object["closed"].as_bool()), (Some(2), Some(false)));
    assert_eq!(object["form_factors"]["counts"]["form_factors"].as_u64(), Some(1));
    let largest = object["checks"]["largest_row_sum"]["row_sum"].as_f64().unwrap();
    assert!((largest - OPPOSED).abs() < 1e-9);

    let ran = folder.run("solve squares.obj --subdivide 2 --json");
    done(&ran);
    let object: Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!((object["elements"].as_u64(), object["outcome"].as_str()), (Some(8), Some("converged")));
    // Σ A E = π Ke on a lamp of area 1.
    let emitted: Vec<f64> =
        object["power"]["emitted"].as_array().unwrap().iter().map(|e| e.as_f64().unwrap()).collect();
    assert!(emitted.iter().zip([2.0, 3.0, 4.0]).all(|(e, ke)| (e - PI * ke).abs() < 1e-12));

    let ran = folder.run("inspect squares.obj --json");
    done(&ran);
    let object: Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!((object["faces"].as_u64(), object["area"].as_f64()), (Some(2), Some(2.0)));
}

/// The lamp reflects nothing, so H of a floor cell is π Ke times its form factor and the lamp sees nothing else; the mean
/// over the floor is π Ke F, and B = ρ H.
#[test]
fn solve_writes_a_line_an_element_with_the_columns_of_the_contract() {
    let folder = squares("solve");
    done(&folder.run("solve squares.obj --subdivide 3 --quiet --output out.csv"));
    let (header, rows) = table(&folder.read("out.csv"));
    assert_eq!((header.as_str(), rows.len()), (COLUMNS, 18));
    let floor: Vec<&Vec<f64>> = rows.iter().filter(|row| row[0] == 0.0).collect();
    assert_eq!(floor.len(), 9);
    for (band, (ke, rho)) in [(2.0, 0.5), (3.0, 0.4), (4.0, 0.3)].into_iter().enumerate() {
        let mean = floor.iter().map(|row| row[10 + band]).sum::<f64>() / 9.0;
        assert!((mean - PI * ke * OPPOSED).abs() < 1e-8, "band {band}: {mean}");
        assert!(floor.iter().all(|row| (row[13 + band] - rho * row[10 + band]).abs() < 1e-12));
    }
    // Cell (i, j): i along the first edge (x), j along the last (y).
    let cell = floor.iter().find(|row| (row[1], row[2]) == (2.0, 0.0)).unwrap();
    assert!((cell[3] - 5.0 / 6.0).abs() < 1e-12 && (cell[4] - 1.0 / 6.0).abs() < 1e-12);
    assert!((cell[6] - 1.0 / 9.0).abs() < 1e-12);
}

#[test]
fn a_report_grid_has_its_own_lines_whatever_the_mesh() {
    let folder = squares("report_grid");
    for subdivide in [1, 2, 5] {
        done(&folder.run(&format!("solve squares.obj --subdivide {subdivide} --report-grid 4 --quiet --output g.csv")));
        let (header, rows) = table(&folder.read("g.csv"));
        assert_eq!((header.as_str(), rows.len()), (COLUMNS, 32));
        // Area means: their own mean is that of the elements, π Ke F whatever the mesh.
        let mean = rows.iter().filter(|row| row[0] == 0.0).map(|row| row[10]).sum::<f64>() / 16.0;
        assert!((mean - PI * 2.0 * OPPOSED).abs() < 1e-8, "--subdivide {subdivide}: {mean}");
    }
}

#[test]
fn every_solver_and_method_writes_the_same_solution() {
    let folder = squares("solvers");
    for solver in ["direct", "jacobi", "gauss-seidel", "cg", "shooting"] {
        for patches in ["", "--patch-subdivide 2"] {
            let options = format!("--subdivide 4 {patches} --solver {solver} --unshot 1e-12 --method analytic");
            done(&folder.run(&format!("solve squares.obj {options} --quiet --output {solver}.csv")));
            let (_, rows) = table(&folder.read(&format!("{solver}.csv")));
            let mean = rows.iter().filter(|row| row[0] == 0.0).map(|row| row[10]).sum::<f64>() / 16.0;
            assert!((mean - PI * 2.0 * OPPOSED).abs() < 1e-8, "{options}: {mean}");
        }
    }
}

#[test]
fn threads_and_repeats_give_the_same_file() {
    let folder = squares("threads");
    for method in ["analytic", "ray-cast", "rays+emitters", "hemicube"] {
        let solve = |threads: u32| {
            let options = format!("--subdivide 4 --method {method} --threads {threads} --seed 7");
            done(&folder.run(&format!("solve squares.obj {options} --quiet --output out.csv")));
            folder.read("out.csv")
        };
        let one = solve(1);
        assert!(solve(1) == one && solve(2) == one && solve(8) == one, "{method}");
    }
}

#[test]
fn a_dry_run_writes_nothing() {
    let folder = squares("dry_run");
    let before = folder.files();
    for command in [
        "form-factors squares.obj --output F.csv",
        "solve squares.obj --output out.csv",
        "compare squares.obj --output comparison",
        "inspect squares.obj",
    ] {
        let ran = folder.run(&format!("{command} --dry-run"));
        done(&ran);
        assert!(!ran.stdout.is_empty(), "{command} says what it would do");
    }
    assert_eq!(folder.files(), before);
}

#[test]
fn quiet_prints_nothing() {
    let folder = squares("quiet");
    for command in
        ["form-factors squares.obj --output F.mtx", "solve squares.obj --output o.ply", "inspect squares.obj"]
    {
        let ran = folder.run(&format!("{command} --quiet"));
        done(&ran);
        assert_eq!(ran.stdout, "", "{command}");
    }
    assert_eq!(folder.files(), ["F.mtx", "F.mtx.json", "o.ply", "squares.mtl", "squares.obj"]);
}

/// Two squares of 2 × 2 elements: 8 faces, or 4 triangles each.
#[test]
fn a_mesh_is_written_flat_or_linear() {
    let folder = squares("shading");
    for (shading, faces, of_vertices) in [("flat", 8, false), ("linear", 32, true)] {
        done(&folder.run(&format!("solve squares.obj --subdivide 2 --shading {shading} --output o.ply")));
        let text = folder.read("o.ply");
        assert!(text.contains(&format!("element face {faces}\n")), "{shading}");
        let before_faces = text.find("radiosity_r").unwrap() < text.find("element face").unwrap();
        assert_eq!(before_faces, of_vertices, "{shading}");
    }
}

#[test]
fn refinement_stops_at_its_tolerance_and_says_so() {
    let folder = squares("tolerance");
    let ran = folder.run("solve squares.obj --tolerance 0.02 --json");
    done(&ran);
    let object: Value = serde_json::from_str(&ran.stdout).unwrap();
    let steps = object["refinement"]["steps"].as_array().unwrap();
    let last = steps.last().unwrap()["estimate"]["total"].as_f64().unwrap();
    assert!(object["refinement"]["met"].as_bool().unwrap() && last <= 0.02, "{object}");
    assert_eq!(object["refinement"]["estimate"].as_f64(), Some(last));
    // As many rows as elements, all of them new.
    assert_eq!(steps[0]["counts"]["source_evaluations"], steps[0]["new_elements"]);
    // Conjugate gradients need the full form: everything is refined alike.
    let ran = folder.run("solve squares.obj --tolerance 0.02 --solver cg --json");
    done(&ran);
    let object: Value = serde_json::from_str(&ran.stdout).unwrap();
    let steps = object["refinement"]["steps"].as_array().unwrap();
    let last = steps.last().unwrap()["difference"]["rms"].as_f64().unwrap();
    assert!(object["refinement"]["met"].as_bool().unwrap() && last <= 0.02 && steps.len() > 1, "{object}");
}

/// A scene without light has the answer 0 and no error.
#[test]
fn a_dark_scene_is_solved() {
    let folder = squares("dark");
    folder.write("squares.mtl", "newmtl grey\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\n");
    let ran = folder.run("solve squares.obj --tolerance 0.1 --json --output out.csv");
    done(&ran);
    let (_, rows) = table(&folder.read("out.csv"));
    assert!(rows.iter().all(|row| row[7..].iter().all(|&v| v == 0.0)));
}

/// A face without an area keeps its row and column, which are 0, and spoils no check.
#[test]
fn a_face_without_area_is_a_row_of_zeros() {
    let folder = squares("zero_area");
    folder.write("squares.obj", &format!("{SQUARES}v 2 0 0\nv 3 0 0\nv 4 0 0\nf 9 10 11\n"));
    let ran = folder.run("form-factors squares.obj --json --output F.csv");
    assert_eq!(ran.code, 0, "{}", ran.stderr);
    let f = numbers(&folder.read("F.csv"));
    assert_eq!((f.len(), &f[2][..]), (3, &[0.0; 3][..]));
    assert!(f.iter().all(|row| row[2] == 0.0) && (f[0][1] - OPPOSED).abs() < 1e-9);
    let object: Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(object["checks"]["reciprocity"]["error"].as_f64(), Some(0.0));
    assert!((object["checks"]["largest_row_sum"]["row_sum"].as_f64().unwrap() - OPPOSED).abs() < 1e-9);
}

/// No form factor, a standard error, no bound; a target that rays do not reach ends by the steps allowed, with exit code 1.
#[test]
fn solving_by_rays_alone_tells_a_standard_error() {
    let folder = squares("solve_stochastic");
    let command = "solve squares.obj --subdivide 2 --method ray-cast --store on-demand --solver stochastic --json";
    let ran = folder.run(command);
    done(&ran);
    let object: Value = serde_json::from_str(&ran.stdout).unwrap();
    let count = |what: &str| object["solve"]["counts"][what].as_u64().unwrap();
    assert_eq!((count("form_factors"), count("source_evaluations"), count("entries_read")), (0, 0, 0));
    assert!(count("rays") >= 64 * 8 && object["standard_error"].as_f64().unwrap() <= 1e-2);
    assert!(object["bound"].is_null() && object["unshot"].is_null() && object["contraction"].is_null());
    let limited = folder.run(&format!("{command} --unshot 1e-9 --steps 20"));
    let object: Value = serde_json::from_str(&limited.stdout).unwrap();
    assert_eq!((limited.code, object["outcome"].as_str(), object["steps"].as_u64()), (1, Some("step limit"), Some(20)));
}

#[test]
fn compare_measures_every_strategy_and_writes_table_and_plot() {
    let folder = squares("compare");
    let ran = folder.run("compare squares.obj --subdivide 1 --json --output comparison");
    done(&ran);
    let object: Value = serde_json::from_str(&ran.stdout).unwrap();
    let strategies = object["strategies"].as_array().unwrap();
    assert!(strategies.len() >= 10, "{}", strategies.len());
    // cg on rows of rays stays in the table, with the reason.
    assert!(strategies.iter().any(|s| s["not_run"].as_str().is_some_and(|why| why.contains("symmetric"))));
    // Every run names its worst cell, of the 8 × 8 on one of the two squares, and the bias of both.
    for total in strategies.iter().map(|s| &s["errors"]["total"]).filter(|total| !total.is_null()) {
        let at = |index: &str| total["worst_cell_at"][index].as_u64().unwrap();
        assert!(at("surface") < 2 && at("i") < 8 && at("j") < 8, "{total}");
        assert_eq!(total["bias_per_surface"].as_array().unwrap().len(), 2);
    }
    let csv = folder.read("comparison/comparison.csv");
    assert_eq!(csv.lines().count(), strategies.len() + 1);
    let columns = |line: &str| line.split(',').count();
    assert!(csv.lines().next().unwrap().ends_with("worst_cell,worst_surface,worst_i,worst_j"));
    assert!(csv.lines().all(|line| columns(line) >= 19));
    assert!(folder.read("comparison/comparison.svg").contains("<svg"));
}

/// Rows of rays do not close: the worst are named, worst first, and a repair closes them all, in `form-factors` as in `solve`.
#[test]
fn the_worst_rows_are_named_and_a_repair_closes_them() {
    let folder = Folder::new("repair_commands");
    folder.write("cube.obj", CUBE);
    folder.write("cube.mtl", CUBE_MTL);
    for command in ["form-factors cube.obj --subdivide 2 --output F.csv", "solve cube.obj --subdivide 2"] {
        let run = |options: &str| -> Value {
            let ran = folder.run(&format!("{command} --rays 256 --json {options}"));
            done(&ran);
            serde_json::from_str(&ran.stdout).unwrap()
        };
        let off = |object: &Value, k: usize| object["checks"]["worst_rows"][k]["row_sum"].as_f64().unwrap() - 1.0;
        // Rows of rays close by themselves, but the mean of both directions does not, and is taken first.
        let (plain, repaired) = (run(""), run("--repair"));
        assert!(off(&plain, 0).abs() >= off(&plain, 1).abs() && plain["repair"].is_null());
        assert_eq!(plain["checks"]["worst_rows"].as_array().unwrap().len(), 5);
        assert!(plain["checks"]["reciprocity"]["error"].as_f64().unwrap() > 1e-4);
        let repair = &repaired["repair"];
        assert!(repair["closure_before"].as_f64().unwrap() > 1e-4, "{repair}");
        assert!(off(&repaired, 0).abs() < 1e-13 && repaired["checks"]["reciprocity"]["error"] == 0.0);
        let change = |name: &str| repair[name].as_f64().unwrap();
        assert!(change("rms_relative_change") < change("largest_relative_change"), "{repair}");
        assert!(change("rms_relative_change") > 0.0 && change("largest_change") > 0.0);
    }
    let beside: Value = serde_json::from_str(&folder.read("F.csv.json")).unwrap();
    assert_eq!(beside["repair"]["kind"], "symmetric scaling");
    // For people the same, by name.
    let ran = folder.run("form-factors cube.obj --subdivide 2 --rays 64 --repair --output F.csv");
    done(&ran);
    assert!(ran.stdout.contains("repair: the mean of both directions") && ran.stdout.contains("rows farthest from 1"));
}

/// A baffle halfway between the squares: pairs get smaller, never larger.
#[test]
fn blocked_pairs_are_compared_with_unblocked_ones() {
    let folder = squares("blocked");
    folder.write("squares.obj", &format!("{SQUARES}v 0 0 .5\nv .25 0 .5\nv .25 .25 .5\nv 0 .25 .5\nf 9 10 11 12\n"));
    let ran = folder.run("form-factors squares.obj --subdivide 2 --json --output F.csv");
    assert_eq!(ran.code, 0, "{}", ran.stderr);
    let object: Value = serde_json::from_str(&ran.stdout).unwrap();
    let blocked = &object["checks"]["blocked"];
    assert!(blocked["smaller"].as_u64().unwrap() > 0 && blocked["larger"] == 0, "{blocked}");
    assert!(blocked["pairs_compared_with_unblocked"].as_u64().unwrap() >= 16);
    assert!(squares_are_clear(&squares("clear")));
}

/// Nothing blocks between two squares, and nothing is compared.
fn squares_are_clear(folder: &Folder) -> bool {
    let ran = folder.run("form-factors squares.obj --subdivide 2 --json --output F.csv");
    serde_json::from_str::<Value>(&ran.stdout).unwrap()["checks"]["blocked"].is_null()
}

/// Every element is a line of `solve`'s output, those inside solids too; without contacts a cell is one row.
#[test]
fn contacts_give_the_rows_of_solve() {
    let folder = Folder::new("contacts");
    // A block stands on the middle of a floor of 2 × 2 cells: each is cut into its part under the block and the rest.
    let floor = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nf 1 2 3 4\n";
    let base = "v 1 1 0\nv 3 1 0\nv 3 3 0\nv 1 3 0\nv 1 1 1\nv 3 1 1\nv 3 3 1\nv 1 3 1\n";
    let sides = "f 5 6 10 9\nf 6 7 11 10\nf 7 8 12 11\nf 8 5 9 12\nf 9 10 11 12\n";
    folder.write("block.obj", &format!("{floor}{base}{sides}"));
    let lines = |options: &str| {
        let ran = folder.run(&format!("form-factors block.obj --subdivide 2 --quiet --output F.csv {options}"));
        done(&ran);
        numbers(&folder.read("F.csv"))
    };
    done(&folder.run("solve block.obj --default-reflectance 0.5 --subdivide 2 --quiet --output out.csv"));
    let (_, elements) = table(&folder.read("out.csv"));
    let (plain, cut) = (lines(""), lines("--contacts"));
    assert_eq!((plain.len(), cut.len()), (24, elements.len()));
    let beside: Value = serde_json::from_str(&folder.read("F.csv.json")).unwrap();
    let close = |a: &Value, b: f64| (a.as_f64().unwrap() - b).abs() < 1e-12;
    for (k, line) in elements.iter().enumerate() {
        assert!(close(&beside["surfaces"][k], line[0]) && close(&beside["cells"][k][0], line[1]), "{k}");
        assert!(close(&beside["areas"][k], line[6]), "{k}");
    }
    // Under the block, whose sides stand on the lines x, y = 1 and 3, nothing is exchanged.
    let covered = |line: &[f64]| line[0] == 0.0 && line[3] > 1.0 && line[3] < 3.0 && line[4] > 1.0 && line[4] < 3.0;
    let dark: Vec<usize> = (0..cut.len()).filter(|&k| covered(&elements[k])).collect();
    assert!(!dark.is_empty() && dark.iter().all(|&k| cut[k].iter().all(|&f| f == 0.0)), "{dark:?}");
}

/// Beside the store there may be a fifth of it, and what grows with the elements alone: the mesh, vectors and partial sums of products,
/// below 4 kB an element. What the smallest run takes is the program itself.
#[cfg(target_os = "linux")]
#[test]
fn peak_memory_is_that_of_the_store() {
    let folder = Folder::new("memory");
    folder.write("cube.obj", CUBE);
    folder.write("cube.mtl", CUBE_MTL);
    let peak = |command: &str| -> (f64, f64) {
        let ran = folder.run(&format!("{command} --method analytic --threads 2 --json"));
        done(&ran);
        let object: Value = serde_json::from_str(&ran.stdout).unwrap();
        (object["peak_bytes"].as_f64().unwrap(), object["stored_bytes"].as_f64().unwrap())
    };
    let (base, _) = peak("solve cube.obj --subdivide 1");
    let m = 6.0 * 14.0 * 14.0;
    let commands = [
        ("solve cube.obj --store dense", 1.0),
        ("solve cube.obj --store packed", 0.5),
        ("solve cube.obj --store packed-f32", 0.25),
        ("form-factors cube.obj --output F.npy", 1.0),
    ];
    for (command, share) in commands {
        let (peak, stored) = peak(&format!("{command} --subdivide 14"));
        // Tiles on the diagonal are whole: 256 entries a row more than half.
        assert!(stored < 8.0 * share * m * (m + 256.0), "{command}: {stored}");
        assert!(peak - base < 1.2 * stored + 4096.0 * m, "{command}: {peak} over {base}, {stored} stored");
    }
}

/// η of Jacobi's iteration is known for as many steps as there were products, and bounded from there on: its steps lie in the forecast.
/// Gauss–Seidel's are about half of them in rooms. The cube is closed but for its black lamp, the Cornell box is open and has blockers.
#[test]
fn steps_of_stationary_methods_are_forecast() {
    let folder = Folder::new("forecast");
    folder.write("cube.obj", CUBE);
    folder.write("cube.mtl", CUBE_MTL);
    let scenes = concat!(env!("CARGO_MANIFEST_DIR"), "/../../experiments/scenes/");
    for name in ["cornell_box.obj", "cornell_box.mtl"] {
        folder.write(name, &std::fs::read_to_string(format!("{scenes}{name}")).unwrap());
    }
    let object = |command: &str| -> Value {
        let ran = folder.run(&format!("{command} --method analytic --forecast --json"));
        done(&ran);
        serde_json::from_str(&ran.stdout).unwrap()
    };
    for scene in ["cube.obj --subdivide 4", "cornell_box.obj --subdivide 2"] {
        let before = object(&format!("inspect {scene}"))["forecast"].clone();
        let [low, high] = [0, 1].map(|k| before["spectral_radius"][k].as_f64().unwrap());
        assert!(0.0 < low && low <= high && high <= before["contraction"].as_f64().unwrap(), "{scene}: {before}");
        assert!(before["condition"].as_f64() <= before["condition_bound"].as_f64());
        assert_eq!(before["products"], 12);
        for solver in ["jacobi", "gauss-seidel"] {
            let run = object(&format!("solve {scene} --solver {solver}"));
            let (taken, steps) = (run["steps"].as_f64().unwrap(), &run["forecast"]["steps"][solver]);
            assert_eq!(*steps, before["steps"][solver], "{scene}: what inspect said");
            let (least, most) = (steps["least"].as_f64().unwrap(), steps["most"].as_f64().unwrap());
            if solver == "jacobi" {
                // η is evaluated to rounding: a step more or less where it meets the target.
                assert!(least - 1.0 <= taken && taken <= most + 1.0, "{scene}: {taken} steps of Jacobi, {steps}");
            }
            assert!(0.8 * most <= taken && taken <= 1.2 * most, "{scene}: {taken} steps of {solver}, {steps}");
        }
    }
}
