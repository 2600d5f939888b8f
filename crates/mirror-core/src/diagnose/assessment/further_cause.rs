//! What a cause that was not found would change: 95 % intervals of displaced mounts, of small errors and of the causes beside them, averaged
//! over the models with one further cause.
//!
//! A board that is printed too large looks like one that is mounted nearer to the camera. Where the postures hardly tell one from the
//! other, the search names neither, or one of them; the mount's own covariance knows nothing of the other. With the score test at
//! the model found, a further cause h has the weight
//!
//! ```text
//! w_h = π_h exp(min(l, t l)),   l its log Bayes factor, t the exponent of the power posterior
//! ```
//!
//! beside 1 of the model as it is. With it a value moves by `D p̂`, and its variance grows by `D Σ Dᵀ`, where p̂ and Σ are the
//! estimate and the covariance of the cause's parameters, and D is how the model's values move with them. The value is a
//! mixture of normals; its deviation is told such that 1.96 of them hold 95 % of the mixture. A cause that may be there with 1 % changes
//! nothing, one with 10 % decides how far the interval reaches.
//!
//! Source: Bayesian model averaging, Hoeting, Madigan, Raftery and Volinsky (1999).

use crate::diagnose::assessment::uncertainty::Deviations;
use crate::diagnose::effects::hypothesis::Catalogue;
use crate::diagnose::likelihood::score_test::{Screening, WithCause};
use crate::diagnose::model::scene::Scene;
use crate::diagnose::principles::{Guard, Size, TEMPER, WORTH_NAMING};
use crate::statistics::{normal_below, normal_quantile};
use std::collections::BTreeMap;

/// Halvings of an interval's bound.
const HALVINGS: Size = 40;
/// A cause that moves a value by less than this share of its deviation is as good as none for it.
const UNNOTICED: Guard = 0.05;
/// Log weights are not above this: their sum must be a number.
const LARGEST_LOG_WEIGHT: Guard = 50.0;

/// One normal of a mixture: weight, mean and standard deviation about the value of the model found.
#[derive(Debug, Clone, Copy)]
struct Normal {
    weight: f64,
    mean: f64,
    std: f64,
}

/// Widens the deviations of mounts, small errors and causes for one further cause that may be there.
pub(crate) fn beside_further_cause(
    screening: &Screening,
    (catalogue, scene): (&Catalogue, &Scene),
    deviations: &mut Deviations,
) {
    let first = screening.active.first_group;
    let mut likeliest: BTreeMap<usize, (f64, WithCause)> = BTreeMap::new();
    for score in screening.scores.iter().filter(|s| !catalogue.is_free(s.hypothesis)) {
        let log_bayes = score.log_bayes.min(TEMPER * score.log_bayes);
        let log_weight = catalogue.log_prior(scene, score.hypothesis, score.variant) + log_bayes;
        let weight = log_weight.min(LARGEST_LOG_WEIGHT).exp();
        if likeliest.get(&score.hypothesis).is_some_and(|known| known.0 >= weight) {
            continue;
        }
        let prior_std = catalogue.prior_stds(score.hypothesis, score.variant);
        if let Some(moved) = screening.with_cause(score, prior_std, first) {
            likeliest.insert(score.hypothesis, (weight, moved));
        }
    }
    let mut mixture = Vec::with_capacity(likeliest.len() + 1);
    let all = deviations.group.iter_mut().chain(deviations.stds.iter_mut().flatten());
    for (k, std) in all.enumerate() {
        mixture.clear();
        mixture.push(Normal { weight: 1.0, mean: 0.0, std: *std });
        for (weight, moved) in likeliest.values() {
            let (mean, adds) = (moved.moves[k], moved.adds_variance[k].max(0.0));
            if mean * mean + adds < (UNNOTICED * *std).powi(2) {
                mixture[0].weight += weight;
            } else {
                mixture.push(Normal { weight: *weight, mean, std: std.hypot(adds.sqrt()) });
            }
        }
        if mixture.len() > 1 {
            *std = interval(&mixture) / normal_quantile(1.0 - 0.5 * WORTH_NAMING);
        }
    }
}

/// Half of the interval about 0 that holds all but [`WORTH_NAMING`] of a mixture.
fn interval(mixture: &[Normal]) -> f64 {
    let total: f64 = mixture.iter().map(|n| n.weight).sum();
    let inside = |half: f64| -> f64 {
        let of = |n: &Normal| {
            n.weight * (normal_below((half - n.mean) / n.std) - normal_below((-half - n.mean) / n.std))
        };
        mixture.iter().map(of).sum::<f64>() / total
    };
    let reach = |n: &Normal| n.mean.abs() + 4.0 * n.std;
    let (mut low, mut high) = (0.0, mixture.iter().map(reach).fold(0.0, f64::max));
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if inside(middle) < 1.0 - WORTH_NAMING { low = middle } else { high = middle }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::{LARGEST_LOG_WEIGHT, Normal, interval};
    use crate::random::Random;

    #[test]
    fn the_interval_holds_95_percent_of_draws_from_the_mixture() {
        let mixture = [
            Normal { weight: 1.0, mean: 0.0, std: 1.0 },
            Normal { weight: 0.15, mean: 9.0, std: 2.0 },
            Normal { weight: 0.02, mean: -30.0, std: 4.0 },
        ];
        let half = interval(&mixture);
        let total: f64 = mixture.iter().map(|n| n.weight).sum();
        let mut random = Random::new(5);
        let draws = 40_000;
        let inside = (0..draws).filter(|_| {
            let mut at = total * random.unit();
            let of = mixture.iter().find(|n| {
                at -= n.weight;
                at < 0.0
            });
            let n = of.copied().unwrap_or(mixture[0]);
            (n.mean + n.std * random.normal()).abs() < half
        });
        let share = inside.count() as f64 / f64::from(draws);
        assert!((share - 0.95).abs() < 0.004, "{share} within {half}");
    }

    #[test]
    fn what_may_be_there_with_a_hundredth_hardly_matters_and_with_a_tenth_decides() {
        let beside = |weight: f64| {
            interval(&[Normal { weight: 1.0, mean: 0.0, std: 1.0 }, Normal { weight, mean: 8.0, std: 1.0 }])
                / interval(&[Normal { weight: 1.0, mean: 0.0, std: 1.0 }])
        };
        assert!(beside(0.01) < 1.1, "{}", beside(0.01));
        assert!(beside(0.1) > 3.5, "{}", beside(0.1));
        // What the score test alone puts far above the model found.
        assert!((beside(LARGEST_LOG_WEIGHT.exp()) - 9.64 / 1.96).abs() < 0.02);
    }
}
