//! Extended form factors by mirror images: exact for planar, ideal mirrors.
//!
//! What is seen in a planar mirror M is where its image is, behind M, as seen through M as a window (Eckert and Sparrow 1961; Rushmeier and Torrance 1990). A chain
//! M₁ … M_k of mirrors is unfolded: the room is mirrored at the window W₁ = M₁, its image at W₂, the image of M₂ there, and so on, until all of the path is one
//! straight segment from s to the last image t⁽ᵏ⁾ of t:
//!
//! ```text
//! A_s F′_st = Σ over chains  Π r_i · ∫_s ∫_t⁽ᵏ⁾ cosθ_s cosθ_t V / (π d²) dA_t dA_s
//! ```
//!
//! r_i is the reflectance of M_i, the same at all angles. V = 1 where the segment passes every window from front to back and meets nothing of the copy of the room
//! between one window and the next. That is an exchange area of two polygons among blockers, which [`Analytic`] computes: the copies are cut to what lies
//! between the planes of their windows, and each window gets a frame, convex polygons that fill the rest of its plane as far as any segment reaches. A mirror lies in
//! its window's plane and so is not among the blockers there; in front of another one it blocks as any polygon does.
//!
//! A chain ends where the next mirror has no part that is behind all windows and faces the last one. Two mirrors at an angle α take at most ⌈π/α⌉ turns; two that face
//! each other never end, so that their bounces must be given a number.
//!
//! **Symmetry.** The chain from t to s is that from s to t the other way round, with the same segments, so F′ is as symmetric as F. Pairs s ≤ t are computed over all
//! chains, and lent to both: symmetric to the last bit, in every band.
//!
//! **Colour.** Chains whose products of reflectance are multiples of each other over the bands share one *colour*, and rows of geometry alone, computed once: grey
//! mirrors have one colour whatever their reflectance, and so has a single mirror. A band reads the rows of each colour with a weight.
//!
//! **Error.** That of [`Analytic`] for each chain, times its product of reflectance: the tolerances of unblocked pairs, and those estimated of partly blocked ones. It
//! is seen in a room whose mirror is replaced by a hole into a copy that is meshed and solved along with it (`radiosity/tests/enhanced.rs`), and against rays.
//!
//! What is *not* here: mirrors whose reflectance depends on the angle (metals), lobes and glass ([`super::SpecularRays`] takes all of them), and polygons that lie in
//! the plane of a mirror and cover a part of it: cut the mirror there.

use glam::DVec3;
use radiosity_core::{Cost, StoreError};
use radiosity_geometry::occlusion::Ends;
use radiosity_geometry::{Facets, Occluders, Polygon, Scene, Specular};
use rayon::prelude::*;

use super::SpecularBounces;
use crate::analytic::{Analytic, FacetBlocks, PartialVisibility};
use crate::rows::{Rows, mix};
use crate::{Pairwise, Run};

/// Chains of mirrors that are followed at most: each takes as many pairs as straight form factors.
const MOST_CHAINS: usize = 1024;

/// Why there are no images.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ImagesError {
    /// A specular surface that shows no images.
    #[error(
        "surface '{surface}' is {what} ('{material}'): images are those of ideal mirrors alone; rays take any specular surface"
    )]
    NotAMirror {
        /// Name of the surface.
        surface: String,
        /// Name of its material.
        material: String,
        /// What it is.
        what: &'static str,
    },
    /// Mirrors that show each other too often.
    #[error(
        "light finds more than {most} ways from mirror to mirror, if they end at all: allow fewer specular bounces in a row, or take rays"
    )]
    Chains {
        /// Ways that are followed at most.
        most: usize,
    },
}

/// The images that the mirrors of a scene show, whatever its mesh.
pub struct Images {
    chains: Vec<Chain>,
    /// Share of every band, the largest 1, of each colour.
    colours: Vec<Vec<f64>>,
}

