//! Stability of a verdict: the search repeated on resampled postures.
//!
//! A resample draws blocks of successive postures with replacement (block bootstrap: Künsch 1989) and repeats the
//! search on them ([`LinearSearch`] says what is selected anew and what is not). Gross mistakes, which are tried
//! exactly, have no stability.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::assessment::resampled::{MadeFor, Resampled};
use crate::diagnose::likelihood::factor::log_det;
use crate::diagnose::likelihood::saturated::postures;
use crate::diagnose::likelihood::score_test::Score;
use crate::diagnose::principles::{LEAST_LOG_ODDS, Size};
use crate::diagnose::selection::competing::Competing;
use crate::diagnose::selection::linear_scales::{InPlace, WeighedSet};
use crate::diagnose::selection::linear_search::LinearSearch;
use crate::diagnose::selection::reduced_equations::Equations;
use crate::diagnose::selection::standing::Standing;
use crate::error::Result;
use crate::random::Random;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::collections::HashMap;

/// Resamples.
pub(crate) const RESAMPLES: Size = 40;
/// Blocks of successive postures at most.
const MOST_BLOCKS: Size = 64;

/// Shares of the resamples in which the same was selected.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stability {
    /// Of each term of the model; none of free-form errors.
    pub terms: Vec<Option<f64>>,
    /// The mean of its probabilities among its alternatives: the bagged posterior.
    pub posterior: Vec<Option<f64>>,
    /// The share of the term or of an alternative that the data cannot separate from it.
    pub or_rivals: Vec<Option<f64>>,
    /// Of each displaced mount that was requested.
    pub mounts: Vec<f64>,
}

/// How stable the causes are, and the displaced `mounts`: columns of the group whose displacement was reported. The search is repeated on
/// resampled postures, unless that was done for the same causes before.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn stability(
    findings: &mut Findings<'_>,
    standings: &[Option<Standing>],
    ranking: &[Score],
    mounts: &[Vec<usize>],
) -> Result<Stability> {
    let catalogue = findings.search.catalogue;
    let hypotheses: Vec<usize> = findings.found.fit.model.terms.iter().map(|t| t.hypothesis).collect();
    let named = |i: usize| !catalogue.is_free(hypotheses[i]);
    let count = hypotheses.len();
    if !(0..count).any(named) && mounts.is_empty() {
        let none = vec![None; count];
        return Ok(Stability {
            terms: none.clone(),
            posterior: none.clone(),
            or_rivals: none,
            mounts: Vec::new(),
        });
    }
    let resampled = resamples(findings, standings, ranking)?;
    let rivals = &resampled.made_for.rivals;
    let whole = &resampled.whole;
    let found = |set: &WeighedSet, h: usize| set.set.iter().any(|&c| whole.candidates[c].hypothesis == h);
    // A search in which numbers overflow says nothing.
    let of_search = |set: &WeighedSet| -> Option<CameOut> {
        let of = |i: usize| whole.in_place(set, hypotheses[i], &rivals[i]);
        let or_rival = |i: usize| found(set, hypotheses[i]) || rivals[i].iter().any(|&h| found(set, h));
        Some(CameOut {
            terms: (0..count).map(of).collect::<Option<_>>()?,
            or_rivals: (0..count).map(or_rival).collect(),
            displaced: displaced(whole, &set.scaled.equations, &set.set, mounts)?,
        })
    };
    let came_out: Vec<CameOut> = resampled.sets.par_iter().filter_map(of_search).collect();
    let total = came_out.len().max(1) as f64;
    let mean = |of: &dyn Fn(&CameOut) -> f64| came_out.iter().map(of).sum::<f64>() / total;
    let share = |of: &dyn Fn(&CameOut) -> bool| mean(&|r| f64::from(u8::from(of(r))));
    let stability = Stability {
        terms: (0..count).map(|i| named(i).then(|| share(&|r| r.terms[i].comes_out))).collect(),
        posterior: (0..count).map(|i| named(i).then(|| mean(&|r| r.terms[i].probability))).collect(),
        or_rivals: (0..count).map(|i| named(i).then(|| share(&|r| r.or_rivals[i]))).collect(),
        mounts: (0..mounts.len()).map(|k| share(&|r| r.displaced[k])).collect(),
    };
    findings.resampled = Some(resampled);
    Ok(stability)
}

