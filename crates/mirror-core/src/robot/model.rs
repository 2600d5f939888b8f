//! A validated robot: its links and joints.

use super::fault::{ModelFault, nearest};
use super::joint::Joint;
use super::step::Step;
use crate::error::{Error, Result};
use nalgebra::Point3;
use std::collections::HashMap;

/// A rigid body and its frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Name.
    pub name: String,
    /// Mass, kg; 0 where the URDF has no `<inertial>`.
    pub mass_kg: f64,
    /// Centre of mass in the link's frame, m.
    pub com_in_link_m: Point3<f64>,
    /// The joint that carries it; none for the root.
    pub parent_joint: Option<usize>,
}

/// A robot: an immutable, validated tree of links and joints.
///
/// Links stand in depth-first order: link 0 is the root, joint j carries link j + 1, parents come before their
/// children, and the links below a link follow it without a gap. Positions `q` have one entry for each
/// joint that moves by itself (not fixed, not mimic), in the order of the joints; rad, or m for a prismatic one.
///
/// ```
/// use mirror_core::robot::Robot;
/// use nalgebra::Point3;
///
/// let robot = Robot::from_urdf_str(
///     r#"<robot name="arm"><link name="base"/><link name="hand"/>
///     <joint name="elbow" type="revolute"><parent link="base"/><child link="hand"/><origin xyz="0 0 0.1"/>
///     <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint></robot>"#,
/// )?;
/// let hand = robot.link_index("hand")?;
/// let at = robot.poses(&[0.5])?.point_in_a(0, hand, &Point3::new(0.0, 0.0, 0.2));
/// assert!((at.x - 0.2 * 0.5_f64.sin()).abs() < 1e-12);
/// # Ok::<(), mirror_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Robot {
    pub(super) name: String,
    pub(super) links: Vec<Link>,
    pub(super) joints: Vec<Joint>,
    /// One past the last link below (or equal to) each link.
    pub(super) subtree_end: Vec<usize>,
    pub(super) position_joints: Vec<usize>,
    pub(super) link_by_name: HashMap<String, usize>,
    pub(super) joint_by_name: HashMap<String, usize>,
    /// The kernel's view of the joints.
    pub(super) steps: Vec<Step>,
}

impl Robot {
    /// Name of the robot, as in its file.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Links, the root first, parents before children.
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// Joints, parents before children; joint j carries link j + 1.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// Length of the positions vector q.
    pub fn position_count(&self) -> usize {
        self.position_joints.len()
    }

    /// Index of the joint that each entry of q moves.
    pub fn position_joints(&self) -> &[usize] {
        &self.position_joints
    }

    /// Names of the joints that the entries of q move.
    pub fn position_names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.position_joints.iter().map(|&j| self.joints[j].name.as_str())
    }

    /// Index of a link by name.
    ///
    /// # Errors
    /// [`ModelFault::UnknownName`] with the nearest valid names.
    pub fn link_index(&self, name: &str) -> Result<usize> {
        let valid = || self.links.iter().map(|l| l.name.as_str());
        self.link_by_name.get(name).copied().ok_or_else(|| unknown("link", name, valid()))
    }

    /// Index of a joint by name.
    ///
    /// # Errors
    /// [`ModelFault::UnknownName`] with the nearest valid names.
    pub fn joint_index(&self, name: &str) -> Result<usize> {
        let valid = || self.joints.iter().map(|j| j.name.as_str());
        self.joint_by_name.get(name).copied().ok_or_else(|| unknown("joint", name, valid()))
    }

    /// Index into q of a joint by name.
    ///
    /// # Errors
    /// [`ModelFault::UnknownName`] with the nearest valid names: also for a fixed and for a mimic joint, which
    /// have no position of their own.
    pub fn position_index(&self, name: &str) -> Result<usize> {
        let own = self.joint_by_name.get(name).and_then(|&joint| self.position_of_joint(joint));
        own.ok_or_else(|| unknown("joint with a position of its own", name, self.position_names()))
    }

    /// Index into q of a joint that moves by itself; none for a fixed or a mimic joint.
    pub fn position_of_joint(&self, joint: usize) -> Option<usize> {
        let joint = self.joints.get(joint)?;
        if joint.mimic.is_some() { None } else { joint.drive.map(|d| d.position) }
    }

    /// Turns a joint's axis round: the same position moves it the other way.
    ///
    /// # Errors
    /// [`ModelFault::UnknownName`] with the nearest valid names.
    pub fn reverse_axis(&mut self, name: &str) -> Result<()> {
        let joint = self.joint_index(name)?;
        self.joints[joint].axis = -self.joints[joint].axis;
        self.steps = Step::of_joints(&self.joints);
        Ok(())
    }

    /// Whether a link hangs below (or is) another.
    pub fn is_below(&self, link: usize, ancestor: usize) -> bool {
        (ancestor..self.subtree_end[ancestor]).contains(&link)
    }

    /// Refuses an index of no link.
    pub(super) fn check_link(&self, what: &str, link: usize) -> Result<()> {
        if link < self.links.len() {
            return Ok(());
        }
        Err(Error::OutOfRange {
            what: what.to_owned(),
            got: link as f64,
            needed: format!("a link index below {}", self.links.len()),
        })
    }
}

fn unknown<'a>(kind: &'static str, got: &str, valid: impl Iterator<Item = &'a str>) -> Error {
    ModelFault::UnknownName { kind, got: got.to_owned(), nearest: nearest(got, valid) }.into()
}
