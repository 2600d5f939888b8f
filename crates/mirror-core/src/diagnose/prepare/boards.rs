//! Boards that are none: a grid found elsewhere in the picture shows no flat mirror.

use crate::diagnose::data::diagnosis::LeftOut;
use crate::diagnose::model::problem::{FrameData, Problem};
use crate::diagnose::principles::{FAR_DEVIATIONS, NEARLY_ALL, Threshold};

/// A board whose residual is beyond this, and far beyond those of the better boards and the stated noise, is of a wrong grid, px: real ones
/// have 1.7 to 2.6 px where good views have 0.3 to 0.5.
pub(super) const USUAL_CORNER_PX: Threshold = 1.0;

/// Leaves out the boards that no mirror explains, and with them what was seen in those mirrors.
pub(crate) fn leave_out_wrong_grids(problem: &mut Problem) -> Vec<LeftOut> {
    let rms = |f: usize| -> Option<f64> {
        let board = problem.boards.get(f).copied().flatten()?;
        Some((board.chi2_px2 / (2.0 * board.corners as f64 - 3.0).max(1.0)).sqrt())
    };
    let mut all: Vec<f64> = (0..problem.frames.len()).filter_map(rms).collect();
    all.sort_by(f64::total_cmp);
    // Nearly all of the others may be wrong.
    let Some(better) = all.get((all.len() as f64 * (1.0 - NEARLY_ALL)) as usize).copied() else {
        return Vec::new();
    };
    let most = (FAR_DEVIATIONS * better.max(problem.noise.corner_px)).max(USUAL_CORNER_PX);
    let wrong: Vec<(usize, f64)> =
        (0..problem.frames.len()).filter_map(|f| Some((f, rms(f)?))).filter(|(_, r)| *r > most).collect();
    let told = wrong
        .iter()
        .map(|&(f, rms)| LeftOut {
            frame: problem.frame_numbers[f],
            target: "board".to_owned(),
            deviations: Some(rms / better.max(problem.noise.corner_px)),
            why: "no flat mirror shows its corners where they are seen: another grid, or another picture"
                .to_owned(),
        })
        .collect();
    for (f, _) in wrong {
        let others = core::mem::take(&mut problem.frames[f].others);
        problem.frames[f] = FrameData { corners: Vec::new(), others };
        problem.boards[f] = None;
    }
    told
}
