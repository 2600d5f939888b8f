//! The causes on another session: predicted with the values found; only that session's nuisance parameters are
//! fitted. What a diagnosis of it would leave out is left out before and after.

use crate::diagnose::assessment::false_there::{self, leave_out_of, without_contradicted};
use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::its_ground::{is_other_ground, on_its_ground, told, with_ground};
use crate::diagnose::data::checked::{Checked, Ground};
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::own::own_effects;
use crate::diagnose::effects::vocabulary;
use crate::diagnose::likelihood::fit::{Fit, FitOptions, Group, fit};
use crate::diagnose::likelihood::noise;
use crate::diagnose::likelihood::saturated::free_markers;
use crate::diagnose::model::elementary::{Column, Weight};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::prepare::boards::leave_out_wrong_grids;
use crate::diagnose::prepare::options::OtherSession;
use crate::diagnose::prepare::prepared::Prepared;
use crate::diagnose::principles::A_GAP;
use crate::error::Result;
use std::sync::Arc;

/// Predicts another session with the causes as they were found; only its own nuisances are fitted. Mistakes of model and log that it
/// shares are undone for the gap after.
pub(crate) fn check(findings: &Findings<'_>, prepared: &Prepared, other: &OtherSession) -> Result<Checked> {
    let recording = other.recording.clone().validated(other.robot.position_count())?;
    let mut given = Problem::new(&other.robot, &recording)?;
    given.cancel = findings.search.problem.cancel.clone();
    let whole = prepared.in_another_session(&other.robot, &recording, given.clone())?;
    let mut problem = whole.clone();
    leave_out_wrong_grids(&mut problem);
    problem.noise = noise::estimate(&problem, &problem.nominal(), problem.noise)?;
    given.noise = problem.noise;
    let here = &findings.search;
    let mut effects = vocabulary();
    effects.extend(own_effects(&other.own, &problem.scene)?);
    let catalogue = Catalogue::new(&problem.scene, effects.into_iter().map(Arc::from).collect(), &[]);
    let found = &findings.found.fit.model;
    let terms = found.causes_in((here.catalogue, &here.problem.scene), (&catalogue, &problem.scene));
    let (group, values) = constant_part(findings, &problem);
    let model = Model { frozen: true, terms, group: values, ..Model::nominal(&problem) };
    let after = without_its_false(&problem, &catalogue, &model, &group)?;
    let ground = ground(&after, &catalogue, &model, &group)?;
    leave_out_of(&mut given, &whole, &after.problem);
    let nominal = Model { frozen: true, ..Model::nominal(&given) };
    let before_m = predicted(&given, &catalogue, &nominal, &Group::default())?.gap_m;
    let left_out = false_there::told(&whole, &after.problem);
    Ok(Checked { session: other.name.clone(), before_m, after_m: after.gap_m, ground, left_out })
}

/// The session predicted without what is false there. What is very far widens the noise by which the rest is judged, so that the
/// rest is judged again.
fn without_its_false(
    problem: &Problem,
    catalogue: &Catalogue,
    model: &Model,
    group: &Group,
) -> Result<Predicted> {
    let mut there = predicted(problem, catalogue, model, group)?;
    for _ in 0..SOLVER.rounds {
        let deformation = there.fit.model.deformation(&there.problem, catalogue, &group.columns);
        let Some(clean) = without_contradicted(&there.problem, &deformation, there.noise)? else { break };
        there = predicted(&clean, catalogue, model, group)?;
    }
    Ok(there)
}

/// How its base yields otherwise, where that is far more probable than not, and without it there is a gap.
fn ground(after: &Predicted, catalogue: &Catalogue, model: &Model, group: &Group) -> Result<Option<Ground>> {
    let (problem, Some(after_m)) = (&after.problem, after.gap_m) else { return Ok(None) };
    let Some(with) = on_its_ground(problem) else { return Ok(None) };
    if !is_other_ground(&with, catalogue, group, (&after.fit, after.noise))? {
        return Ok(None);
    }
    let there = predicted(&with, catalogue, &with_ground(model, &with), group)?;
    // Laws that are not quite right let any parameter close a little.
    let smaller = there.gap_m.filter(|gap_m| after_m > A_GAP * gap_m);
    Ok(smaller.map(|gap_m| told(&with, &there.fit, gap_m)))
}

/// What is found besides causes and is the same in any session, as a group with its values: small errors, and by what a mistake's
/// number is still off. What varies by this session's frames is not.
fn constant_part(findings: &Findings<'_>, other: &Problem) -> (Group, Vec<f64>) {
    let (here, model) = (&findings.search, &findings.found.fit.model);
    let mistakes = &here.problem.mistake_parameters;
    let of_mistakes = mistakes.iter().map(|of| &of.column);
    let first = model.nuisances.len().saturating_sub(mistakes.len());
    let all = of_mistakes.zip(&model.nuisances[first..]).chain(here.group.columns.iter().zip(&model.group));
    let lasts = |column: &Column| other.has_atom(column.atom) && !matches!(column.weight, Weight::Frames(_));
    let kept = all.filter(|(column, _)| lasts(column));
    let (columns, values): (Vec<Column>, Vec<f64>) =
        kept.map(|(column, value)| (column.clone(), *value)).unzip();
    let prior_std = vec![1.0; columns.len()];
    (Group { columns, prior_std, positive: Vec::new() }, values)
}

/// A session as a model predicts it of which only the nuisances are fitted.
struct Predicted {
    /// With the loads of this model.
    problem: Problem,
    fit: Fit,
    /// At which it was fitted.
    noise: Noise,
    /// RMS displacement of the markers, m; none where none is seen.
    gap_m: Option<f64>,
}

fn predicted(problem: &Problem, catalogue: &Catalogue, model: &Model, group: &Group) -> Result<Predicted> {
    let mut problem = problem.clone();
    let mut fitted = |model: &Model| -> Result<(Fit, Noise)> {
        let deformation = model.deformation(&problem, catalogue, &group.columns);
        problem.scene.update_loads(&deformation);
        let noise = noise::effective(&problem, &deformation, problem.noise, None)?;
        let options = FitOptions { noise, steps: SOLVER.loose_steps };
        Ok((fit(&problem, catalogue, group, model, options, None)?, noise))
    };
    let (once, _) = fitted(model)?;
    let (fit, noise) = fitted(&once.model)?;
    let deformation = fit.model.deformation(&problem, catalogue, &group.columns);
    let postures = free_markers(&problem, &deformation, problem.noise, true, None)?;
    let seen = postures.iter().flat_map(|p| &p.markers);
    let (sum, count) = seen.fold((0.0, 0.0), |(s, c), m| (s + m.displacement.norm_squared(), c + 1.0));
    Ok(Predicted { problem, fit, noise, gap_m: (count > 0.0).then(|| (sum / count).sqrt()) })
}
