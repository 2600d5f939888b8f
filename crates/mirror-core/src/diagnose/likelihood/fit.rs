//! The exact fit of a model: damped Gauss–Newton on all causes and nuisances at once, and its marginal likelihood.

use crate::diagnose::effects::hypothesis::{Catalogue, Model, Term, nuisances};
use crate::diagnose::likelihood::normal_equations::{Normal, needs_board};
use crate::diagnose::model::camera_and_mirror::FootPoints;
use crate::diagnose::model::elementary::Column;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::solver::SOLVER;
use crate::error::Result;

use core::ops::Range;
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

/// The group of many small errors that is fitted beside the causes: columns with a common spread each.
#[derive(Debug, Clone, Default)]
pub(crate) struct Group {
    pub columns: Vec<Column>,
    pub prior_std: Vec<f64>,
}

/// How to fit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FitOptions {
    pub noise: Noise,
    pub steps: usize,
}

/// A fitted model.
#[derive(Debug, Clone)]
pub(crate) struct Fit {
    pub model: Model,
    /// Log marginal likelihood (Laplace), up to a constant that all models of the recording share.
    pub log_evidence: f64,
    /// −2 log likelihood with the priors' penalty: what the parameters leave.
    pub misfit: f64,
    /// Covariance of all parameters: nuisances, group, then the terms' in order.
    pub covariance: DMatrix<f64>,
    /// Where the terms' parameters begin in it.
    pub first_term: usize,
}

impl Fit {
    /// Standard deviations of the i-th cause's parameters.
    pub fn stds(&self, term: usize) -> Vec<f64> {
        let before: usize = self.model.terms[..term].iter().map(|t| t.parameters.len()).sum();
        let first = self.first_term + before;
        (0..self.model.terms[term].parameters.len())
            .map(|k| self.covariance[(first + k, first + k)].max(0.0).sqrt())
            .collect()
    }
}

/// Columns, priors and current values of a model, in the order nuisances, group, terms.
pub(crate) struct Active {
    pub columns: Vec<Column>,
    pub prior_std: Vec<f64>,
    pub values: Vec<f64>,
    pub positive: Vec<bool>,
    pub first_group: usize,
    pub first_term: usize,
}

impl Active {
    pub fn of(problem: &Problem, catalogue: &Catalogue, group: &Group, model: &Model) -> Self {
        let mut out = Self {
            columns: Vec::new(),
            prior_std: Vec::new(),
            values: Vec::new(),
            positive: Vec::new(),
            first_group: 0,
            first_term: 0,
        };
        for ((column, std), value) in nuisances(problem).into_iter().zip(&model.nuisances) {
            out.push(column, std, *value, false);
        }
        out.first_group = out.columns.len();
        out.first_term = out.first_group;
        if model.frozen {
            return out;
        }
        if !model.group.is_empty() {
            for ((column, std), value) in group.columns.iter().zip(&group.prior_std).zip(&model.group) {
                out.push(column.clone(), *std, *value, false);
            }
        }
        out.first_term = out.columns.len();
        for term in &model.terms {
            let positive = catalogue.effect(term.hypothesis).is_positive();
            let stds = &catalogue.hypotheses[term.hypothesis].prior_std;
            let columns = catalogue.columns(&problem.scene, term);
            for ((column, std), value) in columns.into_iter().zip(stds).zip(&term.parameters) {
                out.push(column, *std * term.prior_scale, *value, positive);
            }
        }
        out
    }

    fn push(&mut self, column: Column, std: f64, value: f64, positive: bool) {
        self.columns.push(column);
        self.prior_std.push(std);
        self.values.push(value);
        self.positive.push(positive);
    }

    /// Adds the priors to normal equations whose first columns are these.
    pub fn add_priors(&self, h: &mut DMatrix<f64>, g: &mut DVector<f64>) {
        for (i, (value, std)) in self.values.iter().zip(&self.prior_std).enumerate() {
            let weight = std.powi(-2);
            h[(i, i)] += weight;
            g[i] -= value * weight;
        }
    }

    fn penalty(&self, values: &[f64]) -> f64 {
        values.iter().zip(&self.prior_std).map(|(v, s)| (v / s).powi(2)).sum()
    }

    /// The model with these values.
    fn model(&self, like: &Model, values: &[f64]) -> Model {
        let mut model = like.clone();
        model.nuisances.copy_from_slice(&values[..self.first_group]);
        if model.frozen {
            return model;
        }
        model.group.copy_from_slice(&values[self.first_group..self.first_term]);
        let mut at = self.first_term;
        for term in &mut model.terms {
            let count = term.parameters.len();
            term.parameters.copy_from_slice(&values[at..at + count]);
            at += count;
        }
        model
    }
}

