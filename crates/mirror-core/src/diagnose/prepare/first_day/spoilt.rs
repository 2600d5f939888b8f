//! Joints with a spoilt column: what is known of them.

use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::{Atom, Column, Weight};
use crate::diagnose::model::problem::Problem;

/// A joint whose position is unknown in some postures.
#[derive(Debug, Clone)]
pub(crate) struct Lost {
    pub node: NodeId,
    /// Rows of each such posture, and the joint's position less the column's, rad or m.
    pub postures: Vec<(Vec<usize>, f64)>,
    /// Spread of these errors.
    pub spread: f64,
}

/// A joint that has another zero from a row on.
#[derive(Debug, Clone)]
pub(crate) struct Step {
    pub node: NodeId,
    /// Number of the first such row in the session.
    pub first_frame: i64,
    /// Offset of the joint from its column from there on, rad or m.
    pub offset: f64,
}

/// The node that a joint moves.
pub(super) fn node_of(problem: &Problem, joint: usize) -> Option<NodeId> {
    problem.scene.body.nodes.iter().position(|n| n.command.0 == joint && n.command.1 != 0.0)
}

/// The error of a joint in one posture.
pub(crate) fn column(problem: &Problem, node: NodeId, frames: &[usize]) -> Column {
    let mut weights = vec![0.0; problem.frames.len()];
    frames.iter().for_each(|&f| weights[f] = 1.0);
    Column { atom: Atom::Joint(node), weight: Weight::Frames(weights) }
}
