//! How the base yields on another session's ground.
//!
//! A robot that stands on a soft floor, or on loose bolts, turns with the moment M of its weight about the root's origin, `ω = diag(c) M`.
//! In one session the causes contain that. On other ground it is another c: the difference is no error of the robot, and no
//! prediction of it could know. So it is fitted where it is far more probable than none, and told beside the prediction, which
//! is without it.

use crate::diagnose::data::checked::Ground;
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::likelihood::fit::{Fit, FitOptions, Group, fit};
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{Guard, LEAST_LOG_ODDS, LOG_PRIOR_STRUCTURE, TEMPER};
use crate::diagnose::random_effects::free_form::TYPICAL_RAD;
use crate::error::Result;
use nalgebra::Vector3;

/// About an axis about which the moment changes by a smaller share of what it does about another, nothing is fitted.
const LEAST_RANGE: Guard = 0.1;

/// A problem in which c is fitted; none where the base is not seen to move, or no weight's moment changes.
pub(super) fn on_its_ground(problem: &Problem) -> Option<Problem> {
    problem.unknown_frame?;
    let moments = &problem.scene.base_moment;
    let range = |k: usize| {
        let of = || moments.iter().map(|m| m[k]);
        of().fold(f64::NEG_INFINITY, f64::max) - of().fold(f64::INFINITY, f64::min)
    };
    let widest = (0..3).map(range).fold(0.0, f64::max);
    if !(widest > 0.0) {
        return None;
    }
    let largest = moments.iter().map(Vector3::norm).fold(0.0, f64::max);
    // About an axis that is nearly upright there is hardly a moment, and nothing to be seen.
    let share = |k: usize| if range(k) > LEAST_RANGE * widest { 1.0 } else { 0.0 };
    let about = |k: usize| Column {
        atom: Atom::FramePose(k),
        weight: Weight::Frames(moments.iter().map(|m| share(k) * m[k]).collect()),
    };
    let ground = (0..3).map(|k| (about(k), TYPICAL_RAD / largest)).collect();
    Some(Problem { ground, ..problem.clone() })
}

/// A frozen model where c is free, at its start.
pub(super) fn with_ground(model: &Model, problem: &Problem) -> Model {
    let mut out = model.clone();
    let first = out.nuisances.len() - problem.mistake_parameters.len();
    let ground = problem.ground.iter().map(|_| 0.0);
    out.nuisances.splice(first..first, ground);
    out
}

/// Whether another c is far more probable than none, at the noise that the prediction without it leaves.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn is_other_ground(
    with: &Problem,
    catalogue: &Catalogue,
    group: &Group,
    (without, noise): (&Fit, Noise),
) -> Result<bool> {
    let options = FitOptions { noise, steps: SOLVER.loose_steps };
    let with = fit(with, catalogue, group, &with_ground(&without.model, with), options, None)?;
    let gain = with.log_evidence - without.log_evidence;
    Ok(TEMPER * gain + LOG_PRIOR_STRUCTURE > LEAST_LOG_ODDS)
}

/// What is told of a fit.
pub(super) fn told(problem: &Problem, fitted: &Fit, after_m: f64) -> Ground {
    let first = fitted.model.nuisances.len() - problem.mistake_parameters.len() - problem.ground.len();
    let of = |k: usize| fitted.model.nuisances[first + k];
    let std = |k: usize| fitted.covariance[(first + k, first + k)].max(0.0).sqrt();
    Ground { after_m, yields_rad_per_nm: [of(0), of(1), of(2)], std_rad_per_nm: [std(0), std(1), std(2)] }
}
