//! Compares the form factors of a triangulated city with published ones, and explains every difference.
//!
//! ```sh
//! cargo run --release -p radiosity-cli --example published_factors -- city.stl city.vfsparse.txt city.svf.txt
//! ```
//!
//! The first list has a line `i j F_ij` a pair, counted from 1, rounded to 6 decimals, above a threshold; the second the sky factors
//! 1 − Σ_j F_ij of all rows. Published factors that differ by more than 2e-5 are computed once more by a route that shares no rule
//! with the estimator: the exact point factors with blockers, integrated over the sender. That says which of the two is off.
//!
//! Of the 992 factors of the uDALES case 064 (140 triangles) 16 differ by more than 2e-5, by up
//! to 1.3e-4, and in all of them the quadrature agrees with the estimator to 1e-10. Their pairs from 1:
//!
//! | i → j | published | here | | i → j | published | here |
//! |---|---|---|---|---|---|---|
//! | 1 → 133 | 0.028121 | 0.028141 | | 4 → 139 | 0.028121 | 0.028141 |
//! | 133 → 1 | 0.078113 | 0.078170 | | 139 → 4 | 0.078113 | 0.078170 |
//! | 23 → 135 | 0.001324 | 0.001276 | | 53 → 137 | 0.001324 | 0.001276 |
//! | 135 → 23 | 0.003679 | 0.003545 | | 137 → 53 | 0.003679 | 0.003545 |
//! | 133 → 37 | 0.026989 | 0.027010 | | 139 → 35 | 0.026989 | 0.027010 |
//! | 133 → 41 | 0.005017 | 0.005046 | | 139 → 17 | 0.005017 | 0.005046 |
//! | 133 → 42 | 0.010519 | 0.010543 | | 139 → 30 | 0.010519 | 0.010543 |
//! | 134 → 42 | 0.005939 | 0.005960 | | 140 → 30 | 0.005939 | 0.005960 |
//!
//! They come in mirrored pairs (left and right column), as the symmetry of the case asks. Nothing blocks any pair of the case, so that
//! visibility plays no part.

use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

use glam::DVec3;
use radiosity_form_factors::analytic::Analytic;
use radiosity_form_factors::checks::check;
use radiosity_form_factors::point::form_factors_from;
use radiosity_form_factors::stores::DenseFormFactors;
use radiosity_form_factors::{Pairwise, PairwiseRows};
use radiosity_gallery::quadrature::graded;
use radiosity_geometry::{Facets, Occluders, Polygon, Scene, Surface};
use radiosity_io::read_stl_geometry;

/// Difference from a published factor that needs no explanation.
const ALLOWED: f64 = 2e-5;
/// Error asked of the estimator.
const TOLERANCE: f64 = 1e-10;
/// Agreement asked of both routes: that of the rules, far below what is to be explained.
const AGREE: f64 = 1e-8;
/// Nodes a direction of the quadrature.
const NODES: usize = 40;

/// Counts what fails, a line each.
struct Report(u32);

impl Report {
    fn say(&mut self, good: bool, what: &str) {
        println!("{}  {what}", if good { "ok  " } else { "FAIL" });
        self.0 += u32::from(!good);
    }
}

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    let [stl, factors, skies] = &paths[..] else {
        return Err("give the STL file, the factors and the sky factors".into());
    };
    let scene = read_stl_geometry(Path::new(stl))?.scene;
    let facets = Facets::of_surfaces(&scene);
    let blockers = Occluders::blocking(&scene);
    let rows = PairwiseRows::new(Analytic::new(Some(&blockers)), &facets, &facets, TOLERANCE, 1);
    let (store, cost) = DenseFormFactors::assemble(&rows)?;
    let (n, areas) = (facets.len(), facets.areas());
    let f = |i: usize, j: usize| store.entry(i, j) / areas[i];
    println!(
        "{n} faces; {} pairs face each other: {} clear, {} hidden, {} partial",
        cost.form_factors, cost.clear_pairs, cost.hidden_pairs, cost.partial_pairs
    );
    let mut report = Report(0);

    // Published factors, and what is to be explained.
    let listed = numbers(&std::fs::read_to_string(factors)?)?;
    let mut explained = 0;
    for line in &listed {
        let [i, j, published] = line[..] else { return Err(format!("{factors}: {line:?} is no 'i j F'").into()) };
        let (i, j) = (i as usize - 1, j as usize - 1);
        if (f(i, j) - published).abs() > ALLOWED {
            let again = quadrature(&scene, &facets, i, j);
            let good = (f(i, j) - again).abs() < AGREE;
            explained += u32::from(good);
            let off = f(i, j) - published;
            let (there, apart) = (f(i, j), (f(i, j) - again).abs());
            let what = format!("{} → {}: published {published}, here {there:.10} ({off:+.1e})", i + 1, j + 1);
            report.say(good, &format!("{what}, by quadrature {again:.10} ({apart:.0e} apart)"));
        }
    }
    println!("{} factors listed; {explained} that differ by more than {ALLOWED:e} are explained", listed.len());
    let named: Vec<(usize, usize)> = listed.iter().map(|l| (l[0] as usize - 1, l[1] as usize - 1)).collect();
    let unlisted = (0..n).flat_map(|i| (0..n).map(move |j| (i, j))).filter(|pair| !named.contains(pair));
    let largest = unlisted.map(|(i, j)| f(i, j)).fold(0.0, f64::max);
    report.say(largest < ALLOWED, &format!("largest factor that is not listed: {largest:.1e}"));

    // Sky factors: sums of some ten factors of 6 decimals and the exceptions above.
    let sums: Vec<f64> = (0..n).map(|i| (0..n).map(|j| f(i, j)).sum()).collect();
    let skies = numbers(&std::fs::read_to_string(skies)?)?;
    let off = skies.iter().zip(&sums).map(|(sky, sum)| (1.0 - sum - sky[0]).abs()).fold(0.0, f64::max);
    report.say(skies.len() == n && off < 2e-4, &format!("sky factors differ by up to {off:.1e}"));

    // What holds for any form factors.
    let checks = check(&store, &areas, &areas, false)?;
    let largest = (0..n).flat_map(|i| (0..n).map(move |j| (i, j))).map(|(i, j)| f(i, j)).fold(0.0, f64::max);
    report.say(largest <= 1.0 && checks.negative == 0, &format!("largest factor {largest:.6}"));
    let sum = sums.iter().copied().fold(0.0, f64::max);
    report.say(sum <= 1.0, &format!("largest row sum {sum:.6}"));
    let apart = reciprocity(&scene, &blockers);
    report.say(
        apart < 1e-9,
        &format!("both directions of a pair computed apart differ by up to {apart:.1e} of the smaller area"),
    );
    let Obstructed { pairs, reduced, excess } = obstructed(&scene, &blockers);
    let what = format!(
        "{pairs} pairs with obstructions beside them: {reduced} smaller, {excess:+.1e} above at most, bounds allowed for"
    );
    report.say(excess <= 0.0, &what);
    Ok(ExitCode::from(u8::from(report.0 > 0)))
}

