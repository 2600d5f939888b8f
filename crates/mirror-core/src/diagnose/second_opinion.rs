//! A diagnosis, and a second one where the first contradicts itself or rests on what it does not explain.
//!
//! Slips and whole mistakes are looked for before causes are: they take their share of any misfit that is like them. So where there is reason for
//! doubt the session is diagnosed once more, and of the two the second is believed under a condition:
//!
//! | doubt of the first | the second | is believed where it |
//! | --- | --- | --- |
//! | a ratio told twice at one joint, or of no size; a picture of another size beside a focal length that takes it back; a slip by fewer than six deviations; slipped rows that fit their own postures beside the causes | goes without that mistake | explains all, or leaves no more |
//! | a slip, or slipped rows, beside something unexplained | goes without that | leaves clearly less on held-out regions |
//! | something is unexplained | looks beside the causes found for mistakes that do no more than small errors (a log that is a little late) | leaves no more, and explains all or most of it |
//! | a cause is far larger than such an error is | looks beside the others in the same way | explains all by no more causes |
//! | what was left out as false lies together | looks in the same way | explains all and leaves out less than half of that |

use crate::diagnose::assessment::false_together::lies_together;
use crate::diagnose::data::diagnosis::{Cause, Diagnosis, Verdict};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::pipeline::{self, Outcome};
use crate::diagnose::prepare::known::Known;
use crate::diagnose::prepare::options::{DiagnoseOptions, OtherSession};
use crate::diagnose::prepare::prepared::Prepared;
use crate::diagnose::principles::{FAR_DEVIATIONS, LEAST_HELD_OUT_RATIO, MAJORITY, SURE_DEVIATIONS};
use crate::error::Result;
use crate::robot::Robot;

const SLIP: &str = "slip";
/// The parameter of a slip that is none of its motion.
const FIRST_FRAME: &str = "first_frame";
const PAIRING: &str = "pairing";
/// A camera's picture of another size, and what would be told beside it if it had none: a crop is an offset of the centre alone.
const RESIZED: (&str, &str) = ("camera_resolution", "camera_focal");
/// A ratio that is a whole mistake is tried as another unit of the joint, and told as a small one is.
const RATIO: (&str, &str) = ("joint_unit", "gear_ratio");

/// Diagnoses a recording: where the model is wrong, which effect causes it, how far the gap shrinks.
///
/// Slips and rows of their own beside an unexplained remainder, and ratios that are told twice or are none, are asked of twice.
///
/// # Errors
/// A recording that is not valid, links that do not exist, invalid parameters of the camera.
pub fn diagnose(
    robot: &Robot,
    recording: &Recording,
    options: &DiagnoseOptions,
    others: &[OtherSession],
) -> Result<Diagnosis> {
    let prepared = |options: &DiagnoseOptions, known: Option<&Known>| {
        options.progress.enter("looking for whole mistakes");
        Prepared::new(robot, recording, options, known)
    };
    let at_first = prepared(options, None)?;
    let mistakes = at_first.mistakes().to_vec();
    let found = pipeline::diagnose(at_first, robot, recording, options, others)?;
    let Some(doubt) = Doubt::of(&found, recording) else { return Ok(found.diagnosis) };
    let known = doubt.looks_closely().then(|| Known {
        sought: matches!(doubt, Doubt::TooLarge | Doubt::Unexplained),
        ..found.known_without_large.unwrap_or(found.known)
    });
    let mut still = options.clone();
    still.without.extend(doubt.without().map(str::to_owned));
    let again = prepared(&still, known.as_ref())?;
    let first = found.diagnosis;
    // The same mistakes undone come to the same end.
    if doubt.without().is_none() && same_mistakes(again.mistakes(), &mistakes) {
        return Ok(first);
    }
    let mut second = pipeline::diagnose(again, robot, recording, &still, others)?.diagnosis;
    let no_worse = left(&second) <= left(&first);
    let believed = match doubt {
        Doubt::Twice | Doubt::Resized | Doubt::HardlySlipped | Doubt::InOrder => {
            no_worse || explains(&second)
        }
        Doubt::Slip | Doubt::Pairing => LEAST_HELD_OUT_RATIO * left(&second) <= left(&first),
        Doubt::Unexplained => no_worse && (explains(&second) || takes_most(&second, &first)),
        Doubt::TooLarge => {
            explains(&second)
                && second.causes.len() <= first.causes.len()
                && LEAST_HELD_OUT_RATIO * left(&second) <= left(&first)
        }
        // More is used, what was farthest off among it.
        Doubt::FalseTogether => {
            explains(&second) && false_count(&second) as f64 <= MAJORITY * false_count(&first) as f64
        }
    };
    if !believed {
        return Ok(first);
    }
    second.trace.insert(0, doubt.words().into());
    Ok(second)
}

