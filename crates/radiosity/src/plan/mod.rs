//! What a scene does not need is left out: found before any work, exact, and counted.
//!
//! | left out | because | file |
//! |---|---|---|
//! | rows and elements of what only blocks | it is not asked for, and sends nothing or nothing to what is; with rows of rays it keeps its elements, by whose numbers they are drawn | `roles.rs` |
//! | everything in rooms without an emitter | no light reaches them: 0 | `rooms.rs` |
//! | form factors between rooms | a closed shell parts them: 0 | `rooms.rs` |
//! | black surfaces as unknowns | they reflect nothing: what they send is known, H is gathered once | `roles.rs`, `lamps.rs` |
//! | bands | they are 0, or multiples of others | `bands.rs` |
//! | rows that mirror others | isometries map the mesh onto itself: found on it, copied in the store | `symmetry.rs` |
//!
//! Each changes the answer by rounding only. Omissions of the estimators (pairs that face away, polygons that cannot block, empty shafts) are
//! made there and need no plan; `anyway.rs` counts them. A [`Plan`] is made from scene and strategy alone, in O(faces) and at most m²/256 (or 4,096) looks at pairs of faces;
//! symmetries are looked for when there is a mesh, in O(m); [`crate::run`] follows it; [`Strategy::omit`] says which omissions it may make. A solver sees one system of the elements and bands that are needed, and so do
//! observers; the answer is of all elements.
//!
//! Links leave out dark rooms alone. Repair and methods that sample take all there is or draw numbers for all there is, and refinement, changes of a scene, saved matrices and specular
//! light need it: they leave nothing out ([`Plan::off`]). Which store keeps the form factors that are left is a matter of their number ([`choose_store`]). What is *not* here: omissions that need a tolerance ([`crate::bounded`]).

mod anyway;
mod bands;
mod counts;
mod follow;
mod lamps;
mod omissions;
mod roles;
mod rooms;
mod size;
mod store;
mod symmetry;

use std::collections::BTreeSet;

use radiosity_core::Direction;
use radiosity_form_factors::analytic::PartialVisibility;
use radiosity_geometry::Scene;
use radiosity_geometry::mesh::MeshError;

pub use anyway::Anyway;
pub use bands::{Band, BandPlan};
pub use counts::{Counts, LeftOut, Savings};
pub(crate) use follow::follow;
pub use omissions::{Omission, Omissions};
pub use roles::Role;
pub use size::PlannedSize;
pub use store::{StoreChoice, StoreReason, choose_store};

use crate::run::named;
use crate::{Geometry, Method, Shape, Size, Store, Strategy};

/// Pairs of faces that the plan may look at for so many elements: few against their pairs, or few at all.
fn most_looks(elements: u64) -> u64 {
    (elements.saturating_mul(elements) / 256).max(4096)
}

/// Why nothing is left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Off {
    /// It was asked for.
    KeepEverything,
    /// Repair closes the rows of all elements.
    Repair,
    /// Draws are of all elements and bands.
    Samples,
}

impl Off {
    /// Why `strategy` takes everything, if it does.
    pub fn of(strategy: &Strategy) -> Option<Self> {
        match strategy {
            Strategy { omit: Omissions::NONE, .. } => Some(Self::KeepEverything),
            Strategy { repair: true, .. } => Some(Self::Repair),
            strategy if strategy.samples() => Some(Self::Samples),
            _ => None,
        }
    }
}

impl std::fmt::Display for Off {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::KeepEverything => "everything is to be kept",
            Self::Repair => "repair needs whole rows",
            Self::Samples => "a solver that samples draws for all elements",
        })
    }
}

/// What of a scene a run computes.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Why nothing is left out, if nothing is to be.
    pub off: Option<Off>,
    /// What each surface does.
    pub roles: Vec<Role>,
    /// Room of every surface; rooms that do not see each other have different numbers.
    pub room: Vec<u32>,
    /// Bands.
    pub bands: BandPlan,
    /// Whether what only blocks has no elements.
    bare: bool,
    /// Whether rows that mirror others are copied, if the mesh has such.
    symmetry: bool,
}

