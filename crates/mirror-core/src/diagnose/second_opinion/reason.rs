//! The reasons for a second diagnosis: what it does differently, and when it is accepted.

use crate::diagnose::assessment::false_together::lies_together;
use crate::diagnose::data::depends_on::DependsOn;
use crate::diagnose::data::diagnosis::{Cause, Diagnosis, Verdict, Where};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::effects::vocabulary;
use crate::diagnose::pipeline::Outcome;
use crate::diagnose::principles::{FAR_DEVIATIONS, LEAST_HELD_OUT_RATIO, MAJORITY, SURE_DEVIATIONS};

pub(super) const SLIP: &str = "slip";
/// The parameter of a slip that is none of its motion.
pub(super) const FIRST_FRAME: &str = "first_frame";
pub(super) const PAIRING: &str = "pairing";
const GRAVITY: &str = "gravity_direction";
/// Small errors everywhere.
const GROUP: &str = "geometry";
/// A camera's picture of another size, and the effect that appears if there is none: a crop is an offset of the
/// centre alone.
const RESIZED: (&str, &str) = ("camera_resolution", "camera_focal");
/// A ratio as a gross mistake is tried as another unit of the joint; both are reported under the same name.
const RATIO: (&str, &str) = ("joint_unit", "gear_ratio");
/// Columns, or all of the log, that contain later rows' positions.
pub(super) const LATE: &str = "joint_late";
/// A marker that a joint seems not to move, because its column is unrelated to it.
const ON_ANOTHER_LINK: &str = "marker_parent";
/// Mistakes that also appear if a column is unrelated to its joint: scaled to zero, with the other sign, exchanged,
/// in other rows, or as that of a joint that does not move a marker, the column disturbs less.
const OF_A_COLUMN: [&str; 8] = [
    "joint_unit",
    "axis_sign",
    "joints_swapped",
    LATE,
    "joint_frozen",
    "joint_offset",
    PAIRING,
    ON_ANOTHER_LINK,
];

/// Why a session is diagnosed a second time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reason {
    /// A ratio is named twice at one joint, or does not differ from the model's.
    Twice,
    /// A mistake of a column is named, and still the joint's error is independent in each posture.
    Lawless,
    /// The same, and that error is as large as what the column moves.
    SaysNothing,
    /// A mistake of a column that leaves most of the gap.
    Weak,
    /// A picture of another size is named, together with a focal length that cancels it.
    Resized,
    /// Gravity is named as turned, and something is unexplained, or nothing named by itself yields to a load.
    Gravity,
    /// A spring under another direction of gravity explains more than any single cause.
    LoadsTurned,
    /// Several markers are named on other links: their names may be exchanged.
    SeveralOnOtherLinks,
    /// A slip is small, given the causes.
    HardlySlipped,
    /// Slipped rows fit their own postures, given the causes.
    InOrder,
    /// A slip is named, and something is unexplained.
    Slip,
    /// Slipped rows are named, and something is unexplained.
    Pairing,
    /// What was left out as false lies together.
    FalseTogether,
    /// A cause is far larger than such an error usually is, and may be a part of a gross mistake.
    TooLarge,
    /// Something is left unexplained: a joint that stood still over some rows, or whose log is late, does that.
    Unexplained,
}

impl Reason {
    /// The reasons that a first diagnosis gives, in the order in which they are followed until a second one is
    /// accepted. `mistakes`: what the first one undid.
    pub fn all(found: &Outcome, recording: &Recording, mistakes: &[Cause]) -> Vec<Self> {
        let first = Self::first(found, recording);
        let of_columns = matches!(first, Some(Self::Twice | Self::Lawless | Self::SaysNothing));
        let weak = (!of_columns && is_weak(&found.diagnosis, mistakes)).then_some(Self::Weak);
        weak.into_iter().chain(first).chain(found.loads_may_be_turned.then_some(Self::LoadsTurned)).collect()
    }