/// What a first diagnosis is asked again about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Doubt {
    /// A ratio is told twice at one joint, or is that of the model.
    Twice,
    /// A picture of another size is told, and a focal length beside it that takes it back.
    Resized,
    /// A slip by next to nothing, once the causes are known.
    HardlySlipped,
    /// Slipped rows that fit their own postures, once the causes are known.
    InOrder,
    /// A slip beside something unexplained.
    Slip,
    /// Rows of their own beside something unexplained.
    Pairing,
    /// What was left out as false lies together.
    FalseTogether,
    /// A cause far larger than such an error is, which may be a part of a whole mistake.
    TooLarge,
    /// Something is left unexplained: a joint that stood still over some rows, or whose log is late, does that.
    Unexplained,
}

impl Doubt {
    fn of(found: &Outcome, recording: &Recording) -> Option<Self> {
        let first = &found.diagnosis;
        let named = |effect: &str| first.causes.iter().any(|c| c.effect == effect);
        if is_told_twice(&first.causes) || is_of_no_size(&first.causes) {
            return Some(Self::Twice);
        }
        if named(RESIZED.0) && named(RESIZED.1) {
            return Some(Self::Resized);
        }
        if first.causes.iter().any(hardly_slipped) {
            return Some(Self::HardlySlipped);
        }
        if found.rows_in_order {
            return Some(Self::InOrder);
        }
        match () {
            () if explains(first) && lies_together(recording, &first.data) => Some(Self::FalseTogether),
            () if explains(first) => found.known_without_large.as_ref().map(|_| Self::TooLarge),
            () if named(SLIP) => Some(Self::Slip),
            () if named(PAIRING) => Some(Self::Pairing),
            () => Some(Self::Unexplained),
        }
    }

    /// What the second diagnosis does without.
    fn without(self) -> Option<&'static str> {
        match self {
            Self::Twice => Some(RATIO.0),
            Self::Resized => Some(RESIZED.0),
            Self::HardlySlipped | Self::Slip => Some(SLIP),
            Self::Pairing | Self::InOrder => Some(PAIRING),
            Self::Unexplained | Self::FalseTogether | Self::TooLarge => None,
        }
    }

    /// Whether whole mistakes are looked for that do no more than small errors.
    fn looks_closely(self) -> bool {
        matches!(self, Self::Pairing | Self::Unexplained | Self::FalseTogether | Self::TooLarge)
    }

    fn words(self) -> &'static str {
        match self {
            Self::Twice => {
                "a ratio undone as a whole mistake was found again beside it, or to be the model's: it is none"
            }
            Self::Resized => "a focal length took back the pictures' other size: they have the camera's size",
            Self::HardlySlipped => {
                "what slipped by next to nothing predicts held-out regions no better: nothing has slipped"
            }
            Self::Slip => "a slip leaves no smaller gap on held-out regions: nothing has slipped",
            Self::InOrder => {
                "rows that seemed to hold other rows' measurement fit their own, once the causes are known"
            }
            Self::Pairing => "rows of their own leave no smaller gap on held-out regions: they are in order",
            Self::FalseTogether => "what was left out as false is explained by a whole mistake",
            Self::Unexplained => {
                "what was left is explained by a whole mistake that does no more than small errors"
            }
            Self::TooLarge => "a cause larger than such an error ever is was a part of a whole mistake",
        }
    }
}

/// Whether a ratio is told at one joint both as a whole mistake and as a small cause.
fn is_told_twice(causes: &[Cause]) -> bool {
    let mut ratios = causes.iter().enumerate().filter(|(_, c)| c.effect == RATIO.1);
    ratios.any(|(i, c)| causes[..i].iter().any(|other| other.effect == c.effect && other.at == c.at))
}

