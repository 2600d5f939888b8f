//! Long sessions: causes are searched on a part of the frames, then fitted, compared and reported on all of them.
//!
//! A few hundred frames separate causes; with thousands each step of the search costs many times more and gives the
//! same result. What was found on a part is the start of a search on all frames, which finds causes so small that
//! only all frames show them.

use crate::diagnose::likelihood::saturated::postures;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{ABOVE_SCATTER, Size};
use crate::diagnose::selection::search::{Found, Search};
use crate::error::Result;
use crate::statistics::GOLDEN_SECTION;

/// Number of frames that are searched; all frames if there are less than half as many more.
const ENOUGH: Size = 300;

/// The frames on which causes are searched: whole postures, evenly over the session; none means all.
///
/// The i-th posture is used if the fractional part of i φ is below their share, φ the golden ratio: evenly spread
/// whatever the period of the postures.
pub(crate) fn part_of_frames(problem: &Problem) -> Option<Vec<bool>> {
    let frames = problem.frames.len();
    if 2 * frames <= 3 * ENOUGH {
        return None;
    }
    let share = ENOUGH as f64 / frames as f64;
    let mut part = vec![false; frames];
    for (i, its_frames) in postures(problem).into_iter().enumerate() {
        let counts = (i as f64 * GOLDEN_SECTION).fract() < share;
        its_frames.into_iter().for_each(|f| part[f] = counts);
    }
    Some(part)
}

/// Whether the residuals show unmodelled structure rather than measurement noise. Then more frames are no more
/// evidence: residuals equal those of their neighbours, and wrong causes that absorb a part of them gain with every
/// row.
fn is_structure(left: Noise, measured: Noise) -> bool {
    left.point_m > ABOVE_SCATTER * measured.point_m || left.marker_px > ABOVE_SCATTER * measured.marker_px
}

/// Fits to all frames what was found on a part of them, and continues the search if work is left and the residuals
/// are noise.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn on_all_frames(search: &mut Search<'_>, found: &mut Found) -> Result<()> {
    if search.mask.take().is_none() {
        return Ok(());
    }
    found.trace.push("on all frames:".into());
    if search.problem.budget.is_spent() || is_structure(found.noise, search.measured_noise) {
        found.fit = search.fit(&found.fit.model, found.noise, SOLVER.final_steps)?;
        found.noise = search.effective(&found.fit.model)?;
        return Ok(());
    }
    let mut trace = core::mem::take(&mut found.trace);
    *found = search.run(found.fit.model.clone())?;
    trace.append(&mut found.trace);
    found.trace = trace;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_is_structure_where_it_is_far_above_the_measured_noise() {
        let measured = Noise { corner_px: 0.1, marker_px: 0.2, point_m: 1e-4 };
        assert!(!is_structure(measured, measured));
        assert!(!is_structure(Noise { marker_px: 0.25, ..measured }, measured));
        assert!(is_structure(Noise { marker_px: 0.4, ..measured }, measured));
        assert!(is_structure(Noise { point_m: 2e-4, ..measured }, measured));
        // Corners determine the mirror, not the body.
        assert!(!is_structure(Noise { corner_px: 1.0, ..measured }, measured));
    }
}