impl Plan {
    /// The plan for `scene` solved by `strategy`.
    pub fn new(scene: &Scene, strategy: &Strategy) -> Self {
        let off = Off::of(strategy);
        if off.is_some() {
            return Self { off, ..Self::everything(scene) };
        }
        let whole = vec![0; scene.surfaces.len()];
        let omits = |omission: Omission| allowed(strategy).contains(omission);
        let mut room = whole.clone();
        if omits(Omission::Dark) || omits(Omission::Rooms) {
            let cells = Size::before_meshing(scene, &strategy.mesh).map_or(0, |size| size.elements);
            room = rooms::rooms(scene, most_looks(cells)).unwrap_or(room);
        }
        let mut lit = vec![!omits(Omission::Dark); scene.surfaces.len().max(1)];
        let material = |s: usize| &scene.materials[scene.surfaces[s].material];
        (0..scene.surfaces.len()).for_each(|s| lit[room[s] as usize] |= material(s).emission.iter().any(|&e| e > 0.0));
        let asked = if omits(Omission::Blockers) { strategy.asked_surfaces(scene) } else { None };
        let asked = |s: usize| asked.as_ref().is_none_or(|asked| asked.binary_search(&(s as u32)).is_ok());
        // Rooms with something that is asked for; all of them if they are one system, or nothing is.
        let asked_for: Vec<usize> = (0..scene.surfaces.len()).filter(|&s| asked(s)).collect();
        let mut wanted = vec![!omits(Omission::Rooms) || asked_for.is_empty(); scene.surfaces.len()];
        asked_for.into_iter().for_each(|s| wanted[room[s] as usize] = true);
        let mut roles = roles::roles(scene, |s| lit[room[s] as usize], asked, |s| wanted[room[s] as usize]);
        // Where rows are asked for one by one, those of black faces are those of the others.
        if !(omits(Omission::Black) && gathers(strategy)) {
            roles.iter_mut().filter(|role| **role == Role::Receives).for_each(|role| *role = Role::Exchanges);
        }
        let room = if omits(Omission::Rooms) { room } else { whole };
        let symmetry = omits(Omission::Symmetry) && symmetry::copies(strategy);
        // Light is given to unknowns, if there are any beside it and lamps do not belong to what is copied.
        let given = omits(Omission::Black) && gathers(strategy) && gives(strategy);
        let with_lamps: BTreeSet<u32> =
            (0..roles.len()).filter(|&s| roles[s] == Role::Shines).map(|s| room[s]).collect();
        for number in with_lamps {
            let of = |role: Role| (0..roles.len()).filter(|&s| room[s] == number && roles[s] == role).collect();
            let [unknowns, lamps]: [Vec<usize>; 2] = [Role::Exchanges, Role::Shines].map(of);
            let mut faces = unknowns.iter().chain(&lamps).copied();
            if !given || unknowns.is_empty() || (symmetry && symmetry::of_faces(scene, strategy, &mut faces)) {
                lamps.into_iter().for_each(|s| roles[s] = Role::Exchanges);
            }
        }
        let data = |b: usize| {
            let sends = |s: &usize| matches!(roles[*s], Role::Exchanges | Role::Shines);
            let of = (0..roles.len()).filter(sends).map(material);
            of.map(|material| (material.emission[b], material.reflectance[b])).collect()
        };
        let bands =
            if omits(Omission::Bands) { BandPlan::new(scene.bands(), data) } else { BandPlan::all(scene.bands()) };
        Self { off, roles, room, bands, bare: !numbers_count(strategy), symmetry }
    }

    /// The plan that leaves nothing out.
    fn everything(scene: &Scene) -> Self {
        let n = scene.surfaces.len();
        let bands = BandPlan::all(scene.bands());
        Self { off: None, roles: vec![Role::Exchanges; n], room: vec![0; n], bands, bare: false, symmetry: false }
    }

    /// Whether it leaves anything out, whatever the mesh: rows that mirror others are found on that.
    pub fn omits(&self) -> bool {
        self.roles.iter().any(|role| *role != Role::Exchanges) || self.rooms() > 1 || self.bands.omits()
    }

    /// Whether it may leave anything out on some mesh.
    pub(crate) fn may_omit(&self) -> bool {
        self.omits() || self.symmetry
    }

    /// Meshes `scene` as `strategy` says, but for surfaces that only block; all of it if rows are drawn by the numbers of elements.
    ///
    /// # Errors
    ///
    /// [`MeshError`] if the settings make no mesh.
    pub fn mesh<'a>(&self, scene: &'a Scene, strategy: &Strategy) -> Result<Geometry<'a>, MeshError> {
        Geometry::of_strategy_on(scene, strategy, &|s| !self.is_bare(s))
    }

    /// Whether a surface has no elements.
    fn is_bare(&self, surface: usize) -> bool {
        self.bare && self.roles[surface] == Role::Blocks
    }

    /// Whether no entry that is not 0 is missing in rows of the system.
    pub(crate) fn keeps_rows(&self) -> bool {
        !self.roles.iter().any(|role| matches!(role, Role::Receives | Role::Blocks))
    }

    /// Number of rooms in which something is to be solved.
    fn rooms(&self) -> usize {
        self.lit_rooms().len()
    }

    /// Rooms with unknowns, ascending.
    pub(crate) fn lit_rooms(&self) -> Vec<u32> {
        let lit = self.roles.iter().zip(&self.room).filter(|(role, _)| **role == Role::Exchanges);
        let mut rooms: Vec<u32> = lit.map(|(_, &room)| room).collect();
        rooms.sort_unstable();
        rooms.dedup();
        rooms
    }
}

/// What `strategy` can leave out of what it may: links are refined by the light of all elements in all bands, but for the dark ones.
fn allowed(strategy: &Strategy) -> Omissions {
    let links = matches!(strategy.store, Store::Hierarchical { .. });
    if links && strategy.omit.contains(Omission::Dark) {
        Omission::Dark.into()
    } else if links {
        Omissions::NONE
    } else {
        strategy.omit
    }
}

/// Whether rows are drawn by the numbers of their elements, which would change if some had none.
fn numbers_count(strategy: &Strategy) -> bool {
    !matches!(strategy.method, Method::Analytic { partial: PartialVisibility::Exact { .. }, .. })
}

/// Whether light of black surfaces can be given to the others beforehand: by pairs, which are computed one by one. What is bounded by what lamps send has them in the system.
fn gives(strategy: &Strategy) -> bool {
    let pairwise = matches!(strategy.method, Method::Analytic { .. });
    pairwise && strategy.shape == Shape::Full && strategy.thins().is_none() && strategy.bounces.is_none()
}

/// Whether H of what is no unknown is one gather of rows of its own: where elements gather, and rows are held.
fn gathers(strategy: &Strategy) -> bool {
    let held = !matches!(strategy.store, Store::KeepAll | Store::KeepNone);
    let pairwise = matches!(strategy.method, Method::Analytic { .. });
    let shoots = named(&strategy.solver, strategy.seed).is_ok_and(|s| s.needs().direction == Direction::Shoot);
    match strategy.shape {
        Shape::Full => held && (pairwise || !shoots),
        Shape::ElementsToPatches => held,
        Shape::PatchesToElements | Shape::TwoLevel => false,
    }
}
