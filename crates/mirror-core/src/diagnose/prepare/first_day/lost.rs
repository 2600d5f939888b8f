//! Spoilt columns that no effect describes: another joint's values, values in another order, clipped, without signs, or
//! with another zero from a row on.
//!
//! For each joint its position in every posture is estimated freely. The joint that leaves the smallest loss is the
//! place, however large the errors are and whatever the nominal model says. Three alternatives follow for it:
//!
//! | alternative | parameters |
//! | --- | --- |
//! | the column is unrelated to the joint | a position in each posture |
//! | it is clipped | a position in each posture in which it has an extreme value that several postures share |
//! | it has another zero from a row on | the row, the offset |
//!
//! They compete with the mistakes that have a name by evidence ([`super::choice`]), in which each free position has its
//! Occam factor: a step, an inverted axis or a frozen run is named where it leaves as little. If the positions are free,
//! the column is not used at all, so no cause at its joint can compensate for it.

use super::alternatives::{Session, least, range};
use super::chain::{BEAM, Chain, FRAMES, extended, spread, unlike};
use super::freed::Free;
use super::misfit::Misfit;
use super::mistake::Mistake;
use super::spoilt::{Lost, column, node_of};
use super::undone::Undone;
use super::variant::Variant;
use super::verify::Tolerant;
use crate::diagnose::likelihood::saturated::postures;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::elementary::Column;
use crate::diagnose::model::pose::Pose;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::principles::{FEWEST_FRAMES, FEWEST_POSTURES, NEARLY_ALL, Prior, Size};
use crate::error::Result;
use crate::statistics::median;
use core::f64::consts::{PI, TAU};

/// Frames on which all joints are compared.
const FEW_FRAMES: Size = 16;
/// Joints for which the alternatives are made.
const JOINTS: Size = BEAM / 2;
/// Smallest spread of an unknown position, rad or m.
const LEAST_SPREAD: Prior = 0.05;

/// What hands mount, and the joints' zeros.
const BY_HAND: [&str; 4] = ["board_mount", "camera_mount", "marker_mount", "joint_offset"];

/// Range of an unknown position: a full turn, or the column's range and as much on both sides.
fn anywhere(session: &Session<'_>, node: NodeId, column: &[f64]) -> (f64, f64) {
    let (low, high) = range(column);
    let reach = session.problem.scene.reach_m.max(high - low);
    if session.turns(node) { (-PI, PI) } else { (low - reach, high + reach) }
}

/// How chains are searched.
pub(super) struct Searched<'a> {
    /// The frames on which losses are compared, in ascending order.
    pub frames: &'a [usize],
    /// Those on which positions are estimated: with the frames on which chains are compared later.
    pub shown: &'a [usize],
    /// By this the mean loss must fall.
    pub least_fall: f64,
    /// The chains of mistakes that have a name.
    pub of_words: &'a [Chain],
    /// Effects that are not to be found.
    pub without: &'a [String],
}

/// Chains with a spoilt column of a session that is gross; none if the named mistakes leave as little. Independent errors
/// that are not gross are left to the search (`selection::erratic_joint`), a small step to the change points
/// ([`super::changes`]).
pub(super) fn chains(session: &Session<'_>, nominal: &Chain, searched: &Searched<'_>) -> Vec<Chain> {
    let joints = joints_by_loss(session, nominal, searched.frames);
    let of_joint = |(joint, node)| of_joint(session, nominal, (joint, node), searched);
    joints.into_iter().take(JOINTS).flat_map(of_joint).collect()
}

/// The same if displaced mounts are as large as gross mistakes: these are fitted robustly, first at the logged positions,
/// which ranks the joints, and again for each joint with its positions free. Beside those mounts mistakes that have a name are
/// searched again too, if all that were found leave something gross. None where the mounts leave nothing gross.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn chains_beside_mounts(
    undone: &Undone,
    nominal: &Chain,
    searched: &Searched<'_>,
) -> Result<Vec<Chain>> {
    let (problem, log) = (&undone.problem, &undone.recording.columns);
    let misfit = Misfit::given(problem, &mounts_beside(undone, nominal, searched.frames)?)?;
    let session = Session::new(problem, &misfit, log);
    let nominal = nominal.at(&misfit, searched.frames);
    if !nominal.is_gross() {
        return Ok(Vec::new());
    }
    let mut out = Vec::new();
    for (joint, node) in joints_by_loss(&session, &nominal, searched.frames).into_iter().take(JOINTS) {
        problem.cancel.check()?;
        let free = unrelated(&session, &nominal, (joint, node), searched.frames);
        let misfit = Misfit::given(problem, &mounts_beside(undone, &free, searched.frames)?)?;
        let session = Session::new(problem, &misfit, log);
        let nominal = nominal.at(&misfit, searched.frames);
        // With mounts as they are, a mistake that has a name may be enough.
        if searched.of_words.iter().all(Chain::is_gross) {
            let named = extended(&session, searched.frames, &nominal, searched.without, searched.least_fall);
            out.splice(0..0, named.into_iter().filter(|chain| !chain.is_gross()));
        }
        out.extend(of_joint(&session, &nominal, (joint, node), searched));
    }
    unlike(&mut out, usize::MAX);
    Ok(out)
}