/// How the causes and mounts stand in what a resample's search found.
struct CameOut {
    /// Each term of the model among its alternatives.
    terms: Vec<InPlace>,
    /// Whether each or one of its alternatives was found.
    or_rivals: Vec<bool>,
    /// Whether each mount is displaced.
    displaced: Vec<bool>,
}

/// The search repeated on resampled postures: as it was kept, if that was for the same causes. Whoever is done with it gives it back.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(super) fn resamples(
    findings: &mut Findings<'_>,
    standings: &[Option<Standing>],
    ranking: &[Score],
) -> Result<Resampled> {
    let (geometry, fit) = (findings.geometry.as_ref(), &findings.found.fit);
    let made_for = MadeFor::of(&fit.model, standings, geometry, findings.found.noise);
    match findings.resampled.take().filter(|made| made.made_for == made_for) {
        Some(same) => Ok(same),
        None => resampled(findings, made_for, standings, ranking),
    }
}

/// Repeats the search on resampled postures.
fn resampled(
    findings: &Findings<'_>,
    made_for: MadeFor,
    standings: &[Option<Standing>],
    ranking: &[Score],
) -> Result<Resampled> {
    let problem = &findings.search.problem;
    let order = postures(problem);
    let size = order.len().div_ceil(MOST_BLOCKS).max(1);
    let blocks: Vec<Vec<usize>> = order.chunks(size).map(|postures| postures.concat()).collect();
    let count = blocks.len();
    let whole = LinearSearch::new(
        (&findings.search, &findings.found.fit.model, findings.found.noise),
        findings.geometry.as_ref(),
        &Competing::of(standings, ranking),
        &blocks,
    )?;
    let draws: Vec<Vec<f64>> = {
        let mut random = Random::new(0x5851_F42D_4C95_7F2D);
        (0..RESAMPLES)
            .map(|_| {
                let mut weights = vec![0.0; count];
                (0..count).for_each(|_| weights[random.below(count)] += 1.0);
                weights
            })
            .collect()
    };
    let searched = |weights: Vec<f64>| {
        if problem.cancel.is_cancelled() { None } else { whole.search(&whole.sum(&weights)) }
    };
    let sets: Vec<WeighedSet> = draws.into_par_iter().filter_map(searched).collect();
    problem.cancel.check()?;
    Ok(Resampled { made_for, whole, sets })
}

/// Whether each mount is displaced: the Bayes factor of its values against none, by Savage and Dickey.
fn displaced(
    whole: &LinearSearch,
    equations: &Equations,
    set: &[usize],
    mounts: &[Vec<usize>],
) -> Option<Vec<bool>> {
    if mounts.is_empty() {
        return Some(Vec::new());
    }
    let (factor, indices) = whole.factor(equations, set)?;
    let mean = factor.solve(&DVector::from_fn(indices.len(), |i, _| equations.1[indices[i]]));
    let position: HashMap<usize, usize> = indices.iter().enumerate().map(|(k, i)| (*i, k)).collect();
    let of_mount = |columns: &Vec<usize>| -> Option<bool> {
        let at: Vec<usize> =
            columns.iter().map(|c| position.get(&(whole.first_group + c)).copied()).collect::<Option<_>>()?;
        // A block of (L Lᵀ)⁻¹ by columns of L⁻¹.
        let units = DMatrix::from_fn(mean.len(), at.len(), |i, j| f64::from(u8::from(i == at[j])));
        let columns = factor.l_dirty().solve_lower_triangular(&units)?;
        let own = columns.tr_mul(&columns).cholesky()?;
        let values = DVector::from_fn(at.len(), |i, _| mean[at[i]]);
        Some(0.5 * (values.dot(&own.solve(&values)) + log_det(&own)) >= LEAST_LOG_ODDS)
    };
    mounts.iter().map(of_mount).collect()
}
