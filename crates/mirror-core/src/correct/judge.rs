//! Tests of a correction that need only errors and their history: convergence, divergence, stagnation.

use super::bounds::{DistanceBounds, deviate_of_look};
use super::options::JudgeOptions;
use nalgebra::{Matrix3, Vector3};

/// The errors of all markers at one look that was accepted.
#[derive(Debug, Clone)]
pub(super) struct Errors {
    /// Target minus measured, m.
    pub error_m: Vec<Vector3<f64>>,
    pub covariance_m2: Vec<Matrix3<f64>>,
    /// The look's number, from 1.
    pub look: usize,
}

/// A growth or a gain is significant beyond this many standard deviations.
const SIGNIFICANT: f64 = 3.0;
/// An error whose chi-squared is below this deviate does not differ from zero.
const INDISTINCT: f64 = 2.0;

impl Errors {
    pub fn distances_m(&self) -> Vec<f64> {
        self.error_m.iter().map(Vector3::norm).collect()
    }

    /// Bounds that hold for all markers and looks together: below (`sign` +1) or above (−1) which each true distance lies, m.
    pub fn bounds_m(&self, whole: f64, sign: f64) -> Vec<f64> {
        let z = sign * deviate_of_look(whole, self.look, self.error_m.len());
        self.error_m.iter().zip(&self.covariance_m2).map(|(e, c)| DistanceBounds::new(e, c).at(z)).collect()
    }

    /// The upper bounds that an error of 0 would have been given with these covariances, m.
    pub fn bounds_at_zero_m(&self, whole: f64) -> Vec<f64> {
        let z = deviate_of_look(whole, self.look, self.error_m.len());
        self.covariance_m2.iter().map(|c| DistanceBounds::new(&Vector3::zeros(), c).at(z)).collect()
    }

    /// Root mean square distance, m.
    pub fn rms_m(&self) -> f64 {
        rms(&self.error_m)
    }

    /// Standard deviation of [`Self::rms_m`], to first order; for an error near zero that of one axis.
    pub fn rms_std_m(&self) -> f64 {
        let markers = self.error_m.len() as f64;
        let trace: f64 = self.covariance_m2.iter().map(Matrix3::trace).sum::<f64>() / (3.0 * markers);
        let along: f64 =
            self.error_m.iter().zip(&self.covariance_m2).map(|(e, c)| e.dot(&(c * e))).sum::<f64>();
        let square: f64 = self.error_m.iter().map(Vector3::norm_squared).sum();
        if square > 0.0 { (along / (square * markers)).sqrt() } else { trace.sqrt() }
    }

    /// Whether the errors are no more than the measurement's noise.
    pub fn indistinct(&self) -> bool {
        let mut sum = 0.0;
        for (e, c) in self.error_m.iter().zip(&self.covariance_m2) {
            let Some(weight) = c.try_inverse() else { return false };
            sum += e.dot(&(weight * e));
        }
        crate::statistics::chi_squared_deviate(sum, 3.0 * self.error_m.len() as f64) < INDISTINCT
    }
}

/// Root mean square length, m.
pub(super) fn rms(errors: &[Vector3<f64>]) -> f64 {
    (errors.iter().map(Vector3::norm_squared).sum::<f64>() / errors.len().max(1) as f64).sqrt()
}

/// Whether the error is significantly above the best one by the factor that counts as diverging.
pub(super) fn grew(now: &Errors, best_m: f64, options: &JudgeOptions) -> bool {
    let error = now.rms_m();
    error - SIGNIFICANT * now.rms_std_m() > options.divergence * best_m && error > options.tolerance_m
}

/// Whether the last `patience` looks reduced the error too little.
pub(super) fn stalled(history_m: &[f64], options: &JudgeOptions) -> bool {
    let Some(before) = history_m.len().checked_sub(options.patience).filter(|&n| n > 0) else { return false };
    let best = |looks: &[f64]| looks.iter().copied().fold(f64::INFINITY, f64::min);
    best(&history_m[before..]) > (1.0 - options.least_progress) * best(&history_m[..before])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn the_deviation_of_an_error_over_all_markers_is_that_of_its_draws() {
        let truth = [Vector3::new(4e-3, 0.0, 1e-3), Vector3::new(0.0, -3e-3, 2e-3)];
        let std = [Vector3::new(2e-4, 1e-4, 6e-4), Vector3::new(1e-4, 3e-4, 5e-4)];
        let covariance_m2: Vec<_> = std.iter().map(|s| Matrix3::from_diagonal(&s.component_mul(s))).collect();
        let errors =
            |error_m: Vec<Vector3<f64>>| Errors { error_m, covariance_m2: covariance_m2.clone(), look: 1 };
        let mut random = Random::new(11);
        let drawn: Vec<f64> = (0..4000)
            .map(|_| {
                let noise = std.map(|s| s.map(|x| x * random.normal()));
                errors(truth.iter().zip(&noise).map(|(t, n)| t + n).collect()).rms_m()
            })
            .collect();
        let mean = drawn.iter().sum::<f64>() / 4000.0;
        let spread = (drawn.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / 4000.0).sqrt();
        let claimed = errors(truth.to_vec()).rms_std_m();
        assert!((claimed / spread - 1.0).abs() < 0.06, "{claimed} {spread}");
    }

    #[test]
    fn errors_of_zero_have_the_deviation_of_one_axis_however_many_markers_there_are() {
        for markers in [1, 2, 5] {
            let covariance = Matrix3::from_diagonal(&Vector3::new(1e-8, 4e-8, 7e-8));
            let errors = Errors {
                error_m: vec![Vector3::zeros(); markers],
                covariance_m2: vec![covariance; markers],
                look: 1,
            };
            assert!((errors.rms_std_m() - 2e-4).abs() < 1e-12, "{markers}: {}", errors.rms_std_m());
        }
    }

    #[test]
    fn an_error_grew_only_beyond_the_best_one_the_tolerance_and_its_noise() {
        let options = JudgeOptions { tolerance_m: 1e-3, divergence: 1.5, ..JudgeOptions::default() };
        let of = |error_m: f64, std_m: f64| Errors {
            error_m: vec![Vector3::new(error_m, 0.0, 0.0)],
            covariance_m2: vec![Matrix3::identity() * std_m * std_m],
            look: 3,
        };
        assert!(grew(&of(3.2e-3, 1e-5), 2e-3, &options));
        assert!(!grew(&of(2.8e-3, 1e-5), 2e-3, &options), "less than half as large again");
        assert!(!grew(&of(0.9e-3, 1e-5), 1e-4, &options), "within the tolerance");
        assert!(!grew(&of(3.2e-3, 1e-3), 2e-3, &options), "by chance");
    }

    #[test]
    fn a_correction_stalls_where_the_last_looks_bring_less_than_asked() {
        let options = JudgeOptions { patience: 3, least_progress: 0.1, ..JudgeOptions::default() };
        assert!(stalled(&[5.0, 2.0, 1.9, 2.5, 1.85], &options));
        assert!(!stalled(&[5.0, 2.0, 1.9, 2.5, 1.75], &options), "an eighth less than the best before");
        assert!(!stalled(&[2.0, 2.0, 2.0], &options), "too few looks to say so");
    }
}
