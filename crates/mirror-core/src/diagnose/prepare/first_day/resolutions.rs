//! Which of the resolutions that cameras offer a camera file is of.
//!
//! A camera that was mounted askew shifts the picture as another centre does, so with mounts by hand the factor that fits
//! the boards best at the model's mounts may be the neighbour of the right one. The factors around it are compared beside
//! all small errors ([`super::verify`]): beside the wrong one centre and focal length must be far from usual.

use super::mistake::Mistake;
use super::verify::{Tolerant, smaller};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::model::problem::Problem;
use crate::diagnose::principles::Size;
use crate::error::Result;
use crate::robot::Robot;
use nalgebra::Vector2;

/// Factors between resolutions that cameras and drivers offer, in ascending order; each also the other way round.
const FACTORS: [f64; 8] = [1.25, 4.0 / 3.0, 1.5, 1.6, 2.0, 2.4, 3.0, 4.0];
/// Factors that are compared on each side of the one that fits best.
const NEIGHBOURS: Size = 2;

/// All factors in ascending order.
fn factors() -> impl Iterator<Item = f64> {
    FACTORS.iter().rev().map(|factor| 1.0 / factor).chain(FACTORS)
}

/// A camera file of another resolution, the whole picture.
fn of(factor: f64) -> Mistake {
    Mistake::Resolution { factor, offset_px: Vector2::zeros() }
}

/// A camera file of each other resolution.
pub(super) fn all() -> impl Iterator<Item = Mistake> {
    factors().map(of)
}

/// The factor of another resolution that a ratio of focal lengths is, within this of it.
pub(crate) fn resolution_near(ratio: f64, within: f64) -> Option<f64> {
    factors().find(|factor| (factor - ratio).abs() < within)
}

/// The likeliest beside small errors, of a factor and its neighbours; any other mistake as it is.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn likeliest(
    robot: &Robot,
    recording: &Recording,
    problem: &Problem,
    mistake: Mistake,
) -> Result<Mistake> {
    let Mistake::Resolution { factor, .. } = mistake else { return Ok(mistake) };
    let Some(at) = factors().position(|other| other == factor) else { return Ok(mistake) };
    let around = factors().skip(at.saturating_sub(NEIGHBOURS)).take(at.min(NEIGHBOURS) + 1 + NEIGHBOURS);
    let mut fits = Vec::new();
    for factor in around {
        problem.cancel.check()?;
        let (mut robot, mut recording) = (robot.clone(), recording.clone());
        if of(factor).undo(&mut robot, problem, &mut recording).is_err() {
            continue;
        }
        let undone = Problem::new(&robot, &recording)?;
        let shown: Vec<usize> = (0..undone.boards.len()).filter(|&f| undone.boards[f].is_some()).collect();
        if let Ok(fit) = Tolerant::fitted(&undone, &shown, problem.noise) {
            fits.push((factor, fit.predicted()?, fit));
        }
    }
    // What most boards cannot be seen with is not compared.
    let most = fits.iter().map(|fit| fit.1.len()).max().unwrap_or(0);
    fits.retain(|fit| 2 * fit.1.len() > most);
    let Some(noise) = fits.iter().map(|fit| fit.2.noise).reduce(smaller) else { return Ok(mistake) };
    let mut frames: Vec<usize> = fits[0].1.clone();
    frames.retain(|f| fits.iter().all(|fit| fit.1.contains(f)));
    let mut best = (f64::NEG_INFINITY, factor);
    for (factor, _, mut fit) in fits {
        fit.keep(&frames);
        // A fit that comes to no evidence is no candidate.
        if let Ok(evidence) = fit.log_evidence(noise)
            && evidence > best.0
        {
            best = (evidence, factor);
        }
    }
    Ok(of(best.1))
}
