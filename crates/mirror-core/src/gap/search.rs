//! The search for causes: added one at a time, each tried again for dropping and against its rivals.

use super::fit::{Fit, FitOptions, Group, fit};
use super::hypothesis::{Catalogue, Model, Term};
use super::noise::effective;
use super::problem::{Noise, Problem};
use super::screen::{Score, screen};
use super::shift::marker_shift;
use super::slack::with_slack;
use crate::error::Result;
use rayon::prelude::*;

/// How the search goes.
#[derive(Debug, Clone)]
pub(crate) struct SearchOptions {
    /// No more causes than this.
    pub most_causes: usize,
    /// How many of the screened hypotheses are fitted exactly at each step.
    pub refined: usize,
    /// Whether free-form errors are left alone.
    pub named_only: bool,
    /// A cause is kept when its log posterior odds against "not there" exceed this: 3 is 20 to 1.
    pub least_log_odds: f64,
}

impl Default for SearchOptions {
    fn default() -> Self {
        Self { most_causes: 6, refined: 6, named_only: false, least_log_odds: 3.0 }
    }
}

/// Gauss–Newton steps of a candidate, and of the model that is kept.
const CANDIDATE_STEPS: usize = 4;
const FINAL_STEPS: usize = 12;
/// Loads and postures are taken in turn this often: each turn leaves the share by which the droop changes the load.
const LOAD_STEPS: usize = 2;
/// Log of how much less likely a second cause is where there is one already: what looks like two is rather a law that
/// the vocabulary has not.
const LOG_PRIOR_SAME_PLACE: f64 = -4.0;
/// So many causes at one joint are a crowd: together they only imitate the law that is really there.
const CROWD: usize = 3;
const LOG_PRIOR_CROWD: f64 = -40.0;
/// A hypothesis that is less likely than the likeliest by this (log) is no cause in its stead.
const NEARLY_AS_LIKELY: f64 = 5.0;
/// Where the likeliest addition is this unlikely a cause, the others need not be tried.
const HOPELESS_LOG_ODDS: f64 = -3.5;
/// How many of the best candidates are tried with all their discrete unknowns.
const VARIANTS_RETRIED: usize = 3;
/// Share of a common size below which an error is called a tolerance.
const PRIOR_TOLERANCE: f64 = 0.005;
/// A tolerated error moves the markers by no more than this many standard deviations of the noise.
const UNSEEN_SHIFT: f64 = 0.08;
/// Factors on a discrete unknown (a friction torque) that are tried once the cause is found.
const VARIANT_FACTORS: [f64; 8] = [0.7, 0.8, 0.88, 0.95, 1.06, 1.14, 1.25, 1.4];

/// A model that the search ended with.
#[derive(Debug, Clone)]
pub(crate) struct Found {
    pub fit: Fit,
    /// The noise at which the evidence was weighed: the measurement's, or more where the model leaves more.
    pub noise: Noise,
    /// One line a step, for people who want to know how it went.
    pub trace: Vec<String>,
}

/// Everything that the search looks at.
#[derive(Clone)]
pub(crate) struct Search<'a> {
    /// Owned: gravity's loads in its scene follow the actual postures of the model found so far.
    pub problem: Problem,
    pub catalogue: &'a Catalogue,
    pub group: Group,
    pub measured_noise: Noise,
    pub options: SearchOptions,
    pub mask: Option<&'a [bool]>,
}

