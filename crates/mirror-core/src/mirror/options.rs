//! Options that all estimators of this module share.

use super::loss::Loss;
use crate::error::{Result, positive};
use crate::least_squares::Stop;

/// Gauss–Newton from the closed forms takes 2 to 5 steps; an ambiguous pose seen from far may take 20.
const MOST_STEPS: usize = 60;
/// A step with a predicted reduction of the sum of squares below this (px²) is the last one. With noise of 0.2 px
/// it moves the result by 2e-4 of its standard deviation, and Gauss–Newton leaves a thousandth of that.
const SMALLEST_DECREASE_PX2: f64 = 1e-9;

/// How an estimator weighs its corners and when it stops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimatorOptions {
    /// Standard deviation of a corner along one axis, px. `None`: estimated from the residual, degrees of freedom
    /// counted (robust losses: from its median).
    pub noise_px: Option<f64>,
    /// The loss of a corner's residual.
    pub loss: Loss,
    /// Iterations after which [`crate::Error::NotConverged`] is returned.
    pub most_steps: usize,
    /// A step that promises to lower the sum of squares by less than this is the last one, px².
    pub smallest_decrease_px2: f64,
}

impl Default for EstimatorOptions {
    fn default() -> Self {
        Self {
            noise_px: None,
            loss: Loss::Squared,
            most_steps: MOST_STEPS,
            smallest_decrease_px2: SMALLEST_DECREASE_PX2,
        }
    }
}

impl EstimatorOptions {
    /// The options themselves, checked.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a noise, threshold or stopping rule that is not above zero.
    pub fn validated(self) -> Result<Self> {
        if let Some(noise) = self.noise_px {
            positive("noise of a corner (px)", noise)?;
        }
        positive("smallest decrease (px²)", self.smallest_decrease_px2)?;
        self.loss.validated()?;
        Ok(self)
    }

    pub(crate) fn stop(&self) -> Stop {
        Stop { steps: self.most_steps, decrease: self.smallest_decrease_px2, share: 0.0 }
    }
}
