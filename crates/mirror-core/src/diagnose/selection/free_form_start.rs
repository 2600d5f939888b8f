//! Where the search with free-form errors begins: at the causes and free-form errors that are most probable in one
//! linear model of what was found.

use crate::diagnose::effects::hypothesis::Model;
use crate::diagnose::selection::competing::Competing;
use crate::diagnose::selection::linear_search::LinearSearch;
use crate::diagnose::selection::reduced_equations::Reduced;
use crate::diagnose::selection::search::{Found, Search};
use crate::error::Result;

/// A set of causes and free-form errors, to first order.
pub(super) struct LinearChoice {
    pub model: Model,
    /// Whether a free-form error is among them.
    pub has_free: bool,
    /// Log posterior odds against the causes found.
    pub log_odds: f64,
    /// By how much the causes found raise the log posterior of the model without any.
    pub gain: f64,
}

/// The most probable set of causes and free-form errors, at most as many as the search may find, beside what a model has besides causes; it is looked for
/// from the causes found and from nothing. None where numbers overflow.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(super) fn free_form_start(wide: &Search<'_>, found: &Found) -> Result<Option<LinearChoice>> {
    let model = &found.fit.model;
    let scored = wide.sums_at(model, found.noise)?;
    let all: Vec<usize> = (0..model.terms.len()).collect();
    let (in_place, beside) = (wide.ranked(&scored, &all), wide.ranked(&scored, &[]));
    let competing = Competing::in_place_or_beside(&in_place.screening.scores, &beside.screening.scores);
    let mut linear = LinearSearch::new((wide, model, found.noise), None, &competing, &[wide.frames()])?;
    linear.most_causes = wide.options.most_causes;
    let whole = linear.sum(&[1.0]);
    let best = || {
        let reduced = Reduced::of(&whole, &linear.always)?;
        let (own, nothing) = (linear.log_posterior(&reduced, &all)?, linear.log_posterior(&reduced, &[])?);
        let starts =
            if all.len() <= linear.most_causes { vec![all.clone(), Vec::new()] } else { vec![Vec::new()] };
        let ends = starts.into_iter().filter_map(|start| {
            let set = linear.searched(&reduced, start)?;
            Some((linear.log_posterior(&reduced, &set)?, set))
        });
        let (posterior, set) = ends.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let is_free = |&c: &usize| wide.catalogue.is_free(linear.candidates[c].hypothesis);
        Some(LinearChoice {
            has_free: set.iter().any(is_free),
            model: linear.model_with(wide, model, (&whole, &set)),
            log_odds: posterior - own,
            gain: own - nothing,
        })
    };
    Ok(best())
}
