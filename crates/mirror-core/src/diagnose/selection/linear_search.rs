//! The search for causes in one linear model, as small dense algebra: on a part of the postures, or beside small errors
//! everywhere.
//!
//! A model is linearised once, with the columns of its causes and of the hypotheses that compete with them, separately
//! for each part of the postures. The normal equations of any choice of postures are a weighted sum of the parts'. So
//! the search on it is small dense algebra: causes are added while their posterior odds exceed the selection's
//! minimum, dropped and exchanged, starting from nothing and from the causes found; the more probable result is used.
//! Board, camera, markers, zeros and discrepancy terms are free wherever they are free in the model, and the scales of
//! small errors everywhere are estimated anew. Fixed are the noise, the observations left out as false, discrete
//! unknowns (frictions), and gross mistakes.

use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::likelihood::factor::cholesky;
use crate::diagnose::likelihood::fit::Active;
use crate::diagnose::likelihood::normal_equations::{Normal, changes_sight};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::work_budget::WorkBudget;
use crate::diagnose::principles::{LOG_PRIOR_SAME_PLACE, Size};
use crate::diagnose::random_effects::geometric_tolerances::{Geometry, Spreads};
use crate::diagnose::random_effects::law_discrepancy::slack_of_each;
use crate::diagnose::selection::competing::Competing;
use crate::diagnose::selection::reduced_equations::{Base, Equations, Factor, Reduced};
use crate::diagnose::selection::search::Search;
use crate::error::Result;
use core::ops::Range;
use nalgebra::{DMatrix, DVector};
use std::sync::OnceLock;

/// Largest number of causes that a search adds to those that were found.
const MORE_CAUSES: Size = 2;

/// One hypothesis that competes.
pub(crate) struct Candidate {
    pub hypothesis: usize,
    pub variant: f64,
    pub columns: Range<usize>,
    /// The discrepancy terms of its law, which are free where it is in the set; none of a hypothesis that the model lacks.
    slack: Range<usize>,
    log_prior: f64,
    positive: bool,
    node: Option<usize>,
}

impl Candidate {
    /// Its parameters and its law's discrepancy terms.
    fn with_slack(&self) -> impl Iterator<Item = usize> + use<> {
        self.columns.clone().chain(self.slack.clone())
    }
}

/// The model in normal equations of parts of the postures, in units of the priors' deviations.
pub(crate) struct LinearSearch {
    pub(super) parts: Vec<Equations>,
    /// Parameters that are always free.
    pub always: Vec<usize>,
    /// The first `found` of them are the causes of the model.
    pub candidates: Vec<Candidate>,
    pub found: usize,
    pub least_log_odds: f64,
    pub most_causes: usize,
    /// The prior deviations, and the small errors everywhere whose scales each resample estimates anew, with their
    /// first index.
    pub(super) std: Vec<f64>,
    pub(super) geometry: Option<(Geometry, usize)>,
    /// Where the group's parameters begin.
    pub first_group: usize,
    /// Of the session: what learning scales takes counts.
    pub(super) budget: WorkBudget,
    /// The scales without any cause on all postures, once they are asked for.
    pub(super) without_causes: OnceLock<Option<Spreads>>,
}

/// The small errors everywhere beside which sets of causes are compared in linear models, where pictures show the noise.
/// Of measured points only a model shows it, so that each cause changes what the others are.
pub(super) fn by_linear_models<'g>(problem: &Problem, beside: Option<&'g Geometry>) -> Option<&'g Geometry> {
    beside.filter(|group| !group.setup_only && problem.camera.is_some())
}

/// Whether two sets have the same members, each once.
pub(super) fn is_same_set(one: &[usize], other: &[usize]) -> bool {
    one.len() == other.len() && one.iter().all(|member| other.contains(member))
}