/// Whether a ratio is told that is none, within its own deviations.
fn is_of_no_size(causes: &[Cause]) -> bool {
    let of_ratios = causes.iter().filter(|c| c.effect == RATIO.1);
    of_ratios.flat_map(|c| c.parameters.values()).any(|e| e.value.abs() < SURE_DEVIATIONS * e.std)
}

/// Whether it is a slip by so little that its size may be chance, or a part of what another cause moves.
fn hardly_slipped(cause: &Cause) -> bool {
    let motion = || cause.parameters.iter().filter(|(name, _)| *name != FIRST_FRAME);
    cause.effect == SLIP
        && motion().count() > 0
        && motion().all(|(_, e)| e.value.abs() < FAR_DEVIATIONS * e.std)
}

/// Whether the same mistakes were undone, but for their numbers.
fn same_mistakes(a: &[Cause], b: &[Cause]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.effect == b.effect && a.at == b.at)
}

/// How many observations were left out as false.
fn false_count(diagnosis: &Diagnosis) -> usize {
    diagnosis.data.left_out.iter().filter(|l| l.is_false()).count()
}

/// Whether nothing is left unexplained.
fn explains(diagnosis: &Diagnosis) -> bool {
    !matches!(diagnosis.verdict, Verdict::Partial | Verdict::Unknown)
}

/// Whether of two held-out gaps the first is nearer to the noise than to the second, by squares.
fn takes_most(second: &Diagnosis, first: &Diagnosis) -> bool {
    let floor = first.gap.noise_floor_px.or(first.gap.noise_floor_m).unwrap_or(0.0);
    left(second).powi(2) - floor.powi(2) <= MAJORITY * (left(first).powi(2) - floor.powi(2))
}

/// The held-out gap, in the unit of what was seen.
fn left(diagnosis: &Diagnosis) -> f64 {
    diagnosis.gap.after_px.or(diagnosis.gap.after_m).unwrap_or(f64::INFINITY)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::data::diagnosis::Estimate;

    fn cause(effect: &str, at: &str) -> Cause {
        Cause {
            effect: effect.into(),
            at: at.into(),
            kind: "robot".into(),
            probability: 0.99,
            parameters: Default::default(),
            stability: None,
            alternatives: Vec::new(),
            words: String::new(),
            rms_shift: 0.0,
            members: Vec::new(),
            frames: Vec::new(),
        }
    }

    #[test]
    fn only_a_ratio_twice_at_one_joint_is_told_twice() {
        let (a, b) = (cause("gear_ratio", "joint:a"), cause("gear_ratio", "joint:b"));
        let offset = cause("joint_offset", "joint:a");
        assert!(is_told_twice(&[a.clone(), b.clone(), a.clone()]));
        assert!(!is_told_twice(&[a.clone(), b, offset.clone(), offset]));
        let ratio = |value: f64| {
            let scale = ("scale_error".to_owned(), Estimate { value, std: 0.001 });
            Cause { parameters: [scale].into_iter().collect(), ..a.clone() }
        };
        assert!(
            is_of_no_size(&[ratio(-0.002)])
                && !is_of_no_size(&[ratio(-0.02)])
                && !is_of_no_size(core::slice::from_ref(&a))
        );
    }
    #[test]
    fn a_slip_by_next_to_nothing_is_asked_of_twice() {
        let slip = |motion: f64| {
            let of = |value: f64, std: f64| Estimate { value, std };
            let parameters =
                [("dx_m", of(motion, 0.002)), ("dy_m", of(0.001, 0.002)), (FIRST_FRAME, of(90.0, 0.5))];
            let parameters = parameters.into_iter().map(|(name, e)| (name.to_owned(), e)).collect();
            Cause { parameters, ..cause(SLIP, "marker:a") }
        };
        assert!(hardly_slipped(&slip(0.004)) && hardly_slipped(&slip(0.011)) && !hardly_slipped(&slip(0.02)));
        assert!(!hardly_slipped(&cause("gear_ratio", "joint:a")));
    }
}
