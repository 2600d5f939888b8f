//! From log odds to a probability that can be believed.

/// Evidence is taken to this power (a power posterior: Holmes and Walker 2017): laws are never exact, so that data speak less than they seem to.
pub(crate) const TEMPER: f64 = 0.35;
/// What is kept back for a cause that nobody thought of: nothing is told as more probable than the rest.
pub(crate) const UNTHOUGHT_OF: f64 = 0.01;

/// Probability of a cause of which only its log odds against nothing are known.
pub(crate) fn tempered(log_odds: f64) -> f64 {
    against(&[-log_odds])
}

/// Probability of a model against others, of which the log odds against it are known.
pub(crate) fn against(others: &[f64]) -> f64 {
    let rest: f64 = others.iter().map(|log_odds| (TEMPER * log_odds).exp()).sum();
    (1.0 - UNTHOUGHT_OF) / (1.0 + rest)
}
