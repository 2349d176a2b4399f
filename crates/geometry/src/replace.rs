//! What changes when one surface is replaced.

use std::collections::HashMap;

use glam::DVec3;

use crate::{Mesh, Occluders, Polygon, Scene, Surface};

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

/// Rows of the mesh after a replacement, against the mesh before it.
#[derive(Clone, Debug, PartialEq)]
pub struct ChangedRows {
    /// Elements of the new mesh whose row of form factors must be computed anew, ascending.
    pub changed: Vec<u32>,
    /// Elements whose row holds the same form factors as before, as (element now, element before), ascending. Entries
    /// of the row towards elements that are new are zero.
    pub kept: Vec<(u32, u32)>,
}

impl Scene {
    /// The scene with one surface replaced, and how it changed.
    ///
    /// # Panics
    ///
    /// If there is no such surface, or the new one names a material that is not in the list.
    pub fn replace(&self, surface: usize, with: Surface) -> (Self, Change) {
        assert!(with.material < self.materials.len(), "material {} of {}", with.material, self.materials.len());
        let old = &self.surfaces[surface];
        let change = if old.pieces != with.pieces {
            Change::Moved
        } else if self.materials[old.material] != self.materials[with.material] {
            Change::Recoloured
        } else {
            Change::None
        };
        let mut scene = self.clone();
        scene.surfaces[surface] = with;
        (scene, change)
    }
}

/// Rows that change between the meshes of two scenes that differ in one `surface`, meshed with the same settings.
///
/// A row is kept if its element is the same polygon as before and everything that changed (the surface before and
/// after, and cells that are cut or covered otherwise than before) lies behind its plane or in it: then no shaft from the element
/// is touched. This is conservative: rows that could see the surface but for something in between count as changed.
/// Replacing a material keeps every row. Takes time proportional to elements times changed polygons.
pub fn changed_rows(before: (&Scene, &Mesh), after: (&Scene, &Mesh), surface: usize) -> ChangedRows {
    let (old, new) = (before.1, after.1);
    // Elements by cell and, in a cut cell, by polygon.
    let cell = |mesh: &Mesh, e: usize| (mesh.elements[e].surface, mesh.elements[e].i, mesh.elements[e].j);
    let mut by_cell: HashMap<(u32, u32, u32), Vec<usize>> = HashMap::new();
    for e in 0..old.elements.len() {
        by_cell.entry(cell(old, e)).or_default().push(e);
    }
    let polygon = |mesh: &Mesh, e: usize| mesh.element_facets.polygons(e)[0].clone();
    let same = |e: usize, f: usize| {
        old.elements[f].covered == new.elements[e].covered
            && old.element_facets.polygons(f) == new.element_facets.polygons(e)
    };
    let matches: Vec<Option<usize>> =
        (0..new.elements.len()).map(|e| by_cell.get(&cell(new, e))?.iter().copied().find(|&f| same(e, f))).collect();

    // Vertices of everything that changed.
    let moved = before.0.surfaces[surface].pieces != after.0.surfaces[surface].pieces;
    let mut vertices: Vec<DVec3> = Vec::new();
    let mut add = |p: &Polygon| vertices.extend(p.vertices());
    if moved {
        before.0.surfaces[surface].pieces.iter().chain(&after.0.surfaces[surface].pieces).for_each(&mut add);
    }
    let mut survives = vec![false; old.elements.len()];
    matches.iter().flatten().for_each(|&f| survives[f] = true);
    (0..new.elements.len()).filter(|&e| matches[e].is_none()).for_each(|e| add(&polygon(new, e)));
    (0..old.elements.len()).filter(|&f| !survives[f]).for_each(|f| add(&polygon(old, f)));
    vertices.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    vertices.dedup();

    let margin = Occluders::rounding(after.0).max(Occluders::rounding(before.0));
    let mut rows = ChangedRows { changed: Vec::new(), kept: Vec::new() };
    for (e, &previous) in matches.iter().enumerate() {
        let plane = &new.element_facets.polygons(e)[0];
        let slack = margin + 2.0 * plane.thickness();
        let touched = || vertices.iter().any(|v| plane.signed_distance(*v) > slack);
        match previous {
            // A covered element has an empty row, whatever is in front of it.
            Some(f) if new.elements[e].covered || !touched() => rows.kept.push((e as u32, f as u32)),
            _ => rows.changed.push(e as u32),
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Material, MeshSettings, Subdivision,
        testing::{cube, scene_of},
    };

    fn mesh(scene: &Scene) -> Mesh {
        let settings = MeshSettings { elements: Subdivision::Uniform(3), patches: None, contacts: true };
        Mesh::new(scene, &Occluders::of_scene(scene), &settings).unwrap()
    }

    #[test]
    fn recolouring_changes_no_row() {
        let mut scene = scene_of(&cube(1.0));
        scene.materials.push(Material { name: "red".into(), reflectance: vec![0.2], emission: vec![1.0] });
        let red = Surface { material: 1, ..scene.surfaces[2].clone() };
        let (after, change) = scene.replace(2, red);
        assert_eq!(change, Change::Recoloured);
        let rows = changed_rows((&scene, &mesh(&scene)), (&after, &mesh(&after)), 2);
        assert_eq!((rows.changed.len(), rows.kept.len()), (0, 54));
    }

    /// A plate hanging in a room below its ceiling sees down only: it is moved sideways in its plane. All 54 wall cells
    /// see a side of it; of a second plate above it, looking up, no cell does.
    #[test]
    fn moving_a_plate_keeps_the_rows_that_look_away() {
        let plate = |x: f64, z: f64, up: bool| {
            let (a, b) = (DVec3::new(x, 0.0, z), DVec3::new(x + 0.2, 0.2, z));
            let mut corners = vec![a, DVec3::new(b.x, a.y, z), b, DVec3::new(a.x, b.y, z)];
            if !up {
                corners.reverse();
            }
            corners
        };
        let mut faces = cube(1.0);
        faces.extend([plate(0.0, 0.1, false), plate(0.0, 0.3, true)]);
        let scene = scene_of(&faces);
        let moved = Surface::from_loop("plate", 0, 0, &plate(0.1, 0.1, false)).unwrap().0;
        let (after, change) = scene.replace(6, moved);
        assert_eq!(change, Change::Moved);
        let rows = changed_rows((&scene, &mesh(&scene)), (&after, &mesh(&after)), 6);
        let surfaces: Vec<u32> = rows.kept.iter().map(|&(e, _)| mesh(&after).elements[e as usize].surface).collect();
        assert_eq!(surfaces, [7; 9]);
        assert_eq!(rows.changed.len(), 54 + 9);
    }
}
