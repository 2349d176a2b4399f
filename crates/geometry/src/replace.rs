//! What changes between two scenes that list the same surfaces.

use std::collections::HashMap;

use glam::DVec3;

use crate::{Facets, Occluders, Polygon, Scene, Surface};

/// How a replaced surface differs from the old one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Nothing but its name or line, if anything.
    None,
    /// Its material, hence its emission and reflectance: no form factor changes.
    Recoloured,
    /// Its shape or place (and perhaps its material).
    Moved,
}

/// Surfaces in which two scenes differ; surface k of one is surface k of the other.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SceneChange {
    /// Surfaces of the same shape in the same place with another emission or reflectance, ascending.
    pub recoloured: Vec<usize>,
    /// Surfaces of another shape or in another place (and perhaps of another material), ascending.
    pub moved: Vec<usize>,
}

/// Why two scenes cannot be compared surface by surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CompareError {
    /// Another number of surfaces: which of them is which is not known.
    #[error(
        "the scene before has {before} surfaces, the one after {after}; only scenes with the same list of surfaces can be compared"
    )]
    Surfaces {
        /// Surfaces before.
        before: usize,
        /// Surfaces after.
        after: usize,
    },
    /// Another number of bands.
    #[error("the materials have {before} bands before and {after} after")]
    Bands {
        /// Bands before.
        before: usize,
        /// Bands after.
        after: usize,
    },
}

impl Scene {
    /// The scene with one surface replaced, and how it changed.
    ///
    /// # Panics
    ///
    /// If there is no such surface, or the new one names a material that is not in the list.
    pub fn replace(&self, surface: usize, with: Surface) -> (Self, Change) {
        assert!(with.material < self.materials.len(), "material {} of {}", with.material, self.materials.len());
        let mut scene = self.clone();
        scene.surfaces[surface] = with;
        let change = scene.change_of(surface, self);
        (scene, change)
    }

    /// The surfaces in which this scene differs from the one `before`; names of surfaces and materials do not count.
    ///
    /// # Errors
    ///
    /// [`CompareError`] if the scenes do not list the same surfaces, in the same bands.
    pub fn change_from(&self, before: &Self) -> Result<SceneChange, CompareError> {
        let (has, had) = (self.surfaces.len(), before.surfaces.len());
        if has != had {
            return Err(CompareError::Surfaces { before: had, after: has });
        }
        if self.bands() != before.bands() {
            return Err(CompareError::Bands { before: before.bands(), after: self.bands() });
        }
        let mut change = SceneChange::default();
        for surface in 0..has {
            match self.change_of(surface, before) {
                Change::None => {}
                Change::Recoloured => change.recoloured.push(surface),
                Change::Moved => change.moved.push(surface),
            }
        }
        Ok(change)
    }

    fn change_of(&self, surface: usize, before: &Self) -> Change {
        let (old, new) = (&before.surfaces[surface], &self.surfaces[surface]);
        let (was, is) = (&before.materials[old.material], &self.materials[new.material]);
        if old.pieces != new.pieces {
            Change::Moved
        } else if (&was.emission, &was.reflectance) != (&is.emission, &is.reflectance) {
            Change::Recoloured
        } else {
            Change::None
        }
    }
}

/// Which facets of a mesh were facets of an earlier one: the same polygons of the same surface, in the same order.
///
/// Facets that kept their polygons but changed their order among others count as new, so that the earlier indices ascend: what
/// depends on the order of a pair stays as it was.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FacetMap {
    /// Earlier index of every facet.
    earlier: Vec<Option<u32>>,
    /// Present index of every earlier facet.
    later: Vec<Option<u32>>,
}

