//! Several postures at once: one posture a lane of a vector.

use super::frame::{Column, Frame};
use super::joint::JointKind;
use super::model::Robot;
use super::sine;
use super::step::{Motion, Step};
use core::ops::{Add, Mul, Neg, Sub};

/// Number of postures of one pass of the batch kernels.
pub(super) const LANES: usize = 8;

/// One number of each posture. Plain arrays, which the compiler maps to the processor's vectors.
///
/// Only plain loops here, no `map`, no `from_fn`, no closures: those are separate functions, which the compiler
/// does not always inline, and one call in the kernel prevents all vectorisation (measured: 5 times the time).
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub(super) struct Lane(pub [f64; LANES]);

impl Lane {
    pub const ZERO: Self = Self([0.0; LANES]);
    pub const ONE: Self = Self([1.0; LANES]);
}

macro_rules! lanewise {
    ($trait:ident, $method:ident, $op:tt) => {
        impl $trait for Lane {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let mut out = [0.0; LANES];
                for i in 0..LANES {
                    out[i] = self.0[i] $op other.0[i];
                }
                Self(out)
            }
        }
        impl $trait<f64> for Lane {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                let mut out = [0.0; LANES];
                for i in 0..LANES {
                    out[i] = self.0[i] $op other;
                }
                Self(out)
            }
        }
    };
}
lanewise!(Add, add, +);
lanewise!(Sub, sub, -);
lanewise!(Mul, mul, *);

impl Neg for Lane {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        let mut out = [0.0; LANES];
        for i in 0..LANES {
            out[i] = -self.0[i];
        }
        Self(out)
    }
}

/// Three numbers of each posture: a point or a direction.
pub(super) type Lane3 = [Lane; 3];

#[inline(always)]
pub(super) fn cross(a: &Lane3, b: &Lane3) -> Lane3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
pub(super) fn sum(a: &Lane3, b: &Lane3) -> Lane3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
pub(super) fn minus(a: &Lane3, b: &Lane3) -> Lane3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub(super) fn scaled(a: &Lane3, s: f64) -> Lane3 {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// The three numbers of one posture.
#[inline(always)]
pub(super) fn lane_of(a: &Lane3, lane: usize) -> [f64; 3] {
    [a[0].0[lane], a[1].0[lane], a[2].0[lane]]
}

/// `a s + b t`.
#[inline(always)]
fn mix(a: &Lane3, s: Lane, b: &Lane3, t: Lane) -> Lane3 {
    [a[0] * s + b[0] * t, a[1] * s + b[1] * t, a[2] * s + b[2] * t]
}

/// `a_from_b` of each posture: b's axes and origin in frame a.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LaneFrame {
    pub axes: [Lane3; 3],
    pub origin: Lane3,
}

impl LaneFrame {
    const IDENTITY: Self = Self {
        axes: [
            [Lane::ONE, Lane::ZERO, Lane::ZERO],
            [Lane::ZERO, Lane::ONE, Lane::ZERO],
            [Lane::ZERO, Lane::ZERO, Lane::ONE],
        ],
        origin: [Lane::ZERO; 3],
    };

    /// Turns a direction that is the same in all postures.
    #[inline(always)]
    pub fn turned(&self, v: &[f64]) -> Lane3 {
        let [x, y, z] = &self.axes;
        [
            x[0] * v[0] + y[0] * v[1] + z[0] * v[2],
            x[1] * v[0] + y[1] * v[1] + z[1] * v[2],
            x[2] * v[0] + y[2] * v[1] + z[2] * v[2],
        ]
    }

    #[inline(always)]
    pub fn turned_lanes(&self, v: &Lane3) -> Lane3 {
        let [x, y, z] = &self.axes;
        [
            x[0] * v[0] + y[0] * v[1] + z[0] * v[2],
            x[1] * v[0] + y[1] * v[1] + z[1] * v[2],
            x[2] * v[0] + y[2] * v[1] + z[2] * v[2],
        ]
    }

    /// `Rᵀ v`.
    #[inline(always)]
    pub fn turned_back(&self, v: &Lane3) -> Lane3 {
        let [x, y, z] = &self.axes;
        [
            x[0] * v[0] + x[1] * v[1] + x[2] * v[2],
            y[0] * v[0] + y[1] * v[1] + y[2] * v[2],
            z[0] * v[0] + z[1] * v[1] + z[2] * v[2],
        ]
    }

    /// The pose in one posture as a homogeneous matrix by rows.
    #[inline(always)]
    pub fn write_matrix(&self, lane: usize, matrix: &mut [f64; 16]) {
        let [x, y, z] = &self.axes;
        for i in 0..3 {
            matrix[4 * i] = x[i].0[lane];
            matrix[4 * i + 1] = y[i].0[lane];
            matrix[4 * i + 2] = z[i].0[lane];
            matrix[4 * i + 3] = self.origin[i].0[lane];
        }
        matrix[12..].copy_from_slice(&[0.0, 0.0, 0.0, 1.0]);
    }

    /// Maps a point that is the same in all postures.
    #[inline(always)]
    pub fn mapped(&self, p: &[f64]) -> Lane3 {
        sum(&self.turned(p), &self.origin)
    }
}

