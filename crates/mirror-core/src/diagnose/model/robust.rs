//! The likelihood of one observation: a mixture of the noise and, with a small probability, an arbitrary value.

use crate::diagnose::principles::Prior;

/// How many observations in a hundred are expected to be false.
pub(crate) const OUTLIER_FRACTION: Prior = 0.01;

/// A mixture `(1 − ε) N(r; 0, σ² I) + ε / A`: a Gaussian for the good observations, uniform over the area (or
/// volume) A for the false ones. Good observations keep their exact Gaussian weight, so that claimed covariances
/// stay right; false ones have almost no weight.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Mixture {
    /// `ε / (1 − ε) · (2 π σ²)^{k/2} / A`.
    odds: f64,
}

/// Cost (−2 log likelihood, 0 at a perfect fit) and weight (probability of being good) of an observation.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Robust {
    pub cost: f64,
    pub weight: f64,
}

impl Robust {
    /// Plain least squares: every observation is good.
    #[inline]
    pub fn gaussian(squared: f64) -> Self {
        Self { cost: squared, weight: 1.0 }
    }
}

impl Mixture {
    /// `std` in the unit whose `size` (an area or a volume of `dimensions`) the false observations fill.
    pub fn new(std: f64, dimensions: i32, size: f64) -> Self {
        let peak = (2.0 * core::f64::consts::PI).sqrt() * std;
        Self { odds: OUTLIER_FRACTION / (1.0 - OUTLIER_FRACTION) * peak.powi(dimensions) / size }
    }

    /// Of a squared whitened residual.
    #[inline]
    pub fn of(&self, squared: f64) -> Robust {
        let (likelihood, weight) = self.likelihood(squared);
        Robust { cost: -2.0 * likelihood.ln(), weight }
    }

    /// The likelihood of a squared whitened residual, 1 at a perfect fit, and its weight.
    #[inline]
    pub fn likelihood(&self, squared: f64) -> (f64, f64) {
        let good = (-0.5 * squared).exp();
        let sum = good + self.odds;
        (sum / (1.0 + self.odds), good / sum)
    }
}
