//! The curvature that Gauss–Newton leaves out, learned from the last step.
//!
//! Gauss–Newton takes `H = XᵀX` for the curvature and leaves out `Σ r ∂²f`. Where a session has a large unmodelled
//! error (a slip, a spoilt column) the residuals r are systematic, and this part may be as large as H along one
//! direction: each step is then too long by a half, and steps alternate. With the last step s and the change y of the
//! gradient along it, the symmetric rank-one update `H + u uᵀ/(uᵀs)`, `u = y − H s`, has the curvature seen along s.
//!
//! Source: Dennis, Gay and Welsch, "An adaptive nonlinear least-squares algorithm" (1981); the rank-one update,
//! Nocedal and Wright, "Numerical Optimization" (2006), section 6.2.

use crate::diagnose::likelihood::normal_equations::Normal;
use crate::diagnose::principles::Guard;
use nalgebra::{DMatrix, DVector};

/// By this share of Gauss–Newton's curvature the one along the step must be larger to be worth a correction.
const WORTH_CORRECTING: Guard = 0.1;

/// A step and how the gradient of the data changed along it.
pub(super) struct Secant {
    step: DVector<f64>,
    change: DVector<f64>,
}

impl Secant {
    /// From two linearisations that differ by a step.
    pub fn between(before: &Normal, after: &Normal, step: &[f64]) -> Self {
        Self { step: DVector::from_column_slice(step), change: &before.g - &after.g }
    }

    /// The vector w of the update `H + w wᵀ`; none where the curvature along the step is hardly larger than
    /// Gauss–Newton's: a smaller one is that of observations that lose their weight, and does not last.
    pub fn correction(&self, h: &DMatrix<f64>) -> Option<DVector<f64>> {
        if h.nrows() != self.step.len() {
            return None;
        }
        let along = h * &self.step;
        let usual = along.dot(&self.step);
        let left_out = self.change.dot(&self.step) - usual;
        // Written so that NaN is no correction.
        (left_out > WORTH_CORRECTING * usual).then(|| (&self.change - along) / left_out.sqrt())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::diagnose::likelihood::normal_equations::Planes;

    fn normal(h: &DMatrix<f64>, g: DVector<f64>) -> Normal {
        Normal { h: h.clone(), g, cost: 0.0, planes: Planes::default() }
    }

    #[test]
    fn a_step_shows_the_curvature_that_was_left_out() {
        let h = DMatrix::from_row_slice(2, 2, &[4.0, 1.0, 1.0, 3.0]);
        let left_out = DVector::from_vec(vec![1.5, -0.5]);
        let all = &h + &left_out * left_out.transpose();
        let step = [0.2, 0.1];
        let g = DVector::from_vec(vec![1.0, -2.0]);
        let after = &g - &all * DVector::from_column_slice(&step);
        let secant = Secant::between(&normal(&h, g.clone()), &normal(&h, after), &step);
        let w = secant.correction(&h).unwrap();
        assert!((&h + &w * w.transpose() - &all).norm() < 1e-12);
        // Nothing is corrected where Gauss–Newton is right, and where the curvature is smaller.
        let after = &g - &h * DVector::from_column_slice(&step);
        assert!(Secant::between(&normal(&h, g.clone()), &normal(&h, after), &step).correction(&h).is_none());
        let after = &g + &h * DVector::from_column_slice(&step);
        assert!(Secant::between(&normal(&h, g.clone()), &normal(&h, after), &step).correction(&h).is_none());
    }
}
