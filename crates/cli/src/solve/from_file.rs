//! Solutions on form factors from a file.

use std::path::{Path, PathBuf};

use radiosity::{FittedRows, Geometry, Method, Strategy, run_saved};
use radiosity_form_factors::Rows;
use radiosity_geometry::mesh::{MeshSettings, Subdivision};
use radiosity_io::Imported;
use serde_json::{Value, json};

use super::Way;
use super::asked::{CELLS, finish_strategy};
use super::predicted::{Foreseen, dry_run};
use super::report::finish;
use crate::args::SolveArgs;
use crate::saved::Saved;
use crate::{Failure, Verdict, memory, output, saved};

/// Form factors from a file, fitted to the mesh.
pub(super) struct FromFile {
    path: PathBuf,
    rows: FittedRows,
    beside: Value,
}

/// Solves on form factors from a file.
pub(super) fn on_saved(args: &SolveArgs, imported: &Imported, path: &Path) -> Result<Verdict, Failure> {
    let saved = saved::read(path)?;
    // A file that knows its subdivision need not be told.
    let k = args.mesh.subdivide.or(saved.subdivide()).unwrap_or(CELLS);
    let Saved { form_factors, beside } = saved;
    let mesh = MeshSettings { elements: Subdivision::Uniform(k), patches: None, contacts: true };
    let program = memory::program();
    let geometry = Geometry::new(&imported.scene, &mesh)?;
    let rows = form_factors.fit(&geometry).map_err(|error| {
        let scene = args.common.scene.display();
        format!(
            "{}: {error}; `radiosity form-factors {scene} --subdivide {k} --contacts --output FILE` writes the matrix of this mesh",
            path.display()
        )
    })?;
    let solver = if rows.symmetric() { "cg" } else { "gauss-seidel" };
    let plain = Strategy::new(mesh.elements, Method::ANALYTIC);
    let memory = memory::limit(&args.common);
    let mut strategy = Strategy { solver: solver.to_owned(), seed: args.common.seed, memory, ..plain };
    finish_strategy(&mut strategy, args, geometry.blockers().len());
    let file = FromFile { path: path.to_owned(), rows, beside };
    if args.common.dry_run {
        let mut whole = Foreseen::whole(&geometry, &strategy);
        (whole.prediction.form_factors, whole.prediction.source_evaluations) = (0, 0);
        return Ok(dry_run(args, whole, &strategy, Some(&file), program));
    }
    let run = run_saved(geometry, &file.rows, &strategy, &mut ()).map_err(memory::explained)?;
    finish(args, imported, &strategy, Some(&file), &run, Way::Straight(None))
}

/// The estimator with its settings, or the file and what stands beside it.
pub(super) fn method(strategy: &Strategy, file: Option<&FromFile>) -> Value {
    let Some(file) = file else { return output::method(strategy.method) };
    json!({
        "name": file.rows.name(),
        "file": file.path.display().to_string(),
        "symmetric": file.rows.symmetric(),
        "largest_reciprocity_error": file.rows.apart(),
        "made_by": file.beside["method"],
        "tolerance": file.beside["tolerance"],
        "repair": file.beside["repair"],
    })
}

/// The estimator, or the file and what its two directions differ by, in words.
pub(super) fn method_name(strategy: &Strategy, file: Option<&FromFile>) -> String {
    match file {
        Some(file) if file.rows.symmetric() => format!(
            "{} (the mean of both directions, which differ by up to {:.1e})",
            file.path.display(),
            file.rows.apart()
        ),
        Some(file) => format!(
            "{} (row by row: the two directions of a pair differ by up to {:.1e})",
            file.path.display(),
            file.rows.apart()
        ),
        None => strategy.method.name().to_owned(),
    }
}
