//! The upward direction on a link, as an accelerometer at rest reads it.
//!
//! At rest an accelerometer reads `−g` in its own frame:
//!
//! `u = −R_linkᵀ R_root g / |g|`, `R = (∏ A_k E_k A_kᵀ) A`, over the joints k from the robot's root to the link
//!
//! with `A_k` the rotation of the link that joint k carries, at the commanded posture, and `E_k = Rot(axis, δ_k)
//! Exp(ω_k)` its error in this frame: δ the error of its position, ω the bending of the link.

use super::chain::Direction;
use super::joint::JointKind;
use super::model::Robot;
use super::poses::Poses;
use crate::error::{Error, Result, finite, positive};
use crate::geometry::rotation::exp;
use nalgebra::{Matrix3, Vector3};

/// Rotation errors of the link that a joint carries, in addition to its commanded position, posture by posture.
#[derive(Debug, Clone, PartialEq)]
pub struct JointErrors {
    /// Index of the joint.
    pub joint: usize,
    /// Error of its position, rad; of a joint that slides it has no effect. Several entries of one joint add up.
    pub turn_rad: Vec<f64>,
    /// Bending of the link, a rotation vector in its frame, after the turn.
    pub bend_rad: Vec<Vector3<f64>>,
}

impl Robot {
    /// The direction of −g in a link's frame, a unit vector for each of N postures.
    ///
    /// `q` has the positions of `postures` postures, (N, nq), row after row: without movable joints it is empty whatever N is.
    /// `gravity_in_held_link` may have any length but zero. Errors of joints between `held_link` and the robot's root count like those on the
    /// way to the link; all others do not.
    ///
    /// # Errors
    /// An index that is no link or joint, positions of another number of postures, errors of another length, gravity of no length, an
    /// entry that is not finite.
    pub fn up_in_link(
        &self,
        q: &[f64],
        postures: usize,
        held_link: usize,
        link: usize,
        gravity_in_held_link: &Vector3<f64>,
        errors: &[JointErrors],
    ) -> Result<Vec<Vector3<f64>>> {
        let gravity = gravity_in_held_link / positive("length of gravity", gravity_in_held_link.norm())?;
        let chain = self.chain(held_link, link)?;
        let width = self.position_count();
        if q.len() != postures.saturating_mul(width) {
            return Err(Error::LengthMismatch {
                what: format!("positions ({postures}, {width}) of robot {:?}", self.name),
                got: q.len(),
                needed: postures.saturating_mul(width),
            });
        }
        for error in errors {
            let joint = self.joints.get(error.joint).ok_or_else(|| Error::OutOfRange {
                what: "joint of an error".to_owned(),
                got: error.joint as f64,
                needed: format!("a joint index below {}", self.joints.len()),
            })?;
            let got = error.turn_rad.len().min(error.bend_rad.len());
            let turns = error.turn_rad.iter().chain(error.bend_rad.iter().flatten());
            turns.copied().try_for_each(|v| finite("rotation error of a joint (rad)", v).map(drop))?;
            if got != postures || error.turn_rad.len() != error.bend_rad.len() {
                return Err(Error::LengthMismatch {
                    what: format!("errors of joint {:?} (one a posture)", joint.name),
                    got,
                    needed: postures,
                });
            }
        }
        // From the robot's root outwards, so that the last error is applied first.
        let on = |way: Direction| -> Vec<&JointErrors> {
            let steps = chain.steps.iter().filter(move |s| s.direction == way);
            let found = steps.flat_map(|s| errors.iter().filter(move |e| e.joint == s.joint));
            if way == Direction::Up { found.collect() } else { found.rev().collect() }
        };
        let (to_held, to_link) = (on(Direction::Up), on(Direction::Down));
        let mut poses = self.new_poses();
        let each = |row: usize| {
            self.forward_kinematics(&q[row * width..(row + 1) * width], &mut poses)?;
            let down = self.turned(&poses, held_link, &to_held, row) * gravity;
            Ok(-(self.turned(&poses, link, &to_link, row).transpose() * down))
        };
        (0..postures).map(each).collect()
    }

    /// A link's rotation in the root's frame, with the errors on the way to it.
    fn turned(&self, poses: &Poses, link: usize, inwards: &[&JointErrors], row: usize) -> Matrix3<f64> {
        inwards.iter().fold(poses.root_from_link_rotation(link), |rotation, error| {
            let joint = &self.joints[error.joint];
            let carried = poses.root_from_link_rotation(joint.child_link);
            // Where a joint slides, an error of its position turns nothing.
            let turn_rad = if joint.kind == JointKind::Prismatic { 0.0 } else { error.turn_rad[row] };
            let turn = exp(&(joint.axis.into_inner() * turn_rad)) * exp(&error.bend_rad[row]);
            carried * turn.to_rotation_matrix().matrix() * carried.transpose() * rotation
        })
    }
}
