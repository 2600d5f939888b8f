//! What decisions rest on: the quantities agree with each other.

use crate::diagnose::likelihood::probability::tempered;
use crate::diagnose::principles::{
    A_GAP, ABOVE_SCATTER, BEYOND_DOUBT, FAR_DEVIATIONS, FEWEST_OBSERVATIONS, FEWEST_POSTURES,
    FEWEST_REDUNDANT_ROWS, LEAST_HELD_OUT_GAIN, LEAST_HELD_OUT_RATIO, LEAST_LOG_ODDS, LOG_PRIOR_CROWD,
    LOG_PRIOR_FREE, LOG_PRIOR_SAME_PLACE, LOG_PRIOR_STRUCTURE, MAJORITY, NEARLY_ALL, SEVERAL_CAUSES,
    SURE_DEVIATIONS, TEMPER, UNTHOUGHT_OF, WORTH_NAMING,
};
use crate::diagnose::random_effects::law_columns::LAW_SHARE;
use crate::diagnose::report::named_causes::DROOP_BESIDE_BAND;
use crate::diagnose::selection::nonparametric::IMITATOR_SHARE;
use crate::diagnose::selection::with_setup::LEAST_LOG_ODDS as LEAST_LOG_ODDS_BESIDE_SETUP;
use crate::diagnose::selection::with_tolerances::FEWEST_TOLD;

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
    // A cause that is just told is named with its rival, one of 3 to 1 is not.
    assert!((0.7..=0.75).contains(&tempered(LEAST_LOG_ODDS)));
    // A rival that is left aside where the noise is coarse is no more likely than what is beyond doubt.
    assert!((2.0 * LEAST_LOG_ODDS..0.5 * BEYOND_DOUBT).contains(&(-WORTH_NAMING.ln() / TEMPER)));
    // The prior: less than doubtless evidence overcomes each of its steps, but that to a crowd; structure costs more than a cause.
    for step in [LOG_PRIOR_SAME_PLACE, LOG_PRIOR_FREE, LOG_PRIOR_STRUCTURE] {
        assert!((LEAST_LOG_ODDS..0.5 * BEYOND_DOUBT).contains(&-step), "{step}");
    }
    assert!((1.0..3.0).contains(&(LOG_PRIOR_CROWD / -BEYOND_DOUBT)));
    let rising = [-BEYOND_DOUBT, LOG_PRIOR_STRUCTURE, LOG_PRIOR_FREE, LOG_PRIOR_SAME_PLACE];
    assert!(rising.is_sorted_by(|a, b| a < b));
    // A variance from so few rows: its relative deviation is √(2/n).
    assert!((0.15..0.25).contains(&(2.0 / FEWEST_REDUNDANT_ROWS).sqrt()));
}

#[test]
fn sizes_that_decide_stand_where_chance_puts_them() {
    // Of a hundred thousand rows none is false by chance, and one of twice that is not overlooked: P(|z| > d) < 2 exp(−d²/2).
    assert!(2e5 * (-0.5 * FAR_DEVIATIONS.powi(2)).exp() < 0.01 && FAR_DEVIATIONS < 8.0);
    let by_chance = 2.0 * (-0.5 * SURE_DEVIATIONS.powi(2)).exp();
    assert!((0.001..0.03).contains(&by_chance), "{by_chance}");
    // A gap is told before it stands out of its noise, and that before it is twice as large.
    assert!((1.1..1.25).contains(&A_GAP) && (1.25..2.0).contains(&ABOVE_SCATTER));
    // Half, and clearly more than half, of a whole.
    assert!((0.5..0.55).contains(&MAJORITY) && (2.0 / 3.0..0.9).contains(&NEARLY_ALL));
    // A group is asked for more than one cause of it, both for less than a session's resamples scatter by.
    let group = 1.0 - LEAST_HELD_OUT_RATIO;
    assert!(
        (5.0 * LEAST_HELD_OUT_GAIN..0.05).contains(&group) && (0.001..0.01).contains(&LEAST_HELD_OUT_GAIN)
    );
    assert!((2.0 * UNTHOUGHT_OF..0.1).contains(&WORTH_NAMING));
    // Two causes are a pair; place and scatter need more than twice the numbers that are told.
    assert!((3..4).contains(&SEVERAL_CAUSES) && (3..4).contains(&FEWEST_POSTURES));
    assert!((6..=12).contains(&FEWEST_OBSERVATIONS));
}

#[test]
fn sizes_of_single_stages_follow_from_what_they_stand_beside() {
    // A spread from n values is known to a share of 1/√(2n): to better than a half, yet not asked to be known to a third.
    let share = 1.0 / (2.0 * FEWEST_TOLD).sqrt();
    assert!((0.4..0.5).contains(&share), "{share}");
    // A cause beside an error of no name at its own joint moves markers about twice as far as that error.
    let times = IMITATOR_SHARE.sqrt();
    assert!((1.5..2.5).contains(&times), "{times}");
    // Beside the set-up, where its rival is in the model already, a cause needs less than elsewhere, and more than 4 to 1.
    let kept = 1.0 / (1.0 + (-LEAST_LOG_ODDS_BESIDE_SETUP).exp());
    assert!((0.8..0.95).contains(&kept) && LEAST_LOG_ODDS_BESIDE_SETUP < LEAST_LOG_ODDS, "{kept}");
    // A droop of less than a law may be off by is the dead band's own; one of twice that is not.
    assert!((LAW_SHARE..2.0 * LAW_SHARE).contains(&DROOP_BESIDE_BAND));
}
