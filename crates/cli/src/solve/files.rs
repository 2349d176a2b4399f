//! Solutions as files: one line a cell as CSV, or coloured faces as PLY.

use std::path::Path;

use glam::DVec3;
use radiosity::{GridValues, LinearRadiosity, Run};
use radiosity_core::BandValues;
use radiosity_geometry::mesh::Place;
use radiosity_io::{PlyFace, PlyTriangle, PlyVertex, SolutionRow};
use radiosity_io::{write_ply, write_shaded_ply, write_solution};
use radiosity_render::Exposure;

use crate::args::{Shading, SolveArgs};
use crate::{Failure, plan};

/// Kinds of output file.
pub(super) enum Format {
    Csv,
    Ply,
}

/// The kind of file that a name ends in.
pub(super) fn format_of(path: &Path) -> Result<Format, Failure> {
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("csv") => Ok(Format::Csv),
        Some("ply") => Ok(Format::Ply),
        _ => Err(format!("{}: a solution file ends in .csv or .ply", path.display()).into()),
    }
}

/// The band a column shows: of one band all three columns show it; further bands than three are not written.
fn three(values: &BandValues, at: usize) -> [f64; 3] {
    [0, 1, 2].map(|b| values.band(b.min(values.count() - 1))[at])
}

/// Writes what is asked for.
pub(super) fn write(path: &Path, run: &Run<'_>, args: &SolveArgs) -> Result<(), Failure> {
    let asked = plan::asked(&args.plan, run.geometry.scene())?;
    let is_asked = |surface: u32| asked.as_ref().is_none_or(|asked| asked.binary_search(&surface).is_ok());
    match format_of(path)? {
        Format::Csv => {
            let mut rows = match args.report_grid {
                Some(k) => cell_rows(run, k)?,
                None => element_rows(run),
            };
            rows.retain(|row| is_asked(row.surface));
            write_solution(path, &rows)?;
        }
        Format::Ply => match args.shading {
            Shading::Flat => {
                let mut faces = ply_faces(run);
                faces.retain(|face| is_asked(face.surface));
                write_ply(path, &faces)?;
            }
            Shading::Linear => write_shaded_ply(path, &ply_triangles(run, &is_asked))?,
        },
    }
    Ok(())
}

fn element_rows(run: &Run<'_>) -> Vec<SolutionRow> {
    let g = &run.geometry;
    let [e, h, b] = [&g.emission(), &run.solution.irradiance, &run.solution.radiosity].map(|v| g.spread(v));
    let mesh = g.mesh();
    let row = |k: usize| {
        let (element, polygon) = (&mesh.elements[k], &mesh.element_facets.polygons(k)[0]);
        SolutionRow {
            surface: element.surface,
            i: element.i,
            j: element.j,
            centroid: polygon.centroid(),
            area: polygon.area(),
            emission: three(&e, k),
            irradiance: three(&h, k),
            radiosity: three(&b, k),
        }
    };
    (0..mesh.elements.len()).map(row).collect()
}

fn cell_rows(run: &Run<'_>, k: u32) -> Result<Vec<SolutionRow>, Failure> {
    let g = &run.geometry;
    let means = |values: &BandValues| GridValues::means(g, values, k);
    let (e, h, b) = (means(&g.emission())?, means(&run.solution.irradiance)?, means(&run.solution.radiosity)?);
    let cells = g.mesh().report_grid(g.scene(), k)?.cells;
    let row = |(c, cell): (usize, &radiosity_geometry::ReportCell)| SolutionRow {
        surface: cell.surface,
        i: cell.i,
        j: cell.j,
        centroid: cell.polygon.centroid(),
        area: cell.polygon.area(),
        emission: three(&e.values, c),
        irradiance: three(&h.values, c),
        radiosity: three(&b.values, c),
    };
    Ok(cells.iter().enumerate().map(row).collect())
}

/// Radiosity of every element of the mesh, and the exposure that shows it.
fn shown(run: &Run<'_>) -> (Vec<[f64; 3]>, Exposure) {
    let mesh = run.geometry.mesh();
    let b = run.geometry.spread(&run.solution.radiosity);
    let values: Vec<[f64; 3]> = (0..mesh.elements.len()).map(|k| three(&b, k)).collect();
    // Lights are far brighter than what they light: white is what 2 % of the area exceeds.
    let exposure = Exposure::of_share(&values, &mesh.areas(), 0.98);
    (values, exposure)
}

fn ply_faces(run: &Run<'_>) -> Vec<PlyFace> {
    let (mesh, (values, exposure)) = (run.geometry.mesh(), shown(run));
    let face = |((k, value), vertices): ((usize, &[f64; 3]), Vec<_>)| PlyFace {
        vertices,
        surface: mesh.elements[k].surface,
        colour: exposure.colour(*value),
        radiosity: *value,
    };
    values.iter().enumerate().zip(mesh.without_cracks()).map(face).collect()
}

fn ply_triangles(run: &Run<'_>, is_asked: &dyn Fn(u32) -> bool) -> Vec<PlyTriangle> {
    let (mesh, (_, exposure)) = (run.geometry.mesh(), shown(run));
    let linear = LinearRadiosity::new(&run.geometry, &run.solution.irradiance);
    let vertex = |e: usize, (position, place): (DVec3, Place)| {
        let radiosity = [0, 1, 2].map(|b: usize| linear.radiosity(e, &place, b.min(linear.bands() - 1)));
        PlyVertex { position, colour: exposure.colour(radiosity), radiosity }
    };
    let exposed = run.geometry.exposed().iter().enumerate();
    exposed
        .filter(|(_, element)| is_asked(mesh.elements[**element as usize].surface))
        .flat_map(|(e, &element)| {
            let surface = mesh.elements[element as usize].surface;
            let triangles = linear.irradiance().triangles(element as usize);
            triangles.map(move |corners| PlyTriangle { vertices: corners.map(|corner| vertex(e, corner)), surface })
        })
        .collect()
}
