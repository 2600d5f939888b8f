//! The mirror of a frame by all that the frame shows, its board condensed.

use super::work::{FrameWork, Task};
use crate::diagnose::model::problem::{BoardFit, FrameData, Problem};
use crate::diagnose::model::solver::SOLVER;
use nalgebra::{Matrix3, Vector3};

impl FrameWork {
    /// Moves the plane from the board's optimum to the optimum of the whole frame by Gauss–Newton, with the weights of the
    /// present residuals.
    pub(super) fn settle_plane(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        data: &FrameData,
        board: &BoardFit,
    ) {
        let information = board.information / task.noise.corner_px.powi(2);
        for _ in 0..SOLVER.plane_steps {
            let (of_others, rhs) = self.pull_of_others(problem, task, data);
            let rhs = rhs + information * (board.foot - self.foot);
            let Some(factor) = (information + of_others).cholesky() else { break };
            let step = factor.solve(&rhs);
            self.foot += step;
            if rhs.dot(&step) < SOLVER.plane_gain {
                break;
            }
        }
    }

    /// Information on the plane from everything except the board, `Σ DᵀD` and `Σ Dᵀr`.
    fn pull_of_others(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        data: &FrameData,
    ) -> (Matrix3<f64>, Vector3<f64>) {
        if let Some(pull) = self.pull_of_markers(problem, task, data) {
            return pull;
        }
        self.rows.clear();
        self.observe(problem, task, data, false);
        let rows = || self.rows.iter();
        (rows().map(|r| r.plane.tr_mul(&r.plane)).sum(), rows().map(|r| r.plane.tr_mul(&r.residual)).sum())
    }
}
