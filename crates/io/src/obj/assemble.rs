//! From what the files say to a scene.

use std::collections::HashMap;
use std::f64::consts::PI;
use std::path::Path;

use glam::DVec3;
use radiosity_geometry::{FaceKind, Material, Scene, Surface};

use super::library::{Library, RawMaterial};
use super::scan::{Raw, RawFace};
use super::topology::{Loop, Points, Repeat, Repeats, edges};
use super::{ImportReport, Imported, ReadOptions};
use crate::ReadError;

/// Bands of an OBJ file: red, green, blue.
const BANDS: usize = 3;

/// Builds the scene; without a library every face gets one black material.
///
/// # Errors
///
/// [`ReadError`] if no face has an area or a material cannot be used.
pub(crate) fn assemble(
    path: &Path,
    raw: Raw,
    materials: Option<(&Library, &ReadOptions)>,
    mut report: ImportReport,
) -> Result<Imported, ReadError> {
    count_statements(path, &raw, &mut report);
    let specular = materials.is_some_and(|(_, options)| options.specular);
    let (materials, material_of) = match materials {
        Some((library, options)) => {
            report.warnings.extend(library.warnings.iter().cloned());
            Materials { path, library, options, report: &mut report, materials: Vec::new(), index: HashMap::new() }
                .of_faces(&raw.faces)?
        }
        None => (vec![uniform("none", 0.0)], vec![0; raw.faces.len()]),
    };
    let surfaces = surfaces(&raw, &material_of, &mut report);
    let empty = || ReadError::Empty {
        path: path.to_owned(),
        faces: raw.faces.len(),
        first_line: raw.faces.first().map(|face| face.line),
    };
    // All materials have three bands, so an empty scene is the only way to fail.
    let scene = Scene::new(surfaces, materials).map_err(|_| empty())?;
    report.warn(specular);
    Ok(Imported { scene, report })
}

/// Counts that need neither materials nor geometry.
fn count_statements(path: &Path, raw: &Raw, report: &mut ImportReport) {
    report.vertices = raw.vertices.len();
    report.faces = raw.faces.len();
    report.line_elements = raw.line_elements;
    report.point_elements = raw.point_elements;
    report.other_lines = raw.other.values().map(|(count, _)| count).sum();
    for (key, (count, line)) in &raw.other {
        report.warnings.push(format!("{}:{line}: lines '{key}' are left out ({count} of them)", path.display()));
    }
    for corners in raw.faces.iter().map(|face| face.corners.len()) {
        match corners {
            0..3 => {}
            3 => report.triangles += 1,
            4 => report.quads += 1,
            _ => report.polygons += 1,
        }
        report.most_corners = report.most_corners.max(corners);
    }
}

/// One surface a face, faces to be dropped without pieces.
fn surfaces(raw: &Raw, material_of: &[usize], report: &mut ImportReport) -> Vec<Surface> {
    let (mut points, mut repeats, mut kept) = (Points::default(), Repeats::default(), Vec::<Loop>::new());
    let mut surfaces = Vec::with_capacity(raw.faces.len());
    for (face, &material) in raw.faces.iter().zip(material_of) {
        let corners: Vec<DVec3> = face.corners.iter().map(|k| raw.vertices[*k]).collect();
        let dropped = || Surface { name: face.group.clone(), line: face.line, material, pieces: Vec::new() };
        // Coordinates are finite, so having no area is all that can be wrong with a face.
        let Ok((surface, kind)) = Surface::from_loop(&face.group, face.line, material, &corners) else {
            report.zero_area_dropped += 1;
            surfaces.push(dropped());
            continue;
        };
        let closed = points.close(&corners);
        let repeat = repeats.enter(&closed);
        report.duplicate_faces += usize::from(repeat != Repeat::New);
        report.two_sided_sheets += usize::from(repeat == Repeat::OtherSide);
        if repeat == Repeat::Same {
            // Two coincident faces that look the same way would each claim the same light.
            report.repeated_dropped += 1;
            surfaces.push(dropped());
            continue;
        }
        match kind {
            FaceKind::Convex => {}
            FaceKind::Concave => report.concave_split += 1,
            FaceKind::NonPlanar => report.non_planar_split += 1,
        }
        kept.push(closed);
        surfaces.push(surface);
    }
    (report.open_edges, report.turned_edges) = edges(kept.iter());
    surfaces
}

fn uniform(name: &str, reflectance: f64) -> Material {
    Material::diffuse(name, vec![reflectance; BANDS], vec![0.0; BANDS])
}