/// What mounts and joints' zeros do, fitted robustly beside a chain's mistakes and its free positions.
fn mounts_beside(undone: &Undone, chain: &Chain, frames: &[usize]) -> Result<Deformation> {
    let problem = chain.problem(undone, frames)?;
    let free = free_columns(chain, &problem, frames);
    Ok(Tolerant::of_effects(&problem, frames, undone.problem.noise, &BY_HAND, free)?.small_errors())
}

/// The joints, the one first whose free positions leave the smallest loss.
fn joints_by_loss(session: &Session<'_>, nominal: &Chain, frames: &[usize]) -> Vec<(usize, NodeId)> {
    let every = frames.len().div_ceil(FEW_FRAMES).max(1);
    let few: Vec<usize> = frames.iter().copied().step_by(every).collect();
    let left = |&(joint, node): &(usize, NodeId)| unrelated(session, nominal, (joint, node), &few).loss;
    let mut joints: Vec<(f64, (usize, NodeId))> = session.joints.iter().map(|j| (left(j), *j)).collect();
    joints.sort_by(|a, b| a.0.total_cmp(&b.0));
    joints.into_iter().map(|(_, joint)| joint).collect()
}

/// The column is unrelated to the joint: a position in each posture.
fn unrelated(
    session: &Session<'_>,
    nominal: &Chain,
    (joint, node): (usize, NodeId),
    frames: &[usize],
) -> Chain {
    let rows: Vec<usize> = (0..session.problem.frames.len()).collect();
    let bounds = anywhere(session, node, &nominal.variant.column(joint));
    let free = session.freed_in(&nominal.variant, &Free { joint, rows: &rows, shown: frames, bounds });
    Chain::new(vec![Mistake::ColumnLost { joint, rows }], free, session.misfit, frames)
}

/// The alternatives of one joint.
fn of_joint(
    session: &Session<'_>,
    nominal: &Chain,
    (joint, node): (usize, NodeId),
    &Searched { frames, shown, least_fall, of_words, .. }: &Searched<'_>,
) -> Vec<Chain> {
    // A frozen log has free positions too.
    let has_numbers = |c: &&Chain| !c.mistakes.iter().any(|m| matches!(m, Mistake::LogFrozen { .. }));
    let words = of_words.iter().filter(has_numbers);
    let left = words.map(|c| session.misfit.mean_loss(&c.variant, frames)).fold(nominal.loss, f64::min);
    let all = unrelated(session, nominal, (joint, node), shown).at(session.misfit, frames);
    if left - all.loss < least_fall {
        return Vec::new();
    }
    let mut out: Vec<Chain> = step(session, nominal, &all.variant, joint, frames).into_iter().collect();
    if let Some(rows) = at_extremes(session, &nominal.variant.column(joint)) {
        let mut variant = nominal.variant.clone();
        rows.iter().for_each(|&f| variant.positions[f][joint] = all.variant.positions[f][joint]);
        out.push(Chain::new(vec![Mistake::ColumnLost { joint, rows }], variant, session.misfit, frames));
    }
    out.push(all);
    // What is gross with all positions of a joint free is not that joint's column alone.
    out.retain(|c| {
        c.loss < nominal.loss - least_fall
            && !c.is_gross()
            && is_elsewhere(session, nominal, c, frames)
            && is_of_many(session, nominal, c, (frames, least_fall))
    });
    out
}

