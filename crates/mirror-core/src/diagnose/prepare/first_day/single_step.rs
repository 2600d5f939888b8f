//! A joint's zero that changes once, as the only thing that is wrong.
//!
//! Where many small errors are free at once ([`super::changes`]), they absorb most of a small step, and no slip is clear. Alone it
//! may leave nothing, where no single cause does: a drift over the session, its nearest neighbour, leaves the step's saw tooth.

use super::by_frame::zeros;
use super::changes::{LAST, ZERO_STD, scan};
use super::mistake::{Changes, Mistake};
use super::single_cause::{Beside, likeliest};
use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::effects::vocabulary;
use crate::diagnose::likelihood::fit::{Fit, FitOptions, Group, fit};
use crate::diagnose::likelihood::noise::effective;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{A_GAP, BEYOND_DOUBT, FEWEST_FRAMES};
use crate::error::Result;

/// The step that alone leaves no gap, where the likeliest single cause leaves one and is far less probable; `ln (rows × joints)` is the
/// price of its row and joint.
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
    let joints: Vec<NodeId> = (0..scene.nodes()).filter(|&n| scene.relevant[n] && scene.moves(n)).collect();
    let places = zeros(problem, &problem.nominal(), noise, &joints)?;
    let steps = joints.iter().zip(&places).filter_map(|(&node, place)| Some((node, scan(place, 0..count)?)));
    let Some((node, step)) = steps.max_by(|a, b| a.1.gain.total_cmp(&b.1.gain)) else { return Ok(None) };
    let first = step.rows.start;
    let weight = Weight::Frames((0..count).map(|f| f64::from(u8::from(f >= first))).collect());
    let group = Group {
        columns: vec![Column { atom: Atom::Joint(node), weight }],
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
    let odds = alone.log_evidence - against - ((count * joints.len()) as f64).ln();
    let (joint, multiplier, _) = scene.body.nodes[node].command;
    let offset = alone.model.group[0] / multiplier;
    Ok((odds > BEYOND_DOUBT).then(|| (vec![Mistake::ZeroLost { joint, first, offset }], odds)))
}
