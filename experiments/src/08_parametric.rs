//! The classical comparison, one difficulty a family.
//!
//! Question: which strategy reaches 1 % first, and in what memory, as one difficulty grows? Theory: a hinge that closes makes the
//! irradiance singular along its edge, so constant elements must shrink there; a blocker that nears the floor hardens its
//! shadow, whose edge uniform elements resolve like h^½; a long or bright tube takes more bounces, which cost products and no form
//! factors; more boxes cost more blockers and more elements. Measured in four families with one parameter each, following Willmott and
//! Heckbert (1997): every strategy refines until the rms error is at most 1 %, or until its next mesh is predicted to take more elements or
//! more counted work than the budget; no clock decides. References: the hinge and the blocked light exactly, at 64 × 64 points, where
//! blockiness counts; the tube by pairs on a finer mesh and the crowded room by rays on a finer mesh, over a report grid. Read: a curve that
//! rises suffers from that family's difficulty; a hollow mark is the best that a strategy reached without meeting 1 %. Not shown:
//! rooms of more than one light.

use std::error::Error;

use radiosity::{Adaptive, DirectLight, Geometry, Goal, GridValues, Method, Run, Shape, Store, Strategy, run_adaptive};
use radiosity_core::{BandValues, Cost};
use radiosity_experiments::{Context, Experiment, Profile, Record, Row, SeriesOfRows, Tables, group_by};
use radiosity_gallery::boxes::{empty_box, material};
use radiosity_gallery::{BlockedLight, Hinge, crowded_room};
use radiosity_geometry::mesh::Subdivision;
use radiosity_geometry::{Occluders, Scene};
use radiosity_plot::numbers;
use radiosity_plot::{Axis, Figure, Panel, Series};
use serde::Serialize;

use crate::common::{GRID, counts, kept, left_out, value};
use crate::truth::{nested_rays_truth, pairs_truth};

/// The experiment.
pub struct Parametric;

/// The error asked for.
const TARGET: f64 = 0.01;

/// One member of a family.
struct Member {
    family: &'static str,
    parameter: f64,
    scene: Scene,
    truth: GridValues,
    reference_error: f64,
    measure: Measure,
    /// Longest edge of an element on the coarsest mesh.
    length: f64,
    budget: Budget,
}

/// Where a strategy stops that has not come to the error asked for.
#[derive(Clone, Copy, Debug, Serialize)]
struct Budget {
    /// Halvings of the coarsest elements.
    halvings: u32,
    /// Elements of the next mesh, see [`next_elements`].
    elements: usize,
    /// Work of the next mesh, see [`next_work`].
    work: u64,
}

/// Where errors are measured.
#[derive(Clone, Copy)]
enum Measure {
    /// At points of surface 0, whose irradiance is known exactly.
    Points,
    /// Over so many cells along an edge of every face.
    Cells(u32),
}

impl Measure {
    /// Irradiance of the exposed elements where it is measured.
    fn of(self, geometry: &Geometry<'_>, irradiance: &BandValues) -> Result<GridValues, Box<dyn Error>> {
        Ok(match self {
            Self::Points => GridValues::points(geometry, irradiance, POINTS).on(&[0]),
            Self::Cells(cells) => GridValues::means(geometry, irradiance, cells)?,
        })
    }
}

/// Points along an edge of surface 0.
const POINTS: u32 = 64;

/// Parameters of the families: angle in degrees, height of the blocker, length of the tube, its reflectance, boxes.
fn parameters(profile: Profile) -> [Vec<f64>; 5] {
    match profile {
        Profile::Tiny => [vec![60.0], vec![0.5], vec![2.0], vec![], vec![1.0]],
        Profile::Quick => [vec![30.0, 90.0, 150.0], vec![0.1, 0.8], vec![1.0, 8.0], vec![0.9], vec![0.0, 16.0]],
        Profile::Full => [
            vec![30.0, 60.0, 90.0, 120.0, 150.0],
            vec![0.05, 0.1, 0.2, 0.4, 0.8],
            vec![1.0, 2.0, 4.0, 8.0, 16.0],
            vec![0.3, 0.5, 0.7, 0.9, 0.97],
            vec![0.0, 4.0, 16.0, 64.0, 256.0],
        ],
    }
}

fn budget(profile: Profile) -> Budget {
    let (halvings, elements, work) = profile.pick((2, 500, 5_000_000), (5, 4_000, 50_000_000), (6, 8_000, 200_000_000));
    Budget { halvings, elements, work }
}

