//! The search for causes: they are added one at a time; each is tested again for dropping and for exchange with its
//! alternatives.

use crate::diagnose::criteria::cross_validation::{PostureGap, held_out};
use crate::diagnose::data::diagnosis::{Cause, Estimate};
use crate::diagnose::effects::hypothesis::{Catalogue, Model, Term};
use crate::diagnose::likelihood::fit::{Fit, FitOptions, Group, Until, fit, fit_until};
use crate::diagnose::likelihood::joint_scatter::{Scatter, Widening};
use crate::diagnose::likelihood::linearised::Linearised;
use crate::diagnose::likelihood::noise::effective_from;
use crate::diagnose::likelihood::nominal_sums::NominalSums;
use crate::diagnose::likelihood::normal_equations::counts;
use crate::diagnose::likelihood::probability::{tempered, unfinished};
use crate::diagnose::model::problem::{Noise, Problem};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{BEYOND_DOUBT, LEAST_LOG_ODDS};
use crate::diagnose::random_effects::law_discrepancy::with_slack;
use crate::diagnose::selection::scored_model::ScoredModel;
use crate::error::Result;
use rayon::prelude::*;
use std::sync::Arc;

/// How the search goes.
#[derive(Debug, Clone)]
pub(crate) struct SearchOptions {
    /// No more causes than this.
    pub most_causes: usize,
    /// How many of the screened hypotheses are fitted exactly at each step.
    pub refined: usize,
    /// Whether free-form errors are left alone.
    pub named_only: bool,
    /// Hypotheses that are no candidates: the group already explains what they would.
    pub left_out: Vec<usize>,
    /// A cause is kept when its log posterior odds against "not there" exceed this: 3 is 20 to 1.
    pub least_log_odds: f64,
}

impl Default for SearchOptions {
    fn default() -> Self {
        Self {
            most_causes: 6,
            refined: 6,
            named_only: false,
            left_out: Vec::new(),
            least_log_odds: LEAST_LOG_ODDS,
        }
    }
}

impl SearchOptions {
    /// With at most this many causes; 0 for the default.
    pub fn of(most_causes: usize) -> Self {
        let usual = Self::default();
        let most_causes = if most_causes == 0 { usual.most_causes } else { most_causes };
        Self { most_causes, ..usual }
    }
}

/// A model that the search ended with.
#[derive(Debug, Clone)]
pub(crate) struct Found {
    pub fit: Fit,
    /// The noise of the evidence: the measurement's, or more where the model leaves more.
    pub noise: Noise,
    /// The trace: one line for each step.
    pub trace: Vec<String>,
    /// Whether the search ended at its limit of work.
    pub cut_off: bool,
}

/// The input of the search.
#[derive(Clone)]
pub(crate) struct Search<'a> {
    /// Owned: gravity's loads in its scene follow the actual postures of the model found so far.
    pub problem: Problem,
    pub catalogue: &'a Catalogue,
    pub group: Group,
    pub measured_noise: Noise,
    /// The factor by which the noise was increased for correlation over frames; 1 where there is none.
    pub noise_widening: f64,
    /// The scatter of all joints that the measured noise was increased for.
    pub scatter: Option<Scatter>,
    pub options: SearchOptions,
    pub mask: Option<&'a [bool]>,
    /// Causes that were added although another was about as probable, with that other.
    pub ties: Vec<(usize, Term)>,
    /// The sums at the nominal model.
    pub nominal_sums: Option<Arc<NominalSums>>,
}

