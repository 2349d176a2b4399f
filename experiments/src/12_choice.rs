//! Whether the strategy that is chosen for a scene is the one that is there first.
//!
//! Question: how much longer than the best of all candidates, known in hindsight, does the chosen one take to a tolerance, the choice included? And do predictions of
//! time and memory and the estimated error hold? Theory: form factors and rays are counted before a run, so that their time is known to the
//! spread of a machine; how often a mesh is refined is not, and follows from a pilot on few elements, whose error falls with the edge to a power that varies between
//! scenes. What a wrong choice costs is bounded by how far candidates are apart. Measured on generated scenes of
//! every kind of the gallery, of different reflectances, report grids and tolerances from 0.5 to 3 %: every candidate refines until its own estimate meets
//! the tolerance; runs are repeated turn by turn, and the median counts. A run is cut off between two meshes where the next one would take it beyond ten times the best so far; a candidate that took
//! three times as long as the best in the first turn is not repeated, and scenes of which a turn takes seconds have fewer turns. The best in hindsight is the fastest that met the tolerance by its own estimate and
//! against the reference. Constants of the cost model were fitted on other members of the same families (other sizes, seeds, reflectances) and not on these
//! scenes, but for the two rooms and that with a black floor, of which there is one each. References: exact pairs on a mesh that nests in the report cells, or rows of many rays where more than a dozen polygons block. Read: regret 1 is the best; points of predicted against measured
//! time lie on the diagonal. Not shown: scenes for which all candidates take seconds, and other machines. Which runs are cut off depends on the clock, so that rows of slow
//! candidates may come and go; what is chosen does not, and the tiny profile cuts nothing off.

use std::error::Error;
use std::time::Instant;

use radiosity::choice::{Candidate, Reached, Refine, Target};
use radiosity::{Choice, Constants, GridValues, Wanted};
use radiosity_core::{mix, uniform};
use radiosity_experiments::{Context, Experiment, Profile, Record, Row, Tables, group_by};
use radiosity_gallery::boxes::{box_in_cube, empty_box, material};
use radiosity_gallery::{BlockedLight, Hinge, city, crowded_room, furnace, rooms};
use radiosity_geometry::{Occluders, Scene};
use radiosity_plot::numbers;
use radiosity_plot::{Axis, Figure, Panel, Point, Quality, Series};
use radiosity_render::fingerprint;

use crate::common::{cornell, counts, kept, with_reflectance};
use crate::truth::{Truth, nested_pairs_truth, nested_rays_truth};

/// The experiment.
pub struct StrategyChoice;

/// Times the best beyond which a run is cut off.
const CUT_OFF: f64 = 10.0;
/// Times the best of the first turn beyond which a candidate is not repeated.
const AGAIN: f64 = 3.0;
/// Turns of each scene at least, and seconds after which no more are begun.
const LEAST_TURNS: u32 = 2;
const PATIENCE: f64 = 8.0;
/// Polygons that may block up to which the reference is by pairs.
const FEW: usize = 12;

/// A scene with what is wanted of it.
struct Case {
    name: String,
    family: &'static str,
    scene: Scene,
    tolerance: f64,
    grid: u32,
}

fn case(family: &'static str, name: impl std::fmt::Display, scene: Scene, tolerance: f64, grid: u32) -> Case {
    Case { name: format!("{family} {name}"), family, scene, tolerance, grid }
}

/// A tube of which the low end is lit and black.
fn tube(length: f64, reflectance: f64) -> Scene {
    let mut scene = empty_box([1.0, 1.0, length], material("wall", reflectance, 0.0));
    scene.materials.push(material("light", 0.0, 1.0));
    scene.surfaces[4].material = 1;
    scene
}

/// A box in the middle of a cube with a ceiling that shines.
fn lit_box(side: f64, reflectance: f64) -> Scene {
    let mut scene = box_in_cube(side, material("room", reflectance, 0.0), material("box", 0.5, 0.0));
    scene.materials.push(material("light", 0.2, 1.0));
    scene.surfaces[5].material = 2;
    scene
}