/// Rooms of hundreds of faces need elements for each of them.
fn room_budget(profile: Profile) -> Budget {
    let budget = budget(profile);
    Budget { elements: profile.pick(1, 1, 3) * budget.elements, ..budget }
}

fn members(context: &Context) -> Result<Vec<Member>, Box<dyn Error>> {
    let profile = context.profile();
    let member = |family, parameter, scene, truth, measure| {
        let budget = budget(profile);
        Member { family, parameter, scene, truth, reference_error: 0.0, measure, length: 0.5, budget }
    };
    let [angles, heights, lengths, reflectances, boxes] = parameters(profile);
    let mut members = Vec::new();
    for angle in angles {
        let case = Hinge { angle: angle.to_radians(), emission: 1.0, reflectance: 0.5 };
        let truth = exact_points(&case.scene(), |u, v| case.irradiance(u, v))?;
        members.push(member("hinge", angle, case.scene(), truth, Measure::Points));
    }
    for height in heights {
        let case = BlockedLight::at(height);
        let truth = exact_points(&case.scene(), |u, v| case.irradiance(u, v))?;
        members.push(member("blocked light", height, case.scene(), truth, Measure::Points));
    }
    let tubes = lengths.into_iter().map(|length| ("tube, length", length, length, 0.7));
    let bright = reflectances.into_iter().map(|rho| ("tube, reflectance", 4.0, rho, rho));
    for (family, length, parameter, rho) in tubes.chain(bright) {
        // The low end is lit and black.
        let mut scene = empty_box([1.0, 1.0, length], material("wall", rho, 0.0));
        scene.materials.push(material("light", 0.0, 1.0));
        scene.surfaces[4].material = 1;
        // So many elements in all, however long the tube.
        let most = profile.pick(400.0, 4_000.0, 8_000.0);
        let truth = pairs_truth(&scene, Subdivision::EdgeLength((scene.area() / most).sqrt()), GRID)?;
        let member = member(family, parameter, scene, truth.grid, Measure::Cells(GRID));
        members.push(Member { reference_error: truth.error, ..member });
    }
    for count in boxes {
        let scene = crowded_room(count as u32, 1);
        let (edge, rays) = profile.pick((0.5, 64), (0.125, 512), (0.05, 2048));
        let truth =
            kept(context, &format!("room-{count}-{edge}-{rays}"), || nested_rays_truth(&scene, edge, rays, ROOM_GRID))?;
        let member = member("crowded room", count, scene, truth.grid, Measure::Cells(ROOM_GRID));
        members.push(Member { reference_error: truth.error, length: 1.0, budget: room_budget(profile), ..member });
    }
    Ok(members)
}

/// Cells of the report grid of the crowded room, along an edge: its faces are many.
const ROOM_GRID: u32 = 4;

/// Exact values at the points of surface 0.
fn exact_points(scene: &Scene, irradiance: impl Fn(f64, f64) -> f64) -> Result<GridValues, Box<dyn Error>> {
    let strategy = Strategy::new(Subdivision::Uniform(1), Method::ANALYTIC);
    let geometry = Geometry::new(scene, &strategy.mesh)?;
    let zeros = BandValues::zeros(1, geometry.elements().len());
    let mut points = Measure::Points.of(&geometry, &zeros)?;
    let centre = |i: u32| (f64::from(i) + 0.5) / f64::from(POINTS);
    let values = points.indices.iter().map(|&(i, j)| irradiance(centre(i), centre(j)));
    points.values = BandValues::single(values.collect());
    Ok(points)
}

/// The strategies that compete, by the form of their elements and patches.
fn contenders() -> [&'static str; 5] {
    ["full", "elements-to-patches", "patches-to-elements", "adaptive", "hierarchical"]
}

