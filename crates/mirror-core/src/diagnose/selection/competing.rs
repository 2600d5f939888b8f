//! The hypotheses that compete with the causes of a model in one linear model.

use crate::diagnose::effects::hypothesis::Term;
use crate::diagnose::likelihood::score_test::Score;
use crate::diagnose::principles::Size;
use crate::diagnose::selection::standing::Standing;

/// Number of hypotheses that compete with the causes found.
const COMPETING: Size = 28;
/// Hypotheses that compete with the causes of a model, the most promising first.
#[derive(Default)]
pub(crate) struct Competing {
    pub hypotheses: Vec<(usize, f64)>,
    /// The first so many were found without small errors everywhere: the search starts from them, too.
    pub found: usize,
    /// How many of them compete at most.
    pub most: usize,
    /// Whether free-form errors compete too; otherwise those of the model stay in it.
    pub free_forms: bool,
}

impl Competing {
    /// All of these hypotheses.
    pub fn all(hypotheses: impl Iterator<Item = (usize, f64)>) -> Self {
        Self { hypotheses: hypotheses.collect(), most: usize::MAX, ..Self::default() }
    }

    /// The causes' alternatives, and the highest-ranked hypotheses of the first screening but those that are outdone.
    pub fn of(standings: &[Option<Standing>], ranking: &[Score]) -> Self {
        let rivals = standings.iter().flatten().flat_map(|s| &s.rivals).map(|r| (r.hypothesis, r.variant));
        let outdone = |h: usize| standings.iter().flatten().any(|s| s.outdone.contains(&h));
        let first_look = ranking.iter().map(|s| (s.hypothesis, s.variant)).take(4 * COMPETING);
        let first_look = first_look.filter(|(hypothesis, _)| !outdone(*hypothesis));
        Self { hypotheses: rivals.chain(first_look).collect(), most: COMPETING, ..Self::default() }
    }

    /// Causes that were found, and the highest-ranked hypotheses of a screening.
    pub fn with_found(found: &[Term], ranking: &[Score]) -> Self {
        let mut hypotheses: Vec<(usize, f64)> = found.iter().map(|t| (t.hypothesis, t.variant)).collect();
        let count = hypotheses.len();
        hypotheses.extend(ranking.iter().map(|s| (s.hypothesis, s.variant)));
        Self { hypotheses, found: count, most: COMPETING, free_forms: false }
    }

    /// The highest-ranked hypotheses of two screenings, free-form errors among them: in the place of all causes, and beside
    /// them.
    pub fn in_place_or_beside(in_place: &[Score], beside: &[Score]) -> Self {
        let both = in_place.iter().zip(beside).flat_map(|(one, other)| [one, other]);
        let hypotheses = both.map(|s| (s.hypothesis, s.variant)).collect();
        Self { hypotheses, found: 0, most: COMPETING, free_forms: true }
    }
}