impl LinearSearch {
    /// A model that was found, linearised on each part of the postures (given as frames), with the columns of
    /// `competing` hypotheses, the most promising first.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn new(
        (search, found_model, noise): (&Search<'_>, &Model, Noise),
        geometry: Option<&Geometry>,
        competing: &Competing,
        parts: &[Vec<usize>],
    ) -> Result<Self> {
        let (problem, catalogue) = (&search.problem, search.catalogue);
        let (group, model): (_, Model) = search.loosened(found_model, None);
        let active = Active::of(problem, catalogue, &group, &model);
        // Only named causes crowd a place, and of these no zero of a joint where all are off by hand.
        let by_hand = |h: usize| geometry.is_some_and(|g| g.setup_only && g.holds(catalogue, h));
        let crowds = |h: usize| !catalogue.is_free(h) && !by_hand(h);
        let node = |h: usize| catalogue.hypotheses[h].place.node().filter(|_| crowds(h));
        let stays = |h: usize| catalogue.is_free(h) && !competing.free_forms;
        let of =
            |(hypothesis, variant): (usize, f64), columns: Range<usize>, slack: Range<usize>| Candidate {
                hypothesis,
                variant,
                columns,
                slack,
                log_prior: catalogue.log_prior(&problem.scene, hypothesis, variant),
                positive: catalogue.effect(hypothesis).is_positive(),
                node: node(hypothesis),
            };
        let slacks = slack_of_each(problem, catalogue, found_model, active.first_group);
        let of_a_law = |i: &usize| slacks.iter().any(|slack| slack.contains(i));
        let mut always: Vec<usize> = (0..active.first_term).filter(|i| !of_a_law(i)).collect();
        let mut candidates = Vec::new();
        let mut at = active.first_term;
        for (term, slack) in model.terms.iter().zip(&slacks) {
            let own = at..at + term.parameters.len();
            at = own.end;
            if stays(term.hypothesis) {
                always.extend(own);
            } else {
                candidates.push(of((term.hypothesis, term.variant), own, slack.clone()));
            }
        }
        let mut columns = active.columns.clone();
        let (mut std, mut values) = (active.prior_std.clone(), active.values.clone());
        let mut found = candidates.len();
        let mut added = 0;
        for (i, &(hypothesis, variant)) in competing.hypotheses.iter().enumerate() {
            let known = candidates.iter().any(|c| c.hypothesis == hypothesis);
            let left_out = search.options.left_out.contains(&hypothesis) || stays(hypothesis);
            if known || left_out || added >= competing.most {
                continue;
            }
            added += 1;
            found += usize::from(i < competing.found);
            let entry = &catalogue.hypotheses[hypothesis];
            let zero = vec![0.0; entry.prior_std.len()];
            let own = catalogue.effect(hypothesis).columns(&problem.scene, entry.place, variant, &zero);
            candidates.push(of((hypothesis, variant), columns.len()..columns.len() + own.len(), 0..0));
            std.extend(catalogue.prior_stds(hypothesis, variant));
            values.extend(zero);
            columns.extend(own);
        }
        let deformation = model.deformation(problem, catalogue, &group.columns);
        let with_board = changes_sight(problem, &columns);
        let mut equations = Vec::new();
        for frames in parts {
            let mut mask = vec![false; problem.frames.len()];
            frames.iter().for_each(|&f| mask[f] = true);
            let normal = Normal::at(
                problem,
                &deformation,
                noise,
                &columns,
                with_board,
                model.planes.as_deref(),
                Some(&mask),
            )?;
            let v = DVector::from_column_slice(&values);
            // From nothing: the gradient where all parameters are 0, to first order.
            let mut b = &normal.g + &normal.h * v;
            let mut h = normal.h;
            for i in 0..std.len() {
                b[i] *= std[i];
                for j in 0..std.len() {
                    h[(i, j)] *= std[i] * std[j];
                }
            }
            equations.push((h, b));
        }
        let first_group = active.first_group;
        // The scales of mounts have fixed priors, and causes are searched with these.
        let of_model = |g: &&Geometry| !g.setup_only && g.group.columns.len() <= model.group.len();
        let geometry = geometry.filter(of_model).map(|g| (g.clone(), first_group));
        Ok(Self {
            parts: equations,
            always,
            candidates,
            found,
            least_log_odds: search.options.least_log_odds,
            most_causes: found + MORE_CAUSES,
            std,
            geometry,
            first_group,
            budget: problem.budget.clone(),
            without_causes: OnceLock::new(),
        })
    }

