//! From log odds to a calibrated probability.

use crate::diagnose::principles::{TEMPER, UNTHOUGHT_OF};

/// Probability of a cause of which only its log odds against nothing are known.
pub(crate) fn tempered(log_odds: f64) -> f64 {
    against(&[-log_odds])
}

/// Probability of a model against others, of which the log odds against it are known.
pub(crate) fn against(others: &[f64]) -> f64 {
    let rest: f64 = others.iter().map(|log_odds| (TEMPER * log_odds).exp()).sum();
    (1.0 - UNTHOUGHT_OF) / (1.0 + rest)
}
