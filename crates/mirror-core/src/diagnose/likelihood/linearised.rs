//! A model's normal equations at its current values, for questions that need no fit: the evidence with some causes
//! at other sizes, with other columns in a cause's place, or without a cause.

use crate::diagnose::effects::hypothesis::{Catalogue, Model, Term};
use crate::diagnose::likelihood::factor::{cholesky, log_det, variances};
use crate::diagnose::likelihood::fit::{Active, FitOptions, Group, linearise};
use crate::diagnose::likelihood::normal_equations::{Normal, Planes, changes_sight};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::error::Result;
use core::ops::Range;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// A model's normal equations at its current values, for questions that need no fit.
pub(crate) struct Linearised {
    normal: Normal,
    active: Active,
}

impl Linearised {
    /// Linearises a model at its own parameters.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn at(
        problem: &Problem,
        catalogue: &Catalogue,
        group: &Group,
        model: &Model,
        options: FitOptions,
        mask: Option<&[bool]>,
    ) -> Result<Self> {
        let (normal, active) =
            linearise(problem, catalogue, group, model, options.noise, model.planes.as_deref(), mask)?;
        Ok(Self { normal, active })
    }

    /// The same of some parameters of normal equations `(H, g, cost)`; the others are held where they are.
    pub fn among((h, g, cost): (&DMatrix<f64>, &DVector<f64>, f64), active: &Active, kept: &[usize]) -> Self {
        let normal = Normal {
            h: DMatrix::from_fn(kept.len(), kept.len(), |a, b| h[(kept[a], kept[b])]),
            g: DVector::from_fn(kept.len(), |a, _| g[kept[a]]),
            cost,
            planes: Planes::default(),
        };
        Self { normal, active: active.among(kept) }
    }

    /// Which of the parameters are the i-th cause's.
    pub fn of_term(&self, model: &Model, i: usize) -> Range<usize> {
        let before: usize = model.terms[..i].iter().map(|t| t.parameters.len()).sum();
        let first = self.active.first_term + before;
        first..first + model.terms[i].parameters.len()
    }

    /// A model with some of its parameters at other values, and all others at the optimum of the linear model given
    /// these: `δ_r = −(H_rr + P_r)⁻¹ H_ro δ_o`. None where numbers overflow.
    ///
    /// If a cause is removed, the other parameters stay at their optimum with it. There every observation that the
    /// cause explained looks false and has no weight, so a fit from there would never find that the others can
    /// explain it as well.
    pub fn moved_with(&self, model: &Model, own: &Range<usize>, to: &[f64]) -> Option<Model> {
        let (active, h) = (&self.active, &self.normal.h);
        let rest: Vec<usize> = (0..active.values.len()).filter(|i| !own.contains(i)).collect();
        let s: Vec<f64> = rest.iter().map(|&i| active.prior_std[i]).collect();
        let mut values = active.values.clone();
        own.clone().zip(to).for_each(|(o, new)| values[o] = *new);
        let among = self.among_themselves(&rest)?;
        let pull = DVector::from_fn(rest.len(), |a, _| {
            own.clone().map(|o| h[(rest[a], o)] * (active.values[o] - values[o])).sum::<f64>() * s[a]
        });
        let change = among.solve(&pull);
        for (a, &i) in rest.iter().enumerate() {
            let value = active.values[i] + s[a] * change[a];
            values[i] = if active.positive[i] { value.max(0.0) } else { value };
        }
        values.iter().all(|v| v.is_finite()).then(|| active.model(model, &values))
    }

    /// The factor of the equations of some parameters within their priors, in units of the priors' deviations:
    /// `S H_rr S + I`. None where numbers overflow.
    fn among_themselves(&self, rest: &[usize]) -> Option<Cholesky<f64, Dyn>> {
        let (h, std) = (&self.normal.h, &self.active.prior_std);
        let among = DMatrix::from_fn(rest.len(), rest.len(), |a, b| {
            let (i, j) = (rest[a], rest[b]);
            h[(i, j)] * std[i] * std[j] + if a == b { 1.0 } else { 0.0 }
        });
        cholesky(among)
    }

    /// Where the group's parameters begin.
    pub fn first_group(&self) -> usize {
        self.active.first_group
    }

    /// The information of the data on some parameters with all others free within their priors, `A = H_oo − H_or
    /// (H_rr + P_r)⁻¹ H_ro`; none where numbers overflow.
    pub fn information_of(&self, own: &[usize]) -> Option<DMatrix<f64>> {
        let h = &self.normal.h;
        let rest: Vec<usize> = (0..self.active.values.len()).filter(|i| !own.contains(i)).collect();
        let std = |i: usize| self.active.prior_std[i];
        let across = DMatrix::from_fn(rest.len(), own.len(), |a, b| h[(rest[a], own[b])] * std(rest[a]));
        let own_block = DMatrix::from_fn(own.len(), own.len(), |a, b| h[(own[a], own[b])]);
        if rest.is_empty() {
            return Some(own_block);
        }
        let reduced = own_block - across.tr_mul(&self.among_themselves(&rest)?.solve(&across));
        reduced.iter().all(|x| x.is_finite()).then_some(reduced)
    }

    /// The value of one parameter that drives several of the columns together, and its log Bayes factor against none of
    /// them, with a prior of this standard deviation: `½ G² / (A + 1/s²) − ½ ln(1 + A s²)` with the information A on it and
    /// its gradient G, all others free within their priors but `held` ones, which stay where they are. None where
    /// numbers overflow.
    pub fn together(&self, own: &[usize], held: &[usize], std: f64) -> Option<(f64, f64)> {
        let (active, h, g) = (&self.active, &self.normal.h, &self.normal.g);
        let rest: Vec<usize> = (0..active.values.len()).filter(|i| !held.contains(i)).collect();
        let s = |i: usize| active.prior_std[i];
        let across = DVector::from_fn(rest.len(), |a, _| {
            own.iter().map(|&j| h[(rest[a], j)]).sum::<f64>() * s(rest[a])
        });
        let pull = DVector::from_fn(rest.len(), |a, _| {
            let i = rest[a];
            g[i] * s(i) - active.values[i] / s(i)
        });
        let along = self.among_themselves(&rest)?.solve(&across);
        let all: f64 = own.iter().flat_map(|&i| own.iter().map(move |&j| h[(i, j)])).sum();
        let information = (all - across.dot(&along)).max(0.0);
        let gradient = own.iter().map(|&i| g[i]).sum::<f64>() - pull.dot(&along);
        let precision = information + (std * std).recip();
        let log_bayes = 0.5 * gradient * gradient / precision - 0.5 * (1.0 + information * std * std).ln();
        (log_bayes.is_finite()).then_some((gradient / precision, log_bayes))
    }

    /// Values and variances of the parameters from `first` on at the best of the linear model, under other priors for these; none where
    /// numbers overflow.
    pub fn posterior(&self, first: usize, prior_std: &[f64]) -> Option<(Vec<f64>, Vec<f64>)> {
        let (active, h) = (&self.active, &self.normal.h);
        let count = active.values.len();
        let inside = first..first + prior_std.len();
        let s: Vec<f64> = (0..count)
            .map(|i| if inside.contains(&i) { prior_std[i - first] } else { active.prior_std[i] })
            .collect();
        let b = DVector::from_fn(count, |i, _| self.normal.g[i] * s[i] - active.values[i] / s[i]);
        let whitened =
            DMatrix::from_fn(count, count, |i, j| h[(i, j)] * s[i] * s[j] + if i == j { 1.0 } else { 0.0 });
        let factor = cholesky(whitened)?;
        let step = factor.solve(&b);
        let variances = variances(&factor, inside.clone()).into_iter();
        let variances: Vec<f64> = variances.zip(inside.clone()).map(|(v, i)| s[i] * s[i] * v).collect();
        let values: Vec<f64> = inside.map(|i| active.values[i] + s[i] * step[i]).collect();
        values.iter().chain(&variances).all(|x| x.is_finite()).then_some((values, variances))
    }

    /// Log evidence of other columns in the place of the i-th cause's, at the optimum of the linear model; `others`
    /// holds one set for each variant, as many as the cause has, after the model's own columns in the normal
    /// equations. None where numbers overflow.
    ///
    /// With r the residuals at the present parameters p of the columns X, those without the cause are `r + X p`.
    fn log_evidence_instead(&self, own: &Range<usize>, others: &Range<usize>) -> Option<f64> {
        let (active, h, g) = (&self.active, &self.normal.h, &self.normal.g);
        let rest = (0..active.values.len()).filter(|i| !own.contains(i));
        let at: Vec<usize> = rest.chain(others.clone()).collect();
        let prior = |k: usize| {
            active.prior_std[if k < active.values.len() { k } else { own.start + k - others.start }]
        };
        let value = |k: usize| if k < active.values.len() { active.values[k] } else { 0.0 };
        let without = |k: usize| g[k] + own.clone().map(|o| h[(k, o)] * active.values[o]).sum::<f64>();
        let b = DVector::from_fn(at.len(), |i, _| {
            let k = at[i];
            without(k) * prior(k) - value(k) / prior(k)
        });
        let whitened = DMatrix::from_fn(at.len(), at.len(), |i, j| {
            h[(at[i], at[j])] * prior(at[i]) * prior(at[j]) + if i == j { 1.0 } else { 0.0 }
        });
        let factor = cholesky(whitened)?;
        let log_det = log_det(&factor);
        let log = 0.5 * (b.dot(&factor.solve(&b)) - log_det);
        log.is_finite().then_some(log)
    }

    /// Log evidence at the best parameters of the linear model, the prior deviations of some of them scaled; none where numbers
    /// overflow.
    pub fn log_evidence(&self, scaled: Range<usize>, scale: f64) -> Option<f64> {
        let (active, h) = (&self.active, &self.normal.h);
        let count = active.values.len();
        let s: Vec<f64> =
            (0..count).map(|i| active.prior_std[i] * if scaled.contains(&i) { scale } else { 1.0 }).collect();
        let v = DVector::from_fn(count, |i, _| active.values[i] / s[i]);
        let b = DVector::from_fn(count, |i, _| self.normal.g[i] * s[i] - v[i]);
        let whitened =
            DMatrix::from_fn(count, count, |i, j| h[(i, j)] * s[i] * s[j] + if i == j { 1.0 } else { 0.0 });
        let factor = cholesky(whitened)?;
        let gain = b.dot(&factor.solve(&b));
        let log_det = log_det(&factor);
        let value = -0.5 * (self.normal.cost + v.norm_squared() - gain + log_det);
        value.is_finite().then_some(value)
    }
}

