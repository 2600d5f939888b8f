//! A validated robot: links, joints, and which position drives which joint.

use super::fault::{ModelFault, nearest};
use super::step::Step;
use crate::error::{Error, Result};
use nalgebra::{Isometry3, Point3, Unit, Vector3};
use std::collections::HashMap;

/// How a joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum JointKind {
    /// Turns about its axis, within limits.
    Revolute,
    /// Turns about its axis without limits.
    Continuous,
    /// Slides along its axis.
    Prismatic,
    /// Does not move.
    Fixed,
}

impl JointKind {
    /// Whether it turns.
    pub fn turns(self) -> bool {
        matches!(self, Self::Revolute | Self::Continuous)
    }

    /// Whether it moves at all.
    pub fn moves(self) -> bool {
        self != Self::Fixed
    }
}

/// The range of a joint, rad (m for a prismatic one).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Smallest position.
    pub lower: f64,
    /// Largest position.
    pub upper: f64,
}

/// What drives a movable joint: `joint position = multiplier · q[position] + offset`.
///
/// A joint of its own has multiplier 1 and offset 0; a mimic joint those of its (possibly chained) `<mimic>`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// Index into the positions vector.
    pub position: usize,
    /// Factor.
    pub multiplier: f64,
    /// Offset, rad (m for a prismatic joint).
    pub offset: f64,
}

/// A `<mimic>` tag: this joint follows another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mimic {
    /// Index of the joint that the tag names.
    pub joint: usize,
    /// Factor.
    pub multiplier: f64,
    /// Offset, rad (m for a prismatic joint).
    pub offset: f64,
}

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

/// A joint between two links.
///
/// `parent_from_child(θ) = parent_from_joint ∘ motion(θ)`; the motion turns about, or slides along, `axis`.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Name.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// Index of the link that carries it.
    pub parent_link: usize,
    /// Index of the link that it carries.
    pub child_link: usize,
    /// The joint's frame in the parent link's frame: the child's frame at position 0.
    pub parent_from_joint: Isometry3<f64>,
    /// Axis in the joint's frame (and in the child's); of no meaning for a fixed joint.
    pub axis: Unit<Vector3<f64>>,
    /// Limits; none where it has none.
    pub limits: Option<Limits>,
    /// Its `<mimic>` tag.
    pub mimic: Option<Mimic>,
    /// What drives it; none for a fixed joint.
    pub drive: Option<Drive>,
}

/// A robot: an immutable, validated tree of links and joints.
///
/// Links stand in depth-first order: link 0 is the root, joint j carries link j + 1, parents come before their
/// children, and the links below a link follow it without a gap. Positions `q` have one entry for each
/// joint that moves by itself (not fixed, not mimic), in the order of the joints; rad, or m for a prismatic one.
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
