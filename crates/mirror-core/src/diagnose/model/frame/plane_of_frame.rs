//! The mirror of a frame by all that the frame shows, its board condensed.
//!
//! At the board's own optimum markers that are right look false where the board is small or seen obliquely: they would have no weight,
//! and would never correct the plane. With C the plane's covariance by the board alone and D a marker's rows, all whitened, a residual r
//! has the covariance `S = I + D C Dᵀ` there, and the marker is good with the probability that the mixture gives `rᵀ S⁻¹ r`. Where
//! that gives back the weight of a marker, the plane is settled from these weights too, and the more probable of the two is kept.

use super::observe::pixel_mixture;
use super::work::{FrameWork, Task};
use crate::diagnose::model::problem::{BoardFit, FrameData, Problem};
use crate::diagnose::model::robust::{Mixture, Robust};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::MAJORITY;
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};

/// How well the plane is known where residuals are weighed: as it is, or by its board alone, with this covariance (m²).
pub(super) type PlaneKnown = Option<Matrix3<f64>>;

/// What the markers of a frame make of its plane.
pub(super) struct Pull {
    /// `Σ w DᵀD` and `Σ w Dᵀr`.
    pub information: Matrix3<f64>,
    pub gradient: Vector3<f64>,
    /// −2 log likelihood, how many they are, and how many of them count.
    cost: f64,
    count: f64,
    counted: f64,
}

impl Pull {
    pub fn zero() -> Self {
        Self {
            information: Matrix3::zeros(),
            gradient: Vector3::zeros(),
            cost: 0.0,
            count: 0.0,
            counted: 0.0,
        }
    }

    /// Adds a marker, by its whitened rows and residual; without a mixture it is good.
    pub fn add(
        &mut self,
        mixture: Option<&Mixture>,
        known: &PlaneKnown,
        by_foot: &Matrix2x3<f64>,
        residual: &Vector2<f64>,
    ) {
        let unknown = known.and_then(|covariance| {
            let spread = Matrix2::identity() + by_foot * covariance * by_foot.transpose();
            Some(residual.dot(&spread.cholesky()?.solve(residual)))
        });
        let squared = unknown.unwrap_or_else(|| residual.norm_squared());
        let Robust { cost, weight } =
            mixture.map_or_else(|| Robust::gaussian(squared), |mixture| mixture.of(squared));
        self.information += by_foot.tr_mul(by_foot) * weight;
        self.gradient += by_foot.tr_mul(residual) * weight;
        self.cost += cost;
        self.count += 1.0;
        self.counted += weight;
    }
}

impl FrameWork {
    /// Moves the plane from the board's optimum to the optimum of the whole frame.
    pub(super) fn settle_plane(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        data: &FrameData,
        board: &BoardFit,
    ) {
        let start = self.foot;
        let information = board.information / task.noise.corner_px.powi(2);
        let own = self.pull_of_others(problem, task, data, &None);
        let doubted = own.counted < own.count - MAJORITY;
        let counted = own.counted;
        self.settle_from(own, problem, task, data, (&information, &board.foot));
        let Some(covariance) = information.try_inverse().filter(|_| doubted) else { return };
        let settled = self.foot;
        self.foot = start;
        let beside = self.pull_of_others(problem, task, data, &Some(covariance));
        if beside.counted <= counted + MAJORITY {
            self.foot = settled;
            return;
        }
        self.settle_from(beside, problem, task, data, (&information, &board.foot));
        let cost = |work: &mut Self| {
            let away = work.foot - board.foot;
            work.pull_of_others(problem, task, data, &None).cost + away.dot(&(information * away))
        };
        let other = cost(self);
        let foot = core::mem::replace(&mut self.foot, settled);
        if other < cost(self) {
            self.foot = foot;
        }
    }

    /// Gauss–Newton from a first pull, then with the weights of the present residuals; the board's part of the cost is a square.
    fn settle_from(
        &mut self,
        first: Pull,
        problem: &Problem,
        task: &Task<'_>,
        data: &FrameData,
        (information, best): (&Matrix3<f64>, &Vector3<f64>),
    ) {
        let mut pull = first;
        for left in (0..SOLVER.plane_steps).rev() {
            let rhs = pull.gradient + information * (best - self.foot);
            let Some(factor) = (information + pull.information).cholesky() else { break };
            let step = factor.solve(&rhs);
            self.foot += step;
            if left == 0 || rhs.dot(&step) < SOLVER.plane_gain {
                break;
            }
            pull = self.pull_of_others(problem, task, data, &None);
        }
    }

    /// Information on the plane from everything except the board.
    fn pull_of_others(
        &mut self,
        problem: &Problem,
        task: &Task<'_>,
        data: &FrameData,
        known: &PlaneKnown,
    ) -> Pull {
        if let Some(pull) = self.pull_of_markers(problem, task, data, known) {
            return pull;
        }
        self.rows.clear();
        let mixture = task.eye.filter(|_| !task.gaussian).map(|eye| pixel_mixture(eye, task.noise.marker_px));
        self.observe(problem, &Task { gaussian: true, ..*task }, data, false);
        let mut pull = Pull::zero();
        // Measured points, of three rows, do not depend on the plane.
        for row in self.rows.iter().filter(|row| row.count == 2) {
            let by_foot = row.plane.fixed_rows::<2>(0).into_owned();
            pull.add(mixture.as_ref(), known, &by_foot, &row.residual.xy());
        }
        pull
    }
}
