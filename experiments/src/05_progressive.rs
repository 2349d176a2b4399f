//! Progressive refinement: pictures while iterating.
//!
//! Question: how soon does shooting the brightest patch give a useful picture, and what do the ambient term and
//! substructuring add? Theory (Cohen, Chen, Wallace, Greenberg 1988): the light sources shoot first, so after as many shots as
//! there are lit patches all direct light is there, with its shadows, and no interreflection; the error then falls
//! with every shot by less; the ambient term lifts the display towards the final level at once; with patches to shoot
//! from, a shot moves more light. Measured on the Cornell box, rows computed when shot and kept, by hemicube as in the
//! course and by the other estimators; error of the displayed irradiance against the exact solution of the same system.
//! Read: error per shot and per second. Not shown: overshooting, several patches a step.

use std::error::Error;
use std::ops::ControlFlow;
use std::time::Duration;

use radiosity::{Geometry, GridValues, Method, Shape, Store, Strategy, assemble};
use radiosity_core::{BandValues, Cost, Direction, Form, Iterate, Observer, Step, StopRule, System, solve};
use radiosity_experiments::{Context, Experiment, Profile, Record, Row, Tables};
use radiosity_geometry::mesh::{MeshSettings, Subdivision};
use radiosity_plot::numbers;
use radiosity_plot::{Axis, Dash, Figure, Panel, Series};
use radiosity_solvers::{Jacobi, Shooting, ambient};

use crate::common::{GRID, cornell, cornell_truth, counts, left_out, picture, picture_side, setting};

/// The experiment.
pub struct Progressive;

fn methods(profile: Profile) -> Vec<Method> {
    vec![
        Method::Hemicube { resolution: profile.pick(16, 128, 256) },
        Method::rays(profile.pick(64, 4096, 16_384)),
        Method::sampled(1e-8, profile.pick(16, 128, 256)),
    ]
}

/// Elements along an edge of a face, and patches where substructured.
fn mesh(profile: Profile) -> (u32, u32) {
    profile.pick((2, 1), (8, 2), (16, 4))
}

fn most_shots(profile: Profile) -> u64 {
    profile.pick(16, 1024, 4096)
}

/// Shots after which a picture is taken.
const PICTURES: [u64; 5] = [1, 2, 8, 64, 512];

/// Keeps the iterates at the steps wanted.
struct Keep {
    steps: Vec<u64>,
    kept: Vec<(u64, Duration, Cost, Iterate)>,
}

impl Observer for Keep {
    fn observe(&mut self, step: &Step<'_>) -> ControlFlow<()> {
        if self.steps.contains(&step.number) {
            self.kept.push((step.number, step.time, step.cost, step.iterate.clone()));
        }
        ControlFlow::Continue(())
    }
}