impl Search<'_> {
    pub fn fit(&self, model: &Model, noise: Noise, steps: usize) -> Result<Fit> {
        fit(&self.problem, self.catalogue, &self.group, model, FitOptions { noise, steps }, self.mask)
    }

    /// As [`Search::fit`], while the laws of all causes but the one in question may err a little ([`super::slack`]). The
    /// fit's model is without the slack's values.
    pub fn fit_with_slack(
        &self,
        model: &Model,
        in_question: Option<usize>,
        noise: Noise,
        steps: usize,
    ) -> Result<Fit> {
        let (group, start) = self.loosened(model, in_question);
        let mut fit =
            fit(&self.problem, self.catalogue, &group, &start, FitOptions { noise, steps }, self.mask)?;
        fit.model.group.truncate(model.group.len());
        Ok(fit)
    }

    /// The group with the slack of a model's causes, and the model with room for its values.
    pub fn loosened(&self, model: &Model, in_question: Option<usize>) -> (Group, Model) {
        let group = with_slack(&self.problem, self.catalogue, &self.group, model, in_question);
        let mut start = model.clone();
        start.group.resize(group.columns.len(), 0.0);
        (group, start)
    }

    pub fn effective(&self, model: &Model) -> Result<Noise> {
        let deformation = model.deformation(&self.problem, self.catalogue, &self.group.columns);
        effective(&self.problem, &deformation, self.measured_noise, self.mask)
    }

    /// Everything that a model says, as the forward model reads it.
    pub fn deformation(&self, model: &Model) -> super::deformation::Deformation {
        model.deformation(&self.problem, self.catalogue, &self.group.columns)
    }

    /// The gap of a model on regions that its parameters did not see.
    pub fn held_out(&self, model: &Model, noise: Noise) -> Result<Vec<super::heldout::PostureGap>> {
        super::heldout::held_out(
            &self.problem,
            self.catalogue,
            &self.group,
            model,
            noise,
            self.measured_noise,
        )
    }

    fn log_prior(&self, fit: &Fit) -> f64 {
        let place = |t: &Term| self.catalogue.hypotheses[t.hypothesis].place.node();
        let terms = &fit.model.terms;
        let named = |t: &&Term| !self.catalogue.is_free(t.hypothesis) && place(t).is_some();
        let crowding: f64 = terms
            .iter()
            .filter(named)
            .enumerate()
            .map(|(i, term)| {
                let same = terms.iter().filter(named).take(i).filter(|t| place(t) == place(term)).count();
                if same < CROWD - 1 { same as f64 * LOG_PRIOR_SAME_PLACE } else { LOG_PRIOR_CROWD }
            })
            .sum();
        terms.iter().map(|t| self.catalogue.hypotheses[t.hypothesis].log_prior).sum::<f64>() + crowding
    }

    /// Log of evidence times prior.
    pub fn log_posterior(&self, fit: &Fit) -> f64 {
        fit.log_evidence + self.log_prior(fit)
    }

    /// Fits the most promising additions to a model, at a noise; best first.
    pub fn candidates(&self, model: &Model, noise: Noise, count: usize) -> Result<Vec<Fit>> {
        let (group, start) = self.loosened(model, None);
        let scores = screen(&self.problem, self.catalogue, &group, &start, noise, self.mask)?;
        let chosen = self.most_promising(&scores, count);
        let mut fits = chosen
            .par_iter()
            .map(|score| {
                let mut next = model.with(self.catalogue, score.hypothesis, score.variant);
                if let Some(term) = next.terms.last_mut() {
                    let positive = self.catalogue.effect(score.hypothesis).is_positive();
                    term.parameters =
                        score.parameters.iter().map(|p| if positive { p.max(0.0) } else { *p }).collect();
                }
                let last = next.terms.len() - 1;
                self.fit_with_slack(&next, Some(last), noise, CANDIDATE_STEPS)
            })
            // A linear estimate may lie where no camera or mirror can be: such a hypothesis is no candidate.
            .filter_map(Result::ok)
            .collect::<Vec<Fit>>();
        fits.sort_by(|a, b| self.log_posterior(b).total_cmp(&self.log_posterior(a)));
        // The score test takes a play of no width; of its real width another friction may fit far better.
        for fit in fits.iter_mut().take(VARIANTS_RETRIED) {
            *fit = self.best_variant(fit, noise)?;
        }
        fits.sort_by(|a, b| self.log_posterior(b).total_cmp(&self.log_posterior(a)));
        Ok(fits)
    }

    /// The last cause with the best of all its discrete unknowns, each fitted.
    fn best_variant(&self, fit: &Fit, noise: Noise) -> Result<Fit> {
        let Some(term) = fit.model.terms.last() else { return Ok(fit.clone()) };
        let variants = &self.catalogue.hypotheses[term.hypothesis].variants;
        if variants.len() < 2 {
            return Ok(fit.clone());
        }
        let tried = variants
            .par_iter()
            .map(|&variant| {
                let mut model = fit.model.clone();
                if let Some(last) = model.terms.last_mut() {
                    last.variant = variant;
                }
                let last = model.terms.len() - 1;
                self.fit_with_slack(&model, Some(last), noise, CANDIDATE_STEPS)
            })
            .collect::<Result<Vec<Fit>>>()?;
        let best = tried.into_iter().max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence));
        Ok(best.filter(|b| b.log_evidence > fit.log_evidence).unwrap_or_else(|| fit.clone()))
    }

    /// The best variant of each of the `count` best hypotheses.
    fn most_promising<'s>(&self, scores: &'s [Score], count: usize) -> Vec<&'s Score> {
        let value = |s: &Score| s.log_bayes + self.catalogue.hypotheses[s.hypothesis].log_prior;
        let mut sorted: Vec<&Score> = scores.iter().collect();
        sorted.sort_by(|a, b| value(b).total_cmp(&value(a)));
        let mut chosen: Vec<&Score> = Vec::new();
        for score in sorted {
            if chosen.len() == count {
                break;
            }
            let wanted = !(self.options.named_only && self.catalogue.is_free(score.hypothesis));
            if wanted && !chosen.iter().any(|c| c.hypothesis == score.hypothesis) {
                chosen.push(score);
            }
        }
        chosen
    }

    /// Fits a model with gravity's loads taken at its own postures: load and posture are found in turn.
    fn settle(&mut self, mut best: Fit, noise: Noise) -> Result<Fit> {
        let by_load = |t: &Term| self.catalogue.effect(t.hypothesis).depends_on_load();
        let loaded = best.model.terms.iter().any(by_load);
        for _ in 0..if loaded { LOAD_STEPS } else { 0 } {
            let deformation = best.model.deformation(&self.problem, self.catalogue, &self.group.columns);
            self.problem.scene.update_loads(&deformation);
            best = self.fit(&best.model, noise, FINAL_STEPS)?;
        }
        self.refine_variants(best, noise)
    }

    /// Refines discrete unknowns (friction torques) between the values that were screened.
    fn refine_variants(&self, mut best: Fit, noise: Noise) -> Result<Fit> {
        for i in 0..best.model.terms.len() {
            let term = &best.model.terms[i];
            if self.catalogue.hypotheses[term.hypothesis].variants.len() < 2
                || !term.variant.is_finite()
                || term.variant == 0.0
            {
                continue;
            }
            let tried = VARIANT_FACTORS
                .par_iter()
                .map(|factor| {
                    let mut model = best.model.clone();
                    model.terms[i].variant *= factor;
                    self.fit(&model, noise, CANDIDATE_STEPS)
                })
                .collect::<Result<Vec<Fit>>>()?;
            if let Some(better) = tried.into_iter().max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
                && better.log_evidence > best.log_evidence
            {
                best = better;
            }
        }
        Ok(best)
    }

    /// The i-th cause at a size that is tolerated rather than called a cause, all else refitted: two percent of the size
    /// that such an error commonly has, and no more than could be seen. The laws of the other causes have their slack.
    fn tolerated(&self, fit: &Fit, i: usize, noise: Noise) -> Result<Fit> {
        let term = &fit.model.terms[i];
        let stds = &self.catalogue.hypotheses[term.hypothesis].prior_std;
        let multiple = (term.parameters.iter().zip(stds).map(|(p, s)| (p / s).powi(2)).sum::<f64>()
            / stds.len() as f64)
            .sqrt();
        let (all, without) = (self.deformation(&fit.model), self.deformation(&fit.model.without(i)));
        let own = marker_shift(&self.problem, &without, &all, noise)?;
        let own_sum: f64 = own.iter().sum();
        let own_rms = (own_sum / own.iter().filter(|o| **o > 1e-4 * own_sum).count().max(1) as f64).sqrt();
        let unseen = if own_rms > 0.0 { UNSEEN_SHIFT / own_rms * multiple } else { PRIOR_TOLERANCE };
        let scale = PRIOR_TOLERANCE.min(unseen).clamp(1e-6, 1.0);
        let mut model = fit.model.clone();
        model.terms[i].prior_scale = scale;
        model.terms[i].parameters.iter_mut().for_each(|p| *p *= scale.min(0.5));
        self.fit_with_slack(&model, Some(i), noise, FINAL_STEPS)
    }

    /// Log posterior odds of the i-th cause: found, against tolerated.
    pub fn log_odds(&self, fit: &Fit, i: usize, noise: Noise) -> Result<f64> {
        let tolerated = self.tolerated(fit, i, noise)?;
        let found = self.fit_with_slack(&fit.model, Some(i), noise, FINAL_STEPS)?;
        let rest = Fit { model: fit.model.without(i), ..fit.clone() };
        let prior = self.log_prior(fit) - self.log_prior(&rest);
        Ok(found.log_evidence + prior - tolerated.log_evidence)
    }

    /// Runs the ladder up and down until neither adding, dropping nor exchanging a cause helps.
    ///
    /// # Errors
    /// A camera or mirror that cannot be.
    pub fn run(&mut self, start: Model) -> Result<Found> {
        let mut trace = Vec::new();
        let mut noise = self.effective(&start)?;
        let mut best = self.fit(&start, noise, FINAL_STEPS)?;
        noise = self.effective(&best.model)?;
        if !best.model.terms.is_empty() {
            best = self.prune(best, noise, &mut trace)?;
            noise = self.effective(&best.model)?;
        }
        let mut seen = vec![hypotheses_of(&best)];
        while best.model.terms.len() < self.options.most_causes {
            let candidates = self.candidates(&best.model, noise, self.options.refined)?;
            let Some(first) = candidates.first() else { break };
            // Weighed at the noise that the larger model leaves: the smaller one must not hide behind its own misfit.
            let next_noise = self.effective(&first.model)?;
            let refits = candidates
                .iter()
                .take(3)
                .map(|c| {
                    let last = c.model.terms.len() - 1;
                    self.fit_with_slack(&c.model, Some(last), next_noise, FINAL_STEPS)
                })
                .collect::<Result<Vec<Fit>>>()?;
            let mut refits = refits;
            refits.sort_by(|a, b| self.log_posterior(b).total_cmp(&self.log_posterior(a)));
            // The likeliest that is a cause: a likelier one whose size is within tolerance leaves the place to the next.
            let mut larger = None;
            let likeliest = refits.first().map_or(0.0, |r| self.log_posterior(r));
            for refit in refits {
                if self.log_posterior(&refit) < likeliest - NEARLY_AS_LIKELY {
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
                    larger = Some(refit);
                    break;
                }
                if odds < HOPELESS_LOG_ODDS {
                    break;
                }
            }
            let Some(larger) = larger else { break };
            best = self.settle(larger, next_noise)?;
            noise = self.effective(&best.model)?;
            best = self.fit(&best.model, noise, FINAL_STEPS)?;
            best = self.exchange(best, noise, &mut trace)?;
            best = self.prune(best, noise, &mut trace)?;
            noise = self.effective(&best.model)?;
            // Adding and dropping must not go in circles.
            let now = hypotheses_of(&best);
            if seen.contains(&now) {
                break;
            }
            seen.push(now);
        }
        Ok(Found { fit: best, noise, trace })
    }

    fn name_of_last(&self, fit: &Fit) -> String {
        fit.model
            .terms
            .last()
            .map_or_else(String::new, |t| self.catalogue.name(&self.problem.scene, t.hypothesis))
    }

    /// Drops causes without which the model is no worse.
    pub fn prune(&mut self, mut best: Fit, noise: Noise, trace: &mut Vec<String>) -> Result<Fit> {
        let mut i = 0;
        while best.model.terms.len() > 1 && i < best.model.terms.len() {
            let odds = self.log_odds(&best, i, noise)?;
            if odds < self.options.least_log_odds {
                let name = self.catalogue.name(&self.problem.scene, best.model.terms[i].hypothesis);
                trace.push(format!("drop {name}: log odds {odds:.1}"));
                let without = self.fit(&best.model.without(i), noise, FINAL_STEPS)?;
                best = self.settle(without, noise)?;
                i = 0;
            } else {
                i += 1;
            }
        }
        Ok(best)
    }

    /// Replaces causes by better rivals, now that the others are there.
    fn exchange(&mut self, mut best: Fit, noise: Noise, trace: &mut Vec<String>) -> Result<Fit> {
        if best.model.terms.len() < 2 {
            return Ok(best);
        }
        for i in 0..best.model.terms.len() - 1 {
            let rivals = self.candidates(&best.model.without(i), noise, self.options.refined)?;
            let Some(rival) = rivals.first() else { continue };
            let last = rival.model.terms.len() - 1;
            let rival = self.fit_with_slack(&rival.model, Some(last), noise, FINAL_STEPS)?;
            let own = self.fit_with_slack(&best.model, Some(i), noise, FINAL_STEPS)?;
            if self.log_posterior(&rival) > self.log_posterior(&own) + 1e-6 {
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
}

/// The causes of a model, in a fixed order.
fn hypotheses_of(fit: &Fit) -> Vec<usize> {
    let mut out: Vec<usize> = fit.model.terms.iter().map(|t| t.hypothesis).collect();
    out.sort_unstable();
    out
}
