//! Where the search beside small errors everywhere begins: at the causes that are most probable in one linear model.
//!
//! Small errors everywhere can imitate any cause, at large scales. A cause is told by how much smaller it leaves them, so
//! the scales are estimated anew with each set of causes that is compared. A search that adds one cause at a time, at
//! the scales that the others leave, fits each of them a hundred times and may still miss that; in one linear model
//! ([`LinearSearch`]) whole sets are compared, from nothing and from the causes that were found without small errors.

use crate::diagnose::effects::hypothesis::{Model, Term};
use crate::diagnose::model::problem::Noise;
use crate::diagnose::principles::Size;
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::selection::competing::Competing;
use crate::diagnose::selection::linear_scales::WeighedSet;
use crate::diagnose::selection::linear_search::{LinearSearch, is_same_set};
use crate::diagnose::selection::reduced_equations::Equations;
use crate::diagnose::selection::search::Search;
use crate::error::Result;

/// Of the causes that could be added, so many are weighed with the scales that they leave.
const WEIGHED: Size = 6;
/// Sets that follow one another from one start.
const MOST_SETS: Size = 8;

/// The model `start` of small errors everywhere, fitted, with the causes that are most probable beside them; `alone` are the causes found
/// without them.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn linear_start(
    search: &Search<'_>,
    geometry: &Geometry,
    (start, noise): (&Model, Noise),
    alone: &[Term],
) -> Result<Model> {
    let ranking = search.scores(start, noise)?;
    let competing = Competing::with_found(alone, &ranking);
    let mut linear =
        LinearSearch::new((search, start, noise), Some(geometry), &competing, &[search.frames()])?;
    // In each round some are added to those of the round before: no more than any search may find.
    linear.most_causes = search.options.most_causes;
    let whole = linear.sum(&[1.0]);
    let from_found = most_probable(&linear, &whole, (0..linear.found).collect());
    let from_nothing = most_probable(&linear, &whole, Vec::new());
    let ends = [from_found, from_nothing].into_iter().flatten();
    let best = ends.max_by(|a, b| a.log_posterior.total_cmp(&b.log_posterior));
    Ok(best.map_or_else(
        || start.clone(),
        |best| linear.model_with(search, start, (&best.scaled.equations, &best.set)),
    ))
}

/// The set that the search ends at from another; none where numbers overflow.
fn most_probable(linear: &LinearSearch, whole: &Equations, start: Vec<usize>) -> Option<WeighedSet> {
    let mut best = linear.with_scales(whole, start)?;
    for _ in 0..MOST_SETS {
        let next = linear.searched(&best.scaled.reduced, best.set.clone())?;
        if !is_same_set(&next, &best.set) {
            best = linear.with_scales(whole, next)?;
        } else if let Some(wider) = with_one_more(linear, whole, &best) {
            best = wider;
        } else {
            break;
        }
    }
    Some(best)
}

/// The set with the cause that is most probable at the scales that it leaves; none where it is better without.
fn with_one_more(linear: &LinearSearch, whole: &Equations, than: &WeighedSet) -> Option<WeighedSet> {
    if than.set.len() >= linear.most_causes {
        return None;
    }
    let mut others = linear.additions(&than.scaled.reduced, &than.set, None)?;
    others.retain(|(_, odds)| odds.is_finite());
    others.sort_by(|x, y| y.1.total_cmp(&x.1));
    let wider = |c: usize| linear.with_scales(whole, than.set.iter().copied().chain([c]).collect());
    others
        .iter()
        .take(WEIGHED)
        .filter_map(|&(c, _)| wider(c))
        .max_by(|x, y| x.log_posterior.total_cmp(&y.log_posterior))
        .filter(|best| best.log_posterior > than.log_posterior + linear.least_log_odds)
}
