//! Error at points against elements and against time, on uniform and on adaptive meshes: a part of experiment 02.
//!
//! The piecewise constant solution as it is seen, on K × K points of every face of the Cornell box, against direct light that is exact at each point
//! and finely sampled indirect light. Uniform meshes by exact pairs and by rows of rays; adaptive ones by the same estimators, elements cut by
//! estimate, by gradient and at discontinuities. The same solutions are also compared as they are shaded, linear inside elements. Constants on elements are what all are made of, so that a quadtree cut where the true deviation is
//! largest, with the true means, bounds what cutting can gain.

use std::collections::BinaryHeap;
use std::error::Error;

use radiosity::{
    Adaptive, Criterion, Geometry, Goal, GridValues, LinearRadiosity, Method, Shape, Store, Strategy, run, run_adaptive,
};
use radiosity_core::{BandValues, Cost};
use radiosity_experiments::{Profile, Record, Row, SeriesOfRows, Tables, group_by};
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::Subdivision;
use radiosity_plot::{Axis, Figure, Panel, Series, numbers};

use crate::common::{GRID, counts, described, value};
use crate::truth::{Fineness, Truth, points_truth};

/// Name of the series.
pub const POINTS: &str = "at points";
/// Of both adaptive series that the readings compare.
const BY_ESTIMATE: &str = "adaptive by estimate";
/// Quadtrees that know the truth.
const BEST: &str = "best quadtree";
/// Columns of errors at points: of piecewise constant irradiance, and of the same made linear inside elements.
const CONSTANT: &str = "error_points";
const LINEAR: &str = "error_points_linear";
/// Error at which elements and times are compared: the first that both reach.
const COMPARED: [f64; 3] = [0.02, 0.03, 0.06];

/// Points along an edge of a face.
fn points(profile: Profile) -> u32 {
    profile.pick(16, 32, 128)
}

/// The reference at points.
pub fn truth(scene: &Scene, profile: Profile) -> Result<Truth, Box<dyn Error>> {
    let [elements, patches, rays, segments, gathered] =
        profile.pick([8, 4, 64, 16, 64], [8, 8, 256, 64, 256], [32, 16, 2048, 256, 2048]);
    points_truth(scene, Fineness::uniform(elements, patches, rays, segments), points(profile), gathered)
}

/// The error of irradiance that is linear inside elements, at the points of the reference.
fn linear_error(geometry: &Geometry<'_>, irradiance: &BandValues, truth: &Truth, profile: Profile) -> f64 {
    let linear = LinearRadiosity::new(geometry, irradiance);
    GridValues::linear_points(geometry, linear.irradiance(), points(profile)).error(&truth.grid).rms
}

/// The error of piecewise constant irradiance at the points of the reference.
pub fn error(geometry: &Geometry<'_>, irradiance: &BandValues, truth: &Truth, profile: Profile) -> f64 {
    GridValues::points(geometry, irradiance, points(profile)).error(&truth.grid).rms
}

/// A mesh, and what is computed on it.
pub struct Case {
    /// What is plotted as one line.
    line: String,
    setting: String,
    method: Method,
    mesh: Mesh,
}

enum Mesh {
    Uniform(u32),
    Adaptive(Adaptive),
}

/// All cases of a profile.
pub fn cases(profile: Profile) -> Vec<Case> {
    let pairs = Method::exact(1e-6, 1e-4);
    let rays = |rays: u32| Method::RaysAndEmitters { rays };
    let mut all = Vec::new();
    let mut uniform = |line: &str, method: Method, cells: Vec<u32>| {
        let case = |k: u32| Case { line: line.to_owned(), setting: k.to_string(), method, mesh: Mesh::Uniform(k) };
        all.extend(cells.into_iter().map(case));
    };
    uniform("uniform, pairs", pairs, profile.pick(vec![2], vec![4, 8], vec![8, 16, 24, 32]));
    uniform("uniform, 256 rays", rays(256), profile.pick(vec![4], vec![8, 16], vec![16, 24, 32, 48, 64]));
    uniform("uniform, 512 rays", rays(512), profile.pick(vec![], vec![], vec![32, 48, 56]));
    let mut adaptive = |line: String, method: Method, setting: String, settings: Adaptive| {
        all.push(Case { line, setting, method, mesh: Mesh::Adaptive(settings) });
    };
    for (name, method, tolerances) in [
        ("pairs", pairs, profile.pick(vec![], vec![0.1], vec![0.1, 0.06, 0.031])),
        ("rays", rays(256), profile.pick(vec![0.2], vec![0.1, 0.06], vec![0.1, 0.06, 0.035, 0.025, 0.02])),
    ] {
        for tolerance in tolerances {
            let settings = Adaptive::new(Goal::Points, tolerance);
            adaptive(format!("{BY_ESTIMATE}, {name}"), method, tolerance.to_string(), settings);
        }
    }
    // Others go on until nothing meets them, or to a tolerance that they rarely reach.
    let plain = Adaptive::new(Goal::Points, 0.015);
    for share in profile.pick(vec![0.5], vec![0.4], vec![0.4, 0.2, 0.1]) {
        let settings = Adaptive { criterion: Criterion::Gradient(share), ..plain.clone() };
        adaptive("adaptive by gradient, rays".to_owned(), rays(256), share.to_string(), settings);
    }
    for most_level in profile.pick(vec![1], vec![2], vec![1, 2, 3, 4]) {
        let settings = Adaptive { criterion: Criterion::Discontinuities, most_level, ..plain.clone() };
        adaptive("adaptive at discontinuities, rays".to_owned(), rays(256), most_level.to_string(), settings);
    }
    all
}

