//! Candidates that could be added to a model: the hypotheses that the score test ranks high, fitted, each with the
//! most probable value of its discrete unknown (a friction torque, a side).

use crate::diagnose::effects::hypothesis::{Model, Term};
use crate::diagnose::likelihood::fit::{Fit, FitOptions, Until, fit_until};
use crate::diagnose::likelihood::linearised::likeliest_variants;
use crate::diagnose::likelihood::score_test::{Score, screen};
use crate::diagnose::model::problem::Noise;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{BEYOND_DOUBT, Guard, MAJORITY, Size, Threshold};
use crate::diagnose::selection::ranked::Ranked;
use crate::diagnose::selection::search::Search;
use crate::error::Result;
use rayon::prelude::*;
use std::sync::OnceLock;

/// Of candidates with a discrete unknown, and of the values of each, this many of the most probable are fitted
/// exactly.
const FITTED: Size = 3;
/// The score test is linearised: a hypothesis that it ranks lower than the best by more than this (log), and by
/// more than this share of the best's, is not the best when fitted either.
pub(super) const LEAST_REACH: Threshold = 25.0;
pub(super) const REACH: Threshold = 0.15;
/// The same for hypotheses with a discrete unknown, which the score test evaluates at a play of zero width.
const REACH_OF_VARIANTS: Threshold = MAJORITY;
/// The share of the score test's estimate at which a fit starts that got worse from the estimate itself.
const NEXT_TO_NOTHING: Guard = 1e-3;

