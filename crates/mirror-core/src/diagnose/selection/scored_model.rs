//! A model with the sums of the score test at it. They rank what could be added, what could take a cause's place, and
//! tell whether a cause is beyond doubt, in one pass over the frames instead of one for each question.

use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::likelihood::fit::{Active, Group};
use crate::diagnose::likelihood::linearised::Linearised;
use crate::diagnose::likelihood::score_sums::ScoreSums;
use crate::diagnose::likelihood::score_test::{Screening, scored};
use crate::diagnose::model::problem::Noise;
use crate::diagnose::principles::Guard;
use crate::diagnose::random_effects::law_discrepancy::slack_counts;
use crate::diagnose::selection::search::Search;
use crate::error::Result;

/// Sums serve at another noise that differs by less than this share: hypotheses are ranked with them, not fitted.
const SAME_NOISE: Guard = 0.02;

/// A model with the sums of the score test, the discrepancy terms of its causes' laws among its columns.
pub(super) struct ScoredModel {
    model: Model,
    noise: Noise,
    sums: ScoreSums,
    /// By cause: its parameters and its law's discrepancy terms, as indices of the model's columns.
    own: Vec<Own>,
}

struct Own {
    parameters: Vec<usize>,
    slack: Vec<usize>,
}

/// What the score test tells of a model, or of a model without some of its causes.
pub(super) struct Ranked {
    /// The model without the causes, the others where they are best without them, to first order.
    pub model: Model,
    /// The same with room for the values of the laws' discrepancy terms, which the group has.
    pub start: Model,
    pub group: Group,
    pub active: Active,
    pub screening: Screening,
}

impl ScoredModel {
    /// The sums at a model.
    ///
    /// # Errors
    /// Invalid parameters of the camera or mirror.
    pub fn at(search: &Search<'_>, model: &Model, noise: Noise) -> Result<Self> {
        let (problem, catalogue) = (&search.problem, search.catalogue);
        let (group, start) = search.loosened(model, None);
        let sums = ScoreSums::at(problem, catalogue, &group, &start, noise, search.mask)?;
        let (mut slack_at, mut at) = (sums.active.first_group + model.group.len(), sums.active.first_term);
        let counts = slack_counts(problem, catalogue, model);
        let own = model.terms.iter().zip(counts).map(|(term, slack)| {
            let own = Own {
                parameters: (at..at + term.parameters.len()).collect(),
                slack: (slack_at..slack_at + slack).collect(),
            };
            (at, slack_at) = (at + term.parameters.len(), slack_at + slack);
            own
        });
        let own = own.collect();
        Ok(Self { model: model.clone(), noise, sums, own })
    }

    /// Whether the sums are those of a model at a noise.
    pub fn is_of(&self, model: &Model, noise: Noise) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= SAME_NOISE * b.abs();
        let mine = (&self.model, self.noise);
        mine.0.terms == model.terms
            && mine.0.group == model.group
            && mine.0.nuisances == model.nuisances
            && near(mine.1.corner_px, noise.corner_px)
            && near(mine.1.marker_px, noise.marker_px)
            && near(mine.1.point_m, noise.point_m)
    }

    /// The hypotheses ranked in addition to the model's causes but `out`, which are taken out of it.
    pub fn without(&self, search: &Search<'_>, out: &[usize]) -> Ranked {
        let catalogue = search.catalogue;
        let removed: Vec<usize> = out
            .iter()
            .flat_map(|&i| self.own[i].parameters.iter().chain(&self.own[i].slack))
            .copied()
            .collect();
        let mut model = self.model.clone();
        let mut at = 0..model.terms.len();
        model.terms.retain(|_| at.next().is_none_or(|i| !out.contains(&i)));
        let known: Vec<usize> = model.terms.iter().map(|t| t.hypothesis).collect();
        let screening = scored(&self.sums, catalogue, &known, &removed);
        let (group, mut start) = search.loosened(&model, None);
        let active = Active::of(&search.problem, catalogue, &group, &start);
        if !out.is_empty()
            && let Some(values) = screening.at_rest()
        {
            let mut moved = Model { planes: None, ..active.model(&start, &values) };
            moved.group.truncate(model.group.len());
            if search.can_be(&moved) {
                start = moved.clone();
                start.group.resize(group.columns.len(), 0.0);
                model = moved;
            }
        }
        Ranked { model, start, group, active, screening }
    }

    /// The model's normal equations without the discrepancy terms of the i-th cause's law, and where that cause's
    /// parameters are; none where the sums see more of the boards than a fit of the model does.
    pub fn in_question(&self, i: usize) -> Option<(Linearised, core::ops::Range<usize>)> {
        let own = &self.own[i];
        let kept: Vec<usize> =
            (0..self.sums.active.values.len()).filter(|k| !own.slack.contains(k)).collect();
        let first = own.parameters.first()? - own.slack.len();
        let sums = &self.sums;
        let of = Linearised::among((&sums.h, &sums.g, sums.cost), &sums.active, &kept);
        sums.comparable.then_some((of, first..first + own.parameters.len()))
    }
}

impl Search<'_> {
    /// The sums at a model: those at hand if they are its own, else summed anew.
    pub(super) fn scored<'s>(
        &self,
        at_hand: &'s mut Option<ScoredModel>,
        model: &Model,
        noise: Noise,
    ) -> Result<&'s ScoredModel> {
        let fresh = match at_hand.take() {
            Some(scored) if scored.is_of(model, noise) => scored,
            _ => ScoredModel::at(self, model, noise)?,
        };
        Ok(at_hand.insert(fresh))
    }
}
