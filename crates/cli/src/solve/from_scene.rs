//! Solutions of one scene: form factors are computed, and solved on once or to a tolerance.

use std::time::Instant;

use radiosity::bounded::foreseen;
use radiosity::plan::Omissions;
use radiosity::{EnhancedRun, Phase, Plan, SpecularBy, Strategy};
use radiosity::{Shape, run_enhanced, run_planned};
use radiosity_form_factors::extended::SpecularBounces;
use radiosity_io::Imported;

use super::Way;
use super::asked::{admitted, by_links, finish_strategy, mesh_settings, sizes, strategy};
use super::by_choice::on_chosen;
use super::predicted::{Foreseen, dry_run};
use super::refinement::to_tolerance;
use super::report::finish;
use crate::args::{Shading, SolveArgs};
use crate::{Failure, Verdict, choice, memory, plan};

/// Computes form factors and solves.
pub(super) fn on_computed(args: &SolveArgs, imported: &Imported) -> Result<Verdict, Failure> {
    let scene = &imported.scene;
    // Candidates are ways to the error of all surfaces.
    if !args.plan.ask_view
        && let Some(wanted) = choice::wanted(args, scene)
        && let Some(chosen) = choice::choose(args, scene, &wanted)?
    {
        return on_chosen(args, imported, chosen);
    }
    let mesh = mesh_settings(&args.mesh);
    let program = memory::program();
    let transport = args.transport();
    let specular = transport.bounces != SpecularBounces::None && scene.is_specular();
    let (asked, view) = (plan::asked(&args.plan, scene)?, plan::view(&args.plan, scene)?.map(|view| view.camera));
    // Linear shading joins the irradiance of neighbours, and wants it of all.
    let whole = specular || args.tolerance.is_some() || (args.shading == Shading::Linear && asked.is_some());
    let omit = if whole { Omissions::NONE } else { plan::omissions(&args.plan) };
    let planned = |strategy: Strategy| Strategy { omit, asked: asked.clone(), view: view.clone(), ..strategy };
    // Which store is taken is a matter of what is computed once, for one scene.
    let choose = args.store.is_none() && args.tolerance.is_none() && !specular;
    let before = admitted(args, scene, mesh, &planned, choose)?;
    let clock = Instant::now();
    let mut plan = Plan::new(scene, &before);
    let mut geometry = plan.mesh(scene, &before)?;
    let (elements, blocking) = sizes(&geometry);
    let mut strategy = planned(strategy((elements, blocking), mesh, &args.estimator, &args.common));
    finish_strategy(&mut strategy, args, blocking);
    if specular && transport.by != SpecularBy::Images && args.solver.is_none() && strategy.shape == Shape::Full {
        // Extended form factors along rays are not symmetric.
        "gauss-seidel".clone_into(&mut strategy.solver);
    }
    if strategy.method != before.method {
        // Contacts made more elements than was thought, or fewer.
        plan = Plan::new(scene, &strategy);
        geometry = plan.mesh(scene, &strategy)?;
    }
    let choice = (choose && !by_links(args)).then(|| plan.store(&geometry, &strategy));
    strategy.store = choice.map_or(strategy.store, |choice| choice.store);
    let reason = choice.map(|choice| choice.reason);
    let meshing = Phase { time: clock.elapsed(), ..Phase::default() };
    strategy.check()?;
    if args.thin_error.is_some() && !args.plan.keep_everything {
        strategy.check_thinning()?;
    }
    if args.common.dry_run {
        let (savings, prediction) = (plan.left_out(&geometry, &strategy), plan.size(&geometry).predict(&strategy));
        // Refinement makes meshes of its own.
        let bounded = if args.tolerance.is_none() { foreseen(&plan, &geometry, &strategy) } else { Vec::new() };
        let mut anyway = plan.anyway(&geometry, &strategy, None);
        anyway.extend(transport.left_out(scene, prediction.source_evaluations, None));
        let foreseen = Foreseen { prediction, savings, anyway, bounded, reason };
        return Ok(dry_run(args, foreseen, &strategy, None, program));
    }
    let (run, way) = match args.tolerance {
        Some(tolerance) => {
            drop(geometry);
            to_tolerance(args, scene, &mut strategy, tolerance).map_err(memory::explained)?
        }
        None if specular => {
            drop(geometry);
            let EnhancedRun { run, specular, .. } =
                run_enhanced(scene, &strategy, transport, &mut ()).map_err(memory::explained)?;
            (run, Way::Enhanced(transport.by, specular))
        }
        None => {
            let run = run_planned(&plan, geometry, meshing, &strategy, &mut ()).map_err(memory::explained)?;
            (run, Way::Straight(reason))
        }
    };
    finish(args, imported, &strategy, None, &run, way)
}