/// Whether the positions of a spoilt column are farther off than joints that rest badly are, whatever their zero is; another
/// mistake's are. Nor is a column unrelated whose errors are proportional to it: it is another gear's.
fn is_elsewhere(session: &Session<'_>, nominal: &Chain, chain: &Chain, frames: &[usize]) -> bool {
    let Some(Mistake::ColumnLost { joint, rows }) = chain.mistakes.last() else { return true };
    let turns = node_of(session.problem, *joint).is_some_and(|node| session.turns(node));
    let off = |f: &usize| {
        let off = chain.variant.positions[*f][*joint] - nominal.variant.positions[*f][*joint];
        // A turn more is the same position.
        if turns { off - (off / TAU).round() * TAU } else { off }
    };
    let own: Vec<&usize> = frames.iter().filter(|f| rows.binary_search(f).is_ok()).collect();
    let logged = |f: &&usize| nominal.variant.positions[**f][*joint];
    let off: Vec<(f64, f64)> = own.iter().map(|f| (logged(f), off(f))).collect();
    is_unrelated(&off)
}

/// Whether errors of a column, each with what the column says, are farther off than joints that rest badly are, and not proportional to
/// it but for a quarter of their size.
fn is_unrelated(points: &[(f64, f64)]) -> bool {
    let beside = BesideLine::of(points);
    let far = beside.mean > LEAST_SPREAD.powi(2) * points.len() as f64;
    far && beside.line > (1.0 - NEARLY_ALL).powi(2) * beside.mean
}

/// What is left of the ordinates of some points, squared and summed: beside their mean, and beside a line.
struct BesideLine {
    mean: f64,
    line: f64,
}

impl BesideLine {
    /// `Σ (y − ȳ)²` and `Σ (y − ȳ − b (x − x̄))²`; points at one abscissa have no line.
    fn of(points: &[(f64, f64)]) -> Self {
        let count = points.len().max(1) as f64;
        let middle = points.iter().fold((0.0, 0.0), |sum, p| (sum.0 + p.0 / count, sum.1 + p.1 / count));
        let from_middle = points.iter().map(|p| (p.0 - middle.0, p.1 - middle.1));
        let (xx, xy, mean) =
            from_middle.fold((0.0, 0.0, 0.0), |sum, (x, y)| (sum.0 + x * x, sum.1 + x * y, sum.2 + y * y));
        Self { mean, line: if xx > 0.0 { (mean - xy * xy / xx).max(0.0) } else { mean } }
    }
}

/// Whether a column is spoilt in more than a quarter of its rows: without those that gain most the others still gain.
/// Fewer rows are false by themselves ([`super::outlying`]).
fn is_of_many(
    session: &Session<'_>,
    nominal: &Chain,
    chain: &Chain,
    (frames, least_fall): (&[usize], f64),
) -> bool {
    let Some(Mistake::ColumnLost { rows, .. }) = chain.mistakes.last() else { return true };
    let own: Vec<usize> = frames.iter().copied().filter(|f| rows.binary_search(f).is_ok()).collect();
    let losses = |variant: &Variant| {
        let mut out = vec![(0.0, 0.0); own.len()];
        for d in session.misfit.distances(variant, &own) {
            if let Ok(at) = own.binary_search(&d.frame) {
                out[at].0 += session.misfit.loss(d.size_m);
                out[at].1 += 1.0;
            }
        }
        out
    };
    let (before, after) = (losses(&nominal.variant), losses(&chain.variant));
    let mut gains: Vec<(f64, f64)> = before.iter().zip(&after).map(|(b, a)| (b.0 - a.0, b.1)).collect();
    gains.retain(|gain| gain.1 > 0.0);
    gains.sort_by(|a, b| (a.0 / a.1).total_cmp(&(b.0 / b.1)));
    gains.truncate((NEARLY_ALL * gains.len() as f64).ceil() as usize);
    let sum = |of: fn(&(f64, f64)) -> f64| gains.iter().map(of).sum::<f64>();
    sum(|gain| gain.0) > least_fall * sum(|gain| gain.1)
}

/// The rows in which a column has its lowest or highest value, if several postures share it.
fn at_extremes(session: &Session<'_>, column: &[f64]) -> Option<Vec<usize>> {
    let (low, high) = range(column);
    let is_at = |value: f64, f: usize| (column[f] - value).abs() < 1e-9;
    let is_shared =
        |value: &f64| session.postures.iter().filter(|p| is_at(*value, p[0])).count() >= FEWEST_POSTURES;
    let shared: Vec<f64> = [low, high].into_iter().filter(is_shared).collect();
    let rows: Vec<usize> =
        (0..column.len()).filter(|&f| shared.iter().any(|&value| is_at(value, f))).collect();
    (!rows.is_empty() && rows.len() < column.len()).then_some(rows)
}