/// Lines of numbers; `#` begins a comment.
fn numbers(text: &str) -> Result<Vec<Vec<f64>>, Box<dyn Error>> {
    let lines = text.lines().map(|line| line.split('#').next().unwrap_or_default());
    let words =
        lines.filter(|line| !line.trim().is_empty()).map(|line| line.split_whitespace().map(str::parse).collect());
    Ok(words.collect::<Result<_, std::num::ParseFloatError>>()?)
}

fn triangle(surface: &Surface) -> &Polygon {
    &surface.pieces[0]
}

/// F_ij as the mean over triangle i of the exact factors from its points, among all faces.
fn quadrature(scene: &Scene, facets: &Facets, i: usize, j: usize) -> f64 {
    let source = triangle(&scene.surfaces[i]);
    let [a, b, c] = *source.vertices() else { return f64::NAN };
    let mut target = Facets::new();
    target.push(facets.polygons(j).to_vec(), false);
    let blockers: Vec<Polygon> = scene.pieces().map(|(_, piece)| piece.clone()).collect();
    let rule = graded(NODES);
    let at = |s: f64, t: f64| -> DVec3 { a + (b - a) * s + (c - b) * (s * t) };
    let value = |s, t| form_factors_from(at(s, t), source.normal(), &target, &blockers)[0];
    rule.iter().map(|&(s, w)| rule.iter().map(|&(t, v)| 2.0 * s * w * v * value(s, t)).sum::<f64>()).sum()
}

/// The largest |A_i F_ij − A_j F_ji| / min(A_i, A_j) of pairs computed from either side.
fn reciprocity(scene: &Scene, blockers: &Occluders) -> f64 {
    let analytic = Analytic::new(Some(blockers));
    let mut worst = 0.0_f64;
    for (k, i) in scene.surfaces.iter().map(triangle).enumerate() {
        for j in scene.surfaces[..k].iter().map(triangle) {
            let (there, back) = (analytic.exchange(i, j, TOLERANCE, 1), analytic.exchange(j, i, TOLERANCE, 1));
            worst = worst.max((there.value - back.value).abs() / i.area().min(j.area()));
        }
    }
    worst
}

/// Pairs among more obstructions against the same pairs without.
struct Obstructed {
    pairs: u32,
    /// Smaller by more than both bounds.
    reduced: u32,
    /// Largest excess beyond both bounds, relative to the smaller area.
    excess: f64,
}

/// A small triangle beside each of the two faces of every pair that sees each other.
fn obstructed(scene: &Scene, blockers: &Occluders) -> Obstructed {
    let alone = Analytic::new(Some(blockers));
    let mut found = Obstructed { pairs: 0, reduced: 0, excess: f64::NEG_INFINITY };
    for (k, i) in scene.surfaces.iter().map(triangle).enumerate() {
        for j in scene.surfaces[..k].iter().map(triangle) {
            let without = alone.exchange(i, j, TOLERANCE, 1);
            if without.value == 0.0 {
                continue;
            }
            let polygons = scene.pieces().map(|(_, piece)| piece.clone());
            let polygons: Vec<Polygon> = polygons.chain([i, j].into_iter().filter_map(beside)).collect();
            let owners = (0..polygons.len() as u32).collect();
            let with = Analytic::new(Some(&Occluders::new(polygons, owners))).exchange(i, j, TOLERANCE, 1);
            let allowed = with.bound + without.bound;
            found.pairs += 1;
            found.reduced += u32::from(with.value < without.value - allowed);
            found.excess = found.excess.max((with.value - without.value - allowed) / i.area().min(j.area()));
        }
    }
    found
}

/// A triangle a tenth as large, upright beside the first edge of another.
fn beside(face: &Polygon) -> Option<Polygon> {
    let (a, b) = face.edges().next()?;
    let size = 0.1 * a.distance(b);
    let foot = a + (a - face.centroid()) * 0.05;
    Polygon::new(&[foot, foot + (b - a) * 0.1, foot + face.normal() * size]).ok()
}
