//! What was left out of the data, and why: nothing is left out without being listed.

use serde::{Serialize, Serializer};
use std::fmt;

/// Something that was left out.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LeftOut {
    /// The frame's number.
    pub frame: i64,
    /// `board`, or the marker's name.
    pub target: String,
    /// How far off it was, in deviations of the noise; none where nothing predicts it.
    pub deviations: Option<f64>,
    /// Why; in the public format its words.
    pub why: Reason,
}

/// Why something was left out; its words are those of [`fmt::Display`].
#[derive(Debug, Clone, PartialEq)]
pub enum Reason {
    /// A board of which fewer corners are seen than its mirror needs.
    FewCorners {
        /// How many are seen.
        got: usize,
        /// How many it needs.
        needed: usize,
    },
    /// A board that is seen whole and is no reflection of the board; `beside_others`: its residual is far from nearly all others'.
    NoMirror {
        /// Whether most boards of the session agree with their mirrors.
        beside_others: bool,
    },
    /// One corner that does not lie on the grid of the others.
    CornerBeside {
        /// Its index.
        index: usize,
    },
    /// A marker seen in a mirror, in a frame without a board to know the mirror by.
    NoBoard,
    /// The row holds another row's measurement.
    OtherRow,
    /// The row repeats the measurement of the row before.
    Repeated,
    /// The position of a joint that carries it is not known in this row.
    PositionUnknown,
    /// The best model does not predict it to be seen.
    OutOfSight,
    /// A thing in the background that was taken for the marker.
    AtOnePixel {
        /// Where it stands still, px.
        pixel_px: [f64; 2],
        /// In how many postures.
        postures: usize,
        /// By how much the model moves the marker between these, px.
        moved_px: f64,
    },
    /// A marker far from what the best model predicts.
    FarFromModel,
    /// A marker far from all that small errors allow.
    FarFromAll(Option<Elsewhere>),
    /// Nearly all that was seen in the frame is far from the model.
    WholeRow(Option<Elsewhere>),
}

/// A joint whose other position corrects the row.
#[derive(Debug, Clone, PartialEq)]
pub struct Elsewhere {
    /// The joint.
    pub joint: String,
    /// By how much its position differs from what the row says, rad or m.
    pub by: f64,
    /// `rad` or `m`.
    pub unit: &'static str,
}

impl LeftOut {
    /// The joint whose other position corrects the row, and whether that is a larger one.
    pub(crate) fn joint_elsewhere(&self) -> Option<(&str, bool)> {
        match &self.why {
            Reason::FarFromAll(Some(Elsewhere { joint, by, .. }))
            | Reason::WholeRow(Some(Elsewhere { joint, by, .. })) => Some((joint, by.is_sign_positive())),
            _ => None,
        }
    }

    /// Whether it is a marker's observation that is far from the model's prediction.
    pub(crate) fn is_false(&self) -> bool {
        matches!(self.why, Reason::FarFromModel | Reason::FarFromAll(_))
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FewCorners { got, needed } => write!(f, "too few corners: {got}, needed {needed}"),
            Self::NoMirror { beside_others: false } => f.write_str("no flat mirror explains its corners"),
            Self::NoMirror { beside_others: true } => {
                f.write_str("no flat mirror explains its corners: another grid, or another picture")
            }
            Self::CornerBeside { index } => {
                write!(f, "corner {index} lies beside the grid of the others, which are used")
            }
            Self::NoBoard => f.write_str("the mirror of this frame is not known: no board"),
            Self::OtherRow => f.write_str("the row contains the measurement of another row"),
            Self::Repeated => f.write_str("the same measurement, to the last digit, as in the row before"),
            Self::PositionUnknown => {
                f.write_str("the position of a joint that carries it is not known in this row")
            }
            Self::OutOfSight => f.write_str(
                "the best model does not see it in this frame: behind the camera, or beside the mirror",
            ),
            Self::AtOnePixel { pixel_px: [u, v], postures, moved_px } => write!(
                f,
                "at one pixel, {u:.0}, {v:.0}, in {postures} postures between which the model moves it by {moved_px:.0} px: something in the background, \
                 or on the mirror"
            ),
            Self::FarFromModel => f.write_str("far from the best model"),
            Self::FarFromAll(None) => {
                f.write_str("far from all that small errors allow: a digit, a label, or another thing")
            }
            Self::FarFromAll(Some(elsewhere)) => {
                write!(f, "far from all that small errors allow: {elsewhere}")
            }
            Self::WholeRow(None) => {
                f.write_str("nearly all that was seen in this frame is far from the model")
            }
            Self::WholeRow(Some(elsewhere)) => elsewhere.fmt(f),
        }
    }
}

impl fmt::Display for Elsewhere {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { joint, by, unit } = self;
        write!(
            f,
            "would fit if joint:{joint} were {by:+.3} {unit} from what the row says: a digit, or a sign"
        )
    }
}

impl Serialize for Reason {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}