/// Another zero from a row on, estimated from the column's free positions.
fn step(
    session: &Session<'_>,
    nominal: &Chain,
    free: &Variant,
    joint: usize,
    frames: &[usize],
) -> Option<Chain> {
    if !session.ordered {
        return None;
    }
    let error = |f: usize| free.positions[f][joint] - nominal.variant.positions[f][joint];
    let errors: Vec<f64> = frames.iter().map(|&f| error(f)).collect();
    let usual = session.misfit.usual_m / session.problem.scene.reach_m.max(1e-9);
    let cost =
        |errors: &[f64], at: f64| -> f64 { errors.iter().map(|e| ((e - at) / usual).powi(2).ln_1p()).sum() };
    let middle = |errors: &[f64]| median(errors.to_vec());
    let (_, first, before, offset) = (FEWEST_POSTURES..errors.len().saturating_sub(FEWEST_POSTURES))
        .map(|k| {
            let (before, after) = (middle(&errors[..k]), middle(&errors[k..]));
            (cost(&errors[..k], before) + cost(&errors[k..], after), frames[k], before, after - before)
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))?;
    // The joint's zero before the step is one with displaced mounts that were fitted at both zeros.
    let mut as_before = nominal.variant.clone();
    as_before.positions.iter_mut().for_each(|row| row[joint] += before);
    let begun = Chain::new(Vec::new(), as_before, session.misfit, frames);
    let of =
        |first: usize, offset: f64| begun.with(&Mistake::ZeroLost { joint, first, offset }, session, frames);
    let offset = least(offset - 2.0 * usual, offset + 2.0 * usual, |x| of(first, x).loss);
    // Exact row: the largest gain of all rows from it on.
    let mut moved = begun.variant.clone();
    moved.positions.iter_mut().for_each(|row| row[joint] += offset);
    let (own, other) = (session.misfit.frame_losses(&begun.variant), session.misfit.frame_losses(&moved));
    let mut sum = 0.0;
    let gains = (0..own.len()).rev().map(|f| {
        sum += own[f].0 - other[f].0;
        (sum, f)
    });
    let (_, first) = gains.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let inside = first >= FEWEST_FRAMES && own.len() - first >= FEWEST_FRAMES;
    inside.then(|| of(first, offset))
}

/// The free positions of a chain: for each posture in some frames, and for the rows behind a lost zero, a column, its prior
/// deviation and its start.
pub(super) fn free_columns(chain: &Chain, problem: &Problem, frames: &[usize]) -> Vec<(Column, f64, f64)> {
    let mut out = Vec::new();
    for mistake in &chain.mistakes {
        if let Mistake::ZeroLost { joint, first, .. } = *mistake {
            // Its offset is known to a few usual errors.
            let rows: Vec<usize> = (first..problem.frames.len()).collect();
            out.extend(node_of(problem, joint).map(|node| (column(problem, node, &rows), LEAST_SPREAD, 0.0)));
        }
        let (joint, rows) = match mistake {
            Mistake::ColumnLost { joint, rows } => (*joint, rows.clone()),
            Mistake::LogFrozen { joint, first, last } => (*joint, (*first..=*last).collect()),
            _ => continue,
        };
        let Some(node) = node_of(problem, joint) else { continue };
        let found: Vec<f64> = rows.iter().map(|&f| chain.variant.positions[f][joint]).collect();
        let std = spread_of(&found);
        for posture in postures(problem) {
            let own: Vec<usize> = posture.into_iter().filter(|f| rows.binary_search(f).is_ok()).collect();
            if own.iter().any(|f| frames.binary_search(f).is_ok()) {
                out.push((column(problem, node, &own), std, 0.0));
            }
        }
    }
    out
}