    /// The normal equations of the parts with their weights.
    pub fn sum(&self, weights: &[f64]) -> Equations {
        let count = self.parts.first().map_or(0, |b| b.1.len());
        let (mut m, mut b) = (DMatrix::identity(count, count), DVector::zeros(count));
        for ((h, g), weight) in self.parts.iter().zip(weights).filter(|(_, w)| **w > 0.0) {
            m.as_mut_slice().iter_mut().zip(h.as_slice()).for_each(|(a, x)| *a += weight * x);
            b.axpy(*weight, g, 1.0);
        }
        (m, b)
    }

    /// The normal equations of all parts but one; of the only one where there are no others.
    pub fn all_but(&self, part: usize) -> Equations {
        let count = self.parts.len();
        self.sum(&(0..count).map(|p| f64::from(p != part || count == 1)).collect::<Vec<_>>())
    }

    /// The parameters of a set of candidates, with those that are always free before them.
    pub(super) fn indices(&self, set: &[usize]) -> Vec<usize> {
        let own = set.iter().flat_map(|&c| self.candidates[c].with_slack());
        self.always.iter().copied().chain(own).collect()
    }

    /// The equations of a set's parameters (without one of its members); none where numbers overflow.
    pub(super) fn base(&self, reduced: &Reduced, set: &[usize], but: Option<usize>) -> Option<Base> {
        let own = set.iter().filter(|c| Some(**c) != but);
        reduced.base(own.flat_map(|&c| self.candidates[c].with_slack()))
    }

    /// Log posterior odds of a candidate given others, its law as it is written.
    pub fn odds(&self, (reduced, base): (&Reduced, &Base), set: &[usize], candidate: usize) -> f64 {
        let of = &self.candidates[candidate];
        let Some(added) = reduced.added(base, of.columns.clone()) else { return f64::NEG_INFINITY };
        if of.positive && added.values.iter().all(|value| *value <= 0.0) {
            return f64::NEG_INFINITY;
        }
        let same = set
            .iter()
            .filter(|&&c| c != candidate && of.node.is_some() && self.candidates[c].node == of.node);
        added.log_evidence + of.log_prior + LOG_PRIOR_SAME_PLACE * same.count() as f64
    }

    /// The candidates that could be added to a set (without one of its members), with their odds.
    pub fn additions(
        &self,
        reduced: &Reduced,
        set: &[usize],
        but: Option<usize>,
    ) -> Option<Vec<(usize, f64)>> {
        let base = self.base(reduced, set, but)?;
        let others: Vec<usize> = set.iter().copied().filter(|c| Some(*c) != but).collect();
        let free = (0..self.candidates.len()).filter(|c| !others.contains(c));
        Some(free.map(|c| (c, self.odds((reduced, &base), &others, c))).collect())
    }

    /// The best candidate to add to a set (without one of its members), with its odds.
    fn best(&self, reduced: &Reduced, set: &[usize], but: Option<usize>) -> Option<(usize, f64)> {
        self.additions(reduced, set, but)?.into_iter().max_by(|x, y| x.1.total_cmp(&y.1))
    }

    /// The factor of the equations of a set's parameters with those that are always free before them, and their indices.
    pub fn factor(&self, (m, _): &Equations, set: &[usize]) -> Option<(Factor, Vec<usize>)> {
        let indices = self.indices(set);
        let among = DMatrix::from_fn(indices.len(), indices.len(), |i, j| m[(indices[i], indices[j])]);
        Some((cholesky(among)?, indices))
    }