/// A contender on its mesh of a level: edges half as long as those of the level before, or half the tolerance.
fn solve<'a>(contender: &str, member: &'a Member, level: u32) -> Result<(Strategy, Run<'a>), Box<dyn Error>> {
    let (scene, part) = (&member.scene, f64::from(1_u32 << level));
    let (elements, patches) = (member.length / part, 2.0 * member.length / part);
    let plain = |method| Strategy { unshot: 1e-4, ..Strategy::new(Subdivision::EdgeLength(elements), method) };
    // Nothing is gained by pairs that are better than the mesh.
    let pairs = match Occluders::blocking(scene).len() {
        0 => Method::sampled(1e-6, 1),
        blocking => Method::analytic_among(blocking),
    };
    let mut strategy = match contender {
        "full" => plain(pairs),
        "elements-to-patches" => Strategy { shape: Shape::ElementsToPatches, ..plain(Method::RAYS_AND_EMITTERS) },
        "patches-to-elements" => {
            let shape = Shape::PatchesToElements;
            Strategy { shape, solver: "shooting".to_owned(), ..plain(Method::Hemicube { resolution: 128 }) }
        }
        "adaptive" => {
            let method = if scene.surfaces.len() > MANY_SURFACES { Method::RAYS_AND_EMITTERS } else { pairs };
            let solver = "gauss-seidel".to_owned();
            let strategy = Strategy { shape: Shape::ElementsToPatches, solver, ..plain(method) };
            let goal = match member.measure {
                Measure::Points => Goal::Points,
                Measure::Cells(cells) => Goal::Cells(cells),
            };
            let tolerance = COARSEST_TOLERANCE / part;
            let cells = Subdivision::EdgeLength(member.length);
            let adaptive = Adaptive { cells, level: 1, most_elements: MOST_ADAPTIVE, ..Adaptive::new(goal, tolerance) };
            return Ok((strategy.clone(), run_adaptive(scene, &strategy, &adaptive)?.run));
        }
        _ => {
            let store = Store::Hierarchical { error: 0.5 * TARGET, direct: DirectLight::WhereFew };
            let method = Method::of_links_among(Occluders::blocking(scene).len());
            Strategy { store, solver: "jacobi".to_owned(), ..plain(method) }
        }
    };
    if strategy.shape != Shape::Full {
        strategy.mesh.patches = Some(Subdivision::EdgeLength(patches));
    }
    let run = radiosity::run(scene, &strategy, &mut ())?;
    Ok((strategy, run))
}

/// About what a contender's next mesh costs, in elements of one that gathers from patches: pairs of all elements count four times.
fn next_elements(contender: &str, elements: usize) -> usize {
    match contender {
        "full" => 16 * elements,
        "adaptive" => 2 * elements,
        _ => 4 * elements,
    }
}

/// About what a contender's next mesh takes, in rays: a form factor of a pair counts one, a partly blocked one a hundred, a pixel of a
/// hemicube a hundredth, and a form factor that near pairs correct in a hemicube's rows four. Rows of rays and links grow like their elements,
/// pairs and entries like their square.
fn next_work(contender: &str, cost: &Cost) -> u64 {
    match contender {
        "full" => 16 * (cost.form_factors + cost.rays + 100 * cost.partial_pairs),
        "hierarchical" => 4 * (cost.form_factors + cost.rays),
        "patches-to-elements" => 64 * cost.form_factors + 4 * cost.hemicube_pixels / 100,
        _ => 4 * cost.rays,
    }
}

/// Surfaces beyond which adaptive runs cast rays.
const MANY_SURFACES: usize = 16;
/// Elements beyond which adaptive runs cut nothing.
const MOST_ADAPTIVE: usize = 10_000;
/// Tolerance of the first adaptive run.
const COARSEST_TOLERANCE: f64 = 0.04;

