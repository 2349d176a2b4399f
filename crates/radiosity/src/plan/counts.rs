//! What is left out, in counts: predicted from the mesh before anything is computed, and as it was found afterwards.
//!
//! What a run takes is predicted with every omission in turn, in the order of [`Omission::ALL`]; what one saves is the difference. Counts of form
//! factors of pairs are those of [`Cost::form_factors`](radiosity_core::Cost), pairs that face each other. Elements of a plane face all lie in
//! its plane, so that they need no look at pairs of elements:
//!
//! ```text
//! pairs of faces k, l  =  (elements of k above the plane of l) · (elements of l above the plane of k)
//! ```
//!
//! The measured saving is what everything was predicted to take less what was counted.

use std::fmt;

use glam::DVec3;
use radiosity_core::Cost;
use radiosity_geometry::mesh::MeshSize;
use radiosity_geometry::{Polygon, Scene, Surface};

use super::follow::System;
use super::{Band, BandPlan, Omission, Plan, Role, most_looks};
use crate::{Geometry, Method, Shape, Store, Strategy};

/// Work of a run, or work saved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Elements in the system that is solved.
    pub unknowns: u64,
    /// Form factors computed; `None` where they are not counted beforehand: on demand, by links, to whole emitters, of very many faces, or of a face without
    /// elements that another face's plane cuts.
    pub form_factors: Option<u64>,
    /// Rows computed; `None` where rows are computed on demand, and of links.
    pub rows: Option<u64>,
    /// Rays of those rows; `None` where their number depends on what they hit.
    pub rays: Option<u64>,
    /// Bands solved.
    pub bands: u64,
}

impl fmt::Display for Counts {
    /// What there is of each, with commas between; nothing where nothing is.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all = [
            (Some(self.unknowns), "unknowns"),
            (self.form_factors, "form factors"),
            (self.rows, "rows"),
            (self.rays, "rays"),
            (Some(self.bands), "bands"),
        ];
        let some = all.into_iter().filter_map(|(count, what)| Some((count.filter(|count| *count > 0)?, what)));
        for (k, (count, what)) in some.enumerate() {
            write!(f, "{}{count} {what}", if k > 0 { ", " } else { "" })?;
        }
        Ok(())
    }
}

impl Counts {
    fn less(self, other: Self) -> Self {
        let less = |a: Option<u64>, b: Option<u64>| Some(a?.saturating_sub(b?));
        Self {
            unknowns: self.unknowns.saturating_sub(other.unknowns),
            form_factors: less(self.form_factors, other.form_factors),
            rows: less(self.rows, other.rows),
            rays: less(self.rays, other.rays),
            bands: self.bands.saturating_sub(other.bands),
        }
    }
}

/// An exact omission that a scene allows.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOut {
    /// Which.
    pub omission: Omission,
    /// What is left out.
    pub what: String,
    /// What that saves, after those before it.
    pub predicted: Counts,
}

/// All exact omissions of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Savings {
    /// One by one, in order.
    pub list: Vec<LeftOut>,
    /// What all of them were predicted to save.
    pub predicted: Counts,
    /// What they did save; `None` before the run.
    pub measured: Option<Counts>,
    /// What a run that leaves nothing out takes.
    pub(super) everything: Counts,
}

impl Savings {
    /// With what was counted in a run of so many unknowns and bands.
    pub(super) fn measured(self, unknowns: usize, bands: usize, cost: &Cost) -> Self {
        let counted = Counts {
            unknowns: unknowns as u64,
            form_factors: Some(cost.form_factors),
            rows: Some(cost.source_evaluations),
            rays: Some(cost.rays),
            bands: bands as u64,
        };
        let measured = self.everything.less(counted);
        Self { measured: Some(measured), ..self }
    }
}

