//! Runs what a plan keeps, and gives the answer of all elements.
//!
//! The elements that exchange light are a system of their own on the same mesh. Pairs get the seeds and the order that they have among all
//! elements, rows of rays and hemicubes are those of all elements with entries left away: an entry is what it would have been.

use std::time::{Duration, Instant};

use radiosity_core::{BandValues, Bands, Certificate, Cost, Form, FormFactors as _, Observer, Outcome, Solution};
use radiosity_form_factors::stores::{DiagonalBlocks, Keep, OnDemand, Part};
use radiosity_form_factors::{MirroredRows, Mirrors, Numbers, PairwiseRows, Rows, SelectedRows};
use radiosity_geometry::Facets;

use super::lamps::Lamps;
use super::{Band, BandPlan, Plan, Role, symmetry};
use crate::bounded::By;
use crate::estimate::{analytic, ends};
use crate::hierarchical::solve_by_links;
use crate::run::{Check, Known, Made, run_meshed, solve_stored, unblocked};
use crate::thin::fill_thinned;
use crate::{Geometry, Method, Phase, Run, RunError, Shape, Store, Strategy};

/// What takes part in a system, by its numbers among all that is exposed, ascending.
pub(super) struct Selection {
    pub(super) elements: Vec<u32>,
    patches: Vec<u32>,
}

impl Selection {
    /// `part`, which was selected by its elements from `whole`.
    pub(super) fn new(whole: &Geometry<'_>, part: &Geometry<'_>, elements: Vec<u32>) -> Self {
        let place = |p: &u32| whole.exposed_patches().binary_search(p).expect("patches of a part are of the whole");
        Self { elements, patches: part.exposed_patches().iter().map(|p| place(p) as u32).collect() }
    }

    /// Numbers of sources and targets.
    pub(super) fn ends(&self, form: Form) -> [&[u32]; 2] {
        match form {
            Form::Full => [&self.elements, &self.elements],
            Form::ElementsToPatches => [&self.elements, &self.patches],
            Form::PatchesToElements => [&self.patches, &self.elements],
        }
    }
}

/// What exchanges light in one room.
pub(super) struct System<'a> {
    pub(super) room: u32,
    pub(super) part: Geometry<'a>,
    pub(super) selection: Selection,
    /// Which of its rows are mirror images.
    pub(super) mirrors: Option<Mirrors>,
}

impl Plan {
    /// The systems of all rooms in which something is to be solved.
    pub(super) fn systems<'a>(&self, whole: &Geometry<'a>, strategy: &Strategy) -> Vec<System<'a>> {
        let surfaces = whole.surfaces();
        let of_room = |room: u32| {
            let takes_part = |s: usize| self.room[s] == room && self.roles[s] == Role::Exchanges;
            let elements = elements_of(&surfaces, &takes_part);
            let part = whole.part(&elements, &self.bands.solved, self.keeps_rows());
            let part = among(part, strategy, &|s| self.room[s] == room);
            let mirrors = self.symmetry.then(|| symmetry::mirrors(&part, strategy)).flatten();
            let selection = Selection::new(whole, &part, elements);
            System { room, part, selection, mirrors }
        };
        self.lit_rooms().into_iter().map(of_room).collect()
    }
}

/// Elements on the surfaces that a test picks, of those on `surfaces`, ascending.
pub(super) fn elements_of(surfaces: &[u32], is: &dyn Fn(usize) -> bool) -> Vec<u32> {
    (0..surfaces.len() as u32).filter(|&e| is(surfaces[e as usize] as usize)).collect()
}

/// Where each of `some` stands among `all`, both ascending.
pub(super) fn places(some: &[u32], all: &[u32]) -> Vec<u32> {
    some.iter().map(|k| all.binary_search(k).expect("a part of all") as u32).collect()
}

/// A part of which pairs are blocked by what `between` names alone; rows of rays and hemicubes are those of the whole.
pub(super) fn among<'a>(part: Geometry<'a>, strategy: &Strategy, between: &dyn Fn(usize) -> bool) -> Geometry<'a> {
    if matches!(strategy.method, Method::Analytic { .. }) { part.among(between) } else { part }
}

