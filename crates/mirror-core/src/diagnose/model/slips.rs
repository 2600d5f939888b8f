//! Slips during a session: from a row on a marker, the board or the camera has another pose.

use crate::diagnose::model::pose::{Pose, exp};
use nalgebra::{Rotation3, Vector3, Vector6};

/// What can slip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Slipped {
    Marker(usize),
    /// The board against camera and robot.
    Board,
    /// The camera against board and robot.
    Camera,
}

impl Slipped {
    /// Its first entry in a motion (rotation vector, shift): of a marker only the shift is seen.
    pub fn first_number(self) -> usize {
        if matches!(self, Self::Marker(_)) { 3 } else { 0 }
    }
}

/// A slip: real = nominal ∘ (Exp ω, v) from frame `first` on. For a marker v is in the frame of its mount's link,
/// without ω.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Slip {
    pub what: Slipped,
    pub first: usize,
    /// Rotation vector and shift, rad and m.
    pub motion: Vector6<f64>,
}

/// A motion as a pose.
pub(crate) fn pose_of(motion: &Vector6<f64>) -> Pose {
    let part = |first: usize| -> Vector3<f64> { motion.fixed_rows::<3>(first).into_owned() };
    Pose { r: exp(&part(0)), t: part(3) }
}

/// The motion that follows `before` where both together are `both`: `before⁻¹ ∘ both`.
pub(crate) fn following(before: &Vector6<f64>, both: &Vector6<f64>) -> Vector6<f64> {
    let then = pose_of(before).inverse().then(&pose_of(both));
    let omega = Rotation3::from_matrix_unchecked(then.r).scaled_axis();
    Vector6::new(omega.x, omega.y, omega.z, then.t.x, then.t.y, then.t.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_follows_leads_from_one_pose_to_the_other() {
        let (before, both) =
            (Vector6::new(0.2, -0.1, 0.3, 0.01, 0.02, -0.03), Vector6::new(0.0, 0.1, -0.2, 0.02, 0.0, 0.01));
        let reached = pose_of(&before).then(&pose_of(&following(&before, &both)));
        assert!(
            (reached.r - pose_of(&both).r).norm() < 1e-12 && (reached.t - pose_of(&both).t).norm() < 1e-12
        );
        // Back where it was.
        let back = pose_of(&before).then(&pose_of(&following(&before, &Vector6::zeros())));
        assert!((back.r - nalgebra::Matrix3::identity()).norm() < 1e-12 && back.t.norm() < 1e-12);
    }
}
