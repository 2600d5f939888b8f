//! Why a correction ends, each reason with its evidence.

use super::plausible::Implausible;
use super::response::JointResponse;
use serde::Serialize;

/// Why a correction ended.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Stop {
    /// Every marker is within the tolerance of its target, the measurement's uncertainty counted.
    Converged(Converged),
    /// The error no longer falls.
    Stalled(Stalled),
    /// The error grows.
    Diverging(Diverging),
    /// A marker is not seen.
    MarkerLost(MarkerLost),
    /// Readings contradict each other, the model or the commands, and were not acted upon.
    Inconsistent(Inconsistent),
    /// The target cannot be reached within the limits.
    LimitReached(LimitReached),
    /// The allowed number of looks is used up.
    BudgetSpent(BudgetSpent),
}

/// Every marker is within the tolerance of its target.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Converged {
    /// Measured distance of each marker from its target, m.
    pub distance_m: Vec<f64>,
    /// Each true distance is below this, but with the probability `wrong_converged` for the whole correction, m.
    pub below_m: Vec<f64>,
    /// The tolerance, m.
    pub tolerance_m: f64,
    /// The probability of this being wrong, for a whole correction.
    pub wrong_converged: f64,
}

/// Why an error no longer falls.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum StallCause {
    /// The error stays although the steps should reduce it according to the model.
    NoProgress,
    /// A joint does not follow its commands.
    NotFollowing,
    /// The remaining error lies outside of what the free joints can move: no posture of theirs puts all markers on
    /// their targets.
    OutOfReach,
    /// The error is within the measurement's noise, which is larger than the tolerance.
    TooUncertain,
}

/// The error no longer falls.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stalled {
    /// Why.
    pub cause: StallCause,
    /// Distance of each marker from its target, m.
    pub distance_m: Vec<f64>,
    /// The upper bound of each, m.
    pub below_m: Vec<f64>,
    /// Root mean square distance of each accepted look, m.
    pub history_m: Vec<f64>,
    /// The part of each marker's error that the free joints cannot remove according to the model, m.
    pub left_m: Vec<f64>,
    /// How far each joint followed its commands.
    pub responses: Vec<JointResponse>,
}

/// The error grows.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Diverging {
    /// Root mean square distance now, m.
    pub error_m: f64,
    /// Its standard deviation, m.
    pub error_std_m: f64,
    /// The best one seen, m.
    pub best_error_m: f64,
    /// The number of the best look, from 1.
    pub best_look: usize,
    /// Root mean square distance of each accepted look, m.
    pub history_m: Vec<f64>,
    /// How far each joint followed its commands.
    pub responses: Vec<JointResponse>,
}

/// A marker is not seen.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MarkerLost {
    /// The markers that were not measured.
    pub markers: Vec<String>,
    /// Looks in a row that failed.
    pub looks: usize,
}

/// Readings contradict each other, the model or the commands.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Inconsistent {
    /// The readings that were rejected at the last look.
    pub readings: Vec<Implausible>,
    /// Looks in a row that failed.
    pub looks: usize,
}

/// A joint at the end of its range.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LimitHit {
    /// Its name.
    pub joint: String,
    /// Its command, rad (m).
    pub position_rad: f64,
    /// The end at which it stands, rad (m).
    pub limit_rad: f64,
    /// Whether that is the model's limit, or the farthest that a correction may go from the reference posture.
    pub of_model: bool,
    /// Where it would have to go without limits, rad (m).
    pub wanted_rad: f64,
}

/// The target cannot be reached within the limits.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LimitReached {
    /// The joints that stand at an end of their range.
    pub joints: Vec<LimitHit>,
    /// Distance of each marker from its target, m.
    pub distance_m: Vec<f64>,
    /// What is left of it within the limits at best, by the model, m.
    pub left_m: Vec<f64>,
    /// What would be left without the limits, m.
    pub left_without_limits_m: Vec<f64>,
    /// The tolerance, m.
    pub tolerance_m: f64,
}

/// The allowed number of looks is used up.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BudgetSpent {
    /// How many.
    pub looks: usize,
    /// Distance of each marker from its target at the last accepted look, m; empty where there was none.
    pub distance_m: Vec<f64>,
    /// Root mean square distance of each accepted look, m.
    pub history_m: Vec<f64>,
}
