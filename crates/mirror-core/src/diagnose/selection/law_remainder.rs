//! Whether the remainder is only the error of the causes' own laws; no law of a real joint is exact.

use crate::diagnose::criteria::cross_validation::{PostureGap, seen_size};
use crate::diagnose::criteria::marker_shift::marker_shift;
use crate::diagnose::effects::Place;
use crate::diagnose::effects::hypothesis::{Catalogue, Model, Term};
use crate::diagnose::principles::{Count, SEVERAL_CAUSES};
use crate::diagnose::random_effects::law_columns::LAW_SHARE;
use crate::diagnose::selection::nonparametric::{are_together, elsewhere};
use crate::diagnose::selection::search::{Found, Search};
use crate::error::Result;

/// More causes than this at once are rather many small errors.
pub(crate) const MANY_CAUSES: Count = SEVERAL_CAUSES + 1;

/// Whether free-form errors only show that the causes found do not follow their textbook laws exactly: they are at
/// the causes' own places, and what they explain in addition is a small part of what the causes move.
///
/// More causes than those of the other model, or several at the place of a free-form error, are pieces that may together imitate one law. They are not where each of its places has one
/// cause, and these alone, without the others, leave as little. Optics have no laws that are only nearly followed.
pub(crate) fn only_their_laws(
    search: &Search<'_>,
    found: &Found,
    (its_search, with_free): (&Search<'_>, &Found),
    all: &Catalogue,
) -> Result<bool> {
    let (own, other) = (&found.fit.model, &with_free.fit.model);
    if elsewhere(all, other, own) {
        return Ok(false);
    }
    let of_optics =
        |t: &Term| matches!(all.hypotheses[t.hypothesis].place, Place::Camera | Place::Board | Place::Mirror);
    if other.terms.iter().any(|t| all.is_free(t.hypothesis) && of_optics(t)) {
        return Ok(false);
    }
    let place = |t: &Term| all.hypotheses[t.hypothesis].place;
    let causes_at = |t: &Term| own.terms.iter().filter(|c| are_together(place(c), place(t))).count();
    let mut at_its_places = own.clone();
    if own.terms.len() > other.terms.len() {
        if other.terms.iter().any(|t| causes_at(t) != 1) {
            return Ok(false);
        }
        at_its_places.terms.retain(|c| other.terms.iter().any(|t| are_together(place(c), place(t))));
    } else if other.terms.iter().any(|t| all.is_free(t.hypothesis) && causes_at(t) > 1) {
        return Ok(false);
    }
    if !(1..=MANY_CAUSES).contains(&at_its_places.terms.len()) {
        return Ok(false);
    }
    let after = search.held_out(&at_its_places, found.noise)?;
    let after_free = its_search.held_out(other, with_free.noise)?;
    // A law errs by a part of what its own cause moves, not of what another one does.
    let errs = |c: &Term| {
        let mut free = other.terms.iter().filter(|t| all.is_free(t.hypothesis));
        free.any(|t| are_together(place(c), place(t)))
    };
    let mut others = at_its_places;
    others.terms.retain(|c| !errs(c));
    Ok(remainder_share(search, found, (&others, &after), &after_free)? < LAW_SHARE.powi(2))
}

/// The remainder above the noise, or above the `least` of another model, squared, as a share of what the causes move beside `others`.
fn remainder_share(
    search: &Search<'_>,
    found: &Found,
    (others, after): (&Model, &[PostureGap]),
    least: &[PostureGap],
) -> Result<f64> {
    let noise = search.measured_noise;
    let (from, to) = (search.deformation(others), search.deformation(&found.fit.model));
    let moved = marker_shift(&search.problem, &from, &to, noise)?;
    let moved = moved.iter().sum::<f64>() / moved.len().max(1) as f64;
    let unit = search.problem.of_observations(noise);
    let axes = if search.problem.camera.is_some() { 2.0 } else { 3.0 };
    let square = |gaps: &[PostureGap]| (seen_size(gaps) / unit).powi(2);
    let left = square(after) - square(least).max(axes);
    Ok(if moved > 0.0 { left.max(0.0) / moved } else { f64::INFINITY })
}
