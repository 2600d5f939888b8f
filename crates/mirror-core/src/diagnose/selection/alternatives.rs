//! The alternatives of a cause, each fitted in its place, and the probabilities of all.

use crate::diagnose::criteria::cross_validation::PostureGap;
use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::effects::{LawFreedom, Place};
use crate::diagnose::likelihood::fit::Fit;
use crate::diagnose::model::problem::Noise;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{Size, TEMPER, UNTHOUGHT_OF, WORTH_NAMING};
use crate::diagnose::random_effects::displaced::members_of;
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::selection::linear_search::by_linear_models;
use crate::diagnose::selection::linear_standings::linear_standings;
use crate::diagnose::selection::search::{Found, Search, SearchOptions};
use crate::diagnose::selection::standing::{ByMounts, RIVALS, Rival, Standing};
use crate::error::Result;

/// Whether two causes are laws of one joint, neither of which is exactly known. What separates them only if both
/// follow the textbook exactly (a play that widens with its load, and a servo that sticks and droops) is no
/// evidence.
fn both_laws_err(search: &Search<'_>, one: usize, other: usize) -> bool {
    let node = |h: usize| search.catalogue.hypotheses[h].place.node();
    let errs = |h: usize| search.catalogue.effect(h).law_freedom() != LawFreedom::Exact;
    node(one).is_some() && node(one) == node(other) && errs(one) && errs(other)
}

/// Fits the best alternatives in the place of the i-th cause and computes their probabilities.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn standing(search: &Search<'_>, found: &Found, i: usize) -> Result<Standing> {
    let own = found.fit.model.terms[i].hypothesis;
    let rest = search.taken_out(&found.fit.model, i, found.noise)?;
    let named =
        Search { options: SearchOptions { named_only: true, ..search.options.clone() }, ..search.clone() };
    let (rivals, far) = rivals_at_all_noises(&named, found, i, &rest, own)?;
    let tolerated = search.log_odds(&found.fit, i, found.noise)?;
    let reference = if rivals.is_empty() {
        0.0
    } else {
        search.log_posterior(&search.fit_with_slack(
            &found.fit.model,
            Some(i),
            found.noise,
            SOLVER.loose_steps,
        )?)
    };
    // With discrepancy terms of the laws of all causes, the one in question included.
    let loosely = |model: &Model| search.fit_with_slack(model, None, found.noise, 8);
    // Weights relative to the cause itself.
    let mut weights: Vec<(usize, f64, f64)> = Vec::new();
    for rival in &rivals {
        let Some(term) = rival.model.terms.last() else { continue };
        let ahead = if both_laws_err(search, own, term.hypothesis) {
            search.log_posterior(&loosely(&rival.model)?) - search.log_posterior(&loosely(&found.fit.model)?)
        } else {
            search.log_posterior(rival) - reference
        };
        let log = TEMPER * ahead;
        weights.push((term.hypothesis, term.variant, log.min(50.0).exp()));
    }
    let mounts = by_stated_mounts(search, found, i)?;
    if let Some(by) = &mounts {
        weights.retain(|w| w.0 != by.mount);
        weights.push((by.mount, 0.0, (-TEMPER * by.odds).min(50.0).exp()));
    }
    let nothing = (-TEMPER * tolerated).min(50.0).exp();
    let total = 1.0 + nothing + weights.iter().map(|w| w.2).sum::<f64>();
    let scale = (1.0 - UNTHOUGHT_OF) / total;
    let weights_of: Vec<usize> = weights.iter().map(|w| w.0).collect();
    let rivals = weights
        .into_iter()
        .map(|(hypothesis, variant, w)| Rival { hypothesis, variant, probability: w * scale })
        .collect();
    let mut standing = Standing { mounts, ..Standing::of(scale, rivals, nothing * scale) };
    let fitted = weights_of.into_iter().chain(far);
    standing.outdone = fitted
        .filter(|&h| both_laws_err(search, own, h) && !standing.rivals.iter().any(|r| r.hypothesis == h))
        .collect();
    Ok(standing)
}

