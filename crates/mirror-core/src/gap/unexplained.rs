//! The unexplained part: where it lives, on what it depends, and whether a cause only poses as its explanation.

use super::adequacy::Adequacy;
use super::effects::Place;
use super::fit::FitOptions;
use super::freeform::free_forms;
use super::hypothesis::{Catalogue, Model};
use super::noise::effective;
use super::problem::Noise;
use super::screen::screen;
use super::search::{Found, Search};
use crate::error::Result;

/// A free-form error must gain this log Bayes factor to say where something lives.
const LEAST_LOG_BAYES: f64 = 15.0;
/// A cause that leaves more than this share of what a free-form error at its place explains is of another law.
const OTHER_LAW: f64 = 0.06;
/// A remainder whose variance is this many times the noise's is no scatter, wherever it comes from.
const LARGE_EXCESS: f64 = 1.5;
/// So many causes at one joint are a crowd.
const CROWD: usize = 3;
/// Free forms that are fitted exactly.
const REFINED: usize = 4;

/// Where the unexplained part lives.
#[derive(Debug, Clone)]
pub(crate) struct Unexplained {
    pub place: Option<Place>,
    pub depends_on: Option<String>,
}

/// Locates what a model leaves; takes causes back whose place shows another law than theirs.
///
/// # Errors
/// A camera or mirror that cannot be.
pub(crate) fn unexplained(
    search: &Search<'_>,
    found: &mut Found,
    adequacy: &Adequacy,
) -> Result<Option<Unexplained>> {
    if let Some(crowd) = crowded(search, found)? {
        return Ok(Some(crowd));
    }
    if !adequacy.significant && !adequacy.corners_significant {
        return Ok(None);
    }
    if !adequacy.significant {
        return Ok(if adequacy.corners_significant {
            Some(Unexplained { place: Some(Place::Camera), depends_on: None })
        } else {
            None
        });
    }
    let problem = &search.problem;
    // The search's causes keep their indices in the merged catalogue.
    let merged = &Catalogue::with_free_forms(search.catalogue, &problem.scene, free_forms());
    let free_only = search.catalogue.hypotheses.len();
    // Causes that a free-form error at their own place beats by far.
    let places: Vec<Option<usize>> = found
        .fit
        .model
        .terms
        .iter()
        .map(|t| search.catalogue.hypotheses[t.hypothesis].place.node())
        .collect();
    let mut nodes: Vec<usize> = places.iter().flatten().copied().collect();
    nodes.sort_unstable();
    nodes.dedup();
    let mut location = None;
    for node in nodes {
        let at = |t: &super::hypothesis::Term| {
            search.catalogue.hypotheses[t.hypothesis].place.node() == Some(node)
        };
        let mut rest = found.fit.model.clone();
        rest.terms.retain(|t| !at(t));
        let Some((place, on, share)) = beaten(search, found, &rest, merged, node)? else { continue };
        let names: Vec<String> = found
            .fit
            .model
            .terms
            .iter()
            .filter(|t| at(t))
            .map(|t| search.catalogue.name(&problem.scene, t.hypothesis))
            .collect();
        found.trace.push(format!(
            "{} left {:.0} % of what a free-form error there explains: another law",
            names.join(", "),
            share * 100.0
        ));
        location = Some((place, on));
        found.fit = search.fit(&rest, found.noise, 6)?;
    }
    if location.is_none() {
        let scores = screen(problem, merged, &search.group, &found.fit.model, found.noise, None)?;
        location =
            scores.iter().find(|s| s.hypothesis >= free_only).filter(|s| s.log_bayes > LEAST_LOG_BAYES).map(
                |s| (merged.hypotheses[s.hypothesis].place, merged.effect(s.hypothesis).name().to_owned()),
            );
    }
    // A small remainder that no free form finds a structure in is scatter: coloured noise, postures not quite settled.
    if location.is_none() && adequacy.excess < LARGE_EXCESS && !adequacy.corners_significant {
        return Ok(None);
    }
    let (place, depends_on) = location.map_or((None, None), |(p, d)| (Some(p), Some(d)));
    Ok(Some(Unexplained { place, depends_on }))
}

