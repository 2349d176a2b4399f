//! Hierarchical radiosity: links refined while the solution becomes known.
//!
//! ```text
//! H = H_direct + F x,      x = ρ H_direct + ρ F x,      B = E + ρ H
//! ```
//!
//! Light of few emitters is taken out of the links: each element gets H_direct = Σ_L F_eL E_L from the whole of every emitting surface L by
//! the analytic estimator, shadows included, and what it reflects of that becomes the emission of a system of indirect light. Nothing
//! counts twice, since x holds no E. It pays because a link to a small, bright node must be refined down to every element in its light:
//! with direct light the number of links grows with the elements, and without it hardly.
//!
//! Two rounds (lazy linking and multi-gridding; Holzschuch, Sillion, Drettakis 1994): links are made for a guess of x until all of them
//! together err by a few times what is asked for, and the system is solved; then the links whose error is too large *for this x* are refined until the
//! estimate is what was asked for, and the solver goes on from the first answer. The threshold falls in small steps: what is refined beyond
//! need cannot be taken back, and a step costs no more than a look at every link and the links it makes.
//!
//! No link is dropped: what is too weak to be refined is carried by the link of larger nodes, so that nothing has to be given back, and its error is part of the estimate.
//!
//! Where only some surfaces or a view are asked for, ε² of a link counts by the square of its receiver's importance to them ([`Importance`]), guessed like x at first and
//! solved for on the coarse links; the error is that of their irradiance, relative to its mean.

use std::sync::Arc;
use std::time::Instant;

use radiosity_core::{BandValues, Cost, FormFactors, Observer, Solution, StopRule, System, solve_from};
use radiosity_form_factors::Pairwise;
use radiosity_form_factors::analytic::{Analytic, PartialVisibility};
use radiosity_form_factors::hierarchical::{Brightness, HierarchicalFormFactors, Hierarchy, Linking, Links};
use rayon::prelude::*;

use crate::asked::Asked;
use crate::estimate::analytic;
use crate::importance::{Importance, largest_of};
use crate::predict::admit_links;
use crate::run::{Made, allowed, named, stop_rule};
use crate::strategy::partial_among;
use crate::{DirectLight, Geometry, Method, Phase, RunError, Strategy};

/// Emitting surfaces up to which their light is taken exactly unless told otherwise.
const FEW_EMITTERS: usize = 16;
/// Error of all links for the guess, in units of the error asked for.
const COARSE_LINKS: f64 = 3.0;
/// Threshold of the first links, in units of the error they are made for.
const FIRST: f64 = 0.05;
/// By how much a threshold falls in one step, at least and at most.
const FALL: (f64, f64) = (1.05, 16.0);
/// How the error of all links follows the threshold of one, ε ∝ τ^order: at first, so that it does not fall too far, and what the last step may say.
const ORDER: (f64, [f64; 2]) = (1.0, [0.4, 1.0]);
/// Error that a step is meant for, in units of what is asked for.
const AIM: f64 = 0.97;
/// Unshot share to which the first round is solved, in units of the error asked for.
const COARSE: f64 = 3.0;
/// Most steps of a threshold in one round.
const STEPS: u32 = 24;
/// Error of direct light, in units of the error asked for.
const DIRECT: f64 = 0.3;

/// Error of single pairs where the method names none.
const TOLERANCE: f64 = 1e-6;

/// What the links of a run came to.
#[derive(Clone, Debug, PartialEq)]
pub struct HierarchicalReport {
    /// Nodes of the hierarchy.
    pub nodes: usize,
    /// Links, all rounds' refinement done.
    pub links: usize,
    /// Solutions on ever finer links.
    pub rounds: u32,
    /// Estimated rms error of irradiance by links, relative to its mean.
    pub error: f64,
    /// Emitting surfaces whose light was taken exactly.
    pub exact_emitters: usize,
}

