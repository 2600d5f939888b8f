//! Boards that are none: a grid found elsewhere in the picture shows no flat mirror.

use crate::diagnose::data::diagnosis::LeftOut;
use crate::diagnose::model::problem::{FrameData, Problem};
use crate::diagnose::principles::{FAR_DEVIATIONS, FEWEST_FRAMES, NEARLY_ALL, Threshold};
use crate::statistics::best_run;

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
    let wrong =
        but_for_the_last(wrong, &(0..problem.frames.len()).map(|f| rms(f).is_some()).collect::<Vec<_>>());
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

/// Wrong boards but for those of a run to the session's end: from there on board or camera sit elsewhere.
fn but_for_the_last(mut wrong: Vec<(usize, f64)>, has_board: &[bool]) -> Vec<(usize, f64)> {
    // A run of which nearly all are wrong.
    let right = -NEARLY_ALL / (1.0 - NEARLY_ALL);
    let boards: Vec<usize> = (0..has_board.len()).filter(|&f| has_board[f]).collect();
    let gain = |f: &usize| if wrong.iter().any(|w| w.0 == *f) { 1.0 } else { right };
    let gains: Vec<f64> = boards.iter().map(gain).collect();
    if let Some((first, last)) = best_run(&gains)
        && last + 1 == boards.len()
        && last + 1 - first >= FEWEST_FRAMES
    {
        wrong.retain(|w| w.0 < boards[first]);
    }
    wrong
}
