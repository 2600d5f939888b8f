//! Stability of a verdict: the search repeated on resampled postures.
//!
//! A resample draws blocks of successive postures with replacement (block bootstrap: Künsch 1989) and repeats the
//! search on them ([`LinearSearch`] says what is selected anew and what is not). Gross mistakes, which are tried
//! exactly, have no stability.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::effects::hypothesis::Term;
use crate::diagnose::likelihood::factor::log_det;
use crate::diagnose::likelihood::saturated::postures;
use crate::diagnose::likelihood::score_test::Score;
use crate::diagnose::principles::{LEAST_LOG_ODDS, Size};
use crate::diagnose::selection::competing::Competing;
use crate::diagnose::selection::linear_scales::InPlace;
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

/// What a resample's search found.
struct CameOut {
    hypotheses: Vec<usize>,
    /// Each term of the model among its alternatives.
    terms: Vec<InPlace>,
    /// Whether each mount is displaced.
    displaced: Vec<bool>,
}

/// Repeats the search on resampled postures; `mounts` are columns of the group whose displacement was reported.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn stability(
    findings: &Findings<'_>,
    standings: &[Option<Standing>],
    ranking: &[Score],
    mounts: &[Vec<usize>],
) -> Result<Stability> {
    let model = &findings.found.fit.model;
    let named = model.terms.iter().filter(|t| !findings.search.catalogue.is_free(t.hypothesis)).count();
    if named == 0 && mounts.is_empty() {
        let none = vec![None; model.terms.len()];
        return Ok(Stability {
            terms: none.clone(),
            posterior: none.clone(),
            or_rivals: none,
            mounts: Vec::new(),
        });
    }
    let order = postures(&findings.search.problem);
    let size = order.len().div_ceil(MOST_BLOCKS).max(1);
    let blocks: Vec<Vec<usize>> = order.chunks(size).map(|postures| postures.concat()).collect();
    let count = blocks.len();
    let whole = LinearSearch::new(
        (&findings.search, model, findings.found.noise),
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
    let rivals_of = |i: usize| -> Vec<usize> {
        standings.get(i).into_iter().flatten().flat_map(|s| &s.rivals).map(|r| r.hypothesis).collect()
    };
    let rivals: Vec<Vec<usize>> = (0..model.terms.len()).map(rivals_of).collect();
    let came_out: Vec<CameOut> = draws
        .into_par_iter()
        .filter_map(|weights| {
            if findings.search.problem.cancel.is_cancelled() {
                return None;
            }
            let weighed = whole.search(&whole.sum(&weights))?;
            let hypotheses = weighed.set.iter().map(|&c| whole.candidates[c].hypothesis).collect();
            let of = |(i, term): (usize, &Term)| whole.in_place(&weighed, term.hypothesis, &rivals[i]);
            let terms = model.terms.iter().enumerate().map(of).collect::<Option<_>>()?;
            let displaced = displaced(&whole, &weighed.scaled.equations, &weighed.set, mounts)?;
            Some(CameOut { hypotheses, terms, displaced })
        })
        .collect();
    findings.search.problem.cancel.check()?;
    let total = came_out.len().max(1) as f64;
    let mean = |of: &dyn Fn(&CameOut) -> f64| came_out.iter().map(of).sum::<f64>() / total;
    let share = |of: &dyn Fn(&CameOut) -> bool| mean(&|r| f64::from(u8::from(of(r))));
    let or_rivals = |i: usize| {
        let of_it = |h: &usize| *h == model.terms[i].hypothesis || rivals[i].contains(h);
        share(&|r| r.hypotheses.iter().any(of_it))
    };
    let named = |i: usize| !findings.search.catalogue.is_free(model.terms[i].hypothesis);
    let count = model.terms.len();
    Ok(Stability {
        terms: (0..count).map(|i| named(i).then(|| share(&|r| r.terms[i].comes_out))).collect(),
        posterior: (0..count).map(|i| named(i).then(|| mean(&|r| r.terms[i].probability))).collect(),
        or_rivals: (0..count).map(|i| named(i).then(|| or_rivals(i))).collect(),
        mounts: (0..mounts.len()).map(|k| share(&|r| r.displaced[k])).collect(),
    })
}

/// Whether each mount is displaced: the Bayes factor of its values against none, by Savage and Dickey.
fn displaced(
    whole: &LinearSearch<'_>,
    equations: &Equations,
    set: &[usize],
    mounts: &[Vec<usize>],
) -> Option<Vec<bool>> {
    if mounts.is_empty() {
        return Some(Vec::new());
    }
    let (factor, indices) = whole.factor(equations, set)?;
    let mean = factor.solve(&DVector::from_fn(indices.len(), |i, _| equations.1[indices[i]]));
    let covariance = factor.inverse();
    let position: HashMap<usize, usize> = indices.iter().enumerate().map(|(k, i)| (*i, k)).collect();
    let of_mount = |columns: &Vec<usize>| -> Option<bool> {
        let at: Vec<usize> =
            columns.iter().map(|c| position.get(&(whole.first_group + c)).copied()).collect::<Option<_>>()?;
        let own = DMatrix::from_fn(at.len(), at.len(), |i, j| covariance[(at[i], at[j])]).cholesky()?;
        let values = DVector::from_fn(at.len(), |i, _| mean[at[i]]);
        Some(0.5 * (values.dot(&own.solve(&values)) + log_det(&own)) >= LEAST_LOG_ODDS)
    };
    mounts.iter().map(of_mount).collect()
}
