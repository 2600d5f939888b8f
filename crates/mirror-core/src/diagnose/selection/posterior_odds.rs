//! Posterior odds of a model and of each of its causes: the prior over models, the evidence, and the size up to
//! which an error is tolerated instead of being called a cause.

use crate::diagnose::criteria::marker_shift::marker_shift;
use crate::diagnose::effects::hypothesis::{Model, Term};
use crate::diagnose::likelihood::fit::{Fit, FitOptions};
use crate::diagnose::likelihood::linearised::Linearised;
use crate::diagnose::model::problem::Noise;
use crate::diagnose::model::solver::{NEGLIGIBLE, SOLVER};
use crate::diagnose::principles::{
    BEYOND_DOUBT, LOG_PRIOR_CROWD, LOG_PRIOR_SAME_PLACE, Prior, SEVERAL_CAUSES,
};
use crate::diagnose::selection::scored_model::ScoredModel;
use crate::diagnose::selection::search::Search;
use crate::error::Result;
use core::ops::Range;

/// Share of a common size below which an error is called a tolerance.
const PRIOR_TOLERANCE: Prior = 0.005;
/// Upper bound of the shift of a tolerated error, in standard deviations of the noise.
const UNSEEN_SHIFT: Prior = 0.08;

impl Search<'_> {
    /// The prior over models: `log π(M) = Σ log π(effect, place) + Σ crowding`.
    ///
    /// The first sum is over the causes: all effects are equally probable, and so are an effect's places
    /// ([`Catalogue::log_prior`](crate::diagnose::effects::hypothesis::Catalogue::log_prior)). The second is a penalty for each further
    /// cause at one joint or link ([`LOG_PRIOR_SAME_PLACE`]), and excludes a third one ([`LOG_PRIOR_CROWD`]); one of the group's small errors is none. Both, and the priors of
    /// free-form errors and groups, are in `principles.rs`.
    fn log_prior(&self, model: &Model) -> f64 {
        let place = |t: &Term| self.catalogue.hypotheses[t.hypothesis].place.node();
        let terms = &model.terms;
        let named = |t: &&Term| {
            !self.catalogue.is_free(t.hypothesis) && place(t).is_some() && !self.is_of_the_group(t)
        };
        let crowding: f64 = terms
            .iter()
            .filter(named)
            .enumerate()
            .map(|(i, term)| {
                let same = terms.iter().filter(named).take(i).filter(|t| place(t) == place(term)).count();
                if same + 1 < SEVERAL_CAUSES { same as f64 * LOG_PRIOR_SAME_PLACE } else { LOG_PRIOR_CROWD }
            })
            .sum();
        let scene = &self.problem.scene;
        terms.iter().map(|t| self.catalogue.log_prior(scene, t.hypothesis, t.variant)).sum::<f64>() + crowding
    }

    /// Whether a cause is one of the group's small errors that is larger than these: a zero beside two laws of its
    /// joint is in the model in any case, and is no third law.
    fn is_of_the_group(&self, term: &Term) -> bool {
        !self.group.columns.is_empty()
            && self.group.contains(&self.catalogue.columns(&self.problem.scene, term))
    }

    /// Log of evidence times prior.
    pub fn log_posterior(&self, fit: &Fit) -> f64 {
        fit.log_evidence + self.log_prior(&fit.model)
    }

    /// The i-th cause at a tolerated size, everything else fitted again: at most [`PRIOR_TOLERANCE`] of the usual
    /// size of such an error, and too small to be observed. The laws of the other causes have their discrepancy
    /// terms. The fit is given up where the misfit clearly stays above `hopeless`. The other parameters start from
    /// the linear model at the cause as found, with room for the discrepancy terms' values.
    fn tolerated(
        &self,
        fit: &Fit,
        i: usize,
        (here, start): (&Linearised, &Model),
        noise: Noise,
        hopeless: f64,
    ) -> Result<Fit> {
        let term = &fit.model.terms[i];
        let stds = self.catalogue.prior_stds(term.hypothesis, term.variant);
        let multiple = (term.parameters.iter().zip(stds).map(|(p, s)| (p / s).powi(2)).sum::<f64>()
            / term.parameters.len() as f64)
            .sqrt();
        let (all, without) = (self.deformation(&fit.model), self.deformation(&fit.model.without(i)));
        let own = marker_shift(&self.problem, &without, &all, noise)?;
        let own_sum: f64 = own.iter().sum();
        let own_rms = (own_sum / own.iter().filter(|o| **o > 1e-4 * own_sum).count().max(1) as f64).sqrt();
        let unseen = if own_rms > 0.0 { UNSEEN_SHIFT / own_rms * multiple } else { PRIOR_TOLERANCE };
        let scale = PRIOR_TOLERANCE.min(unseen).clamp(NEGLIGIBLE, 1.0);
        let small: Vec<f64> = term.parameters.iter().map(|p| p * scale.min(0.5)).collect();
        let truncated = |mut m: Model| {
            m.group.truncate(fit.model.group.len());
            m
        };
        let moved = here.moved_with(start, &here.of_term(start, i), &small).map(truncated);
        let mut model = moved.filter(|m| self.can_be(m)).unwrap_or_else(|| fit.model.clone());
        model.terms[i].prior_scale = scale;
        model.terms[i].parameters = small;
        self.fit_below(&model, Some(i), noise, SOLVER.final_steps, hopeless)
    }

    /// Log posterior odds of the i-th cause: found, against tolerated.
    pub fn log_odds(&self, fit: &Fit, i: usize, noise: Noise) -> Result<f64> {
        let (group, start) = self.loosened(&fit.model, Some(i));
        let options = FitOptions { noise, steps: 0 };
        let here = Linearised::at(&self.problem, self.catalogue, &group, &start, options, self.mask)?;
        let linear = self.linear_odds(&fit.model, i, &here, here.of_term(&start, i));
        // At the limit of work the linear model decides.
        if let Some(odds) = linear.filter(|odds| is_clear(*odds) || self.problem.budget.is_spent()) {
            return Ok(odds);
        }
        let found = self.fit_with_slack(&fit.model, Some(i), noise, SOLVER.final_steps)?;
        let tolerated = self.tolerated(fit, i, (&here, &start), noise, found.misfit + 8.0 * BEYOND_DOUBT)?;
        Ok(found.log_evidence + self.log_prior_of(&fit.model, i) - tolerated.log_evidence)
    }

    /// Log prior odds of the i-th cause given the others.
    fn log_prior_of(&self, model: &Model, i: usize) -> f64 {
        self.log_prior(model) - self.log_prior(&model.without(i))
    }

    /// The odds of the linearised model if they are beyond doubt, from the sums at the model.
    pub(super) fn odds_beyond_doubt(&self, model: &Model, i: usize, sums: &ScoredModel) -> Option<f64> {
        let (here, own) = sums.in_question(i)?;
        self.linear_odds(model, i, &here, own).filter(|odds| is_clear(*odds))
    }

    /// The odds of the linearised model, evaluated at the largest and the smallest tolerated size: the stronger evidence against the
    /// cause is used. None where numbers overflow.
    fn linear_odds(&self, model: &Model, i: usize, here: &Linearised, own: Range<usize>) -> Option<f64> {
        let found = here.log_evidence(own.clone(), 1.0)?;
        let [large, small] = [PRIOR_TOLERANCE, NEGLIGIBLE].map(|scale| here.log_evidence(own.clone(), scale));
        Some(found + self.log_prior_of(model, i) - large?.max(small?))
    }
}

/// Whether odds of a linear model are such that those of exact fits would be beyond doubt too: these are not needed then.
fn is_clear(odds: f64) -> bool {
    odds > 2.0 * BEYOND_DOUBT
}
