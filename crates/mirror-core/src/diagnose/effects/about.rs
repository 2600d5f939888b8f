//! What readers and files need to know of an effect beyond its law's columns; each effect states it in its own file.

use crate::robot::JointTerm;
use serde::Serialize;

/// The kind of place at which an effect can be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PlaceKind {
    /// A joint: `joint:J`.
    Joint,
    /// A joint that depends on another: `joint:J<-joint:K`.
    JointPair,
    /// A link: `link:L`.
    Link,
    /// A marker: `marker:M`.
    Marker,
    /// The camera.
    Camera,
    /// The board.
    Board,
    /// The mirror.
    Mirror,
}

impl PlaceKind {
    /// Its name in files, for example `joint_pair`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Joint => "joint",
            Self::JointPair => "joint_pair",
            Self::Link => "link",
            Self::Marker => "marker",
            Self::Camera => "camera",
            Self::Board => "board",
            Self::Mirror => "mirror",
        }
    }
}

/// The file into which the effect is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum WrittenTo {
    /// The robot's description.
    Urdf,
    /// The simulator's model: mechanics that a URDF cannot describe.
    Mjcf,
    /// The camera's calibration.
    CameraFile,
    /// The session's description of board and mirror.
    Session,
    /// None: it is repaired or fed forward.
    Nothing,
}

impl WrittenTo {
    /// Its name in files, for example `camera_file`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Urdf => "urdf",
            Self::Mjcf => "mjcf",
            Self::CameraFile => "camera_file",
            Self::Session => "session",
            Self::Nothing => "nothing",
        }
    }
}

/// The description of an effect of the vocabulary.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct About {
    pub at: PlaceKind,
    pub law: &'static str,
    pub remedy: &'static str,
    pub written_to: WrittenTo,
    /// At a joint: which term of the joint law each parameter is; empty where it is none.
    pub joint_law: &'static [JointTerm],
    pub signature: &'static str,
    pub shown_by: &'static str,
    pub confused_with: &'static str,
}
