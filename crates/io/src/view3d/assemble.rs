//! From statements to a scene.

use std::collections::HashMap;
use std::path::Path;

use radiosity_geometry::{FaceKind, Material, Polygon, Scene, Surface};

use super::scan::{Raw, RawSurface};
use super::subsurface::cut_out;
use super::{Role, View3dFault, View3dScene};
use crate::ReadError;
use crate::obj::topology::{Loop, Points, Repeat, Repeats, edges};
use crate::obj::{ImportReport, Imported, ReadOptions};

/// Bands of a scene: as many as OBJ files have.
const BANDS: usize = 3;

/// Builds the scene; without options every surface gets one black material.
///
/// # Errors
///
/// [`ReadError`] if a surface refers to one that it cannot refer to, or none has an area.
pub(super) fn assemble(path: &Path, raw: Raw, options: Option<&ReadOptions>) -> Result<View3dScene, ReadError> {
    let fault = |line: usize, fault| ReadError::View3d { path: path.to_owned(), line, fault };
    let mut report = ImportReport { vertices: raw.vertices, faces: raw.surfaces.len(), ..ImportReport::default() };
    report.warnings.clone_from(&raw.control.warnings);
    let index = numbered(&raw.surfaces).map_err(|(line, what)| fault(line, what))?;

    // Materials, one for every emittance.
    let mut materials = Vec::new();
    let mut material_of = Vec::with_capacity(raw.surfaces.len());
    for surface in &raw.surfaces {
        let material = material(surface, options).map_err(|what| fault(surface.line, what))?;
        let known = materials.iter().position(|known| *known == material);
        material_of.push(known.unwrap_or(materials.len()));
        if known.is_none() {
            materials.push(material);
        }
    }

    // Surfaces as they stand in the file, before anything is cut out of them.
    let mut whole = Vec::with_capacity(raw.surfaces.len());
    for (surface, &material) in raw.surfaces.iter().zip(&material_of) {
        report.triangles += usize::from(surface.corners.len() == 3);
        report.quads += usize::from(surface.corners.len() == 4);
        report.most_corners = report.most_corners.max(surface.corners.len());
        // Coordinates are finite, so having no area is all that can be wrong.
        match Surface::from_loop(&surface.name, surface.line, material, &surface.corners) {
            Ok((made, kind)) => {
                report.concave_split += usize::from(kind == FaceKind::Concave);
                report.non_planar_split += usize::from(kind == FaceKind::NonPlanar);
                whole.push(made);
            }
            Err(_) => {
                report.zero_area_dropped += 1;
                let name = surface.name.clone();
                whole.push(Surface { name, line: surface.line, material, pieces: Vec::new() });
            }
        }
    }
    topology(&raw.surfaces, &whole, &mut report);

    // Bases less their subsurfaces.
    let mut surfaces = whole.clone();
    for (k, surface) in raw.surfaces.iter().enumerate() {
        let pieces = match base(&raw.surfaces, &index, k).map_err(|what| fault(surface.line, what))? {
            Some(base) => without(&whole, &surfaces[base].pieces, base, k, surface.role)
                .map(|pieces| (base, pieces))
                .map_err(|why| (raw.surfaces[base].number, why)),
            None => continue,
        };
        match pieces {
            Ok((base, pieces)) => surfaces[base].pieces = pieces,
            Err((base, why)) => {
                return Err(fault(surface.line, View3dFault::Subsurface { surface: surface.number, base, why }));
            }
        }
    }

    let rows = rows(&raw.surfaces, &index).map_err(|(line, what)| fault(line, what))?;
    let empty = || ReadError::Empty {
        path: path.to_owned(),
        faces: raw.surfaces.len(),
        first_line: raw.surfaces.first().map(|surface| surface.line),
    };
    // All materials have the same bands, so an empty scene is the only way to fail.
    let scene = Scene::new(surfaces, materials).map_err(|_| empty())?;
    report.warn(false);
    Ok(View3dScene {
        title: raw.title,
        control: raw.control,
        imported: Imported { scene, report },
        roles: raw.surfaces.iter().map(|surface| surface.role).collect(),
        rows,
        emittances: raw.surfaces.iter().map(|surface| surface.emittance).collect(),
    })
}

/// A fault and the line it is on.
type Faulty = (usize, View3dFault);

/// Where each surface number stands.
fn numbered(surfaces: &[RawSurface]) -> Result<HashMap<u64, usize>, Faulty> {
    let mut index = HashMap::new();
    for (k, surface) in surfaces.iter().enumerate() {
        if index.insert(surface.number, k).is_some() {
            return Err((surface.line, View3dFault::Twice { what: "surface", number: surface.number }));
        }
    }
    Ok(index)
}