/// Fits all parameters of a model to the frames that count.
///
/// Minimises `−2 log L + Σ (θ/σ₀)²` by damped Gauss–Newton, reweighted by the mixture likelihood; parameters that cannot be
/// negative are held at 0 where they would be. The evidence is Laplace's:
/// `log Z = −(cost + penalty)/2 − ½ log det(I + S A S)`, `S = diag σ₀`, A the information of the data.
///
/// # Errors
/// A camera or mirror that cannot be.
pub(crate) fn fit(
    problem: &Problem,
    catalogue: &Catalogue,
    group: &Group,
    start: &Model,
    options: FitOptions,
    mask: Option<&[bool]>,
) -> Result<Fit> {
    fit_below(problem, catalogue, group, start, options, mask, f64::INFINITY)
}

/// As [`fit`], given up once it is clear that the misfit will not come below `hopeless`.
///
/// # Errors
/// A camera or mirror that cannot be.
pub(crate) fn fit_below(
    problem: &Problem,
    catalogue: &Catalogue,
    group: &Group,
    start: &Model,
    options: FitOptions,
    mask: Option<&[bool]>,
    hopeless: f64,
) -> Result<Fit> {
    let mut model = start.clone();
    let mut damping = 1e-9;
    let start = model.planes.take();
    let (mut normal, mut active) =
        linearise(problem, catalogue, group, &model, options.noise, start.as_deref(), mask)?;
    for taken in 0..options.steps {
        if active.values.is_empty() {
            break;
        }
        let current = normal.cost + active.penalty(&active.values);
        let mut moved = false;
        for _ in 0..6 {
            let Some((step, gain)) = step(&normal, &active, damping) else { break };
            if taken > 0 && current - SOLVER.most_hoped * gain > hopeless {
                break;
            }
            let values: Vec<f64> = active
                .values
                .iter()
                .zip(step.iter())
                .zip(&active.positive)
                .map(|((v, s), positive)| if *positive { (v + s).max(0.0) } else { v + s })
                .collect();
            let next = active.model(&model, &values);
            if gain < SOLVER.last_gain {
                normal.cost = current - gain - active.penalty(&values);
                (model, active.values) = (next, values);
                break;
            }
            let change: Vec<f64> = values.iter().zip(&active.values).map(|(new, old)| new - old).collect();
            let planes = (!normal.planes.feet.is_empty()).then(|| normal.planes.after(&change));
            let Ok((next_normal, next_active)) =
                linearise(problem, catalogue, group, &next, options.noise, planes.as_ref(), mask)
            else {
                damping = (damping * 100.0).max(1e-4);
                continue;
            };
            let cost = next_normal.cost + next_active.penalty(&next_active.values);
            if cost <= current + 1e-9 * current.abs() {
                let small = current - cost < 1e-3;
                (model, normal, active) = (next, next_normal, next_active);
                damping *= 0.1;
                moved = !small;
                break;
            }
            damping = (damping * 100.0).max(1e-4);
        }
        if !moved {
            break;
        }
    }
    // The planes of frames that did not count are not known.
    if mask.is_none() && !normal.planes.feet.is_empty() {
        model.planes = Some(Arc::new(core::mem::take(&mut normal.planes.feet)));
    }
    Ok(summary(model, &normal, &active))
}

/// A model's normal equations where it stands: for questions that need no fit.
pub(crate) struct Linearised {
    normal: Normal,
    active: Active,
}

impl Linearised {
    /// Linearises a model at its own parameters.
    ///
    /// # Errors
    /// A camera or mirror that cannot be.
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

    /// Which of the parameters are the i-th cause's.
    pub fn of_term(&self, model: &Model, i: usize) -> Range<usize> {
        let before: usize = model.terms[..i].iter().map(|t| t.parameters.len()).sum();
        let first = self.active.first_term + before;
        first..first + model.terms[i].parameters.len()
    }

    /// Where the group's parameters begin.
    pub fn first_group(&self) -> usize {
        self.active.first_group
    }

    /// What the data tell of some parameters once all others are free within their priors, `A = H_oo − H_or (H_rr + P_r)⁻¹ H_ro`;
    /// none where numbers overflow.
    pub fn information_of(&self, own: &[usize]) -> Option<DMatrix<f64>> {
        let h = &self.normal.h;
        let rest: Vec<usize> = (0..self.active.values.len()).filter(|i| !own.contains(i)).collect();
        let std = |i: usize| self.active.prior_std[i];
        let among = DMatrix::from_fn(rest.len(), rest.len(), |a, b| {
            let (i, j) = (rest[a], rest[b]);
            h[(i, j)] * std(i) * std(j) + if a == b { 1.0 } else { 0.0 }
        });
        let across = DMatrix::from_fn(rest.len(), own.len(), |a, b| h[(rest[a], own[b])] * std(rest[a]));
        let own_block = DMatrix::from_fn(own.len(), own.len(), |a, b| h[(own[a], own[b])]);
        if rest.is_empty() {
            return Some(own_block);
        }
        let reduced = own_block - across.tr_mul(&among.cholesky()?.solve(&across));
        reduced.iter().all(|x| x.is_finite()).then_some(reduced)
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
        let factor = whitened.cholesky()?;
        let step = factor.solve(&b);
        let inverse = factor.inverse();
        let values: Vec<f64> = inside.clone().map(|i| active.values[i] + s[i] * step[i]).collect();
        let variances: Vec<f64> = inside.map(|i| s[i] * s[i] * inverse[(i, i)]).collect();
        values.iter().chain(&variances).all(|x| x.is_finite()).then_some((values, variances))
    }