/// Elements, and their error, of quadtrees over the points that know the truth: the node whose points deviate most from their mean is cut next, from
/// 4 × 4 a face on, and every node has its true mean. Points inside solids, where it is dark, count for nothing, so that lines of contact cost nothing.
fn best_quadtrees(truth: &GridValues, profile: Profile) -> Vec<(usize, f64)> {
    let (k, bands) = (points(profile), truth.values.count());
    let mut points_of: Vec<Vec<Option<usize>>> = Vec::new();
    for (c, &(i, j)) in truth.indices.iter().enumerate() {
        let lit = (0..bands).any(|band| truth.values.band(band)[c] > 0.0);
        points_of.resize(points_of.len().max(truth.surfaces[c] as usize + 1), vec![None; (k * k) as usize]);
        points_of[truth.surfaces[c] as usize][(j * k + i) as usize] = lit.then_some(c);
    }
    // A node of n × n points from (i, j) on, by its squares; those of what is not negative order like their bits.
    let node = |s: usize, n: u32, i: u32, j: u32| {
        let inside = (j..j + n).flat_map(|y| (i..i + n).map(move |x| (y * k + x) as usize));
        let own: Vec<usize> = inside.filter_map(|at| points_of[s][at]).collect();
        let area: f64 = own.iter().map(|&c| truth.areas[c]).sum();
        let of_band = |band: usize| {
            let value = |c: usize| truth.values.band(band)[c];
            let mean = own.iter().map(|&c| truth.areas[c] * value(c)).sum::<f64>() / area;
            own.iter().map(|&c| truth.areas[c] * (value(c) - mean).powi(2)).sum::<f64>()
        };
        let square: f64 = if own.is_empty() { 0.0 } else { (0..bands).map(of_band).sum() };
        (square.to_bits(), s, n, i, j)
    };
    let n = k / 4;
    let places = |s: usize| (0..4).flat_map(move |j| (0..4).map(move |i| (s, n, i * n, j * n)));
    let first = (0..points_of.len()).flat_map(places);
    let mut heap: BinaryHeap<_> = first.map(|(s, n, i, j)| node(s, n, i, j)).collect();
    let mut sum: f64 = heap.iter().map(|node| f64::from_bits(node.0)).sum();
    let whole = bands as f64 * truth.areas.iter().sum::<f64>() * truth.level().powi(2);
    let mut trees = Vec::new();
    for error in profile.pick(vec![0.3], vec![0.1, 0.06], vec![0.1, 0.06, 0.04, 0.03, 0.02, 0.015]) {
        while sum > error * error * whole {
            let Some((square, s, n, i, j)) = heap.pop().filter(|node| node.2 > 1) else { return trees };
            let half = n / 2;
            let corners = [(i, j), (i + half, j), (i, j + half), (i + half, j + half)];
            let children = corners.map(|(i, j)| node(s, half, i, j));
            sum += children.iter().map(|child| f64::from_bits(child.0)).sum::<f64>() - f64::from_bits(square);
            heap.extend(children);
        }
        trees.push((heap.len(), (sum / whole).max(0.0).sqrt()));
    }
    trees
}