/// The unknown positions of a joint, on all frames, and the unknown frame of measured points beside them; beside mounts as
/// they are displaced, if these are gross.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn lost(undone: &Undone, joint: usize, rows: &[usize]) -> Result<Option<(Lost, Option<Pose>)>> {
    let problem = &undone.problem;
    let Some(node) = node_of(problem, joint) else { return Ok(None) };
    let variant = Variant::of(&undone.recording, problem);
    let logged = variant.column(joint);
    let freed = |misfit: &Misfit<'_>| {
        let session = Session::new(problem, misfit, &undone.recording.columns);
        let bounds = anywhere(&session, node, &logged);
        let free = session.freed_in(&variant, &Free { joint, rows, shown: rows, bounds });
        let frames = spread(&session.postures, FRAMES, 1);
        let mistake = Mistake::ColumnLost { joint, rows: rows.to_vec() };
        (Chain::new(vec![mistake], free, misfit, &frames), frames)
    };
    let mut misfit = Misfit::new(problem)?;
    let (mut free, frames) = freed(&misfit);
    if free.is_gross() {
        misfit = Misfit::given(problem, &mounts_beside(undone, &free, &frames)?)?;
        (free, _) = freed(&misfit);
    }
    let free = free.variant;
    let frame = misfit.placed(&free, &frames).map(|placed| placed.pose);
    let multiplier = problem.scene.body.nodes[node].command.1;
    let postures: Vec<(Vec<usize>, f64)> = postures(problem)
        .into_iter()
        .map(|p| p.into_iter().filter(|f| rows.binary_search(f).is_ok()).collect::<Vec<usize>>())
        .filter(|own| !own.is_empty())
        .map(|own| {
            let error = free.positions[own[0]][joint] - logged[own[0]];
            // A turn more is the same position.
            let turns = if problem.scene.body.nodes[node].prismatic { 0.0 } else { (error / TAU).round() };
            let error = multiplier * (error - turns * TAU);
            (own, error)
        })
        .collect();
    let errors: Vec<f64> = postures.iter().map(|p| p.1).collect();
    let square = errors.iter().map(|e| e * e).sum::<f64>() / errors.len().max(1) as f64;
    Ok(Some((Lost { node, postures, spread: square.sqrt().max(LEAST_SPREAD) }, frame)))
}

fn spread_of(values: &[f64]) -> f64 {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt().max(LEAST_SPREAD)
}

#[cfg(test)]
mod tests {
    use super::{BesideLine, is_unrelated};

    #[test]
    fn a_line_leaves_what_is_beside_it() {
        let line = |x: f64| (x, 0.3 - 0.5 * x);
        let on = [-1.0, -0.2, 0.4, 1.7].map(line);
        let left = BesideLine::of(&on);
        assert!(
            left.line < 1e-15 && (left.mean - 0.25 * 3.8875).abs() < 1e-12,
            "{} {}",
            left.line,
            left.mean
        );
        // ±0.1 by turns, which no line follows: nearly all of it stays.
        let beside: Vec<(f64, f64)> =
            on.iter().zip([0.1, -0.1, -0.1, 0.1]).map(|(p, by)| (p.0, p.1 + by)).collect();
        let left = BesideLine::of(&beside).line;
        assert!(left > 0.035 && left < 0.04, "{left}");
        // A column that stays at one value has no line.
        let still = BesideLine::of(&[(1.0, 0.0), (1.0, 2.0)]);
        assert_eq!((still.mean, still.line), (2.0, 2.0));
        assert_eq!(BesideLine::of(&[]).line, 0.0);
    }

    #[test]
    fn a_column_of_another_gear_is_not_unrelated() {
        let column = [-1.9, -1.6, -0.2, 0.6, 0.3, -1.1, -1.0, 0.5, 1.1, -0.6];
        let off_by = [0.05, -0.03, 0.04, -0.06, 0.02, -0.05, 0.03, 0.06, -0.04, -0.02];
        let errors = |of: fn(f64, f64) -> f64| -> Vec<(f64, f64)> {
            column.iter().zip(off_by).map(|(q, by)| (*q, of(*q, by))).collect()
        };
        // Twice the position, with another zero; the other way; a ratio that is nearly right.
        assert!(!is_unrelated(&errors(|q, by| 0.3 - 0.5 * q + by)));
        assert!(!is_unrelated(&errors(|q, by| -2.0 * q + by)));
        assert!(!is_unrelated(&errors(|q, by| 0.02 * q + 0.2 * by)));
        // Without signs; in another order; held at one value.
        assert!(is_unrelated(&errors(|q, by| q - q.abs() + by)));
        assert!(is_unrelated(&errors(|q, by| 20.0 * by - q)));
        let held: Vec<(f64, f64)> = column.iter().map(|q| (0.7, *q)).collect();
        assert!(is_unrelated(&held));
    }
}
