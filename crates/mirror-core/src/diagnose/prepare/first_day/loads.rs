//! Gravity with a wrong direction: every spring would deflect against its load.
//!
//! Springs have compliances of one sign only. If gravity is stated upside down (or along another axis) they need the
//! other sign. Then no cause of the vocabulary fits, and the right direction explains with one parameter what many
//! others cannot.

use super::mistake::Mistake;
use super::single_cause::{Alone, Beside, Best, Likeliest, likeliest};
use super::verify::smaller;
use crate::diagnose::effects::vocabulary;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::principles::{A_GAP, BEYOND_DOUBT, MAJORITY, NEARLY_ALL};
use crate::error::Result;
use core::f64::consts::{FRAC_PI_2, PI};
use nalgebra::{Rotation3, Vector3};

/// Gravity in another direction.
#[derive(Debug, Clone)]
pub(super) struct Turned {
    pub mistake: Mistake,
    pub log_odds: f64,
    /// Whether one spring under it explains what no cause explains under the stated direction. Else it explains more than any single
    /// cause does, and only a whole diagnosis under each direction can tell.
    pub sure: bool,
}

/// The rotation of gravity with which a single spring explains more than any cause does under the stated direction, with
/// everything mounted as modelled, or with mounts and zeros free. `alone`: the likeliest single cause, if the nominal model leaves
/// a gap; `explained`: whether it leaves none, then mounts have nothing to explain.
///
/// # Errors
/// Invalid parameters of camera or mirror.
pub(super) fn turned_gravity(
    problem: &Problem,
    alone: Option<Alone>,
    explained: bool,
) -> Result<Option<Turned>> {
    // Where nothing is to be explained mounts need not be fitted.
    let Some(Alone { noise, likeliest: stated, .. }) = alone else { return Ok(None) };
    let exact = turned_beside(problem, &Beside::nothing(problem), stated, noise)?;
    if explained || exact.as_ref().is_some_and(|turned| turned.sure) {
        return Ok(exact);
    }
    let mounts = Beside::mounts(problem)?;
    let Some(noise) = mounts.gap(problem)? else { return Ok(exact) };
    let stated = likeliest(problem.clone(), vocabulary(), &mounts, noise)?;
    let beside_mounts = turned_beside(problem, &mounts, stated, noise)?;
    Ok(beside_mounts.filter(|turned| turned.sure).or(exact))
}

/// `stated`: the likeliest cause under the stated gravity.
fn turned_beside(
    problem: &Problem,
    beside: &Beside,
    stated: Option<Likeliest>,
    noise: Noise,
) -> Result<Option<Turned>> {
    let Some(down) = problem.scene.gravity.try_normalize(1e-9) else { return Ok(None) };
    let nominal = problem.nominal();
    let Some(stated) = stated else { return Ok(None) };
    let across = down.cross(&if down.x.abs() < 0.8 { Vector3::x() } else { Vector3::y() }).normalize();
    let other = down.cross(&across);
    let turns = [across * PI, across * FRAC_PI_2, across * -FRAC_PI_2, other * FRAC_PI_2, other * -FRAC_PI_2];
    let mut found: Option<(Likeliest, Vector3<f64>)> = None;
    for turn in turns {
        let mut turned = problem.clone();
        turned.scene.gravity = Rotation3::new(turn) * problem.scene.gravity;
        turned.scene.update_loads(&nominal);
        let springs = vocabulary().into_iter().filter(|e| e.is_spring()).collect();
        if let Some(best) = likeliest(turned, springs, beside, noise)?
            && found.as_ref().is_none_or(|(other, _)| best.log_bayes > other.log_bayes)
        {
            found = Some((best, turn));
        }
    }
    let Some((turned, turn)) = found else { return Ok(None) };
    let likelier = turned.log_bayes > stated.log_bayes + BEYOND_DOUBT;
    let as_likely = turned.log_bayes > stated.log_bayes;
    let turned = turned.fitted(noise)?;
    let excess = |best: &Best| {
        (problem.of_observations(best.left) / problem.of_observations(problem.noise)).powi(2) - 1.0
    };
    let a_gap = A_GAP * A_GAP - 1.0;
    // None of those below, whatever the best cause under the stated gravity leaves.
    if !as_likely && excess(&turned) >= a_gap {
        return Ok(None);
    }
    let stated = stated.fitted(noise)?;
    // With the nominal model's scatter, and with clearly less left than by the best cause under the stated gravity,
    // whatever else is wrong;
    let much =
        likelier && problem.of_observations(turned.left) < NEARLY_ALL * problem.of_observations(stated.left);
    // or if the spring alone leaves no gap, compared with the noise that it leaves. Together with other causes a
    // spring of the wrong sign may only absorb a part of theirs.
    let all = excess(&turned) < a_gap.min(MAJORITY * excess(&stated));
    if !(much || all || as_likely) {
        return Ok(None);
    }
    let at = smaller(turned.left, stated.left);
    let log_odds = turned.log_evidence(at)? - stated.log_evidence(at)?;
    let sure = (much || all) && log_odds > BEYOND_DOUBT;
    let turned = Turned { mistake: Mistake::Gravity { turn }, log_odds, sure };
    Ok((sure || as_likely && log_odds > 0.0).then_some(turned))
}