/// Solves `geometry` on links, to an estimated error of `error` by them.
pub(crate) fn solve_by_links(
    geometry: &Geometry<'_>,
    strategy: &Strategy,
    (error, direct): (f64, DirectLight),
    observer: &mut dyn Observer,
) -> Result<Made, RunError> {
    allowed(error)?;
    let clock = Instant::now();
    let reflectance = geometry.reflectance();
    let areas = geometry.elements().areas();
    let hierarchy = Arc::new(Hierarchy::new(geometry.mesh(), geometry.exposed(), geometry.elements()));
    // What elements send before links: their emission, or what they reflect of direct light.
    let (emitters, _) = geometry.emitters();
    let exact = match direct {
        DirectLight::Exact => true,
        DirectLight::ByLinks => false,
        DirectLight::WhereFew => emitters.len() <= FEW_EMITTERS,
    };
    let mut cost = Cost::default();
    let (lit, sent) = if exact {
        let (lit, spent) = direct_light(geometry, error, strategy.seed);
        cost += spent;
        let mut sent = lit.clone();
        sent.values_mut().iter_mut().zip(reflectance.values()).for_each(|(sent, rho)| *sent *= rho);
        (Some(lit), sent)
    } else {
        (None, geometry.emission())
    };
    let linking = linking(geometry, &hierarchy, strategy.method, strategy.seed);
    let asked = strategy.asks().then(|| Asked::some(geometry, strategy.named())).flatten();
    let asked = asked.map(|asked| asked.weights(&areas));
    let counted = asked.as_deref().map_or(areas.clone(), |asked| areas.iter().zip(asked).map(|(a, w)| a * w).collect());
    let guess = Guess::new(&areas, &sent, &reflectance, lit.as_ref().map(|lit| (lit, &counted[..])));
    let mut brightness = Brightness::of(&hierarchy, &guess.sent, guess.level).linear();
    drop(guess);
    if let Some(asked) = &asked {
        let lamps = BandValues::new(asked.repeat(reflectance.count()), asked.len());
        let guess = Guess::new(&areas, &lamps, &reflectance, None);
        brightness = brightness.worth(&hierarchy, &worth(largest_of(&guess.sent), asked, &areas, &counted));
    }
    let admitted = |links: &Links| admit_links(geometry, strategy, links.len());
    let coarse = COARSE_LINKS * error;
    let mut threshold = FIRST * coarse;
    let (mut links, spent) = linking.links(threshold, &brightness);
    cost += spent;
    let (_, spent) = tighten(&linking, &mut links, &brightness, coarse, &mut threshold, &admitted)?;
    cost += spent;
    let mut form_factors = Phase { cost, time: clock.elapsed() };

    // The first round: a solution on coarse links, to learn what is bright.
    let mut solver = named(&strategy.solver, strategy.seed)?;
    let mut importance = None;
    let first = {
        let clock = Instant::now();
        let store = HierarchicalFormFactors::new(Arc::clone(&hierarchy), &links);
        form_factors.time += clock.elapsed();
        let system = System::full(&store, &areas, sent.view(), reflectance.view())?;
        let stop = StopRule::unshot((COARSE * error).max(strategy.unshot)).steps(strategy.steps).unverified();
        let mut solution = solve_from(&system, &mut *solver, &stop, &mut (), None)?;
        if let Some(asked) = &asked {
            let (found, solved) = Importance::new(&system, asked, &strategy.solver, &stop)?;
            solution.cost += solved.cost;
            solution.time += solved.time;
            importance = Some(worth(largest_of(&found.of_irradiance), asked, &areas, &counted));
        }
        // Only where the solver goes on from is kept.
        solution.irradiance = BandValues::zeros(0, 0);
        solution
    };
    let clock = Instant::now();
    let level = level(&counted, &first, &reflectance, &sent, lit.as_ref());
    brightness = Brightness::of(&hierarchy, &first.radiosity, level).linear();
    if let Some(importance) = importance {
        brightness = brightness.worth(&hierarchy, &importance);
    }
    let (error, spent) = tighten(&linking, &mut links, &brightness, error, &mut threshold, &admitted)?;
    form_factors.cost += spent;
    let store = HierarchicalFormFactors::new(Arc::clone(&hierarchy), &links);
    let exact_emitters = if exact { emitters.len() } else { 0 };
    let report = HierarchicalReport { nodes: hierarchy.len(), links: links.len(), rounds: 2, error, exact_emitters };
    // What was needed to refine is not needed to solve.
    drop((links, brightness));
    form_factors.time += clock.elapsed();

    let system = System::full(&store, &areas, sent.view(), reflectance.view())?;
    let mut solution = solve_from(&system, &mut *solver, &stop_rule(strategy), observer, Some(first.radiosity.view()))?;
    solution.cost += first.cost;
    solution.time += first.time;
    solution.steps += first.steps;
    gather_finally(&store, (&geometry.emission(), &reflectance), lit.as_ref(), &mut solution);
    let stored_bytes = store.properties().stored_bytes;
    Ok(Made::of_links(form_factors, stored_bytes, report, solution))
}

