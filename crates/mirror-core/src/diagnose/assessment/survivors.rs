//! Which causes are selected again in resamples of the postures.
//!
//! Where the model is not exact, the evidence counts a misfit that postures share once for each observation. A cause
//! that only absorbs part of such a misfit then gets log odds of tens and hundreds. Resampled postures vary with
//! such a misfit; the likelihood does not. So a cause is named only if it, or an inseparable alternative, is
//! selected again in more than half of the resamples, or if it is needed for prediction. No probability exceeds the mean
//! of those in the resamples: the bagged posterior. Where a remainder shows that the model is wrong, a selection of the cause's
//! alternatives counts as well.
//!
//! Source: Huggins and Miller, "Robust inference and model selection using bagged posteriors" (2020).

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::noise_floor::is_reached;
use crate::diagnose::assessment::stability::{RESAMPLES, stability};
use crate::diagnose::criteria::cross_validation::held_out;
use crate::diagnose::criteria::lack_of_fit::adequacy;
use crate::diagnose::effects::hypothesis::{Model, Term};
use crate::diagnose::likelihood::fit::FitOptions;
use crate::diagnose::likelihood::probability::tempered;
use crate::diagnose::likelihood::score_test::Score;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{MAJORITY, TEMPER, WORTH_NAMING};
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::selection::alternatives::{held_out_odds, replaced};
use crate::diagnose::selection::large_members::choose_members;
use crate::diagnose::selection::nonparametric::unexplained;
use crate::diagnose::selection::own_scales::AtOwnScales;
use crate::diagnose::selection::standing::Standing;
use crate::error::Result;

/// Removes the causes that are neither stable nor needed for prediction, the least stable first.
///
/// A cause with stability `p` in the resamples and log odds `h` from the held-out regions is removed if both
/// together, with equal weights, are against it: `ln((1 − p) / p) + t h > 0`, with the exponent t of all evidence
/// here.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn keep_survivors(findings: &mut Findings<'_>, ranking: &[Score]) -> Result<()> {
    let standings = findings.standings.clone();
    let found_again = stability(findings, &standings, ranking, &[])?;
    let mut shares = found_again.or_rivals;
    let mut posterior = found_again.posterior;
    // The alternative of a possible small error is that it is one: if other causes replace it, it counts as not
    // selected.
    for (i, term) in findings.found.fit.model.terms.iter().enumerate() {
        if findings
            .geometry
            .as_ref()
            .is_some_and(|group| group.holds(findings.search.catalogue, term.hypothesis))
        {
            shares[i] = found_again.terms[i];
        }
    }
    let mut order: Vec<usize> = (0..shares.len()).filter(|&i| shares[i].is_some()).collect();
    order.sort_by(|&a, &b| shares[a].partial_cmp(&shares[b]).unwrap_or(core::cmp::Ordering::Equal));
    let mut gone: Vec<usize> = Vec::new();
    for i in order {
        let Some(share) = shares[i] else { continue };
        let odds = log_odds(share);
        if odds > 0.0 {
            break;
        }
        let at = i - gone.iter().filter(|g| **g < i).count();
        if taken_back(findings, at, share, odds)? {
            gone.push(i);
        }
    }
    if !gone.is_empty() {
        choose_again(findings)?;
    }
    gone.sort_unstable();
    for i in gone.into_iter().rev() {
        shares.remove(i);
        posterior.remove(i);
    }
    let remainder = findings.unexplained.is_some();
    // A cause that was chosen again is the last, and has no share.
    let told = shares.into_iter().zip(posterior);
    for (standing, (share, posterior)) in findings.standings.iter_mut().zip(told) {
        let (Some(standing), Some(share), Some(posterior)) = (standing, share, posterior) else { continue };
        if remainder {
            standing.probability *= share;
        }
        // What every resample finds again is not limited by how many there are.
        if posterior < 1.0 {
            standing.limited(bagged(posterior), (share - posterior).max(0.0) / (1.0 - posterior));
        }
    }
    likelier_instead(findings)?;
    told_as_members(findings);
    Ok(())
}

/// Puts an alternative that resamples find more often in its cause's place, unless held-out regions speak against
/// it by as much: then they limit its probability.
fn likelier_instead(findings: &mut Findings<'_>) -> Result<()> {
    let catalogue = findings.search.catalogue;
    let count = findings.found.fit.model.terms.len();
    if findings.found.fit.model.terms.iter().any(|t| catalogue.is_free(t.hypothesis)) {
        return Ok(());
    }
    // The last, since the alternative becomes the last of the model.
    for i in (0..count).rev() {
        let Some(Some(standing)) = findings.standings.get(i) else { continue };
        let Some(rival) = standing.likelier() else { continue };
        let (search, found) = (&findings.search, &findings.found);
        let own = &found.fit.model.terms[i];
        let own = (own.hypothesis, own.variant);
        let known = found.fit.model.terms.iter().any(|t| t.hypothesis == rival.hypothesis);
        if known || findings.geometry.as_ref().is_some_and(|g| g.holds(catalogue, rival.hypothesis)) {
            continue;
        }
        let (next, gap) = replaced(search, found, i, Some(rival))?;
        let pooled = standing.pooled(held_out_odds(&gap, &findings.after, found.noise));
        if pooled <= 1.0 {
            let mut held_back = standing.clone();
            held_back.hold_back(pooled);
            findings.standings[i] = Some(held_back);
            continue;
        }
        let name = |h: usize| catalogue.name(&search.problem.scene, h);
        let line = format!(
            "{} in place of {}, which resamples find less often",
            name(rival.hypothesis),
            name(own.0)
        );
        let standing = standing.exchanged(own, rival.hypothesis);
        findings.found.trace.push(line);
        findings.found.fit = next;
        findings.after = gap;
        findings.standings.remove(i);
        findings.standings.push(Some(standing));
    }
    Ok(())
}

