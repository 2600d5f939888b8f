//! Gross mistakes of camera and board: a wrong resolution, a mirrored picture, a rotated board.
//!
//! The boards alone show them: with these mistakes no flat mirror explains their corners. A camera that was mounted
//! askew by hand has nearly the same effect, so the most probable mistake is compared with small errors of every
//! kind ([`super::verify`]).

use super::chain::FRAMES;
use super::misfit::Misfit;
use super::mistake::Mistake;
use super::resolutions;
use super::variant::Variant;
use super::verify::{Tolerant, smaller};
use crate::cancel::Cancel;
use crate::diagnose::data::recording::Recording;
use crate::diagnose::effects::camera_center::CameraCenter;
use crate::diagnose::effects::{Effect, Place};
use crate::diagnose::model::problem::Problem;
use crate::diagnose::prepare::boards::USUAL_CORNER_PX;
use crate::diagnose::principles::{ABOVE_SCATTER, BEYOND_DOUBT, Prior, SURE_DEVIATIONS, Threshold};
use crate::error::Result;
use crate::robot::Robot;

/// A mean loss that right optics do not reach, and by which losses of corners and markers together must fall.
pub(super) const CLEAR_LOSS: Threshold = 0.5;
/// Effects that move the boards' corners besides a crop of the picture: the mounts of camera and board, the board's
/// print.
const OF_BOARDS: [&str; 4] = ["camera_center", "camera_mount", "board_mount", "board_scale"];
/// The loss of a frame whose board no mirror shows.
const NO_MIRROR: Prior = 8.0;

/// The mistake of the optics that corrects boards and markers, if there is one, with its log odds against small
/// errors. `closely`: another crop is also searched for if boards and markers are nearly right.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn find(
    robot: &Robot,
    recording: &Recording,
    without: &[String],
    closely: bool,
    cancel: &Cancel,
) -> Result<Option<(Mistake, f64)>> {
    if recording.sight.as_ref().is_none_or(|s| s.board.is_none()) {
        return Ok(None);
    }
    let step = recording.frames.len().div_ceil(FRAMES).max(1);
    let mut few = recording.clone();
    few.frames = recording.frames.iter().step_by(step).cloned().collect();
    let nominal = loss(robot, &few)?;
    // A mistake of the optics affects every board: if some are right, the others are wrong. In a mirror at an
    // unknown distance a board hardly shows another focal length; then the markers do.
    let nearly_right = nominal.better < CLEAR_LOSS && !(nominal.markers > CLEAR_LOSS);
    if nearly_right && !closely {
        return Ok(None);
    }
    let mut alternatives: Vec<Mistake> = (1..=3).map(|flip| Mistake::Flipped { flip }).collect();
    alternatives.extend((1..=3).map(|quarters| Mistake::BoardTurned { quarters }));
    alternatives.extend(resolutions::all());
    if nearly_right {
        alternatives.clear();
    }
    alternatives.retain(|m| !without.iter().any(|w| w == m.effect()));
    let problem = Problem::new(robot, &few)?;
    let mut best: Option<(f64, Mistake)> = None;
    for mistake in alternatives {
        cancel.check()?;
        let (mut robot, mut tried) = (robot.clone(), few.clone());
        if mistake.undo(&mut robot, &problem, &mut tried).is_err() {
            continue;
        }
        let Ok(loss) = loss(&robot, &tried) else { continue };
        // The markers' part counts if the body is right; a mistake of the body must not hide the boards'.
        let gain = nominal.corners - loss.corners + 0.5 * (nominal.markers - loss.markers);
        let gain = if gain.is_finite() { gain } else { nominal.corners - loss.corners };
        if gain > best.as_ref().map_or(CLEAR_LOSS, |b| b.0) {
            best = Some((gain, mistake));
        }
    }
    let cropped = || crop(&problem).filter(|m| !without.iter().any(|w| w == m.effect()));
    let best = best.map(|b| resolutions::likeliest(robot, &few, &problem, b.1)).transpose()?;
    for mistake in best.into_iter().chain(core::iter::once_with(cropped).flatten()) {
        let odds = log_odds(robot, &few, &problem, &mistake)?;
        if odds > BEYOND_DOUBT {
            return Ok(Some((mistake, odds)));
        }
    }
    Ok(None)
}

