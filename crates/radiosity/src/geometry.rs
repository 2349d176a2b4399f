//! A scene with its mesh, as estimators and systems see it: exposed elements only.

use std::sync::{Arc, OnceLock};

use radiosity_core::BandValues;
use radiosity_geometry::mesh::{Mesh, MeshError, MeshSettings};
use radiosity_geometry::{Facets, Occluders, Scene};

use crate::Strategy;
use crate::senders::shining;

/// A scene, its mesh, and the facets that take part in the exchange of light.
///
/// Elements inside solids (a floor under a block) are no unknowns: they stay in the mesh, for output, and out of
/// everything here.
pub struct Geometry<'a> {
    scene: &'a Scene,
    mesh: Arc<Mesh>,
    blockers: Arc<Occluders>,
    element_occluders: OnceLock<Occluders>,
    patch_occluders: OnceLock<Occluders>,
    /// Mesh element of every exposed element.
    exposed: Vec<u32>,
    elements: Facets,
    patches: Facets,
    /// Mesh patch of every patch with an exposed element.
    exposed_patches: Vec<u32>,
    parent: Vec<u32>,
    emitters: (Facets, Vec<u32>),
    senders: OnceLock<(Facets, Vec<u32>)>,
    /// Bands of the scene that take part.
    bands: Vec<usize>,
    /// Whether every exposed element that one of these sees takes part, or gives its light.
    complete: bool,
    /// Light of what takes no part.
    given: Option<Given>,
}

/// Light that is known before anything is solved, on the elements that take part.
pub(crate) struct Given {
    /// H in the bands that take part.
    pub(crate) irradiance: BandValues,
    /// Exchange area of each element with all that it comes from.
    pub(crate) exchange: Vec<f64>,
}

/// Surfaces that emit, each as one facet, with the index of each surface.
fn emitters(scene: &Scene) -> (Facets, Vec<u32>) {
    let emits = |s: &u32| {
        let surface = &scene.surfaces[*s as usize];
        scene.materials[surface.material].emission.iter().any(|&e| e > 0.0) && !surface.pieces.is_empty()
    };
    whole((0..scene.surfaces.len() as u32).filter(emits).collect(), scene)
}

/// Surfaces, each as one facet, with the index of each.
fn whole(surfaces: Vec<u32>, scene: &Scene) -> (Facets, Vec<u32>) {
    let mut facets = Facets::new();
    surfaces.iter().for_each(|&s| facets.push(scene.surfaces[s as usize].pieces.clone(), false));
    (facets, surfaces)
}

impl<'a> Geometry<'a> {
    /// Meshes `scene`.
    ///
    /// # Errors
    ///
    /// [`MeshError`] if the settings make no mesh.
    pub fn new(scene: &'a Scene, settings: &MeshSettings) -> Result<Self, MeshError> {
        let mesh = Mesh::new(scene, &Occluders::of_scene(scene), settings)?;
        Ok(Self::of_mesh(scene, mesh, Arc::new(Occluders::blocking(scene))))
    }

    /// Meshes `scene` as `strategy` says.
    ///
    /// # Errors
    ///
    /// [`MeshError`] if the settings make no mesh.
    pub fn of_strategy(scene: &'a Scene, strategy: &Strategy) -> Result<Self, MeshError> {
        Self::of_strategy_on(scene, strategy, &|_| true)
    }

    /// [`Self::of_strategy`] with elements on the surfaces that `meshed` names alone; the others block all the same.
    pub(crate) fn of_strategy_on(
        scene: &'a Scene,
        strategy: &Strategy,
        meshed: &dyn Fn(usize) -> bool,
    ) -> Result<Self, MeshError> {
        let mut mesh = Mesh::on_surfaces(scene, &Occluders::of_scene(scene), &strategy.mesh, meshed)?;
        for _ in 0..strategy.contact_level {
            mesh = mesh.refined(&mesh.cut_by_contacts()).mesh;
        }
        Ok(Self::of_mesh(scene, mesh, Arc::new(Occluders::blocking(scene))))
    }