impl Plan {
    /// What the plan leaves out of a run of `strategy` on `geometry`, which [`Plan::mesh`] made.
    pub fn left_out(&self, geometry: &Geometry<'_>, strategy: &Strategy) -> Savings {
        let systems = if self.symmetry { self.systems(geometry, strategy) } else { Vec::new() };
        self.left_out_of(geometry, strategy, &systems)
    }

    /// [`Self::left_out`] of a run of which it is known which rows of its systems are mirror images.
    pub(super) fn left_out_of(&self, geometry: &Geometry<'_>, strategy: &Strategy, systems: &[System<'_>]) -> Savings {
        let mirrored = systems.iter().filter_map(|system| system.mirrors.as_ref());
        let [sources, copies] = mirrored.fold([0, 0], |[sources, copies], mirrors| {
            [sources + mirrors.sources(), copies + mirrors.sources() - mirrors.computed()]
        });
        if !self.omits() && copies == 0 {
            return Savings::default();
        }
        let scene = geometry.scene();
        let mut stages = vec![Self::everything(scene)];
        let mut said = Vec::new();
        let mut stage = |omission: Omission, what: Option<String>, plan: Self| {
            if let Some(what) = what {
                stages.push(plan);
                said.push((omission, what));
            }
        };
        // One omission after the other.
        let count = |role: Role| self.roles.iter().filter(|other| **other == role).count();
        let some = |count: usize, what: String| (count > 0).then_some(what);
        let only = |roles: &[Role]| -> Vec<Role> {
            self.roles.iter().map(|role| if roles.contains(role) { *role } else { Role::Exchanges }).collect()
        };
        let (blocks, dark, black) =
            (count(Role::Blocks), count(Role::Dark), count(Role::Receives) + count(Role::Shines));
        let everything = Self::everything(scene);
        let blocking = Self { roles: only(&[Role::Blocks]), ..everything };
        stage(
            Omission::Blockers,
            some(blocks, format!("{blocks} faces{}", if self.bare { ", not meshed" } else { "" })),
            blocking.clone(),
        );
        let unlit = Self { roles: only(&[Role::Blocks, Role::Dark]), ..blocking };
        let what = format!("{dark} faces");
        stage(Omission::Dark, some(dark, what), unlit.clone());
        let parted = Self { room: self.room.clone(), ..unlit };
        let what = format!("form factors between {} rooms", self.rooms());
        stage(Omission::Rooms, some(self.rooms() - usize::from(self.rooms() > 0), what), parted.clone());
        let gathered = Self { roles: self.roles.clone(), ..parted };
        stage(Omission::Black, some(black, format!("{black} faces as unknowns")), gathered);
        let (zero, scaled) = bands_left(&self.bands);
        let what = match (zero, scaled) {
            (0, scaled) => format!("{scaled} bands"),
            (zero, 0) => format!("{zero} dark bands"),
            (zero, scaled) => format!("{zero} dark bands and {scaled} others"),
        };
        stage(Omission::Bands, some(zero + scaled, what), self.clone());

        let tally = Tally::new(geometry, strategy, self);
        let mut counts = tally.counts(&stages);
        if copies > 0 {
            said.push((Omission::Symmetry, format!("{copies} of {sources} rows")));
            let before = counts[counts.len() - 1];
            let copied = Counts { rows: Some(copies as u64), form_factors: tally.copied(systems), ..Counts::default() };
            counts.push(before.less(copied));
        }
        let list = said.into_iter().zip(counts.windows(2));
        let list = list.map(|((omission, what), step)| LeftOut { omission, what, predicted: step[0].less(step[1]) });
        let (first, last) = (counts[0], counts[counts.len() - 1]);
        Savings { list: list.collect(), predicted: first.less(last), measured: None, everything: first }
    }
}

/// Bands that are 0, and those that follow from others.
fn bands_left(bands: &BandPlan) -> (usize, usize) {
    let zero = bands.of.iter().filter(|band| **band == Band::Dark).count();
    (zero, bands.of.len() - bands.solved.len() - zero)
}