    /// The first of the reasons that do not depend on the mistakes undone.
    fn first(found: &Outcome, recording: &Recording) -> Option<Self> {
        let first = &found.diagnosis;
        let named = |effect: &str| first.causes.iter().any(|c| c.effect == effect);
        if is_told_twice(&first.causes) || is_of_no_size(&first.causes) {
            return Some(Self::Twice);
        }
        if is_turned_in_vain(&first.causes, first.verdict, before(first).unwrap_or(0.0)) {
            return Some(Self::Gravity);
        }
        if is_lawless(first) {
            return Some(if found.says_nothing { Self::SaysNothing } else { Self::Lawless });
        }
        if first.causes.iter().filter(|c| c.effect == ON_ANOTHER_LINK).count() > 1 {
            return Some(Self::SeveralOnOtherLinks);
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
            () if explains(first) => found.too_large.then_some(Self::TooLarge),
            () if named(SLIP) => Some(Self::Slip),
            () if named(PAIRING) => Some(Self::Pairing),
            () => Some(Self::Unexplained),
        }
    }

    /// What the second diagnosis does without.
    pub fn without(self) -> &'static [&'static str] {
        match self {
            Self::Twice => &[RATIO.0],
            Self::Lawless | Self::SaysNothing | Self::Weak => &OF_A_COLUMN,
            Self::Resized => &[RESIZED.0],
            Self::Gravity => &[GRAVITY],
            Self::SeveralOnOtherLinks => &[ON_ANOTHER_LINK],
            Self::HardlySlipped | Self::Slip => &[SLIP],
            Self::Pairing | Self::InOrder => &[PAIRING],
            Self::Unexplained | Self::FalseTogether | Self::TooLarge | Self::LoadsTurned => &[],
        }
    }

    /// Whether gross mistakes that are as small as usual errors are searched for.
    pub fn looks_closely(self) -> bool {
        matches!(self, Self::Pairing | Self::Unexplained | Self::FalseTogether | Self::TooLarge)
    }

    /// Whether the second diagnosis assumes another direction of gravity.
    pub fn turns_loads(self) -> bool {
        self == Self::LoadsTurned
    }

    /// Whether small errors everywhere, which the first diagnosis names, are tried in the second in place of all that
    /// it finds: they explain the same without the turned gravity, and what takes their place may be pieces of one law.
    pub fn keeps_small_errors(self, first: &Diagnosis) -> bool {
        self == Self::Gravity && first.causes.iter().any(|c| c.effect == GROUP)
    }

    /// Whether the second diagnosis replaces the first.
    pub fn believes(self, second: &Diagnosis, first: &Diagnosis) -> bool {
        let no_worse = left(second) <= left(first);
        match self {
            Self::Twice | Self::Resized | Self::Gravity | Self::HardlySlipped => no_worse || explains(second),
            Self::LoadsTurned => {
                explains(second)
                    && second.causes.len() <= first.causes.len()
                    && LEAST_HELD_OUT_RATIO * left(second) <= left(first)
                    && !is_turned_in_vain(&second.causes, second.verdict, before(second).unwrap_or(0.0))
            }
            // Their places, free in the first, fit a little better in any case.
            Self::SeveralOnOtherLinks => {
                explains(second) && LEAST_HELD_OUT_RATIO * left(second) <= left(first)
            }
            // With more rows there is more to predict.
            Self::InOrder => {
                no_worse || explains(second) || !explains(first) && MAJORITY * left(second) <= left(first)
            }
            // With a true mistake of the column the joint's error becomes much smaller.
            Self::Lawless => MAJORITY * left(second) <= left(first),
            Self::SaysNothing => true,
            Self::Weak => {
                let alone = lawless_place(second);
                alone.is_some_and(|at| of_a_column(first).any(|c| is_at(c, at)))
                    && MAJORITY * left(second) <= left(first)
            }
            Self::Slip | Self::Pairing => LEAST_HELD_OUT_RATIO * left(second) <= left(first),
            Self::Unexplained => no_worse && (explains(second) || takes_most(left(second), first)),
            Self::TooLarge => {
                explains(second)
                    && second.causes.len() <= first.causes.len()
                    && LEAST_HELD_OUT_RATIO * left(second) <= left(first)
            }
            // It uses more observations, and among them the farthest outliers.
            Self::FalseTogether => {
                explains(second)
                    && second.data.false_count() as f64 <= MAJORITY * first.data.false_count() as f64
            }
        }
    }

    /// Whether a gross mistake is searched for something that small errors do not explain.
    pub fn seeks(self) -> bool {
        matches!(self, Self::TooLarge | Self::Unexplained)
    }

    /// The line in the trace if the second diagnosis is accepted.
    pub fn words(self) -> &'static str {
        match self {
            Self::Twice => {
                "second diagnosis accepted: a ratio that was undone as a gross mistake was found again as a cause, or does not differ from the model's; it is no mistake"
            }
            Self::Lawless | Self::SaysNothing | Self::Weak => {
                "second diagnosis accepted: the joint's error is independent in each posture, also without the mistake of its column; the column is unrelated to the joint"
            }
            Self::Resized => {
                "second diagnosis accepted: a focal length cancelled the pictures' other size; the pictures have the camera's size"
            }
            Self::Gravity => {
                "second diagnosis accepted: gravity that was turned explained less than the stated one does"
            }
            Self::LoadsTurned => {
                "second diagnosis accepted: a spring under another direction of gravity explains everything with no more causes"
            }
            Self::SeveralOnOtherLinks => {
                "second diagnosis accepted: markers that seemed to be on each other's links have exchanged names"
            }
            Self::HardlySlipped => {
                "second diagnosis accepted: the small slip does not improve the prediction of held-out regions; nothing slipped"
            }
            Self::Slip => {
                "second diagnosis accepted: the slip does not make the gap on held-out regions smaller; nothing slipped"
            }
            Self::InOrder => {
                "second diagnosis accepted: once the causes are known, the rows that seemed to contain other rows' measurements fit their own postures"
            }
            Self::Pairing => {
                "second diagnosis accepted: leaving out the slipped rows does not make the gap on held-out regions smaller; the rows are in order"
            }
            Self::FalseTogether => {
                "second diagnosis accepted: a gross mistake explains the observations that were left out as false"
            }
            Self::Unexplained => {
                "second diagnosis accepted: a gross mistake, as small as usual errors, explains the remainder"
            }
            Self::TooLarge => {
                "second diagnosis accepted: a cause larger than such an error usually is was part of a gross mistake"
            }
        }
    }
}

