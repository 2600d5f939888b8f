//! Each joint's error as a function of its own position, beside small errors everywhere: teeth of gears and scales of
//! encoders are slightly off everywhere, and so have a curve of their own in every joint.
//!
//! `θ = q + e(q)`, e once a turn, linear between [`KNOTS_A_TURN`](crate::diagnose::model::elementary::KNOTS_A_TURN)
//! values `e_k ~ N(0, s²)` with one s for all joints, estimated with the other scales. Where a session does not go e is
//! its prior mean, 0, so that such a curve predicts nothing there.
//!
//! Source: transmission errors of strain wave gears, Tuttle and Seering (1996); errors of encoders' scales and their
//! interpolation have the same form.

use crate::diagnose::criteria::cross_validation::seen_size;
use crate::diagnose::criteria::lack_of_fit::adequacy;
use crate::diagnose::likelihood::fit::FitOptions;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::prepare::false_observations::without_false;
use crate::diagnose::principles::{LEAST_HELD_OUT_RATIO, LOG_PRIOR_STRUCTURE};
use crate::diagnose::random_effects::small_errors::Kind;
use crate::diagnose::selection::extended_models::Extended;
use crate::diagnose::selection::nonparametric::log_odds;
use crate::diagnose::selection::search::{Found, Search};
use crate::error::Result;

/// Adds the joints' transmission errors to small errors everywhere that leave a remainder, where both the evidence and
/// the held-out regions are for them. Causes that are not needed beside them are dropped.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn with_transmission_errors(
    (search, found): (&mut Search<'_>, &mut Found),
    extended: &mut Extended,
) -> Result<()> {
    let of_robot = extended.geometry.as_ref().filter(|group| !group.setup_only && extended.erratic.is_none());
    let Some(geometry) = of_robot else { return Ok(()) };
    let left = adequacy(&extended.clean, &search.deformation(&found.fit.model), search.measured_noise)?;
    if !left.significant || search.problem.budget.is_spent() {
        return Ok(());
    }
    let mut wider = geometry.with_transmission_errors(&search.problem.scene);
    let mut beside = search.clone();
    let mut noise = found.noise;
    let mut with = found.clone();
    // The noise that is left decides how much of the curves the data determine.
    for _ in 0..SOLVER.rounds {
        let options = FitOptions { noise, steps: SOLVER.loose_steps };
        with.fit = wider.fit(&beside.problem, beside.catalogue, &with.fit.model, options, beside.mask)?;
        beside.group = wider.group.clone();
        let left = beside.effective(&with.fit.model)?;
        let change = (left.point_m / noise.point_m).min(left.marker_px / noise.marker_px);
        noise = left;
        if change > 1.0 - SOLVER.spreads_settled {
            break;
        }
    }
    with.noise = noise;
    // The last cause, too: what an eccentric gear explained may be a part of the curve.
    with.fit = beside.prune_to(0, with.fit, noise, &mut None, &mut with.trace)?.0;
    let odds = log_odds((&beside, &with), (search, found))? + LOG_PRIOR_STRUCTURE;
    let ratio = seen_size(&beside.held_out(&with.fit.model, noise)?)
        / seen_size(&search.held_out(&found.fit.model, found.noise)?).max(1e-30);
    let told = format!(
        "with transmission errors of all joints (scale {:.3} mrad): log odds {odds:.1}, held-out gap {ratio:.3} \
         times that without them",
        wider.spread(Kind::Transmission) * 1e3
    );
    // Written so that NaN is no gain.
    if odds > 0.0 && ratio < LEAST_HELD_OUT_RATIO {
        (*search, *found) = (beside, with);
        (extended.clean, _) =
            without_false(&search.problem, &search.deformation(&found.fit.model), found.noise)?;
        (extended.geometry, extended.unnamed) = (Some(wider), None);
    }
    found.trace.push(told);
    Ok(())
}
