//! One choice at every seam: mesh, estimator, store, form and solver.

use radiosity_core::Form;
use radiosity_form_factors::analytic::PartialVisibility;
#[cfg(doc)]
use radiosity_form_factors::ray_cast::RayCast;
use radiosity_geometry::mesh::{MeshSettings, Subdivision};
use radiosity_render::Camera;
use radiosity_solvers::STOCHASTIC;

use crate::plan::Omissions;

/// An estimator with its settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// Pairwise; error of each unoccluded F at most `tolerance`, partly blocked pairs by a rule of their own.
    Analytic {
        /// Absolute error of F asked for.
        tolerance: f64,
        /// How pairs are computed between which something may lie.
        partial: PartialVisibility,
    },
    /// Row-wise by rays.
    RayCast {
        /// Rays a source; the most of them where an error is asked for.
        rays: u32,
        /// Standard error of a row at which no more rays are cast, see [`RayCast::until`].
        error: Option<f64>,
    },
    /// Row-wise by `rays` rays a source, with exact totals towards every emitting surface and the few that shine by their light
    /// ([`Geometry::senders`](crate::Geometry::senders)).
    RaysAndEmitters {
        /// Rays a source.
        rays: u32,
    },
    /// Row-wise by hemicubes of `resolution` pixels along the top.
    Hemicube {
        /// Pixels along an edge of the top face.
        resolution: u32,
    },
}

impl Method {
    /// Analytic with its default settings.
    pub const ANALYTIC: Self = Self::exact(1e-10, 1e-6);
    /// Analytic for links, which need few pairs exactly and none better than the links between them.
    pub const OF_LINKS: Self = Self::exact(1e-6, 1e-4);
    /// Rays with their default number.
    pub const RAY_CAST: Self = Self::rays(1024);
    /// Rays and exact emitters with the default number of rays.
    pub const RAYS_AND_EMITTERS: Self = Self::RaysAndEmitters { rays: 1024 };
    /// Hemicubes with their default resolution.
    pub const HEMICUBE: Self = Self::Hemicube { resolution: 128 };

    /// Analytic, partly blocked pairs to an error of `partial` as well.
    pub const fn exact(tolerance: f64, partial: f64) -> Self {
        Self::Analytic { tolerance, partial: PartialVisibility::Exact { tolerance: partial } }
    }

    /// Analytic, partly blocked pairs by `samples` segments.
    pub const fn sampled(tolerance: f64, samples: u32) -> Self {
        Self::Analytic { tolerance, partial: PartialVisibility::Rays { samples, standard_error: f64::INFINITY } }
    }

    /// Analytic with the default rule for partly blocked pairs among `blocking` polygons: exact, or segments where so many shadows
    /// may overlap that exact ones cost more than they are worth.
    pub const fn analytic_among(blocking: usize) -> Self {
        Self::Analytic { tolerance: 1e-10, partial: partial_among(blocking, 1e-6) }
    }

    /// Analytic for links among `blocking` polygons: pairs exactly as in [`Self::OF_LINKS`], or by segments where so many shadows may overlap.
    pub const fn of_links_among(blocking: usize) -> Self {
        if blocking <= FEW_BLOCKERS { Self::OF_LINKS } else { Self::sampled(1e-6, LINK_SEGMENTS) }
    }

    /// Rows of `rays` rays each.
    pub const fn rays(rays: u32) -> Self {
        Self::RayCast { rays, error: None }
    }

    /// The name used in flags and tables.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Analytic { .. } => "analytic",
            Self::RayCast { .. } => "ray-cast",
            Self::RaysAndEmitters { .. } => "rays+emitters",
            Self::Hemicube { .. } => "hemicube",
        }
    }
}

/// Blocking polygons up to which partly blocked pairs are exact by default.
const FEW_BLOCKERS: usize = 64;

/// Segments of a pair of elements among many blockers that is too near for a link's own samples.
const LINK_SEGMENTS: u32 = 64;

/// The rule for partly blocked pairs among `blocking` polygons: exact to `tolerance` where they are few, else segments.
pub(crate) const fn partial_among(blocking: usize, tolerance: f64) -> PartialVisibility {
    if blocking <= FEW_BLOCKERS {
        PartialVisibility::Exact { tolerance }
    } else {
        PartialVisibility::Rays { samples: 256, standard_error: f64::INFINITY }
    }
}

/// Estimated rms error of irradiance that links may cause unless told otherwise, relative to its mean.
pub const LINK_ERROR: f64 = 0.01;