/// An empty box of random edges, with random reflectances and two random faces that shine.
fn random_room(seed: u64) -> Scene {
    let mut drawn = mix(seed);
    let mut between = |low: f64, high: f64| {
        drawn += 1;
        low + (high - low) * uniform(drawn)
    };
    let size = [between(1.0, 4.0), between(1.0, 4.0), between(1.0, 4.0)];
    let mut scene = empty_box(size, material("face", 0.0, 0.0));
    let lit = [between(0.0, 3.0) as usize, between(3.0, 6.0) as usize];
    for k in 0..6 {
        let emission = if lit.contains(&k) { between(0.5, 2.0) } else { 0.0 };
        scene.materials.push(material("face", between(0.1, 0.9), emission));
        scene.surfaces[k].material = k + 1;
    }
    scene
}

fn cases(profile: Profile) -> Result<Vec<Case>, Box<dyn Error>> {
    let hinge = |degrees: f64, reflectance: f64, tolerance| {
        let scene = Hinge { angle: degrees.to_radians(), emission: 1.0, reflectance }.scene();
        case("hinge", format!("{degrees}°"), scene, tolerance, 8)
    };
    let blocked =
        |height: f64, tolerance| case("blocked light", height, BlockedLight::at(height).scene(), tolerance, 8);
    let tubes = |length: f64, rho: f64, tolerance| {
        case("tube", format!("{length}, ρ = {rho}"), tube(length, rho), tolerance, 8)
    };
    let boxed = |side: f64, rho: f64, tolerance| {
        case("box in cube", format!("{side}, ρ = {rho}"), lit_box(side, rho), tolerance, 8)
    };
    let crowd = |boxes: u32, seed, tolerance, grid| {
        case("crowded room", format!("{boxes} boxes"), crowded_room(boxes, seed), tolerance, grid)
    };
    let painted = |factor: f64, tolerance| -> Result<Case, Box<dyn Error>> {
        Ok(case("Cornell box", format!("× {factor}"), with_reflectance(&cornell()?, factor), tolerance, 8))
    };
    let town = |blocks, panels, seed, tolerance, grid| {
        let scene = city(blocks, panels, seed);
        case("city", format!("{} facets", scene.surfaces.len()), scene, tolerance, grid)
    };
    if profile == Profile::Tiny {
        let grey = case("rooms", "grey", rooms::grey_room([1.0; 3]), 0.03, 4);
        return Ok(vec![hinge(100.0, 0.4, 0.03), blocked(0.4, 0.03), grey]);
    }
    let mut all = vec![
        hinge(50.0, 0.4, 0.01),
        blocked(0.35, 0.02),
        tubes(1.6, 0.65, 0.01),
        boxed(0.32, 0.5, 0.01),
        painted(0.75, 0.01)?,
        crowd(3, 12, 0.02, 8),
        case("rooms", "grey", rooms::grey_room([1.0, 1.0, 1.2]), 0.01, 8),
        case("furnace", "empty", furnace::room([2.0, 2.0, 2.5], 0.65, 1.0), 0.02, 8),
    ];
    if profile == Profile::Quick {
        return Ok(all);
    }
    all.extend([
        hinge(95.0, 0.7, 0.005),
        hinge(125.0, 0.45, 0.02),
        blocked(0.12, 0.01),
        blocked(0.75, 0.005),
        tubes(2.2, 0.75, 0.02),
        tubes(3.8, 0.55, 0.02),
        tubes(2.8, 0.88, 0.03),
        boxed(0.55, 0.65, 0.02),
        boxed(0.48, 0.32, 0.005),
        painted(1.05, 0.02)?,
        painted(0.55, 0.03)?,
        crowd(0, 12, 0.02, 8),
        crowd(1, 12, 0.01, 8),
        crowd(6, 13, 0.03, 4),
        crowd(12, 12, 0.02, 4),
        crowd(24, 13, 0.03, 4),
        crowd(48, 12, 0.03, 2),
        crowd(128, 13, 0.03, 1),
        crowd(256, 12, 0.03, 1),
        town(1, 1, 13, 0.02, 4),
        town(1, 3, 14, 0.02, 2),
        town(2, 1, 15, 0.01, 4),
        case("furnace", "furnished", furnace::furnished(0.35, 0.65, 1.0), 0.01, 8),
        case("rooms", "two, one lit", rooms::two_rooms([true, false]), 0.02, 8),
        case("rooms", "black floor", rooms::black_floor(), 0.01, 8),
        case("random room", 21, random_room(21), 0.01, 8),
        case("random room", 22, random_room(22), 0.02, 8),
        case("random room", 23, random_room(23), 0.005, 8),
    ]);
    Ok(all)
}

