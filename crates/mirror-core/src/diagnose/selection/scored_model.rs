//! A model with the sums of the score test at it. They rank what could be added, what could take a cause's place, and
//! tell whether a cause is beyond doubt, in one pass over the frames instead of one for each question.

use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::likelihood::linearised::Linearised;
use crate::diagnose::likelihood::nominal_sums::serve_at;
use crate::diagnose::likelihood::score_sums::ScoreSums;
use crate::diagnose::model::problem::Noise;
use core::ops::Range;

/// A model with the sums of the score test, the discrepancy terms of its causes' laws among its columns.
pub(super) struct ScoredModel {
    pub model: Model,
    pub sums: ScoreSums,
    noise: Noise,
    /// By cause: its parameters and its law's discrepancy terms, as indices of the model's columns.
    own: Vec<Own>,
}

struct Own {
    parameters: Range<usize>,
    slack: Range<usize>,
}

impl ScoredModel {
    /// A model with its sums, and where each cause's discrepancy terms are.
    pub fn new(model: &Model, noise: Noise, sums: ScoreSums, slack: Vec<Range<usize>>) -> Self {
        let mut at = sums.active.first_term;
        let own = model.terms.iter().zip(slack).map(|(term, slack)| {
            let parameters = at..at + term.parameters.len();
            at = parameters.end;
            Own { parameters, slack }
        });
        let own = own.collect();
        Self { model: model.clone(), noise, sums, own }
    }

    /// Whether the sums are those of a model at a noise.
    pub fn is_of(&self, model: &Model, noise: Noise) -> bool {
        self.model.terms == model.terms
            && self.model.group == model.group
            && self.model.nuisances == model.nuisances
            && serve_at(self.noise, noise)
    }

    /// The columns of some causes and of their laws' discrepancy terms.
    pub fn columns_of(&self, causes: &[usize]) -> Vec<usize> {
        let own = |&i: &usize| self.own[i].parameters.clone().chain(self.own[i].slack.clone());
        causes.iter().flat_map(own).collect()
    }

    /// The model's normal equations without the discrepancy terms of the i-th cause's law, and where that cause's
    /// parameters are; none where the sums see more of the boards than a fit of the model does.
    pub fn in_question(&self, i: usize) -> Option<(Linearised, Range<usize>)> {
        let (own, sums) = (&self.own[i], &self.sums);
        let kept: Vec<usize> = (0..sums.active.values.len()).filter(|k| !own.slack.contains(k)).collect();
        let first = own.parameters.start - own.slack.len();
        let of = Linearised::among((&sums.h, &sums.g, sums.cost), &sums.active, &kept);
        sums.comparable.then_some((of, first..first + own.parameters.len()))
    }
}
