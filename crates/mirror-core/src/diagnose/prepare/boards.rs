//! False boards: a grid detected elsewhere in the picture, which no flat mirror explains.

use crate::diagnose::data::left_out::{LeftOut, Reason};
use crate::diagnose::model::problem::{BoardFit, FrameData, Problem};
use crate::diagnose::principles::{FAR_DEVIATIONS, FEWEST_FRAMES, NEARLY_ALL, Threshold};
use crate::statistics::best_run;

/// A board whose residual is beyond this, and far beyond those of the better boards and the stated noise, is a
/// wrong grid, px: real ones have 1.7 to 2.6 px where good views have 0.3 to 0.5.
pub(super) const USUAL_CORNER_PX: Threshold = 1.0;

/// Leaves out the boards that no mirror explains, and the observations in those mirrors.
pub(crate) fn leave_out_wrong_grids(problem: &mut Problem) -> Vec<LeftOut> {
    let of_board = |board: &BoardFit| (board.chi2_px2 / (2.0 * board.corners as f64 - 3.0).max(1.0)).sqrt();
    let boards: Vec<(usize, f64)> =
        problem.boards.iter().enumerate().filter_map(|(f, b)| Some((f, of_board(b.as_ref()?)))).collect();
    let mut all: Vec<f64> = boards.iter().map(|b| b.1).collect();
    all.sort_by(f64::total_cmp);
    // Nearly all of the others may be wrong.
    let Some(better) = all.get((all.len() as f64 * (1.0 - NEARLY_ALL)) as usize).copied() else {
        return Vec::new();
    };
    let most = (FAR_DEVIATIONS * better.max(problem.noise.corner_px)).max(USUAL_CORNER_PX);
    let wrong = wrong_but_for_the_last(&boards, most);
    let told = wrong
        .iter()
        .map(|&(f, rms)| LeftOut {
            frame: problem.frame_numbers[f],
            target: "board".to_owned(),
            deviations: Some(rms / better.max(problem.noise.corner_px)),
            why: Reason::NoMirror { beside_others: true },
        })
        .collect();
    for (f, _) in wrong {
        let others = core::mem::take(&mut problem.frames[f].others);
        problem.frames[f] = FrameData { corners: Vec::new(), others };
        problem.boards[f] = None;
    }
    told
}

/// Boards (frame, residual) beyond the limit, except a run to the session's end: from there on board or camera may
/// have slipped.
fn wrong_but_for_the_last(boards: &[(usize, f64)], most_px: f64) -> Vec<(usize, f64)> {
    // A run of which nearly all are wrong.
    let right = -NEARLY_ALL / (1.0 - NEARLY_ALL);
    let gains: Vec<f64> = boards.iter().map(|b| if b.1 > most_px { 1.0 } else { right }).collect();
    let last_run = best_run(&gains)
        .filter(|&(first, last)| last + 1 == boards.len() && last + 1 - first >= FEWEST_FRAMES);
    let before = last_run.map_or(boards.len(), |run| run.0);
    boards[..before].iter().copied().filter(|b| b.1 > most_px).collect()
}
