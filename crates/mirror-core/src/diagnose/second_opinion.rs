//! A diagnosis, and a second one where the first rests on what it does not explain.
//!
//! Slips are looked for before causes are: a step takes its share of any misfit that is not even in time. Where something is left
//! unexplained beside a slip, the session is diagnosed once more as if nothing had slipped, and the slip is believed only where it leaves
//! less on held-out regions.

use crate::diagnose::data::diagnosis::{Diagnosis, Verdict};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::pipeline;
use crate::diagnose::prepare::options::{DiagnoseOptions, OtherSession};
use crate::error::Result;
use crate::robot::Robot;

const SLIP: &str = "slip";

/// Diagnoses a recording: where the model is wrong, which effect causes it, how far the gap shrinks.
///
/// Slips beside an unexplained remainder are asked of twice.
///
/// # Errors
/// A recording that is not valid, links that do not exist, a camera that cannot be.
pub fn diagnose(
    robot: &Robot,
    recording: &Recording,
    options: &DiagnoseOptions,
    others: &[OtherSession],
) -> Result<Diagnosis> {
    let first = pipeline::diagnose(robot, recording, options, others)?;
    let unexplained = matches!(first.verdict, Verdict::Partial | Verdict::Unknown);
    if !unexplained || !first.causes.iter().any(|c| c.effect == SLIP) {
        return Ok(first);
    }
    let mut still = options.clone();
    still.without.push(SLIP.into());
    let mut second = pipeline::diagnose(robot, recording, &still, others)?;
    if !(left(&second) <= left(&first)) {
        return Ok(first);
    }
    second.trace.insert(0, "a slip leaves no smaller gap on held-out regions: nothing has slipped".into());
    Ok(second)
}

/// The held-out gap, in the unit of what was seen.
fn left(diagnosis: &Diagnosis) -> f64 {
    diagnosis.gap.after_px.or(diagnosis.gap.after_m).unwrap_or(f64::INFINITY)
}
