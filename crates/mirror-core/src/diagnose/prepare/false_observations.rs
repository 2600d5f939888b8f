//! Observations that the best model shows to be false: another marker's, a reflection's, a detector's slip.

use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::frame::{FrameWork, Task};
use crate::diagnose::model::problem::{Noise, Observation, Problem, Seen};
use crate::diagnose::principles::FAR_DEVIATIONS;
use crate::error::Result;

/// A problem without the observations that a model shows to be false (farther off than [`FAR_DEVIATIONS`] of the noise), and
/// their share of the markers' observations.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn without_false(
    problem: &Problem,
    deformation: &Deformation,
    noise: Noise,
) -> Result<(Problem, f64)> {
    let clean = kept(problem, deformation, noise)?;
    let counted = |p: &Problem| p.frames.iter().map(|f| f.others.len()).sum::<usize>() as f64;
    let share = (counted(problem) - counted(&clean)) / counted(problem).max(1.0);
    Ok((clean, share))
}

fn kept(problem: &Problem, deformation: &Deformation, noise: Noise) -> Result<Problem> {
    let eye = problem.eye(deformation)?;
    let task = Task { gaussian: false, ..Task::of_residuals(problem, deformation, eye.as_ref(), noise) };
    let mut out = problem.clone();
    let mut work = FrameWork::new(problem);
    for (f, data) in out.frames.iter_mut().enumerate() {
        if !work.evaluate(problem, &task, f) {
            continue;
        }
        let mut residuals = Vec::new();
        work.raw_residuals(|marker, measured, r| residuals.push((marker, measured, r.norm())));
        let mut at = 0;
        data.others.retain(|observation| {
            let (marker, std) = match observation {
                Observation::Pixel { seen: Seen::Marker(m), .. } => (*m, noise.marker_px),
                Observation::Point { marker, .. } => (*marker, noise.point_m),
                Observation::Pixel { .. } => return true,
            };
            match residuals.get(at) {
                Some((Some(m), _, size)) if *m == marker => {
                    at += 1;
                    *size <= FAR_DEVIATIONS * std
                }
                // Not predicted at all: as false as can be.
                _ => false,
            }
        });
    }
    Ok(out)
}
