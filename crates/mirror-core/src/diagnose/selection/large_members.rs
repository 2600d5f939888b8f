//! Which of the small errors everywhere are causes of their own, the scales estimated anew with each choice.
//!
//! One zero that is off by a degree is shared out among its neighbours once the scale of all angles has grown to it, and a
//! search at that scale has no reason to name it. With it as a cause the others' scale is small again, which is far more
//! probable. So the members that were named, the one that the nominal model's scores rank first, and the largest are added to the
//! group one by one, the best first, each with its own scales: `log p(y | causes, ŝ) + log π(causes)`.

use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::likelihood::fit::FitOptions;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{BEYOND_DOUBT, LEAST_LOG_ODDS, Size, TEMPER};
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::random_effects::small_errors::single_effect;
use crate::diagnose::selection::linear_search::by_linear_models;
use crate::diagnose::selection::own_scales::AtOwnScales;
use crate::diagnose::selection::search::{Found, Search};
use crate::error::Result;
use rayon::prelude::*;

/// Members that are tried, beside those that were named: the one ranked first, and the largest.
const TRIED: Size = 3;

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
    // Each choice is a fit of all frames.
    if by_linear_models(&search.problem, Some(geometry)).is_some() {
        return Ok(None);
    }
    let catalogue = search.catalogue;
    let held = |h: usize| geometry.holds(catalogue, h);
    let model = found.fit.model.clone();
    let named: Vec<usize> = model.terms.iter().map(|t| t.hypothesis).filter(|&h| held(h)).collect();
    let mut others = model.clone();
    others.terms.retain(|t| !held(t.hypothesis));
    let with = |members: &[usize]| {
        let start = members.iter().fold(others.clone(), |model, &h| model.with(catalogue, h, 0.0));
        let options = FitOptions { noise: found.noise, steps: SOLVER.loose_steps };
        AtOwnScales::fitted(search, geometry, &start, options)
    };
    let mut best = with(&[])?;
    let mut candidates = named.clone();
    let plain = Search { group: Default::default(), ..search.clone() };
    let ranked = plain.scores(nominal, plain.effective(nominal)?)?;
    let first = ranked.iter().map(|score| score.hypothesis).find(|&h| held(h));
    for h in first.into_iter().chain(largest(&best)) {
        if !candidates.contains(&h) {
            candidates.push(h);
        }
    }
    let mut chosen: Vec<usize> = Vec::new();
    loop {
        let left = candidates.par_iter().filter(|h| !chosen.contains(h));
        let tried = left
            .map(|&h| Ok((h, with(&[&chosen[..], &[h]].concat())?)))
            .collect::<Result<Vec<(usize, AtOwnScales<'_>)>>>()?;
        let likeliest = tried.into_iter().max_by(|a, b| a.1.log_posterior().total_cmp(&b.1.log_posterior()));
        let Some((h, next)) = likeliest else { break };
        if TEMPER * (next.log_posterior() - best.log_posterior()) <= LEAST_LOG_ODDS {
            break;
        }
        chosen.push(h);
        best = next;
    }
    let before = search.log_posterior(&search.fit(&model, found.noise, SOLVER.loose_steps)?);
    let ahead = best.log_posterior() - before;
    // Several causes among many errors of which nothing is left are as probable as few among errors of a usual size; resamples of the
    // postures then find others each time.
    let needed = if chosen.len() < named.len() { -BEYOND_DOUBT } else { LEAST_LOG_ODDS / TEMPER };
    if ahead <= needed {
        return Ok(None);
    }
    let names: Vec<String> = chosen.iter().map(|&h| catalogue.name(&search.problem.scene, h)).collect();
    found
        .trace
        .push(format!("of the small errors these are causes: [{}]: log odds {ahead:.1}", names.join(", ")));
    let AtOwnScales { search: beside, geometry: own, fit } = best;
    (*search, *geometry, found.fit) = (beside, own, fit);
    Ok(Some(ahead))
}

/// The hypotheses of the group's largest members, by their values in units of the scales.
fn largest(AtOwnScales { search, geometry, fit }: &AtOwnScales<'_>) -> Vec<usize> {
    let values = &fit.model.group;
    let mut sizes: Vec<(f64, usize)> = Vec::new();
    for ((column, std), value) in geometry.group.columns.iter().zip(&geometry.group.prior_std).zip(values) {
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
