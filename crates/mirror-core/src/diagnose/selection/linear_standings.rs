//! The probabilities of causes beside small errors everywhere, or of many causes at the limit of work, and of the alternatives
//! in each one's place, by one linear model.
//!
//! A fit with a hundred small errors is expensive, and an alternative in a cause's place needs several. All of them are
//! in one linear model at the causes found ([`LinearSearch`]): what is always free is eliminated, and each comparison
//! has as many unknowns as there are causes. A cause and its alternatives are compared with discrepancy terms of the
//! other causes' laws, not of its own.

use crate::diagnose::principles::{TEMPER, UNTHOUGHT_OF};
use crate::diagnose::random_effects::geometric_tolerances::Geometry;
use crate::diagnose::selection::competing::Competing;
use crate::diagnose::selection::linear_search::LinearSearch;
use crate::diagnose::selection::reduced_equations::Reduced;
use crate::diagnose::selection::search::{Found, Search, SearchOptions};
use crate::diagnose::selection::standing::{RIVALS, Rival, Standing};
use crate::error::Result;

/// The standings of all causes; none of free-form errors, and where numbers overflow.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(super) fn linear_standings(
    search: &Search<'_>,
    found: &Found,
    geometry: Option<&Geometry>,
) -> Result<Vec<Option<Standing>>> {
    let (model, catalogue) = (&found.fit.model, search.catalogue);
    let named =
        Search { options: SearchOptions { named_only: true, ..search.options.clone() }, ..search.clone() };
    let mut rivals = Vec::new();
    for (i, term) in model.terms.iter().enumerate() {
        rivals.push(if catalogue.is_free(term.hypothesis) {
            Vec::new()
        } else {
            // At the noise that the model without the cause leaves: all that it explains would look false otherwise.
            let rest = named.taken_out(model, i, found.noise)?;
            let coarse = named.effective(&rest)?;
            let scores = named.scores(&rest, coarse)?;
            let promising = named.most_promising(&scores, RIVALS, Some(term.hypothesis));
            promising.iter().map(|s| (s.hypothesis, s.variant)).filter(|r| r.0 != term.hypothesis).collect()
        });
    }
    let competing = Competing::all(rivals.iter().flatten().copied());
    let linear = LinearSearch::new((search, model, found.noise), geometry, &competing, &[search.frames()])?;
    let equations = linear.sum(&[1.0]);
    let reduced = Reduced::of(&equations, &linear.always);
    let of_term = |i: usize| {
        reduced.as_ref().and_then(|reduced| {
            let place = linear.candidates.iter().position(|c| c.hypothesis == model.terms[i].hypothesis)?;
            standing(&linear, reduced, place, &rivals[i])
        })
    };
    Ok((0..model.terms.len()).map(of_term).collect())
}

/// The probability of a cause, of alternatives in its place, and of nothing there; none where numbers overflow.
fn standing(
    linear: &LinearSearch,
    reduced: &Reduced,
    place: usize,
    rivals: &[(usize, f64)],
) -> Option<Standing> {
    let others: Vec<usize> = (0..linear.found).filter(|&c| c != place).collect();
    let base = linear.base(reduced, &others, None)?;
    let own = linear.odds((reduced, &base), &others, place);
    let ahead = |candidate: usize| linear.odds((reduced, &base), &others, candidate) - own;
    let weight = |log: f64| (TEMPER * log).min(50.0).exp();
    let nothing = weight(-own);
    let weighed: Vec<(usize, f64, f64)> = rivals
        .iter()
        .filter_map(|&(hypothesis, variant)| {
            let candidate = linear.candidates.iter().position(|c| c.hypothesis == hypothesis)?;
            (candidate >= linear.found).then(|| (hypothesis, variant, weight(ahead(candidate))))
        })
        .collect();
    let total = 1.0 + nothing + weighed.iter().map(|w| w.2).sum::<f64>();
    let scale = (1.0 - UNTHOUGHT_OF) / total;
    let rival =
        |(hypothesis, variant, w): (usize, f64, f64)| Rival { hypothesis, variant, probability: w * scale };
    Some(Standing::of(scale, weighed.into_iter().map(rival).collect(), nothing * scale))
}
