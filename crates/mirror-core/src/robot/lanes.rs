//! Several postures at once: one posture a lane of a vector.

use super::model::{JointKind, Robot};
use super::sine::sines_cosines;
use super::step::{Motion, Step};
use core::ops::{Add, Mul, Neg, Sub};

/// Postures that one pass of the batch kernels takes.
pub(super) const LANES: usize = 8;

/// One number of each posture. Plain arrays: the compiler makes them the vectors that the processor has.
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
                Self(core::array::from_fn(|i| self.0[i] $op other.0[i]))
            }
        }
        impl $trait<f64> for Lane {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                Self(core::array::from_fn(|i| self.0[i] $op other))
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
        Self(self.0.map(|x| -x))
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
        core::array::from_fn(|i| x[i] * v[0] + y[i] * v[1] + z[i] * v[2])
    }

    #[inline(always)]
    pub fn turned_lanes(&self, v: &Lane3) -> Lane3 {
        let [x, y, z] = &self.axes;
        core::array::from_fn(|i| x[i] * v[0] + y[i] * v[1] + z[i] * v[2])
    }

    /// `Rᵀ v`.
    #[inline(always)]
    pub fn turned_back(&self, v: &Lane3) -> Lane3 {
        self.axes.map(|axis| axis[0] * v[0] + axis[1] * v[1] + axis[2] * v[2])
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
    /// Joint positions, sines and cosines, [`LANES`] a joint.
    values: Vec<f64>,
    sines: Vec<f64>,
    cosines: Vec<f64>,
}

#[inline(always)]
fn lane_of(numbers: &[f64], joint: usize) -> Lane {
    let mut lane = Lane::ZERO;
    lane.0.copy_from_slice(&numbers[joint * LANES..(joint + 1) * LANES]);
    lane
}

#[inline(always)]
fn advance(step: &Step, parent: &LaneFrame, value: Lane, sine: Lane, cosine: Lane) -> LaneFrame {
    let f = &step.fixed;
    let rotated = || [parent.turned(&f.x), parent.turned(&f.y), parent.turned(&f.z)];
    let turned = |k: u8, [x, y, z]: [Lane3; 3]| match k {
        0 => [x, mix(&y, cosine, &z, sine), mix(&z, cosine, &y, -sine)],
        1 => [mix(&x, cosine, &z, -sine), y, mix(&z, cosine, &x, sine)],
        _ => [mix(&x, cosine, &y, sine), mix(&y, cosine, &x, -sine), z],
    };
    let origin = parent.mapped(&f.origin);
    match step.motion {
        Motion::Shift => LaneFrame { axes: parent.axes, origin },
        Motion::Still => LaneFrame { axes: rotated(), origin },
        Motion::TurnPlain(k) => LaneFrame { axes: turned(k, parent.axes), origin },
        Motion::TurnAligned(k) => LaneFrame { axes: turned(k, rotated()), origin },
        Motion::Turn => {
            let column = |a: &[f64; 4], f: &[f64; 4], s: &[f64; 4]| {
                let local = core::array::from_fn(|i| cosine * (f[i] - a[i]) + sine * s[i] + a[i]);
                parent.turned_lanes(&local)
            };
            let (a, s) = (&step.along, &step.across);
            let axes = [column(&a.x, &f.x, &s.x), column(&a.y, &f.y, &s.y), column(&a.z, &f.z, &s.z)];
            LaneFrame { axes, origin }
        }
        Motion::Slide => {
            let along = parent.turned(&step.slide).map(|x| x * value);
            LaneFrame { axes: rotated(), origin: sum(&origin, &along) }
        }
    }
}

impl Robot {
    pub(super) fn new_lane_poses(&self) -> LanePoses {
        let numbers = || vec![0.0; self.joints.len() * LANES];
        LanePoses {
            frames: vec![LaneFrame::IDENTITY; self.links.len()],
            values: numbers(),
            sines: numbers(),
            cosines: numbers(),
        }
    }

    /// Forward kinematics of up to [`LANES`] postures, rows of `q`; lanes beyond the rows repeat the last one.
    #[inline(always)]
    pub(super) fn advance_lanes(&self, q: &[f64], poses: &mut LanePoses) {
        let width = self.position_count();
        let rows = q.len().checked_div(width).unwrap_or(1).clamp(1, LANES);
        let LanePoses { frames, values, sines, cosines } = poses;
        for (value, step) in values.chunks_exact_mut(LANES).zip(&self.steps) {
            for (lane, value) in value.iter_mut().enumerate() {
                let row = lane.min(rows - 1) * width;
                *value =
                    if width == 0 { 0.0 } else { step.multiplier * q[row + step.position] + step.offset };
            }
        }
        sines_cosines(values, sines, cosines);
        for (j, step) in self.steps.iter().enumerate() {
            let (value, sine, cosine) = (lane_of(values, j), lane_of(sines, j), lane_of(cosines, j));
            let (done, rest) = frames.split_at_mut(j + 1);
            rest[0] = advance(step, &done[step.parent_link], value, sine, cosine);
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