/// The joint of the largest part of the remainder, if its error is independent in each posture.
fn lawless_place(diagnosis: &Diagnosis) -> Option<&str> {
    let first = diagnosis.r#where.first()?;
    (first.depends_on == Some(DependsOn::EachPosture)).then_some(&first.at)
}

/// The named mistakes of columns, a ratio included.
fn of_a_column(diagnosis: &Diagnosis) -> impl Iterator<Item = &Cause> {
    diagnosis.causes.iter().filter(|c| is_of_a_column(c))
}

pub(super) fn is_of_a_column(cause: &Cause) -> bool {
    OF_A_COLUMN.contains(&cause.effect.as_str()) || cause.effect == RATIO.1
}

/// Whether a cause is of a place, or of rows.
fn is_at(cause: &Cause, place: &str) -> bool {
    cause.effect == PAIRING || cause.effect == ON_ANOTHER_LINK || cause.at.split("<->").any(|at| at == place)
}

/// Whether a mistake of a joint's column is named while that joint's error is independent in each posture.
fn is_lawless(first: &Diagnosis) -> bool {
    lawless_place(first).is_some_and(|place| of_a_column(first).any(|c| is_at(c, place)))
}

/// Whether a mistake of a column is named and more than half of the gap is left.
fn is_weak(first: &Diagnosis, mistakes: &[Cause]) -> bool {
    let before = before(first).unwrap_or(f64::INFINITY);
    !explains(first) && mistakes.iter().any(is_of_a_column) && left(first) > MAJORITY * before
}