/// Solves by `strategy` what `plan` keeps of `geometry`.
pub(crate) fn follow<'a>(
    plan: &Plan,
    geometry: Geometry<'a>,
    mut meshing: Phase,
    strategy: &Strategy,
    observer: &mut dyn Observer,
) -> Result<Run<'a>, RunError> {
    let clock = Instant::now();
    let mut systems = plan.systems(&geometry, strategy);
    meshing.time += clock.elapsed();
    if !plan.omits() && systems.iter().all(|system| system.mirrors.is_none()) {
        return run_meshed(geometry, meshing, strategy, observer);
    }
    let savings = plan.left_out_of(&geometry, strategy, &systems);
    let surfaces = geometry.surfaces();
    let chosen = |is: &dyn Fn(usize) -> bool| elements_of(&surfaces, is);
    let elements = chosen(&|s| plan.roles[s] == Role::Exchanges);
    let unknowns = elements.len();
    let mut made = if elements.is_empty() {
        nothing_emits(&geometry, strategy)
    } else {
        let mirrors = systems.iter_mut().map(|system| system.mirrors.take()).collect();
        let lamps = Lamps::new(plan, &geometry, &systems, strategy)?;
        let (mut given, giving) = lamps.light(&geometry, &elements, plan.bands.solved.len())?;
        let union;
        if let [one] = &mut systems[..] {
            one.part.give(given.take());
        }
        let (part, all) = if let [one] = &systems[..] {
            (&one.part, &one.selection)
        } else {
            let part = geometry.part(&elements, &plan.bands.solved, plan.keeps_rows());
            let lit = |s: usize| systems.iter().any(|system| system.room == plan.room[s]);
            let mut part = among(part, strategy, &lit);
            part.give(given);
            let all = Selection::new(&geometry, &part, elements);
            union = (part, all);
            (&union.0, &union.1)
        };
        let mut made = solve_part(&geometry, (part, all), (&systems, mirrors), strategy, observer)?;
        made.stored_bytes += lamps.stored_bytes();
        made.solution.cost += giving;
        made.form_factors.cost += lamps.form_factors.cost;
        made.form_factors.time += lamps.form_factors.time;
        let clock = Instant::now();
        if let Some(given) = part.given() {
            let h = made.solution.irradiance.values_mut().iter_mut().zip(given.irradiance.values());
            h.for_each(|(h, given)| *h += given);
        }
        made.checked = made.checked.map(|checked| checked.renamed(all.ends(strategy.shape.form())));
        let h = &made.solution.irradiance;
        let mut irradiance = spread(&plan.bands, &all.elements, surfaces.len(), h);
        let mut radiosity = spread(&plan.bands, &all.elements, surfaces.len(), &made.solution.radiosity);
        // What black elements gather is off by what the light of the others is off by.
        let reflectance = part.reflectance();
        let mut sent = vec![placed(&all.elements, surfaces.len(), &made.solution.radiosity)];
        let bounds = made.missed.iter_mut().filter_map(|missed| missed.by.as_mut());
        let mut bounds: Vec<&mut By> = bounds.collect();
        for by in &mut bounds {
            let mut reflected = by.values.clone();
            let of_element = reflected.values_mut().iter_mut().zip(reflectance.values());
            of_element.for_each(|(by, rho)| *by = if *rho > 0.0 { *by * rho } else { 0.0 });
            sent.push(placed(&all.elements, surfaces.len(), &reflected));
            by.values = spread(&plan.bands, &all.elements, surfaces.len(), &by.values);
        }
        for room in lamps.rooms() {
            let (h, cost) = room.arriving(&geometry, &sent[0])?;
            made.solution.cost += cost;
            fill_in(&plan.bands, &room.lamps, &h, &mut irradiance);
            fill_in(&plan.bands, &room.lamps, &room.emission, &mut radiosity);
            place(&room.lamps, &room.emission, &mut sent[0]);
        }
        for room in plan.lit_rooms() {
            let in_this_room = |s: usize| plan.room[s] == room;
            let in_room = |s: usize, role: Role| in_this_room(s) && plan.roles[s] == role;
            let black = chosen(&|s| in_room(s, Role::Receives));
            let senders = chosen(&|s| in_room(s, Role::Exchanges) || in_room(s, Role::Shines));
            if !black.is_empty() {
                let (found, cost) = gathered(&geometry, (&black, senders), &in_this_room, &sent, strategy)?;
                made.solution.cost += cost;
                let all = std::iter::once(&mut irradiance).chain(bounds.iter_mut().map(|by| &mut by.values));
                found.iter().zip(all).for_each(|(found, all)| fill_in(&plan.bands, &black, found, all));
            }
        }
        // The square of all is that of the unknowns, and no more than that of their light again.
        let black = plan.roles.contains(&Role::Receives);
        let rho = reflectance.values().iter().copied().fold(0.0, f64::max);
        let more = if black { 1.0 + rho * rho } else { 1.0 };
        for by in bounds {
            let of_band = |band: &Band| match *band {
                Band::Scaled { of, by: factor } => more * factor * factor * by.squares[of],
                Band::Dark => 0.0,
            };
            by.squares = plan.bands.of.iter().map(of_band).collect();
        }
        // What arrives at a blocker that has elements is not known, nor what it reflects of that; all else that is not in the system sends nothing.
        let of_materials = [geometry.emission(), geometry.reflectance()];
        for blocker in chosen(&|s| plan.roles[s] == Role::Blocks) {
            let e = blocker as usize;
            for b in 0..irradiance.count() {
                irradiance.band_mut(b)[e] = f64::NAN;
                if of_materials.iter().any(|of| of.band(b)[e] != 0.0) {
                    radiosity.band_mut(b)[e] = f64::NAN;
                }
            }
        }
        made.solution.radiosity = radiosity;
        made.solution.irradiance = irradiance;
        made.solution.time += clock.elapsed();
        made
    };
    let bands = plan.bands.solved.len();
    let mut cost = made.form_factors.cost + made.solution.cost;
    // What the error does not need is counted with its bound.
    cost.form_factors += made.missed.iter().filter_map(|missed| missed.dropped_pairs()).sum::<u64>();
    made.left_out = savings.measured(unknowns, bands, &cost);
    Ok(made.run(geometry, meshing))
}