/// The frames of all links in [`LANES`] postures.
#[derive(Debug, Clone)]
pub(super) struct LanePoses {
    pub frames: Vec<LaneFrame>,
}

impl LaneFrame {
    /// Turns the frame about its own x, y or z axis (0, 1, 2).
    #[inline(always)]
    fn turn_about(&mut self, axis: u8, sine: Lane, cosine: Lane) {
        let [x, y, z] = self.axes;
        match axis {
            0 => {
                self.axes[1] = mix(&y, cosine, &z, sine);
                self.axes[2] = mix(&z, cosine, &y, -sine);
            }
            1 => {
                self.axes[2] = mix(&z, cosine, &x, sine);
                self.axes[0] = mix(&x, cosine, &z, -sine);
            }
            _ => {
                self.axes[0] = mix(&x, cosine, &y, sine);
                self.axes[1] = mix(&y, cosine, &x, -sine);
            }
        }
    }

    #[inline(always)]
    fn rotated(&self, by: &Frame) -> [Lane3; 3] {
        [self.turned(&by.x), self.turned(&by.y), self.turned(&by.z)]
    }
}

/// A column of the rotation about any axis: `a + cos (f − a) + sin s`.
#[inline(always)]
fn column(a: &Column, f: &Column, s: &Column, sine: Lane, cosine: Lane) -> Lane3 {
    [
        cosine * (f[0] - a[0]) + sine * s[0] + a[0],
        cosine * (f[1] - a[1]) + sine * s[1] + a[1],
        cosine * (f[2] - a[2]) + sine * s[2] + a[2],
    ]
}

#[inline(always)]
fn advance(step: &Step, parent: &LaneFrame, value: Lane, out: &mut LaneFrame) {
    let f = &step.fixed;
    out.origin = parent.mapped(&f.origin);
    match step.motion {
        Motion::Shift => out.axes = parent.axes,
        Motion::Still => out.axes = parent.rotated(f),
        Motion::TurnPlain(k) => {
            let (sine, cosine) = sines_cosines(value);
            out.axes = parent.axes;
            out.turn_about(k, sine, cosine);
        }
        Motion::TurnAligned(k) => {
            let (sine, cosine) = sines_cosines(value);
            out.axes = parent.rotated(f);
            out.turn_about(k, sine, cosine);
        }
        Motion::Turn => {
            let (sine, cosine) = sines_cosines(value);
            let (a, s) = (&step.along, &step.across);
            out.axes = [
                parent.turned_lanes(&column(&a.x, &f.x, &s.x, sine, cosine)),
                parent.turned_lanes(&column(&a.y, &f.y, &s.y, sine, cosine)),
                parent.turned_lanes(&column(&a.z, &f.z, &s.z, sine, cosine)),
            ];
        }
        Motion::Slide => {
            out.axes = parent.rotated(f);
            let [x, y, z] = parent.turned(&step.slide);
            out.origin = sum(&out.origin, &[x * value, y * value, z * value]);
        }
    }
}

#[inline(always)]
fn sines_cosines(angles: Lane) -> (Lane, Lane) {
    let (mut sines, mut cosines) = (Lane::ZERO, Lane::ZERO);
    sine::sines_cosines(&angles.0, &mut sines.0, &mut cosines.0);
    (sines, cosines)
}

impl Robot {
    pub(super) fn new_lane_poses(&self) -> LanePoses {
        LanePoses { frames: vec![LaneFrame::IDENTITY; self.links.len()] }
    }

    /// Forward kinematics of up to [`LANES`] postures, rows of `q`; lanes beyond the rows repeat the last one.
    #[inline(always)]
    pub(super) fn advance_lanes(&self, q: &[f64], poses: &mut LanePoses) {
        let width = self.position_count();
        let rows = q.len().checked_div(width).unwrap_or(1).clamp(1, LANES);
        let mut starts = [0; LANES];
        for (lane, start) in starts.iter_mut().enumerate() {
            *start = lane.min(rows - 1) * width;
        }
        for (j, step) in self.steps.iter().enumerate() {
            let mut value = Lane::ZERO;
            if step.moves {
                for (value, start) in value.0.iter_mut().zip(starts) {
                    *value = step.multiplier * q[start + step.position] + step.offset;
                }
            }
            let (done, rest) = poses.frames.split_at_mut(j + 1);
            advance(step, &done[step.parent_link], value, &mut rest[0]);
        }
    }

    /// Angular velocity and velocity at the root's origin of what a joint carries, a unit of its position.
    #[inline(always)]
    pub(super) fn joint_twist_lanes(&self, poses: &LanePoses, joint: usize) -> (Lane3, Lane3) {
        let frame = &poses.frames[joint + 1];
        match self.joints[joint].kind {
            JointKind::Fixed => ([Lane::ZERO; 3], [Lane::ZERO; 3]),
            JointKind::Prismatic => ([Lane::ZERO; 3], frame.turned(&self.steps[joint].axis)),
            JointKind::Revolute | JointKind::Continuous => {
                let angular = frame.turned(&self.steps[joint].axis);
                (angular, cross(&frame.origin, &angular))
            }
        }
    }
}
