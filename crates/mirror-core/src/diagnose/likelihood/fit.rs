//! The exact fit of a model, damped Gauss–Newton on all causes and nuisance parameters at once, and its marginal
//! likelihood.

use crate::diagnose::effects::hypothesis::{Catalogue, Model, nuisances};
use crate::diagnose::likelihood::covariance::Covariance;
use crate::diagnose::likelihood::factor::{cholesky, log_det};
use crate::diagnose::likelihood::normal_equations::{Normal, changes_sight};
use crate::diagnose::likelihood::secant::Secant;
use crate::diagnose::model::camera_and_mirror::FootPoints;
use crate::diagnose::model::elementary::Column;
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::solver::SOLVER;
use crate::error::Result;

use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

/// The group of small errors that is fitted together with the causes: columns with a common scale for each kind.
#[derive(Debug, Clone, Default)]
pub(crate) struct Group {
    pub columns: Vec<Column>,
    pub prior_std: Vec<f64>,
    /// Which of the first columns cannot be negative; later ones can.
    pub positive: Vec<bool>,
}

impl Group {
    /// Whether all of these are columns of the group.
    pub fn contains(&self, columns: &[Column]) -> bool {
        columns.iter().all(|column| self.columns.contains(column))
    }

    /// The group without its first columns.
    pub fn after(&self, first: usize) -> Self {
        Self {
            columns: self.columns[first..].to_vec(),
            prior_std: self.prior_std[first..].to_vec(),
            positive: self.positive.get(first..).unwrap_or_default().to_vec(),
        }
    }
}

/// How to fit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FitOptions {
    pub noise: Noise,
    pub steps: usize,
}

/// When a fit ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Until {
    /// Once a step gains almost nothing, or once it is clear that the misfit will not come below this.
    Least { hopeless: f64 },
    /// Once a step gains no more than a deviation of each parameter, `gᵀ H⁻¹ g ≤ n`: it is taken without another evaluation,
    /// because the linear model holds as far as the covariance does. For what needs values, and no evidence.
    WithinDeviations,
}

impl Until {
    /// However large the misfit is.
    pub const BEST: Self = Self::Least { hopeless: f64::INFINITY };

    /// The gain of a step of so many parameters that is taken without another evaluation.
    fn unseen(self, parameters: usize) -> f64 {
        match self {
            Self::Least { .. } => SOLVER.last_gain,
            Self::WithinDeviations => (parameters as f64).max(SOLVER.last_gain),
        }
    }

    fn is_hopeless(self, misfit: f64) -> bool {
        matches!(self, Self::Least { hopeless } if misfit > hopeless)
    }
}