/// A chain of mirrors, unfolded.
struct Chain {
    /// The mirrors as seen along a segment, each clipped to where it can be passed.
    windows: Vec<Polygon>,
    /// What blocks between the windows and beside them.
    blockers: Occluders,
    /// Lengths that rounding makes.
    rounding: f64,
    colour: usize,
    /// The product of the reflectances is this times the colour.
    weight: f64,
}

/// Mirrors in the order in which light takes them.
struct Way {
    windows: Vec<Polygon>,
    /// Places in the list of mirrors.
    mirrors: Vec<usize>,
}

/// A polygon that mirrors.
struct Mirror<'a> {
    polygon: &'a Polygon,
    reflectance: &'a [f64],
}

impl Images {
    /// Follows the chains of mirrors in `scene` as far as `bounces` allow.
    ///
    /// # Errors
    ///
    /// [`ImagesError`] if a specular surface is no ideal mirror, or there are more than 1,024 chains, as there are without end where any number of bounces is allowed and
    /// mirrors face each other.
    pub fn new(scene: &Scene, bounces: SpecularBounces) -> Result<Self, ImagesError> {
        let mirrors = mirrors(scene)?;
        let rounding = Occluders::rounding(scene);
        let mut images = Self { chains: Vec::new(), colours: Vec::new() };
        let mut found = Vec::new();
        for way in ways(&mirrors, bounces, rounding)? {
            let product = way.product(&mirrors);
            let weight = product.iter().copied().fold(0.0, f64::max);
            let colour: Vec<f64> = product.iter().map(|r| r / weight).collect();
            found.push((way, images.colour(colour), weight));
        }
        let chain = |(way, colour, weight): (Way, usize, f64)| {
            let rounding = way.rounding(rounding);
            let blockers = blockers(scene, &way.windows, rounding);
            Chain { windows: way.windows, blockers, rounding, colour, weight }
        };
        images.chains = found.into_par_iter().map(chain).collect();
        Ok(images)
    }

    /// The place of a colour, new or not.
    fn colour(&mut self, colour: Vec<f64>) -> usize {
        self.colours.iter().position(|known| *known == colour).unwrap_or_else(|| {
            self.colours.push(colour);
            self.colours.len() - 1
        })
    }

    /// What each set of [`Self::rows`] counts in every band.
    pub fn colours(&self) -> &[Vec<f64>] {
        &self.colours
    }

    /// Number of chains.
    pub fn chains(&self) -> usize {
        self.chains.len()
    }

    /// The largest number of polygons that may block along a chain.
    pub fn blockers(&self) -> usize {
        self.chains.iter().map(|chain| chain.blockers.len()).max().unwrap_or(0)
    }

    /// Rows of F′ from `sources` to `targets` over the chains of one colour, in a band in which that counts 1; with errors as those of [`Analytic`] for each chain.
    /// Symmetric if both are the same object.
    ///
    /// # Panics
    ///
    /// If there is no such colour.
    pub fn rows<'a>(
        &'a self,
        (sources, targets): (&Facets, &Facets),
        colour: usize,
        tolerance: f64,
        partial: PartialVisibility,
        seed: u64,
    ) -> ImageRows<'a> {
        assert!(colour < self.colours.len(), "colour {colour} of {}", self.colours.len());
        let of_colour: Vec<(usize, &Chain)> =
            self.chains.iter().enumerate().filter(|(_, chain)| chain.colour == colour).collect();
        let lay_out = |(k, chain): (usize, &'a Chain)| {
            let estimator = Analytic::new(Some(&chain.blockers)).through(&chain.windows).partial_visibility(partial);
            let (sources, images) = (chain.before(sources), chain.images(targets));
            let blocks = estimator.lay_out(&images);
            LaidOut { estimator, weight: chain.weight, sources, images, blocks, seed: mix(seed ^ k as u64) }
        };
        let chains = of_colour.into_par_iter().map(lay_out).collect();
        let ends = (sources.len(), targets.len());
        ImageRows { chains, ends, symmetric: std::ptr::eq(sources, targets), tolerance }
    }
}

