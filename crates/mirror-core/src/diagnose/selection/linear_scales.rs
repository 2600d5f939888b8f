//! Sets of causes in one linear model, each with the scales of small errors everywhere that it leaves.

use crate::diagnose::likelihood::factor::{cholesky, variances};
use crate::diagnose::principles::Guard;
use crate::diagnose::selection::linear_search::{LinearSearch, is_same_set};
use crate::diagnose::selection::reduced_equations::{Equations, Reduced};
use nalgebra::{DMatrix, DVector};

/// Normal equations at scales that were learned, and the same with what is always free eliminated.
pub(crate) struct Scaled {
    pub equations: Equations,
    pub reduced: Reduced,
}

/// A set of candidates with the log of its evidence times prior, up to a constant, at the scales that it leaves.
pub(crate) struct WeighedSet {
    pub set: Vec<usize>,
    pub log_posterior: f64,
    pub scaled: Scaled,
}

/// How a cause stands in a set against its alternatives.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InPlace {
    /// `1 / Σ exp(l_k − l)`, with the log posterior odds l of each in the place of the one of them that the set has.
    pub probability: f64,
    /// Whether the set has it, or one of them that is no more probable: of several that no data can separate the one at which a
    /// search ends is chance.
    pub comes_out: bool,
}

impl InPlace {
    const NOT: Self = Self { probability: 0.0, comes_out: false };
}

/// Log posterior odds nearer to each other than this are equal.
const AS_PROBABLE: Guard = 1e-6;

impl LinearSearch<'_> {
    /// The causes that the search finds from nothing or from those that were found, whichever are more probable,
    /// with the normal equations at the scales that the resample has with them. Adding one cause at a time may end
    /// at two causes that only imitate two others; the whole search avoids that by additional start points.
    pub fn search(&self, resample: &Equations) -> Option<WeighedSet> {
        // Where a search ends, and the scales there if it ends where it began.
        let end_from = |start: Vec<usize>| -> Option<(Vec<usize>, Option<Scaled>)> {
            let scaled = self.with_spreads(resample, &start)?;
            let set = self.searched(&scaled.reduced, start.clone())?;
            let stayed = is_same_set(&set, &start);
            Some((set, stayed.then_some(scaled)))
        };
        let weighed = |(set, scaled): (Vec<usize>, Option<Scaled>)| match scaled {
            Some(scaled) => self.weighed(set, scaled),
            None => self.with_scales(resample, set),
        };
        let found = weighed(end_from((0..self.found).collect())?)?;
        let from_nothing = end_from(Vec::new())?;
        // Mostly both ways end at the same causes.
        if is_same_set(&from_nothing.0, &found.set) {
            return Some(found);
        }
        let nothing = weighed(from_nothing)?;
        Some(if found.log_posterior >= nothing.log_posterior { found } else { nothing })
    }

    /// A hypothesis in a set, against its alternatives; none where numbers overflow.
    pub fn in_place(
        &self,
        weighed: &WeighedSet,
        hypothesis: usize,
        alternatives: &[usize],
    ) -> Option<InPlace> {
        let is_it = |c: usize| self.candidates[c].hypothesis == hypothesis;
        let competes = |c: usize| is_it(c) || alternatives.contains(&self.candidates[c].hypothesis);
        let set = &weighed.set;
        let selected = set.iter().find(|&&c| is_it(c)).or_else(|| set.iter().find(|&&c| competes(c)));
        let own = (0..self.candidates.len()).find(|&c| is_it(c));
        let Some((&selected, own)) = selected.zip(own) else { return Some(InPlace::NOT) };
        let others: Vec<usize> = set.iter().copied().filter(|&c| c != selected).collect();
        let base = self.base(&weighed.scaled.reduced, &others, None)?;
        let odds = |c: usize| self.odds((&weighed.scaled.reduced, &base), &others, c);
        let of_it = odds(own);
        if of_it == f64::NEG_INFINITY {
            return Some(InPlace::NOT);
        }
        let in_place = (0..self.candidates.len()).filter(|&c| competes(c) && !others.contains(&c));
        let total: f64 = in_place.map(|c| (odds(c) - of_it).exp()).sum();
        let comes_out = selected == own || of_it > odds(selected) - AS_PROBABLE;
        Some(InPlace { probability: 1.0 / total, comes_out })
    }

    /// A set with the scales that it leaves; none where numbers overflow.
    pub fn with_scales(&self, whole: &Equations, set: Vec<usize>) -> Option<WeighedSet> {
        let scaled = self.with_spreads(whole, &set)?;
        self.weighed(set, scaled)
    }

    /// A set with scales that were learned with it.
    pub(super) fn weighed(&self, set: Vec<usize>, scaled: Scaled) -> Option<WeighedSet> {
        let log_posterior = self.log_posterior(&scaled.reduced, &set)?;
        Some(WeighedSet { set, log_posterior, scaled })
    }

    /// The normal equations with the scales of small errors everywhere that the data have with some causes.
    /// Scales that were estimated with the causes found would leave no room for what these causes explain. None where
    /// numbers overflow.
    pub(super) fn with_spreads(&self, whole: &Equations, causes: &[usize]) -> Option<Scaled> {
        let equations = self.with_learned(whole, causes);
        Some(Scaled { reduced: Reduced::of(&equations, &self.always)?, equations })
    }

    /// The equations in the units of the scales learned.
    fn with_learned(&self, (m, b): &Equations, causes: &[usize]) -> Equations {
        let Some((geometry, first)) = self.geometry else { return (m.clone(), b.clone()) };
        let group = first..first + geometry.group.columns.len();
        // By how much the units of all parameters change, and the equations of some of them in these.
        let units = |prior_std: &[f64]| -> Vec<f64> {
            let mut units = vec![1.0; b.len()];
            group.clone().zip(prior_std).for_each(|(i, std)| units[i] = std / self.std[i]);
            units
        };
        let rescaled = |units: &[f64], of: &[usize]| -> Equations {
            let among = DMatrix::from_fn(of.len(), of.len(), |i, j| {
                let one = if i == j { 1.0 } else { 0.0 };
                (m[(of[i], of[j])] - one) * units[of[i]] * units[of[j]] + one
            });
            (among, DVector::from_fn(of.len(), |i, _| b[of[i]] * units[of[i]]))
        };
        // What is always free comes first and in order, so that the group has the same indices everywhere.
        let free = self.indices(causes);
        let posterior = |prior_std: &[f64]| {
            let (m, b) = rescaled(&units(prior_std), &free);
            let factor = cholesky(m)?;
            let mean = factor.solve(&b);
            let values = group.clone().zip(prior_std).map(|(i, std)| std * mean[i]).collect();
            let variances = variances(&factor, group.clone()).into_iter();
            let variances = variances.zip(prior_std).map(|(v, std)| std * std * v).collect();
            Some((values, variances))
        };
        let mut learned = geometry.clone();
        learned.learned_from(&posterior);
        rescaled(&units(&learned.group.prior_std), &(0..b.len()).collect::<Vec<_>>())
    }
}