/// Which light a hierarchical store leaves to its links.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DirectLight {
    /// All of it where many surfaces emit, else indirect light alone.
    WhereFew,
    /// Indirect light alone: what emitters send goes to every element exactly, by pairs.
    Exact,
    /// All light.
    ByLinks,
}

/// What is kept of the form factors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Store {
    /// Every entry, in double precision.
    Dense,
    /// Entries that are not zero.
    Sparse,
    /// Every pair once, in tiles of double precision; of symmetric form factors only.
    Packed,
    /// Every pair once, in tiles of single precision; of symmetric form factors only.
    PackedSingle,
    /// Rows computed when first asked for, and kept.
    KeepAll,
    /// Rows computed whenever asked for.
    KeepNone,
    /// Links between nodes of any size, refined while the solution becomes known; of the analytic method in the full shape.
    Hierarchical {
        /// Estimated rms error of irradiance that links may cause, relative to its mean.
        error: f64,
        /// Which light links carry.
        direct: DirectLight,
    },
}

impl Store {
    /// The stores that take form factors of every estimator in every shape.
    pub const ALL: [Self; 4] = [Self::Dense, Self::Sparse, Self::KeepAll, Self::KeepNone];
    /// The stores that take only symmetric ones: of a pairwise estimator in the full shape.
    pub const SYMMETRIC: [Self; 2] = [Self::Packed, Self::PackedSingle];
    /// Links with default settings.
    pub const HIERARCHICAL: Self = Self::Hierarchical { error: LINK_ERROR, direct: DirectLight::WhereFew };

    /// Whether the store keeps one number for both directions of a pair, and so needs symmetric rows.
    pub fn needs_symmetric(&self) -> bool {
        Self::SYMMETRIC.contains(self)
    }

    /// The name used in flags and tables.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Dense => "dense",
            Self::Sparse => "sparse",
            Self::Packed => "packed",
            Self::PackedSingle => "packed-f32",
            Self::KeepAll => "on-demand, kept",
            Self::KeepNone => "on-demand, recomputed",
            Self::Hierarchical { .. } => "hierarchical",
        }
    }
}

/// How elements and patches take part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// m × m: every element sends to every element.
    Full,
    /// m × n: elements gather from patches.
    ElementsToPatches,
    /// n × m: patches shoot to elements.
    PatchesToElements,
    /// n × n from area-weighted element rows, then one gather to the elements.
    TwoLevel,
}

impl Shape {
    /// What the rows of its store run between; the two-level form sums rows from elements to patches.
    pub fn form(&self) -> Form {
        match self {
            Self::Full => Form::Full,
            Self::ElementsToPatches | Self::TwoLevel => Form::ElementsToPatches,
            Self::PatchesToElements => Form::PatchesToElements,
        }
    }

    /// The name used in tables and legends.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Full => "full",
            Self::ElementsToPatches => "elements-to-patches",
            Self::PatchesToElements => "patches-to-elements",
            Self::TwoLevel => "two-level",
        }
    }
}

/// A complete way to solve a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Strategy {
    /// Elements and patches.
    pub mesh: MeshSettings,
    /// How often the elements that a contact cuts are halved along both directions, those beside them as balance needs: what a solid
    /// darkens at its foot varies within less than an element.
    pub contact_level: u8,
    /// Estimator of form factors.
    pub method: Method,
    /// What is kept of them.
    pub store: Store,
    /// Elements and patches.
    pub shape: Shape,
    /// Whether the rows of a closed scene are closed by symmetric scaling, those of a row-wise estimator after taking the mean of
    /// both directions of a pair; in the full shape and a store that holds its entries.
    pub repair: bool,
    /// Name of the solver, see [`radiosity_solvers::by_name`].
    pub solver: String,
    /// Unshot fraction at which the solver stops, or the estimated error of one that samples.
    pub unshot: f64,
    /// Largest number of steps.
    pub steps: u64,
    /// Whether the residual is recomputed and bounded at the end.
    pub verify: bool,
    /// Products spent, before the solver begins, on forecasting its steps; 0 for no forecast.
    pub forecast: usize,
    /// Seed of everything random.
    pub seed: u64,
    /// Bytes that a run may take; it is refused before it begins if more are predicted.
    pub memory: Option<u64>,
    /// What of the scene may be left out that its answer does not need ([`crate::plan`]); with nothing left out, observers see, and counts
    /// are of, the whole system.
    pub omit: Omissions,
    /// Surfaces whose solution is asked for, ascending; all of them if `None`.
    pub asked: Option<Vec<u32>>,
    /// Camera whose picture alone is asked for, of the surfaces asked for if they are named as well: errors count by what its pixels show of them
    /// ([`crate::bounded`]).
    pub view: Option<Camera>,
    /// rms error of irradiance, relative to its mean level over what is asked for, that dropping small pairs may cause, see [`crate::bounded`]; of exact pairs in the
    /// full shape and a store that holds them, and nothing elsewhere ([`Strategy::check_thinning`]).
    pub thin: Option<f64>,
    /// rms error of irradiance, relative to its level, that bounces which are not followed may cause; the solver stops by it or by
    /// `unshot`, whichever is first.
    pub bounces: Option<f64>,
}