    /// The same scene on another mesh of it.
    pub(crate) fn on(&self, mesh: Mesh) -> Self {
        Self::of_mesh(self.scene, mesh, Arc::clone(&self.blockers))
    }

    fn of_mesh(scene: &'a Scene, mesh: Mesh, blockers: Arc<Occluders>) -> Self {
        let mut exposed: Vec<u32> = (0..mesh.elements.len() as u32).collect();
        exposed.retain(|&e| !mesh.elements[e as usize].covered);
        Self::of_exposed(scene, Arc::new(mesh), blockers, exposed)
    }

    /// The same mesh with some of the elements, ascending, and some of the bands taking part; `complete` if they see no others.
    pub(crate) fn part(&self, elements: &[u32], bands: &[usize], complete: bool) -> Self {
        let exposed = elements.iter().map(|&e| self.exposed[e as usize]).collect();
        let part = Self::of_exposed(self.scene, Arc::clone(&self.mesh), Arc::clone(&self.blockers), exposed);
        Self { bands: bands.to_vec(), complete: self.complete && complete, ..part }
    }

    /// The same with light between surfaces that `among` names alone: what cannot lie between two of them does not block.
    pub(crate) fn among(self, among: &dyn Fn(usize) -> bool) -> Self {
        if (0..self.scene.surfaces.len()).all(among) {
            return self;
        }
        Self { blockers: Arc::new(Occluders::blocking_among(self.scene, among)), ..self }
    }

    fn of_exposed(scene: &'a Scene, mesh: Arc<Mesh>, blockers: Arc<Occluders>, exposed: Vec<u32>) -> Self {
        // Patches that keep an exposed element, renumbered in order.
        let mut number = vec![u32::MAX; mesh.patch_facets.len()];
        for &e in &exposed {
            number[mesh.elements[e as usize].parent as usize] = 0;
        }
        let mut exposed_patches = Vec::new();
        for (p, number) in (0_u32..).zip(&mut number).filter(|(_, number)| **number == 0) {
            *number = exposed_patches.len() as u32;
            exposed_patches.push(p);
        }
        let (patches, elements) = (mesh.patch_facets.select(&exposed_patches), mesh.element_facets.select(&exposed));
        let parent = exposed.iter().map(|&e| number[mesh.elements[e as usize].parent as usize]).collect();
        let (element_occluders, patch_occluders) = (OnceLock::new(), OnceLock::new());
        let (emitters, senders) = (emitters(scene), OnceLock::new());
        Self {
            scene,
            mesh,
            blockers,
            element_occluders,
            patch_occluders,
            exposed,
            elements,
            patches,
            exposed_patches,
            parent,
            emitters,
            senders,
            bands: (0..scene.bands()).collect(),
            complete: true,
            given: None,
        }
    }

    /// Whether rows of the elements that take part should sum to 1: the scene is closed, and they see no others.
    pub(crate) fn closed(&self) -> bool {
        self.complete && self.scene.closed()
    }