/// The mirrors of a scene that reflect anything, piece by piece.
fn mirrors(scene: &Scene) -> Result<Vec<Mirror<'_>>, ImagesError> {
    let mut mirrors = Vec::new();
    for surface in &scene.surfaces {
        let material = &scene.materials[surface.material];
        let what = match &material.specular {
            None => continue,
            Some(Specular::Mirror { reflectance }) => {
                if reflectance.iter().any(|r| *r > 0.0) {
                    mirrors.extend(surface.pieces.iter().map(|polygon| Mirror { polygon, reflectance }));
                }
                continue;
            }
            Some(Specular::Phong { .. }) => "glossy",
            Some(Specular::Conductor { .. }) => "metal",
            Some(Specular::Dielectric { .. }) => "glass",
        };
        let (surface, material) = (surface.name.clone(), material.name.clone());
        return Err(ImagesError::NotAMirror { surface, material, what });
    }
    Ok(mirrors)
}

/// All ways that light can take from mirror to mirror, shorter ones first.
fn ways(mirrors: &[Mirror<'_>], bounces: SpecularBounces, rounding: f64) -> Result<Vec<Way>, ImagesError> {
    let mut found: Vec<Way> = Vec::new();
    let none = Way { windows: Vec::new(), mirrors: Vec::new() };
    let (mut last, mut taken) = (vec![none], 0);
    while bounces.allow(taken) && !last.is_empty() {
        let mut next = Vec::new();
        for way in &last {
            for k in 0..mirrors.len() {
                next.extend(way.on_to(k, mirrors, rounding));
                if found.len() + last.len() + next.len() > MOST_CHAINS + 1 {
                    return Err(ImagesError::Chains { most: MOST_CHAINS });
                }
            }
        }
        found.append(&mut std::mem::replace(&mut last, next));
        taken += 1;
    }
    found.append(&mut last);
    // The first way takes no mirror at all.
    found.remove(0);
    Ok(found)
}

impl Way {
    /// The way that takes mirror `k` next; `None` if no light that comes this way sees its front, or none is reflected.
    fn on_to(&self, k: usize, mirrors: &[Mirror<'_>], rounding: f64) -> Option<Self> {
        let rounding = self.rounding(rounding);
        let mut window = unfolded(mirrors[k].polygon, &self.windows);
        for before in &self.windows {
            window = behind(&window, before, rounding)?;
        }
        // It must be seen from the front through every window.
        self.windows.iter().all(|before| in_front(before, &window, rounding).is_some()).then_some(())?;
        let next = Self {
            windows: self.windows.iter().cloned().chain([window]).collect(),
            mirrors: self.mirrors.iter().copied().chain([k]).collect(),
        };
        next.product(mirrors).iter().any(|r| *r > 0.0).then_some(next)
    }

    /// Product of the reflectances, band by band; the same to the last bit for the same mirrors in any order.
    fn product(&self, mirrors: &[Mirror<'_>]) -> Vec<f64> {
        let mut sorted = self.mirrors.clone();
        sorted.sort_unstable();
        let mut factors = sorted.iter().map(|&k| mirrors[k].reflectance.to_vec());
        let first = factors.next().unwrap_or_default();
        factors.fold(first, |product, r| product.iter().zip(&r).map(|(a, b)| a * b).collect())
    }

    /// Distances that rounding makes after so many reflections, each of which reaches further from where the scene is.
    fn rounding(&self, of_scene: f64) -> f64 {
        of_scene * (1 + 2 * self.windows.len()) as f64
    }
}

/// A polygon of the room as it is seen through windows.
fn unfolded(polygon: &Polygon, windows: &[Polygon]) -> Polygon {
    let mirror = |image: Polygon, window: &Polygon| image.mirrored(window.centroid(), window.normal());
    windows.iter().fold(polygon.clone(), mirror)
}

/// The part of a polygon in front of a window's plane: not what lies in it.
fn in_front(polygon: &Polygon, window: &Polygon, rounding: f64) -> Option<Polygon> {
    part(polygon, (window.centroid(), window.normal()), rounding + 2.0 * window.thickness())
}

/// The part behind.
fn behind(polygon: &Polygon, window: &Polygon, rounding: f64) -> Option<Polygon> {
    part(polygon, (window.centroid(), -window.normal()), rounding + 2.0 * window.thickness())
}

/// The part of a polygon in front of a plane, of which vertices within `slack` count as on it.
fn part(polygon: &Polygon, (point, normal): (DVec3, DVec3), slack: f64) -> Option<Polygon> {
    let slack = slack + 2.0 * polygon.thickness();
    let heights = polygon.vertices().iter().map(|v| (*v - point).dot(normal));
    let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)));
    if high <= slack {
        return None;
    }
    if low >= -slack {
        return Some(polygon.clone());
    }
    // One of the parts may be a sliver without an area.
    let whole = || ((polygon.centroid() - point).dot(normal) > 0.0).then(|| polygon.clone());
    polygon.split(point, normal, slack).map_or_else(whole, |(front, _)| Some(front))
}

