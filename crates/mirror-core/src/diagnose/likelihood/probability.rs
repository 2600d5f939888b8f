//! From log odds to a calibrated probability.

use crate::diagnose::principles::{TEMPER, UNTHOUGHT_OF};

/// Probability of a cause for which only the log odds against its absence are known.
pub(crate) fn tempered(log_odds: f64) -> f64 {
    against(&[-log_odds])
}

/// Probability where the search did not end: a hypothesis that was not tested may be as probable.
pub(crate) fn unfinished(probability: f64) -> f64 {
    probability / (1.0 + probability)
}

/// Probability of a model against others, given the log odds against it.
pub(crate) fn against(others: &[f64]) -> f64 {
    let rest: f64 = others.iter().map(|log_odds| (TEMPER * log_odds).exp()).sum();
    (1.0 - UNTHOUGHT_OF) / (1.0 + rest)
}