    /// The scene.
    pub fn scene(&self) -> &'a Scene {
        self.scene
    }

    /// The whole mesh, covered elements included.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Mesh element of every exposed element.
    pub fn exposed(&self) -> &[u32] {
        &self.exposed
    }

    /// Exposed element of every element of the mesh; `usize::MAX` of covered ones.
    pub(crate) fn places(&self) -> Vec<usize> {
        let mut places = vec![usize::MAX; self.mesh.elements.len()];
        self.exposed.iter().enumerate().for_each(|(k, &e)| places[e as usize] = k);
        places
    }

    /// Exposed elements: m of them.
    pub fn elements(&self) -> &Facets {
        &self.elements
    }

    /// Patches with an exposed element: n of them.
    pub fn patches(&self) -> &Facets {
        &self.patches
    }

    /// Mesh patch of every patch of [`Self::patches`].
    pub(crate) fn exposed_patches(&self) -> &[u32] {
        &self.exposed_patches
    }

    /// Patch of every exposed element.
    pub fn parent(&self) -> &[u32] {
        &self.parent
    }

    /// Surfaces of the scene that can block something.
    pub fn blockers(&self) -> &Occluders {
        &self.blockers
    }

    /// The scene as blocker and receiver of rays: what is hit is owned by the exposed element in which the hit lies. Built when first needed.
    pub fn element_occluders(&self) -> &Occluders {
        self.element_occluders.get_or_init(|| {
            let faces = self.mesh.faces();
            let carriers: Vec<u32> = self.exposed.iter().map(|&e| faces[e as usize]).collect();
            Occluders::of_parts(self.scene, &self.elements, &carriers)
        })
    }

    /// As [`Self::element_occluders`], with the patch in which a hit lies as its owner.
    pub(crate) fn patch_occluders(&self) -> &Occluders {
        self.patch_occluders.get_or_init(|| {
            let faces = self.mesh.faces();
            let mut face = vec![0; self.patches.len()];
            self.exposed.iter().zip(&self.parent).for_each(|(&e, &p)| face[p as usize] = faces[e as usize]);
            let carriers: Vec<u32> = self.patches.iter_polygons().map(|(p, _)| face[p]).collect();
            Occluders::of_parts(self.scene, &self.patches, &carriers)
        })
    }

    /// Surfaces that emit, each as one facet, with the index of each surface.
    pub fn emitters(&self) -> (&Facets, &[u32]) {
        (&self.emitters.0, &self.emitters.1)
    }

    /// The emitters, and the few surfaces that shine by their light: those of which rows of rays get exact totals
    /// ([`Method::RaysAndEmitters`](crate::Method::RaysAndEmitters)). Found when first needed.
    pub fn senders(&self) -> (&Facets, &[u32]) {
        let (facets, surfaces) = self.senders.get_or_init(|| {
            let emitters = self.emitters();
            let shining = shining(self.scene, emitters, &self.blockers);
            whole(emitters.1.iter().copied().chain(shining).collect(), self.scene)
        });
        (facets, surfaces)
    }

    /// Surface of every exposed element.
    pub fn surfaces(&self) -> Vec<u32> {
        self.exposed.iter().map(|&e| self.mesh.elements[e as usize].surface).collect()
    }

    /// Gives it light that is known.
    pub(crate) fn give(&mut self, given: Option<Given>) {
        self.given = given;
    }

    /// The light that is known.
    pub(crate) fn given(&self) -> Option<&Given> {
        self.given.as_ref()
    }

    /// Emission E of the exposed elements, and what they reflect of light that is known: what the others' light adds to.
    pub fn emission(&self) -> BandValues {
        let mut e = self.select(&self.mesh.emission(self.scene));
        if let Some(given) = &self.given {
            let reflected = self.reflectance();
            let reflected = reflected.values().iter().zip(given.irradiance.values()).map(|(rho, h)| rho * h);
            e.values_mut().iter_mut().zip(reflected).for_each(|(e, reflected)| *e += reflected);
        }
        e
    }

    /// Reflectance ρ of the exposed elements.
    pub fn reflectance(&self) -> BandValues {
        self.select(&self.mesh.reflectance(self.scene))
    }

    fn select(&self, values: &[f64]) -> BandValues {
        let (all, m) = (self.mesh.elements.len(), self.exposed.len());
        let bands = self.bands.iter().flat_map(|&b| self.exposed.iter().map(move |&e| (b, e as usize)));
        BandValues::new(bands.map(|(b, e)| values[b * all + e]).collect(), m)
    }

    /// Values on the exposed elements spread to the whole mesh, 0 on covered elements.
    pub fn spread(&self, values: &BandValues) -> BandValues {
        let mut all = BandValues::zeros(values.count(), self.mesh.elements.len());
        for b in 0..values.count() {
            let (to, from) = (all.band_mut(b), values.band(b));
            self.exposed.iter().zip(from).for_each(|(&e, &value)| to[e as usize] = value);
        }
        all
    }
}