impl Experiment for Parametric {
    fn name(&self) -> &'static str {
        "08-parametric"
    }

    fn question(&self) -> &str {
        "Which strategy reaches 1 % first, and in what memory, as one difficulty of the scene grows?"
    }

    fn expects(&self) -> &str {
        "A closing hinge and a hardening shadow call for small elements where they are needed; length and reflectance of a tube cost \
         products, not form factors; boxes cost blockers and elements."
    }

    fn settings(&self, profile: Profile) -> serde_json::Value {
        serde_json::json!({
            "parameters": parameters(profile).to_vec(), "budget": budget(profile), "room_budget": room_budget(profile), "target": TARGET, "unshot": 1e-4, "seed": 1
        })
    }

    fn run(&self, context: &mut Context) -> Result<(), Box<dyn Error>> {
        let members = members(context)?;
        context.begin(members.len() * contenders().len());
        for member in &members {
            for contender in contenders() {
                let budget = member.budget;
                for level in 0..=budget.halvings {
                    let (strategy, run) = solve(contender, member, level)?;
                    let error = member.measure.of(&run.geometry, &run.solution.irradiance)?.error(&member.truth);
                    let met = error.rms <= TARGET;
                    let elements = run.geometry.elements().len();
                    let last = met
                        || level == budget.halvings
                        || next_elements(contender, elements) > budget.elements
                        || next_work(contender, &run.cost()) > budget.work;
                    let key = format!("{}/{}/{contender}/{level}", member.family, member.parameter);
                    let record = counts(Record::new(key), &run.cost())
                        .text("family", member.family)
                        .float("parameter", member.parameter)
                        .text("form", contender)
                        .text("method", strategy.method.name())
                        .text("outcome", if met { "converged" } else { "step limit" })
                        .text("last", if last { "yes" } else { "no" })
                        .int("elements", elements)
                        .int("stored_bytes", run.stored_bytes)
                        .float("error", error.rms)
                        .float("worst_cell", error.worst)
                        .float("reference_error", member.reference_error)
                        .seconds("time", run.seconds());
                    let scene = format!("{} {}", member.family, member.parameter);
                    left_out(context, &scene, &strategy, &run.geometry, Some(&run));
                    context.record(record);
                    if last {
                        break;
                    }
                }
                context.tick(format!("{} {}, {contender}", member.family, member.parameter));
            }
        }
        Ok(())
    }

    fn plots(&self, tables: &Tables) -> Vec<Figure> {
        let panel = |family: &str, rows: Vec<Row<'_>>, column: &'static str, label: &str, unit: &str| {
            let series = group_by(rows, "form").into_iter().map(|(form, rows)| {
                Series::new(&*form, &*form).rows(rows, |r| (r.number("parameter"), value(r, column)))
            });
            let of = match family {
                "hinge" => "angle (degrees)",
                "blocked light" => "height of the blocker",
                "tube, length" => "length",
                "tube, reflectance" => "reflectance",
                _ => "boxes",
            };
            let x = if family == "blocked light" || family == "tube, length" {
                Axis::log(of, "")
            } else {
                Axis::linear(of, "")
            };
            Panel::new(x, Axis::log(label, unit)).title(family).all_series(series)
        };
        let figure = |name: &str, title: &str, column: &'static str, label: &str, unit: &str| {
            let last = tables.select_eq("last", "yes");
            let panels =
                group_by(last, "family").into_iter().map(|(family, rows)| panel(&family, rows, column, label, unit));
            Figure::new(name, title)
                .caption("Of the coarsest mesh that meets 1 % rms; hollow where the budget ended before.")
                .panels(panels.collect::<Vec<_>>())
        };
        let errors = group_by(tables.rows(), "family").into_iter().filter_map(|(family, rows)| {
            let hardest = rows.first()?.text("parameter").to_owned();
            let series =
                group_by(rows.into_iter().filter(|r| r.text("parameter") == hardest).collect::<Vec<_>>(), "form");
            let series = series
                .into_iter()
                .map(|(form, rows)| Series::new(&*form, &*form).rows(rows, |r| (r.seconds("time"), r.number("error"))));
            let axes = (Axis::log("time", "s"), Axis::log("error", "share of the mean"));
            Some(Panel::new(axes.0, axes.1).title(format!("{family} {hardest}")).all_series(series))
        });
        vec![
            figure("time", "Time to 1 %", "time", "time", "s"),
            figure("memory", "Memory of form factors at 1 %", "stored_bytes", "memory", "bytes"),
            Figure::new("error-time", "Error against time, one member of each family")
                .caption("One mark a mesh, each with edges half as long as the one before; adaptive: one a tolerance, each half the one before.")
                .panels(errors.collect::<Vec<_>>()),
        ]
    }

    fn reading(&self, tables: &Tables) -> Vec<String> {
        group_by(tables.select_eq("last", "yes"), "family")
            .into_iter()
            .map(|(family, rows)| {
                let members = group_by(rows, "parameter");
                let best = members.iter().map(|(parameter, rows)| {
                    let met = rows.iter().filter(|r| r.text("outcome") == "converged");
                    let first = met.min_by(|a, b| a.seconds("time").total_cmp(&b.seconds("time")));
                    first.map_or_else(
                        || format!("{parameter}: none"),
                        |r| format!("{parameter}: {} in {}", r.text("form"), numbers::seconds(r.seconds("time"))),
                    )
                });
                format!("First at 1 % in the family {family} — {}.", best.collect::<Vec<_>>().join("; "))
            })
            .collect()
    }
}