impl Experiment for Progressive {
    fn name(&self) -> &'static str {
        "05-progressive"
    }

    fn question(&self) -> &str {
        "How soon does shooting the brightest patch give a useful picture, and what do the ambient term and substructuring add?"
    }

    fn expects(&self) -> &str {
        "The lights shoot first: after them all direct light is there, with shadows and without interreflection. The \
         ambient term lifts the display to nearly the final level at once; with patches to shoot from each shot moves more light \
         and fewer rows are computed."
    }

    fn settings(&self, profile: Profile) -> serde_json::Value {
        serde_json::json!({ "methods": format!("{:?}", methods(profile)), "mesh": mesh(profile), "shots": most_shots(profile) })
    }

    fn slack(&self, column: &str) -> f64 {
        // Differences of nearly equal answers: their last digits depend on the processor.
        if column.starts_with("solver_error") || column == "form_factor_error" { 1e-12 } else { 0.0 }
    }

    fn run(&self, context: &mut Context) -> Result<(), Box<dyn Error>> {
        let profile = context.profile();
        let methods = methods(profile);
        context.begin(2 * methods.len());
        let scene = cornell()?;
        let truth = cornell_truth(context, &scene)?;
        let (elements, patches) = mesh(profile);
        for (m, &method) in methods.iter().enumerate() {
            for substructured in [false, true] {
                let settings = MeshSettings {
                    elements: Subdivision::Uniform(elements),
                    patches: substructured.then_some(Subdivision::Uniform(patches)),
                    contacts: true,
                };
                let geometry = Geometry::new(&scene, &settings)?;
                let (shape, form) = match substructured {
                    true => (Shape::PatchesToElements, Form::PatchesToElements),
                    false => (Shape::Full, Form::Full),
                };
                let strategy = Strategy { mesh: settings, shape, ..Strategy::new(settings.elements, method) };
                left_out(context, "Cornell box", &strategy, &geometry, None);
                let (store, _) = assemble(&geometry, method, form, Store::KeepAll, 1)?;
                let (e, rho) = (geometry.emission(), geometry.reflectance());
                let areas = geometry.elements().areas();
                let system = System::substructured(&*store, form, &areas, geometry.parent(), e.view(), rho.view())?;
                let lights = system.patch_means(e.view()).band(0).iter().filter(|&&e| e > 0.0).count() as u64;
                // Geometric steps, the pictures' steps, and the shot after which every light has shot once.
                let mut steps: Vec<u64> =
                    (0..).map(|k| 1.25_f64.powi(k) as u64).take_while(|&s| s <= most_shots(profile)).collect();
                steps.extend(PICTURES);
                steps.extend([0, lights]);
                steps.sort_unstable();
                steps.dedup();
                let mut keep = Keep { steps, kept: Vec::new() };
                let stop = StopRule::unshot(1e-6).steps(most_shots(profile)).unverified();
                let solution = solve(&system, &mut Shooting::default(), &stop, &mut keep)?;

                // The exact solution of the same system, in the direction of its shots.
                let exact = solve(&system, &mut Jacobi::new(Direction::Shoot), &StopRule::unshot(1e-13), &mut ())?;
                let exact = GridValues::means(&geometry, &exact.irradiance, GRID)?;
                let label = if substructured { "patches-to-elements" } else { "full" };
                let key = format!("{}/{label}", method.name());
                for (shot, time, cost, iterate) in &keep.kept {
                    let plain = displayed(&system, iterate, false);
                    let lifted = displayed(&system, iterate, true);
                    let mut line = counts(Record::new(format!("{key}/{shot}")), cost)
                        .text("method", method.name())
                        .text("setting", setting(method))
                        .text("form", label)
                        .int("elements", geometry.elements().len())
                        .int("patches", geometry.patches().len())
                        .int("lights", lights)
                        .int("shots", *shot)
                        .text(
                            "outcome",
                            if *shot == solution.steps { solution.outcome.to_string() } else { "done".to_owned() },
                        );
                    for (name, b) in [("", &plain), ("_ambient", &lifted)] {
                        let grid = GridValues::means(&geometry, &received(&system, b), GRID)?;
                        line = line
                            .float(format!("solver_error{name}"), grid.error(&exact).rms)
                            .float(format!("error{name}"), grid.error(&truth.grid).rms);
                    }
                    context.record(line.seconds("time", time.as_secs_f64()));
                    // Pictures by hemicube, as in the course, without substructuring and with.
                    if m == 0 && (PICTURES.contains(shot) || *shot == lights) {
                        let what = if *shot == lights { " (every light has shot once)" } else { "" };
                        let mesh = if substructured { "patches to elements" } else { "every element shoots" };
                        for (name, caption, b) in [
                            ("plain", "without the ambient term", &plain),
                            ("ambient", "with the ambient term", &lifted),
                        ] {
                            let image = picture(&geometry, b, picture_side(profile))?;
                            let plural = if *shot == 1 { "shot" } else { "shots" };
                            let caption = format!("{shot} {plural}{what}, {mesh}, {caption}");
                            context.picture(
                                &format!("{label}-{shot:04}-{name}"),
                                &caption,
                                image.width,
                                image.height,
                                &image.rgb,
                            )?;
                        }
                    }
                }
                context.tick(key);
            }
        }
        Ok(())
    }

    fn plots(&self, tables: &Tables) -> Vec<Figure> {
        let panel = |method: &str, x: &'static str| {
            let mut series = Vec::new();
            for form in ["full", "patches-to-elements"] {
                for (column, label, dash) in
                    [("solver_error", "", Dash::Solid), ("solver_error_ambient", " + ambient", Dash::Dashed)]
                {
                    let rows = tables
                        .select(|r| r.text("method") == method && r.text("form") == form && r.number("shots") >= 1.0);
                    let points =
                        rows.iter().map(|r| (if x == "time" { r.seconds(x) } else { r.number(x) }, r.number(column)));
                    series.push(Series::new(format!("{form}{label}"), form).values(points).dash(dash).line());
                }
            }
            let x = if x == "time" { Axis::log("time", "s") } else { Axis::log("shots", "") };
            Panel::new(x, Axis::log("error of the display", "share of the mean")).title(method).all_series(series)
        };
        let all = ["hemicube", "ray-cast", "analytic"];
        vec![
            Figure::new("error-shots", "Error of the display against shots")
                .caption("Against the exact solution of the same system; dashed with the ambient term.")
                .panels(all.map(|method| panel(method, "shots")))
                .shared_y(),
            Figure::new("error-time", "Error of the display against time")
                .caption("Time includes computing the rows of the patches that have shot.")
                .panels(all.map(|method| panel(method, "time")))
                .shared_y(),
        ]
    }

    fn reading(&self, tables: &Tables) -> Vec<String> {
        let rows = |form: &str| tables.select(|r| r.text("method") == "hemicube" && r.text("form") == form);
        let at = |form: &str, shots: f64| rows(form).into_iter().find(|r| r.number("shots") == shots);
        let percent =
            |row: Option<Row<'_>>, column: &str| row.map_or_else(|| "?".into(), |r| numbers::percent(r.number(column)));
        let lights = rows("full").first().map_or(0.0, |r| r.number("lights"));
        let patch_lights = rows("patches-to-elements").first().map_or(0.0, |r| r.number("lights"));
        let reach = |form: &str, column: &str| {
            let reached = rows(form).into_iter().find(|r| r.number(column) <= 0.05 && r.number("shots") >= 1.0);
            reached.map_or_else(
                || "not".to_owned(),
                |r| format!("after {} shots in {}", r.number("shots"), numbers::seconds(r.seconds("time"))),
            )
        };
        vec![
            format!(
                "By hemicube, after all {lights} elements of the light have shot once the error is {}, with the ambient term {}; with \
                 substructuring {patch_lights} shots suffice for {}.",
                percent(at("full", lights), "solver_error"),
                percent(at("full", lights), "solver_error_ambient"),
                percent(at("patches-to-elements", patch_lights), "solver_error"),
            ),
            format!(
                "5 % of the mean is reached {} without and {} with substructuring, and with the ambient term {} and {}.",
                reach("full", "solver_error"),
                reach("patches-to-elements", "solver_error"),
                reach("full", "solver_error_ambient"),
                reach("patches-to-elements", "solver_error_ambient"),
            ),
        ]
    }
}

/// x + r, or with the ambient term for the display.
fn displayed(system: &System<'_>, iterate: &Iterate, lift: bool) -> BandValues {
    if lift {
        return ambient::display(system, iterate).expect("shooting has its residual at hand");
    }
    let r = iterate.residual.as_ref().expect("shooting has its residual at hand");
    let values = iterate.shot.values().iter().zip(r.values()).map(|(x, r)| x + r).collect();
    BandValues::new(values, iterate.shot.len())
}

/// (B − E)/ρ: the irradiance that a display shows; no element of this scene has ρ = 0.
fn received(system: &System<'_>, b: &BandValues) -> BandValues {
    let (e, rho) = (system.emission(), system.reflectance());
    let data = e.values().iter().zip(rho.values());
    let h = b.values().iter().zip(data).map(|(b, (e, rho))| if *rho > 0.0 { (b - e) / rho } else { 0.0 });
    BandValues::new(h.collect(), b.len())
}
