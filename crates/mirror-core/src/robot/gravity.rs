//! Gravity's torque at each joint while any one link is held still.

use super::joint::JointKind;
use super::model::Robot;
use super::poses::Poses;
use crate::error::{Error, Result, finite};
use nalgebra::Vector3;

/// The load of gravity on one joint.
///
/// Force and moment are those conjugate to a tangent `(Exp ω, v)` inserted after the joint (in the child link's
/// frame, about its origin): `−∂V/∂(ω, v)`. If the held link is below the joint, the parent's side moves; the signs
/// follow, so that the moment's part along the axis is the torque of a turning joint in every case.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GravityLoad {
    /// Generalised force on the joint's own coordinate, `−∂V/∂θ`: N m, or N for a prismatic joint; 0 for a fixed one.
    /// Positive pushes θ upward.
    pub torque: f64,
    /// Moment about the child link's origin, in the child link's frame, N m.
    pub moment_in_link_nm: Vector3<f64>,
    /// Force, in the child link's frame, N.
    pub force_in_link_n: Vector3<f64>,
    /// Mass on the joint's side away from the held link, kg.
    pub carried_mass_kg: f64,
}

/// The loads of all joints at one posture: result and workspace of [`Robot::gravity_loads`].
#[derive(Debug, Clone)]
pub struct GravityLoads {
    joints: Vec<GravityLoad>,
    generalised: Vec<f64>,
    /// Mass and first mass moment (kg, kg m, in the root's frame) of each link and all below it.
    below: Vec<(f64, Vector3<f64>)>,
}

impl GravityLoads {
    /// One load a joint, in the robot's order; mimic joints each with their own.
    pub fn joints(&self) -> &[GravityLoad] {
        &self.joints
    }

    /// Generalised forces on q, N m (N for prismatic joints): mimic joints add to the joint that drives them, times
    /// their multiplier.
    pub fn torques(&self) -> &[f64] {
        &self.generalised
    }
}

impl Robot {
    /// A workspace for [`Robot::gravity_loads`].
    pub fn new_gravity_loads(&self) -> GravityLoads {
        let none = GravityLoad {
            torque: 0.0,
            moment_in_link_nm: Vector3::zeros(),
            force_in_link_n: Vector3::zeros(),
            carried_mass_kg: 0.0,
        };
        GravityLoads {
            joints: vec![none; self.joints.len()],
            generalised: vec![0.0; self.position_count()],
            below: vec![(0.0, Vector3::zeros()); self.links.len()],
        }
    }

    /// Gravity loads of all joints while `held_link` stands still.
    ///
    /// `τ_j = −∂V/∂θ_j = Σ m_i g·∂c_i/∂θ_j` over the links that move against the held one. `gravity_in_held_link` is the
    /// acceleration of free fall (m/s², pointing down) in that link's frame. The held link may be any link: the joints between it and
    /// the root then carry the root's side. pinocchio's `computeGeneralizedGravity` has the opposite sign (the torque that
    /// the motors must give). Allocates nothing.
    ///
    /// # Errors
    /// Gravity that is not finite, an index that is no link, poses or loads of another robot.
    pub fn gravity_loads(
        &self,
        poses: &Poses,
        gravity_in_held_link: &Vector3<f64>,
        held_link: usize,
        loads: &mut GravityLoads,
    ) -> Result<()> {
        self.check_poses(poses)?;
        self.check_link("held link", held_link)?;
        for x in gravity_in_held_link.iter() {
            finite("gravity, m/s²", *x)?;
        }
        if loads.below.len() != self.links.len() || loads.generalised.len() != self.position_count() {
            return Err(Error::LengthMismatch {
                what: format!("gravity loads for robot {:?} (links)", self.name),
                got: loads.below.len(),
                needed: self.links.len(),
            });
        }
        let gravity = poses.frames[held_link].vector(gravity_in_held_link);
        for ((link, frame), below) in self.links.iter().zip(&poses.frames).zip(&mut loads.below) {
            *below = (link.mass_kg, frame.point(&link.com_in_link_m) * link.mass_kg);
        }
        for joint in self.joints.iter().rev() {
            let (mass, moment) = loads.below[joint.child_link];
            let parent = &mut loads.below[joint.parent_link];
            parent.0 += mass;
            parent.1 += moment;
        }
        let (all_mass, all_moment) = loads.below[0];
        loads.generalised.fill(0.0);
        for (j, joint) in self.joints.iter().enumerate() {
            let child = joint.child_link;
            let frame = &poses.frames[child];
            let (mut mass, mut moment) = loads.below[child];
            let mut sign = 1.0;
            if self.is_below(held_link, child) {
                (mass, moment, sign) = (all_mass - mass, all_moment - moment, -1.0);
            }
            let about_origin = (moment - frame.translation() * mass).cross(&gravity) * sign;
            let load = GravityLoad {
                moment_in_link_nm: frame.turned_back(&about_origin),
                force_in_link_n: frame.turned_back(&(gravity * (sign * mass))),
                carried_mass_kg: mass,
                torque: 0.0,
            };
            let axis = &joint.axis;
            let torque = match joint.kind {
                JointKind::Fixed => 0.0,
                JointKind::Prismatic => axis.dot(&load.force_in_link_n),
                JointKind::Revolute | JointKind::Continuous => axis.dot(&load.moment_in_link_nm),
            };
            loads.joints[j] = GravityLoad { torque, ..load };
            if let Some(drive) = joint.drive {
                loads.generalised[drive.position] += drive.multiplier * torque;
            }
        }
        Ok(())
    }
}
