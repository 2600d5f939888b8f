//! Simplifies the causes found: those that do not help on held-out regions are dropped, those that are equivalent to
//! a simpler one are replaced by it, those that only served free-form errors are removed.

use crate::diagnose::criteria::cross_validation::{PostureGap, held_out, in_sample, seen_size, size};
use crate::diagnose::effects::hypothesis::{Model, Term};
use crate::diagnose::likelihood::fit::{FitOptions, Group};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{ABOVE_SCATTER, LEAST_HELD_OUT_GAIN, LEAST_LOG_ODDS, NEARLY_ALL, TEMPER};
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::selection::linear_search::by_linear_models;
use crate::diagnose::selection::linear_use::{drop_useless_beside, least_gain};
use crate::diagnose::selection::own_scales::AtOwnScales;
use crate::diagnose::selection::search::{Found, Search};
use crate::diagnose::selection::standing::Standing;
use crate::error::Result;

/// The held-out gap of the nominal model and of the causes found.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn gaps(
    search: &Search<'_>,
    nominal: &Model,
    found: &Found,
) -> Result<(Vec<PostureGap>, Vec<PostureGap>)> {
    Ok((nominal_gap(search, nominal)?, search.held_out(&found.fit.model, found.noise)?))
}

/// The held-out gap of the nominal model: what the session states as unknown is fitted.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn nominal_gap(search: &Search<'_>, nominal: &Model) -> Result<Vec<PostureGap>> {
    let scatter = search.effective(nominal)?;
    let (none, measured) = (Group::default(), search.detector_noise());
    held_out(&search.problem, search.catalogue, &none, nominal, scatter, measured, false)
}

/// Replaces a degenerate effect by its simpler equivalent: stiction without a dead band is compliance.
pub(crate) fn comes_down(search: &Search<'_>, found: &mut Found, after: &mut Vec<PostureGap>) -> Result<()> {
    let catalogue = search.catalogue;
    let mut model = found.fit.model.clone();
    let mut changed = false;
    for term in &mut model.terms {
        let place = catalogue.hypotheses[term.hypothesis].place;
        let Some((effect, parameters)) = catalogue.effect(term.hypothesis).comes_down_to(&term.parameters)
        else {
            continue;
        };
        if let Some(hypothesis) = catalogue.find(effect, place) {
            *term = Term { hypothesis, variant: 0.0, parameters, prior_scale: 1.0 };
            changed = true;
        }
    }
    if changed {
        found.fit = search.fit(&model, found.noise, SOLVER.without_steps)?;
        *after = search.held_out(&found.fit.model, found.noise)?;
    }
    Ok(())
}

/// Drops causes that do not help where they were not fitted. Returns the free-form errors among them without which the postures that they
/// were fitted to are far from the model: something is wrong there, in a few postures of which the others tell nothing.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn drop_useless(
    search: &mut Search<'_>,
    found: &mut Found,
    after: &mut Vec<PostureGap>,
    beside: Option<&Geometry>,
) -> Result<Vec<usize>> {
    let mut needed_there = Vec::new();
    if let Some(geometry) = by_linear_models(&search.problem, beside) {
        if drop_useless_beside(geometry, search, found)? {
            *after = search.held_out(&found.fit.model, found.noise)?;
        }
        return Ok(needed_there);
    }
    let catalogue = search.catalogue;
    let least_of = |term: &Term| match beside {
        None => LEAST_HELD_OUT_GAIN,
        Some(group) if group.setup_only => 0.0,
        Some(_) => least_gain(catalogue.effect(term.hypothesis)),
    };
    let mut i = 0;
    while i < found.fit.model.terms.len() {
        if stands_out_of(beside, search, &found.fit.model.terms[i]) {
            i += 1;
            continue;
        }
        let least = least_of(&found.fit.model.terms[i]);
        let rest = search.taken_out(&found.fit.model, i, found.noise)?;
        let without = search.fit(&rest, found.noise, SOLVER.loose_steps)?;
        // If even the fitted postures are worse, the held-out ones need not be predicted.
        let fitted =
            in_sample(&search.problem, &search.deformation(&without.model), search.detector_noise())?;
        if seen_size(&fitted) >= seen_size(after) * (1.0 + least) {
            i += 1;
            continue;
        }
        let gap = search.held_out(&without.model, found.noise)?;
        if seen_size(&gap) < seen_size(after) * (1.0 + least)
            && TEMPER * ahead_of_member(beside, search, found, (i, &rest))? <= LEAST_LOG_ODDS
        {
            let hypothesis = found.fit.model.terms[i].hypothesis;
            let name = search.catalogue.name(&search.problem.scene, hypothesis);
            found.trace.push(format!("drop {name}: no gain on held-out regions"));
            if catalogue.is_free(hypothesis) {
                let with = search.deformation(&found.fit.model);
                let with = in_sample(&search.problem, &with, search.detector_noise())?;
                if seen_size(&fitted) > ABOVE_SCATTER * seen_size(&with) {
                    needed_there.push(hypothesis);
                }
            }
            found.fit = without;
            *after = gap;
            i = 0;
        } else {
            i += 1;
        }
    }
    Ok(needed_there)
}

