//! The mistakes of one session in another one of the same robot: what is wrong in the model, in how the log is written or in how
//! pictures are taken is wrong there too; what happened to some rows (a slip, a log that hung, a delay by whole rows) is not.

use super::mistake::Mistake;
use super::undone::{Undone, arranged_again};
use crate::diagnose::data::recording::Recording;
use crate::diagnose::model::problem::Problem;
use crate::error::Result;
use crate::robot::Robot;

impl Mistake {
    /// The mistake in another session with so many frames; none where it is of this session's rows alone.
    fn lasting(&self, frames: usize) -> Option<Self> {
        match self {
            Self::AxisSign { .. }
            | Self::JointsSwapped { .. }
            | Self::ColumnsSwapped { .. }
            | Self::JointUnit { .. }
            | Self::AllUnits { .. }
            | Self::Zero { .. }
            | Self::Resolution { .. }
            | Self::Flipped { .. }
            | Self::PointsMirrored { .. }
            | Self::BoardTurned { .. }
            | Self::MarkerParent { .. }
            | Self::Gravity { .. } => Some(self.clone()),
            Self::MarkersSwapped { markers, always: true, .. } => {
                Some(Self::MarkersSwapped { markers: *markers, frames: (0..frames).collect(), always: true })
            }
            // By a part of a row: what is read while the robot still moves, or a clock. By whole rows it is one recording's.
            Self::Late { rows, .. } if rows.abs() < 1.0 => Some(self.clone()),
            Self::MarkersSwapped { .. }
            | Self::Late { .. }
            | Self::LogFrozen { .. }
            | Self::JointFrozen { .. }
            | Self::ColumnLost { .. }
            | Self::ZeroLost { .. }
            | Self::Squares { .. }
            | Self::Slip { .. }
            | Self::Hung { .. }
            | Self::Rows { .. } => None,
        }
    }
}

impl Undone {
    /// Another session, arranged with the lasting mistakes of this one undone, in the same order; as it was `arranged` where its
    /// robot has other joints or its markers other names.
    ///
    /// # Errors
    /// Invalid parameters of camera or mirror.
    pub fn undone_in(&self, robot: &Robot, recording: &Recording, arranged: Problem) -> Result<Problem> {
        let mut problem = arranged;
        let (own, its) = (&self.problem.scene, &problem.scene);
        let joints = own.body.nodes.iter().map(|node| &node.joint);
        if !joints.eq(its.body.nodes.iter().map(|node| &node.joint)) || own.marker_names != its.marker_names {
            return Ok(problem);
        }
        let (mut robot, mut recording) = (robot.clone(), recording.clone());
        let frames = recording.frames.len();
        for mistake in self.mistakes.iter().filter_map(|mistake| mistake.lasting(frames)) {
            mistake.undo(&mut robot, &problem, &mut recording)?;
            problem = arranged_again(&robot, &recording, &problem)?;
            mistake.on_problem(&mut problem)?;
        }
        Ok(problem)
    }
}