impl FacetMap {
    /// Compares facets, each list with the surface of every facet, in time proportional to their number.
    ///
    /// # Panics
    ///
    /// If there is not one surface a facet.
    pub fn new(before: (&Facets, &[u32]), after: (&Facets, &[u32])) -> Self {
        for (facets, surfaces) in [before, after] {
            assert_eq!(facets.len(), surfaces.len(), "a surface for every facet");
        }
        // Neighbours share corners, so the first corner alone leaves a few to choose from.
        let key = |(facets, surfaces): (&Facets, &[u32]), k: usize| {
            let corner = facets.polygons(k).first().map(|p| p.vertices()[0].to_array().map(f64::to_bits));
            (surfaces[k], corner)
        };
        let mut candidates: HashMap<_, Vec<u32>> = HashMap::new();
        (0..before.0.len()).for_each(|k| candidates.entry(key(before, k)).or_default().push(k as u32));
        let same = |new: usize, old: u32| {
            let old = old as usize;
            before.0.covered(old) == after.0.covered(new) && before.0.polygons(old) == after.0.polygons(new)
        };
        let (mut earlier, mut later) = (vec![None; after.0.len()], vec![None; before.0.len()]);
        let mut next = 0;
        for (new, place) in earlier.iter_mut().enumerate() {
            let candidates = candidates.get(&key(after, new));
            *place = candidates.and_then(|c| c.iter().copied().find(|&old| old >= next && same(new, old)));
            if let Some(old) = *place {
                later[old as usize] = Some(new as u32);
                next = old + 1;
            }
        }
        Self { earlier, later }
    }

    /// Earlier index of every facet, ascending; `None` of new ones.
    pub fn earlier(&self) -> &[Option<u32>] {
        &self.earlier
    }

    /// Present index of every earlier facet, ascending; `None` of those that are gone.
    pub fn later(&self) -> &[Option<u32>] {
        &self.later
    }

    /// Facets that were not there before, ascending.
    pub fn new_facets(&self) -> Vec<u32> {
        (0..self.earlier.len() as u32).filter(|&k| self.earlier[k as usize].is_none()).collect()
    }

    /// Earlier facets that are no more, ascending.
    pub fn gone(&self) -> Vec<u32> {
        (0..self.later.len() as u32).filter(|&k| self.later[k as usize].is_none()).collect()
    }
}

/// Everything that is no longer where it was, or not as it was: the points that rows of form factors must not look at to stay as they are.
///
/// A row is the same as before if its source is, and all of this lies behind the plane of the source or in it: then no ray from the source
/// meets it. This is conservative: a row that could see a change but for something in between counts as changed.
#[derive(Clone, Debug)]
pub struct Disturbed {
    vertices: Vec<DVec3>,
    /// Distance that rounding makes in either scene.
    rounding: f64,
}

impl Disturbed {
    /// The `moved` surfaces, in their old and in their new place.
    ///
    /// # Panics
    ///
    /// If one of the scenes has no such surface.
    pub fn new(before: &Scene, after: &Scene, moved: &[usize]) -> Self {
        let rounding = Occluders::rounding(after).max(Occluders::rounding(before));
        let mut disturbed = Self { vertices: Vec::new(), rounding };
        for &surface in moved {
            disturbed.add(before.surfaces[surface].pieces.iter().chain(&after.surfaces[surface].pieces));
        }
        disturbed
    }

    /// Adds the facets of a mesh that are new and those that are gone: cells that are cut or covered otherwise than before, far from
    /// what moved if its edges end there.
    pub fn add_facets(&mut self, map: &FacetMap, before: &Facets, after: &Facets) {
        self.add(map.gone().iter().flat_map(|&k| before.polygons(k as usize)));
        self.add(map.new_facets().iter().flat_map(|&k| after.polygons(k as usize)));
    }

