//! How likely a model is, and each of its causes: priors, evidence, and what is tolerated rather than called a cause.

use crate::diagnose::criteria::marker_shift::marker_shift;
use crate::diagnose::effects::hypothesis::{Model, Term};
use crate::diagnose::likelihood::fit::{Fit, FitOptions, Linearised};
use crate::diagnose::model::problem::Noise;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::{BEYOND_DOUBT, LOG_PRIOR_CROWD, LOG_PRIOR_SAME_PLACE};
use crate::diagnose::selection::search::Search;
use crate::error::Result;

/// So many causes at one joint are a crowd: together they only imitate the law that is really there.
const CROWD: usize = 3;
/// Share of a common size below which an error is called a tolerance.
const PRIOR_TOLERANCE: f64 = 0.005;
const LEAST_TOLERANCE: f64 = 1e-6;
/// A tolerated error moves the markers by no more than this many standard deviations of the noise.
const UNSEEN_SHIFT: f64 = 0.08;

impl Search<'_> {
    fn log_prior(&self, model: &Model) -> f64 {
        let place = |t: &Term| self.catalogue.hypotheses[t.hypothesis].place.node();
        let terms = &model.terms;
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
        fit.log_evidence + self.log_prior(&fit.model)
    }

    /// The i-th cause at a size that is tolerated rather than called a cause, all else refitted: at most
    /// [`PRIOR_TOLERANCE`] of the size that such an error commonly has, and no more than could be seen. The laws of the other causes have their slack.
    /// Given up where it is clear that the misfit stays above `hopeless`.
    fn tolerated(&self, fit: &Fit, i: usize, noise: Noise, hopeless: f64) -> Result<Fit> {
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
        let scale = PRIOR_TOLERANCE.min(unseen).clamp(LEAST_TOLERANCE, 1.0);
        let mut model = fit.model.clone();
        model.terms[i].prior_scale = scale;
        model.terms[i].parameters.iter_mut().for_each(|p| *p *= scale.min(0.5));
        self.fit_below(&model, Some(i), noise, SOLVER.final_steps, hopeless)
    }

    /// Log posterior odds of the i-th cause: found, against tolerated.
    pub fn log_odds(&self, fit: &Fit, i: usize, noise: Noise) -> Result<f64> {
        if let Some(odds) = self.clear_odds(fit, i, noise)? {
            return Ok(odds);
        }
        let found = self.fit_with_slack(&fit.model, Some(i), noise, SOLVER.final_steps)?;
        let tolerated = self.tolerated(fit, i, noise, found.misfit + 8.0 * BEYOND_DOUBT)?;
        Ok(found.log_evidence + self.log_prior_of(&fit.model, i) - tolerated.log_evidence)
    }

    /// Log prior odds of the i-th cause beside the others.
    fn log_prior_of(&self, model: &Model, i: usize) -> f64 {
        self.log_prior(model) - self.log_prior(&model.without(i))
    }

    /// The odds of the linearised model where they leave no doubt: nothing need be fitted then. At the largest and the
    /// smallest size that could be tolerated, whichever speaks more against the cause.
    fn clear_odds(&self, fit: &Fit, i: usize, noise: Noise) -> Result<Option<f64>> {
        let (group, start) = self.loosened(&fit.model, Some(i));
        let options = FitOptions { noise, steps: 0 };
        let here = Linearised::at(&self.problem, self.catalogue, &group, &start, options, self.mask)?;
        let own = here.of_term(&start, i);
        let Some(found) = here.log_evidence(own.clone(), 1.0) else { return Ok(None) };
        let tolerated = [PRIOR_TOLERANCE, LEAST_TOLERANCE].map(|scale| here.log_evidence(own.clone(), scale));
        let [Some(large), Some(small)] = tolerated else { return Ok(None) };
        let odds = found + self.log_prior_of(&fit.model, i) - large.max(small);
        // Exactly fitted they would still be beyond doubt.
        Ok((odds > 2.0 * BEYOND_DOUBT).then_some(odds))
    }
}
