//! A number by which a scene is known again: names what was computed of it, in files that are kept.

use radiosity_core::mix;
use radiosity_geometry::Scene;

/// A number that differs, but for chance, between scenes that differ in any corner or material.
pub fn fingerprint(scene: &Scene) -> u64 {
    let mut hash = mix(scene.surfaces.len() as u64);
    let mut add = |word: u64| hash = mix(hash ^ word);
    for surface in &scene.surfaces {
        add(surface.material as u64);
        for piece in &surface.pieces {
            add(piece.vertices().len() as u64);
            piece.vertices().iter().flat_map(|v| v.to_array()).for_each(|x| add(x.to_bits()));
        }
    }
    // Numbers are shown to their last bit.
    format!("{:?}", scene.materials).bytes().for_each(|byte| add(byte.into()));
    hash
}

#[cfg(test)]
mod tests {
    use radiosity_gallery::cornell_specular;

    use super::*;

    #[test]
    fn a_corner_a_material_or_its_place_makes_another_scene() {
        let scene = cornell_specular();
        let changed = |change: &dyn Fn(&mut Scene)| {
            let mut other = scene.clone();
            change(&mut other);
            fingerprint(&other)
        };
        assert_eq!(changed(&|_| {}), fingerprint(&scene));
        assert_ne!(changed(&|s| s.materials[0].reflectance[1] *= 0.999), fingerprint(&scene));
        assert_ne!(changed(&|s| s.surfaces[0].material += 1), fingerprint(&scene));
        assert_ne!(changed(&|s| s.surfaces.swap(0, 1)), fingerprint(&scene));
        assert_ne!(changed(&|s| s.surfaces[2].pieces.clear()), fingerprint(&scene));
    }
}