/// Elements and patches of one face.
#[derive(Clone, Copy)]
struct Face<'a> {
    surface: usize,
    polygon: &'a Polygon,
    slack: f64,
    elements: Cells<'a>,
    patches: Cells<'a>,
}

/// Polygons on a face, or how many there would be.
#[derive(Clone, Copy)]
enum Cells<'a> {
    /// Facets, by index, of these.
    Meshed(&'a radiosity_geometry::Facets, Range),
    /// So many, not meshed.
    Count(u64),
}

type Range = (u32, u32);

impl Cells<'_> {
    fn len(self) -> u64 {
        match self {
            Self::Meshed(_, (begin, end)) => u64::from(end - begin),
            Self::Count(count) => count,
        }
    }
}

/// Counts of the runs of several plans.
pub(super) struct Tally<'a> {
    strategy: &'a Strategy,
    faces: Vec<Face<'a>>,
    /// Whether pairs of faces may be looked at.
    looks: bool,
}

impl<'a> Tally<'a> {
    pub(super) fn new(geometry: &'a Geometry<'_>, strategy: &'a Strategy, plan: &Plan) -> Self {
        let scene = geometry.scene();
        let mesh_faces = geometry.mesh().faces();
        let of_element = |e: usize| mesh_faces[geometry.exposed()[e] as usize];
        let elements = ranges((0..geometry.exposed().len()).map(of_element), scene.pieces().count());
        let mut of_patch = vec![0; geometry.patches().len()];
        geometry.parent().iter().enumerate().for_each(|(e, &p)| of_patch[p as usize] = of_element(e));
        let patches = ranges(of_patch.into_iter(), elements.len());
        let faces = scene.pieces().enumerate().map(|(k, (surface, polygon))| {
            let size = if plan.is_bare(surface) { cells(scene, surface, polygon, strategy) } else { None };
            let cells = |facets, range, count: fn(MeshSize) -> u64| match size {
                Some(size) => Cells::Count(count(size)),
                None => Cells::Meshed(facets, range),
            };
            Face {
                surface,
                polygon,
                slack: rounding(polygon),
                elements: cells(geometry.elements(), elements[k], |size| size.cells),
                patches: cells(geometry.patches(), patches[k], |size| size.patches),
            }
        });
        let faces: Vec<Face<'a>> = faces.collect();
        let m: u64 = faces.iter().map(|face| face.elements.len()).sum();
        let looks = (faces.len() as u64).pow(2) <= most_looks(m);
        Self { strategy, faces, looks }
    }

    /// Counts of each plan.
    pub(super) fn counts(&self, plans: &[Plan]) -> Vec<Counts> {
        let strategy = self.strategy;
        // Rows of stores that compute them when asked, and links, follow from the solution.
        let on_demand = matches!(strategy.store, Store::KeepAll | Store::KeepNone | Store::Hierarchical { .. });
        let ends = |face: &Face<'a>| self.ends(face);
        let role = |plan: &Plan, face: &Face<'a>| plan.roles[face.surface];
        let computed = |role: Role| matches!(role, Role::Exchanges | Role::Receives | Role::Shines);
        let sends = |role: Role| matches!(role, Role::Exchanges | Role::Shines);
        let simple = |plan: &Plan| {
            let chosen = |is: &dyn Fn(Role) -> bool, of: &dyn Fn(&Face<'a>) -> u64| -> u64 {
                self.faces.iter().filter(|face| is(role(plan, face))).map(of).sum()
            };
            let rows = chosen(&computed, &|face| ends(face).0.len());
            let rays = match strategy.method {
                Method::RayCast { rays, error: None } => Some(rows * u64::from(rays)),
                Method::RayCast { .. } | Method::RaysAndEmitters { .. } | Method::Analytic { .. } => None,
                Method::Hemicube { .. } => Some(0),
            };
            Counts {
                unknowns: chosen(&|role| role == Role::Exchanges, &|face| face.elements.len()),
                form_factors: None,
                rows: (!on_demand).then_some(rows),
                rays: rays.filter(|_| !on_demand),
                bands: plan.bands.solved.len() as u64,
            }
        };
        let mut counts: Vec<Counts> = plans.iter().map(simple).collect();
        let needed = |plan: &Plan, s: &Face<'a>, t: &Face<'a>| {
            plan.room[s.surface] == plan.room[t.surface] && computed(role(plan, s)) && sends(role(plan, t))
        };
        let form_factors = match strategy.method {
            _ if on_demand || !self.looks => None,
            Method::RaysAndEmitters { .. } => None,
            Method::RayCast { .. } | Method::Hemicube { .. } => {
                self.sums(plans, false, needed, |s, t| Some(ends(s).0.len() * ends(t).1.len()))
            }
            Method::Analytic { .. } => {
                let symmetric = strategy.shape == Shape::Full;
                self.sums(plans, symmetric, needed, |s, t| facing((s, ends(s).0), (t, ends(t).1)))
            }
        };
        for (k, counts) in counts.iter_mut().enumerate() {
            counts.form_factors = form_factors.as_ref().map(|sums| sums[k]);
        }
        counts
    }

