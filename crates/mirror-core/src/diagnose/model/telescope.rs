//! Telescopic columns: two or more successive prismatic joints along one axis. (A single one is a carriage, whose
//! guide is the same wherever it stands.)
//!
//! Such a column is a beam whose length is its extension. The middle about which it bends moves with the extension,
//! and the overlap inside shrinks as it extends.

use crate::diagnose::model::pose::Pose;
use crate::diagnose::principles::Guard;
use nalgebra::Vector3;

/// How far two axes may point apart and still be one column's: the cosine's distance from 1.
const ALONG: Guard = 1e-6;

/// A run of sliding joints along one axis, ending with the node that has it; of a carriage that joint alone.
#[derive(Debug, Clone)]
pub(crate) struct Telescope {
    /// The nodes of its joints from the first to the last.
    pub joints: Vec<usize>,
    /// The direction in which each of them slides out: 1, or −1 where its limits let it farther to the negative side.
    outward: Vec<f64>,
    /// The farthest that their limits let them out together, m; infinite where a joint has none.
    pub farthest_m: f64,
    /// Their common unit axis in the last node's frame.
    axis: Vector3<f64>,
    /// From the first joint's origin to the last node's origin while nothing is extended, in the last node's frame, m.
    retracted: Vector3<f64>,
}

impl Telescope {
    /// The run that ends with the prismatic joint of node `id`; `inner` is that of the node that carries it.
    /// `range_m` are the joint's limits, infinite where it has none: at 0 it is taken as retracted, and slides out to
    /// the end that is farther from there.
    pub fn of(
        id: usize,
        inner: Option<&Self>,
        parent_from_joint: &Pose,
        axis: &Vector3<f64>,
        (lower_m, upper_m): (f64, f64),
    ) -> Self {
        let (outward, farthest_m) = if -lower_m > upper_m { (-1.0, -lower_m) } else { (1.0, upper_m) };
        let alone = Self {
            joints: vec![id],
            outward: vec![outward],
            farthest_m,
            axis: *axis,
            retracted: Vector3::zeros(),
        };
        let Some(inner) = inner else { return alone };
        let turned = parent_from_joint.r.tr_mul(&inner.axis);
        if turned.dot(axis) < 1.0 - ALONG {
            return alone;
        }
        let (mut joints, mut outwards) = (inner.joints.clone(), inner.outward.clone());
        joints.push(id);
        outwards.push(outward);
        let retracted = parent_from_joint.r.tr_mul(&(inner.retracted + parent_from_joint.t));
        Self { joints, outward: outwards, farthest_m: inner.farthest_m + farthest_m, axis: *axis, retracted }
    }

    /// Whether it is telescopic: at least two joints.
    pub fn is_column(&self) -> bool {
        self.joints.len() > 1
    }

    /// How far it is out, m: the sum of its joints' positions, `[node]`, each in the direction in which it slides out.
    pub fn extension(&self, positions: &[f64]) -> f64 {
        self.joints.iter().zip(&self.outward).map(|(&n, outward)| outward * positions[n]).sum()
    }

    /// How far its end is along its axis from where it is retracted, m: the sum of the positions.
    fn along(&self, positions: &[f64]) -> f64 {
        self.joints.iter().map(|&n| positions[n]).sum()
    }

    /// Where it begins, in the last node's frame, m.
    pub fn foot(&self, positions: &[f64]) -> Vector3<f64> {
        -(self.retracted + self.axis * self.along(positions))
    }
}
