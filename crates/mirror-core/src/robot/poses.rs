//! The poses of all links at one posture.

use super::frame::Frame;
use super::model::Robot;
use super::sine::sines_cosines;
use crate::error::{Error, Result};
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

/// The frames of all links at one posture, in the root's frame: result and workspace of [`Robot::forward_kinematics`].
///
/// Made once by [`Robot::new_poses`], reused from posture to posture without allocation.
#[derive(Debug, Clone)]
pub struct Poses {
    pub(super) frames: Vec<Frame>,
    values: Vec<f64>,
    sines: Vec<f64>,
    cosines: Vec<f64>,
}

impl Poses {
    /// Number of links.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Whether there is no link; never so for a robot's poses.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Pose of a link in the root's frame.
    ///
    /// Panics, as indexing does, for an index that [`Robot::link_index`] did not give.
    pub fn root_from_link(&self, link: usize) -> Isometry3<f64> {
        self.frames[link].isometry()
    }

    /// Rotation of a link in the root's frame, without the cost of a quaternion.
    pub fn root_from_link_rotation(&self, link: usize) -> Matrix3<f64> {
        self.frames[link].rotation()
    }

    /// Origin of a link in the root's frame, m.
    pub fn link_origin_in_root_m(&self, link: usize) -> Point3<f64> {
        Point3::from(self.frames[link].translation())
    }

    /// Pose of a link in another's frame: `a_from_b = root_from_a⁻¹ ∘ root_from_b`.
    pub fn a_from_b(&self, link_a: usize, link_b: usize) -> Isometry3<f64> {
        let (a, b) = (&self.frames[link_a], &self.frames[link_b]);
        let rotation = a.rotation().transpose() * b.rotation();
        Frame::from_parts(&rotation, &a.turned_back(&(b.translation() - a.translation()))).isometry()
    }

    /// Maps a point (m) from a link's frame into the root's.
    pub fn point_in_root(&self, link: usize, point_in_link: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.frames[link].point(point_in_link))
    }

    /// Maps a point (m) from link b's frame into link a's.
    pub fn point_in_a(&self, link_a: usize, link_b: usize, point_in_b: &Point3<f64>) -> Point3<f64> {
        let in_root: Vector3<f64> = self.frames[link_b].point(point_in_b);
        let a = &self.frames[link_a];
        Point3::from(a.turned_back(&(in_root - a.translation())))
    }
}

impl Robot {
    /// A workspace for [`Robot::forward_kinematics`], all links at the root.
    pub fn new_poses(&self) -> Poses {
        Poses {
            frames: vec![Frame::IDENTITY; self.links.len()],
            values: vec![0.0; self.joints.len()],
            sines: vec![0.0; self.joints.len()],
            cosines: vec![1.0; self.joints.len()],
        }
    }

    /// Forward kinematics: the poses of all links in the root's frame, `root_from_child = root_from_parent ∘
    /// parent_from_joint ∘ motion(θ)`.
    ///
    /// `q` has [`Robot::position_count`] entries, rad (m for prismatic joints). Allocates nothing.
    ///
    /// # Errors
    /// A wrong length of `q`, an entry that is not finite (by the joint's name), poses of another robot.
    pub fn forward_kinematics(&self, q: &[f64], poses: &mut Poses) -> Result<()> {
        self.check_positions(q)?;
        self.check_poses(poses)?;
        self.advance_all(q, poses);
        Ok(())
    }

    /// Forward kinematics into new poses: for use outside inner loops.
    ///
    /// # Errors
    /// As [`Robot::forward_kinematics`].
    pub fn poses(&self, q: &[f64]) -> Result<Poses> {
        let mut poses = self.new_poses();
        self.forward_kinematics(q, &mut poses)?;
        Ok(poses)
    }

    /// Position of a joint (rad, or m), mimic joints included; 0 for a fixed one.
    pub fn joint_position(&self, joint: usize, q: &[f64]) -> f64 {
        self.joints[joint].drive.map_or(0.0, |d| d.multiplier * q[d.position] + d.offset)
    }

    pub(super) fn check_positions(&self, q: &[f64]) -> Result<()> {
        if q.len() != self.position_count() {
            return Err(Error::LengthMismatch {
                what: format!("positions q of robot {:?} (one a movable joint)", self.name),
                got: q.len(),
                needed: self.position_count(),
            });
        }
        // A sum is finite exactly when each term times zero is zero: one pass without branches.
        if q.iter().map(|x| x * 0.0).sum::<f64>() == 0.0 {
            return Ok(());
        }
        let bad = q.iter().position(|x| !x.is_finite()).unwrap_or(0);
        let joint = &self.joints[self.position_joints[bad]].name;
        Err(Error::NotFinite { what: format!("position of joint {joint:?}"), got: q[bad] })
    }

    pub(super) fn check_poses(&self, poses: &Poses) -> Result<()> {
        if poses.frames.len() == self.links.len() {
            return Ok(());
        }
        Err(Error::LengthMismatch {
            what: format!("poses for robot {:?} (links)", self.name),
            got: poses.frames.len(),
            needed: self.links.len(),
        })
    }

    /// The kernel: lengths are checked.
    #[inline(always)]
    fn advance_all(&self, q: &[f64], poses: &mut Poses) {
        let count = self.steps.len();
        let Poses { frames, values, sines, cosines } = poses;
        let (values, sines, cosines) = (&mut values[..count], &mut sines[..count], &mut cosines[..count]);
        for (value, step) in values.iter_mut().zip(&self.steps) {
            *value = if q.is_empty() { 0.0 } else { step.multiplier * q[step.position] + step.offset };
        }
        sines_cosines(values, sines, cosines);
        for (j, step) in self.steps.iter().enumerate() {
            let parent = frames[step.parent_link];
            frames[j + 1] = step.advance(&parent, values[j], sines[j], cosines[j]);
        }
    }
}
