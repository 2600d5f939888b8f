//! The hypotheses that compete with the causes of a model in one linear model.

use crate::diagnose::effects::hypothesis::Term;
use crate::diagnose::likelihood::score_test::Score;
use crate::diagnose::principles::Size;
use crate::diagnose::selection::standing::Standing;

/// Number of hypotheses that compete with the causes found.
const COMPETING: Size = 28;
/// Hypotheses that compete with the causes of a model, the most promising first.
pub(crate) struct Competing {
    pub hypotheses: Vec<(usize, f64)>,
    /// The first so many were found without small errors everywhere: the search starts from them, too.
    pub found: usize,
    /// How many of them compete at most.
    pub most: usize,
}

impl Competing {
    /// All of these hypotheses.
    pub fn all(hypotheses: impl Iterator<Item = (usize, f64)>) -> Self {
        Self { hypotheses: hypotheses.collect(), found: 0, most: usize::MAX }
    }

    /// The causes' alternatives, and the highest-ranked hypotheses of the first screening.
    pub fn of(standings: &[Option<Standing>], ranking: &[Score]) -> Self {
        let rivals = standings.iter().flatten().flat_map(|s| &s.rivals).map(|r| (r.hypothesis, r.variant));
        let first_look = ranking.iter().map(|s| (s.hypothesis, s.variant)).take(4 * COMPETING);
        Self { hypotheses: rivals.chain(first_look).collect(), found: 0, most: COMPETING }
    }

    /// Causes that were found, and the highest-ranked hypotheses of a screening.
    pub fn with_found(found: &[Term], ranking: &[Score]) -> Self {
        let mut hypotheses: Vec<(usize, f64)> = found.iter().map(|t| (t.hypothesis, t.variant)).collect();
        let count = hypotheses.len();
        hypotheses.extend(ranking.iter().map(|s| (s.hypothesis, s.variant)));
        Self { hypotheses, found: count, most: COMPETING }
    }
}
