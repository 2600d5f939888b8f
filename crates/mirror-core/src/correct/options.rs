//! Options of a correction.

use super::jacobian::JacobianSource;
use super::step::StepOptions;
use crate::error::{Error, Result, positive};

/// All choices of a correction.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CorrectOptions {
    /// How a step is taken.
    pub step: StepOptions,
    /// Which Jacobian.
    pub jacobian: JacobianSource,
    /// When to stop, and which readings to accept.
    pub judge: JudgeOptions,
}

/// When a correction stops, and which readings it accepts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JudgeOptions {
    /// ε: each marker's true distance from its target must be below, m.
    pub tolerance_m: f64,
    /// The probability that a whole correction (all its looks and markers together) wrongly reports convergence.
    pub wrong_converged: f64,
    /// The largest number of looks.
    pub looks: usize,
    /// Looks in a row that bring less than [`Self::least_progress`] before the correction counts as stalled.
    pub patience: usize,
    /// The relative reduction of the best error that is required within `patience` looks.
    pub least_progress: f64,
    /// How many times the best error an error must be, significantly and twice in a row, to count as diverging.
    pub divergence: f64,
    /// Number of successive looks at one posture that may fail (a marker not seen, a reading rejected) before the
    /// correction ends.
    pub retries: usize,
    /// The largest plausible distance of a marker from its model at the first look, m; a larger one is rejected.
    pub largest_gap_m: f64,
    /// How far a marker may be from where the last step should have put it, beyond noise and beyond that whole
    /// step: play, m.
    pub play_m: f64,
    /// The farthest that a command may go from the reference posture, rad (m for a prismatic joint).
    pub largest_correction_rad: f64,
}

impl Default for JudgeOptions {
    fn default() -> Self {
        Self {
            tolerance_m: 0.001,
            wrong_converged: 0.01,
            looks: 20,
            patience: 5,
            least_progress: 0.1,
            divergence: 1.5,
            retries: 2,
            largest_gap_m: 0.05,
            // Two degrees of play at an arm's length of 120 mm.
            play_m: 0.004,
            // Three times the largest gap that small servos were seen to have (paper: 9.3 mm at 110 mm, 5°).
            largest_correction_rad: 0.35,
        }
    }
}

impl CorrectOptions {
    /// Refuses invalid options.
    ///
    /// # Errors
    /// A number that is not finite or out of range, by its name.
    pub fn check(&self) -> Result<()> {
        self.step.check()?;
        let j = &self.judge;
        for (what, value) in [
            ("tolerance_m", j.tolerance_m),
            ("largest_gap_m", j.largest_gap_m),
            ("largest_correction_rad", j.largest_correction_rad),
        ] {
            positive(what, value)?;
        }
        let between = [
            ("wrong_converged", j.wrong_converged, 0.0, 0.5),
            ("least_progress", j.least_progress, 0.0, 1.0),
            ("divergence", j.divergence, 1.0, f64::INFINITY),
            ("play_m", j.play_m, -f64::MIN_POSITIVE, f64::INFINITY),
        ];
        for (what, value, above, below) in between {
            if !(value > above && value < below) {
                return Err(Error::OutOfRange {
                    what: what.to_owned(),
                    got: value,
                    needed: format!("a number above {above} and below {below}"),
                });
            }
        }
        for (what, got) in [("looks", j.looks), ("patience", j.patience)] {
            if got == 0 {
                return Err(Error::TooFew { what: what.to_owned(), got, needed: 1 });
            }
        }
        Ok(())
    }
}
