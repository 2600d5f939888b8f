//! Jacobians: of a point on any link in any link's frame, and of all joints at once.

use super::joint::JointKind;
use super::model::Robot;
use super::poses::Poses;
use crate::error::{Error, Result};
use crate::geometry::rotation::hat;
use nalgebra::{Matrix3, Matrix3xX, Matrix6xX, Point3, Vector3};

/// The motion that a unit speed of a joint gives to what it carries, in the root's frame.
///
/// A point of the carried links at x (m, in the root's frame) moves at `angular × x + linear_at_root`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C)]
pub struct JointTwist {
    /// Angular velocity, rad a unit of the joint's position.
    pub angular: Vector3<f64>,
    /// Velocity of the carried body's point at the root's origin, m a unit of the joint's position.
    pub linear_at_root: Vector3<f64>,
}

impl JointTwist {
    /// Velocity (m a unit) of a carried point at x (m), all in the root's frame.
    #[inline(always)]
    pub fn velocity_at(&self, x: &Vector3<f64>) -> Vector3<f64> {
        self.angular.cross(x) + self.linear_at_root
    }
}

impl Robot {
    /// The twist of one joint for a unit of its own position; zero for a fixed joint.
    #[inline(always)]
    pub fn joint_twist(&self, poses: &Poses, joint: usize) -> JointTwist {
        let frame = &poses.frames[joint + 1];
        let [x, y, z] = self.steps[joint].axis;
        let direction = || frame.vector(&Vector3::new(x, y, z));
        match self.joints[joint].kind {
            JointKind::Fixed => JointTwist::default(),
            JointKind::Prismatic => JointTwist { angular: Vector3::zeros(), linear_at_root: direction() },
            JointKind::Revolute | JointKind::Continuous => {
                let angular = direction();
                JointTwist { angular, linear_at_root: frame.translation().cross(&angular) }
            }
        }
    }

    /// Twists of all joints, one each (fixed ones zero, mimic ones for a unit of their own position), root's frame.
    ///
    /// # Errors
    /// Poses or a slice that do not fit the robot.
    pub fn joint_twists(&self, poses: &Poses, twists: &mut [JointTwist]) -> Result<()> {
        self.check_poses(poses)?;
        if twists.len() != self.joints.len() {
            return Err(Error::LengthMismatch {
                what: "joint twists".to_owned(),
                got: twists.len(),
                needed: self.joints.len(),
            });
        }
        for (j, twist) in twists.iter_mut().enumerate() {
            *twist = self.joint_twist(poses, j);
        }
        Ok(())
    }

    /// Geometric Jacobian of link b against link a: 6×nq, rows (ω, v), in link a's frame.
    ///
    /// Column k is the twist of link b per unit of `q[k]`, as seen from link a: ω its angular velocity, v the velocity of
    /// `reference_in_a` (m), taken as a point of link b. Mimic joints add to the column of the joint that drives them.
    ///
    /// # Errors
    /// Poses or a matrix that do not fit the robot, an index that is no link.
    pub fn geometric_jacobian(
        &self,
        poses: &Poses,
        link_a: usize,
        link_b: usize,
        reference_in_a: &Point3<f64>,
        jacobian: &mut Matrix6xX<f64>,
    ) -> Result<()> {
        self.check_jacobian(poses, link_a, link_b, jacobian.ncols())?;
        jacobian.fill(0.0);
        let a = &poses.frames[link_a];
        let x = a.point(reference_in_a);
        self.for_each_between(link_a, link_b, |joint, sign| {
            let Some(drive) = self.joints[joint].drive else { return };
            let twist = self.joint_twist(poses, joint);
            let weight = sign * drive.multiplier;
            let mut column = jacobian.column_mut(drive.position);
            let mut top = column.fixed_rows_mut::<3>(0);
            top += a.turned_back(&twist.angular) * weight;
            let mut bottom = column.fixed_rows_mut::<3>(3);
            bottom += a.turned_back(&twist.velocity_at(&x)) * weight;
        });
        Ok(())
    }