/// Another crop of the picture, larger than the usual error of a centre, from the boards alone. Body and markers
/// have no influence; with a gross mistake of these the corners' loss, which small errors hardly change, says
/// little. Its parameters stay free in the search.
fn crop(problem: &Problem) -> Option<Mistake> {
    let mut boards = problem.clone();
    boards.frames.iter_mut().for_each(|frame| frame.others.clear());
    let shown: Vec<usize> = (0..boards.boards.len()).filter(|&f| boards.boards[f].is_some()).collect();
    let fit = Tolerant::of_effects(&boards, &shown, problem.noise, &OF_BOARDS, Vec::new()).ok()?;
    // Boards that are still far from the noise have another error: for example a joint between camera and board.
    if fit.noise.corner_px > ABOVE_SCATTER * problem.noise.corner_px {
        return None;
    }
    let offset_px = fit.deformation().center_px;
    let usual_px = CameraCenter.prior_std(&problem.scene, Place::Camera);
    let is_large = offset_px.iter().zip(&usual_px).any(|(px, usual)| px.abs() > SURE_DEVIATIONS * usual);
    is_large.then_some(Mistake::Resolution { factor: 1.0, offset_px })
}

/// Log odds of a mistake against small errors, which are free in both models, on the frames in which either is
/// possible; infinite if small errors leave most of the boards without a mirror.
fn log_odds(robot: &Robot, few: &Recording, nominal: &Problem, mistake: &Mistake) -> Result<f64> {
    let (mut robot, mut recording) = (robot.clone(), few.clone());
    mistake.undo(&mut robot, nominal, &mut recording)?;
    let undone = Problem::new(&robot, &recording)?;
    let shown = |problem: &Problem| -> Vec<usize> {
        (0..problem.boards.len()).filter(|&f| problem.boards[f].is_some()).collect()
    };
    let mut with = Tolerant::fitted(&undone, &shown(&undone), nominal.noise)?;
    let Ok(mut without) = Tolerant::fitted(nominal, &shown(nominal), nominal.noise) else {
        return Ok(f64::INFINITY);
    };
    let can = with.predicted()?;
    let both: Vec<usize> = without.predicted()?.into_iter().filter(|f| can.contains(f)).collect();
    if 2 * both.len() < can.len() {
        return Ok(f64::INFINITY);
    }
    let noise = smaller(with.noise, without.noise);
    with.keep(&both);
    without.keep(&both);
    let Ok(small_errors) = without.log_evidence(noise) else { return Ok(f64::INFINITY) };
    let odds = with.log_evidence(noise)? - small_errors;
    // What a fit loses on its way to the evidence counts as nothing seen, not as no misfit.
    Ok(if without.predicted()?.len() < both.len() { f64::INFINITY } else { odds })
}

struct Loss {
    corners: f64,
    /// Of the better boards.
    better: f64,
    markers: f64,
}

fn loss(robot: &Robot, recording: &Recording) -> Result<Loss> {
    let problem = Problem::new(robot, recording)?;
    let misfit = Misfit::new(&problem)?;
    let frames: Vec<usize> = (0..problem.frames.len()).collect();
    let mut boards: Vec<f64> = frames
        .iter()
        .filter(|&&f| problem.frames[f].corners.len() > 3)
        .map(|&f| {
            problem.boards[f].map_or(NO_MIRROR, |b| {
                let freedom = (2.0 * b.corners as f64 - 3.0).max(1.0);
                (b.chi2_px2 / freedom / USUAL_CORNER_PX.powi(2)).ln_1p().min(NO_MIRROR)
            })
        })
        .collect();
    let corners = boards.iter().sum::<f64>() / boards.len().max(1) as f64;
    boards.sort_by(f64::total_cmp);
    let better = boards.get(boards.len() / 5).copied().unwrap_or(0.0);
    let markers = misfit.mean_loss(&Variant::of(recording, &problem), &frames);
    Ok(Loss { corners, better, markers })
}