/// Values of a cause's discrete unknown, the most probable first: by the evidence of one linear model with the
/// columns of all of them.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn likeliest_variants(
    problem: &Problem,
    catalogue: &Catalogue,
    (group, model): (&Group, &Model),
    i: usize,
    variants: &[f64],
    noise: Noise,
    mask: Option<&[bool]>,
) -> Result<Vec<f64>> {
    let active = Active::of(problem, catalogue, group, model);
    let deformation = model.deformation(problem, catalogue, &group.columns);
    let mut columns = active.columns.clone();
    for &variant in variants {
        let term = Term { variant, ..model.terms[i].clone() };
        columns.extend(catalogue.columns(&problem.scene, &term));
    }
    let with_board = changes_sight(problem, &columns);
    let planes = model.planes.as_deref();
    let normal = Normal::at(problem, &deformation, noise, &columns, with_board, planes, mask)?;
    let here = Linearised { normal, active };
    let own = here.of_term(model, i);
    let first = here.active.columns.len();
    let mut valued: Vec<(f64, f64)> = variants
        .iter()
        .enumerate()
        .filter_map(|(k, &variant)| {
            let from = first + k * own.len();
            Some((here.log_evidence_instead(&own, &(from..from + own.len()))?, variant))
        })
        .collect();
    valued.sort_by(|a, b| b.0.total_cmp(&a.0));
    Ok(valued.into_iter().map(|v| v.1).collect())
}