/// Whether gravity is named as turned although something is unexplained (where many small things are wrong, one spring
/// with a turned gravity may be the best single cause of all), or although nothing that is named by itself yields to a
/// load and moves more than a trace of the gap. The springs among small errors everywhere are no evidence: a group
/// absorbs what the turned gravity costs, as it does under the stated one.
pub(super) fn is_turned_in_vain(causes: &[Cause], verdict: Verdict, before: f64) -> bool {
    let yields = |c: &Cause| {
        vocabulary().iter().any(|e| e.name() == c.effect && e.is_spring())
            && c.rms_shift >= (1.0 - LEAST_HELD_OUT_RATIO) * before
    };
    causes.iter().any(|c| c.effect == GRAVITY) && (leaves_something(verdict) || !causes.iter().any(yields))
}

/// Whether a ratio is named at one joint both as a gross mistake and as a small cause.
pub(super) fn is_told_twice(causes: &[Cause]) -> bool {
    let mut ratios = causes.iter().enumerate().filter(|(_, c)| c.effect == RATIO.1);
    ratios.any(|(i, c)| causes[..i].iter().any(|other| other.effect == c.effect && other.at == c.at))
}

/// Whether a named ratio does not differ from the model's, within its own deviation.
pub(super) fn is_of_no_size(causes: &[Cause]) -> bool {
    causes.iter().any(|c| c.effect == RATIO.1 && has_no_size(c))
}

/// Whether a named delay does not differ from none, within its own deviation.
pub(super) fn is_late_by_nothing(causes: &[Cause]) -> bool {
    causes.iter().any(|c| c.effect == LATE && has_no_size(c))
}

/// Whether a ratio or a delay is no number that is there.
pub(super) fn has_no_size(cause: &Cause) -> bool {
    [RATIO.1, LATE].contains(&cause.effect.as_str())
        && cause.parameters.values().any(|e| e.value.abs() < SURE_DEVIATIONS * e.std)
}

/// Whether a slip is so small that it may be a part of what another cause moves: six deviations are no chance, and
/// at twice as many no neighbour of a slightly wrong law explains it.
pub(super) fn hardly_slipped(cause: &Cause) -> bool {
    let motion = || cause.parameters.iter().filter(|(name, _)| *name != FIRST_FRAME);
    cause.effect == SLIP
        && motion().count() > 0
        && motion().all(|(_, e)| e.value.abs() < 2.0 * FAR_DEVIATIONS * e.std)
}

/// Whether what is left has a law without a name: it depends on something that is not the posture's or the row's own.
pub(super) fn leaves_a_law(r#where: &[Where]) -> bool {
    let of_rows =
        |d: &DependsOn| matches!(d, DependsOn::EachPosture | DependsOn::Row | DependsOn::RowsFrom(_));
    r#where.iter().any(|place| place.depends_on.as_ref().is_some_and(|d| !of_rows(d)))
}

/// Whether two markers slip at one and the same row.
pub(super) fn slip_together(mistakes: &[Cause]) -> bool {
    let slips = || mistakes.iter().filter(|c| c.effect == SLIP && c.at.starts_with("marker:"));
    let first = |c: &Cause| c.parameters.get(FIRST_FRAME).map(|e| e.value);
    slips().any(|one| slips().any(|other| one.at != other.at && first(one) == first(other)))
}

/// Whether nothing is left unexplained.
pub(super) fn explains(diagnosis: &Diagnosis) -> bool {
    !leaves_something(diagnosis.verdict)
}

fn leaves_something(verdict: Verdict) -> bool {
    matches!(verdict, Verdict::Partial | Verdict::Unknown)
}

/// Whether of two held-out gaps the first is nearer to the noise than to the second, by squares.
pub(super) fn takes_most(left_by_second: f64, first: &Diagnosis) -> bool {
    let floor = first.gap.noise_floor_px.or(first.gap.noise_floor_m).unwrap_or(0.0);
    left_by_second.powi(2) - floor.powi(2) <= MAJORITY * (left(first).powi(2) - floor.powi(2))
}

/// The nominal model's gap, in the unit of the observations.
fn before(diagnosis: &Diagnosis) -> Option<f64> {
    diagnosis.gap.before_px.or(diagnosis.gap.before_m)
}

/// The held-out gap, in the unit of the observations.
pub(super) fn left(diagnosis: &Diagnosis) -> f64 {
    diagnosis.gap.after_px.or(diagnosis.gap.after_m).unwrap_or(f64::INFINITY)
}
