//! Observations that the best model shows to be false: another marker's, a reflection's, a detection error.

use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::frame::{FrameWork, Task};
use crate::diagnose::model::problem::{Noise, Problem};
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
        let mut residuals = work.residuals_of(&data.others).into_iter();
        data.others.retain(|observation| {
            let residual = residuals.next().flatten();
            // Of a marker and not predicted at all: as false as can be.
            observation.marker().is_none()
                || residual.is_some_and(|r| r.norm() <= FAR_DEVIATIONS * observation.marker_std(noise))
        });
    }
    Ok(out)
}