/// The quadtrees that know the truth: what cutting can gain at most.
pub fn bounds(at_points: &Truth, profile: Profile) -> Vec<Record> {
    let record = |(elements, error): (usize, f64)| {
        Record::new(format!("Cornell box/{POINTS}/{BEST}/{elements}"))
            .text("scene", "Cornell box")
            .text("series", POINTS)
            .text("line", BEST)
            .int("elements", elements)
            .float(CONSTANT, error)
    };
    best_quadtrees(&at_points.grid, profile).into_iter().map(record).collect()
}

/// What a case comes to.
struct Done<'a> {
    geometry: Geometry<'a>,
    irradiance: BandValues,
    cost: Cost,
    seconds: f64,
    rows: [usize; 2],
}

impl Case {
    /// Its name among the runs.
    pub fn key(&self) -> String {
        format!("Cornell box/{POINTS}/{}/{}", self.line, self.setting)
    }

    fn strategy(&self) -> Strategy {
        let plain = Strategy { unshot: 1e-3, verify: false, ..Strategy::new(Subdivision::Uniform(1), self.method) };
        let pairwise = matches!(self.method, Method::Analytic { .. });
        let (shape, store, solver) = match self.mesh {
            Mesh::Adaptive(_) => (Shape::ElementsToPatches, Store::Dense, "gauss-seidel"),
            Mesh::Uniform(_) if pairwise => (Shape::Full, Store::PackedSingle, "cg"),
            Mesh::Uniform(_) => (Shape::Full, Store::Sparse, "jacobi"),
        };
        Strategy { shape, store, solver: solver.to_owned(), ..plain }
    }

    fn solve<'a>(&self, scene: &'a Scene) -> Result<Done<'a>, Box<dyn Error>> {
        let mut strategy = self.strategy();
        match &self.mesh {
            Mesh::Uniform(k) => {
                strategy.mesh.elements = Subdivision::Uniform(*k);
                let run = run(scene, &strategy, &mut ())?;
                let (cost, seconds, rows) = (run.cost(), run.seconds(), [run.geometry.elements().len(), 0]);
                Ok(Done { geometry: run.geometry, irradiance: run.solution.irradiance, cost, seconds, rows })
            }
            Mesh::Adaptive(settings) => {
                let done = run_adaptive(scene, &strategy, settings)?;
                let run = done.run;
                let (cost, seconds) = (run.cost(), run.seconds() + done.estimating.as_secs_f64());
                let new = done.rounds.iter().map(|round| round.new_elements).sum();
                let rows = [new, done.rounds.iter().map(|round| round.rows_again).sum()];
                Ok(Done { geometry: run.geometry, irradiance: run.solution.irradiance, cost, seconds, rows })
            }
        }
    }

    /// Solves and compares: at points, and over cells of the report grid.
    pub fn record(
        &self,
        scene: &Scene,
        (at_points, over_cells): (&Truth, &Truth),
        profile: Profile,
    ) -> Result<Record, Box<dyn Error>> {
        let done = self.solve(scene)?;
        let mut times = vec![done.seconds];
        // A short run is repeated: the smallest of several repeats best on a shared machine.
        for _ in 0..if done.seconds < 1.0 { 2 } else { 0 } {
            times.push(self.solve(scene)?.seconds);
        }
        let error = error(&done.geometry, &done.irradiance, at_points, profile);
        let linear = linear_error(&done.geometry, &done.irradiance, at_points, profile);
        let cells = GridValues::means(&done.geometry, &done.irradiance, GRID)?.error(&over_cells.grid);
        let record = counts(described(self.key(), &self.strategy()), &done.cost)
            .text("scene", "Cornell box")
            .text("series", POINTS)
            .text("line", &self.line)
            .int("elements", done.geometry.elements().len())
            .int("patches", done.geometry.patches().len())
            .int("rows_new", done.rows[0])
            .int("rows_recomputed", done.rows[1])
            .float(CONSTANT, error)
            .float(LINEAR, linear)
            .float("error", cells.rms)
            .float("worst_cell", cells.worst)
            .float("reference_error", at_points.error);
        Ok(record.repetitions("time", &times))
    }
}

/// Error at points against elements, and against time: as computed, and shaded linearly.
pub fn figures(tables: &Tables) -> [Figure; 2] {
    let constant = Figure::new("points", "Error at points: uniform and adaptive meshes").caption(
        "Piecewise constant irradiance; one mark a mesh. Pairs are exact, rays a row cast anew where their noise is too much.",
    );
    let linear = Figure::new("points-linear", "Error at points: the same solutions, linear inside elements")
        .caption("One mark a mesh. What adaptive runs are cut by is the error of constants.");
    [(constant, CONSTANT), (linear, LINEAR)].map(|(figure, measure)| {
        figure.panel(panel(tables, measure, "elements", "elements m")).panel(panel(tables, measure, "time", "time"))
    })
}