impl Strategy {
    /// K × K elements a face, all defaults: dense, full, conjugate gradients or Gauss–Seidel as the store allows; nothing is left out.
    pub fn new(elements: Subdivision, method: Method) -> Self {
        let solver = if matches!(method, Method::Analytic { .. }) { "cg" } else { "gauss-seidel" };
        Self {
            mesh: MeshSettings { elements, patches: None, contacts: true },
            contact_level: 0,
            method,
            store: Store::Dense,
            shape: Shape::Full,
            repair: false,
            solver: solver.to_owned(),
            unshot: 1e-9,
            steps: 1_000_000,
            verify: true,
            forecast: 0,
            seed: 1,
            memory: None,
            omit: Omissions::NONE,
            asked: None,
            view: None,
            thin: None,
            bounces: None,
        }
    }
}

impl Strategy {
    /// Whether the solver samples: its errors end by their estimate and not by a residual.
    pub fn samples(&self) -> bool {
        self.solver == STOCHASTIC
    }

    /// Whether the solver casts rays of its own and has no row: what it solves is the exact system of the mesh.
    pub fn casts_rays(&self) -> bool {
        self.samples() && self.store == Store::KeepNone && matches!(self.method, Method::RayCast { .. })
    }
}

/// The estimator to take when none is asked for: exact pairs while there are few, or nothing blocks; rays with exact emitters beyond.
///
/// `pieces` is the number of polygons that may block, `elements` the number of elements.
pub fn default_method(elements: usize, blocking: usize) -> Method {
    // A partly blocked pair costs tens of microseconds, and every blocker must be looked at for every pair.
    let pairs = elements as f64 * elements as f64 / 2.0;
    let limit = if blocking == 0 { 5e7 } else { 2e8 / blocking as f64 };
    if pairs <= limit { Method::analytic_among(blocking) } else { Method::RAYS_AND_EMITTERS }
}

#[cfg(test)]
mod tests {
    use radiosity_core::StoreError;

    use super::*;
    use crate::RunError;

    #[test]
    fn packed_stores_refuse_what_is_not_symmetric_before_anything_is_computed() {
        for store in Store::SYMMETRIC {
            let strategy = |method, shape| {
                let solver = "jacobi".to_owned();
                Strategy { store, shape, solver, ..Strategy::new(Subdivision::Uniform(1), method) }
            };
            assert_eq!(strategy(Method::ANALYTIC, Shape::Full).check(), Ok(()));
            let refused = |rows| Err(RunError::Store(StoreError::NeedsSymmetric { store: store.name(), rows }));
            assert_eq!(strategy(Method::RAY_CAST, Shape::Full).check(), refused("ray-cast"));
            assert_eq!(strategy(Method::HEMICUBE, Shape::Full).check(), refused("hemicube"));
            assert_eq!(strategy(Method::ANALYTIC, Shape::ElementsToPatches).check(), refused("analytic"));
        }
    }

    #[test]
    fn repair_makes_rows_symmetric_or_says_what_it_needs() {
        let strategy = |method, store, shape| {
            let plain = Strategy { repair: true, store, shape, ..Strategy::new(Subdivision::Uniform(1), method) };
            let solver = if shape == Shape::Full { "cg" } else { "gauss-seidel" };
            Strategy { solver: solver.to_owned(), ..plain }.check()
        };
        assert_eq!(strategy(Method::RAY_CAST, Store::Dense, Shape::Full), Ok(()));
        assert_eq!(strategy(Method::ANALYTIC, Store::PackedSingle, Shape::Full), Ok(()));
        let refused = |method, store, shape| strategy(method, store, shape).unwrap_err().to_string();
        assert!(refused(Method::RAY_CAST, Store::Sparse, Shape::Full).contains("dense"));
        assert!(refused(Method::ANALYTIC, Store::KeepAll, Shape::Full).contains("on-demand"));
        assert!(refused(Method::ANALYTIC, Store::Dense, Shape::ElementsToPatches).contains("elements-to-patches"));
    }
}
