//! Start values of the estimation: each frame's mirror from its board, and the robot's root in the unknown frame of
//! measured points.

use crate::diagnose::data::recording::Recording;
use crate::diagnose::model::frame::FrameWork;
use crate::diagnose::model::kinematics::NodePoses;
use crate::diagnose::model::pose::Pose;
use crate::diagnose::model::problem::{BoardFit, FRAMES_A_CHUNK, Observation, Problem};
use crate::error::Result;
use crate::geometry::rotation::nearest;
use crate::robot::Robot;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

impl Problem {
    /// Arranges a validated recording and finds where estimation starts.
    ///
    /// # Errors
    /// Unknown links; a mirror that no frame's board shows.
    pub fn new(robot: &Robot, recording: &Recording) -> Result<Self> {
        let mut problem = Self::arranged(robot, recording)?;
        if problem.unknown_frame.is_some() {
            problem.unknown_frame = Some(problem.start_of_unknown_frame());
        }
        problem.fit_boards()?;
        problem.leave_out_false_corners()?;
        Ok(problem)
    }

    /// Fits each frame's mirror to its board with nominal optics, from its previous value if there is one.
    pub fn fit_boards(&mut self) -> Result<()> {
        let nominal = self.nominal();
        let eye = self.eye(&nominal)?;
        let fits: Vec<Option<BoardFit>> = (0..self.frames.len())
            .into_par_iter()
            .with_min_len(FRAMES_A_CHUNK)
            .map_init(
                || FrameWork::new(self),
                |work, frame| {
                    let known = self.boards.get(frame).copied().flatten();
                    let near = known.and_then(|known| {
                        work.fit_board(self, &nominal, eye.as_ref(), frame, Some(known.foot))
                    });
                    near.or_else(|| work.fit_board(self, &nominal, eye.as_ref(), frame, None))
                },
            )
            .collect();
        self.boards = fits;
        Ok(())
    }

    /// Pose of the root in the unknown frame that fits the nominal model best (Umeyama 1991, without scale).
    fn start_of_unknown_frame(&self) -> Pose {
        let nominal = self.nominal();
        let nodes = self.scene.nodes();
        let mut poses = NodePoses::new(nodes);
        let (mut pairs, mut mean_a, mut mean_b) = (Vec::new(), Vector3::zeros(), Vector3::zeros());
        for (f, data) in self.frames.iter().enumerate() {
            poses.update(&self.scene.body, &self.scene.commanded[f * nodes..(f + 1) * nodes], &nominal, f);
            let root = poses.site(&self.scene.body.root);
            for observation in &data.others {
                if let Observation::Point { marker, position } = observation {
                    let in_root = root.inverse_point(&poses.site(&self.marker_sites[*marker]).t);
                    mean_a += position;
                    mean_b += in_root;
                    pairs.push((*position, in_root));
                }
            }
        }
        let count = pairs.len().max(1) as f64;
        mean_a /= count;
        mean_b /= count;
        let covariance: Matrix3<f64> =
            pairs.iter().map(|(a, b)| (a - mean_a) * (b - mean_b).transpose()).sum();
        let rotation = nearest(&covariance).unwrap_or_else(Matrix3::identity);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
        let translation = Translation3::from(mean_a - rotation * mean_b);
        Pose::from(&Isometry3::from_parts(translation, rotation))
    }
}
