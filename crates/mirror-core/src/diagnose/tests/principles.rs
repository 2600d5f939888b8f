//! What decisions rest on: the quantities agree with each other.

use crate::diagnose::principles::{
    BEYOND_DOUBT, FEWEST_REDUNDANT_ROWS, LEAST_LOG_ODDS, LOG_PRIOR_CROWD, LOG_PRIOR_FREE, LOG_PRIOR_GEOMETRY,
    LOG_PRIOR_SAME_PLACE, LOG_PRIOR_SETUP, TEMPER, UNTHOUGHT_OF,
};

/// The odds of a tempered log Bayes factor against it.
fn doubt(log_odds: f64) -> f64 {
    (-TEMPER * log_odds).exp()
}

#[test]
fn the_principles_agree_with_each_other() {
    // A cause is told at strong odds, not at certainty.
    let told = 1.0 / (1.0 + (-LEAST_LOG_ODDS).exp());
    assert!((0.9..0.99).contains(&told), "{told}");
    // What is beyond doubt stays so where laws are wrong: by less than is kept back for what nobody thought of.
    assert!(doubt(BEYOND_DOUBT) < 0.01 * UNTHOUGHT_OF);
    assert!(doubt(BEYOND_DOUBT) > 1e-9);
    // What is just told is not certain once tempered.
    assert!(doubt(LEAST_LOG_ODDS) > 0.2);
    // The prior: less than doubtless evidence overcomes each of its steps, but that to a crowd; structure costs more than a cause.
    for step in [LOG_PRIOR_SAME_PLACE, LOG_PRIOR_FREE, LOG_PRIOR_GEOMETRY, LOG_PRIOR_SETUP] {
        assert!((LEAST_LOG_ODDS..0.5 * BEYOND_DOUBT).contains(&-step), "{step}");
    }
    let rising = [LOG_PRIOR_CROWD, -BEYOND_DOUBT, LOG_PRIOR_GEOMETRY, LOG_PRIOR_FREE, LOG_PRIOR_SAME_PLACE];
    assert!(rising.is_sorted_by(|a, b| a < b));
    // A variance from so few rows: its relative deviation is √(2/n).
    assert!((0.15..0.25).contains(&(2.0 / FEWEST_REDUNDANT_ROWS).sqrt()));
}
