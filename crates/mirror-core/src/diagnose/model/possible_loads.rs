//! How much gravity could load each joint and link, whatever its direction: what a load is compared with that may be none.
//!
//! A vertical axis bears no torque. Written with four digits (`rpy="1.571 0 0"`) it is tilted by 0.2 mrad, and bears a
//! share of 2·10⁻⁴: a spring there would need thousands of rad/(N m) to be seen, and its law, a sine of the position, is
//! then what other effects have. No spring gives way so much.

use crate::diagnose::model::body::Body;
use crate::diagnose::model::deformation::Deformation;
use crate::diagnose::model::kinematics::{BeamLoad, Loads, NodePoses, loads};
use crate::diagnose::principles::{Prior, Size};
use nalgebra::Vector3;

/// A load that is a smaller share of the possible one is none: as much as an axis loads its joint that stands
/// askew by half a degree.
pub(crate) const LEAST_BORNE: Prior = 0.01;
/// Frames whose postures are tried, spread over the session.
const TRIED: Size = 64;

/// The largest load of a node over the postures, with gravity along the worst direction.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct PossibleLoad {
    /// On its joint, N m (N of a sliding one).
    pub torque: f64,
    /// On its link, N m.
    pub moment: f64,
}

/// Loads are linear in gravity, `τ = v·g` and `m = M g`: the largest torque is `|v||g|`, from the torques with gravity
/// along each axis; of the moment the Frobenius norm `|M||g|` is told, at most √2 times its largest.
///
/// `commanded` are the nodes' positions, `[frame][node]`, `gravity` its absolute value, m/s².
pub(crate) fn possible_loads(body: &Body, commanded: &[f64], gravity: f64) -> Vec<PossibleLoad> {
    let nodes = body.nodes.len();
    if nodes == 0 {
        return Vec::new();
    }
    let nominal = Deformation::nominal(1, nodes, 0);
    let mut poses = NodePoses::new(nodes);
    let mut possible = vec![PossibleLoad::default(); nodes];
    let (mut torque, mut moment) = (vec![0.0; nodes], vec![Vector3::zeros(); nodes]);
    let mut beam = vec![BeamLoad::default(); nodes];
    let frames = commanded.len() / nodes;
    for posture in commanded.chunks_exact(nodes).step_by(frames.div_ceil(TRIED).max(1)) {
        poses.update(body, posture, &nominal, 0);
        let mut squares = vec![PossibleLoad::default(); nodes];
        for k in 0..3 {
            let gravity = Vector3::ith(k, gravity);
            let of_nodes = Loads { torque: &mut torque, moment: &mut moment, beam: &mut beam };
            loads(body, &poses, &gravity, of_nodes);
            for (square, (torque, moment)) in squares.iter_mut().zip(torque.iter().zip(&moment)) {
                square.torque += torque * torque;
                square.moment += moment.norm_squared();
            }
        }
        for (largest, square) in possible.iter_mut().zip(&squares) {
            largest.torque = largest.torque.max(square.torque.sqrt());
            largest.moment = largest.moment.max(square.moment.sqrt());
        }
    }
    possible
}