/// Rows of `sources` to the targets of `to` in the form of the strategy; `from` are their facets if they are not those of `to`.
pub(super) fn selected_rows<'r>(
    whole: &'r Geometry<'_>,
    (part, selection): (&'r Geometry<'_>, &Selection),
    from: Option<(&'r Facets, &[u32])>,
    strategy: &Strategy,
) -> Result<Box<dyn Rows + 'r>, RunError> {
    let form = strategy.shape.form();
    let [mut sources, targets] = selection.ends(form);
    if let Method::Analytic { tolerance, partial } = strategy.method {
        let (mut from_facets, to) = ends(part, form);
        if let Some((facets, numbers)) = from {
            (from_facets, sources) = (facets, numbers);
        }
        let one_list = form == Form::Full;
        let numbers = Numbers { sources: sources.to_vec(), targets: targets.to_vec(), one_list };
        let pairs = analytic(part.blockers(), partial);
        return Ok(Box::new(PairwiseRows::new(pairs, from_facets, to, tolerance, strategy.seed).numbered(numbers)));
    }
    if let Some((_, numbers)) = from {
        sources = numbers;
    }
    let rows = crate::rows(whole, strategy.method, form, strategy.seed)?;
    Ok(Box::new(SelectedRows::new(rows, sources.to_vec(), targets)))
}