/// What blocks segments that pass `windows`: copies of the scene between them, and frames around them.
fn blockers(scene: &Scene, windows: &[Polygon], rounding: f64) -> Occluders {
    let pieces: Vec<&Polygon> = scene.pieces().map(|(_, p)| p).collect();
    let last = windows.len();
    let mut points: Vec<DVec3> = Vec::new();
    let mut ends_in = |p: Option<Polygon>| p.iter().for_each(|p| points.extend(p.vertices()));
    for p in &pieces {
        ends_in(windows.iter().try_fold((*p).clone(), |p, window| in_front(&p, window, rounding)));
        ends_in(windows.iter().try_fold(unfolded(p, windows), |p, window| behind(&p, window, rounding)));
    }
    let frames: Vec<Polygon> = windows.iter().flat_map(|window| frame(window, &points, rounding)).collect();
    let ends = Ends::new(points, rounding);
    let mut polygons = Vec::new();
    for taken in 0..=last {
        let copies = pieces.iter().filter_map(|p| {
            let mut copy = unfolded(p, &windows[..taken]);
            if let Some(window) = taken.checked_sub(1).map(|k| &windows[k]) {
                copy = behind(&copy, window, rounding)?;
            }
            windows.get(taken).map_or(Some(copy.clone()), |window| in_front(&copy, window, rounding))
        });
        polygons.extend(copies.filter(|copy| ends.parted_by(copy)));
    }
    polygons.extend(frames);
    let owners = vec![0; polygons.len()];
    Occluders::new(polygons, owners)
}

/// Convex polygons that fill the plane of a window around it as far as segments between `points` reach.
fn frame(window: &Polygon, points: &[DVec3], rounding: f64) -> Vec<Polygon> {
    // Segments meet the plane inside the hull of the points, which is projected into it here.
    let (origin, (u, v)) = (window.vertices()[0], window.frame());
    let at = |p: &DVec3| ((*p - origin).dot(u), (*p - origin).dot(v));
    let (mut low, mut high) = ((f64::INFINITY, f64::INFINITY), (f64::NEG_INFINITY, f64::NEG_INFINITY));
    for (x, y) in points.iter().map(at) {
        (low, high) = ((low.0.min(x), low.1.min(y)), (high.0.max(x), high.1.max(y)));
    }
    let corner = |x: f64, y: f64| origin + u * x + v * y;
    let corners = [(low.0, low.1), (high.0, low.1), (high.0, high.1), (low.0, high.1)].map(|(x, y)| corner(x, y));
    // No rectangle where nothing is before the window or behind it.
    let (mut rest, mut frame) = (Polygon::new(&corners).ok(), Vec::new());
    for (a, b) in window.edges() {
        let Some((whole, outward)) = rest.as_ref().zip((b - a).cross(window.normal()).try_normalize()) else {
            continue;
        };
        frame.extend(part(whole, (a, outward), rounding));
        rest = part(whole, (a, -outward), rounding);
    }
    frame
}

