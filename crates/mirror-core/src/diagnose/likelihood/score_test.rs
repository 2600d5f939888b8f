//! Screening: the score test of every effect at every place at once, given the causes that the model already
//! contains.
//!
//! For a hypothesis with columns X and the model's active columns C (nuisance parameters, group, causes), all
//! whitened and with each frame's mirror projected out, the test needs only `XᵀX`, `XᵀC` and `Xᵀr`: no fit.
//! They are [summed](ScoreSums) over the frames once for all hypotheses.
//!
//! Source: the score (Lagrange multiplier) test, Rao 1948; the evidence is that of the linearised model.

use crate::diagnose::effects::hypothesis::{Catalogue, Model};
use crate::diagnose::likelihood::factor::log_det;
use crate::diagnose::likelihood::fit::{Active, Group};
use crate::diagnose::likelihood::score_sums::{CandidateSums, ScoreSums};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::error::Result;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// The result of the score test of one hypothesis.
#[derive(Debug, Clone)]
pub(crate) struct Score {
    pub hypothesis: usize,
    pub variant: f64,
    /// Log Bayes factor of the model with this cause against the model without it, linearised.
    pub log_bayes: f64,
    /// The linearised estimate.
    pub parameters: Vec<f64>,
    /// The information on the parameters with everything in the model free: the inverse of their covariance.
    pub information: DMatrix<f64>,
    /// `L⁻¹ B`: by how much all that the model already contains changes with the parameters.
    pub beside: DMatrix<f64>,
}

/// What a further cause does to values of the model, linearised.
pub(crate) struct WithCause {
    /// By how much they move with it at its estimate.
    pub moves: DVector<f64>,
    /// By how much their variances grow.
    pub adds_variance: DVector<f64>,
}

/// The Cholesky factor L of the model's columns, and `L⁻¹ g` of its gradient.
type Base = (Cholesky<f64, Dyn>, DVector<f64>);

/// All hypotheses scored, best first, given the model.
pub(crate) struct Screening {
    pub scores: Vec<Score>,
    /// The misfit of the model at its current values; none if a fit of it changes which of the board's corners are
    /// visible.
    pub misfit: Option<f64>,
    base: Option<Base>,
    /// All that the model has already.
    pub active: Active,
}

impl Screening {
    /// The values of all that the model has already, moved along with a hypothesis at its estimate, linearised: by `L⁻ᵀ (L⁻¹ g − L⁻¹ B p)`.
    /// None where numbers overflow.
    pub fn moved_along(&self, score: &Score) -> Option<Vec<f64>> {
        let estimate = DVector::from_column_slice(&score.parameters);
        self.moved(&(&self.base.as_ref()?.1 - &score.beside * estimate))
    }

    /// What a hypothesis would do to the model's values from the `first` on: with `D = −L⁻ᵀ L⁻¹ B` they move by `D p̂`, and their variances grow by
    /// those of `D (A + S⁻²)⁻¹ Dᵀ`, where S are the deviations of its prior. None where numbers overflow.
    pub fn with_cause(
        &self,
        score: &Score,
        prior_std: impl Iterator<Item = f64>,
        first: usize,
    ) -> Option<WithCause> {
        let by = self.base.as_ref()?.0.l_dirty().tr_solve_lower_triangular(&score.beside)?;
        let by = -by.rows_range(first..);
        let mut posterior = score.information.clone();
        prior_std.enumerate().for_each(|(i, std)| posterior[(i, i)] += 1.0 / (std * std));
        let covariance = posterior.cholesky()?.inverse();
        let moves = &by * DVector::from_column_slice(&score.parameters);
        let adds_variance = (&by * covariance).component_mul(&by).column_sum();
        let finite = moves.iter().chain(adds_variance.iter()).all(|x| x.is_finite());
        finite.then_some(WithCause { moves, adds_variance })
    }

    /// The same without any hypothesis.
    pub fn at_rest(&self) -> Option<Vec<f64>> {
        self.moved(&self.base.as_ref()?.1)
    }

    fn moved(&self, left: &DVector<f64>) -> Option<Vec<f64>> {
        let (factor, _) = self.base.as_ref()?;
        let step = factor.l_dirty().tr_solve_lower_triangular(left)?;
        let values = self.active.values_moved_by(&step);
        values.iter().all(|x| x.is_finite()).then_some(values)
    }
}

/// Scores all hypotheses that are not yet in the model, best first, given the model; its parameters move with each
/// of them.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn screen(
    problem: &Problem,
    catalogue: &Catalogue,
    group: &Group,
    model: &Model,
    noise: Noise,
    mask: Option<&[bool]>,
) -> Result<Screening> {
    let sums = ScoreSums::at(problem, catalogue, group, model, noise, mask)?;
    let known: Vec<usize> = model.terms.iter().map(|t| t.hypothesis).collect();
    Ok(scored(&sums, catalogue, &known, &[]))
}

