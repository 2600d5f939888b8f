//! What the score test tells of a model, or of a model without some of its causes.

use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::likelihood::fit::Group;
use crate::diagnose::likelihood::score_sums::ScoreSums;
use crate::diagnose::likelihood::score_test::{Screening, scored};
use crate::diagnose::model::problem::Noise;
use crate::diagnose::random_effects::law_discrepancy::slack_of_each;
use crate::diagnose::selection::scored_model::ScoredModel;
use crate::diagnose::selection::search::Search;
use crate::error::Result;

/// The hypotheses ranked in addition to a model.
pub(super) struct Ranked {
    /// The model without the causes that were taken out, the others where they are best without them, to first order.
    pub model: Model,
    /// The same with room for the values of the laws' discrepancy terms, which the group has.
    pub start: Model,
    pub group: Group,
    pub screening: Screening,
}

impl Search<'_> {
    /// The sums at a model; at the nominal one those that are known.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub(super) fn sums_at(&self, model: &Model, noise: Noise) -> Result<ScoredModel> {
        let (problem, catalogue) = (&self.problem, self.catalogue);
        let known = self.nominal_sums.as_ref().filter(|_| self.mask.is_none());
        if let Some(known) = known.filter(|known| known.are_of(problem, catalogue, model, noise)) {
            return Ok(ScoredModel::new(model, noise, known.sums.clone(), Vec::new()));
        }
        let (group, start) = self.loosened(model, None);
        let sums = ScoreSums::at(problem, catalogue, &group, &start, noise, self.mask)?;
        let slack = slack_of_each(problem, catalogue, model, sums.active.first_group);
        Ok(ScoredModel::new(model, noise, sums, slack))
    }

    /// The sums at a model: those at hand if they are its own, else summed anew.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub(super) fn scored<'s>(
        &self,
        at_hand: &'s mut Option<ScoredModel>,
        model: &Model,
        noise: Noise,
    ) -> Result<&'s ScoredModel> {
        let fresh = match at_hand.take() {
            Some(scored) if scored.is_of(model, noise) => scored,
            _ => self.sums_at(model, noise)?,
        };
        Ok(at_hand.insert(fresh))
    }

    /// The hypotheses ranked in addition to a model's causes but `out`, which are taken out of it.
    pub(super) fn ranked(&self, of: &ScoredModel, out: &[usize]) -> Ranked {
        let mut model = of.model.clone();
        let mut at = 0..model.terms.len();
        model.terms.retain(|_| at.next().is_none_or(|i| !out.contains(&i)));
        let known: Vec<usize> = model.terms.iter().map(|t| t.hypothesis).collect();
        let screening = scored(&of.sums, self.catalogue, &known, &of.columns_of(out));
        let (group, mut start) = self.loosened(&model, None);
        if !out.is_empty()
            && let Some(values) = screening.at_rest()
        {
            let mut moved = Model { planes: None, ..screening.active.model(&start, &values) };
            moved.group.truncate(model.group.len());
            if self.can_be(&moved) {
                start = moved.clone();
                start.group.resize(group.columns.len(), 0.0);
                model = moved;
            }
        }
        Ranked { model, start, group, screening }
    }
}