    /// Log evidence of other columns in the place of the i-th cause's, at the best parameters of the linear model; `others` holds one set a
    /// variant, as many as the cause has, behind the model's own columns in the normal equations. None where numbers overflow.
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
        let factor = whitened.cholesky()?;
        let log_det = 2.0 * factor.l_dirty().diagonal().iter().map(|x| x.ln()).sum::<f64>();
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
        let factor = whitened.cholesky()?;
        let gain = b.dot(&factor.solve(&b));
        let log_det = 2.0 * factor.l_dirty().diagonal().iter().map(|x| x.ln()).sum::<f64>();
        let value = -0.5 * (self.normal.cost + v.norm_squared() - gain + log_det);
        value.is_finite().then_some(value)
    }
}

/// Values of a cause's discrete unknown, the likeliest first: by the evidence of one linear model that has the columns of all of them.
///
/// # Errors
/// A camera or mirror that cannot be.
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
    let with_board = needs_board(problem, &columns);
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

fn linearise(
    problem: &Problem,
    catalogue: &Catalogue,
    group: &Group,
    model: &Model,
    noise: Noise,
    planes: Option<&FootPoints>,
    mask: Option<&[bool]>,
) -> Result<(Normal, Active)> {
    let active = Active::of(problem, catalogue, group, model);
    let deformation = model.deformation(problem, catalogue, &group.columns);
    let with_board = needs_board(problem, &active.columns);
    let normal = Normal::at(problem, &deformation, noise, &active.columns, with_board, planes, mask)?;
    Ok((normal, active))
}

/// The step in coordinates scaled by the priors, in which damping treats all parameters alike; parameters that rest at 0
/// and are pushed below it are left out. With it what it gains if all is linear, `gᵀ H⁻¹ g`.
fn step(normal: &Normal, active: &Active, damping: f64) -> Option<(DVector<f64>, f64)> {
    let count = active.values.len();
    let s = DVector::from_column_slice(&active.prior_std);
    let mut g = DVector::from_fn(count, |i, _| (normal.g[i] - active.values[i] / (s[i] * s[i])) * s[i]);
    let mut h = DMatrix::from_fn(count, count, |i, j| normal.h[(i, j)] * s[i] * s[j]);
    for i in 0..count {
        h[(i, i)] = (h[(i, i)] + 1.0) * (1.0 + damping);
        if active.positive[i] && active.values[i] <= 0.0 && g[i] < 0.0 {
            for j in 0..count {
                h[(i, j)] = 0.0;
                h[(j, i)] = 0.0;
            }
            h[(i, i)] = 1.0;
            g[i] = 0.0;
        }
    }
    let scaled = h.cholesky()?.solve(&g);
    let gain = scaled.dot(&g);
    Some((scaled.component_mul(&s), gain))
}

fn summary(model: Model, normal: &Normal, active: &Active) -> Fit {
    let count = active.values.len();
    let s = &active.prior_std;
    let scaled = DMatrix::from_fn(count, count, |i, j| {
        normal.h[(i, j)] * s[i] * s[j] + if i == j { 1.0 } else { 0.0 }
    });
    // The nuisances' wide priors are the same in all models: they do not count.
    let causes = active.first_group..count;
    let penalty: f64 = causes.map(|i| (active.values[i] / s[i]).powi(2)).sum();
    let (log_det, covariance) = match scaled.cholesky() {
        Some(factor) => {
            let log_det = 2.0 * factor.l_dirty().diagonal().iter().map(|x| x.ln()).sum::<f64>();
            let mut covariance = factor.inverse();
            for i in 0..count {
                for j in 0..count {
                    covariance[(i, j)] *= s[i] * s[j];
                }
            }
            (log_det, covariance)
        }
        // Not positive only where numbers overflow: no evidence then.
        None => (f64::INFINITY, DMatrix::from_diagonal(&DVector::from_fn(count, |i, _| s[i] * s[i]))),
    };
    Fit {
        log_evidence: -0.5 * (normal.cost + penalty + log_det),
        misfit: normal.cost + active.penalty(&active.values),
        covariance,
        first_term: active.first_term,
        model,
    }
}
