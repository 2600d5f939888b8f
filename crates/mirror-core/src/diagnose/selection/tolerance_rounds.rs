//! Rounds in which the scales of small errors everywhere, the noise, and the causes beside them are found in turn.

use crate::diagnose::effects::hypothesis::{Model, Term};
use crate::diagnose::likelihood::fit::{Fit, FitOptions};
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::principles::Size;
use crate::diagnose::random_effects::geometric_tolerances::{Geometry, SPREADS_SETTLED};
use crate::diagnose::selection::linear_start::linear_start;
use crate::diagnose::selection::nonparametric::log_odds;
use crate::diagnose::selection::search::{Found, Search};
use crate::error::Result;

/// Rounds in which scales, noise and causes are found in turn: two or three are usual.
const MOST_ROUNDS: Size = 5;
/// The same where causes are added one at a time, each round of which is a whole search.
const GREEDY_ROUNDS: Size = 2;

/// Causes beside small errors everywhere, with these and the noise in turn, each set chosen in one linear model and then
/// fitted; none where a choice is not borne out by its fit. `start` is a fit with small errors everywhere alone, `alone` are
/// the causes found without them; it and the scales are then at the last choice that was borne out.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(super) fn linear_rounds(
    (search, geometry): (&mut Search<'_>, &mut Geometry),
    start: &mut Fit,
    alone: &Found,
) -> Result<Option<Found>> {
    let mut trace = Vec::new();
    let mut known = alone.fit.model.terms.clone();
    for round in 0..MOST_ROUNDS {
        if round > 0 && search.problem.budget.is_spent() {
            break;
        }
        let options = FitOptions { noise: search.effective(&start.model)?, steps: SOLVER.candidate_steps };
        let before = geometry.clone();
        // Scales and noise first: what the scatter of single causes hides is no choice yet.
        *start = geometry.fit(&search.problem, search.catalogue, &start.model, options, search.mask)?;
        search.group = geometry.group.clone();
        let settled = geometry.change_from(&before) < SPREADS_SETTLED;
        let from = (&start.model, options.noise);
        let next = linear_start(search, geometry, from, &core::mem::take(&mut known))?;
        if same_causes(&next, &start.model) {
            if settled {
                break;
            }
            continue;
        }
        let (mut with, mut its) = (search.clone(), geometry.clone());
        let fit = its.fit(&search.problem, search.catalogue, &next, options, search.mask)?;
        with.group = its.group.clone();
        let found = |fit: &Fit, search: &Search<'_>| -> Result<Found> {
            let noise = search.effective(&fit.model)?;
            Ok(Found { fit: fit.clone(), noise, trace: Vec::new(), cut_off: false })
        };
        if log_odds((&with, &found(&fit, &with)?), (search, &found(start, search)?))? <= 0.0 {
            return Ok(None);
        }
        (*search, *geometry, *start) = (with, its, fit);
        let name = |t: &Term| search.catalogue.name(&search.problem.scene, t.hypothesis);
        let names: Vec<String> = start.model.terms.iter().map(name).collect();
        trace.push(format!("beside small errors everywhere: {}", names.join(", ")));
    }
    let noise = search.effective(&start.model)?;
    // Other values of discrete unknowns are compared at this noise.
    let fit = search.fit(&start.model, noise, SOLVER.final_steps)?;
    Ok(Some(Found { fit: search.settle(fit, noise)?, noise, trace, cut_off: false }))
}

/// The same from a model with causes added one at a time, each fitted, at the scales of the round before.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(super) fn one_at_a_time(
    (search, geometry): (&mut Search<'_>, &mut Geometry),
    mut start: Model,
) -> Result<Found> {
    let mut round = 0;
    loop {
        search.group = geometry.group.clone();
        let before = geometry.clone();
        let mut found = search.run(start)?;
        let options = FitOptions { noise: found.noise, steps: SOLVER.candidate_steps };
        found.fit =
            geometry.fit(&search.problem, search.catalogue, &found.fit.model, options, search.mask)?;
        round += 1;
        let settled = geometry.change_from(&before) < SPREADS_SETTLED;
        if round == GREEDY_ROUNDS || settled || search.problem.budget.is_spent() {
            search.group = geometry.group.clone();
            return Ok(found);
        }
        start = found.fit.model;
    }
}

/// Whether two models have the same causes.
fn same_causes(one: &Model, other: &Model) -> bool {
    let has = |model: &Model, term: &Term| model.terms.iter().any(|t| t.hypothesis == term.hypothesis);
    one.terms.len() == other.terms.len() && one.terms.iter().all(|t| has(other, t))
}