    /// Form factors that stores copy in these systems; `None` if they cannot be counted.
    fn copied(&self, systems: &[System<'_>]) -> Option<u64> {
        if !self.looks {
            return None;
        }
        let (form, symmetric) = (self.strategy.shape.form(), self.strategy.shape == Shape::Full);
        let mut copied = 0;
        for system in systems {
            let Some(mirrors) = &system.mirrors else { continue };
            // Originals of the sources that take part, by numbers among all, and whether a target does.
            let [sources, targets] = system.selection.ends(form);
            let mut original = vec![u32::MAX; sources.last().map_or(0, |last| *last as usize + 1)];
            sources.iter().enumerate().for_each(|(k, &s)| original[s as usize] = sources[mirrors.original(k).0]);
            let part_of = |cells: Cells<'_>, numbers: &[u32]| match cells {
                Cells::Meshed(_, range) => Some(range).filter(|range| numbers.binary_search(&range.0).is_ok()),
                Cells::Count(_) => None,
            };
            for (k, s) in self.faces.iter().enumerate() {
                let Some(of_s) = part_of(self.ends(s).0, sources) else { continue };
                for t in &self.faces[if symmetric { k } else { 0 }..] {
                    let Some(of_t) = part_of(self.ends(t).1, targets) else { continue };
                    let first = above(s, self.ends(s).0, t)?;
                    if first.count() == 0 {
                        continue;
                    }
                    let second = above(t, self.ends(t).1, s)?;
                    let (all, pairs) = (second.count(), first.count() * second.count());
                    let mut computing = first.facets(of_s);
                    computing.retain(|&s| original[s as usize] == s);
                    let computed: u64 = if symmetric && !computing.is_empty() {
                        let of = |t: u32| original[t as usize];
                        let mut others: Vec<u32> = second.facets(of_t).into_iter().map(of).collect();
                        others.sort_unstable();
                        let later = |s: &u32| all - others.partition_point(|other| other < s) as u64;
                        computing.iter().map(later).sum()
                    } else {
                        computing.len() as u64 * all
                    };
                    copied += pairs - computed;
                }
            }
        }
        Some(copied)
    }

    /// What rows run between on a face.
    fn ends(&self, face: &Face<'a>) -> (Cells<'a>, Cells<'a>) {
        match self.strategy.shape {
            Shape::Full => (face.elements, face.elements),
            Shape::ElementsToPatches | Shape::TwoLevel => (face.elements, face.patches),
            Shape::PatchesToElements => (face.patches, face.elements),
        }
    }

