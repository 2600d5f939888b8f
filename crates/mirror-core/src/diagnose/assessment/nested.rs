//! Nested cross-validation: the gap on postures that took no part in the selection of the causes either.
//!
//! For each region of posture space the search is repeated on the others ([`LinearSearch`], from the causes found
//! and from nothing). The model with the causes selected there is fitted to the other regions and predicts this one.
//! If the same causes are selected, this is the held-out gap of the causes found; if not, the selection depends on
//! the region. Chosen on all postures are the observations left out as false, the hypotheses that compete, and the
//! kinds of random effects (free mounts, small errors everywhere).
//!
//! The figure estimates how well the method predicts postures of another kind. It is reported beside the gap of the
//! causes found and does not replace it: a zero and a gear's ratio may be inseparable in all regions but one, which
//! separates them without doubt.
//!
//! Source: nested cross-validation, Varma and Simon, "Bias in error estimation when using cross-validation for model
//! selection" (2006).

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::linear_search::{Equations, LinearSearch};
use crate::diagnose::criteria::cross_validation::{PostureGap, gap_of, size};
use crate::diagnose::criteria::regions::regions;
use crate::diagnose::data::diagnosis::ChosenAnew;
use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::likelihood::fit::{Active, FitOptions, fit};
use crate::diagnose::likelihood::saturated::free_markers;
use crate::diagnose::likelihood::score_test::Score;
use crate::diagnose::model::solver::SOLVER;
use crate::error::Result;
use rayon::prelude::*;

/// The gap with causes that are chosen and fitted without the region that they predict; none where nothing is named.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn chosen_anew(findings: &Findings<'_>, ranking: &[Score]) -> Result<Option<ChosenAnew>> {
    let (search, found) = (&findings.search, &findings.found);
    let (problem, catalogue) = (&search.problem, search.catalogue);
    let labels = regions(problem);
    let count = labels.iter().max().map_or(0, |m| m + 1);
    let named = found.fit.model.terms.iter().any(|t| !catalogue.is_free(t.hypothesis));
    if !named || count < 2 {
        return Ok(None);
    }
    let of = |r: usize| (0..labels.len()).filter(|&f| labels[f] == r).collect();
    let parts: Vec<Vec<usize>> = (0..count).map(of).collect();
    let linear = LinearSearch::new(findings, &findings.standings, ranking, &parts)?;
    let gaps = (0..count)
        .into_par_iter()
        .map(|region| -> Result<(bool, Vec<PostureGap>)> {
            let weights: Vec<f64> = (0..count).map(|r| if r == region { 0.0 } else { 1.0 }).collect();
            let equations = linear.sum(&weights);
            let same = |set: &Vec<usize>| set.len() == linear.found && set.iter().all(|&c| c < linear.found);
            let Some((set, _)) = linear.search(&equations).filter(|(set, _)| !same(set)) else {
                let own = |g: &&PostureGap| labels[g.frame] == region;
                return Ok((false, findings.after.iter().filter(own).copied().collect()));
            };
            let train: Vec<bool> = labels.iter().map(|l| *l != region).collect();
            let test: Vec<bool> = labels.iter().map(|l| *l == region).collect();
            let start = with_causes(findings, &linear, (&equations, &set));
            let options = FitOptions { noise: found.noise, steps: SOLVER.final_steps };
            let mut model = fit(problem, catalogue, &search.group, &start, options, Some(&train))?.model;
            // Free-form errors cannot be added to a model.
            model.terms.retain(|t| !catalogue.is_free(t.hypothesis));
            let deformation = search.deformation(&model);
            let seen = free_markers(problem, &deformation, search.detector_noise(), true, Some(&test))?;
            Ok((true, seen.iter().map(gap_of).collect()))
        })
        .collect::<Result<Vec<_>>>()?;
    let gap = size(&gaps.iter().flat_map(|(_, gaps)| gaps.iter().copied()).collect::<Vec<_>>());
    let changed = gaps.iter().filter(|(changed, _)| *changed).count();
    Ok(Some(ChosenAnew { rms_m: gap.told_m(), rms_px: gap.rms_px, regions: count, changed }))
}

/// The model found with a set of candidates in place of its causes, its parameters where the linear model has them.
fn with_causes(
    findings: &Findings<'_>,
    linear: &LinearSearch<'_>,
    (equations, set): (&Equations, &[usize]),
) -> Model {
    let (search, found) = (&findings.search, &findings.found.fit.model);
    let catalogue = search.catalogue;
    let mut model = found.clone();
    let chosen = |h: usize| set.iter().any(|&c| linear.candidates[c].hypothesis == h);
    model.terms.retain(|t| catalogue.is_free(t.hypothesis) || chosen(t.hypothesis));
    for candidate in set.iter().map(|&c| &linear.candidates[c]) {
        if !model.terms.iter().any(|t| t.hypothesis == candidate.hypothesis) {
            model = model.with(catalogue, candidate.hypothesis, candidate.variant);
        }
    }
    let Some(best) = linear.values(equations, set) else { return model };
    let active = Active::of(&search.problem, catalogue, &search.group, &model);
    let mut values = active.values.clone();
    values[..active.first_term].copy_from_slice(&best[..active.first_term]);
    let mut at = active.first_term;
    for term in &model.terms {
        let own = at..at + term.parameters.len();
        at = own.end;
        if let Some(&c) = set.iter().find(|&&c| linear.candidates[c].hypothesis == term.hypothesis) {
            values[own].copy_from_slice(&best[linear.candidates[c].columns.clone()]);
        }
    }
    for (value, positive) in values.iter_mut().zip(&active.positive) {
        *value = if *positive { value.max(0.0) } else { *value };
    }
    let moved = Model { planes: None, ..active.model(&model, &values) };
    if search.can_be(&moved) { moved } else { model }
}
