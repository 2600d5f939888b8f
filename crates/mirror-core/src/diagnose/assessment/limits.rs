//! Limits of detection: for each effect at each place the largest size that these postures would have hidden.
//!
//! An effect is added to the model found. Board, camera and markers are free (within their stated tolerances,
//! otherwise within the usual ones of mounts by hand), and are projected out of the effect's columns. The
//! information on its parameters is `A = X'(I − C(C'C + P)⁻¹C')X`. A cause of size p gains a noncentral chi-squared
//! variable with k degrees of freedom and noncentrality `λ = p' A p`. It is detected if that gain exceeds the
//! criterion of the selection: its prior, its Occam factor, the minimum odds, `c = 2 (least − log π) + log det(I + S
//! A S)`, and if the held-out gap shrinks by the required share. The limit of a parameter is the size, all others 0,
//! at which the gain exceeds c with probability 0.95: a larger one would be detected in 19 of 20 sessions like this
//! one.
//!
//! Not included: an alternative may be reported in its place. Where the effect has a discrete unknown (a friction),
//! the limit is the largest over its values.
//!
//! Source: power of the score test, Rao (1948); noncentral chi-squared by Sankaran's approximation (1959).

use crate::diagnose::assessment::findings::Findings;
use crate::diagnose::criteria::cross_validation::size;
use crate::diagnose::data::diagnosis::Limit;
use crate::diagnose::effects::hypothesis::{Catalogue, Hypothesis, Model};
use crate::diagnose::likelihood::factor::log_det;
use crate::diagnose::likelihood::fit::{FitOptions, Group};
use crate::diagnose::likelihood::linearised::Linearised;
use crate::diagnose::likelihood::score_test::{Screening, screen};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::principles::{Guard, LEAST_HELD_OUT_GAIN, WORTH_NAMING};
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::random_effects::small_errors::single_effect;
use crate::error::Result;
use crate::statistics::normal_quantile;
use nalgebra::DMatrix;
use std::collections::BTreeMap;

/// Beyond so many times the size that an error commonly has, nothing is linear any more: any size would be hidden.
pub(crate) const LARGEST: Guard = 10.0;

/// Limits by hypothesis and parameter; infinite where any size would be hidden.
type Sizes = BTreeMap<usize, Vec<f64>>;

/// The limits of all effects of the vocabulary at all their places; `screening`: the score test at the model found, if it has mounts.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn limits(findings: &Findings<'_>, screening: Option<&Screening>) -> Result<Vec<Limit>> {
    let search = &findings.search;
    let mut model = findings.found.fit.model.clone();
    let setup = model.group.is_empty().then(|| free_setup(&search.problem));
    if let Some(setup) = &setup {
        model.group = vec![0.0; setup.columns.len()];
    }
    let postures = Postures {
        problem: &search.problem,
        catalogue: search.catalogue,
        group: setup.as_ref().unwrap_or(&search.group),
        model: &model,
        noise: findings.found.noise,
        mask: search.mask,
    };
    let criterion =
        Criterion { least_log_odds: search.options.least_log_odds, held_out: held_out_gain(findings) };
    match screening {
        Some(screening) => postures.limits(criterion, screening),
        None => postures.limits(criterion, &postures.screened()?),
    }
}

/// Board, camera and markers, free within their tolerances. Zeros are no mounts by hand: they are estimated, or exact.
pub(crate) fn free_setup(problem: &Problem) -> Group {
    Geometry::of_setup(problem, &["geometry".to_owned()]).group
}

/// When a cause is named.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Criterion {
    pub least_log_odds: f64,
    /// The gain that shrinks the held-out gap by the required share.
    pub held_out: f64,
}

/// Postures with a model that contains a free set-up: what they show of each effect.
#[derive(Clone, Copy)]
pub(crate) struct Postures<'a> {
    pub problem: &'a Problem,
    pub catalogue: &'a Catalogue,
    pub group: &'a Group,
    pub model: &'a Model,
    pub noise: Noise,
    pub mask: Option<&'a [bool]>,
}

impl Postures<'_> {
    /// The score test of all hypotheses beside the model.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn screened(&self) -> Result<Screening> {
        let Self { problem, catalogue, group, model, noise, mask } = *self;
        screen(problem, catalogue, group, model, noise, mask)
    }

    /// The limits of all effects of the vocabulary at all their places, with the score test beside the model.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn limits(&self, criterion: Criterion, screening: &Screening) -> Result<Vec<Limit>> {
        let Self { problem, catalogue, group, model, noise, mask } = *self;
        let mut sizes = Sizes::new();
        let mut add = |hypothesis: usize, information: &DMatrix<f64>| {
            let of = limits_of(&catalogue.hypotheses[hypothesis], information, criterion);
            let entry = sizes.entry(hypothesis).or_insert_with(|| vec![0.0; of.len()]);
            entry.iter_mut().zip(of).for_each(|(old, new)| *old = old.max(new));
        };
        let own = |h: usize| catalogue.is_free(h) || catalogue.effect(h).is_tabulated();
        let options = FitOptions { noise, steps: 0 };
        let here = Linearised::at(problem, catalogue, group, model, options, mask)?;
        let in_group = self.in_group();
        for (i, term) in model.terms.iter().enumerate().filter(|(_, t)| !own(t.hypothesis)) {
            let columns: Vec<usize> = here.of_term(model, i).collect();
            if let Some(information) = here.information_of(&columns) {
                add(term.hypothesis, &information);
            }
        }
        for (h, columns) in &in_group {
            let columns: Vec<usize> = columns.iter().map(|k| here.first_group() + k).collect();
            if let Some(information) = here.information_of(&columns) {
                add(*h, &information);
            }
        }
        for score in
            screening.scores.iter().filter(|s| !own(s.hypothesis) && !in_group.contains_key(&s.hypothesis))
        {
            add(score.hypothesis, &score.information);
        }
        Ok(sizes.iter().map(|(h, of)| self.told(*h, of)).collect())
    }

    /// The hypotheses that are displacements of the free set-up, with the numbers of their columns in it. A mount is
    /// itself free: it is tested with all other mounts free.
    pub fn in_group(&self) -> BTreeMap<usize, Vec<usize>> {
        let mut found: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (k, column) in self.group.columns.iter().enumerate().take(self.model.group.len()) {
            let effect = single_effect(column);
            if let Some(h) = effect.and_then(|(name, place, _)| self.catalogue.find(name, place)) {
                found.entry(h).or_default().push(k);
            }
        }
        let parameters = |h: usize| self.catalogue.hypotheses[h].prior_std.len();
        found.retain(|h, columns| columns.len() == parameters(*h));
        found
    }

    fn told(&self, hypothesis: usize, sizes: &[f64]) -> Limit {
        let effect = self.catalogue.effect(hypothesis);
        let finite = |size: &f64| (*size > 0.0 && size.is_finite()).then_some(*size);
        Limit {
            effect: effect.name().to_owned(),
            at: self.catalogue.hypotheses[hypothesis].place.name(&self.problem.scene),
            parameters: effect.parameters().into_iter().zip(sizes.iter().map(finite)).collect(),
        }
    }
}

