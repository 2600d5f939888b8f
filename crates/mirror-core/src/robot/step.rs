//! Each joint prepared for the kernels: constants folded once, so that a posture costs few operations.

use super::frame::{Frame, mix};
use super::joint::{Joint, JointKind};
use nalgebra::Matrix3;

/// What a joint does to its parent's frame, by the cheapest formula that is exact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Motion {
    /// Fixed, the rotation is the identity: a shift.
    Shift,
    /// Fixed.
    Still,
    /// Turns about the x, y or z axis (0, 1, 2), the rotation of the joint's frame is the identity.
    TurnPlain(u8),
    /// Turns about the x, y or z axis of a rotated frame.
    TurnAligned(u8),
    /// Turns about any axis: index into nothing, the matrices are in `along` and `across`.
    Turn,
    /// Slides along `slide`.
    Slide,
}

/// A joint as the kernels see it. `parent_from_child = fixed ∘ motion(θ)`.
#[derive(Debug, Clone)]
pub(super) struct Step {
    pub motion: Motion,
    pub parent_link: usize,
    /// Whether q moves it.
    pub moves: bool,
    /// `parent_from_joint`.
    pub fixed: Frame,
    /// Entry of q, sign of the axis included in the factor and the offset where the axis is −x, −y or −z.
    pub position: usize,
    pub multiplier: f64,
    pub offset: f64,
    /// For [`Motion::Turn`]: F a aᵀ and F [a]×, so that the rotation is along + cos (F − along) + sin across.
    pub along: Frame,
    pub across: Frame,
    /// For [`Motion::Slide`]: the axis in the parent's frame.
    pub slide: [f64; 3],
    /// The axis in the child's frame.
    pub axis: [f64; 3],
}

/// The coordinate axis and sign of a unit vector that lies exactly on one.
fn aligned(axis: &[f64; 3]) -> Option<(u8, f64)> {
    let k = (0..3).find(|&k| axis[k].abs() == 1.0)?;
    Some((k as u8, axis[k]))
}

impl Step {
    pub fn of_joints(joints: &[Joint]) -> Vec<Self> {
        joints.iter().map(Self::of_joint).collect()
    }

    fn of_joint(joint: &Joint) -> Self {
        let fixed = Frame::from_isometry(&joint.parent_from_joint);
        let rotation = fixed.rotation();
        let plain = rotation == Matrix3::identity();
        let axis = [joint.axis.x, joint.axis.y, joint.axis.z];
        let (mut sign, mut motion) = (1.0, Motion::Still);
        match joint.kind {
            JointKind::Fixed if plain => motion = Motion::Shift,
            JointKind::Fixed => {}
            JointKind::Prismatic => motion = Motion::Slide,
            JointKind::Revolute | JointKind::Continuous => match aligned(&axis) {
                Some((k, s)) => {
                    sign = s;
                    motion = if plain { Motion::TurnPlain(k) } else { Motion::TurnAligned(k) };
                }
                None => motion = Motion::Turn,
            },
        }
        let a = joint.axis.into_inner();
        let zero = nalgebra::Vector3::zeros();
        let slide = rotation * a;
        let drive = joint.drive;
        Self {
            motion,
            parent_link: joint.parent_link,
            moves: drive.is_some(),
            fixed,
            position: drive.map_or(0, |d| d.position),
            multiplier: drive.map_or(0.0, |d| sign * d.multiplier),
            offset: drive.map_or(0.0, |d| sign * d.offset),
            along: Frame::from_parts(&(rotation * a * a.transpose()), &zero),
            across: Frame::from_parts(&(rotation * a.cross_matrix()), &zero),
            slide: [slide.x, slide.y, slide.z],
            axis,
        }
    }

    /// `root_from_child` from `root_from_parent`; `value` is the joint's position with its sign folded in.
    #[inline(always)]
    pub fn advance(&self, parent: &Frame, value: f64, sine: f64, cosine: f64) -> Frame {
        let f = &self.fixed;
        let head = |c: &[f64; 4]| [c[0], c[1], c[2]];
        let origin = parent.mapped(head(&f.origin));
        let turned = |k: u8, base: Frame| match k {
            0 => Frame {
                y: mix(&base.y, cosine, &base.z, sine),
                z: mix(&base.z, cosine, &base.y, -sine),
                ..base
            },
            1 => Frame {
                z: mix(&base.z, cosine, &base.x, sine),
                x: mix(&base.x, cosine, &base.z, -sine),
                ..base
            },
            _ => Frame {
                x: mix(&base.x, cosine, &base.y, sine),
                y: mix(&base.y, cosine, &base.x, -sine),
                ..base
            },
        };
        let rotated =
            |x, y, z| Frame { x: parent.turned(x), y: parent.turned(y), z: parent.turned(z), origin };
        match self.motion {
            Motion::Shift => Frame { origin, ..*parent },
            Motion::Still => rotated(head(&f.x), head(&f.y), head(&f.z)),
            Motion::TurnPlain(k) => turned(k, Frame { origin, ..*parent }),
            Motion::TurnAligned(k) => turned(k, rotated(head(&f.x), head(&f.y), head(&f.z))),
            Motion::Turn => {
                let column = |a: &[f64; 4], f: &[f64; 4], s: &[f64; 4]| {
                    core::array::from_fn(|i| a[i] + cosine * (f[i] - a[i]) + sine * s[i])
                };
                let (a, s) = (&self.along, &self.across);
                rotated(column(&a.x, &f.x, &s.x), column(&a.y, &f.y, &s.y), column(&a.z, &f.z, &s.z))
            }
            Motion::Slide => {
                let shift = core::array::from_fn(|i| f.origin[i] + self.slide[i] * value);
                let base = rotated(head(&f.x), head(&f.y), head(&f.z));
                Frame { origin: parent.mapped(shift), ..base }
            }
        }
    }
}
