//! Input and output of a correction: readings, decisions, the record of each look.

use super::super::plausible::Implausible;
use super::super::stop::Stop;
use crate::error::{Error, Result, finite, is_symmetric, not_negative};
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;

/// The measurement of a marker at one look.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Position in the board's frame, m.
    pub point_in_frame_m: Vector3<f64>,
    /// Its covariance, m².
    pub covariance_m2: Matrix3<f64>,
    /// Sum of squared normalised residuals of its rays.
    pub chi_squared: f64,
    /// Its degrees of freedom; 0 where they are not known.
    pub degrees_of_freedom: usize,
}

impl Reading {
    /// Refuses numbers that are not finite, a covariance that is not positive definite, a negative sum of squares.
    pub(super) fn check(&self) -> Result<()> {
        let numbers = self.point_in_frame_m.iter().chain(self.covariance_m2.iter());
        numbers.copied().try_for_each(|v| finite("reading of a marker", v).map(drop))?;
        not_negative("sum of a marker's squared residuals", self.chi_squared)?;
        if !is_symmetric(&self.covariance_m2) || self.covariance_m2.cholesky().is_none() {
            return Err(Error::OutOfRange {
                what: "determinant of a marker's covariance (m^6)".to_owned(),
                got: self.covariance_m2.determinant(),
                needed: "a symmetric positive definite 3×3 matrix".to_owned(),
            });
        }
        Ok(())
    }
}

/// What is to be done next.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "do", rename_all = "snake_case")]
pub enum Decision {
    /// Command these positions, then look.
    Step {
        /// The new command, N positions, rad (m).
        command: Vec<f64>,
        /// What it changes, rad (m).
        change: Vec<f64>,
        /// Names of the joints that a limit stopped.
        at_limit: Vec<String>,
        /// The damping, m/rad.
        mu_m_per_rad: f64,
        /// 1, or the factor that shortened the step.
        scale: f64,
    },
    /// Look once more at the same posture.
    LookAgain {
        /// Whether the earlier views of this posture are to be left out.
        fresh: bool,
        /// Why: `not_seen`, `not_believed`, `uncertain`, `surprising`.
        why: &'static str,
    },
    /// Stop.
    Stop {
        /// Why.
        stop: Stop,
    },
}

/// A marker's error at one look.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MarkerError {
    /// Its name.
    pub marker: String,
    /// Target minus measured in the board's frame, m; none where it was not measured.
    pub error_m: Option<[f64; 3]>,
    /// Standard deviations of the three, m.
    pub std_m: Option<[f64; 3]>,
    /// The true distance is below this, m.
    pub below_m: Option<f64>,
    /// Why it was rejected.
    pub implausible: Option<Implausible>,
}

/// The measurement of one look and the decision that followed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LookRecord {
    /// From 1.
    pub look: usize,
    /// Steps commanded before it.
    pub steps: usize,
    /// The command at which it was taken, rad (m).
    pub command: Vec<f64>,
    /// One for each marker.
    pub markers: Vec<MarkerError>,
    /// Root mean square distance, m; none where the look was rejected.
    pub rms_m: Option<f64>,
    /// What was decided.
    pub decision: Decision,
}
