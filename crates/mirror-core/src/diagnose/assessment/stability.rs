//! Stability of a verdict: the search repeated on resampled postures.
//!
//! A resample draws blocks of successive postures with replacement (block bootstrap: Künsch 1989) and repeats the
//! search on them ([`LinearSearch`] says what is selected anew and what is not). Gross mistakes, which are tried
//! exactly, have no stability.

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::likelihood::saturated::postures;
use crate::diagnose::likelihood::score_test::Score;
use crate::diagnose::principles::{LEAST_LOG_ODDS, Size};
use crate::diagnose::selection::competing::Competing;
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
    /// The same, of the term or of an alternative that the data cannot separate from it.
    pub or_rivals: Vec<Option<f64>>,
    /// Of each displaced mount that was requested.
    pub mounts: Vec<f64>,
}

/// What a resample's search found: hypotheses, and whether each mount is displaced.
type CameOut = (Vec<usize>, Vec<bool>);

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
        return Ok(Stability { terms: none.clone(), or_rivals: none, mounts: Vec::new() });
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
    let came_out: Vec<CameOut> = draws
        .into_par_iter()
        .filter_map(|weights| {
            if findings.search.problem.cancel.is_cancelled() {
                return None;
            }
            let (set, equations) = whole.search(&whole.sum(&weights))?;
            let hypotheses = set.iter().map(|&c| whole.candidates[c].hypothesis).collect();
            Some((hypotheses, displaced(&whole, &equations, &set, mounts)?))
        })
        .collect();
    findings.search.problem.cancel.check()?;
    let total = came_out.len().max(1) as f64;
    let share = |of: &dyn Fn(&CameOut) -> bool| came_out.iter().filter(|r| of(r)).count() as f64 / total;
    let of_term = |hypothesis: usize| {
        (!findings.search.catalogue.is_free(hypothesis)).then(|| share(&|r| r.0.contains(&hypothesis)))
    };
    let or_rivals = |hypothesis: usize, standing: Option<&Standing>| {
        let rivals: Vec<usize> = standing.iter().flat_map(|s| &s.rivals).map(|r| r.hypothesis).collect();
        let found = |r: &CameOut| r.0.iter().any(|h| *h == hypothesis || rivals.contains(h));
        (!findings.search.catalogue.is_free(hypothesis)).then(|| share(&found))
    };
    let with_standing =
        model.terms.iter().zip(standings.iter().map(Option::as_ref).chain(core::iter::repeat(None)));
    Ok(Stability {
        terms: model.terms.iter().map(|t| of_term(t.hypothesis)).collect(),
        or_rivals: with_standing.map(|(t, standing)| or_rivals(t.hypothesis, standing)).collect(),
        mounts: (0..mounts.len()).map(|k| share(&|r| r.1[k])).collect(),
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
        let log_det: f64 = own.l_dirty().diagonal().iter().map(|x| x.ln()).sum();
        Some(0.5 * values.dot(&own.solve(&values)) + log_det >= LEAST_LOG_ODDS)
    };
    mounts.iter().map(of_mount).collect()
}