/// Whether a free-form error at a node, in place of the causes there, explains much more than they do.
fn beaten(
    search: &Search<'_>,
    found: &Found,
    rest: &Model,
    merged: &Catalogue,
    node: usize,
) -> Result<Option<(Place, String, f64)>> {
    let problem = &search.problem;
    let noise = effective(problem, &search.deformation(&found.fit.model), search.measured_noise, None)?;
    let options = FitOptions { noise, steps: 5 };
    let without = super::fit::fit(problem, merged, &search.group, rest, options, None)?;
    let with = super::fit::fit(problem, merged, &search.group, &found.fit.model, options, None)?;
    let first_free = search.catalogue.hypotheses.len();
    let mut best: Option<(f64, Place, String)> = None;
    let mut tried = 0;
    for (h, hypothesis) in merged.hypotheses.iter().enumerate().skip(first_free) {
        if hypothesis.place.node() != Some(node) || tried == REFINED {
            continue;
        }
        tried += 1;
        let candidate = rest.with(merged, h, 0.0);
        let fitted = super::fit::fit(problem, merged, &search.group, &candidate, options, None)?;
        if best.as_ref().is_none_or(|(cost, ..)| fitted.cost < *cost) {
            best = Some((fitted.cost, hypothesis.place, merged.effect(h).name().to_owned()));
        }
    }
    Ok(best.and_then(|(cost, place, on)| {
        let possible = without.cost - cost;
        let share = (with.cost - cost) / possible.max(1e-9);
        (possible > 2.0 * LEAST_LOG_BAYES && share > OTHER_LAW).then_some((place, on, share))
    }))
}

/// Three or more causes at one joint are no causes: together they only imitate the law that is really there.
fn crowded(search: &Search<'_>, found: &mut Found) -> Result<Option<Unexplained>> {
    let place = |t: &super::hypothesis::Term| search.catalogue.hypotheses[t.hypothesis].place;
    let terms = &found.fit.model.terms;
    let crowd = terms
        .iter()
        .map(place)
        .filter_map(Place::node)
        .find(|&node| terms.iter().filter(|t| place(t).node() == Some(node)).count() >= CROWD);
    let Some(node) = crowd else { return Ok(None) };
    let mut rest = found.fit.model.clone();
    rest.terms.retain(|t| place(t).node() != Some(node));
    let retracted: Vec<String> = terms
        .iter()
        .filter(|t| place(t).node() == Some(node))
        .map(|t| search.catalogue.name(&search.problem.scene, t.hypothesis))
        .collect();
    found.trace.push(format!("{} together imitate a law that the vocabulary has not", retracted.join(", ")));
    found.fit = search.fit(&rest, found.noise, 6)?;
    let depends_on = Some("position".to_owned());
    Ok(Some(Unexplained { place: Some(Place::Joint(node)), depends_on }))
}

/// The best model in which a free-form error at one joint or marker stands in the place of the causes there: its log
/// posterior (the free form as one more cause) and the place.
///
/// # Errors
/// A camera or mirror that cannot be.
pub(crate) fn best_free_form(
    search: &Search<'_>,
    model: &Model,
    noise: Noise,
) -> Result<Option<(f64, Place)>> {
    let problem = &search.problem;
    let merged = &Catalogue::with_free_forms(search.catalogue, &problem.scene, free_forms());
    let first_free = search.catalogue.hypotheses.len();
    let scores = screen(problem, merged, &search.group, model, noise, None)?;
    let mut best: Option<(f64, Place)> = None;
    let mut nodes: Vec<Option<usize>> =
        model.terms.iter().map(|t| search.catalogue.hypotheses[t.hypothesis].place.node()).collect();
    nodes.retain(Option::is_some);
    let from_screen =
        scores.iter().filter(|s| s.hypothesis >= first_free).take(REFINED).map(|s| s.hypothesis);
    let at_causes = (first_free..merged.hypotheses.len()).filter(|&h| {
        let node = merged.hypotheses[h].place.node();
        node.is_some() && nodes.contains(&node)
    });
    let mut tried: Vec<usize> = from_screen.chain(at_causes).collect();
    tried.sort_unstable();
    tried.dedup();
    for h in tried {
        let place = merged.hypotheses[h].place;
        let mut rest = model.clone();
        rest.terms.retain(|t| {
            let at = search.catalogue.hypotheses[t.hypothesis].place;
            at != place && (at.node().is_none() || at.node() != place.node())
        });
        let prior: f64 = rest.terms.iter().map(|t| search.catalogue.hypotheses[t.hypothesis].log_prior).sum();
        let candidate = rest.with(merged, h, 0.0);
        let fitted = super::fit::fit(
            problem,
            merged,
            &search.group,
            &candidate,
            FitOptions { noise, steps: 4 },
            None,
        )?;
        let value = fitted.log_evidence + prior + merged.hypotheses[h].log_prior;
        if best.as_ref().is_none_or(|(b, _)| value > *b) {
            best = Some((value, place));
        }
    }
    Ok(best)
}