impl Chain {
    /// What can send along the chain: the parts before all windows.
    fn before(&self, sources: &Facets) -> Facets {
        self.clipped(sources, |polygon| {
            self.windows.iter().try_fold(polygon.clone(), |p, window| in_front(&p, window, self.rounding))
        })
    }

    /// The last images of what can receive: the parts behind all windows.
    fn images(&self, targets: &Facets) -> Facets {
        self.clipped(targets, |polygon| {
            let image = unfolded(polygon, &self.windows);
            self.windows.iter().try_fold(image, |p, window| behind(&p, window, self.rounding))
        })
    }

    fn clipped(&self, facets: &Facets, clip: impl Fn(&Polygon) -> Option<Polygon>) -> Facets {
        let mut parts = Facets::new();
        for k in 0..facets.len() {
            let left: Vec<Polygon> = facets.polygons(k).iter().filter_map(&clip).collect();
            let covered = facets.covered(k) || left.is_empty();
            parts.push(left, covered);
        }
        parts
    }
}

/// Rows of F′ over the chains of one colour.
pub struct ImageRows<'a> {
    chains: Vec<LaidOut<'a>>,
    ends: (usize, usize),
    symmetric: bool,
    tolerance: f64,
}

/// A chain with what sends and receives along it.
struct LaidOut<'a> {
    estimator: Analytic<'a>,
    weight: f64,
    sources: Facets,
    images: Facets,
    blocks: Option<FacetBlocks>,
    seed: u64,
}

impl LaidOut<'_> {
    /// Exchange areas of source s with the images from `from` on, as many as there are `values`.
    fn fill(&self, s: usize, from: usize, tolerance: f64, values: &mut [f64]) -> (Cost, f64) {
        let Self { sources, images: targets, blocks, seed, .. } = self;
        let run = Run { sources, targets, blocks: blocks.as_ref(), s, from, tolerance, seed: *seed, numbers: None };
        self.estimator.exchange_run(&run, values)
    }
}

impl ImageRows<'_> {
    /// Entries of row s from target `from` on.
    fn fill(&self, s: usize, from: usize, values: &mut [f64]) -> (Cost, f64) {
        assert_eq!(values.len(), self.targets(), "row: length");
        values.fill(0.0);
        let (mut cost, mut bound) = (Cost { source_evaluations: 1, ..Cost::default() }, 0.0);
        let mut along = vec![0.0; values.len()];
        for chain in &self.chains {
            let mut worst = 0.0_f64;
            let mut add = |spent: (Cost, f64)| {
                cost += spent.0;
                worst = worst.max(spent.1);
            };
            // Each pair is asked from its first facet, one by one where that is not this one.
            let first = if self.symmetric { s.max(from) } else { from };
            (from..first).for_each(|t| add(chain.fill(t, s, self.tolerance, &mut along[t..=t])));
            if !chain.sources.covered(s) {
                add(chain.fill(s, first, self.tolerance, &mut along[first..]));
            } else {
                along[first..].fill(0.0);
            }
            bound += chain.weight * worst;
            values[from..].iter_mut().zip(&along[from..]).for_each(|(sum, value)| *sum += chain.weight * value);
        }
        (cost, bound)
    }
}

impl Rows for ImageRows<'_> {
    fn name(&self) -> &'static str {
        "images"
    }

    fn sources(&self) -> usize {
        self.ends.0
    }

    fn targets(&self) -> usize {
        self.ends.1
    }

    fn symmetric(&self) -> bool {
        self.symmetric
    }

    fn row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        Ok(self.fill(s, 0, values))
    }

    fn upper_row(&self, s: usize, values: &mut [f64]) -> Result<(Cost, f64), StoreError> {
        Ok(self.fill(s, if self.symmetric { s } else { 0 }, values))
    }
}
