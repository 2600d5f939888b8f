//! Whether a reading of a marker is plausible after what was commanded; an implausible one is not acted upon.

use super::options::JudgeOptions;
use crate::statistics::chi_squared_deviate;
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;

/// Beyond this many standard deviations noise is no explanation: once in 300,000 readings.
const IMPLAUSIBLE_DEVIATE: f64 = 4.5;

/// A rejected reading, with its evidence.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Implausible {
    /// The marker's name.
    pub marker: String,
    /// What is wrong with it.
    pub surprise: Surprise,
}

/// What is wrong with a reading.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Surprise {
    /// The rays of the views do not meet: something moved between the views, or one of them shows another thing.
    RaysDoNotMeet {
        /// Sum of squared normalised residuals.
        chi_squared: f64,
        /// Its degrees of freedom.
        degrees_of_freedom: usize,
    },
    /// Farther from where the model has the marker than any body can be wrong.
    FarFromModel {
        /// Distance, m.
        distance_m: f64,
        /// The largest distance that is accepted, noise included, m.
        allowed_m: f64,
    },
    /// Farther from where the last step should have put it than noise, that whole step and play together explain.
    Jump {
        /// Distance from where it was expected, m.
        distance_m: f64,
        /// The largest distance that is accepted, m.
        allowed_m: f64,
        /// How far the step was to move it, joint by joint, m.
        commanded_m: f64,
    },
}

/// The prior knowledge of a marker before its reading.
pub(super) struct Expected {
    /// Where it should be, m.
    pub point_m: Vector3<f64>,
    /// Covariance of the earlier reading on which the prediction depends, m²; none at the first look.
    pub covariance_m2: Option<Matrix3<f64>>,
    /// The ways that all joints were to move it since, added up, m.
    pub commanded_m: f64,
}

/// The reason to reject a reading; none if it is accepted.
pub(super) fn surprise(
    point_m: &Vector3<f64>,
    covariance_m2: &Matrix3<f64>,
    chi_squared: f64,
    degrees_of_freedom: usize,
    expected: &Expected,
    options: &JudgeOptions,
) -> Option<Surprise> {
    if degrees_of_freedom > 0
        && chi_squared_deviate(chi_squared, degrees_of_freedom as f64) > IMPLAUSIBLE_DEVIATE
    {
        return Some(Surprise::RaysDoNotMeet { chi_squared, degrees_of_freedom });
    }
    let difference = point_m - expected.point_m;
    let distance_m = difference.norm();
    let covariance = covariance_m2 + expected.covariance_m2.unwrap_or_default();
    // The deviation along the way that it seems to have jumped.
    let along = if distance_m > 0.0 {
        (difference.dot(&(covariance * difference))).max(0.0).sqrt() / distance_m
    } else {
        0.0
    };
    let noise_m = IMPLAUSIBLE_DEVIATE * along;
    let commanded_m = expected.commanded_m;
    if expected.covariance_m2.is_some() {
        let allowed_m = noise_m + commanded_m + options.play_m;
        (distance_m > allowed_m).then_some(Surprise::Jump { distance_m, allowed_m, commanded_m })
    } else {
        let allowed_m = noise_m + options.largest_gap_m;
        (distance_m > allowed_m).then_some(Surprise::FarFromModel { distance_m, allowed_m })
    }
}

#[cfg(test)]
#[allow(clippy::panic)]
mod tests {
    use super::*;

    #[test]
    fn at_the_first_look_a_marker_may_be_off_by_the_largest_gap_and_its_noise() {
        let options = JudgeOptions { largest_gap_m: 0.05, play_m: 0.004, ..JudgeOptions::default() };
        let first = Expected { point_m: Vector3::new(0.1, 0.2, 0.3), covariance_m2: None, commanded_m: 1.0 };
        let at = |off_m: f64, std_m: f64| {
            let point_m = first.point_m + Vector3::new(0.0, off_m, 0.0);
            // Only the noise along the way counts.
            let covariance_m2 = Matrix3::from_diagonal(&Vector3::new(1.0, std_m * std_m, 1.0));
            surprise(&point_m, &covariance_m2, 0.0, 0, &first, &options)
        };
        assert_eq!(at(0.049, 1e-6), None);
        assert!(matches!(at(0.052, 1e-4), Some(Surprise::FarFromModel { .. })));
        assert_eq!(at(0.058, 2e-3), None);
        let Some(Surprise::FarFromModel { allowed_m, .. }) = at(0.060, 2e-3) else { panic!("accepted") };
        assert!((allowed_m - 0.059).abs() < 1e-9, "{allowed_m}");
    }
}