/// The gain (in −2 log likelihood) that shrinks the held-out gap by the share below which a cause is dropped.
fn held_out_gain(findings: &Findings<'_>) -> f64 {
    let (search, after) = (&findings.search, &findings.after);
    let noise = search.measured_noise;
    let total = match size(after).rms_px {
        Some(_) => after.iter().map(|g| g.square_sum_px2).sum::<f64>() / noise.marker_px.powi(2),
        None => after.iter().map(|g| g.square_sum_m2).sum::<f64>() / noise.point_m.powi(2),
    };
    gain_needed(total)
}

/// The same of a held-out gap whose squares, in units of the noise, add up to `total`.
pub(crate) fn gain_needed(total: f64) -> f64 {
    ((1.0 + LEAST_HELD_OUT_GAIN).powi(2) - 1.0) * total
}

/// Each parameter's limit, given the information of the data on all of them.
fn limits_of(entry: &Hypothesis, information: &DMatrix<f64>, criterion: Criterion) -> Vec<f64> {
    let (s, count) = (&entry.prior_std, entry.prior_std.len());
    let occam = DMatrix::from_fn(count, count, |i, j| {
        let (i, j) = (i.min(j), i.max(j));
        information[(i, j)] * s[i] * s[j] + if i == j { 1.0 } else { 0.0 }
    });
    let Some(factor) = occam.cholesky() else { return vec![f64::INFINITY; count] };
    let log_det = log_det(&factor);
    let asked = 2.0 * (criterion.least_log_odds - entry.log_prior) + log_det;
    // A cause uses as many degrees of freedom of the held-out postures as it has parameters.
    let needed = noncentrality(asked.max(criterion.held_out + count as f64), count as f64);
    (0..count)
        .map(|i| {
            let size = (needed / information[(i, i)].max(0.0)).sqrt();
            if size < LARGEST * s[i] { size } else { f64::INFINITY }
        })
        .collect()
}

/// The noncentrality at which a chi-squared of k degrees of freedom exceeds `bound` with all but [`WORTH_NAMING`] of the probability.
pub(crate) fn noncentrality(bound: f64, k: f64) -> f64 {
    let (mut low, mut high) = (0.0, 4.0 * (bound + k) + 40.0);
    let asked = normal_quantile(WORTH_NAMING);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if noncentral_deviate(bound, k, middle) > asked {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

/// A noncentral chi-squared as a standard normal deviate, Sankaran's approximation.
fn noncentral_deviate(x: f64, k: f64, lambda: f64) -> f64 {
    let (mean, spread) = (k + lambda, k + 2.0 * lambda);
    let h = 1.0 - 2.0 * mean * (k + 3.0 * lambda) / (3.0 * spread * spread);
    let p = spread / (mean * mean);
    let m = (h - 1.0) * (1.0 - 3.0 * h);
    let center = 1.0 + h * p * (h - 1.0 - 0.5 * (2.0 - h) * m * p);
    ((x / mean).powf(h) - center) / (h * (2.0 * p).sqrt() * (1.0 + 0.5 * m * p))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn a_gain_exceeds_its_bound_as_often_as_is_claimed() {
        // Of one degree of freedom: P(z + √λ > √c), the other tail far away.
        for bound in [4.0_f64, 16.0, 40.0] {
            let shift = noncentrality(bound, 1.0).sqrt() - bound.sqrt();
            assert!((shift - 1.645).abs() < 0.03, "{bound}: {shift}");
        }
        // Of several it is sampled: squares of normals of a plain generator.
        let mut random = Random::new(7);
        let mut normal = || random.normal();
        for (bound, k) in [(20.0, 3), (45.0, 6)] {
            let shift = noncentrality(bound, f64::from(k)).sqrt();
            let draws = 20_000;
            let beyond = (0..draws)
                .filter(|_| {
                    let rest: f64 = (1..k).map(|_| normal().powi(2)).sum();
                    (normal() + shift).powi(2) + rest > bound
                })
                .count();
            let share = beyond as f64 / f64::from(draws);
            assert!((share - (1.0 - WORTH_NAMING)).abs() < 0.01, "{bound}, {k}: {share}");
        }
    }
}