    fn add<'p>(&mut self, polygons: impl Iterator<Item = &'p Polygon>) {
        self.vertices.extend(polygons.flat_map(Polygon::vertices));
        self.vertices.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
        self.vertices.dedup();
    }

    /// Whether anything of it lies in front of the plane of one of the polygons.
    pub fn in_front_of(&self, polygons: &[Polygon]) -> bool {
        polygons.iter().any(|plane| {
            let slack = self.rounding + 2.0 * plane.thickness();
            self.vertices.iter().any(|v| plane.signed_distance(*v) > slack)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Material, Mesh, MeshSettings, Subdivision,
        testing::{cube, scene_of},
    };

    fn mesh(scene: &Scene) -> Mesh {
        let settings = MeshSettings { elements: Subdivision::Uniform(3), patches: None, contacts: true };
        Mesh::new(scene, &Occluders::of_scene(scene), &settings).unwrap()
    }

    fn surfaces(mesh: &Mesh) -> Vec<u32> {
        mesh.elements.iter().map(|e| e.surface).collect()
    }

    fn map(before: &Mesh, after: &Mesh) -> FacetMap {
        FacetMap::new((&before.element_facets, &surfaces(before)), (&after.element_facets, &surfaces(after)))
    }

    /// A square plate of edge 0.2 with its first corner at (x, 0, z).
    fn plate(x: f64, z: f64, up: bool) -> Vec<DVec3> {
        let (a, b) = (DVec3::new(x, 0.0, z), DVec3::new(x + 0.2, 0.2, z));
        let mut corners = vec![a, DVec3::new(b.x, a.y, z), b, DVec3::new(a.x, b.y, z)];
        if !up {
            corners.reverse();
        }
        corners
    }

    #[test]
    fn recolouring_leaves_every_facet_where_it_was() {
        let mut scene = scene_of(&cube(1.0));
        scene.materials.push(Material::diffuse("red", vec![0.2], vec![1.0]));
        let red = Surface { material: 1, ..scene.surfaces[2].clone() };
        let (after, change) = scene.replace(2, red);
        assert_eq!(change, Change::Recoloured);
        assert_eq!(after.change_from(&scene), Ok(SceneChange { recoloured: vec![2], moved: vec![] }));
        let map = map(&mesh(&scene), &mesh(&after));
        assert_eq!((map.new_facets().len(), map.gone().len()), (0, 0));
        assert!(map.earlier().iter().enumerate().all(|(k, earlier)| *earlier == Some(k as u32)));
    }

    #[test]
    fn scenes_of_other_surfaces_or_bands_are_refused() {
        let scene = scene_of(&cube(1.0));
        let fewer = scene_of(&cube(1.0)[..5]);
        assert_eq!(scene.change_from(&fewer), Err(CompareError::Surfaces { before: 5, after: 6 }));
        let mut coloured = scene.clone();
        coloured.materials[0].reflectance.push(0.5);
        coloured.materials[0].emission.push(0.0);
        assert_eq!(coloured.change_from(&scene), Err(CompareError::Bands { before: 1, after: 2 }));
    }

    /// A plate hanging in a room below its ceiling sees down only: it is moved sideways in its plane. All 54 wall cells
    /// see a side of it; of a second plate above it, looking up, no cell does.
    #[test]
    fn moving_a_plate_leaves_what_looks_away_undisturbed() {
        let mut faces = cube(1.0);
        faces.extend([plate(0.0, 0.1, false), plate(0.0, 0.3, true)]);
        let scene = scene_of(&faces);
        let moved = Surface::from_loop("plate", 0, 0, &plate(0.1, 0.1, false)).unwrap().0;
        let (after, change) = scene.replace(6, moved);
        assert_eq!(change, Change::Moved);
        let (old, new) = (mesh(&scene), mesh(&after));
        let map = map(&old, &new);
        assert_eq!((map.new_facets().len(), map.gone().len()), (9, 9));
        let mut disturbed = Disturbed::new(&scene, &after, &[6]);
        disturbed.add_facets(&map, &old.element_facets, &new.element_facets);
        let kept = (0..new.elements.len())
            .filter(|&e| map.earlier()[e].is_some() && !disturbed.in_front_of(new.element_facets.polygons(e)));
        assert_eq!(kept.map(|e| new.elements[e].surface).collect::<Vec<_>>(), [7; 9]);
    }

    /// Two triangles of one surface listed the other way round: the second keeps its place, the first cannot keep both
    /// its place and its order.
    #[test]
    fn facets_in_another_order_count_as_new() {
        let triangle = |x: f64| Polygon::new(&[DVec3::X * x, DVec3::X * (x + 1.0), DVec3::new(x, 1.0, 0.0)]).unwrap();
        let list = |order: [f64; 3]| {
            let mut facets = Facets::new();
            order.iter().for_each(|&x| facets.push(vec![triangle(x)], false));
            facets
        };
        let map = FacetMap::new((&list([0.0, 1.0, 2.0]), &[0; 3]), (&list([1.0, 0.0, 2.0]), &[0; 3]));
        assert_eq!(map.earlier(), [Some(1), None, Some(2)]);
        assert_eq!((map.later(), map.gone()), (&[None, Some(0), Some(2)][..], vec![0]));
    }
}
