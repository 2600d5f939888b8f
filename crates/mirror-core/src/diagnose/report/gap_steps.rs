//! The gap as causes are added one by one, in the order in which they are reported.
//!
//! Each region of posture space is held out in turn. All parameters of the whole model are fitted to the other
//! regions, and the region is predicted with the first k causes of that fit, for each k. So a step shows what a
//! cause contributes to those before it, at its reported value. Nuisance parameters (unknown mounts and frames) are
//! fitted again at each step.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::criteria::cross_validation::{GapSize, PostureGap, gaps_in, size};
use crate::diagnose::criteria::fit_without_each::fit_without_each;
use crate::diagnose::criteria::regions::{all_but, only, regions};
use crate::diagnose::data::diagnosis::{Cause, GapStep};
use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::likelihood::fit::{Fit, FitOptions, Until, fit};
use crate::diagnose::model::solver::SOLVER;
use crate::error::Result;
use rayon::prelude::*;

/// The part of the model that a reported cause represents.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Part {
    /// A term, by its index.
    Term(usize),
    /// Several terms that are told as one cause.
    Terms(Vec<usize>),
    /// Columns of the group of small errors, and the terms that are reported with them.
    Group {
        /// Indices of the group's columns.
        columns: Vec<usize>,
        /// Indices of the model's terms.
        terms: Vec<usize>,
    },
    /// A gross mistake, which is undone before anything else.
    Mistake,
    /// Nothing separate: slipped rows are left out of all figures, a droop comes with its stiction.
    Nothing,
}

/// The steps; each of `causes` has its part.
///
/// A step between several gross mistakes has no figures: they are undone together.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn gap_steps(findings: &Findings<'_>, causes: &[Cause], parts: &[Part]) -> Result<Vec<GapStep>> {
    let mistakes = parts.iter().filter(|p| **p == Part::Mistake).count();
    let undone = |k: usize| parts[..k].iter().filter(|p| **p == Part::Mistake).count() == mistakes;
    let wanted: Vec<usize> = (1..parts.len()).filter(|&k| undone(k)).collect();
    let between = if wanted.is_empty() { Vec::new() } else { sizes(findings, parts, &wanted)? };
    let mut steps = vec![step(None, Some(size(&findings.before)))];
    for (k, cause) in causes.iter().enumerate() {
        let of = if k + 1 == causes.len() {
            Some(size(&findings.after))
        } else {
            wanted.iter().position(|w| *w == k + 1).map(|at| between[at])
        };
        steps.push(step(Some(format!("{}@{}", cause.effect, cause.at)), of));
    }
    Ok(steps)
}

fn step(added: Option<String>, of: Option<GapSize>) -> GapStep {
    GapStep { added, rms_m: of.and_then(|s| s.told_m()), rms_px: of.and_then(|s| s.rms_px) }
}

/// The held-out gap with the first k causes, for each k that is wanted.
fn sizes(findings: &Findings<'_>, parts: &[Part], wanted: &[usize]) -> Result<Vec<GapSize>> {
    let search = &findings.search;
    let (problem, model) = (findings.reported(), &findings.found.fit.model);
    let options = FitOptions { noise: findings.found.noise, steps: SOLVER.candidate_steps };
    let labels = regions(problem);
    let fits = fit_without_each(
        problem,
        search.catalogue,
        &search.group,
        model,
        options,
        &labels,
        Until::WithinDeviations,
    )?;
    let single = fits.len() == 1;
    let of_regions = fits
        .into_par_iter()
        .enumerate()
        .map(|(region, Fit { model: fitted, .. })| -> Result<Vec<Vec<PostureGap>>> {
            let (train, test) = (all_but(&labels, region), only(&labels, region));
            // A single region is fitted to itself.
            let train = Some(train.as_slice()).filter(|_| !single);
            wanted
                .iter()
                .map(|&k| {
                    let mut some = with_first(findings, &fitted, parts, k);
                    if !some.nuisances.is_empty() {
                        let options = FitOptions { steps: SOLVER.few_steps, ..options };
                        some = fit(problem, search.catalogue, &search.group, &some, options, train)?.model;
                    }
                    let deformation = some.deformation(problem, search.catalogue, &search.group.columns);
                    gaps_in(problem, &deformation, search.detector_noise(), Some(&test))
                })
                .collect()
        })
        .collect::<Result<Vec<_>>>()?;
    let of_step = |at: usize| of_regions.iter().flat_map(|r| r[at].iter().copied()).collect::<Vec<_>>();
    Ok((0..wanted.len()).map(|at| size(&of_step(at))).collect())
}

/// A fitted model with the first k causes only, with fixed values. Small displacements that are not reported
/// separately are in it from the first cause on; free-form errors are not in it.
fn with_first(findings: &Findings<'_>, fitted: &Model, parts: &[Part], k: usize) -> Model {
    let mut model = Model { frozen: true, planes: None, ..fitted.clone() };
    let later = &parts[k..];
    for part in later {
        if let Part::Group { columns, .. } = part {
            columns.iter().for_each(|&c| model.group[c] = 0.0);
        }
    }
    let is_later = |i: usize| {
        later.iter().any(|part| match part {
            Part::Term(own) => *own == i,
            Part::Terms(terms) | Part::Group { terms, .. } => terms.contains(&i),
            Part::Mistake | Part::Nothing => false,
        })
    };
    let mut at = 0;
    model.terms.retain(|term| {
        at += 1;
        !findings.search.catalogue.is_free(term.hypothesis) && !is_later(at - 1)
    });
    model
}