impl Search<'_> {
    pub fn fit(&self, model: &Model, noise: Noise, steps: usize) -> Result<Fit> {
        fit(&self.problem, self.catalogue, &self.group, model, FitOptions { noise, steps }, self.mask)
    }

    /// A model fitted at the scatter that it leaves itself, with that: both in turn.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn fit_at_its_scatter(&self, start: &Model) -> Result<(Fit, Noise)> {
        let rough = self.fit(start, self.effective(start)?, SOLVER.loose_steps)?;
        let noise = self.effective(&rough.model)?;
        Ok((self.fit(&rough.model, noise, SOLVER.loose_steps)?, noise))
    }

    /// As [`Search::fit`], with discrepancy terms of the laws of all causes but the one in question
    /// ([`crate::diagnose::random_effects::law_discrepancy`]). The fit's model is without the discrepancy terms'
    /// values.
    pub fn fit_with_slack(
        &self,
        model: &Model,
        in_question: Option<usize>,
        noise: Noise,
        steps: usize,
    ) -> Result<Fit> {
        self.fit_below(model, in_question, noise, steps, f64::INFINITY)
    }

    /// As [`Search::fit_with_slack`], given up once it is clear that the misfit stays above `hopeless`.
    pub fn fit_below(
        &self,
        model: &Model,
        in_question: Option<usize>,
        noise: Noise,
        steps: usize,
        hopeless: f64,
    ) -> Result<Fit> {
        let (group, start) = self.loosened(model, in_question);
        let options = FitOptions { noise, steps };
        let until = Until::Least { hopeless };
        let mut fit = fit_until(&self.problem, self.catalogue, &group, &start, options, self.mask, until)?;
        fit.model.group.truncate(model.group.len());
        Ok(fit)
    }

    /// The group with the discrepancy terms of a model's causes, and the model with room for their values.
    pub fn loosened(&self, model: &Model, in_question: Option<usize>) -> (Group, Model) {
        let group = with_slack(&self.problem, self.catalogue, &self.group, model, in_question);
        let mut start = model.clone();
        start.group.resize(group.columns.len(), 0.0);
        (group, start)
    }

    /// A fitted model without its i-th cause, with the others at the optimum of the linear model: the start of a
    /// fit of the rest.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn taken_out(&self, model: &Model, i: usize, noise: Noise) -> Result<Model> {
        let options = FitOptions { noise, steps: 0 };
        let here = Linearised::at(&self.problem, self.catalogue, &self.group, model, options, self.mask)?;
        let own = here.of_term(model, i);
        let nothing = vec![0.0; own.len()];
        let moved = here.moved_with(model, &own, &nothing).filter(|m| self.can_be(m));
        Ok(moved.unwrap_or_else(|| model.clone()).without(i))
    }

    /// Whether a model's camera and mirror can be: a linear model may lead to a focal length below zero.
    pub fn can_be(&self, model: &Model) -> bool {
        self.problem.eye(&self.deformation(model)).is_ok()
    }

    /// The frames that count.
    pub fn frames(&self) -> Vec<usize> {
        (0..self.problem.frames.len()).filter(|&frame| counts(self.mask, frame)).collect()
    }

    /// The measured noise as the views of one posture show it.
    pub fn noise_of_views(&self) -> Noise {
        let detector = self.detector_noise();
        Noise { marker_px: detector.marker_px / self.noise_widening, ..detector }
    }

    /// The measured noise without what it was increased by for scattered joints.
    pub fn detector_noise(&self) -> Noise {
        self.scatter.map_or(Widening::NONE, |s| s.widening).undone(self.measured_noise)
    }

    /// What the priors of a model's causes and of its group add to −2 log of its posterior.
    pub fn penalty(&self, model: &Model) -> f64 {
        let group = model.group.iter().zip(&self.group.prior_std).map(|(v, s)| (v / s).powi(2));
        let of_term = |t: &Term| -> f64 {
            let stds = self.catalogue.prior_stds(t.hypothesis, t.variant);
            t.parameters.iter().zip(stds).map(|(v, s)| (v / (s * t.prior_scale)).powi(2)).sum()
        };
        group.sum::<f64>() + model.terms.iter().map(of_term).sum::<f64>()
    }

    pub fn effective(&self, model: &Model) -> Result<Noise> {
        let deformation = model.deformation(&self.problem, self.catalogue, &self.group.columns);
        let planes = model.planes.as_deref();
        effective_from(&self.problem, &deformation, self.measured_noise, planes, self.mask)
    }

    /// The deformation of a model, the input of the forward model.
    pub fn deformation(&self, model: &Model) -> crate::diagnose::model::deformation::Deformation {
        model.deformation(&self.problem, self.catalogue, &self.group.columns)
    }

    /// The gap of a model on regions that its parameters did not see.
    pub fn held_out(&self, model: &Model, noise: Noise) -> Result<Vec<PostureGap>> {
        let measured = self.detector_noise();
        held_out(&self.problem, self.catalogue, &self.group, model, noise, measured, false)
    }

    /// The same if free-form errors are fitted with the rest but predict nothing.
    pub fn held_out_of_causes(&self, model: &Model, noise: Noise) -> Result<Vec<PostureGap>> {
        let measured = self.detector_noise();
        held_out(&self.problem, self.catalogue, &self.group, model, noise, measured, true)
    }

    /// Fits a model with gravity's loads taken at its own postures: load and posture are found in turn.
    pub fn settle(&mut self, mut best: Fit, noise: Noise) -> Result<Fit> {
        let by_load = |t: &Term| self.catalogue.effect(t.hypothesis).depends_on_load();
        let loaded = best.model.terms.iter().any(by_load);
        for _ in 0..if loaded { SOLVER.load_steps } else { 0 } {
            let deformation = best.model.deformation(&self.problem, self.catalogue, &self.group.columns);
            self.problem.scene.update_loads(&deformation);
            best = self.fit(&best.model, noise, SOLVER.final_steps)?;
        }
        self.refine_variants(best, noise)
    }

    /// Adds, drops and exchanges causes until none of these makes the model more probable.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn run(&mut self, start: Model) -> Result<Found> {
        let (mut trace, mut cut_off) = (Vec::new(), false);
        let mut noise = self.effective(&start)?;
        let mut best = self.fit(&start, noise, SOLVER.final_steps)?;
        noise = self.effective(&best.model)?;
        if !best.model.terms.is_empty() {
            best = self.prune(best, noise, &mut trace)?.0;
            noise = self.effective(&best.model)?;
        }
        let mut sums = None;
        let mut seen = vec![hypotheses_of(&best)];
        while best.model.terms.len() < self.options.most_causes {
            let ranked = self.ranked(self.scored(&mut sums, &best.model, noise)?, &[]);
            if self.problem.budget.is_spent() {
                cut_off = self.might_add(&ranked);
                if cut_off {
                    trace.push("the search ends at its limit of work".into());
                }
                break;
            }
            let candidates = self.fitted(&ranked, noise, self.options.refined, None)?;
            let Some(first) = candidates.first() else { break };
            // Weighed at the noise that the larger model leaves: the smaller one must not hide behind its own misfit.
            let next_noise = self.effective(&first.model)?;
            let least = self.log_posterior(first) - BEYOND_DOUBT;
            let refits = candidates
                .par_iter()
                .take(3)
                .filter(|c| self.log_posterior(c) > least)
                .map(|c| {
                    let last = c.model.terms.len() - 1;
                    self.fit_with_slack(&c.model, Some(last), next_noise, SOLVER.final_steps)
                })
                .collect::<Result<Vec<Fit>>>()?;
            let mut refits = refits;
            refits.sort_by(|a, b| self.log_posterior(b).total_cmp(&self.log_posterior(a)));
            // The most probable candidate above the tolerated size; a more probable one within tolerance is
            // skipped.
            let (mut larger, mut its_odds) = (None, 0.0);
            let likeliest = refits.first().map_or(0.0, |r| self.log_posterior(r));
            let as_likely = |r: &&Fit| self.log_posterior(r) >= likeliest - LEAST_LOG_ODDS;
            let near: Vec<Term> =
                refits.iter().filter(as_likely).filter_map(|r| r.model.terms.last().cloned()).collect();
            for refit in refits {
                if self.log_posterior(&refit) < likeliest - LEAST_LOG_ODDS {
                    break;
                }
                let odds = self.log_odds(&refit, refit.model.terms.len() - 1, next_noise)?;
                trace.push(format!(
                    "add {}: log odds {odds:.1} at {:.3} px, {:.3} mm",
                    self.name_of_last(&refit),
                    next_noise.marker_px,
                    next_noise.point_m * 1e3
                ));
                if odds >= self.options.least_log_odds {
                    (larger, its_odds) = (Some(refit), odds);
                    break;
                }
                // If the odds of the most probable addition are this low, the others need not be tried.
                if odds < -LEAST_LOG_ODDS {
                    break;
                }
            }
            let Some(larger) = larger else { break };
            if let Some(taken) = larger.model.terms.last().map(|t| t.hypothesis) {
                let others = near.into_iter().filter(|t| t.hypothesis != taken);
                self.ties.extend(others.map(|other| (taken, other)));
            }
            best = self.settle(larger, next_noise)?;
            noise = self.effective(&best.model)?;
            best = self.fit(&best.model, noise, SOLVER.final_steps)?;
            best = self.exchange(best, noise, &mut sums, &mut trace)?;
            best = self.merge(best, noise, &mut sums, &mut trace)?;
            let odds;
            (best, odds) = self.prune_to(1, best, noise, &mut sums, &mut trace)?;
            self.tell(&best, if odds.is_empty() { core::slice::from_ref(&its_odds) } else { &odds });
            noise = self.effective(&best.model)?;
            // Adding and dropping must not go in circles.
            let now = hypotheses_of(&best);
            if seen.contains(&now) {
                break;
            }
            seen.push(now);
        }
        Ok(Found { fit: best, noise, trace, cut_off })
    }

    /// Reports the intermediate result to the observer; `odds`: each cause's log odds.
    fn tell(&self, fit: &Fit, odds: &[f64]) {
        if !self.problem.progress.is_watched() {
            return;
        }
        let named = fit.model.terms.iter().enumerate().filter(|(_, t)| !self.catalogue.is_free(t.hypothesis));
        let causes = named.map(|(i, term)| {
            let effect = self.catalogue.effect(term.hypothesis);
            let place = self.catalogue.hypotheses[term.hypothesis].place;
            let told =
                term.parameters.iter().zip(fit.stds(i)).map(|(value, std)| Estimate { value: *value, std });
            Cause {
                effect: effect.name().to_owned(),
                at: place.name(&self.problem.scene),
                kind: effect.concern(place).word().into(),
                probability: odds.get(i).map_or(0.0, |o| unfinished(tempered(*o))),
                stability: None,
                parameters: effect.parameters().into_iter().zip(told).collect(),
                alternatives: Vec::new(),
                words: effect.words().to_owned(),
                rms_shift: 0.0,
                members: Vec::new(),
                frames: Vec::new(),
            }
        });
        self.problem.progress.tell_causes(causes.collect());
    }

    fn name_of_last(&self, fit: &Fit) -> String {
        fit.model
            .terms
            .last()
            .map_or_else(String::new, |t| self.catalogue.name(&self.problem.scene, t.hypothesis))
    }

    /// Drops causes without which the model is no worse, but not the last one; also returns the log odds of each that is
    /// left, unless it is the only one.
    pub fn prune(&mut self, best: Fit, noise: Noise, trace: &mut Vec<String>) -> Result<(Fit, Vec<f64>)> {
        self.prune_to(1, best, noise, &mut None, trace)
    }

    /// The same down to so many causes; with the sums at a model, if they are at hand.
    pub(super) fn prune_to(
        &mut self,
        fewest: usize,
        mut best: Fit,
        noise: Noise,
        sums: &mut Option<ScoredModel>,
        trace: &mut Vec<String>,
    ) -> Result<(Fit, Vec<f64>)> {
        let (mut i, mut kept) = (0, Vec::new());
        while best.model.terms.len() > fewest && i < best.model.terms.len() {
            let at_hand = sums.as_ref().filter(|s| s.is_of(&best.model, noise));
            let clear = at_hand.and_then(|s| self.odds_beyond_doubt(&best.model, i, s));
            let odds = match clear {
                Some(odds) => odds,
                None => self.log_odds(&best, i, noise)?,
            };
            if odds < self.options.least_log_odds {
                let name = self.catalogue.name(&self.problem.scene, best.model.terms[i].hypothesis);
                trace.push(format!("drop {name}: log odds {odds:.1}"));
                let rest = self.taken_out(&best.model, i, noise)?;
                let without = self.fit(&rest, noise, SOLVER.final_steps)?;
                best = self.settle(without, noise)?;
                i = 0;
                kept.clear();
            } else {
                i += 1;
                kept.push(odds);
            }
        }
        Ok((best, kept))
    }

    /// Replaces causes by better alternatives, given the other causes.
    fn exchange(
        &mut self,
        mut best: Fit,
        noise: Noise,
        sums: &mut Option<ScoredModel>,
        trace: &mut Vec<String>,
    ) -> Result<Fit> {
        // The last was the best of all. What comes in the place of a cause goes to the end; the cause that moves up is tested in the next
        // pass.
        for i in 0..best.model.terms.len().saturating_sub(1) {
            if self.problem.budget.is_spent() {
                break;
            }
            let own = best.model.terms[i].hypothesis;
            let ranked = self.ranked(self.scored(sums, &best.model, noise)?, &[i]);
            if self.most_promising(&ranked.screening.scores, 1, Some(own)).is_empty() {
                continue;
            }
            let here = self.fit_with_slack(&best.model, Some(i), noise, SOLVER.final_steps)?;
            let rivals = self.fitted(&ranked, noise, self.options.refined, Some((own, &here)))?;
            let Some(rival) = rivals.first() else { continue };
            if self.log_posterior(rival) < self.log_posterior(&here) - BEYOND_DOUBT {
                continue;
            }
            let last = rival.model.terms.len() - 1;
            let rival = self.fit_with_slack(&rival.model, Some(last), noise, SOLVER.final_steps)?;
            if self.log_posterior(&rival) > self.log_posterior(&here) + 1e-6 {
                let old = self.catalogue.name(&self.problem.scene, best.model.terms[i].hypothesis);
                let new = self.name_of_last(&rival);
                if old != new {
                    trace.push(format!("exchange {old} for {new}"));
                }
                best = self.settle(rival, noise)?;
            }
        }
        Ok(best)
    }

    /// Two causes at one joint are replaced by one that is as probable: stiction with its droop instead of play and
    /// a spring.
    fn merge(
        &mut self,
        mut best: Fit,
        noise: Noise,
        sums: &mut Option<ScoredModel>,
        trace: &mut Vec<String>,
    ) -> Result<Fit> {
        let node = |t: &Term| self.catalogue.hypotheses[t.hypothesis].place.node();
        let free = |t: &Term| self.catalogue.is_free(t.hypothesis);
        let terms = &best.model.terms;
        let pair = (0..terms.len()).flat_map(|i| (0..i).map(move |k| (i, k))).find(|&(i, k)| {
            node(&terms[i]).is_some()
                && node(&terms[i]) == node(&terms[k])
                && !free(&terms[i])
                && !free(&terms[k])
        });
        let Some((i, k)) = pair.filter(|_| !self.problem.budget.is_spent()) else { return Ok(best) };
        best = self.at_far_larger_scales(best, [i, k], noise)?;
        let terms = &best.model.terms;
        let mut ranked = self.ranked(self.scored(sums, &best.model, noise)?, &[i, k]);
        // Of this joint alone: elsewhere others may rank higher at a law's width of zero, where the score test looks.
        let of_joint = |h: usize| self.catalogue.hypotheses[h].place.node() == node(&terms[i]);
        ranked.screening.scores.retain(|score| of_joint(score.hypothesis));
        let merged = self.fitted(&ranked, noise, self.options.refined, None)?;
        // Few steps do not show how far each law comes: a play stands for sticking, up to where the joint turns back.
        let fitted = merged
            .par_iter()
            .map(|one| {
                let last = one.model.terms.len() - 1;
                self.fit_with_slack(&one.model, Some(last), noise, SOLVER.final_steps)
            })
            .collect::<Result<Vec<Fit>>>()?;
        let best_of =
            fitted.into_iter().max_by(|a, b| self.log_posterior(a).total_cmp(&self.log_posterior(b)));
        let Some(one) = best_of else { return Ok(best) };
        let two = self.fit_with_slack(&best.model, Some(i), noise, SOLVER.final_steps)?;
        if self.log_posterior(&one) > self.log_posterior(&two) {
            let name = |t: usize| self.catalogue.name(&self.problem.scene, terms[t].hypothesis);
            trace.push(format!("{} for {} and {}", self.name_of_last(&one), name(k), name(i)));
            best = self.settle(one, noise)?;
        }
        Ok(best)
    }
}

/// The causes of a model, in a fixed order.
fn hypotheses_of(fit: &Fit) -> Vec<usize> {
    let mut out: Vec<usize> = fit.model.terms.iter().map(|t| t.hypothesis).collect();
    out.sort_unstable();
    out
}