    /// The values of all parameters, in their own units, where a set of candidates is best by the linear model; 0 of those that are not in it.
    pub fn values(&self, equations: &Equations, set: &[usize]) -> Option<Vec<f64>> {
        let (factor, indices) = self.factor(equations, set)?;
        let mean = factor.solve(&DVector::from_fn(indices.len(), |i, _| equations.1[indices[i]]));
        let mut values = vec![0.0; self.std.len()];
        indices.iter().zip(mean.iter()).for_each(|(&i, mean)| values[i] = mean * self.std[i]);
        values.iter().all(|v| v.is_finite()).then_some(values)
    }

    /// A model that was linearised with a set of candidates in place of its causes, its parameters where the linear model
    /// has them.
    pub fn model_with(
        &self,
        search: &Search<'_>,
        model: &Model,
        (equations, set): (&Equations, &[usize]),
    ) -> Model {
        let catalogue = search.catalogue;
        let mut model = model.clone();
        let chosen = |h: usize| set.iter().any(|&c| self.candidates[c].hypothesis == h);
        let competes = |h: usize| self.candidates.iter().any(|c| c.hypothesis == h);
        model.terms.retain(|t| !competes(t.hypothesis) || chosen(t.hypothesis));
        for candidate in set.iter().map(|&c| &self.candidates[c]) {
            if !model.terms.iter().any(|t| t.hypothesis == candidate.hypothesis) {
                model = model.with(catalogue, candidate.hypothesis, candidate.variant);
            }
        }
        let Some(best) = self.values(equations, set) else { return model };
        let active = Active::of(&search.problem, catalogue, &search.group, &model);
        let mut values = active.values.clone();
        values[..active.first_term].copy_from_slice(&best[..active.first_term]);
        let mut at = active.first_term;
        for term in &model.terms {
            let own = at..at + term.parameters.len();
            at = own.end;
            if let Some(&c) = set.iter().find(|&&c| self.candidates[c].hypothesis == term.hypothesis) {
                values[own].copy_from_slice(&best[self.candidates[c].columns.clone()]);
            }
        }
        for (value, positive) in values.iter_mut().zip(&active.positive) {
            *value = if *positive { value.max(0.0) } else { *value };
        }
        let moved = Model { planes: None, ..active.model(&model, &values) };
        if search.can_be(&moved) { moved } else { model }
    }

    /// Log of evidence times prior of a set, up to a constant.
    pub(super) fn log_posterior(&self, reduced: &Reduced, set: &[usize]) -> Option<f64> {
        let node = |c: usize| self.candidates[c].node;
        let same = |(i, &c): (usize, &usize)| {
            set[..i].iter().filter(|&&k| node(c).is_some() && node(k) == node(c)).count()
        };
        let prior: f64 = set.iter().map(|&c| self.candidates[c].log_prior).sum();
        let together = set.iter().enumerate().map(same).sum::<usize>() as f64;
        let evidence = reduced.log_evidence(&self.base(reduced, set, None)?);
        Some(evidence + prior + LOG_PRIOR_SAME_PLACE * together)
    }

    /// Causes added to a set, dropped and exchanged until nothing changes.
    pub fn searched(&self, reduced: &Reduced, mut set: Vec<usize>) -> Option<Vec<usize>> {
        for _ in 0..2 {
            while set.len() < self.most_causes {
                let Some((next, odds)) = self.best(reduced, &set, None) else { break };
                if odds < self.least_log_odds {
                    break;
                }
                set.push(next);
            }
            let mut changed = false;
            for at in 0..set.len() {
                let own = set[at];
                let (best, odds) = self.best(reduced, &set, Some(own))?;
                if best != own && odds >= self.least_log_odds {
                    set[at] = best;
                    changed = true;
                }
            }
            let before = set.len();
            let mut at = 0;
            while at < set.len() {
                let base = self.base(reduced, &set, Some(set[at]))?;
                if self.odds((reduced, &base), &set, set[at]) >= self.least_log_odds {
                    at += 1;
                } else {
                    set.remove(at);
                }
            }
            if !changed && set.len() == before {
                break;
            }
        }
        Some(set)
    }
}