impl Search<'_> {
    /// Fits the most promising additions to a model, at a noise; best first. `but` is a fit that is already in the
    /// model's place; it is left out, and the others must compete with its misfit.
    pub fn candidates(
        &self,
        model: &Model,
        noise: Noise,
        count: usize,
        but: Option<(usize, &Fit)>,
    ) -> Result<Vec<Fit>> {
        self.fitted(&self.ranked(&self.sums_at(model, noise)?, &[]), noise, count, but)
    }

    /// The same of what was ranked.
    pub(super) fn fitted(
        &self,
        ranked: &Ranked,
        noise: Noise,
        count: usize,
        but: Option<(usize, &Fit)>,
    ) -> Result<Vec<Fit>> {
        let Ranked { model, group, start, screening } = ranked;
        let chosen = self.most_promising(&screening.scores, count, but.map(|b| b.0));
        if chosen.is_empty() {
            return Ok(Vec::new());
        }
        let once = OnceLock::new();
        // The misfit of the model alone. Where it cannot be, any is better. No other may wait for it: a thread that sums frames takes up other
        // candidates meanwhile, and would wait for itself.
        let alone = || {
            once.get().copied().unwrap_or_else(|| {
                let misfit =
                    || self.fit_with_slack(model, None, noise, 0).map_or(f64::INFINITY, |f| f.misfit);
                let misfit = screening.misfit.unwrap_or_else(misfit);
                *once.get_or_init(|| misfit)
            })
        };
        let with = |model: &Model, score: &Score, share: f64| {
            let mut next = model.with(self.catalogue, score.hypothesis, score.variant);
            if let Some(term) = next.terms.last_mut() {
                let positive = self.catalogue.effect(score.hypothesis).is_positive();
                let bounded = |p: &f64| if positive { p.max(0.0) } else { *p };
                term.parameters = score.parameters.iter().map(|p| share * bounded(p)).collect();
            }
            next
        };
        // Where the linear model has all at its best: mostly a step from the end.
        let fitted_along = |score: &Score, hopeless: f64| {
            let next = with(&screening.active.model(start, &screening.moved_along(score)?), score, 1.0);
            let options = FitOptions { noise, steps: SOLVER.candidate_steps };
            let (problem, catalogue) = (&self.problem, self.catalogue);
            let until = Until::Least { hopeless };
            let mut fit = fit_until(problem, catalogue, group, &next, options, self.mask, until).ok()?;
            fit.model.group.truncate(model.group.len());
            Some(fit)
        };
        let fitted_from = |score: &Score, share: f64, hopeless: f64| {
            let next = with(model, score, share);
            let last = next.terms.len() - 1;
            // A linear estimate may lie where no camera or mirror can be: such a hypothesis is no candidate.
            self.fit_below(&next, Some(last), noise, SOLVER.candidate_steps, hopeless).ok()
        };
        let misfit = |f: &Option<Fit>| f.as_ref().map_or(f64::INFINITY, |f| f.misfit);
        let fitted_alone = |score: &Score, hopeless: f64| {
            let no_worse = |fit: &Option<Fit>| {
                fit.as_ref().is_some_and(|f| but.is_some() && f.misfit <= hopeless || f.misfit <= alone())
            };
            let fit = fitted_along(score, hopeless);
            if no_worse(&fit) {
                return fit;
            }
            let fit = fitted_from(score, 1.0, hopeless);
            if no_worse(&fit) {
                return fit;
            }
            // Far from the linear model: where a zero is far off and the mounts compensate it, every observation
            // looks false at the estimate, and the fit does not move. From almost zero it converges.
            let again = fitted_from(score, NEXT_TO_NOTHING, hopeless);
            if misfit(&again) < misfit(&fit) { again } else { fit }
        };
        let fitted = |score: &&Score, hopeless: f64| {
            let fit = fitted_alone(score, hopeless);
            if self.problem.slips.is_empty() {
                return fit;
            }
            let Some(next) = self.with_what_its_slips_took(&with(model, score, 1.0)) else { return fit };
            let last = next.terms.len() - 1;
            let other = self.fit_below(&next, Some(last), noise, SOLVER.candidate_steps, hopeless).ok();
            if misfit(&other) < misfit(&fit) { other } else { fit }
        };
        // The others need not be fitted to convergence if they fall far behind the first, or behind what is there
        // already.
        let hopeless = |fit: Option<&Fit>| fit.map_or(f64::INFINITY, |f| f.misfit + 2.0 * BEYOND_DOUBT);
        let own = hopeless(but.map(|b| b.1));
        let mut fits: Vec<Fit> = chosen.first().and_then(|score| fitted(score, own)).into_iter().collect();
        let least = own.min(hopeless(fits.first()));
        fits.extend(
            chosen
                .get(1..)
                .unwrap_or_default()
                .par_iter()
                .filter_map(|score| fitted(score, least))
                .collect::<Vec<Fit>>(),
        );
        self.problem.cancel.check()?;
        fits.sort_by(|a, b| self.log_posterior(b).total_cmp(&self.log_posterior(a)));
        // The score test uses a play of zero width; with its real width another friction may fit far better, and another
        // course to the same posture by any amount.
        for (rank, fit) in fits.iter_mut().enumerate() {
            *fit = self.best_variant(fit, noise, rank < FITTED)?;
        }
        fits.sort_by(|a, b| self.log_posterior(b).total_cmp(&self.log_posterior(a)));
        Ok(fits)
    }

    /// The scores of all hypotheses that are not yet in a model, best first, with discrepancy terms of its causes' laws.
    pub(super) fn scores(&self, model: &Model, noise: Noise) -> Result<Vec<Score>> {
        let (group, start) = self.loosened(model, None);
        Ok(screen(&self.problem, self.catalogue, &group, &start, noise, self.mask)?.scores)
    }

    /// A value of a cause's discrete unknown that the score test cannot tell from its own.
    fn variant_beside(&self, term: &Term) -> Option<f64> {
        let (effect, place) =
            (self.catalogue.effect(term.hypothesis), self.catalogue.hypotheses[term.hypothesis].place);
        effect.variant_beside(&self.problem.scene, place, term.variant, &term.parameters)
    }

    /// The last cause with the best of its discrete unknowns, each fitted: those that the score test tried too if `all`,
    /// and what it cannot tell.
    fn best_variant(&self, fit: &Fit, noise: Noise, all: bool) -> Result<Fit> {
        let Some(term) = fit.model.terms.last() else { return Ok(fit.clone()) };
        let laws = self.catalogue.laws(term.hypothesis);
        let mut variants = if all && laws.len() > 1 { laws.to_vec() } else { Vec::new() };
        variants.extend(self.variant_beside(term));
        if variants.is_empty() {
            return Ok(fit.clone());
        }
        let last = fit.model.terms.len() - 1;
        let likeliest = self.likeliest_variants(&fit.model, (last, Some(last)), noise, &variants)?;
        let tried = likeliest
            .par_iter()
            .map(|&variant| {
                let mut model = fit.model.clone();
                model.terms[last].variant = variant;
                let hopeless = fit.misfit + 2.0 * BEYOND_DOUBT;
                self.fit_below(&model, Some(last), noise, SOLVER.candidate_steps, hopeless)
            })
            .collect::<Result<Vec<Fit>>>()?;
        let best = tried.into_iter().max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence));
        Ok(best.filter(|b| b.log_evidence > fit.log_evidence).unwrap_or_else(|| fit.clone()))
    }

    /// The most probable values of a cause's discrete unknown, with discrepancy terms of the laws of all other
    /// causes.
    fn likeliest_variants(
        &self,
        model: &Model,
        (i, in_question): (usize, Option<usize>),
        noise: Noise,
        variants: &[f64],
    ) -> Result<Vec<f64>> {
        let (group, start) = match in_question {
            Some(_) => self.loosened(model, in_question),
            None => (self.group.clone(), model.clone()),
        };
        let mut sorted = likeliest_variants(
            &self.problem,
            self.catalogue,
            (&group, &start),
            i,
            variants,
            noise,
            self.mask,
        )?;
        sorted.truncate(FITTED);
        Ok(sorted)
    }

    /// The best variant of each of the `count` best hypotheses that could be the best when fitted exactly.
    pub(crate) fn most_promising<'s>(
        &self,
        scores: &'s [Score],
        count: usize,
        but: Option<usize>,
    ) -> Vec<&'s Score> {
        let value = |s: &Score| s.log_bayes + self.catalogue.hypotheses[s.hypothesis].log_prior;
        let wanted = |s: &&Score| {
            let unnamed = self.options.named_only && self.catalogue.is_free(s.hypothesis);
            !unnamed && !self.options.left_out.contains(&s.hypothesis)
        };
        let mut sorted: Vec<&Score> = scores.iter().filter(wanted).collect();
        sorted.sort_by(|a, b| value(b).total_cmp(&value(a)));
        let best = sorted.first().map_or(0.0, |s| value(s));
        let several = |s: &Score| self.catalogue.laws(s.hypothesis).len() > 1;
        let mut chosen: Vec<&Score> = Vec::new();
        for score in sorted {
            let share = if several(score) { REACH_OF_VARIANTS } else { REACH };
            let in_reach = value(score) >= best - LEAST_REACH - share * best.max(0.0);
            let known = but == Some(score.hypothesis) && !several(score);
            if chosen.len() < count
                && in_reach
                && !known
                && !chosen.iter().any(|c| c.hypothesis == score.hypothesis)
            {
                chosen.push(score);
            }
        }
        chosen
    }

    /// Whether the score test at a model ranks any hypothesis so high.
    pub(super) fn could_add(&self, model: &Model, noise: Noise) -> Result<bool> {
        Ok(self.might_add(&self.ranked(&self.sums_at(model, noise)?, &[])))
    }

    /// Whether the score test ranks any hypothesis so high that it might be added once it is fitted.
    pub(super) fn might_add(&self, ranked: &Ranked) -> bool {
        let best = self.most_promising(&ranked.screening.scores, 1, None);
        let log_odds = |s: &Score| s.log_bayes + self.catalogue.hypotheses[s.hypothesis].log_prior;
        best.first().is_some_and(|s| log_odds(s) >= self.options.least_log_odds)
    }

    /// Refines discrete unknowns (friction torques) between the values that were screened.
    pub(super) fn refine_variants(&self, mut best: Fit, noise: Noise) -> Result<Fit> {
        for i in 0..best.model.terms.len() {
            if self.problem.budget.is_spent() {
                break;
            }
            let term = &best.model.terms[i];
            let hypothesis = &self.catalogue.hypotheses[term.hypothesis];
            let effect = self.catalogue.effect(term.hypothesis);
            let mut near = effect.variants_near(&self.problem.scene, hypothesis.place, term.variant);
            near.extend(self.variant_beside(term));
            if near.is_empty() {
                continue;
            }
            let tried = self
                .likeliest_variants(&best.model, (i, None), noise, &near)?
                .par_iter()
                .map(|&variant| {
                    let mut model = best.model.clone();
                    model.terms[i].variant = variant;
                    self.fit(&model, noise, SOLVER.candidate_steps)
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
}
