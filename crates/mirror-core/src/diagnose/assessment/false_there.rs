//! What a diagnosis of another session would leave out of it: boards that no mirror explains, and false observations of markers.
//!
//! Nothing is fitted to that session, so the model may be wrong there, and its misfits are what a check is for. An observation is
//! false where
//!
//! * it is far from the model by the noise that the model leaves there, as in a diagnosis, and by what it leaves of this marker: a
//!   root mean square without the largest 2 %, so that a model that is wrong about a marker in more than a few observations
//!   makes none of them false;
//! * another view of the same marker in the same posture contradicts it, if there is one: all views of a posture show the same body,
//!   so what all of them tell is no detection's error.

use crate::diagnose::assessment::evidence::same;
use crate::diagnose::data::checked::LeftOutThere;
use crate::diagnose::data::recording::Via;
use crate::diagnose::likelihood::noise::trimmed_share;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::frame::{FrameWork, Task};
use crate::diagnose::model::problem::{FrameData, Noise, Observation, Problem};
use crate::diagnose::principles::FAR_DEVIATIONS;
use crate::error::Result;
use std::collections::BTreeMap;

/// An observation of a marker that can be predicted, and by how many deviations of the noise it is off; infinite where the model
/// does not see it, or it is so far off that it has no weight.
struct Seen {
    frame: usize,
    index: usize,
    marker: usize,
    posture: i64,
    dimensions: f64,
    deviations: f64,
}

/// A session without the observations that a model shows to be false; none where it shows none.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn without_contradicted(
    problem: &Problem,
    deformation: &Deformation,
    noise: Noise,
) -> Result<Option<Problem>> {
    let seen = seen(problem, deformation, noise)?;
    let limits: Vec<f64> = (0..problem.marker_sites.len())
        .map(|marker| FAR_DEVIATIONS * left_of(seen.iter().filter(|s| s.marker == marker)).max(1.0))
        .collect();
    let is_far = |s: &Seen| s.deviations > limits[s.marker];
    let mut views: BTreeMap<(i64, usize), (usize, usize)> = BTreeMap::new();
    for s in &seen {
        let (all, far) = views.entry((s.posture, s.marker)).or_default();
        *all += 1;
        *far += usize::from(is_far(s));
    }
    let agree = |s: &Seen| views.get(&(s.posture, s.marker)).is_some_and(|(all, far)| *all > 1 && far == all);
    let mut out: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for s in seen.iter().filter(|s| is_far(s) && !agree(s)) {
        out.entry(s.frame).or_default().push(s.index);
    }
    if out.is_empty() {
        return Ok(None);
    }
    let mut clean = problem.clone();
    for (frame, indices) in out {
        let mut at = 0;
        clean.frames[frame].others.retain(|_| {
            at += 1;
            !indices.contains(&(at - 1))
        });
    }
    Ok(Some(clean))
}

fn seen(problem: &Problem, deformation: &Deformation, noise: Noise) -> Result<Vec<Seen>> {
    let eye = problem.eye(deformation)?;
    let task = Task { gaussian: false, ..Task::of_residuals(problem, deformation, eye.as_ref(), noise) };
    let mut work = FrameWork::new(problem);
    let mut out = Vec::new();
    for (frame, data) in problem.frames.iter().enumerate() {
        if !work.evaluate(problem, &task, frame) {
            continue;
        }
        let residuals = work.residuals_of(&data.others);
        for (index, (observation, residual)) in data.others.iter().zip(residuals).enumerate() {
            let (marker, in_mirror) = way(observation);
            // In a mirror that no board shows nothing is compared, and nothing need be left out.
            let Some(marker) = marker.filter(|_| !in_mirror || problem.boards[frame].is_some()) else {
                continue;
            };
            let deviations = residual.map(|r| r.norm() / observation.marker_std(noise));
            out.push(Seen {
                frame,
                index,
                marker,
                posture: problem.posture[frame],
                dimensions: if matches!(observation, Observation::Point { .. }) { 3.0 } else { 2.0 },
                deviations: deviations.unwrap_or(f64::INFINITY),
            });
        }
    }
    Ok(out)
}

/// The root mean square of what the model leaves of a marker, without the largest: one at least, which may be the false one.
fn left_of<'a>(of_marker: impl Iterator<Item = &'a Seen>) -> f64 {
    let mut squares: Vec<f64> = of_marker.map(|s| s.deviations.powi(2) / s.dimensions).collect();
    squares.sort_by(f64::total_cmp);
    let largest = (squares.len() as f64 * trimmed_share()).ceil() as usize;
    squares.truncate(squares.len().saturating_sub(largest));
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

/// Leaves the same out of the session as it was given as of the one with its mistakes undone: of `whole`, what `clean` lacks.
pub(super) fn leave_out_of(given: &mut Problem, whole: &Problem, clean: &Problem) {
    for (f, own) in given.frames.iter_mut().enumerate() {
        if whole.boards[f].is_some() && clean.boards[f].is_none() {
            own.corners.clear();
            given.boards[f] = None;
        }
        let stays = kept_in(&whole.frames[f], &clean.frames[f]);
        if own.others.len() == stays.len() {
            let mut at = stays.iter();
            own.others.retain(|_| at.next().copied().unwrap_or(true));
        } else {
            // Undoing a mistake left some of this frame unknown: what is compared after is compared before.
            let left = &clean.frames[f].others;
            own.others.retain(|o| o.marker().is_none() || left.iter().any(|k| way(k) == way(o)));
        }
    }
}

/// What was left out of a session: of `whole`, what `clean` lacks; none where that is nothing.
pub(super) fn told(whole: &Problem, clean: &Problem) -> Option<LeftOutThere> {
    let boards =
        (0..whole.boards.len()).filter(|&f| whole.boards[f].is_some() && clean.boards[f].is_none()).count();
    let (mut points, mut points_given) = (0, 0);
    for (frame, left) in whole.frames.iter().zip(&clean.frames) {
        for (observation, stay) in frame.others.iter().zip(kept_in(frame, left)) {
            points_given += usize::from(observation.marker().is_some());
            points += usize::from(!stay);
        }
    }
    (points + boards > 0).then_some(LeftOutThere { points, points_given, boards })
}

/// The marker, and whether it is seen in the mirror.
fn way(observation: &Observation) -> (Option<usize>, bool) {
    (observation.marker(), matches!(observation, Observation::Pixel { via: Via::Mirror, .. }))
}

/// Which observations of a frame another one, from which some were taken, still has.
fn kept_in(whole: &FrameData, clean: &FrameData) -> Vec<bool> {
    let mut left = clean.others.iter().filter(|o| o.marker().is_some()).peekable();
    let mut stays = |o: &Observation| o.marker().is_none() || left.next_if(|k| same(k, o)).is_some();
    whole.others.iter().map(&mut stays).collect()
}
