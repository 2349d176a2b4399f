//! A scene as paths of light see it: what a ray meets, how it scatters there, and where lights are.

use std::f64::consts::PI;

use glam::DVec3;
use radiosity_geometry::{Occluders, Polygon, Scene};

use crate::brdf::SpecularSurfaces;

/// Where a ray arrives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The surface.
    pub surface: usize,
    /// Who owns the hit: the facet with [`Occluders::of_parts`], `u32::MAX` where there is none.
    pub owner: u32,
    /// The piece ([`Scene::pieces`]).
    pub piece: usize,
    /// The point.
    pub point: DVec3,
    /// Normal of the front.
    pub normal: DVec3,
    /// Whether the ray meets the front.
    pub front: bool,
    /// Distance from the origin of the ray.
    pub distance: f64,
}

/// A point drawn on a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightPoint {
    /// The surface.
    pub surface: usize,
    /// The piece.
    pub piece: usize,
    /// The point.
    pub point: DVec3,
    /// Normal of the front, into whose side the light goes.
    pub normal: DVec3,
    /// Density over area, in 1/m².
    pub density: f64,
}

/// A scene ready for the tracing of paths.
pub struct Stage<'a> {
    scene: &'a Scene,
    occluders: &'a Occluders,
    surface_of: Vec<u32>,
    specular: SpecularSurfaces,
    /// Pieces that emit, with the share of the power that they and those before them have.
    lights: Vec<(u32, f64)>,
    /// Of every piece, the density of points drawn on it, 0 where it does not emit.
    densities: Vec<f64>,
}

impl<'a> Stage<'a> {
    /// `scene` with the polygons of `occluders`, which are its pieces in order: [`Occluders::of_scene`] or [`Occluders::of_parts`].
    ///
    /// # Panics
    ///
    /// If there are not as many polygons as pieces.
    pub fn new(scene: &'a Scene, occluders: &'a Occluders) -> Self {
        let surface_of: Vec<u32> = scene.pieces().map(|(s, _)| s as u32).collect();
        assert_eq!(surface_of.len(), occluders.len(), "pieces of the scene and polygons");
        let emission = |s: usize| scene.materials[scene.surfaces[s].material].emission.iter().sum::<f64>();
        let powers: Vec<f64> = scene.pieces().map(|(s, p)| emission(s) * p.area()).collect();
        let total: f64 = powers.iter().sum();
        let (mut lights, mut until) = (Vec::new(), 0.0);
        for (piece, power) in (0..).zip(&powers) {
            if *power > 0.0 {
                until += power / total;
                lights.push((piece, until));
            }
        }
        let density = |(power, (_, p)): (&f64, (usize, &Polygon))| {
            if *power > 0.0 { power / total / p.area() } else { 0.0 }
        };
        let densities = powers.iter().zip(scene.pieces()).map(density).collect();
        Self { scene, occluders, surface_of, specular: SpecularSurfaces::new(scene), lights, densities }
    }

    /// The scene.
    pub fn scene(&self) -> &'a Scene {
        self.scene
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.scene.bands()
    }

    /// What is specular.
    pub fn specular(&self) -> &SpecularSurfaces {
        &self.specular
    }

    /// What a ray meets first.
    pub fn first(&self, origin: DVec3, direction: DVec3) -> Option<Place> {
        let hit = self.occluders.first_hit(origin, direction)?;
        let piece = hit.polygon as usize;
        Some(Place {
            surface: self.surface_of[piece] as usize,
            owner: hit.owner,
            piece,
            point: origin + direction * hit.distance,
            normal: self.occluders.polygons()[piece].normal(),
            front: hit.front,
            distance: hit.distance,
        })
    }

    /// Whether anything stands between two points.
    pub fn occluded(&self, p: DVec3, q: DVec3) -> bool {
        self.occluders.occluded(p, q)
    }

    /// E of every band of a surface.
    pub fn emission(&self, surface: usize) -> &[f64] {
        &self.scene.materials[self.scene.surfaces[surface].material].emission
    }

    /// Diffuse ρ of every band of a surface.
    pub fn reflectance(&self, surface: usize) -> &[f64] {
        &self.scene.materials[self.scene.surfaces[surface].material].reflectance
    }

    /// Polygons that emit.
    pub fn lights(&self) -> impl Iterator<Item = &Polygon> {
        self.lights.iter().map(|&(piece, _)| &self.occluders.polygons()[piece as usize])
    }

    /// A point on a light, drawn in proportion to power; `None` where there is no light.
    pub fn light_point(&self, u: [f64; 3]) -> Option<LightPoint> {
        let last = self.lights.len().checked_sub(1)?;
        let k = self.lights.partition_point(|&(_, until)| until <= u[0]).min(last);
        let piece = self.lights[k].0 as usize;
        let polygon = &self.occluders.polygons()[piece];
        Some(LightPoint {
            surface: self.surface_of[piece] as usize,
            piece,
            point: polygon.sample(u[1], u[2]),
            normal: polygon.normal(),
            density: self.densities[piece],
        })
    }

    /// Density over solid angle in 1/sr, seen from a distance, with which [`Self::light_point`] draws a point of a piece.
    pub fn light_density(&self, piece: usize, distance: f64, cos: f64) -> f64 {
        if cos > 0.0 { self.densities[piece] * distance * distance / cos } else { 0.0 }
    }
}

/// The radiance of a diffuse emitter of exitance E, or of a reflector of radiosity B, is that over π.
pub const RADIANCE: f64 = 1.0 / PI;
