//! A joint: its motion, its limits, and what drives it.

use nalgebra::{Isometry3, Unit, Vector3};

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
/// An independent joint has multiplier 1 and offset 0; a mimic joint those of its (possibly chained) `<mimic>`.
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
    /// Largest torque (N m) or force (N) that it is made for; none where the URDF states none.
    pub effort_limit: Option<f64>,
    /// Its `<mimic>` tag.
    pub mimic: Option<Mimic>,
    /// What drives it; none for a fixed joint.
    pub drive: Option<Drive>,
}