/// ρ = 1 − ε of a radiating surface; obstructions and null surfaces absorb all.
fn material(surface: &RawSurface, options: Option<&ReadOptions>) -> Result<Material, View3dFault> {
    let black = |name: &str| (name.to_owned(), 0.0);
    let (name, reflectance) = match (options, surface.role) {
        (None, _) => black("none"),
        (Some(_), Role::Obstruction | Role::Null) => black("obstruction"),
        (Some(options), Role::Radiating) => {
            let reflectance = 1.0 - surface.emittance;
            let clamped = options.clamp_reflectance.map_or(reflectance, |clamp| reflectance.min(clamp));
            if clamped >= 1.0 {
                return Err(View3dFault::Reflectance { value: surface.emittance });
            }
            (format!("emittance {}", surface.emittance), clamped)
        }
    };
    Ok(Material::diffuse(&name, vec![reflectance; BANDS], vec![0.0; BANDS]))
}

/// Counts repeated surfaces and open edges. Subsurfaces lie within their bases and take no part.
fn topology(raw: &[RawSurface], whole: &[Surface], report: &mut ImportReport) {
    let (mut points, mut repeats, mut kept) = (Points::default(), Repeats::default(), Vec::<Loop>::new());
    for (surface, _) in raw.iter().zip(whole).filter(|(s, made)| s.base == 0 && !made.pieces.is_empty()) {
        let closed = points.close(&surface.corners);
        let repeat = repeats.enter(&closed);
        report.duplicate_faces += usize::from(repeat != Repeat::New);
        report.two_sided_sheets += usize::from(repeat == Repeat::OtherSide);
        if repeat == Repeat::Same {
            report.warnings.push(format!(
                "surface {} (line {}) repeats an earlier one the same way round: each claims the same light",
                surface.number, surface.line
            ));
        }
        kept.push(closed);
    }
    (report.open_edges, report.turned_edges) = edges(kept.iter());
}

/// Index of the base of surface k, if it has one.
fn base(surfaces: &[RawSurface], index: &HashMap<u64, usize>, k: usize) -> Result<Option<usize>, View3dFault> {
    let surface = &surfaces[k];
    if surface.base == 0 {
        // A null surface removes a part of something.
        let orphan = surface.role == Role::Null;
        return if orphan { Err(View3dFault::NoBase { surface: surface.number }) } else { Ok(None) };
    }
    let what = "base surface";
    let &base = index.get(&surface.base).ok_or(View3dFault::Undefined { what, number: surface.base })?;
    // Obstructions come after radiating surfaces, and may carry them.
    if base >= k && surfaces[base].role != Role::Obstruction {
        return Err(View3dFault::Order { what, number: surface.base, surface: surface.number });
    }
    Ok(Some(base))
}

/// What is `left` of surface `base` less its subsurface k.
fn without(
    whole: &[Surface],
    left: &[Polygon],
    base: usize,
    k: usize,
    role: Role,
) -> Result<Vec<Polygon>, &'static str> {
    let mut left = left.to_vec();
    let Some(plane) = whole[base].pieces.first() else { return Err("lies on no area of") };
    for window in &whole[k].pieces {
        left = cut_out(&left, plane, window, role != Role::Null)?;
    }
    Ok(left)
}

/// Row of every surface: that of the surface it is combined with, or the next of its own.
fn rows(surfaces: &[RawSurface], index: &HashMap<u64, usize>) -> Result<Vec<Option<usize>>, Faulty> {
    let mut rows: Vec<Option<usize>> = Vec::with_capacity(surfaces.len());
    let mut next = 0;
    for (k, surface) in surfaces.iter().enumerate() {
        if surface.role != Role::Radiating {
            rows.push(None);
            continue;
        }
        if surface.combine == 0 {
            rows.push(Some(next));
            next += 1;
            continue;
        }
        let (what, number) = ("surface to combine with", surface.combine);
        let fail = |fault| Err((surface.line, fault));
        let Some(&with) = index.get(&number) else { return fail(View3dFault::Undefined { what, number }) };
        if with >= k {
            return fail(View3dFault::Order { what, number, surface: surface.number });
        }
        if surfaces[with].role != Role::Radiating {
            return fail(View3dFault::Combined { number, why: "no radiating surface" });
        }
        if surfaces[with].combine != 0 {
            return fail(View3dFault::Combined { number, why: "itself combined with another" });
        }
        rows.push(rows[with]);
    }
    Ok(rows)
}