/// All hypotheses but the `known` ones scored, best first; `out` are parameters of the model that are taken out: they are 0, and
/// cannot move.
pub(crate) fn scored(sums: &ScoreSums, catalogue: &Catalogue, known: &[usize], out: &[usize]) -> Screening {
    let all = &sums.active;
    let kept: Vec<usize> = (0..all.columns.len()).filter(|i| !out.contains(i)).collect();
    let active = all.among(&kept);
    // What a gradient gains once those are 0.
    let pulled = |own: &dyn Fn(usize) -> f64| -> f64 { out.iter().map(|&o| own(o) * all.values[o]).sum() };
    let mut h = DMatrix::from_fn(kept.len(), kept.len(), |a, b| sums.h[(kept[a], kept[b])]);
    let mut g = DVector::from_fn(kept.len(), |a, _| sums.g[kept[a]] + pulled(&|o| sums.h[(kept[a], o)]));
    active.add_priors(&mut h, &mut g);
    let base = h.cholesky().and_then(|factor| {
        let along = factor.l_dirty().solve_lower_triangular(&g)?;
        Some((factor, along))
    });
    let candidates = sums.candidates.iter().filter(|c| !known.contains(&c.hypothesis));
    let mut scores: Vec<Score> = candidates
        .map(|candidate| {
            let g =
                DVector::from_fn(candidate.g.len(), |k, _| candidate.g[k] + pulled(&|o| candidate.b[(o, k)]));
            let b = if out.is_empty() { candidate.b.clone() } else { candidate.b.select_rows(&kept) };
            score(candidate, (g, b), catalogue, base.as_ref())
        })
        .collect();
    scores.sort_by(|x, y| y.log_bayes.total_cmp(&x.log_bayes));
    let misfit = (sums.comparable && out.is_empty()).then(|| sums.cost + active.penalty(&active.values));
    Screening { scores, misfit, base, active }
}

/// The score of one hypothesis at the most probable scale of its prior, with the gradient of its parameters and the products of the
/// model's columns with its own.
fn score(
    candidate: &CandidateSums,
    (mut g, b): (DVector<f64>, DMatrix<f64>),
    catalogue: &Catalogue,
    base: Option<&Base>,
) -> Score {
    let mut a = candidate.a.clone();
    a.fill_lower_triangle_with_upper_triangle();
    let mut beside = DMatrix::zeros(b.nrows(), b.ncols());
    if let Some((factor, along)) = base
        && b.nrows() > 0
        && let Some(b) = factor.l_dirty().solve_lower_triangular(&b)
    {
        a -= b.tr_mul(&b);
        g -= b.tr_mul(along);
        beside = b;
    }
    let usual = DVector::from_column_slice(&catalogue.hypotheses[candidate.hypothesis].prior_std);
    let scales = catalogue.prior_scales(candidate.hypothesis);
    let at_scale = |scale: &f64| (evidence(candidate.positive, (&a, &g), &(&usual * *scale)), *scale);
    let by_evidence = |x: &(Evidence, f64), y: &(Evidence, f64)| x.0.0.total_cmp(&y.0.0);
    let best = scales.iter().map(at_scale).max_by(by_evidence);
    let ((log_bayes, parameters), scale) = best.unwrap_or(((f64::NEG_INFINITY, vec![0.0; g.len()]), 1.0));
    let variant = if scales.len() > 1 { scale } else { candidate.variant };
    Score { beside, hypothesis: candidate.hypothesis, variant, log_bayes, parameters, information: a }
}

/// Log Bayes factor, and the estimate that belongs to it.
type Evidence = (f64, Vec<f64>);

/// The evidence of the linear model `a p = g` with a prior of these standard deviations.
fn evidence(positive: bool, (a, g): (&DMatrix<f64>, &DVector<f64>), std: &DVector<f64>) -> Evidence {
    let k = g.len();
    let unit = |i: usize, j: usize| if i == j { 1.0 } else { 0.0 };
    let scaled = DMatrix::from_fn(k, k, |i, j| a[(i, j)] * std[i] * std[j] + unit(i, j));
    let scaled_g = g.component_mul(std);
    let Some(factor) = scaled.clone().cholesky() else { return (f64::NEG_INFINITY, vec![0.0; k]) };
    let mut solution = factor.solve(&scaled_g);
    if positive && k > 1 {
        solution = not_negative(&scaled, &scaled_g, solution);
    }
    let estimate = solution.component_mul(std);
    let impossible = positive && estimate.iter().all(|value| *value <= 0.0);
    let gain = if impossible { 0.0 } else { 0.5 * scaled_g.dot(&solution) };
    (gain - 0.5 * log_det(&factor), estimate.as_slice().to_vec())
}

/// The solution of `A x = g` where no x may be negative: those that would be are held at 0, and the others solved for once more.
fn not_negative(a: &DMatrix<f64>, g: &DVector<f64>, unbound: DVector<f64>) -> DVector<f64> {
    let mut solution = unbound;
    let mut free: Vec<usize> = (0..g.len()).collect();
    while free.iter().any(|&i| solution[i] < 0.0) {
        free.retain(|&i| solution[i] > 0.0);
        let among = DMatrix::from_fn(free.len(), free.len(), |i, j| a[(free[i], free[j])]);
        let own = DVector::from_fn(free.len(), |i, _| g[free[i]]);
        let Some(factor) = among.cholesky() else { return DVector::zeros(g.len()) };
        let part = factor.solve(&own);
        solution.fill(0.0);
        free.iter().zip(part.iter()).for_each(|(&i, x)| solution[i] = *x);
    }
    solution
}
