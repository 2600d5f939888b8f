//! Sets of causes in one linear model, each with the scales of small errors everywhere that it leaves.

use crate::diagnose::likelihood::factor::{cholesky, variances};
use crate::diagnose::model::work_budget::Effort;
use crate::diagnose::principles::Guard;
use crate::diagnose::random_effects::geometric_tolerances::Spreads;
use crate::diagnose::selection::linear_search::{LinearSearch, is_same_set};
use crate::diagnose::selection::reduced_equations::{Equations, Reduced};
use nalgebra::{DMatrix, DVector};

/// Normal equations at scales that were learned, and the same with what is always free eliminated.
pub(crate) struct Scaled {
    /// Those of the small errors everywhere.
    spreads: Option<Spreads>,
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

impl LinearSearch {
    /// The causes that the search finds from nothing or from those that were found, whichever are more probable,
    /// with the normal equations at the scales that the resample has with them. Adding one cause at a time may end
    /// at two causes that only imitate two others; the whole search avoids that by additional start points.
    pub fn search(&self, resample: &Equations) -> Option<WeighedSet> {
        // Where a search ends, the scales where it began, and whether that is the same set.
        let end_from = |start: Vec<usize>, from: Option<Spreads>| -> Option<(Vec<usize>, Scaled, bool)> {
            let scaled = self.with_spreads(resample, &start, from)?;
            let set = self.searched(&scaled.reduced, start.clone())?;
            let stayed = is_same_set(&set, &start);
            Some((set, scaled, stayed))
        };
        // Another set's scales are learned from those of the start.
        let weighed = |(set, scaled, stayed): (Vec<usize>, Scaled, bool)| {
            let scaled = if stayed { scaled } else { self.with_spreads(resample, &set, scaled.spreads)? };
            self.weighed(set, scaled)
        };
        let found = weighed(end_from((0..self.found).collect(), None)?)?;
        let from_nothing = end_from(Vec::new(), self.spreads_of_nothing())?;
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
        let scaled = self.with_spreads(whole, &set, None)?;
        self.weighed(set, scaled)
    }

    /// The scales without any cause, on all postures: where those of a resample begin.
    fn spreads_of_nothing(&self) -> Option<Spreads> {
        let all = || self.with_learned(&self.sum(&vec![1.0; self.parts.len()]), &[], None);
        *self.without_causes.get_or_init(|| all()?.1)
    }

    /// The values of all parameters beside a set, in their own units, at the scales that it leaves; 0 of what is not in it. None where
    /// numbers overflow.
    pub fn values_at_own_scales(&self, weighed: &WeighedSet) -> Option<Vec<f64>> {
        // The equations are in units of the scales learned, these values in those of the model's.
        let mut values = self.values(&weighed.scaled.equations, &weighed.set)?;
        if let Some(((group, first), spreads)) = self.geometry.as_ref().zip(weighed.scaled.spreads.as_ref()) {
            let mut learned = group.clone();
            learned.set_spreads(spreads);
            for (k, std) in learned.group.prior_std.iter().enumerate() {
                values[first + k] *= std / self.std[first + k];
            }
        }
        Some(values)
    }

    /// A set with scales that were learned with it.
    pub(super) fn weighed(&self, set: Vec<usize>, scaled: Scaled) -> Option<WeighedSet> {
        let log_posterior = self.log_posterior(&scaled.reduced, &set)?;
        Some(WeighedSet { set, log_posterior, scaled })
    }

    /// The normal equations with the scales of small errors everywhere that the data have with some causes.
    /// Scales that were estimated with the causes found would leave no room for what these causes explain. The iteration
    /// begins at the scales `from`, or at those of the model. None where numbers overflow.
    pub(super) fn with_spreads(
        &self,
        whole: &Equations,
        causes: &[usize],
        from: Option<Spreads>,
    ) -> Option<Scaled> {
        let (equations, spreads) = self.with_learned(whole, causes, from)?;
        Some(Scaled { reduced: Reduced::of(&equations, &self.always)?, equations, spreads })
    }

    /// The equations in the units of the scales learned, and these.
    ///
    /// A scale only changes the units of the small errors: what is free besides is eliminated once, and each step
    /// from scales to scales has as many unknowns as there are small errors.
    fn with_learned(
        &self,
        whole: &Equations,
        causes: &[usize],
        from: Option<Spreads>,
    ) -> Option<(Equations, Option<Spreads>)> {
        let Some((geometry, first)) = &self.geometry else { return Some((whole.clone(), None)) };
        let group: Vec<usize> = (*first..first + geometry.group.columns.len()).collect();
        let mut others = self.indices(causes);
        others.retain(|i| !group.contains(i));
        let of_group = Reduced::onto(whole, &group, &others)?;
        let (m, b) = of_group.equations();
        let units = |prior_std: &[f64]| -> Vec<f64> {
            prior_std.iter().zip(&group).map(|(std, &i)| std / self.std[i]).collect()
        };
        let posterior = |prior_std: &[f64]| {
            let units = units(prior_std);
            self.budget.spend(Effort::Equations(b.len()));
            let factor = cholesky(in_units(m, &units))?;
            let mean = factor.solve(&DVector::from_fn(b.len(), |i, _| b[i] * units[i]));
            let values = mean.iter().zip(prior_std).map(|(mean, std)| std * mean).collect();
            let variances = variances(&factor, 0..b.len()).into_iter();
            let variances = variances.zip(prior_std).map(|(v, std)| std * std * v).collect();
            Some((values, variances))
        };
        let mut learned = geometry.clone();
        if let Some(from) = from {
            learned.set_spreads(&from);
        }
        learned.learned_from(&posterior);
        let mut of_all = vec![1.0; whole.1.len()];
        group.iter().zip(units(&learned.group.prior_std)).for_each(|(&i, unit)| of_all[i] = unit);
        let b = DVector::from_fn(of_all.len(), |i, _| whole.1[i] * of_all[i]);
        Some(((in_units(&whole.0, &of_all), b), Some(learned.spreads())))
    }
}

/// `M = I + S H S` where the priors' deviations S are multiplied by these.
fn in_units(m: &DMatrix<f64>, units: &[f64]) -> DMatrix<f64> {
    let one = |i: usize, j: usize| if i == j { 1.0 } else { 0.0 };
    DMatrix::from_fn(m.nrows(), m.ncols(), |i, j| (m[(i, j)] - one(i, j)) * units[i] * units[j] + one(i, j))
}
