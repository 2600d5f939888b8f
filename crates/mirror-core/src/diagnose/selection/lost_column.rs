//! The search for causes if a joint's column is unrelated to it: the joint's position in each such posture is free.
//!
//! Mounts by hand are free beside these positions where a few causes are not sufficient.
//!
//! The column is not used: laws of that joint's position, at the joint or at another one, are no candidates. What is
//! found elsewhere holds whatever the column contains.

use crate::diagnose::effects::Place;
use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::problem::Noise;
use crate::diagnose::prepare::false_observations::without_false;
use crate::diagnose::prepare::first_day::{Lost, column};
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::selection::extended_models::Extended;
use crate::diagnose::selection::search::{Found, Search};
use crate::diagnose::selection::with_setup::{suffices, with_setup};
use crate::error::Result;

/// The search for causes with the joint's positions free.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn beside_lost_column(
    search: &mut Search<'_>,
    lost: &Lost,
    nominal: &Model,
    (stated, without): (Noise, &[String]),
) -> Result<(Found, Extended)> {
    let mut start = nominal.clone();
    start.group = vec![0.0; search.group.columns.len()];
    // Each posture has a parameter of its own: of a long session more would not tell more.
    let part = search.mask.take();
    let counts = |f: &usize| part.is_none_or(|part| part[*f]);
    (0..search.problem.frames.len()).filter(|f| !counts(f)).for_each(|f| search.problem.leave_out(f..=f));
    for (frames, error) in lost.postures.iter().filter(|(frames, _)| frames.iter().any(counts)) {
        search.group.columns.push(column(&search.problem, lost.node, frames));
        search.group.prior_std.push(lost.spread);
        start.group.push(*error);
    }
    let hypotheses = search.catalogue.hypotheses.iter().enumerate();
    search.options.left_out.extend(hypotheses.filter(|(_, h)| is_of(h.place, lost.node)).map(|(h, _)| h));
    search.options.named_only = true;
    let mut found = search.run(start)?;
    let mut geometry = None;
    let mounted = Geometry::of_setup(&search.problem, without);
    if !mounted.group.columns.is_empty()
        && !search.problem.budget.is_spent()
        && !suffices(search, &found)?
        && let Some(freed) = with_setup(search, &found, nominal, stated, mounted)?
    {
        (*search, found) = (freed.search, freed.found);
        geometry = Some(freed.setup).filter(|s| !s.group.columns.is_empty());
    }
    let joint = &search.problem.scene.body.nodes[lost.node].joint;
    found.trace.insert(0, format!("the column of joint:{joint} is unrelated to it: its positions are free"));
    let (clean, _) = without_false(&search.problem, &search.deformation(&found.fit.model), found.noise)?;
    Ok((found, Extended { erratic: Some(lost.node), ..Extended::with(geometry, clean) }))
}

/// Whether effects at a place depend on a joint's position.
fn is_of(place: Place, node: NodeId) -> bool {
    match place {
        Place::Joint(n) => n == node,
        Place::JointPair(n, k) => n == node || k == node,
        _ => false,
    }
}