/// Whether what was found leaves the held-out gap no smaller than the nominal model, in the unit of the
/// observations or in metres.
pub(crate) fn named_in_vain(
    search: &Search<'_>,
    found: &Found,
    before: &[PostureGap],
    after: &[PostureGap],
) -> bool {
    let model = &found.fit.model;
    let named = model.terms.iter().any(|t| !search.catalogue.is_free(t.hypothesis));
    let (was, is) = (size(before), size(after));
    // Written so that NaN counts as no gain.
    let smaller = seen_size(after) < seen_size(before) && (is.told_m().is_none() || is.rms_m < was.rms_m);
    (named || !model.group.is_empty()) && !smaller
}

/// Takes back all named causes and small errors: the nominal model, at its own scatter (at that which the causes left everything would look
/// false). `left`: what they leave, for the trace.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn name_nothing(
    search: &Search<'_>,
    found: &mut Found,
    nominal: &Model,
    left: &str,
) -> Result<()> {
    found.trace.push(format!("no cause is named: {left}"));
    (found.fit, found.noise) = search.fit_at_its_scatter(nominal)?;
    Ok(())
}

/// Whether the named causes leave nearly all of the gap: if the remainder has no place, they only absorbed a part
/// of it, whatever their odds.
pub(crate) fn named_for_little(
    search: &Search<'_>,
    found: &Found,
    before: &[PostureGap],
    after: &[PostureGap],
) -> bool {
    let named = found.fit.model.terms.iter().any(|t| !search.catalogue.is_free(t.hypothesis));
    named && seen_size(after) > NEARLY_ALL * seen_size(before)
}

/// Whether a cause is an outlier among the small errors of the mounts: without it these would predict as well, less
/// credibly.
fn stands_out_of(beside: Option<&Geometry>, search: &Search<'_>, term: &Term) -> bool {
    beside.is_some_and(|group| group.setup_only && group.holds(search.catalogue, term.hypothesis))
}

/// By how much a cause is more probable beside the small errors everywhere than as one of them, whose scales are then estimated
/// again: many small errors imitate one that is large on held-out regions too, but only if all are larger. Nothing where these have
/// no such member.
fn ahead_of_member(
    beside: Option<&Geometry>,
    search: &Search<'_>,
    found: &Found,
    (i, rest): (usize, &Model),
) -> Result<f64> {
    let hypothesis = found.fit.model.terms[i].hypothesis;
    let holds = |group: &&Geometry| group.holds(search.catalogue, hypothesis);
    let Some(group) = beside.filter(holds) else { return Ok(f64::NEG_INFINITY) };
    let options = FitOptions { noise: found.noise, steps: SOLVER.loose_steps };
    let without = AtOwnScales::fitted(search, group, rest, options)?;
    let with = search.fit(&found.fit.model, found.noise, SOLVER.loose_steps)?;
    Ok(search.log_posterior(&with) - without.log_posterior())
}

/// The held-out gap of the named causes alone, because free-form errors cannot be added to a model. A cause that by
/// itself makes the gap no smaller only served the free-form errors, and is removed.
pub(crate) fn without_names(
    search: &Search<'_>,
    found: &mut Found,
    standings: &mut Vec<Option<Standing>>,
) -> Result<Vec<PostureGap>> {
    let is_free = |t: &Term| search.catalogue.is_free(t.hypothesis);
    let gap_of = |model: &Model| -> Result<Vec<PostureGap>> {
        let mut causes = model.clone();
        causes.terms.retain(|t| !is_free(t));
        search.held_out(&causes, found.noise)
    };
    let mut model = found.fit.model.clone();
    let mut after = gap_of(&model)?;
    let mut i = 0;
    while i < model.terms.len() {
        let rest = model.without(i);
        if is_free(&model.terms[i]) {
            i += 1;
            continue;
        }
        let without = gap_of(&rest)?;
        // It may be small compared with the free-form errors.
        if seen_size(&after) <= seen_size(&without) * (1.0 + LEAST_HELD_OUT_GAIN) {
            i += 1;
            continue;
        }
        let name = search.catalogue.name(&search.problem.scene, model.terms[i].hypothesis);
        found.trace.push(format!("drop {name}: by itself it does not make the gap smaller"));
        (model, after) = (rest, without);
        standings.remove(i);
        i = 0;
    }
    if model.terms.len() < found.fit.model.terms.len() {
        found.fit = search.fit(&model, found.noise, SOLVER.without_steps)?;
    }
    if model.group.is_empty() && model.terms.iter().all(is_free) {
        return Ok(after);
    }
    // The reported gap is that of the reported parameters, which were estimated with the free-form errors.
    let (s, measured) = (search, search.detector_noise());
    held_out(&s.problem, s.catalogue, &s.group, &found.fit.model, found.noise, measured, true)
}
