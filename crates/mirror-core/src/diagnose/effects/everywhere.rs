//! What is reported besides the effects of one place: small errors everywhere, slipped rows, and gross mistakes of
//! model or log.

use super::about::WrittenTo;
use serde::Serialize;

/// The description of each for readers; how each is tried is in `prepare` and `random_effects`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct MistakeInfo {
    /// Its name in the public vocabulary.
    pub name: &'static str,
    /// What it looks like in the data.
    pub signature: &'static str,
    /// What to do about it.
    pub remedy: &'static str,
    /// The file into which it is written.
    pub written_to: WrittenTo,
    /// Whether it is a gross mistake of model, log or mounting, tried exactly before small errors are searched.
    pub is_mistake: bool,
}

const fn mistake(
    name: &'static str,
    signature: &'static str,
    remedy: &'static str,
    written_to: WrittenTo,
) -> MistakeInfo {
    MistakeInfo { name, signature, remedy, written_to, is_mistake: true }
}

const fn not_a_mistake(name: &'static str, signature: &'static str, remedy: &'static str) -> MistakeInfo {
    MistakeInfo { name, signature, remedy, written_to: WrittenTo::Nothing, is_mistake: false }
}

/// In the order of the public vocabulary.
pub(crate) const EVERYWHERE: [MistakeInfo; 15] = [
    not_a_mistake(
        "geometry",
        "small errors of many places together, none of which is an outlier",
        "diagnose again: this document does not contain each of the small errors",
    ),
    not_a_mistake(
        "pairing",
        "a run of rows is off by much, and fits the row before or after",
        "pair each row with its own picture, and record those rows again",
    ),
    mistake(
        "axis_sign",
        "a limb mirrored about its joint's zero",
        "turn the axis round in the robot's URDF",
        WrittenTo::Urdf,
    ),
    mistake(
        "joints_swapped",
        "two columns (or two arms) fit each other's joints",
        "exchange the columns; if it is the cables, exchange them instead",
        WrittenTo::Session,
    ),
    mistake(
        "joint_unit",
        "a column fits after multiplying by a unit's factor",
        "write the column in rad",
        WrittenTo::Session,
    ),
    mistake(
        "joint_frozen",
        "a column, or the joint, stands still while others move",
        "repair the joint or its log, and record those rows again",
        WrittenTo::Nothing,
    ),
    mistake(
        "joint_late",
        "a column, or all, fit the rows before; all fit the rows behind where the measurements are late (a negative delay)",
        "log each row's positions at the moment of its picture, once the joints rest, and record again",
        WrittenTo::Nothing,
    ),
    mistake(
        "markers_swapped",
        "two markers fit each other's places, in the frames listed",
        "exchange the two names in the frames listed (in session.toml, where it is all of them), several pairs one after the other as they are listed",
        WrittenTo::Nothing,
    ),
    mistake(
        "points_mirrored",
        "the measured points fit as in a mirror",
        "write the measured points in a right-handed frame: change the sign of one coordinate, or exchange the two that were exchanged, and record again",
        WrittenTo::Nothing,
    ),
    mistake(
        "camera_resolution",
        "boards fit after scaling the camera's file",
        "scale focal lengths and centre in the camera's file",
        WrittenTo::CameraFile,
    ),
    mistake(
        "picture_flipped",
        "boards fit when the pictures are mirrored",
        "turn off the mirroring in the camera's driver, and record again",
        WrittenTo::Nothing,
    ),
    mistake(
        "gravity_direction",
        "springs would have to push against their loads",
        "write the reported gravity into session.toml",
        WrittenTo::Session,
    ),
    mistake(
        "marker_parent",
        "a marker stands still against another link",
        "fix the marker's link to the named link, at the reported place, in the robot's URDF",
        WrittenTo::Nothing,
    ),
    mistake(
        "board_turned",
        "boards fit when counted from another corner, or when turned by 90°",
        "turn the board back, or turn its mount in the robot's URDF",
        WrittenTo::Nothing,
    ),
    mistake(
        "slip",
        "from a row on a marker, the board or the camera sits elsewhere",
        "fasten it and record again; rows before and after the slip are two sessions",
        WrittenTo::Nothing,
    ),
];

/// The hypotheses without a single place, in words: small errors everywhere, slipped rows, gross mistakes.
///
/// ```
/// let mistakes = mirror_core::diagnose::mistakes();
/// assert!(mistakes.iter().any(|m| m.name == "axis_sign" && m.is_mistake));
/// ```
pub fn mistakes() -> &'static [MistakeInfo] {
    &EVERYWHERE
}
