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
use crate::diagnose::criteria::cross_validation::{PostureGap, gaps_in, size};
use crate::diagnose::criteria::regions::{all_but, frames_of, only, regions};
use crate::diagnose::data::diagnosis::ChosenAnew;
use crate::diagnose::likelihood::fit::{FitOptions, fit};
use crate::diagnose::likelihood::score_test::Score;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::selection::competing::Competing;
use crate::diagnose::selection::linear_search::LinearSearch;
use crate::error::Result;
use rayon::prelude::*;

/// The gap with causes that are chosen and fitted without the region that they predict; none where nothing is named.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn chosen_anew(findings: &Findings<'_>, ranking: &[Score]) -> Result<Option<ChosenAnew>> {
    let (search, found) = (&findings.search, &findings.found);
    // Beside a lost zero the gap is that of the session as it was logged.
    let (problem, catalogue) = (findings.reported(), search.catalogue);
    let labels = regions(problem);
    let parts = frames_of(&labels);
    let named = found.fit.model.terms.iter().any(|t| !catalogue.is_free(t.hypothesis));
    if !named || parts.len() < 2 {
        return Ok(None);
    }
    let linear = LinearSearch::new(
        (search, &found.fit.model, found.noise),
        findings.geometry.as_ref(),
        &Competing::of(&findings.standings, ranking),
        &parts,
    )?;
    let gaps = (0..parts.len())
        .into_par_iter()
        .map(|region| -> Result<(bool, Vec<PostureGap>)> {
            let equations = linear.all_but(region);
            let same = |set: &Vec<usize>| set.len() == linear.found && set.iter().all(|&c| c < linear.found);
            let other = linear.search(&equations).map(|weighed| weighed.set);
            let Some(set) = other.filter(|set| !same(set)) else {
                let own = |g: &&PostureGap| labels[g.frame] == region;
                return Ok((false, findings.after.iter().filter(own).copied().collect()));
            };
            let (train, test) = (all_but(&labels, region), only(&labels, region));
            let start = linear.model_with(search, &found.fit.model, (&equations, &set));
            let options = FitOptions { noise: found.noise, steps: SOLVER.final_steps };
            let mut model = fit(problem, catalogue, &search.group, &start, options, Some(&train))?.model;
            // Free-form errors cannot be added to a model.
            model.terms.retain(|t| !catalogue.is_free(t.hypothesis));
            let deformation = model.deformation(problem, catalogue, &search.group.columns);
            Ok((true, gaps_in(problem, &deformation, search.detector_noise(), Some(&test))?))
        })
        .collect::<Result<Vec<_>>>()?;
    let gap = size(&gaps.iter().flat_map(|(_, gaps)| gaps.iter().copied()).collect::<Vec<_>>());
    let changed = gaps.iter().filter(|(changed, _)| *changed).count();
    Ok(Some(ChosenAnew { rms_m: gap.told_m(), rms_px: gap.rms_px, regions: parts.len(), changed }))
}
