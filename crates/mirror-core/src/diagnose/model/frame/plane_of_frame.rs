//! The mirror of a frame by all that the frame shows, its board condensed.

use super::work::{FrameWork, Task};
use crate::diagnose::model::problem::{BoardFit, FrameData, Problem};
use crate::diagnose::model::solver::SOLVER;
use nalgebra::{Matrix3, Vector3};

impl FrameWork {
    /// Moves the plane from the board's optimum to the optimum of the whole frame, with the weights of the present residuals:
    /// Gauss–Newton until the next step would gain next to nothing. Returns the gain of a step that is not taken.
    pub(super) fn settle_plane(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        data: &FrameData,
        board: &BoardFit,
    ) -> f64 {
        let information = board.information / task.noise.corner_px.powi(2);
        self.foot = board.foot;
        let mut taken = 0;
        loop {
            let (mut g, mut rhs) = self.pull_of_others(problem, task, data);
            g += information;
            rhs += information * (board.foot - self.foot);
            let Some(factor) = g.cholesky() else { return 0.0 };
            let step = factor.solve(&rhs);
            let gain = step.dot(&rhs);
            if gain < SOLVER.last_plane_gain {
                return gain;
            }
            if taken >= SOLVER.plane_steps {
                return 0.0;
            }
            self.foot += step;
            taken += 1;
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