    /// Sums over pairs of faces that each plan needs, of either order once if `symmetric`; `None` if one cannot be counted.
    fn sums(
        &self,
        plans: &[Plan],
        symmetric: bool,
        needed: impl Fn(&Plan, &Face<'a>, &Face<'a>) -> bool,
        count: impl Fn(&Face<'a>, &Face<'a>) -> Option<u64>,
    ) -> Option<Vec<u64>> {
        let mut sums = vec![0; plans.len()];
        for (k, s) in self.faces.iter().enumerate() {
            for t in &self.faces[if symmetric { k } else { 0 }..] {
                let pairs = count(s, t)?;
                let add = |(sum, plan): (&mut u64, &Plan)| {
                    *sum += if needed(plan, s, t) || (symmetric && needed(plan, t, s)) { pairs } else { 0 };
                };
                sums.iter_mut().zip(plans).for_each(add);
            }
        }
        Some(sums)
    }
}

/// First and one past the last of the facets of each face, which come face by face.
fn ranges(face_of: impl Iterator<Item = u32>, faces: usize) -> Vec<Range> {
    let mut ranges = vec![(0, 0); faces];
    for (k, face) in (0..).zip(face_of) {
        let range = &mut ranges[face as usize];
        *range = (if range.1 == 0 { k } else { range.0 }, k + 1);
    }
    ranges
}

/// Cells that a face would have.
fn cells(scene: &Scene, surface: usize, polygon: &Polygon, strategy: &Strategy) -> Option<MeshSize> {
    let of = &scene.surfaces[surface];
    let alone = Surface { pieces: vec![polygon.clone()], material: 0, ..of.clone() };
    let scene = Scene { surfaces: vec![alone], materials: vec![scene.materials[of.material].clone()] };
    MeshSize::of(&scene, &strategy.mesh).ok()
}

/// Distance from a face's plane that rounding and its thickness make.
fn rounding(face: &Polygon) -> f64 {
    let largest = face.vertices().iter().map(|v| v.abs().max_element()).fold(0.0, f64::max);
    8.0 * f64::EPSILON * largest + 2.0 * face.thickness()
}

/// Pairs of facets of two faces that face each other.
fn facing((k, of_k): (&Face<'_>, Cells<'_>), (l, of_l): (&Face<'_>, Cells<'_>)) -> Option<u64> {
    let first = above(k, of_k, l)?.count();
    Some(if first == 0 { 0 } else { first * above(l, of_l, k)?.count() })
}

/// Facets of a face that reach above the plane of another.
enum Above {
    /// So many: all or none.
    Whole(u64),
    /// These.
    Some(Vec<u32>),
}

impl Above {
    fn count(&self) -> u64 {
        match self {
            Self::Whole(count) => *count,
            Self::Some(facets) => facets.len() as u64,
        }
    }

    /// The facets, of a face that has all of these.
    fn facets(self, (begin, end): Range) -> Vec<u32> {
        match self {
            Self::Whole(0) => Vec::new(),
            Self::Whole(_) => (begin..end).collect(),
            Self::Some(facets) => facets,
        }
    }
}

/// Facets of a face with a corner above the plane of another.
fn above(face: &Face<'_>, cells: Cells<'_>, plane: &Face<'_>) -> Option<Above> {
    let slack = face.slack.max(plane.slack);
    let over = |v: &DVec3| plane.polygon.signed_distance(*v) > slack;
    let of_face = face.polygon.vertices();
    if !of_face.iter().any(over) {
        return Some(Above::Whole(0));
    }
    // Where at most one edge lies in the plane every cell reaches above it; where a corner lies below, some may not.
    if of_face.iter().all(|v| plane.polygon.signed_distance(*v) >= -slack) {
        return Some(Above::Whole(cells.len()));
    }
    let Cells::Meshed(facets, (begin, end)) = cells else { return None };
    let reaches = |e: &u32| facets.polygons(*e as usize).iter().any(|polygon| polygon.vertices().iter().any(over));
    Some(Above::Some((begin..end).filter(reaches).collect()))
}
