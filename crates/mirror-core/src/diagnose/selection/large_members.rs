//! Which of the small errors everywhere are causes of their own, the scales estimated anew with each choice.
//!
//! One zero that is off by a degree is shared out among its neighbours once the scale of all angles has grown to it, and a
//! search at that scale has no reason to name it. With it as a cause the others' scale is small again, which is far more
//! probable. So the members that were named, the one that the nominal model's scores rank first, and the largest are added to the
//! group one by one, the best first, each with its own scales: `log p(y | causes, ŝ) + log π(causes)`.

use crate::diagnose::effects::hypothesis::{Model, Term};
use crate::diagnose::likelihood::fit::{Fit, FitOptions};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{BEYOND_DOUBT, LEAST_LOG_ODDS, Size, TEMPER};
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::random_effects::small_errors::single_effect;
use crate::diagnose::selection::search::{Found, Search};
use crate::error::Result;
use rayon::prelude::*;

/// Members that are tried, beside those that were named: the one ranked first, and the largest.
const TRIED: Size = 3;

/// The group with these of its members as causes, and the fit.
struct Chosen {
    geometry: Geometry,
    fit: Fit,
    log_posterior: f64,
}

/// Chooses the causes among the members of the group anew; other causes stay. Nothing changes where no other choice is clearly more
/// probable than what was found, or with fewer causes not far less.
///
/// Also returns the log odds of the choice, where there is one.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn choose_members(
    (search, geometry): (&mut Search<'_>, &mut Geometry),
    found: &mut Found,
    nominal: &Model,
) -> Result<Option<f64>> {
    let catalogue = search.catalogue;
    let model = found.fit.model.clone();
    let (named, others): (Vec<Term>, Vec<Term>) =
        model.terms.iter().cloned().partition(|term| geometry.holds(catalogue, term));
    let with = |terms: &[Term]| -> Result<Chosen> {
        let mut own = geometry.clone();
        let mut start = model.clone();
        start.terms = others.iter().chain(terms).cloned().collect();
        let options = FitOptions { noise: found.noise, steps: SOLVER.loose_steps };
        let fit = own.fit(&search.problem, catalogue, &start, options, search.mask)?;
        let beside = Search { group: own.group.clone(), ..search.clone() };
        let log_posterior = beside.log_posterior(&fit);
        Ok(Chosen { geometry: own, fit, log_posterior })
    };
    let mut best = with(&[])?;
    let mut candidates: Vec<usize> = named.iter().map(|t| t.hypothesis).collect();
    let held = |h: usize| geometry.holds(catalogue, &zero(search, h));
    let plain = Search { group: Default::default(), ..search.clone() };
    let ranked = plain.scores(nominal, plain.effective(nominal)?)?;
    let first = ranked.iter().map(|score| score.hypothesis).find(|&h| held(h));
    for h in first.into_iter().chain(largest(search, &best)) {
        if !candidates.contains(&h) {
            candidates.push(h);
        }
    }
    let mut terms: Vec<Term> = Vec::new();
    loop {
        let left: Vec<usize> =
            candidates.iter().copied().filter(|h| !terms.iter().any(|t| t.hypothesis == *h)).collect();
        let tried = left
            .par_iter()
            .map(|&h| {
                let more: Vec<Term> = terms.iter().cloned().chain([zero(search, h)]).collect();
                Ok((h, with(&more)?))
            })
            .collect::<Result<Vec<(usize, Chosen)>>>()?;
        let likeliest = tried.into_iter().max_by(|a, b| a.1.log_posterior.total_cmp(&b.1.log_posterior));
        let Some((h, chosen)) = likeliest else { break };
        if TEMPER * (chosen.log_posterior - best.log_posterior) <= LEAST_LOG_ODDS {
            break;
        }
        terms.push(zero(search, h));
        best = chosen;
    }
    let before = search.log_posterior(&search.fit(&model, found.noise, SOLVER.loose_steps)?);
    let ahead = best.log_posterior - before;
    // Several causes among many errors of which nothing is left are as probable as few among errors of a usual size; resamples of the
    // postures then find others each time.
    let needed = if terms.len() < named.len() { -BEYOND_DOUBT } else { LEAST_LOG_ODDS / TEMPER };
    if ahead <= needed {
        return Ok(None);
    }
    let names: Vec<String> =
        terms.iter().map(|t| catalogue.name(&search.problem.scene, t.hypothesis)).collect();
    found
        .trace
        .push(format!("of the small errors these are causes: [{}]: log odds {ahead:.1}", names.join(", ")));
    (*geometry, found.fit) = (best.geometry, best.fit);
    search.group = geometry.group.clone();
    Ok(Some(ahead))
}

/// A hypothesis at zero.
fn zero(search: &Search<'_>, hypothesis: usize) -> Term {
    let parameters = vec![0.0; search.catalogue.hypotheses[hypothesis].prior_std.len()];
    Term { hypothesis, variant: 0.0, parameters, prior_scale: 1.0 }
}

/// The hypotheses of the group's largest members, by their values in units of the scales.
fn largest(search: &Search<'_>, chosen: &Chosen) -> Vec<usize> {
    let values = &chosen.fit.model.group;
    let mut sizes: Vec<(f64, usize)> = Vec::new();
    for ((column, std), value) in
        chosen.geometry.group.columns.iter().zip(&chosen.geometry.group.prior_std).zip(values)
    {
        let of = single_effect(column).and_then(|(effect, place, _)| search.catalogue.find(effect, place));
        let Some(hypothesis) = of else { continue };
        let size = (value / std).powi(2);
        match sizes.iter_mut().find(|(_, h)| *h == hypothesis) {
            Some(known) => known.0 += size,
            None => sizes.push((size, hypothesis)),
        }
    }
    sizes.sort_by(|a, b| b.0.total_cmp(&a.0));
    sizes.into_iter().take(TRIED - 1).map(|s| s.1).collect()
}
