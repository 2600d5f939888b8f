//! A joint that has another zero from a row on: the search runs with that step undone, the reported gap does not.
//!
//! There is no public effect for it and no simulator can be given it, so the remaining gap is that of the session as it
//! was logged, with the causes found: each region predicted from the others. The place is the joint, the dependence the
//! row.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::weighed::as_given;
use crate::diagnose::criteria::cross_validation::{PostureGap, held_out, seen_size};
use crate::diagnose::criteria::marker_shift::marker_shift;
use crate::diagnose::data::depends_on::DependsOn;
use crate::diagnose::effects::Place;
use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::problem::Noise;
use crate::diagnose::model::solver::NEGLIGIBLE;
use crate::diagnose::prepare::first_day::{Step, ZERO_LOST};
use crate::diagnose::prepare::prepared::Prepared;
use crate::diagnose::principles::{A_GAP, LEAST_LOG_ODDS, TEMPER};
use crate::diagnose::selection::alternatives::held_out_odds;
use crate::diagnose::selection::nonparametric::{Unexplained, UnexplainedPlace};
use crate::diagnose::selection::simplify::{name_nothing, named_in_vain};
use crate::error::Result;

/// The gap with a step undone.
pub(crate) struct BesideStep {
    /// Of each posture, on regions that the fit did not see.
    pub after: Vec<PostureGap>,
    /// Its size in the unit of the observations.
    pub size: f64,
}

impl BesideStep {
    /// Whether what other causes leave in place of the step is clearly more: then they are only its neighbours, as a drift is of a
    /// zero that changed once.
    pub fn is_beyond(&self, others: &[PostureGap], noise: Noise) -> bool {
        let odds = TEMPER * held_out_odds(&self.after, others, noise);
        seen_size(others) > A_GAP * self.size || odds > LEAST_LOG_ODDS
    }
}

/// Reports the step that was undone, if any; returns the gap with the step undone.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn tell_step(
    findings: &mut Findings<'_>,
    nominal: &Model,
    prepared: &Prepared,
) -> Result<Option<BesideStep>> {
    let Some((step, as_logged)) = prepared.step() else { return Ok(None) };
    let beside = BesideStep { size: seen_size(&findings.after), after: findings.after.clone() };
    let measured = findings.search.detector_noise();
    // What slipped was found after the step.
    let mut as_logged = as_logged.clone();
    as_logged.slips.clone_from(&findings.search.problem.slips);
    as_logged.mistake_parameters.clone_from(&findings.search.problem.mistake_parameters);
    // The step is not among what the log says.
    let of_step = as_logged.mistake_parameters.iter_mut().filter(|p| p.effect == ZERO_LOST);
    of_step.for_each(|p| p.std = NEGLIGIBLE);
    if !as_logged.slips.is_empty() {
        as_logged.fit_boards()?;
    }
    let after = |findings: &Findings<'_>| {
        let (search, found) = (&findings.search, &findings.found);
        held_out(&as_logged, search.catalogue, &search.group, &found.fit.model, found.noise, measured, true)
    };
    findings.after = after(findings)?;
    findings.before = as_given(&findings.search, &prepared.given)?;
    if named_in_vain(&findings.search, &findings.found, &findings.before, &findings.after) {
        // They explain what undoing the step did, not what was logged.
        let left = "with the zero as logged they leave the gap no smaller";
        name_nothing(&findings.search, &mut findings.found, nominal, left)?;
        findings.geometry = None;
        findings.standings.clear();
        findings.after = after(findings)?;
    }
    let here = UnexplainedPlace {
        place: Some(Place::Joint(step.node)),
        depends_on: Some(DependsOn::RowsFrom(step.first_frame)),
        shift: shift(findings, step)?,
    };
    let others = findings.unexplained.take().map(|u| u.places).unwrap_or_default();
    let others = others.into_iter().filter(|p| p.place.is_some_and(|at| at != Place::Joint(step.node)));
    findings.unexplained = Some(Unexplained { places: core::iter::once(here).chain(others).collect() });
    // With what was found after the step: the model's numbers are those of this session.
    findings.step = Some((step.clone(), as_logged));
    Ok(Some(beside))
}

/// How far the step moves the markers, as it is told of the other places.
fn shift(findings: &Findings<'_>, step: &Step) -> Result<f64> {
    let (search, model) = (&findings.search, &findings.found.fit.model);
    let first = search.problem.frame_numbers.iter().position(|number| *number == step.first_frame);
    let first = first.unwrap_or(0);
    let weights = (0..search.problem.frames.len()).map(|f| f64::from(u8::from(f >= first)));
    let column = Column { atom: Atom::Joint(step.node), weight: Weight::Frames(weights.collect()) };
    // In the search's problem it is undone.
    let undone = search.deformation(model);
    let mut as_logged = undone.clone();
    column.add(-step.offset, &search.problem.scene, &mut as_logged);
    Ok(marker_shift(&search.problem, &as_logged, &undone, search.measured_noise)?.iter().sum())
}