    /// Jacobian of a point: 3×nq, `∂ point_in_a / ∂ q`, of a point fixed in link b as link a sees it.
    ///
    /// Link a may be any link: the camera's, say. m per rad (m per m for prismatic joints). Mimic joints add to the
    /// column of the joint that drives them. Allocates nothing.
    ///
    /// # Errors
    /// Poses or a matrix that do not fit the robot, an index that is no link.
    pub fn point_jacobian(
        &self,
        poses: &Poses,
        link_a: usize,
        link_b: usize,
        point_in_b: &Point3<f64>,
        jacobian: &mut Matrix3xX<f64>,
    ) -> Result<()> {
        self.check_jacobian(poses, link_a, link_b, jacobian.ncols())?;
        jacobian.fill(0.0);
        let a = &poses.frames[link_a];
        let x = poses.frames[link_b].point(point_in_b);
        self.for_each_between(link_a, link_b, |joint, sign| {
            let Some(drive) = self.joints[joint].drive else { return };
            let velocity = self.joint_twist(poses, joint).velocity_at(&x);
            let mut column = jacobian.column_mut(drive.position);
            column += a.turned_back(&velocity) * (sign * drive.multiplier);
        });
        Ok(())
    }

    /// `∂ point_in_a / ∂ (ω, v)` of a tangent inserted after a joint: `parent_from_child ∘ (Exp ω, v)`, 3×3 each.
    ///
    /// The place Jacobian of every effect that is a small twist between a joint and its link (tangent of
    /// [`crate::geometry::rotation::moved`], in the child link's frame). `sign` is the joint's in [`Robot::chain`]; zero off the chain.
    ///
    /// # Errors
    /// Poses that do not fit the robot, an index that is no link or joint.
    pub fn twist_jacobian(
        &self,
        poses: &Poses,
        link_a: usize,
        link_b: usize,
        point_in_b: &Point3<f64>,
        joint: usize,
    ) -> Result<TwistJacobian> {
        self.check_jacobian(poses, link_a, link_b, self.position_count())?;
        self.check_link("child link of the joint", joint + 1)?;
        let child = joint + 1;
        let (carries_a, carries_b) = (self.is_below(link_a, child), self.is_below(link_b, child));
        let sign = f64::from(i8::from(carries_b) - i8::from(carries_a));
        let (a, c) = (&poses.frames[link_a], &poses.frames[child]);
        let point_in_child = c.turned_back(&(poses.frames[link_b].point(point_in_b) - c.translation()));
        let a_from_child = a.rotation().transpose() * c.rotation() * sign;
        Ok(TwistJacobian { wrt_omega: -a_from_child * hat(&point_in_child), wrt_v: a_from_child })
    }

    /// Visits the joints between two links, in no order: sign +1 where they carry b, −1 where they carry a.
    #[inline(always)]
    pub(super) fn for_each_between(&self, link_a: usize, link_b: usize, mut visit: impl FnMut(usize, f64)) {
        for (from, other, sign) in [(link_a, link_b, -1.0), (link_b, link_a, 1.0)] {
            let mut at = from;
            while !self.is_below(other, at) {
                let Some(joint) = self.links[at].parent_joint else { break };
                visit(joint, sign);
                at = self.joints[joint].parent_link;
            }
        }
    }

    fn check_jacobian(&self, poses: &Poses, link_a: usize, link_b: usize, columns: usize) -> Result<()> {
        self.check_poses(poses)?;
        self.check_link("link a", link_a)?;
        self.check_link("link b", link_b)?;
        if columns == self.position_count() {
            return Ok(());
        }
        Err(Error::LengthMismatch {
            what: "columns of the Jacobian".to_owned(),
            got: columns,
            needed: self.position_count(),
        })
    }
}

/// How a point moves with a small rotation and shift at a joint: see [`Robot::twist_jacobian`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwistJacobian {
    /// `∂ point_in_a / ∂ ω`, m/rad.
    pub wrt_omega: Matrix3<f64>,
    /// `∂ point_in_a / ∂ v`, m/m.
    pub wrt_v: Matrix3<f64>,
}
