//! A diagnosis, and a second one where the first contradicts itself or rests on what it does not explain.
//!
//! Slips and whole mistakes are looked for before causes are: they take their share of any misfit that is like them. So where there is reason for
//! doubt the session is diagnosed once more, and of the two the second is believed under a condition:
//!
//! | doubt of the first | the second | is believed where it |
//! | --- | --- | --- |
//! | a ratio told twice at one joint, or of no size; a picture of another size beside a focal length that takes it back; a slip by fewer than twelve deviations; slipped rows that fit their own postures beside the causes | goes without that mistake | explains all, or leaves no more |
//! | a joint is elsewhere in each posture, beside a mistake of its column, a marker on another link or rows out of order | goes without all such mistakes | leaves less than twice as much, or, where these errors are more than half of what the column moves, in any case: the column says nothing of the joint |
//! | a mistake of a column leaves more than half of the gap | goes without in the same way | finds that joint elsewhere in each posture, and leaves less than twice as much |
//! | a slip, or slipped rows, beside something unexplained | goes without that | leaves clearly less on held-out regions |
//! | something is unexplained | looks beside the causes found for mistakes that do no more than small errors (a log that is a little late) | leaves no more, and explains all or most of it |
//! | a cause is far larger than such an error is | looks beside the others in the same way | explains all by no more causes |
//! | what was left out as false lies together | looks in the same way | explains all and leaves out less than half of that |

mod reason;
#[cfg(test)]
mod tests;

use crate::diagnose::data::diagnosis::{Cause, Diagnosis};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::pipeline;
use crate::diagnose::prepare::known::Known;
use crate::diagnose::prepare::options::{DiagnoseOptions, OtherSession};
use crate::diagnose::prepare::prepared::Prepared;
use crate::error::Result;
use crate::robot::Robot;
use reason::Reason;

/// Diagnoses a recording: where the model is wrong, which effect causes it, how far the gap shrinks.
///
/// Where the first diagnosis gives reason for it, there is a second one (see the module).
///
/// # Errors
/// A recording that is not valid, links that do not exist, invalid parameters of the camera.
pub fn diagnose(
    robot: &Robot,
    recording: &Recording,
    options: &DiagnoseOptions,
    others: &[OtherSession],
) -> Result<Diagnosis> {
    let hung = options.allows("pairing");
    let prepared = |options: &DiagnoseOptions, known: Option<&Known>| {
        options.progress.enter("looking for whole mistakes");
        Prepared::new(robot, recording, options, known, hung)
    };
    let at_first = prepared(options, None)?;
    let mistakes = at_first.mistakes().to_vec();
    let found = pipeline::diagnose(at_first, robot, recording, options, others)?;
    for reason in Reason::all(&found, recording, &mistakes) {
        let known = Known { sought: reason.seeks(), ..found.known.clone() };
        let mut still = options.clone();
        still.without.extend(reason.without().iter().map(|effect| (*effect).to_owned()));
        let again = prepared(&still, reason.looks_closely().then_some(&known))?;
        // The same mistakes undone come to the same end.
        if reason.without().is_empty() && same_mistakes(again.mistakes(), &mistakes) {
            continue;
        }
        let mut second = pipeline::diagnose(again, robot, recording, &still, others)?.diagnosis;
        if reason.believes(&second, &found.diagnosis) {
            second.trace.insert(0, reason.words().into());
            return Ok(second);
        }
    }
    Ok(found.diagnosis)
}

/// Whether the same mistakes were undone, but for their numbers.
fn same_mistakes(a: &[Cause], b: &[Cause]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.effect == b.effect && a.at == b.at)
}
