//! How far the positions of a robot may go.

use crate::robot::Robot;

/// The range of each position, rad (m): that of its own joint and of all that follow it.
pub(super) fn position_limits(robot: &Robot) -> Vec<(f64, f64)> {
    let mut limits = vec![(f64::NEG_INFINITY, f64::INFINITY); robot.position_count()];
    for joint in robot.joints() {
        let (Some(drive), Some(own)) = (joint.drive, joint.limits) else { continue };
        if drive.multiplier == 0.0 {
            continue;
        }
        let ends = [own.lower, own.upper].map(|end| (end - drive.offset) / drive.multiplier);
        let (lower, upper) = &mut limits[drive.position];
        *lower = lower.max(ends[0].min(ends[1]));
        *upper = upper.min(ends[0].max(ends[1]));
    }
    limits
}
