//! A diagnosis, and a second one where the first contradicts itself or depends on something that it does not
//! explain.
//!
//! Slips and gross mistakes are searched for before causes are known. They absorb part of any similar misfit. So
//! where there is reason for doubt, the session is diagnosed again with other assumptions. The second diagnosis
//! replaces the first under a condition:
//!
//! | reason for doubt in the first | the second diagnosis | it is accepted if it |
//! | --- | --- | --- |
//! | a column is not used, or a joint has another zero from a row on: neither is a named cause | assumes neither | explains everything, without a mistake of a column, or slips in place of the zero, and predicts held-out regions not clearly worse than the other zero does. It may give reason for doubt itself |
//! | a ratio is named twice at one joint, or does not differ from the model's; a picture of another size together with a focal length that cancels it; a slip by fewer than twelve deviations; slipped rows that fit their own postures once the causes are known | leaves out that mistake | explains everything, or leaves no larger gap (with the slipped rows there is more to predict: less than twice as much, where the first left something unexplained too) |
//! | a delay is named that does not differ from none | leaves out delays | explains everything, or leaves no larger gap. It may give reason for doubt itself |
//! | gravity is named as turned, and something is unexplained, or no cause of its own yields to a load as a spring does and moves a part of the gap | leaves out that; small errors everywhere, if they were named, are tried in place of all causes | explains everything, or leaves no larger gap |
//! | a spring under another direction of gravity explains more than any single cause | assumes that direction | explains everything with no more causes, a spring that moves a part of the gap among them, and leaves no larger gap |
//! | several markers are named on other links | leaves out that | explains everything, and leaves no larger gap, or one by less than held-out regions show |
//! | a joint's error is independent in each posture, together with a mistake of its column, a marker on another link, or slipped rows | leaves out all such mistakes | leaves less than twice as much. It is always accepted if these errors are more than half of what the column moves: the column is unrelated to the joint |
//! | a mistake of a column leaves more than half of the gap | leaves out the same | finds that joint's error independent in each posture, and leaves less than twice as much |
//! | a slip, or slipped rows, together with something unexplained | leaves out that | leaves no clearly larger gap on held-out regions |
//! | something is unexplained | searches, with the causes found, for mistakes that are as small as usual errors (a slightly late log) | leaves no more, and explains everything or most of it |
//! | a cause is far larger than such an error usually is | searches in the same way, without that cause | explains everything with no more causes |
//! | the observations left out as false lie together | searches in the same way | explains everything and leaves out less than half of them |
//!
//! All diagnoses of a session share one budget of work. Where it is used up no further one begins, and the result says
//! so: what was left out as false and lies together at one marker is then something unexplained, and a turned gravity that the next one would have left out is no more
//! probable than what was not tested; so is a slip or a column's mistake where what is left has a law without a name. A second diagnosis that ended at the limit is accepted only if it explains everything or leaves no larger gap.

mod reason;
#[cfg(test)]
mod tests;

use crate::diagnose::data::diagnosis::{Cause, Diagnosis, Verdict, Where};
use crate::diagnose::data::left_out::LeftOut;
use crate::diagnose::data::recording::Recording;
use crate::diagnose::likelihood::probability::unfinished;
use crate::diagnose::pipeline::{self, Outcome};
use crate::diagnose::prepare::first_day::{Memory, Suspects};
use crate::diagnose::prepare::first_result::FirstResult;
use crate::diagnose::prepare::options::{DiagnoseOptions, OtherSession};
use crate::diagnose::prepare::prepared::Prepared;
use crate::diagnose::principles::{NEARLY_ALL, UNTHOUGHT_OF};
use crate::diagnose::report::board_shape::tell;
use crate::diagnose::report::reservations::LIMIT_REACHED;
use crate::error::Result;
use crate::robot::Robot;
use reason::{
    LATE, PAIRING, Reason, explains, hardly_slipped, has_no_size, is_late_by_nothing, is_of_a_column,
    leaves_a_law, left, slip_together, takes_most,
};
use std::collections::BTreeMap;

/// Diagnoses a recording: where the model is wrong, which effect causes it, how far the gap shrinks.
///
/// Where the first diagnosis gives reason for doubt, a second one follows (see the module). It runs on the threads of rayon's pool in which
/// it is called, else of the global one; of more calls at once than it has threads some wait for others.
///
/// # Errors
/// A recording that is not valid, links that do not exist, invalid parameters of the camera.
pub fn diagnose(
    robot: &Robot,
    recording: &Recording,
    options: &DiagnoseOptions,
    others: &[OtherSession],
) -> Result<Diagnosis> {
    // On a thread of the pool: from outside, each of thousands of short loops would wake the pool and wait for it.
    rayon::scope(|_| on_this_thread(robot, recording, options, others))
}

