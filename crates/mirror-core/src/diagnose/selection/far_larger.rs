//! Of two causes at one joint, one that is far larger than such causes are: another gear box, a link of another length.
//!
//! A Gaussian prior then is what is wrong. `½ (v/σ)²` costs more than a second cause that takes a part of v: over a short range
//! `e q + s sin q` is a ratio of `e + s`. So the scale of its prior is learned: `σ` times its deviations, the
//! likeliest scale of a single value, where another part can be the reason. Whether the second cause is needed beside it is decided by the odds, as for any other.

use crate::diagnose::likelihood::fit::Fit;
use crate::diagnose::model::problem::Noise;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::FAR_DEVIATIONS;
use crate::diagnose::selection::search::Search;
use crate::error::Result;

impl Search<'_> {
    /// The model with its own scales for those of two causes that are far larger than their priors, and may be.
    pub(super) fn at_far_larger_scales(&self, mut best: Fit, pair: [usize; 2], noise: Noise) -> Result<Fit> {
        let mut changed = false;
        for i in pair {
            let term = &mut best.model.terms[i];
            let may_be = self.catalogue.effect(term.hypothesis).may_be_of_another_part();
            let deviations = self.catalogue.deviations(term);
            if may_be && deviations > FAR_DEVIATIONS * term.prior_scale {
                (term.prior_scale, changed) = (deviations, true);
            }
        }
        if changed {
            best = self.fit(&best.model, noise, SOLVER.final_steps)?;
        }
        Ok(best)
    }
}