/// Lowers the threshold and refines until all links err by at most `goal` for this brightness; the estimate, and what it cost.
fn tighten(
    linking: &Linking<'_, Analytic<'_>>,
    links: &mut Links,
    brightness: &Brightness,
    goal: f64,
    threshold: &mut f64,
    admitted: &dyn Fn(&Links) -> Result<(), RunError>,
) -> Result<(f64, Cost), RunError> {
    let mut cost = Cost::default();
    let (mut found, mut order) = (linking.error(links, brightness), ORDER.0);
    for _ in 0..STEPS {
        if found <= goal {
            break;
        }
        let fall = (found / (AIM * goal)).powf(1.0 / order).clamp(FALL.0, FALL.1);
        *threshold /= fall;
        cost += linking.refine(links, *threshold, brightness);
        admitted(links)?;
        let before = std::mem::replace(&mut found, linking.error(links, brightness));
        let [least, most] = ORDER.1;
        order = ((before / found).ln() / fall.ln()).clamp(least, most);
    }
    Ok((found, cost))
}

/// Links for light that is equally bright everywhere, to an estimated error of `error` by all of them.
///
/// # Errors
///
/// [`RunError::Tolerance`] if the error is not in (0, 1).
pub(crate) fn fixed_links(
    geometry: &Geometry<'_>,
    method: Method,
    error: f64,
    seed: u64,
) -> Result<(HierarchicalFormFactors, Cost), RunError> {
    allowed(error)?;
    let hierarchy = Arc::new(Hierarchy::new(geometry.mesh(), geometry.exposed(), geometry.elements()));
    let linking = linking(geometry, &hierarchy, method, seed);
    let brightness = Brightness::uniform(&hierarchy);
    let mut threshold = FIRST * error;
    let (mut links, mut cost) = linking.links(threshold, &brightness);
    let (_, spent) = tighten(&linking, &mut links, &brightness, error, &mut threshold, &|_| Ok(()))?;
    cost += spent;
    Ok((HierarchicalFormFactors::new(hierarchy, &links), cost))
}

/// What makes the links of a geometry, with exact pairs by the estimator that `method` asks for.
fn linking<'g>(
    geometry: &'g Geometry<'_>,
    hierarchy: &'g Hierarchy,
    method: Method,
    seed: u64,
) -> Linking<'g, Analytic<'g>> {
    let tolerance = match method {
        Method::Analytic { tolerance, .. } => tolerance,
        _ => TOLERANCE,
    };
    Linking::new(hierarchy, geometry.elements(), geometry.blockers(), estimator(geometry, method), tolerance, seed)
}

/// The estimator of pairs that `method` asks for.
fn estimator<'g>(geometry: &'g Geometry<'_>, method: Method) -> Analytic<'g> {
    let partial = match method {
        Method::Analytic { partial, .. } => partial,
        _ => PartialVisibility::Exact { tolerance: TOLERANCE },
    };
    analytic(geometry.blockers(), partial)
}

/// Irradiance of every element from whole emitting surfaces.
fn direct_light(geometry: &Geometry<'_>, error: f64, seed: u64) -> (BandValues, Cost) {
    let (elements, scene) = (geometry.elements(), geometry.scene());
    let (emitters, surfaces) = geometry.emitters();
    let bands = scene.bands();
    let emission: Vec<&[f64]> =
        surfaces.iter().map(|&s| &scene.materials[scene.surfaces[s as usize].material].emission[..]).collect();
    // An error of F_eL is one of E F in irradiance, whose mean is about the power over the area.
    let brightest = emission.iter().flat_map(|e| e.iter().copied()).fold(0.0, f64::max);
    let power: f64 =
        emission.iter().enumerate().map(|(k, e)| emitters.area(k) * e.iter().copied().fold(0.0, f64::max)).sum();
    let share = power / (brightest * scene.area());
    let tolerance = (DIRECT * error * share).max(f64::MIN_POSITIVE);
    let blockers = geometry.blockers();
    let analytic = analytic(blockers, partial_among(blockers.len(), tolerance));
    let mut lit = vec![0.0; elements.len() * bands];
    const PIECE: usize = 1024;
    let costs: Vec<Cost> = lit
        .par_chunks_mut(PIECE * bands)
        .enumerate()
        .map(|(piece, lit)| {
            let mut cost = Cost::default();
            for (e, lit) in (piece * PIECE..).zip(lit.chunks_exact_mut(bands)) {
                let polygon = &elements.polygons(e)[0];
                for (k, emission) in emission.iter().enumerate() {
                    let mut seen = 0.0;
                    for emitter in emitters.polygons(k) {
                        let estimate = analytic.exchange(polygon, emitter, tolerance, seed);
                        cost += estimate.cost;
                        seen += estimate.value;
                    }
                    lit.iter_mut().zip(*emission).for_each(|(lit, e)| *lit += e * seen / polygon.area());
                }
            }
            cost
        })
        .collect();
    let mut all = BandValues::zeros(bands, elements.len());
    for b in 0..bands {
        all.band_mut(b).iter_mut().zip(lit[b..].iter().step_by(bands)).for_each(|(to, lit)| *to = *lit);
    }
    (all, costs.into_iter().sum())
}