fn on_this_thread(
    robot: &Robot,
    recording: &Recording,
    options: &DiagnoseOptions,
    others: &[OtherSession],
) -> Result<Diagnosis> {
    let mut memory = Memory::default();
    let mut found = accepted(robot, recording, options, others, &mut memory)?;
    if is_late_by_nothing(&found.diagnosis.causes) && !is_over(&mut found) {
        // With the log in time it may give reason for doubt as any other diagnosis does.
        let mut in_time = options.clone();
        in_time.without.push(LATE.into());
        let mut second = accepted(robot, recording, &in_time, others, &mut memory)?;
        if explains(&second.diagnosis) || left(&second.diagnosis) <= left(&found.diagnosis) {
            let words = "second diagnosis accepted: a delay that does not differ from none was a part of another cause";
            second.diagnosis.trace.insert(0, words.into());
            found = second;
        }
    }
    let Outcome { mut diagnosis, not_flat, .. } = found;
    if let Some(not_flat) = not_flat {
        tell(&mut diagnosis, not_flat);
    }
    Ok(diagnosis)
}

/// The first diagnosis, or the second that replaces it.
fn accepted(
    robot: &Robot,
    recording: &Recording,
    options: &DiagnoseOptions,
    others: &[OtherSession],
    memory: &mut Memory,
) -> Result<Outcome> {
    let at_first = Suspects { hung: options.allows("pairing"), ..Suspects::AT_FIRST };
    let mut prepared = |options: &DiagnoseOptions, known: Option<&FirstResult>, suspects: Suspects| {
        options.progress.enter("searching for gross mistakes");
        Prepared::new(robot, recording, options, known, suspects, memory)
    };
    let first = prepared(options, None, at_first)?;
    let mut mistakes = first.mistakes().to_vec();
    let mut found = pipeline::diagnose(first, robot, recording, options, others)?;
    let mut spoilt = at_first.spoilt;
    if (found.lost || found.left_beside_step.is_some()) && !is_over(&mut found) {
        // Effects that were not among the small errors may need far fewer parameters than free positions, and play or
        // sticking looks like another zero where a joint turns back.
        let again = prepared(options, None, Suspects { spoilt: false, ..at_first })?;
        let its_mistakes = again.mistakes().to_vec();
        // Mistakes of columns were weighed against these already, and slips against the step. Markers that slip at one and the
        // same row are what a joint carries that has another zero from there on.
        let slips = |mistakes: &[Cause]| mistakes.iter().filter(|m| m.effect == "slip").count();
        let more_slips = slips(&its_mistakes) > slips(&mistakes);
        let slips_instead = more_slips && (found.left_beside_step.is_some() || slip_together(&its_mistakes));
        if slips_instead || its_mistakes.iter().any(is_of_a_column) {
            return Ok(found);
        }
        let mut second = pipeline::diagnose(again, robot, recording, options, others)?;
        let is_neighbour =
            found.left_beside_step.as_ref().is_some_and(|step| step.is_beyond(&second.after, second.noise));
        if second.diagnosis.verdict != Verdict::Explained || is_neighbour {
            return Ok(found);
        }
        second.diagnosis.trace.insert(
            0,
            "named causes explain what a column's free positions, or another zero from a row on, did".into(),
        );
        // It may give reason for doubt as any other diagnosis does.
        (found, mistakes, spoilt) = (second, its_mistakes, false);
    }
    let mut doubted: Vec<&str> = Vec::new();
    let reasons = Reason::all(&found, recording, &mistakes);
    for (i, &reason) in reasons.iter().enumerate() {
        if is_over(&mut found) {
            if reason == Reason::FalseTogether {
                doubt_what_is_false(&mut found.diagnosis);
            }
            // A slip or a delay is told with its remainder, unless that is a law without a name, of which it may be a piece; a turned
            // gravity turns the sign of every spring.
            let law = leaves_a_law(&found.diagnosis.r#where);
            let not_made = reasons[i..].iter().filter(|r| law || **r == Reason::Gravity);
            doubted = not_made.flat_map(|r| r.without()).copied().collect();
            break;
        }
        let known = FirstResult { sought: reason.seeks(), ..found.known.clone() };
        let mut still = options.clone();
        still.without.extend(reason.without().iter().map(|effect| (*effect).to_owned()));
        let suspects = Suspects { spoilt, loads_turned: reason.turns_loads(), ..at_first };
        let mut again = prepared(&still, reason.looks_closely().then_some(&known), suspects)?;
        again.had_small_errors = reason.keeps_small_errors(&found.diagnosis);
        // If the same mistakes are undone, the result is the same.
        let without_word = again.lost().is_some() || again.step().is_some();
        if reason.without().is_empty() && !without_word && same_mistakes(again.mistakes(), &mistakes) {
            continue;
        }
        let mut second = pipeline::diagnose(again, robot, recording, &still, others)?;
        let believed = match &second.left_beside_step {
            Some(step) => takes_most(step.size, &found.diagnosis),
            None => reason.believes(&second.diagnosis, &found.diagnosis),
        };
        let ended = !second.budget.is_spent()
            || second.diagnosis.verdict == Verdict::Explained
            || left(&second.diagnosis) <= left(&found.diagnosis);
        if believed && ended {
            second.diagnosis.trace.insert(0, reason.words().into());
            return Ok(second);
        }
    }
    // No second diagnosis took it back: it was not made; a slip's own deviations do not carry it; the rows that seemed slipped fit
    // their own postures beside the causes.
    let is_doubted = |c: &Cause| {
        let of_rows = found.rows_in_order && c.effect == PAIRING;
        hardly_slipped(c) || of_rows || doubted.contains(&c.effect.as_str())
    };
    for cause in found.diagnosis.causes.iter_mut().filter(|c| is_doubted(c)) {
        cause.probability = unfinished(cause.probability);
    }
    // Of a mistake that does not differ from none, nothing is left to be named.
    let undone = |c: &Cause| mistakes.iter().any(|m| m.effect == c.effect && m.at == c.at);
    for nothing in found.diagnosis.causes.iter_mut().filter(|c| undone(c) && has_no_size(c)) {
        nothing.probability = nothing.probability.min(UNTHOUGHT_OF);
    }
    Ok(found)
}

/// Whether the session's work is used up, which is told in the first result.
fn is_over(found: &mut Outcome) -> bool {
    let over = found.budget.is_over();
    let warnings = &mut found.diagnosis.warnings;
    if over && !warnings.iter().any(|told| told.ends_with(NO_SECOND)) {
        match warnings.iter_mut().find(|told| *told == LIMIT_REACHED) {
            Some(told) => *told = format!("{told}; {NO_SECOND}"),
            None => warnings.push(format!("the limit of work was reached: {NO_SECOND}")),
        }
    }
    over
}

/// What was left out as false lies together, nearly all of it at one marker, and no second diagnosis looked at it: what it leaves
/// explained is a part. Its place is that marker.
fn doubt_what_is_false(diagnosis: &mut Diagnosis) {
    let Some((marker, count)) = nearly_all_at_one(&diagnosis.data.left_out) else { return };
    let at = format!("marker:{marker}");
    diagnosis.sentence += &format!(
        " But {count} observations of {at} were left out as false, and lie together, which false detections do not: something moves it \
         there that these causes do not describe."
    );
    diagnosis.verdict = Verdict::Partial;
    if diagnosis.r#where.iter().all(|place| place.at != at) {
        diagnosis.r#where.push(Where { at, share: 0.0, depends_on: None });
    }
}

/// The marker that nearly all of what was left out as false is of, with their number; none where it is of several, as of all on a limb
/// whose play is on its other side, which friction may leave anywhere.
fn nearly_all_at_one(left_out: &[LeftOut]) -> Option<(&str, usize)> {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    let false_ones = left_out.iter().filter(|left| left.is_false());
    false_ones.for_each(|left| *counts.entry(&left.target).or_default() += 1);
    let all: usize = counts.values().sum();
    counts.into_iter().max_by_key(|of| of.1).filter(|of| of.1 as f64 >= NEARLY_ALL * all as f64)
}

/// What the warning says where the budget did not suffice for a second diagnosis.
const NO_SECOND: &str = "there is reason for a second diagnosis with other assumptions, which was not made";

/// Whether the same mistakes were undone, apart from their parameters.
fn same_mistakes(a: &[Cause], b: &[Cause]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.effect == b.effect && a.at == b.at)
}
