//! A log that is late, or early, by a small part of a row: as small as usual errors, and no small error of any one joint.
//!
//! To first order a joint that is late by λ rows is off by λ times what it moves between two rows. One λ drives all joints
//! at once, so no effect of the search, which are each at one place, comes near. It is tested by the score of that one
//! parameter, with mounts and zeros free, in normal equations with a column for each joint: with h_j and g_j those of the
//! columns, the common parameter has `Σ_ij h_ij` and `Σ_j g_j`.
//!
//! Friction in every joint is scored in the same equations, by one width of all ([`super::friction_everywhere`]).
//!
//! Source: the score test, Rao 1948.

use super::friction_everywhere::{USUAL_WIDTH, friction_columns};
use super::mistake::{LateKind, Mistake};
use super::single_cause::{Beside, likeliest};
use super::variant::{Variant, seen_joints};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::effects::hypothesis::Catalogue;
use crate::diagnose::effects::vocabulary;
use crate::diagnose::likelihood::fit::FitOptions;
use crate::diagnose::likelihood::linearised::Linearised;
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::principles::{BEYOND_DOUBT, Guard, Prior};
use crate::error::Result;

/// Usual delay, rows (one standard deviation).
const USUAL_ROWS: Prior = 0.3;
/// A delay of more than this is gross, and was searched for before.
const MOST_ROWS: Guard = 0.5;

/// The delay of all joints' rows that explains far more than any single cause of the vocabulary, with its log odds; none
/// where there is none. That of one joint is hardly to be told from play, and is searched for where causes are known.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn find(problem: &Problem, recording: &Recording) -> Result<Option<(Mistake, f64)>> {
    if !problem.scene.ordered {
        return Ok(None);
    }
    let beside = Beside::mounts(problem)?;
    let Some(noise) = beside.gap(problem)? else { return Ok(None) };
    let log = Variant::of(recording, problem);
    let mut columns: Vec<(LateKind, Column)> = Vec::new();
    for (joint, node) in seen_joints(&problem.scene.body, &problem.scene.relevant) {
        let q = log.column(joint);
        let multiplier = problem.scene.body.nodes[node].command.1;
        let next = |f: usize| q[(f + 1).min(q.len() - 1)];
        let back: Vec<f64> = (0..q.len()).map(|f| multiplier * (q[f] - q[f.saturating_sub(1)])).collect();
        let ahead: Vec<f64> = (0..q.len()).map(|f| multiplier * (next(f) - q[f])).collect();
        for (kind, moved) in [(LateKind::Blend, back), (LateKind::Follow, ahead)] {
            if moved.iter().any(|m| *m != 0.0) {
                columns.push((kind, Column { atom: Atom::Joint(node), weight: Weight::Frames(moved) }));
            }
        }
    }
    let friction = friction_columns(problem, &log);
    let (mut group, mut start) = (beside.group.clone(), beside.start.clone());
    let first = group.columns.len();
    let late = columns.iter().map(|(_, column)| (column, USUAL_ROWS));
    for (column, std) in late.chain(friction.iter().map(|column| (column, USUAL_WIDTH))) {
        group.columns.push(column.clone());
        group.prior_std.push(std);
        start.group.push(0.0);
    }
    let none = Catalogue::new(&problem.scene, Vec::new(), &[]);
    let here = Linearised::at(problem, &none, &group, &start, FitOptions { noise, steps: 0 }, None)?;
    let first = here.first_group() + first;
    let first_friction = first + columns.len();
    let of_friction: Vec<usize> = (first_friction..first_friction + friction.len()).collect();
    let all: Vec<usize> = (first..first_friction).chain(of_friction.iter().copied()).collect();
    let of = |kind: LateKind| {
        let own = columns.iter().enumerate().filter(|(_, c)| c.0 == kind);
        let own: Vec<usize> = own.map(|(k, _)| first + k).collect();
        let (rows, log_bayes) = here.together(&own, &all, USUAL_ROWS)?;
        // A log that is early lies between the rows of the other side.
        let kind = match kind {
            _ if rows > 0.0 => kind,
            LateKind::Blend => LateKind::Follow,
            LateKind::Follow => LateKind::Blend,
        };
        Some((rows, kind, log_bayes))
    };
    let tried = [LateKind::Blend, LateKind::Follow].map(of);
    let best = tried.into_iter().flatten().max_by(|a, b| a.2.total_cmp(&b.2));
    let Some((rows, kind, log_bayes)) = best.filter(|b| b.2 > BEYOND_DOUBT && b.0.abs() < MOST_ROWS) else {
        return Ok(None);
    };
    if here.together(&of_friction, &all, USUAL_WIDTH).is_some_and(|friction| friction.1 > log_bayes) {
        return Ok(None);
    }
    let single = likeliest(problem.clone(), vocabulary(), &beside, noise)?.map_or(0.0, |best| best.log_bayes);
    let odds = log_bayes - single.max(0.0);
    Ok((odds > BEYOND_DOUBT).then_some((Mistake::Late { joint: None, rows, kind }, odds)))
}