/// Solves the system of what exchanges light: one store a room.
fn solve_part(
    whole: &Geometry<'_>,
    (part, all): (&Geometry<'_>, &Selection),
    (systems, mirrors): (&[System<'_>], Vec<Option<Mirrors>>),
    strategy: &Strategy,
    observer: &mut dyn Observer,
) -> Result<Made, RunError> {
    if let Store::Hierarchical { error, direct } = strategy.store {
        return solve_by_links(part, strategy, (error, direct), observer);
    }
    let form = strategy.shape.form();
    let mut form_factors = Phase::default();
    let mut blocks: Vec<Part<'_>> = Vec::new();
    let mut thinned = Vec::new();
    let [all_sources, all_targets] = all.ends(form);
    for (System { part: own, selection, .. }, mirrors) in systems.iter().zip(mirrors) {
        let rows = selected_rows(whole, (own, selection), None, strategy)?;
        let rows = match mirrors {
            Some(mirrors) => Box::new(MirroredRows::new(rows, mirrors)),
            None => rows,
        };
        if systems.len() == 1 {
            let (store, known) = fill_thinned(own, rows, unblocked(strategy.method), strategy)?;
            return solve_stored(own, store.store(), known, strategy, None, observer);
        }
        let (store, known) = fill_thinned(own, rows, None, strategy)?;
        form_factors.cost += known.form_factors.cost;
        form_factors.time += known.form_factors.time;
        let [sources, targets] = selection.ends(form);
        let own_places = places(sources, all_sources);
        thinned.extend(known.thinned.into_iter().map(|thinned| thinned.renumbered(own_places.clone())));
        blocks.push((store.boxed(), own_places, places(targets, all_targets)));
    }
    let store = DiagonalBlocks::new(blocks, all_sources.len(), all_targets.len());
    let known = Known { form_factors, repair: None, checks: Check::Find(None, Duration::ZERO), thinned };
    solve_stored(part, &store, known, strategy, None, observer)
}

/// What black elements of a room gather of each of what is `sent`, on all elements, by the senders there.
fn gathered(
    whole: &Geometry<'_>,
    (black, senders): (&[u32], Vec<u32>),
    in_room: &dyn Fn(usize) -> bool,
    sent: &[BandValues],
    strategy: &Strategy,
) -> Result<(Vec<BandValues>, Cost), RunError> {
    let own = among(whole.part(&senders, &[], false), strategy, in_room);
    let selection = Selection::new(whole, &own, senders);
    let facets = whole.elements().select(black);
    let rows = selected_rows(whole, (&own, &selection), Some((&facets, black)), strategy)?;
    // What the senders of the room radiate: elements, or means of patches.
    let senders = &selection.elements;
    let of_band = |band: &[f64]| senders.iter().map(|&e| band[e as usize]).collect::<Vec<f64>>();
    let bands = sent.iter().flat_map(|sent| (0..sent.count()).map(|band| sent.band(band)));
    let mut x = BandValues::new(bands.flat_map(of_band).collect(), senders.len());
    if strategy.shape != Shape::Full {
        x = patch_means(&own, x.view());
    }
    let mut h = BandValues::zeros(x.count(), black.len());
    let cost = OnDemand::new(rows, Keep::None).gather(x.view(), h.view_mut())?;
    for band in 0..h.count() {
        h.band_mut(band).iter_mut().enumerate().for_each(|(e, h)| *h /= facets.area(e));
    }
    let mut values = h.values().chunks_exact(black.len());
    let of = |sent: &BandValues| {
        BandValues::new(values.by_ref().take(sent.count()).flatten().copied().collect(), black.len())
    };
    Ok((sent.iter().map(of).collect(), cost))
}

/// Area means over the patches of `own`.
fn patch_means(own: &Geometry<'_>, x: Bands<'_>) -> BandValues {
    let mut means = BandValues::zeros(x.count(), own.patches().len());
    let mut areas = vec![0.0; own.patches().len()];
    own.parent().iter().enumerate().for_each(|(e, &p)| areas[p as usize] += own.elements().area(e));
    for band in 0..x.count() {
        let of_band = means.band_mut(band);
        for (e, &p) in own.parent().iter().enumerate() {
            of_band[p as usize] += own.elements().area(e) * x.band(band)[e];
        }
        of_band.iter_mut().zip(&areas).for_each(|(mean, area)| *mean /= area);
    }
    means
}

/// Values on so many elements, 0 but on `elements`.
fn placed(elements: &[u32], count: usize, values: &BandValues) -> BandValues {
    let mut all = BandValues::zeros(values.count(), count);
    place(elements, values, &mut all);
    all
}

fn place(elements: &[u32], values: &BandValues, all: &mut BandValues) {
    for b in 0..values.count() {
        let to = all.band_mut(b);
        elements.iter().zip(values.band(b)).for_each(|(&e, value)| to[e as usize] = *value);
    }
}

/// Values of all bands on so many elements, 0 but on `elements`, from those of the solved bands there.
fn spread(bands: &BandPlan, elements: &[u32], count: usize, values: &BandValues) -> BandValues {
    let mut all = BandValues::zeros(bands.of.len(), count);
    fill_in(bands, elements, values, &mut all);
    all
}

fn fill_in(bands: &BandPlan, elements: &[u32], values: &BandValues, all: &mut BandValues) {
    for (b, band) in bands.of.iter().enumerate() {
        if let Band::Scaled { of, by } = *band {
            let to = all.band_mut(b);
            elements.iter().zip(values.band(of)).for_each(|(&e, value)| to[e as usize] = by * value);
        }
    }
}

/// The answer where no light is: 0, and nothing was computed for it.
fn nothing_emits(geometry: &Geometry<'_>, strategy: &Strategy) -> Made {
    let zeros = BandValues::zeros(geometry.scene().bands(), geometry.elements().len());
    // A system without unknowns reflects nothing.
    let certificate = Certificate { contraction: 0.0, bound: Some(0.0), sharp_bound: Some(0.0), backward_error: 0.0 };
    let solution = Solution {
        radiosity: zeros.clone(),
        irradiance: zeros,
        outcome: Outcome::Converged,
        steps: 0,
        cost: Cost::default(),
        verification: Cost::default(),
        time: Duration::ZERO,
        unshot: 0.0,
        standard_error: None,
        certificate: strategy.verify.then_some(certificate),
    };
    Made::of_solution(solution)
}
