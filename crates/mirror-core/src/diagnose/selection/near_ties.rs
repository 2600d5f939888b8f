//! Near ties: two causes were about as probable, and one was added. A tilted axis may replace a zero and a gear
//! together: then the model has one cause too few, and no exchange of one cause for one leads to the right model. So
//! the cause that was not added is tried with one further cause.

use crate::diagnose::effects::hypothesis::{Model, Term};
use crate::diagnose::likelihood::fit::Fit;
use crate::diagnose::model::solver::SOLVER;
use crate::diagnose::model::work_budget::A_STAGE;
use crate::diagnose::principles::LEAST_LOG_ODDS;
use crate::diagnose::selection::nonparametric::log_odds;
use crate::diagnose::selection::search::{Found, Search};
use crate::diagnose::selection::with_setup::suffices;
use crate::error::Result;

/// Repeats the search from the other cause of each near tie if the model is more probable with it.
///
/// # Errors
/// Invalid parameters of the camera or mirror.
pub(crate) fn from_near_ties(search: &mut Search<'_>, found: &mut Found) -> Result<()> {
    if search.ties.is_empty() {
        return Ok(());
    }
    // What is left so far, and, where causes explain all, the share of free-form errors, which have little to do then.
    let stages = if suffices(search, found)? { 1.0 } else { 2.0 };
    search.problem.budget.allow(1.0 - stages * A_STAGE);
    for (taken, other) in core::mem::take(&mut search.ties) {
        if search.problem.budget.is_spent() {
            break;
        }
        let terms = &found.fit.model.terms;
        let position = |hypothesis: usize| terms.iter().position(|t| t.hypothesis == hypothesis);
        let Some(at) = position(taken).filter(|_| position(other.hypothesis).is_none()) else { continue };
        let name = |hypothesis: usize| search.catalogue.name(&search.problem.scene, hypothesis);
        let what = format!("from {} instead of {}", name(other.hypothesis), name(taken));
        let Some(start) = likelier_with(search, found, at, other)? else { continue };
        let mut again = search.clone();
        let mut result = again.run(start)?;
        let odds = log_odds((&again, &result), (search, found))?;
        found.trace.push(format!("{what}: log odds {odds:.1}"));
        if odds > 0.0 {
            result.trace.splice(0..0, core::mem::take(&mut found.trace));
            (*search, *found) = (again, result);
        }
    }
    // Where the searches from here met others, these lead no farther.
    search.ties.clear();
    Ok(())
}

/// The model with the other cause in place of the one that was added, and the most probable further one, if that is
/// more probable than what was found. If the two stay equally probable they are alternatives of each other.
fn likelier_with(search: &Search<'_>, found: &Found, at: usize, other: Term) -> Result<Option<Model>> {
    let mut rest = search.taken_out(&found.fit.model, at, found.noise)?;
    if rest.terms.len() + 1 >= search.options.most_causes {
        return Ok(None);
    }
    rest.terms.push(other);
    let here = search.fit_with_slack(&found.fit.model, Some(at), found.noise, 0)?;
    let exchanged = search.fit(&rest, found.noise, SOLVER.candidate_steps)?;
    let more = search.candidates(&exchanged.model, found.noise, 1, None)?;
    let likelier = |fit: &Fit| search.log_posterior(fit) > search.log_posterior(&here) + LEAST_LOG_ODDS;
    Ok(more.into_iter().find(likelier).map(|fit| fit.model))
}
