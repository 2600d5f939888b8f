//! The joint estimator (bundle adjustment): all views of a session at once, mirrors, camera–board transform and
//! markers together.
//!
//! The camera–board transform dominates the error of every estimator that takes it as known: 1 mm of error in it is
//! about 1 mm of marker error. The board's reflections in several mirrors determine that error. So this estimator
//! adjusts everything at once: each frame's plane, the transform under its prior, and the markers of each posture,
//! which all frames of the posture share.

mod elimination;
mod estimate;
mod problem;
mod start;

pub use crate::mirror::Via;
pub use estimate::{JointEstimate, JointPoint, joint_estimate};
pub use problem::{BoardPrior, JointFrame, JointOptions, MarkerSighting, PointStatus};

pub(crate) use estimate::board_side_from_camera_side;