/// The reference of a case.
fn reference(context: &Context, case: &Case) -> Result<Truth, Box<dyn Error>> {
    let Case { name, scene, grid, .. } = case;
    let blocking = Occluders::blocking(scene).len();
    let few = context.profile().pick(400.0, 2500.0, 5000.0);
    let edge = |most: f64| (scene.area() / most).sqrt();
    let key: String = name.chars().map(|c| if c.is_ascii_alphanumeric() || c == '.' { c } else { '-' }).collect();
    // Members of a family may have the same name.
    let scene_key = fingerprint(scene);
    kept(context, &format!("choice-{key}-{grid}-{few}-{scene_key:016x}"), || match blocking {
        0..=FEW => nested_pairs_truth(scene, edge(few), *grid),
        _ => nested_rays_truth(scene, edge(2.0 * few), 4096, *grid),
    })
}

/// A run of a candidate and how long it took.
fn timed<'a>(
    candidate: &Candidate,
    scene: &'a Scene,
    target: &Target,
    most: f64,
) -> Result<(Reached<'a>, f64), Box<dyn Error>> {
    let clock = Instant::now();
    // The next mesh takes as long as the last one at least, or four times as long.
    let (mut last, longer) = (0.0, if candidate.refine == Refine::Uniform { 4.0 } else { 1.0 });
    let reached = candidate.run(scene, target, &mut || {
        let now = clock.elapsed().as_secs_f64();
        now + longer * (now - std::mem::replace(&mut last, now)) < most
    })?;
    Ok((reached, clock.elapsed().as_secs_f64()))
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// What was measured of one candidate.
struct Tried {
    times: Vec<f64>,
    met: bool,
    estimate: f64,
    error: f64,
    stored: u64,
    elements: usize,
    cost: radiosity_core::Cost,
}

/// Records all candidates of a case and the chosen one.
fn measure(context: &mut Context, case: &Case) -> Result<(), Box<dyn Error>> {
    let truth = reference(context, case)?;
    let turns = context.profile().pick(1, 3, 5);
    let wanted = Wanted { report_grid: case.grid, ..Wanted::tolerance(case.tolerance) };
    let constants = Constants::default();
    // What is allocated first is not what is measured.
    let choice = Choice::new(&case.scene, &wanted, &constants)?;
    let limited = context.profile() != Profile::Tiny;
    // Of those that met the tolerance against the reference, and of all that thought so.
    let (mut best, mut thought) = (f64::INFINITY, f64::INFINITY);
    let mut tried: Vec<Option<Tried>> = choice.ranking.iter().map(|_| None).collect();
    let mut chosen_times = Vec::new();
    let begun = Instant::now();
    for turn in 0..turns {
        if limited && turn >= LEAST_TURNS && begun.elapsed().as_secs_f64() > PATIENCE {
            break;
        }
        // The chosen one with its choice, as a user would run it.
        let clock = Instant::now();
        let again = Choice::new(&case.scene, &wanted, &constants)?;
        again.chosen().candidate.run(&case.scene, &again.target, &mut || true)?;
        chosen_times.push(clock.elapsed().as_secs_f64());
        for (ranked, tried) in choice.ranking.iter().zip(&mut tried) {
            let fastest = if best.is_finite() { best } else { thought };
            if tried.as_ref().is_some_and(|t: &Tried| !t.met || t.times[0] > AGAIN * fastest) {
                continue;
            }
            // What is predicted to be that slow is not begun; a first mesh is not cut off.
            let most = if limited { CUT_OFF * fastest } else { f64::INFINITY };
            if turn == 0 && ranked.expected.seconds > most {
                continue;
            }
            let (reached, seconds) = timed(&ranked.candidate, &case.scene, &choice.target, most)?;
            let entry = match tried {
                Some(known) => known,
                None => {
                    let run = &reached.run;
                    let grid = GridValues::means(&run.geometry, &run.solution.irradiance, case.grid)?;
                    tried.insert(Tried {
                        times: Vec::new(),
                        met: reached.met,
                        estimate: reached.steps.estimate(),
                        error: grid.error(&truth.grid).rms,
                        stored: run.stored_bytes,
                        elements: run.geometry.elements().len(),
                        cost: reached.cost,
                    })
                }
            };
            entry.times.push(seconds);
            if entry.met {
                thought = thought.min(seconds);
            }
            if entry.met && entry.error <= case.tolerance {
                best = best.min(seconds);
            }
        }
    }
    for (rank, (ranked, tried)) in choice.ranking.iter().zip(tried).enumerate() {
        let Some(mut tried) = tried else { continue };
        let middle = median(&mut tried.times);
        let record = counts(Record::new(format!("{}/{}", case.name, ranked.candidate.name)), &tried.cost)
            .text("family", case.family)
            .text("scene", &case.name)
            .float("tolerance", case.tolerance)
            .int("report_grid", i64::from(case.grid))
            .text("candidate", ranked.candidate.name)
            .int("rank", rank + 1)
            .text("outcome", if tried.met { "converged" } else { "time limit" })
            .int("elements", tried.elements)
            .int("predicted_elements", ranked.expected.elements)
            .int("stored_bytes", tried.stored)
            .int("predicted_bytes", ranked.expected.stored_bytes)
            .float("estimate", tried.estimate)
            .float("error", tried.error)
            .float("reference_error", truth.error)
            .float("predicted_seconds", ranked.expected.seconds)
            .repetitions("time", &tried.times)
            .seconds("time_of_candidate", middle);
        let record = if rank == 0 {
            record.seconds("choice_and_run", median(&mut chosen_times)).seconds("choice", choice.time.as_secs_f64())
        } else {
            record
        };
        context.record(record);
    }
    Ok(())
}

/// What came of one case.
struct Came {
    name: String,
    regret: f64,
    /// Measured over predicted time and memory of form factors, and the error over the tolerance, of the chosen one.
    time: f64,
    memory: f64,
    error: f64,
    best: String,
    /// Whether a candidate met the tolerance against the reference.
    possible: bool,
}

fn came(tables: &Tables) -> Vec<Came> {
    let of_case = |(name, rows): (String, Vec<Row<'_>>)| {
        let chosen = *rows.iter().find(|r| r.int("rank") == Some(1))?;
        let there = |r: &&Row<'_>| r.text("outcome") == "converged" && r.number("error") <= r.number("tolerance");
        let time = |r: &Row<'_>| r.seconds("time_of_candidate");
        let fastest =
            |is: &dyn Fn(&&Row<'_>) -> bool| rows.iter().filter(is).min_by(|a, b| time(a).total_cmp(&time(b)));
        // Where none came to the tolerance against the reference, the fastest by its own estimate.
        let best = fastest(&there).or_else(|| fastest(&|r| r.text("outcome") == "converged"))?;
        Some(Came {
            name,
            regret: chosen.seconds("choice_and_run") / time(best),
            time: time(&chosen) / chosen.number("predicted_seconds"),
            memory: chosen.number("stored_bytes") / chosen.number("predicted_bytes"),
            error: chosen.number("error") / chosen.number("tolerance"),
            best: best.text("candidate").to_owned(),
            possible: there(&best),
        })
    };
    group_by(tables.rows(), "scene").into_iter().filter_map(of_case).collect()
}

impl Experiment for StrategyChoice {
    fn name(&self) -> &'static str {
        "12-choice"
    }

    fn question(&self) -> &str {
        "How much longer than the best strategy in hindsight does the chosen one take to the tolerance, and do predictions hold?"
    }

    fn expects(&self) -> &str {
        "Counts are known beforehand, so that time is predicted to the spread of the machine where the number of refinements is; a wrong choice costs no more than candidates are apart."
    }

    fn settings(&self, profile: Profile) -> serde_json::Value {
        let names: Vec<_> = cases(profile).map_or_else(
            |_| Vec::new(),
            |all| all.iter().map(|c| serde_json::json!([c.name, c.tolerance, c.grid])).collect(),
        );
        serde_json::json!({ "scenes": names, "cut_off": CUT_OFF, "repeated_up_to": AGAIN, "turns": profile.pick(1, 3, 5), "turns_at_least": LEAST_TURNS, "patience": PATIENCE, "seed": 1 })
    }

    fn run(&self, context: &mut Context) -> Result<(), Box<dyn Error>> {
        let all = cases(context.profile())?;
        context.begin(all.len());
        for case in &all {
            measure(context, case)?;
            context.tick(&case.name);
        }
        Ok(())
    }

    fn plots(&self, tables: &Tables) -> Vec<Figure> {
        let all = came(tables);
        let point = |(k, came): (usize, &Came)| Point { x: (k + 1) as f64, y: came.regret, quality: Quality::Good };
        let regrets = Series::new("chosen", "chosen").points(all.iter().enumerate().map(point)).scatter();
        let best = Panel::new(Axis::linear("scene, by number", ""), Axis::log("time over that of the best", ""))
            .title("Regret, the choice included")
            .level(1.15, "1.15")
            .level(2.0, "2")
            .series(regrets);
        let against = |chosen: bool, label: &str| {
            let rows = tables.select(|r| (r.int("rank") == Some(1)) == chosen && r.text("outcome") == "converged");
            let points = rows.into_iter().map(|r| Point {
                x: r.number("predicted_seconds"),
                y: r.seconds("time_of_candidate"),
                quality: Quality::Good,
            });
            Series::new(label, label).points(points).scatter()
        };
        let times = Panel::new(Axis::log("predicted time", "s"), Axis::log("measured time", "s"))
            .title("Predicted and measured")
            .series(against(false, "other candidates"))
            .series(against(true, "chosen"))
            .diagonal("as predicted");
        vec![
            Figure::new("regret", "Time of the chosen strategy over that of the best in hindsight").panel(best),
            Figure::new("prediction", "Predicted against measured time").panel(times),
        ]
    }

    fn reading(&self, tables: &Tables) -> Vec<String> {
        let all = came(tables);
        if all.is_empty() {
            return Vec::new();
        }
        let mut regrets: Vec<f64> = all.iter().map(|c| c.regret).collect();
        let middle = median(&mut regrets);
        let worst = all.iter().max_by(|a, b| a.regret.total_cmp(&b.regret)).expect("there are cases");
        let share = |is: &dyn Fn(&Came) -> bool| {
            numbers::percent(all.iter().filter(|c| is(c)).count() as f64 / all.len() as f64)
        };
        let within = |ratio: f64, factor: f64| ratio <= factor && ratio >= factor.recip();
        let missed = all.iter().map(|c| c.error).fold(0.0, f64::max);
        let of_all = tables.select(|r| r.text("outcome") == "converged");
        let of_all_in_time = of_all
            .iter()
            .filter(|r| within(r.seconds("time_of_candidate") / r.number("predicted_seconds"), 2.0))
            .count();
        vec![
            format!(
                "In {} scenes the chosen strategy with its choice takes {middle:.2} times as long as the best in hindsight (median), {:.2} times at worst ({}, where '{}' is best).",
                all.len(),
                worst.regret,
                worst.name,
                worst.best
            ),
            format!(
                "Times of chosen strategies are predicted within a factor of 2 in {} of the scenes (of all {} candidates that came to the tolerance: {}), memory of form factors within 10 % in {}.",
                share(&|c| within(c.time, 2.0)),
                of_all.len(),
                numbers::percent(of_all_in_time as f64 / of_all.len().max(1) as f64),
                share(&|c| (c.memory - 1.0).abs() <= 0.1),
            ),
            format!(
                "The error asked for is met against the reference in {}; the largest is {missed:.2} times the tolerance. In {} of {} scenes no candidate met it, and the best is the fastest that thought so.",
                share(&|c| c.error <= 1.0),
                all.iter().filter(|c| !c.possible).count(),
                all.len(),
            ),
        ]
    }
}
