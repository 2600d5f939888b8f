//! The warning for rows that are missing from the log.
//!
//! Play and friction rest on the side to which a joint moved last. After a row that was deleted (nothing was seen in it) the
//! direction is computed from the row before it: it may be the wrong one.

use crate::diagnose::data::recording::Recording;
use crate::diagnose::principles::WORTH_NAMING;

/// The warning where more than a few postures follow on a gap in the frames' numbers; none where the numbers are not counted one
/// by one, or the rows are in no order.
pub(crate) fn rows_are_missing(recording: &Recording) -> Option<String> {
    let steps = || {
        recording
            .frames
            .windows(2)
            .map(|w| (w[1].number.saturating_sub(w[0].number), w[1].posture != w[0].posture))
    };
    let by_one = steps().filter(|(step, _)| *step == 1).count();
    let moves = steps().filter(|(_, moved)| *moved).count();
    let after_gap = steps().filter(|(step, moved)| *moved && *step > 1).count();
    let counted = 2 * by_one > recording.frames.len().saturating_sub(1);
    let many = after_gap as f64 > WORTH_NAMING * moves as f64;
    (recording.ordered && counted && many).then(|| {
        format!(
            "the frames' numbers jump before {after_gap} of {moves} changes of the posture: rows are missing there, and from which side the joints came is not known; play and \
             friction may be told wrongly, or as another error; leave rows in the log in which nothing was seen"
        )
    })
}
