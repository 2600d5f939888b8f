//! Upper bound of a marker's true distance from its target, given the measurement.

use crate::statistics::{normal_quantile, reduced_chi_squared_at};
use nalgebra::{Matrix3, Vector3};

/// Bounds on the true distance of a marker from its target, m.
///
/// With the measured error e and its covariance Σ the true one is N(e, Σ), and q = ‖true error‖² has mean `m = ‖e‖² + tr Σ` and
/// variance `v = 2 tr Σ² + 4 eᵀ Σ e`. Its quantiles are those of a scaled chi-squared of `k = 2 m²/v` degrees of freedom
/// (Satterthwaite).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DistanceBounds {
    mean_m2: f64,
    degrees_of_freedom: f64,
}

impl DistanceBounds {
    /// Of a measured error (m) and its covariance (m²).
    pub fn new(error_m: &Vector3<f64>, covariance_m2: &Matrix3<f64>) -> Self {
        let mean = error_m.norm_squared() + covariance_m2.trace();
        let variance = 2.0 * covariance_m2.norm_squared() + 4.0 * error_m.dot(&(covariance_m2 * error_m));
        let degrees_of_freedom = if variance > 0.0 { 2.0 * mean * mean / variance } else { f64::INFINITY };
        Self { mean_m2: mean, degrees_of_freedom }
    }

    /// The distance that is exceeded with probability `1 − Φ(z)`, m; z may be negative.
    pub fn at(&self, z: f64) -> f64 {
        if self.mean_m2 <= 0.0 {
            return 0.0;
        }
        (self.mean_m2 * reduced_chi_squared_at(z, self.degrees_of_freedom)).sqrt()
    }
}

/// The deviate for a look so that all looks and markers together err with probability `whole` at most.
///
/// Look k (from 1) uses `whole / (k (k + 1))`, whose sum over all k is `whole`; the markers share it (Bonferroni).
pub(super) fn deviate_of_look(whole: f64, look: usize, markers: usize) -> f64 {
    let k = look as f64;
    -normal_quantile(whole / (k * (k + 1.0)) / markers as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_looks_together_spend_no_more_than_the_whole() {
        let spent: f64 = (1..10_000).map(|k| 1e-3 / (k as f64 * (k as f64 + 1.0))).sum();
        assert!(spent <= 1e-3);
        assert!(deviate_of_look(1e-3, 5, 2) > deviate_of_look(1e-3, 1, 2));
        // The markers share the probability of a look.
        let of_one = |markers: usize| normal_quantile(1.0 - 1e-3 / 2.0 / markers as f64);
        for markers in [1, 2, 7] {
            assert!((deviate_of_look(1e-3, 1, markers) - of_one(markers)).abs() < 1e-9, "{markers}");
        }
    }
}