/// Chooses a cause among the small errors everywhere again, where those that were removed are all among them: resamples may find none
/// of several that share out one which is large.
fn choose_again(findings: &mut Findings<'_>) -> Result<()> {
    let Some(mut group) = findings.geometry.clone().filter(|group| !group.setup_only) else { return Ok(()) };
    let catalogue = findings.search.catalogue;
    let terms = findings.found.fit.model.terms.len();
    let other = |t: &Term| group.holds(catalogue, t.hypothesis) || catalogue.is_free(t.hypothesis);
    if findings.found.fit.model.terms.iter().any(other) {
        return Ok(());
    }
    let nominal = Model::nominal(&findings.search.problem);
    let (mut search, mut found) = (findings.search.clone(), findings.found.clone());
    let Some(odds) = choose_members((&mut search, &mut group), &mut found, &nominal)? else { return Ok(()) };
    // Of one alone the odds are known.
    if found.fit.model.terms.len() != terms + 1 {
        return Ok(());
    }
    findings.after = search.held_out(&found.fit.model, found.noise)?;
    findings.standings.push(Some(Standing::of(tempered(odds), Vec::new(), 1.0 - tempered(odds))));
    (findings.search, findings.found, findings.geometry) = (search, found, Some(group));
    Ok(())
}

/// Takes the names of causes that are more probably members of the small errors everywhere: an outlier of these may be
/// needed to predict, and be found among them in most resamples. It stays in the model with its own prior and is
/// reported with the group.
fn told_as_members(findings: &mut Findings<'_>) {
    let Some(group) = findings.geometry.as_ref().filter(|group| !group.setup_only) else { return };
    for (term, standing) in findings.found.fit.model.terms.iter().zip(&mut findings.standings) {
        let improbable = standing.as_ref().is_some_and(|s| {
            let with_rivals = s.probability + s.rivals.iter().map(|r| r.probability).sum::<f64>();
            with_rivals < MAJORITY || s.probability < WORTH_NAMING
        });
        if improbable && group.holds(findings.search.catalogue, term.hypothesis) {
            *standing = None;
        }
    }
}

/// The probability that a share of the resamples represents (Jeffreys).
fn bagged(share: f64) -> f64 {
    let count = RESAMPLES as f64;
    (count * share + 0.5) / (count + 1.0)
}

/// Log odds of a share of the resamples, half a resample on either side (Jeffreys).
fn log_odds(share: f64) -> f64 {
    let p = bagged(share);
    (p / (1.0 - p)).ln()
}

/// Takes a cause back unless it is needed to predict.
fn taken_back(findings: &mut Findings<'_>, i: usize, share: f64, odds: f64) -> Result<bool> {
    let found = &mut findings.found;
    let rest = findings.search.taken_out(&found.fit.model, i, found.noise)?;
    let hypothesis = found.fit.model.terms[i].hypothesis;
    let columns = findings.search.group.columns.len();
    // What is one of the small errors goes back among them, whose spreads were learned without it.
    let own = |group: &&Geometry| {
        group.group.columns.len() == columns && group.holds(findings.search.catalogue, hypothesis)
    };
    let options = FitOptions { noise: found.noise, steps: SOLVER.without_steps };
    let (search, spreads, without) = if let Some(group) = findings.geometry.as_ref().filter(own) {
        let AtOwnScales { search, geometry, fit } =
            AtOwnScales::fitted(&findings.search, group, &rest, options)?;
        (search, Some(geometry), fit)
    } else {
        let fit = findings.search.fit(&rest, found.noise, options.steps)?;
        (findings.search.clone(), findings.geometry.clone(), fit)
    };
    let gap = search.held_out(&without.model, found.noise)?;
    let with = findings.search.held_out(&found.fit.model, found.noise)?;
    if TEMPER * held_out_odds(&gap, &with, found.noise) <= odds {
        return Ok(false);
    }
    (findings.search, findings.geometry) = (search, spreads);
    let search = &findings.search;
    let name = search.catalogue.name(&search.problem.scene, hypothesis);
    found.trace.push(format!("remove {name}: selected again in {:.0} % of resamples", 100.0 * share));
    found.fit = without;
    findings.standings.remove(i);
    // Free-form errors cannot be added to a model.
    let (s, model) = (search, &found.fit.model);
    let free = model.terms.iter().any(|t| s.catalogue.is_free(t.hypothesis));
    findings.after = if free {
        held_out(&s.problem, s.catalogue, &s.group, model, found.noise, s.detector_noise(), true)?
    } else {
        gap
    };
    if findings.unexplained.is_none() {
        let left = adequacy(&search.problem, &search.deformation(&found.fit.model), search.measured_noise)?;
        let reached = found.fit.model.explains() && is_reached(search, &found.fit, &findings.after)?;
        findings.unexplained = unexplained(search, found, &left, reached)?;
    }
    Ok(true)
}
