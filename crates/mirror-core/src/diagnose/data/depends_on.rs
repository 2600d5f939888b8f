//! The variable on which an error without a known law depends.

use serde::{Serialize, Serializer};
use std::fmt;

/// On what an unexplained error depends; its words, also in the public format, are those of [`fmt::Display`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum DependsOn {
    /// The same in every posture.
    Nothing,
    /// The joint's own position.
    Position,
    /// Gravity's load on the place.
    Load,
    /// The direction of the joint's last motion.
    Direction,
    /// The path that the joint came along.
    History,
    /// Time.
    Time,
    /// The direction in which gravity pulls at it.
    Posture,
    /// The position of another joint.
    PositionOf(String),
    /// Its own position and another joint's.
    PositionAnd(String),
    /// Another error in each posture, without a law.
    EachPosture,
    /// The row of the session.
    Row,
    /// The rows from this frame on.
    RowsFrom(i64),
}

impl DependsOn {
    /// The other joint on whose position it depends.
    pub(crate) fn other_joint(&self) -> Option<&str> {
        match self {
            Self::PositionOf(joint) | Self::PositionAnd(joint) => Some(joint),
            _ => None,
        }
    }
}

impl fmt::Display for DependsOn {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => f.write_str("nothing"),
            Self::Position => f.write_str("position"),
            Self::Load => f.write_str("load"),
            Self::Direction => f.write_str("direction"),
            Self::History => f.write_str("history"),
            Self::Time => f.write_str("time"),
            Self::Posture => f.write_str("posture"),
            Self::PositionOf(joint) => write!(f, "position of joint:{joint}"),
            Self::PositionAnd(joint) => write!(f, "position and position of joint:{joint}"),
            Self::EachPosture => f.write_str("posture, each by itself"),
            Self::Row => f.write_str("row"),
            Self::RowsFrom(frame) => write!(f, "row, from {frame} on"),
        }
    }
}

impl Serialize for DependsOn {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}