/// Materials of faces, made when first used.
struct Materials<'a> {
    path: &'a Path,
    library: &'a Library,
    options: &'a ReadOptions,
    report: &'a mut ImportReport,
    materials: Vec<Material>,
    index: HashMap<&'a str, usize>,
}

impl<'a> Materials<'a> {
    /// The materials, and the index of that of every face.
    fn of_faces(mut self, faces: &'a [RawFace]) -> Result<(Vec<Material>, Vec<usize>), ReadError> {
        let mut of = Vec::with_capacity(faces.len());
        for (k, face) in faces.iter().enumerate() {
            // Exporters write (null) where an object has no material.
            let defined = self.library.materials.get(&face.material);
            let name = if face.material == "(null)" && defined.is_none() { "" } else { &face.material };
            if defined.is_none() {
                if name.is_empty() {
                    self.report.faces_without_material += 1;
                } else {
                    self.report.faces_of_missing_materials += 1;
                }
            }
            let index = match self.index.get(name) {
                Some(index) => *index,
                None => {
                    let material = match defined {
                        Some(raw) => self.defined(raw)?,
                        None => self.missing(k, face, name)?,
                    };
                    self.materials.push(material);
                    self.index.insert(name, self.materials.len() - 1);
                    self.materials.len() - 1
                }
            };
            of.push(index);
        }
        Ok((self.materials, of))
    }

    /// The stand-in for a material that is not defined.
    fn missing(&mut self, k: usize, face: &RawFace, name: &str) -> Result<Material, ReadError> {
        let Some(reflectance) = self.options.default_reflectance else {
            return Err(ReadError::MissingMaterial {
                path: self.path.to_owned(),
                line: face.line,
                face: k,
                material: name.to_owned(),
                not_found: self.report.libraries_not_found.clone(),
            });
        };
        if !name.is_empty() {
            self.report.materials_missing.push(name.to_owned());
        }
        Ok(uniform(name, reflectance))
    }

    /// A material of the library: ρ = Kd, E = π·Ke.
    fn defined(&mut self, raw: &RawMaterial) -> Result<Material, ReadError> {
        let report = &mut *self.report;
        report.textures.extend(raw.textures.iter().cloned());
        if !raw.specular.is_empty() {
            report.specular.push(format!("{}: {}", raw.name, raw.specular));
        }
        if !raw.transparent.is_empty() {
            report.transparent.push(format!("{}: {}", raw.name, raw.transparent));
        }
        if raw.kd.is_none() {
            report.materials_without_kd.push(raw.name.clone());
        }
        // Without Kd a light is black and anything else as unknown as a missing material.
        let emits = raw.ke.iter().any(|v| *v > 0.0);
        let unknown = if emits { 0.0 } else { self.options.default_reflectance.unwrap_or(0.0) };
        let kd = raw.kd.unwrap_or([unknown; BANDS]);
        let sum = [0, 1, 2].map(|b| kd[b] + raw.ks[b]);
        let (largest_kd, largest_sum) = (kd.into_iter().fold(0.0, f64::max), sum.into_iter().fold(0.0, f64::max));
        if largest_kd >= 1.0 {
            report.kd_at_least_1.push(raw.name.clone());
        }
        if largest_sum > 1.0 {
            report.kd_ks_above_1.push(raw.name.clone());
        }
        let (reflectance, ks) = match self.options.clamp_reflectance {
            Some(clamp) => {
                let factor = f64::min(1.0, f64::min(clamp / largest_kd, 1.0 / largest_sum));
                if factor < 1.0 {
                    report.clamped.push(raw.name.clone());
                }
                // The minimum takes away what rounding may have added.
                let clamped = |k: f64| if factor < 1.0 { f64::min(k * factor, clamp) } else { k };
                (kd.map(clamped), raw.ks.map(clamped))
            }
            None => {
                let (path, material) = (raw.path.clone(), raw.name.clone());
                if largest_kd >= 1.0 {
                    return Err(ReadError::Reflectance { path, line: raw.lines.kd, material, value: largest_kd });
                }
                if largest_sum > 1.0 {
                    return Err(ReadError::ReflectanceSum { path, line: raw.lines.ks, material, value: largest_sum });
                }
                (kd, raw.ks)
            }
        };
        let diffuse = if raw.optics.is_bare() { [0.0; BANDS] } else { reflectance };
        Ok(Material {
            specular: raw.optics.specular(reflectance, ks),
            ..Material::diffuse(&raw.name, diffuse.to_vec(), raw.ke.map(|l| PI * l).to_vec())
        })
    }
}
