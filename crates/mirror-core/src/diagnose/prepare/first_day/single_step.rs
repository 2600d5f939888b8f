//! A joint's zero that changes once, as the only thing that is wrong.
//!
//! Where many small errors are free at once ([`super::changes`]), they absorb most of a small step, and no slip is clear. Alone it
//! may leave nothing, and be clearly more probable than any single cause: a drift over the session, its nearest neighbour, leaves the
//! step's saw tooth, which may be less than a gap.

use super::by_frame::What;
use super::changes::{LAST, ZERO_STD, of_zeros, over, scan};
use super::mistake::Changes;
use super::single_cause::{Beside, likeliest};
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::vocabulary;
use crate::diagnose::likelihood::fit::{Fit, FitOptions, Group, fit};
use crate::diagnose::likelihood::noise::effective;
use crate::diagnose::model::elementary::{Atom, Column};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{A_GAP, FEWEST_FRAMES, LEAST_LOG_ODDS, TEMPER};
use crate::error::Result;

/// The step that alone leaves no gap, where the likeliest single cause is clearly less probable; `ln (rows × joints)` is the price of its
/// row and joint. Each is one cause, so the odds are those at which a cause is named.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn find(problem: &Problem) -> Result<Changes> {
    let scene = &problem.scene;
    let count = problem.frames.len();
    if !scene.ordered || count < 2 * FEWEST_FRAMES {
        return Ok(None);
    }
    let exact = Beside::nothing(problem);
    let Some(noise) = exact.gap(problem)? else { return Ok(None) };
    let places = of_zeros(problem, &problem.nominal(), noise)?;
    let steps = places.iter().filter_map(|place| scan(place, 0..count));
    let Some(mut step) = steps.max_by(|a, b| a.gain.total_cmp(&b.gain)) else { return Ok(None) };
    let What::Zero(node) = step.what else { return Ok(None) };
    let group = Group {
        columns: vec![Column { atom: Atom::Joint(node), weight: over(&step.rows, count) }],
        prior_std: vec![ZERO_STD],
        ..Group::default()
    };
    let none = Catalogue::new(scene, Vec::new(), &[]);
    let fitted = |start: &Model, noise| -> Result<Fit> {
        fit(problem, &none, &group, start, FitOptions { noise, steps: SOLVER.loose_steps }, None)
    };
    let mut start = Model::nominal(problem);
    start.group = vec![step.motion[LAST]];
    let alone = fitted(&fitted(&start, noise)?.model, problem.noise)?;
    let left =
        effective(problem, &alone.model.deformation(problem, &none, &group.columns), problem.noise, None)?;
    if problem.of_observations(left) >= A_GAP * problem.of_observations(problem.noise) {
        return Ok(None);
    }
    let Some(cause) = likeliest(problem.clone(), vocabulary(), &exact, noise)? else { return Ok(None) };
    let against = cause.fitted(noise)?.log_evidence(problem.noise)?;
    let odds = alone.log_evidence - against - ((count * places.len()) as f64).ln();
    step.motion[LAST] = alone.model.group[0];
    Ok((TEMPER * odds > LEAST_LOG_ODDS).then(|| (step.mistakes(problem), odds)))
}