/// The best alternatives in the place of the i-th cause, fitted. First with the noise that the model without the
/// cause leaves: with the measurement's own noise everything that the cause explains would look false, and no
/// alternative could compete. Also the hypotheses that are far behind.
fn rivals_at_all_noises(
    named: &Search<'_>,
    found: &Found,
    i: usize,
    rest: &Model,
    own: usize,
) -> Result<(Vec<Fit>, Vec<usize>)> {
    let coarse = named.effective(rest)?;
    let own_fit = named.fit_with_slack(&found.fit.model, Some(i), coarse, SOLVER.candidate_steps)?;
    let candidates = named.candidates(rest, coarse, RIVALS, Some((own, &own_fit)))?;
    let is_rival = |fit: &&Fit| {
        fit.model.terms.last().is_some_and(|term| {
            // An effect that is equivalent to a simpler alternative is that alternative.
            let effect = named.catalogue.effect(term.hypothesis);
            term.hypothesis != own && effect.comes_down_to(&term.parameters).is_none()
        })
    };
    if !candidates.iter().any(|fit| is_rival(&fit)) {
        return Ok((Vec::new(), Vec::new()));
    }
    let reference = named.log_posterior(&own_fit);
    // Log odds at which an alternative would be less probable than is worth naming.
    let far_behind = -WORTH_NAMING.ln() / TEMPER;
    // What fits worse here fits worse by far at the finer noise; what only has more parameters does not.
    let (near, far): (Vec<&Fit>, Vec<&Fit>) =
        candidates.iter().filter(is_rival).partition(|fit| reference - named.log_posterior(fit) < far_behind);
    let near = near
        .into_iter()
        .map(|fit| named.fit_with_slack(&fit.model, Some(fit.model.terms.len() - 1), found.noise, 8))
        .collect::<Result<_>>()?;
    let far = far.iter().filter_map(|fit| fit.model.terms.last()).map(|term| term.hypothesis).collect();
    Ok((near, far))
}

/// The i-th cause compared with markers that are all free within the stated tolerance of their mounts; none where
/// nothing is stated, where mounts are free already, or where the cause is beyond doubt. A stated tolerance is
/// prior knowledge: a single mount must pay for each of its directions, and cannot do what several do together.
fn by_stated_mounts(search: &Search<'_>, found: &Found, i: usize) -> Result<Option<ByMounts>> {
    let catalogue = search.catalogue;
    let in_model = |h: usize| found.fit.model.terms.iter().any(|t| t.hypothesis == h);
    let mounts = Geometry::of_stated_markers(&search.problem, |effect, place| {
        catalogue.find(effect, place).is_some_and(|h| !in_model(h))
    });
    if mounts.group.columns.is_empty() || !search.group.columns.is_empty() || search.problem.budget.is_spent()
    {
        return Ok(None);
    }
    let free = Search { group: mounts.group.clone(), ..search.clone() };
    let mut start = found.fit.model.clone();
    start.group = vec![0.0; mounts.group.columns.len()];
    let with = free.fit(&start, found.noise, SOLVER.final_steps)?;
    let odds = free.log_odds(&with, i, found.noise)?;
    if (-TEMPER * odds).exp() < UNTHOUGHT_OF {
        return Ok(None);
    }
    let without = free.fit(&free.taken_out(&with.model, i, found.noise)?, found.noise, SOLVER.final_steps)?;
    let moved = |effect: &str, place: Place| -> f64 {
        let change = |k: usize| (without.model.group[k] - with.model.group[k]) / mounts.group.prior_std[k];
        members_of(&mounts, effect, place).iter().map(|(k, _)| change(*k).powi(2)).sum()
    };
    let most = mounts.mounts().max_by(|a, b| moved(a.0, a.1).total_cmp(&moved(b.0, b.1)));
    let Some(mount) = most.and_then(|(effect, place)| catalogue.find(effect, place)) else { return Ok(None) };
    Ok(Some(ByMounts { mount, odds, gap: free.held_out(&without.model, found.noise)? }))
}

/// Rounds in which causes are replaced by their alternatives.
const ROUNDS: Size = 4;

