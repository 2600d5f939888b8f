//! From log odds to a calibrated probability.

use crate::diagnose::principles::{TEMPER, UNTHOUGHT_OF};

/// Probability of a cause for which only the log odds against its absence are known.
pub(crate) fn tempered(log_odds: f64) -> f64 {
    against(&[-log_odds])
}

/// Probability of a model against others, given the log odds against it.
pub(crate) fn against(others: &[f64]) -> f64 {
    let rest: f64 = others.iter().map(|log_odds| (TEMPER * log_odds).exp()).sum();
    (1.0 - UNTHOUGHT_OF) / (1.0 + rest)
}