/// What the square of an error on each element counts where only W is asked for, of the area A_W = Σ A W, by its importance Y in the band in which that is largest:
///
/// ```text
/// (y/⟨y⟩_W)² Σ A / A_W,      y = √W + (Y − W), on surfaces Y
/// ```
///
/// Errors of links hardly depend on each other, so that those of nodes add by squares: at once by W, and one that reaches what is asked for evenly is worth (A_p (Y − W)
/// ε)²/A_W ≤ A_p (Y − W)² ε²
/// there. Relative to what is asked for, since errors of links are counted without their reflections; and over its share, so that sums over all area
/// are means over that.
fn worth(y: Vec<f64>, w: &[f64], areas: &[f64], counted: &[f64]) -> Vec<f64> {
    let (asked, total) = (counted.iter().sum::<f64>(), areas.iter().sum::<f64>());
    let y: Vec<f64> =
        y.into_iter().zip(w).map(|(y, w)| if *w == 1.0 { y } else { w.sqrt() + (y - w).max(0.0) }).collect();
    let mean = y.iter().zip(counted).map(|(y, area)| y * area).sum::<f64>() / asked;
    y.into_iter().map(|y| (y / mean).powi(2) * total / asked).collect()
}

/// What elements may send, before anything is solved.
struct Guess {
    sent: BandValues,
    level: f64,
}

impl Guess {
    /// x = e + ρ H, with the same ambient H = ⟨e⟩ / (1 − ⟨ρ⟩) everywhere (Cohen et al. 1988).
    ///
    /// The level is that of the areas that come with direct light.
    fn new(areas: &[f64], e: &BandValues, rho: &BandValues, lit: Option<(&BandValues, &[f64])>) -> Self {
        let total: f64 = areas.iter().sum();
        let mean = |x: &[f64]| x.iter().zip(areas).map(|(x, a)| x * a).sum::<f64>() / total;
        let (mut sent, mut level) = (e.clone(), 0.0);
        for b in 0..e.count() {
            let ambient = mean(e.band(b)) / (1.0 - mean(rho.band(b)));
            sent.band_mut(b).iter_mut().zip(rho.band(b)).for_each(|(x, rho)| *x += rho * ambient);
            let direct = lit.map_or(0.0, |(lit, counted)| {
                let sum = lit.band(b).iter().zip(counted).map(|(lit, a)| lit * a).sum::<f64>();
                sum / counted.iter().sum::<f64>()
            });
            level += (ambient + direct) / e.count() as f64;
        }
        Self { sent, level }
    }
}

/// The mean irradiance that a solution of the system of the links stands for.
fn level(areas: &[f64], solution: &Solution, rho: &BandValues, e: &BandValues, lit: Option<&BandValues>) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for b in 0..e.count() {
        for (k, area) in areas.iter().enumerate() {
            // What an element sends beyond e it has received; the black ones do not tell.
            let rho = rho.band(b)[k];
            if rho > 0.0 {
                let direct = lit.map_or(0.0, |lit| lit.band(b)[k]);
                sum += area * (direct + (solution.radiosity.band(b)[k] - e.band(b)[k]) / rho);
                weight += area;
            }
        }
    }
    if weight > 0.0 { sum / weight } else { 0.0 }
}

/// H = H_direct + F x by the final gather, and B = E + ρ H, in place of what the system of the links says.
fn gather_finally(
    store: &HierarchicalFormFactors,
    (emission, reflectance): (&BandValues, &BandValues),
    lit: Option<&BandValues>,
    solution: &mut Solution,
) {
    let clock = Instant::now();
    let (mut h, cost) = store.final_gather(solution.radiosity.view());
    solution.cost += cost;
    if let Some(lit) = lit {
        h.values_mut().iter_mut().zip(lit.values()).for_each(|(h, lit)| *h += lit);
    }
    let data = emission.values().iter().zip(reflectance.values());
    let b = solution.radiosity.values_mut().iter_mut().zip(h.values()).zip(data);
    b.for_each(|((b, h), (e, rho))| *b = e + rho * h);
    solution.irradiance = h;
    solution.time += clock.elapsed();
}
