//! Solutions that start from that of another scene.

use std::path::Path;

use radiosity::{Geometry, Solved};
use radiosity_geometry::{Scene, SceneChange};
use radiosity_io::Imported;

use super::Way;
use super::asked::{admitted, finish_strategy, mesh_settings, sizes, strategy};
use super::predicted::{Foreseen, dry_run};
use super::report::finish;
use crate::args::SolveArgs;
use crate::{Failure, Verdict, memory, scene};

/// Solves the scene of another file first, and this one from its answer.
pub(super) fn after_change(args: &SolveArgs, imported: &Imported, path: &Path) -> Result<Verdict, Failure> {
    let before = scene::read_with_materials(path, &args.common)?;
    let change = imported.scene.change_from(&before.scene).map_err(|error| format!("{}: {error}", path.display()))?;
    one_moved(&imported.scene, &change, path)?;
    let mesh = mesh_settings(&args.mesh);
    let program = memory::program();
    admitted(args, &imported.scene, mesh, &|strategy| strategy, false)?;
    // What is not asked for is chosen as without the scene before.
    let geometry = Geometry::new(&imported.scene, &mesh)?;
    let (elements, blocking) = sizes(&geometry);
    let mut strategy = strategy((elements, blocking), mesh, &args.estimator, &args.common);
    finish_strategy(&mut strategy, args, blocking);
    strategy.check()?;
    if args.common.dry_run {
        return Ok(dry_run(args, Foreseen::whole(&geometry, &strategy), &strategy, None, program));
    }
    drop(geometry);
    let first = Solved::new(&before.scene, &strategy, &mut ()).map_err(memory::explained)?;
    let (again, saving) = first.resolve(&imported.scene, &mut ())?;
    let seconds = first.run().seconds();
    finish(args, imported, &strategy, None, again.run(), Way::After { path, seconds, saving })
}

/// Refuses scenes in which more than one surface, or the faces of more than one object, moved.
fn one_moved(scene: &Scene, change: &SceneChange, before: &Path) -> Result<(), Failure> {
    let Some(&first) = change.moved.first() else { return Ok(()) };
    let object = &scene.surfaces[first].name;
    let other = |s: &&usize| object.is_empty() || scene.surfaces[**s].name != *object;
    let Some(&second) = change.moved[1..].iter().find(other) else { return Ok(()) };
    let name = |s: usize| {
        let surface = &scene.surfaces[s];
        if surface.name.is_empty() { format!("face {s}") } else { format!("face {s} ('{}')", surface.name) }
    };
    let (before, first, second) = (before.display(), name(first), name(second));
    Err(format!(
        "{second} is not where it was in {before}, and neither is {first}; --after takes scenes in which one face or one object moved"
    )
    .into())
}
