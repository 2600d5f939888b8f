//! What a row is of, a target and its observer, and how elementary changes of the body move one against the other.

use super::rows::Rows;
use crate::diagnose::model::body::NodeId;
use crate::diagnose::model::elementary::{Atom, moves};
use crate::diagnose::model::problem::Problem;

/// The target of a row and its observer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Target {
    node: Option<NodeId>,
    observer: Option<NodeId>,
    marker: Option<usize>,
    measured: bool,
}

impl Target {
    pub fn of(row: &Rows) -> Self {
        Self { node: row.node, observer: row.observer, marker: row.marker, measured: row.measured }
    }

    /// The board before the camera; none in a frame without it.
    pub fn board(problem: &Problem, frame: usize) -> Option<Self> {
        let observer = problem.camera_site.and_then(|s| s.node);
        problem.board_in(frame).map(|board| Self {
            node: board.node,
            observer,
            marker: None,
            measured: false,
        })
    }

    /// How an elementary change with a twist moves the target against its observer: 1, −1 where it is the observer that
    /// moves; none where it moves neither or both. The joints that follow another one apart.
    pub fn sign(&self, problem: &Problem, atom: Atom) -> Option<f64> {
        let is_board = self.marker.is_none();
        let (target, observer) = match atom {
            // The board itself, and a camera on the same body.
            Atom::BoardMount(_) => (is_board, !self.measured && problem.camera_beside_board()),
            Atom::BoardSlip(_) => (is_board, false),
            Atom::MarkerShift(m, _) => (self.marker == Some(m), false),
            _ => (moves(atom, &problem.scene, self.node), moves(atom, &problem.scene, self.observer)),
        };
        (target != observer).then_some(if target { 1.0 } else { -1.0 })
    }
}