fn panel(tables: &Tables, measure: &str, x: &str, title: &str) -> Panel {
    let line = |(name, rows): (&str, Vec<Row<'_>>)| {
        Series::new(name, style(name)).rows(rows, |r| (value(r, x), r.number(measure)))
    };
    // What knows the truth takes no time, and has means only.
    let known = |r: &Row<'_>| value(r, x).is_finite() && r.number(measure).is_finite();
    let rows = tables.select(|r| r.text("series") == POINTS && known(r));
    let lines: Vec<_> = group_by(rows, "line").into_iter().map(|(name, rows)| line((&*name, rows))).collect();
    let unit = if x == "time" { "s" } else { "" };
    Panel::new(Axis::log(title, unit), Axis::log("error at points", "share of the mean"))
        .title("Cornell box")
        .all_series(lines)
}

/// Whose colour a line has.
fn style(line: &str) -> &str {
    match line {
        "uniform, pairs" => "analytic",
        "uniform, 256 rays" => "rays+emitters",
        "uniform, 512 rays" => "ray-cast",
        "adaptive by estimate, pairs" => "two-level",
        "adaptive by estimate, rays" => "adaptive",
        other => other,
    }
}

/// What a line needs of `column` for an error in some measure: on the straight line in log–log between the two meshes around it.
fn needed(tables: &Tables, line: &str, column: &str, (measure, error): (&str, f64)) -> Option<f64> {
    let rows = tables.select(|r| r.text("series") == POINTS && r.text("line") == line);
    let mut marks: Vec<(f64, f64)> = rows.iter().map(|r| (r.number(measure), value(r, column))).collect();
    marks.sort_by(|a, b| b.0.total_cmp(&a.0));
    let pair = marks.windows(2).find(|pair| pair[0].0 >= error && pair[1].0 <= error)?;
    let [(e0, x0), (e1, x1)] = [pair[0], pair[1]];
    Some(x0 * (x1 / x0).powf((error / e0).ln() / (e1 / e0).ln()))
}

/// Ratios at one error, from the tables alone.
pub fn reading(tables: &Tables) -> Vec<String> {
    let sentence = |(of_uniform, of_adaptive, shading): (&str, &str, &str), (uniform, kind): (&str, &str)| {
        let adaptive = format!("{BY_ESTIMATE}, {kind}");
        let both = |column: &str, error: f64| {
            let m = needed(tables, uniform, column, (of_uniform, error))?;
            Some((m, needed(tables, &adaptive, column, (of_adaptive, error))?))
        };
        COMPARED.into_iter().find_map(|error| {
            let ((m, own), (time, own_time)) = (both("elements", error)?, both("time", error)?);
            Some(format!(
                "At an error of {} at points{shading}, a mesh cut by estimate ({kind}) takes {} elements instead of {} ({uniform}), a share of {}, \
                 and {} instead of {}, a share of {}.",
                numbers::percent(error),
                numbers::grouped(own.round() as i64),
                numbers::grouped(m.round() as i64),
                numbers::significant(own / m, 2),
                numbers::seconds(own_time),
                numbers::seconds(time),
                numbers::significant(own_time / time, 2),
            ))
        })
    };
    let pairs = [("uniform, pairs", "pairs"), ("uniform, 256 rays", "rays"), ("uniform, 512 rays", "rays")];
    let shadings = [
        (CONSTANT, CONSTANT, ""),
        (CONSTANT, LINEAR, ", shaded linearly where cut and in one value an element where uniform"),
        (LINEAR, LINEAR, ", shaded linearly"),
    ];
    let all = shadings.into_iter().flat_map(|shading| pairs.map(|pair| (shading, pair)));
    let mut reading: Vec<String> = all.filter_map(|(shading, pair)| sentence(shading, pair)).collect();
    let best = |error: f64| Some((error, needed(tables, BEST, "elements", (CONSTANT, error))?));
    let best = COMPARED.into_iter().find_map(best);
    reading.extend(best.map(|(error, elements)| {
        format!(
            "A quadtree cut where the truth deviates most from its means takes {} elements at {}.",
            numbers::grouped(elements.round() as i64),
            numbers::percent(error)
        )
    }));
    reading
}