/// A fitted model.
#[derive(Debug, Clone)]
pub(crate) struct Fit {
    pub model: Model,
    /// Log marginal likelihood (Laplace), up to a constant that all models of the recording share.
    pub log_evidence: f64,
    /// −2 log likelihood with the priors' penalty, at the fitted parameters.
    pub misfit: f64,
    /// Covariance of all parameters: nuisances, group, then the terms' in order.
    pub covariance: Covariance,
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
#[derive(Clone)]
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
                let positive = group.positive.get(out.columns.len() - out.first_group).copied();
                let positive = positive.unwrap_or(false) || problem.is_least(column.atom);
                out.push(column.clone(), *std, *value, positive);
            }
        }
        out.first_term = out.columns.len();
        for term in &model.terms {
            let positive = catalogue.effect(term.hypothesis).is_positive();
            let stds = catalogue.prior_stds(term.hypothesis, term.variant);
            let columns = catalogue.columns(&problem.scene, term);
            for ((column, std), value) in columns.into_iter().zip(stds).zip(&term.parameters) {
                let positive = positive || problem.is_least(column.atom);
                out.push(column, std * term.prior_scale, *value, positive);
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

    /// Some of the columns.
    pub fn among(&self, kept: &[usize]) -> Self {
        let before = |first: usize| kept.iter().filter(|i| **i < first).count();
        Self {
            columns: kept.iter().map(|&i| self.columns[i].clone()).collect(),
            prior_std: kept.iter().map(|&i| self.prior_std[i]).collect(),
            values: kept.iter().map(|&i| self.values[i]).collect(),
            positive: kept.iter().map(|&i| self.positive[i]).collect(),
            first_group: before(self.first_group),
            first_term: before(self.first_term),
        }
    }

    /// Adds the priors to normal equations whose first columns are these.
    pub fn add_priors(&self, h: &mut DMatrix<f64>, g: &mut DVector<f64>) {
        for (i, (value, std)) in self.values.iter().zip(&self.prior_std).enumerate() {
            let weight = std.powi(-2);
            h[(i, i)] += weight;
            g[i] -= value * weight;
        }
    }

    /// The values after a step; those that cannot be negative are limited to 0.
    pub fn values_moved_by(&self, step: &DVector<f64>) -> Vec<f64> {
        let moved = self.values.iter().zip(step.iter()).zip(&self.positive);
        moved.map(|((v, s), positive)| if *positive { (v + s).max(0.0) } else { v + s }).collect()
    }

    pub fn penalty(&self, values: &[f64]) -> f64 {
        values.iter().zip(&self.prior_std).map(|(v, s)| (v / s).powi(2)).sum()
    }

    /// The model with these values.
    pub fn model(&self, like: &Model, values: &[f64]) -> Model {
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

/// Fits all parameters of a model to the frames in use.
///
/// Minimises `−2 log L + Σ (θ/σ₀)²` by damped Gauss–Newton, reweighted by the mixture likelihood. Parameters that
/// cannot be negative are held at 0 where they would be. The evidence is Laplace's: `log Z = −(cost + penalty)/2 −
/// ½ log det(I + S A S)`, `S = diag σ₀`, A the information of the data.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn fit(
    problem: &Problem,
    catalogue: &Catalogue,
    group: &Group,
    start: &Model,
    options: FitOptions,
    mask: Option<&[bool]>,
) -> Result<Fit> {
    fit_until(problem, catalogue, group, start, options, mask, Until::BEST)
}

/// As [`fit`], until it is good enough.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn fit_until(
    problem: &Problem,
    catalogue: &Catalogue,
    group: &Group,
    start: &Model,
    options: FitOptions,
    mask: Option<&[bool]>,
    until: Until,
) -> Result<Fit> {
    let planes = start.planes.as_deref();
    let first = linearise(problem, catalogue, group, start, options.noise, planes, mask)?;
    Ok(fit_on(problem, catalogue, group, (start, first), options, mask, until))
}

/// As [`fit_until`], from a model that is linearised already.
pub(crate) fn fit_on(
    problem: &Problem,
    catalogue: &Catalogue,
    group: &Group,
    (start, (mut normal, mut active)): (&Model, (Normal, Active)),
    options: FitOptions,
    mask: Option<&[bool]>,
    until: Until,
) -> Fit {
    let mut model = start.clone();
    let mut damping = 1e-9;
    let start = model.planes.take();
    let mut secant: Option<Secant> = None;
    for taken in 0..options.steps {
        if active.values.is_empty() {
            break;
        }
        let current = normal.cost + active.penalty(&active.values);
        let mut moved = false;
        for _ in 0..6 {
            let Some((step, gain)) = step(&normal, &active, damping, secant.as_ref()) else { break };
            if taken > 0 && until.is_hopeless(current - SOLVER.most_hoped * gain) {
                break;
            }
            let values = active.values_moved_by(&step);
            let next = active.model(&model, &values);
            if gain < until.unseen(active.values.len()) {
                // It may lead out of what a camera or a mirror can be: a pane at its largest thickness.
                if problem.eye(&next.deformation(problem, catalogue, &group.columns)).is_err() {
                    break;
                }
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
            secant = Some(Secant::between(&normal, &next_normal, &change));
            if cost <= current + 1e-9 * current.abs() {
                let small = current - cost < 1e-3;
                (model, normal, active) = (next, next_normal, next_active);
                damping *= 0.1;
                moved = !small;
                break;
            }
            // So little may be the cost's own inexactness: planes are settled to a tolerance.
            if gain < SOLVER.least_retried {
                break;
            }
            damping = (damping * 100.0).max(1e-4);
        }
        if !moved {
            break;
        }
    }
    if !normal.planes.feet.is_empty() {
        let mut feet = core::mem::take(&mut normal.planes.feet);
        // The planes of frames that were not used stay as they were.
        if let (Some(before), Some(mask)) = (&start, mask) {
            let left_out = feet.iter_mut().zip(before.iter()).zip(mask).filter(|(_, counts)| !**counts);
            left_out.for_each(|((foot, before), _)| *foot = *before);
        }
        model.planes = Some(Arc::new(feet));
    }
    summary(model, &normal, &active)
}

/// The normal equations of a model at its current values, and its parameters in their order.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn linearise(
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
    let with_board = changes_sight(problem, &active.columns);
    let normal = Normal::at(problem, &deformation, noise, &active.columns, with_board, planes, mask)?;
    Ok((normal, active))
}

/// The step in coordinates scaled by the priors, in which damping treats all parameters alike, with the curvature
/// that the last step showed. Parameters at 0 that are pushed below it are left out. Also returns the gain if
/// everything is linear, `gᵀ H⁻¹ g`.
fn step(
    normal: &Normal,
    active: &Active,
    damping: f64,
    secant: Option<&Secant>,
) -> Option<(DVector<f64>, f64)> {
    let count = active.values.len();
    let s = DVector::from_column_slice(&active.prior_std);
    let mut g = DVector::from_fn(count, |i, _| (normal.g[i] - active.values[i] / (s[i] * s[i])) * s[i]);
    let mut h = DMatrix::from_fn(count, count, |i, j| normal.h[(i, j)] * s[i] * s[j]);
    if let Some(w) = secant.and_then(|secant| secant.correction(&normal.h)) {
        let w = w.component_mul(&s);
        h.ger(1.0, &w, &w, 1.0);
    }
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
    let scaled = cholesky(h)?.solve(&g);
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
    let factor = cholesky(scaled);
    // Not positive only where numbers overflow: no evidence then.
    let log_det = factor.as_ref().map_or(f64::INFINITY, log_det);
    Fit {
        log_evidence: -0.5 * (normal.cost + penalty + log_det),
        misfit: normal.cost + active.penalty(&active.values),
        covariance: Covariance::new(factor, s.clone()),
        first_term: active.first_term,
        model,
    }
}