/// The probabilities of every cause, after each was replaced by an alternative, or by none, where evidence and
/// held-out regions together make that more probable; none for free-form errors. `after` is the held-out gap, `beside`
/// the small errors of the model.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn settled(
    search: &Search<'_>,
    found: &mut Found,
    after: &mut Vec<PostureGap>,
    beside: Option<&Geometry>,
) -> Result<Vec<Option<Standing>>> {
    for round in 0..ROUNDS {
        if round > 0 && search.problem.budget.is_spent() {
            break;
        }
        let mut standings = standings(search, found, beside)?;
        let mut changed = false;
        for (i, standing) in standings.iter_mut().enumerate() {
            let Some(standing) = standing else { continue };
            if standing.challenged() <= 1.0 {
                continue;
            }
            let rival = standing.likelier();
            let together =
                standing.mounts.as_ref().filter(|by| rival.is_some_and(|r| r.hypothesis == by.mount));
            if let Some(by) = together {
                // No single cause can replace it: both are reported.
                let pooled = standing.pooled(held_out_odds(&by.gap, after, found.noise));
                standing.disputed(pooled);
                continue;
            }
            let (next, gap) = replaced(search, found, i, rival)?;
            let pooled = standing.pooled(held_out_odds(&gap, after, found.noise));
            if pooled <= 1.0 {
                standing.disputed(pooled);
                continue;
            }
            let name = |h: usize| search.catalogue.name(&search.problem.scene, h);
            let old = name(found.fit.model.terms[i].hypothesis);
            let new = rival.map_or_else(|| "nothing".to_owned(), |r| name(r.hypothesis));
            found.trace.push(format!("{old} is replaced by {new}, which is more probable"));
            found.fit = next;
            *after = gap;
            changed = true;
            break;
        }
        if !changed {
            return Ok(standings);
        }
    }
    // The exchange did not converge: a cause that would be replaced again is not accepted.
    let mut last = standings(search, found, beside)?;
    last.iter_mut().flatten().filter(|s| s.challenged() > 1.0).for_each(|s| s.disputed(1.0));
    Ok(last)
}

/// A model with the i-th cause replaced by an alternative, which becomes the last, or by none: fitted, and its gap on
/// held-out regions.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn replaced(
    search: &Search<'_>,
    found: &Found,
    i: usize,
    by: Option<&Rival>,
) -> Result<(Fit, Vec<PostureGap>)> {
    let rest = search.taken_out(&found.fit.model, i, found.noise)?;
    let rest = search.fit(&rest, found.noise, SOLVER.without_steps)?;
    let next = match by {
        Some(rival) => {
            let with = rest.model.with(search.catalogue, rival.hypothesis, rival.variant);
            search.fit(&with, found.noise, SOLVER.final_steps)?
        }
        None => rest,
    };
    let gap = search.held_out(&next.model, found.noise)?;
    Ok((next, gap))
}

/// Log likelihood ratio of two models' held-out gaps, at a noise.
pub(crate) fn held_out_odds(one: &[PostureGap], other: &[PostureGap], noise: Noise) -> f64 {
    let pixels = one.iter().any(|g| g.pixels > 0.0);
    let square = |gaps: &[PostureGap]| -> f64 {
        let of = |g: &PostureGap| {
            if pixels {
                g.square_sum_px2 / noise.marker_px.powi(2)
            } else {
                g.square_sum_m2 / noise.point_m.powi(2)
            }
        };
        gaps.iter().map(of).sum()
    };
    0.5 * (square(other) - square(one))
}

fn standings(search: &Search<'_>, found: &Found, beside: Option<&Geometry>) -> Result<Vec<Option<Standing>>> {
    // At the limit of work fits of all alternatives beside many mounts would take as long again.
    let at_limit = search.problem.budget.is_spent();
    let by_linear_model = if at_limit || by_linear_models(&search.problem, beside).is_some() {
        linear_standings(search, found, beside)?
    } else {
        vec![None; found.fit.model.terms.len()]
    };
    by_linear_model
        .into_iter()
        .enumerate()
        .map(|(i, known)| {
            let free = search.catalogue.is_free(found.fit.model.terms[i].hypothesis);
            if free || known.is_some() { Ok(known) } else { standing(search, found, i).map(Some) }
        })
        .collect()
}
