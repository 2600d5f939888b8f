//! Pairs of causes that nearly cancel: each alone has almost no effect, so a search that adds one cause at a time
//! starts with neither.
//!
//! One linearisation gives the normal equations of all one-parameter hypotheses at once. The evidence of each pair
//! then needs only two rows and columns: with the nuisance parameters projected out, `A = XᵀX − B H⁻¹ Bᵀ`, scaled by
//! the priors, `log BF = ½ gᵀ(I + A)⁻¹ g − ½ log det(I + A)`, 2 × 2.

use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::likelihood::fit::Active;
use crate::diagnose::likelihood::normal_equations::{Normal, changes_sight};
use crate::diagnose::model::elementary::Column;
use crate::diagnose::model::problem::Noise;
use crate::diagnose::principles::SEVERAL_CAUSES;
use crate::diagnose::selection::nonparametric::log_odds;
use crate::diagnose::selection::search::{Found, Search};
use crate::error::Result;
use nalgebra::{DMatrix, DVector};

/// Two hypotheses, the most probable pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pair {
    pub hypotheses: [usize; 2],
    pub parameters: [f64; 2],
    pub log_bayes: f64,
}

/// The search from the most probable pair of causes, if the stepwise search ended with several others; none where
/// these are better.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn from_a_pair<'a>(
    search: &Search<'a>,
    found: &Found,
    nominal: &Model,
) -> Result<Option<(Search<'a>, Found)>> {
    if found.fit.model.terms.len() < SEVERAL_CAUSES || search.problem.budget.is_spent() {
        return Ok(None);
    }
    let scatter = search.effective(nominal)?;
    let Some(pair) = likeliest_pair(search, nominal, scatter)? else { return Ok(None) };
    let known = |h: usize| found.fit.model.terms.iter().any(|t| t.hypothesis == h);
    if pair.hypotheses.iter().all(|&h| known(h)) {
        return Ok(None);
    }
    let Some(start) = start_from(search, nominal, &pair) else { return Ok(None) };
    let mut other = search.clone();
    let mut result = other.run(start)?;
    let odds = log_odds((&other, &result), (search, found))?;
    let mut trace = found.trace.clone();
    trace.push(format!("search from the most probable pair of causes: log odds {odds:.1}"));
    trace.append(&mut result.trace);
    result.trace = trace;
    Ok((odds > 0.0).then_some((other, result)))
}

/// A model with the pair added; none where the linear model gives invalid parameters of camera or mirror (a pane of
/// 130 mm).
pub(crate) fn start_from(search: &Search<'_>, nominal: &Model, pair: &Pair) -> Option<Model> {
    let mut start = nominal.clone();
    for (&hypothesis, &parameter) in pair.hypotheses.iter().zip(&pair.parameters) {
        start = start.with(search.catalogue, hypothesis, search.catalogue.hypotheses[hypothesis].variants[0]);
        if let Some(term) = start.terms.last_mut() {
            term.parameters = vec![parameter];
        }
    }
    search.can_be(&start).then_some(start)
}

/// The most probable pair of one-parameter causes to add to a model, linearised there; none where there are fewer
/// than two.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
fn likeliest_pair(search: &Search<'_>, model: &Model, noise: Noise) -> Result<Option<Pair>> {
    let (problem, catalogue) = (&search.problem, search.catalogue);
    let base = Active::of(problem, catalogue, &search.group, model);
    let singles: Vec<usize> = (0..catalogue.hypotheses.len())
        .filter(|&h| {
            let hypothesis = &catalogue.hypotheses[h];
            !catalogue.is_free(h)
                && hypothesis.prior_std.len() == 1
                && hypothesis.variants.len() == 1
                && !model.terms.iter().any(|t| t.hypothesis == h)
        })
        .collect();
    let column = |h: usize| -> Option<Column> {
        let hypothesis = &catalogue.hypotheses[h];
        let columns =
            catalogue.effect(h).columns(&problem.scene, hypothesis.place, hypothesis.variants[0], &[0.0]);
        columns.into_iter().next()
    };
    let (singles, columns): (Vec<usize>, Vec<Column>) =
        singles.into_iter().filter_map(|h| column(h).map(|c| (h, c))).unzip();
    let first = base.columns.len();
    let everything: Vec<Column> = base.columns.iter().cloned().chain(columns).collect();
    let deformation = search.deformation(model);
    let with_board = changes_sight(problem, &everything);
    let planes = model.planes.as_deref();
    let normal = Normal::at(problem, &deformation, noise, &everything, with_board, planes, search.mask)?;
    let (a, g) = reduced(&normal, &base, first);
    let s: Vec<f64> = singles.iter().map(|&h| catalogue.hypotheses[h].prior_std[0]).collect();
    let positive: Vec<bool> = singles.iter().map(|&h| catalogue.effect(h).is_positive()).collect();
    let mut best: Option<Pair> = None;
    for i in 0..singles.len() {
        for j in 0..i {
            let (aii, ajj) = (1.0 + a[(i, i)] * s[i] * s[i], 1.0 + a[(j, j)] * s[j] * s[j]);
            let aij = a[(i, j)] * s[i] * s[j];
            let det = aii * ajj - aij * aij;
            let (gi, gj) = (g[i] * s[i], g[j] * s[j]);
            let (x, y) = ((ajj * gi - aij * gj) / det, (aii * gj - aij * gi) / det);
            let impossible = (positive[i] && x <= 0.0) || (positive[j] && y <= 0.0);
            let prior =
                catalogue.hypotheses[singles[i]].log_prior + catalogue.hypotheses[singles[j]].log_prior;
            let log_bayes = 0.5 * (x * gi + y * gj) - 0.5 * det.ln() + prior;
            // Written so that NaN fails the test.
            if !impossible && best.is_none_or(|b| log_bayes > b.log_bayes) && log_bayes.is_finite() {
                best = Some(Pair {
                    hypotheses: [singles[i], singles[j]],
                    parameters: [x * s[i], y * s[j]],
                    log_bayes,
                });
            }
        }
    }
    Ok(best)
}

/// Information and gradient of the parameters from `first` on, those before it projected out at their priors.
fn reduced(normal: &Normal, base: &Active, first: usize) -> (DMatrix<f64>, DVector<f64>) {
    let count = normal.g.len() - first;
    let mut a = normal.h.view((first, first), (count, count)).into_owned();
    let mut g = normal.g.rows(first, count).into_owned();
    if first == 0 {
        return (a, g);
    }
    let mut h = normal.h.view((0, 0), (first, first)).into_owned();
    let mut own = normal.g.rows(0, first).into_owned();
    base.add_priors(&mut h, &mut own);
    if let Some(factor) = h.cholesky() {
        let b = normal.h.view((first, 0), (count, first)).into_owned();
        a -= &b * factor.solve(&b.transpose());
        g -= &b * factor.solve(&own);
    }
    (a, g)
}
