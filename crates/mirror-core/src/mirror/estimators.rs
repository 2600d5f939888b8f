//! The one interface of the single-view mirror estimators: from a name to the method.

use super::board::BoardView;
use super::estimate::{MirrorEstimate, MirrorEstimator};
use super::options::EstimatorOptions;
use super::rig::Rig;
use super::{likelihood, point_pair, pose_map};
use crate::error::Result;

impl MirrorEstimator {
    /// Estimates the mirror from one view of the reflected board.
    ///
    /// # Errors
    /// As [`super::planar_pose`]; [`crate::Error::MirrorBehind`] where the mirror would be on the board's far side.
    pub fn estimate(self, rig: &Rig, view: &BoardView, options: &EstimatorOptions) -> Result<MirrorEstimate> {
        let options = options.validated()?;
        match self {
            Self::Pose => pose_map::estimate(rig, view, &options),
            Self::PoseSnapped => pose_map::estimate_snapped(rig, view, &options),
            Self::PointPair => point_pair::estimate(rig, view, &options),
            Self::MaximumLikelihood => likelihood::estimate(rig, view, &options),
        }
    }
}
